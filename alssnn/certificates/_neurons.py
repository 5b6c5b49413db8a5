"""Neurons of a loop: which of them count, what they see, and what pairs differ by.

Some neurons stand in a loop twice, at two points that are near, in the plant and in its
observer.  `twins` has for every neuron the number of the one of equal weights to which
its difference is taken, or -1.
"""

from dataclasses import replace

import numpy as np

from ..simulation import regressors

ROUNDING = 1e-13  # of the entries of a row: what is less is left by a cancellation


def differences(lure, twins):
    """Return the form in which neurons with twins are what they differ by.

    Parameters
    ----------
    lure : Lure
        Form of a loop.
    twins : sequence of int
        For every neuron the one that it is the difference to, or -1.

    Returns
    -------
    form : Lure
        Form of the same loop with other neurons.
    """
    Theta, first, column = lure.Theta.copy(), lure.nx + lure.nz, lure.nx + lure.nu
    for i, twin in enumerate(twins):
        if twin >= 0:  # w_i = w_twin + difference
            Theta[:, column + twin] += Theta[:, column + i]
            Theta[first + i] -= Theta[first + twin]
    return replace(lure, Theta=Theta)


def seen_at(lure, x, twins):
    """Return what neurons see at a state, without inputs.

    Parameters
    ----------
    lure : Lure
        Form of a loop.
    x : ndarray of shape (nx,)
        The state.
    twins : ndarray of int
        For every neuron the one that it is the difference to, or -1; may be empty.

    Returns
    -------
    seen : ndarray of shape (nw,)
        Of neurons with twins the difference.
    """
    Phi = regressors(lure, x[None], np.zeros((1, lure.nu)))[0]
    seen, paired = lure.rows_v @ Phi, np.flatnonzero(twins >= 0)
    seen[paired] -= seen[twins[paired]]
    return seen


def reaching(lure, nz, twins=()):
    """Return the numbers of the neurons that reach x+ or the first channels.

    Parameters
    ----------
    lure : Lure
        Form of a loop.
    nz : int
        Number of channels that count.
    twins : sequence of int, default=()
        For every neuron the one that it is the difference to, or -1.

    Returns
    -------
    live : ndarray of int
        The neurons; what a law cancels leaves rounding, which is none.
    """
    n = lure.nx + nz
    scale = np.abs(lure.Theta[:n, :-1]).max(axis=1, keepdims=True)
    live = np.any(np.abs(lure.W[:n]) > ROUNDING * scale, axis=0)
    while True:
        more = live | np.any(lure.E[live] != 0, axis=0)  # and those that they see
        for i, twin in enumerate(twins):
            more[twin] |= more[i] and twin >= 0
        if np.array_equal(more, live):
            return np.flatnonzero(live)
        live = more


def renumbered(twins, neurons):
    """Return the twins of the neurons of a `part`, by their numbers there.

    Parameters
    ----------
    twins : ndarray of int
        For every neuron of the whole the one that it is the difference to, or -1.
    neurons : ndarray of int
        The neurons that stay, in their new order.

    Returns
    -------
    twins : ndarray of int
        The same for those that stay.
    """
    place = np.full(len(twins) + 1, -1)  # the last one is that of no twin
    place[neurons] = np.arange(len(neurons))
    return place[twins[neurons]]

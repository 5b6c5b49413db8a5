"""Excursions: what a model does under inputs that its record does not have.

A record says nothing of larger inputs, and little of those that are held for longer.
There, a network may have a second attractor that no hidden sample speaks against.
"""

import numpy as np

from .simulation import outputs

LARGER = 1.25  # inputs over those of the record, with which a simulation has to stay
NEAR = 3.0  # outputs over the largest of the record
SETTLED = 0.01  # what a linear model has kept of its state, when held inputs change
LONGEST = 1_000  # samples for which inputs are held, at most
LEVELS = (0.1, 0.3, 0.5, 0.7, 0.9)  # quantiles of an input that are held
APART = 1.0  # standard deviations of an output between two places to rest


def settling(A):
    """Return for how many samples inputs are held (eq. latch).

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix of the linear model of a record.

    Returns
    -------
    n_held : int
        Until its slowest mode has come down to a hundredth; zero if that takes more
        than a thousand samples, for then the inputs are not held at all.
    """
    radius = np.abs(np.linalg.eigvals(A)).max(initial=0.0)
    if radius >= 1.0:
        return 0
    n_held = int(np.ceil(np.log(SETTLED) / np.log(max(radius, SETTLED))))
    return n_held if n_held <= LONGEST else 0


def leaves(structure, theta, x0, experiments, n_held=0):
    """Tell whether a model goes where nothing was measured, by one of two ways.

    Parameters
    ----------
    structure : Structure
        Structure of the model, y its first channel.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states of the experiments.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.
    n_held : int, default=0
        Samples for which inputs are held; zero does not hold them.

    Returns
    -------
    leaves : bool
        Whether it escapes or latches.
    """
    model = structure, theta, x0, experiments
    return escapes(*model) or (n_held > 0 and latches(*model, n_held))


def escapes(structure, theta, x0, experiments):
    """Tell whether larger inputs take a model far from its record (eq. escape).

    Parameters
    ----------
    structure : Structure
        Structure of the model, y its first channel.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states of the experiments.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.

    Returns
    -------
    escapes : bool
        Whether an output deviates from its mean by three times what it ever does in the
        record, while inputs deviate by a quarter more.
    """
    lure, ny = structure.lure(theta), structure.sizes["y"]
    u_mean = np.vstack([u[:] for u, _ in experiments]).mean(axis=0)
    y = np.vstack([y[:] for _, y in experiments])
    y_mean = np.nanmean(y, axis=0)
    # a constant output may move by its unit
    bound = NEAR * np.maximum(np.nanmax(np.abs(y - y_mean), axis=0), 1.0)
    for (u, _), start in zip(experiments, x0, strict=True):
        larger = u_mean + LARGER * (u[:] - u_mean)
        with np.errstate(over="ignore", invalid="ignore"):
            y_hat = outputs(lure, larger, structure.initial_state(start))[:, :ny]
        if not np.all(np.abs(y_hat - y_mean) <= bound):
            return True
    return False


def latches(structure, theta, x0, experiments, n_held):
    """Tell whether a model rests in two places under one held input (eq. latch).

    Parameters
    ----------
    structure : Structure
        Structure of the model, y its first channel.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states of the experiments.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    n_held : int
        Samples for which every input is held (`settling`).

    Returns
    -------
    latches : bool
        Whether an output remembers, by more than its standard deviation, from where an
        input came: down from the largest value of the record, or up from the least,
        where its deviation from the mean was a quarter more.
    """
    lure, ny = structure.lure(theta), structure.sizes["y"]
    start = structure.initial_state(x0[0])
    u = np.vstack([u[:] for u, _ in experiments])
    mean = u.mean(axis=0)

    def rests(first, levels):
        held = np.repeat([mean + LARGER * (first - mean), *levels], n_held, axis=0)
        with np.errstate(over="ignore", invalid="ignore"):
            return outputs(lure, held, start)[2 * n_held - 1 :: n_held, :ny]

    for u_j in u.T:
        order = np.argsort(u_j, kind="stable")
        levels = u[order[[int(level * (len(order) - 1)) for level in LEVELS]]]
        up = rests(u[order[0]], levels)
        down = rests(u[order[-1]], levels[::-1])[::-1]
        with np.errstate(invalid="ignore"):  # inf is what diverges
            if not np.all(np.abs(up - down) <= APART):
                return True
    return False

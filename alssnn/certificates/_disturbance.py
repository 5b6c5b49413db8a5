"""Bounds on the residual omega = g(x, v - h) that the linearized loop is left with.

In the Lur'e form g is what remains of x+ once A x + B u + B h is taken away,

    g = G w + c,    G = W - B K,   c = c_x - B k,    h = K w + k,

a function of the neurons alone. Observed along trajectories it gives a bound that
holds on the data; since every |w_i| < 1, the sup over the cube gives one that holds
everywhere (eq. lmi).  The same holds for every bounded activation.
"""

import numpy as np

from ..lure import Lure
from ..simulation import regressors, simulate

VERTICES = 16  # neurons of g up to which the 2^n corners of the cube are visited


def state_feedback(lure, K):
    """Return the form that the feedback v = r - K x makes, with input r.

    Parameters
    ----------
    lure : Lure
        Model.
    K : ndarray of shape (nu, nx)
        Gain.

    Returns
    -------
    lure : Lure
        The closed loop.

    Examples
    --------
    >>> from alssnn.certificates import state_feedback
    >>> from alssnn.lure import Lure
    >>> Theta = np.array([[1.5, 1.0, 0.0], [1.0, 0.0, 0.0]])
    >>> lure = Lure(Theta, nx=1, nu=1, nw=0)
    >>> state_feedback(lure, np.ones((1, 1))).M[0]  # x+ = (1.5 - 1) x + r
    array([0.5, 1. ])
    """
    Theta = lure.Theta.copy()
    Theta[:, : lure.nx] -= Theta[:, lure.nx : lure.nx + lure.nu] @ K
    return Lure(Theta, lure.nx, lure.nu, lure.nw, lure.sigma)


def global_bound(lure, B, feedback):
    """Bound ``|g|`` for all states and inputs, by the saturation of the neurons.

    Parameters
    ----------
    lure : Lure
        Model with the states x alone.
    B : ndarray of shape (nx, nu)
        Input matrix.
    feedback : tuple of ndarray
        Gain K and constant k of h = K w + k, shapes (nu, nw), (nu,).

    Returns
    -------
    eps : float
        The largest ``|G w + c|`` over the box of w, found at one of its corners, for up
        to 16 neurons in G; for more, the smallest of three upper bounds of it. inf if
        a neuron in G is unbounded.

    Examples
    --------
    >>> from alssnn.certificates import global_bound
    >>> from alssnn.lure import Lure
    >>> # x+ = x / 2 + u + g, g = 0.1 tanh(x)
    >>> Theta = np.array([[0.5, 1, 0.1, 0], [1, 0, 0, 0], [1, 0, 0, 0]])
    >>> lure, no_h = Lure(Theta, nx=1, nu=1, nw=1), (np.zeros((1, 1)), np.zeros(1))
    >>> global_bound(lure, np.ones((1, 1)), no_h)
    0.1
    """
    G, c = _residual(lure, B, feedback)
    bound = np.array([activation.bound for activation in lure.sigma])
    active = np.any(G != 0, axis=0)
    if np.isinf(bound[active]).any():
        return np.inf
    G = G[:, active] * bound[active]
    n = G.shape[1]
    if n <= VERTICES:
        # a convex function on a cube is largest at a corner
        corners = 2.0 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1) - 1.0
        return float(np.linalg.norm(corners @ G.T + c, axis=1).max())
    by_neuron = np.linalg.norm(c) + np.linalg.norm(G, axis=0).sum()
    by_state = np.linalg.norm(np.abs(c) + np.abs(G).sum(axis=1))
    by_norm = np.linalg.norm(c) + np.sqrt(n) * np.linalg.norm(G, 2)
    return float(min(by_neuron, by_state, by_norm))


def data_bound(lure, B, feedback, experiments, K=None):
    """Return the largest ``|omega|`` along records, open and closed loop.

    Parameters
    ----------
    lure : Lure
        Model with the states x alone and the input u, both deviations.
    B : ndarray of shape (nx, nu)
        Input matrix.
    feedback : tuple of ndarray
        Gain K and constant k of h = K w + k, shapes (nu, nw), (nu,).
    experiments : sequence of tuple of ndarray
        Tuples (u, x0) of shapes (N, nu), (nx,).
    K : ndarray of shape (nu, nx) or None, default=None
        State feedback v = r - K x of the closed loop, with the recorded input as r.

    Returns
    -------
    eps : float
        Largest ``|g|``, inf if a simulation diverges.

    Examples
    --------
    >>> from alssnn.certificates import data_bound
    >>> from alssnn.lure import Lure
    >>> # x+ = x / 2 + u + g, g = 0.1 tanh(x)
    >>> Theta = np.array([[0.5, 1, 0.1, 0], [1, 0, 0, 0], [1, 0, 0, 0]])
    >>> lure, no_h = Lure(Theta, nx=1, nu=1, nw=1), (np.zeros((1, 1)), np.zeros(1))
    >>> experiments = [(np.zeros((3, 1)), np.array([0.5]))]
    >>> round(data_bound(lure, np.ones((1, 1)), no_h, experiments), 4)
    0.0462
    """
    G, c = _residual(lure, B, feedback)
    loop = lure.close(*feedback)
    if K is not None:
        loop = state_feedback(loop, K)
    largest = 0.0
    for u, x0 in experiments:
        for form in (lure, loop):
            X = simulate(form, u, x0)[:-1]
            if not np.isfinite(X).all():
                return np.inf
            w = regressors(form, X, u)[:, form.nx + form.nu : -1]
            omega = np.linalg.norm(w @ G.T + c, axis=1)
            largest = max(largest, float(omega.max()))
    return largest


def _residual(lure, B, feedback):
    """Return G and c of g = G w + c; what only rounding leaves of B h is zero."""
    nx, (K, k) = lure.nx, feedback
    W, c = lure.W[:nx], lure.c[:nx]
    G, constant = W - B @ K, c - B @ k
    tiny = 64 * np.finfo(float).eps
    G = np.where(np.abs(G) <= tiny * (np.abs(W) + np.abs(B) @ np.abs(K)), 0.0, G)
    size = np.abs(c) + np.abs(B) @ np.abs(k)
    return G, np.where(np.abs(constant) <= tiny * size, 0.0, constant)

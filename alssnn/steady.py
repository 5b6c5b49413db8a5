"""The periodic state of a model: what it settles to under a periodic input.

After one period u_0, ..., u_N-1 the state of a settled model is back where it began,
x_N = x_0 (eq. steady).  Its derivative follows from the sensitivities of x_N,

    dx_0 / dtheta = (I - dx_N / dx_0)^-1 dx_N / dtheta,

so that the initial state of a periodic experiment is no unknown of a fit.
"""

import numpy as np

from .simulation import neuron_gains, regressors, trajectory

ITERATIONS = 60  # periods that are simulated until the state comes back
TOLERANCE = 1e-12  # of the state, from which it has come back


def steady_state(lure, u, initial_state, n_x0):
    """Return the state that comes back after one period (eq. steady).

    Parameters
    ----------
    lure : Lure
        Model.
    u : array of shape (N, nu)
        Inputs of one period; only sliced.
    initial_state : callable
        Returns the whole state of what is free of it, of shape (n_x0,); states behind
        do not act on these.
    n_x0 : int
        Number of first states, which come back.

    Returns
    -------
    x0 : ndarray of shape (n_x0,)
        These states at the first sample; nan if none were found.

    Notes
    -----
    Quasi-Newton steps (Broyden) from the slope of the model at the operating point: one
    step if the model is linear, however slow it is.
    """
    slope, plain = slope_at_rest(lure)[:n_x0, :n_x0], np.eye(n_x0)
    tries = [(plain, False)]  # waiting: networks may hold what the slope does not
    if np.abs(np.linalg.eigvals(slope)).max(initial=0.0) < 1:
        forward = np.linalg.matrix_power(slope, len(u))
        tries.insert(0, (np.linalg.inv(plain - forward), True))

    def miss(x):
        return _end(lure, u, initial_state(x))[:n_x0] - x

    for J, learns in tries:
        x = _root(miss, J, learns)
        if np.isfinite(x).all():
            break
    return x


@np.errstate(over="ignore", invalid="ignore")
def _root(miss, J, learns):
    """Return where a state comes back, by steps J times its miss; nan if nowhere."""
    x = np.zeros(len(J))
    d = miss(x)
    for _ in range(ITERATIONS):
        if not np.isfinite(d).all():
            break
        if np.abs(d).max(initial=0.0) <= TOLERANCE * (1 + np.abs(x).max(initial=0.0)):
            return x
        step = J @ d
        x = x + step
        before, d = d, miss(x)
        moved = J @ (before - d)
        if learns and (scale := step @ moved) != 0:
            J = J + np.outer(step - moved, step @ J) / scale
    return np.full_like(x, np.nan)


def eliminated(sums, end, n_params):
    """Return the sums over [J r] with the initial state eliminated.

    Parameters
    ----------
    sums : ndarray of shape (n + 1, n + 1)
        [J r]'[J r] by (theta, x0) and r, symmetric.
    end : ndarray of shape (nx, n)
        Derivative of the state after the last sample.
    n_params : int
        Number of parameters.

    Returns
    -------
    sums : ndarray of shape (n + 1, n + 1)
        The same with x0 following theta (eq. steady); zero in its own entries.
    """
    x0, D = slice(n_params, len(sums) - 1), follows(end, n_params)
    sums = sums.copy()
    sums[:, :n_params] += sums[:, x0] @ D
    sums[:n_params] += D.T @ sums[x0]
    sums[x0], sums[:, x0] = 0.0, 0.0
    return sums


def follows(end, n_params):
    """Return how the periodic initial state follows theta (eq. steady).

    Parameters
    ----------
    end : ndarray of shape (nx, n_params + n_x0)
        Derivative of the state after the last sample by (theta, x0).
    n_params : int
        Number of parameters.

    Returns
    -------
    dx0 : ndarray of shape (n_x0, n_params)
        Derivative of the initial state.
    """
    forward = end[: end.shape[1] - n_params]  # of the states that come back
    return np.linalg.solve(
        np.eye(len(forward)) - forward[:, n_params:], forward[:, :n_params]
    )


def slope_at_rest(lure):
    """Return dx+/dx at the operating point.

    Parameters
    ----------
    lure : Lure
        Model, whose signals are deviations.

    Returns
    -------
    slope : ndarray of shape (nx, nx)
        The derivative.
    """
    nx = lure.nx
    at_rest = regressors(lure, np.zeros((1, nx)), np.zeros((1, lure.nu)))
    return (
        lure.M[:nx, :nx] + neuron_gains(lure, lure.W[:nx], at_rest)[0] @ lure.V[:, :nx]
    )


def _end(lure, u, x0):
    """Return the state after one period; not finite if it diverges."""
    x = x0
    for _, _, X in trajectory(lure, u, x0):
        x = X[-1]
    return x

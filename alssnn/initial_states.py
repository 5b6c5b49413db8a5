"""Initial states of experiments, from their first samples."""

from functools import partial

import numpy as np

from .criterion import DIVERGED_NORM, Criterion, Restricted
from .mapping import Held
from .optimizers import minimize

INITIAL_STATE_STEPS = 20  # trial steps of an initial-state estimate
# Half and double change nothing on 3 of 4 plants, and make the test error of a network
# 7 % and 4 % larger on one (`python -m benchmarks.constants WINDOW --seeds 1`).
WINDOW = 200  # samples from which the initial state of a long record is restarted


def estimate_x0(structure, theta, experiments, *, window, noise):
    """Estimate the initial state of every experiment from its first samples.

    Maximum a posteriori: states have unit variance, outputs the variance `noise`
    around those of the model.  The prior matters where a window says little about a
    state that decays slowly; as the noise vanishes, it becomes least squares.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters, held.
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    window : int
        Number of samples used at the beginning of every experiment.
    noise : float
        Mean square of the output error of the model, outputs of unit variance.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states; zero where the model diverges within the window.
    """
    plain = structure.observe(structure.measured)
    one = partial(_estimate_one, plain, theta, window, noise)
    return np.reshape(Held.of(experiments).map(one), (-1, structure.n_x0))


def _estimate_one(structure, theta, window, noise, u, y):
    """Return the estimate of the initial state of one experiment."""
    u, y, x0 = u[:window], y[:window], np.zeros(structure.n_x0)
    if len(u) == 0:
        return x0  # an experiment too short to spend samples on it
    criterion = Criterion(structure, [(u, y)], x0_weight=noise / max(1, len(u)))
    mask = np.arange(criterion.n) >= structure.n_params
    problem = Restricted(criterion, criterion.join(theta, x0), mask)
    if not problem.norm(x0) < DIVERGED_NORM:
        return x0  # nothing to estimate: the caller's simulation will show it
    return minimize(problem, x0, max_iter=INITIAL_STATE_STEPS, tol=1e-8).x

"""Initial states of experiments, from their first samples (eq. start)."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import pinv

from .compression import compress
from .criterion import DIVERGED_NORM, Criterion, LeastSquares
from .experiments import gap
from .mapping import Held
from .optimizers import minimize
from .shown import short_repr
from .simulation import simulate

INITIAL_STATE_STEPS = 20  # trial steps of an initial-state estimate
# Half and double change nothing on 3 of 4 plants, and make the test error of a network
# 7 % and 4 % larger on one (`python -m benchmarks.constants WINDOW --seeds 1`).
WINDOW = 200  # samples from which the initial state of a long record is restarted


LONGEST = 20_000  # samples whose states tell where others may begin
LEAST = 0.01  # of the root mean square deviation: that of states which never moved
UNSEEN = 1e-13  # relative size of a direction of whitened states that is rounding


@dataclass(frozen=True, eq=False)
class Prior:
    """Expect initial states where the states along a record were.

    Parameters
    ----------
    mean : ndarray of shape (n_x0,)
        Their mean.
    root : ndarray of shape (n_x0, n)
        Factor of their covariance, root root'.

    Examples
    --------
    >>> X = np.random.default_rng(0).normal(2.0, 0.5, size=(10_000, 1))
    >>> prior = Prior.of_states(X)
    >>> prior.mean.round(1), np.abs(prior.root).round(1)
    (array([2.]), array([[0.5]]))
    """

    __repr__ = short_repr

    mean: np.ndarray
    root: np.ndarray

    @classmethod
    def usual(cls, n):
        """Return the prior of states of which nothing is known.

        Parameters
        ----------
        n : int
            Number of states.

        Returns
        -------
        prior : Prior
            Mean zero and unit variances.
        """
        return cls(np.zeros(n), np.eye(n))

    @classmethod
    def of_states(cls, X):
        """Return the prior of some states.

        Parameters
        ----------
        X : ndarray of shape (N, n_x0)
            States.

        Returns
        -------
        prior : Prior
            Their mean and covariance.
        """
        mean = X.mean(axis=0)
        return cls(mean, _root((X - mean).T / np.sqrt(len(X))))

    @classmethod
    def of_region(cls, region, scale):
        """Return the prior of the states of a region.

        Parameters
        ----------
        region : Region
            Region of the training data.
        scale : ndarray of shape (nx,)
            Size of the states: those of the region over those of the estimate.

        Returns
        -------
        prior : Prior
            Their mean and covariance.
        """
        nx, W = len(scale), region.whiten
        # x and u have units of their own; what never moved stays out in any of them
        size = np.ones((len(W), 1))
        for block in (slice(nx), slice(nx, None)):
            size[block] = np.linalg.norm(W[block]) or 1.0
        F = pinv(W / size, rtol=UNSEEN).T / size
        return cls(region.center[:nx] / scale, _root(F[:nx] / scale[:, None]))

    @classmethod
    def along(cls, structure, theta, x0, experiments):
        """Return the prior of the states along a simulation of experiments.

        Parameters
        ----------
        structure : Structure
            Structure of the model.
        theta : ndarray of shape (n_params,)
            Its parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states.
        experiments : sequence of tuple of array
            Pairs (u, y) of scaled deviations.

        Returns
        -------
        prior : Prior or None
            Mean and covariance of the states; None if they diverge.
        """
        lure, n, most = structure.lure(theta), x0.shape[1], max(1, LONGEST // len(x0))
        runs = [
            simulate(lure, u[:most], structure.initial_state(start))[:-1, :n]
            for (u, _), start in zip(experiments, x0, strict=True)
        ]
        X = np.concatenate(runs)
        return cls.of_states(X) if np.isfinite(X).all() else None


def _root(F):
    """Return a square factor of F F', with a little variance in every direction."""
    # all of the left vectors, and of the right ones, of a long record, no more
    U, spread, _ = np.linalg.svd(F, full_matrices=F.shape[0] > F.shape[1])
    least = LEAST * np.linalg.norm(spread) / np.sqrt(len(U))
    every = np.full(len(U), least)
    every[: len(spread)] = np.maximum(spread, least)
    return U * every


def window_of(u, y, n_samples):
    """Return how many samples at the beginning tell an initial state, and do not count.

    Parameters
    ----------
    u, y : array of shape (N, nu) or (N, ny)
        An experiment; only sliced.
    n_samples : int
        Samples wanted, from the first measured one on.

    Returns
    -------
    window : int
        With those before, and at most a quarter of the others.
    """
    late = gap(u, y)
    return late + min(n_samples, (len(u) - late) // 4)


def estimate_x0(structure, theta, experiments, *, window, noise, prior=None):
    """Estimate the initial state of every experiment from its first samples.

    Maximum a posteriori (eq. start): outputs have the variance `noise` around those of
    the model.  The prior matters where a window says little about a state that decays
    slowly, and where a network would need a state that it has never seen; as the noise
    vanishes, the estimate becomes least squares.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters, held.
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    window : int, None or sequence of int
        Number of samples used at the beginning of every experiment; None for all.
    noise : float
        Mean square of the output error of the model, outputs of unit variance.
    prior : Prior or None, default=None
        Mean and covariance of the states, from whose mean the search begins; None
        means zero and unit variances.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states: zero without samples, and the mean where the model diverges
        within the window.
    """
    plain, n = structure.observe(structure.measured), structure.n_x0
    one = partial(_estimate_one, plain, theta, noise, prior or Prior.usual(n))
    held = Held.of(experiments)
    windows = [window] * len(held) if np.ndim(window) == 0 else window
    return np.reshape(held.map(one, windows), (-1, n))


def _estimate_one(structure, theta, noise, prior, window, u, y):
    """Return the estimate of the initial state of one experiment."""
    u, y = u[:window], y[:window]
    measured = np.isfinite(y).sum() / max(y.shape[1], 1)
    if not measured:
        return np.zeros(structure.n_x0)  # at rest, as in simulations without y
    criterion = Criterion(structure, [(u, y)])
    problem = _Start(criterion, theta, prior, noise / measured)
    z = np.zeros(prior.root.shape[1])
    if not problem.norm(z) < DIVERGED_NORM:
        return prior.mean  # nothing to estimate: the caller's simulation will show it
    return problem.state(minimize(problem, z, max_iter=INITIAL_STATE_STEPS, tol=1e-8).x)


class _Start(LeastSquares):
    """Restrict a criterion to initial states mean + root z, and add weight |z|^2."""

    def __init__(self, criterion, theta, prior, weight):
        self.criterion, self.theta = criterion, theta
        self.prior, self.weight = prior, weight

    def state(self, z):
        return self.prior.mean + self.prior.root @ z

    def norm(self, z):
        norm = self.criterion.norm(self.criterion.join(self.theta, self.state(z)))
        return min(np.sqrt(norm**2 + self.weight * z @ z), DIVERGED_NORM)

    def normal_equations(self, z):
        free = self.criterion.join(self.theta, self.state(z))
        JJ, Jr, norm = self.criterion.normal_equations(free)
        own = slice(len(self.theta), None)
        # by a factor: root' J'J root could lose its positive diagonal to rounding
        rows = compress(JJ[own, own], Jr[own], norm) @ self.prior.root
        JJ = rows.T @ rows + self.weight * np.eye(len(z))
        Jr = norm * rows[0] + self.weight * z
        return JJ, Jr, float(np.sqrt(norm**2 + self.weight * z @ z))

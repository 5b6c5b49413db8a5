"""Behind a training, what is linear goes from h to A (eq. split, best)."""

import numpy as np

from ..simulation import outputs, runs
from ..split import moved, seen_axis, with_linear
from ..stability import SLOWEST
from ._noise import MEASURED

BEST, TRAINED = "best", "trained"  # what (A, B, C) are
# Least share of the variance of s, correlated to others, that still tells of h.
LEAST_SHARE = 1e-6
STILL = 1e-8  # variance over the largest one of s, below which it does not move
ROUNDING = 1e-12  # relative
SHARES = np.linspace(1.0, 0.1, 10)  # of L, where all of it would leave A unstable


def settled_split(estimator, structure, theta, x0, experiments):
    """Return the same model, of which A is the best linear fit.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        What was fitted.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : Held or Remote
        Experiments of the fit, as the training saw them.

    Returns
    -------
    structure : Structure
        With a constant L; the same one where nothing is moved.
    theta : ndarray of shape (n_params,)
        Parameters of the same model.
    """
    if not _can_be_moved(estimator, structure, theta):
        return structure, theta
    L = _linear_part(structure, theta, x0, experiments)
    if not np.isfinite(L).all():  # a simulation that diverges
        return structure, theta
    A, before = structure.split(theta)["A"], _radius(structure, theta)
    change = structure.split(moved(structure, theta, L))["A"] - A
    if np.abs(change).max(initial=0.0) <= ROUNDING * np.abs(A).max(initial=0.0):
        return structure, theta
    # slower than the record, a pole is no better known than one of its length
    slowest = 1.0 - SLOWEST / max(experiments.lengths)
    most = max(min(estimator._radius or 1.0, slowest), before) if before < 1 else np.inf
    for share in SHARES:
        after = moved(structure, theta, share * L)
        if _radius(structure, after) <= most:
            return with_linear(structure, share * L), after
    return structure, theta


def _can_be_moved(estimator, structure, theta):
    """Tell whether A and h are free to take what the other has."""
    options, p = structure.options, structure.split(theta)
    if getattr(estimator, "linear_part", TRAINED) == TRAINED:
        return False
    # a law that is held would leave another linear part than A in continuous time
    if structure.sampling is not None or "h" not in structure.signals:
        return False
    if "feedback" not in options or options["input_map"] != "identity":
        return False
    delay = estimator.input_delay_
    late = np.delete(delay, structure.given[structure.given < len(delay)])
    is_held = estimator.integrators_ or "A" in (estimator.bounds or {}) or late.any()
    if is_held or estimator.stability == "contractive" or not np.any(p["W_h"]):
        return False
    # g was trained to add little to y behind this A (eq. penalty), and D would take
    # what is moved to C, too
    if np.any(p.get("W_g", 0.0)) or options["feedthrough"] or options.get("drift"):
        return False
    is_Cx = not options["n_k"] and options.get("h_sees") != MEASURED
    return options["feedback"] == "state" or is_Cx


def _linear_part(structure, theta, x0, experiments):
    """Return L: the least squares of h on s, with measured disturbances beside.

    Where the law will see y, which is noisy, the noise counts (eq. best).
    """
    visit = _Moments(structure, theta)
    parts = zip(*experiments.map(visit, x0), strict=True)
    n, total, squares, n_measured, errors = (sum(part) for part in parts)
    if not np.isfinite(squares).all():
        return np.full((visit.nv, visit.ns), np.nan)
    mean = total / n
    covariance = squares / n - np.outer(mean, mean)
    n_z = len(mean) - visit.nv
    size = np.maximum(np.diag(covariance)[:n_z], 0.0) * visit.seen
    # what hardly moves tells nothing, and a constant is rounding
    moves = size > np.maximum(
        STILL * size.max(initial=0.0), ROUNDING * np.diag(squares)[:n_z] / n
    )
    known = np.flatnonzero(moves)
    if not visit.of_x:
        covariance[: visit.ns, : visit.ns] += errors / max(n_measured, 1)
    size = np.sqrt(np.diag(covariance)[known])
    R = covariance[np.ix_(known, known)] / np.outer(size, size)
    by_h = covariance[known, n_z:] / size[:, None]
    slopes = np.zeros((n_z, visit.nv))
    slopes[known] = np.linalg.lstsq(R, by_h, rcond=LEAST_SHARE)[0] / size[:, None]
    return slopes[: visit.ns].T


def _radius(structure, theta):
    """Return the spectral radius of A."""
    return np.abs(np.linalg.eigvals(structure.split(theta)["A"])).max(initial=0.0)


class _Moments:
    """Sum what s, d and h(s, d) are along an experiment, where it lives."""

    def __init__(self, structure, theta):
        law, p = structure.law(), structure.split(theta)
        self.lure = structure.lure(theta)
        self.law = law.lure(law.join({name: p[name] for name in law.parameters}))
        self.of_x = seen_axis(structure) != structure.measured
        self.n_x, self.given = structure.sizes["x"], structure.given
        # behind the inputs of the record, a predictor is told the outputs
        self.nu = structure.sizes[structure.inputs[0]]
        self.moved = np.setdiff1d(np.arange(self.nu), self.given)
        self.ns = self.n_x if self.of_x else structure.sizes[structure.measured]
        self.nv = len(self.moved)
        # what h must not see has weights of zero
        weights = (p.get(name) for name in ("W_s", "W_y", "W_d"))
        self.seen = np.hstack([np.any(W, axis=0) for W in weights if W is not None])

    def __call__(self, x0, u, y):
        """Return numbers, sums and sums of products: of [s, d, h], and of errors."""
        n, total, squares = 0, 0.0, 0.0
        n_measured, errors = 0, 0.0
        for part, u_part, X, Z in runs(self.lure, u, x0):
            u_part = u_part[:, : self.nu]
            s = X[:, : self.n_x] if self.of_x else Z[:, : self.ns]
            v = outputs(self.law, np.hstack([s, u_part]), np.empty(0))
            given = self.given[self.given < self.nu]
            z = np.hstack([s, u_part[:, given], v - u_part[:, self.moved]])
            n, total, squares = n + len(z), total + z.sum(axis=0), squares + z.T @ z
            if not self.of_x:
                e = y[part] - s
                e = e[~np.isnan(e).any(axis=1)]
                n_measured, errors = n_measured + len(e), errors + e.T @ e
        return n, total, squares, n_measured, errors

"""Training: from a linear model to fitted networks, coarse to fine.

The networks start with zero output weights, so that the start *is* the linear model,
and with inner weights spread over what the data show: the pre-activation of a neuron
has a random direction in its (unit variance) inputs and is zero at a random sample.

Long records are trained coarse to fine: the liveliest stretch takes most of the
iterations, all samples the last few.  Several random starts compete on the stretch;
the best of them goes on.

A small gamma is reached by continuation: from a large one, whose optimum is close to
the linear start, down to the wanted one, each optimum the start of the next.  Aiming
at a small gamma at once ends in worse optima, often with an unstable A.

All arrays here are scaled deviations (`experiments`).
"""

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import OptimizeResult

from .criterion import DIVERGED_NORM, Criterion, Restricted
from .experiments import stretch
from .optimizers import minimize, single_threaded
from .simulation import simulate
from .stability import Contractive
from .subspace import stabilize

INITIAL_SLOPE = 1.0  # standard deviation of a pre-activation over the record
INITIAL_STATE_STEPS = 20  # trial steps of an initial-state estimate
GAMMA_STEP = np.sqrt(10.0)  # between two weights of a continuation
START_SAMPLES = 100_000  # of an experiment, over which inner weights are spread
WINDOW = 200  # samples from which the initial state of a long record is restarted


def initial_theta(structure, linear, experiments, rng):
    """Return a start: the linear model plus networks of zero output.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    linear : LinearModel
        Linear start; its C is the constant of the structure.
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    rng : numpy.random.Generator
        Source of the inner weights.

    Returns
    -------
    theta : ndarray of shape (n_params,)
        Flat parameters.
    """
    p = {"A": linear.A, "B": linear.B, "D": linear.D}
    pick = rng.integers(len(experiments))
    u, y = (signal[:START_SAMPLES] for signal in experiments[pick])
    X = simulate(
        structure.lure(structure.join(p)), u, structure.initial_state(linear.x0[pick])
    )
    X = X[:-1, : structure.n_x0]
    if not np.isfinite(X).all():  # an unstable start still has to begin somewhere
        X = np.zeros_like(X)
    y_hat = X @ linear.C.T + u @ linear.D.T
    signals = {"x": X, "u": u, "y": np.where(np.isnan(y), y_hat, y)}
    for axis in structure.neurons:
        size = structure.sizes[axis]
        samples = rng.integers(len(u), size=size)
        inner = {
            name: axes[1]
            for name, axes in structure.parameters.items()
            if axes[0] == axis and len(axes) == 2
        }
        width = sum(structure.sizes[source] for source in inner.values())
        v, bias = np.zeros((len(u), size)), np.zeros(size)
        for name, source in inner.items():
            shape = structure.shapes[name]
            p[name] = rng.normal(scale=INITIAL_SLOPE / np.sqrt(width), size=shape)
            bias -= np.sum(p[name] * signals[source][samples], axis=1)
            v += signals[source] @ p[name].T
        for name, axes in structure.parameters.items():
            if axes == (axis,):
                p[name] = bias
                v += bias
        # what the next layer sees
        signals[axis] = structure.activations[axis].value(v)
    return structure.join(p)


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
    x0 = np.zeros((len(experiments), structure.n_x0))
    for i, (u, y) in enumerate(experiments):
        u, y = u[:window], y[:window]
        criterion = Criterion(structure, [(u, y)], x0_weight=noise / max(1, len(u)))
        free = criterion.join(theta, x0[i])
        mask = np.arange(criterion.n) >= structure.n_params
        problem = Restricted(criterion, free, mask)
        if not problem.norm(x0[i]) < DIVERGED_NORM:
            continue  # nothing to estimate: the caller's simulation will show it
        x0[i] = minimize(problem, x0[i], max_iter=INITIAL_STATE_STEPS, tol=1e-8).x
    return x0


def train(
    structure,
    experiments,
    starts,
    *,
    weights=None,
    phi=None,
    bounds=None,
    continuation=0,
    coarse_samples=None,
    polish_iter=20,
    n_jobs=None,
    **options,
):
    """Train networks from several starts, coarse to fine.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    starts : sequence of ndarray of shape (n_params,)
        Starts, one per restart.
    weights : dict or None, default=None
        ``gamma``, ``gamma_k``, ``alpha`` and ``output_weight`` of `Criterion`.
    phi : float or None, default=None
        Rate of stability by construction (eq. contract); None leaves A free.
    bounds : dict of str to tuple of ndarray, or None, default=None
        Lower and upper bounds of parameters by name; equal ones hold an entry.
    continuation : int, default=0
        Number of larger gammas that come first, each half a decade above the next.
    coarse_samples : int or None, default=None
        Samples of the first stages; None trains on all samples at once.
    polish_iter : int, default=20
        Trial steps on all samples after the coarse stages.
    n_jobs : int or None, default=None
        Restarts in parallel, or experiments if there is one start, as in joblib.
    **options : dict
        ``method``, ``max_iter``, ``tol`` and ``report`` of `optimizers.minimize`.

    Returns
    -------
    result : OptimizeResult
        That of the last stage, with ``theta`` and ``x0`` of the best start and the
        trial steps of all its stages in ``nfev``.
    """
    weights = {} if weights is None else weights
    total = sum(len(u) for u, _ in experiments)
    is_coarse = coarse_samples is not None and coarse_samples < total
    first = stretch(experiments, coarse_samples) if is_coarse else experiments
    threads = n_jobs if len(starts) == 1 else None
    criteria = [
        Criterion(structure, first, **_times(weights, factor), n_jobs=threads)
        for factor in GAMMA_STEP ** np.arange(continuation, -1, -1)
    ]
    limits = Limits(structure, phi, bounds)
    results = Parallel(n_jobs=n_jobs if len(starts) > 1 else 1)(
        delayed(_descend)(
            criteria, theta, limits, label=_label(i, len(starts)), **options
        )
        for i, theta in enumerate(starts)
    )
    best = min(results, key=lambda result: result.cost)
    if is_coarse:
        steps = best.nfev
        criterion = Criterion(structure, experiments, **weights, n_jobs=n_jobs)
        options = {**options, "max_iter": polish_iter}
        best = _stage(criterion, best.theta, limits, label="all samples", **options)
        best.nfev += steps
    return best


def _times(weights, factor):
    """Return the weights with all gammas multiplied."""
    return {
        name: value * factor if name.startswith("gamma") else value
        for name, value in weights.items()
    }


def _label(i, n_starts):
    return "train" if n_starts == 1 else f"start {i + 1}/{n_starts}"


def _descend(criteria, theta, limits, **options):
    """Minimize one criterion after the other, each from the optimum of the last."""
    steps, x0 = 0, None
    for criterion in criteria:
        result = _stage(criterion, theta, limits, x0, **options)
        theta, x0 = result.theta, result.x0
        steps += result.nfev
    result.nfev = steps
    return result


def _stage(criterion, theta, limits, x0=None, **options):
    """Minimize from theta and x0, which is estimated first if it is not known."""
    structure, experiments = criterion.structure, criterion.experiments
    with single_threaded():
        theta = limits.clip(theta)
        if x0 is None:
            at_rest = criterion.join(
                theta, np.zeros((len(experiments), structure.n_x0))
            )
            noise = Criterion(structure, experiments).norm(at_rest) ** 2
            x0 = estimate_x0(structure, theta, experiments, window=WINDOW, noise=noise)
        free = criterion.join(theta, x0)
        if not criterion.norm(free) < DIVERGED_NORM:
            # a short stretch did not show that A is unstable, a long record does
            p = structure.split(theta)
            theta = limits.clip(structure.join({**p, "A": stabilize(p["A"])}))
            free = criterion.join(theta, x0)
        result = limits.minimize(criterion, free, **options)
    theta, x0 = criterion.split(result.x)
    return OptimizeResult({**result, "theta": theta, "x0": x0})


class Limits:
    """Keep parameters where they may be: a contraction, bounds, held entries.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    phi : float or None, default=None
        Rate of stability by construction (eq. contract); None leaves A free.
    bounds : dict of str to tuple of ndarray, or None, default=None
        Lower and upper bounds of parameters by name; equal ones hold an entry.
    """

    def __init__(self, structure, phi=None, bounds=None):
        self.phi = phi
        self.low = np.full(structure.n_params, -np.inf)
        self.high = np.full(structure.n_params, np.inf)
        for name, (low, high) in (bounds or {}).items():
            where, shape = structure.slices[name], structure.shapes[name]
            self.low[where] = np.broadcast_to(low, shape).ravel()
            self.high[where] = np.broadcast_to(high, shape).ravel()

    def clip(self, theta):
        """Return parameters moved into their bounds.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Flat parameters.

        Returns
        -------
        theta : ndarray of shape (n_params,)
            Flat parameters.
        """
        return np.clip(theta, self.low, self.high)

    def minimize(self, criterion, free, *, method="lm", **options):
        """Minimize a criterion within the limits.

        Parameters
        ----------
        criterion : Criterion
            Criterion of (theta, x0).
        free : ndarray of shape (n,)
            Start, within the limits.
        method : {"lm", "trf"}, default="lm"
            Method of `optimizers.minimize`; bounds take "trf" in any case.
        **options : dict
            Further options of `optimizers.minimize`.

        Returns
        -------
        result : OptimizeResult
            Its outcome, with the whole free vector in ``x``.
        """
        problem, start = criterion, free
        if self.phi is not None:
            problem = Contractive(criterion, self.phi)
            start = problem.from_free(free)
        low, high = np.full(len(free), -np.inf), np.full(len(free), np.inf)
        low[: len(self.low)], high[: len(self.high)] = self.low, self.high
        held = low == high
        part = Restricted(problem, start, ~held) if held.any() else None
        bounds = low[~held], high[~held]
        if np.isfinite(bounds).any():
            method, options["bounds"] = "trf", bounds
        result = minimize(part or problem, start[~held], method=method, **options)
        x = part.complete(result.x) if part else result.x
        result.x = problem.to_free(x) if self.phi is not None else x
        return result

"""Training: from a linear model to fitted networks, coarse to fine.

Long records are trained coarse to fine: the liveliest stretch takes most of the
iterations, three times as many samples some, and all samples the last few.  Several
random starts compete on the stretch; the best of them goes on.

A small gamma is reached by continuation: from a large one, whose optimum is close to
the linear start, down to the wanted one, each optimum the start of the next.  Aiming
at a small gamma at once ends in worse optima, often with an unstable A.

A large alpha may take random networks away before they have found anything
(`descent`).  Then it is reached from a small one.

All arrays here are scaled deviations (`experiments`).
"""

from functools import partial

import numpy as np
from scipy.optimize import OptimizeResult

from .continuous import damped
from .criterion import DIVERGED_NORM, Criterion
from .descent import is_gone
from .experiments import Sliced
from .initial_states import WINDOW, estimate_x0, window_of
from .limits import Limits
from .linear_model import stabilize
from .mapping import Held
from .optimizers import single_threaded
from .watch import INTERRUPTED, Patience, Watch
from .workers import finished

GAMMA_STEP = np.sqrt(10.0)  # between two weights of a continuation
ONLY_STAGE = "train"  # label of a training that is one search
LEAST_MOVE = 1e-9  # relative change of the parameters that ends a stage
# Decay to zero behind which a larger one is tried again. On the measured tanks, one of
# 1e-2 led to the linear model with five seeds of six, behind this one with none. Before
# every larger one, gone or not, it would do harm: GR-SSNN of the drone with 1e-3 and a
# free A (`benchmarks.recordings`) had medians of 4.4 and 10.0 degrees, not 2.7 and 5.2.
ALIVE = 1e-4
MIDDLE = 3  # times the samples of the first stages: a stretch between them and all
# Accepted steps, and the share of the cost that they have to take away, for one of the
# stages before the last to go on. Of the measured circuit, the second half of the first
# stage took a twentieth, and a sixth of the time of the fit. Where no stage is between
# it and the last, which has few steps, nothing takes over what is left.
SETTLES = (25, 0.015)


def train(
    structure,
    experiments,
    starts,
    *,
    weights=None,
    alpha=0.0,
    center=None,
    phi=None,
    radius=None,
    bounds=None,
    at_rest=False,
    periodic=False,
    continuation=0,
    rises=False,
    coarse_samples=None,
    polish_iter=20,
    n_jobs=None,
    watch=None,
    validation=None,
    fallback=None,
    x0=None,
    settles=False,
    **options,
):
    """Train networks from several starts, coarse to fine.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    experiments : sequence of tuple of array, Held or Remote
        Pairs (u, y) of scaled deviations.
    starts : sequence of ndarray of shape (n_params,)
        Starts, one per restart.
    weights : dict of str to float or ndarray, or None, default=None
        Weights of the channels by name, as of `Criterion`.
    alpha : float, default=0.0
        Weight of the squared network parameters.
    center : ndarray of shape (n_params,) or None, default=None
        Parameters from which that weight pulls away as little as possible.
    phi : float or None, default=None
        Rate of stability by construction (eq. contract); None leaves A free.
    radius : float or None, default=None
        Largest modulus of an eigenvalue of an A that is free; None means no limit.
    bounds : dict of str to tuple of ndarray, or None, default=None
        Lower and upper bounds of parameters by name; equal ones hold an entry.
    at_rest : bool, default=False
        Whether the initial states are held at zero; a stretch of a record begins
        anywhere, and its initial states are free in any case.
    periodic : bool, default=False
        Whether every experiment is one period of what repeats itself (eq. steady); a
        stretch of it is not.
    continuation : int, default=0
        Number of searches with larger weights of all channels but the measured one
        that come first, each half a decade above the next.
    rises : bool, default=False
        Whether a start whose networks an `alpha` has taken away is trained again, with
        a small weight first.
    coarse_samples : int or None, default=None
        Samples of the first stages; None trains on all samples at once.
    polish_iter : int, default=20
        Trial steps on all samples after the coarse stages. A long record has a stage
        between them, on three times the coarse samples, which may do as much work.
    n_jobs : int or None, default=None
        Restarts in parallel, or experiments if there is one start, as in joblib.
    watch : Watch or None, default=None
        Told of every step; may end the training.
    validation : Validation or None, default=None
        Data that judge the points of every stage and the starts.
    fallback : ndarray of shape (n_params,) or None, default=None
        Parameters from which the stage on all samples starts if those of the coarse
        stages simulate them worse.
    x0 : ndarray of shape (n_experiments, n_x0) or None, default=None
        Initial states at the starts, if the first stage is on all samples; None
        estimates them.
    settles : bool, default=False
        Whether the first two of three stages end where steps hardly lower the cost: the
        starts come from a search, and are no saddle, where it falls late.
    **options : dict
        ``method``, ``max_iter``, ``tol`` and ``bends`` of `optimizers.minimize`.

    Returns
    -------
    result : OptimizeResult
        That of the last stage, with ``theta`` and ``x0`` of the best start and the
        trial steps of all its stages in ``nfev``.
    """
    watch = Watch() if watch is None else watch
    options["validation"] = validation
    measured = structure.measured
    # next to a wall a short step is still worth it: the cost alone ends a stage
    options["xtol"] = LEAST_MOVE
    experiments = Held.of(experiments)
    if experiments.is_here:
        experiments = Held(experiments, n_jobs)
    is_coarse = coarse_samples is not None and coarse_samples < experiments.n_samples
    first = experiments.stretch(coarse_samples) if is_coarse else experiments
    if experiments.is_here:  # of several starts, the starts are parallel
        first = Held(first, n_jobs if len(starts) == 1 else None)
    first = Held.of(first)
    factors = GAMMA_STEP ** np.arange(continuation, -1, -1)

    def cost(part, periodic, factor=1.0, alpha=alpha):
        weighted = _times(weights, factor, measured)
        decay = {"alpha": alpha, "center": center}
        return Criterion(structure, part, weights=weighted, periodic=periodic, **decay)

    of_first = partial(cost, first, periodic and not is_coarse)
    criteria = [of_first(factor) for factor in factors]
    rise = []
    if rises and center is None and alpha > ALIVE:
        rise = [(f"alpha {ALIVE:g}", of_first(factors[0], ALIVE))]
    middle = MIDDLE * coarse_samples if is_coarse else 0
    is_long = is_coarse and 2 * middle < experiments.n_samples
    finer = [f"{middle} samples"] * is_long + ["all samples"] * is_coarse
    penalties = [w for c, w in (weights or {}).items() if c != measured]
    labels = _stage_labels(penalties, factors, finer)
    limits = Limits(structure, phi, bounds, at_rest or periodic, radius)
    first_limits = limits
    if is_coarse:
        first_limits = Limits(structure, phi, bounds, radius=radius)
    stages = list(zip(labels[: len(criteria)], criteria, strict=True))
    x0 = None if is_coarse else x0
    early = {**options, "settles": SETTLES if settles and is_long else None}
    best = _best_start(stages, starts, first_limits, watch, n_jobs, early, x0, rise)
    if not is_coarse:
        return best
    # as much work on the middle stretch as on all samples
    n_steps = polish_iter * experiments.n_samples // middle
    n_steps = min(n_steps, options.get("max_iter", n_steps))
    parts = [(experiments, limits, polish_iter, periodic, options)]
    if is_long:
        part = experiments.stretch(middle)
        part = Held(part, n_jobs) if experiments.is_here else Held.of(part)
        parts.insert(0, (part, first_limits, n_steps, False, early))
    for label, (part, within, n, is_periodic, how) in zip(
        labels[len(criteria) :], parts, strict=True
    ):
        how = {**how, "watch": watch, "label": label, "max_iter": n}
        steps, theta, criterion = best.nfev, best.theta, cost(part, is_periodic)
        best = _stage(criterion, theta, within, fallback=fallback, **how)
        best.nfev += steps
    return best


def _best_start(stages, starts, limits, watch, n_jobs, options, x0, rise):
    """Descend from all starts, in parallel, and return the best result."""
    own = partial(_of_start, n_starts=len(starts))
    calls = [
        # in a tuple a start is part of its task; a cluster would place a bare array
        # on one worker, and lose it with that worker
        (own(stages, i), (theta, x0), limits, watch.fork(), options, own(rise, i))
        for i, theta in enumerate(starts)
    ]
    found = {}
    try:
        if len(starts) == 1 or not stages[0][1].experiments.is_here:
            # in this process, whatever the backend of the caller
            for i, call in enumerate(calls):
                found[i] = _descend(*call)
        else:
            elsewhere = n_jobs not in (None, 1)
            if elsewhere:
                watch.competed(0, len(calls), np.nan)
            for i, result in finished(_descend, calls, n_jobs):
                found[i] = result
                if elsewhere:
                    least = min(result.cost for result in found.values())
                    watch.competed(len(found), len(calls), least)
    except KeyboardInterrupt as interrupt:
        watch.stop(INTERRUPTED, interrupt)
    results = [found[i] for i in sorted(found)]
    if not results:  # interrupted while all worked elsewhere: the start is a model
        results = [_descend(stages, (starts[0], x0), limits, watch, options)]
    for result in results:
        watch.history += result.history
    key = "cost" if options["validation"] is None else "validation_rmse"
    return min(results, key=lambda result: result[key])


def _times(weights, factor, measured):
    """Return the weights, those of all channels but the measured one multiplied."""
    return weights and {
        channel: weight if channel == measured else factor * weight
        for channel, weight in weights.items()
    }


def _stage_labels(penalties, factors, finer):
    """Return what the stages of the training are called, in order."""
    names = [ONLY_STAGE]
    if len(factors) > 1:
        names = [
            f"gamma {factor * penalties[0]:.3g}"
            if len(penalties) == 1
            else f"gammas x {factor:.3g}"
            for factor in factors
        ]
    names += finer
    if len(names) == 1:
        return names
    return [f"stage {i}/{len(names)}, {name}" for i, name in enumerate(names, 1)]


def _of_start(stages, i, n_starts):
    """Return the stages of one of several starts, by their labels."""
    if n_starts == 1:
        return stages
    start = f"start {i + 1}/{n_starts}"
    return [
        (start if label == ONLY_STAGE else f"{start}, {label}", criterion)
        for label, criterion in stages
    ]


def _descend(stages, start, limits, watch, options, rise=()):
    """Minimize one criterion after the other, each from the optimum of the last.

    If they have taken the networks away, they do so again, behind those of `rise`.
    """
    (theta, x0), steps = start, 0
    for label, criterion in stages:
        result = _stage(
            criterion, theta, limits, x0, watch=watch, label=label, **options
        )
        theta, x0 = result.theta, result.x0
        steps += result.nfev
    if rise and watch.reason is None and is_gone(criterion.structure, theta, start[0]):
        result = _descend([*rise, *stages], start, limits, watch, options)
        steps += result.nfev
    result.nfev, result.history = steps, watch.history
    return result


def _stage(
    criterion,
    theta,
    limits,
    x0=None,
    *,
    watch,
    validation=None,
    fallback=None,
    **options,
):
    """Minimize from theta and x0, which is estimated first if it is not known."""
    starts = [theta] if fallback is None else [theta, fallback]

    def start():
        points = [_start_of_stage(criterion, start, limits, x0) for start in starts]
        return min(points, key=criterion.norm)

    with single_threaded():
        try:
            free = start()
        except KeyboardInterrupt as interrupt:
            # between two searches: once more, then the next one ends at its start
            watch.stop(INTERRUPTED, interrupt)
            free = start()
        patience = validation and validation.patience(criterion)
        result = limits.minimize(
            criterion, free, watch=watch, patience=patience, **options
        )
    theta, x0 = criterion.split(result.x)
    x0 = criterion.initial_states(theta, x0)
    return OptimizeResult({**result, "theta": theta, "x0": x0})


def _start_of_stage(criterion, theta, limits, x0):
    """Return the free vector of theta and x0 from which the simulation is finite."""
    structure, experiments = criterion.structure, criterion.experiments
    theta = limits.clip(theta)
    zero = np.zeros((len(experiments), structure.n_x0))
    if limits.at_rest:
        x0 = zero
    elif x0 is None:
        plain = structure.observe(structure.measured)
        noise = Criterion(plain, experiments).norm(criterion.join(theta, zero)) ** 2
        x0 = estimate_x0(structure, theta, experiments, window=WINDOW, noise=noise)
    free = criterion.join(theta, x0)
    if not criterion.norm(free) < DIVERGED_NORM:
        # a short stretch did not show that A is unstable, a long record does
        p = structure.split(theta)
        stable = stabilize if structure.sampling is None else damped
        theta = limits.clip(structure.join({**p, "A": stable(p["A"])}))
        free = criterion.join(theta, x0)
    return free


class Behind(Sliced):
    """Outputs without the first samples of an experiment; only sliced.

    Parameters
    ----------
    y : array of shape (N, ny)
        Outputs.
    start : int
        First sample that counts; those before are nan.
    """

    def __init__(self, y, start):
        self.y, self.start, self.shape = y, start, y.shape

    def __getitem__(self, part):
        """Return the samples of a slice, shape (L, ny)."""
        y = np.array(self.y[part])
        y[: max(0, self.start - (part.start or 0))] = np.nan
        return y


class Validation:
    """Judge parameters on data that they are not fitted to.

    The initial states are estimated from the first samples of every experiment, which
    do not count: the policy of ``score``.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; only sliced.
    output_weight : ndarray of shape (ny,)
        Weight of the squared error of every output.
    n_init_samples : int
        Samples spent on an initial state, at most a quarter of the experiment.
    n_iter_no_change : int, default=1
        Accepted steps without a new least error after which a search ends.
    """

    def __init__(self, experiments, output_weight, n_init_samples, n_iter_no_change=1):
        self.output_weight = np.asarray(output_weight) / np.sum(output_weight)
        self.n_iter_no_change = n_iter_no_change
        self._made_of = list(experiments), n_init_samples
        windows = [window_of(u, y, n_init_samples) for u, y in experiments]
        pairs = list(zip(experiments, windows, strict=True))
        self.heads = [(u[:n], y[:n]) for (u, y), n in pairs]
        self.scored = [(u, Behind(y, n)) for (u, y), n in pairs]

    def of(self, change):
        """Return what judges by the same data in another form.

        Parameters
        ----------
        change : callable
            Called with the experiments, a list of pairs (u, y); returns others.

        Returns
        -------
        validation : Validation
            Judge.
        """
        experiments, n_init_samples = self._made_of
        return Validation(
            change(experiments),
            self.output_weight,
            n_init_samples,
            self.n_iter_no_change,
        )

    def patience(self, criterion):
        """Return what judges the points of one search.

        Parameters
        ----------
        criterion : Criterion
            Criterion of the search.

        Returns
        -------
        patience : Patience
            Its judge, which has seen nothing yet.
        """
        noise = [1.0]  # mean square of the last error: what an estimate may trust

        def rmse(free):
            theta, _ = criterion.split(free)
            error = self.rmse(criterion.structure, theta, noise[0])
            noise[0] = error**2 if np.isfinite(error) else noise[0]
            return error

        return Patience(rmse, self.n_iter_no_change)

    def rmse(self, structure, theta, noise, prior=None):
        """Return the error of parameters.

        Parameters
        ----------
        structure : Structure
            Structure of the model.
        theta : ndarray of shape (n_params,)
            Parameters.
        noise : float
            Mean square error that is expected, for the estimate of initial states.
        prior : Prior or None, default=None
            Where these are expected, as in `estimate_x0`.

        Returns
        -------
        rmse : float
            Root mean square error, outputs of unit variance; inf where it diverges.
        """
        structure = structure.observe(structure.measured)
        weights = {structure.measured: self.output_weight}
        error = Criterion(structure, self.scored, weights=weights)
        x0 = estimate_x0(
            structure, theta, self.heads, window=None, noise=noise, prior=prior
        )
        norm = error.norm(error.join(theta, x0))
        return norm if norm < DIVERGED_NORM else np.inf

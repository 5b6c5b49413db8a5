"""Models in continuous time: what the options `time`, `hold` and `substeps` do.

A discrete model of the same equations comes first: its search knows orders, starts and
weights.  Its parameters become those of derivatives (eq. d2c), which the last stages
train through the steps of Runge and Kutta (eq. rk4).
"""

import numpy as np

from ..continuous import (
    can_be_stepped,
    converted,
    damped,
    derivative,
    flow,
    is_alternating,
    is_resolved,
    sampled,
    with_nodes,
)
from ..criterion import DIVERGED_NORM, Criterion
from ..limits import Limits
from ..mapping import Held
from ..shown import percent
from ..simulation import simulate
from ..training import train
from ._integrators import regular
from ._judge import own_judge, warn_left_linear
from ._noise import identified, is_predicting
from ._residual import idle
from ._warn import warn_of_training

CONTINUOUS = "continuous"
ALTERNATES = 0.1  # of a negative pole that is more than a fast one
CLOSE = 0.01  # relative error of a pole that steps of Runge and Kutta may have
FEWEST = 4  # samples of an experiment that tells something of a decay
FLOW_STEPS, FLOW_TOL = 50, 1e-4  # of the search for the same flow
MOST = 20_000  # samples of it
ROUNDED = 1e-9  # of a pole at its limit
FIRST, DECADES = 0.1, 8  # decays that are tried, from that of the discrete model on
GAIN = 0.98  # of the error on hidden samples, from which less decay is better
HELPS = 0.96  # of the error of the linear model, from which networks help
WORSE = 1.1  # error over that of the discrete model, from which something is wrong


def is_continuous(estimator):
    """Tell whether an estimator is fitted in continuous time.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator.

    Returns
    -------
    is_continuous : bool
        Whether its option `time` asks for it.
    """
    return estimator.time == CONTINUOUS


def check_time(estimator):
    """Refuse options that have no meaning for the time of a model.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.

    Raises
    ------
    ValueError
        If continuous time lacks a sampling time or has options that it does not know,
        or discrete time has options of the other.
    """
    if not is_continuous(estimator):
        for name, default in (("hold", "zoh"), ("substeps", 1)):
            if (value := getattr(estimator, name)) != default:
                raise ValueError(
                    f"`{name}` must be {default!r} for time='discrete', got {value!r}. "
                    "Take time='continuous'."
                )
        return
    if type(estimator.dt) is float and estimator.dt == 1.0:  # no int, nor NumPy's
        raise ValueError(
            "`dt` must be given for time='continuous', got 1.0, its default. Give the "
            "sampling time in seconds; if it is one second, write dt=1."
        )
    if is_predicting(estimator):
        raise ValueError(
            "`noise` must be 'output' for time='continuous', got "
            f"{estimator.noise!r}. Take time='discrete'."
        )
    if fixed := set(estimator.bounds or {}) - {"D", "H"}:
        raise ValueError(
            "`bounds` must be of D and H for time='continuous', whose states have a "
            f"basis of their own, got those of {sorted(fixed)}."
        )


def trained(estimator, experiments, previous, watch, held_out):
    """Return the outcome of a fit, and the experiments that it has worked on.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.
    previous : tuple of (Structure, ndarray) or None
        Structure and parameters from which a fit goes on.
    watch : Watch
        What follows the fit.
    held_out : Validation or None
        What judges the fit by other data.

    Returns
    -------
    experiments : Held or Remote
        With what a predictor was told, and with what u does between samples.
    structure : Structure
        What was fitted.
    theta : ndarray of shape (n_params,)
        Its parameters.
    result : OptimizeResult
        How the training ended.
    """
    if not is_continuous(estimator):
        if previous is not None and previous[0].sampling is not None:
            previous = None
        return identified(estimator, experiments, previous, watch, held_out)
    if not Held.of(experiments).is_here:
        raise ValueError(
            "`time` must be 'discrete' for experiments on a cluster, got "
            f"{estimator.time!r}. Fit such a model where the record is."
        )
    if previous is not None and goes_on(estimator, previous):
        structure, theta = previous
        told = Held.of(with_nodes(structure, Held.of(experiments)))
        outcome = _trained(estimator, told, structure, theta, None, watch, held_out)
        _check_rates(structure, outcome.theta, estimator.dt)
        return told, structure, outcome.theta, outcome
    seen, discrete, theta, result = identified(
        estimator, experiments, None, watch, held_out
    )

    def in_time(theta):
        p = discrete.split(theta)
        return converted(discrete, {**p, "A": A}, estimator.hold)

    found = theta, result.x0
    A = discrete.split(theta)["A"]
    p = in_time(theta)
    how = estimator.hold, _substeps(estimator, p["A"]), float(estimator.dt)
    structure = sampled(discrete, *how)
    decay = getattr(estimator, "_decay", None)
    if decay and "center" in decay:
        center = structure.join(in_time(decay["center"]))
        estimator._decay = {**decay, "center": center}
    told = Held.of(with_nodes(structure, seen))
    pairs = told, discrete, found
    theta = structure.join(p)
    if not is_alternating(np.linalg.eigvals(A), ALTERNATES).any():
        theta = _same_flow(estimator, structure, theta, *pairs, watch)
    start = theta, result.x0
    theta, x0, steps = _with_less_decay(estimator, told, structure, start, watch)
    outcome = _trained(estimator, told, structure, theta, x0, watch, held_out)
    outcome.nfev += steps + result.nfev
    error = _misses(structure, outcome.theta, outcome.x0, told)
    least = _misses(discrete, *found, seen)
    if error > WORSE * least and watch.reason is None:
        outcome, error = _or_linear(estimator, structure, p, outcome, told, watch)
    decay = getattr(estimator, "_decay", None)
    if decay and not np.isfinite(decay["alpha"]) and watch.reason is None:
        warn_left_linear(estimator)
    if error > WORSE * least and watch.reason is None:
        warn_of_training(
            f"The model in continuous time misses {percent(100 * error, 3)} of the "
            f"output, a discrete one {percent(100 * least, 3)}. Try another `hold`, "
            f"which says what u does between samples and is {estimator.hold!r}, more "
            "`substeps`, or a smaller `nx`."
        )
    _check_rates(structure, outcome.theta, estimator.dt)
    return told, structure, outcome.theta, outcome


def _same_flow(estimator, structure, theta, experiments, discrete, found, watch):
    """Return parameters whose steps are those of a discrete model (eq. flow)."""
    lure = discrete.observe(discrete.measured).lure(found[0])
    nu, pairs, count = discrete.nu, [], 0
    for (z, _), x0 in zip(experiments, found[1], strict=True):
        z = z[: MOST - count]
        X = simulate(lure, z[:, :nu], x0)
        if len(z) and np.isfinite(X).all():
            pairs.append((np.hstack([z, X[:-1]]), X[1:]))
            count += len(z)
    if not pairs:
        return theta
    bounds = _bounds(estimator, structure, theta)
    radius = _radius(estimator, structure, theta)
    limits = Limits(structure, bounds=bounds, radius=radius)
    criterion = Criterion(flow(structure), pairs)
    free = limits.clip(theta)
    options = {"max_iter": FLOW_STEPS, "tol": FLOW_TOL, "watch": watch.quiet()}
    result = limits.minimize(criterion, free, **options)
    return result.x if np.isfinite(result.cost) else theta


def _or_linear(estimator, structure, p, outcome, experiments, watch):
    """Return a training that went wrong, or the linear model if that misses less."""
    error = _misses(structure, outcome.theta, outcome.x0, experiments)
    before = getattr(estimator, "_decay", None)
    if before is None or structure.nw == 0:
        return outcome, error
    estimator._decay = {"alpha": np.inf}
    nothing = {name: 0.0 * p[name] for name in structure.network_parameters}
    theta = structure.join({**p, **nothing})
    linear = _trained(estimator, experiments, structure, theta, None, watch, None)
    linear.nfev += outcome.nfev
    least = _misses(structure, linear.theta, linear.x0, experiments)
    if least < error:
        return linear, least
    estimator._decay = before
    return outcome, error


def _misses(structure, theta, x0, experiments):
    """Return the error of a simulation over the standard deviation of the outputs."""
    criterion = Criterion(structure.observe(structure.measured), experiments)
    norm = criterion.norm(criterion.join(theta, x0))
    return norm / np.sqrt(structure.sizes[structure.measured])


def _with_less_decay(estimator, experiments, structure, start, watch):
    """Return parameters of the decay that hidden samples ask for, x0, and the steps."""
    theta, x0 = start
    decay = getattr(estimator, "_decay", None)
    if decay is None or estimator.alpha != "auto" or structure.nw == 0:
        return theta, x0, 0
    near = experiments
    if estimator.coarse_samples is not None:
        near = Held.of(experiments.stretch(estimator.coarse_samples))
    pairs = [(pair, 3 * len(pair[1]) // 4) for pair in near]
    starts = x0 if len(x0) == len(pairs) and near[0][0] is experiments[0][0] else None
    if starts is not None:
        starts = starts[[cut >= FEWEST for _, cut in pairs]]
    pairs = [(pair, cut) for pair, cut in pairs if cut >= FEWEST]
    if not pairs:
        return theta, x0, 0
    seen = Held.of([(z[:c], y[:c]) for (z, y), c in pairs])
    judge = own_judge(estimator, [(z[c:], y[c:]) for (z, y), c in pairs])
    helped = np.isfinite(decay["alpha"])
    alpha = decay["alpha"] if helped else FIRST
    noise, best, steps, misses = 1.0, (np.inf, decay, theta), 0, 0
    if not helped:  # the linear model is what has to be beaten
        best = HELPS * judge.rmse(structure, theta, noise), decay, theta
    for _ in range(DECADES):
        estimator._decay = {"center": theta, **decay, "alpha": alpha}
        outcome = _trained(estimator, seen, structure, theta, starts, watch, None)
        theta, steps = outcome.theta, steps + outcome.nfev
        error = judge.rmse(structure, theta, min(outcome.cost, 1.0))
        misses = 0 if error < GAIN * best[0] else misses + 1
        if misses == 0:
            best = error, estimator._decay, theta
        if misses == 2 or watch.reason is not None:
            break
        alpha /= 10.0
    _, estimator._decay, theta = best
    return theta, x0, steps


def goes_on(estimator, previous):
    """Tell whether a fit in continuous time goes on from the last one.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    previous : tuple of (Structure, ndarray)
        Structure and parameters of the last fit.

    Returns
    -------
    goes_on : bool
        Whether it was of the same equations, sampled alike.
    """
    structure, theta = previous
    sampling = structure.sampling
    if sampling is None or sampling.hold != estimator.hold:
        return False
    if sampling.dt != estimator.dt:
        return False
    if sampling.substeps < estimator.substeps or "C" not in structure.constants:
        return False
    A = structure.split(theta)["A"]
    nx, ny = structure.sizes["x"], structure.sizes["y"]
    if not estimator._allows(nx) or not can_be_stepped(A, sampling.substeps):
        return False
    slowest = np.linalg.eigvals(regular(estimator, A)).real.max(initial=-1.0)
    if np.exp(slowest) > _limit(estimator) * (1.0 + ROUNDED):
        return False
    nu = derivative(structure).nu
    wanted = estimator.declare(nx, nu, ny, structure.constants["C"])
    return (
        wanted.shapes == structure.shapes
        and np.array_equal(wanted.given, structure.given)
        and wanted.activations == derivative(structure).activations
    )


def _substeps(estimator, A):
    """Return the steps of Runge and Kutta per sample; warn if it takes more."""
    needed = estimator.substeps
    while not is_resolved(A, needed, CLOSE):
        needed += 1
    if needed == estimator.substeps:
        return needed
    fastest = np.abs(np.linalg.eigvals(A)).max()
    warn_of_training(
        f"`substeps` is raised from {estimator.substeps} to {needed}: a pole of "
        f"modulus {fastest / estimator.dt:.3g} rad/s is too fast for steps of "
        f"{estimator.dt / estimator.substeps:.3g} s. Take a smaller `nx` or sample "
        "faster if the plant has no such pole."
    )
    return needed


def _trained(estimator, experiments, structure, theta, x0, watch, held_out):
    """Return what the last stages make of parameters of derivatives."""
    judge = None
    if held_out is not None:
        judge = held_out.of(lambda pairs: with_nodes(structure, pairs))
    penalized, weights = estimator._criterion_terms(structure)
    theta = _finite(structure, theta, experiments)
    if x0 is not None and not np.isfinite(_misses(structure, theta, x0, experiments)):
        x0 = None
    decay = dict(getattr(estimator, "_decay", None) or {})
    decay.pop("bends", None)  # through all layers of a sample they cost too much
    if not np.isfinite(decay.get("alpha", 0.0)):  # the networks did not help
        decay = {}
    elif not decay:
        alpha = getattr(estimator, "alpha", 0.0)
        decay = {"alpha": 0.0 if isinstance(alpha, str) else alpha}
    return train(
        penalized,
        experiments,
        [theta],
        weights=weights,
        **decay,
        **within_derivatives(estimator, structure, theta),
        at_rest=estimator._at_rest,
        max_iter=estimator.max_iter,
        tol=estimator.tol,
        watch=watch,
        validation=judge,
        x0=x0,
        **stages(estimator),
    )


def stages(estimator):
    """Return the options that say in which stages a training goes, and how.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.

    Returns
    -------
    options : dict
        Those of `training.train` that it has.
    """
    names = ("coarse_samples", "polish_iter", "n_jobs", "method")
    return {k: getattr(estimator, k) for k in names if hasattr(estimator, k)}


def within_derivatives(estimator, structure, theta, held=()):
    """Return the options that keep parameters of derivatives within their limits.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator of continuous time.
    structure : Structure
        Structure of its derivatives, with their sampling.
    theta : ndarray of shape (n_params,)
        Parameters, from which a training starts.
    held : mapping, default=()
        Further bounds, by the name of the parameter.

    Returns
    -------
    options : dict
        ``phi``, ``radius`` and ``bounds`` of `training.train`: the contraction of the
        discrete model is none of A in continuous time.
    """
    bounds = _bounds(estimator, structure, theta) | dict(held)
    radius = _radius(estimator, structure, theta)
    return {"phi": None, "radius": radius, "bounds": bounds}


def _bounds(estimator, structure, theta):
    """Return the bounds of parameters of derivatives."""
    bounds = estimator._scaled_bounds(structure)
    if "A" in bounds:  # of integrators: their derivatives do not see them
        low, high = bounds["A"]
        held = low == high
        A = structure.split(theta)["A"]
        value = np.where(low == np.eye(len(low)), 0.0, A)  # the others are the user's
        bounds["A"] = tuple(np.where(held, value, bound) for bound in (low, high))
    decay = getattr(estimator, "_decay", None) or {"alpha": 0.0}
    return bounds | idle(structure, theta, decay["alpha"])


def _radius(estimator, structure, theta):
    """Return the largest exp of a pole: a stable start is kept stable."""
    slowest = np.linalg.eigvals(structure.split(theta)["A"]).real.max(initial=-1.0)
    if slowest >= 0:
        return None
    return max(np.exp(slowest), _limit(estimator, free=1.0))


def _limit(estimator, free=np.inf):
    """Return the largest exp of a pole that the options allow."""
    limit = estimator._radius  # of a contraction, such poles are within, too
    limit = np.sqrt(1.0 - estimator._phi) if estimator._phi is not None else limit
    return free if limit is None else limit


def _finite(structure, theta, experiments):
    """Return parameters from which the simulation is finite: at worst linear ones."""
    plain = structure.observe(structure.measured)
    criterion = Criterion(plain, experiments)
    at_rest = np.zeros((len(experiments), structure.n_x0))
    if criterion.norm(criterion.join(theta, at_rest)) < DIVERGED_NORM:
        return theta
    p = structure.split(theta)
    nothing = {name: 0.0 * p[name] for name in structure.network_parameters}
    A = damped(p["A"], structure.sampling.substeps)
    return structure.join({**p, **nothing, "A": A})


def _check_rates(structure, theta, dt):
    """Warn where steps of Runge and Kutta are no solution of the equations."""
    A, substeps = structure.split(theta)["A"], structure.sampling.substeps
    if not is_resolved(A, substeps, 2 * CLOSE):
        fastest = np.abs(np.linalg.eigvals(A)).max()
        warn_of_training(
            f"A pole of modulus {fastest / dt:.3g} rad/s is too fast for {substeps} "
            f"steps of Runge and Kutta per sample of {dt:.3g} s: A is right at this "
            "sampling time only. Take more `substeps`, a smaller `nx`, or "
            "time='discrete'."
        )

"""What a fit says of its own outcome: the score on its record, and its doubts."""

from functools import partial

import numpy as np
from scipy.optimize import OptimizeResult

from ..criterion import Criterion
from ..excursions import NEAR, Excursion
from ..holdout import hold_out
from ..horizon import ahead
from ..initial_states import WINDOW, Prior, estimate_x0
from ..linear_model import simulation_error
from ..paths import ESCAPED
from ..search import FAR
from ..shown import percent
from ..stability import hold_off
from ..training import Validation
from ..watch import OUT_OF_TIME, late_fall
from ._checks import output_weights
from ._horizon import judge_over_horizon, over_horizon
from ._integrators import regular
from ._noise import is_predicting
from ._simulation import expected_states
from ._warn import warn_of_training

TOO_FAR = 3.0  # error of a training record over that from the fitted initial state
SEARCHED = (
    "training on all samples made the simulation worse: this is the model of the search"
)
MOST = 200_000  # samples from which nothing is simulated from elsewhere
NOTABLE = 0.1  # relative to the output, from which that is worth a warning


def own_judge(estimator, experiments):
    """Return what judges a model on its own record, by the policy of `score`.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : Held or sequence of tuple of array
        Scaled experiments.

    Returns
    -------
    judge : Validation
        Its error is relative to the standard deviations of the outputs.
    """
    ny = experiments[0][1].shape[1]
    return Validation(experiments, np.ones(ny), estimator.n_init_samples)


def reproducing(estimator, model, experiments):
    """Return a linear model that simulates its record no worse than the mean.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    model : LinearModel
        What was identified.
    experiments : sequence of tuple of array
        Scaled experiments.

    Returns
    -------
    model : LinearModel
        The same, or one whose poles are held off the unit circle.
    """
    judge = own_judge(estimator, experiments)
    if all(np.isnan(y[:]).all() for _, y in judge.scored):
        return model  # nothing is measured behind the first samples
    noise = min(simulation_error(experiments, model) ** 2, 1.0)
    return hold_off(model, experiments, partial(judge.rmse, noise=noise))


def training_score(estimator, experiments, x0):
    """Return the score on the training record; warn if it needs an exact start.

    Parameters
    ----------
    estimator : StateSpaceModel
        Fitted estimator.
    experiments : Held or Remote
        Scaled experiments.
    x0 : ndarray of shape (n_experiments, nx)
        Scaled initial states of the training.

    Returns
    -------
    score : float
        R2 of the simulation; nan if the record stays on a cluster.
    """
    if not experiments.is_here:
        return float("nan")
    structure, theta = estimator._structure, estimator._theta
    criterion = Criterion(structure, experiments)
    fitted = criterion.norm(criterion.join(theta, x0)) / np.sqrt(structure.sizes["y"])
    noise = min(fitted**2 if is_predicting(estimator) else estimator.cost_, 1.0)
    prior = expected_states(estimator)
    rmse = own_judge(estimator, experiments).rmse(structure, theta, noise, prior)
    follows = fitted < 1.0 or not is_predicting(estimator)  # else it is no simulation
    if rmse > TOO_FAR * fitted and rmse > NOTABLE and follows:
        warn_of_training(
            f"{type(estimator).__name__} simulates its own training record with a "
            f"relative error of {rmse:.2g} from an estimated initial state, and of "
            f"{fitted:.2g} from the fitted one: it hangs on an exact initial state. "
            "Take stability='contractive', a smaller `nx`, or a longer record.",
        )
    return float(1.0 - rmse**2)


def warn_if_unstable(estimator):
    """Warn of an unstable linear part in a model for control.

    Parameters
    ----------
    estimator : StateSpaceModel
        Fitted estimator.
    """
    A = regular(estimator, estimator.A_)
    poles = np.linalg.eigvals(A)
    if estimator._structure.sampling is not None:
        poles = np.exp(poles * estimator._structure.sampling.dt)
    radius = np.abs(poles).max(initial=0.0)
    if radius < 1:
        return
    # a kind of failed training: filtered with its other warnings
    if is_predicting(estimator):
        warn_of_training(
            f"The linear part of {type(estimator).__name__} is unstable, spectral "
            f"radius {radius:.6g}: its free run grows, and only predictions follow the "
            "record. This is right for an unstable plant. For another one, try another "
            "`nx` or a longer record.",
        )
        return
    warn_of_training(
        f"The linear part of {type(estimator).__name__} is unstable, spectral radius "
        f"{radius:.6g}: with h cancelled the loop diverges unless a controller "
        "stabilizes it. Unless the plant is unstable itself, try gamma_h=1e-4, "
        "another `nx`, or `AlSsnn` with stability='contractive'.",
    )


def warn_if_unsettled(estimator, watch):
    """Warn of a training that ended before its cost had settled.

    Parameters
    ----------
    estimator : StateSpaceModel
        Fitted estimator.
    watch : Watch
        What followed the fit.
    """
    if estimator.converged_:
        return
    history = estimator.history_
    is_last = bool(history) and "all samples" in history[-1].label
    more = "`polish_iter` or `coarse_samples`" if is_last else "`max_iter`"
    reason = f"before the cost settled to tol={estimator.tol}. Increase {more}"
    if watch.reason == OUT_OF_TIME:
        reason = "because max_time is over. Increase `max_time`"
    fall, n_steps = late_fall(history)
    settled = f" Its last {n_steps} steps lowered the cost by {percent(100 * fall)}."
    warn_of_training(
        f"{type(estimator).__name__} stopped after {estimator.n_iter_} trial steps "
        f"{reason} or `tol`, or continue with `warm_start=True`."
        f"{settled if np.isfinite(fall) else ''}",
    )


def warn_left_linear(estimator, trained=False):
    """Warn that a fit returns its linear model.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    trained : bool, default=False
        Whether a search had found networks, and `not_worse` has refused them.
    """
    verb = "predict" if is_predicting(estimator) else "simulate"
    if trained:
        warn_of_training(
            f"The networks of {type(estimator).__name__} {verb} this record worse than "
            "the linear model, which is returned: from initial states estimated as in "
            "`score`, or from other states of the record. Try a smaller `nx`, a longer "
            "record, or another `random_state`."
        )
        return
    warn_of_training(
        f"The networks of {type(estimator).__name__} do not {verb} hidden samples "
        "better than the linear model, which is returned. Try another `nx`, a longer "
        "record, or `LinearStateSpace`."
    )


def not_worse(estimator, plain, result, theta, linear, experiments, watch):
    """Return what simulates its own record no worse than the linear model, if any does.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    plain : Structure
        Structure of the model.
    result : OptimizeResult
        Outcome of its training on all samples.
    theta : ndarray of shape (n_params,)
        Where that began: what a search had found.
    linear : LinearModel
        Linear model.
    experiments : Held or Remote
        Experiments of the fit; elsewhere, nothing is compared.
    watch : Watch
        What follows the fit.

    Returns
    -------
    result : OptimizeResult or None
        The outcome of the training. That of the search, with a warning, if the former
        simulates the record worse than the linear model, or if it goes far where
        nothing was measured: from other states of the record, or under other inputs
        (eq. escape, latch), as the outcome of the search does not. The plant may, too:
        a fourth of the error outweighs all but a latch, with a warning. None if both
        outcomes are worse than the linear model, from here or from other states.
    """
    worse = partial(_worse, estimator, plain, linear=linear, experiments=experiments)
    hangs = partial(_hangs, estimator, plain, linear=linear, experiments=experiments)
    leaves, latches = _excursions(estimator, plain, linear, experiments)
    lost = worse(result)
    hung = lost or hangs(result)
    if not hung and not leaves(result):
        return result
    noise = min(result.cost, 1.0)
    untrained = as_found(
        estimator, plain, theta, experiments, watch, SEARCHED, noise=noise
    )
    found = OptimizeResult({**result, **untrained})
    if worse(found) or hangs(found):
        return None if hung else result
    is_plant = not hung and leaves(found)
    # folds of a plant that rests in two places would do so, too
    known = not lost and not latches(result)
    outweighs = known and ESCAPED * result.cost < found.cost
    if outweighs or is_plant:
        if not is_plant:
            _warn_elsewhere(estimator, hung)
        return result
    if watch.reason is None:  # else the training might have come out of it
        _warn_untrained(estimator, hung)
    return found


def _warn_elsewhere(estimator, hung):
    """Warn of a model that goes far elsewhere, and fits well otherwise."""
    where = "from other states of it worse than the linear model"
    if not hung:
        where = "goes far from it under inputs that are a quarter larger"
    warn_of_training(
        f"{type(estimator).__name__} simulates this record well, and {where}. That is "
        "right for a plant that does so, as a pendulum that turns over. For another "
        "one, try a smaller `nx`, a longer record, or another `random_state`."
    )


def _warn_untrained(estimator, hung):
    """Warn that a fit returns the model of its search."""
    name = type(estimator).__name__
    what = "prediction" if is_predicting(estimator) else "simulation"
    reason = (
        f"made its {what} of this record, from initial states estimated as in `score` "
        "or from other states of the record, worse than that of the linear model"
        if hung
        else "made it go where nothing was measured. Under inputs that are a quarter "
        f"larger, an output deviates {NEAR:.0f} times as much as any in the record, or "
        "under inputs that are held, it rests in two places"
    )
    warn_of_training(
        f"Training {name} on all samples {reason}. The model that the search found is "
        "returned instead; it may fit less well than a full training. Try a smaller "
        "`nx`, a longer record, or another `random_state`."
    )


def _excursions(estimator, plain, linear, experiments):
    """Return what tells whether other inputs take a simulation far from its record.

    The second function tells whether it rests in two places.
    """
    if is_predicting(estimator) or estimator.integrators_ or not experiments.is_here:
        return (lambda result: False,) * 2
    asks = Excursion.beside(linear, experiments)
    return (
        lambda result: asks.leads(plain, result.theta, result.x0),
        lambda result: asks.latches(plain, result.theta, result.x0),
    )


def as_found(
    estimator, plain, theta, experiments, watch, message, *, x0=None, noise=1.0
):
    """Return parameters that are not trained any more as the outcome of a fit.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    plain : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Its parameters.
    experiments : Held or Remote
        Experiments of the fit.
    watch : Watch
        What follows the fit.
    message : str
        What happened, unless the fit was ended from outside.
    x0 : ndarray of shape (n_experiments, nx) or None, default=None
        Scaled initial states; None estimates them.
    noise : float, default=1.0
        Mean square error that is expected, for that estimate.

    Returns
    -------
    result : OptimizeResult
        ``theta``, ``x0``, ``cost``, ``success`` and ``message``.
    """
    if x0 is None and estimator._at_rest:
        x0 = np.zeros((len(experiments), plain.n_x0))
    elif x0 is None:
        x0 = estimate_x0(plain, theta, experiments, window=WINDOW, noise=noise)
    weight = output_weights(estimator.output_weight, plain.sizes["y"])
    *data, weights = over_horizon(estimator, plain, experiments, {"y": weight})
    periodic = estimator.initial_state == "periodic"
    criterion = Criterion(*data, weights=weights, periodic=periodic)
    return OptimizeResult(
        theta=theta,
        x0=criterion.initial_states(theta, x0),
        cost=criterion.norm(criterion.join(theta, x0)) ** 2,
        success=watch.reason is None,
        message=watch.reason or message,
    )


def _worse(estimator, plain, result, *, linear, experiments):
    """Tell whether a fit simulates its record worse than the linear model by 2 %."""
    if not experiments.is_here:
        return False
    judge = judge_over_horizon(estimator, own_judge(estimator, experiments))
    structure, theta, fit = linear.as_fit()
    start = Criterion(structure, experiments)
    noise = start.norm(start.join(theta, fit.x0)) ** 2
    linear, ahead_of = (ahead(one, estimator.horizon) for one in (structure, plain))
    least = judge.rmse(linear, theta, min(noise, 1.0))
    prior = Prior.along(plain, result.theta, result.x0, experiments)
    error = judge.rmse(ahead_of, result.theta, min(result.cost, 1.0), prior)
    return error > 1.02 * least


def _hangs(estimator, plain, result, *, linear, experiments):
    """Tell whether the error is twice the linear model's from other states.

    It is not asked of predictions over a horizon, and of so many samples that a copy of
    them would count.
    """
    here = experiments.is_here and experiments.n_samples <= MOST
    if not here or estimator.horizon > 1:
        return False
    structure, theta, fit = linear.as_fit()
    walks = 0 if linear.drift is None else len(linear.K_b)  # as in `compare_orders`
    return any(
        fold.error(plain, result.theta, result.x0, elsewhere=True)
        > FAR**2 * fold.error(structure, theta, fit.x0, elsewhere=True)
        for fold in hold_out(experiments, integrators=estimator.integrators_ + walks)
    )

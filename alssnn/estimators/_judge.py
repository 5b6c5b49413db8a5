"""What a fit says of its own outcome: the score on its record, and its doubts."""

from functools import partial

import numpy as np

from ..criterion import Criterion
from ..integrators import SLOWEST
from ..linear_model import simulation_error
from ..shown import percent
from ..stability import hold_off
from ..training import Validation
from ..watch import OUT_OF_TIME, late_fall
from ._integrators import regular
from ._noise import is_predicting
from ._simulation import expected_states
from ._warn import warn_of_training

TOO_FAR = 3.0  # error of a training record over that from the fitted initial state
NOTABLE = 0.1  # relative to the output, from which that is worth a warning
# Relative error of a simulation of the whole record, of plants that integrate, at most.
# Eleven fits of such plants had 0.01 to 0.22, and 0.1 to 0.5 times the linear error on
# a fresh record; four others had 0.48 to 0.69, and 0.6, 1.7, 2.5 and 3.0 times.
WHOLE = 0.4
VANISHED = 0.01  # largest weight of networks without effect, in units of the fit

UNSTABLE = (
    " A pole of the linear model hardly decays within the record. If the plant is "
    "unstable, or a controller was active, fit with noise='innovations'."
)
INTEGRATES = " If an output of the plant is the integral of a rate, set integrators=1."


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
        is_free = hasattr(estimator, "stability") and estimator._phi is None
        stable = "stability='contractive', " if is_free else ""
        warn_of_training(
            f"{type(estimator).__name__} simulates its own training record with a "
            f"relative error of {rmse:.2g} from an estimated initial state, and of "
            f"{fitted:.2g} from the fitted one: it hangs on an exact initial state. "
            f"Take {stable}another `nx`, or a longer record.",
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
    remedy, loop = "another `nx`, or a longer record", "a simulation diverges"
    if hasattr(estimator, "stability"):
        remedy = "another `nx`, or stability='contractive'"
    if hasattr(estimator, "gamma_h"):
        loop = "with h cancelled the loop diverges unless a controller stabilizes it"
    warn_of_training(
        f"The linear part of {type(estimator).__name__} is unstable, spectral radius "
        f"{radius:.6g}: {loop}. Unless the plant is unstable itself, try {remedy}.",
    )


def warn_if_gone(estimator):
    """Warn of networks of which a decay has left next to nothing.

    Parameters
    ----------
    estimator : StateSpaceModel
        Fitted estimator.
    """
    structure = estimator._structure
    p = structure.split(estimator._theta)
    weights = [p[name] for name in structure.network_parameters if p[name].size]
    if not weights or not estimator.alpha_ > 0:  # nothing pulls at them
        return
    if max(np.abs(each).max() for each in weights) < VANISHED:
        warn_of_training(
            f"The decay alpha={estimator.alpha_:g} of {type(estimator).__name__} has "
            "taken its networks away: their weights are nearly zero, and the model is "
            "all but linear. Set a smaller `alpha`."
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
    warm = hasattr(estimator, "warm_start")
    goes_on = ", or continue with `warm_start=True`" if warm else ""
    fall, n_steps = late_fall(history)
    settled = f" Its last {n_steps} steps lowered the cost by {percent(100 * fall)}."
    warn_of_training(
        f"{type(estimator).__name__} stopped after {estimator.n_iter_} trial steps "
        f"{reason} or `tol`{goes_on}."
        f"{settled if np.isfinite(fall) else ''}",
    )


def badly(estimator):
    """Return what else counts as worse than the linear model.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.

    Returns
    -------
    what : str
        Addition to a warning; empty for plants that do not integrate (eq. whole).
    """
    if not estimator.integrators_:
        return ""
    error = percent(100 * WHOLE)
    return f" (or with an error above {error} of y, as the plant integrates)"


def warn_left_linear(estimator, trained=False, fall=np.inf):
    """Warn that a fit returns its linear model.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    trained : bool, default=False
        Whether a search had found networks, and their training was refused.
    fall : float, default=inf
        Lengths of the record over the time constant of its slowest pole; inf if it is
        known why that pole is slow.
    """
    verb = "predict" if is_predicting(estimator) else "simulate"
    slow = UNSTABLE if fall < 1.0 and not trained else ""
    if fall < SLOWEST and estimator.integrators == "auto":
        slow += INTEGRATES
    if trained:
        warn_of_training(
            f"The networks of {type(estimator).__name__} {verb} this record worse than "
            f"the linear model{badly(estimator)}, which is returned: from initial "
            "states estimated as in `score`, or from other states of the record. Try a "
            f"smaller `nx`, a longer record, or another `random_state`.{slow}"
        )
        return
    warn_of_training(
        f"The networks of {type(estimator).__name__} do not {verb} hidden samples "
        "better than the linear model, which is returned. Try another `nx`, a longer "
        f"record, or `LinearStateSpace`.{slow}"
    )

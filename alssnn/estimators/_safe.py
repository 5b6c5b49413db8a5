"""What a fit keeps of a training on all samples, which may spoil what a search found.

The search was judged by samples that it did not see; the training that follows is not.
It is refused if it simulates the record worse than the linear model, or goes where
nothing was measured.  It is then repeated with a larger decay, which keeps the networks
closer to where the search began.
"""

import numpy as np
from scipy.optimize import OptimizeResult

from ..criterion import Criterion
from ..excursions import NEAR, Excursion
from ..holdout import hold_out
from ..horizon import ahead
from ..initial_states import WINDOW, Prior, estimate_x0
from ..paths import ESCAPED
from ..search import FAR
from ._checks import output_weights
from ._horizon import judge_over_horizon, over_horizon
from ._judge import WHOLE, badly, own_judge
from ._noise import is_predicting
from ._warn import warn_of_training

SEARCHED = "training on all samples was refused: this is the model of the search"
MOST = 200_000  # samples from which nothing is simulated from elsewhere
FIRMER = (3.0, 10.0, 30.0)  # times alpha, of trainings that repeat a refused one
LEAST = 1e-9  # alpha that is multiplied, where the search found none


def safely_trained(estimator, plain, train, decay, theta, linear, experiments, watch):
    """Return a training that is no worse than the linear model, if there is one.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    plain : Structure
        Structure of the model.
    train : callable
        Called as ``train(decay)``: returns the outcome of the training on all samples.
    decay : dict
        Weight ``alpha`` and ``center`` of the decay that a search has found.
    theta : ndarray of shape (n_params,)
        Where the training begins: what the search has found.
    linear : LinearModel
        Linear model.
    experiments : Held or Remote
        Experiments of the fit; elsewhere, nothing is compared.
    watch : Watch
        What follows the fit.

    Returns
    -------
    result : OptimizeResult or None
        The outcome of the training, unless it simulates the record worse than the
        linear model (eq. whole), or goes far where nothing was measured: from other
        states of the record, or under other inputs (eq. escape, latch, opened), as the
        outcome of the search does not. The plant may, too: a fourth of the error
        outweighs all but a latch, with a warning. Else that of the first training with
        a larger alpha of which nothing of this is true, and which fits better than the
        outcome of the search; else that one, with a warning. None if it is worse than
        the linear model, too, from here or from other states.
    decay : dict
        The decay of that training.
    """
    record = plain, linear, experiments
    result = train(decay)
    lost = _worse(estimator, result, *record)
    hung = lost or _hangs(estimator, result, *record)
    options = {"noise": min(result.cost, 1.0)}
    untrained = as_found(
        estimator, plain, theta, experiments, watch, SEARCHED, **options
    )
    found = OptimizeResult({**result, **untrained})
    goes = _Goes(estimator, *record, found)
    if not hung and not goes.far(result):
        return result, decay
    spoiled = _worse(estimator, found, *record) or _hangs(estimator, found, *record)
    if not hung and (spoiled or goes.far(found)):
        return result, decay  # the plant may do so, too
    # folds of a plant that rests in two places would do so, too
    known = not lost and not spoiled and not goes.apart(result)
    if known and ESCAPED * result.cost < found.cost:
        _warn_elsewhere(estimator, hung)
        return result, decay
    for times in FIRMER if "center" in decay else ():  # else no search has been
        if watch.reason is not None:
            break
        firm = {**decay, "alpha": times * max(decay["alpha"], LEAST)}
        repeated = train(firm)
        if not spoiled and repeated.cost >= found.cost:
            break  # a larger decay fits the record less well yet
        if not (
            _worse(estimator, repeated, *record)
            or _hangs(estimator, repeated, *record)
            or goes.far(repeated)
        ):
            return repeated, firm
    if spoiled:
        return None, decay
    if watch.reason is None:  # else the training might have come out of it
        goes_apart = not hung and goes.apart(result)
        told = {"lost": lost, "hung": hung, "apart": goes_apart, "far": True}
        _warn_untrained(estimator, next(reason for reason in told if told[reason]))
    return found, decay


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


def _warn_untrained(estimator, reason):
    """Warn that a fit returns the model of its search."""
    name = type(estimator).__name__
    what = "prediction" if is_predicting(estimator) else "simulation"
    reason = {
        "lost": f"made its {what} of this record, from initial states estimated as in "
        f"`score`, worse than that of the linear model{badly(estimator)}",
        "hung": f"made its {what} of this record more than {FAR:.0f} times as wrong as "
        "that of the linear model, where both begin in other states of the record",
        "far": "made it go where nothing was measured: under inputs that are a quarter "
        f"larger, an output deviates more than {NEAR:.0f} times as much as any in the "
        "record",
        "apart": "gave it a second place: where the same inputs lead it depends on the "
        "inputs before. The record does not show that",
    }[reason]
    warn_of_training(
        f"Training {name} on all samples {reason}. The model that the search found is "
        "returned instead; it may fit less well than a full training. Try a smaller "
        "`nx`, a longer record, or another `random_state`."
    )


class _Goes:
    """Tell where other inputs take what was trained, beside what a search found.

    Predictors and plants that integrate are not asked.
    """

    def __init__(self, estimator, structure, linear, experiments, found):
        self.structure, self.found = structure, found
        asks = experiments.is_here and not is_predicting(estimator)
        asks = asks and not estimator.integrators_
        self.excursion = Excursion.beside(linear, experiments) if asks else None

    def far(self, result):
        """Tell whether other inputs take it far from its record."""
        return self._is(Excursion.leads, result)

    def apart(self, result):
        """Tell whether it goes to two places, or farther apart than what was found."""
        return self._is(Excursion.latches, result)

    def _is(self, asked, result):
        model = self.structure, result.theta, result.x0
        return self.excursion is not None and (
            asked(self.excursion, *model)
            or self.excursion.opens(self.structure, self.found, result)
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


def _worse(estimator, result, plain, linear, experiments):
    """Tell whether a fit simulates its record worse than the linear model by 2 %.

    One of a plant that integrates also does if it simulates it badly (eq. whole).
    """
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
    most = WHOLE if estimator.integrators_ else np.inf
    return error > min(1.02 * least, most)


def _hangs(estimator, result, plain, linear, experiments):
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

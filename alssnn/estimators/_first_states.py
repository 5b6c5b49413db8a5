"""Where the experiments of a fit begin: at, or before, the first measured sample."""

from ..mapping import Held
from ..predictions import first_states
from ._noise import is_predicting
from ._periodic import is_periodic
from ._simulation import expected_states


def has_fixed_start(estimator):
    """Tell whether the first state of an experiment of a fit is not free.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator.

    Returns
    -------
    is_fixed : bool
        Whether it is at rest, or that of a period.
    """
    return estimator._at_rest or is_periodic(estimator)


def from_free(estimator, experiments):
    """Return the experiments of a fit from where their states leave a trace.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.

    Returns
    -------
    experiments : Held or Remote
        From their first measured samples on, where first states are free.
    """
    whole = Held.of(experiments)
    return whole if has_fixed_start(estimator) else whole.from_measured()


def whole_states(estimator, fitted, result, experiments):
    """Return the initial states of the experiments of a fit.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit, whose region is known.
    fitted : Structure
        What was fitted: a predictor, of a model with innovations.
    result : OptimizeResult
        How the training ended.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments, of which the fit has seen those `from_free`.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, nx)
        States at their first samples, measured or not.
    """
    if has_fixed_start(estimator) and not is_predicting(estimator):
        return result.x0
    return first_states(
        fitted,
        estimator._theta,
        result.x0,
        experiments,
        noise=1.0 if is_predicting(estimator) else min(result.cost, 1.0),
        prior=expected_states(estimator),
    )

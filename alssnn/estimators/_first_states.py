"""Where the experiments of a fit begin: at, or before, the first measured sample."""

import numpy as np

from ..continuous import with_nodes
from ..mapping import Held, count_measured
from ..predictions import first_states
from ._noise import is_predicting
from ._periodic import is_periodic
from ._simulation import expected_states
from ._time import is_continuous


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


def told_states(result, seen):
    """Return the initial states of what a fit has seen.

    Parameters
    ----------
    result : OptimizeResult
        How the training ended.
    seen : Held or Remote
        Scaled experiments of the fit.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, n_x0)
        Its initial states, zero where nothing was measured: these are rounding.
    """
    measured = np.array(seen.map(_count)) > 0
    return np.where(measured[:, None], result.x0, 0.0)


def _count(u, y):
    return count_measured(y)


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
    if estimator._at_rest:
        return np.zeros((len(experiments), fitted.sizes["x"]))
    if is_continuous(estimator):
        experiments = with_nodes(fitted, Held.of(experiments))
    return first_states(
        fitted,
        estimator._theta,
        result.x0,
        experiments,
        noise=1.0 if is_predicting(estimator) else min(result.cost, 1.0),
        prior=expected_states(estimator),
    )

"""Training on predictions over a horizon: the option `horizon`."""

import numpy as np

from ..horizon import AHEAD, ahead, later
from ..training import train


def trained(estimator, structure, experiments, starts, *, weights, **options):
    """Train a model by the predictions that its options ask for.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        Structure of the model.
    experiments : Held or Remote
        What `training_data` returned.
    starts : sequence of ndarray of shape (n_params,)
        Starts.
    weights : dict of str to float or ndarray
        Weights of the channels by name, as of `Criterion`.
    **options : dict
        Further options of `training.train`.

    Returns
    -------
    result : OptimizeResult
        That of `training.train`; over a horizon the cost is the mean over all of its
        predictions (eq. horizon).
    """
    structure, experiments, weights = over_horizon(
        estimator, structure, experiments, weights
    )
    if options.get("validation") is not None:
        options["validation"] = judge_over_horizon(estimator, options["validation"])
    return train(structure, experiments, starts, weights=weights, **options)


def over_horizon(estimator, structure, experiments, weights):
    """Return what a criterion is made of, for predictions over the horizon of a fit.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        Structure of the model.
    experiments : Held or Remote
        What `training_data` returned.
    weights : dict of str to float or ndarray
        Weights of the channels by name.

    Returns
    -------
    structure : Structure
        The same equations `ahead`.
    experiments : Held or Remote
        The same record with `later` samples.
    weights : dict of str to float or ndarray
        The same, that of the output shared by all predictions.
    """
    horizon, y = estimator.horizon, structure.measured
    if horizon == 1:
        return structure, experiments, weights
    penalties = {name: weight for name, weight in weights.items() if name != y}
    every = np.broadcast_to(weights[y], structure.sizes[y])
    return (
        ahead(structure, horizon),
        later(experiments, horizon),
        {AHEAD: _shared(every, horizon), **penalties},
    )


def judge_over_horizon(estimator, judge):
    """Return what judges predictions over the horizon of a fit.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    judge : Validation
        Judge of predictions one sample ahead.

    Returns
    -------
    judge : Validation
        Judge of structures `ahead`.
    """
    horizon = estimator.horizon
    if horizon == 1:
        return judge
    wide = judge.of(lambda experiments: later(experiments, horizon))
    wide.output_weight = _shared(judge.output_weight, horizon)
    return wide


def _shared(weight, horizon):
    """Return the weights of all predictions, nearest first."""
    return np.tile(weight / horizon, horizon)

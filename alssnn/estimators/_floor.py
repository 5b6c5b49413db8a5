"""The error that no model goes below, and where a training may end for it."""

import numpy as np

from ..checks import noise_levels
from ..nonparametric import best_linear_approximation, noise_of_repeats
from ._noise import is_predicting

SLACK = 1.05  # cost over that of the noise: estimates of the noise err by as much


def floor_of(estimator, u, y, experiment):
    """Return the noise of the outputs that the user knows, or lets the record tell.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like or None
        Labels of the experiments.

    Returns
    -------
    floor : ndarray of shape (ny,) or None
        Root mean squares, in the units of the outputs; None if nothing was asked for.

    Raises
    ------
    ValueError
        If it is not positive, the model is a predictor, or the record does not tell it.
    """
    known = estimator.noise_floor
    if known is None:
        return None
    if isinstance(known, bool | np.bool_) and not known:
        raise ValueError(
            "`noise_floor` must be positive, True or None, got False. None trains "
            "without a floor."
        )
    if is_predicting(estimator):
        raise ValueError(
            f"`noise_floor` must be None for noise={estimator.noise!r}, got {known!r}. "
            "It is the floor of a simulation, noise='output'."
        )
    if known is True:
        known = _told_by(u, y, experiment, estimator)
    return noise_levels(known, 1 if np.ndim(y) < 2 else y.shape[1])


def _told_by(u, y, experiment, estimator):
    """Return what a record tells of its noise, by periods or repeated inputs."""
    if estimator.period is not None:
        return best_linear_approximation(
            u, y, experiment, dt=estimator.dt, period=estimator.period
        )
    known = noise_of_repeats(u, y, experiment)
    if known is None:
        raise ValueError(
            "`noise_floor` may be True only with a `period`, or with experiments that "
            "had the same input, got period=None and different inputs. Give the "
            "samples of a period, or the floor itself."
        )
    return known


def least_cost(floor, lost, weight, y_scale):
    """Return the cost of a model that leaves nothing but the noise (eq. cost).

    Parameters
    ----------
    floor : ndarray of shape (ny,)
        Noise of the outputs.
    lost : ndarray of shape (ny, ny) or float
        Covariance of the noise that means over periods have lost.
    weight : ndarray of shape (ny,)
        Weights of the outputs.
    y_scale : ndarray of shape (ny,)
        Scales of the outputs.

    Returns
    -------
    least : tuple of float and ndarray of shape (ny,)
        Weighted mean square of what is left, outputs scaled, and 5 % more; and the same
        of every output without weights, infinite where its weight is zero: noise of one
        output pays for no error of another.
    """
    left = np.maximum(floor**2 - np.diag(lost * np.eye(len(floor))), 0.0)
    least, weight = SLACK * left / y_scale**2, np.asarray(weight)
    cost = SLACK * float(np.sum(weight * left / y_scale**2))
    return cost, np.where(weight > 0, least, np.inf)

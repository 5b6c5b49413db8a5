"""What noise a model is fitted for: the option `noise`."""

import numpy as np

from ..innovations import INNOVATION, has_innovations, predictor
from ..mapping import Held
from ..predictions import bridged, error_covariance, surprise, told
from ..watch import INTERRUPTED
from ._warn import warn_of_training

INNOVATIONS = "innovations"
SPLIT = 1e-3  # of the error of the linear model: least weight of h(y_m)
MOST_LOST = 0.3  # share of an output that may be missing without a warning
PREDICTED, MEASURED = "predicted", "measured"


def is_predicting(estimator):
    """Tell whether an estimator is fitted by its errors one sample ahead.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator.

    Returns
    -------
    is_predicting : bool
        Whether its option `noise` asks for innovations.
    """
    return estimator.noise == INNOVATIONS


def check_noise(estimator):
    """Refuse options that have no meaning for a model with innovations.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.

    Raises
    ------
    ValueError
        If integrators are held, or a linear start is given; if a random walk or a
        horizon is asked for with other noise.
    """
    if not is_predicting(estimator):
        if estimator.drift is not None:
            raise ValueError(
                f"`drift` must be None for noise={estimator.noise!r}, got "
                f"{estimator.drift!r}. What drifts is told from what was measured: "
                "take noise='innovations'."
            )
        if estimator.horizon > 1:
            raise ValueError(
                f"`horizon` must be 1 for noise={estimator.noise!r}, got "
                f"{estimator.horizon}. The error of a simulation has no horizon: take "
                "noise='innovations' for predictions that begin at what was measured."
            )
        return
    if estimator.integrators not in ("auto", 0):
        raise ValueError(
            "`integrators` must be 'auto' or 0 for noise='innovations', got "
            f"{estimator.integrators}. K tells states that integrate from the record, "
            "and their poles are found with the others."
        )
    if estimator.linear_start is not None:
        raise ValueError(
            "`linear_start` must be None for noise='innovations', for it has no gain "
            "K. Take noise='output', or leave the start to the fit."
        )


def training_data(estimator, experiments):
    """Return the experiments that a fit works on.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.

    Returns
    -------
    experiments : Held or Remote
        The same; those that are `told` to a predictor.

    Raises
    ------
    ValueError
        If a predictor's experiments live elsewhere, or none is longer than a horizon.
    """
    experiments = Held.of(experiments)
    if not is_predicting(estimator):
        return experiments
    if not experiments.is_here:
        raise ValueError(
            "`noise` must be 'output' for experiments on a cluster, got "
            f"{estimator.noise!r}. Fit such a model where the record is."
        )
    longest = max(len(u) for u, _ in experiments)
    if estimator.horizon > 1 and estimator.horizon >= longest:
        raise ValueError(
            "`horizon` must be less than the samples of the longest experiment, "
            f"{longest}, got {estimator.horizon}. Take a time over which you predict."
        )
    return told(experiments, from_rest=estimator._at_rest)


def identified(estimator, experiments, previous, watch, held_out):
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
        Of a predictor, what was told to it.
    structure : Structure
        What was fitted.
    theta : ndarray of shape (n_params,)
        Its parameters.
    result : OptimizeResult
        How the training ended.

    Notes
    -----
    Gaps of y are bridged by straight lines first. Where there are any, a second
    training sees what the first model predicts there, unless the fit has ended by then.
    It may fit too well what is not measured: the model that goes on is the one to which
    the record is the smaller `surprise`.
    """
    seen = training_data(estimator, experiments)
    lost = 0.0
    if is_predicting(estimator):
        missing = sum(np.isnan(y).sum(axis=0) for _, y in seen)
        lost = float(np.max(missing) / sum(len(y) for _, y in seen))
    if lost > MOST_LOST:
        warn_of_training(
            f"{100 * lost:.0f} % of an output were not measured: what is predicted one "
            "sample ahead is not checked there, and noise='innovations' may fail. "
            "Compare with noise='output'."
        )
    first = fitted, theta, result = estimator._identify(seen, previous, watch, held_out)
    if lost == 0 or watch.reason is not None:
        return seen, *first
    attributes, whole = dict(vars(estimator)), seen
    try:
        whole = bridged(fitted, theta, result.x0, seen)
        second = estimator._identify(whole, (fitted, theta), watch, held_out)
        if surprise(second[0], second[1], seen) <= surprise(fitted, theta, seen):
            return whole, *second
    except KeyboardInterrupt as interrupt:  # before there is a second model
        watch.stop(INTERRUPTED, interrupt)
        result.update(success=False, message=INTERRUPTED)
    estimator._reset(attributes)
    return whole, *first


def predicted(estimator, experiments):
    """Return what a linear model of the experiments of a fit predicts by.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array
        What `training_data` returned.

    Returns
    -------
    options : dict
        Options `n_measured`, `drift` and `given` of `drift.identify`; none without
        innovations.
    """
    if not is_predicting(estimator):
        return {}
    given = tuple(map(int, estimator.disturbances_))
    return {"n_measured": experiments[0][1].shape[1], **walk(estimator), "given": given}


def walk(estimator):
    """Return the option of a structure that says where a random walk is.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.

    Returns
    -------
    options : dict
        Option `drift` of `models.state_space`; none without a walk.
    """
    return {} if estimator.drift is None else {"drift": estimator.drift}


def fitted_view(estimator, structure):
    """Return the view of a structure that a fit works on.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        What a model declares.

    Returns
    -------
    structure : Structure
        Its predictor, for a model with innovations.

    Raises
    ------
    ValueError
        If a model that is to have innovations declares none.
    """
    if is_predicting(estimator) and not has_innovations(structure):
        raise ValueError(
            f"`noise` must be known to the structure that `_declare` returns, got "
            f"{estimator.noise!r} for one without the signal {INNOVATION!r}. Declare "
            "its gain K, or take noise='output'."
        )
    return predictor(structure)


def noise_covariance(estimator, structure, x0, experiments):
    """Return the covariance of the training errors.

    Parameters
    ----------
    estimator : StateSpaceModel
        Fitted estimator.
    structure : Structure
        What was fitted: a predictor, of a model with innovations.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : Held or Remote
        What `training_data` returned.

    Returns
    -------
    Lambda : ndarray of shape (ny, ny)
        Covariance of the errors, in the user's units; of experiments that live
        elsewhere, a diagonal matrix that the cost makes.
    """
    scale = estimator._scaling.y_scale
    if not experiments.is_here:
        return np.diag(estimator.cost_ / len(scale) * scale**2)
    Lambda = error_covariance(structure, estimator._theta, x0, experiments)
    return Lambda * np.outer(scale, scale)


def least_gamma_h(estimator):
    """Return the weight of h that settles what is linear, and what of h.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.

    Returns
    -------
    gamma_h : float
        A small share of what the linear model leaves, if h sees the measured outputs:
        the data cannot tell L y of h from A and K there (eq. innovations). Else zero.
    """
    # by the fit, whatever option was set behind it
    sees_y_m = getattr(estimator, "h_sees_", PREDICTED) == MEASURED
    return SPLIT * estimator._linear_cost if sees_y_m else 0.0

"""Fits to settled periods: ``initial_state="periodic"``."""

import numpy as np

from ..periods import mean_periods
from ._integrators import AUTO
from ._noise import is_predicting
from ._time import is_continuous


def is_periodic(estimator):
    """Tell whether the experiments of a fit are periods.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator.

    Returns
    -------
    is_periodic : bool
        Whether its option `initial_state` says so.
    """
    return estimator.initial_state == "periodic"


def check_periodic(estimator, *, is_here=True):
    """Refuse options that have no meaning for periods.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    is_here : bool, default=True
        Whether its experiments are in this process.

    Raises
    ------
    ValueError
        If there is such an option, or a period without ``initial_state="periodic"``.
    """
    if not is_periodic(estimator):
        if estimator.period is not None and estimator.noise_floor is not True:
            raise ValueError(
                f"`period` must be None for initial_state={estimator.initial_state!r}, "
                f"got {estimator.period!r}. Take initial_state='periodic'."
            )
        return
    fraction = getattr(estimator, "validation_fraction", None)
    integrators = estimator.integrators
    refused = (
        (not is_here, "experiments in this process, got some on a cluster"),
        (is_predicting(estimator), f"noise='output', got {estimator.noise!r}"),
        (is_continuous(estimator), f"time='discrete', got {estimator.time!r}"),
        (fraction is not None, f"validation_fraction=None, got {fraction!r}"),
        (integrators not in (AUTO, 0), f"integrators=0, got {integrators!r}"),
    )
    for wrong, need in refused:
        if wrong:
            raise ValueError(
                f"`initial_state` may be 'periodic' only for {need}. Take "
                "initial_state='estimate'."
            )


def settled(estimator, u, y, parts):
    """Return the record as the fit sees it: as it is, or as mean periods.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N,) or (N, ny)
        Outputs.
    parts : list of slice
        Samples of every experiment.

    Returns
    -------
    u, y, parts
        The same, or one period of every experiment.
    lost : ndarray of shape (ny, ny) or float
        Covariance of the noise that the means have lost.
    """
    if not is_periodic(estimator):
        return u, y, parts, 0.0
    return mean_periods(u, y, parts, estimator.period)


def came_round(u, delay):
    """Return late inputs of one period: what came before is its end.

    Parameters
    ----------
    u : ndarray of shape (N, nu)
        Inputs of a period.
    delay : ndarray of int of shape (nu,)
        Samples by which each input arrives late.

    Returns
    -------
    u : ndarray of shape (N, nu)
        Inputs as they arrive.
    """
    return np.column_stack([np.roll(one, d) for one, d in zip(u.T, delay, strict=True)])

"""What a fit found, as a value."""

from dataclasses import dataclass

import numpy as np

from ..scaling import Scaling
from ..structures import Structure
from ._uncertainty import free_entries


@dataclass(frozen=True, eq=False)
class FittedModel:
    """Hold what a fit found, as training knows it: in scaled deviations.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters.
    free : ndarray of bool of shape (n_params,)
        Which parameters nothing held.
    scaling : Scaling
        The user's units of u and y.
    x_scale : ndarray of shape (nx,)
        States of the user over states of the fit.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states of the training.
    cost : float
        Mean squared error of the fit, relative to the variance of y.
    at_rest : bool
        Whether the training experiments began at the operating point.
    for_control : bool
        Whether (A, B, C) is meant for the design of a controller.
    """

    structure: Structure
    theta: np.ndarray
    free: np.ndarray
    scaling: Scaling
    x_scale: np.ndarray
    x0: np.ndarray
    cost: float
    at_rest: bool
    for_control: bool


def fitted_model(model):
    """Return what a fit found.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    fitted : FittedModel
        Its result, in scaled deviations.
    """
    structure = model._structure
    return FittedModel(
        structure=structure,
        theta=model._theta,
        free=free_entries(model, structure.n_params),
        scaling=model._scaling,
        x_scale=np.broadcast_to(model._x_scale, model.nx_),
        x0=model.x0_ / model._x_scale,
        cost=model.cost_,
        at_rest=model._at_rest,
        for_control=model._for_control,
    )

"""What a fit found, as a value."""

import copy
from dataclasses import dataclass

import numpy as np
from sklearn.utils import Bunch
from sklearn.utils.validation import check_is_fitted

from ..containers import Container
from ..continuous import per_second
from ..innovations import has_innovations
from ..region import Region
from ..scaling import Scaling
from ..shown import short_repr
from ..structures import Structure
from ._residual import idle


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
    grows : bool
        Whether a free run grows without bound and says nothing: A is unstable, and was
        identified by errors one sample ahead.
    region : Region
        Region of the training data.
    container : Container
        Kind of the outputs of the training.
    y_ndim : int
        Their number of dimensions.
    decay : dict or None
        Weight of the squared network parameters that a search chose, `alpha`, and
        what it pulls to, `center`.
    predictor : dict or None
        Of networks with innovations, what their training goes on with: the least rate
        of decay of the predictor, `forgets`, and the cost of its linear model,
        `linear_cost`.
    options : dict
        Options of the fit, whatever was set since.
    """

    __repr__ = short_repr

    structure: Structure
    theta: np.ndarray
    free: np.ndarray
    scaling: Scaling
    x_scale: np.ndarray
    x0: np.ndarray
    cost: float
    at_rest: bool
    for_control: bool
    grows: bool
    region: Region
    container: Container
    y_ndim: int
    decay: dict | None
    predictor: dict | None
    options: dict


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
    model = as_fitted(model)
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
        grows=bool(
            has_innovations(structure)
            and np.abs(np.linalg.eigvals(model.A_)).max() >= 1
        ),
        region=model._region,
        container=model._container,
        y_ndim=model._y_ndim,
        decay=model._decay,
        predictor=_kept(model),
        options=model._options,
    )


def _kept(model):
    """Return what the training of a predictor with networks goes on with."""
    names = ("forgets", "linear_cost")
    kept = {name: vars(model).get(f"_{name}") for name in names}
    return None if None in kept.values() else kept


def restore(model, fitted, published):
    """Make an estimator a fitted one again.

    Parameters
    ----------
    model : estimator
        Estimator with the options of the fit.
    fitted : FittedModel or namespace
        What the fit found; what follows from options and results may be missing.
    published : dict
        Its other results, by the names of attributes.

    Returns
    -------
    model : estimator
        The fitted model.

    Raises
    ------
    ValueError
        If an option of the estimator is out of range.
    """
    model._validate_params()
    model._structure, model._theta = fitted.structure, fitted.theta
    model._scaling, model._x_scale = fitted.scaling, fitted.x_scale
    model._region, model._options = fitted.region, fitted.options
    if hasattr(model, "alpha"):
        model._decay = fitted.decay
    model._container, model._y_ndim = fitted.container, fitted.y_ndim
    for name, value in (fitted.predictor or {}).items():
        setattr(model, f"_{name}", value)
    for name, value in published.items():
        setattr(model, name, value)
    publish_parameters(model)
    as_fitted(model)._validate_params()
    return model


def publish_parameters(model):
    """Set the attributes that follow from structure, theta and scales.

    Parameters
    ----------
    model : estimator
        Model in its fit, or one that is restored.
    """
    model._made = None
    scaling, structure = model._scaling, model._structure
    model.disturbances_ = structure.given
    p = {**structure.constants, **structure.split(model._theta)}
    p = per_second(structure, structure.rescale(p, model._units()))
    for name, (low, high) in (model._options["bounds"] or {}).items():
        p[name] = np.clip(p[name], low, high)  # units round, bounds do not
    model.params_ = Bunch(**p)
    model.A_, model.B_, model.C_ = p["A"], p["B"], p["C"]
    (nx, nv), ny, nd = model.B_.shape, len(model.C_), len(structure.given)
    model.D_ = p.get("D", np.zeros((ny, nv)))
    model.G_ = p.get("G", np.zeros((nx, nd)))
    model.H_ = p.get("H", np.zeros((ny, nd)))
    model.K_ = p.get("K", np.zeros((nx, ny)))
    model.K_b_ = p.get("K_b", np.zeros((0, ny)))
    model.nx_ = nx
    if "h_sees" in structure.options:
        model.h_sees_ = structure.options["h_sees"]
    model.u_offset_, model.y_offset_ = scaling.u_offset, scaling.y_offset


def as_fitted(model):
    """Return a model with the options of its fit, whatever was set since.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    model : estimator
        The same results behind these options.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    """
    check_is_fitted(model)
    fitted = copy.copy(model)
    vars(fitted).update(model._options)
    return fitted


def free_entries(model, n):
    """Return which entries of (theta, x0) nothing holds.

    Parameters
    ----------
    model : estimator
        Fitted model.
    n : int
        Length of the free vector.

    Returns
    -------
    free : ndarray of bool of shape (n,)
        Whether an entry is free.
    """
    free = np.ones(n, dtype=bool)
    free[model._structure.n_params :] = not model._at_rest
    structure = model._structure
    held = idle(structure, model._theta, getattr(model, "alpha_", 0.0))
    for name, (low, high) in (model._scaled_bounds(structure) | held).items():
        free[structure.slices[name]] = np.not_equal(low, high).ravel()
    return free

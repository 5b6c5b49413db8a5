"""Fits to experiments that live elsewhere (`distributed`)."""

import numpy as np

from ..containers import Container
from ..region import Region
from ..scaling import Scaling
from ..simulation import runs
from ._checks import order_choices
from ._disturbances import check_disturbances
from ._integrators import find_integrators
from ._noise import check_noise
from ._periodic import check_periodic
from ._time import check_time


def fit_remote(model, experiments):
    """Fit to experiments on a cluster, in the units of the user.

    Parameters
    ----------
    model : estimator
        Model, fitted or not.
    experiments : distributed.Remote
        Experiments.

    Returns
    -------
    model : estimator
        The fitted model.
    """
    watch = model._watch()
    model._validate_params()
    order_choices(model.nx)
    check_noise(model)
    check_time(model)
    check_periodic(model, is_here=False)
    if getattr(model, "validation_fraction", None) is not None:
        raise ValueError(
            "`validation_fraction` must be None for experiments on a cluster, got "
            f"{model.validation_fraction}. Keep whole experiments for `score`."
        )
    with model._undone_unless(watch):
        _fit_checked(model, experiments, watch)
    return model


def _fit_checked(model, experiments, watch):
    """Scale the data where they are, then fit."""
    nu, ny = experiments.shape
    warm = model._continues(nu, ny)
    model.n_features_in_ = nu
    model.disturbances_ = check_disturbances(model, nu)
    if not warm:
        u, y = experiments.moments
        model._scaling = Scaling.from_moments(u, y, model.operating_point)
        model._x_scale = np.ones(1)
        model.__dict__.pop("_decay", None)
        model.integrators_ = 0
    model.experiments_ = list(range(len(experiments)))
    model._container = Container()
    model.output_names_ = None
    model._y_ndim = 1 if experiments.y_ndim == 1 else 2
    at_once = experiments.scaled(model._scaling, np.zeros(nu, dtype=int))
    model.input_delay_ = model._delays(at_once)
    scaled = experiments.scaled(model._scaling, model.input_delay_)
    if not warm and find_integrators(model, scaled, watch):
        scaled = experiments.scaled(model._scaling, model.input_delay_)
    model._complete(scaled, watch, None, warm)


def training_region(model, structure, x0, experiments):
    """Return the region that simulations of scaled experiments cover.

    Parameters
    ----------
    model : estimator
        Fitted model.
    structure : Structure
        What was fitted: a predictor, of a model with innovations.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : Held or Remote
        Experiments of the fit.

    Returns
    -------
    region : Region
        The region, in the user's units.
    """
    lure = structure.lure(model._theta)
    nx = structure.sizes["x"]  # without a random walk
    x_scale = np.broadcast_to(model._x_scale, nx)
    scales = x_scale, model._scaling.u_scale, model._scaling.y_scale
    return Region.of_parts(
        lambda function: experiments.map(_Visit(lure, scales, function), x0)
    )


class _Visit:
    """Apply a function to the simulated chunks of an experiment, where it lives."""

    def __init__(self, lure, scales, function):
        self.lure, self.scales, self.function = lure, scales, function

    def __call__(self, x0, u_s, y_s):
        return self.function(self._chunks(x0, u_s, y_s))

    def _chunks(self, x0, u_s, y_s):
        lure, (x_scale, u_scale, y_scale) = self.lure, self.scales
        # behind them, a predictor is told the outputs
        nx, nu = len(x_scale), len(u_scale)
        for part, u, X, y_hat in runs(lure, u_s, x0):
            y = np.where(np.isnan(y_s[part]), y_hat, y_s[part])
            du = u[:, :nu] * u_scale
            yield X[:, :nx] * x_scale, du, y_hat * y_scale, y * y_scale

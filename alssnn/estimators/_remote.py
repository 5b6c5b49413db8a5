"""Fits to experiments that live elsewhere (`distributed`)."""

from collections.abc import Callable

import numpy as np

from ..containers import Container
from ..region import Region
from ..scaling import Scaling
from ..simulation import regressors, trajectory
from ._fitted import Fitted


class RemoteMixin(Fitted):
    """Fit from scaled experiments, in this process or on the workers of a cluster."""

    _validate_params: Callable
    _watch: Callable
    _set_delay: Callable
    _complete: Callable
    _find_integrators: Callable
    _continues: Callable
    _nx_choices: Callable
    max_time: float | None
    validation_fraction: float | None = None
    operating_point: str | tuple

    def _fit_remote(self, experiments):
        """Fit to `distributed.Remote` experiments, in the units of the user."""
        watch = self._watch()
        self._validate_params()
        self._nx_choices()
        if self.validation_fraction is not None:
            raise ValueError(
                "`validation_fraction` must be None for experiments on a cluster, got "
                f"{self.validation_fraction}. Keep whole experiments for `score`."
            )
        nu, ny = experiments.shape
        warm = self._continues(nu, ny)
        self.n_features_in_ = nu
        if not warm:
            u, y = experiments.moments
            self._scaling = Scaling.from_moments(u, y, self.operating_point)
            self._x_scale = np.ones(1)
            self.__dict__.pop("_decay", None)
            self.integrators_ = 0
        self.experiments_ = list(range(len(experiments)))
        self._container = Container()
        self.output_names_ = None
        self._y_ndim = 1 if experiments.y_ndim == 1 else 2
        at_once = experiments.scaled(self._scaling, np.zeros(nu, dtype=int))
        self._set_delay(at_once, nu)
        scaled = experiments.scaled(self._scaling, self.input_delay_)
        if not warm and self._find_integrators(scaled, watch):
            scaled = experiments.scaled(self._scaling, self.input_delay_)
        self._complete(scaled, watch, None, warm)
        return self

    def _training_region(self, experiments):
        """Return the region that simulations of the scaled experiments cover."""
        lure = self._structure.lure(self._theta)
        scales = self._x_scale, self._scaling.u_scale, self._scaling.y_scale
        x0 = self.x0_ / self._x_scale
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
        Theta_y = lure.Theta[lure.nx : lure.nx + lure.nz].T
        for part, u, X in trajectory(lure, u_s, x0):
            y_hat = regressors(lure, X[:-1], u) @ Theta_y
            y = np.where(np.isnan(y_s[part]), y_hat, y_s[part])
            yield X[:-1] * x_scale, u * u_scale, y_hat * y_scale, y * y_scale

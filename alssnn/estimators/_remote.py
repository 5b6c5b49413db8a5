"""Fits to experiments that live elsewhere (`distributed`)."""

from collections.abc import Callable

import numpy as np

from ..experiments import Scaling
from ..linearizability import Region
from ..simulation import regressors, trajectory
from ..watch import Watch
from ._fitted import Fitted

REGION_SAMPLES = 1_000_000  # of a long record, which span the training region


class RemoteMixin(Fitted):
    """Fit from scaled experiments, in this process or on the workers of a cluster."""

    _validate_params: Callable
    _reporter: Callable
    _set_delay: Callable
    _complete: Callable
    max_time: float | None
    validation_fraction: float | None = None
    operating_point: str | tuple

    def _fit_remote(self, experiments):
        """Fit to `distributed.Remote` experiments, in the units of the user."""
        watch = Watch(max_time=self.max_time, report=self._reporter())
        self._validate_params()
        if self.validation_fraction is not None:
            raise ValueError(
                "`validation_fraction` must be None for experiments on a cluster, got "
                f"{self.validation_fraction}. Keep whole experiments for `score`."
            )
        nu, _ = experiments.shape
        warm = getattr(self, "warm_start", False) and hasattr(self, "_theta")
        self.n_features_in_ = nu
        if not warm:
            u, y = experiments.moments
            self._scaling = Scaling.from_moments(u, y, self.operating_point)
            self._x_scale = np.ones(1)
        self.experiments_ = list(range(len(experiments)))
        self.output_names_ = None
        self._y_ndim = 1 if experiments.y_ndim == 1 else 2
        at_once = experiments.scaled(self._scaling, np.zeros(nu, dtype=int))
        self._set_delay(at_once, nu)
        scaled = experiments.scaled(self._scaling, self.input_delay_)
        self._complete(scaled, watch, None, warm)
        return self

    def _training_region(self, experiments):
        """Return the region that simulations of the scaled experiments cover."""
        every = -(-experiments.n_samples // REGION_SAMPLES)
        visit = _Visit(self._structure.lure(self._theta), self.nx_, every)
        samples = experiments.map(visit, self.x0_ / self._x_scale)
        X, u, y_hat, y = (np.vstack(signal) for signal in zip(*samples, strict=True))
        u_scale, y_scale = self._scaling.u_scale, self._scaling.y_scale
        return Region.of(X * self._x_scale, u * u_scale, y_hat * y_scale, y * y_scale)


class _Visit:
    """Return states, inputs, simulated and measured outputs, some of the samples."""

    def __init__(self, lure, nx, every):
        self.lure, self.nx, self.every = lure, nx, every

    def __call__(self, x0, u_s, y_s):
        lure, nx, samples = self.lure, self.nx, []
        for part, u, X in trajectory(lure, u_s, x0):
            Phi = regressors(lure, X[:-1], u)[:: self.every]
            y_hat = Phi @ lure.Theta[nx : nx + lure.nz].T
            y = y_s[part][:: self.every]
            y = np.where(np.isnan(y), y_hat, y)
            samples.append((Phi[:, :nx], Phi[:, nx : nx + lure.nu], y_hat, y))
        return tuple(np.vstack(signal) for signal in zip(*samples, strict=True))

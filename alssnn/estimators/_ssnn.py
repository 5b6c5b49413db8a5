"""The training that all estimators with networks share."""

from abc import abstractmethod
from numbers import Integral
from typing import ClassVar

import numpy as np
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import StrOptions

from ..stability import contractive_basis
from ..structures import state_space_structure
from ..training import initial_theta, train
from ._base import POSITIVE, WEIGHT, StateSpaceModel


class Ssnn(StateSpaceModel):
    """Share the training of models with networks."""

    _parameter_constraints: ClassVar[dict] = {
        **StateSpaceModel._parameter_constraints,
        "alpha": [WEIGHT],
        "n_init": [POSITIVE],
        "coarse_samples": [POSITIVE, None],
        "polish_iter": [POSITIVE],
        "method": [StrOptions({"lm", "trf"})],
        "random_state": ["random_state"],
        "n_jobs": [Integral, None],
        "warm_start": ["boolean"],
    }

    # What a preset fixes and another lets the user choose.
    gamma: float = 0.0
    gamma_k: float = 0.0
    gamma_h: float = 0.0
    feedthrough: bool = False
    penalty: str | None = None
    stability: str | None = None
    phi: float = 0.0
    continuation: int = 0

    @abstractmethod
    def _networks(self):
        """Return the sizes and kinds of networks, for `state_space_structure`."""

    def _identify(self, experiments, previous):
        report = self._reporter()
        networks = {**self._networks(), "feedthrough": self.feedthrough}
        phi = self.phi if self.stability == "contractive" else None
        if previous is not None and self._fits(previous[0], networks):
            plain, starts = previous[0], [previous[1]]
        else:
            linear = self._linear_model(experiments, report)
            if phi is not None:
                linear = contractive_basis(linear, phi)
                self._x_scale = np.ones(len(linear.A))  # a basis of its own
            nx, nu, ny = len(linear.A), linear.B.shape[1], len(linear.C)
            plain = state_space_structure(nx, nu, ny, C=linear.C, **networks)
            if plain.nw == 0 and phi is None and not self._shapes_linear():
                return linear.as_fit()  # nothing to train beyond the linear model
            random_state = check_random_state(self.random_state)
            seeds = random_state.randint(np.iinfo(np.int32).max, size=self.n_init)
            starts = [
                initial_theta(plain, linear, experiments, np.random.default_rng(seed))
                for seed in seeds
            ]
        nx, nu, ny = (plain.sizes[axis] for axis in "xuy")
        penalized = state_space_structure(
            nx,
            nu,
            ny,
            C=plain.constants["C"],
            penalty=self.penalty if self.gamma > 0 or self.gamma_k > 0 else None,
            penalize_h=self.gamma_h > 0,
            **networks,
        )
        result = train(
            penalized,
            experiments,
            starts,
            weights={
                "gamma": self.gamma,
                "gamma_k": self.gamma_k,
                "gamma_h": self.gamma_h,
                "alpha": self.alpha,
                "output_weight": self._output_weight(ny),
            },
            phi=phi,
            bounds=self._scaled_bounds(plain, contractive=phi is not None),
            continuation=self.continuation,
            coarse_samples=self.coarse_samples,
            polish_iter=self.polish_iter,
            n_jobs=self.n_jobs,
            method=self.method,
            max_iter=self.max_iter,
            tol=self.tol,
            report=report,
        )
        return plain, result.theta, result

    def _fits(self, structure, networks):
        """Tell whether a fitted structure is the one the parameters ask for."""
        nx, nu, ny = (structure.sizes[axis] for axis in "xuy")
        if self.nx not in ("auto", nx) or nu != self.n_features_in_:
            return False
        if "C" not in structure.constants:  # the linear model
            return False
        C = structure.constants["C"]
        wanted = state_space_structure(nx, nu, ny, C=C, **networks)
        return (
            wanted.shapes == structure.shapes
            and wanted.activations == structure.activations
        )

"""What a training may move, and how far."""

import numpy as np

from .criterion import Restricted
from .following import Following, following
from .innovations import drift_of
from .optimizers import FAINT, minimize
from .stability import Contractive, Schur


class Limits:
    """Keep parameters where they may be: a contraction, bounds, held entries.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    phi : float or None, default=None
        Rate of stability by construction (eq. contract); None leaves A free.
    bounds : dict of str to tuple of ndarray, or None, default=None
        Lower and upper bounds of parameters by name; equal ones hold an entry.
    at_rest : bool, default=False
        Whether the initial states are held at zero.
    radius : float or None, default=None
        Largest modulus of an eigenvalue of an A that is free; None means no limit.
    """

    def __init__(self, structure, phi=None, bounds=None, at_rest=False, radius=None):
        self.structure = structure
        self.phi, self.radius = phi, radius
        self.at_rest = at_rest
        self.low = np.full(structure.n_params, -np.inf)
        self.high = np.full(structure.n_params, np.inf)
        for name, (low, high) in (bounds or {}).items():
            where, shape = structure.slices[name], structure.shapes[name]
            self.low[where] = np.broadcast_to(low, shape).ravel()
            self.high[where] = np.broadcast_to(high, shape).ravel()
        # a contraction leaves integrators alone, whose columns of A are held
        A = structure.slices.get("A", slice(0))
        held = (self.low[A] == self.high[A]).reshape(structure.shapes.get("A", (0, 0)))
        self.n_integrators = int(held.all(axis=0).sum())
        if self.n_integrators == len(held):
            self.phi = self.radius = None  # nothing is left to contract

    def clip(self, theta):
        """Return parameters moved into their bounds.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Flat parameters.

        Returns
        -------
        theta : ndarray of shape (n_params,)
            Flat parameters, with a random walk that follows (eq. drift).
        """
        theta = np.clip(theta, self.low, self.high)
        if drift_of(self.structure) is None:
            return theta
        return following(self.structure, theta)[0]

    def minimize(self, criterion, free, *, method="lm", **options):
        """Minimize a criterion within the limits.

        Parameters
        ----------
        criterion : Criterion
            Criterion of (theta, x0).
        free : ndarray of shape (n,)
            Start, within the limits.
        method : {"lm", "trf"}, default="lm"
            Method of `optimizers.minimize`; bounds take "trf" in any case.
        **options : dict
            Further options of `optimizers.minimize`.

        Returns
        -------
        result : OptimizeResult
            Its outcome, with the whole free vector in ``x``.
        """
        low, high = np.full(len(free), -np.inf), np.full(len(free), np.inf)
        n_params = len(self.low)
        low[:n_params], high[:n_params] = self.low, self.high
        if self.at_rest:
            low[n_params:] = high[n_params:] = 0.0
        held = low == high
        problem = criterion = criterion.holding(held[:n_params])
        start = free
        drifts = drift_of(self.structure) is not None
        if drifts:
            problem = criterion = Following(criterion)
        if self.phi is not None:
            problem = Contractive(criterion, self.phi, self.n_integrators)
            start = problem.from_free(free)
        elif self.radius is not None or self.structure.sampling is not None:
            radius = np.inf if self.radius is None else self.radius
            problem = Schur(criterion, radius, self.n_integrators)
        part = Restricted(problem, start, ~held) if held.any() else None
        bounds = low[~held], high[~held]

        def whole(x):
            x = part.to_free(x) if part else x
            x = problem.to_free(x) if self.phi is not None else x
            return criterion.to_free(x) if drifts else x

        if np.isfinite(bounds).any():
            method, options["bounds"] = "trf", bounds
        result = minimize(
            part or problem,
            start[~held],
            method=method,
            to_point=whole,
            faint=FAINT,
            **options,
        )
        result.x = whole(result.x)
        return result

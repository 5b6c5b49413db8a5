"""Integrators of a fit: how many there are, and what of A they hold."""

from collections.abc import Callable
from dataclasses import replace
from numbers import Integral
from typing import Any

import numpy as np

from ..given_system import GivenSystem
from ..integrators import (
    count_integrators,
    identify_integrating,
    integrator_entries,
)
from ..mapping import Held
from ..subspace import identify_linear, simulation_error
from ._fitted import Fitted

AUTO = "auto"


class IntegratorsMixin(Fitted):
    """Declare or find integrators, and hold their poles at one (eq. integrate)."""

    integrators: int | str = 0  # what a model does not offer
    integrators_: int
    linear_start: Any
    nx: Any
    operating_point: str | tuple
    _near: Callable
    _choose_order: Callable

    def _find_integrators(self, experiments, watch):
        """Set `integrators_`; tell whether the operating point moved to their rest.

        What is identified on the way is kept for `_identified_linear`.
        """
        is_auto = self.integrators == AUTO
        self.integrators_ = 0 if is_auto else int(self.integrators)
        # the states of a linear start are the user's: nothing to find, or to move
        if self.integrators == 0 or self.linear_start is not None:
            return False
        near = self._near(Held.of(experiments))
        model = self._plain_linear(near, self.nx, watch)
        if is_auto:
            self.integrators_ = count_integrators(near, model)
        n, ny = self.integrators_, len(model.C)
        if isinstance(self.nx, str) and len(model.A) <= n <= ny:
            model = self._plain_linear(near, n + 1, watch)
        self._check_count(len(model.A), ny)
        if n == 0:
            self._identified = model
            return False
        moves = self.operating_point == "mean" and not self._at_rest
        found = identify_integrating(
            near, model, n, offset=moves, watch=watch, **self._refinement()
        )
        # of what was found: nobody is to begin with a worse model for it
        if is_auto and found.model.result.cost > simulation_error(near, model) ** 2:
            self.integrators_, self._identified = 0, model
            return False
        self._identified = found.model
        scaling = self._scaling
        self._scaling = replace(
            scaling,
            u_offset=scaling.u_offset - scaling.u_scale * found.u_shift,
            y_offset=scaling.y_offset + scaling.y_scale * found.y_shift,
        )
        return moves

    def _refinement(self):
        """Return the options of the search for the linear model."""
        return {}

    def _plain_linear(self, experiments, nx, watch):
        """Return the linear model without integrators."""
        if not isinstance(nx, Integral):
            nx = self._choose_order(experiments, watch)
        return identify_linear(
            experiments,
            nx,
            feedthrough=getattr(self, "feedthrough", False),
            watch=watch,
            **self._refinement(),
        )

    def _identified_linear(self, experiments, watch):
        """Return the linear model of scaled experiments, integrators included."""
        found = vars(self).pop("_identified", None)
        if found is None:
            found = self._plain_linear(experiments, self.nx, watch)
            if self.integrators_:  # a warm start that the model does not fit
                self._check_count(len(found.A), len(found.C))
                found = identify_integrating(
                    experiments, found, self.integrators_, offset=False, watch=watch
                ).model
        return found

    def _check_count(self, nx, ny):
        """Refuse more integrators than states or outputs."""
        if self.integrators_ > min(nx, ny):
            raise ValueError(
                f"`integrators` must be at most the number of states ({nx}) and of "
                f"outputs ({ny}), got {self.integrators}. Increase `nx`, or take one "
                "per output that integrates."
            )

    def _check_given_integrators(self, A, ny):
        """Refuse a linear start that does not have its integrators last."""
        n = self.integrators_
        self._check_count(len(A), ny)
        if n and np.any(A[:, len(A) - n :] != np.eye(len(A))[:, len(A) - n :]):
            raise ValueError(
                f"`linear_start` must have its {n} integrators last, as columns of A "
                "that are zero but for a one on the diagonal, got "
                f"{A[:, len(A) - n :].tolist()}. Change the basis of its states."
            )

    def _with_integrators(self, bounds, structure):
        """Return bounds that hold the rows and columns of integrators in A as well."""
        n = self.integrators_
        if n == 0 or "A" not in structure.parameters:
            return bounds
        nx = structure.sizes["x"]
        held, value = integrator_entries(nx, n), np.eye(nx)
        if self.linear_start is not None and self._keeps_start:
            scale = np.broadcast_to(self._x_scale, nx)
            A = GivenSystem.of(self.linear_start).A * scale / scale[:, None]
            value[nx - n :, : nx - n] = A[nx - n :, : nx - n]
        low, high = bounds.get("A", (np.full_like(value, -np.inf),) * 2)
        if "A" not in bounds:
            high = -low
        elif np.any((value < low) | (value > high), where=held):
            raise ValueError(
                "`bounds` of A must allow the zeros and ones of integrators in the "
                f"last {n} columns, and their rows as they are in `linear_start`, got "
                "others. Use -inf and inf there."
            )
        fixed = tuple(np.where(held, value, bound) for bound in (low, high))
        return {**bounds, "A": fixed}

    @property
    def _keeps_start(self):
        """Whether the states are those of the linear start."""
        return getattr(self, "_phi", None) is None

    def _regular(self, A):
        """Return the block of A without integrators."""
        n = len(A) - self.integrators_
        return A[:n, :n]

    def _note(self):
        """Return what is to be said of integrators that were found."""
        if self.integrators != AUTO or not self.integrators_:
            return ""
        n = self.integrators_
        what = "an integrator, its pole" if n == 1 else f"{n} integrators, their poles"
        return f"; the record shows {what} held at 1"

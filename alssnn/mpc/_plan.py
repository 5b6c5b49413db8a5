"""The online update: the program of this sample, posed along the last plan (eq. mpc).

The last inputs, shifted by one sample, give a trajectory of the whole model.  Along it
h and omega are numbers, and with them the program of `_condensed` is convex.  Its
solution is the next plan; a second pass starts from that.
"""

from dataclasses import dataclass, replace

import numpy as np

from ._inputs import Added, Mapped
from ._qp import Solution


@dataclass(frozen=True, eq=False)
class Pass:
    """Hold one pass: the solution of its program, and what it means.

    Parameters
    ----------
    solution : Solution
        What the solver says.
    X : ndarray of shape (N, nx)
        Planned states x_1, ..., x_N; without a solution those of the last plan.
    inputs : Added or Mapped
        What lies between u and the linear model, along the last plan.
    wanted : ndarray of shape (nu,)
        Input for now, before the limits cut it.
    slack : ndarray of shape (N, n_soft)
        Excess of the soft bounds.
    """

    solution: Solution
    X: np.ndarray
    inputs: Added | Mapped
    wanted: np.ndarray
    slack: np.ndarray


class Planner:
    """Plan inputs, from one sample to the next.

    Parameters
    ----------
    model : DisturbedModel
        The model.
    program : CondensedProgram
        Its program.
    limits : ActuatorLimits
        Limits of u.

    Attributes
    ----------
    U : ndarray of shape (N, nu)
        Planned inputs, in the units of u, within the limits.
    """

    def __init__(self, model, program, limits):
        self.model, self.program, self.limits = model, program, limits
        self.horizon = program.prediction.V_c.shape[0] // len(model.u_scale)
        self.reset()

    def reset(self):
        """Start from the operating point, as far as the limits allow it."""
        self.U = np.tile(self.limits.clip(self.model.u_offset), (self.horizon, 1))
        self.program.qp.reset()

    def shift(self, u_s):
        """Move the plan on by one sample.

        Parameters
        ----------
        u_s : ndarray of shape (nu,)
            Input behind its end.
        """
        self.U = np.vstack([self.U[1:], u_s])

    def improve(self, x, d, u_last, rest, soft_bounds, m=None):
        """Pose and solve the program along the last plan, and take its solution.

        Parameters
        ----------
        x : ndarray of shape (nx,)
            State now.
        d : ndarray of shape (nd,)
            Disturbance.
        u_last : ndarray of shape (nu,)
            Input of the last sample.
        rest : tuple of ndarray of shape (N, nx) or (1, nx), and (N, nu) or (1, nu)
            States of rest and their scaled v.
        soft_bounds : tuple of two ndarray of shape (n_soft,)
            Bounds of the soft rows.
        m : ndarray of shape (N, nm) or None, default=None
            Measured disturbances, now and ahead, if there are any.

        Returns
        -------
        result : Pass
            What came of it. Without a solution the last plan stays.
        """
        model, limits = self.model, self.limits
        self.U = limits.held(u_last, self.U)
        X = model.trajectory(x, d, self.U, m)  # (N + 1, nx)
        inputs = model.inputs(X[:-1], self.U, m)
        solution, plan = self.program.solve(
            x,
            model.omega(X, inputs.V),
            rest,
            inputs.rows(limits, u_last),
            soft_bounds,
        )
        if plan is not None:
            X_new, V, slack = plan
            wanted = inputs.u(V, np.vstack([x, X_new[:-1]]))
            found = np.isfinite(wanted).all(axis=1)
            if found[0]:  # later ones stay those of the last plan, if not found
                wanted = np.where(found[:, None], wanted, self.U)
                self.U = limits.held(u_last, wanted)
                return Pass(solution, X_new, inputs, wanted[0], slack)
            solution = replace(solution, x=None, status="no u found for v")
        # what was applied may be far from what this plan has begun with
        wanted, self.U = self.U[0], limits.followed(u_last, self.U)
        X = model.trajectory(x, d, self.U, m)
        slack = self.program.soft.excess(X[1:], soft_bounds)
        return Pass(solution, X[1:], inputs, wanted, slack)

"""What a predictive controller did, at one sample and along a simulation."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..feedback import LoopRecord
from ..shown import short_repr


@dataclass(frozen=True, eq=False)
class MpcStep:
    """Hold what happened in one step of a predictive controller.

    Parameters
    ----------
    status : str
        What the solver says; "solved" if all is well.
    fallback : bool
        Whether the solver failed, so that the last plan, shifted, was used instead.
    target_status : str
        "closed form" where the bounds leave the state of rest alone, else what the
        solver says of it.
    solve_time : float
        Time in the solver, in seconds, over all passes.
    step_time : float
        Time of the whole step, in seconds.
    iterations : int
        Iterations of the solver, over all passes.
    u : ndarray of shape (nu,)
        Input for the plant, in the units of u.
    v : ndarray of shape (nu,)
        Input of the linear system, u + h(s).
    cut : ndarray of shape (nu,)
        What the limits cut off the planned input. After a solution it is of the size
        of the tolerance, unless the last input was outside the limits, or these are
        linearized.
    saturated : ndarray of bool of shape (nu,)
        Whether a limit of u or its rate is reached.
    slack_y : ndarray of shape (ny,)
        Largest excess of the soft bounds along `y_plan`, in the units of y.
    slack_x : ndarray of shape (nx,)
        The same for the states.
    target_error : ndarray of shape (ny,)
        Output at rest minus the (last) reference; not zero if bounds or the number of
        inputs keep the outputs from it. Of a nonlinear model it needs some samples
        after a large step of the reference: a state of rest moves by at most one
        standard deviation of states and inputs with every program.
    x_hat : ndarray of shape (nx,)
        Estimated state.
    disturbance : ndarray of shape (nd,)
        Estimated disturbance, in the units of y or u; not one that is measured.
    y_plan : ndarray of shape (horizon, ny)
        Planned outputs of the next samples, by the last program; see the notes.
    u_plan : ndarray of shape (horizon, nu)
        Planned inputs, of this sample and the next ones, within the limits.

    Notes
    -----
    `y_plan` is what the linear model of the last program does under its v, with the
    residual and an input disturbance as numbers along the plan before (eq. mpc). It is
    not exactly what the whole model does under `u_plan`. Both are the same without a
    residual, where no limit cuts the plan. They differ most, by tenths of a standard
    deviation, in the first steps after a change of the reference or after an input
    that was not planned, and far along the horizon. With `n_passes` they come closer,
    and after a solver that failed `y_plan` is that of the whole model.

    For what the whole model does, start at z = [x_hat, disturbance] and call ``z =
    mpc.observer.plant.step(z, u)`` and ``mpc.observer.plant.output(z)`` for every row u
    of `u_plan`. That is an open loop: of an unstable plant it runs away from a plan
    that every sample corrects, so that `y_plan` is the better forecast of the loop.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> mpc = model.mpc(horizon=5, u_min=-1, u_max=1)
    >>> u = mpc.step(0.1, y=[0.0])
    >>> mpc.info_.status, mpc.info_.u_plan.shape
    ('solved', (5, 1))
    """

    __repr__ = short_repr

    status: str
    fallback: bool
    target_status: str
    solve_time: float
    step_time: float
    iterations: int
    u: np.ndarray
    v: np.ndarray
    cut: np.ndarray
    saturated: np.ndarray
    slack_y: np.ndarray
    slack_x: np.ndarray
    target_error: np.ndarray
    x_hat: np.ndarray
    disturbance: np.ndarray
    y_plan: np.ndarray
    u_plan: np.ndarray


@dataclass(frozen=True, eq=False)
class MpcRecord(LoopRecord):
    """Hold a closed loop of plant and predictive controller, one row per sample.

    Parameters
    ----------
    t : ndarray of shape (N,)
        Time, in seconds.
    y : ndarray of shape (N, ny)
        Measured outputs, noise included.
    u : ndarray of shape (N, nu)
        Inputs that the controller asks for.
    d : ndarray of shape (N, nd)
        Measured disturbances, in the units of u.
    reference : ndarray of shape (N, ny)
        References.
    steps : list of MpcStep
        What happened at every sample.
    law : LinearizingLaw
        The law, which knows limits and names of the signals.
    tracks : bool, default=True
        Whether references are those of y, as here.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> run = model.mpc(horizon=5).simulate(model, np.full((20, 1), 0.1))
    >>> run.y.shape, run.x_hat.shape, run.n_fallbacks
    ((20, 1), (20, 4), 0)
    """

    of_step: ClassVar[Any] = MpcStep

    @property
    def n_fallbacks(self):
        """Return in how many steps the solver failed."""
        return int(sum(step.fallback for step in self.steps))

    def __repr__(self):
        """Return the figures that matter first."""
        statuses, counts = np.unique(self.status, return_counts=True)
        times = 1e3 * self.step_time
        lines = [
            f"predictive control, {len(self.t)} samples",
            "  status      "
            + ", ".join(f"{s}: {n}" for s, n in zip(statuses, counts, strict=True)),
            f"  fallbacks   {self.n_fallbacks}",
            f"  saturated   {np.mean(self.saturated.any(axis=1)):.1%} of the samples",
            f"  step        median {np.median(times):.2f} ms, max {times.max():.2f} ms",
        ]
        return "\n".join(lines)

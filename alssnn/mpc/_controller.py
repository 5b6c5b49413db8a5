"""The predictive controller: what the user sees, and the order of a step (eq. mpc).

Inside, v is a deviation from u_offset in standard deviations of the training data and
y counts in its own, so that tolerances and penalties mean the same for all signals;
what is public has the units of the user.
"""

import time
from numbers import Real

import numpy as np

from ..checks import is_count
from ..feedback import Controller, LinearizingLaw
from ..feedback.checks import check_limits, check_measured, check_point, check_weight
from ..plants import as_plant
from ._checks import check_ahead, check_observer, check_penalty, check_rate
from ._condensed import CondensedProgram, Weights
from ._limits import ActuatorLimits
from ._model import DisturbedModel
from ._plan import Planner
from ._record import MpcRecord, MpcStep
from ._soft import SoftBounds
from ._target import STEP, StatesOfRest, Target

RESTS = 5  # steps of Newton's method for states of rest, before every program


class LinearizingMPC(Controller):
    """Control a plant by predictive control of its linearized model (eq. mpc).

    Every sample, an observer estimates the state and a constant disturbance, a target
    problem finds the state of rest for the reference, and a quadratic program plans
    v; the plant receives u = v - h(s), or phi^-1(v, s) for a monotone map, within its
    limits. s is the output or the state of the model.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    horizon : int, default=20
        Number of samples that are planned.
    Q : array_like of shape (nx, nx) or None, default=None
        Weight of the states, as for `lqr`. None weighs the outputs by their variance
        in the training data, C' diag(1 / var(y)) C.
    R : array_like of shape (nu, nu) or None, default=None
        Weight of v; None means 0.1 diag(1 / var(u)).
    u_min, u_max : float, array_like of shape (nu,) or None, default=None
        Limits of the actuators, in the units of u; None means no limit. They are never
        violated.
    du_max : float, array_like of shape (nu,) or None, default=None
        Limit of the change of u per sample; never violated unless the limits of u
        force it.
    y_min, y_max : float, array_like of shape (ny,) or None, default=None
        Soft bounds of the outputs, in the units of y.
    x_min, x_max : float, array_like of shape (nx,) or None, default=None
        Soft bounds of the states, which have about unit variance.
    Q_target : array_like of shape (ny, ny) or None, default=None
        Weight of the error at rest, which matters where not all outputs can reach
        their references; None means diag(1 / var(y)). A zero on the diagonal frees an
        output.
    slack_weight : tuple of two floats, default=(100.0, 100.0)
        Linear and quadratic price of an excess s of a soft bound, p s + w s^2 / 2 with
        outputs in standard deviations, in a cost of which all terms are halved.
    observer : Observer, DisturbanceObserver or None, default=None
        Source of the estimates; None means ``DisturbanceObserver(model, gate=100)``,
        which spikes of a sensor do not lead astray. If the model was fitted with a
        `drift`, it has the identified gain (eq. drift), and a gate of two standard
        deviations of y at least, for the drift begins anywhere. An observer without a
        disturbance leaves an offset where the plant differs from the model. The
        controller steps and resets it.
    n_passes : int, default=2
        How many programs are solved per sample, each with h and the residual along the
        plan of the one before.
    tol : float, default=1e-6
        Tolerance of the solver.
    max_iter : int, default=4000
        Limit of its iterations, per program.

    Attributes
    ----------
    info_ : MpcStep or None
        What happened in the last step.
    K : ndarray of shape (nu, nx)
        Gain of `lqr` with Q and R, to which the plan tends without bounds.
    P : ndarray of shape (nx, nx)
        Terminal weight, the solution of the Riccati equation.
    observer : Observer
        The observer.
    law : LinearizingLaw
        The law, with the limits of u.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    TypeError
        If `observer` is of another type.
    ValueError
        If a weight is not positive (semi)definite, bounds are crossed, sizes are wrong,
        an unstable mode is not reached by v, or the observer is one of another model.

    See Also
    --------
    alssnn.feedback.LinearizingController : The same law and interface with a linear
        controller, no bounds.

    Notes
    -----
    A step costs `n_passes` programs of horizon * nu variables, and one slack for every
    sample and soft bound. A solver that fails is reported in `info_`; the last plan,
    shifted by one sample and cut to the limits, is then used.

    With ``input_map="monotone"`` limits of rates and of several inputs are linearized
    along the plan, and better known to every further program. The plant receives
    nothing beyond them; `info_.cut` tells what they took from the plan.

    The controller remembers its last plan. It is no block of python-control, which may
    evaluate an output several times per sample; use `step` online and `simulate` for
    any plant of python-control.

    Examples
    --------
    >>> from alssnn.mpc import LinearizingMPC
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> mpc = LinearizingMPC(model, u_min=-2, u_max=2)
    >>> loop = mpc.simulate(model, np.full((300, 1), 0.1))
    >>> loop.y[-1].round(3), loop.n_fallbacks
    (array([0.1]), 0)
    """

    record_type = MpcRecord

    def __init__(
        self,
        model,
        horizon=20,
        Q=None,
        R=None,
        *,
        u_min=None,
        u_max=None,
        du_max=None,
        y_min=None,
        y_max=None,
        x_min=None,
        x_max=None,
        Q_target=None,
        slack_weight=(100.0, 100.0),
        observer=None,
        n_passes=2,
        tol=1e-6,
        max_iter=4000,
    ):
        counts = {"horizon": horizon, "n_passes": n_passes, "max_iter": max_iter}
        for name, value in counts.items():
            if not is_count(value):
                raise ValueError(f"`{name}` must be a positive integer, got {value!r}.")
        if not isinstance(tol, Real) or not 0 < float(tol) < 1:
            raise ValueError(f"`tol` must lie between 0 and 1, got {tol!r}. Try 1e-6.")
        self.horizon, self.n_passes = int(horizon), int(n_passes)
        self._plant = plant = as_plant(model)
        if np.any(plant.delay) or not plant.has_linear_output:
            raise ValueError(
                "`model` must have y = C x and no input delay for predictive control, "
                "for u is computed after y is measured. Fit with input_delay=0, "
                "feedthrough=False and n_k=0."
            )
        super().__init__(LinearizingLaw(plant, u_min, u_max))
        self.observer = check_observer(observer, plant)
        self._model = DisturbedModel(plant, self.observer.plant)
        (self._ny, self._nx), self._nu = self._model.C.shape, len(self.law.u_min)
        su, sy = self._model.u_scale, self._model.y_scale
        du_max = check_rate(du_max, self._nu)
        bounds = (du_max, self.law.u_min, self.law.u_max)[: 1 if self._nu == 1 else 3]
        couple = not plant.is_explicit and bool(np.isfinite(bounds).any())
        self._limits = ActuatorLimits(
            self.law.u_min, self.law.u_max, du_max, su, couple
        )
        options = {"tol": float(tol), "max_iter": int(max_iter)}
        penalty = check_penalty(slack_weight)
        self._soft = SoftBounds.of(
            self._model.C,
            sy,
            check_limits("y", y_min, y_max, self._ny),
            check_limits("x", x_min, x_max, self._nx),
        )
        if Q_target is None:
            Q_target = np.diag(1 / sy**2)
        Q_target = check_weight("Q_target", Q_target, self._ny) * np.outer(sy, sy)
        weights = Weights(plant, self._model, Q, R)
        self.K, self.P = weights.K, weights.P
        program = CondensedProgram(
            self._model,
            weights,
            self.horizon,
            self._soft,
            self._limits,
            penalty,
            options,
        )
        self._planner = Planner(self._model, program, self._limits)
        sx = self._model.x_scale
        sides = self._model.C * sx, Q_target, self._soft.rows * sx
        step = STEP if plant.form.W.any() else np.inf  # a linear model needs one step
        target = Target(*sides, penalty, options, step)
        self._rest = StatesOfRest(self._model, self._limits, target)
        self.reset()

    def __repr__(self):
        """Return horizon, sizes, observer and law in one line."""
        return (
            f"LinearizingMPC(horizon={self.horizon}, {self._nu} u, {self._ny} y, "
            f"{self.observer!r}, {self.law!r})"
        )

    def reset(self, x0=None, u=None):
        """Start anew: forget plan, disturbance and estimate.

        Parameters
        ----------
        x0 : array_like of shape (nx,) or None, default=None
            State before the first measurement; None means the operating point.
        u : array_like of shape (nu,) or None, default=None
            Input applied before the first step, from which `du_max` counts; None means
            the operating point.

        Raises
        ------
        ValueError
            If a size is wrong or a value not finite.
        """
        x0 = check_point("x0", x0, self._nx)
        nd = len(self.observer.Q) - self._nx
        self.observer.reset(np.concatenate([x0, np.zeros(nd)]))
        u = self._model.u_offset if u is None else check_point("u", u, self._nu)
        self._u = np.asarray(u, dtype=float)
        self._reference, self._d = self._plant.y_offset, self._plant.d_offset
        self._rest.reset()
        self._planner.reset()
        self.info_ = None

    # -- one sample --------------------------------------------------------------------

    def step(self, reference, y, u_applied=None, d=None):
        """Return the input for a new measurement.

        Parameters
        ----------
        reference : array_like of shape (ny,) or (horizon, ny)
            Reference of the outputs, in the units of y, constant or for the next
            `horizon` samples; a number if there is one output. One that is nan or
            infinite is that of the sample before, at first the operating point.
        y : array_like of shape (ny,)
            New measurement; what is nan or infinite was not measured.
        u_applied : array_like of shape (nu,) or None, default=None
            Input that the plant received since the last measurement; None, or a value
            that is nan or infinite, means what the last step returned.
        d : array_like of shape (nd,) or (horizon, nd) or None, default=None
            Measured disturbances of this sample, which are taken to last, or of this
            and the next ones, in the order of the record; needed if the model has any.
            One that is nan or infinite is that of the sample before.

        Returns
        -------
        u : ndarray of shape (nu,)
            Input for the plant, finite and within its limits.

        Raises
        ------
        ValueError
            If a size is wrong.
        """
        start = time.perf_counter()
        references = check_ahead(
            "reference", reference, self.horizon, self._ny, self._reference
        )
        measured = self._measured(d)
        if len(measured) > len(references):
            references = np.tile(references, (len(measured), 1))
        y = check_measured(y, self._ny)
        if u_applied is not None:
            given = check_point("u_applied", u_applied, self._nu, missing=True)
            self._u = np.where(np.isnan(given), self._u, given)
        self._reference = references[0]
        z = self.observer.step(self._plant.every_input(self._u, self._d), y)
        x, d = z[: self._nx], z[self._nx :]
        plan_m, rest_m = self._along(measured, len(references))
        rest, planner, last = self._rest, self._planner, self._u
        planner.shift(rest.U[-1])
        rest.advance(len(references))
        solutions, settled = [], False
        with np.errstate(over="ignore", invalid="ignore"):  # a model that diverges
            y0 = self._model.output(np.zeros((1, self._nx)), d)[0]
            goals = (references - y0) / self._model.y_scale
            soft_bounds = self._soft.around(y0)
            for _ in range(self.n_passes):
                # a step of a measured disturbance moves its states of rest at once
                for _ in range(RESTS if measured.size else 1):
                    if not settled:
                        target_status, settled = rest.improve(
                            d, goals, soft_bounds, rest_m
                        )
                result = planner.improve(
                    x, d, last, (rest.X, rest.V), soft_bounds, plan_m
                )
                solutions.append(result.solution)
                if result.solution.x is None:
                    break
            self._u = self._limits.after(last, planner.U[0])
            self.info_ = self._report(
                x, d, result, last, solutions, target_status, references[-1], start
            )
        self._d = measured[0]
        return self._u.copy()

    def _measured(self, d):
        """Return measured disturbances, a row for now or for the horizon."""
        nd = self._plant.nd
        if d is None:
            self._plant.check_disturbances(None)
            return np.empty((1, 0))
        return check_ahead("d", d, self.horizon, nd, self._d)

    def _along(self, measured, n):
        """Return measured disturbances along the plan, and of n states of rest."""
        if not self._plant.nd:
            return None, None
        plan = np.broadcast_to(measured, (self.horizon, measured.shape[1]))
        return plan, plan[-n:]  # v_i rests for d_i, whatever x is to be behind it

    def _report(self, x, d, result, last, solutions, target_status, reference, start):
        """Return what happened in a step that began at `start`."""
        slack_y, slack_x = self._soft.largest(result.slack)
        y_s = self._model.output(self._rest.X[-1:], d)[0]
        return MpcStep(
            status=result.solution.status,
            fallback=result.solution.x is None,
            target_status=target_status,
            solve_time=sum(s.solve_time for s in solutions),
            iterations=sum(s.iterations for s in solutions),
            u=self._u.copy(),
            v=result.inputs.now(self._u),
            cut=result.wanted - self._u,
            saturated=self._limits.reached(last, self._u),
            slack_y=slack_y,
            slack_x=slack_x,
            target_error=y_s - reference,
            x_hat=x,
            disturbance=d,
            y_plan=self._model.output(result.X, d),
            u_plan=self._planner.U.copy(),
            step_time=time.perf_counter() - start,
        )

"""The predictive controller: it poses and solves one program per sample (eq. mpc).

Inside, v is a deviation from u_offset in standard deviations of the training data and
y counts in its own, so that tolerances and penalties mean the same for all signals;
what is public has the units of the user.
"""

import time
from dataclasses import replace
from numbers import Integral

import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov
from sklearn.utils.validation import check_is_fitted

from ..feedback import Dynamics, LinearizingLaw, lqr
from ..feedback.checks import check_limits, check_point, check_weight
from ..feedback.loop import check_plant
from ..simulation import simulate
from ._checks import (
    check_observer,
    check_penalty,
    check_rate,
    check_references,
    check_signal,
)
from ._prediction import Prediction
from ._qp import QuadraticProgram
from ._record import MpcRecord, MpcStep
from ._soft import SoftBounds
from ._target import Target

CHEAP_INPUT = 0.1  # default weight of v against y, both in standard deviations
SETTLED = 1e-3  # smaller steps of the states of rest are left to the next sample
AT_LIMIT = 1e-6  # distance, in standard deviations of u, that counts as reached


class LinearizingMPC:
    """Control a plant by predictive control of its linearized model (eq. mpc).

    Every sample, an observer estimates the state and a constant disturbance, a target
    problem finds the state of rest for the reference, and a quadratic program plans
    v; the plant receives u = v - h(s), within its limits. s is the output or the state
    of the model.

    Parameters
    ----------
    model : estimator
        Fitted model.
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
        Source of the estimates; None means ``DisturbanceObserver(model)``. Without a
        disturbance there is an offset where the plant differs from the model. The
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
    alssnn.feedback.closed_loop : The same law with a linear controller, no bounds.

    Notes
    -----
    A step costs `n_passes` programs of horizon * nu variables, and one slack for every
    sample and soft bound. A solver that fails is reported in `info_`; the last plan,
    shifted by one sample and cut to the limits, is then used.

    The controller remembers its last plan. It is no block of python-control, which may
    evaluate an output several times per sample; use `step` online and `simulate` for
    any plant of python-control.

    Examples
    --------
    >>> from alssnn.mpc import LinearizingMPC
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4).fit(record.u, record.y)
    >>> mpc = LinearizingMPC(model, u_min=-2, u_max=2)
    >>> loop = mpc.simulate(model, np.full((300, 1), 0.1))
    >>> loop.y[-1].round(3), loop.n_fallbacks
    (array([0.1]), 0)
    """

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
        check_is_fitted(model)
        for name, value in (
            ("horizon", horizon),
            ("n_passes", n_passes),
            ("max_iter", max_iter),
        ):
            if not isinstance(value, Integral) or value < 1:
                raise ValueError(f"`{name}` must be a positive integer, got {value!r}.")
        if not 0 < tol < 1:
            raise ValueError(f"`tol` must lie between 0 and 1, got {tol!r}. Try 1e-6.")
        self.horizon, self.n_passes = int(horizon), int(n_passes)
        self._model = Dynamics.of(model)
        if np.any(model.input_delay_) or not self._model.has_linear_output:
            raise ValueError(
                "`model` must have y = C x and no input delay for predictive control, "
                "for u is computed after y is measured. Fit with input_delay=0, "
                "feedthrough=False and n_k=0."
            )
        self._A, self._su, self._sy = (
            model.A_,
            model._scaling.u_scale,
            model._scaling.y_scale,
        )
        self._B, self._C = model.B_ * self._su, model.C_ / self._sy[:, None]
        self._nx, (self._ny, self._nu) = model.nx_, (len(self._C), len(self._su))
        self.law = LinearizingLaw(model, u_min, u_max)
        self._free_law = LinearizingLaw(model)
        self._du_max = check_rate(du_max, self._nu)
        self.observer = check_observer(observer, model)
        options = {"tol": float(tol), "max_iter": int(max_iter)}
        penalty = check_penalty(slack_weight)
        self._soft = SoftBounds.of(
            self._C,
            self._sy,
            check_limits("y", y_min, y_max, self._ny),
            check_limits("x", x_min, x_max, self._nx),
        )
        if Q_target is None:
            Q_target = np.diag(1 / self._sy**2)
        Q_target = check_weight("Q_target", Q_target, self._ny)
        Q_target = Q_target * np.outer(self._sy, self._sy)
        self._condense(model, Q, R, penalty, options)
        self._target = Target(self._C, Q_target, self._soft.rows, penalty, options)
        self.reset()

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
        self._X_s = np.zeros((1, self._nx))
        self._U_s = self._limited(self._model.u_offset)[None]
        self._U = np.tile(self._U_s, (self.horizon, 1))
        self._qp.reset()
        self._target.reset()
        self.info_ = None

    # -- one sample --------------------------------------------------------------------

    def step(self, reference, y, u_applied=None):
        """Return the input for a new measurement.

        Parameters
        ----------
        reference : array_like of shape (ny,) or (horizon, ny)
            Reference of the outputs, in the units of y, constant or for the next
            `horizon` samples; a number if there is one output.
        y : array_like of shape (ny,)
            New measurement.
        u_applied : array_like of shape (nu,) or None, default=None
            Input that the plant received since the last measurement; None means what
            the last step returned.

        Returns
        -------
        u : ndarray of shape (nu,)
            Input for the plant, within its limits.

        Raises
        ------
        ValueError
            If a size is wrong or a value not finite.
        """
        start = time.perf_counter()
        references = check_references(reference, self.horizon, self._ny)
        if y is None:
            raise ValueError("`y` must be a measurement, got None. Hold the last one.")
        y = check_point("y", np.atleast_1d(y), self._ny)
        if u_applied is not None:
            self._u = check_point("u_applied", u_applied, self._nu)
        x, d = np.split(self.observer.step(self._u, y), [self._nx])
        self._U = np.vstack([self._U[1:], self._U_s[-1:]])  # without a solution
        if len(self._X_s) != len(references):
            self._X_s = np.tile(self._X_s[-1], (len(references), 1))
            self._U_s = np.tile(self._U_s[-1], (len(references), 1))
        y0 = self._model_output(np.zeros((1, self._nx)), d)[0]
        goals = (references - y0) / self._sy
        solutions = []
        last = self._u
        with np.errstate(over="ignore", invalid="ignore"):  # a model that diverges
            moved = np.inf
            for _ in range(self.n_passes):
                if moved > SETTLED:
                    target_status, moved = self._rest(d, y0, goals)
                plan = self._plan(x, d, y0)
                solutions.append(plan[0])
                if plan[0].x is None:
                    break
            self._u = self._within_rate(self._U[0])
            self.info_ = self._report(x, d, plan, last, solutions)
            y_s = self._model_output(self._X_s[-1:], d)[0]
        self.info_ = replace(
            self.info_,
            target_status=target_status,
            target_error=y_s - references[-1],
            step_time=time.perf_counter() - start,
        )
        return self._u.copy()

    def _rest(self, d, y0, goals):
        """Improve the states of rest; return the status and how far they moved."""
        nx, u_e, soft = self._nx, self._model.u_offset, self._soft.around(y0)
        dynamics, law = self.observer.dynamics, self.law
        Xd = self._with_disturbance(self._X_s, d)
        A, B, _, _ = dynamics.jacobian(Xd, self._U_s - u_e)
        A, B = A[:, :nx, :nx], B[:, :nx] * self._su
        U_s = (self._U_s - u_e) / self._su
        W = dynamics.step(Xd, self._U_s)[:, :nx]
        W -= np.einsum("nij,nj->ni", A, self._X_s) + np.einsum("nij,nj->ni", B, U_s)
        u_bounds = (law.u_min - u_e) / self._su, (law.u_max - u_e) / self._su
        statuses, X_last = [], self._X_s.copy()
        for i, goal in enumerate(goals):
            last, model = (self._X_s[i], U_s[i]), (A[i], B[i], W[i])
            self._X_s[i], U_s[i], status = self._target.improve(
                last, model, goal, u_bounds, soft
            )
            statuses.append(status)
        self._U_s = self._limited(u_e + U_s * self._su)
        failed = [s for s in statuses if s not in ("closed form", "solved")]
        return (failed or statuses)[-1], np.abs(self._X_s - X_last).max()

    def _plan(self, x, d, y0):
        """Pose and solve the program along the last plan; return solution, h and v."""
        n, nu, nx, law = self.horizon, self._nu, self._nx, self.law
        u_e, su = self._model.u_offset, self._su
        # the last inputs from the present state, by the whole model
        X = simulate(self.observer.dynamics.lure, self._U - u_e, np.concatenate([x, d]))
        X = X[:, :nx]  # (N + 1, nx)
        h = self._h(X[:-1])
        V = (self._U + h - u_e) / su
        w = X[1:] - X[:-1] @ self._A.T - V @ self._B.T
        V_s = (self._U_s + self._h(self._X_s) - u_e) / su
        X_free, V_free = self._prediction.free(x, w)
        q = self._X_cQ @ (X_free - np.broadcast_to(self._X_s, (n, nx)).ravel())
        q += self._V_cR @ (V_free - np.broadcast_to(V_s, (n, nu)).ravel())
        lower = [((law.u_min + h - u_e) / su).ravel() - V_free]
        upper = [((law.u_max + h - u_e) / su).ravel() - V_free]
        if self._rated:
            # the change of u = v - h, from an input that the limits allow
            u_last = (self._limited(self._u) - u_e) / su
            dh = np.diff(h / su, axis=0, prepend=-u_last[None])
            dv = np.diff(V_free.reshape(n, nu), axis=0, prepend=0)
            lower.append((dh - dv - self._du_max / su).ravel())
            upper.append((dh - dv + self._du_max / su).ravel())
        Y_free = X_free.reshape(n, nx) @ self._soft.rows.T  # (N, n_soft)
        y_min, y_max = (bound - Y_free for bound in self._soft.around(y0))
        below = y_min[:, self._soft.below].ravel()
        above = y_max[:, self._soft.above].ravel()
        lower += [below, np.full(above.size, -np.inf), np.zeros(Y_free.size)]
        upper += [np.full(below.size, np.inf), above, np.full(Y_free.size, np.inf)]
        solution = self._qp.solve(
            np.concatenate([q, self._slack_price]),
            np.concatenate(lower),
            np.concatenate(upper),
        )
        if solution.x is None:
            return solution, X[1:], h[0], self._U[0]
        c = solution.x[: n * nu]
        X = (X_free + self._prediction.X_c @ c).reshape(n, nx)
        V = u_e + (V_free + self._prediction.V_c @ c).reshape(n, nu) * su
        wanted = V - self._h(np.vstack([x, X[:-1]]))
        self._U = self._limited(wanted)
        return solution, X, h[0], wanted[0]

    def _report(self, x, d, plan, last, solutions):
        """Return the report of a step, but for target and time."""
        solution, X, h, wanted = plan
        low, high = last - self._du_max, last + self._du_max
        margin = AT_LIMIT * self._su
        low = np.maximum(self.law.u_min, low) + margin
        high = np.minimum(self.law.u_max, high) - margin
        slack = np.zeros((self.horizon, len(self._soft.rows)))
        if solution.x is not None:
            slack = solution.x[self.horizon * self._nu :].reshape(slack.shape)
        slack_y, slack_x = self._soft.largest(slack)
        return MpcStep(
            status=solution.status,
            fallback=solution.x is None,
            target_status="",
            solve_time=sum(s.solve_time for s in solutions),
            step_time=np.nan,
            iterations=sum(s.iterations for s in solutions),
            u=self._u.copy(),
            v=self._u + h,
            cut=wanted - self._u,
            saturated=(self._u <= low) | (self._u >= high),
            slack_y=slack_y,
            slack_x=slack_x,
            target_error=np.full(self._ny, np.nan),
            x_hat=x,
            disturbance=d,
            y_plan=self._model_output(X, d),
            u_plan=self._U.copy(),
        )

    def _h(self, X):
        """Return h at the states, one per row."""
        S = X if self.law.feedback == "state" else self._model.measure(X)
        return -self._free_law(np.zeros((len(S), self._nu)), S)

    def _limited(self, u):
        return np.clip(u, self.law.u_min, self.law.u_max)

    def _within_rate(self, u):
        """Return u within the limits; the last one if it is not finite."""
        u = np.where(np.isfinite(u), u, self._u)
        near = np.clip(u, self._u - self._du_max, self._u + self._du_max)
        return self._limited(near)

    def _with_disturbance(self, X, d):
        return np.hstack([X, np.broadcast_to(d, (len(X), len(d)))])

    def _model_output(self, X, d):
        """Return the outputs of states, disturbance included."""
        return self.observer.dynamics.measure(self._with_disturbance(X, d))

    # -- a simulation ------------------------------------------------------------------

    def simulate(
        self,
        plant,
        reference,
        *,
        x0=None,
        preview=False,
        input_disturbance=None,
        output_noise=None,
    ):
        """Control a plant from a reset on, and return what happened.

        Parameters
        ----------
        plant : estimator or system of python-control
            What is controlled, from u to y in the units of the user: a fitted model or
            any strictly proper discrete-time system.
        reference : array_like of shape (N, ny) or (N,)
            Reference of every sample.
        x0 : array_like of shape (n_states,) or None, default=None
            Initial state of the plant, which the controller does not know; None means
            zero.
        preview : bool, default=False
            Whether the controller knows the reference of the next samples; else it
            takes the present one to last.
        input_disturbance : array_like of shape (N, nu) or None, default=None
            Added to u behind the controller, in the units of u.
        output_noise : array_like of shape (N, ny) or None, default=None
            Added to the measured output.

        Returns
        -------
        record : MpcRecord
            Signals and reports of all steps.

        Raises
        ------
        TypeError
            If `plant` is neither a model nor a system.
        ValueError
            If sizes or sampling times do not fit, the plant is continuous in time or
            not strictly proper, or a value is not finite.
        """
        dynamics = self._model
        plant = check_plant(plant, dynamics)
        reference = check_signal("reference", reference, None, self._ny)
        n = len(reference)
        push = check_signal("input_disturbance", input_disturbance, n, self._nu)
        noise = check_signal("output_noise", output_noise, n, self._ny)
        x = check_point("x0", x0, plant.nstates)
        self.reset()
        t, u = dynamics.dt * np.arange(n), np.zeros((n, self._nu))
        y, steps = np.zeros((n, self._ny)), []
        for k in range(n):
            y[k] = plant.output(t[k], x, u[k]) + noise[k]
            ahead = np.minimum(np.arange(k + 1, k + 1 + self.horizon), n - 1)
            u[k] = self.step(reference[ahead] if preview else reference[k], y[k])
            steps.append(self.info_)
            x = np.asarray(plant.dynamics(t[k], x, u[k] + push[k]))
        return MpcRecord(t, y, u, reference, steps)

    # -- preparation -------------------------------------------------------------------

    def _condense(self, model, Q, R, penalty, options):
        """Build everything that does not change between samples."""
        n, nu, su = self.horizon, self._nu, self._su
        Q = self._C.T @ self._C if Q is None else check_weight("Q", Q, self._nx)
        R = np.diag(CHEAP_INPUT / su**2) if R is None else R
        self.K = lqr(model, Q, R)
        R = np.asarray(R, dtype=float)
        A_K = self._A - model.B_ @ self.K
        self.P = solve_discrete_lyapunov(A_K.T, Q + self.K.T @ R @ self.K)
        unstable = np.abs(np.linalg.eigvals(self._A)).max() >= 1
        K = unstable * self.K / su[:, None]
        self._prediction = maps = Prediction.of(self._A, self._B, K, n)
        R_s = R * np.outer(su, su)
        self._X_cQ = maps.X_c.T @ block_diag(*[Q] * (n - 1), self.P)
        self._V_cR = maps.V_c.T @ np.kron(np.eye(n), R_s)
        H = self._X_cQ @ maps.X_c + self._V_cR @ maps.V_c
        n_slack = n * len(self._soft.rows)
        Y_c = np.kron(np.eye(n), self._soft.rows) @ maps.X_c  # (n_slack, N nu)
        eye = np.eye(n_slack)
        below, above = (np.tile(z, n) for z in (self._soft.below, self._soft.above))
        self._rated = bool(np.isfinite(self._du_max).any())
        rows = [(maps.V_c, np.zeros((n * nu, n_slack)))]
        if self._rated:
            difference = np.kron(np.eye(n) - np.eye(n, k=-1), np.eye(nu))
            rows.append((difference @ maps.V_c, rows[0][1]))
        rows += [
            (Y_c[below], eye[below]),
            (Y_c[above], -eye[above]),
            (np.zeros((n_slack, n * nu)), eye),
        ]
        self._slack_price = np.full(n_slack, penalty[0])
        self._qp = QuadraticProgram(
            block_diag((H + H.T) / 2, penalty[1] * eye),
            np.vstack([np.hstack(row) for row in rows]),
            **options,
        )

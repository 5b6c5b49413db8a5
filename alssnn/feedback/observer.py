"""Observers: the state of an identified model from measured inputs and outputs.

An estimate is corrected by the measurement and predicted by the whole model f,

    x_hat_k = x_k + M (y_k - C x_k - y_offset),      x_{k+1} = f(x_hat_k, u_k),

so that x_hat_k uses y up to sample k and u up to sample k - 1 and is there in time for
u_k = v_k - h(x_hat_k); where y depends on u of the same sample, C x_k is c(x_k, u_k)
and u_k has to be known.  The gain M is constant, from the stationary Riccati equation
at the operating point ("kalman"), or follows the linearization along the way ("ekf").
Where the fit has identified a gain K of innovations, A M = K, which predicts as the fit
did (eq. innovations).  With A singular there may be no such M.

A y that is not finite was not measured.  With a gate, an innovation y - C x beyond so
many of its standard deviations counts as one of that size: a spike moves the estimate
no further than noise may, and an estimate that is truly off still comes back, in steps
of that size, whereas an observer that drops what surprises it can lock itself out.
"""

from copy import copy

import control
import numpy as np
from scipy.linalg import block_diag

from ..checks import as_numbers, check_option
from ..plants import as_plant
from .checks import check_gate, check_point, check_weight
from .export import as_system, signal_names

PROCESS_NOISE = 1e-4  # variance per sample of states that have a variance of about one
SAME_GAIN = 1e-6  # relative: of K, that a correction may miss
FIT_FLOOR = 1e-6  # share of var(y) below which a residual says nothing about noise


class Observer:
    """Estimate the state of an identified model, sample by sample.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    Q : array_like of shape (nx, nx) or None, default=None
        Covariance of the process noise per sample, in the units of the states. None
        means 1e-4 times the identity: states have about unit variance; or, where K
        was identified, that of K eps. The past of inputs that arrive late, further
        states of x_hat, is known without noise.
    R : array_like of shape (ny, ny) or None, default=None
        Covariance of the measurement noise, in the units of y. None takes the
        variance that the fit leaves, the cost times the variance of each output, at
        least 1e-6 of the latter; or, where K was identified, that of eps. With `Q`
        and `R` left out, "kalman" then has the gain M that belongs to K, A M = K, if
        there is one and A - K C is stable at the operating point; else that of the
        Riccati equation, see `has_fitted_gain`.
    kind : {"kalman", "ekf"}, default="kalman"
        Constant gain for the linearization at the operating point, or extended
        Kalman filter with the analytic Jacobian. Both predict by the whole model.
    gate : float or None, default=None
        Largest innovation that corrects the estimate in full, in its predicted
        standard deviations, the roots of the diagonal of C P C' + R; larger ones are
        cut to it, output by output. None means no gate. Values about 10 stop spikes
        of the sensor; lower ones slow down the way back from a wrong start.

    Attributes
    ----------
    kind : str
        Kind of observer.
    gate : float or None
        The gate.
    Q, R : ndarray
        Covariances in use.
    gain : ndarray of shape (nx, ny)
        Stationary gain M of the correction at the operating point.
    has_fitted_gain : bool
        Whether `gain` belongs to the K of the fit, so that the observer predicts one
        sample ahead as the fit did. Of a model with a `drift` only a
        `DisturbanceObserver` does, for what drifts is no state of the others.
    x_hat : ndarray of shape (nx,)
        Current estimate.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If `kind` is unknown, `Q` or `R` is not a covariance of the right size, `gate`
        is not positive, or the model is not detectable.

    Notes
    -----
    `control.dlqe` returns the covariance P of the predicted state, from which
    M = P C' (C P C' + R)^-1.

    An estimate that overflows, as of a model that diverges, is given up: the observer
    starts anew from the operating point.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=6, dt=record.dt).fit(record.u, record.y)
    >>> model.observer().filter(record.u, record.y).shape
    (1500, 6)
    """

    def __init__(self, model, Q=None, R=None, kind="kalman", gate=None):
        check_option("kind", kind, ("kalman", "ekf"), "Use the default, 'kalman'.")
        self.kind, self.gate = kind, check_gate(gate)
        self.plant = plant = as_plant(model).late()
        ny, n_late = plant.ny, plant.n_late
        nx = plant.nx - n_late
        own = np.arange(plant.nx) < nx
        self._start = np.diag(np.where(own, plant.x_scale, 0.0) ** 2)
        K, is_free = plant.K, Q is None and R is None
        if Q is None:
            Q = process_noise(plant, K, plant.x_scale[:nx])
        if R is None:
            R = np.diag(max(plant.noise, FIT_FLOOR) * plant.y_scale**2)
            if K is not None:
                R = plant.noise_covariance + np.diag(FIT_FLOOR * plant.y_scale**2)
        self.Q = block_diag(check_weight("Q", Q, nx), np.zeros((n_late, n_late)))
        self.R = check_weight("R", R, ny, definite=True)
        self._set_gain(K if is_free and kind == "kalman" else None)

    def __repr__(self):
        """Return kind, number of states and gate."""
        gate = "" if self.gate is None else f", gate={self.gate:g}"
        return f"{type(self).__name__}({self.kind!r}, nx={len(self.Q)}{gate})"

    @property
    def largest_innovation(self):
        """Return what the gate cuts at the stationary gain, (ny,); None without one."""
        return None if self.gate is None else self.gate * self._deviation

    def believed(self, z, signals):
        """Return the outputs, as far as the gate lets them through.

        Parameters
        ----------
        z : ndarray of shape (nx,) or (nx + nx**2,)
            What was predicted for this sample, as in `update`.
        signals : ndarray of shape (nu + ny,)
            Inputs, then outputs, in the user's units.

        Returns
        -------
        y : ndarray of shape (ny,)
            Outputs, cut to `largest_innovation` around what was predicted; nan where
            they were not measured.
        """
        u, y = np.split(signals, [self.plant.nu])
        gate = self.largest_innovation
        if gate is None:
            return y
        now = () if self.plant.has_linear_output else (u,)
        ahead = self.plant.output(z[: self.plant.nx], *now)
        return np.clip(y, ahead - gate, ahead + gate)

    def reset(self, x0=None):
        """Start anew.

        Parameters
        ----------
        x0 : array_like of shape (nx,) or None, default=None
            Estimate before the first measurement; None means the operating point.

        Raises
        ------
        ValueError
            If `x0` has the wrong size.
        """
        self.x_hat = check_point("x0", x0, len(self.Q))
        self._P = self._start_covariance()
        self._started = False

    def step(self, u, y, u_now=None):
        """Return the estimate for a new measurement.

        Parameters
        ----------
        u : array_like of shape (nu,)
            Input since the last measurement, u_{k-1} in the user's units; ignored
            in the first step.
        y : array_like of shape (ny,)
            New measurement y_k, in the user's units; what is nan or infinite was not
            measured.
        u_now : array_like of shape (nu,) or None, default=None
            Input u_k of the same sample, where y depends on it (D, H or k).

        Returns
        -------
        x_hat : ndarray of shape (nx,)
            Estimate of x_k.

        Raises
        ------
        ValueError
            If `u` or `y` has the wrong size, or `u_now` is missing.
        """
        u = check_point("u", u, self.plant.nu)
        y = check_point("y", y, len(self.R), missing=True)
        if u_now is not None:
            u_now = check_point("u_now", u_now, self.plant.nu)
        if self._started:
            self.x_hat, self._P = self._predict(self.x_hat, self._P, u)
        self._started = True
        self.x_hat, self._P = self._correct(self.x_hat, self._P, y, u_now)
        return self.x_hat.copy()

    def filter(self, u, y, x0=None):
        """Return the estimates along a record.

        Parameters
        ----------
        u : array_like of shape (N, nu)
            Inputs.
        y : array_like of shape (N, ny)
            Outputs; nan or infinite where not measured.
        x0 : array_like of shape (nx,) or None, default=None
            Estimate before the first measurement.

        Returns
        -------
        X_hat : ndarray of shape (N, nx)
            Estimates; row k uses the outputs up to k and the inputs up to k - 1.

        Raises
        ------
        ValueError
            If shapes do not fit.

        Notes
        -----
        The observer itself, its state included, does not change. Inputs are held
        between the samples, as in a loop, whatever the `hold` of the model is:
        `predict_ahead` follows records of others.
        """
        u, y = as_numbers("u", u), as_numbers("y", y)
        nu, ny = self.plant.nu, len(self.R)
        if y.ndim == 1 and ny == 1:
            y = y[:, None]
        n = max(y.size // ny, 1)
        if u.shape != (n, nu) or y.shape != (n, ny):
            raise ValueError(
                f"`u` and `y` must have shapes (N, {nu}) and (N, {ny}), got {u.shape} "
                f"and {y.shape}. Time runs down the rows, at least one."
            )
        runner = copy(self)
        runner.reset(x0)
        before = np.vstack([u[:1], u[:-1]])
        return np.array([runner.step(*z) for z in zip(before, y, u, strict=True)])

    def update(self, t, z, signals, params):
        """Return the predicted state for (u, y), for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        z : ndarray of shape (nx,) or (nx + nx**2,)
            State predicted for this sample and, if it follows the way ("ekf"), its
            covariance less that of the start.
        signals : ndarray of shape (nu + ny,)
            Inputs, then outputs, in the user's units.
        params : dict
            Not used.

        Returns
        -------
        z_next : ndarray of shape (nx,) or (nx + nx**2,)
            The same, predicted for the next sample.
        """
        u, y = np.split(signals, [self.plant.nu])
        x, P = self._unpack(z)
        x, P = self._correct(x, P, y, u)
        x, P = self._predict(x, P, u)
        if self.kind == "kalman":
            return x
        return np.concatenate([x, (P - self._start_covariance()).ravel()])

    def output(self, t, z, signals, params):
        """Return the corrected state for (u, y), for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        z : ndarray of shape (nx,) or (nx + nx**2,)
            State predicted for this sample, and its covariance as in `update`.
        signals : ndarray of shape (nu + ny,)
            Inputs, then outputs, in the user's units.
        params : dict
            Not used.

        Returns
        -------
        x_hat : ndarray of shape (nx,)
            Estimate.
        """
        u, y = np.split(signals, [self.plant.nu])
        # without feedthrough x_hat does not depend on u: no algebraic loop
        now = None if self.plant.has_linear_output else u
        x, P = self._unpack(z)
        return self._correct(x, P, y, now)[0]

    def to_nlsys(self):
        """Return the observer as a system of python-control.

        Returns
        -------
        sys : control.NonlinearIOSystem
            System from (u, y), with the names of the training data, made unique, to
            ``x_hat[0]``, ...; its states are the predictions, behind which an extended
            Kalman filter has their covariance less that of the start, row by row: from
            zeros, as loops begin, it starts as `filter` does.
        """
        nx = len(self.Q)
        states = signal_names(None, "x", nx)
        if self.kind == "ekf":
            states += [f"P[{i},{j}]" for i in range(nx) for j in range(nx)]
        inputs = signal_names([*self.plant.inputs, *self.plant.outputs])
        signals = inputs, signal_names(None, "x_hat", nx), states
        return as_system(self, *signals, self.plant.dt, "observer")

    def initial_state(self, x0=None):
        """Return where the system of `to_nlsys` starts as `filter` does.

        Parameters
        ----------
        x0 : array_like of shape (nx,) or None, default=None
            Estimate before the first measurement; None means the operating point.

        Returns
        -------
        z0 : ndarray of shape (nx,) or (nx + nx**2,)
            State of the system.

        Raises
        ------
        ValueError
            If `x0` has the wrong size.
        """
        x0 = check_point("x0", x0, len(self.Q))
        if self.kind == "kalman":
            return x0
        return np.concatenate([x0, np.zeros(len(x0) ** 2)])

    def _start_covariance(self):
        # the start is as uncertain as the states are large
        return self._P_inf + self._start

    def _unpack(self, z):
        nx = len(self.Q)
        P = z[nx:].reshape(-1, nx)  # a constant gain needs none
        return z[:nx], P + self._start_covariance() if len(P) else P

    def _gain(self, P, C):
        """Return the gain, and the covariance of the innovation."""
        PC = P @ C.T  # (nx, ny)
        S = C @ PC + self.R
        return np.linalg.solve(S, PC.T).T, S

    def _set_gain(self, K):
        """Set the stationary gain, that of K if there is one, and start anew."""
        A, _, C, _ = self.plant.jacobian(np.zeros(self.plant.nx), self.plant.u_offset)
        self._P_inf = stationary_covariance(A, C, self.Q, self.R)
        self.gain, S = self._gain(self._P_inf, C)
        self._deviation = np.sqrt(np.diag(S))
        takes_gain = K is not None and self._take_gain(A, C, K)
        # the fit predicted by what drifts, too
        self.has_fitted_gain = takes_gain and self.plant.drift is None
        self.reset()

    def _take_gain(self, A, C, K):
        """Take the stable gain that predicts as K does; tell whether there is one."""
        known = np.diag(self._start) > 0  # the past of late inputs is
        A, C = A[np.ix_(known, known)], C[:, known]
        M = np.linalg.lstsq(A, K, rcond=None)[0]
        predicts = np.linalg.norm(A @ M - K) <= SAME_GAIN * np.linalg.norm(K)
        poles = np.linalg.eigvals(A - K @ C)  # at the operating point: h sees y there
        if not predicts or not np.abs(poles).max() < 1:
            return False
        self.gain = np.zeros_like(self.gain)
        self.gain[known] = M
        self._deviation = np.sqrt(np.diag(self.R))
        return True

    @np.errstate(over="ignore", invalid="ignore")
    def _correct(self, x, P, y, u=None):
        """Return state and covariance after a measurement.

        What is not finite corrects nothing, nor does what the estimate cannot hold.
        """
        M, P_new, deviation = self.gain, P, self._deviation
        if self.kind == "ekf":
            at = self.plant.u_offset if u is None else u
            C = self.plant.jacobian(x, at)[2]
            C = np.where(np.isfinite(y)[:, None], C, 0.0)
            M, S = self._gain(P, C)
            P_new = P - M @ C @ P
            P_new, deviation = (P_new + P_new.T) / 2, np.sqrt(np.diag(S))
        error = y - self.plant.output(x, u)
        error = np.where(np.isfinite(error), error, 0.0)
        if self.gate is not None:
            error = np.clip(error, -self.gate * deviation, self.gate * deviation)
        x_new = x + M @ error
        return (x_new, P_new) if _finite(x_new, P_new) else (x, P)

    @np.errstate(over="ignore", invalid="ignore")
    def _predict(self, x, P, u):
        """Return state and covariance one sample later, the start if they overflow."""
        x_new, P_new = self.plant.step(x, u), P
        if self.kind == "ekf":
            A = self.plant.jacobian(x, u)[0]
            P_new = A @ P @ A.T + self.Q
        if _finite(x_new, P_new):
            return x_new, P_new
        start = self._start_covariance() if self.kind == "ekf" else P
        return np.zeros_like(x), start


def _finite(*arrays):
    return all(np.isfinite(array).all() for array in arrays)


def process_noise(plant, K, size):
    """Return the covariance of what moves states from sample to sample.

    Parameters
    ----------
    plant : Plant
        Model.
    K : ndarray of shape (n, ny) or None
        What innovations do to these states; None where it was not identified.
    size : ndarray of shape (n,)
        Size of the states.

    Returns
    -------
    Q : ndarray of shape (n, n)
        Covariance.
    """
    Q = np.diag(PROCESS_NOISE * size**2)
    return Q if K is None else K @ plant.noise_covariance @ K.T + FIT_FLOOR * Q


def stationary_covariance(A, C, Q, R):
    """Return the covariance of the predicted state, from the Riccati equation.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    Q : ndarray of shape (nx, nx)
        Covariance of the process noise.
    R : ndarray of shape (ny, ny)
        Covariance of the measurement noise.

    Returns
    -------
    P : ndarray of shape (nx, nx)
        Stationary covariance before the measurement.

    Raises
    ------
    ValueError
        If there is no stable observer.
    """
    # outputs in their own units: the equation is solved for unit measurement noise
    scale = np.sqrt(np.diag(R))
    C, R = C / scale[:, None], R / np.outer(scale, scale)
    try:
        _, P, poles = control.dlqe(A, np.eye(len(A)), C, Q, R)
    except np.linalg.LinAlgError as error:
        raise ValueError(_UNDETECTABLE.format("no solution")) from error
    if not np.abs(poles).max() < 1:
        raise ValueError(_UNDETECTABLE.format(f"|pole| = {np.abs(poles).max():.6g}"))
    return P


_UNDETECTABLE = (
    "`Q` and `R` must give a stable observer, got {}. Let `Q` be positive definite; if "
    "it is, y does not show an unstable state: lower `nx`."
)

"""The whole identified model, one step at a time and in the units of the user.

States are deviations, u and y carry their operating point,

    x+ = f(x, u - u_offset),        y = c(x, u - u_offset) + y_offset.

Inputs that arrive late carry their past as further states, behind those of the model.

With the Lur'e form of f (eq. lure) its derivatives are those of (eq. sens):

    [A B; C D](x, u) = M + W R V
"""

from dataclasses import dataclass, replace
from functools import cached_property

import control
import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..lure import Lure
from ..simulation import neuron_gains, regressors
from .checks import check_point
from .export import signal_names, to_statespace


def late_inputs(lure, delay):
    """Return the form with inputs that arrive late, its past inputs as states.

    Parameters
    ----------
    lure : Lure
        Model.
    delay : ndarray of int of shape (nu,)
        Samples by which every input arrives late.

    Returns
    -------
    lure : Lure
        Model with sum(delay) more states: for each input its last values, oldest
        first. The model itself without delay.
    """
    n = int(np.sum(delay))
    if n == 0:
        return lure
    nx, nu = lure.nx, lure.nu
    states, inputs, rest = np.split(lure.Theta, [nx, nx + nu], axis=1)
    late, now = np.zeros((len(lure.Theta), n)), inputs.copy()
    shift, entry = np.eye(n, k=1), np.zeros((n, nu))
    stops = np.cumsum(delay)
    for i in np.flatnonzero(delay):
        oldest, newest = stops[i] - delay[i], stops[i] - 1
        late[:, oldest], now[:, i] = inputs[:, i], 0.0
        shift[newest] = 0.0
        entry[newest, i] = 1.0
    plus, others = np.split(np.hstack([states, late, now, rest]), [nx])
    line = np.hstack([np.zeros((n, nx)), shift, entry, np.zeros((n, rest.shape[1]))])
    return Lure(np.vstack([plus, line, others]), nx + n, nu, lure.nw, lure.sigma)


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Hold one step of an identified model, in the units of the user.

    The methods `update` and `output` have the signature that python-control expects
    and can be pickled.

    Parameters
    ----------
    lure : Lure
        Model with the states x alone, the channel y, and deviations in the user's
        units.
    u_offset : ndarray of shape (nu,)
        Operating point of the inputs, in the units of u.
    y_offset : ndarray of shape (ny,)
        Operating point of the outputs, in the units of y.
    dt : float
        Sampling time, in seconds.
    inputs, outputs : list of str
        Names of the signals.
    name : str
        Name of the model.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.feedback import Dynamics
    >>> dynamics = Dynamics.of(model)
    >>> np.allclose(dynamics.measure(np.zeros((1, 4)), record.u[:1]), model.y_offset_)
    True
    """

    lure: Lure
    u_offset: np.ndarray
    y_offset: np.ndarray
    dt: float
    inputs: list
    outputs: list
    name: str

    @classmethod
    def of(cls, model):
        """Return the dynamics of a fitted estimator.

        Parameters
        ----------
        model : estimator
            Fitted model of this package.

        Returns
        -------
        dynamics : Dynamics
            One step of the model.

        Raises
        ------
        NotFittedError
            If the model is not fitted.
        """
        check_is_fitted(model)
        lure, _ = model._plant()
        return cls(
            late_inputs(lure, model.input_delay_),
            model.u_offset_,
            model.y_offset_,
            model.dt,
            signal_names(getattr(model, "feature_names_in_", None), "u", lure.nu),
            signal_names(model.output_names_, "y", len(model.C_)),
            type(model).__name__,
        )

    def with_disturbance(self, kind):
        """Return the dynamics of the state [x; d] with a constant disturbance d.

        Parameters
        ----------
        kind : {"output", "input"}
            Whether d is added to y, in its units, or to u, in those of u.

        Returns
        -------
        dynamics : Dynamics
            The same model with nx + ny or nx + nu states, the last of which stay as
            they are.

        Raises
        ------
        ValueError
            If `kind` is unknown.
        """
        if kind not in ("output", "input"):
            raise ValueError(
                f"`kind` must be 'output' or 'input', got {kind!r}. Use 'input' if "
                "the model integrates."
            )
        lure, nx, nu = self.lure, self.lure.nx, self.lure.nu
        by_u = lure.Theta[:, nx : nx + nu]
        y = np.arange(nx, nx + lure.nz)
        by_d = by_u if kind == "input" else np.eye(len(lure.Theta))[:, y]
        nd = by_d.shape[1]
        Theta = np.insert(lure.Theta, [nx] * nd, by_d, axis=1)
        keep = np.eye(nd, Theta.shape[1], nx)  # d+ = d
        Theta = np.insert(Theta, [nx] * nd, keep, axis=0)
        return replace(self, lure=Lure(Theta, nx + nd, nu, lure.nw, lure.sigma))

    def step(self, x, u):
        """Return the next state.

        Parameters
        ----------
        x : ndarray of shape (nx,) or (N, nx)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu)
            Input, in the user's units.

        Returns
        -------
        x_next : ndarray of shape (nx,) or (N, nx)
            State one sample later.
        """
        du = np.atleast_2d(u - self.u_offset)
        Phi = regressors(self.lure, np.atleast_2d(x), du)
        return (Phi @ self.lure.Theta[: self.lure.nx].T).reshape(x.shape)

    @cached_property
    def has_linear_output(self):
        """Return whether y = C x; with D or k it depends on u of the same sample."""
        lure = self.lure
        y = lure.Theta[lure.nx : lure.nx + lure.nz]
        return not np.any(y[:, lure.nx :])

    def measure(self, x, u=None):
        """Return the output.

        Parameters
        ----------
        x : ndarray of shape (nx,) or (N, nx)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu) or None, default=None
            Input of the same sample, in the user's units; needed only where y depends
            on it.

        Returns
        -------
        y : ndarray of shape (ny,) or (N, ny)
            Output, in the user's units.

        Raises
        ------
        ValueError
            If `u` is missing though y depends on it.
        """
        lure = self.lure
        if self.has_linear_output:
            return x @ lure.M[lure.nx : lure.nx + lure.nz, : lure.nx].T + self.y_offset
        if u is None:
            raise ValueError(
                "`u` must be given, for y depends on the input of the same sample "
                "through D or k, got None. Pass it, or fit without them."
            )
        du = np.atleast_2d(u - self.u_offset)
        Phi = regressors(lure, np.atleast_2d(x), du)
        y = Phi @ lure.Theta[lure.nx : lure.nx + lure.nz].T + self.y_offset
        return y.reshape(*x.shape[:-1], lure.nz)

    def jacobian(self, x, du):
        """Return the linearization at a state and an input.

        Parameters
        ----------
        x : ndarray of shape (nx,) or (N, nx)
            State, or one per row.
        du : ndarray of shape (nu,) or (N, nu)
            Deviation of the input from the operating point, in the units of u.

        Returns
        -------
        A : ndarray of shape (nx, nx) or (N, nx, nx)
            Derivative of x+ by x.
        B : ndarray of shape (nx, nu) or (N, nx, nu)
            Derivative of x+ by u.
        C : ndarray of shape (ny, nx) or (N, ny, nx)
            Derivative of y by x.
        D : ndarray of shape (ny, nu) or (N, ny, nu)
            Derivative of y by u.
        """
        Phi = regressors(self.lure, np.atleast_2d(x), np.atleast_2d(du))
        return self._slopes(Phi, x.shape[:-1])

    def tangent(self, x, u):
        """Return the next state with its derivatives, for less than both alone.

        Parameters
        ----------
        x : ndarray of shape (N, nx)
            States.
        u : ndarray of shape (N, nu)
            Inputs, in the user's units.

        Returns
        -------
        x_next : ndarray of shape (N, nx)
            States one sample later, as of `step`.
        A : ndarray of shape (N, nx, nx)
            Derivatives by x, as of `jacobian`.
        B : ndarray of shape (N, nx, nu)
            Derivatives by u.
        """
        Phi = regressors(self.lure, x, u - self.u_offset)
        A, B, _, _ = self._slopes(Phi, x.shape[:-1])
        return Phi @ self.lure.Theta[: self.lure.nx].T, A, B

    def _slopes(self, Phi, rows):
        """Return A, B, C and D at regressors."""
        lure, nx = self.lure, self.lure.nx
        J = lure.M + neuron_gains(lure, lure.W, Phi) @ lure.V  # (eq. sens)
        J = J.reshape(*rows, *J.shape[1:])
        return J[..., :nx, :nx], J[..., :nx, nx:], J[..., nx:, :nx], J[..., nx:, nx:]

    def linearize(self, x=None, u=None):
        """Return the linearization at an operating point as a system.

        Parameters
        ----------
        x : array_like of shape (nx,) or None, default=None
            State; None means the operating point of the fit, zero.
        u : array_like of shape (nu,) or None, default=None
            Deviation of the input from `u_offset_`; None means zero.

        Returns
        -------
        sys : control.StateSpace
            Discrete-time system of deviations from (x, u).

        Raises
        ------
        ValueError
            If `x` or `u` has the wrong size.
        """
        x = check_point("x", x, self.lure.nx)
        u = check_point("u", u, self.lure.nu)
        A, B, C, D = self.jacobian(x, u)
        return to_statespace(
            A,
            B,
            C,
            D,
            self.dt,
            inputs=self.inputs,
            outputs=self.outputs,
            name=self.name,
        )

    def update(self, t, x, u, params):
        """Return the next state, for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (nx,)
            State.
        u : ndarray of shape (nu,)
            Input, in the user's units.
        params : dict
            Not used.

        Returns
        -------
        x_next : ndarray of shape (nx,)
            State one sample later.
        """
        return self.step(x, u)

    def output(self, t, x, u, params):
        """Return the output, for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (nx,)
            State.
        u : ndarray of shape (nu,)
            Input, in the user's units.
        params : dict
            Not used.

        Returns
        -------
        y : ndarray of shape (ny,)
            Output, in the user's units.
        """
        return self.measure(x, u)

    def output_and_state(self, t, x, u, params):
        """Return the output and the state, for loops that feed the state back.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (nx,)
            State.
        u : ndarray of shape (nu,)
            Input, in the user's units.
        params : dict
            Not used.

        Returns
        -------
        yx : ndarray of shape (ny + nx,)
            Output in the user's units, then the state.
        """
        return np.concatenate([self.measure(x, u), x])

    def to_nlsys(self):
        """Return the model as a system of python-control.

        Returns
        -------
        sys : control.NonlinearIOSystem
            Discrete-time system from u to y, in the user's units.
        """
        return control.nlsys(
            self.update,
            self.output,
            inputs=self.inputs,
            outputs=self.outputs,
            states=signal_names(None, "x", self.lure.nx),
            dt=self.dt,
            name=self.name,
        )

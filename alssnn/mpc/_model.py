"""The model as the controller sees it, with a constant disturbance (eq. mpc).

    x+ = f(x, u, d) = A x + B v + omega,      v = phi(u, s) - u_offset

omega is what the linear model lacks.  v counts in standard deviations of u and C x in
those of y; u and d have the units of the user.  phi sees the output or the state of
the model, without d.

Measured disturbances m are given, as far ahead as they are known: the trajectory has
them, and with it omega, which is then G dm, too.
"""

import numpy as np

from ..simulation import Stepper
from ._inputs import Added, InputMap, Mapped


class DisturbedModel:
    """Evaluate a model along plans and at rest.

    Parameters
    ----------
    plant : Plant
        The model.
    disturbed : Plant
        The same with the state [x; d], that of the observer.

    Attributes
    ----------
    A, B, C : ndarray
        Linear part, v and y scaled.
    u_offset, u_scale : ndarray of shape (nu,)
        Operating point and standard deviation of the inputs that are moved.
    y_scale : ndarray of shape (ny,)
        Standard deviation of y.
    x_scale : ndarray of shape (nx,)
        Usual size of the states.
    dt : float
        Sampling time, in seconds.
    """

    def __init__(self, plant, disturbed):
        self._own, self._disturbed = plant, disturbed
        self._stepper = Stepper(disturbed.lure, size=disturbed.x_scale)
        self._map = None if plant.is_explicit else InputMap(plant)
        self.u_offset, self.dt = plant.v_offset, plant.dt
        self.u_scale, self.y_scale = plant.v_scale, plant.y_scale
        self.x_scale = plant.x_scale
        self.A, B, C, _ = plant.linear()
        self.B, self.C = B * self.u_scale, C / self.y_scale[:, None]

    def trajectory(self, x, d, U, m=None):
        """Return the states under given inputs, by the whole model.

        Parameters
        ----------
        x : ndarray of shape (nx,)
            State now.
        d : ndarray of shape (nd,)
            Disturbance, which stays.
        U : ndarray of shape (N, nu)
            Inputs.
        m : ndarray of shape (N, nm) or None, default=None
            Measured disturbances, if there are any.

        Returns
        -------
        X : ndarray of shape (N + 1, nx)
            States, the present one first; inf if the model diverges.
        """
        X = np.empty((len(U) + 1, len(x) + len(d)))
        X[0] = np.concatenate([x, d])
        own = self._own
        self._stepper(own.every_input(U, m) - own.u_offset, X[0], X[1:])
        return X[:, : len(x)]

    def omega(self, X, V):
        """Return what the linear model lacks along a trajectory (eq. mpc).

        Parameters
        ----------
        X : ndarray of shape (N + 1, nx)
            States.
        V : ndarray of shape (N, nu)
            Inputs of the linear system.

        Returns
        -------
        omega : ndarray of shape (N, nx)
            What remains, f(x, u, d) - A x - B v.
        """
        return X[1:] - X[:-1] @ self.A.T - V @ self.B.T

    def tangent(self, X, U, d, m=None):
        """Return the linearization of f at states and inputs.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            States.
        U : ndarray of shape (N, nu)
            Inputs.
        d : ndarray of shape (nd,)
            Disturbance.
        m : ndarray of shape (N, nm) or None, default=None
            Measured disturbances, if there are any.

        Returns
        -------
        A : ndarray of shape (N, nx, nx)
            Derivative by x.
        B : ndarray of shape (N, nx, nu)
            Derivative by the scaled input.
        w : ndarray of shape (N, nx)
            Rest: f = A x + B (u - u_offset) / u_scale + w there.
        """
        nx = X.shape[1]
        own = self._own
        plus, A, B = self._disturbed.tangent(self._with(X, d), own.every_input(U, m))
        A, B = A[:, :nx, :nx], B[:, :nx, own.moved] * self.u_scale
        du = (U - self.u_offset) / self.u_scale
        linear = np.einsum("nij,nj->ni", A, X) + np.einsum("nij,nj->ni", B, du)
        return A, B, plus[:, :nx] - linear

    def output(self, X, d):
        """Return the outputs, disturbance included.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            States.
        d : ndarray of shape (nd,)
            Disturbance.

        Returns
        -------
        y : ndarray of shape (N, ny)
            Outputs, in the units of y.
        """
        return self._disturbed.output(self._with(X, d))

    def inputs(self, X, U, m=None):
        """Return what lies between u and the linear model along states and inputs.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            States.
        U : ndarray of shape (N, nu)
            Inputs of the plant.
        m : ndarray of shape (N, nm) or None, default=None
            Measured disturbances, if there are any.

        Returns
        -------
        inputs : Added or Mapped
            The inputs V of the linear model, and what limits them.
        """
        if self._map is None:
            return Added(self._own, X, U, m)
        return Mapped(self._map, X, U, m)

    def ahead(self, m, n):
        """Return measured disturbances of samples, at the operating point if unknown.

        Parameters
        ----------
        m : ndarray of shape (n, nm) or None
            Measured disturbances; None if they are not known.
        n : int
            Number of samples.

        Returns
        -------
        m : ndarray of shape (n, nm) or None
            The same, or those of rest; None for a model without any.
        """
        if m is not None or not self._own.nd:
            return m
        return np.tile(self._own.d_offset, (n, 1))

    def _with(self, X, d):
        """Return the states with the disturbance behind them."""
        return np.hstack([X, np.tile(d, (len(X), 1))])

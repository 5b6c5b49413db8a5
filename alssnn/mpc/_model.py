"""The model as the controller sees it, with a constant disturbance (eq. mpc).

    x+ = f(x, u, d) = A x + B v + omega,      v = u + h(s, u) - u_offset

omega is what the linear model lacks.  v counts in standard deviations of u and C x in
those of y; u, d and h have the units of the user.  h sees the output or the state of
the model, without d, and u if the map v = phi(u, s) is no sum.
"""

import numpy as np

from ..simulation import Stepper


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
        Operating point and standard deviation of u.
    y_scale : ndarray of shape (ny,)
        Standard deviation of y.
    dt : float
        Sampling time, in seconds.
    """

    def __init__(self, plant, disturbed):
        self._own, self._disturbed = plant, disturbed
        self._stepper = Stepper(disturbed.lure)
        self.u_offset, self.dt = plant.u_offset, plant.dt
        self.u_scale, self.y_scale = plant.u_scale, plant.y_scale
        self.A, B, C, _ = plant.linear()
        self.B, self.C = B * self.u_scale, C / self.y_scale[:, None]

    def trajectory(self, x, d, U):
        """Return the states under given inputs, by the whole model.

        Parameters
        ----------
        x : ndarray of shape (nx,)
            State now.
        d : ndarray of shape (nd,)
            Disturbance, which stays.
        U : ndarray of shape (N, nu)
            Inputs.

        Returns
        -------
        X : ndarray of shape (N + 1, nx)
            States, the present one first; inf if the model diverges.
        """
        X = np.empty((len(U) + 1, len(x) + len(d)))
        X[0, : len(x)], X[0, len(x) :] = x, d
        self._stepper(U - self.u_offset, X[0], X[1:])
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

    def tangent(self, X, U, d):
        """Return the linearization of f at states and inputs.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            States.
        U : ndarray of shape (N, nu)
            Inputs.
        d : ndarray of shape (nd,)
            Disturbance.

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
        plus, A, B = self._disturbed.tangent(self._with(X, d), U)
        A, B = A[:, :nx, :nx], B[:, :nx] * self.u_scale
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

    def seen(self, X):
        """Return what the law measures.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            States.

        Returns
        -------
        S : ndarray of shape (N, ns)
            States, or outputs in the units of y.
        """
        return X if self._own.feedback == "state" else self._own.output(X)

    def h(self, S, U):
        """Return what the law cancels.

        Parameters
        ----------
        S : ndarray of shape (N, ns)
            What the law measures.
        U : ndarray of shape (N, nu)
            Inputs of the plant.

        Returns
        -------
        h : ndarray of shape (N, nu)
            Nonlinearity at the input, in the units of u.
        """
        return self._own.cancelled(S, U)

    def v(self, U, h):
        """Return the input of the linear system for one of the plant.

        Parameters
        ----------
        U : ndarray of shape (N, nu)
            Inputs of the plant.
        h : ndarray of shape (N, nu)
            What the law cancels.

        Returns
        -------
        V : ndarray of shape (N, nu)
            Deviations u + h - u_offset, scaled.
        """
        return (U + h - self.u_offset) / self.u_scale

    def v_limit(self, bound, S, h):
        """Return where a limit of u is one of the input of the linear system.

        Parameters
        ----------
        bound : ndarray of shape (nu,)
            Limits of u; infinite without one.
        S : ndarray of shape (N, ns)
            What the law measures.
        h : ndarray of shape (N, nu)
            What the law cancels along the plan.

        Returns
        -------
        V : ndarray of shape (N, nu)
            Limits phi(bound, s): exact for one input. With several, which a map
            couples, that of every input while the others are at theirs.
        """
        if self._own.is_explicit:
            return self.v(bound, h)
        finite = np.where(np.isfinite(bound), bound, self.u_offset)
        U = np.broadcast_to(finite, (len(S), len(finite)))
        return np.where(np.isfinite(bound), self.v(U, self.h(S, U)), bound)

    def u(self, V, S):
        """Return the input of the plant for one of the linear system.

        Parameters
        ----------
        V : ndarray of shape (N, nu)
            Inputs of the linear system, scaled deviations.
        S : ndarray of shape (N, ns)
            What the law measures.

        Returns
        -------
        U : ndarray of shape (N, nu)
            Inputs of the plant, by the law.
        """
        return self._own.law(self.u_offset + V * self.u_scale, S)

    def _with(self, X, d):
        """Return the states with the disturbance behind them."""
        Xd = np.empty((len(X), X.shape[1] + len(d)))
        Xd[:, : X.shape[1]], Xd[:, X.shape[1] :] = X, d
        return Xd

"""What lies between u and the linear model, along a plan: v = phi(u, s) (eq. mpc).

`Added` is v = u + h(s): with h along the plan, limits of u are limits of v.  `Mapped`
is a map that is no sum (eq. monotone).  Limits of one input are limits of v there, too,
for the map increases.  Those of several inputs and of rates become rows of

    u = u_k + K_k (v - v_k - F_k (x - x_k)),    K = (dphi/du)^-1,   F = dphi/dx,

along the plan (x_k, u_k) (eq. rows).  A plan within its limits meets these rows,
whatever the map: no program is without a solution because it was linearized.

v counts in standard deviations of u, u and s have the units of the user.  Inputs u are
those that are moved; the map sees measured disturbances m beside s.
"""

from dataclasses import dataclass

import numpy as np

from ..lure import Lure
from ..simulation import neuron_gains, regressors

MAX_ITER = 8  # of Newton's method, which starts near the solution
FOUND = 1e-5  # last step, in standard deviations: the error is of its square


@dataclass(frozen=True, eq=False)
class InputRows:
    """Hold the limits of u as rows of a program, scaled deviations.

    Parameters
    ----------
    lower, upper : ndarray of shape (N, nu)
        Bounds of the rows w = K (v - F x), which are v without K.
    change : ndarray of shape (N, nu) or None
        Change of w - u per sample, the first one from -u of the last sample; None if
        the rate has no limits.
    du_max : ndarray of shape (nu,) or (N, nu)
        Limit of the change of u.
    slopes : tuple of ndarray of shape (N, nu, nu) and (N, nu, nx), or None
        K and F.
    """

    lower: np.ndarray
    upper: np.ndarray
    change: np.ndarray | None
    du_max: np.ndarray
    slopes: tuple | None = None


class Added:
    """Hold v = u + h(s) along a plan.

    Parameters
    ----------
    plant : Plant
        The model.
    X : ndarray of shape (N, nx)
        States.
    U : ndarray of shape (N, nu)
        Inputs.
    m : ndarray of shape (N, nm) or None, default=None
        Measured disturbances, if there are any.

    Attributes
    ----------
    V : ndarray of shape (N, nu)
        Inputs of the linear model.
    """

    def __init__(self, plant, X, U, m=None):
        self._plant, self._m = plant, m
        self._h = plant.cancelled(_seen(plant, X), U, m)
        self.V = self._v(U)

    def _v(self, U):
        return (U + self._h - self._plant.v_offset) / self._plant.v_scale

    def rows(self, limits, u_last):
        """Return the rows that limit u.

        Parameters
        ----------
        limits : ActuatorLimits
            Limits of u.
        u_last : ndarray of shape (nu,)
            Input of the last sample.

        Returns
        -------
        rows : InputRows
            The rows.
        """
        scale, change = self._plant.v_scale, None
        if limits.rated:
            first = _first(self._plant, limits, u_last)
            change = np.diff(self._h / scale, axis=0, prepend=-first[None])
        bounds = self._v(limits.u_min), self._v(limits.u_max)
        return InputRows(*bounds, change, limits.du_max / scale)

    def u(self, V, X):
        """Return the inputs of the plant that make others of the linear model.

        Parameters
        ----------
        V : ndarray of shape (N, nu)
            Inputs of the linear model.
        X : ndarray of shape (N, nx)
            States.

        Returns
        -------
        U : ndarray of shape (N, nu)
            Inputs, by the law.
        """
        plant = self._plant
        return plant.law(plant.v_offset + V * plant.v_scale, _seen(plant, X), self._m)

    def now(self, u):
        """Return the virtual input that an input of the first sample makes.

        Parameters
        ----------
        u : ndarray of shape (nu,)
            Input of the plant.

        Returns
        -------
        v : ndarray of shape (nu,)
            Virtual input, in the units of u.
        """
        return u + self._h[0]


class InputMap:
    """Evaluate v = z(s) + D u + W sigma(a(s) + P u), scaled deviations.

    Parameters
    ----------
    plant : Plant
        The model.

    Attributes
    ----------
    plant : Plant
        The model.
    """

    def __init__(self, plant):
        self.plant, scale, nu = plant, plant.v_scale, plant.nv
        before, behind = plant.law_map.parts()
        self._D = behind.M[:, -nu:] * scale / scale[:, None]
        self._W = behind.W / scale[:, None]
        self._P = behind.V[:, -nu:] * scale
        self._layers = [(part, behind.sigma[part.start]) for part in behind.layers]
        C = np.eye(plant.nx) if plant.feedback == "state" else plant.linear()[2]
        nd = plant.nd
        ns = before.nu - nd  # no network sees past inputs
        of_s, rest = np.split(before.Theta, [ns], axis=1)
        Theta = np.hstack([of_s @ C[:ns], rest])  # of [x; m]
        self._before = Lure(Theta, 0, plant.nx + nd, before.nw, before.sigma)

    def of_states(self, X, m=None):
        """Return what the map has of the states and of measured disturbances alone.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            States.
        m : ndarray of shape (N, nm) or None, default=None
            Measured disturbances, if there are any.

        Returns
        -------
        z : ndarray of shape (N, nu)
            Part of v.
        a : ndarray of shape (N, m)
            Part of what the neurons see.
        Phi : ndarray of shape (N, n)
            Regressors, for `slopes`.
        """
        if m is not None:
            X = np.hstack([X, m - self.plant.d_offset])
        Phi = regressors(self._before, X[:, :0], X)
        z, a = np.split(Phi @ self._before.rows_z.T, [len(self._D)], axis=1)
        return z / self.plant.v_scale, a, Phi

    def __call__(self, z, a, dU):
        """Return v, and what the neurons see and say.

        Parameters
        ----------
        z, a : ndarray of shape (N, nu) and (N, m)
            What the map has of the states.
        dU : ndarray of shape (N, nu)
            Inputs.

        Returns
        -------
        V : ndarray of shape (N, nu)
            Inputs of the linear model.
        neurons : tuple of two ndarray of shape (N, m)
            Arguments and values.
        """
        seen = a + dU @ self._P.T
        said = np.empty_like(seen)
        for part, sigma in self._layers:
            said[:, part] = sigma.value(seen[:, part])
        return z + dU @ self._D.T + said @ self._W.T, (seen, said)

    def slope(self, seen, said):
        """Return the derivative of v by u.

        Parameters
        ----------
        seen, said : ndarray of shape (N, m)
            Arguments and values of the neurons.

        Returns
        -------
        slope : ndarray of shape (N, nu, nu)
            Derivative by u.
        gains : ndarray of shape (N, nu, m)
            Derivative by a.
        """
        derivative = np.empty_like(seen)
        for part, sigma in self._layers:
            derivative[:, part] = sigma.derivative(seen[:, part], said[:, part])
        gains = self._W * derivative[:, None, :]
        return self._D + gains @ self._P, gains

    def slope_by_states(self, Phi, gains):
        """Return the derivative of v by the states.

        Parameters
        ----------
        Phi : ndarray of shape (N, n)
            Regressors, of `of_states`.
        gains : ndarray of shape (N, nu, m)
            Derivative by a.

        Returns
        -------
        slope : ndarray of shape (N, nu, nx)
            Derivative by x.
        """
        form, nu = self._before, len(self._D)
        by_x = form.M + neuron_gains(form, form.W, Phi) @ form.V
        by_x = by_x[..., : self.plant.nx]
        return by_x[:, :nu] / self.plant.v_scale[:, None] + gains @ by_x[:, nu:]


class Mapped:
    """Hold a monotone v = phi(u, s) along a plan.

    Parameters
    ----------
    phi : InputMap
        The map.
    X : ndarray of shape (N, nx)
        States.
    U : ndarray of shape (N, nu)
        Inputs.
    m : ndarray of shape (N, nm) or None, default=None
        Measured disturbances, if there are any.

    Attributes
    ----------
    V : ndarray of shape (N, nu)
        Inputs of the linear model.
    """

    def __init__(self, phi, X, U, m=None):
        self._phi, self._X, self._m = phi, X, m
        self._dU = (U - phi.plant.v_offset) / phi.plant.v_scale
        self._z, self._a, self._Phi = phi.of_states(X, m)
        self.V, self._neurons = phi(self._z, self._a, self._dU)
        self._slopes = None

    def rows(self, limits, u_last):
        """Return the rows that limit u.

        Parameters
        ----------
        limits : ActuatorLimits
            Limits of u.
        u_last : ndarray of shape (nu,)
            Input of the last sample.

        Returns
        -------
        rows : InputRows
            The rows.
        """
        phi, dU, change = self._phi, self._dU, None
        N, nu = dU.shape
        offset, scale = phi.plant.v_offset, phi.plant.v_scale
        du = limits.du_max / scale
        low, high = (
            np.tile((bound - offset) / scale, (N, 1))
            for bound in (limits.u_min, limits.u_max)
        )
        first = _first(phi.plant, limits, u_last)
        if limits.rated:  # as far as the rate lets u come
            reach = du * np.arange(1, N + 1)[:, None]
            low, high = np.maximum(low, first - reach), np.minimum(high, first + reach)
        if not limits.couple:
            return InputRows(self._limit(low), self._limit(high), None, du)
        slope, gains = phi.slope(*self._neurons)
        F = phi.slope_by_states(self._Phi, gains)
        K = 1 / slope if nu == 1 else np.linalg.inv(slope)
        self._slopes = K, F
        Fx = _times(F, self._X)
        w = _times(K, self.V - Fx)
        if limits.rated:
            change = np.diff(w - dU, axis=0, prepend=-first[None])
            du = np.vstack([np.full(nu, np.inf), np.tile(du, (N - 1, 1))])
        if nu == 1:  # exact
            low, high = (_times(K, self._limit(bound) - Fx) for bound in (low, high))
        else:
            low, high = low + w - dU, high + w - dU
        return InputRows(low, high, change, du, self._slopes)

    def _limit(self, bound):
        """Return phi at limits of one input."""
        finite = np.isfinite(bound)
        V, _ = self._phi(self._z, self._a, np.where(finite, bound, 0.0))
        return np.where(finite, V, bound)

    def u(self, V, X):
        """Return the inputs of the plant that make others of the linear model.

        Parameters
        ----------
        V : ndarray of shape (N, nu)
            Inputs of the linear model.
        X : ndarray of shape (N, nx)
            States.

        Returns
        -------
        U : ndarray of shape (N, nu)
            Inputs, by the law; nan where there is none.
        """
        phi, plant, dU = self._phi, self._phi.plant, self._dU
        z, a, _ = phi.of_states(X, self._m)
        if self._slopes is not None:
            K, F = self._slopes
            dU = dU + _times(K, V - self.V - _times(F, X - self._X))
        for _ in range(MAX_ITER):
            value, neurons = phi(z, a, dU)
            slope, _ = phi.slope(*neurons)
            error = (value - V)[..., None]
            step = error / slope if len(dU.T) == 1 else np.linalg.solve(slope, error)
            step = step[..., 0]
            dU = dU - step
            if np.abs(step).max() <= FOUND:
                return plant.v_offset + dU * plant.v_scale
        return plant.law(plant.v_offset + V * plant.v_scale, _seen(plant, X), self._m)

    def now(self, u):
        """Return the virtual input that an input of the first sample makes.

        Parameters
        ----------
        u : ndarray of shape (nu,)
            Input of the plant.

        Returns
        -------
        v : ndarray of shape (nu,)
            Virtual input, in the units of u.
        """
        offset, scale = self._phi.plant.v_offset, self._phi.plant.v_scale
        V, _ = self._phi(self._z[:1], self._a[:1], ((u - offset) / scale)[None])
        return offset + scale * V[0]


def _seen(plant, X):
    """Return what the law measures."""
    return X if plant.feedback == "state" else plant.output(X)


def _first(plant, limits, u_last):
    """Return the last input as one that the limits allow: else they would cross."""
    return (limits.clip(u_last) - plant.v_offset) / plant.v_scale


def _times(M, x):
    """Return the products of matrices and vectors, one per row."""
    return (M @ x[..., None])[..., 0]

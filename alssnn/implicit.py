"""Neurons that see their own values: an implicit layer, solved at every sample.

Closing the loop u = phi^-1(v, s) makes the neurons of phi see themselves, for they see
u, and u is what v leaves of them (eq. inverse).  Such a layer is

    w = sigma(a + E w),        E = P Q'  of the rank of u,

and is solved for t = Q' w, of as many entries as there are inputs:

    F(t) = t - Q' sigma(a + P t) = 0.

With one input and P_i Q_i <= 0 the slope of F is at least one: the root lies within
|F(t)| of any t, on the side that the sign tells.  Newton's method is kept in that
bracket, and bisection takes over where its steps are not halved.  Else
Newton's method is damped until |F| falls; for a monotone phi its matrix is never
singular.  Where it stalls, E grows from zero in steps.  Without a solution the values
are nan.
"""

from copy import copy
from math import inf, isfinite

import numpy as np

RANK = 1e-13  # relative: what is left of E below it is rounding
MAX_ITER = 200  # bisection from any bracket to rounding, and far more than Newton's
HALVINGS = 30
STAGES = 20  # of a feedback that grows, where Newton's method alone is lost
ROUNDING = 4 * np.finfo(float).eps  # of a step, relative, that ends the iteration
BOTTOM = 1e-13  # of F, relative, where no step makes it smaller


class ImplicitLayer:
    """Solve one layer.

    Parameters
    ----------
    E : ndarray of shape (m, m)
        Weights of the neurons between themselves.
    sigma : Activation
        Their activation.
    """

    def __init__(self, E, sigma):
        self.sigma = sigma
        self.P, self.Q = _factors(E)
        self._PT, self._size = np.ascontiguousarray(self.P.T), np.abs(self.Q)
        self._QP = self.Q * self.P
        self._vectors = [z[:, 0].copy() for z in (self.P, self.Q, self._size, self._QP)]
        falls = np.all(self.P * self.Q <= 0) and sigma.slope[0] >= 0
        self.is_monotone = bool(self.P.shape[1] == 1 and falls)

    def value(self, a):
        """Return the values of the neurons.

        Parameters
        ----------
        a : ndarray of shape (N, m) or (m,)
            What the neurons see but for themselves.

        Returns
        -------
        w : ndarray of shape (N, m) or (m,)
            Values w = sigma(a + E w); nan where there is no solution.
        """
        if self.is_monotone and a.size == len(self._PT[0]) and a.dtype == float:
            return self._alone(a.ravel()).reshape(a.shape)
        return self._solved(np.atleast_2d(a)).reshape(a.shape)

    def _alone(self, a):
        """Return the values at one sample, in numbers: arrays of one row cost more."""
        p, q, size_q, qp = self._vectors
        value, derivative = self.sigma.value, self.sigma.derivative
        w = value(a)
        t, low, high, longest = float(w @ q), -inf, inf, inf
        for _ in range(MAX_ITER):
            v = a + t * p
            w = value(v)
            F = t - float(w @ q)
            if not isfinite(F):
                return np.full_like(a, np.nan)
            low, high = max(low, t - max(F, 0.0)), min(high, t - min(F, 0.0))
            step = F / (1.0 - float(derivative(v, w) @ qp))
            new = t - step
            if low <= new <= high and abs(step) <= longest:
                longest = 0.5 * abs(step)
            else:
                new, longest = 0.5 * (low + high), 0.5 * (high - low)
            far = abs(new - t) > ROUNDING * (abs(t) + float(abs(w) @ size_q))
            t = new
            if not far:
                break
        return value(a + t * p)

    def _solved(self, a):
        t = self.sigma.value(a) @ self.Q
        F, slope, size = self._error(a, t)
        if self.is_monotone:
            t = self._bracketed(a, t, F, slope, size)
        else:
            t = self._damped(a, t, F, slope, size)
            lost = np.isnan(t).any(axis=1) & np.isfinite(a).all(axis=1)
            if lost.any():
                t[lost] = self._continued(a[lost])
        return self.sigma.value(a + t @ self.P.T)

    def _error(self, a, t):
        """Return F, its derivative, and the size of what F is the difference of."""
        v = a + t @ self._PT
        w = self.sigma.value(v)
        D = self.sigma.derivative(v, w)
        if self.is_monotone:  # a number per row
            slope = 1.0 - D @ self._QP
        else:
            slope = np.eye(len(self._PT)) - (D[:, None, :] * self.Q.T) @ self.P
        return t - w @ self.Q, slope, np.abs(t) + np.abs(w) @ self._size

    def _bracketed(self, a, t, F, slope, size):
        """Return the root of a function whose slope is at least one."""
        low, high = t - np.maximum(F, 0.0), t - np.minimum(F, 0.0)
        longest = np.inf
        for _ in range(MAX_ITER):
            step = F / slope
            new = t - step
            slow = ~((new >= low) & (new <= high) & (np.abs(step) <= longest))
            longest = np.where(slow, 0.5 * (high - low), 0.5 * np.abs(step))
            new = np.where(slow, 0.5 * (low + high), new)
            if not np.any(np.abs(new - t) > ROUNDING * size):
                return new
            t = new
            F, slope, size = self._error(a, t)
            low = np.maximum(low, t - np.maximum(F, 0.0))
            high = np.minimum(high, t - np.minimum(F, 0.0))
        return t

    def _continued(self, a):
        """Return the root by way of smaller feedbacks, from none to the whole."""
        t, part = self.sigma.value(a) @ self.Q, copy(self)
        for share in np.linspace(0, 1, STAGES + 1)[1:]:
            part.P, part._PT = share * self.P, share * self._PT
            t = part._damped(a, t, *part._error(a, t))
        return t

    def _damped(self, a, t, F, slope, size):
        """Return the root by Newton's method, every row with a step of its own."""
        rows = np.arange(len(t))  # those that still move
        for _ in range(MAX_ITER):
            try:
                step = np.linalg.solve(slope, F[..., None])[..., 0]
            except np.linalg.LinAlgError:  # no monotone map
                break
            far = np.abs(step).max(axis=1) > ROUNDING * size.max(axis=1)
            rows, F, size, step = rows[far], F[far], size[far], step[far]
            if not len(rows):
                break
            norm, share = np.linalg.norm(F, axis=1), np.ones((len(rows), 1))
            for _ in range(HALVINGS):
                F_new = self._error(a[rows], t[rows] - share * step)[0]
                # "not <": nan must not count as progress
                worse = ~(np.linalg.norm(F_new, axis=1) < norm)
                if not worse.any():
                    break
                share[worse] *= 0.5
            # no step helps: at the bottom of rounding, or at a kink, which is crossed
            done = worse & (norm <= BOTTOM * size.max(axis=1))
            share[worse] = 0.5
            t[rows[~done]] -= (share * step)[~done]
            rows = rows[~done]
            F, slope, size = self._error(a[rows], t[rows])
        t[rows] = np.nan
        return t


def _factors(E):
    """Return P and Q of E = P Q', by elimination: small rows keep their digits."""
    P: list[np.ndarray] = []
    Q: list[np.ndarray] = []
    rest = E.copy()
    least = RANK * np.abs(E).max()
    while len(P) < len(E):
        i, j = np.unravel_index(np.argmax(np.abs(rest)), E.shape)
        if P and np.abs(rest[i, j]) <= least:
            break
        P.append(rest[:, j].copy())
        Q.append(rest[i] / rest[i, j])
        rest -= np.outer(P[-1], Q[-1])
    return np.transpose(P), np.transpose(Q)

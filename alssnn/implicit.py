"""Neurons that see their own values: an implicit layer, solved at every sample.

Closing the loop u = phi^-1(v, s) makes the neurons of phi see themselves, for they see
u, and u is what v leaves of them (eq. inverse).  Such a layer is

    w = sigma(a + E w),        E = P Q'  of the rank of u,

and is solved for t = Q' w, of as many entries as there are inputs:

    F(t) = t - Q' sigma(a + P t) = 0.

With one input and P_i Q_i <= 0 the slope of F is at least one: the root lies within
|F(t)| of any t, on the side that the sign tells, and bisection never leaves it.  Else
Newton's method is damped until |F| falls; for a monotone phi its matrix is never
singular.  Where it stalls, E grows from zero in steps.  Without a solution the values
are nan.
"""

from copy import copy

import numpy as np

RANK = 1e-13  # relative: what is left of E below it is rounding
MAX_ITER = 100  # bisection from any bracket to rounding, and far more than Newton's
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
        return self._solved(np.atleast_2d(a)).reshape(a.shape)

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
        before = high - low
        for _ in range(MAX_ITER):
            step = F / slope
            new = t - step
            # as fast as bisection at least, and never outside
            slow = ~((new >= low) & (new <= high) & (np.abs(step) <= 0.5 * before))
            before = np.where(slow, 0.5 * (high - low), np.abs(step))
            new = np.where(slow, 0.5 * (low + high), new)
            if not np.any(np.abs(new - t) > ROUNDING * size):
                return new
            t = new
            F, slope, size = self._error(a, t)
            low, high = np.where(F < 0, t, low), np.where(F > 0, t, high)
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

"""Neurons that see their own values: an implicit layer, solved at every sample.

Closing the loop u = phi^-1(v, s) makes the neurons of phi see themselves, for they see
u, and u is what v leaves of them (eq. inverse).  Such a layer is

    w = sigma(a + E w),        E = P Q'  of the rank of u,

and is solved for t = Q' w, of as many entries as there are inputs:

    F(t) = t - Q' sigma(a + P t) = 0.

With one input and P_i Q_i <= 0 the slope of F is at least one: the root lies within
|F(t)| of any t, on the side that the sign tells.  Newton's method is kept in that
bracket, and bisection takes over where its steps are not halved.

With several inputs of a monotone phi there is a symmetric positive definite M with
P_i = -c_i Q_i M, c_i > 0: then M F is the gradient of a strictly convex function, and
every step of Newton's method leads down to its one lowest point.  A step must halve the
least |F| so far, which it can only do so often, or stay on the near side of the lowest
point of its line.

Else Newton's method is damped until |F| falls.  Where it stalls, E grows from zero in
steps.  Without a solution the values are nan.
"""

from copy import copy
from math import inf, isfinite

import numpy as np

RANK = 1e-13  # relative: what is left of E below it is rounding
MAX_ITER = 200  # bisection from any bracket to rounding, and far more than Newton's
HALVINGS = 30
STAGES = 20  # of a feedback that grows, where Newton's method alone is lost
ROUNDING = 4 * np.finfo(float).eps  # of a step, relative, that ends the iteration
PARALLEL = 1e-10  # relative: what is left of vectors that should be parallel
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
        self.metric = None
        if sigma.slope[0] >= 0 and not self.is_monotone:
            self.metric = _metric(self.P, self.Q)

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
        elif self.metric is not None:
            t = self._lowest(a, t, F, slope, size)
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

    def _lowest(self, a, t, F, slope, size):
        """Return the lowest point of the convex function whose gradient is M F."""
        rows = np.arange(len(t))  # those that still move
        least = np.linalg.norm(F, axis=1)
        for _ in range(MAX_ITER):
            # never singular but where weights are so large that I is rounding
            step = solve_each(slope, F[..., None])[..., 0]
            far = np.abs(step).max(axis=1) > ROUNDING * size.max(axis=1)
            t[rows[~far]] -= step[~far]
            rows, F, step = rows[far], F[far], step[far]
            down = np.sum((F @ self.metric) * step, axis=1)
            share, low, high = (np.full(len(rows), z) for z in (1.0, 0.0, 1.0))
            trying = np.arange(len(rows))
            for _ in range(HALVINGS):
                if not len(trying):
                    break
                here, part = rows[trying], step[trying]
                F = self._error(a[here], t[here] - share[trying, None] * part)[0]
                ahead = np.sum((F @ self.metric) * part, axis=1)
                norm = np.linalg.norm(F, axis=1)
                near = norm < 0.5 * least[here]
                least[here] = np.where(near, norm, least[here])
                whole = (share[trying] == 1) | (ahead <= 0.5 * down[trying])
                on = ~(near | ((ahead >= 0) & whole))
                past, trying = (ahead < 0)[on], trying[on]
                high[trying] = np.where(past, share[trying], high[trying])
                low[trying] = np.where(past, low[trying], share[trying])
                share[trying] = 0.5 * (low + high)[trying]
            share[trying] = 0.0  # rounding
            t[rows] -= share[:, None] * step
            rows = rows[share > 0]
            if not len(rows):
                break
            F, slope, size = self._error(a[rows], t[rows])
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
            step = solve_each(slope, F[..., None])[..., 0]
            t[rows[np.isnan(step).any(axis=1)]] = np.nan  # no monotone map
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


def solve_each(matrices, right):
    """Return the solutions of several linear systems, nan where one is singular.

    Parameters
    ----------
    matrices : ndarray of shape (N, n, n)
        Their matrices.
    right : ndarray of shape (N, n, k) or (n, k)
        Their right sides, or one for all.

    Returns
    -------
    solutions : ndarray of shape (N, n, k)
        Solutions.
    """
    try:
        return np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:  # one of them, and which one nobody tells
        right = np.broadcast_to(right, (*matrices.shape[:2], right.shape[-1]))
        return np.stack([_solve(*both) for both in zip(matrices, right, strict=True)])


def _solve(matrix, right):
    try:
        return np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return np.full(right.shape, np.nan)


def _metric(P, Q):
    """Return M with P_i = -c_i Q_i M for all i, c_i > 0; None if there is none."""
    r, both = P.shape[1], np.any(P, axis=1) & np.any(Q, axis=1)
    if both.sum() < r:
        return None
    p, q = (z[both] / np.linalg.norm(z[both], axis=1, keepdims=True) for z in (P, Q))
    i, j = np.triu_indices(r)
    basis = np.zeros((len(i), r, r))  # of symmetric matrices, orthonormal
    basis[np.arange(len(i)), i, j] = basis[np.arange(len(i)), j, i] = 0.5**0.5
    basis[i == j] *= 2**0.5
    # q M has the direction of p: no part of it is orthogonal
    seen = np.einsum("ni,bij->bnj", q, basis)
    across = seen - np.einsum("bnj,nj,nk->bnk", seen, p, p)
    _, s, V = np.linalg.svd(across.reshape(len(basis), -1).T)
    # of several, as where inputs have neurons of their own, the one next to p'p
    null = V[s <= PARALLEL * s[0]]
    M = np.tensordot(null.T @ (null @ np.tensordot(basis, p.T @ p, 2)), basis, 1)
    eigenvalues = np.linalg.eigvalsh(M)
    is_positive = eigenvalues[0] > PARALLEL * eigenvalues[-1]
    return M if is_positive and np.all(np.sum((q @ M) * p, axis=1) < 0) else None


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

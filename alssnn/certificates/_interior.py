"""The smallest gain that slope multipliers prove, by interior points (eq. slopes).

The program has few unknowns, P, Lambda and gamma^2, in one large inequality F > 0.  A
general solver works with the inequality: its steps cost n^6 operations, where n is the
number of states, inputs and neurons.  Newton's method on

    t gamma^2 - log det F(P, Lambda, gamma^2),    t = t_0, c t_0, c^2 t_0, ...

works with the unknowns.  Every derivative of F has rank two or comes from P by a
product of matrices, so that gradient and Hessian need S = F^-1 seen from x, x+, and the
neurons, and no more.

F > 0 says that P > 0, because A is stable, and that Lambda > 0, because a neuron does
not see itself with a gain of one or more: there is no other inequality.  Iterates are
inside of it, hence certificates, up to rounding; that is left to the recomputation.

A first point is found in the same way, with F + q Q > 0 for the smallest q, under a
bound on the size of P and Lambda.
"""

from contextlib import suppress

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, eigh

CLOSE = 0.1  # Newton decrement, squared, at which the next t is taken
FASTER = 20.0  # t over the last one
SIZE = 4.0  # of the start, at which P and Lambda are bounded in search of a first point
FAR = 1e4  # of the first point, at which they are: unreachable states bound no P
FEASIBLE = 1e-9  # q above minus this, relative to Q, counts as none
STEPS = 400  # of Newton, after which the program counts as too ill-conditioned
STALLED = 1e-4  # of a Newton step, which rounding no longer lets through
NOTHING = 1e-18  # gamma squared, of the linear part one, that is as good as zero


class _Form:
    """Affine F of (P, Lambda, q), and the derivatives of -log det F.

    F = now'P now - plus'P plus - w'Lambda slack - slack'Lambda w + q Q - R
    """

    def __init__(self, now, plus, w, slack, Q, R):
        self.now, self.plus, self.w, self.slack = now, plus, w, slack
        self.Q, self.R = Q, R
        self.i, self.j = np.triu_indices(len(now))
        self.c = np.where(self.i == self.j, 1.0, 2.0)  # twice that of E_ij

    def pack(self, P, lam, q):
        return np.concatenate([P[self.i, self.j], lam, [q]])

    def unpack(self, z):
        n = len(self.now)
        P = np.zeros((n, n))
        P[self.i, self.j] = P[self.j, self.i] = z[: len(self.i)]
        return P, z[len(self.i) : -1], z[-1]

    def __call__(self, z):
        P, lam, q = self.unpack(z)
        sector = self.w.T @ (lam[:, None] * self.slack)
        F = self.now.T @ P @ self.now - self.plus.T @ P @ self.plus
        F += q * self.Q - self.R - sector - sector.T
        return (F + F.T) / 2

    def derivatives(self, factor):
        """Return gradient and Hessian of -log det F, from the factor of F."""
        S = cho_solve(factor, np.eye(len(self.Q)))
        now, plus, w, k = (Z @ S for Z in (self.now, self.plus, self.w, self.slack))
        N, L, X = now @ self.now.T, plus @ self.plus.T, now @ self.plus.T
        T = S @ self.Q @ S
        ww, kk, wk = w @ self.w.T, k @ self.slack.T, w @ self.slack.T
        m = len(self.i)
        n = m + len(w) + 1
        gradient, H = np.empty(n), np.empty((n, n))
        gradient[:m] = -self.c * (N - L)[self.i, self.j]
        gradient[m:-1] = 2 * np.diag(wk)
        gradient[-1] = -np.sum(S * self.Q)

        H[:m, :m] = self._pairs(N) + self._pairs(L) - self._pairs(X) - self._pairs(X.T)
        across = self._sums(self.now @ w.T, self.now @ k.T)
        across -= self._sums(self.plus @ w.T, self.plus @ k.T)
        H[:m, m:-1] = -across
        H[m:-1, m:-1] = 2 * (ww * kk + wk * wk.T)
        with_q = self.now @ T @ self.now.T - self.plus @ T @ self.plus.T
        H[:m, -1] = self.c * with_q[self.i, self.j]
        H[m:-1, -1] = -2 * np.sum((self.w @ T) * self.slack, axis=1)
        H[-1, -1] = np.sum(T * self.Q)
        H[m:-1, :m], H[-1, :-1] = H[:m, m:-1].T, H[:-1, -1]
        return gradient, H

    def _pairs(self, Y):
        """Return tr(E_ij Y E_kl Y') over all pairs."""
        i, j = self.i, self.j
        found = Y[np.ix_(i, i)] * Y[np.ix_(j, j)] + Y[np.ix_(i, j)] * Y[np.ix_(j, i)]
        return found * np.outer(self.c, self.c) / 2

    def _sums(self, a, b):
        """Return tr(E_ij (a b' + b a')), for the columns of a and b."""
        return self.c[:, None] * (a[self.i] * b[self.j] + a[self.j] * b[self.i])


def n_unknowns(nx, nw):
    """Return the number of unknowns of a program.

    Parameters
    ----------
    nx : int
        States.
    nw : int
        Neurons.

    Returns
    -------
    n : int
        Their number; a step costs about n^3 / 3 operations and 5 n^2 numbers.
    """
    return nx * (nx + 1) // 2 + nw + 1


def smallest_gain(blocks, tol=1e-5):
    """Minimize gamma^2 over P and Lambda (eq. slopes).

    Parameters
    ----------
    blocks : tuple of ndarray
        Matrices that map [dx; dv; dw] to dx, dx+, dv, dy, dw and to the neurons'
        inputs minus dw. In the basis of dx, A should be a contraction.
    tol : float, default=1e-5
        Relative accuracy of gamma^2.

    Returns
    -------
    P : ndarray of shape (nx, nx)
        Lyapunov matrix.
    Lam : ndarray of shape (nw,)
        Diagonal of the multiplier.
    status : str
        "optimal", "infeasible", or why it stopped early, at a point that is valid;
        P and Lam are nan if there is none.

    Raises
    ------
    RuntimeError
        If Newton's method neither finds a point nor shows that there is none.
    """
    now, plus, v, y, w, slack = blocks
    nx, nw = len(now), len(w)
    nan = np.full((nx, nx), np.nan), np.full(nw, np.nan)
    # a neuron that sees itself with a gain of one or more excludes any multiplier
    if np.any(np.sum(w * slack, axis=1) >= 0):
        return *nan, "infeasible"
    inner = ~np.any(v, axis=0)
    # effect of a neuron on x+ over that of x on it, all slopes one: what Lambda weighs
    loop = -slack @ w.T  # I - E
    out = np.linalg.norm(np.linalg.solve(loop.T, w @ plus.T), axis=1)
    seen = np.linalg.norm(np.linalg.solve(loop, (slack + w) @ now.T), axis=1)
    least = 1e-6 * max(out.max(initial=0.0), 1e-6), 1e-6 * max(seen.max(initial=0.0), 1)
    D = np.maximum(out, least[0]) / np.maximum(seen, least[1])
    size = np.concatenate([np.eye(nx)[np.triu_indices(nx)] / nx, 1 / (D * nw), [0.0]])
    inside = [Z[:, inner] for Z in (now, plus, w, slack)]
    found = _first(inside, D, size)
    if found is None:
        return *nan, "infeasible"
    P, lam = found
    Y, V = y.T @ y, v.T @ v
    form = _Form(now, plus, w, slack, V, Y)
    # large enough for y, then gamma for v: a Schur complement
    M = _Form(now, plus, w, slack, V, 0 * Y)(form.pack(P, lam, 0.0))
    large = eigh(Y[np.ix_(inner, inner)], M[np.ix_(inner, inner)], eigvals_only=True)
    grown = 2 * max(large[-1], 1e-12)
    P, lam = grown * P, grown * lam
    F = form(form.pack(P, lam, 0.0))
    across = F[np.ix_(inner, ~inner)]
    rest = across.T @ np.linalg.solve(F[np.ix_(inner, inner)], across)
    most = np.linalg.eigvalsh(rest - F[np.ix_(~inner, ~inner)])[-1]
    z = form.pack(P, lam, 2 * max(most, 1e-12))
    limit = FAR * (size @ z)
    t = len(F) / z[-1]
    z, why = _follow(
        form, z, t, size, limit, lambda z, gap: gap < tol * z[-1] or z[-1] < NOTHING
    )
    P, lam, _ = form.unpack(z)  # inside, whether or not it is the best
    return P, lam, f"stopped early: {why}" if why else "optimal"


def _first(inside, D, size):
    """Return P and Lambda inside the inequality without inputs, or None."""
    now, plus, w, slack = inside
    Q = now.T @ now + w.T @ (D[:, None] * w)
    form = _Form(now, plus, w, slack, Q, 0 * Q)
    z = form.pack(np.eye(len(now)), D, 0.0)
    z[-1] = 1.0 - min(0.0, eigh(form(z), Q, eigvals_only=True)[0])

    def ends(z, gap):
        return z[-1] < 0 or z[-1] - gap > 0 or gap < FEASIBLE

    z, why = _follow(form, z, 1.0, size, SIZE * (size @ z), ends)
    P, lam, q = form.unpack(z)
    if why and q >= 0:
        raise RuntimeError(
            f"The interior-point method broke down: {why}. Rescale the states or the "
            "signals."
        )
    return (P, lam) if q < 0 else None


def _follow(form, z, t, size, limit, ends):
    """Follow the central path of the smallest q until it `ends` at a center.

    Returns the last point, and why it ended before, if it did.
    """
    n, steps = len(form.Q) + 1, 0
    factor = cho_factor(form(z), lower=True)
    while True:
        steps += 1
        if steps > STEPS:
            return z, "too many steps"
        gradient, H = form.derivatives(factor)
        slack = limit - size @ z
        gradient += size / slack
        H += np.outer(size, size) / slack**2
        gradient[-1] += t
        d = 1 / np.sqrt(np.maximum(np.diag(H), np.finfo(float).tiny))
        scaled = H * np.outer(d, d)
        if not np.isfinite(scaled).all():  # least squares would raise, and print
            return z, "a step that is no number"
        try:
            step = -d * cho_solve(cho_factor(scaled), d * gradient)
        except LinAlgError:
            step = -d * np.linalg.lstsq(scaled, d * gradient)[0]
        decrement = -gradient @ step
        if not np.isfinite(decrement):
            return z, "a step that is no number"
        if decrement < CLOSE:
            if ends(z, n / t):
                return z, ""
            t *= FASTER
            continue
        found = _search(form, z, step, factor, t, size, limit, decrement)
        if found is None:
            return z, "no step that improves"
        z, factor = found


def _search(form, z, step, factor, t, size, limit, decrement):
    """Return a point on a Newton step where the barrier has fallen enough, or None."""

    def barrier(z, factor):
        return (
            t * z[-1] - 2 * np.log(np.diag(factor[0])).sum() - np.log(limit - size @ z)
        )

    before, length = barrier(z, factor), 1.0
    while length > STALLED:
        trial = z + length * step
        with suppress(LinAlgError):  # outside of the inequality
            if size @ trial < limit:
                found = cho_factor(form(trial), lower=True)
                after = barrier(trial, found)
                if after <= before - 0.1 * length * decrement + 1e-9 * abs(before):
                    return trial, found
        length /= 2
    return None

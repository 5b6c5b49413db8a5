"""A linear model as sections of two poles: its search on few filtered signals.

In a basis in which A is block diagonal (eq. sections),

    A_b = [sigma 1; q sigma],    (z I - A_b)^-1 = (P I + Q N),    N = [0 1; q 0],
    P = (z - sigma) / chi,    Q = 1 / chi,    chi = (z - sigma)^2 - q,

the outputs and their derivatives by all parameters are combinations of 2 (nu + 3)
signals per section that P and Q have filtered: the inputs u, an impulse for x0, and the
state x.  Only their products are summed over the samples, once for all outputs.

B, D and the initial states, on which the output depends linearly, are solved for at
every point and projected out of J'J (variable projection, with the approximation of
Kaufman).  The search moves C and the poles, the latter by reflection coefficients that
keep them in the unit disc.
"""

from functools import partial
from operator import add
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, block_diag

from .compression import EIGENVALUE_FLOOR, equilibrated_eigh
from .criterion import DIVERGED_NORM, LeastSquares
from .kernels import filter_sections
from .mapping import Held

CHUNK_BYTES = 2_000_000  # filtered signals of one chunk: about the cache
REFLECTION_LIMIT = 1 - 1e-6  # of |k|: integrators stay what they are
FIRST_LIMIT = 1 - 1e-9  # of tanh p at the start, so that p is finite
PROJECTED_FLOOR = 1e-10  # relative: rounding over the root of `EIGENVALUE_FLOOR`
MAX_CONDITION = 1e8  # of the basis: beyond, sections lose half the digits


class Modes(NamedTuple):
    """Hold m sections.

    Parameters
    ----------
    sigma, q : ndarray of shape (m,)
        Poles sigma +- sqrt(q).
    B : ndarray of shape (m, 2, nu)
        Input matrices.
    C : ndarray of shape (ny, m, 2)
        Output matrices.
    D : ndarray of shape (ny, nu)
        Feedthrough matrix.
    """

    sigma: np.ndarray
    q: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray

    @property
    def n_signals(self):
        """Return the number of filtered signals, the inputs among them."""
        m, _, nu = self.B.shape
        return 2 * m * (nu + 3) + nu


def section_basis(A):
    """Return the basis in which A consists of sections, and their poles.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.

    Returns
    -------
    T : ndarray of shape (nx, nx)
        Basis: x of the model is T times that of the sections.
    sigma, q : ndarray of shape (ceil(nx / 2),)
        Poles sigma +- sqrt(q); of the last section only sigma if nx is odd.

    Raises
    ------
    LinAlgError
        If A is not stable, or the basis is next to singular.
    """
    poles, V = np.linalg.eig(A)
    order = np.lexsort((poles.imag, poles.real))
    pairs = [(poles[i], V[:, i]) for i in order if poles[i].imag > 0]
    real = [i for i in order if poles[i].imag == 0]
    T, sigma, q = [], [], []
    for pole, v in pairs:
        T += [v.real, v.imag / pole.imag]
        sigma.append(pole.real)
        q.append(-(pole.imag**2))
    # the closest real poles may become a pair: neighbours share a section
    for i, j in zip(real[:-1:2], real[1::2], strict=True):
        half = (poles[j] - poles[i]).real / 2
        a, b = V[:, i].real, V[:, j].real
        b = b if a @ b >= 0 else -b  # so that near equal poles stay well conditioned
        T += [(a + b) / 2, (b - a) / (2 * half) if half else np.zeros(len(A))]
        sigma.append((poles[i] + poles[j]).real / 2)
        q.append(half**2)
    if len(real) % 2:
        T.append(V[:, real[-1]].real)
        sigma.append(poles[real[-1]].real)
        q.append(0.0)
    basis = np.array(T).T
    size = np.linalg.norm(basis, axis=0)
    size[size == 0] = 1.0  # equal poles share no section
    if np.abs(poles).max() >= 1 or np.linalg.cond(basis / size) > MAX_CONDITION:
        raise LinAlgError("`A` has no basis of sections.")
    return basis, np.array(sigma), np.array(q)


class Sections(LeastSquares):
    """Evaluate |r|, J'r and J'J of a linear model by its poles and C alone.

    Parameters
    ----------
    experiments : sequence of tuple of array, or Held
        Pairs (u, y) of scaled deviations; only sliced. Outputs that were not measured
        are nan.
    model : LinearModel
        Where the search starts; only its A and C count.
    radius : float, default=1.0
        Largest modulus of a pole.

    Attributes
    ----------
    start : ndarray of shape (n,)
        Free vector of the model.

    Raises
    ------
    LinAlgError
        If A is not stable, or its eigenvectors do not allow for sections.
    """

    def __init__(self, experiments, model, radius=1.0):
        self.experiments = Held.of(experiments)
        self.T, sigma, q = section_basis(model.A)
        (nx, nu), m, ny = model.B.shape, len(sigma), len(model.C)
        self.is_odd = nx % 2 == 1
        self.radius = radius  # the coefficients are those of the poles over it
        k_2 = (sigma**2 - q) / radius**2
        k_1 = -2 * sigma / radius / (1 + k_2)
        if self.is_odd:
            k_1[-1], k_2[-1] = -sigma[-1] / radius, 0.0
        k = np.clip(np.array([k_1, k_2]) / REFLECTION_LIMIT, -FIRST_LIMIT, FIRST_LIMIT)
        C = np.zeros((ny, 2 * m))
        C[:, :nx] = model.C @ self.T
        self.held = np.concatenate([np.arctanh(k).ravel(), C.ravel()])
        # free entries of p, C, B, D and x0, one after the other
        shapes = (2, m), (ny, m, 2), (m, 2, nu), (ny, nu), (m, 2)
        is_free = [np.ones(shape, bool) for shape in shapes]
        if self.is_odd:  # the last section has one pole: its second state stays zero
            is_free[0][1, -1] = is_free[1][:, -1, 1] = False
            is_free[2][-1, 1] = is_free[4][-1, 1] = False
        is_free[3][:] = model.feedthrough
        self.is_free = [part.ravel() for part in is_free]
        self.columns = np.flatnonzero(np.concatenate(self.is_free))  # of `_derivative`
        self.mask = np.concatenate(self.is_free[:2])
        self.start = self.held[self.mask]
        self.weight = np.sqrt(ny / max(self.experiments.n_measured, 1))
        self._memo: tuple = (None, None, None, 0.0)  # point, its modes, x0 and norm

    def matrices(self, free):
        """Return the model of a free vector, in the basis of the start.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        matrices : dict of str to ndarray
            A, B, C, D and x0.
        """
        (sigma, q, B, C, D), x0, _ = self._solved(free)
        nx, T = len(self.T), self.T
        A = block_diag(*([[s, 1.0], [t, s]] for s, t in zip(sigma, q, strict=True)))
        return {
            "A": T @ np.linalg.solve(T.T, A[:nx, :nx].T).T,
            "B": T @ B.reshape(-1, B.shape[-1])[:nx],
            "C": np.linalg.solve(T.T, C.reshape(len(C), -1)[:, :nx].T).T,
            "D": D,
            "x0": x0.reshape(len(x0), -1)[:, :nx] @ T.T,
        }

    def solved(self):
        """Return the model of the start with the best B, D and x0.

        Returns
        -------
        matrices : dict of str to ndarray
            A, B, C, D and x0.
        """
        return self.matrices(self.start)

    def norm(self, free):
        """Return |r| at the best B, D and x0, or `DIVERGED_NORM`.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        norm : float
            Root of the cost (eq. cost).
        """
        return self._solved(free)[2]

    def mean_squares(self, free):  # numpydoc ignore=PR01,RT01
        """Return errors of outputs, (ny,), all of weight one."""
        modes, x0, _ = self._solved(free)
        one = partial(self._squares, modes)
        squares, n = self.experiments.reduce(one, add, x0)
        return squares / np.maximum(n, 1)

    def normal_equations(self, free):
        """Return J'J and J'r without B, D and x0, and |r|.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        JJ : ndarray of shape (n, n)
            Schur complement of B, D and x0 in the Gauss-Newton matrix.
        Jr : ndarray of shape (n,)
            Half the gradient of |r|^2.
        norm : float
            Norm of the residual.
        """
        modes, x0, norm = self._solved(free)
        p = self._parts(free)[0]
        sums = self.experiments.reduce(partial(self._projected, modes, p), add, x0)
        sums = project_out(sums, 1 + len(free))
        return sums[1:, 1:], sums[1:, 0], norm

    # -- the free vector -----------------------------------------------------------

    def _parts(self, free):
        """Return p and C of a free vector."""
        flat = self.held.copy()
        flat[self.mask] = free
        n = len(self.is_free[0])
        return flat[:n].reshape(2, -1), flat[n:].reshape(-1, n // 2, 2)

    def _poles(self, p):
        """Return sigma and q, and their derivative by p, of shape (2, 2, m)."""
        t = np.tanh(p)
        k_1, k_2 = REFLECTION_LIMIT * t
        sigma = -k_1 * (1 + k_2) / 2
        q = sigma**2 - k_2
        by_k = np.array([-(1 + k_2) / 2, -k_1 / 2])
        by_k = np.array([by_k, 2 * sigma * by_k])
        by_k[1, 1] -= 1.0
        if self.is_odd:
            sigma[-1], q[-1] = -k_1[-1], 0.0
            by_k[:, :, -1] = [[-1.0, 0.0], [0.0, 0.0]]
        r = self.radius
        by_k *= np.array([r, r**2])[:, None, None]
        return r * sigma, r**2 * q, by_k * REFLECTION_LIMIT * (1 - t**2)

    # -- sums over experiments -----------------------------------------------------

    def _solved(self, free):
        """Return the sections with the best B and D, the best x0, and |r|."""
        if self._memo[0] is not None and np.array_equal(free, self._memo[0]):
            return self._memo[1:]
        p, C = self._parts(free)
        sigma, q, _ = self._poles(p)
        is_B, is_D, is_x0 = self.is_free[2:]
        (ny, m, _), nu = C.shape, len(is_D) // len(C)
        B, D = np.zeros((m, 2, nu)), np.zeros((ny, nu))
        x0 = np.zeros((len(self.experiments), m, 2))
        modes = Modes(sigma, q, B, C, D)
        found = self.experiments.map(partial(self._linear, modes))
        sums = sum(sums for sums, _ in found)
        if np.isfinite(sums).all():
            linear = -solve_singular(sums[1:, 1:], sums[1:, 0])
            n_B = np.count_nonzero(is_B)
            B.reshape(-1)[is_B], D.reshape(-1)[is_D] = linear[:n_B], linear[n_B:]
            for one, (_, step) in zip(x0, found, strict=True):
                one.reshape(-1)[is_x0] = -step[:, 0] - step[:, 1:] @ linear
            square = self.experiments.reduce(partial(self._square, modes), add, x0)
        else:
            square = np.inf
        # "not <": nan means diverged
        norm = np.sqrt(square) if square < DIVERGED_NORM**2 else DIVERGED_NORM
        self._memo = np.array(free), modes, x0, float(norm)
        return self._memo[1:]

    def _linear(self, modes, u, y):
        """Return [r J]'[r J] by B and D without x0, and what x0 follows from."""
        x0 = np.zeros((len(modes.sigma), 2))
        K = _derivative(modes, x0)[:, :, self.columns[len(self.start) :]]
        sums = self._gram(modes, x0, K, u, y)[0]
        n = sums.shape[0] - np.count_nonzero(self.is_free[4])
        if not np.isfinite(sums).all():
            return sums[:n, :n], None
        return project_out(sums, n), solve_singular(sums[n:, n:], sums[n:, :n])

    def _square(self, modes, x0, u, y):
        """Return |r|^2 of an experiment."""
        nothing = np.zeros((len(modes.C), modes.n_signals, 0))
        return self._gram(modes, x0, nothing, u, y)[1]

    def _squares(self, modes, x0, u, y):
        """Return squared errors of outputs, without weights, and how many there are."""
        y = np.asarray(y[:])
        seen = [np.where(one, y, np.nan) for one in np.eye(y.shape[1], dtype=bool)]
        squares = [self._square(modes, x0, u, one) / self.weight**2 for one in seen]
        return np.array([squares, np.isfinite(y).sum(axis=0)])

    def _projected(self, modes, p, x0, u, y):
        """Return [r J]'[r J] of an experiment by p, C, B and D, without x0."""
        K = _derivative(modes, x0)
        poles = K[:, :, : p.size]
        poles[:] = np.einsum(
            "psib,ijb->psjb",
            poles.reshape(*poles.shape[:2], *p.shape),
            self._poles(p)[2],
        ).reshape(poles.shape)
        sums = self._gram(modes, x0, K[:, :, self.columns], u, y)[0]
        return project_out(sums, len(sums) - np.count_nonzero(self.is_free[4]))

    def _gram(self, modes, x0, K, u, y):
        """Return [r J]'[r J] for J_p = Phi K_p of every output p, and |r|^2."""
        ny, nu = modes.D.shape
        beta = np.concatenate([modes.B, x0[:, :, None]], axis=2)
        kappa = _output(modes, beta).T * self.weight
        signals = np.flatnonzero(K.any(axis=(0, 2)))
        Z = np.zeros((len(modes.sigma), nu + 3, 2))
        Z[:, nu, 0] = 1.0  # x0 starts here
        n = len(signals)
        G, gr, square = np.zeros((ny, n, n)), np.zeros((ny, n)), 0.0
        chunk = max(64, CHUNK_BYTES // (8 * modes.n_signals))
        Phi = np.empty((min(chunk, len(u)), modes.n_signals))
        with np.errstate(over="ignore", invalid="ignore"):
            for start in range(0, len(u), chunk):
                part = slice(start, start + chunk)
                u_part = np.ascontiguousarray(u[part], dtype=float)
                filter_sections(modes.sigma, modes.q, beta, u_part, Z, Phi)
                phi = Phi[: len(u_part)]
                r = phi @ kappa - y[part] * self.weight
                missing = np.isnan(y[part])
                r[missing] = 0.0
                square += float(np.vdot(r, r))
                if n == 0:
                    continue
                phi = phi[:, signals] * self.weight
                gr += r.T @ phi
                if not missing.any():
                    G += phi.T @ phi
                    continue
                for G_p, lost in zip(G, missing.T, strict=True):
                    kept = phi[~lost]
                    G_p += kept.T @ kept
            K = K[:, signals]
            Jr = np.einsum("psi,ps->i", K, gr)
            JJ = sum(K_p.T @ (G_p @ K_p) for K_p, G_p in zip(K, G, strict=True))
        return np.block([[square, Jr], [Jr[:, None], JJ]]), square


def _times_N(q, v):
    """Return [v, N v] for two-vectors along axis 1 of v, on a new last axis."""
    return np.stack([v, np.stack([v[:, 1], q[:, None] * v[:, 0]], axis=1)], axis=-1)


def _output(modes, beta):
    """Return the outputs as combinations of the signals: (ny, n_signals)."""
    ny, (m, _, n) = len(modes.C), beta.shape
    kappa = np.zeros((ny, m, n + 2, 2))
    kappa[:, :, :n] = np.einsum("pbi,bisc->pbsc", modes.C, _times_N(modes.q, beta))
    return np.hstack([kappa.reshape(ny, -1), modes.D])


def _derivative(modes, x0):
    """Return the derivative of `_output`: (ny, n_signals, n).

    The columns are those of sigma, q, C, B, D and x0.
    """
    (m, _, nu), ny = modes.B.shape, len(modes.C)
    sizes = [(m,), (m,), (ny, m, 2), (m, 2, nu), (ny, nu), (m, 2)]
    stops = np.cumsum([np.prod(size) for size in sizes])
    sigma, q, C, B, D, X = (
        np.arange(stop - np.prod(size), stop).reshape(size)
        for stop, size in zip(stops, sizes, strict=True)
    )
    # c and c N: what the two pairs of a signal that enters state i give to an output
    w = np.stack([modes.C, np.stack([modes.C[..., 1] * modes.q, modes.C[..., 0]], -1)])
    w = w.transpose(2, 3, 1, 0)  # (m, 2, ny, 2)
    v = _times_N(modes.q, np.concatenate([modes.B, x0[:, :, None]], axis=2))
    K = np.zeros((m, nu + 3, stops[-1], ny, 2))
    K_u = np.zeros((nu, stops[-1], ny))
    b, i, j, p = np.arange(m), np.arange(2), np.arange(nu), np.arange(ny)
    s = np.arange(nu + 1)
    K[b[:, None, None], j, B] = w[:, :, None]
    K[b[:, None], nu, X] = w
    K[b[:, None], nu + 1 + i, sigma[:, None]] = w
    K[b, nu + 1, q] = w[:, 1]
    K[b[:, None, None], s, C[..., None], p[:, None, None, None]] = v
    K_u[j, D, p[:, None]] = 1.0
    K = K.transpose(3, 0, 1, 4, 2).reshape(ny, -1, stops[-1])
    return np.concatenate([K, K_u.transpose(2, 0, 1)], axis=1)


def project_out(W, n):
    """Return J'J of the first columns of J, freed of what the others explain.

    Parameters
    ----------
    W : ndarray of shape (m, m)
        J'J of all columns.
    n : int
        Number of columns to keep.

    Returns
    -------
    S : ndarray of shape (n, n)
        Schur complement.
    """
    S = W[:n, :n] - W[:n, n:] @ solve_singular(W[n:, n:], W[n:, :n])
    # what is left of a column that others explain is rounding, and may be negative
    np.fill_diagonal(S, np.maximum(np.diag(S), PROJECTED_FLOOR * np.diag(W)[:n]))
    return S


def solve_singular(M, h):
    """Solve symmetric equations that may be singular.

    Parameters
    ----------
    M : ndarray of shape (n, n)
        Positive semidefinite matrix.
    h : ndarray of shape (n,) or (n, m)
        Right-hand side.

    Returns
    -------
    x : ndarray of the shape of h
        Solution of M x = h without the directions that M, equilibrated, does not see.
    """
    values, Q, size = equilibrated_eigh(M, EIGENVALUE_FLOOR)
    Q = Q / size[:, None]
    return Q @ ((Q.T @ h).T / values).T

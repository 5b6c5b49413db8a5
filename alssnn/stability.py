"""Stability by construction: A = sqrt(1 - phi) K(Q), K a contraction for every Q.

    K(Q) = Q (I + Q'Q)^(-1/2)      =>   A'A <= (1 - phi) I             (eq. contract)

so that P = I is a Lyapunov matrix of A with rate phi, whatever the optimizer does to
the free matrix Q.  Only the *compressed* problem is reparameterized: with T = dA/dQ,

    J_Q = J_A T,    J_Q'J_Q = T' (J_A'J_A) T,    J_Q'r = T' J_A'r

on n x n matrices, never on the record.  The state basis can no longer hide g: a
contraction amplifies nothing on the way to the output.

The linear start is brought into a basis in which its A is such a contraction: for
r between rho(A) and (1 - phi)^(1/2), the solution P of  (A/r)' P (A/r) - P = -S  gives
|P^(1/2) A P^(-1/2)| <= r.  S is the positive part of I - (A/r)'(A/r), so that P = I
where A/r is a contraction already: the basis, in which the states have unit variance
and are uncorrelated, changes no more than it must.

Of a predictor (eq. innovations) the contraction is A - K C: it is stable for every
plant, and a plant that is not may be one.  Where a random walk is estimated beside x
(eq. drift), what would not follow both is rejected.
"""

import warnings
from dataclasses import replace

import numpy as np
from scipy.linalg import (
    LinAlgWarning,
    block_diag,
    cholesky,
    matrix_balance,
    schur,
    solve_discrete_lyapunov,
    svd,
)
from scipy.optimize import OptimizeResult

from .continuous import can_be_stepped
from .criterion import DIVERGED_NORM, Mapped
from .innovations import state_matrix
from .linear_model import decorrelate, simulation_error, stabilize
from .subspace import fit_input

MARGIN = 0.98  # of the start inside the set that Q can reach: Q stays finite
NEAREST = 1e-7  # distance of a start to a limit of one
SLOWEST = 5.0  # time constants in a record, of the slowest pole that it can tell
FASTEST = 0.5  # distance from the unit circle, to which poles are held off it
HELD_OFF = "its poles are held off the unit circle, to simulate its own record"
LARGE = 1e3  # entry of a state matrix of poles below one, whose square costs digits
LARGEST = 1e10  # eigenvalue of I + Q'Q; above it rounding reaches the least one, 1
ROUNDING = 1e-9  # norms this close to one are taken for one, and moved inside


def contraction(Q):
    """Return K(Q) = Q (I + Q'Q)^(-1/2), of norm below one (eq. contract).

    Parameters
    ----------
    Q : ndarray of shape (nx, nx)
        Free matrix.

    Returns
    -------
    K : ndarray of shape (nx, nx)
        Contraction.
    """
    eigenvalues, V = np.linalg.eigh(np.eye(len(Q)) + Q.T @ Q)
    if not eigenvalues[-1] < LARGEST:
        U, size, Vt = svd(Q)
        return U @ (np.minimum(size / np.sqrt(1 + size**2), 1.0)[:, None] * Vt)
    return Q @ (V / np.sqrt(eigenvalues)) @ V.T


def contraction_derivative(Q):
    """Return the derivative of K(Q).

    Parameters
    ----------
    Q : ndarray of shape (nx, nx)
        Free matrix.

    Returns
    -------
    T : ndarray of shape (nx**2, nx**2)
        Derivative of K.ravel() by Q.ravel().

    Notes
    -----
    With S = I + Q'Q = V diag(s) V', the derivative of S^(-1/2) in direction dS is
    V (F * V' dS V) V', F the divided differences of s^(-1/2) (Daleckii and Krein).
    """
    n = len(Q)
    s, V = np.linalg.eigh(np.eye(n) + Q.T @ Q)
    if not s[-1] < LARGEST:
        _, size, Vt = svd(Q)
        s, V = 1 + size**2, Vt.T
    root = np.sqrt(s)
    # (s_i^-1/2 - s_j^-1/2) / (s_i - s_j), written without cancellation
    F = -1.0 / (np.outer(root, root) * np.add.outer(root, root))
    inverse_root = (V / root) @ V.T
    dQ = np.eye(n * n).reshape(n * n, n, n)
    dS = dQ.transpose(0, 2, 1) @ Q + Q.T @ dQ
    dK = dQ @ inverse_root + Q @ (V @ (F * (V.T @ dS @ V)) @ V.T)
    return dK.reshape(n * n, n * n).T


def contraction_inverse(K):
    """Return Q with K = K(Q).

    Parameters
    ----------
    K : ndarray of shape (nx, nx)
        Matrix of norm below one.

    Returns
    -------
    Q : ndarray of shape (nx, nx)
        Free matrix.

    Raises
    ------
    ValueError
        If the norm of `K` is not below one.
    """
    U, s, V_t = svd(K)
    if not s.max(initial=0.0) < 1 + ROUNDING:
        raise ValueError(
            f"`K` must have a norm below 1, got {s.max():.6g}. Change the state basis."
        )
    s = np.minimum(s, 1 - ROUNDING)
    return U * (s / np.sqrt(1 - s**2)) @ V_t


def contractive_basis(model, phi, integrators=0, radius=1.0):
    """Bring a linear model into a basis in which A'A < (1 - phi) I.

    Parameters
    ----------
    model : LinearModel
        Linear model; eigenvalues of A too close to the limit are moved inside.
    phi : float
        Rate, 0 <= phi < 1.
    integrators : int, default=0
        Number of last states that are integrators (eq. integrate), in a block of
        their own: nothing contracts them.
    radius : float, default=1.0
        Largest modulus of an eigenvalue that is left.

    Returns
    -------
    model : LinearModel
        The model in the new basis, scaled by one factor so that the mean of the
        diagonal of the basis change is one.
    """
    if integrators:
        r, i = np.split(np.arange(len(model.A)), [-integrators])
        if len(r) == 0:
            return model
        A, B, C, x0 = model.A[np.ix_(r, r)], model.B[r], model.C[:, r], model.x0[:, r]
        rest = replace(model, A=A, B=B, C=C, x0=x0)
        rest = contractive_basis(rest, phi, radius=radius)
        return replace(
            model,
            A=block_diag(rest.A, np.eye(integrators)),
            B=np.vstack([rest.B, model.B[i]]),
            C=np.hstack([rest.C, model.C[:, i]]),
            x0=np.hstack([rest.x0, model.x0[:, i]]),
        )
    limit = np.sqrt(1.0 - phi)
    # slow states stay slow: only what is next to the limit keeps a distance
    inside = max(limit - MARGIN * (1.0 - limit), MARGIN * limit) - NEAREST
    A = stabilize(model.A, limit=min(inside, radius))
    r = (np.abs(np.linalg.eigvals(A)).max() + limit) / 2  # radius < r < limit
    r = max(r, MARGIN * limit)
    # where A / r is a contraction already, P = I is the solution
    excess, V = np.linalg.eigh(np.eye(len(A)) - (A / r).T @ (A / r))
    if excess.min() >= -ROUNDING:
        return replace(model, A=A)  # nothing to do: keep the basis
    with warnings.catch_warnings():  # the search tells what it is worth
        warnings.simplefilter("ignore", LinAlgWarning)
        P = _lyapunov(A / r, V * np.maximum(excess, 0.0) @ V.T)
    try:
        T = cholesky(P)  # P = T'T
    except np.linalg.LinAlgError:  # P >= I has lost its digits
        values, V = np.linalg.eigh(P)
        T = np.sqrt(np.maximum(values, 1.0))[:, None] * V.T
    T /= np.sqrt(np.mean(T**2) * len(T))
    return replace(model, A=A).in_basis(T, np.linalg.inv(T))


def _lyapunov(A, Q):
    """Return P = A'P A + Q; in another basis where A is large and its poles are not."""
    if np.abs(A).max() < LARGE:
        return solve_discrete_lyapunov(A.T, Q)
    S, U = schur(A)
    S, D = matrix_balance(S, permute=False)
    T, T_inv = U @ D, np.linalg.inv(D) @ U.T
    return T_inv.T @ solve_discrete_lyapunov(S.T, T.T @ Q @ T) @ T_inv


def hold_off(model, experiments, error):
    """Hold the poles of a linear model off the unit circle, if it needs that.

    A pole on the circle fits a record from one exact initial state; from any other
    state the error stays, and a model may simulate its own record worse than the mean.
    Poles are then cut to smaller and smaller circles, from that of a time constant of
    a fifth of the record on, and B, D and the initial states are solved for.

    Parameters
    ----------
    model : LinearModel
        Stable linear model.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    error : callable
        Called as ``error(structure, theta)``: error of a simulation of the
        record, where that of the mean is one.

    Returns
    -------
    model : LinearModel
        The model itself if its error is below one; else the one of least error.
    """

    def judge(one):
        structure, theta, _ = one.as_fit()
        return error(structure, theta)

    if judge(model) < 1.0:
        return model
    longest = max(len(u) for u, _ in experiments)
    distance = min(SLOWEST / longest, FASTEST)
    candidates = [model]
    while distance <= FASTEST:
        A = stabilize(model.A, limit=1.0 - distance)
        distance *= 2.0
        candidates.append(fit_input(experiments, A, model.C, model.feedthrough))
    best = min(candidates, key=judge)
    if best is model:
        return model
    best = decorrelate(best, experiments)
    result = OptimizeResult(
        {
            **(model.result or {}),
            "cost": simulation_error(experiments, best) ** 2,
            "message": HELD_OFF,
        }
    )
    return replace(best, singular_values=model.singular_values, result=result)


class Contractive(Mapped):
    """Replace A, or A - K C, by Q in the free vector of a criterion.

    Parameters
    ----------
    criterion : Criterion
        Criterion whose structure has a parameter A, and K if it is a predictor.
    phi : float
        Rate, 0 <= phi < 1.
    integrators : int, default=0
        Number of last states whose rows and columns of A stay what they are.
    """

    def __init__(self, criterion, phi, integrators=0):
        self.criterion = criterion
        self.scale = np.sqrt(1.0 - phi)
        nx = criterion.structure.sizes["x"]
        n = nx - integrators
        place = np.arange(nx * nx).reshape(nx, nx)[:n, :n].ravel()
        self.where = criterion.structure.slices["A"].start + place
        self.shape = n, n
        self.K, self.C = criterion.structure.slices.get("K"), None
        if self.K is not None:
            self.C = criterion.structure.constants["C"]

    def to_free(self, free):
        """Return the free vector with A in place of Q.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector with Q.

        Returns
        -------
        free : ndarray of shape (n,)
            Free vector of the criterion.
        """
        free = np.array(free)
        Q = free[self.where].reshape(self.shape)
        free[self.where] = self.scale * contraction(Q).ravel() + self._corrected(free)
        return free

    def from_free(self, free):
        """Return the free vector with Q in place of A.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector of the criterion, with A'A < (1 - phi) I.

        Returns
        -------
        free : ndarray of shape (n,)
            Free vector with Q.
        """
        free = np.array(free)
        A = (free[self.where] - self._corrected(free)).reshape(self.shape)
        free[self.where] = contraction_inverse(A / self.scale).ravel()
        return free

    def _corrected(self, free):
        """Return K C, flat."""
        if self.C is None:
            return 0.0
        return (free[self.K].reshape(self.C.T.shape) @ self.C).ravel()

    def pullback(self, free):  # numpydoc ignore=PR01,RT01
        """Return the transposed derivative of A by Q, and by K (eq. contract)."""
        T = self.scale * contraction_derivative(free[self.where].reshape(self.shape))
        by_K = None if self.C is None else np.kron(np.eye(self.shape[0]), self.C)

        def pull(sums):
            if by_K is not None:  # A follows K
                sums[self.K] += by_K @ sums[self.where]
            sums[self.where] = T.T @ sums[self.where]
            return sums

        return pull


class Schur(Mapped):
    """Reject what has a pole outside a circle, in whatever basis.

    In continuous time the circle is that of exp(pole), and poles with which steps of
    Runge and Kutta may diverge are rejected, too.

    Parameters
    ----------
    criterion : Criterion
        Criterion whose structure has a parameter A.
    radius : float
        Largest modulus of an eigenvalue of A, at most one.
    integrators : int, default=0
        Number of last states whose rows and columns of A do not count.
    """

    def __init__(self, criterion, radius, integrators=0):
        self.criterion, self.radius = criterion, radius
        self.structure = criterion.structure
        self.regular = slice(0, self.structure.sizes["x"] - integrators)

    def norm(self, free):
        """Return |r|, or `DIVERGED_NORM` where a pole is outside.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        norm : float
            Norm of the residual.
        """
        p = self.structure.split(free[: self.structure.n_params])
        A = state_matrix(self.structure, p)[self.regular, self.regular]
        if not np.isfinite(A).all():
            return DIVERGED_NORM
        poles = np.linalg.eigvals(A)
        if (sampling := self.structure.sampling) is not None:
            if not can_be_stepped(A, sampling.substeps):
                return DIVERGED_NORM
            poles = np.exp(np.minimum(poles.real, 1.0))  # of samples
        if np.abs(poles).max(initial=0.0) > self.radius:
            return DIVERGED_NORM
        return self.criterion.norm(free)

    def to_free(self, free):  # numpydoc ignore=PR01,RT01
        """Return the free vector itself."""
        return free

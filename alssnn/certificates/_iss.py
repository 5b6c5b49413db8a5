"""Input-to-state stability of x+ = A x + omega, |omega| <= eps (eq. lmi).

For P > 0, psi > 0 and 0 < phi < 1 - rho(A)^2

    [ A'PA + (phi - 1) P    A'P       ]
    [ PA                    P - psi I ]  < 0

says that V = x'Px obeys V+ <= (1 - phi) V + psi |omega|^2, so that the ellipsoid
x'Px <= psi eps^2 / phi is invariant and attracts every trajectory.

The inequality is homogeneous in (P, psi). For psi = 1 and a fixed phi it has a largest
solution, the inverse of the solution Q of a Lyapunov equation,

    Q = A Q A' / (1 - phi) + I,

which makes the ellipsoid smallest in every direction at once. Only phi is left to
choose, and peak and volume are log-convex in it: a search in one variable. The
semidefinite program (`method="sdp"`) is the paper's way to the same P.

Solutions on the boundary of the inequality prove nothing in floating point. So P is
computed for a phi and a psi that are stricter by the factor STRICT, and the margin of
the result is recomputed, in the basis where P = I.
"""

import time
import warnings
from dataclasses import dataclass
from functools import partial
from numbers import Real

import numpy as np
from scipy.linalg import (
    LinAlgWarning,
    cholesky,
    solve_discrete_lyapunov,
    solve_triangular,
)
from scipy.optimize import minimize_scalar

from ..checks import check_option

OBJECTIVES = ("peak", "feasible", "volume")
METHODS = ("lyapunov", "sdp")
STRICT = 1e-4  # relative: above rounding and solver tolerance, below what matters
FAILED = 1e3  # objective without a P, a logarithm; finite for the sake of the search
MAX_SOLVES = 20
ODDS = 8.0  # the search covers phi / (1 - rho^2) of odds exp(-8) to exp(8)


# What a certificate is worth, by where its bounds of omega and eta come from.
SOURCES = {
    "data": "conditional: a bound seen on data (eps='data') may be left elsewhere",
    "global": "for all states and inputs of the model",
    "given": "conditional: while omega stays within the number that was given",
}


@dataclass(frozen=True, eq=False, repr=False)
class IssCertificate:
    """Hold a certificate of input-to-state stability (eq. lmi).

    Parameters
    ----------
    holds : bool
        Whether the inequality was found to hold.
    margin : float
        Smallest eigenvalue of minus the inequality, relative to diag(P, psi I);
        negative if it does not hold, -inf if there is no P at all.
    P : ndarray of shape (nx, nx)
        Lyapunov matrix in the basis of `A`; nan if there is none.
    phi, psi : float
        Rate per sample, and gain from ``|omega|^2``; nan if there is no P.
    eps : float
        Bound on ``|omega|``, in the units of the states.
    eta : ndarray of shape (ny,)
        Bound on every ``|eta_i|``, what a nonlinear output adds to y at once, in the
        units of y (eq. eta).
    status : str
        "exact" (Lyapunov equation), the status of the solver, or "not solved".
    solve_time : float
        Time of all solutions, in seconds.
    n_solves : int
        Number of Lyapunov equations or semidefinite programs solved.
    reason : str
        Why the certificate does not hold or says little; empty otherwise.
    A : ndarray of shape (nx, nx)
        State matrix.
    C : ndarray of shape (ny, nx)
        Output matrix of the loop, from the deviation of the states to y - eta.
    source : {"data", "global", "given"}, default="given"
        Where the bounds eps and eta come from: seen on data, true for all states and
        inputs, or a number of the user.

    Examples
    --------
    >>> from alssnn.certificates import iss_certificate
    >>> certificate = iss_certificate([[0.9, 0.2], [0.0, 0.8]], eps=0.1)
    >>> certificate.holds, certificate.verify() > 0, certificate.contains([0.0, 0.0])
    (True, True, True)
    """

    holds: bool
    margin: float
    P: np.ndarray
    phi: float
    psi: float
    eps: float
    eta: np.ndarray
    status: str
    solve_time: float
    n_solves: int
    reason: str
    A: np.ndarray
    C: np.ndarray
    source: str = "given"

    @property
    def eigenvalue_range(self):
        """Return the smallest and the largest eigenvalue of P."""
        if not np.isfinite(self.P).all():
            return np.nan, np.nan
        eigenvalues = np.linalg.eigvalsh(self.P)
        return float(eigenvalues[0]), float(eigenvalues[-1])

    @property
    def level(self):
        """Return psi eps^2 / phi, the level of the invariant set; inf without one."""
        return float(self.psi * self.eps**2 / self.phi) if self.holds else np.inf

    @property
    def output_bound(self):
        """Return the guaranteed supremum of ``|y - y_lin|``, in the units of y."""
        if not np.isfinite(self.level):
            return np.inf
        CQC = self.C @ np.linalg.solve(self.P, self.C.T)
        by_states = np.sqrt(self.level * np.linalg.eigvalsh(CQC)[-1])
        return float(by_states + np.linalg.norm(self.eta))

    @property
    def output_bounds(self):
        """Return the guaranteed supremum per output, shape (ny,)."""
        if not np.isfinite(self.level):
            return np.full(len(self.C), np.inf)
        CQC = self.C @ np.linalg.solve(self.P, self.C.T)
        return np.sqrt(self.level * np.diag(CQC)) + self.eta

    def contains(self, x):
        """Tell which states lie in the invariant set.

        Parameters
        ----------
        x : array_like of shape (nx,) or (N, nx)
            States, as deviations from the equilibrium.

        Returns
        -------
        inside : bool or ndarray of shape (N,)
            Whether x'Px is at most the level.

        Raises
        ------
        ValueError
            If the certificate does not hold or `x` has another number of columns.
        """
        self._require()
        x = np.asarray(x, dtype=float)
        if x.ndim not in (1, 2) or x.shape[-1] != len(self.P):
            raise ValueError(
                f"`x` must have {len(self.P)} columns, got shape {x.shape}. Pass one "
                "state, or one per row."
            )
        inside = np.einsum("...i,ij,...j", x, self.P, x) <= self.level
        return bool(inside) if x.ndim == 1 else inside

    def ellipse(self, i, j, *, section=False):
        """Return the semi-axes of the invariant set in the plane of two states.

        Parameters
        ----------
        i, j : int
            Indices of two different states.
        section : bool, default=False
            Whether to cut the set by the plane through the origin instead of
            projecting it.

        Returns
        -------
        axes : ndarray of shape (2, 2)
            Semi-axes as columns, the longer one first: its boundary is
            ``axes @ [cos(t), sin(t)]``.

        Raises
        ------
        ValueError
            If the certificate does not hold or the indices are not two states.
        """
        self._require()
        nx = len(self.P)
        if i == j or not (0 <= i < nx and 0 <= j < nx):
            raise ValueError(
                f"`i` and `j` must be two different states below {nx}, got {i} and {j}."
            )
        plane = np.ix_([i, j], [i, j])
        inv = np.linalg.inv
        shape = inv(self.P[plane]) if section else inv(self.P)[plane]
        squares, axes = np.linalg.eigh(self.level * shape)
        return (axes * np.sqrt(np.maximum(squares, 0.0)))[:, ::-1]

    @property
    def verdict(self):
        """Return "holds", "does not hold", or "undecided" if no solution was valid."""
        if self.holds:
            return "holds"
        return "undecided" if self.n_solves else "does not hold"

    def verify(self):
        """Recompute the margin from A, P, phi and psi, with NumPy alone.

        Returns
        -------
        margin : float
            Margin of the inequality; positive if and only if the certificate is valid.
        """
        return iss_margin(self.A, self.P, self.phi, self.psi)

    def _require(self):
        if not self.holds:
            raise ValueError(f"The certificate must hold, got none: {self.reason}")

    def __repr__(self):
        """Return the certificate as a few lines."""
        if not self.holds:
            return f"IssCertificate: {self.verdict}. {self.reason}"
        low, high = self.eigenvalue_range
        at_once = ""
        if np.any(self.eta):
            at_once = f", |eta| <= {np.linalg.norm(self.eta):.4g}"
        lines = [
            f"IssCertificate: holds while |omega| <= {self.eps:.4g}{at_once}, margin "
            f"{self.margin:.2g} ({self.status})",
            f"  phi {self.phi:.4g}, psi {self.psi:.4g}, "
            f"eigenvalues of P {low:.3g} to {high:.3g}",
            f"  then x'Px <= {self.level:.4g}, |y - y_lin| <= {self.output_bound:.4g}",
            f"  {SOURCES[self.source]}",
        ]
        return "\n".join(lines + ([f"  {self.reason}"] if self.reason else []))


def iss_margin(A, P, phi, psi):
    """Compute the margin of the LMI (eq. lmi) for given numbers.

    Parameters
    ----------
    A : array_like of shape (nx, nx)
        State matrix.
    P : array_like of shape (nx, nx)
        Symmetric matrix.
    phi, psi : float
        Rate and gain.

    Returns
    -------
    margin : float
        Smallest eigenvalue of minus the inequality, relative to diag(P, psi I): at
        most phi, and less what rounding may have added; -inf if P or psi is not
        positive.

    Examples
    --------
    >>> from alssnn.certificates import iss_margin
    >>> bool(iss_margin([[0.5]], [[1.0]], phi=0.25, psi=2.0) > 0)
    True
    >>> bool(iss_margin([[1.5]], [[1.0]], phi=0.25, psi=2.0) > 0)  # unstable
    False
    """
    A, P = np.asarray(A, dtype=float), np.asarray(P, dtype=float)
    if not (np.isfinite(P).all() and psi > 0 and np.allclose(P, P.T, rtol=1e-9)):
        return -np.inf
    try:
        T = cholesky((P + P.T) / 2)  # P = T'T
    except np.linalg.LinAlgError:
        return -np.inf
    n = len(A)
    # the congruence by diag(T, psi^(1/2) I)^-1 turns diag(P, psi I) into I
    AI = np.hstack(
        [solve_triangular(T, (T @ A).T, trans="T").T, T / np.sqrt(psi)]
    )  # (nx, 2 nx)
    form = AI.T @ AI
    form[:n, :n] -= (1.0 - phi) * np.eye(n)
    form[n:, n:] -= np.eye(n)
    rounding = 8 * n * np.finfo(float).eps * np.linalg.cond(T)
    return float(-np.linalg.eigvalsh(form)[-1] - rounding)


def iss_certificate(
    A, C=None, *, eps=1.0, eta=0.0, phi=None, objective="peak", method="lyapunov"
):
    """Certify input-to-state stability of x+ = A x + omega, y = C x + eta (eq. lmi).

    Parameters
    ----------
    A : array_like of shape (nx, nx)
        State matrix of the linear loop.
    C : array_like of shape (ny, nx) or None, default=None
        Output matrix; None means y = x.
    eps : float, default=1.0
        Bound on ``|omega|``, in the units of the states. Nothing is certified if it is
        infinite.
    eta : float or array_like of shape (ny,), default=0.0
        Bound on every ``|eta_i|``, in the units of y.
    phi : float or None, default=None
        Rate, between 0 and 1; None searches it (`objective`).
    objective : {"peak", "feasible", "volume"}, default="peak"
        What the search of phi minimizes: the guaranteed peak of ``|y - y_lin|``, or
        the volume of the invariant set. P is scaled to P >= C'C for the peak, to
        trace(P) = nx otherwise. "feasible" takes the middle of the admissible phi.
    method : {"lyapunov", "sdp"}, default="lyapunov"
        How P is found for each phi: exactly, by a Lyapunov equation, or by a
        semidefinite program (Clarabel). Both have the same solution.

    Returns
    -------
    certificate : IssCertificate
        The certificate; one that does not hold says why.

    Raises
    ------
    ValueError
        If an argument is out of range or the shapes do not fit.
    RuntimeError
        If the solver of the semidefinite program breaks down.

    Notes
    -----
    At most 20 solutions; a Lyapunov equation costs O(nx^3) operations.

    Examples
    --------
    >>> from alssnn.certificates import iss_certificate
    >>> certificate = iss_certificate([[0.5]], eps=0.1)
    >>> certificate.holds, round(certificate.output_bound, 3)
    (True, 0.2)
    """
    A, C, eta = _check(A, C, eps, eta, phi, objective, method)
    certificate = partial(_certificate, A, C, eps, eta)
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    limit = 1.0 - radius**2
    if radius >= 1:
        reason = f"The spectral radius of A is {radius:.6g}, not below one."
        return certificate("not solved", reason)
    if phi is not None and phi >= limit:
        reason = (
            f"phi = {phi:.6g} is not below 1 - rho^2 = {limit:.6g}, where rho is the "
            "spectral radius of A."
        )
        return certificate("not solved", reason)
    if np.isinf(eps):
        return certificate("not solved", "eps is infinite: nothing bounds omega.")
    if phi is None and objective == "feasible":
        phi = limit / 2

    start = time.perf_counter()
    search = _Search(A, C, limit, objective, method)
    if phi is None:
        minimize_scalar(
            lambda s: search(limit / (1.0 + np.exp(-s))),
            bounds=(-ODDS, ODDS),
            method="bounded",
            options={"maxiter": MAX_SOLVES - 1, "xatol": 1e-3},
        )
    else:
        search(phi)
    seconds = time.perf_counter() - start
    if search.best is None:
        reason = "No phi gave a P that passes the recomputation of the inequality."
        if method == "sdp":
            reason += " Use `method='lyapunov'`."
        return certificate(search.status, reason, seconds, search.n_solves)
    _, phi, P, status = search.best

    psi = 1.0 + STRICT
    if objective == "peak":
        scale = np.linalg.eigvalsh(C @ np.linalg.solve(P, C.T))[-1]
    else:
        scale = len(A) / np.trace(P)
    P, psi = scale * P, scale * psi
    reason = "" if np.isfinite(eta).all() else "Nothing bounds eta, nor the output."
    return certificate(status, reason, seconds, search.n_solves, (P, phi, psi))


class _Search:
    """Solve for P at every phi asked for, and keep the best one that passes."""

    def __init__(self, A, C, limit, objective, method):
        self.A, self.C, self.limit, self.objective = A, C, limit, objective
        self.solve = self._lyapunov
        if method == "sdp":
            from ._sdp import LargestP

            self.solve = LargestP(A)
        self.n_solves, self.best, self.status = 0, None, "not solved"

    def __call__(self, phi):
        """Return the logarithm of the objective, or FAILED without a valid P."""
        self.n_solves += 1
        strict = phi + STRICT * (self.limit - phi)
        P, self.status = self.solve(strict)
        if not iss_margin(self.A, P, phi, 1.0 + STRICT) > 0:
            return FAILED
        if self.objective == "volume":
            value = -np.linalg.slogdet(P)[1] - len(P) * np.log(phi)
        else:
            CQC = self.C @ np.linalg.solve(P, self.C.T)
            value = np.log(np.linalg.eigvalsh(CQC)[-1] / phi)
        if self.best is None or value < self.best[0]:
            self.best = value, phi, P, self.status
        return value

    def _lyapunov(self, phi):
        n = len(self.A)
        with warnings.catch_warnings():
            # whether P is good enough is left to the recomputed margin
            warnings.simplefilter("ignore", LinAlgWarning)
            try:
                Q = solve_discrete_lyapunov(self.A / np.sqrt(1.0 - phi), np.eye(n))
                P = np.linalg.inv((Q + Q.T) / 2)
            except np.linalg.LinAlgError:
                return np.full((n, n), np.nan), "singular"
        return (P + P.T) / 2, "exact"


def _certificate(A, C, eps, eta, status, reason, seconds=0.0, n_solves=0, found=None):
    """Return the certificate of (P, phi, psi) found, or one that does not hold."""
    P, phi, psi = found or (np.full(A.shape, np.nan), np.nan, np.nan)
    return IssCertificate(
        holds=found is not None,
        margin=iss_margin(A, P, phi, psi),
        P=P,
        phi=float(phi),
        psi=float(psi),
        eps=float(eps),
        eta=eta,
        status=status,
        solve_time=seconds,
        n_solves=n_solves,
        reason=reason,
        A=A,
        C=C,
    )


def _check(A, C, eps, eta, phi, objective, method):
    """Return A, C and eta as arrays, or say what is wrong with the arguments."""
    A = np.asarray(A, dtype=float)
    if A.ndim != 2 or A.shape[0] != A.shape[1] or not np.isfinite(A).all():
        raise ValueError(
            f"`A` must be a finite square matrix, got shape {A.shape}. Pass `A_`."
        )
    C = np.eye(len(A)) if C is None else np.asarray(C, dtype=float)
    if C.ndim != 2 or C.shape[1] != len(A) or not np.isfinite(C).all():
        raise ValueError(
            f"`C` must be a finite matrix of {len(A)} columns, got shape {C.shape}. "
            "Pass `C_`."
        )
    if not np.any(C):
        raise ValueError("`C` must not be zero, got zeros. Pass None for y = x.")
    if not (isinstance(eps, Real) and float(eps) >= 0):
        raise ValueError(f"`eps` must be at least 0, got {eps!r}. Pass a bound on |g|.")
    eta = np.asarray(eta, dtype=float)
    if eta.shape not in ((), (len(C),)) or not np.all(eta >= 0):
        raise ValueError(
            f"`eta` must be at least 0, one number or one per output, got {eta}."
        )
    if phi is not None and not (isinstance(phi, Real) and 0 < float(phi) < 1):
        raise ValueError(
            f"`phi` must be between 0 and 1, got {phi!r}. Pass None to search it."
        )
    check_option("objective", objective, OBJECTIVES)
    check_option("method", method, METHODS)
    return A, C, np.broadcast_to(eta, len(C))

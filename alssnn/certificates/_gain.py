"""Incremental gain of a Lur'e form by slopes of its neurons, and the H-infinity norm.

Two trajectories of a Lur'e form differ by dx, dw, dy for inputs that differ by dv. All
that is used of a neuron is its slope at its input nu_i, between 0 and 1 (as that of
tanh; other activations are brought to it by a change of w),

    dw_i (dnu_i - dw_i) >= 0,    dnu = V [dx; dv] + E dw.

If for P > 0 and Lambda >= 0 diagonal, for all dx, dv, dw,

    dx+'P dx+ - dx'P dx + |dy|^2 - gamma^2 |dv|^2
        + 2 dw' Lambda (dnu - dw) < 0                              (eq. slopes)

then the l2 norm of dy is at most gamma times that of dv, for equal initial states.
Multipliers treat every slope as free at every sample: gamma may be far above the
truth, but never below.
"""

import time
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cholesky, eig, solve_discrete_lyapunov, solve_triangular

from ..lure import Lure

SHIFT = 1e-7  # strictness asked of the solver, whose tolerance is about 1e-8
GRID = 512  # first frequencies of the H-infinity norm
ON_CIRCLE = 1e-7  # distance from the unit circle that counts as on it
MAX_STEPS = 50  # quadratic convergence: a handful is the rule


@dataclass(frozen=True, eq=False, repr=False)
class GainCertificate:
    """Hold a certificate of incremental gain (eq. slopes).

    Parameters
    ----------
    holds : bool
        Whether a finite gain was certified.
    margin : float
        Smallest eigenvalue of minus the inequality, scaled to a unit diagonal in the
        basis where P = I; -inf if there is no P.
    gamma : float
        Bound on the incremental l2 gain from v to y, in units of y per unit of v; inf
        if there is none.
    P : ndarray of shape (nx, nx)
        Lyapunov matrix in the basis of `lure`; nan if there is none.
    Lam : ndarray of shape (nw,)
        Diagonal of the multiplier.
    status : str
        Status of the solver, or "not solved".
    solve_time : float
        Time of the solution, in seconds.
    n_solves : int
        Number of semidefinite programs solved.
    reason : str
        Why the certificate does not hold; empty otherwise.
    lure : Lure
        The certified loop, its neurons brought to slopes between 0 and 1.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> certificate = model.gain_certificate()
    >>> certificate.holds, certificate.verify() > 0
    (True, True)
    """

    holds: bool
    margin: float
    gamma: float
    P: np.ndarray
    Lam: np.ndarray
    status: str
    solve_time: float
    n_solves: int
    reason: str
    lure: Lure = field(repr=False)

    @property
    def verdict(self):
        """Return "holds", "does not hold", or "undecided" if the solver failed."""
        if self.holds:
            return "holds"
        decided = self.status == "not solved" or self.status.startswith("infeasible")
        return "does not hold" if decided else "undecided"

    def verify(self):
        """Recompute the margin from the loop, P, Lam and gamma, with NumPy alone.

        Returns
        -------
        margin : float
            Margin of the inequality; positive if and only if the certificate is valid.
        """
        return _margin(self.lure, self.P, self.Lam, self.gamma)

    def __repr__(self):
        """Return the certificate in one line."""
        if not self.holds:
            return f"GainCertificate: {self.verdict}. {self.reason}"
        return (
            f"GainCertificate: holds, |dy| <= {self.gamma:.4g} |dv| in l2, margin "
            f"{self.margin:.2g} ({self.status})"
        )


def gain_certificate(lure):
    """Certify the incremental l2 gain of a Lur'e form (eq. slopes).

    Parameters
    ----------
    lure : Lure
        Loop from its input to all of its channels; several layers are allowed.

    Returns
    -------
    certificate : GainCertificate
        The smallest gain that diagonal multipliers prove; one that does not hold says
        why.

    Notes
    -----
    One semidefinite program with an inequality of size nx + nu + nw.

    References
    ----------
    .. [1] M. Fazlyab et al., "Efficient and accurate estimation of Lipschitz constants
       for deep neural networks", NeurIPS, 2019.
    .. [2] H. Yin, P. Seiler, M. Arcak, "Stability analysis using quadratic constraints
       for systems with neural network controllers", IEEE Transactions on Automatic
       Control 67(4), 2022.

    Examples
    --------
    >>> from alssnn.certificates import gain_certificate
    >>> from alssnn.lure import Lure
    >>> Theta = np.array([[0.5, 1.0, 0.0], [1.0, 0.0, 0.0]])  # x+ = x / 2 + v, y = x
    >>> round(gain_certificate(Lure(Theta, nx=1, nu=1, nw=0)).gamma, 2)
    2.0
    """
    lure = _unit_slopes(lure)
    A, B = lure.M[: lure.nx, : lure.nx], lure.M[: lure.nx, lure.nx :]
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    if radius >= 1:
        reason = f"The spectral radius of A is {radius:.6g}, not below one."
        return _none(lure, "not solved", reason)
    from ._sdp import smallest_gain

    C = lure.M[lure.nx :, : lure.nx]
    # The linear part (all slopes 0) is one of the loops: its gain is the unit.
    unit = hinf_norm(A, B, C) or 1.0
    # a basis in which A contracts, for the sake of the solver
    r = (1.0 + radius) / 2
    T = cholesky(solve_discrete_lyapunov((A / r).T, np.eye(len(A))))
    T *= max(np.linalg.norm(C @ np.linalg.inv(T), 2) / unit, 1e-6)
    start = time.perf_counter()
    try:
        P, Lam, status = smallest_gain(_blocks(_change(lure, T), unit), SHIFT)
    except RuntimeError as error:  # a failed solve is a result, too
        return _none(lure, "error", str(error), time.perf_counter() - start)
    seconds = time.perf_counter() - start
    if not np.isfinite(P).all():
        reason = (
            "The program is infeasible: no diagonal multipliers prove a finite gain."
        )
        return _none(lure, status, reason, seconds)
    P, Lam = unit**2 * T.T @ P @ T, unit**2 * Lam
    P = (P + P.T) / 2
    gamma = _smallest_gamma(lure, P, Lam)
    margin = _margin(lure, P, Lam, gamma)
    if not margin > 0:
        reason = "The solver's multipliers fail the recomputation of the inequality."
        return _none(lure, status, reason, seconds)
    return GainCertificate(True, margin, gamma, P, Lam, status, seconds, 1, "", lure)


def hinf_norm(A, B, C, tol=1e-8):
    """Compute the H-infinity norm of C (zI - A)^-1 B.

    Parameters
    ----------
    A, B, C : array_like of shapes (nx, nx), (nx, nu), (ny, nx)
        Discrete-time system; B = I gives the gain from omega to y.
    tol : float, default=1e-8
        Relative accuracy.

    Returns
    -------
    norm : float
        Largest gain over all frequencies; inf if A is not stable.

    Notes
    -----
    A grid of frequencies gives a lower bound. It is raised until the symplectic pencil
    of the bounded-real lemma, at the next larger level, has no eigenvalue on the unit
    circle: such eigenvalues are the frequencies at which the gain crosses the level
    [1]_. Costs a few eigenvalue problems of size 2 nx.

    References
    ----------
    .. [1] N. A. Bruinsma, M. Steinbuch, "A fast algorithm to compute the H-infinity
       norm of a transfer function matrix", Systems and Control Letters 14, 1990.

    Examples
    --------
    >>> from alssnn.certificates import hinf_norm
    >>> round(hinf_norm([[0.5]], [[1.0]], [[1.0]]), 6)  # 1 / (1 - 0.5), at rest
    2.0
    """
    A, B, C = (np.asarray(X, dtype=float) for X in (A, B, C))
    n = len(A)
    poles = np.linalg.eigvals(A)
    if np.abs(poles).max() >= 1:
        return np.inf

    def gain(angles):
        z = np.exp(1j * np.asarray(angles))[:, None, None]
        G = C @ np.linalg.solve(
            z * np.eye(n) - A, np.broadcast_to(B, (len(z), *B.shape))
        )
        return float(np.linalg.norm(G, ord=2, axis=(1, 2)).max())

    # resonances are near the poles
    norm = gain(np.concatenate([np.linspace(0, np.pi, GRID), np.angle(poles)]))
    if norm == 0:
        return 0.0
    for _ in range(MAX_STEPS):
        level = norm * (1 + tol)
        right = np.block([[np.eye(n), -(B @ B.T) / level], [np.zeros((n, n)), A.T]])
        left = np.block([[A, np.zeros((n, n))], [-(C.T @ C) / level, np.eye(n)]])
        z = eig(left, right, right=False)
        z = z[np.isfinite(z)]
        crossings = np.sort(np.angle(z[np.abs(np.abs(z) - 1) < ON_CIRCLE]))
        if not len(crossings):
            break
        following = np.append(crossings[1:], crossings[0] + 2 * np.pi)
        raised = gain(np.concatenate([crossings, (crossings + following) / 2]))
        if raised <= level:
            break
        norm = raised
    return norm


def _change(lure, T):
    """Return the Lur'e form in the state basis T x."""
    nx, Theta = lure.nx, lure.Theta.copy()
    Theta[:nx] = T @ Theta[:nx]
    Theta[:, :nx] = solve_triangular(T, Theta[:, :nx].T, trans="T").T
    return Lure(Theta, nx, lure.nu, lure.nw, lure.sigma)


def _unit_slopes(lure):
    """Return the form with neurons of slopes 0 to 1, by w = a nu + (b - a) w_1.

    a and b bound the slopes of w; what is linear in the neurons' inputs nu joins M.
    """
    a, b = np.array([activation.slope for activation in lure.sigma]).reshape(-1, 2).T
    n = lure.nx + lure.nz
    weights = slice(lure.nx + lure.nu, -1)
    Theta = lure.Theta.copy()
    W, E = lure.W, lure.E
    Theta[:, weights] *= b - a
    # nu = (I - E diag(a))^-1 (V [x; u] + E diag(b - a) w_1 + b)
    Theta[n:] = np.linalg.solve(np.eye(lure.nw) - E * a, Theta[n:])
    Theta[:n] += (W * a) @ Theta[n:]
    return Lure(Theta, lure.nx, lure.nu, lure.nw, lure.sigma)


def _blocks(lure, unit=1.0):
    """Return the maps from [dx; dv; dw] to all differences; y in multiples of unit."""
    nx, nu, nw = lure.nx, lure.nu, lure.nw
    now, v, w = np.split(np.eye(nx + nu + nw), [nx, nx + nu])
    plus, y, neurons = np.split(lure.Theta[:, :-1], [nx, nx + lure.nz])
    return now, plus, v, y / unit, w, neurons - w


def _form(lure, P, Lam):
    """Return the quadratic form (eq. slopes) without its term in gamma."""
    now, plus, _, y, w, slack = _blocks(lure)
    sector = w.T @ (Lam[:, None] * slack)
    return plus.T @ P @ plus - now.T @ P @ now + y.T @ y + sector + sector.T


def _smallest_gamma(lure, P, Lam):
    """Return the gamma that P and Lam prove, by the Schur complement of dv."""
    nx, nu = lure.nx, lure.nu
    form = _form(lure, P, Lam)
    v = np.arange(nx, nx + nu)
    rest = np.setdiff1d(np.arange(len(form)), v)
    try:
        R = cholesky(-form[np.ix_(rest, rest)])
    except np.linalg.LinAlgError:
        return np.inf
    across = solve_triangular(R, form[np.ix_(rest, v)], trans="T")
    largest = np.linalg.eigvalsh(form[np.ix_(v, v)] + across.T @ across)[-1]
    # strict, and positive for a loop that passes nothing
    return float(np.sqrt(max(largest, np.finfo(float).tiny)) * (1 + 1e-5))


def _margin(lure, P, Lam, gamma):
    """Return the margin of (eq. slopes), -inf unless P > 0, Lam >= 0, gamma finite."""
    numbers = np.concatenate([P.ravel(), Lam, [gamma]])
    if not np.isfinite(numbers).all() or np.any(Lam < 0):
        return -np.inf
    try:
        T = cholesky((P + P.T) / 2)  # P = T'T
    except np.linalg.LinAlgError:
        return -np.inf
    nx, nu = lure.nx, lure.nu
    form = _form(_change(lure, T), np.eye(nx), Lam)
    v = np.arange(nx, nx + nu)
    form[v, v] -= gamma**2
    scale = np.sqrt(np.maximum(-np.diag(form), np.finfo(float).tiny))
    if np.any(np.diag(form) >= 0):
        return float(-np.max(np.diag(form)))
    rounding = 8 * len(form) * np.finfo(float).eps * np.linalg.cond(T)
    return float(-np.linalg.eigvalsh(form / np.outer(scale, scale))[-1] - rounding)


def _none(lure, status, reason, seconds=0.0):
    """Return the certificate that does not hold."""
    P, Lam = np.full((lure.nx, lure.nx), np.nan), np.full(lure.nw, np.nan)
    n_solves = int(status != "not solved")
    return GainCertificate(
        False, -np.inf, np.inf, P, Lam, status, seconds, n_solves, reason, lure
    )

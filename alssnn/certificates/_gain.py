"""Incremental gain of a Lur'e form by slopes of its neurons.

Two trajectories of a Lur'e form differ by dx, dw, dy for inputs that differ by dv. All
that is used of a neuron is its slope at its input nu_i, between 0 and 1 (as that of
tanh; other activations are brought to it by a change of w),

    dw_i (dnu_i - dw_i) >= 0,    dnu = V [dx; dv] + E dw.

If for P > 0 and Lambda >= 0 diagonal, for all dx, dv, dw,

    dx+'P dx+ - decay^2 dx'P dx + |dy|^2 - gamma^2 |dv|^2
        + 2 dw' Lambda (dnu - dw) < 0                              (eq. slopes)

then the l2 norm of dy is at most gamma times that of dv, for equal initial states.
Multipliers treat every slope as free at every sample: gamma may be far above the
truth, but never below. With dx weighted by the inverse of a `decay` below one, the
inequality says that trajectories of equal inputs approach each other at that rate, too.
"""

import time
import warnings
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import cholesky, solve_discrete_lyapunov, solve_triangular

from ..forms import part
from ..lure import Lure
from ._hinf import hinf_norm
from ._interior import n_unknowns, smallest_gain
from ._neurons import reaching
from ._state_feedback import matrices

TOLERANCES = (1e-5, 1e-3)  # of gamma^2: the second where rounding takes the first
LARGEST = 2000  # unknowns of a program, which then takes minutes
NEARLY_ZERO = 1e-3  # of what inputs of all states make: a gain that counts as zero


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
        The certified loop, its neurons brought to slopes between 0 and 1; without
        those that reach neither x+ nor y, but for rounding.
    decay : float, default=1.0
        Rate per sample at which trajectories of equal inputs approach each other:
        ``dx_k' P dx_k <= decay^(2 k) dx_0' P dx_0``.

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
    lure: Lure
    decay: float = 1.0

    @property
    def verdict(self):
        """Return "holds", "does not hold" (A is no contraction), or "undecided"."""
        if self.holds:
            return "holds"
        # multipliers that do not exist decide nothing: they treat every neuron alone,
        # and together they may do no harm
        A = self.lure.M[: self.lure.nx, : self.lure.nx]
        radius = np.abs(np.linalg.eigvals(A)).max(initial=0.0)
        return "does not hold" if radius >= self.decay else "undecided"

    @classmethod
    def none(cls, reason):
        """Return the certificate of a loop for which nothing was tried.

        Parameters
        ----------
        reason : str
            Why.

        Returns
        -------
        certificate : GainCertificate
            One that does not hold.
        """
        return _certificate(Lure(np.zeros((0, 1)), 0, 0, 0), 1.0, "not tried", reason)

    def is_of(self, lure, slopes):
        """Return whether this certificate is that of a form with given slopes.

        Parameters
        ----------
        lure : Lure
            Form.
        slopes : pair of ndarray of shape (nw,)
            Least and largest slope of every neuron.

        Returns
        -------
        is_of : bool
            Whether its loop is that form, with neurons of slopes between 0 and 1.
        """
        mine = _unit_slopes(lure, *slopes).Theta
        return mine.shape == self.lure.Theta.shape and np.allclose(
            mine, self.lure.Theta, rtol=1e-9, atol=1e-12
        )

    def verify(self):
        """Recompute the margin from the loop, P, Lam and gamma, with NumPy alone.

        Returns
        -------
        margin : float
            Margin of the inequality; positive if and only if the certificate is valid.
        """
        return _margin(self.lure, self.P, self.Lam, self.gamma, self.decay)

    def __repr__(self):
        """Return the certificate in one line."""
        if not self.holds:
            return f"GainCertificate: {self.verdict}. {self.reason}"
        rate = f", |dx| falls by {self.decay:.4g}" if self.decay < 1 else ""
        return (
            f"GainCertificate: holds, |dy| <= {self.gamma:.4g} |dv| in l2{rate}, "
            f"margin {self.margin:.2g} ({self.status})"
        )


def gain_certificate(lure, slopes=None, *, decay=1.0):
    """Certify the incremental l2 gain of a Lur'e form (eq. slopes).

    Parameters
    ----------
    lure : Lure
        Loop from its input to all of its channels; several layers are allowed.
    slopes : pair of array_like of shape (nw,) or None, default=None
        Least and largest slope of every neuron, one number for all or one per neuron.
        The certificate is then of trajectories along which these slopes hold, which
        the caller has to prove: along every segment between the two inputs of a
        neuron. None takes the slopes that the activations have anywhere.
    decay : float, default=1.0
        Rate per sample that is asked of the distance of two trajectories with equal
        inputs, in the norm of P, above 0 and at most 1. The gain then also holds for
        signals weighted by ``decay^-k``.

    Returns
    -------
    certificate : GainCertificate
        The smallest gain that diagonal multipliers prove; one that does not hold says
        why.

    Raises
    ------
    ValueError
        If `slopes` is no pair of finite numbers per neuron, the least ones first, or
        `decay` is out of range.

    Notes
    -----
    One semidefinite program with an inequality of size nx + nu + nw, in n = nx (nx + 1)
    / 2 + nw + 1 unknowns, solved by an interior-point method of its own: some 50 steps
    of about n^3 / 3 operations. Nothing is certified beyond n = 2000 (62 states): the
    certificate says so at once.

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
    if not 0 < decay <= 1:
        raise ValueError(
            f"`decay` must be above 0 and at most 1, got {decay}. It is a rate per "
            "sample."
        )
    slopes = _slopes(lure, slopes)
    try:
        lure = _unit_slopes(lure, *slopes)
    except np.linalg.LinAlgError:  # neurons that see themselves
        reason = "With the least slopes the neurons' inputs have no unique solution."
        return _certificate(lure, decay, "not solved", reason)
    certificate = partial(_certificate, lure, decay)
    reason = _obstacle(lure, decay)
    if reason:
        return certificate("not solved", reason)
    n = n_unknowns(lure.nx, lure.nw)
    if n > LARGEST:
        reason = (
            f"The program has {n} unknowns, more than {LARGEST}, for {lure.nx} states "
            f"and {lure.nw} neurons. Fit fewer states; late inputs are states, too."
        )
        return certificate("too large", reason)
    start = time.perf_counter()
    try:
        with warnings.catch_warnings():  # of units far apart: any basis is one
            warnings.simplefilter("ignore")
            stirred, T, unit = _scaled(lure, decay)
    except np.linalg.LinAlgError:
        reason = "The states have no basis in which the loop contracts. Rescale them."
        return certificate("not solved", reason)
    for n_solves, tol in enumerate(TOLERANCES, 1):
        try:
            blocks = _blocks(_change(stirred, T), unit, decay)
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                P, Lam, status = smallest_gain(blocks, tol)
        except (RuntimeError, ValueError) as error:  # a failed solve is a result, too
            seconds = time.perf_counter() - start
            return certificate("error", str(error), seconds, n_solves)
        seconds = time.perf_counter() - start
        if not np.isfinite(P).all():
            reason = (
                "No diagonal multipliers were found that prove a finite gain: the "
                "program is infeasible, or too nearly so."
            )
            return certificate(status, reason, seconds, n_solves)
        P, Lam = unit**2 * T.T @ P @ T, unit**2 * Lam
        P = (P + P.T) / 2
        gamma = _smallest_gamma(lure, P, Lam, decay)
        found = certificate(status, "", seconds, n_solves, (P, Lam, gamma))
        if found.holds:
            return found
    reason = "The solver's multipliers fail the recomputation of the inequality."
    return certificate(status, reason, seconds, n_solves)


def _scaled(lure, decay):
    """Return the form whose gain is computed, a basis of the states, and a unit."""
    # The linear part (all slopes 0) is one of the loops: its gain is the unit.
    A, B, C, _ = matrices(lure)
    unit = hinf_norm(A / decay, B / decay, C)
    # a basis in which A contracts, for the sake of the solver
    r = (decay + float(np.abs(np.linalg.eigvals(A)).max())) / 2
    T = cholesky(solve_discrete_lyapunov((A / r).T, np.eye(len(A))))
    stirred, passed = lure, hinf_norm(A / decay, np.linalg.inv(T) / decay, C)
    least = NEARLY_ZERO * np.linalg.norm(T @ B, 2) * passed
    if unit <= least:  # the inputs do not reach the outputs: small ones of all states
        unit = least or passed or 1.0
        stirred = _stirred(lure, unit / (passed or 1.0) * np.linalg.inv(T))
    T *= max(np.linalg.norm(C @ np.linalg.inv(T), 2) / unit, 1e-6)
    return stirred, T, unit


def _stirred(lure, B):
    """Return the form with an input for every state, at the end: gains of it are more.

    A program whose inputs reach no output would have no unique solution.
    """
    end, nx = lure.nx + lure.nu, lure.nx
    Theta = np.insert(lure.Theta, [end] * nx, 0.0, axis=1)
    Theta[:nx, end : end + nx] = B
    return replace(lure, Theta=Theta, nu=lure.nu + nx)


def _obstacle(lure, decay):
    """Return why no multipliers exist, as far as two loops of constant slopes tell."""
    nx, A = lure.nx, lure.M[: lure.nx, : lure.nx]
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    below = "one" if decay == 1 else f"the decay {decay:.6g}"
    if radius >= decay:
        return f"The spectral radius of A is {radius:.6g}, not below {below}."
    try:
        seen = np.linalg.solve(np.eye(lure.nw) - lure.E, lure.V[:, :nx])
    except np.linalg.LinAlgError:
        return "With the largest slopes the neurons' inputs have no unique solution."
    steepest = np.abs(np.linalg.eigvals(A + lure.W[:nx] @ seen)).max()
    if steepest >= decay:
        return (
            "No multipliers prove a finite gain: where all neurons have their largest "
            f"slopes, the spectral radius is {steepest:.6g}, not below {below}."
        )
    return ""


def _change(lure, T):
    """Return the Lur'e form in the state basis T x."""
    nx, Theta = lure.nx, lure.Theta.copy()
    Theta[:nx] = T @ Theta[:nx]
    Theta[:, :nx] = solve_triangular(T, Theta[:, :nx].T, trans="T").T
    return replace(lure, Theta=Theta)


def _slopes(lure, slopes):
    """Return the least and the largest slope of every neuron, or say what is wrong."""
    if slopes is None:
        slopes = np.array([activation.slope for activation in lure.sigma])
        return slopes.reshape(-1, 2).T
    try:
        a, b = (np.broadcast_to(np.asarray(s, float), lure.nw) for s in slopes)
    except (TypeError, ValueError):
        raise ValueError(
            f"`slopes` must be a pair of numbers or of arrays of shape ({lure.nw},), "
            f"got {slopes!r}. Pass (least, largest), one entry per neuron."
        ) from None
    wrong = np.flatnonzero(~(np.isfinite(a) & np.isfinite(b) & (a <= b)))
    if len(wrong):
        i = wrong[0]
        raise ValueError(
            "`slopes` must be finite, and the least at most the largest, got "
            f"{a[i]:.6g} and {b[i]:.6g} of neuron {i}. Pass (least, largest)."
        )
    return a, b


def _unit_slopes(lure, a, b):
    """Return the form with neurons of slopes 0 to 1, by w = a nu + (b - a) w_1.

    a and b bound the slopes of w; what is linear in the neurons' inputs nu joins M.
    Neurons that reach neither x+ nor a channel are left out: a law that cancels h
    leaves columns of it that are zero but for rounding.
    """
    n = lure.nx + lure.nz
    weights = slice(lure.nx + lure.nu, -1)
    Theta = lure.Theta.copy()
    W, E = lure.W, lure.E
    Theta[:, weights] *= b - a
    # nu = (I - E diag(a))^-1 (V [x; u] + E diag(b - a) w_1 + b)
    Theta[n:] = np.linalg.solve(np.eye(lure.nw) - E * a, Theta[n:])
    Theta[:n] += (W * a) @ Theta[n:]
    form = replace(lure, Theta=Theta)
    return part(form, reaching(form, form.nz))


def _blocks(lure, unit=1.0, decay=1.0):
    """Return the maps from [dx; dv; dw] to all differences; y in multiples of unit.

    The first one, to dx, is weighted by the decay.
    """
    nx, nu, nw = lure.nx, lure.nu, lure.nw
    now, v, w = np.split(np.eye(nx + nu + nw), [nx, nx + nu])
    plus, y, neurons = np.split(lure.Theta[:, :-1], [nx, nx + lure.nz])
    return decay * now, plus, v, y / unit, w, neurons - w


def _form(lure, P, Lam, decay):
    """Return the quadratic form (eq. slopes) without its term in gamma."""
    now, plus, _, y, w, slack = _blocks(lure, decay=decay)
    sector = w.T @ (Lam[:, None] * slack)
    return plus.T @ P @ plus - now.T @ P @ now + y.T @ y + sector + sector.T


def _smallest_gamma(lure, P, Lam, decay):
    """Return the gamma that P and Lam prove, by the Schur complement of dv."""
    nx, nu = lure.nx, lure.nu
    form = _form(lure, P, Lam, decay)
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


def _margin(lure, P, Lam, gamma, decay):
    """Return the margin of (eq. slopes), -inf unless P > 0, Lam >= 0, gamma finite."""
    numbers = np.concatenate([P.ravel(), Lam, [gamma]])
    if not np.isfinite(numbers).all() or np.any(Lam < 0) or gamma < 0:
        return -np.inf
    try:
        T = cholesky((P + P.T) / 2)  # P = T'T
    except np.linalg.LinAlgError:
        return -np.inf
    nx, nu = lure.nx, lure.nu
    form = _form(_change(lure, T), np.eye(nx), Lam, decay)
    v = np.arange(nx, nx + nu)
    form[v, v] -= gamma**2
    scale = np.sqrt(np.maximum(-np.diag(form), np.finfo(float).tiny))
    if np.any(np.diag(form) >= 0):
        return float(-np.max(np.diag(form)))
    rounding = 8 * len(form) * np.finfo(float).eps * np.linalg.cond(T)
    return float(-np.linalg.eigvalsh(form / np.outer(scale, scale))[-1] - rounding)


def _certificate(lure, decay, status, reason, seconds=0.0, n_solves=0, found=None):
    """Return the certificate of (P, Lam, gamma) found, or one that does not hold."""
    nothing = np.full((lure.nx, lure.nx), np.nan), np.full(lure.nw, np.nan), np.inf
    P, Lam, gamma = found or nothing
    margin = _margin(lure, P, Lam, gamma, decay)
    numbers = margin, gamma, P, Lam, status, seconds, n_solves
    return GainCertificate(margin > 0, *numbers, reason, lure, decay)

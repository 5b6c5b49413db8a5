"""Quantities that say how linear a model is once h is cancelled.

The paper's figures compare norms in state coordinates, |g| / |A x + B u| and
|h| / |A x + B u|, and their twins of the closed loop u = v - h (eq. loop),

    x+ = A x + B v + omega,     omega = g(x, v - h(s)).

They depend on the basis of the states: training can shrink |g| in directions that a
non-normal A amplifies again on the way to the output.  The output-referred residual
(eq. gauge)

    zeta+ = A zeta + g(x, u),   e = C zeta,     linearization error = rms(e) / rms(y)

does not: e is what g adds to the output, exactly, in any basis; with a feedthrough D
and a nonlinear output k it is e = C zeta + k(x, u) - D h(s).  The same holds for its
parts in frequency bands (eq. bands).  How much the basis hides is told by the
growth of the powers of A and by the H2 norm from g to y (eq. gains).

Everything is computed along simulated trajectories of a Lur'e form with the states
of the plant alone, in the units of its matrices.  Here h is K w + k, whatever it is a
function of, and g is what remains of x+: the code knows neither by name.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgWarning, solve_discrete_lyapunov

from ..lure import Lure
from ..simulation import channels, simulate
from ._record import Bands, Linearizability

N_BANDS = 6  # octaves below the Nyquist frequency; the lowest one reaches down to zero
POWERS = 256  # powers of A whose norms are computed at a time
MAX_BLOCKS = 400  # blocks of powers; about 100,000 samples, longer than any transient


def measure(
    lure, linear, feedback, experiments, *, dt=1.0, region=None, output_names=None
):
    """Measure linearizability along one or several experiments.

    Parameters
    ----------
    lure : Lure
        Model with the states x alone and the input u, both deviations.
    linear : tuple of ndarray
        Matrices A, B, C, D of its linear part, D of shape (ny, nu).
    feedback : tuple of ndarray
        Gain K and constant k of h = K w + k, shapes (nu, nw), (nu,).
    experiments : sequence of tuple of ndarray
        Tuples (u, y, x0) of shapes (N, nu), (N, ny), (nx,): deviations of inputs and
        measured outputs, and the initial state.
    dt : float, default=1.0
        Sampling time, in seconds.
    region : Region or None, default=None
        Region of the training data; None leaves `outside` out.
    output_names : list of str or None, default=None
        Names of the outputs, for the table.

    Returns
    -------
    record : Linearizability
        The measures over all samples of all experiments; inf where a simulation
        diverges.

    Notes
    -----
    Costs four simulations: the model, the closed loop, and the residual of each.
    """
    A, _, C, _ = linear
    opened = [_run(lure, linear, feedback, u, x0) for u, _, x0 in experiments]
    # the closed loop has no h left (eq. loop)
    none = tuple(np.zeros_like(z) for z in feedback)
    try:
        loop = lure.close(*feedback)
    except ValueError:  # an algebraic loop: y depends on u through D or k
        closed = [run.without_solution() for run in opened]
    else:
        closed = [_run(loop, linear, none, v, x0) for v, _, x0 in experiments]
    # what was not measured is taken from the model
    y = [
        np.where(np.isnan(y), run.y, y)
        for (_, y, _), run in zip(experiments, opened, strict=True)
    ]
    e = [run.e for run in opened]

    part = _sizes([run.linear for run in opened])
    ratio_g = _ratios(_sizes([run.g for run in opened]), part)
    ratio_h = _ratios(_sizes([run.h for run in opened]), part)
    closed_part = _sizes([run.linear for run in closed])
    omega = _sizes([run.g for run in closed])
    closed_ratio = _ratios(omega, closed_part)
    with np.errstate(invalid="ignore"):
        y_linear = [run.y - run.e for run in closed]
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    outside = closed_outside = None
    if region is not None:
        outside = _share_outside(region, opened, y)
        unmeasured = [None] * len(closed)
        closed_outside = _share_outside(region, closed, unmeasured, feedback)
    return Linearizability(
        linearization_error=_relative(_squares(e), _squares(y)),
        ratio_g_mean=float(ratio_g.mean()),
        ratio_g_max=float(ratio_g.max()),
        ratio_h_mean=float(ratio_h.mean()),
        ratio_h_max=float(ratio_h.max()),
        spectral_radius=radius,
        closed_linearization_error=_relative(
            _squares([run.e for run in closed]), _squares(y_linear)
        ),
        closed_linear_mean=float(closed_part.mean()),
        closed_linear_max=float(closed_part.max()),
        closed_omega_mean=float(omega.mean()),
        closed_omega_max=float(omega.max()),
        closed_ratio_mean=float(closed_ratio.mean()),
        closed_ratio_max=float(closed_ratio.max()),
        peak_gain=peak_gain(A) if radius < 1 else np.inf,
        h2_gain=h2_gain(A, C) if radius < 1 else np.full(len(C), np.inf),
        outside=outside,
        closed_outside=closed_outside,
        bands=_bands(e, y, dt),
        e=np.vstack(e),
        output_names=output_names,
    )


# -- trajectories ----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Run:
    """Signals along one simulation; not finite where it diverges, e is inf there."""

    X: np.ndarray  # (N, nx)
    u: np.ndarray  # (N, nu): v in the closed loop
    w: np.ndarray  # (N, nw)
    y: np.ndarray  # (N, ny)
    linear: np.ndarray  # (N, nx): A x + B u
    h: np.ndarray  # (N, nu)
    g: np.ndarray  # (N, nx)
    e: np.ndarray  # (N, ny)

    def without_solution(self):
        """Return the run of a loop that has no solution."""
        signals = ("X", "w", "y", "linear", "h", "g", "e")
        infinite = {z: np.full_like(getattr(self, z), np.inf) for z in signals}
        return replace(self, **infinite)


def _run(lure, linear, feedback, u, x0):
    """Simulate and observe [w; y; A x + B u; h; g; k - D h] as channels."""
    (A, B, C, D), (K, k) = linear, feedback
    nx, nu, nw, ny = lure.nx, lure.nu, lure.nw, len(C)
    sizes = [nw, ny, nx, nu, nx, ny]
    Theta = np.zeros((nx + sum(sizes) + nw, nx + nu + nw + 1))
    plus, w_, y_, linear_, h_, g_, k_, v_ = np.split(Theta, np.cumsum([nx, *sizes]))
    plus[:], y_[:], v_[:] = np.split(lure.Theta, [nx, nx + ny])
    w_[:, nx + nu : -1] = np.eye(nw)
    linear_[:, : nx + nu] = np.hstack([A, B])
    h_[:, nx + nu :] = np.column_stack([K, k])
    g_[:] = plus - linear_ - B @ h_
    k_[:] = y_ - D @ h_
    k_[:, : nx + nu] -= np.hstack([C, D])
    observed = Lure(Theta, nx, nu, nw, lure.sigma)
    X = simulate(observed, u, x0)[:-1]
    with np.errstate(over="ignore", invalid="ignore"):
        Z = channels(observed, X, u)
    w, y, part, h, g, k_out = np.split(Z, np.cumsum(sizes[:-1]), axis=1)
    with np.errstate(invalid="ignore"):
        e = output_residual(A, C, g) + k_out
    e = np.where(np.isfinite(e), e, np.inf)
    return _Run(X, u, w, y, part, h, g, e)


def output_residual(A, C, g):
    """Return the part of the output that g makes (eq. gauge).

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    g : ndarray of shape (N, nx)
        Residual nonlinearity along a trajectory.

    Returns
    -------
    e : ndarray of shape (N, ny)
        Output-referred residual; inf where it diverges.
    """
    nx = len(A)
    # a Lur'e form without neurons whose input is g itself
    Theta = np.hstack([A, np.eye(nx), np.zeros((nx, 1))])
    zeta = simulate(Lure(Theta, nx, nx, 0), g, np.zeros(nx))[:-1]
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(zeta).all(axis=1)[:, None], zeta @ C.T, np.inf)


def _share_outside(region, runs, measured, feedback=None):
    """Return the share of samples that leave the region; feedback turns v into u."""
    count = total = 0
    for run, y in zip(runs, measured, strict=True):
        u = run.u
        if feedback is not None:
            with np.errstate(invalid="ignore"):
                u = u - (run.w @ feedback[0].T + feedback[1])
        count += int(region.outside(run.X, u, run.y, y).sum())
        total += len(u)
    return count / total


# -- sizes -----------------------------------------------------------------------------


def _sizes(signals):
    """Return the norm of every sample of all experiments, inf if diverged."""
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.concatenate([np.linalg.norm(z, axis=1) for z in signals])
    return np.where(np.isfinite(sizes), sizes, np.inf)


def _ratios(sizes, part):
    """Return the paper's ratio of every sample."""
    # a sample at rest has no linear part: 0 / 0 is 0
    with np.errstate(over="ignore", invalid="ignore"):
        ratios = sizes / np.maximum(part, np.finfo(float).tiny)
    return np.where(np.isnan(ratios), np.inf, ratios)


def _squares(signals):
    """Return the sum of squares over all experiments, per column, inf if diverged."""
    total = np.sum([np.sum(z**2, axis=0) for z in signals], axis=0)
    return np.where(np.isfinite(total), total, np.inf)


def _relative(square, reference):
    """Return the root of a ratio of sums of squares; 0 / 0 is 0, inf / inf is inf."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(square == 0, 0.0, square / reference)
    return np.sqrt(np.where(np.isfinite(square), ratio, np.inf))


# -- frequency bands -------------------------------------------------------------------


def _bands(e, y, dt):
    """Return what e and y have in every band, relative to all of y (eq. bands)."""
    edges = 0.5 * np.concatenate([[0.0], 2.0 ** np.arange(1 - N_BANDS, 1)])
    total = _squares(y)
    if all(np.isfinite(z).all() for z in e):
        error = _relative(_band_squares(e, edges), total)
    else:
        error = np.full((N_BANDS, len(total)), np.inf)
    return Bands(edges / dt, error, _relative(_band_squares(y, edges), total))


def _band_squares(signals, edges):
    """Return the sum of squares per band, over all experiments, by Parseval.

    A band includes its lower edge, the last one the Nyquist frequency as well.
    """
    squares = np.zeros((len(edges) - 1, signals[0].shape[1]))
    for z in signals:
        N = len(z)
        power = np.abs(np.fft.rfft(z, axis=0)) ** 2 / N  # (N // 2 + 1, ny)
        power[1 : (N + 1) // 2] *= 2  # all but 0 and Nyquist have a conjugate twin
        band = np.searchsorted(edges[1:-1], np.fft.rfftfreq(N), side="right")
        np.add.at(squares, band, power)
    return squares


# -- what the basis hides --------------------------------------------------------------


def peak_gain(A):
    """Return the largest norm of the powers of A (eq. gains).

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix, of spectral radius below one.

    Returns
    -------
    gain : float
        Maximum of ``||A^k||_2`` over k >= 0: at least 1, and 1 for a contraction.

    Notes
    -----
    If ``||A^m|| <= 1`` then no power behind the m-th exceeds all those before it, so
    that the search is finite. It gives up after about 100,000 powers, when the
    spectral radius equals one within 1e-5 or so; the result is then a lower bound.
    """
    first = np.empty((POWERS, *A.shape))  # A^0 ... A^(POWERS - 1)
    first[0] = np.eye(len(A))
    for i in range(1, POWERS):
        first[i] = first[i - 1] @ A
    stride, start, gain = first[-1] @ A, first[0], 1.0
    for _ in range(MAX_BLOCKS):
        norms = np.linalg.norm(first @ start, ord=2, axis=(1, 2))
        gain = max(gain, float(norms.max()))
        start = start @ stride
        if norms[1:].min() <= 1:
            break
    return gain


def h2_gain(A, C):
    """Return the H2 norm from g to every output (eq. gains).

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix, of spectral radius below one.
    C : ndarray of shape (ny, nx)
        Output matrix.

    Returns
    -------
    gain : ndarray of shape (ny,)
        Root mean square of e if the entries of g were independent white noises of
        unit variance, in the units of y; inf if the Lyapunov equation is singular to
        working precision.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", LinAlgWarning)
        try:
            P = solve_discrete_lyapunov(A, np.eye(len(A)))
        except (np.linalg.LinAlgError, LinAlgWarning):
            return np.full(len(C), np.inf)
    return np.sqrt(np.maximum(np.sum((C @ P) * C, axis=1), 0.0))

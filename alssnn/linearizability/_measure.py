"""Quantities that say how linear a model is once h is cancelled.

The paper's figures compare norms in state coordinates, |g| / |A x + B u| and
|h| / |A x + B u|, and their twins of the closed loop u = v - h (eq. loop),

    x+ = A x + B v + omega,     omega = g(x, v - h(s)).

They depend on the basis of the states: training can shrink |g| in directions that a
non-normal A amplifies again on the way to the output.  The output-referred residual
(eq. gauge)

    zeta+ = A zeta + g(x, u),   e = C zeta,     linearization error = rms(e) / std(y)

does not: e is what g adds to the output, exactly, in any basis; with a feedthrough D
and a nonlinear output k it is e = C zeta + eta (eq. eta).  The same holds for its
parts in frequency bands (eq. bands).  How much the basis hides is told by the
growth of the powers of A and by the H2 norm from g to y (eq. gains).

Everything is computed along simulated trajectories of a plant whose inputs have
arrived.  Here g is omega = x+ - A x - B v, and h is v - u, rows of its matrix: the code
knows no network by name.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgWarning, solve_discrete_lyapunov
from scipy.signal import periodogram

from ..lure import Lure
from ..plants import as_plant
from ..simulation import channels, simulate
from ._rate import at_rate
from ._record import Bands, Linearizability

N_BANDS = 6  # octaves below the Nyquist frequency; the lowest one reaches down to zero
POWERS = 256  # powers of A whose norms are computed at a time
MAX_BLOCKS = 400  # blocks of powers; about 100,000 samples, longer than any transient
CLOSED_ERROR = "closed_linearization_error"
MEASURED = ("linear", "omega", "ratio")  # sizes of the closed loop
TINY = np.finfo(float).tiny
CONSTANT = 1e-12  # standard deviation over size of an output that is constant


def measure(plant, records, *, output_names=None, law_dt=None, ahead=False):
    """Measure linearizability along one or several experiments.

    Parameters
    ----------
    plant : estimator or Plant
        Fitted model.
    records : sequence of PreparedRecord
        Experiments, of which `du`, `dy` and `x0` count: deviations of the inputs that
        have arrived and of the measured outputs, and the initial state.
    output_names : list of str or None, default=None
        Names of the outputs, for the table.
    law_dt : float or None, default=None
        Sampling time at which the law runs, in seconds, of a plant in continuous time;
        None is that of the records.
    ahead : bool, default=False
        Whether the law looks ahead (`Plant.at`).

    Returns
    -------
    record : Linearizability
        The measures over all samples of all experiments; inf where a simulation
        diverges, nan in the closed loop of a plant without a law.

    Notes
    -----
    Costs four simulations: the model, the closed loop, and the residual of each.
    """
    plant = as_plant(plant)
    if law_dt is not None or ahead or plant.rates is not None:
        plant, records = at_rate(plant, records, law_dt or plant.dt, ahead)
    is_sampled = plant.rates is not None or plant.looks_ahead
    plant = plant.arrived()
    A, _, C, _ = plant.linear()
    u = [record.du for record in records]
    opened = [_run(plant, record, record.du) for record in records]
    closed, v = opened, u
    if plant.cancels and not plant.no_law:
        loop, v = plant.close(), _virtual_inputs(plant, u, opened)
        closed = [_run(plant, *pair, loop) for pair in zip(records, v, strict=True)]
    # what was not measured is taken from the model
    y = [
        np.where(np.isnan(record.dy), run.y, record.dy)
        for record, run in zip(records, opened, strict=True)
    ]
    e = [run.e for run in opened]
    floor = (CONSTANT * np.abs(plant.y_offset)) ** 2
    spread = _variation(y, floor)
    part = _sizes([run.linear for run in opened])
    ratio_g = _ratios(_sizes([run.g for run in opened]), part)
    ratio_h = _ratios(_sizes([run.h for run in opened]), part)
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    return Linearizability(
        linearization_error=_relative(_squares(e), spread),
        ratio_g_mean=float(ratio_g.mean()),
        ratio_g_max=float(ratio_g.max()),
        ratio_h_mean=float(ratio_h.mean()),
        ratio_h_max=float(ratio_h.max()),
        spectral_radius=radius,
        **_closed_measures(plant, closed, u, spread),
        peak_gain=peak_gain(A) if radius < 1 else np.inf,
        h2_gain=h2_gain(A, C) if radius < 1 else np.full(len(C), np.inf),
        outside=_share_outside(plant.region, opened, y),
        bands=_bands(e, y, spread, plant.dt),
        e=np.vstack(e),
        output_names=output_names,
        no_law=plant.no_law,
        law_size=_law_size([run.h for run in opened], u, plant),
        has_disturbances=bool(plant.nd),
        is_sampled=is_sampled,
        is_mapped=plant.cancels and not plant.law_map.is_sum,
    )


def _closed_measures(plant, runs, u, spread):
    """Return the measures of the loop u = v - h, nan if there is none."""
    names = [f"closed_{z}_{of}" for z in MEASURED for of in ("mean", "max")]
    if plant.no_law:
        unknown = np.full(plant.ny, np.nan)
        rest = dict.fromkeys([*names, "closed_law_size"], np.nan)
        per_output = {CLOSED_ERROR: unknown, "closed_output_size": unknown}
        return {**per_output, **rest, "closed_outside": None}
    part, omega = _sizes([run.linear for run in runs]), _sizes([run.g for run in runs])
    sizes = (part, omega, _ratios(omega, part))
    numbers = [float(of(z)) for z in sizes for of in (np.mean, np.max)]
    with np.errstate(invalid="ignore"):
        y_linear = [run.y - run.e for run in runs]
        designed = _variation(y_linear)
    return {
        CLOSED_ERROR: _relative(_squares([run.e for run in runs]), designed),
        "closed_output_size": _relative(designed, spread),
        "closed_law_size": _law_size([run.h for run in runs], u, plant),
        **dict(zip(names, numbers, strict=True)),
        "closed_outside": _share_outside(plant.region, runs, [None] * len(runs)),
    }


# -- trajectories ----------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Run:
    """Signals along one simulation; not finite where it diverges, e is inf there."""

    X: np.ndarray  # (N, nx)
    u: np.ndarray  # (N, nu)
    y: np.ndarray  # (N, ny)
    linear: np.ndarray  # (N, nx): A x + B u + G d, of the closed loop with v for u
    h: np.ndarray  # (N, nv)
    g: np.ndarray  # (N, nx)
    e: np.ndarray  # (N, ny)


def _virtual_inputs(plant, u, opened):
    """Return v of the loops to judge: the recorded input, or one of its shape.

    v = phi(u, s) has a size of its own, and the recorded input is brought to the mean
    and standard deviation that v had along the record (eq. inverse).
    """
    if plant.law_map.is_sum:
        return u
    moved = plant.moved
    every_u = np.vstack(u)[:, moved]
    every_v = every_u + np.vstack([run.h for run in opened])
    spread = every_u.std(axis=0)
    # what only rounding moves is at rest
    moves = spread > CONSTANT * np.abs(every_u + plant.v_offset).max(axis=0)
    gain = np.where(moves, every_v.std(axis=0) / np.maximum(spread, TINY), 1.0)
    mean_u, mean_v = every_u.mean(axis=0), every_v.mean(axis=0)
    made = [du.copy() for du in u]  # disturbances are what they were
    for dv in made:
        dv[:, moved] = mean_v + gain * (dv[:, moved] - mean_u)
    return made


def _run(plant, record, driven, loop=None):
    """Simulate the plant, or its loop with an input v, and observe it."""
    A, B, C, _ = plant.linear()
    by_input = plant.every_input(B, plant.disturbed_by()[0])
    u = driven
    form, ny, nv = plant.observed, plant.ny, plant.nv
    X = simulate(loop or form, driven, record.x0, plant.x_scale)[:-1]
    with np.errstate(over="ignore", invalid="ignore"):
        if loop is not None:
            u = channels(loop, X, driven)[:, ny:]
        Z = channels(form, X, u)
        Z[:, ~form.rows_z.any(axis=1)] = 0.0  # also where the states diverge
        y, v, g, eta = np.split(Z, np.cumsum([ny, nv, plant.nx]), axis=1)
        e = output_residual(A, C, g, plant.x_scale) + eta
        linear, h = X @ A.T + driven @ by_input.T, v - u[:, plant.moved]
        h = h if plant.cancels else np.zeros_like(h)
    return _Run(X, u, y, linear, h, g, np.where(np.isfinite(e), e, np.inf))


def output_residual(A, C, g, size=1.0):
    """Return the part of the output that g makes (eq. gauge).

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    g : ndarray of shape (N, nx)
        Residual nonlinearity along a trajectory.
    size : float or ndarray of shape (nx,), default=1.0
        Usual size of the states.

    Returns
    -------
    e : ndarray of shape (N, ny)
        Output-referred residual; inf where it diverges.
    """
    nx = len(A)
    # a Lur'e form without neurons whose input is g itself
    Theta = np.hstack([A, np.eye(nx), np.zeros((nx, 1))])
    zeta = simulate(Lure(Theta, nx, nx, 0), g, np.zeros(nx), size)[:-1]
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(zeta).all(axis=1)[:, None], zeta @ C.T, np.inf)


def _share_outside(region, runs, measured):
    """Return the share of samples that leave the region, None if it is not known."""
    if region is None:
        return None
    outside = [
        region.outside(run.X, run.u, run.y, y)
        for run, y in zip(runs, measured, strict=True)
    ]
    return float(np.concatenate(outside).mean())


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
        ratios = sizes / np.maximum(part, TINY)
    return np.where(np.isnan(ratios), np.inf, ratios)


def _squares(signals):
    """Return the sum of squares over all experiments, per column, inf if diverged."""
    total = np.sum([np.sum(z**2, axis=0) for z in signals], axis=0)
    return np.where(np.isfinite(total), total, np.inf)


def _variation(signals, floor=0.0):
    """Return the sum of squares about the mean over all experiments, per column."""
    every = np.vstack(signals)
    with np.errstate(over="ignore", invalid="ignore"):
        mean = every.mean(axis=0)
        total = np.sum((every - mean) ** 2, axis=0)
    # what rounding leaves of a constant is no size to compare with
    least = len(every) * np.maximum(floor, (CONSTANT * mean) ** 2)
    return np.where(np.isfinite(total), np.where(total > least, total, 0.0), np.inf)


def _law_size(h, u, plant):
    """Return the largest std(h) / std(u) over the inputs; inf if h diverges."""
    u = [du[:, plant.moved] for du in u]
    std_u = np.sqrt(_variation(u) / sum(map(len, u)))
    std_u = np.where(std_u > 0, std_u, plant.v_scale)
    std_h = np.sqrt(_variation(h) / sum(map(len, h)))
    return float(np.max(std_h / std_u))


def _relative(square, reference):
    """Return the root of a ratio of sums of squares; 0 / 0 is 0, inf / inf is inf."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(square == 0, 0.0, square / reference)
    return np.sqrt(np.where(np.isfinite(square), ratio, np.inf))


# -- frequency bands -------------------------------------------------------------------


def _bands(e, y, total, dt):
    """Return what e and y have in every band, relative to all of y (eq. bands)."""
    edges = 0.5 * np.concatenate([[0.0], 2.0 ** np.arange(1 - N_BANDS, 1)])
    mean = np.vstack(y).mean(axis=0)
    varying = [np.where(total > 0, z - mean, 0.0) for z in y]
    if all(np.isfinite(z).all() for z in e):
        error = _relative(_band_squares(e, edges), total)
    else:
        error = np.full((N_BANDS, len(total)), np.inf)
    return Bands(edges / dt, error, _relative(_band_squares(varying, edges), total))


def _band_squares(signals, edges):
    """Return the sum of squares per band, over all experiments, by Parseval.

    A band includes its lower edge, the last one the Nyquist frequency as well.
    """
    squares = np.zeros((len(edges) - 1, signals[0].shape[1]))
    for z in signals:
        frequency, power = periodogram(z, detrend=False, scaling="spectrum", axis=0)
        band = np.searchsorted(edges[1:-1], frequency, side="right")
        np.add.at(squares, band, len(z) * power)
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

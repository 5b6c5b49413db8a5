"""Units of records for a tube: simulated, cut, measured, scored (eq. tube).

A unit is an experiment, or a block of one.  The autocorrelation tells how long a block
has to be, and how far from the next, to be nearly independent of it.
"""

from math import ceil
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from ..checks import is_count
from ..experiments import is_list_of_records
from ..region import independent_samples
from ..simulation import outputs

LENGTH = 4  # block over the samples that are as good as one independent sample
GAP = 2  # gap over the same: correlation there is e^-4 if it decays exponentially
SHORTEST = 10  # samples of a block, by default
PART = 4  # every fourth unit fits the scale
PER_COEFFICIENT = 2  # units that the scale takes for each of its coefficients
LEAST_SCALE = 0.1  # over the median error: how small errors may be held for sure
ROUNDING = 1e-9  # of (n + 1) level, which may be an integer


class Run(NamedTuple):
    """Hold one experiment, and what a model says of it.

    Parameters
    ----------
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N, ny)
        Outputs; nan where not measured.
    y_hat : ndarray of shape (N, ny)
        What the model says.
    start : int
        First sample that counts.
    """

    u: np.ndarray
    y: np.ndarray
    y_hat: np.ndarray
    start: int


def simulated_runs(model, u, y, experiment, horizon, x0=None):
    """Return every experiment with what a model says of it.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs.
    y : array_like of shape (N,) or (N, ny), list of them, or None
        Outputs; None simulates without any.
    experiment : array_like of shape (N,) or None
        Label of the experiment of every sample.
    horizon : int or None
        Samples that are predicted ahead; None is the free run.
    x0 : array_like of shape (nx,) or (n_experiments, nx), or None, default=None
        Initial states; None estimates them from the first samples.

    Returns
    -------
    runs : list of Run
        One per experiment; `y_hat` is not finite where a simulation diverges.

    Raises
    ------
    ValueError
        If the data do not fit the model.
    """
    ny = len(model.y_offset_)
    if y is None:
        listed = is_list_of_records(u)
        blank = [np.full((len(z), ny), np.nan) for z in (u if listed else [u])]
        y = blank if listed else blank[0]
    records = model.prepare_records(u, y, experiment)
    starts = _starts(model, records, x0)
    if horizon is not None:
        ahead = model.predict_ahead(u, y, horizon, experiment, x0=starts)
        ahead = np.concatenate(ahead) if isinstance(ahead, list) else ahead
        ahead = np.asarray(ahead).reshape(-1, ny)
    fit, runs = model.fitted_, []
    lure = fit.structure.observe(fit.structure.measured).lure(fit.theta)
    for record, start in zip(records, starts, strict=True):
        first = record.start
        if horizon is None:
            y_hat = outputs(lure, record.u_s, start / fit.x_scale)
            y_hat = y_hat * fit.scaling.y_scale + fit.scaling.y_offset
        else:  # what is predicted from no output is no prediction
            y_hat, first = ahead[record.part], max(first, int(horizon))
        runs.append(Run(record.u, record.y, y_hat, first))
    return runs


def _starts(model, records, x0):
    """Return the initial state of every experiment."""
    if x0 is None:
        return np.vstack([record.x0 for record in records])
    x0, shape = np.asarray(x0, dtype=float), (len(records), model.nx_)
    if x0.shape not in (shape, shape[1:]) or not np.isfinite(x0).all():
        raise ValueError(
            f"`x0` must be finite, of shape {shape[1:]} or {shape}, got shape "
            f"{x0.shape}. Use `estimate_x0`."
        )
    return np.broadcast_to(x0, shape)


def lengths(runs, level, block, gap):
    """Return the length of a unit and of the gaps between units.

    Parameters
    ----------
    runs : list of Run
        Experiments.
    level : float
        Share of units that shall stay in the tube.
    block : {"auto", "experiment"} or int
        What a unit is.
    gap : int or None
        Samples between blocks; None takes what the autocorrelation tells.

    Returns
    -------
    block : int or None
        Samples of a block; None means that the units are the experiments.
    gap : int
        Samples between blocks.
    """
    usable = sum(len(run.u) > run.start for run in runs)
    if block == "experiment" or (block == "auto" and usable >= least_units(level)):
        return None, 0
    span = 1.0  # samples that are as good as one independent one
    for run in runs:
        with np.errstate(invalid="ignore"):
            e = (run.y - run.y_hat)[run.start :]
        e = np.where(np.isfinite(e), e, 0.0)
        # a size that comes and goes makes moduli alike where errors are not
        seen = independent_samples(np.hstack([e, np.abs(e)]))
        span = max(span, len(e) / max(seen, 1.0))
    if block == "auto":
        block = max(SHORTEST, ceil(LENGTH * span))
    return int(block), int(ceil(GAP * span) if gap is None else gap)


def cut(run, part):
    """Return some samples of a run, all of which count.

    Parameters
    ----------
    run : Run
        Experiment.
    part : slice
        Samples.

    Returns
    -------
    run : Run
        These samples.
    """
    return Run(run.u[part], run.y[part], run.y_hat[part], 0)


def units_of(runs, block, gap):
    """Return the units of experiments: all that counts, or blocks with gaps.

    Parameters
    ----------
    runs : list of Run
        Experiments.
    block : int or None
        Samples of a block; None means whole experiments.
    gap : int
        Samples between blocks.

    Returns
    -------
    units : list of Run
        The units, in order of time.
    """
    units = []
    for run in runs:
        if block is None:
            if len(run.u) > run.start:
                units.append(cut(run, slice(run.start, None)))
            continue
        for begin in range(run.start, len(run.u) - block + 1, block + gap):
            units.append(cut(run, slice(begin, begin + block)))
    return units


def measure(units, u_offset, y_offset):
    """Return the largest errors of units, and what the scale is made of.

    Parameters
    ----------
    units : list of Run
        Units.
    u_offset : ndarray of shape (nu,)
        Operating point of the inputs.
    y_offset : ndarray of shape (ny,)
        That of the outputs.

    Returns
    -------
    errors : ndarray of shape (n, ny)
        Largest modulus; nan where nothing was measured, inf where a run diverges.
    sizes : ndarray of shape (n, ny, nu + 2)
        One, and root mean squares of the output of the model and of every input.
    """
    ny, nu = len(y_offset), len(u_offset)
    errors, sizes = np.empty((len(units), ny)), np.empty((len(units), ny, nu + 2))
    for i, unit in enumerate(units):
        with np.errstate(invalid="ignore", over="ignore"):
            e = np.abs(unit.y - unit.y_hat)
            y_size = np.sqrt(np.mean((unit.y_hat - y_offset) ** 2, axis=0))
        known = ~np.isnan(unit.y)
        e[known & ~np.isfinite(e)] = np.inf  # where the simulation diverges
        errors[i] = np.where(known, e, -np.inf).max(axis=0)
        errors[i, ~known.any(axis=0)] = np.nan
        u_size = np.sqrt(np.mean((unit.u - u_offset) ** 2, axis=0))
        sizes[i, :, 0], sizes[i, :, 1], sizes[i, :, 2:] = 1.0, y_size, u_size
    return errors, sizes


def scale(sizes, coefficients):
    """Return the scale of units, per output (eq. tube).

    Parameters
    ----------
    sizes : ndarray of shape (n, ny, nu + 2)
        See `measure`.
    coefficients : ndarray of shape (ny, nu + 2)
        See `fit_scale`.

    Returns
    -------
    scale : ndarray of shape (n, ny)
        What errors are divided by.
    """
    return np.einsum("nik,ik->ni", sizes, coefficients)


def scores_of(errors, sizes, coefficients):
    """Return errors over their scales.

    Parameters
    ----------
    errors : ndarray of shape (n, ny)
        See `measure`.
    sizes : ndarray of shape (n, ny, nu + 2)
        See `measure`.
    coefficients : ndarray of shape (ny, nu + 2)
        See `fit_scale`.

    Returns
    -------
    scores : ndarray of shape (n, ny)
        Scores; nan where nothing was measured, inf where a simulation diverges.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        scores = errors / scale(sizes, coefficients)
    return np.where(np.isnan(scores) & ~np.isnan(errors), np.inf, scores)


def fit_scale(errors, sizes, level):
    """Fit the scale to every fourth unit, if the others are enough for the level.

    Nonnegative least squares, then once more with relative residuals. The constant is
    at least a tenth of the median error: a scale of zero would make any error large.

    Parameters
    ----------
    errors : ndarray of shape (n, ny)
        See `measure`.
    sizes : ndarray of shape (n, ny, nu + 2)
        See `measure`.
    level : float
        Share of units that shall stay in the tube.

    Returns
    -------
    fits : ndarray of bool of shape (n,)
        Which units fitted the scale.
    coefficients : ndarray of shape (ny, nu + 2)
        Nonnegative; 1, 0, ... where too few units tell.
    """
    n, ny, m = sizes.shape
    fits = np.arange(n) % PART == 0
    coefficients = np.zeros((ny, m))
    coefficients[:, 0] = 1.0  # the same width for all
    if fits.sum() < PER_COEFFICIENT * m or (~fits).sum() < least_units(level):
        return np.zeros(n, dtype=bool), coefficients
    for i in range(ny):
        e, s = errors[fits, i], sizes[fits, i]
        good = np.isfinite(e) & np.isfinite(s).all(axis=1)
        e, s = e[good], s[good]
        if len(e) < PER_COEFFICIENT * m or not e.any():
            continue
        least = LEAST_SCALE * np.median(e)
        weight = np.ones(len(e))
        for _ in range(2):
            found, _ = nnls(s * weight[:, None], e * weight)
            weight = 1.0 / np.maximum(s @ found, max(least, np.finfo(float).tiny))
        found[0] = max(found[0], least)
        if found[0] > 0:
            coefficients[i] = found
    return fits, coefficients


def rank(n, level):
    """Return which score is the quantile (eq. tube).

    Parameters
    ----------
    n : int
        Number of scores.
    level : float
        Level.

    Returns
    -------
    rank : int
        From 1; beyond n, no score is.
    """
    return ceil((n + 1) * level - ROUNDING)


def least_units(level):
    """Return the least number of units that make a tube finite.

    Parameters
    ----------
    level : float
        Level.

    Returns
    -------
    n : int
        The number.
    """
    return ceil(level / (1 - level) - ROUNDING)


def conformal_quantile(scores, level):
    """Return the quantile of scores that a fresh one keeps (eq. tube).

    Parameters
    ----------
    scores : ndarray of shape (n,)
        Scores; nan does not count.
    level : float
        Probability with which it is kept.

    Returns
    -------
    quantile : float
        The ceil((n + 1) level)-th smallest score; inf if there are fewer.
    """
    scores = np.sort(scores[~np.isnan(scores)])
    k = rank(len(scores), level)  # (eq. tube)
    return float(scores[k - 1]) if k <= len(scores) else np.inf


def units_in_words(block):
    """Return what units are.

    Parameters
    ----------
    block : int or None
        Samples of a unit; None means whole experiments.

    Returns
    -------
    words : str
        More than one of them.
    """
    return "experiments" if block is None else f"blocks of {block} samples"


def no_quantile(quantile, n, level, block):
    """Return why a quantile is infinite.

    Parameters
    ----------
    quantile : ndarray of shape (ny,)
        Quantiles.
    n : ndarray of shape (ny,)
        Units of each.
    level : float
        Share of units that keep it.
    block : int or None
        Samples of a unit; None means whole experiments.

    Returns
    -------
    reason : str
        The reason; empty if it is finite.
    """
    if np.isfinite(quantile).all():
        return ""
    few, unit = n.min(), units_in_words(block)
    if few < least_units(level):
        remedy = "or shorter `block`s" if block is not None else "or `block='auto'`"
        return (
            f"{few} {unit} are too few for the level {level:.4g}, which takes "
            f"{least_units(level)}. Lower `level`, or give more records {remedy}."
        )
    return (
        f"The simulation diverges in more than {1 - level:.4g} of {few} {unit}. "
        "Stay where the model was trained, or take a `horizon`."
    )


def check_units(level, horizon, block, gap):
    """Say what is wrong with the arguments of a calibration.

    Parameters
    ----------
    level : float
        Share of units.
    horizon : int or None
        Samples ahead.
    block : {"auto", "experiment"} or int
        What a unit is.
    gap : int or None
        Samples between blocks.

    Raises
    ------
    ValueError
        If one is out of range.
    """
    if not isinstance(level, float | int | np.floating) or not 0 < level < 1:
        raise ValueError(
            f"`level` must be between 0 and 1, got {level!r}. 0.9 is nine of ten."
        )
    if block not in ("auto", "experiment") and not is_count(block, 1):
        raise ValueError(
            "`block` must be 'auto', 'experiment' or a positive number of samples, "
            f"got {block!r}. Choose one."
        )
    for name, value, least in (("horizon", horizon, 1), ("gap", gap, 0)):
        if value is not None and not is_count(value, least):
            raise ValueError(
                f"`{name}` must be an integer of at least {least} or None, got "
                f"{value!r}. It counts samples."
            )

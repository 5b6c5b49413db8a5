"""What repeats in a record: periods and their mean, and inputs sent more than once."""

import warnings
from typing import NamedTuple

import numpy as np

from .checks import is_count

LEAST = 4  # samples of a period
BLOCKS = 16  # of a first period, whose last ones may count
APERIODIC = 0.1  # share of the power of u by which periods may differ: noise
ALIKE = 1e-6  # the same of experiments that had one input: rounding, no feedback
TWICE = 20  # samples that two of them have in common, at least


class Periods(NamedTuple):
    """Hold the mean period of every experiment.

    Parameters
    ----------
    u : ndarray of shape (N, nu)
        Inputs, one period per experiment below each other.
    y : ndarray of shape (N,) or (N, ny)
        Outputs; nan where no period has a value.
    parts : list of slice
        Samples of every experiment.
    lost : ndarray of shape (ny, ny)
        Covariance of the noise of a single period minus that of the means.
    """

    u: np.ndarray
    y: np.ndarray
    parts: list
    lost: np.ndarray


def mean_periods(u, y, parts, period):
    """Return the mean over the periods of every experiment.

    Parameters
    ----------
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N,) or (N, ny)
        Outputs; nan where not measured.
    parts : list of slice
        Samples of every experiment.
    period : int or None
        Samples of a period; None means that every experiment is one settled period. Of
        several periods the first is left out, while the plant settles: as far as that
        takes, if the others tell the noise (eq. settled).

    Returns
    -------
    periods : Periods
        The means.

    Raises
    ------
    ValueError
        If an experiment has no whole periods, or its inputs do not repeat themselves.
    """
    if period is not None and not is_count(period, LEAST):
        raise ValueError(
            f"`period` must be the samples of a period, an integer of at least {LEAST},"
            f" or None, got {period!r}."
        )
    columns = y.reshape(len(y), -1)
    inputs, outputs, stops = [], [], [0]
    lost = np.zeros((columns.shape[1],) * 2)
    count = np.zeros_like(lost)
    for i, part in enumerate(parts):
        length = part.stop - part.start
        n = length if period is None else int(period)
        if length % n:
            raise ValueError(
                f"`period` must divide the samples of every experiment, got {period} "
                f"for {length} samples of experiment {i}. Cut the record to whole "
                "periods."
            )
        u_p, y_p = (z[part].reshape(-1, n, z.shape[1]) for z in (u, columns))
        (first_u, u_p), (first, y_p) = ((z[:1], z[length > n :]) for z in (u_p, y_p))
        mean = u_p.mean(axis=0)
        spread = np.mean((u_p - u_p.mean((0, 1))) ** 2, axis=(0, 1))
        if np.any(np.mean((u_p - mean) ** 2, axis=(0, 1)) > APERIODIC * spread):
            raise ValueError(
                f"`u` must repeat itself after `period` = {n} samples, got periods of "
                f"experiment {i} that differ. Check `period`, or take "
                "initial_state='estimate'."
            )
        if len(y_p) > 1:
            late = first.copy()
            late[0, : _settles(first_u[0], first[0], u_p, y_p)] = np.nan
            y_p = np.concatenate([y_p, late])
        seen = ~np.isnan(y_p)
        total = seen.sum(axis=0)
        y_mean = np.where(seen, y_p, 0.0).sum(axis=0) / np.maximum(total, 1)
        error = np.where(seen, y_p - y_mean, 0.0)
        # of a single period, unbiased, less what is left of it in the mean
        joint = np.einsum("pki,pkj->kij", seen, seen, dtype=float)
        products = np.einsum("pki,pkj->kij", error, error)
        lost += np.sum(products / np.maximum(joint, 1.0), axis=0)
        count += np.sum(joint > 0, axis=0)
        inputs.append(mean)
        outputs.append(np.where(total > 0, y_mean, np.nan))
        stops.append(stops[-1] + n)
    return Periods(
        np.concatenate(inputs),
        np.concatenate(outputs).reshape(-1, *y.shape[1:]),
        list(map(slice, stops[:-1], stops[1:])),
        lost / np.maximum(count, 1.0),
    )


def _settles(u, y, u_later, y_later):
    """Return the sample of a first period from which it is like the later ones.

    From the end, blocks count as long as they differ from the mean of the others by no
    more than twice the noise: then their transient adds less to the mean square error
    of the mean than their noise takes from it (eq. settled).
    """
    n, P = len(y), len(y_later)
    mean = u_later.mean(axis=0)
    if np.any(np.mean((u - mean) ** 2, axis=0) > APERIODIC * mean.var(axis=0)):
        return n
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of samples without a value
        noise = np.nanmean(np.nanvar(y_later, axis=0, ddof=1), axis=0)  # (ny,)
        square = (y - np.nanmean(y_later, axis=0)) ** 2 / (1 + 1 / P)
        edges = np.linspace(0, n, min(BLOCKS, n) + 1).astype(int)
        for start, stop in zip(edges[-2::-1], edges[:0:-1], strict=True):
            moved = np.nanmean(square[start:stop], axis=0)
            if not np.all(np.isnan(moved) | (moved <= 2 * noise)):
                return stop
    return 0


def repeated(inputs, tolerance=ALIKE):
    """Return which experiments had the same input.

    Parameters
    ----------
    inputs : sequence of ndarray of shape (N_i, nu)
        Inputs of the experiments; a shorter one is compared as far as it goes.
    tolerance : float, default=1e-6
        Share of the power of an input by which they may differ.

    Returns
    -------
    groups : list of list of int
        Experiments of every input, in order of appearance; of most, a single one.
    """
    groups: list[list[int]] = []
    for i, u in enumerate(inputs):
        for group in groups:
            if _is_same(inputs[group[0]], u, tolerance):
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def _is_same(a, b, tolerance):
    """Tell whether two inputs are one, which moves."""
    n = min(len(a), len(b))
    a, b = a[:n], b[:n]
    power = a.var(axis=0)
    differs = np.mean((a - b) ** 2, axis=0) > tolerance * power
    return n >= TWICE and bool(np.any(power > 0) and not differs.any())

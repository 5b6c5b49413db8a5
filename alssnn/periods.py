"""Periods of a record: their mean, and the noise that it leaves out."""

from typing import NamedTuple

import numpy as np

from .checks import is_count

LEAST = 4  # samples of a period
APERIODIC = 0.1  # share of the power of u by which periods may differ: noise


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
        several periods the first is left out, while the plant settles.

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
        settled = slice(int(length > n), None)
        u_p, y_p = (z[part].reshape(-1, n, z.shape[1])[settled] for z in (u, columns))
        mean = u_p.mean(axis=0)
        spread = np.mean((u_p - u_p.mean((0, 1))) ** 2, axis=(0, 1))
        if np.any(np.mean((u_p - mean) ** 2, axis=(0, 1)) > APERIODIC * spread):
            raise ValueError(
                f"`u` must repeat itself after `period` = {n} samples, got periods of "
                f"experiment {i} that differ. Check `period`, or take "
                "initial_state='estimate'."
            )
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

"""Records at another rate, and without the drift of a sensor."""

from fractions import Fraction

import numpy as np
from scipy.signal import detrend, resample_poly

MOST = 1000  # of the numbers whose ratio is that of two rates


def at_rate(signal, up, down):
    """Return a signal at up / down times its rate, without aliases or delay.

    Parameters
    ----------
    signal : ndarray of shape (N, n)
        Signal.
    up, down : int
        Ratio of the rates.

    Returns
    -------
    signal : ndarray of shape (ceil(N up / down), n)
        What a low-pass filter of linear phase leaves of it; the line through its ends
        goes round the filter.
    """
    return resample_poly(signal, up, down, axis=0, padtype="line")


def ratio(dt, new):
    """Return the ratio of two rates as integers.

    Parameters
    ----------
    dt, new : float
        Sampling times.

    Returns
    -------
    up, down : int
        The new rate is up / down times the old one.

    Raises
    ------
    ValueError
        If the sampling times have no ratio of small numbers.
    """
    found = Fraction(min(dt / new, 2.0 * MOST)).limit_denominator(MOST)
    if not 0 < found <= MOST or abs(float(found) * new / dt - 1) > 1e-8:
        raise ValueError(
            f"`dt` must have a ratio of whole numbers up to {MOST} to {dt:g} s, the "
            f"sampling time of the record, got {new:g}. Take a rounder one."
        )
    return found.numerator, found.denominator


def without_line(signal):
    """Return a signal without its linear trend, its mean kept.

    Parameters
    ----------
    signal : ndarray of shape (N, n)
        Signal; nan where not measured.

    Returns
    -------
    signal : ndarray of shape (N, n)
        The deviations from the line of least squares, plus the mean.
    """
    level = detrended = np.array(signal, dtype=float)
    known = np.isfinite(signal)
    if known.all():
        return detrend(detrended, axis=0) + level.mean(axis=0)
    k = np.linspace(-1.0, 1.0, len(signal))
    for i, seen in enumerate(known.T):
        if seen.sum() > 1:
            line = np.polynomial.Polynomial.fit(k[seen], signal[seen, i], 1)
            detrended[:, i] += signal[seen, i].mean() - line(k)
    return detrended

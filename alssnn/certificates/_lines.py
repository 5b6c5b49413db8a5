"""Neurons as lines: sigma(nu) = s nu + m + delta with |delta| <= d over an interval.

An interval is cut into pieces.  At their ends sigma is known; in between a remainder
whose derivative lies in [p, q] stays below the point where a line of slope q from the
left end and one of slope p from the right end meet, and above its mirror image.
"""

import numpy as np

THIN = 1e-14  # ranges of slopes that count as none


def lines(activation, low, high, pieces=2, slopes=1):
    """Return the lines of one activation over intervals.

    Parameters
    ----------
    activation : Activation
        The activation.
    low, high : ndarray
        Ends of the intervals, of one shape.
    pieces : int, default=2
        Pieces of every interval; more of them tighten d.
    slopes : int, default=1
        Slopes that are tried: 1 takes that of the chord, more take the one with the
        least d.

    Returns
    -------
    s, m, d : ndarray
        Slope, offset and largest remainder, of the same shape.
    """
    nu = low[..., None] + (high - low)[..., None] * np.linspace(0.0, 1.0, pieces + 1)
    w = activation.value(nu)
    least, largest = activation.slopes(nu[..., :-1], nu[..., 1:])
    width = high - low
    chord = np.where(
        width > 0, (w[..., -1] - w[..., 0]) / np.where(width > 0, width, 1.0), 0.0
    )
    best = _remainder(nu, w, least, largest, chord)
    bottom, top = least.min(axis=-1), largest.max(axis=-1)
    for share in np.linspace(0.0, 1.0, slopes) if slopes > 1 else ():
        tried = _remainder(nu, w, least, largest, bottom + share * (top - bottom))
        better = tried[2] < best[2]
        best = tuple(np.where(better, a, b) for a, b in zip(tried, best, strict=True))
    return best


def chords(activation, about, low, high, pieces=64):
    """Return the least and the largest chord from a point to those of an interval.

    The chord from c to nu is the mean of the derivative in between.

    Parameters
    ----------
    activation : Activation
        The activation.
    about : ndarray
        One end of the chords.
    low, high : ndarray
        Interval of the other end, of the same shape, which holds `about`.
    pieces : int, default=64
        Pieces on either side; more of them tighten the range.

    Returns
    -------
    least, largest : ndarray
        Range of ``(sigma(nu) - sigma(about)) / (nu - about)``.
    """
    way = np.stack([low, high]) - about  # to either side
    nu = about[..., None] + way[..., None] * np.linspace(0, 1, pieces + 1)
    slopes = activation.slopes(*np.sort([nu[..., :-1], nu[..., 1:]], axis=0))
    means = np.cumsum(slopes, axis=-1) / np.arange(1, pieces + 1)
    least, largest = means[0].min(axis=(0, -1)), means[1].max(axis=(0, -1))
    rounding = 8 * pieces * np.finfo(float).eps
    return least - rounding * np.abs(least), largest + rounding * np.abs(largest)


def _remainder(nu, w, least, largest, s):
    """Return s, m and d of lines of given slopes."""
    s_ = s[..., None]
    e, h = w - s_ * nu, np.diff(nu)
    p, q, rise = least - s_, largest - s_, np.diff(e)
    spread = q - p
    curved = spread > THIN
    spread = np.where(curved, spread, 1.0)
    up = np.where(curved, q * np.clip((rise - p * h) / spread, 0.0, h), 0.0)
    down = np.where(curved, p * np.clip((q * h - rise) / spread, 0.0, h), 0.0)
    ends = np.maximum(e[..., :-1], e[..., 1:]), np.minimum(e[..., :-1], e[..., 1:])
    up = np.maximum(e[..., :-1] + up, ends[0]).max(axis=-1)
    down = np.minimum(e[..., :-1] + down, ends[1]).min(axis=-1)
    rounding = 4 * np.finfo(float).eps * (np.abs(w).max(-1) + np.abs(s * nu[..., -1]))
    return s, (up + down) / 2, (up - down) / 2 + rounding

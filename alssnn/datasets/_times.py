"""Times of samples: seconds, dates with or without a zone, or text."""

import numpy as np


def as_times(t, name):
    """Return times as floats, or as dates of numpy.

    Parameters
    ----------
    t : array_like of shape (n,)
        Times in seconds, dates or durations; dates may be text, or have a zone.
    name : str
        Name of the argument.

    Returns
    -------
    t : ndarray of shape (n,)
        The times, dates in UTC.

    Raises
    ------
    ValueError
        If they are no times, or one is missing.
    """
    t = np.asarray(t)
    if t.dtype == object or t.dtype.kind in "US":
        try:
            t = t.astype(float)
        except (TypeError, ValueError):  # dates with a zone, or as text
            t = _dates(t, name)
    if t.dtype.kind in "iuf":
        t = t.astype(float)
    elif t.dtype.kind not in "Mm":
        raise ValueError(
            f"`{name}` must be times in seconds or dates, got {t.dtype}. Convert them."
        )
    lost = ~np.isfinite(t)
    if t.ndim != 1 or not len(t) or lost.any():
        raise ValueError(
            f"`{name}` must be finite times of shape (n,), got shape {t.shape} with "
            f"{int(lost.sum())} that are none. Drop these samples."
        )
    return t


def _dates(t, name):
    import pandas

    try:
        dates = pandas.to_datetime(t, utc=True, format="ISO8601")
        return dates.tz_localize(None).to_numpy()
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"`{name}` must be times in seconds or dates, got {str(t.flat[0])!r}. "
            "Convert them to numbers, or to dates as 2026-01-31T12:00:00."
        ) from error


def in_seconds(t):
    """Return durations in seconds.

    Parameters
    ----------
    t : ndarray
        Durations of numpy, or seconds.

    Returns
    -------
    t : ndarray
        Seconds.
    """
    return t / np.timedelta64(1, "s") if t.dtype.kind == "m" else t

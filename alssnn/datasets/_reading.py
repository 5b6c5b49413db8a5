"""Signals of a record from a CSV file or a DataFrame, and the sampling time."""

import numpy as np

from ..tables import SECONDS, read_csv, read_steps, unit_of
from ._times import as_times, in_seconds

UNEVEN = 0.01  # of the sampling time, by which the times of samples may differ


def csv_signals(path, inputs, outputs, time, dt):
    """Return the signals of a CSV file, and their sampling time.

    Parameters
    ----------
    path : str or path-like
        File with a header.
    inputs, outputs : sequence of str
        Names of columns.
    time : str or None
        Column of time, in seconds or in the unit that its name says; None looks for
        one named time or t.
    dt : float or None
        Sampling time, in seconds; None takes it from the column of time.

    Returns
    -------
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N, ny)
        Outputs; nan where not measured.
    dt : float
        Sampling time, in seconds.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If a column is missing or no signal, or there is no sampling time.
    """
    u, y, _ = read_csv(path, inputs, outputs)
    if dt is not None:
        return u, y, dt
    if time is None:
        time, steps = read_steps(path)
    else:
        t, _, _ = read_csv(path, [time], [])
        steps = SECONDS[unit_of(time)] * np.diff(t[:, 0])
    return u, y, even_step(f"column {time!r} of {path}" if time else "", steps)


def frame_signals(frame, inputs, outputs, time, dt):
    """Return the signals of a DataFrame, and their sampling time.

    Parameters
    ----------
    frame : DataFrame
        Data of pandas or polars.
    inputs, outputs : sequence of str
        Names of columns.
    time : str or None
        Column of time, in seconds or in the unit that its name says, or as dates; None
        takes the index of pandas if it holds dates or durations.
    dt : float or None
        Sampling time, in seconds; None takes it from the times.

    Returns
    -------
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N, ny)
        Outputs; nan where not measured.
    dt : float
        Sampling time, in seconds.

    Raises
    ------
    ValueError
        If a column is missing, or there is no sampling time.
    """
    known = {str(name): name for name in frame.columns}
    wanted = [*inputs, *outputs, *([] if time is None else [time])]
    missing = [name for name in wanted if str(name) not in known]
    if missing:
        raise ValueError(
            f"`frame` must have the columns that are named, got none called "
            f"{missing[0]!r} among {', '.join(known)}."
        )
    u, y = (
        np.column_stack([np.asarray(frame[known[str(z)]], dtype=float) for z in names])
        for names in (inputs, outputs)
    )
    if dt is not None:
        return u, y, dt
    times, where, unit = None, "", 1.0
    if time is not None:
        times, where = frame[known[str(time)]], f"column {time!r}"
        unit = SECONDS[unit_of(str(time))]
    elif hasattr(frame, "index"):
        index = np.asarray(frame.index)
        # rows that are counted say nothing of time
        if index.dtype.kind in "mM" or getattr(frame.index, "tz", None) is not None:
            times, where = index, "the index"
    steps = np.empty(0) if times is None else np.diff(as_times(times, "time"))
    # dates know their unit, whatever their column is called
    steps = in_seconds(steps) if steps.dtype.kind == "m" else unit * steps
    return u, y, even_step(where, steps)


def even_step(where, steps):
    """Return the sampling time of times that are evenly spaced.

    Parameters
    ----------
    where : str
        Where the times come from; empty if there are none.
    steps : ndarray of shape (N - 1,)
        Their differences, in seconds.

    Returns
    -------
    dt : float
        Sampling time, in seconds.

    Raises
    ------
    ValueError
        If there are no times, or they are not evenly spaced.
    """
    if not where or not len(steps):
        raise ValueError(
            "`dt` must be given where no column of time tells it, got None. Give the "
            "sampling time in seconds, or name the column as `time`."
        )
    dt = float(np.median(steps))
    odd = ~(np.abs(steps - dt) <= UNEVEN * dt)
    if dt <= 0 or odd.any():
        first = int(np.argmax(odd))  # or 0, if none is
        raise ValueError(
            f"The times in {where} must rise evenly, got a step of "
            f"{steps[first]:g} s after sample {first}, and {dt:g} s in the median. Cut "
            "the record at gaps, interpolate it to even times, or give `dt` if the "
            "times are wrong."
        )
    if abs(dt * len(steps) - steps.sum()) <= 1e-3 * dt:
        dt = float(steps.mean())
    return float(f"{dt:.9g}")  # without the rounding of times: two files have one dt

"""Signals with time stamps of their own, on one even grid."""

import numpy as np
from scipy.interpolate import CubicSpline

from ..checks import as_signal, check_option, sampling_time
from ..warn import warn_user
from ._record import Record
from ._times import as_times, in_seconds

CLOSE = 0.05  # of the shortest usual step, root mean square, by which stamps may move
TOLD = 0.01  # of it, from which a user is told
FINEST = 20  # parts of the shortest usual step
GROWTH = 50  # samples of the grid per sample that was given
ROUNDING = 1e-9  # of a sample
HOLDS = ("zoh", "linear", "cubic")


def on_grid(
    u, t_u, y, t_y, *, dt=None, hold="zoh", name="record", inputs=None, outputs=None
):
    """Return a record of signals that have time stamps of their own.

    Parameters
    ----------
    u : array-like of shape (n, nu) or (n,), or list of them
        Inputs; a list has signals that were sampled at other times.
    t_u : array-like of shape (n,), or list of them
        Times of their samples, in seconds or as dates, in ascending order.
    y : array-like of shape (m, ny) or (m,), or list of them
        Outputs; a list has signals that were sampled at other times.
    t_y : array-like of shape (m,), or list of them
        Times of their samples, as those of u.
    dt : float or None, default=None
        Sampling time of the record, in seconds; None is the longest part of the
        shortest usual step that moves stamps by at most 5 % of it, root mean square.
    hold : {"zoh", "linear", "cubic"}, default="zoh"
        What inputs do between their samples, as in a fit in continuous time.
    name : str, default="record"
        What was recorded.
    inputs, outputs : str, sequence of str or None, default=None
        Names of the columns; None takes those of DataFrames and Series.

    Returns
    -------
    record : Record
        An even record: inputs at all times, outputs at the nearest time, nan where
        there was none. It begins where all inputs are known.

    Raises
    ------
    ValueError
        If stamps do not fit their signal or do not ascend, signals do not overlap, or
        the record would become far larger than it was.

    Warns
    -----
    UserWarning
        If stamps move by more than 1 % of the shortest usual step.

    Examples
    --------
    >>> from alssnn.datasets import on_grid
    >>> t_u, t_y = [0.0, 0.3, 0.6], [0.0, 0.4, 0.8]
    >>> record = on_grid([1.0, 2.0, 3.0], t_u, [5.0, 6.0, 7.0], t_y)
    >>> record
    Record('record', N=9, nu=1, ny=1, dt=0.1 s)
    >>> record.y[:5, 0]
    array([ 5., nan, nan, nan,  6.])
    """
    check_option("hold", hold, HOLDS)
    inputs = _names(u) if inputs is None else inputs
    outputs = _names(y) if outputs is None else outputs
    sent, seen = _paired("u", u, t_u), _paired("y", y, t_y)
    for _, z in sent:
        if not np.isfinite(z).all():
            raise ValueError(
                "`u` must be finite, got nan or infinity. An input must be known at "
                "all times: leave the sample out, and `hold` fills the gap."
            )
    if len({t.dtype.kind for t, _ in (*sent, *seen)}) > 1:
        raise ValueError(
            "`t_u` and `t_y` must all be seconds or all be dates, got both. "
            "Convert one of them."
        )
    origin = min(t[0] for t, _ in sent)
    sent = [(in_seconds(t - origin), z) for t, z in sent]
    seen = [(in_seconds(t - origin), z) for t, z in seen]
    start = max(t[0] for t, _ in sent)  # where all inputs are known
    sent = [(t - start, z) for t, z in sent]
    seen = [(t - start, z) for t, z in seen]
    steps = [np.median(np.diff(t)) for t, _ in (*sent, *seen) if len(t) > 1]
    step = min(steps, default=1.0 if dt is None else dt)
    dt = _chosen(sent, seen, step, hold) if dt is None else sampling_time(dt)
    stop = max(t[-1] for t, _ in seen)
    if hold != "zoh":  # nothing is known behind the last sample of an input
        stop = min(stop, *(t[-1] for t, _ in sent))
    begins, ends = min(t[0] for t, _ in seen), min(t[-1] for t, _ in sent)
    if stop < 0 or begins > ends + step:
        raise ValueError(
            "`t_u` and `t_y` must overlap, got outputs that end before the inputs "
            "begin, or begin behind their end. Check their units and time zones."
        )
    given, N = sum(len(t) for t, _ in (*sent, *seen)), round(stop / dt) + 1
    if N > GROWTH * given:
        raise ValueError(
            f"`dt` must be longer: {dt:.3g} s makes {N} samples of {given}. Give a "
            "longer `dt`, or split the record where nothing was measured for long."
        )
    where = np.arange(N) * dt
    u = np.hstack([_known(t, z, where, dt, hold) for t, z in sent])
    y = np.hstack([_placed(t, z, N, dt) for t, z in seen])
    moved = np.sqrt(np.mean(_moved(sent, seen, dt, hold) ** 2))
    if moved > TOLD * step:
        warn_user(
            f"Time stamps are moved by {moved:.2g} s, root mean square, to an even "
            f"grid of {dt:.4g} s. A shorter `dt` moves them less.",
            UserWarning,
        )
    return Record(u, y, dt, name, inputs=inputs, outputs=outputs)


def _names(signals):
    """Return the names of the columns of all signals, None if one has none."""
    names: list = []
    for z in signals if isinstance(signals, list) else [signals]:
        names += list(getattr(z, "columns", [getattr(z, "name", None)]))
    return None if None in names or "" in names else [str(name) for name in names]


def _paired(name, signals, stamps):
    """Return pairs of stamps and signals, checked."""
    several = isinstance(signals, list) and bool(signals) and np.ndim(signals[0]) > 0
    if not several:
        signals, stamps = [signals], [stamps]
    elif not isinstance(stamps, list) or len(stamps) != len(signals):
        raise ValueError(
            f"`t_{name}` must be a list of {len(signals)} arrays, for `{name}` is one."
        )
    pairs = []
    for z, t in zip(signals, stamps, strict=True):
        z, t = as_signal(name, z, gaps=True), as_times(t, f"t_{name}")
        if len(z) != len(t):
            raise ValueError(
                f"`t_{name}` must have a time for each of {len(z)} samples, got "
                f"{len(t)}."
            )
        back = np.flatnonzero(np.diff(t) <= 0 * np.diff(t))
        if len(back):
            i = int(back[0])
            kind = "repeats" if t[i + 1] == t[i] else "goes back"
            raise ValueError(
                f"`t_{name}` must ascend, got one that {kind} at row {i + 1}: "
                f"{t[i + 1]} behind {t[i]}. Sort the record, or drop what is double."
            )
        pairs.append((t, z))
    return pairs


def _nearest(t, dt):
    """Return the numbers of the nearest times of a grid; a half counts upwards."""
    return np.floor(t / dt + 0.5 + ROUNDING).astype(int)


def _moved(inputs, outputs, dt, hold):
    """Return by how much stamps move, in seconds; inputs that go on are not moved."""
    pairs = (*inputs, *outputs) if hold == "zoh" else outputs
    t = np.concatenate([t for t, _ in pairs])
    return t - dt * _nearest(t, dt)


def _chosen(inputs, outputs, step, hold):
    """Return the sampling time of the grid."""
    for parts in range(1, FINEST + 1):
        dt = step / parts
        if np.sqrt(np.mean(_moved(inputs, outputs, dt, hold) ** 2)) <= CLOSE * step:
            return float(f"{dt:.12g}")  # without the rounding of differences
    raise ValueError(
        f"`dt` must be given: no part of the usual step of {step:.4g} s down to "
        f"{step / FINEST:.3g} s has a grid near the time stamps."
    )


def _known(t, z, where, dt, hold):
    """Return an input at the times of a grid."""
    if hold == "zoh":
        at = _nearest(t, dt) * dt
        return z[np.searchsorted(at, where + 0.25 * dt, side="right") - 1]
    if hold == "cubic" and len(t) > 2:
        return CubicSpline(t, z)(where)
    return np.column_stack([np.interp(where, t, column) for column in z.T])


def _placed(t, z, N, dt):
    """Return an output at the nearest times of a grid; means where several meet."""
    at = _nearest(t, dt)
    inside = (at >= 0) & (at < N)
    sums, counts = np.zeros((N, z.shape[1])), np.zeros((N, z.shape[1]))
    known = np.isfinite(z[inside])
    np.add.at(sums, at[inside], np.where(known, z[inside], 0.0))
    np.add.at(counts, at[inside], known)
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)

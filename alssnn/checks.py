"""Checks of arguments that several packages share."""

import reprlib
from numbers import Integral, Real

import numpy as np

FINISHED = 1.1  # error over that of the noise from which nothing is left to learn


def unmasked(values):
    """Return a masked array with nan where it is masked.

    Parameters
    ----------
    values : object
        Anything.

    Returns
    -------
    values : object
        An array without a mask in place of a masked one; anything else as it came.
    """
    if not isinstance(values, np.ma.MaskedArray):
        return values
    return np.ma.filled(values.astype(float), np.nan)


def is_count(value, smallest=1):
    """Tell whether something is an integer that is not too small.

    Parameters
    ----------
    value : object
        Anything.
    smallest : int, default=1
        Smallest integer that counts.

    Returns
    -------
    is_count : bool
        Whether it is one; booleans are none.
    """
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    return whole and int(value) >= smallest


def is_positive(value):
    """Tell whether something is a positive and finite number.

    Parameters
    ----------
    value : object
        Anything.

    Returns
    -------
    is_positive : bool
        Whether it is one; booleans are none.
    """
    number = isinstance(value, Real) and not isinstance(value, bool)
    return number and 0 < float(value) < np.inf


def count(name, value, smallest=1):
    """Return an integer that is not too small.

    Parameters
    ----------
    name : str
        Name of the argument.
    value : int
        Value.
    smallest : int, default=1
        Smallest value that is accepted.

    Returns
    -------
    value : int
        The integer.

    Raises
    ------
    ValueError
        If it is no integer, or too small.
    """
    if not is_count(value, smallest):
        raise ValueError(
            f"`{name}` must be an integer of at least {smallest}, got {value!r}."
        )
    return int(value)


def as_numbers(name, value):
    """Return an array of real numbers.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like
        The argument.

    Returns
    -------
    value : ndarray of float
        The numbers; nan and inf are left to the caller.

    Raises
    ------
    ValueError
        If they are none.
    """
    try:
        given = np.asarray(unmasked(value))
        if given.dtype.kind in "biufO":  # text is no number, even if it reads as one
            return given.astype(float)
    except (TypeError, ValueError, OverflowError):  # ragged, or other objects
        pass
    raise ValueError(
        f"`{name}` must be real numbers, got {type(value).__name__} "
        f"{reprlib.repr(value)}. Give a number or an array of them."
    )


def numbers_of_shape(value, shape):
    """Return numbers of a shape, nan where something has none that fit.

    Parameters
    ----------
    value : object
        What a user gave: one number, or an array of them.
    shape : int or tuple of int
        Shape that it is to have.

    Returns
    -------
    value : ndarray of shape `shape`
        The numbers, or nan alone; what nan means is said by the caller.
    """
    try:
        return np.broadcast_to(as_numbers("value", value), shape).copy()
    except ValueError:
        return np.full(shape, np.nan)


def as_signal(name, z, gaps=False):
    """Return a signal as columns of finite real numbers.

    Parameters
    ----------
    name : str
        Name of the argument.
    z : array_like of shape (N, n) or (N,)
        Signal, of at least one sample.
    gaps : bool, default=False
        Whether values may be nan.

    Returns
    -------
    z : ndarray of shape (N, n)
        The signal.

    Raises
    ------
    ValueError
        If it is none.
    """
    try:
        z = np.asarray(unmasked(z))
    except ValueError:  # ragged
        z = np.empty(0, dtype=object)
    if z.dtype.kind not in "biuf":  # text and complex would convert silently
        raise ValueError(
            f"`{name}` must be an array of real numbers, got dtype {z.dtype}. Convert "
            "it to floats, one row per sample."
        )
    if z.ndim not in (1, 2) or not z.size:
        raise ValueError(
            f"`{name}` must be a nonempty array of shape (N,) or (N, n_signals), got "
            f"shape {z.shape}. Let time run down the rows."
        )
    z = z.reshape(len(z), -1).astype(float, copy=False)
    wrong = np.isinf(z) if gaps else ~np.isfinite(z)
    if wrong.any():
        k, i = np.argwhere(wrong)[0]
        others = " What was not measured is nan." if gaps else ""
        raise ValueError(
            f"`{name}` must be finite, got {z[k, i]} at row {k} of column {i}. "
            f"Interpolate the sample or cut the record there.{others}"
        )
    return z


def check_columns(name, z, size):
    """Return a signal with a column per variable, or refuse what would be broadcast.

    Parameters
    ----------
    name : str
        Name of the argument.
    z : array_like of shape (size,) or (N, size)
        Signal.
    size : int
        Number of columns.

    Returns
    -------
    z : ndarray of shape (size,) or (N, size)
        The signal.

    Raises
    ------
    ValueError
        If it has another number of columns.
    """
    z = np.asarray(z)
    if z.shape[-1:] != (size,):
        raise ValueError(
            f"`{name}` must have shape ({size},) or (N, {size}), got {z.shape}. Give a "
            "column per signal."
        )
    return z


def check_pairs(**signals):
    """Return signals of the same samples, one per row.

    Parameters
    ----------
    **signals : tuple of (array_like, int)
        Values and number of columns, by the name of the argument.

    Returns
    -------
    rows : list of ndarray of shape (N, size)
        The signals.

    Raises
    ------
    ValueError
        If one has another number of columns, or they differ in their rows.
    """
    rows = [np.atleast_2d(check_columns(n, *pair)) for n, pair in signals.items()]
    if len({len(z) for z in rows}) > 1:
        raise ValueError(
            f"{' and '.join(f'`{name}`' for name in signals)} must have as many rows, "
            f"got {' and '.join(str(len(z)) for z in rows)}. Give one per sample."
        )
    return rows


def check_option(name, value, options, remedy=""):
    """Refuse a value that is none of some strings.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : object
        Its value.
    options : iterable of str
        What it may be.
    remedy : str, default=""
        What to do instead.

    Raises
    ------
    ValueError
        If it is none of them.
    """
    *others, last = map(repr, options)
    if not isinstance(value, str) or value not in list(options):
        words = f"`{name}` must be {', '.join(others)} or {last}, got {value!r}."
        raise ValueError(f"{words} {remedy}".rstrip())


def check_type(name, value, kind, remedy):
    """Refuse a value of another class.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : object
        Its value.
    kind : type
        What it must be.
    remedy : str
        What to do instead.

    Raises
    ------
    TypeError
        If it is of another class.
    """
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise TypeError(
            f"`{name}` must be {article} {kind.__name__}, got {type(value).__name__}. "
            f"{remedy}"
        )


def sampling_time(dt, name="dt"):
    """Return a sampling time.

    Parameters
    ----------
    dt : float
        Sampling time, in seconds.
    name : str, default="dt"
        Name of the argument, for the message.

    Returns
    -------
    dt : float
        The same.

    Raises
    ------
    ValueError
        If it is not positive and finite.
    """
    if not is_positive(dt):
        raise ValueError(
            f"`{name}` must be a positive number, got {dt!r}. Give the sampling time "
            "in seconds."
        )
    return float(dt)


def probability(level, remedy=""):
    """Return a probability that is neither 0 nor 1.

    Parameters
    ----------
    level : float
        Value of the argument `level`.
    remedy : str, default=""
        What it means, or what to do instead.

    Returns
    -------
    level : float
        The same.

    Raises
    ------
    ValueError
        If it is not between them.
    """
    if isinstance(level, bool) or not 0 < level < 1:
        words = f"`level` must be between 0 and 1, got {level!r}. {remedy}"
        raise ValueError(words.rstrip())
    return level


def noise_levels(known, ny):
    """Return the errors that no model goes below.

    Parameters
    ----------
    known : float, array_like of shape (ny,), object with `noise_rms`, or None
        Root mean squares in the units of the outputs; what
        `nonparametric.best_linear_approximation` or `look` say of a record with periods
        or with experiments that had the same input.
    ny : int
        Number of outputs.

    Returns
    -------
    floor : ndarray of shape (ny,) or None
        The floor of every output; None if it is not known.

    Raises
    ------
    ValueError
        If it is not a positive number for every output, or of a record that does not
        tell its noise.

    Examples
    --------
    >>> from alssnn.checks import noise_levels
    >>> noise_levels(0.1, 2)
    array([0.1, 0.1])
    """
    if known is None:
        return None
    value = getattr(known, "noise_rms", known)
    if value is not known and (value is None or np.isnan(value).any()):
        raise ValueError(
            f"`noise_floor` must know the noise, got a {type(known).__name__} of a "
            "record without periods, which does not tell its noise. Give the floor "
            "itself, or None; or record one input twice."
        )
    floor = numbers_of_shape(value, ny)
    if not np.all((floor > 0) & np.isfinite(floor)):
        raise ValueError(
            f"`noise_floor` must be positive, one number or one for each of {ny} "
            f"outputs, got {value!r}. Noise apart from distortion is only known of "
            "periods and of experiments with the same input, see `look`."
        )
    return floor

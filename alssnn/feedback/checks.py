"""Arguments of designs, observers and loops: their sizes, signs and sampling times."""

import reprlib

import numpy as np

from ..checks import as_numbers, is_positive


def check_point(name, value, size, missing=False):
    """Return a vector of given size; None stands for zero.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like of shape (size,) or None
        The argument.
    size : int
        Its length.
    missing : bool, default=False
        Whether entries may be nan or infinite, which count as not measured: nan.

    Returns
    -------
    value : ndarray of shape (size,)
        The vector.

    Raises
    ------
    ValueError
        If the size is wrong or a value not finite.
    """
    if value is None:
        return np.zeros(size)
    value = as_numbers(name, value)
    if value.shape != (size,):
        raise ValueError(
            f"`{name}` must have shape ({size},), got {value.shape}. Give one value "
            "per signal."
        )
    if missing:
        return np.where(np.isfinite(value), value, np.nan)
    if not np.isfinite(value).all():
        raise ValueError(
            f"`{name}` must be finite, got {value}. Replace nan and inf, for "
            "example by the last value."
        )
    return value


def check_measured(y, size):
    """Return a measurement.

    Parameters
    ----------
    y : array_like of shape (size,)
        What was measured, a number if there is one output.
    size : int
        Number of outputs.

    Returns
    -------
    y : ndarray of shape (size,)
        The same; nan where it was not finite.

    Raises
    ------
    ValueError
        If it is None or of another size.
    """
    if y is None:
        raise ValueError(
            "`y` must be a measurement, got None. Give nan where there is none."
        )
    return check_point("y", np.atleast_1d(y), size, missing=True)


def check_weight(name, value, size, *, definite=False):
    """Return a symmetric, positive semidefinite matrix of given size.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like of shape (size, size)
        The matrix.
    size : int
        Its size.
    definite : bool, default=False
        Whether it must be positive definite.

    Returns
    -------
    value : ndarray of shape (size, size)
        The matrix.

    Raises
    ------
    ValueError
        If the size is wrong or the matrix is not as required.
    """
    value = as_numbers(name, value)
    if value.shape != (size, size):
        raise ValueError(
            f"`{name}` must have shape ({size}, {size}), got {value.shape}. Multiply "
            "np.eye by the weights."
        )
    kind = "definite" if definite else "semidefinite"
    rounding = 1e-8 * np.abs(value).max()  # weights come in any units
    symmetric = np.isfinite(value).all() and np.allclose(value, value.T, atol=rounding)
    least = np.linalg.eigvalsh(value).min() if symmetric else np.nan
    # rounding makes eigenvalues of a semidefinite matrix slightly negative
    if not (least > 0 if definite else least >= -1e-12 * np.abs(value).max()):
        raise ValueError(
            f"`{name}` must be symmetric and positive {kind}, got smallest eigenvalue "
            f"{least:.3g}. Use positive weights on the diagonal."
        )
    return (value + value.T) / 2  # python-control refuses what rounding left


def check_limits(letter, lower, upper, size):
    """Return lower and upper limits of every signal.

    Parameters
    ----------
    letter : str
        Name of the signal, for the message: its limits are ``u_min`` and ``u_max``.
    lower : float, array_like of shape (size,) or None
        Lower limits; None means none.
    upper : float, array_like of shape (size,) or None
        Upper limits; None means none.
    size : int
        Number of signals.

    Returns
    -------
    lower, upper : ndarray of shape (size,)
        Limits; infinite where there is none.

    Raises
    ------
    ValueError
        If a limit has the wrong size, is NaN, or the lower one is not below the upper.
    """
    lower = _limit(f"{letter}_min", lower, size, -np.inf)
    upper = _limit(f"{letter}_max", upper, size, np.inf)
    if not np.all(lower < upper):
        raise ValueError(
            f"`{letter}_min` must be below `{letter}_max`, got {lower} and {upper}. "
            "Exchange them."
        )
    return lower, upper


def _limit(name, value, size, default):
    """Return a limit for every signal."""
    if value is None:
        return np.full(size, default)
    value = as_numbers(name, value)
    if value.shape not in [(), (size,)] or np.isnan(value).any():
        raise ValueError(
            f"`{name}` must be a number or have shape ({size},), without NaN, got "
            f"{value}. Use -inf or inf for signals without a limit."
        )
    return np.broadcast_to(value, size).copy()


def check_gate(gate):
    """Return the number of standard deviations that an innovation may have.

    Parameters
    ----------
    gate : float or None
        The argument `gate`; None means no gate.

    Returns
    -------
    gate : float or None
        The number.

    Raises
    ------
    ValueError
        If it is not positive.
    """
    if gate is None:
        return None
    if not is_positive(gate):
        raise ValueError(
            f"`gate` must be a positive number or None, got {reprlib.repr(gate)}. It "
            "counts standard deviations; try 10."
        )
    return float(gate)


def check_signal(name, value, n, size):
    """Return a signal, one row per sample.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    value : array_like of shape (n, size) or None
        The signal; None stands for zero if `n` is given.
    n : int or None
        Number of samples; None means any, at least one.
    size : int
        Number of signals.

    Returns
    -------
    signal : ndarray of shape (n, size)
        The signal.

    Raises
    ------
    ValueError
        If the shape is wrong or a value not finite.
    """
    if value is None and n is not None:
        return np.zeros((n, size))
    value = as_numbers(name, value)
    signal = value[:, None] if value.ndim == 1 and size == 1 else value
    rows = "N" if n is None else n
    if signal.shape != (max(signal.size // size, 1) if n is None else n, size):
        raise ValueError(
            f"`{name}` must have shape ({rows}, {size}), got {value.shape}. Time runs "
            "down the rows, at least one."
        )
    if not np.isfinite(signal).all():
        raise ValueError(
            f"`{name}` must be finite, got nan or inf. Hold the last value "
            "where one is missing."
        )
    return signal


def check_dt(name, sys, dt):
    """Refuse continuous time and other sampling times.

    Parameters
    ----------
    name : str
        Name of the argument, for the message.
    sys : system of python-control
        The argument.
    dt : float
        Sampling time of the model, in seconds.

    Raises
    ------
    ValueError
        If the system is continuous in time, or sampled at another rate.
    """
    if sys.dt == 0:
        raise ValueError(
            f"`{name}` must be discrete in time with dt={dt}, got a continuous-time "
            "system. Discretize it, for example with control.sample_system."
        )
    if sys.dt is None or sys.dt is True:  # not specified
        return
    if not np.isclose(sys.dt, dt, rtol=1e-9, atol=0):
        raise ValueError(
            f"`{name}` must have the sampling time of the model, dt={dt}, got "
            f"{sys.dt}. Resample it, or give the estimator the right `dt`."
        )


def check_disturbances(name, part, plant):
    """Refuse a part of a loop that takes other inputs for measured disturbances.

    Parameters
    ----------
    name : str
        Name of the argument.
    part : object
        Law or observer, whose `plant` tells; anything else is left to other checks.
    plant : Plant
        Model of the loop.

    Raises
    ------
    ValueError
        If their measured disturbances differ.
    """
    own = getattr(getattr(part, "plant", None), "given", plant.given)
    if own != plant.given:
        raise ValueError(
            f"`{name}` must have the measured disturbances of the model, the columns "
            f"{list(plant.given)}, got {list(own)}. Make it from the same model."
        )

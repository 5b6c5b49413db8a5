"""Checks of arguments that what comes before a model shares."""

from numbers import Integral, Real

import numpy as np


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
    if (
        isinstance(value, bool)
        or not isinstance(value, Integral)
        or int(value) < smallest
    ):
        raise ValueError(
            f"`{name}` must be an integer of at least {smallest}, got {value!r}."
        )
    return int(value)


def sampling_time(dt):
    """Return a sampling time.

    Parameters
    ----------
    dt : float
        Sampling time, in seconds.

    Returns
    -------
    dt : float
        The same.

    Raises
    ------
    ValueError
        If it is not positive and finite.
    """
    number = isinstance(dt, Real) and not isinstance(dt, bool)
    if not number or not 0 < float(dt) < np.inf:
        raise ValueError(
            f"`dt` must be a positive number, got {dt!r}. Give the sampling time in "
            "seconds."
        )
    return float(dt)

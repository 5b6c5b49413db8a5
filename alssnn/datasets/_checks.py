"""Checks of arguments that the makers and the record share."""

from numbers import Integral, Real

import numpy as np


def _check_samples(n_samples, noise):
    """Check the number of samples and the noise of a simulated record."""
    if isinstance(n_samples, bool) or not isinstance(n_samples, Integral):
        raise TypeError(
            f"`n_samples` must be an int, got {n_samples!r}. Give a number of samples."
        )
    if n_samples < 1:
        raise ValueError(
            f"`n_samples` must be at least 1, got {n_samples}. "
            "Give a positive number of samples."
        )
    _check_noise("noise", noise, "Use 0.01 for noise of 1 % of the output.")


def _check_noise(name, value, remedy):
    """Check a standard deviation, which may be zero."""
    _check_number(name, value)
    if not 0 <= value < np.inf:
        raise ValueError(
            f"`{name}` must be nonnegative and finite, got {value}. {remedy}"
        )


def _check_positive(name, value, remedy):
    """Check a physical parameter that must be positive."""
    _check_number(name, value)
    if not 0 < value < np.inf:
        raise ValueError(f"`{name}` must be positive and finite, got {value}. {remedy}")


def _check_numbers(name, values, length, remedy):
    """Return `values`, `length` finite numbers, as a list of floats."""
    try:
        numbers = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (length,) or not np.all(np.isfinite(numbers)):
        raise ValueError(
            f"`{name}` must be {length} finite numbers, got {values!r}. {remedy}"
        )
    return numbers.tolist()


def _check_number(name, value, remedy="Give a float."):
    """Check that `value` is a real number."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise TypeError(f"`{name}` must be a number, got {value!r}. {remedy}")

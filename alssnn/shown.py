"""What values look like in words: short reprs, percentages without exponents."""

from dataclasses import fields
from numbers import Number

import numpy as np

FEW = 4  # numbers of an array that are shown
LONGEST = 300  # characters
LEAST, MOST = 1e-3, 1e6  # percentages beyond are no figures to read
NOTHING = 1e-9  # percent: what rounding leaves of zero


def short_repr(self):
    """Return the fields of a dataclass in short: sizes where there are many numbers.

    A class takes it as its ``__repr__``; a dataclass then makes none of its own.

    Parameters
    ----------
    self : dataclass
        The value.

    Returns
    -------
    text : str
        One line of at most 300 characters.
    """
    shown = (
        f"{one.name}={_short(getattr(self, one.name))}"
        for one in fields(self)
        if one.repr and getattr(self, one.name) is not None
    )
    text = f"{type(self).__name__}({', '.join(shown)})"
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 4]}...)"


def _short(value):
    """Return a value in a few words."""
    if isinstance(value, np.ndarray):
        if value.size > FEW:
            return f"array{value.shape}".replace(" ", "")
        return np.array2string(value, precision=4, separator=", ").replace("\n", "")
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if isinstance(value, str | Number | slice):
        return repr(value)
    if isinstance(value, list | tuple | dict):
        if len(value) <= FEW and all(isinstance(z, str | Number) for z in value):
            return repr(value)
        return f"{type(value).__name__} of {len(value)}"
    return type(value).__name__


def percent(value, digits=2):
    """Return a percentage as one reads it, never with an exponent.

    Parameters
    ----------
    value : float
        The percentage.
    digits : int, default=2
        Digits that count; larger numbers are written to the unit.

    Returns
    -------
    text : str
        The number and the sign of percent.
    """
    size = abs(value)
    if size < NOTHING:
        return "0 %"
    if size < LEAST:
        return f"less than {LEAST:g} %"
    if MOST < size < np.inf:
        side = "more than" if value > 0 else "less than -"
        return f"{side} {MOST:,.0f} %".replace("- ", "-")
    if size >= 10**digits - 0.5:
        return f"{value:,.0f} %"
    return f"{value:.{digits}g} %"


def times(ratio):
    """Return how many times one thing is another, in two digits or in words.

    Parameters
    ----------
    ratio : float
        The ratio, at least 1.

    Returns
    -------
    text : str
        What stands before "times".
    """
    if ratio > MOST:
        return "more than a million"
    return f"{ratio:,.0f}" if ratio >= 99.5 else f"{ratio:.2g}"

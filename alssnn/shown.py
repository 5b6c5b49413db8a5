"""Short reprs: what a value is, and its sizes, instead of all its numbers."""

from dataclasses import fields
from numbers import Number

import numpy as np

FEW = 4  # numbers of an array that are shown
LONGEST = 300  # characters


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

"""Arguments of a record: names and a state, checked and converted."""

import numpy as np

from ..checks import as_numbers


def as_list(names):
    """Return one name or several as a list.

    Parameters
    ----------
    names : str or sequence of str
        Names.

    Returns
    -------
    names : list of str
        The names.
    """
    return [names] if isinstance(names, str) else [str(name) for name in names]


def as_names(names, letter, size):
    """Return names of signals, by default the letter and a number.

    Parameters
    ----------
    names : str, sequence of str or None
        Names.
    letter : {"u", "y"}
        Which signals.
    size : int
        Their number.

    Returns
    -------
    names : list of str
        One per signal.

    Raises
    ------
    ValueError
        If their number is wrong.
    """
    if names is None:
        return [f"{letter}{i}" for i in range(size)]
    names = as_list(names)
    if len(names) != size:
        which = "inputs" if letter == "u" else "outputs"
        raise ValueError(
            f"`{which}` must be {size} names, one per column of `{letter}`, got "
            f"{names}."
        )
    return names


def as_state(values):
    """Convert to a float array of shape (nx,).

    Parameters
    ----------
    values : array-like of shape (nx,)
        State.

    Returns
    -------
    x0 : ndarray of shape (nx,)
        State.

    Raises
    ------
    ValueError
        If it is none.
    """
    x0 = as_numbers("x0", values)
    if x0.ndim != 1 or not np.isfinite(x0).all():
        raise ValueError(
            f"`x0` must be of shape (nx,) and finite, got {x0.tolist()}. "
            "Give one number per state."
        )
    return x0

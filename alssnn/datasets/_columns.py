"""Arguments of a record: signals, names and a state, checked and converted."""

import numpy as np

from ..checks import unmasked


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


def _as_real_array(values, name, gaps=False):
    """Convert to a finite float array of any shape; with gaps, nan are left."""
    array = np.asarray(unmasked(values))
    if array.dtype.kind not in "biuf":  # text and complex would convert silently
        raise ValueError(
            f"`{name}` must be an array of real numbers, got dtype {array.dtype}. "
            "Convert it to floats first."
        )
    array = array.astype(float, copy=False)
    wrong = np.isinf(array) if gaps else ~np.isfinite(array)
    if wrong.any():
        row = int(np.argwhere(wrong)[0][0]) if array.ndim else 0
        found = "infinity" if gaps else "NaN or infinity"
        raise ValueError(
            f"`{name}` must be finite, got {found} at row {row}. "
            "Interpolate the sample or cut the record there."
        )
    return array


def as_signal(values, name, gaps=False):
    """Convert to a float array of shape (N, n_signals) with at least one sample.

    Parameters
    ----------
    values : array-like of shape (N,) or (N, n_signals)
        Signal.
    name : str
        Name of the argument.
    gaps : bool, default=False
        Whether values may be nan.

    Returns
    -------
    signal : ndarray of shape (N, n_signals)
        Signal.

    Raises
    ------
    ValueError
        If it is none.
    """
    signal = _as_real_array(values, name, gaps)
    if signal.ndim not in (1, 2) or signal.size == 0:
        raise ValueError(
            f"`{name}` must be a nonempty array of shape (N,) or (N, n_signals), "
            f"got shape {signal.shape}. Let time run down the rows."
        )
    return signal.reshape(len(signal), -1)


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
    x0 = _as_real_array(values, "x0")
    if x0.ndim != 1:
        raise ValueError(
            f"`x0` must be of shape (nx,), got shape {x0.shape}. "
            "Flatten it to one dimension."
        )
    return x0

"""What the networks see: the choices `h_inputs` and `g_inputs`.

The structure of a model is the same whatever its networks see.  The columns of their
first layers that belong to signals they do not see are held at zero
(`training.Limits`), and everything made of the parameters is right without knowing.
"""

from numbers import Integral

import numpy as np

ALL = "all"
SIGNALS = {"x": "state", "u": "input", "y": "output"}


def check_choice(argument, choice, signals):
    """Return what a network is to see, by signal.

    Parameters
    ----------
    argument : str
        Name of the parameter, for messages.
    choice : array_like, dict or None
        Numbers or names of one signal, or one such list per signal by its letter;
        None stands for everything.
    signals : tuple of str
        Letters of what the network can see, such as ``("x", "u")``.

    Returns
    -------
    choices : dict of str to list or "all"
        What is seen of every signal; a signal that is not seen has an empty list.

    Raises
    ------
    ValueError
        If a letter is unknown, nothing is chosen, or a list is none.
    """
    if choice is None:
        return dict.fromkeys(signals, ALL)
    if not isinstance(choice, dict):
        if len(signals) > 1:
            letters = " and ".join(repr(letter) for letter in signals)
            raise ValueError(
                f"`{argument}` must be a dict with lists for {letters}, got "
                f"{choice!r}. A letter that is left out is not seen."
            )
        choice = {signals[0]: choice}
    unknown = sorted(str(letter) for letter in set(choice) - set(signals))
    if unknown or not choice:
        raise ValueError(
            f"`{argument}` must name signals among {', '.join(map(repr, signals))}, "
            f"got {unknown or 'none'}. Leave the network out with n=0 neurons if it "
            "is to see nothing."
        )
    return {letter: _as_list(argument, choice.get(letter)) for letter in signals}


def _as_list(argument, items):
    """Return the items of one signal as a list."""
    if items is None:
        return []
    if isinstance(items, str) and items == ALL:
        return ALL
    if isinstance(items, str | Integral):
        items = [items]
    items = list(items)
    if not items:
        letter = argument[0]
        raise ValueError(
            f"`{argument}` must list something to see, got an empty list. Leave "
            f"the network out with n_{letter}=0, or the letter of a signal that it "
            "is not to see."
        )
    return items


def seen_columns(argument, signal, items, size, names):
    """Return which columns of a signal a list names.

    Parameters
    ----------
    argument : str
        Name of the parameter, for messages.
    signal : {"x", "u", "y"}
        Letter of the signal.
    items : list of int or str, or "all"
        Numbers from 0, or names.
    size : int
        Columns of the signal.
    names : sequence of str or None
        Names of the columns, if they have any.

    Returns
    -------
    seen : ndarray of bool of shape (size,)
        Whether each column is in the list.

    Raises
    ------
    ValueError
        If a name is unknown or a number out of range.
    """
    if isinstance(items, str):  # ALL
        return np.ones(size, dtype=bool)
    names = [] if names is None else list(names)
    seen = np.zeros(size, dtype=bool)
    for item in items:
        is_number = isinstance(item, Integral) and not isinstance(item, bool | np.bool_)
        if is_number and 0 <= item < size:
            seen[item] = True
        elif isinstance(item, str) and item in names:
            seen[names.index(item)] = True
        else:
            known = f" or names among {', '.join(names)}" if names else ""
            unnamed = (
                "Names need data frames. "
                if isinstance(item, str) and not names and signal != "x"
                else ""
            )
            raise ValueError(
                f"`{argument}` must hold numbers of the {SIGNALS[signal]}s, 0 to "
                f"{size - 1}{known}, got {item!r}. {unnamed}Numbers count from 0."
            )
    return seen


def held_columns(structure, seen):
    """Return bounds that hold at zero what the networks do not see.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    seen : dict of tuple to ndarray of bool
        Pairs (network, signal) -> whether each column of the signal is seen.

    Returns
    -------
    bounds : dict of str to tuple of ndarray
        Lower and upper bounds of the weights that have held columns.
    """
    bounds = {}
    for (net, signal), columns in seen.items():
        for name, axes in structure.parameters.items():
            if axes == (f"w_{net}", signal) and not columns.all():
                free = np.where(columns, np.inf, 0.0)
                high = np.broadcast_to(free, structure.shapes[name])
                bounds[name] = -high, high
    return bounds

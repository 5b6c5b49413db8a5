"""What the networks see: the choices `h_inputs` and `g_inputs`.

The structure of a model is the same whatever its networks see.  The columns of their
first layers that belong to signals they do not see are held at zero
(`limits.Limits`), and everything made of the parameters is right without knowing.
"""

from itertools import islice
from numbers import Integral

import numpy as np

from ._input_map import check_map
from ._integrators import keeps_start

ALL = "all"
MOST_COLUMNS = 10_000  # of a list: a range may be endless
SIGNALS = {"x": "state", "u": "input", "y": "output", "d": "disturbance"}


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
    items = listed(argument, items)
    if not items:
        letter = argument[0]
        raise ValueError(
            f"`{argument}` must list something to see, got an empty list. Leave "
            f"the network out with n_{letter}=0, or the letter of a signal that it "
            "is not to see."
        )
    return items


def listed(argument, items):
    """Return numbers or names of columns as a list.

    Parameters
    ----------
    argument : str
        Name of the parameter, for messages.
    items : iterable
        Numbers or names.

    Returns
    -------
    items : list
        The same.

    Raises
    ------
    ValueError
        If there are more than any record has columns.
    """
    items = list(islice(items, MOST_COLUMNS + 1))
    if len(items) > MOST_COLUMNS:
        raise ValueError(
            f"`{argument}` must list columns of the record, got more than "
            f"{MOST_COLUMNS} of them. Name those that count."
        )
    return items


def seen_columns(argument, signal, items, size, names):
    """Return which columns of a signal a list names.

    Parameters
    ----------
    argument : str
        Name of the parameter, for messages.
    signal : {"x", "u", "y", "d"}
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
        layers = {f"w_{net}", "w_phi"} if net == "h" else {f"w_{net}"}
        for name, axes in structure.parameters.items():
            if axes[0] in layers and axes[1:] == (signal,) and not columns.all():
                free = np.where(columns, np.inf, 0.0)
                high = np.broadcast_to(free, structure.shapes[name])
                bounds[name] = -high, high
    return bounds


def check_inputs(estimator):
    """Refuse choices of inputs and outputs before anything is identified.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.

    Raises
    ------
    ValueError
        If a choice does not fit the signals, or the other options.
    """
    check_map(estimator)
    has_h = np.any(getattr(estimator, "n_h", 0)) and estimator.feedback == "output"
    if (
        has_h
        and estimator.h_inputs is None
        and estimator.integrators not in (0, "auto")
    ):
        raise ValueError(
            "`h_inputs` must say which outputs h sees beside integrators with "
            "feedback='output', got None. List those that do not integrate, or "
            "take feedback='state', where h does not see integrators."
        )
    sizes = {"u": estimator.n_features_in_, "y": len(estimator._scaling.y_offset)}
    seen(estimator, {**sizes, "d": len(estimator.disturbances_)})


def seen(estimator, sizes):
    """Return which columns of signals of known sizes the networks see.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    sizes : dict of str to int
        Number of signals, by letter.

    Returns
    -------
    seen : dict of tuple of str to ndarray of bool
        By network and letter: which columns it sees.

    Raises
    ------
    ValueError
        If a choice does not fit the signals.
    """
    given = estimator.disturbances_
    of_h = ("x" if estimator.feedback == "state" else "y", *("d" * bool(len(given))))
    choices = {
        "h": check_choice("h_inputs", estimator.h_inputs, of_h),
        "g": check_choice("g_inputs", estimator.g_inputs, ("x", "u")),
    }
    if estimator.integrators_:  # a shift of an integrator shifts the output alone
        choices["k"] = {"x": ALL, "u": ALL}
    n = estimator.integrators_
    own_basis = estimator.linear_start is not None and keeps_start(estimator)
    names = {
        "u": getattr(estimator, "feature_names_in_", None),
        "y": estimator.output_names_,
    }
    if names["u"] is not None:
        names["d"] = [names["u"][i] for i in given]
    columns_of = {}
    for net, by_signal in choices.items():
        argument = f"{net}_inputs"
        for signal, items in by_signal.items():
            if signal == "x" and items not in (ALL, []) and not own_basis:
                raise ValueError(
                    f"`{argument}` must be 'all' of the states unless they are "
                    f"those of `linear_start`, got {items!r}. Numbers need a basis "
                    "that stays what it is: give `linear_start`, with "
                    "stability=None."
                )
            if signal in sizes:
                hidden = n if signal == "x" else 0
                size = sizes[signal] - hidden
                columns = seen_columns(argument, signal, items, size, names.get(signal))
                columns_of[net, signal] = np.append(columns, np.zeros(hidden, bool))
    return columns_of

"""Which columns of u are measured disturbances: the option `disturbances`."""

from numbers import Integral

import numpy as np

from ..inputs import split_inputs
from ._inputs import listed, seen_columns


def check_disturbances(estimator, nu):
    """Return the columns of u that no controller moves.

    Parameters
    ----------
    estimator : estimator
        Estimator in its fit; the names of its inputs are known.
    nu : int
        Number of columns.

    Returns
    -------
    given : ndarray of int of shape (nd,)
        The columns, rising.

    Raises
    ------
    ValueError
        If a name is unknown or a number out of range, or no column is left to be
        moved.
    """
    items = estimator.disturbances
    if items is None:
        return np.empty(0, dtype=int)
    is_one = isinstance(items, str | Integral)
    items = [items] if is_one else listed("disturbances", items)
    names = getattr(estimator, "feature_names_in_", None)
    chosen = seen_columns("disturbances", "u", items, nu, names)
    return split_inputs(nu, np.flatnonzero(chosen))[1]


def checked(structure, given):
    """Return a structure, or refuse one that moves measured disturbances.

    Parameters
    ----------
    structure : Structure
        Structure that a model declares.
    given : ndarray of int of shape (nd,)
        Columns that no controller moves.

    Returns
    -------
    structure : Structure
        The same.

    Raises
    ------
    ValueError
        If the structure takes other columns for measured disturbances.
    """
    if not np.array_equal(structure.given, given):
        raise ValueError(
            f"`disturbances` must be known to the structure that `_declare` returns, "
            f"got columns {given.tolist()} where it leaves {structure.given.tolist()} "
            "unmoved. Declare an input behind the first one and name the last columns "
            "of u, as the page 'Extending' of the manual shows, or hand "
            "`self.disturbances_` on to `state_space`."
        )
    return structure

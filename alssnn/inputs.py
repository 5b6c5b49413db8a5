"""Columns of u: those that a controller moves, and disturbances that it only sees."""

import numpy as np


def split_inputs(nu, disturbances):
    """Return the columns of u that a controller moves, and those that it only sees.

    Parameters
    ----------
    nu : int
        Number of columns.
    disturbances : sequence of int
        Columns that are measured disturbances.

    Returns
    -------
    moved, given : ndarray of int
        The others, and these.

    Raises
    ------
    ValueError
        If a column is unknown, or none is left to be moved.
    """
    given = np.unique(np.array(disturbances, dtype=int))
    if len(given) and not 0 <= given[0] <= given[-1] < nu:
        raise ValueError(
            f"`disturbances` must hold columns of u, 0 to {nu - 1}, got "
            f"{list(disturbances)}."
        )
    if len(given) == nu:
        raise ValueError(
            f"`disturbances` must leave a column of u that a controller can move, got "
            f"all {nu} of them."
        )
    return np.setdiff1d(np.arange(nu), given), given


def join_inputs(moved, given, columns):
    """Return values of all inputs, of those of both kinds.

    Parameters
    ----------
    moved : ndarray of shape (..., nv)
        Values of the inputs that are moved.
    given : ndarray of shape (..., nd)
        Values of measured disturbances.
    columns : sequence of int
        Columns of the latter.

    Returns
    -------
    values : ndarray of shape (..., nv + nd)
        The values in the order of a record.
    """
    nu = moved.shape[-1] + given.shape[-1]
    rows = np.broadcast_shapes(moved.shape[:-1], given.shape[:-1])
    values = np.empty((*rows, nu), np.result_type(moved, given))
    of_moved, of_given = split_inputs(nu, columns)
    values[..., of_moved], values[..., of_given] = moved, given
    return values

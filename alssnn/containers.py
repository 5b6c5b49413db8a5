"""Containers of users: outputs come back as what they were given as."""

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from .checks import unmasked


@dataclass(frozen=True)
class Container:
    """Remember the kind of `y` that a model was fitted with.

    Parameters
    ----------
    library : {"pandas", "polars"} or None, default=None
        Library of a DataFrame or Series; None for an array.
    is_series : bool, default=False
        Whether it was a Series.
    names : tuple, default=()
        Labels of its columns, or the name of the Series.
    """

    library: str | None = None
    is_series: bool = False
    names: tuple[Any, ...] = ()

    @classmethod
    def of(cls, y):
        """Return the container of an array, DataFrame or Series.

        Parameters
        ----------
        y : array_like, DataFrame or Series
            Outputs.

        Returns
        -------
        container : Container
            Its kind; that of an array, with names of columns that are strings, if the
            library is not known.
        """
        library = type(y).__module__.partition(".")[0]
        if library not in ("pandas", "polars"):
            names = tuple(getattr(y, "columns", ()))
            return cls(names=names) if all(isinstance(z, str) for z in names) else cls()
        if hasattr(y, "columns"):
            return cls(library, False, tuple(y.columns))
        return cls(library, True, (y.name,))

    @property
    def output_names(self):
        """Return the names of the outputs as strings, None without names."""
        named = self.names and not (self.is_series and self.names[0] in (None, ""))
        return [str(name) for name in self.names] if named else None

    def wrap(self, y, index=None):
        """Return values in the container.

        Parameters
        ----------
        y : ndarray of shape (N,) or (N, ny)
            Values.
        index : pandas.Index or None, default=None
            Labels of the rows, for pandas.

        Returns
        -------
        y : ndarray, DataFrame or Series
            The same values.
        """
        if self.library is None:
            return y
        library = importlib.import_module(self.library)
        names = list(self.names)
        if self.is_series and self.library == "polars":
            return library.Series(names[0], y)
        if self.is_series:
            return library.Series(y, index=index, name=names[0])
        y = y.reshape(len(y), -1)
        if self.library == "polars":
            return library.DataFrame(y, schema=names)
        if all(isinstance(name, tuple) for name in names):
            names = library.MultiIndex.from_tuples(names)
        return library.DataFrame(y, index=index, columns=names)


def as_columns(u):
    """Return inputs with a column per signal; one signal alone may be without.

    Parameters
    ----------
    u : array_like of shape (N, nu) or (N,), DataFrame, Series, or list of records
        Inputs.

    Returns
    -------
    u : object
        The same with two dimensions, a Series as a DataFrame; anything else as it
        came.
    """
    if hasattr(u, "to_frame") and not hasattr(u, "columns"):
        return u.to_frame()
    is_plain = hasattr(u, "shape") or (isinstance(u, list | tuple) and np.ndim(u[:1]))
    flat = is_plain and np.ndim(u if hasattr(u, "shape") else u[:1]) == 1
    return np.asarray(unmasked(u))[:, None] if flat else u


def index_of(u):
    """Return the labels of the rows of a pandas DataFrame, None for anything else.

    Parameters
    ----------
    u : object
        Inputs.

    Returns
    -------
    index : pandas.Index or None
        Its index.
    """
    return u.index if type(u).__module__.partition(".")[0] == "pandas" else None


def check_rows_meet(u, y):
    """Refuse data frames whose rows say that they are other samples.

    Rows are paired by position, as in scikit-learn. Numbers that differ are usual, as
    one of two frames may have been numbered anew; dates, or another order, are not.

    Parameters
    ----------
    u, y : object
        Inputs and outputs, as they came.

    Raises
    ------
    ValueError
        If both have an index of pandas, with the same labels in another order or with
        other times.
    """
    rows, others = index_of(u), index_of(y)
    if rows is None or others is None or rows.equals(others):
        return
    if len(rows) != len(others):
        return  # the lengths say more
    if not len(rows.symmetric_difference(others, sort=False)):
        raise ValueError(
            "`u` and `y` must have their rows in the same order, got an index in "
            "another order. Take y.loc[u.index]."
        )
    if rows.dtype.kind + others.dtype.kind in ("MM", "mm"):
        raise ValueError(
            "`u` and `y` must have the same times in their index, got other ones. Use "
            "`alssnn.datasets.on_grid` for signals with time stamps of their own."
        )


def part_of(index, part):
    """Return some of the labels of rows.

    Parameters
    ----------
    index : pandas.Index or None
        Labels.
    part : slice
        Rows.

    Returns
    -------
    index : pandas.Index or None
        Labels of these rows.
    """
    return None if index is None else index[part]

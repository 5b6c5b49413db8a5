"""Signals: sums of products of matrices and the columns that they act on.

A `Signal` is what stands on the right-hand side of an equation, such as B u + B W_h w:
a sum of terms, each a product of factors in front of one axis of columns.  The factors
are parameters and constants, as they are, transposed, or a vector as a diagonal matrix;
the last one may be a vector that is computed from several parameters (`AtRest`).

A factor tells its value, and the pieces of its derivative: the parameter entries
c + i b + j of a piece move the factor by  left[:, i] right[j, :].  This is all that
`Structure` has to know of it.
"""

from dataclasses import dataclass, replace
from numbers import Real
from typing import NamedTuple

import numpy as np

from ..activations import Activation

ONE = "1"  # axis of length one: the column of Theta that carries the constants


class Piece(NamedTuple):
    """Hold a part of the derivative of a factor F.

    Parameters
    ----------
    name : str
        Parameter.
    first : int
        Place c of its entries in the parameter.
    left : ndarray of shape (n_rows of F, a) or None
        What stands before them; None for the identity.
    right : ndarray of shape (b, n_cols of F) or None
        What stands behind them; None for the identity.
    """

    name: str
    first: int
    left: np.ndarray | None
    right: np.ndarray | None


@dataclass(frozen=True)
class Factor:
    """Name a parameter or a constant; a vector stands as one column.

    Parameters
    ----------
    name : str
        Name.
    """

    name: str

    @property
    def names(self):
        """Return the names of the parameters involved."""
        return (self.name,)

    @property
    def T(self):
        """Return the transpose."""
        return Transposed(self.name)

    def value(self, p):
        """Return the matrix.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters and constants by name.

        Returns
        -------
        value : ndarray of shape (n_rows, n_cols)
            The matrix.
        """
        value = p[self.name]
        return self._matrix(value[:, None] if value.ndim == 1 else value)

    def _matrix(self, value):
        return value

    def pieces(self, p):
        """Yield the derivative of the matrix.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name; constants have no derivative.

        Yields
        ------
        piece : Piece
            Part of the derivative.
        """
        if self.name in p:
            yield from self._pieces(p[self.name].shape)

    def _pieces(self, _):
        yield Piece(self.name, 0, None, None)


class Transposed(Factor):
    """Name a matrix that stands transposed."""

    @property
    def T(self):
        """Return the matrix itself."""
        return Factor(self.name)

    def _matrix(self, value):
        return value.T

    def _pieces(self, shape):
        n_rows, n_cols = (*shape, 1)[:2]
        for i, right in enumerate(np.eye(n_rows)):  # row i of W is column i of W'
            yield Piece(self.name, i * n_cols, None, right[None])


class Diagonal(Factor):
    """Name a vector that stands as a diagonal matrix."""

    @property
    def T(self):
        """Return the matrix itself."""
        return self

    def _matrix(self, value):
        return np.diag(value[:, 0])

    def _pieces(self, shape):
        for i, one in enumerate(np.eye(*shape)):
            yield Piece(self.name, i, one[:, None], one[None])


@dataclass(frozen=True)
class AtRest:
    """Name minus the last hidden layer of a network at the operating point.

    Parameters
    ----------
    layers : tuple of tuple of str
        Names (W_i, b_i) of the hidden layers; W_1 meets a zero and is not used.
    activation : Activation
        Activation of the layers.
    """

    layers: tuple
    activation: Activation

    @property
    def names(self):
        """Return the names of the parameters involved."""
        return tuple(name for layer in self.layers for name in layer)[1:]

    def value(self, p):
        """Return the value.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name.

        Returns
        -------
        value : ndarray of shape (n, 1)
            Minus the values of the last hidden layer.
        """
        w = self.activation.value(p[self.layers[0][1]])
        for W, b in self.layers[1:]:
            w = self.activation.value(p[W] @ w + p[b])
        return -w[:, None]

    def pieces(self, p):
        """Yield the derivative of the value.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name.

        Yields
        ------
        piece : Piece
            Derivative by each parameter involved, the matrix on its left.
        """
        v, slope, jacobian = p[self.layers[0][1]], self.activation.derivative, {}
        w = self.activation.value(v)
        jacobian[self.layers[0][1]] = np.diag(slope(v, w))
        for W, b in self.layers[1:]:
            v = p[W] @ w + p[b]
            inner = {name: p[W] @ J for name, J in jacobian.items()}
            inner |= {W: np.kron(np.eye(len(v)), w), b: np.eye(len(v))}
            w = self.activation.value(v)
            jacobian = {name: slope(v, w)[:, None] * J for name, J in inner.items()}
        for name, J in jacobian.items():
            yield Piece(name, 0, -J, None)


@dataclass(frozen=True)
class Term:
    """Hold one product of a signal: gain F_1 ... F_m times the columns of an axis.

    Parameters
    ----------
    cols : str
        Axis that the product acts on: a state, an input, neurons, another signal, or
        `ONE` for a constant; nothing for a term of a matrix.
    factors : tuple of Factor or AtRest, default=()
        Factors from left to right; none for the identity.
    gain : float, default=1.0
        Number in front.
    """

    cols: str
    factors: tuple = ()
    gain: float = 1.0

    def within(self, other):
        """Return this term with another one in front.

        Parameters
        ----------
        other : Term
            Term of a matrix, or one whose columns are a signal with this term.

        Returns
        -------
        term : Term
            The product of both.
        """
        gain = other.gain * self.gain
        return Term(self.cols, other.factors + self.factors, gain)


@dataclass(frozen=True, eq=False)
class Sum:
    """Hold a sum of terms; sums of equal shapes add, numbers multiply them.

    Parameters
    ----------
    axes : tuple of str
        Axes of the entries, which say their units.
    shape : tuple of int
        Their lengths.
    terms : tuple of Term, default=()
        Terms; none for zero.
    """

    axes: tuple
    shape: tuple
    terms: tuple = ()

    __array_ufunc__ = None  # a NumPy number on the left leaves the product to __rmul__

    def __add__(self, other):
        """Return the sum."""
        if type(other) is not type(self):
            return NotImplemented
        if self.shape != other.shape:
            raise ValueError(
                "Signals or matrices that are added must have equal sizes, got "
                f"{self._sizes()} and {other._sizes()}."
            )
        return replace(self, terms=self.terms + other.terms)

    def __rmul__(self, number):
        """Return a multiple."""
        if not isinstance(number, Real):
            return NotImplemented
        terms = (replace(t, gain=float(number) * t.gain) for t in self.terms)
        return replace(self, terms=tuple(terms))

    def __neg__(self):
        """Return minus the sum."""
        return -1.0 * self

    def __sub__(self, other):
        """Return the difference."""
        return self + -other if isinstance(other, Sum) else NotImplemented

    def _sizes(self):
        names = zip(self.axes, self.shape, strict=True)
        return " by ".join(f"{size} ({axis})" for axis, size in names)


class Signal(Sum):
    """Hold a vector that changes with time, in terms of columns of Theta."""

    @property
    def axis(self):
        """Return the axis of the entries."""
        return self.axes[0]

    @property
    def size(self):
        """Return the number of entries."""
        return self.shape[0]


class Matrix(Sum):
    """Hold a matrix, to stand in front of signals; its terms have no columns."""

    @property
    def T(self):
        """Return the transpose."""
        terms = (
            replace(term, factors=tuple(factor.T for factor in reversed(term.factors)))
            for term in self.terms
        )
        return Matrix(self.axes[::-1], self.shape[::-1], tuple(terms))

    def __matmul__(self, other):
        """Return the product with a signal or another matrix."""
        if not isinstance(other, Sum):
            return NotImplemented
        if self.shape[1] != other.shape[0]:
            raise ValueError(
                f"A matrix of {self._sizes()} must meet {self.shape[1]} entries, got "
                f"{other._sizes()}."
            )
        axes, shape = self.axes[:1] + other.axes[1:], self.shape[:1] + other.shape[1:]
        terms = (term.within(left) for left in self.terms for term in other.terms)
        return type(other)(axes, shape, tuple(terms))


def diagonal(vector):
    """Return the diagonal matrix of a vector.

    Parameters
    ----------
    vector : Signal
        A parameter or constant with one axis.

    Returns
    -------
    matrix : Matrix
        The diagonal matrix.

    Raises
    ------
    ValueError
        If it is another signal.
    """
    factors = [factor for term in vector.terms for factor in term.factors]
    if vector.terms != (Term(ONE, tuple(factors[:1])),):
        raise ValueError("`vector` must be a parameter or constant with one axis.")
    term = Term("", (Diagonal(factors[0].name),))
    return Matrix(2 * vector.axes, 2 * vector.shape, (term,))

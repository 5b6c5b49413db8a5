"""The direct derivative of [x+; z] as a table of products of gains and signals."""

from typing import NamedTuple

import numpy as np

from ..kernels import CONSTANT, DIAGONAL, FOUR, VARYING


class Direct(NamedTuple):
    """Hold G and D of (eq. sens) as products, for `kernels.differentiate`.

    Parameters
    ----------
    table : ndarray of int of shape (n_products, 8)
        What the kernel is told of every product.
    constants : ndarray of shape (nx + nz, n_constants)
        Gains of parameters outside the neurons; the first column scales the rows.
    gain_map : ndarray of shape (nw, n_gains)
        Gains of parameters inside the neurons, by the gains of the neurons.
    signal_map : ndarray of shape (nx + nu + nw + 1, n_signals)
        Signals, by the regressors.
    """

    table: np.ndarray
    constants: np.ndarray
    gain_map: np.ndarray
    signal_map: np.ndarray

    def factors(self, Phi, WR):
        """Return the gains and signals of some samples.

        Parameters
        ----------
        Phi : ndarray of shape (L, nx + nu + nw + 1)
            Regressors.
        WR : ndarray of shape (L, nx + nz, nw)
            Derivative of [x+; z] by the neurons' inputs v, scaled like the rows.

        Returns
        -------
        gains : ndarray of shape (L, nx + nz, n_gains)
            Left factors.
        signals : ndarray of shape (L, n_signals)
            Right factors.
        """
        L, n_rows, nw = WR.shape
        if self.gain_map.shape[1] > nw:  # else they are those of the neurons
            own = (WR.reshape(-1, nw) @ self.gain_map[:, nw:]).reshape(L, n_rows, -1)
            WR = np.concatenate([WR, own], axis=2)
        n = Phi.shape[1]
        if self.signal_map.shape[1] > n:
            Phi = np.hstack([Phi, Phi @ self.signal_map[:, n:]])
        return WR, Phi

    def by(self, free):
        """Return the derivatives by some of the parameters alone.

        Parameters
        ----------
        free : ndarray of bool of shape (n_params,)
            Whether the derivative by a parameter is wanted.

        Returns
        -------
        direct : Direct
            The same with a column for each of these.
        """
        column, table = np.cumsum(free) - 1, []
        for start, stop, c, a, b, g, s, kind in self.table:
            wanted = free[c : c + a * b].reshape(a, b)
            if wanted.all():
                table.append((start, stop, column[c], a, b, g, s, kind))
                continue
            # row by row, as many products as there are runs of wanted entries
            kind = VARYING if kind == FOUR else kind
            for i, row in enumerate(wanted):
                span = (start + i, start + i + 1) if kind == DIAGONAL else (start, stop)
                edges = np.flatnonzero(np.diff(row, prepend=False, append=False))
                for j, end in edges.reshape(-1, 2):
                    place = column[c + i * b + j]
                    table.append((*span, place, 1, end - j, g + i, s + j, kind))
        return self._replace(table=np.array(table, dtype=np.int64).reshape(-1, 8))


def direct(structure, p, scale):
    """Return the direct derivative of [x+; z] (eq. sens) as products.

    Direct means: at fixed states, so without the path through earlier samples.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    p : dict of str to ndarray
        Its parameters.
    scale : ndarray of shape (nx + nz,)
        Weight of every row.

    Returns
    -------
    direct : Direct
        What holds at all samples; the kernel makes the rest.
    """
    n_phi = structure.nx + structure.nu + structure.nw + 1
    products = Products(scale, structure.nw, n_phi)
    for rows, cols, column, before, after in _pieces(structure, p):
        products.add(rows, column, before, products.signal(cols, after))
    return products.direct()


def pull(structure, theta, by_Theta):
    """Return the gradient by theta of what has a gradient by Theta.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    theta : ndarray of shape (n_params,)
        Its parameters.
    by_Theta : ndarray of shape (nx + nz + nw, nx + nu + nw + 1)
        Gradient by the entries of Theta.

    Returns
    -------
    gradient : ndarray of shape (n_params,)
        Gradient by the parameters.
    """
    gradient = np.zeros(structure.n_params)
    pieces = _pieces(structure, structure.split(theta))
    for rows, cols, column, before, after in pieces:
        block = product([None if before is None else before.T, by_Theta[rows, cols]])
        block = product([block, None if after is None else after.T])
        gradient[column : column + block.size] += block.ravel()
    return gradient


def _pieces(structure, p):
    """Yield the derivative of Theta: rows, columns, place in theta, before and after.

    The entries of theta from that place on, in rows i and columns j, move the block of
    Theta by ``before[:, i]`` times ``after[j]``; None is the identity.
    """
    known = {**structure.constants, **p}
    for axis, term in structure.terms:
        rows, cols = structure.rows[axis], structure.cols[term.cols]
        values = [factor.value(known) for factor in term.factors]
        for i, factor in enumerate(term.factors):
            before, after = product(values[:i]), product(values[i + 1 :])
            if term.gain != 1.0:
                identity = np.eye(cols.stop - cols.start)
                after = term.gain * (identity if after is None else after)
            for name, first, left, right in factor.pieces(p):
                place = structure.slices[name].start + first
                pair = product([before, left]), product([right, after])
                yield rows, cols, place, *pair


class Products:
    """Collect products, and make a `Direct` of them.

    Parameters
    ----------
    scale : ndarray of shape (nx + nz,)
        Weight of every row of [x+; z].
    nw : int
        Number of neurons.
    n_phi : int
        Number of regressors.
    """

    def __init__(self, scale, nw, n_phi):
        self.scale = scale
        self.table = []
        self.constants = [scale[:, None]]
        self.gains, self.signals = [np.eye(nw)], [np.eye(n_phi)]

    def signal(self, cols, after):
        """Return place and length of a signal.

        Parameters
        ----------
        cols : slice
            Regressors that it sees.
        after : ndarray of shape (b, n_cols) or None
            What stands behind the parameter; None for the regressors themselves.

        Returns
        -------
        signal : tuple of int
            Place and length.
        """
        if after is None:
            return cols.start, cols.stop - cols.start
        return _append(self.signals, cols, after.T), len(after)

    def add(self, rows, column, before, signal):
        """Add a parameter, or some of its entries.

        Parameters
        ----------
        rows : slice
            Rows of Theta that its term adds to.
        column : int
            Place of the first entry in theta.
        before : ndarray of shape (n_rows, a) or None
            What stands before it; None for nothing.
        signal : tuple of int
            Place and length of its signal.
        """
        n_rows, n = len(self.scale), rows.stop - rows.start
        a, span = n if before is None else before.shape[1], (rows.start, rows.stop)
        if rows.start >= n_rows:  # inside a neuron: moves every row
            neurons, span = slice(rows.start - n_rows, rows.stop - n_rows), (0, n_rows)
            kind, place = VARYING, neurons.start
            if before is not None:
                place = _append(self.gains, neurons, before)
        elif before is not None:
            kind = CONSTANT
            place = _append(self.constants, rows, self.scale[rows, None] * before)
        else:  # the parameter [a, b] moves row a alone
            kind, place = DIAGONAL, 0
        s, b = signal
        self.table.append((*span, column, a, b, place, s, kind))

    def direct(self):
        """Return all products.

        Returns
        -------
        direct : Direct
            For the kernel.
        """
        table = np.array(_in_fours(self.table), dtype=np.int64).reshape(-1, 8)
        return Direct(
            table, *map(np.hstack, (self.constants, self.gains, self.signals))
        )


def product(matrices):
    """Return the product of matrices.

    Parameters
    ----------
    matrices : iterable of ndarray or None
        Matrices; None is the identity.

    Returns
    -------
    product : ndarray or None
        Their product; None of none.
    """
    value = None
    for matrix in matrices:
        if matrix is not None:
            value = matrix if value is None else value @ matrix
    return value


def _in_fours(table):
    """Return a table whose products of the same entries stand in fours, if so many."""
    same: dict[tuple, list] = {}
    for product in table:
        *_, kind = product
        same.setdefault((*product[:5], kind), []).append(product)
    ordered = []
    for (*_, kind), products in same.items():
        if kind == VARYING:
            for i in range(0, len(products) - 3, 4):
                products[i] = (*products[i][:-1], FOUR)
        ordered += products
    is_any = any(product[-1] == FOUR for product in ordered)
    return ordered if is_any else table  # else in the order of the terms


def _append(blocks, rows, block):
    """Append columns that are zero but for some rows; return their place."""
    whole = np.zeros((len(blocks[0]), block.shape[1]))
    whole[rows] = block
    place = sum(b.shape[1] for b in blocks)
    blocks.append(whole)
    return place

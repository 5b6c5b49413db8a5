"""The direct derivative of [x+; z] as sheets of products of gains and signals."""

from typing import NamedTuple

import numpy as np


class Direct(NamedTuple):
    """Hold G and D of (eq. sens) as sheets, for `kernels.differentiate`.

    The derivative of a row of [x+; z] by a parameter is a sum of products of a
    constant, a gain and a signal. A sheet holds one product for each of some columns
    that follow each other.

    Parameters
    ----------
    table : ndarray of int of shape (n_sheets, 6)
        What the kernel is told of every sheet.
    weights : ndarray of shape (nx + nz, n_entries)
        Constants by row, where the gains are the same for all rows.
    gain_of : ndarray of unsigned int of shape (n_entries,)
        Number of the gain; the last one is 1, for parameters outside the neurons.
    signal_of : ndarray of unsigned int of shape (n_entries,)
        Number of the signal.
    gain_map : ndarray of shape (nw, n_gains - 1)
        Gains of parameters inside the neurons, by the gains of the neurons.
    signal_map : ndarray of shape (nx + nu + nw + 1, n_signals)
        Signals, by the regressors.
    """

    table: np.ndarray
    weights: np.ndarray
    gain_of: np.ndarray
    signal_of: np.ndarray
    gain_map: np.ndarray
    signal_map: np.ndarray

    @property
    def sheets(self):
        """Return what the kernel is told, the same for all samples."""
        return self.table, self.weights, self.gain_of, self.signal_of

    @property
    def varies(self):
        """Return whether the gains of a sheet differ from row to row."""
        return bool(self.table[:, -1].any())

    def factors(self, Phi, gains):
        """Return the gains and signals of some samples.

        Parameters
        ----------
        Phi : ndarray of shape (L, nx + nu + nw + 1)
            Regressors.
        gains : ndarray of shape (L, nx + nz, nw) or (L, 1, nw)
            Derivative of [x+; z] by the neurons' inputs v, scaled like the rows; where
            no sheet varies, the slopes of the neurons.

        Returns
        -------
        gains : ndarray of shape (L, nx + nz or 1, n_gains)
            Left factors.
        signals : ndarray of shape (L, n_signals)
            Right factors.
        """
        L, n_rows, nw = gains.shape
        own = self.gain_map[:, nw:]  # sums of those of the neurons
        own = (gains.reshape(L * n_rows, nw) @ own).reshape(L, n_rows, own.shape[1])
        n = Phi.shape[1]
        if self.signal_map.shape[1] > n:
            Phi = np.hstack([Phi, Phi @ self.signal_map[:, n:]])
        return np.concatenate([gains, own, np.ones((L, n_rows, 1))], axis=2), Phi

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
        wanted = [free[first:end] for _, _, first, end, *_ in self.table]
        kept = np.concatenate([np.zeros(0, dtype=bool), *wanted])
        column, place = (np.append(0, np.cumsum(which)) for which in (free, kept))
        table = self.table.copy()
        table[:, 2:4], table[:, 4] = column[table[:, 2:4]], place[table[:, 4]]
        entries = self.weights[:, kept], self.gain_of[kept], self.signal_of[kept]
        return Direct(table, *entries, self.gain_map, self.signal_map)


def direct(structure, p, scale, W=None):
    """Return the direct derivative of [x+; z] (eq. sens) as sheets.

    Direct means: at fixed states, so without the path through earlier samples.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    p : dict of str to ndarray
        Its parameters.
    scale : ndarray of shape (nx + nz,)
        Weight of every row.
    W : ndarray of shape (nx + nz, nw) or None, default=None
        Output weights of neurons that do not see each other, scaled like the rows: the
        gains of all rows are then multiples of the slopes. None if they do.

    Returns
    -------
    direct : Direct
        What holds at all samples; the kernel makes the rest.
    """
    n_phi = structure.nx + structure.nu + structure.nw + 1
    products = Products(scale, structure.nw, n_phi)
    for rows, cols, column, before, after in _pieces(structure, p):
        products.add(rows, cols, column, before, after)
    return products.direct(W)


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


class Product(NamedTuple):
    """Hold the direct derivatives by parameters (i, j) from a place in theta on.

    Parameters
    ----------
    rows : slice
        Rows of [x+; z] that they move.
    column : int
        That place.
    shape : tuple of int
        Numbers a and b of values of i and j.
    weights : ndarray of shape (n_rows, a) or None
        Constants of the parameters i; None inside the neurons.
    gain : int or None
        Number of the gain of i = 0; None outside the neurons.
    cols : slice
        Regressors that are seen.
    after : ndarray of shape (b, n_cols) or None
        Signals of the parameters j, by these; None for themselves.
    """

    rows: slice
    column: int
    shape: tuple
    weights: np.ndarray | None
    gain: int | None
    cols: slice
    after: np.ndarray | None

    def signal(self, n_phi):
        """Return the signals by all regressors.

        Parameters
        ----------
        n_phi : int
            Number of regressors.

        Returns
        -------
        signal : ndarray of shape (n_phi, b)
            One column for each.
        """
        whole = np.zeros((n_phi, self.shape[1]))
        whole[self.cols] = np.eye(self.shape[1]) if self.after is None else self.after.T
        return whole

    @property
    def end(self):
        """Return the place behind them."""
        return self.column + self.shape[0] * self.shape[1]


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
        self.scale, self.nw, self.n_phi = scale, nw, n_phi
        self.products: dict[tuple, Product] = {}
        self.gains = [np.eye(nw)]

    def add(self, rows, cols, column, before, after):
        """Add a parameter, or some of its entries.

        Parameters
        ----------
        rows, cols : slice
            Rows and columns of Theta that its term adds to.
        column : int
            Place of the first entry in theta.
        before : ndarray of shape (n_rows, a) or None
            What stands before it; None for nothing.
        after : ndarray of shape (b, n_cols) or None
            What stands behind it; None for nothing.
        """
        n_rows, gain, weights = len(self.scale), None, None
        a = rows.stop - rows.start if before is None else before.shape[1]
        b = cols.stop - cols.start if after is None else len(after)
        if rows.start >= n_rows:  # inside a neuron: moves every row
            neurons = slice(rows.start - n_rows, rows.stop - n_rows)
            rows, gain = slice(0, n_rows), neurons.start
            if before is not None:
                gain = _append(self.gains, neurons, before)
        else:
            scale = self.scale[rows]
            weights = np.diag(scale) if before is None else scale[:, None] * before
        # a parameter may stand before a sum, in several terms: B (u + h)
        known = None if weights is None else weights.tobytes()
        key = rows.start, rows.stop, column, a, b, gain, known
        of = rows, column, (a, b), weights, gain
        new, old = Product(*of, cols, after), self.products.get(key)
        if old is not None:
            both = new.signal(self.n_phi) + old.signal(self.n_phi)
            new = Product(*of, slice(self.n_phi), both.T)
        self.products[key] = new

    def direct(self, W):
        """Return all products.

        Parameters
        ----------
        W : ndarray of shape (nx + nz, nw) or None
            Output weights of neurons that do not see each other; None if they do.

        Returns
        -------
        direct : Direct
            For the kernel.
        """
        gain_map, signals = np.hstack(self.gains), [np.eye(self.n_phi)]
        n_gains, n_signals = gain_map.shape[1], self.n_phi
        if n_gains > self.nw:  # sums of the gains of neurons
            W = None
        products = list(self.products.values())
        n = sum(product.end - product.column for product in products)
        weights = np.zeros((len(self.scale), n))
        # unsigned: compiled loops need not ask whether they count from the end
        gain_of, signal_of = np.empty((2, n), dtype=np.uintp)
        told, at = [], 0
        for sheet in _sheets(products):
            rows, first, gain = sheet[0].rows, sheet[0].column, sheet[0].gain
            varies, start = W is None and gain is not None, at
            for product in sheet:
                (a, b), gain, place = product.shape, product.gain, product.cols
                part = slice(at, at + a * b)
                at = part.stop
                if product.after is not None:
                    signals.append(product.signal(self.n_phi))
                    place = slice(n_signals, n_signals + b)
                    n_signals += b
                signal_of[part].reshape(a, b)[:] = np.arange(place.start, place.stop)
                if gain is None:
                    gain_of[part], own = n_gains, product.weights
                else:
                    gains = np.arange(gain, gain + a)
                    gain_of[part] = gains.repeat(b)
                    own = None if varies else W[:, gains]
                if own is not None:
                    weights[rows, part] = own.repeat(b, axis=1)
            span = first, first + at - start
            told.append((rows.start, rows.stop, *span, start, varies))
        table = np.array(told, dtype=np.int64).reshape(-1, 6)
        signal_map = np.hstack(signals)
        return Direct(table, weights, gain_of, signal_of, gain_map, signal_map)


def _sheets(products):
    """Return lists of products of the same rows and kind, column behind column."""
    sheets: list[list[Product]] = []
    ends: dict[tuple, list[Product]] = {}
    for product in sorted(products, key=lambda product: product.column):
        kind = product.rows.start, product.rows.stop, product.gain is None
        sheet = ends.pop((kind, product.column), None)
        if sheet is None:
            sheets.append(sheet := [])
        sheet.append(product)
        ends[kind, product.end] = sheet  # one that ended here before does not go on
    return sheets


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


def _append(blocks, rows, block):
    """Append columns that are zero but for some rows; return their place."""
    whole = np.zeros((len(blocks[0]), block.shape[1]))
    whole[rows] = block
    place = sum(b.shape[1] for b in blocks)
    blocks.append(whole)
    return place

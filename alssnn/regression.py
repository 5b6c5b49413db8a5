"""Tall regressions, row block by row block.

A least-squares problem is known by the triangular factor R of its columns.  It takes
memory for the columns, not for the record: blocks of rows are factored together with
the factor of those before them.
"""

import numpy as np

CHUNK = 20_000  # rows of a regression treated at a time
ENTRIES = 4_000_000  # of a block of rows: about 32 MB


def lagged(z, lags):
    """Return the past of signals.

    Parameters
    ----------
    z : ndarray of shape (N, n)
        Signals.
    lags : sequence of int
        Lags, not negative.

    Returns
    -------
    past : ndarray of shape (N, len(lags) * n)
        ``z[k - lag]``, lag by lag; nan before the first sample.
    """
    past = np.full((len(z), len(lags), z.shape[1]), np.nan)
    for i, lag in enumerate(lags):
        past[lag:, i] = z[: max(0, len(z) - lag)]
    return past.reshape(len(z), -1)


def complete(blocks):
    """Yield the rows of blocks that hold no nan.

    Parameters
    ----------
    blocks : iterable of ndarray of shape (L, n)
        Rows.

    Yields
    ------
    block : ndarray of shape (at most L, n)
        Complete rows.
    """
    for block in blocks:
        yield block[np.isfinite(block).all(axis=1)]


class Triangle:
    """Hold the factor R of rows that come block by block, and their number.

    Parameters
    ----------
    n_columns : int
        Number of columns.

    Examples
    --------
    >>> from alssnn.regression import Triangle
    >>> rows = np.random.default_rng(0).standard_normal((50, 3))
    >>> triangle = Triangle(3)
    >>> triangle.add(rows[:20]), triangle.add(rows[20:])
    (None, None)
    >>> R = triangle.factor()
    >>> np.allclose(R.T @ R, rows.T @ rows), triangle.n_rows
    (True, 50)
    """

    def __init__(self, n_columns):
        self.n_rows = 0
        self._R = np.zeros((0, n_columns))
        self._waiting = []
        # a factorization repeats the work on R: blocks should be longer than that
        self._enough = max(4 * n_columns, min(CHUNK, ENTRIES // n_columns))

    def add(self, block):
        """Add rows.

        Parameters
        ----------
        block : ndarray of shape (L, n_columns)
            Rows; those with nan do not count.
        """
        (rows,) = complete([block])
        self.n_rows += len(rows)
        for start in range(0, len(rows), self._enough):
            self._waiting.append(rows[start : start + self._enough])
            if sum(map(len, self._waiting)) >= self._enough:
                self.factor()

    def add_triangle(self, R, n_rows):
        """Add the factor of other rows.

        Parameters
        ----------
        R : ndarray of shape (m, n_columns)
            Factor.
        n_rows : int
            Number of rows that it stands for.
        """
        self.add(R)
        self.n_rows += n_rows - len(R)

    def factor(self):
        """Return the factor of all rows so far.

        Returns
        -------
        R : ndarray of shape (n_columns, n_columns)
            Upper triangle, with rows of zeros where there are too few.
        """
        R = np.asarray(np.linalg.qr(np.vstack([self._R, *self._waiting]), mode="r"))
        n = R.shape[1]
        self._R = np.vstack([R, np.zeros((n - len(R), n))])
        self._waiting = []
        return self._R

"""Regression of whitened residuals on what they must not depend on (eq. residuals).

Estimated parameters are wrong by some delta, which leaves r = e - J delta for the noise
e and the sensitivities J of the simulation.  Behind the whitening filter a(q)
(eq. nuisance),

    r_w = e_w - (a(q) J) delta:

an F-test of regressors that come *after* the columns a(q) J, and so count only by what
is orthogonal to them, does not know delta.  It needs no covariance of delta, and
therefore holds on the training data and on others, for efficient estimates and for
those of the simulation error in colored noise.  The sensitivities by the initial state
of an experiment live on its rows alone: they are eliminated experiment by experiment.

All of it is one QR factorization, row block by row block: memory grows with the number
of columns, not with the record.
"""

import numpy as np
from scipy.stats import f

CHUNK = 20_000  # rows of a regression treated at a time
ENTRIES = 4_000_000  # of a block of rows: about 32 MB
RANK_TOL = 1e-8  # share of a column below which the others explain it


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
        past[lag:, i] = z[: len(z) - lag]
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
    >>> from alssnn.validation._regression import Triangle
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


def regress(white, filters, blocks, sensitivities=None):
    """Return p-values and explained shares of blocks of regressors (eq. residuals).

    Parameters
    ----------
    white : list of list of ndarray of shape (N,)
        Whitened residuals, per output and experiment; nan does not count.
    filters : list of ndarray of shape (p,)
        Coefficients a of the whitening filters 1 - a_1 q^-1 - ..., per output.
    blocks : list of tuple (list of ndarray of shape (N, n), sequence of int)
        Signals per experiment and their lags, block by block.
    sensitivities : sequence of callable or None, default=None
        Per experiment, a function that yields (J, J_x0) of consecutive samples: the
        derivatives (L, ny, n) of the outputs by parameters that were estimated, and
        (L, ny, nx) by the initial state. None takes the model for exact.

    Returns
    -------
    results : list of tuple
        Per output the lists p and share: of the sensitivities, then of the blocks.
    """
    ny, n_experiments = len(white), len(white[0])
    sizes = [z[0].shape[1] * len(lags) for z, lags in blocks]
    totals: list = [None] * ny
    n_free, spent = 0, np.zeros(ny, dtype=int)
    for i in range(n_experiments):
        N = len(white[0][i])
        before = [lagged(z[i], lags) for z, lags in blocks]
        past = np.hstack([np.ones((N, 1)), *before])
        parts = _exact(N, ny) if sensitivities is None else sensitivities[i]()
        triangles: list = [None] * ny
        for j, k, J_w, n_x0 in _whitened(parts, filters):
            n_free = J_w.shape[1] - n_x0
            rows = np.hstack([J_w, past[k], white[j][i][k, None]])
            if triangles[j] is None:
                triangles[j] = Triangle(rows.shape[1])
            triangles[j].add(rows)
        for j, triangle in enumerate(triangles):
            R = triangle.factor()
            n_x0 = R.shape[1] - 2 - n_free - sum(sizes)
            if totals[j] is None:
                totals[j] = Triangle(R.shape[1] - n_x0)
            R, known = _independent(R, n_x0)
            n_known = int(known.sum())
            spent[j] += n_known
            totals[j].add_triangle(R[n_known:, n_known:], triangle.n_rows)
    return [
        _f_tests(t.factor(), t.n_rows - int(s), n_free, sizes)
        for t, s in zip(totals, spent, strict=True)
    ]


def _exact(N, ny):
    """Yield the sensitivities of a model without an error, chunk by chunk."""
    for start in range(0, N, CHUNK):
        nothing = np.zeros((min(CHUNK, N - start), ny, 0))
        yield nothing, nothing


def _whitened(parts, filters):
    """Yield (output, samples, a(q) [J_x0, J], number of columns of J_x0)."""
    order = max(len(a) for a in filters)
    before, start = None, 0
    for J, J_x0 in parts:
        both = np.concatenate([J_x0, J], axis=2)
        if before is None:  # the first samples of r_w are nan: any past will do
            before = np.zeros((order, *both.shape[1:]))
        L, both = len(both), np.concatenate([before, both])
        for j, a in enumerate(filters):
            J_w = both[order:, j].copy()
            for lag, a_lag in enumerate(a, start=1):
                J_w -= a_lag * both[order - lag : order - lag + L, j]
            yield j, slice(start, start + L), J_w, J_x0.shape[2]
        before, start = both[L:].copy(), start + L


def _independent(R, n):
    """Return R without those of its first n columns that others before explain.

    Also which of them are left.  Without a second factorization, each would take a
    direction of rounding out of the columns behind it.
    """
    counts = np.abs(np.diag(R)) > RANK_TOL * np.linalg.norm(R, axis=0)
    counts[n:] = True
    return np.linalg.qr(R[:, counts], mode="r"), counts[:n]


def _f_tests(R, n_rows, n_free, sizes):
    """Return p-values and shares: of the sensitivities, then of every block."""
    R, counts = _independent(R, len(R) - 1)
    squares = R[:-1, -1] ** 2
    sizes = [n_free, 1, *sizes]
    ends = np.cumsum([np.sum(part) for part in _cut(counts, sizes)])
    explained = np.array([part.sum() for part in np.split(squares, ends[:-1])])
    variance = np.sum(squares) + R[-1, -1] ** 2 - explained[1]  # without a constant
    variance = max(variance, np.finfo(float).tiny)
    p, share = [], []
    left, dof = variance, n_rows - 1
    for i, d in enumerate(np.diff(ends, prepend=0)):
        if i == 1:
            continue
        left, dof = left - explained[i], dof - d
        left = max(left, np.finfo(float).eps * variance)  # all but rounding explained
        p.append(f.sf(explained[i] / d / (left / dof), d, dof) if d else 1.0)
        share.append(explained[i] / variance)
    return p, share


def _cut(z, sizes):
    return np.split(z, np.cumsum(sizes)[:-1])

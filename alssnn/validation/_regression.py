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

All of it is one factorization (`regression.Triangle`): memory grows with the number of
columns, not with the record.
"""

import numpy as np
from scipy.stats import f

from ..regression import CHUNK, Triangle, lagged

RANK_TOL = 1e-8  # share of a column below which the others explain it


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
    totals: dict = {}
    n_free, n_x0, spent = 0, 0, np.zeros(ny, dtype=int)
    for i in range(n_experiments):
        N = len(white[0][i])
        before = [lagged(z[i], lags) for z, lags in blocks]
        past = np.hstack([np.ones((N, 1)), *before])
        parts = _exact(N, ny) if sensitivities is None else sensitivities[i]()
        triangles: dict = {}
        for j, k, J_w, n_x0 in _whitened(parts, filters):
            n_free = J_w.shape[1] - n_x0
            rows = np.hstack([J_w, past[k], white[j][i][k, None]])
            triangles.setdefault(j, Triangle(rows.shape[1])).add(rows)
        for j, triangle in triangles.items():
            R, known = _independent(triangle.factor(), n_x0)
            n_known = int(known.sum())
            spent[j] += n_known
            R = R[n_known:, n_known:]
            totals.setdefault(j, Triangle(R.shape[1])).add_triangle(R, triangle.n_rows)
    return [
        _f_tests(total.factor(), total.n_rows - int(spent[j]), n_free, sizes)
        for j, total in totals.items()
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

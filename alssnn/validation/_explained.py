"""How much of a residual its inputs explain, on samples that were left out.

The p-values of `_residuals` ask whether a residual depends on u beyond what errors of
the parameters do to it.  A model with many parameters is granted much by this, a wrong
one, too.  So here is the size, with nothing granted and nothing whitened: r is
regressed on the same blocks, in five parts of every experiment, each predicted from the
others,

    share = 1 - |r - r_predicted|^2 / |r - mean|^2.

Noise of any color is not predicted: the share of a right model is negative or small,
even with more regressors than the record bears.
"""

import numpy as np

from ..regression import CHUNK, lagged

FOLDS = 5
RCOND = 1e-10  # of the normal equations: columns that others explain are dropped


def explained_shares(r, blocks):
    """Return the cross-validated share of a residual that blocks explain.

    Parameters
    ----------
    r : list of ndarray of shape (N,)
        Residual per experiment; nan where it is not known.
    blocks : list of tuple (list of ndarray of shape (N, n), sequence of int)
        Signals per experiment and their lags, block by block.

    Returns
    -------
    shares : ndarray of shape (n_blocks,)
        What each block adds to the blocks before it, from 0 to 1; 0 where it predicts
        nothing.
    """
    sizes = [z[0].shape[1] * len(lags) for z, lags in blocks]
    n = 2 + sum(sizes)
    grams = np.zeros((FOLDS, n, n))
    for i, r_i in enumerate(r):
        past = [lagged(z[i], lags) for z, lags in blocks]
        rows = np.hstack([np.ones((len(r_i), 1)), *past, r_i[:, None]])
        for fold, part in enumerate(np.array_split(rows, FOLDS)):
            known = part[np.isfinite(part).all(axis=1)]
            for start in range(0, len(known), CHUNK):
                chunk = known[start : start + CHUNK]
                grams[fold] += chunk.T @ chunk
    total = grams.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
    grams, total = grams / np.outer(scale, scale), total / np.outer(scale, scale)
    ends = 1 + np.cumsum([0, *sizes])
    errors = np.array([_left_out(grams, total, end) for end in ends])
    if not errors[0] > 0:
        return np.zeros(len(blocks))
    known = np.minimum.accumulate(errors) / errors[0]
    return -np.diff(known)


def _left_out(grams, total, end):
    """Return the sum of squares of the folds, each predicted from the others."""
    error = 0.0
    for gram in grams:
        rest = total - gram
        b = np.linalg.lstsq(rest[:end, :end], rest[:end, -1], rcond=RCOND)[0]
        error += gram[-1, -1] - 2 * b @ gram[:end, -1] + b @ gram[:end, :end] @ b
    return max(error, 0.0)

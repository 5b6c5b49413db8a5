r"""Is the plant nonlinear?  A test for records of any kind (eq. reset).

An output is regressed on its past and on that of all inputs,

    y_k = sum_i a_i y_(k-i) + sum_i b_i u_(k-i) + c + e_k,

which says all that a linear plant and its noise have to say, if there are enough lags.
If the plant is linear, then no function of the past predicts e.  Asked are squares and
cubes of what the regression predicts, p, and of the part of the inputs in it, q.
"""

import numpy as np
from scipy.special import fdtrc

from ..experiments import stretch
from ..nonparametric.records import Records
from ..regression import complete, lagged

LAGS = 30  # of every signal, at most
BEFORE = 10  # lags before an input arrives
PER_UNKNOWN = 6  # samples per unknown, at least
TESTED = 50_000  # samples, at most
INDEPENDENT = 1e-6  # relative size of what a power adds to the others


def nonlinearity(u, y, experiment=None):
    """Test whether the plant of a record is nonlinear (eq. reset).

    Parameters
    ----------
    u : array_like of shape (N, nu) or (N,), list of them, or Excitation
        Inputs of all experiments.
    y : array_like of shape (N, ny) or (N,), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    p_value : float
        How likely a linear plant gives such a record; small values speak against one.
        Nan if there are too few samples.
    share : float
        The largest share of the one-step errors of an output that the powers explain.

    Raises
    ------
    ValueError
        If the signals are no records, or do not fit each other.

    Notes
    -----
    It sees curves of what a linear model predicts, not of inputs that have no linear
    effect. What a linear plant shows of an input more than 30 samples late, coarse
    steps of a converter, and noise whose size depends on the signals may count as
    nonlinear. `look` lets the test begin where the inputs arrive.

    Costs O(N (30 (nu + ny))^2), of 50,000 samples at most.

    Examples
    --------
    >>> from alssnn.first_look import nonlinearity
    >>> u = np.random.default_rng(0).standard_normal(1000)
    >>> x = np.r_[0, u[:-1]]
    >>> y = x + 0.1 * np.random.default_rng(1).standard_normal(1000)
    >>> p_linear, _ = nonlinearity(u, y)
    >>> p_square, _ = nonlinearity(u, y + 0.1 * x**2)
    >>> bool(p_linear > 0.05), bool(p_square < 1e-6)
    (True, True)
    """
    records = Records.of(u, y, experiment)
    pairs = stretch(records.pairs, TESTED)
    samples = sum(int(np.isfinite(y).all(axis=1).sum()) for _, y in pairs)
    lags = min(LAGS, samples // (PER_UNKNOWN * (records.ny + records.nu)))
    if lags < 1:
        return np.nan, np.nan
    rows = [np.hstack([y, _past(u, y, lags)]) for u, y in scaled(pairs)]
    data = np.concatenate(list(complete(rows)))
    ny, n = records.ny, data.shape[1] - records.ny
    if len(data) < PER_UNKNOWN * n / 2:
        return np.nan, np.nan
    X = np.column_stack([data[:, ny:], np.ones(len(data))])
    Q, R = np.linalg.qr(X)
    # of a smooth input each lag adds little to those before it, and all much to the
    # first ones: what counts is left in a few directions of all of them
    turn, values, _ = np.linalg.svd(R)
    Q = Q @ turn[:, values > INDEPENDENT * values[0]]
    p_values, shares = [], []
    for y in data[:, :ny].T:
        predicted = Q @ (Q.T @ y)
        by_inputs = X[:, ny * lags : n] @ np.linalg.lstsq(X, y)[0][ny * lags : n]
        p_value, share = _powers(y - predicted, predicted, by_inputs, Q)
        p_values.append(p_value)
        shares.append(share)
    # Bonferroni: one of several outputs is enough
    return float(min(1.0, ny * min(p_values))), float(max(shares))


def arrived(pairs, delays):
    """Return pairs with inputs as they arrive, but for a few samples.

    Parameters
    ----------
    pairs : list of tuple of ndarray
        Pairs (u, y).
    delays : ndarray of int of shape (nu,) or None
        Samples by which the inputs arrive late; None if they are not known.

    Returns
    -------
    u, y : list of ndarray
        Signals of the experiments that are long enough, without their first samples.
    """
    late = np.zeros(1, int) if delays is None else np.maximum(delays - BEFORE, 0)
    first = late.max()
    if first:
        pairs = [
            (
                np.column_stack(
                    [z[first - d : len(z) - d] for z, d in zip(u.T, late, strict=True)]
                ),
                y[first:],
            )
            for u, y in pairs
            if len(u) > first
        ]
    return [u for u, _ in pairs], [y for _, y in pairs]


def scaled(pairs):
    """Return pairs without units.

    Parameters
    ----------
    pairs : list of tuple of ndarray
        Pairs (u, y); y is nan where it was not measured.

    Returns
    -------
    pairs : list of tuple of ndarray
        The same with columns of zero mean and unit variance; of zeros at rest.
    """
    u, y = (np.concatenate(z) for z in zip(*pairs, strict=True))
    u_mean, y_mean = u.mean(axis=0), np.nanmean(y, axis=0)
    u_scale, y_scale = u.std(axis=0), np.nanstd(y, axis=0)
    u_scale, y_scale = (np.where(s > 0, s, 1.0) for s in (u_scale, y_scale))
    return [((u - u_mean) / u_scale, (y - y_mean) / y_scale) for u, y in pairs]


def _past(u, y, lags):
    """Return the regressors of all samples, outputs first; nan if one is missing."""
    return np.hstack([lagged(y, range(1, lags + 1)), lagged(u, range(lags + 1))])


def _powers(e, p, q, Q):
    """Return the p-value of an F test of powers of p and q, and what they explain."""
    Z = np.column_stack([p**2, p**3, q**2, q**3, p * q, p**2 * q, p * q**2])
    size = Z.std(axis=0)
    Z = Z / np.where(size > 0, size, 1.0)
    Z -= Q @ (Q.T @ Z)
    left, values, _ = np.linalg.svd(Z, full_matrices=False)
    left = left[:, values > INDEPENDENT * max(values[0], np.sqrt(len(e)))]
    k = left.shape[1]
    freedom = len(e) - Q.shape[1] - k
    explained, all_of_it = np.sum((left.T @ e) ** 2), np.sum(e**2)
    if not k or all_of_it <= (INDEPENDENT**2) * len(e):  # nothing left to explain
        return 1.0, 0.0
    F = (explained / k) / ((all_of_it - explained) / freedom)  # (eq. reset)
    return float(fdtrc(k, freedom, F)), float(explained / all_of_it)

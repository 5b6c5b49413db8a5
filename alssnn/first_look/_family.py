"""Which family of models a record asks for (eq. curves).

What a linear regression on the past leaves of an output is regressed once more, on
monomials of three kinds of the near past:

    own      y_k-i of one sample at a time, and curves with kinks of one output
    state    y_k-1, y_k-2, y_k-3 and inputs that are older than the newest one
    all      the newest inputs as well

A law u = v - h(y) explains what the first do, u = v - h(x) what the second do; where
the newest inputs matter beyond them, u itself goes through a curve or a product.
"""

from itertools import combinations_with_replacement

import numpy as np

from ..experiments import stretch
from ..regression import complete, lagged

LAGS = 10  # of every signal in the linear regression
NEAR = (3, 2, 1)  # past samples in monomials, as many as the record bears
DEGREES = ((2, 3), (2,))  # of the monomials, likewise
PER_MONOMIAL = 5  # samples per monomial, at least
MONOMIALS = 500  # at most
KNOTS = np.linspace(0.05, 0.95, 7)  # of curves of one output, as shares of its samples
TESTED = 10_000  # samples, at most
DEPENDENT = 1e-4  # singular value, relative, below which a monomial adds nothing
KINDS = ("own", "state", "all")


def explained(records, delays):
    """Return the shares of what is not linear that three kinds of curves explain.

    Parameters
    ----------
    records : Records
        Record.
    delays : ndarray of int of shape (nu,)
        Samples by which inputs arrive late.

    Returns
    -------
    shares : dict of str to float
        Share of the mean square that is left of a linear regression by kind, "own",
        "state" and "all", means over outputs, corrected for their number; nan where
        the record is too short.
    """
    rows = []
    for u, y in stretch(records.pairs, TESTED):
        u = np.column_stack(
            [
                lagged(one[:, None], [d])[:, 0]
                for one, d in zip(u.T, delays, strict=True)
            ]
        )
        rows.append(
            np.hstack([y, lagged(y, range(1, LAGS + 1)), lagged(u, range(LAGS + 1))])
        )
    data = np.concatenate(list(complete(rows)))
    ny, nu = records.ny, records.nu
    for degrees in DEGREES:  # what is odd needs cubes, even of fewer samples
        for n in NEAR:
            kinds = _kinds(data[:1], ny, nu, n, degrees)
            size = kinds["all"].shape[1]
            if size <= MONOMIALS and len(data) > PER_MONOMIAL * (size + data.shape[1]):
                data = data - data.mean(axis=0)
                scale = data.std(axis=0)
                data = data / np.where(scale > 0, scale, 1.0)
                return _shares(data, _kinds(data, ny, nu, n, degrees), ny)
    return dict.fromkeys(KINDS, np.nan)


def _kinds(data, ny, nu, n, degrees):
    """Return the monomials of every kind."""
    y = data[:, ny : ny + n * ny]
    u = data[:, ny + LAGS * ny :]
    older, newest = u[:, 2 * nu : (1 + n) * nu], u[:, : 2 * nu]
    own = [_monomials(y[:, i * ny : (i + 1) * ny], degrees) for i in range(n)]
    own += [np.abs(y - knot) for knot in np.quantile(y, KNOTS, axis=0)]
    past, single = np.hstack([y, older]), np.hstack(own)
    return {
        "own": single,
        "state": np.hstack([single, _monomials(past, degrees)]),
        "all": np.hstack([single, _monomials(np.hstack([past, newest]), degrees)]),
    }


def _monomials(Z, degrees):
    """Return all products of columns."""
    columns = [
        np.prod(Z[:, chosen], axis=1)
        for degree in degrees
        for chosen in map(
            list, combinations_with_replacement(range(Z.shape[1]), degree)
        )
    ]
    return np.column_stack(columns)


def _shares(data, kinds, ny):
    """Return what every kind explains of the residuals of a linear regression."""
    Q = np.linalg.qr(np.column_stack([data[:, ny:], np.ones(len(data))]))[0]
    E = data[:, :ny] - Q @ (Q.T @ data[:, :ny])
    shares = {}
    for kind, Z in kinds.items():
        Z = Z - Z.mean(axis=0)
        size = Z.std(axis=0)
        Z = Z / np.where(size > 0, size, 1.0)
        left, values, _ = np.linalg.svd(Z - Q @ (Q.T @ Z), full_matrices=False)
        left = left[:, values > DEPENDENT * values[0]]
        freedom = len(E) - Q.shape[1]
        rest = 1 - np.sum((left.T @ E) ** 2, axis=0) / np.sum(E**2, axis=0)
        shares[kind] = float(
            np.mean(1 - rest * freedom / max(1, freedom - left.shape[1]))
        )
    return shares

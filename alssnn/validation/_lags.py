"""How many lags the tests of residuals take, and how many a record bears.

A regression on more columns than half the samples that the parameters leave says little
of the columns: a short record is asked for fewer lags, and one that does not even bear
`LEAST` of them is not tested.  The level of an F-test does not depend on the choice,
which looks at lengths only.
"""

import numpy as np

MOST = 25  # lags of inputs, where the record bears them
LEAST = 4  # fewer would miss what is a few samples late
POWER_LAGS = 10  # lags of squares and cubes: the simulated output has memory itself
ROWS = 2  # samples per column


def choose_lags(experiments, n_parameters, ahead=False):
    """Return the number of lags that a record bears.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Tuples (u, y, y_hat) of shapes (N, nu), (N, ny), (N, ny).
    n_parameters : int
        Number of parameters whose errors the tests allow for.
    ahead : bool, default=False
        Whether lags of y count, too.

    Returns
    -------
    n_lags : int
        At most `MOST`; 0 if it does not bear `LEAST`.
    """
    for n_lags in range(MOST, LEAST - 1, -1):
        rows, needed = rows_behind(experiments, n_lags, n_parameters, ahead)
        if rows >= needed:
            return n_lags
    return 0


def rows_behind(experiments, n_lags, n_parameters, ahead=False):
    """Return the samples behind the lags, and those that a regression needs.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Tuples (u, y, y_hat).
    n_lags : int
        Number of lags.
    n_parameters : int
        Number of parameters whose errors the tests allow for.
    ahead : bool, default=False
        Whether lags of y count, too.

    Returns
    -------
    n_rows : int
        Number of measured samples, of the output that was measured least.
    needed : int
        Number that is needed.
    """
    nu, ny = experiments[0][0].shape[1], experiments[0][1].shape[1]
    known = [np.isfinite(y[n_lags:]).sum(axis=0) for _, y, _ in experiments]
    n_squares = (nu * (nu + 1) + ny * (ny + 1)) // 2
    powers = (n_squares + nu + ny) * (min(n_lags, POWER_LAGS) + 1)
    n_linear = nu + ny if ahead else nu
    needed = ROWS * (1 + n_linear * (n_lags + 1) + powers) + n_parameters
    return int(np.sum(known, axis=0).min()), needed

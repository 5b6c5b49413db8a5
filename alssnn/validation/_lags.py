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
    nu, ny = experiments[0][0].shape[1], experiments[0][1].shape[1]
    for n_lags in range(MOST, LEAST - 1, -1):
        needed = rows_needed(nu, ny, n_lags, n_parameters, ahead)
        if fewest_rows(experiments, n_lags) >= needed:
            return n_lags
    return 0


def fewest_rows(experiments, n_lags):
    """Return the samples behind the lags of the output that was measured least.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Tuples (u, y, y_hat).
    n_lags : int
        Number of lags.

    Returns
    -------
    n_rows : int
        Number of measured samples.
    """
    known = [np.isfinite(y[n_lags:]).sum(axis=0) for _, y, _ in experiments]
    return int(np.sum(known, axis=0).min())


def rows_needed(nu, ny, n_lags, n_parameters, ahead=False):
    """Return the samples that a regression needs.

    Parameters
    ----------
    nu, ny : int
        Number of inputs and outputs.
    n_lags : int
        Number of lags.
    n_parameters : int
        Number of parameters whose errors the tests allow for.
    ahead : bool, default=False
        Whether lags of y count, too.

    Returns
    -------
    n_rows : int
        Number of measured samples behind the lags.
    """
    n_squares = (nu * (nu + 1) + ny * (ny + 1)) // 2
    powers = (n_squares + nu + ny) * (min(n_lags, POWER_LAGS) + 1)
    n_linear = nu + ny if ahead else nu
    return ROWS * (1 + n_linear * (n_lags + 1) + powers) + n_parameters

"""Levenberg-Marquardt on the compressed criterion.

`scipy.optimize.least_squares` does the work, with method "lm" (MINPACK; More, 1978)
or "trf" (trust region reflective, which also takes bounds).  Both see a problem of
n + 1 residuals (`criterion`), so that their linear algebra does not grow with the
record.  A trial step whose simulation diverges has a huge but finite residual; both
methods then reject the step, shrink the region and go on.

The default is "lm": on measured records the penalized models, whose valleys are long,
fall faster with it, while "trf" is a little ahead on unpenalized ones
(`benchmarks.methods`).

Nothing here knows what is being fitted: `minimize` takes any
`criterion.LeastSquares`.
"""

import functools
import time

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from threadpoolctl import ThreadpoolController

from .criterion import DIVERGED_NORM

GRADIENT_TOLERANCE = 1e-12  # cosine between r and its derivatives
TERMINATION_MESSAGES = {
    0: "stopped after max_iter trial steps",
    1: "the gradient vanishes",
    2: "the cost no longer falls",
    3: "the parameters no longer move",
    4: "neither cost nor parameters change",
}


@functools.cache
def _threadpools():
    return ThreadpoolController()


def single_threaded():
    """Return a context in which BLAS uses one thread.

    Small products dominate here; more threads make them several times slower.

    Returns
    -------
    context : context manager
        Restores the former limits on exit.
    """
    return _threadpools().limit(limits=1, user_api="blas")


def minimize(
    criterion,
    free,
    *,
    method="lm",
    max_iter=100,
    tol=1e-6,
    bounds=None,
    report=None,
    label="",
):
    """Minimize a least-squares criterion from a given start.

    Parameters
    ----------
    criterion : Criterion
        Object with ``norm(free)``, ``fun(free)`` and ``jac(free)``.
    free : ndarray of shape (n,)
        Start.
    method : {"lm", "trf"}, default="lm"
        Method of `scipy.optimize.least_squares`.
    max_iter : int, default=100
        Largest number of trial steps.
    tol : float, default=1e-6
        Relative change of the cost, and of the parameters, that ends the search.
    bounds : tuple of ndarray or None, default=None
        Lower and upper bounds, for "trf".
    report : callable or None, default=None
        Called as ``report(label, iteration, cost)`` at every accepted step.
    label : str, default=""
        Passed to `report`.

    Returns
    -------
    result : OptimizeResult
        ``x``, ``cost`` (the squared norm, eq. cost), ``nfev``, ``njev``, ``status``,
        ``success``, ``message`` and ``seconds``.

    Raises
    ------
    ValueError
        If the criterion is not finite at the start.
    """
    start = time.perf_counter()
    if not criterion.norm(free) < DIVERGED_NORM:
        raise ValueError(
            "The model diverges from its initial parameters. Scale the data, shorten "
            "the records, or start from a stable linear model."
        )
    count = 0

    def jac(x):
        nonlocal count
        if report is not None:
            report(label, count, criterion.norm(x) ** 2)
        count += 1
        return criterion.jac(x)

    with single_threaded():
        result = least_squares(
            criterion.fun,
            free,
            jac=jac,
            method=method,
            bounds=(-np.inf, np.inf) if bounds is None else bounds,
            x_scale="jac",
            ftol=tol,
            xtol=tol,
            gtol=GRADIENT_TOLERANCE,
            max_nfev=max_iter,
        )
    return OptimizeResult(
        x=result.x,
        cost=2.0 * result.cost,
        nfev=result.nfev,
        njev=count,
        status=result.status,
        success=result.status > 0,
        message=TERMINATION_MESSAGES[result.status],
        seconds=time.perf_counter() - start,
    )

"""Levenberg-Marquardt on the compressed criterion.

`scipy.optimize.least_squares` does the work, with method "lm" (MINPACK; More, 1978)
or "trf" (trust region reflective, which also takes bounds).  Both see a problem of
n + 1 residuals (`criterion`), so that their linear algebra does not grow with the
record.  A trial step whose simulation diverges has a huge but finite residual; both
methods then reject the step, shrink the region and go on.

The default is "lm".  Where its steps bend, it searches in other coordinates
(`acceleration`).  On the record of the benchmarks costs then fall faster than with
straight steps or with "trf" (`benchmarks.methods`).

Nothing here knows what is being fitted: `minimize` takes any
`criterion.LeastSquares`.
"""

import functools

import numpy as np
from scipy.optimize import OptimizeResult, least_squares
from threadpoolctl import ThreadpoolController

from .acceleration import Accelerated
from .criterion import DIVERGED_NORM
from .watch import AT_FLOOR, INTERRUPTED, NO_PROGRESS, TOO_SLOW, Stop

GRADIENT_TOLERANCE = 1e-12  # cosine between r and its derivatives
STOPPED = -1  # status of a search that was left (`watch`)
CLIFF = "the derivatives overflow next to the best point"
# A share of the median of the derivatives, below which one is too faint to say how far
# its parameter may go, and the share that is taken instead.
FAINT, LEAST_SHARE = 1e-5, 1e-3
RETREATS = 8  # halvings of the way to a point whose derivatives overflow
TERMINATION_MESSAGES = {
    0: "stopped after all trial steps that its last stage may take",
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
    xtol=None,
    bounds=None,
    watch=None,
    patience=None,
    to_point=None,
    label="",
    faint=0.0,
    bends=False,
    settles=None,
):
    """Minimize a least-squares criterion from a given start.

    Parameters
    ----------
    criterion : Criterion
        Object with ``norm(free)``, ``fun(free)`` and ``jac(free)``; where steps bend,
        also with ``normal_equations(free)`` and ``pulled``.
    free : ndarray of shape (n,)
        Start.
    method : {"lm", "trf"}, default="lm"
        Method of `scipy.optimize.least_squares`.
    max_iter : int, default=100
        Largest number of trial steps.
    tol : float, default=1e-6
        Relative change of the cost, and of the parameters, that ends the search.
    xtol : float or None, default=None
        Relative change of the parameters that ends the search; None means `tol`.
    bounds : tuple of ndarray or None, default=None
        Lower and upper bounds, for "trf".
    watch : Watch or None, default=None
        Told of every accepted step; may end the search at any trial step. Without
        one, an interrupt of the user is not caught.
    patience : Patience or None, default=None
        Judges accepted points on other data: that of least error is returned.
    to_point : callable or None, default=None
        Map from the free vector of `criterion` to what watch and patience see.
    label : str, default=""
        Name of the search, for `watch`.
    faint : float, default=0.0
        Share of the median of the derivatives at the start. Parameters with a smaller
        one go no further than those with a share of `LEAST_SHARE`.
    bends : bool, default=False
        Whether steps of "lm" bend along the valleys of the cost (`acceleration`).
    settles : tuple of int and float or None, default=None
        Accepted steps, and the share of the cost that they have to take away, else the
        search ends; None lets it go on.

    Returns
    -------
    result : OptimizeResult
        ``x``, ``cost`` (the squared norm, eq. cost), ``nfev``, ``status``, ``success``
        and ``message``; ``validation_rmse`` is that of ``x``, nan without patience.

    Raises
    ------
    ValueError
        If the criterion is not finite at the start.
    """
    if not criterion.norm(free) < DIVERGED_NORM:
        raise ValueError(
            "The model diverges from its initial parameters. Scale `u` and `y`, "
            "shorten the records, or give a stable `linear_start`."
        )
    problem = criterion
    if bends and method == "lm":
        problem = Accelerated(criterion, free)

    def parameters(x):
        return x if problem is criterion else problem.to_free(x)

    def place(x):
        return parameters(x) if to_point is None else to_point(parameters(x))

    search = _Search(problem, free, watch, patience, place, label, faint, settles)
    options = {
        "method": method,
        "bounds": (-np.inf, np.inf) if bounds is None else bounds,
        "ftol": tol,
        "xtol": tol if xtol is None else xtol,
        "gtol": GRADIENT_TOLERANCE,
    }
    try:
        with single_threaded():
            status, message = search.run(free, max_iter, options)
    except Stop as stop:
        status, message = STOPPED, str(stop)
    except KeyboardInterrupt as interrupt:
        if watch is None:
            raise
        watch.stop(INTERRUPTED, interrupt)
        status, message = STOPPED, INTERRUPTED
    best = parameters(search.best)
    cost = criterion.norm(best) ** 2
    if watch is not None:
        watch.end(label, search.n_accepted, cost)
    return OptimizeResult(
        x=best,
        cost=cost,
        nfev=search.nfev,
        status=status,
        # that a wish of the user ends a search is a kind of convergence
        success=status > 0 or message in (NO_PROGRESS, AT_FLOOR, TOO_SLOW),
        message=message,
        validation_rmse=np.nan if patience is None else patience.least,
    )


class _Search:
    """Evaluate a criterion for `least_squares`, and remember what it has seen."""

    def __init__(
        self, criterion, free, watch, patience, to_point, label, faint, settles
    ):
        self.criterion = criterion
        self.watch = watch
        self.patience = patience
        self.to_point = to_point
        self.label = label
        self.faint = faint
        self.settles = settles
        self.costs: list[float] = []  # of accepted points
        self.last = None  # accepted point
        self.best = free.copy()
        self.least = np.inf
        self.nfev = self.n_accepted = 0
        # older releases of scipy ask twice for the start, and once more for the end
        self.known: list[tuple] = []  # points and residuals: the last and the least
        self.derived: tuple | None = None  # the last point with its Jacobian
        self.anchor: np.ndarray | None = None  # last accepted point with derivatives
        self.edge: np.ndarray = free  # last accepted point
        self.reach: float = np.inf  # how far from the anchor a step may go

    def run(self, free, max_iter, options):
        """Run `least_squares`; a step to overflowing derivatives is a rejected one."""
        for _ in range(RETREATS):
            left = max_iter - self.nfev
            if left < 1:
                break
            try:
                options["x_scale"] = self.scales(free)
                found = least_squares(
                    self.fun, free, jac=self.jac, max_nfev=left, **options
                )
            except FloatingPointError:
                if self.anchor is None:
                    return STOPPED, CLIFF
                # MINPACK cannot take a step back: it starts anew, on a shorter leash;
                # the residuals that are known are those of a longer one
                self.reach = float(np.linalg.norm(self.edge - self.anchor)) / 2
                self.known, self.derived = [], None
                free = self.anchor
                if self.patience is None and np.array_equal(self.best, self.edge):
                    self.best, self.least = free.copy(), self.criterion.norm(free)
                continue
            if self.last is None or np.any(found.x != self.last):
                self.accept(found.x)  # the step that met a tolerance
            return found.status, TERMINATION_MESSAGES[found.status]
        return 0, TERMINATION_MESSAGES[0]

    def scales(self, x):
        """Return how far each parameter moves in a step of length one, or "jac".

        By themselves, the solvers move a parameter by the inverse of its derivative. A
        squared weight near zero has hardly one: it would go far beyond where that
        holds, and every step with a part in it is rejected, down to those that move
        nothing.
        """
        if self.faint == 0:
            return "jac"
        self.fun(x)
        sizes = np.linalg.norm(self.jac(x), axis=0)
        acts, median = sizes > 0, np.median(sizes)  # zero counts as one for them
        if not np.any(acts & (sizes < self.faint * median)):
            return "jac"
        return 1 / np.where(acts, np.maximum(sizes, LEAST_SHARE * median), 1.0)

    def fun(self, x):
        for point, residual in self.known:
            if np.array_equal(x, point):
                return residual.copy()
        if self.watch is not None:
            self.watch.check()
        residual = self.criterion.fun(x)
        if self.anchor is not None and np.isfinite(self.reach):
            if np.linalg.norm(x - self.anchor) > self.reach:
                residual[0] = DIVERGED_NORM
        self.nfev += 1
        if self.patience is None and residual[0] < self.least:
            self.best, self.least = x.copy(), residual[0]
        found = x.copy(), residual.copy()
        least = min([*self.known, found], key=lambda known: known[1][0])
        self.known = [found, least]
        return residual

    def jac(self, x):  # both methods ask for it at accepted points only
        if self.derived is not None and np.array_equal(x, self.derived[0]):
            return self.derived[1]
        self.accept(x)
        self.edge = x.copy()
        jacobian = self.criterion.jac(x)
        if self.anchor is None or np.any(x != self.anchor):
            self.anchor, self.reach = self.edge, np.inf
        self.derived = self.edge, jacobian
        return jacobian

    def accept(self, x):
        """Tell watch and patience of an accepted point; raise `Stop` at their wish."""
        self.last, point, rmse = x.copy(), self.to_point(x), np.nan
        if self.patience is not None:
            rmse = self.patience.look(point)
            if self.patience.waited == 0:
                self.best = x.copy()
        cost = self.criterion.norm(x) ** 2
        if self.watch is not None:
            self.watch.step(self.label, self.n_accepted, cost, rmse, point)
        self.n_accepted += 1
        floor = None if self.watch is None else self.watch.floor
        if floor is not None and cost <= floor[0]:
            if np.all(self.criterion.mean_squares(x) <= floor[1]):
                raise Stop(AT_FLOOR)
        if self.patience is not None and self.patience.is_over:
            raise Stop(NO_PROGRESS)
        self.costs.append(cost)
        if self.settles is not None:
            n_steps, share = self.settles
            before = self.costs[-1 - n_steps :]
            if len(before) > n_steps and cost > (1 - share) * before[0]:
                raise Stop(TOO_SLOW)

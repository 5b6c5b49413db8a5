"""Order of networks: paths of several orders, compared.

Orders are compared by few starts along the first descent, and the smallest is taken
that does nearly as well on hidden samples as the best.

Hidden quarters of a short record tell little: what is fitted may not show what they
ask for.  So an order that fits what it sees much better than the chosen one, and does
not do clearly worse on what is hidden, is taken in its place (eq. explained).
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .paths import Path, descended

# Random starts by which orders are compared. With one, `AlSsnn` of two rooms took two
# states instead of three with one seed of three: 0.37 of the linear error, not 0.08.
TRIED = 2
# Root mean square error over the least one of the same order, from which on a start of
# a long record is left.
BEHIND = 3.0
CONTENDS = 1.5  # root mean square error of a start over the least of its comparison
AGREE = 1.05  # the same of the second start, from which on the two disagree
RIVAL = 2.0  # the same of an order, up to which it is compared along all descents
# The same that counts of one above that of the first comparison. Of the measured drone,
# three states had 1.2 times less than two, and more than the linear model on the test.
MORE_STATES = 1.2
CLEARLY = 1.1  # root mean square errors of one start of two orders differ by more
# Root of the cost of a smaller order over that of a larger one which explains what the
# smaller one does not. Noise and further parameters alone do not make such a ratio.
EXPLAINS = 3.0
FALLS = 1.2  # the same, from which on a larger order is worth a look


@dataclass(frozen=True, eq=False)
class Way:
    """Hold the path of a start of some order, and the least error along it.

    Parameters
    ----------
    nx : int
        Order.
    seed : int
        Of the random start.
    path : Path
        Path from it.
    linears : list of LinearModel
        One per fold, from which the path begins.
    error : float, default=inf
        Root of its least score, a mean over the folds.
    """

    nx: int
    seed: int
    path: Path
    linears: list
    error: float = np.inf


class _Walker:
    """Walk ways of several orders, and keep what every order has reached.

    Attributes
    ----------
    curve : dict of int to float
        Least root mean square error on hidden samples, by order.
    best : dict of int to Way
        The way of the least error, by order.
    """

    def __init__(self, orders, watch, tally, n_jobs):
        self.watch, self._how = watch, (watch, tally, n_jobs)
        self._linear = float(np.sqrt(np.mean(orders.errors[orders.nx])))
        self.curve: dict[int, float] = {}
        self.best: dict[int, Way] = {}
        self._costs: dict[int, np.ndarray] = {}

    def __call__(self, ways, alphas=None):
        """Walk alphas, or what is left of the descents; return the ways behind them."""
        paths = descended([way.path for way in ways], *self._how, alphas=alphas)
        walked = []
        for way, path in zip(ways, paths, strict=True):
            least = float(np.sqrt(np.mean(min(path.errors, key=np.sum))))
            self.curve[way.nx] = min(self.curve.get(way.nx, np.inf), least)
            # what one start has not found in a fold, another may have
            costs = np.min([self._costs.get(way.nx, path.costs[0]), *path.costs], 0)
            self._costs[way.nx] = costs
            error = float(np.sqrt(min(path.scores) / len(path.folds)))
            walked.append(replace(way, path=path, error=error))
            if error < self.best.get(way.nx, way).error:
                self.best[way.nx] = walked[-1]
        return walked

    def cost(self, nx):
        """Return the root of the least cost of an order on what its folds fit."""
        return float(np.linalg.norm(self._costs[nx]))

    def gains(self, nx):
        """Tell whether an order is clearly better than all below it."""
        below = (error for n, error in self.curve.items() if n < nx)
        return self.curve[nx] * CLEARLY < min(below, default=np.inf)

    def falls(self, nx):
        """Tell whether an order fits what it sees better than all below it."""
        below = (self.cost(n) for n in self.curve if n < nx)
        return self._learns(nx) and self.cost(nx) * FALLS < min(below, default=np.inf)

    def explains(self, nx, less):
        """Tell whether an order explains what a smaller one does not."""
        nearly = self._learns(nx) and self.curve[nx] <= CLEARLY * self.curve[less]
        # eq. explained; "<", for all may diverge, or none miss anything
        return nx > less and nearly and EXPLAINS * self.cost(nx) < self.cost(less)

    def _learns(self, nx):
        """Tell whether networks of an order are clearly better than no networks.

        If they are not, what they fit beyond a smaller order is taken for noise.
        """
        return self.curve[nx] * CLEARLY < self._linear


def compared(begin, seeds, orders, candidates, largest, descents, watch, tally, n_jobs):
    """Choose an order by the paths of several ones.

    Where the starts along the first descent do not agree, orders that come near the
    best are compared along the other descents, too, from all seeds: one that came down
    late by the first may come lower by another. More paths find low errors of larger
    models also by chance.

    Parameters
    ----------
    begin : callable
        Called as ``begin(linears, seed)``, or with a further descent: returns a `Path`.
    seeds : sequence of int
        One per random start.
    orders : Orders
        Linear models of every fold, by order.
    candidates : sequence of int
        Orders among which the networks choose.
    largest : int
        Up to this order, further ones follow the candidates as long as they gain.
    descents : sequence of Descent
        Weights of the decay along the paths of every start.
    watch : Watch
        May end it.
    tally : Tally
        Told of every stage.
    n_jobs : int or None
        Paths in parallel, as in joblib.

    Returns
    -------
    curve : dict of int to float
        Least root mean square error on hidden samples, by order.
    ways : list of Way
        Those of the order that is chosen, from one linear model, the best first.
    """
    walk = _Walker(orders, watch, tally, n_jobs)
    ways = _screened(walk, begin, seeds[:TRIED], orders, candidates, largest, descents)
    least, second = sorted([*(way.error for way in ways), np.inf])[:2]
    nx = _smallest(ways)
    enough = _enough(walk, candidates) if _is_short(orders) else np.inf
    among = [way for way in walk.best.values() if way.nx <= enough]
    rivals = [way for way in among if way.error <= RIVAL * least]
    disagree = second > AGREE * least and watch.reason is None
    if disagree and len(rivals) > 1 and len(descents) > 1:
        others = [
            replace(way, seed=seed, path=begin(way.linears, seed, along))
            for way, along, seed in product(rivals, descents[1:], seeds)
        ]
        ways += walk(others)
        nx = _smallest(ways, up_to=nx)
    if _is_short(orders):
        nx = min((w.nx for w in ways if walk.explains(w.nx, nx)), default=nx)
    best, *others = sorted(
        (way for way in ways if way.nx == nx), key=lambda way: way.error
    )
    return walk.curve, [best, *(way for way in others if way.linears is best.linears)]


def _is_short(orders):
    """Tell whether a record is so short that its hidden quarters tell little."""
    return len(orders.folds) > 1


def _enough(walk, candidates):
    """Return the order behind which hidden samples alone would ask for no more."""
    ends = (n for n in walk.curve if n >= candidates[-1] and not walk.gains(n))
    return min(ends, default=np.inf)


def _smallest(ways, up_to=np.inf):
    """Return the smallest order that does nearly as well as the best.

    Orders above a given one have to do better than that, by `MORE_STATES`.
    """
    fair = [(w.error * (MORE_STATES if w.nx > up_to else 1.0), w.nx) for w in ways]
    enough = CLEARLY * min(fair)[0]
    return min(nx for error, nx in fair if error <= enough)


def _raced(walk, ways, alphas):
    """Walk alphas, and leave those behind that are far from the best of their order.

    The best goes first, for time may be over before all have.
    """
    behind: list[Way] = []
    for alpha in alphas:
        walked = walk(ways, [alpha])
        least: dict[int, float] = {}
        for way in walked:
            least[way.nx] = min(way.error, least.get(way.nx, np.inf))
        ways = [way for way in walked if way.error <= BEHIND * least[way.nx]]
        ways.sort(key=lambda way: way.error)
        behind += [way for way in walked if way not in ways]
    return [*ways, *behind]


def _screened(walk, begin, seeds, orders, candidates, largest, descents):
    """Return ways of several orders, along the first of the descents.

    Each way to begin is tried from all seeds, by few stages, and those that come near
    the best of them go on. Beyond the candidates, orders go on as long as each is
    clearly better than those before, of a long record also behind one that is not, and
    of a short one where it fits what it sees better; their starts are compared among
    each other, for others have gone through all stages by then.
    """
    first, rest = descents[0].screened
    ways: list[Way] = []
    waited, pending = 0, list(candidates)
    while pending:
        begun = [
            Way(nx, seed, begin(linears, seed), linears)
            for nx in pending
            for linears, seed in product(orders.starts(nx), seeds)
        ]
        nx, pending = pending[-1], []
        fresh = walk(begun, first) if _is_short(orders) else _raced(walk, begun, first)
        # by few stages alone, an order that comes down late looks like a smaller one
        near = CONTENDS * min(way.error for way in fresh)
        behind = [way for way in fresh if way.error > near]
        fresh = [way for way in fresh if way.error <= near]
        if len(ways) + len(fresh) > 1 or nx < largest:
            fresh = walk(fresh, rest)
        ways += [*fresh, *behind]  # what was tried is not begun again
        gains = walk.gains(nx) or (_is_short(orders) and walk.falls(nx))
        waited = 0 if gains else waited + 1
        is_over = waited > (len(orders.folds) == 1) or walk.watch.reason is not None
        if nx < largest and not is_over:
            pending.append(nx + 1)
    return ways

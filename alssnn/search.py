"""Search: order, random start and weight decay, judged by hidden samples.

Three choices decide whether a network helps or harms, and no theory makes them: how
many states, which random start, and how far the networks may move.  All three are made
by the simulation error on hidden quarters of the record (`holdout`).

The path that comes lowest is taken, which may be that by which an order was chosen, and
of its alphas that do nearly as well as the best the largest.  From there it goes on at
this alpha as long as the error on the hidden samples falls; of a long record, the fit
to all its samples does that in one go.  A stage may have broken off where the error is
small by chance, and the fit to all samples goes on from it: where the path loses what
it had, other low ones may go on, too, and the one is taken that ends lowest.

The networks are kept if they beat the best linear model on the hidden samples: in the
sum over the folds, by more than chance makes of it (eq. certainty), with outputs that
gain more than others lose, not much worse in any fold, and with a mean error that is
worth a prediction.

Errors of a predictor are nearly white, and mostly what nobody can predict.  By chance,
those of two models that predict equally well differ by `CHANCE` over the number of
hidden samples.  There, a smaller difference counts as none, and a larger one as a gain;
alphas are relative to the error of the linear model, as the noise is (eq. innovations).
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from .descent import USUAL
from .excursions import Excursion
from .holdout import SHARE, Fold, certainty
from .network_orders import CONTENDS, TRIED, compared
from .paths import Path, Tally, descended, expected_stages, lowest
from .training import LEAST_MOVE
from .watch import Watch

STAGE_TOL = 1e-4  # relative change of the cost that ends one
NEARLY = 1.1  # relative mean square error that is as good as the best
REFIT = 2  # stages, of the fit to all samples that follows
GAIN = 0.96  # mean square error over that of the linear model, at most
# So many parameters fit 2 FITTED / N of the noise of N samples (Akaike): a smaller gain
# is none. A decay leaves fewer free than there are. Of the measured actuator and of the
# dryer with its halves exchanged, 500 samples each, three fits of four with a smaller
# gain had 1.04 to 1.13 times the linear error on the other half.
FITTED = 50
SURE = 1.0  # standard errors by which it is less, at least
# They are so many times as large where a state integrates: blocks that follow each
# other share a drift. GrSsnn of a tanker, better by 1.2 of the smaller ones, had 2.3
# times the linear error on a fresh record; eleven fits with less had 2.4 to 6.9.
DRIFTS = 2.0
WORSE = 1.5  # the same of a single fold
# Root mean square error over all folds, outputs of unit variance, at most. Asked of
# every fold, it refused networks of the measured drives that have 0.1 to 0.7 times the
# linear error (`benchmarks.field`): a fold of a short record may be unlike the others.
USEFUL = 0.6
FAR = 2.0  # root mean square error from elsewhere, over that of the linear model
CHANCE = 2.0  # over the hidden samples: relative difference of white errors by chance
NOISE = 0.1  # mean square error of a linear model, for which `ALPHAS` are meant
SMALL = 0.01  # the same for a decay to zero, and one below which it becomes less


@dataclass(frozen=True)
class Recipe:
    """Say how a linear model becomes one with networks.

    Parameters
    ----------
    declare : callable
        Called as ``declare(linear)``: returns the linear model in the basis of the
        training, the structure for simulation, the one with penalized channels, and
        the weights of its channels.
    start : callable
        Called as ``start(structure, linear, experiments, seed)``: returns theta.
    limits : callable
        Called as ``limits(structure)``: returns the `Limits` of theta.
    """

    declare: Callable
    start: Callable
    limits: Callable


@dataclass(frozen=True, eq=False)
class Found:
    """Hold the outcome of a search.

    Parameters
    ----------
    structure : Structure
        Structure for simulation.
    theta : ndarray of shape (n_params,)
        Parameters, fitted without the samples that the fold hides.
    center : ndarray of shape (n_params,)
        Center of the decay: the random start, or zero.
    alpha : float
        Weight of the decay.
    refit_iter : int
        Trial steps that a fit to all samples may take: of a short record, many more
        than what was judged would be another, less regular model.
    bends : bool
        Whether these may bend, as those of the search did. Of a short record, they
        would lead further than what was judged, too.
    fold : Fold
        The fold whose parameters fit all samples best.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states of its fit.
    errors : ndarray of shape (n_folds,)
        Mean square errors on the hidden samples, outputs of unit variance.
    linear_errors : ndarray of shape (n_folds,)
        Those of the best linear model.
    certainty : float
        How many standard errors the networks are better (eq. certainty).
    by_output : float
        Mean over the outputs of their mean square errors over those of that model.
    curve : dict of int to float
        Least root mean square error on hidden samples of the networks, by order.
    gain : float, default=0.96
        Mean square error over that of the linear model, below which networks help,
        from 2,500 samples on; less for shorter records (eq. beyond).
    """

    structure: object
    theta: np.ndarray
    center: np.ndarray
    alpha: float
    refit_iter: int
    bends: bool
    fold: Fold
    x0: np.ndarray
    errors: np.ndarray
    linear_errors: np.ndarray
    certainty: float
    by_output: float
    curve: dict
    gain: float = GAIN

    @property
    def helps(self):
        """Return whether the networks are better than the linear model."""
        linear = self.linear_errors
        # a part of the record that happens to be linear is no reason against
        bound = WORSE * np.maximum(linear, linear.mean() / 2)
        return bool(
            self.errors.sum() < self.gain * linear.sum()
            and self.certainty >= SURE
            and self.by_output < 1.0
            and np.all(self.errors < bound)
            and np.sqrt(self.errors.mean()) < USEFUL
        )


def search(
    recipe,
    orders,
    candidates,
    seeds,
    *,
    largest=0,
    max_iter,
    descents=(USUAL,),
    method="lm",
    n_jobs=None,
    output_weight=None,
    watch=None,
    is_predictor=False,
):
    """Choose order, start and decay of networks.

    Parameters
    ----------
    recipe : Recipe
        How linear models become models with networks.
    orders : Orders
        Linear models of every fold, by order.
    candidates : sequence of int
        Orders among which the networks choose.
    seeds : sequence of int
        One per random start.
    largest : int, default=0
        Up to this order, further ones follow the candidates as long as they gain; of a
        long record, until two in a row do not.
    max_iter : int
        Trial steps of a whole fit; a stage of a path takes a share of it.
    descents : sequence of Descent, default=(`USUAL`,)
        Weights of the decay along the paths of every start. Orders are compared along
        the first, and along all where starts do not agree.
    method : {"lm", "trf"}, default="lm"
        Method of `optimizers.minimize`.
    n_jobs : int or None, default=None
        Starts in parallel, as in joblib.
    output_weight : ndarray of shape (ny,) or None, default=None
        Weight of the error of every output.
    watch : Watch
        May end the search; it is not told of its steps, but of its stages.
    is_predictor : bool, default=False
        Whether errors are those one sample ahead, nearly white.

    Returns
    -------
    found : Found
        The choice.
    """
    folds, (nearly, gain) = orders.folds, _standards(orders, is_predictor)
    quiet = (Watch() if watch is None else watch).quiet()
    options = {
        "method": method,
        "max_iter": max_iter,
        "tol": STAGE_TOL,
        "xtol": LEAST_MOVE,
        "label": "search",
    }
    # of a single fold, the fit that follows goes on, without a break
    options["bends"] = is_long = len(folds) == 1
    along = dict.fromkeys((is_long and d.of_long) or d for d in descents)  # each once
    usual, *_ = descents = [d.times(_scale(orders, is_predictor, d)) for d in along]
    more = 0 if is_long else max_iter // usual.steps(max_iter)
    common = {
        "weight": output_weight,
        "bounds": _bounds(orders, output_weight),
        "excursions": _excursions(orders, is_predictor),
        "options": options,
    }

    def begin(linears, seed, descent=usual):
        return Path(recipe, folds, linears, seed, descent, **common)

    ways = [linears for nx in candidates for linears in orders.starts(nx)]
    n_stages = expected_stages(len(ways), seeds, descents, TRIED)
    tally = Tally(watch, orders.errors[orders.nx], n_stages + more)
    curve, linears, tried = {}, ways[0], []
    if len(ways) > 1:
        among = seeds, orders, candidates, largest, descents
        curve, tried = compared(begin, *among, quiet, tally, n_jobs)
        linears = tried[0].linears
    nx = len(linears[0].A)
    paths, others = _begun(begin, linears, seeds, descents, tried)
    paths = _walked(paths, quiet, tally, n_jobs)
    walk, chosen, stage = _gone_on([*paths, *others], nearly, more, quiet, tally)
    alpha = walk.alphas[chosen - 1]
    # what goes on from here is chosen by the same samples
    judged, points = walk.errors[chosen], walk.states[chosen]
    reached = float(np.sqrt(np.mean(walk.errors[stage])))
    curve[nx] = min(curve.get(nx, np.inf), reached)  # the order was chosen by less
    linear, sure, by_output = _beside(orders, walk, points, output_weight, is_predictor)
    i = walk.best_fold(stage, alpha, quiet)
    theta, x0 = walk.states[stage][i]
    return Found(
        walk.problems[i][0],
        theta,
        walk.centers[i],
        float(alpha),
        max_iter if is_long else REFIT * walk.descent.steps(max_iter),
        is_long,
        folds[i],
        x0,
        judged,
        linear,
        sure,
        by_output,
        curve,
        gain if is_predictor else _beyond_noise(walk.problems[i][0], folds[i].whole),
    )


def _begun(begin, linears, seeds, descents, tried):
    """Return the paths of all seeds along all descents, and those along other alphas.

    They begin in this process, for the recipe is of the estimator, whose callbacks and
    streams may not leave it. Of what was tried, those along the alphas of their descent
    are the paths of their seeds.
    """
    along = [way for way in reversed(tried) if way.path.is_along]
    walked = {(way.seed, way.path.descent): way.path for way in along}
    paths = [
        walked.get((seed, descent)) or begin(linears, seed, descent)
        for descent, seed in product(descents, seeds)
    ]
    return paths, [way.path for way in tried if way.path not in paths]


def _walked(paths, watch, tally, n_jobs):
    """Go down the paths of all starts; return them."""
    if len(paths) == 1 or len(paths[0].folds) > 1:
        return descended(paths, watch, tally, n_jobs)
    # of a long record, those that come near the best go on where a path may end
    paths = descended(paths, watch, tally, n_jobs, only_first=True)
    least = [path.least(len(path.descent.first)) for path in paths]
    near = []
    for i, path in enumerate(paths):
        if least[i] <= path.descent.contends**2 * min(least):
            path.has_ended = False  # also where it may end
            near.append(i)
    walked = descended([paths[i] for i in near], watch, tally, n_jobs)
    for i, path in zip(near, walked, strict=True):
        paths[i] = path
    # one that went on while orders were compared may be lower than those by now
    while (path := min(paths, key=Path.least)).left():
        [paths[paths.index(path)]] = descended([path], watch, tally)
    return paths


def _gone_on(paths, nearly, n_stages, watch, tally):
    """Let the lowest path go on from its stage; return a path, from where, and to.

    Where it loses what it had, others go on, too, and what ends lowest is taken. An end
    is judged behind as many stages as the fit to all samples takes: it goes on from the
    stage of the least score, as it did here. Without stages, the lowest path is taken.
    """
    n, ends = paths[0].descent.finalists if n_stages else 1, []
    for path, stage in lowest(paths, nearly, n, CONTENDS**2):
        alpha, reached = path.alphas[stage - 1], stage
        if n_stages:
            tell = tally.plan(n_stages)
            reached = path.go_on(stage, alpha, n_stages, watch, tell)
        end = min(path.scores[stage + REFIT :] or path.scores[stage:])
        ends.append((end, path, stage, reached))
        if len(ends) == 1 and end <= nearly * path.scores[stage]:
            break
    return min(ends, key=lambda end: end[0])[1:]


def _bounds(orders, weight):
    """Return by fold the largest error from elsewhere in the record."""
    bounds = []
    for fold, linear in zip(orders.folds, orders.models[orders.nx], strict=True):
        structure, theta, fit = linear.as_fit()
        error = fold.error(structure, theta, fit.x0, weight, elsewhere=True)
        bounds.append(FAR**2 * error)
    return bounds


def _excursions(orders, is_predictor):
    """Return by fold what asks where other inputs take a model, if it is asked.

    It begins with the best linear models: those of another order may not come to rest.
    """
    pairs = zip(orders.folds, orders.models[orders.nx], strict=True)
    return [
        Excursion.beside(linear, fold.fitted)
        for fold, linear in pairs
        if not (is_predictor or fold.integrators)
    ]


def _beside(orders, walk, points, weight, is_predictor):
    """Return errors of the linear model, how sure others are less, and by output."""
    errors, pairs = [], []
    for fold, linear, (structure, *_), point in zip(
        orders.folds, orders.models[orders.nx], walk.problems, points, strict=True
    ):
        known, theta, fit = linear.as_fit()
        its = known, theta, fit.x0, weight
        errors.append(fold.error(*its))
        squares = fold.squares(structure, *point, weight)
        pairs.append((fold.squares(*its), squares))
    linear, ours = (
        sum(part.sum(axis=0) for part in z) for z in zip(*pairs, strict=True)
    )
    judged = linear > 0  # neither without weight nor never measured
    by_output = float(np.mean(ours[judged] / linear[judged])) if judged.any() else 1.0
    # nearly white errors of a predictor have a chance of their own (`_standards`)
    drifts = DRIFTS if orders.folds[0].integrators else 1.0
    sure = np.inf if is_predictor else certainty(pairs) / drifts
    return np.array(errors), sure, by_output


def _beyond_noise(structure, experiments):
    """Return the mean square error over that of the linear model that is a gain."""
    known = structure.shapes
    n = sum(np.prod(known[name], dtype=int) for name in structure.network_parameters)
    fitted = 2.0 * min(n, FITTED) / sum(len(u) for u, _ in experiments)
    return min(GAIN, 1.0 - fitted)  # (eq. beyond)


def _scale(orders, is_predictor, descent):
    """Return what the weights of a decay are multiplied by."""
    linear = float(np.mean(orders.errors[orders.nx]))
    if descent.center == "zero":
        return min(1.0, linear / SMALL)
    return linear / NOISE if is_predictor else 1.0


def _standards(orders, is_predictor):
    """Return what is as good as the best, and what is a gain."""
    if not is_predictor:
        return NEARLY, GAIN
    n_hidden = sum(len(u) * SHARE for fold in orders.folds for u, _ in fold.hidden)
    chance = CHANCE / n_hidden
    return min(NEARLY, 1.0 + chance), max(GAIN, 1.0 - chance)

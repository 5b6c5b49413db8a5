"""Paths: from one random start along falling weights of the decay.

Each optimum is the start of the next one, on all folds of a record at once, and every
stage is judged by the hidden samples (`holdout`).  Which stage of which path is best is
chosen here, too.
"""

import numpy as np

from .criterion import DIVERGED_NORM, Criterion
from .descent import is_gone
from .workers import finished

WAIT = 3  # alphas without a gain, after which a path ends
# Mean square error of what other inputs take far from the record (eq. escape, latch),
# as it counts: the plant may go there, too, where all else has twice the error.
ESCAPED = 4.0


class Tally:
    """Tell a watch how much of a search is done, at most, and what it has reached.

    Parameters
    ----------
    watch : Watch or None
        Told of the end of every stage.
    linear : ndarray of shape (n_folds,)
        Mean square errors of the linear model on the hidden samples.
    of : int
        Number of stages that are expected.

    Examples
    --------
    >>> from alssnn.paths import Tally
    >>> tally = Tally(None, np.ones(2), 10).plan(3)
    >>> tally(np.array([0.5, 0.25]))
    >>> tally.done, tally.of
    (1, 10)
    """

    def __init__(self, watch, linear, of):
        self.watch, self.linear, self.of = watch, float(np.sum(linear)), of
        self.done, self.planned, self.least = 0, 0, np.inf

    def plan(self, n_stages):
        """Begin stages of a path; those that an earlier one did not need are done.

        Parameters
        ----------
        n_stages : int
            Number of stages, at most.

        Returns
        -------
        tally : Tally
            This one.
        """
        self.done, self.planned = self.planned, self.planned + n_stages
        self.of = max(self.of, self.planned)  # orders may go on
        return self

    def walked(self, errors, n_stages):
        """Hear of the errors of a path that another process has walked.

        Parameters
        ----------
        errors : list of ndarray of shape (n_folds,)
            Mean square errors of its stages.
        n_stages : int
            Number of stages, at most.
        """
        self.plan(n_stages)
        self.done = self.planned - 1
        self(min(errors, key=np.sum))

    def __call__(self, errors):
        """Hear of the errors on hidden samples at the end of a stage.

        Parameters
        ----------
        errors : ndarray of shape (n_folds,)
            Mean square errors.
        """
        self.done += 1
        self.least = min(self.least, float(np.sum(errors)))
        if self.watch is not None:
            share = np.sqrt(self.least / max(self.linear, np.finfo(float).tiny))
            self.watch.searched(self.done, self.of, float(share))


class Path:
    """Descend from one start along falling alphas, on all folds at once.

    Where a decay to zero has taken the networks of a fold away, its next stage begins
    at the start.

    Parameters
    ----------
    recipe : Recipe
        How a linear model becomes one with networks.
    folds : list of Fold
        Parts of the record that are fitted, and those that judge.
    linears : list of LinearModel
        One per fold.
    seed : int
        Of the random start.
    descent : Descent
        Weights of the decay, and what it leads to.
    options : dict
        Of the minimization of a stage; its ``max_iter`` is that of a whole fit.
    weight : ndarray of shape (ny,) or None
        Weight of the error of every output.
    bounds : list of float
        By fold, the largest error from elsewhere in the record.
    excursions : sequence of Excursion, default=()
        By fold, what asks where other inputs take a model; empty asks nothing.

    Attributes
    ----------
    alphas : list of float
        Those that were walked.
    has_ended : bool
        Whether further ones would have brought no more.
    errors : list of ndarray of shape (n_folds,)
        Mean square errors on the hidden samples, of the start and behind every alpha.
    scores : list of float
        Their sums, with what the cost asks beside the outputs (eq. judged), multiplied
        where other inputs take the model far from its record.
    states : list of list of tuple of ndarray
        Parameters and initial states of the same, by fold.
    costs : list of list of float
        Root of the cost on the samples that a fold fits, behind every alpha.

    Examples
    --------
    `alssnn.search.search` walks paths.
    """

    def __init__(
        self,
        recipe,
        folds,
        linears,
        seed,
        descent,
        options,
        *,
        weight,
        bounds,
        excursions=(),
    ):
        self.folds, self.weight, self.bounds = folds, weight, bounds
        self.descent, self.excursions = descent, excursions
        self.options = options | {"max_iter": descent.steps(options["max_iter"])}
        self.problems, self.points = [], []
        for fold, model in zip(folds, linears, strict=True):
            linear, structure, penalized, weights = recipe.declare(model)
            theta = recipe.start(structure, linear, fold.fitted, seed)
            limits = recipe.limits(structure)
            self.problems.append((structure, penalized, weights, limits))
            x0 = linear.starts(structure.given)
            x0 = 0.0 * x0 if limits.at_rest else x0
            self.points.append((limits.clip(theta), x0))
        starts = [theta for theta, _ in self.points]
        to_start = descent.center == "start"
        self.centers = starts if to_start else [0.0 * theta for theta in starts]
        self.starts = self.points
        self.alphas, self.has_ended = [], False
        self.errors, self.scores, self.states, self.costs = [], [], [], []
        self._judge()

    def _judge(self):
        """Note the errors of the folds, or from elsewhere if these are too large."""
        errors, asked = [], 0.0
        for fold, bound, (structure, penalized, weights, _), point in zip(
            self.folds, self.bounds, self.problems, self.points, strict=True
        ):
            error = fold.error(structure, *point, self.weight)
            if error < bound:  # else it is large enough already
                elsewhere = fold.error(structure, *point, self.weight, elsewhere=True)
                error = elsewhere if elsewhere > bound else error
            errors.append(error)
            asked += fold.asked(penalized, *point, weights)
        score = float(np.sum(errors)) + asked
        # a stage that comes no lower than one before is not chosen, wherever it leads
        lower = score < min(self.scores[1:], default=np.inf)
        self.errors.append(np.array(errors))
        self.scores.append(score * (ESCAPED if lower and self._leaves() else 1.0))
        self.states.append(self.points)

    def _leaves(self):
        """Tell whether other inputs take a fold to where nothing was measured."""
        return any(
            excursion.leads(structure, *point)
            for excursion, (structure, *_), point in zip(
                self.excursions, self.problems, self.points, strict=False
            )
        )

    @property
    def is_along(self):
        """Return whether what was walked is the beginning of its descent, or all."""
        return self.alphas == list(self.descent.alphas[: len(self.alphas)])

    def left(self, only_first=False):
        """Return the alphas of its descent that are left.

        Parameters
        ----------
        only_first : bool, default=False
            Whether those behind the first at which it may end do not count.

        Returns
        -------
        alphas : tuple of float
            Empty if it has ended.
        """
        alphas = self.descent.first if only_first else self.descent.alphas
        return () if self.has_ended else tuple(alphas[len(self.alphas) :])

    def least(self, n_stages=None):
        """Return the least score of the start and the first stages.

        Parameters
        ----------
        n_stages : int or None, default=None
            Number of stages; None stands for all that were walked.

        Returns
        -------
        score : float
            Sum of the mean square errors of the folds, larger where other inputs take
            the model far from its record.
        """
        return min(self.scores[: None if n_stages is None else n_stages + 1])

    def descend(self, alphas, watch, tell=None, enough=None):
        """Go down the path, and stop where further stages bring no more.

        Parameters
        ----------
        alphas : sequence of float
            Weights of the decay, not rising.
        watch : Watch
            May end it.
        tell : callable or None, default=None
            Called with the errors of every stage.
        enough : float or None, default=None
            Largest alpha at which it may stop; None is that of the descent.

        Returns
        -------
        path : Path
            This one.
        """
        waited, least = 0, self.least()
        enough = self.descent.enough if enough is None else enough
        self.has_ended = False
        for alpha in alphas:
            stages = [
                self._stage(i, fold.fitted, alpha, watch)
                for i, fold in enumerate(self.folds)
            ]
            self.points = [point for point, _ in stages]
            self.costs.append([cost for _, cost in stages])
            self.alphas.append(alpha)
            self._judge()
            if tell is not None:
                tell(self.errors[-1])
            waited = 0 if self.scores[-1] < 0.99 * least else waited + 1
            least = min(least, self.scores[-1])
            if (waited >= WAIT and alpha <= enough) or watch.reason is not None:
                self.has_ended = True
                break
        return self

    def go_on(self, stage, alpha, n_stages, watch, tell=None):
        """Go on from a stage at its alpha.

        Parameters
        ----------
        stage : int
            Stage; 0 is the start.
        alpha : float
            Weight of the decay.
        n_stages : int
            Number of stages, at most.
        watch : Watch
            May end it.
        tell : callable or None, default=None
            Called with the errors of every stage.

        Returns
        -------
        stage : int
            That of the least score, from the given one on.
        """
        kept = slice(0, stage + 1)
        self.errors, self.scores = self.errors[kept], self.scores[kept]
        self.states, self.costs = self.states[kept], self.costs[:stage]
        self.alphas, self.points = self.alphas[:stage], self.states[stage]
        self.descend([alpha] * n_stages, watch, tell, enough=np.inf)
        return stage + int(np.argmin(self.scores[stage:]))

    def best_fold(self, stage, alpha, watch):
        """Return the fold from whose parameters all samples are fitted best.

        A search that has ended in a poor optimum in one fold may have left it in
        another, where the samples that it has seen differ.

        Parameters
        ----------
        stage : int
            Stage to go on from.
        alpha : float
            Weight of the decay.
        watch : Watch
            May end it.

        Returns
        -------
        fold : int
            The first of those whose cost is the least behind one more stage, on all
            samples.
        """
        if len(self.folds) == 1:
            return 0
        self.points = self.states[stage]
        costs = [
            self._stage(i, fold.whole, alpha, watch)[1]
            for i, fold in enumerate(self.folds)
        ]
        return int(np.argmin(costs))

    def _stage(self, i, experiments, alpha, watch):
        """Return parameters and initial states of one fold behind a stage; its cost."""
        _, penalized, weights, limits = self.problems[i]
        theta, x0 = self.starts[i] if self._is_gone(i) else self.points[i]
        criterion = Criterion(
            penalized,
            experiments,
            weights=weights,
            alpha=alpha,
            center=self.centers[i],
        )
        free = criterion.join(theta, x0)
        if criterion.norm(free) < DIVERGED_NORM:
            free = limits.minimize(criterion, free, watch=watch, **self.options).x
        return criterion.split(free), criterion.norm(free)

    def _is_gone(self, i):
        """Tell whether a decay to zero has taken the networks of a fold away."""
        if self.descent.center == "start":
            return False
        (theta, _), (start, _) = self.points[i], self.starts[i]
        return is_gone(self.problems[i][0], theta, start)


def _descend(path, alphas, watch):
    return path.descend(alphas, watch), watch.reason, watch.interrupt


def descended(paths, watch, tally, n_jobs=None, only_first=False, alphas=None):
    """Go down several paths, in processes of their own if asked for.

    Parameters
    ----------
    paths : list of Path
        Paths; some may have been walked in part.
    watch : Watch
        May end it.
    tally : Tally
        Told of every stage.
    n_jobs : int or None, default=None
        Paths in parallel, as in joblib.
    only_first : bool, default=False
        Whether to stop where a path may end.
    alphas : sequence of float or None, default=None
        Weights of the decay of all paths; None takes what is left of the descent of
        each.

    Returns
    -------
    paths : list of Path
        The same, or copies from other processes.
    """
    left = [path.left(only_first) if alphas is None else alphas for path in paths]
    if n_jobs in (None, 1) or len(paths) == 1:
        for path, rest in zip(paths, left, strict=True):
            path.descend(rest, watch, tally.plan(len(rest)))
        return paths
    calls = [(path, rest, watch) for path, rest in zip(paths, left, strict=True)]
    walked = {}
    for i, (path, reason, interrupt) in finished(_descend, calls, n_jobs):
        walked[i] = path
        if reason is not None:  # the watch of this process has not heard of it
            watch.stop(reason, interrupt)
        tally.walked(path.errors, len(left[i]))
    return [walked[i] for i in range(len(calls))]


def expected_stages(n_ways, seeds, descents, tried):
    """Return how many stages lead to the choice of a path, at most.

    Those of orders that go on, and along the further descents, come on top.

    Parameters
    ----------
    n_ways : int
        Number of linear models to start from.
    seeds : sequence of int
        Random starts.
    descents : sequence of Descent
        Descents.
    tried : int
        Number of starts by which linear models are compared, at most.

    Returns
    -------
    n_stages : int
        Stages of comparisons and of all paths.
    """
    screened = sum(map(len, descents[0].screened))
    compared = n_ways * min(len(seeds), tried) * screened if n_ways > 1 else 0
    return len(seeds) * sum(len(d.alphas) for d in descents) + compared


def lowest(paths, nearly, n=1, within=np.inf):
    """Return the paths that come lowest, and of each the stage from which it goes on.

    Parameters
    ----------
    paths : list of Path
        Paths of several starts, also along different alphas.
    nearly : float
        Mean square error over the least one of a path that is as good.
    n : int, default=1
        Number of paths, at most.
    within : float, default=inf
        Score over the least one of all paths, at most.

    Returns
    -------
    lowest : list of tuple of Path and int
        The paths by what they reach behind their start, the lowest first. Of the stages
        that do nearly as well as the best of their path, the one of the largest alpha.
    """

    def reached(path):
        return min(path.scores[1:])

    def stage(path):
        scores = np.array(path.scores[1:])
        return 1 + int(np.argmax(scores <= nearly * scores.min()))

    best, *others = sorted(paths, key=reached)[:n]
    near = [path for path in others if reached(path) <= within * reached(best)]
    return [(path, stage(path)) for path in (best, *near)]

"""Several paths at once: in processes, in races, and how far all of them are.

Paths of a short record are walked to their end.  Those of a long record cost more, and
start alike: the ones that fall behind others of their order where a path may end are
left there.
"""

import numpy as np

from .workers import finished


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
    >>> from alssnn.races import Tally
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


def raced(paths, watch, tally, n_jobs=None, alphas=None):
    """Go down the paths of several starts; of a long record, not all to their end.

    There, those that come near the best of their order where a path may end go on
    behind it.

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
    alphas : sequence of float or None, default=None
        Weights of the decay, as in `descended`.

    Returns
    -------
    paths : list of Path
        The same, or copies from other processes.
    """
    how = watch, tally, n_jobs
    if len(paths) == 1 or len(paths[0].folds) > 1:
        return descended(paths, *how, alphas=alphas)
    head = tail = None
    if alphas is not None:
        head = [alpha for alpha in alphas if alpha >= paths[0].descent.enough]
        tail = alphas[len(head) :]
    paths = descended(paths, *how, only_first=True, alphas=head)
    reached = [path.least(len(path.descent.first)) for path in paths]
    least: dict[int, float] = {}
    for path, score in zip(paths, reached, strict=True):
        least[path.nx] = min(score, least.get(path.nx, np.inf))
    near = []
    for i, path in enumerate(paths):
        if reached[i] <= path.descent.contends**2 * least[path.nx]:
            path.has_ended = False  # also where it may end
            near.append(i)
    walked = descended([paths[i] for i in near], *how, alphas=tail)
    for i, path in zip(near, walked, strict=True):
        paths[i] = path
    return paths


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

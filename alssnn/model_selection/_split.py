"""Splitters that respect time: blocks of a record, whole experiments.

A splitter returns indices, and an estimator sees what they select: u, y and one label
per sample.  Two blocks on both sides of a test block are glued together there, and a
simulation across the seam would be wrong.  Either the training part has no seam
(``train="longest"`` or ``"past"``), or the labels show it: those of `seam_labels` carry
the sample number, and a jump in it starts a new experiment.  Labels reach `fit`,
`score` and the splitter itself under the one name `experiment` when scikit-learn's
metadata routing is on.
"""

from typing import ClassVar

import numpy as np
from sklearn.model_selection import BaseCrossValidator
from sklearn.utils import indexable

from ..checks import check_option
from ..experiments import split_experiments

TRAIN = ("longest", "past", "both")


class _RecordSplit(BaseCrossValidator):
    """Share the labels of splitters of records."""

    # requested by default: with routing on, no one has to say set_split_request
    __metadata_request__split: ClassVar[dict] = {"groups": True, "experiment": True}

    def split(self, X, y=None, groups=None, experiment=None):
        """Yield the indices of training and test samples.

        Parameters
        ----------
        X : array_like of shape (N, nu)
            Inputs; only their number counts.
        y : array_like of shape (N,) or (N, ny) or None, default=None
            Outputs; not used.
        groups : array_like of shape (N,) or (N, 2) or None, default=None
            Labels under the name that scikit-learn passes on without routing.
        experiment : array_like of shape (N,) or (N, 2) or None, default=None
            Label of the experiment of every sample, as `fit` takes it.

        Yields
        ------
        train : ndarray of int
            Indices of the training samples, ascending.
        test : ndarray of int
            Indices of the test samples, ascending.

        Raises
        ------
        ValueError
            If both kinds of labels are given, or the data are too short for the
            folds.
        """
        if groups is not None and experiment is not None:
            raise ValueError(
                "`groups` must be None where `experiment` is given, got both. They "
                "are two names of the same labels."
            )
        X, _ = indexable(X, y)
        labels = groups if experiment is None else experiment
        yield from self._folds(len(X) if hasattr(X, "__len__") else X.shape[0], labels)

    def get_n_splits(self, X=None, y=None, groups=None, experiment=None):
        """Return the number of folds.

        Parameters
        ----------
        X, y, groups, experiment : object, default=None
            Not used.

        Returns
        -------
        n_splits : int
            Number of folds.
        """
        return self.n_splits

    def _check_n_splits(self):
        if not isinstance(self.n_splits, int | np.integer) or self.n_splits < 2:
            raise ValueError(
                f"`n_splits` must be an integer of at least 2, got {self.n_splits!r}."
            )


class BlockedTimeSeriesSplit(_RecordSplit):
    """Test on one contiguous block after the other.

    Every experiment is cut into `n_splits` blocks; fold i tests the i-th block of each
    and trains on what lies beside it, `gap` samples away.

    Parameters
    ----------
    n_splits : int, default=5
        Number of folds.
    gap : int, default=0
        Samples left out between training and test samples, on either side: as long as
        noise or unmeasured disturbances stay correlated.
    train : {"longest", "past", "both"}, default="longest"
        Training samples of an experiment: the longer side of the test block, what
        comes before it (which takes one more block, never tested), or both sides.
        "both" glues two blocks together, and takes labels made by `seam_labels`.

    See Also
    --------
    ExperimentKFold : Test on whole experiments.
    seam_labels : Labels that show seams, for any splitter without shuffling.

    Notes
    -----
    There is no washout to set: scores estimate the initial state of every test block
    from its first `n_init_samples` samples and do not count these.

    Examples
    --------
    >>> from alssnn.model_selection import BlockedTimeSeriesSplit
    >>> for train, test in BlockedTimeSeriesSplit(3, gap=1).split(np.zeros((9, 1))):
    ...     print(train, test)
    [4 5 6 7 8] [0 1 2]
    [0 1] [3 4 5]
    [0 1 2 3 4] [6 7 8]
    """

    def __init__(self, n_splits=5, *, gap=0, train="longest"):
        self.n_splits = n_splits
        self.gap = gap
        self.train = train

    def _folds(self, n_samples, labels):
        self._check_n_splits()
        if not isinstance(self.gap, int | np.integer) or self.gap < 0:
            raise ValueError(
                f"`gap` must be a nonnegative integer, got {self.gap!r}. It counts "
                "samples."
            )
        check_option("train", self.train, TRAIN)
        two_sided = self.train == "both"
        if two_sided and labels is not None and np.ndim(labels) == 1:
            raise ValueError(
                "`experiment` must show seams for train='both', got plain labels. "
                "Make it by `seam_labels(n_samples, experiment)`."
            )
        parts, _ = split_experiments(n_samples, labels)
        n_blocks = self.n_splits + (self.train == "past")
        for i in range(n_blocks - self.n_splits, n_blocks):
            train: list[int] = []
            test: list[int] = []
            for part in parts:
                edges = np.linspace(part.start, part.stop, n_blocks + 1).astype(int)
                start, stop = int(edges[i]), int(edges[i + 1])
                before = range(part.start, max(start - self.gap, part.start))
                after = range(min(stop + self.gap, part.stop), part.stop)
                longest = [max(before, after, key=len)]
                sides = {"longest": longest, "past": [before], "both": [before, after]}
                train += [k for side in sides[self.train] for k in side]
                test += range(start, stop)
            if not train or not test:
                raise ValueError(
                    f"`n_splits` and `gap` must leave samples in every fold, got "
                    f"{self.n_splits} and {self.gap} for {n_samples} samples. Take "
                    "fewer folds or a smaller gap."
                )
            yield np.array(train), np.array(test)


class ExperimentKFold(_RecordSplit):
    """Test on whole experiments, in folds of about equal length.

    Parameters
    ----------
    n_splits : int, default=5
        Number of folds, at most the number of experiments.

    See Also
    --------
    BlockedTimeSeriesSplit : Test on blocks of a record.

    Notes
    -----
    The longest experiment first, each goes to the fold that is shortest so far. What
    scikit-learn's `GroupKFold` does, by the name `experiment` and for labels that
    carry sample numbers, too. One experiment per fold is `LeaveOneGroupOut`.

    Examples
    --------
    >>> from alssnn.model_selection import ExperimentKFold
    >>> labels = ["a", "a", "a", "b", "c", "c"]
    >>> split = ExperimentKFold(2).split(np.zeros((6, 1)), experiment=labels)
    >>> for train, test in split:
    ...     print(train, test)
    [3 4 5] [0 1 2]
    [0 1 2] [3 4 5]
    """

    def __init__(self, n_splits=5):
        self.n_splits = n_splits

    def _folds(self, n_samples, labels):
        self._check_n_splits()
        parts, names = split_experiments(n_samples, labels)
        if np.ndim(labels) == 2:  # all runs of an experiment stay together
            names = [name for name, _ in names]
        lengths: dict = {}
        for part, name in zip(parts, names, strict=True):
            lengths[name] = lengths.get(name, 0) + part.stop - part.start
        if len(lengths) < self.n_splits:
            raise ValueError(
                f"`n_splits` must be at most the number of experiments, "
                f"{len(lengths)}, got {self.n_splits}. Pass `experiment` with one "
                "label per sample, or split a record by `BlockedTimeSeriesSplit`."
            )
        totals, fold_of = np.zeros(self.n_splits), {}
        for name in sorted(lengths, key=lambda name: -lengths[name]):
            fold_of[name] = int(np.argmin(totals))
            totals[fold_of[name]] += lengths[name]
        fold = np.empty(n_samples, dtype=int)
        for part, name in zip(parts, names, strict=True):
            fold[part] = fold_of[name]
        for i in range(self.n_splits):
            yield np.flatnonzero(fold != i), np.flatnonzero(fold == i)

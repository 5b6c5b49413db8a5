"""Mapping: a function of one experiment over all of them, wherever they live.

Everything that a fit wants to know of its data is a sum over experiments, or one value
per experiment.  What asks for it needs two verbs,

    map(function, *columns)             [f(row_1, u_1, y_1), f(row_2, u_2, y_2), ...]
    reduce(function, merge, *columns)   merge(... merge(f_1, f_2) ..., f_n)

and a few numbers: `lengths`, `n_measured`, `n_samples`.  `Held` has the experiments in
this process and maps in a loop or in threads; `distributed.Remote` has them on the
workers of a cluster.  A merge must be associative, not commutative: `Held` merges in
the order of the experiments, so that the number of threads changes no digit.
"""

import functools

import numpy as np
from joblib import Parallel, delayed

from .experiments import chunks, from_measured, stretch


class Held:
    """Hold experiments in this process.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of shapes (N_i, nu) and (N_i, ny); only sliced.
    n_jobs : int or None, default=None
        Experiments treated in parallel threads, as in joblib.
    """

    is_here = True  # whether it can be sent to another process

    def __init__(self, experiments, n_jobs=None):
        self.experiments = list(experiments)
        self.n_jobs = n_jobs
        self.lengths = [len(u) for u, _ in self.experiments]
        self.n_samples = sum(self.lengths)

    @classmethod
    def of(cls, experiments, n_jobs=None):
        """Return experiments that can be mapped over.

        Parameters
        ----------
        experiments : sequence of tuple of array, Held or Remote
            Experiments.
        n_jobs : int or None, default=None
            Threads for a sequence.

        Returns
        -------
        experiments : Held or Remote
            The experiments themselves, unless they are a sequence.
        """
        if hasattr(experiments, "reduce"):
            return experiments
        return cls(experiments, n_jobs)

    def __len__(self):
        """Return the number of experiments."""
        return len(self.experiments)

    def __iter__(self):
        """Return an iterator over pairs (u, y)."""
        return iter(self.experiments)

    def __getitem__(self, i):
        """Return one experiment, (u, y)."""
        return self.experiments[i]

    @functools.cached_property
    def n_measured(self):
        """Return how many values of the outputs are not nan."""
        return sum(count_measured(y) for _, y in self.experiments)

    def stretch(self, n_samples):
        """Return the liveliest contiguous stretch of every experiment.

        Parameters
        ----------
        n_samples : int
            Samples wanted in all.

        Returns
        -------
        stretches : list of tuple of ndarray
            Pairs (u, y).
        """
        return stretch(self.experiments, n_samples)

    def from_measured(self):
        """Return the same experiments, each from its first measured sample on."""
        return Held([from_measured(*pair) for pair in self.experiments], self.n_jobs)

    def map(self, function, *columns):
        """Return the values of a function, one per experiment.

        Parameters
        ----------
        function : callable
            Called as ``function(*row, u, y)``.
        *columns : sequence
            Further arguments, one value per experiment.

        Returns
        -------
        values : list
            Its values, in the order of the experiments.
        """
        rows = zip(*columns, strict=True) if columns else [()] * len(self)
        calls = [(*row, *uy) for row, uy in zip(rows, self.experiments, strict=True)]
        if self.n_jobs in (None, 1) or len(calls) == 1:
            return [function(*call) for call in calls]
        # the backend is fixed: a cluster of the caller is for whole fits, not for this
        threads = Parallel(n_jobs=self.n_jobs, backend="threading")
        return threads(delayed(function)(*call) for call in calls)

    def reduce(self, function, merge, *columns):
        """Return the merged values of a function.

        Parameters
        ----------
        function : callable
            Called as ``function(*row, u, y)``.
        merge : callable
            Associative function of two values.
        *columns : sequence
            Further arguments, one value per experiment.

        Returns
        -------
        value : object
            Their merger, in the order of the experiments.
        """
        return functools.reduce(merge, self.map(function, *columns))


def count_measured(y):
    """Return how many entries of the outputs are not nan.

    Parameters
    ----------
    y : array of shape (N, ny)
        Outputs; only sliced.

    Returns
    -------
    count : int
        Number of measured values.
    """
    return sum(int(np.sum(~np.isnan(y[part]))) for part in chunks(len(y)))

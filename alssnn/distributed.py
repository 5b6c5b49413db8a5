"""Data that fit no single machine: experiments that stay on the workers of a cluster.

The experiments are Dask futures of (u, y).  A fit never brings them together: what
leaves a worker is

* once, the moments of its data and their liveliest stretches, from which the client
  makes the linear start and trains the coarse stage;
* in every trial step, one number;
* in every accepted step, its part of J'J and J'r: n_params^2 numbers for the head of
  the arrow (`contribution`) and n_x0 (n_params + n_x0) for every initial state,
  whatever the number of samples.

The client sends theta and the initial states.  Sums of many workers are merged on the
workers, `FAN_IN` at a time, so that the client receives a few arrays only.

A worker that dies takes its data along.  Dask computes lost futures anew, if it knows
how: make them by ``client.submit(read, path)``, not by ``client.scatter``.

Dask lives here only.
"""

import copy
import functools
import itertools

import numpy as np

from .experiments import from_measured, stretch
from .mapping import count_measured
from .optimizers import single_threaded
from .scaling import Scaling, merge_moments, moments

FAN_IN = 8  # sums that are merged at once


class Remote:
    """Map over experiments that live on the workers of a Dask cluster.

    It has the verbs of `mapping.Held`; the experiments are in scaled deviations once
    `scaled` has been told how.

    Parameters
    ----------
    client : distributed.Client
        Client of the cluster.
    futures : sequence of distributed.Future
        One pair (u, y) per experiment, arrays of shapes (N_i, nu) and (N_i,) or
        (N_i, ny), in the units of the user.

    Raises
    ------
    ValueError
        If there are none, shapes differ between them, or inputs are not finite.

    Examples
    --------
    >>> from distributed import Client  # doctest: +SKIP
    >>> client = Client(n_workers=2, threads_per_worker=1)  # doctest: +SKIP
    >>> futures = client.map(read_experiment, paths)  # doctest: +SKIP
    >>> alssnn.distributed.Remote(client, futures).n_samples  # doctest: +SKIP
    200000
    """

    is_here = False  # a client cannot be sent to another process

    def __init__(self, client, futures):
        from distributed import wait

        self.client = client
        self.futures = list(futures)
        self.scale = _as_read
        if not self.futures:
            raise ValueError(
                "`experiments` must hold at least one future of (u, y), got none."
            )
        wait(self.futures)
        holders = client.who_has(self.futures)
        where = [min(holders.get(f.key, ()), default="") for f in self.futures]
        order = sorted(range(len(where)), key=where.__getitem__)
        # one task per worker, not per experiment: it sends one sum
        self.groups = [
            list(group) for _, group in itertools.groupby(order, key=where.__getitem__)
        ]
        facts = self.map(_facts)
        shapes = {fact["shape"] for fact in facts}
        if len(shapes) > 1:
            raise ValueError(
                "`experiments` must all have the same inputs and outputs, got "
                f"(nu, ny) in {sorted(shapes)}."
            )
        if bad := [i for i, fact in enumerate(facts) if not fact["finite"]]:
            raise ValueError(
                f"`experiments` must have finite inputs and no infinite output, got "
                f"others in {bad}. Only outputs may be nan, where they were not "
                "measured."
            )
        (self.shape,) = shapes
        self.y_ndim = facts[0]["y_ndim"]
        self.scale = _columns
        self.lengths = [fact["length"] for fact in facts]
        self.n_samples = sum(self.lengths)
        self.n_measured = sum(fact["n_measured"] for fact in facts)
        self.moments = tuple(merge_moments([f[z] for f in facts]) for z in ("u", "y"))

    def __len__(self):
        """Return the number of experiments."""
        return len(self.futures)

    def scaled(self, scaling: Scaling, delay):
        """Return the same experiments in scaled deviations.

        Parameters
        ----------
        scaling : Scaling
            Units of the fit.
        delay : ndarray of int of shape (nu,)
            Samples by which each input arrives late.

        Returns
        -------
        experiments : Remote
            They scale what they read: nothing is copied.
        """
        other = copy.copy(self)
        other.scale = functools.partial(_scaled, scaling, delay)
        return other

    def from_measured(self):
        """Return the same experiments, each from its first measured sample on."""
        other = copy.copy(self)
        other.scale = functools.partial(_from_measured, self.scale)
        other.lengths = other.map(_length)
        other.n_samples = sum(other.lengths)
        return other

    def stretch(self, n_samples):
        """Return the liveliest contiguous stretch of every experiment, here.

        Parameters
        ----------
        n_samples : int
            Samples wanted in all.

        Returns
        -------
        stretches : list of tuple of ndarray
            Pairs (u, y); the whole experiments if they are short enough.
        """
        whole = self.n_samples <= n_samples
        wanted = [
            n if whole else max(1, n * n_samples // self.n_samples)
            for n in self.lengths
        ]
        return self.map(_stretch, wanted)

    def map(self, function, *columns):
        """Return the values of a function, one per experiment.

        Parameters
        ----------
        function : callable
            Called as ``function(*row, u, y)`` on the worker that has u and y.
        *columns : sequence
            Further arguments, one value per experiment.

        Returns
        -------
        values : list
            Its values, in the order of the experiments.
        """
        parts = self.client.gather(self._submit(_each, (function,), columns))
        values = dict(
            zip(itertools.chain(*self.groups), itertools.chain(*parts), strict=True)
        )
        return [values[i] for i in range(len(self))]

    def reduce(self, function, merge, *columns):
        """Return the merged values of a function.

        Parameters
        ----------
        function : callable
            Called as ``function(*row, u, y)`` on the worker that has u and y.
        merge : callable
            Associative and commutative function of two values.
        *columns : sequence
            Further arguments, one value per experiment.

        Returns
        -------
        value : object
            Their merger, in the order of the workers.
        """
        parts = self._submit(_merged, (function, merge), columns)
        while len(parts) > FAN_IN:  # a tree of mergers, on the workers
            parts = [
                self.client.submit(_merge, merge, *parts[i : i + FAN_IN], pure=False)
                for i in range(0, len(parts), FAN_IN)
            ]
        return functools.reduce(merge, self.client.gather(parts))

    def _submit(self, task, functions, columns):
        """Return the futures of one task per group."""
        rows = list(zip(*columns, strict=True)) if columns else [()] * len(self)
        return [
            self.client.submit(
                task,
                *functions,
                self.scale,
                [rows[i] for i in group],
                *(self.futures[i] for i in group),
                pure=False,
            )
            for group in self.groups
        ]


def fit(model, experiments, *, client=None):
    """Fit a model to experiments that stay on the workers of a Dask cluster.

    The linear start and the coarse stage run in this process, on the liveliest
    stretches of all experiments; the last stage, `polish_iter` trial steps, on all
    samples where they are. With ``coarse_samples=None`` all of the training does.

    Parameters
    ----------
    model : AlSsnn, FlSsnn, GrSsnn or LinearStateSpace
        Estimator; it is fitted in place.
    experiments : sequence of distributed.Future
        One pair (u, y) per experiment, arrays of shapes (N_i, nu) and (N_i,) or
        (N_i, ny), u finite, y nan where it was not measured. Made by
        ``client.submit``, they survive the loss of a worker.
    client : distributed.Client or None, default=None
        Client of the cluster; None takes the current one.

    Returns
    -------
    model : object
        The fitted model; `experiments_` numbers the experiments.

    Raises
    ------
    ValueError
        If the data do not fit together, or `validation_fraction` is set.

    Notes
    -----
    The client solves a dense problem of n_params + n_experiments n_x0 unknowns in
    every accepted step: a few hundred experiments, each as long as a worker can hold.
    Callbacks of scikit-learn are not called.

    Examples
    --------
    >>> from distributed import Client  # doctest: +SKIP
    >>> client = Client("scheduler:8786")  # doctest: +SKIP
    >>> futures = client.map(read_experiment, paths)  # doctest: +SKIP
    >>> model = alssnn.distributed.fit(alssnn.AlSsnn(nx=4), futures)  # doctest: +SKIP
    """
    if client is None:
        from distributed import get_client

        client = get_client()
    return model.fit_remote(Remote(client, experiments))


# -- what runs on the workers ----------------------------------------------------------


def _as_read(u, y):
    return np.asarray(u), np.asarray(y)


def _columns(u, y):
    """Return inputs and outputs as columns, otherwise as they are."""
    return np.asarray(u), np.asarray(y).reshape(len(y), -1)


def _scaled(scaling, delay, u, y):
    u, y = _columns(u, y)
    return scaling.scale_u(u, delay), scaling.scale_y(y)


def _from_measured(scale, u, y):
    return from_measured(*scale(u, y))


def _length(u, y):
    return len(u)


def _each(function, scale, rows, *data):
    with single_threaded():
        return [
            function(*row, *scale(u, y)) for row, (u, y) in zip(rows, data, strict=True)
        ]


def _merged(function, merge, scale, rows, *data):
    return functools.reduce(merge, _each(function, scale, rows, *data))


def _merge(merge, *values):
    return functools.reduce(merge, values)


def _stretch(n_samples, u, y):
    ((u, y),) = stretch([(u, y)], n_samples)
    return np.array(u), np.array(y)


def _facts(u, y):
    """Return what the client has to know of an experiment."""
    if u.ndim != 2 or len(u) != len(y):
        raise ValueError(
            "`experiments` must be pairs (u, y) of shapes (N, nu) and (N, ny), got "
            f"{u.shape} and {y.shape}."
        )
    y_ndim, (u, y) = y.ndim, _columns(u, y)
    return {
        "shape": (u.shape[1], y.shape[1]),
        "y_ndim": y_ndim,
        "length": len(u),
        "finite": bool(np.isfinite(u).all() and not np.isinf(y).any()),
        "n_measured": count_measured(y),
        "u": moments(u),
        "y": moments(y),
    }

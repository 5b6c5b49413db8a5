"""Experiments: from records with labels to uninterrupted runs.

A record is u (N, nu), y (N, ny) with time running down the rows, and one label per
sample that says which experiment the sample belongs to.  The samples of one
experiment are contiguous and in time order; each experiment has its own initial
state, and nothing is ever simulated across a seam.  An output that was not measured at
a sample is nan there.

Nothing here copies a record as a whole: what looks at all samples does so in `chunks`.
"""

import importlib
from abc import ABC, abstractmethod
from itertools import pairwise

import numpy as np

from .checks import unmasked
from .containers import as_columns, check_rows_meet

WINDOW_GRID = 32  # candidate places of a stretch in every experiment
CHUNK = 100_000  # samples treated at a time


def chunks(stop, start=0, length=CHUNK):
    """Return samples in pieces that fit into memory.

    Parameters
    ----------
    stop : int
        Sample behind the last one.
    start : int, default=0
        First sample.
    length : int, default=`CHUNK`
        Samples of a piece, at most.

    Returns
    -------
    parts : list of slice
        Samples of every piece.
    """
    return [slice(i, min(i + length, stop)) for i in range(start, stop, length)]


def check_inputs(u):
    """Refuse inputs with gaps.

    Parameters
    ----------
    u : array of shape (N, nu)
        Inputs; only sliced.

    Raises
    ------
    ValueError
        If a value is nan.
    """
    for i in chunks(len(u)):
        gaps = np.isnan(u[i])
        if gaps.any():
            k, column = np.argwhere(gaps)[0]
            raise ValueError(
                f"`u` must not contain NaN, got it at sample {i.start + k} of column "
                f"{column}. Only outputs may be missing: fill the gap, or split the "
                "record there into two experiments."
            )


def split_experiments(n_samples, experiment):
    """Return the samples of every experiment.

    Parameters
    ----------
    n_samples : int
        Number of samples.
    experiment : array_like of shape (n_samples,) or (n_samples, 2), or None
        Label of every sample, or label and sample number, where a number that does
        not follow the last one starts a new experiment; None means one experiment.

    Returns
    -------
    parts : list of slice
        Samples of every experiment, in order of appearance.
    labels : list
        Their labels; pairs of label and first sample number if there are numbers;
        ``[None]`` if `experiment` is None.

    Raises
    ------
    ValueError
        If the number of labels differs from the number of samples, a label is nan, the
        samples of one experiment are not contiguous, every one of more than two samples
        has a label of its own, or sample numbers are not integers.
    """
    if experiment is None:
        return [slice(0, n_samples)], [None]
    experiment = np.asarray(experiment)
    if experiment.shape not in [(n_samples,), (n_samples, 2)]:
        raise ValueError(
            f"`experiment` must have one label per sample, shape ({n_samples},), got "
            f"{experiment.shape}. Labels with sample numbers, as `seam_labels` makes "
            f"them, have shape ({n_samples}, 2)."
        )
    label = experiment if experiment.ndim == 1 else experiment[:, 0]
    if np.any(label != label):  # nan would start an experiment at every sample
        raise ValueError(
            "`experiment` must not contain NaN, got it at sample "
            f"{int(np.argmax(label != label))}. Label every sample."
        )
    jumps = label[1:] != label[:-1]
    if experiment.ndim == 2:
        number = _sample_numbers(experiment[:, 1])
        jumps = jumps | (np.diff(number) != 1)
    if experiment.ndim == 1 and n_samples > 2 and jumps.all():
        raise ValueError(
            "`experiment` must label runs of samples, got another label at every "
            "sample, which is what outputs or times look like. Outputs are no argument "
            "of `predict`, and `experiment` of a single run is None."
        )
    starts = np.flatnonzero(np.r_[True, jumps])
    stops = [*starts[1:], n_samples]
    labels = label[starts].tolist()
    if experiment.ndim == 2:
        labels = list(zip(labels, number[starts].tolist(), strict=True))
    if len(set(labels)) < len(labels):
        raise ValueError(
            "`experiment` must label contiguous samples, got a label that returns "
            "after another one. Give every uninterrupted run a label of its own, or "
            "sample numbers by `seam_labels`."
        )
    return [slice(int(a), int(b)) for a, b in zip(starts, stops, strict=True)], labels


def _sample_numbers(column):
    try:
        number = column.astype(float)
    except (TypeError, ValueError):
        number = np.array([np.nan])
    if not np.all(np.isfinite(number) & (number == np.round(number))):
        raise ValueError(
            "`experiment` must have integer sample numbers in its second column, got "
            f"{column[:3].tolist()}... . Make it by `seam_labels`."
        )
    return number.astype(np.int64)


def seam_labels(n_samples, experiment=None):
    """Return labels that show where a record is cut: label and sample number.

    Slice them with the record, as scikit-learn's splitters do, and pass them as
    `experiment`: samples whose numbers do not follow each other become experiments of
    their own, so that blocks glued together are never simulated across the seam.

    Parameters
    ----------
    n_samples : int
        Number of samples.
    experiment : array_like of shape (n_samples,) or None, default=None
        Label of the experiment of every sample; None means one experiment.

    Returns
    -------
    labels : ndarray of shape (n_samples, 2)
        Label, 0 where there was none, and number of every sample; of integers if the
        labels are.

    Raises
    ------
    ValueError
        If the number of labels differs from the number of samples.

    Examples
    --------
    >>> from alssnn.model_selection import seam_labels
    >>> labels = seam_labels(6)[[0, 1, 4, 5]]  # without samples 2 and 3
    >>> labels[:, 1]
    array([0, 1, 4, 5])
    """
    label = np.zeros(n_samples, dtype=int)
    if experiment is not None:
        label = np.asarray(experiment)
    if label.shape != (n_samples,):
        raise ValueError(
            f"`experiment` must have one label per sample, shape ({n_samples},), got "
            f"{label.shape}."
        )
    is_integer = np.issubdtype(label.dtype, np.integer)
    labels = np.empty((n_samples, 2), dtype=np.int64 if is_integer else object)
    labels[:, 0], labels[:, 1] = label, np.arange(n_samples)
    return labels


def stretch(experiments, n_samples):
    """Return the liveliest contiguous stretch of every experiment.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Pairs (u, y).
    n_samples : int
        Samples wanted in all, shared in proportion to the lengths.

    Returns
    -------
    stretches : list of tuple of ndarray
        Pairs (u, y), views; the experiments themselves if they are short enough.
    """
    total = sum(len(u) for u, _ in experiments)
    if total <= n_samples:
        return list(experiments)
    out = []
    for u, y in experiments:
        length = max(1, len(u) * n_samples // total)
        starts = np.unique(np.linspace(0, len(u) - length, WINDOW_GRID, dtype=int))
        marks = np.unique([0, *starts, *(starts + length)])
        between = [_energy(u, *ab) + _energy(y, *ab) for ab in pairwise(marks)]
        energy = dict(zip(marks, np.cumsum([0.0, *between]), strict=True))
        start = max(starts, key=lambda k: energy[k + length] - energy[k])
        out.append((u[start : start + length], y[start : start + length]))
    return out


def _energy(signal, start, stop):
    """Return the sum of squares of the measured samples from start to stop."""
    parts = chunks(stop, start)
    return sum(float(np.nansum(signal[part] ** 2)) for part in parts)


def stack_experiments(us, ys):
    """Join the records of several experiments into one, with labels.

    Parameters
    ----------
    us : sequence of array_like of shape (N_i, nu) or (N_i,)
        Inputs of every experiment, arrays or DataFrames.
    ys : sequence of array_like of shape (N_i, ny) or (N_i,)
        Their outputs.

    Returns
    -------
    u : ndarray or DataFrame of shape (sum(N_i), nu)
        Inputs.
    y : ndarray or DataFrame of shape (sum(N_i), ny)
        Outputs.
    experiment : ndarray of int of shape (sum(N_i),)
        Number of the experiment of every sample, to be passed with `u` and `y`.

    Raises
    ------
    ValueError
        If the numbers of records, their columns or their lengths do not fit.

    Examples
    --------
    >>> u, y, experiment = alssnn.stack_experiments(
    ...     [np.zeros((3, 1)), np.ones((2, 1))], [np.zeros(3), np.ones(2)]
    ... )
    >>> experiment
    array([0, 0, 0, 1, 1])
    """
    if len(us) != len(ys) or not len(us):
        raise ValueError(
            f"`us` and `ys` must have one record per experiment, got {len(us)} and "
            f"{len(ys)}."
        )
    for i, (u, y) in enumerate(zip(us, ys, strict=True)):
        if len(u) != len(y):
            raise ValueError(
                f"`us[{i}]` and `ys[{i}]` must have the same number of samples, got "
                f"{len(u)} and {len(y)}."
            )
    experiment = np.repeat(np.arange(len(us)), [len(u) for u in us])
    return as_columns(_stack(us, "us")), _stack(ys, "ys"), experiment


def is_list_of_records(data):
    """Tell whether data are one array per experiment rather than one array.

    Parameters
    ----------
    data : object
        What a user passed for `u`.

    Returns
    -------
    is_list : bool
        Whether it is a list or tuple of arrays, DataFrames or Series. A list of
        numbers, or of lists of them, is one array.
    """
    return (
        isinstance(data, list | tuple)
        and len(data) > 0
        and all(len(getattr(part, "shape", ())) in (1, 2) for part in data)
    )


def join_records(u, y, experiment):
    """Return records as one; lists of records become labeled experiments.

    Parameters
    ----------
    u : array_like of shape (N, nu), or list of them
        Inputs.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs.
    experiment : array_like of shape (N,) or None
        Labels; None for a list.

    Returns
    -------
    u, y, experiment : tuple
        The record, as it came unless it is a list.

    Raises
    ------
    ValueError
        If a list comes with labels, or its parts do not fit, or data frames have rows
        of other times.
    """
    if not is_list_of_records(u):
        check_rows_meet(u, y)
        return u, y, experiment
    if experiment is not None:
        raise ValueError(
            "`experiment` must be None for a list of records, got labels. The list "
            "itself tells the experiments."
        )
    if not isinstance(y, list | tuple):
        raise ValueError(
            "`y` must be a list of records, as `u` is, got "
            f"{type(y).__name__}. Give one record of outputs per experiment."
        )
    for pair in zip(u, y, strict=False):  # what follows refuses other lengths
        check_rows_meet(*pair)
    try:
        return stack_experiments(u, y)
    except ValueError as error:  # of arguments of another name
        words = str(error).replace("`us", "`u").replace("`ys", "`y")
        raise ValueError(words) from error


def _stack(records, name):
    first = records[0]
    names = {_names(record) for record in records}
    if len(names) > 1:  # or else they would become further columns, full of gaps
        raise ValueError(
            f"`{name}` must have the same names of columns in every record, got "
            f"{sorted(names)}. Rename them."
        )
    if _names(first):  # DataFrames and Series keep their names
        library = importlib.import_module(type(first).__module__.split(".")[0])
        return library.concat(records)
    arrays = [np.asarray(unmasked(record)) for record in records]
    shapes = {array.shape[1:] for array in arrays}
    if len(shapes) > 1:
        raise ValueError(f"`{name}` must have equal columns, got {sorted(shapes)}.")
    return np.concatenate(arrays)


def _names(record):
    """Return the names of the columns of a DataFrame or Series, () of an array."""
    if hasattr(record, "columns"):
        return tuple(str(name) for name in record.columns)
    name = getattr(record, "name", None)
    return () if name is None else (str(name),)


class Sliced(ABC):
    """An array of floats that makes its samples as they are sliced."""

    dtype = np.dtype(float)
    shape: tuple[int, ...]

    @abstractmethod
    def __getitem__(self, part):
        """Return the samples of a slice."""

    def __len__(self):
        """Return the number of samples."""
        return self.shape[0]

    def __array__(self, dtype=None, copy=None):
        """Return all samples."""
        return self[:] if dtype is None else self[:].astype(dtype)


class Filled(Sliced):
    """Fill outputs that were not measured: a start, which a fit corrects.

    Gaps are bridged by straight lines within the slice that is asked for.

    Parameters
    ----------
    y : array of shape (N, ny)
        Outputs; nan where they were not measured.
    """

    def __init__(self, y):
        self.y, self.shape = y, y.shape

    def __getitem__(self, part):
        """Return the samples of a slice, shape (L, ny)."""
        y = np.array(self.y[part])
        k = np.arange(len(y))
        for i in np.flatnonzero(np.isnan(y).any(axis=0)):
            measured = ~np.isnan(y[:, i])
            known = y[measured, i] if measured.any() else np.zeros(1)
            at = k[measured] if measured.any() else k[:1]
            y[:, i] = np.interp(k, at, known)
        return y


class Tail(Sliced):
    """Leave out the first samples of what is sliced.

    Parameters
    ----------
    values : array of shape (N, n)
        Samples; only sliced.
    start : int
        How many of them are left out.
    """

    def __init__(self, values, start):
        self.values, self.start = values, start
        self.shape = (len(values) - start, *values.shape[1:])

    def __getitem__(self, part):
        """Return the samples of a slice, shape (L, n)."""
        first, stop, step = part.indices(len(self))
        return self.values[self.start + first : self.start + stop : step]


def last_measured(y):
    """Return the last measured value of every output at every sample.

    Parameters
    ----------
    y : ndarray of shape (N, ny)
        Outputs; nan where they were not measured.

    Returns
    -------
    y : ndarray of shape (N, ny)
        Every gap filled by what came before it; zero before the first measured value.
    """
    k = np.where(np.isnan(y), 0, np.arange(len(y))[:, None])
    last = np.maximum.accumulate(k, axis=0)
    return np.nan_to_num(np.take_along_axis(y, last, axis=0))


def from_measured(u, y):
    """Return an experiment from its first measured sample on.

    Parameters
    ----------
    u, y : array of shape (N, nu) or (N, ny)
        Inputs and outputs; only sliced.

    Returns
    -------
    u, y : array
        The same; all samples if the first one was measured, or none.
    """
    for part in chunks(len(y)):
        seen = ~np.isnan(y[part]).all(axis=1)
        if seen.any():
            start = part.start + int(np.argmax(seen))
            return (Tail(u, start), Tail(y, start)) if start else (u, y)
    return u, y


def gap(u, y):
    """Return how many samples come before the first measured one.

    Parameters
    ----------
    u, y : array of shape (N, nu) or (N, ny)
        Inputs and outputs; only sliced.

    Returns
    -------
    count : int
        Their number; zero if none was measured.
    """
    return len(u) - len(from_measured(u, y)[0])

"""Experiments: from arrays of users to scaled deviations, and all data errors.

A record is u (N, nu), y (N, ny) with time running down the rows, and one label per
sample that says which experiment the sample belongs to.  The samples of one
experiment are contiguous and in time order; each experiment has its own initial
state, and nothing is ever simulated across a seam.  An output that was not measured at
a sample is nan there.

Identification works on scaled deviations (design of `fit`)

    u_s = (u - u_offset) / u_scale,     y_s = (y - y_offset) / y_scale

where the offsets are the operating point and the scales standard deviations around
the mean.  `Scaling` is the only place that knows both kinds of units.  A `Signal`
scales what is sliced from it, so that a record on disk, or of single precision, is
never copied as a whole.
"""

import importlib
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

WINDOW_GRID = 32  # candidate places of a stretch in every experiment
CHUNK = 100_000  # samples treated at a time


@dataclass(frozen=True, eq=False)
class Scaling:
    """Convert between the user's units and scaled deviations.

    Parameters
    ----------
    u_offset : ndarray of shape (nu,)
        Operating point of the inputs, in the units of `u`.
    y_offset : ndarray of shape (ny,)
        Operating point of the outputs, in the units of `y`.
    u_scale : ndarray of shape (nu,)
        Standard deviations of the inputs.
    y_scale : ndarray of shape (ny,)
        Standard deviations of the outputs.
    """

    u_offset: np.ndarray
    y_offset: np.ndarray
    u_scale: np.ndarray
    y_scale: np.ndarray

    @classmethod
    def from_data(cls, u, y, operating_point):
        """Return the scaling of a record.

        Parameters
        ----------
        u : ndarray of shape (N, nu)
            Inputs.
        y : ndarray of shape (N, ny)
            Outputs; nan where they were not measured.
        operating_point : {"mean", "zero"} or tuple of array_like
            Origin of the deviations; a pair (u_e, y_e) in the user's units.

        Returns
        -------
        scaling : Scaling
            The scaling.

        Raises
        ------
        ValueError
            If an input is constant, an output was never measured, or the operating
            point has the wrong size.
        """
        return cls.from_moments(moments(u), moments(y), operating_point)

    @classmethod
    def from_moments(cls, u, y, operating_point):
        """Return the scaling of records of which only the moments are known.

        Parameters
        ----------
        u, y : tuple of ndarray
            `moments` of inputs and outputs.
        operating_point : {"mean", "zero"} or tuple of array_like
            Origin of the deviations; a pair (u_e, y_e) in the user's units.

        Returns
        -------
        scaling : Scaling
            The scaling.

        Raises
        ------
        ValueError
            As `from_data`.
        """
        _, u_low, u_high, u_mean, u_std = u
        _, _, _, y_mean, y_std = y
        nu, ny = len(u_mean), len(y_mean)
        if not np.isfinite(y_mean).all():
            columns = ", ".join(str(i) for i in np.flatnonzero(~np.isfinite(y_mean)))
            raise ValueError(
                "Input y contains NaN at every sample of column "
                f"{columns}. Leave an output that was never measured out."
            )
        # a column that only carries rounding errors is constant, too
        moves = u_high - u_low > 1e-12 * np.maximum(np.abs(u_low), np.abs(u_high))
        if not moves.all():
            columns = ", ".join(str(i) for i in np.flatnonzero(~moves))
            raise ValueError(
                f"`u` must vary in every column, got constant column {columns}. "
                "An input that never moves cannot be identified: remove it."
            )
        if isinstance(operating_point, str):
            at_mean = operating_point == "mean"
            u_e = u_mean if at_mean else np.zeros(nu)
            y_e = y_mean if at_mean else np.zeros(ny)
        else:
            u_e, y_e = (
                _operating_value(value, size, name)
                for value, size, name in zip(
                    operating_point, (nu, ny), "uy", strict=True
                )
            )
        # a constant output needs no scale: it is predicted by its offset
        return cls(u_e, y_e, u_std, np.where(y_std > 0, y_std, 1.0))

    def scale_u(self, u, delay=None):
        """Return scaled deviations of inputs.

        Parameters
        ----------
        u : array of shape (N, nu)
            Inputs, in the user's units.
        delay : ndarray of int of shape (nu,) or None, default=None
            Samples by which each input arrives late; before the first sample it is
            at the operating point.

        Returns
        -------
        u_s : Signal of shape (N, nu)
            Scaled deviations.
        """
        return Signal(u, self.u_offset, self.u_scale, delay)

    def scale_y(self, y):
        """Return scaled deviations of outputs.

        Parameters
        ----------
        y : array of shape (N, ny)
            Outputs, in the user's units.

        Returns
        -------
        y_s : Signal of shape (N, ny)
            Scaled deviations.
        """
        return Signal(y, self.y_offset, self.y_scale)


class Signal:
    """Scale, and delay, what is sliced from an array of samples.

    Parameters
    ----------
    values : array of shape (N, n)
        Samples of any real type, possibly on disk.
    offset, scale : ndarray of shape (n,)
        A sample z becomes (z - offset) / scale, in double precision.
    delay : ndarray of int of shape (n,) or None, default=None
        Samples by which each column arrives late; zeros fill the beginning.
    """

    dtype = np.dtype(float)

    def __init__(self, values, offset, scale, delay=None):
        self.values, self.offset, self.scale = values, offset, scale
        self.delay = None if delay is None or not np.any(delay) else delay
        self.shape = values.shape

    def __len__(self):
        """Return the number of samples."""
        return self.shape[0]

    def __getitem__(self, part):
        """Return the samples of a slice, shape (L, n)."""
        if self.delay is None:
            return (self.values[part] - self.offset) / self.scale
        start, stop, _ = part.indices(len(self))
        out = np.zeros((stop - start, self.shape[1]))
        for i, d in enumerate(self.delay):
            first = max(start - d, 0)
            late = self.values[first : max(stop - d, 0), i]
            out[len(out) - len(late) :, i] = (late - self.offset[i]) / self.scale[i]
        return out

    def __array__(self, dtype=None, copy=None):
        """Return all samples."""
        return self[:] if dtype is None else self[:].astype(dtype)


def moments(values):
    """Return number, smallest, largest, mean and standard deviation of columns.

    Parameters
    ----------
    values : array of shape (N, n)
        Samples; only sliced. What is nan does not count.

    Returns
    -------
    moments : tuple of ndarray of shape (n,)
        Five rows; those of a column of nothing but nan are nan.
    """
    starts = range(0, len(values), CHUNK)
    chunks = [slice(start, start + CHUNK) for start in starts]
    count = sum(np.sum(~np.isnan(values[part]), axis=0) for part in chunks)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = sum(np.nansum(values[i], axis=0, dtype=float) for i in chunks) / count
        square = sum(np.nansum((values[i] - mean) ** 2, axis=0) for i in chunks)
        std = np.sqrt(square / count)
    low = np.fmin.reduce([np.fmin.reduce(values[part], axis=0) for part in chunks])
    high = np.fmax.reduce([np.fmax.reduce(values[part], axis=0) for part in chunks])
    return count, low, high, mean, std


def merge_moments(parts):
    """Return the moments of several records together.

    Parameters
    ----------
    parts : sequence of tuple of ndarray of shape (n,)
        `moments` of every record.

    Returns
    -------
    moments : tuple of ndarray of shape (n,)
        Moments of all samples.
    """
    counts, lows, highs, means, stds = (np.array(z) for z in zip(*parts, strict=True))
    count = counts.sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(counts * means, axis=0) / count
        square = np.nansum(counts * (stds**2 + (means - mean) ** 2), axis=0)
        std = np.sqrt(square / count)
    return count, np.fmin.reduce(lows), np.fmax.reduce(highs), mean, std


def _operating_value(value, size, name):
    value = np.asarray(value, dtype=float)
    if value.ndim > 1 or value.size not in (1, size) or not np.isfinite(value).all():
        raise ValueError(
            f"`operating_point` must give one finite value per column of `{name}` "
            f"({size}), got {value!r}."
        )
    return np.broadcast_to(value, (size,)).copy()


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
    for start in range(0, len(u), CHUNK):
        gaps = np.isnan(u[start : start + CHUNK])
        if gaps.any():
            k, column = np.argwhere(gaps)[0]
            raise ValueError(
                f"`u` must not contain NaN, got it at sample {start + k} of column "
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
        If the number of labels differs from the number of samples, the samples of one
        experiment are not contiguous, or sample numbers are not integers.
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
    jumps = label[1:] != label[:-1]
    if experiment.ndim == 2:
        number = _sample_numbers(experiment[:, 1])
        jumps = jumps | (np.diff(number) != 1)
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
    if not np.all(number == np.round(number)):
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
    parts = (slice(i, min(i + CHUNK, stop)) for i in range(start, stop, CHUNK))
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
    return _stack(us, "us"), _stack(ys, "ys"), experiment


def is_list_of_records(data):
    """Tell whether data are one array per experiment rather than one array.

    Parameters
    ----------
    data : object
        What a user passed for `u`.

    Returns
    -------
    is_list : bool
        Whether it is a list or tuple of 2-D arrays or DataFrames.
    """
    return (
        isinstance(data, list | tuple)
        and len(data) > 0
        and all(len(getattr(part, "shape", ())) == 2 for part in data)
    )


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
    arrays = [np.asarray(record) for record in records]
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

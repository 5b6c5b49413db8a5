"""Scaling: from the user's units to scaled deviations, and back.

Identification works on scaled deviations (eq. scaling)

    u_s = (u - u_offset) / u_scale,     y_s = (y - y_offset) / y_scale

where the offsets are the operating point and the scales standard deviations around
the mean.  `Scaling` is the only place that knows both kinds of units.  A `Signal`
scales what is sliced from it, so that a record on disk, or of single precision, is
never copied as a whole.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from .checks import numbers_of_shape
from .experiments import Sliced, chunks

EXTREME = 1e30  # size of signals from which products of some of them overflow


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
        _, y_low, y_high, y_mean, y_std = y
        nu, ny = len(u_mean), len(y_mean)
        if not np.isfinite(y_mean).all():
            raise ValueError(
                "`y` must have a measured sample in every column. Input y contains NaN "
                f"at every sample of column {_columns(~np.isfinite(y_mean))}. Leave an "
                "output that was never measured out."
            )
        still = ~_moves(u_low, u_high)
        if still.any():
            raise ValueError(
                f"`u` must vary in every column, got constant column "
                f"{_columns(still)}. An input that never moves cannot be identified: "
                "remove it."
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
        still = ~_moves(y_low, y_high)
        sizes = np.append(u_std, y_std[~still])
        if not np.all((sizes > 1 / EXTREME) & (sizes < EXTREME)):  # nor is nan
            raise ValueError(
                "`u` and `y` must be in units in which their squares are numbers, with "
                f"standard deviations from {1 / EXTREME:g} to {EXTREME:g}, got {u_std} "
                f"and {y_std}. Rescale them."
            )
        if still.any():
            warnings.warn(
                f"`y` does not move in column {_columns(still)}, which is predicted by "
                "its constant. Leave out what tells nothing of the plant.",
                stacklevel=2,
            )
        return cls(u_e, y_e, u_std, np.where(still, 1.0, y_std))

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


class Signal(Sliced):
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

    def __init__(self, values, offset, scale, delay=None):
        self.values, self.offset, self.scale = values, offset, scale
        self.delay = None if delay is None or not np.any(delay) else delay
        self.shape = values.shape

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
    parts = chunks(len(values))
    count = sum(np.sum(~np.isnan(values[i]), axis=0) for i in parts)
    # beyond the range of numbers: refused by `Scaling`
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        mean = sum(np.nansum(values[i], axis=0, dtype=float) for i in parts) / count
        square = sum(np.nansum((values[i] - mean) ** 2, axis=0) for i in parts)
        std = np.sqrt(square / count)
    low = np.fmin.reduce([np.fmin.reduce(values[i], axis=0) for i in parts])
    high = np.fmax.reduce([np.fmax.reduce(values[i], axis=0) for i in parts])
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


def _moves(low, high):
    """Return which columns carry more than rounding errors."""
    return high - low > 1e-12 * np.maximum(np.abs(low), np.abs(high))


def _columns(which):
    """Return the numbers of columns, for a message."""
    return ", ".join(str(i) for i in np.flatnonzero(which))


def _operating_value(value, size, name):
    values = numbers_of_shape(value, size)
    if not np.isfinite(values).all():
        raise ValueError(
            f"`operating_point` must give one finite value per column of `{name}` "
            f"({size}), got {value!r}."
        )
    return values

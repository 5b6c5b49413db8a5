"""Experiments: from arrays of users to scaled deviations, and all data errors.

A record is u (N, nu), y (N, ny) with time running down the rows, and one label per
sample that says which experiment the sample belongs to.  The samples of one
experiment are contiguous and in time order; each experiment has its own initial
state, and nothing is ever simulated across a seam.

Identification works on scaled deviations (design of `fit`)

    u_s = (u - u_offset) / u_scale,     y_s = (y - y_offset) / y_scale

where the offsets are the operating point and the scales standard deviations around
the mean.  `Scaling` is the only place that knows both kinds of units.
"""

from dataclasses import dataclass

import numpy as np

WINDOW_GRID = 32  # candidate places of a stretch in every experiment


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
            Outputs.
        operating_point : {"mean", "zero"} or tuple of array_like
            Origin of the deviations; a pair (u_e, y_e) in the user's units.

        Returns
        -------
        scaling : Scaling
            The scaling.

        Raises
        ------
        ValueError
            If an input is constant or the operating point has the wrong size.
        """
        # a column that only carries rounding errors is constant, too
        moves = np.ptp(u, axis=0) > 1e-12 * np.abs(u).max(axis=0)
        if not moves.all():
            columns = ", ".join(str(i) for i in np.flatnonzero(~moves))
            raise ValueError(
                f"`u` must vary in every column, got constant column {columns}. "
                "An input that never moves cannot be identified: remove it."
            )
        y_std = y.std(axis=0)
        if isinstance(operating_point, str):
            at_mean = operating_point == "mean"
            u_e = u.mean(axis=0) if at_mean else np.zeros(u.shape[1])
            y_e = y.mean(axis=0) if at_mean else np.zeros(y.shape[1])
        else:
            u_e, y_e = (
                _operating_value(value, size, name)
                for value, size, name in zip(
                    operating_point, (u.shape[1], y.shape[1]), "uy", strict=True
                )
            )
        # a constant output needs no scale: it is predicted by its offset
        return cls(u_e, y_e, u.std(axis=0), np.where(y_std > 0, y_std, 1.0))

    def scale_u(self, u):
        """Return scaled deviations of inputs.

        Parameters
        ----------
        u : ndarray of shape (N, nu)
            Inputs, in the user's units.

        Returns
        -------
        u_s : ndarray of shape (N, nu)
            Scaled deviations.
        """
        return (u - self.u_offset) / self.u_scale

    def scale_y(self, y):
        """Return scaled deviations of outputs.

        Parameters
        ----------
        y : ndarray of shape (N, ny)
            Outputs, in the user's units.

        Returns
        -------
        y_s : ndarray of shape (N, ny)
            Scaled deviations.
        """
        return (y - self.y_offset) / self.y_scale


def _operating_value(value, size, name):
    value = np.asarray(value, dtype=float)
    if value.ndim > 1 or value.size not in (1, size) or not np.isfinite(value).all():
        raise ValueError(
            f"`operating_point` must give one finite value per column of `{name}` "
            f"({size}), got {value!r}."
        )
    return np.broadcast_to(value, (size,)).copy()


def split_experiments(n_samples, experiment):
    """Return the samples of every experiment.

    Parameters
    ----------
    n_samples : int
        Number of samples.
    experiment : array_like of shape (n_samples,) or None
        Label of every sample; None means one experiment.

    Returns
    -------
    parts : list of slice
        Samples of every experiment, in order of appearance.
    labels : list
        Their labels; ``[None]`` if `experiment` is None.

    Raises
    ------
    ValueError
        If the number of labels differs from the number of samples, or the samples
        of one experiment are not contiguous.
    """
    if experiment is None:
        return [slice(0, n_samples)], [None]
    experiment = np.asarray(experiment)
    if experiment.shape != (n_samples,):
        raise ValueError(
            f"`experiment` must have one label per sample, shape ({n_samples},), got "
            f"{experiment.shape}."
        )
    starts = np.flatnonzero(np.r_[True, experiment[1:] != experiment[:-1]])
    stops = [*starts[1:], n_samples]
    labels = experiment[starts].tolist()
    if len(set(labels)) < len(labels):
        raise ValueError(
            "`experiment` must label contiguous samples, got a label that returns "
            "after another one. Give every uninterrupted run a label of its own."
        )
    return [slice(int(a), int(b)) for a, b in zip(starts, stops, strict=True)], labels


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
        energy = np.concatenate([[0.0], np.cumsum(np.sum(u**2, 1) + np.sum(y**2, 1))])
        start = starts[np.argmax(energy[starts + length] - energy[starts])]
        out.append((u[start : start + length], y[start : start + length]))
    return out

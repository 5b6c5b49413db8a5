"""The value that all signals are returned as."""

import csv
import io
from dataclasses import dataclass
from importlib import import_module

import numpy as np

from ..checks import count
from ..whole_files import replace_file


@dataclass(frozen=True, eq=False, repr=False)
class Excitation:
    """Hold inputs to record a plant with.

    Experiments stand below each other, time running down the rows: all periods of the
    first one, then those of the next. Realizations are drawn independently; one of
    several inputs can take as many experiments as there are inputs.

    Parameters
    ----------
    u : ndarray of shape (N, nu)
        Inputs, in their own units; read-only.
    dt : float
        Sampling time, in seconds.
    experiment : ndarray of int of shape (N,)
        Number of the experiment of every sample, from 0.
    period : int
        Samples after which an experiment repeats itself.
    n_periods : int
        Periods of every experiment.
    n_realizations : int
        Independent draws; each has as many experiments as the others.
    lines : ndarray of int or None
        Lines of the DFT of one period that are excited; None of signals that are not
        made of lines.
    low, high : ndarray of shape (nu,)
        Limits.
    operating_point : ndarray of shape (nu,)
        Value around which the plant is excited.
    names : tuple of str
        Names of the inputs.
    kind : str
        Name of the function that made it.

    Examples
    --------
    >>> from alssnn.excitation import multisine
    >>> excitation = multisine(1000, dt=0.01, band=(0.5, 20), random_state=0)
    >>> excitation
    Excitation('multisine', N=12000, nu=1, dt=0.01 s, 4 experiments of 3 periods)
    >>> excitation.frequencies[[0, -1]]
    array([ 0.5, 20. ])
    >>> u = excitation.experiments[0]  # send this to the plant
    >>> u.shape, bool(abs(u).max() <= 1)
    ((3000, 1), True)
    """

    u: np.ndarray
    dt: float
    experiment: np.ndarray
    period: int
    n_periods: int
    n_realizations: int
    lines: np.ndarray | None
    low: np.ndarray
    high: np.ndarray
    operating_point: np.ndarray
    names: tuple[str, ...]
    kind: str

    def __post_init__(self):
        """Make the arrays read-only."""
        for array in (self.u, self.experiment, self.lines, self.low, self.high):
            if array is not None:
                array.flags.writeable = False

    def __len__(self):
        """Return the number of samples."""
        return len(self.u)

    def __repr__(self):
        """Return one line that names the signal and its sizes."""
        N, nu = self.u.shape
        return (
            f"Excitation({self.kind!r}, N={N}, nu={nu}, dt={self.dt:.6g} s, "
            f"{self.n_experiments} experiments of {self.n_periods} periods)"
        )

    @property
    def n_experiments(self):
        """Return the number of experiments."""
        return len(self.u) // (self.period * self.n_periods)

    @property
    def experiments(self):
        """Return the inputs of every experiment, a list of arrays (N_i, nu)."""
        return list(self.u.reshape(self.n_experiments, -1, self.u.shape[1]))

    @property
    def realization(self):
        """Return the realization of every sample, an array of int of shape (N,)."""
        return self.experiment // (self.n_experiments // self.n_realizations)

    @property
    def frequencies(self):
        """Return the frequencies of `lines` in Hz; None of signals without lines."""
        return None if self.lines is None else self.lines / (self.period * self.dt)

    @property
    def crest_factor(self):
        """Return the largest deviation over the rms deviation, per input, (nu,)."""
        deviation = self.u - self.operating_point
        rms = np.sqrt(np.mean(deviation**2, axis=0))
        peak = np.abs(deviation).max(axis=0)
        return peak / np.where(rms > 0, rms, 1.0)

    def to_csv(self, path):
        """Write the inputs as CSV: time, the inputs by name, experiment.

        Add the columns of the measured outputs, and the file is a record for
        ``alssnn fit --experiment experiment``.

        Parameters
        ----------
        path : str or path-like
            File to write; its folder must exist.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(["time", *self.names, "experiment"])
        for k, (row, label) in enumerate(
            zip(self.u.tolist(), self.experiment.tolist(), strict=True)
        ):
            writer.writerow([f"{k * self.dt:.12g}", *map(repr, row), label])
        replace_file(path, text.getvalue())

    def plot(self, ax=None, **kwargs):
        """Draw the inputs of the first experiments over time, and their spectrum.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per input; None makes a figure.
        **kwargs : dict
            Options of the curves.

        Returns
        -------
        display : ExcitationDisplay
            The display of :mod:`alssnn.plotting`, drawn.
        """
        # by name: figures lie above what is drawn, and matplotlib loads when asked for
        plotting = import_module("alssnn.plotting")
        return plotting.ExcitationDisplay(self).plot(ax, **kwargs)


def repeat(u, dt, limits, n_periods, n_realizations, lines, names, kind):
    """Repeat the periods of all experiments.

    Parameters
    ----------
    u : ndarray of shape (n_experiments, period, nu)
        One period of every experiment.
    dt : float
        Sampling time, in seconds.
    limits : Limits
        Limits.
    n_periods : int
        Periods of every experiment.
    n_realizations : int
        Independent draws among the experiments.
    lines : ndarray of int or None
        Lines that are excited.
    names : tuple of str
        Names of the inputs.
    kind : str
        Name of the function that made it.

    Returns
    -------
    excitation : Excitation
        The value.

    Raises
    ------
    ValueError
        If `n_periods` is no positive integer.
    """
    n_periods = count("n_periods", n_periods)
    n, period, nu = u.shape
    return Excitation(
        np.tile(u, (1, n_periods, 1)).reshape(-1, nu),
        dt,
        np.repeat(np.arange(n), period * n_periods),
        period,
        n_periods,
        n_realizations,
        lines,
        limits.low,
        limits.high,
        limits.operating_point,
        names,
        kind,
    )

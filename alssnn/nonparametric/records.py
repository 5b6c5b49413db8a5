"""Records as lists of experiments, all messages in the words of the user."""

from dataclasses import dataclass

import numpy as np

from ..checks import as_signal
from ..containers import Container
from ..excitation import Excitation
from ..experiments import join_records, split_experiments
from ..names import signal_names


@dataclass(frozen=True, eq=False)
class Records:
    """Hold the experiments of a record.

    Parameters
    ----------
    pairs : list of tuple of ndarray
        Pairs (u, y) of shapes (N, nu) and (N, ny); y is nan where it was not measured.
    labels : list
        Labels of the experiments.
    input_names, output_names : tuple of str
        Names of the signals.
    """

    pairs: list
    labels: list
    input_names: tuple
    output_names: tuple

    @property
    def u(self):
        """Return the inputs of all experiments, shape (N, nu)."""
        return np.concatenate([u for u, _ in self.pairs])

    @property
    def y(self):
        """Return the outputs of all experiments, shape (N, ny)."""
        return np.concatenate([y for _, y in self.pairs])

    @property
    def nu(self):
        """Return the number of inputs."""
        return len(self.input_names)

    @property
    def ny(self):
        """Return the number of outputs."""
        return len(self.output_names)

    @property
    def rests(self):
        """Return which inputs, then outputs, do not move, or were never measured."""
        signals = np.hstack([self.u, self.y])  # a deviation from a mean has rounding
        return ~(np.fmax.reduce(signals) > np.fmin.reduce(signals))

    @classmethod
    def of(cls, u, y, experiment=None):
        """Check a record and split it into experiments.

        Parameters
        ----------
        u : array_like of shape (N, nu) or (N,), list of them, or Excitation
            Inputs.
        y : array_like of shape (N, ny) or (N,), or list of them
            Outputs; nan where not measured.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.

        Returns
        -------
        records : Records
            The experiments.

        Raises
        ------
        ValueError
            If the signals are no records, or do not fit each other.
        """
        names = None
        if isinstance(u, Excitation):
            names = u.names
            if experiment is None and _is_list(y) and len(y) == u.n_experiments:
                u = u.experiments
            else:
                experiment = u.experiment if experiment is None else experiment
                u = u.u
        u, y, experiment = join_records(u, y, experiment)
        names = Container.of(u).output_names if names is None else names
        output_names = Container.of(y).output_names
        u, y = as_signal("u", u), as_signal("y", y, gaps=True)
        if len(u) != len(y):
            raise ValueError(
                "`u` and `y` must have the same number of samples, got "
                f"{len(u)} and {len(y)}."
            )
        parts, labels = split_experiments(len(u), experiment)
        return cls(
            [(u[part], y[part]) for part in parts],
            labels,
            tuple(signal_names(names, "u", u.shape[1])),
            tuple(signal_names(output_names, "y", y.shape[1])),
        )


def _is_list(y):
    """Tell whether y is a list of records, which may have one dimension."""
    return isinstance(y, list | tuple) and all(np.ndim(part) > 0 for part in y)

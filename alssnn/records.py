"""One experiment of a record, prepared as everything that judges a model takes it.

The policy is written once, in `prepare_records` of the estimators: the initial state of
every experiment is estimated from its first `n_init_samples` samples, at most a quarter
of it, and these samples are not scored.
"""

from dataclasses import dataclass

import numpy as np

from .scaling import Scaling, Signal
from .shown import short_repr


@dataclass(frozen=True, eq=False)
class PreparedRecord:
    """Hold the samples of one experiment in all units, and where it starts.

    Parameters
    ----------
    part : slice
        Rows of the experiment in the data.
    u : ndarray of shape (N, nu)
        Inputs as they were sent, in the user's units.
    y : ndarray of shape (N, ny)
        Outputs, in the user's units; nan where not measured.
    u_s : Signal or ndarray of shape (N, nu or more)
        Scaled deviations of the inputs that have arrived: late inputs are late. A
        model in continuous time has further columns, for what u does between samples.
    y_s : Signal of shape (N, ny)
        Scaled deviations of the outputs.
    x0 : ndarray of shape (nx,)
        Estimated state at the first sample, in the basis of `A_`.
    start : int
        Number of first samples that the estimate is made from.
    scaling : Scaling
        The units.

    Examples
    --------
    >>> data = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=data.dt).fit(*data)
    >>> (record,) = model.prepare_records(*data)
    >>> record.part, record.start, record.x0.shape
    (slice(0, 800, None), 50, (4,))
    >>> np.allclose(record.dy + model.y_offset_, record.y)
    True
    """

    __repr__ = short_repr

    part: slice
    u: np.ndarray
    y: np.ndarray
    u_s: Signal | np.ndarray
    y_s: Signal
    x0: np.ndarray
    start: int
    scaling: Scaling

    @property
    def du(self):
        """Return deviations of the inputs that have arrived, in the user's units."""
        nu = self.u.shape[1]  # behind them, what u does between samples
        return self.u_s[:][:, :nu] * self.scaling.u_scale

    @property
    def dy(self):
        """Return deviations of the outputs, in the user's units."""
        return self.y_s[:] * self.scaling.y_scale

    @property
    def scored(self):
        """Return the samples that count, as a slice of this experiment."""
        return slice(self.start, len(self.y))

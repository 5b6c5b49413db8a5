"""The record: one experiment on one plant, as every loader and maker returns it."""

from collections.abc import Iterator
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False, repr=False)
class Record:
    """Input and output of one experiment, sampled at a fixed rate.

    A record unpacks into its two signals, ``u, y = record``, and its length is the
    number of samples. It cannot be reassigned; its arrays are not copied when they
    already are 2-D arrays of floats.

    Parameters
    ----------
    u : array-like of shape (N, nu) or (N,)
        Input, in its physical unit.
    y : array-like of shape (N, ny) or (N,)
        Output, in its physical unit.
    dt : float
        Sampling time, in seconds.
    name : str
        What was recorded, for titles and error messages.
    plant : control.NonlinearIOSystem, default=None
        True plant of a simulated record, in discrete time; None if it is unknown.
    x0 : array-like of shape (nx,), default=None
        State of `plant` at the first sample; None if it is unknown.

    Attributes
    ----------
    u : ndarray of shape (N, nu)
        Input.
    y : ndarray of shape (N, ny)
        Output.
    dt : float
        Sampling time, in seconds.
    name : str
        What was recorded.
    plant : control.NonlinearIOSystem or None
        True plant.
    x0 : ndarray of shape (nx,) or None
        State of `plant` at the first sample.

    Raises
    ------
    TypeError
        If `name` is not a string, or `dt` is not a number.
    ValueError
        If a signal is not a nonempty, finite, real array of one or two dimensions, if
        the signals differ in length, or if `dt` is not positive and finite.

    Examples
    --------
    >>> from alssnn.datasets import Record
    >>> record = Record([0.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.5, 0.75], 0.1, "step")
    >>> record
    Record('step', N=4, nu=1, ny=1, dt=0.1 s)
    >>> u, y = record
    >>> train, test = record.split(0.75)
    >>> len(train), len(test)
    (3, 1)
    """

    u: np.ndarray
    y: np.ndarray
    dt: float
    name: str
    plant: Any = None
    x0: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Check the fields and give the signals two dimensions."""
        u = _as_signal(self.u, "u")  # (N, nu)
        y = _as_signal(self.y, "y")  # (N, ny)
        if len(u) != len(y):
            raise ValueError(
                "`u` and `y` must have the same number of samples, "
                f"got {len(u)} and {len(y)}. Time runs down the rows; transpose "
                "signals stored as (signals, time)."
            )
        if isinstance(self.dt, bool) or not isinstance(self.dt, Real):
            raise TypeError(
                f"`dt` must be a number, got {self.dt!r}. "
                "Give the sampling time in seconds."
            )
        if not 0 < self.dt < np.inf:
            raise ValueError(
                f"`dt` must be positive and finite, got {self.dt}. "
                "Give the sampling time in seconds."
            )
        if not isinstance(self.name, str):
            raise TypeError(
                f"`name` must be a string, got {self.name!r}. "
                "Say in a few words what was recorded."
            )
        # A frozen dataclass can only be normalized through object.__setattr__.
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "y", y)
        object.__setattr__(self, "dt", float(self.dt))
        if self.x0 is not None:
            object.__setattr__(self, "x0", _as_state(self.x0))

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield `u`, then `y`."""
        return iter((self.u, self.y))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.u)

    def __repr__(self) -> str:
        """Return one line that names the record and its sizes."""
        N, nu = self.u.shape
        plant = "" if self.plant is None else f", plant={type(self.plant).__name__}"
        return (
            f"Record({self.name!r}, N={N}, nu={nu}, ny={self.y.shape[1]}, "
            f"dt={self.dt:.6g} s{plant})"
        )

    def split(self, n: int | float) -> tuple["Record", "Record"]:
        """Split into the first `n` samples and the rest.

        Parameters
        ----------
        n : int or float
            Number of samples of the first part, or its fraction of the record, in
            (0, 1), which is rounded to the nearest number of samples.

        Returns
        -------
        first, rest : Record
            The two parts, as views of the signals. Both carry `plant`; only the first
            one carries `x0`, as the state at the start of the rest is not stored.

        Raises
        ------
        TypeError
            If `n` is neither an integer nor a float.
        ValueError
            If one of the two parts would be empty.
        """
        if isinstance(n, bool) or not isinstance(n, Real):
            raise TypeError(
                f"`n` must be an int or a float, got {n!r}. "
                "Give a number of samples or a fraction of the record."
            )
        if not isinstance(n, Integral) and not 0 < n < 1:
            raise ValueError(
                f"`n` must lie strictly between 0 and 1 when it is a float, got {n}. "
                "Give an int for a number of samples."
            )
        N = len(self)
        n_first = int(n) if isinstance(n, Integral) else round(float(n) * N)
        if not 0 < n_first < N:
            raise ValueError(
                f"`n` must leave at least one of the {N} samples to each part, "
                f"got {n}. Choose 1 to {N - 1} samples, or split a longer record."
            )
        first = Record(
            self.u[:n_first],
            self.y[:n_first],
            self.dt,
            f"{self.name}[:{n_first}]",
            self.plant,
            self.x0,
        )
        rest = Record(
            self.u[n_first:],
            self.y[n_first:],
            self.dt,
            f"{self.name}[{n_first}:]",
            self.plant,
        )
        return first, rest


def _as_real_array(values, name):
    """Convert to a finite float array of any shape."""
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":  # text and complex would convert silently
        raise ValueError(
            f"`{name}` must be an array of real numbers, got dtype {array.dtype}. "
            "Convert it to floats first."
        )
    array = array.astype(float, copy=False)
    if not np.isfinite(array).all():
        row = int(np.argwhere(~np.isfinite(array))[0][0]) if array.ndim else 0
        raise ValueError(
            f"`{name}` must be finite, got NaN or infinity at row {row}. "
            "Interpolate the sample or cut the record there."
        )
    return array


def _as_signal(values, name):
    """Convert to a float array of shape (N, n_signals) with at least one sample."""
    signal = _as_real_array(values, name)
    if signal.ndim not in (1, 2) or signal.size == 0:
        raise ValueError(
            f"`{name}` must be a nonempty array of shape (N,) or (N, n_signals), "
            f"got shape {signal.shape}. Let time run down the rows."
        )
    return signal.reshape(len(signal), -1)


def _as_state(values):
    """Convert to a float array of shape (nx,)."""
    x0 = _as_real_array(values, "x0")
    if x0.ndim != 1:
        raise ValueError(
            f"`x0` must be of shape (nx,), got shape {x0.shape}. "
            "Flatten it to one dimension."
        )
    return x0

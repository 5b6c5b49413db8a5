"""The record: one experiment on one plant, as every loader and maker returns it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from numbers import Integral, Real
from typing import Any

import numpy as np

from ..checks import as_signal, is_count, is_positive
from ..containers import check_rows_meet
from ._checks import _check_number, _check_positive
from ._columns import as_list, as_names, as_state


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
        Output, in its physical unit; nan where not measured.
    dt : float
        Sampling time, in seconds.
    name : str, default="record"
        What was recorded, for titles and error messages.
    plant : control.NonlinearIOSystem, default=None
        True plant of a simulated record, in discrete time; None if it is unknown.
    x0 : array-like of shape (nx,), default=None
        State of `plant` at the first sample; None if it is unknown.
    inputs, outputs : sequence of str or None, default=None
        Names of the signals, such as "valve [%]"; None means u0, u1, ... and y0, ...

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
    inputs, outputs : list of str
        Names of the signals.

    Raises
    ------
    TypeError
        If `name` is not a string, or `dt` is not a number.
    ValueError
        If a signal is not a nonempty, finite, real array of one or two dimensions
        (outputs may have gaps), if the signals differ in length or have rows of other
        times, if `dt` is not positive and finite, or if names are missing or double.

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

    Of your own, with names, prepared, into a fit:

    >>> record = Record.from_csv("plant.csv", "valve_pct", "level_cm")  # doctest: +SKIP
    >>> train, test = record.detrend().decimate(5).split(0.7)  # doctest: +SKIP
    >>> model.fit(*train.to_frames())  # doctest: +SKIP
    """

    u: np.ndarray
    y: np.ndarray
    dt: float
    name: str = "record"
    plant: Any = None
    x0: np.ndarray | None = None
    inputs: Any = None
    outputs: Any = None

    def __post_init__(self) -> None:
        """Check the fields and give the signals two dimensions."""
        check_rows_meet(self.u, self.y)
        u = as_signal("u", self.u)  # (N, nu)
        y = as_signal("y", self.y, gaps=True)  # (N, ny)
        if len(u) != len(y):
            raise ValueError(
                "`u` and `y` must have the same number of samples, "
                f"got {len(u)} and {len(y)}. Time runs down the rows; transpose "
                "signals stored as (signals, time)."
            )
        remedy = "Give the sampling time in seconds."
        _check_number("dt", self.dt, remedy)
        _check_positive("dt", self.dt, remedy)
        if not isinstance(self.name, str):
            raise TypeError(
                f"`name` must be a string, got {self.name!r}. "
                "Say in a few words what was recorded."
            )
        # A frozen dataclass can only be normalized through object.__setattr__.
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "y", y)
        object.__setattr__(self, "dt", float(self.dt))
        names = as_names(self.inputs, "u", u.shape[1])
        names += as_names(self.outputs, "y", y.shape[1])
        if len(set(names)) < len(names):
            raise ValueError(
                f"`inputs` and `outputs` must be different names, got {names}."
            )
        object.__setattr__(self, "inputs", names[: u.shape[1]])
        object.__setattr__(self, "outputs", names[u.shape[1] :])
        if self.x0 is not None:
            object.__setattr__(self, "x0", as_state(self.x0))

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

    @classmethod
    def from_csv(
        cls,
        path: Any,
        inputs: str | Sequence[str],
        outputs: str | Sequence[str],
        *,
        time: str | None = None,
        dt: float | None = None,
        name: str | None = None,
    ) -> "Record":
        """Read a record from a CSV file with a header.

        Parameters
        ----------
        path : str or path-like
            File; columns are separated by comma, semicolon or tab.
        inputs, outputs : str or sequence of str
            Names of the columns; a cell of an output may be empty: not measured.
        time : str or None, default=None
            Column of time, in seconds or in the unit that its name ends in, such as
            time_ms or t [ms]; None looks for one named time or t.
        dt : float or None, default=None
            Sampling time, in seconds; None takes it from the column of time.
        name : str or None, default=None
            What was recorded; None means the path.

        Returns
        -------
        record : Record
            The record, with the names of the columns.

        Raises
        ------
        OSError
            If the file cannot be read.
        ValueError
            If a column is missing or no signal, an input has a gap, or there is no
            sampling time, or none that is even.
        """
        from ._reading import csv_signals

        inputs, outputs = as_list(inputs), as_list(outputs)
        u, y, dt = csv_signals(path, inputs, outputs, time, dt)
        name = str(path) if name is None else name
        return cls(u, y, dt, name, inputs=inputs, outputs=outputs)

    @classmethod
    def from_dataframe(
        cls,
        frame: Any,
        inputs: str | Sequence[str],
        outputs: str | Sequence[str],
        *,
        time: str | None = None,
        dt: float | None = None,
        name: str = "record",
    ) -> "Record":
        """Take a record from a DataFrame.

        Parameters
        ----------
        frame : DataFrame
            Data of pandas or polars.
        inputs, outputs : str or sequence of str
            Names of the columns; nan of an output was not measured.
        time : str or None, default=None
            Column of time, in seconds or in the unit that its name ends in, or as
            dates; None takes the index of pandas if it holds dates or durations.
        dt : float or None, default=None
            Sampling time, in seconds; None takes it from the times.
        name : str, default="record"
            What was recorded.

        Returns
        -------
        record : Record
            The record, with the names of the columns.

        Raises
        ------
        ValueError
            If a column is missing, an input has a gap, or there is no sampling time,
            or none that is even.
        """
        from ._reading import frame_signals

        inputs, outputs = as_list(inputs), as_list(outputs)
        u, y, dt = frame_signals(frame, inputs, outputs, time, dt)
        return cls(u, y, dt, name, inputs=inputs, outputs=outputs)

    @staticmethod
    def merge(records: Sequence["Record"]) -> tuple[Any, Any, np.ndarray]:
        """Join experiments on one plant, as `fit` takes them.

        Parameters
        ----------
        records : sequence of Record
            Records of the same signals, sampled at the same rate.

        Returns
        -------
        u : ndarray of shape (N, nu), or DataFrame
            Inputs of all records; a DataFrame if the signals have names.
        y : ndarray of shape (N, ny), or DataFrame
            Outputs.
        experiment : ndarray of int of shape (N,)
            Number of the record of every sample, from 0.

        Raises
        ------
        ValueError
            If there are none, or signals or sampling times differ.
        """
        if isinstance(records, Record) or not len(records):
            found = "a record itself" if isinstance(records, Record) else "none"
            raise ValueError(f"`records` must be a list of records, got {found}.")
        first = records[0]
        for i, record in enumerate(records):
            for what in ("inputs", "outputs", "dt"):
                found, wanted = getattr(record, what), getattr(first, what)
                if found != wanted:
                    raise ValueError(
                        f"`records` must have the same {what}, got {wanted} in the "
                        f"first and {found} in number {i}. Resample or rename them."
                    )
        joined = replace(
            first,
            u=np.concatenate([record.u for record in records]),
            y=np.concatenate([record.y for record in records]),
        )
        u, y = joined.to_frames() if first.is_named else joined
        return u, y, np.repeat(np.arange(len(records)), [len(r) for r in records])

    @property
    def is_named(self) -> bool:
        """Return whether its signals have names of their own."""
        nu, ny = self.u.shape[1], self.y.shape[1]
        return [*self.inputs, *self.outputs] != [
            *as_names(None, "u", nu),
            *as_names(None, "y", ny),
        ]

    @property
    def t(self) -> np.ndarray:
        """Return the times of the samples, in seconds, from zero."""
        return self.dt * np.arange(len(self))

    def to_frames(self) -> tuple[Any, Any]:
        """Return inputs and outputs as DataFrames of pandas, which carry the names.

        Returns
        -------
        u, y : DataFrame
            The signals; ``fit(*record.to_frames())`` keeps their names.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        pandas = import_module("pandas")
        return (
            pandas.DataFrame(self.u, columns=self.inputs),
            pandas.DataFrame(self.y, columns=self.outputs),
        )

    def plot(self, ax: Any = None, **kwargs: Any) -> Any:
        """Draw all signals against time.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output, then one per input; None makes a figure.
        **kwargs : dict
            Options of all curves.

        Returns
        -------
        display : RecordDisplay
            The display of :mod:`alssnn.plotting`, drawn.
        """
        # by name: figures lie above what is drawn, and matplotlib loads when asked for
        plotting = import_module("alssnn.plotting")
        return plotting.RecordDisplay(self).plot(ax, **kwargs)

    def detrend(self, *, inputs: bool = False) -> "Record":
        """Take out the linear trend of every output; its mean stays.

        Parameters
        ----------
        inputs : bool, default=False
            Whether inputs lose their trend, too. They are what was sent, which mostly
            has none.

        Returns
        -------
        record : Record
            The record without trend. The mean is the operating point, which a fit
            looks after.

        Notes
        -----
        Only for a sensor that drifts. What the plant itself does slowly goes, too, and
        a nonlinear model misses it: the fit of a simulated pendulum without drift fell
        from 99.0 to 87.7 %.
        """
        from ._resampling import without_line

        u = without_line(self.u) if inputs else self.u
        return replace(self, u=u, y=without_line(self.y), plant=None, x0=None)

    def decimate(self, q: int) -> "Record":
        """Keep one of `q` samples, behind a low-pass filter.

        Parameters
        ----------
        q : int
            Factor.

        Returns
        -------
        record : Record
            The record with the sampling time q dt, see `resample`.

        Raises
        ------
        ValueError
            If `q` is no positive integer, or an output has gaps.
        """
        if not is_count(q):
            raise ValueError(f"`q` must be a positive integer, got {q!r}.")
        return self._at(1, int(q))

    def resample(self, dt: float) -> "Record":
        """Return the record at another rate.

        Parameters
        ----------
        dt : float
            New sampling time, in seconds; a ratio of whole numbers to the old one.

        Returns
        -------
        record : Record
            The record. Inputs and outputs go through the same low-pass filter without
            delay (`scipy.signal.resample_poly`), so that the plant between them stays
            what it is.

        Raises
        ------
        ValueError
            If `dt` does not fit, or an output has gaps.
        """
        from ._resampling import ratio

        if not is_positive(dt):
            raise ValueError(f"`dt` must be positive and finite, got {dt!r}.")
        return self._at(*ratio(self.dt, float(dt)))

    def _at(self, up: int, down: int) -> "Record":
        """Return the record at up / down times its rate."""
        from ._resampling import at_rate

        if up == down:
            return self
        if np.isnan(self.y).any():
            row = int(np.argwhere(np.isnan(self.y))[0][0])
            raise ValueError(
                f"`y` must be measured at every sample to change the rate, got a gap "
                f"at row {row}. Fill it, or cut the record there."
            )
        u, y = (at_rate(z, up, down) for z in self)
        return replace(self, u=u, y=y, dt=self.dt * down / up, plant=None, x0=None)

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
        k = int(n) if isinstance(n, Integral) else round(float(n) * N)
        if not 0 < k < N:
            raise ValueError(
                f"`n` must leave at least one of the {N} samples to each part, "
                f"got {n}. Choose 1 to {N - 1} samples, or split a longer record."
            )
        u, y, name = self.u, self.y, self.name
        first = replace(self, u=u[:k], y=y[:k], name=f"{name}[:{k}]")
        return first, replace(self, u=u[k:], y=y[k:], name=f"{name}[{k}:]", x0=None)

"""The records of a ladder: rows, and the table they make."""

import textwrap
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..estimators import LEFT_LINEAR
from ..rows import Rows, aligned
from ..shown import percent, short_repr
from ..watch import late_fall
from ._explain import TEXT_WIDTH, drifts, explain, fault

SETTLED = 0.01  # fall of the cost in the end below which more steps hardly matter,
ENOUGH_STEPS = 20  # if it took at least so many
HEADER = (
    "|para-|RMSE|RMSE|fit|nonlin.|in the|radius|time".split("|"),
    "model|meters|train|test|%|rest, %|loop, %|of A|s".split("|"),
)
PER_OUTPUT = (  # figures of the table
    "rmse_train",
    "rmse_test",
    "fit_percent",
    "linearization_error",
    "closed_linearization_error",
)


@dataclass(frozen=True, eq=False)
class Rung:
    """Hold one fitted model and its figures.

    Parameters
    ----------
    name : str
        Name of the model.
    model : object
        Fitted estimator.
    n_params : int
        Trained parameters, without initial states.
    rmse_train, rmse_test : ndarray of shape (ny,)
        Root-mean-square error of the free-run simulation per output, in the units
        of y; inf if the simulation diverges.
    fit_percent : ndarray of shape (ny,)
        Fit of the test output, in percent; -inf if the simulation diverges.
    linearization_error : ndarray of shape (ny,)
        Per output, rms(e) / std(y) on the test data (eq. gauge); inf if e diverges.
    spectral_radius : float
        Largest modulus of the eigenvalues of A.
    seconds : float
        Duration of the fit, in seconds.
    y_hat : ndarray of shape (n_scored, ny)
        Simulated test output, in the units of y.
    e : ndarray of shape (n_scored, ny)
        Output-referred residual, in the units of y; inf if it diverges.
    no_law : str, default=""
        Why u = v - h(s) is no law of this model; empty if it is one.
    closed_linearization_error : ndarray of shape (ny,), default=0
        Size rms(e) / std(y_lin) in the loop u = v - h with the recorded input as v; nan
        without a law.
    closed_outside : float or None, default=0.0
        Share of samples of that loop outside the region of the training data.
    large_law : float, default=0.0
        How large the law is over the recorded input if that is too much.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> ladder = alssnn.model_ladder(*record, nx=4, dt=record.dt, models=["lti"])
    >>> rung = ladder["LTI"]
    >>> type(rung.model).__name__, rung.linearization_error
    ('LinearStateSpace', array([0.]))
    """

    __repr__ = short_repr

    name: str
    model: Any = field(repr=False)
    n_params: int
    rmse_train: np.ndarray
    rmse_test: np.ndarray
    fit_percent: np.ndarray
    linearization_error: np.ndarray
    spectral_radius: float
    seconds: float
    y_hat: np.ndarray = field(repr=False)
    e: np.ndarray = field(repr=False)
    no_law: str = ""
    closed_linearization_error: np.ndarray | float = 0.0
    closed_outside: float | None = 0.0
    large_law: float = 0.0

    @property
    def converged(self):
        """Return whether the training reached a tolerance."""
        return self.model.converged_

    @property
    def is_left_linear(self):
        """Return whether the fit gave up its networks and left the linear model."""
        return getattr(self.model, "message_", "").startswith(LEFT_LINEAR)


@dataclass(frozen=True, eq=False)
class Ladder(Rows):
    """Compare models of the same data.

    ``str(ladder)`` is the table, ``ladder["AL-SSNN"]`` one row.

    Parameters
    ----------
    rows : tuple of Rung
        One row per model.
    y_test : ndarray of shape (n_scored, ny)
        Measured test output at the scored samples, in its physical unit.
    parts : tuple of slice
        Rows of `y_test` of every test experiment.
    dt : float
        Sampling time, in seconds.
    output_names : list of str or None, default=None
        Names of the outputs, if the data had any.
    noise_floor : ndarray of shape (ny,) or None, default=None
        Errors that no model goes below, in the units of the outputs; None if unknown.
    not_fitted : tuple of str, default=()
        Models that were left out, for the last row is at the noise floor.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> ladder = alssnn.model_ladder(*record, nx=4, dt=record.dt, models=["lti"])
    >>> len(ladder), ladder["LTI"].n_params, ladder.y_test.shape[1]
    (1, 24, 1)
    """

    rows: tuple[Rung, ...]
    y_test: np.ndarray = field(repr=False)
    parts: tuple[slice, ...] = field(repr=False)
    dt: float
    output_names: list[str] | None = None
    noise_floor: np.ndarray | None = None
    not_fitted: tuple[str, ...] = ()

    def __repr__(self):
        """Return the table as aligned plain text."""
        cells = [*HEADER, *(_cells(row) for row in self.rows)]
        if self.noise_floor is not None:
            ratios = [f"{self.over_floor(row).max():.3g}" for row in self.rows]
            column = ["test /", "floor", *ratios]
            cells = [(*c[:4], r, *c[4:]) for c, r in zip(cells, column, strict=True)]
        lines = aligned(cells)
        lines.insert(len(HEADER), "-" * max(map(len, lines)))
        return "\n".join([*lines, *self._notes()])

    def over_floor(self, row):
        """Return the test errors of a row over the noise floor.

        Parameters
        ----------
        row : Rung
            Row of this ladder.

        Returns
        -------
        ratio : ndarray of shape (ny,)
            Per output, 1 where nothing is left to learn; nan if no floor is known.
        """
        floor = np.nan if self.noise_floor is None else self.noise_floor
        return row.rmse_test / floor

    def fault(self, row):
        """Say why a model should not be used, if it should not.

        Parameters
        ----------
        row : Rung
            Row of this ladder.

        Returns
        -------
        sentence : str
            That the model follows the test output no better than its mean, or worse
            than the row named LTI does; empty if neither is so, or if no free run can
            tell, as of an unstable plant or with a `drift`.
        """
        return fault(row, next((one for one in self.rows if one.name == "LTI"), None))

    def _notes(self):
        ny = self.y_test.shape[1]
        average = f", mean over the {ny} outputs" if ny > 1 else ""
        notes = [
            f"RMSE in the units of y{average}; fit of the test output; nonlinear rest: "
            "part of the output that is not the response of (A, B, C), once h (if any) "
            "is cancelled, rms(e) / std(y); in the loop: rms(e) / std(y_lin) under "
            "u = v - h, with the recorded input as v."
        ]
        if any(getattr(row.model, "input_map", "") == "monotone" for row in self.rows):
            notes.append(
                "Behind a monotone map, that input is brought to the mean and the size "
                "that v had."
            )
        if any(getattr(row.model, "time", "") == "continuous" for row in self.rows):
            notes.append("Radius of A: that of the sampled A, in continuous time.")
        if any(map(drifts, self.rows)):
            notes.append(
                "These are errors of a free run, which does not know what drifts. "
                "Judge the model by its predictions: `validate` does."
            )
        if self.noise_floor is not None:
            notes.append(
                "test / floor: RMSE of the test over that of the noise, the worst "
                "output; about 1 is the best that a model can do."
            )
        if self.not_fitted:
            notes.append(
                f"Not fitted: {', '.join(self.not_fitted)}. The error of "
                f"{self.rows[-1].name} is nearly that of the noise, and nothing is "
                "left to learn."
            )
        if not all(row.converged for row in self.rows):
            notes.append(f"* stopped before the cost settled: {self._late_falls()}")
        if any(row.is_left_linear for row in self.rows):
            notes.append(
                "= the networks do not simulate hidden samples better than the linear "
                "model, which was taken."
            )
        # indented, for a name at the beginning of a line is a row
        return [
            textwrap.fill(note, TEXT_WIDTH, subsequent_indent="  " if i else "")
            for i, note in enumerate(notes)
        ]

    def _late_falls(self):
        """Say how much the costs still fell in the end, and whether it matters."""
        falls = {
            row.name: late_fall(row.model.history_)
            for row in self.rows
            if not row.converged
        }
        known = {name: fall for name, fall in falls.items() if np.isfinite(fall[0])}
        if len(known) < len(falls):  # too few steps to tell
            return "more iterations may help."
        text = ", ".join(
            f"{name} lowered it by {percent(100 * fall)} in its last {n} steps"
            for name, (fall, n) in known.items()
        )
        if all(fall < SETTLED and n >= ENOUGH_STEPS for fall, n in known.values()):
            return f"{text}. More iterations will hardly change the model."
        return f"{text}. More iterations may help."

    def to_frame(self):
        """Return the table as a pandas DataFrame.

        Returns
        -------
        frame : pandas.DataFrame
            One row per model, indexed by its name. Figures per output have the name
            of the output in brackets when there are several.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        ny, table = self.y_test.shape[1], []
        names = self.output_names or [f"y{i}" for i in range(ny)]
        for row in self.rows:
            figures = {name: getattr(row, name) for name in PER_OUTPUT}
            if self.noise_floor is not None:
                figures["rmse_over_floor"] = self.over_floor(row)
            record: dict[str, float] = {"n_params": row.n_params}
            for figure, values in figures.items():
                for name, value in zip(names, np.broadcast_to(values, ny), strict=True):
                    record[figure if ny == 1 else f"{figure}[{name}]"] = float(value)
            record["spectral_radius"] = row.spectral_radius
            record["seconds"] = row.seconds
            record["converged"] = row.converged
            table.append(record)
        return self.frame(table)

    def explain(self):
        """Say in words what the figures mean for control.

        Returns
        -------
        text : str
            A few sentences, one paragraph each, about the rows named LTI and AL-SSNN;
            empty without an AL-SSNN.
        """
        return explain(self.rows, self.dt)


def _cells(row):
    """Return the row of the table as strings."""
    errors = (row.linearization_error, row.closed_linearization_error)
    return (
        row.name + (" =" if row.is_left_linear else "" if row.converged else " *"),
        str(row.n_params),
        "-" if np.isnan(row.seconds) else f"{row.rmse_train.mean():.3e}",
        f"{row.rmse_test.mean():.3e}",
        f"{row.fit_percent.mean():.2f}",
        *(_rest(100 * float(np.mean(error))) for error in errors),
        f"{row.spectral_radius:.4f}",
        "-" if np.isnan(row.seconds) else f"{row.seconds:.1f}",
    )


def _rest(error):
    """Return a percentage of the table."""
    if np.isnan(error):
        return "-"
    # exactly linear models leave rounding errors
    return "0" if error < 1e-9 else f"{error:.3g}"

"""What is reported on linearity: fields, a table, a data frame."""

import textwrap
from dataclasses import dataclass

import numpy as np

from ..rows import data_frame
from ..shown import percent, short_repr, times

WIDTHS = (38, 16, 16)  # columns of the table: name, open loop, closed loop
OUTSIDE = 0.02  # share of samples of a record outside, from which it is said
OMEGA = (
    "omega: what the linear part lacks of the next state, by g, and by h where it "
    "moves while u is held"
)
LARGE_LAW = 3.0  # std(h) / std(u) above which the law does more than the record
PER_OUTPUT = (
    "linearization_error",
    "closed_linearization_error",
    "closed_output_size",
    "h2_gain",
)
CARRIED = (  # of a loop with a controller; none if it was not asked for
    "carried",
    "carried_low",
    "carried_high",
    "carried_model",
    "carried_missed",
    "carried_noise",
)
SIZES = ("ratio_g", "ratio_h", "closed_linear", "closed_omega", "closed_ratio")
SCALARS = (
    *(f"{size}_{of}" for size in SIZES for of in ("mean", "max")),
    "spectral_radius",
    "peak_gain",
    "outside",
    "closed_outside",
    "law_size",
    "closed_law_size",
)


@dataclass(frozen=True, eq=False)
class Bands:
    """Hold what e and y have in frequency bands (eq. bands).

    Parameters
    ----------
    edges : ndarray of shape (n_bands + 1,)
        Edges of the bands, in Hz, from 0 to the Nyquist frequency: octaves, the lowest
        band reaching down to zero.
    error : ndarray of shape (n_bands, ny)
        Root mean square of e in the band over the standard deviation of all of y. The
        squares of a column add up to the square of `linearization_error`.
    output : ndarray of shape (n_bands, ny)
        Root mean square of the measured y, without its mean, in the band over the
        standard deviation of all of y. The squares of a column add up to one.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> bands = model.linearizability(*record).bands
    >>> round(float(np.sum(bands.output**2)), 6), len(bands.edges) - len(bands.error)
    (1.0, 1)
    """

    __repr__ = short_repr

    edges: np.ndarray
    error: np.ndarray
    output: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Linearizability:
    """Report how much nonlinearity is left when h is cancelled.

    Parameters
    ----------
    linearization_error : ndarray of shape (ny,)
        Ratio rms(e) / std(y) per output (eq. gauge), y the measured output. Does not
        depend on the state basis, nor on the operating point of y.
    ratio_g_mean, ratio_g_max : float
        Mean and maximum over time of ``|g| / |A x + B u|``, in the state basis. Here
        and below, G d of measured disturbances counts with A x + B u, and g is
        omega in continuous time: what h does while u is held counts, too.
    ratio_h_mean, ratio_h_max : float
        Mean and maximum over time of ``|h| / |A x + B u|``, h in the units of u.
    spectral_radius : float
        Largest modulus of the eigenvalues of A, that of the sampled model.
    closed_linearization_error : ndarray of shape (ny,)
        The same error of the closed loop u = v - h, where v is the recorded input:
        rms(e) / std(y_lin), both of the response to v, y_lin that of the linear system
        (A, B, C) from the same initial state. There is no measured output to compare
        with. Does not depend on the state basis.
    closed_linear_mean, closed_linear_max : float
        Mean and maximum over time of ``|A x + B v|`` (eq. loop).
    closed_omega_mean, closed_omega_max : float
        Mean and maximum over time of ``|omega|``, omega = g(x, v - h).
    closed_ratio_mean, closed_ratio_max : float
        Mean and maximum over time of ``|omega| / |A x + B v|``.
    peak_gain : float
        Maximum of ``||A^k||`` over k >= 0 (eq. gains), inf if A is not stable. Depends
        on the state basis: much above one, small ``|g|`` says little.
    h2_gain : ndarray of shape (ny,)
        H2 norm from g to every output (eq. gains), in units of y per unit of the
        states; inf if A is not stable. Depends on the state basis as `peak_gain` does.
    outside : float or None
        Share of samples outside the region of the training data by more than a tenth
        of its width or radius: (x, u) where the networks are extrapolated, or a
        measured y that training never saw; None if it is not known.
    closed_outside : float or None
        The same in the closed loop, with u = v - h.
    bands : Bands
        The linearization error, and the output, in frequency bands.
    e : ndarray of shape (N, ny)
        Output-referred residual of the open loop at the samples of the data, in the
        units of y; inf where it diverges.
    output_names : list of str or None
        Names of the outputs.
    no_law : str, default=""
        Why u = v - h(s) is no law of this model; empty if it is one.
    law_size, closed_law_size : float, default=0.0
        Largest std(h) / std(u) over the inputs, u the recorded input: along the record,
        and in the closed loop.
    closed_output_size : ndarray of shape (ny,) or None, default=None
        Size std(y_lin) / std(y) per output: how much of the recorded output the linear
        response to the recorded input as v covers. Far below one the figures of the
        closed loop are those of small signals.
    carried : ndarray of shape (ny,) or None, default=None
        Expected distance of the plant from its linear design in the loop of a
        controller, rms over std of the designed output (eq. carried): the median over
        the plants that this record does not rule out. Noise of the measurement in that
        loop does not count. nan where the loop leaves the training data, see
        `carried_outside`; None if it was not measured, see `carried_problem`.
    carried_low, carried_high : ndarray of shape (ny,) or None, default=None
        Four of five of these plants lie between them. No confidence interval: the true
        plant is outside more often.
    carried_model : ndarray of shape (ny,) or None, default=None
        The same distance with the model in the place of the plant: g, sampling, the
        observer, limits.
    carried_missed : ndarray of shape (ny,) or None, default=None
        What is added by what the record shows that the model misses.
    carried_noise : ndarray of shape (ny,) or None, default=None
        What is added by what the noise of the record leaves open.
    carried_outside : float or None, default=None
        Share of the samples of that loop outside the region of the training data.
    carried_problem : str, default=""
        Why there is no `carried`.
    has_disturbances : bool, default=False
        Whether there are measured disturbances d.
    is_sampled : bool, default=False
        Whether A is that of a model in continuous time, from sample to sample.
    is_mapped : bool, default=False
        Whether v is a monotone map: in the closed loop the recorded input then has the
        mean and the standard deviation that v had along the record.

    Notes
    -----
    A quantity that a diverging simulation makes meaningless is inf. Without a residual,
    g and its errors are zero, whatever diverges. Where there is no law there is no
    closed loop: its quantities are nan, and `closed_outside` None.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> report = model.linearizability(*record)
    >>> report.linearization_error.shape, report.ratio_g_max
    ((1,), 0.0)
    """

    linearization_error: np.ndarray
    ratio_g_mean: float
    ratio_g_max: float
    ratio_h_mean: float
    ratio_h_max: float
    spectral_radius: float
    closed_linearization_error: np.ndarray
    closed_linear_mean: float
    closed_linear_max: float
    closed_omega_mean: float
    closed_omega_max: float
    closed_ratio_mean: float
    closed_ratio_max: float
    peak_gain: float
    h2_gain: np.ndarray
    outside: float | None
    closed_outside: float | None
    bands: Bands
    e: np.ndarray
    output_names: list[str] | None = None
    no_law: str = ""
    law_size: float = 0.0
    closed_law_size: float = 0.0
    closed_output_size: np.ndarray | None = None
    carried: np.ndarray | None = None
    carried_low: np.ndarray | None = None
    carried_high: np.ndarray | None = None
    carried_model: np.ndarray | None = None
    carried_missed: np.ndarray | None = None
    carried_noise: np.ndarray | None = None
    carried_outside: float | None = None
    carried_problem: str = ""
    has_disturbances: bool = False
    is_sampled: bool = False
    is_mapped: bool = False

    @property
    def words_v(self):
        """Return what v is in the closed loop, in words."""
        brought = ", brought to the mean and the size that v had" * self.is_mapped
        return f"the recorded input{brought}"

    @property
    def words_rest(self):
        """Return what the linear part lacks of the next state, in words."""
        return "omega" if self.is_sampled else "g"

    @property
    def words_linear(self):
        """Return what states and inputs add up to in the linear part, in words."""
        return "|Ax+Bu+Gd|" if self.has_disturbances else "|Ax+Bu|"

    @property
    def words_radius(self):
        """Return what `spectral_radius` is, in words."""
        return f"spectral radius of {'sampled ' * self.is_sampled}A"

    def __repr__(self):
        """Return a table."""
        linear, rest = self.words_linear, self.words_rest
        rows = [
            ("", "open loop", "closed loop"),
            *(
                (f"linearization error{of}", _percent(a), _percent(b))
                for of, a, b in zip(
                    self._suffixes(),
                    self.linearization_error,
                    self.closed_linearization_error,
                    strict=True,
                )
            ),
            *self._size_rows(f"|{rest}| / {linear}", "ratio_g", "closed_ratio"),
            *self._size_rows(f"|h| / {linear}", "ratio_h"),
            *self._size_rows(linear, None, "closed_linear"),
            *self._size_rows(f"|{rest}|", None, "closed_omega"),
            (
                "samples outside the training region",
                _percent(self.outside),
                _percent(self.closed_outside),
            ),
            _pair("std(h) / std(u)", self.law_size, self.closed_law_size),
            *(
                (f"std(y_lin) / std(y){of}", "", _percent(size))
                for of, size in zip(self._suffixes(), self._output_size, strict=True)
            ),
            *self._carried_rows(),
            "",
            (self.words_radius, f"{self.spectral_radius:.6f}"),
            _pair("peak of |A^k|", self.peak_gain),
            *(
                _pair(f"H2 gain from {rest} to y{of}", gain)
                for of, gain in zip(self._suffixes(), self.h2_gain, strict=True)
                if self.ratio_g_max  # else there is none
            ),
        ]
        rows += [*self._band_rows(), "", *self._closed_words()]
        if self.is_sampled:
            rows += textwrap.wrap(OMEGA, sum(WIDTHS))
        if self.outside is not None and self.outside > OUTSIDE:
            rows += [
                "",
                f"{_percent(self.outside)} of the record lies outside the training",
                "region: there the model is a guess, and so are these numbers.",
                "Train on records that go there, or keep the plant inside.",
            ]
        if self.large_law and np.isfinite(self.large_law):  # else it diverges
            rows += ["", *self.large_law_lines()]
        return "\n".join(map(_line, rows))

    def _size_rows(self, name, *sizes):
        """Return the rows of the mean and the maximum of a size."""
        width = len(f"|{self.words_rest}| / {self.words_linear}  ")
        return [
            _pair(
                text.ljust(width) + of,
                *(size and getattr(self, f"{size}_{of}") for size in sizes),
            )
            for text, of in ((name, "mean"), ("", "max"))
        ]

    def _band_rows(self):
        """Return the rows of frequency bands."""
        bands, rows = self.bands, []
        limits = [
            f"{low:g} to {high:g} Hz"
            for low, high in zip(bands.edges[:-1], bands.edges[1:], strict=True)
        ]
        for i, of in enumerate(self._suffixes()):
            rows += ["", (f"frequency band{of}", "rms e / std y", "rms y / std y")]
            rows += [
                (name, _percent(a), _percent(b))
                for name, a, b in zip(
                    limits, bands.error[:, i], bands.output[:, i], strict=True
                )
            ]
        return rows

    @property
    def large_law(self):
        """Return how large the law is over the recorded input if that is too much."""
        size = np.fmax(self.law_size, self.closed_law_size)
        return float(size) if size > LARGE_LAW else 0.0

    def _carried_rows(self):
        """Return the rows of the loop with a controller; none without."""
        if self.carried is None:
            return []
        every = [np.asarray(getattr(self, name)) for name in CARRIED]
        rows = []
        for i, of in enumerate(self._suffixes()):
            rows += ["", (f"plant from its design{of}", "", self.carried_words(i))]
            if np.isnan(self.carried[i]):
                continue
            low, high, model, missed, noise = (_percent(z[i]) for z in every[1:])
            rows += [
                ("  four of five possible plants", f"from {low}", f"to {high}"),
                ("  by the model itself", "", model),
                ("  by what it is seen to miss", "", missed),
                ("  by what noise leaves open", "", noise),
            ]
        return rows

    def carried_words(self, output=0):
        """Return the distance of the plant from its design in words (eq. carried).

        Parameters
        ----------
        output : int, default=0
            Number of the output.

        Returns
        -------
        words : str
            The share in percent, or that the loop leaves the training data.
        """
        if self.carried is None:
            return "unknown"
        if np.isnan(self.carried[output]):
            return f"outside, {_percent(self.carried_outside)}"
        return _percent(self.carried[output])

    @property
    def _output_size(self):
        unknown = np.full(len(self.linearization_error), np.nan)
        return unknown if self.closed_output_size is None else self.closed_output_size

    def large_law_lines(self):
        """Say what a law means that is larger than the recorded input.

        Returns
        -------
        lines : list of str
            Lines of the table.
        """
        words = (
            f"The law is {times(self.large_law)} times the recorded input. Errors of "
            "the model weigh as much more in the loop, see the distance of the plant. "
            "Fit with a larger `gamma_h`."
        )
        return textwrap.wrap(words, sum(WIDTHS))

    def _closed_words(self):
        """Return what the closed loop is, as lines of the table."""
        if self.no_law:
            words = f"There is no closed loop to measure. {self.no_law}"
            return textwrap.wrap(words, sum(WIDTHS))
        words = (
            f"closed loop: u = v - h, where v is {self.words_v}; its linearization "
            "error is relative to the linear response to v;"
        )
        return *textwrap.wrap(words, sum(WIDTHS)), *self._controlled_words()

    def _controlled_words(self):
        """Return what the loop with a controller is, as lines of the table."""
        if self.carried is None:
            problem = self.carried_problem
            return textwrap.wrap(problem, sum(WIDTHS)) if problem else ()
        words = (
            "plant from its design: rms in the loop of a controller, over the designed "
            "output. It is the median over plants that the record does not rule out, "
            "without noise of the measurement."
        )
        if np.isnan(self.carried).any():
            words += (
                f" In {_percent(self.carried_outside)} of its samples the loop leaves "
                "the training data. There no record says what the plant does: take "
                "smaller references, or train on records that go there."
            )
        return textwrap.wrap(words, sum(WIDTHS))

    def to_frame(self):
        """Return all quantities but `e` as a tidy pandas DataFrame.

        Returns
        -------
        frame : pandas.DataFrame
            One row per number, with the columns `quantity` (the name of the field),
            `output` (None if it belongs to no single one), `f_min` and `f_max` (edges
            of the frequency band in Hz, nan without one) and `value`.

        Raises
        ------
        ImportError
            If pandas is not installed.
        """
        names, edges = self._names(), self.bands.edges
        rows = [
            (quantity, name, np.nan, np.nan, value)
            for quantity in (*PER_OUTPUT, *(() if self.carried is None else CARRIED))
            for name, value in zip(names, getattr(self, quantity), strict=True)
        ]
        rows += [
            (quantity, None, np.nan, np.nan, getattr(self, quantity))
            for quantity in SCALARS
        ]
        rows += [
            (f"bands.{kind}", name, edges[k], edges[k + 1], value)
            for kind in ("error", "output")
            for k, values in enumerate(getattr(self.bands, kind))
            for name, value in zip(names, values, strict=True)
        ]
        columns = ["quantity", "output", "f_min", "f_max", "value"]
        frame = data_frame(rows, columns=columns)
        return frame.astype({"f_min": float, "f_max": float, "value": float})

    def _names(self):
        """Return a name of every output."""
        ny = len(self.linearization_error)
        return self.output_names or [f"y{i}" for i in range(ny)]

    def _suffixes(self):
        """Return what tells the outputs apart in the table."""
        names = self._names()
        return [f", {name}" for name in names] if len(names) > 1 else [""]


# -- the table -------------------------------------------------------------------------


def _percent(value):
    return "-" if value is None or np.isnan(value) else percent(100 * value, 3)


def words_left(plant):
    """Return what the output-referred residual e is made of, in words.

    Parameters
    ----------
    plant : Plant
        Plant along which it was simulated.

    Returns
    -------
    words : str
        A title.
    """
    words = "What g leaves at the output"
    if plant.cancels and plant.rates is not None:
        words += ", and h, which moves while u is held"
    return words


def _pair(name, *values):
    """Return a row of plain numbers; None leaves a cell empty, nan is a dash."""
    cells = (None if value is None else f"{value:.3g}" for value in values)
    return (name, *({None: "", "nan": "-"}.get(cell, cell) for cell in cells))


def _line(row):
    """Return one line of the table; a row that is a text is a note."""
    if isinstance(row, str):
        return row
    cells = [
        cell.rjust(width) for cell, width in zip(row[1:], WIDTHS[1:], strict=False)
    ]
    return (row[0].ljust(WIDTHS[0]) + "".join(cells)).rstrip()

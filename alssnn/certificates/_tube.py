"""A tube around the simulation that future records stay in: split conformal prediction.

What the proofs of this package say holds of the model.  How far the plant is from it
only records tell, held out from the fit.  They are cut into n units alike, whole
experiments or blocks with gaps between them.  The score of a unit is its largest error,
relative to a scale that grows with the size of its signals,

    score = max_k |y_k - y_hat_k| / s,   s = a + b |y_hat|_rms + sum_j b_j |u_j|_rms

Let q be the ceil((n + 1) level)-th smallest score.  If a fresh unit is exchangeable
with those n, its score is at most q with a probability of at least `level`:

    |y_k - y_hat_k| <= q s   for all k of the unit                       (eq. tube)

Nothing is assumed of plant, model or noise.  The scale only decides how well widths fit
their units; it is fitted on a part of the units that does not count among the n.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import beta

from ..checks import numbers_of_shape
from ._tube_bound import TubeWithBound, plain
from ._units import (
    check_units,
    conformal_quantile,
    cut,
    fit_scale,
    least_units,
    lengths,
    measure,
    no_quantile,
    rank,
    scale,
    scores_of,
    simulated_runs,
    units_in_words,
    units_of,
)


class Band(NamedTuple):
    """Hold what the model says of a record, and the tube around it.

    Parameters
    ----------
    y : ndarray of shape (N,) or (N, ny)
        Simulated or predicted outputs, in the user's units.
    lower, upper : ndarray of the same shape
        Tube around them; infinite if nothing is certified.
    """

    y: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Tube:
    """Hold a statistical tube of the error of a model (eq. tube).

    Parameters
    ----------
    level : float
        Share of future units that stay in the tube: of all outputs together if
        `joint`, else of each by itself.
    quantile : ndarray of shape (ny,)
        Half width of the tube per unit of the scale; inf if there are too few units.
    coefficients : ndarray of shape (ny, nu + 2)
        Of the scale: a, b of the root mean square of the simulated output, b_j of
        that of every input, all deviations from the operating point.
    n_blocks : ndarray of shape (ny,) of int
        Units that the level was calibrated on; those that fitted the scale do not
        count.
    scores : ndarray of shape (n, ny)
        Their scores; nan where an output was never measured in a unit.
    joint : bool
        Whether the level is that of all outputs together.
    horizon : int or None
        Samples that are predicted ahead; None is the free run.
    block : int or None
        Samples of a unit; None means that the units are whole experiments.
    gap : int
        Samples left out between two units of one experiment.
    typical : ndarray of shape (ny,)
        Half width at the median scale of the units, in the units of y.
    reason : str
        Why the tube is infinite; empty otherwise.
    model : estimator
        The model.

    Examples
    --------
    >>> from alssnn.datasets import make_wiener_hammerstein
    >>> train, test = make_wiener_hammerstein(4000, random_state=0).split(0.25)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=train.dt).fit(*train)
    >>> tube = model.tube(*test, level=0.8)
    >>> bool(tube.finite), tube.around(test.u).upper.shape
    (True, (3000, 1))
    """

    level: float
    quantile: np.ndarray
    coefficients: np.ndarray
    n_blocks: np.ndarray
    scores: np.ndarray
    joint: bool
    horizon: int | None
    block: int | None
    gap: int
    typical: np.ndarray
    reason: str
    model: Any

    @property
    def finite(self):
        """Return whether the units were enough for a tube of every output."""
        return bool(np.isfinite(self.quantile).all())

    @property
    def assumption(self):
        """Return what the level rests on, in words."""
        if self.block is None:
            return (
                "the experiments of the calibration and the future one are "
                "exchangeable: the same plant, kind and size of input, length, noise, "
                "share of samples that are measured, and way to make them"
            )
        return (
            f"blocks of {self.block} samples with gaps of {self.gap}, those of the "
            "calibration and the future one, are exchangeable: the same plant, kind "
            "and size of input, noise and share of samples that are measured, and "
            "nearly independent. The level is that of one block, not of a whole record"
        )

    @property
    def coverage_range(self):
        """Return the 5 % and 95 % points of what one calibration keeps, (ny, 2)."""
        # kept on average over calibrations; that of one has a beta distribution
        n = self.n_blocks
        k = np.array([rank(i, self.level) for i in n])
        known = np.where(k <= n, k, 1)
        ends = [
            beta.ppf(p, known, np.maximum(n, known) + 1 - known) for p in (0.05, 0.95)
        ]
        return np.where((k <= n)[:, None], np.stack(ends, axis=-1), 1.0)

    def half_width(self, u, y=None, experiment=None, *, x0=None):
        """Return the half width of the tube at every sample.

        Parameters
        ----------
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or None, default=None
            Measured outputs, see `around`.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        x0 : array_like of shape (nx,) or (n_experiments, nx), or None, default=None
            Initial states, see `around`.

        Returns
        -------
        half_width : ndarray of shape (N,) or (N, ny)
            In the units of y, the same at all samples of a unit.

        Raises
        ------
        ValueError
            As `around`.
        """
        return self._simulated(u, y, experiment, x0)[1]

    def around(self, u, y=None, experiment=None, *, x0=None):
        """Return what the model says of inputs, and the tube around it.

        Parameters
        ----------
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or None, default=None
            Measured outputs; a free run takes its initial state from them, and
            predictions some samples ahead need them.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        x0 : array_like of shape (nx,) or (n_experiments, nx), or None, default=None
            Initial states; None estimates them from the first `n_init_samples`
            samples of `y`, as the calibration did, and without `y` begins at rest.

        Returns
        -------
        band : Band
            Outputs `y` of the model, `lower` and `upper`, with as many dimensions as
            the `y` of `fit`. The samples that estimate the initial state do not count
            in the calibration: the level does not speak of them.

        Raises
        ------
        ValueError
            If the data do not fit the model, or `y` is missing for a horizon.
        """
        y_hat, width = self._simulated(u, y, experiment, x0)
        with np.errstate(invalid="ignore"):
            return Band(y_hat, y_hat - width, y_hat + width)

    def contains(self, u, y, experiment=None):
        """Tell which units of a record stay in the tube.

        Parameters
        ----------
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or list of them
            Measured outputs; what is missing (nan) does not count.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.

        Returns
        -------
        inside : ndarray of bool of shape (n_units,) or (n_units, ny)
            One entry per experiment or block, cut as in the calibration; one column
            per output unless there is one, or they are judged together (`joint`).

        Raises
        ------
        ValueError
            If the data do not fit the model.
        """
        runs = simulated_runs(self.model, u, y, experiment, self.horizon)
        units = units_of(runs, self.block, self.gap)
        errors, sizes = measure(units, *_centers(self.model))
        scores = scores_of(errors, sizes, self.coefficients)
        inside = ~(scores > self.quantile)  # nan: nothing was measured
        if self.joint or inside.shape[1] == 1:
            return inside.all(axis=1)
        return inside

    def with_bound(self, bound):
        """Add a bound between the model and its linear design.

        Parameters
        ----------
        bound : float, array_like of shape (ny,), or IssCertificate
            Bound on ``|y_model - y_lin|`` per output, in the units of y; a certificate
            gives its `output_bounds`.

        Returns
        -------
        combined : TubeWithBound
            What both together say of the plant.

        Raises
        ------
        ValueError
            If the bound is no nonnegative number per output.
        """
        value = getattr(bound, "output_bounds", bound)
        value = numbers_of_shape(value, self.quantile.shape)
        if not np.all(value >= 0):
            raise ValueError(
                "`bound` must be at least 0, one number or one per output "
                f"({len(self.quantile)}), got {bound!r}. Pass a certificate."
            )
        kind = getattr(bound, "verdict", "")
        return TubeWithBound(self, value, getattr(bound, "source", kind))

    def _simulated(self, u, y, experiment, x0):
        """Return the outputs of the model and half widths, as columns if `fit` had."""
        if y is None and self.horizon is not None:
            raise ValueError(
                f"`y` must be given for a tube {self.horizon} samples ahead, got None. "
                "Predictions start from what was measured."
            )
        runs = simulated_runs(self.model, u, y, experiment, self.horizon, x0)
        pair = [run.y_hat for run in runs], [self._widths(run) for run in runs]
        flat = self.model.fitted_.y_ndim == 1
        return tuple(np.vstack(z)[:, 0] if flat else np.vstack(z) for z in pair)

    def _widths(self, run):
        """Return half widths at all samples of an experiment."""
        center, n = _centers(self.model), len(run.u)
        length = n if self.block is None else min(self.block, n)
        widths = np.empty(run.y_hat.shape)
        for begin in range(0, n, max(length, 1)):
            begin = min(begin, n - length)  # the last one reaches back
            part = slice(begin, begin + length)
            # of a whole experiment the calibration sees what it counts
            seen = slice(run.start if self.block is None else begin, part.stop)
            _, sizes = measure([cut(run, seen)], *center)
            with np.errstate(invalid="ignore", over="ignore"):
                width = self.quantile * scale(sizes, self.coefficients)[0]
            widths[part] = np.where(np.isnan(width), np.inf, width)
        return widths

    def __repr__(self):
        """Return level, widths, assumption and number of units in a few lines."""
        unit = units_in_words(self.block)
        run = "free run" if self.horizon is None else f"{self.horizon} samples ahead"
        together = " of all outputs together" if self.joint else ", each output alone"
        of = together if len(self.quantile) > 1 else ""
        count = plain(self.n_blocks)
        if not self.finite:
            return f"Tube: infinite, {run}. {self.reason}"
        low, high = self.coverage_range.T
        return "\n".join(
            [
                f"Tube: {self.level:.4g} of future {unit} stay within{of}, {run}",
                f"  half width {plain(self.typical)} at the median of the scale",
                f"  calibrated on {count} {unit}: on average the level is kept, "
                f"by one calibration {low.min():.2f} to {high.max():.2f}",
                f"  if {self.assumption}{self._few()}",
            ]
        )

    def _few(self):
        """Return the doubt about blocks that are hardly enough, or nothing."""
        if self.block is None or np.min(self.n_blocks) >= 2 * least_units(self.level):
            return ""
        return (
            "; the blocks are few, and if they are too short, less is kept: calibrate "
            "on a longer record"
        )


def tube(
    model,
    u,
    y,
    experiment=None,
    *,
    level=0.9,
    horizon=None,
    joint=False,
    block="auto",
    gap=None,
):
    """Calibrate a tube of the error of a model on held-out records (eq. tube).

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs of records that the fit has not seen.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; what was not measured (nan) does not count. A unit with gaps shows less
        of its largest error: the level is that of units with as many of them.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    level : float, default=0.9
        Share of future units that shall stay in the tube, between 0 and 1.
    horizon : int or None, default=None
        Samples between the last output that is used and the one that is predicted, see
        `predict_ahead`; None is the free run.
    joint : bool, default=False
        Whether the level is that of all outputs together; else of each by itself.
    block : {"auto", "experiment"} or int, default="auto"
        What a unit is: a whole experiment, or a block of so many samples. "auto" takes
        experiments if they are enough for the level, else blocks of four times the
        samples that are as good as one independent sample, as the autocorrelation of
        the errors and of their moduli tells.
    gap : int or None, default=None
        Samples left out between two blocks; None means twice what is as good as one
        independent sample.

    Returns
    -------
    tube : Tube
        The tube; one that is infinite says why.

    Raises
    ------
    ValueError
        If an argument is out of range, or the data do not fit the model.

    Notes
    -----
    The level holds on average over calibrations: that of a single one is beta
    distributed, see `Tube.coverage_range`. Every fourth unit fits the scale if the rest
    is enough for the level; otherwise the width is the same for all units.

    The length of blocks is told by the same errors. On a record that is hardly long
    enough, a tube is finite where their correlation seems shorter than it is, and then
    keeps less.

    Costs one simulation of the records.

    References
    ----------
    .. [1] V. Vovk, A. Gammerman, G. Shafer, "Algorithmic Learning in a Random World",
       Springer, 2005.
    .. [2] J. Lei et al., "Distribution-free predictive inference for regression",
       Journal of the American Statistical Association 113, 2018.

    Examples
    --------
    >>> from alssnn.datasets import make_wiener_hammerstein
    >>> train, test = make_wiener_hammerstein(4000, random_state=0).split(0.25)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=train.dt).fit(*train)
    >>> model.tube(*test, block=300).reason
    '8 blocks of 300 samples are too few for the level 0.9, which takes 9. Lower ...'
    """
    check_units(level, horizon, block, gap)
    runs = simulated_runs(model, u, y, experiment, horizon)
    length, gap = lengths(runs, level, block, gap)
    units = units_of(runs, length, gap)
    errors, sizes = measure(units, *_centers(model))
    fits, coefficients = fit_scale(errors, sizes, level)
    scores = scores_of(errors[~fits], sizes[~fits], coefficients)
    judged = scores.max(axis=1, keepdims=True) if joint else scores
    quantile = np.array([conformal_quantile(column, level) for column in judged.T])
    n = np.broadcast_to((~np.isnan(judged)).sum(axis=0), scores.shape[1])
    quantile = np.broadcast_to(quantile, scores.shape[1]).copy()
    typical = np.full(scores.shape[1], np.inf)
    if len(scores):
        with np.errstate(invalid="ignore"):
            scales = scale(sizes[~fits], coefficients)
        typical = quantile * np.median(scales, axis=0)
    return Tube(
        level=float(level),
        quantile=quantile,
        coefficients=coefficients,
        n_blocks=n.copy(),
        scores=scores,
        joint=bool(joint),
        horizon=None if horizon is None else int(horizon),
        block=length,
        gap=gap,
        typical=typical,
        reason=no_quantile(quantile, n, level, length),
        model=model,
    )


def _centers(model):
    return np.asarray(model.u_offset_), np.asarray(model.y_offset_)

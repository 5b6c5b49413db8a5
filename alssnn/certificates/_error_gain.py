"""The gain of the error of a model, by held-out records (eq. errorgain).

What the plant adds to the output of the model is taken as a system driven by u.  Over
every unit of the records its size over that of u is one number; the quantile of these
that a fresh unit keeps is conformal, as the width of a tube is (`_tube`).
"""

from dataclasses import dataclass

import numpy as np

from ._tube_bound import in_words
from ._units import (
    check_units,
    conformal_quantile,
    lengths,
    no_quantile,
    simulated_runs,
    units_in_words,
    units_of,
)


@dataclass(frozen=True, eq=False, repr=False)
class ErrorGain:
    """Hold the gain from u to what a plant adds to the output of its model.

    Parameters
    ----------
    gain : ndarray of shape (ny, nv)
        Largest l2 gain of every part of the error, units of y per unit of u; inf if
        the units are too few.
    level : float
        Share of units like these that keep it, for each output by itself.
    n_blocks : int
        Units of the calibration, those in which an input moves.
    block : int or None
        Samples of a unit; None means whole experiments.
    reason : str
        Why it is infinite; empty otherwise.

    Examples
    --------
    >>> from alssnn.datasets import make_wiener_hammerstein
    >>> train, test = make_wiener_hammerstein(4000, random_state=0).split(0.25)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=train.dt).fit(*train)
    >>> error = alssnn.certificates.error_gain(model, *test, block=150)
    >>> error.gain.shape, bool(0 < error.gain < 1)
    ((1, 1), True)
    """

    gain: np.ndarray
    level: float
    n_blocks: int
    block: int | None
    reason: str

    def __repr__(self):
        """Return the gain, and what it rests on."""
        if self.reason:
            return f"ErrorGain: infinite. {self.reason}"
        alone = ", of each output alone" if len(self.gain) > 1 else ""
        return (
            f"ErrorGain: |y_plant - y_model| <= {in_words(self.gain)} |u| in l2 in "
            f"{self.level:.4g} of future {units_in_words(self.block)} like the "
            f"{self.n_blocks} that were used{alone}"
        )


def error_gain(model, u, y, experiment=None, *, level=0.9, block="auto", gap=None):
    """Measure the gain of the error of a model on held-out records (eq. errorgain).

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs of records that the fit has not seen.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; what was not measured (nan) does not count.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    level : float, default=0.9
        Share of future units that shall keep the gain of an output, between 0 and 1.
        Where the gains of several outputs count together, less is kept.
    block : {"auto", "experiment"} or int, default="auto"
        What a unit is, see `tube`.
    gap : int or None, default=None
        Samples left out between two blocks, see `tube`.

    Returns
    -------
    error : ErrorGain
        The gain, for ``controller.certificate(error=...)``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the data do not fit the model.

    Notes
    -----
    The error is driven by what u adds to the operating point; a loop that rests at
    another u counts from there. Noise of the record counts as an error. Inputs that a
    controller makes may be others than those of the records: of them a measured gain is
    no proof.

    Costs one simulation of the records.
    """
    check_units(level, None, block, gap)
    plant = model.plant_
    runs = simulated_runs(model, u, y, experiment, None)
    length, gap = lengths(runs, level, block, gap)
    ratios = [_ratio(unit, plant) for unit in units_of(runs, length, gap)]
    scores = np.array(ratios).reshape(-1, plant.ny)
    quantile = np.array([conformal_quantile(column, level) for column in scores.T])
    n = (~np.isnan(scores)).sum(axis=0)
    return ErrorGain(
        gain=quantile[:, None] / plant.v_scale,
        level=float(level),
        n_blocks=int(n.min(initial=len(scores))),
        block=length,
        reason=_still(runs, plant) or no_quantile(quantile, n, level, length),
    )


def _ratio(unit, plant):
    """Return the size of the error of every output over that of all inputs, scaled."""
    missing = np.isnan(unit.y)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        e = np.where(missing, 0.0, unit.y - unit.y_hat)
        e = np.sqrt(np.sum(e**2, axis=0) / np.maximum((~missing).sum(axis=0), 1))
        u = (unit.u - plant.u_offset)[:, plant.moved] / plant.v_scale
        ratio = e / np.sqrt(np.mean(np.sum(u**2, axis=1)))
    ratio[~np.isfinite(ratio)] = np.inf  # a simulation that diverges
    return np.where(missing.all(axis=0) | ~np.any(u), np.nan, ratio)


def _still(runs, plant):
    """Return that no input moves, if so: units without a motion tell nothing."""
    moved = (np.any((run.u != plant.u_offset)[:, plant.moved]) for run in runs)
    return "" if any(moved) else "No input leaves the operating point. Move the plant."

"""Fitted models side by side, on one record: a table and a figure."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .metrics import free_run_errors
from .rows import Rows, aligned
from .validation import column_names, scored_experiments


@dataclass(frozen=True, eq=False)
class ComparedModel:
    """Hold how one model follows a record.

    Parameters
    ----------
    name : str
        Name of the model.
    model : estimator
        The model.
    nx : int
        Number of states.
    n_params : int
        Trained parameters, without initial states.
    rmse : ndarray of shape (ny,)
        Root mean square error of the free run, in the units of y; inf if it diverges.
    fit_percent : ndarray of shape (ny,)
        Fit, in percent: 100 is exact, 0 no better than the mean; -inf if it diverges.
    y_hat : list of ndarray of shape (n_scored, ny)
        Simulated outputs of every experiment.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> alssnn.compare([model], *record)["LinearStateSpace"].nx
    4
    """

    name: str
    model: Any = field(repr=False)
    nx: int
    n_params: int
    rmse: np.ndarray
    fit_percent: np.ndarray
    y_hat: list = field(repr=False)


@dataclass(frozen=True, eq=False)
class Comparison(Rows):
    """Hold models side by side; ``str`` is the table, ``plot`` draws the figure.

    Parameters
    ----------
    rows : tuple of ComparedModel
        One row per model; ``comparison["name"]`` is one of them.
    y_true : list of ndarray of shape (n_scored, ny)
        Measured outputs of every experiment at the samples that count for all models.
    starts : list of int
        Number of samples before the first of them, per experiment.
    dt : float
        Sampling time, in seconds.
    output_names : list of str
        Names of the outputs.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> models = {f"nx={n}": alssnn.LinearStateSpace(nx=n) for n in (2, 4)}
    >>> for model in models.values():
    ...     model = model.fit(*record)
    >>> comparison = alssnn.compare(models, *record)
    >>> [row.name for row in comparison], len(comparison.to_frame())
    (['nx=2', 'nx=4'], 2)
    """

    rows: tuple[ComparedModel, ...]
    y_true: list = field(repr=False)
    starts: list = field(repr=False)
    dt: float
    output_names: list

    def __repr__(self):
        """Return the table as aligned plain text."""
        cells = [["model", "states", "parameters"]]
        for name in self.output_names:
            cells[0] += [f"RMSE of {name}", "fit, %"]
        for row in self.rows:
            cells.append([row.name, str(row.nx), str(row.n_params)])
            for error, fit in zip(row.rmse, row.fit_percent, strict=True):
                cells[-1] += [f"{error:.4g}", f"{fit:.2f}"]
        return "\n".join(aligned(cells))

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
        several = len(self.output_names) > 1
        table = []
        for row in self.rows:
            record: dict[str, float] = {"nx": row.nx, "n_params": row.n_params}
            for i, name in enumerate(self.output_names):
                where = f"[{name}]" if several else ""
                record[f"rmse{where}"] = row.rmse[i]
                record[f"fit_percent{where}"] = row.fit_percent[i]
            table.append(record)
        return self.frame(table)

    def plot(self, *, which=0, ax=None, **kwargs):
        """Draw outputs and residuals of all models on shared axes.

        Parameters
        ----------
        which : int, default=0
            Number of the experiment to draw.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output, rows first; None makes a figure.
        **kwargs : dict
            Options of all simulated curves.

        Returns
        -------
        display : ComparisonDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If there is no such experiment or the number of axes is wrong.
        """
        from .plotting import ComparisonDisplay

        return ComparisonDisplay(self, which).plot(ax, **kwargs)

    def plot_bode(self, *, bands=None, decibel=False, ax=None, **kwargs):
        """Draw the frequency responses of the linear parts of all models.

        Parameters
        ----------
        bands : dict of str to FrequencyBand or None, default=None
            Confidence in the response of a model, by its name: what
            ``model.parameter_covariance(u, y).frequency_response()`` returns.
        decibel : bool, default=False
            Whether magnitudes are in dB.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output and input, rows first; None makes a figure.
        **kwargs : dict
            Options of all responses.

        Returns
        -------
        display : BodeComparisonDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If a band belongs to no model, sizes differ or the number of axes is wrong.
        """
        from .plotting import BodeComparisonDisplay

        models = {row.name: row.model for row in self.rows}
        return BodeComparisonDisplay(models, bands, decibel).plot(ax, **kwargs)


def compare(models, u, y, experiment=None):
    """Compare fitted models on one record.

    All of them are scored on the same samples: those that no model needs to estimate
    its initial state.

    Parameters
    ----------
    models : dict of str to estimator, or sequence of them
        Fitted models of the same signals and sampling time; without names they are
        called by their class.
    u : array_like of shape (N, nu), or list of them
        Inputs, better of a record that did not train the models.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    comparison : Comparison
        Table and figure.

    Raises
    ------
    NotFittedError
        If a model is not fitted.
    ValueError
        If there is no model, sampling times differ, or the data do not fit a model.

    See Also
    --------
    model_ladder : Fits models of rising freedom, and compares them.

    Notes
    -----
    Costs one simulation per model.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> train, test = record.split(0.5)
    >>> small, large = (alssnn.LinearStateSpace(nx=n).fit(*train) for n in (1, 4))
    >>> comparison = alssnn.compare({"one": small, "four": large}, *test)
    >>> bool(comparison["four"].rmse < comparison["one"].rmse)
    True
    """
    models = _named(models)
    steps = {name: model.dt for name, model in models.items()}
    if len(set(steps.values())) > 1:
        listed = ", ".join(f"{name}: {dt:g} s" for name, dt in steps.items())
        raise ValueError(
            f"`models` must have the same sampling time, got {listed}. A record is "
            "sampled at one rate."
        )
    found = {
        name: scored_experiments(model, u, y, experiment)
        for name, model in models.items()
    }
    every = [starts for _, starts in found.values()]
    starts = [max(ones) for ones in zip(*every, strict=True)]
    rows, y_true = [], []
    for name, (experiments, own) in found.items():
        behind = [start - s for start, s in zip(starts, own, strict=True)]
        y_true = [z[1][n:] for z, n in zip(experiments, behind, strict=True)]
        y_hat = [z[2][n:] for z, n in zip(experiments, behind, strict=True)]
        rows.append(_row(name, models[name], y_true, y_hat))
    first = next(iter(models.values()))
    names = column_names(first)[1]
    return Comparison(tuple(rows), y_true, starts, first.dt, names)


def _named(models):
    """Return models by name."""
    if hasattr(models, "predict"):
        models = [models]
    held = models.values() if isinstance(models, dict) else models
    held = list(held) if isinstance(held, Iterable) else [held]
    strange = [type(z).__name__ for z in held if not hasattr(z, "predict")]
    if strange:
        raise TypeError(
            f"`models` must be fitted models, or a dict of them, got {strange[0]}. "
            "Give what `fit` returns."
        )
    if not isinstance(models, dict):
        named: dict[str, Any] = {}
        for model in models:
            name, n = type(model).__name__, 2
            while name in named:
                name, n = f"{type(model).__name__} {n}", n + 1
            named[name] = model
        models = named
    if not models:
        raise ValueError("`models` must hold at least one fitted model, got none.")
    return models


def _row(name, model, y_true, y_hat):
    """Return the figures of one model."""
    error, fit = free_run_errors(np.concatenate(y_true), np.concatenate(y_hat))
    n_params = int(model.fitted_.free.sum())
    return ComparedModel(name, model, model.nx_, n_params, error, fit, y_hat)

"""Measured and simulated outputs, with what lies between them."""

import numpy as np

from ..metrics import free_run_errors
from ..shown import percent
from ..validation import check_names, column_names, scored_experiments
from ._axes import (
    MEASURED,
    Display,
    check_which,
    color,
    columns,
    dots,
    finish,
    grid_of_axes,
    spelled,
    time_axis,
)
from ._ladder import limits_of, out_of_view

FAR = 10.0  # ranges of an output, from which a simulation would hide it


class SimulationDisplay(Display):
    """Show a free-run simulation against the measured output.

    Use `from_estimator` or `from_predictions` to make one.

    Parameters
    ----------
    y_true : ndarray of shape (N, ny)
        Measured outputs; nan where not measured.
    y_pred : ndarray of shape (N, ny)
        Simulated outputs.
    t : ndarray of shape (N,)
        Time of the samples, in seconds.
    output_names : list of str
        Names of the outputs, for the axes.
    name : str, default="simulated"
        Name of the model, for the legend.

    Attributes
    ----------
    axes_ : ndarray of shape (2, ny)
        Axes: outputs above their residuals, one column per output.
    figure_ : matplotlib.figure.Figure
        The figure.
    fit_percent_ : ndarray of shape (ny,)
        Fit of every output, in percent, which the legend shows; nan where this
        experiment has no measured sample of it.

    Examples
    --------
    >>> from alssnn.plotting import SimulationDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=6, dt=record.dt).fit(*record)
    >>> display = SimulationDisplay.from_estimator(model, *record)
    >>> display.figure_.savefig("simulation.png")  # doctest: +SKIP
    """

    def __init__(self, y_true, y_pred, t, output_names, name="simulated"):
        self.y_true, self.y_pred, self.t = y_true, y_pred, t
        self.output_names, self.name = output_names, name

    @classmethod
    def from_estimator(
        cls, model, u, y, experiment=None, *, which=0, name=None, ax=None, **kwargs
    ):
        """Simulate a fitted model and draw one experiment.

        Parameters
        ----------
        model : estimator
            Fitted model.
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; their first samples set the initial state and are left out.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        which : int, default=0
            Number of the experiment to draw, in order of appearance.
        name : str or None, default=None
            Name of the model; None means its class.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output; None makes a figure.
        **kwargs : dict
            Options of the simulated curves.

        Returns
        -------
        display : SimulationDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If there is no such experiment or the number of axes is wrong.
        """
        experiments, starts = scored_experiments(model, u, y, experiment)
        check_which(which, len(experiments))
        _, y_true, y_pred = experiments[which]
        return cls.from_predictions(
            y_true,
            y_pred,
            dt=model.dt,
            t0=starts[which] * model.dt,
            output_names=column_names(model)[1],
            name=type(model).__name__ if name is None else name,
            ax=ax,
            **kwargs,
        )

    @classmethod
    def from_predictions(
        cls,
        y_true,
        y_pred,
        *,
        dt=1.0,
        t0=0.0,
        output_names=None,
        name="simulated",
        ax=None,
        **kwargs,
    ):
        """Draw given outputs.

        Parameters
        ----------
        y_true : array_like of shape (N,) or (N, ny)
            Measured outputs; nan where not measured.
        y_pred : array_like of shape (N,) or (N, ny)
            Simulated outputs.
        dt : float, default=1.0
            Sampling time, in seconds.
        t0 : float, default=0.0
            Time of the first sample, in seconds.
        output_names : sequence of str or None, default=None
            Names of the outputs, with units if you like; None means y0, y1, ...
        name : str, default="simulated"
            Name of the model, for the legend.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output; None makes a figure.
        **kwargs : dict
            Options of the simulated curves.

        Returns
        -------
        display : SimulationDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If shapes differ or the number of axes or names is wrong.
        """
        y_true, y_pred = columns("y_true", y_true), columns("y_pred", y_pred)
        if y_true.shape != y_pred.shape:
            raise ValueError(
                "`y_true` and `y_pred` must have the same shape, got "
                f"{y_true.shape} and {y_pred.shape}. Compare the same samples."
            )
        names = check_names("output_names", output_names, "y", y_true.shape[1])
        t = t0 + dt * np.arange(len(y_true))
        return cls(y_true, y_pred, t, names, name).plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw outputs above residuals.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output, rows first; None makes a figure.
        **kwargs : dict
            Options of the simulated curves, such as ``color``.

        Returns
        -------
        display : SimulationDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        ny = self.y_true.shape[1]
        options = {"sharex": "col", "height_ratios": (2, 1)}
        size = (6.0 if ny == 1 else 4.5, 2.2)
        axes = grid_of_axes(ax, (2, ny), size=size, **options)
        self.fit_percent_ = fit = self._fits()
        style = {"color": color(0), "linewidth": 1.2, **spelled(kwargs)}
        for i, (top, bottom) in enumerate(axes.T):
            y, y_hat = self.y_true[:, i], self.y_pred[:, i]
            limits = limits_of(y, [y_hat]) if _is_far(y_hat, y) else ()
            note = out_of_view(y_hat, *limits) if limits else ""
            said = "not measured" if np.isnan(fit[i]) else f"fit {percent(fit[i], 3)}"
            label = f"{self.name}, {said}{note}"
            top.plot(self.t, y, label="measured", **MEASURED, **dots(y))
            top.plot(self.t, y_hat, **{"label": label, **style})
            bottom.plot(self.t, y - y_hat, **{**dots(y), **style})
            if limits:
                top.set_ylim(*limits)
                bottom.set_ylim(*(np.ptp(limits) * np.array([-0.5, 0.5])))
            top.set_ylabel(self.output_names[i])
            bottom.set_ylabel(f"residual of\n{self.output_names[i]}")
            time_axis(bottom)
            finish(top, legend="above")
            finish(bottom, legend=False)
        return self._drawn(axes)

    def _fits(self):
        """Return the fits of the outputs that were measured, nan of the others."""
        fit, known = np.full(self.y_true.shape[1], np.nan), ~np.isnan(self.y_true)
        known = known.any(axis=0)
        if known.any():
            pair = self.y_true[:, known], self.y_pred[:, known]
            fit[known] = free_run_errors(*pair)[1]
        return fit


def _is_far(y_hat, y):
    """Return whether a simulation goes so far that the output would be a line."""
    y = y[np.isfinite(y)]
    size = np.ptp(y) if len(y) else 0.0
    return size > 0 and not np.all(np.abs(y_hat - y.mean()) < FAR * size)

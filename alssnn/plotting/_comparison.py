"""Several models on one record: each its color, the measurement once."""

import numpy as np

from ..shown import percent
from ..validation import column_names, moved_names
from ._axes import (
    MEASURED,
    Display,
    check_which,
    color,
    dots,
    finish,
    grid_of_axes,
    model_style,
    spelled,
    time_axis,
)
from ._bode import (
    draw_band,
    draw_response,
    finish_responses,
    linear_response,
    not_sampled,
)
from ._ladder import limits_of, out_of_view

SLOWEST = 1024  # samples of the slowest sine of a frequency response


class ComparisonDisplay(Display):
    """Show simulations of several models against the measured output.

    Parameters
    ----------
    comparison : Comparison
        What `alssnn.compare` returned.
    which : int, default=0
        Number of the experiment to draw.

    Attributes
    ----------
    axes_ : ndarray of shape (2, ny)
        Axes: outputs above their residuals, one column per output.
    figure_ : matplotlib.figure.Figure
        The figure.

    Raises
    ------
    ValueError
        If there is no such experiment.

    Examples
    --------
    >>> from alssnn.plotting import ComparisonDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> ComparisonDisplay(alssnn.compare([model], *record)).plot().axes_.shape
    (2, 1)
    """

    def __init__(self, comparison, which=0):
        check_which(which, len(comparison.y_true))
        self.comparison, self.which = comparison, which

    def plot(self, ax=None, **kwargs):
        """Draw outputs above residuals.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output, rows first; None makes a figure.
        **kwargs : dict
            Options of all simulated curves, such as ``linewidth``.

        Returns
        -------
        display : ComparisonDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        found, which = self.comparison, self.which
        y_true = found.y_true[which]
        N, ny = y_true.shape
        t = found.dt * (found.starts[which] + np.arange(N))
        options = {"sharex": "col", "height_ratios": (2, 1)}
        axes = grid_of_axes(ax, (2, ny), size=(7.0 if ny == 1 else 5.0, 2.4), **options)
        for i, (top, bottom) in enumerate(axes.T):
            y, simulated = y_true[:, i], [row.y_hat[which][:, i] for row in found]
            low, high = limits_of(y, simulated)
            top.plot(t, y, label="measured", **MEASURED, **dots(y))
            for j, (row, y_hat) in enumerate(zip(found, simulated, strict=True)):
                note = out_of_view(y_hat, low, high)
                label = f"{row.name}, fit {percent(row.fit_percent[i], 3)}{note}"
                style = model_style(j, 1.2) | spelled(kwargs)
                top.plot(t, y_hat, **{"label": label, **style})
                bottom.plot(t, y - y_hat, **{**dots(y), **style})
            top.set_ylim(low, high)
            half = (high - low) / 2  # as the outputs: what is beyond them is far off
            bound = np.nanmax(np.abs(bottom.dataLim.intervaly), initial=0.0)
            bottom.set_ylim(*np.array([-1.05, 1.05]) * min(bound or 1.0, half))
            top.set_ylabel(found.output_names[i])
            bottom.set_ylabel(f"measured - simulated,\n{found.output_names[i]}")
            time_axis(bottom)
            finish(top, legend="above")
            finish(bottom, legend=False)
        return self._drawn(axes)


class BodeComparisonDisplay(Display):
    """Show the frequency responses of the linear parts of several models.

    Parameters
    ----------
    models : dict of str to estimator
        Fitted models by name, of the same numbers of inputs and outputs.
    bands : dict of str to FrequencyBand or None, default=None
        Confidence in the response of a model, by its name: what ``frequency_response``
        of a covariance returns.
    decibel : bool, default=False
        Whether magnitudes are in dB.

    Attributes
    ----------
    axes_ : ndarray of shape (2 * ny, nu)
        Axes: for every output magnitude above phase, one column per input.
    figure_ : matplotlib.figure.Figure
        The figure.

    Raises
    ------
    ValueError
        If a band belongs to no model, or the models differ in size.

    Examples
    --------
    >>> from alssnn.plotting import BodeComparisonDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> BodeComparisonDisplay({"LTI": model}, decibel=True).plot().axes_.shape
    (2, 1)
    """

    def __init__(self, models, bands=None, decibel=False):
        bands = bands or {}
        unknown = sorted(set(bands) - set(models))
        if unknown:
            raise ValueError(
                f"`bands` must belong to models among {', '.join(models)}, got "
                f"{unknown[0]!r}."
            )
        sizes = {(m.plant_.nv, m.plant_.ny) for m in models.values()}
        if len(sizes) != 1:
            raise ValueError(
                "`models` must have the same numbers of inputs and outputs, got "
                f"{sorted(sizes)}."
            )
        self.models, self.bands, self.decibel = models, bands, decibel

    def plot(self, ax=None, **kwargs):
        """Draw magnitudes above phases.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output and input, rows first; None makes a figure.
        **kwargs : dict
            Options of all responses, such as ``linewidth``.

        Returns
        -------
        display : BodeComparisonDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        first = next(iter(self.models.values()))
        inputs, outputs = moved_names(first), column_names(first)[1]
        ny, nu = len(outputs), len(inputs)
        axes = grid_of_axes(ax, (2 * ny, nu), size=(6.0, 2.3), sharex=True)
        for k, (name, model) in enumerate(self.models.items()):
            band = self.bands.get(name)
            if band is not None:
                area = {"color": color(k), "alpha": 0.25, "linewidth": 0}
                draw_band(axes, band, self.decibel, **area)
            f, G = linear_response(model, SLOWEST, band)
            label = f"{name}{not_sampled(G, band)}"
            style = {"label": label, **model_style(k, 1.4), **spelled(kwargs)}
            draw_response(axes, f, G, self.decibel, **style)
        finish_responses(axes, outputs, inputs, self.decibel)
        return self._drawn(axes)

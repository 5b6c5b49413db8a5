"""The ladder: simulated outputs, residuals and spectra of compared models.

An amplitude spectrum here is the square root of a Welch spectrum with a Hann window
("spectrum" scaling): a sine of amplitude a shows as a / sqrt(2), in the unit of the
signal, and two signals of one record compare frequency by frequency.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import ndimage

from ..shown import percent
from ._axes import (
    MEASURED,
    color,
    dots,
    finish,
    frequency_axis,
    model_style,
    time_axis,
)
from ._spectrum import amplitude_spectrum

VIEW = 300  # samples of the zoomed window
SMOOTHING = 15  # samples of the moving RMS


def plot_ladder(ladder, *, axes=None, output=0, view=VIEW, label=None, unit=None):
    """Draw simulated outputs, residuals and spectra of compared models.

    Top: a stretch of the measured test output and its simulations. Middle: the
    residuals over the same stretch, as moving RMS. Time begins with the first scored
    sample of the experiment, the longest one. Bottom: amplitude spectra of the
    measured output, of the residuals, and of the linearization residual e of the
    models that have both h and g (eq. gauge), over the whole of it.

    Parameters
    ----------
    ladder : Ladder
        Comparison made by `alssnn.ladder.model_ladder`.
    axes : sequence of three matplotlib.axes.Axes or None, default=None
        Where to draw; None makes a new figure.
    output : int, default=0
        Column of the output to draw.
    view : int, default=300
        Samples of the stretch, centered on the largest residual.
    label : str or None, default=None
        Name of the output on the axes; None means its name in the data, or "output".
    unit : str or None, default=None
        Unit of the output, for the axes.

    Returns
    -------
    axes : ndarray of shape (3,)
        The axes; ``axes[0].figure`` is the figure.

    Raises
    ------
    ValueError
        If `axes` are not three axes, or `output` or `view` is out of range.

    Examples
    --------
    >>> from alssnn.datasets import make_wiener_hammerstein
    >>> from alssnn.ladder import model_ladder
    >>> from alssnn.plotting import plot_ladder
    >>> record = make_wiener_hammerstein(1500, random_state=0)
    >>> ladder = model_ladder(*record, nx=6, dt=record.dt, models=["lti"])
    >>> axes = plot_ladder(ladder, unit="V")
    >>> axes[0].figure.savefig("ladder.png")  # doctest: +SKIP
    """
    ny = ladder.y_test.shape[1]
    if not 0 <= output < ny:
        raise ValueError(
            f"`output` must be between 0 and {ny - 1}, got {output}. "
            "Columns of the output count from 0."
        )
    if view < 2:
        raise ValueError(
            f"`view` must be at least 2 samples, got {view}. "
            "Give the length of the stretch in samples."
        )
    if axes is None:
        figure = Figure(figsize=(10.0, 9.0), layout="constrained")
        axes = figure.subplots(3, 1, height_ratios=(1.0, 0.8, 1.1))
        axes[0].sharex(axes[1])
        axes[0].tick_params(labelbottom=False)
    axes = np.asarray(axes, dtype=object).ravel()
    if len(axes) != 3 or not all(isinstance(ax, Axes) for ax in axes):
        raise ValueError(
            f"`axes` must hold three axes, got {len(axes)} objects. "
            "Make them by figure.subplots(3, 1)."
        )
    if label is None:
        names = ladder.output_names
        label = "output" if names is None else names[output]
    part = max(ladder.parts, key=lambda part: part.stop - part.start)
    window = _liveliest(ladder, part, output, view)
    t = ladder.dt * (np.arange(window.start, window.stop) - part.start)
    _draw_outputs(axes[0], ladder, t, window, output)
    _draw_residuals(axes[1], ladder, t, window, output)
    _draw_spectra(axes[2], ladder, part, output)
    suffix = "" if unit is None else f" [{unit}]"
    axes[0].set_ylabel(label + suffix)
    axes[1].set_ylabel(f"residual, moving RMS{suffix}")
    axes[2].set_ylabel(f"amplitude, RMS per bin{suffix}")
    return axes


def _residual(ladder, row, output):
    """Return the simulation error of one output, shape (n_scored,)."""
    return ladder.y_test[:, output] - row.y_hat[:, output]


def _bridged(z):
    """Return a signal with straight lines over its gaps; diverged ones stay."""
    k, measured = np.arange(len(z)), ~np.isnan(z)
    return np.interp(k, k[measured], z[measured]) if measured.any() else z


def _smooth(r):
    """Return the moving RMS of a signal."""
    squares = ndimage.uniform_filter1d(_bridged(r) ** 2, SMOOTHING, mode="nearest")
    # the running sum leaves rounding errors of either sign where r vanishes
    return np.sqrt(np.maximum(squares, 0.0))


def _liveliest(ladder, part, output, view):
    """Return the stretch around the largest error of the first finite model."""
    length = part.stop - part.start
    view = min(view, length)
    center = length // 2
    for row in ladder.rows:
        r = _residual(ladder, row, output)[part]
        if np.isfinite(row.y_hat[part, output]).all() and not np.isnan(r).all():
            center = int(np.nanargmax(np.abs(r)))
            break
    start = part.start + min(max(center - view // 2, 0), length - view)
    return slice(start, start + view)


def _draw_outputs(ax, ladder, t, window, output):
    y = ladder.y_test[window, output]
    ax.plot(t, y, label="measured", **MEASURED, **dots(y))
    limits = limits_of(y, [row.y_hat[window, output] for row in ladder.rows])
    for i, row in enumerate(ladder.rows):
        y_hat = row.y_hat[window, output]
        label = f"{row.name}{out_of_view(y_hat, *limits)}"
        ax.plot(t, y_hat, label=label, **model_style(i, 1.6))
    ax.set_ylim(*limits)
    ax.set_xlim(t[0], t[-1])
    time_axis(ax, label="")
    ax.set_title("Test data: measured and simulated output", loc="left")
    finish(ax, legend="beside")


def limits_of(y, simulated):
    """Return limits that show all curves, unless one diverges far from y.

    Parameters
    ----------
    y : ndarray of shape (N,)
        Measured output; nan where not measured.
    simulated : list of ndarray of shape (N,)
        Simulated outputs.

    Returns
    -------
    low, high : float
        Limits of the axis.
    """
    y = y[np.isfinite(y)]  # without its gaps
    if not len(y):
        y = np.concatenate([z[np.isfinite(z)] for z in simulated] + [np.zeros(1)])
    size = np.ptp(y) or 1.0
    curves = np.concatenate([y, *simulated])
    curves = curves[np.abs(curves - y.mean()) < 1.5 * size]
    return curves.min() - 0.05 * size, curves.max() + 0.05 * size


def out_of_view(curve, low, high):
    """Say in the legend that a curve leaves the picture, and where to.

    Parameters
    ----------
    curve : ndarray of shape (N,)
        The curve.
    low, high : float
        Limits of the axis.

    Returns
    -------
    note : str
        On a line of its own; empty if the curve stays.
    """
    if not np.isfinite(curve).all():
        return "\n(diverges)"
    beyond = (curve < low) | (curve > high)
    if not beyond.any():
        return ""
    part = "partly " if not beyond.all() else ""
    return f"\n({part}out of view: {curve.min():.2g} to {curve.max():.2g})"


def _draw_residuals(ax, ladder, t, window, output):
    for i, row in enumerate(ladder.rows):
        r = _residual(ladder, row, output)[window]
        style = {"color": color(i), "label": f"{row.name}, {_percent(row, output)}"}
        if np.isfinite(row.y_hat[window, output]).all() and np.nansum(np.abs(r)):
            ax.semilogy(t, _smooth(r), lw=1.4, **style)
        else:  # a line in the legend tells why there is none in the picture
            ax.semilogy([], [], **style)
    ax.set_xlim(t[0], t[-1])
    time_axis(ax, "time since the first scored sample")
    ax.set_title(
        "Residuals (in the legend: share of the output, all test data)", loc="left"
    )
    finish(ax, legend="beside")


def _percent(row, output):
    missed = 100 - row.fit_percent[output]
    if not np.isfinite(missed):
        return "diverged"
    return percent(missed)


def _draw_spectra(ax, ladder, part, output):
    _draw_spectrum(ax, ladder.y_test[part, output], ladder.dt, "measured", MEASURED)
    for i, row in enumerate(ladder.rows):
        style = {"color": color(i), "linewidth": 1.4}
        r = _residual(ladder, row, output)[part]
        if not np.isfinite(row.y_hat[part, output]).all():
            r = np.full_like(r, np.inf)  # not a gap
        _draw_spectrum(ax, r, ladder.dt, f"residual of {row.name}", style)
    for i, row in enumerate(ladder.rows):
        if {"W_h", "W_g"} <= set(row.model.params_):
            style = {"color": color(i), "linewidth": 1.4, "linestyle": (0, (4, 1.5))}
            label = f"nonlinear rest e\nof {row.name}"
            _draw_spectrum(ax, row.e[part, output], ladder.dt, label, style)
    frequency_axis(ax)
    ax.margins(x=0.0)
    ax.set_title("Amplitude spectra", loc="left")
    finish(ax, legend="beside")


def _draw_spectrum(ax, z, dt, label, style):
    z = _bridged(z)
    if not np.isfinite(z).all() or not z.any():
        ax.loglog([], [], label=label, **style)
        return
    ax.loglog(*amplitude_spectrum(z, dt), label=label, **style)

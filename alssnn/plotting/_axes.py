"""Axes, colors and finishing touches that all figures share."""

from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cbook import normalize_kwargs
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import (
    EngFormatter,
    LogFormatter,
    MaxNLocator,
    ScalarFormatter,
    StrMethodFormatter,
)

MEASURED = {"color": "0.65", "linewidth": 4.0}
# Okabe and Ito's palette: told apart by color-blind readers, too
COLORS = ("#0072B2", "#E69F00", "#D55E00", "#009E73", "#CC79A7", "#56B4E9")
LEGENDS: dict[str, dict] = {  # outside the axes
    # beside and above the power of ten of the ordinate
    "above": {
        "loc": "lower left",
        "bbox_to_anchor": (0, 1),
        "ncols": 2,
        "borderaxespad": 1.7,
    },
    "beside": {"loc": "upper left", "bbox_to_anchor": (1, 1)},
    "below": {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13)},
}
STEPS = (1, 2, 2.5, 5, 10)  # between ticks, in powers of ten
DPI = 100  # of a figure in a notebook
BAND = {"color": "0.85", "linewidth": 0.0}


class Display:
    """Share what all displays do in a notebook: they show their figure.

    Figures here are made without pyplot, which would show and keep them.
    """

    figure_: Any = None

    def __repr__(self):
        """Return the name, and whether it was drawn."""
        n = 0 if self.figure_ is None else len(self.figure_.axes)
        what = f"{n} axes" if n else "not drawn"
        return f"{type(self).__name__}({what})"

    def _drawn(self, axes):
        """Keep one axes, or an array of them, and their figure; return the display."""
        if isinstance(axes, np.ndarray):
            self.axes_, self.figure_ = axes, axes[0, 0].figure
        else:
            self.ax_, self.figure_ = axes, axes.figure
        return self

    def _repr_png_(self):
        """Return the figure for a notebook; None if it was not drawn."""
        if self.figure_ is None:
            return None
        content = BytesIO()
        self.figure_.savefig(content, format="png", dpi=DPI, bbox_inches="tight")
        return content.getvalue()


def color(i):
    """Return the color of the i-th of several curves.

    Parameters
    ----------
    i : int
        Number of the curve.

    Returns
    -------
    color : str
        Color, from `COLORS`.
    """
    return COLORS[i % len(COLORS)]


def spelled(options):
    """Return options of curves by their long names, as those of a display are.

    Parameters
    ----------
    options : dict
        Options, such as ``lw`` or ``linewidth``.

    Returns
    -------
    options : dict
        The same.

    Raises
    ------
    TypeError
        If an option is given by both of its names.
    """
    return normalize_kwargs(options, Line2D)


def dots(y):
    """Return how samples are drawn that have no measured one beside them.

    Parameters
    ----------
    y : ndarray of shape (N,)
        Signal; nan where not measured.

    Returns
    -------
    style : dict
        Options of its curve: a line alone would not show such samples.
    """
    known = np.pad(~np.isnan(y), 1)
    alone = np.flatnonzero(known[1:-1] & ~known[:-2] & ~known[2:])
    return {"marker": ".", "markevery": alone.tolist()} if len(alone) else {}


def model_style(i, linewidth):
    """Return how the i-th of several models is drawn.

    Parameters
    ----------
    i : int
        Number of the model.
    linewidth : float
        Width of its curves.

    Returns
    -------
    style : dict
        Options of the curves. Every other one is dashed: where models agree, the one
        below shows through.
    """
    dashes = (0, (4, 4)) if i % 2 else "-"
    return {"color": color(i), "linewidth": linewidth, "linestyle": dashes}


def grid_of_axes(ax, shape, *, size, **options):
    """Return axes to draw on, those of the caller or those of a new figure.

    Parameters
    ----------
    ax : matplotlib.axes.Axes, sequence of them or None
        Where to draw; None makes a figure, without pyplot.
    shape : tuple of int
        Rows and columns.
    size : tuple of float
        Width and height of one axes of a new figure, in inches.
    **options : dict
        Options of `Figure.subplots`, such as ``sharex``.

    Returns
    -------
    axes : ndarray of shape `shape`
        The axes.

    Raises
    ------
    ValueError
        If the number of axes is wrong, or something else was given.
    """
    rows, columns = shape
    if ax is None:
        figure = Figure(
            figsize=(size[0] * columns, size[1] * rows), layout="constrained"
        )
        return figure.subplots(rows, columns, squeeze=False, **options)
    axes = np.array(ax, dtype=object).ravel()
    if len(axes) != rows * columns or not all(isinstance(a, Axes) for a in axes):
        raise ValueError(
            f"`ax` must hold {rows * columns} axes ({rows} x {columns}), got "
            f"{len(axes)} objects. Make them by figure.subplots({rows}, {columns})."
        )
    return axes.reshape(shape)


def check_which(which, n):
    """Refuse the number of an experiment that there is not.

    Parameters
    ----------
    which : int
        Number of the experiment.
    n : int
        How many there are.

    Raises
    ------
    ValueError
        If there is none of this number.
    """
    if not 0 <= which < n:
        raise ValueError(
            f"`which` must be between 0 and {n - 1}, got {which}. Experiments count "
            "from 0."
        )


def columns(name, z):
    """Return signals as columns.

    Parameters
    ----------
    name : str
        Name of the argument.
    z : array_like of shape (N,) or (N, n)
        Signals.

    Returns
    -------
    z : ndarray of shape (N, n)
        Signals.

    Raises
    ------
    ValueError
        If it has another shape or a single sample.
    """
    z = np.asarray(z, dtype=float)
    if z.ndim not in (1, 2) or len(z) < 2:
        raise ValueError(
            f"`{name}` must have shape (N,) or (N, n) with N > 1, got {z.shape}. Time "
            "runs down the rows."
        )
    return z.reshape(len(z), -1)


def time_axis(ax, label="time"):
    """Label the abscissa as time.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Axes.
    label : str, default="time"
        Label; the ticks carry the unit.
    """
    ax.xaxis.set_major_formatter(EngFormatter(unit="s"))
    ax.xaxis.set_major_locator(MaxNLocator(6, steps=STEPS))  # units make them long
    ax.set_xlabel(label)


def few_ticks(axis):
    """Keep the ticks of small or large numbers apart, with one power of ten for all.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        Linear axis.
    """
    formatter = ScalarFormatter(useMathText=True)
    formatter.set_powerlimits((-3, 4))
    axis.set_major_formatter(formatter)
    axis.set_major_locator(MaxNLocator(6))


class _Minor(LogFormatter):
    """Label, by `text`, the minor ticks that a short axis has labels for."""

    def __init__(self, text):
        super().__init__()
        self.text = text

    def __call__(self, x, pos=None):
        return self.text(x) if super().__call__(x, pos) else ""


def frequency_axis(ax):
    """Label the abscissa as frequency.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Axes.
    """
    if ax.get_xscale() == "linear":
        ax.xaxis.set_major_locator(MaxNLocator(5, steps=STEPS))
    else:
        ax.xaxis.set_minor_formatter(_Minor(EngFormatter(unit="Hz")))
    ax.xaxis.set_major_formatter(EngFormatter(unit="Hz"))
    ax.set_xlabel("frequency")


def plain_logs(axis):
    """Label a logarithmic axis by plain numbers, which are short.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        Logarithmic axis.
    """
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(_Minor(StrMethodFormatter("{x:g}")))


def finish(ax, legend=True):
    """Draw grid and legend, in the style of the package.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Axes.
    legend : bool, "above", "beside" or "below", default=True
        Whether to draw a legend, where there are labels; the words keep it off the
        data.
    """
    ax.grid(True, which="major", color="0.88", linewidth=0.7)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)
    if legend and ax.get_legend_handles_labels()[0]:
        place = LEGENDS.get(legend, {})
        ax.legend(frameon=False, fontsize="small", **place)

"""Loops of several designs side by side, and what their models miss of a record."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ._axes import color, finish, time_axis

SIZE = (10.0, 5.6)  # inches


def plot_designs(responses, residuals, *, dt, label):
    """Draw true responses beside what was designed, and residuals of models.

    Top: one panel per response, on the same scale. Bottom: the residuals over a record.

    Parameters
    ----------
    responses : dict of str to tuple
        By name (t, design, true): times in seconds, and an output as it was designed
        and as it became, arrays of shape (N,).
    residuals : dict of str to ndarray of shape (N,)
        Measured minus simulated output of every model, by its name.
    dt : float
        Sampling time of the residuals, in seconds.
    label : str
        Name and unit of the output, for the axes.

    Returns
    -------
    figure : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import plot_designs
    >>> t = np.arange(5.0)
    >>> responses = {"loop": (t, 1 - 0.5**t, 1 - 0.6**t)}
    >>> figure = plot_designs(responses, {"model": 0.1 * t}, dt=1.0, label="y, rad")
    >>> len(figure.axes)
    2
    """
    figure = Figure(figsize=SIZE, layout="constrained")
    grid = figure.add_gridspec(2, len(responses), height_ratios=(1.2, 1.0))
    axes: list[Axes] = []
    for i in range(len(responses)):
        axes.append(figure.add_subplot(grid[0, i], sharey=axes[0] if axes else None))
        axes[i].tick_params(labelleft=i == 0)
    for i, (ax, (name, (t, design, true))) in enumerate(
        zip(axes, responses.items(), strict=True)
    ):
        ax.plot(t, true, color=color(i), linewidth=1.8, label="true plant")
        ax.plot(t, design, "k--", linewidth=1.0, label="as designed")
        ax.set_title(name)
        finish(ax)
        time_axis(ax)
    axes[0].set_ylabel(label)
    ax = figure.add_subplot(grid[1, :])
    # the largest first, so that the others are drawn above it; colors are those above
    n_open = len(responses) - len(residuals)
    for i, (name, residual) in enumerate(residuals.items()):
        t = dt * np.arange(len(residual))
        ax.plot(t, residual, color=color(n_open + i), linewidth=1.0, label=name)
    ax.set_title("residual on the test data: measured minus simulated")
    ax.set_ylabel(label)
    finish(ax)
    time_axis(ax)
    return figure

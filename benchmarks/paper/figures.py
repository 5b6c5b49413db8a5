"""Figures: output, error of the linear model and of AL-SSNN against time."""

import numpy as np
from matplotlib.figure import Figure

from alssnn.plotting import COLORS
from benchmarks.paper.studies import AL, LTI

SIZE, DPI = (8.0, 5.0), 90  # small files: no more than 150 kB
MAX_POINTS = 4000  # per curve; more are drawn by the envelope of as many bins


def draw(study, fits):
    """Draw the test record, or its end: the output, both errors, and the small one.

    Parameters
    ----------
    study : studies.Study
        The study.
    fits : dict of studies.Fit
        Fits by the name of the model.

    Returns
    -------
    figure : matplotlib.figure.Figure
        Two axes above each other: the (first) output and its errors in one scale, as
        in the paper, and the error of AL-SSNN in its own.
    """
    figure = Figure(figsize=SIZE, layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    curves = {}
    for name in (LTI, AL):
        y, y_hat = fits[name].model.simulate_test(study.test.u, study.test.y)
        curves[f"error of {name}"] = y[:, 0] - y_hat[:, 0]
    curves = {"output": y[:, 0], **curves}
    for (label, z), color in zip(curves.items(), COLORS[:1] + COLORS[2:], strict=False):
        z = z[-(study.view or len(z)) :]
        t = study.test.dt * np.arange(len(study.test) - len(z), len(study.test))
        for ax in (above,) if label != f"error of {AL}" else (above, below):
            ax.plot(*envelope(t, z), color=color, linewidth=0.6, label=label)
    above.legend(loc="upper right", frameon=False, ncols=3, fontsize="small")
    above.margins(x=0.0, y=0.15)
    for ax, title in ((above, study.title), (below, f"error of {AL}")):
        ax.set_title(title, loc="left", fontsize="medium")
        ax.set_ylabel(study.unit)
        ax.grid(True, color="0.88", linewidth=0.7)
        ax.set_axisbelow(True)
        for side in ("top", "right"):
            ax.spines[side].set_visible(False)
    below.set_xlabel("time in the test record, s")
    return figure


def envelope(t, z):
    """Return a curve of few points that looks the same: extremes of equal bins.

    Parameters
    ----------
    t, z : ndarray of shape (N,)
        Times and values.

    Returns
    -------
    t, z : ndarray of shape (M,)
        The curve itself if it is short; otherwise the smallest and the largest value
        of every bin, in the order of time.
    """
    if len(z) <= MAX_POINTS:
        return t, z
    bins = np.array_split(np.arange(len(z)), MAX_POINTS // 2)
    keep = [np.sort([b[np.argmin(z[b])], b[np.argmax(z[b])]]) for b in bins]
    keep = np.concatenate(keep)
    return t[keep], z[keep]

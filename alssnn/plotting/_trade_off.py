"""Accuracy against linearity along a path of weights gamma."""

import numpy as np

from ._axes import Display, color, finish, grid_of_axes, plain_logs, spelled


class GammaPathDisplay(Display):
    """Show the trade-off between accuracy and linearity.

    Parameters
    ----------
    path : GammaPath
        What `model_selection.gamma_path` returns.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        The axes.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.model_selection import gamma_path
    >>> from alssnn.plotting import GammaPathDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(600, random_state=0)
    >>> estimator = alssnn.AlSsnn(nx=4, n_h=2, n_g=2, alpha=0.0, max_iter=10)
    >>> path = gamma_path(estimator, *record, gammas=[10, 1, 0.1])
    >>> display = GammaPathDisplay.from_path(path)
    >>> display.figure_.savefig("path.png")  # doctest: +SKIP
    """

    def __init__(self, path):
        self.path = path

    @classmethod
    def from_path(cls, path, *, ax=None, **kwargs):
        """Draw a path.

        Parameters
        ----------
        path : GammaPath
            What `model_selection.gamma_path` returns.
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the curve.

        Returns
        -------
        display : GammaPathDisplay
            The display, drawn.
        """
        return cls(path).plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw test error against linearization error; unstable models are hollow.

        Parameters
        ----------
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the curve.

        Returns
        -------
        display : GammaPathDisplay
            Itself.

        Raises
        ------
        ValueError
            If no model of the path can be simulated.
        """
        path = self.path
        error, rmse = 100 * path.linearization_error, path.rmse_test
        finite = np.isfinite(error) & np.isfinite(rmse)
        if not finite.any():
            raise ValueError(
                "`path` must have a model whose simulation is finite, got none. Use "
                "larger gammas."
            )
        ((axes,),) = grid_of_axes(ax, (1, 1), size=(6.0, 4.0))
        style = {
            "color": color(0),
            "linewidth": 1.2,
            "zorder": 1,
            **spelled(kwargs),
        }
        draw = axes.loglog
        if not error[finite].all():  # zero has no place on a logarithmic axis
            draw = axes.semilogy
        draw(error[finite], rmse[finite], label="test data", **style)
        stable = path.spectral_radius < 1
        for which, face, label in (
            (finite & stable, style["color"], "A is stable"),
            (finite & ~stable, "white", "A is unstable"),
        ):
            if which.any():
                axes.scatter(
                    error[which],
                    rmse[which],
                    facecolors=face,
                    edgecolors=style["color"],
                    label=label,
                    zorder=2,
                )
        for i in np.flatnonzero(finite):
            axes.annotate(
                f"{path.gammas[i]:g}",
                (error[i], rmse[i]),
                xytext=(5, 5),
                textcoords="offset points",
                fontsize="small",
            )
        if (finite & stable).any():
            knee = path.knee()
            axes.plot(
                error[knee],
                rmse[knee],
                "o",
                markersize=14,
                fillstyle="none",
                color=color(2),
                label=f"knee, gamma = {path.gammas[knee]:g}",
            )
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                plain_logs(axis)
        axes.set_xlabel("linearization error rms(e) / std(y), %")
        axes.set_ylabel("RMSE of the free run, in units of y")
        finish(axes)
        return self._drawn(axes)

"""A loop that ran: outputs with their references, inputs with their limits."""

import numpy as np

from ._axes import Display, color, finish, grid_of_axes, spelled, time_axis


class RunDisplay(Display):
    """Show what plant and controller did along a simulation.

    Parameters
    ----------
    record : LoopRecord
        What `simulate` of a controller returned, of a predictive one, too.

    Attributes
    ----------
    axes_ : ndarray of shape (ny + nv, 1)
        Axes: every output, then every input that is moved.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import RunDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> run = model.controller(u_max=1.0).simulate(model, np.full((50, 1), 0.1))
    >>> RunDisplay(run).plot().axes_.shape
    (2, 1)
    """

    def __init__(self, record):
        self.record = record

    def plot(self, ax=None, **kwargs):
        """Draw outputs and inputs against time.

        References are dashed, limits dotted, and samples at a limit have a gray
        background. v, which no actuator sees, is dashed beside u.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output, then one per input that is moved; None makes a figure.
        **kwargs : dict
            Options of the curves of y and u, such as ``linewidth``.

        Returns
        -------
        display : RunDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        run, plant = self.record, self.record.law.plant
        ny, nv = run.y.shape[1], run.u.shape[1]
        axes = grid_of_axes(ax, (ny + nv, 1), size=(7.0, 2.2), sharex=True)
        style = {"color": color(0), "linewidth": 1.4, **spelled(kwargs)}
        for i, one in enumerate(axes[:ny, 0]):
            one.plot(run.t, run.y[:, i], **{"label": "y", **style})
            if run.tracks:
                one.plot(run.t, run.reference[:, i], "k--", lw=1.0, label="reference")
            one.set_ylabel(plant.outputs[i])
        v, saturated = run.v, run.saturated
        for i, one in enumerate(axes[ny:, 0]):
            one.fill_between(
                run.t,
                0,
                1,
                where=saturated[:, i],
                transform=one.get_xaxis_transform(),
                color="0.9",
                linewidth=0,
                step="post",
                label="at a limit" if saturated[:, i].any() else None,
            )
            later = {"drawstyle": "steps-post", **style}
            one.plot(run.t, run.u[:, i], **{"label": "u", **later})
            later |= {"color": color(2), "linestyle": "--", "linewidth": 1.0}
            one.plot(run.t, v[:, i], **{**later, "label": "v, before the law"})
            for limit in (run.law.u_min[i], run.law.u_max[i]):
                if np.isfinite(limit):
                    one.axhline(limit, color="k", linestyle=":", linewidth=1.0)
            one.set_ylabel(plant.inputs[plant.moved[i]])
        for one in axes[:, 0]:
            finish(one, legend="beside")
        time_axis(axes[-1, 0])
        return self._drawn(axes)

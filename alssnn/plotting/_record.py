"""A record as it was measured: outputs above inputs."""

from ._axes import Display, color, dots, finish, grid_of_axes, spelled, time_axis


class RecordDisplay(Display):
    """Show the signals of a record against time.

    Parameters
    ----------
    record : Record
        The record.

    Attributes
    ----------
    axes_ : ndarray of shape (ny + nu, 1)
        Axes: every output, then every input.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import RecordDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> RecordDisplay(record).plot().axes_.shape
    (2, 1)
    """

    def __init__(self, record):
        self.record = record

    def plot(self, ax=None, **kwargs):
        """Draw the signals.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output, then one per input; None makes a figure.
        **kwargs : dict
            Options of all curves, such as ``linewidth``.

        Returns
        -------
        display : RecordDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        record = self.record
        ny, nu = len(record.outputs), len(record.inputs)
        axes = grid_of_axes(ax, (ny + nu, 1), size=(7.0, 1.9), sharex=True)
        signals = [*record.y.T, *record.u.T]
        names = [*record.outputs, *record.inputs]
        for i, (one, z, name) in enumerate(
            zip(axes[:, 0], signals, names, strict=True)
        ):
            style = {"color": color(0 if i < ny else 2), "linewidth": 1.0}
            if i >= ny:  # inputs are held
                style["drawstyle"] = "steps-post"
            one.plot(record.t, z, **{**style, **dots(z), **spelled(kwargs)})
            one.set_ylabel(name)
            finish(one, legend=False)
        time_axis(axes[-1, 0])
        axes[0, 0].set_title(record.name, fontsize="medium")
        return self._drawn(axes)

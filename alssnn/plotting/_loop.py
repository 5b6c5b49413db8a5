"""Responses of loops side by side."""

import numpy as np

from ..plants import as_plant
from ..validation import column_names, moved_names
from ._axes import Display, color, finish, grid_of_axes, spelled, time_axis

EQUAL = 1e-9  # distance over size from which two responses differ by rounding


class LoopDisplay(Display):
    """Compare responses, such as open loop, linear design and linearized loop.

    Parameters
    ----------
    responses : dict of str to control.TimeResponseData
        Responses by name, of python-control's ``input_output_response`` or
        ``forced_response``.
    outputs : sequence of str or None, default=None
        Labels of the outputs to draw, each from the responses that have it; None means
        those that all responses have.
    design : str or None, default=None
        Name of the response that the others are meant to follow: drawn dashed.
    names : dict of str to str or None, default=None
        What stands beside the axes of an output, by its label; None means the label.
    references : dict of str to float or None, default=None
        Levels that outputs are to reach, by label: drawn dotted.
    ranges : dict of str to tuple of float or None, default=None
        Lowest and highest values that outputs had in the training data, by label:
        drawn as a band.

    Attributes
    ----------
    axes_ : ndarray of shape (n_outputs, 1)
        Axes, one below the other.
    figure_ : matplotlib.figure.Figure
        The figure.
    distance_ : dict of str to ndarray of shape (n_outputs,)
        RMS distance from the design of every other response, which the legend shows;
        empty without a design, nan where sampling times differ or one of both lacks
        the output.

    Raises
    ------
    ValueError
        If there is no response, none has an output, or `design` is not among them.

    Examples
    --------
    >>> import control
    >>> from alssnn.feedback import designed_loop, lqi
    >>> from alssnn.plotting import LoopDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> loop = designed_loop(model, lqi(model, np.eye(5), np.eye(1)))
    >>> t = record.dt * np.arange(50)
    >>> response = control.forced_response(loop, t, np.ones(50))
    >>> display = LoopDisplay.from_responses({"design": response})
    >>> display.figure_.savefig("loop.png")  # doctest: +SKIP
    """

    def __init__(
        self,
        responses,
        *,
        outputs=None,
        design=None,
        names=None,
        references=None,
        ranges=None,
    ):
        if not responses:
            raise ValueError("`responses` must hold at least one, got none.")
        every = [_signals(response) for response in responses.values()]
        if outputs is None:
            outputs = [name for name in every[0] if all(name in z for z in every)]
        known = {name for signals in every for name in signals}
        missing = sorted(set(outputs) - known)
        if missing or not outputs:
            raise ValueError(
                "`outputs` must be outputs of the responses "
                f"({', '.join(sorted(known))}), got "
                f"{', '.join(missing) or 'none in common'}. Rename them, or give those "
                "to draw."
            )
        if design is not None and design not in responses:
            raise ValueError(
                f"`design` must be one of {', '.join(responses)}, got {design!r}."
            )
        self.responses, self.outputs, self.design = responses, list(outputs), design
        self.names, self.references = names or {}, references or {}
        self.ranges = ranges or {}

    @classmethod
    def from_responses(
        cls,
        responses,
        *,
        outputs=None,
        design=None,
        names=None,
        references=None,
        ranges=None,
        ax=None,
        **kwargs,
    ):
        """Draw responses.

        Parameters
        ----------
        responses : dict of str to control.TimeResponseData
            Responses by name.
        outputs : sequence of str or None, default=None
            Labels of the outputs to draw, each from the responses that have it; None
            means those that all responses have.
        design : str or None, default=None
            Name of the response that the others are meant to follow.
        names : dict of str to str or None, default=None
            What stands beside the axes of an output, by its label; None means the
            label.
        references : dict of str to float or None, default=None
            Levels that outputs are to reach, by label.
        ranges : dict of str to tuple of float or None, default=None
            Lowest and highest values that outputs had in the training data, by label.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output; None makes a figure.
        **kwargs : dict
            Options of all curves.

        Returns
        -------
        display : LoopDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If an output is missing or the number of axes is wrong.
        """
        display = cls(
            responses,
            outputs=outputs,
            design=design,
            names=names,
            references=references,
            ranges=ranges,
        )
        return display.plot(ax, **kwargs)

    @classmethod
    def from_steps(cls, model, responses, step=None, *, ax=None, **kwargs):
        """Draw the step responses of a model beside their references.

        The input is drawn on the band that it covered in the training data.

        Parameters
        ----------
        model : estimator
            Fitted model.
        responses : dict of str to control.TimeResponseData
            What `feedback.step_comparison` returned for it.
        step : float, array_like of shape (ny,) or None, default=None
            Height of the step that it was given.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output and input; None makes a figure.
        **kwargs : dict
            Options of all curves.

        Returns
        -------
        display : LoopDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        from ..feedback import input_range  # python-control takes a while

        inputs, outputs = moved_names(model), column_names(model)[1]
        labels = list(responses["model"].output_labels)
        # the real input before v, which no actuator sees
        nu, ny = len(inputs), len(outputs)
        y, v, u = labels[:ny], labels[ny : ny + nu], labels[ny + nu :]
        names = [*outputs, *inputs, *(f"v, in units of {name}" for name in inputs)]
        step = as_plant(model).y_scale if step is None else np.asarray(step)
        return cls.from_responses(
            responses,
            outputs=[*y, *u, *v],
            design="design",
            names=dict(zip([*y, *u, *v], names, strict=True)),
            references=dict(zip(y, model.y_offset_ + step, strict=True)),
            ranges=dict(zip(u, zip(*input_range(model), strict=True), strict=True)),
            ax=ax,
            **kwargs,
        )

    def plot(self, ax=None, **kwargs):
        """Draw the outputs against time.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output; None makes a figure.
        **kwargs : dict
            Options of all curves, such as ``linewidth``.

        Returns
        -------
        display : LoopDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        shape = len(self.outputs), 1
        axes = grid_of_axes(ax, shape, size=(7.0, 2.6), sharex=True)
        self.distance_ = {
            name: self._distances(response)
            for name, response in self.responses.items()
            if self.design is not None and name != self.design
        }
        for i, (one, output) in enumerate(zip(axes[:, 0], self.outputs, strict=True)):
            for j, (name, response) in enumerate(self.responses.items()):
                signals = _signals(response)
                if output not in signals:
                    continue
                label, style = name, {"color": color(j), "linewidth": 1.4}
                if name == self.design:
                    style |= {"color": "k", "linestyle": "--", "zorder": 3}
                elif name in self.distance_ and output in self._designed():
                    miss, size = self.distance_[name][i], np.nanstd(response.outputs)
                    label = f"{name}, RMS from design {miss:.3g}"
                    if miss < EQUAL * size:
                        label = f"{name}, as designed"
                style |= {"label": label, **spelled(kwargs)}
                one.plot(response.time, signals[output], **style)
            if output in self.references:
                level = self.references[output]
                one.axhline(level, color="0.4", linestyle=":", label="reference")
            if output in self.ranges:
                band = {"facecolor": "0.93", "edgecolor": "0.7", "zorder": 0}
                band |= {"label": "range of the training data"}
                one.axhspan(*self.ranges[output], **band)
            one.set_ylabel(self.names.get(output, output))
            finish(one)
        time_axis(axes[-1, 0])
        return self._drawn(axes)

    def _designed(self):
        return _signals(self.responses[self.design])

    def _distances(self, response):
        signals, designed = _signals(response), self._designed()
        design = self.responses[self.design]
        same = np.array_equal(design.time, response.time)
        return np.array(
            [
                np.sqrt(np.mean((signals[y] - designed[y]) ** 2))
                if same and y in signals and y in designed
                else np.nan
                for y in self.outputs
            ]
        )


def _signals(response):
    """Return outputs over time by their labels; of several traces, the first."""
    pairs = zip(response.output_labels, response.y, strict=True)
    return {label: y if y.ndim == 1 else y[0] for label, y in pairs}

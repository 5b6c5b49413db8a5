"""Before the model: excitations, and measured frequency responses."""

import numpy as np

from ._axes import (
    Display,
    color,
    few_ticks,
    finish,
    frequency_axis,
    grid_of_axes,
    spelled,
    time_axis,
)

PERIODS = 2  # of an experiment that are drawn at most
FLOOR = 1e-3  # of the largest line: what is smaller is not drawn
BELOW = 0.3  # of the smallest standard error: where the axis of a response ends
# what a level is called, and how it is drawn: curves first, then what disturbs them
LEVELS = {
    "output": ("output", {"color": "k", "linewidth": 1.2}),
    "total": ("not linear", {"color": color(2), "linewidth": 1.2}),
    "distortion": ("distortion", {"color": color(2), "linewidth": 1.2}),
    "even": ("even", {"color": color(0), "linestyle": "--", "linewidth": 1.2}),
    "odd": ("odd", {"color": color(1), "linestyle": "--", "linewidth": 1.2}),
    "noise": ("noise", {"color": color(3), "linewidth": 1.2}),
}


class ExcitationDisplay(Display):
    """Show inputs over time within their limits, and their spectrum.

    Parameters
    ----------
    excitation : Excitation
        What functions of :mod:`alssnn.excitation` return.

    Attributes
    ----------
    axes_ : ndarray of shape (nu, 2)
        Axes: signal and spectrum, one row per input.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.excitation import multisine
    >>> display = multisine(256, random_state=0).plot()
    >>> display.axes_.shape
    (1, 2)
    """

    def __init__(self, excitation):
        self.excitation = excitation

    def plot(self, ax=None, **kwargs):
        """Draw an experiment of every realization, of two at most.

        It is the one of the input, if there is one: swept sines move one at a time.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per input, row by row; None makes a figure.
        **kwargs : dict
            Options of the curves of the first realization.

        Returns
        -------
        display : ExcitationDisplay
            Itself.

        Raises
        ------
        ValueError
            If the axes do not fit.
        """
        one = self.excitation
        nu, period = one.u.shape[1], one.period
        axes = grid_of_axes(ax, (nu, 2), size=(6.0, 2.6))
        each = one.n_experiments // one.n_realizations
        for i in range(nu):
            signal, spectrum = axes[i]
            for m, u in enumerate(one.experiments[min(i, each - 1) :: each][:2]):
                part = u[: PERIODS * period, i]
                style = {"color": color(m), "linewidth": 1.0}
                style |= {"label": f"realization {m}"} | (
                    spelled(kwargs) if m == 0 else {}
                )
                t = one.dt * np.arange(len(part))
                signal.plot(t, part, drawstyle="steps-post", **style)
                lines, level = _spectrum(u[:period, i], one.lines)
                if one.lines is not None:
                    style |= {"marker": ".", "linestyle": "none"}
                spectrum.semilogy(lines / (period * one.dt), level, **style)
            for limit in (one.low[i], one.high[i]):
                signal.axhline(limit, color="0.4", linestyle="--", linewidth=0.8)
            signal.set_ylabel(one.names[i])
            spectrum.set_ylim(FLOOR * level.max(), 2 * level.max())
            spectrum.set_ylabel(f"rms of a line, {one.names[i]}")
            few_ticks(signal.yaxis)
            time_axis(signal)
            frequency_axis(spectrum)
            finish(signal, legend="above" if i == 0 else False)
            finish(spectrum, legend=False)
        return self._drawn(axes)


def _spectrum(period, lines):
    """Return lines and their rms values; without zero frequency."""
    level = np.abs(np.fft.rfft(period)) * np.sqrt(2) / len(period)
    lines = np.arange(1, len(level)) if lines is None else lines
    return lines, level[lines]


class ApproximationDisplay(Display):
    """Show a measured frequency response, and what disturbs the output.

    Parameters
    ----------
    approximation : BestLinearApproximation
        What functions of :mod:`alssnn.nonparametric` return.
    level : float, default=0.95
        Probability of the band of the magnitude.

    Attributes
    ----------
    axes_ : ndarray of shape (ny, nu + 1)
        Axes: the magnitude of G, one column per input, with its band and its standard
        errors by noise and in all; last, the levels of the output and of what is not
        linear in it.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.excitation import multisine
    >>> from alssnn.nonparametric import best_linear_approximation
    >>> excitation = multisine(256, random_state=0)
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal((len(excitation), 1))
    >>> bla = best_linear_approximation(excitation, excitation.u**3 + noise)
    >>> bla.plot().axes_.shape
    (1, 2)
    """

    def __init__(self, approximation, level=0.95):
        self.approximation, self.level = approximation, level

    def plot(self, ax=None, **kwargs):
        """Draw magnitudes and levels.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Axes, nu + 1 per output, row by row; None makes a figure.
        **kwargs : dict
            Options of the response.

        Returns
        -------
        display : ApproximationDisplay
            Itself.

        Raises
        ------
        ValueError
            If the axes do not fit.
        """
        one = self.approximation
        _, ny, nu = one.G.shape
        f, (low, high) = one.frequencies, one.band(self.level)
        axes = grid_of_axes(ax, (ny, nu + 1), size=(5.0, 3.2), sharex=True)
        response = {
            "color": "k",
            "linewidth": 1.2,
            "label": "|G|",
            **spelled(kwargs),
        }
        error = {"linestyle": "none", "marker": ".", "markersize": 3}
        for i in range(ny):
            for j in range(nu):
                here = axes[i, j]
                band = f"{100 * self.level:g} %"
                limits = low[:, i, j], high[:, i, j]
                here.fill_between(f, *limits, color="0.8", label=band)
                here.semilogy(f, np.abs(one.G[:, i, j]), **response)
                for name, std, style in (
                    ("standard error", one.std, LEVELS["distortion"][1]),
                    ("that of noise", one.noise_std, LEVELS["noise"][1]),
                ):
                    if np.isfinite(std[:, i, j]).any():
                        dots = {**error, "color": style["color"]}
                        here.semilogy(f, std[:, i, j], label=name, **dots)
                end = BELOW * _smallest(one.std[:, i, j], one.noise_std[:, i, j])
                here.set_ylim(min(end, BELOW * _smallest(np.abs(one.G[:, i, j]))))
                here.set_ylabel(f"{one.output_names[i]} / {one.input_names[j]}")
                finish(here, legend="above" if i == j == 0 else False)
            here = axes[i, -1]
            for name, (label, style) in LEVELS.items():
                values = getattr(one, name)[:, i]
                if name == "total" and np.isfinite(one.distortion[:, i]).any():
                    continue  # its parts are drawn
                values = np.where(values > 0, values, np.nan)  # the axis is logarithmic
                if np.isfinite(values).any():
                    here.semilogy(f, values, label=label, **style)
            here.set_ylabel(f"rms of a line, {one.output_names[i]}")
            finish(here, legend="above" if i == 0 else False)
        for here in axes[-1]:
            frequency_axis(here)
        return self._drawn(axes)


def _smallest(*curves):
    """Return the smallest number above zero; 1 if there is none."""
    values = np.concatenate(curves)
    values = values[values > 0]
    return values.min() if len(values) else 1.0

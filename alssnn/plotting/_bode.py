"""Frequency responses: the linear part, and the model at several amplitudes."""

import numpy as np

from ..validation import (
    column_names,
    frequency_response,
    moved_names,
    sine_response,
)
from ._axes import Display, color, finish, frequency_axis, grid_of_axes, spelled

N_FREQUENCIES = 300  # of the linear response
LONGEST = 20  # characters of a label beside an axis


class BodeDisplay(Display):
    """Show the frequency response of (A, B, C, D) and of the model at amplitudes.

    The response of the model to sines of one amplitude is its describing function:
    where it lies on the linear response, the loop is linear at that amplitude.

    Parameters
    ----------
    frequencies : ndarray of shape (n,)
        Frequencies of the linear response, in Hz.
    G : ndarray of complex, shape (n, ny, nu)
        Linear response.
    input_names, output_names : list of str
        Names of the signals.
    responses : sequence of tuple, default=()
        Tuples (label, frequencies, G) of further responses.
    band : FrequencyBand, tuple of ndarray or None, default=None
        Confidence in the linear response: what ``frequency_response`` of a covariance
        returns, or frequencies, lower and upper limits of the magnitude, of shapes (m,)
        and (m, ny, nu). Where no band holds, the legend says so.
    decibel : bool, default=False
        Whether magnitudes are in dB.

    Attributes
    ----------
    axes_ : ndarray of shape (2 * ny, nu)
        Axes: for every output magnitude above phase, one column per input.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import BodeDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=6, dt=record.dt).fit(*record)
    >>> BodeDisplay.from_estimator(model, [0.1, 1.0]).axes_.shape
    (2, 1)
    """

    def __init__(
        self,
        frequencies,
        G,
        input_names,
        output_names,
        responses=(),
        band=None,
        decibel=False,
    ):
        self.frequencies, self.G = frequencies, G
        self.input_names, self.output_names = input_names, output_names
        self.responses, self.band, self.decibel = responses, band, decibel

    @classmethod
    def from_estimator(
        cls,
        model,
        amplitudes=(),
        *,
        loop="open",
        n_frequencies=40,
        period=1024,
        band=None,
        decibel=False,
        ax=None,
        **kwargs,
    ):
        """Draw the frequency responses of a fitted model.

        Parameters
        ----------
        model : estimator
            Fitted model.
        amplitudes : array_like of shape (n,) or (n, nu), default=()
            Amplitudes of sines at the inputs, in the units of u; a row has one per
            input. None are simulated by default.
        loop : {"open", "closed"}, default="open"
            Whether the sines are u, or v of the linearized loop u = v - h(s).
        n_frequencies : int, default=40
            Number of sines per amplitude.
        period : int, default=1024
            Samples of the slowest sine.
        band : FrequencyBand, tuple of ndarray or None, default=None
            Confidence band of the linear response: what ``frequency_response`` of a
            covariance returns, or frequencies, lower and upper limits of the
            magnitude, of shapes (m,) and (m, ny, nu).
        decibel : bool, default=False
            Whether magnitudes are in dB.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Axes; None makes a figure.
        **kwargs : dict
            Options of the linear response.

        Returns
        -------
        display : BodeDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If an option is out of range, or the band or the axes do not fit.
        """
        moved, outputs = model.plant_.moved, column_names(model)[1]
        nu = len(moved)
        amplitudes = np.asarray(amplitudes, dtype=float)
        if amplitudes.size and amplitudes.shape not in [
            (len(amplitudes),),
            (len(amplitudes), nu),
        ]:
            raise ValueError(
                f"`amplitudes` must have shape (n,) or (n, {nu}), got "
                f"{amplitudes.shape}. Give one row per curve."
            )
        responses = []
        for row in amplitudes:
            row = np.broadcast_to(row, nu)
            found = [
                sine_response(
                    model,
                    row[j],
                    loop=loop,
                    input=moved[j],
                    n_frequencies=n_frequencies,
                    period=period,
                )
                for j in range(nu)
            ]
            what = "model" if loop == "open" else "loop u = v - h"
            G = np.stack([G for _, G in found], axis=-1)
            responses.append((f"{what}, {_amplitude(row, G)}", found[0][0], G))
        (f, G), inputs = linear_response(model, period, band), moved_names(model)
        display = cls(f, G, inputs, outputs, responses, band, decibel)
        return display.plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw magnitudes and phases.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output and input, rows first; None makes a figure.
        **kwargs : dict
            Options of the linear response, such as ``color``.

        Returns
        -------
        display : BodeDisplay
            Itself.

        Raises
        ------
        ValueError
            If the band or the axes do not fit.
        """
        _, ny, nu = self.G.shape
        axes = grid_of_axes(ax, (2 * ny, nu), size=(6.0, 2.3), sharex=True)
        db = self.decibel
        if self.band is not None:
            draw_band(axes, self.band, db, label="confidence", color="0.85")
        style = {"color": "k", "linewidth": 1.6, **spelled(kwargs)}
        label = f"(A, B, C, D){not_sampled(self.G, self.band)}"
        draw_response(axes, self.frequencies, self.G, db, label, **style)
        for i, (label, f, G) in enumerate(self.responses):
            style = {"color": color(i), "linewidth": 1.2, "marker": ".", "ls": "--"}
            draw_response(axes, f, G, db, label, **style)
        finish_responses(axes, self.output_names, self.input_names, self.decibel)
        return self._drawn(axes)


def _amplitude(row, G):
    """Return the amplitudes of the inputs in words, and whether all is drawn."""
    values = row[:1] if np.ptp(row) == 0 else row  # in the order of the inputs
    words, known = ", ".join(f"{value:.3g}" for value in values), np.isfinite(G)
    if known.all():
        return f"amplitude {words}"
    return f"amplitude {words}, {'partly ' * bool(known.any())}diverges"


def linear_response(model, period, band=None):
    """Return the response of (A, B, C, D), as a loop sees it, or as its band does.

    Parameters
    ----------
    model : estimator
        Fitted model.
    period : int
        Samples of the slowest sine.
    band : FrequencyBand, tuple of ndarray or None, default=None
        Confidence in it. That of a covariance in continuous time is one of a response
        that is not sampled, which is returned then.

    Returns
    -------
    frequencies : ndarray of shape (n,)
        Frequencies, in Hz.
    G : ndarray of complex, shape (n, ny, nu)
        Response.
    """
    dt = model.plant_.dt
    if model.plant_.rates is not None and hasattr(band, "response"):
        return band.omega / (2 * np.pi), band.response
    f = np.geomspace(1 / (period * dt), 0.5 / dt, N_FREQUENCIES)
    return f, frequency_response(model.to_statespace(dt=dt), f)


def not_sampled(G, band):
    """Return what the legend adds to the name of a response that is that of its band.

    Parameters
    ----------
    G : ndarray of complex
        The response.
    band : FrequencyBand, tuple of ndarray or None
        Its confidence.

    Returns
    -------
    words : str
        Empty for others.
    """
    return ", inputs not held" if G is getattr(band, "response", None) else ""


def draw_response(axes, f, G, decibel, label, **style):
    """Draw a frequency response, its phase beside the one that is there already.

    Parameters
    ----------
    axes : ndarray of shape (2 * ny, nu)
        Axes: for every output magnitude above phase, one column per input.
    f : ndarray of shape (n,)
        Frequencies, in Hz.
    G : ndarray of complex, shape (n, ny, nu)
        Response.
    decibel : bool
        Whether magnitudes are in dB.
    label : str
        Name of the response.
    **style : dict
        Options of the curves.
    """
    for i, j in np.ndindex(G.shape[1:]):
        magnitude, phase = axes[2 * i : 2 * i + 2, j]
        before = [line.get_data() for line in phase.get_lines()[:1]]
        angles = _beside(f, degrees(G[:, i, j]), *before)
        magnitude.plot(f, magnitudes(G[:, i, j], decibel), label=label, **style)
        phase.plot(f, angles, **style)


def _beside(f, angles, other=None):
    """Return phases with the whole turns that bring them near another response."""
    if other is None:
        return angles
    at, before = (z[np.isfinite(other[1])] for z in other)
    apart = np.interp(f, at, before) - angles if len(at) else np.full(len(f), np.nan)
    apart = apart[np.isfinite(apart)]
    return angles + 360.0 * np.round(np.median(apart) / 360.0) if len(apart) else angles


def draw_band(axes, band, decibel, label=None, **style):
    """Draw the confidence in a magnitude; the legend says where none holds.

    Parameters
    ----------
    axes : ndarray of shape (2 * ny, nu)
        Axes: for every output magnitude above phase, one column per input.
    band : FrequencyBand or tuple of ndarray
        The band, or frequencies in Hz, lower and upper limits.
    decibel : bool
        Whether magnitudes are in dB.
    label : str or None, default=None
        Name of a band that holds.
    **style : dict
        Options of the area.

    Raises
    ------
    ValueError
        If the band does not fit.
    """
    if hasattr(band, "magnitude_band"):
        band = (band.omega / (2 * np.pi), *band.magnitude_band())
    ny, nu = len(axes) // 2, axes.shape[1]
    shapes = [np.shape(part) for part in band]
    n = len(band[0]) if len(shapes) == 3 else 0
    if shapes != [(n,), (n, ny, nu), (n, ny, nu)]:
        raise ValueError(
            f"`band` must hold frequencies, lower and upper limits of shapes (n,) "
            f"and (n, {ny}, {nu}), got {shapes}."
        )
    f, *limits = (np.asarray(part) for part in band)
    for i, j in np.ndindex(ny, nu):
        low, high = (magnitudes(limit[:, i, j], decibel) for limit in limits)
        holds = np.isfinite(limits[0][:, i, j]).any()
        name = label if holds else "no confidence band holds"
        axes[2 * i, j].fill_between(f, low, high, label=name, **style)


def finish_responses(axes, outputs, inputs, decibel):
    """Label and scale the axes of frequency responses.

    Parameters
    ----------
    axes : ndarray of shape (2 * ny, nu)
        Axes: for every output magnitude above phase, one column per input.
    outputs, inputs : list of str
        Names of the signals.
    decibel : bool
        Whether magnitudes are in dB.
    """
    for i, output in enumerate(outputs):
        for j, name in enumerate(inputs):
            magnitude, phase = axes[2 * i : 2 * i + 2, j]
            what = f"|{output} / {name}|"
            if len(what) > LONGEST:
                what = what.replace(" / ", " /\n", 1)
            magnitude.set_ylabel(f"{what}, dB" if decibel else what)
            magnitude.set_yscale("linear" if decibel else "log")
            phase.set_ylabel("phase, degrees")
            for one in (magnitude, phase):
                one.set_xscale("log")
            finish(magnitude, legend=i == j == 0)
            finish(phase, legend=False)
    for one in axes[-1]:
        frequency_axis(one)


def degrees(response):
    """Return the phase without jumps.

    Parameters
    ----------
    response : ndarray of complex of shape (n,)
        Frequency response.

    Returns
    -------
    phase : ndarray of shape (n,)
        Phase, in degrees; nan where the response is not known.
    """
    phase = np.full(len(response), np.nan)
    known = np.isfinite(response)
    phase[known] = np.degrees(np.unwrap(np.angle(response[known])))
    return phase


def magnitudes(response, decibel):
    """Return the magnitude of a response.

    Parameters
    ----------
    response : ndarray of shape (n,)
        Frequency response, or its magnitude.
    decibel : bool
        Whether in dB.

    Returns
    -------
    size : ndarray of shape (n,)
        Magnitude.
    """
    size = np.abs(response)
    with np.errstate(divide="ignore"):
        return 20 * np.log10(size) if decibel else size

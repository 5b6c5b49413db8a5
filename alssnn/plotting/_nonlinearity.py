"""Nonlinearities: h over its range, and what g leaves at the output."""

import numpy as np

from ..plants import as_plant
from ..shown import percent
from ..simulation import simulate
from ..validation import column_names, moved_names, scored_experiments
from ._axes import (
    MEASURED,
    Display,
    color,
    few_ticks,
    finish,
    frequency_axis,
    grid_of_axes,
    spelled,
)
from ._spectrum import amplitude_spectrum

N_POINTS = 200  # of a curve of h
BINS = 40
LEVELS = (0.1, 0.5, 0.9)  # quantiles of h at which s rests below a curve of phi


class NonlinearityDisplay(Display):
    """Show h over its input range, with the density of the data.

    With several arguments s the curves are cuts: one argument moves, the others rest
    at their median. Where the data are thin, h is a guess.

    A monotone map v = phi(u, s) is drawn over u itself, at three samples of s: those
    at which h is at its 10 %, 50 % and 90 % quantile while u is at its median.

    Parameters
    ----------
    h : callable
        Function ``h(s)`` of samples (N, ns) with values (N, nv).
    s : ndarray of shape (N, ns)
        Arguments of h in the data: what the law measures, disturbances included, and
        the inputs u behind it if ``n_inputs`` says so.
    argument_names, input_names : list of str
        Names of the arguments, and of the inputs that h adds to.
    n_inputs : int, default=0
        Number of last arguments that are inputs, over which phi is drawn.

    Attributes
    ----------
    axes_ : ndarray of shape (nv, ns)
        Axes.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import NonlinearityDisplay
    >>> record = alssnn.datasets.make_pendulum(600, noise=0.01, random_state=0)
    >>> model = alssnn.FlSsnn(nx=2, n_h=3, n_init=1, random_state=0)
    >>> model = model.fit(*record)
    >>> display = NonlinearityDisplay.from_estimator(model, *record)
    >>> display.figure_.savefig("law.png")  # doctest: +SKIP
    """

    def __init__(self, h, s, argument_names, input_names, n_inputs=0):
        self.h, self.s, self.n_inputs = h, s, n_inputs
        self.argument_names, self.input_names = argument_names, input_names

    @classmethod
    def from_estimator(cls, model, u, y, experiment=None, *, ax=None, **kwargs):
        """Draw h of a fitted model.

        Parameters
        ----------
        model : estimator
            Fitted model with a network h.
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs: the arguments of h with output feedback. With state feedback the
            arguments are the simulated states.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per input and argument; None makes a figure.
        **kwargs : dict
            Options of the curves.

        Returns
        -------
        display : NonlinearityDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If the model has no h, or the number of axes is wrong.
        """
        plant, records = as_plant(model), model.prepare_records(u, y, experiment)
        if not plant.cancels:
            raise ValueError(
                f"`model` must have a network h, got {type(model).__name__} without "
                "one. Fit AlSsnn or FlSsnn with n_h > 0."
            )
        (every, names), inputs = column_names(model), moved_names(model)
        if plant.feedback == "state":
            form, names = plant.arrived().lure, [f"x{i}" for i in range(plant.nx)]
            runs = [
                simulate(form, record.du, record.x0, plant.x_scale)[:-1]
                for record in records
            ]
        else:
            runs = [record.y for record in records]
        u = np.vstack([record.du + plant.u_offset for record in records])
        given = list(plant.given)
        parts = [np.vstack(runs), u[:, given]]
        names = [*names, *(every[i] for i in given)]
        if not plant.is_explicit:  # h = phi(u, s) - u
            parts.append(u[:, plant.moved])
            names += inputs
        ends = np.cumsum([part.shape[1] for part in parts])[:-1]

        def h(z):
            s, d, *m = np.split(z, ends, axis=1)
            return plant.cancelled(s, m[0] if m else None, d)

        s = np.hstack(parts)
        s = s[np.isfinite(s).all(axis=1)]
        n_inputs = 0 if plant.is_explicit else plant.nv
        display = cls(h, s, names, inputs, n_inputs)
        return display.plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw cuts of h and the density of its arguments.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per input and argument, rows first; None makes a figure.
        **kwargs : dict
            Options of the curves.

        Returns
        -------
        display : NonlinearityDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        ns, nu = self.s.shape[1], len(self.input_names)
        axes = grid_of_axes(
            ax, (nu, ns), size=(4.5, 3.0), sharey=False if self.n_inputs else "row"
        )
        for j in range(ns):
            for i in range(nu):
                one = axes[i, j]
                density = one.twinx()
                density.hist(self.s[:, j], BINS, density=True, color="0.88")
                density.set_yticks([])
                density.spines[["top", "right"]].set_visible(False)
                # the curve lies above the density
                one.set_zorder(density.get_zorder() + 1)
                one.patch.set_visible(False)
                value = "phi" if j >= ns - self.n_inputs else "h"
                curves = self._maps if value == "phi" else self._cut
                for k, (z, h, label) in enumerate(curves(i, j)):
                    style = {"color": color(k), "linewidth": 1.8, **spelled(kwargs)}
                    one.plot(z, h, label=label, **style)
                one.set_xlabel(f"{self.argument_names[j]} (gray: density of the data)")
                one.set_ylabel(f"{value}, in units of {self.input_names[i]}")
                finish(one, legend="above" if i == 0 and j in (0, ns - 1) else False)
        return self._drawn(axes)

    def _moving(self, j, rest):
        """Return arguments of which one moves over its range."""
        s = np.tile(rest, (N_POINTS, 1))
        s[:, j] = np.linspace(self.s[:, j].min(), self.s[:, j].max(), N_POINTS)
        return s

    def _cut(self, i, j):
        """Yield the curve of h over one argument."""
        s = self._moving(j, np.median(self.s, axis=0))
        several = self.s.shape[1] > 1
        label = "h, other arguments at their median" if several else "h"
        yield s[:, j], self.h(s)[:, i], label

    def _maps(self, i, j):
        """Yield curves of phi over an input, for s of the data."""
        ns = self.s.shape[1]
        first = ns - self.n_inputs
        at_median = self.s.copy()
        at_median[:, first:] = np.median(self.s[:, first:], axis=0)
        order = np.argsort(self.h(at_median)[:, i], kind="stable")
        for level in LEVELS:
            s = self._moving(j, at_median[order[int(level * (len(order) - 1))]])
            phi = s[:, first + i] + self.h(s)[:, i]
            yield s[:, j], phi, f"phi, s where h is at its {level:.0%} quantile"


class ResidualNonlinearityDisplay(Display):
    """Show what g adds to the output once h is cancelled (eq. gauge).

    Left the distribution of e, right its amplitude spectrum beside that of the output,
    in the longest experiment. In continuous time e is of the law at the sampling time
    of the record, and what h does while u is held is a part of it.

    Parameters
    ----------
    e : list of ndarray of shape (N, ny)
        Output-referred residual of every experiment.
    y : list of ndarray of shape (N, ny)
        Outputs as deviations from the operating point.
    dt : float
        Sampling time, in seconds.
    output_names : list of str
        Names of the outputs.
    share : ndarray of shape (ny,) or None, default=None
        Linearization error, for the legend; None means that of `e` and `y`.

    Attributes
    ----------
    axes_ : ndarray of shape (ny, 2)
        Axes: histogram and spectrum, one row per output.
    figure_ : matplotlib.figure.Figure
        The figure.
    share_ : ndarray of shape (ny,)
        Linearization error rms(e) / std(y), which the legend shows.

    Examples
    --------
    >>> from alssnn.plotting import ResidualNonlinearityDisplay
    >>> record = alssnn.datasets.make_pendulum(600, noise=0.01, random_state=0)
    >>> model = alssnn.FlSsnn(nx=2, n_h=3, n_init=1, random_state=0)
    >>> model = model.fit(*record)
    >>> display = ResidualNonlinearityDisplay.from_estimator(model, *record)
    >>> display.figure_.savefig("residual.png")  # doctest: +SKIP
    """

    def __init__(self, e, y, dt, output_names, share=None):
        self.e, self.y, self.dt, self.output_names = e, y, dt, output_names
        self.share = share

    @classmethod
    def from_estimator(cls, model, u, y, experiment=None, *, ax=None, **kwargs):
        """Draw what g of a fitted model leaves.

        Parameters
        ----------
        model : estimator
            Fitted model.
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; where not measured, simulated ones stand in.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output; None makes a figure.
        **kwargs : dict
            Options of the spectrum of e.

        Returns
        -------
        display : ResidualNonlinearityDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If the simulation diverges, or the number of axes is wrong.
        """
        experiments, starts = scored_experiments(model, u, y, experiment)
        record = model.linearizability(u, y, experiment, in_loop=False)
        every = record.e
        if not np.isfinite(every).all():
            raise ValueError(
                "`u` must keep the simulation bounded, got a residual that diverges. "
                "Stay in the range of the training data."
            )
        lengths = [n + len(z) for n, (_, z, _) in zip(starts, experiments, strict=True)]
        parts = np.split(every, np.cumsum(lengths)[:-1])
        e = [part[n:] for part, n in zip(parts, starts, strict=True)]
        measured = [
            np.where(np.isnan(y_k), y_hat, y_k) - model.y_offset_
            for _, y_k, y_hat in experiments
        ]
        names = column_names(model)[1]
        # of all samples, as everywhere; the first ones are not drawn
        share = record.linearization_error
        return cls(e, measured, model.dt, names, share).plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw histogram and spectrum.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            Two axes per output, rows first; None makes a figure.
        **kwargs : dict
            Options of the spectrum of e.

        Returns
        -------
        display : ResidualNonlinearityDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        ny = len(self.output_names)
        axes = grid_of_axes(ax, (ny, 2), size=(5.0, 2.8))
        longest = max(range(len(self.y)), key=lambda i: len(self.y[i]))
        e, y = np.vstack(self.e), np.vstack(self.y)
        share = self.share
        if share is None:
            size = np.nanstd(y, axis=0)
            share = np.sqrt(np.mean(e**2, axis=0)) / np.where(size > 0, size, 1.0)
        self.share_ = share
        style = {"color": color(0), "linewidth": 1.4, **spelled(kwargs)}
        for i, (left, right) in enumerate(axes):
            name = self.output_names[i]
            label = f"rms(e) / std(y) = {percent(100 * share[i], 3)}"
            left.hist(e[:, i], BINS, color=style["color"], label=label)
            left.set_xlabel(f"e, in units of {name}")
            left.set_ylabel("samples")
            few_ticks(left.xaxis)
            outputs = amplitude_spectrum(self.y[longest][:, i], self.dt)
            right.loglog(*outputs, label=name, **MEASURED)
            if np.any(self.e[longest][:, i]):
                residual = amplitude_spectrum(self.e[longest][:, i], self.dt)
                right.loglog(*residual, **{"label": "e", **style})
            right.set_ylabel("amplitude, RMS per bin")
            frequency_axis(right)
            finish(left)
            finish(right)
        return self._drawn(axes)

"""Correlations of the residuals of a model, with their bands."""

from textwrap import fill

import numpy as np
from matplotlib.ticker import EngFormatter

from ..validation import column_names, judged_experiments, residual_tests
from ._axes import BAND, Display, color, finish, grid_of_axes, spelled

BESIDE, ABOVE = 28, 52  # characters of a line beside and above an axes


class ResidualDisplay(Display):
    """Show whether residuals are noise: autocorrelation, and correlation with u.

    The upper row is the autocorrelation of the residual itself: it may well leave its
    band, for noise has a color. The rows below are correlations of the *whitened*
    residual with u (eq. residuals): at lags from zero on these should stay inside. The
    titles count the lags outside the band that is drawn; the checks of ``validate``,
    which take all lags together and allow for errors of parameters, are not drawn.

    Of a model with innovations, both are those of its errors one sample ahead, which
    are not whitened: the upper row should stay in its band, too, and with u only what
    is later than u.

    Parameters
    ----------
    tests : ResidualTests
        What `validation.residual_tests` and ``model.validate`` return.

    Attributes
    ----------
    axes_ : ndarray of shape (1 + nu, ny)
        Axes, one column per output.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import ResidualDisplay
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=6, dt=record.dt).fit(*record)
    >>> display = ResidualDisplay(model.validate(*record).residuals).plot()
    >>> display.axes_.shape
    (2, 1)
    """

    def __init__(self, tests):
        self.tests = tests

    @classmethod
    def from_estimator(
        cls,
        model,
        u,
        y,
        experiment=None,
        *,
        level=0.01,
        n_lags="auto",
        ax=None,
        **kwargs,
    ):
        """Draw the correlations of the residuals of a fitted model.

        The p-values of its tests take the parameters as exact: those of
        ``model.validate`` do not.

        Parameters
        ----------
        model : estimator
            Fitted model.
        u : array_like of shape (N, nu), or list of them
            Inputs.
        y : array_like of shape (N,) or (N, ny), or list of them
            Outputs; nan where not measured.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        level : float, default=0.01
            Probability to leave the band by chance, at each lag.
        n_lags : int or "auto", default="auto"
            Number of lags; "auto" takes 25, or as many as a shorter record bears.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One plus nu axes per output; None makes a figure.
        **kwargs : dict
            Options of the stems.

        Returns
        -------
        display : ResidualDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If simulation or predictor diverge, the record is too short or an option is
            out of range.
        """
        # what is drawn does not depend on the errors of the parameters
        experiments, options = judged_experiments(model, u, y, experiment, exact=True)
        inputs, outputs = column_names(model)
        tests = residual_tests(
            experiments,
            level=level,
            n_lags=n_lags,
            dt=model.dt,
            input_names=inputs,
            output_names=outputs,
            **options,
        )
        return cls(tests).plot(ax, **kwargs)

    @classmethod
    def from_predictions(
        cls,
        u,
        y_true,
        y_pred,
        *,
        dt=1.0,
        level=0.01,
        n_lags="auto",
        input_names=None,
        output_names=None,
        ax=None,
        **kwargs,
    ):
        """Draw the correlations of the residuals of given outputs.

        Parameters
        ----------
        u : array_like of shape (N,) or (N, nu)
            Inputs.
        y_true : array_like of shape (N,) or (N, ny)
            Measured outputs; nan where not measured.
        y_pred : array_like of shape (N,) or (N, ny)
            Simulated outputs.
        dt : float, default=1.0
            Sampling time, in seconds.
        level : float, default=0.01
            Probability to leave the band by chance, at each lag.
        n_lags : int or "auto", default="auto"
            Number of lags; "auto" takes 25, or as many as a shorter record bears.
        input_names, output_names : sequence of str or None, default=None
            Names of the signals; None means u0, ... and y0, ...
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One plus nu axes per output; None makes a figure.
        **kwargs : dict
            Options of the stems.

        Returns
        -------
        display : ResidualDisplay
            The display, drawn.

        Raises
        ------
        ValueError
            If the record is too short or an option is out of range.
        """
        tests = residual_tests(
            [(u, y_true, y_pred)],
            level=level,
            n_lags=n_lags,
            dt=dt,
            input_names=input_names,
            output_names=output_names,
        )
        return cls(tests).plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw correlations against the lag.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One plus nu axes per output, rows first; None makes a figure.
        **kwargs : dict
            Options of the stems, such as ``color``.

        Returns
        -------
        display : ResidualDisplay
            Itself.

        Raises
        ------
        ValueError
            If the number of axes is wrong.
        """
        tests = self.tests
        nu, ny = len(tests.input_names), len(tests.output_names)
        axes = grid_of_axes(ax, (1 + nu, ny), size=(5.0, 2.1))
        style = {"color": color(0), "linewidth": 1.4, **spelled(kwargs)}
        percent = f"{100 * (1 - tests.level):g} %"
        noun, whitened = "residual", "whitened residual"
        if tests.ahead:
            noun = whitened = "error one sample ahead"
        for i, column in enumerate(axes.T):
            name = tests.output_names[i]
            rows = [
                (
                    tests.lags,
                    tests.autocorrelation[:, i],
                    tests.autocorrelation_band[:, i],
                    f"autocorrelation\nof the {noun} of {name}",
                    f"{noun}: ",
                ),
                *(
                    (
                        tests.cross_lags,
                        tests.cross_correlation[:, i, j],
                        tests.cross_band[:, i],
                        f"{whitened}\nof {name} with {tests.input_names[j]}",
                        f"{tests.input_names[j]}, lags from {tests.first_lag} on: ",
                    )
                    for j in range(nu)
                ),
            ]
            for one, (*curves, label, title) in zip(column, rows, strict=True):
                # where no two samples are a lag apart, nothing is known
                lags, r, band = (np.asarray(z)[curves[2] > 0] for z in curves)
                one.fill_between(
                    lags, -band, band, label=f"{percent} at each lag", **BAND
                )
                one.vlines(lags, 0.0, r, **style)
                one.plot(lags, r, ".", color=style["color"], markersize=4)
                lines = (fill(part, BESIDE) for part in label.split("\n"))
                one.set_ylabel("\n".join(lines), fontsize="small")
                counted = lags >= (tests.first_lag if one is not column[0] else 1)
                out = int(np.sum((np.abs(r) > band)[counted]))
                title += f"{out} of {counted.sum()} outside the band"
                one.set_title(fill(title, ABOVE), loc="left", fontsize="medium")
                # the band is the same everywhere, and correlations may fill it
                finish(one, legend=one is axes[0, 0])
            dt = EngFormatter(unit="s", places=None)(tests.dt)
            column[-1].set_xlabel(f"lag, samples of {dt}")
        return self._drawn(axes)

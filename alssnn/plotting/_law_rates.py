"""Linearity against the sampling time of the law."""

import numpy as np

from ._axes import Display, color, finish, grid_of_axes, plain_logs, spelled


class LawRatesDisplay(Display):
    """Show what it costs that the input is held while the law waits.

    Parameters
    ----------
    rates : LawRates
        What `model_selection.law_rates` returns.

    Attributes
    ----------
    ax_ : matplotlib.axes.Axes
        The axes.
    figure_ : matplotlib.figure.Figure
        The figure.

    Examples
    --------
    >>> from alssnn.plotting import LawRatesDisplay
    >>> record = alssnn.datasets.make_duffing(400, random_state=0)
    >>> model = alssnn.FlSsnn(
    ...     nx=2, n_h=2, alpha=0.0, tol=1e-2, time="continuous", dt=record.dt
    ... )
    >>> rates = alssnn.model_selection.law_rates(model.fit(*record), *record)
    >>> display = LawRatesDisplay.from_rates(rates)
    >>> display.figure_.savefig("rates.png")  # doctest: +SKIP
    """

    def __init__(self, rates):
        self.rates = rates

    @classmethod
    def from_rates(cls, rates, *, ax=None, **kwargs):
        """Draw what `law_rates` found.

        Parameters
        ----------
        rates : LawRates
            What `model_selection.law_rates` returns.
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the curves.

        Returns
        -------
        display : LawRatesDisplay
            The display, drawn.
        """
        return cls(rates).plot(ax, **kwargs)

    def plot(self, ax=None, **kwargs):
        """Draw both errors against the sampling time; a line marks the record's.

        Parameters
        ----------
        ax : matplotlib.axes.Axes or None, default=None
            Where to draw; None makes a figure.
        **kwargs : dict
            Options of the curves.

        Returns
        -------
        display : LawRatesDisplay
            Itself.

        Raises
        ------
        ValueError
            If every loop diverges.
        """
        rates = self.rates
        errors = {
            "law of the sample": rates.error(),
            "law that looks ahead": rates.error(ahead=True),
        }
        if not any(np.isfinite(error).any() for error in errors.values()):
            raise ValueError(
                "`rates` must have a loop whose simulation is finite, got none. "
                "Measure shorter sampling times."
            )
        ((axes,),) = grid_of_axes(ax, (1, 1), size=(6.0, 4.0))
        for i, (label, error) in enumerate(errors.items()):
            shown = np.where(np.isfinite(error), 100 * error, np.nan)
            lost = "" if np.isfinite(error).all() else ", in part without a limit"
            style = {"color": color(i), "marker": "o", "markersize": 4}
            style |= {"label": label + lost, **spelled(kwargs)}
            axes.loglog(rates.law_dt, shown, **style)
        axes.axvline(
            rates.dt, color="0.6", linewidth=0.8, label="sampling time of the record"
        )
        plain_logs(axes.xaxis)
        axes.set_xlabel("sampling time of the law, s")
        axes.set_ylabel("linearization error, %")
        finish(axes)
        return self._drawn(axes)

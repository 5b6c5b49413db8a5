"""How fast the law must run: linearity against its sampling time."""

from dataclasses import dataclass, field

import numpy as np

from ..checks import sampling_time
from ..linearizability import Linearizability, worst_error
from ..rows import data_frame

PARTS = (2.0, 1.0, 0.5, 0.25, 0.125)  # of the sampling time of the record


@dataclass(frozen=True, eq=False)
class LawRates:
    """Hold what sampling costs a law, as `law_rates` found it.

    Parameters
    ----------
    law_dt : ndarray of shape (n,)
        Sampling times of the law, in seconds, the slowest first.
    now : tuple of Linearizability
        Measures of the law that sees its own sample.
    ahead : tuple of Linearizability
        Those of the law that looks half a sample ahead (eq. middle).
    dt : float
        Sampling time of the record, in seconds.

    Examples
    --------
    >>> record = alssnn.datasets.make_duffing(400, noise=0.01, random_state=0)
    >>> model = alssnn.FlSsnn(
    ...     nx=2, n_h=2, alpha=0.0, tol=1e-2, time="continuous", dt=record.dt
    ... )
    >>> rates = alssnn.model_selection.law_rates(model.fit(*record), *record)
    >>> rates.law_dt
    array([0.8 , 0.4 , 0.2 , 0.1 , 0.05])
    >>> bool(rates.error(ahead=True)[-1] < rates.error()[-1])
    True
    """

    law_dt: np.ndarray
    now: tuple[Linearizability, ...] = field(repr=False)
    ahead: tuple[Linearizability, ...] = field(repr=False)
    dt: float

    def error(self, ahead=False):
        """Return what is left of the nonlinearity at every sampling time.

        Parameters
        ----------
        ahead : bool, default=False
            Whether the law looks ahead.

        Returns
        -------
        error : ndarray of shape (n,)
            The larger one of the linearization errors along the record and in the
            loop, of the worst output; a share of its standard deviation.
        """
        return np.array([worst_error(r) for r in (self.ahead if ahead else self.now)])

    def slowest(self, within=0.05, ahead=False):
        """Return the longest sampling time at which the loop is nearly linear.

        Parameters
        ----------
        within : float, default=0.05
            Largest `error` that is accepted, at this time and all shorter ones.
        ahead : bool, default=False
            Whether the law looks ahead.

        Returns
        -------
        law_dt : float
            Sampling time, in seconds; nan if none of those measured will do.
        """
        fails = np.flatnonzero(~(self.error(ahead) <= within))
        good = self.law_dt[fails[-1] + 1 :] if len(fails) else self.law_dt
        return float(good[0]) if len(good) else np.nan

    def __str__(self):
        """Return the errors as a table."""
        lines = [f"{'law_dt, s':>10s}{'error, %':>10s}{'looking ahead, %':>18s}"]
        for dt, now, ahead in zip(
            self.law_dt, self.error(), self.error(ahead=True), strict=True
        ):
            star = " *" if dt == self.dt else ""
            lines.append(f"{dt:10.4g}{100 * now:10.3g}{100 * ahead:18.3g}{star}")
        if np.any(self.law_dt == self.dt):
            lines.append("* the sampling time of the record")
        return "\n".join(lines)

    def to_frame(self):
        """Return the errors as a pandas DataFrame.

        Returns
        -------
        frame : pandas.DataFrame
            One row per sampling time, the columns "now" and "ahead".
        """
        columns = {"now": self.error(), "ahead": self.error(ahead=True)}
        return data_frame(columns, self.law_dt, "law_dt")


def law_rates(model, u, y, experiment=None, law_dt=None):
    """Measure what it costs that the input is held while the law waits.

    Parameters
    ----------
    model : estimator
        Model in continuous time that has a law.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    law_dt : array_like of shape (n,) or None, default=None
        Sampling times of the law, in seconds: parts or multiples of that of the
        record. None takes twice the record's to an eighth of it.

    Returns
    -------
    rates : LawRates
        Linearization errors of the law that sees its own sample, which fall with
        `law_dt`, and of one that looks half a sample ahead, which fall with its square
        (eq. middle). It prints as a table; `plotting.LawRatesDisplay` draws it.

    Raises
    ------
    ValueError
        If the model is one of discrete time or has no law, or a time is no part or
        multiple of the record's or so long that its steps could not be counted.

    Notes
    -----
    Costs eight simulations per sampling time, on as many samples as the law has.
    """
    plant = model.plant_
    if not plant.cancels:
        raise ValueError(
            f"`model` must have a law that cancels something, got {plant.name} without "
            "h. Sampling costs its linear design nothing."
        )
    if law_dt is None:
        law_dt = plant.dt * np.array(PARTS)
    times = [sampling_time(float(dt), "law_dt") for dt in np.ravel(law_dt)]
    law_dt = np.unique(times)[::-1]
    if not len(law_dt):
        raise ValueError(
            "`law_dt` must have sampling times, got none. Give one or more."
        )

    def measured(ahead):
        return tuple(
            model.linearizability(
                u, y, experiment, law_dt=float(dt), ahead=ahead, in_loop=False
            )
            for dt in law_dt
        )

    return LawRates(law_dt, measured(False), measured(True), plant.dt)

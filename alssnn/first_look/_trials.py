"""Trial fits: a small model of every family, judged by samples that it has not seen.

The first part of a stretch of the record trains

    linear   x+ = A x + B u
    h(y)     x+ = A x + B (u + h(y))
    h(x)     x+ = A x + B (u + h(x))
    AL       x+ = A x + B (u + h(x)) + g(x, u)

with few neurons and few steps; the last part tells what they are worth.  Every family
contains the one above it (h(y) is an h(x)), and the first one that is nearly as good as
the best is the one to begin with.
"""

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..estimators import AlSsnn, FlSsnn, LinearStateSpace
from ..experiments import stretch

SAMPLES = 2_000  # of all experiments, at most
HIDDEN = 0.3  # share of them that judges
SHORTEST = 60  # samples of an experiment that is split
WARM_UP = 30  # hidden samples that tell the initial state, at most a quarter
NEAR = 1.4  # hidden error over the least one: as good,
LITTLE = 0.05  # as is this share of the error of the linear model
USEFUL = 0.6  # hidden error, outputs of unit variance: above it nothing was learned
SMALL = {"n_init": 1, "max_iter": 60, "alpha": 1e-4, "random_state": 0, "n_h": 6}
FAMILIES: dict[str, tuple[type, dict, dict]] = {  # with what is asked, and is small
    "linear": (LinearStateSpace, {}, {}),
    "h(y)": (FlSsnn, {"feedback": "output"}, SMALL),
    "h(x)": (FlSsnn, {"feedback": "state"}, SMALL),
    "AL": (AlSsnn, {}, SMALL | {"n_g": 6}),
}
MONOTONE = {"feedback": "output", "input_map": "monotone"}


@dataclass(frozen=True, eq=False)
class Parts:
    """Hold a stretch of a record, and which of its samples judge.

    Parameters
    ----------
    pieces : list of tuple
        Tuples (u, y, n) of experiments; samples from n on judge.
    spread : ndarray of shape (ny,)
        Standard deviations of the outputs.
    """

    pieces: list
    spread: np.ndarray = field(repr=False)

    @classmethod
    def of(cls, records):
        """Split a stretch of a record by time.

        Parameters
        ----------
        records : Records
            Record.

        Returns
        -------
        parts : Parts
            The stretch; of experiments too short to be split, every third judges.
        """
        pieces = []
        pairs = stretch(records.pairs, SAMPLES)
        for i, (u, y) in enumerate(pairs):
            n = round((1 - HIDDEN) * len(u))
            if len(u) < SHORTEST and len(pairs) > 2:
                n = 0 if i % 3 == 2 else len(u)
            pieces.append((u, y, n))
        spread = np.nanstd(np.vstack([y for _, y in pairs]), axis=0)
        return cls(pieces, np.where(spread > 0, spread, 1.0))

    @property
    def train(self):
        """Return pairs (u, y) that train."""
        return [(u[:n], y[:n]) for u, y, n in self.pieces if n]

    @property
    def hidden(self):
        """Return pairs (u, y) that judge."""
        return [(u[n:], y[n:]) for u, y, n in self.pieces if n < len(u)]

    def error(self, pairs):
        """Return the error of outputs, relative to their standard deviations.

        Parameters
        ----------
        pairs : list of tuple of ndarray
            Measured and simulated outputs.

        Returns
        -------
        error : float
            Root mean square over outputs; infinite if a simulation diverges.
        """
        y, y_hat = (np.vstack(z) for z in zip(*pairs, strict=True))
        if not np.isfinite(y_hat).all():
            return np.inf
        return float(np.sqrt(np.nanmean(((y - y_hat) / self.spread) ** 2)))


@dataclass(frozen=True, eq=False)
class Trial:
    """Hold a trial fit.

    Parameters
    ----------
    name : str
        Family.
    error : float
        Error on hidden samples, relative to the standard deviation of the output.
    options : dict
        What makes the estimator this family.
    model : estimator
        The fitted model, of the class of the family.
    """

    name: str
    error: float
    options: dict
    model: Any = field(repr=False)


def with_options(options):
    """Return the families of networks that have options.

    Parameters
    ----------
    options : dict
        Options of estimators.

    Returns
    -------
    names : list of str
        Families, simplest first.
    """
    return [
        name
        for name, (cls, _, small) in FAMILIES.items()
        if small and set(options) <= set(cls().get_params())
    ]


def trial(parts, name, orders=None, **options):
    """Fit small models of a family and judge them.

    Parameters
    ----------
    parts : Parts
        Samples.
    name : str
        Family.
    orders : sequence of int or None, default=None
        Numbers of states of models with networks; a linear one chooses its own.
    **options : dict
        Further options of the estimator.

    Returns
    -------
    trial : Trial
        The best of the fits and its error.
    """
    cls, asked, small = FAMILIES[name]
    asked = asked | options
    u, y = map(list, zip(*parts.train, strict=True))
    fits = []
    for nx in orders or ["auto"]:
        model = cls(nx=nx, **(small | asked), n_init_samples=WARM_UP)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that it stops early is meant
            model.fit(u, y)
        pairs = [model.simulate_test(u, y) for u, y in parts.hidden]
        fits.append(Trial(name, parts.error(pairs), asked, model))
    return min(fits, key=lambda fit: fit.error)

"""A tube of the plant around the model, and a bound of the model around its design."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ._units import units_in_words

# What a bound rests on, by its source.
WHILE = {
    "data": " while |g| stays as on its data",
    "given": " while |g| stays within the number that was given",
    # the verdict of a certificate of every bounded input
    "holds": " while v stays within the amplitude of the certificate, from rest",
}


@dataclass(frozen=True, eq=False, repr=False)
class TubeWithBound:
    """Hold a tube of the plant around the linear design.

    Parameters
    ----------
    tube : Tube
        Of the plant around the model.
    bound : ndarray of shape (ny,)
        On ``|y_model - y_lin|``, in the units of y.
    source : str
        What the bound rests on; empty if it is a number.
    """

    tube: Any
    bound: np.ndarray
    source: str

    @property
    def statement(self):
        """Return what is true of the plant, in words."""
        level, units = self.tube.level, units_in_words(self.tube.block)
        is_alone = len(self.bound) > 1 and not self.tube.joint
        alone = ", of each output alone," if is_alone else ","
        return (
            f"With {level:.4g} of future {units} like those of the calibration{alone} "
            "|y_plant - y_lin| is at most the half width of the tube plus "
            f"{plain(self.bound)}{WHILE.get(self.source, '')}.\n"
            "y_lin is the linear design with the v for which the model, simulated "
            "without feedback from the plant, applies this u.\n"
            "Inputs that a law or a controller makes on the plant are others than "
            "those of the calibration: of them the tube says nothing until it is "
            "calibrated on records of that loop."
        )

    def half_width(self, u, y=None, experiment=None, *, x0=None):
        """Return the half width around y_lin at every sample.

        Parameters
        ----------
        u : array_like of shape (N, nu), or list of them
            Inputs of the plant.
        y : array_like of shape (N,) or (N, ny), or None, default=None
            Measured outputs, see `Tube.around`.
        experiment : array_like of shape (N,) or None, default=None
            Label of the experiment of every sample.
        x0 : array_like of shape (nx,) or (n_experiments, nx), or None, default=None
            Initial states, see `Tube.around`.

        Returns
        -------
        half_width : ndarray of shape (N,) or (N, ny)
            In the units of y.

        Raises
        ------
        ValueError
            As `Tube.around`.
        """
        width = self.tube.half_width(u, y, experiment, x0=x0)
        return width + (self.bound if width.ndim == 2 else self.bound[0])

    def __repr__(self):
        """Return the statement, or why there is none."""
        if not (self.tube.finite and np.isfinite(self.bound).all()):
            why = self.tube.reason or "The bound is infinite."
            return f"TubeWithBound: infinite. {why}"
        return "TubeWithBound: " + self.statement.replace("\n", "\n  ")


def plain(values):
    """Return a number as text, or a list of different ones.

    Parameters
    ----------
    values : array_like
        Numbers.

    Returns
    -------
    text : str
        Four digits of every one.
    """
    texts = [f"{value:.4g}" for value in np.ravel(values)]
    return texts[0] if len(set(texts)) == 1 else f"[{', '.join(texts)}]"


def in_words(gain):
    """Return a matrix of gains as text, row by row.

    Parameters
    ----------
    gain : ndarray of shape (ny, nv)
        Gains from every input to every output.

    Returns
    -------
    text : str
        A number if there is one, else a list for every output.
    """
    rows = ["[" + ", ".join(f"{value:.4g}" for value in row) + "]" for row in gain]
    return f"{gain[0, 0]:.4g}" if gain.size == 1 else f"[{', '.join(rows)}]"

"""Where a model was trained.

A network says nothing outside the data it has seen.  A sample (x, u) is *inside* if

    u, y = C x and, where there is one, the measured y lie in the box that inputs and
    outputs spanned in training, and
    x lies in the ellipsoid  |W' (x - center)| <= radius  of the training states,

W W' being the inverse of their covariance (up to a factor) and `radius` the largest
value in training.  Neither depends on the basis of the states.  Both are a little
enlarged, for the initial states of the same data are not always estimated alike.

The measured y counts because a model that is out of its depth may stay inside while its
plant leaves: simulated in free run, it does not see what happens.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

MARGIN = 0.01  # enlargement of the box and the ellipsoid, relative to their width
RANK_TOL = 1e-10  # directions of x with less spread than that were not excited


@dataclass(frozen=True, eq=False)
class Region:
    """Hold the region that the training data cover.

    Parameters
    ----------
    low, high : ndarray of shape (nu + ny,)
        Box of [u; y], deviations in the user's units.
    center : ndarray of shape (nx,)
        Mean state.
    whiten : ndarray of shape (nx, n_excited)
        Map from deviations of the state to coordinates of equal variance.
    radius : float
        Largest norm in these coordinates.
    """

    low: np.ndarray
    high: np.ndarray
    center: np.ndarray
    whiten: np.ndarray
    radius: float

    @classmethod
    def of(cls, X, u, y, measured=None):
        """Return the region of training trajectories.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            Simulated states.
        u : ndarray of shape (N, nu)
            Inputs.
        y : ndarray of shape (N, ny)
            Simulated outputs.
        measured : ndarray of shape (N, ny) or None, default=None
            Measured outputs; None if there are none.

        Returns
        -------
        region : Region
            The region, enlarged by `MARGIN`.
        """
        chunk = X, u, y, y if measured is None else measured
        return cls.of_parts(lambda function: [function([chunk])])

    @classmethod
    def of_parts(cls, each):
        """Return the region of training trajectories that are made chunk by chunk.

        Parameters
        ----------
        each : callable
            ``each(function)`` returns a list of ``function(chunks)``, one per
            experiment, with an iterable of tuples (X, u, y, measured) as `of` takes
            them. It is called twice: nothing is kept of a chunk.

        Returns
        -------
        region : Region
            The region, enlarged by `MARGIN`.
        """
        lows, highs, triangles = zip(*each(_extent), strict=True)
        low, high = np.min(lows, axis=0), np.max(highs, axis=0)
        R = np.asarray(np.linalg.qr(np.vstack(triangles), mode="r"))
        # R'R sums [1, X]'[1, X]: its first row has the mean, the others what is left
        center = R[0, 1:] / R[0, 0]
        _, spread, Vt = np.linalg.svd(R[1:, 1:], full_matrices=False)
        excited = spread > RANK_TOL * spread.max(initial=0.0)
        whiten = Vt[excited].T / spread[excited]
        radius = np.max(each(partial(_farthest, center=center, whiten=whiten)))
        slack = MARGIN * (high - low)
        return cls(low - slack, high + slack, center, whiten, (1 + MARGIN) * radius)

    @property
    def seen(self):
        """Return the box of [u; y] as it was in training, not enlarged."""
        slack = MARGIN / (1 + 2 * MARGIN) * (self.high - self.low)
        return self.low + slack, self.high - slack

    def outside(self, X, u, y, measured=None):
        """Return which samples lie outside.

        Parameters
        ----------
        X : ndarray of shape (N, nx)
            States.
        u : ndarray of shape (N, nu)
            Inputs of the plant.
        y : ndarray of shape (N, ny)
            Outputs of the model.
        measured : ndarray of shape (N, ny) or None, default=None
            Measured outputs; None if there are none, as in a loop that was not run.

        Returns
        -------
        outside : ndarray of bool, shape (N,)
            Whether a sample is outside; a diverged one is.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            distance = np.linalg.norm((X - self.center) @ self.whiten, axis=1)
        inside = (distance <= self.radius) & np.isfinite(X).all(axis=1)
        for outputs in (y,) if measured is None else (y, measured):
            uy = np.hstack([u, outputs])
            # nan compares false
            inside &= np.all((uy >= self.low) & (uy <= self.high), axis=1)
        return ~inside


def _extent(chunks):
    """Return the box of [u; y] and a triangle R, where R'R sums [1, X]'[1, X]."""
    low, high, R = np.array(np.inf), np.array(-np.inf), np.empty((0, 0))
    for X, u, y, measured in chunks:
        outputs = np.vstack([y, measured])
        low = np.minimum(low, np.hstack([u.min(axis=0), outputs.min(axis=0)]))
        high = np.maximum(high, np.hstack([u.max(axis=0), outputs.max(axis=0)]))
        rows = np.hstack([np.ones((len(X), 1)), X])
        rows = np.vstack([R, rows]) if R.size else rows
        R = np.asarray(np.linalg.qr(rows, mode="r"))
    return low, high, R


def _farthest(chunks, center, whiten):
    """Return the largest whitened distance from the center."""
    return max(np.linalg.norm((X - center) @ whiten, axis=1).max() for X, *_ in chunks)

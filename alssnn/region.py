"""Where a model was trained.

A network says nothing outside the data it has seen.  A sample (x, u) is *inside* if

    u, y = C x and, where there is one, the measured y lie in the box that inputs and
    outputs spanned in training, and
    z = [x; u] lies in the ellipsoid  |W' (z - center)| <= radius  of the training data,

W W' being the inverse of their covariance (up to a factor) and `radius` the largest
value in training.  x and u count together: where a controller made u from x, a sample
beside that law is new, though x and u were both seen.  A combination of x and u that
hardly varied has at least the spread `LEAST` beside those of x and u, and directions
of x that never varied say nothing.  Neither box nor ellipsoid depends on the basis of
the states.  Both are a little enlarged, for the initial states of the same data are not
always estimated alike.

The largest value of a record is a matter of chance: of n independent samples of a fresh
record of the same kind, 2 / n leave the range of one signal, and with four signals and
an ellipsoid it is soon more than a percent.  To be a little beyond is not to
extrapolate.  So a sample is only called outside where it is beyond box or ellipsoid by
the share `BEYOND` of the width or the radius.

The measured y counts because a model that is out of its depth may stay inside while its
plant leaves: simulated in free run, it does not see what happens.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import block_diag

MARGIN = 0.01  # enlargement of the box and the ellipsoid, relative to their width
BEYOND = 0.1  # distance that counts as outside, relative to width and radius
RANK_TOL = 1e-10  # directions of x with less spread than that were not excited
LEAST = 0.01  # spread of a combination of x and u, each of spread one, that counts


@dataclass(frozen=True, eq=False)
class Region:
    """Hold the region that the training data cover.

    Parameters
    ----------
    low, high : ndarray of shape (nu + ny,)
        Box of [u; y], deviations in the user's units.
    center : ndarray of shape (nx + nu,)
        Mean of [x; u]; of x alone in models that older versions saved.
    whiten : ndarray of shape (nx + nu, n_excited)
        Map from deviations of [x; u], or of x, to coordinates of equal variance.
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
        lows, highs, triangles, (ny, *_) = zip(*each(_extent), strict=True)
        low, high = np.min(lows, axis=0), np.max(highs, axis=0)
        R = np.asarray(np.linalg.qr(np.vstack(triangles), mode="r"))
        # R'R sums [1, X, u]'[1, X, u]: its first row has the mean, the rest the spread
        center, rest = R[0, 1:] / R[0, 0], R[1:, 1:]
        nx = len(center) - (len(low) - ny)
        # x and u one by one, then together: of spread one each, in any basis
        each_alone = block_diag(_whitening(rest[:, :nx]), _whitening(rest[:, nx:]))
        _, spread, Vt = np.linalg.svd(rest @ each_alone, full_matrices=False)
        whiten = each_alone @ Vt.T / np.maximum(spread, LEAST)
        radius = np.max(each(partial(_farthest, center=center, whiten=whiten)))
        slack = MARGIN * (high - low)
        return cls(low - slack, high + slack, center, whiten, (1 + MARGIN) * radius)

    @property
    def seen(self):
        """Return the box of [u; y] as it was in training, not enlarged."""
        slack = MARGIN / (1 + 2 * MARGIN) * (self.high - self.low)
        return self.low + slack, self.high - slack

    def outside(self, X, u, y, measured=None):
        """Return which samples lie clearly outside, by more than `BEYOND`.

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
            z = np.hstack([X, u])[:, : len(self.center)]
            distance = np.linalg.norm((z - self.center) @ self.whiten, axis=1)
        inside = distance <= (1 + BEYOND) * self.radius
        inside &= np.isfinite(X).all(axis=1)
        slack = BEYOND * (self.high - self.low)
        for outputs in (y,) if measured is None else (y, measured):
            uy = np.hstack([u, outputs])
            # nan compares false
            inside &= np.all(
                (uy >= self.low - slack) & (uy <= self.high + slack), axis=1
            )
        return ~inside


def _whitening(R):
    """Return the map from deviations of which R'R is the sum to those of spread one."""
    _, spread, Vt = np.linalg.svd(R, full_matrices=False)
    excited = spread > RANK_TOL * spread.max(initial=0.0)
    return Vt[excited].T / spread[excited]


def _extent(chunks):
    """Return the box of [u; y], a triangle R of [1, X, u], and the number of y."""
    low, high, R, ny = np.array(np.inf), np.array(-np.inf), np.empty((0, 0)), 0
    for X, u, y, measured in chunks:
        outputs = np.vstack([y, measured])
        low = np.minimum(low, np.hstack([u.min(axis=0), outputs.min(axis=0)]))
        high = np.maximum(high, np.hstack([u.max(axis=0), outputs.max(axis=0)]))
        rows, ny = np.hstack([np.ones((len(X), 1)), X, u]), y.shape[1]
        rows = np.vstack([R, rows]) if R.size else rows
        R = np.asarray(np.linalg.qr(rows, mode="r"))
    return low, high, R, ny


def _farthest(chunks, center, whiten):
    """Return the largest whitened distance from the center."""
    return max(
        np.linalg.norm((np.hstack([X, u]) - center) @ whiten, axis=1).max()
        for X, u, *_ in chunks
    )

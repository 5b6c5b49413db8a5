"""Where a model was trained.

A network says nothing outside the data it has seen.  A sample (x, u) is *inside* if

    u, y = C x and, where there is one, the measured y lie in the box that inputs and
    outputs spanned in training, and
    z = [x; u] lies in the ellipsoid  |W' (z - center)| <= radius  of the training data,
    and the nearest of up to `REFERENCES` training samples is within `reach` of W' z,

W W' being the inverse of their covariance (up to a factor) and `radius` the largest
value in training.  x and u count together: where a controller made u from x, a sample
beside that law is new, though x and u were both seen.  A combination of x and u that
hardly varied has at least the spread `LEAST` beside those of x and u, and directions
of x that never varied say nothing.  Neither box nor ellipsoid depends on the basis of
the states.  Both are a little enlarged, for the initial states of the same data are not
always estimated alike.

Box and ellipsoid are convex: of data on a limit cycle, or at two levels, they have the
middle, which nobody saw.  The nearest sample tells.  How near is near the record says
itself: a tenth of it is left out, and its distances to the rest are what a fresh record
of the same kind would have.  Tenths in time, because a neighbour in time is near
whatever happens, and of every period where the input has one, for its copies are.

The largest value of a record is a matter of chance: of n independent samples of a fresh
record of the same kind, 2 / n leave the range of one signal, and with four signals and
an ellipsoid it is soon more than a percent.  To be a little beyond is not to
extrapolate.  So a sample is only called outside where it is beyond box or ellipsoid by
the share `BEYOND` of the width or the radius.  A short record of a slow signal has few
independent samples, n, as its autocorrelation tells: with a new level every 50 samples,
250 samples are five.  Two such records do not cover the same region, and what is
*surely* outside is beyond by about DOUBT / n more.

The measured y counts because a model that is out of its depth may stay inside while its
plant leaves: simulated in free run, it does not see what happens.
"""

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import block_diag
from scipy.spatial import cKDTree

from .shown import short_repr

MARGIN = 0.01  # enlargement of the box and the ellipsoid, relative to their width
BEYOND = 0.1  # distance that counts as outside, relative to width and radius
RANK_TOL = 1e-10  # directions of x with less spread than that were not excited
LEAST = 0.01  # spread of a combination of x and u, each of spread one, that counts; so
# much is near, too
REFERENCES = 1_000  # training samples that are kept
DIVERGED = 1e100  # size of a sample whose square is no number, or soon none
LEAST_REFERENCES = 50  # fewer do not tell how near is near
TENTHS = 10  # parts of a record, of which each is judged by the others
NEAR = 1.5  # reach over the distance that SHARE of the parts left out do not exceed
SHARE = 0.99
DOUBT = 4.0  # over the number of independent samples: how far a fresh record may be off
FEW = 5  # independent samples that say nothing on the others
PERIODIC = 0.9  # correlation of an input with itself from which it repeats itself
FORGOTTEN = 0.5  # correlation below which it has become another before
LONGEST = 100_000  # samples of an experiment in which a period is looked for
GOLDEN = 0.5 * (5**0.5 - 1)  # its multiples have no common period with any signal


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
        Map from deviations of [x; u], or of x, to coordinates of equal variance, of
        variance one except in models that older versions saved.
    radius : float
        Largest norm in these coordinates.
    points : ndarray of shape (n_points, n_excited), default=none
        Training samples in these coordinates, at most `REFERENCES` of them; none in
        models that older versions saved, and of short records.
    reach : float, default=0.0
        Distance to the nearest of them up to which a sample is near the data.
    doubt : float, default=0.0
        Share of width, radius and reach by which a fresh record of the same kind may
        be beyond all of them, for want of independent samples.
    """

    __repr__ = short_repr

    low: np.ndarray
    high: np.ndarray
    center: np.ndarray
    whiten: np.ndarray
    radius: float
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    reach: float = 0.0
    doubt: float = 0.0

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
            them. It is called twice: of a chunk, some samples are kept.

        Returns
        -------
        region : Region
            The region, enlarged by `MARGIN`.
        """
        extents = each(_extent)
        lows, highs, triangles, (ny, *_), sizes, periods = zip(*extents, strict=True)
        low, high = np.min(lows, axis=0), np.max(highs, axis=0)
        R = np.asarray(np.linalg.qr(np.vstack(triangles), mode="r"))
        # R'R sums [1, X, u]'[1, X, u]: its first row has the mean, the rest the spread
        center, rest = R[0, 1:] / R[0, 0], R[1:, 1:] / R[0, 0]
        nx = len(center) - (len(low) - ny)
        # x and u one by one, then together: of spread one each, in any basis
        each_alone = block_diag(_whitening(rest[:, :nx]), _whitening(rest[:, nx:]))
        _, spread, Vt = np.linalg.svd(rest @ each_alone, full_matrices=False)
        whiten = each_alone @ Vt.T / np.maximum(spread, LEAST)
        step = -(-sum(sizes) // REFERENCES)
        visits = each(partial(_visit, center=center, whiten=whiten, step=step))
        farthest, times, points = zip(*visits, strict=True)
        tenths = [
            # of many short experiments, a tenth of the experiments
            TENTHS * (t % period) // period
            if len(t) >= TENTHS
            else np.full(len(t), i % TENTHS)
            for i, (t, period) in enumerate(zip(times, periods, strict=True))
        ]
        # a period counts once
        independent = sum(
            independent_samples(P) * period / max(n, 1)
            for P, n, period in zip(points, sizes, periods, strict=True)
        )
        doubt = DOUBT / max(independent - FEW, 1.0)
        kept, reach = _near(np.vstack(points), np.concatenate(tenths))
        slack = MARGIN * (high - low)
        return cls(
            low - slack,
            high + slack,
            center,
            whiten,
            (1 + MARGIN) * np.max(farthest),
            kept,
            (1 + doubt) * reach,
            doubt,
        )

    @property
    def seen(self):
        """Return the box of [u; y] as it was in training, not enlarged."""
        slack = MARGIN / (1 + 2 * MARGIN) * (self.high - self.low)
        return self.low + slack, self.high - slack

    def outside(self, X, u, y, measured=None, surely=False):
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
        surely : bool, default=False
            Whether only what is beyond by `doubt` more counts, which a fresh record of
            the same kind hardly has, however short the training was.

        Returns
        -------
        outside : ndarray of bool, shape (N,)
            Whether a sample is outside; a diverged one is.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            z = np.hstack([X, u])[:, : len(self.center)]
            distance = np.linalg.norm((z - self.center) @ self.whiten, axis=1)
        doubt = self.doubt if surely else 0.0
        inside = distance <= (1 + BEYOND + doubt) * self.radius
        inside &= np.isfinite(X).all(axis=1)
        slack = (BEYOND + doubt) * (self.high - self.low)
        for outputs in (y,) if measured is None else (y, measured):
            uy = np.hstack([u, outputs])
            # nan compares false
            inside &= np.all(
                (uy >= self.low - slack) & (uy <= self.high + slack), axis=1
            )
        if len(self.points):
            z = (z[inside] - self.center) @ self.whiten
            reach = (1 + doubt) * self.reach
            nearest, _ = cKDTree(self.points).query(z, distance_upper_bound=reach)
            inside[inside] = np.isfinite(nearest)
        return ~inside


def _whitening(R):
    """Return the map from deviations of which R'R is the sum to those of spread one."""
    _, spread, Vt = np.linalg.svd(R, full_matrices=False)
    excited = spread > RANK_TOL * spread.max(initial=0.0)
    return Vt[excited].T / spread[excited]


def _extent(chunks):
    """Return the extent of an experiment.

    That is the box of [u; y], a triangle R of [1, X, u], and the number of y, the
    number of samples and the period of u.
    """
    low, high, R, ny = np.array(np.inf), np.array(-np.inf), np.empty((0, 0)), 0
    n, inputs = 0, []
    for chunk in chunks:
        X, u, y, measured = _seen(chunk)
        uy = np.vstack([np.hstack([u, outputs]) for outputs in (y, measured)])
        low = np.minimum(low, uy.min(axis=0, initial=np.inf))
        high = np.maximum(high, uy.max(axis=0, initial=-np.inf))
        rows, ny = np.hstack([np.ones((len(X), 1)), X, u]), y.shape[1]
        rows = np.vstack([R, rows]) if R.size else rows
        R = np.asarray(np.linalg.qr(rows, mode="r"))
        if n < LONGEST:
            inputs.append(u[: LONGEST - n])
        n += len(u)
    return low, high, R, ny, n, _period(np.vstack(inputs)) or n


def _seen(chunk):
    """Return the samples of a chunk that are numbers.

    An experiment whose outputs were not measured has no part in the fit, and a linear
    model that is not stable may diverge along it.
    """
    size = np.max(np.abs(np.hstack(chunk)), axis=1)
    seen = size < DIVERGED  # nan compares false
    return chunk if seen.all() else tuple(z[seen] for z in chunk)


def _visit(chunks, center, whiten, step):
    """Return the largest whitened norm of an experiment and one sample of every step.

    Where in its step a sample is taken changes, so that samples of a periodic signal
    are not all of one phase.

    Parameters
    ----------
    chunks : iterable of tuple of ndarray
        Tuples (X, u, y, measured).
    center : ndarray of shape (nx + nu,)
        Mean of [x; u].
    whiten : ndarray of shape (nx + nu, n_excited)
        Map to coordinates of equal variance.
    step : int
        Number of samples of which one is taken.

    Returns
    -------
    farthest : float
        Largest norm.
    times : ndarray of shape (n_points,)
        Samples that were taken.
    points : ndarray of shape (n_points, n_excited)
        Their coordinates.
    """
    farthest, start = 0.0, 0
    times, points = [np.empty(0, dtype=int)], [np.empty((0, whiten.shape[1]))]
    for chunk in chunks:
        X, u, *_ = _seen(chunk)
        z = (np.hstack([X, u]) - center) @ whiten
        farthest = max(farthest, np.linalg.norm(z, axis=1).max(initial=0.0))
        j = np.arange(start // step, (start + len(z)) // step + 1)
        taken = (step * (j + j * GOLDEN % 1)).astype(int)
        taken = taken[(taken >= start) & (taken < start + len(z))]
        times.append(taken)
        points.append(z[taken - start])
        start += len(z)
    return farthest, np.concatenate(times), np.vstack(points)


def _correlation(z):
    """Return the autocorrelation of every column at lags from 0 on, not normalized."""
    n = next_fast_len(2 * len(z), real=True)
    return irfft(np.abs(rfft(z - z.mean(axis=0), n, axis=0)) ** 2, n, axis=0)[: len(z)]


def _period(u):
    """Return after how many samples the inputs repeat themselves, 0 if they do not."""
    n = len(u)
    if n < 2:
        return 0
    r = _correlation(u)
    moves = r[0] > 0
    if not moves.any():
        return 0
    r = (r[:, moves] / r[0, moves]).mean(axis=1) * n / np.arange(n, 0, -1)
    r = r[: 3 * n // 4]  # of less than a quarter, no correlation is one
    other = np.flatnonzero(r < FORGOTTEN)
    if not len(other):
        return 0
    again = other[0] + np.flatnonzero(r[other[0] :] >= PERIODIC)
    if not len(again):
        return 0
    # the first run of lags that are all alike, and the best of them
    run = again[again - again[0] == np.arange(len(again))]
    return int(run[np.argmax(r[run])])


def independent_samples(points):
    """Return how many samples of a series are as good as independent ones.

    Their number over the sum of the autocorrelation to its first zero, that of the
    coordinate where this is least.

    Parameters
    ----------
    points : ndarray of shape (N, n)
        Series, finite.

    Returns
    -------
    count : float
        At most N.
    """
    n = len(points)
    if n < 2:
        return float(n)
    r = _correlation(points)
    counts = [float(n)]
    for column in r.T[r[0] > 0]:
        zeros = np.flatnonzero(column <= 0)
        until = zeros[0] if len(zeros) else n
        counts.append(n / (1 + 2 * column[1:until].sum() / column[0]))
    return min(counts)


def _near(points, tenths):
    """Return the training samples to keep, and how near to them is near."""
    finite = np.isfinite(points).all(axis=1)
    points, tenths = points[finite], tenths[finite]
    if len(points) > REFERENCES:  # many short experiments, one at least of each
        taken = np.linspace(0, len(points) - 1, REFERENCES).astype(int)
        points, tenths = points[taken], tenths[taken]
    none = np.empty((0, points.shape[1])), 0.0
    if len(points) < LEAST_REFERENCES or not points.shape[1]:
        return none
    distances = np.zeros(len(points))
    for tenth in range(TENTHS):
        own = tenths == tenth
        if own.all():
            return none
        distances[own], _ = cKDTree(points[~own]).query(points[own])
    return points, max(NEAR * float(np.quantile(distances, SHARE)), LEAST)

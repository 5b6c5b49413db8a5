"""What a network adds to a linear map over a region, by subdivision (eq. cells).

A region is a box of [x; r], less what lies outside given strips, cut into cells.
Over a cell every neuron is a line, sigma(nu) = s nu + m + delta with |delta| <= d
(`lines`), layer by layer, so that a row of the network is affine plus the sum of what
the deltas may add: an interval that holds for the whole cell.  Cells whose interval is
well beyond what samples of the region show are cut in two, until none is left or the
budget is spent; the bound holds in either case.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ..forms import part
from ..lure import Lure
from ..simulation import regressors
from ._lines import lines
from ._neurons import differences, reaching, renumbered, seen_at

FIRST = 500  # cells of the first grid, about
CHUNK = 4_000  # cells that are evaluated at once
BUDGET = 40_000  # cells in all
TOLERANCE = 0.03  # excess over the samples, relative to their range, that is left


@dataclass(frozen=True, eq=False)
class Network:
    """Hold the part of a Lur'e form that reaches x+ and y, in scaled coordinates.

    With z = [x; r] and w = sigma(V z + E w + b) it is q = [x+; y] = M z + W w + c.

    Parameters
    ----------
    lure : Lure
        The form, with the channels y and no neuron that reaches nothing.
    twins : tuple of int, default=()
        Neurons that are differences, w = sigma(nu + nu_j) - sigma(nu_j), by the
        number j; -1 for plain ones. Empty without differences.
    live : ndarray of int or None, default=None
        Numbers of the neurons in the whole form.
    rest : ndarray of shape (nw,) or None, default=None
        What the neurons see at the origin, where some of them are solved together.
    """

    lure: Lure
    twins: tuple = ()
    live: np.ndarray | None = None
    rest: np.ndarray | None = None

    @classmethod
    def of(cls, lure, ny, T, units, scale, twins=()):
        """Return the network of a form whose first channels are y.

        Parameters
        ----------
        lure : Lure
            Form of a loop.
        ny : int
            Number of outputs, its first channels.
        T : ndarray of shape (nx, nx)
            Basis: the states are T x.
        units : ndarray of shape (nu,)
            Inputs of modulus one.
        scale : ndarray of shape (ny,)
            Outputs of modulus one.
        twins : sequence of int, default=()
            For every neuron another one of equal weights at another point, to which
            its difference is taken; -1 for none.

        Returns
        -------
        network : Network
            The network.
        """
        nx, nu, twins = lure.nx, lure.nu, np.asarray(twins, dtype=int)
        Theta = differences(lure, twins).Theta
        Theta[:, :nx] = Theta[:, :nx] @ T
        Theta[:, nx : nx + nu] *= units
        Theta[:nx] = np.linalg.solve(T, Theta[:nx])
        Theta[nx : nx + ny] /= scale[:, None]
        scaled = replace(lure, Theta=Theta)
        live = reaching(scaled, ny, twins)
        rest = seen_at(lure, np.zeros(nx), twins)[live]
        others = tuple(renumbered(twins, live)) if np.any(twins >= 0) else ()
        return cls(part(scaled, live, ny), others, live, rest)

    def values(self, z):
        """Return q at points z.

        Parameters
        ----------
        z : ndarray of shape (n, nx + nu)
            Points.

        Returns
        -------
        q : ndarray of shape (n, nx + ny)
            Values.
        """
        Phi = regressors(self.lure, *np.split(z, [self.lure.nx], axis=1))
        return Phi @ self.lure.Theta[: self.lure.nx + self.lure.nz].T

    def over(self, centers, halves, low, high, pieces=2):
        """Return every neuron as a line over cells, and whether a cell is possible.

        Parameters
        ----------
        centers, halves : ndarray of shape (n, nx + nu)
            Cells.
        low, high : ndarray of shape (nw,)
            Range that each neuron sees in the region.
        pieces : int, default=2
            Pieces of an interval, see `lines`.

        Returns
        -------
        s, m, d : ndarray of shape (n, nw)
            Slopes, offsets, largest remainders.
        possible : ndarray of bool, shape (n,)
            Cells that may have points within low and high.
        """
        lure, n = self.lure, len(centers)
        s, m, d = np.zeros((3, n, lure.nw))
        possible = np.ones(n, dtype=bool)
        for layer in lure.layers:
            E = lure.E[layer]
            if np.any(E):
                middle, radius = self.affine(
                    E, lure.V[layer], lure.b[layer], (s, m, d), centers, halves
                )[:2]
            else:
                middle = centers @ lure.V[layer].T + lure.b[layer]
                radius = halves @ np.abs(lure.V[layer]).T
            a = np.maximum(middle - radius, low[layer])
            b = np.minimum(middle + radius, high[layer])
            possible &= ~np.any(a > b, axis=1)  # what is not known is possible
            line = lines(lure.sigma[layer.start], a, np.maximum(a, b), pieces)
            s[:, layer], m[:, layer], d[:, layer] = line
        return s, m, d, possible

    def affine(self, rows, by_z, constant, line, centers, halves):
        """Return rows @ w + by_z z + constant over cells, as middle and radius.

        Parameters
        ----------
        rows : ndarray of shape (k, nw)
            Weights of the neurons.
        by_z : ndarray of shape (k, nx + nu)
            Weights of the point.
        constant : ndarray of shape (k,)
            Constant.
        line : tuple of ndarray of shape (n, nw)
            Slopes, offsets and largest remainders of the neurons over the cells.
        centers, halves : ndarray of shape (n, nx + nu)
            Cells.

        Returns
        -------
        middle, radius : ndarray of shape (n, k)
            Interval of every cell.
        curved : ndarray of shape (n, k, nw)
            What the remainder of every neuron contributes to the radius.
        """
        lure, (s, m, d) = self.lure, line
        L = np.broadcast_to(rows, (len(s), *rows.shape)).copy()
        for layer in reversed(lure.layers):
            E = lure.E[layer]
            if np.any(E):
                L += np.matmul(L[:, :, layer] * s[:, None, layer], E)
        by_z = by_z + np.matmul(L * s[:, None], lure.V)
        middle = np.matmul(L, (m + s * lure.b)[..., None])[..., 0] + constant
        middle += np.matmul(by_z, centers[..., None])[..., 0]
        curved = np.abs(L) * d[:, None]
        radius = np.matmul(np.abs(by_z), halves[..., None])[..., 0] + curved.sum(-1)
        return middle, radius, curved


@dataclass(frozen=True, eq=False)
class Strips:
    """Hold a region: a box of [x; r] less what lies outside of strips.

    Parameters
    ----------
    box : ndarray of shape (2, nx + nu)
        Lower and upper ends.
    rows : ndarray of shape (k, nx)
        Directions of the states.
    low, high : ndarray of shape (k,)
        Range of ``rows @ x``.
    seen : ndarray of shape (2, nw)
        Range of what each neuron sees; infinite where nothing is known.
    """

    box: np.ndarray
    rows: np.ndarray
    low: np.ndarray
    high: np.ndarray
    seen: np.ndarray

    def samples(self, n, rng):
        """Return points of the region, many of them on faces of the box.

        Parameters
        ----------
        n : int
            Points that are drawn; those outside of strips are left out.
        rng : Generator
            Source of them.

        Returns
        -------
        z : ndarray of shape (n_inside, nx + nu)
            The points.
        """
        low, high = self.box
        z = rng.uniform(low, high, (n, len(low)))
        face = np.where(rng.random(z.shape) < 0.5, low, high)
        z = np.where(rng.random(z.shape) < 0.3, face, z)
        along = z[:, : self.rows.shape[1]] @ self.rows.T
        inside = np.all((along >= self.low) & (along <= self.high), axis=1)
        return z[inside] if inside.sum() > n // 20 else z

    def possible(self, centers, halves):
        """Return which cells may have points of the region.

        Parameters
        ----------
        centers, halves : ndarray of shape (n, nx + nu)
            Cells.

        Returns
        -------
        possible : ndarray of bool, shape (n,)
            Those that no strip excludes.
        """
        nx = self.rows.shape[1]
        middle = centers[:, :nx] @ self.rows.T
        radius = halves[:, :nx] @ np.abs(self.rows).T
        beyond = (middle - radius > self.high) | (middle + radius < self.low)
        return ~beyond.any(axis=1)


def remainder(network, region, rows, fit, samples, budget=BUDGET):
    """Bound rows @ (q - fit) over a region (eq. cells).

    Parameters
    ----------
    network : Network
        What q = [x+; y] is.
    region : Strips
        Region of z = [x; r].
    rows : ndarray of shape (k, nx + ny)
        Rows that are bounded.
    fit : ndarray of shape (nx + ny, nx + nu + 1)
        Affine map that is taken away.
    samples : ndarray of shape (n, k)
        Values at points of the region, which tell what is worth refining.
    budget : int, default=40_000
        Cells that are evaluated.

    Returns
    -------
    low, high : ndarray of shape (k,)
        Bounds that hold over the whole region.
    """
    lure, (lower, upper) = network.lure, region.box
    W, by_z = rows @ lure.W, rows @ (lure.M - fit[:, :-1])
    constant = rows @ (lure.c - fit[:, -1])
    least, largest = samples.min(axis=0), samples.max(axis=0)
    excess = TOLERANCE * np.maximum(largest - least, np.finfo(float).tiny)
    centers, halves = _grid(lower, upper)
    bounds = np.array([least, largest])
    used = 0
    while len(centers):
        cells = region.possible(centers, halves)
        centers, halves = centers[cells], halves[cells]
        intervals, scores, possible = [], [], []
        for start in range(0, len(centers), CHUNK):
            part = slice(start, start + CHUNK)
            *line, there = network.over(centers[part], halves[part], *region.seen)
            middle, radius, curved = network.affine(
                W, by_z, constant, line, centers[part], halves[part]
            )
            low, high = middle - radius, middle + radius
            low = np.where(np.isnan(low), -np.inf, low)
            high = np.where(np.isnan(high), np.inf, high)
            intervals.append(np.stack([low, high]))
            scores.append(_scores(lure.V, halves[part], curved / excess[:, None]))
            possible.append(there)
        used += len(centers)
        if not intervals:
            break
        there = np.concatenate(possible)
        (low, high), score = np.hstack(intervals)[:, there], np.vstack(scores)[there]
        centers, halves = centers[there], halves[there]
        rough = np.any((high > largest + excess) | (low < least - excess), axis=1)
        done = np.ones_like(rough) if used > budget else ~rough
        if done.any():
            bounds[0] = np.minimum(bounds[0], low[done].min(axis=0))
            bounds[1] = np.maximum(bounds[1], high[done].max(axis=0))
        if used > budget:
            break
        centers, halves = _halved(centers[rough], halves[rough], score[rough])
    return bounds[0], bounds[1]


def _grid(low, high):
    """Return a first grid of cells."""
    n = len(low)
    k = max(1, round(FIRST ** (1 / n)))
    grid, half = unit_grid(k, n), (high - low) / 2
    return (low + high) / 2 + grid * half, np.broadcast_to(half / k, grid.shape).copy()


def unit_grid(k, n):
    """Return the centers of cells that cut the box from -1 to 1.

    Parameters
    ----------
    k : int
        Cells along every axis.
    n : int
        Number of axes.

    Returns
    -------
    centers : ndarray of shape (k^n, n)
        The centers.
    """
    steps = (2 * np.arange(k) + 1) / k - 1
    return np.array(list(product(steps, repeat=n)))


def _scores(V, halves, curved):
    """Return what halving each side of a cell would gain, about."""
    seen = halves[:, None, :] * np.abs(V)  # (n, nw, nz)
    share = seen / np.maximum(seen.sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    return np.einsum("nkj,nji->ni", curved, share)


def _halved(centers, halves, score):
    """Return the cells, each cut in two along its most rewarding side."""
    side = np.argmax(score, axis=1)
    cells = np.arange(len(centers))
    halves = halves.copy()
    halves[cells, side] /= 2
    shift = np.zeros_like(halves)
    shift[cells, side] = halves[cells, side]
    return np.vstack([centers - shift, centers + shift]), np.vstack([halves, halves])

"""Loops as linear systems with bounded remainders: two ways to bound them (eq. local).

A cover takes the region in which a loop is and gives a linear system

    x+ = A x + B r + G rho + c,    y = C x + D r + H rho + d,    |rho_i| <= radius_i

that has every trajectory of the loop that stays in the region, and the region in which
this system then is.  `ByNeurons` takes every neuron as a line and its remainder as one
rho; it costs little in any dimension, but neurons that cancel each other count twice.
`ByCells` fits a linear map to the network as a whole and bounds what is left by
subdivision (`_cells`), which a handful of states and inputs allow.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ._cells import Strips, remainder
from ._lines import lines
from ._peaks import peaks

PIECES = 64  # of the range of a neuron
SLOPES = 33  # slopes tried for its line
POINTS = 4_000  # samples that a linear map is fitted to
LAWSON = 25  # steps towards the fit with the smallest largest error
GUESS = 1.02  # remainder over that of the samples, while the region is searched
MOST_DIMENSIONS = 5  # states and inputs of a subdivision


@dataclass(frozen=True, eq=False)
class Affine:
    """Hold a linear system with bounded remainders, in scaled coordinates.

    Parameters
    ----------
    A, B, c : ndarray
        Of x+, with inputs of modulus at most one.
    C, D, d : ndarray
        Of y.
    G, H : ndarray of shapes (nx, m) and (ny, m)
        What remainders add to x+ and y.
    radius : ndarray of shape (m,)
        Largest modulus of each remainder.
    watched : ndarray of shape (k, nx + nu + m + 1)
        Signals whose range is the region: their weights of [x; r; rho; 1].
    """

    A: np.ndarray
    B: np.ndarray
    c: np.ndarray
    C: np.ndarray
    D: np.ndarray
    d: np.ndarray
    G: np.ndarray
    H: np.ndarray
    radius: np.ndarray
    watched: np.ndarray

    def region(self):
        """Return the region in which the system is, from x = 0.

        Returns
        -------
        region : ndarray of shape (2, k)
            Range of the signals that are watched.
        """
        return self.reach(self.watched)

    def reach(self, signals):
        """Return the range of signals over all inputs and remainders, from x = 0.

        Parameters
        ----------
        signals : ndarray of shape (k, nx + nu + m + 1)
            Weights of [x; r; rho; 1].

        Returns
        -------
        reach : ndarray of shape (2, k)
            Least and largest values.
        """
        nx, nu = self.B.shape
        B = np.hstack([self.B, self.G])
        by_x, at_once, constant = np.split(signals, [nx, signals.shape[1] - 1], axis=1)
        found = peaks(self.A, B, by_x, at_once, self.c, constant[:, 0])
        radius = found.gain @ np.concatenate([np.ones(nu), self.radius])
        return np.array([found.low - radius, found.high + radius])


class ByNeurons:
    """Cover a loop neuron by neuron; the region is the range of what neurons see.

    Parameters
    ----------
    network : Network
        The loop.
    """

    name = "neurons"

    def __init__(self, network):
        self.network = network
        lure = network.lure
        self.start = np.stack([network.rest, network.rest])
        self.plain: dict = {}
        twins = network.twins or [-1] * lure.nw
        for i, (activation, twin) in enumerate(zip(lure.sigma, twins, strict=True)):
            if twin < 0:
                self.plain.setdefault(activation, []).append(i)
        self.pairs = [(i, twin) for i, twin in enumerate(twins) if twin >= 0]

    def system(self, region, exact=True):
        """Return the linear system of a region.

        Parameters
        ----------
        region : ndarray of shape (2, nw)
            Range of what each neuron sees.
        exact : bool, default=True
            Not used: the remainder of a line costs nothing.

        Returns
        -------
        system : Affine
            The system.
        """
        lure = self.network.lure
        nx, nu, nw = lure.nx, lure.nu, lure.nw
        s, m, d = self._lines(region)
        # nu = V z + E w + b with w = s nu + m + rho
        solved = np.linalg.solve(
            np.eye(nw) - lure.E * s,
            np.hstack([lure.V, lure.E, (lure.b + lure.E @ m)[:, None]]),
        )
        q = np.hstack([lure.M, lure.W, (lure.c + lure.W @ m)[:, None]])
        q += (lure.W * s) @ solved
        ends = [nx, nx + nu, nx + nu + nw]
        A, B, G, c = np.split(q[:nx], ends, axis=1)
        C, D, H, k = np.split(q[nx:], ends, axis=1)
        return Affine(A, B, c[:, 0], C, D, k[:, 0], G, H, d, solved)

    def slopes(self, region):
        """Return the least and largest slope of every neuron over a region.

        Parameters
        ----------
        region : ndarray of shape (2, nw)
            Range of what each neuron sees, of a difference that of the difference.

        Returns
        -------
        slopes : ndarray of shape (2, nw)
            Slopes; that of a difference over that of what it sees.
        """
        low, high = region.copy()
        for i, twin in self.pairs:
            ends = region[:, twin] + region[:, i]
            low[i] = min(region[0, twin], ends[0])
            high[i] = max(region[1, twin], ends[1])
        sigma = self.network.lure.sigma
        found = [z.slopes(*ends) for z, *ends in zip(sigma, low, high, strict=True)]
        return np.array(found, dtype=float).reshape(-1, 2).T

    def seen(self, region):
        """Return the range of what every neuron sees: the region itself.

        Parameters
        ----------
        region : ndarray of shape (2, nw)
            The region.

        Returns
        -------
        seen : ndarray of shape (2, nw)
            Of a neuron with a twin that of the difference.
        """
        return region

    def _lines(self, region):
        """Return slope, offset and remainder of every neuron."""
        s, m, d = np.zeros((3, region.shape[1]))
        for activation, i in self.plain.items():
            low, high = region[:, i]
            s[i], m[i], d[i] = lines(activation, low, high, PIECES, SLOPES)
        if self.pairs:
            i = [number for number, _ in self.pairs]
            least, largest = self.slopes(region)[:, i]
            s[i] = (least + largest) / 2
            d[i] = (largest - least) / 2 * np.abs(region[:, i]).max(axis=0)
        return s, m, d


class ByCells:
    """Cover a loop as a whole; the region is the range along given directions.

    Parameters
    ----------
    network : Network
        The loop.
    design : Affine
        Linear system whose region is the first one.
    """

    name = "cells"

    def __init__(self, network, design):
        self.network = network
        lure, nx = network.lure, network.lure.nx
        axes = np.eye(nx)
        pairs = [a + sign * b for a, b in combinations(axes, 2) for sign in (1, -1)]
        self.rows = np.vstack([axes, *pairs, lure.V[:, :nx]])
        self.n_strips = nx + len(pairs)
        self.first = ~lure.E.any(axis=1)
        self.start = design.reach(self._watched(lure.nu))

    def system(self, region, exact=True):
        """Return the linear system of a region.

        Parameters
        ----------
        region : ndarray of shape (2, k)
            Range along the directions.
        exact : bool, default=True
            Whether remainders are bounded; else they are those of samples.

        Returns
        -------
        system : Affine
            The system.
        """
        nx, nu = self.network.lure.nx, self.network.lure.nu
        ones = np.ones((2, nu)) * [[-1], [1]]
        low, high = region[:, : self.n_strips]
        box = np.hstack([region[:, :nx], ones])
        seen = self.seen(region)
        strips = Strips(box, self.rows[: self.n_strips], low, high, seen)
        z = strips.samples(POINTS, np.random.default_rng(0))
        q = self.network.values(z)
        z = np.column_stack([z, np.ones(len(z))])
        fit = np.linalg.lstsq(z, q, rcond=None)[0].T
        # directions of the remainder of x+, the largest first; y has its own
        directions = np.eye(len(q[0]))
        turn = np.linalg.svd((q - z @ fit.T)[:, :nx].T, full_matrices=False)[0]
        directions[:nx, :nx] = turn
        fit = directions @ _least_peak(z, q @ directions, fit.T @ directions).T
        samples = (q - z @ fit.T) @ directions
        if exact:
            low, high = remainder(self.network, strips, directions.T, fit, samples)
        else:
            low, high = GUESS * samples.min(axis=0), GUESS * samples.max(axis=0)
        # remainders around their middle
        fit[:, -1] += directions @ (low + high) / 2
        radius = (high - low) / 2
        used = radius > 0
        G, H = directions[:nx, used], directions[nx:, used]
        (A, B, c), (C, D, d) = (
            np.split(rows, [nx, nx + nu], axis=1) for rows in (fit[:nx], fit[nx:])
        )
        watched = self._watched(nu + used.sum())
        return Affine(A, B, c[:, 0], C, D, d[:, 0], G, H, radius[used], watched)

    def slopes(self, region):
        """Return the least and largest slope of every neuron over a region.

        Parameters
        ----------
        region : ndarray of shape (2, k)
            Range along the directions.

        Returns
        -------
        slopes : ndarray of shape (2, nw)
            Slopes; those that they have anywhere for neurons behind others.
        """
        sigma, seen = self.network.lure.sigma, self.seen(region)
        found = [
            z.slopes(*ends) if first else z.slope
            for z, ends, first in zip(sigma, seen.T, self.first, strict=True)
        ]
        return np.array(found, dtype=float).reshape(-1, 2).T

    def seen(self, region):
        """Return the range of what every neuron sees.

        Parameters
        ----------
        region : ndarray of shape (2, k)
            Range along the directions.

        Returns
        -------
        seen : ndarray of shape (2, nw)
            Infinite behind other neurons.
        """
        lure = self.network.lure
        by_r = np.abs(lure.V[:, lure.nx :]).sum(axis=1)
        seen = region[:, self.n_strips :] + lure.b + np.outer([-1, 1], by_r)
        seen[:, ~self.first] = np.array([[-np.inf], [np.inf]])
        return seen

    def _watched(self, n):
        """Return the directions beside n inputs and remainders, which they lack."""
        return np.pad(self.rows, ((0, 0), (0, n + 1)))


def _least_peak(z, q, fit):
    """Return a fit whose largest error is small, column by column (Lawson's method).

    Any fit is valid; the remainder of this one is smaller than that of least squares.
    """
    fit = fit.copy()
    for i, target in enumerate(q.T):
        weights, least = np.full(len(z), 1 / len(z)), np.inf
        tried = fit[:, i]
        for _ in range(LAWSON):
            error = np.abs(target - z @ tried)
            if error.max() < least:
                least, fit[:, i] = error.max(), tried
            if error.max() <= 1e-12 * np.abs(target).max():
                break
            weights = weights * error
            weights /= weights.sum()
            weighted = z.T * weights
            tried = np.linalg.lstsq(weighted @ z, weighted @ target, rcond=None)[0]
    return fit


def covers(network, design):
    """Return the covers that suit a loop.

    Parameters
    ----------
    network : Network
        The loop.
    design : Affine
        Its linear design.

    Returns
    -------
    covers : list
        `ByCells` where the loop has few states, those of the design, and few inputs,
        and `ByNeurons`.
    """
    lure = network.lure
    by_neurons = ByNeurons(network)
    small = lure.nx == len(design.A) and lure.nx + lure.nu <= MOST_DIMENSIONS
    if not small or lure.implicit or network.twins or not lure.nw:
        return [by_neurons]
    return [ByCells(network, design), by_neurons]

"""What a local certificate rests on: a region, and the system that bounds it."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from ._covers import Affine, ByCells, ByNeurons
from ._grid import Grid
from ._lines import chords
from ._peaks import peaks


@dataclass(frozen=True, eq=False)
class Proof:
    """Hold what is needed to check a region again, in scaled coordinates.

    Parameters
    ----------
    cover : ByCells or ByNeurons
        How the remainders are bounded.
    region : ndarray
        Region that was assumed.
    design : Affine
        Linear design.
    scale : ndarray of shape (ny,)
        Units of the outputs.
    amplitude : ndarray of shape (nr,)
        Units of the inputs.
    basis : ndarray of shape (nx, nx)
        The states are ``basis @ x``.
    cells : int, default=0
        Cells of a grid that bounds the outputs, too; 0 for none.
    """

    cover: ByCells | ByNeurons
    region: np.ndarray
    design: Affine
    scale: np.ndarray
    amplitude: np.ndarray
    basis: np.ndarray
    cells: int = 0

    def check(self):
        """Return the margin of the region and the bounds of the outputs.

        Returns
        -------
        margin : float
            See `LocalCertificate.verify`.
        bounds : ndarray of shape (ny,)
            Bounds of ``|y - y_lin|``.
        """
        system = self.cover.system(self.region)
        found = system.region()
        width = np.maximum(self.region[1] - self.region[0], 1e-12)
        inside = np.concatenate(
            [(found[0] - self.region[0]) / width, (self.region[1] - found[1]) / width]
        )
        margin = float(np.min(inside)) if inside.size else 0.0
        bounds = distance(system, self.design)
        if self.cells:
            grid = Grid(self.cover.network, self.design, self.states(), self.cells)
            bounds = np.minimum(bounds, grid.bounds())
        return margin, self.scale * bounds

    def slopes(self, sigma):
        """Return the slopes of all neurons of the loop over the region.

        Parameters
        ----------
        sigma : tuple of Activation
            Activations of the loop, dead neurons included.

        Returns
        -------
        slopes : ndarray of shape (2, nw)
            Least and largest ones.
        """
        slopes = np.array([z.slope for z in sigma], dtype=float).reshape(-1, 2).T
        live = self.cover.network.live
        slopes[:, live] = self.cover.slopes(self.region)
        return slopes

    def sectors(self, sigma, rest):
        """Return the chords of all neurons of the loop from rest, over the region.

        Parameters
        ----------
        sigma : tuple of Activation
            Activations of the loop, dead neurons included.
        rest : ndarray of shape (nw,)
            What they see at rest.

        Returns
        -------
        sectors : ndarray of shape (2, nw)
            Least and largest ones; of neurons with twins the slopes.
        reach : ndarray of shape (nw,)
            How far from rest they hold; inf for neurons that reach nothing.
        """
        sectors, reach = self.slopes(sigma), np.full(len(sigma), np.inf)
        network, seen = self.cover.network, self.cover.seen(self.region)
        for place, i in enumerate(network.live):
            low, high = min(seen[0, place], rest[i]), max(seen[1, place], rest[i])
            if not np.isfinite([low, high]).all():
                continue  # behind others: the sector holds everywhere
            reach[i] = min(high - rest[i], rest[i] - low)
            if not network.twins or network.twins[place] < 0:
                sectors[:, i] = chords(sigma[i], *np.array([rest[i], low, high]))
        return sectors, reach

    def channels(self):
        """Return the range of the channels behind y, (2, n_watched)."""
        system, ny = self.cover.system(self.region), len(self.scale)
        parts = system.C, system.D, system.H, system.d[:, None]
        return system.reach(np.hstack(parts)[ny:])

    def states(self):
        """Return the range of the scaled states, (2, nx)."""
        system = self.cover.system(self.region)
        nx, n = len(system.A), system.B.shape[1] + len(system.radius)
        return system.reach(np.eye(nx, nx + n + 1))

    def range_of_states(self):
        """Return the range of the states in the basis of the loop, (2, nx)."""
        states = self.states()
        middle, radius = states.mean(axis=0), np.ptp(states, axis=0) / 2
        middle, radius = self.basis @ middle, np.abs(self.basis) @ radius
        return np.array([middle - radius, middle + radius])


def distance(system, design):
    """Bound ``|y - y_lin|`` of a system with remainders and a linear design.

    Parameters
    ----------
    system : Affine
        The system.
    design : Affine
        The design, without remainders; it may have other states.

    Returns
    -------
    bounds : ndarray of shape (ny,)
        Bounds for all inputs of modulus at most one.
    """
    n, m, ny = len(design.A), len(system.radius), len(design.C)
    found = peaks(
        block_diag(system.A, design.A),
        np.block([[system.B, system.G], [design.B, np.zeros((n, m))]]),
        np.hstack([system.C[:ny], -design.C]),
        np.hstack([system.D[:ny] - design.D, system.H[:ny]]),
        np.concatenate([system.c, design.c]),
        system.d[:ny] - design.d,
    )
    inputs = np.concatenate([np.ones(system.B.shape[1]), system.radius])
    return np.maximum(np.abs(found.low), np.abs(found.high)) + found.gain @ inputs

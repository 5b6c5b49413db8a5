"""The distance from the design on a grid of states (eq. grid): for few states.

Peak gains know no phase: they let every remainder be at its largest, with the worst
sign, at every sample.  For few states the truth can be computed.  With phi(x, r) the
part of x+ that the design lacks, and psi that of y, the distance is

    y_T - y_lin,T = psi(x_T, r_T) + sum_i C A^i phi(x_(T-1-i), r_(T-1-i))

along a trajectory of the loop: the reward of a control problem with the states of the
loop alone.  Its largest value follows backwards in time,

    U_0(x) = max_r psi(x, r),   U_(i+1)(x) = max_r C A^i phi(x, r) + U_i(x+(x, r))

on the cells of a grid that trajectories from rest can reach; the bound is the largest
of all U_i at rest, and of the last U anywhere with what the sum leaves out.  Over a
cell of states and inputs x+, phi and psi are intervals (eq. cells), and U is the
largest value over all cells that the interval of x+ meets: every number is an upper
bound.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from ._cells import Network, unit_grid
from ._covers import Affine
from ._peaks import peaks

CELLS = 300_000  # of states and inputs, by default, if all can be reached
PER_INPUT = 6  # cells of a state for each of an input
MOST_STATES, MOST_INPUTS = 3, 2
CHUNK = 20_000  # cells that are evaluated at once
LONGEST = 1_000  # samples of the sum
LEAST = 1e-9  # half width of the box, and what it is widened by
TAIL = 1e-3  # of the first weight, at which the sum ends and what follows is bounded


@dataclass(frozen=True, eq=False)
class Grid:
    """Hold a loop of few states and inputs, and a box that its states do not leave.

    Parameters
    ----------
    network : Network
        The loop, in scaled coordinates.
    design : Affine
        Its linear design, with the same states.
    box : ndarray of shape (2, nx)
        Range of the states.
    n_cells : int, default=300_000
        Cells of states and inputs, about.
    """

    network: Network
    design: Affine
    box: np.ndarray
    n_cells: int = CELLS

    @staticmethod
    def suits(network, design):
        """Return whether a grid of the states of a loop has few enough cells.

        Parameters
        ----------
        network : Network
            The loop.
        design : Affine
            Its linear design.

        Returns
        -------
        suits : bool
            Whether there are few states, those of the design, and few inputs.
        """
        lure = network.lure
        few = 0 < lure.nx <= MOST_STATES and lure.nu <= MOST_INPUTS and lure.nw
        plain = not lure.implicit and not network.twins  # what `Network.over` knows
        return bool(few and plain and lure.nx == len(design.A))

    @property
    def shape(self):
        """Return the number of cells of every state."""
        return (PER_INPUT * self._per_input(),) * self.network.lure.nx

    def _per_input(self):
        """Return the number of cells of every input."""
        nx, nu = self.network.lure.nx, self.network.lure.nu
        return max(2, int((self.n_cells / PER_INPUT**nx) ** (1 / (nx + nu))))

    def bounds(self):
        """Bound ``|y - y_lin|`` over all inputs of modulus one, from rest.

        Returns
        -------
        bounds : ndarray of shape (ny,)
            The bounds.

        Raises
        ------
        TooSlow
            If the design forgets too slowly.
        """
        A, C = self.design.A, self.design.C
        corner, size, cells, (phi, phi_off), (psi, psi_off) = self._reach()
        largest = (np.abs(phi) + phi_off).reshape(-1, len(A)).max(axis=0)
        bounds = np.zeros(len(C))
        for output, row in enumerate(C):
            for sign in (1.0, -1.0):
                U, weight = sign * psi[..., output] + psi_off[..., output], sign * row
                for _ in range(LONGEST):
                    # from rest, which need not be a state that lasts: the first cell
                    bounds[output] = max(bounds[output], U[0].max())
                    U = self._dilated(U.max(axis=1), cells, size)[corner]
                    U += phi @ weight
                    U += phi_off @ np.abs(weight)
                    weight = weight @ A
                    if np.abs(weight).max() <= TAIL * np.abs(row).max():
                        break
                after = peaks(A, np.eye(len(A)), weight[None], np.zeros((1, len(A))))
                bound = U.max() + float((after.gain @ largest)[0])
                bounds[output] = max(bounds[output], bound)
        return bounds * (1 + 1e-9)

    def _reach(self):
        """Return images and remainders of all cells that can be reached from rest."""
        shape = np.array(self.shape)
        middle, half = self.box.mean(axis=0), np.ptp(self.box, axis=0) / 2
        half = half * (1 + LEAST) + LEAST  # a state that nothing moves has no width
        low, width = middle - half, 2 * half / shape
        reached, new = np.zeros((2, *shape), dtype=bool)
        new[tuple(np.clip(np.floor(-low / width), 0, shape - 1).astype(int))] = True
        found, size = [], np.ones(len(shape), dtype=int)
        while new.any():
            reached |= new
            cells = np.argwhere(new)
            (x, off), *rest = self._over(low + (cells + 0.5) * width, width / 2)
            # the loop does not leave the box: what lies outside of it is not reached
            a, b = (
                np.clip(np.floor((end - low) / width), 0, shape - 1).astype(int)
                for end in (x - off, x + off)
            )
            found.append((cells, a, *rest))
            wide = (b - a).reshape(-1, len(shape)).max(axis=0) + 1
            size = np.maximum(size, wide)
            marks = np.zeros_like(reached)
            marks[tuple(np.moveaxis(a, -1, 0))] = True
            new = _over_boxes(marks, wide, -1) & ~reached
        cells, a, phi, psi = (
            np.concatenate([part[i] for part in found], axis=axis)
            for i, axis in ((0, 0), (1, 0), (2, 1), (3, 1))
        )
        cells, corner = (
            np.ravel_multi_index(tuple(np.moveaxis(z, -1, 0)), self.shape)
            for z in (cells, a)
        )
        return corner, size, cells, phi, psi

    def _over(self, centers, half):
        """Return x+, phi and psi over cells and inputs, as middle and radius."""
        lure, design, m = self.network.lure, self.design, self._per_input()
        nx, nu, n = lure.nx, lure.nu, lure.nx + len(design.C)
        linear = np.block([[design.A, design.B], [design.C, design.D]])
        rows = np.vstack([lure.W[:nx], lure.W[:n]])
        by_z = np.vstack([lure.M[:nx], lure.M[:n] - linear])
        constant = np.concatenate([lure.c[:nx], lure.c[:n]])
        r = unit_grid(m, nu)
        x = np.repeat(centers, len(r), axis=0)
        z = np.hstack([x, np.tile(r, (len(centers), 1))])
        halves = np.concatenate([half, np.full(nu, 1 / m)])
        low, high = np.full((2, lure.nw), np.inf) * [[-1], [1]]  # nothing is known
        parts = []
        for start in range(0, len(z), CHUNK):
            part = z[start : start + CHUNK]
            sides = np.broadcast_to(halves, part.shape)
            *line, _ = self.network.over(part, sides, low, high, pieces=1)
            both = self.network.affine(rows, by_z, constant, line, part, sides)[:2]
            parts.append(np.array(both))
        both = np.concatenate(parts, axis=1).reshape(2, len(centers), len(r), -1)
        return both[..., :nx], both[..., nx : 2 * nx], both[..., 2 * nx :]

    def _dilated(self, values, cells, size):
        """Return the largest value over boxes of a size, by their lowest corners."""
        U = np.full(np.prod(self.shape), -np.inf)
        U[cells] = values
        return _over_boxes(U.reshape(self.shape), size, 1).ravel()


def _over_boxes(values, size, way):
    """Return the largest value over boxes that start (way 1) or end (-1) at a cell."""
    origin = [-(n // 2) if way == 1 else (n - 1) // 2 for n in size]
    return maximum_filter(values, size, mode="nearest", origin=origin)

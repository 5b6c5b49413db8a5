"""What one experiment contributes to the sums of the cost and its derivatives.

`Contribution` is what a worker has to know: the structure and the weights of the
channels, no data.  By theta, the initial state and (u, y) it returns |r|^2, or with it
the blocks of J'J and J'r.  The initial state of an experiment touches nothing but that
experiment, so that J'J over all of them is an arrow,

    [ sum J_t'J_t      J_t'J_1   J_t'J_2   ... ]
    [    J_1'J_t       J_1'J_1                 ]
    [    J_2'J_t                 J_2'J_2       ]

whose head is one sum of size n_params^2 whatever the number of experiments.
"""

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .adjoint import pulled_change
from .experiments import chunks
from .kernels import add_square
from .sensitivities import sensitivities
from .simulation import regressors, trajectory
from .steady import eliminated, steady_state
from .structures import Structure

# Mean square derivative by a parameter beyond which the rounding of the simulation
# alone moves it by its own size: its derivatives lead nowhere.
SENSITIVITY_LIMIT = 1e32
BUFFERS = 4  # chunks of J, of which one is made while a second thread squares others
MAKING = 4.0  # time of a multiplication that makes J, over that of one that squares it
# Time to make a chunk over that to square it, as follows from `MAKING`, from which on
# the thread that makes them has no time to square any.
LATE = 0.9


class Arrow(NamedTuple):
    """Hold J'J, J'r and |r|^2 over some experiments.

    Parameters
    ----------
    head : ndarray of shape (n_free, n_free)
        J'J by the free parameters.
    head_r : ndarray of shape (n_free,)
        J'r by these.
    square : float
        |r|^2.
    borders : dict of int to tuple of ndarray
        By number of the experiment: the rows of J'J of its initial state, of shape
        (n_x0, n_free + n_x0), and of J'r, of shape (n_x0,).
    """

    head: np.ndarray
    head_r: np.ndarray
    square: float
    borders: dict

    def merge(self, other):
        """Return the sums over the experiments of both.

        Parameters
        ----------
        other : Arrow
            Sums over other experiments.

        Returns
        -------
        arrow : Arrow
            Sums over all.
        """
        return Arrow(
            self.head + other.head,
            self.head_r + other.head_r,
            self.square + other.square,
            {**self.borders, **other.borders},
        )


class Pulled(NamedTuple):
    """Hold J'c over some experiments, for a vector c as long as the residual.

    Parameters
    ----------
    by_theta : ndarray of shape (n_params,)
        Part by the parameters; nan if a simulation diverges.
    by_x0 : dict of int to ndarray
        Parts by the initial states, of shape (n_x0,), by number of the experiment.
    """

    by_theta: np.ndarray
    by_x0: dict

    def merge(self, other):
        """Return the sums over the experiments of both.

        Parameters
        ----------
        other : Pulled
            Sums over other experiments.

        Returns
        -------
        pulled : Pulled
            Sums over all.
        """
        return Pulled(self.by_theta + other.by_theta, {**self.by_x0, **other.by_x0})


@dataclass(frozen=True, eq=False)
class Contribution:
    """Evaluate one experiment.

    Parameters
    ----------
    structure : Structure
        Map from parameters to the Lur'e form; its first channel is what was measured.
    weight : ndarray of shape (nz,)
        Factors of the residual.
    chunk : int or None
        Samples per chunk of the sensitivities; None fits the cache.
    pipelined : bool, default=False
        Whether a second thread squares most chunks. The result does not depend on it.
    periodic : bool, default=False
        Whether the experiment is one period of what repeats itself: the initial state
        is the periodic one (eq. steady), whatever x0 is.
    free : ndarray of bool of shape (n_params,) or None, default=None
        Parameters by which is differentiated, n_free of them; None means all.
    """

    structure: Structure
    weight: np.ndarray
    chunk: int | None = None
    pipelined: bool = False
    periodic: bool = False
    free: np.ndarray | None = None

    def initial(self, theta, x0, u, y=None):
        """Return the initial state of an experiment.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Parameters.
        x0 : ndarray of shape (n_x0,)
            Initial state of the free vector.
        u : array of shape (N, nu)
            Inputs.
        y : array of shape (N, ny) or None, default=None
            Outputs; not used.

        Returns
        -------
        x0 : ndarray of shape (n_x0,)
            The same; that of the periodic state if the experiment is periodic.
        """
        if not self.periodic:
            return x0
        structure = self.structure
        return steady_state(structure.lure(theta), u, structure.initial_state, len(x0))

    def residuals(self, theta, x0, u, y):
        """Yield the weighted residual in chunks, nan if diverged.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Parameters.
        x0 : ndarray of shape (n_x0,)
            Initial state.
        u : array of shape (N, nu)
            Inputs.
        y : array of shape (N, ny)
            Outputs.

        Yields
        ------
        r : ndarray of shape (L, nz)
            Residual of a chunk; one row of nan ends a diverged experiment.
        """
        lure = self.structure.lure(theta)
        x0 = self.initial(theta, x0, u)
        for part, u_part, X in trajectory(lure, u, self.structure.initial_state(x0)):
            if not np.isfinite(X[-1]).all():
                yield np.full(lure.nz, np.nan)
                return
            Z = regressors(lure, X[:-1], u_part) @ lure.rows_z.T * self.weight
            yield self._subtract(Z, y[part])[0]

    def _subtract(self, Z, y):
        """Return Z minus the weighted targets, in place, and what was not measured."""
        ny = y.shape[1]
        missing = np.isnan(y)
        Z[:, :ny] -= y * self.weight[:ny]
        if missing.any():
            Z[:, :ny][missing] = 0.0
            return Z, missing
        return Z, None

    def square(self, theta, x0, u, y):
        """Return |r|^2.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Parameters.
        x0 : ndarray of shape (n_x0,)
            Initial state.
        u : array of shape (N, nu)
            Inputs.
        y : array of shape (N, ny)
            Outputs.

        Returns
        -------
        square : float
            Its squared norm; nan if diverged.
        """
        return sum(float(np.vdot(r, r)) for r in self.residuals(theta, x0, u, y))

    def squares(self, theta, x0, u, y):
        """Return squared errors of every output, without weights.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Parameters.
        x0 : ndarray of shape (n_x0,)
            Initial state.
        u : array of shape (N, nu)
            Inputs.
        y : array of shape (N, ny)
            Outputs.

        Returns
        -------
        squares : ndarray of shape (2, ny)
            Their sums, and how many were measured.
        """
        ny = y.shape[1]
        weight = np.where(self.weight[:ny] > 0, self.weight[:ny], np.inf)
        rows = [r[..., :ny] / weight for r in self.residuals(theta, x0, u, y)]
        n = sum(np.isfinite(y[part]).sum(axis=0) for part in chunks(len(y)))
        return np.array([np.sum(np.vstack(rows) ** 2, axis=0), n])

    def arrow(self, theta, i, x0, u, y):
        """Return J'J, J'r and |r|^2, accumulated chunk by chunk.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Parameters.
        i : int
            Number of the experiment.
        x0 : ndarray of shape (n_x0,)
            Initial state.
        u : array of shape (N, nu)
            Inputs.
        y : array of shape (N, ny)
            Outputs.

        Returns
        -------
        arrow : Arrow
            The sums over this experiment.

        Raises
        ------
        FloatingPointError
            If the simulation diverges, or its sensitivities do.
        """
        n_free = self.structure.n_params if self.free is None else np.sum(self.free)
        n = n_free + self.structure.n_x0
        end = np.empty((self.structure.nx, n)) if self.periodic else None
        blocks = self._jacobian(theta, self.initial(theta, x0, u), u, y, end)
        # of [J r]: J'J, J'r and |r|^2 are blocks of one sum
        sums = _squares(blocks, n + 1, self._own_squares(n), self.pipelined)
        JJ = np.tril(sums) + np.tril(sums, -1).T
        if self.periodic:
            JJ = eliminated(JJ, end, n_free)
        border = JJ[n_free:n, :n].copy(), JJ[n_free:n, n].copy()
        head, head_r = JJ[:n_free, :n_free].copy(), JJ[:n_free, n].copy()
        return Arrow(head, head_r, float(JJ[n, n]), {i: border})

    def pulled(self, thetas, i, x0s, u, y):
        """Return J'(r_2 - r_1) for the residuals at two points.

        Parameters
        ----------
        thetas : sequence of two ndarray of shape (n_params,)
            Parameters; J belongs to the first ones.
        i : int
            Number of the experiment.
        x0s : ndarray of shape (2, n_x0)
            Initial states.
        u : array of shape (N, nu)
            Inputs.
        y : array of shape (N, ny)
            Outputs; only what was not measured counts.

        Returns
        -------
        pulled : Pulled
            The sum over this experiment.
        """

        def missing(part):
            return np.isnan(y[part])

        points = zip(thetas, x0s, strict=True)
        x0s = [self.initial(theta, x0, u) for theta, x0 in points]
        how = u, self.weight, missing, self.periodic
        by_theta, by_x0 = pulled_change(self.structure, thetas, x0s, *how)
        return Pulled(by_theta, {i: by_x0})

    def _own_squares(self, n):
        """Return k if every k-th chunk is squared by the thread that makes them.

        Both threads are busy to the end if that one squares (1 - m) / 2 of them, where
        m is the time to make a chunk over that to square it. Zero stands for none. Else
        k is 3 or more, so that of two chunks that wait none is in the next buffer.
        """
        nx, nz = self.structure.nx, self.structure.nz
        # of multiplications, those of the simulation with them
        made, squared = MAKING * (nx + nz) * (nx + 6), nz * n
        return int(np.ceil(2 / (1 - made / squared))) if made < LATE * squared else 0

    def _jacobian(self, theta, x0, u, y, end):
        """Yield [J r] in chunks; if pipelined, a chunk outlives the next ones."""
        buffers = BUFFERS if self.pipelined else 1
        options = {"spare": 1, "buffers": buffers, "end": end}
        options["free"] = self.free
        for part, Z, J in sensitivities(
            self.structure, theta, x0, u, self.weight, self.chunk, **options
        ):
            J[:, :, -1], missing = self._subtract(Z, y[part])
            if missing is not None:
                J[:, : missing.shape[1]][missing] = 0.0
            yield J.reshape(-1, J.shape[2])


def _squares(blocks, n, every, pipelined):
    """Return the sum of the squares of blocks, the lower triangle.

    If pipelined, a second thread adds most of them while the next ones are made. Both
    threads have sums of their own, and blocks of their own, so that the result is the
    same with one.
    """
    sums = np.zeros((2, n, n))
    waiting: deque = deque()
    with ThreadPoolExecutor(1) if pipelined else nullcontext() as thread:
        for i, block in enumerate(blocks):
            is_own = every > 0 and i % every == every - 1
            if thread is None or is_own:
                add_square(block, sums[int(is_own)])
            else:
                waiting.append(thread.submit(add_square, block, sums[0]))
            while len(waiting) > BUFFERS - 2:  # else the next one would overwrite it
                waiting.popleft().result()
            _check(sums)
        for added in waiting:
            added.result()
    _check(sums)
    return sums[0] + sums[1]


def _check(sums):
    """Raise if the sums show diverging sensitivities."""
    largest = np.diagonal(sums, axis1=1, axis2=2)[:, :-1].max(initial=0.0)
    if not largest < SENSITIVITY_LIMIT:  # "not <": nan is beyond
        raise FloatingPointError(
            "The simulation is finite at these parameters, but its sensitivities "
            "diverge."
        )

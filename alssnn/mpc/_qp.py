"""Quadratic programs that change in their vectors only, and nothing else.

min x'Px / 2 + q'x  subject to  lower <= G x <= upper.  OSQP factorizes once; every
later solve updates q and the bounds and starts from the last solution.
"""

import time
from dataclasses import dataclass

import numpy as np
import osqp
from scipy.sparse import csc_matrix

# An inaccurate solution meets ten thousand times the tolerance only: not a solution.
SOLVED = osqp.SolverStatus.OSQP_SOLVED


@dataclass(frozen=True, eq=False)
class Solution:
    """Hold what the solver says; `x` is None unless it solved the program."""

    x: np.ndarray | None
    status: str
    iterations: int
    solve_time: float


class QuadraticProgram:
    """Solve a sequence of quadratic programs with the same matrices.

    The solver is set up at the first solve and after unpickling.

    Parameters
    ----------
    P : ndarray of shape (n, n)
        Hessian, positive definite.
    G : ndarray of shape (m, n)
        Constraints.
    tol : float
        Absolute and relative tolerance of both residuals.
    max_iter : int
        Limit of iterations.
    """

    def __init__(self, P, G, tol, max_iter):
        self.P, self.G = csc_matrix(np.triu(P)), csc_matrix(G)
        self._places = None
        self.settings = {"eps_abs": tol, "eps_rel": tol, "max_iter": max_iter}
        self._solver = None

    def __getstate__(self):
        """Leave out the solver, which cannot be pickled."""
        return self.__dict__ | {"_solver": None}

    def reset(self):
        """Forget the last solution."""
        self._solver = None

    def change(self, P, G):
        """Replace the matrices by others of the same size, for small programs.

        Parameters
        ----------
        P : ndarray of shape (n, n)
            Hessian, positive definite.
        G : ndarray of shape (m, n)
            Constraints.
        """
        if self._places is None:  # from now on zeros are stored, too
            self._places = _dense(P, upper=True), _dense(G)
            self.P, self.G = (
                csc_matrix((M[rows, columns], rows, ends), shape=M.shape)
                for M, (rows, columns, ends) in zip((P, G), self._places, strict=True)
            )
            self._solver = None
            return
        for matrix, M, (rows, columns, _) in zip(
            (self.P, self.G), (P, G), self._places, strict=True
        ):
            matrix.data = M[rows, columns]
        if self._solver is not None:
            self._solver.update(Px=self.P.data, Ax=self.G.data)

    def solve(self, q, lower, upper):
        """Solve the program for given vectors.

        Parameters
        ----------
        q : ndarray of shape (n,)
            Gradient.
        lower : ndarray of shape (m,)
            Lower bounds.
        upper : ndarray of shape (m,)
            Upper bounds.

        Returns
        -------
        solution : Solution
            Solution, or the reason why there is none.
        """
        start = time.perf_counter()
        if not (np.isfinite(q).all() and (lower <= upper).all()):  # nan is false
            return Solution(None, "data not finite or bounds crossed", 0, 0.0)
        if self._solver is None:
            self._solver = osqp.OSQP()
            vectors = {"q": q, "l": lower, "u": upper}
            settings = {"verbose": False, "warm_starting": True, **self.settings}
            self._solver.setup(P=self.P, A=self.G, **vectors, **settings)
        else:
            self._solver.update(q=q, l=lower, u=upper)
        result = self._solver.solve(raise_error=False)
        info, x = result.info, result.x
        seconds = time.perf_counter() - start
        if info.status_val != SOLVED or not np.isfinite(x).all():
            self._solver = None  # a later program must not start from a failed one
            return Solution(None, info.status, info.iter, seconds)
        return Solution(x.copy(), info.status, info.iter, seconds)


def _dense(matrix, upper=False):
    """Return rows, columns and column ends of a pattern that has all entries."""
    m, n = matrix.shape
    counts = np.arange(1, n + 1) if upper else np.full(n, m)
    rows = np.concatenate([np.arange(count) for count in counts])
    columns = np.repeat(np.arange(n), counts)
    return rows, columns, np.concatenate([[0], np.cumsum(counts)])

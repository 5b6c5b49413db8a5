"""Quadratic programs that change in their numbers only, and nothing else.

min x'Px / 2 + q'x  subject to  lower <= G x <= upper.  OSQP factorizes once, and again
where a matrix changes; every later solve updates q and the bounds and starts from the
last solution.
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
    """Solve a sequence of quadratic programs whose matrices have the same zeros.

    The solver is set up at the first solve and after unpickling.

    Parameters
    ----------
    P : ndarray of shape (n, n)
        Hessian, positive definite; before `change`, what is not zero in all of them.
    G : ndarray of shape (m, n)
        Constraints; the same.
    tol : float
        Absolute and relative tolerance of both residuals.
    max_iter : int
        Limit of iterations.
    **settings : float
        Other settings of OSQP.
    """

    def __init__(self, P, G, tol, max_iter, **settings):
        self.P, self.G = csc_matrix(np.triu(P)), csc_matrix(G)
        self.settings = {"eps_abs": tol, "eps_rel": tol, "max_iter": max_iter}
        self.settings |= {"verbose": False, "warm_starting": True, **settings}
        self._places = {
            name: (M.indices, np.repeat(np.arange(M.shape[1]), np.diff(M.indptr)))
            for name, M in (("Px", self.P), ("Ax", self.G))
        }
        self._solver = None

    def __getstate__(self):
        """Leave out the solver, which cannot be pickled."""
        return self.__dict__ | {"_solver": None}

    def reset(self):
        """Forget the last solution."""
        self._solver = None

    def change(self, *, P=None, G=None):
        """Replace matrices by others with the same zeros.

        Parameters
        ----------
        P : ndarray of shape (n, n) or None, default=None
            Hessian, positive definite; None leaves it.
        G : ndarray of shape (m, n) or None, default=None
            Constraints; None leaves them.
        """
        data = {}
        for name, matrix, M in (("Px", self.P, P), ("Ax", self.G, G)):
            if M is not None:
                matrix.data = data[name] = M[self._places[name]]
        if self._solver is not None:
            self._solver.update(**data)

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
        vectors = {"q": q, "l": lower, "u": upper}
        if self._solver is None:
            self._solver = osqp.OSQP()
            self._solver.setup(P=self.P, A=self.G, **vectors, **self.settings)
        else:
            self._solver.update(**vectors)
        result = self._solver.solve(raise_error=False)
        info, x = result.info, result.x
        seconds = time.perf_counter() - start
        if info.status_val != SOLVED or not np.isfinite(x).all():
            self._solver = None  # a later program must not start from a failed one
            return Solution(None, info.status, info.iter, seconds)
        return Solution(x.copy(), info.status, info.iter, seconds)

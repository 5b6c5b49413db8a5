"""The semidefinite programs of the certificates, and nothing else.

cvxpy states them, Clarabel solves them. What a solver returns is a proposal: the
callers recompute every inequality in NumPy before they call it a certificate.
"""

import warnings

import cvxpy as cp
import numpy as np

SOLVER = "CLARABEL"
SOLVED = ("optimal", "optimal_inaccurate")  # the second is left to the recomputation
INFEASIBLE = ("infeasible", "infeasible_inaccurate")


class LargestP:
    """Find the largest P of the LMI for psi = 1 and varying phi (eq. lmi).

    The product of the parameter phi and the variable P is affine by the rules of
    parametrized programs, so that the program is compiled once.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    """

    def __init__(self, A):
        n = len(A)
        self.phi = cp.Parameter(nonneg=True)
        self.P = cp.Variable((n, n), PSD=True)
        blocks = [
            [A.T @ self.P @ A + self.phi * self.P - self.P, A.T @ self.P],
            [self.P @ A, self.P - np.eye(n)],
        ]
        self.problem = cp.Problem(
            cp.Maximize(cp.trace(self.P)), [_symmetric(cp.bmat(blocks)) << 0]
        )

    def __call__(self, phi):
        """Return P and the status of the solver; P is nan if there is none.

        Parameters
        ----------
        phi : float
            Rate.

        Returns
        -------
        P : ndarray of shape (nx, nx)
            Largest solution, in the order of symmetric matrices.
        status : str
            Status of the solver.
        """
        self.phi.value = phi
        status = _solve(self.problem)
        if status in SOLVED:
            return _symmetric(self.P.value), status
        return np.full(self.P.shape, np.nan), status


def _symmetric(X):
    # cvxpy wants symmetry up to the last bit
    return (X + X.T) / 2


def _solve(problem):
    """Solve and return the status: a solution or none; else the solver failed."""
    with warnings.catch_warnings():
        # accuracy is judged by the recomputed margin, not by the solver
        warnings.filterwarnings("ignore", "Solution may be inaccurate")
        try:
            problem.solve(solver=SOLVER)
        except cp.error.SolverError as error:
            raise RuntimeError(_breakdown(problem.status or "error")) from error
    if problem.status not in (*SOLVED, *INFEASIBLE):
        raise RuntimeError(_breakdown(problem.status))
    return problem.status


def _breakdown(status):
    return (
        f"The solver {SOLVER} broke down with status {status!r}. Rescale the states "
        "or the signals."
    )

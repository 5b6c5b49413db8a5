"""States of rest that come closest to a reference within the bounds (eq. target).

The whole model x+ = A x + B u + w, linearized at the last target, rests at

    [x_s; u_s] = p + N z,      N spans the null space of [I - A, -B],

with as many z as u, for models that integrate as well.  Where the bounds do not bind, z
is that of weighted least squares in closed form; else a small quadratic program finds
it.  Relinearized at every pass this is Newton's method: it does not matter how the
model divides its slope between A and h.
"""

import numpy as np
from scipy.linalg import block_diag

from ._qp import QuadraticProgram

PRIOR = 1e-4  # weight, relative, of |u_s| in directions that the reference leaves free
RANK = 1e-8  # singular value, relative, below which a direction counts as lost
STEP = 1.0  # largest step of Newton's method, in standard deviations of x and u


class Target:
    """Find the state of rest for a reference; all signals are scaled deviations.

    Parameters
    ----------
    C : ndarray of shape (ny, nx)
        Output matrix.
    weight : ndarray of shape (ny, ny)
        Weight of the error y_s - r.
    soft : ndarray of shape (n_soft, nx)
        Rows whose products with x_s have soft bounds.
    penalty : tuple of two floats
        Linear and quadratic weight of what exceeds them.
    options : dict
        Options of `QuadraticProgram`.
    """

    def __init__(self, C, weight, soft, penalty, options):
        self.C, self.weight, self.soft = C, weight, soft
        self.penalty, self.options = penalty, options
        self._qp = None

    def reset(self):
        """Forget the last program."""
        self._qp = None

    def improve(self, last, model, goal, u_bounds, soft_bounds):
        """Return a better state of rest than the last one.

        Parameters
        ----------
        last : tuple of ndarray of shape (nx,) and (nu,)
            Last state of rest and its input.
        model : tuple of ndarray of shape (nx, nx), (nx, nu) and (nx,)
            A, B and w of the linearization there.
        goal : ndarray of shape (ny,)
            Desired value of C x_s.
        u_bounds : tuple of two ndarray of shape (nu,)
            Bounds of u_s.
        soft_bounds : tuple of two ndarray of shape (n_soft,)
            Bounds of the soft rows.

        Returns
        -------
        x_s : ndarray of shape (nx,)
            State of rest.
        u_s : ndarray of shape (nu,)
            Its input, within the bounds if the last one was.
        status : str
            "closed form", or what the solver says if it was needed. If it fails, the
            last state of rest stays.
        """
        if not all(np.isfinite(part).all() for part in (*model, goal)):
            return *last, "data not finite"
        x, u, status = self._rest(model, goal, u_bounds, soft_bounds)
        if x is None:
            return *last, status
        step = np.concatenate([x - last[0], u - last[1]])
        share = min(1.0, STEP / max(np.abs(step).max(), STEP))
        return last[0] + share * (x - last[0]), last[1] + share * (u - last[1]), status

    def _rest(self, model, goal, u_bounds, soft_bounds):
        """Return the state of rest of the linearization, its input and the status."""
        p, N = _at_rest(*model)
        nx = len(model[0])
        (p_x, p_u), (N_x, N_u) = np.split(p, [nx]), np.split(N, [nx])
        G = self.C @ N_x  # (ny, nz)
        H = G.T @ self.weight @ G
        gradient = G.T @ self.weight @ (self.C @ p_x - goal)
        # |u_s| decides only where the outputs leave z free: the others get no bias
        values, Z = np.linalg.eigh(H)
        free = N_u @ Z[:, values <= RANK * values[-1]]  # (nu, n_free)
        if free.size:
            prior = PRIOR * max(values[-1], RANK) * N_u.T @ free @ free.T  # (nz, nu)
            H, gradient = H + prior @ N_u, gradient + prior @ p_u
        z = -np.linalg.lstsq(H, gradient)[0]
        (u_min, u_max), (lower, upper) = u_bounds, soft_bounds
        x, u = p_x + N_x @ z, p_u + N_u @ z
        soft = self.soft @ x
        if np.all((u_min <= u) & (u <= u_max)) and np.all(
            (lower <= soft) & (soft <= upper)
        ):
            return x, u, "closed form"
        n_soft = len(soft)
        at, S = self.soft @ p_x, self.soft @ N_x
        eye, zero = np.eye(n_soft), np.zeros((len(u), n_soft))
        none = np.full(n_soft, np.inf)
        blocks = [(N_u, zero), (S, -eye), (S, eye), (0 * S, eye)]
        P = block_diag(H, self.penalty[1] * eye)
        rows = np.vstack([np.hstack(row) for row in blocks])
        if self._qp is None:
            self._qp = QuadraticProgram(P, rows, **self.options)
        self._qp.change(P, rows)
        solution = self._qp.solve(
            np.concatenate([gradient, np.full(n_soft, self.penalty[0])]),
            np.concatenate([u_min - p_u, -none, lower - at, 0 * at]),
            np.concatenate([u_max - p_u, upper - at, none, none]),
        )
        if solution.x is None:
            return None, None, solution.status
        z = solution.x[: len(z)]
        return p_x + N_x @ z, np.clip(p_u + N_u @ z, u_min, u_max), solution.status


def _at_rest(A, B, w):
    """Return p and N of all solutions [x; u] = p + N z of x = A x + B u + w."""
    nx = len(A)
    U, s, Vt = np.linalg.svd(np.hstack([np.eye(nx) - A, -B]))
    inverse = np.where(s > RANK * s[0], 1 / np.maximum(s, RANK * s[0]), 0.0)
    return Vt[:nx].T @ (inverse * (U.T @ w)), Vt[nx:].T

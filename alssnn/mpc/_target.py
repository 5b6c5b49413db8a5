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
SETTLED = 1e-3  # smaller steps are left to the next sample
STEP = 1.0  # largest step of Newton's method, in standard deviations of x and u
TINY = np.finfo(float).tiny


class StatesOfRest:
    """Keep one state of rest for every reference, and improve them.

    Parameters
    ----------
    model : DisturbedModel
        The model.
    limits : ActuatorLimits
        Limits of u.
    target : Target
        The problem of one of them.

    Attributes
    ----------
    X : ndarray of shape (n, nx)
        States of rest.
    U : ndarray of shape (n, nu)
        Their inputs, in the units of u.
    V : ndarray of shape (n, nu)
        The same as inputs of the linear system, scaled.
    """

    def __init__(self, model, limits, target):
        self.model, self.limits, self.target = model, limits, target
        self._u_bounds = tuple(
            (bound - model.u_offset) / model.u_scale
            for bound in (limits.u_min, limits.u_max)
        )
        self.reset()

    def reset(self):
        """Rest at the operating point, as far as the limits allow it."""
        self._keep(
            np.zeros((1, len(self.model.A))),
            self.limits.clip(self.model.u_offset)[None],
        )
        self.target.reset()

    def _keep(self, X, U, m=None):
        self.X, self.U = X, U
        self.V = self.model.inputs(X, U, self.model.ahead(m, len(X))).V

    def advance(self, n):
        """Move on by one sample; let the number of references be another one.

        Parameters
        ----------
        n : int
            Number of references.
        """
        if len(self.X) == n > 1:  # known ahead: that of a sample comes one nearer
            self._keep(*(np.vstack([z[1:], z[-1:]]) for z in (self.X, self.U)))
        elif len(self.X) != n:
            self._keep(np.tile(self.X[-1], (n, 1)), np.tile(self.U[-1], (n, 1)))

    def improve(self, d, goals, soft_bounds, m=None):
        """Take one step of Newton's method for every reference (eq. target).

        Parameters
        ----------
        d : ndarray of shape (nd,)
            Disturbance.
        goals : ndarray of shape (n, ny)
            Desired values of C x_s, scaled.
        soft_bounds : tuple of two ndarray of shape (n_soft,)
            Bounds of the soft rows.
        m : ndarray of shape (n, nm) or None, default=None
            Measured disturbances there, if there are any.

        Returns
        -------
        status : str
            That of the last one, or of the last one that failed.
        settled : bool
            Whether none has moved any more.
        """
        A, B, W = self.model.tangent(self.X, self.U, d, m)
        u_e, su, sx = self.model.u_offset, self.model.u_scale, self.model.x_scale
        A, B, W = A * sx / sx[:, None], B / sx[:, None], W / sx
        X, U, statuses = self.X / sx, (self.U - u_e) / su, []
        for i, goal in enumerate(goals):
            last, linear = (X[i], U[i]), (A[i], B[i], W[i])
            X[i], U[i], status = self.target.improve(
                last, linear, goal, self._u_bounds, soft_bounds
            )
            statuses.append(status)
        # a measured disturbance that moves may move the input of rest alone
        was = self.X / sx, (self.U - u_e) / su
        moved = max(np.abs(X - was[0]).max(), np.abs(U - was[1]).max())
        self._keep(X * sx, self.limits.clip(u_e + U * su), m)
        failed = [s for s in statuses if s not in ("closed form", "solved")]
        return (failed or statuses)[-1], not moved > SETTLED


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
    step : float
        Largest step of Newton's method, in standard deviations of x and u; infinite
        for a linear model, whose first step is the solution.
    """

    def __init__(self, C, weight, soft, penalty, options, step):
        self.C, self.weight, self.soft = C, weight, soft
        self.penalty, self.options, self.step = penalty, options, step
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
        share = min(1.0, self.step / max(np.abs(step).max(), TINY))
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
        at, S = self.soft @ p_x, self.soft @ N_x
        none = np.full(len(soft), np.inf)
        solution = self._program(H, N_u, S).solve(
            np.concatenate([gradient, np.full(len(soft), self.penalty[0])]),
            np.concatenate([u_min - p_u, -none, lower - at, 0 * at]),
            np.concatenate([u_max - p_u, upper - at, none, none]),
        )
        if solution.x is None:
            return None, None, solution.status
        z = solution.x[: len(z)]
        return p_x + N_x @ z, np.clip(p_u + N_u @ z, u_min, u_max), solution.status

    def _program(self, H, N_u, S):
        """Return the program in (z, sigma), with what changed in its matrices."""
        nu, nz = N_u.shape
        n_soft = len(S)
        if self._qp is None:
            eye, zero = np.eye(n_soft), np.zeros((nu, n_soft))
            blocks = [(N_u, zero), (S, -eye), (S, eye), (0 * S, eye)]
            self._rows = np.vstack([np.hstack(row) for row in blocks])
            self._P = block_diag(H, self.penalty[1] * eye)
            shapes = np.ones_like(self._P), np.ones_like(self._rows)
            self._qp = QuadraticProgram(*shapes, **self.options)
        self._P[:nz, :nz], self._rows[:nu, :nz] = H, N_u
        self._rows[nu : nu + n_soft, :nz] = S
        self._rows[nu + n_soft : nu + 2 * n_soft, :nz] = S
        self._qp.change(P=self._P, G=self._rows)
        return self._qp


def _at_rest(A, B, w):
    """Return p and N of all solutions [x; u] = p + N z of x = A x + B u + w."""
    nx = len(A)
    U, s, Vt = np.linalg.svd(np.hstack([np.eye(nx) - A, -B]))
    inverse = np.where(s > RANK * s[0], 1 / np.maximum(s, RANK * s[0]), 0.0)
    return Vt[:nx].T @ (inverse * (U.T @ w)), Vt[nx:].T

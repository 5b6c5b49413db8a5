"""The quadratic program of the controller, condensed and built once (eq. mpc).

With X = X_free + X_c c and V = V_free + V_c c (`_prediction`) the cost of (eq. mpc) is

    c' H c / 2 + q' c + penalty of sigma,     H = X_c' Q X_c + V_c' R V_c,
    q = X_c' Q (X_free - X_s) + V_c' R (V_free - V_s),

and its constraints are rows of (c, sigma), in this order:

               v_min - V_free  <=  V_c c          <=  v_max - V_free
    dh - diff V_free - du_max  <=  diff V_c c     <=  dh - diff V_free + du_max
               y_min - Y_free  <=  Y_c c + sigma
                                   Y_c c - sigma  <=  y_max - Y_free
                            0  <=  sigma

Here Q and R stand for all samples, P in the place of the last Q.  H and the rows never
change; the free response, h and omega move q and the bounds.  Only where a map of u
couples its limits (`_inputs`), w = K (v - F x) takes the place of v in the first two
kinds of rows, with other K and F in every program.
"""

import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov

from ..feedback import lqr
from ..feedback.checks import check_weight
from ._prediction import Prediction
from ._qp import QuadraticProgram

SCALING = 2  # iterations that balance a matrix which changes in every program
CHEAP_INPUT = 0.1  # default weight of v against y, both in standard deviations


class Weights:
    """Hold the weights of the cost and the regulator that they stand for.

    Parameters
    ----------
    plant : Plant
        Fitted model.
    model : DisturbedModel
        The same, scaled.
    Q : array_like of shape (nx, nx) or None
        Weight of the states; None means C'C with C scaled.
    R : array_like of shape (nu, nu) or None
        Weight of v, in the units of u; None means a tenth of the variances' inverse.

    Attributes
    ----------
    Q : ndarray of shape (nx, nx)
        Weight of the states.
    R : ndarray of shape (nu, nu)
        Weight of v, scaled.
    K : ndarray of shape (nu, nx)
        Gain of the regulator, in the units of u.
    P : ndarray of shape (nx, nx)
        Solution of the Riccati equation, the terminal weight.
    """

    def __init__(self, plant, model, Q, R):
        su = model.u_scale
        Q = model.C.T @ model.C if Q is None else check_weight("Q", Q, len(model.A))
        R = np.diag(CHEAP_INPUT / su**2) if R is None else R
        self.K = lqr(plant, Q, R)
        R = np.asarray(R, dtype=float)
        A_K = model.A - plant.linear()[1] @ self.K
        self.P = solve_discrete_lyapunov(A_K.T, Q + self.K.T @ R @ self.K)
        self.Q, self.R = Q, R * np.outer(su, su)


class CondensedProgram:
    """Pose and solve the program of one sample; all signals are scaled deviations.

    Parameters
    ----------
    model : DisturbedModel
        The model, for its linear part.
    weights : Weights
        Weights of the cost.
    horizon : int
        Number of samples N.
    soft : SoftBounds
        Rows with soft bounds.
    limits : ActuatorLimits
        Limits of u.
    penalty : tuple of two floats
        Linear and quadratic price of sigma.
    options : dict
        Options of `QuadraticProgram`.

    Attributes
    ----------
    prediction : Prediction
        The maps from c to X and V.
    qp : QuadraticProgram
        The solver.
    soft : SoftBounds
        Rows with soft bounds.
    price : ndarray of shape (N * n_soft,)
        Linear price of sigma.
    """

    def __init__(self, model, weights, horizon, soft, limits, penalty, options):
        n, (nx, nu) = horizon, model.B.shape
        self._shape_x, self._shape_v = (n, nx), (n, nu)
        self.soft, self._limits = soft, limits
        unstable = np.abs(np.linalg.eigvals(model.A)).max() >= 1
        K = unstable * weights.K / model.u_scale[:, None]
        self.prediction = maps = Prediction.of(model.A, model.B, K, n)
        self._X_cQ = maps.X_c.T @ block_diag(*[weights.Q] * (n - 1), weights.P)
        self._V_cR = maps.V_c.T @ np.kron(np.eye(n), weights.R)
        H = self._X_cQ @ maps.X_c + self._V_cR @ maps.V_c
        n_slack = n * len(soft.rows)
        self.price = np.full(n_slack, penalty[0])
        self._G = self._rows(maps, n_slack)
        if limits.couple:  # numbers come with every program: here, what is not zero
            before = np.kron(np.tri(n), np.ones((nu, nu)))
            n_blocks = 2 if limits.rated else 1
            self._G[: n_blocks * n * nu, : n * nu] = np.tile(before, (n_blocks, 1))
            ahead = np.vstack([np.zeros((nx, n * nu)), maps.X_c[:-nx]])
            options = {**options, "scaling": SCALING}
            self._c_maps = maps.V_c.reshape(n, nu, -1), ahead.reshape(n, nx, -1)
        self.qp = QuadraticProgram(
            block_diag((H + H.T) / 2, penalty[1] * np.eye(n_slack)), self._G, **options
        )

    def _rows(self, maps, n_slack):
        """Return the rows of the constraints, in the order of the module's text."""
        (n, nu), soft = self._shape_v, self.soft
        Y_c = np.kron(np.eye(n), soft.rows) @ maps.X_c  # (n_slack, N nu)
        eye = np.eye(n_slack)
        below, above = (np.tile(z, n) for z in (soft.below, soft.above))
        rows = [(maps.V_c, np.zeros((n * nu, n_slack)))]
        if self._limits.rated:
            difference = np.kron(np.eye(n) - np.eye(n, k=-1), np.eye(nu))
            rows.append((difference @ maps.V_c, rows[0][1]))
        rows += [
            (Y_c[below], eye[below]),
            (Y_c[above], -eye[above]),
            (np.zeros((n_slack, n * nu)), eye),
        ]
        return np.vstack([np.hstack(row) for row in rows])

    def solve(self, x, omega, rest, inputs, soft_bounds):
        """Solve the program of one sample.

        Parameters
        ----------
        x : ndarray of shape (nx,)
            State now.
        omega : ndarray of shape (N, nx)
            What the linear model lacks.
        rest : tuple of ndarray of shape (N, nx) or (1, nx), and (N, nu) or (1, nu)
            States of rest and their v.
        inputs : InputRows
            Limits of u.
        soft_bounds : tuple of two ndarray of shape (n_soft,)
            Bounds of the soft rows.

        Returns
        -------
        solution : Solution
            What the solver says.
        plan : tuple of ndarray of shape (N, nx), (N, nu) and (N, n_soft), or None
            States x_1, ..., x_N, inputs v_0, ... and excess of the soft bounds; None
            without a solution.
        """
        (X_s, V_s), n_c = rest, len(self._V_cR)
        X_free, V_free = self.prediction.free(x, omega)
        q = self._X_cQ @ (X_free.reshape(self._shape_x) - X_s).ravel()
        q += self._V_cR @ (V_free.reshape(self._shape_v) - V_s).ravel()
        W_free = V_free
        if inputs.slopes is not None:
            W_free = self._tilt(x, X_free, V_free, *inputs.slopes)
        lower, upper = (
            [bound.ravel() - W_free] for bound in (inputs.lower, inputs.upper)
        )
        if inputs.change is not None:
            free = W_free.reshape(self._shape_v)
            change = inputs.change - np.diff(free, axis=0, prepend=0)
            lower.append((change - inputs.du_max).ravel())
            upper.append((change + inputs.du_max).ravel())
        if len(self.soft.rows):
            self._bound_softly(X_free, soft_bounds, lower, upper)
        solution = self.qp.solve(
            np.concatenate([q, self.price]),
            np.concatenate(lower),
            np.concatenate(upper),
        )
        if solution.x is None:
            return solution, None
        c, slack = solution.x[:n_c], solution.x[n_c:]
        X = (X_free + self.prediction.X_c @ c).reshape(self._shape_x)
        V = (V_free + self.prediction.V_c @ c).reshape(self._shape_v)
        return solution, (X, V, slack.reshape(len(X), len(self.soft.rows)))

    def _tilt(self, x, X_free, V_free, K, F):
        """Make rows of w = K (v - F x), and return what it is for c = 0."""
        (n, nu), (V_c, X_c) = self._shape_v, self._c_maps
        size = n * nu
        rows = (K @ (V_c - F @ X_c)).reshape(size, size)
        self._G[:size, :size] = rows
        if self._limits.rated:
            self._G[size : 2 * size, :size] = rows
            self._G[size + nu : 2 * size, :size] -= rows[:-nu]
        if np.isfinite(rows).all():  # else the bounds are not, and there is no solution
            self.qp.change(G=self._G)
        X = np.vstack([x, X_free.reshape(self._shape_x)[:-1]])
        return (K @ (V_free.reshape(n, nu, 1) - F @ X[..., None])).ravel()

    def _bound_softly(self, X_free, soft_bounds, lower, upper):
        """Append the bounds of the rows with sigma."""
        Y_free = X_free.reshape(self._shape_x) @ self.soft.rows.T  # (N, n_soft)
        y_min, y_max = (bound - Y_free for bound in soft_bounds)
        below = y_min[:, self.soft.below].ravel()
        above = y_max[:, self.soft.above].ravel()
        lower += [below, np.full(above.size, -np.inf), np.zeros(Y_free.size)]
        upper += [np.full(below.size, np.inf), above, np.full(Y_free.size, np.inf)]

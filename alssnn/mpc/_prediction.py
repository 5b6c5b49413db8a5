"""The linear model over a horizon, condensed: all states from the inputs (eq. mpc).

With v_i = c_i - K x_i, where K is zero for a stable A and stabilizes an unstable one,
so that no power of it blows up,

    X = [x_1; ...; x_N] = X_x x_0 + X_c c + X_w w       V = V_x x_0 + V_c c + V_w w

for c = [c_0; ...; c_{N-1}] and the known w_0, ..., w_{N-1} of x+ = A x + B v + w.
Condensing was chosen by measurement, see `benchmarks.mpc`.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Prediction:
    """Hold the maps from (x_0, c, w) to all states and inputs of the horizon."""

    X_x: np.ndarray  # (N nx, nx)
    X_c: np.ndarray  # (N nx, N nu)
    X_w: np.ndarray  # (N nx, N nx)
    V_x: np.ndarray  # (N nu, nx)
    V_c: np.ndarray  # (N nu, N nu)
    V_w: np.ndarray  # (N nu, N nx)

    @classmethod
    def of(cls, A, B, K, horizon):
        """Condense x+ = A x + B v + w with v = c - K x.

        Parameters
        ----------
        A : ndarray of shape (nx, nx)
            State matrix.
        B : ndarray of shape (nx, nu)
            Input matrix.
        K : ndarray of shape (nu, nx)
            Gain; zero for none.
        horizon : int
            Number of samples N.

        Returns
        -------
        prediction : Prediction
            The maps.
        """
        nx, nu = B.shape
        A_K, eye = A - B @ K, np.eye(horizon)
        powers = [np.eye(nx)]
        for _ in range(horizon):
            powers.append(A_K @ powers[-1])
        X_x = np.vstack(powers[1:])
        X_w = np.zeros((horizon * nx, horizon * nx))
        for i in range(horizon):
            X_w += np.kron(np.eye(horizon, k=-i), powers[i])
        X_c = X_w @ np.kron(eye, B)
        # x_0, ..., x_{N-1}: the states above, one sample later
        gain = np.kron(np.eye(horizon, k=-1), K)  # (N nu, N nx)
        V_x = -gain @ X_x
        V_x[:nu] = -K
        V_c, V_w = np.eye(horizon * nu) - gain @ X_c, -gain @ X_w
        return cls(X_x, X_c, X_w, V_x, V_c, V_w)

    def free(self, x0, w):
        """Return the states and inputs for c = 0.

        Parameters
        ----------
        x0 : ndarray of shape (nx,)
            State now.
        w : ndarray of shape (N, nx)
            Known part of the state equation.

        Returns
        -------
        X : ndarray of shape (N * nx,)
            States x_1, ..., x_N.
        V : ndarray of shape (N * nu,)
            Inputs v_0, ..., v_{N-1}.
        """
        w = w.ravel()
        return self.X_x @ x0 + self.X_w @ w, self.V_x @ x0 + self.V_w @ w

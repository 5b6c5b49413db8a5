"""Measures of what nonlinearity is left once h is cancelled.

The paper's figures compare norms in state coordinates, |g| / |A x + B u| and
|h| / |A x + B u|.  They depend on the basis of the states: training can shrink |g| in
directions that a non-normal A amplifies again on the way to the output.  The
output-referred residual (eq. gauge)

    zeta+ = A zeta + g(x, u),   e = C zeta,     linearization error = rms(e) / rms(y)

does not: e is what g adds to the output, exactly, in any basis.  Everything here is
computed along a simulated trajectory.
"""

from dataclasses import dataclass

import numpy as np

from .lure import Lure
from .simulation import simulate


@dataclass(frozen=True, eq=False)
class Linearizability:
    """Report how much nonlinearity is left when h is cancelled.

    Parameters
    ----------
    linearization_error : ndarray of shape (ny,)
        Ratio rms(e) / rms(y) per output, y as deviation from the operating point.
    ratio_g_mean, ratio_g_max : float
        Mean and maximum over time of ``|g| / |A x + B u|``, in the state basis.
    ratio_h_mean, ratio_h_max : float
        Mean and maximum over time of ``|h| / |A x + B u|``, h in the units of u.
    spectral_radius : float
        Largest modulus of the eigenvalues of A.
    """

    linearization_error: np.ndarray
    ratio_g_mean: float
    ratio_g_max: float
    ratio_h_mean: float
    ratio_h_max: float
    spectral_radius: float

    def __str__(self):
        """Return a small table."""
        errors = ", ".join(f"{100 * e:.3g} %" for e in self.linearization_error)
        rows = [
            ("linearization error rms(e)/rms(y)", errors),
            (
                "|g|/|Ax+Bu| mean, max",
                f"{self.ratio_g_mean:.3g}, {self.ratio_g_max:.3g}",
            ),
            (
                "|h|/|Ax+Bu| mean, max",
                f"{self.ratio_h_mean:.3g}, {self.ratio_h_max:.3g}",
            ),
            ("spectral radius of A", f"{self.spectral_radius:.6f}"),
        ]
        return "\n".join(f"{name:35s}{value}" for name, value in rows)


def output_residual(A, C, g):
    """Return the part of the output that g makes (eq. gauge).

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    g : ndarray of shape (N, nx)
        Residual nonlinearity along a trajectory.

    Returns
    -------
    e : ndarray of shape (N, ny)
        Output-referred residual; inf where it diverges.
    """
    nx = len(A)
    # a Lur'e form without neurons whose input is g itself
    Theta = np.hstack([A, np.eye(nx), np.zeros((nx, 1))])
    zeta = simulate(Lure(Theta, nx, nx, 0), g, np.zeros(nx))[:-1]
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(zeta).all(axis=1)[:, None], zeta @ C.T, np.inf)


def measure(A, B, C, trajectories):
    """Measure linearizability along trajectories of one or several experiments.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    B : ndarray of shape (nx, nu)
        Input matrix, in the user's units of u.
    C : ndarray of shape (ny, nx)
        Output matrix, in the user's units of y.
    trajectories : sequence of tuple of ndarray
        Tuples (X, u, y, h, g) of shapes (N, nx), (N, nu), (N, ny), (N, nu), (N, nx):
        states, deviations of inputs and measured outputs, values of h and g.

    Returns
    -------
    record : Linearizability
        Ratios over all samples of all experiments; inf if a trajectory diverges.
    """
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    if not all(np.isfinite(g).all() for *_, g in trajectories):
        error, nothing = np.full(len(C), np.inf), np.inf
        return Linearizability(error, nothing, nothing, nothing, nothing, radius)
    linear, size_h, size_g, square_e, square_y = [], [], [], 0.0, 0.0
    for X, u, y, h, g in trajectories:
        linear.append(np.linalg.norm(X @ A.T + u @ B.T, axis=1))
        size_h.append(np.linalg.norm(h, axis=1))
        size_g.append(np.linalg.norm(g, axis=1))
        square_e = square_e + np.sum(output_residual(A, C, g) ** 2, axis=0)
        square_y = square_y + np.sum(y**2, axis=0)
    # a sample at rest has no linear part: keep its ratio finite
    linear = np.maximum(np.concatenate(linear), np.finfo(float).tiny)
    ratio_g = np.concatenate(size_g) / linear
    ratio_h = np.concatenate(size_h) / linear
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.sqrt(np.where(square_e == 0, 0.0, square_e / square_y))
    return Linearizability(
        linearization_error=error,
        ratio_g_mean=float(ratio_g.mean()),
        ratio_g_max=float(ratio_g.max()),
        ratio_h_mean=float(ratio_h.mean()),
        ratio_h_max=float(ratio_h.max()),
        spectral_radius=radius,
    )

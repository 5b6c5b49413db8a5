"""Linear controllers in a loop: they work on deviations, the signals do not.

`LinearController` is the one place where the operating point enters and leaves.  It is
made from a gain, with or without integrators, or from a linear system.
"""

from dataclasses import dataclass

import control
import numpy as np

from ..checks import as_numbers
from ..shown import short_repr
from .checks import check_dt


@dataclass(frozen=True, eq=False)
class LinearController:
    """Hold a linear controller that works on deviations.

    Its state is z, its inputs are r, y, x_hat and cut, its output is v:
    z+ = A z + B e, v = v_offset + C z + D e with e = (r, y, x_hat, cut) - offset. Only
    a controller by gain has x_hat, and only one with integrators has cut, the part of
    v that the limits cut off.

    Parameters
    ----------
    A, B, C, D : ndarray
        Matrices.
    offset : ndarray of shape (n_inputs,)
        Operating point of the inputs.
    v_offset : ndarray of shape (nu,)
        Operating point of the output.
    """

    __repr__ = short_repr

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    offset: np.ndarray
    v_offset: np.ndarray

    def update(self, t, z, signals, params):
        """Return the next state, for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        z : ndarray of shape (nz,)
            State of the controller.
        signals : ndarray of shape (n_inputs,)
            The inputs.
        params : dict
            Not used.

        Returns
        -------
        z_next : ndarray of shape (nz,)
            State one sample later.
        """
        return self.A @ z + self.B @ (signals - self.offset)

    def output(self, t, z, signals, params):
        """Return v, for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        z : ndarray of shape (nz,)
            State of the controller.
        signals : ndarray of shape (n_inputs,)
            The inputs.
        params : dict
            Not used.

        Returns
        -------
        v : ndarray of shape (nu,)
            Input of the linear system.
        """
        return self.v_offset + self.C @ z + self.D @ (signals - self.offset)


def split_gain(gain, plant):
    """Return the parts of a gain that act on the states and on the integrators.

    Parameters
    ----------
    gain : array_like of shape (nu, nx) or (nu, nx + ny)
        Gain, as for `closed_loop`.
    plant : Plant
        Model that it was designed for, without delays (`Plant.late`).

    Returns
    -------
    K_x : ndarray of shape (nu, nx)
        Gain of the states.
    K_z : ndarray of shape (nu, ny) or (nu, 0)
        Gain of the integrators, if there are any.

    Raises
    ------
    ValueError
        If the gain has the wrong shape or is not finite.
    """
    nx, nu, ny = plant.nx, plant.nv, plant.ny
    K = as_numbers("gain", gain)
    if K.shape not in [(nu, nx), (nu, nx + ny)] or not np.isfinite(K).all():
        raise ValueError(
            f"`gain` must be finite and have shape ({nu}, {nx}) or ({nu}, {nx + ny}), "
            f"got shape {K.shape}. Use `lqr`, `place` or `lqi`."
        )
    return K[:, :nx], K[:, nx:]


def back_calculation(K_z):
    """Return what takes the part cut off v out of the integrators, against windup.

    Parameters
    ----------
    K_z : ndarray of shape (nu, ny)
        Gain of the integrators, v = ... - K_z z.

    Returns
    -------
    back : ndarray of shape (ny, nu)
        Gain of z+ = z + y - r + back cut.
    """
    return np.linalg.pinv(K_z)


def from_gain(gain, plant):
    """Return the controller of a gain, and whether r is a reference of y.

    Parameters
    ----------
    gain : array_like of shape (nu, nx) or (nu, nx + ny)
        Gain, as for `closed_loop`.
    plant : Plant
        Model that it was designed for, without delays (`Plant.late`).

    Returns
    -------
    controller : LinearController
        The controller, with inputs (r, y, x_hat), and cut if it has integrators.
    of_y : bool
        Whether r has the units of y rather than those of u.

    Raises
    ------
    ValueError
        If the gain has the wrong shape or is not finite.
    """
    nx, nu, ny = plant.nx, plant.nv, plant.ny
    K_x, K_z = split_gain(gain, plant)
    if not K_z.size:
        D = np.hstack([np.eye(nu), np.zeros((nu, ny)), -K_x])
        offset = np.concatenate([plant.v_offset, plant.y_offset, np.zeros(nx)])
        empty = np.zeros((0, 0)), np.zeros((0, D.shape[1])), np.zeros((nu, 0))
        return LinearController(*empty, D, offset, plant.v_offset), False
    back = back_calculation(K_z)
    B = np.hstack([-np.eye(ny), np.eye(ny), np.zeros((ny, nx)), back])
    D = np.hstack([np.zeros((nu, 2 * ny)), -K_x, np.zeros((nu, nu))])
    offset = np.concatenate([plant.y_offset, plant.y_offset, np.zeros(nx + nu)])
    matrices = np.eye(ny), B, -K_z, D
    return LinearController(*matrices, offset, plant.v_offset), True


def from_system(system, plant):
    """Return the controller of a linear system with inputs (r, y) or r - y.

    Parameters
    ----------
    system : control.StateSpace or control.TransferFunction
        The `controller` of `closed_loop`.
    plant : Plant
        Model that it was designed for, without delays (`Plant.late`).

    Returns
    -------
    controller : LinearController
        The controller, with inputs (r, y).

    Raises
    ------
    TypeError
        If it is no linear system.
    ValueError
        If sizes or sampling times do not fit, or it is continuous in time.
    """
    nu, ny = plant.nv, plant.ny
    if not isinstance(system, control.StateSpace | control.TransferFunction):
        raise TypeError(
            "`controller` must be a StateSpace or TransferFunction, got "
            f"{type(system).__name__}. Give a matrix as `gain`."
        )
    check_dt("controller", system, plant.dt)
    sys = control.ss(system)
    if sys.noutputs != nu or sys.ninputs not in (ny, 2 * ny):
        raise ValueError(
            f"`controller` must have {nu} outputs and {ny} inputs (r - y) or {2 * ny} "
            f"(r, y), got {sys.noutputs} and {sys.ninputs}. Design it on "
            "`model.to_statespace()`."
        )
    B, D = sys.B, sys.D
    if sys.ninputs == ny:
        B, D = np.hstack([B, -B]), np.hstack([D, -D])
    offset = np.concatenate([plant.y_offset, plant.y_offset])
    return LinearController(sys.A, B, sys.C, D, offset, plant.v_offset)

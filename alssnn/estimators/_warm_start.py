"""Whether a fit can go on from the last one."""

import numpy as np

from ..innovations import free_run, state_matrix
from ..limits import Limits
from ._integrators import regular, with_integrators


def fits(estimator, previous):
    """Tell whether a fitted model is one that the options ask for.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    previous : tuple of (Structure, ndarray)
        Structure of the last fit, as training saw it, and its parameters.

    Returns
    -------
    fits : bool
        Whether the training may start there.
    """
    structure, theta = previous
    phi, radius = estimator._phi, estimator._radius
    nx, nu, ny = structure.sizes["x"], free_run(structure).nu, structure.sizes["y"]
    if not estimator._allows(nx) or "C" not in structure.constants:  # the linear model
        return False
    wanted = estimator.declare(nx, nu, ny, structure.constants["C"])
    if not np.array_equal(wanted.given, structure.given):
        return False
    A = regular(estimator, state_matrix(structure, structure.split(theta)))
    if phi is not None and A.size and not np.linalg.norm(A, 2) < np.sqrt(1 - phi):
        return False  # no contraction of this rate
    poles = np.abs(np.linalg.eigvals(A))
    if radius is not None and poles.max(initial=0.0) > radius:
        return False
    if wanted.shapes != structure.shapes or wanted.activations != structure.activations:
        return False
    held = with_integrators(estimator, estimator._held_weights(structure), structure)
    # else its networks saw more
    return bool(np.all(Limits(structure, bounds=held).clip(theta) == theta))

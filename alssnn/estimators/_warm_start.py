"""Whether a fit can go on from the last one, and with which predictors."""

import numpy as np

from ..innovations import free_run, state_matrix
from ..limits import Limits
from ._integrators import regular, with_integrators
from ._noise import MEASURED, PREDICTED, is_predicting


def goes_on(estimator, previous):
    """Tell whether a fit goes on from the last one.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit, with what the last one has left.
    previous : tuple of (Structure, ndarray) or None
        Structure of the last fit, as training saw it, and its parameters.

    Returns
    -------
    goes_on : bool
        Whether it `fits`, and has networks: a search that left the linear model is
        repeated.
    """
    decay = estimator._decay
    left = estimator.alpha == "auto" and decay and not np.isfinite(decay["alpha"])
    return previous is not None and not left and fits(estimator, previous)


def same_point(one, other):
    """Tell whether two choices of an operating point are the same.

    Parameters
    ----------
    one, other : str or tuple of array_like
        The option `operating_point` of two fits.

    Returns
    -------
    same : bool
        Whether they are.
    """
    if isinstance(one, str) or isinstance(other, str):
        return isinstance(one, str) and isinstance(other, str) and one == other
    return all(
        np.array_equal(np.atleast_1d(a), np.atleast_1d(b))
        for a, b in zip(one, other, strict=True)
    )


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
    if wanted.options.get("h_sees") != structure.options.get("h_sees"):
        return False  # of the same shapes
    held = with_integrators(estimator, estimator._held_weights(structure), structure)
    # else its networks saw more
    return bool(np.all(Limits(structure, bounds=held).clip(theta) == theta))


def forms(estimator, previous):
    """Return what h may see in the predictors that are to compete.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit, with what the last one has left.
    previous : tuple of (Structure, ndarray) or None
        Structure and parameters from which a fit goes on.

    Returns
    -------
    forms : list of str
        One or two of "measured" and "predicted"; a fit that goes on keeps to what the
        one before has chosen.
    """
    choice = getattr(estimator, "h_sees", PREDICTED)
    sees_y = getattr(estimator, "n_h", 0) != 0 and estimator.feedback == "output"
    if not is_predicting(estimator) or not sees_y:
        return [PREDICTED]
    if choice != "auto":
        return [choice]
    has_chosen = hasattr(estimator, "h_sees_") and goes_on(estimator, previous)
    return [estimator.h_sees_] if has_chosen else [MEASURED, PREDICTED]

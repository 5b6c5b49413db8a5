"""What is linear of a model, and what is left to h (eq. split, best).

For any L, h(s) - L s with A + B L S in the place of A is the same model, where s = S x
is what h sees.  Equations say which of these they are by a constant, L.
"""

from dataclasses import replace

from .structures import Factor, Matrix, Signal, Term

NAME = "L"


def is_split(structure):
    """Tell whether a linear part of h has been moved to A.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    is_split : bool
        Whether it has the constant L.
    """
    return NAME in structure.constants


def seen_axis(structure):
    """Return what h sees of the model.

    Parameters
    ----------
    structure : Structure
        Structure of a model with h.

    Returns
    -------
    axis : str
        The state, or the measured signal.
    """
    of_x = structure.options["feedback"] == "state"
    return next(iter(structure.updates)) if of_x else structure.measured


def with_linear(structure, L):
    """Return the equations with h(s) - L s in the place of h(s).

    Parameters
    ----------
    structure : Structure
        Structure of a model with h, which has not been split.
    L : ndarray of shape (nv, ns)
        What is moved.

    Returns
    -------
    structure : Structure
        The same parameters, and a constant L.
    """
    h, axis = structure.signals["h"], seen_axis(structure)
    axes = h.axes[0], axis
    moved = Matrix(axes, L.shape, (Term("", (Factor(NAME),)),))
    s = Signal((axis,), (structure.sizes[axis],), (Term(axis),))
    return replace(
        structure,
        signals={**structure.signals, "h": h - moved @ s},
        constants={**structure.constants, NAME: L},
        constant_axes={**structure.constant_axes, NAME: axes},
    )


def without_linear(structure):
    """Return the equations before something was moved.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    structure : Structure
        The same parameters, without the constant L.
    """
    if not is_split(structure):
        return structure
    h, named = structure.signals["h"], (Factor(NAME),)
    kept = tuple(term for term in h.terms if term.factors != named)
    axes, constants = dict(structure.constant_axes), dict(structure.constants)
    del axes[NAME], constants[NAME]
    return replace(
        structure,
        signals={**structure.signals, "h": replace(h, terms=kept)},
        constants=constants,
        constant_axes=axes,
    )


def moved(structure, theta, L):
    """Return parameters of the same model where L s is no longer a part of h.

    Parameters
    ----------
    structure : Structure
        Structure of a model with h.
    theta : ndarray of shape (n_params,)
        Its parameters.
    L : ndarray of shape (nv, ns)
        What is moved from h to A.

    Returns
    -------
    theta : ndarray of shape (n_params,)
        With A + B L S.
    """
    p = structure.split(theta)
    of_y = seen_axis(structure) == structure.measured
    LS = L @ structure.constants["C"] if of_y else L
    return structure.join({**p, "A": p["A"] + p["B"] @ LS})  # (eq. split)


def as_trained(structure, theta):
    """Return a model as its training knows it: nothing is moved.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    theta : ndarray of shape (n_params,)
        Its parameters.

    Returns
    -------
    structure : Structure
        Structure without L.
    theta : ndarray of shape (n_params,)
        Parameters of the same model.
    """
    if not is_split(structure):
        return structure, theta
    theta = moved(structure, theta, -structure.constants[NAME])
    return without_linear(structure), theta

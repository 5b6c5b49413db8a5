"""Two views of one model with innovations: its predictor, and its free run.

With process noise, or feedback in the record, a model is fitted by its errors one
sample ahead (eq. innovations),

    x+ = A x + B v + g(x, u) + K eps,    eps = y_m - y,    v = u + h(y_m)  or  u + h(y)

where y_m is what was measured.  The *predictor* has y_m as a further input.  In *free
run* nothing is measured: y takes the place of y_m, and eps vanishes.  Both are the
same equations with the same parameters; the second is the model without noise, for
simulation, laws and certificates.
"""

from dataclasses import replace

import numpy as np

from .experiments import Filled
from .structures import Signal, Term

MEASURED, INNOVATION = "y_m", "eps"  # axis of the input, and signal


def has_innovations(structure):
    """Tell whether a structure has a gain K of innovations.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    has : bool
        Whether it is one view of a model with innovations.
    """
    return INNOVATION in structure.signals


def predictor(structure):
    """Return the view of a structure that sees what was measured.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    structure : Structure
        The same equations, whose last inputs are the measured outputs; the structure
        itself if it has no innovations.
    """
    if not has_innovations(structure) or MEASURED in structure.inputs:
        return structure
    y = structure.signals[structure.measured]
    eps = (Term(MEASURED), Term(structure.measured, gain=-1.0))
    signals = {**structure.signals, INNOVATION: Signal(y.axes, y.shape, eps)}
    del signals[MEASURED]
    return replace(structure, inputs=(*structure.inputs, MEASURED), signals=signals)


def free_run(structure):
    """Return the view of a structure to which no output is told.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    structure : Structure
        The same equations with y in the place of y_m; the structure itself if it has
        no innovations.
    """
    if not has_innovations(structure) or MEASURED not in structure.inputs:
        return structure
    y = structure.signals[structure.measured]
    told = Signal(y.axes, y.shape, (Term(structure.measured),))
    nothing = Signal(y.axes, y.shape)
    signals = {**structure.signals, MEASURED: told, INNOVATION: nothing}
    inputs = tuple(axis for axis in structure.inputs if axis != MEASURED)
    return replace(structure, inputs=inputs, signals=signals)


def with_outputs(experiments):
    """Return the experiments of a predictor: what was measured is an input, too.

    Parameters
    ----------
    experiments : iterable of tuple of array
        Pairs (u, y) of scaled deviations; nan where y was not measured.

    Returns
    -------
    experiments : list of tuple of ndarray
        Pairs ([u, y_m], y). Gaps of y_m are bridged by straight lines.
    """
    return [(np.hstack([u[:], Filled(y)[:]]), y) for u, y in experiments]


def state_matrix(structure, p):
    """Return the matrix that carries the error of an estimate of the states.

    Parameters
    ----------
    structure : Structure
        Structure of a model with a fixed C.
    p : dict of str to ndarray
        Its parameters.

    Returns
    -------
    A : ndarray of shape (nx, nx)
        A - K C of a model with innovations; else A.
    """
    if not has_innovations(structure):
        return p["A"]
    return p["A"] - p["K"] @ structure.constants["C"]

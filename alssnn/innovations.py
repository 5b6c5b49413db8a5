"""Three views of one model with innovations: predictor, free run, and record.

With process noise, or feedback in the record, a model is fitted by its errors one
sample ahead (eq. innovations),

    x+ = A x + B v + g(x, u) + K eps,    eps = y_m - y,    v = u + h(y_m)  or  u + h(y)

where y_m is what was measured.  The *predictor* has y_m as a further input.  In *free
run* nothing is measured: y takes the place of y_m, and eps vanishes.  For a *record*
eps is drawn, and y_m = y + eps.  All are the same equations with the same parameters;
the free run is the model without noise, for simulation, laws and certificates.

A random walk that nobody measured may be declared, b+ = b + K_b eps, and is added to
the output or to the inputs that are moved (eq. drift).  In free run it is zero.
"""

from dataclasses import replace

import numpy as np

from .experiments import Filled
from .structures import Signal, Term

MEASURED, INNOVATION = "y_m", "eps"  # axis of the input, and signal
DRIFT, LEVEL = "drift", "b"  # signal, and the state that it is where it moves


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


def drift_of(structure):
    """Return where a model has a random walk.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    drift : {"output", "input"} or None
        What b is added to; None for a model without.
    """
    return structure.options.get("drift") if DRIFT in structure.signals else None


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
    signals = {**_drifting(structure), INNOVATION: Signal(y.axes, y.shape, eps)}
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
    if DRIFT in signals:  # b stays where it starts, at zero
        signals[DRIFT] = replace(signals[DRIFT], terms=())
    inputs = tuple(axis for axis in structure.inputs if axis != MEASURED)
    return replace(structure, inputs=inputs, signals=signals)


def recording(structure):
    """Return the view of a structure whose innovations are given.

    Parameters
    ----------
    structure : Structure
        Structure of a model with innovations.

    Returns
    -------
    structure : Structure
        The same equations with eps as last inputs, and y_m = y + eps.
    """
    structure = free_run(structure)
    y = structure.signals[structure.measured]
    told = Signal(y.axes, y.shape, (Term(structure.measured), Term(INNOVATION)))
    signals = {**_drifting(structure), MEASURED: told}
    del signals[INNOVATION]
    inputs = (*structure.inputs, INNOVATION)
    return replace(structure, inputs=inputs, signals=signals)


def _drifting(structure):
    """Return the signals with the state b where it is added."""
    signals = dict(structure.signals)
    if DRIFT in signals:
        signals[DRIFT] = replace(signals[DRIFT], terms=(Term(LEVEL),))
    return signals


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
        Structure of a model.
    p : dict of str to ndarray
        Its parameters.

    Returns
    -------
    A : ndarray of shape (nx, nx)
        A - K C of a model with innovations; else A.
    """
    if not has_innovations(structure):
        return p["A"]
    return p["A"] - p["K"] @ output_matrix(structure, p)


def error_matrix(structure, p):
    """Return the matrix that carries the error of an estimate of states and drift.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    p : dict of str to ndarray
        Its parameters.

    Returns
    -------
    A : ndarray of shape (nx + nb, nx + nb)
        That of [x; b] (eq. drift); `state_matrix` for a model without drift.
    """
    A, kind = state_matrix(structure, p), drift_of(structure)
    if kind is None:
        return A
    C, K_b = output_matrix(structure, p), p["K_b"]
    eye = np.eye(len(K_b))
    if kind == "output":
        return np.block([[A, -p["K"]], [-K_b @ C, eye - K_b]])
    D = p.get("D", np.zeros((len(C), len(K_b))))
    return np.block([[A, p["B"] - p["K"] @ D], [-K_b @ C, eye - K_b @ D]])


def output_matrix(structure, p):
    """Return the output matrix, a constant or a parameter.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    p : dict of str to ndarray
        Its parameters.

    Returns
    -------
    C : ndarray of shape (ny, nx)
        Output matrix.
    """
    return p["C"] if "C" in p else structure.constants["C"]

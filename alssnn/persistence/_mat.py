"""Models for MATLAB and Simulink: one struct of matrices, networks and names."""

import numpy as np

from ._archive import release
from ._parts import Parts

LAYER = [("W", object), ("b", object)]  # fields of the struct array of layers


def to_mat(model, path, *, law=None, observer=None, gain=None):
    """Write a fitted model, its law, observer and controller as a MAT-file.

    Parameters
    ----------
    model : estimator
        Fitted model.
    path : str or path-like
        File; one that exists is replaced.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer()``, False leaves it
        out.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of a controller, as for `feedback.closed_loop`.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If the file cannot be written.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, or an activation is the user's.
    """
    from scipy.io import savemat

    parts = Parts.of(model, law, observer, gain)
    nothing = np.zeros((0, 0))  # isempty() tells
    struct = {
        "name": parts.name,
        "version": f"alssnn {release()}",
        "dt": parts.dt,
        **{name: getattr(parts, name) for name in "ABCD"},
        **{net: _net(parts.nets.get(net), nothing) for net in "hgk"},
        "feedback": parts.feedback,
        "input_delay": _column(parts.delay),
        "u_offset": _column(parts.u_offset),
        "y_offset": _column(parts.y_offset),
        "u_scale": _column(model._scaling.u_scale),
        "y_scale": _column(model._scaling.y_scale),
        "x0": model.x0_,
        "inputs": _cell(parts.inputs),
        "outputs": _cell(parts.outputs),
        "law": nothing
        if parts.law is None
        else {"u_min": _column(parts.law.u_min), "u_max": _column(parts.law.u_max)},
        "M": nothing if parts.M is None else parts.M,
        "K_x": nothing if parts.K_x is None else parts.K_x,
        "K_z": parts.K_z if parts.integrates else nothing,
    }
    with open(path, "wb") as file:
        savemat(file, {"model": struct})


def _net(perceptron, nothing):
    """Return a network as a struct of its activation and a struct array of layers."""
    if perceptron is None:
        return nothing
    layers = np.empty((1, len(perceptron.layers)), dtype=LAYER)
    for i, (W, b) in enumerate(perceptron.layers):
        layers[0, i] = W, _column(b)
    return {"activation": perceptron.activation.name, "layers": layers}


def _column(vector):
    return np.asarray(vector, dtype=float)[:, None]


def _cell(names):
    cell = np.empty((len(names), 1), dtype=object)
    cell[:, 0] = names
    return cell

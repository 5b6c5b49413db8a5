"""Models for MATLAB and Simulink: one struct of matrices, Lur'e forms and names."""

import io

import numpy as np

from ..whole_files import replace_file
from ._archive import release
from ._export import Export

UNITS = ("u_offset", "y_offset", "u_scale", "y_scale")
BLOCKS = ("M", "W", "c", "V", "E", "b")  # of Theta (eq. lure)
LAYER = [(name, object) for name in ("first", "last", "activation", "value", "slope")]


def to_mat(model, path, *, law=None, observer=None, gain=None):
    """Write a fitted model, its law, observer and controller as a MAT-file.

    Parameters
    ----------
    model : estimator, Plant or LinearizingController
        Fitted model, or its `plant_`; or a controller, which has all the parts below.
    path : str or path-like
        File; one that exists is replaced.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer(gate=100)``, whose
        gate keeps spikes of a sensor small; False leaves it out.
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
        If an argument does not fit the model, or an activation has no expression for
        MATLAB.
    """
    from scipy.io import savemat

    export = Export.of(model, law, observer, gain)
    plant, law = export.plant, export.law
    arrived = plant.arrived()
    (A, B, C, D), (G, H) = arrived.linear(), arrived.disturbed_by()
    nothing = np.zeros((0, 0))  # isempty() tells
    struct = {
        "name": plant.name,
        "version": f"alssnn {release()}",
        "dt": plant.dt,
        "hold": export.held,
        "A": A,
        "B": B,
        "C": C,
        "D": D,
        "G": G,
        "H": H,
        "disturbances": _column(plant.given) + 1,
        "lure": _form(export.late.form),
        "feedback": plant.feedback,
        "input_delay": _column(plant.delay),
        **{name: _column(getattr(plant, name)) for name in UNITS},
        "x0": getattr(model, "x0_", nothing),
        "inputs": _cell(plant.inputs),
        "outputs": _cell(plant.outputs),
        "law": nothing
        if law is None
        else {
            # h of [s; d], or phi of [s; d; u] where the law solves v = phi(u, s, d)
            "h": nothing if plant.is_solved else _form(export.h),
            "phi": _form(plant.solved_map.form) if plant.is_solved else nothing,
            # s of [x; d; v] where the law looks half a sample ahead
            "middle": plant.middle.matrix if plant.looks_ahead else nothing,
            "u_min": _column(law.u_min),
            "u_max": _column(law.u_max),
        },
        "K": nothing if plant.K is None else plant.K,
        "K_b": nothing if plant.K_b is None else plant.K_b,
        "M": nothing if export.M is None else export.M,
        "gate": nothing if export.gate is None else _column(export.gate),
        "K_x": nothing if export.K_x is None else export.K_x,
        "K_z": export.K_z if export.integrates else nothing,
    }
    content = io.BytesIO()
    savemat(content, {"model": struct})
    replace_file(path, content.getvalue())


def _form(lure):
    """Return the blocks of a Lur'e form, and its layers as a struct array."""
    layers = np.empty((1, len(lure.layers)), dtype=LAYER)
    for i, layer in enumerate(lure.layers):
        sigma = lure.sigma[layer.start]
        ends = layer.start + 1, layer.stop
        value = sigma.expression("matlab", v="v")
        layers[0, i] = *ends, sigma.name, value, _slope(sigma)
    blocks = {name: getattr(lure, name) for name in BLOCKS}
    blocks |= {name: _column(blocks[name]) for name in "cb"}
    return {"nx": lure.nx, "nu": lure.nu, **blocks, "layers": layers}


def _slope(sigma):
    """Return the derivative at v, where w is the value."""
    if "matlab_slope" in sigma.expressions:
        return sigma.expression("matlab_slope", v="v", w="w")
    # of an activation that says nothing of its derivative
    ahead = sigma.expression("matlab", v="(v + 1e-8 * (1 + abs(v)))")
    return f"(({ahead}) - w) ./ (1e-8 * (1 + abs(v)))"


def _column(vector):
    return np.asarray(vector, dtype=float)[:, None]


def _cell(names):
    cell = np.empty((len(names), 1), dtype=object)
    cell[:, 0] = names
    return cell

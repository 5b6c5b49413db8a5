"""Models and controllers for Simulink: a script that builds the diagram.

The numbers are those of `to_mat`, and the blocks call the functions for MATLAB
(templates ``*.m``), so that no equation is written twice.
"""

from importlib.resources import files

import numpy as np

from ..whole_files import as_path, write_files
from ._c_map import Numbers
from ._export import Export
from ._mat import to_mat
from ._parts import Parts, check_prefix, fill

FUNCTIONS = (
    *("channels", "law_alssnn", "solve_alssnn"),
    *("correct_alssnn", "control_alssnn", "simulate_alssnn"),
)
OWN = ("build_plant", "plant_data", "plant_step", "plant_respond")


def to_simulink(
    model, directory, *, law=None, observer=None, gain=None, prefix="plant"
):
    """Write a fitted model and its controller as a script for Simulink.

    Parameters
    ----------
    model : estimator, Plant or LinearizingController
        Fitted model, or its `plant_`; or a controller, which has all the parts below.
    directory : str or path-like
        Folder, made if need be; files of the same names are replaced.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer(gate=100)``, False
        leaves it out.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of a controller, as for `feedback.closed_loop`.
    prefix : str, default="plant"
        Begins the names of files and functions.

    Returns
    -------
    paths : list of Path
        The script ``build_{prefix}.m`` first, then the data ``{prefix}.mat`` and the
        functions that the blocks call.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If a file cannot be written.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, or an activation has no expression in
        MATLAB.

    Notes
    -----
    The blocks are of the kind Interpreted MATLAB Function: they simulate, and generate
    no code. For code, take `to_c`, `to_st` or `to_fmu`.
    """
    check_prefix(prefix, "MATLAB")
    export = Export.of(model, law, observer, gain)
    parts = Parts(export, first=1)
    sizes, plant = parts.sizes, parts.plant
    nw = sizes["state"] + sizes["z"]
    inputs = {name: sizes[name] for name in "ryd" if sizes[name]}
    blanks = {
        **parts.blanks(Numbers("double")),
        "prefix": prefix,
        "nw": nw,
        "ncontrolled": plant.nv + nw,
        "law_d": ", d" if plant.nd else "",
        "controller_inputs": ", ".join(f"'{name}'" for name in inputs),
        "controller_sizes": " ".join(map(str, [nw, *inputs.values()])),
        "order": " ".join(str(i + 1) for i in np.argsort([*plant.moved, *plant.given])),
    }
    names = [*OWN, "plant_control"] if parts.flags["CONTROL"] else OWN
    texts = {
        f"{name.replace('plant', prefix)}.m": fill(
            f"{name}.m", prefix, parts.flags, blanks
        )
        for name in names
    }
    templates = files(__package__) / "templates"
    for name in FUNCTIONS:
        texts[f"{name}.m"] = (templates / f"{name}.m").read_text("ascii")
    folder = as_path("directory", directory)
    folder.mkdir(parents=True, exist_ok=True)
    data = folder / f"{prefix}.mat"
    to_mat(model, data, law=law, observer=observer, gain=gain)
    script, *others = write_files(folder, texts)
    return [script, data, *others]

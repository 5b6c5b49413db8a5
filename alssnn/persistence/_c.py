"""Models in C99: fixed sizes, no allocation, nothing beyond math.h.

What is the same for all models stands in `templates`, as C, with two kinds of blanks:
lines between ``#if FLAG`` and ``#endif`` are written for models that need them, and
``$name`` is a number or a text.  The maps of a model are functions of their own
(`_c_map`).  What is compiled is compared with Python in the tests, step by step.
"""

import re
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np

from ..walk import static_map, walk
from ..whole_files import replace_file
from ._archive import release
from ._c_law import Inverse
from ._c_map import SUFFIX, Function, Numbers, Slope
from ._c_test import SAMPLES, vectors
from ._export import Export

TEMPLATES = {
    "plant.h": "{}.h",
    "plant.c": "{}.c",
    "plant_demo.c": "{}_demo.c",
    "plant_test.c": "{}_test.c",
    "Makefile": "Makefile",
    "README.md": "README.md",
}


def to_c(
    model,
    directory,
    *,
    law=None,
    observer=None,
    gain=None,
    dtype="double",
    prefix="plant",
):
    """Write a fitted model, its law, observer and controller as C sources.

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
        Observer with constant gain; None takes ``model.observer(gate=100)``, whose
        gate keeps spikes of a sensor small; False leaves it out.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of a controller, as for `feedback.closed_loop`.
    dtype : {"double", "float"}, default="double"
        Type of all numbers.
    prefix : str, default="plant"
        Begins the names of files, functions and types.

    Returns
    -------
    paths : list of Path
        The files.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If a file cannot be written.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, a value is beyond the range of `dtype`,
        or an activation has no expression in C.
    """
    if dtype not in SUFFIX:
        raise ValueError(f"`dtype` must be 'double' or 'float', got {dtype!r}.")
    if not isinstance(prefix, str) or not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", prefix):
        raise ValueError(
            "`prefix` must begin with a letter and consist of letters, digits and _, "
            f"got {prefix!r}. It begins names in C."
        )
    export = Export.of(model, law, observer, gain)
    known = vectors(export, Numbers(dtype)).replace("plant_real", f"{prefix}_real")
    values = {"vectors": known, "samples": SAMPLES}
    texts = sources(export, TEMPLATES, dtype, prefix, values=values)
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    for name, content in texts.items():
        replace_file(directory / name, content)
    return [directory / name for name in texts]


def sources(export, templates, dtype, prefix, flags=None, values=None):
    """Return the files of an export in C.

    Parameters
    ----------
    export : Export
        The export.
    templates : dict of str to str
        Names of templates, and of the files that become of them, with ``{}`` for the
        prefix.
    dtype : {"double", "float"}
        Type of all numbers.
    prefix : str
        Begins the names of files, functions and types.
    flags : dict of str to bool or None, default=None
        What else decides on lines of the templates; "SLOPE" asks for derivatives of
        the output.
    values : dict of str to str or None, default=None
        What else stands for blanks.

    Returns
    -------
    texts : dict of str to str
        Contents of the files.
    """
    numbers = Numbers(dtype)
    is_solved = export.law is not None and not export.plant.is_explicit
    inverse = Inverse(export.plant) if is_solved else None
    flags = {"SLOPE": False, **flags_of(export, inverse), **(flags or {})}
    blanks = _values(export, inverse, flags, numbers)
    blanks = {"prefix": prefix, "dtype": dtype, **blanks, **(values or {})}
    return {
        name.format(prefix): fill(template, prefix, flags, blanks)
        for template, name in templates.items()
    }


def fill(template, prefix, flags, values):
    """Return a template with its blanks filled, and its names begun by the prefix.

    Parameters
    ----------
    template : str
        Name of the template.
    prefix : str
        What stands for ``plant``.
    flags : dict of str to bool
        What decides on lines.
    values : dict of str to object
        What stands for blanks.

    Returns
    -------
    text : str
        The text.
    """
    text = (files(__package__) / "templates" / template).read_text(encoding="ascii")
    text = re.sub(r"\bplant(?=[_.])", prefix, text)
    text = re.sub(r"\bPLANT_", f"{prefix.upper()}_", text)
    lines, wanted = [], []
    for line in text.splitlines(keepends=True):
        word, _, condition = line.strip().partition(" ")
        if word == "#if":
            names = condition.split(" && ")
            wanted.append(all(flags[n.strip("!")] != n.startswith("!") for n in names))
        elif line == "#else\n":
            wanted[-1] = not wanted[-1]
        elif line == "#endif\n":
            wanted.pop()
        elif all(wanted):
            lines.append(line)
    return Template("".join(lines)).substitute(values)


def flags_of(export, inverse):
    """Return what decides on the lines of the templates.

    Parameters
    ----------
    export : Export
        The export.
    inverse : Inverse or None
        Law that is solved for u; None for another one.

    Returns
    -------
    flags : dict of str to bool
        The flags by their names.
    """
    plant, law = export.plant, export.law
    return {
        "NEURONS": plant.form.nw > 0,
        "FEEDS": not plant.has_linear_output,
        "LATE": bool(np.any(plant.delay)),
        "LAW": law is not None,
        "CANCELS": plant.cancels,
        "SOLVED": inverse is not None,
        "BY_STATE": plant.feedback == "state",
        "INNER": inverse is not None and inverse.n_inner > 0,
        "ONE": plant.nv == 1,
        "DISTURBED": plant.nd > 0,
        "LIMITED": law is not None and bool(np.isfinite([law.u_min, law.u_max]).any()),
        "OBSERVER": export.M is not None,
        "GATED": export.gate is not None,
        "CONTROL": export.K_x is not None,
        "INTEGRATES": export.integrates,
    }


def _values(export, inverse, flags, numbers):
    """Return what stands for the blanks of the templates."""
    plant, by_state = export.plant, flags["BY_STATE"]
    if flags["INTEGRATES"]:
        demo = plant.y_offset + 0.5 * plant.y_scale
    else:
        demo = plant.u_offset + plant.u_scale
        if flags["CONTROL"]:
            demo = plant.v_offset + 0.5 * plant.v_scale
    what = "a step response of the model"
    if flags["CONTROL"]:
        what = "a step of the reference in closed loop"
    signals = list(signal_lines(plant))
    letters = [("y", plant.ny), ("u", plant.nu)]
    return {
        "name": plain(plant.name),
        "version": release(),
        "dt": repr(plant.dt),
        "nx": plant.nx,
        "nx_all": export.late.nx,
        "nu": plant.nu,
        "ny": plant.ny,
        "nv": plant.nv,
        "nd": plant.nd,
        "ns": plant.law_form.nu - plant.nu,
        "nr": plant.ny if flags["INTEGRATES"] else plant.nv,
        "v_offset": "v_offset" if plant.nd else "u_offset",
        "v_scale": "v_scale" if plant.nd else "u_scale",
        "d": "c->d, " if plant.nd else "",
        "law_d": "d, " if plant.nd else "",
        **_places(plant, numbers),
        "r_units": "y" if flags["INTEGRATES"] else "u",
        "late": ", then past inputs, oldest first" if flags["LATE"] else "",
        "unused": "" if flags["FEEDS"] else "; u is not used, may be 0",
        "u": "u" if flags["FEEDS"] else "0",
        "s": "x" if by_state else "y",
        "s_words": "the estimated state" if by_state else "the measured y",
        "signals": "\n".join(f" * {line}" for line in signals),
        "units": "\n".join(f"  - {line}" for line in signals),
        "no_law": plain(export.no_law),
        "what": what,
        "What": what.capitalize(),
        "values": ", ".join(numbers.literal("r", value) for value in demo),
        "columns": ",".join(f"{a}[{i}]" for a, n in letters for i in range(n)),
        "n_inner": inverse.n_inner if inverse else 0,
        "respond": inverse.response(numbers) if inverse else "",
        "EPS": numbers.literal("EPS", 4 * numbers.eps),
        "constants": "\n".join(_constants(export, inverse, flags, numbers)),
        "maps": "\n\n".join(_maps(export, inverse, flags, numbers)),
    }


def _places(plant, numbers):
    """Return blanks that tell inputs that are moved from measured disturbances."""
    blanks = {"d_values": ", ".join(numbers.literal("d", d) for d in plant.d_offset)}
    for name in ("moved", "given"):
        columns = getattr(plant, name)
        blanks[name] = ", ".join(map(str, columns))
        words = ", ".join(f"{plant.inputs[i]} (u[{i}])" for i in columns)
        blanks[f"{name}_words"] = plain(words)
    return blanks


def _constants(export, inverse, flags, numbers):
    plant, law = export.plant, export.law
    arrays = {"u_offset": plant.u_offset}
    if plant.nd and flags["LAW"]:
        arrays["d_offset"] = plant.d_offset
    if plant.nd and (flags["SOLVED"] or flags["CONTROL"]):
        arrays["v_offset"] = plant.v_offset
    if flags["INTEGRATES"] or (flags["LAW"] and not flags["BY_STATE"]):
        arrays["y_offset"] = plant.y_offset
    if flags["SOLVED"]:
        scale = "v_scale" if plant.nd else "u_scale"
        arrays |= {scale: plant.v_scale, **inverse.arrays()}
    if flags["LIMITED"]:
        arrays |= {"u_min": law.u_min, "u_max": law.u_max}
    if flags["OBSERVER"]:
        arrays["M"] = export.M
    if flags["GATED"]:
        arrays["gate"] = export.gate
    if flags["CONTROL"]:
        arrays["K_x"] = export.K_x
    if flags["INTEGRATES"]:
        # what the limits cut off v is taken out of z, as in `feedback.controller`
        arrays |= {"K_z": export.K_z, "back": np.linalg.pinv(export.K_z)}
    for name, values in arrays.items():
        yield numbers.array(name, values)
    if flags["LATE"]:
        delay = ", ".join(map(str, plant.delay))
        yield f"static const int delay[NU] = {{{delay}}}; /* samples */"
    if plant.nd and flags["CONTROL"]:
        for name in ("moved", "given"):
            places = ", ".join(map(str, getattr(plant, name)))
            yield f"static const int {name}[] = {{{places}}}; /* places in u */"


def maps_of(export, inverse):
    """Return next state, output, and what the law cancels, as static maps.

    Parameters
    ----------
    export : Export
        The export.
    inverse : Inverse or None
        Law that is solved for u; None for another one.

    Returns
    -------
    maps : dict of str to tuple
        Comment, static map and inputs of every value.
    """
    plant, form = export.plant, export.plant.form
    output = static_map(form, slice(form.nx, form.nx + plant.ny))
    output.rows_z[:, -1] += plant.y_offset  # a copy; the plant stays as it is
    inputs = {"x": plant.nx, "du": plant.nu}
    maps = {
        "next": ("x+", static_map(form, slice(0, form.nx)), inputs),
        "y": ("y", output, inputs),
    }
    if export.law is not None and not inverse:
        maps["h"] = "what the law takes off v", export.h, {"s": export.h.nu}
    return {**maps, **(inverse.maps() if inverse else {})}


def _maps(export, inverse, flags, numbers):
    """Yield the functions of all maps."""
    maps = maps_of(export, inverse)
    for value, (comment, lure, signals) in maps.items():
        function = Function(value, signals, numbers, comment)
        walk(lure, signals, function, value)
        yield function.source()
    if flags["SLOPE"]:
        _, lure, signals = maps["y"]
        function = Slope("y", signals, numbers, "change of y along changes of x and du")
        walk(lure, signals, function, "y")
        yield function.source()


def signal_lines(plant):
    """Yield a line on every signal: its name in C, that of the data, how late it is.

    Parameters
    ----------
    plant : Plant
        The plant.

    Yields
    ------
    line : str
        The line.
    """
    for i, name in enumerate(plant.inputs):
        late = f", {plant.delay[i]} samples late" if plant.delay[i] else ""
        yield f"u[{i}]: {plain(name)}{late}"
    for i, name in enumerate(plant.outputs):
        yield f"y[{i}]: {plain(name)}"


def plain(words):
    """Return words that are safe in a comment of C and of Structured Text.

    Parameters
    ----------
    words : object
        The words.

    Returns
    -------
    words : str
        The same, with _ for what might end a comment.
    """
    return re.sub(r"[^A-Za-z0-9 _.,:;()\[\]'`=+-]", "_", str(words))

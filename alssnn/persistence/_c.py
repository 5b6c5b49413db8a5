"""Models in C99: fixed sizes, no allocation, nothing beyond math.h.

What is the same for all models stands in `templates`, as C, with blanks that `_parts`
derives.  The maps of a model are functions of their own (`_c_map`).  What is compiled
is compared with Python in the tests, step by step.
"""

import re

from ..checks import check_option
from ..walk import walk
from ..whole_files import write_files
from ._archive import release
from ._c_map import SUFFIX, Function, Numbers, Slope
from ._c_test import SAMPLES, vectors
from ._export import Export
from ._parts import Parts, check_prefix, fill, plain

LAYOUTS = {  # templates, and the files that become of them
    "flat": {
        "plant.h": "{}.h",
        "plant.c": "{}.c",
        "plant_demo.c": "{}_demo.c",
        "plant_test.c": "{}_test.c",
        "Makefile": "Makefile",
        "README.md": "README.md",
    },
    "arduino": {
        "library.properties": "library.properties",
        "plant.h": "src/{}.h",
        "plant.c": "src/{}.c",
        "plant.ino": "examples/{0}_demo/{0}_demo.ino",
        "plant_test.c": "extras/{}_test.c",
        "README.md": "README.md",
    },
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
    layout="flat",
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
    layout : {"flat", "arduino"}, default="flat"
        All files in one folder, with a Makefile; or a library as the Arduino IDE and
        PlatformIO read it, with an example sketch. Most boards compute in single
        precision: take ``dtype="float"``.

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
    check_option("dtype", dtype, SUFFIX)
    check_prefix(prefix, "C")
    check_option("layout", layout, LAYOUTS)
    export = Export.of(model, law, observer, gain)
    numbers = Numbers(dtype)
    Parts(export).blanks(numbers)  # refuses what is beyond the range, by its name
    known = vectors(export, numbers).replace("plant_real", f"{prefix}_real")
    values = {"vectors": known, "samples": SAMPLES}
    flags = {"FLAT": layout == "flat"}
    texts = sources(export, LAYOUTS[layout], dtype, prefix, flags, values)
    return write_files(directory, texts)


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
    numbers, parts = Numbers(dtype), Parts(export)
    flags = {"SLOPE": False, **parts.flags, **(flags or {})}
    blanks = parts.blanks(numbers) | _blanks(parts, flags, numbers)
    blanks |= {"prefix": prefix, "dtype": dtype, **(values or {})}
    return {
        name.format(prefix): fill(template, prefix, flags, blanks)
        for template, name in templates.items()
    }


def _blanks(parts, flags, numbers):
    """Return what stands for the blanks of C alone."""
    export, plant, by_state = parts.export, parts.plant, flags["BY_STATE"]
    what, demo = "a step response of the model", plant.u_offset + plant.u_scale
    if flags["CONTROL"]:
        what = "a step of the reference in closed loop"
        demo = plant.v_offset + 0.5 * plant.v_scale
    if flags["INTEGRATES"]:
        demo = plant.y_offset + 0.5 * plant.y_scale
    signals = list(parts.signals())
    letters = [("y", plant.ny), ("u", plant.nu)]
    return {
        "d": "c->d, " if plant.nd else "",
        "law_d": "d, " if plant.nd else "",
        "d_values": ", ".join(numbers.literal("d", d) for d in plant.d_offset),
        "moved": ", ".join(map(str, plant.moved)),
        "given": ", ".join(map(str, plant.given)),
        "unused": "" if flags["FEEDS"] else "; u is not used, may be 0",
        "u": "u" if flags["FEEDS"] else "0",
        "s": "x" if by_state else "y",
        "signals": "\n".join(f" * {line}" for line in signals),
        "units": "\n".join(f"  - {line}" for line in signals),
        "no_law": plain(export.no_law),
        "what": what,
        "What": what.capitalize(),
        "values": ", ".join(numbers.literal("r", value) for value in demo),
        "library_version": ".".join(map(str, _numbers(release()))),
        "columns": ",".join(f"{a}[{i}]" for a, n in letters for i in range(n)),
        "respond": parts.inverse.response(numbers) if parts.inverse else "",
        "maps": "\n\n".join(_maps(parts, flags, numbers)),
    }


def _numbers(version):
    """Return the three numbers of a version, which is all that a library may have."""
    found = [int(n) for n in re.findall(r"\d+", version)[:3]]
    return [*found, 0, 0, 0][:3]


def _maps(parts, flags, numbers):
    """Yield the functions of all maps."""
    maps = parts.maps()
    for value, (comment, lure, signals) in maps.items():
        function = Function(value, signals, numbers, comment)
        walk(lure, signals, function, value)
        yield function.source()
    if flags["SLOPE"]:
        _, lure, signals = maps["y"]
        function = Slope("y", signals, numbers, "change of y along changes of x and du")
        walk(lure, signals, function, "y")
        yield function.source()

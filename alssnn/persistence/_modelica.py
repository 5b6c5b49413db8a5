"""Models and controllers in Modelica: one package of functions and sampled blocks.

What is the same for all models stands in the template ``plant.mo``, with blanks that
`_parts` derives as for C; the maps of a model are functions of their own, written by
the same walk.  Nothing of a library is used, and every loop is bounded.
"""

import re
import textwrap

import numpy as np

from ..whole_files import as_path, write_file
from ._assigned import Literals, Map, sources
from ._c_map import WIDTH
from ._export import Export
from ._parts import Parts, fill

# words of the language, and names of the package, that may not name it
TAKEN = {
    *("algorithm and annotation block break class connect connector constant".split()),
    *("constrainedby der discrete each else elseif elsewhen encapsulated end".split()),
    *("enumeration equation expandable extends external false final flow for".split()),
    *("function if import impure in initial inner input loop model not".split()),
    *("operator or outer output package parameter partial protected public".split()),
    *("pure record redeclare replaceable return stream then true type when".split()),
    *("while within Real Integer Boolean String Model Controller Modelica".split()),
    *("RealInput RealOutput dt step respond law correct control time".split()),
}


def to_modelica(model, path, *, law=None, observer=None, gain=None):
    """Write a fitted model, its law, observer and controller as a Modelica package.

    Parameters
    ----------
    model : estimator, Plant or LinearizingController
        Fitted model, or its `plant_`; or a controller, which has all the parts below.
    path : str or path-like
        File, such as ``"Motor.mo"``; its folder is made if need be.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer(gate=100)``, False
        leaves it out.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of a controller, as for `feedback.closed_loop`.

    Returns
    -------
    path : Path
        The file. The package has the name of the file, as Modelica wants it.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If the file cannot be written.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, the name of the file is none of a
        package, or an activation has no expression in Modelica.
    """
    path = as_path("path", path)
    name = path.stem
    if path.suffix != ".mo" or not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name):
        raise ValueError(
            "`path` must end in the name of a package: a letter, then letters, digits "
            f"and _, then .mo, got {path.name!r}. Take one such as 'Motor.mo'."
        )
    numbers = _Literals("double")
    parts = Parts(Export.of(model, law, observer, gain), first=1)
    maps = sources(_Function, "{}_of".format, parts, numbers)
    if name in TAKEN:
        raise ValueError(
            f"`path` must not be a word of Modelica, got {path.name!r}. Take a name "
            "such as 'Motor.mo'."
        )
    flags = parts.flags
    respond = numbers.respond(parts.inverse) if flags["INNER"] else []
    v = "v_offset - K_x * now - K_z * z" if flags["INTEGRATES"] else "r - K_x * now"
    blanks = {
        **parts.blanks(numbers),
        "package": name,
        "largest": numbers.literal("largest", numbers.largest),
        "signals": "\n".join(f"     {line}" for line in parts.signals()),
        "maps": maps,
        "respond": "\n".join(f"    {line}" for line in respond),
        "a": "a, " if flags["INNER"] else "",
        "only_z": "z, a" if flags["INNER"] else "z",
        "law_d": ", d" if flags["DISTURBED"] else "",
        "v_words": v,
    }
    return write_file(path, fill("plant.mo", "plant", flags, blanks))


class _Literals(Literals):
    """Write numbers in Modelica, arrays by their rows."""

    language, first, size = "modelica", 1, "abs"
    for_each = "for {} in {}:{} loop", "  ", "end for;"

    def array(self, name, values):
        values = np.asarray(values)
        rows = [
            f"{{{', '.join(self.literal(name, value) for value in row)}}}"
            for row in np.atleast_2d(values)
        ]
        text = f"{{{', '.join(rows)}}}" if values.ndim > 1 else rows[0]
        return self.declare("Real", name, values.shape, text)

    def integers(self, name, values):
        first = 0 if name == "delay" else 1  # places are counted from 1
        words = ", ".join(str(value + first) for value in values)
        return self.declare("Integer", name, (len(values),), f"{{{words}}}")

    def declare(self, kind, name, shape, text):
        head = f"constant {kind} {name}[{', '.join(map(str, shape))}] ="
        if len(head) + len(text) + 8 <= WIDTH:
            return f"{head} {text};"
        lines = [
            line
            for row in text.replace("}, ", "},\n").splitlines()
            for line in textwrap.wrap(row, WIDTH - 8, break_on_hyphens=False)
        ]
        return "\n".join([head, *(f"        {line}" for line in lines)]) + ";"


class _Function(Map):
    """Write a static map as a function, see `walk`."""

    def affine(self, value, terms, constant):
        n = len(constant[1])
        if value != "value":
            self.declared.append(f"Real {value}[{n}];")
        parts = [f"{self.constant(name, W)} * {signal}" for name, W, signal in terms]
        total = " + ".join([self.constant(*constant), *parts])
        self.lines.append(f"{value} := {total};")
        return value

    def source(self, size):
        """Return the function, whose value has a size."""
        inputs = [f"input Real {name}[{n}];" for name, n in self.inputs.items()]
        body = [
            *inputs,
            f"output Real value[{size}];",
            "protected",
            *self.declared,
            "algorithm",
            *self.lines,
        ]
        sections = "protected", "algorithm"
        return "\n".join(
            [
                f'  function {self.name} "{self.comment}"',
                *(f"  {'' if b in sections else '  '}{b}" for b in body),
                f"  end {self.name};",
            ]
        )

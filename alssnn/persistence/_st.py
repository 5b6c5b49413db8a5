"""Models and controllers in Structured Text of IEC 61131-3, for PLCs.

What is the same for all models stands in the template ``plant.st``, with blanks that
`_parts` derives as for C; the maps of a model are function blocks of their own, written
by the same walk.  Nothing but arrays of fixed size, bounded loops and ABS, EXP, SEL,
SIN and COS is used.  Names differ by more than the case of their letters, which do not
count.
"""

import re
import textwrap

import numpy as np

from ..walk import walk
from ..whole_files import as_path, replace_file
from ._c_map import SUFFIX, WIDTH, Numbers
from ._export import Export
from ._parts import Parts, fill
from ._plcopen import plcopen

TYPES = {"double": "LREAL", "float": "REAL"}


def to_st(
    model,
    path,
    *,
    law=None,
    observer=None,
    gain=None,
    dtype="double",
    prefix="plant",
):
    """Write a fitted model, its law, observer and controller as function blocks.

    Parameters
    ----------
    model : estimator, Plant or LinearizingController
        Fitted model, or its `plant_`; or a controller, which has all the parts below.
    path : str or path-like
        File, such as ``"plant.st"``; its folder is made if need be. One that ends in
        ``.xml`` is a project of PLCopen XML (TC6, version 2.01) with the same blocks.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer(gate=100)``, whose
        gate keeps spikes of a sensor small; False leaves it out.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of a controller, as for `feedback.closed_loop`.
    dtype : {"double", "float"}, default="double"
        Type of all numbers, LREAL or REAL.
    prefix : str, default="plant"
        Begins the names of function blocks.

    Returns
    -------
    path : Path
        The file.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If the file cannot be written.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, a value is beyond the range of `dtype`,
        or an activation has no expression in Structured Text.
    """
    if dtype not in TYPES:
        raise ValueError(f"`dtype` must be 'double' or 'float', got {dtype!r}.")
    if not isinstance(prefix, str) or not re.fullmatch(
        "[A-Za-z]([A-Za-z0-9]|_(?!_))*", prefix
    ):
        raise ValueError(
            "`prefix` must begin with a letter and consist of letters, digits and "
            f"single _, got {prefix!r}. It begins names in Structured Text."
        )
    numbers = _Literals(dtype, prefix)
    parts = Parts(Export.of(model, law, observer, gain))
    blanks = parts.blanks(numbers) | _blanks(parts, numbers)
    uses_tanh = any(numbers.tanh in blanks[name] for name in ("maps", "respond"))
    text = fill("plant.st", prefix, {**parts.flags, "TANH": uses_tanh}, blanks)
    path = as_path("path", path)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, plcopen(text, prefix) if path.suffix.lower() == ".xml" else text)
    return path


class _Literals(Numbers):
    """Write numbers of one type in Structured Text."""

    def __init__(self, dtype, prefix):
        super().__init__(dtype)
        self.type, self.prefix = TYPES[dtype], prefix
        self.begin, self.tanh = f"{self.type}#", f"{prefix}_tanh("
        self.largest = float(np.finfo(self.kind).max)
        self.blanks = {"t": self.begin, "p": f"{prefix}_"}

    def literal(self, name, value):
        if np.isinf(value) and name in ("u_min", "u_max"):
            value = np.copysign(self.largest, value)
        text = super().literal(name, value).removesuffix(SUFFIX[self.dtype])
        mantissa, _, exponent = text.partition("e")
        mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
        return f"{self.begin}{mantissa}{exponent and 'E'}{exponent}"

    def array(self, name, values):
        literals = [self.literal(name, value) for value in np.ravel(values)]
        return self.declare(name, self.type, literals)

    def integers(self, name, values):
        return self.declare(name, "DINT", list(map(str, values)))

    def declare(self, name, kind, literals):
        head = f"{name} : ARRAY[0..{len(literals) - 1}] OF {kind} := ["
        whole = f"{head}{', '.join(literals)}];"
        if len(whole) + 4 <= WIDTH:
            return whole
        rows = textwrap.wrap(", ".join(literals), WIDTH - 9, break_on_hyphens=False)
        return "\n".join([head, *(f"        {row}" for row in rows)]) + "];"


class _Map:
    """Write a static map as a function block, see `walk`."""

    def __init__(self, name, comment, inputs, numbers):
        self.name, self.comment, self.inputs = name, comment, inputs
        self.numbers, self.locals, self.constants, self.lines = numbers, [], [], []

    def affine(self, value, terms, constant):
        n = len(constant[1])
        if value != "value":
            self.locals.append((value, n))
        start = self.constant(*constant)
        self.lines += [f"FOR i := 0 TO {n - 1} DO", f"    {value}[i] := {start}[i];"]
        for name, matrix, signal in terms:
            W, m = self.constant(name, matrix), matrix.shape[1]
            self.lines += [
                f"    FOR j := 0 TO {m - 1} DO",
                f"        {value}[i] := {value}[i] + {W}[i * {m} + j] * {signal}[j];",
                "    END_FOR;",
            ]
        self.lines.append("END_FOR;")
        return value

    def activate(self, value, size, sigma):
        v = f"{value}[i]"
        expression = sigma.expression("st", v=v, **self.numbers.blanks)
        self.lines += [f"FOR i := 0 TO {size - 1} DO", f"    {v} := {expression};"]
        self.lines.append("END_FOR;")
        return value

    def constant(self, name, values):
        """Return the name of a constant, which a w of the same letters has not."""
        name = f"k_{name}".rstrip("_")
        self.constants.append(self.numbers.array(name, values))
        return name

    def source(self, size):
        """Return the block, whose value has a size."""

        def array(name, n):
            return f"    {name} : ARRAY[0..{n - 1}] OF {self.numbers.type};"

        constants = [f"    {line}" for line in self.constants]
        return "\n".join(
            [
                f"(* {self.comment} *)",
                f"FUNCTION_BLOCK {self.name}",
                "VAR_INPUT",
                *(array(name, n) for name, n in self.inputs.items()),
                "END_VAR",
                "VAR_OUTPUT",
                array("value", size),
                "END_VAR",
                "VAR CONSTANT",
                *constants,
                "END_VAR",
                "VAR",
                *(array(name, n) for name, n in self.locals),
                "    i, j : DINT;",
                "END_VAR",
                *self.lines,
                "END_FUNCTION_BLOCK",
            ]
        )


def _blanks(parts, numbers):
    """Return what stands for the blanks of Structured Text alone."""
    upper, maps = numbers.prefix.upper(), []
    for value, (comment, lure, inputs) in parts.maps().items():
        block = _Map(f"{upper}_MAP_{value.upper()}", comment, inputs, numbers)
        walk(lure, inputs, block, "value")
        maps.append(block.source(lure.nz))
    sizes = {**parts.sizes, "slope": parts.plant.nv**2}
    return {
        **{f"last_{name}": size - 1 for name, size in sizes.items()},
        "t": numbers.type,
        "p": numbers.begin,
        "largest": numbers.literal("largest", numbers.largest),
        "signals": "\n".join(f"   {line}" for line in parts.signals()),
        "of_u": "of the same sample" if parts.flags["FEEDS"] else "not used",
        "maps": "\n\n".join(maps),
        "respond": _respond(parts.inverse, numbers) if parts.sizes["inner"] else "",
    }


def _respond(inverse, numbers):
    """Return the statements that turn what neurons see into w and its slope."""
    lines, small = [], numbers.literal("h", np.sqrt(numbers.eps))
    for layer in inverse.layers:
        sigma, blanks = inverse.sigma[layer.start], numbers.blanks
        value = sigma.expression("st", v="sees", **blanks)
        lines += [f"FOR j := {layer.start} TO {layer.stop - 1} DO", "    sees := w[j];"]
        lines.append(f"    w[j] := {value};")
        if "st_slope" in sigma.expressions:
            slope = sigma.expression("st_slope", v="sees", w="w[j]", **blanks)
        else:  # of an activation that says nothing of its derivative
            lines.append(f"    part := {small} * ({numbers.begin}1.0 + ABS(sees));")
            ahead = sigma.expression("st", v="(sees + part)", **blanks)
            slope = f"(({ahead}) - w[j]) / part"
        lines += [f"    rise[j] := {slope};", "END_FOR;"]
    return "\n".join(lines)

"""Models and controllers in Structured Text of IEC 61131-3, for PLCs.

What is the same for all models stands in the template ``plant.st``, with blanks that
`_parts` derives as for C; the maps of a model are function blocks of their own, written
by the same walk.  Nothing but arrays of fixed size, bounded loops and ABS, EXP, SEL,
SIN and COS is used.  Names differ by more than the case of their letters, which do not
count.
"""

import textwrap

import numpy as np

from ..checks import check_option
from ..whole_files import as_path, write_file
from ._assigned import Literals, Map, sources
from ._c_map import WIDTH
from ._export import Export
from ._parts import Parts, check_prefix, fill
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
    check_option("dtype", dtype, TYPES)
    check_prefix(prefix, "Structured Text", "single _")
    numbers = _Literals(dtype, prefix)
    parts = Parts(Export.of(model, law, observer, gain))
    blanks = parts.blanks(numbers) | _blanks(parts, numbers)
    uses_tanh = any(numbers.tanh in blanks[name] for name in ("maps", "respond"))
    text = fill("plant.st", prefix, {**parts.flags, "TANH": uses_tanh}, blanks)
    path = as_path("path", path)
    is_xml = path.suffix.lower() == ".xml"
    return write_file(path, plcopen(text, prefix) if is_xml else text)


class _Literals(Literals):
    """Write numbers of one type in Structured Text."""

    language, first, size = "st", 0, "ABS"
    for_each = "FOR {} := {} TO {} DO", "    ", "END_FOR;"

    def __init__(self, dtype, prefix):
        super().__init__(dtype)
        self.type, self.prefix = TYPES[dtype], prefix
        self.begin, self.tanh = f"{self.type}#", f"{prefix}_tanh("
        self.blanks = {"t": self.begin, "p": f"{prefix}_"}

    def literal(self, name, value):
        text = super().literal(name, value).removesuffix(self.suffix)
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


class _Map(Map):
    """Write a static map as a function block, see `walk`."""

    def affine(self, value, terms, constant):
        n, v, loop = len(constant[1]), f"{value}[i]", self.numbers.loop
        if value != "value":
            self.locals.append((value, n))
        body = [f"{v} := {self.constant(*constant)}[i];"]
        for name, matrix, signal in terms:
            W, m = self.constant(name, matrix), matrix.shape[1]
            total = f"{v} := {v} + {W}[i * {m} + j] * {signal}[j];"
            body += loop("j", slice(0, m), [total])
        self.lines += loop("i", slice(0, n), body)
        return value

    def source(self, size):
        """Return the block, whose value has a size."""

        def array(name, n):
            return f"    {name} : ARRAY[0..{n - 1}] OF {self.numbers.type};"

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
                *(f"    {line}" for line in self.declared),
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
    prefix = f"{numbers.prefix}_MAP_"
    maps = sources(_Map, lambda value: f"{prefix}{value}".upper(), parts, numbers)
    respond = numbers.respond(parts.inverse) if parts.sizes["inner"] else []
    sizes = {**parts.sizes, "slope": parts.plant.nv**2}
    return {
        **{f"last_{name}": size - 1 for name, size in sizes.items()},
        "t": numbers.type,
        "p": numbers.begin,
        "largest": numbers.literal("largest", numbers.largest),
        "signals": "\n".join(f"   {line}" for line in parts.signals()),
        "of_u": "of the same sample" if parts.flags["FEEDS"] else "not used",
        "maps": maps,
        "respond": "\n".join(respond),
    }

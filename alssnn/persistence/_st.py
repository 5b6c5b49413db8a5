"""Models and controllers in Structured Text of IEC 61131-3, for PLCs.

What is the same for all models stands in the template ``plant.st``, with the blanks of
those in C (`_c`); the maps of a model are function blocks of their own, written by the
same walk.  Nothing but arrays of fixed size, bounded loops and ABS, EXP, SEL, SIN and
COS is used.  Names differ by more than the case of their letters, which do not count.
"""

import re
import textwrap
from pathlib import Path

import numpy as np

from ..walk import walk
from ..whole_files import replace_file
from ._archive import release
from ._c import fill, flags_of, maps_of, plain, signal_lines
from ._c_law import Inverse
from ._c_map import SUFFIX, WIDTH, Numbers
from ._export import Export

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
    model : estimator or Plant
        Fitted model, or its `plant_`.
    path : str or path-like
        File, such as ``"plant.st"``; its folder is made if need be.
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
    export, numbers = Export.of(model, law, observer, gain), _Literals(dtype, prefix)
    is_solved = export.law is not None and not export.plant.is_explicit
    inverse = Inverse(export.plant) if is_solved else None
    flags = flags_of(export, inverse)
    values = _values(export, inverse, flags, numbers)
    flags["TANH"] = any(numbers.tanh in values[name] for name in ("maps", "respond"))
    text = fill("plant.st", prefix, flags, values)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, text)
    return path


class _Literals(Numbers):
    """Write numbers of one type in Structured Text."""

    def __init__(self, dtype, prefix):
        super().__init__(dtype)
        self.type, self.prefix = TYPES[dtype], prefix
        self.begin, self.tanh = f"{self.type}#", f"{prefix}_tanh("
        kind = np.float32 if dtype == "float" else np.float64
        self.largest = float(np.finfo(kind).max)
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


def _values(export, inverse, flags, numbers):
    """Return what stands for the blanks of the template."""
    plant, upper = export.plant, numbers.prefix.upper()
    maps = []
    for value, (comment, lure, inputs) in maps_of(export, inverse).items():
        block = _Map(f"{upper}_MAP_{value.upper()}", comment, inputs, numbers)
        walk(lure, inputs, block, "value")
        maps.append(block.source(lure.nz))
    ns, nr = plant.law_form.nu - plant.nu, plant.nv
    nr = plant.ny if flags["INTEGRATES"] else nr
    n_inner = inverse.n_inner if inverse else 0
    sizes = {
        "x": export.late.nx,
        "nx": plant.nx,
        "u": plant.nu,
        "y": plant.ny,
        "v": plant.nv,
        "d": plant.nd,
        "s": ns,
        "r": nr,
        "seen": ns + plant.nd,
        "inner": n_inner,
        "slope": plant.nv**2,
    }
    late = ", then past inputs, oldest first" if flags["LATE"] else ""
    return {
        **{f"last_{name}": size - 1 for name, size in sizes.items()},
        **{f"n{name}": sizes[name] for name in ("y", "v", "s")},
        **_constants(export, inverse, numbers),
        "nx": plant.nx,
        "nx_all": export.late.nx,
        "n_inner": n_inner,
        "name": plain(plant.name),
        "version": release(),
        "dt": repr(float(plant.dt)),
        "t": numbers.type,
        "p": numbers.begin,
        "eps": numbers.literal("eps", 4 * numbers.eps),
        "largest": numbers.literal("largest", numbers.largest),
        "signals": "\n".join(f"   {line}" for line in signal_lines(plant)),
        "late_words": late,
        "s_words": "the estimated state" if flags["BY_STATE"] else "the measured y",
        "r_units": "y" if flags["INTEGRATES"] else "u",
        "of_u": "of the same sample" if flags["FEEDS"] else "not used",
        "given_words": plain(", ".join(plant.inputs[i] for i in plant.given)),
        "maps": "\n\n".join(maps),
        "respond": _respond(inverse, numbers) if n_inner else "",
    }


def _constants(export, inverse, numbers):
    """Return the declarations of constant arrays, empty where there are none."""
    plant, law = export.plant, export.law
    arrays = {"u_offset": plant.u_offset, "v_offset": plant.v_offset}
    arrays |= {"y_offset": plant.y_offset, "v_scale": plant.v_scale}
    arrays |= {"d_offset": plant.d_offset, "weight": export.M, "gate": export.gate}
    arrays |= {"K_x": export.K_x, "K_z": export.K_z}
    if law is not None:
        arrays |= {"u_min": law.u_min, "u_max": law.u_max}
    if export.integrates:
        # what the limits cut off v is taken out of z, as in `feedback.controller`
        arrays["back"] = np.linalg.pinv(export.K_z)
    known = {name: values for name, values in arrays.items() if values is not None}
    known |= inverse.arrays() if inverse else {}
    names = [*arrays, "u_min", "u_max", "back", "phi_D", "phi_U", "phi_W"]
    declared = {f"k_{name}": "" for name in names}
    declared |= {f"k_{name}": numbers.array(name, v) for name, v in known.items()}
    for name in ("delay", "moved", "given"):
        declared[f"k_{name}"] = numbers.integers(name, getattr(plant, name))
    return declared


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

"""What C and Structured Text say of an export: sizes, flags, constants and maps.

Both fill templates, with two kinds of blanks: lines between ``#if FLAG`` and ``#endif``
are written for models that need them, and ``$name`` is a number or a text.  Here both
are derived once; a language says how its numbers, arrays and functions are written.
"""

import re
from functools import cached_property
from importlib.resources import files
from string import Template

import numpy as np

from ..walk import static_map
from ._archive import release
from ._c_law import Inverse


class Parts:
    """Derive what templates need of an export.

    Parameters
    ----------
    export : Export
        The export.
    first : int, default=0
        Number of the first element of an array.
    """

    def __init__(self, export, first=0):
        self.export, self.plant, self.first = export, export.plant, first
        solves = export.law is not None and export.plant.is_solved
        self.inverse = Inverse(export.plant) if solves else None

    @cached_property
    def sizes(self):
        """Return sizes of signals by their names."""
        export, plant = self.export, self.plant
        ns = plant.law_form.nu - plant.nu
        return {
            "x": plant.nx,
            "state": export.late.nx,
            "u": plant.nu,
            "y": plant.ny,
            "v": plant.nv,
            "d": plant.nd,
            "s": ns,
            "z": plant.ny if export.integrates else 0,
            "r": plant.ny if export.integrates else plant.nv,
            "mid": export.middle.nz if plant.looks_ahead else ns,
            "seen": plant.solved_map.form.nu - plant.nv,
            "inner": self.inverse.n_inner if self.inverse else 0,
        }

    @cached_property
    def flags(self):
        """Return what decides on lines of templates."""
        export, plant, law = self.export, self.plant, self.export.law
        limits = [] if law is None else [law.u_min, law.u_max]
        return {
            "NEURONS": plant.form.nw > 0,
            "FEEDS": not plant.has_linear_output,
            "LATE": bool(np.any(plant.delay)),
            "LAW": law is not None,
            "CANCELS": plant.cancels,
            "AHEAD": plant.looks_ahead,
            "SOLVED": self.inverse is not None,
            "BY_STATE": plant.feedback == "state",
            "INNER": self.sizes["inner"] > 0,
            "ONE": plant.nv == 1,
            "DISTURBED": plant.nd > 0,
            "LIMITED": bool(np.isfinite(limits).any()),
            "OBSERVER": export.M is not None,
            "GATED": export.gate is not None,
            "CONTROL": export.K_x is not None,
            "INTEGRATES": export.integrates,
            "HOLDS": bool(export.between),
            "DRIFTS": plant.drift is not None,
        }

    def blanks(self, numbers):
        """Return what stands for blanks.

        Parameters
        ----------
        numbers : Numbers
            Type of all numbers, and how arrays are declared.

        Returns
        -------
        blanks : dict of str to object
            Sizes ``nx``, ..., words, and ``k_name`` for the constants, empty where
            the export has none.
        """
        plant, flags, went_on = self.plant, self.flags, self.export.went_on
        measures = "the estimated state" if flags["BY_STATE"] else "the measured y"
        return {
            **{f"n{name}": size for name, size in self.sizes.items()},
            **{f"k_{name}": text for name, text in self._constants(numbers)},
            "name": plain(plant.name),
            "version": release(),
            "dt": repr(float(plant.dt)),
            "f": numbers.suffix,
            "eps": numbers.literal("eps", 4 * numbers.eps),
            "between": self.export.between,
            "went_on": f"\n   {went_on}." if went_on else "",
            "late": ", then past inputs, oldest first" if flags["LATE"] else "",
            "s_words": measures,
            "r_units": "y" if flags["INTEGRATES"] else "u",
            "moved_words": self._words(plant.moved),
            "given_words": self._words(plant.given),
        }

    def maps(self):
        """Return next state, output, and what the law evaluates, as static maps.

        Returns
        -------
        maps : dict of str to tuple
            Comment, static map and inputs of every value.
        """
        plant, form = self.plant, self.plant.form
        output = static_map(form, slice(form.nx, form.nx + plant.ny))
        output.rows_z[:, -1] += plant.y_offset  # a copy; the plant stays as it is
        inputs = {"x": plant.nx, "du": plant.nu}
        maps = {
            "next": ("x+", static_map(form, slice(0, form.nx)), inputs),
            "y": ("y", output, inputs),
        }
        if self.export.law is None:
            return maps
        if plant.looks_ahead:
            sees = {key: self.sizes[key] for key in "sdv" if self.sizes[key]}
            words = "what the law sees, half a sample ahead"
            maps["middle"] = words, self.export.middle, sees
        if self.inverse:
            return {**maps, **self.inverse.maps()}
        h = self.export.h
        return {**maps, "h": ("what the law takes off v", h, {"s": h.nu})}

    def signals(self):
        """Yield a line on every signal: its name here, that of the data, how late."""
        plant = self.plant
        for i, (name, delay) in enumerate(
            zip(plant.inputs, plant.delay, strict=True), self.first
        ):
            late = f", {delay} sample{'s' if delay > 1 else ''} late" if delay else ""
            yield f"u[{i}]: {plain(name)}{late}"
        for i, name in enumerate(plant.outputs, self.first):
            yield f"y[{i}]: {plain(name)}"

    def _words(self, inputs):
        names = self.plant.inputs
        return plain(", ".join(f"{names[i]} (u[{i + self.first}])" for i in inputs))

    def _constants(self, numbers):
        export, plant, law = self.export, self.plant, self.export.law
        arrays = {
            **{f"{z}_offset": getattr(plant, f"{z}_offset") for z in "uyvd"},
            "v_scale": plant.v_scale,
            "weight": export.M,
            "gate": export.gate,
            "K_x": export.K_x,
            "K_z": export.K_z,
            "back": export.back,
            "u_min": None if law is None else law.u_min,
            "u_max": None if law is None else law.u_max,
            **dict.fromkeys(("phi_D", "phi_U", "phi_W")),
            **(self.inverse.arrays() if self.inverse else {}),
        }
        for name, values in arrays.items():
            is_there = values is not None and np.size(values)
            yield name, numbers.array(name, values) if is_there else ""
        for name in ("delay", "moved", "given"):
            values = getattr(plant, name)
            yield name, numbers.integers(name, values) if len(values) else ""


def check_prefix(prefix, language, line="_"):
    """Refuse what cannot begin names.

    Parameters
    ----------
    prefix : object
        What was given.
    language : str
        Language of the names.
    line : {"_", "single _"}, default="_"
        What may stand beside letters and digits.

    Raises
    ------
    ValueError
        If it is no beginning of a name.
    """
    later = "[A-Za-z0-9_]" if line == "_" else "([A-Za-z0-9]|_(?!_))"
    if not isinstance(prefix, str) or not re.fullmatch(f"[A-Za-z]{later}*", prefix):
        raise ValueError(
            f"`prefix` must begin with a letter and consist of letters, digits and "
            f"{line}, got {prefix!r}. It begins names in {language}."
        )


def fill(template, prefix, flags, values):
    """Return a template with its blanks filled, and its names begun by the prefix.

    Parameters
    ----------
    template : str
        Name of the template.
    prefix : str
        What stands for ``plant``.
    flags : dict of str to bool
        What decides on lines: ``#if A && !B || C``.
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
            wanted.append(any(_holds(c, flags) for c in condition.split(" || ")))
        elif line == "#else\n":
            wanted[-1] = not wanted[-1]
        elif line == "#endif\n":
            wanted.pop()
        elif all(wanted):
            lines.append(line)
    return Template("".join(lines)).substitute(values)


def _holds(condition, flags):
    names = condition.split(" && ")
    return all(flags[name.strip("!")] != name.startswith("!") for name in names)


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

"""What Structured Text and Modelica share: ``:=``, counted loops, and no infinity."""

import numpy as np

from ..walk import walk
from ._c_map import Numbers


class Literals(Numbers):
    """Write numbers and statements of one type.

    A language says how its expressions are called (`language`), what they need beside
    signals (`blanks`), where its arrays begin (`first`), what its absolute value is
    called (`size`), and what is the first line, the indent and the last line of its
    loops (`for_each`).

    Parameters
    ----------
    dtype : {"double", "float"}
        Type of all numbers.
    """

    language: str
    first: int
    size: str
    for_each: tuple[str, str, str]

    def __init__(self, dtype):
        super().__init__(dtype)
        self.largest = float(np.finfo(self.kind).max)
        self.blanks: dict[str, str] = {}

    def literal(self, name, value):
        """Return a literal; an infinite limit becomes the largest number.

        Parameters
        ----------
        name : str
            What it belongs to.
        value : float
            The number.

        Returns
        -------
        literal : str
            The number in the language.
        """
        if np.isinf(value) and name in ("u_min", "u_max"):
            value = np.copysign(self.largest, value)
        return super().literal(name, value)

    def neuron(self, sigma, what="", **signals):
        """Return an expression of an activation.

        Parameters
        ----------
        sigma : Activation
            The activation.
        what : str, default=""
            What is wanted: the value, or by ``"_slope"`` the derivative.
        **signals : str
            What it depends on.

        Returns
        -------
        expression : str
            The expression.
        """
        return sigma.expression(self.language + what, **signals, **self.blanks)

    def loop(self, i, elements, body):
        """Return a loop over elements of arrays.

        Parameters
        ----------
        i : str
            Name of the counter.
        elements : slice
            The elements, counted from 0.
        body : list of str
            Lines of what is done for each.

        Returns
        -------
        lines : list of str
            Lines of the loop.
        """
        begin, indent, end = self.for_each
        ends = elements.start + self.first, elements.stop - 1 + self.first
        return [begin.format(i, *ends), *(indent + line for line in body), end]

    def respond(self, inverse):
        """Return the statements that turn what neurons see into w and its slope.

        Parameters
        ----------
        inverse : Inverse
            Parts of the law that is solved for u.

        Returns
        -------
        lines : list of str
            The statements.
        """
        lines = []
        for layer in inverse.layers:
            sigma = inverse.sigma[layer.start]
            body = ["sees := w[j];", f"w[j] := {self.neuron(sigma, v='sees')};"]
            if f"{self.language}_slope" in sigma.expressions:
                slope = self.neuron(sigma, "_slope", v="sees", w="w[j]")
            else:  # of an activation that says nothing of its derivative
                small, one = self.literal("h", np.sqrt(self.eps)), self.literal("1", 1)
                body.append(f"part := {small} * ({one} + {self.size}(sees));")
                slope = f"(({self.neuron(sigma, v='(sees + part)')}) - w[j]) / part"
            lines += self.loop("j", layer, [*body, f"rise[j] := {slope};"])
        return lines


class Map:
    """Write a static map, see `walk`; a language adds `affine` and `source`.

    Parameters
    ----------
    name : str
        What it is called.
    comment : str
        What it computes.
    inputs : dict of str to int
        Its arguments, and their sizes.
    numbers : Literals
        Type of all numbers.
    """

    def __init__(self, name, comment, inputs, numbers):
        self.name, self.comment, self.inputs = name, comment, inputs
        self.numbers, self.locals, self.declared, self.lines = numbers, [], [], []

    def activate(self, value, size, sigma):
        """State value = sigma(value).

        Parameters
        ----------
        value : str
            Name of the value.
        size : int
            Its size.
        sigma : Activation
            The activation.

        Returns
        -------
        value : str
            The same name.
        """
        v = f"{value}[i]"
        body = [f"{v} := {self.numbers.neuron(sigma, v=v)};"]
        self.lines += self.numbers.loop("i", slice(0, size), body)
        return value

    def constant(self, name, values):
        """Declare a constant.

        Parameters
        ----------
        name : str
            What it is called elsewhere.
        values : ndarray
            Its numbers.

        Returns
        -------
        name : str
            Its name, which a w of the same letters has not.
        """
        name = f"k_{name}".rstrip("_")
        self.declared.append(self.numbers.array(name, values))
        return name


def sources(kind, name, parts, numbers):
    """Return all maps of an export.

    Parameters
    ----------
    kind : type
        Class of a map.
    name : callable
        Returns what a map is called, for the name of its value.
    parts : Parts
        The export.
    numbers : Literals
        Type of all numbers.

    Returns
    -------
    sources : str
        Their sources.
    """
    found = []
    for value, (comment, lure, inputs) in parts.maps().items():
        one = kind(name(value), comment, inputs, numbers)
        walk(lure, inputs, one, "value")
        found.append(one.source(lure.nz))
    return "\n\n".join(found)

"""What every file of a C export says of the model: names, sizes and numbers."""

import re

import numpy as np

from ._archive import release

WIDTH = 88  # columns of the sources
SUFFIX = {"double": "", "float": "f"}


class CModel:
    """Hold a model and the words that stand for it in C.

    Parameters
    ----------
    parts : Parts
        The model.
    dtype : {"double", "float"}
        Type of all numbers.
    prefix : str
        Begins the names of functions and types.
    scaling : Scaling
        Sizes of the signals.

    Attributes
    ----------
    names : dict of str to object
        What the templates call ``$name``.
    """

    def __init__(self, parts, dtype, prefix, scaling):
        self.parts, self.dtype, self.scaling = parts, dtype, scaling
        nx, nu = parts.B.shape
        self.nx, self.nu, self.ny = nx, nu, len(parts.C)
        self.feeds_through = not parts.has_linear_output
        self.by_state = parts.feedback == "state"
        self.has_law, self.has_h = parts.law is not None, "h" in parts.nets
        late = ", then past inputs, oldest first" if parts.n_late else ""
        self.names = {
            "name": parts.name,
            "version": release(),
            "prefix": prefix,
            "PREFIX": prefix.upper(),
            "dtype": dtype,
            "dt": repr(parts.dt),
            "nx": nx,
            "nu": nu,
            "ny": self.ny,
            "nx_all": nx + parts.n_late,
            "late_comment": late,
            "output_comment": "" if self.feeds_through else "; u is not used, may be 0",
            "what": "a step of the reference in closed loop"
            if parts.K_x is not None
            else "a step response of the model",
        }

    @property
    def limited(self):
        """Return whether the law has limits."""
        law = self.parts.law
        return law is not None and bool(np.isfinite([law.u_min, law.u_max]).any())

    def signals(self):
        """Yield a line on every input and output.

        Yields
        ------
        line : str
            Its name in C, that of the data, and how late it is.
        """
        delay = self.parts.delay
        for letter, signals in (("u", self.parts.inputs), ("y", self.parts.outputs)):
            for i, signal in enumerate(signals):
                late = delay[i] if letter == "u" else 0
                after = f", {late} samples late" if late else ""
                yield f"{letter}[{i}]: {plain(signal)}{after}"

    def array(self, name, matrix):
        """Return the definition of a constant array.

        Parameters
        ----------
        name : str
            Its name.
        matrix : ndarray
            Its numbers, stored by rows.

        Returns
        -------
        definition : str
            One or more lines of C.
        """
        numbers = [self.number(name, value) for value in np.ravel(matrix)]
        head = f"static const real {name}[{len(numbers)}] = {{"
        one_line = f"{head}{', '.join(numbers)}}};"
        if len(one_line) <= WIDTH:
            return one_line
        lines, line = [head], "   "
        for number in numbers:
            if len(line) + len(number) + 2 > WIDTH:
                lines.append(line)
                line = "   "
            line += f" {number},"
        return "\n".join([*lines, line.rstrip(","), "};"])

    def number(self, name, value):
        """Return a literal of the type of all numbers.

        Parameters
        ----------
        name : str
            What it belongs to.
        value : float
            The number; only limits may be infinite.

        Returns
        -------
        literal : str
            The number in C.

        Raises
        ------
        ValueError
            If it is beyond the range of the type.
        """
        if np.isinf(value) and name in ("u_min", "u_max"):
            return "INFINITY" if value > 0 else "-INFINITY"
        with np.errstate(over="ignore"):
            literal = np.float32(value) if self.dtype == "float" else float(value)
        if not np.isfinite(literal):
            raise ValueError(
                f"`{name}` must be in the range of `dtype`, {self.dtype!r}, got "
                f"{value}. Use 'double', or other units."
            )
        return f"{literal!s}{SUFFIX[self.dtype]}"


def plain(words):
    """Return words that are safe in a comment of C.

    Parameters
    ----------
    words : object
        What is printed there.

    Returns
    -------
    words : str
        The same, strange characters replaced.
    """
    return re.sub(r"[^A-Za-z0-9 _.,:;()\[\]'`=+-]", "_", str(words))

"""Numbers and static maps in C: constant arrays, and one function per map."""

import textwrap

import numpy as np

WIDTH = 88  # columns of the sources
SUFFIX = {"double": "", "float": "f"}


class Numbers:
    """Write numbers of one type.

    Parameters
    ----------
    dtype : {"double", "float"}
        Type of all numbers.
    """

    def __init__(self, dtype):
        self.dtype, self.suffix = dtype, SUFFIX[dtype]
        self.kind = np.float32 if dtype == "float" else np.float64
        self.eps = float(np.finfo(self.kind).eps)

    def literal(self, name, value):
        """Return a literal.

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
        return f"{literal!s}{self.suffix}"

    def array(self, name, values):
        """Return the definition of a constant array.

        Parameters
        ----------
        name : str
            Its name.
        values : ndarray
            Its numbers, stored by rows.

        Returns
        -------
        definition : str
            One or more lines of C.
        """
        literals = [self.literal(name, value) for value in np.ravel(values)]
        head = f"static const real {name}[{len(literals)}] = {{"
        one_line = f"{head}{', '.join(literals)}}};"
        if len(one_line) <= WIDTH:
            return one_line
        words = ", ".join(literals) + ","
        rows = textwrap.wrap(words, WIDTH - 4, break_on_hyphens=False)
        body = "\n".join(f"    {row}" for row in rows)
        return f"{head}\n{body.rstrip(',')}\n}};"

    def integers(self, name, values):
        """Return the definition of a constant array of integers.

        Parameters
        ----------
        name : str
            Its name.
        values : sequence of int
            The integers.

        Returns
        -------
        definition : str
            A line of C.
        """
        words = ", ".join(map(str, values))
        return f"static const int {name}[{len(values)}] = {{{words}}};"


class Function:
    """Write one static map as a function, see `walk`.

    Parameters
    ----------
    value : str
        What it computes; the function is ``{value}_of``.
    inputs : sequence of str
        Its arguments.
    numbers : Numbers
        Type of all numbers.
    comment : str
        What stands above it.
    """

    def __init__(self, value, inputs, numbers, comment):
        self.value, self.numbers, self.comment = value, numbers, comment
        self.inputs, self.used = list(inputs), set()
        self.constants, self.locals, self.lines = {}, [], []

    def affine(self, value, terms, constant):
        """State value = sum of matrix @ signal + constant.

        Parameters
        ----------
        value : str
            Name of the value.
        terms : list of tuple
            Name of the matrix, matrix and name of the signal.
        constant : tuple
            Name and vector.

        Returns
        -------
        value : str
            The same name.
        """
        n = len(constant[1])
        if value != self.value:
            self.locals.append(f"{value}[{n}]")
        self.lines.append(f"set({n}, {self._constant(*constant)}, {value});")
        for name, matrix, signal in terms:
            W = self._constant(name, matrix)
            self.lines.append(f"add({n}, {matrix.shape[1]}, {W}, {signal}, {value});")
            self.used.add(signal)
        return value

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
        v, f = f"{value}[i]", self.numbers.suffix
        self.lines.append(f"for (i = 0; i < {size}; i++) {{")
        self.lines.append(f"    {v} = {sigma.expression('c', v=v, f=f)};")
        self.lines.append("}")
        return value

    def source(self):
        """Return the constants and the function.

        Returns
        -------
        source : str
            Source in C.
        """
        arguments = "".join(f"const real *{name}, " for name in self.inputs)
        start = [f"real {', '.join(self.locals)};"] if self.locals else []
        start += ["int i;"] if any("(i =" in line for line in self.lines) else []
        idle = [f"(void){name};" for name in self.inputs if name not in self.used]
        return "\n".join(
            [
                *self.constants.values(),
                f"/* {self.comment} */",
                f"static void {self.value}_of({arguments}real *{self.value})",
                "{",
                *(f"    {line}" for line in [*start, *idle, *self.lines]),
                "}",
            ]
        )

    def _constant(self, name, values):
        name = f"{self.value}_{name}"
        self.constants[name] = self.numbers.array(name, values)
        return name


class Slope(Function):
    """Write the change of a static map along changes of its inputs, see `walk`.

    The function is ``{value}_slope_of``; the changes are called as the signals, with
    ``dot_`` in front.

    Parameters
    ----------
    value : str
        What the map computes.
    inputs : sequence of str
        Its arguments.
    numbers : Numbers
        Type of all numbers.
    comment : str
        What stands above it.
    """

    def __init__(self, value, inputs, numbers, comment):
        super().__init__(
            f"{value}_slope", [*inputs, *map("dot_{}".format, inputs)], numbers, comment
        )
        self.last = value

    def affine(self, value, terms, constant):
        """State value = sum of matrix @ signal + constant, and its change.

        Parameters
        ----------
        value : str
            Name of the value.
        terms : list of tuple
            Name of the matrix, matrix and name of the signal.
        constant : tuple
            Name and vector.

        Returns
        -------
        value : str
            The same name.
        """
        n, change = len(constant[1]), f"dot_{value}"
        if value == self.last:
            change = self.value
        else:
            super().affine(value, terms, constant)
            self.locals.append(f"{change}[{n}]")
        zero = f"0.0{self.numbers.suffix}"
        self.lines += [f"for (i = 0; i < {n}; i++) {{", f"    {change}[i] = {zero};"]
        self.lines.append("}")
        for name, matrix, signal in terms:
            W, m = self._constant(name, matrix), matrix.shape[1]
            self.lines.append(f"add({n}, {m}, {W}, dot_{signal}, {change});")
            self.used.add(f"dot_{signal}")
        return value

    def activate(self, value, size, sigma):
        """State value = sigma(value), and its change.

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
        self.lines += [f"for (i = 0; i < {size}; i++) {{", "    real d;"]
        self.lines += neuron_and_slope(sigma, self.numbers, f"{value}[i]", "d")
        self.lines += [f"    dot_{value}[i] *= d;", "}"]
        return value


def neuron_and_slope(sigma, numbers, w, d):
    """Return the statements that turn what a neuron sees into its value and slope.

    Parameters
    ----------
    sigma : Activation
        The activation.
    numbers : Numbers
        Type of all numbers.
    w : str
        What holds what it sees, and then its value.
    d : str
        What will hold the slope.

    Returns
    -------
    lines : list of str
        Lines of a block in C, with an own variable x.
    """
    f = numbers.suffix
    lines = [f"real x = {w};", f"{w} = {sigma.expression('c', v='x', f=f)};"]
    if "c_slope" in sigma.expressions:
        lines.append(f"{d} = {sigma.expression('c_slope', v='x', w=w, f=f)};")
    else:  # of an activation that says nothing of its derivative
        h = numbers.literal("h", np.sqrt(numbers.eps))
        ahead = sigma.expression("c", v="ahead", f=f)
        lines.append(f"real h = {h} * (1 + fabs{f}(x)), ahead = x + h;")
        lines.append(f"{d} = (({ahead}) - {w}) / (ahead - x);")
    return [f"    {line}" for line in lines]

"""Models in C99: fixed sizes, no allocation, nothing beyond math.h.

The sources state the equations of `Parts` once more.  What is compiled is compared with
Python in the tests, step by step.
"""

import re
from pathlib import Path

import numpy as np

from . import _c_source as text
from ._archive import release
from ._parts import Parts

WIDTH = 88  # columns of the sources
DEMO_SAMPLES = 200
SUFFIX = {"double": "", "float": "f"}


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
    model : estimator
        Fitted model.
    directory : str or path-like
        Folder, made if need be; files of the same names are replaced.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer()``, False leaves it
        out.
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
        or an activation is the user's.
    """
    if dtype not in SUFFIX:
        raise ValueError(f"`dtype` must be 'double' or 'float', got {dtype!r}.")
    if not isinstance(prefix, str) or not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", prefix):
        raise ValueError(
            "`prefix` must begin with a letter and consist of letters, digits and _, "
            f"got {prefix!r}. It begins names in C."
        )
    parts = Parts.of(model, law, observer, gain)
    source = _Source(parts, dtype, prefix, model._scaling)
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    files = {
        f"{prefix}.h": source.header(),
        f"{prefix}.c": source.source(),
        f"{prefix}_demo.c": source.demo(),
        "Makefile": text.MAKEFILE.substitute(source.names),
        "README.md": source.readme(),
    }
    paths = [directory / name for name in files]
    for path, content in zip(paths, files.values(), strict=True):
        path.write_text(content, encoding="ascii")
    return paths


class _Source:
    """Fill the templates for one model."""

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

    # -- header ------------------------------------------------------------------------

    def header(self):
        parts, names = self.parts, self.names
        sizes, declarations = [], ""
        if self.has_law:
            n, s = (self.nx, "x") if self.by_state else (self.ny, "y")
            sizes.append(f"#define {names['PREFIX']}_NS {n} /* what the law sees */")
            s = "the estimated state" if self.by_state else "the measured y"
            declarations += text.DECLARE_LAW.substitute(names, s=s)
        if parts.M is not None:
            declarations += text.DECLARE_OBSERVER.substitute(names)
        if parts.K_x is not None:
            n, r = (
                (self.ny, "in the units of y")
                if parts.integrates
                else (self.nu, "in the units of u")
            )
            sizes.append(f"#define {names['PREFIX']}_NR {n} /* references */")
            z = f"\n    {names['prefix']}_real z[{names['PREFIX']}_NY];"
            declarations += text.DECLARE_CONTROLLER.substitute(
                names,
                r=r,
                z_member=z if parts.integrates else "",
                z_comment=" z sums y - r." if parts.integrates else "",
            )
        return text.HEADER.substitute(
            names,
            equations="\n".join(f" *     {line}" for line in self._equations()),
            signals="\n".join(f" * {line}" for line in self._signals()),
            sizes="".join(f"{size}\n" for size in sizes),
            declarations=declarations,
        )

    def _equations(self):
        nets = self.parts.nets
        s = "x" if self.by_state else "y - y_offset"
        state = "A x + B (du + h(s))" if self.has_h else "A x + B du"
        state += " + g(x, du)" if "g" in nets else ""
        output = "C x" + (" + D du" if np.any(self.parts.D) else "")
        output += " + k(x, du)" if "k" in nets else ""
        lines = [f"x+ = {state}", f"y  = {output} + y_offset"]
        if self.has_h:
            lines.append(f"s  = {s}")
        late = ", as late as it arrives" if self.parts.n_late else ""
        return [*lines, f"du = u - u_offset{late}"]

    def _signals(self):
        delay = self.parts.delay
        for letter, signals in (("u", self.parts.inputs), ("y", self.parts.outputs)):
            for i, signal in enumerate(signals):
                late = delay[i] if letter == "u" else 0
                after = f", {late} samples late" if late else ""
                yield f"{letter}[{i}]: {_plain(signal)}{after}"

    # -- source ------------------------------------------------------------------------

    def source(self):
        return text.SOURCE.substitute(
            self.names,
            constants="\n".join(self._constants()),
            functions="".join(self._functions()),
        )

    def _constants(self):
        parts = self.parts
        matrices = {"A": parts.A, "B": parts.B, "C": parts.C}
        if np.any(parts.D):
            matrices["D"] = parts.D
        for net, perceptron in parts.nets.items():
            for i, (W, b) in enumerate(perceptron.layers, start=1):
                matrices |= {f"{net}_W{i}": W, f"{net}_b{i}": b}
        matrices |= {"u_offset": parts.u_offset, "y_offset": parts.y_offset}
        if parts.M is not None:
            matrices["M"] = parts.M
        if parts.K_x is not None:
            matrices["K_x"] = parts.K_x
        if parts.integrates:
            # what the limits cut off v is taken out of z, as in `feedback.controller`
            matrices |= {"K_z": parts.K_z, "back": np.linalg.pinv(parts.K_z)}
        if self._limited():
            matrices |= {"u_min": parts.law.u_min, "u_max": parts.law.u_max}
        for name, matrix in matrices.items():
            yield self._array(name, matrix)

    def _limited(self):
        law = self.parts.law
        return law is not None and bool(np.isfinite([law.u_min, law.u_max]).any())

    def _array(self, name, matrix):
        numbers = [self._number(name, value) for value in np.ravel(matrix)]
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

    def _number(self, name, value):
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

    def _functions(self):
        parts, names = self.parts, self.names
        used = {net.activation.name for net in parts.nets.values()}
        for sigma in sorted(used | ({"identity"} if used else set())):
            expression = text.EXPRESSIONS[sigma].substitute(f=SUFFIX[self.dtype])
            yield text.LAYER.substitute(sigma=sigma, expression=expression)
        for net, perceptron in parts.nets.items():
            layers = "\n".join(_layers(net, perceptron))
            yield text.NET.substitute(net=net, layers=layers)
        yield text.ARRIVED.substitute(inputs=self._arrived())
        yield text.DEVIATION.substitute(
            start="    net_k(xu, y);"
            if "k" in parts.nets
            else "    int i;\n    for (i = 0; i < NY; i++)\n        y[i] = 0;",
            D="\n    add(NY, NU, D, xu + NX, y);" if np.any(parts.D) else "",
        )
        yield self._step()
        yield text.OUTPUT.substitute(
            names,
            value="    real xu[NX + NU];\n    arrived(x, u, xu);\n    deviation(xu, y);"
            if self.feeds_through
            else "    (void)u;\n    deviation(x, y);",
        )
        if self.has_law:
            yield text.LAW.substitute(
                names, h=self._h(), limits=text.LIMITS if self._limited() else ""
            )
        if parts.M is not None:
            yield text.CORRECT.substitute(names)
        if parts.K_x is not None:
            yield self._control()

    def _arrived(self):
        if not self.parts.n_late:
            line = "xu[NX + i] = u[i] - u_offset[i];"
            return f"    for (i = 0; i < NU; i++)\n        {line}"
        oldest, lines = self.nx, []
        for i, delay in enumerate(self.parts.delay):
            value = f"x[{oldest}]" if delay else f"u[{i}] - u_offset[{i}]"
            lines.append(f"    xu[NX + {i}] = {value};")
            oldest += int(delay)
        if np.all(self.parts.delay):
            lines.append("    (void)u;")
        return "\n".join(lines)

    def _step(self):
        nets, lines = self.parts.nets, []
        if "g" in nets:
            lines.append("net_g(xu, next);")
        if self.has_h and self.by_state:
            lines.append("net_h(xu, v);")
        elif self.has_h:
            lines += ["deviation(xu, s);", "net_h(s, v);"]
        shift, oldest = [], self.nx
        for i, delay in enumerate(self.parts.delay):
            newest = oldest + int(delay) - 1
            if delay > 1:
                shift.append(f"for (i = {oldest}; i < {newest}; i++)")
                shift.append("    x[i] = x[i + 1];")
            if delay:
                shift.append(f"x[{newest}] = u[{i}] - u_offset[{i}];")
            oldest = newest + 1
        return text.STEP.substitute(
            self.names,
            s="\n    real s[NY];" if self.has_h and not self.by_state else "",
            nets="".join(f"\n    {line}" for line in lines),
            shift="".join(f"\n    {line}" for line in shift),
        )

    def _h(self):
        if not self.has_h:
            return "    (void)s;"
        if self.by_state:
            return "    net_h(s, h);"
        return (
            "    real ds[NY];\n"
            "    for (i = 0; i < NY; i++)\n"
            "        ds[i] = s[i] - y_offset[i];\n"
            "    net_h(ds, h);"
        )

    def _control(self):
        prefix, integrates = self.names["prefix"], self.parts.integrates
        fills = self.has_h and not self.by_state
        return text.CONTROL.substitute(
            self.names,
            s="\n    real s[NY];" if fills else "",
            reset_z="\n    for (i = 0; i < NY; i++)\n        c->z[i] = 0;"
            if integrates
            else "",
            Kz="\n    add(NU, NY, K_z, c->z, Kx);" if integrates else "",
            v_start="u_offset" if integrates else "r",
            # the law takes the output of the model for one that was not measured
            law=f"\n    {prefix}_output(c->x, 0, s);\n    for (i = 0; i < NY; i++)\n"
            "        s[i] = isnan(y[i]) ? s[i] : y[i];"
            if fills
            else "",
            measured="s" if fills else "c->x" if self.by_state else "y",
            integrate="\n    for (i = 0; i < NY; i++)\n"
            "        c->z[i] += isnan(y[i]) ? 0 : y[i] - r[i];\n"
            "    add(NY, NU, back, cut, c->z);"
            if integrates
            else "",
        )

    # -- demonstration and words -------------------------------------------------------

    def demo(self):
        parts, names = self.parts, self.names
        controlled = parts.K_x is not None
        prefix, scaling = names["prefix"], self.scaling
        if parts.integrates:
            signal, values = "r", parts.y_offset + 0.5 * scaling.y_scale
        elif controlled:
            signal, values = "r", parts.u_offset + 0.5 * scaling.u_scale
        else:
            signal, values = "u", parts.u_offset + scaling.u_scale
        loop = [f"        {prefix}_output(x, {'0' if controlled else 'u'}, y);"]
        if controlled:
            loop.append(f"        {prefix}_control(&c, r, y, u);")
        header = [
            *(f"y[{i}]" for i in range(self.ny)),
            *(f"u[{i}]" for i in range(self.nu)),
        ]
        start = [f'    printf("k,{",".join(header)}\\n");']
        if controlled:
            start.insert(0, f"    {prefix}_controller c;\n    {prefix}_reset(&c);")
        return text.DEMO.substitute(
            {**names, "what": names["what"].capitalize()},
            signal=signal,
            size=len(values),
            values=", ".join(self._number(signal, value) for value in values),
            u=f", u[{names['PREFIX']}_NU]" if controlled else "",
            start="\n".join(start),
            loop="\n".join(loop),
            samples=DEMO_SAMPLES,
        )

    def readme(self):
        parts, prefix = self.parts, self.names["prefix"]
        return text.README.substitute(
            self.names,
            order="\n".join(self._order()),
            units="\n".join(f"  - {line}" for line in self._signals()),
            notes="".join(f"- {note}\n" for note in self._notes(parts, prefix)),
        )

    def _order(self):
        prefix = self.names["prefix"]
        if self.parts.K_x is not None:
            yield f"1. Once: `{prefix}_reset(&c)`."
            yield "2. Measure y."
            yield f"3. `{prefix}_control(&c, r, y, u)`: corrects the estimate, applies"
            yield "   gain and law, and predicts the next state."
            yield "4. Apply u."
            return
        u = "u" if self.feeds_through else "0"
        yield "As a simulation:"
        yield ""
        yield f"1. `{prefix}_output(x, {u}, y)`"
        yield f"2. `{prefix}_step(x, u)`"
        if self.parts.M is None:
            return
        yield ""
        yield "As an observer, and with a controller of your own that computes v:"
        yield ""
        s = "x" if self.by_state else "y"
        act = f"`{prefix}_law(v, {s}, u, cut)`" if self.has_law else "Compute u"
        act += ", then apply u."
        correct = f"`{prefix}_correct(x, {u}, y)`: x is the estimate of this sample."
        # where y depends on u, u is chosen by the prediction
        steps = ["Measure y.", correct]
        steps = [act, *steps] if self.feeds_through else [*steps, act]
        for i, step in enumerate(steps, start=1):
            yield f"{i}. {step}"
        yield f"4. `{prefix}_step(x, u)`: x is the prediction for the next sample."

    def _notes(self, parts, prefix):
        if parts.M is not None:
            yield "The observer has a constant gain and predicts by the whole model."
        if parts.integrates:
            yield (
                "Integrators do not wind up: what the limits cut off is taken out of "
                "them."
            )
        if self.has_law and not self.has_h:
            yield "The model has no h: its law is u = v within the limits."
        if self.has_law and self.has_h and not self.by_state:
            yield f"`{prefix}_law` needs every output measured."
            if parts.K_x is not None:
                yield f"`{prefix}_control` takes the model's output for a missing one."
        if not self.has_law:
            yield f"No law: {_plain(parts.no_law)}"
        if parts.n_late:
            yield "Inputs arrive late; the state carries their past."


def _layers(net, perceptron):
    """Yield the lines that evaluate a network."""
    *hidden, (W_out, _) = perceptron.layers
    for i, (W, _) in enumerate(hidden, start=1):
        yield f"    real w{i}[{len(W)}];"
    x, last = "x", len(hidden) + 1
    for i, (W, _) in enumerate(hidden, start=1):
        rows, cols = W.shape
        call = f"layer_{perceptron.activation.name}({rows}, {cols}"
        yield f"    {call}, {net}_W{i}, {net}_b{i}, {x}, w{i});"
        x = f"w{i}"
    rows, cols = W_out.shape
    call = f"layer_identity({rows}, {cols}, {net}_W{last}, {net}_b{last}"
    yield f"    {call}, {x}, value);"


def _plain(words):
    """Return words that are safe in a comment of C."""
    return re.sub(r"[^A-Za-z0-9 _.,:;()\[\]'`=+-]", "_", str(words))

"""The header and the source of a C export: the templates, filled for one model."""

import numpy as np

from . import _c_source as text
from ._c_model import SUFFIX


def header(model):
    """Return the header: what can be called, and what it expects.

    Parameters
    ----------
    model : CModel
        The model.

    Returns
    -------
    text : str
        Source in C.
    """
    parts, names = model.parts, model.names
    sizes, declarations = [], ""
    if model.has_law:
        n, s = (model.nx, "x") if model.by_state else (model.ny, "y")
        sizes.append(f"#define {names['PREFIX']}_NS {n} /* what the law sees */")
        s = "the estimated state" if model.by_state else "the measured y"
        declarations += text.DECLARE_LAW.substitute(names, s=s)
    if parts.M is not None:
        declarations += text.DECLARE_OBSERVER.substitute(names)
    if parts.K_x is not None:
        n, r = (
            (model.ny, "in the units of y")
            if parts.integrates
            else (model.nu, "in the units of u")
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
        equations="\n".join(f" *     {line}" for line in _equations(model)),
        signals="\n".join(f" * {line}" for line in model.signals()),
        sizes="".join(f"{size}\n" for size in sizes),
        declarations=declarations,
    )


def _equations(model):
    nets = model.parts.nets
    s = "x" if model.by_state else "y - y_offset"
    state = "A x + B (du + h(s))" if model.has_h else "A x + B du"
    state += " + g(x, du)" if "g" in nets else ""
    output = "C x" + (" + D du" if np.any(model.parts.D) else "")
    output += " + k(x, du)" if "k" in nets else ""
    lines = [f"x+ = {state}", f"y  = {output} + y_offset"]
    if model.has_h:
        lines.append(f"s  = {s}")
    late = ", as late as it arrives" if model.parts.n_late else ""
    return [*lines, f"du = u - u_offset{late}"]


def source(model):
    """Return the source: the numbers, and the functions that the model needs.

    Parameters
    ----------
    model : CModel
        The model.

    Returns
    -------
    text : str
        Source in C.
    """
    return text.SOURCE.substitute(
        model.names,
        constants="\n".join(_constants(model)),
        functions="".join(_functions(model)),
    )


def _constants(model):
    parts = model.parts
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
    if model.limited:
        matrices |= {"u_min": parts.law.u_min, "u_max": parts.law.u_max}
    for name, matrix in matrices.items():
        yield model.array(name, matrix)


def _functions(model):
    parts, names = model.parts, model.names
    used = {net.activation.name for net in parts.nets.values()}
    for sigma in sorted(used | ({"identity"} if used else set())):
        expression = text.EXPRESSIONS[sigma].substitute(f=SUFFIX[model.dtype])
        yield text.LAYER.substitute(sigma=sigma, expression=expression)
    for net, perceptron in parts.nets.items():
        layers = "\n".join(_layers(net, perceptron))
        yield text.NET.substitute(net=net, layers=layers)
    yield text.ARRIVED.substitute(inputs=_arrived(model))
    yield text.DEVIATION.substitute(
        start="    net_k(xu, y);"
        if "k" in parts.nets
        else "    int i;\n    for (i = 0; i < NY; i++)\n        y[i] = 0;",
        D="\n    add(NY, NU, D, xu + NX, y);" if np.any(parts.D) else "",
    )
    yield _step(model)
    yield text.OUTPUT.substitute(
        names,
        value="    real xu[NX + NU];\n    arrived(x, u, xu);\n    deviation(xu, y);"
        if model.feeds_through
        else "    (void)u;\n    deviation(x, y);",
    )
    if model.has_law:
        yield text.LAW.substitute(
            names, h=_h(model), limits=text.LIMITS if model.limited else ""
        )
    if parts.M is not None:
        yield text.CORRECT.substitute(names)
    if parts.K_x is not None:
        yield _control(model)


def _arrived(model):
    if not model.parts.n_late:
        line = "xu[NX + i] = u[i] - u_offset[i];"
        return f"    for (i = 0; i < NU; i++)\n        {line}"
    oldest, lines = model.nx, []
    for i, delay in enumerate(model.parts.delay):
        value = f"x[{oldest}]" if delay else f"u[{i}] - u_offset[{i}]"
        lines.append(f"    xu[NX + {i}] = {value};")
        oldest += int(delay)
    if np.all(model.parts.delay):
        lines.append("    (void)u;")
    return "\n".join(lines)


def _step(model):
    nets, lines = model.parts.nets, []
    if "g" in nets:
        lines.append("net_g(xu, next);")
    if model.has_h and model.by_state:
        lines.append("net_h(xu, v);")
    elif model.has_h:
        lines += ["deviation(xu, s);", "net_h(s, v);"]
    shift, oldest = [], model.nx
    for i, delay in enumerate(model.parts.delay):
        newest = oldest + int(delay) - 1
        if delay > 1:
            shift.append(f"for (i = {oldest}; i < {newest}; i++)")
            shift.append("    x[i] = x[i + 1];")
        if delay:
            shift.append(f"x[{newest}] = u[{i}] - u_offset[{i}];")
        oldest = newest + 1
    return text.STEP.substitute(
        model.names,
        s="\n    real s[NY];" if model.has_h and not model.by_state else "",
        nets="".join(f"\n    {line}" for line in lines),
        shift="".join(f"\n    {line}" for line in shift),
    )


def _h(model):
    if not model.has_h:
        return "    (void)s;"
    if model.by_state:
        return "    net_h(s, h);"
    return (
        "    real ds[NY];\n"
        "    for (i = 0; i < NY; i++)\n"
        "        ds[i] = s[i] - y_offset[i];\n"
        "    net_h(ds, h);"
    )


def _control(model):
    prefix, integrates = model.names["prefix"], model.parts.integrates
    fills = model.has_h and not model.by_state
    return text.CONTROL.substitute(
        model.names,
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
        measured="s" if fills else "c->x" if model.by_state else "y",
        integrate="\n    for (i = 0; i < NY; i++)\n"
        "        c->z[i] += isnan(y[i]) ? 0 : y[i] - r[i];\n"
        "    add(NY, NU, back, cut, c->z);"
        if integrates
        else "",
    )


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

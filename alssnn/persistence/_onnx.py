"""Models as ONNX graphs in double precision: one step, and the law.

The graphs state the equations of `Parts` for rows: every input and output has the
shape (N, n), where the N rows are as many plants, or samples of a law.  A step is

    x, u -> x_next, y        x deviations, behind them the past of late inputs

and stepping is left to whoever runs the graph, as in C.
"""

import json
import re
from pathlib import Path

import numpy as np

from ._archive import release
from ._parts import Parts

OPSET = 17
IR_VERSION = 8  # the one of that opset, for runtimes that are not the newest
# operators of the activations; identity needs none
OPERATORS = {"tanh": "Tanh", "sigmoid": "Sigmoid", "relu": "Relu", "sin": "Sin"}


def to_onnx(model, directory, *, law=None, prefix="plant"):
    """Write one step of a fitted model, and its law, as ONNX graphs.

    Parameters
    ----------
    model : estimator
        Fitted model.
    directory : str or path-like
        Folder, made if need be; files of the same names are replaced.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    prefix : str, default="plant"
        Begins the names of the files.

    Returns
    -------
    paths : list of Path
        The files, ``plant_step.onnx`` and, where there is a law, ``plant_law.onnx``.

    Raises
    ------
    ImportError
        If onnx is not installed.
    NotFittedError
        If the model is not fitted.
    OSError
        If a file cannot be written.
    TypeError
        If `law` is of another type.
    ValueError
        If the law is of another model, `prefix` is no name, or an activation is the
        user's.
    """
    if not isinstance(prefix, str) or not re.fullmatch(r"\w[\w.-]*", prefix):
        raise ValueError(
            "`prefix` must consist of letters, digits, and -, _ or . after the first "
            f"one, got {prefix!r}. It begins the names of files; the folder is "
            "`directory`."
        )
    parts = Parts.of(model, law, observer=False)
    onnx = _onnx()
    graphs = {"step": _step(parts)}
    if parts.law is not None:
        graphs["law"] = _law(parts)
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, graph in graphs.items():
        paths.append(directory / f"{prefix}_{name}.onnx")
        written = graph.model(onnx, name, _metadata(parts))
        paths[-1].write_bytes(written.SerializeToString())
    return paths


def _onnx():
    try:
        import onnx
    except ImportError as error:
        raise ImportError(
            "`to_onnx` needs the package onnx, which could not be imported. Install "
            'it by pip install "alssnn[onnx]", or write the model by `to_c` or '
            "`to_mat`."
        ) from error
    return onnx


def _step(parts):
    """Return the graph of x, u -> x_next, y (eq. model)."""
    nx, nu = parts.B.shape
    graph = _Graph()
    x = graph.input("x", nx + parts.n_late)
    u = graph.input("u", nu)
    # columns of [x; past; u - u_offset]: what has arrived, and what is past next
    arrived, past, oldest = list(range(nx)), [], nx
    for i, delay in enumerate(map(int, parts.delay)):
        line = [*range(oldest, oldest + delay), nx + parts.n_late + i]
        arrived.append(line[0])
        past += line[1:]
        oldest += delay
    signals = graph.node("Concat", x, graph.shift(u, -parts.u_offset), axis=-1)
    xu = graph.columns(signals, arrived)
    own, du = graph.columns(xu, range(nx)), graph.columns(xu, range(nx, nx + nu))

    dy = graph.affine(own, parts.C)
    if np.any(parts.D):
        dy = graph.node("Add", dy, graph.affine(du, parts.D))
    if "k" in parts.nets:
        dy = graph.node("Add", dy, graph.net(xu, parts.nets["k"]))
    if "h" in parts.nets:
        s = own if parts.feedback == "state" else dy
        du = graph.node("Add", du, graph.net(s, parts.nets["h"]))
    plus = graph.node("Add", graph.affine(own, parts.A), graph.affine(du, parts.B))
    if "g" in parts.nets:
        plus = graph.node("Add", plus, graph.net(xu, parts.nets["g"]))
    if past:
        plus = graph.node("Concat", plus, graph.columns(signals, past), axis=-1)
    graph.output("x_next", plus, nx + parts.n_late)
    graph.output("y", graph.shift(dy, parts.y_offset), len(parts.C))
    return graph


def _law(parts):
    """Return the graph of v, s -> u (eq. loop), s the measured y or the state x."""
    nx, nu = parts.B.shape
    by_state = parts.feedback == "state"
    graph = _Graph()
    u = graph.input("v", nu)
    s = graph.input(*(("x", nx) if by_state else ("y", len(parts.C))))
    if "h" in parts.nets:
        ds = s if by_state else graph.shift(s, -parts.y_offset)
        u = graph.node("Sub", u, graph.net(ds, parts.nets["h"]))
    for operator, limit in (("Max", parts.law.u_min), ("Min", parts.law.u_max)):
        if np.isfinite(limit).any():
            u = graph.node(operator, u, graph.constant(limit))
    graph.output("u", u, nu)
    return graph


def _metadata(parts):
    """Return what a reader has to know, as texts; lists are JSON."""
    late = [
        f"{name}, {k} samples ago"
        for name, delay in zip(parts.inputs, map(int, parts.delay), strict=True)
        for k in range(delay, 0, -1)
    ]
    states = [f"x{i}" for i in range(len(parts.A))] + late
    return {
        "model": parts.name,
        "dt": repr(parts.dt),
        "inputs": json.dumps(list(parts.inputs)),
        "outputs": json.dumps(list(parts.outputs)),
        "states": json.dumps(states),
        "feedback": parts.feedback,
        "no_law": parts.no_law,
    }


class _Graph:
    """Collect nodes and constants; every method returns the name of its value."""

    def __init__(self):
        self.nodes, self.constants, self.inputs, self.outputs = [], [], [], []

    def input(self, name, size):
        self.inputs.append((name, size))
        return name

    def output(self, name, value, size):
        self.nodes.append(("Identity", [value], name, {}))
        self.outputs.append((name, size))

    def constant(self, values):
        self.constants.append(np.asarray(values))
        return f"constant_{len(self.constants)}"

    def node(self, operator, *values, **attributes):
        name = f"value_{len(self.nodes)}"
        self.nodes.append((operator, list(values), name, attributes))
        return name

    def columns(self, value, indices):
        indices = self.constant(np.array(indices, dtype=np.int64))
        return self.node("Gather", value, indices, axis=-1)

    def shift(self, value, offset):
        return self.node("Add", value, self.constant(offset))

    def affine(self, value, W, b=None):
        value = self.node("MatMul", value, self.constant(W.T))
        return value if b is None else self.shift(value, b)

    def net(self, value, perceptron):
        *hidden, last = perceptron.layers
        for W, b in hidden:
            value = self.affine(value, W, b)
            if perceptron.activation.name in OPERATORS:
                value = self.node(OPERATORS[perceptron.activation.name], value)
        return self.affine(value, *last)

    def model(self, onnx, name, metadata):
        helper, double = onnx.helper, onnx.TensorProto.DOUBLE
        nodes = [
            helper.make_node(operator, values, [value], **attributes)
            for operator, values, value, attributes in self.nodes
        ]
        inputs, outputs = (
            [helper.make_tensor_value_info(n, double, ["N", m]) for n, m in signals]
            for signals in (self.inputs, self.outputs)
        )
        constants = [
            onnx.numpy_helper.from_array(np.ascontiguousarray(values), f"constant_{i}")
            for i, values in enumerate(self.constants, start=1)
        ]
        graph = helper.make_graph(nodes, name, inputs, outputs, constants)
        model = helper.make_model(
            graph,
            producer_name="alssnn",
            producer_version=release(),
            opset_imports=[helper.make_opsetid("", OPSET)],
            ir_version=IR_VERSION,
        )
        helper.set_model_props(model, metadata)
        onnx.checker.check_model(model, full_check=True)
        return model

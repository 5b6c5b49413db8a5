"""Models as ONNX graphs in double precision: one step, and the law.

The graphs state the maps of a plant for rows: every input and output has the shape
(N, n), where the N rows are as many plants, or samples of a law.  A step is

    x, u -> x_next, y        x deviations, behind them the past of late inputs

and stepping is left to whoever runs the graph, as in C.
"""

import json
import re
from dataclasses import replace

import numpy as np

from ..walk import static_map, walk
from ..whole_files import write_files
from ._archive import release
from ._export import Export, extra

OPSET = 17
SOLVED = (
    "The law of this model is solved for u, by iteration, which is not written as a "
    "graph. `to_c` writes it."
)
IR_VERSION = 8  # the one of that opset, for runtimes that are not the newest


def to_onnx(model, directory, *, law=None, prefix="plant"):
    """Write one step of a fitted model, and its law, as ONNX graphs.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    directory : str or path-like
        Folder, made if need be; files of the same names are replaced.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed. That of a monotone input map is left
        out, too, for it iterates.
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
        If the law is of another model, `prefix` is no name, or an activation has no
        operator of ONNX.
    """
    if not isinstance(prefix, str) or not re.fullmatch(r"\w[\w.-]*", prefix):
        raise ValueError(
            "`prefix` must consist of letters, digits, and -, _ or . after the first "
            f"one, got {prefix!r}. It begins the names of files; the folder is "
            "`directory`."
        )
    export = Export.of(model, law, observer=False)
    if export.law is not None and export.plant.is_solved:
        export = replace(export, law=None, no_law=SOLVED)
    with extra("onnx", "`to_c` or `to_mat`"):
        import onnx
    graphs = {"step": _step(export.late)}
    if export.law is not None:
        graphs["law"] = _law(export)
    contents = {
        f"{prefix}_{name}.onnx": graph.model(onnx, name, _metadata(export))
        for name, graph in graphs.items()
    }
    return write_files(directory, contents)


def _step(plant):
    """Return the graph of x, u -> x_next, y (eq. lure)."""
    nx, nu, ny = plant.nx, plant.nu, plant.ny
    graph = _Graph()
    x, u = graph.input("x", nx), graph.input("u", nu)
    du = graph.shift(u, "u_offset", -plant.u_offset)
    both = static_map(plant.form, slice(0, nx + ny))
    both = walk(both, {x: nx, du: nu}, graph, "x_next_dy")
    graph.output("x_next", graph.columns(both, "states", range(nx)), nx)
    dy = graph.columns(both, "outputs", range(nx, nx + ny))
    graph.output("y", graph.shift(dy, "y_offset", plant.y_offset), ny)
    return graph


def _law(export):
    """Return the graph of v, s, d -> u (eq. loop), s the measured y or the state x."""
    plant, law, h = export.plant, export.law, export.h
    by_state = plant.feedback == "state"
    graph = _Graph()
    u, nv, nd = graph.input("v", plant.nv), plant.nv, plant.nd
    ns = plant.law_form.nu - plant.nu
    s = graph.input("x" if by_state else "y", ns)
    s = s if by_state else graph.shift(s, "y_offset", -plant.y_offset)
    given = {}
    if nd:
        d = graph.input("d", nd)
        given = {graph.shift(d, "d_offset", -plant.d_offset): nd}
    if plant.looks_ahead:
        wanted = {graph.shift(u, "v_offset", -plant.v_offset): nv}
        s = walk(export.middle, {s: ns, **given, **wanted}, graph, "middle")
    h = walk(h, {s: h.nu - nd, **given}, graph, "h")
    u = graph.node("Sub", u, h)
    for operator, name in (("Max", "u_min"), ("Min", "u_max")):
        limit = getattr(law, name)
        if np.isfinite(limit).any():
            u = graph.node(operator, u, graph.constant(name, limit))
    graph.output("u", u, nv)
    return graph


def _metadata(export):
    """Return what a reader has to know, as texts; lists are JSON."""
    plant = export.plant
    late = [
        f"{name}, {k} samples ago"
        for name, delay in zip(plant.inputs, map(int, plant.delay), strict=True)
        for k in range(delay, 0, -1)
    ]
    return {
        "model": plant.name,
        "dt": repr(plant.dt),
        "inputs": json.dumps(list(plant.inputs)),
        "outputs": json.dumps(list(plant.outputs)),
        "disturbances": json.dumps([plant.inputs[i] for i in plant.given]),
        "states": json.dumps([f"x{i}" for i in range(plant.nx)] + late),
        "feedback": plant.feedback,
        "hold": export.held,
        "no_law": export.no_law,
    }


class _Graph:
    """Collect nodes and constants, see `walk`; methods return the names of values."""

    def __init__(self):
        self.nodes, self.constants, self.inputs, self.outputs = [], {}, [], []

    def input(self, name, size):
        self.inputs.append((name, size))
        return name

    def output(self, name, value, size):
        self.nodes.append(("Identity", [value], name, {}))
        self.outputs.append((name, size))

    def constant(self, name, values):
        self.constants[name] = np.ascontiguousarray(values)
        return name

    def node(self, operator, *values, name="", **attributes):
        name = name or f"value_{len(self.nodes)}"
        self.nodes.append((operator, list(values), name, attributes))
        return name

    def columns(self, value, name, indices):
        indices = self.constant(name, np.array(indices, dtype=np.int64))
        return self.node("Gather", value, indices, axis=-1)

    def shift(self, value, name, offset):
        shifted = f"{value}_shifted"
        return self.node("Add", value, self.constant(name, offset), name=shifted)

    def affine(self, value, terms, constant):
        total = self.constant(f"{value}_{constant[0]}", constant[1])
        for name, matrix, signal in terms:
            W = self.constant(f"{value}_{name}", matrix.T)
            total = self.node("Add", self.node("MatMul", signal, W), total)
        return total

    def activate(self, value, size, sigma):
        return self.node(sigma.expression("onnx"), value)

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
            onnx.numpy_helper.from_array(values, name)
            for name, values in self.constants.items()
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
        return model.SerializeToString()

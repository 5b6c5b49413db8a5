"""Models as functions of CasADi, for optimal control and estimation by others.

The functions are the maps of a plant, stated layer by layer (`walk`), and what stands
around them: observer, gain and limits, as in C.  All states are arguments, so that
stepping is left to whoever calls:

    step      x, u -> x_next            output    x, u -> y
    law       v, s, d -> u, cut         correct   x, y, u -> x_hat
    control   x, z, r, y, d -> u, x_next, z_next

A law that is solved for u is a root of phi(u, s) - v (eq. inverse), which CasADi
differentiates by the implicit function theorem.
"""

import numpy as np

from ..walk import static_map, walk
from ._export import Export, extra
from ._parts import Parts

# Newton's method on a residual in sizes of u, by steps to rounding
NEWTON = {"abstol": 1e-13, "abstolStep": 1e-15, "max_iter": 200, "error_on_fail": False}


SIGNALS = {  # arguments and results of the functions
    "step": ("xu", ["x_next"]),
    "output": ("xu", ["y"]),
    "law": ("vsd", ["u", "cut"]),
    "correct": ("xyu", ["x_hat"]),
    "control": ("xzryd", ["u", "x_next", "z_next"]),
}


def to_casadi(model, *, law=None, observer=None, gain=None):
    """Return a fitted model, its law, observer and controller as CasADi functions.

    Parameters
    ----------
    model : estimator, Plant or LinearizingController
        Fitted model, or its `plant_`; or a controller, which has all the parts below.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer(gate=100)``, False
        leaves it out.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of a controller, as for `feedback.closed_loop`.

    Returns
    -------
    functions : dict of str to casadi.Function
        "step" and "output", "law" where there is one, "correct" of the observer, and
        "control" with a `gain`; behind each ``f_jacobian`` with the derivatives of its
        outputs by its inputs, such as ``dx_next_du``. Signals are columns in the units
        of the data; states are deviations, behind them the past of late inputs, oldest
        first. s is y or x, whatever the law measures, and d the measured disturbances
        (no rows without any). What is not finite in y was not measured; all else must
        be finite.

    Raises
    ------
    ImportError
        If CasADi is not installed.
    NotFittedError
        If the model is not fitted.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, or an activation has no expression in
        CasADi.

    Notes
    -----
    The functions are of double precision. All but a law that is solved for u, and its
    controller, are expanded to scalars; those hold a Newton iteration (eq. inverse).
    """
    export = Export.of(model, law, observer, gain)
    with extra("casadi", "`to_c` or `to_onnx`"):
        import casadi
    return _Functions(casadi, export).every()


class _Expressions:
    """State a static map as expressions, see `walk`."""

    def __init__(self, casadi, **values):
        self.casadi, self.values = casadi, values

    def affine(self, value, terms, constant):
        total = self.casadi.DM(constant[1])
        for _, matrix, signal in terms:
            W = self.casadi.sparsify(self.casadi.DM(matrix))
            total = total + W @ self.values[signal]
        self.values[value] = total
        return value

    def activate(self, value, size, sigma):
        v = self.values[value]
        # the user's own words, or ours: no file brings any
        names = {**vars(self.casadi), "v": v}
        self.values[value] = eval(sigma.expression("casadi", v="v"), names)
        return value


class _Functions:
    """Make the functions of an export."""

    def __init__(self, casadi, export):
        self.casadi, self.export = casadi, export
        self.plant, self.late = export.plant, export.late
        self.sizes = {**Parts(export).sizes, "x": self.late.nx}

    def every(self):
        """Return all functions by their names, every one with its Jacobian."""
        export = self.export
        parts = {"law": export.law, "correct": export.M, "control": export.K_x}
        missing = {name for name, part in parts.items() if part is None}
        made = {name: self.function(name) for name in SIGNALS if name not in missing}
        jacobians = {f"{n}_jacobian": self.jacobian(f) for n, f in made.items()}
        return {**made, **jacobians}

    def function(self, name):
        """Return the function of a method, in scalars where no root is sought."""
        casadi, (letters, outputs) = self.casadi, SIGNALS[name]
        is_root = name in ("law", "control") and self.plant.is_solved
        symbol = casadi.MX.sym if is_root else casadi.SX.sym
        signals = [symbol(letter, self.sizes[letter]) for letter in letters]
        values = getattr(self, name)(*signals)
        values = list(values) if len(outputs) > 1 else [values]
        return casadi.Function(name, signals, values, list(letters), outputs)

    def jacobian(self, function):
        """Return the derivatives of all outputs by all inputs."""
        casadi = self.casadi
        names, outputs = function.name_in(), function.name_out()
        symbol = casadi.SX.sym if function.is_a("SXFunction") else casadi.MX.sym
        signals = [symbol(n, function.size1_in(n)) for n in names]
        values = function.call(signals)
        slopes = {
            f"d{output}_d{name}": casadi.jacobian(value, signal)
            for output, value in zip(outputs, values, strict=True)
            for name, signal in zip(names, signals, strict=True)
        }
        name = f"{function.name()}_jacobian"
        return casadi.Function(
            name, signals, list(slopes.values()), names, list(slopes)
        )

    def state(self, lure, **values):
        """Return the channels of a static map of values."""
        sizes = {name: value.shape[0] for name, value in values.items()}
        writer = _Expressions(self.casadi, **values)
        return writer.values[walk(lure, sizes, writer, "channels")]

    def step(self, x, u):
        lure = static_map(self.late.form, slice(0, self.late.nx))  # (eq. lure)
        return self.state(lure, x=x, du=u - self.plant.u_offset)

    def output(self, x, u):
        nx, plant = self.late.nx, self.plant
        lure = static_map(self.late.form, slice(nx, nx + plant.ny))
        return self.state(lure, x=x, du=u - plant.u_offset) + plant.y_offset

    def law(self, v, s, d):
        """Return u within the limits, and what they cut off v (eq. loop)."""
        casadi, plant, law = self.casadi, self.plant, self.export.law
        if plant.feedback == "output":
            s = s - plant.y_offset
        d = d - plant.d_offset
        if plant.looks_ahead:
            s = self.state(self.export.middle, s=s, d=d, v=v - plant.v_offset)
        seen = casadi.vertcat(s, d)
        if not plant.is_solved:
            wanted = v - self.state(self.export.h, s=seen)
        else:
            wanted = plant.v_offset + plant.v_scale * self.root(v, seen)
        u = casadi.fmin(casadi.fmax(wanted, law.u_min), law.u_max)
        if not plant.is_solved:
            return u, wanted - u
        # phi couples inputs: a limit of one takes off v of all
        met = casadi.sum1(casadi.fabs(u - wanted)) > 0
        cut = v - plant.v_offset - self.phi(u - plant.v_offset, seen)
        return u, casadi.if_else(met, cut, 0)

    def phi(self, du, seen):
        plant = self.plant
        lure = static_map(plant.solved_map.form, slice(0, plant.nv))
        return self.state(lure, s=seen, du=du)

    def root(self, v, seen):
        """Return the q = du / v_scale with phi(du, s) = dv (eq. inverse)."""
        casadi, plant = self.casadi, self.plant
        q, p = casadi.SX.sym("q", plant.nv), casadi.SX.sym("p", seen.shape[0])
        dv = casadi.SX.sym("dv", plant.nv)
        miss = (self.phi(q * plant.v_scale, p) - dv) / plant.v_scale
        both = casadi.vertcat(p, dv)
        residual = casadi.Function("miss", [q, both], [miss])
        solve = casadi.rootfinder("solve", "newton", residual, NEWTON)
        start = casadi.DM.zeros(plant.nv)
        return solve(start, casadi.vertcat(seen, v - plant.v_offset))

    def correct(self, x, y, u):
        """Return the corrected state; an innovation counts as the gate at most."""
        casadi, export = self.casadi, self.export
        e = y - self.output(x, u)
        e = casadi.if_else(self.is_finite(e), e, 0)
        if export.gate is not None:
            e = casadi.fmin(casadi.fmax(e, -export.gate), export.gate)
        return x + casadi.DM(export.M) @ e

    def control(self, x, z, r, y, d):
        """Return u and the states of one sample later, as `plant_control` in C."""
        casadi, plant, export = self.casadi, self.plant, self.export
        u_rest = casadi.DM(plant.u_offset)  # y depends on no u, or there is no gain
        expected, measured = self.output(x, u_rest), self.is_finite(y)
        if export.gate is not None:
            low, high = expected - export.gate, expected + export.gate
            y = casadi.if_else(measured, casadi.fmin(casadi.fmax(y, low), high), y)
        x = self.correct(x, y, u_rest)
        v = plant.v_offset if export.integrates else r
        v = v - casadi.DM(export.K_x) @ x
        if export.integrates:
            v = v - casadi.DM(export.K_z) @ z
        s = x[: self.sizes["s"]]
        if plant.feedback == "output":
            s = casadi.if_else(measured, y, self.output(x, u_rest))
        u, cut = self.law(v, s, d)
        if export.integrates:
            back = casadi.DM(export.back)
            z = z + casadi.if_else(measured, y - r, 0) + back @ cut
        places = np.argsort([*plant.moved, *plant.given]).tolist()
        every = casadi.vertcat(u, d)[places]
        return u, self.step(x, every), z

    def is_finite(self, value):
        return self.casadi.fabs(value) <= np.finfo(float).max

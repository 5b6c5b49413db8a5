"""Exports against Python: the largest deviation of every target, over all structures.

    python -m benchmarks.where_it_runs [--steps 1000] [--only C ONNX]

The plants are those of the tests: every structure of their list with random
parameters, and ten loops with limits, gate, missing measurements, spikes, measured
disturbances and laws that look ahead (tests/exported.py).  Per target the largest
deviation from Python over steps and outputs of all structures, each from `--steps`
random states; over derivatives there, where a target has them; over the inputs that the
controller sends in as many samples of every closed loop; and over y and u of a loop
that is exported as a whole; all over the range of what is expected.  Writes
doc/benchmarks/where_it_runs.csv.  Exits with 1 if one is above 1e-12 in double, 1e-4 in
single precision.  Needs gcc, GNU Octave and the packages onnx, casadi, fmpy, blark and
pymoca; a target whose program or package is missing has the row "not run".
"""

import argparse
import importlib.util
import os
import shutil
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np

from alssnn.persistence import to_casadi, to_fmu, to_onnx
from benchmarks._tables import OUT, machine, replace_runs
from exported import CONTROLLED, NAMES, Loop, make_plant, signals

LIMITS = {"double": 1e-12, "float": 1e-4}
# what is written, and how it is run here
TARGETS = {
    "C, double": ("model, law, observer, controller", "compiled by gcc"),
    "C, float": ("model, law, observer, controller", "compiled by gcc"),
    "ONNX": ("model, law", "reference evaluator of onnx"),
    "CasADi": ("model, law, observer, controller, Jacobians", "virtual machine"),
    "FMU 3.0": ("model, its slopes, controller, loop", "validated and run by fmpy"),
    "FMU 2.0": ("model, its slopes, controller, loop", "validated and run by fmpy"),
    "MATLAB": ("model, law, observer, controller", "functions of the manual in Octave"),
    "Modelica": ("model, law, observer, controller", "parsed by pymoca, run from it"),
    "ST, LREAL": ("model, law, observer, controller", "parsed by blark, run from it"),
    "ST, REAL": ("model, law, observer, controller", "parsed by blark, run from it"),
}
FIGURES = ("model", "derivatives", "controller", "loop")
COLUMNS = ("target", "holds", "run here", "samples", *FIGURES)
NEEDS = {"ONNX": "onnx", "CasADi": "casadi", "FMU": "fmpy"}
NEEDS |= {"ST": "blark", "Modelica": "pymoca"}


def deviation(found, expected):
    """Return the largest difference over the range of what is expected."""
    found, expected = np.asarray(found), np.asarray(expected)
    size = np.ptp(expected, axis=0)
    error = np.abs(found - expected).max(axis=0)
    return float((error[size > 0] / size[size > 0]).max(initial=0.0))


def slope_deviation(found, expected):
    """Return the largest difference of derivatives over the largest derivative."""
    size = max(np.abs(expected).max(initial=0.0), 1.0)
    return float(np.abs(found - expected).max(initial=0.0) / size)


class Target:
    """Run exports of one target: model steps, and a controller as a function."""

    def __init__(self, name, folder):
        self.name, self.folder = name, folder
        self.dtype = "float" if name in ("C, float", "ST, REAL") else "double"
        self.kind = np.float32 if self.dtype == "float" else np.float64

    def model(self, plant, x, u):
        """Return states one sample later, and outputs."""
        raise NotImplementedError

    def derivatives(self, plant, x, u):
        """Return pairs of what is found and expected, for one sample."""
        raise NotImplementedError

    def controller(self, loop):
        """Return the function of r, y and d."""
        raise NotImplementedError

    def inputs(self, loop, n):
        """Return what the controller sends in a closed loop, and what is expected."""
        _, u = loop.run(self.controller(loop), n)
        return u, loop.run(loop.controller(), n)[1]

    def loop(self, loop, n):
        """Return y and u of a loop that is exported as a whole."""
        raise NotImplementedError


class C(Target):
    def model(self, plant, x, u):
        from test_c import Compiled

        folder = tempfile.mkdtemp(dir=self.folder)
        c = Compiled(plant, Path(folder), self.dtype, observer=False)
        after, y = c.array(x).copy(), c.zeros((len(x), plant.ny))
        for x_k, u_k, y_k in zip(after, c.array(u), y, strict=True):
            c.output(x_k, u_k, y_k)
            c.step(x_k, u_k)
        return after, y

    def controller(self, loop):
        from test_c_law import controller

        return controller(loop, Path(tempfile.mkdtemp(dir=self.folder)), self.dtype)


class Onnx(Target):
    def model(self, plant, x, u):
        from onnx.reference import ReferenceEvaluator

        path = to_onnx(plant, self.folder)[0]
        return ReferenceEvaluator(str(path)).run(None, {"x": x, "u": u})


class Casadi(Target):
    def model(self, plant, x, u):
        f = to_casadi(plant, observer=False)
        states, inputs = x.T, u.T
        maps = (f[name].map(len(x)) for name in ("step", "output"))
        return [np.array(g(states, inputs)).T for g in maps]

    def derivatives(self, plant, x, u):
        f, late = to_casadi(plant, observer=False), plant.late()
        found = {
            **f["step_jacobian"](x=x[0], u=u[0]),
            **f["output_jacobian"](x=x[0], u=u[0]),
        }
        names = ("dx_next_dx", "dx_next_du", "dy_dx", "dy_du")
        expected = late.jacobian(x[0], u[0])
        return zip((np.array(found[n]) for n in names), expected, strict=True)

    def controller(self, loop):
        control = to_casadi(loop.plant, **loop.options)["control"]
        x, z = np.zeros(control.size1_in("x")), np.zeros(control.size1_in("z"))

        def step(r, y, d):
            nonlocal x, z
            u, x, z = (np.array(w).ravel() for w in control(x, z, r, y, d))
            return u

        return step


class FmuTarget(Target):
    def slave(self, plant, **options):
        from test_fmu import Slave

        path = Path(tempfile.mkdtemp(dir=self.folder)) / "a.fmu"
        return Slave(to_fmu(plant, path, version=self.name[-3:], **options))

    def model(self, plant, x, u):
        slave = self.slave(plant)
        after, y = x.copy(), np.empty((len(x), plant.ny))
        for k in range(len(x)):
            slave.reset(**dict(zip(slave.states, x[k], strict=True)))
            y[k] = slave.sample(plant.dt, u[k])
            after[k] = slave.get(slave.states)
        slave.close()
        return after, y

    def controller(self, loop):
        slave = self.slave(loop.plant, what="controller", **loop.options)
        return lambda *signals: slave.sample(loop.plant.dt, *signals)

    def derivatives(self, plant, x, u):
        slave, (_, _, C, D) = self.slave(plant), plant.late().jacobian(x[0], u[0])
        slave.reset(**dict(zip(slave.states, x[0], strict=True)))
        slave.set(slave.inputs, u[0])
        found = [slave.slopes(known) for known in (slave.states, slave.inputs)]
        slave.close()
        return zip(found, (C, D), strict=True)

    def loop(self, loop, n):
        slave = self.slave(loop.plant, what="both", **loop.options)
        r, _, d = loop.signals(n)
        dt = loop.plant.dt
        found = [slave.sample(dt, *z) for z in zip(r, d, strict=True)]
        slave.close()
        return np.array(found)


class StructuredText(Target):
    def blocks(self, plant, **options):
        from test_st import export

        folder = Path(tempfile.mkdtemp(dir=self.folder))
        return export(plant, folder, dtype=self.dtype, **options)

    def numbers(self, values):
        return [self.kind(value) for value in values]

    def model(self, plant, x, u):
        blocks = self.blocks(plant, observer=False)
        step, output = blocks["PLANT_STEP"](), blocks["PLANT_OUTPUT"]()
        after, y = [], []
        for x_k, u_k in zip(x, u, strict=True):
            state, sent = self.numbers(x_k), self.numbers(u_k)
            y.append(list(output(x=state, u=sent).y))
            step(x=state, u=sent)
            after.append(state)
        return after, y

    def controller(self, loop):
        block = self.blocks(loop.plant, **loop.options)["PLANT_CONTROL"]()

        def step(r, y, d):
            given = {"d": self.numbers(d)} if len(d) else {}
            block(setpoint=self.numbers(r), y=self.numbers(y), **given)
            return np.array(block.u, dtype=float)

        return step


class Modelica(Target):
    def package(self, plant, **options):
        from test_modelica import export

        return export(plant, Path(tempfile.mkdtemp(dir=self.folder)), **options)

    def model(self, plant, x, u):
        package = self.package(plant, observer=False)
        return [
            [package[name](*one) for one in zip(x, u, strict=True)]
            for name in ("step", "respond")
        ]

    def controller(self, loop):
        block = self.package(loop.plant, **loop.options)["Controller"]()

        def step(r, y, d):
            given = {"d": d} if len(d) else {}
            return block(r=r, y=y, **given).values["u"]

        return step


class Matlab(Target):
    """Octave runs all samples at once: the controller sees the y of Python's loop."""

    def compute(self, plant, options, **given):
        import octave

        folder = Path(tempfile.mkdtemp(dir=self.folder))
        return octave.compute([((plant, options), given)], folder)[0]

    def model(self, plant, x, u):
        found = self.compute(plant, {"observer": False}, x=x, u=u)
        return found["after"], found["output"]

    def inputs(self, loop, n):
        r, _, d = loop.signals(n)
        y, expected = loop.run(loop.controller(), n)
        return self.compute(loop.plant, loop.options, r=r, y=y, d=d)["u"], expected


KINDS = {
    "C": C,
    "ONNX": Onnx,
    "CasADi": Casadi,
    "FMU": FmuTarget,
    "MATLAB": Matlab,
    "Modelica": Modelica,
    "ST": StructuredText,
}


def lacking(kind):
    """Return why a target cannot be run here."""
    if kind == "MATLAB":
        return "" if shutil.which("octave-cli") else "not run: no octave-cli"
    package = NEEDS.get(kind)
    there = package is None or importlib.util.find_spec(package)
    return "" if there else f"not run: no {package}"


def measure(target, steps):
    """Return the largest deviations, by their names in FIGURES."""
    kind, errors = type(target), {}

    def add(name, error):
        errors[name] = np.max([errors.get(name, 0.0), error])  # keeps nan

    for name in NAMES:
        plant = make_plant(name)
        x, u, _ = signals(plant, steps)
        after, y = target.model(plant, x, u)
        late = plant.late()
        add("model", deviation(after, late.step(x, u)))
        add("model", deviation(y, late.output(x, u)))
        if kind.derivatives is not Target.derivatives:
            for found, expected in target.derivatives(plant, x, u):
                add("derivatives", slope_deviation(found, expected))
    if kind.controller is Target.controller and kind.inputs is Target.inputs:
        return errors
    for name in CONTROLLED:
        loop = Loop(name)
        add("controller", deviation(*target.inputs(loop, steps)))
        if kind.loop is not Target.loop:
            add("loop", deviation(target.loop(loop, steps), loop.alone(steps)))
    return errors


def main():
    """Measure, print, write, and compare with the limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--only", nargs="+", default=[*KINDS], choices=KINDS)
    options = parser.parse_args()
    note, missed = machine(os.getloadavg()[0], np), False
    for name, (holds, how) in TARGETS.items():
        kind = name.replace(",", "").split()[0]
        if kind not in options.only:
            continue
        if missing := lacking(kind):
            print(f"{name}: {missing}")
            row = [name, holds, missing, 0, *[""] * len(FIGURES)]
            replace_runs(OUT / "where_it_runs.csv", COLUMNS, [row], note)
            continue
        with tempfile.TemporaryDirectory() as folder:
            target = KINDS[kind](name, folder)
            errors = measure(target, options.steps)
        limit = LIMITS[target.dtype]
        missed |= any(not error <= limit for error in errors.values())
        words = [f"{errors[f]:.1e}" if f in errors else "" for f in FIGURES]
        row = [name, holds, how, options.steps, *words]
        print("  ".join(map(str, row)), flush=True)
        replace_runs(OUT / "where_it_runs.csv", COLUMNS, [row], note)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

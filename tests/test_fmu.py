"""FMUs are valid, and do what Python does, sample by sample."""

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from alssnn import Activation
from alssnn.activations import ACTIVATIONS
from alssnn.feedback import LinearizingController
from alssnn.persistence import to_fmu
from exported import (
    CONTROLLED,
    NAMES,
    assert_exact,
    fast_plant,
    make_loop,
    make_plant,
    make_unknown,
    signals,
)

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")
if shutil.which("gcc") is None:
    pytest.skip("no gcc", allow_module_level=True)
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

VERSIONS = ("3.0", "2.0")
HEADERS = Path(fmpy.__file__).parent / "c-code"
N = 120  # samples of a loop: limits, gaps and spikes are met many times


class Slave:
    """Call an FMU of either version, by the names of its variables."""

    def __init__(self, fmu, start=0.0):
        self.folder = fmpy.extract(str(fmu.path))
        self.told = fmpy.read_model_description(self.folder)
        kind = FMU3Slave if fmu.version == "3.0" else FMU2Slave
        self.is_3, self.start, self.time = kind is FMU3Slave, start, start
        told = self.told
        self.fmu = kind(
            guid=told.guid or told.instantiationToken,
            modelIdentifier=told.coSimulation.modelIdentifier,
            unzipDirectory=self.folder,
        )
        self.references = {v.name: v.valueReference for v in told.modelVariables}
        kinds = ("input", "output", "local")
        self.inputs, self.outputs, self.states = (
            [v.name for v in told.modelVariables if v.causality == kind]
            for kind in kinds
        )
        self.fmu.instantiate()
        self.begin()

    def begin(self, **values):
        """Initialize, with values of states."""
        if self.is_3:
            self.fmu.enterInitializationMode(startTime=self.start)
        else:
            self.fmu.setupExperiment(startTime=self.start)
            self.fmu.enterInitializationMode()
        if values:
            self.set(list(values), list(values.values()))
        self.fmu.exitInitializationMode()
        self.time = self.start

    def reset(self, **values):
        self.fmu.reset()
        self.begin(**values)

    def get(self, names):
        get = self.fmu.getFloat64 if self.is_3 else self.fmu.getReal
        return np.array(get([self.references[name] for name in names]))

    def set(self, names, values):
        put = self.fmu.setFloat64 if self.is_3 else self.fmu.setReal
        put([self.references[name] for name in names], list(map(float, values)))

    def slopes(self, known):
        """Return the derivatives of all outputs by known variables, (ny, n)."""
        unknown = [self.references[name] for name in self.outputs]
        slope = self.fmu.getDirectionalDerivative
        columns = [slope(unknown, [self.references[name]], [1.0]) for name in known]
        return np.array(columns).reshape(-1, len(unknown)).T

    def step(self, dt):
        self.fmu.doStep(currentCommunicationPoint=self.time, communicationStepSize=dt)
        self.time += dt

    def sample(self, dt, *inputs):
        """Return the outputs of a sample, and go on to the next one."""
        self.set(self.inputs, np.concatenate(inputs))
        outputs = self.get(self.outputs)
        self.step(dt)
        return outputs

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)


@pytest.fixture
def unoptimized(monkeypatch):
    """Compile in less time, where the speed of what is compiled is of no interest."""
    flags = "-std=c99 -O0 -shared -fPIC"
    monkeypatch.setattr("alssnn.persistence._fmu.FLAGS", flags)


@pytest.fixture
def load(unoptimized):
    """Return a function that loads FMUs, which are freed at the end."""
    loaded = []

    def load(fmu, **options):
        assert fmu.binary and not fmu.no_binary
        assert validate_fmu(str(fmu.path)) == []
        loaded.append(Slave(fmu, **options))
        return loaded[-1]

    yield load
    for slave in loaded:
        slave.close()


@pytest.fixture(params=CONTROLLED, scope="module")
def loop(request):
    return make_loop(request.param)


@pytest.mark.parametrize("name", NAMES)
def test_every_structure_is_what_its_plant_is(name, tmp_path, load):
    plant = make_plant(name)
    late = plant.late()
    slave = load(to_fmu(plant, tmp_path / "a.fmu", version=VERSIONS[len(name) % 2]))
    x, u, _ = signals(plant, 20)
    y, after = np.empty((len(x), plant.ny)), x.copy()
    dy_dx, dy_du = np.empty((len(x), plant.ny, late.nx)), np.empty((*y.shape, plant.nu))
    for k in range(len(x)):
        slave.reset(**dict(zip(slave.states, x[k], strict=True)))
        slave.set(slave.inputs, u[k])
        dy_dx[k], dy_du[k] = slave.slopes(slave.states), slave.slopes(slave.inputs)
        y[k] = slave.sample(plant.dt, u[k])
        after[k] = slave.get(slave.states)
    assert_exact(y, late.output(x, u))
    assert_exact(after, late.step(x, u))
    _, _, C, D = late.jacobian(x, u)
    assert_exact(dy_dx, C)
    assert_exact(dy_du, D)


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_slopes_of_all_activations(activation, tmp_path, load):
    """Those of the output alone: a network there sees the states."""
    from alssnn.models import state_space
    from helpers import plant_of_structure, random_theta

    rng = np.random.default_rng(0)
    sizes = {"n_h": 2, "n_k": (3, 2), "feedback": "state", "feedthrough": True}
    C = rng.standard_normal((2, 2))
    structure = state_space(2, 1, 2, C=C, activation=activation, **sizes)
    plant = plant_of_structure(structure, random_theta(structure, rng), rng)
    slave = load(to_fmu(plant, tmp_path / "a.fmu"))
    x, u = rng.standard_normal(2), rng.standard_normal(1)
    slave.reset(**dict(zip(slave.states, x, strict=True)))
    slave.set(slave.inputs, u)
    found = slave.fmu.getDirectionalDerivative(
        [slave.references[name] for name in slave.outputs],
        [slave.references[name] for name in slave.states],
        [0.3, -2.0],
    )
    assert_exact(np.array(found), plant.jacobian(x, u)[2] @ [0.3, -2.0])


def test_the_controller_acts_as_in_python(loop, tmp_path, load):
    version = VERSIONS[not loop.integrates]
    options = {"what": "controller", "version": version, **loop.options}
    slave = load(to_fmu(loop.plant, tmp_path / "a.fmu", **options), start=10.0)
    dt = loop.plant.dt
    y, u = loop.run(lambda *signals: slave.sample(dt, *signals), N)
    expected_y, expected_u = loop.expected(N)
    met = (expected_u == loop.law.u_min) | (expected_u == loop.law.u_max)
    assert 0.02 < met.any(axis=1).mean() < 0.98
    assert_exact(u, expected_u)
    finite = np.isfinite(y)
    assert not finite.all()
    assert_exact(y[finite], expected_y[finite])


def test_the_loop_of_both_is_that_of_python(loop, tmp_path, load):
    version = VERSIONS[loop.integrates]
    options = {"what": "both", "version": version, **loop.options}
    slave = load(to_fmu(loop.plant, tmp_path / "a.fmu", **options))
    r, _, d = loop.signals(N)
    found = [slave.sample(loop.plant.dt, *z) for z in zip(r, d, strict=True)]
    assert_exact(np.array(found), loop.alone(N))


@pytest.mark.usefixtures("unoptimized")
def test_a_controller_is_taken_as_it_is(tmp_path):
    """The parts of a controller are those that are given one by one."""
    loop = make_loop("ahead, disturbed")
    parts = {"law": loop.law, "observer": loop.observer}
    controller = LinearizingController(loop.plant, loop.gain, **parts)
    for what in (None, "controller", "both"):
        fmu = to_fmu(controller, tmp_path / "a.fmu", what=what)
        whole = {"what": what or "controller", **loop.options}
        expected = to_fmu(loop.plant, tmp_path / "b" / "a.fmu", **whole)
        assert fmu.path.read_bytes() == expected.path.read_bytes()
    with pytest.raises(ValueError, match=r"got a controller\. Give its `model`"):
        to_fmu(controller, tmp_path / "a.fmu", what="model")
    with pytest.raises(ValueError, match="must be None beside a controller"):
        to_fmu(controller, tmp_path / "a.fmu", gain=loop.gain)


@pytest.mark.parametrize("version", VERSIONS)
def test_states_are_kept_sent_and_reset(version, tmp_path, load):
    loop = make_loop("disturbed")
    options = {"what": "both", "version": version, **loop.options}
    fmu = to_fmu(loop.plant, tmp_path / "a.fmu", **options)
    slave, other = load(fmu), load(fmu)
    r, _, d = loop.signals(40)
    dt, names = loop.plant.dt, ("FMUState", "FMUstate")[version == "2.0"]

    def run(slave, part):
        return np.array(
            [slave.sample(dt, *z) for z in zip(r[part], d[part], strict=True)]
        )

    first = run(slave, slice(0, 20))
    state, time = getattr(slave.fmu, f"get{names}")(), slave.time
    second = run(slave, slice(20, 40))
    getattr(slave.fmu, f"set{names}")(state)
    slave.time = time
    np.testing.assert_array_equal(run(slave, slice(20, 40)), second)
    # another instance goes on from bytes
    data = getattr(slave.fmu, f"serialize{names}")(state)
    undo = "deserialize" if version == "3.0" else "deSerialize"
    copy = getattr(other.fmu, f"{undo}{names}")(data)
    getattr(other.fmu, f"set{names}")(copy)
    other.time = time
    np.testing.assert_array_equal(run(other, slice(20, 40)), second)
    for one, kept in ((slave, state), (other, copy)):
        getattr(one.fmu, f"free{names}")(kept)
    slave.reset()
    np.testing.assert_array_equal(run(slave, slice(0, 20)), first)


@pytest.mark.parametrize("version", VERSIONS)
def test_steps_of_other_lengths_hold_what_a_sample_saw(version, tmp_path, load):
    plant = make_plant("nonlinear output, late")
    fmu = to_fmu(plant, tmp_path / "a.fmu", version=version)
    whole, parts, long = load(fmu), load(fmu), load(fmu)
    rng, dt = np.random.default_rng(0), plant.dt
    for u in rng.standard_normal((20, plant.nu)):
        expected = whole.sample(dt, u)
        parts.set(parts.inputs, u)
        parts.step(0.25 * dt)
        parts.set(parts.inputs, 100 + u)  # comes between samples: nobody sees it
        np.testing.assert_array_equal(parts.get(parts.outputs), expected)
        parts.step(0.5 * dt)
        parts.step(0.25 * dt)
        np.testing.assert_array_equal(parts.get(parts.states), whole.get(whole.states))
    u = rng.standard_normal(plant.nu)
    for slave in (whole, long):
        slave.reset()
    for _ in range(7):
        whole.sample(dt, u)
    long.sample(7 * dt, u)
    np.testing.assert_array_equal(long.get(long.states), whole.get(whole.states))


@pytest.mark.parametrize("version", VERSIONS)
def test_simulation_by_a_master(version, tmp_path):
    """The master of fmpy reads outputs after the step, with the inputs before it."""
    plant = make_plant("linear")
    fmu = to_fmu(plant, tmp_path / "a.fmu", version=version)
    n, rng = 50, np.random.default_rng(0)
    u = rng.standard_normal((n + 1, plant.nu))
    t = plant.dt * np.arange(n + 1)
    dtype = [("time", float), *((name, float) for name in plant.inputs)]
    table = np.array([(t_k, *u_k) for t_k, u_k in zip(t, u, strict=True)], dtype=dtype)
    result = fmpy.simulate_fmu(
        str(fmu.path), stop_time=t[-1], output_interval=plant.dt, input=table
    )
    x, expected = np.zeros(plant.nx), []
    for k in range(n + 1):
        expected.append(plant.output(x, u[max(k - 1, 0)]))
        x = plant.step(x, u[k])
    found = np.array([result[name] for name in plant.outputs]).T
    assert_exact(found, np.array(expected))


@pytest.mark.parametrize("version", VERSIONS)
def test_what_is_wrong_is_refused(version, tmp_path, load):
    plant = make_plant("linear")
    slave = load(to_fmu(plant, tmp_path / "a.fmu", version=version))
    failure = pytest.raises(Exception, match=r"rror|status")
    with failure:
        slave.set(slave.inputs[:1], [np.nan])
    with failure:
        slave.set(slave.states[:1], [1.0])  # after the start
    with failure:
        slave.set(slave.outputs[:1], [1.0])
    with failure:
        slave.step(-1.0)
    slave.time = 5.0
    with failure:
        slave.step(plant.dt)
    slave.time = 0.0
    assert_exact(slave.sample(plant.dt, plant.u_offset), plant.y_offset)
    token, slave.fmu.guid = slave.fmu.guid, "another"
    with pytest.raises(Exception, match="nstantiate"):
        slave.fmu.instantiate()
    slave.fmu.guid = token
    slave.fmu.instantiate()


HOST = r"""
#define _POSIX_C_SOURCE 200112L
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "fmi3FunctionTypes.h"

#define LOAD(name) name##TYPE *name = (name##TYPE *)dlsym(library, #name)

/* path, token, steps, dt, inputs: prints all outputs of the last sample, and s/step */
int main(int argc, char **argv)
{
    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL);
    long k, n = atol(argv[3]);
    double dt = atof(argv[4]), u = 0, y = 0, last;
    fmi3ValueReference in = 1, out = (fmi3ValueReference)atol(argv[5]);
    fmi3Boolean a, b, c;
    fmi3Instance fmu;
    clock_t start;
    LOAD(fmi3InstantiateCoSimulation);
    LOAD(fmi3EnterInitializationMode);
    LOAD(fmi3ExitInitializationMode);
    LOAD(fmi3SetFloat64);
    LOAD(fmi3GetFloat64);
    LOAD(fmi3DoStep);
    (void)argc;
    fmu = fmi3InstantiateCoSimulation("a", argv[2], 0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
    fmi3EnterInitializationMode(fmu, 0, 0, 0, 0, 0);
    fmi3ExitInitializationMode(fmu);
    start = clock();
    for (k = 0; k < n; k++) {
        u = (double)(k % 7) - 3;
        if (fmi3SetFloat64(fmu, &in, 1, &u, 1) || fmi3GetFloat64(fmu, &out, 1, &y, 1)
            || fmi3DoStep(fmu, k * dt, dt, 1, &a, &b, &c, &last))
            return 1;
    }
    printf("%.17g %.9g\n", y, (double)(clock() - start) / CLOCKS_PER_SEC / n);
    return 0;
}
"""


def hosted(plant, folder):
    """Return a function that steps the FMU of a plant in a program in C.

    Its argument is the number of steps; it returns the last y and seconds per step.
    """
    fmu = to_fmu(plant, folder / "a.fmu")
    zipfile.ZipFile(fmu.path).extractall(folder)
    told = fmpy.read_model_description(str(fmu.path))
    (folder / "host.c").write_text(HOST)
    command = ["gcc", "-O2", "-I", HEADERS, "-o", folder / "host"]
    subprocess.run([*command, folder / "host.c", "-ldl"], check=True)

    def run(steps):
        words = [folder / fmu.binary, told.instantiationToken, steps, plant.dt, 2]
        run = subprocess.run(
            [folder / "host", *map(str, words)], capture_output=True, check=True
        )
        return tuple(map(float, run.stdout.split()))

    return run


def test_a_program_without_python_runs_it(tmp_path):
    """In a process of its own, and fast: a million steps in a few seconds."""
    plant, n = fast_plant(), 50
    run = hosted(plant, tmp_path)
    x = np.zeros(6)
    for k in range(n):
        u = np.array([k % 7 - 3.0])
        y = plant.output(x, u)
        x = plant.step(x, u)
    assert_exact(run(n)[0], y)
    _, seconds = run(1_000_000)
    assert seconds < 1e-5  # 0.3 microseconds where nothing else runs


@pytest.mark.usefixtures("unoptimized")
@pytest.mark.parametrize("version", VERSIONS)
def test_the_functions_are_those_of_the_standard(version, tmp_path):
    """Compiled after the official headers: another prototype is an error."""
    loop = make_loop("disturbed")
    strict = "-std=c99 -Wall -Wextra -Werror -pedantic -fsyntax-only"
    for what in ("model", "controller", "both"):
        options = {} if what == "model" else loop.options
        path = tmp_path / f"{what}.fmu"
        to_fmu(loop.plant, path, what=what, version=version, **options)
        zipfile.ZipFile(path).extractall(tmp_path / what)
        file = tmp_path / what / "sources" / f"fmi{version[0]}.c"
        header = HEADERS / f"fmi{version[0]}Functions.h"
        command = ["gcc", *strict.split()]
        subprocess.run([*command, file], check=True)
        subprocess.run([*command, "-include", header, file], check=True)
        declared = header.read_text()
        text = file.read_text()
        for line in declared.splitlines():
            if line.startswith(f"#define fmi{version[0]}") and "FullName(fmi" in line:
                function = line.split()[1]
                is_there = f"({function})" in text or f"({function}," in text
                assert is_there or version == "2.0", function
        static = f"-DFMI{version[0]}_FUNCTION_PREFIX=own_"
        subprocess.run([*command, static, file], check=True)


def test_names_units_and_dependencies(tmp_path):
    import dataclasses

    plant = dataclasses.replace(
        make_plant("linear"), inputs=["a<b", "a.b"], outputs=["time", "x[0]"]
    )
    plant = dataclasses.replace(plant, outputs=["time", "x[0]"][: plant.ny])
    units = {"a<b": "N.m", "time": "°C"}
    for version in VERSIONS:
        fmu = to_fmu(plant, tmp_path / "1 a.fmu", version=version, units=units)
        assert validate_fmu(str(fmu.path)) == []
        told = fmpy.read_model_description(str(fmu.path))
        names = [v.name for v in told.modelVariables]
        assert names[:4] == ["time", "a<b", "a_b", "time_"]
        assert len({*names}) == len(names)
        assert told.modelVariables[1].unit == "N.m"
        assert told.modelVariables[3].unit == "°C"
        assert told.coSimulation.modelIdentifier == "fmu_1_a"
        assert told.defaultExperiment.stepSize == str(plant.dt)
        assert told.outputs[0].dependencies == []
    with pytest.raises(ValueError, match=r"`units` must be of signals .* got one of b"):
        to_fmu(plant, tmp_path / "a.fmu", units={"b": "m"})


def test_the_same_model_is_the_same_file(tmp_path):
    plant = make_plant("al")
    files = [to_fmu(plant, tmp_path / name / "a.fmu") for name in "ab"]
    assert files[0].path.read_bytes() == files[1].path.read_bytes()


def test_attributes_have_one_order_whatever_the_seed_of_hashes(tmp_path):
    plant = make_plant("al")
    units = dict.fromkeys(plant.inputs, "V")
    fmu = to_fmu(plant, tmp_path / "a.fmu", version="2.0", units=units)
    with zipfile.ZipFile(fmu.path) as archive:
        description = archive.read("modelDescription.xml").decode()
    found = re.findall(r"<Real (\w+)=\S+ (\w+)=", description)
    assert found == [("unit", "start")] * plant.nu


@pytest.mark.parametrize("name", ["fmu", "fmi2", "fmi3"])
def test_names_of_our_own_sources_are_taken_by_none(name, tmp_path):
    fmu = to_fmu(make_plant("al"), tmp_path / f"{name}.fmu")
    sources = zipfile.ZipFile(fmu.path).namelist()
    assert f"sources/fmu_{name}.c" in sources
    assert validate_fmu(str(fmu.path)) == []


def test_without_a_compiler_the_sources_are_there(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    for version in VERSIONS:
        fmu = to_fmu(make_plant("al"), tmp_path / "a.fmu", version=version)
        assert fmu.binary == "" and "No compiler was found" in fmu.no_binary
        names = zipfile.ZipFile(fmu.path).namelist()
        assert not any(name.startswith("binaries") for name in names)
        assert f"sources/fmi{version[0]}.c" in names
        assert validate_fmu(str(fmu.path)) == []


def test_building_needs_no_fmpy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "fmpy", None)
    assert to_fmu(make_plant("al"), tmp_path / "a.fmu").binary


def test_refusals(tmp_path):
    path, loop = tmp_path / "a.fmu", make_loop("output")
    own = Activation("own", np.tanh, lambda v, w: 1 - w**2, (0, 1))
    with pytest.raises(ValueError, match=r"expression in 'c' .*'own'"):
        to_fmu(make_unknown(own), path)
    with pytest.raises(ValueError, match=r"`what` must be 'model', .*'plant'"):
        to_fmu(loop.plant, path, what="plant")
    with pytest.raises(ValueError, match=r"`version` must be '3.0' or .* got 2"):
        to_fmu(loop.plant, path, version=2)
    with pytest.raises(ValueError, match="`gain` must be given with what='both'"):
        to_fmu(loop.plant, path, what="both")
    with pytest.raises(ValueError, match="`gain` must be None with what='model'"):
        to_fmu(loop.plant, path, gain=loop.gain)
    assert not path.exists()

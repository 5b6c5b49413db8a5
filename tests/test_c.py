"""The C sources compile without a warning and compute what Python computes."""

import csv
import ctypes
import shutil
import subprocess
import warnings
from functools import cache

import control
import numpy as np
import pytest

from alssnn import Activation, LinearStateSpace
from alssnn.feedback import (
    DisturbanceObserver,
    closed_loop,
    lqi,
    lqr,
)
from alssnn.persistence import to_c
from exported import NAMES, assert_exact, make_plant, signals
from models import al_ssnn, fit, fl_ssnn, gr_ssnn, lively, simulate

if shutil.which("gcc") is None:
    pytest.skip("no gcc", allow_module_level=True)

STRICT = "-std=c99 -Wall -Wextra -Werror -pedantic -Wconversion -Wdouble-promotion"
STEPS = 2_000
TOLERANCE = {"double": 1e-12, "float": 1e-4}
TYPES = {"double": np.float64, "float": np.float32}
SMALL = {"max_iter": 3, "tol": 1e-2, "random_state": 0, "dt": 0.25}
DEEP = {"n_h": (3, 2), "n_g": (4, 3)}
# estimator and (nu, ny)
MODELS = {
    "linear": (LinearStateSpace(nx=2, dt=0.25), (1, 1)),
    "fl": (fl_ssnn(nx=2, n_h=3, **SMALL), (1, 1)),
    "fl, state, sin": (
        fl_ssnn(nx=3, n_h=3, feedback="state", activation="sin", **SMALL),
        (2, 1),
    ),
    "al": (al_ssnn(nx=3, n_h=4, n_g=3, **SMALL), (2, 2)),
    "al, state, deep": (
        al_ssnn(
            nx=3,
            feedback="state",
            activation={"h": "sigmoid", "g": "relu"},
            **DEEP,
            **SMALL,
        ),
        (2, 2),
    ),
    "al, odd, deep": (al_ssnn(nx=2, odd=True, **DEEP, **SMALL), (1, 2)),
    "gr, identity": (gr_ssnn(nx=2, n_f=3, activation="identity", **SMALL), (2, 1)),
    "D, k, late": (
        al_ssnn(
            nx=2,
            n_h=2,
            n_g=2,
            n_k=(2, 2),
            feedthrough=True,
            input_delay=(0, 3),
            **SMALL,
        ),
        (2, 2),
    ),
    "D, state": (
        al_ssnn(nx=2, n_h=2, n_g=0, feedback="state", feedthrough=True, **SMALL),
        (1, 1),
    ),
    "monotone": (fl_ssnn(nx=2, n_h=3, input_map="monotone", **SMALL), (2, 2)),
    "monotone, state": (
        al_ssnn(nx=2, n_h=3, n_g=2, input_map="monotone", feedback="state", **SMALL),
        (1, 1),
    ),
    "all late": (gr_ssnn(nx=2, n_f=2, input_delay=(1, 2), **SMALL), (2, 1)),
}
LAWS = ["fl", "fl, state, sin", "al, state, deep", "linear"]
LAWS += ["monotone", "monotone, state"]
WIDE = ["fl, state, sin"]  # loops without integrators
LOOPS = ["fl", "fl, state, sin", "al", "al, state, deep", "gr, identity", "all late"]


@pytest.fixture(scope="module")
def fitted():
    models = {}
    for name, (model, (nu, ny)) in MODELS.items():
        models[name] = lively(fit(model, nu, ny), size=0.05)
    return models


def shared_library(folder, level="-O0"):
    """Compile the sources of a folder, with warnings as errors."""
    library = folder / "plant.so"
    files = ["-o", library, folder / "plant.c", "-lm"]
    command = ["gcc", level, *STRICT.split(), "-shared", "-fPIC", *files]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


class Compiled:
    """Call the functions of the generated sources with arrays."""

    def __init__(self, model, folder, dtype="double", level="-O0", **options):
        to_c(model, folder, dtype=dtype, **options)
        self.library, self.dtype = shared_library(folder, level), TYPES[dtype]

    def zeros(self, n):
        return np.zeros(n, self.dtype)

    def array(self, values):
        return np.ascontiguousarray(values, dtype=self.dtype)

    def __getattr__(self, name):
        function = getattr(self.library, f"plant_{name}")
        function.restype = None

        def call(*arrays):
            assert all(a is None or a.dtype == self.dtype for a in arrays)
            function(*(None if a is None else a.ctypes.data_as(P) for a in arrays))

        P = ctypes.c_void_p
        return call


def signal(model, n, size=1.0, seed=0):
    """Return inputs around the operating point."""
    rng = np.random.default_rng(seed)
    du = rng.standard_normal((n, len(model.u_offset_)))
    return model.u_offset_ + size * model._scaling.u_scale * du


def assert_close(values, expected, dtype):
    """Compare relative to the range of every signal."""
    error = np.abs(values - expected).max(axis=0) / np.ptp(expected, axis=0)
    assert error.max() < TOLERANCE[dtype], error


# -- model -----------------------------------------------------------------------------


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", MODELS)
def test_the_model_simulates_as_predict(fitted, name, dtype, tmp_path):
    model = fitted[name]
    # some warnings need the analysis of an optimizing compiler
    plant = Compiled(model, tmp_path, dtype, "-O2" if dtype == "double" else "-O0")
    u, x0 = signal(model, STEPS), np.linspace(0.5, -0.3, model.nx_)
    x = plant.zeros(model.nx_ + model.input_delay_.sum())
    x[: model.nx_] = x0
    y, y_k = np.empty((STEPS, len(model.C_))), plant.zeros(len(model.C_))
    for k, u_k in enumerate(plant.array(u)):
        plant.output(x, u_k, y_k)
        y[k] = y_k
        plant.step(x, u_k)
    assert_close(y, simulate(model, u, x0=x0), dtype)


@pytest.mark.parametrize("name", NAMES)
def test_every_structure_is_what_its_plant_is(name, tmp_path):
    plant = make_plant(name)
    late, c = plant.late(), Compiled(plant, tmp_path, observer=False)
    x, u, s = signals(plant)
    y, cut, after, sent = np.empty((len(x), plant.ny)), u.copy(), x.copy(), u.copy()
    for k in range(len(x)):
        c.output(x[k], u[k], y[k])
        c.step(after[k], u[k])
        if not plant.no_law:
            c.law(u[k], s[k], sent[k], cut[k])
    assert_exact(y, late.output(x, u))
    assert_exact(after, late.step(x, u))
    if not plant.no_law:
        assert_exact(sent, plant.law(u, s))
        assert not cut.any()


def self_test_of(plant, folder, **options):
    """Return what the self-test of a plant says."""
    to_c(plant, folder, **(options or {"observer": False}))
    files = [folder / "plant_test.c", folder / "plant.c", "-lm"]
    command = ["gcc", *STRICT.split(), "-o", folder / "test", *files]
    subprocess.run(command, check=True)
    return subprocess.run([folder / "test"], capture_output=True, text=True).stdout


def test_the_self_test_of_plants_that_were_changed(tmp_path):
    for i, kind in enumerate(("output", "input")):
        plant = make_plant("al").with_disturbance(kind)
        assert self_test_of(plant, tmp_path / str(i)) == "passed: 20 samples\n"
    plant = make_plant("linear, late").late()
    assert self_test_of(plant, tmp_path / "late") == "passed: 20 samples\n"


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", MODELS)
def test_the_self_test_passes_and_can_fail(fitted, name, dtype, tmp_path):
    gain = gain_of(fitted[name], name not in WIDE) if name in LOOPS else None
    to_c(fitted[name], tmp_path, dtype=dtype, gain=gain)

    strict, numbers = ["gcc", *STRICT.split()], tmp_path / "plant_test.o"
    command = [*strict, "-c", "-o", numbers, tmp_path / "plant_test.c"]
    subprocess.run(command, check=True)

    def run():
        files = [numbers, tmp_path / "plant.c", "-lm"]
        subprocess.run([*strict, "-o", tmp_path / "test", *files], check=True)
        return subprocess.run([tmp_path / "test"], capture_output=True, text=True)

    passed = run()
    assert (passed.returncode, passed.stdout) == (0, "passed: 20 samples\n")
    # another controller, then another model behind the same numbers
    source = tmp_path / "plant.c"
    whole = source.read_text()
    wrong = [("y[i] += sum", "y[i] -= sum")]
    if gain is not None:
        wrong.insert(0, ("add(NV, PLANT_NX, K_x, c->x, Kx);", "(void)K_x;"))
    for right, other in wrong:
        assert right in whole
        source.write_text(whole.replace(right, other))
        failed = run()
        assert failed.returncode == 1 and failed.stdout.endswith("failed\n")


def test_sources_are_short_and_name_their_signals(fitted, tmp_path):
    model = lively(fit(al_ssnn(nx=6, n_h=10, n_g=10, **SMALL), 1, 1))
    model.to_c(tmp_path, gain=lqi(model, np.eye(7), np.eye(1)), prefix="motor")
    lines = {p.name: len(p.read_text().splitlines()) for p in tmp_path.iterdir()}
    assert lines["motor.c"] < 350 and lines["motor.h"] < 100
    header = (tmp_path / "motor.h").read_text()
    assert "u[0]: valve_a" in header and "#define MOTOR_DT 0.25" in header
    # a name that would end the comment
    fitted["al"].to_c(tmp_path)
    assert "u[1]: p__\n" in (tmp_path / "plant.h").read_text()


# -- observer and law ------------------------------------------------------------------


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", MODELS)
def test_the_observer_filters_as_in_python(fitted, name, dtype, tmp_path):
    model, n = fitted[name], 300
    observer = model.observer()
    plant = Compiled(model, tmp_path, dtype)
    u = signal(model, n)
    rng = np.random.default_rng(1)
    y = simulate(model, u)
    y = y + 0.1 * model._scaling.y_scale * rng.standard_normal(y.shape)
    y[rng.random(y.shape) < 0.1] = np.nan
    x, X = plant.zeros(len(observer.x_hat)), np.empty((n, len(observer.x_hat)))
    expected, state = X.copy(), np.zeros(X.shape[1])
    linear = observer.plant.has_linear_output
    for k, (u_k, y_k) in enumerate(zip(plant.array(u), plant.array(y), strict=True)):
        plant.correct(x, None if linear else u_k, y_k)
        X[k] = x
        plant.step(x, u_k)
        both = np.concatenate([u[k], y[k]])
        expected[k] = observer.output(0, state, both, {})
        state = observer.update(0, state, both, {})
    moves = np.ptp(expected, axis=0) > 0
    assert_close(X[:, moves], expected[:, moves], dtype)


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", LAWS)
def test_the_law_cancels_and_saturates_as_in_python(fitted, name, dtype, tmp_path):
    model, n = fitted[name], 500
    high = model.u_offset_ + 0.5 * model._scaling.u_scale
    high[1:] = np.inf
    law = model.linearizing_law(u_max=high)
    plant = Compiled(model, tmp_path, dtype, law=law, observer=False)
    v = signal(model, n)
    rng = np.random.default_rng(2)
    if law.feedback == "state":
        s = rng.standard_normal((n, model.nx_))
    else:
        deviations = rng.standard_normal((n, len(model.C_)))
        s = model.y_offset_ + model._scaling.y_scale * deviations
    u, cut = plant.zeros(v.shape), plant.zeros(v.shape)
    for k in range(n):
        plant.law(plant.array(v[k]), plant.array(s[k]), u[k], cut[k])
    expected, expected_cut = law.split(v, s)
    assert np.any(expected_cut[:, 0] > 0)
    assert_close(u, expected, dtype)
    assert_close(v - cut, v - expected_cut, dtype)


# -- controller ------------------------------------------------------------------------


def gain_of(model, integrators):
    n = model.nx_ + model.input_delay_.sum()
    ny = len(model.C_)
    C = np.pad(model.C_ / model._scaling.y_scale[:, None], ((0, 0), (0, n - model.nx_)))
    Q, R = C.T @ C + 1e-3 * np.eye(n), np.diag(model._scaling.u_scale**-2.0)
    if not integrators:
        return lqr(model, Q, R)
    Q_z = np.diag(0.05 * model._scaling.y_scale**-2.0)
    Q = np.block([[Q, np.zeros((n, ny))], [np.zeros((ny, n)), Q_z]])
    return lqi(model, Q, R)


def reference(model, integrators, n):
    """Return steps of the reference, one every 100 samples, some out of reach."""
    rng = np.random.default_rng(3)
    scaling = model._scaling
    du = scaling.u_scale * rng.uniform(-1, 1, (n // 100 + 1, len(scaling.u_scale)))
    du = np.repeat(du, 100, axis=0)[:n]
    if not integrators:
        return model.u_offset_ + du
    at_rest = np.linalg.solve(np.eye(model.nx_) - model.A_, model.B_)
    return model.y_offset_ + du @ (model.C_ @ at_rest).T


def run_in_c(model, plant, r, x0):
    """Return y and u of a loop of the compiled model and the compiled controller."""
    n, ny = model.nx_ + model.input_delay_.sum(), len(model.C_)
    state = plant.zeros(n + 2 * ny + len(model.u_offset_))  # at least [x; z; r]
    plant.reset(state)
    x, y, u = plant.zeros(n), plant.zeros(ny), plant.zeros(len(model.u_offset_))
    x[: model.nx_] = x0
    Y, U = np.empty((len(r), ny)), np.empty((len(r), len(u)))
    for k, r_k in enumerate(plant.array(r)):
        plant.output(x, None, y)
        plant.control(state, r_k, y, u)
        plant.step(x, u)
        Y[k], U[k] = y, u
    return Y, U


def run_in_python(model, observer, law, gain, r, x0):
    """Return y and u of the same loop, from the parts of `feedback`."""
    dynamics, n = model.plant_.late(), len(observer.Q)
    K_x, K_z = gain[:, :n], gain[:, n:]
    x, x_hat, z = np.zeros(n), np.zeros(n), np.zeros(K_z.shape[1])
    x[: model.nx_] = x0
    Y, U = [], []
    for r_k in r:
        y = dynamics.output(x)
        now = observer.output(0, x_hat, np.concatenate([0 * model.u_offset_, y]), {})
        v = (model.u_offset_ if z.size else r_k) - K_x @ now - K_z @ z
        u, cut = law.split(v, now if law.feedback == "state" else y)
        if z.size:
            z = z + y - r_k + np.linalg.pinv(K_z) @ cut
        x_hat = dynamics.step(now, u)
        x = dynamics.step(x, u)
        Y.append(y)
        U.append(u)
    return np.array(Y), np.array(U)


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("name", LOOPS)
def test_the_controller_acts_as_in_python(fitted, name, dtype, tmp_path):
    model = fitted[name]
    integrators = name not in WIDE
    limit = 0.7 * model._scaling.u_scale
    law = model.linearizing_law(model.u_offset_ - limit, model.u_offset_ + limit)
    observer, gain = model.observer(), gain_of(model, integrators)
    plant = Compiled(model, tmp_path, dtype, law=law, observer=observer, gain=gain)
    is_long = dtype == "double" and name == "al, state, deep"
    steps = STEPS if is_long else 400
    r, x0 = reference(model, integrators, steps), np.linspace(0.2, -0.4, model.nx_)
    y, u = run_in_c(model, plant, r, x0)
    expected_y, expected_u = run_in_python(model, observer, law, gain, r, x0)
    saturates = (expected_u == law.u_min) | (expected_u == law.u_max)
    assert 0.02 < saturates.mean() < 0.98
    assert_close(y, expected_y, dtype)
    assert_close(u, expected_u, dtype)


@pytest.mark.parametrize("name", ["fl", "al, state, deep"])
def test_the_controller_is_that_of_closed_loop(fitted, name, tmp_path):
    model = fitted[name]
    limit = 0.7 * model._scaling.u_scale
    law = model.linearizing_law(model.u_offset_ - limit, model.u_offset_ + limit)
    observer, gain = model.observer(), gain_of(model, True)
    plant = Compiled(model, tmp_path, law=law, observer=observer, gain=gain)
    r = reference(model, True, 300)
    y, u = run_in_c(model, plant, r, np.zeros(model.nx_))
    loop = closed_loop(model, model, gain, observer=observer, law=law)
    time = model.dt * np.arange(len(r))
    response = control.input_output_response(loop, time, r.T)
    ny, nu = y.shape[1], u.shape[1]
    assert_close(y, response.outputs[:ny].T, "double")
    assert_close(u, response.outputs[ny : ny + nu].T, "double")


def test_a_missing_output_is_taken_from_the_model(fitted, tmp_path):
    model = fitted["fl"]
    plant = Compiled(model, tmp_path, gain=gain_of(model, True))
    n, y = model.nx_, plant.array(model.y_offset_ + 0.3 * model._scaling.y_scale)
    states, inputs = [], []
    # after one measurement: nothing, or exactly what the observer expects
    for measured in (False, True):
        state, u = plant.zeros(n + 2), plant.zeros(1)  # [x; z; r]
        plant.reset(state)
        plant.control(state, y, y, u)
        expected = plant.zeros(1)
        plant.output(state, None, expected)
        r = expected.copy()  # the integrator stays in both cases
        plant.control(state, r, expected if measured else np.full(1, np.nan), u)
        states.append(state)
        inputs.append(u)
    np.testing.assert_array_equal(*states)
    np.testing.assert_array_equal(*inputs)
    assert np.isfinite(inputs[0]).all()


@pytest.mark.parametrize("name", ["fl", "al, state, deep"])
def test_the_gate_is_that_of_python(fitted, name, tmp_path):
    model = fitted[name]
    observer = model.observer(gate=3.0)
    plant = Compiled(model, tmp_path, observer=observer)
    u = signal(model, 200)
    y = model.y_offset_ + 0.1 * model._scaling.y_scale * np.sin(np.arange(200))[:, None]
    y[::7] += 1e3 * model._scaling.y_scale
    y[5], y[11] = 1e200, -1e200
    x, expected = plant.zeros(observer.plant.nx), observer.filter(u, y)
    assert np.abs(model.observer().filter(u, y)).max() > 1e100
    for u_k, y_k, x_k in zip(u, y, expected, strict=True):
        plant.correct(x, plant.array(u_k), plant.array(y_k))
        np.testing.assert_allclose(x, x_k, rtol=1e-9, atol=1e-9)
        plant.step(x, plant.array(u_k))


@pytest.fixture(scope="module")
def limited(fitted, tmp_path_factory):
    """Return how to get a model, whether its loop integrates, its law, its sources."""

    @cache
    def made(name):
        model = fitted[name]
        integrators = len(model.u_offset_) >= len(model.C_) and name != "fl, state, sin"
        limit = 0.7 * model._scaling.u_scale
        law = model.linearizing_law(model.u_offset_ - limit, model.u_offset_ + limit)
        options = {"law": law, "gain": gain_of(model, integrators)}
        compiled = Compiled(model, tmp_path_factory.mktemp("limited"), **options)
        return model, integrators, law, compiled

    return made


@pytest.mark.parametrize("spike", [1e200, -1e200, 1e12, 1e308])
@pytest.mark.parametrize("name", ["fl", "fl, state, sin", "al"])
def test_one_spike_does_not_pin_the_input(limited, name, spike):
    model, integrators, law, plant = limited(name)
    nu, ny = len(model.u_offset_), len(model.C_)
    state, u = plant.zeros(model.nx_ + 2 * (nu + ny)), plant.zeros(nu)
    plant.reset(state)
    r = plant.array(model.y_offset_ if integrators else model.u_offset_)
    x, inputs = plant.zeros(model.plant_.late().nx), []
    for k in range(500):
        y = plant.zeros(ny)
        plant.output(x, plant.array(model.u_offset_), y)
        if k == 50:
            y[0] = spike
        plant.control(state, r, y, u)
        plant.step(x, u)
        inputs.append(u.copy())
    inputs = np.array(inputs)
    assert np.isfinite(inputs).all() and np.isfinite(state).all()
    assert np.all(inputs >= law.u_min) and np.all(inputs <= law.u_max)
    np.testing.assert_allclose(
        inputs[-1], inputs[49], atol=0.02 * model._scaling.u_scale.max()
    )


@pytest.mark.parametrize("integrators", [True, False])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_never_reaches_a_state(fitted, wrong, integrators, tmp_path):
    model = fitted["fl"]
    plant = Compiled(model, tmp_path, gain=gain_of(model, integrators))
    x, y, bad = plant.zeros(model.nx_), plant.array(model.y_offset_), np.full(1, wrong)
    x += 0.1
    before = x.copy()
    plant.correct(x, None, bad)
    np.testing.assert_array_equal(x, before)
    states, inputs = [], []
    at_rest = model.y_offset_ if integrators else model.u_offset_
    r = plant.array(at_rest + 0.01 * model._scaling.y_scale)
    for references in ([r, r, r], [r, bad, r]):  # the last reference is held
        state, u = plant.zeros(model.nx_ + 2), plant.zeros(1)
        plant.reset(state)
        for r_k, y_k in zip(references, [y, y, bad], strict=True):
            plant.control(state, r_k, y_k, u)
        states.append(state)
        inputs.append(u)
    np.testing.assert_array_equal(*states)
    np.testing.assert_array_equal(*inputs)
    assert np.isfinite(states).all() and inputs[0] != model.u_offset_


@pytest.mark.parametrize("name", ["fl", "al, state, deep", "D, k, late"])
def test_the_demonstration_builds_and_runs(fitted, name, tmp_path):
    model = fitted[name]
    gain = None if name == "D, k, late" else gain_of(model, True)
    model.to_c(tmp_path, gain=gain)
    make = ["make", "-s", "-C", str(tmp_path), f"CFLAGS=-O2 {STRICT}"]
    subprocess.run(make, check=True)
    run = subprocess.run([tmp_path / "plant_demo"], capture_output=True, text=True)
    head, *rows = csv.reader(run.stdout.splitlines())
    sizes = {"y": len(model.C_), "u": len(model.u_offset_)}
    assert head == ["k", *(f"{s}[{i}]" for s, n in sizes.items() for i in range(n))]
    table = np.array(rows, dtype=float)[:, 1:]
    scaling, n = model._scaling, len(table)
    if gain is None:
        u = np.tile(model.u_offset_ + scaling.u_scale, (n, 1))
        expected = np.hstack([simulate(model, u), u])
    else:
        r = np.tile(model.y_offset_ + 0.5 * scaling.y_scale, (n, 1))
        parts = model.observer(), model.linearizing_law(), gain
        expected = np.hstack(run_in_python(model, *parts, r, np.zeros(model.nx_)))
    np.testing.assert_allclose(table, expected, rtol=1e-7, atol=1e-7)
    readme = (tmp_path / "README.md").read_text()
    assert ("plant_control" in readme) == (gain is not None)


# -- what is refused -------------------------------------------------------------------


def test_a_model_without_law_says_why(fitted, tmp_path):
    fitted["D, k, late"].to_c(tmp_path)
    assert "No law: The law u = v - h(y)" in (tmp_path / "README.md").read_text()
    assert "plant_law" not in (tmp_path / "plant.h").read_text()
    fitted["D, state"].to_c(tmp_path)
    readme = (tmp_path / "README.md").read_text()
    order = ["`plant_law(v, x, u, cut)`", "Measure y", "`plant_correct(x, u, y)`"]
    places = [readme.index(f"{i}. {step}") for i, step in enumerate(order, start=1)]
    assert places == sorted(places)
    gain = np.zeros((2, 5))
    with pytest.raises(ValueError, match="algebraic loop"):
        fitted["D, k, late"].to_c(tmp_path, gain=gain)
    with pytest.raises(ValueError, match=r"through D.* would wait for them"):
        fitted["D, state"].to_c(tmp_path, gain=np.zeros((1, 2)))


def test_wrong_arguments_are_refused_before_anything_is_written(fitted, tmp_path):
    model, folder = fitted["al"], tmp_path / "c"
    other, good = fitted["fl"], gain_of(model, True)
    wrong = [
        ({"dtype": "half"}, ValueError, "`dtype` must be"),
        ({"prefix": "1a"}, ValueError, "`prefix` must begin with a letter"),
        ({"prefix": "a-b"}, ValueError, "`prefix` must begin with a letter"),
        ({"gain": good[:, :-1]}, ValueError, "`gain` must be finite and have shape"),
        ({"gain": good, "observer": False}, ValueError, "`observer` must not be False"),
        ({"observer": model.observer(kind="ekf")}, ValueError, "kind='kalman'"),
        ({"observer": other.observer()}, ValueError, "states of this model alone"),
        ({"observer": DisturbanceObserver(model)}, ValueError, "of this model alone"),
        ({"observer": good}, TypeError, "`observer` must be an Observer"),
        ({"law": other.linearizing_law()}, ValueError, "got one of another model"),
        ({"law": lambda v, s: v}, TypeError, "`law` must be a LinearizingLaw"),
    ]
    for options, error, message in wrong:
        with pytest.raises(error, match=message):
            model.to_c(folder, **options)
    assert not folder.exists()


def test_an_activation_without_an_expression_is_refused_by_name(tmp_path):
    own = Activation("own", np.arctan, lambda v, w: 1 / (1 + v**2), (0, 1), np.pi / 2)
    model = lively(fit(fl_ssnn(nx=2, n_h=2, activation=own, **SMALL), 1, 1))
    with pytest.raises(ValueError, match=r"expression in 'c'.*got 'own'"):
        model.to_c(tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_numbers_beyond_single_precision_are_refused(tmp_path):
    model, (nu, ny) = MODELS["linear"]
    model = fit(model, nu, ny)
    gain = np.full((1, 2), 1e60)
    with pytest.raises(ValueError, match=r"`K_x` must be in the range of `dtype`"):
        model.to_c(tmp_path / "c", gain=gain, dtype="float")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.to_c(tmp_path / "c", gain=gain)
    # its loop diverges: the self-test compares the samples before
    said = self_test_of(model, tmp_path / "c", gain=gain)
    assert said == "passed: 20 samples\n"
    assert "#define CONTROLLED 2 " in (tmp_path / "c" / "plant_test.c").read_text()

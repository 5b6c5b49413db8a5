"""The controller as one object: what `closed_loop` and the C sources do, online."""

import inspect
import pickle
import shutil
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.io import loadmat
from test_disturbances_exported import PLANTS, make_plant

from alssnn import LinearStateSpace, persistence
from alssnn.feedback import (
    Controller,
    DisturbanceObserver,
    LinearizingController,
    LinearizingLaw,
    Observer,
    closed_loop,
    lqi,
    lqr,
)
from alssnn.mpc import LinearizingMPC
from alssnn.persistence import to_mat
from models import al_ssnn, fit, fl_ssnn, gr_ssnn, lively

SMALL = {"max_iter": 3, "tol": 1e-2, "random_state": 0, "dt": 0.25}
# estimator and (nu, ny)
MODELS = {
    "linear": (LinearStateSpace(nx=2, dt=0.25), (1, 1)),
    "fl": (fl_ssnn(nx=2, n_h=3, **SMALL), (2, 2)),
    "fl, state": (fl_ssnn(nx=3, n_h=3, feedback="state", **SMALL), (2, 1)),
    "al, late": (gr_ssnn(nx=2, n_f=2, input_delay=(1, 2), **SMALL), (2, 1)),
    "monotone": (fl_ssnn(nx=2, n_h=3, input_map="monotone", **SMALL), (2, 2)),
    "one output": (al_ssnn(nx=2, n_h=3, n_g=2, **SMALL), (1, 1)),
}


@pytest.fixture(scope="module")
def plants():
    plants = {
        name: lively(fit(model, *sizes), size=0.05).plant_
        for name, (model, sizes) in MODELS.items()
    }
    return plants | {f"given, {name}": make_plant(*how) for name, how in PLANTS.items()}


NAMES = [*MODELS, *(f"given, {name}" for name in PLANTS)]


def gain_of(plant, integrates):
    late = plant.late()
    Q, R = np.eye(late.nx), np.diag(plant.v_scale**-2.0)
    if not integrates:
        return lqr(plant, Q, R)
    Q_z = np.diag(0.05 * plant.y_scale**-2.0)
    return lqi(
        plant,
        np.block(
            [[Q, np.zeros((late.nx, plant.ny))], [np.zeros((plant.ny, late.nx)), Q_z]]
        ),
        R,
    )


def limited(plant, size=0.4):
    return LinearizingLaw(
        plant,
        plant.v_offset - size * plant.v_scale,
        plant.v_offset + size * plant.v_scale,
    )


def references(plant, at_rest, size, n=20):
    """Return steps of references and of measured disturbances."""
    rng = np.random.default_rng(1)
    steps = np.repeat(
        rng.uniform(-1, 1, (n // 10, len(at_rest) + plant.nd)), 10, axis=0
    )
    r, d = np.split(steps, [len(at_rest)], axis=1)
    return at_rest + size * r, plant.d_offset + 0.5 * d


def response(loop, plant, r, d):
    """Return y, u and v of a loop of python-control."""
    t = plant.dt * np.arange(len(r))
    outputs = control.input_output_response(loop, t, np.hstack([r, d]).T).outputs
    return np.split(outputs.T, [plant.ny, plant.ny + plant.nv], axis=1)


def assert_same(run, plant, expected):
    y, u, v = expected
    for found, wanted, scale in (
        (run.y, y, plant.y_scale),
        (run.u, u, plant.v_scale),
        (run.v, v, plant.v_scale),
    ):
        assert (np.abs(found - wanted) / scale).max() < 1e-11


# every plant with both observers, with integrators beside one of them
LOOPS = [
    (name, kind, (i + j) % 2 == 0)
    for i, name in enumerate(NAMES)
    for j, kind in enumerate(("kalman", "ekf"))
]


@pytest.mark.parametrize(("name", "kind", "integrates"), LOOPS)
def test_it_is_the_loop_of_python_control(plants, name, kind, integrates):
    plant = plants[name]
    if integrates and plant.nv < plant.ny:
        integrates = False
    gain = gain_of(plant, integrates)
    at_rest = plant.y_offset if integrates else plant.v_offset
    size = plant.y_scale if integrates else 2 * plant.v_scale
    r, d = references(plant, at_rest, size)
    free = LinearizingController(plant, gain).simulate(plant, r, d=d).u
    law = LinearizingLaw(plant, *np.quantile(free, [0.25, 0.8], axis=0))
    parts = {"law": law, "observer": Observer(plant, kind=kind)}
    controller = LinearizingController(plant, gain, **parts)
    run = controller.simulate(plant, r, d=d)
    assert 0 < run.saturated.mean() < 1 and np.abs(run.cut).max() > 0
    loop = closed_loop(plant, controller)
    assert_same(run, plant, response(loop, plant, r, d))
    assert_same(
        run, plant, response(closed_loop(plant, plant, gain, **parts), plant, r, d)
    )
    # and once more: simulate starts anew
    np.testing.assert_array_equal(controller.simulate(plant, r, d=d).u, run.u)


@pytest.mark.parametrize("none", [[], [[]] * 5, np.zeros((5, 0))])
def test_no_disturbances_are_none_however_they_are_written(plants, none):
    plant = plants["linear"]
    controller, r = LinearizingController(plant), np.tile(plant.y_offset + 1, (5, 1))
    run = controller.simulate(plant, r, d=none)
    np.testing.assert_array_equal(run.u, controller.simulate(plant, r).u)
    with pytest.raises(ValueError, match="`d` must be None"):
        controller.simulate(plant, r, d=np.zeros((5, 1)))


@pytest.mark.parametrize("kind", ["kalman", "ekf"])
@pytest.mark.parametrize("integrates", [True, False])
@pytest.mark.parametrize("name", ["fl", "fl, state", "one output"])
def test_with_a_gate_it_is_that_loop_too(plants, name, integrates, kind):
    """What the gate cuts reaches neither the integrators nor a law of y."""
    plant = plants[name]
    integrates = integrates and plant.nv >= plant.ny
    observer = Observer(plant, kind=kind, gate=0.02)
    controller = LinearizingController(
        plant, gain_of(plant, integrates), observer=observer
    )
    at_rest = plant.y_offset if integrates else plant.v_offset
    size = plant.y_scale if integrates else 2 * plant.v_scale
    r, d = references(plant, at_rest, size)
    # innovations are beyond the gate
    true = replace(plant, y_offset=plant.y_offset + 0.3 * plant.y_scale)
    run = controller.simulate(true, r, d=d)
    assert_same(run, plant, response(closed_loop(true, controller), plant, r, d))
    free = LinearizingController(plant, gain_of(plant, integrates))
    free = free.simulate(true, r, d=d)
    assert np.any(np.abs(free.u - run.u).max(axis=0) > 1e-3 * plant.v_scale)


@pytest.mark.parametrize("error_only", [True, False])
@pytest.mark.parametrize("name", ["linear", "fl", "fl, state"])
def test_it_takes_a_linear_controller(plants, name, error_only):
    plant = plants[name]
    n = plant.ny if error_only else 2 * plant.ny
    D = np.outer(plant.v_scale, np.tile(0.1 / plant.y_scale, n // plant.ny))
    C = plant.v_scale[:, None] * np.full((plant.nv, 1), 0.1)
    B = np.tile(1 / plant.y_scale, n // plant.ny)[None]
    system = control.ss([[0.5]], B, C, D, True)
    controller = LinearizingController(
        plant, controller=system, u_max=1e3 * plant.v_scale
    )
    r, d = references(plant, plant.y_offset, plant.y_scale)
    run = controller.simulate(plant, r)
    assert_same(run, plant, response(closed_loop(plant, controller), plant, r, d))
    assert (controller.observer is None) == (plant.feedback == "output")
    controller.reset()
    rest = [controller.step(plant.y_offset, plant.y_offset) for _ in range(3)]
    if plant.feedback == "output":  # then nothing moves at the operating point
        np.testing.assert_allclose(rest[1:], [rest[0]] * 2, rtol=0, atol=1e-9)
    with pytest.raises(ValueError, match="must be a controller with a gain"):
        controller.to_c("nowhere")


def test_the_default_is_a_running_loop(plants):
    plant = plants["one output"]
    controller = LinearizingController(plant)
    goal = plant.y_offset + 0.3 * plant.y_scale
    run = controller.simulate(plant, np.tile(goal, (400, 1)))
    assert np.abs(run.y[-1] - goal) < 1e-3 * plant.y_scale
    assert controller.observer.gate == 100


def test_what_was_applied_enters_the_estimate(plants):
    """An actuator that somebody else holds: the estimate follows the plant."""
    plant = plants["linear"]
    controller = LinearizingController(plant)
    x = np.zeros(plant.nx)
    errors = {}
    for told in (True, False):
        controller.reset()
        x = np.zeros(plant.nx)
        held = plant.u_offset + plant.u_scale
        for k in range(10):
            applied = held if told and k else None
            controller.step(plant.y_offset, plant.output(x), u_applied=applied)
            errors[told] = np.abs(controller.info_.x_hat - x).max()
            x = plant.step(x, held)
    assert errors[True] < 1e-12 < errors[False]


@pytest.mark.parametrize(
    "name", ["fl", "fl, state", "al, late", "given, monotone, state, 2"]
)
def test_what_is_not_finite_never_reaches_a_state(plants, name):
    plant = plants[name]
    controller = LinearizingController(
        plant, gain_of(plant, plant.nv >= plant.ny), law=limited(plant)
    )
    r, _ = references(plant, *controller.at_rest)
    d = plant.d_offset + 0.1
    inputs = []
    for bad in (np.nan, np.inf, 1e200, None):
        controller.reset()
        for k in range(60):
            y = plant.y_offset + 0.1 * plant.y_scale
            d_k, r_k = d, r[0]
            if k in (7, 8) and bad is not None:
                y, r_k = np.full(plant.ny, bad), np.where(abs(bad) > 1e100, np.nan, r_k)
                d_k = np.full(plant.nd, np.nan)
            u = controller.step(r_k, y, d=d_k if plant.nd else None)
            assert np.isfinite(u).all()
            assert np.all(u >= controller.law.u_min) and np.all(
                u <= controller.law.u_max
            )
        inputs.append(u)
    np.testing.assert_array_equal(inputs[0], inputs[1])


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")
@pytest.mark.parametrize("integrates", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_it_is_what_it_exports(plants, name, integrates, tmp_path):
    """Spikes, gaps and lost references among the signals."""
    from test_c import shared_library

    plant = plants[name]
    integrates = integrates and plant.nv >= plant.ny
    controller = LinearizingController(
        plant,
        gain_of(plant, integrates),
        law=limited(plant),
        observer=Observer(plant, gate=5.0),
    )
    controller.to_c(tmp_path)
    function = shared_library(tmp_path)
    state, u_c = np.zeros(200), np.zeros(plant.nv)
    function.plant_reset(state.ctypes)
    rng = np.random.default_rng(2)
    r, d = references(plant, *controller.at_rest)
    y = plant.y_offset + 0.3 * plant.y_scale * rng.standard_normal((len(r), plant.ny))
    y[rng.random(y.shape) < 0.1] = np.nan
    y[rng.random(y.shape) < 0.05] *= 1e6
    r[rng.random(r.shape) < 0.1] = np.nan
    d[rng.random(d.shape) < 0.1] = np.inf
    for k in range(len(r)):
        u = controller.step(r[k], y[k], d=d[k] if plant.nd else None)
        signals = [r[k], y[k], *([d[k]] if plant.nd else [])]
        pointers = [np.ascontiguousarray(z).ctypes for z in signals]
        function.plant_control(state.ctypes, *pointers, u_c.ctypes)
        assert (np.abs(u - u_c) / plant.v_scale).max() < 1e-9


def test_it_goes_to_matlab_as_its_parts_do(plants, tmp_path):
    plant, path = plants["fl"], tmp_path / "plant.mat"
    gain, law = gain_of(plant, True), limited(plant)
    to_mat(LinearizingController(plant, gain, law=law), path)
    found = loadmat(path, squeeze_me=True)["model"]
    to_mat(plant, path, gain=gain, law=law)
    expected = loadmat(path, squeeze_me=True)["model"]
    for name in ("M", "K_x", "K_z"):
        np.testing.assert_array_equal(found[name].item(), expected[name].item())
    gated = LinearizingController(plant, gain, observer=Observer(plant, gate=5))
    to_mat(gated, path)
    found = loadmat(path)["model"]["gate"][0, 0][:, 0]
    np.testing.assert_array_equal(found, gated.observer.largest_innovation)
    with pytest.raises(ValueError, match="must be None beside a controller"):
        to_mat(gated, path, gain=gain)


def written(path):
    """Return what a file says; times stand in MAT-files alone."""
    return path.read_bytes()[128:] if path.suffix == ".mat" else path.read_bytes()


@pytest.mark.parametrize("export", ["to_c", "to_fmu", "to_mat", "to_st"])
def test_it_writes_itself_as_the_model_writes_its_parts(plants, export, tmp_path):
    plant = plants["fl"]
    gain, law = gain_of(plant, True), limited(plant)
    parts = {"gain": gain, "law": law, "observer": Observer(plant, gate=5.0)}
    controller = LinearizingController(plant, **parts)
    function, name = getattr(persistence, export), "a" if export == "to_c" else "a.st"
    name = {"to_fmu": "a.fmu", "to_mat": "a.mat"}.get(export, name)
    if export == "to_fmu":
        parts["what"] = "controller"
    (tmp_path / "own").mkdir()
    (tmp_path / "parts").mkdir()
    getattr(controller, export)(tmp_path / "own" / name)
    function(plant, tmp_path / "parts" / name, **parts)
    found = sorted(p for p in (tmp_path / "own").rglob("*") if p.is_file())
    assert found
    for path in found:
        other = tmp_path / "parts" / path.relative_to(tmp_path / "own")
        assert written(path) == written(other)


def test_it_becomes_functions_of_casadi(plants):
    pytest.importorskip("casadi")
    plant = plants["fl"]
    controller = LinearizingController(plant, gain_of(plant, True), law=limited(plant))
    control = controller.to_casadi()["control"]
    x, z = np.zeros(control.size1_in("x")), np.zeros(control.size1_in("z"))
    rng = np.random.default_rng(0)
    for y in plant.y_offset + plant.y_scale * rng.standard_normal((20, plant.ny)):
        expected = controller.step(plant.y_offset, y)
        u, x, z = (np.array(w) for w in control(x, z, plant.y_offset, y, []))
        np.testing.assert_allclose(u.ravel(), expected, rtol=0, atol=1e-9)


def test_a_preview_needs_a_plan(plants):
    controller = LinearizingController(plants["fl"])
    with pytest.raises(ValueError, match="`preview` must be False"):
        controller.simulate(plants["fl"], np.zeros((5, 1)), preview=True)


def test_predictive_control_has_the_same_interface():
    assert issubclass(LinearizingMPC, Controller)
    for name in ("step", "reset", "simulate"):
        ours = inspect.signature(getattr(LinearizingController, name)).parameters
        theirs = inspect.signature(getattr(LinearizingMPC, name)).parameters
        assert [p for p in theirs if p in ours] == list(ours)


def test_predictive_control_holds_what_the_law_knows(plants):
    plant = plants["linear"]
    mpc = LinearizingMPC(plant, horizon=5, u_max=plant.u_offset + plant.u_scale)
    run = mpc.simulate(plant, np.tile(plant.y_offset + plant.y_scale, (40, 1)))
    assert run.saturated.any() and run.law is mpc.law
    assert run.plot().axes_.shape == (2, 1)


def test_runs_are_drawn_with_references_and_limits(plants):
    plant = plants["fl"]
    controller = LinearizingController(plant, law=limited(plant, 0.1))
    display = controller.plot()
    y, u = display.axes_[0, 0], display.axes_[plant.ny, 0]
    assert display.record.saturated[:, 0].any()
    assert [line.get_label() for line in y.lines] == ["y", "reference"]
    assert y.get_ylabel() == "level" and u.get_ylabel() == "valve_a"
    assert "at a limit" in [t.get_text() for t in u.get_legend().get_texts()]
    np.testing.assert_array_equal(u.lines[0].get_ydata(), display.record.u[:, 0])
    # references of a static gain are no outputs
    static = LinearizingController(plant, gain_of(plant, False)).plot()
    assert [line.get_label() for line in static.axes_[0, 0].lines] == ["y"]


def test_it_can_be_pickled_and_goes_on(plants):
    plant = plants["fl, state"]
    controller = LinearizingController(plant, gain_of(plant, False), law=limited(plant))
    r, y = plant.v_offset + plant.v_scale, plant.y_offset + plant.y_scale
    controller.step(r, y)
    twin = pickle.loads(pickle.dumps(controller))
    np.testing.assert_array_equal(twin.step(r, y), controller.step(r, y))
    run = controller.simulate(plant, np.tile(r, (5, 1)))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(run)).x_hat, run.x_hat)


def test_errors(plants, tmp_path):
    plant, other = plants["fl"], plants["linear"]
    make, K = LinearizingController, gain_of(plants["fl"], True)
    law, run = limited(plant), LinearizingController(plant, K)
    D = np.zeros((2, 4))
    cases = [
        (
            lambda: make(plant, K, law=law, u_min=0.0),
            "`u_min` and `u_max` must be None",
        ),
        (
            lambda: make(plant, K, controller=control.ss([], [], [], D, True)),
            "got both",
        ),
        (lambda: make(plant, K, law=limited(other)), r"`law`.*\(4, 2\), got \(2, 1\)"),
        (lambda: make(plant, K, observer=Observer(other)), "`observer` must have as"),
        (
            lambda: make(plant, K, observer=DisturbanceObserver(plant)),
            "`observer` must",
        ),
        (lambda: make(plant, K[:, :3]), "`gain` must be finite and have shape"),
        (
            lambda: make(plant, K, observer=False).step([0, 0], [0, 0]),
            "False for a con",
        ),
        (lambda: make(plant, K, observer=False).to_c(tmp_path), "must not be False"),
        (
            lambda: closed_loop(plants["monotone"], make(plant, K, observer=False)),
            "False unless `plant` is its own model",
        ),
        (lambda: run.step([0.0], [0, 0]), r"`reference` must have shape \(2,\)"),
        (lambda: run.step([0.0, 0.0], None), "`y` must be a measurement"),
        (lambda: run.step([0, 0], [0, 0], d=[1.0]), r"`d` must have shape \(0,\)"),
        (lambda: run.reset([1.0]), r"`x0` must have shape \(2,\)"),
        (lambda: closed_loop(plant, run, K), "`gain` must be None beside a controller"),
        (
            lambda: (
                plants["given, identity, state, 1"]
                and make(plants["given, identity, state, 1"]).step([0.0], [0.0])
            ),
            "`d` must have the 1 measured",
        ),
    ]
    for call, message in cases:
        with pytest.raises(ValueError, match=message):
            call()
    for part in ("law", "observer"):
        with pytest.raises(TypeError, match=f"`{part}` must be"):
            make(plant, K, **{part: "u = v"})


def test_without_observer_the_loop_has_the_true_state(plants):
    plant = plants["fl, state"]
    gain = gain_of(plant, False)
    controller = LinearizingController(plant, gain, observer=False)
    r, d = references(plant, plant.v_offset, plant.v_scale)
    found = response(closed_loop(plant, controller), plant, r, d)
    expected = response(closed_loop(plant, plant, gain), plant, r, d)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_state_that_is_known_too_late_is_refused():
    options = {"n_h": 2, "n_g": 0, "feedback": "state", "feedthrough": True}
    plant = lively(fit(al_ssnn(nx=2, **options, **SMALL), 1, 1)).plant_
    controller = LinearizingController(plant)
    with pytest.raises(ValueError, match="through D: the estimated state would wait"):
        controller.step(plant.y_offset, plant.y_offset)
    assert closed_loop(plant, controller).ninputs == 1  # solves the algebraic loop

"""Exports of plants with measured disturbances do what Python does."""

import shutil

import control
import numpy as np
import pytest
from scipy.io import loadmat

from alssnn.feedback import LinearizingLaw, closed_loop, lqi, lqr
from alssnn.models import state_space
from alssnn.persistence import to_c, to_mat, to_onnx
from helpers import plant_of_structure

NU, GIVEN, MOVED = 3, (0, 2), [1]
N = 300
STRICT = "-std=c99 -Wall -Wextra -Werror -pedantic"


def make_plant(input_map, feedback, given=GIVEN, n_g=2):
    """Return a plant of one output whose inputs have units."""
    rng = np.random.default_rng(3)
    structure = state_space(
        2,
        NU,
        1,
        n_h=4,
        n_g=n_g,
        C=np.array([[1.0, 0.3]]),
        feedback=feedback,
        input_map=input_map,
        disturbances=given,
    )
    p = {k: 0.4 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    p["A"] = np.array([[0.8, 0.2], [-0.1, 0.7]])
    return plant_of_structure(structure, structure.join(p), rng)


PLANTS = {
    f"{input_map}, {feedback}, {len(given)}": (input_map, feedback, given)
    for input_map in ("identity", "monotone")
    for feedback in ("output", "state")
    for given in (GIVEN, (1,))
}


@pytest.fixture(params=PLANTS, scope="module")
def plant(request):
    return make_plant(*PLANTS[request.param])


def signals(plant, n=N):
    """Return all inputs, and what the law measures."""
    rng = np.random.default_rng(0)
    u = plant.u_offset + plant.u_scale * rng.standard_normal((n, plant.nu))
    x = rng.standard_normal((n, plant.nx))
    return u, x, x if plant.feedback == "state" else plant.output(x, u)


@pytest.mark.parametrize("names", ["D", "H", "D and H", "H and k"])
def test_what_brings_inputs_to_the_output_at_once_is_named(tmp_path, names):
    """H is there without D where bounds hold D at zero."""
    sizes = {"n_h": 2, "n_k": 2 * ("k" in names), "feedback": "state"}
    structure = state_space(
        2, NU, 1, C=np.ones((1, 2)), feedthrough=True, disturbances=GIVEN, **sizes
    )
    rng = np.random.default_rng(3)
    p = {k: 0.4 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    for name in {"D", "H"} - set(names):
        p[name] *= 0.0
    plant = plant_of_structure(structure, structure.join(p), rng)
    with pytest.raises(ValueError, match=rf"same sample through {names}, got None"):
        plant.output(np.zeros(2))
    with pytest.raises(ValueError, match=rf"same sample, through {names}: "):
        to_c(plant, tmp_path, gain=np.zeros((1, 2)))


gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc")


def assert_close(values, expected, scale):
    assert (np.abs(values - expected) / scale).max() < 1e-12


@gcc
def test_the_law_in_c(plant, tmp_path):
    from test_c import Compiled

    u, x, s = signals(plant)
    v, d = plant.virtual(x, u), u[:, list(plant.given)]
    low = plant.v_offset - 0.5 * plant.v_scale
    for name, law in (("free", None), ("limited", LinearizingLaw(plant, u_min=low))):
        c = Compiled(plant, tmp_path / name, law=law, observer=False)
        found, cut = np.empty((2, N, plant.nv))
        for k in range(N):
            c.law(*(c.array(z[k]) for z in (v, s, d)), found[k], cut[k])
        python = LinearizingLaw(plant) if law is None else law
        expected, lost = python.split(v, s, d)
        assert_close(found, expected, plant.v_scale)
        assert_close(cut, lost, 10 * plant.v_scale)
    assert np.any(lost)


@gcc
@pytest.mark.parametrize("integrates", [True, False])
def test_the_controller_in_c(plant, integrates, tmp_path):
    from test_c import Compiled

    if integrates:
        gain = lqi(plant, np.eye(3), np.eye(plant.nv))
    else:
        gain = lqr(plant, np.eye(2), np.eye(plant.nv))
    observer = plant_observer(plant)
    c = Compiled(plant, tmp_path, gain=gain, observer=observer)
    state = c.zeros(200)  # more than the controller has
    c.reset(state)
    rng = np.random.default_rng(1)
    d = plant.d_offset + np.repeat(rng.standard_normal((6, plant.nd)), 10, axis=0)
    rest = plant.y_offset if integrates else plant.v_offset
    r = rest + 0.3 * np.repeat(rng.standard_normal((6, len(rest))), 10, axis=0)
    loop = closed_loop(plant, plant, gain, observer=observer)
    response = control.input_output_response(
        loop, plant.dt * np.arange(60), np.hstack([r, d]).T
    ).outputs
    y, u = np.empty((60, 1)), np.empty((60, plant.nv))
    x, y_k, u_k = np.zeros(2), c.zeros(1), c.zeros(plant.nv)
    for k in range(60):
        y[k] = plant.output(x)
        y_k[:] = y[k]
        c.control(state, c.array(r[k]), y_k, c.array(d[k]), u_k)
        u[k] = u_k
        x = plant.step(x, plant.every_input(u_k, d[k]))
    assert_close(y[:, 0], response[0], 10.0)
    assert_close(u, response[1 : 1 + plant.nv].T, 10 * plant.v_scale)


def plant_observer(plant):
    from alssnn.feedback import Observer

    return Observer(plant)


@gcc
def test_a_disturbance_that_is_no_number_is_the_last_one(tmp_path):
    from test_c import Compiled

    plant = make_plant("monotone", "state")
    c = Compiled(plant, tmp_path, gain=lqi(plant, np.eye(3), np.eye(1)))
    outputs = []
    for second in ([1.0, 2.0], [np.nan, np.inf]):
        state, u, y = c.zeros(200), c.zeros(1), c.array(plant.y_offset)
        c.reset(state)
        for d in ([1.0, 2.0], second, second):
            c.control(state, y, y, c.array(d), u)
        outputs.append(u[0])
    assert outputs[0] == outputs[1]
    assert np.isfinite(outputs[0])


def test_the_demo_in_c_runs(tmp_path):
    if shutil.which("gcc") is None:
        pytest.skip("no gcc")
    import subprocess

    plant = make_plant("identity", "output")
    to_c(plant, tmp_path, gain=lqi(plant, np.eye(3), np.eye(1)))
    header = (tmp_path / "plant.h").read_text()
    assert "#define PLANT_ND 2" in header
    assert "plant_control(&c, r, y, d, u)" in (tmp_path / "README.md").read_text()
    files = [tmp_path / name for name in ("plant.c", "plant_demo.c")]
    subprocess.run(
        ["gcc", *STRICT.split(), "-o", tmp_path / "demo", *files, "-lm"],
        check=True,
    )
    run = subprocess.run(
        [tmp_path / "demo"], capture_output=True, text=True, check=True
    )
    lines = run.stdout.splitlines()
    assert lines[0] == "k,y[0],u[0],u[1],u[2]"
    last = float(lines[-1].split(",")[1])
    wanted = plant.y_offset[0] + 0.5 * plant.y_scale[0]
    assert abs(last - wanted) < 1e-6 * plant.y_scale[0]


def test_onnx(tmp_path):
    pytest.importorskip("onnx")
    reference = pytest.importorskip("onnx.reference")
    plant = make_plant("identity", "output")
    step, law = to_onnx(plant, tmp_path)
    u, x, s = signals(plant)
    v, d = plant.virtual(x, u), u[:, list(plant.given)]
    found = reference.ReferenceEvaluator(str(law)).run(None, {"v": v, "y": s, "d": d})
    np.testing.assert_allclose(found[0], u[:, MOVED], atol=1e-12)
    found = reference.ReferenceEvaluator(str(step)).run(None, {"x": x, "u": u})
    np.testing.assert_allclose(found[0], plant.step(x, u), atol=1e-12)


@pytest.mark.parametrize("input_map", ["identity", "monotone"])
def test_mat(input_map, tmp_path):
    plant = make_plant(input_map, "state")
    to_mat(plant, tmp_path / "model.mat")
    told = loadmat(tmp_path / "model.mat", squeeze_me=True)["model"]
    np.testing.assert_array_equal(told["disturbances"].item(), [1, 3])
    G, H = plant.disturbed_by()
    np.testing.assert_array_equal(told["G"].item(), G)
    np.testing.assert_array_equal(told["H"].item(), H[0])
    assert told["B"].item().shape == (2,)

"""ONNX graphs compute what Python computes, step by step."""

import json
import sys

import numpy as np
import pytest

from alssnn import Activation, LinearStateSpace
from alssnn.activations import ACTIVATIONS
from alssnn.persistence import to_onnx
from exported import (
    CONTROLLED,
    NAMES,
    assert_exact,
    make_loop,
    make_plant,
    signals,
)
from models import al_ssnn, fit, fl_ssnn, gr_ssnn, lively, simulate

onnx = pytest.importorskip("onnx", reason="onnx is not installed")
from onnx.reference import ReferenceEvaluator  # noqa: E402

STEPS = 1000
SMALL = {"max_iter": 3, "tol": 1e-2, "random_state": 0, "dt": 0.25}
# estimator and (nu, ny)
MODELS = {
    "linear": (LinearStateSpace(nx=2, dt=0.25), (1, 1)),
    **{
        f"al, {name}": (al_ssnn(nx=3, n_h=3, n_g=3, activation=name, **SMALL), (2, 2))
        for name in ACTIVATIONS
    },
    "state, deep": (
        al_ssnn(nx=3, feedback="state", n_h=(3, 2), n_g=(4, 3), **SMALL),
        (2, 1),
    ),
    "D, k, late": (
        al_ssnn(
            nx=2,
            n_h=2,
            n_g=2,
            n_k=(2, 2),
            feedthrough=True,
            input_delay=(0, 3),
            activation={"h": "sigmoid", "g": "relu", "k": "sin"},
            **SMALL,
        ),
        (2, 2),
    ),
    "all late": (gr_ssnn(nx=2, n_f=2, input_delay=(1, 2), **SMALL), (2, 1)),
    "fl, wide": (fl_ssnn(nx=2, n_h=2, input_delay=(2,), **SMALL), (1, 2)),
}


@pytest.fixture(scope="module")
def fitted():
    return {
        name: lively(fit(model, nu, ny), size=0.05)
        for name, (model, (nu, ny)) in MODELS.items()
    }


def read(path):
    """Return a function of arrays, and the metadata of a file."""
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    run = ReferenceEvaluator(model)
    names = [value.name for value in model.graph.input]
    told = {entry.key: entry.value for entry in model.metadata_props}
    return lambda *z: run.run(None, dict(zip(names, z, strict=True))), told


def signal(model, n, size=1.0, seed=0):
    """Return inputs around the operating point."""
    rng = np.random.default_rng(seed)
    du = rng.standard_normal((n, len(model.u_offset_)))
    return model.u_offset_ + size * model._scaling.u_scale * du


@pytest.mark.parametrize("name", NAMES)
def test_every_structure_is_what_its_plant_is(name, tmp_path):
    plant = make_plant(name)
    late = plant.late()
    x, u, s = signals(plant)
    paths = to_onnx(plant, tmp_path)
    after, y = read(paths[0])[0](x, u)
    assert_exact(after, late.step(x, u))
    assert_exact(y, late.output(x, u))
    has_law = plant.is_explicit and not plant.no_law
    assert len(paths) == 1 + has_law
    if has_law:
        assert_exact(read(paths[1])[0](u, s)[0], plant.law(u, s))


@pytest.mark.parametrize("name", CONTROLLED)
def test_the_law_of_every_loop(name, tmp_path):
    loop = make_loop(name)
    v, s, d = loop.law_signals(STEPS)
    law = loop.limited(loop.plant.law(v, s, d))
    paths = to_onnx(loop.plant, tmp_path, law=law)
    if loop.plant.is_solved:  # it iterates
        assert len(paths) == 1
        assert "by iteration" in read(paths[0])[1]["no_law"]
        return
    given = [d] if loop.plant.nd else []
    assert_exact(read(paths[1])[0](v, s, *given)[0], law(v, s, d))


@pytest.mark.parametrize("name", MODELS)
def test_the_steps_simulate_as_predict(fitted, name, tmp_path):
    model = fitted[name]
    step, told = read(model.to_onnx(tmp_path)[0])
    u, x0 = signal(model, STEPS), np.linspace(0.5, -0.3, model.nx_)
    x = np.concatenate([x0, np.zeros(int(model.input_delay_.sum()))])[None]
    y = np.empty((STEPS, len(model.C_)))
    for k, u_k in enumerate(u):
        x, y_k = step(x, u_k[None])
        y[k] = y_k[0]
    assert x.dtype == y_k.dtype == np.float64
    expected = simulate(model, u, x0=x0)
    assert np.ptp(expected, axis=0).min() > 0
    error = np.abs(y - expected).max(axis=0) / np.ptp(expected, axis=0)
    assert error.max() < 1e-12
    assert len(json.loads(told["states"])) == x.shape[1]


@pytest.mark.parametrize(
    "name", [n for n in MODELS if n not in ("D, k, late", "fl, wide")]
)
def test_the_law_is_that_of_the_model(fitted, name, tmp_path):
    model = fitted[name]
    nu, rng = len(model.u_offset_), np.random.default_rng(3)
    v = signal(model, 200, size=2.0, seed=1)
    by_state = "W_s" in model.params_
    s = rng.standard_normal((200, model.nx_ if by_state else len(model.C_)))
    if not by_state:
        s = model.y_offset_ + model._scaling.y_scale * s
    high = model.u_offset_ + model._scaling.u_scale
    low = np.where(np.arange(nu) == 0, high - 2 * model._scaling.u_scale, -np.inf)
    for law in (model.linearizing_law(), model.linearizing_law(low, high)):
        paths = model.to_onnx(tmp_path, law=law)
        run, _ = read(paths[1])
        (u,) = run(v, s)
        error = np.abs(u - law(v, s)) / model._scaling.u_scale
        assert error.max() < 1e-12
    assert (u == high).any() and (u[:, 0] == low[0]).any()


def test_rows_are_plants_of_their_own(fitted, tmp_path):
    model = fitted["D, k, late"]
    step, _ = read(model.to_onnx(tmp_path)[0])
    rng = np.random.default_rng(5)
    x = rng.standard_normal((7, model.nx_ + int(model.input_delay_.sum())))
    u = signal(model, 7)
    together = step(x, u)
    for i in range(7):
        for all_, one in zip(together, step(x[i : i + 1], u[i : i + 1]), strict=True):
            np.testing.assert_allclose(all_[i], one[0], rtol=1e-12, atol=1e-12)


def test_metadata_name_the_signals(fitted, tmp_path):
    paths = fitted["D, k, late"].to_onnx(tmp_path / "new", prefix="pump-1")
    assert [path.name for path in paths] == ["pump-1_step.onnx"]
    _, told = read(paths[0])
    assert json.loads(told["inputs"]) == ["valve_a", "p*/"]
    assert json.loads(told["outputs"]) == ["level", "flow"]
    assert json.loads(told["states"])[-3:] == [
        f"p*/, {k} samples ago" for k in (3, 2, 1)
    ]
    assert told["dt"] == "0.25" and told["feedback"] == "output"
    assert told["hold"] == "u is held for a sample"
    assert "algebraic loop" in told["no_law"]


def test_wrong_arguments(fitted, tmp_path, monkeypatch):
    model = fitted["linear"]
    with pytest.raises(ValueError, match="`prefix` must consist of letters"):
        model.to_onnx(tmp_path, prefix="a/b")
    with pytest.raises(TypeError, match="`law` must be a LinearizingLaw"):
        model.to_onnx(tmp_path, law=np.eye(2))
    own = Activation("own", np.arctan, lambda v, w: 1 / (1 + v**2), (0, 1), np.pi / 2)
    users = fit(fl_ssnn(nx=2, n_h=2, activation=own, **SMALL))
    with pytest.raises(ValueError, match=r"expression in 'onnx'.*got 'own'"):
        users.to_onnx(tmp_path / "own")
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(ImportError, match=r'pip install "alssnn\[onnx\]"'):
        model.to_onnx(tmp_path)
    assert list(tmp_path.iterdir()) == []

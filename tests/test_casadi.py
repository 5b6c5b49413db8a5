"""The functions of CasADi compute what Python computes, derivatives included."""

import sys

import numpy as np
import pytest

from alssnn import Activation
from alssnn.feedback import LinearizingLaw
from alssnn.persistence import to_casadi
from exported import (
    CONTROLLED,
    NAMES,
    assert_exact,
    make_loop,
    make_plant,
    make_unknown,
    signals,
)
from models import fit, fl_ssnn

casadi = pytest.importorskip("casadi", reason="casadi is not installed")

N = 1000


def rows(function, *arrays):
    """Return the outputs of a function for one sample per row."""
    many = function.map(len(arrays[0]))
    found = many.call([casadi.DM(np.atleast_2d(a.T)) for a in arrays])
    return [np.array(z).T for z in found]


@pytest.fixture(params=CONTROLLED, scope="module")
def loop(request):
    return make_loop(request.param)


@pytest.mark.parametrize("name", NAMES)
def test_every_structure_is_what_its_plant_is(name):
    plant = make_plant(name)
    late, functions = plant.late(), to_casadi(plant, observer=False)
    x, u, s = signals(plant, N)
    assert_exact(rows(functions["step"], x, u)[0], late.step(x, u))
    assert_exact(rows(functions["output"], x, u)[0], late.output(x, u))
    A, B, C, D = late.jacobian(x[:5], u[:5])
    for k in range(5):
        found = functions["step_jacobian"](x=x[k], u=u[k])
        assert_exact(np.array(found["dx_next_dx"]), A[k])
        assert_exact(np.array(found["dx_next_du"]), B[k])
        found = functions["output_jacobian"](x=x[k], u=u[k])
        assert_exact(np.array(found["dy_dx"]), C[k])
        assert_exact(np.array(found["dy_du"]), D[k])
    assert ("law" in functions) == (not plant.no_law)
    if "law" in functions:
        sent, cut = rows(functions["law"], u, s, np.empty((N, 0)))
        assert_exact(sent, plant.law(u, s))
        assert not cut.any()


def test_the_law_cancels_and_saturates_as_in_python(loop):
    v, s, d = loop.law_signals(N)
    law = loop.limited(loop.plant.law(v, s, d))
    expected, lost = law.split(v, s, d)
    sent, cut = rows(to_casadi(loop.plant, law=law)["law"], v, s, d)
    assert 0.3 < np.mean(np.any(lost, axis=1)) < 0.5
    assert_exact(sent, expected)
    assert_exact(cut, lost)


def test_derivatives_of_the_law_are_those_of_differences(loop):
    plant, rng = loop.plant, np.random.default_rng(1)
    law, slope = (to_casadi(plant)[name] for name in ("law", "law_jacobian"))
    v, d = rng.standard_normal(plant.nv), rng.standard_normal(plant.nd)
    s, h = rng.standard_normal(plant.law_form.nu - plant.nu), 1e-6
    found = slope(v=v, s=s, d=d)
    for name, value in (("v", v), ("s", s), ("d", d)):
        for i, e in enumerate(np.eye(len(value))):
            point = {"v": v, "s": s, "d": d}
            ahead = law(**{**point, name: value + h * e})["u"]
            before = law(**{**point, name: value - h * e})["u"]
            expected = np.array((ahead - before) / (2 * h)).ravel()
            column = np.array(found[f"du_d{name}"])[:, i]
            np.testing.assert_allclose(column, expected, atol=1e-7)


def test_the_observer_corrects_as_in_python(loop):
    late, observer = loop.plant.late(), loop.observer
    correct = to_casadi(loop.plant, **loop.options)["correct"]
    rng = np.random.default_rng(1)
    x, u = rng.standard_normal((N, late.nx)), rng.standard_normal((N, late.nu))
    y = late.output(x) + loop.signals(N)[1]
    found = rows(correct, x, y, u)[0]
    both = np.hstack([u, y])
    expected = [observer.output(0, *z, {}) for z in zip(x, both, strict=True)]
    assert_exact(found, np.array(expected))


def test_the_controller_acts_as_in_python(loop):
    control = to_casadi(loop.plant, **loop.options)["control"]
    x, z = np.zeros(control.size1_in("x")), np.zeros(control.size1_in("z"))

    def step(r, y, d):
        nonlocal x, z
        u, x, z = (np.array(w).ravel() for w in control(x, z, r, y, d))
        return u

    n = 300  # limits, gaps and spikes are met many times
    y, u = loop.run(step, n)
    expected_y, expected_u = loop.expected(n)
    met = (expected_u == loop.law.u_min) | (expected_u == loop.law.u_max)
    assert 0.02 < met.any(axis=1).mean() < 0.98
    assert not np.isfinite(y).all()
    assert_exact(u, expected_u)
    finite = np.isfinite(y)
    assert_exact(y[finite], expected_y[finite])


@pytest.mark.parametrize("hold", ["zoh", "cubic"])
def test_a_plant_in_continuous_time_is_one_of_its_samples(hold):
    options = {"time": "continuous", "hold": hold, "max_iter": 3, "random_state": 0}
    model = fit(fl_ssnn(nx=2, n_h=2, dt=0.25, **options), 1, 1)
    rng = np.random.default_rng(0)
    for plant in (model.plant_, model.plant_.at(0.1)):
        late = plant.late()
        x, u = rng.standard_normal((20, late.nx)), rng.standard_normal((20, late.nu))
        step = to_casadi(plant, observer=False)["step"]
        assert_exact(rows(step, x, u)[0], late.step(x, u))


def test_a_steep_map_is_solved():
    """Newton's method without a safeguard would jump back and forth here."""
    plant = make_plant("monotone")
    law = to_casadi(plant, observer=False)["law"]
    rng = np.random.default_rng(0)
    v = 100 * rng.standard_normal((N, plant.nv))
    s = 10 * rng.standard_normal((N, plant.law_form.nu - plant.nu))
    sent, _ = rows(law, v, s, np.empty((N, 0)))
    assert_exact(plant.cancelled(s, sent) + sent, v)


def test_refusals(monkeypatch):
    own = Activation("own", np.tanh, lambda v, w: 1 - w**2, (0, 1))
    with pytest.raises(ValueError, match=r"expression in 'casadi' .*'own'"):
        to_casadi(make_unknown(own), observer=False)
    plant = make_plant("al")
    with pytest.raises(TypeError, match="`law` must be a LinearizingLaw, got str"):
        to_casadi(plant, law="law")
    with pytest.raises(ValueError, match="another model"):
        to_casadi(plant, law=LinearizingLaw(make_plant("linear")))
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ImportError, match=r"alssnn\[casadi\]"):
        to_casadi(plant)

"""How far a plant will be from its design, told before it is in the loop."""

import tracemalloc
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import FlSsnn, LinearStateSpace
from alssnn.datasets import make_valve_tank
from alssnn.feedback import (
    LinearizingController,
    design_distance,
    missed,
    what_is_missed,
)
from alssnn.linearizability import judge
from alssnn.region import Region

STEPS = np.repeat([0.0, 0.3, -0.4, 0.1, 0.5, -0.2], 40)[:, None]
REST = 60  # samples that a loop needs to settle


def cubic(n=1500, noise=0.01, seed=0, bend=0.15):
    """Return a record and the plant x+ = 0.7 x + 0.3 u - bend x^3, y = x."""

    def step(t, x, u, params):
        return 0.7 * x + 0.3 * u - bend * x**3

    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.5, 1.5, n), rng.integers(1, 15, n))[:n, None]
    x = np.zeros((n + 1, 1))
    for k in range(n):
        x[k + 1] = step(0, x[k], u[k], {})
    y = x[:-1] + noise * x.std() * rng.standard_normal((n, 1))
    plant = control.nlsys(
        step, lambda t, x, u, params: x, inputs=1, outputs=1, states=1, dt=1.0
    )
    return u, y, plant


def true_distance(controller, plant):
    """Return what the loop of the true plant does, simulated by the controller."""
    own = controller.own
    r = own.y_offset + np.vstack([np.zeros((REST, 1)), STEPS])
    y = controller.simulate(plant, r).y
    design = alssnn.feedback.designed_loop(own, controller.gain)
    linear = control.forced_response(design, np.arange(len(r)), (r - own.y_offset).T)
    linear = linear.outputs[: own.ny].reshape(own.ny, -1).T + own.y_offset
    off = (y - linear)[REST:]
    return np.sqrt(np.mean(off**2)) / np.std(linear[REST:])


def told(model, u, y, **options):
    controller = model.controller()
    r = model.y_offset_ + np.vstack([np.zeros((1, 1)), STEPS])
    found = model.linearizability(u, y, controller=controller, reference=r, **options)
    return found, controller


@pytest.mark.parametrize("bend", [0.15, 0.05], ids=["much", "little"])
def test_what_a_linear_model_misses_is_told(bend):
    u, y, plant = cubic(bend=bend)
    model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
    found, controller = told(model, u, y)
    true = true_distance(controller, plant)
    assert true > 0.01
    assert true / 2 < found.carried[0] < 2 * true
    assert found.carried_model[0] < 1e-6  # of a linear model
    assert found.carried_low[0] <= found.carried[0] <= found.carried_high[0]
    # the model is linear, but the plant of its design would not be
    low = found.carried_low[0]
    passed, sentence = judge(found, within=0.9 * low)
    assert not passed and "not accurate enough for a loop" in sentence
    assert judge(found, within=1.1 * low)[0]


def test_what_noise_leaves_open_grows_with_it():
    """An exact model: nothing is missed, and ten times the noise hides ten times."""
    found = []
    for noise in (0.003, 0.03):
        u, y, _ = cubic(noise=noise, bend=0.0)
        model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
        found.append(told(model, u, y)[0])
    small, large = found
    assert 4 < large.carried_noise[0] / small.carried_noise[0] < 15
    assert small.carried_missed[0] < 2 * small.carried_noise[0]
    assert small.carried[0] < 0.01


def test_the_part_of_the_model_is_that_of_the_simulated_loop():
    u, y, _ = cubic()
    model = alssnn.AlSsnn(
        nx=1, n_h=2, n_g=2, gamma=0.0, alpha=1e-3, n_init=1, dt=1.0, random_state=0
    ).set_params(max_iter=30)
    model.fit(u, y)
    found, controller = told(model, u, y)
    expected = true_distance(controller, model)
    assert expected > 1e-4
    assert found.carried_model[0] == pytest.approx(expected, rel=0.02)


def test_the_law_removes_what_it_cancels():
    u, y, _ = cubic()
    linear = told(LinearStateSpace(nx=1, dt=1.0).fit(u, y), u, y)[0]
    law = FlSsnn(nx=1, n_h=4, n_init=1, dt=1.0, alpha=1e-6, random_state=0).fit(u, y)
    assert told(law, u, y)[0].carried[0] < 0.2 * linear.carried[0]


def test_outside_is_said_instead_of_a_number():
    u, y, _ = cubic()
    model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
    r = model.y_offset_ + 20 * STEPS
    found = model.linearizability(u, y, reference=r)
    assert found.carried_outside > 0.05 and np.isnan(found.carried[0])
    assert "outside, " in repr(found) and "possible plants" not in repr(found)
    passed, sentence = judge(found)
    assert passed and "is unknown" in sentence  # what is not known fails nothing
    inside = told(model, u, y)[0]
    assert inside.carried_outside < 0.05
    assert "outside, " not in repr(inside) and "possible plants" in repr(inside)
    assert set(inside.to_frame()["quantity"]) >= {"carried", "carried_noise"}


def test_two_inputs_disturbances_and_delays():
    rng = np.random.default_rng(0)
    u, x = rng.standard_normal((800, 3)), np.zeros((801, 2))
    for k in range(800):
        late = u[max(k - 2, 0), 0]
        push = [late + 0.3 * u[k, 2], u[k, 1] + 0.2 * np.tanh(u[k, 2])]
        x[k + 1] = x[k] @ [[0.7, 0.1], [0.0, 0.5]] + push
    y = x[:-1] + 0.01 * rng.standard_normal((800, 2))
    model = LinearStateSpace(nx=2, input_delay=[2, 0, 0], disturbances=[2]).fit(u, y)
    found = model.linearizability(u, y)
    assert found.carried.shape == (2,)
    assert np.all(found.carried < 0.2) and np.all(found.carried_model < 1e-6)
    # the tanh reaches the second output, and hardly the first through the regulator
    assert found.carried_missed[1] > 2 * found.carried_missed[0]
    # what fails is said of the output whose low end is too far
    figures = {"carried": [0.09, 0.07], "carried_high": [0.3, 0.08]}
    far = replace(
        found,
        carried_low=np.array([0.03, 0.06]),
        **{name: np.array(values) for name, values in figures.items()},
    )
    passed, sentence = judge(far)
    assert not passed and "7 % of the output from its design (6 % to 8 %)" in sentence


def test_more_outputs_than_inputs_have_a_gain_on_the_states():
    rng = np.random.default_rng(0)
    u, x = rng.standard_normal((600, 1)), np.zeros((601, 2))
    for k in range(600):
        x[k + 1] = x[k] @ [[0.7, 0.4], [0.0, 0.5]] + [u[k, 0], 0]
    model = LinearStateSpace(nx=2).fit(u, x[:-1] + 0.01 * rng.standard_normal((600, 2)))
    found = model.linearizability(u, x[:-1])
    assert found.carried.shape == (2,) and np.all(found.carried < 0.05)


def test_an_unstable_predictor_is_judged_by_its_predictions():
    record = alssnn.datasets.make_inverted_pendulum(1_000, random_state=0)
    model = LinearStateSpace(nx=2, noise="innovations", dt=record.dt)
    with pytest.warns(ConvergenceWarning, match="is unstable"):
        model.fit(record.u, record.y)
    found = model.linearizability(record.u, record.y)
    assert np.isfinite(found.carried_missed).all()


def test_a_valve_is_told_by_its_linear_model():
    """The same order as in `benchmarks.true_loops`: about a tenth, not a half."""
    tank = make_valve_tank(1_000, noise=0.01, random_state=0)
    model = LinearStateSpace(nx=1, disturbances=[1], dt=tank.dt).fit(tank.u, tank.y)
    (record,) = model.prepare_records(tank.u, tank.y)
    left = what_is_missed(model.plant_, [record])
    # the residual is that of the curve, and what is left of it is near the noise
    y_hat = model.predict(tank.u, x0=record.x0)
    residual = np.std(tank.y - y_hat.reshape(tank.y.shape))
    assert left.noise[0] < 0.2 * residual


def test_hidden_samples_tell_how_much_a_fit_may_miss():
    u, y, _ = cubic(n=120, bend=0.0)
    model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
    records, plant = model.prepare_records(u, y), model.plant_
    assert plant.hidden_error is None

    def distance(error):
        found = design_distance(replace(plant, hidden_error=error), records)
        return found.distance[0]

    unknown = distance(None)
    noise = np.sqrt(plant.noise)
    # errors there that noise explains leave less open, larger ones more
    assert distance(0.0) == distance(noise / 2) < unknown < distance(1.5 * noise)
    assert distance(10 * noise) > 1.5 * unknown
    assert distance(np.inf) == unknown  # it diverged there


def test_the_error_on_hidden_samples_is_one_of_the_plant(tmp_path):
    u, y, _ = cubic(n=400)
    model = LinearStateSpace(nx="auto", dt=1.0).fit(u, y)
    error = model.plant_.hidden_error
    assert error == model.orders_["linear"][model.nx_] > 0
    model.save(tmp_path / "m.npz")
    assert alssnn.load(tmp_path / "m.npz").plant_.hidden_error == error
    # a residual of predictions is not judged by simulations
    plant = replace(model.plant_, K=np.full((model.nx_, 1), 0.1))
    records = model.prepare_records(u, y)
    one, other = (
        what_is_missed(replace(plant, hidden_error=e), records) for e in (None, 1.0)
    )
    assert np.array_equal(one.factor, other.factor)


def test_networks_that_were_left_tell_nothing_of_the_linear_model():
    u, y, _ = cubic(n=400, bend=0.0, noise=0.2)
    model = FlSsnn(nx=1, n_h=2, n_init=1, max_iter=20, random_state=0)
    with pytest.warns(ConvergenceWarning, match="linear model, which is returned"):
        model.fit(u, y)
    assert model.orders_["networks"] and model.plant_.hidden_error is None


def test_the_kernel_is_as_large_everywhere():
    rng = np.random.default_rng(0)
    X, du = rng.standard_normal((500, 1)), rng.standard_normal((500, 1))
    region = Region.of(X, du, X)
    z = np.hstack([X, du]) - region.center
    z = z @ region.whiten / region.radius
    powers = missed._powers(region, 1, 1e6)
    psi = missed._terms(region, powers, X, du)
    near = np.linalg.norm(z, axis=1) < 0.4  # the series ends at a degree
    apart = np.sum((z[near, None] - z[None, near]) ** 2, axis=2)
    kernel = np.exp(-(missed.TURN**2) / 2 * apart)
    np.testing.assert_allclose(psi[near] @ psi[near].T, kernel, atol=2e-3)


def test_a_model_may_miss_as_much_as_its_residual(monkeypatch):
    u, y, _ = cubic(noise=0.15)
    model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
    (record,) = model.prepare_records(u, y)
    assert 1 - model.score(u, y) > missed.EXPECTED
    before = what_is_missed(model.plant_, [record]).factor
    monkeypatch.setattr(missed, "EXPECTED", 1e-9)
    assert np.array_equal(what_is_missed(model.plant_, [record]).factor, before)


@pytest.mark.parametrize("observed", [0.2, 1.0, 5.0])
def test_the_enlargement_is_the_most_likely_one(observed):
    """Of one coefficient with unit effect, the equation is one of numbers."""
    every, noise, prior = np.ones((100, 1, 1)), 0.1, 2.0
    hidden = np.arange(100) >= 20
    weight = np.array([0.2])  # of every sample

    def misfit(s):
        made = 1 / (prior / np.exp(s) + 20 * weight[0])  # what the others leave open
        total = noise + made
        variance = (2 * noise**2 / 80 + made**2) / total**2
        off = np.log(observed / total)
        return off**2 / variance + np.log(variance) + (s / missed.LOG_SPREAD) ** 2

    best = minimize_scalar(misfit, bounds=(-9, 9)).x
    gram = np.full((1, 1, 1), 100.0)
    found = missed._enlarged(every, gram, weight, [hidden], observed, noise, prior)
    assert np.log(found) == pytest.approx(best, abs=0.06)  # half of a step


def test_hidden_experiments_count_together():
    """What is open on hidden samples is what the rest leaves, of all outputs."""
    u, y, _ = cubic(n=1_200, bend=0.0)
    model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
    plant = replace(model.plant_, hidden_error=0.1)
    parts = np.repeat([0, 1], 600)
    sizes = [
        np.linalg.norm(what_is_missed(plant, model.prepare_records(u, y, of)).factor)
        for of in (None, parts)
    ]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.5)


def test_missing_outputs_and_several_experiments():
    u, y, _ = cubic()
    model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
    whole = told(model, u, y)[0].carried[0]
    holes = y.copy()
    holes[100:130] = np.nan
    parts = np.repeat([0, 1, 2], 500)
    found = told(model, u, holes, experiment=parts)[0].carried[0]
    assert found == pytest.approx(whole, rel=0.25)


def test_many_states_take_samples_and_not_memory(monkeypatch):
    u, y, _ = cubic(n=3_000)
    model = LinearStateSpace(nx=6, dt=1.0).fit(u, y)
    (whole,) = model.prepare_records(u, y)
    before = what_is_missed(model.plant_, [whole])
    monkeypatch.setattr(missed, "ENTRIES", 1e5)
    tracemalloc.start()
    try:
        few = what_is_missed(model.plant_, [whole])
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20 * 8 * missed.ENTRIES
    assert few.noise[0] == pytest.approx(before.noise[0], rel=0.2)
    # of every experiment the same share, and no more than constants of many states
    parts = missed._first([(np.arange(100),) * 2, (np.arange(300),) * 2], 40)
    assert [len(first) for first, _ in parts] == [10, 30]
    powers = missed._powers(Region.of(np.eye(50), np.eye(50), np.eye(50)), 50, 1e6)
    assert powers.sum() == 0 and len(powers) == 1


def test_arguments_are_checked():
    u, y, _ = cubic(n=400)
    model = LinearStateSpace(nx=1, dt=1.0).fit(u, y)
    (records, plant) = model.prepare_records(u, y), model.plant_
    with pytest.raises(TypeError, match="`controller` must be a LinearizingController"):
        design_distance(plant, records, controller=1.0)
    other = LinearStateSpace(nx=2, dt=1.0).fit(u, y)
    with pytest.raises(ValueError, match="`controller` must be made for this model"):
        design_distance(plant, records, controller=LinearizingController(other))
    with pytest.raises(ValueError, match="`reference`"):
        model.linearizability(u, y, reference=np.zeros((5, 2)))

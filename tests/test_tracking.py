import numpy as np
import pytest

import alssnn
from alssnn.feedback import balanced_weights, designed_loop, lqi, tracking_comparison
from helpers import simulate_linear


@pytest.fixture(scope="module")
def two_by_two():
    rng = np.random.default_rng(0)
    u = 2.0 + rng.standard_normal((600, 2))
    A, B = np.array([[0.8, 0.1], [-0.1, 0.7]]), np.array([[0.3, 0.1], [0.0, 0.4]])
    y = simulate_linear(A, B, np.eye(2), u)[200:]
    return alssnn.LinearStateSpace(nx=2, dt=0.1).fit(u[200:], y)


def test_a_linear_model_is_its_own_design(two_by_two):
    model = two_by_two
    gain = lqi(model, *balanced_weights(model))
    r = np.repeat(
        [model.y_offset_, model.y_offset_ + np.array([0.3, -0.2])], [5, 60], axis=0
    )
    responses = tracking_comparison(model, model, gain, r)
    design, loop, alone = (responses[n] for n in ("design", "loop", "open loop"))
    assert design.output_labels == loop.output_labels[:4]
    np.testing.assert_allclose(loop.outputs[:4], design.outputs, atol=1e-9)
    np.testing.assert_allclose(loop.outputs[4:], design.outputs[2:], atol=1e-9)  # u = v
    np.testing.assert_allclose(alone.outputs, design.outputs[:2], atol=1e-9)
    np.testing.assert_allclose(loop.time, 0.1 * np.arange(65))
    radius = np.abs(designed_loop(model, gain).poles()).max()
    assert radius**60 < 1e-2
    np.testing.assert_allclose(loop.outputs[:2, -1], r[-1], atol=0.3 * radius**55)


def test_the_true_tank_with_a_measured_inflow():
    tank = alssnn.datasets.make_valve_tank(600, random_state=0)
    model = alssnn.LinearStateSpace(nx=1, disturbances=[1], dt=tank.dt).fit(*tank)
    gain = lqi(model, *balanced_weights(model, integral=0.1))
    responses = tracking_comparison(tank.plant, model, gain, np.full(300, 0.5))
    level, _, lift = responses["loop"].outputs
    assert abs(level[-1] - 0.5) < 1e-3 and 0 < lift[-1] < 1
    # without feedback the linear model misses the curve of the valve
    assert abs(responses["open loop"].outputs[0, -1] - 0.5) > 0.02


def test_wrong_references(two_by_two):
    gain = lqi(two_by_two, *balanced_weights(two_by_two))
    for r in (np.zeros(9), np.zeros((9, 3)), np.full((9, 2), np.nan)):
        with pytest.raises(ValueError, match=r"`r` must be finite with one column per"):
            tracking_comparison(two_by_two, two_by_two, gain, r)
    with pytest.raises(ValueError, match="`gain` must have 4 columns, integrators"):
        tracking_comparison(two_by_two, two_by_two, gain[:, :2], np.zeros((9, 2)))

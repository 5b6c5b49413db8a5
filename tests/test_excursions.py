"""Excursions: what a model does under inputs that its record does not have."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from alssnn.excursions import (
    APART,
    LARGER,
    LONGEST,
    Excursion,
    apart,
    away,
    escapes,
    settling,
    within_reach,
)
from alssnn.linear_model import LinearModel
from alssnn.models import state_space
from alssnn.simulation import outputs, simulate
from helpers import bistable, point


@pytest.mark.parametrize(
    ("threshold", "offset", "found"),
    [
        (1.75, 0.0, True),  # beyond what the record reaches, 1.56, and below 1.95
        (2.5, 0.0, False),
        (1.75, 100.0, True),  # inputs deviate from their mean, not from zero
        (2.5, 100.0, False),
    ],
)
def test_a_second_attractor_beyond_the_record_is_found(threshold, offset, found):
    structure, _ = bistable(0.0)
    u = np.random.default_rng(0).uniform(-1, 1, (500, 1))
    values = {"A": 0.5, "B": 1.0, "W_x": 40.0, "b_x": -40.0 * threshold, "W_g": 5.0}
    theta = {n: np.full(structure.shapes[n], values.get(n, 0.0)) for n in values}
    theta["W_u"] = np.zeros((1, 1))
    if offset:  # x = 2 offset + what it is without
        theta["b_x"] = theta["b_x"] - 40.0 * 2 * offset
    u, x0 = u + offset, np.array([[2 * offset]])
    theta = structure.join(theta)
    y = outputs(structure.lure(theta), u, x0[0])
    assert np.ptp(y) < 4
    y[::7] = np.nan  # not measured
    assert escapes(structure, theta, x0, [(u, y)]) == found


def test_a_constant_output_escapes_nowhere(rng):
    u = rng.standard_normal((300, 1))
    model = point(np.array([[0.5]]), np.array([[1e-3]]), np.ones((1, 1)))
    assert not escapes(*model, np.zeros((1, 1)), [(u, np.zeros((300, 1)))])


def test_a_simulation_that_diverges_escapes(rng):
    u = rng.standard_normal((3000, 1))
    model = point(np.array([[3.0]]), np.ones((1, 1)), np.ones((1, 1)))
    assert escapes(*model, np.zeros((1, 1)), [(u, u)])


# -- inputs that are held --------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.0, 0.3, 0.9, 0.99])
def test_inputs_are_held_until_the_slowest_mode_has_settled(radius):
    A = np.array([[radius, 5.0], [0.0, radius / 2]])  # not normal: poles decide
    n_held = settling(A)
    assert 1 <= n_held <= LONGEST
    assert radius**n_held <= 0.01 and (n_held == 1 or radius ** (n_held - 1) > 0.01)


@pytest.mark.parametrize("radius", [0.9999, 1.0, 1.2])
def test_no_input_is_held_for_ever(radius):
    assert settling(np.array([[radius]])) == LONGEST


def test_a_slow_plant_that_has_not_come_to_rest_is_no_latch():
    """It is compared with its linear model, which has not either."""
    slow = LinearModel(*(np.full((1, 1), z) for z in (0.9999, 1e-2, 1.0, 0.0, 0.0)))
    u = np.linspace(-1, 1, 300)[:, None]
    structure, theta, fit = slow.as_fit()
    excursion = Excursion.beside(slow, [(u, u)])
    assert excursion.apart > APART
    assert not excursion.latches(structure, theta, fit.x0)
    other = replace(excursion, apart=np.zeros(1))
    assert other.latches(structure, theta, fit.x0)


def latches(structure, theta, x0, experiments, n_held, larger=LARGER):
    larger = np.full((structure.sizes["u"], 2), larger)
    return not np.all(apart(structure, theta, x0, experiments, n_held, larger) <= APART)


def record_of(structure, theta, rng, amplitude):
    u = amplitude * rng.uniform(-1, 1, (400, 1))
    x0 = np.ones((1, 1))
    return x0, [(u, simulate(structure.lure(theta), u, x0[0])[:-1])]


@pytest.mark.parametrize("amplitude", [0.02, 1.0])
@pytest.mark.parametrize(("w", "keeps"), [(0.3, False), (0.75, True)])
def test_a_model_that_rests_in_two_places_latches(rng, w, keeps, amplitude):
    """Only inputs that are large enough to take it to the other place show it."""
    structure, theta = bistable(w)
    x0, experiments = record_of(structure, theta, rng, amplitude)
    model = structure, theta, x0, experiments
    found = keeps and amplitude == 1.0
    assert latches(*model, 50) == found
    linear = LinearModel(*(np.full((1, 1), z) for z in (0.5, 1.0, 1.0, 0.0, 0.0)))
    excursion = Excursion.beside(linear, experiments)
    assert excursion.latches(*model[:3]) == found
    assert excursion.leads(*model[:3]) == found


@pytest.mark.parametrize(
    ("before", "after", "slow", "opens"),
    [
        (0.0, 0.49, 0.0, False),
        (0.0, 0.51, 0.0, True),
        (0.4, 0.89, 0.0, False),  # as far apart as the plant may have them
        (0.4, 0.91, 0.0, True),
        (0.0, 0.69, 0.2, False),  # the linear model has not come to rest either
        (0.0, 0.71, 0.2, True),
        (0.0, np.inf, 0.0, True),
    ],
)
def test_a_training_may_move_two_places_apart(monkeypatch, before, after, slow, opens):
    monkeypatch.setattr(Excursion, "gap", lambda self, structure, theta, x0: theta)
    asks = Excursion([], 50, np.array([slow, slow]), np.ones((1, 2)))
    found, trained = (
        SimpleNamespace(theta=np.array([0.0, gap]), x0=None) for gap in (before, after)
    )
    assert asks.opens(None, found, trained) == opens
    assert not asks.opens(None, trained, found)


def test_no_input_hides_what_another_latches(rng):
    """Of three inputs and two outputs, one pair has two places to rest."""
    structure = state_space(2, 3, 2, n_g=1, C=np.eye(2))
    zero = {name: np.zeros(shape) for name, shape in structure.shapes.items()}
    values = zero | {
        "A": 0.5 * np.eye(2),
        "B": np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        "W_x": np.array([[0.0, 1.0]]),
        "W_g": np.array([[0.0], [0.75]]),
    }
    x0, u = np.zeros((1, 2)), rng.uniform(-1, 1, (300, 3))
    for shared, found in (([0.0, 0.75], True), ([0.75, 0.0], False)):
        values["W_g"] = np.array(shared)[:, None]
        theta = structure.join(values)
        assert latches(structure, theta, x0, [(u, np.zeros((300, 2)))], 50) == found


@pytest.mark.parametrize(("threshold", "found"), [(2.2, True), (2.6, False)])
def test_inputs_that_are_held_are_larger_than_those_of_the_record(threshold, found):
    """Held at 1, x comes to 2, and held at 1.25 to 2.5: there it jumps to 8.5.

    It then stays up for good, at the least input, too.
    """
    structure, _ = bistable(0.0)
    values = {"A": 0.5, "B": 1.0, "W_x": 40.0, "b_x": -40.0 * threshold, "W_g": 1.5}
    theta = {n: np.full(structure.shapes[n], values.get(n, 0.0)) for n in values}
    theta["W_u"] = np.zeros((1, 1))
    theta = structure.join(theta)
    u = np.linspace(-1, 1, 300)[:, None]
    model = structure, theta, np.zeros((1, 1)), [(u, u)]
    assert latches(*model, 60) == found


# -- the way back ----------------------------------------------------------------------


def switch(threshold):
    """Return a resonance, and a second state that it switches for good if it is wide.

    x_3 rests at -1.5, and at 1.5 once x_1 has been above the threshold.
    """
    structure = state_space(3, 1, 1, n_g=3, C=np.array([[1.0, 0.0, 0.1]]))
    zero = {name: np.zeros(shape) for name, shape in structure.shapes.items()}
    turn = 0.95 * np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
    A = np.zeros((3, 3))
    A[:2, :2], A[2, 2] = turn, 0.5
    W_x = np.zeros((3, 3))
    W_x[0, 0] = W_x[1, 2] = 40.0
    W_g = np.zeros((3, 3))
    W_g[2] = 2.0, 0.75, 2.0  # x_3+ = x_3 / 2 + 0.75 sign(x_3) + 4 (x_1 > threshold)
    return structure, structure.join(
        zero
        | {"A": A, "B": np.array([[1.0], [0.0], [0.0]]), "W_x": W_x, "W_g": W_g}
        | {"b_x": np.array([-40.0 * threshold, 0.0, 40.0])}
    )


@pytest.mark.parametrize(("beyond", "stays"), [(1.1, True), (1.4, False)])
@pytest.mark.parametrize("runs", [1, 2])
def test_a_model_that_larger_inputs_have_switched_for_good_stays_away(
    beyond, stays, runs
):
    """Held inputs, as large as they are, do not switch it: they do not resonate."""
    u = np.sin(0.5 * np.arange(400.0))[:, None]
    structure, _ = switch(0.0)
    reached = np.abs(simulate(structure.lure(switch(1e3)[1]), u, np.zeros(3))[:, 0])
    theta = switch(beyond * reached.max())[1]
    x0 = np.tile([0.0, 0.0, -1.5], (runs, 1))
    experiments = [(u, outputs(structure.lure(theta), u, x0[0])) for _ in range(runs)]
    model = structure, theta, x0
    np.testing.assert_allclose(away(*model, experiments), 0.3 * stays, atol=1e-3)
    experiments = [(u, 10 * y) for u, y in experiments]  # outputs of usual size
    structure = replace(structure, constants={"C": 10 * structure.constants["C"]})
    model = structure, theta, x0
    A, C = structure.split(theta)["A"][:2, :2], np.array([[10.0, 0.0]])
    B, D = np.array([[1.0], [0.0]]), np.zeros((1, 1))
    linear = LinearModel(A, B, C, D, x0[:, :2])
    excursion = Excursion.beside(linear, experiments)
    held = apart(*model, experiments, excursion.n_held, excursion.larger)
    assert np.all(held <= APART / 2)
    assert not escapes(*model, experiments)
    assert excursion.latches(*model) == excursion.leads(*model) == stays


def test_what_has_not_forgotten_larger_inputs_is_no_latch_of_a_slow_plant():
    """It is compared with its linear model, which has not either."""
    slow = LinearModel(*(np.full((1, 1), z) for z in (0.9999, 1e-1, 1.0, 0.0, 0.0)))
    u = np.linspace(0, 1, 300)[:, None] ** 2
    structure, theta, fit = slow.as_fit()
    assert away(structure, theta, fit.x0, [(u, u)]) > APART
    assert not Excursion.beside(slow, [(u, u)]).latches(structure, theta, fit.x0)


def test_what_diverges_stays_away(rng):
    model = point(np.array([[3.0]]), np.ones((1, 1)), np.ones((1, 1)))
    u = rng.standard_normal((300, 1))
    assert np.isinf(away(*model, np.zeros((1, 1)), [(u, u)]))


def test_a_linear_model_latches_nowhere(rng):
    model = point(np.diag([0.9, 0.5]), np.ones((2, 1)), np.ones((1, 2)))
    u = rng.standard_normal((300, 1))
    its = *model, np.ones((1, 2)), [(u, u)]
    assert not latches(*its, settling(np.diag([0.9, 0.5])))
    assert latches(*its, 2)  # it has not settled


def test_a_simulation_that_diverges_latches(rng):
    model = point(np.array([[3.0]]), np.ones((1, 1)), np.ones((1, 1)))
    u = rng.standard_normal((300, 1))
    assert latches(*model, np.zeros((1, 1)), [(u, u)], 1_000)


def test_experiments_are_held_as_one(rng):
    """The largest and the least input may lie in different experiments."""
    structure, theta = bistable(0.75)
    up, down = rng.uniform(0.5, 1, (200, 1)), -rng.uniform(0.5, 1, (200, 1))
    middle = 0.01 * rng.uniform(-1, 1, (600, 1))
    x0 = np.ones((3, 1))
    experiments = [(u, np.zeros((len(u), 1))) for u in (up, middle, down)]
    assert latches(structure, theta, x0, experiments, 50)
    assert not latches(structure, theta, x0[:2], experiments[:2], 50)


@pytest.mark.parametrize(
    ("gain", "expected"),
    # held, the second output of gain 1 would come to twice its record, 5 times; or not
    [(0.1, [[0.25, 0.5]]), (10.0, [[1.25, 1.25]])],
)
def test_no_held_input_takes_a_linear_model_far_from_its_record(gain, expected):
    """A slow plant answers little to the short peaks of its record."""
    structure, theta = point(np.array([[0.9]]), np.array([[0.1]]), np.ones((1, 1)))
    u = np.zeros((200, 1))
    u[100], u[150] = 10.0, -20.0
    u[:50] = 10.0 / 50  # the mean is zero
    y = gain * np.linspace(-1.0, 1.0, 200)[:, None] * 40.0
    larger = within_reach(structure, theta, [(u, y)], 1_000)
    np.testing.assert_allclose(larger, expected, rtol=1e-9)
    halves = [(u[:120], y[:120]), (u[120:], y[120:])]
    assert np.array_equal(within_reach(structure, theta, halves, 1_000), larger)


def test_what_only_an_unreachable_input_latches_is_no_latch(rng):
    """The same second place, with outputs of the record that are near or far."""
    structure, theta = bistable(0.75)
    x0, experiments = record_of(structure, theta, rng, 1.0)
    linear = LinearModel(*(np.full((1, 1), z) for z in (0.5, 1.0, 1.0, 0.0, 0.0)))
    assert Excursion.beside(linear, experiments).latches(structure, theta, x0)
    slow = LinearModel(*(np.full((1, 1), z) for z in (0.5, 500.0, 1.0, 0.0, 0.0)))
    assert not Excursion.beside(slow, experiments).latches(structure, theta, x0)

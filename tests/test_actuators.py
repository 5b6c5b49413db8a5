"""Plants that a law u = v - h(s) does not linearize, and the laws that do.

The oracles are the differential equations as the docstrings print them, integrated by
scipy at a tight tolerance, and equilibria and energies by hand.
"""

from dataclasses import replace
from functools import partial
from itertools import combinations_with_replacement

import numpy as np
import pytest
from scipy import integrate

from alssnn.datasets import (
    make_fan_arm,
    make_heat_exchanger,
    make_magnetic_levitation,
    make_two_input_arm,
    make_valve_tank,
)

make_regulated = partial(make_magnetic_levitation, regulated=True)
make_exchanger = partial(make_heat_exchanger, disturbance=False)
make_tank = partial(make_valve_tank, disturbance=False)

# -- the equations, written again ------------------------------------------------------


def fan_rates(t, x, u):
    return [x[1], 8 * u[0] ** 2 - 9.81 * np.sin(x[0]) - 2 * x[1]]


def levitation_rates(t, x, i):
    return [x[1], 9810 * (1 - (10 * i[0] / x[0]) ** 2)]


def inertia(q2):
    m12 = 1 / 3 + 3 / 8 * np.cos(q2)
    m11 = 11 / 12 + 3 / 4 * np.cos(q2)
    return np.array([[m11 + 0.05, m12], [m12, 1 / 3 + 0.05]])


def arm_rest(x):
    """Return the torques that are not those of inertia: Coriolis, dampers, springs."""
    q, w = x[:2], x[2:]
    turn = 3 / 8 * np.sin(q[1])
    coriolis = turn * np.array([-w[1] * (2 * w[0] + w[1]), w[0] ** 2])
    return coriolis, np.array([3.0, 0.8]) * w + np.array([20.0, 8.0]) * q


def arm_rates(t, x, tau):
    torque = tau - sum(arm_rest(x))
    return [*x[2:], *np.linalg.solve(inertia(x[1]), torque)]


def exchanger_rates(t, x, u):
    inlet = u[1] if len(u) == 2 else 80.0
    heat = 4 * (x[0] - x[1])
    return [(u[0] * (inlet - x[0]) - heat) / 120, (3 * (15 - x[1]) + heat) / 120]


def tank_rates(t, x, u):
    inflow = u[1] if len(u) == 2 else 0.09
    return [(0.6 * 50 ** (u[0] - 1) + inflow - 0.664 * np.sqrt(x[0])) / 50]


# -- the laws that make them linear in continuous time ---------------------------------


def fan_law(v, x):
    return np.sqrt(v + 9.81 / 8 * (np.sin(x[0]) - x[0]))


def levitation_law(v, x):
    # v is a gap: force linear in gap, speed and v, and i follows from the force
    force = 1 + 0.12 * (x[0] - v) + 0.007 * x[1]
    return x[0] / 10 * np.sqrt(force)


def arm_law(v, x):
    coriolis, rest = arm_rest(x)
    return inertia(x[1]) @ np.linalg.solve(inertia(1.0), v - rest) + coriolis + rest


def exchanger_law(v, x):
    return v / (80 - x[0])


def tank_law(v, x):
    # k sqrt(h) is replaced by its chord, 0.664 * 1.5 h, of levels around 0.4 m
    return 1 + np.log((v + 0.664 * (np.sqrt(x[0]) - 1.5 * x[0])) / 0.6) / np.log(50)


PLANTS = {
    "fan": (make_fan_arm, fan_rates, 1e-5),
    "levitation": (make_magnetic_levitation, levitation_rates, 1e-5),
    "arm": (make_two_input_arm, arm_rates, 1e-4),
    "exchanger": (make_exchanger, exchanger_rates, 1e-3),
    "exchanger, d": (make_heat_exchanger, exchanger_rates, 1e-3),
    "tank": (make_tank, tank_rates, 1e-5),
    "tank, d": (make_valve_tank, tank_rates, 1e-5),
}
# law, range of v, and how often better than any law u = v - h(s) it must be
LAWS = {
    "fan": (make_fan_arm, fan_law, (0.35, 0.8), 10),
    "levitation": (make_magnetic_levitation, levitation_law, (6.0, 14.0), 10),
    "arm": (make_two_input_arm, arm_law, (-9.0, 9.0), 5),
    "exchanger": (make_exchanger, exchanger_law, (25.0, 90.0), 10),
    "tank": (make_tank, tank_law, (0.1, 0.55), 10),
}
MAKERS = [plant[0] for plant in PLANTS.values()] + [make_regulated]
every_maker = pytest.mark.parametrize("make", MAKERS, ids=range(len(MAKERS)))


def states(record):
    """Return the states of a record, one more than it has samples."""
    X = [record.x0]
    for k, u in enumerate(record.u):
        X.append(record.plant.dynamics(k, X[-1], u))
    return np.array(X)


# -- records ---------------------------------------------------------------------------


@every_maker
def test_plant_reproduces_record(make):
    record = make(2_000, random_state=0)
    X = states(record)
    y = [
        record.plant.output(k, x, u)
        for k, (x, u) in enumerate(zip(X[:-1], record.u, strict=True))
    ]
    # an unstable plant, too: the map is the same to the last bit
    np.testing.assert_array_equal(y, record.y)
    assert record.plant.dt == record.dt
    assert record.plant.ninputs == record.u.shape[1]
    assert record.plant.noutputs == record.y.shape[1]
    assert len(record.x0) == record.plant.nstates


@every_maker
def test_noise_is_relative_to_every_output(make):
    clean = make(4_000, random_state=3)
    noisy = make(4_000, noise=0.1, random_state=3)
    np.testing.assert_array_equal(noisy.u, clean.u)
    np.testing.assert_array_equal(noisy.x0, clean.x0)
    e = noisy.y - clean.y
    np.testing.assert_allclose(e.std(axis=0), 0.1 * clean.y.std(axis=0), rtol=0.05)


@every_maker
def test_random_state_is_reproducible(make):
    first, again, other = (make(100, noise=0.1, random_state=s) for s in (5, 5, 6))
    np.testing.assert_array_equal(first.y, again.y)
    assert not np.allclose(first.y, other.y)
    clean, longer = make(100, random_state=5), make(150, random_state=5)
    np.testing.assert_array_equal(longer.u[:100], first.u)
    np.testing.assert_array_equal(longer.y[:100], clean.y)
    seeded = make(100, noise=0.1, random_state=np.random.RandomState(5))
    np.testing.assert_array_equal(seeded.y, first.y)
    assert len(replace(make(1, random_state=0), plant=None)) == 1


@pytest.mark.parametrize("make", [make_heat_exchanger, make_valve_tank])
def test_the_input_does_not_depend_on_the_disturbance(make):
    both, alone = (
        make(500, random_state=1),
        make(500, disturbance=False, random_state=1),
    )
    assert both.u.shape == (500, 2) and alone.u.shape == (500, 1)
    np.testing.assert_array_equal(both.u[:, :1], alone.u)
    # the disturbance changes less often
    moves = np.count_nonzero(np.diff(both.u, axis=0), axis=0)
    assert 0 < 2 * moves[1] < moves[0]


@pytest.mark.parametrize("name", PLANTS)
def test_plant_integrates_its_equation(name):
    make, rates, tolerance = PLANTS[name]
    record = make(40, random_state=0)
    scale = record.y.std()
    for k, x in enumerate(states(record)[:-1]):
        exact = integrate.solve_ivp(
            rates, (0, record.dt), x, args=(record.u[k],), rtol=1e-11, atol=1e-13
        ).y[:, -1]
        ahead = record.plant.dynamics(k, x, record.u[k])
        np.testing.assert_allclose(ahead, exact, rtol=0, atol=tolerance * scale)


def test_excitation_covers_its_range():
    record = make_fan_arm(5_000, command=(0.2, 0.9), hold=(0.1, 0.5), random_state=0)
    assert 0.2 <= record.u.min() < 0.22 and 0.88 < record.u.max() <= 0.9
    changes = np.diff(np.flatnonzero(np.diff(record.u[:, 0])))
    assert changes.min() >= 2 and changes.max() <= 10


# -- equilibria and energy -------------------------------------------------------------


def settle(record, u, n_samples=5_000):
    """Return the state where a constant input leads."""
    x = record.x0
    for k in range(n_samples):
        x = record.plant.dynamics(k, x, np.array(u))
    return x


def test_equilibria_by_hand():
    theta, omega = settle(make_fan_arm(2, random_state=0), [0.8])
    assert np.sin(theta) == pytest.approx(8 * 0.64 / 9.81) and abs(omega) < 1e-9
    assert settle(make_fan_arm(2, random_state=0), [-0.8]) == pytest.approx([0, 0])
    gap, speed = settle(make_regulated(2, random_state=0), [12.0])
    assert gap == pytest.approx(12.0) and abs(speed) < 1e-9
    q = settle(make_two_input_arm(2, random_state=0), [10.0, -4.0])
    np.testing.assert_allclose(q, [0.5, -0.5, 0, 0], atol=1e-9)
    (level,) = settle(make_valve_tank(2, random_state=0), [1.0, 0.05])
    assert level == pytest.approx((0.65 / 0.664) ** 2)
    hot, cold = settle(make_heat_exchanger(2, random_state=0), [6.0, 75.0])
    # what the hot stream loses the cold one takes
    assert 6 * (75 - hot) == pytest.approx(3 * (cold - 15))
    assert settle(make_exchanger(2, random_state=0), [-1.0]) == pytest.approx([15, 15])


def test_the_arm_loses_the_energy_of_its_dampers():
    record = make_two_input_arm(2, random_state=0)
    x = np.array([0.8, -1.2, 2.0, 1.0])

    def energy(x):
        w = x[2:]
        return w @ inertia(x[1]) @ w / 2 + np.sum([10, 4] * x[:2] ** 2)

    def with_loss(t, z):
        return [*arm_rates(t, z[:4], np.zeros(2)), np.sum([3.0, 0.8] * z[2:4] ** 2)]

    lost = integrate.solve_ivp(with_loss, (0, 0.5), [*x, 0.0], rtol=1e-10, atol=1e-12)
    start = energy(x)
    for k in range(50):
        x = record.plant.dynamics(k, x, np.zeros(2))
    assert start - energy(x) == pytest.approx(lost.y[4, -1], rel=1e-4)


# -- levitation ------------------------------------------------------------------------


def test_the_regulator_holds_the_ball():
    for seed in range(5):
        record = make_magnetic_levitation(5_000, random_state=seed)
        assert 4 < record.y.min() and record.y.max() < 16
        assert record.u.min() >= 0
        same = make_regulated(5_000, random_state=seed)
        np.testing.assert_array_equal(same.y, record.y)  # one plant, two inputs


def test_the_bare_ball_is_unstable():
    linear = make_magnetic_levitation(2).plant.linearize([10.0, 0.0], [1.0], eps=1e-6)
    poles = np.sort(np.linalg.eigvals(linear.A).real)
    expected = np.exp(np.sqrt(2 * 9810 / 10) * 0.002 * np.array([-1, 1]))
    np.testing.assert_allclose(poles, expected, rtol=1e-5)


@pytest.mark.parametrize(("current", "end"), [(1.05, 1.0), (5.0, 1.0), (0.5, 20.0)])
def test_a_lost_ball_stays_where_it_is(current, end):
    plant = make_magnetic_levitation(2, random_state=0).plant
    x = np.array([10.0, 0.0])
    for k in range(300):
        x = plant.dynamics(k, x, np.array([current]))
    np.testing.assert_array_equal(x, [end, 0.0])
    for other in (0.0, 10.0):  # no current brings it back
        back = plant.dynamics(0, x, np.array([other]))
        np.testing.assert_array_equal(back, x)


def test_an_infinite_current_is_a_crash_and_nan_stays_nan():
    plant = make_magnetic_levitation(2, random_state=0).plant
    crashed = plant.dynamics(0, np.array([10.0, 0.0]), np.array([1e6]))
    np.testing.assert_array_equal(crashed, [1.0, 0.0])
    assert np.isnan(plant.dynamics(0, np.array([np.nan, 0.0]), np.array([1.0]))).all()


# -- laws ------------------------------------------------------------------------------


def monomials(X, degree):
    X = (X - X.mean(axis=0)) / X.std(axis=0)
    powers = (
        np.prod(X[:, chosen], axis=1)
        for d in range(1, degree + 1)
        for chosen in map(list, combinations_with_replacement(range(X.shape[1]), d))
    )
    return np.column_stack([np.ones(len(X)), *powers])


def unexplained(ahead, *regressors):
    """Return std of the states ahead that a regression leaves, of shape (nx,)."""
    Z = np.column_stack(regressors)
    return (ahead - Z @ np.linalg.lstsq(Z, ahead, rcond=None)[0]).std(axis=0)


@pytest.mark.parametrize("name", LAWS)
def test_the_true_law_makes_it_linear_and_no_sum_does(name):
    make, law, (low, high), times = LAWS[name]
    record = make(3_000, random_state=0)
    # x+ = f(x) + B u with any f, linear where u = v - h(s) cancels all of it
    X = states(record)
    degree = 5 if X.shape[1] < 3 else 3
    alone = unexplained(X[1:], monomials(X[:-1], degree))
    summed = unexplained(X[1:], monomials(X[:-1], degree), record.u) / alone
    # the same levels and holds as those of the record, in the range of the law
    span = record.u.max(axis=0) - record.u.min(axis=0)
    steps = (record.u - record.u.min(axis=0)) / span
    if name == "levitation":  # its current is no stair-step, its reference is
        steps = (make_regulated(3_000, random_state=0).u - 6) / 8
    v = low + (high - low) * steps
    x, X = record.x0, [record.x0]
    for k, v_k in enumerate(v):
        x = record.plant.dynamics(k, x, np.atleast_1d(np.squeeze(law(v_k, x))))
        X.append(x)
    X = np.array(X)
    alone = unexplained(X[1:], monomials(X[:-1], degree))
    exact = unexplained(X[1:], monomials(X[:-1], 1), v) / alone
    assert np.all(summed > times * exact), (summed, exact)
    # what is left is that of a law that is held between two samples
    assert np.all(exact < 0.06), exact


# -- bad arguments ---------------------------------------------------------------------


@every_maker
@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"n_samples": 10.0}, TypeError, "`n_samples` must be an int, got 10.0"),
        ({"n_samples": 0}, ValueError, "`n_samples` must be at least 1, got 0"),
        ({"noise": "low"}, TypeError, "`noise` must be a number, got 'low'"),
        ({"noise": -0.1}, ValueError, "`noise` must be nonnegative and finite, got"),
        ({"hold": 1.0}, ValueError, "`hold` must be 2 finite numbers"),
        ({"hold": (300.0, 20.0)}, ValueError, "`hold` must be an increasing pair"),
        ({"hold": (0, 1)}, ValueError, "`hold` must be an increasing pair"),
    ],
)
def test_maker_errors(make, arguments, error, message):
    with pytest.raises(error, match=message):
        make(**arguments)


@pytest.mark.parametrize(
    ("make", "arguments", "error", "message"),
    [
        (make_fan_arm, {"gravity": "g"}, TypeError, "`gravity` must be a number"),
        (make_fan_arm, {"thrust": 0}, ValueError, "`thrust` must be positive"),
        (make_fan_arm, {"command": 1.0}, ValueError, "`command` must be 2 finite"),
        (make_fan_arm, {"command": (-1, 1)}, ValueError, "pair of at least 0.0"),
        (make_fan_arm, {"command": (1, 0.5)}, ValueError, "an increasing pair"),
        (make_fan_arm, {"thrust": 50.0}, ValueError, "must keep the arm below the top"),
        (make_two_input_arm, {"stiffness": 1}, ValueError, "`stiffness` must be 2"),
        (make_two_input_arm, {"damping": (1, 0)}, ValueError, "must be positive"),
        (make_two_input_arm, {"amplitude": (1e9, 1)}, ValueError, "keep the arm slow"),
        (make_two_input_arm, {"damping": (1e6, 1e6)}, ValueError, "keep the arm slow"),
        (make_magnetic_levitation, {"gap": (0.5, 9)}, ValueError, "lie within"),
        (make_magnetic_levitation, {"gap": (5, 25)}, ValueError, "lie within"),
        (make_magnetic_levitation, {"travel": (9, 5)}, ValueError, "`travel` must be"),
        (make_magnetic_levitation, {"gap": (1.1, 19.9)}, ValueError, "off the ends"),
        (make_heat_exchanger, {"flow": (-1, 5)}, ValueError, "`flow` must be an incr"),
        (make_heat_exchanger, {"flow": (1, 1e4)}, ValueError, "small for a sampling"),
        (make_valve_tank, {"rangeability": 1}, ValueError, "must exceed 1, got 1"),
        (make_valve_tank, {"lift": (0.5, 1.5)}, ValueError, "`lift` must not exceed 1"),
        (make_valve_tank, {"lift": (0.99, 1.0)}, ValueError, "the level below 1.0 m"),
        (make_valve_tank, {"lift": (np.nan, 1)}, ValueError, "`lift` must be 2 finite"),
    ],
)
def test_plant_errors(make, arguments, error, message):
    with pytest.raises(error, match=message):
        make(1_000, random_state=0, **arguments)

"""Predictive control through a map v = phi(u, s) that is no sum: limits of u hold."""

import numpy as np
import pytest
from scipy.optimize import minimize
from structures import declare

from alssnn.datasets import make_two_input_arm
from alssnn.feedback import DisturbanceObserver, Observer
from alssnn.mpc import LinearizingMPC, _inputs
from helpers import plant_of_structure
from models import fl_ssnn

HALF, RATE = 0.7, 0.2
LIMITS = {
    "u": {"half": HALF},
    "rate": {"rate": RATE},
    "both": {"half": HALF, "rate": RATE},
}
CASES = [
    ("monotone", "u"),
    ("monotone", "rate"),
    ("monotone", "both"),
    ("monotone-state", "rate"),
    ("monotone-state", "both"),
]


def plant_of(name, seed, size=1.0, residual=0.0):
    """Return a random plant; `size` makes its map steep."""
    rng = np.random.default_rng(seed)
    structure = declare(name, rng)
    p = {k: 0.4 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    p["A"] *= 0.7 / np.abs(np.linalg.eigvals(p["A"])).max()
    for weights in ("U_phi", "r_phi", "V_phi"):
        p[weights] *= size
    if "W_g" in p:
        p["W_g"] *= residual
    return plant_of_structure(structure, structure.join(p), rng, 0), rng


def limits_of(plant, half=None, rate=None):
    """Return options: u within `half` of the operating point, at most at `rate`."""
    u_e, given = plant.u_offset, {} if rate is None else {"du_max": rate}
    return (
        given if half is None else {"u_min": u_e - half, "u_max": u_e + half, **given}
    )


def true_cost(mpc, plant, x0):
    """Return the cost of inputs on the plant itself, of the target of a controller."""
    model, x_s, v_s = mpc._model, mpc._rest.X[0], mpc._rest.V[0]
    Q = [model.C.T @ model.C] * (mpc.horizon - 1) + [mpc.P]

    def cost(U):
        x, total = x0, 0.0
        for u, weight in zip(U.reshape(mpc.horizon, -1), Q, strict=True):
            v = (plant.virtual(x, u) - plant.u_offset) / plant.u_scale
            x = plant.step(x, u)
            total += (x - x_s) @ weight @ (x - x_s) + 0.1 * (v - v_s) @ (v - v_s)
        return total / 2

    return cost


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name, limits", CASES)
def test_passes_converge_to_the_solution_of_the_nonlinear_program(name, limits, seed):
    plant, rng = plant_of(name, seed)
    options, n = limits_of(plant, **LIMITS[limits]), 5
    mpc = LinearizingMPC(
        plant, n, observer=Observer(plant), n_passes=30, tol=1e-8, **options
    )
    x0 = 0.7 * rng.standard_normal(plant.nx)
    mpc.reset(x0)
    mpc.step(plant.y_offset + rng.standard_normal(plant.ny), plant.output(x0))
    assert not mpc.info_.fallback
    cost, plan = true_cost(mpc, plant, x0), mpc.info_.u_plan.ravel()
    difference = np.eye(plan.size) - np.eye(plan.size, k=-plant.nu)
    rate, last = options.get("du_max", np.inf), np.zeros(plan.size)
    last[: plant.nu] = plant.u_offset
    slack = [
        {
            "type": "ineq",
            "fun": lambda U, s=sign: rate + s * (difference @ U - last),
            "jac": lambda U, s=sign: s * difference,
        }
        for sign in (1, -1)
        if np.isfinite(rate)
    ]
    half = LIMITS[limits].get("half", np.inf)
    at = np.tile(plant.u_offset, n)
    moves = np.abs(difference @ plan - last)
    met = (np.abs(plan - at) > half - 1e-6) | (moves > rate - 1e-6)
    assert met.any()  # the limits matter here
    best = minimize(
        cost,
        plan,
        method="SLSQP",
        bounds=list(zip(at - half, at + half, strict=True)),
        constraints=slack,
        options={"maxiter": 500, "ftol": 1e-13},
    )
    assert cost(plan) <= best.fun * (1 + 2e-3) + 1e-8
    np.testing.assert_allclose(mpc.info_.u_plan[0], best.x[: plant.nu], atol=2e-3)


@pytest.mark.parametrize("size", [0.3, 1.0, 5.0])
@pytest.mark.parametrize("name, limits", CASES)
def test_limits_hold_whatever_the_map(name, limits, size):
    """References far out of reach, inputs that others moved, and a model that errs."""
    plant, rng = plant_of(name, 3, size, residual=0.3)
    half, rate = LIMITS[limits].get("half"), LIMITS[limits].get("rate", np.inf)
    mpc = LinearizingMPC(plant, 8, **limits_of(plant, half, rate))
    half, n_fallbacks = half or np.inf, 0
    x, last = rng.standard_normal(plant.nx), plant.u_offset + 1.5
    mpc.reset(u=last)
    for k in range(60):
        if k % 10 == 0:
            far = rng.choice([1.0, 30.0])
            reference = plant.y_offset + far * rng.standard_normal(plant.ny)
        moved = None
        if k % 13 == 12:
            moved = last = plant.u_offset + rng.uniform(-2, 2, plant.nu)
        u = mpc.step(reference, plant.output(x), moved)
        info = mpc.info_
        forced = np.abs(
            last - np.clip(last, plant.u_offset - half, plant.u_offset + half)
        )
        assert np.all(np.abs(u - plant.u_offset) <= half * (1 + 1e-12))
        assert np.all(np.abs(u - last) <= np.maximum(rate, forced) * (1 + 1e-9))
        plan = info.u_plan
        assert np.all(np.abs(plan - plant.u_offset) <= half * (1 + 1e-12))
        assert np.all(np.abs(np.diff(plan, axis=0)) <= rate * (1 + 1e-9))
        np.testing.assert_array_equal(plan[0], u)  # what is sent is what is planned
        s = info.x_hat if plant.feedback == "state" else plant.output(info.x_hat)
        np.testing.assert_allclose(info.v, u + plant.cancelled(s, u), atol=1e-9)
        n_fallbacks += info.fallback
        x, last = plant.step(x, u), u
    assert n_fallbacks == 0


def test_limits_that_exclude_the_operating_point():
    plant, _ = plant_of("monotone", 0)
    low, high = plant.u_offset + 0.3, plant.u_offset + 0.9
    mpc = LinearizingMPC(plant, u_min=low, u_max=high, du_max=0.05)
    record = mpc.simulate(plant, np.tile(plant.y_offset - 2.0, (40, 1)))
    assert record.n_fallbacks == 0
    assert np.all((record.u >= low) & (record.u <= high))
    assert np.all(np.abs(np.diff(record.u, axis=0)) <= 0.05 * (1 + 1e-9))


def test_a_plan_that_no_solver_improves_keeps_the_rates():
    plant, rng = plant_of("monotone", 1)
    mpc = LinearizingMPC(plant, 8, **limits_of(plant, HALF, RATE))
    reference = plant.y_offset + rng.standard_normal(plant.ny)
    mpc.step(reference, plant.y_offset)
    mpc._planner.program.qp.settings["max_iter"] = 1
    mpc._planner.program.qp.reset()
    moved = plant.u_offset - 0.6
    u = mpc.step(reference, plant.y_offset, u_applied=moved)
    assert mpc.info_.fallback and "maximum iterations" in mpc.info_.status
    assert np.all(np.abs(u - moved) <= RATE * (1 + 1e-9))


def test_where_newtons_method_is_lost_the_law_is_asked(monkeypatch):
    plant, rng = plant_of("monotone", 2)
    reference = plant.y_offset + np.repeat(
        rng.standard_normal((3, plant.ny)), 5, axis=0
    )
    mpc = LinearizingMPC(plant, **limits_of(plant, HALF, RATE))
    quick = mpc.simulate(plant, reference)
    monkeypatch.setattr(_inputs, "MAX_ITER", 0)
    np.testing.assert_allclose(mpc.simulate(plant, reference).u, quick.u, atol=1e-8)


def test_inputs_that_are_not_found_stay_as_they_were(monkeypatch):
    plant, rng = plant_of("monotone", 2)
    mpc = LinearizingMPC(plant, **limits_of(plant, HALF))
    reference = plant.y_offset + rng.standard_normal(plant.ny)
    mpc.step(reference, plant.y_offset)
    plan = mpc.info_.u_plan
    lost = np.full((mpc.horizon, plant.nu), np.nan)
    monkeypatch.setattr(_inputs.Mapped, "u", lambda self, V, X: lost)
    u = mpc.step(reference, plant.y_offset)
    assert mpc.info_.fallback and mpc.info_.status == "no u found for v"
    np.testing.assert_array_equal(u, plan[1])
    lost[0] = plant.u_offset  # found now, but not those of later samples
    mpc.step(reference, plant.y_offset)
    assert not mpc.info_.fallback
    np.testing.assert_array_equal(mpc.info_.u_plan[1:-2], plan[3:])


@pytest.mark.filterwarnings("ignore:.*stopped after")
def test_an_arm_is_held_at_its_limits():
    record = make_two_input_arm(1500, noise=0.01, random_state=0)
    model = fl_ssnn(
        nx=4,
        n_h=6,
        feedback="state",
        input_map="monotone",
        max_iter=40,
        tol=1e-3,
        dt=record.dt,
        random_state=0,
    ).fit(record.u, record.y)
    high, rate = 0.6 * np.abs(record.u).max(axis=0), np.array([2.0, np.inf])
    mpc = LinearizingMPC(
        model,
        u_min=-high,
        u_max=high,
        du_max=rate,
        observer=DisturbanceObserver(model, gate=100),
    )
    size = record.y.std(axis=0)
    levels = np.random.default_rng(0).uniform(-1.5, 1.5, (6, 2))
    reference = size * np.repeat(levels, 25, axis=0)
    loop = mpc.simulate(record.plant, reference)
    assert loop.n_fallbacks == 0
    assert np.all(np.abs(loop.u) <= high)
    assert np.abs(np.diff(loop.u[:, 0])).max() <= rate[0] * (1 + 1e-12)
    assert loop.saturated.mean() > 0.1  # the limits matter here
    assert np.abs(loop.cut / record.u.std(axis=0)).max() < 0.05

"""Predictive control knows measured disturbances, now and ahead."""

from dataclasses import replace

import numpy as np
import pytest
from test_disturbances_exported import make_plant

from alssnn.mpc import LinearizingMPC

N = 60


def steps(plant, n=N):
    """Return disturbances that step."""
    rng = np.random.default_rng(1)
    levels = 0.2 * rng.uniform(-1, 1, (n // 30, plant.nd))
    return plant.d_offset + np.repeat(levels, 30, axis=0)


PLANTS = [
    (input_map, feedback, given)
    for input_map in ("identity", "monotone")
    for feedback in ("output", "state")
    for given in ((0, 2), (1,))
]


@pytest.fixture(params=PLANTS, ids=str, scope="module")
def plant(request):
    return make_plant(*request.param, n_g=0)


def run(plant, d, **options):
    settings = {
        k: options.pop(k) for k in ("du_max", "u_min", "u_max", "R") if k in options
    }
    mpc = LinearizingMPC(plant, horizon=12, **settings)
    reference = np.tile(plant.y_offset + 0.2, (len(d), 1))
    return mpc.simulate(plant, reference, d=d, **options)


def test_the_output_comes_back_when_disturbances_move(plant):
    record = run(plant, steps(plant), preview=True)
    assert record.u.shape == (N, plant.nv)
    np.testing.assert_array_equal(record.d, steps(plant))
    assert np.abs(record.y - record.reference)[-3:].max() < 1e-3


@pytest.mark.parametrize("given", [(0, 2), (1,)])
def test_a_preview_pays(given):
    plant = make_plant("identity", "state", given, n_g=0)
    d = steps(plant, 120)
    # actuators too slow for a step of d that nobody has announced; y alone counts
    options = {"du_max": 0.03 * plant.v_scale, "R": 1e-5 * np.eye(plant.nv)}
    errors = []
    for preview in (True, False):
        record = run(plant, d, preview=preview, **options)
        errors.append(np.sqrt(np.mean((record.y - record.reference)[45:] ** 2)))
    assert errors[0] < 0.7 * errors[1]


def test_limits_hold_whatever_the_disturbances(plant):
    limit = 0.4 * plant.v_scale
    limits = {
        "u_min": plant.v_offset - 2 * limit,
        "u_max": plant.v_offset + 2 * limit,
        "du_max": limit,
    }
    record = run(plant, steps(plant), preview=True, **limits)
    assert np.all((record.u >= limits["u_min"]) & (record.u <= limits["u_max"]))
    change = np.diff(record.u, axis=0, prepend=plant.v_offset[None])
    assert np.all(np.abs(change) <= limit * (1 + 1e-9))
    assert record.n_fallbacks <= 3


def test_at_rest_disturbances_are_those_of_the_record(plant):
    record = run(plant, None or np.tile(plant.d_offset, (40, 1)))
    reference = np.tile(plant.y_offset + 0.2, (40, 1))
    mpc = LinearizingMPC(plant, horizon=12)
    again = mpc.simulate(plant, reference)
    np.testing.assert_array_equal(again.u, record.u)
    np.testing.assert_array_equal(again.d, np.tile(plant.d_offset, (40, 1)))


def test_a_step_needs_them_and_keeps_the_last_ones(plant):
    mpc = LinearizingMPC(plant, horizon=12)
    y = plant.y_offset
    with pytest.raises(ValueError, match=r"`d` must have the .* measured disturbances"):
        mpc.step(y, y)
    with pytest.raises(ValueError, match=r"`d` must have shape"):
        mpc.step(y, y, d=np.zeros((3, plant.nd)))
    moved = plant.d_offset + 0.3
    found = []
    for second in (moved, np.full(plant.nd, np.nan)):
        mpc.reset()
        mpc.step(y, y, d=moved)
        found.append(mpc.step(y, y, d=second))
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("preview", [True, False])
def test_what_enters_with_u_is_fed_forward_at_once(preview):
    """A disturbance of the same place as u, two standard deviations large."""
    plant = make_plant("identity", "state", (0, 2), n_g=0)
    B, G = plant.linear()[1], plant.disturbed_by()[0]
    Theta = plant.form.Theta.copy()  # with G in the range of B
    Theta[: plant.nx, plant.nx + np.array([0, 2])] += B @ [[0.7, -0.4]] - G
    form = type(plant.form)(Theta, plant.nx, plant.nu, plant.form.nw, plant.form.sigma)
    plant = replace(plant, form=form)
    d = np.tile(plant.d_offset, (40, 1))
    d[20:] += 2.0
    mpc = LinearizingMPC(plant, horizon=8)
    record = mpc.simulate(plant, np.tile(plant.y_offset, (40, 1)), d=d, preview=preview)
    assert np.abs(record.y - record.reference)[15:].max() < 1e-4

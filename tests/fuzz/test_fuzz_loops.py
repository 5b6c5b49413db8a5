"""Loops with sensors that fail: limits hold, and inputs are numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import alssnn
from alssnn.datasets import make_pendulum
from alssnn.feedback import Observer, lqr
from fuzzing import SCALE, cases, only_warnings_for_users

LIMIT = 6.0
HOSTILE = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e200, 1e12, -1e6, 0.0, 0.3]


@pytest.fixture(scope="module")
def pendulum():
    """Return the true plant, and a model that was fitted on its record."""
    record = make_pendulum(1_500, amplitude=5.0, noise=0.01, random_state=0)
    model = alssnn.FlSsnn(
        nx=2,
        n_h=4,
        alpha=0.0,
        n_init=1,
        max_iter=40,
        tol=1e-3,
        dt=record.dt,
        random_state=0,
    )
    with only_warnings_for_users():
        model.fit(record.u, record.y)
    return record.plant, model, float(np.std(record.y))


class Sensor:
    """Measure with noise, dropouts, and spikes of any size."""

    def __init__(self, rng, spikes):
        self.rng, self.spikes = rng, spikes

    def __call__(self, y):
        kind = self.rng.random()
        if kind < 0.05:
            return np.full_like(y, self.rng.choice([np.nan, np.inf, -np.inf]))
        if kind < 0.06:
            return y + self.rng.choice(self.spikes)
        return y + 0.01 * self.rng.normal(size=y.shape)


def run(plant, control, n, sensor, y_std, *, dropped_references=True):
    """Return the inputs and the errors of n steps on the true plant."""
    rng, x, u = sensor.rng, np.zeros(plant.nstates), np.zeros(1)
    inputs, errors, reference = np.zeros(n), np.zeros(n), 0.0
    for k in range(n):
        if k % 100 == 0:
            reference = rng.uniform(-1, 1) * y_std
        y = plant.output(k * plant.dt, x, u)
        lost = dropped_references and k % 100 and rng.random() < 0.02
        u = control(np.nan if lost else reference, sensor(np.asarray(y)))
        inputs[k], errors[k] = u[0], y[0] - reference
        push = 0.5 * (k // 200 % 2)  # a step behind the actuator
        x = np.asarray(plant.dynamics(k * plant.dt, x, u + push))
    assert np.isfinite(inputs).all()
    assert np.abs(inputs).max() <= LIMIT
    return inputs, errors


def settled(errors):
    """Return the root mean square error late after each new reference."""
    late = np.concatenate([e[60:] for e in errors.reshape(-1, 100)])
    return np.sqrt(np.mean(late**2))


def test_predictive_control_with_a_bad_sensor(pendulum):
    plant, model, y_std = pendulum
    n = 100 * round(6 * SCALE)

    def looped(spikes):
        mpc = model.mpc(u_min=-LIMIT, u_max=LIMIT)
        sensor = Sensor(np.random.default_rng(1), spikes)
        return run(plant, mpc.step, n, sensor, y_std)

    inputs, errors = looped([1e12, -1e12, 1e3, 1e300])
    assert np.abs(inputs).max() == LIMIT  # saturation is part of it
    assert settled(looped([0.0])[1]) < 0.01 * y_std
    assert settled(errors) < 0.1 * y_std


def test_observer_and_law_with_a_bad_sensor(pendulum):
    plant, model, y_std = pendulum
    law = model.linearizing_law(u_min=-LIMIT, u_max=LIMIT)
    K = lqr(model, np.eye(2), 0.1 * np.eye(1))
    A, B, C = model.A_, model.B_, model.C_
    gain = np.linalg.inv(C @ np.linalg.solve(np.eye(2) - A + B @ K, B))
    n = 100 * round(12 * SCALE)

    def looped(spikes, gate):
        observer = Observer(model, gate=gate)
        held = {"u": np.zeros(1), "r": 0.0}

        def control(r, y):
            held["r"] = r if np.isfinite(r) else held["r"]
            x_hat = observer.step(held["u"], y)
            v = model.u_offset_ + gain[0] * (held["r"] - model.y_offset_) - K @ x_hat
            held["u"] = law(v, x_hat)
            return held["u"]

        sensor = Sensor(np.random.default_rng(2), spikes)
        return settled(run(plant, control, n, sensor, y_std)[1])

    quiet = looped([0.0], None)
    assert looped([0.0], 10.0) <= 1.01 * quiet  # the gate costs nothing
    assert looped([1e12, -1e12, 1e3, 1e300], 10.0) < 1.5 * quiet
    looped([1e12, -1e12], None)  # useless, but within the limits


@cases(20)
@given(data=st.data())
def test_any_measurement_at_any_time(pendulum, data):
    model = pendulum[1]
    low = data.draw(st.sampled_from([-0.5, -LIMIT, -np.inf]))
    options = {
        "horizon": data.draw(st.integers(1, 8)),
        "u_min": low,
        "u_max": LIMIT,
        "du_max": data.draw(st.sampled_from([None, 0.1])),
        "y_max": data.draw(st.sampled_from([None, 0.2])),
        "n_passes": data.draw(st.integers(1, 2)),
    }
    if data.draw(st.booleans()):
        options["observer"] = Observer(model, kind=data.draw(KINDS))
    mpc, values = model.mpc(**options), st.sampled_from(HOSTILE)
    for _ in range(8):
        u = mpc.step(data.draw(values), data.draw(values))
        assert np.isfinite(u).all()
        assert np.all((low <= u) & (u <= LIMIT))
    for _ in range(3):
        assert np.isfinite(mpc.step(0.0, 0.0)).all()


KINDS = st.sampled_from(["kalman", "ekf"])


@cases(10)
@given(
    st.lists(st.sampled_from(HOSTILE), min_size=5, max_size=20),
    KINDS,
    st.sampled_from([None, 5.0]),
)
def test_estimates_are_numbers(pendulum, measured, kind, gate):
    model = pendulum[1]
    observer = Observer(model, kind=kind, gate=gate)
    for y in measured:
        assert np.isfinite(observer.step([0.1], [y])).all()
    y = np.array([measured[0], *measured])
    assert np.isfinite(observer.filter(np.zeros((len(y), 1)), y)).all()


def test_references_that_are_no_numbers_hold_the_last(pendulum):
    model = pendulum[1]
    one, other = (model.mpc(horizon=3) for _ in range(2))
    given_ = [0.2, np.nan, np.inf, [[0.1], [np.nan], [0.3]], -0.1, np.nan]
    meant = [0.2, 0.2, 0.2, [[0.1], [0.1], [0.3]], -0.1, -0.1]
    for r, same in zip(given_, meant, strict=True):
        np.testing.assert_array_equal(one.step(r, 0.05), other.step(same, 0.05))
    start = model.mpc(horizon=3)
    start.step(np.nan, 0.05)
    assert start.info_.target_error == pytest.approx(0.0, abs=1e-3)


def test_a_law_refuses_what_is_no_number(pendulum):
    law = pendulum[1].linearizing_law(u_min=-1, u_max=1)
    for v, s, name in ((np.nan, 0.0, "v"), (np.inf, 0.0, "v"), (0.0, np.nan, "s")):
        with pytest.raises(ValueError, match=f"`{name}` must be finite"):
            law([v], [s, 0.0])
    with pytest.raises(ValueError, match="`v` must be real numbers"):
        law(["0.1"], [0.0, 0.0])
    block = law.to_nlsys()
    for bad in ([np.nan, 0, 0], [np.inf, 0, 0], [0.1, np.nan, np.inf]):
        u = block.output(0.0, [], np.array(bad, dtype=float))
        assert np.all(np.abs(u) <= 1)


@pytest.mark.parametrize("gate", [0, -1.0, np.nan, np.inf, "10", True])
def test_gates_are_positive(pendulum, gate):
    with pytest.raises(ValueError, match="`gate` must be a positive number"):
        Observer(pendulum[1], gate=gate)


def test_a_gate_is_written_for_all(pendulum, tmp_path):
    observer = Observer(pendulum[1], gate=5.0)
    pendulum[1].to_c(tmp_path, observer=observer)
    pendulum[1].to_mat(tmp_path / "model.mat", observer=observer)

"""Initial states of fresh records: where the training was, unless data say else."""

import numpy as np
import pytest

from alssnn import FlSsnn, LinearStateSpace
from alssnn.datasets import make_pendulum
from alssnn.estimators import _simulation
from alssnn.initial_states import Prior, estimate_x0
from alssnn.models import state_space
from alssnn.region import Region
from alssnn.simulation import simulate
from helpers import simulate_linear

A, B, C = np.array([[0.95, 0.1], [0.0, 0.6]]), np.ones((2, 1)), np.array([[1.0, 0.5]])
WIDE, FLAT = np.diag([0.7, 0.2]), np.array([[0.5, 0.0], [0.5, 0.0]])


def linear():
    """Return a linear structure and its parameters."""
    structure = state_space(2, 1, 1)
    return structure, structure.join({"A": A, "B": B, "C": C})


@pytest.mark.parametrize("root", [np.eye(2), WIDE, FLAT])
@pytest.mark.parametrize("noise", [1e-4, 0.3])
def test_the_estimate_has_the_largest_posterior(rng, root, noise):
    """Beside its closed form; what a singular covariance excludes stays excluded."""
    window, mean = 30, np.array([2.0, -1.0])
    u, y = rng.standard_normal((80, 1)), rng.standard_normal((80, 1))
    prior = Prior(mean, root)
    options = {"window": window, "noise": noise, "prior": prior}
    (x0,) = estimate_x0(*linear(), [(u, y)], **options)
    free = [simulate_linear(A, B, C, 0 * u, e)[:window] for e in np.eye(2)]
    J = np.hstack(free) @ root
    left = (y - simulate_linear(A, B, C, u, mean))[:window, 0]
    z = np.linalg.solve(J.T @ J + noise * np.eye(2), J.T @ left)
    np.testing.assert_allclose(x0, mean + root @ z, rtol=1e-5, atol=1e-6)


def test_the_usual_prior_is_that_of_unit_variances(rng):
    u, y = rng.standard_normal((60, 1)), rng.standard_normal((60, 1))
    options = {"window": 20, "noise": 0.1}
    (x0,) = estimate_x0(*linear(), [(u, y)], **options)
    unit = Prior(np.zeros(2), np.eye(2))
    (same,) = estimate_x0(*linear(), [(u, y)], prior=unit, **options)
    np.testing.assert_array_equal(x0, same)


def test_without_samples_an_experiment_begins_at_rest(rng):
    u, y = rng.standard_normal((60, 1)), rng.standard_normal((60, 1))
    prior = Prior(np.array([2.0, -1.0]), WIDE)
    (x0,) = estimate_x0(*linear(), [(u, y)], window=0, noise=0.1, prior=prior)
    np.testing.assert_array_equal(x0, [0.0, 0.0])


def test_a_prior_has_the_mean_and_covariance_of_states(rng):
    X = rng.standard_normal((500, 2)) @ [[1.0, 0.5], [0.0, 0.2]] + [3.0, -1.0]
    prior = Prior.of_states(X)
    np.testing.assert_allclose(prior.mean, X.mean(axis=0))
    np.testing.assert_allclose(prior.root @ prior.root.T, np.cov(X.T, bias=True))
    u = rng.standard_normal((500, 1))
    along = Prior.along(*linear(), np.zeros((1, 2)), [(u, u)])
    structure, theta = linear()
    X = simulate(structure.lure(theta), u, np.zeros(2))[:-1]
    np.testing.assert_allclose(along.root @ along.root.T, np.cov(X.T, bias=True))
    growing = structure.join({"A": 3 * A, "B": B, "C": C})
    assert Prior.along(structure, growing, np.ones((1, 2)), [(u, u)]) is None


def test_a_prior_of_a_long_record_takes_no_memory():
    prior = Prior.of_states(np.resize([0.0, 1.0, 2.0, 3.0], (200_000, 2)))
    assert prior.root.shape == (2, 2)


def test_a_model_expects_the_states_of_its_training():
    record = make_pendulum(600, noise=0.01, random_state=0)
    model = LinearStateSpace(nx=2, dt=record.dt).fit(record.u, record.y)
    prior = _simulation.expected_states(model)
    (rec,) = model.prepare_records(record.u, record.y)
    X = simulate(model.plant_.lure, rec.du, rec.x0)[:-1]
    np.testing.assert_allclose(prior.mean, X.mean(axis=0), atol=0.05)
    np.testing.assert_allclose(prior.root @ prior.root.T, np.cov(X.T), atol=0.01)
    model._region = None  # as of old files
    assert _simulation.expected_states(model) is None
    assert np.isfinite(model.score(record.u, record.y))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_fresh_record_begins_where_the_training_was(monkeypatch, seed):
    """Deviations from zero are far from zero: a slow and a fast state in noise."""
    rng, poles, noise = np.random.default_rng(seed), np.array([0.98, 0.7]), 0.3

    def run(n):
        u = 5 + np.repeat(rng.uniform(-1, 1, n // 10), 10)
        x, y = np.array([5.0, 5.0]), np.empty(n)
        for k in range(n):
            y[k] = x.sum()
            x = poles * x + (1 - poles) * u[k]
        return u[:, None], y, y + noise * rng.standard_normal(n)

    u, _, y = run(1_000)
    model = LinearStateSpace(nx=2, operating_point="zero").fit(u, y)
    fresh = run(2_000)
    pieces = [[z[i : i + 40] for z in fresh] for i in range(0, 2_000, 40)]

    def error():
        missed = []
        for u, true, measured in pieces:
            y_hat = model.simulate_test(u, measured)[1]
            missed.append(y_hat - true[-len(y_hat) :])
        return np.sqrt(np.mean(np.square(missed)))

    its = error()
    monkeypatch.setattr(_simulation, "expected_states", lambda model: None)
    assert its < noise / 3 and error() > 5 * its


@pytest.mark.parametrize("noise", ["output", "innovations"])
@pytest.mark.parametrize("cls", [LinearStateSpace, FlSsnn])
def test_a_fit_begins_where_something_was_measured(cls, noise):
    """States that have decayed by then may be anything, and were 1e22."""
    record, gap = make_pendulum(1_000, noise=0.01, random_state=0), 300
    y = record.y.copy()
    y[:gap] = np.nan
    small = {"n_h": 4, "n_init": 1, "alpha": 1e-4, "random_state": 0}
    own = small if cls is FlSsnn else {}
    model = cls(nx=4, noise=noise, dt=record.dt, **own)
    model.fit([record.u, record.u[gap:]], [y, record.y[gap:]])
    low, high = model._region.seen
    size = np.abs(record.y).max()
    assert low[-1] > -2 * size and high[-1] < 2 * size
    assert np.abs(model.x0_).max() < 10
    ends = model.predict([record.u, record.u[gap:]], x0="training")
    for y_hat in (ends[0][gap:], ends[1]):
        assert np.std(y_hat[:, 0] - record.y[gap:, 0]) < 0.3 * np.std(record.y)
    scored = model.prepare_records(record.u, y)[0]
    assert scored.start == gap + model.n_init_samples
    assert model.score(record.u, y) > 0.9


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("initial_state", ["estimate", "rest"])
@pytest.mark.parametrize("noise", ["output", "innovations"])
def test_what_was_never_measured_begins_anywhere(noise, initial_state):
    """Nothing is told of it: its state is zero, and no part of the region."""
    record = make_pendulum(900, noise=0.01, random_state=0)
    y = record.y.copy()
    y[:350] = np.nan  # all of the first of three experiments, a part of the second
    label = np.repeat([0, 1, 2], 300)
    model = LinearStateSpace(
        nx=3, noise=noise, initial_state=initial_state, dt=record.dt
    ).fit(record.u, y, label)
    np.testing.assert_array_equal(model.x0_[0], 0.0)
    assert np.abs(model.x0_).max() < 10 and np.abs(model._region.seen[0]).max() < 10
    if initial_state == "rest":
        np.testing.assert_array_equal(model.x0_, 0.0)


@pytest.mark.parametrize("hold", ["zoh", "linear"])
def test_a_gap_at_the_beginning_in_continuous_time(hold):
    record = make_pendulum(400, noise=0.01, random_state=0)
    y = record.y.copy()
    y[:80] = np.nan
    model = LinearStateSpace(nx=2, time="continuous", hold=hold, dt=record.dt)
    assert model.fit(record.u, y).score(record.u, y) > 0.9


# the model is linear, and the plant is not
@pytest.mark.filterwarnings("ignore:The confidence bands are wider")
@pytest.mark.filterwarnings("ignore:No confidence band holds")
@pytest.mark.filterwarnings("ignore:The models that are drawn are no sample")
@pytest.mark.parametrize(
    "options", [{}, {"noise": "innovations"}, {"time": "continuous"}]
)
def test_a_covariance_is_that_of_what_was_measured(options):
    record, late = make_pendulum(500, noise=0.01, random_state=0), 200
    y = record.y.copy()
    y[:late] = np.nan
    model = LinearStateSpace(nx=2, dt=record.dt, **options).fit(record.u, y)
    whole = model.parameter_covariance(record.u, y)
    cut = model.parameter_covariance(record.u[late:], y[late:])
    std = [np.sqrt(np.diag(c.covariance) - c.bias**2) for c in (whole, cut)]
    np.testing.assert_allclose(*std, rtol=0.05)
    data = {"data": (record.u, y), "random_state": 0}
    (drawn,) = model.sample_models(whole, 1, **data)
    assert drawn.score(record.u, y) == pytest.approx(model.score(record.u, y), abs=0.01)


def test_an_estimate_begins_where_something_was_measured():
    record = make_pendulum(500, noise=0.01, random_state=0)
    y = record.y.copy()
    y[:80] = np.nan
    model = LinearStateSpace(nx=2, dt=record.dt).fit(record.u, record.y)
    x0 = model.estimate_x0(record.u, y)
    np.testing.assert_allclose(x0, model.prepare_records(record.u, y)[0].x0[None])
    assert np.std(model.predict(record.u, x0=x0)[80:] - record.y[80:]) < 0.2


def test_states_that_nearly_agree_are_estimated(rng):
    """Two of four states are noise of 1e-6: a covariance must not lose the others."""
    A = 0.995 * np.array([[np.cos(0.05), np.sin(0.05)], [-np.sin(0.05), np.cos(0.05)]])
    records = []
    for x0 in ([1.0, 1.0], [3.0, -2.0]):
        u = np.repeat(rng.standard_normal((60, 1)), 5, axis=0)
        y = simulate_linear(A, np.array([[0.1], [0.05]]), np.eye(2)[:1], u, x0)
        records.append((u, y + 1e-6 * rng.standard_normal(y.shape)))
    for nx in (3, 4, 5):
        model = LinearStateSpace(nx=nx).fit(*records[0])
        assert 1 - model.score(*records[1]) < 1e-8 and 1 - model.train_score_ < 1e-8


def test_states_that_never_moved_may_yet_begin_elsewhere():
    """They have a hundredth of the usual deviation, so that a record may say so."""
    X = np.outer(np.sin(np.arange(500.0)), [1.0, 2.0])
    prior = Prior.of_states(X)
    P, along, across = prior.root @ prior.root.T, [1.0, 2.0], [2.0, -1.0]
    assert along @ P @ along == pytest.approx(np.var(X @ along))
    assert 1e-5 < (across @ P @ across) / (along @ P @ along) < 1e-3
    u = np.cos(np.arange(500.0))[:, None]
    region = Region.of(X, u, X)
    other = Prior.of_region(region, np.ones(2))
    np.testing.assert_allclose(other.root @ other.root.T, P, rtol=1e-6)
    scaled = Prior.of_region(Region.of(1e6 * X, 1e-9 * u, X), np.ones(2))
    np.testing.assert_allclose(scaled.root @ scaled.root.T, 1e12 * P, rtol=1e-6)


def test_a_direction_that_the_outputs_do_not_show_keeps_its_curvature(rng):
    """Beside an unstable state, J'J of it is rounding, which must not be negative."""
    structure = state_space(2, 1, 1)
    for _ in range(20):
        T = rng.standard_normal((2, 2))
        A = T @ np.diag([2.4, 0.5]) @ np.linalg.inv(T)
        theta = structure.join({"A": A, "B": B, "C": C})
        u, y = np.zeros((40, 1)), rng.standard_normal((40, 1))
        prior = Prior(np.zeros(2), np.column_stack([T[:, 1], T.sum(axis=1)]))
        options = {"window": 40, "noise": 1e-6, "prior": prior}
        (x0,) = estimate_x0(structure, theta, [(u, y)], **options)
        assert np.all(np.isfinite(x0))

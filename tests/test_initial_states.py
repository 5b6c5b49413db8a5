"""Initial states of fresh records: where the training was, unless data say else."""

import numpy as np
import pytest

from alssnn import FlSsnn, GrSsnn, LinearStateSpace
from alssnn.datasets import make_pendulum
from alssnn.estimators import _simulation
from alssnn.initial_states import Prior, estimate_x0
from alssnn.models import state_space
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


def test_a_fresh_record_begins_where_the_training_was(monkeypatch):
    """A third state that a pendulum does not need is near -7, and zero is far away."""
    options = {"amplitude": 3.0}
    record = make_pendulum(1_000, noise=0.01, random_state=2, **options)
    fresh = make_pendulum(1_000, random_state=102, **options)
    model = GrSsnn(
        nx=3, n_f=6, n_init=1, alpha=1e-6, max_iter=150, dt=record.dt, random_state=2
    ).fit(record.u, record.y)
    data = fresh.u[200:], fresh.y[200:]
    error = np.sqrt(1 - model.score(*data))
    monkeypatch.setattr(_simulation, "expected_states", lambda model: None)
    without = np.sqrt(1 - model.score(*data))
    assert error < 0.01 and without > 4 * error


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

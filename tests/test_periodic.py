"""Settled periods: the initial state that comes back, and fits that know it."""

import warnings

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn.criterion import Criterion
from alssnn.excitation import multisine
from alssnn.periods import mean_periods
from alssnn.simulation import channels, simulate
from helpers import assert_jacobian, dense_jacobian, dense_residuals, random_theta

MODELS = {
    "LinearStateSpace": {},
    "FlSsnn": {"n_h": 3},
    "AlSsnn": {"n_h": 3, "n_g": 3},
    "GrSsnn": {"n_f": 3},
}
PERIOD = 200


def weighted(structure):
    every = {"y": 1.0, "g": 0.7, "e": 0.7, "k": 0.2, "h": 0.4, "v": 0.3}
    return {channel: every[channel] for channel in structure.channels}


def long_run(criterion, free):
    """Return the residuals of the period that follows ten of them."""
    structure, rows = criterion.structure, []
    theta, _ = criterion.split(free)
    lure, ny = structure.lure(theta), criterion.experiments[0][1].shape[1]
    for u, y in criterion.experiments:
        start = structure.initial_state(np.zeros(structure.n_x0, dtype=theta.dtype))
        settled = simulate(lure, np.tile(u, (10, 1)), start)[-1]
        start = structure.initial_state(settled[: structure.n_x0])
        Z = channels(lure, simulate(lure, u, start)[:-1], u)
        Z[:, :ny] = np.where(np.isnan(y), 0.0, Z[:, :ny] - np.nan_to_num(y))
        rows.append((Z * criterion.one.weight).ravel())
    return np.concatenate([*rows, criterion.decay * free])


def test_residuals_and_jacobian_are_those_of_the_long_run(structure, experiments, rng):
    options = {"weights": weighted(structure), "alpha": 0.01, "periodic": True}
    criterion = Criterion(structure, experiments, **options)
    x0 = rng.standard_normal((len(experiments), structure.n_x0))  # of no effect
    free = criterion.join(0.7 * random_theta(structure, rng), x0)  # all settle
    expected = long_run(criterion, free)
    np.testing.assert_allclose(dense_residuals(criterion, free), expected, atol=1e-10)
    J = dense_jacobian(criterion, free)
    assert_jacobian(lambda free: long_run(criterion, free), J, free, rtol=1e-9)
    assert not J[: -criterion.n, structure.n_params :].any()
    JJ, Jr, norm = criterion.normal_equations(free)
    np.testing.assert_allclose(JJ, J.T @ J, atol=1e-12 * np.abs(JJ).max())
    np.testing.assert_allclose(Jr, J.T @ expected, atol=1e-9)
    np.testing.assert_allclose(norm, np.linalg.norm(expected))
    np.testing.assert_allclose(criterion.norm(free), norm)
    step = 0.02 * rng.standard_normal(len(free))
    r = [dense_residuals(criterion, point) for point in (free, free + step)]
    got = criterion.pulled(free, free + step)
    np.testing.assert_allclose(got, J.T @ (r[1] - r[0]), atol=1e-9)


def plant(u, slow=0.0):
    """Return two outputs of a plant with a spring, from rest."""
    x, y = np.zeros(3), []
    for one in u:
        y.append([0.15 * x[0] + 0.1 * x[1], 0.1 * x[1] + slow * x[2]])
        v = one[0] + 0.3 * one[1] - 0.8 * np.tanh(2 * y[-1][0])
        x = np.array([1.6 * x[0] - 0.8 * x[1] + v, x[0], 0.995 * x[2] + one[1]])
    return np.array(y)


@pytest.fixture(scope="module")
def record():
    excitation = multisine(PERIOD, 2, n_periods=4, n_realizations=1, random_state=0)
    clean = [plant(u) for u in excitation.experiments]
    noise = 0.05 * np.random.default_rng(0).standard_normal((len(excitation), 2))
    return excitation, np.concatenate(clean), np.concatenate(clean) + noise


@pytest.mark.parametrize("name", MODELS)
def test_every_model_knows_its_periodic_state(name, record):
    excitation, clean, y = record
    options = {"alpha": 1e-6, "n_init": 1, "random_state": 0, "max_iter": 40}
    options = {} if name == "LinearStateSpace" else options
    model = getattr(alssnn, name)(nx=3, **MODELS[name], **options)
    model.set_params(initial_state="periodic", period=PERIOD)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(excitation.u, y, excitation.experiment)
    assert model.x0_.shape == (2, 3)
    for u, x0, one in zip(excitation.experiments, model.x0_, range(2), strict=True):
        period = model.predict(u[:PERIOD], x0=x0)
        twice = model.predict(u[: 2 * PERIOD], x0=x0)
        np.testing.assert_allclose(twice[PERIOD:], period, atol=1e-9)
        settled = model.predict(np.tile(u, (5, 1)))[-PERIOD:]  # from rest
        np.testing.assert_allclose(settled, period, atol=1e-6)
        if name != "LinearStateSpace":  # the mean of three periods leaves 0.029
            truth = clean[(one + 1) * 4 * PERIOD - PERIOD :][:PERIOD]
            assert np.sqrt(np.mean((period - truth) ** 2)) < 0.022
            noise = np.sqrt(np.diag(model.noise_covariance_))
            np.testing.assert_allclose(noise, 0.05, rtol=0.15)


def test_a_slow_pole_needs_no_long_transient():
    # a pole of 0.995 forgets 37 % in a period; its linear period is known at once
    rng = np.random.default_rng(1)
    u = rng.standard_normal((PERIOD, 1))
    y, x = [], 0.0
    for k in range(40 * PERIOD):
        y.append(x)
        x = 0.995 * x + 0.1 * u[k % PERIOD, 0]
    y = np.array(y[-PERIOD:]) + 1e-3 * rng.standard_normal(PERIOD)
    options = {"nx": 1, "operating_point": "zero", "initial_state": "periodic"}
    model = alssnn.LinearStateSpace(**options).fit(u, y)
    assert abs(model.A_[0, 0] - 0.995) < 1e-3
    rest = alssnn.LinearStateSpace(**{**options, "initial_state": "rest"}).fit(u, y)
    assert abs(rest.A_[0, 0] - 0.995) > 3 * abs(model.A_[0, 0] - 0.995)


def test_late_inputs_come_round(record):
    excitation, *_ = record
    u = excitation.experiments[0][:, :1]
    late = np.concatenate([np.zeros((5, 1)), u[:-5]])
    y = plant(np.hstack([late, 0 * late]))[:, :1]
    options = {"nx": 2, "initial_state": "periodic", "period": PERIOD}
    model = alssnn.LinearStateSpace(input_delay=5, **options).fit(u, y)
    same = alssnn.LinearStateSpace(**options).fit(np.roll(u, 5, axis=0), y)
    np.testing.assert_allclose(model.cost_, same.cost_, rtol=1e-6)


def test_means_leave_out_the_first_period_and_what_was_not_measured(rng):
    u = np.tile(rng.standard_normal((8, 1)), (4, 1))
    y = np.tile(rng.standard_normal((8, 2)), (4, 1))
    truth = y[:8].copy()
    y[:8] = 1e3
    y[9, 0], y[[8 + 3, 16 + 3, 24 + 3], 1] = np.nan, np.nan
    mean = mean_periods(u, y, [slice(0, 32)], 8)
    truth[3, 1] = np.nan
    np.testing.assert_allclose(mean.y, truth)
    np.testing.assert_allclose(mean.u, u[:8])
    np.testing.assert_allclose(mean.lost, 0.0, atol=1e-30)
    assert mean.parts == [slice(0, 8)]


def settling(memory, n=640, periods=3, seed=0):
    """Return a periodic record with unit noise and a large transient."""
    rng = np.random.default_rng(seed)
    u = np.tile(rng.standard_normal((n, 1)), (periods, 1))
    clean = np.tile(rng.standard_normal((n, 2)), (periods, 1))
    k = np.arange(len(u))[:, None]
    return u, clean, 30 * np.exp(-k / memory), rng.standard_normal(clean.shape)


def test_a_first_period_counts_from_where_it_has_settled():
    n, counted = 640, []
    for memory in (1e-9, 20.0, 250.0):
        u, clean, transient, noise = settling(memory)
        mean = mean_periods(u, clean + transient + noise, [slice(0, len(u))], n)
        three = (clean + noise).reshape(3, n, 2).mean(axis=0)
        same = np.abs(mean.y - three - transient[:n] / 3).max(axis=1) < 1e-9
        counted.append(same.mean())
        assert np.all(np.diff(same.astype(int)) >= 0)  # from one sample on
        if memory < 100:  # else the later periods differ as well
            lost = 1 / 2 + same.mean() / 6  # of three periods, or of two
            np.testing.assert_allclose(np.diag(mean.lost), lost, rtol=0.15)
    assert counted[0] == 15 / 16 and counted[2] == 0  # its first sample, or always
    assert 0.7 < counted[1] < 1 - 3.4 * 20 / n  # 30 exp(-3.4) is the noise
    u, clean, _, noise = settling(1e-9)
    u[:n] *= 2  # another input: no period of this signal
    mean = mean_periods(u, clean + noise, [slice(0, len(u))], n)
    two = (clean + noise)[n:].reshape(2, n, 2).mean(axis=0)
    np.testing.assert_allclose(mean.y, two)


def test_the_late_first_period_lowers_the_error_of_the_mean():
    gains = []
    for memory in (0.1, 10.0, 50.0, 150.0):
        errors = []
        for seed in range(20):
            u, clean, transient, noise = settling(memory, seed=seed)
            y = clean + transient + noise
            mean = mean_periods(u, y, [slice(0, len(u))], 640).y
            two = y[640:].reshape(2, 640, 2).mean(axis=0)
            errors.append([np.mean((z - clean[:640]) ** 2) for z in (mean, two)])
        ratio = np.divide(*np.mean(errors, axis=0))
        gains.append(ratio)
    assert gains[0] < 0.72 and np.all(np.diff(gains) > 0) and gains[-1] < 1.0


def test_gaps_lose_no_noise(rng):
    n, periods = 2_000, 5
    u = np.tile(rng.standard_normal((n, 1)), (periods, 1))
    y = rng.standard_normal((periods * n, 2))
    y[rng.uniform(size=y.shape) < 0.5] = np.nan
    mean = mean_periods(u, y, [slice(0, len(u))], n)
    total = np.isfinite(y.reshape(periods, n, 2)).sum(axis=0)  # settled throughout
    left = [np.mean(1 / t[t > 0]) for t in total.T]
    np.testing.assert_allclose(np.diag(mean.lost) + left, 1.0, atol=0.06)


def test_every_input_repeats_itself(rng):
    u = np.hstack(
        [1e3 * np.tile(rng.standard_normal((50, 1)), (4, 1)), np.ones((200, 1))]
    )
    y = rng.standard_normal((200, 1))
    assert len(mean_periods(u, y, [slice(0, 200)], 50).u) == 50
    u[:, 1] = rng.standard_normal(200)
    with pytest.raises(ValueError, match="`u` must repeat itself"):
        mean_periods(u, y, [slice(0, 200)], 50)


def test_the_noise_of_a_period_is_that_of_the_mean_and_what_it_lost(rng):
    n, P = 20_000, 4
    noise = 0.3 * rng.standard_normal((n * P, 1))
    mean = mean_periods(np.zeros((n * P, 1)), noise, [slice(0, n * P)], n)
    whole = np.mean(mean.y**2) + mean.lost[0, 0]
    np.testing.assert_allclose(whole, 0.09, rtol=0.02)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"noise": "innovations"}, "only for noise='output'"),
        ({"time": "continuous", "dt": 0.1}, "only for time='discrete'"),
        ({"integrators": 1}, "only for integrators=0"),
        ({"initial_state": "rest"}, "`period` must be None for initial_state='rest'"),
        ({"period": 130}, "`period` must divide .* got 130 for 800"),
        ({"period": 2}, "integer of at least 4, or None, got 2"),
        ({"period": 100}, "`u` must repeat itself after `period` = 100"),
    ],
)
def test_what_has_no_period_is_refused(changes, message, record):
    excitation, _, y = record
    options = {"nx": 2, "initial_state": "periodic", "period": PERIOD, **changes}
    with pytest.raises(ValueError, match=message):
        alssnn.LinearStateSpace(**options).fit(excitation.u, y, excitation.experiment)


def test_no_end_of_a_period_is_held_out(record):
    excitation, _, y = record
    options = {"initial_state": "periodic", "validation_fraction": 0.2}
    with pytest.raises(
        ValueError, match=r"only for validation_fraction=None, got 0\.2"
    ):
        alssnn.FlSsnn(nx=2, **options).fit(excitation.u, y, excitation.experiment)

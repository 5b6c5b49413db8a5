"""Training on predictions over a horizon: horizon=k."""

import numpy as np
import pytest

import alssnn
from alssnn.criterion import Criterion
from alssnn.horizon import AHEAD, ahead, later
from alssnn.innovations import free_run, predictor, with_outputs
from alssnn.models import state_space
from alssnn.simulation import outputs, regressors, simulate
from alssnn.training import Validation
from helpers import assert_direct, complex_step, dense_jacobian

pytestmark = pytest.mark.filterwarnings(
    "ignore::sklearn.exceptions.ConvergenceWarning"  # short fits are enough
)

OPTIONS = {
    "linear": {},
    "linear, output": {"drift": "output"},
    "FL, measured": {"n_h": 3, "feedback": "output", "h_sees": "measured"},
    "FL, predicted": {"n_h": 3, "feedback": "output"},
    "AL": {"n_h": 3, "n_g": (2, 3), "n_k": 2, "feedthrough": True, "drift": "input"},
    "AL, given": {
        "n_h": 2,
        "n_g": 2,
        "feedback": "output",
        "h_sees": "measured",
        "feedthrough": True,
        "disturbances": (1,),
        "drift": "output",
    },
    "monotone": {"n_h": 3, "feedback": "output", "input_map": "monotone"},
}


def declared(name):
    """Return a predictor with random parameters."""
    rng = np.random.default_rng(0)
    C = rng.standard_normal((2, 3)) if OPTIONS[name] else None
    C = None if name.startswith("linear") else C
    structure = predictor(
        state_space(3, 2, 2, C=C, noise="innovations", **OPTIONS[name])
    )
    return structure, 0.3 * rng.standard_normal(structure.n_params)


def make_record(n=1000, *, gain=0.0, seed=0, noise=0.02):
    """Return a record of four states, of which two are slow or fast."""
    rng = np.random.default_rng(seed)
    A = np.array([[1.6, -0.8], [1.0, 0.0]])
    r = np.repeat(rng.uniform(-1.5, 1.5, n // 8 + 1), 8)[:n]
    x, s, (u, y) = np.zeros(2), np.zeros(2), np.empty((2, n))
    for k in range(n):
        own = 0.15 * x[0] + 0.1 * x[1] + 0.3 * s[0] + 0.1 * s[1]
        y[k] = own + noise * rng.standard_normal()
        u[k] = r[k] - gain * y[k]
        v = u[k] + 2.5 * noise * rng.standard_normal()
        x = A @ x + np.array([v, 0.0])
        s = np.array([0.97 * s[0] + 0.03 * v, -0.5 * s[1] + 0.5 * v])
    return u[:, None], y


def errors(model, record, steps):
    """Return errors of predictions some samples ahead."""
    u, y = record
    return np.array([np.std((y - model.predict_ahead(u, y, k))[100:]) for k in steps])


@pytest.mark.parametrize("name", OPTIONS)
def test_predictions_run_on_from_the_state_of_the_predictor(name):
    structure, theta = declared(name)
    rng, k, n = np.random.default_rng(1), 4, 12
    u, y = rng.standard_normal((2, n, 2))
    ((z, _),) = later(with_outputs([(u, y)]), k)
    plain, wide = structure.observe("y"), ahead(structure, k)
    assert wide.measured == AHEAD and wide.n_x0 == plain.n_x0
    assert list(wide.parameters) == list(structure.parameters)
    x0 = rng.standard_normal(plain.n_x0)
    found = outputs(wide.lure(theta), z, wide.initial_state(x0))
    lure = plain.lure(theta)
    X = simulate(lure, np.hstack([u, y]), x0)
    expected = np.empty((n - k + 1, k, 2))
    for t in range(n - k + 1):
        x = X[t]
        for j in range(k):  # told what it predicts, it runs on alone
            unknown = np.full((1, 2), 9.9)
            expected[t, j] = outputs(lure, np.hstack([u[[t + j]], unknown]), x)[0]
            told = np.hstack([u[[t + j]], expected[t, [j]]])
            x = simulate(lure, told, x)[1]
    np.testing.assert_allclose(
        found[: n - k + 1].reshape(expected.shape), expected, atol=1e-12
    )


@pytest.mark.parametrize("name", OPTIONS)
def test_derivative(name, rng):
    structure, theta = declared(name)
    wide = ahead(structure, 3)
    assert_direct(wide, theta, rng)
    if "e" in structure.signals:
        assert_direct(ahead(structure.observe("y", "e"), 3), theta, rng)
    u, y = rng.standard_normal((2, 9, 2))
    pairs = later(with_outputs([(u, y)]), 3)
    criterion = Criterion(wide, pairs, weights={AHEAD: np.arange(1.0, 7.0)})
    x0 = rng.standard_normal((1, wide.n_x0))
    free = criterion.join(theta, x0)
    J = dense_jacobian(criterion, free)[: 9 * 6].reshape(9, 6, -1)
    ((z, targets),) = pairs
    weight = criterion.one.weight * ~np.isnan(targets)

    def stacked(free):
        lure = wide.lure(free[: wide.n_params])
        x, rows = wide.initial_state(free[wide.n_params :])[None], []
        for one in z:
            Phi = regressors(lure, x, one[None])
            x = Phi @ lure.rows_x.T
            rows.append(Phi @ lure.rows_z.T)
        return np.vstack(rows) * weight

    expected = complex_step(stacked, free)
    np.testing.assert_allclose(J, expected, rtol=0, atol=1e-12 * np.abs(J).max())


def test_one_sample_is_the_predictor_itself():
    structure, _ = declared("FL, measured")
    assert ahead(structure, 1) is structure
    pairs = with_outputs([(np.ones((9, 2)), np.ones((9, 2)))])
    assert later(pairs, 1)[0][0] is pairs[0][0]
    u, y = make_record(300)
    options = {"nx": 2, "noise": "innovations"}
    models = [
        alssnn.LinearStateSpace(**options, **horizon).fit(u, y)
        for horizon in ({}, {"horizon": 1})
    ]
    np.testing.assert_array_equal(*(model._theta for model in models))


@pytest.mark.parametrize("name", ["linear", "FL, predicted", "monotone"])
def test_the_longest_horizon_is_the_error_of_a_simulation(name):
    structure, theta = declared(name)
    rng, n = np.random.default_rng(0), 15
    u, y = rng.standard_normal((2, n, 2))
    y[3, 1], y[7] = np.nan, np.nan
    pairs, x0 = with_outputs([(u, y)]), rng.standard_normal((1, 3))
    plain = free_run(structure).observe("y")
    simulated = outputs(plain.lure(theta), u, x0[0])
    ((z, targets),) = later(pairs, n)
    wide = ahead(structure, n)
    found = outputs(wide.lure(theta), z, x0[0])
    np.testing.assert_allclose(found[0].reshape(n, 2), simulated, atol=1e-12)
    np.testing.assert_array_equal(targets[0].reshape(n, 2), y)
    # without K all predictions are that simulation
    p = structure.split(theta)
    theta = structure.join({**p, "K": 0.0 * p["K"]})
    count = np.add.outer(np.arange(n), np.arange(n))
    square = np.nansum((y - simulated) ** 2, axis=1)[count[count < n]].sum()
    n_measured = np.sum(~np.isnan(targets)) / (2 * n)
    criterion = Criterion(wide, [(z, targets)], weights={AHEAD: 1 / n})
    assert criterion.norm(criterion.join(theta, x0)) ** 2 == pytest.approx(
        square / n / n_measured, rel=1e-12
    )


def test_records_end_with_what_is_not_known():
    u, y = np.arange(6.0).reshape(3, 2), np.arange(3.0)[:, None]
    ((z, targets),) = later([(np.hstack([u, 10 + y]), y)], 3)
    expected = [
        [0, 1, 10, 2, 3, 4, 5],
        [2, 3, 11, 4, 5, 4, 5],
        [4, 5, 12, 4, 5, 4, 5],
    ]
    np.testing.assert_array_equal(z, expected)
    nan = np.nan
    np.testing.assert_array_equal(targets, [[0, 1, 2], [1, 2, nan], [2, nan, nan]])


@pytest.mark.parametrize("gain", [0.0, 0.4])
def test_too_simple_a_model_predicts_better_further_ahead(gain):
    record, fresh = (make_record(gain=gain, seed=seed) for seed in (0, 1))
    options = {"nx": 2, "noise": "innovations"}
    one, five = (
        alssnn.LinearStateSpace(horizon=k, **options).fit(*record) for k in (1, 5)
    )
    ratio = errors(five, fresh, [1, 5, 20]) / errors(one, fresh, [1, 5, 20])
    assert ratio[0] > 1.02 and ratio[1] < 0.95 and ratio[2] < 0.97
    poles = np.linalg.eigvals(five.A_ - five.K_ @ five.C_)
    assert np.abs(poles).max() < 1
    # the true order leaves nothing to trade
    one, five = (
        alssnn.LinearStateSpace(nx=4, noise="innovations", horizon=k).fit(*record)
        for k in (1, 5)
    )
    np.testing.assert_allclose(
        errors(five, fresh, [1, 5]), errors(one, fresh, [1, 5]), rtol=0.03
    )


def test_networks_over_a_horizon(tmp_path):
    u, y = make_record(600, gain=0.4)
    y[200:204] = np.nan
    options = {"nx": 2, "n_h": 2, "n_g": 2, "n_init": 1, "alpha": 1e-4, "max_iter": 15}
    options |= {"random_state": 0, "noise": "innovations", "warm_start": True}
    model = alssnn.AlSsnn(horizon=3, drift="output", **options).fit(u, y)
    one = alssnn.AlSsnn(drift="output", **options).fit(u, y)
    seen = [np.nanstd((y - m.predict_ahead(u, y, 3))[100:]) for m in (model, one)]
    assert seen[0] < seen[1]
    covariance = None
    with pytest.warns(UserWarning, match="horizon"):
        covariance = model.parameter_covariance(u, y)
    assert not covariance.holds
    model.save(tmp_path / "model")
    again = alssnn.load(tmp_path / "model")
    assert again.horizon == 3
    np.testing.assert_array_equal(again.predict(u), model.predict(u))
    cost = model.cost_
    assert model.fit(u, y).cost_ <= cost * (1 + 1e-4)


@pytest.mark.parametrize(("horizon", "fits"), [(39, True), (40, False), (99, False)])
def test_a_horizon_is_shorter_than_the_longest_experiment(horizon, fits):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((70, 1))
    y = np.vstack([np.zeros((1, 1)), u[:-1]]) + 0.1 * rng.standard_normal((70, 1))
    label = np.arange(70) >= 40
    options = {"noise": "innovations", "horizon": horizon, "max_iter": 30}
    model = alssnn.LinearStateSpace(nx=1, **options)
    if fits:
        assert model.fit(u, y, experiment=label).horizon == horizon
        return
    with pytest.raises(ValueError, match=r"`horizon` must be less than .* 40, got"):
        model.fit(u, y, experiment=label)


def test_what_is_held_out_is_judged_over_the_horizon():
    rng = np.random.default_rng(0)
    structure, theta = declared("FL, predicted")
    u, y = rng.standard_normal((2, 40, 2))
    pairs = with_outputs([(u, y)])
    judge = Validation(pairs, [1.0, 3.0], 10)
    wide = judge.of(lambda experiments: later(experiments, 2))
    wide.output_weight = np.tile(wide.output_weight / 2, 2)
    rmse = wide.rmse(ahead(structure, 2), theta, 1.0)
    assert rmse != judge.rmse(structure, theta, 1.0)
    model = alssnn.FlSsnn(
        nx=2,
        n_h=2,
        n_init=1,
        alpha=1e-4,
        max_iter=5,
        random_state=0,
        noise="innovations",
        horizon=2,
        validation_fraction=0.3,
    )
    record = make_record(400)
    assert np.isfinite(model.fit(*record).history_[-1].validation_rmse)


def test_linear_outcome_of_networks_is_trained_over_the_horizon():
    u, y = make_record(500)
    options = {"nx": 2, "noise": "innovations", "horizon": 4}
    left = alssnn.FlSsnn(n_h=0, stability=None, tol=1e-8, **options).fit(u, y)
    linear = alssnn.LinearStateSpace(**options).fit(u, y)
    assert left.cost_ == pytest.approx(linear.cost_, rel=1e-6)
    # what is left of networks that do not help, too
    options |= {"n_h": 2, "n_init": 1, "random_state": 0, "max_iter": 30}
    left = alssnn.FlSsnn(**options).fit(u, y)
    assert left.alpha_ == np.inf
    assert left.cost_ == pytest.approx(linear.cost_, rel=0.01)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"horizon": 2}, "`horizon` must be 1 for noise='output', got 2"),
        ({"horizon": 0, "noise": "innovations"}, "horizon"),
    ],
)
def test_refused_options(options, match):
    u, y = make_record(100)
    with pytest.raises(ValueError, match=match):
        alssnn.LinearStateSpace(nx=2, **options).fit(u, y)

import warnings
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, chi2, f, kstest
from sklearn.exceptions import ConvergenceWarning, NotFittedError

from alssnn import LinearStateSpace
from alssnn.estimators import _plant
from alssnn.linearizability import Region, judge, measure, percent, worst_error
from alssnn.lure import Lure
from alssnn.regression import lagged
from alssnn.sensitivities import sensitivities
from alssnn.simulation import simulate
from alssnn.validation import (
    ahead_fit,
    frequency_response,
    loop_deviation,
    residual_tests,
    scored_experiments,
    scored_sensitivities,
    sine_response,
    validate,
)
from alssnn.validation._explained import explained_shares
from helpers import as_records, linear_plant, plant_of
from models import al_ssnn, fl_ssnn

A = np.array([[0.8, 0.3], [-0.2, 0.7]])
B = np.array([[1.0, 0.2], [0.1, 0.5]])
C = np.array([[1.0, 0.0], [0.3, 1.0]])
TESTS = ("independence", "squares", "cubes")


def colored(rng, shape, pole):
    return lfilter([1], [1, -pole], rng.standard_normal(shape), axis=0)


def plant(u, strength=0.0):
    """A linear plant of two inputs and outputs, or one with an even remainder."""
    x, y = np.zeros(2), np.empty((len(u), 2))
    for k, u_k in enumerate(u):
        y[k] = C @ x
        x = A @ x + B @ u_k + strength * x**2
    return y


def fit(estimator, u, y, experiment=None):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return estimator.fit(u, y, experiment)


@pytest.fixture(scope="module")
def true_model():
    u = colored(np.random.default_rng(0), (2000, 2), 0.8)
    model = LinearStateSpace(nx=2, dt=0.1, operating_point="zero").fit(u, plant(u))
    assert model.score(u, plant(u)) > 1 - 1e-9
    return model


@pytest.fixture(scope="module", params=["output", "state"])
def fl_model(request):
    rng = np.random.default_rng(1)
    u = rng.standard_normal((600, 2))
    y = plant(np.tanh(u))
    model = fl_ssnn(nx=2, n_h=3, feedback=request.param, max_iter=15, random_state=0)
    model.set_params(dt=0.1)
    return fit(model, u, y)


@pytest.fixture
def residuals_alone(monkeypatch):
    """Leave out simulated loops and predictions, which no test of residuals sees."""
    untried = {"carried_problem": "No controller was tried."}
    monkeypatch.setattr(_plant, "_carried", lambda *args, **options: untried)

    def unpredicted(*args, **options):
        raise ValueError("No prediction was asked for.")

    monkeypatch.setattr("alssnn.validation._validate.ahead_fit", unpredicted)


# -- statistics ------------------------------------------------------------------------


def test_whiteness_is_the_test_of_ljung_and_box():
    rng = np.random.default_rng(0)
    r = colored(rng, 300, 0.1)
    tests = residual_tests([(rng.standard_normal(300), r, 0 * r)], n_lags=10)
    r = r - r.mean()
    rho = np.correlate(r, r, "full")[299:310] / (r @ r)
    Q = 300 * 302 * np.sum(rho[1:] ** 2 / (300 - np.arange(1, 11)))
    np.testing.assert_allclose(tests.autocorrelation[:, 0], rho, atol=1e-12)
    assert tests.p_values["whiteness"][0] == pytest.approx(chi2.sf(Q, 10))
    half = 2.5758293 * np.sqrt(300 - np.arange(11)) / 300  # normal quantile of 0.995
    np.testing.assert_allclose(tests.autocorrelation_band[:, 0], half)


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_p_values_of_true_residuals_are_uniform(pole):
    n, p = 120, {name: [] for name in TESTS}
    outside = []
    for seed in range(n):
        rng = np.random.default_rng(seed)
        u = colored(rng, (500, 1), 0.9)
        y_hat = lfilter([0, 1], [1, -0.7], u, axis=0)
        tests = residual_tests(
            [(u, y_hat + colored(rng, (500, 1), pole), y_hat)], n_lags=15
        )
        for name in TESTS:
            p[name].append(tests.p_values[name][0])
        outside.append(np.abs(tests.cross_correlation[..., 0]) > tests.cross_band)
    for name in TESTS:
        # with colored signals, too: nominal at 5 % and over all levels
        assert np.sum(np.array(p[name]) < 0.05) <= binom.ppf(0.9999, n, 0.05)
        assert kstest(p[name], "uniform").pvalue > 1e-3
    # lags of one record are correlated: only the mean over seeds is near 1 %
    assert 0.002 < np.mean(outside) < 0.025


def test_each_block_catches_its_own_remainder():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((3000, 2))
    y_hat = 0.1 * rng.standard_normal((3000, 1))
    before = np.vstack([np.zeros((3, 2)), u[:-3]])
    remainders = {
        "independence": before[:, 0],
        "squares": before[:, 0] * before[:, 1],
        "cubes": before[:, 1] ** 3 - 3 * before[:, 1],  # orthogonal to u
    }
    for name, remainder in remainders.items():
        r = 0.3 * remainder[:, None] + colored(rng, (3000, 1), 0.5)
        tests = residual_tests([(u, y_hat + r, y_hat)], n_lags=10)
        assert {k for k in TESTS if tests.p_values[k][0] < 1e-6} == {name}
        # r_w = 0.3 z + e - 0.15 z_{k-1}: variances 0.1125 var(z) and about 1
        part = 0.1125 * np.var(remainder)
        assert tests.shares[name][0] == pytest.approx(part / (1 + part), abs=0.05)
    k = int(np.argmax(np.abs(tests.cross_correlation[:, 0, 0])))
    tests = residual_tests([(u, y_hat + before[:, :1], y_hat)], n_lags=10)
    k = int(np.argmax(np.abs(tests.cross_correlation[:, 0, 0])))
    assert tests.cross_lags[k] == 3


def test_seams_and_gaps_do_not_count():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 1))
    r = rng.standard_normal((400, 1))
    r[50:60] = np.nan
    parts = [(z[:150], z[150:]) for z in (u, r, 0 * u)]
    tests = residual_tests(list(zip(*parts, strict=True)), n_lags=5)
    assert tests.n_samples[0] == 390
    r = r - np.nanmean(r)
    halves = [r[:150, 0], r[150:, 0]]
    products = np.concatenate([z[2:] * z[:-2] for z in halves])
    expected = np.nansum(products) / np.nansum(r**2)
    assert tests.autocorrelation[2, 0] == pytest.approx(expected)
    pairs = np.isfinite(products).sum()
    assert tests.autocorrelation_band[2, 0] == pytest.approx(
        2.5758293 * np.sqrt(pairs) / 390
    )


def test_cross_correlations_are_those_of_known_pairs():
    rng = np.random.default_rng(2)
    u, r = rng.standard_normal((200, 2)), rng.standard_normal((200, 1))
    r[50:55] = np.nan
    tests = residual_tests([(u, r, 0 * u[:, :1])], n_lags=3)
    assert tests.ar_order[0] == 0  # white noise: the filter is one
    r, u = r[:, 0] - np.nanmean(r), (u - u.mean(axis=0)) / u.std(axis=0)
    known = np.isfinite(r)
    size = np.sqrt(np.sum(r[known] ** 2) * np.sum(u[known] ** 2, axis=0))
    for i, lag in enumerate(range(-3, 4)):
        k = np.arange(200)[
            known & (np.arange(200) >= lag) & (np.arange(200) < 200 + lag)
        ]
        expected = r[k] @ u[k - lag] / size
        np.testing.assert_allclose(tests.cross_correlation[i, 0], expected)
        band = 2.5758293 * np.sqrt(len(k)) / 195
        assert tests.cross_band[i, 0] == pytest.approx(band)
    assert tests.cross_lags.tolist() == list(range(-3, 4))


def test_an_experiment_of_one_sample_is_one():
    rng = np.random.default_rng(0)
    u, r = rng.standard_normal((2, 300, 1))
    whole = [(u, r, 0 * r)]
    tests = residual_tests([*whole, (u[:1], r[:1], 0 * r[:1])], n_lags=3)
    assert tests.n_samples[0] == 301


def test_short_chunks_give_the_same_tests(monkeypatch):
    rng = np.random.default_rng(0)
    u, y, y_hat = rng.standard_normal((3, 900, 1))
    whole = residual_tests([(u, y, y_hat)])
    monkeypatch.setattr("alssnn.validation._regression.CHUNK", 70)
    monkeypatch.setattr("alssnn.regression.ENTRIES", 0)
    parts = residual_tests([(u, y, y_hat)])
    for name in TESTS:
        np.testing.assert_allclose(parts.p_values[name], whole.p_values[name])


def test_columns_that_others_explain_count_for_nothing():
    rng = np.random.default_rng(0)
    u = np.sign(rng.standard_normal((600, 1)))  # its square is one, its cube itself
    tests = residual_tests([(u, rng.standard_normal((600, 1)), np.zeros((600, 1)))])
    assert tests.p_values["squares"][0] == 1.0
    assert tests.p_values["cubes"][0] == 1.0
    assert 0 < tests.p_values["independence"][0] < 1


def test_feedback_shows_at_negative_lags():
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(2000)
    u = rng.standard_normal(2000)
    u[2:] -= 0.5 * noise[:-2]
    tests = residual_tests([(u, noise, 0 * noise)])
    out = np.abs(tests.cross_correlation[:, 0, 0]) > 2 * tests.cross_band[:, 0]
    assert tests.cross_lags[out].tolist() == [-2]
    assert tests.p_values["independence"][0] > 0.01


def test_a_residual_of_rounding_passes():
    u = np.random.default_rng(0).standard_normal((300, 1))
    tests = residual_tests([(u, u, u * (1 + 1e-15))])
    assert all(p[0] == 1 for p in tests.p_values.values())


def test_an_output_of_rounding_beside_one_of_noise():
    rng = np.random.default_rng(0)
    u, noise = rng.standard_normal((2, 300, 2))
    y = np.hstack([u[:, :1], u[:, 1:] + noise[:, :1]])
    tests = residual_tests([(u, y, u)], n_lags=4)
    alone = residual_tests([(u, y[:, 1:], u[:, 1:])], n_lags=4)
    assert tests.n_samples.tolist() == [300, 300] and tests.ar_order[0] == 0
    assert tests.autocorrelation[:, 0].tolist() == [1, 0, 0, 0, 0]
    for nothing in (
        tests.autocorrelation_band,
        tests.cross_band,
        np.abs(tests.cross_correlation).max(axis=2),
    ):
        assert not nothing[:, 0].any() and nothing[:, 1].all()
    assert tests.cross_correlation.shape == (9, 2, 2)
    for name, p in tests.p_values.items():
        assert p[0] == 1 and tests.shares[name][0] == 0
    for name, explained in tests.explained.items():
        assert explained[0] == 0 and explained[1] == alone.explained[name][0]
    np.testing.assert_array_equal(
        tests.autocorrelation[:, 1], alone.autocorrelation[:, 0]
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": 0}, "`level` must be between 0 and 1, got 0. It is"),
        ({"n_lags": 0}, "`n_lags` must be a positive integer or 'auto', got 0. Give"),
        ({"n_lags": "all"}, "`n_lags` must be a positive integer or 'auto', got 'all'"),
        ({"n_lags": np.nan}, "`n_lags` must be a positive integer or 'auto', got nan"),
        ({"output_names": ["a", "b"]}, "`output_names` must have one name per signal"),
        ({"n_lags": 60}, "`y` must have at least 212 measured samples behind the"),
    ],
)
def test_wrong_options_of_the_tests(options, message):
    z = np.random.default_rng(0).standard_normal((100, 1))
    with pytest.raises(ValueError, match=message):
        residual_tests([(z, z, 0 * z)], **options)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda u, y, y_hat: [], "hold one or more tuples"),
        (lambda u, y, y_hat: [(u[:-3], y, y_hat)], r"got \[\(\(497, 2\), \(500, 2\)"),
        (lambda u, y, y_hat: [(u, y, y_hat[:, :1])], r"\(N, ny\), \(N, ny\), got"),
        (lambda u, y, y_hat: [(u, y, y_hat), (u[:, :1], y, y_hat)], "of shapes"),
        (lambda u, y, y_hat: [(u, y, y_hat), (u[:0], y[:0], y_hat[:0])], "of shapes"),
        (lambda u, y, y_hat: [(spoiled(u, np.nan), y, y_hat)], "`u` must be finite"),
        (lambda u, y, y_hat: [(u, spoiled(y, np.inf), y_hat)], "`y` finite or nan"),
    ],
)
def test_experiments_that_cannot_be_tested_are_refused(change, message):
    u, noise = np.random.default_rng(0).standard_normal((2, 500, 2))
    with pytest.raises(ValueError, match=message):
        residual_tests(change(u, u + noise, u))


def spoiled(z, value):
    z = z.copy()
    z[7, 0] = value
    return z


def test_a_diverged_simulation_has_no_residual():
    z = np.ones((100, 1))
    with pytest.raises(ValueError, match="`y_hat` must be finite"):
        residual_tests([(z, z, z * np.inf)])


# -- validate --------------------------------------------------------------------------


@pytest.mark.usefixtures("residuals_alone")
def test_a_true_model_passes_at_the_nominal_rate(true_model):
    seeds, failed = 40, dict.fromkeys(TESTS, 0)
    colors = {0.0: 0, 0.9: 0}  # of the noise: half of the seeds each
    for seed in range(seeds):
        rng, pole = np.random.default_rng(100 + seed), (0.0, 0.9)[seed % 2]
        u = colored(rng, (400, 2), 0.8)
        noise = 0.5 * colored(rng, (400, 2), pole)
        found = true_model.validate(u, plant(u) + noise, n_lags=10)
        for name in TESTS:
            failed[name] += not found[name].passed
        colors[pole] += not found["whiteness"].passed
    assert max(failed.values()) <= binom.ppf(0.9999, seeds, 0.01)  # 4
    # the color of the noise is seen, and does not decide
    assert colors[0.9] == seeds // 2
    assert colors[0.0] <= binom.ppf(0.9999, seeds // 2, 0.01)  # 3


def test_a_colored_record_passes_and_says_so(true_model):
    rng = np.random.default_rng(0)
    u = colored(rng, (900, 2), 0.5)
    y = plant(u) + 0.05 * colored(rng, (900, 2), 0.9)
    found = true_model.validate(u, y)
    assert found.passed
    assert not found["whiteness"].passed
    assert "independence decides" in found["whiteness"].sentence
    assert str(found).endswith("LinearStateSpace passes.")


def test_a_model_of_too_low_order_fails_independence(true_model):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1500, 2))
    low = LinearStateSpace(nx=1, dt=0.1).fit(u[:700], plant(u)[:700])
    y = plant(u)[700:] + 0.1 * rng.standard_normal((800, 2))
    found = low.validate(u[700:], y)
    check = found["independence"]
    assert not check.passed and not found.passed
    assert check.value < 1e-10
    assert "raise `nx`" in check.sentence
    assert true_model.validate(u[700:], y)["independence"].passed
    assert "fails: independence" in repr(found)


@pytest.mark.usefixtures("residuals_alone")
def test_identified_models_of_the_right_structure_pass():
    """Errors of the parameters are no dependence, on training data or on others."""
    seeds, pole = 10, 0.9
    failed = {name: dict.fromkeys(TESTS, 0) for name in ("train", "fresh", "exact")}
    low = 0
    for seed in range(seeds):
        rng = np.random.default_rng(1000 + seed)
        u, fresh = rng.standard_normal((2, 500, 2))
        records = [
            (z, plant(z) + 0.1 * colored(rng, z.shape, pole)) for z in (u[:300], fresh)
        ]
        model = LinearStateSpace(nx=2, dt=0.1, integrators=0).fit(*records[0])
        options = {"n_lags": 8}
        for name, found in {
            "train": model.validate(*records[0], **options),
            "fresh": model.validate(*records[1], **options),
            "exact": model.validate(*records[1], **options, exact=True),
        }.items():
            for test in TESTS:
                failed[name][test] += not found[test].passed
        if seed < 2:
            model = LinearStateSpace(nx=1, dt=0.1, integrators=0).fit(*records[0])
            low += not model.validate(*records[1], **options)["independence"].passed
    most = binom.ppf(0.999, seeds, 0.01)  # 2
    assert max(failed["train"].values()) <= most
    assert max(failed["fresh"].values()) <= most
    assert failed["exact"]["independence"] > most  # what the sensitivities spare
    assert low == 2


def test_parameters_are_eliminated_as_by_a_dense_regression(true_model):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((900, 2))
    y = plant(u) + 0.3 * rng.standard_normal((900, 2))
    y[300:310, 1] = np.nan
    label = np.repeat([0, 1], 450)
    experiments, _ = scored_experiments(true_model, u, y, label)
    parts = scored_sensitivities(true_model, u, y, label)
    tests = residual_tests(experiments, sensitivities=parts, n_lags=4)
    # one output, dense: null columns, F-test of the lags of u
    rows = [[], [], []]
    for i, (u_i, y_i, y_hat) in enumerate(experiments):
        both = [[z.copy() for z in chunk] for chunk in parts[i]()]
        J, J_x0 = (np.concatenate(z)[:, 1] for z in zip(*both, strict=True))
        start = np.zeros((len(J), 4))
        start[:, 2 * i : 2 * i + 2] = J_x0
        rows[0].append(np.hstack([J, start, np.ones((len(J), 1))]))
        rows[1].append(lagged(u_i, range(5)))
        rows[2].append((y_i - y_hat)[:, 1])
    J, past, r = (np.concatenate(z) for z in rows)
    assert tests.ar_order[1] == 0  # white noise: the filter is one
    kept = np.isfinite(past).all(axis=1) & np.isfinite(r)
    J = J[:, np.linalg.norm(J[kept], axis=0) > 0]  # C of the other output
    X0, X1, r = J[kept] / np.linalg.norm(J[kept], axis=0), past[kept], r[kept]

    def rss(X):
        return np.sum((r - X @ np.linalg.lstsq(X, r, rcond=1e-10)[0]) ** 2)

    rank = np.linalg.matrix_rank(X0, tol=1e-10)
    assert rank == 6 + 4 + 1  # of 10 columns of J, 4 belong to the basis of the states
    dof = len(r) - rank - 10
    F = (rss(X0) / rss(np.hstack([X0, X1])) - 1) / 10 * dof
    assert tests.p_values["independence"][1] == pytest.approx(f.sf(F, 10, dof))
    assert tests.n_parameters == true_model._structure.n_params


def test_a_changed_plant_is_found_by_exact_parameters(true_model):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((800, 2))
    y = 1.03 * plant(u) + 0.1 * rng.standard_normal((800, 2))  # another gain
    found = true_model.validate(u, y)
    assert found["independence"].passed  # the structure still fits ...
    assert found.residuals.p_values["parameters"].max() < 1e-10  # ... with others
    assert not true_model.validate(u, y, exact=True)["independence"].passed


def test_parameters_are_no_excuse_for_a_large_dependence(true_model):
    """What other parameters would explain counts if it is 5 % of the output."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((800, 2))
    for gain in (1.1, 2.0):
        y = gain * plant(u) + 0.1 * rng.standard_normal((800, 2))
        found = true_model.validate(u, y)
        check, tests = found["independence"], found.residuals
        assert check.value > 0.01  # the test alone passes
        assert not check.passed and not found.passed
        assert tests.explained["independence"].max() > 0.6
        assert "predict" in check.sentence and "of the output" in check.sentence


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_noise_of_any_color_explains_nothing(pole):
    shares = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u = colored(rng, (500, 1), 0.9)
        y_hat = lfilter([0, 1], [1, -0.7], u, axis=0)
        r = colored(rng, (500, 1), pole)
        r[40:50] = np.nan
        tests = residual_tests([(u, y_hat + r, y_hat)], n_lags=15)
        shares.append([tests.explained[name][0] for name in TESTS])
    assert np.max(shares) < 0.25


def test_explained_shares_against_a_plain_cross_validation():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((500, 2))
    y_hat = u[:, :1]
    r = u[:, :1] + 0.5 * np.roll(u[:, 1:], 2, axis=0) + rng.standard_normal((500, 1))
    tests = residual_tests([(u, y_hat + r, y_hat)], n_lags=4)
    X = np.hstack([np.ones((500, 1)), lagged((u - u.mean(0)) / u.std(0), range(5))])
    errors = np.zeros(2)
    for rows in np.array_split(np.arange(500), 5):
        test = rows[np.isfinite(X[rows]).all(axis=1)]
        train = np.setdiff1d(np.arange(4, 500), rows)
        for i, Z in enumerate((X[:, :1], X)):
            b = np.linalg.lstsq(Z[train], r[train, 0], rcond=None)[0]
            errors[i] += np.sum((r[test, 0] - Z[test] @ b) ** 2)
    assert tests.explained["independence"][0] == pytest.approx(
        1 - errors[1] / errors[0], abs=1e-9
    )
    assert 0.5 < tests.explained["independence"][0] < 0.6  # 1.25 of 2.25


def test_scored_samples_are_in_the_units_of_the_user():
    u = colored(np.random.default_rng(0), (500, 2), 0.5)
    y = plant(u) + np.array([40.0, -7.0])  # about an operating point
    u = u + np.array([3.0, -20.0])
    model = LinearStateSpace(nx=2, n_init_samples=30).fit(u, y)
    ((u_s, y_s, y_hat),), (start,) = scored_experiments(model, u, y)
    assert start == 30
    np.testing.assert_allclose(u_s, u[30:])
    np.testing.assert_array_equal(y_s, y[30:])
    np.testing.assert_allclose(y_hat, y[30:], atol=0.1)  # of its mean, too


def test_scored_sensitivities_are_those_of_the_scored_samples():
    u = colored(np.random.default_rng(0), (9000, 2), 0.5)  # more than one chunk
    model = LinearStateSpace(nx=2, n_init_samples=30).fit(u[:600], plant(u[:600]))
    u, y = u[400:], plant(u)[400:]  # not from rest
    (parts,) = scored_sensitivities(model, u, y)
    pieces = [(J.copy(), J_x0.copy()) for J, J_x0 in parts()]
    J, J_x0 = map(np.concatenate, zip(*pieces, strict=True))
    (record,), fit = model.prepare_records(u, y), model.fitted_
    assert np.abs(record.x0).min() > 0.1
    x0 = record.x0 / fit.x_scale  # as the training had it
    ones, n = np.ones(2), fit.structure.n_params
    whole = sensitivities(fit.structure, fit.theta, x0, record.u_s, ones, 8600)
    ((_, _, expected),) = whole
    assert len(pieces) > 1 and len(J) == 8570
    np.testing.assert_allclose(J, expected[30:, :, :n][..., fit.free], atol=1e-10)
    np.testing.assert_allclose(J_x0, expected[30:, :, n:], atol=1e-10)


@pytest.mark.parametrize("offset", [0.0, 3.0, -1e3])
def test_an_offset_of_the_residual_is_no_part_of_its_variance(offset):
    z, noise = np.random.default_rng(0).standard_normal((2, 600, 1))
    r = (z + noise)[:, 0] + offset
    (share,) = explained_shares([r], [([z], range(3))])
    assert share == pytest.approx(0.5, abs=0.05)
    assert explained_shares([np.full(600, offset)], [([z], range(3))])[0] == 0


@pytest.mark.parametrize(
    ("missed", "passes"), [(0.03, True), (0.15, False), (1.2, False)]
)
def test_a_free_run_far_worse_than_in_training_fails(true_model, missed, passes):
    """Any fit above zero used to pass; this model was trained without an error."""
    rng = np.random.default_rng(0)
    u = colored(rng, (600, 2), 0.8)
    y = plant(u)
    noise = np.tanh(u[:, :1]) * u[:, 1:]
    y += missed * y.std(axis=0) * (noise - noise.mean()) / noise.std()
    check = true_model.validate(u, y, n_lags=10)["free run"]
    assert check.passed == passes
    if passes:
        assert "The mean of the output misses all of it" in check.sentence
    elif check.value > 0:
        assert "of the training record" in check.sentence
    else:
        assert "no better than its mean" in check.sentence


def test_a_free_run_worse_than_a_linear_model_fails(true_model):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((800, 2))
    y = plant(u) + 0.02 * rng.standard_normal((800, 2))
    poor = LinearStateSpace(nx=1, dt=0.1, operating_point="zero").fit(u, y)
    found = validate(poor, u, y, n_lags=10, baseline=true_model)["free run"]
    assert not found.passed and found.value > 0
    assert "Use the linear model." in found.sentence
    assert validate(true_model, u, y, n_lags=10, baseline=poor)["free run"].passed


def loop_that_diverges():
    """Return a plant that is linear on its record and not at all under its law."""
    # x+ = .95 x + (u + h) + 5 (tanh(x - 9) + tanh(9)), h = -45 tanh(.01 x)
    Theta = np.zeros((5, 5))
    Theta[0] = [0.95, 1.0, -45.0, 5.0, 5 * np.tanh(9.0)]
    Theta[1, 0] = 1.0
    Theta[2:4, 0], Theta[3, 4] = [0.01, 1.0], -9.0
    lure = Lure(Theta[:4], 1, 1, 2)
    return plant_of(lure, K=np.array([[-45.0, 0.0]]))


def test_linearity_is_decided_by_the_loop_as_well():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, 300), 10)[:, None]
    plant_ = loop_that_diverges()
    X = simulate(plant_.lure, u, np.zeros(1))[:-1]
    plant_ = replace(plant_, region=Region.of(X, u, X))
    record = measure(plant_, as_records([(u, X, np.zeros(1))]))
    assert record.linearization_error[0] < 1e-3 and record.outside < 1e-3
    assert record.closed_linearization_error[0] > 10 and record.closed_outside > 0.9
    passed, sentence = judge(record, fit=99.0)
    assert not passed and worst_error(record) > 10
    assert "less than 0.001 %" in sentence or "along the record" in sentence
    assert percent(record.closed_linearization_error[0]) in sentence
    # each of the conditions alone
    good = replace(
        record,
        closed_linearization_error=np.array([0.01]),
        closed_outside=0.01,
        closed_law_size=1.0,
        law_size=1.0,
    )
    assert judge(good, fit=99.0)[0] and judge(good)[0]
    for change, words in (
        ({"closed_outside": 0.5}, "extrapolated"),
        ({"closed_outside": None}, "an unknown share"),
        ({"closed_linearization_error": np.array([0.2])}, "disturbance"),
        ({"linearization_error": np.array([np.nan])}, "disturbance"),
        ({"law_size": 10.0}, "10 times the recorded input"),
        ({"spectral_radius": 1.1}, "stabilizes"),
        ({"no_law": "It is late."}, "There is no loop"),
    ):
        passed, sentence = judge(replace(good, **change), fit=99.0)
        assert not passed and words in sentence
    passed, sentence = judge(good, fit=-10.0)
    assert not passed and "does not follow the plant" in sentence


def test_a_nonlinear_remainder_is_caught_by_squares():
    rng = np.random.default_rng(0)
    u = 0.5 * rng.standard_normal((1600, 2))
    y = plant(u, strength=0.02)
    y += 0.05 * rng.standard_normal(y.shape)
    linear = LinearStateSpace(nx=2, dt=0.1, operating_point="zero").fit(
        u[:800], y[:800]
    )
    found = linear.validate(u[800:], y[800:])
    assert not found["squares"].passed
    assert found["squares"].value < 1e-10
    assert "even nonlinearity" in found["squares"].sentence
    assert not found.passed


def test_experiments_names_and_frames(true_model):
    pandas = pytest.importorskip("pandas")
    rng = np.random.default_rng(0)
    u = pandas.DataFrame(rng.standard_normal((600, 2)), columns=["fan", "heater"])
    y = plant(u.to_numpy()) + 0.1 * rng.standard_normal((600, 2))
    y = pandas.DataFrame(y, columns=["flow", "temperature"])
    label = np.repeat([3, 7], 300)
    model = LinearStateSpace(nx=2, dt=0.1, operating_point="zero").fit(u, y, label)
    found = model.validate(u, y, label)
    assert found.residuals.input_names == ["fan", "heater"]
    assert found.residuals.output_names == ["flow", "temperature"]
    frame = found.to_frame()
    assert frame.index.tolist() == [check.name for check in found]
    assert frame.loc["independence", "value"] == found["independence"].value
    assert len(found) == len(frame) == 9
    as_list = model.validate([u[:300], u[300:]], [y[:300], y[300:]])
    assert as_list["independence"].value == found["independence"].value
    with pytest.raises(KeyError, match="`name` must be one of free run, extrapolation"):
        found["colour"]


def test_data_outside_the_training_region_fail(true_model):
    u = 5 * colored(np.random.default_rng(0), (400, 2), 0.8)
    found = true_model.validate(u, plant(u), n_lags=10)
    assert not found["extrapolation"].passed
    assert found["extrapolation"].value == found.linearizability.outside > 0.5
    assert found["independence"].value == 1.0  # exact all the same


def test_a_diverging_run_fails_with_a_reason(true_model, monkeypatch):
    u = np.random.default_rng(0).standard_normal((400, 2))
    monkeypatch.setattr(
        "alssnn.validation._scored.outputs",
        lambda lure, u, x0: np.full((len(u), lure.nz), np.inf),
    )
    found = true_model.validate(u, plant(u))
    assert not found.passed
    assert found.residuals is None
    assert "diverges" in found["independence"].sentence
    assert found["free run"].value == -np.inf


def test_what_is_not_linearizable_fails_if_made_for_control():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 2))
    y = plant(u, strength=0.02) + 0.01 * rng.standard_normal((400, 2))
    model = fit(
        al_ssnn(nx=2, n_h=2, n_g=3, gamma=1e-4, max_iter=15, random_state=0), u, y
    )
    options = {"n_lags": 4, "horizons": [1]}
    found = model.validate(u, y, **options)
    record = found.linearizability
    closed = record.closed_linearization_error.max()
    error = max(record.linearization_error.max(), closed)
    check = found["linearizability"]
    assert check.value == error > 0.001
    assert check.decides
    tight = model.validate(u, y, **options, linear_within=0.5 * error)
    loose = model.validate(u, y, **options, linear_within=2 * error)
    assert not tight["linearizability"].passed and loose["linearizability"].passed


def test_a_model_without_a_law_is_not_called_linearizable():
    u = np.random.default_rng(0).standard_normal((600, 2))
    late = np.vstack([np.zeros((2, 2)), u[:-2]])
    options = {"nx": 2, "n_h": 2, "n_g": 2, "max_iter": 10, "random_state": 0}
    model = fit(al_ssnn(**options, input_delay=2), u, plant(np.tanh(late)))
    found = model.validate(u, plant(np.tanh(late)), n_lags=10)
    check = found["linearizability"]
    assert not check.passed and check.decides
    assert "There is no loop to judge." in check.sentence
    assert "2 samples ahead" in check.sentence
    assert np.isnan(found.linearizability.closed_linearization_error).all()
    for refused in (
        lambda: sine_response(model, 1.0, loop="closed", period=64),
        lambda: loop_deviation(model, u, u),
    ):
        with pytest.raises(ValueError, match="2 samples ahead"):
            refused()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"level": 2}, "`level` must be between 0 and 1"),
        ({"linear_within": 0}, "`linear_within` must be a positive share"),
        ({"horizons": [0]}, "`horizons` must be positive integers"),
        ({"horizons": [1.5]}, "`horizons` must be positive integers"),
        ({"horizons": [np.nan]}, "`horizons` must be positive integers"),
        ({"horizons": []}, "`horizons` must be positive integers"),
        ({"horizons": [300]}, "`horizons` must fit into a quarter"),
    ],
)
def test_wrong_options_of_validate(true_model, options, message):
    u = np.random.default_rng(0).standard_normal((400, 2))
    with pytest.raises(ValueError, match=message):
        true_model.validate(u, plant(u), n_lags=10, **options)


# -- predictions -----------------------------------------------------------------------


def test_predictions_of_a_true_model_are_exact(true_model):
    u = colored(np.random.default_rng(5), (400, 2), 0.8)
    y = plant(u)
    y[100:110] = np.nan
    label = np.repeat([0, 1], [250, 150])
    ahead = ahead_fit(true_model, u, y, label, horizons=[1, 7, 500])
    assert ahead.horizons.tolist() == [1, 7]
    np.testing.assert_allclose(ahead.fit, 100, atol=1e-2)
    parts = [y[:250], y[250:]]
    truth = np.vstack([z[7:] for z in parts])
    held = np.vstack([_hold(z)[:-7] for z in parts])
    ok = np.isfinite(truth[:, 0])
    error = np.linalg.norm((truth - held)[ok], axis=0)
    spread = np.linalg.norm((truth - truth[ok].mean(axis=0))[ok], axis=0)
    np.testing.assert_allclose(ahead.last_value[1], 100 * (1 - error / spread))


def _hold(z):
    out = z.copy()
    for k in range(1, len(out)):
        out[k] = np.where(np.isnan(out[k]), out[k - 1], out[k])
    return out


def test_predictions_know_late_inputs():
    u = np.random.default_rng(0).standard_normal((800, 2))
    late = np.vstack([np.zeros((4, 2)), u[:-4]])
    late[:, 1] = u[:, 1]
    y = plant(late)
    model = LinearStateSpace(nx=2, input_delay=[4, 0], operating_point="zero").fit(u, y)
    ahead = ahead_fit(model, u, y, horizons=[1, 10])
    np.testing.assert_allclose(ahead.fit, 100, atol=1e-2)
    assert model.validate(u, y)["independence"].passed


# -- finite amplitudes -----------------------------------------------------------------


def test_sine_response_of_a_linear_model_is_its_frequency_response(true_model):
    f, G = sine_response(true_model, 3.0, input=1, n_frequencies=12, period=128)
    expected = frequency_response(true_model.to_statespace(), f)[..., 1]
    np.testing.assert_allclose(G, expected, atol=1e-3 * np.abs(expected).max())
    assert f[0] == pytest.approx(1 / 12.8) and f[-1] < 5


def test_a_frequency_response_has_what_feeds_through():
    sys = control.ss([[0.5, 0.2], [0, -0.3]], np.eye(2), [[1, 2]], [[3, -4]], 0.1)
    G = frequency_response(sys, [0.7, 2.0])
    for G_f, frequency in zip(G, (0.7, 2.0), strict=True):
        np.testing.assert_allclose(G_f, sys(np.exp(0.2j * np.pi * frequency)))


@pytest.mark.parametrize(
    ("period", "n", "harmonics"),
    [(8, 40, [1, 2, 3]), (9, 40, [1, 2, 3, 4]), (64, 1, [1]), (64, 3, [1, 6, 31])],
)
def test_sines_are_harmonics_below_the_nyquist_frequency(period, n, harmonics):
    plant_ = linear_plant([[0.5]], [[1.0]])
    f, G = sine_response(plant_, 1.0, n_frequencies=n, period=period)
    np.testing.assert_allclose(f * period * plant_.dt, harmonics)
    assert np.isfinite(G).all()


@pytest.mark.parametrize(
    ("pole", "settle"), [(0.5, 1), (0.838, 2), (0.9, 2), (0.98, 8)]
)
def test_a_sine_response_waits_for_the_transient(monkeypatch, pole, settle):
    """Until 1e-4 of it is left, for at most eight periods."""
    assert settle == min(np.ceil(np.log(1e-4) / np.log(pole) / 50), 8)
    plant_ = linear_plant([[pole]], [[1.0]])
    steps, step = [], type(plant_).step
    monkeypatch.setattr(
        type(plant_), "step", lambda *args: steps.append(1) or step(*args)
    )
    f, G = sine_response(plant_, 2.0, n_frequencies=5, period=50)
    assert len(steps) == 50 * (settle + 1)
    expected = 1 / (np.exp(2j * np.pi * f) - pole)
    np.testing.assert_allclose(G[:, 0], expected, rtol=2e-3)


@pytest.mark.parametrize("pole", [1.0, 1.5, 1e9])
def test_what_never_settles_is_given_eight_periods(monkeypatch, pole):
    plant_ = linear_plant([[pole]], [[1.0]])
    steps, step = [], type(plant_).step
    monkeypatch.setattr(
        type(plant_), "step", lambda *args: steps.append(1) or step(*args)
    )
    _, G = sine_response(plant_, 2.0, n_frequencies=2, period=50)
    assert len(steps) == 50 * 9
    assert np.isnan(G).all() == (pole > 1)  # it grows, or overflows


@pytest.mark.parametrize("period", [16, 32, 64])
def test_a_sine_response_of_what_grows_slowly_is_none(period):
    """Its transient is larger than the response; a ramp is not, and has one."""
    for A, grows in ([[1.02]], True), ([[1.0, 1.0], [0.0, 1.0]], False):
        plant_ = linear_plant(A, np.eye(len(A))[:, -1:])
        _, G = sine_response(plant_, 1.0, n_frequencies=2, period=period)
        assert np.isnan(G).all() == np.isnan(G).any() == grows


def test_the_law_makes_the_response_linear_at_any_amplitude(fl_model):
    G_lin = None
    spread = {}
    for loop in ("open", "closed"):
        curves = [
            sine_response(fl_model, a, loop=loop, n_frequencies=8, period=64)
            for a in (0.1, 2.0)
        ]
        f = curves[0][0]
        G_lin = frequency_response(fl_model.to_statespace(), f)[..., 0]
        size = np.abs(G_lin).max()
        spread[loop] = max(np.abs(G - G_lin).max() / size for _, G in curves)
    assert spread["closed"] < 1e-3
    assert spread["open"] > 10 * spread["closed"]


def test_the_loop_deviates_by_what_g_makes(fl_model):
    u = np.random.default_rng(0).standard_normal((200, 2))
    (run,) = loop_deviation(fl_model, u, plant(np.tanh(u)))
    assert np.abs(run.Z).max() < 1e-9 * np.abs(run.X).max()
    rng = np.random.default_rng(0)
    y = plant(u, strength=0.02) + 0.01 * rng.standard_normal(u.shape)
    model = fit(al_ssnn(nx=2, n_h=2, n_g=3, max_iter=10, random_state=0), u, y)
    K = 0.1 * rng.standard_normal((2, 2))
    certificate = model.iss_certificate(u, y, K=K)
    (run,) = loop_deviation(model, u, y, K=K)
    omega = run.Z[1:] - run.Z[:-1] @ (model.A_ - model.B_ @ K).T
    assert 0 < np.linalg.norm(omega, axis=1).max() <= certificate.eps * (1 + 1e-9)
    assert certificate.contains(run.Z).all()


def test_the_loop_of_a_plant_with_late_inputs_is_its_own():
    u = np.random.default_rng(0).standard_normal((300, 2))
    late = np.vstack([np.zeros((2, 2)), u[:-2]])
    model = LinearStateSpace(nx=2, input_delay=2, operating_point="zero")
    model = fit(model, u, plant(late))
    K = 0.1 * np.ones((2, 2))
    (run,) = loop_deviation(model, u, plant(late), K=K)
    assert run.X.shape == (300, 6) and np.abs(run.Z).max() < 1e-12
    x, past = run.X[0, :2], [np.zeros(2), np.zeros(2)]
    for k in range(300):
        np.testing.assert_allclose(run.X[k, :2], x, atol=1e-9)
        now = u[k] - K @ x
        x = model.A_ @ x + model.B_ @ past[0]
        past = [past[1], now]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"amplitude": 0.0}, "`amplitude` must be positive"),
        ({"amplitude": np.inf}, "`amplitude` must be positive"),
        ({"input": -1}, "`input` must be between 0 and 1, got -1"),
        ({"n_frequencies": 0}, "`n_frequencies` one of at least 1, got 64 and 0"),
        ({"n_frequencies": 1.5}, "`n_frequencies` one of at least 1, got 64 and 1.5"),
        ({"input": 2}, "`input` must be between 0 and 1, got 2"),
        ({"loop": "half"}, "`loop` must be 'open' or 'closed'"),
        ({"period": 4}, "`period` must be an integer of at least 8 samples"),
        ({"period": 64.5}, "`period` must be an integer of at least 8 samples"),
    ],
)
def test_wrong_options_of_sine_response(true_model, options, message):
    with pytest.raises(ValueError, match=message):
        sine_response(true_model, **{"amplitude": 1.0, "period": 64, **options})


def test_models_that_are_not_fitted_are_refused():
    u = np.zeros((100, 2))
    for ask in (
        lambda model: model.validate(u, u),
        lambda model: scored_experiments(model, u, u),
        lambda model: sine_response(model, 1.0, period=64),
    ):
        with pytest.raises(NotFittedError):
            ask(LinearStateSpace(nx=2))


# -- short records ---------------------------------------------------------------------


@pytest.mark.parametrize("n", [60, 120, 250, 500])
def test_short_records_are_tested_with_fewer_lags(true_model, n):
    rng = np.random.default_rng(n)
    u = rng.standard_normal((n, 2))
    found = true_model.validate(u, plant(u) + 0.05 * rng.standard_normal((n, 2)))
    for name in TESTS:
        check = found[name]
        assert check.outcome in ("pass", "open")
        assert check.undecided == (not check.passed)
    lags = 0 if found.residuals is None else len(found.residuals.lags) - 1
    assert 4 <= lags <= 25 if n >= 250 else lags == 0
    assert (found.residuals is None) == (n < 250)
    assert found.passed == (n >= 250)
    assert repr(found).endswith(
        "passes." if found.passed else "independence, squares, cubes."
    )


def test_a_short_record_of_many_parameters_leaves_open_what_it_does_not_tell():
    rng = np.random.default_rng(3)
    u = rng.standard_normal((500, 2))
    y = plant(np.tanh(u)) + 0.02 * rng.standard_normal((500, 2))
    model = fit(fl_ssnn(nx=2, n_h=20, max_iter=6, random_state=0), u[:250], y[:250])
    assert model.fitted_.free.sum() > 100
    found = model.validate(u[250:], y[250:])
    assert not any(found[name].outcome == "FAIL" for name in TESTS)
    assert found.residuals.n_parameters == 0
    with pytest.raises(ValueError, match="Take fewer `n_lags`"):
        model.validate(u[250:], y[250:], n_lags=25)
    wrong = y[250:] + (y[250:] - y.mean(axis=0))  # another gain
    check = model.validate(u[250:], wrong)["independence"]
    assert check.outcome == "FAIL" and "too much for errors" in check.sentence
    lost = model.validate(u[250:330], y[250:330])
    assert [lost[name].outcome for name in TESTS] == ["open"] * 3
    assert "too short" in lost["independence"].sentence
    assert "is undecided" in lost.verdict or "fails" in lost.verdict

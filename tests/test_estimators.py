import pickle
import warnings
from functools import cache

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError

from alssnn import LinearStateSpace, datasets, nonparametric
from alssnn.datasets import make_wiener_hammerstein
from alssnn.metrics import rmse
from alssnn.models import state_space
from alssnn.simulation import simulate
from helpers import simulate_linear
from models import al_ssnn, fl_ssnn, gr_ssnn

ESTIMATORS = [
    LinearStateSpace(nx=2),
    fl_ssnn(nx=2, n_h=2, max_iter=8, tol=1e-2, random_state=0),
    al_ssnn(nx=2, n_h=2, n_g=2, max_iter=8, tol=1e-2, random_state=0),
    gr_ssnn(nx=2, n_f=2, max_iter=8, tol=1e-2, random_state=0),
    al_ssnn(
        nx=2,
        n_h=2,
        n_g=2,
        feedback="state",
        penalty="output",
        stability="contractive",
        continuation=1,
        max_iter=8,
        tol=1e-2,
        random_state=0,
    ),
]


def named(estimator):
    return f"{type(estimator).__name__}-{getattr(estimator, 'feedback', 'none')}"


@pytest.fixture(params=ESTIMATORS, ids=named)
def estimator(request):
    return clone(request.param)


@pytest.fixture(autouse=True)
def _short_fits():
    """Fits are short on purpose here; the warning has a test of its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        yield


@pytest.fixture(scope="module")
def mimo():
    """A mildly nonlinear plant with 2 inputs and 2 outputs, in odd units."""
    rng = np.random.default_rng(0)
    A = np.array([[0.7, 0.2], [-0.2, 0.6]])
    B = np.array([[0.4, 0.1], [0.0, 0.5]])
    u = rng.standard_normal((400, 2)) * [3.0, 0.02] + [10.0, -1.0]
    x, y = np.zeros(2), np.empty((400, 2))
    for k in range(400):
        y[k] = x
        drive = (u[k] - [10.0, -1.0]) / [3.0, 0.02] + 0.5 * np.tanh(x)
        x = A @ x + B @ drive + 0.05 * np.tanh(x) ** 2
    y += 0.01 * rng.standard_normal(y.shape)
    return u, y * [100.0, 0.1] + [5.0, 7.0]


@pytest.fixture(scope="module")
def fits(mimo):
    """Return how to get an estimator that is fitted, which no test changes."""
    return cache(lambda estimator: clone(estimator).fit(*mimo))


@pytest.fixture(params=ESTIMATORS, ids=named)
def fitted(request, fits):
    return fits(request.param)


@pytest.fixture
def linear(fits):
    return fits(ESTIMATORS[0])


# -- fit and predict -------------------------------------------------------------------


def test_fit_sets_documented_attributes(estimator, mimo):
    u, y = mimo
    assert estimator.fit(u, y) is estimator
    assert estimator.A_.shape == (2, 2)
    assert estimator.B_.shape == estimator.C_.shape == estimator.D_.shape == (2, 2)
    assert estimator.x0_.shape == (1, 2)
    assert estimator.n_iter_ >= 1
    assert estimator.n_features_in_ == 2
    assert isinstance(estimator.converged_, bool)
    assert estimator.cost_ > 0
    np.testing.assert_allclose(estimator.u_offset_, u.mean(axis=0))
    np.testing.assert_allclose(estimator.y_offset_, y.mean(axis=0))
    assert estimator.score(u, y) > 0.9
    documented = set(type(estimator).__doc__.split("Attributes")[1].split())
    for name in vars(estimator):
        if name.endswith("_") and not name.startswith("_"):
            assert name in documented or f"{name}," in documented, name


def test_params_are_the_equations_in_the_units_of_the_user(fitted, mimo):
    (u, y), model = mimo, fitted
    p, x = model.params_, np.zeros(2)
    y_hat = np.empty_like(y)
    for k, du in enumerate(u - model.u_offset_):
        dy = p["C"] @ x
        y_hat[k] = dy + model.y_offset_
        h, g = np.zeros(2), np.zeros(2)
        if "W_y" in p:
            h = p["W_h"] @ np.tanh(p["W_y"] @ dy + p["b_y"]) + p["b_h"]
        if "W_s" in p:
            h = p["W_h"] @ np.tanh(p["W_s"] @ x + p["b_s"]) + p["b_h"]
        if "L" in p:
            h -= p["L"] @ (dy if "W_y" in p else x)
        if "W_g" in p:
            b_g = p.get("b_g", -p["W_g"] @ np.tanh(p["b_x"]))
            g = p["W_g"] @ np.tanh(p["W_x"] @ x + p["W_u"] @ du + p["b_x"]) + b_g
        x = p["A"] @ x + p["B"] @ (du + h) + g
    np.testing.assert_allclose(model.predict(u), y_hat, rtol=1e-9)
    np.testing.assert_array_equal(model.A_, p["A"])


def test_fit_in_other_units_predicts_the_same(estimator, mimo):
    u, y = mimo
    estimator.set_params(tol=1e-12)  # or else rounding decides where training stops
    if "continuation" in estimator.get_params():
        estimator.set_params(continuation=0)  # a path of optima amplifies rounding more
    first = clone(estimator).fit(u, y).predict(u)
    second = clone(estimator).fit(10 * u, y / 3).predict(10 * u)
    # 10 and 3 change the rounding, which the undetermined state basis amplifies
    difference = (3 * second - first) / y.std(axis=0)
    np.testing.assert_allclose(difference, 0, atol=1e-4)


def test_same_seed_same_result_other_seed_other_result(estimator, mimo):
    u, y = mimo
    first, again = (clone(estimator).fit(u, y).predict(u) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    if "random_state" in estimator.get_params():
        other = clone(estimator).set_params(random_state=1).fit(u, y).predict(u)
        assert np.any(other != first)


def test_random_state_none_and_generator(mimo):
    u, y = mimo
    small = al_ssnn(nx=2, n_h=2, n_g=2, max_iter=3)
    small.set_params(random_state=np.random.RandomState(3)).fit(u, y)
    assert np.isfinite(small.cost_)


def test_pickle_and_clone(estimator, mimo):
    u, y = mimo
    model = estimator.fit(u, y)
    model.to_statespace()
    model.linearizability(u, y)
    copy = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(copy.predict(u), model.predict(u))
    assert not hasattr(clone(model), "A_")
    assert clone(model).get_params() == model.get_params()


def test_nothing_the_user_passes_in_is_modified(estimator, mimo):
    u, y = (np.array(z) for z in mimo)
    labels = np.repeat([1, 2], 200)
    before = u.copy(), y.copy(), labels.copy()
    for array in (u, y, labels):
        array.setflags(write=False)
    x0 = np.ones((2, 2))
    x0.setflags(write=False)
    model = estimator.fit(u, y, labels)
    model.predict(u, labels, x0)
    model.score(u, y, labels)
    model.linearizability(u, y, labels)
    for array, copy in zip((u, y, labels), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_one_dimensional_y_comes_back_one_dimensional(estimator, mimo):
    u, y = mimo
    model = estimator.fit(u, y[:, 0])
    assert model.predict(u).shape == (400,)
    assert clone(model).fit(u, y[:, :1]).predict(u).shape == (400, 1)


# -- several experiments and initial states --------------------------------------------


def test_every_experiment_has_its_own_initial_state(estimator, mimo):
    u, y = mimo
    labels = np.repeat(["a", "b", "c"], [100, 250, 50])
    model = estimator.fit(u, y, labels)
    assert model.x0_.shape == (3, 2)
    assert model.experiments_ == ["a", "b", "c"]
    alone = model.predict(u[100:350], x0=model.x0_[1])
    together = model.predict(u, labels, x0=model.x0_)
    np.testing.assert_allclose(together[100:350], alone, rtol=1e-12)


def test_predict_starts_at_the_operating_point(fitted, mimo):
    (u, _), model = mimo, fitted
    np.testing.assert_allclose(model.predict(u)[0], model.y_offset_)
    first = model.predict(u, x0=[1.0, 0.0])[0]
    np.testing.assert_allclose(first, model.y_offset_ + model.C_[:, 0])


def test_estimate_x0_recovers_the_state(fitted, mimo):
    (u, _), model = mimo, fitted
    truth = np.array([[0.7, -0.4], [0.1, 0.9]])
    labels = np.repeat([0, 1], 200)
    simulated = model.predict(u, labels, truth)
    np.testing.assert_allclose(
        model.estimate_x0(u, simulated, labels, n_samples=40), truth, atol=0.02
    )


def test_score_is_r2_without_the_initial_samples(estimator, mimo):
    u, y = mimo
    model = estimator.set_params(n_init_samples=20).fit(u, y)
    x0 = model.estimate_x0(u, y)
    y_hat = model.predict(u, x0=x0)
    residual, spread = (y - y_hat)[20:], (y - y[20:].mean(axis=0))[20:]
    r2 = 1 - np.sum(residual**2, axis=0) / np.sum(spread**2, axis=0)
    assert model.score(u, y) == pytest.approx(r2.mean(), rel=1e-9)


def test_score_of_a_diverging_model_is_minus_infinity(mimo):
    u, y = mimo
    model = LinearStateSpace(nx=2).fit(u, y)
    p = {**model._structure.split(model._theta), "A": 3 * np.eye(2)}
    model._theta = model._structure.join(p)
    long_u, long_y = np.tile(u, (10, 1)), np.tile(y, (10, 1))
    with pytest.warns(RuntimeWarning, match=r"diverges before sample \d+"):
        assert not np.isfinite(model.predict(long_u)).all()
    for n_init_samples in (2, 50, 3000):  # diverging behind or within the window
        model.set_params(n_init_samples=n_init_samples)
        assert model.score(long_u, long_y) == -np.inf
        # without g, whatever diverges
        assert model.linearizability(long_u, long_y).ratio_g_mean == 0


# -- limits and known systems ----------------------------------------------------------


@pytest.mark.parametrize("model", [al_ssnn(2, 0, 0), fl_ssnn(2, 0), gr_ssnn(2, 0)])
def test_no_neurons_is_the_linear_model(model, mimo):
    u, y = mimo
    linear = LinearStateSpace(nx=2).fit(u, y)
    np.testing.assert_array_equal(model.fit(u, y).predict(u), linear.predict(u))
    assert model.cost_ == linear.cost_


def test_alssnn_without_any_argument():
    record = make_wiener_hammerstein(600, random_state=0)
    model = al_ssnn(random_state=0).fit(record.u, record.y)
    assert model.score(record.u, record.y) > 0.99
    linear = LinearStateSpace().fit(record.u, record.y)
    assert 1 - model.score(record.u, record.y) < 0.1 * (
        1 - linear.score(record.u, record.y)
    )


def test_large_gamma_drives_the_residual_to_zero(mimo):
    u, y = mimo
    ratios = [
        al_ssnn(2, 2, 2, gamma=gamma, max_iter=30, random_state=0)
        .fit(u, y)
        .linearizability(u, y)
        .ratio_g_mean
        for gamma in (1e-4, 1.0, 1e4)
    ]
    assert ratios[0] > 3 * ratios[1] > 9 * ratios[2]
    assert ratios[2] < 1e-4


def test_exact_recovery_of_a_known_fl_system(rng):
    structure = state_space(2, 1, 1, n_h=2, C=np.array([[1.0, 0.5]]))
    theta = structure.join(
        {
            "A": [[0.7, 0.3], [-0.3, 0.6]],
            "B": [[0.5], [1.0]],
            "W_h": [[-0.3, 0.2]],
            "W_y": [[1.0], [0.4]],
            "b_y": [0.3, -0.6],
        }
    )
    u = 2 * rng.standard_normal((2000, 1))
    y = (
        simulate(structure.lure(theta), u, np.zeros(2))[:-1]
        @ structure.constants["C"][0]
    )
    model = fl_ssnn(
        nx=2, n_h=2, n_init=6, tol=1e-14, operating_point="zero", random_state=0
    ).fit(u[:1000], y[:1000])
    error = y[1000:] - model.predict(u[1000:], x0=model.estimate_x0(u[1000:], y[1000:]))
    assert np.sqrt(np.mean(error**2)) < 1e-5 * y.std()


@pytest.mark.parametrize("penalty", ["state", "output"])
def test_a_contraction_is_kept_and_makes_P_equal_to_the_identity(mimo, penalty):
    u, y = mimo
    model = al_ssnn(
        2,
        3,
        3,
        penalty=penalty,
        stability="contractive",
        phi=0.2,
        max_iter=30,
        random_state=0,
    ).fit(u, y)
    # V(x) = x'x falls by the share phi along the linear part, and the inequality with
    # P = I and any psi above its bound has no positive eigenvalue
    A, n = model.A_, 2
    assert np.linalg.eigvalsh(A.T @ A).max() <= 0.8 + 1e-12
    psi, phi = 1e4, 0.2 - 1e-3
    lmi = np.block([[A.T @ A + (phi - 1) * np.eye(n), A.T], [A, (1 - psi) * np.eye(n)]])
    assert np.linalg.eigvalsh(lmi).max() < 0
    assert model.score(u, y) > 0.9


@pytest.fixture
def bounded(rng):
    """An unstable linear plant, kept bounded by a saturating feedback inside it."""
    u = rng.standard_normal((600, 1))
    x, y = 0.0, np.empty(600)
    for k in range(600):
        y[k] = x
        x = 1.3 * x - 0.9 * np.tanh(2 * x) + 0.3 * u[k, 0]
    return u, y


def test_an_unstable_linear_part_is_reported(bounded):
    u, y = bounded
    with pytest.warns(
        ConvergenceWarning, match=r"unstable, spectral radius.*contractive"
    ):
        model = fl_ssnn(
            1, 2, max_iter=100, n_init=3, linear_part="trained", random_state=0
        ).fit(u, y)
    assert np.abs(np.linalg.eigvals(model.A_)).max() > 1
    assert model.score(u, y) > 0.99


def linear_share(model, u, y):
    """Return the size of the linear part of h over a record, relative to that of h."""
    law = model.linearizing_law()
    x0 = model.estimate_x0(u, y)[0]
    X = simulate(model.plant_.lure, u - model.u_offset_, x0)[:-1]
    s = X if law.feedback == "state" else X @ model.C_.T
    h = -law(np.zeros_like(u), s if law.feedback == "state" else s + model.y_offset_)
    L = np.linalg.lstsq(s, h, rcond=None)[0]
    scale = model._scaling.u_scale
    return np.linalg.norm(s @ L / scale) / np.linalg.norm(h / scale)


@pytest.mark.parametrize("feedback", ["output", "state"])
def test_a_weight_of_h_leaves_what_is_linear_to_A(bounded, mimo, feedback):
    # the milder the nonlinearity, the larger the weight that h needs to notice
    strong = bounded, 1e-3, {"nx": 1, "n_init": 3}
    mild = mimo, 0.1, {"nx": 2, "n_h": 6}
    for (u, y), weight, sizes in (strong, mild):
        options = {"feedback": feedback, "max_iter": 50, "random_state": 0}
        options["linear_part"] = "trained"
        model = fl_ssnn(**{"n_h": 2, **options, **sizes})
        shares, scores = [], []
        for gamma_h in (0.0, weight):
            model.set_params(gamma_h=gamma_h).fit(u, y)
            shares.append(linear_share(model, u, y))
            scores.append(model.score(u, y))
        assert shares[0] > 0.9 and shares[1] < 0.05
        assert scores[1] > scores[0] - 1e-3
        assert np.abs(np.linalg.eigvals(model.A_)).max() < 1


def test_a_large_weight_of_h_leaves_the_linear_model(mimo):
    u, y = mimo
    options = {"nx": 2, "n_h": 2, "max_iter": 60, "random_state": 0}
    scores = [fl_ssnn(gamma_h=w, **options).fit(u, y).score(u, y) for w in (0.0, 1e6)]
    linear = LinearStateSpace(nx=2).fit(u, y).score(u, y)
    assert scores[1] == pytest.approx(linear, abs=1e-3)
    assert scores[0] > linear + 1e-3


# -- training options ------------------------------------------------------------------


def test_warm_start_continues(mimo):
    u, y = mimo
    model = al_ssnn(2, 2, 2, max_iter=4, warm_start=True, random_state=0).fit(u, y)
    first = model.cost_
    assert model.fit(u, y).cost_ < first
    cold = clone(model).set_params(warm_start=False).fit(u, y)
    assert cold.cost_ == first
    # another structure cannot be continued and starts anew
    assert model.set_params(n_g=3).fit(u, y).params_["W_g"].shape == (2, 3)


@pytest.mark.parametrize("n", [0, 2])
def test_warm_start_begins_anew_with_other_signals(mimo, n):
    u, y = mimo
    model = al_ssnn(2, n, n, max_iter=4, warm_start=True, random_state=0).fit(u, y)
    for signals in ((u[:, :1], y), (u, y[:, :1]), (u, y[:, 0])):
        cold = clone(model).set_params(warm_start=False).fit(*signals)
        if signals[1].ndim > 1:
            assert model.fit(*signals).cost_ == cold.cost_
        else:  # the same as before, and goes on
            assert 0.99 * cold.cost_ < model.fit(*signals).cost_ <= cold.cost_
        assert model.D_.shape == cold.D_.shape
        np.testing.assert_array_equal(model.y_offset_, cold.y_offset_)


@pytest.mark.parametrize("point", ["zero", ([0.1, 0.2], [0.3, 0.4])])
def test_warm_start_begins_anew_at_another_operating_point(mimo, point):
    u, y = mimo
    model = al_ssnn(2, 2, 2, max_iter=2, warm_start=True, random_state=0).fit(u, y)
    model.set_params(operating_point=point)
    cold = clone(model).set_params(warm_start=False).fit(u, y)
    model.fit(u, y)
    np.testing.assert_array_equal(model.u_offset_, cold.u_offset_)
    np.testing.assert_array_equal(model.y_offset_, cold.y_offset_)
    np.testing.assert_array_equal(model.predict(u), cold.predict(u))
    steps = len(model.fit(u, y).history_)  # and goes on at the same one
    assert model.history_[0].cost <= cold.cost_ * (1 + 1e-9) and steps > 0


def test_warm_start_begins_anew_where_A_is_no_contraction(mimo):
    u, y = mimo
    model = al_ssnn(2, 2, 2, max_iter=4, warm_start=True, random_state=0).fit(u, y)
    for phi in (0.05, 0.6):
        model.set_params(stability="contractive", phi=phi).fit(u, y)
        A = model.A_ / model._x_scale[:, None] * model._x_scale
        assert np.linalg.norm(A, 2) <= np.sqrt(1 - phi) * (1 + 1e-12)


def test_restarts_do_not_depend_on_n_jobs(mimo):
    u, y = mimo
    small = al_ssnn(2, 2, 2, max_iter=4, n_init=3, random_state=0)
    alone = clone(small).fit(u, y)
    pair = clone(small).set_params(n_jobs=2).fit(u, y)
    np.testing.assert_array_equal(alone.predict(u), pair.predict(u))
    assert alone.cost_ <= clone(small).set_params(n_init=1).fit(u, y).cost_


def test_weight_decay_shrinks_the_networks(mimo):
    u, y = mimo
    sizes = []
    for alpha in (0.0, 0.1):
        model = al_ssnn(2, 2, 2, alpha=alpha, max_iter=20, random_state=0).fit(u, y)
        sizes.append(sum(np.sum(model.params_[k] ** 2) for k in ("W_h", "W_g")))
    assert sizes[1] < 0.5 * sizes[0]


@pytest.mark.parametrize("method", ["lm", "trf"])
def test_methods_reach_the_same_cost_level(mimo, method):
    u, y = mimo
    model = fl_ssnn(2, 2, method=method, max_iter=60, random_state=0).fit(u, y)
    assert model.score(u, y) > 0.99


def test_verbose_prints_progress(mimo, capsys):
    u, y = mimo
    al_ssnn(2, 1, 1, max_iter=3, random_state=0).fit(u, y)
    assert capsys.readouterr().out == ""
    al_ssnn(2, 1, 1, max_iter=3, random_state=0, verbose=2).fit(u, y)
    out = capsys.readouterr().out
    assert "linear" in out
    assert "train" in out
    assert "cost" in out


def test_stopping_early_is_a_convergence_warning(mimo):
    u, y = mimo
    with pytest.warns(ConvergenceWarning, match=r"AlSsnn stopped.*Increase `max_iter`"):
        model = al_ssnn(2, 2, 2, max_iter=2, random_state=0).fit(u, y)
    assert not model.converged_


# -- exports ---------------------------------------------------------------------------


def test_to_statespace_has_units_dt_and_names(estimator, mimo):
    u, y = mimo
    u = pd.DataFrame(u, columns=["valve.a", "pump"])
    y = pd.DataFrame(y, columns=["level", "flow"])
    model = estimator.set_params(dt=0.25).fit(u, y)
    sys = model.to_statespace()
    assert sys.dt == 0.25
    assert sys.input_labels == ["valve_a", "pump"]  # "." separates systems there
    assert sys.output_labels == ["level", "flow"]
    np.testing.assert_allclose(sys.A, model.A_, rtol=1e-12)  # L goes and comes back
    np.testing.assert_array_equal(sys.B, model.B_)
    np.testing.assert_array_equal(sys.C, model.C_)
    assert not np.any(sys.D)


def test_linear_model_and_its_statespace_respond_alike(mimo):
    u, y = mimo
    model = LinearStateSpace(nx=2).fit(u, y)
    sys = model.to_statespace()
    response = simulate_linear(sys.A, sys.B, sys.C, u - model.u_offset_)
    np.testing.assert_allclose(model.predict(u), response + model.y_offset_, rtol=1e-9)


def test_names_without_dataframes(mimo):
    u, y = mimo
    sys = LinearStateSpace(nx=2).fit(u, y).to_statespace()
    assert sys.input_labels == ["u[0]", "u[1]"]
    series = LinearStateSpace(nx=2).fit(u, pd.Series(y[:, 0], name="level"))
    assert series.to_statespace().output_labels == ["level"]


def test_linearizability_of_models_without_residual(mimo):
    u, y = mimo
    fl = fl_ssnn(2, 2, max_iter=20, random_state=0).fit(u, y).linearizability(u, y)
    np.testing.assert_allclose(fl.linearization_error, 0, atol=1e-12)
    assert fl.ratio_h_mean > 1e-3
    linear = LinearStateSpace(nx=2).fit(u, y).linearizability(u, y)
    assert linear.ratio_h_max == 0
    assert linear.spectral_radius < 1


@pytest.mark.parametrize("feedback", ["output", "state"])
def test_linearizability_in_the_units_of_the_user(mimo, feedback):
    u, y = mimo
    model = al_ssnn(2, 2, 2, gamma=0.01, max_iter=20, random_state=0, feedback=feedback)
    record = model.fit(u, y).linearizability(u, y)
    p, du = model.params_, u - model.u_offset_
    for closed in (False, True):
        x = model.estimate_x0(u, y)[0]
        x_linear, e, omega = x.copy(), np.empty_like(y), np.empty(len(u))
        y_linear = np.empty_like(y)
        for k in range(len(u)):
            dy, y_linear[k] = p["C"] @ x, p["C"] @ x_linear
            e[k] = dy - y_linear[k]
            if feedback == "output":
                h = p["W_h"] @ np.tanh(p["W_y"] @ dy + p["b_y"]) + p["b_h"]
            else:
                h = p["W_h"] @ np.tanh(p["W_s"] @ x + p["b_s"]) + p["b_h"]
            u_k = du[k] - h if closed else du[k]
            pre = p["W_x"] @ x + p["W_u"] @ u_k + p["b_x"]
            g = p["W_g"] @ (np.tanh(pre) - np.tanh(p["b_x"]))
            omega[k] = np.linalg.norm(g)
            x = p["A"] @ x + p["B"] @ (u_k + h) + g
            x_linear = p["A"] @ x_linear + p["B"] @ (u_k + h)  # the same input, no g
        e_rms = np.sqrt(np.mean(e**2, axis=0))
        if closed:
            expected = e_rms / y_linear.std(axis=0)
            error = record.closed_linearization_error
            assert record.closed_omega_max == pytest.approx(omega.max(), rel=1e-6)
        else:
            expected = e_rms / y.std(axis=0)
            error = record.linearization_error
            np.testing.assert_allclose(record.e / y.std(axis=0), e / y.std(axis=0))
        np.testing.assert_allclose(error, expected, rtol=1e-6)


def test_linearizability_knows_the_sampling_time_and_the_names(mimo):
    u, y = mimo
    y = pd.DataFrame(y, columns=["level", "flow"])
    record = LinearStateSpace(nx=2, dt=0.25).fit(u, y).linearizability(u, y)
    assert record.bands.edges[-1] == 2.0
    assert record.output_names == ["level", "flow"]


def test_training_data_are_inside_their_region(estimator, mimo):
    u, y = mimo
    model = estimator.fit(u, y)
    record = model.linearizability(u, y)
    assert record.outside <= 0.01  # initial states are estimated anew
    wide = model.linearizability(3 * (u - u.mean(axis=0)) + u.mean(axis=0), y)
    assert wide.outside > 0.3
    assert np.isfinite(record.to_frame()["value"]).all()


def test_experiments_are_measured_together(mimo):
    u, y = mimo
    model = al_ssnn(2, 2, 2, max_iter=8, random_state=0).fit(u, y)
    parts = [slice(0, 150), slice(150, 400)]
    single = [model.linearizability(u[part], y[part]) for part in parts]
    both = model.linearizability(u, y, np.repeat([0, 1], [150, 250]))
    np.testing.assert_allclose(both.e, np.vstack([record.e for record in single]))
    dy = y - y.mean(axis=0)
    expected = np.sqrt(np.sum(both.e**2, axis=0) / np.sum(dy**2, axis=0))
    np.testing.assert_allclose(both.linearization_error, expected)
    mean = np.average([r.ratio_g_mean for r in single], weights=[150, 250])
    assert both.ratio_g_mean == pytest.approx(mean)


def test_states_that_only_the_cost_needs_change_no_measure(mimo):
    u, y = mimo
    model = al_ssnn(2, 2, 2, max_iter=8, random_state=0).fit(u, y)
    plain = model.linearizability(u, y)
    model._structure = state_space(
        2, 2, 2, n_h=2, n_g=2, C=model._structure.constants["C"]
    ).observe("y", "e")
    extended = model.linearizability(u, y)
    np.testing.assert_allclose(extended.e, plain.e, rtol=1e-9, atol=1e-12)
    assert extended.closed_ratio_max == pytest.approx(plain.closed_ratio_max)


# -- errors ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda u, y: (u, y[:-1]), "got 400 and 399, inconsistent numbers of samples"),
        (lambda u, y: (np.where(u > 14, np.nan, u), y), "`u` must not contain NaN"),
        (lambda u, y: (u, np.where(y > 80, np.inf, y)), "Input y contains infinity"),
        (lambda u, y: (0 * u + 1, y), "constant column 0, 1"),
        (lambda u, y: (u[:9], y[:9]), "at least 10 samples .*got 9"),
        (
            lambda u, y: (u.astype(object) + "V", y),
            "could not convert|dtype|unsupported",
        ),
    ],
)
def test_data_errors(mimo, change, message):
    with pytest.raises((ValueError, TypeError), match=message):
        LinearStateSpace(nx=4).fit(*change(*(np.array(z) for z in mimo)))


def test_non_numeric_data(mimo):
    u, y = mimo
    words = np.full(u.shape, "high", dtype=object)
    with pytest.raises(ValueError, match="could not convert string to float"):
        LinearStateSpace(nx=2).fit(words, y)


def test_wrong_column_names(mimo):
    u, y = mimo
    model = LinearStateSpace(nx=2).fit(pd.DataFrame(u, columns=["a", "b"]), y)
    with pytest.raises(ValueError, match="feature names should match"):
        model.predict(pd.DataFrame(u, columns=["a", "c"]))
    with pytest.raises(ValueError, match="expecting 2 features"):
        LinearStateSpace(nx=2).fit(u, y).predict(u[:, :1])


def test_wrong_labels(mimo):
    u, y = mimo
    with pytest.raises(ValueError, match="one label per sample"):
        LinearStateSpace(nx=2).fit(u, y, np.zeros(3))
    labels = np.repeat([1, 2, 1], [100, 200, 100])
    with pytest.raises(ValueError, match="contiguous"):
        LinearStateSpace(nx=2).fit(u, y, labels)


@pytest.mark.parametrize("x0", [np.zeros(3), np.zeros((2, 2)), 1.0])
def test_x0_of_wrong_size(mimo, x0):
    u, y = mimo
    model = LinearStateSpace(nx=2).fit(u, y)
    with pytest.raises(ValueError, match=r"`x0` must have shape \(2,\).*estimate_x0"):
        model.predict(u, x0=x0)


@pytest.mark.parametrize(
    "call",
    ["score", "simulate_test", "estimate_x0", "linearizability", "predict_ahead"],
)
def test_outputs_of_another_number_are_refused(mimo, linear, call):
    u, y = mimo
    labels = np.repeat([0, 1], len(u) // 2)
    for wrong in (y[:, 0], y[:, :1], np.hstack([y, y[:, :1]])):
        with pytest.raises(ValueError, match=r"`y` must have the outputs .* 2, got"):
            getattr(linear, call)(u, wrong, experiment=labels)


def test_x0_and_its_samples_are_checked(mimo):
    u, y = mimo
    model = LinearStateSpace(nx=2).fit(u, y)
    with pytest.raises(ValueError, match="`x0` must be finite"):
        model.predict(u, x0=[0.0, np.nan])
    for n_samples in (0, -5, 2.5):
        with pytest.raises(ValueError, match="`n_samples` must be a positive integer"):
            model.estimate_x0(u, y, n_samples=n_samples)


def test_unfitted(estimator, mimo):
    u, y = mimo
    for call in (
        lambda: estimator.predict(u),
        lambda: estimator.score(u, y),
        lambda: estimator.estimate_x0(u, y),
        lambda: estimator.to_statespace(),
        lambda: estimator.linearizability(u, y),
        lambda: estimator.validate(u, y),
        lambda: estimator.prepare_records(u, y),
    ):
        with pytest.raises(NotFittedError):
            call()


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"nx": 0}, "nx"),
        ({"nx": "many"}, "nx"),
        ({"n_h": -1}, "n_h"),
        ({"gamma": -1.0}, "gamma"),
        ({"dt": 0.0}, "dt"),
        ({"method": "adam"}, "method"),
        ({"operating_point": "median"}, "operating_point"),
        ({"operating_point": (1.0,)}, r"pair \(u_e, y_e\), got a tuple of 1"),
        ({"max_iter": 0}, "max_iter"),
        ({"feedback": "input"}, "feedback"),
        ({"penalty": "both"}, "penalty"),
        ({"stability": "hurwitz"}, "stability"),
        ({"phi": 1.0}, "phi"),
        ({"continuation": -1}, "continuation"),
    ],
)
def test_parameters_are_validated_in_fit(mimo, parameters, message):
    u, y = mimo
    with pytest.raises(ValueError, match=message):
        al_ssnn(**parameters).fit(u, y)


def test_records_are_prepared_in_one_way(mimo):
    u, y = (np.copy(z) for z in mimo)
    y[20:25, 0] = np.nan
    labels = np.repeat([3, 1], [len(u) - 100, 100])
    model = LinearStateSpace(nx=2, input_delay=[0, 2]).fit(u, y, labels)
    records = model.prepare_records(u, y, labels)
    assert [record.part for record in records] == [
        slice(0, len(u) - 100),
        slice(len(u) - 100, len(u)),
    ]
    for record in records:
        n = len(record.y)
        assert record.start == min(model.n_init_samples, n // 4)
        assert record.scored == slice(record.start, n)
        np.testing.assert_array_equal(record.u, u[record.part])
        np.testing.assert_array_equal(record.y, y[record.part])
        x0 = model.estimate_x0(record.u, record.y, n_samples=record.start)
        np.testing.assert_array_equal(record.x0, x0[0])
        arrived = record.u - model.u_offset_
        arrived[2:, 1], arrived[:2, 1] = arrived[:-2, 1].copy(), 0.0
        np.testing.assert_allclose(record.du, arrived, atol=1e-12)
        np.testing.assert_allclose(record.dy, record.y - model.y_offset_)
        y_hat = model.predict(record.u, x0=record.x0)
        _, scored = model.simulate_test(record.u, record.y)
        np.testing.assert_array_equal(scored, y_hat[record.scored])
    with pytest.raises(AttributeError):
        record.start = 0


def test_what_a_fit_found_is_a_value(mimo):
    model = fl_ssnn(2, 2, max_iter=3, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(*mimo)
    fitted = model.fitted_
    p = fitted.structure.rescale(
        fitted.structure.split(fitted.theta),
        {"u": fitted.scaling.u_scale, "y": fitted.scaling.y_scale, "x": fitted.x_scale},
    )
    np.testing.assert_allclose(p["A"], model.A_)
    np.testing.assert_allclose(fitted.x0 * fitted.x_scale, model.x0_)
    assert fitted.free.all() and len(fitted.free) == len(fitted.theta)
    assert fitted.cost == model.cost_ and not fitted.at_rest and fitted.for_control
    with pytest.raises(AttributeError):
        fitted.cost = 0.0
    with pytest.raises(NotFittedError):
        assert fl_ssnn().fitted_


@pytest.mark.parametrize(("n", "start"), [(16, 4), (40, 10), (1000, 50)])
def test_at_most_a_quarter_of_an_experiment_is_spent_on_its_initial_state(
    mimo, n, start
):
    u, y = mimo
    u, y = np.resize(u, (n, u.shape[1])), np.resize(y, (n, y.shape[1]))
    model = LinearStateSpace(nx=2).fit(*mimo)
    assert [record.start for record in model.prepare_records(u, y)] == [start]
    assert len(model.simulate_test(u, y)[0]) == n - start


def test_a_warm_start_of_another_order_begins_anew(mimo):
    u, y = mimo
    model = al_ssnn(2, 2, 2, max_iter=4, warm_start=True, random_state=0).fit(u, y)
    model.set_params(nx=3).fit(u, y)
    cold = clone(model).set_params(warm_start=False).fit(u, y)
    assert model.nx_ == 3
    np.testing.assert_array_equal(model.A_, cold.A_)


def test_outputs_of_another_order_are_refused(mimo):
    u, y = mimo
    y = pd.DataFrame(y, columns=["level", "flow"])
    model = LinearStateSpace(nx=2).fit(u, y)
    with pytest.raises(ValueError, match="in this order"):
        model.score(u, y[["flow", "level"]])
    with pytest.raises(ValueError, match="in this order"):
        model.estimate_x0([u, u], [y[["flow", "level"]]] * 2)
    assert model.score(u, y) == model.score(u, y.to_numpy())


def test_what_is_masked_was_not_measured(mimo):
    u, y = mimo
    mask = np.zeros(y.shape, dtype=bool)
    mask[::7, 0] = True
    hidden = np.ma.array(np.where(mask, -9999.0, y), mask=mask)
    bare = LinearStateSpace(nx=2).fit(u, np.where(mask, np.nan, y))
    masked = LinearStateSpace(nx=2).fit(u, hidden)
    np.testing.assert_array_equal(masked.A_, bare.A_)
    assert masked.score(u, hidden) == bare.score(u, np.where(mask, np.nan, y))
    several = LinearStateSpace(nx=2).fit([u, u], [hidden, hidden])
    np.testing.assert_array_less(np.abs(several.y_offset_), 100.0)
    gaps = np.ma.array(u, mask=np.arange(u.size).reshape(u.shape) == 5)
    with pytest.raises(ValueError, match="`u`"):
        LinearStateSpace(nx=2).fit(gaps, y)


def test_masks_are_gaps_for_all_that_takes_outputs(mimo):
    u, y = mimo
    mask = np.zeros(y.shape, dtype=bool)
    mask[[3, 200], 0] = True
    hidden = np.ma.array(np.where(mask, -9999.0, y), mask=mask)
    gaps = np.where(mask, np.nan, y)
    model = LinearStateSpace(nx=2).fit(u, y)
    y_hat, observer = model.predict(u), model.observer()
    for take in (
        lambda y: rmse(y, y_hat, multioutput="raw_values"),
        lambda y: datasets.Record(u, y, dt=1.0).y,
        lambda y: observer.filter(u, y),
        lambda y: nonparametric.local_polynomial(u, y, dt=1.0).total_rms,
        lambda y: model.estimate_x0(u, y),
    ):
        np.testing.assert_array_equal(take(hidden), take(gaps))
        assert hidden.data[3, 0] == -9999.0  # left as it was

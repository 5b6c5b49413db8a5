"""Models that are fitted by their errors one sample ahead: noise="innovations"."""

import warnings
from dataclasses import replace

import control
import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import Bunch

import alssnn
from alssnn.criterion import Criterion
from alssnn.datasets import make_inverted_pendulum
from alssnn.estimators import _horizon, _ssnn
from alssnn.feedback import DisturbanceObserver, Observer, closed_loop, lqi
from alssnn.innovations import (
    free_run,
    has_innovations,
    predictor,
    recording,
    with_outputs,
)
from alssnn.models import state_space
from alssnn.optimizers import minimize
from alssnn.sections import Sections
from alssnn.simulation import outputs, simulate
from alssnn.stability import Contractive, Schur
from alssnn.subspace import identify_linear, predictor_space, shift_structure
from alssnn.training import train
from helpers import assert_direct

pytestmark = pytest.mark.filterwarnings(
    "ignore::sklearn.exceptions.ConvergenceWarning"  # short fits are enough
)

A = np.array([[1.6, -0.8], [1.0, 0.0]])
B = np.array([1.0, 0.0])
C = np.array([0.15, 0.1])
OPTIONS = {
    "linear": {},
    "FL, measured": {"n_h": 3, "feedback": "output", "h_sees": "measured"},
    "FL, predicted": {"n_h": 3, "feedback": "output"},
    "FL of x": {"n_h": 3, "feedback": "state"},
    "AL": {"n_h": 3, "n_g": (2, 3), "n_k": 2, "feedthrough": True},
    "AL, given": {
        "n_h": 2,
        "n_g": 2,
        "feedback": "output",
        "h_sees": "measured",
        "feedthrough": True,
        "disturbances": (1,),
    },
    "monotone": {
        "n_h": 3,
        "feedback": "output",
        "h_sees": "measured",
        "input_map": "monotone",
    },
}


def h(y):
    return -0.8 * np.tanh(2 * y) + 0.4 * y


def make_record(n=1200, *, gain=0.4, process=0.5, noise=0.01, h=h, seed=0):
    """Return a record of x+ = A x + B (u + h(y) + w), y = C x, u = r - gain y."""
    rng = np.random.default_rng(seed)
    r = np.repeat(rng.uniform(-1.5, 1.5, n // 8 + 1), 8)[:n]
    x, u, y = np.zeros(2), np.empty(n), np.empty(n)
    for k in range(n):
        y[k] = C @ x + noise * rng.standard_normal()
        u[k] = r[k] - gain * y[k]
        x = A @ x + B * (u[k] + h(C @ x) + process * rng.standard_normal())
    return u, y


def nothing(y):
    return 0.0 * y


def true_loop(model, n=1000):
    """Return the deviation of the loop with the true plant, without noise."""
    rng = np.random.default_rng(99)
    v = np.repeat(rng.uniform(-1.5, 1.5, n // 8 + 1), 8)[:n, None]
    plant = model.plant_
    A_m, B_m, C_m, _ = plant.linear()
    x, x_m, y, y_m = np.zeros(2), np.zeros(len(A_m)), np.empty(n), np.empty(n)
    for k in range(n):
        y[k], y_m[k] = C @ x, (C_m @ x_m)[0] + plant.y_offset[0]
        u = plant.law(v[k], y[k : k + 1])[0]
        x, x_m = A @ x + B * (u + h(y[k])), A_m @ x_m + B_m @ (v[k] - plant.v_offset)
    return np.std(y - y_m) / np.std(y)


def declared(name, nx=3, nu=2, ny=2):
    """Return the free run of a model with random parameters."""
    rng = np.random.default_rng(0)
    options = OPTIONS[name]
    C_m = rng.standard_normal((ny, nx)) if options else None
    structure = state_space(nx, nu, ny, C=C_m, noise="innovations", **options)
    theta = 0.3 * rng.standard_normal(structure.n_params)
    return structure, theta, C_m


@pytest.fixture(scope="module")
def loop_record():
    return make_record()


@pytest.fixture(scope="module")
def linear(loop_record):
    return alssnn.LinearStateSpace(nx=2, noise="innovations").fit(*loop_record)


@pytest.mark.parametrize("name", OPTIONS)
def test_free_run_is_the_model_without_noise(name):
    structure, theta, C_m = declared(name)
    options = {k: v for k, v in OPTIONS[name].items() if k != "h_sees"}
    plain = state_space(3, 2, 2, C=C_m, **options)
    assert has_innovations(structure) and not has_innovations(plain)
    expected = plain.lure(plain.join(structure.split(theta))).Theta
    np.testing.assert_array_equal(structure.lure(theta).Theta, expected)
    seen = predictor(structure)
    assert seen.inputs == ("u", "y_m") and structure.inputs == ("u",)
    np.testing.assert_array_equal(free_run(seen).lure(theta).Theta, expected)
    assert predictor(seen) is seen and free_run(structure) is structure
    assert predictor(plain) is plain and free_run(plain) is plain


@pytest.mark.parametrize("name", OPTIONS)
def test_predictor_is_the_free_run_corrected_by_K_eps(name):
    structure, theta, _ = declared(name)
    seen = predictor(structure).observe("y")
    rng = np.random.default_rng(1)
    x, u, y_m = rng.standard_normal(3), rng.standard_normal(2), rng.standard_normal(2)
    p, lure = structure.split(theta), seen.lure(theta)
    plain = structure.observe("y").lure(theta)
    y = outputs(plain, u[None], x)[0]
    # told what it predicts, a predictor is the free run
    told = simulate(lure, np.r_[u, y][None], x)[1]
    np.testing.assert_allclose(told, simulate(plain, u[None], x)[1], atol=1e-13)
    moved = simulate(lure, np.r_[u, y_m][None], x)[1] - told
    if OPTIONS[name].get("h_sees") != "measured":
        np.testing.assert_allclose(moved, p["K"] @ (y_m - y), atol=1e-13)
    else:
        assert np.linalg.norm(moved - p["K"] @ (y_m - y)) > 1e-3


@pytest.mark.parametrize("name", OPTIONS)
def test_derivative_of_a_predictor(name, rng):
    structure, theta, _ = declared(name)
    assert_direct(predictor(structure), theta, rng)
    if "e" in structure.signals:
        assert_direct(predictor(structure).observe("y", "e"), theta, rng)


@pytest.mark.parametrize("kind", ["contractive", "schur"])
def test_stability_is_that_of_the_predictor(kind):
    structure, theta, _ = declared("AL")
    seen = predictor(structure)
    rng = np.random.default_rng(0)
    pairs = [(rng.standard_normal((30, 2)), rng.standard_normal((30, 2)))]
    criterion = Criterion(seen, with_outputs(pairs))
    p = dict(structure.split(theta))
    C_m = structure.constants["C"]
    p["A"] = 0.3 * np.eye(3) + 2.0 * C_m.T @ C_m  # the plant may be unstable
    p["K"] = 2.0 * C_m.T
    assert np.abs(np.linalg.eigvals(p["A"])).max() > 1
    free = criterion.join(structure.join(p), np.zeros((1, 3)))
    assert np.linalg.norm(p["A"] - p["K"] @ C_m, 2) < 1
    if kind == "schur":
        assert Schur(criterion, 1.0).norm(free) == criterion.norm(free)
        p["K"] = 0.0 * p["K"]
        outside = criterion.join(structure.join(p), np.zeros((1, 3)))
        assert Schur(criterion, 1.0).norm(outside) > 1e6
        return
    problem = Contractive(criterion, 1e-5)
    Q = problem.from_free(free)
    np.testing.assert_allclose(problem.to_free(Q), free, atol=1e-10)
    moved = problem.to_free(Q + 0.3 * rng.standard_normal(len(Q)))
    q = structure.split(moved[: structure.n_params])
    assert np.linalg.norm(q["A"] - q["K"] @ C_m, 2) < 1
    JJ, Jr, _ = problem.normal_equations(Q)
    gradient = np.empty(len(Q))
    for i, one in enumerate(np.eye(len(Q))):
        up, down = (problem.norm(Q + s * 1e-6 * one) ** 2 for s in (1, -1))
        gradient[i] = (up - down) / 4e-6
    np.testing.assert_allclose(Jr, gradient, atol=1e-6 * np.abs(gradient).max())
    np.testing.assert_allclose(JJ, JJ.T, atol=1e-12 * np.abs(JJ).max())


def test_linear_start_is_exact_for_a_noisy_predictor_without_error():
    rng = np.random.default_rng(0)
    K = np.array([0.5, 0.2])
    u, eps = rng.standard_normal((2, 4000))
    x, y = np.zeros(2), np.empty(4000)
    for k in range(4000):  # an innovation of one in a million
        y[k] = C @ x + 1e-6 * eps[k]
        x = A @ x + B * u[k] + K * 1e-6 * eps[k]
    pairs = with_outputs([(u[:, None], y[:, None])])
    U, s = predictor_space(pairs, 40, n_measured=1)
    A_K, _ = shift_structure(U, s, 2, 1)
    poles = np.sort_complex(np.linalg.eigvals(A_K))
    expected = np.sort_complex(np.linalg.eigvals(A - np.outer(K, C)))
    np.testing.assert_allclose(poles, expected, atol=0.02)
    model = identify_linear(pairs, 2, n_measured=1)
    p = model.by_name()
    assert model.nu == 1
    np.testing.assert_allclose(np.linalg.eigvals(p["A"]), np.linalg.eigvals(A), 1e-5)
    again = model.with_matrices(p, ())
    np.testing.assert_allclose(again.B, model.B)
    np.testing.assert_allclose(again.A, model.A)


def test_feedback_and_process_noise_do_not_bias_a_linear_model():
    poles = np.sort_complex(np.linalg.eigvals(A))
    errors = {"output": [], "innovations": []}
    for seed in range(6):
        u, y = make_record(1500, gain=0.8, h=nothing, seed=seed)
        for noise, found in errors.items():
            model = alssnn.LinearStateSpace(nx=2, noise=noise).fit(u, y)
            found.append(np.sort_complex(np.linalg.eigvals(model.A_)) - poles)
    bias = {noise: np.abs(np.mean(found, axis=0)[0]) for noise, found in errors.items()}
    assert bias["innovations"] < bias["output"] / 3
    assert not np.any(model.D_)


def test_law_of_a_nonlinear_plant_in_a_loop_with_process_noise(loop_record):
    options = {"nx": 2, "n_h": 4, "feedback": "output", "n_init": 1, "random_state": 0}
    models = {
        noise: alssnn.FlSsnn(alpha=1e-5, noise=noise, **options).fit(*loop_record)
        for noise in ("output", "innovations")
    }
    errors = {noise: true_loop(model) for noise, model in models.items()}
    assert errors["innovations"] < 0.12
    assert errors["innovations"] < errors["output"] / 2
    assert models["innovations"].h_sees_ == "measured"
    fitted = models["innovations"]
    eps = loop_record[1] - fitted.predict_ahead(*loop_record)
    assert abs(np.corrcoef(eps[1:], eps[:-1])[0, 1]) < 0.06
    np.testing.assert_allclose(fitted.noise_covariance_, eps[50:].var(), rtol=0.05)


@pytest.mark.parametrize("h_sees", ["measured", "predicted"])
def test_the_weight_that_splits_what_h_and_K_say(
    h_sees, loop_record, linear, monkeypatch
):
    asked = []

    def recorded(*args, weights, **options):
        asked.append(weights)
        return train(*args, weights=weights, **options)

    monkeypatch.setattr(_horizon, "train", recorded)
    options = {"n_h": 2, "n_init": 1, "max_iter": 1, "alpha": 1e-3, "random_state": 0}
    for gamma_h in (0.0, 0.5):
        alssnn.FlSsnn(
            nx=2,
            feedback="output",
            noise="innovations",
            h_sees=h_sees,
            gamma_h=gamma_h,
            **options,
        ).fit(*loop_record)
    # a thousandth of the error of the linear model, if the data cannot choose
    least = 1e-3 * linear.cost_ if h_sees == "measured" else 0.0
    assert 0 < linear.cost_ < 100
    given = [weights.get("h", 0.0) for weights in asked]
    np.testing.assert_allclose(given, [least, 0.5], rtol=0.05)


def test_noise_of_the_sensor_alone_leaves_h_to_the_prediction():
    u, y = make_record(gain=0.0, process=0.0, noise=0.1)
    options = {"nx": 2, "n_h": 4, "feedback": "output", "n_init": 1, "random_state": 0}
    model = alssnn.FlSsnn(alpha=1e-6, noise="innovations", **options).fit(u, y)
    assert model.h_sees_ == "predicted"
    assert np.abs(model.K_).max() < 0.15
    assert true_loop(model) < 0.03


@pytest.mark.parametrize("cls", [alssnn.AlSsnn, alssnn.GrSsnn, alssnn.FlSsnn])
def test_networks_on_linear_models(cls, loop_record, linear):
    sizes = {"n_g": 3} if cls is alssnn.AlSsnn else {}
    model = cls(
        nx=2, n_init=1, alpha=1e-5, random_state=0, noise="innovations", **sizes
    ).fit(*loop_record)
    ahead = {
        m: np.std(loop_record[1] - m.predict_ahead(*loop_record))
        for m in (model, linear)
    }
    assert ahead[model] < 0.97 * ahead[linear]
    A_K = model.A_ - model.K_ @ model.C_
    assert np.abs(np.linalg.eigvals(A_K)).max() < 1


def test_a_predictor_forgets_its_start_where_there_is_no_noise():
    # a smooth record without noise: from one exact start every K predicts it
    t = np.arange(400)
    u = np.sin(0.1 * t) + np.sin(0.023 * t)
    x, y = np.zeros(3), np.empty(400)
    for k in range(400):
        y[k] = x[0]
        x = np.array([x[0] + 0.1 * x[1], x[1] + 0.1 * x[2], 0.9 * x[2] - x[0] / 3])
        x[2] += 0.2 * u[k] - 0.3 * x[1]
    for nx in (2, 3, 4):
        model = alssnn.LinearStateSpace(nx=nx, noise="innovations").fit(u, y)
        left = y - model.predict_ahead(u, y, x0=3.0 * np.ones(nx))
        assert np.std(left[100:]) < 0.05 * np.std(y)


def test_poles_of_sections_stay_within_a_radius():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((500, 1))
    y = np.zeros((500, 1))
    for k in range(499):
        y[k + 1] = 0.99 * y[k] + u[k]
    free = identify_linear([(u, y / y.std())], 1)
    inside = Sections([(u, y / y.std())], replace(free, A=0.8 * np.eye(1)), radius=0.9)
    gradient = inside.normal_equations(inside.start)[1]
    step = 1e-6
    for i, one in enumerate(np.eye(len(inside.start))):
        up, down = (inside.norm(inside.start + s * step * one) ** 2 for s in (1, -1))
        np.testing.assert_allclose(gradient[i], (up - down) / 4 / step, 1e-4, 1e-9)
    found = minimize(inside, inside.start, max_iter=50, tol=1e-10).x
    pole = inside.matrices(found)["A"][0, 0]
    assert 0.89 < pole < 0.9 and free.A[0, 0] > 0.98


def test_several_records_two_inputs_a_late_one_and_a_disturbance():
    rng = np.random.default_rng(0)
    us, ys = [], []
    for n in (700, 500):
        u, x, y = rng.standard_normal((n, 2)), np.zeros(2), np.empty((n, 2))
        for k in range(n):
            y[k] = x + 0.01 * rng.standard_normal(2)
            late = u[k - 2, 0] if k > 1 else 0.0
            w = 0.2 * rng.standard_normal(2)
            x = np.array([[0.7, 0.2], [0.0, 0.5]]) @ x + np.array([late, u[k, 1]]) + w
        us.append(u)
        ys.append(y + np.array([5.0, 0.0]))
    model = alssnn.LinearStateSpace(
        nx=2, noise="innovations", input_delay=[2, 0], disturbances=[1]
    ).fit(us, ys)
    poles = np.sort(np.linalg.eigvals(model.A_).real)
    np.testing.assert_allclose(poles, [0.5, 0.7], atol=0.03)
    assert model.K_.shape == (2, 2) and model.G_.shape == (2, 1)
    assert model.x0_.shape == (2, 2)
    np.testing.assert_allclose(model.noise_covariance_, 0.04 * np.eye(2), atol=0.01)
    ahead = np.vstack(model.predict_ahead(us, ys)) - np.vstack(ys)
    np.testing.assert_allclose(np.std(ahead[10:], axis=0), 0.2, rtol=0.1)
    two = np.vstack(model.predict_ahead(us, ys, 2)) - np.vstack(ys)
    assert np.all(np.std(two, axis=0) > 1.05 * np.std(ahead, axis=0))


def test_feedthrough_is_not_told_to_itself():
    u, y = make_record(h=nothing)
    u, y = u[:-1], y[:-1] + 0.5 * u[:-1]
    model = alssnn.LinearStateSpace(nx=2, noise="innovations", feedthrough=True)
    model.fit(u, y)
    np.testing.assert_allclose(model.D_, 0.5, atol=0.02)
    poles = np.sort_complex(np.linalg.eigvals(model.A_))
    np.testing.assert_allclose(poles, np.sort_complex(np.linalg.eigvals(A)), atol=0.03)


def test_orders_are_compared_one_sample_ahead(loop_record):
    model = alssnn.LinearStateSpace(noise="innovations").fit(*loop_record)
    errors = model.orders_["linear"]
    assert errors[2] < 0.9 * errors[1] and max(errors) > 2
    assert model.nx_ in (2, 3)


def test_gaps_are_bridged_by_what_is_predicted(loop_record, linear):
    u, y = loop_record
    rng = np.random.default_rng(0)
    lost = np.where(rng.random(len(y)) < 0.2, np.nan, y)
    model = alssnn.LinearStateSpace(nx=2, noise="innovations").fit(u, lost)
    poles = [np.sort_complex(np.linalg.eigvals(m.A_)) for m in (model, linear)]
    np.testing.assert_allclose(*poles, atol=0.05)
    # a prediction uses nothing of later samples
    ahead = linear.predict_ahead(u, lost)
    changed = lost.copy()
    changed[601:] += 1.0
    np.testing.assert_array_equal(linear.predict_ahead(u, changed)[:602], ahead[:602])
    k = int(np.flatnonzero(np.isnan(lost))[5])
    told = lost[: k + 2].copy()
    told[k] = ahead[k]
    again = linear.predict_ahead(u[: k + 2], told)
    np.testing.assert_allclose(again[k + 1], ahead[k + 1], rtol=1e-10)


@pytest.mark.parametrize("n", [4, 8, 40])
def test_records_that_begin_or_end_with_a_gap(n, loop_record, linear):
    u, y = loop_record
    first, second = y.copy(), y[:500].copy()
    first[:n] = second[-n:] = np.nan
    model = alssnn.LinearStateSpace(nx=2, noise="innovations")
    model.fit([u[:, None], u[:500, None]], [first, second])
    assert model.cost_ == pytest.approx(linear.cost_, rel=0.1)
    np.testing.assert_allclose(model.noise_covariance_, linear.noise_covariance_, 0.1)
    assert model.x0_.shape == (2, 2) and np.abs(model.x0_).max() < 20
    poles = [np.sort_complex(np.linalg.eigvals(m.A_)) for m in (model, linear)]
    np.testing.assert_allclose(*poles, atol=0.05)


@pytest.mark.parametrize(("first", "n"), [(0, 30), (500, 100)])
def test_a_gap_of_a_record_that_began_at_rest_is_followed_from_there(first, n):
    """Behind a gap, a plant that once was at rest is so no longer."""
    rng = np.random.default_rng(1)
    u, x, y = np.repeat(0.5 + rng.standard_normal(200), 5), np.zeros(2), np.empty(1000)
    for k in range(1000):
        y[k] = x[0] + 0.5 * rng.standard_normal()
        x = np.array(
            [1.7 * x[0] - 0.75 * x[1] + u[k] + 0.1 * rng.standard_normal(), x[0]]
        )
    known = {"noise": "innovations", "initial_state": "rest", "operating_point": "zero"}
    whole = alssnn.LinearStateSpace(nx=2, **known).fit(u, y)
    y[first : first + n] = np.nan
    model = clone(whole).fit(u, y)
    assert model.cost_ == pytest.approx(whole.cost_, rel=0.1)
    np.testing.assert_allclose(model.C_ @ model.K_, whole.C_ @ whole.K_, atol=0.05)
    assert not np.any(model.x0_)
    told = [m.parameter_covariance(u, y).n_effective for m in (model, whole)]
    assert told[0] == pytest.approx(told[1], abs=0.1)


def test_a_long_gap_of_an_unstable_plant():
    record = make_inverted_pendulum(1500, random_state=0)
    y = record.y.copy()
    y[700:900] = np.nan
    with pytest.warns(UserWarning, match="unstable"):
        model = alssnn.LinearStateSpace(nx=2, dt=record.dt, noise="innovations")
        model.fit(record.u, y)
    assert np.abs(np.linalg.eigvals(model.A_)).max() == pytest.approx(1.09, abs=0.01)
    left = record.y - model.predict_ahead(record.u, y)
    assert np.std(left[50:700]) < 0.05 * record.y.std()
    assert np.std(left[950:]) < 0.05 * record.y.std()
    assert np.isfinite(model.bic(record.u, y))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_outputs_that_are_never_measured_together(seed):
    rng = np.random.default_rng(seed)
    u, x, y = rng.standard_normal((1500, 1)), np.zeros(2), np.empty((1500, 2))
    for k in range(1500):
        y[k] = x + 0.02 * rng.standard_normal(2)
        w = 0.1 * rng.standard_normal(2)
        x = np.array([[0.7, 0.2], [0.0, 0.5]]) @ x + np.array([0.3, 1.0]) * u[k, 0] + w
    y[::2, 0], y[1::2, 1] = np.nan, np.nan
    with pytest.warns(UserWarning, match="50 % of an output"):
        model = alssnn.LinearStateSpace(nx=2, noise="innovations").fit(u, y)
        free = alssnn.LinearStateSpace(nx=2).fit(u, y)
    left = (y - model.predict_ahead(u, y))[50:]
    assert np.all(np.nanstd(left, axis=0) < 0.25 * np.nanstd(y, axis=0))
    # K = 0 is the simulation: a predictor is no worse
    assert model.cost_ < free.cost_


@pytest.mark.parametrize("noise", ["output", "innovations"])
def test_nothing_of_a_fit_is_left_for_the_next_one(noise, loop_record):
    model = alssnn.FlSsnn(
        nx=2, n_h=2, n_init=1, alpha=1e-4, max_iter=3, random_state=0, warm_start=True
    ).fit(*loop_record)
    assert model.set_params(nx=3, noise=noise).fit(*loop_record).nx_ == 3
    assert not {"_identified", "_orders", "_curve"} & set(vars(model))


def test_observer_predicts_as_the_fit_did(loop_record, linear):
    u, y = loop_record
    observer, plant = linear.observer(), linear.plant_
    np.testing.assert_allclose(linear.A_ @ observer.gain, linear.K_, atol=1e-9)
    np.testing.assert_allclose(plant.K, linear.K_)
    X = observer.filter(u[:, None], y[:, None])
    ahead = plant.output(plant.step(X[:-1], u[:-1, None]))[:, 0]
    np.testing.assert_allclose(ahead, linear.predict_ahead(u, y)[1:], atol=1e-9)
    assert observer.has_fitted_gain
    other = linear.observer(R=np.eye(1))
    assert np.abs(other.gain - observer.gain).max() > 1e-3
    assert not other.has_fitted_gain
    assert not linear.observer(kind="ekf").has_fitted_gain
    assert plant.with_disturbance("output").K is None


def test_a_gain_with_a_disturbance_that_was_not_identified_is_not_fitted(linear):
    observer = DisturbanceObserver(linear)
    assert linear.plant_.K is not None and observer.plant.K is None
    assert not observer.has_fitted_gain


@pytest.mark.parametrize("K", [np.array([[0.3], [0.2]]), np.array([[0.3], [0.0]])])
def test_an_observer_says_where_A_has_no_gain_for_K(linear, K):
    plant = linear.plant_
    A_m = np.diag([0.5, 0.0])  # the second state forgets what it was corrected to
    Theta = plant.lure.Theta.copy()
    Theta[:2, :2] = A_m
    form = replace(plant.form, Theta=Theta)
    observer = Observer(replace(plant, form=form, K=K))
    assert observer.has_fitted_gain is not bool(K[1])
    if observer.has_fitted_gain:
        np.testing.assert_allclose(A_m @ observer.gain, K)
    assert np.isfinite(observer.gain).all()


def test_late_inputs_and_the_identified_gain(loop_record):
    u, y = loop_record
    model = alssnn.LinearStateSpace(nx=2, noise="innovations", input_delay=1)
    model.fit(u[:-1], y[1:])
    gain = model.observer().gain
    assert gain.shape == (3, 1) and not gain[2:].any()


def test_files_keep_the_predictor(loop_record, tmp_path):
    model = alssnn.FlSsnn(
        nx=2,
        n_h=3,
        feedback="output",
        n_init=1,
        alpha=1e-4,
        max_iter=30,
        random_state=0,
        noise="innovations",
    ).fit(*loop_record)
    model.save(tmp_path / "model")
    again = alssnn.load(tmp_path / "model")
    assert again.h_sees_ == model.h_sees_
    np.testing.assert_array_equal(again.K_, model.K_)
    np.testing.assert_array_equal(again.noise_covariance_, model.noise_covariance_)
    ahead = (m.predict_ahead(*loop_record, 3) for m in (again, model))
    np.testing.assert_array_equal(*ahead)
    np.testing.assert_array_equal(again.observer().gain, model.observer().gain)


def test_warm_start_goes_on_from_the_predictor(loop_record):
    model = alssnn.AlSsnn(
        nx=2,
        n_h=3,
        n_g=2,
        n_init=1,
        alpha=1e-4,
        max_iter=5,
        random_state=0,
        noise="innovations",
        warm_start=True,
    )
    first = model.fit(*loop_record).cost_
    assert model.set_params(max_iter=20).fit(*loop_record).cost_ <= first
    assert model.history_[0].cost == pytest.approx(first, rel=0.05)


@pytest.mark.parametrize("alpha", [1e-4, "auto"])
def test_warm_starts_keep_what_h_sees_unless_it_is_asked_for(
    loop_record, alpha, monkeypatch
):
    record, sees = [z[:200] for z in loop_record], []

    def recorded(structure, *args, **options):
        sees.append(structure.options["h_sees"])
        return train(structure, *args, **options)

    monkeypatch.setattr(_horizon, "train", recorded)
    model = alssnn.FlSsnn(
        nx=2,
        n_h=2,
        feedback="output",
        n_init=1,
        integrators=0,
        alpha=alpha,
        max_iter=5,
        random_state=0,
        noise="innovations",
        warm_start=True,
    ).fit(*record)
    chosen = model.h_sees_
    (other,) = {"measured", "predicted"} - {chosen}
    assert sees == ["measured", "predicted"]
    # "auto" has chosen: the other one, which was left behind, would begin anew
    assert model.fit(*record).history_[0].label == "train"
    assert sees[2:] == [chosen]
    model.set_params(h_sees=other).fit(*record)
    assert sees[3:] == [other] and model.h_sees_ == other
    assert model.history_[0].label == "linear"
    model.set_params(h_sees="auto", nx=3).fit(*record)
    assert sees[4:] == ["measured", "predicted"]


def test_networks_that_do_not_help_a_predictor_do_not_predict(loop_record, monkeypatch):
    monkeypatch.setattr(_ssnn, "search", lambda *_, **__: Bunch(helps=False, curve={}))
    model = alssnn.FlSsnn(nx=2, n_h=2, noise="innovations", random_state=0)
    with pytest.warns(ConvergenceWarning, match="do not predict hidden samples better"):
        model.fit(*loop_record)
    assert model.alpha_ == np.inf


def test_gaps_are_predicted_by_the_form_that_was_chosen(loop_record, monkeypatch):
    u, y = loop_record
    y = np.where(np.arange(len(y)) % 20 == 0, np.nan, y)
    forms = []

    def recorded(structure, *args, **options):
        forms.append(structure.options["h_sees"])
        return train(structure, *args, **options)

    monkeypatch.setattr(_horizon, "train", recorded)
    options = {"n_h": 2, "n_init": 1, "alpha": 1e-4, "max_iter": 4, "random_state": 0}
    alssnn.FlSsnn(nx=2, feedback="output", noise="innovations", **options).fit(u, y)
    assert forms[:2] == ["measured", "predicted"] and len(forms) == 3


def test_options_set_after_the_fit_leave_the_weight_of_h(loop_record):
    options = {"n_h": 2, "n_init": 1, "alpha": 1e-4, "max_iter": 4, "random_state": 0}
    model = alssnn.FlSsnn(
        nx=2, feedback="output", noise="innovations", h_sees="measured", **options
    ).fit(*loop_record)
    before = model.bic(*loop_record)
    assert model.set_params(noise="output").bic(*loop_record) == before


def test_an_unstable_plant_from_its_loop():
    record = make_inverted_pendulum(2000, angle=0.8, random_state=0)
    options = {"nx": 2, "dt": record.dt, "noise": "innovations"}
    with pytest.warns(UserWarning, match="unstable"):
        linear = alssnn.LinearStateSpace(**options).fit(record.u, record.y)
        model = alssnn.FlSsnn(
            n_h=4, n_init=1, alpha=1e-8, feedback="output", random_state=0, **options
        ).fit(record.u, record.y)
    true = record.plant.linearize([0.0, 0.0], [0.0]).A
    A_0 = model.plant_.jacobian(np.zeros(2), model.u_offset_)[0]
    poles = (np.sort(np.linalg.eigvals(M).real) for M in (A_0, true))
    np.testing.assert_allclose(*poles, atol=0.01)
    assert model.cost_ < 0.9 * linear.cost_
    K = lqi(model, np.eye(3), 0.01 * np.eye(1))
    loop = closed_loop(record.plant, model, K, law=model.linearizing_law(-20, 20))
    start = np.zeros(loop.nstates)
    start[next(i for i, name in enumerate(loop.state_labels) if "angle" in name)] = 0.5
    t = record.dt * np.arange(150)
    response = control.input_output_response(loop, t, np.zeros(150), start)
    assert np.abs(response.outputs[0][-20:]).max() < 1e-3


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"angle": 0.0}, "`angle` must be"),
        ({"angle": 3.0}, "hold the pendulum"),
        ({"torque_noise": -1.0}, "`torque_noise` must be"),
        ({"hold": (1.0, 0.5)}, "`hold` must be"),
    ],
)
def test_pendulums_that_fall_are_refused(options, match):
    with pytest.raises(ValueError, match=match):
        make_inverted_pendulum(500, random_state=0, **options)


def test_pendulum_without_noise_is_its_plant():
    quiet = make_inverted_pendulum(300, noise=0.0, torque_noise=0.0, random_state=0)
    t = quiet.dt * np.arange(20)
    response = control.input_output_response(quiet.plant, t, quiet.u[:20, 0], quiet.x0)
    np.testing.assert_allclose(response.outputs, quiet.y[:20, 0], atol=1e-9)


def test_covariance_holds_where_that_of_a_simulation_does_not():
    u, y = make_record(1000, h=nothing)
    model = alssnn.LinearStateSpace(nx=2, noise="innovations").fit(u, y)
    covariance = model.parameter_covariance(u, y)
    assert covariance.holds
    regions = covariance.poles()
    assert np.isfinite(regions.covariance).all()
    shorter = alssnn.LinearStateSpace(nx=1, noise="innovations").fit(u, y)
    assert model.bic(u, y) < shorter.bic(u, y)
    drawn = model.sample_models(covariance, 3, random_state=0, data=(u, y))
    assert all(not np.array_equal(one.A_, model.A_) for one in drawn)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"integrators": 1}, "`integrators` must be 'auto' or 0"),
        ({"linear_start": (A, B[:, None], C[None])}, "`linear_start` must be None"),
        ({"noise": "white"}, "noise"),
    ],
)
def test_refused_options(options, match, loop_record):
    model = alssnn.LinearStateSpace(**{"noise": "innovations", **options})
    with pytest.raises(ValueError, match=match):
        model.fit(*loop_record)
    assert not hasattr(model, "A_")


def test_structures_without_innovations_are_refused(loop_record):
    class Plain(alssnn.FlSsnn):
        def _declare(self, nx, nu, ny, **networks):
            return state_space(nx, nu, ny, **networks)

    with pytest.raises(ValueError, match="without the signal 'eps'"):
        Plain(nx=1, noise="innovations").fit(*loop_record)


def test_parameters_survive_a_clone():
    model = alssnn.FlSsnn(noise="innovations", h_sees="measured")
    assert clone(model).get_params() == model.get_params()


def test_records_drawn_from_a_model_are_as_its_own(loop_record, linear):
    u = loop_record[0]
    assert np.array_equal(linear.simulate(u), linear.predict(u))
    drawn = linear.simulate(u, noise=True, random_state=0)
    assert np.array_equal(drawn, linear.simulate(u, noise=True, random_state=0))
    # what was drawn is what its predictor does not predict
    eps = np.random.RandomState(0).multivariate_normal(
        np.zeros(1), linear.noise_covariance_, len(u)
    )
    left = drawn - linear.predict_ahead(u, drawn)
    np.testing.assert_allclose(left, eps[:, 0], atol=1e-9)
    again = alssnn.LinearStateSpace(nx=2, noise="innovations").fit(u, drawn)
    np.testing.assert_allclose(again.noise_covariance_, linear.noise_covariance_, 0.1)
    plain = alssnn.LinearStateSpace(nx=2).fit(*loop_record)
    white = plain.simulate(u, noise=True, random_state=0) - plain.predict(u)
    np.testing.assert_allclose(white.var(), plain.noise_covariance_[0, 0], rtol=0.1)
    pair = linear.simulate([u[:50, None], u[:70, None]], noise=True, random_state=0)
    assert [len(one) for one in pair] == [50, 70]


@pytest.mark.parametrize("name", OPTIONS)
def test_record_and_predictor_are_inverse_to_each_other(name):
    structure, theta, _ = declared(name)
    rng = np.random.default_rng(0)
    u, eps, x0 = rng.standard_normal((9, 2)), rng.standard_normal((9, 2)), np.ones(3)
    drawn = recording(structure).observe("y").lure(theta)
    y_m = outputs(drawn, np.hstack([u, eps]), x0) + eps
    seen = predictor(structure).observe("y").lure(theta)
    np.testing.assert_allclose(y_m - outputs(seen, np.hstack([u, y_m]), x0), eps)


def test_a_loaded_predictor_goes_on_where_it_was(loop_record, tmp_path):
    options = {"nx": 2, "n_h": 3, "n_init": 1, "alpha": 1e-4, "random_state": 0}
    model = alssnn.FlSsnn(
        feedback="output",
        max_iter=4,
        warm_start=True,
        noise="innovations",
        h_sees="measured",
        **options,
    ).fit(*loop_record)
    model.save(tmp_path / "model")
    again = alssnn.load(tmp_path / "model")
    assert vars(again).keys() >= vars(model).keys()
    for one in (model, again):
        one.set_params(max_iter=8).fit(*loop_record)
    np.testing.assert_array_equal(again.A_, model.A_)
    # a fit for the output keeps nothing of it
    model.set_params(noise="output").fit(*loop_record)
    assert not {"_forgets", "_linear_cost", "h_sees_"} & set(vars(model))


def test_late_inputs_are_validated_too(loop_record):
    u, y = loop_record
    late = np.roll(u, -2, axis=0)[:-2]
    model = alssnn.LinearStateSpace(nx=2, input_delay=2, noise="innovations")
    check = model.fit(late, y[:-2]).validate(late, y[:-2])["free run"]
    assert "one sample ahead the model misses" in check.sentence


def test_a_short_experiment_that_was_never_measured_is_a_small_share():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((620, 1))
    y = np.vstack([np.zeros((1, 1)), u[:-1]]) + 0.1 * rng.standard_normal(u.shape)
    label = np.arange(620) >= 600
    y[label] = np.nan
    model = alssnn.LinearStateSpace(nx=1, noise="innovations")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(u, y, experiment=label)
    y[1:600:2] = np.nan
    with pytest.warns(ConvergenceWarning, match="52 % of an output were not measured"):
        model.fit(u, y, experiment=label)

"""Models with a random walk that nobody measured: drift="output" and "input"."""

import functools

import numpy as np
import pytest
from sklearn.base import clone

import alssnn
from alssnn.criterion import Criterion
from alssnn.drift import centered, filtered
from alssnn.feedback import DisturbanceObserver
from alssnn.following import Following, follows
from alssnn.innovations import (
    drift_of,
    error_matrix,
    free_run,
    predictor,
    recording,
    state_matrix,
    with_outputs,
)
from alssnn.limits import Limits
from alssnn.linear_model import LinearModel, simulation_error
from alssnn.models import state_space
from alssnn.orders import compare_orders
from alssnn.scorers import k_step
from alssnn.simulation import outputs, simulate
from alssnn.stability import Contractive, Schur
from helpers import assert_direct

pytestmark = pytest.mark.filterwarnings(
    "ignore::sklearn.exceptions.ConvergenceWarning"  # short fits are enough
)

KINDS = ["output", "input"]
A = np.array([[0.9, 0.2, 0.0], [-0.2, 0.8, 0.1], [0.0, 0.0, 0.6]])
B = np.array([[1.0, 0.0], [0.0, 0.5], [0.3, 1.0]])
C = np.array([[0.3, 0.1, 0.0], [0.0, 0.2, 0.5]])
OPTIONS = {
    "linear": {},
    "FL, measured": {"n_h": 3, "feedback": "output", "h_sees": "measured"},
    "FL, predicted": {"n_h": 3, "feedback": "output"},
    "AL, given": {
        "n_h": 2,
        "n_g": 2,
        "n_k": 2,
        "feedback": "output",
        "h_sees": "measured",
        "feedthrough": True,
        "disturbances": (1,),
    },
    "monotone": {"n_h": 3, "feedback": "state", "n_g": 2, "input_map": "monotone"},
}
CASES = [(name, kind) for name in OPTIONS for kind in KINDS]


def make_record(n=1500, *, kind="output", gain=0.4, walk=0.02, seed=0):
    """Return a record of two loops with a random walk, and the walk."""
    rng = np.random.default_rng(seed)
    x, b = np.zeros(3), 0.5 * rng.standard_normal(2)
    r = np.repeat(rng.uniform(-1, 1, (n // 10 + 1, 2)), 10, axis=0)[:n]
    u, y, walks = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2))
    for k in range(n):
        walks[k] = b
        y[k] = C @ x + b * (kind == "output") + 0.05 * rng.standard_normal(2)
        u[k] = r[k] - gain * y[k]
        w = 0.02 * rng.standard_normal(3)
        x = A @ x + B @ (u[k] + b * (kind == "input")) + w
        b = b + walk * rng.standard_normal(2)
    return u, y, walks


def response(model):
    """Return the frequency response of the linear part, in radians per sample."""
    A_m, B_m, C_m = (A, B, C) if model is None else (model.A_, model.B_, model.C_)
    z = np.exp(1j * np.geomspace(0.01, 3, 30))
    return np.array([C_m @ np.linalg.solve(s * np.eye(len(A_m)) - A_m, B_m) for s in z])


def declared(name, kind, nx=3, nu=2, ny=2):
    """Return the free run of a model with random parameters."""
    rng = np.random.default_rng(0)
    options = OPTIONS[name]
    C_m = rng.standard_normal((ny, nx)) if options else None
    options = {"noise": "innovations", "drift": kind, **options}
    structure = state_space(nx, nu, ny, C=C_m, **options)
    return structure, 0.3 * rng.standard_normal(structure.n_params), C_m


@pytest.fixture(scope="module", params=KINDS)
def fitted(request):
    u, y, _ = make_record(kind=request.param)
    options = {"nx": 3, "noise": "innovations", "drift": request.param}
    return alssnn.LinearStateSpace(**options).fit(u, y), u, y


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_free_run_knows_no_walk(name, kind):
    structure, theta, C_m = declared(name, kind)
    plain = state_space(3, 2, 2, C=C_m, noise="innovations", **OPTIONS[name])
    assert drift_of(structure) == kind and drift_of(plain) is None
    p = structure.split(theta)
    expected = plain.lure(plain.join(p))
    assert structure.states == plain.states and structure.n_x0 == 3
    np.testing.assert_array_equal(structure.lure(theta).Theta, expected.Theta)
    law, without = structure.law(), plain.law()
    assert law.inputs == without.inputs
    np.testing.assert_array_equal(
        law.lure(law.join(p)).Theta, without.lure(without.join(p)).Theta
    )
    seen = predictor(structure)
    assert seen.n_x0 == 3 + len(p["K_b"])
    assert seen.observe("y").states == ("x", "b")
    np.testing.assert_array_equal(free_run(seen).lure(theta).Theta, expected.Theta)


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_no_gain_of_the_walk_is_the_model_without(name, kind):
    structure, theta, C_m = declared(name, kind)
    plain = predictor(
        state_space(3, 2, 2, C=C_m, noise="innovations", **OPTIONS[name])
    ).observe("y")
    seen = predictor(structure).observe("y")
    p = {k: v for k, v in structure.split(theta).items() if k != "K_b"}
    rng = np.random.default_rng(1)
    z, x0 = rng.standard_normal((9, 4)), rng.standard_normal(3)
    np.testing.assert_allclose(
        outputs(seen.lure(seen.join(p)), z, seen.initial_state(x0)),
        outputs(plain.lure(plain.join(p)), z, x0),
        atol=1e-13,
    )


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_derivative_of_a_predictor(name, kind, rng):
    structure, theta, _ = declared(name, kind)
    assert_direct(predictor(structure), theta, rng)
    if "e" in structure.signals:
        assert_direct(predictor(structure).observe("y", "e"), theta, rng)


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_record_and_predictor_are_inverse_to_each_other(name, kind):
    structure, theta, _ = declared(name, kind)
    rng = np.random.default_rng(0)
    u, eps = rng.standard_normal((9, 2)), rng.standard_normal((9, 2))
    drawn, seen = recording(structure).observe("y"), predictor(structure).observe("y")
    x0 = rng.standard_normal(seen.n_x0)
    y_m = outputs(drawn.lure(theta), np.hstack([u, eps]), x0) + eps
    y = outputs(seen.lure(theta), np.hstack([u, y_m]), x0)
    np.testing.assert_allclose(y_m - y, eps, atol=1e-12)
    # what moves the walk is K_b eps
    X = simulate(seen.lure(theta), np.hstack([u, y_m]), x0)
    np.testing.assert_allclose(
        np.diff(X[:, 3:], axis=0), eps @ structure.split(theta)["K_b"].T, atol=1e-12
    )


@pytest.mark.parametrize(
    ("options", "moves"),
    [
        ({"n_h": 3, "feedback": "state"}, True),
        ({"n_h": (3, 2), "h_sees": "measured"}, True),
        ({"n_h": 3, "disturbances": (0,)}, True),
        ({"n_h": 3, "input_map": "monotone"}, True),
        ({"n_g": 3, "tied_bias": False}, True),
        ({"n_h": 3, "n_g": (2, 3), "tied_bias": False, "disturbances": (1,)}, True),
        ({"n_h": 3, "n_g": 2}, False),  # g is zero at rest
        ({"n_h": 3, "feedthrough": True}, False),
        ({"n_h": 3, "odd": True}, False),
        ({}, False),
    ],
)
def test_the_mean_of_a_load_is_in_a_bias_where_one_can_take_it(options, moves, rng):
    C_m = rng.standard_normal((2, 3)) if options else None
    options = {"noise": "innovations", "drift": "input", **options}
    seen = predictor(state_space(3, 2, 2, C=C_m, **options))
    theta = 0.3 * rng.standard_normal(seen.n_params)
    # K and K_b of an observer that follows
    p = seen.split(theta)
    p |= {"K": 0.1 * p["K"], "K_b": 0.1 * p["K_b"]}
    theta = seen.join(p)
    pairs = [
        (rng.standard_normal((n, 2)), rng.standard_normal((n, 2))) for n in (40, 9)
    ]
    pairs[0][1][20:] = np.nan
    pairs.append((pairs[1][0], np.full((9, 2), np.nan)))
    told = with_outputs(pairs)
    x0 = 2.0 + rng.standard_normal((3, seen.n_x0))
    x0[2] = 0.0
    found, starts = centered(seen, theta, x0, told)
    assert np.array_equal(found, theta) == np.array_equal(starts, x0) == (not moves)
    both, rows = seen.observe("y", "drift"), (20, 9)
    paths = [
        [
            outputs(both.lure(point), u, both.initial_state(one))[:n]
            for (u, _), one, n in zip(told, begins, rows, strict=False)
        ]
        for point, begins in ((theta, x0), (found, starts))
    ]
    before, after = (np.concatenate(path) for path in paths)
    np.testing.assert_allclose(after[:, :2], before[:, :2], rtol=0, atol=1e-11)
    if moves:
        assert np.abs(before[:, 2:].mean(axis=0)).min() > 0.1
        np.testing.assert_allclose(after[:, 2:].mean(axis=0), 0.0, atol=1e-11)
        np.testing.assert_array_equal(starts[2], 0.0)


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_error_of_states_and_walk(name, kind):
    structure, theta, _ = declared(name, kind)
    seen = predictor(structure).observe("y").lure(theta)
    p = structure.split(theta)
    matrix = error_matrix(structure, p)
    if name == "linear":
        np.testing.assert_allclose(seen.M[:-2, : seen.nx], matrix, atol=1e-13)
    np.testing.assert_array_equal(matrix[:3, :3], state_matrix(structure, p))
    assert follows(structure, {**p, "K_b": 0.0 * p["K_b"]}) == (
        np.abs(np.linalg.eigvals(matrix[:3, :3])).max() <= 1
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_walk_that_does_not_follow_has_a_smaller_gain(kind):
    structure, theta, C_m = declared("FL, measured", kind)
    seen = predictor(structure)
    rng = np.random.default_rng(0)
    pairs = [(rng.standard_normal((30, 2)), rng.standard_normal((30, 2)))]
    criterion = Criterion(seen, with_outputs(pairs))
    p = {**structure.split(theta), "A": 0.5 * np.eye(3)}
    p["K"], p["B"] = 0.0 * p["K"], C_m.T
    good, bad = ({**p, "K_b": s * 0.05 * np.eye(2)} for s in (1, -1))
    assert follows(seen, good) and not follows(seen, bad)
    start = np.zeros((1, seen.n_x0))
    inside, outside = (criterion.join(seen.join(q), start) for q in (good, bad))
    still = criterion.join(seen.join({**p, "K_b": np.zeros((2, 2))}), start)
    inner = Following(criterion)
    contractive = Contractive(inner, 1e-5)
    for problem, to_free in (
        (Schur(inner, 1.0), np.array),
        (contractive, contractive.from_free),
    ):
        assert problem.norm(to_free(inside)) == pytest.approx(criterion.norm(inside))
        assert problem.norm(to_free(outside)) == pytest.approx(criterion.norm(still))
    # a start is moved inside, by the gain of the walk alone
    far = seen.join({**p, "K_b": 9.0 * np.eye(2)})
    moved = seen.split(Limits(seen).clip(far))
    assert follows(seen, moved) and 0 < moved["K_b"][0, 0] < 9
    np.testing.assert_array_equal(moved["A"], p["A"])
    # by the share of the gain that is left, derivatives are those of the norm
    free = criterion.join(far, start)
    JJ, Jr, norm = inner.normal_equations(free)
    assert norm == pytest.approx(inner.norm(free))
    for i in range(len(free)):
        step = 1e-6 * np.eye(len(free))[i]
        squares = [inner.norm(free + s * step) ** 2 for s in (1, -1)]
        assert Jr[i] == pytest.approx((squares[0] - squares[1]) / 4e-6, abs=1e-6)
    assert np.linalg.eigvalsh(JJ)[0] > -1e-9 * np.linalg.eigvalsh(JJ)[-1]
    points = [free, free + 1e-3]
    share = np.ones(len(free))
    share[seen.slices["K_b"]] = inner.to_free(free)[seen.slices["K_b"]][0] / 9.0
    expected = share * criterion.pulled(*map(inner.to_free, points))
    np.testing.assert_allclose(inner.pulled(*points), expected, rtol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_linear_model_simulates_as_its_structure(kind):
    rng = np.random.default_rng(0)
    given = (1,)
    K_b = 0.1 * rng.standard_normal((2, 2))
    b0 = rng.standard_normal((1, 2))
    if kind == "input":
        K_b[1], b0[:, 1] = 0.0, 0.0
    model = LinearModel(
        A=0.5 * np.eye(3),
        B=rng.standard_normal((3, 4)),
        C=C,
        D=np.hstack([rng.standard_normal((2, 2)), np.zeros((2, 2))]),
        x0=rng.standard_normal((1, 3)),
        feedthrough=True,
        n_measured=2,
        drift=kind,
        K_b=K_b,
        b0=b0,
    )
    pairs = with_outputs([(rng.standard_normal((40, 2)), rng.standard_normal((40, 2)))])
    errors = [simulation_error(pairs, model)]
    for columns in ((), given):
        structure, theta, fit = model.as_fit(columns)
        criterion = Criterion(structure, pairs)
        errors.append(criterion.norm(criterion.join(theta, fit.x0)))
    np.testing.assert_allclose(errors, errors[0], rtol=1e-12)


def test_filter_turns_a_walk_into_white_noise():
    rng = np.random.default_rng(0)
    eps, K_b = rng.standard_normal((3000, 1)), 0.3
    b = np.vstack([[0.0], K_b * np.cumsum(eps, axis=0)[:-1]])
    ((_, y),) = filtered([(eps, b + eps)], K_b)
    ratio = (y / eps)[100:]  # what came before the record has decayed
    np.testing.assert_allclose(ratio, ratio[:1] + 0 * ratio, rtol=1e-9)
    assert np.mean(y**2) == pytest.approx(1.0)
    gap = b + eps
    gap[5] = np.nan
    ((_, y),) = filtered([(eps, gap)], K_b)
    assert np.flatnonzero(np.isnan(y[:, 0])).tolist() == [5]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("gain", [0.0, 0.4])
def test_walk_does_not_bias_the_model(kind, gain):
    u, y, _ = make_record(kind=kind, gain=gain)
    fresh = make_record(kind=kind, gain=gain, seed=7)[:2]
    true, found = response(None), {}
    for drift in (None, kind):
        options = {"nx": 3, "noise": "innovations", "drift": drift}
        model = alssnn.LinearStateSpace(**options).fit(u, y)
        left = (fresh[1] - model.predict_ahead(*fresh))[200:]
        error = np.linalg.norm(response(model) - true) / np.linalg.norm(true)
        found[drift] = error, np.std(left), model
    assert found[kind][0] < 0.03 < found[None][0] / 2
    assert found[kind][1] < 0.08 < found[None][1] / 1.2
    assert model.K_b_.shape == (2, 2) and found[None][2].K_b_.shape == (0, 2)
    assert "drift" not in alssnn.LinearStateSpace().fit(u[:200], y[:200]).params_


def test_where_nothing_walks_none_is_found():
    u, y, _ = make_record(walk=0.0)
    options = {"nx": 3, "noise": "innovations"}
    plain = alssnn.LinearStateSpace(**options).fit(u, y)
    model = alssnn.LinearStateSpace(drift="output", **options).fit(u, y)
    assert np.abs(model.K_b_).max() < 0.03
    assert model.cost_ <= plain.cost_ * (1 + 1e-9)
    np.testing.assert_allclose(response(model), response(plain), atol=0.03)


def test_observer_predicts_as_the_fit_did(fitted):
    model, u, y = fitted
    plant, kind = model.plant_, model.drift
    assert plant.drift == kind and plant.K_b.shape == (2, 2)
    np.testing.assert_allclose(plant.K_b, model.K_b_, atol=1e-12)
    observer = DisturbanceObserver(model)
    assert observer.disturbance == kind
    K = np.vstack([model.K_, model.K_b_])
    np.testing.assert_array_equal(observer.plant.K, plant.with_disturbance(kind).K)
    A_d, _, _, _ = observer.plant.jacobian(np.zeros(5), plant.u_offset)
    np.testing.assert_allclose(A_d @ observer.gain, K, atol=1e-9)
    X = observer.filter(u, y)
    ahead = observer.plant.output(observer.plant.step(X[:-1], u[:-1]))
    np.testing.assert_allclose(ahead, model.predict_ahead(u, y)[1:], atol=1e-9)
    three = observer.plant
    X_3 = three.step(three.step(three.step(X[:-3], u[:-3]), u[1:-2]), u[2:-1])
    np.testing.assert_allclose(
        three.output(X_3), model.predict_ahead(u, y, 3)[3:], atol=1e-9
    )
    assert observer.has_fitted_gain
    # one without what drifts has the gain of the states, and predicts otherwise
    without = model.observer()
    np.testing.assert_allclose(without.plant.form.M[:3, :3] @ without.gain, model.K_)
    assert not without.has_fitted_gain
    errors = [
        np.std((model.predict_ahead(u, y, observer=one) - y)[100:])
        for one in (observer, without)
    ]
    assert errors[1] > 1.5 * errors[0]
    # what the user gives, or another kind, is no identified gain
    other = DisturbanceObserver(model, Q_d=np.eye(2))
    assert np.abs(other.gain - observer.gain).max() > 1e-3
    (unknown,) = {"output", "input"} - {kind}
    assert plant.with_disturbance(unknown).K is None
    assert DisturbanceObserver(model, disturbance=unknown).disturbance == unknown


def test_exported_observers_say_that_they_leave_out_the_walk(fitted, tmp_path):
    model, u, y = fitted
    plain = alssnn.LinearStateSpace(nx=3, noise="innovations").fit(u, y)
    for one, says in ((model, True), (plain, False)):
        one.to_c(tmp_path)
        text = (tmp_path / "README.md").read_text()
        assert ("a random walk (`drift`), which this observer does not" in text) is says


def test_a_walk_is_no_fault_of_a_free_run(fitted):
    """One that has gone far leaves every free run, and no prediction."""
    model = fitted[0]
    u, y, _ = make_record(kind=model.drift, walk=0.3, seed=5)
    checks = model.validate(u, y)
    free_run = checks["free run"]
    assert not free_run.passed and not free_run.decides and free_run.value < 0
    assert "No free run knows what drifts, and this one is" in free_run.sentence
    assert checks["linearizability"].decides
    assert "does not follow the plant" not in checks["linearizability"].sentence
    ahead = model.predict_ahead(u, y, 5)
    misses = np.linalg.norm(ahead - y, axis=0) / np.linalg.norm(y - y.mean(0), axis=0)
    horizon = list(checks.ahead.horizons).index(5)
    np.testing.assert_allclose(checks.ahead.fit[horizon], 100 * (1 - misses), atol=1.0)
    assert k_step(5)(model, u, y) == pytest.approx(-np.mean(misses), abs=0.01)


def test_estimate_follows_the_walk():
    u, y, b = make_record(kind="input", seed=3)
    options = {"nx": 3, "noise": "innovations", "drift": "input"}
    model = alssnn.LinearStateSpace(**options).fit(u, y)
    found = DisturbanceObserver(model).filter(u, y)[:, 3:]
    moved = found - found.mean(axis=0) - (b - b.mean(axis=0))
    assert np.all(np.std(moved[100:], axis=0) < 0.5 * np.std(b[100:], axis=0))


def test_predictive_control_has_no_offset(fitted):
    model = fitted[0]
    load, r = np.array([0.3, -0.2]), np.array([0.2, 0.4])
    mpc = model.mpc()
    assert mpc.observer.disturbance == model.drift
    x, is_input = np.zeros(3), model.drift == "input"
    for _ in range(150):
        y = C @ x + load * (not is_input)
        u = mpc.step(r, y)
        x = A @ x + B @ (u + load * is_input)
    np.testing.assert_allclose(y, r, atol=1e-6)
    assert np.all(mpc.observer.largest_innovation >= 2 * model.plant_.y_scale)


def test_networks_with_a_load_that_drifts(tmp_path):
    rng = np.random.default_rng(0)

    def h(y):
        return -0.8 * np.tanh(2 * y) + 0.4 * y

    def record(n=1200):
        r = np.repeat(rng.uniform(-1.5, 1.5, n // 8 + 1), 8)[:n]
        x, b, u, y = np.zeros(2), 0.0, np.empty(n), np.empty(n)
        for k in range(n):
            own = 0.15 * x[0] + 0.1 * x[1]
            y[k] = own + 0.01 * rng.standard_normal()
            u[k] = r[k] - 0.4 * y[k]
            drive = u[k] + b + h(own) + 0.05 * rng.standard_normal()
            x = np.array([1.6 * x[0] - 0.8 * x[1] + drive, x[0]])
            b += 0.03 * rng.standard_normal()
        return u, y

    u, y = record()
    fresh, models = record(), {}
    for drift in (None, "input"):
        options = {"nx": 2, "n_h": 4, "feedback": "output", "alpha": 1e-5}
        options |= {"n_init": 1, "random_state": 0, "noise": "innovations"}
        models[drift] = alssnn.FlSsnn(drift=drift, **options).fit(u, y)
    errors = {
        drift: np.std((fresh[1] - model.predict_ahead(*fresh, 10))[100:])
        for drift, model in models.items()
    }
    assert errors["input"] < errors[None] / 2
    model = models["input"]
    poles = np.linalg.eigvals(
        error_matrix(model._structure, model._structure.split(model._theta))
    )
    assert np.abs(poles).max() < 1
    assert model.x0_.shape == (1, 2) and model.fitted_.region is not None
    # no constant is in the walk that is as well one of h
    levels = DisturbanceObserver(model).filter(u[:, None], y[:, None])[:, 2]
    assert abs(levels.mean()) < 0.05 * np.std(levels)
    assert model.validate(*fresh)["whiteness"].passed
    # files keep it
    model.save(tmp_path / "model")
    again = alssnn.load(tmp_path / "model")
    np.testing.assert_array_equal(again.K_b_, model.K_b_)
    np.testing.assert_array_equal(
        again.predict_ahead(*fresh, 3), model.predict_ahead(*fresh, 3)
    )
    observers = [DisturbanceObserver(one).gain for one in (model, again)]
    np.testing.assert_array_equal(*observers)
    # a fit goes on from its predictor
    model.set_params(warm_start=True, max_iter=3)
    cost = model.cost_
    assert model.fit(u, y).cost_ <= cost * (1 + 1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_gaps_experiments_orders_and_measured_disturbances(kind):
    parts = [make_record(400, kind=kind, seed=seed)[:2] for seed in (0, 1)]
    u, y = ([part[i] for part in parts] for i in range(2))
    rng = np.random.default_rng(0)
    d = [rng.standard_normal((400, 1)) for _ in parts]
    y = [y_i + 0.3 * np.roll(d_i, 1, axis=0) for y_i, d_i in zip(y, d, strict=True)]
    y[0][100:105], y[1][300:340, 0] = np.nan, np.nan
    u = [np.hstack([d_i, u_i]) for u_i, d_i in zip(u, d, strict=True)]
    options = {"noise": "innovations", "drift": kind, "disturbances": [0]}
    options |= {"max_iter": 10, "tol": 1e-3}
    nx = [3, 4] if kind == "output" else 4  # the comparison takes most of the time
    model = alssnn.LinearStateSpace(nx=nx, **options).fit(u, y)
    assert model.nx_ == 4 and model.x0_.shape == (2, 4) and model.B_.shape == (4, 2)
    left = np.concatenate(
        [a - b for a, b in zip(y, model.predict_ahead(u, y), strict=True)]
    )
    assert np.nanstd(left[50:]) < 0.12
    assert model.K_b_.shape == (2, 2)
    covariance = model.parameter_covariance(u, y)
    assert np.isfinite(covariance.covariance).all()
    drawn = model.simulate(u, noise=True, random_state=0)
    assert np.isfinite(np.concatenate(drawn)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_late_inputs(kind):
    u, y, _ = make_record(800, kind=kind, gain=0.0)
    u, y = u[1:], y[:-1]
    options = {"nx": 3, "noise": "innovations", "drift": kind, "input_delay": 1}
    model = alssnn.LinearStateSpace(**options).fit(u, y)
    gain = DisturbanceObserver(model).gain
    assert gain.shape == (7, 2) and np.isfinite(gain).all()
    if kind == "output":  # the past of inputs is known
        assert not gain[3:5].any() and gain[5:].any()
    assert np.std((y - model.predict_ahead(u, y))[50:]) < 0.09


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"drift": "output"}, "`drift` must be None for noise='output'"),
        ({"drift": "state", "noise": "innovations"}, "drift"),
    ],
)
def test_refused_options(options, match):
    u, y, _ = make_record(200)
    with pytest.raises(ValueError, match=match):
        alssnn.LinearStateSpace(nx=2, **options).fit(u, y)


def test_parameters_survive_a_clone():
    model = alssnn.AlSsnn(noise="innovations", drift="input")
    assert clone(model).get_params() == model.get_params()


@pytest.mark.parametrize("kind", KINDS)
def test_networks_that_do_not_help_leave_the_linear_model(kind, rng):
    """The fit raised: the walk has initial states, too."""
    u, load = rng.standard_normal(400), 0.02 * np.cumsum(rng.standard_normal(400))
    y, x = np.zeros(400), 0.0
    for k in range(400):
        y[k] = x + load[k] + 0.02 * rng.standard_normal()
        x = 0.8 * x + 0.2 * u[k]
    model = alssnn.FlSsnn(
        nx=1, n_h=3, n_init=1, noise="innovations", drift=kind, random_state=0
    ).fit(u, y)
    assert model.alpha_ == np.inf and "linear" in model.message_
    assert model.x0_.shape == (1, 1)
    assert np.std(model.predict_ahead(u, y) - y) < 0.06


@functools.cache
def cost_where_nothing_walks(drift):
    rng = np.random.default_rng(1)
    u, y, x = np.repeat(rng.uniform(-1, 1, 100), 5), np.empty(500), 0.0
    for k in range(500):
        y[k] = x + 0.005 * rng.standard_normal()
        x = 0.85 * x + 0.3 * (u[k] - 0.5 * np.tanh(2 * x))
    options = {"nx": 1, "n_h": 4, "n_init": 1, "random_state": 0}
    # a search would hide a part of what rejected steps cost
    options |= {"alpha": 1e-4, "integrators": 0}
    return alssnn.FlSsnn(noise="innovations", drift=drift, **options).fit(u, y).cost_


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_walk_that_is_declared_and_not_there_costs_little(kind):
    """It was 4 times: steps that made its gain negative were rejected as a whole."""
    assert cost_where_nothing_walks(kind) < 1.1 * cost_where_nothing_walks(None)


@pytest.mark.parametrize(
    ("kind", "given"), [("output", ()), ("input", ()), ("input", (1,))]
)
def test_walks_begin_where_they_are(kind, given):
    """Of hidden samples, only the states of the plant begin elsewhere, too."""
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((80, 2)), rng.standard_normal((80, 2))
    orders = compare_orders(
        with_outputs([(u, y)]), [1], n_measured=2, drift=kind, given=given
    )
    fold, (model, *_) = orders.folds[0], orders.models[1]
    start = model.starts()
    assert start.shape == (1, 3)
    x0, *others = fold._nudged(start)
    for other in others:
        assert other[0, 0] != x0[0, 0]
        np.testing.assert_array_equal(other[0, 1:], x0[0, 1:])

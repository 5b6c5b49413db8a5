"""The options of the model class, through the estimators, in the units of the user."""

import copy
import pickle
import tracemalloc
import warnings

import control
import numpy as np
import pandas as pd
import polars as pl
import pytest
from scipy.linalg import solve_discrete_lyapunov
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.frozen import FrozenEstimator

import alssnn
from alssnn import (
    Activation,
    AlSsnn,
    FlSsnn,
    GrSsnn,
    LinearStateSpace,
    delays,
    starts,
)
from alssnn.datasets import make_duffing, make_pendulum
from alssnn.delays import estimate_delays
from alssnn.estimators import _checks
from benchmarks import model_class
from models import al_ssnn, fl_ssnn, gr_ssnn

DT = 0.25
SMALL = {"nx": 2, "max_iter": 6, "tol": 1e-2, "random_state": 0, "dt": DT}


def _softsign(v):
    return v / (1 + abs(v))


def _softsign_slope(v, w):
    return (1 - abs(w)) ** 2


softsign = Activation("softsign", _softsign, _softsign_slope, (0, 1), 1.0, odd=True)

# -- a model of every option -----------------------------------------------------------

MODELS = {
    "linear, D, late": LinearStateSpace(2, dt=DT, feedthrough=True, input_delay=[1, 0]),
    "fl, deep, odd": fl_ssnn(n_h=(3, 2), odd=True, activation="sin", **SMALL),
    "fl, state, late": fl_ssnn(
        n_h=2, feedback="state", activation=softsign, input_delay=[0, 3], **SMALL
    ),
    "gr, D, k": gr_ssnn(n_f=(2, 2), n_k=2, feedthrough=True, **SMALL),
    "al, D, k": al_ssnn(n_h=2, n_g=2, n_k=2, feedthrough=True, gamma_h=1e-3, **SMALL),
    "al, all": al_ssnn(
        n_h=(2, 2),
        n_g=(2, 3),
        n_k=(2, 2),
        feedback="state",
        penalty="output",
        feedthrough=True,
        activation={"h": "sigmoid", "g": softsign, "k": "relu"},
        input_delay=[2, 1],
        output_weight=[1.0, 2.0],
        gamma_k=0.1,
        **SMALL,
    ),
    "al, contractive": al_ssnn(
        n_h=2, n_g=2, n_k=2, stability="contractive", continuation=1, **SMALL
    ),
}


@pytest.fixture(autouse=True)
def _short_fits():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        yield


def make_record(n=400, seed=0):
    """Return a record with feedthrough and a nonlinear output, in odd units."""
    rng = np.random.default_rng(seed)
    A = np.array([[0.7, 0.2], [-0.2, 0.6]])
    B = np.array([[0.4, 0.1], [0.0, 0.5]])
    du, x, y = rng.standard_normal((n, 2)), np.zeros(2), np.empty((n, 2))
    for k in range(n):
        y[k] = x + [0.2, 0.1] * du[k] + 0.1 * np.tanh(x)
        x = A @ x + B @ (du[k] + 0.4 * np.tanh(x))
    y += 0.01 * rng.standard_normal(y.shape)
    return du * [3.0, 0.02] + [10.0, -1.0], y * [100.0, 0.1] + [5.0, 7.0]


@pytest.fixture(scope="module")
def data():
    return make_record()


@pytest.fixture(scope="module")
def fitted(data):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return {name: model.fit(*data) for name, model in MODELS.items()}


@pytest.fixture(params=MODELS)
def model(request, fitted):
    return fitted[request.param]


def net(p, name, seen, bias, sigma):
    """Evaluate a network by its equation, from the parameters by name."""
    if f"W_{name}" not in p:
        return 0.0
    w = sigma(sum(p[W] @ z for W, z in seen.items() if W in p) + p.get(bias, 0.0))
    i = 2
    while f"W_{name}{i}" in p:
        w = sigma(p[f"W_{name}{i}"] @ w + p.get(f"b_{name}{i}", 0.0))
        i += 1
    return p[f"W_{name}"] @ w + p.get(f"b_{name}", 0.0)


SIGMA = {
    "tanh": np.tanh,
    "sin": np.sin,
    "sigmoid": lambda v: 1 / (1 + np.exp(-v)),
    "relu": lambda v: np.maximum(v, 0),
}


def equations(model, x, u):
    """Return x+, y, h, g, k by the equations (eq. model), deviations."""
    p, activation = model.params_, getattr(model, "activation", "tanh")
    by_net = activation if isinstance(activation, dict) else {}
    sigma = {}
    for name in "hgk":
        function = by_net.get(name, activation if not by_net else "tanh")
        sigma[name] = SIGMA.get(function, getattr(function, "value", None))

    def vanishing(name, W_x, W_u, b):
        value = net(p, name, {W_x: x, W_u: u}, b, sigma[name])
        if f"b_{name}" in p:
            return value
        return value - net(p, name, {W_x: 0 * x, W_u: 0 * u}, b, sigma[name])

    g = vanishing("g", "W_x", "W_u", "b_x")
    k = vanishing("k", "W_kx", "W_ku", "b_kx")
    y = p["C"] @ x + p.get("D", np.zeros((2, 2))) @ u + k
    seen, b = ({"W_s": x}, "b_s") if "W_s" in p else ({"W_y": y}, "b_y")
    h = net(p, "h", seen, b, sigma["h"])
    if "L" in p:
        (s,) = seen.values()
        h = h - p["L"] @ s
    return p["A"] @ x + p["B"] @ (u + h) + g, y, h, g, k


def delayed(model, u):
    """Return deviations of inputs as they arrive."""
    du = u - model.u_offset_
    return np.column_stack(
        [
            np.r_[np.zeros(d), z][: len(z)]
            for z, d in zip(du.T, model.input_delay_, strict=True)
        ]
    )


def test_params_obey_the_equations_in_the_units_of_the_user(model, data):
    u, y = data
    x, y_hat = np.array([0.3, -0.2]), np.empty_like(y)
    for k, du in enumerate(delayed(model, u)):
        x, dy, *_ = equations(model, x, du)
        y_hat[k] = dy + model.y_offset_
    got = model.predict(u, x0=[0.3, -0.2])
    np.testing.assert_allclose((got - y_hat) / y.std(axis=0), 0, atol=1e-11)
    assert model.score(u, y) > 0.4  # some are told wrong delays
    assert model.feedthrough == ("D" in model.params_)


def test_systems_of_python_control_respond_as_predict_does(model, data):
    u = data[0][:80]
    sys = model.to_nlsys()
    assert sys.nstates == 2 + model.input_delay_.sum()
    time = DT * np.arange(len(u))
    x0 = np.r_[0.3, -0.2, np.zeros(sys.nstates - 2)]
    y = control.input_output_response(sys, time, u.T, x0, squeeze=False).outputs.T
    expected = model.predict(u, x0=[0.3, -0.2])
    scale = data[1].std(axis=0)
    np.testing.assert_allclose((y - expected) / scale, 0, atol=1e-9)


def test_observer_follows_its_own_model(model, data):
    u = data[0]
    y = model.predict(u, x0=[0.5, 0.5])
    observer = model.observer()
    error = np.abs(observer.plant.output(observer.filter(u, y), u) - y)
    assert (error[-50:] < 1e-4 * y.std(axis=0)).all()


def test_linear_model_with_delay_and_feedthrough_is_its_statespace(fitted, data):
    model, u = fitted["linear, D, late"], data[0]
    sys = model.to_statespace()
    assert sys.nstates == 3
    y = control.forced_response(sys, None, (u - model.u_offset_).T).outputs.T
    np.testing.assert_allclose(
        (model.predict(u) - model.y_offset_ - y) / data[1].std(axis=0), 0, atol=1e-10
    )


def test_pickle_and_clone(model, data):
    u, _ = data
    copy = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(copy.predict(u), model.predict(u))
    assert clone(model).get_params() == model.get_params()
    again = clone(copy).fit(*data)
    np.testing.assert_array_equal(again.predict(u), model.predict(u))


@pytest.mark.parametrize("name", [n for n in MODELS if n != "linear, D, late"])
def test_warm_start_continues(fitted, data, name):
    model = pickle.loads(pickle.dumps(fitted[name])).set_params(warm_start=True)
    before, structure = model.cost_, model._structure
    if "continuation" in model.get_params():
        model.set_params(continuation=0)
    model.set_params(tol=1e-9).fit(*data)
    assert model._structure.shapes == structure.shapes
    assert model._structure.constants.keys() == structure.constants.keys()
    # initial states are estimated anew, so that a continued fit may begin above
    assert model.cost_ < before * (1 + 1e-3)


# -- the law ---------------------------------------------------------------------------


def test_law_of_the_state_leaves_the_linear_part_with_D_and_k(data):
    u, y = data
    model = fl_ssnn(n_h=(3, 2), feedback="state", **SMALL).fit(u, y)
    law = model.linearizing_law()
    x, x_linear = np.zeros(2), np.zeros(2)
    for v in u[:50]:
        u_k = law(v, x)
        x = equations(model, x, u_k - model.u_offset_)[0]
        x_linear = model.A_ @ x_linear + model.B_ @ (v - model.u_offset_)
    np.testing.assert_allclose(x, x_linear, atol=1e-12)


def test_law_of_the_state_in_a_model_with_everything(data):
    u, y = data
    options = {**SMALL, "n_h": 2, "n_g": 2, "n_k": 2, "feedthrough": True}
    model = al_ssnn(feedback="state", **options).fit(u, y)
    law, x = model.linearizing_law(), np.array([0.4, -0.7])
    du = law(u[3], x) - model.u_offset_
    x_next, _, _, g, _ = equations(model, x, du)
    linear = model.A_ @ x + model.B_ @ (u[3] - model.u_offset_)
    np.testing.assert_allclose(x_next, linear + g, atol=1e-12)


def test_laws_that_cannot_be_are_refused(fitted):
    with pytest.raises(ValueError, match=r"algebraic loop.*feedback='state'"):
        fitted["al, D, k"].linearizing_law()
    with pytest.raises(ValueError, match=r"algebraic loop"):
        fitted["al, contractive"].linearizing_law()
    with pytest.raises(ValueError, match=r"3 samples ahead.*input_delay=0"):
        fitted["fl, state, late"].linearizing_law()


def test_designed_loop_knows_the_delay(fitted):
    model = fitted["linear, D, late"]
    K = alssnn.feedback.lqr(model, np.eye(3), np.diag([1.0, 1e4]))
    linear = model.to_statespace()
    poles = alssnn.feedback.designed_loop(model, K).poles()
    expected = np.linalg.eigvals(linear.A - linear.B @ K)
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(expected))


def test_integrators_and_the_designed_loop_know_the_feedthrough(fitted):
    model = fitted["linear, D, late"]
    A, B, C, D = (getattr(model.to_statespace(), name) for name in "ABCD")
    assert np.abs(D).max() > 0
    nx, ny = len(A), len(C)
    Q, R = alssnn.feedback.balanced_weights(model, state=1.0, integral=0.1)
    K = alssnn.feedback.lqi(model, Q, R)
    # the equations, by hand: y = C x + D v in the integrators, too
    r, x, z, expected = np.array([0.3, -0.2]), np.zeros(nx), np.zeros(ny), []
    for _ in range(400):
        v = -K @ np.r_[x, z]
        y = C @ x + D @ v
        expected.append([*y, *v])
        x, z = A @ x + B @ v, z + y - r
    np.testing.assert_allclose(expected[-1][:ny], r, atol=1e-6)
    loop = alssnn.feedback.designed_loop(model, K)
    inputs = np.repeat(r[:, None], 400, axis=1)
    outputs = control.forced_response(loop, None, inputs).outputs.T
    np.testing.assert_allclose(outputs, expected, atol=1e-9)
    # no other gain costs less, from any state
    F = np.block([[A, np.zeros((nx, ny))], [C, np.eye(ny)]])
    G = np.vstack([B, D])

    def cost(K):
        return np.trace(solve_discrete_lyapunov((F - G @ K).T, Q + K.T @ R @ K))

    rng = np.random.default_rng(0)
    for direction in rng.standard_normal((5, *K.shape)) * np.abs(K).max(axis=0):
        for sign in (-1e-3, 1e-3):
            assert cost(K + sign * direction) > cost(K)


def test_observer_takes_the_noise_of_the_states_alone(fitted, data):
    model, (u, y) = fitted["fl, state, late"], data
    observer = model.observer(Q=1e-3 * np.eye(2), kind="ekf")
    X_hat = observer.filter(u, y)
    past = (u - model.u_offset_)[:-3, 1]
    # the input of three samples ago is known, whatever was measured
    np.testing.assert_array_equal(X_hat[3:, 2], past)


# -- linearizability -------------------------------------------------------------------


@pytest.mark.parametrize("name", ["al, D, k", "gr, D, k", "al, all"])
def test_linearizability_against_a_plain_loop(fitted, data, name):
    model, (u, y) = fitted[name], data
    record = model.linearizability(u, y)
    x = model.estimate_x0(u, y)[0]
    x_linear, e = x, np.empty_like(y)
    ratios = []
    D = model.params_["D"]
    for k, du in enumerate(delayed(model, u)):
        x_next, dy, h, g, _ = equations(model, x, du)
        # y of the linear system whose input is v = u + h
        e[k] = dy - model.C_ @ x_linear - D @ (du + h)
        linear = model.A_ @ x + model.B_ @ du
        ratios.append(np.linalg.norm(g) / np.linalg.norm(linear))
        x, x_linear = x_next, model.A_ @ x_linear + model.B_ @ (du + h)
    np.testing.assert_allclose(record.e / y.std(axis=0), e / y.std(axis=0), atol=1e-9)
    assert record.ratio_g_mean == pytest.approx(np.mean(ratios), rel=1e-6)
    closed = [getattr(record, f"closed_{z}") for z in ("omega_mean", "ratio_max")]
    posed = "W_h" not in model.params_
    assert np.isfinite(closed).all() == posed
    assert np.isfinite(record.closed_linearization_error).all() == posed
    if not posed:
        assert np.isnan(closed).all()
        assert record.no_law == model.plant_.no_law


def test_measure_of_the_closed_loop_with_D_and_k(fitted, data):
    """In the loop u = v - h(x) the linear system sees v, D v included."""
    u, y = data
    model = clone(MODELS["al, all"]).set_params(input_delay=0).fit(u, y)
    record = model.linearizability(u, y)
    x = model.estimate_x0(u, y)[0]
    x_linear, e, y_linear = x, np.empty_like(y), np.empty_like(y)
    for k, v in enumerate(delayed(model, u)):
        h = equations(model, x, v)[2]  # a function of the state
        x_next, dy, *_ = equations(model, x, v - h)
        y_linear[k] = model.C_ @ x_linear + model.D_ @ v
        e[k] = dy - y_linear[k]
        x, x_linear = x_next, model.A_ @ x_linear + model.B_ @ v
    expected = np.sqrt(np.mean(e**2, axis=0)) / np.std(y_linear, axis=0)
    np.testing.assert_allclose(record.closed_linearization_error, expected, rtol=1e-6)


# -- outputs that were not measured ----------------------------------------------------


def gaps(kind, shape):
    missing = np.zeros(shape, dtype=bool)
    if kind == "20 %":
        missing = np.random.default_rng(5).random(shape) < 0.2
    elif kind == "one for a while":
        missing[100:250, 1] = True
    else:  # multi-rate
        missing[:, 0] = np.arange(shape[0]) % 4 != 0
    return missing


@pytest.mark.parametrize("kind", ["20 %", "one for a while", "multi-rate"])
@pytest.mark.parametrize("name", ["linear, D, late", "al, D, k"])
def test_missing_outputs(data, fitted, kind, name):
    u, y = data
    missing = gaps(kind, y.shape)
    model = clone(MODELS[name]).fit(u, np.where(missing, np.nan, y))
    whole = fitted[name]
    error = {
        m: (m.predict(u, x0="training") - y) / y.std(axis=0) for m in (model, whole)
    }
    # the samples left out are predicted, too, nearly as well
    rms = {m: np.sqrt(np.mean(e[missing] ** 2)) for m, e in error.items()}
    assert rms[model] < max(0.05, 2 * rms[whole])
    assert np.isfinite(model.score(u, np.where(missing, np.nan, y)))
    assert np.isfinite(model.linearizability(u, np.where(missing, np.nan, y)).e).all()


def test_a_missing_output_is_no_output(data):
    """Values that were not measured have no influence: any placeholder is nan."""
    u, y = data
    missing = gaps("20 %", y.shape)
    model = clone(MODELS["al, D, k"]).fit(u, np.where(missing, np.nan, y))
    e = (model.predict(u, x0="training") - y) / model._scaling.y_scale
    mean_square = np.mean(e[~missing] ** 2) * 2  # per sample, both outputs
    p = model.params_
    assert model.cost_ >= mean_square > 0.5 * model.cost_
    assert np.isfinite(p["W_k"]).all()


def test_gaps_where_none_may_be(data):
    u, y = data
    bad = u.copy()
    bad[7, 1] = np.nan
    message = r"`u` must not contain NaN, got it at sample 7 of column 1.*two exper"
    model = LinearStateSpace(nx=2)
    with pytest.raises(ValueError, match=message):
        model.fit(bad, y)
    model.fit(u, y)
    for call in (model.score, model.estimate_x0, model.linearizability):
        with pytest.raises(ValueError, match=message):
            call(bad, y)
    with pytest.raises(ValueError, match=message):
        model.predict(bad)
    bad[7, 1] = np.inf
    for arguments in ((bad, y), (u, np.where(y > 100, -np.inf, y))):
        with pytest.raises(ValueError, match="infinity"):
            model.fit(*arguments)
    with pytest.raises(ValueError, match="infinity"):
        model.predict(bad)
    with pytest.raises(ValueError, match=r"NaN at every sample of column 1\. Leave"):
        model.fit(u, np.where([False, True], np.nan, y))
    with pytest.raises(ValueError, match=r"two measured samples .* column 1. Score"):
        model.score(u, np.where([False, True], np.nan, y))


# -- several experiments ---------------------------------------------------------------


def parts_of(data):
    u, y = data
    cuts = [slice(0, 60), slice(60, 75), slice(75, 400)]
    return [u[c] for c in cuts], [y[c] for c in cuts]


@pytest.mark.parametrize("library", [pd, pl])
def test_lists_of_dataframes_keep_their_names(data, library):
    us, ys = parts_of(data)
    us = [library.DataFrame(dict(zip(("valve", "pump"), u.T, strict=True))) for u in us]
    ys = [library.DataFrame(dict(zip(("level", "flow"), y.T, strict=True))) for y in ys]
    model = LinearStateSpace(nx=2, feedthrough=True).fit(us, ys)
    assert list(model.feature_names_in_) == ["valve", "pump"]
    assert model.output_names_ == ["level", "flow"]
    assert model.experiments_ == [0, 1, 2]
    arrays = clone(model).fit(*parts_of(data))
    out, expected = model.predict(us), arrays.predict(parts_of(data)[0])
    assert [len(y) for y in out] == [60, 15, 325]
    for y, other in zip(out, expected, strict=True):
        # the memory order of frames changes the rounding
        np.testing.assert_allclose(y, other, rtol=1e-7)
    assert model.score(us, ys) == pytest.approx(arrays.score(*parts_of(data)))


def test_lists_of_series_keep_their_name(data):
    us, ys = parts_of(data)
    us = [pd.DataFrame(u, columns=["valve", "pump"]) for u in us]
    model = LinearStateSpace(nx=2).fit(us, [pd.Series(y[:, 0], name="T") for y in ys])
    assert model.output_names_ == ["T"]
    assert [y.shape for y in model.predict(us)] == [(60,), (15,), (325,)]


def test_records_that_do_not_belong_together(data):
    us, ys = parts_of(data)
    with pytest.raises(ValueError, match="one record per experiment, got 3 and 2"):
        LinearStateSpace(2).fit(us, ys[:2])
    with pytest.raises(ValueError, match=r"`u\[0\]` and `y\[0\]`.*60 and 59"):
        LinearStateSpace(2).fit(us, [ys[0][:-1], *ys[1:]])
    with pytest.raises(ValueError, match="equal columns"):
        LinearStateSpace(2).fit(us, [ys[0][:, :1], *ys[1:]])
    frames = [pd.DataFrame(y, columns=["a", "b"]) for y in ys]
    frames[1] = frames[1].rename(columns={"b": "B"})
    with pytest.raises(ValueError, match=r"same names of columns in every record"):
        LinearStateSpace(2).fit(us, frames)
    with pytest.raises(ValueError, match="must be None for a list of records"):
        LinearStateSpace(2).fit(us, ys, np.zeros(400))


def test_threads_over_experiments_change_nothing(data):
    us, ys = parts_of(data)
    model = al_ssnn(n_h=2, n_g=2, **SMALL)
    alone = clone(model).fit(us, ys)
    pair = clone(model).set_params(n_jobs=2).fit(us, ys)
    assert alone.cost_ == pair.cost_
    np.testing.assert_array_equal(alone._theta, pair._theta)
    np.testing.assert_array_equal(alone.x0_, pair.x0_)


def test_experiments_shorter_than_the_order_take_part(data):
    us, ys = parts_of(data)
    us, ys = [*us, us[2][:3]], [*ys, ys[2][:3]]
    model = fl_ssnn(n_h=2, **SMALL).fit(us, ys)
    assert model.x0_.shape == (4, 2)
    assert np.isfinite(model.predict(us, x0="training")[3]).all()


# -- delays ----------------------------------------------------------------------------


def coloured(white, pole):
    out = white.copy()
    for k in range(1, len(out)):
        out[k] = pole * out[k - 1] + white[k]
    return out


def late_record(delay, *, pole=0.0, seed=0, n=1000, feedthrough=False):
    """Return inputs and outputs of a plant with delays in its inputs."""
    rng = np.random.default_rng(seed)
    du = coloured(rng.standard_normal((n, len(delay))), pole)
    late = np.column_stack(
        [np.r_[np.zeros(d), z][:n] for z, d in zip(du.T, delay, strict=True)]
    )
    B = np.array([[1.0, 0.4, -0.3], [-0.5, 0.8, 0.6]])[:, : len(delay)]
    x, y = np.zeros(2), np.empty((n, 2))
    for k in range(n):
        y[k] = x + (B @ late[k] if feedthrough else 0)
        x = np.array([[0.7, 0.2], [-0.1, 0.5]]) @ x + B @ late[k]
    return 2 + 5 * du, 3 * (y + 0.01 * y.std() * rng.standard_normal(y.shape))


@pytest.mark.parametrize("feedthrough", [False, True])
@pytest.mark.parametrize("pole", [0.0, 0.9])
@pytest.mark.parametrize("delay", [[3], [0], [3, 0, 1]])
def test_auto_finds_the_delay(delay, pole, feedthrough):
    u, y = late_record(delay, pole=pole, feedthrough=feedthrough)
    model = LinearStateSpace(2, input_delay="auto", feedthrough=feedthrough)
    missing = np.random.default_rng(0).random(y.shape) < 0.1
    for outputs in (y, np.where(missing, np.nan, y)):
        model.fit(u, outputs)
        assert model.input_delay_.tolist() == delay
        assert model.score(u, y) > 0.999


@pytest.mark.parametrize("make", [make_pendulum, make_duffing])
@pytest.mark.parametrize("share", [0.0, 0.2])
@pytest.mark.parametrize("delay", [0, 3])
def test_auto_finds_the_delay_of_a_smooth_nonlinear_plant(make, share, delay):
    """To one sample: what its first answer is worth is close to the noise."""
    missing = np.random.default_rng(0).random((4_000, 1)) < share
    record = make(4_000, noise=0.01, random_state=0)
    u = [record.u[:900], record.u[900:]]
    y = np.where(missing, np.nan, record.y)
    y = [y[:900], y[900:]]
    late = [np.vstack([u_i[delay:], u_i[:delay]]) for u_i in u]
    n = [len(u_i) - delay for u_i in u]
    late, y = ([z[:k] for z, k in zip(zs, n, strict=True)] for zs in (late, y))
    model = LinearStateSpace(2, input_delay="auto").fit(late, y)
    assert abs(model.input_delay_[0] - delay) <= 1


@pytest.mark.parametrize("nx", [2, "auto"])
def test_the_delay_of_many_short_experiments(nx, monkeypatch):
    """Stretches of all would be too short to show it."""
    # the same with ten times as many samples, and as many experiments
    monkeypatch.setattr(delays, "PREDICTED", delays.PREDICTED // 10)
    monkeypatch.setattr(delays, "SIMULATED", delays.SIMULATED // 10)
    u, y = (z / z.std() for z in late_record([3], n=3_000))
    u, y = u - u.mean(), y - y.mean(axis=0)
    experiments = list(zip(np.split(u, 50), np.split(y, 50), strict=True))
    assert estimate_delays(experiments, nx) == [3]


def test_auto_takes_no_delay_where_nothing_can_be_tested():
    rng = np.random.default_rng(0)
    u, y = late_record([3], n=40)
    assert LinearStateSpace(1, input_delay="auto").fit(u, y).input_delay_ == [0]
    y = rng.standard_normal((2_000, 1))  # no response at all
    u = rng.standard_normal((2_000, 1))
    assert LinearStateSpace(1, input_delay="auto").fit(u, y).input_delay_ == [0]


def test_a_delay_is_not_bridged_between_experiments():
    """Every experiment begins with its inputs at the operating point."""
    u, y = late_record([3, 1], n=300)
    model = LinearStateSpace(2, input_delay=[3, 1]).fit(u, y)
    labels = np.repeat([0, 1], [120, 180])
    together = model.predict(u, labels, x0=[0.2, 0.1])
    for part in (slice(0, 120), slice(120, 300)):
        alone = model.predict(u[part], x0=[0.2, 0.1])
        np.testing.assert_array_equal(together[part], alone)
        # what arrives first is the operating point, not the end of the last experiment
        x, dy = np.array([0.2, 0.1]), []
        for du in delayed(model, u[part])[:5]:
            dy.append(model.C_ @ x)
            x = model.A_ @ x + model.B_ @ du
        np.testing.assert_allclose(alone[:5] - model.y_offset_, dy, atol=1e-12)


@pytest.mark.parametrize("bad", [-1, [1, 2, 3], [0.5, 1.0], 75, "late"])
def test_wrong_delays(data, bad):
    us, ys = parts_of(data)
    with pytest.raises(ValueError, match="input_delay"):
        LinearStateSpace(2, input_delay=bad).fit(us, ys)


# -- linear starts and bounds ----------------------------------------------------------

START = (
    [[0.7, 0.2], [-0.2, 0.6]],
    [[0.4 / 3, 0.1 / 0.02], [0.0, 0.5 / 0.02]],
    [[110.0, 0.0], [0.0, 0.11]],
    [[20 / 3, 0.0], [0.0, 0.01 / 0.02]],
)


def exact():
    """Return a record of the start itself, without noise, from rest at zero."""
    u = np.random.default_rng(3).standard_normal((200, 2)) * [3.0, 0.02]
    sys = control.ss(*START, DT)
    return u, control.forced_response(sys, None, u.T).outputs.T


@pytest.mark.parametrize(
    "start", [START, control.ss(*START, DT), control.ss(*START, True)], ids=type
)
@pytest.mark.parametrize(
    "model", [LinearStateSpace(), al_ssnn(n_h=2, n_g=2), al_ssnn(n_h=0, n_g=0)]
)
def test_a_linear_start_keeps_its_basis(start, model):
    """Where the start is the truth nothing moves, in the units of the user."""
    u, y = exact()
    model = clone(model).set_params(
        linear_start=start, feedthrough=True, dt=DT, operating_point="zero", tol=1e-3
    )
    model.fit(u, y)
    got = model.A_, model.B_, model.C_, model.D_
    for value, expected in zip(got, START, strict=True):
        np.testing.assert_allclose(value, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(model.predict(u) / y.std(axis=0), y / y.std(axis=0))


@pytest.mark.parametrize("dt", [DT, True])
def test_an_estimator_with_a_system_as_start_can_be_pickled(dt):
    """What arrives fits as what left, to the bit, and minds the sampling time."""
    u, y = exact()
    model = al_ssnn(n_h=2, n_g=2, dt=DT, feedthrough=True, max_iter=5, tol=1e-3)
    model.set_params(linear_start=control.ss(*START, dt), random_state=0)
    arrived = pickle.loads(pickle.dumps(model))
    assert isinstance(model.linear_start, control.StateSpace)  # left as it was
    model.fit(u, y)
    fits = [arrived.fit(u, y), *(f(model) for f in (copy.deepcopy, copy.copy))]
    for other in [*fits, pickle.loads(pickle.dumps(model)), clone(arrived).fit(u, y)]:
        np.testing.assert_array_equal(other.predict(u), model.predict(u))
        np.testing.assert_array_equal(other.linear_start.D, START[3])
    if dt is not True:
        with pytest.raises(ValueError, match=r"sampling time dt=0\.5"):
            arrived.set_params(dt=0.5).fit(u, y)


@pytest.mark.parametrize("frozen", [False, True])
def test_a_fitted_model_starts_another_one(frozen):
    u, y = exact()
    options = {"dt": DT, "operating_point": "zero"}
    first = LinearStateSpace(2, feedthrough=True, **options).fit(u, y)
    start = FrozenEstimator(first) if frozen else first
    model = al_ssnn(n_h=2, n_g=0, feedthrough=True, linear_start=start, **options)
    model.set_params(tol=1e-3).fit(u, y)
    for name in ("A_", "B_", "C_", "D_"):
        np.testing.assert_allclose(
            getattr(model, name), getattr(first, name), rtol=1e-5, atol=1e-7
        )
    again = clone(model)
    if frozen:
        np.testing.assert_allclose(again.set_params(dt=DT).fit(u, y).A_, model.A_)
    else:
        with pytest.raises(ValueError, match=r"`clone` undid it.*FrozenEstimator"):
            again.fit(u, y)
    with pytest.raises(ValueError, match=r"dt=1.0, got 0.25"):
        model.set_params(dt=1.0).fit(u, y)


def test_a_start_is_improved_upon(data):
    u, y = data
    A, B, C, D = (np.array(M) for M in START)
    model = LinearStateSpace(
        linear_start=(A, 0.5 * B, C, D), feedthrough=True, max_iter=50
    ).fit(u, y)
    best = LinearStateSpace(2, feedthrough=True).fit(u, y)
    assert model.cost_ == pytest.approx(best.cost_, rel=1e-3)
    # without neurons C is fixed, which costs no accuracy
    lti = al_ssnn(n_h=0, n_g=0, linear_start=START, feedthrough=True).fit(u, y)
    np.testing.assert_allclose(lti.C_, C, rtol=1e-12, atol=1e-15)
    assert lti.cost_ == pytest.approx(best.cost_, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"linear_start": START}, "D = 0 for a model without feedthrough"),
        ({"linear_start": START[:2]}, "must be a tuple .A, B, C. or"),
        ({"linear_start": "n4sid"}, "must be a tuple .A, B, C. or"),
        ({"linear_start": (*START[:2], [[1.0, 0.0]])}, "finite C of shape"),
        ({"linear_start": (np.full((2, 2), np.nan), *START[1:3])}, "nan or infinity"),
        ({"linear_start": START[:3], "nx": 3}, "`nx` must be 'auto' or the order"),
        ({"linear_start": control.ss(*START[:3], 0, 0.5)}, "dt=0.25, got 0.5"),
        ({"linear_start": control.ss(*START[:3], 0)}, "dt=0.25, got 0. Use `control.s"),
    ],
)
def test_wrong_linear_starts(data, options, message):
    with pytest.raises(ValueError, match=message):
        LinearStateSpace(dt=DT, **options).fit(*data)


@pytest.mark.parametrize("cls", [LinearStateSpace, FlSsnn, AlSsnn, GrSsnn])
def test_bounds_hold_in_the_units_of_the_user(data, cls):
    A, B, C, D = (np.array(M) for M in START)
    low, high = np.full((2, 2), -np.inf), np.full((2, 2), np.inf)
    low[0, 1] = high[0, 1] = 0.3  # held, away from where it wants to be
    high[1, 0] = -0.25
    B_low = np.array([[-np.inf, 4.0], [0.0, -np.inf]])
    B_high = np.array([[0.12, 4.5], [0.0, np.inf]])
    bounds = {"A": (low, high), "B": (B_low, B_high)}
    model = cls(linear_start=(A, B, C), max_iter=15)
    if "feedthrough" in model.get_params():
        model.set_params(linear_start=START, feedthrough=True)
        bounds["D"] = D, D
    if "random_state" in model.get_params():
        # of a search, see `test_search.py`
        model.set_params(random_state=0, alpha=0.0, n_init=1)
    model.set_params(bounds=bounds).fit(*data)
    assert model.A_[0, 1] == 0.3
    assert model.A_[1, 0] <= -0.25
    assert model.B_[1, 0] == 0.0
    assert (model.B_ >= B_low).all() and (model.B_ <= B_high).all()
    if "D" in bounds:
        np.testing.assert_array_equal(model.D_, D)
    assert np.all(np.diag(model.A_) != np.diag(A))  # the others are free
    # what is published is what is simulated
    x, dy = np.array([0.3, -0.2]), model.predict(data[0][:2], x0=[0.3, -0.2])
    x, *_ = equations(model, x, data[0][0] - model.u_offset_)
    _, expected, *_ = equations(model, x, data[0][1] - model.u_offset_)
    np.testing.assert_allclose(dy[1] - model.y_offset_, expected, rtol=1e-9)


def test_bounds_of_D_need_no_basis(data):
    for model in (
        LinearStateSpace(2, feedthrough=True, bounds={"D": (-np.inf, 0.0)}),
        al_ssnn(n_h=0, n_g=0, nx=2, feedthrough=True, bounds={"D": (-np.inf, 0.0)}),
    ):
        assert (model.set_params(max_iter=20).fit(*data).D_ <= 0).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bounds": {"A": (0, 1)}}, "need a basis of the states"),
        ({"bounds": {"C": (0, 1)}, "linear_start": START[:3]}, "for A, B, the free"),
        ({"bounds": {"D": (0, 1)}}, "for A, B, the free matrices"),
        ({"bounds": {"E": (0, 1)}}, "the free matrices of this model, got 'E'"),
        ({"bounds": {"A": (1, 0)}, "linear_start": START[:3]}, "low <= high"),
        ({"bounds": {"A": (np.nan, 0)}, "linear_start": START[:3]}, "low <= high"),
        ({"bounds": {"A": 0.5}, "linear_start": START[:3]}, r"a pair \(low, high\)"),
        ({"bounds": {"A": (0, 1, 2)}, "linear_start": START[:3]}, "must be a pair"),
        (
            {"bounds": {"B": (np.zeros(3), 1)}, "linear_start": START[:3]},
            r"arrays of shape \(2, 2\)",
        ),
        (
            {
                "bounds": {"A": (0, 1)},
                "linear_start": START[:3],
                "stability": "contractive",
            },
            "no stability=",
        ),
    ],
)
def test_wrong_bounds(data, options, message):
    with pytest.raises(ValueError, match=message):
        al_ssnn(n_h=2, n_g=2, **options).fit(*data)


# -- initial states --------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:No confidence band holds")  # it does not start so
@pytest.mark.filterwarnings("ignore:The confidence bands are wider")
@pytest.mark.parametrize("cls", [LinearStateSpace, FlSsnn, AlSsnn, GrSsnn])
def test_initial_states_at_rest(data, cls):
    """Held on whole records, after a coarse stretch as well."""
    u, y = data
    labels = np.repeat([0, 1], [len(u) // 3, len(u) - len(u) // 3])
    model = cls(nx=2, initial_state="rest", max_iter=10, tol=1e-12)
    if cls is not LinearStateSpace:
        model.set_params(alpha=0.0, n_init=1)  # of a search, see `test_search.py`
    if cls is AlSsnn:
        model.set_params(stability="contractive", penalty="output")
    for coarse in (None, 60):
        if "coarse_samples" in model.get_params():
            model.set_params(coarse_samples=coarse, polish_iter=5, random_state=0)
        model.fit(u, y, labels)
        np.testing.assert_array_equal(model.x0_, np.zeros((2, 2)))
        # the cost is that of a simulation from there
        np.testing.assert_array_equal(
            model.predict(u, labels, x0="training"), model.predict(u, labels, x0="rest")
        )
    free = model.parameter_covariance(u, y, labels)
    estimated = clone(model).set_params(initial_state="estimate").fit(u, y, labels)
    known = free.n_effective
    assert known < estimated.parameter_covariance(u, y, labels).n_effective


def test_a_network_that_starts_at_rest_is_right_there():
    """With x0 free, another state with C x = 0 may take the place of rest.

    The training cost is the same, but a simulation from rest begins wrong.
    """
    system = model_class.KINDS["two-layer g"]
    (us, ys), (u, y, noise) = model_class.data(system, seed=0)
    options = {"operating_point": "zero", "max_iter": 150, "random_state": 2}
    free = gr_ssnn(2, n_f=(2, 2), **options).fit(us, ys)
    rest = gr_ssnn(2, n_f=(2, 2), initial_state="rest", **options).fit(us, ys)
    assert rest.cost_ == pytest.approx(free.cost_, rel=1e-3)
    error, wrong = (np.std(y - model.predict(u)) for model in (rest, free))
    assert error < 1.05 * noise.std() < 1.4 * noise.std() < wrong


# -- weights of outputs ----------------------------------------------------------------


def test_output_weight_moves_the_error(data):
    u, y = data
    e = {}
    for weight in ([1.0, 0.01], [0.01, 1.0]):
        for model in (LinearStateSpace(1), al_ssnn(1, 0, 0)):
            model.set_params(output_weight=weight, feedthrough=False).fit(u, y)
            error = (model.predict(u, x0="training") - y) / y.std(axis=0)
            e[tuple(weight), type(model)] = np.mean(error**2, axis=0)
    for cls in (LinearStateSpace, AlSsnn):
        first, second = e[(1.0, 0.01), cls], e[(0.01, 1.0), cls]
        assert first[0] < 0.9 * second[0] and second[1] < 0.9 * first[1]


@pytest.mark.parametrize("weight", [[1.0], [1.0, -1.0], [0.0, 0.0], [np.nan, 1.0]])
def test_wrong_output_weights(data, weight):
    with pytest.raises(ValueError, match="one nonnegative number per output"):
        al_ssnn(output_weight=weight, **SMALL).fit(*data)


# -- large records ---------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, [2, 0]])
def test_single_precision_on_disk(tmp_path, data, delay):
    us, ys = (np.asarray(z, dtype=np.float32) for z in data)
    paths = [tmp_path / "u.npy", tmp_path / "y.npy"]
    for path, array in zip(paths, (us, ys), strict=True):
        np.save(path, array)
    u, y = (np.load(path, mmap_mode="r") for path in paths)
    model = al_ssnn(n_h=2, n_g=2, input_delay=delay, **SMALL)
    disk = clone(model).fit(u, y)
    memory = clone(model).fit(us.astype(float), ys.astype(float))
    scale = data[1].std(axis=0)
    difference = (disk.predict(u) - memory.predict(us.astype(float))) / scale
    np.testing.assert_allclose(difference, 0, atol=1e-6)
    assert disk.predict(u).dtype == float
    assert disk.score(u, y) == pytest.approx(memory.score(us, ys), abs=1e-6)


def test_the_memory_of_a_fit_does_not_grow_with_the_record(tmp_path, monkeypatch):
    n, path = 120_000, tmp_path / "record.npy"
    disk = np.lib.format.open_memmap(path, "w+", np.float32, (n, 2))
    disk[:] = np.random.default_rng(0).standard_normal((n, 2))
    u, y = disk[:, :1], disk[:, 1:]
    # what looks at so many samples at most, at so few
    monkeypatch.setattr(_checks, "DELAY_SAMPLES", 1000)
    monkeypatch.setattr(starts, "START_SAMPLES", 1000)
    model = fl_ssnn(1, n_h=1, max_iter=1, polish_iter=1, random_state=0)
    model.set_params(coarse_samples=2000, input_delay="auto")
    model.set_params(linear_start=([[0.5]], [[1.0]], [[1.0]]))  # quicker than N4SID
    model.fit(u[:4000], y[:4000])  # compiles the kernels
    peaks = []
    for part in (slice(0, n // 2), slice(0, n)):
        tracemalloc.start()
        model.fit(u[part], y[part])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # a copy of one signal of what was added, in single precision, would be more
    assert peaks[1] - peaks[0] < 4 * (n // 2)

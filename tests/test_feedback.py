import pickle
import warnings
from dataclasses import replace

import control
import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning, NotFittedError

from alssnn import LinearStateSpace
from alssnn.feedback import (
    LinearizingLaw,
    Observer,
    closed_loop,
    designed_loop,
    input_range,
    lqi,
    lqr,
    place,
)
from alssnn.feedback.law import leaves_range
from alssnn.names import signal_names
from helpers import linear_plant, simulate_linear
from models import al_ssnn, fl_ssnn, gr_ssnn

DT = 0.25
SMALL = {"max_iter": 12, "tol": 1e-2, "random_state": 0, "dt": DT}
MODELS = {
    "linear": LinearStateSpace(nx=2, dt=DT),
    "gr": gr_ssnn(nx=2, n_f=2, **SMALL),
    "fl": fl_ssnn(nx=2, n_h=3, **SMALL),
    "fl-state": fl_ssnn(nx=2, n_h=3, feedback="state", **SMALL),
    "al": al_ssnn(nx=2, n_h=2, n_g=2, gamma=0.01, **SMALL),
    "al-output": al_ssnn(
        nx=2, n_h=2, n_g=2, feedback="state", penalty="output", **SMALL
    ),
}
T = DT * np.arange(200)


def plant_record(n_u):
    """Return a nonlinear record in odd units, with named columns."""
    rng = np.random.default_rng(0)
    A = np.array([[0.7, 0.2], [-0.2, 0.6]])
    B = np.array([[0.4, 0.1], [0.0, 0.5]])[:, :n_u]
    du = rng.standard_normal((400, n_u))
    x, y = np.zeros(2), np.empty((400, 2))
    for k in range(400):
        y[k] = x
        x = A @ x + B @ (du[k] + 0.5 * np.tanh(x[:n_u]))
    y += 0.01 * rng.standard_normal(y.shape)
    u = du * [3.0, 0.02][:n_u] + [10.0, -1.0][:n_u]
    y = (y * [100.0, 0.1] + [5.0, 7.0])[:, :n_u]
    return (
        pd.DataFrame(u, columns=["valve.a", "pump"][:n_u]),
        pd.DataFrame(y, columns=["level", "flow"][:n_u]),
    )


@pytest.fixture(scope="module")
def fitted():
    models = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for n_u in (1, 2):
            u, y = plant_record(n_u)
            for name, model in MODELS.items():
                models[name, n_u] = clone(model).fit(u, y)
    return models


@pytest.fixture(params=[(m, n) for m in MODELS for n in (1, 2)], ids=str)
def model(request, fitted):
    return fitted[request.param]


@pytest.fixture
def u(model):
    return plant_record(model.n_features_in_)[0][: len(T)]


def respond(sys, signals, x0=None):
    """Return the response with time running down the rows."""
    x0 = np.zeros(sys.nstates) if x0 is None else x0
    time = DT * np.arange(len(signals))
    response = control.input_output_response(
        sys, time, np.asarray(signals).T, x0, squeeze=False
    )
    return response.outputs.T, response.states.T


def rest(model, n):
    """Return n samples of the reference at the operating point."""
    return np.tile(model.y_offset_, (n, 1))


# -- exports ---------------------------------------------------------------------------


def test_to_nlsys_responds_as_predict(model, u):
    x0 = np.array([0.3, -0.2])
    y, _ = respond(model.to_nlsys(), u, x0)
    np.testing.assert_allclose(y, model.predict(u, x0=x0), rtol=1e-9)


def test_names_and_sampling_time_survive(model):
    n = model.n_features_in_
    for sys in (
        model.to_nlsys(),
        model.to_statespace(),
        model.to_statespace("local"),
    ):
        assert sys.dt == DT
        assert sys.input_labels == ["valve_a", "pump"][:n]
        assert sys.output_labels == ["level", "flow"][:n]
        assert sys.state_labels == ["x[0]", "x[1]"]
    loop = closed_loop(model, model, lqr(model, np.eye(2), np.eye(n)))
    v = ["v[0]", "v[1]"][:n]
    assert loop.output_labels == [*["level", "flow"][:n], *["valve_a", "pump"][:n], *v]
    assert loop.dt == DT


@pytest.mark.parametrize("point", [None, 1.0])
def test_local_linearization_is_that_of_python_control(model, point):
    x, du = None, None
    if point:
        x, du = np.array([0.5, -0.3]), 0.4 * model._scaling.u_scale
    local = model.to_statespace("local", x, du)
    at = (np.zeros(2) if x is None else x, model.u_offset_ + (0 if du is None else du))
    numerical = control.linearize(model.to_nlsys(), *at, eps=1e-7)
    for name in "ABCD":
        matrix = getattr(local, name)
        atol = 1e-5 * max(1e-3, np.abs(matrix).max())
        np.testing.assert_allclose(getattr(numerical, name), matrix, atol=atol)
    if "W_h" not in model.params_ and "W_g" not in model.params_:
        np.testing.assert_array_equal(local.A, model.A_)


def test_models_and_what_is_made_from_them_can_be_pickled(model, u):
    model.to_nlsys(), model.to_statespace("local")
    law, observer = model.linearizing_law(), model.observer()
    law.to_nlsys(), observer.to_nlsys()
    copy = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(copy.predict(u), model.predict(u))
    y = model.predict(u)
    twin = pickle.loads(pickle.dumps(observer))
    np.testing.assert_array_equal(twin.filter(u, y), observer.filter(u, y))
    v, s = np.asarray(u), y if law.feedback == "output" else observer.filter(u, y)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(law))(v, s), law(v, s))
    pickle.dumps(model.to_nlsys().updfcn)


# -- law -------------------------------------------------------------------------------


def test_law_leaves_the_linear_part(model, u):
    if "W_g" in model.params_:
        pytest.skip("g remains")
    n, law, x0 = model.n_features_in_, model.linearizing_law(), np.array([0.3, -0.2])
    plant, v = model.to_nlsys(), np.asarray(u)
    x, y = x0, np.empty((len(v), n))
    for k in range(len(v)):
        y[k] = plant.output(0, x, v[k])
        x = plant.dynamics(0, x, law(v[k], x if law.feedback == "state" else y[k]))
    linear = simulate_linear(model.A_, model.B_, model.C_, v - model.u_offset_, x0)
    np.testing.assert_allclose(y, linear + model.y_offset_, rtol=1e-9)
    # the same loop, connected by python-control: v = r with a gain of zero
    loop = closed_loop(model, model, np.zeros((n, 2)))
    z, _ = respond(loop, v, x0)
    np.testing.assert_allclose(z[:, :n], y, rtol=1e-9)
    np.testing.assert_allclose(z[:, 2 * n :], v, rtol=1e-12)


def test_a_law_says_what_it_measures_and_inputs_where_they_were():
    u, y = map(np.asarray, plant_record(1))
    model = LinearStateSpace(nx=2, input_delay=1).fit(u + 5, y)
    np.testing.assert_allclose(np.ravel(input_range(model)), [u.min() + 5, u.max() + 5])
    ends = np.array([[u.min() + 5, u.max() + 5]])
    for beyond, leaves in ((0.0, False), (1e-9, False), (1e-3, True)):
        assert leaves_range(model, ends + beyond) == leaves  # rounding does not count
        assert leaves_range(model, ends - beyond) == leaves
    state = replace(model.plant_.late(), feedback="state")
    assert LinearizingLaw(state).n_seen == 2  # not the past of late inputs
    assert repr(LinearizingLaw(state)) == "LinearizingLaw(u = v)"


def test_law_of_rows_is_the_law_of_each_row(model, u, rng):
    law, v = model.linearizing_law(), np.asarray(u)[:5]
    ns = 2 if law.feedback == "state" else len(model.C_)
    s = rng.standard_normal((5, ns))
    single = np.array([law(*pair) for pair in zip(v, s, strict=True)])
    np.testing.assert_allclose(law(v, s), single, rtol=1e-12)
    np.testing.assert_allclose(
        law.to_nlsys().output(0, [], np.r_[v[0], s[0]]), single[0], rtol=1e-12
    )
    if "W_h" not in model.params_:
        np.testing.assert_array_equal(law(v, s), v)


def test_law_saturates_and_says_how_much(model, u, rng):
    v = np.asarray(u)
    low, high = np.quantile(v, 0.2, axis=0), np.quantile(v, 0.8, axis=0)
    law = model.linearizing_law(low, high)
    s = rng.standard_normal((len(v), 2 if law.feedback == "state" else len(model.C_)))
    s = s if law.feedback == "state" else s + model.y_offset_
    applied, cut = law.split(v, s)
    assert np.any(cut > 0)
    assert np.any(cut < 0)
    assert np.all((low <= applied) & (applied <= high))
    np.testing.assert_allclose(applied + cut, model.linearizing_law()(v, s))
    h = law.h(s)
    inside = (low + h <= v) & (v <= high + h)
    np.testing.assert_array_equal(inside, cut == 0)


def test_a_lost_signal_leaves_the_others_what_they_are(fitted):
    """In a block of a loop: one v is not a number, the other is beyond its limit."""
    model = fitted["linear", 2]
    low, high = model.u_offset_ - 1, model.u_offset_ + 1
    law = model.linearizing_law(low, high).to_nlsys(with_cut=True)
    v = np.array([np.nan, model.u_offset_[1] + 3])
    u_cut = law.output(0, [], np.concatenate([v, model.y_offset_]))
    np.testing.assert_allclose(u_cut, [model.u_offset_[0], high[1], 0, 2])


# -- observer --------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["kalman", "ekf"])
def test_observer_converges_to_the_true_state(model, u, kind):
    x0 = np.array([0.5, -0.4])
    y, X = respond(model.to_nlsys(), u, x0)
    observer = model.observer(kind=kind)
    error = np.abs(observer.filter(u, y) - X).max(axis=1)
    assert error[-50:].max() < 1e-5 * max(error[0], 0.1)
    np.testing.assert_array_equal(observer.x_hat, np.zeros(2))  # not moved
    np.testing.assert_allclose(observer.filter(u, y, x0), X, atol=1e-9)


@pytest.mark.parametrize("kind", ["kalman", "ekf"])
def test_observer_online_on_records_and_as_a_system(model, u, kind):
    y, _ = respond(model.to_nlsys(), u, [0.5, -0.4])
    observer, u = model.observer(kind=kind), np.asarray(u)
    X_hat = observer.filter(u, y)
    for _ in range(2):
        online = [observer.step(u[max(k - 1, 0)], y[k]) for k in range(len(u))]
        np.testing.assert_array_equal(online, X_hat)
        observer.reset()
    start = observer.initial_state()
    system, _ = respond(observer.to_nlsys(), np.hstack([u, y]), start)
    np.testing.assert_allclose(system, X_hat, atol=1e-12)
    assert not np.any(start)  # as the blocks of a loop begin


def test_both_kinds_agree_on_a_linear_model(fitted):
    model = fitted["linear", 2]
    u, y = plant_record(2)
    kalman, ekf = (model.observer(kind=k).filter(u, y)[-1] for k in ("kalman", "ekf"))
    np.testing.assert_allclose(kalman, ekf, atol=1e-8)


def test_trust_in_the_measurement_raises_the_gain(fitted):
    model, R = fitted["fl", 1], plant_record(1)[1].to_numpy().var() * np.eye(1)
    sizes = [np.linalg.norm(model.observer(R=r * R).gain) for r in (1e-4, 1e-2, 1)]
    assert sizes[0] > sizes[1] > sizes[2]


# -- closed loops ----------------------------------------------------------------------


def test_a_loop_takes_either_kind_of_observer(fitted):
    model = fitted["fl-state", 2]
    K = lqr(model, np.eye(2), np.eye(2))
    r = model.u_offset_ + 0.1 * np.sin(np.arange(60))[:, None]
    # the model as its own plant, from rest: no error to correct, whatever the gain
    outputs = [
        respond(closed_loop(model, model, K, observer=model.observer(kind=kind)), r)[0]
        for kind in ("kalman", "ekf")
    ]
    np.testing.assert_allclose(*outputs, atol=1e-10)
    assert np.ptp(outputs[0], axis=0).min() > 1e-3


def test_weights_may_be_asymmetric_by_rounding(fitted):
    model = fitted["linear", 2]
    Q = np.array([[1.0, 0.3], [0.3, 2.0]])
    rounded = Q + np.diag([1e-12], 1)
    R = np.eye(model.B_.shape[1])
    np.testing.assert_allclose(lqr(model, rounded, R), lqr(model, Q, R), rtol=1e-9)


def test_lqr_of_the_true_state_is_the_linear_loop(fitted):
    for key in [("fl", 1), ("fl-state", 2), ("linear", 2)]:
        model = fitted[key]
        n = key[1]
        K = lqr(model, np.eye(2), np.diag(1 / model._scaling.u_scale**2))
        r = plant_record(n)[0].to_numpy()[: len(T)]
        loop = closed_loop(model, model, K)
        y, _ = respond(loop, r, np.array([0.3, -0.2]))
        A = model.A_ - model.B_ @ K
        linear = simulate_linear(
            A, model.B_, model.C_, r - model.u_offset_, [0.3, -0.2]
        )
        np.testing.assert_allclose(y[:, :n], linear + model.y_offset_, rtol=1e-9)
        poles = [0.3, 0.5]
        placed = np.linalg.eigvals(model.A_ - model.B_ @ place(model, poles))
        np.testing.assert_allclose(np.sort(placed), poles, atol=1e-9)


# one input from the true state, two from an observer
@pytest.mark.parametrize("name", ["linear", "fl", "fl-state", "al"])
@pytest.mark.parametrize(("n", "observed"), [(1, False), (2, True)])
def test_lqi_tracks_a_step_without_offset(fitted, name, n, observed):
    model = fitted[name, n]
    u_scale, y_scale = model._scaling.u_scale, model._scaling.y_scale
    Q = np.diag(np.r_[np.ones(2), 0.05 / y_scale**2])
    K = lqi(model, Q, np.diag(1 / u_scale**2))
    assert K.shape == (n, 2 + n)
    observer = model.observer() if observed else None
    loop = closed_loop(model, model, K, observer=observer)
    r = rest(model, 250)
    r[20:] += 0.4 * y_scale
    y, _ = respond(loop, r)
    np.testing.assert_allclose((y[-1, :n] - r[-1]) / y_scale, 0, atol=1e-6)


@pytest.mark.parametrize("name", ["fl", "fl-state"])
@pytest.mark.parametrize("error_only", [False, True])
def test_linear_controller_on_another_plant(fitted, name, error_only):
    model, plant = fitted[name, 1], fitted["gr", 1]
    gain = 0.05 * model._scaling.u_scale[0] / model._scaling.y_scale[0]
    sign = np.sign(model.to_statespace().dcgain()).item()
    B = [[1.0]] if error_only else [[1.0, -1.0]]
    D = np.zeros((1, len(B[0])))
    integral = control.ss([[1.0]], B, [[sign * gain]], D, DT)
    loop = closed_loop(plant, model, controller=integral)
    r = rest(model, 600)
    r += 0.3 * model._scaling.y_scale
    y, _ = respond(loop, r)
    assert y[-1, 0] == pytest.approx(r[-1, 0], abs=1e-3 * model._scaling.y_scale[0])
    assert loop.ninputs == 1


def test_loop_starts_with_limits_in_its_law(fitted):
    model = fitted["fl", 1]
    top = model.u_offset_ + 0.1 * model._scaling.u_scale
    law = model.linearizing_law(u_max=top)
    loop = closed_loop(model, model, np.zeros((1, 2)), law=law)
    y, _ = respond(loop, plant_record(1)[0][:100])
    assert y[:, 1].max() == pytest.approx(top.item())
    assert y[:, 2].max() > top.item()


@pytest.mark.parametrize("name", ["linear", "fl", "fl-state"])
@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.parametrize("integrates", [False, True])
def test_designed_loop_is_that_of_an_exactly_linearized_plant(
    fitted, name, n, integrates
):
    model = fitted[name, n]
    u_scale, y_scale = model._scaling.u_scale, model._scaling.y_scale
    R = np.diag(1 / u_scale**2)
    if integrates:
        K = lqi(model, np.diag(np.r_[np.ones(2), 0.05 / y_scale**2]), R)
        offset, r = model.y_offset_, rest(model, 100)
        r[20:] += 0.4 * y_scale
    else:
        K = lqr(model, np.eye(2), R)
        offset, r = model.u_offset_, plant_record(n)[0].to_numpy()[:100]
    signals, _ = respond(closed_loop(model, model, K), r)
    design = designed_loop(model, K)
    expected, _ = respond(design, r - offset)
    np.testing.assert_allclose(
        (signals[:, :n] - model.y_offset_) / y_scale,
        expected[:, :n] / y_scale,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        (signals[:, 2 * n :] - model.u_offset_) / u_scale,
        expected[:, n:] / u_scale,
        atol=1e-9,
    )
    assert design.dt == DT and np.abs(design.poles()).max() < 1


@pytest.mark.parametrize("n", [1, 2])
def test_integrators_do_not_wind_up(fitted, n):
    model = fitted["fl", n]
    u_scale, y_scale = model._scaling.u_scale, model._scaling.y_scale
    Q = np.diag(np.r_[np.ones(2), 0.5 / y_scale**2])
    K = lqi(model, Q, np.diag(1 / u_scale**2))
    # an unreachable reference for long, then one within the limits
    r = rest(model, 300)
    r[20:150] += 5 * y_scale
    loops = [
        closed_loop(model, model, K, law=model.linearizing_law(*limits))
        for limits in (
            (model.u_offset_ - 0.5 * u_scale, model.u_offset_ + 0.5 * u_scale),
            (None, None),
        )
    ]
    (limited, states), (free, _) = (respond(loop, r) for loop in loops)
    u = slice(n, 2 * n)
    assert np.abs(free[:, u] - model.u_offset_).max() > u_scale.min()
    np.testing.assert_allclose(  # they did saturate
        np.abs(limited[140, u] - model.u_offset_), 0.5 * u_scale
    )
    settled = np.abs((limited[:, :n] - model.y_offset_) / y_scale).max(axis=1) < 0.05
    assert settled[175:].all()
    np.testing.assert_allclose(limited[-1, :n], r[-1], atol=1e-6 * y_scale.max())
    # wound up, the integrators would hold the sum of 130 samples of the error
    z = states[150, -n:] / y_scale
    wound_up = ((limited[20:150, :n] - r[20:150]) / y_scale).sum(axis=0)
    assert np.all(np.abs(z) < 0.1 * np.abs(wound_up))


def test_plants_of_python_control(fitted):
    model = fitted["linear", 1]
    K, r = np.zeros((1, 2)), rest(model, 30)
    s = control.ss(model.A_, model.B_, model.C_, model.D_, DT)
    for plant in (s, control.ss2tf(s), control.ss(*s_matrices(s), True)):
        loop = closed_loop(plant, model, K)
        y, _ = respond(loop, r)
        np.testing.assert_allclose(
            y[:, 0], simulate_linear(s.A, s.B, s.C, r)[:, 0], rtol=1e-6
        )


def s_matrices(s):
    return s.A, s.B, s.C, s.D


# -- errors ----------------------------------------------------------------------------


def test_unfitted_models():
    model = fl_ssnn()
    for call in (
        model.to_nlsys,
        lambda: model.to_statespace("local"),
        model.linearizing_law,
        model.observer,
        lambda: lqr(model, 1, 1),
        lambda: lqi(model, 1, 1),
        lambda: place(model, [0]),
        lambda: closed_loop(model, model, 1),
        lambda: designed_loop(model, 1),
    ):
        with pytest.raises(NotFittedError):
            call()


def static(sizes, dt=DT, D=0.0):
    ny, nu = sizes
    return control.ss(
        0.5 * np.eye(1), np.ones((1, nu)), np.ones((ny, 1)), np.full((ny, nu), D), dt
    )


Z = np.zeros((2, 2))
ERRORS = {
    "which": (lambda m: m.to_statespace("all"), "`which` must be 'linear' or 'local'"),
    "point of linear part": (
        lambda m: m.to_statespace(x=[0, 0]),
        "must be None for the linear part.*which='local'",
    ),
    "x": (lambda m: m.to_statespace("local", [1]), r"`x` must have shape \(2,\)"),
    "u": (
        lambda m: m.to_statespace("local", None, [np.nan, 0]),
        "`u` must be finite",
    ),
    "limit": (lambda m: m.linearizing_law([1, 2, 3]), "`u_min` must be a number or"),
    "nan limit": (lambda m: m.linearizing_law(None, np.nan), "`u_max`.*without NaN"),
    "limits": (lambda m: m.linearizing_law(1, 0), "`u_min` must be below `u_max`"),
    "v": (lambda m: m.linearizing_law()([1], [1, 2]), r"`v` must have shape \(2,\)"),
    "s": (lambda m: m.linearizing_law()([1, 2], [1]), r"`s` must have shape \(2,\)"),
    "rows": (lambda m: m.linearizing_law()(Z, Z[:1]), "same number of rows.*1 and 2"),
    "kind": (lambda m: m.observer(kind="ukf"), "`kind` must be 'kalman' or 'ekf'"),
    "Q": (lambda m: m.observer(np.eye(3)), r"`Q` must have shape \(2, 2\)"),
    "Q infinite": (
        lambda m: m.observer(np.full((2, 2), np.inf)),
        "`Q`.*semidefinite.*nan",
    ),
    "Q negative": (lambda m: m.observer(-np.eye(2)), "`Q`.*semidefinite.*-1"),
    "R": (lambda m: m.observer(R=Z), "`R`.*positive definite.*positive weights"),
    "R asymmetric": (
        lambda m: m.observer(R=[[1, 1], [0, 1]]),
        "`R` must be symmetric",
    ),
    "small R asymmetric": (  # in whatever units
        lambda m: lqr(m, np.eye(2), 1e-10 * np.array([[1, 0.9], [0, 1]])),
        "`R` must be symmetric",
    ),
    "x0": (lambda m: m.observer().reset([1]), r"`x0` must have shape \(2,\)"),
    "step": (lambda m: m.observer().step([1, 1], [1]), r"`y` must have shape \(2,\)"),
    "filter": (
        lambda m: m.observer().filter(Z, Z[:1]),
        r"shapes \(N, 2\) and \(N, 2\).*Time runs down",
    ),
    "filter nothing": (
        lambda m: m.observer().filter(Z[:0], Z[:0]),
        "Time runs down the rows, at least one",
    ),
    "filter numbers": (lambda m: m.observer().filter(1.0, 2.0), "must have shapes"),
    "lqr R": (lambda m: lqr(m, np.eye(2), Z), "`R`.*positive definite"),
    "lqi Q": (lambda m: lqi(m, np.eye(2), np.eye(2)), r"`Q` must have shape \(4, 4\)"),
    "poles": (lambda m: place(m, [0.1]), r"`poles` must have shape \(2,\)"),
    "pairs": (
        lambda m: place(m, [0.1 + 0.1j, 0.2]),
        "`poles` must come in conjugate pairs.*apart",
    ),
    "no gain": (lambda m: closed_loop(m, m), "Exactly one.*got none"),
    "both": (
        lambda m: closed_loop(m, m, Z, controller=static((2, 2))),
        "Exactly one.*got both",
    ),
    "gain": (
        lambda m: closed_loop(m, m, np.zeros((2, 3))),
        r"`gain` must be finite and have shape \(2, 2\) or \(2, 4\)",
    ),
    "controller": (
        lambda m: closed_loop(m, m, controller=static((2, 3))),
        r"`controller` must have 2 outputs and 2 inputs \(r - y\) or 4",
    ),
    "continuous controller": (
        lambda m: closed_loop(m, m, controller=static((2, 2), 0)),
        "`controller` must be discrete in time.*Discretize",
    ),
    "continuous plant": (
        lambda m: closed_loop(static((2, 2), 0), m, Z),
        "`plant` must be discrete in time with dt=0.25.*Discretize",
    ),
    "dt of plant": (
        lambda m: closed_loop(static((2, 2), 0.1), m, Z),
        "`plant` must have the sampling time of the model, dt=0.25, got 0.1",
    ),
    "size of plant": (
        lambda m: closed_loop(static((1, 2)), m, Z),
        r"`plant` must have as many inputs and outputs as the model, \(2, 2\), got",
    ),
}


@pytest.mark.parametrize(("call", "message"), ERRORS.values(), ids=ERRORS)
def test_errors(fitted, call, message):
    with pytest.raises(ValueError, match=message):
        call(fitted["fl", 2])


def test_parts_of_another_model(fitted):
    model, other = fitted["fl", 2], fitted["fl", 1]
    with pytest.raises(ValueError, match=r"`law`.*\(4, 2\), got \(2, 1\)"):
        closed_loop(model, model, Z, law=other.linearizing_law())
    with pytest.raises(ValueError, match=r"`observer`.*\(4, 2\), got \(2, 2\)"):
        closed_loop(model, model, Z, observer=other.observer())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"plant": "motor"}, "`plant` must be a fitted model or a system.*got str"),
        ({"law": "u = v"}, "`law` must be a LinearizingLaw, got str"),
        ({"observer": Z}, "`observer` must be an Observer, got ndarray"),
        ({"gain": None, "controller": Z}, "`controller` must be a StateSpace or"),
    ],
)
def test_wrong_types(fitted, options, message):
    model = fitted["fl", 2]
    with pytest.raises(TypeError, match=message):
        closed_loop(**{"plant": model, "model": model, "gain": Z, **options})


def test_uncontrollable_pairs():
    B = np.array([[0.0, 0.0], [1.0, 2.0]])
    model = linear_plant(np.diag([1.2, 0.5]), B)
    message = r"controllable pair \(A, B\), got a mode 1.2.*Lower `nx`"
    with pytest.raises(ValueError, match=message):
        lqr(model, np.eye(2), np.eye(2))
    with pytest.raises(ValueError, match="controllable pair"):
        lqi(model, np.eye(4), np.eye(2))
    with pytest.raises(ValueError, match=message):
        place(model, [0.1, 0.2])
    model = linear_plant(np.diag([0.8, 0.5]), B)  # out of reach, but stable
    assert lqr(model, np.eye(2), np.eye(2)).shape == (2, 2)
    model = linear_plant(np.diag([0.8, 0.5]), B[:, :1])
    with pytest.raises(ValueError, match="at most as many outputs as inputs, got 2"):
        lqi(model, np.eye(4), np.eye(1))


def test_models_that_no_observer_suits():
    model = linear_plant(np.diag([1.2, 0.5]), np.ones((2, 1)), np.array([[0.0, 1.0]]))
    with pytest.raises(ValueError, match=r"stable observer.*lower `nx`"):
        Observer(model)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["T", "T_2", "T", "q"], ["T", "T_2", "T_2_", "q"]),
        (["a", "a", "a"], ["a", "a_1", "a_2"]),
        (["a", "a_1_", "a_1", "a"], ["a", "a_1_", "a_1", "a_3"]),
        (["a_1", "a", "a", "a_2_"], ["a_1", "a", "a_2", "a_2_"]),
        (["x.y", "x_y"], ["x_y", "x_y_1"]),
    ],
)
def test_names_of_signals_are_unique(names, expected):
    assert signal_names(names, "", len(names)) == expected


def second_order(N):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((N, 1))
    y = lfilter([0.0, 1.0, 0.3], [1.0, -1.2, 0.5], u, axis=0)
    return u, y + 0.01 * rng.standard_normal(y.shape)


def test_an_observer_of_signals_of_one_name_has_an_input_for_each():
    u, y = second_order(300)
    frames = (pd.DataFrame(z, columns=["flow"]) for z in (u[:, :1], y[:, :1]))
    system = LinearStateSpace(nx=2).fit(*frames).observer().to_nlsys()
    assert system.input_labels == ["flow", "flow_1"] and system.ninputs == 2


@pytest.mark.parametrize("size", [1.0, 1e-9, 1e9])
def test_placed_poles_do_not_depend_on_units(size):
    u, y = second_order(400)
    model = LinearStateSpace(nx=2).fit(u[:, :1], y[:, :1])
    scaled = LinearStateSpace(nx=2).fit(size * u[:, :1], y[:, :1] / size)
    poles = [0.3, 0.4]
    K = place(scaled, poles)
    found = np.sort(np.linalg.eigvals(scaled.A_ - scaled.B_ @ K).real)
    np.testing.assert_allclose(found, poles, rtol=1e-6)
    np.testing.assert_allclose(K, size * place(model, poles), rtol=1e-5)
    with pytest.raises(ValueError, match="`poles` must be finite"):
        place(model, [0.3, np.nan])

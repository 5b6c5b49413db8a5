import pickle
import warnings

import control
import cvxpy as cp
import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning, NotFittedError

from alssnn import LinearStateSpace
from alssnn.datasets import make_duffing, make_pendulum
from alssnn.feedback import DisturbanceObserver, Observer
from alssnn.mpc import LinearizingMPC
from alssnn.mpc._limits import ActuatorLimits
from alssnn.mpc._target import STEP, Target
from helpers import linear_plant
from models import al_ssnn, fl_ssnn

DT = 0.5


def mimo_plant(n_y=3):
    """Return a nonlinear plant with 2 inputs in odd units, and records of it."""
    A = np.array([[0.8, 0.2, 0.0], [-0.2, 0.7, 0.1], [0.0, 0.0, 0.6]])
    B = np.array([[0.4, 0.1], [0.0, 0.5], [0.3, -0.2]])
    C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]])[:n_y]
    u_size, u_e = np.array([3.0, 0.02]), np.array([10.0, -1.0])
    y_size, y_e = np.array([100.0, 0.1, 1.0])[:n_y], np.array([5.0, 7.0, 0.0])[:n_y]

    def update(t, x, u, params):
        return A @ x + B @ ((u - u_e) / u_size + 0.4 * np.tanh((C @ x)[:2]))

    def output(t, x, u, params):
        return C @ x * y_size + y_e

    plant = control.nlsys(update, output, inputs=2, outputs=n_y, states=3, dt=DT)
    rng = np.random.default_rng(0)
    u = u_e + u_size * rng.standard_normal((500, 2))
    x, y = np.zeros(3), np.empty((500, n_y))
    for k in range(500):
        y[k] = output(0, x, u[k], {})
        x = update(0, x, u[k], {})
    return plant, u, y + 0.01 * y_size * rng.standard_normal(y.shape)


@pytest.fixture(scope="module")
def fitted():
    """Return (plant, model) by name: linear, h(y), h(x), with g; 2 inputs each."""
    small = {"n_h": 3, "random_state": 0, "max_iter": 30, "tol": 1e-3, "dt": DT}
    out = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for n_y in (2, 3):
            plant, u, y = mimo_plant(n_y)
            models = {
                "linear": LinearStateSpace(nx=3, dt=DT),
                "fl": fl_ssnn(nx=3, **small),
                "fl-state": fl_ssnn(nx=3, feedback="state", **small),
                "al": al_ssnn(nx=3, n_g=2, gamma=0.01, **small),
            }
            for name, model in models.items():
                out[name, n_y] = plant, model.fit(u, y)
    return out


NAMES = ["linear", "fl", "fl-state", "al"]


@pytest.fixture(params=[(m, n) for m in NAMES for n in (2, 3)], ids=str)
def pair(request, fitted):
    return fitted[request.param]


@pytest.fixture(scope="module")
def linear(fitted):
    return fitted["linear", 2][1]


# -- the program is the one that is stated ---------------------------------------------


def test_without_bounds_it_is_the_regulator_with_riccati_weight(pair):
    _, model = pair
    if "W_g" in model.params_:
        pytest.skip("g adds to the linear plan")
    mpc = LinearizingMPC(model, horizon=5, observer=Observer(model), tol=1e-9)
    x0 = np.array([0.3, -0.2, 0.4])
    y = model.plant_.late().output(x0)  # no innovation: x_hat = x0
    for _ in range(5):  # until Newton's method has found the target
        mpc.observer.reset(x0)
        u = mpc.step(model.y_offset_, y)
    law = model.linearizing_law()
    s = x0 if law.feedback == "state" else y
    x_s, rest = mpc._rest.X[0], mpc._model
    v_s = rest.u_offset + rest.u_scale * mpc._rest.V[0]
    v = v_s - mpc.K @ (x0 - x_s)
    scale = model._scaling.u_scale
    np.testing.assert_allclose(u / scale, law(v, s) / scale, rtol=0, atol=1e-6)


def test_the_first_move_of_a_linear_model_is_the_regulator_of_its_reference(linear):
    """However far the reference: its state of rest is known in closed form."""
    A, B, C, scale = linear.A_, linear.B_, linear.C_, linear._scaling
    dr = np.array([4.0, -3.0]) * scale.y_scale
    rest = np.block([[np.eye(3) - A, -B], [C, np.zeros((2, 2))]])
    x_s, v_s = np.split(np.linalg.solve(rest, np.r_[np.zeros(3), dr]), [3])
    assert max(np.abs(x_s).max(), np.abs(v_s / scale.u_scale).max()) > 3
    mpc = LinearizingMPC(linear)
    u = mpc.step(linear.y_offset_ + dr, linear.y_offset_)
    expected = linear.u_offset_ + v_s + mpc.K @ x_s
    np.testing.assert_allclose((u - expected) / scale.u_scale, 0.0, atol=1e-5)
    np.testing.assert_allclose(mpc.info_.target_error / scale.y_scale, 0.0, atol=1e-9)


@pytest.mark.parametrize(("scale_h", "reached"), [(0.0, True), (1.0, False)])
def test_networks_at_zero_leave_a_linear_model(fitted, scale_h, reached):
    """Its state of rest is found at once, however far the reference is."""
    model = pickle.loads(pickle.dumps(fitted["fl", 2][1]))
    model._made = None  # the plant as it was fitted
    structure = model._structure
    p = structure.split(model._theta)
    model._theta = structure.join({**p, "W_h": scale_h * p["W_h"]})
    mpc, size = LinearizingMPC(model), model._scaling.y_scale
    mpc.step(model.y_offset_ + np.array([4.0, -3.0]) * size, model.y_offset_)
    assert (np.abs(mpc.info_.target_error / size).max() < 1e-9) == reached


@pytest.mark.parametrize("unstable", [False, True])
@pytest.mark.parametrize("du_max", [None, [0.8, 0.005]])
def test_solution_is_that_of_an_independent_solver(linear, unstable, du_max):
    model = pickle.loads(pickle.dumps(linear))
    if unstable:
        model = _with_radius(model, 1.2)
    A, B, C, u_e = model.A_, model.B_, model.C_, model.u_offset_
    sy = model._scaling.y_scale
    half = 0.7 * model._scaling.u_scale
    y_max = np.array([model.y_offset_[0] + 0.3 * sy[0], np.inf])
    x_min = [-np.inf, -0.2, -np.inf]
    mpc = LinearizingMPC(
        model,
        horizon=8,
        u_min=u_e - half,
        u_max=u_e + half,
        du_max=du_max,
        y_max=y_max,
        x_min=x_min,
        slack_weight=(0.1, 0.5),
        observer=Observer(model),
        n_passes=1,
        tol=1e-9,
        max_iter=100_000,
    )
    x0 = np.array([0.6, -0.5, 0.4])
    mpc.reset(x0)
    mpc.step(model.y_offset_ + 0.5 * sy, model.plant_.late().output(x0))
    info = mpc.info_
    assert info.status == "solved"
    # the same program with the states as variables, in the units of the user
    x_s, v_s = mpc._rest.X[0], mpc._rest.U[0] - u_e
    X, V = cp.Variable((9, 3)), cp.Variable((8, 2))
    s = cp.Variable((8, 2), nonneg=True)
    root_Q = C / sy[:, None]
    root_R = np.sqrt(0.1) / model._scaling.u_scale
    root_P = np.linalg.cholesky(mpc.P).T
    constraints, cost = [X[0] == x0], 0
    for i in range(8):
        constraints += [
            X[i + 1] == A @ X[i] + B @ V[i],
            cp.abs(V[i]) <= half,
            (C @ X[i + 1])[0] / sy[0] <= 0.3 + s[i, 0],
            X[i + 1, 1] >= -0.2 - s[i, 1],
        ]
        if du_max is not None:
            constraints.append(cp.abs(V[i] - (V[i - 1] if i else 0)) <= du_max)
        weight = root_P if i == 7 else root_Q
        cost += cp.sum_squares(weight @ (X[i + 1] - x_s)) / 2
        cost += cp.sum_squares(cp.multiply(root_R, V[i] - v_s)) / 2
        cost += 0.1 * cp.sum(s[i]) + 0.5 * cp.sum_squares(s[i]) / 2
    cp.Problem(cp.Minimize(cost), constraints).solve(
        cp.CLARABEL, tol_gap_abs=1e-11, tol_gap_rel=1e-11, tol_feas=1e-11
    )
    scale = model._scaling.u_scale
    np.testing.assert_allclose(
        (info.u_plan - u_e) / scale, V.value / scale, rtol=0, atol=2e-5
    )
    y_plan = X.value[1:] @ C.T + model.y_offset_
    np.testing.assert_allclose(info.y_plan / sy, y_plan / sy, rtol=0, atol=1e-4)
    slack = np.array([info.slack_y[0] / sy[0], info.slack_x[1]])
    np.testing.assert_allclose(slack, s.value.max(axis=0), atol=1e-4)
    assert slack.max() > 0.01  # the soft bounds matter here
    assert info.saturated.any()


def _with_radius(model, radius):
    """Scale A of a linear model; what is made from the model follows."""
    A = model.A_ * radius / np.abs(np.linalg.eigvals(model.A_)).max()
    p = {**model._structure.constants, **model._structure.split(model._theta), "A": A}
    model._theta = model._structure.join(p)
    model.A_ = A
    model._made = None
    return model


def test_unstable_modes_that_v_does_not_reach_are_refused():
    plant = linear_plant(1.2 * np.eye(2), np.zeros((2, 2)))
    with pytest.raises(ValueError, match="controllable pair"):
        LinearizingMPC(plant)


# -- closed loops ----------------------------------------------------------------------


def test_no_offset_under_a_constant_disturbance(pair):
    plant, model = pair
    scale, n = model._scaling, 320
    tracked = np.diag([1.0, 1.0, 0.0][: len(model.C_)] / scale.y_scale**2)
    mpc = LinearizingMPC(model, Q_target=tracked)
    reference = np.tile(model.y_offset_, (n, 1))
    reference[:, 0] += 0.4 * scale.y_scale[0]
    reference[:, 1] -= 0.3 * scale.y_scale[1]
    push = np.tile(0.2 * scale.u_scale, (n, 1))
    loop = mpc.simulate(plant, reference, input_disturbance=push)
    assert loop.n_fallbacks == 0
    error = (loop.y - reference)[-1] / scale.y_scale
    np.testing.assert_allclose(error[:2], 0, atol=1e-6)


def test_an_input_disturbance_is_found(fitted):
    plant, model = fitted["fl", 2]
    scale, n = model._scaling, 300
    observer = DisturbanceObserver(model, disturbance="input")
    push = np.tile(0.2 * scale.u_scale, (n, 1))
    loop = LinearizingMPC(model, observer=observer).simulate(
        model, np.tile(model.y_offset_, (n, 1)), input_disturbance=push
    )
    found = loop.disturbance[-1] / scale.u_scale
    np.testing.assert_allclose(found, 0.2, atol=1e-4)
    np.testing.assert_allclose(
        (loop.y[-1] - model.y_offset_) / scale.y_scale, 0, atol=1e-5
    )
    loop = LinearizingMPC(model, observer=Observer(model)).simulate(
        plant, np.tile(model.y_offset_, (n, 1)), input_disturbance=push
    )  # and without disturbance there is an offset
    assert np.abs((loop.y[-1] - model.y_offset_) / scale.y_scale).max() > 0.02


@pytest.mark.parametrize("feedback", ["output", "state"])
@pytest.mark.parametrize("make", [make_pendulum, make_duffing])
def test_limits_hold_on_the_true_plant(make, feedback):
    record = make(800, noise=0.01, random_state=0)
    options = {"dt": record.dt, "max_iter": 60, "random_state": 0}
    model = fl_ssnn(nx=2, n_h=6, feedback=feedback, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(record.u, record.y)
    size, n = record.y.std(), 160
    limit = 0.5 * np.abs(record.u).max()
    rate = 0.3 * limit
    mpc = LinearizingMPC(model, u_min=-limit, u_max=limit, du_max=rate)
    levels = np.random.default_rng(0).uniform(-2, 2, n // 20)
    reference = size * np.repeat(levels, 20)
    loop = mpc.simulate(record.plant, reference)
    assert np.abs(loop.u).max() <= limit
    assert np.abs(np.diff(loop.u, axis=0)).max() <= rate * (1 + 1e-12)
    assert loop.n_fallbacks == 0
    assert loop.saturated.mean() > 0.1  # the limits matter here
    assert np.abs(loop.cut).max() < 1e-3 * limit  # and the program knows them


def test_soft_bounds_hold_where_they_can(pair):
    _, model = pair
    scale = model._scaling.y_scale
    y_max = model.y_offset_ + 0.3 * scale
    reference = np.tile(model.y_offset_ + 0.3 * scale, (80, 1))
    reference[:, 0] += 0.5 * scale[0]  # beyond the bound
    bounded = LinearizingMPC(model, y_max=y_max)
    loop = bounded.simulate(model, reference)
    assert ((loop.y - y_max) / scale).max() < 1e-3
    assert (loop.slack_y / scale).max() < 1e-3
    assert bounded.info_.target_error[0] / scale[0] < -0.45
    free = LinearizingMPC(model).simulate(model, reference)
    assert ((free.y - y_max) / scale).max() > 0.1


def test_bounds_that_cannot_hold_are_reported(linear):
    scale, x0 = linear._scaling.y_scale, np.array([2.0, 2.0, 2.0])
    y = linear.plant_.late().output(x0)
    half = 0.1 * linear._scaling.u_scale
    mpc = LinearizingMPC(
        linear,
        u_min=linear.u_offset_ - half,
        u_max=linear.u_offset_ + half,
        y_min=linear.y_offset_ - 0.1 * scale,
        y_max=linear.y_offset_ + 0.1 * scale,
    )
    mpc.reset(x0)
    mpc.step(linear.y_offset_, y)
    assert mpc.info_.status == "solved"
    assert (mpc.info_.slack_y / scale).max() > 0.1


def test_preview_moves_before_the_step(linear):
    reference = np.tile(linear.y_offset_, (60, 1))
    reference[30:, 0] += linear._scaling.y_scale[0]
    blind = linear.mpc().simulate(linear, reference)
    seeing = linear.mpc().simulate(linear, reference, preview=True)
    errors = [np.square((r.y - reference)[:, 0]).sum() for r in (blind, seeing)]
    assert errors[1] < 0.7 * errors[0]
    np.testing.assert_allclose(blind.u[20], linear.u_offset_, atol=1e-6)
    np.testing.assert_allclose(seeing.y[-1], reference[-1], rtol=1e-5)


# -- failures are reported -------------------------------------------------------------


def test_a_solver_that_fails_leaves_the_shifted_plan(fitted):
    _, model = fitted["fl", 2]
    scale = model._scaling
    half = 0.5 * scale.u_scale
    options = {"u_min": model.u_offset_ - half, "u_max": model.u_offset_ + half}
    mpc = LinearizingMPC(model, **options)
    reference = model.y_offset_ + scale.y_scale
    mpc.step(reference, model.y_offset_)
    plan = mpc.info_.u_plan
    qp = mpc._planner.program.qp
    qp.settings["max_iter"] = 1
    qp.reset()
    u = mpc.step(reference, model.y_offset_ + 0.1 * scale.y_scale)
    assert mpc.info_.fallback
    assert "maximum iterations" in mpc.info_.status
    np.testing.assert_array_equal(u, plan[1])
    qp.settings["max_iter"] = 4000  # and it recovers
    mpc.step(reference, model.y_offset_ + 0.1 * scale.y_scale)
    assert not mpc.info_.fallback


def test_a_plan_that_is_kept_beyond_its_bounds_says_so(linear):
    scale = linear._scaling
    y_max = linear.y_offset_ + 0.1 * scale.y_scale
    mpc = LinearizingMPC(linear, y_max=y_max, max_iter=1)
    far = np.array([2.0, 2.0, 2.0])
    mpc.reset(far)
    mpc.step(linear.y_offset_, linear.plant_.late().output(far))
    info = mpc.info_
    beyond = np.maximum((info.y_plan - y_max).max(axis=0), 0.0)
    assert info.fallback and (beyond / scale.y_scale).max() > 0.1
    np.testing.assert_allclose(info.slack_y, beyond, rtol=1e-9)


def test_a_plan_that_is_kept_begins_with_what_is_sent(fitted):
    """Someone else has moved the plant further than a step of the plan may be."""
    _, model = fitted["fl", 2]
    scale = model._scaling.u_scale
    mpc = LinearizingMPC(model, du_max=0.3 * scale, y_max=model.y_offset_, max_iter=1)
    mpc.step(model.y_offset_, model.y_offset_)
    moved = model.u_offset_ + 2 * scale
    u = mpc.step(model.y_offset_, model.y_offset_, u_applied=moved)
    info = mpc.info_
    assert info.fallback and np.all(np.abs(u - moved) <= 0.3 * scale * (1 + 1e-9))
    np.testing.assert_array_equal(info.u_plan[0], u)
    moves = np.abs(np.diff(info.u_plan, axis=0))
    assert np.all(moves <= 0.3 * scale * (1 + 1e-9))
    y = _by_whole_model(mpc)
    np.testing.assert_allclose(info.y_plan, y)
    beyond = np.maximum((y - model.y_offset_).max(axis=0), 0.0)
    np.testing.assert_allclose(info.slack_y, beyond, atol=1e-9)
    assert np.abs(info.cut).max() > 0.3 * scale.min()


def _by_whole_model(mpc):
    """Return the outputs of the model, disturbance included, under the plan."""
    info, disturbed = mpc.info_, mpc.observer.plant
    z, y = np.append(info.x_hat, info.disturbance), np.empty_like(info.y_plan)
    for k, u in enumerate(info.u_plan):
        z = disturbed.step(z, u)
        y[k] = disturbed.output(z)
    return y


@pytest.mark.parametrize(("name", "differs"), [("fl", False), ("al", True)])
def test_a_plan_of_the_program_is_that_of_the_model_without_a_residual(
    fitted, name, differs
):
    _, model = fitted[name, 2]
    scale = model._scaling.y_scale
    mpc, apart = LinearizingMPC(model), []
    for _ in range(5):
        mpc.step(model.y_offset_ + 0.8 * scale, model.y_offset_)
        apart.append(np.abs((mpc.info_.y_plan - _by_whole_model(mpc)) / scale).max())
    assert (apart[0] > 1e-3) == differs
    assert apart[4] < (1e-4 if differs else 1e-9)


def test_a_diverging_model_is_reported(linear):
    ungated = DisturbanceObserver(linear)
    mpc = LinearizingMPC(linear, u_min=-1e3, u_max=1e3, observer=ungated)
    u = mpc.step(linear.y_offset_, np.full(2, 1e300))
    assert mpc.info_.fallback
    assert np.isfinite(u).all() and not mpc.info_.slack_y.any()  # no bound


def test_reset_and_pickle_repeat_the_same_inputs(fitted):
    plant, model = fitted["al", 3]
    reference = np.tile(model.y_offset_ + 0.2 * model._scaling.y_scale, (20, 1))
    mpc = model.mpc(u_min=model.u_offset_ - model._scaling.u_scale)
    first = mpc.simulate(plant, reference)
    np.testing.assert_array_equal(mpc.simulate(plant, reference).u, first.u)
    again = pickle.loads(pickle.dumps(mpc)).simulate(plant, reference)
    np.testing.assert_allclose(again.u, first.u, rtol=1e-12)
    assert "fallbacks   0" in repr(first)


@pytest.mark.parametrize(
    "options, match",
    [
        ({"horizon": 0}, "horizon"),
        ({"n_passes": 1.5}, "n_passes"),
        ({"tol": 0}, "tol"),
        ({"max_iter": 0}, "max_iter"),
        ({"Q": np.eye(2)}, "`Q`"),
        ({"R": -np.eye(2)}, "`R`"),
        ({"Q_target": np.eye(3)}, "`Q_target`"),
        ({"u_min": 1, "u_max": 0}, "`u_min` must be below"),
        ({"y_min": 1, "y_max": 1}, "`y_min` must be below"),
        ({"x_max": [1, 2]}, "`x_max`"),
        ({"du_max": 0}, "`du_max`"),
        ({"slack_weight": (1, 0)}, "`slack_weight`"),
    ],
)
def test_wrong_options(linear, options, match):
    with pytest.raises(ValueError, match=match):
        LinearizingMPC(linear, **options)


def test_wrong_signals(linear, fitted):
    mpc, rest = linear.mpc(), linear.y_offset_
    for reference, y, match in (
        ([1.0], rest, "`reference` must have shape"),
        (np.zeros((3, 2)), rest, "`reference` must have shape"),
        (rest, [1.0], "`y` must have shape"),
        (rest, None, "got None"),
    ):
        with pytest.raises(ValueError, match=match):
            mpc.step(reference, y)
    with pytest.raises(ValueError, match=r"`reference`.*at least one"):
        mpc.simulate(linear, np.zeros((0, 2)))
    signal = np.tile(rest, (5, 1))
    for plant, match in (
        (control.ss([[0.5]], [[1, 1]], [[1], [1]], 0, 2 * DT), "sampling time"),
        (control.ss([[-1]], [[1, 1]], [[1], [1]], 0), "continuous-time"),
        (control.ss([[0.5]], [[1]], [[1]], 0, DT), "inputs and outputs"),
    ):
        with pytest.raises(ValueError, match=match):
            mpc.simulate(plant, signal)
    with pytest.raises(TypeError, match="plant"):
        mpc.simulate(lambda u: u, signal)
    with pytest.raises(ValueError, match="input_disturbance"):
        mpc.simulate(linear, signal, input_disturbance=np.zeros((4, 2)))
    with pytest.raises(TypeError, match="observer"):
        LinearizingMPC(linear, observer=linear)
    with pytest.raises(ValueError, match="same model"):
        LinearizingMPC(linear, observer=Observer(fitted["fl", 2][1]))
    with pytest.raises(NotFittedError):
        LinearizingMPC(LinearStateSpace(nx=2))


# -- the disturbance -------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["output", "input"])
def test_disturbed_dynamics_are_the_model_with_d_added(pair, kind, rng):
    _, model = pair
    plain = model.plant_.late()
    disturbed = plain.with_disturbance(kind)
    scale = model._scaling.y_scale if kind == "output" else model._scaling.u_scale
    x, u = rng.standard_normal((4, 3)), model.u_offset_ + 0.1 * rng.standard_normal(2)
    d = scale * rng.standard_normal((4, len(scale)))
    X, U = np.hstack([x, d]), np.tile(u, (4, 1))
    pushed = U + d if kind == "input" else U
    expected = np.hstack([plain.step(x, pushed), d])
    np.testing.assert_allclose(disturbed.step(X, U), expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        disturbed.step(X[1], u), expected[1], rtol=1e-9, atol=1e-12
    )
    y = plain.output(x) + (d if kind == "output" else 0)
    np.testing.assert_allclose(disturbed.output(X), y, rtol=1e-9)
    rows = disturbed.jacobian(X, U)
    one = disturbed.jacobian(X[2], u)
    for many, single in zip(rows, one, strict=True):
        np.testing.assert_allclose(many[2], single, rtol=1e-9, atol=1e-12)


def test_disturbances_that_the_outputs_do_not_show_are_refused(linear):
    with pytest.raises(ValueError, match="'output' or 'input'"):
        DisturbanceObserver(linear, disturbance="state")
    with pytest.raises(ValueError, match="Q_d"):
        DisturbanceObserver(linear, Q_d=np.zeros((2, 2)))
    with pytest.raises(ValueError, match="integrates"):
        model = linear_plant(np.diag([1.0, 0.5]), np.eye(2))
        DisturbanceObserver(model, disturbance="output")


def test_what_integrates_has_disturbances_of_the_input():
    """Under a constant load it comes to its reference, by the default observer."""
    model, x = linear_plant(np.diag([1.0, 0.5]), np.eye(2)), np.zeros(2)
    mpc = LinearizingMPC(model, 5)
    assert mpc.observer.disturbance == "input"
    for _ in range(60):
        u = mpc.step([0.4, 0.3], y=x)
        x = np.array([1.0, 0.5]) * x + u + np.array([0.2, -0.1])
    np.testing.assert_allclose(x, [0.4, 0.3], atol=1e-4)


# -- states of rest of one linearization -----------------------------------------------


@pytest.fixture
def improve():
    """Return one step of the target problem of x1 without bounds, two inputs."""
    target = Target(
        np.array([[1.0, 0.0]]), np.eye(1), np.zeros((0, 2)), (100.0, 100.0), {}, STEP
    )
    free = np.full(2, -np.inf), np.full(2, np.inf)
    none = np.zeros(0), np.zeros(0)
    return lambda last, model, goal: target.improve(last, model, goal, free, none)


# at rest x1 = 2 (u1 + u2) and x2 = 10 u2
AT_REST = (
    np.diag([0.5, 0.9]),
    np.array([[1.0, 1.0], [0.0, 1.0]]),
    np.zeros(2),
)


def test_inputs_share_what_the_reference_leaves_free(improve):
    x, u = np.zeros(2), np.zeros(2)
    for _ in range(5):
        x, u, status = improve((x, u), AT_REST, np.ones(1))
        assert status == "closed form"
    # the smallest |u| of all that reach x1 = 1, however large it makes x2
    np.testing.assert_allclose(u, [0.25, 0.25], atol=1e-9)
    np.testing.assert_allclose(x, [1.0, 2.5], atol=1e-9)


def test_steps_to_rest_are_limited(improve):
    x, u, _ = improve((np.zeros(2), np.zeros(2)), AT_REST, np.ones(1))
    # one standard deviation of x2, on the way to (1, 2.5)
    np.testing.assert_allclose(x, [0.4, 1.0], atol=1e-9)
    np.testing.assert_allclose(u, [0.1, 0.1], atol=1e-9)


@pytest.mark.parametrize("broken", range(4))
def test_states_of_rest_stay_where_the_model_diverges(improve, broken):
    x, u = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    parts = [np.array(part) for part in (*AT_REST, np.ones(1))]
    parts[broken].flat[0] = np.nan
    *last, status = improve((x, u), tuple(parts[:3]), parts[3])
    assert status == "data not finite"
    np.testing.assert_array_equal(last, [x, u])


def test_inputs_that_are_not_finite_hold_the_last_one():
    limits = ActuatorLimits(-np.ones(2), np.ones(2), np.full(2, 0.5), np.ones(2))
    last = np.array([0.2, -0.3])
    np.testing.assert_array_equal(
        limits.after(last, np.array([np.nan, 1.0])), [0.2, 0.2]
    )
    np.testing.assert_array_equal(
        limits.after(last, np.array([-1.0, -np.inf])), [-0.3, -0.3]
    )

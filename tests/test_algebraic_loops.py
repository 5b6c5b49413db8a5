"""Loops around plants with feedthrough, against their equations written out."""

import warnings

import control
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import fsolve
from sklearn.exceptions import ConvergenceWarning
from test_model_class import DT, equations, make_record

from alssnn import LinearStateSpace
from alssnn.feedback import closed_loop, lqi, lqr, weigh_outputs
from alssnn.feedback.algebraic import AlgebraicLoop
from alssnn.mpc import LinearizingMPC
from models import al_ssnn, fl_ssnn, lively

SMALL = {"nx": 2, "max_iter": 20, "tol": 1e-2, "random_state": 0, "dt": DT}
# another plant with 2 inputs and outputs, in the units of the record
S_U, S_Y = np.diag([3.0, 0.02]), np.diag([100.0, 0.1])
A_P = np.array([[0.75, 0.1], [-0.25, 0.6]])
B_P = np.array([[0.4, 0.0], [0.1, 0.5]]) @ np.linalg.inv(S_U)
C_P = S_Y @ np.array([[1.0, 0.1], [0.0, 1.0]])
D_P = S_Y @ np.array([[0.3, 0.1], [-0.1, 0.2]]) @ np.linalg.inv(S_U)


@pytest.fixture(scope="module")
def fitted():
    models = {
        "linear, D": LinearStateSpace(2, dt=DT, feedthrough=True),
        "linear": LinearStateSpace(2, dt=DT),
        "fl": fl_ssnn(n_h=3, **SMALL),
        "al, D, k": al_ssnn(
            n_h=2, n_g=2, n_k=2, feedthrough=True, feedback="state", **SMALL
        ),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        models = {name: model.fit(*make_record()) for name, model in models.items()}
    for name in ("fl", "al, D, k"):
        lively(models[name], size=0.3)
    return models


def run(loop, r, x0=None):
    """Return y, u and v of a loop, one row per sample."""
    x0 = np.zeros(loop.nstates) if x0 is None else x0
    out = control.input_output_response(loop, DT * np.arange(len(r)), r.T, x0).outputs
    return np.split(out.T, [2, 4], axis=1)


def references(rest, size, n=60):
    rng = np.random.default_rng(0)
    return rest + np.repeat(rng.uniform(-1, 1, (n // 10, 2)), 10, axis=0) * size


def scaled(model, y, u):
    """Return signals in standard deviations, for one tolerance."""
    return np.hstack([y / model._scaling.y_scale, u / model._scaling.u_scale])


def test_true_state_of_a_model_with_D_and_k(fitted):
    model = fitted["al, D, k"]
    K = lqr(model, np.eye(2), np.linalg.inv(S_U @ S_U))
    r = references(model.u_offset_, model._scaling.u_scale)
    law, x = model.linearizing_law(), np.array([0.2, -0.1])
    y, u, v = run(closed_loop(model, model, K), r, x)
    for k in range(len(r)):
        expected = r[k] - K @ x
        np.testing.assert_allclose(v[k], expected, rtol=1e-9, atol=1e-9)
        u_k = law(expected, x)
        x, y_k = equations(model, x, u_k - model.u_offset_)[:2]
        np.testing.assert_allclose(u[k], u_k, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(y[k], y_k + model.y_offset_, rtol=1e-9, atol=1e-9)


def test_integrators_and_limits_around_a_model_with_D(fitted):
    model = fitted["linear, D"]
    K = lqi(model, np.eye(4) * np.r_[1, 1, 1e-4, 1], np.linalg.inv(S_U @ S_U))
    K_x, K_z = np.hsplit(K, 2)
    half = 0.3 * model._scaling.u_scale
    law = model.linearizing_law(model.u_offset_ - half, model.u_offset_ + half)
    r = references(model.y_offset_, model._scaling.y_scale)
    y, u, _ = run(closed_loop(model, model, K, law=law), r)
    x, z, cuts = np.zeros(2), np.zeros(2), 0
    for k in range(len(r)):
        wanted = -K_x @ x - K_z @ z
        du = np.clip(wanted, -half, half)
        dy = model.C_ @ x + model.D_ @ du
        np.testing.assert_allclose(u[k], du + model.u_offset_, rtol=1e-8)
        np.testing.assert_allclose(y[k], dy + model.y_offset_, rtol=1e-8)
        z = z + dy + model.y_offset_ - r[k] + np.linalg.pinv(K_z) @ (wanted - du)
        x = model.A_ @ x + model.B_ @ du
        cuts += np.any(wanted != du)
    assert 0 < cuts < len(r)  # the limits matter, not always


@pytest.mark.parametrize("name", ["linear", "linear, D"])
@pytest.mark.parametrize("kind", ["ss", "nlsys"])
def test_an_observer_closes_an_algebraic_loop(fitted, name, kind):
    model = fitted[name]
    A, B, C, D = model.A_, model.B_, model.C_, model.D_
    K = lqr(model, np.eye(2), np.linalg.inv(S_U @ S_U))
    observer = model.observer()
    M, r = observer.gain, references(model.u_offset_, model._scaling.u_scale)
    plant = control.ss(A_P, B_P, C_P, D_P, DT)
    if kind == "nlsys":
        plant = control.nlsys(
            lambda t, x, u, params: A_P @ x + B_P @ u,
            lambda t, x, u, params: C_P @ x + D_P @ u,
            inputs=2,
            outputs=2,
            states=2,
            dt=DT,
        )
    y, u, v = run(closed_loop(plant, model, K, observer=observer), r)
    x, x_o, u_e, y_e = np.zeros(2), np.zeros(2), model.u_offset_, model.y_offset_
    loop = np.eye(2) + K @ M @ (D_P - D)  # what u - F(u) does with u
    assert np.abs(loop - np.eye(2)).max() > 0.01
    for k in range(len(r)):
        # x_hat = x_o + M (C_P x + D_P u - y_e - C x_o - D (u - u_e)), u = r - K x_hat
        known = x_o + M @ (C_P @ x - y_e - C @ x_o + D @ u_e)
        u_k = np.linalg.solve(loop, r[k] - K @ known)
        y_k = C_P @ x + D_P @ u_k
        np.testing.assert_allclose(
            scaled(model, y[k], u[k]), scaled(model, y_k, u_k), atol=1e-8
        )
        x_hat = x_o + M @ (y_k - y_e - C @ x_o - D @ (u_k - u_e))
        np.testing.assert_array_equal(u[k], v[k])
        x, x_o = A_P @ x + B_P @ u_k, A @ x_hat + B @ (u_k - u_e)


def test_a_law_of_y_is_solved_for(fitted):
    model = fitted["fl"]
    law, u_e, y_e = model.linearizing_law(), model.u_offset_, model.y_offset_
    plant = control.nlsys(
        lambda t, x, u, params: A_P @ x + B_P @ (u - u_e),
        lambda t, x, u, params: C_P @ x + D_P @ (u - u_e) + y_e,
        inputs=2,
        outputs=2,
        states=2,
        dt=DT,
    )
    static = control.ss([], [], [], np.zeros((2, 4)), DT)  # v = u_offset
    x0 = np.array([2.0, -1.0])
    loop = closed_loop(plant, model, controller=static)
    y, u, _ = run(loop, np.tile(y_e, (20, 1)), x0)
    x = x0
    for k in range(20):
        known = C_P @ x + y_e
        u_k = u_e + S_U @ fsolve(
            lambda s, y=known: s - (law(u_e, y + D_P @ S_U @ s) - u_e) / np.diag(S_U),
            np.zeros(2),
            xtol=1e-12,
        )
        y_k = known + D_P @ (u_k - u_e)
        np.testing.assert_allclose(
            scaled(model, y[k], u[k]), scaled(model, y_k, u_k), atol=1e-7
        )
        x = A_P @ x + B_P @ (u_k - u_e)
    assert np.ptp(u / np.diag(S_U), axis=0).min() > 0.01  # the law does something


def test_limits_in_an_algebraic_loop(fitted):
    model = fitted["linear"]
    u_e, y_e, half = model.u_offset_, model.y_offset_, np.diag(S_U)
    D = S_Y @ np.linalg.inv(S_U)  # one scaled unit in, one out
    gain = 3 * np.linalg.inv(D)  # a full step of Newton's method jumps across
    plant = control.ss([], [], [], D, DT)
    loop = closed_loop(
        plant,
        model,
        controller=control.ss([], [], [], gain, DT),
        law=model.linearizing_law(u_e - half, u_e + half),
    )
    r = references(y_e + 0.5 * (D @ u_e - y_e), 3 * np.diag(S_Y))
    r[:20] += D @ u_e - y_e
    _, u, _ = run(loop, r)
    # decoupled: u = u_e + 3 (D^-1 r - u), between its limits
    free = (u_e + 3 * r @ np.linalg.inv(D)) / 4
    expected = np.clip(free, u_e - half, u_e + half)
    np.testing.assert_allclose(u / half, expected / half, atol=1e-8)
    at_limit = np.abs(u - u_e) >= half * (1 - 1e-9)
    assert at_limit.any() and not at_limit.all()


def test_large_offsets_leave_a_solution(fitted):
    model = fitted["linear"]
    u_e, far = model.u_offset_, 1e6 * np.diag(S_Y)  # F is a staircase
    D = S_Y @ np.linalg.inv(S_U)
    back = 30 * np.linalg.inv(D)
    plant = control.nlsys(
        None,
        lambda t, x, u, params: (D @ (u - u_e) + far) - far + model.y_offset_,
        inputs=2,
        outputs=2,
        dt=DT,
    )
    loop = closed_loop(plant, model, controller=control.ss([], [], [], back, DT))
    r = references(model.y_offset_, model._scaling.y_scale, 20)
    _, u, _ = run(loop, r)
    # u - u_e = 30 (D^-1 (r - y_e) - (u - u_e)), up to the rounding of far
    expected = u_e + (r - model.y_offset_) @ np.linalg.inv(D) * 30 / 31
    np.testing.assert_allclose(u / np.diag(S_U), expected / np.diag(S_U), atol=1e-6)


def test_loops_that_are_not_well_posed_are_refused(fitted):
    model, plant = fitted["linear"], control.ss(A_P, B_P, C_P, D_P, DT)
    gain = -np.linalg.inv(D_P)  # I + gain D = 0
    with pytest.raises(ValueError, match=r"well-posed.*add a delay of one sample"):
        closed_loop(plant, model, controller=control.ss([], [], [], gain, DT))
    # a delay in the controller makes it well-posed
    closed_loop(
        plant, model, controller=control.ss(np.zeros((2, 2)), gain, np.eye(2), 0, DT)
    )


def test_a_law_without_solution_is_reported(fitted):
    model = fitted["linear"]

    def root(t, x, u, params):  # y = ... has no u = 1 + y - u_e, y = u + 1 + u^2
        du = (u - model.u_offset_) / np.diag(S_U)
        return np.diag(S_Y) * (du + t + du**2) + model.y_offset_

    plant = control.nlsys(None, root, inputs=2, outputs=2, dt=DT)
    gain = -S_U @ np.linalg.inv(S_Y)  # v - u_e = y - r
    with pytest.raises(ValueError, match=r"well-posed"):
        loop = closed_loop(plant, model, controller=control.ss([], [], [], gain, DT))
        run(loop, np.tile(model.y_offset_, (5, 1)))


def test_predictive_control_measures_before_the_input_moves(fitted):
    model = fitted["linear"]
    scale, u_e = model._scaling, model.u_offset_
    mpc, n = LinearizingMPC(model), 1500  # from far away: the plant has u_e = 0
    rng = np.random.default_rng(0)
    x0 = rng.standard_normal(2)
    r = np.tile(model.y_offset_ + 0.3 * scale.y_scale, (n, 1))
    push = np.tile(0.1 * scale.u_scale, (n, 1))
    plant = control.ss(A_P, B_P, C_P, D_P, DT)
    loop = mpc.simulate(plant, r, x0=x0, input_disturbance=push)
    x, held = x0, u_e
    for k in range(n):
        np.testing.assert_allclose(loop.y[k], C_P @ x + D_P @ held, rtol=1e-9)
        held = loop.u[k] + push[k]
        x = A_P @ x + B_P @ held
    np.testing.assert_allclose((loop.y[-1] - r[-1]) / scale.y_scale, 0, atol=1e-6)


# -- weights ---------------------------------------------------------------------------


def test_weights_of_outputs_have_cross_terms(fitted):
    model = fitted["linear, D"]
    A, B, C, D = model.A_, model.B_, model.C_, model.D_
    Q_y, R = np.linalg.inv(S_Y @ S_Y), 0.1 * np.linalg.inv(S_U @ S_U)
    weights = weigh_outputs(model, Q_y, R)
    x, v = np.random.default_rng(0).standard_normal((2, 2)) * [[1.0, 1], [3, 0.02]]
    y = C @ x + D @ v
    cost = x @ weights[0] @ x + v @ weights[1] @ v + 2 * x @ weights[2] @ v
    np.testing.assert_allclose(cost, y @ Q_y @ y + v @ R @ v, rtol=1e-12)
    K = lqr(model, *weights)
    P = solve_discrete_are(A, B, weights[0], weights[1], s=weights[2])
    expected = np.linalg.solve(weights[1] + B.T @ P @ B, B.T @ P @ A + weights[2].T)
    np.testing.assert_allclose(S_U @ K / 3, S_U @ expected / 3, rtol=1e-7, atol=1e-12)

    def measured(K):  # the sum of y'Qy + v'Rv from every unit state, by simulation
        total = 0.0
        for x in np.eye(2):
            for _ in range(400):
                v = -K @ x
                y = C @ x + D @ v
                total += y @ Q_y @ y + v @ R @ v
                x = A @ x + B @ v
        return total

    least = measured(K)
    assert measured(lqr(model, C.T @ Q_y @ C, R)) > 1.001 * least  # what D costs
    for direction in np.random.default_rng(1).standard_normal((5, 2, 2)):
        for sign in (-1e-3, 1e-3):
            assert measured(K * (1 + sign * direction)) > least


def test_cross_weights_of_integrators(fitted):
    model = fitted["linear, D"]
    Q, R, N = weigh_outputs(model, np.linalg.inv(S_Y @ S_Y), np.linalg.inv(S_U @ S_U))
    big = np.zeros((4, 4))
    big[:2, :2], big[2:, 2:] = Q, 0.01 * np.linalg.inv(S_Y @ S_Y)
    with_N = lqi(model, big, R, np.vstack([N, np.zeros((2, 2))]))
    A = np.block([[model.A_, np.zeros((2, 2))], [model.C_, np.eye(2)]])
    B = np.vstack([model.B_, model.D_])
    P = solve_discrete_are(A, B, big, R, s=np.vstack([N, np.zeros((2, 2))]))
    expected = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A + np.hstack([N.T, 0 * N]))
    np.testing.assert_allclose(with_N, expected, rtol=1e-6, atol=1e-10)
    for wrong, match in (
        (np.eye(3), "`N` must be finite and have shape"),
        (1e3 * np.ones((2, 2)), "positive semidefinite"),
    ):
        with pytest.raises(ValueError, match=match):
            lqr(model, Q, R, wrong)


@pytest.mark.parametrize(("size", "slope"), [(3, 3), (5, 5), (20, 50)])
def test_bends_of_the_loop_take_shorter_steps(size, slope):
    # u + size atan(slope (u - 1)) = 1: full steps of Newton's method run away from 0
    def control_law(t, x, signals, params):
        r, y = signals
        return [r - size * np.arctan(slope * (y - 1))]

    def through(t, x, signals, params):
        return signals

    blocks = [
        control.nlsys(None, function, inputs=inputs, outputs=[output], dt=DT)
        for function, inputs, output in (
            (through, ["u"], "y"),
            (control_law, ["r", "y"], "v"),
            (through, ["v"], "u"),
        )
    ]
    loop = AlgebraicLoop(blocks, ["r"], ["u"], ["y", "u"], np.zeros(1), np.ones(1))
    shown = loop.output(0.0, np.zeros(0), np.ones(1), {})
    np.testing.assert_allclose(shown, [1.0, 1.0], atol=1e-10)

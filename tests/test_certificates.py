import subprocess
import sys
import warnings
from dataclasses import replace
from itertools import product

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.exceptions import ConvergenceWarning

from alssnn import Activation, LinearStateSpace
from alssnn.activations import ACTIVATIONS
from alssnn.certificates import (
    certify_gain,
    certify_iss,
    data_bound,
    gain_certificate,
    global_bound,
    hinf_norm,
    iss_certificate,
    iss_margin,
    linearized_loop,
    state_feedback,
)
from alssnn.certificates._disturbance import _largest
from alssnn.certificates._state_feedback import linear_form
from alssnn.lure import Lure
from alssnn.models import state_space
from alssnn.simulation import channels, simulate
from alssnn.stability import contraction
from helpers import (
    as_records,
    plant_of,
    plant_of_structure,
    random_theta,
    simulate_linear,
    stable,
)
from models import al_ssnn

METHODS = ["lyapunov", "sdp"]


def linear_lure(A, B, C):
    zero = np.zeros((len(C), B.shape[1]))
    Theta = np.hstack([np.block([[A, B], [C, zero]]), np.zeros((len(A) + len(C), 1))])
    return Lure(Theta, len(A), B.shape[1], 0)


@pytest.fixture(scope="module")
def fitted():
    rng = np.random.default_rng(3)
    u = rng.standard_normal((300, 1))
    y = simulate_linear(
        np.array([[0.7, 0.2], [-0.2, 0.6]]), np.ones((2, 1)), np.eye(2)[:1], u
    )
    y = y + 0.1 * np.tanh(y)
    model = al_ssnn(
        nx=2,
        n_h=3,
        n_g=3,
        gamma=0.1,
        stability="contractive",
        max_iter=10,
        random_state=0,
    )
    with warnings.catch_warnings():
        # any model will do
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(u, y), u, y


# -- input-to-state stability ----------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("a", [0.3, -0.8, 0.97])
def test_scalar_closed_form(a, method):
    # psi / phi = (1 - phi) / (phi (1 - phi - a^2)) is least at phi = 1 - |a|
    certificate = iss_certificate([[a]], eps=0.1, method=method)
    assert certificate.holds
    assert certificate.phi == pytest.approx(1 - abs(a), rel=0.03)
    ratio = certificate.psi / certificate.phi
    assert ratio == pytest.approx(1 / (1 - abs(a)) ** 2, rel=2e-3)
    # which is the truth: omega = eps for ever
    assert certificate.output_bound == pytest.approx(0.1 / (1 - abs(a)), rel=1e-3)


def test_given_phi_is_optimal():
    phi, a = 0.2, 0.5
    certificate = iss_certificate([[a]], phi=phi)
    assert certificate.n_solves == 1
    expected = (1 - phi) / (1 - phi - a**2)
    assert certificate.psi / certificate.P[0, 0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("objective", ["peak", "volume", "feasible"])
def test_methods_agree(rng, objective):
    A, C = stable(rng, 3, 0.8), rng.standard_normal((2, 3))
    a, b = (iss_certificate(A, C, objective=objective, method=m) for m in METHODS)
    assert a.holds and b.holds
    assert a.output_bound == pytest.approx(b.output_bound, rel=1e-3)
    for c in (a, b):
        assert c.verify() == c.margin > 0
        assert c.n_solves <= 20
        if objective == "peak":
            assert np.linalg.eigvalsh(c.P - C.T @ C)[0] > -1e-9
        else:
            assert np.trace(c.P) == pytest.approx(3)


@pytest.mark.parametrize("method", METHODS)
def test_six_states_take_few_solves(rng, method):
    A, C = stable(rng, 6, 0.9), rng.standard_normal((1, 6))
    certificate = iss_certificate(A, C, method=method)
    assert certificate.holds
    assert certificate.n_solves <= 20


def test_objectives_differ_as_they_say(rng):
    A, C = stable(rng, 4, 0.9), rng.standard_normal((1, 4))
    by = {o: iss_certificate(A, C, objective=o) for o in ("peak", "volume", "feasible")}
    volume = {o: 4 * np.log(c.level) - np.linalg.slogdet(c.P)[1] for o, c in by.items()}
    assert by["peak"].output_bound == min(c.output_bound for c in by.values())
    assert volume["volume"] == min(volume.values())


@settings(max_examples=30, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**31), n=st.integers(1, 5), radius=st.floats(0.05, 0.97))
def test_no_trajectory_leaves_the_set(seed, n, radius):
    rng = np.random.default_rng(seed)
    A, C, eps = stable(rng, n, radius), rng.standard_normal((2, n)), rng.uniform(0.1, 3)
    c = iss_certificate(A, C, eps=eps)
    assert c.holds
    # starts on the boundary, and the disturbance that pushes outwards
    T = np.linalg.cholesky(c.P).T
    x = rng.standard_normal((20, n))
    x = np.sqrt(c.level) * np.linalg.solve(
        T, (x / np.linalg.norm(x, axis=1)[:, None]).T
    )
    x, zeta = 0.999999 * x.T, np.zeros((20, n))
    assert c.contains(x).all()
    for _ in range(60):
        omega = (x if rng.random() < 0.7 else rng.standard_normal(x.shape)) @ A.T @ c.P
        omega *= eps / np.maximum(np.linalg.norm(omega, axis=1)[:, None], 1e-300)
        x, zeta = x @ A.T + omega, zeta @ A.T + omega
        assert c.contains(x).all()
        e = zeta @ C.T
        assert np.linalg.norm(e, axis=1).max() <= c.output_bound
        assert (np.abs(e) <= c.output_bounds).all()


def test_bound_is_at_least_the_peak_gain(rng):
    A, C = stable(rng, 4, 0.8), rng.standard_normal((1, 4))
    impulse = sum(np.linalg.norm(C @ np.linalg.matrix_power(A, k)) for k in range(200))
    assert impulse <= iss_certificate(A, C).output_bound <= 3 * impulse


def test_contractive_model_has_the_identity(rng):
    rate, phi = 0.2, 0.1
    A = np.sqrt(1 - rate) * contraction(rng.standard_normal((4, 4)))
    psi = (1 - phi) / (rate - phi)  # by the Schur complement, for A'A = (1 - rate) I
    assert iss_margin(A, np.eye(4), phi, 1.01 * psi) > 0
    assert iss_margin(A, np.eye(4), phi, 0.9) < 0
    assert iss_margin(A, np.eye(4), 1.0, 1e6) < 0


def test_tampering_is_detected(rng):
    c = iss_certificate(stable(rng, 4, 0.9))
    assert c.verify() == c.margin > 0
    c.P[0, 0] *= 1.01
    assert c.verify() < 0
    c.P[:] = -np.eye(4)
    assert c.verify() == -np.inf


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("radius", [1.0, 1.3])
def test_unstable_is_said_without_a_solver(monkeypatch, radius, method):
    monkeypatch.setattr(cp.Problem, "solve", None)
    c = iss_certificate(np.diag([radius, 0.1]), method=method)
    assert not c.holds
    assert c.margin < 0 and c.n_solves == 0 and c.status == "not solved"
    assert "spectral radius" in c.reason and "does not hold" in repr(c)
    assert c.level == c.output_bound == np.inf
    assert np.isinf(c.output_bounds).all()
    assert np.isnan(c.eigenvalue_range).all()
    assert c.verify() == -np.inf
    for use in (lambda: c.contains([0, 0]), lambda: c.ellipse(0, 1)):
        with pytest.raises(ValueError, match=r"certificate must hold, got none"):
            use()


def test_phi_beyond_the_limit_is_infeasible():
    c = iss_certificate([[0.9]], phi=0.3)
    assert not c.holds and "1 - rho^2" in c.reason and c.n_solves == 0


def test_bad_solution_is_not_a_certificate(monkeypatch):
    from alssnn.certificates import _sdp

    monkeypatch.setattr(_sdp.LargestP, "__call__", lambda *_: (np.eye(1), "optimal"))
    c = iss_certificate([[0.9]], phi=0.1, method="sdp")
    assert not c.holds and "recomputation" in c.reason and "lyapunov" in c.reason
    assert "undecided" in repr(c) and "does not hold" not in repr(c)


def test_solver_breakdown(monkeypatch):
    def solve(*_, **__):
        raise cp.error.SolverError("no luck")

    monkeypatch.setattr(cp.Problem, "solve", solve)
    with pytest.raises(RuntimeError, match="CLARABEL broke down with status"):
        iss_certificate([[0.5]], method="sdp")


def test_interior_points_break_down(monkeypatch):
    loop = linear_lure(*(np.array([[z]]) for z in (0.5, 1.0, 1.0)))
    best = gain_certificate(loop)
    monkeypatch.setattr("alssnn.certificates._interior.STEPS", 3)
    c = gain_certificate(loop)  # ends at a point that is valid, if not the best
    assert c.holds and c.verify() > 0 and c.status == "stopped early: too many steps"
    assert c.gamma > best.gamma
    monkeypatch.setattr("alssnn.certificates._interior.STEPS", 0)
    c = gain_certificate(loop)
    assert not c.holds and c.status == "error" and np.isinf(c.gamma)
    assert "broke down" in c.reason
    assert repr(c).startswith("GainCertificate: undecided. The interior-point")


def test_a_slow_pole_has_a_gain(capfd):
    """It is 0.225 / slow: where it is not found, nothing may say that there is none."""

    def certificate(slow):
        one = (np.array([[z]]) for z in (1 - slow, 0.25, 0.9))
        return gain_certificate(linear_lure(*one))

    for slow in (1e-6, 6.8e-7, 5e-8):
        c = certificate(slow)
        assert c.holds and c.verify() > 0
        assert c.gamma == pytest.approx(0.225 / slow, rel=0.01)
    c = certificate(1e-8)
    assert not c.holds and c.verdict == "undecided"
    assert "No diagonal multipliers were found that prove" in c.reason
    assert capfd.readouterr() == ("", "")


def test_ellipse_and_contains():
    c = iss_certificate(np.diag([0.5, 0.9, 0.2]), objective="volume")
    t = np.linspace(0, 2 * np.pi, 9)
    circle = np.array([np.cos(t), np.sin(t)])
    x = np.zeros((9, 3))
    x[:, [0, 1]] = (c.ellipse(0, 1, section=True) @ circle).T
    assert c.contains(0.999 * x).all() and not c.contains(1.001 * x).any()
    assert c.contains(0 * x[0]) is True
    # a diagonal P: cut and shadow agree
    np.testing.assert_allclose(c.ellipse(0, 1), c.ellipse(0, 1, section=True))
    with pytest.raises(ValueError, match=r"`i` and `j` must be two different states"):
        c.ellipse(1, 1)
    with pytest.raises(ValueError, match=r"`x` must have 3 columns"):
        c.contains([1.0, 2.0])


def test_repr():
    text = repr(iss_certificate([[0.5]], eps=0.1))
    assert "holds while |omega| <= 0.1" in text and "conditional" in text
    assert "|y - y_lin| <= 0.2" in text


@pytest.mark.parametrize(
    ("eps", "said"),
    [
        ("data", "conditional: a bound seen on data"),
        ("global", "for all states and inputs"),
        (5.0, "conditional: while omega stays within"),
    ],
)
def test_a_certificate_says_where_its_bounds_come_from(eps, said, rng):
    structure = state_space(2, 1, 1, n_g=2, C=np.ones((1, 2)))
    plant = plant_of(structure.lure(random_theta(structure, rng, radius=0.5)))
    u = rng.standard_normal((50, 1))
    records = as_records([(u, np.zeros((50, 1)), np.zeros(2))])
    text = repr(certify_iss(plant, records, eps=eps))
    assert "holds while" in text and said in text
    assert ("conditional" in text) == (eps != "global")


def test_an_exact_law_needs_no_condition(rng):
    """Where g is zero, nothing may be left elsewhere."""
    structure = state_space(2, 1, 1, n_h=2, n_g=2, C=np.ones((1, 2)))
    p = dict(structure.split(random_theta(structure, rng, radius=0.5)))
    for name in ("W_g", "b_x"):
        p[name] = 0 * p[name]
    plant = plant_of_structure(structure, structure.join(p), rng)
    u = rng.standard_normal((50, 1))
    records = as_records([(u, np.zeros((50, 1)), np.zeros(2))])
    certificate = certify_iss(plant, records)
    assert certificate.holds and certificate.output_bound == 0
    assert "for all states and inputs" in repr(certificate)
    assert "conditional" not in repr(certificate)


@pytest.mark.parametrize(
    "args, kwargs, match",
    [
        (([[1, 2]],), {}, "`A` must be a finite square matrix"),
        (([[0.5]], [[1, 2]]), {}, "`C` must be a finite matrix of 1 columns"),
        (([[0.5]], [[0]]), {}, "`C` must not be zero"),
        (([[0.5]],), {"eps": -1}, "`eps` must be at least 0, got -1"),
        (([[0.5]],), {"eps": np.nan}, "`eps` must be at least 0, got nan"),
        (([[0.5]],), {"eta": -1}, "`eta` must be at least 0, one number"),
        (
            ([[0.5]],),
            {"eta": [1, 2]},
            "`eta` must be at least 0, one number",
        ),
        (([[0.5]],), {"phi": 1.5}, "`phi` must be between 0 and 1, got 1.5"),
        (([[0.5]],), {"objective": "x"}, "`objective` must be 'peak'"),
        (([[0.5]],), {"method": "x"}, "`method` must be 'lyapunov'"),
    ],
)
def test_wrong_arguments(args, kwargs, match):
    with pytest.raises(ValueError, match=match):
        iss_certificate(*args, **kwargs)


# -- bounds on the residual ------------------------------------------------------------


def plain_g(rng, n_g):
    """Return a plant y = x without h, g = G (tanh(v) - tanh(b)), and G, b."""
    nx, nu = 3, 2
    A, B, G = stable(rng, nx, 0.7), rng.standard_normal((nx, nu)), np.zeros((nx, n_g))
    G[:] = rng.standard_normal((nx, n_g))
    V, b = rng.standard_normal((n_g, nx + nu)), rng.standard_normal(n_g)
    Theta = np.block(
        [
            [A, B, G, -(G @ np.tanh(b))[:, None]],
            [np.eye(nx, nx + nu + n_g + 1)],
            [V, np.zeros((n_g, n_g)), b[:, None]],
        ]
    )
    return plant_of(Lure(Theta, nx, nu, n_g)), G, b


@pytest.mark.parametrize("n_g", [0, 5, 18])
def test_global_bound(rng, n_g):
    plant, G, b = plain_g(rng, n_g)
    eps, eta = global_bound(plant)
    signs = np.sign(rng.standard_normal((4000, n_g)))
    seen = np.linalg.norm((signs - np.tanh(b)) @ G.T, axis=1).max()
    crude = np.linalg.norm(G, axis=0) @ (1 + np.abs(np.tanh(b)))
    assert seen - 1e-12 <= eps <= crude + 1e-12
    if n_g == 5:
        assert eps == pytest.approx(seen)
    records = as_records([(rng.standard_normal((50, 2)),) * 2 + (np.ones(3),)])
    assert data_bound(plant, records)[0] <= eps
    assert not np.any(eta) and not np.any(data_bound(plant, records)[1])


def test_divergence_on_the_data_is_infinite(rng):
    plant, *_ = plain_g(rng, 2)
    plant.form.Theta[:3, :3] = 30 * np.eye(3)
    ones = np.ones((50, 2))
    eps, eta = data_bound(plant, as_records([(ones, ones, np.ones(3))]))
    assert eps == np.inf and np.isposinf(eta).all()
    c = iss_certificate([[0.5]], eps=np.inf)
    assert not c.holds and c.output_bound == np.inf and "eps is infinite" in repr(c)


def test_model_certificate(fitted):
    model, u, y = fitted
    on_data = model.iss_certificate(u, y)
    anywhere = model.iss_certificate(eps="global")
    given = model.iss_certificate(eps=0.5, objective="feasible")
    record = model.linearizability(u, y)
    assert on_data.holds and anywhere.holds and given.eps == 0.5
    assert record.closed_omega_max <= on_data.eps * (1 + 1e-9)
    assert on_data.eps < anywhere.eps
    # h is no disturbance: the loop has the residual of g alone
    W_g, b_x = model.params_["W_g"], model.params_["b_x"]
    crude = np.linalg.norm(W_g, axis=0) @ (1 + np.abs(np.tanh(b_x)))
    assert anywhere.eps <= crude + 1e-12

    # the bound on the output, in the loop that is simulated
    loop = linearized_loop(model)
    v = 5 * np.random.default_rng(0).standard_normal((200, 1))
    y_loop = channels(loop, simulate(loop, v, np.zeros(2)), v)[:, :1]
    e = y_loop - simulate_linear(model.A_, model.B_, model.C_, v)
    assert np.abs(e).max() <= anywhere.output_bound


def test_model_certificate_with_state_feedback(fitted):
    model, u, y = fitted
    K = 0.1 * np.linalg.pinv(model.B_) @ model.A_
    c = model.iss_certificate(u, y, K=K)
    np.testing.assert_allclose(c.A, model.A_ - model.B_ @ K)
    loop = state_feedback(model.plant_.close(), K)
    np.testing.assert_allclose(loop.M[:2, :2], c.A, atol=1e-12)
    assert model.gain_certificate(K=K).lure.nw == loop.nw  # g sees u, which sees h


# -- loops as they are -----------------------------------------------------------------


def feedthrough_record(n=1500):
    """Return u, y of x+ = 0.7 x + u - 1.2 tanh(x), y = x + 0.5 u."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-2, 2, n // 5), 5)[:, None]
    x, y = 0.0, np.zeros((n, 1))
    for k in range(n):
        y[k] = x + 0.5 * u[k, 0]
        x = 0.7 * x + u[k, 0] - 1.2 * np.tanh(x)
    return u, y + 0.01 * rng.standard_normal(y.shape)


def test_the_output_bound_knows_the_feedthrough():
    u, y = feedthrough_record()
    model = al_ssnn(
        nx=1,
        n_h=4,
        n_g=2,
        feedback="state",
        penalty="output",
        gamma=0.01,
        feedthrough=True,
        operating_point="zero",
        max_iter=100,
        gamma_h=1e-4,
        random_state=0,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(u, y)
    K = np.array([[0.3]])
    e = np.abs(model.linearizability(u, y).e).max()
    assert e > 0.1
    for eps in ("data", "global"):
        c = model.iss_certificate(u, y, eps=eps)
        assert c.holds and e <= c.output_bound, eps
        assert eps == "global" or c.output_bound < 3 * e
        assert c.output_bound == pytest.approx(c.output_bounds[0])
        assert f"|eta| <= {c.eta[0]:.4g}" in repr(c)
    # the loop that is certified, with a gain: y - y_lin of (A - BK, C - DK)
    c = model.iss_certificate(eps="global", K=K)
    np.testing.assert_allclose(c.C, model.C_ - model.D_ @ K)
    loop = linearized_loop(model, K)
    r = 2 * np.sign(np.random.default_rng(1).standard_normal((500, 1)))
    y_loop = channels(loop, simulate(loop, r, np.zeros(1)), r)[:, :1]
    A = model.A_ - model.B_ @ K
    y_linear = simulate_linear(A, model.B_, c.C, r) + r @ model.D_.T
    worst = np.abs(y_loop - y_linear).max()
    assert 0.1 < worst <= c.output_bound


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), with_gain=st.booleans())
def test_the_output_bound_of_random_loops_holds(seed, with_gain):
    """Nonlinear output, feedthrough, state feedback; the worst of random inputs."""
    rng = np.random.default_rng(seed)
    structure = state_space(
        2,
        2,
        2,
        n_h=3,
        n_g=2,
        n_k=3,
        feedback="state",
        feedthrough=True,
        C=rng.standard_normal((2, 2)),
    )
    theta = random_theta(structure, rng, radius=0.6)
    p = {**structure.split(theta), **structure.constants}
    weights = np.zeros((2, structure.nw))
    weights[:, :3] = p["W_h"]
    plant = plant_of(structure.lure(theta), weights, p["b_h"], feedback="state")
    K = 0.1 * rng.standard_normal((2, 2)) if with_gain else None
    A, B, C, D = plant.linear()
    if with_gain:
        A, C = A - B @ K, C - D @ K
    loop = linearized_loop(plant, K)
    size = rng.choice([0.3, 3.0])
    r = size * rng.standard_normal((200, 2))
    record = as_records([(r, r, np.zeros(2))])
    e = channels(loop, simulate(loop, r, np.zeros(2)), r)[:, :2]
    e -= simulate_linear(A, B, C, r) + r @ D.T
    assert np.abs(D).max() > 0 and np.abs(e).max() > 0
    for c in (
        certify_iss(plant, record, K=K),
        certify_iss(plant, K=K, eps="global"),
    ):
        assert not c.holds or np.linalg.norm(e, axis=1).max() <= c.output_bound
        assert not c.holds or np.all(np.abs(e).max(axis=0) <= c.output_bounds)


def late_plant(h=0.0, n=3):
    """Return x+ = 1.2 x + u(k - n) + B h tanh(2 x) + 1e-3 tanh(x), y = x."""
    Theta = np.array(
        [
            [1.2, 1.0, h, 1e-3, 0.0],
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    K = np.array([[h, 0.0]])
    return plant_of(Lure(Theta, 1, 1, 2), K, delay=np.array([n]))


def test_a_gain_that_forgets_the_delay_has_no_certificate():
    plant, forgets = late_plant(), np.ones((1, 1))
    radius = np.abs(np.roots([1, -1.2, 0, 0, 1])).max()
    assert radius > 1.2
    iss = certify_iss(plant, eps="global", K=forgets)
    gain = certify_gain(plant, forgets)
    for c in (iss, gain):
        assert not c.holds and f"radius of A is {radius:.6g}" in c.reason
    # one that knows it: the poles are at 0 and 0.6
    A = np.block([[np.array([[1.2, 1, 0, 0]])], [np.eye(3, 4, 2)]])
    A[3] = 0
    knows = 0.6 * np.array([[1.2**3, 1.2**2, 1.2, 1.0]])  # of x three samples ahead
    np.testing.assert_allclose(
        np.abs(np.linalg.eigvals(A - np.eye(4)[:, 3:] @ knows)).max(), 0.6, rtol=1e-6
    )
    c = certify_iss(plant, eps="global", K=knows)
    assert c.holds and c.A.shape == (4, 4)
    loop = linearized_loop(plant, knows)
    r = np.sign(np.random.default_rng(0).standard_normal((300, 1)))
    y = channels(loop, simulate(loop, r, np.zeros(4)), r)[:, :1]
    y_linear = simulate_linear(c.A, np.eye(4)[:, 3:], c.C, r)
    assert 0 < np.abs(y - y_linear).max() <= c.output_bound
    assert certify_gain(plant, knows).holds


def test_data_bound_of_a_late_plant_against_a_plain_loop(rng):
    K = 0.6 * np.array([[1.2**3, 1.2**2, 1.2, 1.0]])
    u, x0 = rng.standard_normal((40, 1)), np.array([0.4])
    omega = []
    for closed in (False, True):
        x, past = x0[0], [0.0, 0.0, 0.0]
        for k in range(40):
            now = u[k, 0] - closed * float(K[0] @ [x, *past])
            omega.append(1e-3 * abs(np.tanh(x)))
            x = 1.2 * x + past[0] + 1e-3 * np.tanh(x)
            past = [*past[1:], now]
    eps, _ = data_bound(late_plant(), as_records([(u, u, x0)]), K)
    assert eps == pytest.approx(max(omega), rel=1e-12)


def test_models_with_late_inputs_are_certified_with_them():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 1))
    late = np.vstack([np.zeros((3, 1)), u[:-3]])
    y = simulate_linear(np.array([[0.9]]), np.eye(1), np.eye(1), late)
    y += 0.01 * rng.standard_normal(y.shape)
    model = LinearStateSpace(nx=1, input_delay=3).fit(u, y)
    K = 0.95 / model.B_  # stable, was there no delay
    assert model.iss_certificate(u, y).holds
    assert not model.iss_certificate(u, y, K=K).holds
    assert not model.gain_certificate(K).holds
    with pytest.raises(ValueError, match=r"\(1, 1\) or \(1, 4\), past inputs included"):
        model.gain_certificate(np.ones((1, 2)))


@pytest.mark.parametrize("eps", ["data", "global", 0.1])
def test_loops_that_the_law_refuses_have_no_certificate(eps):
    u, y = feedthrough_record(400)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        options = {"nx": 1, "n_h": 2, "n_g": 2, "max_iter": 5, "random_state": 0}
        algebraic = al_ssnn(**options, feedthrough=True).fit(u, y)
        ahead = al_ssnn(**options, input_delay=2).fit(u, y)
    for model, why in ((algebraic, "algebraic loop"), (ahead, "2 samples ahead")):
        with pytest.raises(ValueError, match=why):
            model.linearizing_law()
        with pytest.raises(ValueError, match=why):
            model.iss_certificate(u, y, eps=eps)
        with pytest.raises(ValueError, match=why):
            model.gain_certificate()


def test_a_global_bound_grows_with_that_of_the_activation(rng):
    tanh = ACTIVATIONS["tanh"]
    twice = Activation(
        "twice",
        lambda v: 2 * np.tanh(v),
        lambda v, w: 2 - w**2 / 2,
        slope=(0, 2),
        bound=2,
    )
    options = {"n_g": 3, "C": np.ones((1, 2)), "tied_bias": False}
    one, two = (
        state_space(2, 1, 1, activation=activation, **options)
        for activation in (tanh, twice)
    )
    p = one.split(random_theta(one, rng))
    p["b_g"] = np.zeros(2)
    (eps, _), (larger, _) = (
        global_bound(plant_of(s.lure(s.join(p)))) for s in (one, two)
    )
    assert larger == pytest.approx(2 * eps)


@pytest.mark.parametrize("network", ["g", "k"])
def test_an_unbounded_activation_has_no_global_bound(network, rng):
    structure = state_space(
        2, 1, 1, n_g=2, n_k=2, C=np.ones((1, 2)), activation={network: "relu"}
    )
    plant = plant_of(structure.lure(random_theta(structure, rng)))
    c = certify_iss(plant, eps="global")
    assert c.output_bound == np.inf and np.isposinf(c.output_bounds).all()
    if network == "g":
        assert not c.holds and "in g is unbounded" in c.reason
        assert "data" in c.reason and "diverges" not in c.reason
    else:  # the states stay in their set all the same
        assert c.holds and np.isfinite(c.level) and "Nothing bounds eta" in repr(c)


def test_rounding_is_charged_to_a_margin():
    # exact numbers: what is missing to 1/2 and to 1 is the charge
    eps = np.finfo(float).eps
    assert iss_margin([[0.0]], [[1.0]], phi=0.5, psi=4.0) == 0.5 - 8 * eps
    lure = linear_lure(np.zeros((1, 1)), np.ones((1, 1)), np.zeros((1, 1)))
    c = replace(
        gain_certificate(linear_lure(*(np.full((1, 1), z) for z in (0.5, 1.0, 1.0)))),
        lure=Lure(np.zeros_like(lure.Theta), 1, 1, 0),
        P=np.eye(1),
        Lam=np.zeros(0),
        gamma=1.0,
    )
    assert c.verify() == 1.0 - 16 * eps
    # P is so ill-conditioned that its inequality says nothing
    P = np.diag([1.0, 1e-30])
    assert iss_margin(np.zeros((2, 2)), P, phi=0.5, psi=4.0) < 0
    lure = Lure(np.zeros((3, 4)), 2, 1, 0)
    assert replace(c, lure=lure, P=P).verify() < 0


def test_model_messages(fitted):
    model, u, y = fitted
    with pytest.raises(ValueError, match="`eps` must be 'data', 'global' or a number"):
        model.iss_certificate(u, y, eps="all")
    with pytest.raises(ValueError, match="`u` and `y` must be given for eps='data'"):
        model.iss_certificate()
    with pytest.raises(ValueError, match=r"`K` must be a finite matrix of shape"):
        model.gain_certificate(K=np.zeros((2, 2)))


def test_import_leaves_cvxpy_alone():
    code = "import sys, alssnn; sys.exit('cvxpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


# -- gains -----------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.5, 0.95, 0.999])
def test_hinf_norm(rng, radius):
    A, B, C = stable(rng, 4, radius), rng.standard_normal((4, 2)), np.eye(4)[:2]
    w = np.linspace(0, np.pi, 20001)
    z = np.exp(1j * np.concatenate([w, np.angle(np.linalg.eigvals(A))]))
    G = C @ np.linalg.solve(z[:, None, None] * np.eye(4) - A, B.astype(complex))
    expected = np.linalg.norm(G, ord=2, axis=(1, 2)).max()
    assert hinf_norm(A, B, C) == pytest.approx(expected, rel=1e-3)
    assert hinf_norm(A, B, C) >= expected * (1 - 1e-7)


def test_hinf_norm_limits():
    assert hinf_norm([[0.5]], [[1]], [[1]]) == pytest.approx(2)
    assert hinf_norm([[0.5]], [[0]], [[1]]) == 0
    assert hinf_norm([[1.0]], [[1]], [[1]]) == np.inf


@pytest.mark.parametrize("radius", [0.5, 0.97])
def test_gain_of_a_linear_system(rng, radius):
    A, B, C = stable(rng, 4, radius), rng.standard_normal((4, 2)), np.eye(4)[:2]
    certificate = gain_certificate(linear_lure(A, 100 * B, C))
    assert certificate.holds
    assert certificate.gamma == pytest.approx(100 * hinf_norm(A, B, C), rel=1e-3)


def test_gain_of_a_slope():
    # x+ = 0.2 x + 0.5 tanh(x) + v, y = x: worst with slope 1 throughout
    Theta = np.array([[0.2, 1, 0.5, 0], [1, 0, 0, 0], [1, 0, 0, 0]])
    certificate = gain_certificate(Lure(Theta, 1, 1, 1))
    assert certificate.gamma == pytest.approx(1 / 0.3, rel=1e-3)
    assert certificate.verify() == certificate.margin > 0
    assert "l2" in repr(certificate)
    certificate.Lam[0] *= 1.5
    assert certificate.verify() < 0


def test_gain_of_given_slopes():
    # x+ = 0.2 x + 0.5 tanh(x) + 0.3 sin(x) + v, of which every loop has one slope
    Theta = np.array(
        [[0.2, 1, 0.5, 0.3, 0], [1, 0, 0, 0, 0], [1, 0, 0, 0, 0], [1, 0, 0, 0, 0]]
    )
    sigma = (ACTIVATIONS["tanh"], ACTIVATIONS["sin"])
    lure = Lure(Theta, 1, 1, 2, sigma)
    # 0.4 <= tanh' <= 0.6 and 0.2 <= sin' <= 0.8 on some region: 0.46 to 0.74
    certificate = gain_certificate(lure, ([0.4, 0.2], [0.6, 0.8]))
    assert certificate.holds and certificate.verify() > 0
    assert certificate.gamma == pytest.approx(1 / (1 - 0.74), rel=1e-3)
    # no more than a point: the loop is linear
    linear = gain_certificate(lure, (0.5, 0.5))
    assert linear.gamma == pytest.approx(1 / (1 - 0.2 - 0.25 - 0.15), rel=1e-3)
    # slopes everywhere: 0.2 + 0.5 + 0.3 is an integrator
    assert not gain_certificate(lure).holds
    everywhere = gain_certificate(lure, ([0, -1], [1, 0.9]))
    assert everywhere.gamma == pytest.approx(1 / 0.03, rel=1e-3)


@pytest.mark.parametrize(
    ("slopes", "said"),
    [
        (0.5, r"be a pair of numbers or of arrays of shape \(2,\)"),
        (([0, 0, 0], 1), r"be a pair of numbers or of arrays of shape \(2,\)"),
        (([0, 1], [1, 0.5]), "got 1 and 0.5 of neuron 1"),
        ((0, np.inf), "got 0 and inf of neuron 0"),
    ],
)
def test_wrong_slopes(slopes, said):
    lure = Lure(np.zeros((4, 5)), 1, 1, 2)
    with pytest.raises(ValueError, match=f"`slopes` must .*{said}"):
        gain_certificate(lure, slopes)


def random_lure(rng, nx, nw, nu=1, ny=1, size=0.4, implicit=False):
    Theta = size * rng.standard_normal((nx + ny + nw, nx + nu + nw + 1))
    Theta[:nx, :nx] = stable(rng, nx, rng.uniform(0.1, 0.95))
    E = Theta[nx + ny :, nx + nu : -1]
    E[:] = 0.5 * E if implicit else np.tril(E, -1)
    return Lure(Theta, nx, nu, nw)


def smallest_gain_by_cvxpy(lure):
    """Return gamma, inf if there is none: the program as it is written."""
    nx, nu, nw = lure.nx, lure.nu, lure.nw
    now, v, w = np.split(np.eye(nx + nu + nw), [nx, nx + nu])
    plus, y, neurons = np.split(lure.Theta[:, :-1], [nx, nx + lure.nz])
    P, square = cp.Variable((nx, nx), PSD=True), cp.Variable()
    Lam = cp.Variable(nw, nonneg=True)
    sector = w.T @ cp.diag(Lam) @ (neurons - w)
    form = plus.T @ P @ plus - now.T @ P @ now + y.T @ y - square * (v.T @ v)
    form = form + sector + sector.T
    problem = cp.Problem(cp.Minimize(square), [(form + form.T) / 2 << 0])
    problem.solve(solver="CLARABEL")
    return np.sqrt(square.value) if problem.status == "optimal" else np.inf


@pytest.mark.parametrize("implicit", [False, True])
def test_interior_points_find_the_optimum(implicit):
    rng, decided = np.random.default_rng(int(implicit)), []
    for _ in range(15):
        nx, nw, nu, ny = rng.integers(1, 4, 4)
        lure = random_lure(rng, nx, nw + 1, nu, ny, implicit=implicit)
        certificate = gain_certificate(lure)
        decided.append(certificate.holds)
        expected = smallest_gain_by_cvxpy(lure)
        assert certificate.gamma == pytest.approx(expected, rel=1e-4)
    assert 3 <= sum(decided) <= 13


def test_derivatives_of_the_barrier(rng):
    from alssnn.certificates._interior import _Form

    nx, nw, n = 2, 3, 6
    now, plus = rng.standard_normal((2, nx, n))
    w, slack = rng.standard_normal((2, nw, n))
    Q, R = np.eye(n), -20 * np.eye(n)
    form = _Form(now, plus, w, slack, Q, R)
    z = form.pack(np.eye(nx), np.ones(nw), 30.0)

    def barrier(z):
        return -np.linalg.slogdet(form(z))[1]

    def gradient(z):
        return form.derivatives((np.linalg.cholesky(form(z)), True))[0]

    g, H = form.derivatives((np.linalg.cholesky(form(z)), True))
    steps = 1e-5 * np.eye(len(z))
    numeric = [(barrier(z + d) - barrier(z - d)) / 2e-5 for d in steps]
    np.testing.assert_allclose(g, numeric, rtol=1e-6, atol=1e-9)
    numeric = [(gradient(z + d) - gradient(z - d)) / 2e-5 for d in steps]
    np.testing.assert_allclose(H, numeric, rtol=1e-5, atol=1e-9)


def test_states_that_nothing_reaches_or_sees():
    """Their P is not bounded by the program."""
    Theta = np.zeros((4, 5))
    Theta[:3, :3] = np.diag([0.5, 0.8, 0.3])
    Theta[0, 3], Theta[3, 0] = 2.0, 1.0
    certificate = gain_certificate(Lure(Theta, 3, 1, 0))
    assert certificate.holds
    assert certificate.gamma == pytest.approx(4, rel=1e-4)
    nothing = gain_certificate(Lure(0 * Theta, 3, 1, 0))
    assert nothing.holds and nothing.gamma < 1e-3


def test_larger_loops_take_seconds():
    lure = random_lure(np.random.default_rng(0), 6, 20, size=0.15)
    certificate = gain_certificate(lure)
    assert certificate.holds and certificate.gamma >= empirical_gain(
        lure, np.random.default_rng(1)
    )
    assert certificate.solve_time < 10


def test_what_is_too_large_is_said_at_once():
    c = gain_certificate(linear_lure(0.5 * np.eye(63), np.eye(63), np.eye(63)))
    assert not c.holds and c.verdict == "undecided" and c.n_solves == 0
    assert "2017 unknowns, more than 2000, for 63 states and 0 neurons" in c.reason


def test_neurons_that_reach_nothing_are_left_out(rng):
    lure = random_lure(rng, 2, 2, size=0.3)
    more = (
        6  # two that nobody sees, two that these see, two that are seen by a live one
    )
    Theta = np.zeros((3 + more + 2, 3 + more + 3))
    old = np.r_[0:3, 3 + more : 3 + more + 3]
    rows = np.r_[0:3, 3 + more : 3 + more + 2]
    Theta[np.ix_(rows, old)] = lure.Theta
    new = 3 + np.arange(more)
    Theta[new, :3] = rng.standard_normal((more, 3))
    Theta[:2, 3] = 1e-17  # left over
    Theta[3 + 2, 3 + 0] = 5.0  # seen by a dead one
    dead = Lure(Theta, 2, 1, more + 2)
    a, b = gain_certificate(dead), gain_certificate(lure)
    assert a.holds and a.lure.nw == 2 and a.gamma == pytest.approx(b.gamma, rel=1e-6)
    Theta[-1, 3 + 4] = 0.1  # seen by a live one
    seen = gain_certificate(Lure(Theta, 2, 1, more + 2))
    assert seen.lure.nw == 3


@pytest.mark.parametrize("decay", [0.95, 0.85])
def test_decay(rng, decay):
    lure = random_lure(np.random.default_rng(4), 2, 2, size=0.2)
    assert np.abs(np.linalg.eigvals(lure.M[:2, :2])).max() < 0.8
    certificate = gain_certificate(lure, decay=decay)
    assert certificate.holds and certificate.verify() == certificate.margin > 0
    assert certificate.gamma >= gain_certificate(lure).gamma * (1 - 1e-5)
    assert f"|dx| falls by {decay}" in repr(certificate)
    u, P = rng.standard_normal((60, 1)), certificate.P
    starts = 3 * rng.standard_normal((2, 2))
    a, b = (simulate(lure, u, start) for start in starts)
    V = np.einsum("ki,ij,kj->k", a - b, P, a - b)
    assert (V <= V[0] * decay ** (2 * np.arange(61)) * (1 + 1e-9)).all()
    assert replace(certificate, decay=0.5).verify() < 0
    with pytest.raises(ValueError, match="`decay` must be above 0 and at most 1"):
        gain_certificate(lure, decay=0.0)


def test_decay_of_a_linear_loop():
    lure = linear_lure(*(np.full((1, 1), z) for z in (0.5, 1.0, 1.0)))
    certificate = gain_certificate(lure, decay=0.75)
    # of signals weighted by 0.75^-k: x+ = (x / 2 + v) / 0.75
    assert certificate.gamma == pytest.approx((1 / 0.75) / (1 - 0.5 / 0.75), rel=1e-4)
    slower = gain_certificate(lure, decay=0.5)
    assert "spectral radius of A is 0.5, not below the decay 0.5" in slower.reason


def test_gain_is_infeasible_or_unstable(monkeypatch):
    # slope 1 makes an integrator
    Theta = np.array([[0.5, 1, 0.5, 0], [1, 0, 0, 0], [1, 0, 0, 0]])
    infeasible = gain_certificate(Lure(Theta, 1, 1, 1))
    assert not infeasible.holds and infeasible.gamma == np.inf
    assert infeasible.margin < 0 and "undecided" in repr(infeasible)
    assert "largest slopes, the spectral radius is 1" in infeasible.reason
    # slopes (0, 0) and (1, 1) are stable, (1, 0) is not: 0.9 - 1.9
    Theta = np.array(
        [[0.9, 1, 1.9, 1.9, 0], [1, 0, 0, 0, 0], [-1, 0, 0, 0, 0], [1, 0, 0, 0, 0]]
    )
    between = gain_certificate(Lure(Theta, 1, 1, 2))
    assert between.status == "infeasible" and "undecided" in repr(between)
    # neurons that cancel: the gain is 2, but no multipliers know it
    Theta = np.array(
        [[0.5, 1, 2, -2, 0], [1, 0, 0, 0, 0], [1, 0, 0, 0, 0], [1, 0, 0, 0, 0]]
    )
    assert gain_certificate(Lure(Theta, 1, 1, 2)).verdict == "undecided"
    monkeypatch.setattr("alssnn.certificates._gain.smallest_gain", None)
    unstable = gain_certificate(linear_lure(np.eye(1), np.eye(1), np.eye(1)))
    assert not unstable.holds and "spectral radius" in unstable.reason
    assert unstable.verdict == "does not hold"
    assert unstable.n_solves == 0 and unstable.verify() == -np.inf


def test_all_programs_that_were_solved_count(monkeypatch):
    """The second tolerance is tried where the first leaves no valid multipliers."""
    useless = np.zeros((1, 1)), np.zeros(0), "optimal"
    monkeypatch.setattr("alssnn.certificates._gain.smallest_gain", lambda *_: useless)
    c = gain_certificate(linear_lure(np.eye(1) / 2, np.eye(1), np.eye(1)))
    assert not c.holds and "fail the recomputation" in c.reason and c.n_solves == 2


def empirical_gain(lure, rng):
    gains = []
    for scale in (1e-3, 1, 5):
        u = rng.standard_normal((300, lure.nu))
        du = scale * rng.standard_normal(u.shape)
        du[200:] = 0
        y = [
            channels(lure, simulate(lure, v, np.zeros(lure.nx)), v) for v in (u, u + du)
        ]
        gains.append(np.linalg.norm(y[1] - y[0]) / np.linalg.norm(du))
    return max(gains)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "relu", "identity", "sin"])
def test_gain_bounds_two_layers(seed, activation):
    rng = np.random.default_rng(seed)
    structure = state_space(
        3,
        2,
        1,
        n_h=2,
        n_g=(3, 4),
        C=rng.standard_normal((1, 3)),
        activation={"g": activation},
    )
    theta = random_theta(structure, rng, radius=0.3)
    lure = structure.lure(theta)
    assert np.any(lure.E)
    Theta = lure.Theta.copy()
    Theta[: lure.nx, lure.nx + lure.nu : -1] *= 0.3  # keeps the loop certifiable
    small = Lure(Theta, lure.nx, lure.nu, lure.nw, lure.sigma)
    certificate = gain_certificate(small)
    assert certificate.holds
    assert certificate.gamma >= empirical_gain(small, rng)
    # the one of the smallest slopes is one of the loops
    M = certificate.lure.M
    y_only = hinf_norm(M[:3, :3], M[:3, 3:], M[3:4, :3])
    assert certificate.gamma >= y_only * (1 - 1e-6)


def test_model_gain(fitted):
    model, _, _ = fitted
    certificate = model.gain_certificate()
    if certificate.holds:
        assert certificate.gamma >= hinf_norm(model.A_, model.B_, model.C_) * (1 - 1e-6)
        rng = np.random.default_rng(0)
        assert certificate.gamma >= empirical_gain(certificate.lure, rng)
    else:
        assert certificate.reason


def test_the_corners_of_16_neurons_are_tried(rng):
    """An exact maximum up to there, an upper bound beyond."""
    G, c = rng.standard_normal((2, 17)), rng.standard_normal(2)

    def tried(G):
        signs = np.array(list(product([-1.0, 1.0], repeat=G.shape[1])))
        return np.linalg.norm(signs @ G.T + c, axis=1).max()

    assert _largest(G[:, :16], c) == pytest.approx(tried(G[:, :16]))
    exact = tried(G)
    assert 1.001 * exact < _largest(G, c) < 3 * exact


def test_certificates_know_measured_disturbances(rng):
    """The law cancels h: what is left from v is linear, and says nothing of d."""
    C = rng.standard_normal((2, 2))
    options = {"n_h": 3, "C": C, "disturbances": (1,), "feedback": "state"}
    structure = state_space(2, 3, 2, **options).observe("y")
    plant = plant_of_structure(structure, random_theta(structure, rng), rng)
    A, B, C, D = plant.linear()
    G, H = plant.disturbed_by()
    form = linear_form(plant)
    order = [0, 2, 1]  # as the plant has them: moved, given, moved
    expected = np.block([[A, B, G], [C, D, H]])[:, np.r_[0, 1, 2 + np.argsort(order)]]
    np.testing.assert_array_equal(form.M, expected)
    assert not form.c.any() and form.nw == 0
    certificate = certify_gain(plant)
    assert certificate.lure.nu == 2
    assert certificate.gamma == pytest.approx(hinf_norm(A, B, C), rel=1e-3)
    # what was found to be bounded needs no reason
    bounded = certify_iss(plant, eps="global")
    assert bounded.holds and bounded.reason == "" and bounded.eps < 1e-12
    assert certify_iss(plant, eps=0.1).reason == ""


@pytest.mark.parametrize("angle", [0.0, 0.01, 1.234, 3.13, np.pi])
def test_the_norm_of_a_sharp_resonance(angle):
    """1 / (z^2 - 2 r cos(a) z + r^2) at exp(i a), where others are far smaller."""
    r, others = 0.99999, 0.7 * np.diag([1.0, -1.0])
    pair = r * np.array(
        [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    )
    A = np.block([[pair, np.zeros((2, 2))], [np.zeros((2, 2)), others]])
    rng = np.random.default_rng(0)
    B, C = rng.standard_normal((4, 2)), rng.standard_normal((1, 4))
    z = np.exp(1j * (angle + np.linspace(-1e-4, 1e-4, 4001)))
    G = [C @ np.linalg.solve(z_k * np.eye(4) - A, B) for z_k in z]
    expected = max(np.linalg.norm(G_k, 2) for G_k in G)
    assert hinf_norm(A, B, C) == pytest.approx(expected, rel=1e-6)
    assert hinf_norm(A, B, C) >= expected * (1 - 2e-8)
    assert hinf_norm(A, 0 * B, C) == 0.0


def test_the_norm_of_two_peaks_is_that_of_the_larger():
    """Two resonances between the points of the grid, the narrower one higher."""
    blocks, B = np.zeros((4, 4)), np.array([[1.0], [0.0], [1.0], [0.0]])
    for i, (r, angle) in enumerate(((0.9, 0.8), (0.999, 2.0023))):
        c, s = r * np.cos(angle), r * np.sin(angle)
        blocks[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[c, s], [-s, c]]
    C = np.array([[1.0, 0.0, 0.02, 0.0]])
    z = np.exp(1j * np.linspace(2.0, 2.005, 20_001))[:, None, None]
    G = C @ np.linalg.solve(z * np.eye(4) - blocks, np.broadcast_to(B, (len(z), 4, 1)))
    expected = np.abs(G).max()
    assert hinf_norm(blocks, B, C) == pytest.approx(expected, rel=1e-6)

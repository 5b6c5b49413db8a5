"""v = phi(u, s): a monotone map, its inverse, and the loop that it closes."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning
from structures import STRUCTURES, declare

import alssnn
from alssnn.activations import ACTIVATIONS
from alssnn.certificates import certify_gain, certify_iss
from alssnn.equations import Equations
from alssnn.estimators import _input_map
from alssnn.estimators._fitted import fitted_model
from alssnn.feedback import LinearizingLaw, input_range
from alssnn.implicit import ImplicitLayer, solve_each
from alssnn.lure import Lure
from alssnn.models import state_space
from alssnn.mpc import LinearizingMPC
from alssnn.simulation import channels, simulate
from alssnn.starts import initial_theta
from alssnn.subspace import identify_linear
from helpers import plant_of_structure

MONOTONE = [name for name in STRUCTURES if name.startswith("monotone")]


def plant_of(name, rng, size=1.0, residual=1.0):
    """Return a plant with steep maps, in units that differ."""
    structure = declare(name, rng)
    p = {k: 0.4 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    p["A"] *= 0.7 / np.abs(np.linalg.eigvals(p["A"])).max()
    for weights in ("U_phi", "r_phi", "V_phi"):
        p[weights] *= size
    if "W_g" in p:
        p["W_g"] *= residual
    return plant_of_structure(structure, structure.join(p), rng, 0)


def law_signals(plant, rng, n):
    ns = plant.law_form.nu - plant.nu
    s = rng.standard_normal((n, ns))
    if plant.feedback == "output":
        s = plant.y_offset + plant.y_scale * s
    return plant.u_offset + 3 * plant.u_scale * rng.standard_normal((n, plant.nu)), s


@pytest.mark.parametrize("size", [0.1, 1.0, 10.0])
@pytest.mark.parametrize("name", MONOTONE)
def test_the_law_solves_for_u(name, size, rng):
    plant = plant_of(name, rng, size)
    assert not plant.is_explicit and plant.cancels and not plant.no_law
    u, s = law_signals(plant, rng, 2000)
    v = u + plant.cancelled(s, u)
    found = plant.law(v, s)
    error = np.abs(found - u) / plant.u_scale
    assert error.max() < 1e-12 * (1 + np.abs(u / plant.u_scale).max())
    np.testing.assert_array_equal(plant.law(v[7], s[7]), plant.law(v[7:8], s[7:8])[0])


@pytest.mark.parametrize("name", MONOTONE)
def test_every_v_is_reached_by_one_u(name, rng):
    """The derivative of phi by u is symmetric in scaled inputs and at least d."""
    plant = plant_of(name, rng, 3.0)
    u, s = law_signals(plant, rng, 20)
    step = 1e-6
    slope = np.stack(
        [
            (plant.cancelled(s, u + d) - plant.cancelled(s, u - d)) / (2 * step)
            for d in step * np.diag(plant.u_scale)
        ],
        axis=-1,
    )
    slope = slope / plant.u_scale[:, None] + np.eye(plant.nu)
    np.testing.assert_allclose(slope, np.swapaxes(slope, 1, 2), atol=1e-6)
    assert np.linalg.eigvalsh(slope).min() > 0.01 - 1e-6
    v = plant.u_offset + plant.u_scale * rng.uniform(-50, 50, (200, plant.nu))
    u = plant.law(v, np.resize(s, (200, s.shape[1])))
    assert np.isfinite(u).all()


@pytest.mark.parametrize("name", MONOTONE)
def test_the_closed_loop_is_the_plant_under_its_law(name, rng):
    plant = plant_of(name, rng, 2.0)
    loop = plant.close()
    assert loop.implicit
    dv = rng.standard_normal((50, plant.nu)) * plant.u_scale
    x0 = rng.standard_normal(plant.nx)
    X = simulate(loop, dv, x0)
    u = channels(loop, X, dv)[:, plant.ny :] + plant.u_offset
    x = x0
    for k in range(50):
        s = x if plant.feedback == "state" else plant.output(x)
        by_law = plant.law(dv[k] + plant.u_offset, s)
        assert np.all(np.abs(u[k] - by_law) <= 1e-10 * plant.u_scale)
        x = plant.step(x, by_law)
        np.testing.assert_allclose(X[k + 1], x, atol=1e-10)


@pytest.mark.parametrize("name", MONOTONE)
def test_the_linear_part_is_that_from_v(name, rng):
    plant = plant_of(name, rng)
    A, B, *_ = plant.linear()
    u, s = law_signals(plant, rng, 30)
    x = s if plant.feedback == "state" else rng.standard_normal((30, plant.nx))
    dv = plant.virtual(x, u) - plant.u_offset
    omega = plant.step(x, u) - x @ A.T - dv @ B.T
    Z = channels(plant.observed, x, u - plant.u_offset)
    of_omega = slice(plant.ny + plant.nu, plant.ny + plant.nu + plant.nx)
    np.testing.assert_allclose(Z[:, of_omega], omega, atol=1e-11)
    if "g" not in declare(name, rng).signals:
        np.testing.assert_allclose(omega, 0, atol=1e-12)


@pytest.mark.parametrize("name", MONOTONE)
def test_slopes_of_the_loop(name, rng):
    loop = plant_of(name, rng, 2.0).linearized()
    x, u = rng.standard_normal((4, loop.nx)), rng.standard_normal((4, loop.nu))
    A, B, _, _ = loop.jacobian(x, u)
    step = 1e-6
    for J, size, moved in (
        (A, loop.nx, lambda d: loop.step(x + d, u)),
        (B, loop.nu, lambda d: loop.step(x, u + d)),
    ):
        differences = [(moved(d) - moved(-d)) / (2 * step) for d in step * np.eye(size)]
        np.testing.assert_allclose(J, np.stack(differences, axis=-1), atol=1e-6)


def test_certificates_hold_for_the_implicit_loop(rng):
    plant = plant_of("monotone-state", rng, residual=0.03)
    gain = certify_gain(plant)
    iss = certify_iss(plant, eps="global")
    assert gain.holds and iss.holds
    loop = plant.close()
    worst = 0.0
    for _ in range(20):
        a, b = rng.standard_normal((2, 300, 1)) * plant.u_scale
        b[150:] = a[150:]
        X = [simulate(loop, dv, np.zeros(plant.nx)) for dv in (a, b)]
        y = [
            channels(loop, x, dv)[:, : plant.ny]
            for x, dv in zip(X, (a, b), strict=True)
        ]
        worst = max(worst, np.linalg.norm(y[0] - y[1]) / np.linalg.norm(a - b))
    assert worst <= gain.gamma
    A, B, C, _ = plant.linear()
    linear = Lure(np.hstack([A, B, np.zeros((len(A), 1))]), plant.nx, plant.nu, 0)
    deviation = (X[0] - simulate(linear, a, np.zeros(plant.nx))) @ C.T
    assert np.all(np.abs(deviation).max(axis=0) <= iss.output_bounds)


def test_what_need_not_have_an_inverse_has_no_law(rng):
    e = Equations(x=2, u=1, y=1)
    x, u = e.state("x"), e.input("u")
    y = e.signal("y", e.parameter("C", "y", "x") @ x)
    v = e.signal("v", u + e.mlp("f", "u", 4, {"W_u": u}))
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    structure = e.structure({"x": A @ x + B @ v}, {"y": y, "v": v})
    plant = plant_of_structure(
        structure, 0.3 * rng.standard_normal(structure.n_params), rng, 0
    )
    assert "one u for every v" in plant.no_law
    with pytest.raises(ValueError, match="one u for every v"):
        plant.law(np.zeros(1), np.zeros(1))


def test_a_mirrored_weight_has_no_law(rng):
    plant = plant_of("monotone", rng)
    assert not plant.no_law
    Theta = plant.law_form.Theta.copy()
    Theta[plant.nu :, plant.law_form.nu - plant.nu : plant.law_form.nu] *= -1
    law_form = Lure(Theta, 0, plant.law_form.nu, plant.law_form.nw)
    assert "one u for every v" in replace(plant, law_form=law_form).no_law


def test_activations_of_the_map_must_not_decrease():
    with pytest.raises(ValueError, match="must not decrease, got 'sin'"):
        state_space(2, 1, 1, n_h=2, C=[[1, 0]], activation="sin", input_map="monotone")
    u, y = np.random.default_rng(0).standard_normal((2, 200, 1))
    with pytest.raises(ValueError, match="must not decrease, got 'sin'"):
        alssnn.FlSsnn(nx=1, activation="sin", input_map="monotone").fit(u, y)
    with pytest.raises(ValueError, match="input_map"):
        alssnn.FlSsnn(nx=1, input_map="square").fit(u, y)


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("rank", [1, 3])
def test_an_implicit_layer_is_solved_to_rounding(activation, rank, rng):
    sigma = ACTIVATIONS[activation]
    U = rng.standard_normal((12, rank)) * rng.choice([1e-3, 1, 30], (12, 1))
    E = -U @ (U * rng.uniform(0, 5, (12, 1))).T
    a = 20 * rng.standard_normal((3000, 12))
    w = ImplicitLayer(E, sigma).value(a)
    v = a + w @ E.T
    size = np.abs(a) + np.abs(w) @ np.abs(E.T)
    assert np.all(np.abs(sigma.value(v) - w) <= 1e-11 * (1 + size))


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("own", [False, True], ids=["coupled", "neurons of their own"])
def test_several_inputs_lead_to_the_lowest_point(activation, own, rng):
    """M F is the gradient of a convex function, however steep the neurons are."""
    U = 10 * rng.standard_normal((14, 3))
    if own:
        U *= np.eye(3)[np.arange(14) % 3]
    E = -U @ np.diag([100.0, 10.0, 1.0]) @ (U * rng.uniform(0, 5, (14, 1))).T
    layer = ImplicitLayer(E, ACTIVATIONS[activation])
    P, Q, M = layer.P, layer.Q, layer.metric
    np.testing.assert_allclose(P @ Q.T, E, atol=1e-9 * np.abs(E).max())
    along = -np.sum(P * (Q @ M), axis=1, keepdims=True)
    along /= np.sum((Q @ M) ** 2, axis=1, keepdims=True)
    assert np.all(along > 0) and np.array_equal(M, M.T)
    np.testing.assert_allclose(P, -along * (Q @ M), atol=1e-8 * np.abs(P).max())
    a = 100 * rng.standard_normal((3000, 14))
    w = layer.value(a)
    v = a + w @ E.T
    size = np.abs(a) + np.abs(w) @ np.abs(E.T)
    # neurons are as steep as they are: compare what they see, not what they say
    wanted = ACTIVATIONS[activation].value(v)
    assert np.all(np.abs(wanted - w) <= 1e-11 * (1 + size))
    a[7] = np.nan
    lost = layer.value(a)
    assert np.isnan(lost[7]).all() and np.isfinite(np.delete(lost, 7, 0)).all()


def test_a_layer_that_is_no_gradient_is_solved(rng):
    E = 0.2 * rng.standard_normal((8, 3)) @ rng.standard_normal((3, 8))
    layer = ImplicitLayer(E, ACTIVATIONS["tanh"])
    assert layer.metric is None
    a = rng.standard_normal((500, 8))
    w = layer.value(a)
    np.testing.assert_allclose(np.tanh(a + w @ E.T), w, atol=1e-12)


def test_a_sample_without_solution_leaves_the_others_theirs(rng):
    a = np.where(np.arange(40)[:, None] % 2, -1.0, 1e20 * rng.standard_normal((40, 6)))
    for _ in range(20):  # some of them are singular: the unit matrix is rounding
        U = 1e20 * rng.standard_normal((6, 2))
        E = -U @ (U * rng.uniform(0, 5, (6, 1))).T
        w = ImplicitLayer(E, ACTIVATIONS["relu"]).value(a)
        np.testing.assert_array_equal(w[1::2], 0.0)  # no neuron of these is bent
    matrices = np.array([np.eye(2), np.ones((2, 2)), 2 * np.eye(2)])
    solved = solve_each(matrices, np.ones((2, 1)))[..., 0]
    np.testing.assert_array_equal(solved, [[1, 1], [np.nan, np.nan], [0.5, 0.5]])


def test_one_sample_is_solved_as_one_of_many(rng):
    U = rng.standard_normal((12, 1)) * rng.choice([1e-3, 1, 30], (12, 1))
    layer = ImplicitLayer(-U @ U.T, ACTIVATIONS["tanh"])
    a = 20 * rng.standard_normal((300, 12))
    w = layer.value(a)
    assert layer.is_monotone
    for a_k, w_k in zip(a, w, strict=True):
        np.testing.assert_allclose(layer.value(a_k), w_k, rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(layer.value(a[:1]), layer.value(a[0])[None])
    for wrong in (np.nan, np.inf, 1e308):
        a[0] = wrong
        lost = layer.value(a)
        one = layer.value(a[0])
        np.testing.assert_array_equal(np.isnan(lost[0]), np.isnan(one))
        np.testing.assert_allclose(lost[1:], w[1:], rtol=1e-12, atol=1e-13)


def test_a_layer_without_a_solution_says_nan():
    relu = ACTIVATIONS["relu"]
    layer = ImplicitLayer(np.array([[2.0]]), relu)  # w = max(1 + 2 w, 0)
    assert np.isnan(layer.value(np.array([1.0]))).all()
    np.testing.assert_allclose(layer.value(np.array([-1.0])), 0.0, atol=1e-12)


def fan_arm(n, seed, noise=0.01):
    """Return a record of an arm that a fan lifts: thrust u^2, gravity, friction."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.1, 1.0, n // 20 + 1), 20)[:n]
    x, X = np.array([0.3, 0.0]), []
    for force in 8 * u**2:
        X.append(x)
        for _ in range(4):
            rate = force - 9 * np.sin(x[0]) - 2 * x[1]
            x = x + 0.0125 * np.array([x[1] + 0.00625 * rate, rate])
    y = np.array(X)[:, :1]
    return u[:, None], y + noise * y.std() * rng.standard_normal(y.shape)


def test_a_fan_is_linearized_by_default_options():
    u, y = fan_arm(400, 0)
    fresh = fan_arm(600, 1, noise=0)
    options = {"nx": 2, "n_init": 1, "random_state": 0, "dt": 0.05}
    model = alssnn.FlSsnn(input_map="monotone", **options).fit(u, y)
    plain = alssnn.FlSsnn(**options).fit(u, y)
    error, of_plain = (np.sqrt(1 - m.score(*fresh)) for m in (model, plain))
    assert error < 0.05 and 3 * error < of_plain
    assert model.alpha_ in _input_map.DECAYS
    # the law on the arm itself: u^2 in the place of u, up to what the state adds
    x = np.zeros((40, 2))
    inputs = np.linspace(0.15, 1.0, 40)[:, None]
    v = inputs + model.plant_.cancelled(x, inputs)
    fit = np.polyfit(inputs[:, 0] ** 2, v[:, 0], 1)
    assert np.abs(v[:, 0] - np.polyval(fit, inputs[:, 0] ** 2)).max() < 0.1 * np.ptp(v)
    figures = model.linearizability(u, y)
    assert figures.closed_linearization_error.max() < 1e-9


@pytest.mark.parametrize(
    ("matched", "nx", "seed", "needed"),
    [(True, 1, 0, False), (False, 2, 0, True), (False, 2, 2, False)],
)
def test_g_stays_zero_where_hidden_samples_do_not_need_it(matched, nx, seed, needed):
    """A curve of the actuator is all of phi; no law cancels one behind a state.

    The third training without g has found a phi so good that g gains 5 %: too little.
    """
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, 200), 3)
    x, y = np.zeros(2), np.empty(600)
    for k in range(600):
        y[k] = x[0]
        if matched:
            x = np.array([0.8 * x[0] + 0.2 * u[k] + 0.4 * u[k] ** 3, 0.0])
        else:
            x = np.array([0.7 * x[0] + 0.4 * np.tanh(3 * x[1]), 0.5 * (x[1] + u[k])])
    y += 0.01 * y.std() * rng.standard_normal(600)
    sizes = {"nx": nx, "n_h": 4, "n_g": 4, "n_init": 1, "max_iter": 100}
    options = {"feedback": "state", "input_map": "monotone", "random_state": 0}
    options["integrators"] = 0
    model = alssnn.AlSsnn(**sizes, **options).fit(u, y)
    assert np.any(model.params_["W_h"]) and np.any(model.params_["r_phi"])
    assert np.any(model.params_["W_g"]) == needed
    error = model.linearizability(u, y).closed_linearization_error.max()
    assert error > 0.01 if needed else error == 0.0
    fit = fitted_model(model)  # what is held has no variance
    assert fit.free[fit.structure.slices["W_g"]].all() == needed
    assert fit.free[fit.structure.slices["W_h"]].all()
    if matched:
        covariance = model.parameter_covariance(u, y)
        (drawn,) = model.sample_models(covariance, 1, random_state=0, data=(u, y))
        assert not np.any(drawn.params_["W_g"])
        assert np.any(drawn.params_["W_h"] != model.params_["W_h"])
        more = y + 0.01 * rng.standard_normal(600)
        model.set_params(warm_start=True, tol=1e-2).fit(u, more)
        assert not np.any(model.params_["W_g"])


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_map_is_searched_along_decays_of_its_own(monkeypatch):
    monkeypatch.setattr(_input_map, "DECAYS", (0.03, 0.02))
    u, y = fan_arm(400, 0)
    options = {"nx": 2, "n_h": 3, "n_init": 1, "max_iter": 50, "random_state": 0}
    model = alssnn.FlSsnn(input_map="monotone", **options).fit(u, y)
    assert model.alpha_ in (0.03, 0.02)


def test_single_samples_meet_rows(rng):
    plant = plant_of("monotone", rng)
    law = LinearizingLaw(plant)
    u, s = law_signals(plant, rng, 5)
    rows = law(u, s[0])
    assert rows.shape == u.shape
    np.testing.assert_array_equal(rows, law(u, np.tile(s[0], (5, 1))))
    np.testing.assert_array_equal(law.h(s[0], u), law.h(np.tile(s[0], (5, 1)), u))
    with pytest.raises(ValueError, match="`u` must be given"):
        law.h(s)


@pytest.mark.parametrize("name", ["monotone", "monotone-state"])
def test_what_the_limits_cut_is_what_the_linear_part_misses(name, rng):
    plant = plant_of(name, rng)
    high = plant.u_offset + 0.3 * plant.u_scale
    law = LinearizingLaw(plant, u_max=high)
    v, s = law_signals(plant, rng, 100)
    u, cut = law.split(v, s)
    met = np.any(u == high, axis=1)
    assert met.any() and not met.all() and np.all(u <= high)
    assert not cut[~met].any()
    np.testing.assert_allclose(v - cut, u + plant.cancelled(s, u), atol=1e-9)
    block = law.to_nlsys(with_cut=True)  # in a loop that overflows the limits hold
    lost = block.output(0.0, np.zeros(0), np.concatenate([v[0] * np.nan, s[0]]))
    assert np.all(lost[: plant.nu] <= high) and np.isfinite(lost).all()


@pytest.mark.filterwarnings("ignore:.*stopped after")
def test_what_h_does_not_see_phi_does_not_see():
    u, y = fan_arm(300, 0)
    both = np.hstack([y, np.gradient(y[:, 0])[:, None]])
    model = alssnn.FlSsnn(
        nx=2,
        n_h=3,
        alpha=1e-5,
        max_iter=5,
        n_init=1,
        random_state=0,
        feedback="output",
        h_inputs=[0],
        input_map="monotone",
    ).fit(u, both)
    for name in ("W_y", "V_phi"):
        assert np.any(model.params_[name][:, 0])
        assert not np.any(model.params_[name][:, 1])


@pytest.mark.filterwarnings("ignore:.*stopped after", "ignore:.*all but linear")
@pytest.mark.parametrize("alpha", [1e-5, 0.1])
def test_v_is_as_large_as_u(alpha):
    u, y = fan_arm(400, 0)
    options = {"nx": 2, "n_h": 3, "n_init": 1, "random_state": 0, "max_iter": 30}
    model = alssnn.FlSsnn(alpha=alpha, input_map="monotone", **options).fit(u, y)
    (record,) = model.prepare_records(u, y)
    plant = model.plant_
    X = simulate(plant.lure, record.du, model.x0_[0])[:-1]
    v = plant.virtual(X, u)
    assert v.std() == pytest.approx(u.std(), rel=1e-6)


def test_without_a_gain_the_linear_model_is_returned_as_it_is():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((300, 1))
    y = control_free(u) + 0.3 * rng.standard_normal((300, 1))
    with pytest.warns(ConvergenceWarning, match="do not simulate hidden samples"):
        model = alssnn.FlSsnn(
            nx=1, n_h=3, n_init=1, max_iter=50, random_state=0, input_map="monotone"
        ).fit(u, y)
    plant = model.plant_
    np.testing.assert_allclose(plant.cancelled(np.ones((5, 1)), u[:5]), 0, atol=1e-14)


def control_free(u):
    y = np.zeros_like(u)
    for k in range(1, len(u)):
        y[k] = 0.8 * y[k - 1] + u[k - 1]
    return y


def test_what_a_monotone_map_cannot_do_is_refused():
    u, y = fan_arm(300, 0)
    for options, match in (
        ({"n_h": 0}, "`n_h` must be positive"),
        ({"input_delay": 2}, "must be 'identity' for inputs that arrive late"),
    ):
        with pytest.raises(ValueError, match=match):
            alssnn.FlSsnn(nx=2, input_map="monotone", **options).fit(u, y)


@pytest.mark.filterwarnings("ignore:.*stopped after")
def test_predictive_control_meets_a_limit_of_the_input_exactly():
    u, y = fan_arm(600, 0)
    options = {"nx": 2, "n_h": 4, "n_init": 1, "random_state": 0, "max_iter": 60}
    model = alssnn.FlSsnn(alpha=1e-5, input_map="monotone", **options).fit(u, y)
    mpc = LinearizingMPC(model, u_min=0.1, u_max=1.0, n_passes=4)
    reference = model.y_offset_ + model.plant_.y_scale * np.repeat([1.0, -1.0], 60)
    record = mpc.simulate(model, reference)
    assert record.n_fallbacks == 0
    assert np.any([step.saturated for step in record.steps])
    assert max(np.abs(step.cut).max() for step in record.steps) < 1e-6
    assert abs(record.y[59] - reference[59]) < 1e-3 * model.plant_.y_scale


@pytest.mark.parametrize("name", MONOTONE)
def test_the_map_in_two_steps_is_the_map(name, rng):
    plant = plant_of(name, rng)
    before, behind = plant.law_map.parts()
    ds, du = rng.standard_normal((9, before.nu)), rng.standard_normal((9, plant.nu))
    none = np.zeros((9, 0))
    of_s = channels(before, none, ds)
    dv = channels(behind, none, np.hstack([of_s, du]))
    whole = channels(plant.law_form, none, np.hstack([ds, du]))
    np.testing.assert_allclose(dv, whole, rtol=1e-12, atol=1e-13)


def test_the_start_spreads_over_the_states_of_the_linear_model():
    """phi sees x of unit size, as h does, though nothing but d u acts at R = 0."""
    u, y = fan_arm(600, 0)
    u, y = (u - u.mean()) / u.std(), (y - y.mean()) / y.std()
    linear = identify_linear([(u, y)], 2)
    structure = state_space(
        2, 1, 1, n_h=400, C=linear.C, feedback="state", input_map="monotone"
    )
    rng = np.random.default_rng(0)
    p = structure.split(initial_theta(structure, linear, [(u, y)], rng))
    plain = state_space(2, 1, 1, n_h=400, C=linear.C, feedback="state")
    q = plain.split(initial_theta(plain, linear, [(u, y)], np.random.default_rng(0)))
    np.testing.assert_allclose(p["b_s"].std(), q["b_s"].std(), rtol=0.1)
    np.testing.assert_allclose(p["r_phiu"] ** 2, 0.99)


@pytest.fixture(scope="module")
def fan():
    record = alssnn.datasets.make_fan_arm(300, noise=0.01, random_state=0)
    options = {"nx": 2, "n_h": 2, "n_init": 1, "max_iter": 5, "random_state": 0}
    model = alssnn.FlSsnn(
        input_map="monotone", alpha=1e-4, dt=record.dt, tol=0.1, **options
    )
    with pytest.warns(ConvergenceWarning):
        return model.fit(record.u, record.y)


def test_limits_that_were_never_reached_are_warned_of(fan):
    low, high = input_range(fan)
    size = high - low
    near = fan.linearizing_law(u_min=low - 0.09 * size, u_max=high + 0.09 * size)
    assert near.u_max == high + 0.09 * size
    with pytest.warns(
        UserWarning, match=r"limit .* of 'u\[0\]' is beyond the training"
    ):
        fan.linearizing_law(u_max=high + 0.11 * size)
    with pytest.warns(UserWarning, match=r"Record inputs up to the limit"):
        fan.linearizing_law(u_min=low - 0.11 * size)


def test_a_law_without_a_solution_says_so(fan, monkeypatch):
    low, high = input_range(fan)
    law = fan.linearizing_law(u_min=low, u_max=high)
    monkeypatch.setattr(
        type(fan.plant_), "law", lambda self, v, s, d=None: np.full_like(v, np.nan)
    )
    with pytest.warns(RuntimeWarning, match="found no u"):
        u = law(np.array([0.5]), np.zeros(2))
    assert low <= u <= high


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_the_center_of_the_decay_has_the_size_of_v():
    """A fit that goes on begins near its own optimum: the decay knows the new phi."""
    record = alssnn.datasets.make_fan_arm(300, noise=0.01, random_state=0)
    model = alssnn.FlSsnn(
        nx=2,
        n_h=5,
        n_init=1,
        integrators=0,
        dt=record.dt,
        input_map="monotone",
        random_state=0,
        warm_start=True,
    ).fit(record.u, record.y)
    center = model.fitted_.structure.split(model.fitted_.decay["center"])
    # the start has the gain one, and v its size behind the fit
    gain = 0.01 + center["r_phiu"] ** 2
    assert abs(gain[0] - 1) > 0.01
    before = model.cost_
    model.fit(record.u, record.y)
    # near: phi was multiplied by 9, and its distance from the center with it, so that
    # the decay weighs more (0.92 to 1.08 times the cost before, five seeds)
    assert model.cost_ <= before * 1.1

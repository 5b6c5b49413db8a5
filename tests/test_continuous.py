"""Models in continuous time: steps of Runge and Kutta, holds, rates, consequences."""

import pickle
import warnings
import zipfile

import control
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.io import loadmat
from scipy.linalg import expm
from scipy.signal import butter, lsim, sosfiltfilt
from sklearn.base import clone
from sklearn.frozen import FrozenEstimator

import alssnn
from alssnn import LinearStateSpace, cli
from alssnn.continuous import (
    HOLDS,
    between,
    can_be_stepped,
    converted,
    damped,
    derivative,
    flow,
    held,
    sampled,
    with_nodes,
)
from alssnn.feedback import DisturbanceObserver
from alssnn.innovations import has_innovations
from alssnn.models import state_space
from alssnn.simulation import outputs, regressors, simulate
from alssnn.validation import ahead_fit, frequency_response
from benchmarks.continuous import keep, steps_of_training
from helpers import assert_direct

pytestmark = pytest.mark.filterwarnings(
    "ignore::sklearn.exceptions.ConvergenceWarning"  # short fits are enough
)

C = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -0.5]])


def equations(**options):
    """Return equations of derivatives with stable random parameters."""
    rng = np.random.default_rng(1)
    networks = {"n_h": 3, "n_g": (3, 2), "feedback": "output", **options}
    structure = state_space(3, 2, 2, C=C, **networks)
    theta = 0.3 * rng.standard_normal(structure.n_params)
    theta[structure.slices["A"]] -= 0.6 * np.eye(3).ravel()
    return structure, theta


def runge_kutta(lure, nodes, substeps, n):
    """Return the states of the classical method, written as everybody knows it."""

    def f(x, u):
        return regressors(lure, x[None], u[None])[0] @ lure.rows_x.T

    x, h, X = np.zeros(lure.nx), 1 / substeps, []
    for k in range(n):
        X.append(x)
        for j in range(substeps):
            first, middle, last = nodes[k, 2 * j : 2 * j + 3]
            k1 = f(x, first)
            k2 = f(x + h / 2 * k1, middle)
            k3 = f(x + h / 2 * k2, middle)
            k4 = f(x + h * k3, last)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(X)


@pytest.mark.parametrize("hold", HOLDS)
@pytest.mark.parametrize("substeps", [1, 2])
def test_a_sampled_structure_is_the_method_of_runge_and_kutta(hold, substeps, rng):
    structure, theta = equations(feedthrough=True, n_k=2)
    whole = sampled(structure, hold, substeps).observe("y", "e")
    u = rng.standard_normal((40, 2))
    z = np.hstack([u, between(u, hold, substeps)])
    assert z.shape[1] == whole.nu
    nodes = np.repeat(u[:, None], 2 * substeps + 1, axis=1)
    if hold != "zoh":
        nodes[:, 1:] = z[:, 2:].reshape(40, 2 * substeps, 2)
    plain = structure.observe("y", "e").lure(theta)
    X = simulate(whole.lure(theta), z, np.zeros(plain.nx))[:-1]
    np.testing.assert_allclose(
        X, runge_kutta(plain, nodes, substeps, 40), rtol=1e-12, atol=1e-13
    )


@pytest.mark.parametrize("hold", ["zoh", "cubic"])
@pytest.mark.parametrize("options", [{}, {"input_map": "monotone"}, {"n_g": 0}])
def test_the_derivative_of_a_sampled_structure_is_exact(hold, options, rng):
    structure, theta = equations(**options)
    channels = ["y", "e"] if "e" in structure.signals else ["y"]
    assert_direct(sampled(structure, hold, 2).observe(*channels), theta, rng)


def test_signals_of_a_sample_are_those_of_its_first_stage(rng):
    structure, theta = equations()
    view, u, x = sampled(structure), rng.standard_normal((1, 2)), rng.standard_normal(3)
    for name in ("y", "v", "h", "g"):
        one, other = (
            regressors(lure, x[None], u)[0] @ lure.rows_z.T
            for lure in (s.observe(name).lure(theta) for s in (structure, view))
        )
        np.testing.assert_allclose(one, other, rtol=1e-14)


def test_between_two_samples_a_cubic_is_a_cubic():
    k = np.arange(12.0)[:, None]
    u = np.hstack([0.01 * k**3 - 0.2 * k**2 + k, 2 - k])
    for hold, column, last in (("cubic", 0, 9), ("cubic", 1, 12), ("linear", 1, 12)):
        nodes = between(u, hold, 2).reshape(12, 4, 2)[:last, :, column]
        t = k[:last] + np.arange(1, 5) / 4
        expected = [0.01 * t**3 - 0.2 * t**2 + t, 2 - t][column]
        # a spline bends before an end that goes on along a line
        slack = 0.02 if column == 0 else 1e-12
        np.testing.assert_allclose(nodes, expected, atol=slack)
    assert between(u, "zoh", 3).shape == (12, 0)
    np.testing.assert_array_equal(between(u[:1], "cubic", 1), [[*u[0], *u[0]]])


def rates(A):
    """Return the derivative that a discrete state matrix samples."""
    p = {"A": A, "B": np.ones((len(A), 1)), "C": np.ones((1, len(A)))}
    return converted(state_space(len(A), 1, 1), p)["A"]


def test_rates_are_the_logarithm():
    A = np.array([[-0.3, 1.2, 0.0], [-1.2, -0.3, 0.4], [0.0, 0.0, -0.1]])
    np.testing.assert_allclose(rates(expm(A)), A, atol=1e-12)
    poles = np.linalg.eigvals(rates(np.diag([-0.5, 0.0, 1e-9, 0.5])))
    np.testing.assert_allclose(np.sort(poles), [-2.5, -2.5, -0.8, np.log(0.5)])
    twice = rates(np.array([[0.5, 1.0], [0.0, 0.5]]))
    np.testing.assert_allclose(expm(twice), [[0.5, 1.0], [0.0, 0.5]], atol=1e-4)
    assert np.linalg.eigvals(damped(np.diag([0.3, -1.0]))).max() == pytest.approx(-1e-3)
    assert not can_be_stepped(np.diag([-3.0, -1.0]), 1)
    assert can_be_stepped(np.diag([-3.0, -1.0]), 2)
    assert can_be_stepped(damped(np.diag([-3.0, -1.0])), 1)


def test_converted_parameters_of_a_linear_model_have_its_response():
    rng = np.random.default_rng(0)
    structure = state_space(2, 1, 1)
    p = {"A": [[0.9, 0.2], [-0.2, 0.9]], "B": [[0.1], [1.0]], "C": [[1.0, 0.3]]}
    p = {name: np.array(value) for name, value in p.items()}
    u, x0 = rng.standard_normal((60, 1)), np.zeros(2)
    y = outputs(structure.lure(structure.join(p)), u, x0)
    whole = sampled(structure, "zoh", 4)
    y_c = outputs(whole.lure(whole.join(converted(structure, p))), u, x0)
    np.testing.assert_allclose(y_c, y, atol=1e-5)


@pytest.mark.parametrize("hold", ["zoh", "cubic"])
def test_a_mode_that_alternates_keeps_its_response_at_rest(hold):
    structure = state_space(3, 1, 1)
    p = {"A": np.diag([0.9, 0.5, -0.99]), "B": np.ones((3, 1)), "C": np.ones((1, 3))}
    p_c = converted(structure, p, hold)
    gains = np.linalg.solve(np.eye(3) - p["A"], p["B"])
    gains_c = np.linalg.solve(-p_c["A"], p_c["B"])
    assert gains_c[2] == pytest.approx(gains[2])
    if hold == "zoh":
        np.testing.assert_allclose(gains_c, gains)


def test_an_input_that_is_smooth_between_samples_takes_no_pole_that_alternates():
    # a discrete model takes a pole at -1 to know the input between the samples
    def record(seed, dt=0.3, parts=4, n=400):
        rng = np.random.default_rng(seed)
        band = butter(4, [0.05, 0.5], "band", output="sos")
        u = 0.8 * sosfiltfilt(band, rng.standard_normal(n))
        at = (np.arange(parts * n) + 0.5) / parts
        fine = CubicSpline(np.arange(n), u)(at)
        X = simulated_plant(stiffening, fine, dt / parts, steps=2)
        return u[:, None], X[::parts, 0]

    options = {"nx": 3, "n_h": 3, "dt": 0.3, "n_init": 1, "random_state": 0}
    options |= {"alpha": 1e-6, "max_iter": 60}
    (u, y), test = record(0), record(1)
    y = y + 0.002 * np.random.default_rng(3).standard_normal(len(y))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        discrete = alssnn.FlSsnn(linear_part="trained", **options).fit(u, y)
        options |= {"time": "continuous", "hold": "cubic"}
        model = alssnn.FlSsnn(**options).fit(u, y)
    assert np.linalg.eigvals(discrete.A_).real.min() < -0.9
    assert 1 - model.score(*test) < 0.1 * (1 - discrete.score(*test))


def test_flow_is_the_map_without_memory(rng):
    structure, theta = equations()
    whole = sampled(structure, "linear")
    map_ = flow(whole)
    assert map_.nx == 0 and map_.n_params == whole.n_params
    u = rng.standard_normal((30, 2))
    ((z, _),) = with_nodes(whole, [(u, None)])
    X = simulate(whole.observe("y").lure(theta), z, np.zeros(3))
    following = outputs(map_.lure(theta), np.hstack([z, X[:-1]]), np.zeros(0))
    np.testing.assert_allclose(following, X[1:], atol=1e-13)


def test_views_know_each_other():
    structure, _ = equations(disturbances=(1,))
    whole = sampled(structure, "cubic", 2)
    assert derivative(whole) is structure and derivative(structure) is structure
    assert held(structure) is structure and held(whole).nu == 2
    assert held(whole, 5).sampling.substeps == 5
    assert whole.given.tolist() == structure.given.tolist() == [1]
    assert not has_innovations(whole)


# -- fits ----------------------------------------------------------------------------


def simulated_plant(f, u, dt, x0=(0.0, 0.0), steps=8):
    """Return the states of x' = f(x, u) at the samples; u is a function of time."""
    x, X, h = np.array(x0), [], dt / steps
    for k in range(len(u)):
        X.append(x)
        for _ in range(steps):
            k1 = f(x, u[k])
            k2 = f(x + h / 2 * k1, u[k])
            k3 = f(x + h / 2 * k2, u[k])
            k4 = f(x + h * k3, u[k])
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(X)


def pendulum(x, u):
    """Return x' of a pendulum whose input is a torque."""
    return np.array([x[1], 4 * u - 4 * np.sin(x[0]) - 0.8 * x[1]])


def stiffening(x, u):
    """Return x' of a spring that stiffens."""
    return np.array([x[1], 4 * u - 4 * x[0] - 3 * x[0] ** 3 - 0.8 * x[1]])


def steps(n, length, seed=0):
    """Return an input of random steps."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1, 1, n // length + 1), length)[:n]


def swinging(dt, n=600, seed=0):
    """Return a record of the pendulum without noise; the input is the same in time."""
    u = 0.6 * steps(n, round(1.6 / dt), seed)
    return u[:, None], simulated_plant(pendulum, u, dt)[:, 0]


def distance(poles, true):
    """Return how far two poles are from those of the plant, in any order."""
    return min(np.abs(poles - order).max() for order in (true, true[::-1]))


def hanging(model, dt):
    """Return the poles about the hanging pendulum, which no basis changes."""
    A, *_ = model.plant_.at(dt / 64).jacobian(np.zeros((1, 2)), np.zeros((1, 1)))
    return np.log(np.linalg.eigvals(A[0]).astype(complex)) * 64 / dt


def test_parameters_are_those_of_the_plant_and_converge_with_fourth_order():
    # u + h(y) with h = w sin(a y) is the equation of the pendulum
    errors = []
    for dt in (0.4, 0.2):
        u, y = swinging(dt, 400)
        model = alssnn.FlSsnn(
            nx=2,
            n_h=1,
            odd=True,
            activation="sin",
            feedback="output",
            dt=dt,
            time="continuous",
            operating_point="zero",
            tol=1e-15,
            max_iter=300,
            random_state=0,
            n_init=1,
        ).fit(u, y)
        errors.append(distance(hanging(model, dt), np.roots([1.0, 0.8, 4.0])))
    assert errors[0] < 0.02 and errors[1] < 1e-3
    assert np.log2(errors[0] / errors[1]) > 3.5, errors


@pytest.fixture(scope="module")
def noisy():
    u, y = swinging(0.2, 600)
    return u, y + 0.01 * np.random.default_rng(1).standard_normal(len(y))


@pytest.fixture(scope="module")
def swing(noisy):
    return alssnn.FlSsnn(
        nx=2,
        n_h=3,
        dt=0.2,
        time="continuous",
        alpha=1e-6,
        n_init=1,
        integrators=0,
        random_state=0,
    ).fit(*noisy)


def test_a_model_holds_at_another_rate(swing):
    u, y = swinging(0.1, 600, seed=5)
    refit = alssnn.FlSsnn(
        nx=2,
        n_h=3,
        dt=0.1,
        time="continuous",
        alpha=1e-6,
        n_init=1,
        integrators=0,
        random_state=0,
    ).fit(*swinging(0.1, 800))
    plant, errors = swing.plant_.at(0.1), []
    for one in (plant, refit.plant_):
        du = u - one.u_offset
        y_hat = outputs(one.lure, du, np.zeros(2))[:, 0] + one.y_offset
        errors.append(np.sqrt(np.mean((y_hat - y)[100:] ** 2)))
    assert errors[0] < 0.02 * y.std()
    assert errors[0] < errors[1] + 0.01  # of the noise of its record


def test_what_is_published_is_by_seconds(swing):
    plant = swing.plant_
    A, B, *_ = plant.linear()
    system = swing.to_statespace()
    assert system.dt == 0 and swing.to_statespace(dt=0.2).dt == 0.2
    np.testing.assert_array_equal(system.A, swing.A_)
    exact = control.sample_system(system, 0.2)
    np.testing.assert_allclose(A, exact.A, atol=2e-3)
    np.testing.assert_allclose(B, exact.B, atol=2e-3)
    finer = plant.at(0.2 / 16)
    exact = control.sample_system(system, 0.2 / 16)
    np.testing.assert_allclose(finer.linear()[0], exact.A, atol=1e-9)
    x, u = np.array([[0.4, -0.3]]), np.array([[0.5]])
    X = x
    for _ in range(16):
        X = finer.step(X, u)
    np.testing.assert_allclose(plant.step(x, u), X, atol=2e-4)
    assert finer.form.nw == plant.form.nw and plant.at(0.2) is plant


def test_a_slower_rate_takes_more_steps(swing):
    slow = swing.plant_.at(0.8)
    assert slow.form.nw == 4 * swing.plant_.form.nw
    x, u = np.array([[0.4, -0.3]]), np.array([[0.5]])
    X = x
    for _ in range(4):
        X = swing.plant_.step(X, u)
    np.testing.assert_allclose(slow.step(x, u), X, atol=1e-12)
    with pytest.raises(ValueError, match="`dt` must be a positive number"):
        swing.plant_.at(-1.0)


def test_a_file_keeps_a_model_in_continuous_time(swing, noisy, tmp_path):
    path = tmp_path / "model.alssnn"
    swing.save(path)
    again = alssnn.load(path)
    np.testing.assert_array_equal(again.predict(noisy[0]), swing.predict(noisy[0]))
    np.testing.assert_array_equal(again.A_, swing.A_)
    np.testing.assert_array_equal(
        again.plant_.at(0.1).form.Theta, swing.plant_.at(0.1).form.Theta
    )
    np.testing.assert_array_equal(
        pickle.loads(pickle.dumps(swing)).predict(noisy[0]), swing.predict(noisy[0])
    )


def test_a_fit_goes_on(swing, noisy):
    model = clone(swing).set_params(warm_start=True, max_iter=3)
    model.fit(*noisy)
    before, steps = model.cost_, model.n_iter_
    model.set_params(max_iter=40).fit(*noisy)
    assert model.cost_ <= before * (1 + 1e-9)
    assert model.history_[0].cost <= before * (1 + 1e-6)
    discrete = model.set_params(time="discrete").fit(*noisy)
    assert discrete.plant_.rates is None and steps > 0
    assert np.abs(np.linalg.eigvals(discrete.A_)).max() < 1


def test_what_judges_a_model_takes_its_hold():
    # a smooth input, measured: u goes on between the samples
    n, dt = 700, 0.25
    t = dt * np.arange(n)
    rng = np.random.default_rng(0)
    w = np.linspace(0.3, 5.0, 12)
    phase = rng.uniform(0, 6, 12)
    u = 0.08 * np.sin(np.outer(t, w) + phase).sum(axis=1)

    def plant(x, k, s):
        now = 0.08 * np.sin(w * (k + s) * dt + phase).sum()
        return np.array([x[1], 4 * now - 4 * np.sin(x[0]) - 0.8 * x[1]])

    x, y, h = np.zeros(2), np.empty(n), dt / 8
    for k in range(n):
        y[k] = x[0]
        for i in range(8):
            s = i / 8
            k1 = plant(x, k, s)
            k2 = plant(x + h / 2 * k1, k, s + 1 / 16)
            k3 = plant(x + h / 2 * k2, k, s + 1 / 16)
            k4 = plant(x + h * k3, k, s + 1 / 8)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    errors, options = {}, {"n_init": 1, "integrators": 0, "random_state": 0}
    for hold in HOLDS:
        # errors of the cubic are the smallest, and so is its decay
        options["alpha"] = 1e-8 if hold == "cubic" else 1e-6
        model = alssnn.FlSsnn(
            nx=2, n_h=3, dt=dt, time="continuous", hold=hold, **options
        ).fit(u[:500, None], y[:500])
        errors[hold] = np.sqrt(1 - model.score(u[500:, None], y[500:]))
    assert errors["cubic"] < 2e-3
    assert 5 * errors["cubic"] < errors["linear"] < errors["zoh"], errors
    # the last model is that of the cubic: all that judges it sees the same errors
    validation = model.validate(u[500:, None], y[500:])
    _, y_pred = model.simulate_test(u[500:, None], y[500:])
    assert validation["free run"].passed
    assert validation["predictions"].value > 99.5  # percent, as the free run
    ahead = model.predict_ahead(u[500:, None], y[500:], 5)
    assert np.std((ahead - y[500:])[30:]) < 4e-3 * np.std(y[500:])
    (prepared,) = model.prepare_records(u[500:, None], y[500:])
    assert prepared.u_s.shape == (200, 3) and prepared.du.shape == (200, 1)
    np.testing.assert_allclose(prepared.du[:, 0], u[500:] - model.u_offset_, atol=1e-12)
    y_hat = model.predict(u[500:, None], x0=prepared.x0)
    np.testing.assert_allclose(y_hat[prepared.scored], y_pred, atol=1e-12)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # what is no noise may look so
        covariance = model.parameter_covariance(u[500:, None], y[500:])
    np.testing.assert_allclose(
        np.sort(covariance.poles().poles), np.sort(np.linalg.eigvals(model.A_))
    )
    band = covariance.frequency_response([0.5, 2.0])
    expected = model.to_statespace()(1j * np.array([0.5, 2.0]))
    np.testing.assert_allclose(band.response[:, 0, 0], expected, rtol=1e-9)


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("kind", ["kalman", "ekf", "disturbance"])
def test_predictions_of_exact_outputs_are_exact_between_the_samples(noisy, kind, delay):
    """Nothing is corrected where the model says what was measured."""
    u, y = noisy
    options = {"input_delay": delay, "dt": 0.2, "time": "continuous", "hold": "cubic"}
    model = alssnn.LinearStateSpace(nx=2, **options).fit(u, y)
    exact = model.predict(u)
    observer = DisturbanceObserver(model)
    if kind != "disturbance":
        observer = model.observer(kind=kind)
    ahead = model.predict_ahead(u, exact, 3, observer=observer)
    np.testing.assert_allclose(ahead[3:], exact[3:], atol=1e-9 * np.std(y))
    assert ahead_fit(model, u, exact, horizons=[3]).fit[0, 0] > 99.9


def test_linear_models_of_several_inputs_and_experiments_with_gaps():
    A = np.array([[-0.5, 2.0, 0.0], [-2.0, -0.5, 0.3], [0.0, 0.0, -1.0]])
    B = np.array([[1.0, 0.0], [0.0, 0.5], [0.3, 1.0]])
    dt, rng = 0.2, np.random.default_rng(3)
    exact = control.sample_system(control.ss(A, B, C, 0), dt)
    us, ys = [], []
    for n in (400, 250):
        u = np.repeat(rng.standard_normal((n // 5 + 1, 2)), 5, axis=0)[:n]
        y = np.asarray(control.forced_response(exact, inputs=u.T).outputs).T
        y[rng.random(y.shape) < 0.1] = np.nan
        us.append(u)
        ys.append(y)
    model = alssnn.LinearStateSpace(nx=3, dt=dt, time="continuous", substeps=2)
    model.fit(us, ys)
    omega = np.array([0.3, 2.0, 6.0])
    np.testing.assert_allclose(
        model.to_statespace()(1j * omega),
        control.ss(A, B, C, 0)(1j * omega),
        rtol=5e-3,
        atol=1e-3,
    )
    assert model.score(us, ys) > 0.999


def test_held_out_samples_judge_it_too(noisy):
    model = alssnn.AlSsnn(
        nx=2,
        n_h=3,
        n_g=2,
        dt=0.2,
        time="continuous",
        hold="linear",
        alpha=1e-6,
        n_init=1,
        max_iter=15,
        validation_fraction=0.2,
        random_state=0,
    ).fit(*noisy)
    last = model.history_[-1]
    assert np.isfinite(last.validation_rmse) and model.score(*noisy) > 0.9


def test_a_training_that_went_wrong_gives_way_to_the_linear_model(noisy, monkeypatch):
    from alssnn.estimators import _time

    linear = alssnn.LinearStateSpace(nx=2, dt=0.2, time="continuous").fit(*noisy)
    trained = _time._trained

    def wrong(estimator, experiments, structure, theta, *rest):
        result = trained(estimator, experiments, structure, theta, *rest)
        if np.isfinite(estimator._decay["alpha"]):
            p = structure.split(result.theta)
            result.theta = structure.join({**p, "B": -5.0 * p["B"]})
        return result

    monkeypatch.setattr(_time, "_trained", wrong)
    model = alssnn.FlSsnn(
        nx=2, n_h=2, dt=0.2, time="continuous", n_init=1, max_iter=20, random_state=0
    )
    with pytest.warns(UserWarning, match="than the linear model, which is returned"):
        model.fit(*noisy)
    assert model.alpha_ == np.inf
    assert model.score(*noisy) > linear.score(*noisy) - 0.02


def test_a_loop_of_the_sampled_law(swing, noisy):
    measured = swing.linearizability(*noisy)
    assert np.isfinite(measured.closed_linearization_error).all()
    finer = swing.plant_.at(0.02)
    loop, slow = finer.close(), swing.plant_.close()
    assert loop.nx == slow.nx
    # at a fast rate h is cancelled nearly at once: the loop is nearly linear
    rng, errors = np.random.default_rng(0), []
    for plant, n in ((swing.plant_, 20), (finer, 200)):
        v = 0.3 * np.repeat(rng.uniform(-1, 1, 20), n // 20)[:, None]
        A, B, C_, _ = plant.linear()
        X = simulate(plant.close(), v - plant.v_offset, np.zeros(2))
        x, linear = np.zeros(2), []
        for value in v - plant.v_offset:
            linear.append(x)
            x = A @ x + B @ value
        errors.append(np.abs((X[:-1] - linear) @ C_.T).max())
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"time": "continuous"}, "`dt` must be given"),
        ({"time": "continuous", "dt": 0.1, "noise": "innovations"}, "`noise` must"),
        ({"time": "continuous", "dt": 0.1, "bounds": {"A": (0, 1)}}, "`bounds` must"),
        ({"hold": "cubic"}, "`hold` must be 'zoh' for time='discrete'"),
        ({"substeps": 2}, "`substeps` must be 1"),
        ({"time": "continuous", "dt": 0.1, "substeps": 0}, "substeps"),
    ],
)
def test_options_without_a_meaning_are_refused(options, message):
    u, y = swinging(0.1, 60)
    with pytest.raises(ValueError, match=message):
        alssnn.LinearStateSpace(nx=2, **options).fit(u, y)
    if "dt" not in options and "time" in options:  # one second is a sampling time
        alssnn.LinearStateSpace(nx=1, time="continuous", dt=1).fit(u, y)


def test_a_discrete_plant_has_one_rate():
    u, y = swinging(0.1, 100)
    model = alssnn.LinearStateSpace(nx=2, dt=0.1).fit(u, y)
    with pytest.raises(ValueError, match="time='continuous'"):
        model.plant_.at(0.2)
    with pytest.raises(ValueError, match="time='continuous'"):
        model.to_statespace(dt=0.2)
    assert model.to_statespace(dt=0.1).dt == 0.1


def test_poles_too_fast_for_a_step_are_told():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 1))
    fast = control.sample_system(control.tf([30], [1, 31, 30]), 0.1)
    y = np.ravel(control.forced_response(fast, inputs=u[:, 0]).outputs)
    with pytest.warns(UserWarning, match="`substeps` is raised from 1 to 3"):
        model = alssnn.LinearStateSpace(nx=2, dt=0.1, time="continuous").fit(u, y)
    assert model.score(u, y) > 0.99
    assert model.A_.shape == (2, 2) and model.fitted_.structure.sampling.substeps == 3


@pytest.mark.parametrize("pole", [-1.2 + 12j, -1.4 + 28j, -8.0 + 0j])
def test_rates_are_right_where_one_step_would_not_do(pole):
    dt, u = 0.1, steps(800, 4)[:, None]
    poles = [pole, pole.conjugate()] if pole.imag else [pole]
    plant = control.tf([np.abs(pole) ** len(poles)], np.poly(poles).real)
    exact = control.sample_system(plant, dt)
    y = np.ravel(control.forced_response(exact, inputs=u[:, 0]).outputs)
    model = alssnn.LinearStateSpace(nx=len(poles), dt=dt, time="continuous").fit(u, y)
    found = np.linalg.eigvals(model.A_)
    assert np.abs(found - pole).min() < 0.03 * np.abs(pole)


def test_slow_states_begin_where_the_discrete_model_says():
    rng = np.random.default_rng(1)
    u = 5.0 + np.repeat(rng.uniform(-1, 1, (75, 1)), 8, axis=0)
    slow = control.ss(control.tf([1.0], np.poly([-0.02, -1.0 + 2j, -1.0 - 2j])))
    exact = control.sample_system(slow, 0.2)
    y = np.ravel(control.forced_response(exact, inputs=u[:, 0]).outputs)
    misses = []
    for options in ({}, {"time": "continuous"}):
        model = alssnn.LinearStateSpace(nx=3, dt=0.2, **options).fit(u, y)
        y_hat = model.predict(u, x0="training")
        misses.append(np.std(y - y_hat) / y.std())
    assert misses[1] < 2 * misses[0] + 2e-3


def test_a_plant_that_was_changed_has_one_rate(swing):
    plant = swing.plant_
    for changed in (plant.linearized(), plant.with_disturbance("output")):
        with pytest.raises(ValueError, match="the plant was changed"):
            changed.at(0.1)
    for wrong in (0, -1.0, np.nan, np.inf, None, "a", True, [0.1]):
        with pytest.raises(ValueError, match="`dt` must be a positive number"):
            plant.at(wrong)
    with pytest.raises(ValueError, match="must be shorter"):
        plant.at(200.0)


def test_the_sampling_time_of_the_fit_stays(swing, noisy, tmp_path):
    model = pickle.loads(pickle.dumps(swing))
    A, step = model.A_, model.plant_.form.Theta
    model.set_params(dt=0.1, time="discrete", hold="cubic")
    again = pickle.loads(pickle.dumps(model))
    again._made = None  # as if nobody had asked for the plant before
    assert again.plant_.dt == 0.2
    np.testing.assert_array_equal(again.plant_.form.Theta, step)
    model.save(tmp_path / "model.alssnn")
    loaded = alssnn.load(tmp_path / "model.alssnn")
    np.testing.assert_array_equal(loaded.A_, A)
    np.testing.assert_array_equal(loaded.predict(noisy[0]), swing.predict(noisy[0]))


def test_a_frequency_response_is_not_finite_at_an_undamped_pole():
    A, B, C = [[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]]
    G = frequency_response(control.ss(A, B, C, 0), np.array([0.5, 1.0]) / np.pi / 2)
    assert G[0, 0, 0] == pytest.approx(1 / (1 - 0.25)) and not np.isfinite(G[1]).any()


def test_frequency_responses_are_those_of_the_loop(swing):
    f = np.array([0.1, 0.4])
    system = swing.to_statespace()
    expected = system(2j * np.pi * f)
    np.testing.assert_allclose(frequency_response(system, f)[:, 0, 0], expected)
    held_ = frequency_response(swing.to_statespace(dt=0.2), f)[:, 0, 0]
    assert np.abs(np.abs(held_ / expected) - 1).max() < 0.05


@pytest.mark.parametrize(
    ("hold", "words"),
    [("zoh", ""), ("cubic", "a cubic spline"), ("linear", "straight")],
)
def test_what_is_exported_says_that_it_holds_inputs(hold, words, tmp_path, capsys):
    """It does not follow a record whose inputs went on, as `predict` does."""
    t = 0.3 * np.arange(400)
    u = np.sin(t) + np.sin(1.9 * t + 1)
    options = {"nx": 2, "time": "continuous", "hold": hold, "dt": 0.3}
    y = lsim(([1.0], [1.0, 0.5, 1.0]), u, t)[1]
    model = alssnn.LinearStateSpace(integrators=0, **options).fit(u, y)
    if hold != "zoh":
        plant, x, held = model.plant_, model.x0_[0], np.empty(len(u))
        for k in range(len(u)):
            held[k], x = plant.output(x)[0], plant.step(x, u[[k]])
        errors = model.predict(u, x0="training") - y, held - y
        assert np.std(errors[1]) > 5 * np.std(errors[0])
    model.to_c(tmp_path)
    model.to_st(tmp_path / "plant.st")
    model.to_modelica(tmp_path / "Plant.mo")
    model.to_mat(tmp_path / "plant.mat")
    model.to_simulink(tmp_path / "diagram")
    fmu = model.to_fmu(tmp_path / "plant.fmu")
    with zipfile.ZipFile(fmu.path) as archive:
        described = archive.read("modelDescription.xml").decode()
    said = [(tmp_path / name).read_text() for name in ("plant.st", "Plant.mo")]
    said += [(tmp_path / name).read_text() for name in ("README.md", "plant.h")]
    said.append((tmp_path / "diagram" / "build_plant.m").read_text())
    for matrices in (tmp_path / "plant.mat", tmp_path / "diagram" / "plant.mat"):
        said.append(str(loadmat(matrices)["model"]["hold"].item().item()))
        assert said[-1].startswith("u is held for a sample")
    for text in [*said, described]:
        assert ("went on" in text) == bool(words) and words in text
    model.save(tmp_path / "model.npz")
    capsys.readouterr()
    cli.main(["info", str(tmp_path / "model.npz")])
    assert ("exports hold u" in capsys.readouterr().out) == bool(words)


@pytest.mark.usefixtures("undrawn", "rough_certificates")
def test_a_report_says_the_equations_of_derivatives(swing, noisy, tmp_path):
    path = tmp_path / "report.html"
    u, y = noisy
    swing.report(path, u[:200], y[:200])
    text = path.read_text(encoding="utf-8")
    assert "x&#x27; = A x + B" in text and "per second" in text
    assert "Poles of A: " in text
    assert "spectral radius of sampled A" in text  # not of the A that is printed
    figures = swing.linearizability(u[:200], y[:200], in_loop=False)
    assert "\nspectral radius of sampled A  " in repr(figures)


def test_experiments_of_one_sample_do_no_harm(noisy):
    u, y = noisy
    model = alssnn.FlSsnn(
        nx=2, n_h=2, dt=0.2, time="continuous", n_init=1, max_iter=5, random_state=0
    ).fit([u[:300], u[300:301]], [y[:300], y[300:301]])
    assert np.isfinite(model.cost_)


def test_late_inputs(noisy):
    u, y = noisy
    late = np.vstack([u[3:], u[-3:]])  # what is sent now arrives three samples later
    model = alssnn.LinearStateSpace(nx=2, dt=0.2, time="continuous", input_delay=3).fit(
        late, y
    )
    with pytest.raises(ValueError, match="arrive late"):
        model.to_statespace()
    assert len(model.to_statespace(dt=0.2).A) == 5
    assert model.plant_.at(0.1).delay.tolist() == [6]
    with pytest.raises(ValueError, match="must divide the delays"):
        model.plant_.at(0.35)


def test_the_benchmark_times_all_passes():
    rows = list(steps_of_training(quick=True))
    assert [row[:3] for row in rows[:3]] == [
        ("FL", "zoh", "1"),
        ("FL", "cubic", "1"),
        ("FL", "zoh", "2"),
    ]
    assert len(rows) == 9 and all(float(row[3]) > 0 for row in rows)


def test_tables_of_other_studies_stay(tmp_path):
    path = tmp_path / "continuous.md"
    keep(path, "step", ["| a |", "|---|", "| 1 |"])
    keep(path, "rates", ["| b |", "|---|", "| 2 |"])
    keep(path, "step", ["| a |", "|---|", "| 3 |"])
    text = path.read_text()
    assert text.index("## rates") < text.index("## step")
    assert "| 2 |" in text and "| 3 |" in text and "| 1 |" not in text


def test_refits_are_not_held_to_the_contraction_of_the_discrete_model(rng):
    """A per second may have any norm, where that of the discrete model is below 1."""
    u, x, y = np.repeat(rng.standard_normal(120), 5), np.zeros(2), np.zeros(600)
    for k in range(600):
        y[k] = x.sum() + 0.005 * rng.standard_normal()
        moved = u[k] - 0.3 * np.sin(x.sum())
        x = np.array([0.2, 0.8]) * x + np.array([0.4, 0.2]) * moved
    options = {"gamma_h": 1e-4, "alpha": 1e-6, "n_init": 1, "random_state": 0}
    model = alssnn.FlSsnn(nx=2, n_h=3, time="continuous", dt=0.1, **options).fit(u, y)
    covariance = model.parameter_covariance(u, y)
    (drawn,) = model.sample_models(covariance, 1, random_state=0, data=(u, y))
    assert np.linalg.norm(drawn.A_ * model.dt, 2) > 1
    assert 0 < np.std(drawn.predict(u) - model.predict(u)) < 0.05 * np.std(y)


def test_a_sampling_time_of_one_second_is_one_that_was_given(rng):
    u = rng.standard_normal(100)
    y = np.convolve(u, 0.5 ** np.arange(20))[:100]
    options = {"nx": 1, "time": "continuous"}
    given = alssnn.LinearStateSpace(dt=np.float64(1.0), **options).fit(u, y)
    assert given.A_ == alssnn.LinearStateSpace(dt=1, **options).fit(u, y).A_
    with pytest.raises(ValueError, match="write dt=1"):
        alssnn.LinearStateSpace(**options).fit(u, y)


def test_a_model_in_continuous_time_is_no_discrete_start(swing, noisy):
    """Its A and B are by seconds."""
    start = FrozenEstimator(swing)
    model = LinearStateSpace(linear_start=start, dt=swing.dt)
    with pytest.raises(ValueError, match=r"sampling time dt=.*control.sample_system"):
        model.fit(*noisy)


@pytest.mark.parametrize("stability", ["contractive", "schur"])
def test_poles_decay_as_fast_as_is_asked_for(swing, noisy, stability):
    """The limit of a discrete pole is that of exp(A dt)."""
    model = clone(swing).set_params(phi=0.3, stability=stability, max_iter=10)
    model.fit(*noisy)
    slowest = np.linalg.eigvals(model.A_).real.max()
    assert np.exp(slowest * model.dt) <= np.sqrt(0.7) * (1 + 1e-9)
    free = np.exp(np.linalg.eigvals(swing.A_).real.max() * swing.dt)
    assert free > np.sqrt(0.7)  # else nothing was asked for
    warm = clone(swing).set_params(max_iter=2, warm_start=True).fit(*noisy)
    warm.set_params(phi=0.3, stability=stability, max_iter=10).fit(*noisy)
    slowest = np.linalg.eigvals(warm.A_).real.max()
    assert np.exp(slowest * warm.dt) <= np.sqrt(0.7) * (1 + 1e-9)

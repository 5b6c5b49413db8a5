"""What doc/extending.rst promises: a package extended from outside, in few lines.

The members between the markers are shown in the manual; the tests keep them alive.
"""

import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

import alssnn
from alssnn import Activation
from alssnn.certificates import iss_margin
from alssnn.criterion import Criterion
from alssnn.datasets import Record
from alssnn.equations import Equations, diagonal
from alssnn.estimators import Networks, Ssnn, estimator, option, take
from alssnn.kernels import differentiate
from alssnn.metrics import rmse
from alssnn.optimizers import minimize
from alssnn.simulation import channels, simulate
from alssnn.starts import initial_theta
from alssnn.subspace import LinearModel, identify_linear
from alssnn.training import train
from helpers import assert_jacobian, dense_jacobian, dense_residuals
from models import fl_ssnn, gr_ssnn

DOC = Path(__file__).parents[1] / "doc"


def hammerstein(nx, nu, ny, *, n_f, C=None, activation="tanh"):
    """Return x+ = A x + B (u + f(u)), y = C x, with a network f, f(0) = 0."""
    e = Equations(x=nx, u=nu, y=ny)
    x, u = e.state("x"), e.input("u")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    C = e.parameter("C", "y", "x") if C is None else e.constant("C", C, "y", "x")
    f = e.mlp("f", "u", n_f, {"W_v": u}, biases="tied", activation=activation)
    return e.structure({"x": A @ x + B @ (u + f)}, {"y": C @ x})


def wiener(nx, nu, ny, *, n_f, C):
    """Return x+ = A x + B u, y = C x + f(C x), with a network f, f(0) = 0."""
    e = Equations(x=nx, u=nu, y=ny)
    x, u = e.state("x"), e.input("u")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    z = e.constant("C", C, "y", "x") @ x
    f = e.mlp("f", "y", n_f, {"W_z": z}, biases="tied")
    return e.structure({"x": A @ x + B @ u}, {"y": z + f})


def monotone(nx, nu, ny, *, n_h, C):
    """Return x+ = A x + B v, v = u + W_h sigma(diag(lambda) W_h' u + W_s x + b_s)."""
    e = Equations(x=nx, u=nu, y=ny, w_h=n_h)
    x, u = e.state("x"), e.input("u")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    W_h, W_s = e.weights("W_h", "u", "w_h"), e.weights("W_s", "w_h", "x")
    scale, b_s = e.weights("lambda", "w_h"), e.weights("b_s", "w_h")
    w = e.neurons("w_h", diagonal(scale) @ W_h.T @ u + W_s @ x + b_s)
    v = e.signal("v", u + W_h @ w)
    y = e.constant("C", C, "y", "x") @ x
    return e.structure({"x": A @ x + B @ v}, {"y": y})


def innovations(nx, nu, ny, *, n_h, C):
    """Return x+ = A x + B (u + h(y_m)) + K (y_m - y), y = C x, with y_m measured."""
    e = Equations(x=nx, u=nu, y=ny, y_m=ny)
    x, u, y_m = e.state("x"), e.input("u"), e.input("y_m")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    K = e.parameter("K", "x", "y")
    y = e.signal("y", e.constant("C", C, "y", "x") @ x)
    v = e.signal("v", u + e.mlp("h", "u", n_h, {"W_y": y_m}))
    return e.structure({"x": A @ x + B @ v + K @ (y_m - y)}, ["y"])


def runge_kutta(nx, nu, ny, *, n_g, C, dt):
    """Return one step of x' = f(x, u) = A x + B u + W_g sigma(W_x x + b_x)."""
    e = Equations(x=nx, u=nu, y=ny, w=n_g)
    x, u = e.state("x"), e.input("u")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    W_g, W_x = e.weights("W_g", "x", "w"), e.weights("W_x", "w", "x")
    b_x = e.weights("b_x", "w")

    def f(stage, x):  # neurons of its own, weights that all stages share
        w = e.neurons(f"w_{stage}", W_x @ x + b_x)
        return e.signal(f"f_{stage}", A @ x + B @ u + W_g @ w)

    f_1 = f(1, x)
    f_2 = f(2, x + dt / 2 * f_1)
    f_3 = f(3, x + dt / 2 * f_2)
    f_4 = f(4, x + dt * f_3)
    y = e.constant("C", C, "y", "x") @ x
    return e.structure({"x": x + dt / 6 * (f_1 + 2 * f_2 + 2 * f_3 + f_4)}, {"y": y})


@estimator
class HammersteinSsnn(Ssnn):
    """A static nonlinearity at the input of a linear system.

    Parameters
    ----------
    n_f : int, default=6
        Neurons of the nonlinearity.
    """

    n_f: int = option(6, [int], kw_only=False)
    activation: object = take(Networks, "activation")

    def _networks(self):
        return {"n_f": self.n_f, "activation": self.activation}

    def _declare(self, nx, nu, ny, *, n_f, C, activation, **_):
        return hammerstein(nx, nu, ny, n_f=n_f, C=C, activation=activation)


def loaded(nx, nu, nd, ny, *, n_h, C):
    """Return x+ = A x + B (u + h(y, d)) + G d, y = C x, with d measured."""
    e = Equations(x=nx, u=nu, d=nd, y=ny)
    x, u, d = e.state("x"), e.input("u"), e.input("d")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    G = e.parameter("G", "x", "d")
    y = e.signal("y", e.constant("C", C, "y", "x") @ x)
    v = e.signal("v", u + e.mlp("h", "u", n_h, {"W_y": y, "W_d": d}))
    return e.structure({"x": A @ x + B @ v + G @ d}, ["y"])


@estimator
class LoadedSsnn(Ssnn):
    """A law that sees the output and the last columns of u, measured disturbances.

    Parameters
    ----------
    n_h : int, default=6
        Neurons of the law.
    """

    n_h: int = option(6, [int], kw_only=False)

    def _networks(self):
        return {"n_h": self.n_h}

    def _declare(self, nx, nu, ny, *, n_h, C, **_):
        nd = len(self.disturbances_)
        return loaded(nx, nu - nd, nd, ny, n_h=n_h, C=C)


SOFTSIGN = Activation(
    "softsign",
    lambda v: v / (1 + np.sqrt(v * v)),  # not abs: analytic, for complex steps
    lambda v, w: 1 / (1 + np.sqrt(v * v)) ** 2,
    slope=(0, 1),
    bound=1,
    odd=True,
    expressions={  # for exports
        "c": "{v} / (1.0{f} + fabs{f}({v}))",
        "casadi": "{v} / (1 + fabs({v}))",
        "matlab": "{v} ./ (1 + abs({v}))",
        "modelica": "{v} / (1.0 + abs({v}))",
        "onnx": "Softsign",
        "st": "{v} / ({t}1.0 + ABS({v}))",
    },
)


def gauss_newton(criterion, free, n_steps):
    """Minimize any `LeastSquares` by damped Gauss-Newton steps."""
    damping = 1e-3
    for _ in range(n_steps):
        JJ, Jr, norm = criterion.normal_equations(free)
        step = np.linalg.solve(JJ + damping * np.diag(np.diag(JJ) + 1e-12), -Jr)
        better = criterion.norm(free + step) < norm
        free = free + step if better else free
        damping *= 0.3 if better else 10.0
    return free


def decay_certificate(A):
    """Return P and phi of V+ <= (1 - phi) V for the free motion of x+ = A x."""
    P = solve_discrete_lyapunov(A.T, np.eye(len(A)))  # A'PA - P = -I
    return P, 0.999 / np.linalg.eigvalsh(P)[-1]


def make_saturated_filter(n_samples, *, random_state=None):
    """Return a record of two inputs, saturated, into two outputs of a linear system."""
    rng = np.random.default_rng(random_state)
    u = 2 * rng.standard_normal((n_samples, 2))
    A = np.array([[0.7, 0.2], [-0.2, 0.7]])
    B = np.array([[1.0, 0.3], [0.0, 1.0]])
    X = np.zeros((n_samples, 2))
    for k in range(n_samples - 1):
        X[k + 1] = A @ X[k] + B @ np.tanh(u[k])
    y = X @ np.array([[1.0, 0.5], [0.2, 1.0]]) + 0.02 * rng.standard_normal((len(X), 2))
    return Record(u, y, 0.1, "saturated filter")


# -- the structure ---------------------------------------------------------------------

C = np.array([[1.0, 0.5], [0.2, 1.0], [0.0, 1.0]])
DT = 0.3
DECLARED = {
    "hammerstein, C free": lambda: hammerstein(2, 2, 3, n_f=4),
    "hammerstein": lambda: hammerstein(2, 2, 3, n_f=(4, 2), C=C, activation=SOFTSIGN),
    "wiener": lambda: wiener(2, 2, 3, n_f=4, C=C),
    "monotone": lambda: monotone(2, 2, 3, n_h=4, C=C),
    "innovations": lambda: innovations(2, 2, 3, n_h=4, C=C),
    "runge-kutta": lambda: runge_kutta(2, 2, 3, n_g=4, C=C, dt=DT),
}


@pytest.fixture(params=DECLARED, ids=str)
def declared(request, rng):
    structure = DECLARED[request.param]()
    return structure, 0.4 * rng.standard_normal(structure.n_params)


@pytest.mark.parametrize("plain", [False, True], ids=["compiled", "plain"])
def test_derivative_of_a_declared_structure(declared, rng, plain, monkeypatch):
    if plain:
        monkeypatch.setattr("alssnn.sensitivities.differentiate", differentiate.plain)
    structure, theta = declared
    experiments = [
        (rng.standard_normal((n, structure.nu)), rng.standard_normal((n, 3)))
        for n in (12, 19)
    ]
    criterion = Criterion(structure, experiments, alpha=0.01)
    free = criterion.join(theta, rng.standard_normal((2, 2)))
    assert_jacobian(
        partial(dense_residuals, criterion),
        dense_jacobian(criterion, free),
        free,
        rtol=1e-12,
    )
    JJ, Jr, norm = criterion.normal_equations(free)
    J, r = dense_jacobian(criterion, free), dense_residuals(criterion, free)
    np.testing.assert_allclose(JJ, J.T @ J, atol=1e-12 * np.abs(JJ).max())
    np.testing.assert_allclose(Jr, J.T @ r, atol=1e-12 * np.abs(Jr).max())
    assert norm == pytest.approx(np.linalg.norm(r), rel=1e-12)


def simulate_declared(structure, theta, rng):
    """Return inputs, states and outputs of a structure from x = 0."""
    u, lure = rng.standard_normal((10, structure.nu)), structure.lure(theta)
    X = simulate(lure, u, np.zeros(2))
    return u, X, channels(lure, X, u)


def follow(X, step):
    """Check the states against an equation."""
    x = np.zeros(2)
    for k in range(10):
        np.testing.assert_allclose(X[k], x, atol=1e-13)
        x = step(k, x)


def test_hammerstein_is_its_equation(rng):
    structure = hammerstein(2, 2, 2, n_f=3)
    theta = 0.4 * rng.standard_normal(structure.n_params)
    u, X, _ = simulate_declared(structure, theta, rng)
    p = structure.split(theta)

    def step(k, x):
        f = p["W_f"] @ (np.tanh(p["W_v"] @ u[k] + p["b_f1"]) - np.tanh(p["b_f1"]))
        return p["A"] @ x + p["B"] @ (u[k] + f)

    follow(X, step)


def test_wiener_is_its_equation(rng):
    structure = wiener(2, 2, 3, n_f=3, C=C)
    theta = 0.4 * rng.standard_normal(structure.n_params)
    u, X, Y = simulate_declared(structure, theta, rng)
    p, z = structure.split(theta), X[:-1] @ C.T
    follow(X, lambda k, x: p["A"] @ x + p["B"] @ u[k])
    f = (np.tanh(z @ p["W_z"].T + p["b_f1"]) - np.tanh(p["b_f1"])) @ p["W_f"].T
    np.testing.assert_allclose(Y, z + f, atol=1e-13)


def test_a_law_that_sees_the_input_is_its_equation_and_monotone(rng):
    structure = monotone(2, 2, 3, n_h=4, C=C)
    theta = 0.4 * rng.standard_normal(structure.n_params)
    p = structure.split(theta)
    p["lambda"][:] = np.abs(p["lambda"])  # a view of theta
    u, X, _ = simulate_declared(structure, theta, rng)

    def phi(u, x):
        inner = p["lambda"] * (p["W_h"].T @ u) + p["W_s"] @ x + p["b_s"]
        return u + p["W_h"] @ np.tanh(inner)

    follow(X, lambda k, x: p["A"] @ x + p["B"] @ phi(u[k], x))
    law = structure.law()
    assert law.inputs == ("x", "u")
    xu = np.hstack([X[:-1], u])
    v = channels(law.lure(law.join(p)), np.empty((10, 0)), xu)
    expected = [phi(u_k, x) for u_k, x in zip(u, X[:-1], strict=True)]
    np.testing.assert_allclose(v, expected, atol=1e-14)
    for k in range(9):
        assert (v[k + 1] - phi(u[k], X[k + 1])) @ (du := u[k + 1] - u[k]) >= du @ du


def test_innovations_are_their_equation(rng):
    structure = innovations(2, 2, 3, n_h=3, C=C)
    theta = 0.3 * rng.standard_normal(structure.n_params)
    uy, X, _ = simulate_declared(structure, theta, rng)
    p, (u, y) = structure.split(theta), np.split(uy, [2], axis=1)

    def step(k, x):
        h = p["W_h"] @ np.tanh(p["W_y"] @ y[k] + p["b_h1"]) + p["b_h"]
        return p["A"] @ x + p["B"] @ (u[k] + h) + p["K"] @ (y[k] - C @ x)

    follow(X, step)
    assert structure.law().inputs == ("y_m", "u")


def test_runge_kutta_is_its_equation(rng):
    structure = runge_kutta(2, 2, 3, n_g=3, C=C, dt=DT)
    theta = 0.4 * rng.standard_normal(structure.n_params)
    u, X, _ = simulate_declared(structure, theta, rng)
    p = structure.split(theta)
    assert structure.nw == 12

    def step(k, x):
        def f(x):
            g = p["W_g"] @ np.tanh(p["W_x"] @ x + p["b_x"])
            return p["A"] @ x + p["B"] @ u[k] + g

        f_1 = f(x)
        f_2 = f(x + DT / 2 * f_1)
        f_3 = f(x + DT / 2 * f_2)
        return x + DT / 6 * (f_1 + 2 * f_2 + 2 * f_3 + f(x + DT * f_3))

    follow(X, step)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("fixed", [True, False], ids=["C fixed", "C free"])
def test_declared_structure_trains(fixed, named):
    record = make_saturated_filter(400, random_state=0)
    scaled = [((record.u / record.u.std(0)), record.y / record.y.std(0))]
    linear = identify_linear(scaled, 2)
    structure = hammerstein(2, 2, 2, n_f=6, C=linear.C if fixed else None)
    if not named:  # axes without an activation have tanh
        structure = replace(structure, activations={})
    theta = initial_theta(structure, linear, scaled, np.random.default_rng(0))
    start = Criterion(structure, scaled)
    free = start.join(theta, linear.x0)
    p = structure.split(theta)
    np.testing.assert_array_equal(p["A"], linear.A)  # the start is the linear model
    result = train(structure, scaled, [theta], max_iter=60)
    assert np.sqrt(result.cost) < 0.1 * start.norm(free)
    again = minimize(start, free, max_iter=60)
    assert np.sqrt(again.cost) < 0.1 * start.norm(free)


@pytest.mark.parametrize("name", [name for name in DECLARED if "free" not in name])
def test_a_start_of_any_structure_is_linear_with_neurons_that_are_spread(name, rng):
    structure = DECLARED[name]()
    nu, A = structure.nu, np.array([[-0.3, 0.2], [-0.2, -0.3]])
    linear = LinearModel(A, np.eye(2), C, np.zeros((3, nu)), np.zeros((1, 2)))
    u, y = rng.standard_normal((300, nu)), rng.standard_normal((300, 3))
    p = structure.split(initial_theta(structure, linear, [(u, y)], rng))
    lure = structure.lure(structure.join(p))
    assert not lure.W.any()
    assert lure.V.any() and lure.b.all()
    if name == "monotone":
        assert not p["lambda"].any()
    if name == "runge-kutta":
        np.testing.assert_array_equal(*np.split(lure.b, 2))


# -- the estimator ---------------------------------------------------------------------


@pytest.mark.parametrize("activation", ["tanh", SOFTSIGN], ids=["tanh", "softsign"])
def test_estimator_of_a_declared_structure(activation, tmp_path):
    train_runs = [make_saturated_filter(300, random_state=i) for i in (0, 1)]
    test = make_saturated_filter(300, random_state=2)
    options = {"alpha": 0.0, "max_iter": 100, "tol": 1e-3, "n_init": 1}
    model = HammersteinSsnn(
        2, 8, activation=activation, operating_point="zero", dt=0.1, **options
    )
    model.set_params(random_state=0).fit(*zip(*train_runs, strict=True))
    assert model.x0_.shape == (2, 2)
    error = rmse(*model.simulate_test(*test))
    linear = fl_ssnn(2, 0, operating_point="zero", dt=0.1).fit(
        *zip(*train_runs, strict=True)
    )
    assert error < 0.2 * rmse(*linear.simulate_test(*test))
    assert model.to_statespace().dt == 0.1
    record = model.linearizability(*test)
    assert np.all(record.linearization_error > 0.05)  # f is not cancelled by a law
    with pytest.raises(ValueError, match="n_f"):
        HammersteinSsnn(n_f="many").fit(*test)
    if activation == "tanh":  # a file holds no code
        path = tmp_path / "model.npz"
        model.save(path)
        with pytest.raises(ValueError, match="got 'HammersteinSsnn'"):
            alssnn.load(path)
        again = alssnn.load(path, classes=[HammersteinSsnn])
        x, u = np.ones(2), np.ones(2)
        np.testing.assert_array_equal(again.plant_.step(x, u), model.plant_.step(x, u))
        assert again.score(*test) == model.score(*test)


@pytest.fixture(scope="module")
def loaded_record():
    """A linear system of two inputs and a disturbance of other units, law included."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 3)) * [1.0, 50.0, 0.02]
    y = np.zeros((400, 2))
    for k in range(399):
        s = u[k] / [1.0, 50.0, 0.02]
        v = s[:2] + 0.5 * np.tanh(2 * y[k] + s[2])
        y[k + 1] = 0.5 * y[k] + v + [0.3 * s[2], -0.1 * s[2]]
    return u, y + 0.01 * rng.standard_normal(y.shape)


def test_further_inputs_of_a_declared_structure_are_disturbances(
    loaded_record, tmp_path
):
    """The model is, with its units, that of the shipped structure."""
    u, y = loaded_record
    options = {"alpha": 1e-3, "disturbances": [2], "random_state": 0}
    model = LoadedSsnn(nx=2, n_h=3, **options)
    options_of_ours = {"feedback": "output", "linear_part": "trained"}
    shipped = alssnn.FlSsnn(nx=2, n_h=3, **options_of_ours, **options)
    model.fit(u, y)
    shipped.fit(u, y)
    assert model.B_.shape == (2, 2) and model.G_.shape == (2, 1)
    for name in ("A_", "B_", "G_", "C_"):
        expected = getattr(shipped, name)
        np.testing.assert_allclose(getattr(model, name), expected, rtol=1e-6)
    laws = [m.linearizing_law()(u[0, :2], y[0], u[0, 2:]) for m in (model, shipped)]
    np.testing.assert_allclose(*laws, rtol=1e-6)
    bands = [
        m.parameter_covariance(u, y).frequency_response() for m in (model, shipped)
    ]
    np.testing.assert_allclose(*[b.magnitude_std for b in bands], rtol=1e-4)
    model.save(tmp_path / "model")
    again = alssnn.load(tmp_path / "model", classes=[LoadedSsnn])
    np.testing.assert_array_equal(again.predict(u), model.predict(u))
    np.testing.assert_array_equal(again.disturbances_, [2])
    n_iter, A = model.n_iter_, model.A_
    model.set_params(warm_start=True).fit(u, y)
    assert model.n_iter_ < n_iter / 2
    np.testing.assert_allclose(model.A_, A, atol=1e-3)


@pytest.mark.parametrize(
    ("cls", "given", "found"),
    [
        (LoadedSsnn, [0], r"\[0\] where it leaves \[2\]"),
        (HammersteinSsnn, [2], r"\[\]"),
    ],
)
def test_disturbances_that_a_structure_does_not_know(loaded_record, cls, given, found):
    model = cls(2, disturbances=given, random_state=0)
    with pytest.raises(ValueError, match=f"{found}.*input behind .*last columns of u"):
        model.fit(*loaded_record)


# -- optimizer, certificate, activation ------------------------------------------------


def test_an_optimizer_needs_the_criterion_alone(rng):
    record = make_saturated_filter(300, random_state=0)
    pairs = [(record.u / record.u.std(0), record.y / record.y.std(0))]
    linear = identify_linear(pairs, 2)
    structure = hammerstein(2, 2, 2, n_f=4, C=linear.C)
    theta = initial_theta(structure, linear, pairs, np.random.default_rng(0))
    criterion = Criterion(structure, pairs, alpha=1e-4)
    free = criterion.join(theta, linear.x0)
    ours = criterion.norm(gauss_newton(criterion, free, 60))
    shipped = np.sqrt(minimize(criterion, free, max_iter=60).cost)
    assert ours < 0.3 * criterion.norm(free)
    assert ours < 1.5 * shipped


def test_a_certificate_is_checked_by_numbers_and_by_simulation(rng):
    A = np.array([[0.7, 1.2], [-0.2, 0.7]])
    P, phi = decay_certificate(A)
    assert iss_margin(A, P, phi, 1e9) > 0  # without a disturbance psi is free
    assert iss_margin(A, P, 2 * phi, 1e9) < 0
    x = rng.standard_normal((1000, 2))
    V, after = (np.sum(z @ P * z, axis=1) for z in (x, x @ A.T))
    assert np.all(after <= (1 - phi) * V)


def test_an_activation_of_the_user_works_in_shipped_models():
    record = make_saturated_filter(200, random_state=0)
    model = gr_ssnn(2, 4, activation=SOFTSIGN, tol=1e-2, random_state=0)
    model.fit(*record)
    assert np.isfinite(model.predict(record.u)).all()
    assert model._structure.sigma == (SOFTSIGN,) * 4


# -- the page --------------------------------------------------------------------------

PAGE = (DOC / "extending.rst").read_text(encoding="utf-8")
INCLUDES = re.findall(
    r"^\.\. literalinclude:: (\S+)\n((?:   :.*\n)*)", PAGE, re.MULTILINE
)


@pytest.mark.parametrize(("target", "options"), INCLUDES)
def test_the_page_shows_code_that_exists(target, options):
    source = (DOC / target).read_text(encoding="utf-8")
    options = dict(re.findall(r":([\w-]+): (.*)", options))
    assert {"pyobject", "start-at"} & set(options)
    if "pyobject" in options:
        name = options["pyobject"].split(".")[-1]
        assert re.search(rf"^ *(?:def|class) {name}\b", source, re.MULTILINE)
    for marker in ("start-at", "end-before"):
        if marker in options:
            assert options[marker] in source


def test_the_page_names_files_that_exist():
    names = re.findall(r"``((?:alssnn|doc|tests)/[\w/]+\.\w+)``", PAGE)
    assert len(names) > 8 and len(INCLUDES) > 7
    for name in names:
        assert (DOC.parent / name).exists(), name
    index = (DOC / "index.rst").read_text(encoding="utf-8")
    assert "\n   extending\n" in index

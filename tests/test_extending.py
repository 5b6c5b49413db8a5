"""What doc/extending.rst promises: a package extended from outside, in few lines.

The members between the markers are shown in the manual; the tests keep them alive.
"""

import re
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from alssnn import Activation
from alssnn.activations import as_activation
from alssnn.certificates import iss_margin
from alssnn.criterion import Criterion
from alssnn.datasets import Record
from alssnn.estimators import Ssnn
from alssnn.metrics import rmse
from alssnn.networks import AtRest, Term
from alssnn.optimizers import minimize
from alssnn.simulation import simulate
from alssnn.structures import Structure
from alssnn.subspace import identify_linear
from alssnn.training import initial_theta, train
from helpers import assert_jacobian
from models import fl_ssnn, gr_ssnn

DOC = Path(__file__).parents[1] / "doc"


def hammerstein_structure(nx, nu, ny, *, n_f, C=None, activation="tanh"):
    """Return x+ = A x + B (u + f(u)), y = C x, with a network f, f(0) = 0."""
    sigma = as_activation(activation)
    at_rest = AtRest((("W_v", "b_v"),), sigma)
    parameters = {"A": ("x", "x"), "B": ("x", "u")}
    constants = {} if C is None else {"C": np.asarray(C)}
    if C is None:
        parameters["C"] = ("y", "x")
    return Structure(
        sizes={"x": nx, "u": nu, "y": ny, "w_f": n_f},
        states=("x",),
        channels=("y",),
        neurons=("w_f",),
        parameters=parameters
        | {"W_f": ("u", "w_f"), "W_v": ("w_f", "u"), "b_v": ("w_f",)},
        terms=(
            Term("x", "x", ("A",)),
            Term("x", "u", ("B",)),
            Term("y", "x", ("C",)),
            Term("w_f", "u", ("W_v",)),
            Term("w_f", "1", ("b_v",)),
            Term("x", "w_f", ("B", "W_f")),  # a product: no derivative to write
            Term("x", "1", ("B", "W_f", at_rest)),
        ),
        constants=constants,
        constant_axes=dict.fromkeys(constants, ("y", "x")),
        network_parameters=("W_f", "W_v", "b_v"),
        activations={"w_f": sigma},
    )


class HammersteinSsnn(Ssnn):
    """A static nonlinearity at the input of a linear system."""

    _parameter_constraints: ClassVar[dict] = {
        **Ssnn._parameter_constraints,
        "n_f": [int],
        "activation": "no_validation",
    }

    def __init__(self, nx=2, n_f=6, *, activation="tanh", dt=1.0, random_state=None):
        self.nx = nx
        self.n_f = n_f
        self.activation = activation
        self.dt = dt
        self.random_state = random_state

    # what this model does not let its user choose
    alpha, max_iter, tol, polish_iter, coarse_samples = 0.0, 100, 1e-3, 20, None
    n_init, n_jobs, method, warm_start, n_init_samples = 1, None, "lm", False, 20
    input_delay, output_weight, linear_start, bounds = 0, None, None, None
    operating_point, initial_state, verbose = "zero", "estimate", 0
    max_time, validation_fraction, n_iter_no_change = None, None, 20

    def _networks(self):
        return {"n_f": self.n_f, "activation": self.activation}

    def _declare(self, nx, nu, ny, *, n_f, C, activation, **_):
        return hammerstein_structure(nx, nu, ny, n_f=n_f, C=C, activation=activation)


SOFTSIGN = Activation(
    "softsign",
    lambda v: v / (1 + np.sqrt(v * v)),  # not abs: analytic, for complex steps
    lambda v, w: 1 / (1 + np.sqrt(v * v)) ** 2,
    slope=(0, 1),
    bound=1,
    odd=True,
    expressions={  # for exports
        "c": "{v} / (1.0{f} + fabs{f}({v}))",
        "matlab": "{v} ./ (1 + abs({v}))",
        "onnx": "Softsign",
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


@pytest.mark.parametrize("activation", ["tanh", SOFTSIGN], ids=["tanh", "softsign"])
@pytest.mark.parametrize("C", [None, np.array([[1.0, 0.5], [0.2, 1.0], [0.0, 1.0]])])
def test_derivative_of_a_declared_structure(activation, C, rng):
    structure = hammerstein_structure(2, 2, 3, n_f=4, C=C, activation=activation)
    theta = 0.4 * rng.standard_normal(structure.n_params)
    experiments = [
        (rng.standard_normal((n, 2)), rng.standard_normal((n, 3))) for n in (12, 19)
    ]
    criterion = Criterion(structure, experiments, alpha=0.01)
    free = criterion.join(theta, rng.standard_normal((2, 2)))
    assert_jacobian(criterion.residuals, criterion.jacobian(free), free)


def test_declared_structure_is_its_equation(rng):
    structure = hammerstein_structure(2, 2, 2, n_f=3)
    theta = 0.4 * rng.standard_normal(structure.n_params)
    p, u = structure.split(theta), rng.standard_normal((10, 2))
    x = np.zeros(2)
    X = simulate(structure.lure(theta), u, x)
    for k in range(10):
        np.testing.assert_allclose(X[k], x, atol=1e-14)
        f = p["W_f"] @ (np.tanh(p["W_v"] @ u[k] + p["b_v"]) - np.tanh(p["b_v"]))
        x = p["A"] @ x + p["B"] @ (u[k] + f)


@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("fixed", [True, False], ids=["C fixed", "C free"])
def test_declared_structure_trains(fixed, named):
    record = make_saturated_filter(400, random_state=0)
    scaled = [((record.u / record.u.std(0)), record.y / record.y.std(0))]
    linear = identify_linear(scaled, 2)
    structure = hammerstein_structure(2, 2, 2, n_f=6, C=linear.C if fixed else None)
    if not named:  # axes without an activation have tanh
        structure = Structure(**{**vars_of(structure), "activations": {}})
    theta = initial_theta(structure, linear, scaled, np.random.default_rng(0))
    start = Criterion(structure, scaled)
    free = start.join(theta, linear.x0)
    p = structure.split(theta)
    np.testing.assert_array_equal(p["A"], linear.A)  # the start is the linear model
    result = train(structure, scaled, [theta], max_iter=60)
    assert np.sqrt(result.cost) < 0.1 * start.norm(free)
    again = minimize(start, free, max_iter=60)
    assert np.sqrt(again.cost) < 0.1 * start.norm(free)


def vars_of(structure):
    """Return the fields of a structure, without what it has cached."""
    return {name: getattr(structure, name) for name in structure.__dataclass_fields__}


# -- the estimator ---------------------------------------------------------------------


@pytest.mark.parametrize("activation", ["tanh", SOFTSIGN], ids=["tanh", "softsign"])
def test_estimator_of_a_declared_structure(activation):
    train_runs = [make_saturated_filter(300, random_state=i) for i in (0, 1)]
    test = make_saturated_filter(300, random_state=2)
    model = HammersteinSsnn(2, 8, activation=activation, dt=0.1, random_state=0)
    model.fit(*zip(*train_runs, strict=True))
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


# -- optimizer, certificate, activation ------------------------------------------------


def test_an_optimizer_needs_the_criterion_alone(rng):
    record = make_saturated_filter(300, random_state=0)
    pairs = [(record.u / record.u.std(0), record.y / record.y.std(0))]
    linear = identify_linear(pairs, 2)
    structure = hammerstein_structure(2, 2, 2, n_f=4, C=linear.C)
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

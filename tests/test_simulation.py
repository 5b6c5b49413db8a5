import sys

import control
import numpy as np
import pytest

from alssnn import kernels
from alssnn.activations import ACTIVATIONS
from alssnn.continuous import flow, sampled
from alssnn.equations import Equations
from alssnn.models import state_space
from alssnn.sensitivities import chunk_length, sensitivities
from alssnn.simulation import SIMULATION_CHUNK, channels, simulate, weight_lists
from alssnn.structures import direct
from helpers import assert_jacobian, random_theta, simulate_linear


@pytest.fixture
def run(structure, rng):
    theta = random_theta(structure, rng)
    return (
        theta,
        rng.standard_normal((30, structure.nu)),
        rng.standard_normal(structure.n_x0),
    )


def test_linear_case_equals_python_control(rng):
    structure = state_space(3, 2, 2)
    theta = random_theta(structure, rng)
    p = structure.split(theta)
    u, x0 = rng.standard_normal((50, 2)), rng.standard_normal(3)
    linear = control.ss(p["A"], p["B"], p["C"], np.zeros((2, 2)), 0.1)
    response = control.forced_response(linear, 0.1 * np.arange(50), u.T, x0)
    lure = structure.lure(theta)
    y = channels(lure, simulate(lure, u, x0), u)
    np.testing.assert_allclose(y, response.outputs.T, atol=1e-12)
    np.testing.assert_allclose(y, simulate_linear(p["A"], p["B"], p["C"], u, x0))


def test_splitting_a_record_at_its_true_state_changes_nothing(structure, rng):
    theta = random_theta(structure, rng)
    u = rng.standard_normal((2 * SIMULATION_CHUNK + 7, structure.nu))
    lure = structure.lure(theta)
    X = simulate(lure, u, np.zeros(structure.nx))
    for k in (1, 500, SIMULATION_CHUNK, len(u) - 1):
        tail = simulate(lure, u[k:], X[k])
        np.testing.assert_allclose(tail, X[k:], rtol=0, atol=1e-13)


def test_sensitivities(structure, run, rng):
    theta, u, x0 = run
    scale = rng.uniform(0.5, 2.0, structure.nz)

    def trajectory(v):
        lure = structure.lure(v[: structure.n_params])
        X = simulate(lure, u, structure.initial_state(v[structure.n_params :]))
        return channels(lure, X, u) * scale

    J = [J.copy() for *_, J in sensitivities(structure, theta, x0, u, scale)]
    assert_jacobian(trajectory, np.concatenate(J), np.concatenate([theta, x0]))


@pytest.mark.parametrize("chunk", [1, 7, 30, 1000])
def test_chunk_size_of_sensitivities_changes_nothing(structure, run, chunk):
    theta, u, x0 = run
    scale = np.ones(structure.nz)
    results = []
    for size in (None, chunk):
        parts, blocks = [], []
        for part, Z, J in sensitivities(structure, theta, x0, u, scale, size):
            parts.append(range(len(u))[part])
            blocks.append(np.dstack([J, Z]))
        assert [k for part in parts for k in part] == list(range(len(u)))
        results.append(np.concatenate(blocks))
    np.testing.assert_allclose(*results, rtol=0, atol=1e-13)


def test_divergence_fills_the_rest_with_inf():
    structure = state_space(1, 1, 1)
    theta = structure.join({"A": [[1.5]], "B": [[1.0]], "C": [[1.0]]})
    X = simulate(structure.lure(theta), np.ones((5000, 1)), np.zeros(1))
    assert X.shape == (5001, 1)
    assert np.isinf(X[1:]).all()
    assert X[0] == 0


@pytest.mark.parametrize(("size", "finite"), [(0.99e8, True), (1.01e8, False)])
def test_a_trajectory_is_given_up_where_a_state_is_beyond_sense(size, finite):
    structure = state_space(1, 1, 1)  # scaled units: 1e8 standard deviations
    theta = structure.join({"A": [[0.5]], "B": [[1.0]], "C": [[1.0]]})
    u = np.zeros((9, 1))
    u[4] = -size
    X = simulate(structure.lure(theta), u, np.zeros(1))
    assert np.isfinite(X).all() == finite
    X = simulate(structure.lure(theta), 50 * u, np.zeros(1), size=50.0)  # the usual one
    assert np.isfinite(X).all() == finite


def test_a_divergence_takes_its_own_1024_samples_along():
    structure = state_space(1, 1, 1)
    theta = structure.join({"A": [[0.5]], "B": [[1.0]], "C": [[1.0]]})
    u = np.zeros((4000, 1))
    u[1100] = 1e9
    X = simulate(structure.lure(theta), u, np.ones(1))
    assert np.isfinite(X[:1025]).all() and np.isinf(X[1025:]).all()


def test_sensitivities_of_a_chunk_fit_the_cache(structure):
    n = structure.n_params + structure.n_x0
    sample = 8 * n * structure.nz  # bytes
    chunk = chunk_length(structure.nz, n)
    assert chunk * sample <= 1.2e6 < (chunk + 1) * sample
    assert chunk_length(30, 1_000) == 32  # a loop over less is slow


def test_unstable_but_short_simulation_is_not_divergence():
    structure = state_space(1, 1, 1)
    theta = structure.join({"A": [[1.5]], "B": [[1.0]], "C": [[1.0]]})
    X = simulate(structure.lure(theta), np.ones((20, 1)), np.zeros(1))
    np.testing.assert_allclose(X[-1], 2 * (1.5**20 - 1))


@pytest.mark.parametrize("activation", ACTIVATIONS.values(), ids=str)
@pytest.mark.parametrize("n_neurons", [0, 3, 80])  # the last with calls of BLAS
def test_kernels_do_the_same_compiled_and_plain(rng, n_neurons, activation):
    L, nx = 6, 4
    base = rng.standard_normal((L, n_neurons + nx))
    P = 0.3 * rng.standard_normal((n_neurons + nx, nx))
    W = rng.standard_normal((nx, n_neurons)) / max(n_neurons, 1)
    E = np.tril(0.5 * rng.standard_normal((n_neurons, n_neurons)), -1)
    assert (P.size + W.size > kernels.FEW) == (n_neurons == 80)
    k = np.arange(n_neurons)  # each a layer; the last ones see the one before alone
    first = np.where(k > 2, k - 1, 0)
    layers = np.stack([k, k + 1, first], axis=1)
    states = [np.zeros((L, nx)), np.zeros((L, nx))]
    functions = [activation.value] * n_neurons
    codes = np.full(n_neurons, activation.code)
    given = E, layers, functions
    if kernels.advance.is_compiled:
        seen = E * (np.arange(n_neurons) >= first[:, None])
        given = weight_lists(seen), layers, codes
    kernels.advance(base, P, *given, W, np.ones(nx), states[0])
    kernels.advance.plain(base, P, E, layers, functions, W, np.ones(nx), states[1])
    np.testing.assert_allclose(*states, rtol=1e-13)


def test_sensitivities_do_the_same_compiled_and_plain(structure, run, monkeypatch):
    theta, u, x0 = run
    results = []
    for kernel in (kernels.differentiate, kernels.differentiate.plain):
        monkeypatch.setattr("alssnn.sensitivities.differentiate", kernel)
        blocks = sensitivities(structure, theta, x0, u, np.ones(structure.nz), 7)
        results.append(np.concatenate([J.copy() for *_, J in blocks]))
    np.testing.assert_allclose(*results, rtol=0, atol=1e-13)


DEEP = {  # structures of many layers
    "h": ({"n_h": 4, "feedback": "state"}, ("y", "v"), "zoh", 1),
    "g of two layers": ({"n_g": (3, 2)}, ("y", "g"), "linear", 2),
    "both": ({"n_h": 4, "n_g": 3}, ("y", "e"), "zoh", 3),
    "relu": ({"n_g": 3, "activation": "relu"}, ("y",), "cubic", 1),
    "no states": ({"n_h": 2, "feedback": "state"}, None, "zoh", 1),
}


@pytest.fixture(params=DEEP.values(), ids=DEEP)
def deep(request):
    options, observed, hold, substeps = request.param
    one = sampled(state_space(3, 2, 2, C=np.eye(2, 3), **options), hold, substeps)
    return flow(one) if observed is None else one.observe(*observed)


def test_many_layers_are_differentiated_as_few(deep, rng, monkeypatch):
    theta = 0.2 * rng.standard_normal(deep.n_params)
    u, x0 = rng.standard_normal((37, deep.nu)), rng.standard_normal(deep.n_x0)
    scale = rng.uniform(0.5, 2.0, deep.nz)
    ways = [  # most layers that are few, bytes of gains, kernels
        (np.inf, 1, kernels.back_propagate, kernels.differentiate),
        (8, 1, kernels.back_propagate, kernels.differentiate),
        (8, 1, kernels.back_propagate.plain, kernels.differentiate.plain),
        (8, 10**6, kernels.back_propagate, kernels.differentiate.plain),
    ]
    results = []
    for most, size, back_propagate, differentiate in ways:
        monkeypatch.setattr("alssnn.sensitivities.MANY_LAYERS", most)
        monkeypatch.setattr("alssnn.sensitivities.GAINS_BYTES", size)
        monkeypatch.setattr("alssnn.sensitivities.back_propagate", back_propagate)
        monkeypatch.setattr("alssnn.sensitivities.differentiate", differentiate)
        blocks = sensitivities(deep, theta, x0, u, scale, 20)
        results.append(
            np.concatenate([np.dstack([Z[:, :, None], J]) for _, Z, J in blocks])
        )
    assert len(deep.lure(theta).layers) > 8
    size = np.abs(results[0]).max()
    for result in results[1:]:
        np.testing.assert_allclose(result, results[0], rtol=0, atol=1e-13 * size)


@pytest.mark.parametrize("n_rows", [3, 5])
def test_the_adjoint_is_the_transposed_derivative(rng, n_rows):
    nx, L = 3, 17
    FH = 0.5 * rng.standard_normal((L, n_rows, nx))
    c, end = rng.standard_normal((L, n_rows - nx)), rng.standard_normal(nx)
    moved, expected = np.eye(nx), np.zeros(nx)  # of each state, by the first
    for FH_k, c_k in zip(FH, c, strict=True):
        both = FH_k @ moved
        moved = both[:nx]
        expected += both[nx:].T @ c_k
    expected += moved.T @ end
    for kernel in (kernels.retrace, kernels.retrace.plain):
        carried, rows = end.copy(), np.hstack([np.empty((L, nx)), c])
        kernel(FH, carried, rows)
        np.testing.assert_allclose(carried, expected)
        np.testing.assert_array_equal(rows[-1, :nx], end)


def test_derivatives_through_many_layers(deep, rng):
    theta = 0.2 * rng.standard_normal(deep.n_params)
    u, x0 = rng.standard_normal((19, deep.nu)), rng.standard_normal(deep.n_x0)

    def simulated(v):
        lure = deep.lure(v[: deep.n_params])
        X = simulate(lure, u, deep.initial_state(v[deep.n_params :]))
        return channels(lure, X, u)

    J = [J.copy() for *_, J in sensitivities(deep, theta, x0, u, np.ones(deep.nz))]
    assert_jacobian(simulated, np.concatenate(J), np.concatenate([theta, x0]))


def test_derivatives_of_many_networks_side_by_side(rng):
    e = Equations(x=2, u=1, y=1)
    x, u = e.state("x"), e.input("u")
    following = e.parameter("A", "x", "x") @ x + e.parameter("B", "x", "u") @ u
    for i in range(9):  # every change of the activation begins another layer
        names = {f"W{i}": x, f"U{i}": u}
        activation = ACTIVATIONS[("tanh", "sigmoid")[i % 2]]
        options = {"bias": f"b{i}", "biases": "free", "activation": activation}
        following = following + e.mlp(f"n{i}", "x", 2, names, **options)
    C = e.constant("C", np.array([[1.0, 0.5]]), "y", "x")
    many = e.structure({"x": following}, {"y": C @ x})
    theta, x0 = 0.2 * rng.standard_normal(many.n_params), np.zeros(2)
    u, lure = rng.standard_normal((19, 1)), many.lure(theta)
    assert len(lure.layers) == 9 and not lure.E.any()

    def simulated(v):
        lure = many.lure(v[: many.n_params])
        return channels(lure, simulate(lure, u, v[many.n_params :]), u)

    J = [J.copy() for *_, J in sensitivities(many, theta, x0, u, np.ones(1))]
    assert_jacobian(simulated, np.concatenate(J), np.concatenate([theta, x0]))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("kernel", ["compiled", "plain"])
def test_derivatives_by_some_parameters(
    structure, run, rng, share, kernel, monkeypatch
):
    theta, u, x0 = run
    if kernel == "plain":
        monkeypatch.setattr(
            "alssnn.sensitivities.differentiate", kernels.differentiate.plain
        )
    free = rng.random(structure.n_params) < share
    scale, ends = rng.uniform(0.5, 2.0, structure.nz), []
    results = []
    for wanted in (np.ones_like(free), free):
        ends.append(np.empty((structure.nx, wanted.sum() + structure.n_x0)))
        options = {"spare": 1, "end": ends[-1], "free": wanted}
        blocks = sensitivities(structure, theta, x0, u, scale, 7, **options)
        results.append(np.concatenate([J[:, :, :-1].copy() for *_, J in blocks]))
    kept = np.append(free, np.ones(structure.n_x0, dtype=bool))
    np.testing.assert_allclose(results[1], results[0][:, :, kept], rtol=0, atol=1e-13)
    np.testing.assert_allclose(ends[1], ends[0][:, kept], rtol=0, atol=1e-13)


def test_derivatives_by_some_through_many_layers(deep, rng):
    theta = 0.2 * rng.standard_normal(deep.n_params)
    u, x0 = rng.standard_normal((19, deep.nu)), rng.standard_normal(deep.n_x0)
    free = rng.random(deep.n_params) < 0.5
    results = []
    for wanted in (None, free):
        blocks = sensitivities(deep, theta, x0, u, np.ones(deep.nz), free=wanted)
        results.append(np.concatenate([J.copy() for *_, J in blocks]))
    kept = np.append(free, np.ones(deep.n_x0, dtype=bool))
    size = np.abs(results[0]).max(initial=1.0)
    np.testing.assert_allclose(results[1], results[0][:, :, kept], atol=1e-13 * size)


@pytest.mark.parametrize("L", [1, 8, 19])
def test_gains_go_back_through_the_neurons_that_see_them(rng, L):
    nw, n_rows, further = 7, 3, 4
    seen = np.tril(rng.standard_normal((nw, nw)), -1)
    seen[4, 3] = seen[6, 5] = 0.0  # in one layer
    seen = np.hstack([seen, rng.standard_normal((nw, further))])
    seen[2] = 0.0  # sees nothing
    initial = rng.standard_normal((n_rows, nw + further))
    slope = rng.standard_normal((L, nw))
    layers = np.array([[0, 1], [1, 2], [2, 3], [3, 5], [5, 7]])
    lists = weight_lists(seen)
    expected = np.empty((L, n_rows, nw + further))
    for k in range(L):  # W R by its definition
        E = seen[:, :nw]
        R = np.linalg.inv(np.eye(nw) - slope[k][:, None] * E) * slope[k]
        WR = initial[:, :nw] @ R
        expected[k] = np.hstack([WR, initial[:, nw:] + WR @ seen[:, nw:]])
    for kernel in (kernels.back_propagate, kernels.back_propagate.plain):
        out = np.full(expected.shape, np.nan)
        kernel(initial, slope, layers, *lists, out)
        np.testing.assert_allclose(out, expected, atol=1e-10)


def test_a_parameter_before_a_sum_has_one_product():
    one = state_space(2, 1, 1, n_h=3, C=np.eye(1, 2))
    rng = np.random.default_rng(0)
    p = one.split(rng.standard_normal(one.n_params))
    for W in (None, rng.standard_normal((3, 3))):
        sheets = direct(one, p, np.ones(3), W)
        covered = np.zeros((3, one.n_params), dtype=int)
        for start, stop, first, end, *_ in sheets.table:
            covered[start:stop, first:end] += 1
        assert covered.max() == 1  # B u + B h: of B, not one for each
        assert sheets.varies == (W is None)


# -- compiled kernels ------------------------------------------------------------------


def twice(x):
    return 2 * x


def test_a_kernel_runs_without_numba(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    kernel = kernels.Kernel(twice)
    assert not kernel.is_compiled and kernel(3.0) == 6.0


def test_a_kernel_is_compiled_where_no_folder_can_be_written(monkeypatch):
    def find_none(*_):
        raise RuntimeError("cannot cache function 'twice': no locator available")

    monkeypatch.setattr("numba.core.caching.FunctionCache.__init__", find_none)
    kernel = kernels.Kernel(twice)
    assert kernel.is_compiled and kernel(3.0) == 6.0

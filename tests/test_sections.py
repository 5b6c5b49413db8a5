from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import LinAlgError
from scipy.optimize import approx_fprime

from alssnn import kernels
from alssnn.criterion import DIVERGED_NORM
from alssnn.linear_model import AllEntries, LinearModel
from alssnn.mapping import Held
from alssnn.sections import Sections, section_basis
from alssnn.subspace import identify_linear
from helpers import simulate_linear

# nx, nu, ny and whether D is free; odd orders have a section of one pole
SHAPES = [(2, 1, 1, False), (1, 1, 1, True), (3, 2, 2, True), (6, 1, 3, False)]


@pytest.fixture(params=SHAPES, ids=str)
def model(request, rng):
    nx, nu, ny, feedthrough = request.param
    A = rng.standard_normal((nx, nx))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.standard_normal((nx, nu)), rng.standard_normal((ny, nx))
    return LinearModel(A, B, C, np.zeros((ny, nu)), np.zeros((2, nx)), feedthrough)


@pytest.fixture
def pairs(model, rng):
    """Two experiments of unequal length, some outputs missing."""
    nu, ny = model.B.shape[1], len(model.C)
    pairs = [
        (rng.standard_normal((n, nu)), rng.standard_normal((n, ny))) for n in (70, 40)
    ]
    pairs[0][1][3:9, 0] = np.nan
    return pairs


@pytest.fixture
def sections(model, pairs):
    return Sections(pairs, model)


@pytest.fixture
def entries(model, pairs, sections):
    """The same model, by the entries of its matrices."""
    return AllEntries(pairs, replace(model, **sections.matrices(sections.start)))


def test_the_model_of_the_start_is_kept(model, sections):
    found = sections.matrices(sections.start)
    np.testing.assert_allclose(found["A"], model.A, atol=1e-12)
    np.testing.assert_allclose(found["C"], model.C, atol=1e-12)
    if not model.feedthrough:
        assert not found["D"].any()


def test_the_norm_is_that_of_all_entries(sections, entries):
    norm = sections.norm(sections.start)
    assert norm == pytest.approx(entries.norm(entries.start), rel=1e-12)


def test_input_and_initial_states_are_the_best(model, sections, entries):
    _, Jr, _ = entries.normal_equations(entries.start)
    slices = entries.structure.slices
    for name in {"B", "D"} & set(slices):
        np.testing.assert_allclose(Jr[slices[name]], 0, atol=1e-12)
    np.testing.assert_allclose(Jr[entries.structure.n_params :], 0, atol=1e-12)
    solved = entries.solved()  # by one Gauss-Newton step
    for name, value in sections.solved().items():
        if name in solved:
            np.testing.assert_allclose(solved[name], value, atol=1e-9)


def test_gradient(sections, rng):
    free = sections.start + 0.1 * rng.standard_normal(len(sections.start))
    _, Jr, norm = sections.normal_equations(free)
    assert norm == sections.norm(free)
    half_square = approx_fprime(free, lambda x: sections.norm(x) ** 2 / 2, 1e-7)
    np.testing.assert_allclose(half_square, Jr, atol=1e-5 * max(1, np.abs(Jr).max()))


def test_predicted_decrease_is_that_of_all_entries(sections, entries):
    decrease = [
        Jr @ np.linalg.pinv(JJ, rcond=1e-9) @ Jr
        for JJ, Jr, _ in (
            sections.normal_equations(sections.start),
            entries.normal_equations(entries.start),
        )
    ]
    assert decrease[0] == pytest.approx(decrease[1], rel=1e-6)


def test_threads_change_no_digit(model, pairs, sections):
    threaded = Sections(Held(pairs, n_jobs=2), model)
    for one, two in zip(
        sections.normal_equations(sections.start),
        threaded.normal_equations(sections.start),
        strict=True,
    ):
        np.testing.assert_array_equal(one, two)


def test_all_poles_stay_in_the_disc(sections, rng):
    for scale in (1.0, 100.0):
        free = scale * rng.standard_normal(len(sections.start))
        assert np.abs(np.linalg.eigvals(sections.matrices(free)["A"])).max() < 1
        assert sections.norm(free) < DIVERGED_NORM
        assert np.isfinite(sections.jac(free)).all()


@pytest.mark.parametrize(
    "A",
    [
        np.diag([0.9, 0.5, -0.3]),
        [[0.6, 0.5], [-0.5, 0.6]],
        [[0.6, 1e-5], [-1e-5, 0.6]],
        [[0.5, 0.3, 0.0], [-0.3, 0.5, 0.1], [0.0, 0.0, -0.8]],
    ],
)
def test_section_basis(A):
    A = np.asarray(A, dtype=float)
    T, sigma, q = section_basis(A)
    S = np.linalg.solve(T, A @ T)
    for k in range(len(A) // 2):
        expected = [[sigma[k], 1.0], [q[k], sigma[k]]]
        np.testing.assert_allclose(S[2 * k :, 2 * k :][:2, :2], expected, atol=1e-10)


@pytest.mark.parametrize("A", [np.eye(3, k=1), 0.5 * np.eye(2), np.diag([1.1, 0.5])])
def test_no_basis_of_sections(A):
    with pytest.raises(LinAlgError, match="no basis of sections"):
        section_basis(A)


def test_a_chain_of_delays_is_identified_entry_by_entry(rng):
    u = rng.standard_normal((300, 1))
    A, B, C = np.eye(3, k=-1), np.eye(3)[:, :1], np.array([[1.0, -0.5, 0.25]])
    model = identify_linear([(u, simulate_linear(A, B, C, u))], 3)
    assert model.result.cost < 1e-20


def test_filter_compiled_and_plain(rng):
    m, nu, L = 3, 2, 8
    sigma, q = rng.uniform(-0.5, 0.5, m), rng.uniform(-0.3, 0.2, m)
    beta, u = rng.standard_normal((m, 2, nu + 1)), rng.standard_normal((L, nu))
    results = []
    for kernel in (kernels.filter_sections, kernels.filter_sections.plain):
        Z = np.ones((m, nu + 3, 2))
        out = np.empty((L, Z.size + nu))
        kernel(sigma, q, beta, u, Z, out)
        results.append(np.append(out, Z))
    np.testing.assert_allclose(*results, rtol=1e-12)

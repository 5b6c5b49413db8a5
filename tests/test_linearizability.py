import numpy as np
import pytest

from alssnn.linearizability import measure, output_residual
from helpers import simulate_linear


@pytest.fixture
def trajectory(rng):
    A = np.array([[0.8, 0.1], [-0.2, 0.7]])
    B, C = rng.standard_normal((2, 1)), rng.standard_normal((2, 2))
    X, u = rng.standard_normal((40, 2)), rng.standard_normal((40, 1))
    y, h = rng.standard_normal((40, 2)), rng.standard_normal((40, 1))
    return A, B, C, (X, u, y, h, 0.1 * rng.standard_normal((40, 2)))


def test_output_residual_is_the_response_to_g(trajectory):
    A, _, C, (*_, g) = trajectory
    expected = simulate_linear(A, np.eye(2), C, g)
    np.testing.assert_allclose(output_residual(A, C, g), expected, atol=1e-14)


def test_measure_against_the_definitions(trajectory):
    A, B, C, (X, u, y, h, g) = trajectory
    record = measure(A, B, C, [(X, u, y, h, g)])
    linear = np.linalg.norm(X @ A.T + u @ B.T, axis=1)
    ratio_g = np.linalg.norm(g, axis=1) / linear
    ratio_h = np.linalg.norm(h, axis=1) / linear
    e = output_residual(A, C, g)
    error = np.sqrt(np.mean(e**2, axis=0) / np.mean(y**2, axis=0))
    np.testing.assert_allclose(record.linearization_error, error)
    assert record.ratio_g_mean == pytest.approx(ratio_g.mean())
    assert record.ratio_g_max == pytest.approx(ratio_g.max())
    assert record.ratio_h_mean == pytest.approx(ratio_h.mean())
    assert record.ratio_h_max == pytest.approx(ratio_h.max())
    assert record.spectral_radius == pytest.approx(np.sqrt(0.8 * 0.7 + 0.02))


def test_the_error_does_not_depend_on_the_state_basis_but_the_ratio_does(
    trajectory, rng
):
    A, B, C, (X, u, y, h, g) = trajectory
    T = rng.standard_normal((2, 2))
    T_inv = np.linalg.inv(T)
    here = measure(A, B, C, [(X, u, y, h, g)])
    there = measure(T @ A @ T_inv, T @ B, C @ T_inv, [(X @ T.T, u, y, h, g @ T.T)])
    np.testing.assert_allclose(
        there.linearization_error, here.linearization_error, rtol=1e-8
    )
    assert abs(there.ratio_g_mean / here.ratio_g_mean - 1) > 0.01


def test_a_model_without_g_has_no_error_and_prints(trajectory):
    A, B, C, (X, u, y, h, g) = trajectory
    record = measure(A, B, C, [(X, u, 0 * y, h, 0 * g)])
    np.testing.assert_array_equal(record.linearization_error, 0)
    assert "linearization error" in str(record)


def test_an_unstable_A_gives_an_infinite_error(trajectory):
    A, B, C, (X, u, y, h, g) = trajectory
    N = 3000
    long = tuple(np.tile(z, (N // 40, 1)) for z in (X, u, y, h, g))
    assert np.isinf(measure(3 * A, B, C, [long]).linearization_error).all()


def test_a_diverged_trajectory_is_infinitely_nonlinear(trajectory):
    A, B, C, (X, u, y, h, g) = trajectory
    record = measure(A, B, C, [(X, u, y, h, np.full_like(g, np.nan))])
    assert np.isinf(record.linearization_error).all()
    assert record.ratio_g_mean == record.ratio_h_max == np.inf

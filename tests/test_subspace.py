from dataclasses import replace

import numpy as np
import pytest

from alssnn.linear_model import LinearModel, decorrelate, stabilize
from alssnn.subspace import _candidate_horizons, hankel_triangle, identify_linear
from helpers import simulate_linear


def markov(A, B, C, n=12):
    """Return C B, C A B, C A^2 B, ..."""
    return np.stack([C @ np.linalg.matrix_power(A, k) @ B for k in range(n)])


def system(rng, nx, nu, ny, radius=0.9):
    A = rng.standard_normal((nx, nx))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.standard_normal((nx, nu)), rng.standard_normal((ny, nx))


def records(rng, plant, lengths, noise=0.0):
    A, B, C = plant
    out = []
    for n in lengths:
        u = rng.standard_normal((n, B.shape[1]))
        y = simulate_linear(A, B, C, u, rng.standard_normal(len(A)))
        out.append((u, y + noise * rng.standard_normal(y.shape)))
    return out


@pytest.mark.parametrize(
    "shape", [(1, 1, 1), (3, 1, 1), (4, 2, 3), (2, 2, 4), (5, 3, 1)]
)
@pytest.mark.parametrize("lengths", [(400,), (150, 90, 260)])
def test_noise_free_systems_are_recovered(rng, shape, lengths):
    plant = system(rng, *shape)
    model = identify_linear(records(rng, plant, lengths), shape[0])
    np.testing.assert_allclose(
        markov(model.A, model.B, model.C), markov(*plant), rtol=0, atol=1e-6
    )


def test_states_have_unit_variance(rng):
    experiments = records(rng, system(rng, 3, 1, 1), (500,))
    model = identify_linear(experiments, 3)
    X = np.empty((500, 3))
    x = model.x0[0]
    for k, u in enumerate(experiments[0][0]):
        X[k] = x
        x = model.A @ x + model.B @ u
    np.testing.assert_allclose(X.std(axis=0), 1.0, rtol=1e-9)


def states(model, experiments):
    """Return the states over all experiments, by the plainest loop."""
    X = []
    for (u, _), x in zip(experiments, model.x0, strict=True):
        for u_k in u:
            X.append(x)
            x = model.A @ x + model.B @ u_k
    return np.array(X)


@pytest.mark.parametrize("lengths", [(500,), (60, 200)])
def test_states_are_uncorrelated_and_fall_in_energy(rng, lengths):
    A = np.array([[0.95, 0.1, 0.0], [0.0, 0.94, 0.2], [0.0, 0.0, 0.3]])
    plant = A, rng.standard_normal((3, 1)), rng.standard_normal((2, 3))
    experiments = records(rng, plant, lengths)
    x0 = rng.standard_normal((len(lengths), 3))
    given = LinearModel(*plant, np.zeros((2, 1)), x0)
    model = decorrelate(given, experiments)
    covariance = np.cov(states(model, experiments).T, bias=True)
    np.testing.assert_allclose(covariance, np.eye(3), atol=1e-9)
    # energy of the outputs that a state leaves behind: one by one, and falling
    powers = [np.linalg.matrix_power(model.A, k) for k in range(2000)]
    energy = sum(P.T @ model.C.T @ model.C @ P for P in powers)
    np.testing.assert_allclose(energy, np.diag(np.diag(energy)), atol=1e-8)
    assert np.all(np.diff(np.diag(energy)) < 0)
    # the same system
    np.testing.assert_allclose(
        markov(model.A, model.B, model.C), markov(*plant), atol=1e-9
    )
    np.testing.assert_allclose(model.x0 @ model.C.T, x0 @ plant[2].T, atol=1e-9)


def test_the_signs_of_the_states_are_no_chance(rng):
    plant = system(rng, 3, 1, 2)
    experiments = records(rng, plant, (300,))
    for flip in np.diag([1, 1, -1]), np.diag([-1, 1, -1]):
        A, B, C = flip @ plant[0] @ flip, flip @ plant[1], plant[2] @ flip
        given = LinearModel(A, B, C, np.zeros((2, 1)), np.zeros((1, 3)))
        C = decorrelate(given, experiments).C
        assert np.all(C[np.abs(C).argmax(axis=0), range(3)] > 0)


def test_a_state_that_does_not_move_keeps_the_basis(rng):
    A, C = np.diag([0.5, 0.8]), np.ones((1, 2))
    given = LinearModel(A, [[1.0], [0.0]], C, np.zeros((1, 1)), np.zeros((1, 2)))
    given = replace(given, B=np.array(given.B))
    model = decorrelate(given, [(rng.standard_normal((50, 1)), np.zeros((50, 1)))])
    np.testing.assert_array_equal(model.A, A)


def test_a_change_of_the_true_state_basis_changes_nothing(rng):
    A, B, C = system(rng, 3, 1, 1)
    T = rng.standard_normal((3, 3))
    u = rng.standard_normal((300, 1))
    models = []
    for plant in ((A, B, C), (T @ A @ np.linalg.inv(T), T @ B, C @ np.linalg.inv(T))):
        y = simulate_linear(*plant, u)
        models.append(identify_linear([(u, y)], 3))
    first, second = (markov(m.A, m.B, m.C) for m in models)
    np.testing.assert_allclose(first, second, atol=1e-7)


def test_refinement_reaches_the_noise_floor(rng):
    plant = system(rng, 3, 1, 1)
    ((u, y),) = records(rng, plant, (2000,), noise=0.1)
    model = identify_linear([(u, y)], 3)
    y_hat = simulate_linear(model.A, model.B, model.C, u, model.x0[0])
    rmse = np.sqrt(np.mean((y - y_hat) ** 2))
    assert rmse < 0.1 * 1.02
    assert model.result.cost == pytest.approx(rmse**2, rel=1e-9)


def test_hankel_triangle_equals_the_block_hankel_matrix(rng):
    experiments = records(rng, system(rng, 2, 2, 1), (30, 4, 25))
    i, columns = 3, []
    for u, y in experiments:
        for k in range(len(u) - 2 * i + 1):
            columns.append(
                np.concatenate(
                    [
                        u[k + i : k + 2 * i].ravel(),
                        u[k : k + i].ravel(),
                        y[k : k + i].ravel(),
                        y[k + i : k + 2 * i].ravel(),
                    ]
                )
            )
    H = np.array(columns).T
    R = hankel_triangle(experiments, i)
    assert R.shape == (18, 18)
    np.testing.assert_allclose(R.T @ R, H @ H.T, atol=1e-12)
    np.testing.assert_array_equal(R, np.triu(R))


def test_hankel_triangle_by_chunks(rng, monkeypatch):
    experiments = records(rng, system(rng, 2, 1, 1), (100,))
    whole = hankel_triangle(experiments, 4)
    monkeypatch.setattr("alssnn.subspace.QR_COLUMNS", 13)
    parts = hankel_triangle(experiments, 4)
    np.testing.assert_allclose(parts.T @ parts, whole.T @ whole, atol=1e-11)


def test_stabilize_reflects_and_keeps_the_rest(rng):
    V = rng.standard_normal((3, 3))
    A = V @ np.diag([0.5, -1.25, 0.9]) @ np.linalg.inv(V)
    np.testing.assert_allclose(
        np.sort(np.linalg.eigvals(stabilize(A)).real), [-0.8, 0.5, 0.9]
    )
    stable = 0.5 * np.eye(2)
    assert stabilize(stable) is stable


@pytest.mark.parametrize(
    "A", [[[1.0, 1.0], [0.0, 1.0]], [[1.0]], [[0.0, 3.0], [-3.0, 0.0]], [[5.0]]]
)
def test_stabilize_ends_inside_the_disc(A):
    result = stabilize(np.array(A))
    assert np.isrealobj(result)
    assert np.abs(np.linalg.eigvals(result)).max() <= 0.999 + 1e-9


@pytest.mark.parametrize(("nx", "needed"), [(6, 20), (2, 8), (1, 5)])
def test_too_short_for_the_order(rng, nx, needed):
    u, y = rng.standard_normal((needed - 1, 1)), rng.standard_normal((needed - 1, 1))
    with pytest.raises(ValueError, match=rf"at least {needed} samples .* smaller `nx`"):
        identify_linear([(u, y)], nx)
    u, y = rng.standard_normal((needed, 1)), rng.standard_normal((needed, 1))
    assert isinstance(identify_linear([(u, y)], nx), LinearModel)


@pytest.mark.parametrize(
    ("n", "nx", "horizons"),
    [
        (1000, 3, [15, 40]),  # fast and slow sampling
        (155, 3, [15, 26]),  # N + 1 columns of 2 (nu + ny) i + 2 rows, nu = ny = 1
        (50, 3, [8]),
        (1000, 20, [21, 40]),  # one block more than the order
        (1000, 60, [61]),
    ],
)
def test_horizons_are_within_reach_of_record_and_order(n, nx, horizons):
    z = np.zeros((n, 1))
    assert _candidate_horizons([(z, z)], nx) == horizons


def test_singular_values_are_those_of_the_longest_horizon(rng):
    model = identify_linear(records(rng, system(rng, 2, 1, 2), (700,)), 2, max_iter=1)
    assert len(model.singular_values) == 2 * 40


def test_constant_output_gives_a_model_of_zero(rng):
    u = rng.standard_normal((50, 1))
    model = identify_linear([(u, np.zeros((50, 1)))], 2)
    assert np.abs(markov(model.A, model.B, model.C)).max() < 1e-9


def test_integrators_are_found_and_models_are_stable(rng):
    A, B, C = np.array([[1.0, 0.1], [0.0, 0.5]]), np.eye(2)[:, 1:], np.eye(2)[:1]
    u = rng.standard_normal((400, 1))
    y = simulate_linear(A, B, C, u) + 0.01 * rng.standard_normal((400, 1))
    model = identify_linear([(u, y / y.std())], 2)
    radius = np.abs(np.linalg.eigvals(model.A)).max()
    assert 0.998 < radius < 1


def test_growing_modes_of_a_short_record_are_reflected(rng):
    # a slowly growing oscillation: simulation error alone would keep it
    k = np.arange(150)
    y = (1.01**k * np.cos(0.3 * k))[:, None]
    u = rng.standard_normal((150, 1))
    model = identify_linear([(u, y / y.std())], 2)
    assert np.abs(np.linalg.eigvals(model.A)).max() < 1

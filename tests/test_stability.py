import warnings

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

from alssnn import GrSsnn
from alssnn.criterion import DIVERGED_NORM, Criterion
from alssnn.linear_model import LinearModel
from alssnn.models import state_space
from alssnn.stability import (
    Contractive,
    Schur,
    contraction,
    contraction_derivative,
    contraction_inverse,
    contractive_basis,
    hold_off,
)
from helpers import dense_residuals, random_theta, simulate_linear


@pytest.mark.parametrize("size", [0.1, 1.0, 1e3])
def test_every_Q_gives_a_contraction_and_comes_back(rng, size):
    Q = size * rng.standard_normal((4, 4))
    K = contraction(Q)
    assert np.linalg.norm(K, 2) < 1
    np.testing.assert_allclose(contraction_inverse(K), Q, rtol=1e-6 * max(1, size**2))


@pytest.mark.parametrize("size", [1e8, 1e12, 1e20])
def test_a_trial_of_huge_Q_is_a_contraction(rng, size):
    """Rounding of the largest eigenvalue of I + Q'Q is more than the least of them."""
    for _ in range(20):
        Q = rng.standard_normal((6, 6)) * size ** rng.uniform(0, 1, 6)[:, None]
        assert np.linalg.norm(contraction(Q), 2) <= 1 + 1e-9
        assert np.isfinite(contraction_derivative(Q)).all()


def test_derivative_of_the_contraction(rng):
    Q = rng.standard_normal((3, 3))
    T = np.empty((9, 9))
    for i in range(9):
        dQ = np.zeros(9)
        dQ[i] = 1e-6
        dQ = dQ.reshape(3, 3)
        T[:, i] = (contraction(Q + dQ) - contraction(Q - dQ)).ravel() / 2e-6
    # central differences, step 1e-6
    np.testing.assert_allclose(contraction_derivative(Q), T, atol=1e-9)


def test_a_norm_of_one_has_no_Q():
    with pytest.raises(ValueError, match=r"norm below 1, got 2\. Change the state"):
        contraction_inverse(2 * np.eye(2))


@pytest.mark.parametrize("phi", [0.0, 0.01, 0.3])
@pytest.mark.parametrize("radius", [0.5, 0.95, 1.2])
def test_contractive_basis(rng, phi, radius):
    A = rng.standard_normal((4, 4))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    model = LinearModel(
        A,
        rng.standard_normal((4, 2)),
        rng.standard_normal((1, 4)),
        np.zeros((1, 2)),
        np.ones((3, 4)),
    )
    new = contractive_basis(model, phi)
    assert np.linalg.norm(new.A, 2) < np.sqrt(1 - phi)
    if radius < 0.98 * np.sqrt(1 - phi):  # inside: the same system in another basis
        u = rng.standard_normal((30, 2))
        for i in range(3):
            np.testing.assert_allclose(
                simulate_linear(new.A, new.B, new.C, u, new.x0[i]),
                simulate_linear(model.A, model.B, model.C, u, model.x0[i]),
                atol=1e-10,
            )


@pytest.mark.parametrize("norm", [1 - 1e-6, 1 - 1e-12, 1.0, 1 + 1e-12])
def test_next_to_a_norm_of_one_Q_stays_finite(rng, norm):
    V = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    K = norm * V * [1.0, 0.5, -0.2]
    Q = contraction_inverse(K)
    assert np.isfinite(Q).all()
    # norms of 1 - 1e-9 and more are moved there
    np.testing.assert_allclose(contraction(Q), K, rtol=0, atol=2e-9)


def linear(poles, rng):
    """Return a model of real poles, in a basis that is no contraction."""
    T = rng.standard_normal((len(poles), len(poles)))
    A = T @ np.diag(poles) @ np.linalg.inv(T)
    B, C = rng.standard_normal((len(poles), 1)), rng.standard_normal((1, len(poles)))
    return LinearModel(A, B, C, np.zeros((1, 1)), np.zeros((1, len(poles))))


@pytest.mark.parametrize(
    ("phi", "poles"),
    # square roots of 1 - phi: 1, 0.999995, 0.894, 0.316
    [
        (0.0, [0.9999, 0.99, -0.5]),
        (1e-5, [0.9999, 0.99, -0.5]),
        (0.2, [0.85, 0.8, -0.3]),
        (0.9, [0.3, 0.2, -0.25]),
    ],
)
def test_poles_below_the_limit_stay_what_they_are(rng, phi, poles):
    new = contractive_basis(linear(poles, rng), phi)
    assert np.linalg.norm(new.A, 2) < np.sqrt(1 - phi)
    found = np.sort(np.linalg.eigvals(new.A).real)
    np.testing.assert_allclose(found, np.sort(poles), rtol=1e-9)


def test_a_basis_may_leave_out_what_is_slower_than_the_record(rng):
    new = contractive_basis(linear([0.9999, 0.5], rng), 1e-5, radius=0.99)
    found = np.sort(np.linalg.eigvals(new.A).real)
    np.testing.assert_allclose(found, [0.5, 0.99], rtol=1e-9)


@pytest.mark.parametrize("size", [1.0, 0.98, 0.5, 1e-2])
def test_states_that_nearly_cancel(size):
    """Its Lyapunov equation is singular in the digits of a double."""
    A = [[202677.63871075, -202677.31027121], [202676.68219429, -202676.35375427]]
    A, B = size * np.array(A), np.ones((2, 1))
    model = LinearModel(A, B, B.T, np.zeros((1, 1)), np.zeros((1, 2)))
    new = contractive_basis(model, 1e-5)
    assert np.linalg.norm(new.A, 2) < 1
    np.testing.assert_allclose(np.trace(new.A), np.trace(A), rtol=1e-6)


def test_a_basis_that_nearly_contracts_is_nearly_kept():
    A, eye = np.diag([0.9, 0.7, -0.5, 0.2]), np.eye(4)
    A[0, 3] = 0.6  # |A| = 1.08
    model = LinearModel(A, eye, eye, np.zeros((4, 4)), np.zeros((1, 4)))
    new = contractive_basis(model, 1e-5)
    assert np.linalg.norm(new.A, 2) < 1
    # B is the change of the basis: states that were uncorrelated, of unit variance, for
    # the networks to see, stay near that. P of (A / r)'P (A / r) - P = -I has 3.9 here
    assert np.linalg.cond(new.B) < 1.7
    # and a contraction is left alone
    again = contractive_basis(new, 1e-5)
    np.testing.assert_array_equal(again.A, new.A)


def test_poles_are_held_off_the_circle_where_a_record_is_not_reproduced(rng):
    model = linear([0.99999, 0.5], rng)
    record = [(rng.standard_normal((200, 1)), rng.standard_normal((200, 1)))]

    def error(structure, theta):
        A = structure.split(theta)["A"]
        return 0.1 + 10 * max(0, np.abs(np.linalg.eigvals(A)).max() - 0.9)

    assert error(*model.as_fit()[:2]) > 1
    held = hold_off(model, record, error)
    # of the circles 1 - 5/200, 1 - 10/200, 1 - 20/200 the third is the first in reach
    poles = np.sort(np.abs(np.linalg.eigvals(held.A)))
    np.testing.assert_allclose(poles, [0.5, 0.9], atol=1e-9)
    assert "held off" in held.result.message
    assert hold_off(held, record, error) is held


def test_normal_equations_by_Q(rng):
    structure = state_space(3, 1, 1, n_h=2, n_g=2, C=np.ones((1, 3))).observe("y", "g")
    u, y = rng.standard_normal((40, 1)), rng.standard_normal((40, 1))
    criterion = Criterion(structure, [(u, y)], weights={"y": 1.0, "g": 0.5})
    problem = Contractive(criterion, phi=0.1)
    theta = random_theta(structure, rng, radius=0.3)
    p = structure.split(theta)
    p["A"] *= 0.5 / np.linalg.norm(p["A"], 2)
    free = problem.from_free(criterion.join(structure.join(p), rng.standard_normal(3)))
    np.testing.assert_allclose(problem.to_free(free)[:9], p["A"].ravel(), atol=1e-14)
    JJ, Jr, norm = problem.normal_equations(free)
    assert norm == pytest.approx(problem.norm(free), rel=1e-14)
    gradient = [
        (problem.norm(free + d) ** 2 - problem.norm(free - d) ** 2) / 2e-5 / 2
        for d in 1e-5 * np.eye(len(free))
    ]
    np.testing.assert_allclose(Jr, gradient, atol=1e-8)  # central differences
    J = np.array(
        [
            (
                dense_residuals(criterion, problem.to_free(free + d))
                - dense_residuals(criterion, problem.to_free(free - d))
            )
            / 2e-5
            for d in 1e-5 * np.eye(len(free))
        ]
    )
    np.testing.assert_allclose(JJ, J @ J.T, atol=1e-8)


def test_schur_takes_no_step_outside_the_circle(rng):
    structure = state_space(2, 1, 1, n_g=2, C=np.ones((1, 2)))
    u, y = rng.standard_normal((40, 1)), rng.standard_normal((40, 1))
    criterion = Criterion(structure, [(u, y)])
    theta = random_theta(structure, rng, radius=0.3)
    problem = Schur(criterion, 0.9)
    free = criterion.join(theta, np.zeros((1, 2)))
    assert problem.norm(free) == criterion.norm(free)
    for got, wanted in zip(
        problem.normal_equations(free), criterion.normal_equations(free), strict=True
    ):
        np.testing.assert_array_equal(got, wanted)
    p = structure.split(theta.copy())
    for A, inside in [
        ([[0.5, 5.0], [0.0, 0.5]], True),  # of norm 5, and stable
        ([[0.95, 0.0], [0.0, 0.5]], False),
        ([[np.nan, 0.0], [0.0, 0.5]], False),
    ]:
        free = criterion.join(structure.join({**p, "A": np.array(A)}), np.zeros((1, 2)))
        assert (problem.norm(free) < DIVERGED_NORM) is inside
    # an integrator, last, is no pole to be held
    A = np.array([[0.5, 0.0], [0.0, 1.0]])
    free = criterion.join(structure.join({**p, "A": A}), np.zeros((1, 2)))
    assert Schur(criterion, 0.9, 1).norm(free) < DIVERGED_NORM
    assert problem.norm(free) == DIVERGED_NORM


@pytest.mark.parametrize("phi", [1e-5, 0.3])
def test_a_schur_model_has_its_poles_inside_the_circle(rng, phi):
    u = rng.standard_normal((300, 1))
    y = simulate_linear([[0.95]], [[1.0]], [[1.0]], u)
    y += 0.3 * np.tanh(y) + 0.05 * rng.standard_normal(y.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model = GrSsnn(
            nx=2, n_f=2, n_init=1, stability="schur", phi=phi, alpha=1e-4, max_iter=20
        ).fit(u, y)
    radius = np.abs(np.linalg.eigvals(model.A_)).max()
    assert radius <= np.sqrt(1 - phi)
    assert model.train_score_ > (0.9 if phi < 0.1 else 0.5)
    model.set_params(warm_start=True, phi=0.9, max_iter=1)  # which it does not fit
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(u, y)
    assert np.abs(np.linalg.eigvals(model.A_)).max() <= np.sqrt(1 - 0.9)

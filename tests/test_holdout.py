"""Folds: what they hide, what they see, and how they judge."""

import numpy as np
import pytest

from alssnn import holdout
from alssnn.holdout import hold_out
from alssnn.models import state_space
from alssnn.simulation import regressors, simulate
from helpers import bistable, point, simulate_linear


def records(rng, lengths, ny=2):
    normal = rng.standard_normal
    return [(normal((n, 1)), normal((n, ny))) for n in lengths]


@pytest.mark.parametrize(
    ("lengths", "n_folds"),
    # by the number of samples of all experiments: FEW = 1200, MANY = 4000
    [((40,), 3), ((500, 700), 3), ((1201,), 2), ((2000, 2000), 2), ((4001,), 1)],
)
def test_short_records_are_judged_by_more_folds(rng, lengths, n_folds):
    assert len(hold_out(records(rng, lengths))) == n_folds


@pytest.mark.parametrize("lengths", [(400,), (101, 55, 8), (7, 400)])
def test_a_fold_hides_one_quarter_and_never_the_first(rng, lengths):
    experiments = records(rng, lengths)
    folds = hold_out(experiments)
    for i, (u, y) in enumerate(experiments):
        judged = np.zeros(len(u), dtype=int)
        for fold in folds:
            u_f, seen = fold.fitted[i]
            u_h, unseen = fold.hidden[i]
            np.testing.assert_array_equal(u_f, u)
            np.testing.assert_array_equal(u_h, u)
            is_hidden = np.isnan(seen)
            # every sample either fits or judges
            np.testing.assert_array_equal(is_hidden, ~np.isnan(unseen))
            np.testing.assert_array_equal(np.where(is_hidden, unseen, seen), y)
            assert abs(is_hidden[:, 0].sum() - len(u) / 4) <= 1
            assert np.ptp(np.flatnonzero(is_hidden[:, 0])) == is_hidden[:, 0].sum() - 1
            judged += is_hidden[:, 0]
        assert judged.max() == 1  # no sample judges twice
        assert not judged[: int(np.floor(len(u) / 4))].any()


def test_the_share_that_is_hidden_can_be_chosen(rng):
    experiments = records(rng, (200,))
    (fold,) = hold_out(experiments, share=0.5)
    np.testing.assert_array_equal(
        np.isnan(fold.hidden[0][1][:, 0]), np.arange(200) < 100
    )


def test_the_only_fold_ends_where_it_hides(rng):
    experiments = records(rng, (3000, 2001))
    (fold,) = hold_out(experiments)
    for whole, fitted, hidden, (u, y) in zip(
        fold.whole, fold.fitted, fold.hidden, experiments, strict=True
    ):
        n = len(fitted[1])
        assert abs(n - 0.75 * len(u)) <= 1
        for signals, wanted in ((whole, (u, y)), (fitted, (u[:n], y[:n]))):
            np.testing.assert_array_equal(signals[0], wanted[0])
            np.testing.assert_array_equal(signals[1], wanted[1])
        np.testing.assert_array_equal(hidden[0], u)
        assert np.isnan(hidden[1][:n]).all()
        np.testing.assert_array_equal(hidden[1][n:], y[n:])


def test_smaller_shares_make_no_more_folds(rng):
    assert len(hold_out(records(rng, (400,)), share=0.1)) == 3


def test_what_the_record_lacks_judges_nobody(rng):
    experiments = records(rng, (80,))
    experiments[0][1][70:, 1] = np.nan
    fold = hold_out(experiments)[0]
    assert np.isnan(fold.hidden[0][1][70:, 1]).all()
    assert np.isfinite(fold.hidden[0][1][60:, 0]).all()


def test_the_data_are_not_touched(rng):
    experiments = records(rng, (80, 60))
    kept = [(u.copy(), y.copy()) for u, y in experiments]
    hold_out(experiments)
    for one, other in zip(experiments, kept, strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        np.testing.assert_array_equal(one[1], other[1])


# -- the error -------------------------------------------------------------------------

A, B, C = np.diag([0.9, 0.5]), np.ones((2, 1)), np.array([[1.0, 0.5], [0.0, 2.0]])


@pytest.mark.parametrize("weight", [None, [1.0, 3.0], [0.0, 2.0]])
def test_the_error_is_that_of_a_simulation_through_the_gap(rng, weight, monkeypatch):
    monkeypatch.setattr(holdout, "NUDGE", 0.0)
    experiments, x0 = records(rng, (60, 90)), rng.standard_normal((2, 2))
    structure, theta = point(A, B, C)
    share = np.array([1.0, 1.0] if weight is None else weight)
    for i, fold in enumerate(hold_out(experiments)):
        square, count = np.zeros(2), 0
        for (u, y), start in zip(experiments, x0, strict=True):
            # 60 and 90 samples: quarters of 15, and of 22 and 23
            n = len(u)
            last, first = n - round(i * n / 4), n - round((i + 1) * n / 4)
            error = y - simulate_linear(A, B, C, u, start)
            square += np.sum(error[first:last] ** 2, axis=0)
            count += last - first
        expected = square / count @ share / share.sum()
        error = fold.error(structure, theta, x0, weight)
        assert error == pytest.approx(expected, rel=1e-12)


def test_the_error_is_the_worst_from_starts_next_to_x0(rng):
    ((u, _),), x0 = records(rng, (80,)), np.array([[0.3, -0.2]])
    x_true = x0[0] + [0.3, 0.3]  # so that a direction that is not tried is the worst
    y = simulate_linear(A, B, C, u, x_true)
    fold, (structure, theta) = hold_out([(u, y)])[-1], point(A, B, C)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(2, 1, 2))
    errors = []
    for sign in [np.zeros(2), *signs[:, 0]]:
        shifted = simulate_linear(A, B, C, u, x0[0] + 0.1 * sign)
        errors.append(np.mean((shifted - y)[20:40] ** 2))
    assert max(errors) > 0
    error = fold.error(structure, theta, x0)
    assert error == pytest.approx(max(errors), rel=1e-12)


def test_a_model_that_hangs_on_an_exact_state_is_found_out(rng):
    # a mode that grows by 2 % per sample is silent from its exact state, zero; from a
    # tenth beside it, it is 0.1 * 1.02**225 = 8.6 where the last quarter begins
    u = rng.standard_normal((300, 1))
    B, C = np.array([[1.0], [0.0]]), np.ones((1, 2))
    y = simulate_linear(np.diag([0.5, 1.02]), B, C, u)
    fold, x0 = hold_out([(u, y)])[0], np.zeros((1, 2))
    assert fold.error(*point(np.diag([0.5, 1.02]), B, C), x0) > 8.6**2
    assert fold.error(*point(np.diag([0.5, 0.9]), B, C), x0) < 1e-12


def test_what_integrates_is_not_nudged(rng):
    u = rng.standard_normal((300, 1))
    A, B, C = np.diag([0.5, 1.0]), np.ones((2, 1)), np.ones((1, 2))
    y = simulate_linear(A, B, C, u)
    errors = [
        hold_out([(u, y)], integrators=n)[0].error(*point(A, B, C), np.zeros((1, 2)))
        for n in (0, 1)
    ]
    # a tenth of a state stays a tenth for ever
    np.testing.assert_allclose(errors, [0.01, 0.0], atol=1e-12)


def test_a_model_that_diverges_is_infinitely_bad(rng):
    experiments = records(rng, (3000,), ny=1)
    structure, theta = point(np.diag([3.0, 0.5]), B, np.ones((1, 2)))
    assert hold_out(experiments)[0].error(structure, theta, np.ones((1, 2))) == np.inf


@pytest.mark.parametrize(("w", "forgets"), [(0.75, False), (0.3, True)])
def test_a_model_that_ends_elsewhere_from_another_state_is_found_out(rng, w, forgets):
    """Small inputs leave it where it is, near 1.1 or near -1.1, if it has both."""
    structure, theta = bistable(w)
    lure, x0 = structure.lure(theta), np.array([[1.0], [-1.0]])
    inputs = 0.02 * rng.standard_normal((2, 300, 1))
    experiments = [
        (u, simulate(lure, u, start)[:-1]) for u, start in zip(inputs, x0, strict=True)
    ]
    for fold in hold_out(experiments):
        assert fold.error(structure, theta, x0) < 1e-6
        error = fold.error(structure, theta, x0, elsewhere=True)
        assert error < 1e-6 if forgets else error > 1.0


def test_elsewhere_are_four_states_in_the_middle_of_quarters(rng):
    A = np.diag([0.999, 0.995])  # what it begins with is seen to the end
    ((u, _),), x0 = records(rng, (600,)), np.array([[0.3, -0.2]])
    X = np.empty((600, 2))
    X[0] = x0
    for k in range(599):
        X[k + 1] = A @ X[k] + B @ u[k]
    y = simulate_linear(A, B, C, u, x0[0]) + rng.standard_normal((600, len(C)))
    fold, (structure, theta) = hold_out([(u, y)])[-1], point(A, B, C)
    known = np.isfinite(fold.hidden[0][1])
    errors = [
        np.mean((simulate_linear(A, B, C, u, X[k]) - y)[known] ** 2)
        for k in (75, 225, 375, 525)
    ]
    error = fold.error(structure, theta, x0, elsewhere=True)
    assert error == pytest.approx(max(errors), rel=1e-12)


def test_a_simulation_that_diverges_does_so_from_everywhere(rng):
    u = rng.standard_normal((4_000, 1))
    fold = hold_out([(u, u)])[0]
    growing = point(np.diag([0.5, 1.5]), np.ones((2, 1)), np.ones((1, 2)))
    assert fold.error(*growing, np.zeros((1, 2)), elsewhere=True) == np.inf


def test_what_integrates_begins_where_it_did(rng):
    u = rng.standard_normal((300, 1))
    A, B, C = np.diag([0.5, 1.0]), np.ones((2, 1)), np.ones((1, 2))
    x0 = np.array([[0.3, 2.0]])
    y = simulate_linear(A, B, C, u, x0[0])
    free, integrating = (hold_out([(u, y)], integrators=n)[0] for n in (0, 1))
    model = point(A, B, C)
    assert free.error(*model, x0, elsewhere=True) > 1.0
    error = integrating.error(*model, x0)
    assert integrating.error(*model, x0, elsewhere=True) == error


@pytest.mark.parametrize(("weight", "total"), [([1.0, 1.0], 2.0), ([3.0, 0.0], 3.0)])
def test_what_the_cost_asks_beside_the_outputs(rng, weight, total):
    """Over all samples of all experiments, whatever is measured (eq. judged)."""
    structure = state_space(2, 1, 2, n_h=3, n_g=2, C=C, feedback="state")
    theta = 0.3 * rng.standard_normal(structure.n_params)
    penalized = structure.observe("y", "h", "g")
    experiments = records(rng, (60, 40))
    x0 = rng.standard_normal((2, 2))
    (fold, *_) = hold_out(experiments)
    weights = {"y": np.array(weight), "h": 0.5, "g": 4.0}
    p, squares = structure.split(theta), 0.0
    for (u, _), start in zip(experiments, x0, strict=True):
        X = simulate(structure.lure(theta), u, structure.initial_state(start))[:-1, :2]
        Z = regressors(penalized.lure(theta), X, u) @ penalized.lure(theta).rows_z.T
        squares += np.sum(0.5 * Z[:, 2] ** 2) + np.sum(4.0 * Z[:, 3:] ** 2)
        assert Z.shape[1] == 2 + 1 + 2 and p["W_g"].any()
    asked = fold.asked(penalized, theta, x0, weights)
    assert asked == pytest.approx(squares / 100 / total, rel=1e-9)
    assert fold.asked(structure, theta, x0, {"y": 1.0}) == 0.0
    theta = structure.join({**p, "A": 30.0 * np.eye(2)})
    assert fold.asked(penalized, theta, x0, weights) == np.inf

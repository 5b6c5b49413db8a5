import numpy as np
import pytest

from alssnn.criterion import DIVERGED_NORM, Criterion, LeastSquares
from alssnn.models import state_space
from alssnn.optimizers import FAINT, minimize
from alssnn.watch import TOO_SLOW, Watch
from helpers import Heard


class Rosenbrock(LeastSquares):
    """r = [10 (x2 - x1^2), 1 - x1], minimum 0 at (1, 1)."""

    def __init__(self, floor=-np.inf):
        self.floor = floor  # x2 below which the "simulation" diverges
        self.rejected = 0

    def residuals(self, x):
        return np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])

    def norm(self, x):
        if x[1] < self.floor:
            self.rejected += 1
            return DIVERGED_NORM
        return np.linalg.norm(self.residuals(x))

    def normal_equations(self, x):
        r, J = self.residuals(x), np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
        return J.T @ J, J.T @ r, self.norm(x)


@pytest.fixture(params=["lm", "trf"])
def method(request):
    return request.param


def test_rosenbrock(method):
    result = minimize(
        Rosenbrock(), np.array([-1.2, 1.0]), method=method, tol=1e-14, max_iter=200
    )
    np.testing.assert_allclose(result.x, 1.0, atol=1e-6)
    assert result.success
    assert result.cost < 1e-12


class Squared(LeastSquares):
    """r = [x1 - 1, x2^2 + 0.001]: of x2, only its square counts, best at zero."""

    def norm(self, x):
        return np.linalg.norm([x[0] - 1, x[1] ** 2 + 0.001])

    def normal_equations(self, x):
        r, J = np.array([x[0] - 1, x[1] ** 2 + 0.001]), np.diag([1.0, 2 * x[1]])
        return J.T @ J, J.T @ r, self.norm(x)


def test_a_parameter_of_faint_effect_does_not_hold_the_others_back(method):
    start, options = np.array([3.0, 1e-8]), {"method": method, "max_iter": 10}
    result = minimize(Squared(), start, tol=1e-9, faint=FAINT, **options)
    assert result.cost < 1e-3
    # else every step goes 25,000 times too far for x2, and is cut down for both
    assert minimize(Squared(), start, tol=1e-9, **options).cost > 1.0


def test_derivatives_that_are_not_faint_change_nothing():
    start, options = np.array([-1.2, 1.0]), {"tol": 1e-14, "max_iter": 200}
    plain = minimize(Rosenbrock(), start, **options)
    same = minimize(Rosenbrock(), start, faint=FAINT, **options)
    np.testing.assert_array_equal(plain.x, same.x)
    assert plain.nfev == same.nfev


def test_a_diverging_trial_is_rejected_and_the_search_goes_on(method):
    problem = Rosenbrock(floor=-1.0)  # the first Gauss-Newton step is (1, -15)
    result = minimize(
        problem, np.array([-3.0, 9.0]), method=method, tol=1e-14, max_iter=300
    )
    assert problem.rejected > 0
    np.testing.assert_allclose(result.x, 1.0, atol=1e-5)


def test_unstable_trials_of_a_simulation_do_not_end_the_training(method, rng):
    # A = 0.2 and y huge: Gauss-Newton overshoots to |A| > 1, which diverges
    structure = state_space(1, 1, 1)
    u = rng.standard_normal((3000, 1))
    y = np.zeros((3000, 1))
    for k in range(2999):
        y[k + 1] = 0.97 * y[k] + u[k]
    criterion = Criterion(structure, [(u, y)])
    trials = []
    norm = criterion.norm
    criterion.norm = lambda free: trials.append(norm(free)) or trials[-1]
    start = structure.join({"A": [[0.2]], "B": [[1.0]], "C": [[1.0]]})
    result = minimize(
        criterion, criterion.join(start, np.zeros((1, 1))), method=method, tol=1e-12
    )
    assert DIVERGED_NORM in trials
    assert result.cost < 1e-10
    assert result.x[0] == pytest.approx(0.97)


def test_max_iter_and_message(method):
    result = minimize(Rosenbrock(), np.array([-1.2, 1.0]), method=method, max_iter=3)
    assert result.nfev == 3
    assert not result.success
    assert (
        result.message == "stopped after all trial steps that its last stage may take"
    )


def test_a_search_ends_where_steps_hardly_lower_the_cost(method):
    def costs(settles):
        watch = Watch()
        options = {"method": method, "tol": 1e-14, "max_iter": 200, "watch": watch}
        result = minimize(Squared(), np.array([0.0, 1.0]), settles=settles, **options)
        return result, np.array([step.cost for step in watch.history])

    _, all_of_them = costs(None)
    result, found = costs((3, 0.5))
    assert result.success and result.message == TOO_SLOW
    assert 4 <= len(found) < len(all_of_them)
    np.testing.assert_array_equal(found, all_of_them[: len(found)])
    is_slow = found[3:] > 0.5 * found[:-3]
    assert is_slow[-1] and not is_slow[:-1].any()


def test_report_sees_falling_cost(method):
    calls = []
    minimize(
        Rosenbrock(),
        np.array([-1.2, 1.0]),
        method=method,
        watch=Watch(report=Heard(lambda *args: calls.append(args))),
        label="here",
    )
    assert {label for label, _, _ in calls} == {"here"}
    assert [i for _, i, _ in calls] == list(range(len(calls)))
    assert np.all(np.diff([cost for *_, cost in calls]) <= 0)


def test_diverging_start_is_an_error_with_a_remedy():
    with pytest.raises(ValueError, match=r"diverges from its initial.*stable `linear"):
        minimize(Rosenbrock(floor=2.0), np.array([-1.2, 1.0]))

import tracemalloc

import numpy as np
import pytest

from alssnn import GrSsnn, acceleration
from alssnn.acceleration import Accelerated
from alssnn.criterion import Criterion, LeastSquares, Restricted
from alssnn.innovations import predictor
from alssnn.limits import Limits
from alssnn.models import state_space
from alssnn.optimizers import minimize
from alssnn.stability import Contractive, Schur
from alssnn.watch import Watch
from helpers import random_theta, simulate_linear


class Valley(LeastSquares):
    """r = [steep (x2 - x1^2), 1 - x1]: a narrow, bent valley down to (1, 1)."""

    steep = 300.0

    def __init__(self):
        self.asked, self.passes = 0, 0

    def residuals(self, x):
        return np.array([self.steep * (x[1] - x[0] ** 2), 1 - x[0]])

    def jacobian(self, x):
        return np.array([[-2 * self.steep * x[0], self.steep], [-1.0, 0.0]])

    def norm(self, x):
        return np.linalg.norm(self.residuals(x))

    def normal_equations(self, x):
        self.passes += 1
        r, J = self.residuals(x), self.jacobian(x)
        return J.T @ J, J.T @ r, self.norm(x)

    def pulled(self, at, after):
        self.asked += 1
        return self.jacobian(at).T @ (self.residuals(after) - self.residuals(at))


START = np.array([-1.2, 1.44])


@pytest.mark.parametrize(
    ("damping", "bends"), [(1e-7, False), (1e-5, True), (1e-4, True)]
)
def test_a_step_is_bent_by_the_second_derivative(damping, bends):
    problem = Accelerated(Valley(), START)
    JJ, Jr, _ = problem.normal_equations(START)
    damped = JJ + damping * np.diag(np.diag(JJ))
    step = -np.linalg.solve(damped, Jr)
    second = np.array([-2 * Valley.steep * step[0] ** 2, 0.0])
    a = -np.linalg.solve(damped, Valley().jacobian(START).T @ second)
    size = np.sqrt(np.diag(JJ))
    length = np.linalg.norm(size * step)
    # far along the tangent the bend is longer than half of the step
    assert (np.linalg.norm(size * a) < length / 2) == bends
    expected = START + step + bends * a / 2
    got = problem.to_free(START + step)
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-4 * length / size[0])
    assert problem.norm(START + step) == Valley().norm(got)


def test_bent_steps_need_fewer_derivatives():
    passes = []
    for bends in (False, True):
        valley = Valley()
        options = {"tol": 1e-12, "max_iter": 2000, "bends": bends}
        result = minimize(valley, START, **options)
        np.testing.assert_allclose(result.x, 1.0, atol=1e-5)
        assert result.cost == valley.norm(result.x) ** 2
        assert (valley.asked > 0) == bends
        passes.append(valley.passes)
    assert passes[1] < 0.5 * passes[0]


@pytest.mark.parametrize("answer", [None, np.full(2, np.nan)])
def test_a_step_stays_straight_where_nothing_tells_the_bend(answer, monkeypatch):
    straight = minimize(Valley(), START, max_iter=20)
    monkeypatch.setattr(Valley, "pulled", lambda *_: answer)
    same = minimize(Valley(), START, max_iter=20, bends=True)
    np.testing.assert_allclose(same.x, straight.x, rtol=1e-9)
    assert same.nfev == straight.nfev


def test_a_step_stays_straight_where_the_matrix_has_no_factor(monkeypatch):
    problem = Accelerated(Valley(), START)
    problem.normal_equations(START)

    def fails(_):
        raise acceleration.LinAlgError

    monkeypatch.setattr(acceleration, "cho_factor", fails)
    step = np.array([0.01, 0.02])
    np.testing.assert_allclose(problem.to_free(START + step), START + step)


def test_a_point_that_was_asked_for_is_the_same_again():
    problem = Accelerated(Valley(), START)
    problem.normal_equations(START)
    x = START + np.array([0.02, -0.05])
    once = problem.to_free(x).copy()
    problem.normal_equations(x)  # steps begin elsewhere now
    np.testing.assert_array_equal(problem.to_free(x), once)
    np.testing.assert_array_equal(problem.to_free(START), START)


@pytest.mark.parametrize("step", [0.0, 1e-200])
def test_a_step_of_no_length_stays_straight(step):
    start = np.array([-0.0, 1.0])
    problem = Accelerated(Valley(), start)
    problem.normal_equations(start)
    x = np.array([step, 1.0])
    np.testing.assert_array_equal(problem.to_free(x), x)


def test_states_of_a_long_record_are_not_all_kept(monkeypatch, rng):
    structure = state_space(10, 1, 1, n_g=2, C=np.eye(1, 10))
    theta, x0 = 0.1 * random_theta(structure, rng), np.zeros((1, 10))
    monkeypatch.setattr("alssnn.adjoint.KEPT_BYTES", 320_000)  # of 2,000 samples
    peaks = []
    for n_samples in (8_000, 32_000):
        pair = rng.standard_normal((2, n_samples, 1))
        criterion = Criterion(structure, [tuple(pair)])
        free = criterion.join(theta, x0)
        criterion.pulled(free, free)
        tracemalloc.start()
        criterion.pulled(free, free + 1e-3)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0]


def test_what_watches_a_search_sees_its_parameters_not_its_coordinates():
    points, valley = [], Valley()

    class Looks(Watch):
        def step(self, label, i, cost, rmse, point):
            points.append((point, cost))

    minimize(valley, START, max_iter=30, bends=True, watch=Looks())
    assert len(points) > 5
    for point, cost in points:
        assert valley.norm(point) ** 2 == pytest.approx(cost, rel=1e-12)


def test_derivatives_that_overflow_are_a_rejected_step():
    class Cliff(Valley):
        """The valley, without derivatives beyond a line."""

        def normal_equations(self, x):
            if x[0] > 0.5:
                raise FloatingPointError
            return super().normal_equations(x)

    cliff = Cliff()
    result = minimize(cliff, START, max_iter=300, bends=True)
    assert result.x[0] <= 0.5
    assert cliff.norm(result.x) < 0.7
    assert result.cost == cliff.norm(result.x) ** 2


def mapped(criterion, kind, free):
    """Return a criterion behind a map, and its free vector."""
    if kind == "restricted":
        mask = np.arange(len(free)) % 3 > 0
        return Restricted(criterion, free, mask), free[mask]
    if kind == "schur":
        return Schur(criterion, 1.0), free
    problem = Contractive(criterion, 0.05)
    return problem, problem.from_free(free)


@pytest.mark.parametrize("noise", ["output", "innovations"])
@pytest.mark.parametrize("kind", ["restricted", "schur", "contractive"])
def test_what_is_pulled_back_through_a_map(kind, noise, rng):
    """It is the derivative of the map, transposed, on what the criterion says."""
    structure = state_space(2, 1, 1, n_g=3, C=np.ones((1, 2)), noise=noise)
    if noise == "innovations":
        structure = predictor(structure)
    record = [(rng.standard_normal((60, structure.nu)), rng.standard_normal((60, 1)))]
    criterion = Criterion(structure, record, alpha=0.01)
    theta = 0.5 * random_theta(structure, rng)
    free = criterion.join(theta, np.zeros((1, structure.n_x0)))
    problem, x = mapped(criterion, kind, free)
    step = 0.01 * rng.standard_normal(len(x))
    points = [problem.to_free(x + t * step) for t in (0, 1)]
    pulled = criterion.pulled(*points)
    J = np.empty((len(free), len(x)))
    for i, e in enumerate(1e-6 * np.eye(len(x))):
        J[:, i] = (problem.to_free(x + e) - problem.to_free(x - e)) / 2e-6
    got = problem.pulled(x, x + step)
    np.testing.assert_allclose(got, J.T @ pulled, rtol=1e-5, atol=1e-9)
    JJ, Jr, norm = criterion.normal_equations(points[0])
    ours = problem.normal_equations(x)
    np.testing.assert_allclose(ours[0], J.T @ JJ @ J, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(ours[1], J.T @ Jr, rtol=1e-5, atol=1e-8)
    assert ours[2] == pytest.approx(norm)


def test_a_fit_with_held_parameters_bends_the_others(rng):
    structure = state_space(2, 1, 1, n_g=4, C=np.ones((1, 2)))
    u = rng.standard_normal((300, 1))
    y = np.tanh(2 * simulate_linear([[0.8]], [[0.5]], [[1.0]], u))
    criterion = Criterion(structure, [(u, y)], alpha=1e-6)
    theta = 0.5 * random_theta(structure, rng)
    A = structure.split(theta)["A"]
    low, high = np.full((2, 2), -np.inf), np.full((2, 2), np.inf)
    low[0] = high[0] = A[0]
    limits = Limits(structure, bounds={"A": (low, high)})
    free = criterion.join(theta, np.zeros((1, 2)))
    costs = [
        limits.minimize(criterion, free, max_iter=25, bends=bends)
        for bends in (False, True)
    ]
    assert costs[1].cost < costs[0].cost
    np.testing.assert_array_equal(structure.split(costs[1].x[:-2])["A"][0], A[0])


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize(
    ("alpha", "n_samples", "expected"),
    [(1e-4, 300, True), ("auto", 300, False), ("auto", 4100, True)],
)
def test_which_fits_have_bent_steps(alpha, n_samples, expected, monkeypatch, rng):
    """All but those of a short record whose decay was chosen with straight steps."""
    asked, minimize = [], Limits.minimize

    def recorded(self, criterion, free, bends=False, **options):
        asked.append((options["label"], bends))
        return minimize(self, criterion, free, bends=bends, **options)

    monkeypatch.setattr(Limits, "minimize", recorded)
    u = rng.standard_normal((n_samples, 1))
    y = np.tanh(2 * simulate_linear([[0.8]], [[0.5]], [[1.0]], u))
    y += 0.01 * rng.standard_normal(y.shape)
    options = {"max_iter": 50, "n_init": 1, "random_state": 0, "warm_start": True}
    model = GrSsnn(nx=1, n_f=3, alpha=alpha, **options).fit(u, y)
    labels, bends = zip(*asked, strict=True)
    assert set(bends) == {expected}
    assert ("search" in labels) == (alpha == "auto")
    assert model.score(u, y) > 0.9
    asked.clear()
    model.fit(u, y)  # goes on as it began
    assert {bends for _, bends in asked} == {expected}

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, GrSsnn
from alssnn.criterion import Criterion
from alssnn.initial_states import estimate_x0
from alssnn.limits import Limits
from alssnn.linear_model import LinearModel
from alssnn.models import state_space
from alssnn.simulation import channels, simulate
from alssnn.stability import contractive_basis
from alssnn.starts import initial_theta
from alssnn.training import _start_of_stage, train
from alssnn.watch import Silent, Watch
from helpers import Heard, random_theta


@pytest.fixture
def problem(rng):
    """An FL system, its structure, true parameters and two noise-free records."""
    structure = state_space(2, 1, 1, n_h=2, C=np.array([[1.0, 0.5]]))
    theta = structure.join(
        {
            "A": [[0.7, 0.3], [-0.3, 0.6]],
            "B": [[0.5], [1.0]],
            "W_h": [[0.4, -0.5]],
            "W_y": [[1.0], [0.4]],
            "b_y": [0.3, -0.6],
        }
    )
    lure, experiments = structure.lure(theta), []
    for n in (300, 200):
        u, x0 = rng.standard_normal((n, 1)), rng.standard_normal(2)
        experiments.append((u, channels(lure, simulate(lure, u, x0), u)))
    return structure, theta, experiments


def linear_start(structure, theta):
    p = structure.split(theta)
    return LinearModel(
        p["A"], p["B"], structure.constants["C"], np.zeros((1, 1)), np.zeros((2, 2))
    )


def test_the_start_is_the_linear_model(problem, rng):
    structure, theta, experiments = problem
    linear = linear_start(structure, theta)
    start = initial_theta(structure, linear, experiments, rng)
    lure = structure.lure(start)
    assert np.any(lure.V)
    assert not np.any(lure.W)
    np.testing.assert_array_equal(structure.split(start)["A"], linear.A)


def test_inner_weights_are_spread_over_the_data(rng):
    structure = state_space(2, 1, 1, n_h=50, n_g=50, C=np.ones((1, 2)))
    linear = LinearModel(
        0.8 * np.eye(2),
        np.array([[0.6], [0.3]]),
        np.ones((1, 2)),
        np.zeros((1, 1)),
        np.zeros((1, 2)),
    )
    u = rng.standard_normal((500, 1))
    y = 5.0 + rng.standard_normal((500, 1))  # the neurons of h must follow y there
    start = initial_theta(structure, linear, [(u, y)], rng)
    p = structure.split(start)
    v_h = y @ p["W_y"].T + p["b_y"]
    crosses_zero = (v_h.min(axis=0) <= 0) & (v_h.max(axis=0) >= 0)
    assert crosses_zero.all()
    assert len(np.unique(p["b_x"])) == 50


def test_neurons_start_where_tanh_bends(rng):
    """Pre-activations have unit variance over the record, whatever they see."""
    structure = state_space(2, 1, 1, n_h=2000, n_g=2000, C=np.ones((1, 2)))
    A, B = (
        np.diag([0.8, -0.6]),
        np.array([[0.6], [0.8]]),
    )  # white u: x has unit variance
    linear = LinearModel(A, B, np.ones((1, 2)), np.zeros((1, 1)), np.zeros((1, 2)))
    u, y = rng.standard_normal((4000, 1)), rng.standard_normal((4000, 1))
    p = structure.split(initial_theta(structure, linear, [(u, y)], rng))
    X = np.stack(
        [
            lfilter([0, b], [1, -a], u[:, 0])
            for a, b in zip(np.diag(A), B[:, 0], strict=True)
        ],
        1,
    )
    for v in (y @ p["W_y"].T, X @ p["W_x"].T + u @ p["W_u"].T):
        assert np.sqrt(np.mean(v**2)) == pytest.approx(1.0, rel=0.1)


def test_exact_recovery_of_a_known_fl_system(problem, rng):
    structure, theta, experiments = problem
    start = theta + 0.1 * rng.standard_normal(len(theta))
    result = train(
        structure, experiments, [start], max_iter=200, tol=1e-15, method="lm"
    )
    assert result.cost < 1e-20
    fresh = rng.standard_normal((100, 1))
    outputs = []
    for parameters in (theta, result.theta):
        lure = structure.lure(parameters)
        outputs.append(channels(lure, simulate(lure, fresh, np.zeros(2)), fresh))
    np.testing.assert_allclose(*outputs, atol=1e-6)


def test_estimate_x0_finds_the_true_state(problem, rng):
    structure, theta, experiments = problem
    lure = structure.lure(theta)
    x0 = estimate_x0(structure, theta, experiments, window=30, noise=1e-14)
    for (u, y), start in zip(experiments, x0, strict=True):
        y_hat = channels(lure, simulate(lure, u, start), u)
        np.testing.assert_allclose(y_hat, y, atol=1e-7)


@pytest.mark.parametrize(("sample", "counts"), [(199, True), (200, False)])
def test_a_stage_takes_initial_states_from_200_samples(sample, counts):
    structure = state_space(1, 1, 1)
    theta = structure.join({"A": [[0.999]], "B": [[1.0]], "C": [[1.0]]})
    u, y = np.zeros((600, 1)), 0.999 ** np.arange(600.0)[:, None]
    other = y.copy()
    other[sample] *= -1  # as large as before: the noise of the prior is the same
    limits = SimpleNamespace(clip=lambda theta: theta, at_rest=False)
    starts = [
        _start_of_stage(Criterion(structure, [(u, z)]), theta, limits, None)[-1]
        for z in (y, other)
    ]
    assert starts[0] == pytest.approx(1.0, abs=0.02)  # but for the prior
    assert (abs(starts[1] - starts[0]) > 1e-3) == counts


def test_the_prior_keeps_unobservable_states_at_rest(rng):
    structure = state_space(2, 1, 1)
    p = {"A": np.diag([0.5, 0.999]), "B": [[1.0], [1.0]], "C": [[1.0, 1e-3]]}
    theta, lure = structure.join(p), structure.lure(structure.join(p))
    experiments = []
    for _ in range(20):
        u = rng.standard_normal((50, 1))
        y = channels(lure, simulate(lure, u, np.array([1.0, 0.0])), u)
        experiments.append((u, y + 0.1 * rng.standard_normal(y.shape)))
    spread = {
        noise: estimate_x0(structure, theta, experiments, window=50, noise=noise).std(0)
        for noise in (1e-2, 1e-12)
    }
    # least squares alone trusts the noise: 0.1 / (1e-3 sqrt(50)) = 14
    assert 7 < spread[1e-12][1] < 28
    assert spread[1e-2][1] < 0.3
    assert spread[1e-2][0] == pytest.approx(spread[1e-12][0], rel=0.2)


def test_a_long_record_has_a_stage_in_between(problem, rng):
    structure, theta, experiments = problem
    n_samples = sum(len(u) for u, _ in experiments)
    coarse = n_samples // 7
    watch = Watch()
    result = train(
        structure,
        experiments,
        [theta + 0.1 * rng.standard_normal(len(theta))],
        coarse_samples=coarse,
        polish_iter=2,
        max_iter=50,
        tol=1e-14,
        watch=watch,
        n_jobs=2,
    )
    steps = {}
    for step in watch.history:
        steps[step.label] = steps.get(step.label, 0) + 1
    assert list(steps) == [
        "stage 1/3, train",
        f"stage 2/3, {3 * coarse} samples",
        "stage 3/3, all samples",
    ]
    # as much work as two steps on all samples
    assert steps[f"stage 2/3, {3 * coarse} samples"] <= 2 * 7 / 3 + 1
    criterion = Criterion(structure, experiments)
    cost = criterion.norm(criterion.join(result.theta, result.x0)) ** 2
    assert cost == pytest.approx(result.cost)


@pytest.mark.parametrize("settles", [False, True])
def test_stages_before_the_last_settle(problem, rng, monkeypatch, settles):
    structure, theta, experiments = problem
    noisy = [(u, y + 0.1 * rng.standard_normal(y.shape)) for u, y in experiments]
    monkeypatch.setattr("alssnn.training.SETTLES", (2, 0.5))
    watch = Watch()
    train(
        structure,
        noisy,
        [theta + 0.1 * rng.standard_normal(len(theta))],
        coarse_samples=70,
        polish_iter=20,
        max_iter=50,
        tol=1e-14,
        watch=watch,
        settles=settles,
    )
    goes_on = {}
    for label in dict.fromkeys(step.label for step in watch.history):
        costs = np.array([step.cost for step in watch.history if step.label == label])
        is_slow = costs[2:] > 0.5 * costs[:-2]
        goes_on[label] = bool(is_slow[:-1].any())
    assert list(goes_on.values()) == [not settles, not settles, True]


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize(
    ("alpha", "coarse", "settles"),
    [("auto", 4050, True), ("auto", 5000, False), (1e-4, 4050, False)],
)
def test_two_of_three_stages_settle_behind_a_search(
    alpha, coarse, settles, monkeypatch, rng
):
    """A random start is a saddle, where the cost falls late."""
    asked, minimize = {}, Limits.minimize

    def recorded(self, criterion, free, settles=None, **options):
        asked[options["label"]] = settles is not None
        return minimize(self, criterion, free, settles=settles, **options)

    monkeypatch.setattr(Limits, "minimize", recorded)
    u, y, x = rng.standard_normal(24_400), np.empty(24_400), 0.0
    for k, u_k in enumerate(u):
        y[k] = x
        x = 0.8 * x + u_k - 0.5 * np.tanh(2 * x)
    options = {"max_iter": 36, "n_init": 1, "coarse_samples": coarse, "random_state": 0}
    GrSsnn(nx=1, n_f=2, alpha=alpha, **options).fit(u, y)
    *first, _ = (label for label in asked if label.startswith("stage"))
    assert len(first) == (1 if coarse == 5000 else 2)
    assert all(asked.pop(label) == settles for label in first)
    assert not any(asked.values())  # of the last, the search, and the linear start


def test_coarse_to_fine_ends_on_all_samples(problem, rng):
    structure, theta, experiments = problem
    labels = []
    result = train(
        structure,
        experiments,
        [theta + 0.1 * rng.standard_normal(len(theta))],
        coarse_samples=200,
        polish_iter=50,
        max_iter=50,
        tol=1e-14,
        watch=Watch(report=Heard(lambda label, *_: labels.append(label))),
    )
    assert sorted(set(labels)) == ["stage 1/2, train", "stage 2/2, all samples"]
    assert result.x0.shape == (2, 2)
    criterion = Criterion(structure, experiments)
    cost = criterion.norm(criterion.join(result.theta, result.x0)) ** 2
    assert cost == pytest.approx(result.cost)
    assert cost < 1e-15


@pytest.mark.parametrize("n_jobs", [None, 2])
def test_the_best_of_several_starts_goes_on(problem, rng, n_jobs):
    structure, _, experiments = problem
    starts = [random_theta(structure, rng) for _ in range(3)]
    costs = [
        train(structure, experiments, [start], max_iter=8, tol=1e-9).cost
        for start in starts
    ]
    best = train(structure, experiments, starts, max_iter=8, tol=1e-9, n_jobs=n_jobs)
    assert best.cost == min(costs)
    assert len(set(costs)) == 3


@pytest.fixture
def penalized(rng):
    """A structure with g, a linear start and a mildly nonlinear record."""
    structure = state_space(2, 1, 1, n_h=2, n_g=2, C=np.array([[1.0, 0.5]])).observe(
        "y", "e"
    )
    A, B = np.array([[0.7, 0.3], [-0.3, 0.6]]), np.array([[0.5], [1.0]])
    u, x, y = rng.standard_normal((400, 1)), np.zeros(2), np.empty((400, 1))
    for k in range(400):
        y[k] = structure.constants["C"] @ x
        x = A @ x + B @ u[k] + 0.1 * np.tanh(x) ** 2
    linear = LinearModel(
        A, B, structure.constants["C"], np.zeros((1, 1)), np.zeros((1, 2))
    )
    return structure, linear, [(u, y)]


def test_continuation_goes_down_in_half_decades(penalized, rng, monkeypatch):
    structure, linear, experiments = penalized
    gammas = []
    original = Criterion.__init__

    def record(self, *args, **options):
        gammas.append((options.get("weights") or {}).get("e"))
        original(self, *args, **options)

    monkeypatch.setattr(Criterion, "__init__", record)
    start = initial_theta(structure, linear, experiments, rng)
    calls = []
    result = train(
        structure,
        experiments,
        [start],
        weights={"y": 1.0, "e": 0.1},
        continuation=2,
        max_iter=5,
        watch=Watch(report=Heard(lambda *args: calls.append(args))),
    )
    np.testing.assert_allclose(gammas[:3], [1.0, 0.1 * np.sqrt(10), 0.1])
    assert [label for label, iteration, _ in calls if iteration == 0] == [
        "stage 1/3, gamma 1",
        "stage 2/3, gamma 0.316",
        "stage 3/3, gamma 0.1",
    ]
    assert result.nfev <= 15


def test_continuation_is_of_all_penalties(penalized, rng, monkeypatch):
    structure, linear, experiments = penalized
    seen = []
    original = Criterion.__init__

    def record(self, *args, weights=None, **options):
        seen.append(weights)
        original(self, *args, weights=weights, **options)

    monkeypatch.setattr(Criterion, "__init__", record)
    weights = {"y": np.array([2.0]), "v": 0.1, "h": 0.2}
    train(
        structure.observe(*weights),
        experiments,
        [initial_theta(structure, linear, experiments, rng)],
        weights=weights,
        continuation=2,
        max_iter=2,
        watch=(watch := Watch()),
    )
    assert [seen[0][c] for c in "yvh"] == pytest.approx([2.0, 1.0, 2.0])
    assert watch.history[0].label == "stage 1/3, gammas x 10"


@pytest.mark.parametrize("phi", [0.0, 0.2])
def test_contractive_training_keeps_the_lyapunov_inequality(penalized, rng, phi):
    structure, linear, experiments = penalized
    linear = contractive_basis(linear, phi)
    structure = state_space(2, 1, 1, n_h=2, n_g=2, C=linear.C).observe("y", "e")
    start = initial_theta(structure, linear, experiments, rng)
    result = train(
        structure,
        experiments,
        [start],
        weights={"y": 1.0, "e": 0.1},
        phi=phi,
        max_iter=30,
        tol=1e-9,
    )
    A = structure.split(result.theta)["A"]
    # P = I: A'A - (1 - phi) I is negative semidefinite
    assert np.linalg.eigvalsh(A.T @ A - (1 - phi) * np.eye(2)).max() < 1e-12
    first = Criterion(structure, experiments, weights={"y": 1.0, "e": 0.1})
    assert result.cost < 0.1 * first.norm(first.join(start, np.zeros((1, 2)))) ** 2


def test_a_start_that_diverges_on_the_whole_record_is_reflected(rng):
    structure = state_space(1, 1, 1, n_g=1, C=np.ones((1, 1))).observe("y", "e")
    u = rng.standard_normal((20_000, 1))
    y = np.zeros((20_000, 1))
    for k in range(len(u) - 1):
        y[k + 1] = 0.9 * y[k] + u[k]
    start = structure.join({"A": [[1.01]], "B": [[1.0]], "W_x": [[1.0]]})
    result = train(
        structure,
        [(u, y)],
        [start],
        weights={"y": 1.0, "e": 0.1},
        max_iter=20,
        tol=1e-12,
    )
    assert result.cost < 1e-6
    assert abs(structure.split(result.theta)["A"][0, 0]) < 1


def test_workers_use_one_blas_thread(problem, rng, tmp_path):
    structure, _, experiments = problem
    starts = [random_theta(structure, rng) for _ in range(2)]

    class Threads(Silent):
        def step(self, label, iteration, cost):
            import os

            from threadpoolctl import threadpool_info

            threads = [
                p["num_threads"] for p in threadpool_info() if p["user_api"] == "blas"
            ]
            with open(tmp_path / str(os.getpid()), "a") as file:
                print(*threads, sep="\n", file=file)

    watch = Watch(report=Threads())
    train(structure, experiments, starts, max_iter=4, n_jobs=2, watch=watch)
    lines = [int(n) for path in tmp_path.iterdir() for n in path.read_text().split()]
    assert lines and set(lines) == {1}


@pytest.mark.parametrize("missing", [False, True])
def test_threads_over_experiments_change_no_digit(problem, missing):
    structure, theta, experiments = problem
    if missing:
        experiments[0][1][3] = np.nan
    one, two = (
        Criterion(structure, experiments, n_jobs=n_jobs) for n_jobs in (None, 2)
    )
    free = one.join(theta, np.ones((2, 2)))
    for a, b in zip(
        one.normal_equations(free), two.normal_equations(free), strict=True
    ):
        np.testing.assert_array_equal(a, b)
    assert one.norm(free) == two.norm(free)


@pytest.mark.parametrize("cls", [AlSsnn, GrSsnn])
def test_a_large_alpha_is_reached_from_a_small_one(cls):
    """From random networks it would lead to the linear model, with an error of 0.28."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, 80), 4)
    x, y = 0.0, np.empty(320)
    for k in range(320):
        y[k] = x
        x = 0.8 * x + 0.3 * np.tanh(3 * u[k])
    costs = []
    for seed in range(2):
        model = cls(nx=1, alpha=0.01, n_init=1, random_state=seed).fit(u, y)
        assert np.sqrt(1 - model.score(u, y)) < 0.1
        assert "alpha 0.0001" in {step.label for step in model.history_}
        costs.append(model.cost_)
    assert costs[0] == pytest.approx(costs[1], rel=1e-2)
    model.set_params(warm_start=True).fit(u, y)  # goes on, without the small one
    assert model.n_iter_ < 20 and model.cost_ <= 1.001 * costs[1]
    both = cls(nx=1, alpha=0.01, n_init=2, n_jobs=2, random_state=0).fit(u, y)
    assert both.cost_ == pytest.approx(costs[0], rel=1e-2)
    assert "start 1/2, alpha 0.0001" in {step.label for step in both.history_}
    # a start that keeps its networks is not trained again
    kept = cls(nx=1, alpha=1e-3, n_init=1, random_state=1).fit(u, y)
    assert {step.label for step in kept.history_} == {"linear", "train"}


@pytest.mark.parametrize("cls", [AlSsnn, GrSsnn])
def test_a_decay_that_leaves_nothing_is_told(cls):
    rng = np.random.default_rng(0)
    u = rng.standard_normal(200)
    y = lfilter([0, 1], [1, -0.8], u)
    with pytest.warns(ConvergenceWarning, match=r"alpha=10 .* all but linear"):
        model = cls(nx=1, alpha=10.0, n_init=1, random_state=0).fit(u, y)
    assert model.score(u, y) > 0.999  # as the linear model

"""The search for order, start and decay: what it finds, and what it leaves alone."""

import copy
import pickle
import warnings
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace, network_orders
from alssnn import paths as walking
from alssnn import search as searching
from alssnn.criterion import Criterion
from alssnn.datasets import make_pendulum
from alssnn.descent import ALPHAS, FADING, LONG, SMOOTH, USUAL, Descent, is_gone
from alssnn.estimators import _horizon, _safe, _ssnn
from alssnn.excursions import Excursion
from alssnn.holdout import Fold, certainty
from alssnn.limits import Limits
from alssnn.models import state_space
from alssnn.network_orders import Way
from alssnn.optimizers import minimize
from alssnn.orders import Orders, compare_orders
from alssnn.search import Found, Recipe, search
from alssnn.starts import initial_theta
from alssnn.training import train
from alssnn.watch import BY_OBSERVER, INTERRUPTED, OUT_OF_TIME, Watch
from helpers import simulate_linear

CLASSES = {
    "fl": (FlSsnn, {"n_h": 3, "n_init": 2}),  # one class is enough for several starts
    "al": (AlSsnn, {"n_h": 3, "n_g": 3, "n_init": 1}),
    "gr": (GrSsnn, {"n_f": 4, "n_init": 1}),
}
LINEAR = "networks do not help: this is the linear model"
# the search for integrators comes before, and would take half of the time
QUICK = {"nx": 1, "integrators": 0, "max_iter": 25, "random_state": 0}


def twin(seed, n=1500, noise=0.1):
    """Return a record of x+ = 0.8 x + u + 0.5 tanh(3 x), steps of five samples.

    The slope of the plant is 2.3 about rest and 0.8 far from it: it has two equilibria,
    and the linear model explains four fifths of its variance.
    """
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 5), 5)
    x, y = 0.0, np.empty(n)
    for k in range(n):
        y[k] = x
        x = 0.8 * x + u[k] + 0.5 * np.tanh(3 * x)
    return u[:, None], y + noise * rng.standard_normal(n)


def soft(seed, n=400):
    """Return a record of x+ = 0.8 x + u - 0.5 tanh(x), which is found quickly."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1, 1, n // 5), 5)
    x, y = 0.0, np.empty(n)
    for k in range(n):
        y[k] = x
        x = 0.8 * x + u[k] - 0.5 * np.tanh(x)
    return u[:, None], y + 0.02 * rng.standard_normal(n)


def linear_plant(seed, n=600, noise=0.3):
    """Return a record of a linear plant of two states in white noise."""
    rng = np.random.default_rng(seed)
    A, B = np.array([[0.7, 0.3], [-0.3, 0.7]]), np.array([1.0, 0.5])
    u, x, y = rng.standard_normal((n, 1)), np.zeros(2), np.empty(n)
    for k in range(n):
        y[k] = x[0]
        x = A @ x + B * u[k]
    return u, y + noise * rng.standard_normal(n)


def quietly(model, *data, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(*data, **options)


def make(kind, **options):
    cls, sizes = CLASSES[kind]
    return cls(**{**sizes, **QUICK, **options})


@pytest.fixture(scope="module")
def short():
    """A short record, on which a search takes a second."""
    return soft(0)


@pytest.fixture(scope="module")
def fitted(short):
    return quietly(make("fl"), *short)


# -- what it is for ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("cls", "options"),
    [
        (FlSsnn, {}),
        # the others from one start, which takes half of the time
        pytest.param(AlSsnn, {"n_init": 1}, marks=pytest.mark.slow),
        pytest.param(GrSsnn, {"n_init": 1}, marks=pytest.mark.slow),
    ],
    ids=["FlSsnn", "AlSsnn", "GrSsnn"],
)
def test_default_networks_beat_the_linear_model_on_fresh_records(cls, options):
    record, fresh = twin(0), twin(1)
    linear = LinearStateSpace(2).fit(*record).score(*fresh)
    assert linear < 0.85
    model = quietly(cls(2, random_state=0, **options), *record)
    # the noise of 0.1 leaves an R2 of 1 - 0.01 / 9
    assert model.score(*fresh) > 0.99
    assert model.train_score_ == pytest.approx(model.score(*record), abs=1e-3)
    assert np.isfinite(model.alpha_) and list(model.orders_["networks"]) == [2]


@pytest.mark.parametrize("kind", CLASSES)
def test_a_linear_plant_keeps_its_linear_model(kind):
    u, y = linear_plant(0)
    linear = LinearStateSpace(2, tol=1e-8).fit(u, y)
    model = make(kind, nx=2)
    with pytest.warns(ConvergenceWarning, match="the linear model, which is returned"):
        model.fit(u, y)
    assert LINEAR in model.message_
    assert model.alpha_ == np.inf and model.converged_
    np.testing.assert_allclose(model.predict(u), linear.predict(u), rtol=1e-6)
    fresh = linear_plant(1)
    assert model.score(*fresh) == pytest.approx(linear.score(*fresh), rel=0.01)
    for name in ("W_h", "W_g"):
        assert not np.any(model.params_.get(name, 0.0))


@pytest.mark.parametrize(
    ("pole", "options", "says"),
    [(0.95, {}, True), (0.95, {"integrators": 0}, False), (0.5, {}, False)],
)
def test_a_slow_plant_is_asked_whether_it_integrates(pole, options, says):
    rng = np.random.default_rng(1)
    u = rng.standard_normal(300)
    y = lfilter([0, 1], [1, -pole], u) + 0.1 * rng.standard_normal(300)
    model = FlSsnn(1, n_init=1, max_iter=50, random_state=0, **options)
    with pytest.warns(ConvergenceWarning, match="is returned") as caught:
        model.fit(u, y)
    assert ("set integrators=1" in str(caught[0].message)) == says


def test_the_warning_is_at_the_line_of_the_user():
    model, data = make("fl", nx=2), linear_plant(0, 200)
    with pytest.warns(ConvergenceWarning, match="is returned") as caught:
        model.fit(*data)
    assert [w.filename for w in caught] == [__file__]
    model.set_params(alpha=0.0, max_iter=1)
    with pytest.warns(ConvergenceWarning, match="stopped after") as caught:
        model.fit(*data)
    assert {w.filename for w in caught} == {__file__}


def test_a_number_of_alpha_searches_nothing(short, monkeypatch):
    monkeypatch.setattr(searching, "hold_out", pytest.fail, raising=False)
    monkeypatch.setattr("alssnn.estimators._ssnn.search", pytest.fail)
    for name in ("compare_orders", "compare_down"):
        monkeypatch.setattr(f"alssnn.estimators._candidates.{name}", pytest.fail)
    model = quietly(make("fl", alpha=1e-3), *short)
    assert model.alpha_ == 1e-3 and model.orders_ == {}
    assert "start 2/2" in {step.label for step in model.history_}


def test_a_search_is_no_part_of_the_history(fitted):
    assert {step.label for step in fitted.history_} == {"linear", "train"}
    assert fitted.alpha_ in ALPHAS


# -- the path ------------------------------------------------------------------------


def recipe(n_h=3):
    """Return how linear models become models with h, without an estimator."""

    def declare(linear):
        structure = state_space(
            len(linear.A), 1, 1, n_h=n_h, C=linear.C, feedback="state"
        )
        return linear, structure, structure, {"y": 1.0}

    def start(structure, linear, experiments, seed):
        rng = np.random.default_rng(seed)
        return initial_theta(structure, linear, experiments, rng)

    return Recipe(declare, start, Limits)


def scaled(u, y):
    y = y[:, None]
    return [((u - u.mean()) / u.std(), (y - y.mean()) / y.std())]


@cache
def compared(*orders):
    """Return the orders of the short record, compared, which no test changes."""
    return compare_orders(scaled(*soft(0)), orders)


def walk(
    orders, bounds=(np.inf,) * 3, center="start", is_predictor=False, steps=20, tol=1e-6
):
    """Return the start of a path of order 1."""
    return searching.Path(
        recipe(),
        orders.folds,
        orders.models[1],
        0,
        Descent(stages=1, center=center),
        {"method": "lm", "max_iter": steps, "tol": tol},
        weight=None,
        bounds=bounds[: len(orders.folds)],
        excursions=searching._excursions(orders, is_predictor),
    )


@pytest.mark.parametrize(
    ("bound", "elsewhere", "counts"),
    [(1.0, 0.9, False), (1.0, 1.1, True), (1e-4, 1.1, False)],
)
def test_an_error_from_elsewhere_counts_beyond_a_bound(
    monkeypatch, bound, elsewhere, counts
):
    """Unless the error of the fold is as large already."""
    orders = compared(1)
    real = Fold.error

    def told(*point, **where):
        return elsewhere if where.get("elsewhere") else real(*point)

    monkeypatch.setattr(Fold, "error", told)
    (errors,) = walk(orders, bounds=(bound,) * 3).errors
    expected = elsewhere if counts else orders.errors[1]
    np.testing.assert_allclose(errors, expected, rtol=1e-9)
    assert searching._bounds(orders, None) == [4 * elsewhere] * 3  # twice the root


@pytest.mark.parametrize(
    ("errors", "leads", "asked", "scores"),
    [
        # the second comes no lower than the first, wherever it leads
        ([2.0, 3.0, 1.0], [False, True], [2.0, 1.0], [2.0, 3.0, 4.0]),
        # the first counts fourfold, so that the second may be chosen
        ([2.0, 3.0, 1.0], [True, False, True], [2.0, 3.0, 1.0], [8.0, 3.0, 4.0]),
    ],
)
def test_stages_that_may_be_chosen_are_asked_where_they_lead(
    monkeypatch, errors, leads, asked, scores
):
    """The start is none of them: it may be lower, and is not chosen."""
    path = walk(compared(1))
    n, given, seen = len(path.folds), iter(leads), []
    path.scores[0] = 0.0
    for error in errors:
        monkeypatch.setattr(Fold, "error", lambda *_, e=error, **__: e)
        monkeypatch.setattr(
            path, "_leaves", lambda e=error: seen.append(e) or next(given)
        )
        path._judge()
    assert seen == asked
    np.testing.assert_allclose(path.scores[1:], n * np.array(scores))


def test_what_the_cost_asks_counts_where_paths_are_compared(monkeypatch):
    """Not where they are compared with the linear model."""
    errors = walk(compared(1)).errors[0]
    monkeypatch.setattr(Fold, "asked", lambda *_: 0.25)
    path = walk(compared(1))
    np.testing.assert_array_equal(path.errors[0], errors)
    assert path.scores[0] == pytest.approx(errors.sum() + 0.25 * len(errors))


def test_a_large_alpha_leaves_the_linear_model():
    orders = compared(1)
    path = walk(orders)
    path.descend([1e8], Watch())
    before, after = (np.sqrt(errors.sum()) for errors in path.errors)
    assert after == pytest.approx(before, rel=1e-3)
    np.testing.assert_allclose(path.errors[0], orders.errors[1], rtol=1e-9)
    for (theta, _), start in zip(path.points, path.centers, strict=True):
        structure = path.problems[0][0]
        moved, held = structure.split(theta), structure.split(start)
        for name in structure.network_parameters:
            np.testing.assert_allclose(moved[name], held[name], atol=1e-4)


def test_a_decay_to_zero_takes_the_networks_away():
    orders = compared(1)
    path = walk(orders, center="zero", steps=50, tol=1e-9)
    path.descend([1e2], Watch())
    for theta, _ in path.points:
        structure = path.problems[0][0]
        p = structure.split(theta)
        for name in structure.network_parameters:
            np.testing.assert_allclose(p[name], 0.0, atol=1e-3)


def test_where_networks_were_taken_away_a_path_begins_anew():
    """The linear model is a saddle, at which a smaller decay would change nothing."""
    orders = compared(1)
    alone, behind, above = (walk(orders, center="zero", tol=1e-9) for _ in range(3))
    alone.descend([1e-4], Watch())
    behind.descend([1e2, 1e-4], Watch())
    np.testing.assert_allclose(behind.errors[-1], alone.errors[-1], rtol=1e-9)
    assert behind.errors[-1].sum() < 0.25 * behind.errors[1].sum()
    above.descend([1e-4, 1e-4], Watch())  # what is there goes on
    costs = [
        Criterion(path.problems[0][0], orders.folds[0].fitted).norm(
            np.concatenate([path.points[0][0], path.points[0][1].ravel()])
        )
        for path in (above, alone)
    ]
    assert costs[0] < costs[1]


@pytest.mark.parametrize(
    ("left", "gone"), [({}, True), ({"b_h": 0.5}, True), ({"W_h": 0.5}, False)]
)
def test_networks_are_gone_where_their_biases_alone_are_left(left, gone):
    """A bias of the output is no network, and stays at a decay that takes all else."""
    path = walk(compared(1))
    structure, start = path.problems[0][0], path.points[0][0]
    p = structure.split(start)
    now = {n: v * (n not in structure.network_parameters) for n, v in p.items()}
    now |= {name: np.full_like(p[name], value) for name, value in left.items()}
    assert is_gone(structure, structure.join(now), start) is gone


@pytest.mark.parametrize(("error", "scale"), [(1e-4, 0.01), (0.01, 1.0), (0.5, 1.0)])
def test_a_decay_to_zero_is_small_for_a_small_linear_error(monkeypatch, error, scale):
    orders = compared(1)
    orders = replace(orders, errors={1: np.array([0.5, 1.0, 1.5]) * error})
    walked = told(monkeypatch, [[1, 0.9]], [11])
    search(recipe(), orders, [1], [11], max_iter=60, descents=[SMOOTH])
    alphas, enough = walked[0].asked
    np.testing.assert_allclose(alphas, scale * np.array(SMOOTH.alphas))
    assert enough == pytest.approx(scale * 1e-4)
    assert not walked[0].centers[0].any()


def test_smaller_alphas_fit_more():
    orders = compared(1)
    path = walk(orders)
    path.descend(ALPHAS[:6], Watch())
    costs = []
    for points in path.states:
        theta, x0 = points[0]
        criterion = Criterion(path.problems[0][0], orders.folds[0].fitted)
        costs.append(criterion.norm(criterion.join(theta, x0)))
    assert np.all(np.diff(costs) < 1e-9)
    assert path.errors[-1].sum() < path.errors[0].sum() / 4
    # what it keeps is the cost, that of the decay included, on what a fold fits
    kept, (theta, x0) = np.array(path.costs), path.states[-1][0]
    decay = {"alpha": ALPHAS[5], "center": path.centers[0]}
    _, penalized, weights, _ = path.problems[0]
    fitted = orders.folds[0].fitted
    criterion = Criterion(penalized, fitted, weights=weights, **decay)
    assert kept.shape == (6, 3) and np.all(kept[:, 0] >= costs[1:])
    assert kept[-1, 0] == pytest.approx(criterion.norm(criterion.join(theta, x0)))


class Walked:
    """Stand in for a path of one fold that was walked."""

    folds = (None,)

    def __init__(self, alphas, errors):
        self.alphas = list(alphas)
        self.errors = [np.array([error]) for error in errors]
        self.scores = list(errors)


@pytest.mark.parametrize(
    ("errors", "stage"),
    [
        ((1.0, 0.29, 0.28), 1),  # lower, and its larger alpha does nearly as well
        ((1.0, 0.4, 0.29), 2),
        ((1.0, 0.4, 0.31), None),  # not lower
    ],
)
def test_the_path_that_chose_an_order_is_taken_if_it_comes_lower(errors, stage):
    paths = [Walked([3, 2, 1], row) for row in ((1, 0.5, 0.3, 0.3), (1, 0.9, 0.9, 0.9))]
    other = Walked([3, 1], errors)
    expected = (paths[0], 2) if stage is None else (other, stage)
    assert walking.lowest([*paths, other], 1.1) == [expected]


def test_a_path_that_was_walked_to_choose_an_order_is_not_walked_again(monkeypatch):
    """Along the usual alphas it is another one, along those to zero the same."""
    orders, seeds = compared(1, 2), [11, 22]
    descend, walked = searching.Path.descend, []

    def recorded(self, alphas, *rest, **options):
        walked.append((self, list(alphas)))
        return descend(self, alphas, *rest, **options)

    monkeypatch.setattr(searching.Path, "descend", recorded)
    for descent in (replace(SMOOTH, center="start"), USUAL):
        walked.clear()
        found = search(recipe(), orders, [1, 2], seeds, descents=[descent], max_iter=20)
        nx = found.structure.sizes["x"]
        of_order = [
            (path, alphas)
            for path, alphas in walked
            if path.problems[0][0].sizes["x"] == nx
        ]
        of_path = {}
        for path, alphas in of_order:
            of_path.setdefault(id(path), []).extend(alphas)
        n = len(descent.alphas)  # but for what goes on at the end
        complete = [alphas for alphas in of_path.values() if len(alphas) >= n]
        along = [alphas for alphas in complete if alphas[:n] == list(descent.alphas)]
        in_one_go = [alphas for _, alphas in of_order if len(alphas) == n]
        assert len(along) == 2  # one per seed
        assert len(in_one_go) == 2 if descent is USUAL else len(in_one_go) < 2


@pytest.mark.parametrize(
    ("table", "stage", "start"),
    [
        # errors along the paths of three starts: the linear model, then one per alpha.
        # 0.51 is within 10 % of the least, 0.5
        ([[1, 0.6, 0.51, 0.5], [1, 0.6, 0.51, 0.5], [1, 0.9, 0.9, 0.1e3]], 2, 0),
        ([[1, 0.6, 0.56, 0.5], [1, 0.6, 0.56, 0.5], [1, 0.9, 0.9, 0.9]], 3, 0),
        # of the starts, the one that comes lowest
        ([[1, 0.5, 0.50, 0.9], [1, 0.4, 0.30, 0.9], [1, 0.9, 0.9, 0.9]], 2, 1),
        # nothing helps: what does least harm, which `Found.helps` refuses
        ([[1, 1.1, 2.0, 3.0], [1, 1.2, 2.0, 3.0], [1, 1.0, 1.0, 1.1]], 1, 2),
        # also where all others do worse: an average over the better ones stopped early
        ([[1, 0.9, 2.0, 3.0], [1, 0.9, 3.0, 3.0], [1, 0.95, 3.0, 0.8]], 3, 2),
    ],
)
def test_the_largest_alpha_that_does_nearly_as_well(monkeypatch, table, stage, start):
    orders = compared(1)
    seeds, fold = [11, 22, 33], start  # any fold may have the best parameters
    told(monkeypatch, table, seeds, fold)
    found = search(recipe(), orders, [1], seeds, max_iter=10)
    assert found.alpha == ALPHAS[stage - 1]
    assert found.errors.sum() == pytest.approx(table[start][stage])
    assert found.fold is orders.folds[fold]
    linear = orders.models[1][fold]
    centre = recipe().start(found.structure, linear, found.fold.fitted, seeds[start])
    np.testing.assert_array_equal(found.center, centre)
    np.testing.assert_array_equal(found.theta, centre + stage)


@pytest.mark.parametrize("to_zero", [0.8, 0.4])
def test_the_lowest_path_of_all_descents_is_taken(monkeypatch, to_zero):
    orders, seeds = compared(1), [11, 22]
    descents = USUAL, FADING
    zero = [[1, 0.9, 0.9], [1, 0.9, to_zero]]
    walked = told(monkeypatch, [[1, 0.5, 0.9], [1, 0.9, 0.9]], seeds, zero=zero)
    found = search(recipe(), orders, [1], seeds, descents=descents, max_iter=60)
    scale = min(1.0, orders.errors[1].mean() / 0.01)
    expected = [USUAL] * 2 + [FADING.times(scale)] * 2
    assert [path.descent for path in walked] == expected
    assert [path.asked[0] for path in walked] == [list(d.alphas) for d in expected]
    path, stage = (walked[3], 2) if to_zero < 0.5 else (walked[0], 1)
    assert found.alpha == path.descent.alphas[stage - 1]
    assert found.center.any() == (path is walked[0])
    # what follows has steps of a stage of this path
    assert found.refit_iter == searching.REFIT * path.descent.steps(60)


def told(monkeypatch, table, seeds, fold=0, zero=None, further=None):
    """Have paths whose errors are told: one row per seed, one column per stage.

    Those of a decay to zero have a table of their own. What they reach when they go on
    is one more row per seed.
    """

    class Path(searching.Path):
        def __init__(self, recipe, folds, linears, seed, *of, **common):
            super().__init__(recipe, folds, linears, seed, *of, **common)
            own = zero if zero and self.descent.center == "zero" else table
            self.row, self.seed = own[seeds.index(seed)], seed

        def descend(self, alphas, watch, tell=None):
            n_folds, self.asked = len(self.folds), (list(alphas), self.descent.enough)
            self.alphas = list(alphas)
            self.errors = [np.full(n_folds, error / n_folds) for error in self.row]
            self.scores = list(self.row)
            self.states = [
                [(theta + i, x0) for theta, x0 in self.points]
                for i in range(len(self.row))
            ]
            self.has_ended = True
            walked.append(self)
            return self

        def go_on(self, stage, alpha, *args):
            assert alpha == self.alphas[stage - 1]
            if further is None:
                return stage
            went_on.append(self)
            kept, more = slice(0, stage + 1), further[seeds.index(self.seed)]
            n_folds = len(self.folds)
            self.scores = [*self.scores[kept], *more]
            self.errors = [np.full(n_folds, z / n_folds) for z in self.scores]
            self.states = [*self.states[kept], *(self.states[stage] for _ in more)]
            self.alphas = [*self.alphas[:stage], *(alpha for _ in more)]
            return stage + int(np.argmin(self.scores[stage:]))

        def best_fold(self, stage, alpha, watch):
            assert alpha == self.alphas[stage - 1]
            return fold

    walked: list = []
    went_on = told.went_on = []
    monkeypatch.setattr(searching, "Path", Path)
    return walked


@pytest.mark.parametrize(
    ("finalists", "further", "taken", "went"),
    [
        # the lowest had not come to rest, and the fit that follows would go on as well
        (3, [[0.5, 0.45], [0.38, 0.37], [0.1, 0.1]], 1, 2),
        (2, [[0.5, 0.45], [0.46, 0.47], [0.1, 0.1]], 0, 2),
        # one more stage is not as many as that fit takes
        (2, [[0.2, 0.50, 0.52], [0.4, 0.45], [0.1, 0.1]], 1, 2),
        # it keeps nearly what it had: no other one goes on, wherever it would end
        (3, [[0.5, 0.32], [0.1, 0.1], [0.1, 0.1]], 0, 1),
        # stopped before it has taken as many
        (2, [[0.2], [0.1], [0.1]], 0, 1),
        (1, [[0.5, 0.45], [0.38, 0.37], [0.1, 0.1]], 0, 1),
        # the third is not near the others: it does not go on
        (9, [[0.5, 0.45], [0.46, 0.47], [0.1, 0.1]], 0, 2),
    ],
)
def test_of_low_paths_the_one_that_ends_lowest_if_the_lowest_does_not_rest(
    monkeypatch, finalists, further, taken, went
):
    orders, seeds = compared(1), [11, 22, 33]
    table = [[1, 0.3, 0.9], [1, 0.9, 0.4], [1, 0.9, 0.8]]
    told(monkeypatch, table, seeds, further=further)
    descents = [replace(USUAL, finalists=finalists)]
    found = search(recipe(), orders, [1], seeds, descents=descents, max_iter=10)
    assert len(told.went_on) == went
    # judged by what it had before it went on
    assert found.errors.sum() == pytest.approx(table[taken][1 + taken])
    assert found.alpha == ALPHAS[taken]
    least = np.sqrt(min(table[taken][1 + taken], *further[taken]) / 3)
    assert found.curve[1] == pytest.approx(least)


def test_the_path_of_a_long_record_does_not_go_on(monkeypatch):
    orders, seeds = compare_orders(scaled(*soft(0, 4100)), [1]), [11, 22]
    assert len(orders.folds) == 1
    told(monkeypatch, [[1, 0.3], [1, 0.4]], seeds, further=[[0.5, 0.5], [0.1, 0.1]])
    descents = [replace(USUAL, finalists=3)]
    found = search(recipe(), orders, [1], seeds, descents=descents, max_iter=10)
    assert not told.went_on and found.errors.sum() == pytest.approx(0.3)


class Noted(searching.Path):
    """Note what is walked, and reach errors and costs that are told."""

    cost = 1.0

    def note(self, walked, key, told):
        n_folds = len(self.folds)
        self.walked, self.key, self.scores = walked, key, [float(n_folds)]
        self.errors = [np.ones(n_folds)]
        self.told = [np.full(n_folds, error**2) for error in told]

    def descend(self, alphas, watch, tell=None):
        self.walked.append((self.key, len(alphas)))
        self.alphas += list(alphas)
        self.errors.append(self.told[min(len(self.errors), len(self.told)) - 1])
        self.scores.append(self.errors[-1].sum())
        self.states.append(self.points)
        self.costs.append([self.cost] * len(self.folds))
        return self

    def go_on(self, stage, *args):
        return stage


def told_by_order(monkeypatch, orders, table, costs=()):
    """Let paths reach tables of errors and costs; return a list for what is walked."""
    walked = []

    class Path(Noted):
        def __init__(self, recipe, folds, linears, *of, **common):
            super().__init__(recipe, folds, linears, *of, **common)
            n = len(linears[0].A)
            is_idle = n > orders.nx and not linears[0].C[:, orders.nx :].any()
            key = -n if is_idle else n
            self.note(walked, key, table.get(key, (0.99, 0.99)))
            self.cost = dict(costs).get(n, 1.0)

    monkeypatch.setattr(searching, "Path", Path)
    monkeypatch.setattr(Orders, "nx", 2)
    return walked


@pytest.mark.parametrize(
    ("table", "largest", "nx"),
    [
        # 3 is not clearly better than 2, also where both have gone on
        ({2: (0.30, 0.29), 3: (0.29, 0.28)}, 3, 2),
        # it comes down late: few stages alone do not tell
        ({2: (0.30, 0.29), 3: (0.40, 0.10)}, 3, 3),
        # so late that nobody waits for it
        ({2: (0.30, 0.29), 3: (0.46, 0.10)}, 3, 2),
        # of two ways to begin, one may do
        ({2: (0.30, 0.29), 3: (0.9, 0.9), -3: (0.31, 0.1)}, 3, 3),
        # orders go on while each gains, up to the largest
        ({2: (0.3, 0.3), 3: (0.2, 0.2), -4: (0.1, 0.1), -5: (0.1, 0.1)}, 9, 4),
        ({2: (0.3, 0.3), 3: (0.2, 0.2), -4: (0.1, 0.1)}, 3, 3),
        # from what was fitted as well as with idle states
        ({2: (0.3, 0.3), 3: (0.2, 0.2), 4: (0.1, 0.1), -5: (0.1, 0.1)}, 9, 4),
        # a few stages of one order are not compared with all stages of others
        ({2: (0.3, 0.3), 3: (0.4, 0.1), -4: (0.25, 0.05), -5: (0.1, 0.1)}, 9, 4),
        # nor is a start that others of its order leave behind
        ({2: (0.3, 0.3), 3: (0.2, 0.2), 4: (0.19, 0.19), -4: (0.3, 0.01)}, 9, 3),
    ],
)
def test_the_smallest_order_that_does_nearly_as_well(monkeypatch, table, largest, nx):
    """A table of errors after few stages and after all, negative orders are idle."""
    orders = compared(2, 3, 4)
    walked = told_by_order(monkeypatch, orders, table)
    found = search(recipe(), orders, [2, 3], [0], largest=largest, max_iter=10)
    assert found.structure.sizes["x"] == nx
    assert {2, 3, -3} <= {key for key, _ in walked}
    assert ((4, 3) in walked) == ((-4, 3) in walked) == (largest > 3 and nx > 2)
    assert ((-5, 3) in walked) == (-5 in table)


@pytest.mark.parametrize(
    ("n_samples", "table", "nx"),
    [
        (None, {2: (0.3, 0.3), -4: (0.1, 0.1)}, 2),
        # of a long record, the next one is tried behind one that brings nothing
        (4100, {2: (0.3, 0.3), -4: (0.1, 0.1)}, 4),
        (4100, {2: (0.3, 0.3), 3: (0.2, 0.2), -5: (0.1, 0.1)}, 5),
        # and no further one
        (4100, {2: (0.3, 0.3), -5: (0.1, 0.1)}, 2),
    ],
)
def test_a_long_record_waits_for_an_order(monkeypatch, n_samples, table, nx):
    record = soft(0) if n_samples is None else soft(0, n_samples)
    orders = compare_orders(scaled(*record), (2, 3, 4, 5))
    assert (len(orders.folds) == 1) == (n_samples is not None)
    told_by_order(monkeypatch, orders, table)
    found = search(recipe(), orders, [2, 3], [0], largest=9, max_iter=10)
    assert found.structure.sizes["x"] == nx


@pytest.mark.parametrize(
    ("costs", "hidden", "n_samples", "linear", "nx"),
    [
        # three times less of what is seen, and as much of what is hidden
        ({3: 0.8, 4: 0.33}, 0.32, None, 1.0, 4),
        ({3: 0.33, 4: 0.1}, 0.32, None, 1.0, 3),
        ({3: 0.8, 4: 0.35}, 0.32, None, 1.0, 2),
        # of what is hidden, clearly more
        ({3: 0.8, 4: 0.1}, 0.34, None, 1.0, 2),
        # nobody looks behind an order that fits no better
        ({3: 0.9, 4: 0.1}, 0.32, None, 1.0, 2),
        # hidden samples of a long record tell enough
        ({3: 0.8, 4: 0.1}, 0.32, 4100, 1.0, 2),
        # without networks, hidden samples are missed hardly more
        ({3: 0.8, 4: 0.33}, 0.32, None, 0.34, 2),
        ({3: 0.8, 4: 0.33}, 0.32, None, 0.36, 4),
    ],
)
def test_an_order_that_explains_more_is_taken(
    monkeypatch, costs, hidden, n_samples, linear, nx
):
    record = soft(0) if n_samples is None else soft(0, n_samples)
    orders = compare_orders(scaled(*record), (2, 3, 4))
    errors = {n: np.full(len(orders.folds), linear**2) for n in orders.errors}
    orders = replace(orders, errors=errors)
    table = {2: (0.3, 0.3), 3: (0.31, 0.31), 4: (hidden, hidden)}
    told_by_order(monkeypatch, orders, table, costs)
    found = search(recipe(), orders, [2, 3], [0], largest=4, max_iter=10)
    assert found.structure.sizes["x"] == nx


@pytest.mark.parametrize(
    ("zero", "nx", "further", "spread", "three"),
    [
        # an order that nearly came down along the first descent does along the second
        ({2: 0.21, 3: 0.2}, 2, {2, 3}, 1.06, 0.2),
        ({2: 0.23, 3: 0.2}, 3, {2, 3}, 1.06, 0.2),
        # also the larger one, beside what the smaller one has reached
        ({2: 0.3, 3: 0.1}, 3, {2, 3}, 1.06, 0.2),
        # beyond the order of the first comparison, 2, others have to gain more
        ({2: 0.3, 3: 0.23}, 2, {1, 2, 3}, 1.06, 0.36),
        ({2: 0.3, 3: 0.22}, 3, {1, 2, 3}, 1.06, 0.36),
        # one with over twice the least error is not tried again
        ({1: 0.01, 2: 0.3, 3: 0.3}, 3, {2, 3}, 1.06, 0.2),
        # two starts agree: others would not come lower
        ({2: 0.01, 3: 0.1}, 3, {3}, 1.04, 0.2),
        # there is no further descent
        ({}, 3, set(), 1.06, 0.2),
    ],
)
def test_orders_are_compared_along_all_descents_unless_starts_agree(
    monkeypatch, zero, nx, further, spread, three
):
    orders, seeds = compared(1, 2, 3), [11, 22, 33]
    first, walked = {1: 0.41, 2: 0.38, 3: three}, []

    class Path(Noted):
        def __init__(self, recipe, folds, linears, seed, *of, **common):
            super().__init__(recipe, folds, linears, seed, *of, **common)
            n, is_zero = len(linears[0].A), self.descent.center == "zero"
            # of the further descent, the last start alone comes lower
            told = zero.get(n, 0.9) if seed == seeds[-1] else 0.9
            near = first[n] if seed == seeds[0] else spread * first[n]
            self.note(walked, (n, is_zero), [told if is_zero else near])

    monkeypatch.setattr(searching, "Path", Path)
    monkeypatch.setattr(Orders, "nx", 3)
    descents = (USUAL, FADING) if zero else (USUAL,)
    found = search(recipe(), orders, [1, 2, 3], seeds, descents=descents, max_iter=60)
    assert found.structure.sizes["x"] == nx
    # every start of an order once, also where it is that of the path that is taken
    again = [n for (n, is_zero), n_alphas in walked if is_zero and n_alphas]
    assert sorted(again) == sorted([*further] * 3)


def test_orders_that_fit_better_alone_are_not_compared_along_all_descents(monkeypatch):
    orders, seeds, walked = compared(1, 2, 3), [11, 22], []
    costs = {1: 1.0, 2: 0.8, 3: 0.5}  # for which three states are tried
    errors = {nx: np.ones(len(orders.folds)) for nx in orders.errors}

    class Path(Noted):
        def __init__(self, recipe, folds, linears, seed, *of, **common):
            super().__init__(recipe, folds, linears, seed, *of, **common)
            n, is_zero = len(linears[0].A), self.descent.center == "zero"
            near = {1: 0.3, 2: 0.29, 3: 0.27}[n] * (1.0 if seed == seeds[0] else 1.06)
            self.cost = costs[n]
            self.note(walked, (n, is_zero), [0.9 if is_zero else near])

    monkeypatch.setattr(searching, "Path", Path)
    monkeypatch.setattr(Orders, "nx", 3)
    among = recipe(), replace(orders, errors=errors), [1, 2], seeds
    search(*among, largest=3, descents=(USUAL, FADING), max_iter=60)
    tried = {n for (n, is_zero), _ in walked if not is_zero}
    again = {n for (n, is_zero), n_alphas in walked if is_zero and n_alphas}
    assert tried == {1, 2, 3} and again == {1, 2}


@pytest.mark.parametrize("n_folds", [1, 3])
@pytest.mark.parametrize(
    ("model", "n_kinds", "changes"),
    [
        (AlSsnn(), 2, True),
        (GrSsnn(), 1, True),
        (AlSsnn(n_g=0), 1, True),  # it is compared with the first one
        (FlSsnn(), 1, False),
        # what judges a predictor is mostly noise
        (AlSsnn(noise="innovations"), 1, False),
        (GrSsnn(noise="innovations"), 1, False),
    ],
)
def test_free_networks_of_long_records_go_along_the_same_alphas(
    monkeypatch, model, n_kinds, changes, n_folds
):
    orders, begun = compared(1), []
    parts = {1: orders.models[1][:n_folds]}, {1: orders.errors[1][:n_folds]}
    orders = Orders(orders.folds[:n_folds], *parts)

    class Path(Noted):
        def __init__(self, recipe, folds, linears, seed, descent, **common):
            super().__init__(recipe, folds, linears, seed, descent, **common)
            begun.append(descent)
            self.note([], None, [0.3])

    monkeypatch.setattr(searching, "Path", Path)
    descents = model._descents()
    search(recipe(), orders, [1], [11, 22], max_iter=90, descents=descents)
    lengths = [len(d.alphas) for d in begun]
    if n_folds == 1 and changes:
        assert lengths == [len(LONG.alphas)] * 2  # both starts, once
        assert begun[0].center == "zero" and begun[0].steps(90) == 10
    else:
        assert sorted(lengths) == sorted([len(d.alphas) for d in descents] * 2)
        assert len(descents) == n_kinds and len(LONG.alphas) not in lengths


def test_the_best_start_of_a_long_record_goes_first():
    """Where time is over, it is the one that has come far."""
    asked, errors = [], {11: 0.25, 22: 0.1, 33: 0.2, 44: 0.31}

    def walk(ways, alphas):
        asked.append(([way.seed for way in ways], *alphas))
        return [replace(way, error=errors[way.seed]) for way in ways]

    ways = [Way(1, seed, None, []) for seed in errors]
    raced = network_orders._raced(walk, ways, [1e-4, 1e-6])
    assert asked == [([11, 22, 33, 44], 1e-4), ([22, 33, 11], 1e-6)]
    assert [way.seed for way in raced] == [22, 33, 11, 44]


@pytest.mark.parametrize("n_samples", [None, 4100])
def test_a_start_of_a_long_record_that_is_far_behind_goes_no_further(
    monkeypatch, n_samples
):
    """Along fewer alphas, and starts are not begun again where their order is taken."""
    record = soft(0) if n_samples is None else soft(0, n_samples)
    orders, seeds = compare_orders(scaled(*record), (1, 2)), [11, 22]
    usual = replace(SMOOTH, center="start")
    usual = replace(usual, of_long=replace(usual, alphas=(1e-4, 1e-6)))
    errors = {(1, 11): 0.1, (1, 22): 0.31, (2, 11): 0.05, (2, 22): 0.14}
    walked, begun = Counter(), []

    class Path(Noted):
        def __init__(self, recipe, folds, linears, seed, *of, **common):
            super().__init__(recipe, folds, linears, seed, *of, **common)
            begun.append((len(linears[0].A), seed))
            self.note([], begun[-1], [errors[begun[-1]]])

        def descend(self, alphas, *rest):
            walked[self.key] += len(alphas)
            return super().descend(alphas, *rest)

    monkeypatch.setattr(searching, "Path", Path)
    monkeypatch.setattr(Orders, "nx", 2)
    search(recipe(), orders, [1, 2], seeds, max_iter=60, descents=[usual])
    if n_samples is None:
        assert walked == {(1, 11): 3, (1, 22): 3, (2, 11): 5, (2, 22): 5}
    else:  # three times as far as another one of the same order
        assert walked == {(1, 11): 2, (1, 22): 1, (2, 11): 2, (2, 22): 2}
    assert sorted(begun) == sorted(errors)


# a record of 400 samples hides three times 100: chance is 2 / 300
WITHIN, BEYOND = 1 + 1.8 / 300, 1 + 2.2 / 300


@pytest.mark.parametrize("is_predictor", [False, True])
def test_white_errors_differ_by_chance(monkeypatch, is_predictor):
    orders = compared(1)
    for share, stage in ((WITHIN, 2), (BEYOND, 3 if is_predictor else 2)):
        walked = told(monkeypatch, [[1, 0.9, 0.5 * share, 0.5]], [11])
        options = {"max_iter": 10, "is_predictor": is_predictor}
        found = search(recipe(), orders, [1], [11], **options)
        assert found.alpha == pytest.approx(walked[0].asked[0][stage - 1])
    linear = orders.errors[1]
    for share, helps in ((1 / WITHIN, False), (1 / BEYOND, is_predictor)):
        row = [linear.sum(), linear.sum() * share]
        told(monkeypatch, [row], [11])
        found = search(recipe(), orders, [1], [11], **options)
        # every fold of the told errors has the same: so have the linear models
        told_too = {"certainty": 9.0, "by_output": 0.5}
        found = replace(found, linear_errors=np.full(3, linear.mean()), **told_too)
        assert found.helps is helps


@pytest.mark.parametrize("error", [0.1, 1e-4])
def test_alphas_of_a_predictor_are_relative_to_its_noise(monkeypatch, error):
    orders = compared(1)
    orders = replace(orders, errors={1: np.array([0.5, 1.0, 1.5]) * error})
    asked = []
    for is_predictor in (False, True):
        walked = told(monkeypatch, [[1, 0.9]], [11])
        options = {"max_iter": 10, "is_predictor": is_predictor}
        search(recipe(), orders, [1], [11], **options)
        asked.append(walked[0].asked)
    (plain, enough), (relative, enough_relative) = asked
    np.testing.assert_array_equal(plain, ALPHAS)
    # they are meant for a mean square error of a tenth
    np.testing.assert_allclose(relative, ALPHAS * error / 0.1, rtol=1e-12)
    assert enough == USUAL.enough
    assert enough_relative == pytest.approx(enough * error / 0.1)


def test_a_fit_says_that_it_searches_a_predictor(short, monkeypatch):
    class Asked(Exception):
        pass

    def search(*args, is_predictor, **options):
        raise Asked(is_predictor)

    monkeypatch.setattr(_ssnn, "search", search)
    for noise in ("output", "innovations"):
        with pytest.raises(Asked, match=str(noise == "innovations")):
            make("fl", noise=noise).fit(*short)


def long_search(monkeypatch, scores, least, contends=1.0):
    """Search on one fold; return the choice, and what was walked, with its options."""
    orders = compared(1)
    one = {1: orders.models[1][:1]}, {1: orders.errors[1][:1]}
    orders = Orders(orders.folds[:1], *one)  # a long record has one fold
    went, scores = [], iter(scores)
    descend = searching.Path.descend

    def recorded(self, alphas, *rest, **options):
        went.append((self, list(alphas)))
        return descend(self, alphas, *rest, **options)

    def told(self, n_stages=None):
        return least(self, went) if n_stages is None else next(scores)

    monkeypatch.setattr(searching.Path, "descend", recorded)
    monkeypatch.setattr(searching.Path, "least", told)
    descents = [Descent(contends=contends)]
    found = search(recipe(), orders, [1], [1, 2, 3], descents=descents, max_iter=50)
    return found, went


FIRST, REST = list(ALPHAS[:6]), list(ALPHAS[6:])


@pytest.mark.parametrize(("contends", "n"), [(1.0, 1), (1.5, 2), (1.7, 3)])
def test_of_a_long_record_starts_near_the_best_go_all_the_way(monkeypatch, contends, n):
    scores = 1.6**2, 1.4**2, 1.0
    end = len(ALPHAS)
    found, went = long_search(
        monkeypatch, scores, lambda path, _: end - len(path.alphas), contends
    )
    paths = [path for path, _ in went]
    assert [alphas for _, alphas in went] == [FIRST] * 3 + [REST] * n
    assert ALPHAS[5] == pytest.approx(USUAL.enough)
    assert [id(path) for path in paths[3:]] == [id(path) for path in paths[3 - n : 3]]
    # the fit to all samples goes on from there, with all its steps
    assert found.refit_iter == 50


def test_of_a_long_record_the_lowest_start_goes_all_the_way(monkeypatch):
    """Also one that was not near where all were compared, but is lower by now."""

    def least(path, went):
        return 0.5 if path is went[0][0] else 1.0

    _, went = long_search(monkeypatch, (4.0, 3.0, 1.0), least)
    paths = [path for path, _ in went]
    assert [alphas for _, alphas in went] == [FIRST] * 3 + [REST] * 2
    assert paths[3] is paths[2] and paths[4] is paths[0]


@pytest.mark.parametrize("n_folds", [1, 3])
def test_steps_are_bent_on_long_records(monkeypatch, n_folds):
    orders, asked = compared(1), []
    parts = {1: orders.models[1][:n_folds]}, {1: orders.errors[1][:n_folds]}
    orders = Orders(orders.folds[:n_folds], *parts)
    minimize = Limits.minimize

    def recorded(self, *args, bends, **options):
        asked.append(bends)
        return minimize(self, *args, bends=bends, **options)

    monkeypatch.setattr(Limits, "minimize", recorded)
    found = search(recipe(), orders, [1], [11], max_iter=50)
    assert set(asked) == {n_folds == 1}
    assert found.bends == (n_folds == 1)  # the fit to all samples, too


def test_a_path_goes_on_as_long_as_hidden_samples_gain():
    orders = compared(1)
    path = walk(orders, steps=2, tol=1e-9)
    path.descend(ALPHAS[:5], Watch())
    before = [errors.sum() for errors in path.errors]
    stage = path.go_on(4, ALPHAS[3], 30, Watch())
    after = [errors.sum() for errors in path.errors]
    np.testing.assert_array_equal(after[:5], before[:5])
    assert 4 < stage < 34
    assert len(path.costs) == len(path.alphas) == len(after) - 1
    assert after[stage] == min(after[4:]) < 0.9 * before[4]


@pytest.mark.parametrize("best", [0, 1, 2])
def test_the_fold_from_which_all_samples_are_fitted_best(best):
    orders = compared(1)
    path = walk(orders)
    path.descend(ALPHAS[:6], Watch())
    start, end = path.states[0], path.states[-1]
    path.states.append([(end if i == best else start)[i] for i in range(3)])
    path.options["max_iter"] = 1
    assert path.best_fold(7, ALPHAS[5], Watch()) == best


def test_a_fold_has_all_samples(short):
    (u, y), fold = scaled(*short)[0], compared(1).folds[1]
    y = y.copy()
    y[3] = np.nan
    fold = replace(fold, fitted=[(u, np.where(np.isnan(y), y, fold.fitted[0][1]))])
    np.testing.assert_array_equal(fold.whole[0][0], u)
    np.testing.assert_array_equal(fold.whole[0][1], y)


@pytest.mark.parametrize(
    ("errors", "linear", "helps"),
    [
        ([0.1, 0.1], [0.2, 0.2], True),
        ([0.195, 0.195], [0.2, 0.2], False),  # a gain of 2.5 %
        ([0.01, 0.31], [0.4, 0.2], False),  # 1.55 times as bad in one fold
        ([0.001, 0.07], [0.01, 0.3], True),
        # a fold that happens to be linear counts as half of the mean, 0.15
        ([0.05, 0.11], [0.29, 0.01], True),
        ([0.05, 0.12], [0.29, 0.01], False),
        ([0.61, 0.1], [3.0, 3.0], True),  # a mean of 0.355 < 0.6^2
        ([0.63, 0.1], [3.0, 3.0], False),  # no prediction: 0.365
    ],
)
def test_what_counts_as_help(errors, linear, helps):
    errors, linear = np.array(errors), np.array(linear)
    found = Found(
        *[None] * 3, 1e-3, 24, False, None, None, errors, linear, 2.0, 0.5, {}
    )
    assert found.helps is helps
    # by chance, or one output at the cost of another
    assert not replace(found, certainty=0.9).helps
    assert not replace(found, by_output=1.1).helps


def test_how_sure_a_gain_is():
    # eight blocks of two samples each, of two outputs
    gain = np.array([4.0, 2.0, 3.0, 3.0, 5.0, 1.0, 3.0, 3.0])
    ours = np.repeat(gain, 2)[:, None] * [0.75, 0.25] + 1.0
    error = gain.std(ddof=1) / np.sqrt(8)
    assert certainty([(ours, np.ones_like(ours))]) == pytest.approx(3.0 / error)
    assert certainty([(np.ones_like(ours), ours)]) == pytest.approx(-3.0 / error)
    both = gain, gain + 6.0  # two folds: the mean of 16 blocks
    folds = [(np.repeat(g, 2)[:, None], np.zeros((16, 1))) for g in both]
    error = np.concatenate(both).std(ddof=1) / 4
    assert certainty(folds) == pytest.approx(6.0 / error)


def test_how_sure_a_gain_is_where_something_diverges_or_little_is_hidden():
    fine, lost = np.ones((16, 1)), np.full((16, 1), np.inf)
    assert certainty([(fine, lost)]) == certainty([(lost, lost)]) == -np.inf
    assert certainty([(lost, fine)]) == np.inf
    assert certainty([(fine[:0], fine[:0])]) == certainty([(fine[:1], fine[:1])]) == 0.0
    assert certainty([(fine, fine)]) == 0.0


def test_hidden_squares_are_those_of_the_error(short):
    orders = compared(1)
    for fold, linear in zip(orders.folds, orders.models[1], strict=True):
        structure, theta, fit = linear.as_fit()
        squares = fold.squares(structure, theta, fit.x0)
        assert squares.shape == (len(short[0]) / 4, 1)
        assert squares.mean() == pytest.approx(orders.errors[1].mean(), rel=0.5)
        # nothing is as bad from other initial states, which a stable plant forgets
        error = fold.error(structure, theta, fit.x0)
        assert squares.mean() == pytest.approx(error, rel=1e-6)


def test_networks_are_compared_output_by_output(monkeypatch):
    """With the weights of the outputs, and those of no weight left out."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 1))
    y = lfilter([0, 1], [1, -0.5], u, axis=0) * [1.0, 2.0]
    y += 0.1 * rng.standard_normal(y.shape)
    orders = compare_orders([(u, y)], [1])
    structure, theta, fit = orders.models[1][0].as_fit()
    squares = Fold.squares

    def told(self, structure, theta, x0, weight=None):
        found = squares(self, structure, theta, x0, weight)
        return found * (0.25, 3.0) if theta is other else found

    monkeypatch.setattr(Fold, "squares", told)
    other = theta.copy()

    class Walk:
        problems = [(structure,)] * len(orders.folds)

    for weight, by_output in ((None, 1.625), ([1, 3], 1.625), ([1, 0], 0.25)):
        alike = orders.folds[:1], {1: orders.models[1][:1]}
        one = replace(orders, folds=alike[0], models=alike[1])
        Walk.problems = [(structure,)]
        errors, sure, found = searching._beside(
            one, Walk, [(other, fit.x0)], weight, False
        )
        assert found == pytest.approx(by_output)
        assert sure > 0 if weight == [1, 0] else sure < 0
        expected = one.folds[0].error(structure, theta, fit.x0, weight)
        assert errors == pytest.approx([expected])


@pytest.mark.parametrize("escaped", [False, True])
def test_what_larger_inputs_take_away_counts_with_twice_its_error(monkeypatch, escaped):
    orders = compared(1)
    monkeypatch.setattr(Excursion, "leads", lambda *point: escaped)
    path = walk(orders)
    assert path.scores == [pytest.approx(path.errors[0].sum() * (4 if escaped else 1))]
    assert path.least(5) == path.scores[0]
    # of predictors and of plants that integrate, nobody asks
    assert walk(orders, is_predictor=True).scores == [path.errors[0].sum()]
    folds = [replace(fold, integrators=1) for fold in orders.folds]
    orders = replace(orders, folds=folds)
    assert walk(orders).scores == [pytest.approx(path.errors[0].sum(), rel=0.5)]


def test_of_two_paths_the_one_that_stays():
    stays, leaves = Walked([2, 1], (1, 0.5, 0.3)), Walked([2, 1], (1, 0.4, 0.2))
    leaves.scores = [1, 0.4, 0.8]
    assert walking.lowest([stays, leaves], 1.1) == [(stays, 2)]
    leaves.scores = [1, 0.4, 0.2]
    assert walking.lowest([stays, leaves], 1.1) == [(leaves, 2)]


def test_a_path_ends_after_three_stages_without_a_gain():
    class Path(walking.Path):
        def __init__(self, told):
            self.told, self.folds, self.descent = iter(told), [], USUAL
            self.alphas, self.errors, self.scores, self.states = [], [], [1.0], []
            self.costs = []

        def _judge(self):
            self.scores.append(next(self.told))
            self.errors.append(np.array([self.scores[-1]]))

    # a gain is one of more than a hundredth, of the least so far
    path = Path([0.5, 0.51, 0.497, 0.4, 0.45, 0.41, 0.399, 0.1])
    path.descend([1e-5] * 8, Watch())
    assert path.has_ended and len(path.alphas) == 7
    path = Path([0.5, 0.6, 0.6, 0.6, 0.6, 0.6])
    path.descend([1e-3, 1e-3, 1e-3, 1e-3, 1e-4, 1e-5], Watch())
    assert path.has_ended and len(path.alphas) == 5  # not before `enough`


def test_a_tally_tells_what_is_done_and_reached():
    told = []

    class Told:
        def searched(self, *what):
            told.append(what)

    tally = walking.Tally(Told(), np.ones(2), 5)
    tally.plan(2)(np.array([0.25, 0.25]))
    tally(np.ones(2))
    tally.plan(3)(np.array([0.09, 0.09]))  # two stages less than planned
    tally.plan(4)(np.array([0.5, 0.5]))  # more than expected
    tally.walked([np.array([0.5, 0.5]), np.array([0.04, 0.04])], 2)
    done, of, share = np.transpose(told)
    assert list(done) == [1, 2, 3, 6, 11] and list(of) == [5, 5, 5, 9, 11]
    np.testing.assert_allclose(share, [0.5, 0.5, 0.3, 0.3, 0.2])


def test_the_lowest_paths_are_those_near_the_best():
    rows = [(1, 0.5, 0.4), (1, 0.29, 0.28), (1, 0.9, 0.2), (0.1, 0.9, 0.46), (1, 3, 3)]
    paths = [Walked([2, 1], row) for row in rows]
    order = [(paths[2], 2), (paths[1], 1), (paths[0], 2), (paths[3], 2), (paths[4], 1)]
    assert walking.lowest(paths, 1.1, 9) == order  # the start is none of its stages
    assert walking.lowest(paths, 1.1, 9, 2.25) == order[:3]
    assert walking.lowest(paths, 1.1, 2, 2.25) == order[:2]
    assert walking.lowest(paths, 1.1, 9, 1.0) == order[:1]


def test_overflowing_derivatives_are_a_cliff_and_not_the_end():
    # a Gauss-Newton step goes to zero at once; left of 0.7 the derivatives overflow
    class Cliff:
        def norm(self, x):
            return float(abs(x[0]))

        def fun(self, x):
            return np.append(np.abs(x), 0.0)

        def jac(self, x):
            if x[0] < 0.7:
                raise FloatingPointError("overflow")
            return np.array([[1.0], [0.0]])

    result = minimize(Cliff(), np.array([2.0]), max_iter=200)
    assert 0.7 <= result.x[0] < 0.75
    assert result.cost == pytest.approx(result.x[0] ** 2)


def test_a_start_without_derivatives_is_returned():
    class Cliff:
        norm = staticmethod(lambda x: 1.0)
        fun = staticmethod(lambda x: np.ones(2))

        def jac(self, x):
            raise FloatingPointError

    result = minimize(Cliff(), np.array([2.0]))
    assert not result.success and "overflow" in result.message
    np.testing.assert_array_equal(result.x, [2.0])


@pytest.mark.parametrize("alpha", ["auto", 0.0])
@pytest.mark.parametrize("every", [2, 7])
def test_overflows_within_a_fit_leave_a_model(short, monkeypatch, alpha, every):
    original, calls = Criterion.normal_equations, [0]

    def overflowing(self, free):
        calls[0] += self.structure.nw > 0 and len(free) > self.structure.n_x0
        if calls[0] % every == 0 and calls[0]:
            raise FloatingPointError("overflow")
        return original(self, free)

    monkeypatch.setattr(Criterion, "normal_equations", overflowing)
    monkeypatch.setattr("alssnn.estimators._base.training_score", lambda *_: 0.0)
    u, y = short
    model = quietly(make("fl", alpha=alpha), u, y)
    assert np.isfinite(model.cost_) and np.isfinite(model.predict(u)).all()
    assert calls[0] > 10


def test_all_samples_begin_where_they_are_simulated_best(short):
    experiments = scaled(*short)
    linear = compare_orders(experiments, [1]).models[1][0]
    plan = recipe()
    _, structure, _, _ = plan.declare(linear)
    good = plan.start(structure, linear, experiments, 0)
    p = structure.split(good.copy())
    p["W_h"][:] = 5.0  # far worse on any sample
    bad = structure.join(p)
    options = {"coarse_samples": 200, "max_iter": 1, "polish_iter": 1, "tol": 1e-2}
    costs = {}
    for fallback in (None, good):
        watch = Watch()
        watch.reason = "stages return their starts"
        result = train(
            structure, experiments, [bad], fallback=fallback, watch=watch, **options
        )
        costs[fallback is None] = result.cost
        wanted = bad if fallback is None else good
        np.testing.assert_array_equal(result.theta, wanted)
    assert costs[False] < costs[True] / 2
    # a fallback that is worse is none
    watch = Watch()
    watch.reason = "stages return their starts"
    result = train(structure, experiments, [good], fallback=bad, watch=watch, **options)
    np.testing.assert_array_equal(result.theta, good)


# -- the same again ------------------------------------------------------------------


@pytest.mark.parametrize("kind", CLASSES)
def test_the_same_seed_gives_the_same_model(short, kind):
    u, y = short
    first, again = (
        quietly(make(kind, max_iter=10), u[:100], y[:100]) for _ in range(2)
    )
    np.testing.assert_array_equal(first._theta, again._theta)
    assert first.alpha_ == again.alpha_ and first.orders_ == again.orders_


def test_starts_in_parallel_are_those_of_one_process(short, fitted):
    parallel = quietly(make("fl", n_jobs=2), *short)
    np.testing.assert_allclose(parallel._theta, fitted._theta, rtol=1e-9)
    assert parallel.alpha_ == fitted.alpha_


def test_orders_are_compared_in_parallel_as_in_one_process(short, monkeypatch):
    u, y = short
    sent, finished = [], walking.finished

    def noted(function, calls, n_jobs):
        sent.append((len(calls), n_jobs))
        return finished(function, calls, n_jobs)

    monkeypatch.setattr(walking, "finished", noted)
    options = {"nx": range(1, 3), "n_init": 2, "n_h": 1, "max_iter": 10}
    alone = quietly(make("fl", **options), u[:100], y[:100])
    assert not sent
    parallel = quietly(make("fl", n_jobs=2, **options), u[:100], y[:100])
    # of both orders two starts, and of the larger one two with an idle state
    assert sent[0] == (6, 2)
    np.testing.assert_allclose(parallel._theta, alone._theta, rtol=1e-9)
    networks = (model.orders_["networks"] for model in (parallel, alone))
    assert next(networks) == pytest.approx(next(networks))


def test_what_ended_a_worker_ends_the_fit(monkeypatch):
    """Or it would search on, and say that the networks do not help."""

    def far(function, calls, n_jobs):
        for i, (*call, watch) in enumerate(calls):
            yield i, function(*call, pickle.loads(pickle.dumps(watch)))

    monkeypatch.setattr(walking, "finished", far)
    orders, watch = compared(1), Watch(max_time=0.0)
    paths = [walk(orders) for _ in range(2)]
    tally = walking.Tally(watch, orders.errors[1], 2)
    walking.descended(paths, watch.quiet(), tally, n_jobs=2)
    assert watch.reason == OUT_OF_TIME


# -- what a fit leaves ---------------------------------------------------------------


def assert_model(model, u):
    """Check that what a fit left is a model of finite numbers."""
    us = u if isinstance(u, list) else [u]
    for one in us:
        assert np.isfinite(model.predict(one)).all()
    assert np.isfinite(model.cost_)
    assert np.isfinite(model.train_score_)
    assert set(model.orders_) <= {"linear", "networks"}
    assert model.message_


def two_by_two(seed=0, n=500):
    rng = np.random.default_rng(seed)
    A = np.array([[0.7, 0.2], [-0.2, 0.6]])
    u, x, y = rng.standard_normal((n, 2)), np.zeros(2), np.empty((n, 2))
    for k in range(n):
        y[k] = x
        x = A @ x + 0.5 * u[k] + 0.6 * np.tanh(2 * x[::-1])
    return u, y + 0.02 * rng.standard_normal(y.shape)


@pytest.mark.parametrize("kind", CLASSES)
def test_two_inputs_and_two_outputs(kind):
    u, y = two_by_two(n=150)
    model = quietly(make(kind, nx=2, max_iter=10), u, y)
    assert_model(model, u)
    linear = LinearStateSpace(2).fit(u, y)
    assert model.score(*two_by_two(1)) > linear.score(*two_by_two(1)) - 0.01


def test_experiments_of_different_length(short):
    u, y = short
    us, ys = [u[:260], u[260:]], [y[:260], y[260:]]
    model = quietly(make("fl", n_init=1), us, ys)
    assert_model(model, us)
    assert model.x0_.shape == (2, 1)


def test_outputs_that_were_not_measured(short):
    u, y = short
    y = y.copy()
    y[::7] = np.nan
    y[300:] = np.nan  # nothing is left of the quarter that one fold hides
    model = quietly(make("fl"), u, y)
    assert_model(model, u)
    assert model.score(u[:300], short[1][:300]) > 0.99


def test_a_constant_output():
    u = np.random.default_rng(0).standard_normal((100, 1))
    with pytest.warns(UserWarning, match="does not move in column 0"):
        model = quietly(make("fl"), u, np.full(100, 3.0))
    np.testing.assert_allclose(model.predict(u), 3.0, atol=1e-6)


@pytest.mark.parametrize("nx", ["auto", 1])
@pytest.mark.parametrize("kind", CLASSES)
def test_twenty_samples(kind, nx):
    u, y = twin(0, 20)
    model = quietly(make(kind, nx=nx), u, y)
    assert_model(model, u)


def test_too_few_samples_for_an_order():
    u, y = twin(0, 20)
    with pytest.raises(ValueError, match=r"at least \d+ samples .* smaller `nx`"):
        make("fl", nx=8).fit(u, y)


@pytest.mark.parametrize("kind", CLASSES)
def test_at_rest(kind):
    for data in (soft(0, 200), linear_plant(0, 200)):
        model = quietly(make(kind, initial_state="rest"), *data)
        assert_model(model, data[0])
        np.testing.assert_array_equal(model.x0_, [[0.0]])


@pytest.mark.parametrize("kind", CLASSES)
def test_a_given_start(kind):
    start, data = ([[0.9]], [[1.0]], [[1.0]]), soft(0, 200)
    model = quietly(make(kind, linear_start=start), *data)
    assert_model(model, data[0])
    assert model.orders_.keys() == {"networks"}


@pytest.mark.parametrize(
    "data", [twin(0, 200), linear_plant(0, 200)], ids=["twin", "linear"]
)
@pytest.mark.parametrize("kind", CLASSES)
def test_bounds_hold_whatever_a_search_finds(data, kind):
    bounds = {"A": (0.2, 0.65), "B": (0.5, 0.9)}
    start = ([[0.6]], [[0.8]], [[1.0]])
    options = {"linear_start": start, "bounds": bounds, "stability": None}
    model = quietly(make(kind, **options), *data)
    assert_model(model, data[0])
    assert 0.2 <= model.A_[0, 0] <= 0.65 and 0.5 <= model.B_[0, 0] <= 0.9


def test_a_shaped_linear_model_is_that_of_the_linear_estimator():
    u, y = linear_plant(0, 300)
    for options in (
        {"initial_state": "rest"},
        {"output_weight": [2.0]},
        {"feedthrough": True, "bounds": {"D": (-1.0, -0.2)}},
    ):
        linear = LinearStateSpace(2, **options, tol=1e-8).fit(u, y)
        sizes = {"nx": 2, "n_h": 1, "n_g": 1}
        model = quietly(make("al", **sizes, tol=1e-8, **options), u, y)
        assert LINEAR in model.message_
        assert model.cost_ == pytest.approx(linear.cost_, rel=1e-4)
        np.testing.assert_allclose(
            model.predict(u), linear.predict(u), atol=1e-2 * y.std()
        )


@pytest.mark.parametrize("kind", CLASSES)
def test_an_integrator(kind):
    u, y = soft(0)
    y = np.cumsum(y - y.mean()) * 0.1
    model = quietly(make(kind, nx=2, integrators=1), u, y)
    assert_model(model, u)
    assert np.isclose(np.linalg.eigvals(model.A_), 1.0).any()


@pytest.mark.parametrize("input_delay", [3, "auto"])
def test_a_delay(short, input_delay):
    u, y = short
    late = np.concatenate([np.full(3, y[0]), y[:-3]])
    model = quietly(make("fl", input_delay=input_delay), u, late)
    assert_model(model, u)
    assert model.score(u, late) > 0.95


@pytest.mark.parametrize("held_out", ["records", "fraction"])
def test_validation(short, held_out):
    u, y = short
    if held_out == "records":
        model = quietly(make("fl"), u, y, validation=soft(1, 200))
    else:
        model = quietly(make("fl", validation_fraction=0.2), u, y)
    assert_model(model, u)
    trained = [s.validation_rmse for s in model.history_ if s.label == "train"]
    assert np.isfinite(trained).any()


def test_a_warm_start_goes_on_with_what_was_chosen(short, fitted):
    model = clone(fitted).set_params(warm_start=True, max_iter=60)
    quietly(model, *short)
    alpha, cost = model.alpha_, model.cost_
    quietly(model, *short)
    assert model.alpha_ == alpha and np.isfinite(alpha)
    assert model.cost_ <= cost * (1 + 1e-9)
    assert {step.label for step in model.history_} == {"train"}
    quietly(model.set_params(alpha=0.5), *short)
    assert model.alpha_ == 0.5


def test_a_warm_start_from_a_linear_model_searches_again(short):
    model = make("fl", warm_start=True)
    quietly(model, *linear_plant(0, 200))
    assert model.alpha_ == np.inf
    quietly(model, *short)
    assert np.isfinite(model.alpha_)
    assert_model(model, short[0])


@pytest.mark.parametrize("max_time", [1e-3, 0.3])
@pytest.mark.parametrize("nx", ["auto", 1])
def test_time_may_be_over_at_any_time(short, max_time, nx):
    model = make("fl", max_time=max_time, nx=nx, max_iter=100)  # longer than that
    with pytest.warns(ConvergenceWarning, match="max_time is over") as caught:
        model.fit(*short)
    assert not any("do not simulate hidden" in str(w.message) for w in caught)
    assert model.message_ == "max_time is over" and not model.converged_
    assert_model(model, short[0])


@pytest.mark.parametrize("where", ["in a stage", "between stages", "of the orders"])
def test_an_interrupt_within_a_search(short, monkeypatch, where):
    calls = [0]

    def interrupt(original, at):
        def function(*args, **kwargs):
            calls[0] += 1
            if calls[0] == at:
                raise KeyboardInterrupt
            return original(*args, **kwargs)

        return function

    if where == "in a stage":
        wrapped = interrupt(walking.Criterion.normal_equations, 12)

        class Interrupted(Criterion):
            normal_equations = wrapped

        monkeypatch.setattr(walking, "Criterion", Interrupted)
    elif where == "between stages":
        wrapped = interrupt(searching.Path._judge, 4)
        monkeypatch.setattr(searching.Path, "_judge", wrapped)
    else:
        wrapped = interrupt(alssnn.subspace.minimize, 2)
        monkeypatch.setattr("alssnn.subspace.minimize", wrapped)
    model = make("fl", warm_start=True)
    with pytest.raises(KeyboardInterrupt):
        model.fit(*short)
    assert calls[0] > 1
    if where != "of the orders":
        assert model.message_ == "interrupted" and not model.converged_
        assert_model(model, short[0])
    quietly(model, *short)  # and on it goes
    assert np.isfinite(model.alpha_)


def test_a_model_that_hangs_on_an_exact_state_is_told():
    # a mode that grows by 3 % per sample is silent from its exact state; the noise of
    # 50 samples tells it to 0.01 or so, which is 1000 after 400
    rng = np.random.default_rng(0)
    A, B, C = np.diag([0.5, 1.03]), np.array([[1.0], [0.0]]), np.ones((1, 2))
    u = rng.standard_normal((400, 1))
    y = simulate_linear(A, B, C, u) + 0.1 * rng.standard_normal((400, 1))
    model = LinearStateSpace(
        linear_start=(A, B, C),
        bounds={"A": (A, A), "B": (B, B), "C": (C, C)},
        operating_point="zero",
    )
    with (
        pytest.warns(ConvergenceWarning, match="hangs on an exact initial state"),
        pytest.warns(ConvergenceWarning, match="unstable, spectral radius 1.03"),
    ):
        model.fit(u, y)
    assert model.cost_ < 0.1 and model.train_score_ < 0
    model.set_params(bounds=None, linear_start=None, nx=1)
    assert model.fit(u, y).train_score_ == pytest.approx(model.score(u, y), abs=0.01)


# -- the way to a file and back --------------------------------------------------------


@pytest.mark.parametrize(
    "data", [twin(0, 200), linear_plant(0, 200)], ids=["twin", "linear"]
)
def test_what_was_chosen_survives_a_file(tmp_path, data):
    model = quietly(make("fl", nx=range(1, 3), n_init=1, max_iter=15), *data)
    model.save(tmp_path / "model.npz")
    loaded = alssnn.load(tmp_path / "model.npz")
    assert loaded.alpha_ == model.alpha_
    assert loaded.train_score_ == model.train_score_
    assert loaded.orders_ == model.orders_
    assert loaded.orders_.keys() == {"linear", "networks"}
    assert list(loaded.nx) == [1, 2]
    for one in (model, loaded):
        quietly(one.set_params(warm_start=True, max_iter=3), *data)
    np.testing.assert_array_equal(loaded._theta, model._theta)
    assert loaded.alpha_ == model.alpha_


@pytest.mark.parametrize(
    ("options", "is_stopped", "with_g"),
    [
        ({}, False, [True, False]),
        ({"time": "continuous", "dt": 0.1}, False, [True, False]),
        ({}, True, [True]),
        ({"n_h": 0}, False, [True]),
        ({"n_g": 0}, False, [False]),
    ],
)
def test_h_alone_is_tried_where_networks_with_g_do_not_help(
    monkeypatch, options, is_stopped, with_g
):
    """A search that was stopped is not repeated, and nobody searches for nothing."""
    real, searches = _ssnn.search, []

    def refused(*args, watch, **how):
        found = real(*args, watch=watch, **how)
        searches.append("W_g" in found.structure.parameters)
        if is_stopped:
            watch.stop(BY_OBSERVER)
        return replace(found, gain=0.0 if searches[-1] else found.gain)

    monkeypatch.setattr(_ssnn, "search", refused)
    sizes = {"n_h": 1, "n_g": 1, **options}
    model = quietly(make("al", **sizes), *soft(0, 100))
    assert searches == with_g
    assert np.any(model.params_.get("W_h", 0.0)) != with_g[-1]
    if with_g == [True, False]:
        assert not np.any(model.params_["W_g"])
        again = quietly(model.set_params(warm_start=True, max_iter=3), *soft(0, 100))
        assert len(searches) == 2 and not np.any(again.params_["W_g"])


def test_what_was_chosen_survives_a_pickle(fitted):
    again = pickle.loads(pickle.dumps(fitted))
    assert again.alpha_ == fitted.alpha_ and again.orders_ == fitted.orders_


def spoil(monkeypatch, reason=None):
    """Let a training on all samples end with a wrong model, or be ended with one."""
    real = _horizon.train

    def spoiled(penalized, experiments, starts, *, watch, **options):
        result = real(penalized, experiments, starts, watch=watch, **options)
        result.theta = result.theta.copy()
        result.theta[penalized.slices["W_h"]] *= -3
        if reason is not None:
            watch.stop(reason)
        return result

    monkeypatch.setattr(_horizon, "train", spoiled)


@pytest.fixture(scope="module")
def swinging():
    return make_pendulum(500, amplitude=4.0, noise=0.01, random_state=0)


def hanging(record):
    """Return an estimator of that record; what follows its search is tested."""
    return FlSsnn(nx=2, n_h=4, n_init=1, dt=record.dt, random_state=0)


@pytest.fixture(scope="module")
def what_was_found():
    return {}


@pytest.fixture
def searched(request, monkeypatch, what_was_found):
    """Search once for all tests with the same record, options and changed search."""
    real, case = _ssnn.search, getattr(request, "param", "plain")

    def remembered(*args, **options):
        if case not in what_was_found:
            what_was_found[case] = real(*args, **options)
        return copy.deepcopy(what_was_found[case])

    monkeypatch.setattr(_ssnn, "search", remembered)


@pytest.mark.usefixtures("searched")
def test_a_training_that_spoils_what_was_found_is_left_out(monkeypatch, swinging):
    """The model of the search is returned, not the linear one, with a warning."""
    spoil(monkeypatch)
    record = swinging
    model = hanging(record)
    with pytest.warns(ConvergenceWarning, match=r"worse than .* linear model.* Try a"):
        model.fit(record.u, record.y)
    assert model.message_.endswith("this is the model of the search")
    assert model.converged_
    linear = LinearStateSpace(nx=2, dt=record.dt).fit(record.u, record.y)
    error = np.sqrt(1 - np.array([model.train_score_, linear.train_score_]))
    assert error[0] < 0.7 * error[1]
    np.testing.assert_allclose(
        model.train_score_, model.score(record.u, record.y), rtol=1e-4
    )


@pytest.mark.parametrize("searched", ["as told"], indirect=True)
@pytest.mark.parametrize(
    ("all_are", "words", "message"),
    [
        (False, "The model that the search found", "the model of the search"),
        (
            True,
            "simulate this record worse than the linear model, which",
            "the linear model",
        ),
    ],
)
def test_a_training_that_ends_elsewhere_from_other_states_is_left_out(
    monkeypatch, swinging, searched, all_are, words, message
):
    """A good score is not enough: from other states it would be another model."""
    real = Fold.error

    def error(fold, structure, theta, x0, weight=None, *, elsewhere=False):
        far = elsewhere and any(theta is one for one in refused)
        return 9.0 if far else real(fold, structure, theta, x0, weight)

    refused, train = [], _horizon.train

    def training(penalized, experiments, starts, **options):
        result = train(penalized, experiments, starts, **options)
        refused.extend([result.theta, *starts] if all_are else [result.theta])
        return result

    monkeypatch.setattr(_horizon, "train", training)
    monkeypatch.setattr(Fold, "error", error)
    model = hanging(swinging)
    with pytest.warns(ConvergenceWarning, match=words):
        model.fit(swinging.u, swinging.y)
    assert model.message_.endswith(message)
    assert np.isinf(model.alpha_) == all_are


def _times(factor, refused):
    """Return `as_found`, the cost of the search's model that times the training's."""
    real = _safe.as_found

    def as_found(*args, **options):
        found = real(*args, **options)
        found.cost = factor * refused[-1].cost
        return found

    return as_found


@pytest.mark.usefixtures("searched")
@pytest.mark.parametrize(
    ("factor", "is_searched", "words"),
    [
        (3.9, True, "made its simulation of this record"),
        (4.1, False, "from other states of it worse"),
    ],
)
def test_a_fourth_of_the_error_outweighs_what_happens_elsewhere(
    monkeypatch, swinging, factor, is_searched, words
):
    """An arm that turns over ends elsewhere from other states, too."""
    trained, hangs = [], _safe._hangs

    def hang(estimator, result, *record):
        if result.message != _safe.SEARCHED:
            trained.append(result)
            return True
        return hangs(estimator, result, *record)

    monkeypatch.setattr(_safe, "_hangs", hang)
    monkeypatch.setattr(_safe, "as_found", _times(factor, trained))
    model = hanging(swinging)
    with pytest.warns(ConvergenceWarning, match=words):
        model.fit(swinging.u, swinging.y)
    assert ("the model of the search" in model.message_) == is_searched


@pytest.mark.usefixtures("searched")
@pytest.mark.parametrize(
    ("n_refused", "is_better", "times"),
    [(0, True, 1.0), (1, True, 3.0), (2, True, 10.0), (4, True, 0.0), (1, False, 0.0)],
)
def test_a_refused_training_is_repeated_with_a_larger_decay(
    monkeypatch, swinging, n_refused, is_better, times
):
    """The first one is kept that is not refused, if it fits better than the search."""
    real, train, alphas, asked = _safe._hangs, _horizon.train, [], []

    def hang(estimator, result, *record):
        if result.message == _safe.SEARCHED:
            return real(estimator, result, *record)
        asked.append(result)
        return len(asked) <= n_refused

    def training(*args, alpha, **options):
        alphas.append(alpha)
        result = train(*args, alpha=alpha, **options)
        if len(alphas) > 1:
            result.cost *= 1e-3 if is_better else 1e3
        return result

    monkeypatch.setattr(_horizon, "train", training)
    monkeypatch.setattr(_safe, "_hangs", hang)
    monkeypatch.setattr(_safe, "ESCAPED", np.inf)  # nothing outweighs
    model = hanging(swinging)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(swinging.u, swinging.y)
    told = any("The model that the search found" in str(w.message) for w in caught)
    assert told == (times == 0) == ("model of the search" in model.message_)
    np.testing.assert_allclose(model.alpha_, max(times, 1.0) * alphas[0], rtol=1e-12)
    n_trainings = min(n_refused + 1, 4)
    expected = alphas[0] * np.array([1.0, 3.0, 10.0, 30.0])[:n_trainings]
    np.testing.assert_allclose(alphas, expected, rtol=1e-12)
    assert len(asked) == (n_trainings if is_better else 1)


@pytest.mark.parametrize("searched", ["led nowhere"], indirect=True)
@pytest.mark.parametrize("n_escapes", [1, 2])
def test_a_training_that_other_inputs_lead_away_is_left_out(
    monkeypatch, swinging, searched, n_escapes
):
    asked = []

    def leads(excursion, structure, theta, x0):
        asked.append(len(excursion.experiments))
        # every training, and then the model of the search
        return len(asked) % 2 == 1 or n_escapes == 2

    # along the paths of the search, nothing is led away
    monkeypatch.setattr(walking.Path, "_leaves", lambda path: False)
    monkeypatch.setattr(Excursion, "leads", leads)
    model = hanging(swinging)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(swinging.u, swinging.y)
    # what the search found does so, too: it may be the plant
    assert ("the model of the search" in model.message_) == (n_escapes == 1)
    told = any("a quarter larger" in str(w.message) for w in caught)
    assert told == (n_escapes == 1)
    assert asked[:2] == [1, 1]  # the training, and the model of the search


@pytest.mark.usefixtures("searched")
@pytest.mark.parametrize(("n_opened", "times"), [(0, 1), (1, 3), (2, 10)])
def test_a_training_that_moves_two_places_apart_is_repeated(
    monkeypatch, swinging, n_opened, times
):
    asked, alphas, train = [], [], _horizon.train

    def opens(excursion, structure, before, after):
        if before is not after and not any(after is one for one in asked):
            asked.append(after)
        return before is not after and any(after is one for one in asked[:n_opened])

    def training(*args, alpha, **options):
        alphas.append(alpha)
        result = train(*args, alpha=alpha, **options)
        result.cost *= 1e-3 ** len(alphas)  # better than the model of the search
        return result

    monkeypatch.setattr(_horizon, "train", training)
    monkeypatch.setattr(_safe, "ESCAPED", np.inf)  # nothing outweighs
    monkeypatch.setattr(Excursion, "opens", opens)
    monkeypatch.setattr(Excursion, "leads", lambda *_: False)
    model = hanging(swinging).fit(swinging.u, swinging.y)
    assert len(asked) == n_opened + 1 == len(alphas)
    np.testing.assert_allclose(model.alpha_, times * alphas[0], rtol=1e-12)


@pytest.mark.usefixtures("searched")
@pytest.mark.parametrize(
    ("opens", "leads", "words"),
    [
        (True, False, "gave it a second place"),
        (False, True, "under inputs that are a quarter larger, an output deviates"),
    ],
)
def test_a_refused_training_says_why(monkeypatch, swinging, opens, leads, words):
    found = []

    def as_found(*args, **options):
        found.append(_as_found(*args, **options))
        return found[-1]

    def is_trained(theta):
        return not any(np.array_equal(theta, one.theta) for one in found)

    _as_found = _safe.as_found
    monkeypatch.setattr(_safe, "as_found", as_found)
    monkeypatch.setattr(_safe, "ESCAPED", np.inf)  # nothing outweighs
    monkeypatch.setattr(Excursion, "opens", lambda *_: opens)
    monkeypatch.setattr(Excursion, "latches", lambda *_: False)
    monkeypatch.setattr(walking.Path, "_leaves", lambda path: False)
    monkeypatch.setattr(
        Excursion,
        "leads",
        lambda self, structure, theta, x0: leads and is_trained(theta),
    )
    monkeypatch.setattr(_safe._Goes, "_is", _only_trained(_safe._Goes._is, is_trained))
    with pytest.warns(ConvergenceWarning, match=words):
        model = hanging(swinging).fit(swinging.u, swinging.y)
    assert "the model of the search" in model.message_


def _only_trained(asked, is_trained):
    """Return the question, answered by no for what the search found."""

    def only(self, question, result):
        return is_trained(result.theta) and asked(self, question, result)

    return only


def test_a_pole_that_hardly_decays_is_named_where_networks_do_not_help():
    """The plant is unstable, and a controller holds it."""
    rng = np.random.default_rng(1)
    u, y, x = np.zeros((300, 1)), np.zeros(300), 0.0
    for k in range(300):
        y[k] = x + 0.1 * rng.standard_normal()
        u[k] = rng.standard_normal() - 0.15 * y[k]
        x = 1.01 * x + u[k, 0] + 0.3 * rng.standard_normal()
    model = make("fl", integrators=0, nx=1, max_iter=15, n_init=1)
    with pytest.warns(ConvergenceWarning, match="fit with noise='innovations'"):
        model.fit(u, y)
    assert model.alpha_ == np.inf


@pytest.mark.usefixtures("searched")
@pytest.mark.parametrize("reason", [OUT_OF_TIME, INTERRUPTED, BY_OBSERVER])
def test_what_ended_a_spoiled_training_is_said(monkeypatch, swinging, reason):
    """A fit that was ended from outside has not converged, whatever it returns."""
    spoil(monkeypatch, reason)
    model = hanging(swinging)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model.fit(swinging.u, swinging.y)
    assert (model.message_, model.converged_) == (reason, False)
    assert model.train_score_ > 0.9
    assert not any("made its simulation" in str(w.message) for w in caught)

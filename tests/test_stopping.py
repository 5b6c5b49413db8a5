"""What ends a fit before its time, and what is left of it."""

import pickle
import re
import sys
import time
import warnings
from contextlib import nullcontext

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

from alssnn import FlSsnn, LinearStateSpace
from alssnn.criterion import Criterion
from alssnn.estimators import _noise, _progress
from alssnn.optimizers import minimize
from alssnn.sections import Sections
from alssnn.training import Validation
from alssnn.watch import OUT_OF_TIME, Patience, Step, Watch, late_fall
from models import al_ssnn, fl_ssnn


@pytest.fixture(autouse=True)
def _short_fits():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        yield


def plant(rng, n, noise=0.0):
    """Return a record of a plant with 2 inputs and 2 outputs that h can linearize."""
    A = np.array([[0.7, 0.2], [-0.2, 0.6]])
    B = np.array([[0.4, 0.1], [0.0, 0.5]])
    u, x, y = rng.standard_normal((n, 2)), rng.standard_normal(2), np.empty((n, 2))
    for k in range(n):
        y[k] = x
        x = A @ x + B @ (u[k] + 0.8 * np.tanh(x[::-1]))
    return 3.0 * u + 10.0, 50.0 * (y + noise * rng.standard_normal(y.shape))


@pytest.fixture(scope="module")
def two():
    """Two experiments, stacked."""
    rng = np.random.default_rng(0)
    (u1, y1), (u2, y2) = (plant(rng, n, noise=0.02) for n in (300, 200))
    return np.vstack([u1, u2]), np.vstack([y1, y2]), np.repeat([0, 1], [300, 200])


@pytest.fixture(scope="module")
def brief(two):
    """The end of one experiment and the start of the other: searches are short."""
    return tuple(z[200:400] for z in two)


@pytest.fixture
def interrupt(monkeypatch):
    """Return a function that sends an interrupt at a call of `normal_equations`."""
    calls = {"count": 0, "at": None}

    def interruptible(original):
        def normal_equations(self, free):
            calls["count"] += 1
            if calls["count"] == calls["at"]:
                raise KeyboardInterrupt
            return original(self, free)

        return normal_equations

    def at(call):
        calls.update(count=0, at=call)
        return calls

    for kind in (Criterion, Sections):
        replacement = interruptible(kind.normal_equations)
        monkeypatch.setattr(kind, "normal_equations", replacement)
    # its initial states are searches, too, but come when the fit is over
    monkeypatch.setattr("alssnn.estimators._base.training_score", lambda *_: 0.0)
    return at


# -- interrupts ------------------------------------------------------------------------


@pytest.mark.parametrize("coarse_samples", [None, 200])
def test_an_interrupted_fit_goes_on_to_the_same_cost(two, interrupt, coarse_samples):
    model = fl_ssnn(
        2,
        3,
        gamma_h=1e-3,  # without it the valley is flat, and where a fit ends is chance
        max_iter=100,
        polish_iter=100,
        tol=1e-8,
        coarse_samples=coarse_samples,
        warm_start=True,
        random_state=0,
    )
    calls = interrupt(None)
    whole = clone(model).fit(*two)
    total, linear_cost = calls["count"], whole.history_[0].cost
    for seed in range(2):
        once = clone(model)
        call = int(np.random.default_rng(seed).integers(1, total))
        interrupt(call)
        with pytest.raises(KeyboardInterrupt):
            once.fit(*two)
        assert once.message_ == "interrupted"
        assert not once.converged_
        assert once.cost_ <= linear_cost
        assert np.isfinite(once.predict(two[0], two[2])).all()
        assert once.score(*two) > 0.5
        interrupt(None)
        once.fit(*two)
        assert once.cost_ == pytest.approx(whole.cost_, rel=0.01)


def test_an_interrupt_keeps_the_best_parameters_so_far(two, interrupt):
    model = al_ssnn(2, 2, 2, max_iter=40, coarse_samples=None, random_state=0)
    interrupt(None)
    whole = clone(model).fit(*two)
    training = [step for step in whole.history_ if step.label == "train"]
    linear = interrupt(None)
    clone(model).set_params(n_h=0, n_g=0).fit(*two)
    interrupt(linear["count"] + 30)
    with pytest.raises(KeyboardInterrupt):
        model.fit(*two)
    assert 1 < len(model.history_) < len(whole.history_)
    # the step at which the interrupt came had been accepted
    assert model.cost_ == pytest.approx(model.history_[-1].cost)
    assert model.cost_ <= training[0].cost


def test_an_interrupted_linear_start_is_a_model(two, interrupt):
    model = al_ssnn(2, 2, 2, max_iter=40, random_state=0)
    interrupt(3)
    with pytest.raises(KeyboardInterrupt):
        model.fit(*two)
    assert model.score(*two) > 0.5
    assert not np.any(model.params_["W_h"])  # still the linear model
    assert {step.label for step in model.history_} == {"linear"}
    interrupt(3)
    with pytest.raises(KeyboardInterrupt):
        LinearStateSpace(2).fit(*two)


def test_an_interrupt_before_there_is_a_model_leaves_none(two, monkeypatch):
    def interrupted(*args, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("alssnn.subspace.hankel_triangle", interrupted)
    model = al_ssnn(2, 2, 2)
    with pytest.raises(KeyboardInterrupt):
        model.fit(*two)
    assert not hasattr(model, "A_")


def test_an_interrupt_between_two_searches_keeps_the_stage_before(two, monkeypatch):
    from alssnn import training

    original, calls = training.estimate_x0, []

    def interrupted(structure, theta, experiments, **options):
        calls.append(len(experiments[0][0]))
        if calls.count(300) == 1 and calls[-1] == 300:  # all samples, the first time
            raise KeyboardInterrupt
        return original(structure, theta, experiments, **options)

    monkeypatch.setattr(training, "estimate_x0", interrupted)
    model = al_ssnn(2, 2, 2, max_iter=20, coarse_samples=200, random_state=0)
    with pytest.raises(KeyboardInterrupt):
        model.fit(*two)
    assert "stage 1/2, train" in {step.label for step in model.history_}
    assert model.score(*two) > 0.95
    assert np.any(model.params_["W_h"])


@pytest.mark.parametrize("where", ["bridged", "second", "time"])
@pytest.mark.parametrize(
    "model", [LinearStateSpace(2), al_ssnn(2, 2, 2, max_iter=5, random_state=0)]
)
def test_the_model_before_gaps_are_predicted_is_kept(two, monkeypatch, model, where):
    u, y, experiment = two
    y = np.where(np.random.default_rng(0).random(y.shape) < 0.1, np.nan, y)
    model = clone(model).set_params(noise="innovations")
    identify, outcomes = type(model)._identify, []

    def identified(self, experiments, previous, watch, held_out):
        if outcomes:
            assert where == "second"
            self.singular_values_ = self._decay = None  # what a fit sets on its way
            raise KeyboardInterrupt
        outcomes.append(identify(self, experiments, previous, watch, held_out))
        if where == "time":
            watch.stop(OUT_OF_TIME)
        return outcomes[0]

    def interrupted(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(type(model), "_identify", identified)
    if where == "bridged":
        monkeypatch.setattr(_noise, "bridged", interrupted)
    with nullcontext() if where == "time" else pytest.raises(KeyboardInterrupt):
        model.fit(u, y, experiment)
    _, theta, result = outcomes[0]
    np.testing.assert_array_equal(model._theta, theta)
    assert model.cost_ == result.cost
    assert len(model.singular_values_) and np.isfinite(model.noise_covariance_).all()
    if where != "time":
        assert model.message_ == "interrupted" and not model.converged_
    assert np.nanstd(y - model.predict_ahead(u, y, 1, experiment)) < np.nanstd(y) / 2


@pytest.mark.parametrize("stability", [None, "contractive"])
def test_interrupts_in_every_parametrization(two, interrupt, stability):
    model = al_ssnn(
        2, 2, 2, gamma=0.1, max_iter=40, random_state=0, stability=stability
    )
    calls = interrupt(None)
    clone(model).fit(*two)
    interrupt(calls["count"] - 3)
    with pytest.raises(KeyboardInterrupt):
        model.fit(*two)
    if stability:
        A = model._structure.split(model._theta)["A"]
        assert np.linalg.norm(A, 2) <= np.sqrt(1 - model.phi) + 1e-12
    assert model.score(*two) > 0.95


# -- time ------------------------------------------------------------------------------


@pytest.mark.parametrize("model", [al_ssnn(2, 2, 2), LinearStateSpace(2)], ids=repr)
def test_max_time_ends_a_fit_with_a_model(two, model):
    model = clone(model).set_params(max_time=1e-9)
    with pytest.warns(ConvergenceWarning, match="Increase `max_time`"):
        model.fit(*two)
    assert not model.converged_
    assert model.message_ == "max_time is over"
    assert np.isfinite(model.cost_)
    assert model.score(*two) > 0.5


def test_max_time_ends_a_search_at_its_next_trial_step(rng, monkeypatch):
    clock = iter(range(10**6))  # a second at every look
    monkeypatch.setattr("alssnn.watch.time.time", lambda: next(clock))
    u, y = plant(rng, 300)
    free = {"n": 0}
    original = Criterion.norm

    def counted(self, point):
        free["n"] += 1
        return original(self, point)

    monkeypatch.setattr(Criterion, "norm", counted)
    model = al_ssnn(2, 2, 2, max_time=60, max_iter=10**4, tol=1e-15, random_state=0)
    model.fit(u, y)
    assert model.message_ == "max_time is over"
    assert 5 < model.history_[-1].seconds <= 62
    assert free["n"] < 300


def test_starts_in_other_processes_share_the_time(two):
    model = al_ssnn(2, 3, 3, n_init=3, n_jobs=2, max_iter=10**5, tol=1e-15)
    model.set_params(max_time=1.0, random_state=0)
    start = time.perf_counter()
    model.fit(*two)
    assert time.perf_counter() - start < 30  # far below what max_iter would take
    assert model.message_ == "max_time is over"


# -- validation ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def overfit():
    """A short noisy record, and a long one of the same plant."""
    rng = np.random.default_rng(1)
    return plant(rng, 80, noise=0.3), plant(rng, 600, noise=0.3)


def test_validation_keeps_what_is_best_on_other_data(overfit):
    train, other = overfit
    model = al_ssnn(2, 12, 12, gamma=0.01, max_iter=150, tol=1e-12, random_state=0)
    free = clone(model).fit(*train)
    model.fit(*train, validation=other)
    assert model.score(*other) > free.score(*other)
    assert model.converged_
    assert model.message_ == "the validation error no longer falls"
    errors = np.array([s.validation_rmse for s in model.history_ if s.label == "train"])
    best = int(np.argmin(errors))
    assert len(errors) - 1 - best == model.n_iter_no_change
    # the model is that of the best step, and its error is the one of `simulate_test`
    costs = [s.cost for s in model.history_ if s.label == "train"]
    assert model.cost_ == pytest.approx(costs[best])
    y, y_hat = model.simulate_test(*other)
    scaled = (y - y_hat) / model._scaling.y_scale
    assert errors[best] == pytest.approx(np.sqrt(np.mean(scaled**2)), rel=0.02)


def test_a_fraction_is_the_end_of_every_experiment_and_is_not_fitted(two):
    u, y, experiment = two
    model = al_ssnn(2, 2, 2, validation_fraction=0.25, max_iter=15, random_state=0)
    model.fit(u, y, experiment)
    other = y.copy()
    heads, tails = np.r_[0:225, 300:450], np.r_[225:300, 450:500]
    # outputs of the tail only judge: another value of equal moments changes no start
    other[tails] = y[tails][::-1]
    changed = clone(model).fit(u, other, experiment)
    first = [m.history_[0] for m in (model, changed)]
    assert first[0].cost == pytest.approx(first[1].cost, rel=1e-9)
    errors = [m.history_[-1].validation_rmse for m in (model, changed)]
    assert errors[1] > 3 * errors[0]
    assert model.x0_.shape == (2, 2)
    assert len(heads) + len(tails) == len(u)


def test_the_tail_of_a_delayed_input_knows_what_was_sent_before(rng):
    u, y = plant(rng, 200)
    y = np.vstack([np.zeros((3, 2)), y[:-3]])  # every input arrives 3 samples late
    model = al_ssnn(2, 2, 2, input_delay=3, validation_fraction=0.2)
    model.max_time = None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.set_params(max_iter=2).fit(u, y)
    parts = [slice(0, 200)]
    experiments, judge = model._hold_out(u, y, parts, None)
    assert len(experiments[0][0]) == 160
    whole = model._experiments(u, y, parts)[0][0]
    np.testing.assert_array_equal(judge.scored[0][0], whole[160:])
    assert np.any(judge.scored[0][0][0])


def test_a_model_that_diverges_on_validation_data_is_never_the_best(rng):
    errors = iter([3.0, np.inf, 2.0, np.inf, np.inf])
    patience = Patience(lambda point: next(errors), n_iter_no_change=2)
    seen = [patience.look(np.array([float(i)])) for i in range(5)]
    assert seen[3] == np.inf and patience.is_over
    assert patience.best[0] == 2.0 and patience.least == 2.0


def test_every_output_counts_by_its_weight(rng):
    u, y = plant(rng, 400)
    model = al_ssnn(2, 2, 2, max_iter=3, random_state=0).fit(u, y)
    experiments = model._experiments(u, y, [slice(0, 400)])
    y_s = np.array(experiments[0][1])
    wrong = [(experiments[0][0], y_s + np.array([0.0, 5.0]))]
    criterion = Criterion(model._structure, experiments)
    free = criterion.join(model._theta, model.x0_)
    first, both = (
        Validation(wrong, weight, 50, 3).patience(criterion).look(free)
        for weight in ([1.0, 0.0], [1.0, 1.0])
    )
    assert first < 0.5 < 2.0 < both


@pytest.mark.parametrize(
    ("validation", "message"),
    [
        ("tail", r"`validation` must be a tuple \(u, y\)"),
        ((np.ones((4, 2)), np.ones((4, 2))), "Validation needs at least 8 samples"),
        ((np.ones((20, 2)), np.ones(20)), "`y` must have the outputs of .* 2, got 1"),
        ((np.ones((20, 3)), np.ones((20, 2))), "3 features"),
        ((np.ones((20, 2)), np.full((20, 2), np.nan)), "needs measured outputs"),
    ],
)
def test_validation_errors(two, validation, message):
    with pytest.raises(ValueError, match=message):
        al_ssnn(2, 1, 1).fit(*two, validation=validation)


# -- history and callbacks of the search ---------------------------------------------


def test_history_tells_the_whole_fit(two):
    model = al_ssnn(2, 2, 2, max_iter=10, coarse_samples=200, random_state=0).fit(*two)
    labels = list(dict.fromkeys(step.label for step in model.history_))
    assert labels == ["linear", "stage 1/2, train", "stage 2/2, all samples"]
    for label in labels:
        steps = [step for step in model.history_ if step.label == label]
        assert steps[0].iteration == 0
        assert steps[-1].cost <= steps[0].cost
    assert np.all(np.diff([step.seconds for step in model.history_]) >= 0)
    assert model.history_[-1].cost == pytest.approx(model.cost_)
    assert model.history_[0]._fields == Step._fields
    assert repr(pickle.loads(pickle.dumps(model)).history_) == repr(model.history_)


def test_several_starts_name_their_stages(two):
    model = al_ssnn(2, 2, 2, gamma=0.1, continuation=1, n_init=2, max_iter=4)
    model.set_params(coarse_samples=200, random_state=0).fit(*two)
    labels = list(dict.fromkeys(step.label for step in model.history_))
    assert labels == [
        "linear",
        "start 1/2, stage 1/3, gamma 0.316",
        "start 1/2, stage 2/3, gamma 0.1",
        "start 2/2, stage 1/3, gamma 0.316",
        "start 2/2, stage 2/3, gamma 0.1",
        "stage 3/3, all samples",
    ]


def test_progress_has_a_line_per_search(two, capsys):
    options = {"gamma": 0.1, "continuation": 2, "max_iter": 5, "random_state": 0}
    model = al_ssnn(2, 2, 2, linear_part="trained", **options)
    model.fit(*two)
    assert capsys.readouterr().out == ""
    model.set_params(verbose=1).fit(*two)
    lines = capsys.readouterr().out.splitlines()
    n_searches = sum(step.iteration == 0 for step in model.history_)
    assert len(lines) == n_searches == 4
    assert "stage 1/3, gamma 1: cost " in lines[1]
    last = [step for step in model.history_ if step.label == "stage 3/3, gamma 0.1"]
    costs = f"cost {last[0].cost:.4g} to {model.cost_:.4g} in {len(last) - 1} steps"
    assert lines[-1].startswith("AlSsnn ") and lines[-1].endswith(costs)
    model.set_params(verbose=2).fit(*two)
    assert len(capsys.readouterr().out.splitlines()) == len(model.history_)


def test_long_stages_show_that_they_go_on(monkeypatch, capsys):
    clock = [0.0]
    monkeypatch.setattr(_progress.time, "time", lambda: clock[0])
    progress = _progress.Progress("Model")
    for iteration in range(7):
        progress.step("train", iteration, 1.0 / (1 + iteration))
        clock[0] += 4.0
    progress.end("train", 7, 0.14)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("train: ")[1] for line in lines] == [
        "step 3: cost 0.25",
        "step 6: cost 0.1429",
        "cost 1 to 0.14 in 6 steps",
    ]


def test_a_bar_shows_search_and_training(brief, capsys):
    pytest.importorskip("tqdm")
    options = {"max_iter": 8, "n_init": 1, "integrators": 0, "random_state": 0}
    silent = FlSsnn(nx=2, n_h=2, **options).fit(*brief)
    assert capsys.readouterr().err == ""
    shown = FlSsnn(nx=2, n_h=2, verbose="bar", **options).fit(*brief)
    assert shown.cost_ == silent.cost_  # and to the last bit
    out, err = capsys.readouterr()
    assert out == ""
    for label in {step.label for step in shown.history_} | {"search"}:
        assert f"FlSsnn, {label}: " in err
    assert "% of the error of the linear model" in err
    assert re.search(r"\[\d\d:\d\d<\d\d:\d\d", err)  # time taken and left


def test_a_bar_counts_the_starts_of_other_processes(brief, capsys):
    pytest.importorskip("tqdm")
    options = {"max_iter": 8, "n_init": 3, "random_state": 0, "alpha": 1e-3}
    options["integrators"] = 0
    silent = FlSsnn(nx=2, n_h=2, **options).fit(*brief)
    shown = FlSsnn(nx=2, n_h=2, verbose="bar", n_jobs=2, **options).fit(*brief)
    assert shown.cost_ == silent.cost_
    err = capsys.readouterr().err
    assert re.search(r"FlSsnn, starts: .* 3/3 .*least cost .* of the linear model", err)
    assert "start 1/3" not in err  # two processes would write over each other


@pytest.mark.parametrize("n_jobs", [None, 2])
def test_stages_of_a_search_are_told(n_jobs, brief, monkeypatch):
    told = []
    monkeypatch.setattr(_progress.Progress, "search", lambda _, *z: told.append(z))
    options = {"n_init": 2, "random_state": 0, "verbose": 1, "n_jobs": n_jobs}
    options["integrators"] = 0
    model = FlSsnn(nx=[2, 3], n_h=2, max_iter=15, **options).fit(*brief)
    done, of, share = zip(*told, strict=True)
    assert len(set(of)) == 1 and list(done) == sorted(set(done)) and done[-1] <= of[0]
    assert list(share) == sorted(share, reverse=True)
    best = model.orders_["networks"][model.nx_] / min(model.orders_["linear"].values())
    assert share[-1] == pytest.approx(best, rel=1e-6)


def test_a_bar_needs_tqdm(two, monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    with pytest.raises(
        ImportError, match=r"needs tqdm: pip install \"alssnn\[progress"
    ):
        FlSsnn(nx=2, verbose="bar").fit(*two)


def test_late_fall_is_that_of_the_last_search():
    def steps(label, *costs):
        return [Step(label, i, c, 0.0, np.nan) for i, c in enumerate(costs)]

    first = steps("stage 1/2", 8.0, 4.0, 2.0)
    fall, n_steps = late_fall(first + steps("stage 2/2", 5.0, 4.0, 3.0, 2.0))
    assert (fall, n_steps) == (0.5, 2)
    # a step that rises is not where a search ends
    fall, n_steps = late_fall(steps("train", 5.0, 4.0, 3.0, 3.5))
    assert (fall, n_steps) == (0.25, 2)
    assert np.isnan(late_fall(first + steps("stage 2/2", 5.0))[0])
    assert np.isnan(late_fall([])[0])


def test_the_warning_says_how_much_the_cost_still_fell(two):
    model = al_ssnn(2, 2, 2, max_iter=8, random_state=0)
    with pytest.warns(ConvergenceWarning, match="stopped after") as caught:
        model.fit(*two)
    fall, n_steps = late_fall(model.history_)
    expected = f"Its last {n_steps} steps lowered the cost by {100 * fall:.2g} %."
    assert str(caught[0].message).endswith(expected)


def test_an_observer_ends_the_whole_fit(rng):
    u, y = plant(rng, 300)
    criterion = Criterion(al_ssnn(2, 2, 2, max_iter=1).fit(u, y)._structure, [(u, y)])
    seen = []
    watch = Watch(observe=lambda step, point: seen.append(point) or len(seen) == 3)
    start = np.full(criterion.n, 0.01)
    result = minimize(criterion, start, watch=watch)
    assert len(seen) == 3
    assert result.message == "stopped by a callback"
    np.testing.assert_array_equal(result.x, seen[-1])
    again = minimize(criterion, result.x, watch=watch)
    assert again.nfev == 0 and again.cost == pytest.approx(result.cost)


@pytest.mark.parametrize("n_init", [1, 2])
def test_a_training_takes_no_more_than_its_trial_steps(two, n_init):
    model = al_ssnn(2, 2, 2, n_init=n_init, max_iter=7, tol=1e-12, random_state=0)
    model.fit(*two)
    assert model.n_iter_ == 7
    assert "max_iter" not in model.message_  # each stage has a limit of its own
    model.set_params(continuation=2).fit(*two)
    assert 7 < model.n_iter_ <= 3 * 7
    for what in ("continuation", "n_iter_", "polish_iter"):
        assert what in type(model).__doc__.partition("max_iter : ")[2][:600]


def test_a_long_record_asks_for_more_steps_of_the_stage_that_ended(two):
    model = al_ssnn(2, 2, 2, coarse_samples=40, polish_iter=2, max_iter=5, tol=1e-12)
    with pytest.warns(ConvergenceWarning, match="Increase `polish_iter`"):
        model.fit(*two)

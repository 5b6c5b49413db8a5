"""Records of closed loops: what is found of them, and how models are judged on them."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from alssnn import LinearStateSpace
from alssnn.innovations import predictor
from alssnn.plotting import ResidualDisplay
from alssnn.simulation import outputs
from alssnn.validation import (
    Check,
    FeedbackTests,
    feedback_tests,
    judged_experiments,
    residual_tests,
)
from alssnn.validation._closed_loop import feedback_check, in_closed_loop
from alssnn.validation._predicted import sent_experiments
from benchmarks import feedback as benchmark

LEVEL = 0.01


def loop(n, seed, gain=0.4, *, reference=1.0, process=1.0, pole=0.8, law=None):
    """Return u, y, the simulation without noise, and the errors one sample ahead.

    y+ = pole y + u + process noise; nothing disturbs the sensor, so that the noise is
    the error one sample ahead, one sample later.  u is made of y of the same sample.
    """
    rng = np.random.default_rng(seed)
    r, w = reference * rng.standard_normal(n), process * rng.standard_normal(n)
    r = lfilter([1], [1, -0.5], r)
    law = (lambda y: -gain * y) if law is None else law
    u, y, clean = np.empty(n), np.zeros(n), np.zeros(n)
    for k in range(n):
        u[k] = r[k] + law(y[k])
        if k + 1 < n:
            y[k + 1] = pole * y[k] + u[k] + w[k]
            clean[k + 1] = pole * clean[k] + u[k]
    return u[:, None], y[:, None], clean[:, None], np.r_[0.0, w[:-1]][:, None]


# -- feedback in a record --------------------------------------------------------------


def repeated(seed, n_periods=16, period=128, gain=0.0):
    """Return u, y and a simulation that is wrong, of a reference that repeats."""
    rng = np.random.default_rng(seed)
    r = np.tile(lfilter([1], [1, -0.5], rng.uniform(-1, 1, period)), n_periods)
    w = 0.002 * rng.standard_normal(len(r))
    u, x, clean = np.empty(len(r)), np.zeros(len(r)), np.zeros(len(r))
    for k in range(len(r)):
        u[k] = r[k] - gain * (x[k] + w[k])
        if k + 1 < len(r):
            x[k + 1] = 0.8 * x[k] + u[k] - 0.3 * np.tanh(x[k])
            clean[k + 1] = 0.6 * clean[k] + u[k]
    return u[:, None], (x + w)[:, None], clean[:, None]


@pytest.mark.parametrize("period", [None, 128])
def test_an_input_that_repeats_was_moved_by_no_noise(period):
    """Though the error of the model repeats, too, sixteen times."""
    for seed in range(10):
        u, y, clean = repeated(seed)
        tests = feedback_tests([(u, y, clean)], simulated=[clean], period=period)
        assert not tests.found(1e-3).any() and tests.p == 1.0
        # what was measured of it has noise of its own
        u = u + 0.002 * np.random.default_rng(seed + 10).standard_normal(u.shape)
        tests = feedback_tests([(u, y, clean)], simulated=[clean], period=128)
        assert not tests.found(1e-3).any() and tests.p_values.min() < 1


def test_an_input_that_was_sent_twice_was_moved_by_no_noise():
    """Though the error of the model is the same in both experiments."""
    runs = [
        (u[: len(u) // 16], y[: len(u) // 16], clean[: len(u) // 16])
        for u, y, clean in (repeated(0), repeated(0))
    ]
    assert feedback_tests(runs).p == 1.0
    u, y, clean = repeated(0, gain=0.4)  # one that was moved counts as before
    assert feedback_tests([*runs, (u, y, clean)]).found(1e-3).any()


@pytest.mark.parametrize("n_periods", [2, 3, 16])
def test_a_loop_is_found_between_periods(n_periods):
    for seed in range(5):
        u, y, clean = repeated(seed, n_periods, 256, gain=0.4)
        tests = feedback_tests([(u, y, clean)], period=256)
        assert tests.found(1e-3).any()


def test_between_periods_no_sample_counts_twice():
    """The rate of false alarms is the nominal one with as few as two periods."""
    found = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        u, noise = rng.standard_normal((2, 512, 1))
        found += feedback_tests([(u, noise, 0 * u)], period=256).p < 0.05
    assert binom.sf(found - 1, 100, 0.05) > 0.001


@pytest.mark.parametrize("ahead", [False, True])
def test_nothing_is_found_in_open_loop(ahead):
    """At the nominal rate, and though the model is wrong in how it takes u."""
    seeds, found = 100, 0
    for seed in range(seeds):
        u, y, clean, eps = loop(400, seed, gain=0.0)
        if ahead:
            experiments = [(u, y, y - eps)]
        else:
            experiments = [(u, y, 0.7 * clean)]
        tests = feedback_tests(experiments, simulated=[clean], ahead=ahead)
        found += tests.found(0.05).any()
        assert tests.found(0.05).any() == (tests.p < 0.05)
    assert binom.ppf(0.001, seeds, 0.05) <= found <= binom.ppf(0.999, seeds, 0.05)


@pytest.mark.parametrize("ahead", [False, True])
def test_a_loop_is_found(ahead):
    for seed in range(10):
        u, y, clean, eps = loop(600, seed)
        y_hat = y - eps if ahead else clean
        tests = feedback_tests([(u, y, y_hat)], simulated=[clean], ahead=ahead)
        assert tests.found(LEVEL)[0, 1]
        assert 0.1 < tests.by_outputs[0] < 0.5


def test_a_controller_with_a_delay_acts_on_noise_of_the_past():
    for seed in range(10):
        u, y, _, eps = loop(600, seed, gain=0.0)
        late = np.vstack([[[0.0]], y[:-1]])
        tests = feedback_tests([(u - 0.4 * late, y, y - eps)], ahead=True)
        assert tests.found(LEVEL)[0].tolist() == [True, False]
        assert tests.shares[0, 0] > 0.1
        assert tests.shares[0, 1] < 0.02


def test_noise_of_the_same_sample_counts_only_without_feedthrough():
    rng = np.random.default_rng(0)
    u, noise = rng.standard_normal((2, 500, 1))
    experiments = [(u + noise, u + noise, u)]
    assert feedback_tests(experiments).found(LEVEL)[0].tolist() == [False, True]
    assert not feedback_tests(experiments, direct=False).found(LEVEL).any()


@pytest.mark.parametrize(
    "law",
    [
        lambda y: -0.4 * y,
        lambda y: np.clip(-0.4 * y, -0.3, 0.3),
        lambda y: -np.arctan(y),
    ],
)
def test_that_nothing_but_y_moves_u_is_seen(law):
    u, y, _, eps = loop(800, 0, reference=0.0, law=law)
    tests = feedback_tests([(u, y, y - eps)], ahead=True)
    assert tests.found(LEVEL).any() and tests.by_outputs[0] > 0.99
    u, y, _, eps = loop(800, 0, reference=0.2, law=law)
    tests = feedback_tests([(u, y, y - eps)], ahead=True)
    assert tests.by_outputs[0] < 0.98


def test_only_inputs_that_are_moved_are_asked_and_gaps_do_no_harm():
    u, y, clean, _ = loop(900, 0)
    rng = np.random.default_rng(1)
    d = y + rng.standard_normal(y.shape)  # a disturbance that knows y is no feedback
    y[rng.random(len(y)) < 0.3] = np.nan
    both = np.hstack([d, u])
    experiments = [
        (both[:500], y[:500], clean[:500]),
        (both[500:], y[500:], clean[500:]),
    ]
    tests = feedback_tests(experiments, moved=[1], input_names=["valve"])
    assert tests.p_values.shape == (1, 2) and tests.input_names == ["valve"]
    free, _, clean, _ = loop(900, 3, gain=0.0)
    noisy = clean + rng.standard_normal(clean.shape)
    experiments = [(np.hstack([noisy, free]), noisy, clean)]
    assert feedback_tests(experiments).found(LEVEL)[0].any()
    assert not feedback_tests(experiments, moved=[1]).found(LEVEL).any()


def test_what_the_past_of_u_tells_is_no_feedback():
    u = np.sin(0.3 * np.arange(500.0))[:, None]
    y = np.vstack([[[0.0]], u[:-1]])
    noise = np.random.default_rng(0).standard_normal(u.shape)
    tests = feedback_tests([(u, y + noise, y)])
    assert tests.p == 1.0 and not tests.shares.any()
    exact = feedback_tests([(noise, y, y)])  # nor is a residual of rounding
    assert not exact.found(LEVEL).any()


def test_a_short_record_tells_nothing_of_feedback():
    u, y, clean, _ = loop(41, 0)
    assert feedback_tests([(u, y, clean)]) is None
    check = feedback_check(None, LEVEL, ahead=False)
    assert not check.decides and check.undecided and "too short" in check.sentence


def found(p_past, p_same, by_y=0.3):
    """Return tests of two inputs, the second of which has given p-values."""
    return FeedbackTests(
        np.array([[0.5, 0.5], [p_past, p_same]]),
        np.array([[0.0, 0.0], [0.12, 0.34]]),
        np.array([0.999, by_y]),
        ["fan", "valve"],
    )


@pytest.mark.parametrize("ahead", [False, True])
def test_words_of_the_check_of_feedback(ahead):
    check = feedback_check(found(0.0024, 0.5), LEVEL, ahead)
    assert check.outcome == "note" and check.value == pytest.approx(4 * 0.0024)
    assert "noise of the past explains 12 %" in check.sentence
    assert "of valve" in check.sentence and "fan" not in check.sentence
    assert ("fit with noise='innovations'" in check.sentence) != ahead
    assert ("does no harm" in check.sentence) == ahead
    assert "Outputs explain 30 % of it for valve; something else" in check.sentence
    check = feedback_check(found(0.5, 0.0024, 0.991), LEVEL, ahead)
    assert "noise of the same sample explains 34 %" in check.sentence
    assert "`feedthrough=True`" in check.sentence
    assert "nothing but y moves u" in check.sentence
    assert "Add a reference." in check.sentence
    check = feedback_check(found(0.0026, 0.0026, 0.999), LEVEL, ahead)
    assert check.outcome == "pass" and "No feedback found" in check.sentence


def blocks(passed):
    names = ("independence", "squares", "cubes")
    return [Check(name, passed, 0.5, "p-value", True, "It is so.") for name in names]


def test_a_pass_in_closed_loop_is_open_where_the_simulation_error_is_biased():
    feedback = found(0.0, 0.5)
    first, *others = in_closed_loop(blocks(True), feedback, LEVEL, False, 0.2)
    assert first.outcome == "open" and [c.outcome for c in others] == ["pass", "pass"]
    assert "the past of the residual tells 20 % of the output" in first.sentence
    assert "fit with noise='innovations'" in first.sentence
    for unharmed in (
        in_closed_loop(blocks(True), feedback, LEVEL, False, 0.0),  # small, or white
        in_closed_loop(blocks(True), feedback, LEVEL, True, 0.2),
        in_closed_loop(blocks(True), found(0.5, 0.5), LEVEL, False, 0.2),
        in_closed_loop(blocks(True), None, LEVEL, False, 0.2),
    ):
        assert unharmed == blocks(True)
    failed = in_closed_loop(blocks(False), feedback, LEVEL, False, 0.0)
    assert all("feedback, which may be the cause" in check.sentence for check in failed)
    assert in_closed_loop(blocks(False), feedback, LEVEL, True, 0.0) == blocks(False)


@pytest.mark.parametrize("ahead", [False, True])
def test_a_pass_is_open_where_nothing_but_y_moves_u(ahead):
    first, *_ = in_closed_loop(blocks(True), found(0.0, 0.5, 0.999), LEVEL, ahead, 0.0)
    assert first.outcome == "open" and "add a reference" in first.sentence


# -- errors one sample ahead -----------------------------------------------------------


def test_true_errors_one_sample_ahead_pass_in_closed_loop():
    tests = ("whiteness", "independence", "squares", "cubes")
    seeds, failed = 60, dict.fromkeys(tests, 0)
    for seed in range(seeds):
        u, y, _, eps = loop(400, seed)
        p = residual_tests([(u, y, y - eps)], ahead=True, first_lag=1).p_values
        for name in failed:
            failed[name] += p[name][0] < LEVEL
    assert max(failed.values()) <= binom.ppf(0.9999, seeds, LEVEL)
    u, y, _, eps = loop(2000, 0)  # u of the same sample is made of them
    assert residual_tests([(u, y, y - eps)], ahead=True).p_values["independence"] < 1e-9


@pytest.mark.parametrize(
    ("missing", "test"),
    [
        (lambda u, y: 0.3 * u, "independence"),
        (lambda u, y: 0.1 * y, "independence"),
        (lambda u, y: 0.05 * (y**2 - np.mean(y**2)), "squares"),
        (lambda u, y: 0.03 * y**3, "cubes"),
    ],
)
@pytest.mark.parametrize("first_lag", [0, 1])
def test_what_a_predictor_misses_of_the_past_is_found(missing, test, first_lag):
    u, y, _, eps = loop(2000, 0, gain=0.0 if first_lag == 0 else 0.4)
    before = np.vstack([[[0.0]], missing(u, y)[:-1]])
    experiments = [(u, y, y - eps - before)]
    tests = residual_tests(experiments, ahead=True, first_lag=first_lag)
    assert tests.p_values[test] < 1e-4
    assert tests.ahead and tests.first_lag == first_lag


def test_gaps_are_what_was_predicted():
    u, y, _, eps = loop(1500, 0)
    y_hat = y - eps
    y[np.random.default_rng(0).random(len(y)) < 0.3] = np.nan
    tests = residual_tests([(u, y, y_hat)], ahead=True, first_lag=1)
    assert tests.n_samples[0] == np.isfinite(y).sum()
    assert min(tests.p_values.values()) > 1e-3


def predicting(nx, *records, **options):
    return LinearStateSpace(nx=nx, noise="innovations", **options).fit(*records)


def of_the_plant(n, seed, **options):
    return benchmark.record(n, "closed", "process", False, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def in_loop():
    """Models of both kinds of a linear plant in closed loop, with process noise."""
    training = of_the_plant(1000, 0)
    return {
        "innovations": predicting(2, *training),
        "output": LinearStateSpace(nx=2).fit(*training),
    }


def test_the_verdict_of_a_simulation_error_in_closed_loop_is_no_pass(in_loop):
    fresh = of_the_plant(1000, 100)
    validation = in_loop["output"].validate(*fresh)
    assert not validation.passed
    check = validation["independence"]
    assert check.outcome == "open" and "noise='innovations'" in check.sentence
    assert "Compare with noise='innovations'" in validation["whiteness"].sentence
    assert validation.verdict == "is undecided: independence"
    assert validation.feedback.found(LEVEL).any()
    validation = in_loop["innovations"].validate(*fresh)
    assert validation.passed and validation.verdict == "passes"
    assert validation["whiteness"].decides and validation["whiteness"].passed
    assert validation["feedback"].outcome == "note"
    assert "one sample ahead the model misses" in validation["free run"].sentence
    assert validation["free run"].decides and validation.residuals.ahead


def test_a_predictor_that_is_too_small_fails():
    low = predicting(1, *of_the_plant(1000, 0))
    validation = low.validate(*of_the_plant(1000, 100))
    assert not validation["whiteness"].passed and "whiteness" in validation.verdict
    assert not validation["independence"].passed
    assert "of u and y predict" in validation["independence"].sentence


@pytest.mark.parametrize("gap", [0.0, 0.1])
def test_errors_one_sample_ahead_are_those_of_the_predictor(in_loop, gap):
    model, (u, y) = in_loop["innovations"], of_the_plant(300, 5)
    y[np.random.default_rng(0).random(len(y)) < gap] = np.nan
    ((u_i, y_i, y_hat),), options = judged_experiments(model, u, y)
    n, fit = len(y_hat), model.fitted_
    np.testing.assert_allclose(y_i[:, 0], y[-n:], rtol=1e-12)
    np.testing.assert_allclose(u_i, u[-n:], atol=1e-12)
    assert options["ahead"] and options["first_lag"] == 1
    # where the first states are forgotten, they are those of any start
    expected = model.predict_ahead(u, y, 1)[-100:]
    np.testing.assert_allclose(y_hat[-100:, 0], expected, atol=1e-6)
    # the derivatives are those of the predictor, told what it was told
    scaling, structure = fit.scaling, predictor(fit.structure)
    parts = list(options["sensitivities"][0]())
    J, J_x0 = (np.concatenate(z) for z in zip(*parts, strict=True))
    assert len(J) == n and J.shape[2] == fit.free.sum() and J_x0.shape[2] == 2
    skipped = len(y) - n
    told = np.where(np.isnan(y[skipped:, None]), y_hat, y[skipped:, None])
    z = np.hstack([scaling.scale_u(u, [0])[:][skipped:], (told - scaling.y_offset)])
    z[:, -1] /= scaling.y_scale

    def run(theta):
        lure = structure.observe("y").lure(theta)
        return outputs(lure, z, np.zeros(2))[-100:, 0]

    step, late = 1e-6, slice(-100, None)
    for column, i in enumerate(np.flatnonzero(fit.free)):
        shift = step * (np.arange(len(fit.theta)) == i)
        slope = (run(fit.theta + shift) - run(fit.theta - shift)) / (2 * step)
        np.testing.assert_allclose(J[late, 0, column], slope, atol=2e-5)
    assert np.abs(J[late, 0, structure.slices["K"]]).max() > 0.01


@pytest.mark.parametrize("kind", ["innovations", "output"])
def test_inputs_as_they_were_sent_are_those_of_the_judged_samples(in_loop, kind):
    model, (u, y) = in_loop[kind], of_the_plant(600, 5)
    y[:7] = y[100:130] = y[300:340] = y[-3:] = np.nan
    experiments, _ = judged_experiments(model, u, y)
    assert len(experiments) == (3 if kind == "innovations" else 1)
    sent = sent_experiments(model, u, y)
    for (u_sent, free_run), (u_i, *_) in zip(sent, experiments, strict=True):
        np.testing.assert_allclose(u_sent, u_i, atol=1e-12)
        assert free_run.shape == (len(u_i), 1)
    validation = model.validate(u, y)  # in which pieces meet the inputs again
    assert np.isfinite(validation["feedback"].value)


def test_late_inputs_are_asked_for_feedback_when_they_are_sent():
    u, y = of_the_plant(600, 5)
    model = predicting(2, u[:-2], y[2:], input_delay=2)
    y = y[2:].copy()
    y[100:130] = np.nan
    for (u_sent, _), (u_i, *_) in zip(
        sent_experiments(model, u[:-2], y),
        judged_experiments(model, u[:-2], y)[0],
        strict=True,
    ):
        np.testing.assert_allclose(u_sent[:-2], u_i[2:], atol=1e-12)


def test_a_model_of_the_simulation_error_is_tested_by_it(in_loop):
    model, data = in_loop["output"], of_the_plant(300, 5)
    ((*_, y_hat),), options = judged_experiments(model, *data, exact=True)
    simulated = model.simulate_test(*data)
    np.testing.assert_allclose(y_hat[:, 0], simulated[1], rtol=1e-9)
    assert options == {"sensitivities": None, "ahead": False, "first_lag": 0}


@pytest.mark.filterwarnings("ignore::UserWarning")  # the fit says that it is unstable
def test_a_free_run_of_an_unstable_plant_decides_nothing():
    def unstable(n, seed):
        rng = np.random.default_rng(seed)
        r = np.repeat(rng.standard_normal(n // 5), 5)
        x, u, y = 0.0, np.empty((n, 1)), np.empty(n)
        for k in range(n):
            y[k] = x + 0.05 * rng.standard_normal()
            u[k] = r[k] - 0.6 * y[k]
            x = 1.1 * x + u[k, 0] + 0.2 * rng.standard_normal()
        return u, y

    model = predicting(1, *unstable(1000, 0))
    assert model.A_[0, 0] > 1.05
    validation = model.validate(*unstable(1000, 1))
    free_run = validation["free run"]
    assert free_run.outcome == "note" and "reported only" in free_run.sentence
    linear = validation["linearizability"]
    assert linear.outcome == "note" and "designed_loop" in linear.sentence
    assert validation.passed
    assert validation["extrapolation"].passed  # by its states as they are predicted
    for name in ("independence", "squares", "cubes", "whiteness"):
        assert validation[name].passed
    u, y = unstable(1000, 1)
    assert not model.validate(3 * u, 3 * y)["extrapolation"].passed


def test_correlations_are_those_of_the_errors_one_sample_ahead(in_loop):
    data = of_the_plant(500, 5)
    display = ResidualDisplay.from_estimator(in_loop["innovations"], *data)
    titles = [ax.get_title(loc="left") for ax in display.axes_[:, 0]]
    assert titles[0].startswith("error one sample ahead: ")
    assert titles[1].startswith("u0, lags from 1 on: ")
    assert "of 25 outside" in titles[1]
    display = ResidualDisplay.from_estimator(in_loop["output"], *data)
    assert display.axes_[0, 0].get_title(loc="left").startswith("residual: ")


@pytest.mark.usefixtures("rough_certificates")
def test_a_report_says_what_was_tested(in_loop, tmp_path):
    path, data = tmp_path / "report.html", of_the_plant(500, 5)
    in_loop["innovations"].report(path, *data)
    text = path.read_text(encoding="utf-8")
    assert "Correlations of the errors one sample ahead" in text
    assert in_loop["innovations"].validate(*data)["feedback"].sentence in text

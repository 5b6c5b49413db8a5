"""Where verdicts turn: figures on both sides of every margin, each margin alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from alssnn.linearizability import judge, percent, worst_error
from alssnn.validation import Check, _validate, residual_tests
from alssnn.validation._residuals import whiten
from alssnn.validation._scored import is_rounding

# -- percentages in words --------------------------------------------------------------


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (np.nan, "an unbounded share"),
        (np.inf, "an unbounded share"),
        (0.0, "0 %"),
        (0.9e-11, "0 %"),  # of rounding
        (1.1e-11, "less than 0.001 %"),
        (0.99e-5, "less than 0.001 %"),
        (1.1e-5, "0.0011 %"),
        (0.0123, "1.2 %"),
        (0.9949, "99 %"),
        (0.9951, "100 %"),
        (1.5, "150 %"),
        (123.4, "12,340 %"),
    ],
)
def test_a_share_in_words(share, words):
    assert percent(share) == words


# -- linearizable ----------------------------------------------------------------------


def figures(**change):
    """Return figures of a model that is linearizable, but for what is changed."""
    return SimpleNamespace(
        **{
            "no_law": "",
            "spectral_radius": 0.9,
            "linearization_error": np.array([0.001, 0.002]),
            "closed_linearization_error": np.array([0.003, 0.001]),
            "closed_outside": 0.0,
            "large_law": None,
            **change,
        }
    )


@pytest.mark.parametrize(
    ("name", "good", "bad", "words"),
    [
        ("spectral_radius", 0.9999, 1.0001, "a controller that stabilizes it"),
        ("linearization_error", [0.05, 0.0], [0.0501, 0.0], "for a disturbance"),
        ("closed_linearization_error", [0, 0.05], [0, 0.0501], "for a disturbance"),
        ("closed_outside", 0.05, 0.0501, "extrapolated"),
        ("large_law", None, 3.5, "3.5 times the recorded input"),
    ],
)
def test_every_condition_of_a_linear_design_alone(name, good, bad, words):
    passed, sentence = judge(figures(**{name: good}), fit=50.0)
    assert passed and "are only" in sentence
    passed, sentence = judge(figures(**{name: bad}), fit=50.0)
    assert not passed and words in sentence


def integrates(**change):
    """Return figures of a model that drifts without a controller."""
    drift = {"closed_linearization_error": np.full(2, np.inf), "closed_outside": 0.9}
    held = {"carried_model": np.array([0.01, 0.02]), "carried_outside": 0.0}
    return figures(spectral_radius=1.0, **{**drift, **held, **change})


def test_what_integrates_is_judged_behind_a_controller():
    passed, sentence = judge(integrates())
    assert passed and "2 % in the loop of a first controller, which" in sentence
    assert worst_error(integrates()) == 0.02
    rounded = integrates()
    for rounded.spectral_radius in (1 - 1e-8, 1 + 1e-8):  # two integrators in a row
        assert judge(rounded)[0] and worst_error(rounded) == 0.02


def test_what_integrates_may_fail_behind_a_controller():
    far = integrates(carried_model=np.array([0.01, 0.06]))
    assert not judge(far)[0] and worst_error(far) == 0.06
    for outside in (0.06, None):
        passed, sentence = judge(integrates(carried_outside=outside))
        assert not passed and "extrapolated" in sentence
    passed, sentence = judge(integrates(linearization_error=np.array([0.06, 0.0])))
    assert not passed and "6 % of the output along the record" in sentence
    problem = "No controller could be tried. B is zero."
    passed, sentence = judge(integrates(carried_model=None, carried_problem=problem))
    assert not passed and sentence.endswith(problem)
    untried = integrates(carried_model=None)
    passed, sentence = judge(untried)
    assert not passed and sentence.endswith("None was tried.")
    untried.closed_linearization_error = np.array([0.3, 0.1])  # of the ladder, of rates
    assert worst_error(untried) == 0.3


def test_a_model_without_networks_extrapolates_none():
    none = {
        "linearization_error": np.zeros(2),
        "closed_linearization_error": np.zeros(2),
    }
    passed, sentence = judge(figures(**none, closed_outside=0.25, law_size=0.0))
    assert passed and "networks" not in sentence and "gamma_h" not in sentence
    # an exact law is a network, too
    passed, sentence = judge(figures(**none, closed_outside=0.25, law_size=0.5))
    assert not passed and "networks are extrapolated" in sentence


def test_a_linear_design_needs_a_model_that_follows():
    assert judge(figures(), fit=0.1)[0] and judge(figures(), fit=None)[0]
    for fit in (0.0, -3.0, np.nan):
        passed, sentence = judge(figures(), fit=fit)
        assert not passed and "does not follow the plant" in sentence


def test_the_share_that_may_be_left_is_that_of_the_call():
    assert judge(figures(), within=0.003)[0]
    assert not judge(figures(), within=0.0029)[0]


def test_the_worst_error_is_that_of_any_output_and_loop():
    assert worst_error(figures()) == 0.003
    assert worst_error(figures(linearization_error=np.array([0.1, 0.7]))) == 0.7
    no_loop = figures(closed_linearization_error=np.full(2, np.nan))
    assert worst_error(no_loop) == 0.002


@pytest.mark.parametrize(
    ("radius", "drifts", "words"),
    [
        (0.9, True, "No free run knows what drifts"),
        (1.0, False, "A integrates, spectral radius 1: noise"),
        (1.2, False, "A is unstable, spectral radius 1.2: noise"),
    ],
)
def test_a_free_run_that_noise_leads_away_is_reported_only(radius, drifts, words):
    failed = Check("free run", False, -3.0, "fit", True, "It is far off.")
    one = SimpleNamespace(spectral_radius=radius)
    check = _validate._noisy_run(one, failed, np.array([0.1]), drifts)
    assert not check.decides and check.sentence.startswith(words)
    assert "10 %" in check.sentence
    # one that passes, and one that nothing leads away, decide as any other
    for kept in (
        _validate._noisy_run(one, replace(failed, passed=True), np.zeros(1), drifts),
        _validate._noisy_run(figures(), failed, np.zeros(1), False),
    ):
        assert kept.decides and kept.sentence.startswith(failed.sentence)


# -- residuals -------------------------------------------------------------------------


def residuals(explained, p=(1.0, 1.0), block="independence", **change):
    """Return tests of two outputs, whose blocks explain what is given."""
    blocks = _validate.BLOCKS
    values = {name: np.zeros(2) for name in blocks}
    values |= {name: np.array(value) for name, value in explained.items()}
    return SimpleNamespace(
        **{
            "p_values": {name: np.ones(2) for name in blocks} | {block: np.array(p)},
            "shares": dict.fromkeys([*blocks, block], np.array([0.25, 0.31])),
            "explained": values,
            "n_parameters": 3,
            "ahead": False,
            "output_names": ["flow", "level"],
            "level": 0.01,
            **change,
        }
    )


@pytest.mark.parametrize(
    ("share", "missed", "passes"),
    [
        (0.49, 0.35, True),  # half of the residual may be errors of parameters,
        (0.51, 0.35, False),
        (0.64, 0.0624, True),  # or more, if it is less than 5 % of the output
        (0.64, 0.0626, False),
        (0.16, 0.624, True),  # but no more than a quarter of the output
        (0.16, 0.626, False),
    ],
)
def test_a_dependence_too_large_for_errors_of_parameters(share, missed, passes):
    found = residuals({"independence": [0.05, share]})
    missed = np.array([0.95, missed])  # of the first output little is explained
    check = _validate._block(found, "independence", missed)
    assert check.passed == passes and check.decides and check.value == 1.0
    if not passes:
        assert "of the residual of level on samples left out" in check.sentence
        part = percent(np.sqrt(share) * missed[1])
        assert f"Lags of u predict {percent(share)}" in check.sentence
        assert f"{part} of the output: too much" in check.sentence


@pytest.mark.parametrize(("own", "passes"), [(0.099, True), (0.101, False)])
def test_a_block_answers_for_what_it_adds(own, passes):
    found = residuals({"independence": [0.6, 0.0], "squares": [own, 0.0]})
    check = _validate._block(found, "squares", np.array([0.5, 0.5]))
    assert check.passed == passes
    whole = f"predict {percent(0.6 + own)} of the residual"
    assert whole in check.sentence
    if passes:
        assert f"they and lags of u {whole}" in check.sentence
    else:
        assert "an even nonlinearity is missing" in check.sentence


def test_of_two_large_dependences_the_larger_part_of_the_output_is_named():
    found = residuals({"independence": [0.9, 0.6]})
    check = _validate._block(found, "independence", np.array([0.1, 0.5]))
    assert "of the residual of level on" in check.sentence


@pytest.mark.parametrize(("p", "passes"), [(0.0017, True), (0.0016, False)])
def test_the_smallest_p_value_counts_for_two_outputs_and_three_tests(p, passes):
    check = _validate._block(residuals({}, [0.9, p]), "independence", np.zeros(2))
    assert check.passed == passes
    assert check.value == pytest.approx(6 * p)
    if passes:
        assert "beyond errors of the parameters" in check.sentence
    else:
        assert "The residual of level depends on lags of u" in check.sentence
        assert "explain 31 % of it (whitened); dynamics" in check.sentence
    exact = residuals({}, [0.9, p], n_parameters=0)
    sentence = _validate._block(exact, "independence", np.zeros(2)).sentence
    assert "beyond errors" not in sentence


def test_a_p_value_at_the_level_passes_and_none_exceeds_one():
    at_level = residuals({}, [2**-10, 0.9], level=6 * 2**-10)
    assert _validate._block(at_level, "independence", np.zeros(2)).passed
    assert _validate._block(residuals({}), "independence", np.zeros(2)).value == 1.0


@pytest.mark.parametrize(("p", "passes"), [(0.005, True), (0.0049, False)])
def test_color_is_said_and_decides_nothing(p, passes):
    found = residuals({}, [0.9, p], block="whiteness")
    check = _validate._whiteness(found, np.zeros(2))
    assert check.passed == passes and not check.decides
    if not passes:
        assert "of level is colored: its past explains 31 % of it" in check.sentence
        assert "innovations" not in check.sentence


@pytest.mark.parametrize(
    ("share", "missed", "advised"),
    [
        (0.64, 0.0626, True),
        (0.64, 0.0624, False),  # 5 % of the output
        (0.49, 0.5, False),  # half of the residual
    ],
)
def test_a_large_colored_residual_calls_for_innovations(share, missed, advised):
    found = residuals({}, [0.9, 0.0], block="whiteness")
    found.shares["whiteness"] = np.array([0.0, share])
    check = _validate._whiteness(found, np.array([0.9, missed]))
    assert ("Compare with noise='innovations'" in check.sentence) == advised
    part = percent(np.sqrt(share) * missed)
    assert (f"But this is {part} of the output" in check.sentence) == advised


@pytest.mark.parametrize("doubt", ["", "The record is short"])
@pytest.mark.parametrize(("p", "passes"), [(0.005, True), (0.0049, False)])
def test_errors_one_sample_ahead_have_to_be_white(p, passes, doubt):
    found = residuals({}, [0.9, p], block="whiteness", ahead=True)
    check = _validate._whiteness(found, np.ones(2), doubt)
    assert check.passed == passes and check.decides
    if not passes:
        assert check.undecided == bool(doubt)
        assert "The error one sample ahead of level is colored" in (
            check.sentence if not doubt else check.sentence.replace("the", "The")
        )
        assert ("raise `nx`" in check.sentence) != bool(doubt)


def test_errors_one_sample_ahead_are_called_so():
    found = residuals({}, [0.9, 0.0], ahead=True)
    for name in ("independence", "squares"):
        sentence = _validate._block(found, name, np.zeros(2)).sentence
        assert "error one sample ahead" in sentence and "lags of u and y" in sentence
        assert "residual" not in sentence and "whitened" not in sentence


# -- the free run ----------------------------------------------------------------------


def free_run(missed, trained=np.nan, linear=None):
    """Return the check of a model that misses given shares of its outputs."""
    y = np.random.default_rng(0).standard_normal((50, len(missed)))
    mean = y.mean(axis=0)

    def run(share):
        return [(None, y, y + np.array(share) * (mean - y))]

    model = SimpleNamespace(train_score_=1 - trained**2)
    baseline = None if linear is None else run(linear)
    names = ["flow", "level"][: len(missed)]
    return _validate._free_run(model, run(missed), names, baseline)


@pytest.mark.parametrize(
    ("missed", "trained", "passes"),
    [
        (0.149, 0.05, True),
        (0.151, 0.05, False),  # three times as much as in training
        (0.099, 0.001, True),  # but for fits above 90 %
        (0.101, 0.001, False),
        (0.5, np.nan, True),
        (0.999, np.nan, True),
        (1.001, np.nan, False),
    ],
)
def test_how_much_worse_than_in_training_a_free_run_may_be(missed, trained, passes):
    check = free_run([missed], trained)
    assert check.passed == passes and check.decides
    assert check.value == pytest.approx(100 * (1 - missed))
    if np.isfinite(trained):
        assert percent(trained) in check.sentence
    else:
        assert "training" not in check.sentence


@pytest.mark.parametrize(("missed", "passes"), [(0.219, True), (0.221, False)])
def test_how_much_worse_than_a_linear_model_a_free_run_may_be(missed, passes):
    """A tenth of what the linear model misses."""
    check = free_run([0.1, missed], linear=[0.1, 0.2])
    assert check.passed == passes
    assert f"misses {percent(missed)} of level" in check.sentence
    assert f"linear model misses {percent(0.2)}" in check.sentence or not passes


def test_the_output_on_which_the_linear_model_is_better_is_named():
    check = free_run([0.05, 0.5], linear=[0.01, 0.5])
    assert not check.passed and check.value == pytest.approx(50)
    expected = f"misses {percent(0.05)} of flow, the linear model {percent(0.01)}. Use"
    assert expected in check.sentence


def test_predictions_are_judged_at_the_last_horizon():
    def ahead(*fits):
        fit = np.column_stack([[99.0] * 3, fits])
        last = np.full((3, 2), 50.0)
        return SimpleNamespace(fit=fit, last_value=last, horizons=np.array([1, 5, 9]))

    check = _validate._ahead(ahead(90.0, 40.0, 60.0), "", ["flow", "level"])
    assert check.passed and check.value == 60.0 and not check.decides
    assert "Fit of level in % by samples ahead, 1: 90, 5: 40, 9: 60" in check.sentence
    assert "as good a guess 5 ahead" in check.sentence
    check = _validate._ahead(ahead(90.0, 70.0, 50.0), "", ["flow", "level"])
    assert not check.passed and "as good a guess 9 ahead" in check.sentence
    check = _validate._ahead(ahead(90.0, 70.0, 60.0), "", ["flow", "level"])
    assert check.passed and "worse guess at all of them" in check.sentence
    check = _validate._ahead(None, "It is late.", ["flow", "level"])
    assert not check.passed and check.sentence == "It is late."


@pytest.mark.parametrize(
    ("outside", "passes"), [(0.0, True), (0.02, True), (0.0201, False), (None, False)]
)
def test_two_samples_in_a_hundred_may_be_outside(outside, passes):
    check = _validate._extrapolation(outside, lambda: 0.021)
    assert check.passed == passes and check.decides and not check.undecided
    assert ("train on such data" in check.sentence) != passes


def test_what_only_a_longer_record_can_tell_is_open():
    check = _validate._extrapolation(0.5, lambda: 0.02)
    assert not check.passed and check.outcome == "open"
    assert "train on a longer record" in check.sentence


# -- what a residual is compared with --------------------------------------------------


@pytest.mark.parametrize(("size", "is_rounding"), [(0.99e-10, True), (1.01e-10, False)])
def test_what_counts_as_rounding(size, is_rounding):
    rng = np.random.default_rng(0)
    u, r = rng.standard_normal((2, 300))
    r -= r.mean()
    y = u / np.abs(u).max()
    tests = residual_tests([(u, y, y - size * r / np.abs(r).max())])
    assert (tests.p_values["whiteness"][0] == 1.0) == is_rounding
    assert (tests.ar_order[0], tests.autocorrelation[1, 0]) == (0, 0) or not is_rounding


@pytest.mark.parametrize(("extra", "enough"), [(0, True), (-1, False)])
def test_two_samples_for_every_column_are_enough(extra, enough):
    # 1 + (4 + 1) lags of u, as many of u^2 and y^2 and of u^3 and y^3
    n = 4 + 2 * (1 + 5 + 10 + 10) + extra
    u, r = np.random.default_rng(0).standard_normal((2, n))
    experiments = [(u, u + r, u)]
    if enough:
        assert residual_tests(experiments, n_lags=4).n_samples[0] == n
    else:
        with pytest.raises(ValueError, match=r"at least 52 .* first 4 .* got 51"):
            residual_tests(experiments, n_lags=4)


@pytest.mark.parametrize(
    ("lengths", "highest"),
    [
        ([1200], 30),  # 10 log10(N)
        ([150], 15),  # N / 10
        ([40] * 30, 10),  # a quarter of the shortest
    ],
)
def test_how_far_back_whitening_looks(lengths, highest):
    """r_k = 0.97 r_{k-p} + noise is white to all filters that are shorter than p."""
    rng = np.random.default_rng(0)
    for p, seen in ((highest, True), (highest + 1, False)):
        parts = []
        for n in lengths:
            r = rng.standard_normal(n + 40 * p)
            for k in range(p, len(r)):
                r[k] += 0.97 * r[k - p]
            parts.append(r[-n:])
        mean = np.mean(np.concatenate(parts))
        white, a, share = whiten([part - mean for part in parts])
        assert (len(a) == p) == seen and len(a) <= highest
        assert (share > 0.8) == seen
        assert all(np.isnan(part[: len(a)]).all() for part in white)


@pytest.mark.parametrize("order", [1, -1])
def test_rounding_is_told_where_an_experiment_was_never_measured(order):
    never, y = np.full(5, np.nan), np.array([1.0, -3.0, np.nan])
    for size, known in ((2e-10, True), (4e-10, False)):
        residuals = [never, size * np.array([0.5, -1.0, np.nan])][::order]
        assert is_rounding(residuals, [never, y][::order]) == known
    assert is_rounding([never], [never])

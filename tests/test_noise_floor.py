"""The error that no model goes below, where models are judged."""

from functools import partial

import numpy as np
import pytest

import alssnn
from alssnn.checks import noise_levels
from alssnn.excitation import multisine
from alssnn.nonparametric import best_linear_approximation, local_polynomial

NOISE = 0.03
look = partial(alssnn.look, recommends=False)


@pytest.fixture(scope="module")
def record():
    """Return an excitation and two outputs of a linear plant, the second one late."""
    excitation = multisine(256, n_periods=3, n_realizations=2, random_state=0)
    y = []
    for u in excitation.experiments:
        x, rows = 0.0, []
        for one in u[:, 0]:
            rows.append([x, 2 * x])
            x = 0.8 * x + 0.5 * one
        y.append(rows)
    noise = np.random.default_rng(0).standard_normal((len(excitation), 2))
    return excitation, np.concatenate(y) + NOISE * noise


@pytest.fixture(scope="module")
def model(record):
    excitation, y = record
    return alssnn.LinearStateSpace(nx=1).fit(excitation.u, y, excitation.experiment)


def test_a_look_and_a_response_know_it(record):
    page = look(*record)
    response = best_linear_approximation(*record)
    np.testing.assert_allclose(page.noise_rms, NOISE, rtol=0.1)
    for known in (page, response):
        np.testing.assert_array_equal(noise_levels(known, 2), response.noise_rms)
    assert look(record[0].u, record[1]).noise_rms is None  # nobody said: periods
    assert noise_levels(None, 2) is None


@pytest.mark.usefixtures("rough_certificates")
@pytest.mark.parametrize("make", [look, local_polynomial])
def test_what_does_not_tell_its_noise_is_named(record, model, make, tmp_path):
    excitation, y = record
    data = excitation.u, y, excitation.experiment
    silent = make(*data)
    words = f"got a {type(silent).__name__} of a record without periods"
    with pytest.raises(ValueError, match=words):
        model.validate(*data, noise_floor=silent)
    with pytest.raises(ValueError, match=words):
        model.report(tmp_path / "page.html", *data, noise_floor=silent)
    with pytest.raises(ValueError, match=words):
        alssnn.model_ladder(*data[:2], nx=1, models=["lti"], noise_floor=silent)


@pytest.mark.parametrize("wrong", [0.0, [1.0, -1.0], [1.0, 2.0, 3.0], np.nan, "0.1"])
def test_what_is_no_floor_is_refused(wrong):
    with pytest.raises(ValueError, match=r"`noise_floor` must be positive"):
        noise_levels(wrong, 2)


def test_the_check_says_what_is_left_and_does_not_decide(record, model):
    excitation, y = record
    data = excitation.u, y, excitation.experiment
    check = model.validate(*data, noise_floor=NOISE)["noise floor"]
    assert check.passed and 0.95 < check.value < 1.05 and not check.decides
    low = model.validate(*data, noise_floor=[NOISE, NOISE / 2])
    check = low["noise floor"]
    assert 1.9 < check.value < 2.1 and check.outcome == "note"
    assert "times the noise of y1: 75 % of its square" in check.sentence
    assert low.passed == model.validate(*data).passed
    check = model.validate(*data, noise_floor=2 * NOISE)["noise floor"]
    assert "this record has less noise" in check.sentence


def test_the_table_has_test_errors_over_it(record):
    excitation, y = record
    options = {"experiment": excitation.experiment, "nx": 1, "models": ["lti"]}
    plain = alssnn.model_ladder(excitation.u, y, **options)
    ladder = alssnn.model_ladder(excitation.u, y, noise_floor=[0.03, 0.06], **options)
    ratio = ladder["LTI"].rmse_test / [0.03, 0.06]
    np.testing.assert_allclose(ladder.over_floor(ladder["LTI"]), ratio)
    assert f"{ratio.max():.3g}" in str(ladder).splitlines()[3]
    assert "floor" in str(ladder) and "floor" not in str(plain)
    assert np.isnan(plain.over_floor(plain["LTI"])).all()
    frame = ladder.to_frame()
    np.testing.assert_allclose(frame["rmse_over_floor[y1]"], ratio[1])


def test_a_ladder_ends_at_the_floor(record):
    excitation, y = record
    data = {"experiment": excitation.experiment, "nx": 1, "n_init": 1, "max_iter": 5}
    data |= {"models": ["lti", "fl", "gr"], "alpha": 0.0}
    whole = alssnn.model_ladder(excitation.u, y, noise_floor=NOISE / 2, **data)
    assert len(whole) == 3 and whole.not_fitted == ()
    assert all(row.model.noise_floor[0] == NOISE / 2 for row in whole)
    ladder = alssnn.model_ladder(excitation.u, y, noise_floor=NOISE, **data)
    assert [row.name for row in ladder] == ["LTI"]
    assert ladder.not_fitted == ("FL-SSNN", "GR-SSNN")
    words = " ".join(str(ladder).split())
    assert "Not fitted: FL-SSNN, GR-SSNN. The error of LTI is nearly that" in words
    # one output above it is enough to go on
    ladder = alssnn.model_ladder(
        excitation.u, y, noise_floor=[2 * NOISE, NOISE / 2], **data
    )
    assert len(ladder) == 3
    data |= {"noise": "innovations", "models": ["lti"]}  # has no floor in its training
    ladder = alssnn.model_ladder(excitation.u, y, noise_floor=NOISE, **data)
    assert ladder["LTI"].model.noise_floor is None


@pytest.mark.usefixtures("rough_certificates")
def test_a_report_has_a_column_of_it(record, model, tmp_path):
    excitation, y = record
    data = excitation.u, y, excitation.experiment
    model.report(tmp_path / "page.html", *data, noise_floor=NOISE)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "RMSE / noise floor" in text and "times the noise of" in text
    assert "On a fresh record the best that a model can do is about the noise" in text
    assert "No model goes below" not in text  # a training does, with its own noise

"""The error that no model goes below, where models are judged."""

import numpy as np
import pytest

import alssnn
from alssnn.checks import noise_levels
from alssnn.excitation import multisine
from alssnn.nonparametric import best_linear_approximation

NOISE = 0.03


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
    page = alssnn.look(*record)
    response = best_linear_approximation(*record)
    np.testing.assert_allclose(page.noise_rms, NOISE, rtol=0.1)
    for known in (page, response):
        np.testing.assert_array_equal(noise_levels(known, 2), response.noise_rms)
    assert alssnn.look(record[0].u, record[1]).noise_rms is None  # nobody said: periods
    assert noise_levels(None, 2) is None


@pytest.mark.parametrize("wrong", [0.0, [1.0, -1.0], [1.0, 2.0, 3.0], np.nan, "much"])
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


def test_a_report_has_a_column_of_it(record, model, tmp_path):
    excitation, y = record
    data = excitation.u, y, excitation.experiment
    model.report(tmp_path / "page.html", *data, noise_floor=NOISE)
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "RMSE / noise floor" in text and "times the noise of" in text

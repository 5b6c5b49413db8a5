"""The benchmarks of innovations measure what they say, and keep what was missed."""

import sys
from functools import partial
from types import ModuleType

import numpy as np
import pytest

from alssnn import LinearStateSpace
from benchmarks import (
    closed_loop_linear,
    drift,
    horizon,
    noisy_plants,
    one_step,
    predictor_step,
    process_noise,
    unstable,
)
from benchmarks.field.case import Case, Data


def test_the_deviation_is_none_if_nothing_is_left_to_cancel(monkeypatch):
    monkeypatch.setitem(process_noise.NOISES, "process", (0.0, 0.0))
    model = LinearStateSpace(nx=2, operating_point="zero")
    u, y = process_noise.make_record("process", "closed", 400, 0)
    assert process_noise.deviation(model.fit(u, y).plant_) > 0.1
    monkeypatch.setattr(process_noise, "h", np.zeros_like)
    u, y = process_noise.make_record("process", "closed", 400, 0)
    assert process_noise.deviation(model.fit(u, y).plant_) < 1e-4


def test_a_deviation_beyond_its_limit_is_missed():
    def rows(noise, output, innovations):
        head = noise, "open", 3000, 0
        return [
            (*head, "output", "predicted", output, 1.0),
            (*head, "innovations", "measured", innovations, 1.0),
        ]

    assert not process_noise.missed(rows("process", 0.3, 0.05))
    assert len(process_noise.missed(rows("process", 0.3, 0.07))) == 1
    assert not process_noise.missed(rows("measurement", 0.01, 0.0125))
    assert len(process_noise.missed(rows("measurement", 0.01, 0.0135))) == 1


@pytest.mark.parametrize("predicts", [True, False])
def test_the_starts_know_a_plant_without_noise(predicts, monkeypatch):
    monkeypatch.setitem(
        closed_loop_linear.make_record.__globals__["CASES"],
        closed_loop_linear.CASE,
        (0.0, 0.0, 0.01 * predicts, 0.4),
    )
    u, y = closed_loop_linear.make_record(closed_loop_linear.CASE, 600, 0)
    found = closed_loop_linear.figures(*closed_loop_linear.start(predicts, u, y))
    np.testing.assert_allclose(found, [0.8, 0.4, 1.25], rtol=0.01)


def test_rows_that_are_omitted_are_said(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "sippy_unipi", None)
    assert not any("SIPPY" in name for name in closed_loop_linear.methods())
    said = capsys.readouterr().out
    assert said.startswith("Rows of SIPPY are omitted") and "sippy_unipi" in said
    monkeypatch.setitem(sys.modules, "sippy_unipi", ModuleType("sippy_unipi"))
    assert "SIPPY PARSIM-K" in closed_loop_linear.methods()
    assert not capsys.readouterr().out


def test_the_bias_is_a_mean_with_its_standard_error():
    errors = np.array([[1.0, 0.0], [3.0, 0.0]])
    mean, se = closed_loop_linear.bias(errors)
    np.testing.assert_allclose(mean, [2.0, 0.0])
    np.testing.assert_allclose(se, [1.0, 0.0])


def arx_record(n_samples, direct):
    rng = np.random.default_rng(0)
    u, y = rng.standard_normal((n_samples, 1)), np.zeros((n_samples, 1))
    for k in range(2, n_samples):
        y[k] = 0.5 + 1.2 * y[k - 1] - 0.5 * y[k - 2] + u[k - 2] + direct * u[k]
        y[k] += 0.01 * rng.standard_normal()
    return u, y


@pytest.mark.parametrize("direct", [False, True])
def test_arx_is_chosen_by_validation_and_finds_its_coefficients(direct):
    u, y = arx_record(400, direct)
    y[100:103] = np.nan
    n, has_direct, theta = one_step.choose_arx([(u, y)])
    assert n >= 2 and (has_direct or not direct)
    np.testing.assert_allclose(theta[:3, 0], [0.5, 1.2, -0.5], atol=0.15)
    whole = arx_record(400, direct)
    error, _ = one_step.of_arx(Data([(u, y)], {}, 1.0), [whole], (False, True), 10)
    assert error * np.nanstd(y) == pytest.approx(0.01, rel=0.15)


def test_errors_leave_out_what_is_missing_and_diverging_models_are_infinite():
    y = np.array([[9.0], [1.0], [np.nan], [2.0]])
    y_hat = np.array([[0.0], [2.0], [5.0], [3.0]])
    assert one_step.scaled_rms([(y, y_hat)], 2.0, 1) == pytest.approx(0.5)
    assert one_step.scaled_rms([(y, np.full_like(y, np.inf))], 2.0, 1) == np.inf


def test_a_fit_that_fails_is_a_row_and_the_newest_row_stays(tmp_path):
    def load():
        u, y = arx_record(80, False)
        return Data([(u, y)], {"fresh": [(u[:, 0], y[:, 0])]}, -1.0)

    case = Case("tiny", "ARX", load, "seen", n_init=10)
    (row,) = [one_step.text_of(row) for row in one_step.compare(case, "lti")]
    assert row[:3] == ["tiny", "lti", "fresh"] and "dt" in row[-1]
    assert one_step.failures([row]) == [row]
    better = [*row[:3], "0.9", *row[4:]]
    one_step.write(one_step.replaced([row], [better]), tmp_path)
    assert one_step.read(tmp_path / "one_step.csv") == [better]
    assert "0 of 1 tests missed" in (tmp_path / "one_step.md").read_text()


@pytest.mark.parametrize("sees", predictor_step.SEES)
def test_passes_of_predictor_and_free_run_have_the_same_unknowns(sees):
    predictor, free, output = predictor_step.criteria("SISO", "AL", sees, 50)
    assert predictor[0].n == free[0].n > output[0].n
    for criterion, vector in (predictor, free, output):
        assert np.isfinite(criterion.normal_equations(vector)[0]).all()
    # K has no effect in free run
    assert free[0].norm(free[1]) == pytest.approx(output[0].norm(output[1]))


def test_the_pendulum_is_unstable_and_kept_by_its_regulator():
    record = unstable.make_pendulum(300, random_state=1)
    assert np.abs(record.y).max() < 0.35
    A = np.column_stack([unstable.swing(1e-6 * e, 0.0) / 1e-6 for e in np.eye(2)])
    assert np.abs(np.linalg.eigvals(A)).max() == pytest.approx(1.091, abs=1e-3)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_linear_model_of_innovations_holds_the_pendulum():
    setting = unstable.PLANTS["pendulum"]
    record = unstable.make_pendulum(600, random_state=0)
    model = LinearStateSpace(nx=2, dt=record.dt, noise="innovations")
    model.fit(record.u, record.y)
    assert unstable.held(setting, record, model, 0.1)
    assert not unstable.held(setting, record, model, 3.0)  # it hangs already


@pytest.mark.parametrize("kind", ["output", "input"])
def test_no_predictor_is_better_than_that_of_the_walk(kind):
    u, y = drift.make_record(0.02, kind, 0.0, 4000, 0)
    model = LinearStateSpace(nx=3, noise="innovations", drift=kind).fit(u, y)
    error = np.trace(model.noise_covariance_) / 2
    assert error == pytest.approx(drift.least_error(0.02, kind), rel=0.05)
    assert drift.least_error(0.003, kind) < drift.least_error(0.02, kind)


def test_a_drift_beyond_its_limits_is_missed():
    head = 0.02, "output", "open"
    assert not drift.missed([(*head, "none", 0.5, 2.0, 1.0)])
    assert not drift.missed([(*head, "output", 0.02, 1.01, 0.0)])
    assert len(drift.missed([(*head, "output", 0.02, 1.10, 0.0)])) == 1
    assert len(drift.missed([(*head, "output", 0.02, 1.01, np.nan)])) == 1


@pytest.mark.parametrize("plant", noisy_plants.PLANTS)
def test_noisy_plants_are_bounded_and_noisy(plant):
    make = noisy_plants.PLANTS[plant]
    records = [make(np.random.default_rng(seed), 800) for seed in (0, 0, 1)]
    (u, y), again, other = records
    np.testing.assert_array_equal(u, again[0])
    np.testing.assert_array_equal(y, again[1])
    assert len(u) == len(y) == 800 and not np.array_equal(u, other[0])
    assert np.nanmax(np.abs(y)) < 3
    assert np.isnan(y).mean() == pytest.approx(0.1 * (plant == "cells"), abs=0.02)


def test_rows_of_noisy_plants_are_relative_to_the_linear_model(monkeypatch):
    class Constant(LinearStateSpace):
        alpha_ = np.inf

        def predict_ahead(self, u, y):
            return np.zeros_like(y)

    models = {"lti": partial(LinearStateSpace, nx=1), "none": partial(Constant, nx=1)}
    monkeypatch.setattr(noisy_plants, "MODELS", models)
    row, worse = noisy_plants.row_of("tank", 300, 0)
    assert row[:3] == ("tank", "300", "0") and 0.05 < float(row[3]) < 0.2
    assert float(row[4].removesuffix("=")) > 5  # a level of one, in units of 0.2
    assert row[4].endswith("=") and worse == 1
    assert "- 300 samples: 1 of 1 fits are worse" in noisy_plants.table([(row, worse)])
    for ratio, worse in ((1.02, 0), (1.03, 1), (np.nan, 1)):
        errors = {"lti": 0.1, "none": 0.1 * ratio}
        monkeypatch.setattr(
            noisy_plants, "compare", lambda *_, e=errors: (e, set(), "")
        )
        assert noisy_plants.row_of("tank", 300, 0)[1] == worse


def test_a_horizon_that_does_not_help_every_time_is_missed():
    head = "linear", "open"
    errors = (0.1,) * 5
    assert not horizon.missed([(*head, 1, *errors, 0, 1.0, 4)])
    assert not horizon.missed([(*head, 5, *errors, 4, 1.0, 4)])
    (text,) = horizon.missed([(*head, 5, *errors, 3, 1.0, 4)])
    assert "3 of 4" in text


def test_the_record_of_a_horizon_is_linear_without_h():
    u, y = horizon.make_record(True, 0.0, 400, 0)
    v, z = horizon.make_record(False, 0.0, 400, 0)
    np.testing.assert_array_equal(u, v)
    found = [
        LinearStateSpace(nx=4, operating_point="zero").fit(u, one).score(u, one)
        for one in (y, z)
    ]
    assert found[0] > found[1] + 0.005

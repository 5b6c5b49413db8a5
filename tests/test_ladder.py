import builtins
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from alssnn import AlSsnn, LinearStateSpace
from alssnn.datasets import make_wiener_hammerstein
from alssnn.ladder import PRESETS, Ladder, Rung, model_ladder
from alssnn.ladder._explain import _about_feedback
from alssnn.ladder._fit import _estimators
from alssnn.metrics import fit_percent, rmse
from alssnn.watch import Step

SMALL = {"nx": 6, "n_h": 2, "n_g": 3, "n_f": 4, "max_iter": 10}
SMALL |= {"alpha": 0.0, "n_init": 1}  # a search would need more steps


@pytest.fixture(scope="module")
def record():
    return make_wiener_hammerstein(1200, noise=0.002, random_state=0)


@pytest.fixture(scope="module")
def ladder(record):
    return model_ladder(*record, dt=record.dt, **SMALL)


def make_row(name="AL-SSNN", *, missed=1.0, rest=1.0, rho=0.9, converged=True, ny=1):
    """Return a row with given figures: `missed` and `rest` in percent."""
    return Rung(
        name=name,
        model=SimpleNamespace(converged_=converged),
        n_params=7,
        rmse_train=np.full(ny, missed / 100),
        rmse_test=np.full(ny, missed / 100),
        fit_percent=np.full(ny, 100.0 - missed),
        linearization_error=np.full(ny, rest / 100),
        spectral_radius=rho,
        seconds=1.0,
        y_hat=np.zeros((5, ny)),
        e=np.zeros((5, ny)),
    )


def make_ladder(*rows, ny=1, names=None):
    return Ladder(rows, np.zeros((5, ny)), (slice(0, 5),), 0.1, names)


def explain(*rows):
    return " ".join(make_ladder(*rows).explain().split())


# Rows


def test_rows_are_the_models_in_order(ladder):
    names = ["LTI", "FL-SSNN", "AL-SSNN", "GR-SSNN"]
    assert [row.name for row in ladder] == names
    assert len(ladder) == 4
    assert ladder["AL-SSNN"].model.n_g == 3
    with pytest.raises(KeyError, match="one of LTI, FL-SSNN, AL-SSNN, GR-SSNN, got"):
        ladder["ARX"]


def test_rows_count_free_parameters(ladder):
    # with nx = 6 and nu = ny = 1: A, B and, for LTI alone, C
    # and h of six states
    linear, h, g, f = 36 + 6, 2 * 9 - 1, 3 * (6 + 6 + 1 + 1), 4 * 14 + 6
    assert [row.n_params for row in ladder] == [
        linear + 6,
        linear + h,
        linear + h + g,
        linear + f,
    ]


def test_a_model_without_neurons_counts_as_linear(record):
    ladder = model_ladder(*record, nx=2, n_h=0, stability=None, models="fl")
    assert ladder["FL-SSNN"].n_params == 4 + 2 + 2


def test_figures_are_those_of_the_models(record, ladder):
    train, test = record.split(0.5)
    for row in ladder:
        y_true, y_pred = row.model.simulate_test(*test)
        np.testing.assert_array_equal(ladder.y_test, y_true)
        np.testing.assert_array_equal(row.y_hat, y_pred)
        np.testing.assert_allclose(row.rmse_test, rmse(y_true, y_pred))
        np.testing.assert_allclose(row.fit_percent, fit_percent(y_true, y_pred))
        np.testing.assert_allclose(
            row.rmse_train, rmse(*row.model.simulate_test(*train))
        )
        measure = row.model.linearizability(*test)
        assert row.linearization_error == measure.linearization_error
        assert row.spectral_radius == measure.spectral_radius
    assert ladder["AL-SSNN"].rmse_test < 0.7 * ladder["LTI"].rmse_test


def test_residual_is_what_g_adds_to_the_output(record, ladder):
    model = ladder["AL-SSNN"].model
    u, y = record.split(0.5)[1]
    x = model.estimate_x0(u, y)[0]
    zeta, e, p = np.zeros(6), [], model.params_
    for u_k in u:
        du = u_k - model.u_offset_
        h = p.W_h @ np.tanh(p.W_s @ x + p.b_s) + p.b_h
        g = p.W_g @ (np.tanh(p.W_x @ x + p.W_u @ du + p.b_x) - np.tanh(p.b_x))
        e.append(model.C_ @ zeta)
        zeta = model.A_ @ zeta + g
        x = model.A_ @ x + model.B_ @ (du + h) + g
    np.testing.assert_allclose(ladder["AL-SSNN"].e, np.array(e)[50:], atol=1e-10)


@pytest.mark.parametrize("name", ["LTI", "FL-SSNN"])
def test_models_without_g_leave_no_residual(ladder, name):
    assert np.abs(ladder[name].e).max() < 1e-12


def test_a_diverging_model_has_infinite_errors(record):
    class Unstable(LinearStateSpace):
        def fit(self, u, y, experiment=None):
            super().fit(u, y, experiment)
            self._theta = 1.3 * self._theta  # diverges behind the first samples
            self.A_ = 1.3 * self.A_
            return self

    ladder = model_ladder(*record, models={"bad": Unstable(nx=6)})
    row = ladder["bad"]
    assert np.isposinf(row.rmse_test) and np.isneginf(row.fit_percent)
    assert not row.linearization_error.any() and not row.e.any()  # it has no g
    assert "inf" in str(ladder)


# Data


def test_test_data_can_be_given(record):
    train, test = record.split(0.5)
    given = model_ladder(*train, test=test, nx=6, models=["lti"])
    split = model_ladder(*record, nx=6, models=["lti"])
    np.testing.assert_array_equal(given["LTI"].y_hat, split["LTI"].y_hat)
    labels = np.repeat([0, 1], [200, len(test) - 200])
    both = model_ladder(*train, test=(*test, labels), nx=6, models=["lti"])
    assert both.parts == (slice(0, 150), slice(150, 500))


def test_the_last_part_of_every_experiment_is_kept_for_testing(record):
    u, y = record
    labels = np.repeat(["a", "b"], [800, 400])
    ladder = model_ladder(u, y, experiment=labels, test_size=0.25, nx=6, models=["lti"])
    # 200 and 100 samples, of which 50 and 25 set the initial states
    assert ladder.parts == (slice(0, 150), slice(150, 225))
    np.testing.assert_allclose(ladder.y_test[:150], y[650:800])
    np.testing.assert_allclose(ladder.y_test[150:], y[1125:])
    assert ladder["LTI"].model.experiments_ == ["a", "b"]


def test_experiments_may_be_lists(record):
    parts = record.split(0.6)
    us, ys = [one.u for one in parts], [one.y for one in parts]
    labels = np.repeat([0, 1], [len(one) for one in parts])
    options = {"nx": 6, "models": ["lti"]}
    joined = model_ladder(*record, experiment=labels, **options)
    listed = model_ladder(us, ys, **options)
    assert listed.parts == joined.parts and len(listed.parts) == 2
    np.testing.assert_array_equal(listed["LTI"].y_hat, joined["LTI"].y_hat)
    tested = [
        model_ladder(us, ys, test=test, **options)
        for test in ((*record, labels), (us, ys), list(parts))
    ]
    for one in tested:
        assert one.parts == tested[0].parts and len(one.parts) == 2
        np.testing.assert_array_equal(one.y_test, tested[0].y_test)
    with pytest.raises(ValueError, match="`experiment` must be None for a list"):
        model_ladder(us, ys, experiment=labels, **options)


def test_lists_and_frames_are_accepted(record):
    u, y = record
    lists = model_ladder(u.tolist(), y[:, 0].tolist(), nx=6, models=["lti"])
    frames = model_ladder(
        pd.DataFrame(u, columns=["voltage"]),
        pd.DataFrame(y, columns=["speed"]),
        nx=6,
        models=["lti"],
    )
    np.testing.assert_allclose(lists["LTI"].y_hat, frames["LTI"].y_hat)
    assert frames.output_names == ["speed"] and lists.output_names is None
    assert list(frames["LTI"].model.feature_names_in_) == ["voltage"]


def test_several_outputs_have_figures_of_their_own(record):
    u, y = record
    Y = np.column_stack([y, 2 * np.roll(y, 1, axis=0)])
    ladder = model_ladder(u, Y, nx=7, models=["lti"])
    assert ladder["LTI"].rmse_test.shape == (2,)
    assert "mean over the 2 outputs" in " ".join(str(ladder).split())
    assert "rmse_test[y1]" in ladder.to_frame().columns


def test_callback_sees_every_row_as_it_is_finished(record):
    rows = []
    ladder = model_ladder(*record, nx=2, models=["lti"], callback=rows.append)
    assert rows == list(ladder)


def test_models_can_be_estimators(record):
    sizes = {"nx": 2, "n_h": 2, "n_g": 2, "n_init": 1}
    model = AlSsnn(**sizes, gamma=10.0, alpha=1e-4, max_iter=3, random_state=0)
    ladder = model_ladder(*record, models={"heavy": model})
    assert ladder["heavy"].model.gamma == 10.0
    assert not hasattr(model, "A_")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"models": ["arx"]},
            "`models` must name lti, fl, al, al-paper, gr, got 'arx'. Give",
        ),
        ({"models": []}, "`models` must name at least one model, got none. Use"),
        ({"test": (1, 2, 3, 4)}, r"`test` must be a Record, .* got 4 items. Use None"),
        ({"test_size": 1.0}, "`test_size` must lie strictly between 0 and 1, got 1.0"),
        (
            {"test_size": 1e-6},
            "`test_size` must leave .* of 1200 samples. Take another",
        ),
        ({"experiment": [0, 1]}, "`experiment` must have one label per sample"),
    ],
)
def test_wrong_arguments(record, options, message):
    with pytest.raises(ValueError, match=message):
        model_ladder(*record, **options)


def test_what_no_estimator_takes_is_refused(record):
    message = "must be given options of estimators, got order. Look at"
    with pytest.raises(TypeError, match=message):
        model_ladder(*record, nx=2, order=6)


@pytest.mark.parametrize(("u", "sizes"), [(np.zeros((3, 1)), "3"), (1.0, "0")])
def test_signals_of_different_lengths(record, u, sizes):
    with pytest.raises(ValueError, match=f"same number of samples, got {sizes} and"):
        model_ladder(u, record.y)


# Table


def test_table_is_aligned_and_marks_unfinished_fits(ladder):
    lines = str(ladder).splitlines()
    rule = lines[2]
    assert set(rule) == {"-"} and len(rule) <= 79
    assert all(len(line) == len(rule) for line in lines[:2] + lines[3:7])
    assert lines[3].startswith("LTI ") and "  0  " in lines[3]
    assert lines[5].startswith("AL-SSNN *")
    assert "\n* stopped before the cost settled: " in str(ladder)


def test_table_says_what_the_error_of_the_loop_is_relative_to(ladder):
    words = " ".join(str(ladder).split())
    assert "in the loop: rms(e) / std(y_lin) under u = v - h" in words


def test_table_without_unfinished_fits_has_no_star():
    assert "*" not in str(make_ladder(make_row()))


def test_frame_has_the_figures(ladder):
    frame = ladder.to_frame()
    assert list(frame.index) == [row.name for row in ladder]
    assert frame.loc["LTI", "rmse_test"] == ladder["LTI"].rmse_test[0]
    assert not frame.loc["AL-SSNN", "converged"]


def test_frame_without_pandas(ladder, monkeypatch):
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(ImportError, match=r"needs pandas.* Install it by pip install"):
        ladder.to_frame()


# Explanation


def test_explanation_follows_the_numbers():
    lti = make_row("LTI", missed=20.0, rest=0.0)
    text = explain(lti, make_row(missed=0.5, rest=2.0, rho=np.exp(-0.1)))
    assert "LTI misses 20 % of the output, AL-SSNN 0.5 %, 40 times less." in text
    assert "2 % of the output of AL-SSNN is still not" in text
    assert "10 times less than LTI misses without that feedback" in text
    assert "decays by 63 % in 10 samples, 1 s." in text


def test_a_model_without_a_law_is_not_said_to_be_linearized():
    text = explain(replace(make_row(), no_law="u arrives late."))
    assert "there is no linearized loop. u arrives late." in text
    assert "with u = v - h" not in text


def test_explanation_of_a_plant_that_h_does_not_linearize():
    lti = make_row("LTI", missed=20.0, rest=0.0)
    text = explain(lti, make_row(missed=0.5, rest=23.0))
    assert "cancelling h does not make this plant more linear" in text


def test_explanation_without_any_rest():
    text = explain(make_row("LTI", missed=20.0, rest=0.0), make_row(rest=0.0))
    assert "0 % of the output of AL-SSNN is still not" in text


def test_explanation_of_networks_that_gain_nothing():
    lti = make_row("LTI", missed=1.0, rest=0.0)
    assert "the networks gain nothing" in explain(lti, make_row(missed=0.95))


def test_explanation_does_not_depend_on_the_units_of_the_outputs():
    rows = make_row("LTI", missed=5.0, ny=2), make_row(missed=2.0, ny=2)
    in_mv = [replace(row, rmse_test=row.rmse_test * [1, 1000]) for row in rows]
    in_mv[1].rmse_test[1] = in_mv[0].rmse_test[1]  # the second output gains nothing
    for some in (rows, in_mv):
        text = " ".join(make_ladder(*some, ny=2).explain().split())
        assert "misses 5 % of the output, AL-SSNN 2 %, 2.5 times less." in text


def test_explanation_of_unstable_models():
    lti = make_row("LTI", missed=20.0, rest=0.0)
    text = explain(lti, make_row(missed=np.inf, rest=np.inf, rho=1.02))
    assert "AL-SSNN diverges on the test data" in text
    assert "grows without bound" in text
    assert "A of AL-SSNN is unstable (spectral radius 1.0200)" in text
    text = explain(lti, make_row(missed=0.5, rest=2.0, rho=1.0))
    assert "A of AL-SSNN integrates (spectral radius 1.0000)" in text


def test_no_free_run_knows_what_drifts():
    model = SimpleNamespace(converged_=True, drift="input")
    rows = [
        replace(make_row(name, missed=missed, rest=2.0), model=model)
        for name, missed in (("LTI", 160.0), ("AL-SSNN", 150.0))
    ]
    text = explain(*rows)
    assert "Accuracy: no free run knows what drifts. `validate` judges" in text
    assert "2 % of the output of AL-SSNN is still not the response" in text
    assert "LTI misses" not in text and "says nothing" not in text
    assert "which does not know what drifts" in str(make_ladder(*rows))
    model.fitted_ = SimpleNamespace(grows=False)
    assert make_ladder(*rows).fault(rows[1]) == ""
    assert "does not know" not in str(make_ladder(make_row()))


def test_explanation_counts_the_loop():
    """A model is not praised by its open loop alone."""
    lti = make_row("LTI", missed=20.0, rest=0.0)
    row = replace(make_row(rest=0.0024), closed_linearization_error=np.array([35.4]))
    text = explain(lti, replace(row, closed_outside=0.994))
    assert "and 3,540 % in the loop itself" in text
    assert "99 % of its samples outside the training data" in text
    assert "Design on (A, B, C)" not in text
    assert "does not make this plant more linear" in explain(lti, row)
    text = explain(lti, replace(make_row(rest=0.1), large_law=10.0))
    assert "the law is 10 times the recorded input" in text
    assert "Design on" not in text and "Design on" in explain(lti, make_row(rest=0.1))


def test_explanation_has_the_means_of_the_table():
    """The worst output of the record is not said to be the loop."""
    lti = make_row("LTI", missed=20.0, rest=0.0)
    open_loop, loop = np.array([0.0828, 0.0641]), np.array([0.0814, 0.0571])
    row = replace(make_row(), linearization_error=open_loop)
    text = explain(lti, replace(row, closed_linearization_error=loop))
    assert "7.3 % of the outputs (mean; 8.3 % of one of them)" in text
    assert "in the loop itself" not in text


def test_explanation_does_not_praise_what_misses_the_mean():
    lti = make_row("LTI", missed=20.0, rest=0.0)
    text = explain(lti, make_row(missed=130.0, rest=0.0))
    assert "no better than their mean" in text
    assert "says nothing on how linear" in text and "Design on" not in text


def test_explanation_without_the_rows_it_is_about():
    assert make_ladder(make_row("LTI")).explain() == ""
    assert explain(make_row(rest=2.0)).startswith("- Linearity: with u = v - h, 2 %")
    assert "(A, B, C). - Stability" in explain(make_row(rest=2.0))


def test_advice_on_feedback():
    def row(error):
        return replace(make_row(), linearization_error=np.array([error]))

    gain = _about_feedback(row(0.2), row(0.002))
    assert "h(y) leaves 20 % of the output nonlinear, h(x) 0.2 %" in gain
    assert "observer and cancel h(x)" in gain
    assert "not worth its while" in _about_feedback(row(0.02), row(0.015))
    assert "observer and cancel" in _about_feedback(row(np.inf), row(0.1))
    assert "says nothing about state feedback" in _about_feedback(row(0.1), row(np.inf))


def test_presets_are_the_defaults_and_the_form_of_the_paper():
    for key, (_, cls, changes) in PRESETS.items():
        assert bool(changes) == (key == "al-paper")
        assert changes.items() <= cls(**changes).get_params().items()
    for model in _estimators(None, {"random_state": None}).values():
        assert model.get_params() == type(model)().get_params()


def test_options_are_those_of_the_preset_unless_given(record):
    options = {"nx": 2, "n_h": 1, "n_g": 1, "alpha": 0.0, "max_iter": 1, "n_init": 1}
    options["models"] = ["fl", "al", "al-paper", "lti"]
    names = ("gamma", "gamma_h", "feedback", "stability")
    rows = []
    for given in (
        {},
        dict(zip(names, (2.0, 1e-3, "output", "contractive"), strict=True)),
    ):
        ladder = model_ladder(*record, **given, **options)
        known = [row.model.get_params() for row in ladder]
        rows.append([[p.get(name) for name in names] for p in known])
    assert rows[0] == [
        [None, 0.0, "state", "auto"],
        [0.01, 0.0, "state", "auto"],
        [1.0, 0.0, "output", None],
        [None] * 4,
    ]
    assert rows[1] == [
        [None, 1e-3, "output", "contractive"],
        *[[2.0, 1e-3, "output", "contractive"]] * 2,
        [None] * 4,
    ]


def test_table_marks_networks_that_do_not_help():
    row = make_row()
    row.model.message_ = "the networks do not help: this is the linear model"
    text = str(make_ladder(row))
    assert "\nAL-SSNN = " in text
    assert "\n= the networks do not simulate hidden samples better than" in text


@pytest.mark.parametrize(
    ("costs", "message"),
    [
        ([1.0, 0.5, 0.2, 0.1], "lowered it by 80 % in its last 2 steps. More iter"),
        (
            [1.0, 0.5, 0.4999, 0.4998],
            "0.04 % in its last 2 steps. More iterations may",  # too few to say
        ),
        (
            [*np.linspace(1.0, 0.5, 20), *np.linspace(0.5, 0.4998, 20)],
            "0.04 % in its last 20 steps. More iterations will hardly",
        ),
        ([1.0], "settled: more iterations may help."),
    ],
)
def test_a_star_says_whether_it_matters(costs, message):
    model = SimpleNamespace(
        converged_=False,
        history_=[Step("train", i, cost, 0.0, np.nan) for i, cost in enumerate(costs)],
    )
    row = replace(make_row(), model=model)
    assert message in " ".join(str(make_ladder(row)).split())

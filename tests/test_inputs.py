"""What the networks see: h_inputs and g_inputs."""

import warnings

import control
import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import LinearStateSpace
from alssnn.models import state_space
from alssnn.starts import initial_theta
from alssnn.subspace import identify_linear
from models import al_ssnn, fit, fl_ssnn, gr_ssnn, record

QUICK = {"nx": 3, "max_iter": 15, "tol": 1e-3, "random_state": 0}
A = np.array([[0.7, 0.2, 0.0], [-0.2, 0.6, 0.1], [0.0, -0.1, 0.5]])
START = (A, np.ones((3, 2)), np.eye(3)[:2] * 100.0)


def test_h_sees_the_outputs_that_are_listed():
    model = fit(fl_ssnn(n_h=3, h_inputs=["flow"], **QUICK))
    W_y = model.params_["W_y"]
    assert not W_y[:, 0].any()
    assert W_y[:, 1].all()
    by_number = fit(fl_ssnn(n_h=3, h_inputs=[1], **QUICK))
    np.testing.assert_array_equal(by_number.params_["W_y"], W_y)


def test_what_h_does_not_see_does_not_move_its_law():
    model = fit(fl_ssnn(n_h=3, h_inputs="flow", **QUICK))
    y = np.array([[0.0, 0.3], [7.0, 0.3]])
    assert np.ptp(model.plant_.cancelled(y), axis=0).max() == 0


def test_h_sees_the_states_that_are_listed():
    options = {"linear_start": START, "feedback": "state", "h_inputs": [0, 2]}
    model = fit(fl_ssnn(n_h=3, **QUICK, **options))
    np.testing.assert_array_equal(model.params_["W_s"].any(axis=0), [True, False, True])


@pytest.mark.parametrize(
    ("g_inputs", "x", "u"),
    [
        ({"x": [1], "u": "all"}, [0, 1, 0], [1, 1]),
        ({"x": "all"}, [1, 1, 1], [0, 0]),
        ({"u": ["p*/"]}, [0, 0, 0], [0, 1]),
        ({"x": np.array([0, 2]), "u": (0,)}, [1, 0, 1], [1, 0]),
    ],
)
@pytest.mark.parametrize("model", [al_ssnn(n_h=2, n_g=3), gr_ssnn(n_f=3)])
def test_g_sees_the_signals_that_are_listed(model, g_inputs, x, u):
    changes = {"linear_start": START, "g_inputs": g_inputs}
    p = fit(model, **QUICK, **changes).params_
    np.testing.assert_array_equal(p["W_x"].any(axis=0), np.array(x, bool))
    np.testing.assert_array_equal(p["W_u"].any(axis=0), np.array(u, bool))


def test_none_is_everything():
    every = {"h_inputs": [0, 1], "g_inputs": {"x": "all", "u": [0, 1]}}
    model = al_ssnn(n_h=2, n_g=2, **QUICK)
    np.testing.assert_array_equal(fit(model)._theta, fit(model, **every)._theta)


def test_the_start_spreads_over_what_is_seen(rng):
    u = rng.standard_normal((500, 1))
    y = np.column_stack([np.convolve(u[:, 0], 0.9 ** np.arange(30))[:500]] * 2)
    y += 0.1 * rng.standard_normal(y.shape)
    experiments = [(u, y / y.std(axis=0))]
    linear = identify_linear(experiments, 2)
    structure = state_space(2, 1, 2, n_h=4000, C=linear.C)
    high = np.broadcast_to([0.0, np.inf], (4000, 2))
    theta = initial_theta(structure, linear, experiments, rng, {"W_y": (-high, high)})
    W_y = structure.split(theta)["W_y"]
    assert not W_y[:, 0].any()
    assert np.std(W_y[:, 1]) == pytest.approx(1.0, abs=0.05)  # the whole slope


@pytest.mark.parametrize("method", ["lm", "trf"])
@pytest.mark.parametrize(
    "changes",
    [
        {"alpha": 1e-3},
        {"stability": "contractive"},
        {"penalty": "output", "gamma_h": 1e-2},
        {"n_init": 2, "coarse_samples": 100},
    ],
)
def test_every_way_of_training_keeps_the_columns(changes, method):
    model = al_ssnn(n_h=2, n_g=2, h_inputs=[1], g_inputs={"x": "all"}, **QUICK)
    p = fit(model, method=method, **changes).params_
    assert not p["W_y"][:, 0].any()
    assert not p["W_u"].any()


def test_a_warm_start_continues_unless_the_networks_see_less():
    model = fl_ssnn(n_h=2, warm_start=True, **QUICK)
    data = record(2, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.set_params(h_inputs=[1]).fit(*data)
        narrow = model.cost_
        model.set_params(h_inputs=None).fit(*data)  # goes on, with zeros to begin with
        assert model.history_[0].label != "linear"
        assert model.cost_ <= narrow
        model.set_params(h_inputs=[1]).fit(*data)  # begins again
    assert model.history_[0].label == "linear"
    assert not model.params_["W_y"][:, 0].any()


def test_held_weights_are_certain_and_not_counted():
    model = fit(al_ssnn(n_h=2, n_g=2, h_inputs=[1], **QUICK))
    u, y, experiment = record(2, 2)
    covariance = model.parameter_covariance(u, y, experiment)
    where = model._structure.slices["W_y"]
    variance = np.diag(covariance.covariance)[where].reshape(2, 2)
    assert not variance[:, 0].any()
    assert variance[:, 1].all()
    assert covariance.rank <= model.fitted_.free.sum() + 6
    refits = model.sample_models(covariance, 2, 0, data=(u, y, experiment), max_iter=3)
    assert not any(refit.params_["W_y"][:, 0].any() for refit in refits)


def test_what_is_held_is_not_free():
    every, one = (fit(fl_ssnn(n_h=2, h_inputs=h, **QUICK)) for h in (None, [0]))
    assert every.fitted_.free.sum() - one.fitted_.free.sum() == 2


def test_choices_survive_a_file(tmp_path):
    choices = {"h_inputs": ["flow"], "g_inputs": {"x": "all", "u": ["p*/"]}}
    model = fit(al_ssnn(n_h=2, n_g=2, **QUICK, **choices))
    model.save(tmp_path / "model.npz")
    loaded = alssnn.load(tmp_path / "model.npz")
    assert {k: loaded.get_params()[k] for k in choices} == choices
    assert clone(loaded).get_params()["g_inputs"] == choices["g_inputs"]
    np.testing.assert_array_equal(loaded.fitted_.free, model.fitted_.free)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"h_inputs": ["speed"]}, r"`h_inputs` must hold numbers .* level, flow"),
        ({"h_inputs": [2]}, r"`h_inputs` must hold numbers of the outputs, 0 to 1"),
        ({"h_inputs": [-1]}, "Numbers count from 0"),
        ({"h_inputs": [True, False]}, "got True"),
        ({"h_inputs": []}, r"`h_inputs` must list .* n_h=0"),
        ({"h_inputs": [0], "feedback": "state"}, r"`h_inputs` .*`linear_start`"),
        ({"g_inputs": {}}, "`g_inputs` must name signals among 'x', 'u'"),
        ({"g_inputs": {"y": [0]}}, r"`g_inputs` .* got \['y'\]"),
        ({"g_inputs": {"x": []}}, r"`g_inputs` must list .* n_g=0"),
        ({"g_inputs": {"u": ["speed"]}}, r"`g_inputs` .* valve.a, p\*/"),
        ({"g_inputs": {"x": [0]}}, r"`g_inputs` .* give `linear_start`"),
        (
            {"g_inputs": {"x": [5]}, "linear_start": START},
            "`g_inputs` must hold numbers of the states, 0 to 2, got 5",
        ),
        (
            {
                "g_inputs": {"x": [0]},
                "linear_start": START,
                "stability": "contractive",
            },
            "with stability=None",
        ),
        ({"g_inputs": ["valve.a"]}, "`g_inputs`"),
    ],
)
def test_choices_that_name_nothing_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        fit(al_ssnn(n_h=2, n_g=2, **QUICK), **changes)


def test_names_need_names():
    u, y, experiment = (np.asarray(part) for part in record(2, 2))
    model = fl_ssnn(n_h=2, h_inputs=["level"], **QUICK)
    with pytest.raises(ValueError, match=r"got 'level'\. Names need data frames"):
        model.fit(u, y, experiment)
    named = pd.DataFrame(y, columns=["level", "flow"])
    with pytest.raises(ValueError, match="`h_inputs`"):
        clone(model).set_params(h_inputs=["flows"]).fit(u, named, experiment)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("side", ["inputs", "outputs"])
def test_a_start_with_signals_in_another_order_is_refused(side):
    rng = np.random.default_rng(0)
    u = pd.DataFrame(rng.standard_normal((200, 2)), columns=["valve", "flow"])
    y = pd.DataFrame(rng.standard_normal((200, 2)), columns=["T", "p"])
    names = {"inputs": ["valve", "flow"], "outputs": ["T", "p"]}
    matrices = 0.5 * np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), 1.0
    start = control.ss(*matrices, **names | {side: names[side][::-1]})
    match = rf"`linear_start` must have its {side} in the order of the record"
    with pytest.raises(ValueError, match=match):
        LinearStateSpace(linear_start=start, max_iter=1).fit(u, y)
    for known in (control.ss(*matrices, **names), control.ss(*matrices)):
        LinearStateSpace(linear_start=known, max_iter=1).fit(u, y)
    other = control.ss(*matrices, inputs=["a", "b"], outputs=["c", "d"])
    LinearStateSpace(linear_start=other, max_iter=1).fit(u, y)  # named otherwise

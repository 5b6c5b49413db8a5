"""Every fit ends in a model that can be used, or in a refusal that says why."""

import copy
import pickle
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import event, given
from hypothesis import strategies as st
from sklearn.base import clone

import alssnn
from fuzzing import cases, check_refusal, only_warnings_for_users
from records import models, records

ROUNDING = 1e-18  # a cost that is zero, outputs having unit variance


def fit(model, record):
    """Return the fitted model, or None if it was refused."""
    try:
        return model.fit(*record)
    except (ValueError, TypeError) as error:
        check_refusal(error)
        event("refused")
        return None


@cases(60)
@given(models(), records(), st.booleans())
def test_a_fit_is_a_model_or_a_refusal(model, record, again):
    check(model, record, again)


CONTINUOUS = {
    "time": "continuous",
    "noise": "output",  # what follows is refused in continuous time
    "horizon": 1,
    "integrators": 0,
    "disturbances": None,
    "period": None,
    "drift": None,
}


@cases(20)
@given(models(**CONTINUOUS), records())
def test_a_fit_in_continuous_time_misses_little_more_than_its_start(model, record):
    check(model.set_params(dt=0.1 if model.dt == 1.0 else model.dt), record, False)


def check(model, record, again):
    """Fit a model, and assert what holds for every fit."""
    given_ = copy.deepcopy(record)
    with only_warnings_for_users() as said:
        fitted = fit(model, record)
        assert pickle.dumps(record) == pickle.dumps(given_)  # nan and objects, too
        if fitted is None:
            assert not hasattr(model, "A_")
            return
        event("fitted")
        u, y, experiment = record
        for name, value in [*fitted.params_.items(), ("x0_", fitted.x0_)]:
            assert np.isfinite(value).all(), name
        assert np.isfinite(fitted.cost_)
        y_hat = fitted.predict(u, experiment, x0="training")
        assert y_hat.shape == y.shape
        check_cost(fitted, [str(warning.message) for warning in said])
        try:
            score = fitted.score(*record)
            assert np.isfinite(score) or score == -np.inf
        except ValueError as error:
            check_refusal(error)
        if again and (model.get_params().get("random_state", 0) is not None):
            twin = clone(model).fit(*record)
            np.testing.assert_array_equal(twin._theta, fitted._theta)
        check_file(fitted, u, experiment)


def check_cost(model, said):
    """Assert that training made nothing worse than the linear start."""
    if model.get_params().get("validation_fraction"):
        return  # hidden samples choose, not the cost
    worse = 1 + 1e-6
    if model.time == "continuous":  # its start is discrete: it tells what that misses
        worse = 1.1**2
        if any("in continuous time misses" in message for message in said):
            return
    history = [s for s in model.history_ if "coarse" not in s.label]
    linear = [s.cost for s in history if s.label.startswith("linear")]
    last = history[-1].label if history else ""
    starts = [s.cost for s in history if s.label == last and s.iteration == 0]
    if linear and not last.startswith("linear"):
        before = max(linear[-1], *starts, ROUNDING)
        assert model.cost_ <= worse * before, model.history_


def check_file(model, u, experiment):
    """Assert that a saved model is the same one."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        try:
            model.save(path)
        except (ValueError, TypeError) as error:  # an option that no file holds
            check_refusal(error)
            return
        loaded = alssnn.load(path)
    np.testing.assert_array_equal(
        loaded.predict(u, experiment), model.predict(u, experiment)
    )
    assert loaded.cost_ == model.cost_


SHORT = st.integers(1, 4)


@cases(10)
@given(SHORT, st.sampled_from(["score", "simulate_test", "validate", "estimate_x0"]))
def test_records_of_a_few_samples(n, method):
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=(60, 1)), rng.normal(size=60)
    model = alssnn.LinearStateSpace(nx=1).fit(u, y)
    with only_warnings_for_users():
        try:
            result = getattr(model, method)(u[:n], y[:n])
        except ValueError as error:
            check_refusal(error)
            assert str(error).startswith("`y` must have at least")
        else:
            assert np.isfinite(
                np.hstack([np.ravel(part) for part in result])
                if isinstance(result, tuple)
                else result
            ).all()

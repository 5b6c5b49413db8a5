"""Callbacks of scikit-learn follow a fit, score it and end it."""

import threading
import warnings

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit

from alssnn import FlSsnn
from alssnn.datasets import make_wiener_hammerstein
from models import al_ssnn

callback = pytest.importorskip("sklearn.callback", reason="needs scikit-learn 1.9")


@pytest.fixture(autouse=True)
def _short_fits():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        yield


@pytest.fixture(scope="module")
def record():
    return make_wiener_hammerstein(600, noise=0.01, random_state=0)


@pytest.fixture
def model():
    return al_ssnn(2, 2, 2, max_iter=12, coarse_samples=300, random_state=0)


class Follower:
    """Keep what a callback is told, and end the fit when it is told to."""

    def __init__(self, stop_at=None):
        self.stop_at = stop_at
        self.events, self.scores = [], []

    def setup(self, estimator, context):
        self.events.append("setup")

    def teardown(self, estimator, context):
        self.events.append("teardown")

    def on_fit_task_begin(self, estimator, context):
        self.events.append(f"{context.task_name} begins")

    def on_fit_task_end(self, estimator, context, *, X, y, fitted_estimator):
        self.events.append(f"{context.task_name} ends")
        if context.task_name == "iteration" and fitted_estimator is not None:
            assert fitted_estimator is not estimator
            self.scores.append(fitted_estimator.score(X, y))
        return self.events.count("iteration ends") == self.stop_at


def test_every_accepted_step_is_a_task(model, record):
    follower = Follower()
    model.set_params(linear_part="trained")  # of the loop there are no tasks (eq. kept)
    model.set_callbacks(follower).fit(*record)
    assert follower.events[:2] == ["setup", "fit begins"]
    assert follower.events[-2:] == ["fit ends", "teardown"]
    assert follower.events.count("iteration ends") == len(model.history_)
    n_linear = sum(step.label == "linear" for step in model.history_)
    assert len(follower.scores) == len(model.history_) - n_linear
    assert follower.scores[-1] == pytest.approx(model.score(*record))
    assert follower.scores[0] < follower.scores[-1]


@pytest.mark.parametrize("n_jobs", [None, 2])
def test_a_search_is_no_task(record, n_jobs):
    # with callbacks that no process but this one can have
    follower = Follower()
    follower.lock = threading.Lock()
    model = FlSsnn(2, 2, n_init=2, max_iter=50, random_state=0, n_jobs=n_jobs)
    plain = clone(model).fit(*record)
    model.set_callbacks(follower).fit(*record)
    assert follower.events.count("iteration ends") == len(model.history_)
    assert [step.cost for step in model.history_] == [s.cost for s in plain.history_]
    np.testing.assert_array_equal(plain.predict(record.u), model.predict(record.u))


def test_callbacks_change_no_result(model, record):
    plain = clone(model).fit(*record)
    model.set_callbacks(Follower()).fit(*record)
    np.testing.assert_array_equal(plain.predict(record.u), model.predict(record.u))


def test_a_callback_ends_the_fit(model, record):
    follower = Follower(stop_at=5)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConvergenceWarning)  # it was the user's wish
        model.set_callbacks(follower).fit(*record)
    assert len(model.history_) >= 5
    assert follower.events.count("iteration ends") == 5
    assert model.message_ == "stopped by a callback"
    assert not model.converged_
    assert np.isfinite(model.score(*record))


def test_the_scoring_monitor_of_scikit_learn(model, record):
    monitor = callback.ScoringMonitor(scoring={"own": type(model).score})
    experiment = np.repeat(["a", "b"], 300)
    model.set_callbacks(monitor).fit(*record, experiment)
    rows = [row for row in monitor.get_logs().data if "own" in row]
    scores = {row["task_id_path"]: row["own"] for row in rows}
    assert scores[(0,)] == model.score(*record, experiment)  # the fit itself
    n_linear = sum(step.label == "linear" for step in model.history_)
    assert len(scores) == 1 + len(model.history_) - n_linear
    assert len(set(scores.values())) > 10


def test_a_search_over_models_can_be_followed(model, record):
    follower = Follower()
    search = GridSearchCV(
        model.set_callbacks(follower), {"gamma": [1.0, 0.1]}, cv=TimeSeriesSplit(2)
    )
    search.fit(*record)
    # two weights, two folds, one refit
    assert follower.events.count("setup") == follower.events.count("teardown") == 5

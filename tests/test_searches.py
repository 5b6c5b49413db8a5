"""Searches of scikit-learn: labels reach everyone, scores keep to the policy."""

import pickle

import numpy as np
import pandas
import polars
import pytest
from scipy.signal import lfilter
from sklearn import config_context
from sklearn.base import clone
from sklearn.experimental import enable_halving_search_cv  # noqa: F401
from sklearn.model_selection import (
    GridSearchCV,
    HalvingGridSearchCV,
    KFold,
    LeaveOneGroupOut,
    cross_val_predict,
    cross_validate,
)

from alssnn import LinearStateSpace, metrics, scorers
from alssnn.datasets import make_wiener_hammerstein
from alssnn.estimators import _sklearn
from alssnn.estimators._fitted import publish_parameters
from alssnn.model_selection import (
    BlockedTimeSeriesSplit,
    ExperimentKFold,
    seam_labels,
)
from models import al_ssnn

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
SCORING = {
    "accuracy": scorers.neg_rmse,
    "fit": scorers.fit_percent,
    "linearity": scorers.neg_linearization_error,
}


@pytest.fixture(scope="module")
def record():
    return make_wiener_hammerstein(1500, noise=0.01, random_state=0)


@pytest.fixture
def network():
    return al_ssnn(nx=4, n_h=2, n_g=2, max_iter=8, tol=1e-2, random_state=0)


# -- routing -------------------------------------------------------------------------


def test_labels_reach_fit_score_and_splitter_without_a_request(record):
    labels = seam_labels(1500, np.repeat([0, 1, 2], 500))
    model = LinearStateSpace(nx=2)
    with config_context(enable_metadata_routing=True):
        search = GridSearchCV(
            model, {"nx": [1, 2]}, cv=ExperimentKFold(3), scoring=SCORING, refit="fit"
        ).fit(record.u, record.y, experiment=labels)
        scores = cross_validate(
            model,
            record.u,
            record.y,
            cv=KFold(3),
            params={"experiment": labels[::1]},
            return_estimator=True,
        )
    assert search.best_estimator_.experiments_ == [(0, 0), (1, 500), (2, 1000)]
    assert [m.experiments_ for m in scores["estimator"]] == [
        [(1, 500), (2, 1000)],
        [(0, 0), (2, 1000)],
        [(0, 0), (1, 500)],
    ]
    # the score that was routed is that of the fold with its labels
    test = slice(500, 1000)
    middle = scores["estimator"][1]
    expected = middle.score(record.u[test], record.y[test], labels[test])
    assert scores["test_score"][1] == expected


def test_scores_see_the_seams_of_a_test_fold(record):
    labels = np.repeat([0, 1, 2, 3], [400, 350, 400, 350])
    with config_context(enable_metadata_routing=True):
        result = cross_validate(
            LinearStateSpace(nx=2),
            record.u,
            record.y,
            cv=ExperimentKFold(2),
            scoring=SCORING,
            params={"experiment": labels},
            return_estimator=True,
            return_indices=True,
        )
    test, model = result["indices"]["test"][0], result["estimator"][0]
    data = record.u[test], record.y[test]
    assert len(set(labels[test])) == 2
    expected = metrics.rmse(*model.simulate_test(*data, labels[test]))
    assert result["test_accuracy"][0] == -expected
    assert result["test_accuracy"][0] != -metrics.rmse(*model.simulate_test(*data))


def test_without_routing_labels_reach_fit_and_groups_the_splitter(record):
    labels = np.repeat([0, 1, 2], 500)
    for cv in (ExperimentKFold(3), LeaveOneGroupOut()):
        search = GridSearchCV(LinearStateSpace(), {"nx": [1, 2]}, cv=cv)
        search.fit(record.u, record.y, groups=labels, experiment=labels)
        assert search.best_estimator_.experiments_ == [0, 1, 2]
        assert search.best_params_ == {"nx": 2}
    both = cross_validate(
        LinearStateSpace(nx=2),
        record.u,
        record.y,
        cv=BlockedTimeSeriesSplit(3, gap=50, train="both"),
        params={"experiment": seam_labels(1500)},
        return_estimator=True,
    )
    assert both["estimator"][1].experiments_ == [(0, 0), (0, 1050)]


def test_lists_of_records_are_split_as_lists(record):
    us = [record.u[:600], record.u[600:1000], record.u[1000:]]
    ys = [record.y[:600], record.y[600:1000], record.y[1000:]]
    result = cross_validate(
        LinearStateSpace(nx=2), us, ys, cv=3, scoring=SCORING, return_estimator=True
    )
    model = result["estimator"][1]
    assert model.experiments_ == [0, 1]
    expected = metrics.fit_percent(*model.simulate_test([us[1]], [ys[1]]))
    assert result["test_fit"][1] == expected


# -- scorers -------------------------------------------------------------------------


def test_scorers_are_the_metrics_under_the_policy(record, network):
    train, test = record.split(0.5)
    model = network.fit(*train)
    y_true, y_pred = model.simulate_test(*test)
    assert len(y_true) == len(test.y) - model.n_init_samples
    assert scorers.neg_rmse(model, *test) == -metrics.rmse(y_true, y_pred)
    assert scorers.neg_nrmse(model, *test) == -metrics.nrmse(y_true, y_pred)
    assert scorers.fit_percent(model, *test) == metrics.fit_percent(y_true, y_pred)
    error = model.linearizability(*test).linearization_error.mean()
    assert scorers.neg_linearization_error(model, *test) == -error
    again = pickle.loads(pickle.dumps(scorers.fit_percent))
    assert again(model, *test) == scorers.fit_percent(model, *test)


@pytest.mark.parametrize("metric", ["rmse", "nrmse", "fit_percent"])
def test_k_step_scores_predict_ahead_of_every_experiment(metric):
    rng = np.random.default_rng(0)
    u = rng.standard_normal((900, 2))
    y = np.column_stack([lfilter([0, 1], [1, -0.9], z) for z in u.T])
    y += np.cumsum(0.05 * rng.standard_normal((900, 2)), axis=0)
    y[700:705, 1] = np.nan
    model = LinearStateSpace(nx=2, n_init_samples=30, input_delay=[0, 1]).fit(u, y)
    test, labels = slice(500, 900), np.repeat([7, 3], [180, 220])
    us, ys = u[test], y[test]
    truth, guess = [], []
    for part in (slice(0, 180), slice(180, 400)):
        x0 = model.estimate_x0(us[part], ys[part])
        truth.append(ys[part][45:])
        guess.append(model.predict_ahead(us[part], ys[part], 45, x0=x0)[45:])
    sign = 1 if metric == "fit_percent" else -1
    expected = sign * getattr(metrics, metric)(np.vstack(truth), np.vstack(guess))
    scorer = scorers.k_step(45, metric=metric)
    assert scorer(model, us, ys, labels) == pytest.approx(expected, rel=1e-12)
    lists = [us[:180], us[180:]], [ys[:180], ys[180:]]
    assert scorer(model, *lists) == scorer(model, us, ys, labels)
    near = scorers.k_step(1, metric=metric)  # the window is longer
    x0 = model.estimate_x0(us, ys)
    ahead = model.predict_ahead(us, ys, 1, x0=x0)
    expected = sign * getattr(metrics, metric)(ys[30:], ahead[30:])
    assert near(model, us, ys) == pytest.approx(expected, rel=1e-12)
    assert pickle.loads(pickle.dumps(near))(model, us, ys) == near(model, us, ys)


def test_k_step_in_searches_gets_the_labels(record):
    labels = np.repeat([0, 1, 2, 3], [400, 350, 400, 350])
    scoring = {"near": scorers.k_step(2), "far": scorers.k_step(20)}
    with config_context(enable_metadata_routing=True):
        search = GridSearchCV(
            LinearStateSpace(),
            {"nx": [1, 4]},
            cv=ExperimentKFold(2),
            scoring=scoring,
            refit="far",
        ).fit(record.u, record.y, experiment=labels)
        result = cross_validate(
            LinearStateSpace(nx=4),
            record.u,
            record.y,
            cv=ExperimentKFold(2),
            scoring=scoring,
            params={"experiment": labels},
            return_estimator=True,
            return_indices=True,
        )
    assert search.best_params_ == {"nx": 4}
    test, model = result["indices"]["test"][0], result["estimator"][0]
    data = record.u[test], record.y[test]
    expected = scoring["far"](model, *data, labels[test])
    assert result["test_far"][0] == expected != scoring["far"](model, *data)


def test_k_step_says_what_it_cannot_score(record):
    for bad in (0, 2.5, True, np.inf):
        with pytest.raises(ValueError, match="`steps` must be a positive integer"):
            scorers.k_step(bad)
    with pytest.raises(ValueError, match="`metric` must be 'rmse'"):
        scorers.k_step(1, metric="r2")
    model = LinearStateSpace(nx=2).fit(record.u, record.y)
    with pytest.raises(ValueError, match="Take fewer `steps` or a longer record"):
        scorers.k_step(300)(model, record.u[:300], record.y[:300])
    model._theta = model._theta * 1e3
    publish_parameters(model)
    with np.errstate(all="ignore"):
        assert scorers.k_step(200)(model, record.u, record.y) == -np.inf


def test_a_constraint_ranks_what_meets_it_first(record, network):
    train, test = record.split(0.5)
    model = network.fit(*train)
    error = model.linearizability(*test).linearization_error.mean()
    assert error > 0
    accuracy = scorers.neg_nrmse(model, *test)
    loose = scorers.accuracy_subject_to(linearization_error=1.01 * error)
    tight = scorers.accuracy_subject_to(linearization_error=0.5 * error)
    assert loose(model, *test) == accuracy
    assert tight(model, *test) == pytest.approx(-1 - 2.0)  # twice what is allowed
    assert "0.05" in repr(scorers.accuracy_subject_to(linearization_error=0.05))


def test_a_model_that_diverges_scores_lowest(record):
    model = LinearStateSpace(nx=2).fit(record.u, record.y)
    model._theta = model._theta * 1e3  # spectral radius far above one
    for scorer in (*SCORING.values(), scorers.neg_nrmse):
        with np.errstate(all="ignore"):
            assert scorer(model, record.u, record.y) == -np.inf


def test_best_index_of_known_results():
    choose = scorers.best_subject_to(linearization_error=0.1)
    accuracy = np.array([-1.0, -0.2, -0.1, np.nan])
    linearity = np.array([-0.01, -0.09, -0.5, -0.0])
    results = {"mean_test_accuracy": accuracy, "mean_test_linearity": linearity}
    assert choose(results) == 1
    assert choose({**results, "mean_test_linearity": linearity - 1}) == 0  # none
    with pytest.raises(ValueError, match="a score of the name 'linearity'"):
        choose({"mean_test_accuracy": accuracy})
    with pytest.raises(ValueError, match="needs a candidate"):
        choose({**results, "mean_test_accuracy": np.full(4, np.nan)})
    for bad in (0, -0.1, np.nan):
        with pytest.raises(ValueError, match="must be positive"):
            scorers.best_subject_to(linearization_error=bad)
        with pytest.raises(ValueError, match="must be positive"):
            scorers.accuracy_subject_to(linearization_error=bad)


# -- searches ------------------------------------------------------------------------


def test_a_grid_over_weights_and_sizes(record, network):
    search = GridSearchCV(
        network,
        {"nx": [2, 4], "n_h": [1], "n_g": [2], "gamma": [1.0, 0.01]},
        scoring=SCORING,
        refit=scorers.best_subject_to(linearization_error=0.5),
        cv=BlockedTimeSeriesSplit(2, gap=20),
        error_score="raise",
    ).fit(record.u, record.y)
    results = search.cv_results_
    means = results["mean_test_accuracy"], results["mean_test_linearity"]
    allowed = -means[1] <= 0.5
    assert allowed.any()
    assert means[0][search.best_index_] == means[0][allowed].max()
    assert search.best_estimator_.get_params()["n_h"] == 1
    assert len(set(means[0])) == 4


@pytest.mark.parametrize("resource", ["n_samples", "max_iter"])
def test_halving_takes_iterations_or_whole_experiments(record, network, resource):
    # scikit-learn draws samples in random order: records, not instants, must be samples
    parts = [slice(start, start + 75) for start in range(0, 750, 75)]
    lists = [record.u[part] for part in parts], [record.y[part] for part in parts]
    data, cv, limits = {
        "n_samples": (lists, 2, {"min_resources": 4}),
        "max_iter": (record, BlockedTimeSeriesSplit(2), {"max_resources": 8}),
    }[resource]
    search = HalvingGridSearchCV(
        clone(network).set_params(nx=2),
        {"gamma": [1.0, 0.1, 0.01, 0.001]},
        factor=2,
        resource=resource,
        cv=cv,
        scoring=scorers.neg_rmse,
        random_state=0,
        error_score="raise",
        **limits,
    ).fit(*data)
    assert search.n_iterations_ >= 2
    assert search.n_resources_[0] < search.n_resources_[-1]
    if resource == "n_samples":
        assert len(search.best_estimator_.experiments_) == 10


# -- containers ----------------------------------------------------------------------


def frames(library, record):
    u = np.column_stack([record.u, np.roll(record.u, 7)])
    y = np.column_stack([record.y, 2 * record.y])
    make = {"pandas": pandas.DataFrame, "polars": polars.DataFrame}[library]
    u, y = (
        make(dict(zip("ab", u.T, strict=True))),
        make(dict(zip("pq", y.T, strict=True))),
    )
    if library == "pandas":
        u.index = y.index = pandas.date_range("2026", periods=len(u), freq="s")
    return u, y


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_predictions_come_back_as_what_y_was(record, library):
    u, y = frames(library, record)
    model = LinearStateSpace(nx=2).fit(u, y)
    assert model.feature_names_in_.tolist() == ["a", "b"]
    assert model.output_names_ == ["p", "q"]
    y_hat = model.predict(u)
    assert type(y_hat) is type(y) and list(y_hat.columns) == ["p", "q"]
    parts = model.predict([u[:50], u[50:90]])
    assert [type(part) for part in parts] == [type(y)] * 2
    if library == "pandas":
        assert y_hat.index.equals(u.index)
        assert parts[1].index.equals(u.index[50:90])
    plain = LinearStateSpace(nx=2).fit(np.asarray(u), np.asarray(y))
    expected = plain.predict(np.asarray(u))
    assert type(expected) is np.ndarray
    np.testing.assert_array_equal(np.asarray(y_hat), expected)
    again = pickle.loads(pickle.dumps(model)).predict(u)
    assert type(again) is type(y)
    assert model.score(u, y) == plain.score(np.asarray(u), np.asarray(y))

    series = model.fit(u, y["q"]).predict(u)
    assert type(series) is type(y["q"]) and series.name == "q"
    assert model.output_names_ == ["q"]
    # only the y of fit counts
    assert type(model.fit(u, np.asarray(y)).predict(u)) is np.ndarray


def test_unnamed_outputs_and_cross_val_predict(record):
    u, y = frames("pandas", record)
    model = LinearStateSpace(nx=2).fit(u.to_numpy(), y["p"].rename(None))
    y_hat = model.predict(u.to_numpy())
    assert model.output_names_ is None and y_hat.name is None
    assert y_hat.index.tolist() == list(range(len(u)))
    folds = cross_val_predict(model, u.to_numpy(), y, cv=KFold(3))
    assert folds.shape == y.shape


# -- display -------------------------------------------------------------------------


def test_the_display_links_to_the_manual_where_there_is_one(monkeypatch):
    model = al_ssnn()
    monkeypatch.setattr(_sklearn, "manual_url", lambda: "")
    assert model._get_doc_link() == ""
    assert "AlSsnn" in model._repr_html_()
    monkeypatch.setattr(_sklearn, "manual_url", lambda: "https://example.org/en")
    page = "https://example.org/en/generated/alssnn.AlSsnn.html"
    assert model._get_doc_link() == page
    assert page in model._repr_html_()


def test_the_address_is_that_of_the_package(monkeypatch):
    class Metadata:
        def get_all(self, name):
            return ["Source, https://a.org", "Documentation, https://b.org/en/"]

    _sklearn.manual_url.cache_clear()
    monkeypatch.setattr(_sklearn.metadata, "metadata", lambda name: Metadata())
    assert _sklearn.manual_url() == "https://b.org/en"
    _sklearn.manual_url.cache_clear()

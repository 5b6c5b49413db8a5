import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from sklearn.base import clone
from sklearn.model_selection import KFold, cross_val_score

from alssnn import LinearStateSpace
from alssnn.datasets import make_wiener_hammerstein
from alssnn.experiments import split_experiments
from alssnn.model_selection import (
    BlockedTimeSeriesSplit,
    ExperimentKFold,
    GammaPath,
    gamma_path,
    seam_labels,
)
from alssnn.scorers import neg_certified_distance
from models import al_ssnn


@pytest.fixture(scope="module")
def record():
    return make_wiener_hammerstein(1200, noise=0.01, random_state=0)


@pytest.fixture(scope="module")
def path(record):
    estimator = al_ssnn(
        nx=6, n_h=3, n_g=3, penalty="output", max_iter=30, random_state=0
    )
    train, test = record.split(0.5)
    return gamma_path(estimator, *train, gammas=[0.01, 10.0, 1.0, 0.1], test=test)


def test_path_falls_in_gamma_and_gains_accuracy(path):
    np.testing.assert_array_equal(path.gammas, [10.0, 1.0, 0.1, 0.01])
    assert len(path) == len(path.models) == 4
    assert path.rmse_train[-1] < 0.5 * path.rmse_train[0]
    assert [m.gamma for m in path.models] == path.gammas.tolist()
    assert all(not m.warm_start for m in path.models)
    assert len({m.cost_ for m in path.models}) == 4  # four models, not one four times


def test_figures_are_those_of_the_models(path, record):
    _, test = record.split(0.5)
    for i, model in enumerate(path.models):
        y_true, y_pred = model.simulate_test(*test)
        expected = np.sqrt(np.mean((y_true - y_pred) ** 2))
        assert path.rmse_test[i] == pytest.approx(expected, rel=1e-12)
        error = model.linearizability(*test).linearization_error.mean()
        assert path.linearization_error[i] == error


def test_later_fits_share_the_budget_of_one(path):
    assert path.models[0].max_iter == 30
    assert {m.max_iter for m in path.models[1:]} == {10}
    assert sum(m.n_iter_ for m in path.models) <= 60


def test_the_estimator_is_left_alone_and_the_callback_is_called(record):
    estimator = al_ssnn(nx=2, n_h=1, n_g=1, max_iter=2, random_state=0)
    before, calls = estimator.get_params(), []
    gamma_path(
        estimator,
        *record,
        gammas=[1.0, 0.1],
        callback=lambda gamma, model: calls.append((gamma, model.gamma)),
    )
    assert estimator.get_params() == before
    assert not hasattr(estimator, "A_")
    assert calls == [(1.0, 1.0), (0.1, 0.1)]


def known(rmse, error, radius=0.9):
    n = len(rmse)
    return GammaPath(
        gammas=np.logspace(1, -1, n),
        models=(None,) * n,
        rmse_train=np.array(rmse, float),
        rmse_test=np.array(rmse, float),
        linearization_error=np.array(error, float),
        spectral_radius=np.broadcast_to(radius, n),
        seconds=np.ones(n),
    )


def test_knee_of_known_curves():
    # an L: the corner is the third point
    assert known([1, 0.1, 0.01, 0.009, 0.008], [0.01, 0.011, 0.012, 0.1, 1]).knee() == 2
    # no gain: a straight line has no knee, take the most accurate
    assert known([1, 0.1, 0.01], [0.01, 0.1, 1]).knee() == 2


def test_knee_passes_over_unusable_models():
    curve = known([1, 0.01, 0.009], [0.01, 0.012, 1.0])
    assert curve.knee() == 1
    unstable = dataclasses.replace(curve, spectral_radius=np.array([0.9, 1.1, 0.9]))
    assert unstable.knee() != 1
    with pytest.raises(ValueError, match="needs a stable model on the path, got none"):
        dataclasses.replace(curve, spectral_radius=np.full(3, 1.1)).knee()


def test_table_and_frame(path):
    text = str(path)
    assert len(text.splitlines()) == 5
    assert text.count("*") == 1
    frame = path.to_frame()
    np.testing.assert_array_equal(frame.index, path.gammas)
    np.testing.assert_array_equal(frame["rmse_test"], path.rmse_test)


@pytest.mark.usefixtures("rough_certificates")
def test_a_path_may_be_judged_by_what_is_proved(record):
    scores = {1.0: -0.009, 0.3: -0.01, 0.1: -np.inf, 0.03: -0.5}

    def scoring(model, u, y, experiment=None):
        assert len(u) == len(record.u)
        return scores[model.gamma]

    estimator = al_ssnn(nx=2, n_h=1, n_g=1, max_iter=3, random_state=0)
    path = gamma_path(estimator, *record, gammas=list(scores), scoring=scoring)
    assert path.score.tolist() == list(scores.values())
    assert path.to_frame()["score"].tolist() == list(scores.values())
    assert "score" in str(path) and "-0.009" in str(path)
    # accuracy as the same everywhere: the knee is where the score turns
    even = dataclasses.replace(path, rmse_test=np.array([1.0, 0.5, 0.4, 0.39]))
    assert even.knee() == 1  # an infinite one is not chosen
    path = gamma_path(estimator, *record, gammas=[1.0], scoring=neg_certified_distance)
    assert path.score[0] == neg_certified_distance(path.models[0], *record)
    with pytest.raises(TypeError, match="`scoring` must be a callable"):
        gamma_path(estimator, *record, scoring="certified")


@pytest.mark.parametrize("gammas", [[], [1.0, 0.0], [-1.0], 1.0])
def test_gammas_must_be_positive(record, gammas):
    with pytest.raises(ValueError, match="at least one positive weight"):
        gamma_path(al_ssnn(), *record, gammas=gammas)


def test_test_data_are_checked_before_the_fits(record):
    with pytest.raises(ValueError, match=r"`test` must be a tuple \(u, y\) or"):
        gamma_path(al_ssnn(max_iter=-1), *record, test=(record.u,))


# -- splitters and seams --------------------------------------------------------------


def test_shuffled_folds_score_an_exact_model_wrongly():
    """The manual says so, and names what to take."""
    u = np.random.default_rng(0).standard_normal((600, 1))
    y = lfilter([0.0, 0.1], [1.0, -0.9], u, axis=0)
    model = LinearStateSpace(nx=1)
    shuffled = KFold(3, shuffle=True, random_state=0)
    assert cross_val_score(model, u, y, cv=shuffled).max() < 0.4
    held = np.repeat(u[:12], 50, axis=0)  # what is shuffled looks much the same then
    late = lfilter([0.0, 0.5], [1.0, -0.5], held, axis=0)
    assert 0.6 < cross_val_score(model, held, late, cv=shuffled).mean() < 0.97
    assert cross_val_score(model, u, y, cv=BlockedTimeSeriesSplit(3)).min() > 0.95
    pages = Path(__file__).parents[1] / "doc"
    for page in ("scikit_learn.rst", "guide_identify.rst"):
        text = " ".join((pages / page).read_text(encoding="utf-8").split())
        assert "0.4 or less" not in text
        assert "huffled folds" in text and "Take ``BlockedTimeSeriesSplit``" in text


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_glued_blocks_are_the_two_experiments_that_they_are(record):
    # seen through a splitter and labels, or given as a list: the same fit
    u, y = record
    train, _ = list(BlockedTimeSeriesSplit(3, train="both").split(u))[1]
    model = al_ssnn(nx=3, n_h=2, n_g=2, max_iter=10, tol=1e-2, random_state=0)
    glued = clone(model).fit(u[train], y[train], seam_labels(len(u))[train])
    apart = clone(model).fit([u[:400], u[800:]], [y[:400], y[800:]])
    assert glued.experiments_ == [(0, 0), (0, 800)]
    assert glued.cost_ == apart.cost_
    np.testing.assert_array_equal(glued._theta, apart._theta)
    np.testing.assert_array_equal(glued.x0_, apart.x0_)
    blind = clone(model).fit(u[train], y[train])  # across the seam: another problem
    assert len(blind.x0_) == 1 and blind.cost_ != apart.cost_


def test_blocks_leave_the_gap_and_test_everything_once():
    for mode in ("longest", "past", "both"):
        split = BlockedTimeSeriesSplit(4, gap=3, train=mode)
        folds = list(split.split(np.zeros((101, 2))))
        assert len(folds) == split.get_n_splits() == 4
        tested = np.concatenate([test for _, test in folds])
        assert len(set(tested)) == len(tested)
        assert len(tested) == (81 if mode == "past" else 101)
        for train, test in folds:
            distance = np.abs(train[:, None] - test).min()
            assert distance == 4  # three samples between them
            jumps = np.sum(np.diff(train) != 1)
            assert jumps == 0 or mode == "both"
            if mode == "past":
                assert train.max() < test.min()
    _, middle = [train for train, _ in split.split(np.zeros((101, 2)))][:2]
    assert np.sum(np.diff(middle) != 1) == 1


def test_blocks_are_cut_in_every_experiment():
    labels = np.repeat(["a", "b"], [60, 30])
    folds = list(BlockedTimeSeriesSplit(3).split(np.zeros((90, 1)), experiment=labels))
    for train, test in folds:
        assert np.bincount(labels[test] == "b").tolist() == [20, 10]
        assert set(labels[train]) == {"a", "b"}
    by_groups = BlockedTimeSeriesSplit(3).split(np.zeros((90, 1)), groups=labels)
    for one, other in zip(folds, by_groups, strict=True):
        np.testing.assert_array_equal(one[0], other[0])


def test_experiments_stay_whole_and_folds_even(rng):
    lengths = [100, 80, 60, 50, 40, 30]
    labels = np.repeat(rng.permutation(6), lengths)
    numbered = seam_labels(360, labels)
    u = np.zeros((360, 1))
    for given in (labels, numbered):
        folds = list(ExperimentKFold(3).split(u, experiment=given))
        sizes = [len(test) for _, test in folds]
        assert sum(sizes) == 360 and max(sizes) - min(sizes) <= 30
        for train, test in folds:
            assert not set(labels[train]) & set(labels[test])
            assert np.all(np.diff(train) > 0)


def test_labels_of_any_kind_carry_sample_numbers():
    labels = seam_labels(6, ["a", "a", "a", "b", "b", "b"])
    kept = [0, 2, 3, 4]
    parts, names = split_experiments(4, labels[kept])
    assert names == [("a", 0), ("a", 2), ("b", 3)]
    assert [(p.start, p.stop) for p in parts] == [(0, 1), (1, 2), (2, 4)]
    # an experiment that returns is two runs here, and an error without numbers
    assert len(split_experiments(4, seam_labels(6, [0, 0, 1, 1, 0, 0])[1:5])[0]) == 3
    with pytest.raises(ValueError, match="contiguous samples"):
        split_experiments(4, [0, 0, 1, 0])
    with pytest.raises(ValueError, match="contiguous samples"):  # the same run twice
        split_experiments(4, seam_labels(4)[[0, 1, 0, 1]])
    for number in (np.nan, np.inf):
        with pytest.raises(ValueError, match="integer sample numbers"):
            split_experiments(2, np.array([[0.0, 1.0], [0.0, number]]))
    for label in (np.array([1.0, np.nan]), np.array(["a", np.nan], dtype=object)):
        with pytest.raises(
            ValueError, match="must not contain NaN, got it at sample 1"
        ):
            split_experiments(2, label)
    with pytest.raises(ValueError, match="integer sample numbers"):
        split_experiments(2, [["a", "b"], ["a", "c"]])
    with pytest.raises(ValueError, match="one label per sample"):
        seam_labels(3, [0, 0])


@pytest.mark.parametrize(
    "split, labels, message",
    [
        (BlockedTimeSeriesSplit(1), None, "at least 2"),
        (BlockedTimeSeriesSplit(3, gap=-1), None, "nonnegative integer"),
        (BlockedTimeSeriesSplit(3, gap=50), None, "leave samples in every fold"),
        (BlockedTimeSeriesSplit(3, train="left"), None, "`train` must be 'longest'"),
        (BlockedTimeSeriesSplit(3, train="both"), np.zeros(60), "must show seams"),
        (ExperimentKFold(3), None, "number of experiments"),
    ],
)
def test_a_wrong_split_is_an_error(split, labels, message):
    with pytest.raises(ValueError, match=message):
        list(split.split(np.zeros((60, 1)), experiment=labels))


def test_labels_have_one_name_at_a_time():
    with pytest.raises(ValueError, match="two names of the same labels"):
        next(ExperimentKFold().split(np.zeros((6, 1)), None, np.zeros(6), np.zeros(6)))


def test_measuring_in_parallel_changes_no_figure(path, record):
    estimator = al_ssnn(nx=2, n_h=1, n_g=1, max_iter=2, random_state=0)
    one, two = (
        gamma_path(estimator, *record, gammas=[1.0, 0.1], n_jobs=n_jobs)
        for n_jobs in (None, 2)
    )
    for name in ("rmse_train", "rmse_test", "linearization_error", "spectral_radius"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))

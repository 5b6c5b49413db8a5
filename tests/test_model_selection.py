import dataclasses

import numpy as np
import pytest

from alssnn import AlSsnn
from alssnn.datasets import make_wiener_hammerstein
from alssnn.model_selection import GammaPath, gamma_path


@pytest.fixture(scope="module")
def record():
    return make_wiener_hammerstein(1200, noise=0.01, random_state=0)


@pytest.fixture(scope="module")
def path(record):
    estimator = AlSsnn(nx=6, n_h=3, n_g=3, max_iter=30, random_state=0)
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
    estimator = AlSsnn(nx=2, n_h=1, n_g=1, max_iter=2, random_state=0)
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


@pytest.mark.parametrize("gammas", [[], [1.0, 0.0], [-1.0]])
def test_gammas_must_be_positive(record, gammas):
    with pytest.raises(ValueError, match="at least one positive weight"):
        gamma_path(AlSsnn(), *record, gammas=gammas)


def test_measuring_in_parallel_changes_no_figure(path, record):
    estimator = AlSsnn(nx=2, n_h=1, n_g=1, max_iter=2, random_state=0)
    one, two = (
        gamma_path(estimator, *record, gammas=[1.0, 0.1], n_jobs=n_jobs)
        for n_jobs in (None, 2)
    )
    for name in ("rmse_train", "rmse_test", "linearization_error", "spectral_radius"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))

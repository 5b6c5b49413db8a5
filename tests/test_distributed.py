"""Fits on a Dask cluster: two workers, each a process of its own."""

import os
import signal
import warnings
from itertools import chain

import joblib
import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit

from alssnn import FlSsnn, LinearStateSpace
from alssnn.criterion import Criterion
from alssnn.mapping import Held
from alssnn.models import state_space
from helpers import random_theta
from models import al_ssnn, fl_ssnn, gr_ssnn

dask = pytest.importorskip("distributed", reason='needs the extra "cluster"')
remote = pytest.importorskip("alssnn.distributed")

pytestmark = [
    pytest.mark.filterwarnings("ignore::DeprecationWarning:distributed"),
    # connections to a killed worker are closed by the garbage collector
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


@pytest.fixture(autouse=True)
def _short_fits():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        yield


@pytest.fixture(scope="module")
def client():
    with (
        dask.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            silence_logs=50,
        ) as cluster,
        dask.Client(cluster) as client,
    ):
        yield client


def record(seed, n):
    """Return an experiment of a plant with 2 inputs and 2 outputs."""
    rng = np.random.default_rng(seed)
    A, B = np.array([[0.7, 0.2], [-0.2, 0.6]]), np.array([[0.4, 0.1], [0.0, 0.5]])
    u, x, y = rng.standard_normal((n, 2)), rng.standard_normal(2), np.empty((n, 2))
    for k in range(n):
        y[k] = x
        x = A @ x + B @ (u[k] + 0.8 * np.tanh(x[::-1]))
    y += 0.02 * rng.standard_normal(y.shape)
    y[n // 2, 0] = np.nan
    return 3.0 * u + 10.0, 50.0 * y - 7.0


LENGTHS = (150, 100, 200, 120, 130)


@pytest.fixture(scope="module")
def experiments():
    return [record(seed, n) for seed, n in enumerate(LENGTHS)]


@pytest.fixture
def futures(client):
    # read where they are: what is made there can be made again
    addresses = sorted(client.scheduler_info()["workers"])
    return [
        client.submit(record, seed, n, workers=addresses[seed % 2], pure=False)
        for seed, n in enumerate(LENGTHS)
    ]


# -- experiments that stay on the workers ----------------------------------------------


def scaled(client, futures, experiments):
    """Return the same scaled experiments there and here."""
    model = LinearStateSpace(2, integrators=0, max_iter=1)
    us, ys = zip(*experiments, strict=True)
    model.fit(list(us), list(ys))
    there = remote.Remote(client, futures)
    here = [
        (model._scaling.scale_u(u), model._scaling.scale_y(y)) for u, y in experiments
    ]
    return there.scaled(model._scaling, np.zeros(2, dtype=int)), Held(here), model


def test_what_is_known_of_the_data_is_what_is_known_here(client, futures, experiments):
    there, here, model = scaled(client, futures, experiments)
    assert len(there.groups) == 2
    assert there.lengths == list(LENGTHS)
    assert there.n_measured == here.n_measured == 2 * sum(LENGTHS) - len(LENGTHS)
    count, low, high, mean, std = there.moments[1]
    y = np.vstack([y for _, y in experiments])
    np.testing.assert_array_equal(count, np.sum(~np.isnan(y), axis=0))
    np.testing.assert_array_equal([low, high], [np.nanmin(y, 0), np.nanmax(y, 0)])
    np.testing.assert_allclose(mean, model._scaling.y_offset)
    np.testing.assert_allclose(std, model._scaling.y_scale)
    for n in (10_000, 300):
        for a, b in zip(there.stretch(n), here.stretch(n), strict=True):
            np.testing.assert_array_equal(a[0], b[0])
            np.testing.assert_array_equal(a[1], b[1])


@pytest.mark.parametrize("fan_in", [8, 2])
def test_sums_are_those_of_one_process(client, futures, experiments, rng, fan_in):
    there, here, _ = scaled(client, futures, experiments)
    if fan_in == 2:
        there.groups = [[i] for i in (3, 1, 4, 0, 2)]  # as many workers
    remote_fan_in, remote.FAN_IN = remote.FAN_IN, fan_in
    structure = state_space(2, 2, 2, n_h=3, n_g=2, C=np.eye(2)).observe("y", "e")
    criteria = [
        Criterion(structure, e, weights={"y": 1.0, "e": 0.3}, alpha=1e-3)
        for e in (there, here)
    ]
    theta = random_theta(structure, rng)
    free = criteria[0].join(theta, rng.standard_normal((5, 2)))
    try:
        assert criteria[0].norm(free) == pytest.approx(
            criteria[1].norm(free), rel=1e-12
        )
        for a, b in zip(*(c.normal_equations(free) for c in criteria), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)
    finally:
        remote.FAN_IN = remote_fan_in


@pytest.mark.parametrize(
    ("coarse_samples", "initial_state"),
    [(300, "estimate"), pytest.param(None, "rest", marks=pytest.mark.slow)],
)
def test_a_search_looks_at_what_is_near(
    client, futures, experiments, coarse_samples, initial_state
):
    us, ys = map(list, zip(*experiments, strict=True))
    options = {"coarse_samples": coarse_samples, "initial_state": initial_state}
    options["integrators"] = 0
    model = FlSsnn(2, 3, max_iter=8, n_init=1, random_state=0, **options)
    here = clone(model).fit(us, ys)
    there = remote.fit(clone(model), futures, client=client)
    assert list(there.orders_["networks"]) == [2]
    assert np.isfinite(there.alpha_) == np.isfinite(here.alpha_)
    assert np.isfinite(there.cost_) and there.x0_.shape == (5, 2)
    assert there.score(us, ys) > here.score(us, ys) - 0.01
    assert np.isnan(there.train_score_)  # it would need a pass of its own


@pytest.mark.parametrize(
    "model",
    [
        fl_ssnn(2, 3, gamma_h=1e-3, max_iter=15, coarse_samples=300, random_state=0),
        al_ssnn(
            *(2, 2, 2),
            max_iter=6,
            coarse_samples=None,
            n_init=2,
            linear_part="trained",  # its loop is trained here alone
            random_state=0,
        ),
        LinearStateSpace(2, input_delay="auto"),
    ],
    ids=lambda model: type(model).__name__,
)
def test_a_fit_there_is_a_fit_here(client, futures, experiments, model):
    us, ys = map(list, zip(*experiments, strict=True))
    here = clone(model).fit(us, ys)
    there = remote.fit(clone(model), futures, client=client)
    # sums in another order: rounding grows along what the cost does not see
    assert there.cost_ == pytest.approx(here.cost_, rel=5e-3)
    assert there.x0_.shape == (5, 2)
    assert there.score(us, ys) == pytest.approx(here.score(us, ys), abs=1e-3)
    y_hat = there.predict(us, x0="training")
    assert all(p.shape == y.shape for p, y in zip(y_hat, ys, strict=True))
    np.testing.assert_allclose(there.u_offset_, here.u_offset_)
    assert there.linearizability(us, ys).outside == pytest.approx(
        here.linearizability(us, ys).outside, abs=0.02
    )


def test_no_data_leave_the_workers_in_an_iteration(client, monkeypatch):
    sizes = {}
    for n in (200, 2000):
        there = remote.Remote(
            client, [client.submit(record, i, n, pure=False) for i in range(4)]
        )
        structure = state_space(2, 2, 2, n_h=4, C=np.eye(2))
        criterion = Criterion(structure, there)
        original, sent = client.gather, []
        monkeypatch.setattr(
            client,
            "gather",
            lambda parts, original=original, sent=sent: (
                sent.append(original(parts)) or sent[-1]
            ),
        )
        theta = structure.join({"A": 0.5 * np.eye(2)})
        criterion.normal_equations(criterion.join(theta, np.zeros((4, 2))))
        monkeypatch.undo()
        (arrows,) = sent
        assert len(arrows) == len(there.groups)
        sizes[n] = sum(a.head.nbytes + a.head_r.nbytes for a in arrows)
        assert sizes[n] == len(arrows) * 8 * structure.n_params * (
            structure.n_params + 1
        )
    assert sizes[200] <= 2 * sizes[2000]  # by the number of workers, not of samples


def test_no_experiments_are_refused_before_anything_is_asked_of_a_cluster():
    with pytest.raises(ValueError, match="at least one future"):
        remote.fit(fl_ssnn(2), [], client=object())


def test_errors_name_what_is_wrong(client, futures):
    with pytest.raises(ValueError, match=r"same inputs and outputs, got.*\(1, 2\)"):
        odd = client.submit(lambda: (np.ones((9, 1)), np.ones((9, 2))))
        remote.fit(fl_ssnn(2), [*futures, odd], client=client)
    with pytest.raises(ValueError, match="finite inputs"):
        bad = client.submit(lambda: (np.full((9, 2), np.nan), np.ones((9, 2))))
        remote.fit(fl_ssnn(2), [*futures, bad], client=client)
    with pytest.raises(ValueError, match="`validation_fraction` must be None"):
        remote.fit(fl_ssnn(2, validation_fraction=0.1), futures, client=client)


# -- whole fits on the workers ---------------------------------------------------------


def test_restarts_on_a_cluster_are_those_of_one_process(client, experiments):
    us, ys = map(list, zip(*experiments, strict=True))
    model = al_ssnn(2, 2, 2, n_init=3, max_iter=4, random_state=0)
    here = clone(model).fit(us, ys)
    with joblib.parallel_config(backend="dask"):
        there = clone(model).fit(us, ys)
    assert there.cost_ == here.cost_
    assert len(there.history_) == len(here.history_)
    assert {"start 1/3", "start 3/3"} < {step.label for step in there.history_}


def search():
    model = fl_ssnn(2, 2, max_iter=6, random_state=0)
    return GridSearchCV(model, {"gamma_h": [0.0, 1e-3]}, cv=TimeSeriesSplit(2))


@pytest.mark.slow
def test_a_grid_search_does_not_depend_on_where_it_runs(client):
    u, y = record(0, 300)
    here = search().fit(u, y)
    pair = search().set_params(n_jobs=2).fit(u, y)
    with joblib.parallel_config(backend="dask"):
        there = search().fit(u, y)
    for other in (pair, there):
        np.testing.assert_array_equal(
            here.cv_results_["mean_test_score"], other.cv_results_["mean_test_score"]
        )


@pytest.mark.parametrize("alpha", ["auto", 1e-4])
def test_coarse_stages_are_the_same_wherever_the_data_lie(
    client, futures, experiments, alpha
):
    options = {"alpha": alpha, "max_iter": 8, "tol": 1e-4, "random_state": 0}
    options |= {"coarse_samples": 300, "polish_iter": 3, "n_init": 2}
    here = gr_ssnn(nx=2, n_f=3, **options).fit(
        *map(list, zip(*experiments, strict=True))
    )
    there = remote.fit(gr_ssnn(nx=2, n_f=3, **options), futures, client=client)
    assert here.alpha_ == there.alpha_
    assert there.cost_ == pytest.approx(here.cost_, rel=1e-5)
    assert [step.label for step in here.history_] == [s.label for s in there.history_]


# -- workers that are killed, and started again: the last of all -----------------------


@pytest.mark.slow
def test_a_search_survives_a_killed_worker(client, tmp_path):
    u, y = record(0, 300)
    expected = search().fit(u, y).cv_results_["mean_test_score"]
    flag = tmp_path / "killed"

    class Suicidal(FlSsnn):
        def fit(self, u, y, experiment=None, *, validation=None):
            try:
                os.close(os.open(flag, os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                return super().fit(u, y, experiment, validation=validation)
            os.kill(os.getpid(), signal.SIGKILL)

    folds = list(TimeSeriesSplit(2).split(u))
    estimator = Suicidal(**search().estimator.get_params())
    suicidal = search().set_params(estimator=estimator, cv=folds)
    client.wait_for_workers(2)
    # copies on every worker, and kept: what only one has is lost with it
    client.amm.stop()
    with joblib.parallel_config(backend="dask", scatter=[u, y, *chain(*folds)]):
        suicidal.set_params(refit=False).fit(u, y)
    assert flag.exists()
    np.testing.assert_array_equal(suicidal.cv_results_["mean_test_score"], expected)


@pytest.mark.slow
def test_a_fit_survives_a_killed_worker(client, experiments):
    us, ys = map(list, zip(*experiments, strict=True))
    model = fl_ssnn(2, 3, gamma_h=1e-3, max_iter=10, coarse_samples=300, random_state=0)
    expected = clone(model).fit(us, ys)
    client.wait_for_workers(2)
    futures = [client.submit(record, i, n) for i, n in enumerate(LENGTHS)]
    there = remote.Remote(client, futures)
    pid = next(iter(client.run(os.getpid).values()))
    calls, original = [], Criterion.normal_equations

    def deadly(self, free):
        calls.append(self.experiments.is_here)
        if calls.count(False) == 2 and not calls[-1]:
            os.kill(pid, signal.SIGKILL)
        return original(self, free)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Criterion, "normal_equations", deadly)
        fitted = model.fit_remote(there)
    assert calls.count(False) > 2
    assert fitted.cost_ == pytest.approx(expected.cost_, rel=5e-3)

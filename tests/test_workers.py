"""Processes that die while they work for a fit."""

import os
import warnings

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn
from alssnn.model_selection import _gamma_path, gamma_path
from alssnn.workers import finished
from deaths import dies


def test_what_was_finished_is_not_done_again(tmp_path):
    calls = [(i, os.getpid(), tmp_path / "flag") for i in range(4)]
    with pytest.warns(UserWarning, match=r"A worker process died.*\d of 4") as record:
        values = dict(finished(dies, calls, 2))
    assert values == {i: i for i in range(4)}
    (warning,) = record
    assert warning.filename == __file__


class Deadly:
    """Kill the first worker that is told to report."""

    def __init__(self, flag):
        self.flag, self.home = flag, os.getpid()

    def __call__(self, *_):
        if os.getpid() != self.home:
            try:
                os.close(os.open(self.flag, os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                return
            os._exit(1)


def record():
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=(100, 1)), np.zeros(100)
    for k in range(99):
        y[k + 1] = 0.8 * y[k] + 0.2 * (u[k, 0] + np.tanh(y[k]))
    return u, y


@pytest.mark.parametrize("alpha", [0.0, pytest.param("auto", marks=pytest.mark.slow)])
def test_a_fit_survives_a_dead_process(tmp_path, monkeypatch, alpha):
    """Once in its starts, once in its search: the model is that of no accident."""
    u, y = record()
    sizes = {"nx": 1, "n_h": 1, "n_g": 1, "n_init": 2, "integrators": 0}
    options = {**sizes, "alpha": alpha, "max_iter": 4, "random_state": 0}
    model = AlSsnn(**options)
    flag = tmp_path / "flag"
    where = "training" if alpha == 0.0 else "paths"
    module = __import__(f"alssnn.{where}", fromlist=["_descend"])
    monkeypatch.setattr(module, "_descend", Once(Deadly(flag), module._descend))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        expected = AlSsnn(**options).fit(u, y)
        with pytest.warns(UserWarning, match="A worker process died"):
            model.set_params(n_jobs=2).fit(u, y)
    assert flag.exists()
    assert model.cost_ == expected.cost_
    for name, value in expected.params_.items():
        np.testing.assert_array_equal(model.params_[name], value)


class Once:
    """Call one function after another."""

    def __init__(self, before, function):
        self.before, self.function = before, function

    def __call__(self, *args):
        self.before()
        return self.function(*args)


@pytest.mark.slow
def test_a_path_of_gammas_survives_a_dead_process(tmp_path, monkeypatch):
    u, y = record()
    monkeypatch.setattr(
        _gamma_path, "_measure", Once(Deadly(tmp_path / "flag"), _gamma_path._measure)
    )
    model = AlSsnn(nx=1, n_h=1, n_g=1, alpha=0.0, n_init=1, max_iter=3, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        with pytest.warns(UserWarning, match="A worker process died"):
            path = gamma_path(model, u, y, gammas=(1.0, 0.1), n_jobs=2)
    assert (tmp_path / "flag").exists()
    assert np.isfinite(path.rmse_test).all()

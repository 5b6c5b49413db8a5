"""Whether AlSsnn keeps g, or holds it at zero because h alone does nearly as well."""

import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.base import clone

import alssnn
from alssnn.datasets import make_pendulum
from alssnn.estimators import _residual, _ssnn
from alssnn.estimators._residual import is_enough
from alssnn.model_selection import gamma_path
from alssnn.watch import Watch


def outcome(errors, helps=True, gain=0.96):
    """Return what is asked of the outcome of a search, which took three states."""
    told = {"errors": np.array(errors), "helps": helps, "gain": gain, "curve": {}}
    return SimpleNamespace(structure=SimpleNamespace(sizes={"x": 3}), **told)


@pytest.mark.parametrize(
    ("errors", "is_predictor", "enough"),
    [
        ([1.0, 3.0], False, True),
        ([2.0, 2.0], False, True),  # folds may differ, their sum counts
        ([1.0, 3.4], False, True),  # 1.0488 times the root mean square
        ([1.0, 3.42], False, False),
        ([1.0, 3.04], True, True),  # by chance
        ([1.0, 3.05], True, False),
    ],
)
def test_h_alone_is_enough_if_its_hidden_error_is_hardly_larger(
    errors, is_predictor, enough
):
    found = outcome([1.0, 3.0], gain=0.99)
    alone = outcome(errors, gain=0.99)
    assert is_enough(alone, found, is_predictor) == enough


@pytest.mark.parametrize(
    ("with_g", "alone", "enough"), [(False, True, True), (True, False, False)]
)
def test_what_does_not_help_is_not_taken(with_g, alone, enough):
    """However small its error is: a fold, or an output, may be worse."""
    errors = [1.0] if with_g else [0.5]
    found, other = outcome([1.0], helps=with_g), outcome(errors, helps=alone)
    assert is_enough(other, found, False) == enough


def told(monkeypatch, outcomes, watch, *, ends_at=None):
    """Let searches have these outcomes; return the sizes of g that they had.

    Where g helps, h alone is searched for with as many states.
    """
    sizes = []

    def search(self, own, experiments, linear, seeds, watch, nx=None):
        assert nx == (3 if sizes and outcomes[0].helps else None)
        sizes.append(own.n_g)
        if len(sizes) == ends_at:
            watch.stop("ended")
        return outcomes[len(sizes) - 1]

    monkeypatch.setattr(alssnn.AlSsnn, "_search", search)
    return sizes


@pytest.mark.parametrize(
    ("helps", "ends_at", "chosen"),
    [
        (True, None, "alone"),
        (True, 1, "with g"),
        (True, 2, "with g"),  # one that was ended may be better than it looks
        (False, None, "alone"),
        (False, 2, "alone"),
    ],
)
def test_a_search_that_is_ended_does_not_change_what_was_found(
    monkeypatch, helps, ends_at, chosen
):
    watch, model = Watch(), alssnn.AlSsnn(n_g=2)
    found, alone = outcome([1.0], helps=helps), outcome([0.5])
    found.curve, alone.curve = {1: 1.0}, {2: 0.5}
    sizes = told(monkeypatch, [found, alone], watch, ends_at=ends_at)
    own, taken = model._found(None, None, None, watch)
    assert sizes == ([2] if ends_at == 1 else [2, 0])
    assert taken is (alone if chosen == "alone" else found)
    assert own.n_g == (0 if chosen == "alone" else 2)
    # of the orders that were compared
    assert model._curve == (found if helps else taken).curve


@pytest.mark.parametrize(("helps", "alone"), [(True, ([3], 0)), (False, None)])
def test_h_alone_takes_the_order_of_the_networks_with_g(monkeypatch, helps, alone):
    """If these help: what it explains, they explain with as many states."""
    record, asked = make_pendulum(300, random_state=0), []

    def search(recipe, orders, candidates, seeds, *, largest, **options):
        asked.append((list(candidates), largest))
        if len(asked) == 2:
            raise RuntimeError("asked twice")
        return outcome([1.0], helps=helps)

    monkeypatch.setattr(_ssnn, "search", search)
    with pytest.raises(RuntimeError, match="asked twice"):
        alssnn.AlSsnn(nx="auto").fit(record.u, record.y)
    (first, largest), second = asked
    assert len(first) > 1 and largest > first[-1]
    assert second == (alone or (first, largest))


@pytest.mark.parametrize(
    "options", [{"n_k": 2}, {"feedthrough": True}, {"time": "continuous"}]
)
@pytest.mark.parametrize("helps", [True, False])
def test_h_alone_is_worth_a_search_if_its_law_leaves_nothing(
    monkeypatch, options, helps
):
    sizes = told(monkeypatch, [outcome([1.0], helps=helps), outcome([0.5])], Watch())
    alssnn.AlSsnn(n_g=2, **options)._found(None, None, None, Watch())
    assert len(sizes) == (1 if helps else 2)


def test_late_inputs_leave_no_law_that_is_exact(monkeypatch):
    sizes = told(monkeypatch, [outcome([1.0]), outcome([0.5])], Watch())
    model = alssnn.AlSsnn(n_g=2)
    model.input_delay_ = np.array([1])
    model._found(None, None, None, Watch())
    assert len(sizes) == 1


@pytest.mark.parametrize(("over", "searches"), [(0.3, 2), (0.4, 1)])
def test_time_is_left_for_the_training(monkeypatch, over, searches):
    watch = Watch(max_time=1000.0)
    watch.start -= 1000.0 * over
    sizes = told(monkeypatch, [outcome([1.0]), outcome([0.5])], watch)
    alssnn.AlSsnn(n_g=2)._found(None, None, None, watch)
    assert len(sizes) == searches


def test_an_interrupted_second_search_loses_nothing(monkeypatch):
    watch, model, found = Watch(), alssnn.AlSsnn(n_g=2), outcome([1.0])
    told(monkeypatch, [found, None], watch, ends_at=2)
    assert model._found(None, None, None, watch) == (model, found)


@pytest.mark.parametrize("options", [{"n_g": 0}, {"n_h": 0}, {"input_map": "monotone"}])
def test_without_a_choice_one_search_is_enough(monkeypatch, options):
    watch, found = Watch(), outcome([1.0])
    sizes = told(monkeypatch, [found], watch)
    alssnn.AlSsnn(**options)._found(None, None, None, watch)
    assert len(sizes) == 1


@pytest.fixture(scope="module")
def swinging():
    return make_pendulum(500, amplitude=4.0, noise=0.01, random_state=0)


@pytest.fixture(scope="module")
def small(swinging):
    sizes = {"nx": 2, "n_h": 4, "n_g": 2, "n_init": 1}
    return alssnn.AlSsnn(**sizes, dt=swinging.dt, random_state=0)


@pytest.fixture(scope="module")
def held(swinging, small):
    """Return a model without g, and what would be held if h had ended at zero."""
    seen = {}

    def without_h(model, own, found, *args):
        p = found.structure.split(found.theta)
        theta = found.structure.join({**p, "W_h": 0.0 * p["W_h"]})
        other = replace(found, theta=theta)
        seen["names"] = set(_residual.completed(model, own, other, *args)[3])
        return _residual.completed(model, own, found, *args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("alssnn.estimators._ssnn.completed", without_h)
        return clone(small).fit(swinging.u, swinging.y), seen["names"]


def test_a_plant_of_matched_nonlinearity_needs_no_g(swinging, held):
    """The torque of a pendulum is all of h: its law is exact on the model."""
    model = copy.deepcopy(held[0])
    assert not np.any(model.params_["W_g"]) and np.any(model.params_["W_h"])
    assert model.message_.endswith(_residual.H_ALONE)
    assert model.linearizability(swinging.u, swinging.y).linearization_error == 0
    assert set(model.orders_["networks"]) == {2}
    model.set_params(warm_start=True, tol=1e-2).fit(swinging.u, swinging.y)
    assert not np.any(model.params_["W_g"])
    assert _residual.H_ALONE not in model.message_  # it did not ask again


def test_g_is_held_where_h_alone_has_ended_at_zero(held):
    """Then k or an integrator is what helps, and g would come back by itself."""
    assert held[1] == {"W_g", "W_u", "W_x", "b_x"}  # all of g


def test_a_fit_that_needs_g_says_nothing_of_it(monkeypatch, swinging, small):
    monkeypatch.setattr("alssnn.estimators._ssnn.is_enough", lambda *_: False)
    model = clone(small).set_params(n_h=2, n_g=1)
    model.fit(swinging.u[:300], swinging.y[:300])
    assert np.any(model.params_["W_g"])
    assert _residual.H_ALONE not in model.message_


def test_a_path_asks_again_whether_g_is_needed(monkeypatch, swinging, small):
    """A large gamma may leave h alone, a smaller one need g."""
    asked = []
    small = clone(small).set_params(n_h=2, max_iter=60)

    def enough(alone, found, is_predictor):
        asked.append(True)
        return len(asked) == 1

    monkeypatch.setattr("alssnn.estimators._ssnn.is_enough", enough)
    path = gamma_path(small, swinging.u, swinging.y, gammas=[10.0, 0.1, 0.01])
    has_g = [bool(np.any(model.params_["W_g"])) for model in path.models]
    assert has_g == [False, True, True]
    assert len(asked) == 2  # the third goes on from the second
    assert [m.max_iter for m in path.models] == [60, 60, 30]

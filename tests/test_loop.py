"""Where g is not zero, the loop of the law is trained beside the record (eq. kept)."""

import control
import numpy as np
import pytest
from scipy.signal import lfilter
from sklearn.base import clone

from alssnn import AlSsnn
from alssnn.criterion import Criterion
from alssnn.estimators import _loop
from alssnn.feedback import balanced_weights, closed_loop, designed_loop, lqi
from alssnn.forms import closed
from alssnn.looped import looped
from alssnn.models import state_space
from alssnn.simulation import channels, outputs, simulate
from helpers import complex_step
from models import al_ssnn

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
STRUCTURES = {
    "h(x)": {"feedback": "state"},
    "h(y)": {"feedback": "output"},
    "two layers": {"feedback": "state", "n_h": (4, 3), "n_g": (3, 2)},
    "disturbance": {"feedback": "state", "disturbances": (1,)},
    "h(y), disturbance": {"disturbances": (0, 2)},
}
OPTIONS = {
    "nx": 3,
    "n_h": 6,
    "n_g": 6,
    "alpha": 1e-8,
    "n_init": 1,
    "max_iter": 300,
    "operating_point": ([0.0], [0.0]),
    "random_state": 0,
}
SEEDS = range(10)


@pytest.fixture(params=STRUCTURES)
def structure(request):
    """A model with three inputs and two outputs."""
    rng = np.random.default_rng(0)
    C = rng.standard_normal((2, 4))
    return state_space(
        4, 3, 2, C=C, **{"n_h": 4, "n_g": 3, **STRUCTURES[request.param]}
    )


@pytest.fixture
def theta(structure):
    """Random parameters of a stable model."""
    theta = 0.3 * np.random.default_rng(1).standard_normal(structure.n_params)
    A = 0.5 * structure.split(theta)["A"]
    return structure.join({**structure.split(theta), "A": A})


def saturated(seed=3, N=1_000):
    """Return a record of a filter that saturates, whose laws go far if they may."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3, 3, N // 10), 10)
    y = np.tanh(lfilter([0, 0.1], [1, -1.5, 0.6], u))
    return u[:, None], y + 0.005 * rng.standard_normal(N)


@pytest.fixture(scope="module")
def record():
    """A record of a filter that saturates."""
    return saturated()


@pytest.fixture(scope="module")
def pair(record):
    """The same fit, as the training has left it and with its loop trained."""
    return straying(record)


@pytest.fixture
def unfitted(pair):
    """That fit, not yet fitted."""
    return clone(pair[1])


def straying(record, error=0.25, **options):
    """Return a fit whose loop strays, and the same fit, whose loop is brought back.

    Which loop one seed leaves hangs on the rounding of the machine, and about one loop
    in five is not brought back. Of five that stray, one has to be.
    """
    n_strayed = 0
    for seed in SEEDS:
        how = {**OPTIONS, "random_state": seed, **options}
        trained = AlSsnn(linear_part="trained", **how).fit(*record)
        found = trained.linearizability(*record)
        if found.closed_linearization_error.max() < 0.5 or found.closed_outside < 0.3:
            continue
        n_strayed += 1
        kept = clone(trained).set_params(linear_part="best").fit(*record)
        assert (_loop.KEPT in kept.message_) != (_loop.LEFT in kept.message_)
        found = kept.linearizability(*record)
        is_near = found.closed_linearization_error.max() < error
        if is_near and found.closed_outside < 0.1:
            return trained, kept
        if n_strayed == 5:
            break
    raise AssertionError(f"{n_strayed} loops have strayed, and none has come back")


def in_loop(model, record):
    """Return the linearization error in the loop, and its share outside the data."""
    found = model.linearizability(*record)
    return found.closed_linearization_error[0], found.closed_outside


# -- the second run --------------------------------------------------------------------


def test_the_second_run_is_the_loop(structure, theta):
    u = np.random.default_rng(2).standard_normal((50, 3))
    both = looped(structure).observe("y", "y'", "u'")
    Z = outputs(both.lure(theta), u, np.zeros(both.nx))
    moved = np.setdiff1d(np.arange(3), structure.given)
    loop = closed(structure.observe("y", "v").lure(theta), moved)
    expected = outputs(loop, u, np.zeros(loop.nx))
    assert np.abs(expected).max() < 100 and np.ptp(Z[:, 2:]) > 1
    np.testing.assert_allclose(Z[:, 2:], expected, rtol=1e-10, atol=1e-12)
    plain = structure.observe("y")
    alone = outputs(plain.lure(theta), u, np.zeros(plain.nx))
    np.testing.assert_allclose(Z[:, :2], alone, rtol=1e-12)
    assert np.abs(Z[:, :2] - Z[:, 2:4]).max() > 1e-3  # another run


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_what_g_adds_in_the_loop_is_its_distance_from_the_design(
    structure, theta, share
):
    u = np.random.default_rng(2).standard_normal((50, 3))
    both = looped(structure, share).observe("y", "y'", "e'")
    _, Y, E = np.split(outputs(both.lure(theta), u, np.zeros(both.nx)), 3, axis=1)
    p = structure.split(theta)
    moved = np.setdiff1d(np.arange(3), structure.given)
    x, design = np.zeros(4), np.empty((50, 2))
    for k in range(50):
        design[k] = structure.constants["C"] @ x
        x = p["A"] @ x + p["B"] @ u[k, moved]
        if len(structure.given):
            x = x + p["G"] @ u[k, structure.given]
    np.testing.assert_allclose(Y - share * E, design, rtol=1e-9, atol=1e-12)
    assert np.abs(E).max() > 1e-2


def test_both_runs_have_the_derivatives_of_their_cost(structure, theta):
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((30, 3)), rng.standard_normal((30, 2))
    weights = {"y": [1.0, 0.5], "e": 0.1, "e'": 0.2, "h": 0.3, "h'": 0.4}
    both = looped(structure).observe(*weights)
    criterion = Criterion(both, [(u, y)], weights=weights)
    free = criterion.join(theta, 0.1 * np.ones((1, 4)))
    _, Jr, norm = criterion.normal_equations(free)

    def half_square(z):
        theta, x0 = criterion.split(z)
        lure = both.lure(theta)
        X = simulate(lure, u, both.initial_state(x0[0]))[:-1]
        Z = channels(lure, X, u)
        Z = np.hstack([Z[:, :2] - y, Z[:, 2:]])
        square = np.concatenate([np.broadcast_to(weights[c], n) for c, n in sizes])
        return np.atleast_1d(0.5 * np.sum(square * Z**2) / len(u))

    sizes = [(c, both.sizes[c]) for c in weights]
    np.testing.assert_allclose(norm**2 / 2, half_square(free)[0], rtol=1e-12)
    np.testing.assert_allclose(Jr, complex_step(half_square, free)[0], rtol=1e-8)


# -- what a fit makes of it ------------------------------------------------------------


def test_the_loop_stays_near_the_data(pair, record):
    trained, kept = pair
    assert _loop.KEPT in kept.message_ and _loop.KEPT not in trained.message_
    assert in_loop(kept, record)[0] < in_loop(trained, record)[0] / 2
    fresh = saturated(seed=5)
    before, after = in_loop(trained, fresh), in_loop(kept, fresh)
    assert after[0] < 0.3 and after[1] < 0.15 and after[1] < before[1] / 2


def test_the_true_loop_is_as_designed(pair, record):
    A, B = np.array([[1.5, -0.6], [1.0, 0.0]]), np.array([1.0, 0.0])
    plant = control.nlsys(
        lambda t, x, u, p: A @ x + B * u[0],
        lambda t, x, u, p: np.tanh([0.1 * x[0]]),
        inputs=1,
        outputs=1,
        states=2,
        dt=1,
    )
    u, y = record
    levels = np.random.default_rng(0).uniform(-1, 1, 10)
    r = y.mean() + y.std() * np.repeat([0.0, *levels], 40)[None]
    distances = []
    for model in pair:
        K, t = lqi(model, *balanced_weights(model)), np.arange(r.shape[1])
        at = model.y_offset_[:, None]
        design = control.forced_response(designed_loop(model, K), t, r - at)
        law = model.linearizing_law(u_min=u.min(axis=0), u_max=u.max(axis=0))
        loop = closed_loop(plant, model, K, law=law)
        true = control.input_output_response(loop, t, r, 0, squeeze=False)
        missed = np.asarray(true.outputs[0] - design.outputs[0]) - at[0]
        distances.append(np.sqrt(np.mean(missed[40:] ** 2)) / y.std())
    assert distances[1] < 0.06
    assert distances[1] < distances[0] / 4


def test_the_simulation_is_nearly_the_same(pair, record):
    for u, y in (record, saturated(seed=5)):
        before, after = (np.mean((y - model.predict(u))[50:] ** 2) for model in pair)
        assert before < 1e-3 * y.var()
        assert after < 2 * before


def test_costs_and_steps_are_those_of_the_outcome(pair):
    trained, kept = pair
    assert kept.n_iter_ == trained.n_iter_
    # the same cost, of which h and g are no longer the optimum
    assert trained.cost_ < kept.cost_ < 3 * trained.cost_
    assert len(kept.history_) == len(trained.history_)


def test_the_training_of_the_loop_shows_its_progress(record, capsys):
    model = AlSsnn(**{**OPTIONS, "max_iter": 80}, verbose=1).fit(*record)
    lines = [x for x in capsys.readouterr().out.splitlines() if "loop, gamma_h" in x]
    most = len(_loop.GAMMAS) * (len(_loop.SHARES) + len(_loop.BACK))
    assert 2 <= len(lines) <= most
    assert not any("loop" in step.label for step in model.history_)  # another cost


@pytest.mark.parametrize("options", [{"penalty": "state"}, {"gamma_h": 1e-8}], ids=str)
def test_other_costs_have_their_loop_too(options, record):
    trained, kept = straying(record, **options)
    assert _loop.KEPT in kept.message_
    assert in_loop(kept, record)[0] < in_loop(trained, record)[0] / 2


def test_another_fit_goes_on_from_there(pair, record):
    _, kept = pair
    again = clone(kept).set_params(warm_start=True)
    again.fit(*record)
    cost = again.cost_
    again.set_params(max_iter=3).fit(*record)
    assert in_loop(again, record)[1] < 0.1
    assert again.cost_ < 1.5 * cost


@pytest.mark.parametrize(
    "options",
    [
        {"gamma": 0.0},
        {"n_k": 2},
        {"feedthrough": True},
        {"input_map": "monotone"},
        {"input_delay": 1},
        {"n_g": 0},
        {"noise": "innovations"},
        {"initial_state": "periodic"},
    ],
    ids=str,
)
def test_nothing_is_done_where_there_is_no_such_loop(options, record, monkeypatch):
    def never(*args):
        raise AssertionError("trained")

    monkeypatch.setattr(_loop, "_Loop", never)
    common = {**OPTIONS, "max_iter": 5, "n_h": 3, "n_g": 2}
    model = al_ssnn(**{**common, "linear_part": "best", **options}).fit(*record)
    assert _loop.KEPT not in model.message_


def test_a_model_with_such_a_loop_is_asked(record, monkeypatch):
    asked = []
    monkeypatch.setattr(_loop._Loop, "strays", lambda *args: asked.append(args) or 0.0)
    common = {**OPTIONS, "max_iter": 5, "n_h": 3, "n_g": 2}
    model = AlSsnn(**common).fit(*record)
    assert len(asked) == 1
    assert _loop.KEPT not in model.message_ and _loop.LEFT not in model.message_
    other = AlSsnn(**common, linear_part="trained").fit(*record)
    np.testing.assert_array_equal(model.A_, other.A_)


@pytest.mark.parametrize("name", ["LESS", "RISE"])
def test_what_is_no_better_is_not_taken(name, pair, unfitted, record, monkeypatch):
    # of every outcome, something is asked that it cannot give
    monkeypatch.setattr(_loop, name, -1.0)
    model = unfitted.fit(*record)
    assert _loop.KEPT not in model.message_ and _loop.LEFT in model.message_
    for key, value in pair[0].params_.items():
        np.testing.assert_array_equal(model.params_[key], value)
    assert model.cost_ == pair[0].cost_ and model.n_iter_ == pair[0].n_iter_


def test_a_place_to_which_other_inputs_lead_is_refused(unfitted, record, monkeypatch):
    calls = []

    def leads(*args):
        calls.append(args)
        return len(calls) % 2 == 1  # every outcome, and not what was there before

    monkeypatch.setattr(_loop.Excursion, "leads", leads)
    model = unfitted.fit(*record)
    assert len(calls) >= 2 and _loop.KEPT not in model.message_


def test_an_end_of_the_time_leaves_a_model(unfitted, record, monkeypatch):
    descend = _loop._Loop._descend

    def slow(self, *args):
        self.how["watch"].stop("time is over")
        return descend(self, *args)

    monkeypatch.setattr(_loop._Loop, "_descend", slow)
    model = unfitted.fit(*record)
    assert np.isfinite(model.score(*record))


def test_other_data_that_judge_a_fit_have_the_last_word(unfitted, record):
    model = unfitted.fit(*record, validation=saturated(seed=5))
    assert _loop.KEPT not in model.message_


def test_a_loop_that_diverges_is_left(unfitted, record, monkeypatch):
    tried = []

    def diverging(structure, share=1.0):
        tried.append(share)
        return looped(structure, 1e9 if len(tried) > 1 else share)  # g is bounded

    monkeypatch.setattr(_loop, "looped", diverging)
    monkeypatch.setattr(_loop, "DIVERGED_NORM", 1e3)
    model = unfitted.fit(*record)
    assert len(tried) > 2 and _loop.KEPT not in model.message_


@pytest.mark.parametrize("where", ["strays", "_descend"])
def test_an_interrupt_leaves_the_model_of_the_training(
    where, pair, unfitted, record, monkeypatch
):
    def interrupt(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr(_loop._Loop, where, interrupt)
    model = unfitted
    with pytest.raises(KeyboardInterrupt):
        model.fit(*record)
    np.testing.assert_array_equal(model.A_, pair[0].A_)


def test_long_records_are_trained_on_a_stretch_and_then_on_all():
    record = saturated(N=1_500)
    trained, kept = straying(record, coarse_samples=900, polish_iter=60)
    assert _loop.KEPT in kept.message_
    assert kept.score(*record) > 1 - 2 * (1 - trained.score(*record))


def test_several_experiments_of_several_inputs_are_the_same_path():
    rng = np.random.default_rng(7)
    u, y = [], []
    for seed in (2, 3):
        one, saturates = saturated(seed, N=500)
        other = np.repeat(rng.uniform(-1, 1, 50), 10)
        linear = lfilter([0, 0.3], [1, -0.7], other) + 0.5 * saturates
        u.append(np.column_stack([one, other]))
        y.append(np.column_stack([saturates, linear]))
    u, y = np.vstack(u), np.vstack(y) + 0.005 * rng.standard_normal((1_000, 2))
    y[[10, 700], [0, 1]] = np.nan
    record = u, y, np.arange(1_000) >= 500
    options = {"nx": 4, "n_h": 8, "n_g": 8, "max_iter": 200, "operating_point": "mean"}
    trained, kept = straying(record, **options)
    before, after = (model.linearizability(*record) for model in (trained, kept))
    assert _loop.KEPT in kept.message_
    assert np.all(after.closed_linearization_error < before.closed_linearization_error)


def test_what_begins_at_rest_still_does(record):
    u, y = record
    u, y = np.vstack([np.zeros((20, 1)), u]), np.concatenate([np.zeros(20), y])
    _, kept = straying((u, y), initial_state="rest")
    assert _loop.KEPT in kept.message_
    np.testing.assert_array_equal(kept.x0_, np.zeros((1, 3)))

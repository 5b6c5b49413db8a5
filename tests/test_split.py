"""What is linear goes from h to A: the same model, with the smallest law."""

import pickle

import numpy as np
import pytest

import alssnn
from alssnn import AlSsnn, FlSsnn, LinearStateSpace
from alssnn.datasets import make_duffing, make_pendulum
from alssnn.estimators import _split
from alssnn.mapping import Held
from alssnn.split import as_trained, is_split, moved, with_linear
from models import al_ssnn, fl_ssnn

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
OPTIONS = {"n_h": 4, "max_iter": 30, "random_state": 0}
KINDS = {
    "h(x)": {"feedback": "state"},
    "h(y)": {"feedback": "output"},
    "innovations": {"feedback": "state", "noise": "innovations"},
    "innovations, h(y)": {"noise": "innovations", "h_sees": "predicted"},
    "contraction": {"feedback": "state", "stability": "auto"},
    "two layers, odd": {"feedback": "state", "n_h": (4, 3), "odd": True},
    "k": {"feedback": "state", "n_k": 3},
    "disturbance": {"feedback": "state", "disturbances": [2]},
}


def record(nu, ny):
    """Return two experiments of a plant whose inputs meet a curve of its state."""
    rng = np.random.default_rng(0)
    A = np.array([[0.7, 0.2, 0.0], [-0.2, 0.6, 0.1], [0.0, -0.1, 0.5]])
    B, C = rng.standard_normal((3, nu)), rng.standard_normal((ny, 3))
    u, x, y = rng.standard_normal((400, nu)), np.zeros(3), np.empty((400, ny))
    for k in range(400):
        y[k] = C @ x
        x = A @ x + B @ (u[k] + 0.5 * np.tanh(x[0]))
    y += 0.01 * rng.standard_normal(y.shape)
    units = np.array([3.0, 0.02, 1.0])[:nu], np.array([100.0, 0.1])[:ny]
    return (u + 10) * units[0], (y - 2) * units[1], np.arange(400) >= 150


@pytest.fixture(scope="module")
def data():
    """Two experiments of a plant of three inputs and two outputs, some lost."""
    u, y, experiment = record(3, 2)
    y = y.copy()
    y[[5, 40, 200], [0, 1, 1]] = np.nan
    return u, y, experiment


@pytest.fixture(scope="module", params=KINDS)
def pair(request, data):
    """The same fit, as the training has left it and with the best linear part."""
    made, options = (al_ssnn if "n_k" in KINDS[request.param] else fl_ssnn), {}
    if made is al_ssnn:
        options["n_g"] = 0
    return [
        made(
            nx=3, linear_part=part, **{**OPTIONS, **options, **KINDS[request.param]}
        ).fit(*data)
        for part in ("trained", "best")
    ]


def along(model, u):
    """Return states of an experiment, and what the law cancels there."""
    plant, x, X = model.plant_, np.zeros(model.nx_), []
    for one in u:
        X.append(x)
        x = plant.step(x, one)
    X = np.array(X)
    return X, plant.virtual(X, u) - np.delete(u, plant.given, axis=1)


def test_the_model_is_the_same(pair, data):
    u, y, experiment = data
    trained, best = pair
    assert "L" in best.params_ and "L" not in trained.params_
    scale = np.nanstd(y, axis=0)
    first = experiment == experiment[0]
    x0 = 0.1 * np.ones(best.nx_)
    one, other = (m.predict(u[first], x0=x0) / scale for m in pair)
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert best.cost_ == trained.cost_ and best.score(*data) == pytest.approx(
        trained.score(*data), abs=1e-9
    )
    ahead = [m.predict_ahead(u[first], y[first], steps=2) for m in pair]
    np.testing.assert_allclose(*(z / scale for z in ahead), atol=1e-9)
    np.testing.assert_array_equal(best.B_, trained.B_)
    np.testing.assert_array_equal(best.C_, trained.C_)
    S = np.eye(best.nx_) if best.plant_.feedback == "state" else best.C_
    expected = trained.A_ + best.B_ @ best.params_["L"] @ S  # (eq. split)
    np.testing.assert_allclose(best.A_, expected, atol=1e-12)


@pytest.mark.parametrize("feedback", ["state", "output"])
def test_the_law_can_be_rebuilt_from_the_parameters(feedback):
    """As the page on conventions says, L s included."""
    pendulum = make_pendulum(600, noise=0.01, random_state=0)
    options = {"nx": 2, "n_h": 4, "alpha": 1e-6, "n_init": 1, "max_iter": 60}
    model = FlSsnn(feedback=feedback, dt=pendulum.dt, random_state=0, **options)
    p = model.fit(pendulum.u, pendulum.y).params_
    letter, at = ("s", 0.0) if feedback == "state" else ("y", model.y_offset_)
    s = np.linspace(-0.3, 0.4, 10).reshape(-1, 2 if feedback == "state" else 1)
    neurons = np.tanh(s @ p[f"W_{letter}"].T + p[f"b_{letter}"])
    h = neurons @ p["W_h"].T + p["b_h"] - s @ p["L"].T
    np.testing.assert_allclose(model.plant_.cancelled(s + at), h, rtol=1e-9)
    assert np.abs(p["L"]).max() > 0.01


def test_nothing_linear_is_left_to_h(data):
    """Along the training, from the initial states that it found."""
    u, _, experiment = data
    model = fl_ssnn(nx=3, feedback="state", **OPTIONS).fit(*data)
    S, H = [], []
    for label, x0 in zip(dict.fromkeys(experiment), model.x0_, strict=True):
        part, x = u[experiment == label], x0
        for one in part:
            S.append(x)
            x = model.plant_.step(x, one)
        H.append(model.plant_.virtual(np.array(S[-len(part) :]), part) - part)
    S, H = np.array(S), np.vstack(H)
    S, H = S - S.mean(axis=0), H - H.mean(axis=0)
    slopes = np.linalg.lstsq(S, H, rcond=None)[0]
    assert np.abs(S @ slopes).max() < 1e-6 * np.abs(H).max()


def test_the_law_is_smaller_and_leaves_the_linear_part(pair, data):
    u, _, experiment = data
    best = pair[1]
    first = experiment == experiment[0]
    sizes = [along(m, u[first])[1].std(axis=0) for m in pair]
    assert np.all(sizes[1] <= 1.02 * sizes[0]) and np.any(sizes[1] < 0.98 * sizes[0])
    A, B, *_ = best.plant_.linear()
    np.testing.assert_allclose(A, best.A_, atol=1e-14)
    np.testing.assert_array_equal(B, best.B_)
    np.testing.assert_allclose(best.to_statespace().A, best.A_, atol=1e-14)
    rng = np.random.default_rng(0)
    X, v = rng.standard_normal((20, best.nx_)), u[:20, : B.shape[1]]
    d = u[:20, B.shape[1] :] if len(best.plant_.given) else None
    s = X if best.plant_.feedback == "state" else best.plant_.output(X)
    sent = best.linearizing_law()(v, s, d)
    whole = sent if d is None else np.hstack([sent, d])
    expected = X @ A.T + (v - best.plant_.v_offset) @ B.T
    if d is not None:
        expected += (d - best.plant_.d_offset) @ best.G_.T
    np.testing.assert_allclose(best.plant_.step(X, whole), expected, atol=1e-9)


def test_default_laws_of_known_plants_are_small():
    """Linear parts aside, the law has what the plant is nonlinear by."""
    for make, least in ((make_pendulum, 0.2), (make_duffing, 0.2)):
        known = make(1_000, noise=0.01, random_state=1)
        fresh = make(2_000, noise=0.01, random_state=2)
        options = {"nx": 2, "n_h": 6, "n_init": 1, "integrators": 0, "dt": known.dt}
        sizes, outside = [], []
        for part in ("trained", "best"):
            model = FlSsnn(linear_part=part, random_state=0, **options)
            report = model.fit(known.u, known.y).linearizability(fresh.u, fresh.y)
            sizes.append(report.law_size)
            outside.append(report.closed_outside)
            assert model.plant_.linear()[0].shape == (2, 2)
        assert sizes[1] < least * sizes[0]
        assert outside[1] < 0.01 < outside[0]


def test_what_is_not_free_is_left():
    u, y, experiment = record(1, 1)
    common = {"nx": 2, "n_h": 2, "max_iter": 5, "random_state": 0}
    linear = LinearStateSpace(nx=2, integrators=0).fit(u, y, experiment)
    own = {"linear_start": linear.to_statespace()}
    wide = np.full((2, 2), 2.0)
    kept = {
        "integrators": {"integrators": 1, "feedback": "state"},
        "A": {"bounds": {"A": (-wide, wide)}, **own},
        "D": {"feedthrough": True, "feedback": "state"},
        "k": {"n_k": 2, "feedback": "output"},
        "map": {"input_map": "monotone"},
        "rate": {"stability": "contractive"},
        "asked": {"linear_part": "trained"},
        "walk": {"noise": "innovations", "drift": "input", "feedback": "state"},
        "y_m": {"noise": "innovations", "h_sees": "measured", "feedback": "output"},
        "time": {"time": "continuous", "dt": 1},
        "g": {"n_g": 2},
        "late": {"input_delay": 2},
    }
    for name, options in kept.items():
        made = al_ssnn if {"n_k", "feedthrough", "n_g"} & set(options) else fl_ssnn
        if made is al_ssnn:
            options = {"n_g": 0, **options}
        model = made(**common, **options).fit(u, y, experiment)
        assert "L" not in model.params_, name
    for options in ({}, own):
        assert "L" in fl_ssnn(**common, **options).fit(u, y, experiment).params_
    with pytest.raises(ValueError, match="linear_part"):
        fl_ssnn(**common, linear_part="least").fit(u, y, experiment)


def test_what_h_must_not_see_is_not_seen_by_its_linear_part():
    u, y, experiment = record(2, 2)
    model = fl_ssnn(nx=3, h_inputs=[1], **OPTIONS).fit(u, y, experiment)
    assert not np.any(model.params_["L"][:, 0]) and np.all(model.params_["L"][:, 1])


def test_a_linear_part_that_would_be_unstable_is_moved_in_part(monkeypatch):
    u, y, experiment = record(1, 1)
    model = fl_ssnn(nx=2, feedback="state", **OPTIONS)
    whole = model.fit(u, y, experiment).params_["L"]
    found = _split._linear_part

    def larger(*known):
        return 1.5 * factor * found(*known)

    for factor in (2.0**i for i in range(12)):
        monkeypatch.setattr(_split, "_linear_part", larger)
        again = fl_ssnn(nx=2, feedback="state", **OPTIONS).fit(u, y, experiment)
        assert np.abs(np.linalg.eigvals(again.A_)).max() < 1
        if "L" not in again.params_:
            break
        share = np.linalg.norm(again.params_["L"]) / np.linalg.norm(whole)
        if share < 0.99 * 1.5 * factor:
            assert share / (1.5 * factor) == pytest.approx(
                round(10 * share / (1.5 * factor)) / 10
            )
            return
    raise AssertionError("no factor made the linear part unstable")


def test_sensors_that_tell_nothing_are_not_measured_by_the_law():
    """Neither one that stands still, nor the noise by which two of them differ."""
    known = make_pendulum(600, noise=0.01, random_state=0)
    rng = np.random.default_rng(0)
    options = {**OPTIONS, "feedback": "output"}
    still = np.column_stack([known.y, np.full(600, 3.0)])
    with pytest.warns(UserWarning, match="does not move"):
        model = fl_ssnn(nx=2, **options).fit(known.u, still)
    assert np.abs(model.params_["L"][:, 1]).max(initial=0.0) < 1e-6
    noisy = known.y + 0.1 * known.y.std() * rng.standard_normal((600, 2))
    laws = []
    for part in ("trained", "best"):
        model = fl_ssnn(nx=4, linear_part=part, **{**options, "max_iter": 60})
        law = model.fit(known.u, noisy).linearizing_law()
        laws.append(np.std(law(np.zeros_like(known.u), noisy)))
    assert "L" in model.params_
    assert laws[1] <= 1.01 * laws[0]


def test_a_linear_part_is_no_slower_than_the_record_can_tell():
    known = make_pendulum(600, noise=0.01, random_state=0)
    for seed in range(3):
        options = {**OPTIONS, "random_state": seed, "feedback": "state"}
        model = fl_ssnn(nx=4, stability="auto", **options).fit(known.u, known.y)
        before = as_trained(model._structure, model._theta)
        radii = [
            np.abs(np.linalg.eigvals(one.split(theta)["A"])).max()
            for one, theta in (before, (model._structure, model._theta))
        ]
        assert radii[1] <= max(radii[0], 1 - 5 / 600)


def test_a_constant_is_no_signal(monkeypatch):
    """Its variance is rounding, of either sign."""
    u, y, experiment = record(2, 2)
    model = fl_ssnn(nx=3, linear_part="trained", **OPTIONS).fit(u, y, experiment)

    class Constant:
        def __init__(self, *known):
            self.ns, self.nv, self.of_x, self.seen = 2, 1, True, np.ones(2, bool)

        def __call__(self, x0, u, y):
            z = np.random.default_rng(len(u)).standard_normal((len(u), 3))
            z[:, 1] = 1 / 3
            return len(z), z.sum(axis=0), z.T @ z, 0, 0.0

    monkeypatch.setattr(_split, "_Moments", Constant)
    for n in range(100, 140):
        held = Held([(np.zeros((n, 1)), np.zeros((n, 1)))])
        L = _split._linear_part(model._structure, model._theta, [np.zeros(3)], held)
        assert np.isfinite(L).all() and L[0, 1] == 0


def test_there_and_back_again():
    u, y, experiment = record(2, 2)
    model = fl_ssnn(nx=3, **OPTIONS).fit(u, y, experiment)
    structure, theta = model._structure, model._theta
    before, start = as_trained(structure, theta)
    assert is_split(structure) and not is_split(before)
    assert as_trained(before, start) == (before, start)
    L = structure.constants["L"]
    again = with_linear(before, L)
    np.testing.assert_allclose(moved(before, start, L), theta, atol=1e-14)
    one, other = (s.lure(theta).Theta for s in (structure, again))
    np.testing.assert_array_equal(one, other)


def test_files_copies_and_warm_starts(tmp_path):
    u, y, experiment = record(2, 2)
    model = fl_ssnn(nx=3, stability="auto", **OPTIONS).fit(u, y, experiment)
    model.save(tmp_path / "model.npz")
    for again in (
        alssnn.load(tmp_path / "model.npz"),
        pickle.loads(pickle.dumps(model)),
    ):
        np.testing.assert_array_equal(again.A_, model.A_)
        np.testing.assert_array_equal(again.params_["L"], model.params_["L"])
        np.testing.assert_array_equal(again.predict(u), model.predict(u))
        cost = again.cost_
        again.set_params(warm_start=True, max_iter=5).fit(u, y, experiment)
        assert again.cost_ <= cost * (1 + 1e-6) and "L" in again.params_
        # and it is a contraction, in the basis of the training, that goes on
        structure, theta = as_trained(again._structure, again._theta)
        assert np.linalg.norm(structure.split(theta)["A"], 2) < 1


def test_models_that_might_as_well_be_are_drawn_around_it():
    u, y, experiment = record(1, 1)
    model = fl_ssnn(nx=2, stability="auto", feedback="state", **OPTIONS)
    model.fit(u, y, experiment)
    covariance = model.parameter_covariance(u, y, experiment)
    drawn = model.sample_models(
        covariance, 2, random_state=0, data=(u, y, experiment), max_iter=3
    )
    for one in drawn:  # each with a linear part of its own
        assert not np.array_equal(one.params_["L"], model.params_["L"])
        assert one.score(u, y, experiment=experiment) > 0.9 * model.score(
            u, y, experiment=experiment
        )


def test_al_ssnn_whose_g_is_held_at_zero_is_split():
    known = make_pendulum(1_000, noise=0.01, random_state=0)
    options = {"nx": 2, "n_h": 6, "n_g": 2, "n_init": 1, "integrators": 0}
    model = AlSsnn(random_state=0, dt=known.dt, **options)
    model.fit(known.u, known.y)
    assert not np.any(model.params_["W_g"])  # else it is another test
    assert np.any(model.params_["L"])

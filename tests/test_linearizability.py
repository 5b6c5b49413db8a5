import builtins
import pickle
import warnings
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from sklearn.exceptions import ConvergenceWarning
from structures import declare

from alssnn import LinearStateSpace
from alssnn.datasets import make_pendulum
from alssnn.linearizability import (
    OUTSIDE,
    Bands,
    Linearizability,
    Region,
    measure,
    output_residual,
)
from alssnn.linearizability._measure import h2_gain, peak_gain
from alssnn.lure import Lure
from alssnn.models import state_space
from helpers import (
    as_records,
    plant_of,
    plant_of_structure,
    random_theta,
    simulate_linear,
)
from models import fl_ssnn

DT = 0.01


def make_model(rng, *, n_h=3, n_g=4, radius=0.7, **options):
    """Return a random model, its records and its equations by name."""
    structure = state_space(
        3, 2, 2, n_h=n_h, n_g=n_g, C=rng.standard_normal((2, 3)), **options
    )
    theta = random_theta(structure, rng, radius=radius)
    p = {**structure.split(theta), **structure.constants}
    K, k = np.zeros((2, structure.nw)), np.zeros(2)
    if n_h:
        K[:, :n_h], k = p["W_h"], p["b_h"]
    experiments = [
        (rng.standard_normal((n, 2)), rng.standard_normal((n, 2)), x0)
        for n, x0 in ((60, np.zeros(3)), (83, rng.standard_normal(3)))
    ]
    plant = plant_of(structure.lure(theta), K, k, dt=DT)
    own = plant_of_structure(structure, theta, np.random.default_rng(0))
    return SimpleNamespace(p=p, plant=plant, experiments=experiments, own=own)


@pytest.fixture
def model(rng):
    return make_model(rng)


def measured(model, experiments=None, **fields):
    """Return the measures of a model, of which fields are replaced."""
    plant = replace(model.plant, **fields)
    return measure(plant, as_records(experiments or model.experiments))


def replay(p, u, x0, *, closed):
    """Run the equations of the model and its linear part, sample by sample."""
    run = SimpleNamespace(x=[], u=[], y=[], linear=[], h=[], g=[], e=[], y_linear=[])
    x, x_linear = x0, x0
    for v in u:
        s = x if "W_s" in p else p["C"] @ x
        h = np.zeros(2)
        if "W_h" in p:
            inner = p["W_s"] @ s + p["b_s"] if "W_s" in p else p["W_y"] @ s + p["b_y"]
            h = p["W_h"] @ np.tanh(inner) + p["b_h"]
        u_k = v - h if closed else v
        g = np.zeros(3)
        if "W_g" in p:
            b_g = p.get("b_g", -p["W_g"] @ np.tanh(p["b_x"]))
            g = p["W_g"] @ np.tanh(p["W_x"] @ x + p["W_u"] @ u_k + p["b_x"]) + b_g
        run.x.append(x)
        run.u.append(u_k)
        run.y.append(p["C"] @ x)
        run.h.append(h)
        run.g.append(g)
        run.linear.append(p["A"] @ x + p["B"] @ v)
        run.y_linear.append(p["C"] @ x_linear)
        run.e.append(p["C"] @ (x - x_linear))
        x = p["A"] @ x + p["B"] @ (u_k + h) + g
        x_linear = p["A"] @ x_linear + p["B"] @ (u_k + h)
    return {name: np.array(value) for name, value in vars(run).items()}


def replay_all(model, *, closed):
    runs = [replay(model.p, u, x0, closed=closed) for u, _, x0 in model.experiments]
    return {name: np.vstack([run[name] for run in runs]) for name in runs[0]}


def sizes(z):
    return np.linalg.norm(z, axis=1)


def rms(z):
    return np.sqrt(np.mean(z**2, axis=0))


# Definitions

VARIANTS = {
    "al": {},
    "state feedback": {"feedback": "state"},
    "gr": {"n_h": 0, "tied_bias": False},
    "fl": {"n_g": 0},
    "linear": {"n_h": 0, "n_g": 0},
}


@pytest.mark.parametrize("options", VARIANTS.values(), ids=VARIANTS)
def test_measures_against_a_plain_loop(rng, options):
    model = make_model(rng, **options)
    record = measured(model)
    run, y = (
        replay_all(model, closed=False),
        np.vstack([y for _, y, _ in model.experiments]),
    )
    np.testing.assert_allclose(record.e, run["e"], atol=1e-13)
    np.testing.assert_allclose(
        record.linearization_error, rms(run["e"]) / y.std(axis=0), atol=1e-13
    )
    for name in "gh":
        ratio = sizes(run[name]) / sizes(run["linear"])
        assert getattr(record, f"ratio_{name}_mean") == pytest.approx(ratio.mean())
        assert getattr(record, f"ratio_{name}_max") == pytest.approx(ratio.max())
    loop = replay_all(model, closed=True)
    np.testing.assert_allclose(
        record.closed_linearization_error,
        rms(loop["e"]) / loop["y_linear"].std(axis=0),
        atol=1e-13,
    )
    np.testing.assert_allclose(
        record.closed_output_size, loop["y_linear"].std(axis=0) / y.std(axis=0)
    )
    u = np.vstack([u for u, _, _ in model.experiments])
    for size, one in ((record.law_size, run), (record.closed_law_size, loop)):
        expected = (one["h"].std(axis=0) / u.std(axis=0)).max()
        assert size == pytest.approx(expected, abs=1e-13)
    linear, omega = sizes(loop["linear"]), sizes(loop["g"])
    assert record.closed_linear_mean == pytest.approx(linear.mean())
    assert record.closed_linear_max == pytest.approx(linear.max())
    assert record.closed_omega_mean == pytest.approx(omega.mean(), abs=1e-14)
    assert record.closed_omega_max == pytest.approx(omega.max(), abs=1e-14)
    assert record.closed_ratio_mean == pytest.approx((omega / linear).mean(), abs=1e-13)
    assert record.closed_ratio_max == pytest.approx((omega / linear).max(), abs=1e-13)
    assert record.spectral_radius == pytest.approx(0.7)


def test_what_a_nonlinear_output_adds_is_an_error(rng):
    structure = state_space(
        3, 2, 2, n_g=3, n_k=2, feedthrough=True, C=rng.standard_normal((2, 3))
    )
    plant = plant_of_structure(structure, random_theta(structure, rng), rng)
    plant = replace(plant, u_offset=np.zeros(2), y_offset=np.zeros(2))
    A, B, C, D = plant.linear()
    u, e, x = rng.standard_normal((50, 2)), [], np.zeros(3)
    x_linear = x
    for u_k in u:
        e.append(plant.output(x, u_k) - C @ x_linear - D @ u_k)
        x, x_linear = plant.step(x, u_k), A @ x_linear + B @ u_k
    record = measure(plant, as_records([(u, u, np.zeros(3))]))
    np.testing.assert_allclose(record.e, e, atol=1e-12)
    assert np.all(rms(record.e) > 0.1)


def now(p, x, u):
    """Return h and g of one sample, which does not depend on the past."""
    run = replay(p, u[None], x, closed=False)
    return {"h": run["h"][0], "g": run["g"][0]}


@pytest.mark.parametrize("name", ["monotone", "monotone-state"])
def test_a_loop_that_is_solved_for_u_is_driven_by_v_as_it_was(rng, name):
    """The recorded u is moved and stretched to the mean and size of v = phi(u, s)."""
    structure = declare(name, rng)
    plant = plant_of_structure(structure, random_theta(structure, rng, 0.7), rng)
    plant = replace(plant, u_offset=0 * plant.u_offset, y_offset=0 * plant.y_offset)
    u = 0.3 + rng.standard_normal((200, plant.nu))
    if plant.nu > 1:
        u[:, -1] = 0.25  # one that rests
    parts = [(u[:80], np.zeros(plant.nx)), (u[80:], rng.standard_normal(plant.nx))]
    A, B, _, _ = plant.linear()

    def loop(drive, law):
        X, V = [], []
        for (u_i, x), v_i in zip(parts, drive, strict=True):
            for u_k, v_k in zip(u_i, v_i, strict=True):
                s = x if plant.feedback == "state" else plant.output(x)
                u_k = plant.law(v_k, s) if law else u_k
                X.append(x)
                V.append(u_k + plant.cancelled(s, u_k))
                x = plant.step(x, u_k)
        return np.array(X), np.array(V)

    _, v = loop([u[:80], u[80:]], law=False)
    gain = np.where(u.std(axis=0) > 1e-9, v.std(axis=0) / (u.std(axis=0) + 1e-99), 1.0)
    made = v.mean(axis=0) + gain * (u - u.mean(axis=0))
    X, V = loop([made[:80], made[80:]], law=True)
    np.testing.assert_allclose(V, made, atol=1e-9)
    records = [(u_i, np.zeros((len(u_i), plant.ny)), x) for u_i, x in parts]
    record = measure(plant, as_records(records))
    linear = sizes(X @ A.T + V @ B.T)
    assert record.closed_linear_mean == pytest.approx(linear.mean())
    assert record.closed_linear_max == pytest.approx(linear.max())
    assert record.law_size != pytest.approx(record.closed_law_size)


@pytest.mark.parametrize(("size", "varies"), [(0.8e-12, False), (1.5e-12, True)])
@pytest.mark.parametrize("offset", [0.0, 20.0, -20.0])
def test_what_counts_as_constant(rng, size, varies, offset):
    """A standard deviation of 1e-12 of the mean, or of the operating point."""
    u = np.tile([[1.0], [-1.0]], (50, 1))
    lure = Lure(np.array([[0.5, 1.0, 0.0], [1.0, 0.0, 0.0]]), 1, 1, 0)
    dy = 20 * size * u + (20.0 if offset == 0 else 0.0)
    plant = plant_of(lure, y_offset=np.array([offset]))
    record = measure(plant, as_records([(u, dy, np.zeros(1))]))
    assert np.sum(record.bands.output**2) == pytest.approx(float(varies), abs=1e-3)


def test_output_residual_is_the_response_to_g(model, rng):
    p, g = model.p, rng.standard_normal((40, 3))
    expected = simulate_linear(p["A"], np.eye(3), p["C"], g)
    np.testing.assert_allclose(output_residual(p["A"], p["C"], g), expected, atol=1e-13)


def test_without_h_the_closed_loop_is_the_open_one(rng):
    record = measured(make_model(rng, n_h=0))
    assert record.closed_ratio_mean == record.ratio_g_mean
    assert record.closed_ratio_max == record.ratio_g_max
    assert record.ratio_h_max == 0


def test_without_g_nothing_is_left(rng):
    record = measured(make_model(rng, n_g=0))
    np.testing.assert_allclose(record.linearization_error, 0, atol=1e-13)
    np.testing.assert_allclose(record.closed_linearization_error, 0, atol=1e-13)


def test_silence_has_no_error():
    lure = Lure(np.array([[0.5, 1.0, 0.0], [1.0, 0.0, 0.0]]), 1, 1, 0)
    zero = np.zeros((9, 1))
    record = measure(plant_of(lure), as_records([(zero, zero, np.zeros(1))]))
    assert record.linearization_error == record.closed_linearization_error == 0
    assert record.ratio_g_max == record.closed_ratio_mean == 0
    np.testing.assert_array_equal(record.bands.output, 0)


def test_the_operating_point_does_not_flatter(rng):
    """An output of 100 +- 4 is as nonlinear about zero as about its mean."""
    u = np.repeat(rng.uniform(-2, 2, (300, 1)), 5, axis=0)
    y = 100.0 + 4 * u / u.std()
    Theta = np.array([[0.5, 1.0, 0.3, 0.0], [1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    lure = Lure(Theta, 1, 1, 1)
    about_zero, about_mean = (
        measure(plant_of(lure), as_records([(u, z, np.zeros(1))]))
        for z in (y, y - y.mean())
    )
    assert about_zero.linearization_error == about_mean.linearization_error
    np.testing.assert_allclose(
        about_zero.linearization_error, rms(about_zero.e) / y.std(axis=0)
    )


def test_an_output_that_is_constant_has_no_error_of_rounding(rng):
    u = rng.standard_normal((300, 1))
    lure = Lure(np.array([[0.5, 1.0, 0.0], [0.0, 0.0, 0.0]]), 1, 1, 0)
    y = np.full((300, 1), 20.1)
    record = measure(plant_of(lure), as_records([(u, y, np.zeros(1))]))
    assert record.linearization_error == 0 and np.all(record.bands.output == 0)


def test_a_law_larger_than_the_record_is_said(rng):
    # x+ = 0.9 x + u + h, h = -10 tanh(w), w = tanh(x): the plant is 0.9 x + u - 10 w
    Theta = np.array([[0.5, 1.0, -4.0, 0.0], [1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    u = rng.standard_normal((500, 1))
    record = measure(
        plant_of(Lure(Theta, 1, 1, 1), K=-4.0), as_records([(u, u, np.zeros(1))])
    )
    assert record.law_size > 3 and record.large_law
    assert "times the recorded input. Errors of the model" in str(record)
    record = measure(
        plant_of(Lure(Theta, 1, 1, 1), K=-1e-3), as_records([(u, u, np.zeros(1))])
    )
    assert record.law_size < 1 and "times the recorded" not in str(record)


# Frequency bands


def test_bands_add_up_to_the_whole(model):
    record = measured(model)
    bands = record.bands
    np.testing.assert_allclose(
        np.sum(bands.error**2, axis=0), record.linearization_error**2, rtol=1e-12
    )
    np.testing.assert_allclose(np.sum(bands.output**2, axis=0), 1, rtol=1e-12)
    expected = np.array([0, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1]) / (2 * DT)
    np.testing.assert_allclose(bands.edges, expected)


def test_bands_against_projections_on_sinusoids(model):
    record = measured(model)
    every = np.vstack([y for _, y, _ in model.experiments])
    total = len(every) * every.var(axis=0)
    squares, start = np.zeros((6, 2)), 0
    for u, _, _ in model.experiments:
        n = len(u)
        e, start = record.e[start : start + n], start + n
        for k in range(n):  # two-sided discrete Fourier transform
            frequency = min(k, n - k) / (n * DT)
            band = min(np.sum(frequency >= record.bands.edges[1:]), 5)
            wave = np.exp(-2j * np.pi * k * np.arange(n) / n)
            squares[band] += np.abs(wave @ e) ** 2 / n
    np.testing.assert_allclose(record.bands.error, np.sqrt(squares / total), rtol=1e-9)


@pytest.mark.parametrize(("cycles", "band"), [(0, 0), (1, 1), (5, 3), (31, 5), (32, 5)])
def test_a_tone_is_in_its_band(model, cycles, band):
    y = np.cos(2 * np.pi * cycles * np.arange(64) / 64)[:, None] * [1.0, 3.0]
    record = measured(model, [(np.zeros((64, 2)), y, np.zeros(3))])
    expected = np.zeros((6, 2))
    expected[band] = cycles > 0  # a constant does not vary
    np.testing.assert_allclose(record.bands.output, expected, atol=1e-12)


# State basis


def transform(model, T):
    """Return the same model with the state T x."""
    lure, nx = model.plant.form, model.plant.nx
    Theta = lure.Theta.copy()
    Theta[:nx] = T @ Theta[:nx]
    Theta[:, :nx] = Theta[:, :nx] @ np.linalg.inv(T)
    form = Lure(Theta, nx, lure.nu, lure.nw)
    return SimpleNamespace(
        plant=replace(model.plant, form=form),
        experiments=[(u, y, T @ x0) for u, y, x0 in model.experiments],
    )


def region_of(model):
    """Return the region of the linear response to the first experiment."""
    A, B, C, _ = model.plant.linear()
    u, _, x0 = model.experiments[0]
    X = np.zeros((len(u), len(A)))
    X[0] = x0
    for k in range(len(u) - 1):
        X[k + 1] = A @ X[k] + B @ u[k]
    return Region.of(X, u, X @ C.T)


def test_what_depends_on_the_state_basis_and_what_does_not(model, rng):
    T = rng.standard_normal((3, 3))
    other = transform(model, T)
    here, there = (measured(m, region=region_of(m)) for m in (model, other))
    for name in ("linearization_error", "closed_linearization_error", "e"):
        np.testing.assert_allclose(
            getattr(there, name), getattr(here, name), rtol=1e-8, atol=1e-11
        )
    np.testing.assert_allclose(there.bands.error, here.bands.error, rtol=1e-8)
    np.testing.assert_array_equal(there.bands.output, here.bands.output)
    assert there.spectral_radius == pytest.approx(here.spectral_radius, rel=1e-8)
    assert there.outside == here.outside > 0
    assert there.closed_outside == here.closed_outside > 0
    for name in (
        "ratio_g_mean",
        "ratio_h_mean",
        "closed_ratio_mean",
        "closed_omega_max",
        "peak_gain",
        "h2_gain",
    ):
        assert np.all(abs(getattr(there, name) / getattr(here, name) - 1) > 0.01), name


def test_the_gain_grows_as_the_basis_shrinks_g(model):
    here, there = measured(model), measured(transform(model, 1e-3 * np.eye(3)))
    assert there.closed_omega_mean == pytest.approx(1e-3 * here.closed_omega_mean)
    np.testing.assert_allclose(there.h2_gain, 1e3 * here.h2_gain)


# What the basis hides


def test_h2_gain_is_the_energy_of_the_impulse_responses(model):
    A, _, C, _ = model.plant.linear()
    energy, power = np.zeros(2), np.eye(3)
    for _ in range(300):
        energy += np.sum((C @ power) ** 2, axis=1)
        power = A @ power
    np.testing.assert_allclose(h2_gain(A, C), np.sqrt(energy), rtol=1e-10)


@pytest.mark.parametrize("radius", [0.5, 0.99, 0.9999])
def test_peak_gain_is_the_largest_power(rng, radius):
    A = np.triu(rng.standard_normal((4, 4)), 1) + np.diag([radius, 0.3, -0.8, radius])
    norms = [1.0]
    power = np.eye(4)
    for _ in range(20_000):
        power = power @ A
        norms.append(np.linalg.norm(power, ord=2))
    assert peak_gain(A) == pytest.approx(max(norms), rel=1e-9)
    assert max(norms) > 1.5


def test_a_contraction_has_no_peak(rng):
    Q, _ = np.linalg.qr(rng.standard_normal((5, 5)))
    assert peak_gain(0.999 * Q) == peak_gain(np.zeros((5, 5))) == 1.0


def test_a_search_without_end_is_given_up():
    A = (1 - 1e-12) * np.array([[1.0, 1.0], [0.0, 1.0]])
    assert peak_gain(A) == pytest.approx(400 * 256, rel=1e-3)  # powers that are seen


def test_gain_of_a_numerically_singular_equation_is_infinite():
    A = np.array([[0.99, 1e9], [0.0, 0.98]])
    assert np.isinf(h2_gain(A, np.eye(2))).all()


# Divergence


def longer(experiments, n=40):
    return [(np.tile(u, (n, 1)), np.tile(y, (n, 1)), x) for u, y, x in experiments]


def numbers(record):
    frame = record.to_frame()
    return dict(zip(frame["quantity"], frame["value"], strict=True))


def test_a_diverging_model_is_infinitely_nonlinear(rng):
    model = make_model(rng, radius=1.3)
    record = measured(model, longer(model.experiments))
    values = numbers(record)
    assert not np.isnan([v for k, v in values.items() if "outside" not in k]).any()
    assert np.isposinf(record.linearization_error).all()
    assert np.isposinf(record.closed_linearization_error).all()
    assert np.isposinf(record.bands.error).all()
    assert np.isfinite(record.bands.output).all()
    assert np.isposinf(record.h2_gain).all()
    for name in (
        "ratio_g_mean",
        "ratio_h_max",
        "closed_linear_max",
        "closed_omega_mean",
    ):
        assert values[name] == np.inf
    assert values["closed_ratio_mean"] == values["peak_gain"] == np.inf
    assert np.isposinf(record.e[-1]).all()
    assert "inf" in str(record)


@pytest.mark.parametrize("n_h", [0, 3])
def test_where_there_is_no_g_nothing_is_left_of_what_diverges(rng, n_h):
    model = make_model(rng, radius=1.3, n_g=0, n_h=n_h)
    record = measured(model, longer(model.experiments))
    values = numbers(record)
    assert values["closed_linear_max"] == np.inf  # it diverges
    assert not record.linearization_error.any() and not record.e.any()
    assert not record.closed_linearization_error.any()
    for name in ("ratio_g", "closed_ratio", "closed_omega"):
        assert values[f"{name}_mean"] == values[f"{name}_max"] == 0
    assert "H2 gain" not in str(record)
    assert "times the recorded input" not in str(record)  # h only diverges
    if not n_h:
        assert record.law_size == record.closed_law_size == values["ratio_h_max"] == 0


def test_a_bounded_model_with_unstable_A_has_infinite_errors(rng):
    # h = -0.5 x / B, nearly, keeps x+ = 1.2 x + (u + h) bounded
    Theta = np.array(
        [[1.2, 1.0, -5.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.1, 0.0, 0.0, 0.0]]
    )
    lure = Lure(Theta, 1, 1, 1)
    u = 0.1 * rng.standard_normal((3000, 1))
    records = as_records([(u, u, np.zeros(1))])
    region = Region.of(10 * rng.permuted(u), u, 10 * u)
    record = measure(plant_of(lure, K=-5.0, region=region), records)
    assert np.isfinite(record.ratio_h_mean) and record.outside < 0.01
    assert record.closed_linear_mean == np.inf
    assert not record.closed_linearization_error.any()  # h is all that it has
    assert record.closed_outside > 0.9
    # the same with g instead of h: a bounded residual with an unbounded effect
    record = measure(plant_of(lure), records)
    assert np.isfinite(record.ratio_g_mean)
    assert np.isposinf(record.linearization_error).all()
    assert np.isposinf(record.bands.error).all()
    assert np.isposinf(record.closed_linearization_error).all()


# Plants without a law


@pytest.mark.parametrize("why", ["feedthrough", "delay"])
def test_where_there_is_no_law_there_is_no_closed_loop(model, why):
    region = region_of(model)
    fields = {"delay": np.array([0, 3])}
    if why == "feedthrough":
        Theta = model.plant.form.Theta.copy()
        Theta[3:5, 3:5] = np.eye(2)
        fields = {"form": Lure(Theta, 3, 2, model.plant.form.nw)}
    record = measured(model, region=region, **fields)
    reason = {"feedthrough": "algebraic loop", "delay": "3 samples ahead"}[why]
    assert reason in record.no_law
    table = str(record)
    assert "There is no closed loop to measure." in table and "nan" not in table
    assert reason in " ".join(table.split())
    assert max(map(len, table.splitlines())) <= 79
    closed = {k: v for k, v in numbers(record).items() if k.startswith("closed_")}
    assert len(closed) == 10 and np.isnan(list(closed.values())).all()
    # the open loop is what it is
    assert record.outside is not None and np.isfinite(record.linearization_error).all()


# Region


def test_region_contains_its_samples_and_no_others(rng):
    X = rng.standard_normal((500, 3)) @ rng.standard_normal((3, 3)) + [5.0, 0.0, -1.0]
    u, y = rng.uniform(-1, 1, (500, 2)), X[:, :1]
    region = pickle.loads(pickle.dumps(Region.of(X, u, y)))
    assert not region.outside(X, u, y).any()
    width = region.high[1] - region.low[1]
    far_enough = region.high[1] + 0.1 * width
    assert not region.outside(X, u + np.array([0, 0.09 * width]), y).any()
    beyond = u[:, 1] + 0.5 > far_enough
    assert beyond.any()
    assert np.all(region.outside(X, u + np.array([0, 0.5]), y)[beyond])
    far = X + 10 * X.std(axis=0)
    assert region.outside(far, u, y).all()
    assert region.outside(X, u, y + np.ptp(y) * 1.2).all()
    far[0] = np.inf
    assert region.outside(far, u, y)[0]


def test_region_against_the_covariance(rng):
    X = rng.standard_normal((300, 2)) @ np.array([[1.0, 2.0], [0.0, 0.1]])
    u = np.zeros((300, 1))
    S_inv = np.linalg.inv(np.cov(X.T))
    distance = np.einsum("ki,ij,kj->k", X - X.mean(0), S_inv, X - X.mean(0))
    test = 1.5 * X
    expected = np.einsum("ki,ij,kj->k", test - X.mean(0), S_inv, test - X.mean(0))
    np.testing.assert_array_equal(
        Region.of(X, u, u).outside(test, u, u),
        expected > (1.1 * 1.01) ** 2 * distance.max(),
    )


def test_region_of_unexcited_states(rng):
    X, u = np.zeros((50, 2)), rng.standard_normal((50, 1))
    assert not Region.of(X, u, u).outside(X, u, u).any()
    X[:, 0] = u[:, 0]  # no statement on the other one
    assert not Region.of(X, u, u).outside(X + np.array([0, 1]), u, u).any()


@pytest.mark.parametrize("dither", [0.0, 0.02])
def test_region_knows_that_a_controller_made_u(rng, dither):
    """Beside u = -K x nothing was seen, though x and u were both."""
    X = rng.standard_normal((2000, 2))
    u = -X @ [[0.8], [0.5]] + dither * rng.standard_normal((2000, 1))
    region = Region.of(X, u, X[:, :1])
    assert region.outside(X, u, X[:, :1]).mean() < 0.002  # of 2,000 one is alone
    beside = rng.uniform(-2, 2, (2000, 1))
    far = np.abs(beside - u)[:, 0] > 0.5
    low, high = region.low[0], region.high[0]
    assert np.all((beside > low) & (beside < high))  # the box alone sees nothing
    assert region.outside(X, beside, X[:, :1])[far].all()
    T = np.array([[1.0, 1e2], [0.0, -3.0]])  # another basis of the states
    other = Region.of(X @ T, u, X[:, :1])
    np.testing.assert_array_equal(
        other.outside(X @ T, beside, X[:, :1]), region.outside(X, beside, X[:, :1])
    )


def test_region_of_older_files_is_that_of_the_states(rng):
    X, u = rng.standard_normal((300, 2)), rng.standard_normal((300, 1))
    region = Region.of(X, u, u)
    old = replace(
        region,
        center=X.mean(axis=0),
        whiten=np.eye(2),
        radius=1.0,
        points=np.empty((0, 2)),
    )
    inside = np.linalg.norm(X - X.mean(axis=0), axis=1) <= 1.1
    np.testing.assert_array_equal(~old.outside(X, u, u), inside)


def van_der_pol(n, rng):
    """Return states and inputs on its limit cycle."""
    u, X, x = 0.05 * rng.standard_normal((n, 1)), np.empty((n, 2)), np.array([2.0, 0.0])
    for k in range(n):
        X[k] = x
        for _ in range(5):
            x = x + 0.02 * np.array([x[1], (1 - x[0] ** 2) * x[1] - x[0] + u[k, 0]])
    return X, u


def test_the_middle_of_a_limit_cycle_is_outside(rng):
    """Box and ellipsoid have it, and no sample is near; a fresh record is inside."""
    X, u = van_der_pol(2_000, rng)
    region = Region.of(X, u, X[:, :1])
    middle = 0.2 * rng.standard_normal((500, 2))
    judged = middle, u[:500], middle[:, :1]
    convex = replace(region, points=region.points[:0])
    assert not convex.outside(*judged).any()
    assert region.outside(*judged).mean() > 0.8
    assert region.outside(X, u, X[:, :1]).mean() < 0.005
    X, u = van_der_pol(2_000, rng)
    assert region.outside(X, u, X[:, :1]).mean() < 0.01
    T = np.array([[1.0, 1e2], [0.0, -3.0]])  # in another basis of the states, too
    other = Region.of(*van_der_pol(2_000, np.random.default_rng(3)), X[:, :1])
    X, u = van_der_pol(2_000, np.random.default_rng(3))
    turned = Region.of(X @ T, u, X[:, :1])
    assert turned.reach == pytest.approx(other.reach, rel=1e-6)
    assert turned.doubt == pytest.approx(other.doubt, rel=1e-6)


def test_references_of_a_region_are_few_and_always_the_same(rng):
    X, u = rng.standard_normal((123_457, 2)), rng.standard_normal((123_457, 1))
    one, other = (Region.of(X, u, u) for _ in range(2))
    np.testing.assert_array_equal(one.points, other.points)
    assert 990 <= len(one.points) <= 1_000
    edges = [0, 1_000, 1_001, 50_000, len(X)]  # in chunks of any size
    chunks = [slice(a, b) for a, b in pairwise(edges)]
    pieces = Region.of_parts(lambda f: [f((X[c], u[c], u[c], u[c]) for c in chunks)])
    np.testing.assert_allclose(pieces.points, one.points, atol=1e-9)
    # of many short experiments, too
    experiments = [(X[i : i + 3], u[i : i + 3]) for i in range(0, 9_000, 3)]
    short = Region.of_parts(lambda f: [f([(X, u, u, u)]) for X, u in experiments])
    assert 50 <= len(short.points) <= 1_000
    assert not len(Region.of(X[:40], u[:40], u[:40]).points)  # too few to tell


def test_copies_of_a_record_do_not_make_its_neighbours_far(rng):
    """Periods are no fresh records: other phases of the same spectrum are inside."""
    spectrum = np.zeros((2, 101), dtype=complex)
    spectrum[:, 1:30] = np.exp(2j * np.pi * rng.uniform(size=(2, 29)))
    periods = np.fft.irfft(spectrum, 200, axis=1)[..., None]
    X, fresh = (
        np.hstack(
            [
                lfilter([0.0, 0.4], [1.0, -p], np.tile(z, (9, 1)), axis=0)[200:]
                for p in (0.9, 0.5)
            ]
        )
        for z in periods
    )
    u, u_fresh = (np.tile(z, (8, 1)) for z in periods)
    region = Region.of(X, u, X[:, :1])
    one = Region.of(X[:200], u[:200], X[:200, :1])
    assert region.reach == pytest.approx(one.reach, rel=0.5)  # 0 if copies counted
    assert region.doubt == pytest.approx(one.doubt, rel=0.5)
    assert region.outside(fresh, u_fresh, fresh[:, :1], surely=True).mean() <= OUTSIDE
    twice = Region.of_parts(  # a copy as an experiment of its own
        lambda f: [f([(X[:200], u[:200], X[:200, :1], X[:200, :1])]) for _ in range(2)]
    )
    assert twice.reach == pytest.approx(one.reach, rel=0.5)


def test_few_independent_samples_make_doubt(rng):
    """Two records of a few levels each do not cover the same region."""
    fast, slow = rng.standard_normal((2, 500, 1))
    slow = np.repeat(slow[:10], 50, axis=0)
    doubt = [Region.of(u, u, u).doubt for u in (fast, slow)]
    assert doubt[0] < 0.02 and 0.3 < doubt[1] <= 4.0
    region = Region.of(slow, slow, slow)
    width = np.ptp(slow)
    near, far = (slow + z * width for z in (0.5, 1.2 + doubt[1]))
    assert region.outside(near, near, near).mean() > 0.1
    assert not region.outside(near, near, near, surely=True).any()
    assert region.outside(far, far, far, surely=True).all()
    assert Region.of(*(np.zeros((20, 1)),) * 3).doubt <= 4.0  # nothing moves


def test_what_diverged_is_not_of_the_region(rng):
    """A model may diverge along an experiment of which no output was measured."""
    X, u = rng.standard_normal((300, 2)), rng.standard_normal((300, 1))
    chunk = X, u, X[:, :1], X[:, :1]
    expected = Region.of_parts(lambda f: [f([chunk])])
    far = 1e300 * np.cumsum(np.ones((300, 2)), axis=0)
    with np.errstate(over="ignore"):
        far = np.where(np.arange(300)[:, None] > 50, 1e10 * far, far)
    gone = far, u, far[:, :1], far[:, :1]
    region = Region.of_parts(lambda f: [f([gone]), f([chunk])])
    for name in ("low", "high", "points", "reach", "radius"):
        np.testing.assert_allclose(getattr(region, name), getattr(expected, name))
    assert not region.outside(*chunk[:3]).any()


@pytest.mark.parametrize("seed", [195, 231])
def test_a_fit_with_an_experiment_that_diverges_is_a_model(seed):
    rng = np.random.default_rng(seed)
    n = rng.integers(10, 40)
    u, y = rng.standard_normal((2 * n, 2)), rng.standard_normal((2 * n, 1))
    y[:n] = np.nan
    if seed % 3 == 0:
        u = np.vstack([rng.standard_normal((1500, 2)), u])
        y = np.vstack([np.full((1500, 1), np.nan), y])
    model = LinearStateSpace(nx=3, max_iter=1, input_delay=int(rng.integers(2)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model.fit(u, y, np.repeat([0, 1], [len(u) - n, n]))
    assert np.isfinite(model.fitted_.region.radius)


def test_region_counts_what_was_measured(rng):
    X, u, y = (rng.standard_normal((100, n)) for n in (2, 1, 1))
    measured = y + 1.0
    region = Region.of(X, u, y, measured)
    assert not region.outside(X, u, y, measured).any()
    assert region.high[1] > measured.max() and region.low[1] < y.min()
    np.testing.assert_array_equal(
        region.outside(X, u, y, measured + 2.0),
        measured[:, 0] + 2.0 > region.high[1] + 0.1 * (region.high[1] - region.low[1]),
    )
    assert not region.outside(X, u, y).any()  # nothing was measured


def test_a_fresh_record_of_the_same_kind_is_inside(rng):
    """By chance 1.5 % of it leave the box, and hardly any of it by a tenth."""
    beyond, outside, louder, elsewhere = [], [], [], []
    for _ in range(40):
        u, fresh = rng.standard_normal((2, 500, 1))
        x, x_fresh = (lfilter([0.0, 0.4], [1.0, -0.9], z, axis=0) for z in (u, fresh))
        region = Region.of(x, u, x)
        box = np.hstack([fresh, x_fresh])
        beyond.append(np.any((box < region.low) | (box > region.high), axis=1).mean())
        outside.append(region.outside(x_fresh, fresh, x_fresh).mean())
        louder.append(region.outside(2 * x_fresh, 2 * fresh, 2 * x_fresh).mean())
        elsewhere.append(region.outside(x_fresh + 8, fresh + 2, x_fresh + 8).mean())
    assert np.mean(np.array(beyond) > 0.01) > 0.1
    assert np.mean(np.array(outside) > OUTSIDE) < 0.06
    assert min(louder) > OUTSIDE and min(elsewhere) > OUTSIDE


def test_over_the_top_is_outside_the_training_region():
    # the same torques, but the arm of the second record goes over the top
    train, held_out, over = (
        make_pendulum(4_000, amplitude=5.0, full_turns=seed == 24, random_state=seed)
        for seed in (0, 3, 24)
    )
    assert max(np.abs(train.y).max(), np.abs(held_out.y).max()) < np.pi / 2 + 0.3
    assert np.abs(over.y).max() > 2 * np.pi
    model = fl_ssnn(nx=2, n_h=8, feedback="state", dt=train.dt, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.set_params(max_iter=60).fit(train.u, train.y)
    record = model.linearizability(held_out.u, held_out.y)
    assert record.outside < 0.01 and "of the record lies outside" not in str(record)
    record = model.linearizability(over.u, over.y)
    assert record.outside > 0.7  # 74 % of the angles were never seen
    share = f"{100 * record.outside:.3g} %"
    assert f"{share} of the record lies outside the training" in str(record)
    assert max(map(len, str(record).splitlines())) <= 79


def test_shares_outside_against_a_plain_loop(model):
    region = region_of(model)
    record = measured(model, region=region)
    y_measured = np.vstack([y for _, y, _ in model.experiments])
    for share, closed in ((record.outside, False), (record.closed_outside, True)):
        run = replay_all(model, closed=closed)
        y = None if closed else y_measured
        assert share == region.outside(run["x"], run["u"], run["y"], y).mean()
    assert record.outside != record.closed_outside


# Table


def test_table_is_aligned_and_has_units(model):
    plant = replace(model.plant, region=region_of(model))
    names = ["level", "flow"]
    record = measure(plant, as_records(model.experiments), output_names=names)
    assert repr(record) == str(record)
    lines = str(record).splitlines()
    assert max(map(len, lines)) <= 79
    assert lines[0].split() == ["open", "loop", "closed", "loop"]
    assert lines[1].startswith("linearization error, level ")
    assert len(lines[1]) == len(lines[0]) and lines[1].endswith(" %")
    assert f"{100 * record.linearization_error[0]:.3g} %" in lines[1]
    assert "frequency band, flow" in str(record)
    assert "25 to 50 Hz" in str(record)


def test_table_of_one_output_does_not_name_it():
    one, many = np.ones(1), np.ones((6, 1))
    bands = Bands(np.arange(7.0), many, many)
    record = Linearizability(
        one, *[1.0] * 5, one, *[1.0] * 7, one, None, None, bands, one
    )
    assert "linearization error   " in str(record) and "y0" not in str(record)
    assert "-" in str(record)  # the region is not known


def test_frame_has_every_number(model):
    record = measured(model)
    frame = record.to_frame()
    assert list(frame.columns) == ["quantity", "output", "f_min", "f_max", "value"]
    by_name = frame.groupby("quantity")["value"].apply(list)
    assert by_name["linearization_error"] == list(record.linearization_error)
    assert by_name["peak_gain"] == [record.peak_gain]
    assert by_name["bands.error"] == list(record.bands.error.ravel())
    fields = {name for name in vars(record) if not name.startswith("carried")}
    assert set(by_name.index) | {"bands", "e", "output_names", "no_law"} == (
        fields - {"has_disturbances", "is_sampled", "is_mapped"}
        | {"bands.error", "bands.output", "bands"}
    )
    band = frame[(frame["quantity"] == "bands.output") & (frame["output"] == "y1")]
    np.testing.assert_array_equal(band["f_max"], record.bands.edges[1:])


def test_frame_without_pandas(model, monkeypatch):
    real = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(ImportError, match=r"needs pandas.* Install it by pip install"):
        measured(model).to_frame()

"""A first look finds what was spoiled, and nothing in a good record."""

import json
import warnings
from functools import partial

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.stats import f as f_distribution

import alssnn
from alssnn import cli
from alssnn.excitation import multisine, steps
from alssnn.first_look import nonlinearity
from benchmarks import recommendations as benchmark

FIRST = butter(2, 0.1)
look = partial(alssnn.look, recommends=False)
NAMES = [
    "record",
    "gaps",
    "saturation",
    "quantization",
    "outliers",
    "inputs",
    "delay",
    "nonlinearity",
    "accuracy",
    "sampling",
]


def make(seed=0, N=1500, nu=1, curve=lambda x: x, delay=0):
    """Return inputs and noisy outputs of a plant with a curve at its output."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((N, nu))
    late = np.vstack([np.zeros((delay, nu)), u[: N - delay]])
    x = lfilter(*FIRST, late, axis=0)
    return u, curve(x) + 0.01 * rng.standard_normal((N, nu))


@pytest.fixture(scope="module")
def good():
    return make()


def test_a_good_record_needs_no_attention(good):
    page = look(*good, dt=0.1)
    assert [one.name for one in page] == NAMES
    assert [one.name for one in page if one.attention] == []
    assert page["record"].value == 1500 and "150 s" in page["record"].sentence
    share = 0.01 / np.std(good[1])
    assert page["accuracy"].value == pytest.approx(share, rel=0.1)
    assert repr(page) == "FirstLook(attention=[])"
    assert all(len(line) < 80 for line in str(page).splitlines())
    with pytest.raises(KeyError, match=r"`name` must be one of record, .* got 'noise'"):
        page["noise"]


def spiked(u, y):
    y = y.copy()
    y[[100, 700]] += 3
    return u, y


SPOILED = {
    "gaps": (
        lambda u, y: (u, np.where(np.arange(1500)[:, None] < 150, np.nan, y)),
        0.1,
    ),
    "saturation": (lambda u, y: (u, np.minimum(y, 0.5)), None),
    "quantization": (lambda u, y: (u, np.round(y / 0.05) * 0.05), None),
    "outliers": (spiked, 2),
    "inputs": (lambda u, y: (np.hstack([u, u**0]), y), 1),
    "record": (lambda u, y: (u[:150], y[:150]), 150),
}


@pytest.mark.parametrize("name", SPOILED)
def test_what_is_spoiled_is_found(good, name):
    spoil, value = SPOILED[name]
    page = look(*spoil(*good))
    assert page[name].attention
    if value is not None:
        assert page[name].value == value
    others = set(NAMES[:6]) - {name}
    assert not any(page[other].attention for other in others)
    assert f"! {name}" in str(page)


def test_numbers_of_limits_and_steps(good):
    u, y = good
    page = look(u, np.minimum(y, 0.5))
    assert page["saturation"].value == pytest.approx(np.mean(y > 0.5))
    step = 0.05 / np.round(y / 0.05).std() / 0.05
    page = look(u, np.round(y / 0.05) * 0.05)
    assert page["quantization"].value == pytest.approx(step)


def test_rounding_is_no_converter():
    """Of periods without noise, values repeat themselves up to the last digit."""
    y = np.tile(np.random.default_rng(0).standard_normal(100), 10)
    y[50::100] = 0
    y[550] = 1e-21
    assert len(np.unique(y)) < len(y) / 2
    assert look(np.roll(y, -1), y)["quantization"].value == 0


def test_waves_and_steps_are_no_spikes():
    t = np.arange(2000)
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, 100), 20)
    y = u + np.sin(0.3 * t) + 0.01 * rng.standard_normal(2000)  # edges, and crests
    assert look(u, y)["outliers"].value == 0
    y[1000] += 1
    page = look(u, y)
    assert page["outliers"].value == 1 and "sample 1000" in page["outliers"].sentence


@pytest.mark.parametrize("value", [0.1, 3.3, np.nan])
def test_an_output_at_rest_is_told_and_has_no_accuracy(good, value):
    """Its deviation from the mean is one of rounding, and not zero."""
    u, y = good
    still = np.full_like(y, value)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # of empty means
        page = alssnn.look(u, np.hstack([y, still]))
    assert "At rest: y[1]" in page["model"].sentence
    assert np.isnan(page["accuracy"].value)
    assert "y[1]" in page["accuracy"].sentence
    if value == value:
        assert "u[0] does not move" in look(still, y)["inputs"].sentence


def test_delays_and_inputs_that_move_together():
    u, y = make(delay=6)
    page = look(u, y)
    assert page["delay"].value == pytest.approx(6, abs=1)
    assert f"input_delay=[{page['delay'].value:.0f}]" in page["delay"].sentence
    rng = np.random.default_rng(1)
    both = np.hstack([u, u + 0.01 * rng.standard_normal(u.shape)])
    page = look(both, y)
    assert page["inputs"].value > 0.99 and "u[0] and u[1]" in page["inputs"].sentence


def test_inputs_whose_sum_is_another():
    u, y = make()
    rng = np.random.default_rng(1)
    two = np.hstack([u, rng.standard_normal(u.shape)])
    noise = 0.01 * rng.standard_normal(u.shape)
    three = np.hstack([two, two.sum(axis=1, keepdims=True) + noise])
    found = look(three, y, recommends=False)["inputs"]
    assert found.value > 0.99 and found.attention
    assert "With a sum of all others" in found.sentence
    assert "move them independently" in found.sentence
    three[:, 2:] = rng.standard_normal(u.shape)
    found = look(three, y, recommends=False)["inputs"]
    assert not found.attention and "sum" not in found.sentence


def test_a_periodic_record_tells_noise_from_distortion():
    excitation = multisine(256, dt=0.1, random_state=0)
    rng = np.random.default_rng(0)
    clean = np.concatenate([u + 0.3 * u**2 for u in excitation.experiments])
    page = look(excitation, clean + 0.01 * rng.standard_normal(clean.shape))
    assert page["nonlinearity"].attention
    assert "between realizations" in page["nonlinearity"].sentence
    assert "and any model about 0.010" in page["accuracy"].sentence
    assert page["gaps"].value == 0


def test_inputs_that_were_sent_twice_tell_the_noise():
    u, y = make(curve=lambda x: x + 0.3 * x**3)
    again = y + 0.01 * np.random.default_rng(1).standard_normal(y.shape)
    page = look([u, u, u[::-1]], [y, again, y])
    assert "repeat the input of another one: 1." in page["record"].sentence
    # the second has the noise of the first, and as much again: half of it differs
    np.testing.assert_allclose(page.noise_rms, 0.01 / np.sqrt(2), rtol=0.1)
    assert "and any model about 0.007" in page["accuracy"].sentence
    assert look(u, y).noise_rms is None


def test_what_cannot_be_told_is_said():
    u, y = make(N=20)
    page = look(u, y)
    assert np.isnan(page["accuracy"].value)
    assert "got at most 20 samples" in page["accuracy"].sentence
    page = look(u, 0 * y)
    assert "at rest" in page["delay"].sentence


def test_slow_and_fast_sampling():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.standard_normal(60), 100)
    slow = lfilter(*butter(2, 0.005), u)
    page = look(u, slow + 1e-4 * rng.standard_normal(6000))
    assert page["sampling"].attention and "times longer" in page["sampling"].sentence
    u = rng.standard_normal(2000)
    page = look(u, u + 0.01 * rng.standard_normal(2000))
    assert "Sample faster" in page["sampling"].sentence
    assert page["sampling"].value == pytest.approx(2, abs=0.1)


def test_sharp_resonances_are_neither_a_floor_nor_a_loop():
    """A linear model of six states took what it missed for noise that moves u."""
    rng = np.random.default_rng(0)
    options = {"band": (5e-4, 0.3), "n_periods": 1, "n_realizations": 1}
    u = multisine(2000, **options, random_state=0).u
    a = np.convolve([1, -1.7, 0.98], [1, -1.1, 0.95])
    y = lfilter([0, 0.1, 0.05], np.convolve(a, [1, 0.3, 0.9]), u[:, 0])
    y += 0.01 * y.std() * rng.standard_normal(len(y))
    page = alssnn.look(u, y)
    assert page["accuracy"].value < 0.02  # noise is 0.01
    assert page.recommendation.estimator is alssnn.LinearStateSpace
    assert page.recommendation.options == {}


def test_a_calm_end_of_a_record_is_no_accuracy():
    """What a linear model leaves there says nothing of the rest of the record."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((2000, 1))
    u[1400:] *= 0.2
    y = lfilter([0, 0.2, 0.1], [1, -1.2, 0.5], u[:, 0] + 0.5 * u[:, 0] ** 3)
    assert alssnn.look(u, y)["accuracy"].value > 0.4


def test_a_curve_is_asked_for_where_a_linear_model_is_near_the_noise_too():
    excitation = multisine(256, n_periods=4, n_realizations=4, random_state=1)
    u = excitation.u[:, 0] / excitation.u[:, 0].std()
    noise = 0.3 * np.random.default_rng(0).standard_normal(u.shape)
    wanted = alssnn.look(excitation, u + 0.03 * u**3 + noise).recommendation
    assert not wanted and "without any dynamics" in wanted.reason


def test_the_benchmark_knows_the_half_of_all_its_cases():
    names = benchmark.known()
    text = benchmark.table(dict.fromkeys(names, "linear"), benchmark.searched())
    assert len(names) > 40 and text.count("| linear |") >= len(names)


# -- the test for nonlinearity ---------------------------------------------------------


def test_the_level_of_the_test_is_its_level():
    called = [nonlinearity(*make(seed, 800, 2))[0] < 0.05 for seed in range(100)]
    assert 0 <= np.mean(called) < 0.12  # 0.05 but for chance


def test_smooth_inputs_of_a_linear_plant_show_no_nonlinearity():
    """Their lags nearly depend on each other, and yet all of them count."""
    called = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        f, phase = rng.uniform(0.001, 0.05, 5), rng.uniform(0, 2 * np.pi, 5)
        u = np.sin(2 * np.pi * f * np.arange(1000)[:, None] + phase).sum(axis=1)
        y = lfilter([0, 0.01, 0.005], [1, -1.87, 0.873], u)
        y = y + 0.01 * y.std() * rng.standard_normal(1000)
        called.append(nonlinearity(u, y)[0] < 0.05)
    assert np.mean(called) < 0.15  # 0.05 but for chance


@pytest.mark.parametrize("noise", [0, 1e-3])
def test_fast_motion_and_the_ends_of_a_record_are_no_spikes(noise):
    """Overshoots of a few samples, and waves that are cut anywhere."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        held = steps(1000, random_state=seed).u[:, 0]
        waves = np.sin(0.3 * np.arange(1000 - 20 * seed) + seed)
        for u in (held, waves):
            y = lfilter([0, 0.3, 0.1], [1, -1.2, 0.5], u)[10:]
            y = y + noise * y.std() * rng.standard_normal(y.shape)
            assert look(u[10:], y)["outliers"].value == 0
            y[[300, 600]] += [2.0, -2.0]
            assert look(u[10:], y)["outliers"].value == 2


def test_a_late_input_of_a_linear_plant_shows_no_nonlinearity():
    rng = np.random.default_rng(1)
    u = np.repeat(rng.choice([-1.0, 1.0], 125), 8)
    y = lfilter([0, 0.3], [1, -0.7], np.roll(u, 40)) + 0.03 * rng.standard_normal(1000)
    page = look(u[40:], y[40:])
    assert page["delay"].value == 40
    assert page["nonlinearity"].value > 1e-2
    assert nonlinearity(u[40:], y[40:])[0] < 1e-10  # its lags do not reach so far


def test_a_delay_longer_than_an_experiment_is_told_and_not_tried():
    rng = np.random.default_rng(0)
    us = [rng.standard_normal(n) for n in (60, 35, 400)]
    ys = [np.r_[np.zeros(40), u][: len(u)] for u in us]
    ys = [y + 0.01 * rng.standard_normal(y.shape) for y in ys]
    page = alssnn.look(us, ys)
    assert page["delay"].value >= 35
    assert "input_delay" not in page.recommendation.options


def test_it_is_an_f_test_of_two_regressions():
    """The oracle: sums of squares of both, by NumPy's least squares."""
    u, y = (z[:, 0] for z in make(0, 400))
    n = 30
    past = [np.ones(400 - n), *(y[n - i : 400 - i] for i in range(1, n + 1))]
    inputs = [u[n - i : 400 - i] for i in range(n + 1)]
    X, target = np.column_stack([*past, *inputs]), y[n:]
    theta = np.linalg.lstsq(X, target)[0]
    # powers of deviations from the means, as the test takes them
    p = (X @ theta - y.mean()) / y.std()
    q = (X[:, n + 1 :] - u.mean()) @ theta[n + 1 :] / y.std()
    Z = np.column_stack([p**2, p**3, q**2, q**3, p * q, p**2 * q, p * q**2])
    less, more = (
        np.sum((target - A @ np.linalg.lstsq(A, target)[0]) ** 2)
        for A in (X, np.hstack([X, Z]))
    )
    freedom = 400 - n - X.shape[1] - 7
    F = (less - more) / 7 / (more / freedom)
    p_value, share = nonlinearity(u, y)
    assert p_value == pytest.approx(f_distribution.sf(F, 7, freedom), rel=1e-6)
    assert share == pytest.approx(1 - more / less, rel=1e-6)


@pytest.mark.parametrize(
    "curve", [lambda x: x + 0.1 * x**2, lambda x: x + 0.1 * x**3, np.tanh, np.abs]
)
@pytest.mark.parametrize("nu", [1, 2])
def test_curves_are_seen(curve, nu):
    for seed in range(5):
        p_value, share = nonlinearity(*make(seed, 1000, nu, curve))
        assert p_value < 1e-3 and 0 < share < 1


def test_noise_that_went_around_a_loop_is_no_nonlinearity():
    called = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        r = np.repeat(rng.uniform(-1.5, 1.5, 76), 8)
        w, u, y, x = rng.standard_normal(600), np.empty(600), np.empty(600), (0.0, 0.0)
        for k in range(600):
            y[k] = 0.15 * x[0] + 0.1 * x[1]
            u[k] = r[k] - 0.4 * y[k]
            x = 1.6 * x[0] - 0.8 * x[1] + u[k] + 0.5 * w[k], x[0]
        y += 0.01 * rng.standard_normal(600)
        called.append(nonlinearity(u, y)[0] < 0.05)
    assert np.mean(called) < 0.15  # 0.05 but for chance


def test_gaps_units_and_experiments_do_not_matter():
    u, y = make(curve=lambda x: x + 0.05 * x**2)
    one = nonlinearity(u, y)
    two = nonlinearity(1e3 * u + 5, 1e-4 * y - 7)
    np.testing.assert_allclose(two, one, rtol=1e-6)
    parts = nonlinearity([u[:700], u[700:]], [y[:700], y[700:]])
    labels = nonlinearity(u, y, np.repeat([0, 1], [700, 800]))
    assert parts == labels
    gaps = y.copy()
    gaps[400:410] = np.nan
    assert nonlinearity(u, gaps)[0] < 1e-6
    assert np.isnan(nonlinearity(u[:10], y[:10])).all()


def test_an_exact_linear_record_is_linear():
    u, _ = make()
    assert nonlinearity(u, lfilter(*FIRST, u, axis=0))[0] > 0.05
    assert nonlinearity(u, 2 * u)[0] > 0.05
    assert nonlinearity(0 * u, 0 * u)[0] == 1


# -- the command -----------------------------------------------------------------------


def test_the_command_prints_the_page(tmp_path, monkeypatch, capsys):
    excitation = multisine(64, random_state=0, names=["valve"])
    path = tmp_path / "plant.csv"
    excitation.to_csv(path)
    lines = path.read_text(encoding="utf-8").splitlines()
    y = excitation.u[:, 0] ** 2
    rows = [f"{line},{v:.9g}" for line, v in zip(lines[1:], y, strict=True)]
    path.write_text("\n".join([lines[0] + ",level", *rows]), encoding="utf-8")
    argv = ["look", path, "--input", "valve", "--output", "level", "--dt", 0.1]
    argv += ["--experiment", "experiment", "--period", 64]
    pages, real = [], alssnn.first_look.look

    def kept(*record, **options):
        pages.append(real(*record, **options))
        return pages[0]

    monkeypatch.setattr("alssnn.first_look.look", kept)
    assert cli.main([str(arg) for arg in argv]) == 0
    out = capsys.readouterr().out
    assert "! nonlinearity" in out and "4 experiments" in out
    assert " of level (" in out and "y[0]" not in out and "u[0]" not in out
    (page,) = pages
    monkeypatch.setattr("alssnn.first_look.look", lambda *_, **__: page)
    assert cli.main([*(str(arg) for arg in argv), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found["recommendation"]) == {"estimator", "options", "reason"}
    assert "level" in found["findings"][8]["sentence"]


def spring(u, law, delay=0, noise=0.005, seed=0):
    """Return outputs of oscillators, one per input, with a law of (y, u, speed)."""
    x = np.zeros((2, u.shape[1]))
    late = np.vstack([np.zeros((delay, u.shape[1])), u[: len(u) - delay]])
    y = np.empty_like(late)
    for k, one in enumerate(late):
        y[k] = 0.15 * x[0] + 0.1 * x[1]
        v = law(y[k], one, x[0] - x[1])
        x = np.stack([1.6 * x[0] - 0.8 * x[1] + v, x[0]])
    return y + noise * np.random.default_rng(seed).standard_normal(y.shape)


LAWS = {
    "LinearStateSpace": lambda y, u, speed: u - 0.3 * y,
    "FlSsnn, output": lambda y, u, speed: u - 0.8 * np.tanh(2 * y),
    "FlSsnn, state": lambda y, u, speed: u - 0.5 * np.tanh(2 * speed),
    "AlSsnn": lambda y, u, speed: np.tanh(2 * u),
}


@pytest.mark.parametrize(
    ("name", "nu", "delay"),
    [
        *((name, 1, 0) for name in LAWS),
        ("LinearStateSpace", 1, 4),
        ("FlSsnn, state", 1, 4),
        ("FlSsnn, output", 2, 0),
    ],
)
def test_it_recommends_the_family_of_the_plant(name, nu, delay):
    u = np.repeat(np.random.default_rng(2).uniform(-1, 1, (1000, nu)), 3, axis=0)
    y = spring(u, LAWS[name], delay)
    y[500:600] = np.nan  # gaps and units do not matter
    page = alssnn.look(1e3 * u, y / 50 + 7, dt=0.1)
    wanted = page.recommendation
    family, _, sees = name.partition(", ")
    assert wanted.estimator is getattr(alssnn, family)
    assert wanted.options.get("feedback", "") == sees
    # of a linear plant, states are as good as a delay
    without = [delay if family == "LinearStateSpace" else 0] * nu
    assert wanted.options.get("input_delay", without) == [delay] * nu
    assert wanted.options["dt"] == 0.1
    assert f"Begin with {wanted}." in page["model"].sentence
    wanted.estimator(**wanted.options)
    if family == "AlSsnn" and not delay:  # where the monotone map is possible
        tried = "FlSsnn(feedback='output', input_map='monotone', dt=0.1)"
        assert tried in wanted.reason


def play(u, radius):
    held, out = 0.0, []
    for one in u:
        held = min(max(held, one - radius), one + radius)
        out.append(held)
    return np.array(out)


def looped(r, rng):
    """Return the record of a loop with noise inside, driven by r."""
    x, u, y = np.zeros(2), np.zeros(len(r)), np.zeros(len(r))
    for k, one in enumerate(r):
        y[k] = x[0] + 0.02 * rng.standard_normal()
        u[k] = 2 * (one - y[k])
        force = 0.2 * u[k] - 0.1 * np.tanh(3 * x[0]) + 0.05 * rng.standard_normal()
        x = np.array([0.9 * x[0] + 0.1 * x[1], 0.8 * x[1] + force])
    return u, y


def levels(rng, N):
    return np.repeat(rng.uniform(-1, 1, N), rng.integers(5, 30, N))[:N]


def twins(name, rng, N=2000):
    """Return a record that no model with a state describes, or one beside it."""
    white = rng.standard_normal(N)
    smooth = lfilter(*butter(2, 0.03), white)
    smooth /= smooth.std()
    sent = levels(rng, N)
    lagging = lfilter(*butter(1, 0.2), np.r_[0, sent[:-1]])
    k = np.arange(N)
    noise = 0.005 * rng.standard_normal(N)
    return {
        "curve": lambda: (white, white + 0.3 * white**3 + noise),
        "late curve": lambda: (white, np.r_[0, 0, 0, np.tanh(white)[:-3]] + noise),
        "hysteresis": lambda: (
            smooth,
            sum(play(smooth, r) for r in (0.1, 0.4, 0.8, 1.2)) + noise,
        ),
        "delay varies": lambda: (
            sent,
            lagging[np.maximum(k - np.round(6 + 5 * np.sin(k / 200)).astype(int), 0)]
            + noise,
        ),
        "delay jumps": lambda: (
            sent,
            lagging[np.maximum(k - np.where(k // 400 % 2, 9, 3), 0)] + noise,
        ),
        "no reference": lambda: looped(0 * sent, rng),
        "few": lambda: (
            white[:120],
            lfilter(*butter(1, 0.2), white + 0.5 * white**3)[:120] + noise[:120],
        ),
        "reference": lambda: looped(sent, rng),
        "dynamics": lambda: (sent, lagging + noise),
        "feedthrough": lambda: (white, lfilter(*butter(2, 0.2), white) + noise),
    }[name]()


@pytest.mark.parametrize("seed", [1, 11])
def test_a_loop_with_a_slow_disturbance_has_no_delay_that_varies(seed):
    """Inputs to come tell of the output, for the controller answers to it."""
    rng = np.random.default_rng(seed)
    r = np.repeat(rng.standard_normal(41), 25)[:1000]
    u, y = np.zeros(1000), np.zeros(1000)
    x, total, slow = np.zeros(2), 0.0, 0.0
    for k in range(1000):
        slow = 0.95 * slow + 0.05 * rng.standard_normal()
        y[k] = x[0] + slow + 0.02 * rng.standard_normal()
        total += 0.05 * (r[k] - y[k])
        u[k] = 0.5 * (r[k] - y[k]) + total
        x = np.array([1.2 * x[0] - 0.5 * x[1] + 0.4 * u[k], x[0]])
    wanted = alssnn.look(u, y).recommendation
    assert wanted.options["noise"] == "innovations"


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("curve", "without any dynamics"),
        ("late curve", "without any dynamics"),
        ("hysteresis", "Play operators"),
        ("delay varies", "The delay varies"),
        ("delay jumps", "The delay varies"),
        ("no reference", "nothing but a controller"),
        ("few", "120 samples are too few"),
    ],
)
def test_what_this_package_is_not_for(name, reason):
    page = alssnn.look(*twins(name, np.random.default_rng(0)))
    assert not page.recommendation and page["model"].attention
    assert page.recommendation.estimator is None
    assert reason in page.recommendation.reason
    assert page["model"].sentence.startswith("No model of this package. ")
    assert str(page.recommendation) == "no model of this package"


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("reference", {"noise": "innovations"}),
        ("dynamics", {}),
        ("feedthrough", {"feedthrough": True}),
    ],
)
def test_what_stands_beside_it(name, options):
    wanted = alssnn.look(*twins(name, np.random.default_rng(0))).recommendation
    assert wanted.estimator is alssnn.LinearStateSpace
    assert wanted.options == options


@pytest.mark.parametrize("period", [None, 128])
def test_a_periodic_record_of_an_open_loop_is_no_loop(period):
    # fewer periods would pass for no loop by themselves
    u = multisine(128, n_periods=16, n_realizations=1, random_state=0).u
    y = spring(u, LAWS["AlSsnn"], noise=0.002)
    wanted = alssnn.look(u, y, period=period).recommendation
    assert "noise" not in wanted.options and "loop" not in wanted.reason


def test_a_curve_within_the_noise_needs_no_network():
    excitation = multisine(512, n_periods=3, n_realizations=8, random_state=0)
    laws = {c: lambda y, u, speed, c=c: u - c * y**3 for c in (0.25, 1.5)}
    linear = {}
    for size, law in laws.items():
        y = [
            spring(u, law, noise=0.05, seed=i)
            for i, u in enumerate(excitation.experiments)
        ]
        page = alssnn.look(excitation, np.concatenate(y))
        assert page["nonlinearity"].attention  # it is there, and it is seen
        linear[size] = page.recommendation.estimator is alssnn.LinearStateSpace
        assert ("within 5 % of the noise" in page.recommendation.reason) == linear[size]
    assert linear == {0.25: True, 1.5: False}


def test_no_family_is_told_from_too_little():
    u, y = make(N=11)
    page = alssnn.look(u, y)
    assert not page.recommendation and [one.name for one in page] == [*NAMES, "model"]
    assert "nothing can be learned" in alssnn.look(u, 0 * y).recommendation.reason
    u, y = make(N=150)
    assert alssnn.look(u, y).recommendation.estimator is alssnn.LinearStateSpace


def test_why_there_is_no_recommendation_is_said():
    u, y = make(N=1500, nu=2)
    hidden = y.copy()
    hidden[1050:] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        wanted = alssnn.look(u, hidden).recommendation
    assert not wanted and wanted.reason == "No hidden sample was measured."
    still = np.column_stack([y[:, 0], np.full(1500, 3.0)])
    reason = alssnn.look(u, still).recommendation.reason
    assert "y[1]" in reason and "y[0]" not in reason and "Leave it out" in reason
    seldom = y.copy()
    seldom[np.arange(1500) % 3 > 0, 1] = np.nan
    reason = alssnn.look(u, seldom).recommendation.reason
    assert "have all outputs measured, 500 of 1500" in reason


def test_what_the_searches_found_best(tmp_path):
    errors = benchmark.searched()
    assert errors["pendulum"]["linear"] == 1.0 and len(errors) >= 30
    found = {"linear": 1.0, "h(y)": 0.13, "h(x)": 0.11, "AL": 0.1}
    assert benchmark.best(found) == "h(x)"  # as good, and simpler
    assert benchmark.best({**found, "h(x)": 0.13}) == "AL"
    text = benchmark.table(
        {"pendulum": "h(y)", "linear": "AL", "Duffing": "not run", "wh paper": "AL"},
        {"pendulum": found, "linear": {**found, "linear": 0.105}, "Duffing": found},
    )
    assert "| pendulum | unseen | h(y) | h(x) | 1.30 |" in text
    assert "| linear | tuned | AL | linear | 1.00 |" in text
    assert "| Duffing | tuned | not run | - | - |" in text
    assert "| wh paper | unseen | AL | - | - |" in text
    assert "Thresholds tuned: 0 of 1 (0 %) are the best family, 0 with" in text
    assert "1 are nonlinear where the linear model is within 5 % of the best" in text
    assert "Thresholds unseen: 1 of 1 (100 %) are the best family, 0 with" in text


def test_errors_of_runs_are_gathered(tmp_path):
    rows = [
        {"case": "linear", "model": model, "options": options, "relative": value}
        for model, options, value in (
            ("lti", "", "1"),
            ("fl", "feedback='output'", "0.5"),
            ("fl", "", "0.2"),
            ("fl", "", "0.4"),
            ("fl", "alpha=0.01; feedback='output'", "0.7"),
            ("al", "", "1"),
            ("al", "alpha=0.01", "0.1"),  # the least of a family
        )
    ]
    path = tmp_path / "families.csv"
    benchmark.gather([*rows, {**rows[0], "case": "Duffing"}], path)
    wanted = {"linear": 1.0, "h(y)": 0.5, "h(x)": 0.3, "AL": 0.1}
    assert benchmark.searched(path) == {"linear": wanted}

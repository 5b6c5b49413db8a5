import os
import pickle
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, signal

from alssnn.datasets import (
    Record,
    fetch_wiener_hammerstein,
    make_duffing,
    make_fan_arm,
    make_pendulum,
    make_prey_predator,
    make_wiener_hammerstein,
)

DT = 1 / 51_200  # s
MAKERS = [
    make_wiener_hammerstein,
    make_pendulum,
    make_duffing,
    partial(make_duffing, excitation="stairs"),
    make_prey_predator,
]
every_maker = pytest.mark.parametrize("make", MAKERS, ids=range(len(MAKERS)))


@pytest.fixture
def record():
    u = np.arange(10.0)
    return Record(u, np.column_stack([u, -u]), 0.5, "ramp", x0=[1, 2, 3])


def simulate_plant(plant, u, x0):
    """Step the plant by its own functions: no time axis to round."""
    x, y = x0, []
    for k in range(len(u)):
        y.append(plant.output(k, x, u[k]))
        x = plant.dynamics(k, x, u[k])
    return np.array(y)


def linear_floor(record, n_taps=150):
    """Return what the best FIR model with an offset leaves of std(y)."""
    u, y = record.u[:, 0], record.y[n_taps:, 0]
    lags = [u[n_taps - i : len(u) - i] for i in range(n_taps)]
    Z = np.column_stack([*lags, np.ones(len(y))])
    e = y - Z @ np.linalg.lstsq(Z, y, rcond=None)[0]
    return e.std() / y.std()


# Record


def test_record_unpacks_into_two_dimensional_signals(record):
    u, y = record
    assert u.shape == (10, 1) and y.shape == (10, 2)
    assert u.dtype == y.dtype == np.float64
    assert len(record) == 10
    assert record.dt == 0.5 and record.name == "ramp" and record.plant is None
    np.testing.assert_array_equal(record.x0, [1.0, 2.0, 3.0])


def test_record_is_frozen_and_keeps_the_arrays_of_the_user():
    u, y = np.ones((4, 1)), np.zeros(4, dtype=int)
    record = Record(u, y, 1, "constant")
    assert record.u.base is u or record.u is u
    assert y.dtype == int and y.shape == (4,)
    with pytest.raises(AttributeError):
        record.dt = 2.0


def test_record_repr_is_short(record):
    assert repr(record) == "Record('ramp', N=10, nu=1, ny=2, dt=0.5 s)"
    simulated = make_wiener_hammerstein(100_000, random_state=0)
    assert "plant=NonlinearIOSystem" in repr(simulated)
    assert len(repr(simulated)) < 120


def test_record_without_plant_pickles(record):
    copy = pickle.loads(pickle.dumps(record))
    np.testing.assert_array_equal(copy.y, record.y)
    assert repr(copy) == repr(record)


@pytest.mark.parametrize("n", [7, np.int64(7), 0.7, np.float64(0.71)])
def test_record_split(record, n):
    first, rest = record.split(n)
    assert (len(first), len(rest)) == (7, 3)
    np.testing.assert_array_equal(np.vstack([first.y, rest.y]), record.y)
    assert first.dt == rest.dt == record.dt
    assert (first.name, rest.name) == ("ramp[:7]", "ramp[7:]")
    assert first.x0 is not None and rest.x0 is None


@pytest.mark.parametrize("n", [True, "half", None, 1j])
def test_record_split_type_error(record, n):
    with pytest.raises(TypeError, match="`n` must be an int or a float, got"):
        record.split(n)


@pytest.mark.parametrize("n", [0.0, 1.0, 5.0, -0.5, np.nan])
def test_record_split_fraction_error(record, n):
    with pytest.raises(ValueError, match="`n` must lie strictly between 0 and 1"):
        record.split(n)


@pytest.mark.parametrize("n", [0, 10, 11, -1, 0.01, 0.99])
def test_record_split_empty_part_error(record, n):
    with pytest.raises(ValueError, match="`n` must leave at least one of the 10"):
        record.split(n)


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"y": np.zeros(4)}, ValueError, "same number of samples, got 5 and 4"),
        ({"u": []}, ValueError, r"`u` must be a nonempty array .* got shape \(0,\)"),
        ({"u": 1.0}, ValueError, r"`u` must be a nonempty array .* got shape \(\)"),
        ({"y": np.zeros((5, 1, 1))}, ValueError, "`y` must be a nonempty array"),
        ({"y": np.zeros((5, 0))}, ValueError, "`y` must be a nonempty array"),
        ({"u": [0, 1, np.nan, 3, 4]}, ValueError, "`u` must be finite, got .* row 2"),
        ({"u": [np.inf] * 5}, ValueError, "`u` must be finite, got inf at row 0"),
        ({"y": ["a"] * 5}, ValueError, "`y` must be an array of real numbers, got"),
        ({"y": [[1], [1, 2]]}, ValueError, "`y` must be an array of real numbers, got"),
        ({"y": np.ones(5) * 1j}, ValueError, "real numbers, got dtype complex128"),
        ({"dt": "1"}, TypeError, "`dt` must be a number, got '1'"),
        ({"dt": True}, TypeError, "`dt` must be a number, got True"),
        ({"dt": 0}, ValueError, "`dt` must be positive and finite, got 0"),
        ({"dt": np.nan}, ValueError, "`dt` must be positive and finite, got nan"),
        ({"name": 3}, TypeError, "`name` must be a string, got 3"),
        ({"x0": np.zeros((1, 2))}, ValueError, r"`x0` must be of shape \(nx,\)"),
    ],
)
def test_record_errors(changed, error, message):
    arguments = {"u": np.zeros(5), "y": np.zeros(5), "dt": 1.0, "name": "zero"}
    with pytest.raises(error, match=message):
        Record(**(arguments | changed))


# All simulated plants


def test_import_is_light():
    code = (
        "import sys, alssnn.datasets; "
        "sys.exit(bool({'control', 'matplotlib'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@every_maker
def test_plant_reproduces_record(make):
    record = make(2_000, random_state=0)
    y = simulate_plant(record.plant, record.u, record.x0)
    # rounding of a compiled transfer function against a recursion
    np.testing.assert_allclose(y, record.y, rtol=0, atol=1e-10)


@every_maker
def test_plant_reproduces_record_in_python_control(make):
    control = pytest.importorskip("control")
    record = make(500, random_state=0)
    response = control.input_output_response(
        record.plant,
        np.arange(500) * record.dt,
        record.u.T,
        X0=record.x0,
        squeeze=False,
    )
    np.testing.assert_allclose(response.outputs.T, record.y, rtol=0, atol=1e-10)
    assert record.plant.dt == record.dt
    assert len(record.x0) == record.plant.nstates


@every_maker
def test_noise_is_relative_to_the_output(make):
    clean = make(5_000, random_state=3)
    noisy = make(5_000, noise=0.1, random_state=3)
    np.testing.assert_array_equal(noisy.u, clean.u)
    np.testing.assert_array_equal(noisy.x0, clean.x0)
    e = noisy.y - clean.y
    assert e.std() == pytest.approx(0.1 * clean.y.std(), rel=0.05)
    assert abs(np.mean(e[1:] * e[:-1])) < 0.05 * e.var()  # white


@every_maker
def test_random_state_is_reproducible(make):
    first = make(100, noise=0.1, random_state=5)
    again = make(100, noise=0.1, random_state=5)
    other = make(100, noise=0.1, random_state=6)
    np.testing.assert_array_equal(first.y, again.y)
    assert not np.allclose(first.y, other.y)
    clean, longer = make(100, random_state=5), make(150, random_state=5)
    np.testing.assert_allclose(longer.u[:100], first.u, rtol=1e-12)
    np.testing.assert_allclose(longer.y[:100], clean.y, rtol=1e-9, atol=1e-12)
    seeded = make(100, noise=0.1, random_state=np.random.RandomState(5))
    np.testing.assert_array_equal(seeded.y, first.y)


@every_maker
def test_simulated_record_without_plant_pickles(make):
    record = replace(make(1, random_state=0), plant=None)
    assert len(record) == 1
    copy = pickle.loads(pickle.dumps(record))
    np.testing.assert_array_equal(copy.y, record.y)
    np.testing.assert_array_equal(copy.x0, record.x0)


@every_maker
@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"n_samples": 10.0}, TypeError, "`n_samples` must be an int, got 10.0"),
        ({"n_samples": True}, TypeError, "`n_samples` must be an int, got True"),
        ({"n_samples": 0}, ValueError, "`n_samples` must be at least 1, got 0"),
        ({"noise": "low"}, TypeError, "`noise` must be a number, got 'low'"),
        ({"noise": -0.1}, ValueError, "`noise` must be nonnegative and finite, got"),
        ({"noise": np.nan}, ValueError, "`noise` must be nonnegative and finite, got"),
        ({"amplitude": None}, TypeError, "`amplitude` must be a number, got None"),
        ({"amplitude": 0}, ValueError, "`amplitude` must be positive and finite, got"),
    ],
)
def test_maker_errors(make, arguments, error, message):
    with pytest.raises(error, match=message):
        make(**arguments)


# Simulated Wiener-Hammerstein plant


def test_plant_signals():
    plant = make_wiener_hammerstein(10, random_state=0).plant
    assert (plant.nstates, plant.ninputs, plant.noutputs) == (6, 1, 1)
    assert plant.input_labels == ["u"] and plant.output_labels == ["y"]
    assert plant.dt == DT


@pytest.fixture
def linear_part():
    """Return the plant where the saturation does not act: v < 0."""
    plant = make_wiener_hammerstein(10, random_state=0).plant
    return plant.linearize(np.full(6, -1e-3), [0.0], eps=1e-8)


def test_plant_has_the_poles_of_the_analog_filters(linear_part):
    poles = [
        signal.cheby1(3, 0.5, 2 * np.pi * 4_400, analog=True, output="zpk")[1],
        signal.cheby2(3, 40, 2 * np.pi * 5_000, analog=True, output="zpk")[1],
    ]
    expected = np.exp(np.concatenate(poles) * DT)  # of a zero-order hold
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(linear_part.A)),
        np.sort_complex(expected),
        atol=1e-6,  # forward difference, step 1e-8
    )


def test_plant_is_strictly_proper(linear_part):
    A, B, C, D = linear_part.A, linear_part.B, linear_part.C, linear_part.D
    assert np.all(D == 0) and np.all(C @ B == 0)  # one sample of delay per filter
    assert (C @ A @ B).item() > 1e-4


def test_plant_filters_meet_the_specification(linear_part):
    frequencies = np.linspace(0, 25_600, 1_025)  # Hz
    gain = 20 * np.log10(np.abs(linear_part(np.exp(2j * np.pi * DT * frequencies))))
    assert abs(gain[0]) < 1e-5  # dB
    assert gain[frequencies >= 5_000].max() < -39
    assert gain[frequencies <= 1_000].min() > -0.5


def test_saturation_acts_on_one_sign_only():
    plant = make_wiener_hammerstein(10, random_state=0).plant
    for u, expected in [(-1.0, -1.0), (1.0, 0.6 * np.tanh(1 / 0.6)), (50.0, 0.6)]:
        # both filters have a static gain of one, so y settles at f(u)
        y = simulate_plant(plant, np.full((600, 1), u), np.zeros(6))
        np.testing.assert_allclose(y[-1], expected, rtol=1e-10)


def test_record_is_far_from_linear():
    record = make_wiener_hammerstein(20_000, random_state=0)
    # 17 % for the simulated record; 18 % for the measured one, rows 5,200 to 45,199
    assert 0.14 < linear_floor(record) < 0.20
    almost_linear = make_wiener_hammerstein(20_000, amplitude=0.01, random_state=0)
    assert linear_floor(almost_linear) < 1e-3


def test_record_is_stationary_and_band_limited():
    record = make_wiener_hammerstein(50_000, random_state=0)
    u, y = record
    assert record.dt == DT
    assert u.std() == pytest.approx(0.7, rel=0.02)  # of 50,000 correlated samples
    # the first samples are as large as the others: no start from rest
    assert y[:100].std() > 0.5 * y.std()
    frequencies, power = signal.welch(u[:, 0], 1 / DT, nperseg=1_024)
    above = power[frequencies > 20_000].sum() / power.sum()
    assert above < 1e-4
    assert power[frequencies < 8_000].sum() / power.sum() > 0.7


# Simulated pendulum, Duffing oscillator, prey and predator


def pendulum_rates(t, x, u):
    return [x[1], u[0] - 9.81 * np.sin(x[0]) - 0.8 * x[1]]


def duffing_rates(t, x, u):
    return [x[1], u[0] - 0.1 * x[1] - x[0] - x[0] ** 3]


def prey_predator_rates(t, x, u):
    x1, x2, x3 = x
    return [
        0.2 * x1 - 0.01 * x1 * x2 - 0.05 * x1 * x3 + u[0] ** 2,
        0.1 * x2 - 0.01 * x1 * x2 - 0.05 * x2 * x3 + u[1] ** 2,
        -0.5 * x3 + 0.02 * x1 * x3 + 0.02 * x2 * x3,
    ]


@pytest.mark.parametrize(
    ("make", "rates"),
    [
        (make_pendulum, pendulum_rates),
        (make_duffing, duffing_rates),
        (make_prey_predator, prey_predator_rates),
    ],
)
def test_plant_integrates_its_equation(make, rates):
    record = make(40, random_state=0)
    exact = x = record.x0
    for k in range(40):
        held = (0, record.dt), exact
        solution = integrate.solve_ivp(
            rates, *held, args=(record.u[k],), rtol=1e-10, atol=1e-12
        )
        exact, x = solution.y[:, -1], record.plant.dynamics(k, x, record.u[k])
    np.testing.assert_allclose(x, exact, rtol=1e-4, atol=1e-5)


def test_prey_predator_is_bounded():
    record = make_prey_predator()
    assert record.u.shape == (50_000, 2) and record.dt == 0.05
    assert 4 < record.y.min() and record.y.max() < 30
    assert record.y[25_000:].std() == pytest.approx(1.476, abs=0.001)
    np.testing.assert_array_equal(record.x0, [30, 30, 20])
    t = 0.05 * 777
    expected = 2 * np.sin(t + 1) + 2 * np.sin(t / 10 + 1)
    assert record.u[777, 1] == pytest.approx(expected)


def test_pendulum_stays_below_the_top():
    for seed in range(5):
        u, y = make_pendulum(4_000, random_state=seed)
        assert np.abs(y).max() < 2 and np.abs(u).max() <= 4
        changes = np.diff(np.flatnonzero(np.diff(u[:, 0])))
        assert changes.min() >= 4 and changes.max() <= 30  # 0.2 to 1.5 s


def test_pendulum_over_the_top_on_request():
    arguments = {"amplitude": 8.0, "random_state": 0}
    with pytest.raises(ValueError, match="below the top"):
        make_pendulum(1_000, **arguments)
    record = make_pendulum(1_000, full_turns=True, **arguments)
    assert np.abs(record.y).max() > 2 * np.pi
    y = simulate_plant(record.plant, record.u, record.x0)
    np.testing.assert_array_equal(y, record.y)


@pytest.mark.parametrize("excitation", ["multisine", "stairs"])
def test_duffing_excitation(excitation):
    record = make_duffing(20_000, excitation=excitation, random_state=0)
    assert record.u.std() == pytest.approx(0.1, rel=0.03)
    if excitation == "multisine":
        frequencies, power = signal.welch(record.u[:, 0], 1 / 0.4, nperseg=1_024)
        above = power[frequencies > 3.2 / (2 * np.pi)].sum()
        assert above < 0.01 * power.sum()


@pytest.mark.parametrize(
    ("make", "floor"),
    [
        (make_pendulum, 0.107),
        (make_duffing, 0.321),
        (partial(make_duffing, excitation="stairs"), 0.156),
    ],
)
def test_oscillators_are_far_from_linear(make, floor):
    record = make(20_000, random_state=0)
    assert linear_floor(record, n_taps=400) == pytest.approx(floor, abs=0.02)
    # stationary: the start is as lively as the rest
    assert record.y[:500].std() > 0.4 * record.y.std()
    almost_linear = make(5_000, amplitude=0.001, random_state=0)
    assert linear_floor(almost_linear, n_taps=400) < 1e-3


@pytest.mark.parametrize(
    ("make", "arguments", "error", "message"),
    [
        (make_pendulum, {"gravity": "g"}, TypeError, "`gravity` must be a number"),
        (make_pendulum, {"damping": 0}, ValueError, "`damping` must be positive"),
        (make_pendulum, {"hold": 1.0}, ValueError, "`hold` must be 2 finite numbers"),
        (make_pendulum, {"hold": (2, 1)}, ValueError, "`hold` must be an increasing"),
        (make_pendulum, {"hold": (0, 1)}, ValueError, "`hold` must be an increasing"),
        (make_pendulum, {"amplitude": 30.0}, ValueError, "must keep the arm below"),
        (make_pendulum, {"amplitude": 1e300}, ValueError, "must keep the arm below"),
        (make_pendulum, {"amplitude": 1e308}, ValueError, "must keep the arm slow"),
        (
            partial(make_pendulum, full_turns=True),
            {"damping": 200.0},
            ValueError,
            "`damping` must keep the arm slow for its sampling time of 0.05 s, got 200",
        ),
        (
            partial(make_pendulum, full_turns=True),
            {"damping": 112.0},
            ValueError,
            "must keep the arm slow for its sampling time of 0.05 s, got 112",
        ),
        (make_fan_arm, {"damping": 200.0}, ValueError, "must keep the arm slow for"),
        (make_duffing, {"k1": -1.0}, ValueError, "`k1` must be positive and finite"),
        (make_duffing, {"k3": True}, TypeError, "`k3` must be a number, got True"),
        (make_duffing, {"amplitude": 1e6}, ValueError, "must keep the oscillator slow"),
        (make_duffing, {"excitation": "sine"}, ValueError, "must be 'multisine' or"),
        (make_prey_predator, {"a": 0.2}, ValueError, "`a` must be 2 finite numbers"),
        (make_prey_predator, {"d": (1, np.nan)}, ValueError, "`d` must be 2 finite"),
        (make_prey_predator, {"x0": "many"}, ValueError, "`x0` must be 3 finite"),
        (make_prey_predator, {"x0": (1, -1, 1)}, ValueError, "positive and finite pop"),
        (make_prey_predator, {"dt": 5.0}, ValueError, "positive and finite pop"),
        (make_prey_predator, {"e": 0}, ValueError, "`e` must be positive and finite"),
    ],
)
def test_plant_errors(make, arguments, error, message):
    with pytest.raises(error, match=message):
        make(1_000, random_state=0, **arguments)


# Measured Wiener-Hammerstein record


@pytest.fixture
def measured_home():
    home = os.environ.get("ALSSNN_DATA_HOME")
    if not home:
        pytest.skip("ALSSNN_DATA_HOME is not set")
    name = "WienerHammerBenchmark.csv"
    if not any((Path(home) / f / name).is_file() for f in ("wiener_hammerstein", "")):
        pytest.skip("the Wiener-Hammerstein record is not in ALSSNN_DATA_HOME")
    return home


@pytest.fixture
def small_record(monkeypatch):
    """Make the loader expect 10 rows: 0 to 5 for training, 6 to 9 for testing."""
    module = sys.modules[fetch_wiener_hammerstein.__module__]
    rows = {"train": slice(0, 6), "test": slice(6, 10)}
    monkeypatch.setattr(module, "LENGTH", 10)
    monkeypatch.setattr(module, "SPLITS", {"paper": rows})
    monkeypatch.delenv("ALSSNN_DATA_HOME", raising=False)
    lines = ['"uBenchMark","yBenchMark","fs",', "0,0.5,51200,"]
    return "\n".join([*lines, *(f"{k},{k + 0.5},," for k in range(1, 10)), "\n"])


def write_record(folder, text):
    folder.mkdir(exist_ok=True)
    path = folder / "WienerHammerBenchmark.csv"
    path.write_text(text, encoding="utf-8")
    return path


def assert_is_small_record(train, test):
    assert (len(train), len(test)) == (6, 4)
    np.testing.assert_array_equal(train.u[:, 0], np.arange(6))
    np.testing.assert_array_equal(test.y[:, 0], np.arange(6, 10) + 0.5)
    assert train.dt == test.dt == DT
    assert train.name == "Wiener-Hammerstein, paper train"
    assert test.name == "Wiener-Hammerstein, paper test"


def test_fetch_measured_record_paper_split(measured_home):
    train, test = fetch_wiener_hammerstein()
    assert train.u.shape == train.y.shape == (100_000, 1)
    assert test.u.shape == test.y.shape == (88_000, 1)
    assert train.dt == test.dt == DT
    # first and last rows as they stand in the published file
    assert (train.u[0, 0], train.y[0, 0]) == (-0.11605, 0.083432)
    assert (test.u[-1, 0], test.y[-1, 0]) == (-0.0058368, -0.0065235)


def test_fetch_measured_record_official_split(measured_home):
    train, test = fetch_wiener_hammerstein(split="official")
    assert (len(train), len(test)) == (100_000, 78_800)
    # the input is active from the first sample to the last
    for part in (train.u[:500], train.u[-500:], test.u[:500], test.u[-500:]):
        assert part.std() > 0.3


def test_splits_of_measured_record_agree(measured_home):
    paper = np.vstack([r.y for r in fetch_wiener_hammerstein(measured_home)])
    official = np.vstack([r.y for r in fetch_wiener_hammerstein(split="official")])
    np.testing.assert_array_equal(official, paper[5_200:184_000])


@pytest.mark.parametrize("folder", ["wiener_hammerstein", "."])
def test_fetch_finds_file_in_data_home(small_record, tmp_path, folder):
    write_record(tmp_path / folder, small_record)
    assert_is_small_record(*fetch_wiener_hammerstein(tmp_path))
    assert_is_small_record(*fetch_wiener_hammerstein(str(tmp_path)))


def test_fetch_finds_file_by_environment(small_record, tmp_path, monkeypatch):
    write_record(tmp_path, small_record)
    monkeypatch.setenv("ALSSNN_DATA_HOME", str(tmp_path))
    assert_is_small_record(*fetch_wiener_hammerstein())


@pytest.mark.parametrize("variable", [None, ""])
def test_fetch_finds_file_in_user_home(small_record, tmp_path, monkeypatch, variable):
    write_record(tmp_path / "alssnn_data", small_record)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    if variable is not None:
        monkeypatch.setenv("ALSSNN_DATA_HOME", variable)
    assert_is_small_record(*fetch_wiener_hammerstein())


def test_fetch_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="was not found, looked for") as error:
        fetch_wiener_hammerstein(tmp_path)
    message = str(error.value)
    path = tmp_path / "wiener_hammerstein" / "WienerHammerBenchmark.csv"
    for part in (str(path), "nonlinearbenchmark.org", "ALSSNN_DATA_HOME", "[data]"):
        assert part in message


@pytest.mark.parametrize("split", ["other", ["paper"], None])
def test_fetch_unknown_split(tmp_path, split):
    with pytest.raises(ValueError, match="`split` must be 'paper' or 'official', got"):
        fetch_wiener_hammerstein(tmp_path, split=split)


def test_fetch_wrong_header(small_record, tmp_path):
    write_record(tmp_path, small_record.replace("uBenchMark", "V1"))
    with pytest.raises(ValueError, match="must start with the columns uBenchMark, yB"):
        fetch_wiener_hammerstein(tmp_path)


def test_fetch_binary_file(tmp_path):
    write_record(tmp_path, "").write_bytes(bytes(range(256)))
    with pytest.raises(ValueError, match="must start with the columns"):
        fetch_wiener_hammerstein(tmp_path)


def test_fetch_garbled_row(small_record, tmp_path):
    write_record(tmp_path, small_record.replace("\n3,", "\nthree,"))
    with pytest.raises(ValueError, match="must hold numbers below its header, got"):
        fetch_wiener_hammerstein(tmp_path)


def test_fetch_truncated_file(small_record, tmp_path):
    write_record(tmp_path, small_record[: small_record.index("\n8,")])
    with pytest.raises(ValueError, match="must hold 10 samples, got 8"):
        fetch_wiener_hammerstein(tmp_path)


def test_fetch_downloads_through_nonlinear_benchmarks(
    small_record, tmp_path, monkeypatch
):
    def load(train_test_split):
        """Stand in for the loader of nonlinear_benchmarks, which returns (u, y)."""
        assert train_test_split is False
        return np.arange(10.0), np.arange(10.0) + 0.5

    package = SimpleNamespace(WienerHammerBenchMark=load)
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", package)
    train, test = fetch_wiener_hammerstein(tmp_path, download_if_missing=True)
    assert_is_small_record(train, test)


def test_fetch_prefers_the_file_to_a_download(small_record, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", None)
    write_record(tmp_path, small_record)
    train, test = fetch_wiener_hammerstein(tmp_path, download_if_missing=True)
    assert_is_small_record(train, test)


def test_fetch_download_without_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "nonlinear_benchmarks", None)
    with pytest.raises(ImportError, match="needs the package nonlinear_benchmarks"):
        fetch_wiener_hammerstein(tmp_path, download_if_missing=True)

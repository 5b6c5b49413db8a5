"""Loaders of the measured records beside the Wiener-Hammerstein circuit."""

import os

import numpy as np
import pytest
from scipy.io import savemat

from alssnn.datasets import (
    fetch_cascaded_tanks,
    fetch_classics,
    fetch_coupled_drives,
    fetch_fine_steering_mirror,
    fetch_quarter_drone,
    fetch_silverbox,
)

HOME = os.environ.get("ALSSNN_DATA_HOME")  # before the tests hide it
LOADERS = {
    "coupled_electric_drives": fetch_coupled_drives,
    "cascaded_tanks": fetch_cascaded_tanks,
    "silverbox": fetch_silverbox,
    "quarter_drone": fetch_quarter_drone,
    "classics": fetch_classics,
    "fine_steering_mirror": fetch_fine_steering_mirror,
}


@pytest.fixture(autouse=True)
def no_data_home(monkeypatch, tmp_path):
    """Keep the loaders of fabricated files away from the real ones."""
    monkeypatch.delenv("ALSSNN_DATA_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))


def measured(folder, home=HOME):
    """Return what a loader finds in the real data home."""
    if not os.path.isdir(os.path.join(home or "?", folder)):
        pytest.skip(f"{folder} is not in ALSSNN_DATA_HOME")
    return LOADERS[folder](home)


def write_columns(path, names, length, quote="", tail=""):
    """Write a CSV file whose entry in row k and column j is k + j / 100."""
    path.parent.mkdir(parents=True, exist_ok=True)
    header = ",".join(f"{quote}{name}{quote}" for name in names) + tail
    rows = [
        ",".join(f"{k + j / 100:.2f}" for j in range(len(names))) + tail
        for k in range(length)
    ]
    path.write_text("\n".join([header, *rows, ""]), encoding="utf-8")
    return path


def assert_column(signal, j, first=0):
    """Check a signal against column `j` of `write_columns`, from row `first` on."""
    k = np.arange(first, first + len(signal))
    np.testing.assert_allclose(signal, (k + j / 100)[:, None], atol=1e-12)


def write_drone(folder):
    columns = ["Tempo_s", "Referencia", "Saida_y", "Controle_u"]
    for name, length in (
        ("sinal2_degraus", 10_000),
        ("sinal3_swept_sine", 10_001),
        ("sinal4_multiseno", 10_000),
    ):
        write_columns(folder / f"{name}_malha_fechada.csv", columns, length)
    columns = ["tempo_ms", "angulo_deg", "u_pct", "referencia"]
    return write_columns(folder / "dados_14_drone.csv", columns, 17_537)


@pytest.mark.parametrize("folder", ["coupled_electric_drives", "."])
def test_coupled_drives_are_pairs_of_experiments(tmp_path, folder):
    path = tmp_path / folder / "DATAUNIF.csv"
    write_columns(path, ["u11", "u12", "z11", "z12"], 500, '"', ",")
    train, test = fetch_coupled_drives(tmp_path)
    assert [len(r) for r in train + test] == [400, 400, 100, 100]
    for i, (a, b) in enumerate(zip(train, test, strict=True)):
        assert_column(a.u, i)
        assert_column(a.y, i + 2)
        assert_column(b.y, i + 2, first=400)
        assert a.dt == b.dt == 0.02
    u, y = zip(*train, strict=True)  # straight into fit
    assert [s.shape for s in (*u, *y)] == [(400, 1)] * 4


def test_drives_with_prbs_name_the_output_first(tmp_path):
    names = ["z1", "u1", "z2", "u2", "z3", "u3"]
    write_columns(tmp_path / "DATAPRBS.csv", names, 500, '"', ",")
    train, test = fetch_coupled_drives(tmp_path, excitation="prbs")
    assert len(train) == len(test) == 3
    assert_column(train[2].u, 5)
    assert_column(train[2].y, 4)


@pytest.mark.parametrize("excitation", ["sine", None, ["prbs"]])
def test_drives_unknown_excitation(tmp_path, excitation):
    with pytest.raises(ValueError, match="must be 'uniform' or 'prbs', got"):
        fetch_coupled_drives(tmp_path, excitation)


def test_tanks(tmp_path):
    names = ["uEst", "uVal", "yEst", "yVal", "Ts"]
    write_columns(tmp_path / "dataBenchmark.csv", names, 1024)
    train, test = fetch_cascaded_tanks(tmp_path)
    assert_column(train.u, 0)
    assert_column(test.u, 1)
    assert_column(train.y, 2)
    assert_column(test.y, 3)
    assert train.dt == 4.0


def test_silverbox_splits(tmp_path):
    k = np.arange(131_072.0)
    savemat(tmp_path / "SNLS80mV.mat", {"V1": k[None], "V2": -k[None]})
    train, tests = fetch_silverbox(tmp_path)
    rows = {name: (int(r.u[0, 0]), int(r.u[-1, 0])) for name, r in tests.items()}
    assert rows == {
        "multisine": (105_712, 127_399),
        "arrow": (100, 40_574),
        "arrow, no extrapolation": (100, 32_099),
    }
    assert (train.u[0, 0], train.u[-1, 0]) == (40_650, 105_711)
    np.testing.assert_array_equal(train.y, -train.u)
    assert 1 / train.dt == pytest.approx(610.35, abs=0.01)


@pytest.mark.parametrize("content", [b"", b"not a MATLAB file" * 20, "V1", 5])
def test_silverbox_foreign_file(tmp_path, content):
    path = tmp_path / "SNLS80mV.mat"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content == "V1":
        savemat(path, {"V1": np.zeros(131_072)})
    else:
        savemat(path, {"V1": np.zeros(content), "V2": np.zeros(content)})
    with pytest.raises(ValueError, match=r"must (be a MATLAB file|hold 131072 sam)"):
        fetch_silverbox(tmp_path)


def test_drone_runs(tmp_path):
    write_drone(tmp_path / "quarter_drone")
    runs = fetch_quarter_drone(tmp_path)
    assert list(runs) == ["steps", "multisine", "swept sine", "staircase"]
    assert [len(r) for r in runs.values()] == [10_000, 10_000, 10_001, 17_537]
    assert_column(runs["steps"].u, 3)
    assert_column(runs["steps"].y, 2)
    assert_column(runs["staircase"].u, 2)
    assert_column(runs["staircase"].y, 1)
    assert {r.dt for r in runs.values()} == {0.01}


def write_mirror(folder):
    """Write arrays that tell of their level, channel, realization and period."""
    folder.mkdir(parents=True, exist_ok=True)
    shape = np.indices((3, 6, 2))
    tags = (100 * shape[0] + 10 * shape[1] + shape[2])[None]  # channel, run, period
    for level in (100, 200, 300):
        for part, runs in (("train", 6), ("test", 3)):
            for z, sign in (("u", 1.0), ("y", -1.0)):
                array = np.tile(
                    sign * (1_000 * level + tags[:, :, :runs]), (8192, 1, 1, 1)
                )
                np.save(folder / f"{z}_{level}mV_{part}.npy", array)


@pytest.mark.parametrize("folder", ["fine_steering_mirror", "."])
def test_mirror_averages_the_periods_of_the_training(tmp_path, folder):
    write_mirror(tmp_path / folder)
    train, tests = fetch_fine_steering_mirror(tmp_path)
    assert len(train) == 18
    assert list(tests) == ["100 mV", "200 mV", "300 mV"]
    np.testing.assert_array_equal(train[7].u[0], 200_010.5 + np.array([0, 100, 200]))
    np.testing.assert_array_equal(train[7].y, -train[7].u)
    last = tests["300 mV"][5]  # third realization, second period
    np.testing.assert_array_equal(last.y[0], -300_021.0 - np.array([0, 100, 200]))
    assert train[0].dt == 1 / 6400


def test_mirror_foreign_arrays(tmp_path):
    write_mirror(tmp_path)
    np.save(tmp_path / "u_100mV_train.npy", np.zeros((8192, 3, 5, 2)))
    with pytest.raises(ValueError, match=r"must have shape \(8192, 3, 6, 2\), got"):
        fetch_fine_steering_mirror(tmp_path)
    for content in ("no array", ""):
        (tmp_path / "u_100mV_train.npy").write_text(content)
        with pytest.raises(ValueError, match=r"must be an array of NumPy, got: .*git"):
            fetch_fine_steering_mirror(tmp_path)


def write_classics(folder):
    k = np.arange(2_500.0)
    savemat(folder / "actuator.mat", {"u": k[:1024, None], "p": -k[:1024, None]})
    savemat(folder / "tank.mat", {"u": k[None], "y": np.stack([k + 1, k + 2])})
    for name, length in (("ballbeam", 1_000), ("dryer", 1_000), ("flutter", 1_024)):
        np.savetxt(folder / f"{name}.dat", np.stack([k, -k], axis=1)[:length])
    np.savetxt(
        folder / "gas_furnace.csv",
        np.stack([k, -k], axis=1)[:296],
        delimiter=",",
        header="InputGasRate,CO2",
        comments="",
    )


def test_classics(tmp_path):
    write_classics(tmp_path)
    records = fetch_classics(tmp_path)
    assert [len(r) for r in records.values()] == [1024, 1000, 1000, 1024, 296, 2500]
    tanks = records.pop("two tanks")
    assert tanks.u.shape == (2_500, 1) and tanks.dt == 0.2
    np.testing.assert_array_equal(tanks.y[3], [4.0, 5.0])
    for record in records.values():
        np.testing.assert_array_equal(record.u[:, 0], np.arange(len(record)))
        np.testing.assert_array_equal(record.y, -record.u)


def test_classics_foreign_and_short_files(tmp_path):
    write_classics(tmp_path)
    (tmp_path / "dryer.dat").write_text("1 2\n3 4\n")
    with pytest.raises(ValueError, match="must hold 1000 samples, got 2"):
        fetch_classics(tmp_path)
    savemat(tmp_path / "actuator.mat", {"u": np.zeros((1024, 1))})
    with pytest.raises(ValueError, match="must hold an input and an output"):
        fetch_classics(tmp_path)


def test_truncated_and_renamed_files(tmp_path):
    path = write_drone(tmp_path)
    text = path.read_text()
    path.write_text(text[: text.rindex("\n17536")])
    with pytest.raises(ValueError, match="must hold 17537 samples, got 17536"):
        fetch_quarter_drone(tmp_path)
    path.write_text(text.replace("u_pct", "u_V"))
    with pytest.raises(ValueError, match="must start with the columns tempo_ms"):
        fetch_quarter_drone(tmp_path)


@pytest.mark.parametrize("folder", LOADERS)
def test_missing_file_names_folder_and_source(tmp_path, folder):
    with pytest.raises(FileNotFoundError, match="was not found, looked for") as error:
        LOADERS[folder](tmp_path)
    message = str(error.value)
    assert str(tmp_path / folder) in message
    assert "ALSSNN_DATA_HOME" in message
    assert "download_if_missing" not in message  # these loaders have no such argument
    own = {"quarter_drone", "classics", "fine_steering_mirror"}  # not from there
    assert ("nonlinearbenchmark.org" in message) == (folder not in own)


def test_measured_drives():
    train, test = measured("coupled_electric_drives")
    # first and last rows as they stand in the published file
    assert (train[0].u[0, 0], train[1].u[0, 0]) == (1.6961, 2.1961)
    assert (test[0].y[-1, 0], test[1].y[-1, 0]) == (1.5849, 2.5177)
    for record in train + test:
        assert record.y.min() > -0.03  # a speed without sign, and a bias


def test_measured_tanks():
    train, test = measured("cascaded_tanks")
    assert (train.u[0, 0], train.y[0, 0], test.y[-1, 0]) == (3.2567, 5.205, 3.7179)
    assert train.y.max() == test.y.max() == 10.0  # the sensor saturates


def test_measured_silverbox():
    train, tests = measured("silverbox")
    largest = {name: np.abs(r.y).max() for name, r in tests.items()}
    assert largest["arrow"] > 1.3 * np.abs(train.y).max()  # it does extrapolate
    assert largest["multisine"] < 1.1 * np.abs(train.y).max()


def test_measured_drone():
    runs = measured("quarter_drone")
    assert (runs["steps"].y[0, 0], runs["staircase"].y[0, 0]) == (2.7, 0.41)
    for record in runs.values():
        assert -2 < record.y.min() < 1 < 70 < record.y.max() < 100  # degrees
        assert 50 < record.u.max() < 65 or "staircase" in record.name  # per cent


def test_measured_mirror():
    train, tests = measured("fine_steering_mirror")
    assert [len(test) for test in tests.values()] == [6, 6, 6]
    levels = [np.mean([r.u.std() for r in train[i : i + 6]]) for i in (0, 6, 12)]
    np.testing.assert_allclose(np.divide(levels, levels[0]), [1, 2, 3], rtol=0.05)
    first, second = tests["100 mV"][:2]  # two periods of one realization
    np.testing.assert_allclose(first.u, second.u, atol=0.02 * first.u.std())


def test_measured_classics():
    records = measured("classics")
    assert all(r.y.std() > 0 for r in records.values())
    assert records["gas furnace"].u[0, 0] == -0.109  # first row of the file
    assert records["gas furnace"].y[0, 0] == 53.8

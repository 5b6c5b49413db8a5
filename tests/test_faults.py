"""What must not be lost or confused when something goes wrong."""

import io
import json
import subprocess
import sys
import textwrap
import time
import zipfile

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

import alssnn
from alssnn import FlSsnn, LinearStateSpace, whole_files
from alssnn.cli import _record
from alssnn.tables import read_csv, read_steps
from alssnn.whole_files import replace_file


def record(n=300, seed=0):
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=(n, 1)), np.zeros(n)
    for k in range(n - 1):
        y[k + 1] = 0.9 * y[k] + 0.1 * u[k, 0]
    return u, y + 0.01 * rng.normal(size=n)


# -- data ------------------------------------------------------------------------------


@pytest.mark.parametrize("constant", [0.0, 20.0, 20.1, 1e6 / 3])
def test_a_dead_sensor_is_named_and_harms_nobody(constant):
    u, y = record()
    with pytest.warns(UserWarning, match="`y` does not move in column 1"):
        model = LinearStateSpace(nx=1).fit(u, np.c_[y, np.full(len(y), constant)])
    alone = LinearStateSpace(nx=1).fit(u, y)
    assert model.y_offset_[1] == pytest.approx(constant)
    y_hat = model.predict(u, x0=model.x0_)
    np.testing.assert_allclose(
        y_hat[:, 0], alone.predict(u, x0=alone.x0_), atol=1e-3 * np.std(y)
    )


@pytest.mark.parametrize("factor", [1e155, 1e35, 1e-35, 1e-170])
def test_units_beyond_the_range_of_squares_are_refused(factor):
    u, y = record()
    with pytest.raises(ValueError, match=r"squares are numbers.*Rescale"):
        LinearStateSpace(nx=1).fit(factor * u, y)
    with pytest.raises(ValueError, match=r"squares are numbers.*Rescale"):
        LinearStateSpace(nx=1).fit(u, factor * y)


def test_one_input_needs_no_column():
    u, y = record()
    expected = LinearStateSpace(nx=1).fit(u, y)
    pandas = pytest.importorskip("pandas")
    for flat in (u[:, 0], u[:, 0].tolist(), pandas.Series(u[:, 0], name="valve")):
        model = LinearStateSpace(nx=1).fit(flat, y)
        np.testing.assert_array_equal(model.A_, expected.A_)
        np.testing.assert_array_equal(
            np.ravel(model.predict(flat)), expected.predict(u)
        )
        assert model.score(flat, y) == expected.score(u, y)
    assert model.feature_names_in_ == ["valve"]


def test_time_along_the_columns_gets_a_remedy():
    u, y = record()
    with pytest.raises(ValueError, match=r"one row per sample.*pass u\.T"):
        LinearStateSpace(nx=1).fit(u.T, y)


# -- fits that do not come to an end ---------------------------------------------------

REFUSED = [
    lambda m, u, y: m.fit(u[:3] * 1000, y[:3] * 50 + 7),
    lambda m, u, y: m.fit(1000 * u, 50 * y + 7, experiment=np.arange(7)),
    lambda m, u, y: m.set_params(input_delay=[1, 2]).fit(1000 * u, 50 * y + 7),
    lambda m, u, y: m.set_params(output_weight=[-1]).fit(1000 * u, 50 * y + 7),
]


@pytest.mark.parametrize("again", REFUSED)
def test_a_refused_fit_leaves_the_model_that_was_there(again):
    u, y = record()
    model = LinearStateSpace(nx=1).fit(u, y)
    before = {k: v for k, v in vars(model).items() if k.endswith("_")}
    score = model.score(u, y)
    with pytest.raises(ValueError):
        again(model, u, y)
    assert model.score(u, y) == score
    assert {k for k in vars(model) if k.endswith("_")} == set(before)


def test_an_interrupt_before_there_is_a_result_changes_nothing(monkeypatch):
    u, y = record()
    model = LinearStateSpace(nx=1).fit(u, y)
    score = model.score(u, y)

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(LinearStateSpace, "_identify", interrupted)
    with pytest.raises(KeyboardInterrupt):
        model.fit(1000 * u, 50 * y + 7)
    assert model.score(u, y) == score


def test_a_first_fit_that_is_refused_leaves_an_unfitted_model():
    u, y = record()
    model = LinearStateSpace(nx=1)
    with pytest.raises(ValueError):
        model.fit(u[:3], y[:3])
    with pytest.raises(NotFittedError):
        model.predict(u)


# -- files -----------------------------------------------------------------------------


def test_a_file_that_cannot_be_completed_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "model.npz"
    replace_file(path, "old")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        replace_file(path, b"new")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_keeps_its_permissions_and_a_link_stays_one(tmp_path):
    path, link = tmp_path / "model.npz", tmp_path / "link.npz"
    replace_file(path, "old")
    path.chmod(0o640)
    link.symlink_to(path)
    replace_file(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640


# the module alone, for the package takes a second to import
KILLED = """
    import runpy, sys
    replace_file = runpy.run_path(sys.argv[1])["replace_file"]
    print("ready", flush=True)
    while True:
        replace_file(sys.argv[2], bytes(30_000))
"""


def test_kills_leave_a_whole_file(tmp_path):
    path = tmp_path / "model.npz"
    replace_file(path, bytes(30_000))
    rng = np.random.default_rng(0)
    for _ in range(20):
        code = textwrap.dedent(KILLED)
        command = [sys.executable, "-c", code, whole_files.__file__, str(path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            process.stdout.readline()
            time.sleep(0.02 * rng.random())
            process.kill()
        assert path.stat().st_size == 30_000


def test_a_packed_member_is_refused_before_it_is_read(tmp_path):
    u, y = record()
    path = tmp_path / "model.npz"
    LinearStateSpace(nx=1).fit(u, y).save(path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("extra.npy", bytes(100_000_000))
    with pytest.raises(ValueError, match="a compressed member, extra"):
        alssnn.load(path)


def test_a_member_that_claims_to_be_huge_is_refused(tmp_path):
    u, y = record()
    path, forged = tmp_path / "model.npz", tmp_path / "forged.npz"
    LinearStateSpace(nx=1).fit(u, y).save(path)
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(forged, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "x0.npy":
                assert b"(1, 1), }        " in data
                data = data.replace(b"(1, 1), }        ", b"(1, 900000000), }")
            new.writestr(name, data)
    with pytest.raises(ValueError, match="too large an array, x0"):
        alssnn.load(forged)


def test_a_fit_that_diverged_on_validation_data_is_saved(tmp_path):
    rng = np.random.default_rng(2)
    u, y = rng.normal(size=(60, 1)), np.zeros(60)
    for k in range(59):
        y[k + 1] = 1.05 * y[k] + u[k, 0]
    model = FlSsnn(
        nx=1,
        n_h=2,
        max_iter=5,
        alpha=0.0,
        stability=None,
        random_state=0,
        linear_start=([[1.05]], [[1.0]], [[1.0]]),
    )
    with pytest.warns(UserWarning):
        model.fit(u, y, validation=(rng.normal(size=(3000, 1)), rng.normal(size=3000)))
    assert np.inf in [step.validation_rmse for step in model.history_]
    path = tmp_path / "model.npz"
    model.save(path)
    assert alssnn.load(path).history_ == model.history_
    json.dumps([list(step) for step in model.history_])


# -- tables ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("u,y\n0,125,0,012\n", "as many cells in a line as its header, 2, got 4"),
        ("u,y\n1_0,2\n", "got '1_0' in column 'u' at line 2"),
        ("u,y\n1,\uff12\n", "in column 'y' at line 2"),
    ],
)
def test_cells_that_are_no_numbers_are_refused(tmp_path, text, message):
    path = tmp_path / "plant.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message):
        read_csv(path, ["u"], ["y"])


@pytest.mark.parametrize(
    ("cell", "remedy"),
    [
        ("0,05", "Write decimal points, not commas."),
        ("-1,5e-3", "Write decimal points, not commas."),
        ("2024-05-01T12:00:00.050", "write a column of seconds, or read the file"),
        ("1.5.2024 12:00", "Record.from_dataframe and on_grid of alssnn.datasets take"),
        ("05/01/24", "Dates and clocks are no numbers"),
        ("12:00:00", "Dates and clocks are no numbers"),
        ("1,5,2", None),
        ("1-2-on", None),
    ],
)
@pytest.mark.parametrize("role", ["input", "output"])
def test_dates_and_decimal_commas_are_called_so(tmp_path, cell, remedy, role):
    path = tmp_path / "plant.csv"
    path.write_text(f"t;y\n{cell};2\n", encoding="utf-8")
    columns = (["t"], ["y"]) if role == "input" else ([], ["t"])
    with pytest.raises(ValueError, match="in column 't' at line 2") as caught:
        read_csv(path, *columns)
    usual = "fill the gap" if role == "input" else "Leave the cell empty"
    assert (usual in str(caught.value)) == (remedy is None)
    assert (remedy or usual) in str(caught.value)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be"])
def test_another_encoding_is_called_so(tmp_path, encoding, monkeypatch):
    path = tmp_path / "plant.csv"
    path.write_text("t,u,y\n0,1,2\n1,2,3\n", encoding=encoding)
    stream = io.TextIOWrapper(io.BytesIO(path.read_bytes()))
    monkeypatch.setattr(sys, "stdin", stream)
    for source in (path, _record.source_of("-")):
        for read in (read_steps, lambda source: read_csv(source, ["u"], ["y"])):
            with pytest.raises(ValueError, match=r"must be text in UTF-8.* Save it as"):
                read(source)

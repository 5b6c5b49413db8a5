"""The benchmark of the recordings runs, and its table says what was measured."""

import csv

import numpy as np
import pytest

from alssnn import LinearStateSpace
from alssnn.datasets import Record, make_pendulum
from alssnn.metrics import rmse
from benchmarks import recordings
from models import gr_ssnn

MODELS = {
    "LTI": LinearStateSpace(nx=2, integrators=0, operating_point="zero"),
    "GR": gr_ssnn(2, 2, operating_point="zero", max_iter=3),
}


def pendulums():
    """Return two training records and two tests of a pushed pendulum."""
    runs = [make_pendulum(400, random_state=i).split(300) for i in (0, 1)]
    train, test = zip(*runs, strict=True)
    return list(train), {f"experiment {i}": r for i, r in enumerate(test, start=1)}


def without_sign():
    """Return the same without the sign of the angle."""

    def absolute(record):
        return Record(record.u, np.abs(record.y), record.dt, record.name)

    train, tests = pendulums()
    return [*map(absolute, train)], {k: absolute(r) for k, r in tests.items()}


@pytest.fixture
def fabricated(monkeypatch, tmp_path):
    published = {"somebody": {"experiment 1": 0.5}}
    entries = {
        "signed": recordings.Recording(pendulums, MODELS, "mrad", published, 1e3),
        "no sign": recordings.Recording(without_sign, MODELS, "rad", rectified=True),
    }
    monkeypatch.setattr(recordings, "RECORDINGS", entries)
    monkeypatch.setattr(recordings, "OUT", tmp_path)
    return tmp_path


def test_rows_are_the_errors_of_the_models(fabricated, capsys):
    assert recordings.main(["--record", "signed", "--seeds", "2"]) == 0
    with (fabricated / "recordings.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * (1 + 2)  # tests, times seeds where there is one
    train, tests = pendulums()
    model = LinearStateSpace(
        nx=2, integrators=0, operating_point="zero", dt=train[0].dt
    )
    model.fit(*zip(*train, strict=True))
    for row in rows[:2]:
        error = 1e3 * rmse(*model.simulate_test(*tests[row["test"]]))
        assert float(row["rmse"]) == pytest.approx(error, rel=1e-4)
    # a second recording joins the table, a repeated one replaces its rows
    for name in ("no sign", "signed"):
        assert recordings.main(["--record", name, "--seeds", "1"]) == 0
    page = (fabricated / "recordings.md").read_text("utf-8")
    assert page.count("| signed | experiment 1 | GR | 1 |") == 1
    assert page.count("| no sign | experiment 2 | GR | 1 |") == 1
    assert "| signed | experiment 1 | somebody | | 0.500 | | mrad |" in page
    assert "Choices were made on training data alone" in page
    assert "somebody" in capsys.readouterr().out


def test_outputs_without_sign_are_simulated_on_from_the_training(fabricated):
    entry = recordings.RECORDINGS["no sign"]
    train, tests = without_sign()
    u, y = zip(*train, strict=True)
    model = LinearStateSpace(
        nx=2, integrators=0, operating_point="zero", dt=train[0].dt
    ).fit(u, y)
    errors = recordings.score(entry, model, train, tests, y)
    whole = [np.vstack([a.u, b.u]) for a, b in zip(train, tests.values(), strict=True)]
    for i, s in enumerate(model.predict(whole, x0="training")):
        test = tests[f"experiment {i + 1}"]
        expected = rmse(test.y, np.abs(s[300:]))
        assert errors[f"experiment {i + 1}"][0] == pytest.approx(expected)


def test_a_missing_data_home_is_said_and_leaves_the_table_alone(
    monkeypatch, tmp_path, capsys
):
    monkeypatch.setenv("ALSSNN_DATA_HOME", str(tmp_path))
    monkeypatch.setattr(recordings, "OUT", tmp_path)
    assert recordings.main(["--record", "drives", "tanks"]) == 1
    assert "DATAUNIF.csv was not found" in capsys.readouterr().out
    assert not (tmp_path / "recordings.csv").exists()


def test_the_published_table_covers_every_recording():
    path = recordings.OUT / "recordings.csv"
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = {(row["recording"], row["model"]) for row in rows}
    expected = {
        (name, label)
        for name, entry in recordings.RECORDINGS.items()
        for label in entry.models
    }
    assert found == expected

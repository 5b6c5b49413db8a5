"""The lines of the page of tasks run, do what they say, and are three at most."""

import re
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

from alssnn.datasets import make_pendulum

pd = pytest.importorskip("pandas")
PAGE = (Path(__file__).parents[1] / "doc" / "tasks.rst").read_text(encoding="utf-8")
TASKS = [
    "Read a CSV file",
    "Keep names and units",
    "Plot the data",
    "Take out the drift",
    "Reduce the sampling rate",
    "Split",
    "Merge",
    "Find the delay",
    "Compare two models",
    "Bode plot with a confidence band",
    "Step response",
    "Estimate the initial state",
    "Close the loop, with saturation, and plot it",
    "Run the controller online",
    "Save a model",
    "Tune gamma",
]

SHORTER = {  # one random start, and no search over decays or for integrators
    "Compare two models": [
        ("FlSsnn(nx=2, dt=", "FlSsnn(nx=2, n_init=1, alpha=1e-4, integrators=0, dt=")
    ],
    "Tune gamma": [("max_iter=20", "max_iter=20, n_init=1, alpha=1e-4, integrators=0")],
}


def blocks():
    """Return the lines of every task, by its bold words; the imports first."""
    start = re.search(r"\.\. code-block:: python\n\n((?:   .*\n)+)", PAGE).group(1)
    found = {"": textwrap.dedent(start)}
    for row in PAGE.split("   * - ")[2:]:
        title = re.match(r"\*\*([^*]*?)\.?\*\*", row).group(1)
        code = re.search(r"code-block:: python\n\n((?:          .*\n)+)", row).group(1)
        found[title] = textwrap.dedent(code)
    return found


def test_there_are_sixteen_of_three_lines():
    found = blocks()
    assert list(found) == ["", *TASKS]
    for title in TASKS:
        assert len(found[title].splitlines()) <= 3, title


@pytest.fixture(scope="module")
def names(tmp_path_factory):
    """Return what there is after all lines."""
    folder = tmp_path_factory.mktemp("tasks")
    plain = make_pendulum(2000, amplitude=5.0, noise=0.01, random_state=3)
    t = plain.dt * np.arange(len(plain))
    columns = [
        ("time", t),
        ("torque [Nm]", plain.u[:, 0]),
        ("angle [rad]", plain.y[:, 0]),
    ]
    pd.DataFrame(dict(columns)).to_csv(folder / "arm.csv", index=False)
    names = {"plain": plain, "folder": folder}
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", ConvergenceWarning)
        for title, code in blocks().items():
            for old, new in SHORTER.get(title, []):
                assert code.count(old) == 1, old
                code = code.replace(old, new)
            exec(code, names)
    return names


def test_they_do_what_they_say(names):
    record, plain = names["record"], names["plain"]
    assert record.dt == pytest.approx(plain.dt) and len(record) == 2000
    assert list(names["train"].to_frames()[1]) == ["angle [rad]"]
    assert (names["folder"] / "data.png").stat().st_size > 10_000
    assert names["slow"].dt == pytest.approx(2 * plain.dt)
    assert (len(names["train"]), len(names["test"])) == (1400, 600)
    assert names["both"].experiments_ == [0, 1]
    # none, but the first sample of an answer from rest is smaller than the noise
    assert names["late"].input_delay_[0] in (0, 1)
    assert np.abs(names["without"].y.mean() - plain.y.mean()) < 1e-12


def test_models_keep_names_and_are_compared(names):
    assert names["model"].plant_.inputs == ["torque [Nm]"]
    assert names["linear"].output_names_ == ["angle [rad]"]
    magnitude = names["bode"].axes_[0, 0]
    assert magnitude.get_ylabel() == "|angle [rad] /\ntorque [Nm]|, dB"
    assert len(magnitude.lines) == 2 and len(magnitude.collections) == 1
    y = names["test"].y[100:, 0]
    error = y - np.ravel(names["y_hat"])[100:]
    np.testing.assert_array_equal(names["again"].A_, names["model"].A_)
    assert error.std() < 0.05 * y.std()


def test_the_loop_runs(names):
    run = names["run"]
    assert abs(run.y[-1, 0] - 0.5) < 0.01
    assert run.saturated.any() and run.u.max() <= 8
    assert (names["folder"] / "loop.png").stat().st_size > 10_000
    assert -8 <= names["u_now"][0] <= 8
    assert np.isfinite(names["path"].rmse_test).all()
    assert names["step"].outputs.shape == names["step"].time.shape

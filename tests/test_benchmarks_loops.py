"""The benchmark of loops, and the true plants behind the records of the field."""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from alssnn import AlSsnn, FlSsnn
from benchmarks import loops
from benchmarks.field.case import Case, Data, columns, simulated
from benchmarks.field.signals import heard, iterate
from benchmarks.field.truth import truth

pytestmark = pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")

OPTIONS = {"nx": 3, "n_h": 6, "n_g": 6, "alpha": 1e-8, "n_init": 1, "max_iter": 300}


def saturated(seed=2, N=600):
    """Return a record of a filter that saturates, whose laws go far if they may."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3, 3, N // 10), 10)
    y = np.tanh(lfilter([0, 0.1], [1, -1.5, 0.6], u))
    return u[:, None], y + 0.005 * rng.standard_normal(N)


def test_the_benchmark_tells_loops_of_a_case(monkeypatch, tmp_path, capsys):
    u, y = saturated()
    records = Data([(u, y[:, None])], {"fresh": [saturated(seed=3)]}, 1.0)
    case = Case("saturated", "filter", lambda: records, "seen")
    monkeypatch.setitem(loops.MODELS, "al", partial(AlSsnn, **OPTIONS))
    monkeypatch.setitem(loops.CASES, "saturated", case)
    path = tmp_path / "loops.csv"
    argv = ["--cases", "saturated", "--models", "al", "--out", str(path)]
    loops.main([*argv, "--set", "linear_part=trained"])
    loops.main(argv)
    loops.main(argv)  # nothing is left to do
    trained, best = loops.read(path)
    assert [r["options"] for r in (trained, best)] == ["linear_part='trained'", ""]
    assert best["outside"] < 0.1 < 0.5 < trained["outside"]
    assert len(capsys.readouterr().out.splitlines()) == 2
    # its records do not tell the equations
    assert np.isnan([trained["distance"], best["distance"]]).all()


def bent(rng, N):
    """Return a record of a plant that a law linearizes, with its output bent."""

    def update(x, u):
        return [0.8 * x[0] - 0.5 * np.tanh(2 * x[0]) + x[1], 0.6 * x[1] + u[0]]

    u = rng.uniform(-1, 1, N)
    return u, iterate(update, [0.1, 0.0], u)[:, 0]


def test_the_benchmark_runs_the_true_loop(monkeypatch, tmp_path, capsys):
    case = simulated("bent", "filter", bent, split="seen", N=600)
    monkeypatch.setitem(loops.CASES, "bent", case)
    monkeypatch.setitem(
        loops.MODELS, "fl", partial(FlSsnn, nx=2, n_h=3, alpha=1e-6, feedback="state")
    )
    monkeypatch.setattr(loops, "OUT", tmp_path)
    path = tmp_path / "loops.csv"
    argv = ["--cases", "bent", "--models", "lti", "fl", "--out", str(path)]
    loops.main(argv)
    linear, ours = loops.read(path)
    assert 0 < ours["distance"] < linear["distance"] / 3 < loops.LOST
    assert abs(ours["tracking"] / linear["tracking"] - 1) < 1
    told = capsys.readouterr().out
    assert "FlSsnn: 1 true loops, distance over that of the linear model" in told
    loops.main(["--table", str(path), "--page"])
    assert "| bent |" in (tmp_path / "loops.md").read_text()
    # a loop that diverges has failed
    monkeypatch.setattr(loops, "LOST", 0.0)
    loops.main([*argv[:-1], str(tmp_path / "lost.csv")])
    assert [r["failure"] for r in loops.read(tmp_path / "lost.csv")] == 2 * ["diverged"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("valve", (1, 1, 2)),  # the second state is measured
        ("levitation", (1, 1, 3)),  # behind its regulator, of which r is recorded
        ("two links", (2, 2, 4)),  # behind a regulator, of which u is recorded
        ("solenoid", None),  # the output bends
        ("delay", None),
        ("dryer", None),  # a record
    ],
)
def test_the_field_tells_the_plants_behind_its_records(name, expected):
    case = loops.CASES[name]
    own = truth(case)
    if expected is None:
        assert own is None
        return
    plant = own.plant
    assert (plant.ninputs, plant.noutputs, plant.nstates) == expected
    run = case.load.args[1]
    with heard() as simulations:
        u, y = map(columns, run(np.random.default_rng(5), 50))
    x = simulations[0].X[0]
    for k in range(50):
        np.testing.assert_allclose(plant.output(k, x, u[k]), y[k], atol=1e-6)
        x = plant.dynamics(k, x, u[k])


def test_the_page_and_the_readme_say_what_the_runs_say():
    folder = Path(__file__).parents[1]
    rows = loops.read(folder / "doc" / "benchmarks" / "loops.csv")
    page = (folder / "doc" / "benchmarks" / "loops.md").read_text().splitlines()
    assert page[:-1] == loops.page(rows, "")[:-2]
    (said,) = (text for text in loops.summary(rows) if text.startswith("AlSsnn"))
    n, median, half, larger, told, of = re.search(
        r"(\d+) true loops.* median ([\d.]+), at most 1/2 in (\d+), above 1 in (\d+),"
        r".* in (\d+) of (\d+),",
        said,
    ).groups()
    text = " ".join((folder / "README.md").read_text().split())
    assert f"In true loops of {n} of these plants" in text
    assert f"is {median} times that of a linear model" in text
    assert f"It is at most half in {half} of them and larger in {larger}." in text
    assert f"right within a factor 2 in {told} of {of}" in text

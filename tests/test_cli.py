import csv
import re
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.io import loadmat

import alssnn
from alssnn import cli
from alssnn.cli import _demo, _fit_options, _main
from alssnn.continuous import HOLDS
from alssnn.datasets import (
    Record,
    make_inverted_pendulum,
    make_pendulum,
    make_wiener_hammerstein,
)
from alssnn.feedback import balanced_weights, lqi
from alssnn.ladder import LADDER, PRESETS, model_ladder
from alssnn.tables import read_csv
from helpers import simulate_linear

SMALL = ["--nx", "6", "--n-h", "2", "--n-g", "2", "--n-f", "2", "--max-iter", "3"]
SMALL += ["--alpha", "1e-4", "--n-init", "1"]
PLAIN = {"alpha": 1e-4, "n_init": 1}  # no search, where any model will do
RECORD = make_wiener_hammerstein(800, noise=0.01, random_state=0)


def write_csv(path, delimiter=",", rows=slice(None), header=("u", "y", "run")):
    u, y = RECORD.u[rows, 0], RECORD.y[rows, 0]
    runs = ["first" if k < len(u) // 2 else "second" for k in range(len(u))]
    lines = [delimiter.join(header)]
    lines += [
        delimiter.join([f"{a:.9g}", f"{b:.9g}", run])
        for a, b, run in zip(u, y, runs, strict=True)
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def plant(tmp_path):
    return write_csv(tmp_path / "plant.csv")


def run(*argv):
    return cli.main([str(arg) for arg in argv])


def run_fit(path, *more):
    return run("fit", path, "--input", "u", "--output", "y", *more)


def assert_one_line(capsys, *parts):
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("alssnn: error: ") and err.count("\n") == 1
    for part in parts:
        assert part in err


# demo


def test_demo_runs_the_loops_of_a_pendulum(tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    assert run("demo", "--quick", "-o", folder) == 0
    out, err = capsys.readouterr()
    table, notes, verdict, figure = out.split("\n\n")
    head, _, *lines = table.splitlines()
    assert re.split("  +", head)[-2:] == ["linear model", "model with h"]
    figures = {
        re.split("  +", line)[0]: [float(z) for z in re.split("  +", line)[1:]]
        for line in lines
    }
    # every line of the table is explained, in its order
    assert re.findall(r"^- (.*?):", notes, re.M) == [
        name.partition(",")[0] for name in figures
    ]
    errors = figures["simulation error, rad"]
    noise = float(re.search(r"alone\s+makes\s+(\S+)\s+rad", notes)[1])
    assert noise < errors[1] < 2 * noise < errors[0] / 3
    linear, law = figures["in the loop, rad"]
    assert law < linear / 5
    ratio = float(re.search(r"is\s+(\S+)\s+times", verdict)[1])
    assert ratio == pytest.approx(linear / law, rel=0.06)  # two digits
    assert "*" not in table
    assert "model with h: fitted in" in err and "warning" not in err
    assert (folder / "alssnn-demo.png").stat().st_size > 10_000
    assert figure == f"Figure: {folder / 'alssnn-demo.png'}\n"


@pytest.mark.usefixtures("undrawn")
@pytest.mark.filterwarnings("ignore:The networks of FlSsnn do not simulate")
def test_demo_says_where_the_law_does_not_help(tmp_path, capsys):
    options = ["--samples", 200, "--noise", 1, "-q", "-o", tmp_path]
    assert run("demo", *options) == 0
    out, err = capsys.readouterr()
    assert "does not bring the loop closer" in " ".join(out.split()) and err == ""


def test_demo_of_the_circuit(tmp_path, monkeypatch, capsys):
    def ladder(u, y, **options):  # the four models, one start of each
        return model_ladder(u, y, **{**options, **PLAIN})

    monkeypatch.setattr(alssnn.ladder, "model_ladder", ladder)
    monkeypatch.setitem(_demo.QUICK, _demo.CIRCUIT, (600, 2))
    assert run("demo", "wiener-hammerstein", "--quick", "-o", tmp_path) == 0
    out, err = capsys.readouterr()
    assert [line.split()[0] for line in out.splitlines()[3:7]] == [
        "LTI",
        "FL-SSNN",
        "AL-SSNN",
        "GR-SSNN",
    ]
    assert "- Accuracy: " in out and "- Linearity: " in out and "- Stability: " in out
    assert "cost" in err and "cost " not in out.splitlines()[0]
    assert (tmp_path / "alssnn-demo.png").stat().st_size > 10_000


def test_demo_depends_on_the_seed_alone(tmp_path, monkeypatch, capsys):
    def ladder(u, y, **options):  # with two models of four, small ones
        few = {"nx": 2, "models": ["lti", "fl"], **PLAIN}
        return model_ladder(u, y, **{**options, **few})

    monkeypatch.setattr(alssnn.ladder, "model_ladder", ladder)
    monkeypatch.setitem(_demo.QUICK, _demo.CIRCUIT, (600, 2))
    tables = []
    for seed in (0, 0, 1):
        name = f"{len(tables)}.svg"
        options = ["--noise", 0.1, "--seed", seed, "-q", "-o", tmp_path]
        argv = ["demo", "wiener-hammerstein", "--quick", *options]
        assert run(*argv, "--figure", name) == 0
        out, err = capsys.readouterr()
        assert err == ""
        if not tables:  # drawn once, as the numbers matter
            assert (tmp_path / name).read_text().startswith("<?xml")
            monkeypatch.setattr(Figure, "savefig", lambda *_, **__: None)
        tables.append(re.findall(r"\d\.\d{3}e[-+]\d+", out))
    assert tables[0] == tables[1] != tables[2]


@pytest.mark.usefixtures("undrawn")
def test_demo_of_the_measured_record(tmp_path, monkeypatch, capsys):
    record = make_wiener_hammerstein(12_000, random_state=0)
    calls = []

    def fetch(split):
        assert split == "paper"
        return record.split(0.5)

    def ladder(u, y, **options):
        calls.append((len(u), options))
        return model_ladder(u[:600], y[:600], nx=2, models=["lti"])

    monkeypatch.setattr(alssnn.datasets, "fetch_wiener_hammerstein", fetch)
    monkeypatch.setattr(alssnn.ladder, "model_ladder", ladder)
    monkeypatch.setattr(_demo, "MEASURED_QUICK", 500)
    argv = ["demo", "wiener-hammerstein", "--measured", "-o", tmp_path]
    assert run(*argv) == 0 and run(*argv, "--quick") == 0
    (whole, options), (part, quick) = calls
    assert (whole, len(options["test"])) == (6000, 6000)
    assert (part, len(quick["test"])) == (500, 500)
    assert isinstance(quick["test"], Record)
    assert options["nx"] == 6 and options["max_iter"] > quick["max_iter"]


def test_demo_without_the_measured_record(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("ALSSNN_DATA_HOME", str(tmp_path))
    argv = ["demo", "wiener-hammerstein", "--measured", "-o", tmp_path]
    assert run(*argv) == 2
    assert_one_line(capsys, "WienerHammerBenchmark.csv was not found")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["wiener-hammerstein", "--measured", "--noise", "0.1"], "belong to a sim"),
        (["wiener-hammerstein", "--measured", "--samples", "9"], "belong to a sim"),
        (["--measured"], "--measured belongs to wiener-hammerstein"),
        (["--noise", "-1"], "must be a number of at least 0, got -1"),
        (["--figure", "demo.doc"], "must end in .png, .pdf, .svg, got demo.doc"),
        (["--samples", "0"], "must be an integer of at least 1, got 0"),
        (["--seed", "-1"], "must be an integer of at least 0, got -1"),
        (["--qui"], "unrecognized arguments: --qui"),
    ],
)
def test_wrong_usage_of_demo(argv, message, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        run("demo", "-o", tmp_path, *argv)
    assert message in capsys.readouterr().err


def test_output_folder_that_is_a_file(plant, capsys):
    assert run("demo", "-o", plant) == 2
    assert_one_line(capsys, "plant.csv")


# fit


def test_fit_compares_models_of_a_file(plant, tmp_path, capsys):
    figure = tmp_path / "plant.pdf"
    assert run_fit(plant, *SMALL, "--nx", 2, "--dt", 0.01, "--figure", figure) == 0
    out, _ = capsys.readouterr()
    assert len(re.findall(r"^(LTI|FL-SSNN|AL-SSNN|GR-SSNN) ", out, re.M)) == 4
    assert figure.read_bytes().startswith(b"%PDF")


def test_fit_in_continuous_time(tmp_path, capsys):
    plant = write_csv(tmp_path / "plant.csv", rows=slice(300))
    options = ["--model", "lti", "--continuous", "--hold", "linear", "--nx", "2"]
    saved = tmp_path / "model.alssnn"
    assert run_fit(plant, *options, "--dt", "1", "--save", saved, "--force") == 0
    model = alssnn.load(saved)
    sampling = model.fitted_.structure.sampling
    assert sampling.hold == "linear" and sampling.dt == 1.0
    assert model.to_statespace().dt == 0


def test_fit_hands_its_options_to_the_ladder(plant, monkeypatch, tmp_path, capsys):
    seen = {}

    def ladder(u, y, **options):
        seen.update(options, u=u, y=y)
        return model_ladder(u, y, nx=2, models=["lti"])

    monkeypatch.setattr(alssnn.ladder, "model_ladder", ladder)
    options = ["--experiment", "run", "--test-size", "0.25", "--models", "al", "lti"]
    options += [*SMALL, "--gamma", "10", "--n-init", "2", "--seed", "5", "--dt", "0.1"]
    options += ["--gamma-h", "0.001", "--alpha", "0.1", "--stability", "none"]
    options += ["--feedback", "output", "--input-map", "monotone", "--innovations"]
    options += ["--linear-part", "trained"]
    options += ["--drift", "input", "--horizon", "3", "--odd", "--max-time", "60"]
    options += ["--operating-point", "zero", "--initial-state", "rest"]
    options += ["--input-delay", "1"]
    assert run_fit(plant, *options, "--quiet") == 0
    assert callable(seen.pop("callback"))
    np.testing.assert_allclose(seen.pop("u"), RECORD.u, rtol=1e-8)
    np.testing.assert_allclose(seen.pop("y"), RECORD.y, rtol=1e-8)
    assert list(seen.pop("experiment")) == ["first"] * 400 + ["second"] * 400
    assert seen == {
        "test_size": 0.25,
        "models": ["al", "lti"],
        "nx": 6,
        "n_h": 2,
        "n_g": 2,
        "n_f": 2,
        "max_iter": 3,
        "gamma": 10.0,
        "gamma_h": 0.001,
        "alpha": 0.1,
        "stability": None,
        "linear_part": "trained",
        "feedback": "output",
        "input_map": "monotone",
        "disturbances": None,
        "noise": "innovations",
        "drift": "input",
        "time": "discrete",
        "hold": "zoh",
        "horizon": 3,
        "n_init": 2,
        "odd": True,
        "operating_point": "zero",
        "initial_state": "rest",
        "input_delay": 1,
        "max_time": 60.0,
        "test": None,
        "random_state": 5,
        "dt": 0.1,
        "verbose": 0,
    }
    out, err = capsys.readouterr()
    assert "Figure" not in out and "Accuracy" not in out and err == ""


@pytest.mark.parametrize("known", [_fit_options.MODELS, _fit_options.FOUR])
def test_the_command_knows_the_models_of_the_ladder(known):
    ladder = PRESETS if known is _fit_options.MODELS else LADDER
    assert known == tuple(ladder)
    assert _fit_options.HOLDS == HOLDS


@pytest.mark.usefixtures("undrawn")
def test_a_disturbance_is_measured_and_not_moved(tmp_path, capsys):
    record = alssnn.datasets.make_valve_tank(400, random_state=0)
    table = np.column_stack([record.u, record.y])
    file = tmp_path / "tank.csv"
    np.savetxt(file, table, delimiter=",", header="valve,inflow,level", comments="")
    model = tmp_path / "model.npz"
    argv = ["fit", str(file), "--input", "valve", "--disturbance", "inflow"]
    argv += ["--output", "level", "--model", "lti", "--nx", "1", "--save", str(model)]
    assert cli.main([*argv, "--quiet"]) == 0
    fitted = alssnn.load(model)
    np.testing.assert_array_equal(fitted.disturbances_, [1])
    assert fitted.plant_.inputs == ["valve", "inflow"]
    argv = ["control", str(model), "-o", str(tmp_path / "design")]
    assert cli.main(argv) == 0
    assert "valve" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--nx", "many"], "argument --nx: must be an integer of at least 1, got many"),
        (["--nx", "5-2"], "argument --nx: must be a range that ascends, got 5-2"),
        (["--alpha", "-1"], "argument --alpha: must be a number of at least 0, got -1"),
        (["--n-h", "-1"], "must be an integer of at least 0, got -1"),
        (["--gamma", "-1"], "argument --gamma: must be a number of at least 0, got -1"),
        (["--dt", "0"], "argument --dt: must be a positive number, got 0"),
        (["--dt", "fast"], "argument --dt: must be a positive number, got fast"),
        (["--models", "arx"], "argument --models: invalid choice: 'arx'"),
        (["--drift", "input"], "--drift needs --innovations"),
        (["--hold", "cubic"], "--hold needs --continuous"),
        (["--continuous"], "--continuous needs --dt, the sampling time in seconds"),
        (["--horizon", "2"], "--horizon needs --innovations"),
        (["--test", "t.csv", "--test-size", "0.3"], "exclude each other"),
        (["--dt", "1", "--time-column", "t"], "exclude each other"),
        (["--input-delay", "auto", "1"], "takes auto alone"),
        (["--input-delay", "-1"], "must be an integer of at least 0, got -1"),
        (["--gama", "1"], "alssnn fit: error: unrecognized arguments: --gama 1"),
    ],
)
def test_wrong_usage_of_fit(plant, argv, message, capsys):
    with pytest.raises(SystemExit, match="2"):
        run_fit(plant, *argv)
    assert message in capsys.readouterr().err


def test_fit_with_wrong_data(plant, tmp_path, capsys):
    assert run_fit(plant, "--test-size", "2") == 2
    assert_one_line(capsys, "`test_size` must lie strictly between 0 and 1, got 2.0.")
    short = write_csv(tmp_path / "short.csv", rows=slice(0, 4))
    assert run_fit(short, "--nx", 6, "-q") == 2
    assert_one_line(capsys)


def test_fit_without_a_file(tmp_path, capsys):
    assert run_fit(tmp_path / "missing.csv") == 2
    assert_one_line(capsys, "missing.csv")


@pytest.mark.parametrize(
    ("error", "code", "message"),
    [
        (np.linalg.LinAlgError("SVD did not converge"), 1, "SVD did not converge"),
        (RuntimeError("two\nlines"), 1, "two lines"),
        (MemoryError(), 1, "MemoryError"),
        (ValueError("bad data"), 2, "bad data"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_exit_codes(plant, monkeypatch, error, code, message, capsys):
    def fail(*args, **options):
        raise error

    monkeypatch.setattr(alssnn.ladder, "model_ladder", fail)
    assert run_fit(plant) == code
    assert_one_line(capsys, message)


def test_faults_of_the_package_keep_their_traceback(plant, monkeypatch):
    def fail(*args, **options):
        raise AttributeError("a bug")

    monkeypatch.setattr(alssnn.ladder, "model_ladder", fail)
    with pytest.raises(AttributeError, match="a bug"):
        run_fit(plant)


# from a saved model to a controller


@pytest.fixture(scope="module")
def linear_plant(tmp_path_factory):
    """Return a record of a linear plant, two inputs and outputs, two experiments."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((1200, 2))
    A, B = np.array([[0.8, 0.1], [-0.1, 0.7]]), np.array([[0.3, 0.1], [0.0, 0.4]])
    y = simulate_linear(A, B, np.eye(2), u) + 0.02 * rng.standard_normal((1200, 2))
    path = tmp_path_factory.mktemp("plant") / "plant.csv"
    lines = ["run,a,b,speed,angle"]
    for k, row in enumerate(np.hstack([u, y])):
        lines.append(",".join([str(k // 600), *(f"{z:.9g}" for z in row)]))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def saved(linear_plant):
    path = linear_plant.with_name("plant.npz")
    columns = ["--input", "a", "b", "--output", "speed", "angle", "--experiment", "run"]
    options = ["--nx", 2, "--model", "lti", "--dt", 0.1, "--save", path, "-q"]
    assert run("fit", linear_plant, *columns, *options) == 0
    return path


def data(path):
    return ["--data", path, "--experiment", "run", "--last", "0.5"]


def test_a_saved_model_knows_its_columns(saved, linear_plant, tmp_path, capsys):
    model = alssnn.load(saved)
    assert list(model.feature_names_in_) == ["a", "b"]
    assert model.output_names_ == ["speed", "angle"]
    assert model.dt == 0.1 and len(model.experiments_) == 2
    table = tmp_path / "checks.csv"
    assert run("validate", saved, *data(linear_plant), "-o", table) == 0
    out, err = capsys.readouterr()
    assert "LinearStateSpace passes." in out and err == ""
    assert "No feedback found" in out
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert "independence" in [row["name"] for row in rows]
    assert all(row["passed"] == "True" for row in rows if row["decides"] == "True")


def test_a_share_that_leaves_nothing_says_what_to_do(saved, linear_plant, capsys):
    argv = ["--data", linear_plant, "--experiment", "run", "--last", "1e-6"]
    assert run("validate", saved, *argv) == 2
    assert_one_line(capsys, "`--last` must leave samples", "Take another share")


def test_a_failed_check_is_exit_code_1(plant, tmp_path, capsys):
    path = tmp_path / "poor.npz"
    assert run_fit(plant, "--model", "lti", "--nx", 1, "-q", "--save", path) == 0
    assert run("validate", path, "--data", plant, "--lags", 10) == 1
    assert "LinearStateSpace fails: " in capsys.readouterr().out
    assert run("validate", path, "--data", plant, "--lags", 300) == 2
    assert_one_line(capsys, "samples behind the first 300 of the experiments")


def test_a_model_worse_than_the_linear_one_is_not_saved(
    plant, tmp_path, monkeypatch, capsys
):
    """A fit that is no model is refused, with a sentence and exit code 1."""
    from dataclasses import replace

    fits = []  # once, as all runs have the same options

    def ladder(u, y, **options):
        if not fits:
            few = {"nx": 2, "max_iter": 2, **PLAIN}
            fits.append(model_ladder(u, y, **{**options, **few}))
        (found,) = fits
        assert [row.name for row in found] == ["LTI", "FL-SSNN"]
        missed = options.pop("missed", case["missed"])
        fl = replace(found.rows[1], fit_percent=100 - np.array([missed]))
        lti = replace(found.rows[0], fit_percent=np.array([85.0]))
        return replace(found, rows=(lti, fl))

    monkeypatch.setattr(alssnn.ladder, "model_ladder", ladder)
    path = tmp_path / "m.npz"
    argv = ["--model", "fl", "--n-h", "2", "--save", path, "-q"]
    for missed, words in (
        (66.0, "FL-SSNN is worse than the linear model on the test data: it misses 66"),
        (581.0, "no better than the mean of the output: do not use it."),
        (np.inf, "FL-SSNN diverges on the test data: do not use it."),
    ):
        case = {"missed": missed}
        assert run_fit(plant, *argv) == 1
        out = " ".join(capsys.readouterr().out.split())
        assert words in out and "m.npz was not written" in out
        assert not path.exists()
    assert run_fit(plant, *argv, "--force") == 0 and path.exists()
    assert "Caution: FL-SSNN diverges" in " ".join(capsys.readouterr().out.split())
    path.unlink()
    case = {"missed": 14.0}
    assert run_fit(plant, *argv) == 0 and path.exists()
    assert "Caution" not in capsys.readouterr().out


@pytest.mark.usefixtures("undrawn")
def test_control_depends_on_the_verdict(saved, linear_plant, plant, tmp_path, capsys):
    folder = tmp_path / "design"
    assert run("control", saved, *data(linear_plant), "-o", folder) == 0
    assert "not validated" not in capsys.readouterr().out
    assert run("control", saved, "-o", folder) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "The verdict is unknown. The model was not validated here" in told
    assert "Of its training record the model misses " in told
    poor = tmp_path / "poor.npz"
    assert run_fit(plant, "--model", "lti", "--nx", 1, "-q", "--save", poor) == 0
    capsys.readouterr()
    other = tmp_path / "none"
    assert run("control", poor, "--data", plant, "-o", other) == 1
    out = capsys.readouterr().out
    assert "LinearStateSpace fails: " in out and "use --force" in out
    assert not other.exists()
    assert run("control", poor, "--data", plant, "--force", "-o", other) == 0


@pytest.mark.parametrize(
    ("option", "named"),
    [
        (["--input", "u"], "--input"),
        (["--output", "y", "--last", "0.5"], "--output, --last"),
        (["--experiment", "run"], "--experiment"),
    ],
)
def test_control_without_a_record_has_no_columns(
    saved, tmp_path, capsys, option, named
):
    with pytest.raises(SystemExit) as stop:
        run("control", saved, *option, "-o", tmp_path / "none")
    assert stop.value.code == 2
    assert f": {named} must come with --data: " in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.usefixtures("rough_certificates")
def test_report_of_a_saved_model(saved, linear_plant, tmp_path, monkeypatch, capsys):
    path = tmp_path / "new" / "report.html"
    assert run("report", saved, *data(linear_plant), "-o", path) == 0
    assert capsys.readouterr().out == f"Report: {path}\n"
    text = path.read_text(encoding="utf-8")
    assert "speed" in text and "<td>training</td>" in text
    assert "u is what the plant gets, over its range in the training data" in text
    assert run("report", saved, "--data", linear_plant, "-o", path) == 2
    assert_one_line(capsys, "report.html` must not exist yet", "--overwrite")
    monkeypatch.setattr(Figure, "savefig", lambda *_, **__: None)  # drawn above
    argv = ["report", saved, "--data", linear_plant, "-o", path]
    assert run(*argv, "--overwrite") == 0
    assert "<td>training</td>" not in path.read_text(encoding="utf-8")


def test_control_writes_gain_and_step(saved, tmp_path, capsys):
    folder = tmp_path / "design"
    options = ["--step", 1, -1, "--samples", 80, "--figure", "s.svg", "-o", folder]
    assert run("control", saved, *options) == 0
    gain = np.loadtxt(folder / "gain.csv", delimiter=",", skiprows=1)
    model = alssnn.load(saved)
    np.testing.assert_array_equal(gain, lqi(model, *balanced_weights(model)))
    with (folder / "step.csv").open() as file:
        header = next(csv.reader(file))
        steps = np.loadtxt(file, delimiter=",")
    assert header[:3] == ["time", "speed design", "angle design"]
    assert header[5:] == [
        "speed model",
        "angle model",
        "v[0] model",
        "v[1] model",
        "a model",
        "b model",
    ]
    assert steps.shape == (80, 11)
    # a linear model is its own design, and integrators leave no offset
    np.testing.assert_allclose(steps[:, 1:5], steps[:, 5:9], atol=1e-9)
    np.testing.assert_allclose(steps[:, 9:], steps[:, 7:9], atol=1e-9)  # u = v
    assert (folder / "s.svg").read_text().startswith("<?xml")
    out = capsys.readouterr().out
    assert "K, columns x0 x1 z0 z1 =" in out
    assert re.search(r"^  speed: \S+, \S+ % of the range of the design$", out, re.M)
    assert re.search(r"^  v, in units of a: ", out, re.M)
    assert run("control", saved, "--qi", 1, "--ru", 0.1, "-o", folder) == 0
    faster = np.loadtxt(folder / "gain.csv", delimiter=",", skiprows=1)
    assert np.linalg.norm(faster) > np.linalg.norm(gain)


@pytest.mark.usefixtures("undrawn")
def test_control_says_where_the_actuators_go(saved, linear_plant, tmp_path, capsys):
    half = [*range(300), *range(600, 900)]  # what trained
    u, _, _ = read_csv(linear_plant, ["a", "b"], ["speed"])
    low, high = u[half].min(axis=0), u[half].max(axis=0)
    line = (
        r"^  {}: \S+ to (\S+), largest size (\S+); training {:.4g} to {:.4g}(, at .*)?$"
    )
    patterns = [line.format(*row) for row in zip("ab", low, high, strict=True)]

    assert run("control", saved, "--step", 0.1, "-o", tmp_path) == 0
    out = capsys.readouterr().out
    assert all(re.search(pattern, out, re.M) for pattern in patterns)
    assert "out of the range" not in out

    # beyond what either actuator ever did
    assert run("control", saved, "--step", 40, "-o", tmp_path) == 0
    out = capsys.readouterr().out
    with (tmp_path / "step.csv").open() as file:
        next(file)
        steps = np.loadtxt(file, delimiter=",")
    for pattern, signal in zip(patterns, steps[:, -2:].T, strict=True):
        found = re.search(pattern, out, re.M)
        assert float(found[1]) == pytest.approx(signal.max(), rel=1e-3)
        assert float(found[2]) == pytest.approx(np.abs(signal).max(), rel=1e-3)
    words = " ".join(out.split())
    assert "drives a, b out of the range of the training data" in words
    assert all(flag in words for flag in ("--step", "--ru", "--u-max", "--gamma-h"))

    # limits at that range keep it there, and are said to
    limits = ["--u-min", *low, "--u-max", *high]
    assert run("control", saved, "--step", 40, *limits, "-o", tmp_path) == 0
    out = capsys.readouterr().out
    assert "out of the range" not in out
    assert re.search(patterns[0], out, re.M)[3].endswith("% of the samples")


@pytest.mark.usefixtures("undrawn")
def test_export_for_c_and_matlab(saved, tmp_path, capsys):
    assert run("control", saved, "-o", tmp_path) == 0
    gain = tmp_path / "gain.csv"
    capsys.readouterr()
    assert run("export", saved, "--c", tmp_path / "c", "--gain", gain) == 0
    assert str(tmp_path / "c" / "plant.c") in capsys.readouterr().out.splitlines()
    assert "plant_control(" in (tmp_path / "c" / "plant.c").read_text()
    assert run("export", saved, "--c", tmp_path / "small", "--dtype", "float") == 0
    capsys.readouterr()
    for folder, real in (("c", "double"), ("small", "float")):
        sources = [path.read_text() for path in (tmp_path / folder).glob("*.[ch]")]
        assert any(f"typedef {real} " in text for text in sources)
    path = tmp_path / "new" / "plant.mat"
    assert run("export", saved, "--mat", path, "--gain", gain) == 0
    held = loadmat(path, simplify_cells=True)["model"]
    np.testing.assert_array_equal(held["A"], alssnn.load(saved).A_)
    K = np.loadtxt(gain, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(np.hstack([held["K_x"], held["K_z"]]), K)


@pytest.mark.usefixtures("undrawn")
def test_a_gain_of_late_inputs_goes_from_control_to_export(tmp_path, capsys):
    u = np.random.default_rng(0).standard_normal((1200, 2))
    late = np.column_stack([u[:, 0], np.roll(u[:, 1], 2)])
    y = simulate_linear(
        0.8 * np.eye(2), np.array([[1, 0.2], [0, 0.5]]), np.eye(2), late
    )
    model = alssnn.LinearStateSpace(nx=2, dt=0.1, input_delay=[0, 2])
    model.fit(u[2:], y[2:]).save(tmp_path / "late.npz")
    assert run("control", tmp_path / "late.npz", "-o", tmp_path) == 0
    assert "K, columns x0 x1 x2 x3 z0 z1 =" in capsys.readouterr().out
    gain, path = tmp_path / "gain.csv", tmp_path / "late.mat"
    assert run("export", tmp_path / "late.npz", "--mat", path, "--gain", gain) == 0
    held = loadmat(path, simplify_cells=True)["model"]
    K = np.loadtxt(gain, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(np.hstack([held["K_x"], held["K_z"]]), K)


@pytest.mark.usefixtures("undrawn")
def test_export_for_plcs_and_as_fmus(saved, tmp_path, monkeypatch, capsys):
    flags = "-std=c99 -O0 -shared -fPIC"  # nothing of it is run
    monkeypatch.setattr("alssnn.persistence._fmu.FLAGS", flags)
    assert run("control", saved, "-o", tmp_path) == 0
    gain = tmp_path / "gain.csv"
    path = tmp_path / "new" / "plant.st"
    assert run("export", saved, "--st", path, "--gain", gain, "--dtype", "float") == 0
    assert capsys.readouterr().out.splitlines()[-1] == str(path)
    text = path.read_text()
    assert "FUNCTION_BLOCK PLANT_CONTROL" in text and "LREAL" not in text
    for options, kind in (
        ([], "Model"),
        (["--gain", gain], "Controller"),
        (["--gain", gain, "--both", "--fmi", "2.0"], "Both"),
    ):
        path = tmp_path / f"{kind}.fmu"
        assert run("export", saved, "--fmu", path, *options) == 0
        assert capsys.readouterr().out.splitlines()[-1] == str(path)
        told = zipfile.ZipFile(path).read("modelDescription.xml").decode()
        assert f'description="{kind}, ' in told
        assert ('fmiVersion="2.0"' in told) == (kind == "Both")
    assert run("export", saved, "--fmu", path, "--both") == 2
    assert_one_line(capsys, "`--both` must come with --gain")
    units = ["--units", "a=V", "speed=rad/s"]
    assert run("export", saved, "--fmu", tmp_path / "units.fmu", *units) == 0
    told = zipfile.ZipFile(tmp_path / "units.fmu").read("modelDescription.xml").decode()
    assert 'unit="V"' in told and 'unit="rad/s"' in told


def test_every_option_of_an_export_arrives(saved, tmp_path, capsys):
    board = tmp_path / "board"
    options = ["--layout", "arduino", "--dtype", "float", "--prefix", "motor"]
    assert run("export", saved, "--c", board, *options, "--no-observer") == 0
    source = (board / "src" / "motor.c").read_text()
    assert "motor_step(" in source and "motor_correct(" not in source
    assert (board / "library.properties").exists()
    path = tmp_path / "a.xml"
    assert run("export", saved, "--st", path, "--prefix", "motor") == 0
    assert "MOTOR_CORRECT" in path.read_text()
    assert run("export", saved, "--simulink", tmp_path, "--prefix", "motor") == 0
    assert "plant" not in (tmp_path / "build_motor.m").read_text()
    package = tmp_path / "Motor.mo"
    assert run("export", saved, "--modelica", package, "--no-observer") == 0
    assert "package Motor" in package.read_text()
    assert "correct" not in package.read_text()
    assert run("export", saved, "--mat", tmp_path / "a.mat", "--gate", "7") == 0
    held = loadmat(tmp_path / "a.mat", simplify_cells=True)["model"]
    gate = alssnn.load(saved).observer(gate=7).largest_innovation
    np.testing.assert_array_equal(np.atleast_1d(held["gate"]), gate)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--st", "a.st", "--layout", "arduino"], "`--layout` must be left out with"),
        (["--mat", "a.mat", "--dtype", "float"], "It is an option of --c or --st"),
        (["--c", "a", "--units", "u=V"], "`--units` must be left out with --c"),
        (["--fmu", "a.fmu", "--units", "u"], "`--units` must be pairs"),
        (["--fmu", "a.fmu", "--gate", "5"], "`--gate` must come with --gain"),
        (["--c", "a", "--gate", "5", "--no-observer"], "`--gate` must be left out"),
    ],
)
def test_an_option_without_a_use_is_refused(saved, options, message, capsys):
    assert run("export", saved, *options) == 2
    assert_one_line(capsys, message)


def test_export_as_graphs(saved, linear_plant, tmp_path, capsys):
    pytest.importorskip("onnx", reason="onnx is not installed")
    assert run("export", saved, "--onnx", tmp_path / "graphs") == 0
    paths = [tmp_path / "graphs" / f"plant_{name}.onnx" for name in ("step", "law")]
    assert capsys.readouterr().out.split() == [str(path) for path in paths]
    assert all(path.stat().st_size > 100 for path in paths)
    assert run("export", saved, "--onnx", tmp_path, "--gain", linear_plant) == 2
    assert_one_line(capsys, "`--gain` must be left out with --onnx")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (
            ["fit", "{csv}", "--input", "a", "--output", "b", "--save", "m.npz"],
            "--model al",
        ),
        (["validate", "{npz}"], "required: --data"),
        (
            ["validate", "{npz}", "--data", "{csv}", "--input", "a"],
            "must name 2 columns",
        ),
        (["report", "{npz}", "--data", "{csv}", "--last", "2"], "a share above 0"),
        (["control", "{npz}", "--qx", "-1"], "must be a number of at least 0, got -1"),
        (["control", "{npz}", "--step", "high"], "must be a number, got high"),
        (
            ["export", "{npz}"],
            "arguments --c --mat --simulink --onnx --st --modelica --fmu is",
        ),
    ],
)
def test_wrong_usage_of_commands_on_models(argv, message, saved, linear_plant, capsys):
    with pytest.raises(SystemExit, match="2"):
        run(*(arg.format(npz=saved, csv=linear_plant) for arg in argv))
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("command", ["validate", "report", "control", "export"])
def test_files_that_are_no_models(command, linear_plant, tmp_path, capsys):
    more = {"control": [], "export": ["--mat", tmp_path / "x.mat"]}
    more = more.get(command, ["--data", linear_plant])
    assert run(command, tmp_path / "missing.npz", *more) == 2
    assert_one_line(capsys, "missing.npz")
    assert run(command, linear_plant, *more) == 2
    assert_one_line(capsys)


def test_commands_refuse_what_does_not_fit(saved, linear_plant, tmp_path, capsys):
    assert run("control", saved, "--qi", 0, "-o", tmp_path) == 2
    assert_one_line(capsys, "`integral` must be positive and finite, got 0.0.")
    assert run("export", saved, "--mat", tmp_path / "x", "--gain", linear_plant) == 2
    assert_one_line(capsys, "must have one column 'x0', got none")
    columns = ["--input", "a", "q", "--experiment", "run"]
    assert run("validate", saved, "--data", linear_plant, *columns) == 2
    assert_one_line(capsys, "must have one column 'q', got none")


@pytest.mark.usefixtures("rough_certificates")
def test_the_five_commands_of_the_readme(tmp_path, monkeypatch, capsys):
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    text = readme.split("in five commands")[1]
    block = re.search(r"```sh\n(.*?)```", text, re.S)[1]
    commands = [shlex.split(line) for line in block.splitlines()]
    names = ["fit", "validate", "report", "control", "export"]
    assert [command[:2] for command in commands] == [["alssnn", n] for n in names]
    monkeypatch.chdir(tmp_path)
    # a short record, and above a bound that is not sharp: what is printed matters
    record = make_pendulum(800, amplitude=5.0, noise=0.01, random_state=0)
    np.savetxt(
        "plant.csv", np.hstack([*record]), delimiter=",", header="u,y", comments=""
    )
    fit, validate, *rest = commands
    assert run(*fit[1:], "--max-iter", 20, "--alpha", 1e-4) == 0
    verdict = run(*validate[1:])
    out, _ = capsys.readouterr()
    assert verdict == (0 if "AlSsnn passes." in out else 1)
    assert re.search(r"^pass  independence", out, re.M)
    for command in rest:  # so short a fit may fail, and nothing is designed for it
        force = ["--force"] if verdict and command[1] == "control" else []
        assert run(*command[1:], *force) == 0, command
    step = np.genfromtxt("design/step.csv", delimiter=",", skip_header=1)
    assert np.isfinite(step).all()
    for name in ("report.html", "design/gain.csv", "firmware/plant.c"):
        assert Path(name).stat().st_size > 10


# CSV files


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_reads_any_common_delimiter(tmp_path, delimiter):
    path = write_csv(tmp_path / "plant.csv", delimiter)
    u, y, labels = read_csv(path, ["u"], ["y"])
    np.testing.assert_allclose(np.hstack([u, y]), np.hstack([*RECORD]), rtol=1e-8)
    assert labels is None


def test_reads_columns_in_the_order_asked_for(tmp_path):
    path = tmp_path / "plant.csv"
    text = '\ufeff"t", "u, left",y,note,u2\n0,1,2,free text,3\n\n1,4,5,,6\n,,,,\n'
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"columns: t,"):
        read_csv(path, ["x"], ["y"])
    path.write_text(text.replace(', "', ',"'), encoding="utf-8")
    u, y, labels = read_csv(path, ["u2", "u, left"], ["y"], "t")
    np.testing.assert_array_equal(u, [[3, 1], [6, 4]])
    np.testing.assert_array_equal(y, [[2], [5]])
    assert labels.tolist() == ["0", "1"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("u,z\n1,2\n", r"must have one column 'y', got none\. .* the columns: u, z\."),
        ("u,y,y\n1,2,3\n", r"must have one column 'y', got several\. .* u, y, y\."),
        ("u [V],y\n1,2\n", r"names the columns: u \[V\], y\. Did you mean 'u \[V\]'\?"),
        ("u,y\n", r"must hold samples below its header, got none\. Write one line"),
        ("", r"must have one column 'u', got none\."),
        ("u,y\n1,2\n\n1,off\n", r"got 'off' in column 'y' at line 4\. Leave the cell"),
        ("u,y\n1,2\n,3\n", r"finite numbers .* got '' in column 'u' at line 3\."),
        ("u,y\n1,2\n,\n3,4\n", r"got '' in column 'u' at line 3\. .* fill the gap"),
        ("u,y\n1,2\nnan,3\n", r"got 'nan' in column 'u' at line 3\. .* fill the gap"),
        ("u,y\n1,2\n1,inf\n", r"got 'inf' in column 'y' at line 3\."),
        ("u,y\n" + "1,\n2,\n" * 20, r"y: not measured at 40 of 40 samples"),
        ("u;y\n1,5;2\n", r"with a decimal point, got '1,5' in column 'u' at line 2\."),
        ("u,y\n" + "1" * 200_000 + ",2\n", r"field larger than field limit"),
    ],
)
def test_wrong_files(tmp_path, text, message, capsys):
    path = tmp_path / "plant.csv"
    path.write_text(text, encoding="utf-8")
    assert run_fit(path) == 2
    assert re.search(message, capsys.readouterr().err)


def test_gaps_of_outputs_are_not_measured(tmp_path):
    path = tmp_path / "plant.csv"
    path.write_text("a,y,b,z\n1,,2,3\n4,5,6\n7,NaN,8, nan \n9,10,11,12\n")
    u, y, _ = read_csv(path, ["a", "b"], ["y", "z"])
    np.testing.assert_array_equal(u, [[1, 2], [4, 6], [7, 8], [9, 11]])
    nan = np.nan
    np.testing.assert_array_equal(y, [[nan, 3], [5, nan], [nan, nan], [10, 12]])


@pytest.mark.usefixtures("rough_certificates")
def test_gaps_of_outputs_from_fit_to_report(
    linear_plant, tmp_path, monkeypatch, capsys
):
    lines = linear_plant.read_text().splitlines()
    for k in range(1, len(lines), 4):  # `angle` comes at another rate
        cells = lines[k].split(",")
        lines[k] = ",".join([*cells[:4], "" if k % 8 == 1 else "nan"])
    path, model = tmp_path / "gaps.csv", tmp_path / "gaps.npz"
    path.write_text("\n".join(lines) + "\n")
    columns = ["--input", "a", "b", "--output", "speed", "angle", "--experiment", "run"]
    options = ["--nx", 2, "--model", "lti", "--dt", 0.1, "--save", model, "-q"]
    figure = tmp_path / "fit.png"
    columns[4:6] = columns[5:3:-1]  # the first output is drawn: that with gaps
    assert columns[4] == "angle"
    assert run("fit", path, *columns, *options, "--figure", figure) == 0
    _, err = capsys.readouterr()
    assert err == "angle: not measured at 300 of 1200 samples.\n"
    assert figure.stat().st_size > 10_000
    assert run("validate", model, *data(path)) == 0
    assert "LinearStateSpace passes." in capsys.readouterr().out
    page = tmp_path / "report.html"
    monkeypatch.setattr(Figure, "savefig", lambda *_, **__: None)  # words matter
    assert run("report", model, *data(path), "-o", page) == 0
    assert "angle 25 %" in page.read_text(encoding="utf-8")
    # eigenvalues of [[0.8, 0.1], [-0.1, 0.7]]
    poles = np.sort_complex(np.linalg.eigvals(alssnn.load(model).A_))
    np.testing.assert_allclose(poles, [0.75 - 0.0866j, 0.75 + 0.0866j], atol=0.01)


@pytest.mark.filterwarnings("always")
@pytest.mark.parametrize(
    ("name", "step", "message"),
    [
        ("time [s]", 0.05, None),
        ("t", 0.05000001, None),
        ("Time", 2.0, "'Time' are 2, but the sampling time is 0.05 s. .* use --dt 2"),
        ("t_s", -0.05, "between -0.05 and -0.05 s. Models need a fixed rate"),
        ("time [ms]", 50.0, None),
        ("Time_ms", 100.0, "are 0.1 s, but the sampling time is 0.05 s. Use --dt 0.1"),
        ("t_min", 50.0, None),  # may be a temperature
        ("timeout_ms", 7.0, None),
        ("throttle", 50.0, None),
        ("time (s)", None, "between 0.01 and 0.09 s. Models need a fixed rate"),
    ],
)
def test_a_column_of_time_is_compared(name, step, message, tmp_path, capsys):
    rng = np.random.default_rng(0)
    u = rng.standard_normal(400)
    y = np.convolve(u, [0, 0.5, 0.3, 0.1])[:400]
    t = np.arange(400) * (step or 0.05)
    if step is None:
        t[1::2] += 0.04
        t -= t[0]
    path = tmp_path / "plant.csv"
    table = np.column_stack([t, u, y])
    np.savetxt(path, table, delimiter=",", header=f"{name},u,y", comments="")
    assert run_fit(path, "--models", "lti", "--nx", 2, "--dt", 0.05, "-q") == 0
    err = capsys.readouterr().err
    if message is None:
        assert "column" not in err
    else:
        assert re.search(message, err)


@pytest.mark.filterwarnings("always")
def test_records_of_another_sampling_time_are_told(tmp_path, capsys):
    u = np.random.default_rng(0).standard_normal(400)
    y = np.convolve(u, [0, 0.5, 0.3, 0.1])[:400]
    for name, dt in (("train.csv", 0.05), ("like.csv", 0.05), ("slow.csv", 0.1)):
        table = np.column_stack([dt * np.arange(400), u, y])
        options = {"delimiter": ",", "header": "t,u,y", "comments": ""}
        np.savetxt(tmp_path / name, table, **options)
    train, like, slow = (tmp_path / f"{name}.csv" for name in ("train", "like", "slow"))
    model = tmp_path / "plant.npz"
    fit = [train, "--model", "lti", "--nx", 2, "-q"]
    assert run_fit(*fit, "--time-column", "t", "--test", like, "--save", model) == 0
    capsys.readouterr()
    assert run_fit(*fit, "--time-column", "t", "--test", slow) == 2
    words = "the sampling time of the other record, 0.05 s, got 0.1 s in 't'. Resample"
    assert_one_line(capsys, words)
    words = "'t' are 0.1, but the sampling time is 0.05 s. If the column is in seconds"
    assert run_fit(*fit, "--dt", 0.05, "--test", slow) == 0
    assert words in capsys.readouterr().err
    for command in (["validate"], ["simulate", "-o", tmp_path / "y.csv"]):
        told = []
        for path in (like, slow):
            run(command[0], model, "--data", path, *command[1:], "--overwrite", "-q")
            told.append(capsys.readouterr().err)
        assert words in told[1] and "resample the record" in told[1]
        assert "column" not in told[0]


@pytest.mark.parametrize(
    ("name", "step", "unit"),
    [
        ("time_ms", 50, "ms"),
        ("t [ms]", 50, "ms"),
        ("T_US", 50000, "us"),
        ("clock/\u00b5s", 50000, "\u03bcs"),
        ("time (min)", 0.05 / 60, "min"),
        ("Zeit in h", 0.05 / 3600, "h"),
        ("rhythms", 0.05, "seconds"),
        ("t (s)", 0.05, "seconds"),
    ],
)
def test_a_column_of_time_has_the_unit_of_its_name(name, step, unit, tmp_path, capsys):
    u = np.random.default_rng(0).standard_normal(200)
    y = np.convolve(u, [0, 0.5, 0.3, 0.1])[:200]
    path, model = tmp_path / "plant.csv", tmp_path / "plant.npz"
    table = np.column_stack([step * np.arange(200), u, y])
    options = {"delimiter": ",", "comments": "", "encoding": "utf-8"}
    np.savetxt(path, table, header=f"{name},u,y", **options)
    argv = ["--model", "lti", "--nx", 2, "--time-column", name, "--save", model]
    assert run_fit(path, *argv, "--test", path) == 0
    err = capsys.readouterr().err
    assert err.count(f"Sampling time: 0.05 s, by the column {name!r}, which is") == 1
    assert f"taken to be in {unit}.\n" in err
    assert alssnn.load(model).dt == 0.05
    assert run_fit(path, *argv, "--overwrite", "--quiet") == 0
    assert ("Sampling time: 0.05 s" in capsys.readouterr().err) == (unit != "seconds")
    record = alssnn.datasets.Record.from_csv(path, "u", "y", time=name)
    assert record.dt == pytest.approx(0.05)


@pytest.mark.parametrize("kind", ["input", "output"])
def test_a_model_of_what_drifts_is_kept(kind, tmp_path, capsys):
    """Its free run is far from the record, for none knows where the walk went."""
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-1, 1, 80), 10)
    walk, y, x = 0.05 * np.cumsum(rng.standard_normal(800)), np.empty(800), 0.0
    for k in range(800):
        y[k] = x + walk[k] * (kind == "output") + 0.02 * rng.standard_normal()
        x = 0.8 * x + 0.2 * (u[k] + walk[k] * (kind == "input"))
    path, model = tmp_path / "plant.csv", tmp_path / "plant.npz"
    options = {"delimiter": ",", "header": "u,y", "comments": ""}
    np.savetxt(path, np.column_stack([u, y]), **options)
    argv = ["--model", "lti", "--nx", 1, "--dt", 1, "--innovations", "--drift", kind]
    assert run_fit(path, *argv, "-q", "--save", model) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "a free run, which does not know what drifts. Judge the model by" in out
    fitted = alssnn.load(model)
    del fitted.feature_names_in_
    tests = u[400:, None], y[400:, None]
    assert fitted.score(*tests) < 0  # which is what was held against it
    assert np.std(fitted.predict_ahead(*tests) - tests[1]) < 0.2 * np.std(tests[1])
    run("info", model)
    assert "simulated without knowing what drifts" in capsys.readouterr().out


@pytest.mark.parametrize("moves_later", [False, True])
def test_an_input_that_does_not_move_is_named(moves_later, tmp_path, capsys):
    u = np.random.default_rng(0).standard_normal((400, 2))
    u[: 200 if moves_later else 400, 1] = 3.0
    y = np.convolve(u[:, 0], [0, 0.5, 0.3, 0.1])[:400]
    path = tmp_path / "plant.csv"
    options = {"delimiter": ",", "header": "u,fan,y", "comments": ""}
    np.savetxt(path, np.column_stack([u, y]), **options)
    fit = ["--output", "y", "--model", "lti", "--nx", "2", "--dt", "1", "-q"]
    for inputs in (["--input", "u", "fan"], ["--input", "u", "--disturbance", "fan"]):
        assert run("fit", path, *inputs, *fit) == 2
        words = "inputs that move where models are trained, got 'fan' at one value"
        assert_one_line(capsys, words)
    if moves_later:
        assert run("fit", path, *inputs, *fit, "--test-size", "0.2") == 0


def test_long_headers_are_shortened(tmp_path):
    path = tmp_path / "plant.csv"
    path.write_text(",".join(f"channel_{i}" for i in range(1000)) + "\n")
    with pytest.raises(ValueError, match=r"channel_9, .*\[\.\.\.\]") as caught:
        read_csv(path, ["u"], ["y"])
    assert len(str(caught.value)) < 600


def test_a_column_has_one_role(plant, capsys):
    assert run("fit", plant, "--input", "u", "--output", "u") == 2
    assert_one_line(capsys, "must name different columns, got 'u' twice. Its role")


# help


def test_version(capsys):
    with pytest.raises(SystemExit, match="0"):
        run("--version")
    assert capsys.readouterr().out == f"alssnn {alssnn.__version__}\n"


COMMANDS = [module.__name__.rpartition("_")[2] for module in _main.COMMANDS]


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_help_teaches_by_examples(command, capsys):
    with pytest.raises(SystemExit, match="0"):
        run(*command, "--help")
    out = capsys.readouterr().out
    assert "examples:\n  alssnn" in out
    assert max(len(line) for line in out.splitlines()) <= 88


def test_no_command_is_wrong_usage(capsys):
    with pytest.raises(SystemExit, match="2"):
        run()
    assert "usage: alssnn" in capsys.readouterr().err


def test_runs_as_a_module_without_matplotlib_or_control():
    code = (
        "import sys, runpy; sys.argv = ['alssnn', '--version']\n"
        "try: runpy.run_module('alssnn', run_name='__main__')\n"
        "except SystemExit as end: assert end.code == 0\n"
        "sys.exit(bool({'matplotlib', 'control', 'cvxpy'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"alssnn {alssnn.__version__}\n"


@pytest.mark.usefixtures("undrawn")
def test_an_unstable_plant_from_its_csv_to_a_controller(tmp_path, capsys):
    record = make_inverted_pendulum(1600, angle=0.1, random_state=0)
    path, model = tmp_path / "loop.csv", tmp_path / "loop.npz"
    table = np.hstack([record.u, record.y])
    np.savetxt(path, table, delimiter=",", header="torque,angle", comments="")
    options = ["--input", "torque", "--output", "angle", "--dt", "0.02", "--nx", "2"]
    options += ["--model", "lti", "--innovations", "--save", model, "--quiet"]
    assert run("fit", path, *options) == 0
    held_out = ["--data", path, "--last", "0.5"]
    assert run("validate", model, *held_out) == 0
    assert run("control", model, *held_out, "-o", tmp_path) == 0
    assert (tmp_path / "gain.csv").exists()
    assert "LinearStateSpace passes" in capsys.readouterr().out

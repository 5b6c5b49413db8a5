"""What a shell expects of the command line: pipes, interrupts, JSON, files."""

import argparse
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import alssnn
from alssnn import cli
from alssnn.cli import _fit, _record
from alssnn.cli._arguments import new_parser, with_numbers
from alssnn.first_look import Recommendation
from helpers import simulate_linear

COLUMNS = ["--input", "a", "b", "--output", "speed", "angle", "--experiment", "run"]
DT = 0.1


def run(*argv):
    return cli.main([str(arg) for arg in argv])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a record of two experiments, and two models of it."""
    folder = tmp_path_factory.mktemp("plant")
    rng = np.random.default_rng(0)
    u = rng.standard_normal((800, 2))
    A, B = np.array([[0.8, 0.1], [-0.1, 0.7]]), np.array([[0.3, 0.1], [0.0, 0.4]])
    y = simulate_linear(A, B, np.eye(2), u) + 0.02 * rng.standard_normal((800, 2))
    lines = ["t,run,a,b,speed,angle"]
    for k, row in enumerate(np.hstack([u, y])):
        cells = [f"{DT * (k % 400):.2f}", str(k // 400), *(f"{z:.9g}" for z in row)]
        lines.append(",".join(cells))
    (folder / "plant.csv").write_text("\n".join(lines) + "\n")
    for name, nx in (("small", 1), ("large", 2)):
        argv = [folder / "plant.csv", *COLUMNS, "--model", "lti", "--nx", nx, "-q"]
        options = ["--time-column", "t", "--save", folder / f"{name}.npz"]
        assert run("fit", *argv, *options) == 0
    return folder


@pytest.fixture
def piped(folder, monkeypatch):
    """Send the record through the standard input."""
    data = (folder / "plant.csv").read_bytes()
    stream = io.TextIOWrapper(io.BytesIO(data))
    monkeypatch.setattr(sys, "stdin", stream)


def data(source):
    return ["--data", source, "--experiment", "run", "--last", "0.5"]


# sampling time, test record


def test_the_column_of_time_is_the_sampling_time(folder):
    assert alssnn.load(folder / "large.npz").dt == DT


def test_a_column_of_unequal_steps_is_refused(tmp_path, capsys):
    rows = [f"{k + (k == 5) * 0.5},{k % 3},{k % 5}" for k in range(40)]
    (tmp_path / "p.csv").write_text("\n".join(["t,u,y", *rows]))
    argv = [tmp_path / "p.csv", "--input", "u", "--output", "y", "--time-column", "t"]
    for command in ("fit", "look"):
        assert run(command, *argv) == 2
        err = capsys.readouterr().err
        assert "`--time-column` must have equal steps above zero, got 0.5 to 1.5" in err


def test_another_record_tests(folder, tmp_path, capsys):
    lines = (folder / "plant.csv").read_text().splitlines()
    (tmp_path / "one.csv").write_text("\n".join(lines[:401]) + "\n")
    (tmp_path / "two.csv").write_text("\n".join([lines[0], *lines[401:]]) + "\n")
    options = ["--model", "lti", "--nx", 2, "-q", "--time-column", "t"]
    more = ["--test", tmp_path / "two.csv", "--save", tmp_path / "m.npz"]
    assert run("fit", tmp_path / "one.csv", *COLUMNS, *options, *more) == 0
    assert "not trained on " in (out := capsys.readouterr().out) and "two.csv" in out
    u, y, _ = alssnn.tables.read_csv(
        tmp_path / "one.csv", ["a", "b"], ["speed", "angle"]
    )
    whole = alssnn.LinearStateSpace(nx=2, dt=DT).fit(u, y)
    saved = alssnn.load(tmp_path / "m.npz")
    np.testing.assert_allclose(
        np.sort(np.linalg.eigvals(saved.A_)), np.sort(np.linalg.eigvals(whole.A_))
    )


def test_a_model_does_not_replace_a_record(folder, piped, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    options = [*COLUMNS, "--model", "lti", "--nx", 2, "--overwrite", "-q"]
    for argv in (["plant.csv"], ["-", "--test", "plant.csv"]):
        with pytest.raises(SystemExit):
            run("fit", *argv, *options, "--save", "plant.csv")
        assert "--save must not be the record itself" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        run("fit", "-", *options, "--test", "-")
    assert "one record, not both" in capsys.readouterr().err
    # what comes through a pipe is no file
    options = [*options, "--time-column", "t"]
    assert run("fit", "-", *options, "--save", "large.npz") == 0


# pipes


@pytest.mark.parametrize(
    "argv",
    [
        ["validate", "large.npz", *data("-")],
        ["compare", "small.npz", "large.npz", *data("-")],
        ["simulate", "large.npz", *data("-"), "--x0", "estimate"],
        ["look", "-", *COLUMNS, "--time-column", "t"],
        ["fit", "-", *COLUMNS, "--time-column", "t", "--nx", "2", "--model", "lti"],
    ],
    ids=lambda argv: argv[0],
)
def test_the_standard_input_is_a_record(folder, piped, monkeypatch, capsys, argv):
    monkeypatch.chdir(folder)
    # the trials of models take most of the time, and know nothing of pipes
    none = Recommendation(None, {}, "Nothing was tried.")
    monkeypatch.setattr("alssnn.first_look._look.recommend", lambda *_, **__: none)
    assert run(*argv, "-q") == 0
    through, err = capsys.readouterr()
    assert err == ""
    assert run(*("plant.csv" if arg == "-" else arg for arg in argv), "-q") == 0
    again = capsys.readouterr().out
    if argv[0] == "fit":  # the last column is the time it took
        through, again = (re.sub(r"\S+$", "", z, flags=re.M) for z in (through, again))
    assert through == again and len(again) > 100


def test_a_report_says_that_its_record_came_through_a_pipe(
    folder, piped, monkeypatch, tmp_path
):
    said: dict = {}

    def report(model, *args, **options):
        said.update(options)

    monkeypatch.setattr(alssnn.LinearStateSpace, "report", report)
    path = tmp_path / "report.html"
    assert run("report", folder / "large.npz", *data("-"), "-o", path) == 0
    source = "Model large.npz, record from the standard input, its last 50 %"
    assert said["source"] == source


def test_messages_name_the_standard_input(folder, monkeypatch, capsys):
    stream = io.TextIOWrapper(io.BytesIO(b"a,b\n1,2\n"))
    monkeypatch.setattr(sys, "stdin", stream)
    assert run("look", "-", "--input", "q", "--output", "b") == 2
    assert "`the standard input` must have one column 'q'" in capsys.readouterr().err
    assert str(_record.source_of(folder / "plant.csv")).endswith("plant.csv")


@pytest.mark.skipif(not hasattr(signal, "SIGPIPE"), reason="no pipes of this kind")
def test_a_reader_that_has_gone_is_no_error(folder):
    command = [sys.executable, "-m", "alssnn", "simulate", "large.npz"]
    read, write = os.pipe()
    os.close(read)  # what `head` leaves behind
    done = subprocess.run(
        [*command, *data("plant.csv")],
        cwd=folder,
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


# JSON, quiet, errors


@pytest.mark.usefixtures("rough_certificates")
@pytest.mark.parametrize(
    ("argv", "keys"),
    [
        (["info", "large.npz"], {"model", "poles", "states", "options"}),
        (["validate", "large.npz", *data("plant.csv")], {"passed", "checks"}),
        (["compare", "large.npz", "small.npz", *data("plant.csv")], {"models"}),
        (["simulate", "large.npz", *data("plant.csv")], {"outputs", "file"}),
        (["plot", "large.npz", *data("plant.csv"), "-o", "{}/p.png"], {"file"}),
        (["control", "large.npz", "-o", "design"], {"gain", "columns", "files"}),
        (["export", "large.npz", "--c", "firmware"], {"files"}),
        (["excite", "steps", "--samples", "50", "-o", "{}/e.csv"], {"file"}),
        (["look", "plant.csv", *COLUMNS], {"findings"}),
        (["report", "large.npz", *data("plant.csv"), "-o", "{}/r.html"], {"file"}),
        (
            ["fit", "plant.csv", *COLUMNS, "--model", "lti", "--nx", "2", "--dt", "1"],
            {"models", "cautions", "saved"},
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
@pytest.mark.filterwarnings("ignore:The steps of the column")
def test_json_is_all_that_is_printed(folder, tmp_path, monkeypatch, capsys, argv, keys):
    monkeypatch.chdir(folder)
    code = run(*(arg.format(tmp_path) for arg in argv), "--json", "-q")
    out, err = capsys.readouterr()
    numbers = json.loads(out)
    assert numbers["exit_code"] == code == 0 and err == ""
    assert keys <= set(numbers)


def test_json_says_what_is_not_finite(capsys):
    from alssnn.cli import _main

    value = {"a": np.array([1.0, np.nan]), "b": np.float64(np.inf), "c": 1 + 2j}
    assert _main.plain(value) == {"a": [1.0, None], "b": None, "c": [1.0, 2.0]}


def test_errors_show_the_usage_of_the_command(folder, capsys):
    for command in ("fit", "info", "control"):
        with pytest.raises(SystemExit):
            argv = [folder / "plant.csv", *(COLUMNS if command == "fit" else [])]
            run(command, *argv, "--nothing")
        err = capsys.readouterr().err
        assert err.startswith(f"usage: alssnn {command} ")
        assert f"alssnn {command}: error: unrecognized arguments: --nothing" in err


def test_a_missing_file_is_named(folder, capsys):
    assert run("info", folder / "none.npz") == 2
    expected = f"alssnn: error: {folder / 'none.npz'}: No such file or directory\n"
    assert capsys.readouterr().err == expected


# files


@pytest.mark.parametrize(
    "argv",
    [
        ["fit", "plant.csv", *COLUMNS, "--model", "lti", "--nx", "2", "--save", "{}"],
        ["validate", "large.npz", *data("plant.csv"), "-o", "{}"],
        ["simulate", "large.npz", *data("plant.csv"), "-o", "{}"],
        ["export", "large.npz", "--mat", "{}"],
        ["excite", "steps", "--samples", "50", "-o", "{}"],
    ],
    ids=lambda argv: argv[0],
)
@pytest.mark.filterwarnings("ignore:The steps of the column")
def test_a_file_is_replaced_only_when_told(folder, tmp_path, monkeypatch, capsys, argv):
    monkeypatch.chdir(folder)
    path = tmp_path / "precious"
    path.write_text("mine")
    argv = [arg.format(path) for arg in argv] + ["-q"]
    assert run(*argv) == 2
    assert "`--overwrite`" in (err := capsys.readouterr().err) or "--overwrite" in err
    assert path.read_text() == "mine"
    assert run(*argv, "--overwrite") == 0
    assert path.read_bytes() != b"mine"


# commands


def test_plot_draws_the_parts_that_a_model_has(folder, tmp_path, capsys):
    path = tmp_path / "p.svg"
    argv = ["plot", folder / "large.npz", *data(folder / "plant.csv"), "-o", path]
    assert run(*argv) == 0
    assert capsys.readouterr().out == f"Figure: {path}\n"
    whole = path.read_text()
    assert run(*argv) == 2 and "--overwrite" in capsys.readouterr().err
    assert run(*argv, "--overwrite", "--part", "residual") == 0
    assert len(path.read_text()) < 0.8 * len(whole)
    assert run(*argv, "--overwrite", "--part", "h") == 2
    assert "A linear model has neither h nor g" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        run(*argv[:-1], "p.txt")
    assert "must end in .png" in capsys.readouterr().err


def test_info_of_a_fit_on_a_cluster_has_no_training_error(folder, tmp_path, capsys):
    model = alssnn.load(folder / "large.npz")
    model.train_score_ = np.nan  # what `fit_remote` leaves
    model.save(tmp_path / "remote.npz")
    assert run("info", folder / "large.npz") == 0
    assert "training error" in capsys.readouterr().out
    assert run("info", tmp_path / "remote.npz") == 0
    out = capsys.readouterr().out
    assert "training error" not in out and "nan" not in out


def test_info_says_what_a_model_is(folder, capsys):
    assert run("info", folder / "large.npz") == 0
    rows = dict(line.split("  ", 1) for line in capsys.readouterr().out.splitlines())
    rows = {name.strip(): value.strip() for name, value in rows.items()}
    assert rows["model"] == "LinearStateSpace" and rows["states"] == "2"
    assert rows["inputs"] == "a, b" and rows["outputs"] == "speed, angle"
    assert rows["sampling time"] == "0.1 s"
    model = alssnn.load(folder / "large.npz")
    poles = [complex(z) for z in rows["poles"].split(", ")]
    np.testing.assert_allclose(
        np.sort_complex(poles), np.sort_complex(np.linalg.eigvals(model.A_)), rtol=1e-3
    )


@pytest.mark.filterwarnings("ignore:X does not have valid feature names")
def test_simulate_writes_what_predict_returns(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    path = tmp_path / "new" / "simulated.csv"
    figure = tmp_path / "figures" / "s.png"
    argv = ["simulate", "large.npz", "--data", "plant.csv", "--experiment", "run"]
    assert run(*argv, "--x0", "estimate", "-o", path, "--figure", figure) == 0
    out, err = capsys.readouterr()
    assert out == f"Simulation: {path}\n" and "speed: fit 9" in err
    assert figure.stat().st_size > 5_000
    t, y, labels = alssnn.tables.read_csv(path, ["time"], ["speed", "angle"], "run")
    u, measured, runs = alssnn.tables.read_csv(
        "plant.csv", ["a", "b"], ["speed", "angle"], "run"
    )
    model = alssnn.load("large.npz")
    x0 = model.estimate_x0(u, measured, runs)
    np.testing.assert_allclose(y, model.predict(u, runs, x0=x0), rtol=1e-8, atol=1e-9)
    assert list(labels) == list(runs)
    assert t[400, 0] == 0 and t[401, 0] == pytest.approx(DT)
    # without outputs in the file: from rest
    lines = (folder / "plant.csv").read_text().splitlines()
    inputs = "\n".join(",".join(line.split(",")[2:4]) for line in lines)
    (tmp_path / "inputs.csv").write_text(inputs + "\n")
    assert run("simulate", "large.npz", "--data", tmp_path / "inputs.csv") == 0
    shown = np.genfromtxt(
        io.StringIO(capsys.readouterr().out), delimiter=",", names=True
    )
    np.testing.assert_allclose(shown["speed"], model.predict(u)[:, 0], atol=1e-8)
    with pytest.raises(SystemExit):
        run(*argv, "--figure", figure)
    assert "--figure needs --x0 estimate" in capsys.readouterr().err


def test_compare_ranks_models_on_one_record(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    figure = tmp_path / "compared.png"
    argv = ["compare", "small.npz", "large.npz", *data("plant.csv")]
    assert run(*argv, "--json", "--figure", figure) == 0
    small, large = json.loads(capsys.readouterr().out)["models"]
    assert (small["name"], large["name"]) == ("small", "large")
    assert np.all(np.array(large["rmse_test"]) < np.array(small["rmse_test"]))
    np.testing.assert_allclose(large["rmse_test"], 0.02, rtol=0.2)  # the noise
    assert figure.stat().st_size > 10_000
    with pytest.raises(SystemExit):
        run("compare", "small.npz", "small.npz", *data("plant.csv"))
    assert "two models have the same name" in capsys.readouterr().err


def test_models_of_other_plants_are_not_compared(folder):
    model = alssnn.load(folder / "large.npz")
    u, y, _ = alssnn.tables.read_csv(
        folder / "plant.csv", ["a", "b"], ["speed", "angle"]
    )
    faster = alssnn.LinearStateSpace(nx=2, dt=0.2).fit(u, y)
    judge = alssnn.ladder.judge_models
    with pytest.raises(ValueError, match=r"one sampling time, got 0\.1, 0\.2"):
        judge({"a": model, "b": faster}, u, y)
    with pytest.raises(ValueError, match="must have one sampling time, got no model"):
        judge({}, u, y)


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["va"], ["validate"]),
        (["fit", "--op"], ["--operating-point"]),
        (["fit", "plant.csv", "--in"], ["--initial-state", "--innovations"]),
        (["info", "--gamma"], []),
        (["info", "lar"], ["large.npz"]),
        (["nothing", "--"], []),
    ],
)
def test_completion_knows_commands_options_and_files(folder, capsys, words, expected):
    assert run("completion") == 0
    line = ["alssnn", *words]
    script = capsys.readouterr().out + (
        f"COMP_WORDS=({' '.join(line)})\nCOMP_CWORD={len(words)}\n_alssnn\n"
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    done = subprocess.run(
        ["bash", "-c", script], cwd=folder, capture_output=True, text=True, check=True
    )
    found = done.stdout.split()
    assert set(expected) <= set(found) and len(found) <= len(expected) + 3
    assert done.stderr == "" and (expected or not found)


# an interrupt


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT between processes")
@pytest.mark.filterwarnings("ignore:X does not have valid feature names")
def test_an_interrupt_saves_the_best_model(tmp_path):
    record = alssnn.datasets.make_pendulum(
        2000, amplitude=4.5, noise=0.01, random_state=0
    )
    table = np.hstack([*record])
    np.savetxt(tmp_path / "p.csv", table, delimiter=",", header="u,y", comments="")
    argv = "fit p.csv --input u --output y --dt 0.05 --nx 2 --model al".split()
    argv += "--gamma-h 0.01 --n-init 100 --save m.npz".split()
    process = subprocess.Popen(
        [sys.executable, "-m", "alssnn", *argv],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    for line in process.stderr:  # the training of networks has begun
        if line.startswith("AlSsnn"):
            break
    time.sleep(1)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert process.returncode == 130, (out, err)
    assert "the best one up to the interrupt" in err and "error: interrupted" in err
    model = alssnn.load(tmp_path / "m.npz")
    assert list(model.feature_names_in_) == ["u"] and model.output_names_ == ["y"]
    assert model.score(record.u[1000:], record.y[1000:]) > 0.9  # the linear one


@pytest.mark.parametrize("text", ["-1e-3", "-5E+2", "-.5", "-3.", "-7", "-inf", "-nan"])
def test_numbers_below_zero_are_no_options(text):
    """In whatever form: limits of inputs in small or large units have exponents."""
    parser = new_parser(argparse.ArgumentParser, "", "")
    parser.add_argument("--u-min", nargs="+", type=float)
    commands = parser.add_subparsers()
    given = new_parser(partial(commands.add_parser, "run"), "", "")
    given.add_argument("--low", type=float)
    argv = with_numbers(["--u-min", text, "0"])
    assert len(parser.parse_args(argv).u_min) == 2
    low = parser.parse_args(with_numbers(["run", "--low", text])).low
    assert low < 0 or np.isnan(low)


@pytest.mark.parametrize(
    ("options", "command"),
    [
        ({}, "last 50 %: validate it there, by --last 0.5."),
        (
            {"experiment": "run", "test_size": 0.25},
            "25 % of every experiment: validate it there, by --last 0.25 "
            "--experiment run.",
        ),
        ({"test": "t.csv"}, "on t.csv: validate it there."),
        ({"test": "t.csv", "experiment": "run"}, "there, by --experiment run."),
    ],
)
def test_what_has_not_trained_is_named_as_it_is_typed(options, command):
    known = {"test": None, "test_size": None, "experiment": None} | options
    assert _fit._unseen(SimpleNamespace(**known)).endswith(command)

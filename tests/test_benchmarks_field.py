"""The field benchmark keeps every fit, whatever happens, and counts what failed."""

import csv
import os
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from alssnn import AlSsnn, LinearStateSpace
from alssnn.metrics import rmse
from alssnn.watch import OUT_OF_TIME
from benchmarks.field import __main__ as command
from benchmarks.field import rivals, runs, table
from benchmarks.field.case import Case, Data, fresh
from benchmarks.field.further import FURTHER
from benchmarks.field.independent import INDEPENDENT
from benchmarks.field.plants import PLANTS
from benchmarks.field.records import RECORDS


def saturated(rng, N):
    u = rng.standard_normal(N)
    y = np.zeros(N)
    for k in range(N - 1):
        y[k + 1] = np.tanh(0.6 * y[k] + u[k])
    return u, y


def broken():
    raise RuntimeError("no\nsuch plant")


def absent():
    raise FileNotFoundError("not here")


def fatal():
    os._exit(3)


TINY = Case(
    "tiny",
    "map",
    partial(fresh, "tiny", saturated, N=200),
    "seen",
    "mV",
    1e3,
    n_init=20,
)
QUICK = {
    "options": {"nx": 1, "gr.n_f": 2, "gr.alpha": 1e-4, "max_iter": 9},
    "jobs": 0,
}


@pytest.fixture
def out(tmp_path):
    return tmp_path / "field.csv"


def said(lines):
    return lambda text: lines.append(text)


def test_rows_are_the_errors_of_the_models(out):
    runs.run([TINY], ["lti", "gr"], 2, out, **QUICK)
    rows = runs.read(out)
    assert [(r["model"], r["seed"], r["options"]) for r in rows] == [
        ("lti", "0", ""),
        ("lti", "0", "max_iter=9; nx=1"),
        ("gr", "0", "alpha=0.0001; max_iter=9; n_f=2; nx=1"),
        ("gr", "1", "alpha=0.0001; max_iter=9; n_f=2; nx=1"),
    ]
    data = TINY.load()
    model = LinearStateSpace(n_init_samples=20).fit(*data.train[0])
    y, y_hat = model.simulate_test(*data.tests["fresh"][0])
    assert len(y) == 180  # the first samples are not scored
    assert float(rows[0]["rmse"]) == pytest.approx(1e3 * rmse(y, y_hat), rel=1e-4)
    for row in rows:
        expected = float(row["rmse"]) / float(rows[0]["rmse"])
        assert float(row["relative"]) == pytest.approx(expected, rel=1e-4)
    assert rows[2]["warnings"] == "ConvergenceWarning 1"
    assert rows[2]["converged"] == "False" and rows[2]["nx"] == "1"
    assert rows[2]["rmse"] != rows[3]["rmse"]


def test_the_page_has_cases_that_are_whole():
    rows = [
        {"case": case, "model": model, "seed": "0", "options": ""} | cells
        for case in ("linear", "tanks")
        for model, cells in {
            "lti": {"relative": "1", "rmse": "0.2", "std": "0.5"},
            "fl": {"relative": "0.25"},
            "al": {"relative": "0.125", "linearization": "0.0123"},
            "gr": {"relative": "1.004"},
        }.items()
    ]
    other = {**rows[1], "options": "nx=1", "relative": "9"}  # no default fit
    alone = {**rows[1], "case": "pendulum"}
    more = [
        {**rows[1], "seed": "1", "relative": "0.5"},
        {**rows[1], "seed": "2", "relative": "0.2"},
    ]
    lines = table.page([*rows, *more, other, alone], command.CASES)
    (y,) = (y for _, y in command.CASES["linear"].load().train)
    noise = 0.05 * y.std() / 0.2  # as the case says
    start = "   linear, 0.500, 0.25 (0.50), 0.12, 1.00, "
    assert lines[-1] == f"{start}1.2%, 3/1/1, {noise:.2f}"
    rows[2]["linearization"] = ""  # of a file that is older than the column
    (line,) = (z for z in table.page(rows, command.CASES) if "linear, 0.500" in z)
    assert line.endswith(f"0.12, 1.00, , 1, {noise:.2f}")
    assert not any(name in line for line in lines for name in ("pendulum", "tanks"))


def test_the_page_of_measured_records_has_their_unit_and_what_others_published():
    rows = [
        {"case": case, "test": test, "model": model, "seed": seed, "options": ""}
        | {"rmse": f"{size * (1 + int(seed)):g}"}
        for case, test in (
            ("linear", "fresh"),
            ("drives", "experiment 1"),
            ("drives", "experiment 2"),
            ("tanks", "validation"),
        )
        for model, seeds, size in (
            ("lti", "0", 0.6),
            ("fl", "01", 0.4),
            ("al", "012", 0.02),
            ("gr", "0", 1.25),
        )
        for seed in seeds
    ]
    rows.append({**rows[-1], "options": "nx=1", "rmse": "9"})  # no default fit
    part = [row for row in rows if row["model"] != "gr" or row["case"] != "drives"]
    *_, line = table.records_page(part, command.CASES)
    assert line.startswith(
        '   tanks, "validation", V, 0.600, 0.600 (0.800), 0.0400 (0.0600), 1.25, 2/3/1,'
    )
    assert "GRU 0.396; LSTM 0.49;" in line and line.endswith(
        'best quoted grey box 0.18"'
    )
    lines = table.records_page(rows, command.CASES)
    names = [line.split(", ")[:2] for line in lines[lines.index("") + 1 :]]
    assert names == [
        ["   tanks", '"validation"'],
        ["   drives", '"experiment 1"'],
        ["   drives", '"experiment 2"'],
    ]


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_a_row_of_a_model_with_a_law_has_what_the_law_leaves(out):
    options = {"nx": 1, "n_h": 2, "n_g": 2, "alpha": 1e-4, "max_iter": 9}
    runs.run([TINY], ["fl", "al", "gr"], 1, out, options=options, jobs=0)
    left = {row["model"]: row["linearization"] for row in runs.read(out)}
    assert left["lti"] == left["gr"] == "" and left["fl"] == "0"
    (test,) = TINY.load().tests["fresh"]
    model = AlSsnn(**options, random_state=0).fit(*TINY.load().train[0])
    model.set_params(n_init_samples=20)
    (expected,) = model.linearizability(*test).linearization_error
    assert float(left["al"]) == pytest.approx(expected, rel=1e-4) and expected > 0


def test_a_run_goes_on_where_the_file_ends(out, monkeypatch):
    runs.run([TINY], ["gr"], 1, out, **QUICK)
    fitted = []
    fit = runs.fit
    monkeypatch.setattr(runs, "fit", lambda job: fitted.append(job.key()) or fit(job))
    rows = runs.run([TINY], ["gr"], 2, out, **QUICK)
    assert fitted == [("tiny", "gr", "1", "alpha=0.0001; max_iter=9; n_f=2; nx=1")]
    assert len(rows) == len(runs.read(out)) == 3


def test_a_crash_is_a_row_and_a_missing_record_is_said(out):
    wrong = Case("broken", "none", broken, "seen")
    lines = []
    missing = Case("absent", "none", absent, "real")
    rows = runs.run([wrong, missing], ["gr"], 1, out, show=said(lines), **QUICK)
    assert [row["error"] for row in rows] == ["RuntimeError: no such plant"] * 2
    assert "absent: not here" in lines
    found = table.summary(rows)
    assert len(found.crashes) == found.fits == 1  # the linear model counts apart
    assert found.agree == {1.3: 0, 2.0: 0}
    # a fit that cannot start knows its tests
    rows = runs.run([TINY], ["fl"], 1, out, options={"nx": 500}, jobs=0)
    assert rows[-1]["test"] == "fresh" and rows[-1]["error"].startswith("ValueError")


@pytest.mark.slow
def test_a_process_that_dies_is_a_row_and_not_the_end(out):
    cases = [Case("fatal", "none", fatal, "seen"), TINY]
    rows = runs.run(cases, ["lti"], 1, out, jobs=2)
    errors = {row["case"]: row["error"] for row in rows}
    assert errors == {"fatal": "the process died", "tiny": ""}


def test_divergence_is_an_infinite_error():
    class Diverging:
        def simulate_test(self, u, y):
            return y, np.full_like(y, np.inf)

    y = np.ones((4, 1))
    assert runs.score(Diverging(), [(y, y)]) == {"rmse": np.inf, "std": np.inf}


def test_what_diverges_is_not_asked_for_its_linearization_error():
    class Diverging(AlSsnn):
        def simulate_test(self, u, y):
            return y, np.full_like(y, np.inf)

        def linearizability(self, *record, **options):
            raise AssertionError("its simulation diverges")

    y = np.ones((4, 1))
    assert runs.tested(Diverging(), [(y, y)]) == {"rmse": np.inf, "std": np.inf}


def test_scores_are_means_over_experiments_and_outputs():
    class Off:
        def simulate_test(self, u, y):
            return y, y + u

    y = np.array([[1.0, 10.0], [-1.0, -10.0]])
    errors = runs.score(Off(), [(np.array([[1.0, 2.0]] * 2), y), (3.0, y)], scale=10)
    assert errors["rmse"] == pytest.approx(10 * np.mean([2.0, 2.5]))
    assert errors["std"] == pytest.approx(np.mean([2.0, 0.25]))


def row(model, seed, value, relative, **more):
    cells = {"case": "tiny", "test": "fresh", "model": model, "seed": str(seed)}
    cells |= {"rmse": str(value), "relative": str(relative)}
    return dict.fromkeys(runs.COLUMNS, "") | cells | more


def test_the_table_counts_what_must_not_happen():
    rows = [row("lti", 0, 2.0, 1.0)]
    rows += [row("fl", s, 1 + s / 10, 0.5 + s / 20, cpu="2") for s in range(3)]
    rows += [row("al", 0, 1.0, 0.5), row("al", 1, 1.0, 0.5), row("al", 2, 3.0, 1.5)]
    rows += [row("gr", 0, "inf", "inf", warnings="RuntimeWarning 1")]
    rows += [row("gr", 1, "nan", "nan", error="ValueError: no")]
    found = table.summary(rows)
    assert found.fits == 8
    assert found.crashes == [rows[-1]] and found.diverging == [rows[-2]]
    assert found.worse == found.silent == [rows[6]]
    assert found.agree == {1.3: 1 / 3, 2.0: 1 / 3}
    case = Case("tiny", "map", None, "seen", "mV", published={"book": {"fresh": 0.25}})
    text = "\n".join(table.report(rows, {"tiny": case}))
    assert "tiny, fresh [mV] seen" in text
    assert "of lti    0.550 worst    0.600" in text
    assert "worse: tiny, fresh, al seed 2: 1.5 of lti" in text
    assert "0.25  published" in text
    assert "1 crashed, diverges" in text


def test_the_command_runs_and_prints_its_file_again(out, monkeypatch, capsys):
    monkeypatch.setattr(command, "CASES", {"tiny": TINY})
    arguments = ["--cases", "ti*", "--models", "gr", "--seeds", "1", "--jobs", "0"]
    arguments += ["--out", str(out), "--set", "nx=1", "n_f=2", "feedback=state"]
    assert command.main([*arguments, "--max-time", "0.5"]) == 0
    with out.open(newline="") as file:
        assert [r["options"] for r in csv.DictReader(file)] == [
            "",
            "max_time=0.5; n_f=2; nx=1",
        ]
    printed = capsys.readouterr().out
    assert command.main(["--table", str(out)]) == 0
    assert capsys.readouterr().out.strip() in printed
    with pytest.raises(SystemExit, match="no case other"):
        command.main(["--cases", "other"])


def test_plants_are_the_same_in_every_call():
    case = PLANTS["gaps"]
    for one, other in zip(case.load().train, case.load().train, strict=True):
        assert np.array_equal(one[1], other[1], equal_nan=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", {**PLANTS, **INDEPENDENT, **FURTHER})
def test_plants_move_and_their_tests_are_new(name):
    data = command.CASES[name].load()
    u, y = data.train[0]
    assert u.ndim == y.ndim == 2 and len(u) == len(y)
    assert np.isfinite(u).all() and not np.isinf(y).any()
    assert (np.nanstd(y, axis=0) > 0).all()
    u_t, y_t = data.tests["fresh"][0]
    assert u.shape[1] == u_t.shape[1] and y.shape[1] == y_t.shape[1]
    assert not np.array_equal(u[:100], u_t[:100])


def test_both_halves_of_the_plants_are_of_all_kinds():
    assert len(PLANTS) >= 26
    splits = Counter(case.split for case in PLANTS.values())
    assert set(splits) == {"seen", "unseen", "later", "latest", "newest"}
    assert abs(splits["seen"] - splits["unseen"]) <= 2
    assert {case.split for case in RECORDS.values()} == {"real"}


def test_published_errors_name_tests_of_their_case():
    tests = {"wh official": {"test"}, "tanks": {"validation"}}
    for name, found in tests.items():
        for errors in RECORDS[name].published.values():
            assert set(errors) <= found


def test_the_page_and_the_readme_say_what_the_runs_say():
    """The table is that of the runs beside it, and the counts are those of the rows."""
    folder = Path(__file__).parents[1]
    rows = runs.read(folder / "doc" / "benchmarks" / "field_runs.csv")
    lines = (folder / "doc" / "benchmarks" / "field.inc").read_text().splitlines()
    body = lines[lines.index("") + 1 :]
    shown = {line.split(",")[0].strip(): line.split(",")[2:5] for line in body}
    medians = {}
    for model, column in (("fl", 0), ("al", 1), ("gr", 2)):
        seeds = {name: [] for name in PLANTS}
        for row in rows:
            if row["model"] == model:
                seeds[row["case"]].append(float(row["relative"]))
        assert seeds.keys() == shown.keys()
        for name, values in seeds.items():
            assert shown[name][column].split()[0] == f"{np.median(values):.2f}"
            assert max(values) <= 1.02
        medians[model] = f"{np.median([np.median(z) for z in seeds.values()]):.2f}"
    text = " ".join((folder / "README.md").read_text().split())
    n_fits = sum(row["model"] != "lti" for row in rows)
    assert f"{n_fits} fits" in text
    assert (
        f"is {medians['fl']} for `FlSsnn`, {medians['al']} for `AlSsnn` and "
        f"{medians['gr']} for `GrSsnn`." in text
    )


def test_the_readme_says_what_the_runs_of_independent_plants_say():
    folder = Path(__file__).parents[1]
    rows = runs.read(folder / "doc" / "benchmarks" / "independent_runs.csv")
    page = (folder / "doc" / "benchmarks" / "independent.inc").read_text()
    assert page.splitlines() == table.page(rows, INDEPENDENT | FURTHER)
    worse = [float(row["relative"]) for row in rows if row["model"] != "lti"]
    above = [ratio for ratio in worse if ratio > 1.02]
    text = " ".join((folder / "README.md").read_text().split())
    words = (
        f"{len(above)} of {len(worse)} fits were worse than the linear model by more"
    )
    assert f"{words} than 2 %, at most by {100 * (max(above) - 1):.0f} %" in text
    assert f"Of {len(INDEPENDENT | FURTHER)} more plants" in text
    text = " ".join((folder / "doc" / "benchmarks.rst").read_text().split())
    assert f"Of these {len(worse)} fits" in text
    assert "Two are worse than the linear model by more than 2 %, both with a" in text
    assert all(row["warnings"] for row in rows if float(row["relative"]) > 1.02)


def test_the_page_and_the_readme_say_what_the_runs_of_measured_records_say():
    folder = Path(__file__).parents[1]
    rows = runs.read(folder / "doc" / "benchmarks" / "record_runs.csv")
    page = (folder / "doc" / "benchmarks" / "records.inc").read_text().splitlines()
    assert page == table.records_page(rows, RECORDS)
    found = {tuple(line.split(", ")[:2]): line.split(", ")[3:7] for line in page[6:]}
    text = (folder / "README.md").read_text()
    part = text[text.index("| record, test |") :].split("\n\n")[0].splitlines()[2:]
    assert len(part) >= 6
    for line in part:
        name, *cells, _published = (cell.strip() for cell in line.strip("|").split("|"))
        record, test = name.split(", ", 1)
        test, _, unit = test.rpartition(" [")
        assert RECORDS[record].unit == unit.rstrip("]")
        key = f"   {record}", f'"{test}"'
        assert cells == [cell.split()[0] for cell in found[key]]


@pytest.mark.skipif("ALSSNN_DATA_HOME" not in os.environ, reason="no records")
@pytest.mark.parametrize("name", sorted(set(RECORDS) - {"wh paper"}))
def test_records_load_and_are_what_they_say(name):
    case = RECORDS[name]
    try:
        data = case.load()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    assert isinstance(data, Data)
    for u, y in [*data.train, *(part for test in data.tests.values() for part in test)]:
        assert u.ndim == y.ndim == 2 and len(u) == len(y)
    for errors in case.published.values():
        assert set(errors) <= set(data.tests)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_our_curve_has_longer_and_longer_fits(monkeypatch):
    data = TINY.load()
    model = runs.MODELS["gr"](nx=1, n_f=2, alpha=1e-4, max_iter=5, random_state=0)
    limits, fit = [], type(model).fit

    def slow(self, u, y):
        limits.append(self.max_time)
        fit(self, u, y).message_ = OUT_OF_TIME if self.max_time < 3 else "settled"
        return self

    monkeypatch.setattr(type(model), "fit", slow)
    rows = rivals.our_curve(model, data.train, data.tests, 20, 1e3, 64)
    assert limits == pytest.approx([1, 2**0.5, 2, 2**1.5, 4])  # the last one suffices
    assert [row[0] for row in rows] == ["fresh"] * 5
    fitted = fit(model, *map(list, zip(*data.train, strict=True)))
    y, y_hat = fitted.set_params(n_init_samples=20).simulate_test(
        *data.tests["fresh"][0]
    )
    assert float(rows[-1][3]) == pytest.approx(1e3 * rmse(y, y_hat), rel=1e-4)
    assert all(0 < float(wall) < 60 for _, wall, *_ in rows)


def test_curves_are_compared_by_their_ends_and_by_when_ours_passes():
    head = ("wh", "official")
    rows = [
        (*head, "gr", 0, "2.0", "2.0", "4.0"),
        (*head, "gr", 0, "5.0", "5.0", "0.9"),
        (*head, "gr", 0, "9.0", "9.0", "0.25"),
        (*head, "jax-sysid", 0, "100.0", "150.0", "1.0"),
        (*head, "gr", 1, "3.0", "3.0", "2.0"),
        (*head, "jax-sysid", 1, "100.0", "150.0", "1.0"),
        (*head, "gr", 2, "3.0", "3.0", "2.0"),
    ]
    first, second = rivals.summary(rows).splitlines()[2:]  # the seed 2 has no pair
    cells = [cell.strip() for cell in first.strip("|").split("|")]
    theirs, ours = ["jax-sysid", "1", "100"], ["gr", "0.25", "9"]
    assert cells == ["wh, official, 0", *theirs, *ours, "0.25", "5.0", "20"]
    assert second.split("|")[-3].strip() == "never"


@pytest.mark.slow
def test_a_motor_does_not_stay_where_a_long_step_has_taken_it():
    """No FL-SSNN is this plant; one that fits its record keeps two places to rest."""
    case = PLANTS["saturating motor"]
    u, y = map(list, zip(*case.load().train, strict=True))
    linear = runs.MODELS["lti"](dt=0.02).fit(u, y)
    options = {"nx": 2, "n_init": 1, "random_state": 2}  # the order and start it takes
    model = runs.MODELS["fl"](dt=0.02, **options).fit(u, y)
    (test,) = case.load().tests.values()
    errors = [
        runs.score(one.set_params(n_init_samples=case.n_init), test)["rmse"]
        for one in (linear, model)
    ]
    assert errors[1] < 0.7 * errors[0]
    highest = np.quantile(u[0], 0.98)
    held = np.r_[np.full(1_000, highest), np.zeros(1_000)]
    # it had stayed at twice the standard deviation of the output
    assert abs(model.predict(held)[-1]) < 0.2 * np.std(y[0])

"""The reproduction of the paper runs, and its tables say what was measured."""

import csv
from dataclasses import replace

import control
import numpy as np
import pytest

from alssnn.datasets import Record, make_wiener_hammerstein
from benchmarks import mirror
from benchmarks.paper import __main__ as command
from benchmarks.paper import published, report, studies, tables
from benchmarks.paper.figures import envelope


@pytest.fixture(scope="module")
def circuit():
    """The study of the circuit on a short simulated record, and its fits."""
    record = make_wiener_hammerstein(1500, random_state=0)
    train, test = record.split(0.6)
    models, gammas = studies.wiener_hammerstein_models(float(np.var(train.y)), 0, True)
    for model in {*models.values(), *gammas.values()}:
        if model.get_params().get("max_iter", 0) > 5:
            model.set_params(max_iter=5)
        if "alpha" in model.get_params():  # the tables, not the models, are of interest
            model.set_params(alpha=0.0, n_init=1)
        model.set_params(integrators=0)
    data = "Simulated circuit", "V", train, test
    study = studies.Study("wh", *data, models, gammas, official=(train, test))
    with pytest.warns(UserWarning, match="stopped after"):
        fits = studies.run(study)
    return study, *fits


def small_prey_predator(seed, quick):
    study = studies.prey_predator(seed, quick, n_samples=400)
    for model in study.models.values():  # the wiring, not the models, is of interest
        model.set_params(integrators=0)
    return study


@pytest.fixture
def prey(monkeypatch):
    monkeypatch.setitem(studies.STUDIES, "prey", small_prey_predator)


def columns(table):
    """Return a table as a list of cells by the title of the column, once each."""
    rows = list(csv.reader(table.to_csv().splitlines()))
    return {title: cells for title, *cells in zip(*rows, strict=True)}


def test_the_command_writes_tables_and_figure(prey, tmp_path, capsys):
    arguments = ["--study", "prey", "--quick", "--output"]
    texts = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        assert command.main([*arguments, str(folder)]) == 0
        texts.append(capsys.readouterr().out)
        assert (folder / "prey.png").stat().st_size < 150_000
        for name in ("accuracy", "open_loop", "closed_loop", "training"):
            path = folder / f"prey_{name}.csv"
            rows = list(csv.reader(path.read_text("utf-8").splitlines()))
            assert len({len(row) for row in rows}) == 1
            assert rows[0][1:] and len(rows) > 2
        page = (folder / "prey.md").read_text("utf-8")
        part = (folder / "prey.inc").read_text("utf-8")
        for word in ("AL-SSNN, state feedback", "FL-SSNN", "load", "0.095"):
            assert word in page and word in part
    # two runs agree to the last digit, times aside
    for name in ("accuracy", "open_loop", "closed_loop"):
        a, b = ((tmp_path / d / f"prey_{name}.csv").read_bytes() for d in ("a", "b"))
        assert a == b
    assert "Accuracy and linearity" in texts[0]


def test_accuracy_shows_what_was_measured(circuit):
    study, fits, _ = circuit
    table = columns(tables.accuracy(study, fits))
    i = table["model"].index("AL-SSNN")
    fit = fits["AL-SSNN"]
    y, y_hat = fit.model.simulate_test(*study.test)
    assert float(table["test"][i]) == pytest.approx(np.std(y - y_hat), rel=0.05)
    assert table["test, paper"][i] == "0.00055"
    error = 100 * fit.model.linearizability(*study.test).linearization_error[0]
    assert table["linearization error"][i] == f"{error:.3g} %"
    assert table["linearization error"][table["model"].index("FL-SSNN")] == "0"
    record = fit.model.linearizability(*study.test)
    y = study.test.y - fit.model.y_offset_
    error = np.sqrt(np.mean(record.e[300:] ** 2) / np.mean(y[300:] ** 2))
    assert table["settled"][i] == report.percent(error)  # of 600 samples, half


def test_gamma_is_converted_to_an_output_of_unit_variance(circuit):
    study, fits, gammas = circuit
    assert list(gammas) == list(published.GAMMA)
    for gamma, fit in gammas.items():
        assert fit.model.gamma * np.var(study.train.y) == pytest.approx(gamma)
    assert gammas[1] is fits["AL-SSNN"]  # fitted once


def test_certificate_bounds_what_the_closed_loop_does(circuit):
    study, fits, _ = circuit
    table = tables.certificate(study, fits)
    paper = dict(zip(table.header, table.rows[0], strict=True))
    assert paper["psi eps²/phi"] == "0.00031"
    assert any("0.0031" in note for note in table.notes)  # what its figures give
    found = tables.certificates(study, fits[studies.STATE].model)["best phi"]
    assert found.holds and found.verify()
    assert found.eps >= fits[studies.STATE].linearity.closed_omega_max


def test_requirements_compare_and_count_a_divergence_as_missed(circuit):
    study, fits, gammas = circuit
    named = {c.name: c for c in tables.checks(study, fits, gammas)}
    assert named["GR-SSNN, test, V"].value == fits["GR-SSNN"].rmse_test
    bad = {**fits, "AL-SSNN": replace(fits["AL-SSNN"], rmse_test=np.inf)}
    named = {c.name: c for c in tables.checks(study, bad, gammas)}
    assert not named["AL-SSNN, test, V"].holds and "MISSED" in str(
        named["AL-SSNN, test, V"]
    )


def test_a_table_is_written_in_every_format():
    header, rows = ("model", "|g|, mean"), [("AL-SSNN, state", "0.5")]
    table = report.Table("x", "Title", header, rows, ("A note.",))
    assert table.to_csv() == 'model,"|g|, mean"\n"AL-SSNN, state",0.5\n'
    assert r"| model | \|g\|, mean |" in table.to_markdown()
    assert '   "AL-SSNN, state",0.5\n\nA note.' in table.to_rst()
    assert table.to_text().splitlines()[2] == "AL-SSNN, state        0.5"
    with pytest.raises(ValueError, match="must have 2 cells"):
        report.Table("x", "Title", header, [("one",)])


def test_numbers_are_short_and_say_when_there_is_none():
    assert [report.number(v) for v in (None, 4.3e-4, 25.16, np.inf)] == [
        "",
        "0.00043",
        "25.2",
        "diverges",
    ]
    assert report.percent(0.00151) == "0.151 %"
    assert report.percent(np.inf) == "diverges"


def test_the_envelope_keeps_the_extremes(rng):
    t, z = np.arange(50_000.0), rng.standard_normal(50_000)
    t_few, z_few = envelope(t, z)
    assert len(t_few) <= 4000 and np.all(np.diff(t_few) >= 0)
    assert (z_few.min(), z_few.max()) == (z.min(), z.max())
    np.testing.assert_array_equal(z_few, z[t_few.astype(int)])
    np.testing.assert_array_equal(envelope(t[:9], z[:9])[1], z[:9])


def test_the_mirror_is_fitted_to_realizations_of_every_level(rng):
    train = [Record(*rng.standard_normal((2, 8, 1)), 1.0) for _ in range(6)]
    us, ys = mirror.of_every_level(train, 1)
    for i, (u, y) in enumerate(zip(us, ys, strict=True)):
        assert u is train[2 * i].u and y is train[2 * i].y
    assert len(us) == 3 and len(mirror.of_every_level(train, 2)[0]) == 6


def test_the_modal_form_of_the_mirror_is_the_same_system(rng):
    A = np.diag([0.9, 0.5, 0.2]) + np.triu(rng.standard_normal((3, 3)), 1)
    A = np.block(
        [[A, np.zeros((3, 2))], [np.ones((2, 3)), np.array([[0.6, 0.3], [-0.3, 0.6]])]]
    )
    B, C = rng.standard_normal((5, 2)), rng.standard_normal((3, 5))
    system = control.ss(A, B, C, rng.standard_normal((3, 2)), 0.1)
    found, bounds = mirror.modal(system)
    z = np.exp(0.1j * np.linspace(0, 30, 7))
    np.testing.assert_allclose(found(z), system(z), atol=1e-10)
    low, high = bounds["A"]
    assert np.isinf(high).sum() == np.isinf(low).sum() == 3 + 4
    assert np.all((low <= found.A) & (found.A <= high)) and found.dt == 0.1


def test_errors_of_the_mirror_are_means_over_outputs_and_records(rng):
    u = rng.standard_normal((300, 1))
    y = np.column_stack([u, 2 * u])

    class Model:
        def estimate_x0(self, u, y):
            assert len(u) == len(y) == mirror.WINDOW
            return "x0"

        def simulate(self, u, x0):
            assert x0 == "x0"
            return np.column_stack([u + 1e-6, 2 * u - 3e-6])

    tests = {"low": [Record(u, y, 1.0)], "high": [Record(u, y + 1e-6, 1.0)] * 2}
    found = mirror.errors(Model(), tests.values())
    np.testing.assert_allclose(found, [2.0, 2.0], rtol=1e-6)
    train = [Record(u, y + shift, 1.0) for shift in (0, 0, 0, 0, 5e-6, 5e-6)]
    assert mirror.row(Model(), train, tests) == "2.0000 2.0000 | 2.0000 2.0000 6.0000"

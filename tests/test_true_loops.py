"""The benchmark of true loops designs alike, and counts what failed."""

from dataclasses import replace

import numpy as np
import pytest

from alssnn import FlSsnn, LinearStateSpace
from alssnn.feedback import designed_loop
from benchmarks import true_loops as command
from benchmarks._tables import replace_runs
from benchmarks.closed_loop import references
from benchmarks.true_loops import CASES, attempt, design, judge, row, summarize


@pytest.fixture(scope="module")
def fan():
    case = replace(CASES["fan"], n_steps=3)
    return case, case.make(600, noise=0.01, random_state=0)


def test_the_design_does_not_depend_on_the_units_of_v(fan):
    case, record = fan
    loops = []
    for unit in (1.0, 50.0):
        model = LinearStateSpace(nx=2, dt=record.dt).fit(unit * record.u, record.y)
        K = design(model, case, record.y.std(axis=0))
        loops.append(np.sort_complex(designed_loop(model, K).poles()))
    np.testing.assert_allclose(*loops, rtol=1e-6)


def test_a_linear_model_follows_its_own_design_and_not_on_the_plant(fan):
    case, record = fan
    run = attempt(case, record, LinearStateSpace(nx=2, dt=record.dt), 0)
    assert run.predicted < 1e-9 and 0 < run.reported < 0.5 and not run.failure
    assert 0.02 < run.deviation < 0.5


@pytest.mark.filterwarnings("ignore:The limit .* is beyond the training data")
def test_what_is_reported_of_a_law_that_nearly_fits_is_true_within_a_factor_2():
    case, ratios = CASES["valve"], []
    options = {"nx": 1, "n_h": 4, "n_init": 1, "feedback": "state"}
    options |= {"disturbances": [1], "input_map": "monotone", "integrators": 0}
    for seed in range(1, 5):
        record = case.make(1_000, noise=0.01, random_state=seed)
        model = FlSsnn(**options, dt=record.dt, random_state=seed)
        run = attempt(case, record, model, seed)
        assert run.deviation < 0.01 and run.predicted < 1e-9
        ratios.append(run.reported / run.deviation)
    # of one record, it is up to 2.5
    assert 0.5 < np.median(ratios) < 2


def test_disturbances_move_in_the_loop_and_in_its_design():
    case = replace(CASES["valve"], n_steps=3)
    record = case.make(600, noise=0.01, random_state=0)
    d = command.disturbances(case, 0, 270)
    assert d.shape == (1, 270)
    assert d.std() > 0.5 * record.u[:, 1].std()
    runs = [
        attempt(
            case, record, LinearStateSpace(nx=1, dt=record.dt, disturbances=[1]), 0
        ),
        attempt(
            replace(case, disturbances=()),
            case.make(600, noise=0.01, disturbance=False, random_state=0),
            LinearStateSpace(nx=1, dt=record.dt),
            0,
        ),
    ]
    for run in runs:
        assert run.predicted < 1e-9 and 0.01 < run.deviation < 1 and not run.failure


def test_runs_take_the_place_of_those_of_the_same_plant_and_model(tmp_path):
    path, columns = tmp_path / "runs.csv", ("plant", "model", "seed")
    first = [("fan", "LTI", 0), ("fan", "FL", 0), ("valve", "FL", 0)]
    replace_runs(path, columns, first, "old", n_first=2)
    table = replace_runs(path, columns, [("fan", "FL", 1)], "new", n_first=2)
    assert table == [
        ["fan", "LTI", "0", "old"],
        ["valve", "FL", "0", "old"],
        ["fan", "FL", "1", "new"],
    ]
    assert path.read_text().splitlines()[1:] == [",".join(row) for row in table]


def test_the_input_map_reaches_the_models(monkeypatch):
    asked = []

    def model(**options):
        asked.append(options.get("input_map"))

    for name in command.MODELS:
        monkeypatch.setitem(command.MODELS, name, model)
    fine = command.Run(0.1, 0.0, 0.0, 1.0, "")
    monkeypatch.setattr(command, "attempt", lambda *args: fine)
    rows = command.compare("fan", 0, ["identity", "monotone"])
    # the default is not said
    assert asked == [None, None, "monotone", "monotone"]
    labels = [
        "LTI",
        *(f"{m}, {i}" for i in ("identity", "monotone") for m in ("FL", "AL")),
    ]
    assert [r[1] for r in rows] == labels
    rows = command.compare("fan", 0, ["monotone"], models=["AL"])
    assert [r[1] for r in rows] == ["LTI", "AL, monotone"]


def test_references_have_a_row_per_output():
    case = CASES["arm"]
    r = references(case, 0, np.array([1.0, -1.0]))
    assert r.shape == (2, case.settle + case.n_steps * case.hold)
    np.testing.assert_array_equal(r[:, 0], [1.0, -1.0])
    assert np.abs(r - [[1.0], [-1.0]]).max() <= case.reference


def test_a_lost_ball_and_a_diverging_loop_are_failures():
    case = replace(CASES["levitation"], settle=0)
    designed = 10 + np.sin(np.arange(100.0))[None]
    assert judge(case, designed, designed) == ("", 0.0)
    y = designed.copy()
    y[0, 60:] = 1.0  # at the magnet
    assert judge(case, y, designed) == ("lost", np.inf)
    free = replace(case, travel=(-np.inf, np.inf))
    for wrong in (np.nan, 1e3):
        y[0, 60:] = wrong
        assert judge(free, y, designed) == ("diverged", np.inf)


def test_the_summary_counts_failures_and_agreement():
    fine = command.Run(0.01, 0.012, 0.03, 1.0, "")
    linear = command.Run(0.1, 0.0, 0.0, 1.0, "")
    lost = command.Run(np.inf, np.nan, np.nan, 1.0, "lost")
    runs = [(fine, linear), (lost, linear), (fine, lost), (lost, lost)]
    rows = [row("p", "m", k, *pair) for k, pair in enumerate(runs)]
    (line,) = summarize(rows)
    told = dict(zip(command.TITLES[:6], line[:6], strict=True))
    assert told["seeds"] == 4 and told["ratio"] == pytest.approx(0.1)
    # predicted agrees twice, reported never; two failures of either kind
    assert line[-6:] == (2, 0.03, 0, 0, 2, 2)
    outside = command.Run(0.01, 0.012, np.nan, 1.0, "")
    (line,) = summarize([row("p", "m", 0, outside, linear)])
    assert line[-4:] == (0, 1, 0, 0)  # nothing is reported, which is said

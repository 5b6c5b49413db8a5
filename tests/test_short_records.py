"""Default fits of short records, and the benchmark that counts them."""

import warnings

from sklearn.exceptions import ConvergenceWarning

from alssnn import GrSsnn
from benchmarks import short_records
from benchmarks.field import runs

CASES = {case.name: case for case in short_records.CASES}


def fitted(model, name):
    """Return a model fitted to a case, and its error relative to the linear model."""
    data = CASES[name].load()
    (u, y), test = data.train[0], data.tests["fresh"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        linear = runs.MODELS["lti"]().fit(u, y)
        model.fit(u, y)
    return model, runs.score(model, test)["rmse"] / runs.score(linear, test)["rmse"]


def test_networks_do_not_take_fewer_states_for_a_comparison_that_ends_early():
    """Two states behind a dead zone: models of one state come down sooner.

    The defaults, but of these two orders and from one start: others change nothing.
    """
    model, error = fitted(GrSsnn([1, 2], n_init=1, random_state=0), "brief dead zone")
    assert model.nx_ == 2
    assert error < 0.3


def test_both_halves_have_plants_that_are_short():
    splits = [case.split for case in CASES.values()]
    assert splits.count("seen") == splits.count("unseen") == 8
    for case in CASES.values():
        (u, y), *others = case.load().train
        assert not others and 300 <= len(u) == len(y) <= 1_000


def row(seed, relative, options="", message=""):
    return {
        "seed": seed,
        "options": options,
        "relative": relative,
        "message": message,
        "cpu": "1",
    }


def test_counts_of_a_table():
    by_hand = [row("0", "0.4", "alpha=1"), row("0", "1.3", "alpha=2")]
    defaults = [
        row("0", "1.0", message=f"{short_records.LINEAR}: so it is"),
        row("1", "1.1"),
        row("2", "0.2"),
        row("3", ""),  # a crash
    ]
    *_, last = short_records.table({("plant", "fl"): (defaults, by_hand)})
    assert last.startswith("4 default fits: 2 worse than the linear model, 1 return it")
    assert "1 of them where options set by hand have less than half" in last
    assert "median 2.625" in last


def test_rows_are_those_of_the_defaults_and_of_the_grid(tmp_path, monkeypatch):
    asked = []

    def run(cases, models, seeds, path, *, options=None, **others):
        asked.append((seeds, options))
        return [
            {"case": "brief product", "model": "gr", "options": ""},
            {"case": "brief product", "model": "gr", "options": "alpha=0.01"},
            {"case": "another", "model": "gr", "options": ""},
        ]

    monkeypatch.setattr(short_records, "run", run)
    found = short_records.fits([CASES["brief product"]], ["gr"], 2, tmp_path / "x.csv")
    assert asked[0] == (2, None)
    assert [options["alpha"] for _, options in asked[1:]] == list(short_records.ALPHAS)
    assert [len(rows) for rows in found["brief product", "gr"]] == [1, 1]

"""The verdict of `validate` on models that are known to be good or wrong."""

import numpy as np
import pytest

from benchmarks import verdicts
from benchmarks.wrong_models import PLANTS, WRONG, identified, loop_error, record

pytestmark = [
    pytest.mark.filterwarnings("ignore::UserWarning"),  # fits that stop, as wrong ones
    pytest.mark.filterwarnings("ignore::RuntimeWarning"),  # models that diverge
]


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_model_does_not_pass(name):
    ((_, passed, error, failures),) = verdicts.wrong_models(1, _silent, [name])
    assert not passed and failures
    assert error > 0.015


@pytest.mark.parametrize("start", [0, 10, 20, 30])
def test_good_models_pass(start):
    """Three per plant: two linear ones, two that a law linearizes."""
    failed, counts, _ = verdicts.good_models(3, _silent, start)
    assert not failed
    (plant,) = counts
    assert counts[plant] == 3 and PLANTS[plant].good


def test_the_error_of_the_true_loop():
    rng = np.random.default_rng(0)
    data = record("bent", 600, rng=rng, noise=0.01)
    model = identified("bent", data.u, data.y)
    assert loop_error("bent", model, data.u) < 0.05
    assert loop_error("against", model, data.u) > 0.5  # a law for another plant


def test_the_report_counts_what_was_no_good_model():
    failed = [("linear", "squares, cubes")]
    bad = [("pushed", [0.2, 0.5], "nothing"), ("pushed", [2.0], "free run")]
    rows = [(name, False, 0.5, "free run") for name in WRONG]
    text = "\n".join(verdicts._report(failed, {"linear": 50}, bad, rows))
    assert "false alarms: 1 of 50 good models (2.0%)" in text
    assert f"false passes: 0 of {len(WRONG)} wrong models" in text
    assert "no good models: 2, of which the verdict fails 1." in text
    assert "| pushed | 20%, 50% | nothing |" in text


def _silent(_):
    """Print nothing."""

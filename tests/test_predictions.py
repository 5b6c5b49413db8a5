"""What a predictor is told, how it follows a record, and which one is likeliest."""

from types import SimpleNamespace

import numpy as np
import pytest

import alssnn
from alssnn.innovations import predictor, with_outputs
from alssnn.mapping import Held
from alssnn.models import state_space
from alssnn.predictions import (
    GAP,
    bridged,
    deviance,
    follow,
    likeliest,
    pieces,
    surprise,
    told,
)
from alssnn.simulation import outputs

RNG = np.random.default_rng(0)
STRUCTURE = predictor(state_space(1, 1, 2, noise="innovations"))


def record(n=300, *, spread=(1.0, 1.0)):
    """Return a linear predictor and a record of its errors, of which both are known."""
    theta = STRUCTURE.join({"A": [[0.5]], "B": [[1.0]], "C": [[1.0], [0.5]]})
    u = RNG.standard_normal((n, 1))
    plain = state_space(1, 1, 2)
    y = outputs(plain.lure(plain.join(STRUCTURE.split(theta))), u, np.zeros(1))
    return theta, u, y + np.array(spread) * RNG.standard_normal((n, 2))


def test_deviance_is_the_log_likelihood_of_normal_errors():
    theta, u, y = record(20_000, spread=(0.1, 2.0))
    value = deviance(STRUCTURE, theta, np.zeros((1, 1)), told([(u, y)]))
    assert value == pytest.approx(np.log(0.1**2 * 2.0**2), abs=0.03)


def test_the_likeliest_is_not_that_of_least_cost():
    # an error of the quiet output weighs more than one of the loud output
    theta, u, y = record(20_000, spread=(0.1, 2.0))
    quiet = {**STRUCTURE.split(theta), "C": np.array([[1.0], [0.45]])}
    loud = {**STRUCTURE.split(theta), "C": np.array([[0.9], [0.5]])}
    x0 = np.zeros((1, 1))
    outcomes = [
        ((STRUCTURE, STRUCTURE.join(p), SimpleNamespace(x0=x0, cost=cost)), name)
        for p, name, cost in ((loud, "loud", 1.0), (quiet, "quiet", 2.0))
    ]
    experiments = told([(u, y)])
    assert likeliest(outcomes, experiments)[1] == "quiet"
    assert likeliest(outcomes[:1], experiments)[1] == "loud"


def test_digits_of_an_output_without_errors_decide_nothing():
    # an output that is constant, or has no noise, is predicted to the last digit
    theta, u, y = record(spread=(0.1, 0.0))
    worse = {**STRUCTURE.split(theta), "C": np.array([[0.9], [0.5]])}
    x0 = np.zeros((1, 1))
    exact, rounded = deviance(STRUCTURE, theta, x0, told([(u, y)])), y.copy()
    assert np.isfinite(exact)
    rounded[:, 1] *= 1 + 1e-13
    digits = deviance(STRUCTURE, theta, x0, told([(u, rounded)]))
    assert digits == pytest.approx(exact, abs=1e-6)
    assert exact < deviance(STRUCTURE, STRUCTURE.join(worse), x0, told([(u, y)])) - 0.1


def test_overflow_is_no_likelihood():
    theta, u, y = record()
    p = {**STRUCTURE.split(theta), "A": np.array([[5.0]])}
    experiments = Held(with_outputs([(u, y)]))
    x0 = np.zeros((1, 1))
    assert deviance(STRUCTURE, STRUCTURE.join(p), x0, experiments) == np.inf


def test_pieces_leave_out_what_nobody_measured():
    _, u, y = record()
    y[:3] = y[100 : 101 + GAP] = y[-5:] = np.nan
    y[200:202] = np.nan
    assert pieces([(u, y)]) == [(0, slice(3, 100)), (0, slice(101 + GAP, 295))]
    assert pieces([(u, np.full_like(y, np.nan))]) == [(0, slice(0, 300))]
    assert [len(z) for z, _ in told([(u, y)])] == [97, 295 - 101 - GAP]


def test_a_gap_is_filled_by_what_is_predicted():
    theta, u, y = record()
    theta = STRUCTURE.join({**STRUCTURE.split(theta), "K": [[0.3, 0.1]]})
    y[50:55] = np.nan
    y[70, 1] = np.nan
    x0 = np.array([0.2])
    ((z, _),) = bridged(STRUCTURE, theta, x0[None], with_outputs([(u, y)]))
    _, X = follow(STRUCTURE, theta, x0, *with_outputs([(u, y)])[0])
    p, x = STRUCTURE.split(theta), x0
    for k in range(len(u)):
        y_hat = p["C"] @ x
        seen = np.where(np.isnan(y[k]), y_hat, y[k])
        np.testing.assert_allclose(X[k], x, atol=1e-12)
        np.testing.assert_allclose(z[k, 1:], seen, atol=1e-12)
        x = p["A"] @ x + p["B"] @ u[k] + p["K"] @ (seen - y_hat)


def test_a_record_is_a_surprise_to_what_hangs_on_its_start_or_on_fillings():
    theta, u, y = record(2000, spread=(0.1, 0.1))
    y[50:60], y[1::9, 0] = np.nan, np.nan
    experiments = told([(u, y)])
    good = surprise(STRUCTURE, theta, experiments)
    filled = bridged(STRUCTURE, theta, np.zeros((1, 1)), experiments)
    assert good == deviance(STRUCTURE, theta, np.zeros((1, 1)), filled)
    lines = deviance(STRUCTURE, theta, np.zeros((1, 1)), experiments)
    assert good == pytest.approx(lines)  # without K nothing is seen of them
    p = {**STRUCTURE.split(theta), "K": [[1.5, 0.0]]}  # A - K C = -1: never forgets
    hanging = STRUCTURE.join(p)
    assert surprise(STRUCTURE, hanging, experiments) > good + 1


@pytest.mark.parametrize("spoiled", [0, 1])
def test_a_training_on_predicted_gaps_that_spoils_the_model_is_left_out(
    spoiled, monkeypatch
):
    _, u, y = record(spread=(0.1, 0.1))
    y[::10] = np.nan
    identify, outcomes = alssnn.LinearStateSpace._identify, []

    def identified(self, *args):
        structure, theta, result = identify(self, *args)
        if len(outcomes) == spoiled:
            p = structure.split(theta)
            theta = structure.join({**p, "A": p["A"] + 0.4})
            result.cost = 0.0  # by its own account it is the best of all
        outcomes.append(theta)
        return structure, theta, result

    monkeypatch.setattr(alssnn.LinearStateSpace, "_identify", identified)
    model = alssnn.LinearStateSpace(nx=1, noise="innovations").fit(u, y)
    assert len(outcomes) == 2
    np.testing.assert_array_equal(model._theta, outcomes[1 - spoiled])
    assert (model.cost_ > 0) and len(model.singular_values_)


def test_an_option_set_after_the_fit_changes_nothing():
    u, y = RNG.standard_normal((400, 1)), np.zeros(400)
    for k in range(1, 400):
        y[k] = 0.8 * y[k - 1] + u[k - 1, 0] + 0.3 * RNG.standard_normal()
    model = alssnn.LinearStateSpace(nx=1, noise="innovations").fit(u, y)

    def results():
        covariance = model.parameter_covariance(u, y).covariance
        return model.predict_ahead(u, y), model.aic(u, y), covariance

    before = results()
    model.set_params(noise="output")
    for one, other in zip(before, results(), strict=True):
        np.testing.assert_array_equal(one, other)

import warnings

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning

from alssnn import FlSsnn, LinearStateSpace
from alssnn.rectified import restore_sign
from helpers import simulate_linear
from models import fl_ssnn

A = np.array([[0.8, 0.3, 0.0], [-0.3, 0.8, 0.1], [0.0, 0.0, 0.5]])
B = np.array([[1.0, 0.0], [0.0, 0.3], [0.0, 1.0]])
C = np.array([[1.0, 0.0, 0.5], [0.0, 0.2, 1.0]])
ZERO = LinearStateSpace(nx=3, operating_point="zero")


@pytest.fixture
def us(rng):
    """Inputs of two experiments, steps around a mean that tells the direction."""
    return [
        np.repeat(rng.uniform(-1, 3.5, (n // 10, 2)), 10, axis=0) for n in (400, 700)
    ]


def sign_errors(s, truth):
    """Return the share of samples of wrong sign, up to the sign of each output."""
    wrong = np.mean(np.vstack(s) * np.vstack(truth) < 0, axis=0)
    return np.minimum(wrong, 1 - wrong)


def test_signs_of_two_outputs_over_experiments(us, rng):
    truth = [simulate_linear(A, B, C, u) for u in us]
    noisy = [abs(s) + 0.01 * rng.standard_normal(s.shape) for s in truth]
    naive = sign_errors(noisy, truth)
    s, model = restore_sign(us, noisy, ZERO)
    assert [part.shape for part in s] == [(400, 2), (700, 2)]
    assert np.all(naive > 0.05)  # there is something to restore
    assert np.all(sign_errors(s, truth) < 0.01)
    for part, y in zip(s, noisy, strict=True):
        np.testing.assert_array_equal(abs(part), abs(y))
    y_hat = abs(np.vstack(model.predict(us, x0="training")))
    assert np.sqrt(np.mean((y_hat - np.vstack(noisy)) ** 2)) < 0.012


def test_one_experiment_keeps_its_shape_and_what_was_not_measured(us):
    truth = simulate_linear(A, B, C, us[1])[:, 0]
    y = abs(truth)
    y[30:40] = np.nan
    s, _ = restore_sign(us[1], y, ZERO)
    assert s.shape == (700,)
    np.testing.assert_array_equal(np.isnan(s), np.isnan(y))
    measured = ~np.isnan(y)
    assert sign_errors([s[measured, None]], [truth[measured, None]]) < 0.01


def test_the_given_model_is_not_touched_and_may_be_nonlinear(us):
    u, y = us[0], abs(simulate_linear(A, B, C, us[0]))
    model = fl_ssnn(nx=3, n_h=2, operating_point="zero", max_iter=3, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        _, fitted = restore_sign(u, y, model, max_turns=2)
    assert type(fitted) is FlSsnn and hasattr(fitted, "A_")
    assert not hasattr(model, "A_")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"max_turns": 0}, "`max_turns` must be at least 1, got 0"),
        ({"model": LinearStateSpace()}, "must have operating_point='zero'"),
    ],
)
def test_errors(arguments, message):
    with pytest.raises(ValueError, match=message):
        restore_sign(np.ones((30, 1)), np.ones((30, 1)), **arguments)

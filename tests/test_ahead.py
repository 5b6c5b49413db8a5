"""Prediction some samples ahead, against plain loops over the observer."""

import warnings

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning, NotFittedError

from alssnn import LinearStateSpace
from alssnn.feedback import DisturbanceObserver
from models import al_ssnn, fl_ssnn

OPTIONS = {"max_iter": 8, "tol": 1e-2, "random_state": 0}
MODELS = {
    "linear": LinearStateSpace(nx=2),
    "al": al_ssnn(nx=2, n_h=2, n_g=2, **OPTIONS),
    "feedthrough": al_ssnn(nx=2, n_h=2, n_g=0, n_k=2, feedthrough=True, **OPTIONS),
    "late": fl_ssnn(nx=2, n_h=(2, 2), input_delay=[2, 0], **OPTIONS),
}


def record():
    """Return inputs and outputs with process and measurement noise, in odd units."""
    rng = np.random.default_rng(1)
    du = rng.standard_normal((300, 2))
    A, B = np.array([[0.8, 0.2], [-0.2, 0.7]]), np.array([[0.4, 0.1], [0.0, 0.5]])
    x, y = np.zeros(2), np.empty((300, 2))
    for k in range(300):
        y[k] = x + 0.3 * du[k]
        noise = 0.3 * rng.standard_normal(2)
        x = A @ x + B @ (du[k] + 0.3 * np.tanh(x)) + noise
    y += 0.05 * rng.standard_normal(y.shape)
    return du * [3.0, 0.02] + [10.0, -1.0], y * [100.0, 0.1] + [5.0, 7.0]


@pytest.fixture(scope="module")
def fitted():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return {name: model.fit(*record()) for name, model in MODELS.items()}


@pytest.fixture(params=MODELS)
def model(request, fitted):
    return fitted[request.param]


def plain(model, u, y, steps, x0):
    """Predict sample by sample: filter up to k - steps, then simulate."""
    dynamics, observer = model.plant_.late(), model.observer()
    start = np.zeros(dynamics.lure.nx)
    start[: model.nx_] = x0
    X_hat = observer.filter(u, y, start)
    y_hat = np.empty((len(u), 2))
    for k in range(len(u)):
        x, first = (X_hat[k - steps], k - steps) if k >= steps else (start, 0)
        for i in range(first, k):
            x = dynamics.step(x, u[i])
        y_hat[k] = dynamics.output(x, u[k])
    return y_hat


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_against_a_plain_loop(model, steps):
    u, y = (z[:60] for z in record())
    y = np.where(np.random.default_rng(0).random(y.shape) < 0.2, np.nan, y)
    labels, x0 = np.repeat(["a", "b"], [25, 35]), np.array([[0.5, 0.1], [0.0, -0.4]])
    expected = [
        plain(model, u[part], y[part], steps, start)
        for part, start in zip((slice(0, 25), slice(25, 60)), x0, strict=True)
    ]
    y_hat = model.predict_ahead(u, y, steps, labels, x0=x0)
    scale = y_hat.std(axis=0)
    np.testing.assert_allclose((y_hat - np.vstack(expected)) / scale, 0, atol=1e-10)


def test_far_ahead_is_a_simulation(model):
    u, y = record()
    for steps in (len(u), 10**6, np.inf):
        np.testing.assert_array_equal(
            model.predict_ahead(u, y, steps), model.predict(u)
        )
    first = model.predict_ahead(u, y, 40)[:40]
    np.testing.assert_array_equal(first, model.predict(u)[:40])


def test_one_step_is_the_innovation_of_the_observer(model):
    """x_hat_k - x_{k|k-1} is the gain times what one step ahead misses."""
    u, y = record()
    dynamics, observer = model.plant_.late(), model.observer()
    X_hat = observer.filter(u, y)
    error = y - model.predict_ahead(u, y)
    correction = X_hat[1:] - dynamics.step(X_hat[:-1], u[:-1])
    np.testing.assert_allclose(error[1:] @ observer.gain.T, correction, atol=1e-10)


def test_the_error_grows_with_the_steps(fitted):
    u, y = record()
    model = fitted["feedthrough"]
    observer = model.observer(Q=0.1 * np.eye(2))
    errors = [
        np.std((y - model.predict_ahead(u, y, n, observer=observer)) / y.std(axis=0))
        for n in (1, 2, 4, np.inf)
    ]
    assert errors == sorted(errors)
    assert errors[0] < 0.9 * errors[-1]


def test_only_the_past_is_used(model):
    """An output changes the predictions from `steps` samples later on, no others."""
    u, y = record()
    changed = y.copy()
    changed[50] += [30.0, 0.03]
    moved = np.any(
        model.predict_ahead(u, y, 3) != model.predict_ahead(u, changed, 3), axis=1
    )
    assert not moved[:53].any()
    assert moved[53:56].all()


def test_missing_outputs_are_not_waited_for(model):
    """Without any output, the prediction is the simulation."""
    u, y = record()
    y_hat = model.predict_ahead(u, np.full_like(y, np.nan), 2)
    scale = y.std(axis=0)
    np.testing.assert_allclose((y_hat - model.predict(u)) / scale, 0, atol=1e-11)


def test_lists_come_back_as_lists(fitted):
    u, y = record()
    model = fitted["al"]
    out = model.predict_ahead([u[:100], u[100:]], [y[:100], y[100:]], 2)
    labels = np.repeat([0, 1], [100, 200])
    np.testing.assert_array_equal(
        np.vstack(out), model.predict_ahead(u, y, 2, experiment=labels)
    )
    assert [len(part) for part in out] == [100, 200]


def test_initial_states_of_the_training(fitted):
    u, y = record()
    model = fitted["linear"]
    given = model.predict_ahead(u, y, 5, x0=model.x0_)
    np.testing.assert_array_equal(model.predict_ahead(u, y, 5, x0="training"), given)
    assert np.any(given != model.predict_ahead(u, y, 5))


@pytest.mark.parametrize("steps", [0, -1, 1.5, np.nan])
def test_wrong_steps(fitted, steps):
    with pytest.raises(ValueError, match="`steps` must be a positive integer or inf"):
        fitted["al"].predict_ahead(*record(), steps)


def test_unfitted():
    with pytest.raises(NotFittedError):
        LinearStateSpace().predict_ahead(*record())


def test_predictions_have_the_form_of_the_outputs(fitted):
    pandas = pytest.importorskip("pandas")
    (u, y), model = record(), fitted["linear"]
    plainly = model.predict_ahead(u, y, 3)
    times = pandas.date_range("2026-01-01", periods=len(u), freq="s")
    frame = pandas.DataFrame(y, index=times, columns=["level", "flow"])
    found = model.predict_ahead(u, frame, 3)
    pandas.testing.assert_frame_equal(
        found, pandas.DataFrame(plainly, index=times, columns=["level", "flow"])
    )
    parts = model.predict_ahead([u[:100], u[100:]], [frame[:100], frame[100:]], 3)
    assert [list(part.index) for part in parts] == [
        list(times[:100]),
        list(times[100:]),
    ]
    one = LinearStateSpace(nx=2).fit(u, y[:, 0])
    series = one.predict_ahead(u, frame["level"])
    np.testing.assert_array_equal(series, one.predict_ahead(u, y[:, 0]))
    assert series.name == "level" and series.index.equals(times)


def test_an_observer_of_disturbances(fitted):
    """It begins without a disturbance, and takes off what is constant."""
    u, y = record()
    model = next(iter(fitted.values()))
    observer = DisturbanceObserver(model)
    y_hat = model.predict_ahead(u, y + y.std(axis=0), 1, observer=observer)
    plain = model.predict_ahead(u, y + y.std(axis=0), 1)
    late, shifted = slice(len(y) // 2, None), y + y.std(axis=0)
    biases = [abs(np.mean(z[late] - shifted[late])) for z in (y_hat, plain)]
    assert biases[0] < 0.5 * biases[1]

"""An interrupt at any time leaves the estimator as it was, or fitted."""

import signal
import time
import warnings

import numpy as np
import pytest

from alssnn import AlSsnn
from fuzzing import SCALE

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="no timers on this system"
)


def record(seed, gain):
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=(200, 1)), np.zeros(200)
    for k in range(199):
        y[k + 1] = 0.8 * y[k] + gain * (u[k, 0] + np.tanh(y[k]))
    return u, y


# An interrupt that falls into a callback of the garbage collector is swallowed
# there, by Python and not by the package, and the fit goes on to its end.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_interrupts_at_random_times():
    """Random times of one long fit, half of them on a model that was fitted."""

    def interrupt(*_):
        raise KeyboardInterrupt

    first, second = record(0, 0.1), record(1, 0.3)
    second = second[0] * 1e3, second[1] * 1e3 + 7  # other units: mixing shows
    model = AlSsnn(nx=2, n_h=2, n_g=2, alpha=0.0, n_init=2, max_iter=10, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model.fit(*second)  # imports and compiles
        started = time.perf_counter()
        model.fit(*second)
        duration = time.perf_counter() - started
        old = signal.signal(signal.SIGALRM, interrupt)
        try:
            rng, outcomes = np.random.default_rng(0), set()
            for k in range(round(8 * SCALE)):
                outcomes.add(_one(model, first, second, k % 2, rng, duration))
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, old)
    assert len(outcomes) > 1, outcomes


def _one(model, first, second, refit, rng, duration):
    from sklearn.base import clone

    model = clone(model)
    before = None
    if refit:
        model.set_params(max_iter=2).fit(*first).set_params(max_iter=10)
        before = model.predict(first[0]), model.score(*first)
    try:
        signal.setitimer(signal.ITIMER_REAL, duration * rng.uniform(0.001, 0.95))
        model.fit(*second)
        signal.setitimer(signal.ITIMER_REAL, 0)
    except KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, 0)
    if not hasattr(model, "A_"):
        assert not refit
        assert not [name for name in vars(model) if name.endswith("_")]
        return "not fitted"
    if before is not None and np.array_equal(model.predict(first[0]), before[0]):
        assert model.score(*first) == before[1]
        return "as before"
    # a model of the second record, whole: its scales are those of its parameters
    assert model.y_offset_ == pytest.approx(second[1].mean())
    y_hat = model.predict(second[0], x0="training")
    error = np.mean((y_hat - second[1]) ** 2) / second[1].var()
    assert error <= model.cost_ * (1 + 1e-6) + 1e-9
    return "fitted"

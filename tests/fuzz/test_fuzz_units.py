"""Units change numbers, never words: u and y times powers of two.

Powers of two are exact, so that the fit of a record in other units is the same fit.
What comes of the model has to be the same, too, as far as solvers are exact.
"""

import functools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.certificates import error_gain
from alssnn.feedback import DisturbanceObserver, place
from fuzzing import cases, only_warnings_for_users

N = 240
LIMIT = 0.2  # of inputs of about one: it is reached
NET = {"nx": 2, "alpha": 0.0, "n_init": 1, "max_iter": 4, "random_state": 0}
KINDS = {
    "linear": LinearStateSpace(nx=2),
    "feedthrough": LinearStateSpace(nx=2, feedthrough=True),
    "state": AlSsnn(n_h=2, n_g=2, **NET),
    "output": FlSsnn(n_h=2, feedback="output", **NET),
    "late": FlSsnn(n_h=2, input_delay=2, **NET),
    "one network": GrSsnn(n_f=3, **NET),
    "monotone": FlSsnn(n_h=2, input_map="monotone", **NET),
    "innovations": FlSsnn(n_h=2, noise="innovations", **NET),
    "integrator": FlSsnn(n_h=2, integrators=1, **NET),
    "continuous": FlSsnn(n_h=2, feedback="output", time="continuous", dt=0.1, **NET),
}


def record():
    """Return a record of a plant with a nonlinearity that its input could cancel."""
    rng = np.random.default_rng(0)
    u, y, x = rng.normal(size=(N, 1)), np.zeros((N, 1)), np.zeros(2)
    for k in range(N):
        y[k] = x[0] + 0.02 * rng.normal()
        pushed = u[k, 0] + 0.1 * np.tanh(2 * x[0])
        x = np.array([[0.8, 0.2], [-0.1, 0.7]]) @ x + np.array([0.5, 0.2]) * pushed
    return u, y


def step(controller, model, s_y):
    """Return the input for a reference and a measurement off the operating point."""
    return controller.step(model.y_offset_ + 0.3 * s_y, model.y_offset_ + 0.1 * s_y)


def limits(model, s_u):
    return {
        "u_min": model.u_offset_ - LIMIT * s_u,
        "u_max": model.u_offset_ + LIMIT * s_u,
    }


def by_law(model, u, y, s_u, s_y):
    return step(model.controller(**limits(model, s_u)), model, s_y) / s_u


def by_gain(model, u, y, s_u, s_y):
    K = place(model, 0.1 + 0.1 * np.arange(model.plant_.late().nx))
    return (
        model.controller(K, **limits(model, s_u)).step(
            model.u_offset_ + 0.1 * s_u, model.y_offset_ + 0.1 * s_y
        )
        / s_u
    )


def by_prediction(model, u, y, s_u, s_y):
    mpc = model.mpc(5, **limits(model, s_u), du_max=0.15 * s_u, y_max=np.ptp(y))
    return step(mpc, model, s_y) / s_u


def observed(model, u, y, s_u, s_y):
    observer = DisturbanceObserver(model)
    n = model.plant_.late().nx
    return np.ravel(observer.filter(u, y)[-1, n:]) / s_y


def measured(model, u, y, s_u, s_y):
    z = model.linearizability(u, y)
    return np.hstack([z.linearization_error, z.closed_linearization_error])


def certified(model, u, y, s_u, s_y):
    loop = model.controller().certificate(noise=0.01 * s_y, search=False)
    local = model.local_certificate().holds
    return np.hstack([loop.holds, loop.local.output_bounds / s_y, local])


def bounded(model, u, y, s_u, s_y):
    gain = model.gain_certificate()
    return np.hstack(
        [gain.holds, model.iss_certificate(u, y).holds, gain.gamma * s_u / s_y]
    )


def covered(model, u, y, s_u, s_y):
    tube = model.tube(u, y, level=0.5, horizon=5)
    gain = error_gain(model, u, y, level=0.5).gain
    return np.hstack([tube.quantile / s_y, gain.ravel() * s_u / s_y])


def told(model, u, y, s_u, s_y):
    checks = model.validate(u, y).checks
    return np.array([float(check.passed) for check in checks])


def uncertain(model, u, y, s_u, s_y):
    covariance = model.parameter_covariance(u, y)
    return np.hstack([covariance.noise_covariance.ravel() / s_y**2, covariance.holds])


def planned(model, u, y, s_u, s_y):
    found = model.next_input(u, y, candidates=2, n_samples=20, random_state=0)
    return found.expected


ASKED = [
    *(by_law, by_gain, by_prediction, observed, measured, bounded),
    *(covered, told, uncertain, planned),
]


@functools.cache  # what is said in the units of the record, most of all
def answer(ask, model, s_u, s_y):
    """Return what a method says, or how it refuses."""
    u, y = record()
    u, y = s_u * u, s_y * y
    with only_warnings_for_users(), np.errstate(under="ignore"):
        fitted = fitted_to(model, s_u, s_y)
        try:
            return np.asarray(ask(fitted, u, y, s_u, s_y), dtype=float)
        except ValueError as error:
            return str(error)[:40]  # the words before the first number


@functools.cache
def fitted_to(model, s_u, s_y):
    u, y = record()
    return clone(model).fit(s_u * u, s_y * y)


EXPONENTS = st.integers(-20, 20)


@cases(15)
@given(st.sampled_from(sorted(KINDS)), st.sampled_from(ASKED), EXPONENTS, EXPONENTS)
def test_units_of_records(kind, ask, a, b):
    check(ask, KINDS[kind], 2.0**a, 2.0**b)


@pytest.mark.parametrize("ask", ASKED, ids=lambda ask: ask.__name__)
@pytest.mark.parametrize(("a", "b"), [(-40, 0), (0, 40)])
def test_extreme_units_of_records(ask, a, b):
    check(ask, KINDS["state"], 2.0**a, 2.0**b)


@pytest.mark.parametrize("ask", [by_law, by_prediction, measured])
@pytest.mark.parametrize("s_x", [2.0**-20, 2.0**40])
def test_units_of_states(ask, s_x):
    """Those of a start that the user gives are the user's."""
    A, B, C = np.array([[0.8, 0.2], [-0.1, 0.7]]), np.array([[0.5], [0.2]]), np.eye(2)
    if ask is by_prediction:
        s_x = min(s_x, 2.0**20)
    one, other = (
        LinearStateSpace(linear_start=(A, s * B, C[:1] / s)) for s in (1.0, s_x)
    )
    expected, got = answer(ask, one, 1.0, 1.0), answer(ask, other, 1.0, 1.0)
    np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-6)


@pytest.mark.usefixtures("rough_certificates")
@pytest.mark.parametrize("factor", [2.0**-10, 2.0**10])
def test_certificates_in_other_units(factor):
    check(certified, KINDS["state"], 1.0, factor)


def check(ask, model, s_u, s_y):
    """Assert that a method says the same in other units."""
    expected, got = answer(ask, model, 1.0, 1.0), answer(ask, model, s_u, s_y)
    if isinstance(expected, str) or isinstance(got, str):
        assert str(got)[:40] == str(expected)[:40]
    else:
        np.testing.assert_allclose(got, expected, rtol=1e-3, atol=1e-6)

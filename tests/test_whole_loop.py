"""The whole loop as one form, and what is proved of it."""

import pickle
from dataclasses import replace

import control
import numpy as np
import pytest
from structures import declare

from alssnn.certificates import certify_loop
from alssnn.certificates._whole import _Wires, limit, whole_loop
from alssnn.feedback import LinearizingController, Observer, designed_loop, lqi, lqr
from alssnn.simulation import channels, simulate
from helpers import plant_of_structure, random_theta

NAMES = ["fl", "fl-state", "al", "al-siso", "al-state-output", "al-split"]


def controlled(name, seed=0, *, integrates=True, limits=None, scale=1.0, size=0.3):
    """Return a controller of a random plant of a structure."""
    rng = np.random.default_rng(seed)
    structure = declare(name, rng)
    theta = random_theta(structure, rng, 0.5)
    p = structure.split(theta)
    for key in ("W_h", "W_g"):
        if key in p:
            p[key] = size * p[key]
    plant = plant_of_structure(structure, structure.join(p), rng)
    nx, ny, nv = plant.nx, plant.ny, plant.nv
    if integrates:
        K = lqi(plant, np.eye(nx + ny), 10 * np.eye(nv))
    else:
        K = lqr(plant, np.eye(nx), 10 * np.eye(nv))
    observer = Observer(plant, R=0.1 * np.eye(ny))
    bounds = {}
    if limits is not None:
        bounds = {
            "u_min": plant.v_offset - limits,
            "u_max": plant.v_offset + limits,
        }
    return LinearizingController(plant, scale * K, observer=observer, **bounds)


def run(controller, r, n):
    """Return y and u of the controller, step by step, around its own plant."""
    plant = controller.own
    controller.reset()
    x, Y, U = np.zeros(plant.nx), [], []
    rest = plant.y_offset if controller.tracks else plant.v_offset
    for r_k, n_k in zip(r, n, strict=True):
        y = plant.output(x)
        u = controller.step(rest + r_k, y + n_k)
        x = plant.step(x, u)
        Y.append(y - plant.y_offset)
        U.append(u - plant.v_offset)
    return np.array(Y), np.array(U)


@pytest.fixture(params=NAMES)
def name(request):
    return request.param


@pytest.mark.parametrize("integrates", [True, False])
@pytest.mark.parametrize("limits", [None, 0.2])
def test_the_form_is_the_loop(name, integrates, limits, rng):
    controller = controlled(name, integrates=integrates, limits=limits)
    loop = whole_loop(controller)
    own = controller.own
    nr = own.ny if controller.tracks else own.nv
    r, n = 0.5 * rng.standard_normal((60, nr)), 0.05 * rng.standard_normal((60, own.ny))
    Y, U = run(controller, r, n)
    inputs = np.hstack([r, n])
    X = simulate(loop.lure, inputs, np.zeros(loop.lure.nx))[:-1]
    Z = channels(loop.lure, X, inputs)
    Z = Z[:, : own.ny + own.nv]
    np.testing.assert_allclose(Z, np.hstack([Y, U]), rtol=0, atol=1e-11)
    if limits:
        assert np.abs(U).max() == pytest.approx(limits)


@pytest.mark.parametrize("observer", [True, False])
def test_the_design_is_that_of_the_gain(name, observer, rng):
    controller = controlled(name)
    loop = whole_loop(controller, observer=observer)
    own = controller.own
    r = rng.standard_normal((80, own.ny))
    t = own.dt * np.arange(80)
    wanted = control.forced_response(
        designed_loop(own, controller.gain), t, r.T, squeeze=False
    ).outputs[: own.ny]
    A, B, C, D = loop.design
    x, inputs = np.zeros(len(A)), np.pad(r, ((0, 0), (0, B.shape[1] - own.ny)))
    for k in range(80):
        np.testing.assert_allclose(C @ x + D @ inputs[k], wanted[:, k], atol=1e-11)
        x = A @ x + B @ inputs[k]


@pytest.mark.parametrize("limits", [None, 0.3])
def test_no_run_violates_a_certificate(name, limits):
    rng = np.random.default_rng(1)
    controller = controlled(name, limits=limits, size=0.1)
    own = controller.own
    c = certify_loop(controller, 0.05, noise=0.005)
    assert c.holds and c.verify() >= 0, c
    sizes = c.local.amplitude
    A, B, C, D = whole_loop(controller).design
    trials = [rng.uniform(-1, 1, (120, len(sizes))) * sizes for _ in range(3)]
    trials += [rng.choice([-1.0, 1.0], (120, len(sizes))) * sizes, c.local.worst_input]
    for inputs in trials:
        Y, U = run(controller, inputs[:, : own.ny], inputs[:, own.ny :])
        x, linear = np.zeros(len(A)), []
        for e in inputs:
            linear.append(C @ x + D @ e)
            x = A @ x + B @ e
        assert np.all(np.abs(Y - linear) <= c.local.output_bounds)
        assert np.all(U + own.v_offset >= c.u_low - 1e-9)
        assert np.all(U + own.v_offset <= c.u_high + 1e-9)
    if limits:
        assert np.all(c.u_low >= own.v_offset - limits)


def test_trajectories_approach_each_other_at_the_proved_rate(rng):
    controller = controlled("al", size=0.1)
    c = certify_loop(controller, 0.1, noise=0.01)
    assert c.gain.holds and c.decay < 1
    loop = whole_loop(controller)
    r = rng.uniform(-1, 1, (2, 300, loop.lure.nu)) * c.local.amplitude
    Y = [
        channels(loop.lure, simulate(loop.lure, one, np.zeros(loop.lure.nx))[:-1], one)
        for one in r
    ]
    ny = controller.own.ny
    difference = np.linalg.norm(Y[0][:, :ny] - Y[1][:, :ny])
    assert difference <= c.gain.gamma * np.linalg.norm(r[0] - r[1])


def test_a_gain_that_is_too_high_is_refused():
    assert certify_loop(controlled("al", size=0.1), 0.05, noise=0.0).holds
    unstable = controlled("al", size=0.1, scale=40.0)
    c = certify_loop(unstable, 0.05, noise=0.0)
    assert not c.holds and not c.gain.holds and "spectral radius" in repr(c)
    assert not c.verify() >= 0


def test_the_observer_is_exact_without_noise():
    """From rest the estimate is the state: the observer changes no bound."""
    controller = controlled("al", size=0.1)
    without = certify_loop(controller, 0.1, noise=0.0, search=False)
    hardly = certify_loop(controller, 0.1, noise=1e-12, search=False)
    assert without.holds and hardly.holds
    # the same loop, bounded in one way or the other
    assert hardly.output_bound <= 3 * without.output_bound


def test_messages():
    controller = controlled("al", size=0.1)
    for wrong in (0.0, -1.0, [1.0] * 7):
        with pytest.raises(ValueError, match="`amplitude` must be positive"):
            certify_loop(controller, wrong)
        if wrong != 0.0:
            with pytest.raises(ValueError, match="`noise` must be at least 0"):
                certify_loop(controller, 0.1, noise=wrong)
    with pytest.raises(ValueError, match="`amplitude` must be given"):
        certify_loop(controller)
    own = controller.own
    ekf = LinearizingController(
        own, controller.gain, observer=Observer(own, kind="ekf")
    )
    with pytest.raises(ValueError, match="kind 'kalman'"):
        certify_loop(ekf, 0.1, noise=0.1)


def test_limits_are_neurons():
    activation = limit(-1.0, 2.0)
    low, high = np.array([-3.0, -0.5, -0.5, 2.5]), np.array([-2.0, 1.0, 3.0, 4.0])
    least, largest = activation.slopes(low, high)
    np.testing.assert_array_equal(least, [0, 1, 0, 0])
    np.testing.assert_array_equal(largest, [0, 1, 1, 0])
    np.testing.assert_array_equal(activation.value(low), [-1.0, -0.5, -0.5, 2.0])


def test_a_gate_that_cuts_is_no_loop_that_is_certified():
    controller = controlled("al", size=0.1)
    own, K = controller.own, controller.gain
    gated = LinearizingController(own, K, observer=Observer(own, gate=5.0))
    largest = float(gated.observer.largest_innovation.min())
    assert certify_loop(gated, 0.05, noise=0.1 * largest, search=False).holds
    c = certify_loop(gated, 0.05, noise=2 * largest, search=False)
    assert not c.holds and "gate" in c.local.reason and not c.gain.holds
    # without a gate it may well hold
    open_ = certify_loop(controller, 0.05, noise=2 * largest, search=False)
    assert open_.holds or "gate" not in open_.local.reason


def test_parts_of_another_model_are_refused():
    controller, other = controlled("al", seed=0), controlled("al", seed=1)
    own, K = controller.own, controller.gain
    with pytest.raises(ValueError, match="a law of its own model"):
        law = other.law
        certify_loop(
            LinearizingController(own, K, observer=controller.observer, law=law), 0.1
        )
    with pytest.raises(ValueError, match="an observer of its own model"):
        parts = LinearizingController(own, K, observer=other.observer)
        certify_loop(parts, 0.1, noise=0.1)


def test_a_certificate_with_limits_can_be_stored():
    c = certify_loop(controlled("al", limits=0.3, size=0.1), 0.05, noise=0.005)
    again = pickle.loads(pickle.dumps(c))
    assert again.verify() == c.verify() >= 0
    assert repr(again) == repr(c)


def test_the_rate_is_that_of_its_own_norm():
    c = certify_loop(controlled("al", size=0.1), 0.1, noise=0.01, search=False)
    assert c.rate.holds and c.decay == c.rate.decay < 1
    other = replace(c, rate=replace(c.rate, decay=0.5 * c.decay))
    assert c.verify() >= 0 and not other.verify() >= 0


@pytest.mark.parametrize("unit", [1e-10, 1e10])
def test_neurons_are_the_same_in_all_units(unit):
    """The law sees the noise, the plant does not, however small its numbers are."""
    controller = controlled("fl", size=0.1)
    plain = whole_loop(controller).lure
    wires = _Wires(controller.own.form, controller, np.full((2, 2), np.inf), True)
    wires.at["n"] = wires.at["n"] / unit
    wires.gain = wires.gain * 1.0
    scaled, _ = wires.lure()
    assert scaled.nw == plain.nw

"""The whole loop as one form, and what is proved of it."""

import pickle
from dataclasses import replace

import control
import numpy as np
import pytest
from structures import STRUCTURES

from alssnn.certificates import certify_loop
from alssnn.certificates._whole import _Wires, limit, whole_loop
from alssnn.feedback import LinearizingController, Observer, designed_loop
from alssnn.simulation import channels, simulate
from helpers import controlled

NAMES = ["fl", "fl-state", "al", "al-siso", "al-state-output", "al-split"]
SOLVED = ["monotone", "monotone-state"]  # laws that are solved at every sample


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


@pytest.mark.parametrize("name", NAMES + SOLVED)
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


@pytest.mark.parametrize("name", NAMES + SOLVED)
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


# either with limits or without: structures and limits do not depend on each other
LIMITS = dict(zip(NAMES, (None, 0.3, None, 0.3, None, 0.3), strict=True))


@pytest.mark.usefixtures("rough_certificates")
@pytest.mark.parametrize(("name", "limits"), LIMITS.items())
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
        linear = forced(A, B, C, D, inputs)
        assert np.all(np.abs(Y - linear) <= c.local.output_bounds)
        assert np.all(U + own.v_offset >= c.u_low - 1e-9)
        assert np.all(U + own.v_offset <= c.u_high + 1e-9)
    if limits:
        assert np.all(c.u_low >= own.v_offset - limits)


@pytest.fixture
def soon_at_rest(monkeypatch):
    """Wait for a rest no longer than loops take here: laws that are solved are slow."""
    monkeypatch.setattr("alssnn.certificates._rest.LONG", 500)


@pytest.mark.usefixtures("soon_at_rest")
@pytest.mark.parametrize(
    ("name", "limits"), [("monotone", 1.0), ("monotone-state", None)]
)
def test_no_run_of_a_solved_law_violates_a_certificate(name, limits):
    rng = np.random.default_rng(2)
    controller = controlled(name, limits=limits, size=0.1)
    own = controller.own
    c = certify_loop(controller, 0.02, noise=0.002, search=False)
    assert c.holds and c.verify() >= 0, c
    sizes = c.local.amplitude
    A, B, C, D = whole_loop(controller).design
    for inputs in (
        rng.uniform(-1, 1, (100, len(sizes))) * sizes,
        rng.choice([-1.0, 1.0], (100, len(sizes))) * sizes,
    ):
        Y, U = run(controller, inputs[:, : own.ny], inputs[:, own.ny :])
        linear = forced(A, B, C, D, inputs)
        assert np.all(np.abs(Y - linear) <= c.local.output_bounds)
        assert np.all(U + own.v_offset >= c.u_low - 1e-9)
        assert np.all(U + own.v_offset <= c.u_high + 1e-9)


def forced(A, B, C, D, inputs):
    """Return the response of a linear system from rest."""
    x, y = np.zeros(len(A)), []
    for e in inputs:
        y.append(C @ x + D @ e)
        x = A @ x + B @ e
    return np.array(y)


@pytest.mark.usefixtures("soon_at_rest")
@pytest.mark.parametrize(
    ("name", "share"),
    [("fl", None), ("monotone-state", None), ("al-siso", 0.8), ("fl-state", -0.8)],
)
def test_the_gain_bounds_the_distance_of_every_plant_near_the_model(name, share):
    rng = np.random.default_rng(3)
    controller = controlled(name, size=0.1)
    own, plant = controller.own, controller.own
    error = None if share is None else 0.05
    c = certify_loop(controller, 0.1, noise=0.05, error=error, search=False)
    assert c.holds and c.gain.holds and c.verify() >= 0, c
    rest = own.y_offset if controller.tracks else own.v_offset
    A, B, C, D = whole_loop(controller).design
    for _ in range(3):
        # a part of the range, so that errors stay within what counts as noise
        r = 0.1 * rng.choice([-1.0, 1.0], (25, own.ny)).repeat(8, axis=0)
        controller.reset()
        x, Y, late = np.zeros(plant.nx), [], np.zeros(own.nv)
        for r_k in r:
            added = 0.0 if share is None else share * 0.05 * late.sum()
            y = plant.output(x) + added
            u = controller.step(rest + r_k, y)
            x, late = plant.step(x, u), u - own.v_offset
            Y.append(y - own.y_offset)
            assert np.all(np.abs(added) <= 0.05)
        inputs = np.hstack([r, np.zeros((len(r), own.ny))])
        distance = np.linalg.norm(np.array(Y) - forced(A, B, C, D, inputs))
        assert distance <= c.gain.gamma * np.linalg.norm(r)
    if share is not None:
        assert c.largest_error >= 1.0
        beyond = certify_loop(controller, 0.1, noise=0.05, error=60.0, search=False)
        assert not beyond.gain.holds and beyond.largest_error < 1


@pytest.mark.parametrize("name", ["fl-state", "al", "monotone-state"])
def test_the_loop_rests_from_every_state_of_the_basin(name):
    rng = np.random.default_rng(4)
    controller = controlled(name, size=0.1)
    own = controller.own
    c = certify_loop(controller, 0.2, noise=0.01, search=False)
    assert c.rate.holds and np.linalg.eigvalsh(c.basin)[0] > 0
    lure, n = whole_loop(controller).lure, own.nx
    root = np.linalg.inv(np.linalg.cholesky(c.basin)).T
    rest = simulate(lure, np.zeros((4000, lure.nu)), np.zeros(lure.nx))[-1]
    for direction in rng.standard_normal((8, n)):
        x = root @ direction / np.linalg.norm(direction)
        assert x @ c.basin @ x == pytest.approx(1.0)
        start = np.concatenate([x, x, np.zeros(lure.nx - 2 * n)])
        still = np.zeros((400, lure.nu))
        X = simulate(lure, still, start) - rest
        V = np.einsum("ki,ij,kj->k", X, c.rate.P, X)
        fall = c.decay ** (2 * np.arange(len(V)))
        assert np.all(V <= V[0] * fall * (1 + 1e-6) + 1e-12)


def test_a_larger_basin_is_detected():
    c = certify_loop(controlled("al-siso", size=0.1), 0.1, noise=0.01, search=False)
    assert c.verify() >= 0
    # on another machine the last digits are others
    digits = 1 + 1e-14 * np.arange(len(c.proof.reach))
    other = replace(c.proof, reach=c.proof.reach * digits)
    assert replace(c, proof=other).verify() >= 0
    assert replace(c, basin=0.5 * c.basin).verify() == -np.inf
    assert replace(c, gain=replace(c.gain, gamma=0.9 * c.gain.gamma)).verify() < 0
    other = certify_loop(
        controlled("al-siso", size=0.15), 0.1, noise=0.01, search=False
    )
    assert replace(c, gain=other.gain).verify() == -np.inf
    wider = certify_loop(
        controlled("al-siso", size=0.1), 0.12, noise=0.01, search=False
    )
    assert wider.holds and replace(c, local=wider.local).verify() == -np.inf
    further = replace(c.local, amplitude=2 * c.local.amplitude)
    assert replace(c, local=further).verify() == -np.inf
    negative = replace(c.gain, gamma=-c.gain.gamma)
    assert replace(c, gain=negative).verify() == -np.inf
    assert replace(c, proof=None).verify() == -np.inf
    narrow = replace(c.local, z_high=0.5 * c.local.z_high)
    assert replace(c, local=narrow).verify() == -np.inf


@pytest.mark.parametrize("seed", [14, 30])
def test_rounding_is_no_motion(seed):
    """Tied networks rest at the origin, but for 1e-17."""
    controller = controlled("al", seed=seed, limits=1.0, size=0.1)
    c = certify_loop(controller, 0.02, noise=0.002, search=False)
    assert c.holds and "come to rest" not in c.gain.reason


def test_a_loop_that_rests_at_a_limit_has_no_gain():
    controller = controlled("monotone-state", size=0.1)
    own = controller.own
    limits = {"u_min": own.v_offset + 0.05, "u_max": own.v_offset + 0.6}
    parts = {"observer": controller.observer, **limits}
    beyond = LinearizingController(own, controller.gain, **parts)
    c = certify_loop(beyond, 0.01, noise=0.001, search=False)
    assert "rests at a limit of an actuator" in c.gain.reason
    assert not c.gain.holds and not c.rate.holds and np.isnan(c.basin).all()


def test_a_grid_does_not_take_differences_for_neurons(monkeypatch):
    """A plant of one state has two with its observer: few enough for a grid."""
    monkeypatch.setitem(STRUCTURES, "scalar", ((1, 1, 1), {"n_h": 3, "n_g": 3}, "yg"))
    controller = controlled("scalar", integrates=False, size=0.3)
    c = certify_loop(controller, 0.5, noise=0.3)
    assert c.holds and c.local.proof.cover.network.lure.nx == 2
    assert c.local.proof.cover.network.twins and c.local.proof.cells == 0
    sizes = c.local.amplitude
    inputs = c.local.worst_input
    assert np.all(np.abs(inputs) <= sizes)
    Y, _ = run(controller, inputs[:, :1], inputs[:, 1:])
    linear = forced(*whole_loop(controller).design, inputs)
    assert np.all(np.abs(Y - linear) <= c.local.output_bounds)


def test_a_gain_that_is_too_high_is_refused():
    controller = controlled("al", size=0.1)
    assert certify_loop(controller, 0.05, noise=0.0, search=False).holds
    unstable = controlled("al", size=0.1, scale=40.0)
    c = certify_loop(unstable, 0.05, noise=0.0)
    assert not c.holds and not c.gain.holds and "spectral radius" in repr(c)
    assert not c.verify() >= 0


def test_the_observer_is_exact_without_noise():
    """From rest the estimate is the state: the observer changes no bound."""
    controller = controlled("al-siso", size=0.1)
    without = certify_loop(controller, 0.1, noise=0.0, search=False)
    hardly = certify_loop(controller, 0.1, noise=1e-12, search=False)
    assert without.holds and hardly.holds
    assert "same inputs; the estimate is exact" in repr(without)
    assert "noise" not in repr(without) and "noise included" in repr(hardly)
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
    for wrong in (-1.0, np.nan, [1.0, 2.0, 3.0], "much"):
        with pytest.raises(ValueError, match="`error` must be at least 0"):
            certify_loop(controller, 0.1, noise=0.1, error=wrong)
    with pytest.raises(ValueError, match="`noise` must be positive"):
        certify_loop(controller, 0.1, noise=0.0, error=0.1)
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
    controller = controlled("al-siso", size=0.1)
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
    c = certify_loop(
        controlled("al-siso", limits=0.3, size=0.1), 0.05, noise=0.005, search=False
    )
    again = pickle.loads(pickle.dumps(c))
    assert again.verify() == c.verify() >= 0
    assert repr(again) == repr(c)


def test_the_rate_is_that_of_its_own_norm():
    c = certify_loop(controlled("al-siso", size=0.1), 0.1, noise=0.01, search=False)
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


def test_no_run_violates_a_small_certificate():
    rng = np.random.default_rng(1)
    controller = controlled("al-siso", limits=0.3, size=0.1)
    own = controller.own
    c = certify_loop(controller, 0.05, noise=0.005, search=False)
    assert c.holds and c.verify() >= 0
    sizes = c.local.amplitude
    np.testing.assert_array_equal(sizes, [0.05] * own.ny + [0.005] * own.ny)
    A, B, C, D = whole_loop(controller).design
    for inputs in (
        rng.choice([-1.0, 1.0], (60, len(sizes))) * sizes,
        rng.choice([-1.0, 1.0], (10, len(sizes))).repeat(10, axis=0) * sizes,
    ):
        Y, U = run(controller, inputs[:, : own.ny], inputs[:, own.ny :])
        assert np.all(np.abs(Y - forced(A, B, C, D, inputs)) <= c.local.output_bounds)
        assert np.all(U + own.v_offset >= c.u_low - 1e-9)
        assert np.all(U + own.v_offset <= c.u_high + 1e-9)

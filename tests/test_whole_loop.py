"""The whole loop as one form, and what is proved of it."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import control
import numpy as np
import pytest
from structures import STRUCTURES, declare

from alssnn.activations import ACTIVATIONS
from alssnn.certificates import LocalCertificate, _whole_certificate, certify_loop
from alssnn.certificates._rest import (
    corrections,
    from_design,
    from_rest,
    level_of,
    with_error,
)
from alssnn.certificates._whole import _Wires, limit, whole_loop
from alssnn.certificates._whole_certificate import _inputs
from alssnn.feedback import LinearizingController, Observer, designed_loop, lqi, lqr
from alssnn.lure import Lure
from alssnn.simulation import channels, simulate
from helpers import plant_of_structure, random_theta

NAMES = ["fl", "fl-state", "al", "al-siso", "al-state-output", "al-split"]
SOLVED = ["monotone", "monotone-state"]  # laws that are solved at every sample


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
        linear = forced(A, B, C, D, inputs)
        assert np.all(np.abs(Y - linear) <= c.local.output_bounds)
        assert np.all(U + own.v_offset >= c.u_low - 1e-9)
        assert np.all(U + own.v_offset <= c.u_high + 1e-9)
    if limits:
        assert np.all(c.u_low >= own.v_offset - limits)


@pytest.mark.parametrize("name", SOLVED)
@pytest.mark.parametrize("limits", [None, 1.0])
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
    for direction in rng.standard_normal((8, n)):
        x = root @ direction / np.linalg.norm(direction)
        assert x @ c.basin @ x == pytest.approx(1.0)
        start = np.concatenate([x, x, np.zeros(lure.nx - 2 * n)])
        still = np.zeros((400, lure.nu))
        X = simulate(lure, still, start)
        X = X - simulate(lure, np.zeros((4000, lure.nu)), np.zeros(lure.nx))[-1]
        V = np.einsum("ki,ij,kj->k", X, c.rate.P, X)
        fall = c.decay ** (2 * np.arange(len(V)))
        assert np.all(V <= V[0] * fall * (1 + 1e-6) + 1e-12)


def test_a_larger_basin_is_detected():
    c = certify_loop(controlled("al", size=0.1), 0.1, noise=0.01, search=False)
    assert c.verify() >= 0
    # on another machine the last digits are others
    digits = 1 + 1e-14 * np.arange(len(c.proof.reach))
    other = replace(c.proof, reach=c.proof.reach * digits)
    assert replace(c, proof=other).verify() >= 0
    assert replace(c, basin=0.5 * c.basin).verify() == -np.inf
    assert replace(c, gain=replace(c.gain, gamma=0.9 * c.gain.gamma)).verify() < 0
    other = certify_loop(controlled("al", size=0.15), 0.1, noise=0.01, search=False)
    assert replace(c, gain=other.gain).verify() == -np.inf
    wider = certify_loop(controlled("al", size=0.1), 0.12, noise=0.01, search=False)
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
    controller = controlled("monotone", size=0.1)
    own = controller.own
    limits = {"u_min": own.v_offset + 0.05, "u_max": own.v_offset + 0.6}
    parts = {"observer": controller.observer, **limits}
    beyond = LinearizingController(own, controller.gain, **parts)
    c = certify_loop(beyond, 0.01, noise=0.001, search=False)
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


# -- what the inequalities are made of -------------------------------------------------


def straight(loop):
    """Return a loop whose neurons are linear: its differences are what they say."""
    sigma = (ACTIVATIONS["identity"],) * loop.lure.nw
    lure = loop.lure
    return replace(loop, lure=Lure(0.3 * lure.Theta, lure.nx, lure.nu, lure.nw, sigma))


def outputs_of(form, inputs):
    """Return channels and states of a form from rest at the origin."""
    X = simulate(form, inputs, np.zeros(form.nx))[:-1]
    return channels(form, X, inputs), X


@pytest.mark.parametrize("has_error", [False, True])
def test_deviations_from_the_design_are_two_loops_apart(has_error, rng):
    """y - y_d of the one form, by simulation of loop and design."""
    controller = controlled("al", limits=0.3)
    own, loop = controller.own, straight(whole_loop(controller))
    A, B, C, D = loop.design
    ny, nr = own.ny, own.ny
    error = np.array([[0.0, 2.0], [0.5, 1.0]])[:ny, : own.nv] if has_error else None
    form = from_design(loop, nr, error)
    inputs = rng.standard_normal((30, nr))
    found, X = outputs_of(form, inputs)
    x, x_d = np.zeros(loop.lure.nx), np.zeros(len(A))
    for k, r in enumerate(inputs):
        every = np.zeros(loop.lure.nu)
        every[:nr] = r
        if has_error:  # u does not depend on the noise of the same sample in a loop
            for _ in range(60):  # unless the law sees it: until it settles
                u = channels(loop.lure, x[None], every[None])[0][ny:][: own.nv]
                every[-ny:] = (error > 0) @ u
        z = channels(loop.lure, x[None], every[None])[0][:ny]
        added = every[-ny:] if has_error else 0.0
        design = np.zeros(B.shape[1])
        design[:nr] = r
        np.testing.assert_allclose(
            found[k], z + added - C @ x_d - D @ design, atol=1e-9
        )
        np.testing.assert_allclose(X[k], np.concatenate([x - x_d, x_d]), atol=1e-9)
        x = simulate(loop.lure, every[None], x)[1]
        x_d = A @ x_d + B @ design
    sectors = with_error(np.zeros((2, loop.lure.nw)), error)
    sizes = [] if error is None else error[error > 0]
    np.testing.assert_array_equal(
        sectors[:, loop.lure.nw :], [-1 * np.array(sizes), sizes]
    )
    assert sectors.shape[1] == form.nw


def test_deviations_from_rest_are_the_loop(rng):
    controller = controlled("al", limits=0.3)
    own, loop = controller.own, straight(whole_loop(controller))
    form = from_rest(loop, own.ny)
    inputs = rng.standard_normal((30, own.ny))
    every = np.pad(inputs, ((0, 0), (0, loop.lure.nu - own.ny)))
    found, X = outputs_of(form, inputs)
    z, x = outputs_of(loop.lure, every)
    np.testing.assert_allclose(found, z[:, : own.ny], atol=1e-10)
    np.testing.assert_allclose(X, x, atol=1e-10)
    assert form.nw == loop.lure.nw and form.sigma == loop.lure.sigma


def test_corrections_are_what_the_observer_sees(rng):
    """y + n - C x_p, as weights of states and of neurons that are differences."""
    controller = controlled("al", limits=0.3)
    loop, own = whole_loop(controller), controller.own
    rows = corrections(loop)
    x = rng.standard_normal(loop.lure.nx)
    C = own.linear()[2]
    expected = C @ x[: own.nx] - C @ x[own.nx : 2 * own.nx]
    np.testing.assert_allclose(rows[:, : loop.lure.nx] @ x, expected, atol=1e-12)
    assert rows.shape == (own.ny, loop.lure.nx + loop.lure.nw)
    assert not rows[:, loop.lure.nx :].any()


def scalar(k, nw=1, e=0.0):
    """Return x+ = x / 2 + sum of w, with neurons that see k x, the second e w_1."""
    Theta = np.zeros((2 + nw, 2 + nw + 1))
    Theta[0, 0], Theta[1, 0], Theta[0, 2:-1] = 0.5, 1.0, 0.1
    Theta[2, 0] = k
    if nw > 1:
        Theta[3, 2] = e
    return Lure(Theta, 1, 1, nw)


@pytest.mark.parametrize("sector", [(0.0, 1.0), (0.2, 0.6), (-0.5, 0.1), (1.0, 1.0)])
def test_the_level_of_one_state_is_known(sector):
    """V = p x^2 with |k x| <= reach, and then with what a neuron passes on."""
    sectors, p, k, e = np.array([sector, [0.0, 1.0]]).T, 4.0, -3.0, 2.0
    most = max(abs(sector[0]), abs(sector[1]))
    one = scalar(k), np.full((1, 1), p)
    level = level_of(*one, sectors[:, :1], np.array([0.6]))
    assert level == pytest.approx(p * (0.6 / 3) ** 2)
    two = scalar(k, 2, e), np.full((1, 1), p)
    level = level_of(*two, sectors, np.array([np.inf, 0.6]))
    assert level == pytest.approx(p * (0.6 / (3 * 2 * most)) ** 2)
    assert level_of(*one, sectors[:, :1], np.array([np.inf])) == np.inf
    # a signal that is watched: x - 2 w, within its gate
    watched, middle = np.array([[1.0, -2.0]]), np.mean(sector)
    half = (sector[1] - sector[0]) / 2
    size = abs(1 + 6 * middle) + 6 * half
    level = level_of(*one, sectors[:, :1], np.array([np.inf]), watched, np.array([0.3]))
    assert level == pytest.approx(p * (0.3 / size) ** 2)
    both = level_of(*one, sectors[:, :1], np.array([1e-3]), watched, np.array([0.3]))
    assert both == pytest.approx(p * (1e-3 / 3) ** 2)


def test_neurons_that_drive_each_other_too_much_have_no_level():
    """nu = k x + e w with |w - nu / 2| <= |nu| / 2: x known, nu up to k x / (1 - e)."""
    form = scalar(1.0)
    sectors, P, reach = np.array([[0.0], [1.0]]), np.eye(1), np.ones(1)
    for e, most in ((0.5, 1 / (1 - 0.5)), (-0.5, 1.0), (0.9, 10.0)):
        Theta = form.Theta.copy()
        Theta[2, 2] = e
        level = level_of(Lure(Theta, 1, 1, 1), P, sectors, reach)
        # the worst chord: theta of 1 for e > 0, of 0 for e < 0
        assert level == pytest.approx(1 / most**2)
    for e in (1.0, 1.5, -5.0):
        Theta[2, 2] = e
        level = level_of(Lure(Theta, 1, 1, 1), P, sectors, reach)
        assert level == 0.0 if e > 0 else level == pytest.approx(1.0)


def test_no_state_within_the_level_leaves_the_sectors(rng):
    """With several states and layers: chords at random, at most what was allowed."""
    nx, nw = 3, 4
    Theta = rng.standard_normal((nx + 1 + nw, nx + 1 + nw + 1))
    Theta[nx + 1 :, nx + 1 : -1] *= 0.3 * np.tri(nw, k=-1)
    form = Lure(Theta, nx, 1, nw)
    half = rng.standard_normal((nx, nx))
    P = half @ half.T + np.eye(nx)
    sectors = np.sort(rng.uniform(-0.5, 1.0, (2, nw)), axis=0)
    reach = rng.uniform(0.1, 1.0, nw)
    watched, gate = rng.standard_normal((2, nx + nw)), np.array([0.4, 0.9])
    for signals in ((), (watched, gate)):
        level = level_of(form, P, sectors, reach, *signals)
        root = np.linalg.inv(np.linalg.cholesky(P)).T * np.sqrt(level)
        closest = 0.0
        for _ in range(4_000):
            x = rng.standard_normal(nx)
            x = root @ x / np.linalg.norm(x)
            nu, w = np.zeros(nw), np.zeros(nw)
            theta = sectors[rng.integers(0, 2, nw), np.arange(nw)]
            for i in range(nw):
                nu[i] = form.V[i, :nx] @ x + form.E[i] @ w
                w[i] = theta[i] * nu[i]
            share = np.abs(nu) / reach
            if signals:
                seen = np.abs(watched @ np.concatenate([x, w])) / gate
                share = np.concatenate([share, seen])
            assert np.all(share <= 1 + 1e-9)
            closest = max(closest, share.max())
        assert closest > 0.6


@pytest.fixture(scope="module")
def certified():
    controller = controlled("al-siso", limits=0.5, size=0.1)
    return controller, certify_loop(controller, 0.05, noise=0.005, search=False)


def test_what_is_said_of_a_proof_is_recomputed(certified):
    c = certified[1]
    proof, local = c.proof, c.local
    assert proof.is_of(local)
    for other in (
        replace(proof, x_rest=proof.x_rest + 1e-4 * (local.x_high - local.x_low)),
        replace(proof, x_rest=proof.x_rest - 1e-4 * (local.x_high - local.x_low)),
        replace(proof, sectors=proof.sectors * 0.999),
        replace(proof, reach=proof.reach * 1.001),
    ):
        assert not other.is_of(local)
        assert replace(c, proof=other).verify() == -np.inf


def test_the_range_of_inputs_ends_at_their_limits():
    own = SimpleNamespace(nv=4, v_offset=np.array([1.0, 1.0, 0.0, 0.0]))
    law = SimpleNamespace(
        u_min=np.array([-5.0, 0.0, -1.0, -np.inf]),
        u_max=np.array([5.0, 9.0, 2.0, np.inf]),
    )
    local = SimpleNamespace(
        holds=True,
        z_low=np.array([-2.0, -3.0, -0.5, -7.0, 0.0]),
        z_high=np.array([2.0, 3.0, 2.0, 8.0, 0.0]),
    )
    low, high, reaches = _inputs(local, law, own)
    np.testing.assert_array_equal(low, [-1.0, 0.0, -0.5, -7.0])
    np.testing.assert_array_equal(high, [3.0, 4.0, 2.0, 8.0])
    np.testing.assert_array_equal(reaches, [False, True, True, False])
    local.holds = False
    low, high, reaches = _inputs(local, law, own)
    assert np.all(low == -np.inf) and np.all(high == np.inf)
    np.testing.assert_array_equal(reaches, [True, True, True, False])


@pytest.mark.parametrize("limit", [0.0, 1e-3, 0.02, 0.5, 1.0, 7.0, 63.0, 1e3])
def test_the_largest_error_is_the_largest_that_is_proved(monkeypatch, limit):
    """The gain is proved up to `limit` times an error of a fifth."""

    def gain(proof, error):
        return SimpleNamespace(holds=bool(error.max() <= 0.2 * limit))

    monkeypatch.setattr(_whole_certificate, "_gain", gain)
    error = np.array([[0.2, 0.1]])
    found = _whole_certificate._largest_error(None, error, gain(None, error))
    assert found <= limit
    if 1 / 64 < limit < 64:
        assert found >= limit / 1.02
    else:
        assert found == pytest.approx(0.0 if limit < 1 else 64, rel=0.02)
    assert np.isnan(_whole_certificate._largest_error("no region", error, None))


@pytest.mark.parametrize("least", [0.55, 0.75, 1.0])
def test_the_rate_is_the_smallest_that_is_proved(monkeypatch, least):
    def certify(form, sectors, decay=1.0):
        return SimpleNamespace(holds=decay >= least, decay=decay)

    monkeypatch.setattr(_whole_certificate, "gain_certificate", certify)
    proof = SimpleNamespace(deviations=lambda: (scalar(1.0), None))
    found = _whole_certificate._rate(proof)  # no rate is below the pole, 0.5
    assert found.holds and least <= found.decay <= least + 0.5 / 2**6


def test_a_gate_is_that_of_every_sensor():
    own = SimpleNamespace(nv=1)
    local = LocalCertificate(
        True, *[np.ones(1)] * 6, np.ones(1), np.array([-9.0, -0.5, -2.0]),
        np.array([9.0, 1.0, 1.0]), "neurons", "", 0.0,
    )  # fmt: skip
    for gate, holds in (([1.0, 2.0], True), ([0.9, 9.0], False), ([9.0, 1.9], False)):
        observer = SimpleNamespace(largest_innovation=np.array(gate))
        controller = SimpleNamespace(own=own, observer=observer)
        found = _whole_certificate._gated(local, controller)
        assert found.holds == holds
        assert np.isinf(found.output_bounds).all() == (not holds)
        assert holds or "may reach 2, beyond the gate" in found.reason
    without = SimpleNamespace(own=own, observer=SimpleNamespace())
    assert _whole_certificate._gated(local, without) is local


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

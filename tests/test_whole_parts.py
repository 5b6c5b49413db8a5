"""What is proved of a whole loop: its parts, in numbers that are known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from alssnn.activations import ACTIVATIONS
from alssnn.certificates import (
    GainCertificate,
    LocalCertificate,
    _whole_certificate,
    certify_loop,
)
from alssnn.certificates._rest import (
    LoopProof,
    at_rest,
    corrections,
    from_design,
    from_rest,
    level_of,
    with_error,
)
from alssnn.certificates._whole import WholeLoop, _same, whole_loop
from alssnn.certificates._whole_certificate import _inputs, _noise, _sizes
from alssnn.feedback import LinearizingController, Observer
from alssnn.lure import Lure
from alssnn.simulation import channels, simulate
from helpers import controlled

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


def test_the_basin_is_the_level_of_plant_and_observer(certified):
    """Both start at x: its V is that of [x; x; 0], at most the level."""
    c = certified[1]
    proof, n = c.proof, len(c.basin)
    form, sectors = proof.deviations()
    level = level_of(form, c.rate.P, sectors, proof.reach)
    P = c.rate.P[: 2 * n, : 2 * n].reshape(2, n, 2, n).sum(axis=(0, 2))
    assert 0 < level < np.inf and np.linalg.eigvalsh(c.basin)[0] > 0
    np.testing.assert_allclose(c.basin, P / level)
    assert replace(c, basin=0.9 * c.basin).verify() == -np.inf
    assert replace(c, rate=replace(c.rate, holds=False)).verify() == -np.inf
    # half the room makes a basin of half the size
    half = replace(proof, reach=0.5 * proof.reach).basin(c.rate.P)
    np.testing.assert_allclose(half, 4 * c.basin)
    gated = replace(proof, gate=np.full(1, 1e-9)).basin(c.rate.P)
    assert np.linalg.eigvalsh(gated)[0] > 100 * np.linalg.eigvalsh(c.basin)[-1]
    # without any there is none
    assert np.isnan(replace(proof, reach=0.0 * proof.reach).basin(c.rate.P)).all()
    # of a plant alone
    alone = replace(proof, loop=replace(proof.loop, watches=False)).basin(c.rate.P)
    np.testing.assert_allclose(alone, c.rate.P[:n, :n] / level)


def rests(pole, constant, extent=0.0):
    """Return what the neurons of x+ = pole x + constant see at rest, and the state."""
    Theta = np.array(
        [
            [pole, 0.0, 0.0, 0.0, constant],
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [3.0, 0.0, 0.0, 0.0, 1.0],
            [5.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    design = (np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)))
    loop = WholeLoop(Lure(Theta, 1, 1, 2), design, np.array([-1, 0]), True)
    return at_rest(loop, extent)


def test_what_rests_and_what_does_not():
    seen, x = rests(0.5, 1.0)
    assert x == pytest.approx(2.0)
    np.testing.assert_allclose(seen, [7.0, 10.0 - 7.0])
    for pole in (0.9999, -1.0, 1.01, 10.0):  # slow, for ever, away
        assert np.isnan(rests(pole, 1.0)[1])
    # a motion is small beside what the loop may do
    assert np.isnan(rests(0.9999, 1e-3)[1]) and rests(0.9999, 1e-3, 1e7)[1] > 3


def test_models_are_the_same_if_nothing_of_them_differs():
    own = controlled("al-siso").own
    assert _same(own, own) and _same(own, replace(own))

    def other(form):
        return Lure(1.01 * form.Theta, form.nx, form.nu, form.nw, form.sigma)

    for name, value in (
        ("u_offset", own.u_offset + 1),
        ("y_offset", own.y_offset + 1),
        ("form", other(own.form)),
        ("law_form", other(own.law_form)),
    ):
        assert not _same(own, replace(own, **{name: value}))


def test_what_a_certificate_says_of_gain_and_rate(certified):
    c = certified[1]
    assert "|y - y_design| <=" in repr(c) and "every plant" not in repr(c)
    assert "|r| in l2 without noise, from x_rest, and y and u count from" in repr(c)
    assert "|r| in l2, from x_rest" in repr(replace(c, has_noise=False))
    labels = "r of y[0]", "inflow"
    disturbed = replace(c, local=replace(c.local, labels=labels))
    disturbed = replace(disturbed, proof=replace(c.proof, n_free=2))
    assert "|r, d| in l2 without noise" in repr(disturbed)
    assert "an ellipsoid of |x - x_rest| <= " in repr(c)
    assert "r and y_lin count from the operating point" in repr(c)
    assert "for the whole range" not in repr(c)
    wider = replace(c, full=2 * c.full)
    words = (
        "region and gain are not both proved for the whole range, |r of y[0]| <= 0.1,"
    )
    assert words in repr(wider)
    error = np.array([[0.25]])
    near = replace(c, error=error, largest_error=3.0)
    words = "<= 0.25 |u| (proved up to 3 times that), as long as this difference"
    assert words in repr(near)
    none = replace(c, gain=GainCertificate.none("Because."))
    assert "no gain was proved. Because.\n" in repr(none) + "\n"
    for largest, said in (
        (0.0, "Because. The `error` is too large for this loop."),
        (0.5, "Because. It holds for 0.5 times this `error`."),
        (np.nan, "Because."),
    ):
        text = repr(replace(none, error=error, largest_error=largest))
        assert f"{said}\n" in text + "\n"
    slow = replace(c.rate, decay=1.0)
    for basin, rate, said in (
        (c.basin, c.rate, f"rest at {c.decay:.4g} per sample, from states in an"),
        (np.full((2, 2), np.nan), slow, "comes to rest, from states near rest"),
        (np.zeros((2, 2)), slow, "comes to rest, from every state"),
        (np.diag([4.0, 1 / 9]), slow, "in an ellipsoid of |x - x_rest| <= [0.5, 3]"),
    ):
        assert said in repr(replace(c, basin=basin, rate=rate))
    unproved = replace(c, rate=GainCertificate.none("None."))
    assert "comes to rest" not in repr(unproved)
    for reaches in (False, True):
        text = repr(replace(c, reaches_limits=np.array([reaches])))
        assert ("(at a limit)" in text) == reaches


def test_a_certificate_without_a_proof_has_no_margin(certified):
    c = certified[1]
    nothing = GainCertificate.none("")
    bare = replace(c, proof=None, gain=nothing, rate=nothing)
    assert bare.verify() == c.local.verify()
    for other in (replace(bare, gain=c.gain), replace(bare, rate=c.rate)):
        assert other.verify() == -np.inf
    assert np.isnan(bare.x_rest).all() and not np.isnan(c.x_rest).any()
    assert len(c.x_rest) == len(c.basin) == 2
    failed = replace(c, local=replace(c.local, holds=False))
    assert failed.verify() == -np.inf and not failed.holds
    least = min(c.local.verify(), c.gain.verify(), c.rate.verify())
    assert c.verify() == min(least, 0.0) or c.verify() == pytest.approx(0.0)


@pytest.mark.parametrize(("integrates", "n_free"), [(True, 1), (False, 2)])
def test_a_proof_knows_its_references_and_its_gate(integrates, n_free):
    """Two inputs and one output: references are those of y, or those of v."""
    controller = controlled("al-split", integrates=integrates, size=0.05)
    own, K = controller.own, controller.gain
    gated = LinearizingController(own, K, observer=Observer(own, gate=500.0))

    def proof_of(observer):
        loop = whole_loop(gated, observer=observer)
        sizes = np.full(loop.lure.nu, 0.01)
        local = _whole_certificate._local(loop, sizes, own, search=False)
        return LoopProof.of(loop, local, gated)

    proof = proof_of(observer=True)
    assert proof.n_free == n_free and proof.n_plant == own.nx == 3
    np.testing.assert_array_equal(proof.gate, gated.observer.largest_innovation)
    assert proof_of(observer=False).gate is None
    assert proof.distance()[0].nu == proof.deviations()[0].nu == n_free


@pytest.mark.parametrize(
    ("amplitude", "largest", "tried"),
    [
        (1.0, 0.3, [1.0]),
        (None, 0.3, [1.0, 0.5, 0.25]),
        (None, 2.0, [1.0]),
        (None, 0.0, [1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125]),
    ],
)
def test_amplitudes_halve_until_one_is_proved(monkeypatch, amplitude, largest, tried):
    """Those of references: a given one is kept, and noise is what it is."""
    controller, found = controlled("al-siso", size=0.1), []

    def local(loop, sizes, own, search):
        found.append(sizes.copy())
        ones = [np.ones(1)] * 7
        return LocalCertificate(
            bool(sizes[0] <= largest),
            sizes,
            *ones,
            np.zeros(2),
            np.zeros(2),
            "",
            "",
            0.0,
        )

    def proof(loop, local, controller):
        return "" if local.holds else "No region was proved."

    def gain(proof, error):
        return replace(GainCertificate.none(proof), holds=not proof)

    sizes = np.array([1.0, 0.1])
    for name, stub in (("_local", local), ("_proof", proof), ("_gain", gain)):
        monkeypatch.setattr(_whole_certificate, name, stub)
    monkeypatch.setattr(_whole_certificate, "_sizes", lambda *_: sizes)
    c = certify_loop(controller, amplitude, noise=0.1, search=False)
    np.testing.assert_array_equal(found, [[size, 0.1] for size in tried])
    assert c.holds == c.gain.holds == (tried[-1] <= largest)
    last = tried[-1] if c.holds else 1.0
    np.testing.assert_array_equal(c.local.amplitude, [last, 0.1])
    np.testing.assert_array_equal(c.full, sizes)
    assert c.local.labels == ("r of y[0]", "noise of y[0]")


def test_sizes_are_those_of_the_record():
    """One input that is moved, one that is measured, and an output."""
    low, high = np.array([-1.0, -2.0, -3.0]), np.array([0.5, 4.0, 2.0])
    own = SimpleNamespace(
        nu=2, ny=1, moved=np.array([0]), given=(1,), noise=0.04,
        y_scale=np.array([5.0]), region=SimpleNamespace(low=low, high=high),
    )  # fmt: skip
    np.testing.assert_allclose(_noise(own, None), [3 * 0.2 * 5.0])
    np.testing.assert_array_equal(_noise(own, 0.3), [0.3])
    np.testing.assert_array_equal(_noise(own, [0.0]), [0.0])
    unknown = SimpleNamespace(noise=-1.0, y_scale=own.y_scale)
    np.testing.assert_array_equal(_noise(unknown, None), [0.0])
    noise, gains = np.array([0.1]), np.array([[1.0, 1.0, 0.0]])
    half = np.array([[0.5]])
    design = half, gains, np.ones((1, 1)), np.zeros((1, 3))  # peak gains of 2
    for tracks, of_record in ((True, 3.0), (False, 1.0)):
        controller = SimpleNamespace(own=own, tracks=tracks)
        given = _sizes(controller, design, 0.7, noise)
        np.testing.assert_array_equal(given, [0.7, 4.0, 0.1])
        alone = half, gains[:, :2], np.ones((1, 1)), np.zeros((1, 2))
        without = _sizes(controller, alone, 0.7, np.zeros(1))
        np.testing.assert_array_equal(without, [0.7, 4.0])
        share = 3.0 / (2 * of_record + 2 * 4.0)  # the design stays within |y| <= 3
        found = _sizes(controller, design, None, noise)
        np.testing.assert_allclose(found, [share * of_record, 4.0, 0.1])
    weak = half, 0.01 * gains, np.ones((1, 1)), np.zeros((1, 3))
    np.testing.assert_array_equal(_sizes(controller, weak, None, noise), [1, 4, 0.1])

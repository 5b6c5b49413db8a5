"""What certificates are made of: every bound holds, and is no wider than it must be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from alssnn.activations import ACTIVATIONS, Activation
from alssnn.certificates import (
    _grid,
    _local,
    local_certificate,
    peaks,
    worst_input,
)
from alssnn.certificates._cells import Network, Strips, remainder
from alssnn.certificates._covers import Affine, ByCells, ByNeurons, covers
from alssnn.certificates._grid import Grid, _over_boxes
from alssnn.certificates._local import _scaled
from alssnn.certificates._neurons import differences, reaching
from alssnn.certificates._proof import distance
from alssnn.certificates._worst import _Pair
from alssnn.lure import Lure
from alssnn.simulation import channels, simulate
from helpers import simulate_linear, small_loop, stable

# -- cells -----------------------------------------------------------------------------


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "relu", "sin"])
@pytest.mark.parametrize("budget", [100, 20_000])
def test_no_point_of_a_region_exceeds_its_remainder(rng, activation, budget):
    loop, _ = small_loop(rng, size=1.0, activation=activation)
    network = Network.of(loop, 1, np.eye(2), np.ones(1), np.ones(1))
    box = np.array([[-1.0, -0.5, -1.0], [0.7, 2.0, 1.0]])
    rows = np.array([[1.0, 1.0]])
    seen = np.full((2, network.lure.nw), np.inf) * [[-1], [1]]
    region = Strips(box, rows, np.array([-0.6]), np.array([1.2]), seen)
    z = region.samples(20_000, rng)
    fit = np.linalg.lstsq(
        np.column_stack([z, np.ones(len(z))]), network.values(z), rcond=None
    )[0].T
    true = network.values(z) - z @ fit[:, :-1].T - fit[:, -1]
    low, high = remainder(network, region, np.eye(3), fit, true[:500], budget)
    assert np.all(true >= low - 1e-12) and np.all(true <= high + 1e-12)
    if budget > 100:  # and hardly more
        assert np.all(high - low <= 1.4 * np.ptp(true, axis=0) + 1e-9)


def test_a_network_is_its_loop_in_other_coordinates(rng):
    loop, _ = small_loop(rng)
    T, unit, scale = rng.standard_normal((2, 2)), np.array([3.0]), np.array([0.2])
    network = Network.of(loop, 1, T, unit, scale)
    z = rng.standard_normal((20, 3))
    x, r = z[:, :2] @ T.T, z[:, 2:] * unit
    for k in range(20):
        after = simulate(loop, r[k : k + 1], x[k])[1]
        y = channels(loop, x[k : k + 1], r[k : k + 1])[0]
        expected = np.concatenate([np.linalg.solve(T, after), y / scale])
        np.testing.assert_allclose(network.values(z[k : k + 1])[0], expected)


def test_neurons_that_reach_nothing_are_left_out(rng):
    loop, _ = small_loop(rng)
    Theta = loop.Theta.copy()
    Theta[:3, 3 + np.array([1, 3])] = 0.0  # one is still seen by another
    assert list(reaching(replace(loop, Theta=Theta), 1)) == [0, 1, 2]
    Theta[3:, 3:-1] = 0.0  # no longer
    form = replace(loop, Theta=Theta)
    assert list(reaching(form, 1)) == list(reaching(form, 1, [-1, -1, -1, 1])) == [0, 2]
    assert list(reaching(form, 1, [-1, -1, 1, -1])) == [0, 1, 2]  # 2 differs from 1


def test_cells_that_strips_exclude_have_no_point_of_the_region(rng):
    rows = np.array([[1.0, 1.0], [1.0, -2.0]])
    box = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    low, high = np.array([-0.6, -1.0]), np.array([0.5, 1.5])
    strips = Strips(box, rows, low, high, np.zeros((2, 0)))
    z = strips.samples(4_000, rng)
    along = z[:, :2] @ rows.T
    assert len(z) > 200 and np.all((along >= low) & (along <= high))
    assert np.all(np.abs(z) <= 1) and np.mean(np.abs(z) == 1) > 0.05
    side = np.full((1, 3), 0.125)
    steps = np.arange(8) / 4 - 0.875
    centers = np.stack(np.meshgrid(steps, steps, [0.0]), axis=-1).reshape(-1, 3)
    possible = strips.possible(centers, np.repeat(side, len(centers), axis=0))
    for center, is_possible in zip(centers, possible, strict=True):
        points = center[:2] + rng.uniform(-0.125, 0.125, (400, 2))
        there = points @ rows.T
        if np.all((there >= low) & (there <= high), axis=1).any():
            assert is_possible
    assert 0.2 < possible.mean() < 0.7
    # a region of points: what is drawn is kept
    thin = Strips(box, rows, np.zeros(2), np.zeros(2), np.zeros((2, 0)))
    assert len(thin.samples(100, rng)) == 100


def test_a_cell_without_a_point_of_the_range_of_a_neuron_is_impossible(rng):
    loop, _ = small_loop(rng)
    network = Network.of(loop, 1, np.eye(2), np.ones(1), np.ones(1))
    lure, n = network.lure, 300
    centers, halves = rng.uniform(-2, 2, (n, 3)), rng.uniform(0, 0.5, (n, 3))
    low, high = np.full((2, lure.nw), np.inf) * [[-1], [1]]
    assert network.over(centers, halves, low, high)[3].all()
    assert network.over(centers, 0 * halves, low, high)[3].all()  # a cell of a point
    low[0], high[0] = -0.2, 0.3
    possible = network.over(centers, halves, low, high)[3]
    middle = centers @ lure.V[0] + lure.b[0]
    radius = halves @ np.abs(lure.V[0])
    np.testing.assert_array_equal(
        possible, (middle + radius >= -0.2) & (middle - radius <= 0.3)
    )


@pytest.mark.parametrize("activation", ["tanh", "relu", "sin"])
def test_intervals_of_cells_hold_every_point(rng, activation):
    loop, _ = small_loop(rng, size=1.0, activation=activation)
    network = Network.of(loop, 1, np.eye(2), np.ones(1), np.ones(1))
    lure, n = network.lure, 60
    centers, halves = rng.uniform(-2, 2, (n, 3)), rng.uniform(0, 0.5, (n, 3))
    known = np.full((2, lure.nw), np.inf) * [[-1], [1]]
    *line, _ = network.over(centers, halves, *known)
    middle, radius, curved = network.affine(
        lure.W, lure.M, lure.c, line, centers, halves
    )
    assert np.all(radius >= curved.sum(axis=-1)) and np.all(curved >= 0)
    widest = np.zeros_like(radius)
    for _ in range(400):
        share = rng.choice([-1.0, 1.0, 0.0, 0.5], (n, 3))
        q = network.values(centers + share * halves)
        off = np.abs(q - middle)
        assert np.all(off <= radius + 1e-12)
        widest = np.maximum(widest, off)
    assert np.median(radius / np.maximum(widest, 1e-9)) < 1.5


def test_a_budget_ends_the_subdivision_with_a_bound(rng):
    loop, _ = small_loop(rng, size=1.0)
    network = Network.of(loop, 1, np.eye(2), np.ones(1), np.ones(1))
    box = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    known = np.full((2, network.lure.nw), np.inf) * [[-1], [1]]
    region = Strips(box, np.zeros((0, 2)), np.zeros(0), np.zeros(0), known)
    z = region.samples(3_000, rng)
    q = network.values(z)
    by_z = np.column_stack([z, np.ones(len(z))])
    fit = np.linalg.lstsq(by_z, q, rcond=None)[0].T
    q -= by_z @ fit.T
    widths = []
    for budget in (0, 2_000, 100_000):
        low, high = remainder(network, region, np.eye(3), fit, q[:50], budget)
        assert np.all(q >= low - 1e-12) and np.all(q <= high + 1e-12)
        widths.append(high - low)
    assert np.all(widths[0] >= widths[1]) and np.all(widths[1] >= widths[2])
    assert widths[0].sum() > 1.003 * widths[2].sum()
    assert np.all(widths[2] <= 1.1 * np.ptp(q, axis=0))


def test_what_has_no_value_has_no_bound():
    """A root has none below zero: nothing is known of a region that reaches there."""
    root = Activation("root", np.sqrt, lambda v, w: 0.5 / w, slope=(0.0, 1.0))
    Theta = np.array([[0.5, 1.0, 1.0, 0.0], [1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    loop = Lure(Theta, 1, 1, 1, (root,))
    network = Network.of(loop, 1, np.eye(1), np.ones(1), np.ones(1))
    known, box = np.array([[-np.inf], [np.inf]]), np.array([[-1.0, 0.0], [1.0, 0.0]])
    region = Strips(box, np.zeros((0, 1)), np.zeros(0), np.zeros(0), known)
    with np.errstate(invalid="ignore"):
        low, high = remainder(
            network, region, np.eye(2), np.zeros((2, 3)), np.zeros((1, 2)), 100
        )
    assert low[0] == -np.inf and high[0] == np.inf


def paired_loop(rng, size=0.1, n=3, activation="tanh"):
    """Return a loop whose last neurons are those of the first at another point."""
    loop, design = small_loop(rng, 3, 2, 2 * n, size, 0.6, activation)
    Theta = loop.Theta.copy()
    rows = slice(len(Theta) - n, None)
    Theta[4 + n :, :3] = Theta[4 : 4 + n, :3]
    Theta[rows, :2] += 0.05 * rng.standard_normal((n, 2))
    Theta[4:, 5:-1] = 0.0  # one layer
    twins = np.r_[np.arange(n) + n, np.full(n, -1)]
    return Lure(Theta, 3, 2, 2 * n, loop.sigma), design, twins


def test_differences_are_the_same_loop(rng):
    loop, _, twins = paired_loop(rng)
    other = differences(loop, twins)
    z = rng.standard_normal(5)
    nu = loop.V @ z + loop.b
    w = np.tanh(nu)
    dw, dnu = w.copy(), nu.copy()
    dw[:3] -= w[3:]
    dnu[:3] -= nu[3:]
    np.testing.assert_allclose(other.V @ z + other.E @ dw + other.b, dnu)
    np.testing.assert_allclose(
        other.M @ z + other.W @ dw + other.c, loop.M @ z + loop.W @ w + loop.c
    )


# -- covers ----------------------------------------------------------------------------


def test_a_linear_loop_reaches_its_region(rng):
    """The range of a signal is attained: inputs and remainders at their limits."""
    A, B, G = stable(rng, 2, 0.8), *rng.standard_normal((2, 2, 1))
    c, radius = rng.standard_normal(2), np.array([0.3])
    signals = rng.standard_normal((3, 5))
    none = np.zeros((0, 2)), np.zeros((0, 1)), np.zeros(0)
    system = Affine(A, B, c, *none, G, np.zeros((0, 1)), radius, signals)
    low, high = system.region()
    np.testing.assert_array_equal([low, high], system.reach(signals))
    n, both = 300, np.hstack([B, G * radius])
    for i, row in enumerate(signals):
        at_once = row[2:4] * [1.0, radius[0]]
        response, x = [at_once], both
        for _ in range(n):
            response.append(row[:2] @ x)
            x = A @ x
        rest = np.linalg.solve(np.eye(2) - A, c)
        most = np.abs(response).sum()
        assert high[i] >= row[:2] @ rest + row[4] + most - 1e-9
        assert low[i] <= row[:2] @ rest + row[4] - most + 1e-9
    # from rest at the origin, without constants, the range is symmetric and attained
    plain = Affine(A, B, 0 * c, *none, G, np.zeros((0, 1)), radius, signals)
    low, high = plain.reach(np.pad(signals[:, :4], ((0, 0), (0, 1))))
    for i, row in enumerate(signals):
        most, x = np.abs(row[2:4] * [1.0, radius[0]]).sum(), both
        for _ in range(n):
            most += np.abs(row[:2] @ x).sum()
            x = A @ x
        np.testing.assert_allclose([low[i], high[i]], [-most, most], rtol=1e-8)


def held(system, network, z, x_next, y):
    """Return what the remainders of a system are at points, and the rest of x+, y."""
    nx, nu = system.B.shape
    x, r = z[:, :nx], z[:, nx : nx + nu]
    left = np.hstack(
        [
            x_next - x @ system.A.T - r @ system.B.T - system.c,
            y - x @ system.C.T - r @ system.D.T - system.d,
        ]
    )
    return left


@pytest.mark.parametrize("activation", ["tanh", "relu", "sigmoid"])
def test_lines_of_neurons_hold_every_point(rng, activation):
    loop, _ = small_loop(rng, size=0.5, activation=activation)
    network = Network.of(loop, 1, np.eye(2), np.ones(1), np.ones(1))
    z = rng.uniform(-1, 1, (500, 3))
    nu, w = seen_by(network.lure, z)
    cover = ByNeurons(network)
    region = np.array([nu.min(axis=0), nu.max(axis=0)])
    system = cover.system(region)
    rho, watched = remainders(system, cover, region, z, nu, w)
    assert np.all(np.abs(rho) <= system.radius)
    q = network.values(z)
    left = held(system, network, z, q[:, :2], q[:, 2:])
    np.testing.assert_allclose(
        left, rho @ np.vstack([system.G, system.H]).T, atol=1e-12
    )
    np.testing.assert_allclose(watched, nu, atol=1e-12)
    least, largest = cover.slopes(region)
    slopes = network.lure.sigma[0].derivative(nu, w)
    assert np.all(slopes >= least - 1e-12) and np.all(slopes <= largest + 1e-12)
    np.testing.assert_array_equal(cover.seen(region), region)
    assert np.all(largest - least <= 1) and np.all(system.radius <= 0.5 * np.ptp(w, 0))


def seen_by(lure, z):
    """Return what neurons see at points, and their values, one after the other."""
    nu, w = np.zeros((len(z), lure.nw)), np.zeros((len(z), lure.nw))
    for i in range(lure.nw):
        nu[:, i] = z @ lure.V[i] + w @ lure.E[i] + lure.b[i]
        w[:, i] = lure.sigma[i].value(nu[:, i])
    return nu, w


def remainders(system, cover, region, z, nu, w):
    """Return the remainders of neurons that have lines, and what is watched."""
    s, m, _ = cover._lines(region)
    rho = w - s * nu - m
    n = np.column_stack([z, rho, np.ones(len(z))])
    return rho, n @ system.watched.T


@pytest.mark.parametrize("activation", ["tanh", "relu", "sin"])
def test_lines_of_differences_hold_every_point(rng, activation):
    loop, _, twins = paired_loop(rng, 0.5, activation=activation)
    network = Network.of(loop, 1, np.eye(3), np.ones(2), np.ones(1), twins)
    assert list(network.twins) == list(twins)
    z = rng.uniform(-1.5, 1.5, (800, 5))
    nu = z @ loop.V.T + loop.b
    w = loop.sigma[0].value(nu)
    derivative = loop.sigma[0].derivative(nu, w)
    both, dw = nu.copy(), w.copy()
    both[:, :3] -= nu[:, 3:]
    dw[:, :3] -= w[:, 3:]
    cover = ByNeurons(network)
    assert np.array_equal(cover.start, [network.rest] * 2)
    region = np.array([both.min(axis=0), both.max(axis=0)])
    system = cover.system(region)
    rho, watched = remainders(system, cover, region, z, both, dw)
    assert np.all(np.abs(rho) <= system.radius + 1e-12)
    np.testing.assert_allclose(watched, both, atol=1e-12)
    least, largest = cover.slopes(region)
    assert np.all(derivative[:, 3:] >= least[3:] - 1e-12)
    assert np.all(derivative[:, 3:] <= largest[3:] + 1e-12)
    # a chord between a neuron and its twin is the mean of slopes on the way
    theta = dw[:, :3] / np.where(both[:, :3] == 0, 1, both[:, :3])
    assert np.all(theta >= least[:3] - 1e-9) and np.all(theta <= largest[:3] + 1e-9)
    x_next, y = (loop.M @ z.T + loop.W @ w.T + loop.c[:, None]).T[:, :3], None
    y = (loop.M @ z.T + loop.W @ w.T + loop.c[:, None]).T[:, 3:4]
    left = held(system, network, z, x_next, y)
    np.testing.assert_allclose(
        left, rho @ np.vstack([system.G, system.H]).T, atol=1e-12
    )
    # they stay as narrow as the differences are
    assert np.all(system.radius[:3] <= np.abs(region[:, :3]).max(axis=0))


@pytest.mark.parametrize("activation", ["tanh", "sin"])
def test_a_map_of_cells_holds_every_point(rng, activation):
    loop, design = small_loop(rng, size=0.5, activation=activation)
    network, scaled, _ = _scaled(loop, design, np.ones(1), np.ones(1))
    cover = ByCells(network, scaled)
    system = cover.system(cover.start)
    nx, low, high = 2, *cover.start
    z = np.hstack(
        [rng.uniform(low[:nx], high[:nx], (4_000, nx)), rng.uniform(-1, 1, (4_000, 1))]
    )
    along = z[:, :nx] @ cover.rows.T
    z = z[np.all((along >= low) & (along <= high), axis=1)]
    assert len(z) > 300
    q = network.values(z)
    left = held(system, network, z, q[:, :nx], q[:, nx:])
    rho = np.linalg.lstsq(np.vstack([system.G, system.H]), left.T, rcond=None)[0].T
    np.testing.assert_allclose(rho @ np.vstack([system.G, system.H]).T, left, atol=1e-9)
    assert np.all(np.abs(rho) <= system.radius * (1 + 1e-9))
    assert np.all(system.radius <= 1.2 * np.abs(rho).max(axis=0) + 1e-9)
    nu, w = seen_by(network.lure, z)
    seen = cover.seen(cover.start)
    assert np.all(nu >= seen[0] - 1e-9) and np.all(nu <= seen[1] + 1e-9)
    first = ~network.lure.E.any(axis=1)
    assert np.isinf(seen[:, ~first]).all() and np.isfinite(seen[:, first]).all()
    least, largest = cover.slopes(cover.start)
    slopes = network.lure.sigma[0].derivative(nu, w)
    assert np.all(slopes >= least - 1e-9) and np.all(slopes <= largest + 1e-9)
    # of samples, while the region is searched: about the same, in no time
    guess = cover.system(cover.start, exact=False)
    assert np.all(guess.radius <= 1.03 * system.radius)
    assert np.all(guess.radius >= 0.8 * system.radius)


def test_covers_suit_a_loop(rng):
    for nx, nu, names in (
        (2, 1, ["cells", "neurons"]),
        (4, 1, ["cells", "neurons"]),
        (5, 1, ["neurons"]),
    ):
        loop, design = small_loop(rng, nx, nu)
        network, scaled, _ = _scaled(loop, design, np.ones(nu), np.ones(1))
        assert [cover.name for cover in covers(network, scaled)] == names
    loop, design, twins = paired_loop(rng)
    network, scaled, _ = _scaled(loop, design, np.ones(2), np.ones(1), twins)
    assert [cover.name for cover in covers(network, scaled)] == ["neurons"]
    linear = Lure(np.delete(loop.Theta[:4], np.s_[5:11], axis=1), 3, 2, 0)
    network, scaled, _ = _scaled(linear, design, np.ones(2), np.ones(1))
    assert [cover.name for cover in covers(network, scaled)] == ["neurons"]


def test_the_distance_of_systems_is_what_remainders_and_constants_make(rng):
    A, B, C = stable(rng, 2, 0.7), rng.standard_normal((2, 1)), np.ones((1, 2))
    G, H = rng.standard_normal((2, 1)), np.array([[0.5]])
    none = np.zeros((2, 0)), np.zeros((1, 0)), np.zeros(0), np.zeros((0, 4))
    design = Affine(A, B, np.zeros(2), C, np.ones((1, 1)), np.zeros(1), *none)
    for constant in (0.0, 0.4, -0.4):
        system = Affine(
            A, B, np.zeros(2), C, np.ones((1, 1)), np.array([constant]),
            G, H, np.array([0.3]), np.zeros((0, 5)),
        )  # fmt: skip
        most, x = 0.5, G
        for _ in range(400):
            most, x = most + abs(float((C @ x)[0, 0])), A @ x
        expected = 0.3 * most + abs(constant)
        assert distance(system, design)[0] == pytest.approx(expected, rel=1e-6)
        assert distance(system, design)[0] > expected * (1 - 1e-12)
    # the design may have a gain of its own
    less = Affine(A, 0.9 * B, np.zeros(2), C, np.ones((1, 1)), np.zeros(1), *none)
    most, x = 0.0, 0.1 * B
    for _ in range(400):
        most, x = most + abs(float((C @ x)[0, 0])), A @ x
    assert distance(design, less)[0] == pytest.approx(most, rel=1e-6)


# -- grid ------------------------------------------------------------------------------


def test_the_largest_value_over_boxes(rng):
    values = rng.standard_normal((6, 5))
    for size in ((1, 1), (2, 3), (3, 1)):
        ahead, behind = (_over_boxes(values, size, way) for way in (1, -1))
        for i in range(6):
            for j in range(5):
                box = values[i : i + size[0], j : j + size[1]]
                assert ahead[i, j] == box.max()
                first = max(0, i - size[0] + 1), max(0, j - size[1] + 1)
                box = values[first[0] : i + 1, first[1] : j + 1]
                assert behind[i, j] == box.max()


@pytest.mark.parametrize("tail", [1e-3, 0.6])
@pytest.mark.parametrize("gain", [0.3, -0.3])
def test_a_grid_bounds_all_inputs_and_comes_close(monkeypatch, gain, tail):
    """x+ = x / 2 + r / 2 + gain (tanh(x) - x), y = x + 0.1 tanh(x): all sequences."""
    Theta = np.zeros((3, 4))
    Theta[0] = [0.5 - gain, 0.5, gain, 0.0]
    Theta[1, [0, 2]] = 1.0, 0.1
    Theta[2, 0] = 1.0
    loop = Lure(Theta, 1, 1, 1)
    design = np.array([[0.5]]), np.array([[0.5]]), np.ones((1, 1)), np.zeros((1, 1))
    network, scaled, T = _scaled(loop, design, np.ones(1), np.ones(1))
    half = 1.5 / abs(T[0, 0])
    box = np.array([[-half], [half]])
    found = worst_input(loop, design, np.ones(1), 60)[0][0]
    monkeypatch.setattr(_grid, "TAIL", tail)  # what follows is bounded, wherever it is
    bounds = [Grid(network, scaled, box, n).bounds()[0] for n in (500, 10_000)]
    assert found <= bounds[1] < bounds[0]
    assert bounds[1] <= (1.06 if tail < 0.1 else 4) * found


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_grid_of_a_constant_rounds_upwards(sign):
    """y - y_lin = sign tanh(0.3) at every sample, whatever the cells are."""
    Theta = np.array([[0.5, 1.0, 0, 0], [1.0, 0, sign, 0], [0, 0, 0, 0.3]])
    design = np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    network, scaled, _ = _scaled(Lure(Theta, 1, 1, 1), design, np.ones(1), np.ones(1))
    bound = Grid(network, scaled, np.array([[-2.0], [2.0]]), 500).bounds()[0]
    assert np.tanh(0.3) < bound < np.tanh(0.3) * (1 + 2e-9)


def test_a_grid_starts_at_rest():
    """x+ = x / 2 + 1 - 1.2 tanh(3 x): at once y - y_lin = 1, then 0.3 and less."""
    Theta = np.zeros((3, 4))
    Theta[0] = [0.5, 0.01, -1.2, 1.0]
    Theta[1, 0], Theta[2, 0] = 1.0, 3.0
    design = np.array([[0.5]]), np.array([[0.01]]), np.ones((1, 1)), np.zeros((1, 1))
    network, scaled, T = _scaled(Lure(Theta, 1, 1, 1), design, np.ones(1), np.ones(1))
    half = 2.0 / abs(T[0, 0])
    bound = Grid(network, scaled, np.array([[-half], [half]]), 20_000).bounds()[0]
    assert 1.0 <= bound <= 1.3


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rest_may_be_at_an_end_of_the_box(sign):
    """|y - y_lin| = 1 / 2 at rest, at the end of all states, and then less."""
    Theta = np.array([[0.5, 0.1, 0, -0.2], [1, 0, 1, 0], [5, 0, 0, 0]])
    Theta[[0, 1, 2], [3, 2, 0]] *= sign  # all signals change their sign
    loop = Lure(Theta, 1, 1, 1, (ACTIVATIONS["sigmoid"],))
    design = np.array([[0.5]]), np.array([[0.1]]), np.ones((1, 1)), np.zeros((1, 1))
    network, scaled, T = _scaled(loop, design, np.ones(1), np.ones(1))
    ends = np.sort([0.0, -0.7 * sign / T[0, 0]])
    bound = Grid(network, scaled, ends[:, None], 400).bounds()[0]
    assert 0.5 <= bound < 0.56


def test_a_grid_of_a_linear_loop_adds_nothing(rng):
    """The bound of no distance is what the cells are wide, and rounds upwards."""
    loop, design = small_loop(rng, nx=1, nu=1, nw=1, size=0.0)
    Theta = loop.Theta.copy()
    Theta[1, 2] = 1e-9  # a neuron that hardly reaches y
    Theta[:2, -1] = 0.0
    loop = Lure(Theta, 1, 1, 1)
    network, scaled, _ = _scaled(loop, design, np.ones(1), np.ones(1))
    bound = Grid(network, scaled, np.array([[-4.0], [4.0]]), 2_000).bounds()[0]
    assert 0 < bound < 1.1e-9


def test_grids_suit_few_states_and_inputs():
    def suits(nx, nu, nw=1, twins=(), implicit=None, states=None):
        lure = SimpleNamespace(nx=nx, nu=nu, nw=nw, implicit=implicit or {})
        network = SimpleNamespace(lure=lure, twins=twins)
        design = SimpleNamespace(A=np.eye(nx if states is None else states))
        return Grid.suits(network, design)

    assert suits(1, 1) is suits(3, 2) is True
    for other in (
        suits(0, 1), suits(4, 1), suits(1, 3), suits(1, 1, nw=0), suits(2, 1, states=3),
        suits(1, 1, twins=(0,)), suits(1, 1, implicit={0: 1}),
    ):  # fmt: skip
        assert other is False


# -- worst inputs ----------------------------------------------------------------------


def test_the_gradient_of_the_distance(rng):
    loop, design = small_loop(rng, 2, 2, 6, 0.5)
    pair = _Pair(loop, design, np.ones(2), 12)
    r = rng.uniform(-1, 1, (12, 2))
    gradient = pair._gradient(r, 0)
    for k in range(12):
        for j in range(2):
            ends = []
            for step in (1e-5, -1e-5):
                moved = r.copy()
                moved[k, j] += step
                ends.append(pair.distance(moved)[-1, 0])
            slope = (ends[0] - ends[1]) / 2e-5
            assert gradient[k, j] == pytest.approx(slope, rel=1e-4, abs=1e-9)


def test_a_search_starts_within_the_amplitude(rng):
    loop, design = small_loop(rng, 2, 2, 4, 0.3)
    amplitude = np.array([0.5, 4.0])
    starts = list(_Pair(loop, design, amplitude, 20).starts(rng))
    assert len(starts) > 30
    for r in starts:
        assert r.shape == (20, 2) and np.all(np.abs(r) <= amplitude)


def test_the_worst_input_is_as_bad_as_said(rng):
    loop, design = small_loop(rng, 2, 1, 4, 0.3)
    found, r = worst_input(loop, design, np.array([0.7]), 30)
    pair = _Pair(loop, design, np.array([0.7]), 30)
    e = channels(loop, simulate(loop, r, np.zeros(2))[:-1], r)[:, :1]
    e -= simulate_linear(*design[:3], r) + r @ design[3].T
    np.testing.assert_allclose(pair.distance(r), np.abs(e))
    assert found == pytest.approx(np.abs(e).max()) and np.abs(r).max() <= 0.7
    for _ in range(100):
        other = 0.7 * rng.choice([-1.0, 1.0], (30, 1))
        assert pair.distance(other).max() <= found * (1 + 1e-9)


def test_a_loop_that_diverges_is_infinitely_far():
    Theta = np.array([[1e200, 1.0, 0.0], [1.0, 0.0, 0.0]])
    design = np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    found, r = worst_input(Lure(Theta, 1, 1, 0), design, np.ones(1), 20)
    assert found[0] == np.inf and np.abs(r).max() == 1


def test_the_worst_input_of_a_linear_difference_is_its_peak(rng):
    A, B, C = stable(rng, 2, 0.9), rng.standard_normal((2, 2)), np.ones((1, 2))
    Theta = np.zeros((3, 5))
    Theta[:2, :2], Theta[:2, 2:4], Theta[2, :2], Theta[2, 3] = A, B, C, 0.7
    design = A, 0.8 * B, C, np.array([[0.2, 0.0]])
    amplitude = np.array([0.5, 2.0])
    found, r = worst_input(Lure(Theta, 2, 2, 0), design, amplitude, 200)
    whole = peaks(A, 0.2 * B, C, np.array([[-0.2, 0.7]])).gain @ amplitude
    assert found == pytest.approx(whole, rel=1e-5)
    assert np.all(np.abs(r) == amplitude)


# -- what a certificate says of itself -------------------------------------------------


@pytest.fixture(scope="module")
def local():
    """One state, one input, and a channel behind y that is watched."""
    Theta = np.array(
        [
            [0.5, 1.0, 0.05, -0.02, 0.01],
            [1.0, 0.0, 0.1, 0.0, 0.0],
            [2.0, -1.0, 0.0, 0.3, 0.0],
            [1.0, 0.5, 0.0, 0.0, 0.2],
            [-0.5, 0.0, 1.0, 0.0, 0.0],
        ]
    )
    loop = Lure(Theta, 1, 1, 2)
    design = np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    options = {"search": False, "cells": 0, "watched": 1}
    return loop, design, local_certificate(loop, design, [0.5], **options)


def test_ranges_hold_what_inputs_do(local):
    loop, (A, B, C, _), c = local
    rng, amplitude, n = np.random.default_rng(0), 0.5, 400
    assert c.holds and c.verify() >= 0 and np.isnan(c.ratio)
    most = np.full((2, 4), -np.inf)
    for hold in (1, 2, 5, 100):
        for _ in range(20):
            r = amplitude * rng.choice([-1.0, 1.0], (n // hold, 1)).repeat(hold, axis=0)
            X = simulate(loop, r, np.zeros(1))[:-1]
            z = channels(loop, X, r)
            linear = simulate_linear(A, B, C, r)
            seen = np.column_stack([X, z, z[:, 0] - linear[:, 0]])
            most = np.maximum(most, [seen.max(axis=0), -seen.min(axis=0)])
    assert c.x_high >= most[0, 0] and -c.x_low >= most[1, 0]
    assert c.z_high >= most[0, 2] and -c.z_low >= most[1, 2]
    assert c.output_bounds >= most[:, 3].max()
    # and are not much wider
    for bound, (high, low) in (
        ((c.x_low, c.x_high), most[:, 0]),
        ((c.z_low, c.z_high), most[:, 2]),
    ):
        assert (bound[1] - bound[0])[0] <= 1.15 * (high + low)
    assert c.output_bounds <= 2 * most[:, 3].max()
    assert c.design_peak == pytest.approx(amplitude * 2, rel=1e-6)


@pytest.mark.parametrize(
    "name", ["output_bounds", "x_low", "x_high", "z_low", "z_high", "amplitude"]
)
def test_more_than_was_proved_is_detected(local, name):
    """A bound that is tighter by a millionth; a wider one is still one."""
    c = local[2]
    value = getattr(c, name)
    wider = -1 if name.endswith("low") else 1
    size = 1e-6 * np.maximum(np.abs(value), 1e-3)
    assert replace(c, **{name: value - wider * size}).verify() == -np.inf
    if name != "amplitude":
        assert replace(c, **{name: value + wider * size}).verify() == c.verify()
        assert replace(c, **{name: value - wider * 1e-12}).verify() == c.verify()
    else:
        assert replace(c, **{name: value + size}).verify() == -np.inf


def test_what_does_not_hold_has_no_margin(local):
    c = local[2]
    assert replace(c, holds=False).verify() == -np.inf
    assert replace(c, proof=None).verify() == -np.inf


@pytest.mark.parametrize("side", [0, 1])
def test_the_margin_is_what_is_left_of_the_region(local, side):
    """On either side, over the width: what follows has to lie within the region."""
    proof = local[2].proof
    found = proof.cover.system(proof.region).region()
    width = np.ptp(proof.region, axis=0)
    left = np.minimum(found[0] - proof.region[0], proof.region[1] - found[1])
    assert proof.check()[0] == pytest.approx(np.min(left / width))
    tight = proof.region.copy()
    tight[side] *= 0.9
    assert replace(proof, region=tight).check()[0] < 0
    wide = proof.region.copy()
    wide[side] *= 1.001
    assert 0 <= replace(proof, region=wide).check()[0] <= 0.1


def test_ranges_are_those_of_states_in_the_basis_of_the_loop(local):
    c = local[2]
    states = c.proof.states()
    T = c.proof.basis[0, 0]
    np.testing.assert_allclose(
        np.sort([T * states[0, 0], T * states[1, 0]]), [c.x_low[0], c.x_high[0]]
    )
    # any other basis: the box of the same set is a wider one
    T = np.array([[1.0, 2.0], [-1.0, 1.0]])
    box = np.array([[-1.0, 0.0], [3.0, 2.0]])
    proof = replace(c.proof, basis=T)
    object.__setattr__(proof, "states", lambda: box)
    np.testing.assert_allclose(proof.range_of_states(), [[-1.0, -3.0], [7.0, 3.0]])


def test_sectors_hold_from_rest(local):
    """Chords from what neurons see at rest, as far as the region goes."""
    loop, _, c = local
    rest = loop.b + np.array([0.05, -0.1])
    sectors, reach = c.proof.sectors(loop.sigma, rest)
    seen = c.proof.cover.seen(c.proof.region)
    assert c.proof.cover.network.live.tolist() == [0, 1]
    for i in range(2):
        if not np.isfinite(seen[:, i]).all():
            assert np.isinf(reach[i]) and sectors[:, i].tolist() == [0, 1]
            continue
        expected = min(seen[1, i] - rest[i], rest[i] - seen[0, i])
        assert reach[i] == pytest.approx(expected) and expected > 0
        nu = np.linspace(seen[0, i], seen[1, i], 999)
        chord = (np.tanh(nu) - np.tanh(rest[i])) / (nu - rest[i])
        assert np.all(chord >= sectors[0, i]) and np.all(chord <= sectors[1, i])
        assert sectors[0, i] >= chord.min() - 0.02
        assert sectors[1, i] <= chord.max() + 0.02
    assert np.isfinite(reach).any()
    # a rest beyond the region: chords from there, and no room on that side
    far = rest + 100.0
    sectors, reach = c.proof.sectors(loop.sigma, far)
    finite = np.isfinite(seen).all(axis=0)
    np.testing.assert_allclose(reach[finite], 0.0)
    chord = (np.tanh(seen[:, finite]) - 1) / (seen[:, finite] - far[finite])
    assert np.all(sectors[0, finite] <= chord) and np.all(sectors[1, finite] >= chord)


def test_a_loop_that_grows_has_no_region():
    """x+ = x / 2 + r + relu(0.6 x): unstable for positive x, in its design stable."""
    Theta = np.array([[0.5, 1.0, 0.6, 0.0], [1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    loop = Lure(Theta, 1, 1, 1, (ACTIVATIONS["relu"],))
    design = np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    c = local_certificate(loop, design, [0.1], search=False)
    assert not c.holds and c.verify() == -np.inf and c.ratio == np.inf
    assert np.isinf(c.output_bounds).all() and "No region was found" in c.reason
    assert np.isinf(c.x_high).all() and c.verdict == "undecided"
    # with less of it there is one, and a bound: (0.1 / (1 - 0.9) - 0.1 / 0.5)
    Theta[0, 2] = 0.4
    c = local_certificate(Lure(Theta, 1, 1, 1, loop.sigma), design, [0.1], search=False)
    assert c.holds and c.output_bound >= 1 - 0.2 and c.x_high >= 1.0


def test_inputs_beyond_the_range_of_the_bounds_contradict_them(monkeypatch, local):
    """What was found may not be larger than what is proved."""
    loop, design, c = local
    for found, holds in ((1.01, False), (0.99, True)):
        seen = found * c.output_bounds, np.ones((5, 1))
        monkeypatch.setattr(_local, "worst_input", lambda *_, seen=seen: seen)
        again = local_certificate(loop, design, [0.5], cells=0, watched=1)
        assert again.holds == holds
        assert holds or "contradict" in again.reason
    assert again.ratio == pytest.approx(1 / 0.99)


def test_the_grid_counts_where_it_is_tighter(local):
    loop, design, c = local
    fine = local_certificate(loop, design, [0.5], search=False, cells=3_000, watched=1)
    assert fine.proof.cells == 3_000 and fine.verify() >= 0
    assert fine.output_bound < c.output_bound
    coarse = replace(fine.proof, cells=10)
    assert fine.output_bound < coarse.check()[1] <= c.output_bounds
    assert replace(fine, proof=coarse).verify() == -np.inf

"""Local certificates: proved from above, tried from below."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from structures import STRUCTURES, declare

from alssnn.activations import ACTIVATIONS, Activation
from alssnn.certificates import (
    _cells,
    _local,
    certify_local,
    linearized_loop,
    local_certificate,
    worst_input,
)
from alssnn.certificates._covers import ByCells, ByNeurons
from alssnn.certificates._grid import Grid
from alssnn.certificates._local import _scaled
from alssnn.certificates._whole import limit
from alssnn.lure import Lure
from alssnn.simulation import channels, simulate
from helpers import (
    linear_plant,
    plant_of_structure,
    random_theta,
    small_loop,
    stable,
)


def distances(loop, design, r):
    """Return |y - y_lin| of every sample, by the plainest loops."""
    A, B, C, D = design
    y = channels(loop, simulate(loop, r, np.zeros(loop.nx))[:-1], r)[:, : len(C)]
    x = np.zeros(len(A))
    for k, r_k in enumerate(r):
        y[k] -= C @ x + D @ r_k
        x = A @ x + B @ r_k
    return np.abs(y)


def some_inputs(rng, amplitude, n=300):
    """Yield inputs of many kinds within an amplitude."""
    nr = len(amplitude)
    yield amplitude * np.ones((n, nr))
    yield amplitude * rng.uniform(-1, 1, (n, nr))
    for hold in (1, 3, 12, 50):
        levels = rng.choice([-1.0, 1.0], (n // hold + 1, nr))
        yield amplitude * np.repeat(levels, hold, axis=0)[:n]
    t = np.arange(n)[:, None]
    yield amplitude * np.sin(rng.uniform(0.01, 3) * t + rng.uniform(0, 6, nr))


# -- certificates ----------------------------------------------------------------------


@settings(max_examples=6, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    nx=st.integers(1, 4),
    nu=st.integers(1, 2),
    size=st.sampled_from([0.02, 0.1, 0.3]),
    activation=st.sampled_from(["tanh", "sigmoid", "relu", "sin"]),
)
def test_no_input_violates_a_certificate(roughly, seed, nx, nu, size, activation):
    rng = np.random.default_rng(seed)
    loop, design = small_loop(rng, nx, nu, size=size, activation=activation)
    amplitude = rng.uniform(0.2, 2.0, nu)
    with roughly():
        c = local_certificate(loop, design, amplitude)
    if not c.holds:
        assert c.reason and not c.verify() >= 0
        return
    assert c.verify() >= 0
    assert np.all(c.lower_bounds <= c.output_bounds)
    for r in [*some_inputs(rng, amplitude), c.worst_input]:
        assert np.all(distances(loop, design, r) <= c.output_bounds)
        X = simulate(loop, r, np.zeros(nx))
        assert np.all(X >= c.x_low - 1e-9) and np.all(X <= c.x_high + 1e-9)


def test_the_worst_input_is_worse_than_random_ones_and_as_bad_as_said(rng):
    loop, design = small_loop(rng, size=0.2)
    amplitude = np.array([1.0])
    c = local_certificate(loop, design, amplitude, cells=0)
    assert np.all(np.abs(c.worst_input) <= amplitude)
    e = distances(loop, design, c.worst_input)
    assert e.max() == pytest.approx(c.lower_bound, rel=1e-6)
    others = max(distances(loop, design, r).max() for r in some_inputs(rng, amplitude))
    assert others <= c.lower_bound * (1 + 1e-9)


def test_a_linear_difference_is_bounded_exactly(rng):
    """Without neurons: the bound is the peak gain, and the worst input attains it."""
    A, B = stable(rng, 3, 0.9), rng.standard_normal((3, 1))
    C = rng.standard_normal((1, 3))
    Theta = np.zeros((4, 5))
    Theta[:3, :3], Theta[:3, 3:4], Theta[3:, :3] = A, B, C
    design = A, 1.1 * B, C, np.zeros((1, 1))
    c = local_certificate(Lure(Theta, 3, 1, 0), design, [2.0])
    assert c.holds and c.ratio < 1 + 1e-6
    assert c.output_bound == pytest.approx(0.1 * c.design_peak[0] / 1.1, rel=1e-6)


def test_what_was_found_is_not_above_what_is_proved(rng, monkeypatch):
    """Of a loop that is its design, by errors of rounding."""
    plant = linear_plant(stable(rng, 2, 0.5), np.ones((2, 1)), np.ones((1, 2)))
    loop, design = plant.lure, plant.linear()
    proved = local_certificate(loop, design, [1.0])
    for share, holds in ((0.5, True), (2.0, False)):
        found = proved.output_bounds + share * _local.NOTHING * proved.design_peak
        worst = found, np.zeros((5, 1))
        monkeypatch.setattr(_local, "worst_input", lambda *_, worst=worst: worst)
        c = local_certificate(loop, design, [1.0])
        assert c.holds == holds
        assert c.lower_bound <= c.output_bound


@pytest.mark.usefixtures("rough_certificates")
def test_the_design_may_have_other_states(rng):
    loop, (A, B, C, D) = small_loop(rng, size=0.05)
    extra = np.zeros((3, 3))
    extra[:2, :2], extra[2, 2] = A, 0.5
    design = extra, np.vstack([B, [[1.0]]]), np.hstack([C, [[0.0]]]), D
    c = local_certificate(loop, design, [1.0], cells=0)
    plain = local_certificate(loop, (A, B, C, D), [1.0], cells=0)
    assert c.holds and c.method == "neurons"
    assert plain.lower_bound <= c.output_bound * (1 + 1e-9)


def test_cells_know_what_neurons_forget():
    """Two neurons that cancel each other add nothing over a region."""
    Theta = np.zeros((2 + 2, 2 + 2 + 1))
    Theta[0, :2] = 0.5, 1.0
    Theta[1, 0] = 1.0
    Theta[0, 2:4] = 2.0, -2.0
    Theta[2:, 0] = 1.0, 1.0 + 1e-9
    loop = Lure(Theta, 1, 1, 2)
    design = np.array([[0.5]]), np.array([[1.0]]), np.array([[1.0]]), np.zeros((1, 1))
    network, scaled, _ = _scaled(loop, design, np.ones(1), np.ones(1))
    by_cells = ByCells(network, scaled)
    apart = by_cells.system(by_cells.start)
    by_neurons = ByNeurons(network)
    lost = by_neurons.system(np.array([[-2.0, -2.0], [2.0, 2.0]]))
    assert np.all(apart.radius < 0.2) and np.abs(lost.G) @ lost.radius > 0.5
    c = local_certificate(loop, design, [1.0], cells=0, search=False)
    assert c.holds and c.method == "cells"


def test_a_bound_that_is_unstable_is_not_called_the_loop():
    """x+ = 1.2 x - sat(0.9 x) + r has its pole at 0.3 near rest, but its bound not."""
    Theta = np.array([[1.2, 1.0, -1.0, 0.0], [1.0, 0, 0, 0], [0.9, 0, 0, 0]])
    loop = Lure(Theta, 1, 1, 1, (limit(-0.1, 0.1),))
    design = np.array([[0.3]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    c = local_certificate(loop, design, [0.15], search=False)
    assert c.verdict == "undecided" and "radius of the loop" not in c.reason
    assert "The loop is bounded by a linear system" in c.reason
    assert "The spectral radius of the linear system is 1.2," in c.reason


def test_what_diverges_does_not_hold():
    """x+ = x / 2 + tanh(x) + r has a slope of 1.5 at the origin."""
    Theta = np.array([[0.5, 1.0, 1.0, 0.0], [1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    loop = Lure(Theta, 1, 1, 1)
    design = np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    c = local_certificate(loop, design, [0.1])
    # it does not diverge, for tanh saturates: the bound is that of the whole range
    assert c.lower_bound > 1.5 and (not c.holds or c.output_bound >= c.lower_bound)
    Theta[0, 2] = 1e4
    grows = Lure(Theta, 1, 1, 1, (ACTIVATIONS["relu"],))
    c = local_certificate(grows, design, [0.1])
    assert not c.holds and c.verdict == "does not hold"
    assert "diverges" in c.reason and "diverges" in repr(c)
    unstable = np.array([[1.2]]), *design[1:]
    c = local_certificate(loop, unstable, [0.1])
    assert not c.holds and "spectral radius" in c.reason


def spring_loop(radius=0.9):
    """Return an oscillator with a spring that hardens, and its linear part."""
    A = radius * np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])
    Theta = np.zeros((4, 5))
    Theta[:2, :2], Theta[1, 2], Theta[2, 0] = A, 0.2, 1.0
    Theta[1, 0] += 0.3
    Theta[1, 3], Theta[3, 0] = -0.3, 1.0  # x1 - tanh(x1): cubic
    design = A, Theta[:2, 2:3], Theta[2:3, :2], np.zeros((1, 1))
    return Lure(Theta, 2, 1, 1, (ACTIVATIONS["tanh"],)), design


def test_a_grid_knows_the_phase_that_peak_gains_forget():
    loop, design = spring_loop()
    rough = local_certificate(loop, design, [0.1], cells=0)
    fine = local_certificate(loop, design, [0.1])
    assert rough.holds and fine.holds and fine.verify() >= 0
    assert fine.lower_bound == rough.lower_bound
    assert fine.ratio < 1.3 < 1.38 < rough.ratio
    # the number of cells is part of what is recomputed
    coarse = replace(fine.proof, cells=20_000)
    bounds = coarse.check()[1]
    assert fine.lower_bound <= fine.output_bound < 0.97 * np.max(bounds)
    assert not replace(fine, proof=coarse).verify() >= 0


@pytest.mark.parametrize(("nx", "nu"), [(1, 1), (1, 2), (2, 2), (3, 1)])
def test_no_input_violates_a_grid(nx, nu):
    rng = np.random.default_rng(10 * nx + nu)
    loop, design = small_loop(rng, nx, nu, size=0.3)
    amplitude = rng.uniform(0.2, 2.0, nu)
    network, scaled, _ = _scaled(loop, design, amplitude, np.ones(1))
    proof = local_certificate(loop, design, amplitude, cells=0, search=False).proof
    bound = Grid(network, scaled, proof.states(), 10_000).bounds()
    inputs = list(some_inputs(rng, amplitude))
    inputs.append(worst_input(loop, design, amplitude, 150)[1])
    for r in inputs:
        assert np.all(distances(loop, design, r) <= bound)


def test_a_grid_knows_the_first_samples_after_a_rest_that_does_not_last():
    """x+ = x / 2 + 1 - 1.2 tanh(3 x): at once y - y_lin = 1, then 0.3 and less."""
    Theta = np.zeros((3, 4))
    Theta[0] = [0.5, 0.01, -1.2, 1.0]
    Theta[1, 0], Theta[2, 0] = 1.0, 3.0
    loop = Lure(Theta, 1, 1, 1, (ACTIVATIONS["tanh"],))
    design = np.array([[0.5]]), np.array([[0.01]]), np.ones((1, 1)), np.zeros((1, 1))
    network, scaled, T = _scaled(loop, design, np.ones(1), np.ones(1))
    half = 2.0 / abs(T[0, 0])
    bound = Grid(network, scaled, np.array([[-half], [half]])).bounds()
    found, r = worst_input(loop, design, np.ones(1), 100)
    assert 1.0 <= found[0] <= bound[0] <= 1.1
    assert distances(loop, design, r).max() == pytest.approx(found[0])


def test_tampering_is_detected(rng):
    loop, design = small_loop(rng, nx=1, size=0.1)
    c = local_certificate(loop, design, [1.0], cells=3_000, search=False)
    assert c.verify() >= 0
    smaller = replace(c, output_bounds=0.9 * c.output_bounds)
    assert not smaller.verify() >= 0
    tight = replace(c.proof, region=0.8 * c.proof.region)
    assert not replace(c, proof=tight).verify() >= 0


@pytest.mark.usefixtures("rough_certificates")
@pytest.mark.parametrize("name", STRUCTURES)
def test_every_structure(name, monkeypatch):
    # a linear map of fewer samples, and shorter inputs of laws that are solved; fewer
    # cells, which bound nothing more sharply here
    monkeypatch.setattr("alssnn.certificates._covers.POINTS", 1_000)
    monkeypatch.setattr("alssnn.certificates._cells.TOLERANCE", 0.1)
    monkeypatch.setattr(_cells.remainder, "__defaults__", (10_000,))  # its budget
    monkeypatch.setattr("alssnn.certificates._worst.SOLVED", (40, 1, 1, 2))
    rng = np.random.default_rng(5)
    structure = declare(name, rng)
    plant = plant_of_structure(structure, random_theta(structure, rng, 0.5), rng)
    if plant.no_law:
        with pytest.raises(ValueError, match="law"):
            certify_local(plant, 0.2)
        return
    if plant.nd:  # the range of disturbances comes from the record
        with pytest.raises(ValueError, match="amplitude"):
            certify_local(plant, 0.2)
        return
    c = certify_local(plant, 0.2, cells=2_000)
    loop = linearized_loop(plant)
    A, B, C, D = plant.linear()
    if c.holds:
        assert c.verify() >= 0
        for r in some_inputs(rng, np.full(plant.nv, 0.2), 60):
            e = distances(loop, (A, B, C, D), r)
            assert np.all(e <= c.output_bounds)
    else:
        assert c.reason


def test_amplitude_and_messages(rng):
    plant = linear_plant(stable(rng, 2, 0.5), np.ones((2, 1)), np.ones((1, 2)))
    assert certify_local(plant, 0.5).holds
    for wrong in (0.0, -1.0, np.nan, [1.0, 2.0]):
        with pytest.raises(ValueError, match="`amplitude` must be positive"):
            certify_local(plant, wrong)
    with pytest.raises(ValueError, match="`amplitude` must be given"):
        certify_local(plant)


def test_the_worst_input_alone(rng):
    loop, design = small_loop(rng, nu=2)
    found, r = worst_input(loop, design, np.array([0.5, 0.0]), 60)
    assert found.shape == (1,) and np.all(r[:, 1] == 0)
    assert np.abs(r[:, 0]).max() <= 0.5


def test_the_scorer_is_the_proved_share():
    from alssnn import LinearStateSpace
    from alssnn.datasets import make_wiener_hammerstein
    from alssnn.scorers import neg_certified_distance

    record = make_wiener_hammerstein(600, random_state=0)
    model = LinearStateSpace(nx=3, dt=record.dt).fit(*record)
    score = neg_certified_distance(model, *record)
    assert -1e-6 < score <= 0  # a linear model is its design


def test_an_activation_without_a_bounded_slope_is_said():
    root = Activation("root", np.cbrt, lambda v, w: 1 / (3 * w**2), slope=(0, np.inf))
    Theta = np.array([[0.5, 1.0, 0.1, 0.0], [1.0, 0, 0, 0], [1.0, 0, 0, 0]])
    design = np.array([[0.5]]), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    c = local_certificate(Lure(Theta, 1, 1, 1, (root,)), design, [0.1], search=False)
    assert not c.holds and "'root' has no bounded slope" in c.reason


@pytest.mark.parametrize("unit", [1e-14, 1e14])
def test_units_change_no_bound(rng, unit):
    loop, (A, B, C, D) = small_loop(rng, nx=1, size=0.1)
    Theta = loop.Theta.copy()
    Theta[:, 1:2] /= unit
    scaled = replace(loop, Theta=Theta)
    options = {"search": False, "cells": 3_000}
    c = local_certificate(loop, (A, B, C, D), [0.5], **options)
    design = A, B / unit, C, D / unit
    same = local_certificate(scaled, design, [0.5 * unit], **options)
    np.testing.assert_allclose(same.output_bounds, c.output_bounds, rtol=1e-6)


def test_odd_states_and_amplitudes(rng):
    """A state that nothing moves has no width, and zeros are no amplitude."""
    loop, design = small_loop(rng, nx=1, size=0.1)
    Theta = np.insert(np.insert(loop.Theta, 1, 0.0, axis=0), 1, 0.0, axis=1)
    still = Lure(Theta, 2, loop.nu, loop.nw, loop.sigma)
    A, B, C, D = design
    wide = np.diag([A[0, 0], 0.0]), np.vstack([B, 0 * B]), np.hstack([C, 0 * C]), D
    c = local_certificate(still, wide, [1.0])
    assert c.holds and c.verify() >= 0
    with pytest.raises(ValueError, match="`amplitude` must be positive for an input"):
        local_certificate(loop, design, [0.0])
    for wrong in (-1, 0.5, np.nan, None):
        with pytest.raises(ValueError, match="`cells` must be an integer"):
            local_certificate(loop, design, [1.0], cells=wrong)

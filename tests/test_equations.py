"""Equations: what can be written, what follows from it, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from structures import STRUCTURES, declare

from alssnn.equations import Equations, diagonal
from alssnn.models import state_space
from alssnn.simulation import channels, regressors
from alssnn.structures import Signal, Term
from helpers import assert_direct, random_theta


def everything():
    """Return a structure with factors of all kinds in all places."""
    e = Equations(x=2, z=2, u=2, d=1, y=3)
    x, z, u, d = e.state("x"), e.state("z"), e.input("u"), e.input("d")
    A, M = e.parameter("A", "x", "x"), e.parameter("M", "y", "x")
    E, F = e.parameter("E", "x", "d"), e.constant("F", np.ones((2, 1)), "x", "d")
    s, t = e.parameter("s", "x"), e.constant("t", [0.3, -0.2], "x")
    y = e.signal("y", M @ x)
    p = e.neurons("p", 0.5 * (M @ A @ x) - diagonal(e.parameter("b", "y")) @ y)
    q = e.neurons("q", A.T @ M.T @ p + diagonal(s) @ x + A @ u, "sin")
    r = e.neurons("r", (diagonal(s) @ A).T @ q + 2 * s + t, "sigmoid")
    w = e.signal("w", -(M.T @ p) + diagonal(s) @ diagonal(s) @ q - 3 * A @ A @ u)
    updates = {"x": A.T @ x + w + E @ d, "z": np.float64(0.5) * z + A.T @ (r - s)}
    b, c = F.T @ (u - z), diagonal(s) @ u + (F + E - 2 * F) @ d
    return e.structure(updates, {"out": y + p, "a": s - t, "b": b, "c": c, "w": w})


def evaluate(p, x, z, u, d):
    """Return [x+; z+; out; a; b; c; w] by the plainest formulas."""
    A, M, E, F, s, t, b = (p[name] for name in "AMEFstb")
    w_p = np.tanh(0.5 * M @ A @ x - b * (M @ x))
    w_q = np.sin(A.T @ M.T @ w_p + s * x + A @ u)
    w_r = 1 / (1 + np.exp(-((np.diag(s) @ A).T @ w_q + 2 * s + t)))
    w = -M.T @ w_p + s * s * w_q - 3 * A @ A @ u
    out = [A.T @ x + w + E @ d, 0.5 * z + A.T @ (w_r - s), M @ x + w_p]
    return np.concatenate([*out, s - t, F.T @ (u - z), s * u + (E - F) @ d, w])


def test_theta_is_what_is_written(rng):
    structure = everything()
    theta = 0.5 * rng.standard_normal(structure.n_params)
    lure, p = structure.lure(theta), structure.split(theta)
    x, z, u, d = (rng.standard_normal(n) for n in (2, 2, 2, 1))
    phi = regressors(lure, np.hstack([x, z])[None], np.hstack([u, d])[None])[0]
    out = lure.Theta[: structure.nx + structure.nz] @ phi
    expected = evaluate({**structure.constants, **p}, x, z, u, d)
    np.testing.assert_allclose(out, expected, atol=1e-14)


def test_derivative_of_all_factors_in_all_places(rng):
    structure = everything()
    theta = 0.5 * rng.standard_normal(structure.n_params)
    assert_direct(structure, theta, rng)


def test_a_change_of_units_knows_all_matrices():
    structure = everything()
    p = {**structure.constants, **structure.split(np.ones(structure.n_params))}
    scaled = structure.rescale(p, {"d": np.array([2.0]), "y": np.array([4.0, 5, 6])})
    np.testing.assert_array_equal(scaled["F"], [[0.5], [0.5]])
    np.testing.assert_array_equal(scaled["M"], [[4, 4], [5, 5], [6, 6]])


# -- views -----------------------------------------------------------------------------


def test_any_signal_can_be_observed_at_no_cost(structure, rng):
    theta = random_theta(structure, rng)
    plain = structure.observe("y")
    both = structure.observe("y", "v")
    assert both.parameters == plain.parameters
    assert both.states == plain.states == ("x",)
    assert both.neurons == plain.neurons
    assert "zeta" in structure.observe(*structure.signals).states or (
        "e" not in structure.signals
    )
    lure, p = both.lure(theta), structure.split(theta)
    x, u = rng.standard_normal((1, plain.nx)), rng.standard_normal((1, plain.nu))
    v = channels(lure, x, u)[:, plain.nz :]
    x_next = (regressors(lure, x, u) @ lure.Theta[: lure.nx].T)[0]
    g = x_next - p["A"] @ x[0] - p["B"] @ v[0]
    expected = 0.0
    if "g" in structure.signals:
        of_g = structure.observe("g")
        expected = channels(of_g.lure(theta), x, u)[0]
    np.testing.assert_allclose(g, expected, atol=1e-14)


@pytest.mark.parametrize("name", STRUCTURES)
def test_the_law_is_v_as_a_function_of_what_is_measured(name, rng):
    structure = declare(name, rng)
    theta = random_theta(structure, rng)
    law = structure.law()
    sees_x = "W_s" in structure.parameters
    assert law.inputs == ("x" if sees_x else "y", "u")
    assert law.states == () and law.nx == law.n_x0 == 0
    of_h = set(structure.parameters) & {"W_h", "b_h", "W_s", "b_s", "W_y", "b_y"}
    deeper = {f"{kind}_h{i}" for kind in "Wb" for i in (2, 3)}
    of_phi = {"U_phi", "V_phi", "b_phi", "r_phi", "r_phiu"}
    declared = set(structure.parameters)
    assert set(law.parameters) == of_h | ((deeper | of_phi) & declared)
    assert set(law.network_parameters) == set(law.parameters) - {"r_phiu"}
    lure = structure.observe("y", "v").lure(theta)
    x, u = rng.standard_normal((5, lure.nx)), rng.standard_normal((5, structure.nu))
    y, v = np.split(channels(lure, x, u), [structure.sizes["y"]], axis=1)
    static = law.lure(law.join(structure.split(theta)))
    inputs = np.hstack([x if sees_x else y, u])
    np.testing.assert_allclose(
        channels(static, np.empty((5, 0)), inputs), v, atol=1e-14
    )
    if not of_h:
        np.testing.assert_array_equal(v, u)


def test_what_is_not_there_cannot_be_observed():
    structure = state_space(2, 1, 1, n_h=2, C=[[1, 0]])
    with pytest.raises(ValueError, match="which are y, h, v, got 'g'"):
        structure.observe("y", "g")
    e = Equations(x=1, u=1, y=1)
    x, _ = e.state("x"), e.input("u")
    with pytest.raises(ValueError, match="which are y, got 'v'"):
        e.structure({"x": x}, {"y": x}).law()


# -- errors ----------------------------------------------------------------------------


@pytest.fixture
def e():
    return Equations(x=2, u=1, y=1)


def test_sizes_are_positive_integers():
    with pytest.raises(ValueError, match="positive integer, got 0 for 'x'"):
        Equations(x=0)


def test_axes_and_names_are_known(e):
    with pytest.raises(ValueError, match=r"one of 'x', 'u', 'y', got 'q'.*\(q=...\)"):
        e.parameter("A", "x", "q")
    with pytest.raises(ValueError, match="one of 'x', 'u', 'y', got 'q'"):
        e.state("q")
    with pytest.raises(ValueError, match="one or two axes, got 3"):
        e.parameter("A", "x", "x", "x")
    x, _ = e.state("x"), e.input("u")
    with pytest.raises(ValueError, match=r"Channels must be signals.*none, got 'y'"):
        e.structure({"x": x}, ["y"])
    other = Equations(x=2, d=2)
    d, A = other.input("d"), other.parameter("A", "x", "x")
    for strange, name in ((d, "d"), (A @ x, "A")):
        with pytest.raises(ValueError, match=f"these equations declare, got '{name}'"):
            e.structure({"x": x + strange}, {})


def test_names_are_used_once(e):
    x = e.state("x")
    e.parameter("A", "x", "x")
    with pytest.raises(ValueError, match="names of their own, got 'A' again"):
        e.constant("A", np.eye(2), "x", "x")
    with pytest.raises(ValueError, match="names of their own, got 'x' again"):
        e.input("x")
    e.neurons("w", x)
    with pytest.raises(ValueError, match="names of their own, got 'w' again"):
        e.signal("w", x)


def test_sizes_must_fit(e):
    x, u = e.state("x"), e.input("u")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    with pytest.raises(ValueError, match=r"2 \(x\) by 2 \(x\) must .*, got 1 \(u\)"):
        A @ u
    with pytest.raises(ValueError, match=r"must meet 2 entries, got 1 \(u\) by 2"):
        A @ B.T
    with pytest.raises(ValueError, match=r"equal sizes, got 2 \(x\) and 1 \(u\)"):
        x + u
    with pytest.raises(ValueError, match="'y' must have 1 entries as its axis, got 2"):
        e.signal("y", x)
    with pytest.raises(ValueError, match=r"`C` must have the shape of 'y', 'x', got"):
        e.constant("C", np.ones((2, 2)), "y", "x")
    with pytest.raises(ValueError, match="update of 'x' must have 2 entries, got 1"):
        e.structure({"x": u}, {"y": u})


def test_every_state_has_an_update(e):
    x = e.state("x")
    for updates, given in (({}, "none"), ({"x": x, "z": x}, "'x', 'z'")):
        with pytest.raises(ValueError, match=f"the states 'x', got {given}"):
            e.structure(updates, {})


def test_what_is_no_signal(e):
    x = e.state("x")
    A = e.parameter("A", "x", "x")
    for wrong in (1, "a", A):
        for operation in (lambda w: x + w, lambda w: x - w, lambda w: w - x):
            with pytest.raises(TypeError):
                operation(wrong)
    for operation in (lambda: A @ 1, lambda: "a" * x):
        with pytest.raises(TypeError):
            operation()
    for wrong in (x, 2.0 * e.parameter("b", "x"), A @ x):
        with pytest.raises(ValueError, match="parameter or constant with one axis"):
            diagonal(wrong)


def test_networks(e):
    x, u = e.state("x"), e.input("u")
    with pytest.raises(ValueError, match="positive integers"):
        e.mlp("f", "x", -1, {"W_x": x})
    with pytest.raises(ValueError, match="'free', 'tied' or 'none', got 'all'"):
        e.mlp("f", "x", 2, {"W_x": x}, biases="all")
    b = e.parameter("b", "x")
    with pytest.raises(ValueError, match="of 'f' must not be 'tied'"):
        e.mlp("f", "x", 2, {"W_x": e.signal("s", x + b)}, biases="tied")
    assert e.mlp("f", "u", 0, {"W_x": x}).terms == ()
    e.mlp("f", "u", 2, {"W_x": e.signal("r", x), "W_u": u}, biases="tied")


def test_algebraic_loops():
    structure = state_space(2, 1, 1, n_h=(2, 2), C=[[1, 0]])
    w, v = (Signal((axis,), (2,), (Term(axis),)) for axis in ("w_h2", "v"))
    looped = replace(structure, layers={**structure.layers, "w_h": w})
    with pytest.raises(ValueError, match="got w_h <- w_h2: an algebraic loop"):
        looped.lure(np.zeros(structure.n_params))
    looped = replace(structure, signals={**structure.signals, "v": v})
    with pytest.raises(ValueError, match="got x <- v <- v: an algebraic loop"):
        looped.lure(np.zeros(structure.n_params))
    unknown = replace(structure, updates={"x": Signal(("x",), (2,), (Term("q"),))})
    with pytest.raises(ValueError, match=r"got x <- q: .* without an equation"):
        unknown.lure(np.zeros(structure.n_params))

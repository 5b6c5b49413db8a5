import numpy as np
import pytest

from alssnn.lure import Lure
from alssnn.simulation import neuron_gains, regressors
from alssnn.structures import state_space_structure
from helpers import assert_jacobian, random_theta


def test_split_and_join_are_inverse(structure, rng):
    theta = rng.standard_normal(structure.n_params)
    np.testing.assert_array_equal(structure.join(structure.split(theta)), theta)


def test_join_ignores_strangers_and_fills_with_zero(structure):
    theta = structure.join({"A": np.eye(structure.n_x0), "stranger": 1.0})
    p = structure.split(theta)
    np.testing.assert_array_equal(p["A"], np.eye(structure.n_x0))
    assert not np.any(p["B"])


def test_lure_evaluates_the_model_equations(structure, rng):
    theta = random_theta(structure, rng)
    p = {**structure.constants, **structure.split(theta)}
    full, u = rng.standard_normal(structure.nx), rng.standard_normal(structure.nu)
    lure = structure.lure(theta)
    out = lure.Theta @ regressors(lure, full[None], u[None])[0]
    x, zeta = full[: structure.n_x0], full[structure.n_x0 :]
    y = p["C"] @ x
    h, g = np.zeros(structure.nu), np.zeros(structure.n_x0)
    if "W_y" in p:
        h = p["W_h"] @ np.tanh(p["W_y"] @ y + p["b_y"]) + p["b_h"]
    if "W_s" in p:
        h = p["W_h"] @ np.tanh(p["W_s"] @ x + p["b_s"]) + p["b_h"]
    if "W_2" in p:
        inner = np.tanh(p["W_x"] @ x + p["W_u"] @ u + p["b_x"])
        g = p["W_g"] @ np.tanh(p["W_2"] @ inner + p["b_2"])
    elif "W_g" in p:
        b_g = p.get("b_g", -p["W_g"] @ np.tanh(p["b_x"]))
        g = p["W_g"] @ np.tanh(p["W_x"] @ x + p["W_u"] @ u + p["b_x"]) + b_g
    expected = [p["A"] @ x + p["B"] @ (u + h) + g]
    if "zeta" in structure.states:
        expected.append(p["A"] @ zeta + g)
    expected.append(y)
    if "h" in structure.channels:
        expected.append(h)
    if "g" in structure.channels:
        expected.append(g)
    if "e" in structure.channels:
        expected.append(p["C"] @ zeta)
    n = structure.nx + structure.nz
    np.testing.assert_allclose(out[:n], np.concatenate(expected), atol=1e-14)


def test_blocks_of_lure_are_parts_of_theta(structure, rng):
    lure = structure.lure(random_theta(structure, rng))
    rebuilt = np.block(
        [[lure.M, lure.W, lure.c[:, None]], [lure.V, lure.E, lure.b[:, None]]]
    )
    np.testing.assert_array_equal(rebuilt, lure.Theta)
    assert lure.nz == structure.nz


def test_direct_derivative_of_one_step(structure, rng):
    theta = random_theta(structure, rng)
    L = 5
    X, u = (
        rng.standard_normal((L, structure.nx)),
        rng.standard_normal((L, structure.nu)),
    )
    n_rows = structure.nx + structure.nz
    scale = rng.uniform(0.5, 2.0, n_rows)

    def step(theta):
        lure = structure.lure(theta)
        return regressors(lure, X, u) @ lure.Theta[:n_rows].T * scale

    lure = structure.lure(theta)
    Phi = regressors(lure, X, u)
    w = Phi[:, structure.nx + structure.nu : -1]
    WR = neuron_gains(lure, lure.W * scale[:, None], w)
    out = np.zeros((L, n_rows, structure.n_params))
    structure.add_direct(structure.split(theta), Phi, WR, scale, out)
    assert_jacobian(step, out, theta)


def test_tied_bias_makes_g_vanish_at_the_operating_point(rng):
    structure = state_space_structure(
        3, 2, 1, n_g=4, C=np.ones((1, 3)), penalty="state"
    )
    lure = structure.lure(random_theta(structure, rng))
    at_rest = regressors(lure, np.zeros((1, 3)), np.zeros((1, 2)))
    np.testing.assert_allclose(at_rest @ lure.Theta[4:7].T, 0, atol=1e-15)


def test_rescale_keeps_the_map_from_input_to_output(structure, rng):
    theta = random_theta(structure, rng)
    p = {**structure.constants, **structure.split(theta)}
    su = rng.uniform(0.1, 9, structure.nu)
    sy = rng.uniform(0.1, 9, structure.sizes["y"])
    q = structure.rescale(p, {"u": su, "y": sy})
    x, u = rng.standard_normal(structure.n_x0), rng.standard_normal(structure.nu)
    np.testing.assert_allclose(q["B"] @ (su * u), p["B"] @ u)
    np.testing.assert_allclose(q["C"] @ x, sy * (p["C"] @ x))
    if "W_y" in p:
        y = p["C"] @ x
        np.testing.assert_allclose(q["W_y"] @ (sy * y), p["W_y"] @ y)
    if "W_h" in p:
        np.testing.assert_allclose(q["B"] @ q["b_h"], p["B"] @ p["b_h"])
    if "W_g" in p:
        np.testing.assert_allclose(q["W_u"] @ (su * u), p["W_u"] @ u)
        np.testing.assert_array_equal(q["W_x"], p["W_x"])


def test_free_C_needs_a_linear_model():
    with pytest.raises(ValueError, match="`C` must be given for a model with networks"):
        state_space_structure(2, 1, 1, n_h=2)


def test_lure_refuses_wrong_shapes_and_disorder():
    with pytest.raises(ValueError, match="must have 5 columns"):
        Lure(np.zeros((4, 4)), 2, 1, 1)
    Theta = np.zeros((4, 5))
    Theta[-1, 3] = 1.0
    with pytest.raises(ValueError, match="depends on itself or a later one"):
        Lure(Theta, 2, 1, 1)


def test_layers_are_found_from_the_couplings():
    Theta = np.zeros((6, 7))
    lure = Lure(Theta, 1, 1, 4)
    assert lure.layers == [slice(0, 4)]
    Theta[2 + 2, 2 + 0] = 1.0  # neuron 2 sees neuron 0
    Theta[2 + 3, 2 + 1] = 1.0  # neuron 3 sees neuron 1: the same layer as 2
    assert Lure(Theta, 1, 1, 4).layers == [slice(0, 2), slice(2, 4)]
    assert Lure(np.zeros((2, 3)), 1, 1, 0).layers == []


def test_feedback_cancels_h(rng):
    structure = state_space_structure(
        2, 1, 1, n_h=3, n_g=2, C=np.ones((1, 2)), penalty="state"
    )
    theta = random_theta(structure, rng)
    p = structure.split(theta)
    K = np.hstack([p["W_h"], np.zeros((1, 2))])
    closed = structure.lure(theta).close(K, p["b_h"])
    x, v = rng.standard_normal(2), rng.standard_normal(1)
    h = p["W_h"] @ np.tanh(p["W_y"] @ [x.sum()] + p["b_y"]) + p["b_h"]
    pre = p["W_x"] @ x + p["W_u"] @ (v - h) + p["b_x"]
    omega = p["W_g"] @ (np.tanh(pre) - np.tanh(p["b_x"]))
    out = closed.Theta @ regressors(closed, x[None], v[None])[0]
    np.testing.assert_allclose(out[:2], p["A"] @ x + p["B"] @ v + omega, atol=1e-14)
    np.testing.assert_allclose(out[3:5], omega, atol=1e-14)

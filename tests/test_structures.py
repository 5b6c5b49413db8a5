import hashlib

import numpy as np
import pytest
from structures import FIRST_EDITION, declare

from alssnn.activations import ACTIVATIONS
from alssnn.lure import Lure
from alssnn.models import state_space
from alssnn.simulation import regressors
from helpers import assert_direct, plant_of, random_theta


def test_split_and_join_are_inverse(structure, rng):
    theta = rng.standard_normal(structure.n_params)
    np.testing.assert_array_equal(structure.join(structure.split(theta)), theta)


def test_join_ignores_strangers_and_fills_with_zero(structure):
    theta = structure.join({"A": np.eye(structure.n_x0), "stranger": 1.0})
    p = structure.split(theta)
    np.testing.assert_array_equal(p["A"], np.eye(structure.n_x0))
    assert not np.any(p["B"])


def net(structure, p, name, inputs):
    """Evaluate a network by its equation, from the parameters by name."""
    axes = [a for a in structure.neurons if a in (f"w_{name}", f"w_{name}{a[-1]}")]
    if not axes:
        return 0.0
    value = structure.activations[axes[0]].value
    W_in, b_in = inputs
    w = value(sum(p[W] @ z for W, z in W_in.items()) + p.get(b_in, 0.0))
    for i in range(2, len(axes) + 1):
        w = value(p[f"W_{name}{i}"] @ w + p.get(f"b_{name}{i}", 0.0))
    return p[f"W_{name}"] @ w + p.get(f"b_{name}", 0.0)


def model(structure, p, x, u):
    """Return y, h, g, k by the equations (eq. model)."""
    xu = {"W_x": x, "W_u": u}
    rest = {"W_x": 0 * x, "W_u": 0 * u}
    g = net(structure, p, "g", (xu, "b_x"))
    if "b_g" not in p:
        g = g - net(structure, p, "g", (rest, "b_x"))
    k = net(structure, p, "k", ({"W_kx": x, "W_ku": u}, "b_kx"))
    k = k - net(structure, p, "k", ({"W_kx": 0 * x, "W_ku": 0 * u}, "b_kx"))
    y = p["C"] @ x + (p["D"] @ u if "D" in p else 0) + k
    seen = ({"W_s": x}, "b_s") if "W_s" in p else ({"W_y": y}, "b_y")
    h = net(structure, p, "h", seen)
    if "U_phi" in p:
        z = x if "W_s" in p else y
        w = structure.activations["w_phi"].value(
            p["U_phi"] @ u + p["V_phi"] @ z + p.get("b_phi", 0.0)
        )
        gain = p["S_phi"] @ p["U_phi"].T
        h = h + (0.01 + p["r_phiu"] ** 2 - 1) * u + gain @ (p["r_phi"] ** 2 * w)
    return y, h, g, k


def test_lure_evaluates_the_model_equations(structure, rng):
    theta = random_theta(structure, rng)
    p = {**structure.constants, **structure.split(theta)}
    full, u = rng.standard_normal(structure.nx), rng.standard_normal(structure.nu)
    lure = structure.lure(theta)
    out = lure.Theta @ regressors(lure, full[None], u[None])[0]
    x, zeta = full[: structure.n_x0], full[structure.n_x0 :]
    y, h, g, k = model(structure, p, x, u)
    h, g = h + np.zeros(structure.nu), g + np.zeros(structure.n_x0)
    expected = [p["A"] @ x + p["B"] @ (u + h) + g]
    if "zeta" in structure.states:
        expected.append(p["A"] @ zeta + g)
    e = p["C"] @ zeta if len(zeta) else None
    values = {"y": y, "g": g, "k": k, "h": h, "e": e}
    expected += [values[channel] for channel in structure.channels]
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
    assert_direct(structure, random_theta(structure, rng), rng)


def test_parameters_and_matrices_are_those_of_the_first_edition():
    """Names, places and Theta of all structures, in one hash."""
    digest = hashlib.sha256()
    for name in FIRST_EDITION:
        rng = np.random.default_rng(0)
        structure = declare(name, rng)
        Theta = structure.lure(rng.standard_normal(structure.n_params)).Theta
        places = structure.shapes, structure.rows, structure.cols
        digest.update(repr(places).encode())
        digest.update(np.round(1e6 * Theta).astype(np.int64).tobytes())
    assert digest.hexdigest()[:16] == "f4d110afee98e29c"


@pytest.mark.parametrize("sizes", [3, (3, 2), (2, 3, 4)])
def test_tied_biases_make_g_and_k_vanish_at_the_operating_point(sizes, rng):
    structure = state_space(3, 2, 2, n_g=sizes, n_k=sizes, C=np.ones((2, 3))).observe(
        "y", "g", "k"
    )
    lure = structure.lure(random_theta(structure, rng))
    at_rest = regressors(lure, np.zeros((1, 3)), np.zeros((1, 2)))
    np.testing.assert_allclose(at_rest @ lure.Theta[3:10].T, 0, atol=1e-15)


def test_rescale_keeps_the_map_from_input_to_output(structure, rng):
    theta = random_theta(structure, rng)
    p = {**structure.constants, **structure.split(theta)}
    su = rng.uniform(0.1, 9, structure.nu)
    sy = rng.uniform(0.1, 9, structure.sizes["y"])
    q = structure.rescale(p, {"u": su, "y": sy})
    x, u = rng.standard_normal(structure.n_x0), rng.standard_normal(structure.nu)
    np.testing.assert_allclose(q["B"] @ (su * u), p["B"] @ u)
    np.testing.assert_allclose(q["C"] @ x, sy * (p["C"] @ x))
    before, after = model(structure, p, x, u), model(structure, q, x, su * u)
    for old, new, scale in zip(before, after, (sy, su, 1, sy), strict=True):
        np.testing.assert_allclose(new, scale * old, atol=1e-13)


def test_free_C_needs_a_linear_model():
    with pytest.raises(ValueError, match="`C` must be given for a model with networks"):
        state_space(2, 1, 1, n_h=2)


def test_lure_refuses_wrong_shapes():
    with pytest.raises(ValueError, match="must have 5 columns"):
        Lure(np.zeros((4, 4)), 2, 1, 1)


def test_activations_are_for_networks_of_the_family():
    options = {"n_h": 2, "C": [[1, 0]]}
    with pytest.raises(ValueError, match=r"must name the networks .* got \['q'\]"):
        state_space(2, 1, 1, **options, activation={"q": "sin"})


def test_odd_needs_an_odd_activation():
    with pytest.raises(ValueError, match="of h must be odd for odd=True, got 'relu'"):
        state_space(2, 1, 1, n_h=2, C=[[1, 0]], odd=True, activation="relu")


def test_unknown_activation():
    with pytest.raises(ValueError, match="must be one of 'tanh', 'sigmoid'"):
        state_space(2, 1, 1, n_h=2, C=[[1, 0]], activation="softmax")


def test_layers_are_found_from_the_couplings():
    Theta = np.zeros((6, 7))
    lure = Lure(Theta, 1, 1, 4)
    assert lure.layers == [slice(0, 4)]
    Theta[2 + 2, 2 + 0] = 1.0  # neuron 2 sees neuron 0
    Theta[2 + 3, 2 + 1] = 1.0  # neuron 3 sees neuron 1: the same layer as 2
    assert Lure(Theta, 1, 1, 4).layers == [slice(0, 2), slice(2, 4)]
    assert Lure(np.zeros((2, 3)), 1, 1, 0).layers == []
    sigma = tuple(ACTIVATIONS[name] for name in ("tanh", "tanh", "sin", "sin"))
    mixed = Lure(np.zeros((6, 7)), 1, 1, 4, sigma)
    assert mixed.layers == [slice(0, 2), slice(2, 4)]


def test_feedback_cancels_h(rng):
    structure = state_space(2, 1, 1, n_h=3, n_g=2, C=np.ones((1, 2)))
    theta = random_theta(structure, rng)
    p = structure.split(theta)
    K = np.hstack([p["W_h"], np.zeros((1, 2))])
    closed = plant_of(structure.lure(theta), K, p["b_h"]).close()
    x, v = rng.standard_normal(2), rng.standard_normal(1)
    h = p["W_h"] @ np.tanh(p["W_y"] @ [x.sum()] + p["b_y"]) + p["b_h"]
    pre = p["W_x"] @ x + p["W_u"] @ (v - h) + p["b_x"]
    omega = p["W_g"] @ (np.tanh(pre) - np.tanh(p["b_x"]))
    out = closed.Theta @ regressors(closed, x[None], v[None])[0]
    np.testing.assert_allclose(out[:2], p["A"] @ x + p["B"] @ v + omega, atol=1e-14)
    np.testing.assert_allclose(out[2:4], [x.sum(), *(v - h)], atol=1e-14)

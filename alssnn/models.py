"""Models: the family that ships with the package, written as its equations.

    x+ = A x + B v + g(x, u),      v = u + h(s),      s = y or x          (eq. model)
    y  = C x + D u + k(x, u)

Any of h, g, k and D may be left out: the linear model has none of them, FL-SSNN has h,
GR-SSNN g, and AL-SSNN both.

Columns of u that are measured disturbances d are none that a controller moves: v has
only the others, G d and H d are linear, and h sees d beside s (eq. disturbance).

With process noise, or feedback in the record, K eps adds what the errors one sample
ahead say of the states (eq. innovations).  A random walk b+ = b + K_b eps may be added
to the output or to the inputs that are moved (eq. drift).
"""

from dataclasses import replace
from functools import partial

import numpy as np

from .activations import as_activation
from .equations import Equations, hidden_sizes
from .innovations import DRIFT, INNOVATION, LEVEL, MEASURED, free_run
from .inputs import split_inputs

NETWORKS = ("h", "g", "k")


def state_space(
    nx,
    nu,
    ny,
    *,
    n_h=0,
    n_g=0,
    n_k=0,
    C=None,
    feedthrough=False,
    feedback="output",
    tied_bias=True,
    odd=False,
    activation="tanh",
    input_map="identity",
    disturbances=(),
    noise="output",
    h_sees="predicted",
    drift=None,
):
    """Return the structure x+ = A x + B (u + h(s)) + g(x, u), y = C x + D u + k(x, u).

    Its signals are y, the virtual input v, and what a cost may penalize: e (the
    output-referred residual, eq. gauge, with states zeta), g, k and h, as far as the
    model has them.

    Parameters
    ----------
    nx, nu, ny : int
        Number of states, inputs and outputs.
    n_h, n_g, n_k : int or tuple of int, default=0
        Neurons of the hidden layers of h, g and k; zero leaves the network out.
    C : ndarray of shape (ny, nx) or None, default=None
        Fixed output matrix; None makes it a free parameter (linear models only).
    feedthrough : bool, default=False
        Whether D is a free parameter; else it is zero.
    feedback : {"output", "state"}, default="output"
        What h sees: s = y, with D u and k in it, or s = x.
    tied_bias : bool, default=True
        Whether the output bias of g is tied so that g(0, 0) = 0; else it is free.
        That of k always is.
    odd : bool, default=False
        Whether h has no biases, which makes it odd if its activation is.
    activation : str, Activation or dict, default="tanh"
        Activation of all networks, or one per network: ``{"h": ..., "g": ...}``,
        where those not named have tanh.
    input_map : {"identity", "monotone"}, default="identity"
        Whether h sees s alone, or v = u + h(s, u) = phi(u, s) is a monotone map of u:
        h(s) and a layer of as many neurons as its last one (eq. monotone).
    disturbances : tuple of int, default=()
        Columns of u that are measured but not moved: parameters G and, beside D, H,
        and weights of h named ``W_d`` and, of a monotone map, ``V_phid``.
    noise : {"output", "innovations"}, default="output"
        Whether y alone is noisy, or K eps acts on the states (eq. innovations): a
        parameter K, and a `predictor` beside the free run that is returned.
    h_sees : {"predicted", "measured"}, default="predicted"
        Whether the h(y) of a predictor sees y, or y_m.
    drift : {"output", "input"} or None, default=None
        Of a predictor, whether a random walk with a gain K_b is added to y, behind what
        h sees, or to the inputs that are moved (eq. drift).

    Returns
    -------
    structure : Structure
        The map from parameters to the Lur'e form (eq. model), observed by y, with
        inputs u alone.

    Raises
    ------
    ValueError
        If C is free in a model with networks, or an activation is unknown, for an
        unknown network, not odd where `odd` asks for it, or decreases where
        `input_map` forbids it.
    """
    n = {
        net: hidden_sizes(size)
        for net, size in zip(NETWORKS, (n_h, n_g, n_k), strict=True)
    }
    if C is None and any(n.values()):
        raise ValueError("`C` must be given for a model with networks, got None.")
    sigma = _activations(activation, odd)
    e, x, u, m, of_d, b = _signals(nx, nu, ny, disturbances, drift)
    of_m, network = m.axis, partial(_network, e, n, sigma)
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", of_m)
    C = e.parameter("C", "y", "x") if C is None else e.constant("C", C, "y", "x")
    y = C @ x
    if feedthrough:
        y += e.parameter("D", "y", of_m) @ m
        y = sum((e.parameter("H", "y", "d") @ d for d in of_d.values()), start=y)
    of_h, of_g = "none" if odd else "free", "tied" if tied_bias else "free"
    y += network("k", "y", "tied", "b_kx", W_kx=x, W_ku=u)
    y = e.signal("y", y + b if drift == "output" else y)
    of_x = feedback == "state"
    y_m = eps = None
    if noise == "innovations":
        y_m = e.input(MEASURED, "y")
        eps = e.signal(INNOVATION, y_m - y)
    told = y if y_m is None or h_sees == "predicted" else y_m
    if drift == "output":
        told -= b
    s = {"s" if of_x else "y": x if of_x else told, **of_d}
    seen = {f"W_{letter}": signal for letter, signal in s.items()}
    h = network("h", of_m, of_h, "b_s" if of_x else "b_y", **seen)
    if n["h"] and input_map == "monotone":  # behind h(s), which does not see u
        seen = dict(zip(("V_phi", "V_phid"), s.values(), strict=False))
        options = {"biases": of_h, "activation": sigma["h"]}
        h += e.monotone("phi", m, n["h"][-1], seen, **options) - m
    v = e.signal("v", m + (e.signal("h", h) if n["h"] else h))
    g = network("g", "x", of_g, "b_x", W_x=x, W_u=u)
    driven = (e.parameter("G", "x", "d") @ d for d in of_d.values())
    updates = {"x": sum(driven, start=A @ x + B @ v) + g}
    K = None if eps is None else e.parameter("K", "x", "y")
    if eps is not None:
        updates["x"] += K @ eps
    if b is not None:  # (eq. drift)
        updates[LEVEL] = b + e.parameter("K_b", b.axis, "y") @ eps
    if n["g"]:
        updates["zeta"] = _effect(e, g, A, C, K)
    options = {
        **{f"n_{net}": n[net] for net in NETWORKS},
        "feedthrough": feedthrough,
        "feedback": feedback,
        "tied_bias": tied_bias,
        "odd": odd,
        "activation": sigma,
        "input_map": input_map,
        **({"disturbances": tuple(map(int, np.unique(disturbances)))} if of_d else {}),
        **({} if eps is None else {"noise": noise, "h_sees": h_sees}),
        **({} if b is None else {"drift": drift}),
    }
    structure = e.structure(updates, ["y"], options=options)
    # where a walk begins is as unknown as the state
    return free_run(replace(structure, free_starts=1 if b is None else 2))


def _signals(nx, nu, ny, disturbances, drift):
    """Return equations, x, u, what is moved of u, what is given, and a random walk."""
    sizes, (moved, given) = {}, split_inputs(nu, disturbances)
    if len(given):
        sizes = {"moved": len(moved), "d": len(given)}
    if drift is not None:
        sizes[LEVEL] = ny if drift == "output" else len(moved)
    e = Equations(x=nx, u=nu, y=ny, zeta=nx, **sizes)
    x, u = e.state("x"), e.input("u")
    m, of_d, b = u, {}, None
    if len(given):  # of u, what a controller moves and what it only sees
        S = e.constant("S_m", np.eye(nu)[moved], "moved", "u")
        m = S @ u
        of_d = {"d": e.constant("S_d", np.eye(nu)[given], "d", "u") @ u}
    if drift is not None:
        b = replace(e.state(LEVEL), axes=("y" if drift == "output" else m.axis,))
        b = e.signal(DRIFT, b)
    if drift == "input":
        u, m = u + (S.T @ b if len(given) else b), m + b
    return e, x, u, m, of_d, b


def _network(e, n, sigma, net, axis, biases, bias, **inputs):
    """Return the value of a network: a signal by its name, but for h."""
    value = e.mlp(
        net, axis, n[net], inputs, bias=bias, biases=biases, activation=sigma[net]
    )
    return e.signal(net, value) if n[net] and net != "h" else value


def _effect(e, g, A, C, K):
    """Return what g does to the states, whose output e is penalized (eq. penalty)."""
    zeta = e.state("zeta")
    residual = e.signal("e", C @ zeta)
    effect = A @ zeta + g
    return effect if K is None else effect - K @ residual  # of what is predicted


def _activations(activation, odd):
    """Return the activation of every network."""
    if not isinstance(activation, dict):
        activation = dict.fromkeys(NETWORKS, activation)
    unknown = sorted(set(activation) - set(NETWORKS))
    if unknown:
        raise ValueError(
            "`activation` must name the networks 'h', 'g' (f of GR-SSNN) and 'k', got "
            f"{unknown}. A network that is left out has tanh."
        )
    sigma = {net: as_activation(activation.get(net, "tanh")) for net in NETWORKS}
    if odd and not sigma["h"].odd:
        raise ValueError(
            f"`activation` of h must be odd for odd=True, got {sigma['h'].name!r}. "
            "Choose 'tanh' or 'sin'."
        )
    return sigma

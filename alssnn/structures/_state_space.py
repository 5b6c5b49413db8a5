"""The one family of models (eq. model), declared."""

from numbers import Integral

import numpy as np

from ..activations import as_activation
from ..networks import Term, hidden_axes, network
from ._structure import Structure

# Where else the value of a network goes if a penalty makes it an axis.
SHOWN = {"h": ("h",), "g": ("zeta", "g"), "k": ("k",)}


def state_space_structure(
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
    penalty=None,
    penalize_h=False,
    tied_bias=True,
    odd=False,
    activation="tanh",
):
    """Return the structure x+ = A x + B (u + h(s)) + g(x, u), y = C x + D u + k(x, u).

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
    penalty : {"state", "output"} or None, default=None
        Channel next to y: g itself, or the output-referred residual e (eq. gauge),
        for which the states are (x, zeta); and k itself. None for simulation alone.
        The flat vector theta does not depend on it.
    penalize_h : bool, default=False
        Whether h, if there is one, is a channel, too (eq. split).
    tied_bias : bool, default=True
        Whether the output bias of g is tied so that g(0, 0) = 0; else it is free.
        That of k always is.
    odd : bool, default=False
        Whether h has no biases, which makes it odd if its activation is.
    activation : str, Activation or dict, default="tanh"
        Activation of all networks, or one per network: ``{"h": ..., "g": ...}``,
        where those not named have tanh.

    Returns
    -------
    structure : Structure
        The map from parameters to the Lur'e form (eq. model).

    Raises
    ------
    ValueError
        If C is free in a model with networks, or an activation is unknown, for an
        unknown network, or not odd where `odd` asks for it.
    """
    # h before what it acts on in the loop u = v - h(x); behind k if it sees y
    order = "hkg" if feedback == "state" else "khg"
    n = {"h": n_h, "g": n_g, "k": n_k}
    layers = {net: _sizes(n[net]) for net in order}
    if C is None and any(layers.values()):
        raise ValueError("`C` must be given for a model with networks, got None.")
    sigma = _activations(activation, odd)
    hidden = {
        net: dict(zip(hidden_axes(net, len(sizes)), sizes, strict=True))
        for net, sizes in layers.items()
    }
    states, channels = _signals(layers, penalty, penalize_h)
    signals = {
        "x": nx,
        "u": nu,
        "y": ny,
        "zeta": nx,
        "e": ny,
        "g": nx,
        "k": ny,
        "h": nu,
    }
    sizes = {axis: signals[axis] for axis in ("u", *states, *channels)}
    linear, terms = _linear_part(free_C=C is None, feedthrough=feedthrough)
    if "zeta" in states:  # zeta+ = A zeta + g, e = C zeta
        terms += [Term("zeta", "zeta", ("A",)), Term("e", "zeta", ("C",))]
    parameters = dict(linear)

    def add(net, inputs, rows, biases):
        # a value goes to its own channel, too, or to the states of its effect
        rows += [(axis, ()) for axis in SHOWN[net] if axis in sizes]
        new, contributions = network(
            net, len(layers[net]), inputs, rows, biases=biases, activation=sigma[net]
        )
        parameters.update(new)
        terms.extend(contributions)

    x, u = ("x", ()), ("u", ())
    if layers["k"]:
        add("k", {"x": [x], "u": [u]}, [("y", ())], "tied")
    if layers["h"]:
        y = [(term.cols, term.factors) for term in terms if term.rows == "y"]
        inputs = {"y": y} if feedback == "output" else {"x": [x]}
        add("h", inputs, [("x", ("B",))], "none" if odd else "free")
    if layers["g"]:
        add("g", {"x": [x], "u": [u]}, [x], "tied" if tied_bias else "free")
    return Structure(
        sizes={**sizes, **{a: m for axes in hidden.values() for a, m in axes.items()}},
        states=states,
        channels=channels,
        neurons=tuple(axis for axes in hidden.values() for axis in axes),
        parameters=parameters,
        terms=tuple(terms),
        constants={} if C is None else {"C": np.array(C, float)},
        constant_axes={} if C is None else {"C": ("y", "x")},
        network_parameters=tuple(name for name in parameters if name not in linear),
        activations={axis: sigma[net] for net, axes in hidden.items() for axis in axes},
        options={
            **{f"n_{net}": layers[net] for net in "hgk"},
            "feedthrough": feedthrough,
            "feedback": feedback,
            "penalty": penalty,
            "penalize_h": penalize_h,
            "tied_bias": tied_bias,
            "odd": odd,
            "activation": {net: sigma[net] for net in order},
        },
    )


def _activations(activation, odd):
    """Return the activation of every network."""
    if not isinstance(activation, dict):
        activation = dict.fromkeys("hgk", activation)
    unknown = sorted(set(activation) - set("hgk"))
    if unknown:
        raise ValueError(
            "`activation` must name the networks 'h', 'g' (f of GR-SSNN) and 'k', got "
            f"{unknown}. A network that is left out has tanh."
        )
    sigma = {net: as_activation(activation.get(net, "tanh")) for net in "hgk"}
    if odd and not sigma["h"].odd:
        raise ValueError(
            f"`activation` of h must be odd for odd=True, got {sigma['h'].name!r}. "
            "Choose 'tanh' or 'sin'."
        )
    return sigma


def _signals(layers, penalty, penalize_h):
    """Return states and channels, with those that a penalty asks for."""
    states, channels = ["x"], ["y"]
    if layers["g"] and penalty == "state":
        channels.append("g")
    elif layers["g"] and penalty == "output":
        states.append("zeta")
        channels.append("e")
    if layers["k"] and penalty is not None:
        channels.append("k")
    if layers["h"] and penalize_h:
        channels.append("h")
    return tuple(states), tuple(channels)


def _linear_part(free_C, feedthrough):
    """Return parameters and terms of x+ = A x + B u, y = C x + D u."""
    parameters = {"A": ("x", "x"), "B": ("x", "u")}
    terms = [Term("x", "x", ("A",)), Term("x", "u", ("B",)), Term("y", "x", ("C",))]
    if free_C:
        parameters["C"] = ("y", "x")
    if feedthrough:
        parameters["D"] = ("y", "u")
        terms.append(Term("y", "u", ("D",)))
    return parameters, terms


def _sizes(n):
    """Return the sizes of the hidden layers; none for a network left out."""
    sizes = (n,) if np.ndim(n) == 0 else tuple(n)
    if sizes in [(0,), ()]:
        return ()
    if not all(isinstance(size, Integral) and int(size) > 0 for size in sizes):
        raise ValueError(
            "The sizes of hidden layers must be positive integers, such as 10 or "
            f"(10, 5), got {n!r}."
        )
    return tuple(int(size) for size in sizes)

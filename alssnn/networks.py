"""Networks: multilayer perceptrons as terms of the Lur'e form.

With one hidden layer and a linear output layer (eq. model):

    h(y)    = W_h sigma(W_y y + b_y) + b_h    or    h(x) = W_h sigma(W_s x + b_s) + b_h
    g(x, u) = W_g sigma(W_x x + W_u u + b_x) + b_g
    k(x, u) = W_k sigma(W_kx x + W_ku u + b_kx) + b_k

A further hidden layer i = 2, 3, ... of net n puts sigma(W_ni . + b_ni) behind the ones
before it.  In deviation variables the operating point is (x, u) = (0, 0), and tied
biases b_g and b_k make g and k vanish there: minus what the net would give (`AtRest`).

A network is a table of parameters (name -> axes) and a list of terms, each adding a
product of parameters to a block of Theta; see `structures` for what is done with them.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .activations import Activation

ONE = "1"  # axis of length one: the column of Theta that carries the constants
# Parameters of the first hidden layer: weights by what they act on, and the bias.
INNER = {
    "h": {"y": "W_y", "x": "W_s"},
    "g": {"x": "W_x", "u": "W_u"},
    "k": {"x": "W_kx", "u": "W_ku"},
}
INNER_BIAS = {"h": {"y": "b_y", "x": "b_s"}, "g": {"x": "b_x"}, "k": {"x": "b_kx"}}
OUTPUT = {"h": "u", "g": "x", "k": "y"}  # axis of the value of each network


@dataclass(frozen=True)
class Term:
    """Contribute the product of its factors to the block (rows, cols) of Theta.

    Parameters
    ----------
    rows, cols : str
        Axes of the block.
    factors : tuple of str or AtRest
        Names of parameters or constants, from left to right; the last one may be an
        `AtRest`. A vector stands as one column.
    """

    rows: str
    cols: str
    factors: tuple


@dataclass(frozen=True)
class AtRest:
    """Name minus the last hidden layer of a network at the operating point.

    Parameters
    ----------
    layers : tuple of tuple of str
        Names (W_i, b_i) of the hidden layers; W_1 meets a zero and is not used.
    activation : Activation
        Activation of the layers.
    """

    layers: tuple
    activation: Activation

    def value(self, p):
        """Return the value.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name.

        Returns
        -------
        value : ndarray of shape (n, 1)
            Minus the values of the last hidden layer.
        """
        w = self.activation.value(p[self.layers[0][1]])
        for W, b in self.layers[1:]:
            w = self.activation.value(p[W] @ w + p[b])
        return -w[:, None]

    def jacobian(self, p):
        """Return the derivative of the value.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name.

        Returns
        -------
        jacobian : dict of str to ndarray
            Derivative by each parameter involved, shape (n, its size).
        """
        v, slope, jacobian = p[self.layers[0][1]], self.activation.derivative, {}
        w = self.activation.value(v)
        jacobian[self.layers[0][1]] = np.diag(slope(v, w))
        for W, b in self.layers[1:]:
            v = p[W] @ w + p[b]
            inner = {name: p[W] @ J for name, J in jacobian.items()}
            inner |= {W: np.kron(np.eye(len(v)), w), b: np.eye(len(v))}
            w = self.activation.value(v)
            jacobian = {name: slope(v, w)[:, None] * J for name, J in inner.items()}
        return {name: -J for name, J in jacobian.items()}


def hidden_axes(net, depth):
    """Return the axes of the hidden layers of a network.

    Parameters
    ----------
    net : {"h", "g", "k"}
        Network.
    depth : int
        Number of hidden layers.

    Returns
    -------
    axes : list of str
        Such as ``["w_g", "w_g2"]``.
    """
    return [f"w_{net}{i}" if i > 1 else f"w_{net}" for i in range(1, depth + 1)]


def network(net, depth, inputs, rows, *, biases="free", activation):
    """Return parameters and terms of a network.

    Parameters
    ----------
    net : {"h", "g", "k"}
        Network.
    depth : int
        Number of hidden layers.
    inputs : dict of str to list of tuple
        What the first layer sees: axis of a signal -> its parts (cols, factors), each
        a product of factors times a column axis.
    rows : list of tuple
        Where the value goes: pairs (rows, factors), factors before the output weights.
    biases : {"free", "tied", "none"}, default="free"
        Free biases in all layers, output bias tied so that the network vanishes at
        the operating point, or no biases at all.
    activation : Activation
        Activation of the hidden layers.

    Returns
    -------
    parameters : dict of str to tuple of str
        Axes of the parameters.
    terms : list of Term
        Contributions to Theta.
    """
    axes = hidden_axes(net, depth)
    first, last = axes[0], axes[-1]
    W_out, b_out = f"W_{net}", f"b_{net}"
    parameters: dict[str, tuple[str, ...]] = {W_out: (OUTPUT[net], last)}
    terms = [Term(axis, last, (*before, W_out)) for axis, before in rows]
    if biases == "free":
        parameters[b_out] = (OUTPUT[net],)
    for signal, parts in inputs.items():
        W = INNER[net][signal]
        parameters[W] = (first, signal)
        terms += [Term(first, cols, (W, *factors)) for cols, factors in parts]
    layers = [("", next(INNER_BIAS[net][s] for s in inputs if s in INNER_BIAS[net]))]
    layers += [(f"W_{net}{i}", f"b_{net}{i}") for i in range(2, depth + 1)]
    for (before, axis), (W, _) in zip(pairwise(axes), layers[1:], strict=True):
        parameters[W] = (axis, before)
        terms.append(Term(axis, before, (W,)))
    if biases != "none":
        for axis, (_, b) in zip(axes, layers, strict=True):
            parameters[b] = (axis,)
            terms.append(Term(axis, ONE, (b,)))
        tied = (W_out, AtRest(tuple(layers), activation))
        bias = (b_out,) if biases == "free" else tied
        terms += [Term(axis, ONE, (*before, *bias)) for axis, before in rows]
    return parameters, terms


@dataclass(frozen=True, eq=False)
class Perceptron:
    """Evaluate a network from its weights.

    Parameters
    ----------
    layers : list of tuple of ndarray
        Weights and biases (W, b) from the first hidden to the output layer.
    activation : Activation
        Activation of the hidden layers.
    """

    layers: list
    activation: Activation

    @classmethod
    def h(cls, p, activation):
        """Return the network h.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name, those of h and B.
        activation : Activation
            Activation of h.

        Returns
        -------
        h : Perceptron or None
            The network; None for a model without h.
        """
        return cls.of("h", p, activation)

    @classmethod
    def of(cls, net, p, activation):
        """Return a network.

        Parameters
        ----------
        net : {"h", "g", "k"}
            Network. What g and k see is [x; u].
        p : dict of str to ndarray
            Parameters by name.
        activation : Activation
            Activation of the network.

        Returns
        -------
        network : Perceptron or None
            The network, tied biases included; None for a model without it.
        """
        if f"W_{net}" not in p:
            return None
        signals = [s for s, W in INNER[net].items() if W in p]
        b = next(INNER_BIAS[net][s] for s in signals if s in INNER_BIAS[net])
        layers = [(np.hstack([p[INNER[net][s]] for s in signals]), p.get(b))]
        while f"W_{net}{len(layers) + 1}" in p:
            i = len(layers) + 1
            layers.append((p[f"W_{net}{i}"], p.get(f"b_{net}{i}")))
        layers.append((p[f"W_{net}"], p.get(f"b_{net}")))
        layers = [(W, np.zeros(len(W)) if b is None else b) for W, b in layers]
        network = cls(layers, activation)
        if net != "h" and f"b_{net}" not in p:  # tied: it vanishes at rest
            W, _ = layers[-1]
            layers[-1] = W, -network(np.zeros(layers[0][0].shape[1]))
        return network

    def __call__(self, s):
        """Evaluate the network (eq. model).

        Parameters
        ----------
        s : ndarray of shape (N, n_inputs)
            What the first layer sees, one row per sample.

        Returns
        -------
        value : ndarray of shape (N, n_outputs)
            Values.
        """
        *hidden, (W_out, b_out) = self.layers
        for W, b in hidden:
            s = self.activation.value(s @ W.T + b)
        return s @ W_out.T + b_out

"""Networks: the values of h, g and k, from their weights.

The names of the weights are those of `models`; here they are read.
"""

from dataclasses import dataclass

import numpy as np

from .activations import Activation

# Parameters of the first hidden layer: weights by what they act on, and the bias.
INNER = {
    "h": {"y": "W_y", "x": "W_s"},
    "g": {"x": "W_x", "u": "W_u"},
    "k": {"x": "W_kx", "u": "W_ku"},
}
INNER_BIAS = {"h": {"y": "b_y", "x": "b_s"}, "g": {"x": "b_x"}, "k": {"x": "b_kx"}}


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

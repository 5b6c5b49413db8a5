"""Equations: how a structure is written.

A model reads as its mathematics.  For a nonlinearity at the input of a linear system,

    e = Equations(x=nx, u=nu, y=ny)
    x, u = e.state("x"), e.input("u")
    A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    y = e.signal("y", e.constant("C", C, "y", "x") @ x)
    v = e.signal("v", u + e.mlp("f", "u", 8, {"W_u": u}))
    structure = e.structure({"x": A @ x + B @ v}, ["y"])

Matrices stand in front of signals, signals add, neurons are signals of their own.  What
is written is collected in a `structures.Structure`, in the order of writing: that of
the parameters in theta and of the neurons.

A network is a chain of neurons.  With one hidden layer and a linear output layer,

    g(x, u) = W_g sigma(W_x x + W_u u + b_x) + b_g

A further hidden layer i = 2, 3, ... of net n puts sigma(W_ni . + b_ni) behind the ones
before it.  In deviation variables the operating point is (x, u) = (0, 0), and a tied
bias b_g makes g vanish there: minus what the net would give (`structures.AtRest`).
"""

from dataclasses import replace
from numbers import Integral

import numpy as np

from .activations import as_activation
from .checks import check_option
from .structures import ONE, AtRest, Factor, Matrix, Signal, Structure, Term, diagonal

LEAST_GAIN = 0.01  # of a monotone network: its inverse amplifies a hundredfold at most


class Equations:
    """Write a model.

    Parameters
    ----------
    **sizes : int
        Length of every axis: states, inputs, outputs, and what else parameters map.
        Neurons and named signals bring theirs.

    Examples
    --------
    >>> from alssnn.equations import Equations
    >>> e = Equations(x=2, u=1, y=1)
    >>> x, u = e.state("x"), e.input("u")
    >>> A, B = e.parameter("A", "x", "x"), e.parameter("B", "x", "u")
    >>> y = e.signal("y", e.parameter("C", "y", "x") @ x)
    >>> e.structure({"x": A @ x + B @ u}, ["y"]).n_params
    8
    """

    def __init__(self, **sizes):
        self.sizes = {}
        for axis, size in sizes.items():
            if not isinstance(size, Integral) or size < 1:
                raise ValueError(
                    f"The length of an axis must be a positive integer, got {size!r} "
                    f"for {axis!r}."
                )
            self.sizes[axis] = int(size)
        self._states, self._inputs, self._layers, self._signals = [], [], {}, {}
        self._parameters, self._constants, self._networks = {}, {}, []
        self._activations, self._axes = {}, {}

    def state(self, axis):
        """Return a state.

        Parameters
        ----------
        axis : str
            Axis. The first state is the one whose initial value is free.

        Returns
        -------
        x : Signal
            The state.
        """
        self._states.append(self._new(axis))
        return self._column(axis)

    def input(self, axis, like=None):
        """Return an input.

        Parameters
        ----------
        axis : str
            Axis. The columns of u are those of all inputs in order; the first one is
            what a controller moves, the others are measured.
        like : str or None, default=None
            Axis whose units it has; None means units of its own.

        Returns
        -------
        u : Signal
            The input.
        """
        self._inputs.append(self._new(axis, like and self._size(like)))
        return replace(self._column(axis), axes=(like or axis,))

    def parameter(self, name, *axes):
        """Return a free parameter.

        Parameters
        ----------
        name : str
            Name.
        *axes : str
            Axes of rows and columns; one of them for a vector.

        Returns
        -------
        parameter : Matrix or Signal
            A matrix, or a constant signal for a vector.
        """
        value = self._named(name, axes)
        self._parameters[name] = axes
        return value

    def weights(self, name, *axes):
        """Return a free parameter that belongs to a network (weight decay).

        Parameters
        ----------
        name : str
            Name.
        *axes : str
            Axes of rows and columns; one of them for biases.

        Returns
        -------
        weights : Matrix or Signal
            A matrix, or a constant signal for biases.
        """
        value = self.parameter(name, *axes)
        self._networks.append(name)
        return value

    def constant(self, name, value, *axes):
        """Return a fixed matrix or vector.

        Parameters
        ----------
        name : str
            Name.
        value : array_like
            Values.
        *axes : str
            Axes of rows and columns; one of them for a vector.

        Returns
        -------
        constant : Matrix or Signal
            A matrix, or a constant signal for a vector.
        """
        constant, value = self._named(name, axes), np.array(value, dtype=float)
        if value.shape != tuple(self.sizes[axis] for axis in axes):
            raise ValueError(
                f"`{name}` must have the shape of {_list(axes)}, got {value.shape}."
            )
        self._constants[name], self._axes[name] = value, axes
        return constant

    def signal(self, name, value):
        """Name a signal, which can then be observed.

        Parameters
        ----------
        name : str
            Name.
        value : Signal
            What it is.

        Returns
        -------
        signal : Signal
            The signal by its name.
        """
        self._signals[self._new(name, value.size)] = value
        return Signal(value.axes, value.shape, (Term(name),))

    def neurons(self, axis, value, activation="tanh"):
        """Return neurons.

        Parameters
        ----------
        axis : str
            Axis, their own.
        value : Signal
            What they see.
        activation : str or Activation, default="tanh"
            Activation.

        Returns
        -------
        w : Signal
            Their values.
        """
        self._layers[self._new(axis, value.size)] = value
        self._activations[axis] = as_activation(activation)
        return self._column(axis)

    def mlp(
        self, net, axis, sizes, inputs, *, bias=None, biases="free", activation="tanh"
    ):
        """Return the value of a network.

        For net="f" the output layer is W_f and b_f, further hidden layers are W_f2 and
        b_f2, and so on, and the axes of the neurons are w_f, w_f2, and so on.

        Parameters
        ----------
        net : str
            Name of the network.
        axis : str
            Axis of its value.
        sizes : int or tuple of int
            Neurons of the hidden layers; zero leaves the network out.
        inputs : dict of str to Signal
            What the first layer sees, by the names of its weights.
        bias : str or None, default=None
            Name of the biases of the first layer; None means ``b_f1`` for net="f".
        biases : {"free", "tied", "none"}, default="free"
            Free biases in all layers, output bias tied so that the network vanishes at
            the operating point, or no biases at all.
        activation : str or Activation, default="tanh"
            Activation of the hidden layers.

        Returns
        -------
        value : Signal
            The value; zero for a network left out.
        """
        check_option("biases", biases, ("free", "tied", "none"))
        sizes, sigma = hidden_sizes(sizes), as_activation(activation)
        if not sizes:
            return Signal((axis,), (self._size(axis),))
        if biases == "tied" and not all(map(self._rests, inputs.values())):
            raise ValueError(
                f"`biases` of {net!r} must not be 'tied', for it sees more than states "
                "and inputs, which alone are zero at rest. Take 'free'."
            )
        numbers = range(2, len(sizes) + 1)
        layers = [f"w_{net}", *(f"w_{net}{i}" for i in numbers)]
        for layer, size in zip(layers, sizes, strict=True):
            self._size(layer, size)
        weights = self.weights
        # in this order they stand in theta: output, weights, biases
        W_out = weights(f"W_{net}", axis, layers[-1])
        b_out = weights(f"b_{net}", axis) if biases == "free" else None
        seen = [weights(W, layers[0], s.axis) @ s for W, s in inputs.items()]
        inner = [
            weights(f"W_{net}{i}", layer, before)
            for i, before, layer in zip(numbers, layers, layers[1:], strict=False)
        ]
        names = [bias or f"b_{net}1", *(f"b_{net}{i}" for i in numbers)]
        if biases == "none":
            offsets = [Signal((layer,), (self._size(layer),)) for layer in layers]
        else:
            offsets = [weights(*each) for each in zip(names, layers, strict=True)]
        w = self.neurons(layers[0], sum(seen[1:], start=seen[0]) + offsets[0], sigma)
        for layer, W, b in zip(layers[1:], inner, offsets[1:], strict=True):
            w = self.neurons(layer, W @ w + b, sigma)
        if biases == "tied":
            W_names = ["", *(f"W_{net}{i}" for i in numbers)]
            at_rest = AtRest(tuple(zip(W_names, names, strict=True)), sigma)
            w += Signal(w.axes, w.shape, (Term(ONE, (at_rest,)),))
        return W_out @ w if b_out is None else W_out @ w + b_out

    def monotone(self, net, u, size, inputs, *, biases="free", activation="tanh"):
        """Return a network that increases with a signal (eq. monotone).

        For net="f" that is

            d u + diag(r_fu)^2 u + S_f U_f' diag(r_f)^2 sigma(U_f u + ... + b_f)

        with d = `LEAST_GAIN`, S_f = I, which only says the units, and what the layer
        sees of other signals in the place of the dots. Its derivative by u is symmetric
        and at least d for an activation that does not decrease, so that every value is
        that of exactly one u.

        Parameters
        ----------
        net : str
            Name of the network.
        u : Signal
            What it increases with.
        size : int
            Neurons of its hidden layer.
        inputs : dict of str to Signal
            What the layer sees beside u, by the names of its weights.
        biases : {"free", "none"}, default="free"
            Biases of the layer, or none.
        activation : str or Activation, default="tanh"
            Activation of the layer, which must not decrease.

        Returns
        -------
        value : Signal
            The value, as long as u.

        Raises
        ------
        ValueError
            If the activation decreases.
        """
        sigma, layer = as_activation(activation), f"w_{net}"
        if not sigma.slope[0] >= 0:
            raise ValueError(
                f"`activation` of {net!r} must not decrease, got {sigma.name!r}. "
                "Choose 'tanh' or 'sigmoid'."
            )
        # axes of their own where units are none, or those of 1 / u
        for axis, length in (
            (layer, size),
            (f"{net}u", u.size),
            (f"per_{u.axis}", u.size),
        ):
            self._size(axis, length)
        # no weight of a network: a decay would take the input away
        R_u = diagonal(self.parameter(f"r_{net}u", f"{net}u"))
        R = diagonal(self.weights(f"r_{net}", layer))
        U = self.weights(f"U_{net}", layer, u.axis)
        seen = U @ u
        for W, signal in inputs.items():
            seen += self.weights(W, layer, signal.axis) @ signal
        if biases == "free":
            seen += self.weights(f"b_{net}", layer)
        w = self.neurons(layer, seen, sigma)
        S = self.constant(f"S_{net}", np.eye(u.size), u.axis, f"per_{u.axis}")
        return LEAST_GAIN * u + R_u @ R_u @ u + S @ U.T @ R @ R @ w

    def structure(self, updates, channels, options=None):
        """Return what has been written as a structure.

        Parameters
        ----------
        updates : dict of str to Signal
            Next value of every state.
        channels : sequence of str, or dict of str to Signal
            Signals that make up z; a dict names those that have no name yet. The first
            one is what a record holds. `Structure.observe` takes any other signals.
        options : dict or None, default=None
            What `Structure.options` says.

        Returns
        -------
        structure : Structure
            The map from parameters to the Lur'e form.

        Raises
        ------
        ValueError
            If a state has no update or one of another size, or a name is unknown.
        """
        if isinstance(channels, dict):
            for name, value in channels.items():
                if value.terms != (Term(name),):  # else it is the signal of that name
                    self.signal(name, value)
        if missing := [name for name in channels if name not in self._signals]:
            raise ValueError(
                f"Channels must be signals, which are {_list(self._signals)}, got "
                f"{_list(missing)}. Name them with `signal`."
            )
        if set(updates) != set(self._states):
            raise ValueError(
                f"`updates` must be those of the states {_list(self._states)}, got "
                f"{_list(updates)}."
            )
        for axis, value in updates.items():
            if value.size != self.sizes[axis]:
                raise ValueError(
                    f"The update of {axis!r} must have {self.sizes[axis]} entries, got "
                    f"{value.size}."
                )
        signals = {name: self._signals[name] for name in (*channels, *self._signals)}
        updates = {axis: updates[axis] for axis in self._states}
        known = {*self._parameters, *self._constants, *self._roles()}
        for value in (*signals.values(), *updates.values(), *self._layers.values()):
            names = {name for t in value.terms for f in t.factors for name in f.names}
            if strange := (names | {t.cols for t in value.terms}) - known:
                raise ValueError(
                    f"Signals must be made of what these equations declare, got "
                    f"{_list(sorted(strange))}. Write all of a model with one object."
                )
        return Structure(
            sizes=dict(self.sizes),
            inputs=tuple(self._inputs),
            updates=updates,
            layers=dict(self._layers),
            signals=signals,
            channels=tuple(channels),
            parameters=dict(self._parameters),
            constants=dict(self._constants),
            constant_axes=dict(self._axes),
            network_parameters=tuple(self._networks),
            activations=dict(self._activations),
            options=options or {},
        )

    def _size(self, axis, size=None):
        """Return the length of an axis, which may be new."""
        known = self.sizes.setdefault(axis, size) if size else self.sizes.get(axis)
        if known is None:
            raise ValueError(
                f"An axis must be one of {_list(self.sizes)}, got {axis!r}. Give its "
                f"length: Equations({axis}=...)."
            )
        if size not in (None, known):
            raise ValueError(
                f"{axis!r} must have {known} entries as its axis, got {size}."
            )
        return known

    def _new(self, name, size=None):
        """Return a name that no signal has yet."""
        if name in self._roles():
            raise ValueError(
                f"Signals must have names of their own, got {name!r} again."
            )
        self._size(name, size)
        return name

    def _roles(self):
        """Return the names of all signals."""
        return (*self._states, *self._inputs, *self._layers, *self._signals, ONE)

    def _column(self, axis):
        return Signal((axis,), (self.sizes[axis],), (Term(axis),))

    def _named(self, name, axes):
        """Return a new parameter or constant."""
        if name in self._parameters or name in self._constants:
            raise ValueError(
                f"Parameters must have names of their own, got {name!r} again."
            )
        if len(axes) not in (1, 2):
            raise ValueError(f"`{name}` must have one or two axes, got {len(axes)}.")
        shape = tuple(self._size(axis) for axis in axes)
        if len(axes) == 2:
            return Matrix(axes, shape, (Term("", (Factor(name),)),))
        return Signal(axes, shape, (Term(ONE, (Factor(name),)),))

    def _rests(self, signal):
        """Tell whether a signal is zero at rest: a sum of states and inputs alone."""
        return all(
            self._rests(self._signals[term.cols])
            if term.cols in self._signals
            else term.cols in (*self._states, *self._inputs)
            for term in signal.terms
        )


def hidden_sizes(n):
    """Return the sizes of hidden layers.

    Parameters
    ----------
    n : int or tuple of int
        Neurons of one layer, or of every layer; zero for a network left out.

    Returns
    -------
    sizes : tuple of int
        Neurons of every layer; none for a network left out.

    Raises
    ------
    ValueError
        If they are not positive integers.
    """
    sizes = (n,) if np.ndim(n) == 0 else tuple(n)
    if sizes in [(0,), ()]:
        return ()
    if not all(isinstance(size, Integral) and int(size) > 0 for size in sizes):
        raise ValueError(
            "The sizes of hidden layers must be positive integers, such as 10 or "
            f"(10, 5), got {n!r}."
        )
    return tuple(int(size) for size in sizes)


def _list(names):
    return ", ".join(map(repr, names)) or "none"

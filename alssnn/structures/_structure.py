"""The map from named parameters to Theta, and its derivative."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import prod
from typing import Any

import numpy as np

from ..activations import ACTIVATIONS
from ..lure import Lure
from ..shown import short_repr
from ._direct import product
from ._signals import ONE, Factor


@dataclass(frozen=True, eq=False)
class Structure:
    """Map named parameters to a Lur'e form and differentiate that map.

    Parameters
    ----------
    sizes : dict of str to int
        Length of every axis.
    inputs : tuple of str
        Axes that make up u; the first is the one that a controller moves.
    updates : dict of str to Signal
        Next value of every state.
    layers : dict of str to Signal
        What every axis of neurons sees, in the order of evaluation.
    signals : dict of str to Signal
        Signals that others refer to, or that can be observed; the first is the one
        that a record holds: the measured output.
    channels : tuple of str
        Signals that make up z.
    parameters : dict of str to tuple of str
        Axes of every free parameter, in the order of the flat vector theta.
    constants : dict of str to ndarray
        Fixed matrices that signals refer to, such as the output matrix C.
    constant_axes : dict of str to tuple of str
        Axes of the constants, for the change of units.
    network_parameters : tuple of str
        Names of the parameters that belong to neural networks (weight decay).
    activations : dict of str to Activation
        Activation of the neuron axes; axes that are not named have tanh.
    options : dict
        Keyword arguments of `models.state_space` that declare it again, but for C.
    sampling : Sampling or None
        How derivatives became updates (`continuous.sampled`), if they did.
    free_starts : int
        Number of first states with a free initial value; others start at zero.
    """

    __repr__ = short_repr

    sizes: dict
    inputs: tuple
    updates: dict
    layers: dict
    signals: dict
    channels: tuple
    parameters: dict
    constants: dict = field(default_factory=dict)
    constant_axes: dict = field(default_factory=dict)
    network_parameters: tuple = ()
    activations: dict = field(default_factory=dict)
    options: dict = field(default_factory=dict)
    sampling: Any = None
    free_starts: int = 1

    # -- views of the same equations ---------------------------------------------

    @property
    def measured(self):
        """Return the signal that a record holds."""
        return next(iter(self.signals))

    @cached_property
    def given(self):
        """Return the columns of u that no controller moves, as an array."""
        if self.sampling is not None:
            return self.sampling.derivative.given
        further = range(self.sizes[self.inputs[0]], self.nu)
        return np.array([*self.options.get("disturbances", ()), *further], dtype=int)

    def observe(self, *names):
        """Return the structure with other channels.

        Parameters are the same; states and neurons that neither the channels nor the
        first state depend on are left out.

        Parameters
        ----------
        *names : str
            Signals that make up z.

        Returns
        -------
        structure : Structure
            The same equations, observed by these channels.

        Raises
        ------
        ValueError
            If the equations have no signal of a name.
        """
        for name in names:
            if name not in self.signals:
                raise ValueError(
                    f"Channels must be signals of the equations, which are "
                    f"{', '.join(self.signals)}, got {name!r}."
                )
        return replace(self, channels=names)

    def law(self):
        """Return the static map from (s, u) to the virtual input v.

        Its inputs are what v depends on: states or the measured output (the latter
        where v is a function of u alone), further inputs, and the first input last.

        Returns
        -------
        law : Structure
            A structure without states, whose parameters are those that v needs.

        Raises
        ------
        ValueError
            If the equations have no signal v.
        """
        plain = self.observe("v")
        given = (*self.updates, self.measured)
        seen = plain._reach({"v"}, {*self.inputs, *given})
        u, *others = self.inputs
        s = [axis for axis in (*given, *others) if axis in seen] or [self.measured]
        law = replace(plain, inputs=(*s, u), updates={})
        used = {name for _, t in law.terms for f in t.factors for name in f.names}
        return replace(
            law,
            parameters={k: v for k, v in self.parameters.items() if k in used},
            network_parameters=tuple(n for n in self.network_parameters if n in used),
        )

    def _reach(self, axes, given):
        """Return the axes that some depend on, up to those that are given."""
        equations = {**self.updates, **self.layers, **self.signals}
        reached, todo = set(), set(axes)
        while todo:
            axis = todo.pop()
            reached.add(axis)
            if axis not in given and axis in equations:
                todo |= {term.cols for term in equations[axis].terms} - reached
        return reached

    @cached_property
    def _needed(self):  # with the state of the linear model
        return self._reach({*self.channels, *list(self.updates)[:1]}, self.inputs)

    @cached_property
    def states(self):
        """Return the axes that make up x."""
        return tuple(axis for axis in self.updates if axis in self._needed)

    @cached_property
    def neurons(self):
        """Return the axes that make up w, those of v first: u may be solved for."""
        law = self._reach({"v"}, {*self.inputs, *self.updates})
        order = sorted(self.layers, key=lambda axis: axis not in law)  # stable
        return tuple(axis for axis in order if axis in self._needed)

    @cached_property
    def terms(self):
        """Return what Theta is the sum of: pairs of an axis of rows and a term.

        Other signals are put in their place, so that the columns are states, inputs,
        neurons and the constant one.

        Returns
        -------
        terms : tuple of tuple
            The pairs.

        Raises
        ------
        ValueError
            If a signal contains itself, a neuron sees itself or a later one, or an
            axis is unknown.
        """
        columns, found = {*self.states, *self.inputs, ONE}, {}

        def expand(signal, path):
            terms = []
            for term in signal.terms:
                if term.cols in columns:
                    terms.append(term)
                elif term.cols in self.signals and term.cols not in path:
                    if term.cols not in found:
                        inner = self.signals[term.cols]
                        found[term.cols] = expand(inner, (*path, term.cols))
                    terms += [part.within(term) for part in found[term.cols]]
                else:
                    raise ValueError(
                        "Signals must be made of states, inputs, earlier neurons and "
                        f"other signals, got {' <- '.join((*path, term.cols))}: an "
                        "algebraic loop, or an axis without an equation."
                    )
            return terms

        rows = []
        for axes, equations in (
            (self.neurons, self.layers),
            (self.states, self.updates),
            (self.channels, self.signals),
        ):
            for axis in axes:
                rows += [(axis, term) for term in expand(equations[axis], (axis,))]
                columns |= {axis} & set(self.neurons)  # for those behind them
        return tuple(rows)

    def leading(self, term):
        """Return the parameter that a term begins with.

        Parameters
        ----------
        term : Term
            A term.

        Returns
        -------
        name : str or None
            Its name; None for a term that begins otherwise.
        """
        if term.factors and type(term.factors[0]) is Factor:
            name = term.factors[0].name
            return name if name in self.parameters else None
        return None

    @cached_property
    def rows(self):
        """Return the rows of Theta of every axis, as slices."""
        return self._places(self.states + self.channels + self.neurons)

    @cached_property
    def cols(self):
        """Return the columns of Theta of every axis, as slices."""
        return self._places((*self.states, *self.inputs, *self.neurons, ONE))

    def _places(self, axes):
        return _slices(axes, [self._size(axis) for axis in axes])

    def _size(self, axis):
        return 1 if axis == ONE else self.sizes[axis]

    def _total(self, axes):
        return sum(self.sizes[axis] for axis in axes)

    @property
    def nx(self):
        """Return the number of states of the Lur'e form."""
        return self._total(self.states)

    @property
    def n_x0(self):
        """Return the number of free initial states."""
        free = list(self.updates)[: self.free_starts]
        return self._total(axis for axis in self.states if axis in free)

    def initial_state(self, x0):
        """Return the state of the Lur'e form for a free initial state.

        Parameters
        ----------
        x0 : ndarray of shape (n_x0,)
            Initial values that are free; others are zero.

        Returns
        -------
        x : ndarray of shape (nx,)
            Initial state.
        """
        return np.concatenate([x0, np.zeros(self.nx - len(x0))])

    @property
    def nu(self):
        """Return the number of inputs."""
        return self._total(self.inputs)

    @property
    def nz(self):
        """Return the number of channels."""
        return self._total(self.channels)

    @property
    def nw(self):
        """Return the number of neurons."""
        return self._total(self.neurons)

    @cached_property
    def sigma(self):
        """Return the activation of every neuron."""
        return tuple(
            self.activation(axis)
            for axis in self.neurons
            for _ in range(self.sizes[axis])
        )

    def activation(self, axis):
        """Return the activation of an axis of neurons.

        Parameters
        ----------
        axis : str
            Axis of neurons.

        Returns
        -------
        activation : Activation
            That of `activations`, tanh if it is not named there.
        """
        return self.activations.get(axis, ACTIVATIONS["tanh"])

    @cached_property
    def shapes(self):
        """Return the shape of every parameter."""
        return {
            name: tuple(self.sizes[axis] for axis in axes)
            for name, axes in self.parameters.items()
        }

    @cached_property
    def slices(self):
        """Return the place of every parameter in theta, as slices."""
        return _slices(self.shapes, map(prod, self.shapes.values()))

    @cached_property
    def n_params(self):
        """Return the length of theta."""
        return max((s.stop for s in self.slices.values()), default=0)

    # -- theta <-> named parameters ----------------------------------------------

    def split(self, theta):
        """Return the named parameters in theta, as views.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Flat parameters.

        Returns
        -------
        p : dict of str to ndarray
            Parameters by name.
        """
        return {
            name: theta[where].reshape(self.shapes[name])
            for name, where in self.slices.items()
        }

    def join(self, p):
        """Return theta for named parameters; missing names are zero.

        Parameters
        ----------
        p : dict of str to array_like
            Parameters by name; names that the structure does not have are ignored.

        Returns
        -------
        theta : ndarray of shape (n_params,)
            Flat parameters.
        """
        theta = np.zeros(self.n_params)
        for name, where in self.slices.items():
            if name in p:
                theta[where] = np.reshape(p[name], -1)
        return theta

    def by_axis(self, scales):
        """Complete the units of signals by those of the axes that are parts of u.

        Parameters
        ----------
        scales : dict of str to ndarray
            New units over old ones, such as ``{"u": su, "y": sy}``.

        Returns
        -------
        scales : dict of str to ndarray
            The same, of every input, and of what is "moved" of u and what is not, "d".
        """
        if "u" not in scales:
            return scales
        of_u, parts = scales["u"], self._places(self.inputs)
        parts = {a: of_u[w] for a, w in parts.items() if w.stop <= len(of_u)}
        given = self.given[self.given < len(of_u)]  # a predictor has more inputs
        return {"moved": np.delete(of_u, given), "d": of_u[given], **scales, **parts}

    def rescale(self, p, scales):
        """Change the units of parameters and constants.

        A matrix that maps axis b to axis a has the units of a over those of b; an
        axis "per_a" has one over those of a.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters (and constants) by name.
        scales : dict of str to ndarray
            New units over old units of signals (`by_axis`); axes that are not named
            keep their units.

        Returns
        -------
        p : dict of str to ndarray
            Parameters in the new units.
        """
        axes_of = {**self.constant_axes, **self.parameters}
        scales = self.by_axis(scales)
        scales = {**scales, **{f"per_{a}": 1.0 / scale for a, scale in scales.items()}}
        out = {}
        for name, value in p.items():
            axes = axes_of[name]
            value = value * np.reshape(
                scales.get(axes[0], 1.0), (-1,) + (1,) * (value.ndim - 1)
            )
            if len(axes) == 2:
                value = value / scales.get(axes[1], 1.0)
            out[name] = value
        return out

    # -- theta -> Lur'e, and its derivative ------------------------------------

    def lure(self, theta):
        """Return the Lur'e form at theta.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Flat parameters, real or complex.

        Returns
        -------
        lure : Lure
            The model (eq. lure).
        """
        p = {**self.constants, **self.split(theta)}
        q = self.nx + self.nu + self.nw + 1
        Theta = np.zeros((self.nx + self.nz + self.nw, q), dtype=theta.dtype)
        for axis, term in self.terms:
            block = Theta[self.rows[axis], self.cols[term.cols]]
            value = product(factor.value(p) for factor in term.factors)
            block += term.gain * (np.eye(len(block)) if value is None else value)
        return Lure(Theta, self.nx, self.nu, self.nw, self.sigma)


def _slices(names, lengths):
    """Return the places of what stands in a row, as slices by name."""
    start, places = 0, {}
    for name, length in zip(names, lengths, strict=True):
        places[name] = slice(start, start + int(length))
        start += int(length)
    return places

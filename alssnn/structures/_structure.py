"""The map from named parameters to Theta, and its derivative."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..activations import ACTIVATIONS
from ..lure import Lure
from ..networks import ONE, AtRest
from ._direct import Products


@dataclass(frozen=True, eq=False)
class Structure:
    """Map named parameters to a Lur'e form and differentiate that map.

    Parameters
    ----------
    sizes : dict of str to int
        Length of every axis.
    states, channels, neurons : tuple of str
        Axes that make up x, z and w. The first state axis is the one whose
        initial value is free; the others start at zero.
    parameters : dict of str to tuple of str
        Axes of every free parameter, in the order of the flat vector theta.
    terms : tuple of Term
        Contributions to Theta.
    constants : dict of str to ndarray
        Fixed matrices that terms refer to, such as the output matrix C.
    constant_axes : dict of str to tuple of str
        Axes of the constants, for the change of units.
    network_parameters : tuple of str
        Names of the parameters that belong to neural networks (weight decay).
    activations : dict of str to Activation
        Activation of the neuron axes; axes that are not named have tanh.
    options : dict
        Keyword arguments of `state_space_structure` that declare it again, but for C.
    """

    sizes: dict
    states: tuple
    channels: tuple
    neurons: tuple
    parameters: dict
    terms: tuple
    constants: dict = field(default_factory=dict)
    constant_axes: dict = field(default_factory=dict)
    network_parameters: tuple = ()
    activations: dict = field(default_factory=dict)
    options: dict = field(default_factory=dict)

    # -- sizes and places --------------------------------------------------------

    @cached_property
    def rows(self):
        """Return the rows of Theta of every axis, as slices."""
        return self._slices(self.states + self.channels + self.neurons)

    @cached_property
    def cols(self):
        """Return the columns of Theta of every axis, as slices."""
        return self._slices((*self.states, "u", *self.neurons, ONE))

    def _slices(self, axes):
        stops = np.cumsum([self._size(axis) for axis in axes])
        return {
            axis: slice(int(stop) - self._size(axis), int(stop))
            for axis, stop in zip(axes, stops, strict=True)
        }

    def _size(self, axis):
        return 1 if axis == ONE else self.sizes[axis]

    @property
    def nx(self):
        """Return the number of states of the Lur'e form."""
        return sum(self.sizes[axis] for axis in self.states)

    @property
    def n_x0(self):
        """Return the number of free initial states."""
        return self.sizes[self.states[0]]

    def initial_state(self, x0):
        """Return the state of the Lur'e form for a free initial state.

        Parameters
        ----------
        x0 : ndarray of shape (n_x0,)
            Initial value of the first state axis; the others start at zero.

        Returns
        -------
        x : ndarray of shape (nx,)
            Initial state.
        """
        return np.concatenate([x0, np.zeros(self.nx - len(x0))])

    @property
    def nu(self):
        """Return the number of inputs."""
        return self.sizes["u"]

    @property
    def nz(self):
        """Return the number of channels."""
        return sum(self.sizes[axis] for axis in self.channels)

    @property
    def nw(self):
        """Return the number of neurons."""
        return sum(self.sizes[axis] for axis in self.neurons)

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
        stops = np.cumsum([int(np.prod(s)) for s in self.shapes.values()])
        starts = [0, *stops[:-1]]
        return {
            name: slice(int(start), int(stop))
            for name, start, stop in zip(self.shapes, starts, stops, strict=True)
        }

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

    def rescale(self, p, scales):
        """Change the units of parameters and constants.

        A matrix that maps axis b to axis a has the units of a over those of b.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters (and constants) by name.
        scales : dict of str to ndarray
            New units over old units of the signals of an axis, such as
            ``{"u": su, "y": sy}``; axes that are not named keep their units.

        Returns
        -------
        p : dict of str to ndarray
            Parameters in the new units.
        """
        axes_of = {**self.constant_axes, **self.parameters}
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

    # -- theta -> Lur'e ----------------------------------------------------------

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
        p = self.split(theta)
        q = self.nx + self.nu + self.nw + 1
        Theta = np.zeros((self.nx + self.nz + self.nw, q), dtype=theta.dtype)
        for term in self.terms:
            block = Theta[self.rows[term.rows], self.cols[term.cols]]
            block += _product([self._value(factor, p) for factor in term.factors])
        return Lure(Theta, self.nx, self.nu, self.nw, self.sigma)

    def _value(self, factor, p):
        """Return the matrix of a factor; vectors stand as one column."""
        if isinstance(factor, AtRest):
            return factor.value(p)
        value = p[factor] if factor in p else self.constants[factor]
        return value[:, None] if value.ndim == 1 else value

    # -- derivative ----------------------------------------------------------------

    def direct(self, p, scale):
        """Return the direct derivative of [x+; z] (eq. sens) as products.

        Direct means: at fixed states, so without the path through earlier samples.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name.
        scale : ndarray of shape (nx + nz,)
            Weight of every row.

        Returns
        -------
        direct : Direct
            What holds at all samples; the kernel makes the rest.
        """
        products = Products(scale, self.nw, self.nx + self.nu + self.nw + 1)
        for term in self.terms:
            rows, cols = self.rows[term.rows], self.cols[term.cols]
            values = [self._value(factor, p) for factor in term.factors]
            for i, factor in enumerate(term.factors):
                before = _product(values[:i]) if i else None
                if isinstance(factor, AtRest):
                    signal = products.signal(cols, None)  # the constant 1 of phi
                    for name, jacobian in factor.jacobian(p).items():
                        gain = jacobian if before is None else before @ jacobian
                        products.add(rows, self.slices[name], gain, signal)
                elif factor in p:
                    after = values[i + 1 :]
                    signal = products.signal(cols, _product(after) if after else None)
                    products.add(rows, self.slices[factor], before, signal)
        return products.direct()


def _product(matrices):
    value = matrices[0]
    for matrix in matrices[1:]:
        value = value @ matrix
    return value

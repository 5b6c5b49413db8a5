"""Structures: maps from named parameters to the Lur'e form.

A structure is declared, not programmed.  It consists of

    sizes       axis name -> length; an axis is a block of rows or columns of Theta
    states, channels, neurons   which axes make up x, z and w, in order
    parameters  name -> axes, for example  B: ("x", "u"),  b_y: ("w_h",)
    terms       Term(rows, cols, left, right):  Theta[rows, cols] += left @ right

and everything else follows: the flat vector theta, Theta itself, its derivative,
the change of units.  The factors of a term are parameters, constants, or a
parameter under an elementwise function (for a bias tied so that g vanishes at the
operating point).  The derivative of a term is the product rule.  Acting on the
regressor phi of one sample (see `simulation`), a term contributes

    left @ right @ phi[cols]

so that the derivative by left[i, j] is  e_i (right @ phi[cols])[j]  and the one by
right[j, l] is  left[:, j] phi[cols][l]  (eq. sens).  `add_direct` writes these for
many samples at once; nothing ever forms d Theta / d theta as a dense array.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .kernels import add_diagonal, add_outer_products
from .lure import Lure
from .networks import NETWORK_AXES, ONE, Factor, Term, network_g, network_h


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
            block += self._product(term, p)
        return Lure(Theta, self.nx, self.nu, self.nw)

    def _product(self, term, p):
        left = self._value(term.left, p)
        return left if term.right is None else left @ self._value(term.right, p)

    def _value(self, factor, p):
        """Return the matrix of a factor; vectors stand as one column."""
        raw = p[factor.name] if factor.name in p else self.constants[factor.name]
        value = factor.function(raw)
        return value[:, None] if value.ndim == 1 else value

    # -- derivative ----------------------------------------------------------------

    def add_direct(self, p, Phi, WR, scale, out):
        """Add the direct derivative of [x+; z] to `out` (eq. sens).

        Direct means: at fixed states, so without the path through earlier samples.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name.
        Phi : ndarray of shape (L, nx + nu + nw + 1)
            Regressors of L samples.
        WR : ndarray of shape (L, nx + nz, nw)
            Derivative of [x+; z] by the neurons' inputs v, scaled like the rows.
        scale : ndarray of shape (nx + nz,)
            Weight of every row.
        out : ndarray of shape (L, nx + nz, >= n_params)
            Added to in place; trailing columns are left alone.

        Notes
        -----
        Costs O(L (nx + nz) n_inner) for the n_inner parameters inside tanh and
        O(L n_nonzero) for the others.
        """
        n_rows = self.nx + self.nz
        for term in self.terms:
            rows, phi = self.rows[term.rows], Phi[:, self.cols[term.cols]]
            if rows.start >= n_rows:  # inside tanh: moves every row
                gain = WR[:, :, rows.start - n_rows : rows.stop - n_rows]
                self._add_inner(term, p, phi, gain, out)
            else:
                self._add_outer(term, p, phi, scale[rows], out[:, rows])

    def _add_inner(self, term, p, phi, gain, out):
        """Add the derivative of a term in rows of v, which act through `gain`."""
        left, right = term.left, term.right
        if left.name in p:
            signal = phi if right is None else phi @ self._value(right, p).T
            self._add_products(left, p, gain, signal, out)
        if right is not None and right.name in p:
            self._add_products(right, p, gain @ self._value(left, p), phi, out)

    def _add_outer(self, term, p, phi, scale, out):
        """Add the derivative of a term in rows of x+ or z; `out` holds its rows."""
        left, right = term.left, term.right
        if left.name in p:  # left[i, j] moves row i alone
            signal = phi if right is None else phi @ self._value(right, p).T
            slope = np.broadcast_to(left.slope(p), signal.shape[1])
            gain = scale[:, None] * slope
            add_diagonal(gain, signal, self._columns(out, left))
        if right is not None and right.name in p:
            gain = scale[:, None] * self._value(left, p)
            gain = np.broadcast_to(gain, (len(out), *gain.shape))
            self._add_products(right, p, gain, phi, out)

    def _add_products(self, factor, p, gain, signal, out):
        if factor.derivative is not None:
            gain = gain * factor.slope(p)
        add_outer_products(gain, signal, self._columns(out, factor))

    def _columns(self, out, factor):
        return out[:, :, self.slices[factor.name]]


def state_space_structure(
    nx,
    nu,
    ny,
    *,
    n_h=0,
    n_g=0,
    C=None,
    feedback="output",
    penalty=None,
    penalize_h=False,
    tied_bias=True,
):
    """Return the structure x+ = A x + B (u + h(s)) + g(x, u), y = C x.

    Parameters
    ----------
    nx, nu, ny : int
        Number of states, inputs and outputs.
    n_h, n_g : int, default=0
        Hidden neurons of h and g; zero leaves the network out.
    C : ndarray of shape (ny, nx) or None, default=None
        Fixed output matrix; None makes it a free parameter (linear models only).
    feedback : {"output", "state"}, default="output"
        What h sees: s = y or s = x.
    penalty : {"state", "output"} or None, default=None
        Channel next to y: g itself, or the output-referred residual e (eq. gauge),
        for which the states are (x, zeta). None for simulation alone. The flat
        vector theta does not depend on it.
    penalize_h : bool, default=False
        Whether h, if there is one, is a channel, too (eq. split).
    tied_bias : bool, default=True
        Whether the output bias of g is tied so that g(0, 0) = 0; else it is free.

    Returns
    -------
    structure : Structure
        The map from parameters to the Lur'e form (eq. model).

    Raises
    ------
    ValueError
        If C is free in a model with networks.
    """
    if C is None and (n_h or n_g):
        raise ValueError("`C` must be given for a model with networks, got None.")
    sizes = {"x": nx, "u": nu, "y": ny}
    states, channels, neurons = ["x"], ["y"], []
    parameters: dict[str, tuple[str, ...]] = {"A": ("x", "x"), "B": ("x", "u")}
    terms = [
        Term("x", "x", Factor("A")),
        Term("x", "u", Factor("B")),
        Term("y", "x", Factor("C")),
    ]
    constants, constant_axes = {}, {}
    if C is None:
        parameters["C"] = ("y", "x")
    else:
        constants, constant_axes = {"C": np.array(C, float)}, {"C": ("y", "x")}
    linear = tuple(parameters)
    if n_h:
        sizes[NETWORK_AXES["h"]] = n_h
        neurons.append(NETWORK_AXES["h"])
        if penalize_h:
            sizes["h"] = nu
            channels.append("h")
        more, new = network_h(feedback, channel=penalize_h)
        parameters |= more
        terms += new
    if n_g:
        sizes[NETWORK_AXES["g"]] = n_g
        neurons.append(NETWORK_AXES["g"])
        rows = ["x"]
        if penalty == "state":
            sizes["g"] = nx
            channels.append("g")
            rows.append("g")
        elif penalty == "output":  # zeta+ = A zeta + g, e = C zeta
            sizes |= {"zeta": nx, "e": ny}
            states.append("zeta")
            channels.append("e")
            rows.append("zeta")
            terms.append(Term("zeta", "zeta", Factor("A")))
            terms.append(Term("e", "zeta", Factor("C")))
        more, new = network_g(rows, tied_bias=tied_bias)
        parameters |= more
        terms += new
    return Structure(
        sizes=sizes,
        states=tuple(states),
        channels=tuple(channels),
        neurons=tuple(neurons),
        parameters=parameters,
        terms=tuple(terms),
        constants=constants,
        constant_axes=constant_axes,
        network_parameters=tuple(n for n in parameters if n not in linear),
    )

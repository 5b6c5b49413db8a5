"""The Lur'e form: the one shape that every model takes.

A model with state x (nx), input u (nu), channels z (nz) and neurons w (nw) is

    [x+]           [x]
    [z ] = Theta * [u]        w = sigma(v)                             (eq. lure)
    [v ]           [w]
                   [1]

with the blocks of the design equations as sub-matrices of the one array `Theta`:

              x    u    w   1
    x+, z  [  M        | W | c ]
    v      [  V        | E | b ]

The regressor phi = [x; u; w; 1] and the matrix Theta are all that simulation,
sensitivities and linearization need to know.  `z` stacks the output y and every
signal that the cost penalizes.  E couples layers of neurons and is block lower
triangular, so that w can be evaluated layer by layer; it is zero for one hidden layer.
sigma acts elementwise, one activation per neuron.  The blocks on the diagonal are zero
for every model that is trained.

A feedback u = v - K w - k turns one Lur'e form into another (`Plant.close`):
cancelling h couples the neurons of g to those of h, and where neurons of h see u they
see themselves.  Such a layer is solved (`implicit`).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .activations import ACTIVATIONS
from .implicit import ImplicitLayer
from .shown import short_repr


@dataclass(frozen=True, eq=False)
class Lure:
    """Hold the matrix of a Lur'e form and name its blocks.

    Parameters
    ----------
    Theta : ndarray of shape (nx + nz + nw, nx + nu + nw + 1)
        Stacked matrix (eq. lure), real, or complex for complex-step tests.
    nx : int
        Number of states.
    nu : int
        Number of inputs.
    nw : int
        Number of neurons.
    sigma : tuple of Activation, default=()
        Activation of every neuron; empty means tanh for all.

    Raises
    ------
    ValueError
        If the number of columns of `Theta` does not fit.
    """

    __repr__ = short_repr

    Theta: np.ndarray
    nx: int
    nu: int
    nw: int
    sigma: tuple = ()

    def __post_init__(self):
        """Check the shape of `Theta`."""
        if not self.sigma:
            object.__setattr__(self, "sigma", (ACTIVATIONS["tanh"],) * self.nw)
        expected = self.nx + self.nu + self.nw + 1
        if self.Theta.ndim != 2 or self.Theta.shape[1] != expected:
            raise ValueError(
                f"`Theta` must have {expected} columns for nx={self.nx}, "
                f"nu={self.nu}, nw={self.nw}, got shape {self.Theta.shape}."
            )

    @property
    def nz(self):
        """Return the number of channels."""
        return len(self.Theta) - self.nx - self.nw

    @property
    def rows_x(self):
        """Return the rows that make x+, shape (nx, n_columns)."""
        return self.Theta[: self.nx]

    @property
    def rows_z(self):
        """Return the rows that make the channels, shape (nz, n_columns)."""
        return self.Theta[self.nx : self.nx + self.nz]

    @property
    def rows_v(self):
        """Return the rows that make what neurons see, shape (nw, n_columns)."""
        return self.Theta[self.nx + self.nz :]

    @property
    def M(self):
        """Return the linear part, shape (nx + nz, nx + nu)."""
        return self.Theta[: self.nx + self.nz, : self.nx + self.nu]

    @property
    def W(self):
        """Return the output weights of the neurons, shape (nx + nz, nw)."""
        return self.Theta[: self.nx + self.nz, self.nx + self.nu : -1]

    @property
    def c(self):
        """Return the constant part, shape (nx + nz,)."""
        return self.Theta[: self.nx + self.nz, -1]

    @property
    def V(self):
        """Return the input weights of the neurons, shape (nw, nx + nu)."""
        return self.Theta[self.nx + self.nz :, : self.nx + self.nu]

    @property
    def E(self):
        """Return the weights between neurons, shape (nw, nw)."""
        return self.Theta[self.nx + self.nz :, self.nx + self.nu : -1]

    @property
    def b(self):
        """Return the biases of the neurons, shape (nw,)."""
        return self.Theta[self.nx + self.nz :, -1]

    @cached_property
    def layers(self):
        """Return the layers of neurons, as slices: one activation each.

        Returns
        -------
        layers : list of slice
            The layers in the order of evaluation. The neurons of one do not see each
            other, unless it is one of `implicit`.
        """
        row, column = np.nonzero(self.E)
        # the last that a neuron sees of those before it, and of itself and those behind
        parts = column < row, column >= row
        before, last = np.full((2, self.nw), -1)
        for end, part in zip((before, last), parts, strict=True):
            np.maximum.at(end, row[part], column[part])
        before, last = before.tolist(), last.tolist()
        layers, start = [], 0
        while start < self.nw:
            stop = start + 1
            if last[start] >= start:  # solved together with all that it sees
                while max(last[start:stop]) >= stop:
                    stop = max(last[start:stop]) + 1
            else:
                while (
                    stop < self.nw
                    and last[stop] < stop
                    and self.sigma[stop] is self.sigma[start]
                    and before[stop] < start
                ):
                    stop += 1
            layers.append(slice(start, stop))
            start = stop
        return layers

    @cached_property
    def seen(self):
        """Return what the neurons of every layer see of those before it, as slices.

        Returns
        -------
        seen : list of slice
            The least that holds them all, for each of `layers`; empty if it sees none.
        """
        seen = []
        for layer in self.layers:
            columns = np.flatnonzero(np.any(self.E[layer, : layer.start], axis=0))
            seen.append(
                slice(int(columns[0]) if len(columns) else layer.start, layer.start)
            )
        return seen

    @cached_property
    def implicit(self):
        """Return the layers that see themselves.

        Returns
        -------
        implicit : dict of int to ImplicitLayer
            The layers, by the number of their first neuron.
        """
        blocks = {layer.start: self.E[layer, layer] for layer in self.layers}
        return {
            start: ImplicitLayer(E, self.sigma[start])
            for start, E in blocks.items()
            if np.any(E)
        }

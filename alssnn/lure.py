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
signal that the cost penalizes.  E couples layers of neurons and is strictly lower
triangular, so that w can be evaluated in order; it is zero for one hidden layer.
sigma acts elementwise, one activation per neuron.

A feedback u = v - K w - k turns one Lur'e form into another (`Plant.close`):
cancelling h couples the neurons of g to those of h.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .activations import ACTIVATIONS


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
        If the number of columns of `Theta` does not fit, or a neuron depends on
        itself or a later one.
    """

    Theta: np.ndarray
    nx: int
    nu: int
    nw: int
    sigma: tuple = ()

    def __post_init__(self):
        """Check the shape of `Theta` and the order of the neurons."""
        if not self.sigma:
            object.__setattr__(self, "sigma", (ACTIVATIONS["tanh"],) * self.nw)
        expected = self.nx + self.nu + self.nw + 1
        if self.Theta.ndim != 2 or self.Theta.shape[1] != expected:
            raise ValueError(
                f"`Theta` must have {expected} columns for nx={self.nx}, "
                f"nu={self.nu}, nw={self.nw}, got shape {self.Theta.shape}."
            )
        if np.any(np.triu(self.E)):
            raise ValueError(
                "`Theta` must have a strictly lower triangular block E, got a neuron "
                "that depends on itself or a later one. Order the layers."
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
        """Return the layers of neurons, as slices: no coupling, one activation each."""
        starts = [0] if self.nw else []
        for i in range(1, self.nw):
            other = self.sigma[i] is not self.sigma[i - 1]
            if other or np.any(self.E[i, starts[-1] : i]):
                starts.append(i)
        stops = [*starts[1:], self.nw]
        return [slice(a, b) for a, b in zip(starts, stops, strict=False)]

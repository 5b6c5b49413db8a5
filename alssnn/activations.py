"""Activations: the scalar functions of the neurons, with what others must know.

Simulation needs the value, sensitivities the derivative, certificates the bounds:

    slope[0] <= sigma'(v) <= slope[1]     for all v      (multipliers, eq. slopes)
    |sigma(v)| <= bound                   for all v      (the global bound of g)

The shipped members have a code, by which compiled kernels know them; a user's own
activation has none and is simulated by the NumPy kernel.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

# Codes of the compiled kernels.
TANH, SIGMOID, RELU, IDENTITY, SIN, OTHER = range(6)


@dataclass(frozen=True)
class Activation:
    """Hold an activation function and its bounds.

    Parameters
    ----------
    name : str
        Name, for the display of estimators.
    value : callable
        Elementwise function of an array of real numbers.
    derivative : callable
        ``derivative(v, w)``: its derivative at v, where ``w = value(v)`` is known.
    slope : tuple of float
        Smallest and largest derivative.
    bound : float, default=inf
        Largest absolute value.
    odd : bool, default=False
        Whether ``value(-v) == -value(v)``.
    code : int, default=OTHER
        Code of a compiled twin; only shipped activations have one.

    Examples
    --------
    >>> softsign = alssnn.Activation(
    ...     "softsign",
    ...     lambda v: v / (1 + abs(v)),
    ...     lambda v, w: (1 - abs(w)) ** 2,
    ...     slope=(0, 1),
    ...     bound=1,
    ...     odd=True,
    ... )
    >>> model = alssnn.FlSsnn(nx=2, n_h=4, activation=softsign)
    """

    name: str
    value: Callable
    derivative: Callable
    slope: tuple[float, float]
    bound: float = np.inf
    odd: bool = False
    code: int = OTHER

    def __reduce__(self):
        """Pickle a shipped activation by its name, for its functions have none."""
        if ACTIVATIONS.get(self.name) is self:
            return as_activation, (self.name,)
        return super().__reduce__()

    def __repr__(self):
        """Return the name: functions have no readable representation."""
        return f"Activation({self.name!r})"


def _sigmoid(v):
    return 0.5 * (1.0 + np.tanh(0.5 * v))  # no overflow, and complex-step safe


ACTIVATIONS = {
    activation.name: activation
    for activation in (
        Activation(
            "tanh", np.tanh, lambda v, w: 1.0 - w**2, (0, 1), 1.0, odd=True, code=TANH
        ),
        Activation(
            "sigmoid",
            _sigmoid,
            lambda v, w: w * (1.0 - w),
            (0, 0.25),
            1.0,
            code=SIGMOID,
        ),
        Activation(
            "relu",
            lambda v: v * (np.real(v) > 0),
            lambda v, w: 1.0 * (np.real(v) > 0),
            (0, 1),
            code=RELU,
        ),
        Activation(
            "identity",
            lambda v: +v,
            lambda v, w: np.ones_like(v),
            (1, 1),
            odd=True,
            code=IDENTITY,
        ),
        Activation(
            "sin", np.sin, lambda v, w: np.cos(v), (-1, 1), 1.0, odd=True, code=SIN
        ),
    )
}


def as_activation(activation):
    """Return the activation of a name.

    Parameters
    ----------
    activation : str or Activation
        Name of a shipped activation, or one of the user's.

    Returns
    -------
    activation : Activation
        The activation.

    Raises
    ------
    ValueError
        If the name is unknown, or it is neither a name nor an activation.
    """
    if isinstance(activation, Activation):
        return activation
    if isinstance(activation, str) and activation in ACTIVATIONS:
        return ACTIVATIONS[activation]
    names = ", ".join(map(repr, ACTIVATIONS))
    raise ValueError(
        f"`activation` must be one of {names} or an `alssnn.Activation`, got "
        f"{activation!r}."
    )

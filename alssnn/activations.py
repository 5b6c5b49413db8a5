"""Activations: the scalar functions of the neurons, with what others must know.

Simulation needs the value, sensitivities the derivative, certificates the bounds:

    slope[0] <= sigma'(v) <= slope[1]     for all v      (multipliers, eq. slopes)
    |sigma(v)| <= bound                   for all v      (the global bound of g)

Exports need one expression per language (`Activation.expression`).  What stands here
of an activation is all there is: nothing else in the package knows one by its name.
The shipped members have a code, by which compiled kernels know them; a user's own
activation has none and is simulated by the NumPy kernel.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

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
    slope_range : callable or None, default=None
        ``slope_range(low, high)``: smallest and largest derivative over intervals,
        arrays of any shape. None means `slope` wherever the neuron is, and then local
        certificates say less.
    odd : bool, default=False
        Whether ``value(-v) == -value(v)``.
    code : int, default=OTHER
        Code of a compiled twin; only shipped activations have one.
    expressions : dict of str to str, default={}
        The value in the languages of exports, where ``{v}`` stands for the argument.
        "c" is an expression of C99 with ``math.h``, and ``{f}`` the suffix of functions
        and numbers in single precision; "c_slope" is the derivative in C, where ``{w}``
        stands for the value, taken by differences if it is missing; "matlab" is an
        elementwise expression, "casadi" one of functions of CasADi; "onnx" is the name
        of an operator; "st" is an expression of Structured Text, where ``{t}`` begins
        literals and ``{p}`` the names of functions (``{p}tanh`` is one); "modelica" is
        an expression of Modelica; "matlab_slope", "st_slope" and "modelica_slope" are
        as "c_slope".

    Examples
    --------
    >>> softsign = alssnn.Activation(
    ...     "softsign",
    ...     lambda v: v / (1 + abs(v)),
    ...     lambda v, w: (1 - abs(w)) ** 2,
    ...     slope=(0, 1),
    ...     bound=1,
    ...     odd=True,
    ...     expressions={
    ...         "c": "{v} / (1.0{f} + fabs{f}({v}))",
    ...         "casadi": "{v} / (1 + fabs({v}))",
    ...         "matlab": "{v} ./ (1 + abs({v}))",
    ...         "onnx": "Softsign",
    ...     },
    ... )
    >>> model = alssnn.FlSsnn(nx=2, n_h=4, activation=softsign)
    """

    name: str
    value: Callable
    derivative: Callable
    slope: tuple[float, float]
    bound: float = np.inf
    slope_range: Callable | None = field(default=None, compare=False, kw_only=True)
    odd: bool = False
    code: int = OTHER
    expressions: dict[str, str] = field(default_factory=dict, compare=False)

    def slopes(self, low, high):
        """Return the smallest and the largest derivative over intervals.

        Parameters
        ----------
        low, high : ndarray
            Ends of the intervals, of one shape.

        Returns
        -------
        least, largest : ndarray
            Bounds of the derivative, of the same shape.
        """
        ranges = self.slope_range
        found = self.slope if ranges is None else ranges(low, high)
        return tuple(np.broadcast_to(bound, np.shape(low)) for bound in found)

    def expression(self, language, **blanks):
        """Return what computes the value in another language.

        Parameters
        ----------
        language : str
            Key of `expressions`, such as "c".
        **blanks : str
            What stands in the place of ``{v}`` and other blanks.

        Returns
        -------
        expression : str
            The expression.

        Raises
        ------
        ValueError
            If there is none in this language.
        """
        if language not in self.expressions:
            raise ValueError(
                f"`activation` must have an expression in {language!r} for this "
                f"export, got {self.name!r}, which has {sorted(self.expressions)}. "
                "Add it to the `expressions` of your Activation."
            )
        return self.expressions[language].format(**blanks)

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


def _bell(slope):
    """Return the range of a derivative that falls with the distance from zero."""

    def slope_range(low, high):
        far = np.maximum(np.abs(low), np.abs(high))
        near = np.maximum(np.maximum(low, -high), 0.0)  # zero lies between
        return slope(far), slope(near)

    return slope_range


def _cosine(low, high):
    """Return the range of the cosine: its extrema are the multiples of pi."""
    ends = np.cos(low), np.cos(high)

    def has(at):  # an integer in the interval, in turns
        turns = 2 * np.pi
        return np.floor((high - at) / turns) >= np.ceil((low - at) / turns)

    least = np.where(has(np.pi), -1.0, np.minimum(*ends))
    return least, np.where(has(0.0), 1.0, np.maximum(*ends))


ACTIVATIONS = {
    activation.name: activation
    for activation in (
        Activation(
            "tanh",
            np.tanh,
            lambda v, w: 1.0 - w**2,
            (0, 1),
            1.0,
            slope_range=_bell(lambda v: 1.0 - np.tanh(v) ** 2),
            odd=True,
            code=TANH,
            expressions={
                "c": "tanh{f}({v})",
                "c_slope": "1.0{f} - {w} * {w}",
                "casadi": "tanh({v})",
                "matlab": "tanh({v})",
                "matlab_slope": "1 - {w} .^ 2",
                "modelica": "tanh({v})",
                "modelica_slope": "1.0 - {w} * {w}",
                "onnx": "Tanh",
                "st": "{p}tanh({v})",
                "st_slope": "{t}1.0 - {w} * {w}",
            },
        ),
        Activation(
            "sigmoid",
            _sigmoid,
            lambda v, w: w * (1.0 - w),
            (0, 0.25),
            1.0,
            slope_range=_bell(lambda v: _sigmoid(v) * _sigmoid(-v)),
            code=SIGMOID,
            expressions={
                "c": "0.5{f} * (1.0{f} + tanh{f}(0.5{f} * {v}))",
                "c_slope": "{w} * (1.0{f} - {w})",
                "casadi": "0.5 * (1 + tanh(0.5 * {v}))",
                "matlab": "0.5 * (1 + tanh(0.5 * {v}))",
                "matlab_slope": "{w} .* (1 - {w})",
                "modelica": "0.5 * (1.0 + tanh(0.5 * {v}))",
                "modelica_slope": "{w} * (1.0 - {w})",
                "onnx": "Sigmoid",
                "st": "{t}0.5 * ({t}1.0 + {p}tanh({t}0.5 * {v}))",
                "st_slope": "{w} * ({t}1.0 - {w})",
            },
        ),
        Activation(
            "relu",
            lambda v: v * (np.real(v) > 0),
            lambda v, w: 1.0 * (np.real(v) > 0),
            (0, 1),
            slope_range=lambda low, high: (1.0 * (low > 0), 1.0 * (high > 0)),
            code=RELU,
            # a NaN stays one
            expressions={
                "c": "{v} < 0 ? 0 : {v}",
                "c_slope": "{v} > 0 ? 1.0{f} : 0.0{f}",
                "casadi": "if_else({v} < 0, 0, {v})",
                "matlab": "max({v}, 0)",
                "matlab_slope": "double({v} > 0)",
                "modelica": "if {v} < 0.0 then 0.0 else {v}",
                "modelica_slope": "if {v} > 0.0 then 1.0 else 0.0",
                "onnx": "Relu",
                "st": "SEL({v} < {t}0.0, {v}, {t}0.0)",
                "st_slope": "SEL({v} > {t}0.0, {t}0.0, {t}1.0)",
            },
        ),
        Activation(
            "identity",
            lambda v: +v,
            lambda v, w: np.ones_like(v),
            (1, 1),
            odd=True,
            code=IDENTITY,
            expressions={
                "c": "{v}",
                "c_slope": "1.0{f}",
                "casadi": "{v}",
                "matlab": "{v}",
                "matlab_slope": "ones(size({v}))",
                "modelica": "{v}",
                "modelica_slope": "1.0",
                "onnx": "Identity",
                "st": "{v}",
                "st_slope": "{t}1.0",
            },
        ),
        Activation(
            "sin",
            np.sin,
            lambda v, w: np.cos(v),
            (-1, 1),
            1.0,
            slope_range=_cosine,
            odd=True,
            code=SIN,
            expressions={
                "c": "sin{f}({v})",
                "c_slope": "cos{f}({v})",
                "casadi": "sin({v})",
                "matlab": "sin({v})",
                "matlab_slope": "cos({v})",
                "modelica": "sin({v})",
                "modelica_slope": "cos({v})",
                "onnx": "Sin",
                "st": "SIN({v})",
                "st_slope": "COS({v})",
            },
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


def shipped_name(activation):
    """Return the name under which a file of `save` refers to an activation.

    Parameters
    ----------
    activation : Activation
        The activation.

    Returns
    -------
    name : str
        Its name.

    Raises
    ------
    ValueError
        If it is not one that is shipped.
    """
    if activation not in ACTIVATIONS.values():
        names = ", ".join(map(repr, ACTIVATIONS))
        raise ValueError(
            f"`activation` must be one of {names} for a file, got your own "
            f"{activation.name!r}: a file holds no code. Pickle the model, or fit it "
            "with an activation that is shipped."
        )
    return activation.name

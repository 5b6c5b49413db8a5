"""Networks: multilayer perceptrons as terms of the Lur'e form.

One hidden layer, tanh, linear output layer (eq. model):

    h(y)    = W_h tanh(W_y y + b_y) + b_h      or     h(x) = W_h tanh(W_s x + b_s) + b_h
    g(x, u) = W_g tanh(W_x x + W_u u + b_x) + b_g

In deviation variables the operating point is (x, u) = (0, 0), and the tied bias
b_g = -W_g tanh(b_x) makes g vanish there.

A network is a table of parameters (name -> axes) and a list of terms that add
`left @ right` to blocks of Theta; see `structures` for what is done with them.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

NETWORK_AXES = {"h": "w_h", "g": "w_g"}  # axis of the neurons of each network
ONE = "1"  # axis of length one: the column of Theta that carries the constants


def _identity(value):
    return value


def _minus_tanh(value):
    return -np.tanh(value)


def _minus_tanh_derivative(value):
    return np.tanh(value) ** 2 - 1.0


@dataclass(frozen=True)
class Factor:
    """Name a parameter or constant, possibly under an elementwise function.

    Parameters
    ----------
    name : str
        Parameter or constant.
    function, derivative : callable
        Elementwise function of a vector and its derivative; a derivative of None
        means one, and then `name` may be a matrix.
    """

    name: str
    function: Callable = _identity
    derivative: Callable | None = None

    def slope(self, p):
        """Return the derivative of the factor's value by the parameter.

        Parameters
        ----------
        p : dict of str to ndarray
            Parameters by name.

        Returns
        -------
        slope : float or ndarray
            Elementwise derivative, of the shape of the parameter.
        """
        return 1.0 if self.derivative is None else self.derivative(p[self.name])


@dataclass(frozen=True)
class Term:
    """Contribute ``left @ right`` to the block (rows, cols) of Theta.

    Parameters
    ----------
    rows, cols : str
        Axes of the block.
    left : Factor
        Left factor.
    right : Factor or None, default=None
        Right factor; None stands for the identity.
    """

    rows: str
    cols: str
    left: Factor
    right: Factor | None = None


def network_h(feedback, *, channel=False):
    """Return parameters and terms of the matched network B h(s).

    Parameters
    ----------
    feedback : {"output", "state"}
        What h sees: s = y = C x, or s = x.
    channel : bool, default=False
        Whether h is a channel of its own as well, to be penalized.

    Returns
    -------
    parameters : dict of str to tuple of str
        Axes of W_h, b_h and of W_y, b_y (output) or W_s, b_s (state).
    terms : list of Term
        Contributions to x+, the neurons' inputs and the channel.
    """
    w = NETWORK_AXES["h"]
    parameters: dict[str, tuple[str, ...]] = {"W_h": ("u", w), "b_h": ("u",)}
    terms = [
        Term("x", w, Factor("B"), Factor("W_h")),
        Term("x", ONE, Factor("B"), Factor("b_h")),
    ]
    if channel:
        terms += [Term("h", w, Factor("W_h")), Term("h", ONE, Factor("b_h"))]
    if feedback == "output":
        parameters |= {"W_y": (w, "y"), "b_y": (w,)}
        terms += [Term(w, "x", Factor("W_y"), Factor("C")), Term(w, ONE, Factor("b_y"))]
    else:
        parameters |= {"W_s": (w, "x"), "b_s": (w,)}
        terms += [Term(w, "x", Factor("W_s")), Term(w, ONE, Factor("b_s"))]
    return parameters, terms


def network_g(rows, *, tied_bias):
    """Return parameters and terms of the residual network g(x, u).

    Parameters
    ----------
    rows : sequence of str
        Axes that g is added to: the state and, if penalized, its channel.
    tied_bias : bool
        Whether b_g = -W_g tanh(b_x), so that g(0, 0) = 0; else b_g is free.

    Returns
    -------
    parameters : dict of str to tuple of str
        Axes of W_g, W_x, W_u, b_x and, if free, b_g.
    terms : list of Term
        Contributions to `rows` and to the neurons' inputs.
    """
    w = NETWORK_AXES["g"]
    parameters: dict[str, tuple[str, ...]] = {
        "W_g": ("x", w),
        "W_x": (w, "x"),
        "W_u": (w, "u"),
        "b_x": (w,),
    }
    terms = [
        Term(w, "x", Factor("W_x")),
        Term(w, "u", Factor("W_u")),
        Term(w, ONE, Factor("b_x")),
    ]
    if tied_bias:
        tied = Factor("b_x", _minus_tanh, _minus_tanh_derivative)
        bias = [Factor("W_g"), tied]
    else:
        parameters["b_g"] = ("x",)
        bias = [Factor("b_g")]
    for axis in rows:
        terms += [Term(axis, w, Factor("W_g")), Term(axis, ONE, *bias)]
    return parameters, terms


def evaluate_h(p, s):
    """Evaluate h(s) (eq. model); zero for a model without h.

    Parameters
    ----------
    p : dict of str to ndarray
        Parameters by name.
    s : ndarray of shape (N, ny) or (N, nx)
        Outputs (deviations in the units of `p`) or states, whatever h sees.

    Returns
    -------
    h : ndarray of shape (N, nu)
        Matched nonlinearity, in the units of u.
    """
    if "W_h" not in p:
        return np.zeros((len(s), p["B"].shape[1]))
    inner, bias = ("W_y", "b_y") if "W_y" in p else ("W_s", "b_s")
    return np.tanh(s @ p[inner].T + p[bias]) @ p["W_h"].T + p["b_h"]

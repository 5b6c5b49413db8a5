"""Further instances of equations: the same parameters, other signals.

One step of Runge and Kutta evaluates the derivative of the states four times, and a
prediction over several samples applies the model again to what it has predicted.  Each
of these is an instance of the same equations whose states and inputs are other
signals; neurons and named signals are its own, and the parameters are shared.
"""

from dataclasses import replace
from typing import NamedTuple

from .activations import ACTIVATIONS
from .structures import Signal


class Instance(NamedTuple):
    """Hold the equations of an instance, by the names that they have there.

    Parameters
    ----------
    updates : dict of str to Signal
        What the updates of the states are, by the names of the states of the structure.
    layers : dict of str to Signal
        What its neurons see.
    signals : dict of str to Signal
        Its named signals.
    sizes : dict of str to int
        Lengths of the axes that are its own.
    activations : dict of str to Activation
        Activations of its neurons.
    """

    updates: dict
    layers: dict
    signals: dict
    sizes: dict
    activations: dict


def instance(structure, tag, given):
    """Return the equations of a structure once more, of other signals.

    Parameters
    ----------
    structure : Structure
        Equations.
    tag : str
        What tells the names of this instance from others: "w_g" becomes "w_g@" + tag.
    given : dict of str to str
        Names of the signals that stand in the place of states, of inputs and, if they
        are not to be computed anew, of other signals.

    Returns
    -------
    instance : Instance
        The equations.
    """
    own = [name for name in (*structure.layers, *structure.signals)]
    names = {**{name: f"{name}@{tag}" for name in own}, **given}

    def renamed(signal):
        terms = (replace(t, cols=names.get(t.cols, t.cols)) for t in signal.terms)
        return Signal(signal.axes, signal.shape, tuple(terms))

    def its(equations):
        return {
            names[name]: renamed(value)
            for name, value in equations.items()
            if name not in given
        }

    return Instance(
        updates={axis: renamed(value) for axis, value in structure.updates.items()},
        layers=its(structure.layers),
        signals=its(structure.signals),
        sizes={names[name]: structure.sizes[name] for name in own},
        activations={
            names[axis]: structure.activation(axis)
            for axis in structure.layers
            if axis not in given
        },
    )


def passed_on(value, axis):
    """Return a signal as neurons that pass it on, so that it is computed once.

    Parameters
    ----------
    value : Signal
        Sum of terms.
    axis : str
        Name of the neurons.

    Returns
    -------
    layer : Signal
        What the neurons see, under their own axis; their activation is "identity".
    """
    return Signal((axis,), value.shape, value.terms)


IDENTITY = ACTIVATIONS["identity"]

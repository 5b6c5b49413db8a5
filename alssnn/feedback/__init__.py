"""From an identified model to a closed loop, with the objects of python-control.

    x+ = A x + B (u + h(s)) + g(x, u)        y = C x        u = v - h(s)   (eq. loop)

`dynamics` is the model one step at a time, `export` names the signals of systems, `law`
cancels h, `observer` estimates the state, `design` computes gains for (A, B, C),
`controller` gives them the operating point, `loop` connects all, with `algebraic` where
the plant has feedthrough, and `proposal` makes a first design and compares it with the
model.

python-control is imported in this package and nowhere else.  Its objects cannot be
pickled, so none is ever stored: they are built on demand.  Its axes are (signals,
time), ours (time, signals).
"""

from .controller import split_gain
from .design import linear_part, lqi, lqr, place, weigh_outputs
from .disturbance import DisturbanceObserver
from .dynamics import Dynamics, late_inputs
from .export import signal_names, to_statespace
from .law import LinearizingLaw
from .loop import closed_loop, designed_loop
from .observer import Observer
from .proposal import balanced_weights, input_range, step_comparison

__all__ = [
    "DisturbanceObserver",
    "Dynamics",
    "LinearizingLaw",
    "Observer",
    "balanced_weights",
    "closed_loop",
    "designed_loop",
    "input_range",
    "late_inputs",
    "linear_part",
    "lqi",
    "lqr",
    "place",
    "signal_names",
    "split_gain",
    "step_comparison",
    "to_statespace",
    "weigh_outputs",
]

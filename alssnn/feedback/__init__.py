"""From an identified model to a closed loop, with the objects of python-control.

    x+ = A x + B (u + h(s)) + g(x, u)        y = C x        u = v - h(s)   (eq. loop)

All of it works on a `Plant`; a fitted model is one by its `plant_`. `export` makes
systems with the names of its signals, `law` cancels h, `observer` estimates the state,
`design` computes gains for (A, B, C), `controller` gives them the operating point,
`online` is all of it as one object that runs sample by sample (`run`), `loop` connects
it with a plant, with `algebraic` where the plant has feedthrough, `proposal` makes a
first design and compares it with the model, and `tracking` with the plant. `missed`
says what a record leaves open of the plant, `deviation` what that does in the loop.

python-control is imported in this package and nowhere else.  Its objects cannot be
pickled, so none is ever stored: they are built on demand.  Its axes are (signals,
time), ours (time, signals).
"""

from .controller import split_gain
from .design import balanced_weights, lqi, lqr, place, weigh_outputs
from .deviation import DesignDistance, design_distance
from .disturbance import DisturbanceObserver
from .export import linearize, signal_names, to_nlsys, to_statespace
from .law import LinearizingLaw, input_range
from .loop import closed_loop, designed_loop
from .missed import Missed, what_is_missed
from .observer import Observer
from .online import LinearizingController
from .proposal import step_comparison
from .run import Controller, LoopRecord, LoopStep
from .tracking import tracking_comparison

__all__ = [
    "Controller",
    "DesignDistance",
    "DisturbanceObserver",
    "LinearizingController",
    "LinearizingLaw",
    "LoopRecord",
    "LoopStep",
    "Missed",
    "Observer",
    "balanced_weights",
    "closed_loop",
    "design_distance",
    "designed_loop",
    "input_range",
    "linearize",
    "lqi",
    "lqr",
    "place",
    "signal_names",
    "split_gain",
    "step_comparison",
    "to_nlsys",
    "to_statespace",
    "tracking_comparison",
    "weigh_outputs",
    "what_is_missed",
]

"""Neural state-space identification for control.

`alssnn` identifies models x+ = A x + B (u + h(y)) + g(x, u), y = C x from records of
inputs and outputs. The law u = v - h(y) cancels h, and what g leaves is penalized.
"""

from importlib import import_module

from . import datasets, metrics
from .activations import Activation
from .estimators import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace, load
from .experiments import stack_experiments
from .ladder import model_ladder
from .linearizability import Linearizability

__version__ = "0.1.0"

__all__ = [
    "Activation",
    "AlSsnn",
    "FlSsnn",
    "GrSsnn",
    "LinearStateSpace",
    "Linearizability",
    "compare",
    "datasets",
    "excitation",
    "load",
    "look",
    "metrics",
    "model_ladder",
    "nonparametric",
    "stack_experiments",
]

# what not everyone needs is loaded when it is asked for
_LATER = {
    "compare": "comparison",
    "feedback": "feedback",
    "model_selection": "model_selection",
    "plotting": "plotting",
    "excitation": "excitation",
    "look": "first_look",
    "nonparametric": "nonparametric",
}


def __getattr__(name):
    """Return what is loaded late, by name."""
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f".{_LATER[name]}", __name__)
    return getattr(module, name, module)  # a function of its module, or the module


def __dir__():
    """Return all names, those that are loaded late, too."""
    return sorted({*globals(), *_LATER})

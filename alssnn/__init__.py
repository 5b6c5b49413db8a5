"""Neural state-space identification for control.

`alssnn` identifies models x+ = A x + B (u + h(y)) + g(x, u), y = C x from records of
inputs and outputs. The law u = v - h(y) cancels h, and what g leaves is penalized.
"""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from . import datasets, excitation, metrics, nonparametric
    from .activations import Activation
    from .comparison import compare
    from .estimators import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace, load
    from .experiments import stack_experiments
    from .first_look import look
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

# Everything is loaded when it is asked for: scikit-learn and SciPy take seconds, and
# `alssnn --help` needs neither.
_HOMES = {
    "Activation": "activations",
    "AlSsnn": "estimators",
    "FlSsnn": "estimators",
    "GrSsnn": "estimators",
    "LinearStateSpace": "estimators",
    "Linearizability": "linearizability",
    "compare": "comparison",
    "load": "estimators",
    "look": "first_look",
    "model_ladder": "ladder",
    "stack_experiments": "experiments",
}


def __getattr__(name):
    """Return a name of the package or one of its modules, loaded now."""
    if name in _HOMES:
        value = getattr(import_module(f".{_HOMES[name]}", __name__), name)
        globals()[name] = value
        return value
    if not name.startswith("_") and find_spec(f"{__name__}.{name}") is not None:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    """Return all names, those that are loaded late, too."""
    return sorted({*globals(), *__all__})

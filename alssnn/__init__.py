"""Neural state-space identification for control.

`alssnn` identifies models x+ = A x + B (u + h(y)) + g(x, u), y = C x from records of
inputs and outputs. The law u = v - h(y) cancels h, and what g leaves is penalized.
"""

from . import datasets, excitation, metrics, nonparametric
from .activations import Activation
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
    "datasets",
    "excitation",
    "load",
    "look",
    "metrics",
    "model_ladder",
    "nonparametric",
    "stack_experiments",
]

"""Estimators: the facade, and the only module that knows scikit-learn.

    LinearStateSpace   x+ = A x + B u                        N4SID, then refinement
    FlSsnn             x+ = A x + B (u + h(y))               exactly linearizable
    AlSsnn             x+ = A x + B (u + h(y)) + g(x, u)     g penalized by gamma
    GrSsnn             x+ = A x + B u + f(x, u)              f free

with y = C x for all; `Ssnn` is what models of other structures derive from, with
`estimator`, `option` and `take` for their options.  `fit`
turns records into scaled deviations, identifies a linear model, trains the networks
from it and converts the outcome to the user's units; everything else delegates
downwards.
"""

from ._al_ssnn import AlSsnn
from ._fl_ssnn import FlSsnn
from ._gr_ssnn import GrSsnn
from ._left_linear import LEFT_LINEAR
from ._linear import LinearStateSpace
from ._load import load
from ._networks import Networks
from ._options import estimator, option, take
from ._ssnn import Ssnn

__all__ = [
    "LEFT_LINEAR",
    "AlSsnn",
    "FlSsnn",
    "GrSsnn",
    "LinearStateSpace",
    "Networks",
    "Ssnn",
    "estimator",
    "load",
    "option",
    "take",
]

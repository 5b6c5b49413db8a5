"""The ladder: four models of the same data, side by side.

    LTI       x+ = A x + B u                          what a linear model can do
    FL-SSNN   x+ = A x + B (u + h(x))                 exactly linearizable
    AL-SSNN   x+ = A x + B (u + h(x)) + g(x, u)       g penalized by gamma
    GR-SSNN   x+ = A x + B u + f(x, u)                what a free model can do

The distance from LTI to GR-SSNN says how nonlinear the plant is, and where FL-SSNN and
AL-SSNN stand between them how much of that a law u = v - h(x) can cancel.  All models
see the same samples and seeds, and the initial state of every test experiment is
estimated from the same first samples, which are not scored.

Accuracy is one half of the answer.  The other is the output-referred residual
(eq. gauge): with v = u + h(x), it is

    e = y_hat - (response of (A, B, C) to v),

what a linear design on (A, B, C) does not see.  For GR-SSNN, which has no h, e is the
whole of what f does to the output.
"""

from ._explain import fault
from ._fit import LADDER, PRESETS, hold_out_last, judge_models, model_ladder
from ._records import Ladder, Rung

__all__ = [
    "LADDER",
    "PRESETS",
    "Ladder",
    "Rung",
    "fault",
    "hold_out_last",
    "judge_models",
    "model_ladder",
]

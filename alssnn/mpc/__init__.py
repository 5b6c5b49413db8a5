"""Predictive control of the linearized loop: a quadratic program at every sample.

    min  sum |x_i - x_s|_Q^2 + |v_i - v_s|_R^2      x+ = A x + B v + omega   (eq. mpc)
    s.t. u_min <= v - h(s) <= u_max,  soft bounds of y and x

The law u = v - h(s) leaves a linear model, and the program is convex.  What it does not
leave linear enters as known numbers, evaluated along the last plan: h in the bounds of
v, and omega, the part of the whole model that the linear one lacks.

For a law u = phi^-1(v, s) h is phi(u, s) - u, and the limits of u are linearized along
the plan where phi couples them (eq. rows).

`_model` evaluates omega and `_inputs` what lies between u and v, `_target` finds the
states of rest (eq. target), `_prediction` condenses the linear model over the horizon
and `_condensed` builds the program from it, once; `_plan` poses it at every sample
along the last plan, within what `_limits` and `_soft` hold.  `_controller` is what the
user sees, `_record` holds what happened, and `_qp` is the only place that knows OSQP.
"""

from ._controller import LinearizingMPC
from ._record import MpcRecord, MpcStep

__all__ = ["LinearizingMPC", "MpcRecord", "MpcStep"]

"""Certificates of the linearized loop: invariant sets, bounds and gains.

_loop            certificates of a fitted model: functions of a `Plant`
_state_feedback  the linearized loop with a gain around it
_disturbance     bounds on omega and eta, what is left of x+ and of y
_iss             input-to-state stability, which takes omega as its input
_gain            the incremental gain of the nonlinear loop
_sdp             semidefinite programs, the only place that knows cvxpy
"""

from ._disturbance import data_bound, global_bound
from ._gain import GainCertificate, gain_certificate, hinf_norm
from ._iss import IssCertificate, iss_certificate, iss_margin
from ._loop import certify_gain, certify_iss
from ._state_feedback import full_gain, linearized_loop, state_feedback

__all__ = [
    "GainCertificate",
    "IssCertificate",
    "certify_gain",
    "certify_iss",
    "data_bound",
    "full_gain",
    "gain_certificate",
    "global_bound",
    "hinf_norm",
    "iss_certificate",
    "iss_margin",
    "linearized_loop",
    "state_feedback",
]

"""Certificates of the linearized loop: invariant sets, bounds and gains.

Four modules: `_iss` states the certificate of input-to-state stability, `_disturbance`
bounds the residual omega that it takes as input, `_gain` bounds the incremental gain of
the nonlinear loop, and `_sdp` holds the semidefinite programs, the only place that
knows cvxpy.
"""

from ._disturbance import data_bound, global_bound, state_feedback
from ._gain import GainCertificate, gain_certificate, hinf_norm
from ._iss import IssCertificate, iss_certificate, iss_margin

__all__ = [
    "GainCertificate",
    "IssCertificate",
    "data_bound",
    "gain_certificate",
    "global_bound",
    "hinf_norm",
    "iss_certificate",
    "iss_margin",
    "state_feedback",
]

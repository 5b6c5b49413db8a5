"""Certificates of the linearized loop: invariant sets, bounds and gains.

_loop            certificates of a fitted model: functions of a `Plant`
_state_feedback  the linearized loop with a gain around it
_disturbance     bounds on omega and eta, what is left of x+ and of y
_iss             input-to-state stability, which takes omega as its input
_gain            the incremental gain of the nonlinear loop
_hinf            the H-infinity norm
_interior        its semidefinite program
_sdp             the paper's semidefinite program, the only place that knows cvxpy
_local           the distance from the linear design, for all bounded inputs
_proof           what that rests on
_covers          loops as linear systems with bounded remainders
_cells           what a network adds to a linear map over a region, by subdivision
_lines           neurons as lines over intervals
_neurons         those that count, what they see, what pairs of them differ by
_grid            the distance on a grid of states, for few of them
_amplitudes      sizes of inputs, checked and in words
_peaks           what bounded inputs do to linear systems
_worst           the input that takes a loop farthest from its design
_whole           the whole loop: plant, observer, law, integrators, limits
_whole_certificate  what is proved of it
_rest            that loop as deviations from rest, and from its design
_error_gain      the gain of what the plant adds to the model, by held-out records
_tube            how far the plant is from the model, by held-out records
"""

from ._disturbance import data_bound, global_bound
from ._error_gain import ErrorGain, error_gain
from ._gain import GainCertificate, gain_certificate
from ._hinf import hinf_norm
from ._iss import IssCertificate, iss_certificate, iss_margin
from ._local import LocalCertificate, local_certificate
from ._loop import certify_gain, certify_iss, certify_local
from ._peaks import Peaks, peaks
from ._state_feedback import full_gain, linearized_loop, state_feedback
from ._tube import Band, Tube, TubeWithBound, tube
from ._whole_certificate import LoopCertificate, certify_loop
from ._worst import worst_input

__all__ = [
    "Band",
    "ErrorGain",
    "GainCertificate",
    "IssCertificate",
    "LocalCertificate",
    "LoopCertificate",
    "Peaks",
    "Tube",
    "TubeWithBound",
    "certify_gain",
    "certify_iss",
    "certify_local",
    "certify_loop",
    "data_bound",
    "error_gain",
    "full_gain",
    "gain_certificate",
    "global_bound",
    "hinf_norm",
    "iss_certificate",
    "iss_margin",
    "linearized_loop",
    "local_certificate",
    "peaks",
    "state_feedback",
    "tube",
    "worst_input",
]

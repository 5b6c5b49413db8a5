"""Before the model: what a record says without one.

    G(k)       best linear approximation: the linear system that is nearest to the
               plant for this kind of input, at the lines of the spectrum
    noise      what differs from one period to the next
    distortion what differs from one realization of the phases to the next, and is no
               noise: the nonlinearity, even and odd where the excitation shows it

`best_linear_approximation` takes periodic records (eq. robust) (eq. fast),
`local_polynomial` any other (eq. lpm).  Both return a `BestLinearApproximation`.  Its
``noise_rms`` is the root mean square error that no model can go below, its
``total_rms`` the one that no *linear* model can go below.  Both are estimates; those of
`local_polynomial` are too large where a resonance is narrower than its windows.

Experiments that had the same input tell their noise without periods, too
(`noise_of_repeats`, eq. repeats): copies count as further periods to the first, and the
second knows its ``noise_rms`` by them.

Not here: parametric models (`estimators`), and records of closed loops, whose noise is
correlated with the input.
"""

from ._local import local_polynomial
from ._periodic import best_linear_approximation
from ._repeats import noise_of_repeats
from ._response import BestLinearApproximation

__all__ = [
    "BestLinearApproximation",
    "best_linear_approximation",
    "local_polynomial",
    "noise_of_repeats",
]

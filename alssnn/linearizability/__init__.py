"""Measures of what nonlinearity is left once h is cancelled.

_rate       records at the sampling time of the law
_measure    the quantities, computed along simulated trajectories
_record     what is reported: fields, table, data frame
_verdict    whether that is good enough
"""

from ..region import Region
from ._measure import measure, output_residual
from ._rate import at_rate
from ._record import LARGE_LAW, OMEGA, OUTSIDE, Bands, Linearizability, words_left
from ._verdict import LOOP_OUTSIDE, is_unstable, judge, percent, worst_error

__all__ = [
    "LARGE_LAW",
    "LOOP_OUTSIDE",
    "OMEGA",
    "OUTSIDE",
    "Bands",
    "Linearizability",
    "Region",
    "at_rate",
    "is_unstable",
    "judge",
    "measure",
    "output_residual",
    "percent",
    "words_left",
    "worst_error",
]

"""Measures of what nonlinearity is left once h is cancelled.

_measure    the quantities, computed along simulated trajectories
_region     where a model was trained, and which samples leave it
_record     what is reported: fields, table, data frame
"""

from ..region import Region
from ._measure import measure, output_residual
from ._record import Bands, Linearizability

__all__ = ["Bands", "Linearizability", "Region", "measure", "output_residual"]

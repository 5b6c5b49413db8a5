"""A first look at a record, in words: what to mend or to expect before a fit.

`look` asks of a record what an engineer would ask: are there gaps, spikes, limits that
were hit, a converter that is too coarse; do the inputs move, and independently of each
other; are they late; is the plant nonlinear (eq. reset); how accurate can a model be;
is the sampling time right; which model to begin with (eq. rivals).  Every answer is a
`Finding` with a number and a sentence.
"""

from ._findings import Finding, FirstLook
from ._look import look
from ._nonlinearity import nonlinearity
from ._recommend import Recommendation

__all__ = ["Finding", "FirstLook", "Recommendation", "look", "nonlinearity"]

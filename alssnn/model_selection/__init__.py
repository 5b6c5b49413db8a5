"""Choosing a model: splitters for records, labels for their seams, a path in gamma.

    seam_labels               labels by which an estimator sees where a record was cut
    BlockedTimeSeriesSplit    contiguous test blocks, training on one or both sides
    ExperimentKFold           whole experiments
    gamma_path                accuracy against linearity, by warm-started fits
    law_rates                 linearity against the sampling time of the law

The scores to search by are in `alssnn.scorers`.
"""

from ..experiments import seam_labels
from ._gamma_path import DEFAULT_GAMMAS, GammaPath, gamma_path
from ._law_rates import LawRates, law_rates
from ._split import BlockedTimeSeriesSplit, ExperimentKFold

__all__ = [
    "DEFAULT_GAMMAS",
    "BlockedTimeSeriesSplit",
    "ExperimentKFold",
    "GammaPath",
    "LawRates",
    "gamma_path",
    "law_rates",
    "seam_labels",
]

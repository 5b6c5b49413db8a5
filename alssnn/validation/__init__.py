"""Validation: what a model says about records that it was not trained on.

_residuals  correlations and tests of the residuals of a free run
_regression  the regression behind them, which knows errors of the parameters
_ahead      fit of predictions against their horizon
_loops      responses at finite amplitudes, the linearized loop along a record
_validate   all checks in one table
_record     what it reports
_scored     the samples of a record that count

No figure is drawn here: see `alssnn.plotting`.
"""

from ._ahead import AheadFit, ahead_fit
from ._loops import LoopDeviation, frequency_response, loop_deviation, sine_response
from ._record import Check, Validation
from ._residuals import ResidualTests, residual_tests
from ._scored import (
    check_names,
    column_names,
    moved_names,
    scored_experiments,
    scored_sensitivities,
)
from ._validate import validate

__all__ = [
    "AheadFit",
    "Check",
    "LoopDeviation",
    "ResidualTests",
    "Validation",
    "ahead_fit",
    "check_names",
    "column_names",
    "frequency_response",
    "loop_deviation",
    "moved_names",
    "residual_tests",
    "scored_experiments",
    "scored_sensitivities",
    "sine_response",
    "validate",
]

"""Validation: what a model says about records that it was not trained on.

_residuals  correlations and tests of the residuals
_predicted  which errors of a model they are: of a free run, or one sample ahead
_feedback   whether noise moved the inputs of a record
_closed_loop  what that means for a model
_regression  the regression behind them, which knows errors of the parameters
_ahead      fit of predictions against their horizon
_loops      responses at finite amplitudes, the linearized loop along a record
_validate   all checks in one table
_record     what it reports
_scored     the samples of a record that count

No figure is drawn here: see `alssnn.plotting`.
"""

from ._ahead import AheadFit, ahead_fit
from ._feedback import FeedbackTests, feedback_tests
from ._loops import LoopDeviation, frequency_response, loop_deviation, sine_response
from ._predicted import judged_experiments
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
    "FeedbackTests",
    "LoopDeviation",
    "ResidualTests",
    "Validation",
    "ahead_fit",
    "check_names",
    "column_names",
    "feedback_tests",
    "frequency_response",
    "judged_experiments",
    "loop_deviation",
    "moved_names",
    "residual_tests",
    "scored_experiments",
    "scored_sensitivities",
    "sine_response",
    "validate",
]

"""Figures: the only home of matplotlib.

Displays follow scikit-learn: ``from_estimator`` computes and draws,
``from_predictions`` draws what was computed, and ``plot`` draws again, on axes that the
caller may give; a display keeps its numbers, and its axes as ``ax_`` or ``axes_`` and
``figure_``.

Figures are objects built without pyplot: nothing is registered, shown or closed, and no
display is needed. Give axes of ``matplotlib.pyplot.subplots`` to see them in a window.
"""

from ._axes import COLORS
from ._before import ApproximationDisplay, ExcitationDisplay
from ._bode import BodeDisplay
from ._certificate import CertificateDisplay
from ._comparison import BodeComparisonDisplay, ComparisonDisplay
from ._curves import figure_curves
from ._designs import plot_designs
from ._ladder import plot_ladder
from ._law_rates import LawRatesDisplay
from ._linear import PoleDisplay, SingularValuesDisplay
from ._loop import LoopDisplay
from ._model import plot_model
from ._nonlinearity import NonlinearityDisplay, ResidualNonlinearityDisplay
from ._record import RecordDisplay
from ._residuals import ResidualDisplay
from ._run import RunDisplay
from ._simulation import SimulationDisplay
from ._trade_off import GammaPathDisplay

__all__ = [
    "COLORS",
    "ApproximationDisplay",
    "BodeComparisonDisplay",
    "BodeDisplay",
    "CertificateDisplay",
    "ComparisonDisplay",
    "ExcitationDisplay",
    "GammaPathDisplay",
    "LawRatesDisplay",
    "LoopDisplay",
    "NonlinearityDisplay",
    "PoleDisplay",
    "RecordDisplay",
    "ResidualDisplay",
    "ResidualNonlinearityDisplay",
    "RunDisplay",
    "SimulationDisplay",
    "SingularValuesDisplay",
    "figure_curves",
    "plot_designs",
    "plot_ladder",
    "plot_model",
]

"""Whether a model may be called linearizable: one verdict for all that speak of it."""

import numpy as np

from ..shown import percent as in_words
from ..shown import times

LOOP_OUTSIDE = 0.05  # share of samples of the loop outside the training region
ON_CIRCLE = 1e-6  # a pole no farther from the unit circle integrates, but for rounding


def percent(share):
    """Return a share in percent, in words.

    Parameters
    ----------
    share : float
        Share, one for all.

    Returns
    -------
    text : str
        Percentage, without an exponent.
    """
    value = 100 * float(share)
    if not np.isfinite(value):
        return "an unbounded share"
    return in_words(value)


def is_unstable(figures):
    """Return whether A has a pole outside the unit circle; integrators have none.

    Parameters
    ----------
    figures : Linearizability or Rung
        What was measured.

    Returns
    -------
    is_unstable : bool
        Whether the free run of the linear part grows without bound by itself.
    """
    return bool(figures.spectral_radius > 1 + ON_CIRCLE)


def _in_judged_loop(figures):
    """Return errors and samples outside of the loop that is judged, and its name.

    What integrates drifts away in the loop u = v - h, linear or not, where no
    controller holds it. There it is the model's loop of a first controller.
    """
    if figures.spectral_radius < 1 - ON_CIRCLE or is_unstable(figures):
        errors = figures.closed_linearization_error
        return errors, figures.closed_outside, "the loop u = v - h"
    errors = getattr(figures, "carried_model", None)  # a rung of the ladder has none
    outside = getattr(figures, "carried_outside", None)
    return errors, outside, "the loop of a first controller"


def worst_error(figures):
    """Return the larger of the errors in open and in closed loop.

    Parameters
    ----------
    figures : Linearizability or Rung
        What was measured.

    Returns
    -------
    error : float
        Largest one over the outputs; that of the record if there is no loop. The loop
        is that of `judge`, and u = v - h where no controller was tried.
    """
    in_loop = _in_judged_loop(figures)[0]
    if in_loop is None:
        in_loop = figures.closed_linearization_error
    both = (figures.linearization_error, in_loop)
    return float(np.nanmax([np.max(error) for error in both]))


def judge(figures, within=0.05, fit=None):
    """Decide whether a linear design on (A, B, C) has a basis.

    Parameters
    ----------
    figures : Linearizability or Rung
        What was measured.
    within : float, default=0.05
        Share of the output that may be left, in open and in closed loop.
    fit : float or None, default=None
        Fit of the free run in percent, that of the worst output; None if unknown.

    Returns
    -------
    passed : bool
        Whether both errors are small, the loop stays inside the training data, the
        law is no larger than they bear, A is stable, the model follows the plant at
        all, and not even the low end of what is expected of the plant in a loop is
        farther from the design. The loop is u = v - h with the recorded input as v; of
        a plant that integrates, that of a first controller.
    sentence : str
        Why, with the figures.
    """
    if figures.no_law:
        return False, f"There is no loop to judge. {figures.no_law}"
    if is_unstable(figures):
        return False, (
            f"The {getattr(figures, 'words_radius', 'spectral radius of A')} is "
            f"{figures.spectral_radius:.4g}: the linear part needs a controller that "
            "stabilizes it."
        )
    errors, outside, loop = _in_judged_loop(figures)
    if errors is None:
        problem = getattr(figures, "carried_problem", "")
        return False, (
            "The model integrates, and its loop cannot be judged without a controller. "
            f"{problem or 'None was tried.'}"
        )
    opened, closed = (
        float(np.max(error)) for error in (figures.linearization_error, errors)
    )
    unseen = "an unknown share" if outside is None else percent(outside)
    both = (
        f"{percent(opened)} of the output along the record and {percent(closed)} in "
        f"{loop}, which spends {unseen} of its samples outside the training data"
    )
    if fit is not None and not fit > 0:
        return False, (
            "The model does not follow the plant (see free run), and how linear it is "
            f"says nothing on the plant. Of the model, not linear are {both}."
        )
    if not (opened <= within and closed <= within):
        return False, (
            f"Not the response of (A, B, C) are {both}. A linear design takes this "
            "for a disturbance."
        )
    # what is linear everywhere is no guess anywhere
    bends = opened > 0 or closed > 0 or getattr(figures, "law_size", np.nan) != 0
    if bends and (outside is None or not outside <= LOOP_OUTSIDE):
        return False, (
            f"Not the response of (A, B, C) are {both}. The networks are extrapolated "
            "there, and the figure of the loop is a guess. Fit with a larger `gamma_h`."
        )
    if figures.large_law:
        return False, (
            f"The law is {times(figures.large_law)} times the recorded input, so that "
            "errors of the model weigh as much more in the loop. Not the response of "
            f"(A, B, C) are {both}. Fit with a larger `gamma_h`."
        )
    carried = getattr(figures, "carried", None)  # a rung of the ladder has none
    known = carried is not None and not np.isnan(carried).any()
    if known and np.max(figures.carried_low) > within:
        return False, (
            f"By the model, not the response of (A, B, C) are {both}. But it is not "
            f"accurate enough for a loop.{_in_loop(figures, figures.carried_low)} Try "
            "another model, or a longer record."
        )
    expected = "" if carried is None else _in_loop(figures, carried)
    return True, f"Not the response of (A, B, C) are only {both}.{expected}"


def _in_loop(figures, by):
    """Return how far the plant may be from its design, of the output where most is."""
    carried = figures.carried
    if np.isnan(carried).any():
        return (
            " How far the plant will be from its design is unknown: the loop of a "
            f"first controller is outside the training data in "
            f"{percent(figures.carried_outside)} of its samples."
        )
    i = int(np.argmax(by))
    low, high = figures.carried_low[i], figures.carried_high[i]
    return (
        f" In the loop of a first controller the plant is expected to be "
        f"{percent(carried[i])} of the output from its design ({percent(low)} to "
        f"{percent(high)})."
    )

"""What the figures of a ladder mean, in words derived from the numbers."""

import textwrap

import numpy as np

from ..linearizability import LOOP_OUTSIDE, is_unstable, worst_error
from ..linearizability import percent as share_in_words
from ..shown import percent, times

CLEARLY = 1.1  # ratio of errors below which two models count as equally accurate
WORTHWHILE = 2.0  # gain in linearity for which an observer pays
TEXT_WIDTH = 79  # columns


def explain(rows, dt):
    """Say in words what the figures of a ladder mean for control.

    Parameters
    ----------
    rows : sequence of Rung
        Rows; those named LTI, AL-SSNN and "AL-SSNN/y" are spoken of.
    dt : float
        Sampling time, in seconds.

    Returns
    -------
    text : str
        One paragraph each on accuracy, linearity, feedback and stability; empty
        without an AL-SSNN.
    """
    named = {row.name: row for row in rows}
    if "AL-SSNN" not in named:
        return ""
    al, lti = named["AL-SSNN"], named.get("LTI")
    sentences = [_about_linearity(al, lti), _about_stability(al, dt)]
    if "AL-SSNN/y" in named:
        sentences.insert(1, _about_feedback(named["AL-SSNN/y"], al))
    if lti is not None:
        sentences.insert(0, _about_accuracy(al, lti))
    return "\n".join(
        textwrap.fill(s, TEXT_WIDTH, initial_indent="- ", subsequent_indent="  ")
        for s in sentences
    )


def fault(row, lti=None):
    """Say why a model should not be used, if it should not.

    Parameters
    ----------
    row : Rung
        Row of the model.
    lti : Rung or None, default=None
        Row of the linear model.

    Returns
    -------
    sentence : str
        The reason; empty if there is none, or if no free run can tell.
    """
    if row.model.fitted_.grows or drifts(row):
        return ""
    if not np.isfinite(row.fit_percent).all():
        return f"{row.name} diverges on the test data: do not use it."
    if row.fit_percent.min() <= 0:
        return (
            f"{row.name} follows the test data no better than the mean of the output: "
            "do not use it."
        )
    if lti is not None and _missed(row) > CLEARLY * _missed(lti):
        return (
            f"{row.name} is worse than the linear model on the test data: it misses "
            f"{percent(_missed(row))} of the output, LTI {percent(_missed(lti))}. "
            "Use the linear model, or train on more data."
        )
    return ""


def drifts(row):
    """Return whether a model has a random walk, of which no free run knows.

    Parameters
    ----------
    row : Rung
        Row of the model.

    Returns
    -------
    drifts : bool
        Whether the model was fitted with a `drift`.
    """
    return getattr(row.model, "drift", None) is not None


def _missed(row):
    """Return the percentage of the test output that the simulation misses."""
    return float(100 - row.fit_percent.mean())


def _about_accuracy(al, lti):
    if drifts(al):
        return "Accuracy: no free run knows what drifts. `validate` judges predictions."
    # without units, as the percentages beside it
    ratio = _missed(lti) / max(_missed(al), np.finfo(float).eps)
    if not np.isfinite(al.rmse_test).all():
        return "Accuracy: AL-SSNN diverges on the test data and is of no use there."
    if _missed(al) >= 100:
        return (
            "Accuracy: AL-SSNN follows the test data no better than their mean and is "
            "of no use there."
        )
    facts = (
        f"Accuracy: on the test data LTI misses {percent(_missed(lti))} of the output,"
        f" AL-SSNN {percent(_missed(al))}"
    )
    if ratio > CLEARLY:
        return f"{facts}, {times(ratio)} times less."
    return (
        f"{facts}: the networks gain nothing. Either the plant is nearly linear on "
        "these data, or the training needs more iterations, neurons or states."
    )


def _about_linearity(al, lti):
    if al.no_law:
        return f"Linearity: there is no linearized loop. {al.no_law}"
    # means over the outputs, as the table has them
    rest = 100 * float(np.mean(al.linearization_error))
    loop = 100 * float(np.mean(al.closed_linearization_error))
    loop = rest if np.isnan(loop) else loop
    if not np.isfinite(worst_error(al)):
        return (
            "Linearity: what is left of the nonlinearity grows without bound, because "
            "the simulation or A is unstable."
        )
    is_lost = not np.isfinite(al.rmse_test).all() or _missed(al) >= 100
    if is_lost and not drifts(al):
        return (
            "Linearity: a model that does not follow the test data says nothing on "
            "how linear the plant becomes."
        )
    which = "the output"
    if len(al.linearization_error) > 1:
        worst = percent(100 * np.max(al.linearization_error))
        which = f"the outputs (mean; {worst} of one of them)"
    facts = (
        f"Linearity: with u = v - h, {percent(rest)} of {which} of AL-SSNN is "
        "still not the response of its linear part (A, B, C)"
    )
    outside = al.closed_outside
    if loop > CLEARLY * rest:
        facts += f" along the test data, and {percent(loop)} in the loop itself"
    if outside is None or outside > LOOP_OUTSIDE:
        unseen = "an unknown share" if outside is None else share_in_words(outside)
        return (
            f"{facts}. But the loop spends {unseen} of its samples outside the "
            "training data, where the networks are a guess. Fit with a larger gamma_h."
        )
    if al.large_law:
        return (
            f"{facts}. But the law is {times(al.large_law)} times the recorded input, "
            "and errors of the model weigh as much more. Fit with a larger gamma_h."
        )
    rest = max(rest, loop)
    if lti is None or not np.isfinite(lti.rmse_test).all() or drifts(al):
        return f"{facts}."
    ratio = _missed(lti) / max(rest, np.finfo(float).eps)  # the rest may be 0
    if ratio > CLEARLY:
        return (
            f"{facts}: {times(ratio)} times less than LTI misses without that "
            "feedback. Design on (A, B, C) and allow for this rest as uncertainty."
        )
    return (
        f"{facts}, while LTI misses {percent(_missed(lti))} without any feedback: "
        "cancelling h does not make this plant more linear. Try a larger gamma and "
        "watch what it costs in accuracy."
    )


def _about_feedback(output, state):
    rest, rest_state = (100 * worst_error(row) for row in (output, state))
    if not np.isfinite(rest_state):
        return (
            "Feedback: the model with h(x) is unstable on the test data and says "
            "nothing about state feedback."
        )
    facts = (
        f"Feedback: h(y) leaves {percent(rest)} of the output nonlinear, h(x) "
        f"{percent(rest_state)}"
    )
    if not np.isfinite(rest) or rest > WORTHWHILE * rest_state:
        return (
            f"{facts}: this fit found no output feedback that linearizes the plant as "
            "well. Estimate the state by an observer and cancel h(x)."
        )
    return f"{facts}: an observer is not worth its while, h(y) does."


def _about_stability(al, dt):
    rho = al.spectral_radius
    if is_unstable(al):
        return (
            f"Stability: A of AL-SSNN is unstable (spectral radius {rho:.4f}); the "
            "linear controller has to stabilize it."
        )
    if rho >= 1:
        return (
            f"Stability: A of AL-SSNN integrates (spectral radius {rho:.4f}); without "
            "a controller its output drifts."
        )
    samples = -1 / np.log(max(rho, np.finfo(float).tiny))
    return (
        f"Stability: A of AL-SSNN is stable (spectral radius {rho:.4f}); its slowest "
        f"mode decays by 63 % in {samples:.2g} samples, {samples * dt:.2g} s."
    )

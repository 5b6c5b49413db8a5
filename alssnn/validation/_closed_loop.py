"""What feedback in a record means for a model: a check, and a doubt of other checks.

The tests of a free run suppose that u does not depend on noise.  Where it does, and the
residual is large and colored, a model can be biased in a way that they do not see
(eq. fedback).  Errors one sample ahead suppose nothing of that kind, but something
besides y has to move u.
"""

from dataclasses import replace

import numpy as np

from ..linearizability import percent
from ._record import Check

NEARLY_ALL = 0.99  # share of an input that outputs explain where no reference moves it
REMEDY = "fit with noise='innovations'."


def feedback_check(tests, level, ahead, doubt=""):
    """Return the check of feedback.

    Parameters
    ----------
    tests : FeedbackTests or None
        What was found; None if nothing could be.
    level : float
        Probability of a false alarm.
    ahead : bool
        Whether the model is judged by its errors one sample ahead.
    doubt : str, default=""
        Why there are no tests, if another reason is known than a short record.

    Returns
    -------
    check : Check
        Reported only.
    """
    if tests is None:
        sentence = doubt or "The record is too short to tell, or the model diverges."
        return Check("feedback", False, np.nan, "p-value", False, sentence, True)
    found = tests.found(level)
    if not found.any():
        sentence = (
            "No feedback found: noise explains no more than chance of what the past of "
            "u does not tell of u."
        )
        return Check("feedback", True, tests.p, "p-value", False, sentence)
    block = 0 if found[:, 0].any() else 1
    worst = int(tests.p_values[:, block].argmin())
    when = ("of the past", "of the same sample")[block]
    sentence = (
        f"Feedback found: noise {when} explains {percent(tests.shares[worst, block])} "
        f"of what the past of u does not tell of {tests.input_names[worst]}. "
    )
    if block == 1:
        sentence += (
            "Either the controller has no delay, or y depends on u of the same sample "
            "and the model does not: try `feedthrough=True`. "
        )
    if ahead:
        sentence += "This does no harm to errors one sample ahead. "
    else:
        sentence += (
            "The simulation error is biased where noise goes through the plant: "
            f"{REMEDY} "
        )
    if block == 0:
        sentence += (
            "(If nobody acted on y, u is late against y in this record, or the model "
            "has too few states: its errors then depend on u as noise does in a loop.) "
        )
    alone, others = _alone(tests, level), "; something else moves u, too."
    if alone.any():
        worst = int(np.argmax(np.where(alone, tests.by_outputs, 0.0)))
        others = (
            ": nothing but y moves u, and plant and controller cannot be told apart. "
            "Add a reference."
        )
    sentence += (
        f"Outputs explain {percent(tests.by_outputs[worst])} of it for "
        f"{tests.input_names[worst]}{others}"
    )
    return Check("feedback", False, tests.p, "p-value", False, sentence)


def in_closed_loop(checks, tests, level, ahead, part):
    """Return checks of residuals, with the doubt that a closed loop casts on them.

    Parameters
    ----------
    checks : sequence of Check
        Independence first.
    tests : FeedbackTests or None
        What was found of feedback.
    level : float
        Probability of a false alarm.
    ahead : bool
        Whether the model is judged by its errors one sample ahead.
    part : float
        Share of an output that the past of the residual tells; 0 if it is small.

    Returns
    -------
    checks : list of Check
        Independence is open where it passed, but says little; what failed has a hint.
    """
    if tests is None or not tests.found(level).any():
        return list(checks)
    if not ahead:
        hint = f"But there is feedback, which may be the cause: first {REMEDY}"
        checks = [_with(check, hint) for check in checks]
    first, *others = checks
    doubt = ""
    if part and not ahead:
        doubt = (
            "But there is feedback, and the past of the residual tells "
            f"{percent(part)} of the output. Then the simulation error is biased, "
            f"and this test does not see it: {REMEDY}"
        )
    elif np.any(_alone(tests, level)):
        doubt = "But nothing but y moves u (see feedback): add a reference."
    if first.passed and doubt:
        sentence = f"{first.sentence} {doubt}"
        first = replace(first, passed=False, undecided=True, sentence=sentence)
    return [first, *others]


def _alone(tests, level):
    """Return which inputs nothing but outputs moves."""
    return tests.found(level).any(axis=1) & (tests.by_outputs > NEARLY_ALL)


def _with(check, hint):
    """Return a check that failed with a hint."""
    if check.outcome != "FAIL":
        return check
    return replace(check, sentence=f"{check.sentence} {hint}")

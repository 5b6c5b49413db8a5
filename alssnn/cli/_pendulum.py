"""The demonstration: from the record of a pendulum to a loop on the true pendulum.

Two models of the same record, a linear one and x+ = A x + B (u + h(x)), each with a
regulator that is designed on its (A, B, C) with the same weights.  Each regulator then
runs on the true pendulum, behind an observer, the second one behind the law u = v - h.
A loop is as good as its design predicts, or it is not: that distance is the result.
"""

import textwrap
import time
from typing import NamedTuple

import numpy as np

from ..estimators import FlSsnn, LinearStateSpace
from ..rows import aligned
from ..shown import times
from ._comparison import TEXT_WIDTH

AMPLITUDE = 4.5  # rad/s2: the record covers the angles of the reference
REFERENCE = ((0.0, 10), (1.0, 80), (-0.8, 80))  # rad, samples
WEIGHTS = {"integral": 0.02, "control": 0.05}  # settles in about 2 s
# It hangs at zero without a torque, which signals of mean zero would not say.
OPTIONS = {"nx": 2, "operating_point": "zero"}
LAW_OPTIONS = {"gamma_h": 1e-4, "n_init": 1}  # one start, for speed
CLEARLY = 1.1  # ratio below which two loops count as equally good
LINEAR, LAW = "linear model", "model with h"


class Outcome(NamedTuple):
    """Hold what one model came to.

    Parameters
    ----------
    residual : ndarray of shape (N,)
        Measured minus simulated angle on the test data, in rad.
    missed : float
        Its RMS over that of the measured angle around its mean.
    response : tuple of ndarray
        Time, angle as designed, angle of the true pendulum in the loop.
    planned : ndarray of shape (N,)
        Angle of the true pendulum if the planned input is sent without feedback.
    torque : ndarray of shape (N,)
        What the actuator did in the loop, in rad/s2.
    seconds : float
        Duration of the fit.
    """

    residual: np.ndarray
    missed: float
    response: tuple
    planned: np.ndarray
    torque: np.ndarray
    seconds: float

    @property
    def loop_distance(self):
        """Return the RMS distance of the loop from its design, in rad."""
        _, design, true = self.response
        return _rms(true - design)

    @property
    def open_distance(self):
        """Return the same without feedback."""
        return _rms(self.planned - self.response[1])


def try_designs(record, train, test, *, max_iter, random_state, report):
    """Fit both models, and run their loops on the true plant.

    Parameters
    ----------
    record : Record
        Record with the true plant.
    train, test : Record
        Its parts.
    max_iter : int
        Largest number of trial steps.
    random_state : int
        Seed of the networks.
    report : callable
        Called with a line of text before every step.

    Returns
    -------
    outcomes : dict of str to Outcome
        By name of the model.
    """
    models = {
        LINEAR: LinearStateSpace(dt=record.dt, **OPTIONS),
        LAW: FlSsnn(
            dt=record.dt,
            max_iter=max_iter,
            random_state=random_state,
            **OPTIONS,
            **LAW_OPTIONS,
        ),
    }
    outcomes = {}
    for name, model in models.items():
        report(f"fit of the {name}")
        start = time.perf_counter()
        model.fit(train.u, train.y)
        seconds = time.perf_counter() - start
        report(f"{name}: fitted in {seconds:.0f} s; its loop on the true pendulum")
        outcomes[name] = _outcome(record.plant, model, test, seconds)
    return outcomes


def _outcome(plant, model, test, seconds):
    """Return what a fitted model comes to, on a record and in its loop."""
    from ..feedback import balanced_weights, lqi, tracking_comparison

    measured, simulated = model.simulate_test(test.u, test.y)
    residual = (measured - simulated)[:, 0]
    gain = lqi(model, *balanced_weights(model, **WEIGHTS))
    r = np.concatenate([np.full(n, level) for level, n in REFERENCE])
    responses = tracking_comparison(plant, model, gain, r)
    angle = {name: response.outputs[0] for name, response in responses.items()}
    return Outcome(
        residual=residual,
        missed=_rms(residual) / measured.std(),
        response=(responses["loop"].time, angle["design"], angle["loop"]),
        planned=angle["open loop"],
        torque=responses["loop"].outputs[2],
        seconds=seconds,
    )


def _rms(z):
    return float(np.sqrt(np.mean(np.square(z))))


def explain(outcomes, noise):
    """Return the table, and a sentence on each of its lines.

    Parameters
    ----------
    outcomes : dict of str to Outcome
        What `try_designs` returned.
    noise : float
        Standard deviation of the measurement noise, in rad.

    Returns
    -------
    text : str
        The table, the sentences, and the verdict.
    """
    linear, law = (outcomes[name] for name in (LINEAR, LAW))
    lines = (
        (
            "simulation error, rad",
            lambda one: f"{_rms(one.residual):.4f}",
            "RMS of measured minus simulated angle on the last third of the record, "
            "which trained nothing. The measurement noise alone makes "
            f"{noise:.4f} rad.",
        ),
        (
            "share that is missed, %",
            lambda one: f"{100 * one.missed:.1f}",
            "The same error in percent of the standard deviation of the angle.",
        ),
        (
            "without feedback, rad",
            lambda one: f"{one.open_distance:.3f}",
            "The input that the model gets in its own loop is sent to the true "
            "pendulum. RMS distance of its angle from the design.",
        ),
        (
            "in the loop, rad",
            lambda one: f"{one.loop_distance:.4f}",
            "The controller of the design runs on the true pendulum. RMS distance of "
            "its angle from the design: the smaller, the better the model predicts "
            "the loop.",
        ),
        (
            "largest torque, rad/s2",
            lambda one: f"{np.abs(one.torque).max():.1f}",
            f"What the actuator does in the loop. The record has up to {AMPLITUDE}.",
        ),
        (
            "time of the fit, s",
            lambda one: f"{one.seconds:.1f}",
            "Time of the training. The first one on a computer compiles loops, too.",
        ),
    )
    cells = [(name, figure(linear), figure(law)) for name, figure, _ in lines]
    head, *rows = aligned([("", LINEAR, LAW), *cells])
    notes = [
        textwrap.fill(
            f"- {name.partition(',')[0]}: {note}", TEXT_WIDTH, subsequent_indent="  "
        )
        for name, _, note in lines
    ]
    verdict = textwrap.fill(_verdict(linear, law), TEXT_WIDTH)
    return "\n".join([head, "-" * len(head), *rows, "", *notes, "", verdict])


def _verdict(linear, law):
    """Say which loop follows its design better."""
    if not np.isfinite(law.loop_distance):
        return "The loop of the model with h diverges. Take more samples or less noise."
    ratio = linear.loop_distance / law.loop_distance
    if ratio > CLEARLY:
        return (
            f"The true loop behind u = v - h(x) is {times(ratio)} times closer to its "
            "design than the loop of the linear model: the law makes the pendulum "
            "behave like the linear system that the controller was designed for."
        )
    return (
        "On this record the law u = v - h(x) does not bring the loop closer to its "
        "design. Take more samples or less noise."
    )

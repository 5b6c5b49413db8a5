"""The plants behind the cases: their equations, to be run with inputs of a law.

A case has records. Where a single simulation has made them, driven by the recorded
input, and the outputs are linear in its states, the plant can be run again, in a loop
with a model of it.
"""

from dataclasses import dataclass

import control
import numpy as np

from .case import columns, fresh
from .signals import heard

EXACT = 1e-9  # of an output that is linear in the states, relative
CHECKED = 20  # samples, run again to see whether the recorded input drives the plant


@dataclass(frozen=True)
class Truth:
    """Hold a plant, and what its record reaches."""

    plant: control.NonlinearIOSystem  # in discrete time
    x0: np.ndarray  # the last state of a record, of shape (nx,)
    u_min: np.ndarray  # of shape (nu,)
    u_max: np.ndarray


def truth(case):
    """Return the plant of a case; None if its records do not tell its equations."""
    if getattr(case.load, "func", None) is not fresh:
        return None
    options = case.load.keywords
    with heard() as simulations:
        run = case.load.args[1]
        u, y = map(columns, run(np.random.default_rng(0), options.get("N", 2_000)))
    if len(simulations) != 1:
        return None
    update, law, X, _ = simulations[0]
    X, known = X[: len(u)], np.column_stack([X, np.ones(len(X))])[: len(u)]
    C, *_ = np.linalg.lstsq(known, y, rcond=None)
    if np.abs(known @ C - y).max() > EXACT * np.abs(y).max():
        return None
    # the recorded input is that of the plant, or of the plant with its controller
    ways = [update] if law is None else [update, lambda x, r: update(x, law(x, r))]
    for way in ways:
        if _is_driven(way, X[: CHECKED + 1], u):
            plant = _system(way, C, u.shape[1], options.get("dt", 1.0))
            return Truth(plant, X[-1], u.min(axis=0), u.max(axis=0))
    return None


def _is_driven(update, X, u):
    """Tell whether states follow from an input."""
    try:
        after = [
            update(x, v) for x, v in zip(X[:-1].tolist(), u.tolist(), strict=False)
        ]
    except (IndexError, ValueError):  # it has another number of inputs
        return False
    return bool(np.allclose(after, X[1:], rtol=0, atol=EXACT * np.abs(X).max()))


def _system(update, C, nu, dt):
    """Return x+ = update(x, u) with outputs linear in x as a system."""

    def moved(t, x, u, params):
        return np.array(update(x.tolist(), np.atleast_1d(u).tolist()))

    def output(t, x, u, params):
        return np.append(x, 1.0) @ C

    nx, ny = len(C) - 1, C.shape[1]
    return control.nlsys(moved, output, inputs=nu, outputs=ny, states=nx, dt=dt)

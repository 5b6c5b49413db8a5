"""Predictions over a horizon: a predictor that runs on alone (eq. horizon).

From the state that a predictor has at sample t, the model in free run gives

    y_t|t-1,  y_t+1|t-1,  ...,  y_t+k-1|t-1

without any y_m of these samples.  Each is another instance of the same equations
(`instances`), whose states are what the one before it has predicted and whose inputs
are those of a later sample.  So one Lur'e form with the same parameters has all k
predictions, stacked, in the place of y, and its record has later samples as further
columns: the criterion, its derivative and its compression stay what they are.
"""

from dataclasses import replace

import numpy as np

from .innovations import INNOVATION, LEVEL, MEASURED
from .instances import IDENTITY, instance, passed_on
from .mapping import Held
from .structures import Factor, Signal, Term

AHEAD = "y_ahead"  # the stack, and its axis


def ahead(structure, horizon):
    """Return a predictor with predictions over a horizon in the place of the output.

    Parameters
    ----------
    structure : Structure
        Predictor, of a model with innovations.
    horizon : int
        Number k of predictions.

    Returns
    -------
    structure : Structure
        The same parameters; the channel "y_ahead" of k ny predictions, the nearest
        first, stands where that of the output was, and the inputs of `later` samples
        behind the others. The structure itself for k = 1.
    """
    if horizon == 1:
        return structure
    y, runs = structure.measured, _running(structure)
    ny, chained = structure.sizes[y], [s for s in structure.updates if s != LEVEL]
    told = [axis for axis in structure.inputs if axis != MEASURED]
    sizes, layers = dict(structure.sizes), dict(structure.layers)
    signals, activations = dict(structure.signals), dict(structure.activations)
    constants, axes = dict(structure.constants), dict(structure.constant_axes)
    sizes[AHEAD], parts, inputs = horizon * ny, [y], []
    given = {axis: axis for axis in (*structure.updates, *told)}
    for j in range(horizon):
        tag = f"ahead{j}"
        if j:
            given |= {axis: f"{axis}@{tag}" for axis in told}
            inputs += [given[axis] for axis in told]
            sizes |= {given[axis]: structure.sizes[axis] for axis in told}
        one = instance(runs, tag, given)
        signals, layers = {**signals, **one.signals}, {**layers, **one.layers}
        sizes, activations = {**sizes, **one.sizes}, {**activations, **one.activations}
        if j:
            parts.append(f"{y}@{tag}")
        for state in chained:  # a random walk stays where it is
            given[state] = at = f"{state}@{tag}"
            layers[at] = passed_on(one.updates[state], at)
            sizes[at], activations[at] = structure.sizes[state], IDENTITY
    terms = []
    for j, part in enumerate(parts):
        name = f"S_ahead{j}"
        constants[name] = np.eye(horizon * ny, ny, -j * ny)
        axes[name] = AHEAD, y
        terms.append(Term(part, (Factor(name),)))
    stack = Signal((AHEAD,), (horizon * ny,), tuple(terms))
    return replace(
        structure,
        sizes=sizes,
        inputs=(*structure.inputs, *inputs),
        layers=layers,
        signals={AHEAD: stack, **signals},
        channels=tuple(AHEAD if c == y else c for c in structure.channels),
        constants=constants,
        constant_axes=axes,
        activations=activations,
    )


def _running(structure):
    """Return the equations of a predictor to which no output is told any more."""
    y = structure.signals[structure.measured]
    return replace(
        structure,
        inputs=tuple(axis for axis in structure.inputs if axis != MEASURED),
        signals={
            **structure.signals,
            MEASURED: Signal(y.axes, y.shape, (Term(structure.measured),)),
            INNOVATION: Signal(y.axes, y.shape),
        },
    )


def later(experiments, horizon):
    """Return the record of a predictor over a horizon.

    Parameters
    ----------
    experiments : sequence of tuple of array, or Held
        Pairs ([u, y_m], y) of scaled deviations.
    horizon : int
        Number k of predictions.

    Returns
    -------
    experiments : Held
        Pairs of the same length: inputs [u_t, y_m,t, u_t+1, ..., u_t+k-1] and outputs
        [y_t, ..., y_t+k-1], nan behind the end of an experiment.

    Notes
    -----
    Takes k times the memory of the record.
    """
    held = Held.of(experiments)
    if horizon == 1:
        return held

    def shifted(signal, j, fill):
        behind = np.broadcast_to(fill, (min(j, len(signal)), signal.shape[1]))
        return np.vstack([signal[j:], behind])

    wide = []
    for z, y in held:
        z, y = np.asarray(z[:]), np.asarray(y[:])
        u = z[:, : z.shape[1] - y.shape[1]]
        inputs = [shifted(u, j, u[-1:]) for j in range(1, horizon)]
        targets = [shifted(y, j, np.nan) for j in range(horizon)]
        wide.append((np.hstack([z, *inputs]), np.hstack(targets)))
    return Held(wide, held.n_jobs)

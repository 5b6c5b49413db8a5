"""Where the training of networks starts: at the linear model, networks at zero.

The output weights are zero, so that the start *is* the linear model; inner weights are
spread over what the data show: the pre-activation of a neuron has a random direction in
its (unit variance) inputs and is zero at a random sample.

A weight that is squared would stay at zero: that of an input begins where the input
acts as in the linear model, those of neurons small and different (eq. monotone).
"""

import numpy as np

from .simulation import simulate
from .structures import ONE, Diagonal

# Half and double have no clear advantage (`python -m benchmarks.constants
# INITIAL_SLOPE`): of 8 fits of 4 plants, the test errors relative to those with this
# one have the median 0.97 and the worst 1.21 with 0.5, and 0.97 and 1.84 with 2.
INITIAL_SLOPE = 1.0  # standard deviation of a pre-activation over the record
# Range of squared weights. With all at 0.1, 5 of 6 fits of plants with a valve, a fan,
# an exchanger and a magnet ended at 1.2 to 11 times the test error, one at 0.7. Half
# and double have no clear advantage (`python -m benchmarks.constants INITIAL_ROOTS`):
# of 6 fits of 3 plants, the errors have the median 1.26 and the worst 1.74 with half,
# and 1.05 and 2.89 with double.
INITIAL_ROOTS = 0.1, 0.6
START_SAMPLES = 100_000  # of an experiment, over which inner weights are spread


def initial_theta(structure, linear, experiments, rng, bounds=None, roots=None):
    """Return a start: the linear model plus networks of zero output.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    linear : LinearModel
        Linear start; its C is that of the structure, a constant or a parameter.
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    rng : numpy.random.Generator
        Source of the inner weights.
    bounds : dict of str to tuple of ndarray, or None, default=None
        Bounds of parameters by name: inner weights that they hold are zero, and what
        a neuron sees of the others has the whole slope.
    roots : tuple of two floats or None, default=None
        Range of the squared weights in front of neurons; None is 0.1 to 0.6, and (0, 0)
        exactly the linear model, from which they would not move.

    Returns
    -------
    theta : ndarray of shape (n_params,)
        Flat parameters.
    """
    p = linear.by_name(structure.given)  # an input may be none of the records
    for name, missing in _squared(structure).items():  # before u is to act on x
        shape = structure.shapes[name]
        if missing is None:
            p[name] = rng.uniform(*(roots or INITIAL_ROOTS), shape)
        else:
            p[name] = np.full(shape, np.sqrt(missing))
    pick = rng.integers(len(experiments))
    u, y = (signal[:START_SAMPLES] for signal in experiments[pick])
    shown = _Shown(structure, p, linear, u, y, linear.starts(structure.given)[pick])
    for axis in structure.neurons:
        inner, biases = _first_layer(structure, axis, p)
        if not inner:
            continue
        size = structure.sizes[axis]
        samples = rng.integers(len(u), size=size)
        free = {name: _free_weights(structure, name, bounds or {}) for name in inner}
        width = sum(weights.any(axis=0).sum() for weights in free.values())
        bias = np.zeros(size)
        for name, terms in inner.items():
            shape = structure.shapes[name]
            scale = INITIAL_SLOPE / np.sqrt(max(width, 1))
            p[name] = rng.normal(scale=scale, size=shape) * free[name]
            seen = sum(shown.behind(term, 1, samples) for term in terms)
            bias -= np.sum(p[name] * seen, axis=1)
        p |= dict.fromkeys(biases, bias)
    return structure.join(p)


class _Shown:
    """Show the values of every axis at samples of a simulation; p may still grow."""

    def __init__(self, structure, p, linear, u, y, x0):
        self.structure, self.p = structure, p
        lure, first = structure.lure(structure.join(p)), structure.nx
        X = simulate(lure, u, structure.initial_state(x0))[:-1]
        if not np.isfinite(X).all():  # an unstable start still has to begin somewhere
            X = np.zeros_like(X)
        y_hat = X[:, : len(linear.A)] @ linear.C.T + u @ linear.D.T
        self.signals = {
            ONE: np.ones((len(u), 1)),
            **{axis: X[:, structure.cols[axis]] for axis in structure.states},
            structure.measured: np.where(np.isnan(y), y_hat, y),
        }
        for axis in structure.inputs:
            where = structure.cols[axis]
            self.signals[axis] = u[:, where.start - first : where.stop - first]

    def behind(self, term, first, samples):
        """Return what stands in a term behind its first factors."""
        structure = self.structure
        q = {**structure.constants, **structure.split(structure.join(self.p))}
        value = self._columns(term.cols, samples).T
        for factor in reversed(term.factors[first:]):
            value = factor.value(q) @ value
        return term.gain * value.T

    def _columns(self, axis, samples):
        if axis in self.signals:
            return self.signals[axis][samples]
        structure, is_layer = self.structure, axis in self.structure.layers
        terms = (structure.layers if is_layer else structure.signals)[axis].terms
        v = sum(self.behind(term, 0, samples) for term in terms)
        return structure.activation(axis).value(v) if is_layer else v


def _first_layer(structure, axis, p):
    """Return the terms of weights of neurons that p has not yet, and their biases."""
    inner: dict[str, list] = {}
    biases = []
    for term in structure.layers[axis].terms:
        name = structure.leading(term)
        if name is None or name in p:  # weights may be shared by several layers
            continue
        if len(structure.shapes[name]) == 2:
            inner.setdefault(name, []).append(term)
        else:
            biases.append(name)
    return inner, biases


def _squared(structure):
    """Return weights that stand as diag(r)^2, and what r^2 of an input has to add."""
    found: dict[str, float | None] = {}
    for signal in structure.signals.values():
        for term in signal.terms:
            for first, second in zip(term.factors, term.factors[1:], strict=False):
                if first == second and type(first) is Diagonal:
                    found[first.name] = None
                    if term.cols in structure.inputs:
                        others = sum(
                            other.gain
                            for other in signal.terms
                            if other.cols == term.cols
                            and other.factors == term.factors[2:]
                        )
                        # the signal is v itself, or what it has beside u
                        found[first.name] = -others if others < 0 else 1.0 - others
    return found


def _free_weights(structure, name, bounds):
    """Return which weights of a layer no equal bounds hold."""
    low, high = bounds.get(name, (-np.inf, np.inf))
    return np.broadcast_to(np.not_equal(low, high), structure.shapes[name])

"""The input that takes a loop farthest from its linear design, within an amplitude.

A lower bound of what certificates bound from above.  The distance at the last sample is
a function of all inputs before; its gradient comes from the adjoint of the linearized
loop.  At a maximum over a box every input is at one of its limits, unless its
derivative vanishes, so that a step takes inputs to the limits that the gradient points
to: those that gain most, or all of them part of the way.  It starts from the inputs
that take the linear responses of outputs, states and neurons to their peaks, and from
regular and random switching.
"""

from itertools import islice
from operator import itemgetter

import numpy as np

from ..lure import Lure
from ..simulation import channels, neuron_gains, regressors, simulate

SHORTEST, LONGEST = 100, 1_500  # samples of an input
RANDOM = 12  # random starts
WAVES = (
    16  # square waves and as many sines, of periods from 2 samples to the whole length
)
REFINED = 5  # starts that are improved, the farthest ones, for every output
STEPS = 30
SOLVED = 100, 1, 3, 16  # the same where a law is solved, which is slow; and starts
SHARES = (1, 2, 4, 8, 16, 32, 64)  # of the samples, one in so many that change at once
LEAST_GAIN = 1e-5  # relative gain of a step that goes on
_first = itemgetter(0)


def worst_input(lure, design, amplitude, length, seed=0):
    """Search the input that makes ``|y - y_lin|`` large.

    Parameters
    ----------
    lure : Lure
        Loop from r to its channels, of which the first are y; deviations.
    design : tuple of ndarray
        (A, B, C, D) of the linear design.
    amplitude : ndarray of shape (nr,)
        Largest modulus of every input.
    length : int
        Samples that the design remembers.
    seed : int, default=0
        Seed of the random starts.

    Returns
    -------
    found : ndarray of shape (ny,)
        Largest distance of every output; inf if the loop diverges.
    r : ndarray of shape (N, nr)
        Input that makes the largest of all, relative to what the design may do.
    """
    longest, refined, steps, n_starts = LONGEST, REFINED, STEPS, None
    if lure.implicit:
        longest, refined, steps, n_starts = SOLVED
    n = int(np.clip(length, SHORTEST, longest))
    pair = _Pair(lure, design, amplitude, n)
    starts = islice(pair.starts(np.random.default_rng(seed)), n_starts)
    tried = [(pair.distance(r), r) for r in starts]
    found, worst = np.zeros(pair.ny), None
    for output in range(pair.ny):
        tried.sort(key=lambda one: -one[0][:, output].max())
        results = []
        for e, r in tried[:refined]:
            if not np.isfinite(e).all():
                return np.full(pair.ny, np.inf), r
            last = int(e[:, output].argmax())
            results.append(pair.improve(r, last, output, steps))
        value, r = max(results, key=_first)
        if worst is None or value > found.max():
            worst = r
        found[output] = max(found[output], value)
        found = np.maximum(found, pair.distance(r).max(axis=0))
    return found, worst


class _Pair:
    """Hold a loop and its design, and run them with the same input."""

    def __init__(self, lure, design, amplitude, n):
        self.lure, self.design, self.amplitude, self.n = lure, design, amplitude, n
        A, B, C, D = design
        rows = np.block([[A, B], [C, D]])
        Theta = np.column_stack([rows, np.zeros(len(rows))])
        self.linear = Lure(Theta, len(A), B.shape[1], 0)
        self.ny = len(C)

    def distance(self, r):
        """Return ``|y - y_lin|`` of every sample, inf where the loop diverges."""
        with np.errstate(all="ignore"):  # a loop may diverge
            y, y_lin = (
                channels(form, _states(form, r), r)[:, : self.ny]
                for form in (self.lure, self.linear)
            )
            e = np.abs(y - y_lin)
        return np.where(np.isfinite(e), e, np.inf)

    def starts(self, rng):
        """Yield inputs: constants, peaks of linear responses, switching."""
        A, B, C, _ = self.design
        rows = [C]
        if len(A) == self.lure.nx:
            rows += [np.eye(len(A)), self.lure.V[:, : self.lure.nx]]
        constant = np.ones((self.n, len(self.amplitude))) * self.amplitude
        yield from (constant, -constant)
        responses = np.empty((self.n, len(np.vstack(rows)), B.shape[1]))
        X = B
        for k in range(self.n):
            responses[-1 - k] = np.vstack(rows) @ X
            X = A @ X
        for response in np.moveaxis(responses, 1, 0):
            r = np.where(response >= 0, self.amplitude, -self.amplitude)
            yield from (r, -r)
        for half in np.unique(np.geomspace(1, self.n / 2, WAVES).astype(int)):
            signs = (-1.0) ** (np.arange(self.n) // half)
            yield signs[:, None] * self.amplitude
            wave = np.sin(np.pi * np.arange(self.n) / half)
            yield wave[:, None] * self.amplitude
        for _ in range(RANDOM):
            hold = int(rng.integers(1, max(2, self.n // 8)))
            levels = rng.choice([-1.0, 1.0], size=(self.n // hold + 1, B.shape[1]))
            yield np.repeat(levels, hold, axis=0)[: self.n] * self.amplitude

    def improve(self, r, last, output, steps):
        """Return a local maximum of the distance at the last sample, and its input."""
        until = r[: last + 1]  # its farthest sample is the last one
        long = np.vstack([np.zeros((len(r) - 1 - last, r.shape[1])), until])
        ways = [self._ascent(long, output, steps)]
        if self.distance(until)[-1, output] > ways[0][0]:  # a rest that does not last
            ways.append(self._ascent(until, output, steps))
        return max(ways, key=_first)

    def _ascent(self, r, output, steps):
        """Return what steps along the gradient reach, and the input."""
        value = self.distance(r)[-1, output]
        for _ in range(steps):
            gradient = self._gradient(r, output)
            full = np.where(gradient >= 0, self.amplitude, -self.amplitude)
            gain = np.sum(gradient * (full - r), axis=1)
            order = np.argsort(-gain)
            best, chosen = value, None
            for share in SHARES:  # some samples all the way, or all part of the way
                change = order[: -(-len(order) // share)]
                jump = r.copy()
                jump[change] = full[change]
                ways = [jump, r + (full - r) / share]
                values = [self.distance(way)[-1, output] for way in ways]
                reached, tried = max(zip(values, ways, strict=True), key=_first)
                if reached > best:
                    best, chosen = reached, tried
            if chosen is None or not np.isfinite(best):
                return (value, r) if chosen is None else (best, chosen)
            small = best - value <= LEAST_GAIN * best
            value, r = best, chosen
            if small:
                break
        return value, r

    def _gradient(self, r, output):
        """Return the derivative of the distance at the last sample by all inputs."""
        (y, by_loop), (y_lin, by_design) = (
            _adjoint(form, _states(form, r), r, output)
            for form in (self.lure, self.linear)
        )
        return np.sign(y - y_lin) * (by_loop - by_design)


def _states(form, r):
    """Return the states of a form from rest, not finite where it diverges."""
    return simulate(form, r, np.zeros(form.nx), np.inf)[:-1]


def _adjoint(lure, X, r, output):
    """Return an output at the last sample and its derivative by all inputs."""
    nx = lure.nx
    Phi = regressors(lure, X, r)
    J = np.broadcast_to(lure.M, (len(r), *lure.M.shape))
    if lure.nw:
        J = J + neuron_gains(lure, lure.W, Phi) @ lure.V
    y = float(Phi[-1] @ lure.rows_z[output])
    gradient = np.empty_like(r)
    row = J[-1, nx + output]
    gradient[-1], row = row[nx:], row[:nx]
    for k in range(len(r) - 2, -1, -1):
        row = row @ J[k, :nx]
        gradient[k], row = row[nx:], row[:nx]
    return y, gradient

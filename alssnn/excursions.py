"""Excursions: what a model does under inputs that its record does not have.

A record says nothing of larger inputs, and little of those that are held for longer.
There, a network may have a second attractor that no hidden sample speaks against.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .simulation import outputs, regressors, simulate

LARGER = 1.25  # inputs over those of the record, with which a simulation has to stay
NEAR = 3.0  # outputs over the largest of the record
SETTLED = 0.01  # what a linear model has kept of its state, when held inputs change
LONGEST = 1_000  # samples for which inputs are held, at most
LEVELS = (0.1, 0.3, 0.5, 0.7, 0.9)  # quantiles of an input that are held
APART = 1.0  # standard deviations of an output between two places to rest
# The same by which they may move apart in a training. A default AlSsnn of the plant
# "collector" of `benchmarks.field`, seed 2, had moved them by 0.64, and was worse than
# the linear model on a fresh record.
OPENED = 0.5


def settling(A):
    """Return for how many samples inputs are held (eq. latch).

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix of the linear model of a record.

    Returns
    -------
    n_held : int
        Until its slowest mode has come down to a hundredth, a thousand at most.
    """
    radius = np.abs(np.linalg.eigvals(A)).max(initial=0.0)
    radius = np.clip(radius, SETTLED, SETTLED ** (1 / LONGEST))
    return min(int(np.ceil(np.log(SETTLED) / np.log(radius))), LONGEST)


@dataclass(frozen=True)
class Excursion:
    """Ask models of a record where inputs take them that it does not have.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.
    n_held : int
        Samples for which every input is held (`settling`).
    apart : ndarray of shape (ny,)
        Largest distance of two places where the linear model is (`apart`, `away`): a
        slow one has not come to rest.
    larger : ndarray of shape (nu, 2)
        Deviations of inputs that are held over those of the record (`within_reach`).

    Examples
    --------
    >>> import numpy as np
    >>> from alssnn.excursions import Excursion
    >>> from alssnn.linear_model import LinearModel
    >>> u = np.sin(np.arange(100.0))[:, None]
    >>> B, C, D = np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1))
    >>> linear = LinearModel(np.array([[0.5]]), B, C, D, np.zeros((1, 1)))
    >>> Excursion.beside(linear, [(u, u)]).n_held
    7
    """

    experiments: Sequence
    n_held: int
    apart: np.ndarray
    larger: np.ndarray

    @classmethod
    def beside(cls, linear, experiments):
        """Return the excursion of a record that a linear model explains.

        Parameters
        ----------
        linear : LinearModel
            The model.
        experiments : sequence of tuple of array
            Pairs (u, y) of scaled deviations.

        Returns
        -------
        excursion : Excursion
            The one.
        """
        structure, theta, fit = linear.as_fit()
        n_held = settling(linear.A)
        larger = within_reach(structure, theta, experiments, n_held)
        plain = cls(experiments, n_held, np.zeros(structure.sizes["y"]), larger)
        return replace(plain, apart=plain.gap(structure, theta, fit.x0))

    def leads(self, structure, theta, x0):
        """Tell whether a model goes where nothing was measured, by one of two ways.

        Parameters
        ----------
        structure : Structure
            Structure of the model, y its first channel.
        theta : ndarray of shape (n_params,)
            Its parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states of the experiments.

        Returns
        -------
        leads : bool
            Whether it escapes (eq. escape) or latches (eq. latch, away).
        """
        its = structure, theta, x0
        return escapes(*its, self.experiments) or self.latches(*its)

    def latches(self, structure, theta, x0):
        """Tell whether one input leads a model to two places (eq. latch, away).

        Parameters
        ----------
        structure : Structure
            Structure of the model, y its first channel.
        theta : ndarray of shape (n_params,)
            Its parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states of the experiments.

        Returns
        -------
        latches : bool
            Whether an output remembers what the inputs were, by more than its standard
            deviation, and by more than the linear model does.
        """
        return not np.all(self.gap(structure, theta, x0) <= APART + self.apart)

    def gap(self, structure, theta, x0):
        """Return how far apart two places are where one input leads (eq. latch, away).

        Parameters
        ----------
        structure : Structure
            Structure of the model, y its first channel.
        theta : ndarray of shape (n_params,)
            Its parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states of the experiments.

        Returns
        -------
        gap : ndarray of shape (ny,)
            Largest difference of every output, in standard deviations.
        """
        its = structure, theta, x0, self.experiments
        return np.fmax(apart(*its, self.n_held, self.larger), away(*its))

    def opens(self, structure, before, after):
        """Tell whether a training has moved two places to rest apart (eq. opened).

        Parameters
        ----------
        structure : Structure
            Structure of the model, y its first channel.
        before, after : OptimizeResult
            Parameters `theta` and initial states `x0`.

        Returns
        -------
        opens : bool
            Whether an output remembers more than before, by half its standard
            deviation.
        """
        first, last = (self.gap(structure, z.theta, z.x0) for z in (before, after))
        return not np.all(last <= np.maximum(first, self.apart) + OPENED)


def escapes(structure, theta, x0, experiments):
    """Tell whether larger inputs take a model far from its record (eq. escape).

    Parameters
    ----------
    structure : Structure
        Structure of the model, y its first channel.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states of the experiments.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.

    Returns
    -------
    escapes : bool
        Whether an output deviates from its mean by three times what it ever does in the
        record, while inputs deviate by a quarter more.
    """
    lure, ny = structure.lure(theta), structure.sizes["y"]
    y = np.vstack([y[:] for _, y in experiments])
    y_mean = np.nanmean(y, axis=0)
    # a constant output may move by its unit
    bound = NEAR * np.maximum(np.nanmax(np.abs(y - y_mean), axis=0), 1.0)
    for u, start in zip(_larger(experiments), x0, strict=True):
        with np.errstate(over="ignore", invalid="ignore"):
            y_hat = outputs(lure, u, structure.initial_state(start))[:, :ny]
        if not np.all(np.abs(y_hat - y_mean) <= bound):
            return True
    return False


def away(structure, theta, x0, experiments):
    """Return how far from its simulation a model stays behind larger ones (eq. away).

    Parameters
    ----------
    structure : Structure
        Structure of the model, y its first channel.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states of the experiments.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    away : ndarray of shape (ny,)
        Largest difference of an output in the second half of an experiment that begins
        where larger inputs have taken the model. inf where a simulation diverges.
    """
    lure, ny = structure.lure(theta), structure.sizes["y"]
    largest = np.zeros(ny)
    inputs = zip(experiments, _larger(experiments), x0, strict=True)
    for (u, _), larger, start in inputs:
        start = structure.initial_state(start)
        with np.errstate(over="ignore", invalid="ignore"):
            moved = simulate(lure, larger, start)[-1]
            own, other = (
                outputs(lure, u[:], x)[len(larger) // 2 :, :ny] for x in (start, moved)
            )
            found = np.abs(other - own).max(axis=0)
        largest = np.fmax(largest, np.where(np.isnan(found), np.inf, found))
    return largest


def _larger(experiments):
    """Return the inputs of all experiments, a quarter further from their mean."""
    mean = np.vstack([u[:] for u, _ in experiments]).mean(axis=0)
    return [mean + LARGER * (u[:] - mean) for u, _ in experiments]


def within_reach(structure, theta, experiments, n_held):
    """Return how much larger inputs may be held (eq. reach).

    Parameters
    ----------
    structure : Structure
        Structure of a linear model, y its first channel.
    theta : ndarray of shape (n_params,)
        Its parameters.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    n_held : int
        Samples for which an input is held.

    Returns
    -------
    larger : ndarray of shape (nu, 2)
        Deviation of the least and the largest value of every input, over that of the
        record: a quarter more, or less where this would take an output of the linear
        model more than a quarter beyond those of the record.
    """
    lure, ny = structure.lure(theta), structure.sizes["y"]
    u = np.vstack([u[:] for u, _ in experiments])
    y = np.vstack([y[:] for _, y in experiments])
    rest = structure.initial_state(np.zeros(structure.n_x0))
    furthest = np.nanmax(np.abs(y - np.nanmean(y, axis=0)), axis=0)
    furthest = np.maximum(furthest, 1.0)  # a constant output may move by its unit

    def larger(extreme):
        held = np.repeat([extreme - u.mean(axis=0)], n_held, axis=0)
        moved = np.abs(outputs(lure, held, rest)[:, :ny]).max(axis=0)
        return LARGER / max(1.0, *(moved / furthest))

    rows = [u[[np.argmin(u_j), np.argmax(u_j)]] for u_j in u.T]
    return np.array([[larger(extreme) for extreme in pair] for pair in rows])


def apart(structure, theta, x0, experiments, n_held, larger):
    """Return how far apart two places are where a model comes to (eq. latch).

    Parameters
    ----------
    structure : Structure
        Structure of the model, y its first channel.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, n_x0)
        Initial states of the experiments.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    n_held : int
        Samples for which every input is held.
    larger : ndarray of shape (nu, 2)
        Deviations of the least and the largest value of every input from its mean, over
        those of the record.

    Returns
    -------
    apart : ndarray of shape (ny,)
        Largest difference of an output, while inputs are held at five values of the
        record: up from the least one, and down from the largest. inf where the
        simulation diverges.
    """
    lure, ny = structure.lure(theta), structure.sizes["y"]
    start = structure.initial_state(x0[0])
    u = np.vstack([u[:] for u, _ in experiments])
    mean = u.mean(axis=0)

    def rests(first, factor, levels):
        held = np.repeat([mean + factor * (first - mean), *levels], n_held, axis=0)
        last = slice(2 * n_held - 1, None, n_held)
        Phi = regressors(lure, simulate(lure, held, start)[:-1][last], held[last])
        return Phi @ lure.rows_z[:ny].T

    largest = np.zeros(ny)
    for u_j, (below, above) in zip(u.T, larger, strict=True):
        order = np.argsort(u_j, kind="stable")
        levels = u[order[[int(level * (len(order) - 1)) for level in LEVELS]]]
        with np.errstate(over="ignore", invalid="ignore"):
            up = rests(u[order[0]], below, levels)
            down = rests(u[order[-1]], above, levels[::-1])[::-1]
            found = np.abs(up - down).max(axis=0)
        largest = np.fmax(largest, np.where(np.isnan(found), np.inf, found))
    return largest

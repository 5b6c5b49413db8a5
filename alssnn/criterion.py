"""The cost, its Gauss-Newton matrix and its exact compression.

The cost of one model over several experiments (eq. cost)

    J_N = 1/N sum_k ( |y_k - yhat_k|^2 + gamma |g_k|^2 + gamma_k |k_k|^2 )
          + alpha |theta_net - center|^2

is |r|^2 for the stacked residual r = weights * (z - target), where the target of the
first channel is the record and that of every other one, a penalty, is zero.  Outputs
that were not measured are nan in the record: their residual is zero, and N counts the
others.
r has (N nz) rows, too many to store; `least_squares` uses r and its Jacobian J only
through |r|, J'r and J'J, so it is handed an equivalent problem of n + 1 rows
(eq. compress):

    fun  = [|r|, 0, ..., 0],    jac = [a'; L'],    a = J'r / |r|,  L L' = J'J - a a'

Same cost, same gradient, same Gauss-Newton matrix, hence the same iterates
(`compression`).

The free vector is [theta; x0 of experiment 1; x0 of experiment 2; ...].  An
experiment contributes sums over its samples (`contribution`), taken chunk by chunk from
slices of the record: it may live on disk or on another machine, and experiments may be
summed in parallel (`mapping`).
"""

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import replace
from functools import partial
from operator import add

import numpy as np

from .compression import compress
from .contribution import Arrow, Contribution, Pulled
from .mapping import Held

DIVERGED_NORM = 1e100  # |r| of a diverged trial: finite, so that lm and trf reject it


class LeastSquares(ABC):
    """Compress what `norm` and `normal_equations` return for `least_squares`."""

    @abstractmethod
    def norm(self, free):
        """Return |r|.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        norm : float
            Norm of the residual.
        """

    @abstractmethod
    def normal_equations(self, free):
        """Return J'J, J'r and |r|.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        JJ : ndarray of shape (n, n)
            Gauss-Newton matrix.
        Jr : ndarray of shape (n,)
            Half the gradient of |r|^2.
        norm : float
            Norm of the residual.
        """

    def mean_squares(self, free):  # numpydoc ignore=PR01,RT01
        """Return errors of outputs, (ny,), all of weight one; zero if unknown."""
        return 0.0

    def pulled(self, at, after):  # numpydoc ignore=PR01
        """Return J'(r_2 - r_1) for the residuals at two points, (n,).

        J belongs to the first point. None says that it is not known, nan that a
        simulation diverges.
        """
        return None

    def fun(self, free):
        """Return the compressed residual [|r|, 0, ..., 0] (eq. compress).

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        residual : ndarray of shape (n + 1,)
            Compressed residual.
        """
        residual = np.zeros(len(free) + 1)
        residual[0] = self.norm(free)
        return residual

    def jac(self, free):
        """Return the compressed Jacobian [a'; L'] (eq. compress).

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        jacobian : ndarray of shape (n + 1, n)
            Compressed Jacobian.
        """
        return compress(*self.normal_equations(free))


class Criterion(LeastSquares):
    """Evaluate |r|, J'r and J'J of a structure over experiments.

    Parameters
    ----------
    structure : Structure
        Map from parameters to the Lur'e form; its first channel is what was measured.
    experiments : sequence of tuple of array, Held or Remote
        Pairs (u, y) of shapes (N_i, nu) and (N_i, ny), scaled deviations; only sliced.
        Outputs that were not measured are nan.
    weights : dict of str to float or ndarray, or None, default=None
        Weight of the square of every channel by its name, such as
        ``{"y": [1.0, 0.5], "g": 0.01}``; None means one, for a measured channel alone.
    alpha : float, default=0.0
        Weight of the squared network parameters.
    center : ndarray of shape (n_params,) or None, default=None
        Parameters from which that weight pulls away as little as possible; None means
        zero. Around the random start of a network it leads to the linear model, while
        around zero it takes the inner weights, too, and with them the gradient.
    chunk : int or None, default=None
        Samples per chunk of the sensitivities; None fits the cache.
    n_jobs : int or None, default=None
        Experiments of a sequence summed in parallel threads, as in joblib; one
        experiment alone takes two threads, one for its derivatives and both for their
        squares. The result does not depend on it.
    periodic : bool, default=False
        Whether every experiment is one period of what repeats itself: its initial state
        is the periodic one (eq. steady), and that of the free vector has no effect.

    Attributes
    ----------
    n : int
        Length of the free vector: ``n_params + n_experiments * n_x0``.
    n_samples : int
        Number of samples over all experiments.

    Raises
    ------
    ValueError
        If a channel has no weight, or a weight no channel.
    """

    def __init__(
        self,
        structure,
        experiments,
        *,
        weights=None,
        alpha=0.0,
        center=None,
        chunk=None,
        n_jobs=None,
        periodic=False,
    ):
        self.structure = structure
        self.periodic = periodic
        self.experiments = Held.of(experiments, n_jobs)
        self.n_samples = self.experiments.n_samples
        self.n = structure.n_params + len(self.experiments) * structure.n_x0
        square = _by_channel(structure, weights)
        ny = structure.sizes[structure.channels[0]]
        n_measured = self.experiments.n_measured / ny
        N = np.where(np.arange(structure.nz) < ny, max(n_measured, 1), self.n_samples)
        n_jobs = getattr(self.experiments, "n_jobs", n_jobs)
        pipelined = len(self.experiments) == 1 and n_jobs not in (None, 1)
        self.one = Contribution(
            structure, np.sqrt(square / N), chunk, pipelined, periodic
        )
        self.decay = np.zeros(self.n)  # square roots of the L2 weights
        for name in structure.network_parameters:
            self.decay[structure.slices[name]] = np.sqrt(alpha)
        self.center = np.zeros(self.n)
        if center is not None:
            self.center[: structure.n_params] = center
        self._memo: tuple = (None, 0.0)  # last free vector and its norm

    def holding(self, held):
        """Return the same criterion without derivatives by some parameters.

        Parameters
        ----------
        held : ndarray of bool of shape (n_params,)
            Parameters whose entries of J'J and J'r are wanted by nobody.

        Returns
        -------
        criterion : Criterion
            Those are zero, but for the decay, and cost no time.
        """
        if not held.any():
            return self
        other = copy(self)
        other.one = replace(self.one, free=~held)
        return other

    # -- the free vector -----------------------------------------------------------

    def join(self, theta, x0):
        """Return the free vector for theta and one initial state per experiment.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states.

        Returns
        -------
        free : ndarray of shape (n,)
            The free vector.
        """
        return np.concatenate([theta, np.ravel(x0)])

    def split(self, free):
        """Return theta and the initial states in a free vector, as views.

        Parameters
        ----------
        free : ndarray of shape (n,)
            The free vector.

        Returns
        -------
        theta : ndarray of shape (n_params,)
            Parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states.
        """
        n_params = self.structure.n_params
        n_x0 = self.structure.n_x0
        return free[:n_params], free[n_params:].reshape(len(self.experiments), n_x0)

    def initial_states(self, theta, x0):
        """Return the initial states that the simulations begin with.

        Parameters
        ----------
        theta : ndarray of shape (n_params,)
            Parameters.
        x0 : ndarray of shape (n_experiments, n_x0)
            Initial states of the free vector.

        Returns
        -------
        x0 : ndarray of shape (n_experiments, n_x0)
            The same, or the periodic ones.
        """
        if not self.periodic:
            return x0
        return np.stack(self.experiments.map(partial(self.one.initial, theta), x0))

    # -- values ----------------------------------------------------------------------

    def norm(self, free):
        """Return |r|, or `DIVERGED_NORM` where the simulation diverges.

        Parameters
        ----------
        free : ndarray of shape (n,)
            The free vector.

        Returns
        -------
        norm : float
            Root of the cost J_N (eq. cost).
        """
        if self._memo[0] is None or not np.array_equal(free, self._memo[0]):
            square = float(np.sum((self.decay * (free - self.center)) ** 2))
            theta, x0 = self.split(free)
            value = partial(self.one.square, theta)
            square += self.experiments.reduce(value, add, x0)
            # "not <": nan means diverged
            norm = np.sqrt(square) if square < DIVERGED_NORM**2 else DIVERGED_NORM
            self._memo = (np.array(free), float(norm))
        return self._memo[1]

    def mean_squares(self, free):  # numpydoc ignore=PR01,RT01
        """Return errors of outputs, (ny,), all of weight one."""
        theta, x0 = self.split(free)
        sums, n = self.experiments.reduce(partial(self.one.squares, theta), add, x0)
        return sums / np.maximum(n, 1)

    def normal_equations(self, free):
        """Return J'J, J'r and |r|, accumulated chunk by chunk.

        Parameters
        ----------
        free : ndarray of shape (n,)
            The free vector.

        Returns
        -------
        JJ : ndarray of shape (n, n)
            Gauss-Newton matrix.
        Jr : ndarray of shape (n,)
            Half the gradient of the cost.
        norm : float
            Norm of the residual.

        Raises
        ------
        FloatingPointError
            If the simulation diverges, or its sensitivities do.
        """
        n_params, n_x0 = self.structure.n_params, self.structure.n_x0
        theirs = np.arange(n_params)
        if self.one.free is not None:
            theirs = theirs[self.one.free]
        away = self.decay * (free - self.center)
        JJ, Jr, square = np.diag(self.decay**2), self.decay * away, float(away @ away)
        theta, x0 = self.split(free)
        arrow = self.experiments.reduce(
            partial(self.one.arrow, theta), Arrow.merge, range(len(x0)), x0
        )
        JJ[np.ix_(theirs, theirs)] += arrow.head
        Jr[theirs] += arrow.head_r
        for i, (rows, rows_r) in arrow.borders.items():
            own = n_params + i * n_x0 + np.arange(n_x0)
            border, corner = np.split(rows, [len(theirs)], axis=1)
            JJ[np.ix_(own, theirs)] += border
            JJ[np.ix_(theirs, own)] += border.T
            JJ[np.ix_(own, own)] += corner
            Jr[own] += rows_r
        return JJ, Jr, float(np.sqrt(square + arrow.square))

    def pulled(self, at, after):
        """Return J'(r_2 - r_1) for the residuals at two points.

        Parameters
        ----------
        at, after : ndarray of shape (n,)
            Free vectors; J belongs to the first one.

        Returns
        -------
        pulled : ndarray of shape (n,)
            The product; nan if a simulation diverges.
        """
        points = [self.split(free) for free in (at, after)]
        thetas, x0 = zip(*points, strict=True)
        found = self.experiments.reduce(
            partial(self.one.pulled, thetas),
            Pulled.merge,
            range(len(self.experiments)),
            np.stack(x0, axis=1),
        )
        pulled = self.decay**2 * (after - at)
        by_theta, by_x0 = self.split(pulled)  # views
        by_theta += found.by_theta
        for i, part in found.by_x0.items():
            by_x0[i] += part
        if self.one.free is not None:
            by_theta[~self.one.free] = 0.0
        return pulled


def _by_channel(structure, weights):
    """Return the weight of every entry of z."""
    channels = structure.channels
    weights = {channels[0]: 1.0} if weights is None else weights
    if set(weights) != set(channels):
        raise ValueError(
            f"`weights` must have one for each of the channels {', '.join(channels)}, "
            f"got {', '.join(weights) or 'none'}. `Structure.observe` takes others."
        )
    sizes = structure.sizes
    return np.concatenate([np.broadcast_to(weights[c], sizes[c]) for c in channels])


class Mapped(LeastSquares):
    """Evaluate a criterion at what a free vector stands for.

    Attributes
    ----------
    criterion : LeastSquares
        Criterion.
    """

    criterion: LeastSquares

    @abstractmethod
    def to_free(self, free):
        """Return the free vector of the criterion.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector of this one.

        Returns
        -------
        free : ndarray of shape (n_whole,)
            Free vector of the criterion.
        """

    def pullback(self, free):
        """Return the transposed derivative of `to_free`, by default the identity.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector of this one.

        Returns
        -------
        pull : callable
            Maps ndarray of shape (n_whole, ...), which it may change, to (n, ...).
        """
        return lambda sums: sums

    def norm(self, free):  # numpydoc ignore=PR01,RT01
        """Return |r|."""
        return self.criterion.norm(self.to_free(free))

    def mean_squares(self, free):  # numpydoc ignore=PR01,RT01
        """Return errors of outputs, (ny,), all of weight one."""
        return self.criterion.mean_squares(self.to_free(free))

    def normal_equations(self, free):  # numpydoc ignore=PR01,RT01
        """Return J'J, J'r and |r|."""
        JJ, Jr, norm = self.criterion.normal_equations(self.to_free(free))
        pull = self.pullback(free)
        return pull(pull(JJ).T).T, pull(Jr), norm

    def pulled(self, at, after):  # numpydoc ignore=PR01,RT01
        """Return J'(r_2 - r_1) for the residuals at two points."""
        found = self.criterion.pulled(self.to_free(at), self.to_free(after))
        return None if found is None else self.pullback(at)(found)


class Restricted(Mapped):
    """Restrict a criterion to some entries of the free vector.

    Parameters
    ----------
    criterion : Criterion
        Criterion of the whole vector.
    free : ndarray of shape (n,)
        Values of the entries that are held.
    mask : ndarray of bool of shape (n,)
        Entries that stay free.
    """

    def __init__(self, criterion, free, mask):
        self.criterion = criterion
        self.held = np.array(free, dtype=float)
        self.mask = mask

    def to_free(self, part):
        """Return the whole free vector.

        Parameters
        ----------
        part : ndarray of shape (n_free,)
            Entries that are free.

        Returns
        -------
        free : ndarray of shape (n,)
            The free vector.
        """
        free = self.held.copy()
        free[self.mask] = part
        return free

    def pullback(self, _):  # numpydoc ignore=PR01,RT01
        """Return what takes the free entries alone."""
        return lambda sums: sums[self.mask]

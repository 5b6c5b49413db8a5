"""The cost, its Gauss-Newton matrix and its exact compression.

The cost of one model over several experiments (eq. cost)

    J_N = 1/N sum_k ( |y_k - yhat_k|^2 + gamma |g_k|^2 ) + alpha |theta_net|^2

is |r|^2 for the stacked residual r = weights * (z - target), where the target of y
is the record and that of every penalized channel is zero.  r has (N nz) rows, too
many to store; `least_squares` uses r and its Jacobian J only through |r|, J'r and
J'J, so it is handed an equivalent problem of n + 1 rows (eq. compress):

    fun  = [|r|, 0, ..., 0],    jac = [a'; L'],    a = J'r / |r|,  L L' = J'J - a a'

Same cost, same gradient, same Gauss-Newton matrix, hence the same iterates.  L is
taken from the eigenvectors of the equilibrated matrix, not from Cholesky: the state
basis is not unique, J'J is singular, and a rounded zero may be negative.  Such
eigenvalues are raised to the level of rounding; left at zero, noise divided by noise
would move the parameters along the directions that the cost does not see.

The free vector is [theta; x0 of experiment 1; x0 of experiment 2; ...].
"""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from scipy.linalg import eigh
from scipy.linalg.blas import dsyrk

from .simulation import channels, sensitivities, simulate

EIGENVALUE_FLOOR = 1e-12  # relative: below it, J'J is rounding times its conditioning
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
        Map from parameters to the Lur'e form; its first channels are y.
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of shapes (N_i, nu) and (N_i, ny), scaled deviations.
    gamma : float, default=0.0
        Weight of every other channel behind y, relative to that of y.
    gamma_h : float, default=0.0
        Weight of the channel h (eq. split), relative to that of y.
    alpha : float, default=0.0
        Weight of the squared network parameters.
    x0_weight : float, default=0.0
        Weight of the squared initial states: a prior, for short records.
    chunk : int or None, default=None
        Samples per chunk of the sensitivities; None fits the cache.

    Attributes
    ----------
    n : int
        Length of the free vector: ``n_params + n_experiments * n_x0``.
    n_samples : int
        Number of samples N over all experiments.
    """

    def __init__(
        self,
        structure,
        experiments,
        *,
        gamma=0.0,
        gamma_h=0.0,
        alpha=0.0,
        x0_weight=0.0,
        chunk=None,
    ):
        self.structure = structure
        self.experiments = list(experiments)
        self.chunk = chunk
        self.n_samples = sum(len(u) for u, _ in self.experiments)
        self.n = structure.n_params + len(self.experiments) * structure.n_x0
        weights = {structure.channels[0]: 1.0, "h": gamma_h}
        weight = [
            np.full(structure.sizes[axis], weights.get(axis, gamma))
            for axis in structure.channels
        ]
        self.weight = np.sqrt(np.concatenate(weight) / self.n_samples)
        self.decay = np.zeros(self.n)  # square roots of the L2 weights
        self.decay[structure.n_params :] = np.sqrt(x0_weight)
        for name in structure.network_parameters:
            self.decay[structure.slices[name]] = np.sqrt(alpha)
        self._memo: tuple[Any, Any, Any] = (
            None,
            None,
            None,
        )  # free vector, norm, trajectories

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
        return free[:n_params], free[n_params:].reshape(-1, self.structure.n_x0)

    # -- values ----------------------------------------------------------------------

    def _residual(self, lure, X, u, y):
        """Return the weighted residual of one experiment, shape (N_i, nz)."""
        Z = channels(lure, X, u)
        Z[:, : y.shape[1]] -= y
        Z *= self.weight
        return Z

    def _simulate(self, free):
        """Return the norm of r and the trajectories; remember the last ones."""
        if self._memo[0] is not None and np.array_equal(free, self._memo[0]):
            return self._memo[1:]
        theta, x0 = self.split(free)
        lure = self.structure.lure(theta)
        square = float(np.sum((self.decay * free) ** 2))
        trajectories = []
        for (u, y), start in zip(self.experiments, x0, strict=True):
            X = simulate(lure, u, self.structure.initial_state(start))
            if not np.all(np.isfinite(X[-1])):
                return DIVERGED_NORM, None
            r = self._residual(lure, X, u, y)
            square += float(np.vdot(r, r))
            trajectories.append(X)
        norm = min(np.sqrt(square), DIVERGED_NORM)
        self._memo = (free.copy(), norm, trajectories)
        return norm, trajectories

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
        return self._simulate(free)[0]

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
            If the simulation diverges.
        """
        norm, trajectories = self._simulate(free)
        if trajectories is None:
            raise FloatingPointError("The simulation diverges at these parameters.")
        n_params, n_x0 = self.structure.n_params, self.structure.n_x0
        theta, _ = self.split(free)
        JJ, Jr = np.zeros((self.n, self.n)), np.zeros(self.n)
        for i, (X, (u, y)) in enumerate(
            zip(trajectories, self.experiments, strict=True)
        ):
            part_JJ, part_Jr = self._accumulate(theta, X, u, y)
            where = np.r_[:n_params, n_params + i * n_x0 : n_params + (i + 1) * n_x0]
            JJ[np.ix_(where, where)] += part_JJ
            Jr[where] += part_Jr
        JJ[np.diag_indices(self.n)] += self.decay**2
        Jr += self.decay**2 * free
        return JJ, Jr, norm

    def _accumulate(self, theta, X, u, y):
        """Return J'J and J'r of one experiment by (theta, its own x0)."""
        n = self.structure.n_params + self.structure.n_x0
        JJ, Jr = np.zeros((n, n), order="F"), np.zeros(n)
        lure = self.structure.lure(theta)
        for part, J in sensitivities(
            self.structure, theta, X, u, self.weight, self.chunk
        ):
            r = self._residual(lure, X[part], u[part], y[part])
            J = J.reshape(-1, n)
            # upper triangle of JJ += J'J, in place: J.T is Fortran-ordered
            JJ = dsyrk(1.0, J.T, beta=1.0, c=JJ, overwrite_c=1)
            Jr += r.reshape(-1) @ J
        return np.triu(JJ) + np.triu(JJ, 1).T, Jr

    # -- the uncompressed problem: for tests and small records ---------------------

    def residuals(self, free):
        """Return the full residual r; for tests and small problems.

        Parameters
        ----------
        free : ndarray of shape (n,)
            The free vector.

        Returns
        -------
        r : ndarray of shape (n_samples * nz + n,)
            Weighted residuals, those of the weight decay last.
        """
        theta, x0 = self.split(free)
        lure = self.structure.lure(theta)
        parts = [
            self._residual(
                lure, simulate(lure, u, self.structure.initial_state(start)), u, y
            ).ravel()
            for (u, y), start in zip(self.experiments, x0, strict=True)
        ]
        return np.concatenate([*parts, self.decay * free])

    def jacobian(self, free):
        """Return the full Jacobian of `residuals`; for tests and small problems.

        Parameters
        ----------
        free : ndarray of shape (n,)
            The free vector.

        Returns
        -------
        J : ndarray of shape (n_samples * nz + n, n)
            Derivative of the residuals.
        """
        theta, x0 = self.split(free)
        lure = self.structure.lure(theta)
        n_params, n_x0 = self.structure.n_params, self.structure.n_x0
        parts = []
        for i, ((u, _), start) in enumerate(zip(self.experiments, x0, strict=True)):
            X = simulate(lure, u, self.structure.initial_state(start))
            block = np.zeros((len(u) * self.structure.nz, self.n))
            where = np.r_[:n_params, n_params + i * n_x0 : n_params + (i + 1) * n_x0]
            block[:, where] = np.concatenate(
                [
                    J.reshape(-1, n_params + n_x0).copy()
                    for _, J in sensitivities(
                        self.structure, theta, X, u, self.weight, self.chunk
                    )
                ]
            )
            parts.append(block)
        return np.vstack([*parts, np.diag(self.decay)])


def compress(JJ, Jr, norm):
    """Return the compressed Jacobian [a'; L'] of n + 1 rows (eq. compress).

    Parameters
    ----------
    JJ : ndarray of shape (n, n)
        Gauss-Newton matrix J'J.
    Jr : ndarray of shape (n,)
        J'r.
    norm : float
        Norm of r.

    Returns
    -------
    jacobian : ndarray of shape (n + 1, n)
        ``jacobian.T @ jacobian`` is J'J and ``jacobian[0] * norm`` is J'r.
    """
    a = Jr / norm if norm > 0 else np.zeros_like(Jr)
    size = np.sqrt(np.diag(JJ))
    still = size == 0  # a parameter without effect keeps an exact zero column
    size[still] = 1.0
    # equilibrated, so that the rounding of J'J is relative to each column
    eigenvalues, Q = eigh((JJ - np.outer(a, a)) / np.outer(size, size))
    floor = EIGENVALUE_FLOOR * eigenvalues[-1]
    L_t = np.sqrt(np.maximum(eigenvalues, floor))[:, None] * Q.T * size
    L_t[:, still] = 0.0
    return np.vstack([a, L_t])


class Restricted(LeastSquares):
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

    def complete(self, part):
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

    def norm(self, part):
        """Return |r| at the free entries.

        Parameters
        ----------
        part : ndarray of shape (n_free,)
            Entries that are free.

        Returns
        -------
        norm : float
            Root of the cost.
        """
        return self.criterion.norm(self.complete(part))

    def normal_equations(self, part):
        """Return J'J, J'r and |r| of the free entries.

        Parameters
        ----------
        part : ndarray of shape (n_free,)
            Entries that are free.

        Returns
        -------
        JJ : ndarray of shape (n_free, n_free)
            Gauss-Newton matrix.
        Jr : ndarray of shape (n_free,)
            Half the gradient.
        norm : float
            Norm of the residual.
        """
        JJ, Jr, norm = self.criterion.normal_equations(self.complete(part))
        return JJ[np.ix_(self.mask, self.mask)], Jr[self.mask], norm

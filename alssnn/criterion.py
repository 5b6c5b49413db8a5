"""The cost, its Gauss-Newton matrix and its exact compression.

The cost of one model over several experiments (eq. cost)

    J_N = 1/N sum_k ( |y_k - yhat_k|^2 + gamma |g_k|^2 + gamma_k |k_k|^2 )
          + alpha |theta_net|^2

is |r|^2 for the stacked residual r = weights * (z - target), where the target of y
is the record and that of every penalized channel is zero.  Outputs that were not
measured are nan in the record: their residual is zero, and N counts the others.
r has (N nz) rows, too many to store; `least_squares` uses r and its Jacobian J only
through |r|, J'r and J'J, so it is handed an equivalent problem of n + 1 rows
(eq. compress):

    fun  = [|r|, 0, ..., 0],    jac = [a'; L'],    a = J'r / |r|,  L L' = J'J - a a'

Same cost, same gradient, same Gauss-Newton matrix, hence the same iterates.  L is
taken from the eigenvectors of the equilibrated matrix, not from Cholesky: the state
basis is not unique, J'J is singular, and a rounded zero may be negative.  Such
eigenvalues are raised to the level of rounding; left at zero, noise divided by noise
would move the parameters along the directions that the cost does not see.

The free vector is [theta; x0 of experiment 1; x0 of experiment 2; ...].  An
experiment contributes sums over its samples, taken chunk by chunk from slices of the
record: it may live on disk, and experiments may be summed in parallel.
"""

from abc import ABC, abstractmethod

import numpy as np
from joblib import Parallel, delayed
from scipy.linalg import eigh
from scipy.linalg.blas import dsyrk

from .simulation import regressors, sensitivities, trajectory

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
    experiments : sequence of tuple of array
        Pairs (u, y) of shapes (N_i, nu) and (N_i, ny), scaled deviations; only sliced.
        Outputs that were not measured are nan.
    gamma : float, default=0.0
        Weight of the channel g or e, relative to that of y.
    gamma_k : float, default=0.0
        Weight of the channel k, relative to that of y.
    gamma_h : float, default=0.0
        Weight of the channel h (eq. split), relative to that of y.
    output_weight : ndarray of shape (ny,) or None, default=None
        Weight of the squared error of every output; None means one.
    alpha : float, default=0.0
        Weight of the squared network parameters.
    x0_weight : float, default=0.0
        Weight of the squared initial states: a prior, for short records.
    chunk : int or None, default=None
        Samples per chunk of the sensitivities; None fits the cache.
    n_jobs : int or None, default=None
        Experiments summed in parallel threads, as in joblib. The result does not
        depend on it.

    Attributes
    ----------
    n : int
        Length of the free vector: ``n_params + n_experiments * n_x0``.
    n_samples : int
        Number of samples over all experiments.
    """

    def __init__(
        self,
        structure,
        experiments,
        *,
        gamma=0.0,
        gamma_k=0.0,
        gamma_h=0.0,
        output_weight=None,
        alpha=0.0,
        x0_weight=0.0,
        chunk=None,
        n_jobs=None,
    ):
        self.structure = structure
        self.experiments = list(experiments)
        self.chunk = chunk
        self.n_samples = sum(len(u) for u, _ in self.experiments)
        self.n = structure.n_params + len(self.experiments) * structure.n_x0
        self.n_jobs = n_jobs
        weights = {
            "y": 1.0 if output_weight is None else np.asarray(output_weight),
            "g": gamma,
            "e": gamma,
            "k": gamma_k,
            "h": gamma_h,
        }
        square = np.concatenate(
            [
                np.broadcast_to(weights[c], structure.sizes[c])
                for c in structure.channels
            ]
        )
        ny = structure.sizes["y"]
        n_measured = sum(count_measured(y) for _, y in self.experiments) / ny
        N = np.where(np.arange(structure.nz) < ny, max(n_measured, 1), self.n_samples)
        self.weight = np.sqrt(square / N)
        self.decay = np.zeros(self.n)  # square roots of the L2 weights
        self.decay[structure.n_params :] = np.sqrt(x0_weight)
        for name in structure.network_parameters:
            self.decay[structure.slices[name]] = np.sqrt(alpha)
        self._memo: tuple = (None, 0.0)  # last free vector and its norm

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

    def _each(self, function, free):
        """Return the values of a function of (theta, x0, u, y), one per experiment."""
        theta, x0 = self.split(free)
        calls = [
            (theta, start, u, y)
            for start, (u, y) in zip(x0, self.experiments, strict=True)
        ]
        if self.n_jobs in (None, 1) or len(calls) == 1:
            return [function(*call) for call in calls]
        # the backend is fixed: a cluster of the caller is for whole fits, not for this
        threads = Parallel(n_jobs=self.n_jobs, backend="threading")
        return threads(delayed(function)(*call) for call in calls)

    # -- values ----------------------------------------------------------------------

    def _residuals(self, theta, x0, u, y):
        """Yield the weighted residual of one experiment in chunks, nan if diverged."""
        lure, nx = self.structure.lure(theta), self.structure.nx
        Theta_z = lure.Theta[nx : nx + lure.nz].T
        for part, u_part, X in trajectory(lure, u, self.structure.initial_state(x0)):
            if not np.isfinite(X[-1]).all():
                yield np.full(lure.nz, np.nan)
                return
            Z = regressors(lure, X[:-1], u_part) @ Theta_z * self.weight
            yield self._subtract(Z, y[part])[0]

    def _subtract(self, Z, y):
        """Return Z minus the weighted targets, in place, and what was not measured."""
        ny = y.shape[1]
        missing = np.isnan(y)
        Z[:, :ny] -= y * self.weight[:ny]
        if missing.any():
            Z[:, :ny][missing] = 0.0
            return Z, missing
        return Z, None

    def _square(self, theta, x0, u, y):
        """Return |r|^2 of one experiment."""
        return sum(float(np.vdot(r, r)) for r in self._residuals(theta, x0, u, y))

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
            square = float(np.sum((self.decay * free) ** 2))
            square += sum(self._each(self._square, free))
            # "not <": nan means diverged
            norm = np.sqrt(square) if square < DIVERGED_NORM**2 else DIVERGED_NORM
            self._memo = (np.array(free), float(norm))
        return self._memo[1]

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
        n_params, n_x0 = self.structure.n_params, self.structure.n_x0
        JJ, Jr = np.diag(self.decay**2), self.decay**2 * free
        square = float(np.sum((self.decay * free) ** 2))
        for i, (part_JJ, part_Jr, part) in enumerate(
            self._each(self._accumulate, free)
        ):
            where = np.r_[:n_params, n_params + i * n_x0 : n_params + (i + 1) * n_x0]
            JJ[np.ix_(where, where)] += part_JJ
            Jr[where] += part_Jr
            square += part
        return JJ, Jr, float(np.sqrt(square))

    def _accumulate(self, theta, x0, u, y):
        """Return J'J, J'r by (theta, its own x0) and |r|^2 of one experiment."""
        n = self.structure.n_params + self.structure.n_x0
        JJ, Jr, square = np.zeros((n, n), order="F"), np.zeros(n), 0.0
        for part, Z, J in sensitivities(
            self.structure, theta, x0, u, self.weight, self.chunk
        ):
            r, missing = self._subtract(Z, y[part])
            if missing is not None:
                J[:, : missing.shape[1]][missing] = 0.0
            J = J.reshape(-1, n)
            # upper triangle of JJ += J'J, in place: J.T is Fortran-ordered
            JJ = dsyrk(1.0, J.T, beta=1.0, c=JJ, overwrite_c=1)
            Jr += r.reshape(-1) @ J
            square += float(np.vdot(r, r))
        return np.triu(JJ) + np.triu(JJ, 1).T, Jr, square

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
        parts = [
            r.ravel()
            for rs in self._each(lambda *args: list(self._residuals(*args)), free)
            for r in rs
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
        n_params, n_x0 = self.structure.n_params, self.structure.n_x0
        parts = []
        for i, ((u, y), start) in enumerate(zip(self.experiments, x0, strict=True)):
            where = np.r_[:n_params, n_params + i * n_x0 : n_params + (i + 1) * n_x0]
            for part, _, J in sensitivities(
                self.structure, theta, start, u, self.weight, self.chunk
            ):
                J[:, : y.shape[1]][np.isnan(y[part])] = 0.0
                block = np.zeros((J.shape[0] * J.shape[1], self.n))
                block[:, where] = J.reshape(len(block), -1)
                parts.append(block)
        return np.vstack([*parts, np.diag(self.decay)])


def count_measured(y, chunk=100_000):
    """Return how many entries of the outputs are not nan.

    Parameters
    ----------
    y : array of shape (N, ny)
        Outputs; only sliced.
    chunk : int, default=100000
        Samples treated at a time.

    Returns
    -------
    count : int
        Number of measured values.
    """
    starts = range(0, len(y), chunk)
    return sum(int(np.sum(~np.isnan(y[i : i + chunk]))) for i in starts)


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

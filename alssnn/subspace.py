"""Linear models: N4SID by block Hankel matrices and QR, then refinement.

The subspace step takes the past and future of horizon i of all experiments,

    H = [U_f; U_p; Y_p; Y_f],        H' = Q R   (only R is kept, chunk by chunk)

and the block R_32 of R that maps the past (U_p, Y_p), freed of U_f, to Y_f.  Its
dominant left singular vectors span the extended observability matrix Gamma, whose
shift structure gives A and whose top gives C (Van Overschee and De Moor, 1994, with
the weighting that makes it MOESP).  The simulated output is then linear in (B, x0),
so that one Gauss-Newton step of the criterion solves for them.

Subspace estimates minimize no simulation error and may be unstable: eigenvalues of
A are first reflected into the unit disc, and all matrices are then refined by the
same Levenberg-Marquardt as every other model: by poles and C alone (`sections`), or
entry by entry where A has no basis for that.  All arrays here are scaled deviations
(see `experiments`).
"""

from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError, eigh, lstsq, qr, solve_discrete_lyapunov, svd
from scipy.optimize import OptimizeResult

from .criterion import Criterion, Restricted
from .experiments import chunks, stretch
from .models import state_space
from .optimizers import minimize, single_threaded
from .sections import Sections
from .simulation import trajectory

QR_COLUMNS = 20_000  # columns of H treated at a time: H itself is never formed
LEAST_VARIANCE = 1e-12  # of a state, relative to the largest, that counts as moving
GAP = 2 * 40  # samples without any output behind which a record starts anew
RADIUS_LIMIT = 0.999  # spectral radius of a stabilized start
REFINED_MARGIN = 1e-6  # of a refined model: integrators stay what they are
HORIZONS = (15, 40)  # candidate horizons: fast and slow sampling
SUBSPACE_SAMPLES = 100_000  # of the subspace step: a start needs no more
TRIAL_SAMPLES = 20_000  # samples of the first, thorough refinement
TRIAL_TOLERANCE = 1e-4  # of it: the rest is for all samples
POLISH_STEPS = 10  # trial steps on all samples after it


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Hold a linear model of scaled deviations.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    B : ndarray of shape (nx, nu)
        Input matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    D : ndarray of shape (ny, nu)
        Feedthrough matrix.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    feedthrough : bool
        Whether D is free; else it is zero.
    singular_values : ndarray
        Singular values behind the choice of the order, descending.
    result : OptimizeResult or None
        Outcome of the refinement.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    x0: np.ndarray
    feedthrough: bool = False
    singular_values: np.ndarray = field(default_factory=lambda: np.empty(0))
    result: OptimizeResult | None = None

    @property
    def structure(self):
        """Return the linear structure with free C."""
        nx, nu, ny = len(self.A), self.B.shape[1], len(self.C)
        return state_space(nx, nu, ny, feedthrough=self.feedthrough)

    def as_fit(self):
        """Return the model as a fitted structure.

        Returns
        -------
        structure : Structure
            Linear structure with free C.
        theta : ndarray of shape (n_params,)
            Its parameters.
        result : OptimizeResult
            Outcome of the refinement, with `x0` in the basis of this model.
        """
        structure = self.structure
        result = OptimizeResult({**(self.result or {}), "x0": self.x0})
        return structure, structure.join(vars(self)), result


def _past_future(u, y, horizon):
    """Return [U_f, U_p, Y_p, Y_f] with one row per time instant."""

    def blocks(signal):
        windows = np.lib.stride_tricks.sliding_window_view(signal, 2 * horizon, axis=0)
        windows = windows.transpose(0, 2, 1)  # (columns of H, 2 horizon, n)
        flat = windows.reshape(len(windows), -1)
        half = horizon * signal.shape[1]
        return flat[:, :half], flat[:, half:]

    (U_p, U_f), (Y_p, Y_f) = blocks(u), blocks(y)
    return np.hstack([U_f, U_p, Y_p, Y_f])


def hankel_triangle(experiments, horizon):
    """Return the triangular factor of the block Hankel matrix of all experiments.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Pairs (u, y); those shorter than two horizons are passed over.
    horizon : int
        Block rows of past and of future.

    Returns
    -------
    R : ndarray of shape (n_rows, n_rows)
        Upper triangular, ``R.T @ R = H @ H.T`` with
        ``n_rows = 2 * horizon * (nu + ny)``.

    Notes
    -----
    Costs O(N n_rows^2) operations and O(QR_COLUMNS n_rows) memory.
    """
    n_rows = 2 * horizon * sum(signal.shape[1] for signal in experiments[0])
    R = np.zeros((0, n_rows))
    for u, y in experiments:
        n_columns = len(u) - 2 * horizon + 1
        for start in range(0, n_columns, QR_COLUMNS):
            stop = min(start + QR_COLUMNS, n_columns) + 2 * horizon - 1
            H_t = _past_future(u[start:stop], y[start:stop], horizon)
            R = qr(np.vstack([R, H_t]), mode="r", overwrite_a=True)[0][:n_rows]
    return np.vstack([R, np.zeros((n_rows - len(R), n_rows))])


def stabilize(A, limit=RADIUS_LIMIT):
    """Move eigenvalues of a matrix into a disc.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    limit : float, default=0.999
        Largest modulus allowed.

    Returns
    -------
    A : ndarray of shape (nx, nx)
        The matrix itself if its spectral radius is at most `limit`; else one with
        eigenvalues reflected at the unit circle and cut to the limit.
    """
    eigenvalues, vectors = np.linalg.eig(A)
    modulus = np.abs(eigenvalues)
    if modulus.max() <= limit:
        return A
    if np.linalg.cond(vectors) > 1e8:  # nearly defective: shrink the matrix
        return A * (limit / modulus.max())
    safe = np.maximum(modulus, 1e-300)
    target = np.minimum(np.where(modulus > 1, 1 / safe, modulus), limit)
    return np.real(vectors * (eigenvalues * target / safe) @ np.linalg.inv(vectors))


def past_to_future(R, experiments, horizon):
    """Return the left singular vectors and values of R_32.

    Parameters
    ----------
    R : ndarray of shape (n_rows, n_rows)
        Result of `hankel_triangle`.
    experiments : sequence of tuple of ndarray
        Pairs (u, y), for their sizes.
    horizon : int
        Block rows of past and of future.

    Returns
    -------
    U : ndarray of shape (horizon * ny, horizon * ny)
        Directions of the extended observability matrix.
    s : ndarray of shape (horizon * ny,)
        Singular values, descending.
    """
    n_u, n_y = (horizon * signal.shape[1] for signal in experiments[0])
    # R' is lower triangular: columns n_u to -n_y belong to the past, freed of U_f
    R_32 = R[n_u:-n_y, -n_y:].T
    return svd(R_32, full_matrices=False)[:2]


def shift_structure(U, s, nx, ny):
    """Return A and C from the extended observability matrix.

    Parameters
    ----------
    U : ndarray of shape (horizon * ny, n)
        Directions of the observability matrix.
    s : ndarray of shape (n,)
        Their singular values.
    nx : int
        Order.
    ny : int
        Number of outputs.

    Returns
    -------
    A : ndarray of shape (nx, nx)
        Stabilized state matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    """
    # a floor on s keeps states that the data do not show from vanishing
    floor = 1e-12 * s[0] if s[0] > 0 else 1.0
    Gamma = U[:, :nx] * np.sqrt(np.maximum(s[:nx], floor))
    return stabilize(lstsq(Gamma[:-ny], Gamma[ny:])[0]), Gamma[:ny]


def fit_input(experiments, A, C, feedthrough=False, n_jobs=None):
    """Solve for (B, D, x0) at given (A, C): a linear least-squares problem.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    A : ndarray of shape (nx, nx)
        Stable state matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    feedthrough : bool, default=False
        Whether D is free; else it is zero.
    n_jobs : int or None, default=None
        Experiments summed in parallel threads, as in joblib.

    Returns
    -------
    model : LinearModel
        The model of least simulation error for these A and C.
    """
    nx, (nu, ny) = len(A), (signal.shape[1] for signal in experiments[0])
    B, D, x0 = np.zeros((nx, nu)), np.zeros((ny, nu)), np.zeros((len(experiments), nx))
    model = LinearModel(A, B, C, D, x0, feedthrough)
    with single_threaded():
        found = _search(experiments, model, n_jobs).solved()
    return replace(model, **{**found, "A": A, "C": C})


class AllEntries(Criterion):
    """Evaluate |r|, J'r and J'J of a linear model by the entries of its matrices.

    Parameters
    ----------
    experiments : sequence of tuple of array, or Held
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Where the search starts.
    n_jobs : int or None, default=None
        Experiments summed in parallel threads, as in joblib.

    Attributes
    ----------
    start : ndarray of shape (n,)
        Free vector of the model.
    """

    def __init__(self, experiments, model, n_jobs=None):
        structure = model.structure
        super().__init__(structure, experiments, n_jobs=n_jobs)
        self.start = self.join(structure.join(vars(model)), model.x0)

    def matrices(self, free):
        """Return the model of a free vector.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        matrices : dict of str to ndarray
            A, B, C, D (if it is free) and x0.
        """
        theta, x0 = self.split(free)
        return {**self.structure.split(theta), "x0": x0}

    def solved(self):
        """Return the model of the start with the best B, D and x0.

        Returns
        -------
        matrices : dict of str to ndarray
            A, B, C, D (if it is free) and x0.
        """
        is_linear = np.ones(self.n, dtype=bool)
        for name in ("A", "C"):
            is_linear[self.structure.slices[name]] = False
        part = Restricted(self, self.start, is_linear)
        # the residual is linear in (B, D, x0): one Gauss-Newton step solves
        JJ, Jr, _ = part.normal_equations(self.start[is_linear])
        return self.matrices(part.complete(self.start[is_linear] - lstsq(JJ, Jr)[0]))


def _search(experiments, model, n_jobs):
    """Return the criterion of a search from a linear model."""
    try:
        return Sections(experiments, model, n_jobs)
    except LinAlgError:  # such as a chain of delays: several poles at one place
        return AllEntries(experiments, model, n_jobs)


def _candidate_horizons(experiments, nx):
    """Return the horizons to try, ascending: within reach of record and order."""
    nu, ny = (signal.shape[1] for signal in experiments[0])
    longest = max(len(u) for u, _ in experiments)
    lowest = max(2, -(-nx // ny) + 1)  # Gamma without its last block has rank nx
    samples = 2 * lowest + nx
    if longest < samples:
        raise ValueError(
            f"`u` and `y` must have at least {samples} samples in one experiment for "
            f"nx={nx}, got {longest}. Use a longer record or a smaller `nx`."
        )
    # more columns than rows in H, or else U_f leaves nothing of the past
    highest = (longest + 1) // (2 * (nu + ny) + 2)
    return sorted({max(lowest, min(horizon, highest)) for horizon in HORIZONS})


def largest_order(experiments):
    """Return the largest order that a record can tell.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    nx : int
        At least 1; the parameters of a model of this order are a tenth of the samples.
    """
    nu, ny = (signal.shape[1] for signal in experiments[0])
    longest = max(len(u) for u, _ in experiments)
    return max(1, longest // (10 * (nu + ny)))


def without_gaps(experiments):
    """Return the experiments cut where no output was measured for long.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    pieces : list of tuple of array
        Pairs (u, y), slices; shorter gaps are left in.
    """
    pieces = []
    for u, y in experiments:
        missing = np.concatenate([np.isnan(y[i]).all(axis=1) for i in chunks(len(y))])
        edges = np.flatnonzero(np.diff(np.r_[False, missing, False].astype(int)))
        gaps = [(a, b) for a, b in edges.reshape(-1, 2) if b - a >= GAP]
        starts = [0, *(b for _, b in gaps)]
        stops = [*(a for a, _ in gaps), len(u)]
        whole = zip(starts, stops, strict=True)
        pieces += [(u[a:b], y[a:b]) for a, b in whole if a < b] if gaps else [(u, y)]
    return pieces


def refine(experiments, model, *, max_iter, tol, watch=None, n_jobs=None):
    """Refine all matrices of a linear model on its simulation error.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Stable start.
    max_iter : int
        Largest number of trial steps.
    tol : float
        Relative tolerance.
    watch : Watch or None, default=None
        Told of every step; may end the search.
    n_jobs : int or None, default=None
        Experiments summed in parallel threads, as in joblib.

    Returns
    -------
    model : LinearModel
        Stable model of least simulation error near the start; `result` is set.
    """
    problem, structure = _search(experiments, model, n_jobs), model.structure

    def to_point(free):
        found = problem.matrices(free)
        return np.concatenate([structure.join(found), np.ravel(found["x0"])])

    result = minimize(
        problem,
        problem.start,
        max_iter=max_iter,
        tol=tol,
        watch=watch,
        to_point=to_point,
        label="linear",
    )
    with single_threaded():
        refined = replace(model, **problem.matrices(result.x), result=result)
    if np.abs(np.linalg.eigvals(refined.A)).max() < 1.0:
        return refined
    # A finite record may prefer a slowly growing mode, which no simulation of
    # another record survives: reflect it, and keep the better of two stable models.
    A = stabilize(refined.A, limit=1.0 - REFINED_MARGIN)
    reflected = fit_input(experiments, A, refined.C, model.feedthrough, n_jobs)
    best = min(model, reflected, key=partial(simulation_error, experiments))
    return replace(best, result=result)


def identify_linear(
    experiments,
    nx,
    *,
    feedthrough=False,
    max_iter=100,
    tol=1e-8,
    watch=None,
    n_jobs=None,
):
    """Identify a linear model: subspace start, then simulation-error refinement.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    nx : int
        Order.
    feedthrough : bool, default=False
        Whether D is free; else it is zero.
    max_iter : int, default=100
        Largest number of trial steps of the refinement.
    tol : float, default=1e-8
        Relative tolerance of the refinement.
    watch : Watch or None, default=None
        Told of every step; may end the search.
    n_jobs : int or None, default=None
        Experiments summed in parallel threads, as in joblib. The result does not
        depend on it.

    Returns
    -------
    model : LinearModel
        Model whose states have unit variance over the record.

    Raises
    ------
    ValueError
        If the longest experiment is too short for the order.
    """
    ny = experiments[0][1].shape[1]
    near = stretch(experiments, SUBSPACE_SAMPLES)
    if min(len(u) for u, _ in near) < 10 * HORIZONS[-1]:  # many short ones
        near = experiments
    pieces = without_gaps(near)
    horizons = _candidate_horizons(pieces, nx)
    filled = [(u, Filled(y)) for u, y in pieces]
    with single_threaded():
        spaces = [
            past_to_future(hankel_triangle(filled, i), filled, i) for i in horizons
        ]
    # the longest horizon sees the slowest dynamics
    singular_values = spaces[-1][1]
    trial = stretch(experiments, TRIAL_SAMPLES)
    pairs = [shift_structure(U, s, nx, ny) for U, s in spaces]
    options = {"watch": watch, "n_jobs": n_jobs}
    starts = [fit_input(trial, A, C, feedthrough, n_jobs) for A, C in pairs]
    model = min(starts, key=partial(simulation_error, trial))
    is_trial = sum(len(u) for u, _ in trial) < sum(len(u) for u, _ in experiments)
    trial_tol = max(tol, TRIAL_TOLERANCE) if is_trial else tol
    model = refine(trial, model, max_iter=max_iter, tol=trial_tol, **options)
    if is_trial:
        model = fit_input(experiments, model.A, model.C, feedthrough, n_jobs)
        model = refine(experiments, model, max_iter=POLISH_STEPS, tol=tol, **options)
    model = decorrelate(model, experiments)
    return replace(model, singular_values=singular_values)


def simulation_error(experiments, model):
    """Return the simulation error of a linear model.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Model, with an initial state for every experiment.

    Returns
    -------
    error : float
        Norm of the residual over the measured outputs (eq. cost).
    """
    problem = AllEntries(experiments, model)
    return problem.norm(problem.start)


def normalize(model, experiments):
    """Scale the states to unit variance over the record.

    Parameters
    ----------
    model : LinearModel
        Model.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    model : LinearModel
        The model with scaled states.
    std : ndarray of shape (nx,)
        States before over states after.
    """
    std = np.sqrt(np.diag(_state_covariance(model, experiments)))
    std = np.where((std > 0) & np.isfinite(std), std, 1.0)
    scaled = replace(
        model,
        A=model.A * std / std[:, None],
        B=model.B / std[:, None],
        C=model.C * std,
        x0=model.x0 / std,
    )
    return scaled, std


def decorrelate(model, experiments):
    """Bring a model into the basis of uncorrelated states of unit variance.

    Among these bases, the one whose states contribute to later outputs one by one and
    in falling order: a balanced realization for the spectrum of the record. States of
    two poles close to each other would else be nearly the same, and a network that
    sees them would see one; a white input makes A a contraction.

    Parameters
    ----------
    model : LinearModel
        Stable model.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    model : LinearModel
        The model in this basis; as it is where a state does not move.
    """
    model, _ = normalize(model, experiments)
    variance, V = eigh(_state_covariance(model, experiments))
    radius = np.abs(np.linalg.eigvals(model.A)).max()
    if not variance[0] > LEAST_VARIANCE * variance[-1] or not radius < 1:
        return model
    T = (V / np.sqrt(variance)).T  # T cov T' = I
    T_inv = V * np.sqrt(variance)
    A, C = T @ model.A @ T_inv, model.C @ T_inv
    energy, U = eigh(solve_discrete_lyapunov(A.T, C.T @ C))
    U = U[:, np.argsort(-energy)]
    # an eigenvector has no sign of its own: rounding is not to choose the basis
    seen = C @ U
    U = U * np.where(seen[np.abs(seen).argmax(axis=0), range(len(A))] < 0, -1.0, 1.0)
    T, T_inv = U.T @ T, T_inv @ U
    return replace(
        model,
        A=T @ model.A @ T_inv,
        B=T @ model.B,
        C=model.C @ T_inv,
        x0=model.x0 @ T.T,
    )


def _state_covariance(model, experiments):
    """Return the covariance of the simulated states."""
    structure = model.structure
    lure = structure.lure(structure.join(vars(model)))
    count, total, square = 0, 0.0, 0.0
    for (u, _), x0 in zip(experiments, model.x0, strict=True):
        for _, _, X in trajectory(lure, u, x0):
            count += len(X) - 1
            total = total + X[:-1].sum(axis=0)
            square = square + X[:-1].T @ X[:-1]
    mean = total / count
    return square / count - np.outer(mean, mean)


class Filled:
    """Fill outputs that were not measured, for the subspace step alone.

    Gaps are bridged by straight lines within the slice that is asked for: a start,
    which the refinement on what was measured corrects.

    Parameters
    ----------
    y : array of shape (N, ny)
        Outputs; nan where they were not measured.
    """

    def __init__(self, y):
        self.y, self.shape = y, y.shape

    def __len__(self):
        """Return the number of samples."""
        return len(self.y)

    def __getitem__(self, part):
        """Return the samples of a slice, shape (L, ny)."""
        y = np.array(self.y[part])
        k = np.arange(len(y))
        for i in np.flatnonzero(np.isnan(y).any(axis=0)):
            measured = ~np.isnan(y[:, i])
            known = y[measured, i] if measured.any() else np.zeros(1)
            at = k[measured] if measured.any() else k[:1]
            y[:, i] = np.interp(k, at, known)
        return y

"""Linear models: N4SID by block Hankel matrices and QR, then refinement.

The subspace step takes the past and future of horizon i of all experiments,

    H = [U_f; U_p; Y_p; Y_f],        H' = Q R   (only R is kept, chunk by chunk)

and the block R_32 of R that maps the past (U_p, Y_p), freed of U_f, to Y_f.  Its
dominant left singular vectors span the extended observability matrix Gamma, whose
shift structure gives A and whose top gives C (Van Overschee and De Moor, 1994, with
the weighting that makes it MOESP).  The simulated output is then linear in (B, x0),
so that one Gauss-Newton step of the criterion solves for them.

A predictor, whose inputs are u and the measured outputs (`n_measured`), would explain
Y_f by itself.  There, a regression of y on the inputs of i samples before gives the
Markov parameters Phi_j = C (A - K C)^(j-1) [B K], consistent with feedback in the
record, too; Gamma is what maps these samples to Y_f without inputs in between
(eq. predictor; Chiuso and Picci, 2005; Chiuso, 2007).

Subspace estimates minimize no simulation error and may be unstable: eigenvalues of
A are first reflected into the unit disc, and all matrices are then refined by the
same Levenberg-Marquardt as every other model: by poles and C alone (`sections`), or
entry by entry where A has no basis for that.  All arrays here are scaled deviations
(see `experiments`).
"""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.linalg import LinAlgError, lstsq, qr, svd

from .experiments import Filled, chunks, stretch
from .linear_model import (
    AllEntries,
    LinearModel,
    decorrelate,
    forgets,
    simulation_error,
    stabilize,
)
from .optimizers import minimize, single_threaded
from .sections import Sections

QR_COLUMNS = 20_000  # columns of H treated at a time: H itself is never formed
GAP = 2 * 40  # samples without any output behind which a record starts anew
MEMORY = 10.0  # time constants in a record, of the slowest pole of a predictor
START_SHARE = 0.999  # of the largest modulus, at the start of a predictor
REFINED_MARGIN = 1e-6  # of a refined model: integrators stay what they are
# Half and double make little difference (`python -m benchmarks.constants HORIZONS`):
# test errors of linear models of 6 plants with (7, 20) are 0.93 to 1.04 of those with
# these, with (30, 80) 0.89 to 1.00, the medians 1.00.
HORIZONS = (15, 40)  # candidate horizons: fast and slow sampling
SUBSPACE_SAMPLES = 100_000  # of the subspace step: a start needs no more
TRIAL_SAMPLES = 20_000  # samples of the first, thorough refinement
TRIAL_TOLERANCE = 1e-4  # of it: the rest is for all samples
POLISH_STEPS = 10  # trial steps on all samples after it


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


def predictor_space(experiments, horizon, feedthrough=False, n_measured=0):
    """Return the left singular vectors and values of what the past says of y.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Pairs (u, y), u without nan; those shorter than the horizon are passed over.
        Every output takes the rows where it was measured.
    horizon : int
        Samples of the past, and of the future.
    feedthrough : bool, default=False
        Whether y depends on the inputs of the same sample that are not measured
        outputs.
    n_measured : int, default=0
        Number of last inputs that are measured outputs.

    Returns
    -------
    U : ndarray of shape (horizon * ny, horizon * ny)
        Directions of the extended observability matrix.
    s : ndarray of shape (horizon * ny,)
        Singular values, descending.
    """
    nz, ny = (signal.shape[1] for signal in experiments[0])
    now = nz - n_measured if feedthrough else 0
    n_past, n = horizon * nz, horizon * nz + now
    is_whole = not any(np.isnan(y).any() for _, y in experiments)
    groups = [slice(None)] if is_whole else [slice(p, p + 1) for p in range(ny)]
    triangles = []
    for group in groups:
        R = np.zeros((0, n + len(range(ny)[group])))
        for rows in _regressions(experiments, horizon, now):
            kept = np.hstack([rows[:, :n], rows[:, n:][:, group]])
            kept = kept[~np.isnan(kept).any(axis=1)]
            R = qr(np.vstack([R, kept]), mode="r", overwrite_a=True)[0][: R.shape[1]]
        triangles.append(np.vstack([R, np.zeros((R.shape[1] - len(R), R.shape[1]))]))
    Phi = np.hstack([lstsq(R[:n, :n], R[:n, n:])[0][:n_past] for R in triangles]).T
    R = max(triangles, key=np.linalg.norm)
    later = [np.pad(Phi[:, i * nz :], ((0, 0), (0, i * nz))) for i in range(horizon)]
    U, s, _ = svd(np.vstack(later) @ R[:n_past, :n_past].T)
    return U, s


def _regressions(experiments, horizon, now):
    """Yield rows [z_(k-1), ..., z_(k-horizon), u_k, y_k] of the experiments."""
    for u, y in experiments:
        for start in range(0, len(u) - horizon, QR_COLUMNS):
            stop = min(start + QR_COLUMNS, len(u) - horizon)
            z, target = u[start : stop + horizon], y[start + horizon : stop + horizon]
            past = np.lib.stride_tricks.sliding_window_view(z[:-1], horizon, axis=0)
            past = past[:, :, ::-1].transpose(0, 2, 1).reshape(len(target), -1)
            yield np.hstack([past, z[horizon:, :now], target])


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


def fit_input(experiments, A, C, feedthrough=False, n_measured=0, radius=1.0):
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
    n_measured : int, default=0
        Number of last inputs that are the measured outputs of a predictor.
    radius : float, default=1.0
        Largest modulus of a pole that a search from there may reach.

    Returns
    -------
    model : LinearModel
        The model of least simulation error for these A and C.
    """
    nx, (nu, ny) = len(A), (signal.shape[1] for signal in experiments[0])
    B, D, x0 = np.zeros((nx, nu)), np.zeros((ny, nu)), np.zeros((len(experiments), nx))
    limits = {"n_measured": n_measured, "radius": radius}
    model = LinearModel(A, B, C, D, x0, feedthrough, **limits)
    with single_threaded():
        found = _search(experiments, model).solved()
    return replace(model, **{**found, "A": A, "C": C})


def _search(experiments, model):
    """Return the criterion of a search from a linear model."""
    if model.feedthrough and model.n_measured:  # D has entries that are held
        return AllEntries(experiments, model)
    try:
        return Sections(experiments, model, model.radius)
    except LinAlgError:  # such as a chain of delays: several poles at one place
        return AllEntries(experiments, model)


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
        At least 1; the parameters of a model of this order, with the initial states of
        further experiments, are a tenth of the samples.
    """
    nu, ny = (signal.shape[1] for signal in experiments[0])
    n_samples, more = sum(len(u) for u, _ in experiments), len(experiments) - 1
    return max(1, n_samples // (10 * (nu + ny + more)))


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


def refine(experiments, model, *, max_iter, tol, watch=None):
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

    Returns
    -------
    model : LinearModel
        Stable model of least simulation error near the start; `result` is set.
    """
    problem, structure = _search(experiments, model), model.structure

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
    if np.abs(np.linalg.eigvals(refined.A)).max() < model.radius:
        return refined
    # A finite record may prefer a slowly growing mode, which no simulation of
    # another record survives: reflect it, and keep the better of two stable models.
    A = stabilize(refined.A, limit=model.radius * (1.0 - REFINED_MARGIN))
    kind = model.feedthrough, model.n_measured, model.radius
    reflected = fit_input(experiments, A, refined.C, *kind)
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
    n_measured=0,
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
    n_measured : int, default=0
        Number of last inputs that are the measured outputs of a predictor, whose
        simulation error is the error one sample ahead.

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

    def space(horizon):
        if n_measured:
            return predictor_space(pieces, horizon, feedthrough, n_measured)
        filled = [(u, Filled(y)) for u, y in pieces]
        return past_to_future(hankel_triangle(filled, horizon), filled, horizon)

    with single_threaded():
        spaces = [space(horizon) for horizon in horizons]
    # the longest horizon sees the slowest dynamics
    singular_values = spaces[-1][1]
    trial = stretch(experiments, TRIAL_SAMPLES)
    pairs = [shift_structure(U, s, nx, ny) for U, s in spaces]
    is_trial = sum(len(u) for u, _ in trial) < sum(len(u) for u, _ in experiments)
    trial_tol = max(tol, TRIAL_TOLERANCE) if is_trial else tol
    if n_measured and any(np.isnan(y[:]).any() for _, y in pieces):
        # the regression is on bridged outputs, of which a simulation sees nothing
        kind = {"feedthrough": feedthrough, "max_iter": max_iter, "tol": trial_tol}
        plain = [(u[:, :-n_measured], y) for u, y in trial]
        free = identify_linear(plain, nx, watch=watch, **kind)
        pairs.append((free.A, free.C))

    def found(radius):
        kind = feedthrough, n_measured, radius
        inside = START_SHARE * radius if n_measured else np.inf
        starts = [fit_input(trial, stabilize(A, inside), C, *kind) for A, C in pairs]
        model = min(starts, key=partial(simulation_error, trial))
        model = refine(trial, model, max_iter=max_iter, tol=trial_tol, watch=watch)
        if is_trial:
            model = fit_input(experiments, model.A, model.C, *kind)
            polish = {"max_iter": POLISH_STEPS, "tol": tol}
            model = refine(experiments, model, **polish, watch=watch)
        return model

    distance = MEMORY / max(len(u) for u, _ in trial) if n_measured else 0.0
    model = found(max(1.0 - distance, 0.5))
    while n_measured and distance < 0.5 and not forgets(experiments, model):
        distance *= 2.0
        model = found(max(1.0 - distance, 0.5))
    model = decorrelate(model, experiments)
    return replace(model, singular_values=singular_values)

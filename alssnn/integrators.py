"""Integrators: poles held at one, for outputs that are integrals of a rate.

The last n states of such a model are integrators (eq. integrate),

    A = [A_r  0]        x_i+ = x_i + B_i (u + h) + g_i
        [ 0   I]

and no network sees them, so that a shift of x_i shifts the output and changes nothing
else.  The linear start comes from two sides, of which the better one is refined with
the zeros and ones of A held: the poles next to one of a model of the output are put
there, or a model of the output's differences is summed up.

Where the input's mean is not what holds the output still, an integrator drifts: a
constant ramp that no other parameter makes up for.  So a constant input is fitted as
well, and becomes a part of the operating point.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import block_diag, lstsq, schur, solve_sylvester

from .criterion import Criterion, Restricted
from .experiments import Filled, Sliced, stretch
from .linear_model import LinearModel, normalize, stabilize
from .optimizers import minimize, single_threaded
from .subspace import (
    HORIZONS,
    POLISH_STEPS,
    REFINED_MARGIN,
    TRIAL_SAMPLES,
    fit_input,
    hankel_triangle,
    identify_linear,
    past_to_future,
    shift_structure,
)

LABEL = "linear, integrators"  # of the search, for those who watch
SLOWEST = 30.0  # N (1 - p) of a pole that may be an integrator's without an offset
SHARE = 5.0  # N (1 - p) of the pole that an integrator has to beat
GAIN = 0.02  # by so much of the simulation error
FAST = 10.0  # N (1 - p) of the other pole at least: two slow ones are something else
SAME = 0.1  # relative size of an integrator that is not a part of another one
FARTHEST = 0.5  # offset of an input that rests, in its standard deviations, at most
MOST = 0.7  # standard deviation of what is integrated, over that of the output


@dataclass(frozen=True, eq=False)
class Integrating:
    """Hold a linear model with integrators, about an operating point of its own.

    Parameters
    ----------
    model : LinearModel
        Model whose last states are the integrators.
    u_shift : ndarray of shape (nu,)
        Its scaled inputs are the given ones plus this.
    y_shift : ndarray of shape (ny,)
        Its scaled outputs are the given ones minus this.
    """

    model: LinearModel
    u_shift: np.ndarray
    y_shift: np.ndarray


def integrator_entries(nx, n):
    """Return which entries of A belong to integrators.

    Parameters
    ----------
    nx : int
        Number of states.
    n : int
        Number of integrators, the last states.

    Returns
    -------
    mask : ndarray of bool of shape (nx, nx)
        True in their rows and columns.
    """
    last = np.arange(nx) >= nx - n
    return last[:, None] | last


def identify_integrating(
    experiments, model, n, *, offset=True, max_iter=100, tol=1e-8, watch=None
):
    """Identify a linear model with integrators.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Model without integrators; its order is kept.
    n : int
        Number of integrators, at most that of states and of outputs.
    offset : bool, default=True
        Whether a constant input is fitted and becomes a part of the operating point.
    max_iter : int, default=100
        Largest number of trial steps of the refinement.
    tol : float, default=1e-8
        Relative tolerance of the refinement.
    watch : Watch or None, default=None
        Told of every step; may end the search.

    Returns
    -------
    integrating : Integrating
        The model, states of unit variance, and its operating point.
    """
    trial = stretch(experiments, TRIAL_SAMPLES)
    search = partial(_refine, n=n, offset=offset, tol=tol, watch=watch)
    start = _start(trial, model, n, offset)
    found = search(_with_one(trial), start, max_iter=max_iter)
    if sum(len(u) for u, _ in trial) < sum(len(u) for u, _ in experiments):
        pairs = _with_one(experiments)
        found = _solve(pairs, found, offset)
        found = search(pairs, found, max_iter=POLISH_STEPS)
    return _about_rest(found, experiments, model, n)


def count_integrators(experiments, model):
    """Return how many integrators a plant seems to have, at most one per output.

    Every output is looked at alone, with two states: more would describe what is not
    linear by slow poles of their own. It integrates if a pole at one beats a pole of
    a fifth of the record, the operating point free in both.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    model : LinearModel
        Refined linear model of them.

    Returns
    -------
    n : int
        Number of integrators, less than that of states but for a single state.
    """
    longest = max(len(u) for u, _ in experiments)
    nx, ny = len(model.A), len(model.C)
    if longest * np.abs(1 - np.linalg.eigvals(model.A)).min() > SLOWEST:
        return 0
    trial = stretch(experiments, TRIAL_SAMPLES)
    gains = [_gain(trial, model, j, longest) for j in range(ny)]
    sizes = np.linalg.svd(np.vstack(gains), compute_uv=False)
    # one integrator may show in several outputs
    n = int(np.sum(sizes > SAME * max(float(sizes[0]), np.finfo(float).tiny)))
    return min(n, max(nx - 1, 1))


def _gain(trial, model, j, longest):
    """Return the gains (nu,) of the integrator of one output, zero without one."""
    alone = [(u, _View(y, lambda z: z[:, j : j + 1], 1)) for u, y in trial]
    none = np.zeros(trial[0][0].shape[1])
    if len(model.A) > 2 or len(model.C) > 1:
        try:
            model = identify_linear(
                alone, min(len(model.A), 2), feedthrough=model.feedthrough
            )
        except ValueError:  # too few samples to tell
            return none
    pairs, slow = _with_one(alone), 1.0 - SHARE / longest
    held = _refine(pairs, _start(alone, model, 1, True), n=1, offset=True)
    error = _criterion(pairs, held)[2]
    rest, last = held.A[:-1, :-1], held.A.copy()
    last[-1, -1] = slow
    starts = (
        _start(alone, model, 1, True, slow),
        _solve(pairs, replace(held, A=last), True),
    )
    leaky = (_refine(pairs, start, n=1, offset=True) for start in starts)
    best = min(_criterion(pairs, other)[2] for other in leaky)
    found = _about_rest(held, alone, model, 1)
    if (
        best > (1 + GAIN) * error
        and np.all(longest * np.abs(1 - np.linalg.eigvals(rest)) > FAST)
        and np.abs(found.u_shift).max() < FARTHEST
        and np.abs(found.model.C[0, -1]) > MOST
    ):
        return held.C[0, -1] * held.B[-1, :-1]
    return none


def decouple(model, n):
    """Bring a linear model whose last states integrate into two blocks.

    Parameters
    ----------
    model : LinearModel
        Model with ``A = [[A_r, 0], [L, I]]``, A_r without a pole at one.
    n : int
        Number of integrators.

    Returns
    -------
    model : LinearModel
        The same in a basis with L = 0 (eq. integrate).
    """
    if n == 0:
        return model
    n_r = len(model.A) - n
    A_r, L = model.A[:n_r, :n_r], model.A[n_r:, :n_r]
    if n_r:  # a pole at one that nobody declared
        A_r = stabilize(A_r, limit=1.0 - REFINED_MARGIN)
    T = np.eye(len(model.A))
    T[n_r:, :n_r] = L @ np.linalg.inv(np.eye(n_r) - A_r)  # x_i + L (I - A_r)^-1 x_r
    decoupled = model.in_basis(T, 2 * np.eye(len(T)) - T)
    return replace(decoupled, A=block_diag(A_r, np.eye(n)))


# -- starts -------------------------------------------------------------------------


def _start(experiments, model, n, offset, pole=1.0):
    """Return the better of two models with n poles there, with a constant input."""
    pairs = _with_one(experiments)
    starts = []
    for A_r, C in (_split(model.A, model.C, n), _summed(experiments, model, n)):
        A = block_diag(stabilize(A_r) if len(A_r) else A_r, pole * np.eye(n))
        blank = _blank(experiments, A, C, model.feedthrough)
        starts.append(_solve(pairs, blank, offset))
    return min(starts, key=lambda start: _criterion(pairs, start)[2])


def _split(A, C, n):
    """Return A_r and C of a model with n of its poles moved to one."""
    limit = np.sort(np.abs(np.linalg.eigvals(A) - 1))[n - 1] * (1 + 1e-9)
    # last in the Schur form: those near one; of a pair, one is a real pole then
    R, Z, n_far = schur(A, sort=lambda re, im=0.0: abs(re + 1j * im - 1) > limit)
    n_r = len(A) - n
    R_rr, R_ri, R_ii = R[:n_r, :n_r], R[:n_r, n_r:], R[n_r:, n_r:]
    X = np.zeros_like(R_ri)
    if 0 < n_r == n_far:
        X = solve_sylvester(R_rr, -R_ii, -R_ri)  # [I X; 0 I] decouples
    C = C @ Z
    return R_rr, np.hstack([C[:, :n_r], C[:, :n_r] @ X + C[:, n_r:]])


def _summed(experiments, model, n):
    """Return A_r and C of a model of the output's differences, summed up."""
    ny, n_r = len(model.C), len(model.A) - n
    pairs = _differences(experiments)
    horizon = min(max(HORIZONS), (max(len(u) for u, _ in pairs) + 1) // 8)
    if n_r == 0 or (horizon - 1) * ny < n_r:
        return np.zeros((n_r, n_r)), np.eye(ny, len(model.A), k=n_r)
    U, s = past_to_future(hankel_triangle(pairs, horizon), pairs, horizon)
    A_r, C_d = shift_structure(U, s, n_r, ny)
    rate = fit_input(pairs, A_r, C_d, True)
    # y+ = y + C_d x + D u, and y + C_d (I - A_r)^-1 x sums up the gain at rest alone
    C_r = -C_d @ np.linalg.inv(np.eye(n_r) - A_r)
    gain = rate.D - C_r @ rate.B
    return A_r, np.hstack([C_r, np.linalg.svd(gain)[0][:, :n]])


def _differences(experiments):
    """Return u and the differences of y, both without their means."""
    pairs = []
    for u, y in experiments:
        u, d = u[: len(u) - 1], np.diff(Filled(y)[:], axis=0)
        pairs.append((u, d))
    u_mean, d_mean = (np.mean(np.vstack(z), axis=0) for z in zip(*pairs, strict=True))
    return [(u - u_mean, d - d_mean) for u, d in pairs]


def _blank(experiments, A, C, feedthrough):
    """Return a model without inputs; a column for the constant is there."""
    nu = experiments[0][0].shape[1] + 1
    B, D = np.zeros((len(A), nu)), np.zeros((len(C), nu))
    return LinearModel(A, B, C, D, np.zeros((len(experiments), len(A))), feedthrough)


# -- search -------------------------------------------------------------------------


class _View(Sliced):
    """A signal that is changed as it is sliced."""

    def __init__(self, values, change, width):
        self.values, self.change, self.shape = values, change, (len(values), width)

    def __getitem__(self, part):
        return self.change(self.values[part])


def _with_one(experiments):
    return [
        (_View(u, lambda z: np.column_stack([z, np.ones(len(z))]), u.shape[1] + 1), y)
        for u, y in experiments
    ]


def _criterion(pairs, model):
    """Return criterion, free vector and simulation error of a model."""
    structure = model.structure
    criterion = Criterion(structure, pairs)
    free = criterion.join(structure.join(vars(model)), model.x0)
    return criterion, free, criterion.norm(free)


def _free(criterion, free_A, free_C, offset):
    """Return which entries of a free vector a search moves."""
    structure = criterion.structure
    mask = np.ones(criterion.n, dtype=bool)
    p = structure.split(mask[: structure.n_params])  # views
    p["A"][...], p["C"][...] = free_A, free_C
    p["B"][:, -1] = offset
    if "D" in p:
        p["D"][:, -1] = False
    return mask


def _solve(pairs, model, offset):
    """Solve for (B, D, x0), linear least squares."""
    criterion, free, _ = _criterion(pairs, model)
    mask = _free(criterion, False, False, offset)
    restricted = Restricted(criterion, free, mask)
    try:
        with single_threaded():
            JJ, Jr, _ = restricted.normal_equations(free[mask])
    except FloatingPointError:  # they overflow: the model is left as it is
        return model
    # the initial state of an experiment that was never measured moves nothing
    size = np.sqrt(np.where(np.diag(JJ) > 0, np.diag(JJ), 1.0))
    step = lstsq(JJ / np.outer(size, size), -Jr / size)[0] / size
    theta, x0 = criterion.split(restricted.to_free(free[mask] + step))
    return replace(model, **criterion.structure.split(theta), x0=x0)


def _refine(pairs, model, *, n, offset, max_iter=100, tol=1e-8, watch=None):
    """Refine a model with its integrators held; one that stays stable."""
    criterion, free, _ = _criterion(pairs, model)
    mask = _free(criterion, ~integrator_entries(len(model.A), n), True, offset)
    part = Restricted(criterion, free, mask)
    options = {"max_iter": max_iter, "tol": tol, "watch": watch, "label": LABEL}
    result = minimize(part, free[mask], to_point=part.to_free, **options)
    theta, x0 = criterion.split(part.to_free(result.x))
    refined = replace(model, **criterion.structure.split(theta), x0=x0, result=result)
    n_r = len(model.A) - n
    A_r = refined.A[:n_r, :n_r]
    if n_r == 0 or np.abs(np.linalg.eigvals(A_r)).max() < 1.0:
        return refined
    A = refined.A.copy()
    A[:n_r, :n_r] = stabilize(A_r, limit=1.0 - REFINED_MARGIN)
    reflected = _solve(pairs, replace(refined, A=A), offset)
    best = min(model, reflected, key=lambda m: _criterion(pairs, m)[2])
    return replace(best, result=result)


def _about_rest(found, experiments, model, n):
    """Move the constant input into the operating point (eq. integrate)."""
    nx, nu = len(found.A), found.B.shape[1] - 1
    r, i = slice(nx - n), slice(nx - n, nx)
    B, beta = found.B[:, :nu], found.B[:, nu]
    D = found.D[:, :nu]
    d = lstsq(B[i], beta[i])[0]  # B_i d = beta_i: with u + d the integrators rest
    rest = np.linalg.solve(np.eye(nx - n) - found.A[r, r], beta[r] - B[r] @ d)
    shift = found.C[:, r] @ rest - D @ d
    x0 = np.array(found.x0)
    x0[:, r] -= rest
    # what integrators can take of the outputs' shift is a matter of where they begin
    start = lstsq(found.C[:, i], shift)[0]
    x0[:, i] += start
    still = replace(found, B=B, D=D, x0=x0, singular_values=model.singular_values)
    shifted = [(_View(u, lambda z: z + d, len(d)), y) for u, y in experiments]
    scaled, _ = normalize(still, shifted)
    return Integrating(scaled, d, shift - found.C[:, i] @ start)

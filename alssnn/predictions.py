"""A predictor on a record: what it is told, how it follows, how likely its errors are.

A predictor (eq. predictor) sees what was measured.  Where nothing was, it is told what
it predicts itself; behind a long gap it starts anew.
"""

import numpy as np

from .experiments import gap
from .initial_states import WINDOW, estimate_x0
from .innovations import free_run, has_innovations, with_outputs
from .mapping import Held
from .sandwich import residual_moments
from .simulation import Stepper, regressors

GAP = 20  # rows without any output, behind which a predictor starts anew
EXACT = 1e-12  # variance of an error, of outputs of variance one, that is rounding
FAR = 100.0  # of a state of unit variance, from which a gap was too long


def told(experiments, *, from_rest=False):
    """Return the experiments that the fit of a predictor works on.

    Parameters
    ----------
    experiments : sequence of tuple of array, or Held
        Scaled experiments.
    from_rest : bool, default=False
        Whether they begin at rest. Then none starts anew, and none is cut.

    Returns
    -------
    experiments : Held
        Their `pieces`, with the measured outputs as further inputs.
    """
    held = Held.of(experiments)
    whole = with_outputs(held)
    if from_rest:  # only there a predictor knows where it is
        return Held(whole, held.n_jobs)
    parts = [(whole[i][0][part], whole[i][1][part]) for i, part in pieces(held)]
    return Held(parts, held.n_jobs)


def pieces(experiments):
    """Return where a predictor has something to follow.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y).

    Returns
    -------
    pieces : list of tuple of (int, slice)
        Number of the experiment, and rows: without those before the first and behind
        the last measurement, and without gaps of at least `GAP` rows. All rows of an
        experiment that was never measured.
    """
    found = []
    for i, (_, y) in enumerate(experiments):
        rows = np.flatnonzero(~np.isnan(y[:]).all(axis=1))
        if len(rows) == 0:
            found.append((i, slice(0, len(y))))
            continue
        cuts = np.flatnonzero(np.diff(rows) > GAP)
        starts, stops = rows[[0, *(cuts + 1)]], rows[[*cuts, -1]] + 1
        pairs = zip(starts.tolist(), stops.tolist(), strict=True)
        found += [(i, slice(*pair)) for pair in pairs]
    return found


def bridged(structure, theta, x0, experiments):
    """Return the experiments of a predictor, which fills gaps of y by what it predicts.

    Parameters
    ----------
    structure : Structure
        Predictor.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : sequence of tuple of ndarray
        Pairs ([u, y_m], y).

    Returns
    -------
    experiments : Held
        The same pairs, where y_m is what is predicted wherever y is nan.
    """
    held = Held.of(experiments)
    parts = [
        (follow(structure, theta, start, z, y[:])[0], y)
        for (z, y), start in zip(held, x0, strict=True)
    ]
    return Held(parts, held.n_jobs)


def follow(structure, theta, x0, z, y):
    """Let a predictor follow a record, and fill its gaps.

    Parameters
    ----------
    structure : Structure
        Predictor.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (nx,)
        Initial state.
    z : ndarray of shape (N, nu + ny)
        Inputs, then the measured outputs, filled in any way.
    y : ndarray of shape (N, ny)
        Outputs; nan where not measured.

    Returns
    -------
    z : ndarray of shape (N, nu + ny)
        The same, filled by what is predicted.
    X : ndarray of shape (N, nx)
        Predicted states. In a gap of an unstable plant they grow, and from `FAR` on
        start anew at the operating point.
    """
    plain = structure.observe(structure.measured)
    lure = plain.lure(theta)
    step, z, x = Stepper(lure, float), np.array(z), plain.initial_state(x0)
    missing, y_m = np.isnan(y), z[:, -y.shape[1] :]  # a view
    X = np.empty((len(z) + 1, len(x)))
    X[0] = x
    stops = [*np.flatnonzero(missing.any(axis=1)), len(z)]
    for row, stop in zip([0, *stops[:-1]], stops, strict=True):
        if stop > row:  # whose gaps are filled
            with np.errstate(over="ignore", invalid="ignore"):
                step(z[row:stop], X[row], X[row + 1 : stop + 1])
        if stop == len(z):
            break
        if not np.abs(X[stop]).max() < FAR:
            X[stop] = 0.0
        y_hat = regressors(lure, X[stop : stop + 1], z[stop : stop + 1])[0]
        y_m[stop, missing[stop]] = (y_hat @ lure.rows_z.T)[missing[stop]]
    return z, X[:-1]


def first_states(structure, theta, x0, experiments, *, noise=1.0, prior=None):
    """Return the initial states of whole experiments.

    Parameters
    ----------
    structure : Structure
        What was fitted.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_pieces, nx)
        Initial states of what was `told`, or of experiments from their first measured
        samples on.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.
    noise : float, default=1.0
        Mean square error that is expected behind a gap, outputs of unit variance.
    prior : Prior or None, default=None
        Where the states of an experiment that begins with a gap are expected, as in
        `estimate_x0`.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, nx)
        The same without a random walk; estimated from its first samples where an
        experiment begins with a gap.
    """
    if has_innovations(structure):
        owners = np.array([i for i, _ in pieces(experiments)])
        firsts = np.searchsorted(owners, np.arange(len(experiments)))
        x0 = x0[firsts, : structure.sizes["x"]]
    gaps = np.array(Held.of(experiments).map(gap))
    if gaps.any():
        found = estimate_x0(
            free_run(structure),
            theta,
            experiments,
            window=np.where(gaps > 0, gaps + WINDOW, 0),
            noise=noise,
            prior=prior,
        )
        x0 = np.where(gaps[:, None] > 0, found, x0)
    return x0


def error_covariance(structure, theta, x0, experiments):
    """Return the covariance of the errors of a model on a record.

    Parameters
    ----------
    structure : Structure
        What was fitted: a predictor, of a model with innovations.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : Held
        What it was fitted to: `told`, to a predictor.

    Returns
    -------
    Lambda : ndarray of shape (ny, ny)
        Mean products of the errors, scaled; not finite if they overflow.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        moments = residual_moments(structure, theta, x0, experiments)
        return moments.products[0] / np.maximum(moments.pairs[0], 1)


def deviance(structure, theta, x0, experiments):
    """Return how unlikely a record is to a predictor (eq. deviance).

    The weights of its training, of outputs and of networks, have no part in it.

    Parameters
    ----------
    structure : Structure
        Predictor.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : Held
        What was `told`.

    Returns
    -------
    deviance : float
        Logarithm of the determinant of the covariance of the errors: -2 log L of
        normal innovations per sample, but for constants; inf if they overflow.
    """
    Lambda = error_covariance(structure, theta, x0, experiments)
    if not np.isfinite(Lambda).all():
        return np.inf
    # eq. deviance; digits of what is predicted exactly shall not decide
    return float(np.linalg.slogdet(Lambda + EXACT * np.eye(len(Lambda)))[1])


def surprise(structure, theta, experiments):
    """Return how unlikely a record is to a predictor that is told nothing but y.

    Parameters
    ----------
    structure : Structure
        Predictor.
    theta : ndarray of shape (n_params,)
        Its parameters.
    experiments : Held
        What was `told`.

    Returns
    -------
    surprise : float
        The `deviance` where its states begin at rest, and where it fills the gaps of y
        by what it predicts itself: a model that hangs on an exact start, or on what
        gaps were filled with in its training, is much surprised.
    """
    x0 = np.zeros((len(experiments), structure.n_x0))
    return deviance(structure, theta, x0, bridged(structure, theta, x0, experiments))


def likeliest(outcomes, experiments):
    """Return the predictor of the least deviance (eq. deviance).

    Parameters
    ----------
    outcomes : list of tuple
        Pairs whose first is (structure, theta, result), as of a training.
    experiments : Held
        What they were fitted to.

    Returns
    -------
    outcome : tuple
        One of them; the only one, whatever its training was.
    """
    if len(outcomes) == 1:
        return outcomes[0]

    def unlikely(outcome):
        structure, theta, result = outcome[0]
        return deviance(structure, theta, result.x0, experiments)

    return min(outcomes, key=unlikely)

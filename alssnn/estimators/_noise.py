"""What noise a model is fitted for: the option `noise`."""

import numpy as np

from ..initial_states import WINDOW, estimate_x0
from ..innovations import (
    INNOVATION,
    free_run,
    has_innovations,
    predictor,
    with_outputs,
)
from ..mapping import Held
from ..sandwich import residual_moments
from ..simulation import Stepper, regressors
from ._warn import warn_of_training

INNOVATIONS = "innovations"
GAP = 20  # rows without any output, behind which a predictor starts anew
SPLIT = 1e-3  # of the error of the linear model: least weight of h(y_m)
MOST_LOST = 0.3  # share of an output that may be missing without a warning
FAR = 100.0  # of a state of unit variance, from which a gap was too long
PREDICTED, MEASURED = "predicted", "measured"


def is_predicting(estimator):
    """Tell whether an estimator is fitted by its errors one sample ahead.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator.

    Returns
    -------
    is_predicting : bool
        Whether its option `noise` asks for innovations.
    """
    return estimator.noise == INNOVATIONS


def check_noise(estimator):
    """Refuse options that have no meaning for a model with innovations.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.

    Raises
    ------
    ValueError
        If integrators are held, or a linear start is given.
    """
    if not is_predicting(estimator):
        return
    if estimator.integrators not in ("auto", 0):
        raise ValueError(
            "`integrators` must be 'auto' or 0 for noise='innovations', got "
            f"{estimator.integrators}. K tells states that integrate from the record, "
            "and their poles are found with the others."
        )
    if estimator.linear_start is not None:
        raise ValueError(
            "`linear_start` must be None for noise='innovations', for it has no gain "
            "K. Take noise='output', or leave the start to the fit."
        )


def told(estimator, experiments):
    """Return the experiments that a fit works on.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.

    Returns
    -------
    experiments : Held or Remote
        The same; for a predictor its `pieces`, with the measured outputs as further
        inputs.

    Raises
    ------
    ValueError
        If a predictor's experiments live elsewhere.
    """
    experiments = Held.of(experiments)
    if not is_predicting(estimator):
        return experiments
    if not experiments.is_here:
        raise ValueError(
            "`noise` must be 'output' for experiments on a cluster, got "
            f"{estimator.noise!r}. Fit such a model where the record is."
        )
    whole = with_outputs(experiments)
    parts = [(whole[i][0][part], whole[i][1][part]) for i, part in pieces(experiments)]
    lost = max(np.isnan(y).mean(axis=0).max() for _, y in parts)
    if lost > MOST_LOST:
        warn_of_training(
            f"{100 * lost:.0f} % of an output were not measured: what is predicted one "
            "sample ahead is not checked there, and noise='innovations' may fail. "
            "Compare with noise='output'."
        )
    return Held(parts, experiments.n_jobs)


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


def identified(estimator, experiments, previous, watch, held_out):
    """Return the outcome of a fit, and the experiments that it has worked on.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.
    previous : tuple of (Structure, ndarray) or None
        Structure and parameters from which a fit goes on.
    watch : Watch
        What follows the fit.
    held_out : Validation or None
        What judges the fit by other data.

    Returns
    -------
    experiments : Held or Remote
        Of a predictor, what was told to it.
    structure : Structure
        What was fitted.
    theta : ndarray of shape (n_params,)
        Its parameters.
    result : OptimizeResult
        How the training ended.

    Notes
    -----
    Gaps of y are bridged by straight lines first. Where there are any, a second
    training sees what the first model predicts there.
    """
    seen = told(estimator, experiments)
    fitted, theta, result = estimator._identify(seen, previous, watch, held_out)
    if is_predicting(estimator) and any(np.isnan(y[:]).any() for _, y in seen):
        seen, previous = bridged(fitted, theta, result.x0, seen), (fitted, theta)
        fitted, theta, result = estimator._identify(seen, previous, watch, held_out)
    return seen, fitted, theta, result


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
    return Held(
        [
            (follow(structure, theta, start, z, y[:])[0], y)
            for (z, y), start in zip(experiments, x0, strict=True)
        ]
    )


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


def first_states(estimator, structure, theta, x0, experiments):
    """Return the initial states of whole experiments.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        What was fitted.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_pieces, nx)
        Initial states of what `told` returned.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, nx)
        The same; estimated from its first samples where an experiment begins with a
        gap.
    """
    if not is_predicting(estimator):
        return x0
    starts, found = pieces(experiments), np.zeros((len(experiments), x0.shape[1]))
    for i, pair in enumerate(experiments):
        first = next(k for k, (j, _) in enumerate(starts) if j == i)
        if starts[first][1].start == 0:
            found[i] = x0[first]
        else:
            kind = {"window": WINDOW, "noise": 1.0}
            found[i] = estimate_x0(free_run(structure), theta, [pair], **kind)[0]
    return found


def n_measured(estimator, experiments):
    """Return how many inputs of the experiments of a fit are measured outputs.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array
        What `told` returned.

    Returns
    -------
    n : int
        Number of last inputs; zero without innovations.
    """
    return experiments[0][1].shape[1] if is_predicting(estimator) else 0


def fitted_view(estimator, structure):
    """Return the view of a structure that a fit works on.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    structure : Structure
        What a model declares.

    Returns
    -------
    structure : Structure
        Its predictor, for a model with innovations.

    Raises
    ------
    ValueError
        If a model that is to have innovations declares none.
    """
    if is_predicting(estimator) and not has_innovations(structure):
        raise ValueError(
            f"`noise` must be known to the structure that `_declare` returns, got "
            f"{estimator.noise!r} for one without the signal {INNOVATION!r}. Declare "
            "its gain K, or take noise='output'."
        )
    return predictor(structure)


def noise_covariance(estimator, structure, x0, experiments):
    """Return the covariance of the training errors.

    Parameters
    ----------
    estimator : StateSpaceModel
        Fitted estimator.
    structure : Structure
        What was fitted: a predictor, of a model with innovations.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : Held or Remote
        What `told` returned.

    Returns
    -------
    Lambda : ndarray of shape (ny, ny)
        Covariance of the errors, in the user's units; of experiments that live
        elsewhere, a diagonal matrix that the cost makes.
    """
    scale = estimator._scaling.y_scale
    if not experiments.is_here:
        return np.diag(estimator.cost_ / len(scale) * scale**2)
    with np.errstate(over="ignore", invalid="ignore"):
        moments = residual_moments(structure, estimator._theta, x0, experiments)
        Lambda = moments.products[0] / np.maximum(moments.pairs[0], 1)
    return Lambda * np.outer(scale, scale)


def forms(estimator):
    """Return what h may see in the predictors that are to compete.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.

    Returns
    -------
    forms : list of str
        One or two of "measured" and "predicted".
    """
    choice = getattr(estimator, "h_sees", PREDICTED)
    sees_y = getattr(estimator, "n_h", 0) != 0 and estimator.feedback == "output"
    if not is_predicting(estimator) or not sees_y:
        return [PREDICTED]
    return [MEASURED, PREDICTED] if choice == "auto" else [choice]


def least_gamma_h(estimator):
    """Return the weight of h that settles what is of A and K, and what of h.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.

    Returns
    -------
    gamma_h : float
        A small share of what the linear model leaves, if h sees the measured outputs:
        the data cannot tell L y of h from A and K there (eq. innovations). Else zero.
    """
    sees_y_m = is_predicting(estimator) and estimator.h_sees_ == MEASURED
    return SPLIT * estimator._linear_cost if sees_y_m else 0.0

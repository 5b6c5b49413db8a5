"""Linear models with a random walk that nobody measured (eq. drift).

A walk b+ = b + K_b eps is not stationary, and a regression on the past would spend
states on it.  Filtered by

    L(q) = (q - 1) / (q - 1 + kappa)

it is white noise of one sample, or nearly so: with K_b = kappa at the output and K = 0,
L (b + eps) = eps exactly, whatever A, B and C are, and these are what L u and L y tell.
Every rate kappa gives a start.  That of kappa = 0 is the model without a walk, so that
none is found where it does not predict better.  All are refined by their errors one
sample ahead.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import pinv
from scipy.signal import lfilter

from .criterion import Criterion
from .equations import LEAST_GAIN as LEAST_SLOPE
from .experiments import Filled, stretch
from .initial_states import WINDOW, estimate_x0
from .innovations import DRIFT, drift_of
from .inputs import join_inputs, split_inputs
from .limits import Limits
from .linear_model import decorrelate
from .simulation import outputs
from .subspace import (
    POLISH_STEPS,
    TRIAL_SAMPLES,
    identify_linear,
)

RATES = (0.0, 0.05, 0.3)  # kappa of the starts
SHARES = (1.0, 0.3, 0.1)  # of kappa, for K explains some of the walk
LEAST_GAIN = 1e-2  # of the input at rest, relative, that a walk may act through
NOISE = 0.1  # mean square error that the estimate of a start expects
SAME = 1e-9  # difference of predictions that is rounding, outputs of unit variance


def identify(experiments, nx, *, drift=None, given=(), **options):
    """Identify a linear model, with a random walk if one is declared.

    Parameters
    ----------
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations; with a walk ([u, y_m], y) of a predictor.
    nx : int
        Order, without the walk.
    drift : {"output", "input"} or None, default=None
        What the walk is added to; None identifies a model without.
    given : sequence of int, default=()
        Columns of u that are measured disturbances, which no walk is added to.
    **options : dict
        Those of `identify_linear`.

    Returns
    -------
    model : LinearModel
        Model whose states have unit variance over the record.

    Raises
    ------
    ValueError
        If the longest experiment is too short for the order.

    Notes
    -----
    A walk costs three subspace estimates and six refinements instead of one.
    """
    if drift is None:
        return identify_linear(experiments, nx, **options)
    watch = options.get("watch")
    trial = stretch(experiments, TRIAL_SAMPLES)
    is_trial = sum(len(u) for u, _ in trial) < sum(len(u) for u, _ in experiments)
    steps = {name: options[name] for name in ("max_iter", "tol") if name in options}
    found = []
    for rate in RATES:
        model = identify_linear(filtered(trial, rate), nx, **options)
        points = [
            _started(trial, walk, given, is_known=rate == 0)
            for walk in _walks(model, drift, given, rate)
        ]
        best = min(points, key=lambda point: point[0].norm(point[1]))
        found.append(_refined(model, drift, given, *best, watch=watch, **steps))
        if watch is not None and watch.reason is not None:
            break
    model = min(found, key=lambda one: one.result.cost)
    if is_trial:
        point = _started(experiments, model, given)
        steps["max_iter"] = POLISH_STEPS
        model = _refined(model, drift, given, *point, watch=watch, **steps)
    return decorrelate(model, experiments)


def count_walks(experiments, n_measured=0, drift=None):
    """Return how many random walks a linear predictor of some records has, at most.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs ([u, y_m], y).
    n_measured : int, default=0
        Number of columns of y_m.
    drift : {"output", "input"} or None, default=None
        What the walks are added to.

    Returns
    -------
    count : int
        One per output, or per input: those of measured disturbances do not move.
    """
    u, y = experiments[0]
    return {None: 0, "output": y.shape[1], "input": u.shape[1] - n_measured}[drift]


def filtered(experiments, rate):
    """Return records without what is slow.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y); nan where y was not measured.
    rate : float
        Rate kappa of the filter L (eq. drift); zero filters nothing.

    Returns
    -------
    experiments : list of tuple of ndarray
        Pairs (L u, L y), multiplied by one number that makes the mean square of L y
        one.
    """
    if rate == 0:
        return list(experiments)

    def fast(signal):
        return lfilter([1.0, -1.0], [1.0, rate - 1.0], signal - signal[:1], axis=0)

    pairs = [(fast(u[:]), fast(Filled(y)[:])) for u, y in experiments]
    for (_, y_f), (_, y) in zip(pairs, experiments, strict=True):
        y_f[np.isnan(y[:])] = np.nan
    square = np.nanmean(np.concatenate([y for _, y in pairs]) ** 2)
    factor = 1.0 / np.sqrt(square) if square > 0 else 1.0
    return [(factor * u, factor * y) for u, y in pairs]


def centered(structure, theta, x0, experiments):
    """Return the same predictor with a walk at the input of zero mean (eq. center).

    Parameters
    ----------
    structure : Structure
        Predictor; one without a walk at the input is returned as it is.
    theta : ndarray of shape (n_params,)
        Parameters.
    x0 : ndarray of shape (n_experiments, nx + nb)
        Initial states of the model and of the walk, all of them free.
    experiments : Held
        What the predictor is told.

    Returns
    -------
    theta : ndarray of shape (n_params,)
        Parameters that take the mean of the walk over what was measured into the
        output bias of a network; the same where no bias can.
    x0 : ndarray of shape (n_experiments, nx + nb)
        Initial states.
    """
    p = structure.split(theta)
    bias = next((name for name in ("b_h", "b_g") if name in p), None)
    # where its bias is zero as well, networks are left out: there is no constant
    if drift_of(structure) != "input" or bias is None or not p[bias].any():
        return theta, x0
    seen = structure.observe(structure.measured, DRIFT)
    before = _followed(seen, theta, x0, experiments)
    ny = structure.sizes[structure.measured]
    measured = [np.isfinite(y[:]).any(axis=1) for _, y in experiments]
    levels = [Z[rows, ny:] for Z, rows in zip(before, measured, strict=True)]
    mean = np.concatenate(levels).mean(axis=0)
    if not np.isfinite(mean).all():
        return theta, x0
    theta_c = structure.join(_shifted(structure, p, bias, mean))
    x0_c = x0.copy()
    x0_c[:, -len(mean) :] -= [mean * rows.any() for rows in measured]
    after = _followed(seen, theta_c, x0_c, experiments)
    for one, other, rows in zip(before, after, measured, strict=True):
        # such as of D, or of g that is tied to zero at rest
        if rows.any() and not np.abs(one - other)[:, :ny].max() <= SAME:
            return theta, x0
    return theta_c, x0_c


def _shifted(structure, p, bias, mean):
    """Return parameters of the same model of an input that is less by a constant."""
    given = structure.options.get("disturbances", ())
    p, moved = dict(p), split_inputs(structure.sizes["u"], given)[0]
    slope = 1.0  # of v by u
    if "b_phi" in p:
        p["b_phi"] = p["b_phi"] + p["U_phi"] @ mean
        slope = LEAST_SLOPE + p["r_phiu"] ** 2
    if "b_x" in p and "W_u" in p:
        p["b_x"] = p["b_x"] + p["W_u"][:, moved] @ mean
    p[bias] = p[bias] + (slope * mean if bias == "b_h" else p["B"] @ mean)
    return p


def _followed(structure, theta, x0, experiments):
    """Return the channels of a predictor along its experiments."""
    lure = structure.lure(theta)
    pairs = zip(experiments, x0, strict=True)
    return [outputs(lure, u[:], structure.initial_state(one)) for (u, _), one in pairs]


def _walks(model, drift, given, rate):
    """Return a model of filtered records with walks that the filter may stand for."""
    nu, ny, n = model.nu, len(model.C), len(model.x0)
    K_b = rate * np.eye(ny)
    if drift == "input":  # the walk that the output sees at rest is the same
        p, moved = model.by_name(), split_inputs(nu, given)[0]
        at_rest = model.C @ pinv(np.eye(len(p["A"])) - p["A"]) @ p["B"] + p["D"]
        K_b = np.zeros((nu, ny))
        K_b[moved] = rate * pinv(at_rest[:, moved], rtol=LEAST_GAIN)
    model = replace(model, drift=drift, b0=np.zeros((n, len(K_b))))
    return [replace(model, K_b=share * K_b) for share in SHARES if rate or share == 1]


def _started(experiments, model, given, is_known=False):
    """Return the criterion of a search, and the point where it starts."""
    structure, theta, fit = model.as_fit(given)
    criterion = Criterion(structure, experiments)
    theta = Limits(structure).clip(theta)
    if is_known:
        return criterion, criterion.join(theta, fit.x0)
    x0 = estimate_x0(structure, theta, experiments, window=WINDOW, noise=NOISE)
    return criterion, criterion.join(theta, x0)


def _refined(model, drift, given, criterion, free, **options):
    """Return the model of least errors one sample ahead near a point."""
    limits = Limits(criterion.structure, radius=model.radius)
    result = limits.minimize(criterion, free, label="linear", **options)
    theta, x0 = criterion.split(result.x)
    p, nx = criterion.structure.split(theta), len(model.A)
    K_b, b0 = p["K_b"], x0[:, nx:]
    if drift == "input":
        K_b = join_inputs(K_b.T, np.zeros(len(given)), given).T
        b0 = join_inputs(b0, np.zeros(len(given)), given)
    found = {"x0": x0[:, :nx], "b0": b0, "K_b": K_b, "drift": drift, "result": result}
    return model.with_matrices(p, given, **found)

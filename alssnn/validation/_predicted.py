"""The errors by which a model is judged: those that its fit has made small.

A model that was fitted to the simulation error has the residual of a free run.  One
with innovations has errors one sample ahead (eq. innovations), white and independent of
all that was before, also in a closed loop; of its free run one can ask neither, for
noise of the process goes through the plant.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from ..experiments import gap
from ..initial_states import estimate_x0
from ..innovations import has_innovations, predictor
from ..plants import as_plant
from ..predictions import follow, pieces, told
from ..simulation import regressors
from ._scored import derivatives, scored_experiments, scored_sensitivities, simulated


def predicts(model):
    """Tell whether a model is judged by its errors one sample ahead.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    predicts : bool
        Whether it has innovations.
    """
    return has_innovations(model.fitted_.structure)


def judged_experiments(model, u, y, experiment=None, *, exact=False):
    """Return what the tests of residuals need of a model on a record.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    exact : bool, default=False
        Whether the parameters count as exact.

    Returns
    -------
    experiments : list of tuple of ndarray
        Tuples (u, y, y_hat) of the scored samples, as of `scored_experiments`; y_hat
        is predicted one sample ahead if the model has innovations.
    options : dict
        Options `sensitivities`, `ahead` and `first_lag` of `residual_tests`.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the data do not fit the model, or its predictor is unstable.
    """
    data = u, y, experiment
    if predicts(model):
        experiments, derivatives = _ahead(model, *data)
        # a controller without delay has seen y of the same sample
        first_lag = int(not as_plant(model).arrived().feeds_through)
    else:
        experiments, _ = scored_experiments(model, *data)
        derivatives = None if exact else scored_sensitivities(model, *data)
        first_lag = 0
    return experiments, {
        "sensitivities": None if exact else derivatives,
        "ahead": predicts(model),
        "first_lag": first_lag,
    }


def share_outside(model, u, y, experiment=None, *, surely=False):
    """Return the share of samples whose predicted states are outside the training.

    A free run of an unstable plant leaves any region; its states as they are predicted
    do not.

    Parameters
    ----------
    model : estimator
        Fitted model with innovations that knows its region.
    u : array_like of shape (N, nu), or list of them
        Inputs.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    surely : bool, default=False
        Whether only samples that are surely outside count.

    Returns
    -------
    share : float
        Share of all samples.
    """
    fit, region = model.fitted_, as_plant(model).arrived().region
    scaling, outside = fit.scaling, []
    for piece in _followed(model, u, y, experiment):
        du = piece.z[:, : len(scaling.u_scale)] * scaling.u_scale
        told = piece.z[:, len(scaling.u_scale) :] * scaling.y_scale
        X = piece.X[:, : len(fit.x_scale)] * fit.x_scale  # without a random walk
        dy_hat = piece.y_hat * scaling.y_scale
        outside.append(region.outside(X, du, dy_hat, told, surely=surely))
    return float(np.concatenate(outside).mean())


class _Piece(NamedTuple):
    """What a predictor has followed without a break, in scaled deviations."""

    x0: np.ndarray
    z: np.ndarray  # inputs, then what was measured or, where it was not, predicted
    y: np.ndarray
    X: np.ndarray
    y_hat: np.ndarray
    start: int  # first sample that counts


def _ahead(model, u, y, experiment):
    """Return experiments with predictions one sample ahead, and their derivatives."""
    fit, experiments, parts = model.fitted_, [], []
    structure, scaling = predictor(fit.structure), fit.scaling
    for piece in _followed(model, u, y, experiment):
        n, start = len(scaling.u_scale), piece.start
        arrived = piece.z[start:, :n] * scaling.u_scale + scaling.u_offset
        outputs = (Y[start:] * scaling.y_scale for Y in (piece.y, piece.y_hat))
        experiments.append((arrived, *(Y + scaling.y_offset for Y in outputs)))
        parts.append(partial(derivatives, structure, fit, piece.x0, piece.z, start))
    return experiments, parts


def sent_experiments(model, u, y, experiment=None):
    """Return inputs as they were sent, and free runs, of `judged_experiments`.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    experiments : list of tuple of ndarray
        Pairs (u, y_hat) of the samples that are judged: late inputs are there before
        they arrive, y_hat is simulated.
    """
    found = []
    for record in model.prepare_records(u, y, experiment):
        y_hat, judged = simulated(model, record), [record.scored]
        if predicts(model):
            judged = [
                slice(part.start + start, part.stop) for part, start in _parts(record)
            ]
        found += [(record.u[rows], y_hat[rows]) for rows in judged]
    return found


def _parts(record):
    """Return the rows of every piece of a record, and how many do not count."""
    parts = [part for _, part in pieces([(record.u_s, record.y_s)])]
    # at most half of a piece between two gaps is left to its initial state
    window = record.start - gap(record.u_s, record.y_s)  # pieces begin behind gaps
    starts = [min(window, (part.stop - part.start) // 2) for part in parts]
    return list(zip(parts, starts, strict=True))


def _followed(model, u, y, experiment):
    """Return the pieces of records on which a predictor was judged."""
    fit, found = model.fitted_, []
    structure = predictor(fit.structure)
    plain = structure.observe(structure.measured)
    lure = plain.lure(fit.theta)
    for record in model.prepare_records(u, y, experiment):
        parts = told([(record.u_s, record.y_s)])
        for (z, y_s), (_, start) in zip(parts, _parts(record), strict=True):
            (x0,) = estimate_x0(
                structure, fit.theta, [(z, y_s)], window=start, noise=fit.cost
            )
            z, X = follow(structure, fit.theta, x0, z, y_s[:])
            y_hat = regressors(lure, X, z) @ lure.rows_z.T
            found.append(_Piece(x0, z, y_s[:], X, y_hat, start))
    return found

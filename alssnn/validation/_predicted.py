"""The errors by which a model is judged: those that its fit has made small.

A model that was fitted to the simulation error has the residual of a free run.  One
with innovations has errors one sample ahead (eq. innovations), white and independent of
all that was before, also in a closed loop; of its free run one can ask neither, for
noise of the process goes through the plant.
"""

from functools import partial

import numpy as np

from ..initial_states import estimate_x0
from ..innovations import has_innovations, predictor, with_outputs
from ..plant import as_plant
from ..simulation import sensitivities, simulate
from ._scored import scored_experiments, scored_sensitivities


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
    structure = predictor(fit.structure)
    lure = structure.observe(structure.measured).lure(fit.theta)
    outside = []
    for record, x0, z, dy_hat in _predicted(model, u, y, experiment):
        X = simulate(lure, z, x0)[:-1] * fit.x_scale
        measured = np.where(np.isnan(record.dy), dy_hat, record.dy)
        outside.append(region.outside(X, record.du, dy_hat, measured, surely=surely))
    return float(np.concatenate(outside).mean())


def _ahead(model, u, y, experiment):
    """Return experiments with predictions one sample ahead, and their derivatives."""
    fit, experiments, parts = model.fitted_, [], []
    structure, scaling = predictor(fit.structure), fit.scaling
    for record, x0, z, dy_hat in _predicted(model, u, y, experiment):
        arrived = record.du + scaling.u_offset
        pieces = arrived, record.y, dy_hat + scaling.y_offset
        experiments.append(tuple(z[record.scored] for z in pieces))
        parts.append(partial(_derivatives, structure, fit, x0, z, record.start))
    return experiments, parts


def _predicted(model, u, y, experiment):
    """Return records with initial states, inputs of the predictor and predictions."""
    records, fit = model.prepare_records(u, y, experiment), model.fitted_
    structure, scaling = predictor(fit.structure), fit.scaling
    starts = [
        estimate_x0(
            structure,
            fit.theta,
            with_outputs([(record.u_s, record.y_s)]),
            window=record.start,
            noise=fit.cost,
        )[0]
        for record in records
    ]
    x0 = np.array(starts) * fit.x_scale
    y_hat = model.predict_ahead(u, y, 1, experiment, x0=x0)
    y_hat = np.concatenate(y_hat) if isinstance(y_hat, list) else y_hat
    y_hat = y_hat.reshape(len(y_hat), -1) - scaling.y_offset
    found = []
    for record, start in zip(records, starts, strict=True):
        dy_hat = y_hat[record.part]
        # what was not measured, the predictor has seen as it was predicted
        told = np.where(np.isnan(record.dy), dy_hat, record.dy) / scaling.y_scale
        found.append((record, start, np.hstack([record.u_s[:], told]), dy_hat))
    return found


def _derivatives(structure, fit, x0, z, n_skipped):
    """Yield the derivatives of the scored predictions, chunk by chunk."""
    n, ones = structure.n_params, np.ones(structure.nz)
    for part, _, J in sensitivities(structure, fit.theta, x0, z, ones):
        J = J[max(n_skipped - part.start, 0) :]
        if len(J):
            yield J[..., :n][..., fit.free], J[..., n:]

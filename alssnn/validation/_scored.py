"""What a fitted model says about records: the samples that count, one by one.

The initial state of every experiment is estimated from its first samples, as `score`
does, and these samples are left out (`prepare_records`).
"""

from functools import partial

import numpy as np

from ..plants import as_plant
from ..sensitivities import sensitivities
from ..simulation import channels, outputs, simulate

PERFECT = 1e-10  # residual over output that is rounding


def scored_experiments(model, u, y, experiment=None):
    """Return inputs, measured and simulated outputs of every experiment.

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
        Tuples (u, y, y_hat) of the scored samples, in the user's units; u is what
        arrives at the plant, late inputs are late.
    starts : list of int
        Number of samples before the first scored one, per experiment.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the data do not fit the model.
    """
    plant = as_plant(model).arrived()
    records = model.prepare_records(u, y, experiment)
    experiments = []
    for record in records:
        pieces = (record.du + plant.u_offset, record.y, simulated(model, record))
        experiments.append(tuple(z[record.scored] for z in pieces))
    return experiments, [record.start for record in records]


def simulated(model, record):
    """Return the outputs of a free run along a prepared record.

    Parameters
    ----------
    model : estimator
        Fitted model.
    record : PreparedRecord
        Experiment, as the model has prepared it.

    Returns
    -------
    y_hat : ndarray of shape (N, ny)
        Outputs, in the user's units; inf where the simulation diverges.
    """
    fit = model.fitted_
    lure = fit.structure.observe(fit.structure.measured).lure(fit.theta)
    y_s = outputs(lure, record.u_s, record.x0 / fit.x_scale)
    return y_s * fit.scaling.y_scale + fit.scaling.y_offset


def scored_sensitivities(model, u, y, experiment=None):
    """Return the derivatives of the simulations of `scored_experiments`.

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
    parts : list of callable
        Per experiment, a function of no argument that yields (J, J_x0) of consecutive
        scored samples, of shapes (L, ny, n) and (L, ny, nx): derivatives of the scaled
        outputs by the parameters that were free in the training and by the initial
        state.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the data do not fit the model.
    """
    records, fit = model.prepare_records(u, y, experiment), model.fitted_
    return [
        partial(derivatives, fit.structure, fit, r.x0 / fit.x_scale, r.u_s, r.start)
        for r in records
    ]


def derivatives(structure, fit, x0, u, start):
    """Yield the derivatives of the channels of scored samples, chunk by chunk.

    Parameters
    ----------
    structure : Structure
        The model, or its predictor.
    fit : FittedModel
        What was fitted: its parameters, and which of them were free.
    x0 : ndarray of shape (n_x0,)
        Initial state, scaled.
    u : ndarray of shape (N, n)
        Scaled inputs.
    start : int
        Number of samples before the first scored one.

    Yields
    ------
    J : ndarray of shape (L, ny, n)
        Derivatives by the parameters that were free.
    J_x0 : ndarray of shape (L, ny, n_x0)
        Those by the initial state.
    """
    n, ones = structure.n_params, np.ones(structure.nz)
    for part, _, J in sensitivities(structure, fit.theta, x0, u, ones):
        J = J[max(start - part.start, 0) :]
        if len(J):
            yield J[..., :n][..., fit.free], J[..., n:]


def surely_outside(model, u, y, experiment=None):
    """Return the share of samples that are surely outside the training region.

    Parameters
    ----------
    model : estimator
        Fitted model that knows its region.
    u : array_like of shape (N, nu), or list of them
        Inputs.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    share : float
        Share of all samples, those included that estimate the initial states, as
        `linearizability` counts them.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the data do not fit the model.
    """
    plant, fit, outside = as_plant(model).arrived(), model.fitted_, []
    structure = fit.structure.observe(fit.structure.measured)
    lure = structure.lure(fit.theta)
    for record in model.prepare_records(u, y, experiment):
        X = simulate(lure, record.u_s, structure.initial_state(record.x0 / fit.x_scale))
        with np.errstate(over="ignore", invalid="ignore"):
            y_hat = channels(lure, X[:-1], record.u_s) * fit.scaling.y_scale
            X = X[:-1] * fit.x_scale
        measured = np.where(np.isnan(record.dy), y_hat, record.dy)
        found = plant.region.outside(X, record.du, y_hat, measured, surely=True)
        outside.append(found)
    return float(np.concatenate(outside).mean())


def check_names(name, names, letter, size):
    """Return one name per signal.

    Parameters
    ----------
    name : str
        Name of the argument.
    names : sequence of str or None
        Names; None means letter and number.
    letter : str
        Letter of default names.
    size : int
        Number of signals.

    Returns
    -------
    names : list of str
        Names.

    Raises
    ------
    ValueError
        If their number is wrong.
    """
    if names is None:
        return [f"{letter}{i}" for i in range(size)]
    names = [str(z) for z in names]
    if len(names) != size:
        raise ValueError(
            f"`{name}` must have one name per signal ({size}), got {len(names)}. "
            "Add the unit to a name, such as 'speed [rad/s]'."
        )
    return names


def column_names(model):
    """Return names of the inputs and outputs of a model, as its data have them.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    inputs, outputs : list of str
        Names of the columns of the training data, else u0, u1, ... and y0, y1, ...
    """
    inputs = getattr(model, "feature_names_in_", None)
    return (
        check_names("feature_names_in_", inputs, "u", model.n_features_in_),
        check_names("output_names_", model.output_names_, "y", len(model.C_)),
    )


def moved_names(model):
    """Return names of the inputs that a controller moves, as of `column_names`.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    names : list of str
        Names, without those of measured disturbances.
    """
    return [column_names(model)[0][i] for i in model.plant_.moved]


def is_rounding(r, y):
    """Tell whether residuals are errors of rounding.

    Parameters
    ----------
    r, y : sequence of ndarray
        Residuals and outputs of every experiment; nan where nothing was measured, of
        some experiments everywhere.

    Returns
    -------
    is_rounding : bool
        Whether the largest residual is 1e-10 of the largest output at most.
    """
    size, scale = (
        max(float(np.nanmax(np.abs(part), initial=0.0)) for part in parts)
        for parts in (r, y)
    )
    return size <= PERFECT * scale


def count_estimated(sensitivities):
    """Return the number of parameters whose errors count.

    Parameters
    ----------
    sensitivities : sequence of callable or None
        What `scored_sensitivities` returns; None for exact parameters.

    Returns
    -------
    n_parameters : int
        How many there are.
    """
    return 0 if sensitivities is None else next(sensitivities[0]())[0].shape[2]

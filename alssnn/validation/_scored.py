"""What a fitted model says about records: the samples that count, one by one.

The initial state of every experiment is estimated from its first samples, as `score`
does, and these samples are left out.
"""

from functools import partial

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..simulation import channels, sensitivities, simulate


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
    experiments, starts = [], []
    parts = deviations(model, u, y, experiment)
    lure, _ = model._plant()
    for u_k, y_k, x0 in parts:
        X = simulate(lure, u_k, x0)[:-1]
        with np.errstate(over="ignore", invalid="ignore"):
            y_hat = channels(lure, X, u_k)
        y_hat = np.where(np.isfinite(y_hat), y_hat, np.inf)
        start = model._window(u_k)
        u_k, y_k, y_hat = (z[start:] for z in (u_k, y_k, y_hat))
        offset = model.y_offset_
        experiments.append((u_k + model.u_offset_, y_k + offset, y_hat + offset))
        starts.append(start)
    return experiments, starts


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
    check_is_fitted(model)
    structure = model._structure
    free = model.free_entries(structure.n_params)
    u, y, parts = model._test_data(u, y, experiment)

    def one(u_s, y_s):
        start = model._window(u_s)
        x0 = model._initial_state(u_s, y_s, start) / model._x_scale
        ones = np.ones(structure.nz)
        for part, _, J in sensitivities(structure, model._theta, x0, u_s, ones):
            J = J[max(start - part.start, 0) :]
            if len(J):
                yield (
                    J[..., : structure.n_params][..., free],
                    J[..., structure.n_params :],
                )

    return [partial(one, u_s, y_s) for u_s, y_s in model._experiments(u, y, parts)]


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
    ny, nu = model.D_.shape
    inputs = getattr(model, "feature_names_in_", None)
    return (
        check_names("feature_names_in_", inputs, "u", nu),
        check_names("output_names_", model.output_names_, "y", ny),
    )


def deviations(model, u, y, experiment=None):
    """Return deviations from the operating point and initial states.

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
        Tuples (u, y, x0), in the user's units; late inputs are late.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the data do not fit the model.
    """
    check_is_fitted(model)
    u, y, parts = model._test_data(u, y, experiment)
    scaling = model._scaling
    return [
        (
            u_s[:] * scaling.u_scale,
            np.asarray(y_s[:]) * scaling.y_scale,
            model._initial_state(u_s, y_s, model._window(u_s)),
        )
        for u_s, y_s in model._experiments(u, y, parts)
    ]

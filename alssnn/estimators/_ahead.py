"""Prediction some samples ahead: what the model says with the record at hand.

An observer follows the record; from each of its estimates the model runs on alone,

    x_{k-n|k-n} -> ... -> x_{k|k-n},      y_hat_k = c(x_{k|k-n}, u_k),

where a model with innovations is its own predictor (eq. innovations), which gives
x_{k-n+1|k-n}: for all starting points at once.  One step is the error that a filter
sees, infinitely many are a simulation.
"""

from numbers import Real

import numpy as np
from sklearn.utils.validation import check_is_fitted

from ..containers import Container, index_of
from ..experiments import is_list_of_records
from ..innovations import has_innovations, predictor, with_outputs
from ..predictions import follow
from ._simulation import labeled_data, simulated, start_states

CHUNK = 8192  # starting points treated at a time, which bounds the memory for w


def predict_ahead(model, u, y, steps=1, experiment=None, *, x0="rest", observer=None):
    """Predict every output from the data up to some samples before it.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs. A list has one array per experiment.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs; nan where an output was not measured.
    steps : int or inf, default=1
        Number of samples between the last output that is used and the one that is
        predicted. With as many as an experiment has, the result is that of
        `predict`.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    x0 : {"rest", "training"} or array_like, default="rest"
        Initial states of the observer, as for `predict`.
    observer : Observer or None, default=None
        Observer of this model; None takes the predictor of ``noise="innovations"``,
        else `observer` with its defaults.

    Returns
    -------
    y_hat : ndarray of shape (N,) or (N, ny), DataFrame or Series, or list of them
        Predicted outputs, in the form of `y`: row k uses the outputs up to k - steps of
        its experiment and the inputs up to k. The first `steps` rows use no output,
        they are simulated from `x0`.

    Raises
    ------
    ValueError
        If `steps` is no positive integer, `x0` has the wrong size, or the model
        has no stable observer.

    Notes
    -----
    Costs N steps of the observer, and steps times N - steps samples of the
    model, for all starting points in one product.

    With a `hold` other than "zoh" the inputs go on between the samples as the model was
    fitted for, also behind an observer; a cubic spline sees the inputs behind k, too.
    """
    from ..feedback import Observer
    from ..feedback.recorded import along_records

    check_is_fitted(model)
    known = isinstance(steps, Real) and float(steps) >= 1
    if not (known and (steps == np.inf or steps == int(steps))):
        raise ValueError(
            f"`steps` must be a positive integer or inf, got {steps!r}. It counts "
            "samples."
        )
    as_list, given = is_list_of_records(u), y
    u, y, parts, labels = labeled_data(model, u, y, experiment)
    predicts = observer is None and has_innovations(model._structure)
    observer = Observer(model) if observer is None else observer
    observer, inputs = along_records(observer, model)
    n_more = observer.plant.nx - len(model.A_)  # late inputs, and disturbances
    y_hat = np.empty((len(u), len(model.C_)))
    for part, start in zip(parts, start_states(model, x0, labels), strict=True):
        u_i = np.asarray(u[part], dtype=float)
        y_i = np.asarray(y[part], dtype=float).reshape(len(u_i), -1)
        n = int(min(steps, len(u_i)))
        y_hat[part][:n] = simulated(model, u_i[:n], start)
        if predicts and n <= len(u_i):
            X_hat, u_i = predicted(model, u_i, y_i, start)
            plant = model.plant_.arrived()
            if plant.drift is not None:
                plant = plant.with_disturbance(plant.drift)
            y_hat[part][n - 1 :] = run_on(plant, X_hat[: len(u_i) - n + 1], u_i, n - 1)
        elif n < len(u_i):
            u_i = inputs(u_i)
            X_hat = observer.filter(u_i, y_i, np.pad(start, (0, n_more)))
            y_hat[part][n:] = run_on(observer.plant, X_hat[:-n], u_i, n)
    y_hat = y_hat[:, 0] if y.ndim == 1 else y_hat
    if as_list:
        return [_like(z, y_hat[i]) for z, i in zip(given, parts, strict=True)]
    return _like(given, y_hat)


def _like(y, y_hat):
    """Return outputs in the form of others: array, DataFrame or Series."""
    return Container.of(y).wrap(y_hat, index_of(y))


def predicted(model, u, y, x0):
    """Return the states that the predictor of a model with innovations says.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : ndarray of shape (N, nu)
        Inputs of one experiment, in the user's units.
    y : ndarray of shape (N, ny)
        Outputs; nan where not measured.
    x0 : ndarray of shape (nx,)
        Initial state.

    Returns
    -------
    X : ndarray of shape (N, nx)
        States, and what drifts behind them; row k uses inputs and outputs up to k - 1.
    u : ndarray of shape (N, nu)
        Inputs that have arrived.
    """
    structure, scaling = predictor(model._structure), model._scaling
    ((z, y),) = with_outputs(model._experiments(u, y, [slice(None)]))
    z, X = follow(structure, model._theta, x0 / model._x_scale, z, y)
    u = z[:, : len(scaling.u_scale)] * scaling.u_scale + scaling.u_offset
    X[:, : model.nx_] *= model._x_scale
    if structure.options.get("drift") is not None:
        plant = model.plant_
        X[:, model.nx_ :] *= plant.y_scale if plant.drift == "output" else plant.v_scale
    return X, u


def run_on(plant, X, u, steps):
    """Return the outputs some samples behind every state of a record.

    Parameters
    ----------
    plant : Plant
        Model.
    X : ndarray of shape (N - steps, nx)
        States at the samples 0, 1, ...
    u : ndarray of shape (N, nu)
        Inputs, in the user's units.
    steps : int
        Number of samples that the model runs alone.

    Returns
    -------
    y_hat : ndarray of shape (N - steps, ny)
        Outputs at the samples steps, steps + 1, ..., not finite where the model
        diverges.
    """
    y_hat = np.empty((len(X), len(plant.y_offset)))
    for start in range(0, len(X), CHUNK):
        stop = min(start + CHUNK, len(X))
        X_i = X[start:stop]
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(steps):
                X_i = plant.step(X_i, u[start + k : stop + k])
            y_hat[start:stop] = plant.output(X_i, u[start + steps : stop + steps])
    return y_hat

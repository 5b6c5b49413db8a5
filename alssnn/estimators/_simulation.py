"""Simulation of a fitted model: predictions, initial states, scores."""

import warnings
from numbers import Integral

import numpy as np
from sklearn.metrics import r2_score
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted

from ..checks import as_numbers
from ..containers import as_columns, index_of, part_of
from ..continuous import with_nodes
from ..experiments import (
    check_inputs,
    gap,
    is_list_of_records,
    join_records,
    split_experiments,
)
from ..initial_states import Prior, window_of
from ..initial_states import estimate_x0 as least_squares_x0
from ..innovations import has_innovations, recording
from ..records import PreparedRecord
from ..simulation import outputs
from ._data import check_outputs, check_u
from ._doubts import warn_of_time


def predict(model, u, experiment=None, x0="rest"):
    """Simulate the output, free-run.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs. A list has one array per experiment.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    x0 : {"rest", "training"} or array_like, default="rest"
        Initial states: at the operating point, x0 = 0; those of the training
        experiments, `x0_`; or given, of shape (nx,) or (n_experiments, nx), as
        `estimate_x0` returns them. None means "rest".

    Returns
    -------
    y : ndarray of shape (N,) or (N, ny), DataFrame or Series, or list of them
        Simulated outputs, with as many dimensions as the `y` of `fit`, and a
        DataFrame or Series of the same library and names if that was one, with
        the index of `u`. Not finite where the simulation diverges, with a warning.

    Raises
    ------
    ValueError
        If `u` or `x0` has the wrong size or is not finite.
    """
    return _simulation(model, u, experiment, x0)


def _simulation(model, u, experiment, x0, draw=None):
    """Return what `predict` does, with innovations that are drawn."""
    check_is_fitted(model)
    as_list = is_list_of_records(u)
    u = as_columns(u) if model.n_features_in_ == 1 else u
    u, _, experiment = join_records(u, u, experiment)
    warn_of_time(u, model.dt, experiment, fitted=True)
    index = index_of(u)
    u = check_u(model, u, reset=False)
    check_inputs(u)
    parts, labels = split_experiments(len(u), experiment)
    y = np.empty((len(u), len(model.C_)))
    for part, start in zip(parts, start_states(model, x0, labels), strict=True):
        eps = None
        if draw is not None:
            Lambda = model.noise_covariance_
            eps = draw(np.zeros(len(Lambda)), Lambda, len(u[part]))
        y[part] = simulated(model, u[part], start, eps)
    if not np.isfinite(y).all():
        bad = int(np.argmin(np.isfinite(y).all(axis=1)))
        warnings.warn(
            f"The simulation diverges before sample {bad + 1}. Keep `u` in the "
            "range of the training data or fit a more strongly penalized model.",
            RuntimeWarning,
            stacklevel=3,
        )
    y = y[:, 0] if model._y_ndim == 1 else y
    wrap = model._container.wrap
    if as_list:
        return [wrap(y[part], part_of(index, part)) for part in parts]
    return wrap(y, index)


def simulate(model, u, experiment=None, x0="rest", *, noise=False, random_state=None):
    """Simulate the output, with noise as in the training record if wanted.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs. A list has one array per experiment.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    x0 : {"rest", "training"} or array_like, default="rest"
        Initial states, as for `predict`.
    noise : bool, default=False
        Whether noise of the covariance `noise_covariance_` is drawn: innovations,
        which go through the plant, of ``noise="innovations"``; else white noise.
    random_state : int, RandomState instance or None, default=None
        Source of the noise.

    Returns
    -------
    y : ndarray of shape (N,) or (N, ny), DataFrame or Series, or list of them
        Outputs, in the form of `predict`.

    Raises
    ------
    ValueError
        If `u` or `x0` has the wrong size or is not finite.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, noise="innovations").fit(*record)
    >>> y = model.simulate(record.u, noise=True, random_state=0)
    >>> bool(y.std() > model.predict(record.u).std())
    True
    """
    draw = check_random_state(random_state).multivariate_normal if noise else None
    return _simulation(model, u, experiment, x0, draw)


def simulated(model, u, x0, eps=None):
    """Return the outputs of one experiment, all in the user's units.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : ndarray of shape (N, nu)
        Inputs.
    x0 : ndarray of shape (nx,)
        Initial state.
    eps : ndarray of shape (N, ny) or None, default=None
        Noise; None means none.

    Returns
    -------
    y : ndarray of shape (N, ny)
        Outputs; not finite where the simulation diverges.
    """
    scaling, structure = model._scaling, model._structure
    ((z, _),) = with_nodes(structure, [(scaling.scale_u(u, model.input_delay_), None)])
    if eps is not None and has_innovations(structure):
        structure, z = recording(structure), np.hstack([z, eps / scaling.y_scale])
    plain = structure.observe(structure.measured)
    x0, lure = plain.initial_state(x0 / model._x_scale), plain.lure(model._theta)
    y = outputs(lure, z, x0) * scaling.y_scale + scaling.y_offset
    return y if eps is None else y + eps


def start_states(model, x0, labels):
    """Return one initial state per experiment, in the user's units.

    Parameters
    ----------
    model : estimator
        Fitted model.
    x0 : {"rest", "training"} or array_like
        What a user gave.
    labels : list
        Labels of the experiments.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    """
    if x0 is None or (isinstance(x0, str) and x0 == "rest"):
        return np.zeros((len(labels), model.nx_))
    if isinstance(x0, str):
        if x0 != "training":
            raise ValueError(
                f"`x0` must be 'rest', 'training' or an array, got {x0!r}."
            )
        if labels != model.experiments_:
            raise ValueError(
                "`experiment` must have the labels of the training for "
                f"x0='training', {model.experiments_}, got {labels}. Use "
                "`estimate_x0`."
            )
        return model.x0_
    x0 = as_numbers("x0", x0)
    if x0.shape not in [(model.nx_,), (len(labels), model.nx_)]:
        raise ValueError(
            f"`x0` must have shape ({model.nx_},) or ({len(labels)}, {model.nx_})"
            f", got {x0.shape}. Use `estimate_x0`."
        )
    if not np.isfinite(x0).all():
        raise ValueError("`x0` must be finite, got nan or infinity. Use `estimate_x0`.")
    return np.broadcast_to(x0, (len(labels), model.nx_))


def estimate_x0(model, u, y, experiment=None, n_samples=None):
    """Estimate the initial state of every experiment from its first samples.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    n_samples : int or None, default=None
        Number of samples to use, from the first measured one on; None means the
        parameter `n_init_samples`.

    Returns
    -------
    x0 : ndarray of shape (n_experiments, nx)
        States at the first sample of every experiment: least squares, with
        mean and covariance of the states of the training as prior (eq. start).

    Raises
    ------
    ValueError
        If `u` or `y` has the wrong size, or `n_samples` is no positive integer.
    """
    check_is_fitted(model)
    window = model.n_init_samples if n_samples is None else n_samples
    if not isinstance(window, Integral) or window < 1:
        raise ValueError(
            f"`n_samples` must be a positive integer or None, got {n_samples!r}. "
            "None takes `n_init_samples`."
        )
    u, y, parts = labeled_data(model, u, y, experiment)[:3]
    return np.vstack(
        [
            initial_state(model, u_s, y_s, gap(u_s, y_s) + window)
            for u_s, y_s in simulated_experiments(model, u, y, parts)
        ]
    )


def labeled_data(model, u, y, experiment):
    """Return checked data, the samples of every experiment, and their labels.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None
        Label of the experiment of every sample.

    Returns
    -------
    data : tuple
        Inputs, outputs, one slice per experiment, and its label.
    """
    u = as_columns(u) if model.n_features_in_ == 1 else u
    u, y, experiment = join_records(u, y, experiment)
    warn_of_time(u, model.dt, experiment, fitted=True)
    check_outputs(model, y)
    u, y = model._validate(u, y, reset=False)
    ny, found = len(model._scaling.y_offset), 1 if y.ndim == 1 else y.shape[1]
    if found != ny:  # one column would be broadcast
        raise ValueError(
            f"`y` must have the outputs of the training, {ny}, got {found}. Leave "
            "what was not measured as columns of nan."
        )
    return u, y, *split_experiments(len(u), experiment)


def simulated_experiments(model, u, y, parts):
    """Return scaled experiments as the structure of a model takes them.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N,) or (N, ny)
        Outputs.
    parts : list of slice
        Samples of every experiment.

    Returns
    -------
    experiments : list of tuple of array
        Pairs (u, y) of scaled deviations, with what u does between samples.
    """
    return with_nodes(model._structure, model._experiments(u, y, parts))


def initial_state(model, u_s, y_s, window):
    """Return the state at the first sample of one scaled experiment.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u_s : array of shape (N, nu)
        Scaled inputs.
    y_s : array of shape (N, ny)
        Scaled outputs.
    window : int
        Samples to estimate it from.

    Returns
    -------
    x0 : ndarray of shape (nx,)
        The state, in the user's units.
    """
    noise = model.cost_  # outputs are scaled to unit variance, as states are
    x0 = least_squares_x0(
        model._structure,
        model._theta,
        [(u_s, y_s)],
        window=window,
        noise=noise,
        prior=expected_states(model),
    )[0]
    return x0 * model._x_scale


def expected_states(model):
    """Return where the initial states of records of a model are expected.

    Parameters
    ----------
    model : estimator
        Fitted model, whose region of the training data is known.

    Returns
    -------
    prior : Prior or None
        Mean and covariance of the states of the training, scaled; None if unknown.
    """
    region, n = getattr(model, "_region", None), model._structure.n_x0
    if region is None or n != model._structure.sizes["x"]:
        return None
    return Prior.of_region(region, np.broadcast_to(model._x_scale, n))


def prepare_records(model, u, y, experiment=None):
    """Return records as all that judges a model takes them.

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
    records : list of PreparedRecord
        One per experiment: signals in all units, and the initial state that its
        first `n_init_samples` samples, at most a quarter of it, tell.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the data do not fit the model.
    """
    check_is_fitted(model)
    u, y, parts = labeled_data(model, u, y, experiment)[:3]
    y, records = np.asarray(y.reshape(len(y), -1), dtype=float), []
    pairs = simulated_experiments(model, u, y, parts)
    for part, (u_s, y_s) in zip(parts, pairs, strict=True):
        start = window_of(u_s, y_s, model.n_init_samples)
        x0 = initial_state(model, u_s, y_s, start)
        raw = part, u[part], y[part]
        records.append(PreparedRecord(*raw, u_s, y_s, x0, start, model._scaling))
    return records


def score(model, u, y, experiment=None):
    """Return R2 of the free-run simulation.

    The initial state of every experiment is estimated from its first
    `n_init_samples` samples (at most a quarter of it), which are not scored.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    score : float
        Coefficient of determination, averaged over the outputs; -inf if the
        simulation diverges.
    """
    pair = model.simulate_test(u, y, experiment)
    y_true, y_pred = (z.reshape(len(z), -1) for z in pair)
    if not np.isfinite(y_pred).all():
        return -np.inf
    measured = ~np.isnan(y_true)
    if not (measured.sum(axis=0) >= 2).all():
        columns = ", ".join(map(str, np.flatnonzero(measured.sum(axis=0) < 2)))
        raise ValueError(
            "`y` must have at least two measured samples in every column behind "
            f"those that estimate the initial states, got fewer in column "
            f"{columns}. Score a longer record."
        )
    return float(
        np.mean(
            [
                r2_score(t[m], p[m])
                for t, p, m in zip(y_true.T, y_pred.T, measured.T, strict=True)
            ]
        )
    )


def simulate_test(model, u, y, experiment=None):
    """Return measured and simulated outputs under the scoring policy.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    y_true : ndarray of shape (n_scored,) or (n_scored, ny)
        Measured outputs without the samples that estimate the initial states, with as
        many dimensions as `y`.
    y_pred : ndarray of the same shape
        Simulated outputs at the same samples.
    """
    records = model.prepare_records(u, y, experiment)
    lure = model._structure.lure(model._theta)
    y_true, y_pred = [], []
    for record in records:
        y_hat = outputs(lure, record.u_s, record.x0 / model._x_scale)
        y_true.append(record.y[record.scored])
        y_pred.append(y_hat[record.scored])
    scaling = model._scaling
    y_pred = np.vstack(y_pred) * scaling.y_scale + scaling.y_offset
    pair = np.vstack(y_true), y_pred
    return tuple(z[:, 0] for z in pair) if is_flat(u, y) else pair


def is_flat(u, y):
    """Tell whether one output came as a plain sequence.

    Parameters
    ----------
    u : array_like of shape (N, nu), or list of them
        Inputs.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs.

    Returns
    -------
    is_flat : bool
        Whether y has no columns, so that what is returned should have none.
    """
    return len(np.shape(y[0] if is_list_of_records(u) else y)) == 1

"""Which experiment comes next: the one that tells most about the law of a model."""

import numpy as np

from ..checks import is_count
from ..excitation import Excitation, menu
from ..informative import (
    LAW,
    OUTPUT,
    NextInput,
    error,
    information,
    law_weight,
    simulated,
    spread,
    told,
)
from ..initial_states import estimate_x0
from ..innovations import has_innovations
from ..optimizers import single_threaded
from ._first_states import from_free
from ._fitted import as_fitted
from ._simulation import labeled_data


def next_input(
    model,
    u,
    y,
    experiment=None,
    *,
    candidates=24,
    n_samples=None,
    low=None,
    high=None,
    rate=None,
    operating_point=None,
    y_low=None,
    y_high=None,
    random_state=None,
):
    """Choose the experiment that tells most about the law of a model.

    Parameters
    ----------
    model : estimator
        Fitted model, with ``noise="output"`` and in discrete time.
    u : array_like of shape (N, nu), or list of them
        Inputs of the training.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs of the training.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    candidates : int or list of Excitation or array_like, default=24
        Inputs that may be sent next, each of one experiment, or how many of them
        `excitation.menu` makes. They have the columns of the inputs that are moved;
        measured disturbances are those of the record, or come as further columns.
    n_samples : int or None, default=None
        Samples of an experiment: what is longer counts with its first ones. None
        means those of the record if candidates are made, else all of a candidate.
    low, high : float or array_like of shape (nv,) or None, default=None
        Limits of the inputs that are made; None means those of the record.
    rate : float, array_like of shape (nv,) or None, default=None
        Largest change per second of the inputs that are made.
    operating_point : float, array_like of shape (nv,) or None, default=None
        Value around which they move; None means the middle of the limits.
    y_low, y_high : float, array_like of shape (ny,) or None, default=None
        Limits of the outputs: a candidate that the model leads beyond does not count.
    random_state : int, RandomState instance or None, default=None
        Seed of the inputs that are made.

    Returns
    -------
    next_input : NextInput
        The candidates, what to expect of each, and the best one.

    Raises
    ------
    ValueError
        If the model or an argument is not one of these, or no candidate is left.

    Notes
    -----
    By the information of the record and of a candidate together (eq. next), with the
    decay of the training as what is known before. The law is looked at where the
    record and all candidates lead the model to; a model without h is judged by its
    output. It believes the model: where the record tells nothing, neither does the
    model. To first order, and for noise of the sensors.

    Costs one pass of the sensitivities over the record and every candidate.
    """
    model = as_fitted(model)
    _check(model)
    u, y, parts, _ = labeled_data(model, u, y, experiment)
    structure, theta = model._structure, model._theta
    limits = {
        "low": low,
        "high": high,
        "rate": rate,
        "operating_point": operating_point,
        "random_state": random_state,
    }
    inputs = _inputs(model, u, candidates, n_samples, limits)
    record = from_free(model, model._experiments(u, y, parts))
    sent = [model._scaling.scale_u(one, model.input_delay_)[:] for _, one in inputs]
    ny = structure.sizes["y"]
    weight = model._output_weight(ny)
    with single_threaded():
        runs = simulated(structure, theta, sent)
        allowed = [_keeps(model, run, y_low, y_high) for run in runs]
        if not any(allowed):
            raise ValueError(
                "`candidates` must keep the outputs within `y_low` and `y_high`, none "
                f"of {len(sent)} does by the model. Lower the amplitudes."
            )
        H = _known(model, record, weight)
        targets = [(one, np.zeros((len(one), ny))) for one in sent]
        gains = [
            gain if ok else None
            for gain, ok in zip(
                information(structure, theta, targets, weight), allowed, strict=True
            )
        ]
        M = everything = H + sum(gain for gain in gains if gain is not None)
        basis, prior = told(everything)
        prior = prior + _decay(model, len(y))
        target = LAW if structure.law().parameters else OUTPUT
        if target == LAW:
            visited = [
                (*run, one)
                for run, one, gain in zip(runs, sent, gains, strict=True)
                if gain is not None
            ]
            M = law_weight(structure, theta, *_places(model, record, visited))
        now = error(M, H, basis, prior)
        expected = [
            np.nan if gain is None else np.sqrt(error(M, H + gain, basis, prior) / now)
            for gain in gains
        ]
    return NextInput([one for one, _ in inputs], np.array(expected), target)


def _known(model, record, weight):
    """Return the information of the record."""
    structure, theta, longest = model._structure, model._theta, max(record.lengths)
    x0 = estimate_x0(structure, theta, record, window=longest, noise=model.cost_)
    found = information(structure, theta, record, weight, x0)
    known = [H for H in found if H is not None]
    if not known:
        raise ValueError(
            "`u` and `y` must be data that the model can simulate, got a "
            "simulation that diverges. Pass the training data."
        )
    return sum(known)


def _places(model, record, visited):
    """Return the states, inputs and outputs of the record and of other runs."""
    inputs = [u[:] for u, _ in record]
    runs = simulated(model._structure, model._theta, inputs)
    seen = [(*run, u) for run, u in zip(runs, inputs, strict=True) if run is not None]
    X, Y, U = (np.vstack(z) for z in zip(*seen, *visited, strict=True))
    return spread(X, U, Y)


def _check(model):
    """Refuse models whose information this is not."""
    if has_innovations(model._structure):
        raise ValueError(
            f"`noise` must be 'output' for the next input, got {model.noise!r}: what "
            "an experiment tells depends on its disturbances there."
        )
    if model._structure.sampling is not None:
        raise ValueError(
            "`time` must be 'discrete' for the next input, got 'continuous'. Fit a "
            "discrete model of the same record, and send what it asks for."
        )


def _inputs(model, u, candidates, n_samples, limits):
    """Return pairs of every candidate and its inputs, disturbances included."""
    moved = np.setdiff1d(np.arange(u.shape[1]), model.disturbances_)
    counts = is_count(candidates, -np.inf)  # `menu` says which are too small
    if not counts and (not isinstance(candidates, list | tuple) or not candidates):
        raise ValueError(
            "`candidates` must be a positive integer or a list of signals, got "
            f"{candidates!r}."
        )
    if n_samples is not None and not is_count(n_samples):
        raise ValueError(
            f"`n_samples` must be an integer of at least 1 or None, got {n_samples!r}."
        )
    if counts:
        for name, end in (("low", np.min), ("high", np.max)):
            if limits[name] is None:
                limits[name] = end(u[:, moved], axis=0)
        names = list(getattr(model, "feature_names_in_", [])) or None
        names = names and [str(names[i]) for i in moved]
        n = len(u) if n_samples is None else n_samples
        options = {"dt": model.dt, "n_candidates": int(candidates), "names": names}
        candidates = menu(n, len(moved), **options, **limits)
    elif any(limit is not None for limit in limits.values()):
        raise ValueError(
            "`candidates` must be a number if `low`, `high`, `rate`, `operating_point` "
            "or `random_state` is given: signals have limits of their own."
        )
    found = []
    for one in candidates:
        sent = np.asarray(one.u if isinstance(one, Excitation) else one, dtype=float)
        if sent.ndim not in (1, 2) or not sent.size:
            raise ValueError(
                "`candidates` must be signals with samples, got one of shape "
                f"{sent.shape}."
            )
        sent = sent.reshape(len(sent), -1)[:n_samples]
        if sent.shape[1] not in (u.shape[1], len(moved)) or not np.isfinite(sent).all():
            raise ValueError(
                f"`candidates` must be finite, with {len(moved)} columns of the inputs "
                f"that are moved or all {u.shape[1]}, got shape {sent.shape}."
            )
        if sent.shape[1] < u.shape[1]:
            whole = np.resize(u, (len(sent), u.shape[1])).astype(float)
            whole[:, moved] = sent
            sent = whole
        found.append((one, sent))
    return found


def _keeps(model, run, y_low, y_high):
    """Tell whether a simulation is finite and within limits of the outputs."""
    if run is None:
        return False
    y = run[1] * model._scaling.y_scale + model._scaling.y_offset
    low = -np.inf if y_low is None else np.asarray(y_low, dtype=float)
    high = np.inf if y_high is None else np.asarray(y_high, dtype=float)
    return bool(np.all((low <= y) & (y <= high)))


def _decay(model, n_samples):
    """Return the information that the decay of the training stands for."""
    structure = model._structure
    decay = np.zeros(structure.n_params)
    alpha = getattr(model, "alpha_", 0.0)
    for name in structure.network_parameters:
        decay[structure.slices[name]] = alpha if np.isfinite(alpha) else 0.0
    return n_samples * decay

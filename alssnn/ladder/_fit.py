"""Fit the models of a ladder to the same data."""

import time
import warnings
from collections.abc import Mapping

import numpy as np
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import _safe_indexing

from ..estimators import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from ..experiments import split_experiments
from ..metrics import fit_percent, rmse
from ._records import Ladder, Rung

# What the last model of AL-SSNN changes: the most linear loop that we know to train.
# Without gamma_h it hides a large linear part in h, which A takes back: a step of two
# tanks drives v to 34 V where no u above 9.3 V was seen, and with recorded u as v the
# loops of pendulum and Wiener-Hammerstein circuit leave their data (65 % and 100 % of
# the samples). 1e-6, the smallest weight tried, ends that; 1e-4 doubles what is left of
# the nonlinearity on tanks, Duffing oscillator and circuit (`benchmarks.law_size`).
STATE_FEEDBACK = {
    "feedback": "state",
    "penalty": "output",
    "stability": "contractive",
    "gamma": 0.01,
    "gamma_h": 1e-6,
    "continuation": 4,
}
PRESETS: dict[str, tuple[str, type, dict]] = {
    "lti": ("LTI", LinearStateSpace, {}),
    "fl": ("FL-SSNN", FlSsnn, {}),
    "al": ("AL-SSNN", AlSsnn, {}),
    "al-state": ("AL-SSNN/x", AlSsnn, STATE_FEEDBACK),
    "gr": ("GR-SSNN", GrSsnn, {}),
}
N_INIT_SAMPLES = 50  # samples for the initial state, as the benchmarks allow


def model_ladder(
    u,
    y,
    *,
    experiment=None,
    test=None,
    test_size=0.5,
    nx="auto",
    n_h=10,
    n_g=10,
    n_f=15,
    gamma=1.0,
    gamma_h=None,
    dt=1.0,
    random_state=0,
    max_iter=300,
    n_init=1,
    models=None,
    verbose=0,
    callback=None,
):
    """Fit several models to the same data and compare them.

    Parameters
    ----------
    u : array_like of shape (N, nu)
        Inputs; time runs down the rows.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    test : Record or tuple or None, default=None
        Test data: a `Record`, (u, y), or (u, y, experiment). All of `u` and `y` then
        serve for training. None splits them by time.
    test_size : float, default=0.5
        Share of every experiment, its last part, that is kept for testing; not used
        when `test` is given.
    nx : int or "auto", default="auto"
        Number of states; "auto" decides by the singular values.
    n_h, n_g : int, default=10
        Hidden neurons of h and g.
    n_f : int, default=15
        Hidden neurons of f in GR-SSNN.
    gamma : float, default=1.0
        Weight of ``|g|^2`` in AL-SSNN, outputs scaled to unit variance.
    gamma_h : float or None, default=None
        Weight of ``|h|^2`` in all models with h; None means 1e-6 for "al-state", 0 for
        the others.
    dt : float, default=1.0
        Sampling time, in seconds.
    random_state : int or None, default=0
        Seed of the initial inner weights.
    max_iter : int, default=300
        Largest number of trial steps of every model; twice as many for "al-state".
    n_init : int, default=1
        Number of random starts of every model with networks.
    models : sequence of str or dict or None, default=None
        Models to compare, of "lti", "fl", "al", "al-state" and "gr"; None means all.
        "al-state" feeds back the state, penalizes e with a weight of 0.01 reached by
        continuation, and keeps A a contraction. A dict of names and estimators
        compares these instead; orders, weights and seeds are then their own.
    verbose : int, default=0
        1 prints a line per stage of the training, 2 every step; not for a dict.
    callback : callable or None, default=None
        Called as ``callback(row)`` with every finished `Rung`.

    Returns
    -------
    ladder : Ladder
        The rows, in the order of `models`.

    Raises
    ------
    ValueError
        If `models` is empty or unknown, `test` or `test_size` does not give test data,
        or the data or parameters are refused by the estimators.

    See Also
    --------
    alssnn.AlSsnn : The model in the middle of the ladder.

    Notes
    -----
    A fit that stops at `max_iter` gives no warning here but a star in the table. The
    initial state of every test experiment is estimated from its first 50 samples (at
    most a quarter of it), which are not scored.

    Examples
    --------
    >>> from alssnn.ladder import model_ladder
    >>> from alssnn.datasets import make_wiener_hammerstein
    >>> record = make_wiener_hammerstein(1500, random_state=0)
    >>> ladder = model_ladder(*record, nx=6, dt=record.dt, models=["lti", "fl"])
    >>> [row.name for row in ladder]
    ['LTI', 'FL-SSNN']
    """
    options = {
        "nx": nx,
        "n_h": n_h,
        "n_g": n_g,
        "n_f": n_f,
        "gamma": gamma,
        "dt": dt,
        "random_state": random_state,
        "max_iter": max_iter,
        "n_init": n_init,
        "verbose": verbose,
    }
    if gamma_h is not None:
        options["gamma_h"] = gamma_h
    estimators = _estimators(models, options)
    train, test = _train_and_test(u, y, experiment, test, test_size)
    rows = []
    for name, model in estimators.items():
        y_test, row = _climb(name, model, train, test)
        rows.append(row)
        if callback is not None:
            callback(row)
    return Ladder(
        rows=tuple(rows),
        y_test=y_test,
        parts=_scored_parts(test),
        dt=float(dt),
        output_names=rows[0].model.output_names_,
    )


def _estimators(models, options):
    """Return unfitted models by name."""
    if isinstance(models, Mapping):
        estimators = {str(name): clone(model) for name, model in models.items()}
    else:
        keys = list(PRESETS) if models is None else models
        keys = [keys] if isinstance(keys, str) else list(keys)
        for key in keys:
            if key not in list(PRESETS):  # `key` may be unhashable
                raise ValueError(
                    f"`models` must name {', '.join(PRESETS)}, got {key!r}. "
                    "Give a dict of names and estimators for other models."
                )
        estimators = {}
        for name, cls, changes in (PRESETS[key] for key in keys):
            known = cls().get_params()
            model = cls(**{k: v for k, v in options.items() if k in known})
            if "gamma_h" in options:  # the caller's, not the preset's
                changes = {k: v for k, v in changes.items() if k != "gamma_h"}
            stages = 1 + changes.get("continuation", 0)
            if stages > 1:  # twice the trial steps of the others, shared by the stages
                changes = {**changes, "max_iter": max(1, 2 * model.max_iter // stages)}
            estimators[name] = model.set_params(**changes)
    if not estimators:
        raise ValueError(
            "`models` must name at least one model, got none. Use None for all of them."
        )
    for model in estimators.values():
        model.set_params(n_init_samples=N_INIT_SAMPLES)  # one policy for all
    return estimators


# -- data ------------------------------------------------------------------------------


def _train_and_test(u, y, experiment, test, test_size):
    """Return training and test data as tuples (u, y, experiment)."""
    if test is not None:
        return (u, y, experiment), _test_data(test)
    return hold_out_last(u, y, experiment, test_size)


def hold_out_last(u, y, experiment, test_size, *, name="test_size"):
    """Split every experiment by time.

    Parameters
    ----------
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None
        Label of the experiment of every sample.
    test_size : float
        Share of every experiment, its last part, that is held out.
    name : str, default="test_size"
        Name of the share in messages.

    Returns
    -------
    first, last : tuple of (u, y, experiment)
        Both parts of the record.

    Raises
    ------
    ValueError
        If u and y differ in length, or a part would be empty.
    """
    if np.shape(u)[:1] != np.shape(y)[:1] or np.ndim(u) == 0:
        sizes = [np.shape(z)[0] if np.ndim(z) else 0 for z in (u, y)]
        raise ValueError(
            "`u` and `y` must have the same number of samples, got "
            f"{sizes[0]} and {sizes[1]}. Let time run down the rows of both."
        )
    if not 0 < test_size < 1:
        raise ValueError(
            f"`{name}` must lie strictly between 0 and 1, got {test_size}. "
            "Give the share of the samples that is kept for testing."
        )
    parts, _ = split_experiments(np.shape(u)[0], experiment)
    first, last = [], []
    for part in parts:
        length = part.stop - part.start
        n_test = round(test_size * length)
        if not 0 < n_test < length:
            raise ValueError(
                f"`{name}` must leave samples of every experiment to both parts, "
                f"got {test_size} for an experiment of {length} samples. Take another "
                "share or longer experiments."
            )
        first.append(np.arange(part.start, part.stop - n_test))
        last.append(np.arange(part.stop - n_test, part.stop))
    return tuple(
        tuple(_take(z, np.concatenate(rows)) for z in (u, y, experiment))
        for rows in (first, last)
    )


def _take(data, rows):
    """Return rows of data, with the names of its columns if it has any."""
    if data is None:
        return None
    return _safe_indexing(data if hasattr(data, "shape") else np.asarray(data), rows)


def _test_data(test):
    test = tuple(test)
    if len(test) not in (2, 3):
        raise ValueError(
            "`test` must be a Record, (u, y) or (u, y, experiment), got "
            f"{len(test)} items. Use None to split `u` and `y` by time."
        )
    u, y, experiment = (*test, None)[:3]
    return u, y, experiment


def _windows(test):
    """Return every test experiment and the first samples of it that set its state."""
    u, _, experiment = test
    parts, _ = split_experiments(np.shape(u)[0], experiment)
    return [(p, min(N_INIT_SAMPLES, (p.stop - p.start) // 4)) for p in parts]


def _scored_parts(test):
    """Return the rows of every experiment among the scored samples."""
    lengths = [part.stop - part.start - window for part, window in _windows(test)]
    stops = np.cumsum(lengths).tolist()
    return tuple(slice(b - n, b) for b, n in zip(stops, lengths, strict=True))


# -- one model -------------------------------------------------------------------------


def _climb(name, model, train, test):
    """Return the scored test output and the row of one model."""
    start = time.perf_counter()
    with warnings.catch_warnings():
        # the table marks the row instead
        warnings.simplefilter("ignore", ConvergenceWarning)
        model.fit(*train)
    seconds = time.perf_counter() - start
    rmse_train, _ = _errors(*model.simulate_test(*train))
    y_test, y_hat = model.simulate_test(*test)
    rmse_test, fit = _errors(y_test, y_hat)
    record = model.linearizability(*test)
    scored = [record.e[part.start + n : part.stop] for part, n in _windows(test)]
    return y_test, Rung(
        name=name,
        model=model,
        n_params=_count_parameters(model),
        rmse_train=rmse_train,
        rmse_test=rmse_test,
        fit_percent=fit,
        linearization_error=record.linearization_error,
        spectral_radius=record.spectral_radius,
        seconds=seconds,
        y_hat=y_hat,
        e=np.vstack(scored),
    )


def _errors(y_true, y_pred):
    """Return RMSE and fit per output, infinite for a diverged simulation."""
    if not np.isfinite(y_pred).all():
        ny = y_true.shape[1]
        return np.full(ny, np.inf), np.full(ny, -np.inf)
    return (
        rmse(y_true, y_pred, multioutput="raw_values"),
        fit_percent(y_true, y_pred, multioutput="raw_values"),
    )


def _count_parameters(model):
    """Return the number of trained parameters: those that nothing holds."""
    return int(model._free_entries(model._structure.n_params).sum())

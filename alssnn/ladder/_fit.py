"""Fit the models of a ladder to the same data."""

import copy
import time
import warnings
from collections.abc import Mapping

import numpy as np
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

from ..checks import FINISHED, noise_levels
from ..estimators import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from ..experiments import join_records, split_experiments
from ..metrics import free_run_errors
from ._records import Ladder, Rung

# The models that one names, and what they change of the defaults of their estimators.
PRESETS: dict[str, tuple[str, type, dict]] = {
    "lti": ("LTI", LinearStateSpace, {}),
    "fl": ("FL-SSNN", FlSsnn, {}),
    "al": ("AL-SSNN", AlSsnn, {}),
    "al-paper": (
        "AL-SSNN/y",
        AlSsnn,
        {
            "feedback": "output",
            "penalty": "state",
            "gamma": 1.0,
            "linear_part": "trained",
            "stability": None,
        },
    ),
    "gr": ("GR-SSNN", GrSsnn, {}),
}
LADDER = ("lti", "fl", "al", "gr")  # those compared unless told otherwise
N_INIT_SAMPLES = 50  # samples for the initial state, as the benchmarks allow


def model_ladder(
    u,
    y,
    *,
    experiment=None,
    test=None,
    test_size=0.5,
    gamma=None,
    gamma_h=None,
    stability="auto",
    feedback=None,
    dt=1.0,
    random_state=0,
    max_iter=None,
    n_init=None,
    models=None,
    noise_floor=None,
    verbose=0,
    callback=None,
    **more,
):
    """Fit several models to the same data and compare them.

    Parameters
    ----------
    u : array_like of shape (N, nu), or list of them
        Inputs; time runs down the rows. A list has one array per experiment.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample; None for lists.
    test : Record, list of Record, tuple or None, default=None
        Test data: a `Record` or a list of them, (u, y), or (u, y, experiment). All of
        `u` and `y` then serve for training. None splits them by time.
    test_size : float, default=0.5
        Share of every experiment, its last part, that is kept for testing; not used
        when `test` is given.
    gamma : float or None, default=None
        Weight of the residual in AL-SSNN, outputs scaled to unit variance; None means
        0.01, and 1 for "al-paper".
    gamma_h : float or None, default=None
        Weight of ``|h|^2`` in all models with h; None means 0.
    stability : {"auto", "contractive"} or None, default="auto"
        Whether A is a contraction, in all models with networks; "auto" leaves it to the
        models: all are trained as contractions but "al-paper".
    feedback : {"output", "state"} or None, default=None
        What h sees in all models with h; None leaves it to the models: the state, and
        the output in "al-paper".
    dt : float, default=1.0
        Sampling time, in seconds.
    random_state : int or None, default=0
        Seed of the initial inner weights.
    max_iter : int or None, default=None
        Largest number of trial steps of every model; None means 300, and 100 for "lti".
    n_init : int or None, default=None
        Number of random starts of every model with networks; None means 3.
    models : sequence of str or dict or None, default=None
        Models to compare: "lti", "fl", "al" and "gr" are the estimators with their
        defaults, and None means these four. "al-paper" is AL-SSNN in the form of the
        paper: h sees the output, gamma weighs ``|g|^2``, and A is free. A dict of names
        and estimators compares these instead; all options are then their own.
    noise_floor : float, array_like of shape (ny,), or object or None, default=None
        Errors that no model goes below, in the units of the outputs; what `look` or
        `nonparametric.best_linear_approximation` return of a periodic record. The
        table then has test errors over it; trainings with ``noise="output"`` end at
        it, but those of a dict; and the ladder ends with a model whose test error is
        within 10 % of it in every output.
    verbose : int or "bar", default=0
        1 prints a line per stage of the training, 2 every step; not for a dict.
    callback : callable or None, default=None
        Called as ``callback(row)`` with every finished `Rung`.
    **more : dict
        Options of `AlSsnn`, and `n_f` of `GrSsnn`, for all models that have them; not
        for a dict. Those that are left out have their defaults: the order `nx`; the
        neurons `n_h`, `n_g` and `n_f`; `alpha`, `input_map` and `input_delay`;
        `disturbances`, `noise`, `drift` and `horizon`; `time`, `hold` and `substeps`;
        `max_time` and all others.

    Returns
    -------
    ladder : Ladder
        The rows, in the order of `models`; `not_fitted` names those that a ladder at
        the noise floor has left out.

    Raises
    ------
    KeyboardInterrupt
        If the user interrupts. The row of the model under way, with the best
        parameters so far, goes to `callback` before.
    TypeError
        If no estimator has an option of that name.
    ValueError
        If `models` is empty or unknown, `test` or `test_size` does not give test data,
        or the data or parameters are refused by the estimators.

    See Also
    --------
    alssnn.AlSsnn : The model in the middle of the ladder.

    Notes
    -----
    A fit that stops at `max_iter` gives no warning here but a star in the table, and a
    fit whose networks do not beat the linear model on hidden samples an equals sign.
    The initial state of every test experiment is estimated from its first 50 samples
    (at most a quarter of it), which are not scored.

    Examples
    --------
    >>> from alssnn.ladder import model_ladder
    >>> from alssnn.datasets import make_wiener_hammerstein
    >>> record = make_wiener_hammerstein(1500, random_state=0)
    >>> ladder = model_ladder(*record, nx=6, dt=record.dt, models=["lti"])
    >>> [row.name for row in ladder]
    ['LTI']
    """
    options = {"dt": dt, "random_state": random_state, "verbose": verbose}
    choices = {
        "gamma": gamma,
        "gamma_h": gamma_h,
        "feedback": feedback,
        "max_iter": max_iter,
        "n_init": n_init,
    }
    options |= {name: value for name, value in choices.items() if value is not None}
    if stability != "auto":
        options["stability"] = stability
    foreign = set(more).difference(
        *(cls().get_params() for _, cls, _ in PRESETS.values())
    )
    if foreign:
        raise TypeError(
            f"`model_ladder` must be given options of estimators, got "
            f"{', '.join(sorted(foreign))}. Look at the options of `AlSsnn`."
        )
    options |= more
    u, y, experiment = join_records(u, y, experiment)
    floor = noise_levels(noise_floor, 1 if np.ndim(y) < 2 else np.shape(y)[1])
    if floor is not None and more.get("noise", "output") == "output":
        options["noise_floor"] = floor
    estimators = _estimators(models, options)
    if test is None:
        train, test = hold_out_last(u, y, experiment, test_size)
    else:
        train, test = (u, y, experiment), _test_data(test)
    rows = []
    for name, model in estimators.items():
        seconds, interrupt = _fit(model, train)
        row, records = _judge(name, model, train, test, seconds)
        rows.append(row)
        if callback is not None:
            callback(row)
        if interrupt is not None:
            raise interrupt
        if floor is not None and np.all(row.rmse_test <= FINISHED * floor):
            break
    return _ladder(rows, records, dt, floor, tuple(estimators)[len(rows) :])


def judge_models(models, u, y, experiment=None):
    """Compare fitted models on one record.

    Parameters
    ----------
    models : dict of str to estimator
        Fitted models by name, all of the same outputs and sampling time.
    u : array_like of shape (N, nu), or dict of str to array_like
        Inputs, of all models or by their names; time runs down the rows.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    ladder : Ladder
        One row per model; errors of the training and durations are nan.

    Raises
    ------
    ValueError
        If there is no model, or their sampling times or outputs differ.

    Examples
    --------
    >>> from alssnn.ladder import judge_models
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> models = {
    ...     f"nx={nx}": alssnn.LinearStateSpace(nx=nx, dt=record.dt).fit(*record)
    ...     for nx in (2, 6)
    ... }
    >>> small, large = judge_models(models, *record)
    >>> bool(large.rmse_test < small.rmse_test)
    True
    """
    for name, values in (
        ("sampling time", {float(model.dt) for model in models.values()}),
        ("number of outputs", {len(model.C_) for model in models.values()}),
    ):
        if len(values) != 1:
            found = ", ".join(f"{value:g}" for value in sorted(values)) or "no model"
            raise ValueError(
                f"`models` must have one {name}, got {found}. Compare models of the "
                "same plant and rate."
            )
    rows = []
    for name, model in models.items():
        model = copy.deepcopy(model).set_params(n_init_samples=N_INIT_SAMPLES)
        test = (u[name] if isinstance(u, Mapping) else u, y, experiment)
        row, records = _judge(name, model, None, test, np.nan)
        rows.append(row)
    return _ladder(rows, records, model.dt)


def _ladder(rows, records, dt, noise_floor=None, not_fitted=()):
    """Return rows with the test data of the last one."""
    scored = [record.y[record.scored] for record in records]
    stops = np.cumsum([0, *map(len, scored)]).tolist()
    return Ladder(
        rows=tuple(rows),
        y_test=np.vstack(scored),
        parts=tuple(map(slice, stops[:-1], stops[1:])),
        dt=float(dt),
        output_names=rows[0].model.output_names_,
        noise_floor=noise_floor,
        not_fitted=not_fitted,
    )


def _estimators(models, options):
    """Return unfitted models by name."""
    if isinstance(models, Mapping):
        estimators = {str(name): clone(model) for name, model in models.items()}
    else:
        keys = LADDER if models is None else models
        keys = list(keys) if isinstance(keys, list | tuple) else [keys]
        for key in keys:
            if key not in list(PRESETS):  # `key` may be unhashable
                raise ValueError(
                    f"`models` must name {', '.join(PRESETS)}, got {key!r}. "
                    "Give a dict of names and estimators for other models."
                )
        estimators = {}
        for name, cls, changes in (PRESETS[key] for key in keys):
            known = cls().get_params()
            chosen = {**changes, **options}  # the caller's before the preset's
            estimators[name] = cls(**{k: v for k, v in chosen.items() if k in known})
    if not estimators:
        raise ValueError(
            "`models` must name at least one model, got none. Use None for four."
        )
    for model in estimators.values():
        model.set_params(n_init_samples=N_INIT_SAMPLES)  # one policy for all
    return estimators


# -- data ------------------------------------------------------------------------------


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
    data = data if hasattr(data, "shape") else np.asarray(data)
    return data.iloc[rows] if hasattr(data, "iloc") else data[rows]


def _test_data(test):
    test = tuple(test)
    if test and all(hasattr(one, "y") for one in test):  # one record per experiment
        test = [one.u for one in test], [one.y for one in test]
    if len(test) not in (2, 3):
        raise ValueError(
            "`test` must be a Record, (u, y) or (u, y, experiment), got "
            f"{len(test)} items. Use None to split `u` and `y` by time."
        )
    u, y, experiment = (*test, None)[:3]
    return join_records(u, y, experiment)


# -- one model -------------------------------------------------------------------------


def _fit(model, train):
    """Return the duration of a fit, and what interrupted it, if a model is left."""
    start = time.perf_counter()
    interrupt = None
    with warnings.catch_warnings():
        # the table marks the row instead
        warnings.simplefilter("ignore", ConvergenceWarning)
        try:
            model.fit(*train)
        except KeyboardInterrupt as stop:
            if not hasattr(model, "train_score_"):
                raise
            interrupt = stop
    return time.perf_counter() - start, interrupt


def _judge(name, model, train, test, seconds):
    """Return the row of one fitted model, and the test data as it judges them."""
    rmse_train = np.full(len(model.C_), np.nan)
    if train is not None:
        rmse_train, _ = free_run_errors(*model.simulate_test(*train))
    y_test, y_hat = _columns(model.simulate_test(*test))
    rmse_test, fit = free_run_errors(y_test, y_hat)
    record = model.linearizability(*test, in_loop=False)
    records = model.prepare_records(*test)
    row = Rung(
        name=name,
        model=model,
        n_params=int(model.fitted_.free.sum()),
        rmse_train=rmse_train,
        rmse_test=rmse_test,
        fit_percent=fit,
        linearization_error=record.linearization_error,
        spectral_radius=record.spectral_radius,
        seconds=seconds,
        y_hat=y_hat,
        no_law=record.no_law,
        closed_linearization_error=record.closed_linearization_error,
        closed_outside=record.closed_outside,
        large_law=record.large_law,
        e=np.vstack([record.e[r.part][r.scored] for r in records]),
    )
    return row, records


def _columns(signals):
    """Return signals with one column per output."""
    return tuple(z.reshape(len(z), -1) for z in signals)

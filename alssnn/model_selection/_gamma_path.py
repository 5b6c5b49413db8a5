"""Choosing gamma: accuracy against linearity along a path of warm-started fits.

A large gamma gives a linear loop and a poor fit, a small one the reverse.  The path
goes down in gamma, each fit the start of the next, which is both quicker and better
than separate fits: training at a small gamma from a linear start ends in worse optima
(see `training`).  The knee is the point of the curve

    (log linearization error, log RMSE),   both scaled to [0, 1],

farthest below the straight line between its ends.
"""

import copy
import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

from ..metrics import rmse
from ..optimizers import single_threaded
from ..rows import data_frame
from ..workers import finished

DEFAULT_GAMMAS = (10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01)


@dataclass(frozen=True, eq=False)
class GammaPath:
    """Hold accuracy and linearity along a path of weights gamma.

    Parameters
    ----------
    gammas : ndarray of shape (n,)
        Weights, falling.
    models : tuple of object
        Fitted estimators.
    rmse_train, rmse_test : ndarray of shape (n,)
        Root-mean-square error of the free-run simulation, mean over the outputs, in
        the units of y; inf where it diverges.
    linearization_error : ndarray of shape (n,)
        Share rms(e) / std(y) of the test output (eq. gauge), mean over the outputs.
    spectral_radius : ndarray of shape (n,)
        Largest modulus of the eigenvalues of A.
    seconds : ndarray of shape (n,)
        Duration of every fit, in seconds.
    score : ndarray of shape (n,) or None, default=None
        What `scoring` said of every model, the greater the better.

    Examples
    --------
    >>> from alssnn.model_selection import gamma_path
    >>> record = alssnn.datasets.make_wiener_hammerstein(600, random_state=0)
    >>> estimator = alssnn.AlSsnn(nx=4, n_h=2, n_g=2, alpha=0.0, max_iter=10)
    >>> path = gamma_path(estimator, *record, gammas=[10, 0.1])
    >>> path.gammas, len(path.models)
    (array([10. ,  0.1]), 2)
    """

    gammas: np.ndarray
    models: tuple[Any, ...] = field(repr=False)
    rmse_train: np.ndarray
    rmse_test: np.ndarray
    linearization_error: np.ndarray
    spectral_radius: np.ndarray
    seconds: np.ndarray
    score: np.ndarray | None = None

    def knee(self):
        """Return the index of the best trade-off of accuracy and linearity.

        With a `score` its negative takes the place of the linearization error.

        Returns
        -------
        index : int
            Stable model farthest below the line between the ends of the curve of log
            RMSE against log linearization error; the most accurate stable model if
            the curve is not convex anywhere.

        Raises
        ------
        ValueError
            If no model of the path is stable on the test data.

        Notes
        -----
        Of several outputs, RMSE is the mean in their units: one in large numbers, such
        as mV beside V, decides alone.
        """
        nonlinear = self.linearization_error if self.score is None else -self.score
        usable = np.isfinite(self.rmse_test) & np.isfinite(nonlinear)
        usable &= self.spectral_radius < 1
        if not usable.any():
            raise ValueError(
                "`knee` needs a stable model on the path, got none. Use larger gammas "
                'or `stability="contractive"`.'
            )
        where = np.flatnonzero(usable)
        tiny = np.finfo(float).tiny
        across = _unit(np.log(np.maximum(nonlinear[where], tiny)))
        down = _unit(np.log(np.maximum(self.rmse_test[where], tiny)))
        depth = 1.0 - across - down  # below the line from (0, 1) to (1, 0)
        if depth.max() <= 0:
            return int(where[np.argmin(self.rmse_test[where])])
        return int(where[np.argmax(depth)])

    def __len__(self):
        """Return the number of weights."""
        return len(self.gammas)

    def __repr__(self):
        """Return the path as a table; a star marks the knee."""
        try:
            knee = self.knee()
        except ValueError:
            knee = -1
        lines = [
            f"{'gamma':>10s}{'RMSE train':>12s}{'RMSE test':>12s}{'e/y, %':>9s}"
            f"{'radius':>9s}{'time, s':>9s}"
            + ("" if self.score is None else f"{'score':>11s}")
        ]
        for i, gamma in enumerate(self.gammas):
            lines.append(
                f"{gamma:10.4g}{self.rmse_train[i]:12.4g}{self.rmse_test[i]:12.4g}"
                f"{100 * self.linearization_error[i]:9.3g}"
                f"{self.spectral_radius[i]:9.4f}{self.seconds[i]:9.1f}"
                + ("" if self.score is None else f"{self.score[i]:11.4g}")
                + (" *" if i == knee else "")
            )
        return "\n".join(lines)

    def to_frame(self):
        """Return the path as a pandas DataFrame.

        Returns
        -------
        frame : pandas.DataFrame
            One row per weight.
        """
        names = ("rmse_train", "rmse_test", "linearization_error", "spectral_radius")
        columns = {name: getattr(self, name) for name in (*names, "seconds")}
        columns |= {} if self.score is None else {"score": self.score}
        return data_frame(columns, self.gammas, "gamma")


def _unit(values):
    """Scale values to [0, 1]; equal values to 0."""
    span = np.ptp(values)
    return (values - values.min()) / span if span > 0 else np.zeros_like(values)


def gamma_path(
    estimator,
    u,
    y,
    gammas=DEFAULT_GAMMAS,
    *,
    experiment=None,
    test=None,
    scoring=None,
    callback=None,
    n_jobs=None,
):
    """Fit along falling gamma, each fit the start of the next.

    Parameters
    ----------
    estimator : AlSsnn
        Unfitted estimator; its `gamma` is replaced and it is left alone.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs.
    gammas : sequence of float, default=(10, 3, 1, 0.3, 0.1, 0.03, 0.01)
        Weights; sorted to fall.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    test : Record or tuple or None, default=None
        Test data (u, y) or (u, y, experiment); None measures on the training data.
    scoring : callable or None, default=None
        A further figure of every model on the test data, the greater the better, called
        as ``scoring(model, u, y, experiment)``, for example
        `scorers.neg_certified_distance`: the knee is then chosen by what is proved.
    callback : callable or None, default=None
        Called as ``callback(gamma, model)`` after every fit.
    n_jobs : int or None, default=None
        Models measured in parallel, as in joblib. The fits follow each other; their
        restarts and experiments take the `n_jobs` of the estimator. The result does
        not depend on it.

    Returns
    -------
    path : GammaPath
        Accuracy against linearization error; ``path.models[path.knee()]`` is the
        model at the knee.

    Raises
    ------
    ValueError
        If `gammas` is empty or not positive, or `test` no pair or triple.
    TypeError
        If `scoring` cannot be called.

    Notes
    -----
    The first weight takes `max_iter` and `polish_iter` trial steps; the others share
    as many, so that the path costs about two fits. With ``alpha="auto"``, a fit that
    holds g at zero, or returns the linear model, is no start: the next weight then
    costs a whole fit.

    Examples
    --------
    >>> from alssnn.model_selection import gamma_path
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> estimator = alssnn.AlSsnn(nx=6, n_h=3, n_g=3, alpha=0.0, max_iter=20)
    >>> path = gamma_path(estimator, *record, gammas=[10, 1, 0.1])
    >>> bool(path.rmse_test[-1] < path.rmse_test[0])
    True
    """
    gammas = np.asarray(gammas, dtype=float)
    if gammas.ndim != 1 or len(gammas) == 0 or not np.all(gammas > 0):
        raise ValueError(
            f"`gammas` must hold at least one positive weight, got {gammas.tolist()}. "
            "Leave g unpenalized by GrSsnn."
        )
    if not (scoring is None or callable(scoring)):
        raise TypeError(
            f"`scoring` must be a callable or None, got {scoring!r}. Take one of "
            "`alssnn.scorers`."
        )
    gammas = np.sort(gammas)[::-1]
    test = (u, y, experiment) if test is None else tuple(test)
    if len(test) not in (2, 3):  # before the fits, not behind them
        raise ValueError(
            "`test` must be a tuple (u, y) or (u, y, experiment), got one of length "
            f"{len(test)}."
        )
    model = clone(estimator)
    steps = {name: model.get_params()[name] for name in ("max_iter", "polish_iter")}
    whole = {**steps, "continuation": model.continuation}
    share = {name: max(1, n // max(1, len(gammas) - 1)) for name, n in steps.items()}
    share["continuation"] = 0
    models, seconds = [], []
    for i, gamma in enumerate(gammas):
        # share one more fit among the others; one that held g at zero asks again
        goes_on = i > 0 and np.any(model.params_.get("W_g", 1.0))
        model.set_params(**share if goes_on else whole, warm_start=bool(goes_on))
        start = time.perf_counter()
        with warnings.catch_warnings():
            # the path goes on from wherever a fit stops
            warnings.simplefilter("ignore", ConvergenceWarning)
            model.set_params(gamma=float(gamma)).fit(u, y, experiment)
        seconds.append(time.perf_counter() - start)
        models.append(copy.deepcopy(model).set_params(warm_start=False))
        if callback is not None:
            callback(float(gamma), models[-1])
    calls = [(fitted, (u, y, experiment), test, scoring) for fitted in models]
    found = dict(finished(_measure, calls, n_jobs))
    measured = [found[i] for i in range(len(calls))]
    records, rmse_train, rmse_test, scores = zip(*measured, strict=True)
    return GammaPath(
        gammas=gammas,
        models=tuple(models),
        rmse_train=np.array(rmse_train),
        rmse_test=np.array(rmse_test),
        linearization_error=np.array([r.linearization_error.mean() for r in records]),
        spectral_radius=np.array([r.spectral_radius for r in records]),
        seconds=np.array(seconds),
        score=None if scoring is None else np.array(scores, dtype=float),
    )


def _measure(model, train, test, scoring):
    """Return the linearity of a model on test data, its errors on both, its score."""
    with single_threaded():
        record = model.linearizability(*test, in_loop=False)
        score = np.nan if scoring is None else scoring(model, *test)
        return record, _error(model, train), _error(model, test), score


def _error(model, data):
    """Return the RMSE of the free-run simulation, inf where it diverges."""
    y_true, y_pred = model.simulate_test(*data)
    return rmse(y_true, y_pred) if np.isfinite(y_pred).all() else np.inf

"""Scorers of simulations and predictions, for `scoring=` of scikit-learn's searches.

    neg_rmse, neg_nrmse, fit_percent    accuracy of the simulation (`metrics`)
    k_step(...)                         accuracy some samples ahead of an observer
    neg_linearization_error             rms(e) / std(y) (eq. gauge)
    neg_certified_distance              proved distance from the design (eq. local)
    accuracy_subject_to(...)            accuracy, if the model is linear enough
    best_subject_to(...)                the same as a choice among all candidates

All are called as ``scorer(model, u, y, experiment=None)`` and return one number, mean
over the outputs, of which the greater is the better.  They keep to the policy of
`score`: the initial state of every experiment is estimated from its first
`n_init_samples` samples, which are not scored (`simulate_test`; the linearization error
counts them).  Labels reach them without `set_score_request` where scikit-learn's
metadata routing is on.

Strings such as "r2" do not keep to that policy: they score `predict`, which starts at
the operating point and knows no experiments.
"""

from functools import partial
from numbers import Real

import numpy as np
from sklearn.utils.metadata_routing import MetadataRequest

from . import metrics
from .checks import check_option, is_count

__all__ = [
    "Scorer",
    "accuracy_subject_to",
    "best_subject_to",
    "fit_percent",
    "k_step",
    "neg_certified_distance",
    "neg_linearization_error",
    "neg_nrmse",
    "neg_rmse",
]


class Scorer:
    """Score a fitted model on records.

    Parameters
    ----------
    name : str
        Name, for the eye.
    measure : callable
        Called as ``measure(model, u, y, experiment)``, returns a float, the greater
        the better. Of module level, so that searches can run in parallel.
    **options : object
        Further keywords of `measure`.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.scorers import Scorer
    >>> def stable(model, u, y, experiment):
    ...     return abs(np.linalg.eigvals(model.A_)).max() < 1
    >>> Scorer("stable", stable)(model, *record)
    1.0
    """

    def __init__(self, name, measure, **options):
        self.name = name
        self.measure = measure
        self.options = options

    def __call__(self, model, u, y, experiment=None):
        """Return the score of a fitted model."""
        return float(self.measure(model, u, y, experiment, **self.options))

    def get_metadata_routing(self):
        """Return what scikit-learn is asked to pass on.

        Returns
        -------
        request : MetadataRequest
            The labels `experiment`.
        """
        request = MetadataRequest(owner=self)
        request.score.add_request(param="experiment", alias=True)
        return request

    def __repr__(self):
        """Return the name."""
        return f"alssnn.scorers.{self.name}"


def _accuracy(model, u, y, experiment, *, metric, sign):
    """Return a metric of the free-run simulation, -inf where it diverges."""
    y_true, y_pred = model.simulate_test(u, y, experiment)
    if not np.isfinite(y_pred).all():
        return -np.inf
    return sign * getattr(metrics, metric)(y_true, y_pred)


def _k_step(model, u, y, experiment, *, steps, metric, sign):
    """Return a metric of the predictions `steps` ahead, -inf where there are none."""
    records = model.prepare_records(u, y, experiment)
    x0 = np.vstack([record.x0 for record in records])
    try:
        # what drifts is a part of the predictions
        observer = model.observer() if model.plant_.drift is None else None
    except ValueError:  # not detectable: nothing follows the record
        return -np.inf
    with np.errstate(over="ignore", invalid="ignore"):
        y_hat = model.predict_ahead(u, y, steps, experiment, x0=x0, observer=observer)
    y_hat = np.concatenate(y_hat) if isinstance(y_hat, list) else y_hat
    y_hat = y_hat.reshape(len(y_hat), -1)
    # the first `steps` rows are simulated, those of the window made x0
    starts = [max(record.start, steps) for record in records]
    pairs = zip(records, starts, strict=True)
    y_true, y_pred = (
        np.vstack(z)
        for z in zip(*((r.y[n:], y_hat[r.part][n:]) for r, n in pairs), strict=True)
    )
    if not np.isfinite(y_true).any(axis=0).all():
        raise ValueError(
            f"`y` must have measured samples behind the first {steps} of an "
            "experiment, got none in an output. Take fewer `steps` or a longer record."
        )
    if not np.isfinite(y_pred).all():
        return -np.inf
    return sign * getattr(metrics, metric)(y_true, y_pred)


def _linearity(model, u, y, experiment):
    if not np.isfinite(model.simulate_test(u, y, experiment)[1]).all():
        return -np.inf  # without g, nothing would be left of a run that diverges
    record = model.linearizability(u, y, experiment, in_loop=False)
    error = np.mean(record.linearization_error)
    return -error if np.isfinite(error) else -np.inf


def _certified(model, u, y, experiment):
    from .feedback import balanced_weights, lqr

    Q, R = balanced_weights(model)
    nx = model.plant_.late().nx
    try:
        K = lqr(model, Q[:nx, :nx], R)
        certificate = model.local_certificate(K=K, search=False)
    except ValueError:  # no gain, or no law
        return -np.inf
    shares = certificate.output_bounds / np.maximum(certificate.design_peak, 1e-300)
    return -float(np.mean(shares))


def _constrained(model, u, y, experiment, *, limit):
    error = -_linearity(model, u, y, experiment)
    accuracy = _accuracy(model, u, y, experiment, metric="nrmse", sign=-1)
    if error <= limit:
        return accuracy
    return min(accuracy, -1.0) - error / limit


neg_rmse = Scorer("neg_rmse", _accuracy, metric="rmse", sign=-1)
neg_nrmse = Scorer("neg_nrmse", _accuracy, metric="nrmse", sign=-1)
fit_percent = Scorer("fit_percent", _accuracy, metric="fit_percent", sign=1)
neg_linearization_error = Scorer("neg_linearization_error", _linearity)
# with the regulator of `balanced_weights`; records count by the training region alone
neg_certified_distance = Scorer("neg_certified_distance", _certified)


def k_step(steps, *, metric="nrmse"):
    """Return a scorer of predictions some samples ahead.

    The observer of the model, with its defaults, follows the record, or the predictor
    of a model with a `drift`; from every estimate the model runs alone
    (`predict_ahead`).  As the samples that estimate the initial state, the first
    `steps` of every experiment are not scored.

    Parameters
    ----------
    steps : int
        Number of samples ahead, such as the horizon of a predictive controller.
    metric : {"rmse", "nrmse", "fit_percent"}, default="nrmse"
        Measure of accuracy in `metrics`, mean over the outputs.

    Returns
    -------
    scorer : Scorer
        The metric, errors with a minus sign: the greater the better. Minus infinity
        where predictions diverge or the model is not detectable.

    Raises
    ------
    ValueError
        If `steps` is no positive integer or the metric unknown; when scoring, if no
        experiment is longer than `steps`.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.scorers import k_step
    >>> k_step(10)
    alssnn.scorers.k_step(10, metric='nrmse')
    >>> k_step(1)(model, *record) > k_step(10)(model, *record)
    True
    """
    if not is_count(steps):
        raise ValueError(
            f"`steps` must be a positive integer, got {steps!r}. It counts samples; "
            "`neg_nrmse` scores the free run."
        )
    signs = {"rmse": -1, "nrmse": -1, "fit_percent": 1}
    check_option("metric", metric, signs)
    name = f"k_step({steps}, metric={metric!r})"
    return Scorer(name, _k_step, steps=int(steps), metric=metric, sign=signs[metric])


def accuracy_subject_to(*, linearization_error):
    """Return a scorer of accuracy among models that are linear enough.

    Parameters
    ----------
    linearization_error : float
        Largest share rms(e) / std(y) that is allowed on the test data, such as 0.05,
        mean over the outputs (eq. gauge).

    Returns
    -------
    scorer : Scorer
        Minus the relative simulation error, `metrics.nrmse`; for a model that is not
        linear enough, the worse of that and -1, less its error over the one allowed.
        A model that is linear enough, and better than the mean of y, ranks before all
        that are not.

    Raises
    ------
    ValueError
        If the bound is not positive.

    See Also
    --------
    best_subject_to : Bound of the mean over the folds, instead of every fold.

    Examples
    --------
    >>> from alssnn.scorers import accuracy_subject_to
    >>> accuracy_subject_to(linearization_error=0.05)
    alssnn.scorers.accuracy_subject_to(linearization_error=0.05)
    """
    limit = _check_limit(linearization_error)
    name = f"accuracy_subject_to(linearization_error={limit:g})"
    return Scorer(name, _constrained, limit=limit)


def best_subject_to(*, linearization_error, accuracy="accuracy", linearity="linearity"):
    """Return the choice of the most accurate candidate that is linear enough.

    Parameters
    ----------
    linearization_error : float
        Largest mean share rms(e) / std(y) over the test folds that is allowed.
    accuracy : str, default="accuracy"
        Name of the score of accuracy in `scoring=`, the greater the better.
    linearity : str, default="linearity"
        Name of the score `neg_linearization_error` in `scoring=`.

    Returns
    -------
    refit : callable
        For `refit=` of a search with several scores: returns the index of the most
        accurate candidate within the bound, of the most linear one if there is none.
        It raises ValueError if one of the scores is missing, or no candidate could be
        simulated on all folds.

    Raises
    ------
    ValueError
        If the bound is not positive.

    Examples
    --------
    >>> from sklearn.model_selection import GridSearchCV
    >>> from alssnn import scorers
    >>> search = GridSearchCV(
    ...     alssnn.AlSsnn(),
    ...     {"gamma": [1.0, 0.1]},
    ...     scoring={
    ...         "accuracy": scorers.neg_rmse,
    ...         "linearity": scorers.neg_linearization_error,
    ...     },
    ...     refit=scorers.best_subject_to(linearization_error=0.05),
    ... )
    """
    limit = _check_limit(linearization_error)
    return partial(_best_index, limit=limit, names=(accuracy, linearity))


def _best_index(cv_results, *, limit, names):
    """Return the index of the best candidate within a bound."""
    scores = []
    for name in names:
        key = f"mean_test_{name}"
        if key not in cv_results:
            raise ValueError(
                f"`scoring` must have a score of the name {name!r}, got results "
                "without it. Name the scores in a dict, or name them here."
            )
        scores.append(np.nan_to_num(cv_results[key], nan=-np.inf, neginf=-np.inf))
    accuracy, linearity = scores
    usable = np.isfinite(accuracy) & np.isfinite(linearity)
    if not usable.any():
        raise ValueError(
            "`best_subject_to` needs a candidate that can be simulated on all folds, "
            "got none. Use larger gammas or other orders."
        )
    good = usable & (-linearity <= limit)
    if good.any():
        return int(np.argmax(np.where(good, accuracy, -np.inf)))
    return int(np.argmax(np.where(usable, linearity, -np.inf)))


def _check_limit(limit):
    if isinstance(limit, bool) or not isinstance(limit, Real) or not float(limit) > 0:
        raise ValueError(
            f"`linearization_error` must be positive, got {limit!r}. It is a share: "
            "0.05 allows 5 % of the output."
        )
    return float(limit)

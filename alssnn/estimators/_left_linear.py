"""What a fit with networks returns where they do not help: its linear model."""

import numpy as np

from ._horizon import trained
from ._judge import warn_left_linear
from ._noise import is_predicting
from ._safe import as_found
from ._time import is_continuous

LEFT_LINEAR = "the networks do not help: this is the linear model"


def left_linear(estimator, linear, near, experiments, watch, refused=False):
    """Return the linear model as the outcome of a fit, and say so.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    linear : LinearModel
        Linear model.
    near : Held
        Experiments of the linear start.
    experiments : Held or Remote
        Experiments of the fit.
    watch : Watch
        What follows the fit.
    refused : bool, default=False
        Whether a search had found networks, and their training was refused.

    Returns
    -------
    plain : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Its parameters, the networks without effect.
    result : OptimizeResult
        The outcome.
    """
    estimator._decay = {"alpha": np.inf}
    radius = np.abs(np.linalg.eigvals(linear.A)).max()
    linear, plain = estimator._declared(linear)
    theta = estimator._start(plain, linear, near, 0, roots=(0.0, 0.0))
    if estimator._phi is not None:
        estimator._x_scale = np.ones(plain.sizes["x"])
    # in continuous time they may help yet; and unless all was tried, nobody knows
    if watch.reason is None and not is_continuous(estimator):
        fall = (1.0 - radius) * max(experiments.lengths)
        if estimator.integrators_ or is_predicting(estimator):
            fall = np.inf  # what hardly falls is known
        warn_left_linear(estimator, refused, fall)
    if estimator._shapes_linear():
        return _shaped(estimator, plain, theta, experiments, watch)
    # of a stretch elsewhere, then estimated: free, as in a fit
    x0 = linear.starts(plain.given) if experiments.is_here else None
    own = {"x0": x0, "noise": 0.0}
    result = as_found(estimator, plain, theta, experiments, watch, LEFT_LINEAR, **own)
    # of the search for this model, for the networks took none
    result.nfev = linear.result.nfev if linear.result is not None else 1
    return plain, theta, result


def _shaped(estimator, plain, theta, experiments, watch):
    """Return the linear model as the user shapes it, networks held at zero."""
    p, options = plain.split(theta), estimator._training(plain)
    options["bounds"] |= {n: (p[n], p[n]) for n in plain.network_parameters}
    options["weights"] = {"y": estimator._output_weight(plain.sizes["y"])}
    result = trained(estimator, plain, experiments, [theta], watch=watch, **options)
    if result.success:
        result.message = LEFT_LINEAR
    return plain, result.theta, result

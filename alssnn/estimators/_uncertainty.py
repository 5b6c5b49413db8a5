"""What a fitted model knows of its own uncertainty: covariance, criteria, samples."""

import copy
import warnings

import numpy as np
from sklearn.utils import Bunch, check_random_state
from sklearn.utils.validation import check_is_fitted

from ..criterion import Criterion
from ..initial_states import WINDOW, estimate_x0
from ..innovations import free_run, has_innovations, predictor
from ..mapping import Held, count_measured
from ..noise import fit_noise, highest_order
from ..optimizers import single_threaded
from ..predictions import bridged, first_states, told
from ..sandwich import (
    pseudo_inverse,
    residual_moments,
    score_covariance,
    weighted_step,
)
from ..split import as_trained
from ..training import train
from ..uncertainty import ParameterCovariance
from ._first_states import from_free
from ._fitted import as_fitted, free_entries, publish_parameters
from ._plant import sampling_time
from ._residual import idle
from ._simulation import expected_states, labeled_data, simulated_experiments
from ._split import settled_split
from ._time import is_continuous, within_derivatives

BIASED = 0.05  # level below which the step counts as a bias
REFUSED = 1e-3  # and below which there are no bands: the model may be too small
MOVES = (
    "The fit moves more than noise allows when its color is weighed (p = {:.1g}): "
    "noise reached `u` by feedback, or the model is too small."
)


def parameter_covariance(model, u, y, experiment=None):
    """Return the uncertainty of the parameters, from the training data.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs of the training.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs of the training.
    experiment : array_like of shape (N,) or (N, 2), or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    covariance : ParameterCovariance
        First-order covariance, with frequency response and poles on request.

    Raises
    ------
    ValueError
        If the simulation diverges on the data, or an output has too few measured
        samples for the parameters.

    Warns
    -----
    UserWarning
        If the fit moves more than the noise allows when its color is weighed
        (eq. weighting): the record of a closed loop, or a model that is too small. The
        simulation error is biased then, and the bands are wider by the bias that
        shows (eq. bias). If noise explains it with a probability below 0.001, the
        result has `holds` False and no bands. ``noise="innovations"`` takes records of
        a closed loop without a bias.

    Notes
    -----
    Costs a few passes over the sensitivities. The noise may have any color, and be
    that of the process where the model is linear; the color is that of the residuals.
    It takes u independent of the noise and no active bound; entries held by equal
    bounds are certain, and so are networks of a fit that returned the linear model. Of
    a contractive model, A counts as free, and what was linear of h is held where it is
    (eq. best). The weight `alpha_` and a training that ends
    early keep a fit from its optimum: the bands are wider by the step that is missing
    (eq. pull). Whether the model is right is for `validate` to say.
    """
    model = as_fitted(model)
    fit = _gauss_newton(model, u, y, experiment)
    n_params = model._structure.n_params
    EE, count = fit.moments.products[0], fit.moments.pairs[0]
    freedom = count - fit.n_effective / len(EE)
    if not np.diag(freedom).min() > 0.5:  # rounded: a whole sample is left
        raise ValueError(
            "`y` must have more measured samples of every output than parameters "
            f"per output ({fit.n_effective / len(EE):.1f}), got "
            f"{int(np.diag(count).min())}. Take a longer record or a smaller "
            "model."
        )
    Lambda = np.where(count > 0, EE / np.maximum(freedom, 1.0), 0.0)
    weight = fit.output_weight / fit.n_measured
    simulated = fit.structure, model._theta, fit.x0, fit.experiments
    noise = fit_noise(fit.moments)
    with single_threaded():
        # what the parameters took out of the residuals (eq. effective)
        noise = noise.rescale(np.sqrt(np.diag(count) / np.diag(freedom)))
        F = score_covariance(*simulated, weight, noise)
        force, p = weighted_step(*simulated, weight, noise, F, fit.free)
    P = fit.inverse @ F @ fit.inverse  # (eq. sandwich)
    bias = np.zeros(len(P))
    reason = _doubt(model, P, p)
    if reason:
        warnings.warn(f"No confidence band holds. {reason}", UserWarning, stacklevel=2)
    elif p < BIASED:
        bias = fit.inverse @ force  # (eq. bias)
        warnings.warn(
            f"The confidence bands are wider by a bias. {MOVES.format(p)} Fit with "
            "noise='innovations' if it was feedback.",
            UserWarning,
            stacklevel=2,
        )
    scale = model._scaling.y_scale
    P = P + sum(np.outer(z, z) for z in (bias, fit.pull))
    return ParameterCovariance(
        theta=model._theta.copy(),
        covariance=P[:n_params, :n_params],
        noise_covariance=Lambda * np.outer(scale, scale),
        n_effective=fit.n_effective,
        rank=fit.rank,
        n_samples=fit.n_samples,
        structure=model._structure,
        units=model._units(),
        dt=sampling_time(model),
        input_delay=model.input_delay_,
        noise=noise.rescale(scale),
        p_weighting=p,
        bias=bias[:n_params],
        pull=fit.pull[:n_params],
        reason=reason,
    )


def _doubt(model, P, p):
    """Return why no interval covers the truth; "" if nothing speaks against one."""
    if model.horizon > 1:
        return (
            f"The fit has weighed predictions over `horizon`={model.horizon} samples, "
            "whose errors are not independent. Fit with horizon=1."
        )
    if not np.isfinite(P).all():
        return "The covariance has entries that are not finite. Fit a smaller model."
    return "" if p >= REFUSED else MOVES.format(p)  # nan is no likelihood


def aic(model, u, y, experiment=None):
    """Return the information criterion of Akaike, from the training data.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs of the training.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs of the training.
    experiment : array_like of shape (N,) or (N, 2), or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    aic : float
        ``-2 log L + 2 n``: L the likelihood of normal output noise of the color that
        the residuals have (eq. criteria), n the effective number of parameters
        (eq. effective) and those of the color; the lower the better.
    """
    return _criterion_value(model, u, y, experiment)


def bic(model, u, y, experiment=None):
    """Return the Bayesian information criterion, from the training data.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu), or list of them
        Inputs of the training.
    y : array_like of shape (N,) or (N, ny), or list of them
        Outputs of the training.
    experiment : array_like of shape (N,) or (N, 2), or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    bic : float
        ``-2 log L + n log N``, as `aic` but with a larger price of parameters;
        the lower the better.
    """
    return _criterion_value(model, u, y, experiment, by_samples=True)


def sample_models(
    model,
    covariance,
    n_models=10,
    random_state=None,
    *,
    data=None,
    max_iter=30,
    tol=1e-4,
):
    """Return models drawn from the uncertainty of this one.

    Parameters
    ----------
    model : estimator
        Fitted model.
    covariance : ParameterCovariance
        What `parameter_covariance` returned for this model.
    n_models : int, default=10
        Number of models.
    random_state : int, RandomState instance or None, default=None
        Source of the draws.
    data : tuple of array_like or None, default=None
        The training data (u, y) or (u, y, experiment): every draw is then the
        optimum of the training cost for y plus a draw of the noise, as correlated
        over time as the residuals are (eq. bootstrap). None draws parameters from
        their normal approximation, which is of use where the data determine all of
        them, as for a linear model.
    max_iter : int, default=30
        Largest number of trial steps of every draw from `data`.
    tol : float, default=1e-4
        Relative change of the cost that ends a draw from `data`.

    Returns
    -------
    models : list of object
        Fitted copies that differ in their parameters. Normal draws of a network
        with neurons that the data hardly determine leave the range of the first
        order: they fit badly or diverge. Those from `data` do not.

    Raises
    ------
    ValueError
        If the covariance belongs to another model or other data.

    Warns
    -----
    UserWarning
        If the covariance does not hold: neither do the draws. With `data` also if it
        has a bias (eq. bias), which those draws do not have.

    Notes
    -----
    Without `data` this is nearly free. With it, every model costs one short
    training from the parameters of this one, without its networks' random start;
    where the first order holds, and `pull` is small, both have the same distribution.
    Draws from `data` are not held back by `alpha_`, and spread about the optimum
    without it. Their linear parts are their own (eq. best), and closer together.
    """
    check_is_fitted(model)
    theta = getattr(covariance, "theta", ())  # (): no covariance at all
    if not np.array_equal(theta, model._theta):
        raise ValueError(
            "`covariance` must be that of this model, got that of another one. "
            "Call `parameter_covariance` again after a fit."
        )
    reason = covariance.reason
    if data is not None and covariance.bias.any():
        reason = MOVES.format(covariance.p_weighting)
    if reason:
        warnings.warn(
            "The models that are drawn are no sample of what is possible: "
            f"{reason} They are too close to each other.",
            UserWarning,
            stacklevel=2,
        )
    if data is None:
        same = model._structure
        sampled = covariance.sample(n_models, random_state)
        draws = ((z, model.x0_, same) for z in sampled)
    else:
        draws = _refits(
            as_fitted(model),
            covariance,
            n_models,
            random_state,
            data,
            max_iter=max_iter,
            tol=tol,
        )
    models = []
    for theta, x0, structure in draws:
        drawn = copy.deepcopy(model)
        drawn._theta, drawn.x0_, drawn._structure = theta, x0, structure
        publish_parameters(drawn)
        models.append(drawn)
    return models


def _refits(model, covariance, n_models, random_state, data, **options):
    """Yield optima for data with more noise: theta, x0, structure (eq. bootstrap)."""
    if not isinstance(data, tuple | list) or len(data) not in (2, 3):
        raise ValueError(
            "`data` must be a tuple (u, y) or (u, y, experiment), got "
            f"{type(data).__name__}. Pass the training data."
        )
    u, y, parts = labeled_data(model, *data, *[None] * (3 - len(data)))[:3]
    if len(u) != covariance.n_samples:
        raise ValueError(
            f"`data` must be the {covariance.n_samples} samples of `covariance`, "
            f"got {len(u)}. Pass the training data."
        )
    experiments = _seen(model, u, y, parts)
    scale = model._scaling.y_scale
    noise = covariance.noise.rescale(1 / scale)
    before, start = as_trained(model._structure, model._theta)
    plain = predictor(before)
    structure, weights = model._criterion_terms(plain)
    held = idle(structure, start, getattr(model, "alpha_", 0.0))
    own = model._training(structure, held)
    if is_continuous(model):
        own |= within_derivatives(model, structure, start, held)
    options = {**own, "periodic": False, **options}
    random_state = check_random_state(random_state)
    for _ in range(n_models):
        noisy = []
        for u_s, y_s in experiments:
            noisy.append((u_s, y_s[:] + noise.draw(len(u_s), random_state)))
        result = train(
            structure,
            noisy,
            [start],
            weights=weights,
            **options,
        )
        whole = simulated_experiments(model, u, y, parts)
        kind = {"noise": min(model.cost_, 1.0), "prior": expected_states(model)}
        x0 = first_states(structure, result.theta, result.x0, whole, **kind)
        split = settled_split(model, plain, result.theta, result.x0, Held(noisy))
        yield split[1], x0 * model._x_scale, free_run(split[0])


def _seen(model, u, y, parts):
    """Return scaled experiments as the training saw them."""
    experiments = from_free(model, simulated_experiments(model, u, y, parts))
    if not has_innovations(model._structure):
        return experiments
    experiments = told(experiments, from_rest=model._at_rest)
    structure, theta = predictor(model._structure), model._theta
    x0 = np.zeros((len(experiments), structure.n_x0))
    if not model._at_rest:
        known = {"window": WINDOW, "noise": model.cost_}
        x0 = estimate_x0(structure, theta, experiments, **known)
    return bridged(structure, theta, x0, experiments)


def _gauss_newton(model, u, y, experiment):
    """Return the Gauss-Newton matrices of the training and its residuals."""
    u, y, parts = labeled_data(model, u, y, experiment)[:3]
    experiments = _seen(model, u, y, parts)
    structure, theta = predictor(model._structure), model._theta
    penalized, weights = model._criterion_terms(structure)
    of_y = {"y": weights["y"]}
    longest = max(len(u_s) for u_s, _ in experiments)
    with single_threaded():
        if model._at_rest:
            x0 = np.zeros((len(experiments), structure.n_x0))
        else:
            x0 = estimate_x0(structure, theta, experiments, window=longest, noise=0.0)
        try:
            sums = [
                criterion.normal_equations(criterion.join(theta, x0))
                for criterion in (
                    Criterion(penalized, experiments, weights=weights),
                    Criterion(structure, experiments, weights=of_y),
                )
            ]
        except FloatingPointError:
            raise ValueError(
                "`u` and `y` must be data that the model can simulate, got a "
                "simulation that diverges. Pass the training data."
            ) from None
        ny = structure.sizes["y"]
        n_measured = sum(count_measured(y_s) for _, y_s in experiments) / ny
        n_lags = highest_order(int(n_measured), ny)
        n_lags = min(n_lags, longest - 1)
        moments = residual_moments(structure, theta, x0, experiments, n_lags)
    JJ, Jr = [square for square, *_ in sums], sums[0][1]
    free = free_entries(model, len(Jr))
    H, H_y = (M[np.ix_(free, free)] for M in JJ)
    inverse = np.zeros_like(JJ[0])
    inverse[np.ix_(free, free)], _ = pseudo_inverse(H)
    return Bunch(
        structure=structure,
        experiments=experiments,
        x0=x0,
        inverse=inverse,
        pull=-inverse @ Jr,
        free=free,
        rank=pseudo_inverse(H_y)[1],
        n_effective=float(np.sum(inverse * JJ[1])),
        moments=moments,
        output_weight=weights["y"],
        n_samples=len(u),
        n_measured=n_measured,
    )


def _criterion_value(model, u, y, experiment, by_samples=False):
    """Return -2 log L + price n, in the units of y (eq. criteria)."""
    fit = _gauss_newton(as_fitted(model), u, y, experiment)
    scale = model._scaling.y_scale
    EE, count = fit.moments.products[0], fit.moments.pairs[0]
    measured = np.diag(count)
    noise = fit_noise(fit.moments)
    Lambda = EE / np.maximum(count, 1) if noise.order == 0 else noise.innovation
    Lambda = Lambda * np.outer(scale, scale)
    n = fit.n_effective + noise.order * len(Lambda) ** 2
    with np.errstate(divide="ignore"):
        if np.all(count == fit.n_samples):
            deviance = fit.n_samples * np.linalg.slogdet(Lambda)[1]
        else:  # outputs that were measured apart: as if their noise were, too
            deviance = float(np.sum(measured * np.log(np.diag(Lambda))))
    deviance += measured.sum() * (1 + np.log(2 * np.pi))
    return float(deviance + (np.log(fit.n_samples) if by_samples else 2.0) * n)

"""The checks of a model on a record, and their words."""

import numpy as np

from ..metrics import fit_percent
from ._ahead import ahead_fit
from ._record import Check, Validation
from ._residuals import BLOCKS, check_options, residual_tests
from ._scored import column_names, scored_experiments, scored_sensitivities

OUTSIDE = 0.01  # share of samples outside the training region that is accepted

MEANING = {
    "independence": (
        "lags of u",
        "dynamics are missing: raise `nx`, or check `input_delay`",
    ),
    "squares": (
        "squares and products of the signals",
        "an even nonlinearity is missing: add networks or neurons",
    ),
    "cubes": (
        "cubes of the signals",
        "an odd nonlinearity is missing: add networks or neurons",
    ),
}


def validate(
    model,
    u,
    y,
    experiment=None,
    *,
    level=0.01,
    n_lags=25,
    horizons=(1, 2, 5, 10, 20, 50),
    linear_within=0.05,
    exact=False,
):
    """Check a model on a record that it was not trained on.

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
    level : float, default=0.01
        Probability of a false alarm of every test of residuals.
    n_lags : int, default=25
        Number of lags of the tests, in samples.
    horizons : sequence of int, default=(1, 2, 5, 10, 20, 50)
        Samples ahead at which predictions are compared.
    linear_within : float, default=0.05
        Share rms(e) / std(y) up to which the model counts as linearizable.
    exact : bool, default=False
        Whether the tests of residuals take the parameters for exact. By default, what
        other values of the parameters would explain to first order is no fault, so
        that a right structure passes whose parameters have errors; with True it is,
        which finds a plant that has changed since the training.

    Returns
    -------
    validation : Validation
        The checks and what they rest on; it prints as a table.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If an option is out of range or the record is too short for the lags.

    Notes
    -----
    With several outputs a p-value is the smallest one times their number (Bonferroni).
    Costs five simulations, one pass of an observer, and unless `exact` one of the
    sensitivities with a QR factorization of as many columns as parameters per output.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.validation import validate
    >>> validate(model, *record, n_lags=10)["extrapolation"].passed
    True
    """
    check_options(level, n_lags)
    if not linear_within > 0:
        raise ValueError(
            f"`linear_within` must be positive, got {linear_within}. It is a share of "
            "the output."
        )
    experiments, _ = scored_experiments(model, u, y, experiment)
    inputs, outputs = column_names(model)
    linear = model.linearizability(u, y, experiment)
    residuals = None
    if all(np.isfinite(y_hat).all() for _, _, y_hat in experiments):
        sensitivities = None
        if not exact:
            sensitivities = scored_sensitivities(model, u, y, experiment)
        residuals = residual_tests(
            experiments,
            sensitivities=sensitivities,
            level=level,
            n_lags=n_lags,
            dt=model.dt,
            input_names=inputs,
            output_names=outputs,
        )
    ahead, problem = None, ""
    try:
        ahead = ahead_fit(model, u, y, experiment, horizons=horizons)
    except ValueError as error:
        if "horizons" in str(error):
            raise
        problem = str(error)
    checks = (
        *(_block(residuals, name) for name in BLOCKS),
        _whiteness(residuals),
        _free_run(experiments, outputs),
        _ahead(ahead, problem, outputs),
        _extrapolation(linear),
        _linear(linear, linear_within, model.fitted_.for_control),
    )
    return Validation(checks, residuals, ahead, linear, type(model).__name__)


def _bonferroni(p):
    return float(min(1.0, len(p) * p.min()))


def _diverged(name, decides=True):
    sentence = "The free run diverges: there is no residual to test."
    return Check(name, False, np.nan, "p-value", decides, sentence)


def _block(residuals, name):
    if residuals is None:
        return _diverged(name)
    p, share = residuals.p_values[name], residuals.shares[name]
    worst = int(p.argmin())
    value = _bonferroni(p)
    passed = value >= residuals.level
    what, remedy = MEANING[name]
    if passed:
        sentence = f"The residual does not depend on {what}"
        sentence += (
            " beyond errors of the parameters." if residuals.n_parameters else "."
        )
    else:
        sentence = (
            f"The residual of {residuals.output_names[worst]} depends on {what}, which "
            f"explain {100 * share[worst]:.2g} % of it (whitened); {remedy}."
        )
    return Check(name, passed, value, "p-value", True, sentence)


def _whiteness(residuals):
    if residuals is None:
        return _diverged("whiteness", decides=False)
    p, share = residuals.p_values["whiteness"], residuals.shares["whiteness"]
    value = _bonferroni(p)
    passed = value >= residuals.level
    if passed:
        sentence = "The residual is white, as white measurement noise is."
    else:
        worst = int(p.argmin())
        sentence = (
            f"The residual of {residuals.output_names[worst]} is colored: its past "
            f"explains {100 * share[worst]:.2g} % of it. The residual of a free run "
            "has the color of the noise: reported only, independence decides."
        )
    return Check("whiteness", passed, value, "p-value", False, sentence)


def _free_run(experiments, outputs):
    y, y_hat = (np.vstack([e[i] for e in experiments]) for i in (1, 2))
    fit = np.full(y.shape[1], -np.inf)
    if np.isfinite(y_hat).all():
        fit = fit_percent(y, y_hat, multioutput="raw_values")
    worst = int(fit.argmin())
    passed = bool(fit[worst] > 0)
    if passed:
        sentence = f"The free run follows {outputs[worst]}, its worst output."
    else:
        sentence = f"The free run predicts {outputs[worst]} no better than its mean."
    return Check("free run", passed, float(fit[worst]), "fit, %,", True, sentence)


def _ahead(ahead, problem, outputs):
    if ahead is None:
        return Check("predictions", False, np.nan, "fit, %,", False, problem)
    worst = int(ahead.fit[-1].argmin())
    fit, last = ahead.fit[:, worst], ahead.last_value[:, worst]
    wins = fit > last
    curve = ", ".join(f"{k}: {a:.3g}" for k, a in zip(ahead.horizons, fit, strict=True))
    sentence = f"Fit of {outputs[worst]} in % by samples ahead, {curve}; "
    if wins.all():
        sentence += "the last value is a worse guess at all of them."
    else:
        horizon = ahead.horizons[np.flatnonzero(~wins)]
        listed = ", ".join(map(str, horizon))
        sentence += f"the last value is as good a guess {listed} ahead."
    passed = bool(wins[-1])
    return Check("predictions", passed, float(fit[-1]), "fit, %,", False, sentence)


def _extrapolation(linear):
    outside = float("nan") if linear.outside is None else float(linear.outside)
    passed = bool(outside <= OUTSIDE)
    sentence = f"{100 * outside:.2g} % of the record lies outside the training region"
    sentence += (
        "." if passed else ": there the model is a guess, train on such data as well."
    )
    return Check("extrapolation", passed, outside, "share", True, sentence)


def _linear(linear, within, decides):
    error = float(np.max(linear.linearization_error))
    passed = bool(error <= within and linear.spectral_radius < 1 and not linear.no_law)
    share = f"{100 * error:.2g} % of the output"
    if linear.no_law:
        sentence = f"There is no loop to judge. {linear.no_law}"
    elif linear.spectral_radius >= 1:
        sentence = (
            f"A has the spectral radius {linear.spectral_radius:.4g}: the linear part "
            "needs a controller that stabilizes it."
        )
    elif passed:
        sentence = f"All but {share} is the response of (A, B, C) once h is cancelled."
    else:
        sentence = (
            f"{share} is not the response of (A, B, C) once h is cancelled: a linear "
            "design takes it for a disturbance."
        )
    if not decides:
        sentence += " This model was not made for control: reported only."
    return Check("linearizability", passed, error, "rms(e) / std(y)", decides, sentence)

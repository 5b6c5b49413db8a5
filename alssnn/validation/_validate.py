"""The checks of a model on a record, and their words."""

from dataclasses import replace
from functools import partial

import numpy as np

from ..checks import FINISHED, noise_levels
from ..linearizability import OUTSIDE, is_unstable, judge, percent, worst_error
from ..metrics import free_run_errors, missed_percent
from ..plants import as_plant
from ._ahead import ahead_fit
from ._closed_loop import feedback_check, in_closed_loop
from ._feedback import feedback_tests
from ._lags import choose_lags
from ._predicted import judged_experiments, predicts, sent_experiments, share_outside
from ._record import Check, Validation
from ._residuals import AUTO, BLOCKS, check_options, residual_tests
from ._scored import (
    column_names,
    count_estimated,
    moved_names,
    scored_experiments,
    surely_outside,
)

LEAST = 20  # samples of which a verdict can be given
WORSE = 3.0  # error of the free run over that in training from which it is too much,
NOTABLE = 90.0  # if the fit is below this, in percent
EXPLAINED = 0.5  # share of a residual that u explains, from which errors of parameters
MATTERS = 0.05  # are no excuse if it is as much as this of the output;
PREDICTED = 0.25  # they are none either for as much as this of the output
OWN = 0.1  # of it, what a block has to add to those before it

WHITE = "The residual is white, as white measurement noise is."  # of an exact model
LIKE_WHITE = "The residual has no color but that of errors of the parameters."
MEANING = {  # of a block: what it is, what is missing, and with those before it
    "independence": (
        "lags of u",
        "dynamics are missing: raise `nx`, or check `input_delay`",
        "they",
    ),
    "squares": (
        "squares and products of the signals",
        "an even nonlinearity is missing: add networks or neurons",
        "they and lags of u",
    ),
    "cubes": (
        "cubes of the signals",
        "an odd nonlinearity is missing: add networks or neurons",
        "they and lags of u and squares",
    ),
}


def validate(
    model,
    u,
    y,
    experiment=None,
    *,
    level=0.01,
    n_lags="auto",
    horizons=(1, 2, 5, 10, 20, 50),
    linear_within=0.05,
    exact=False,
    baseline=None,
    noise_floor=None,
    law_dt=None,
    ahead=False,
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
        Probability of a false alarm of the three deciding tests of residuals together,
        of the test of whiteness, and of that of feedback.
    n_lags : int or "auto", default="auto"
        Number of lags of the tests, in samples; "auto" takes 25, or as many as a
        shorter record bears, at least 4. Where it does not bear these beside the
        parameters, a test that finds nothing of exact parameters passes, and another
        is undecided unless the dependence is too large for errors of parameters.
    horizons : sequence of int, default=(1, 2, 5, 10, 20, 50)
        Samples ahead at which predictions are compared.
    linear_within : float, default=0.05
        Share rms(e) / std(y) up to which the model counts as linearizable, in open and
        in closed loop.
    exact : bool, default=False
        Whether the tests of residuals take the parameters for exact. By default, what
        other values of the parameters would explain to first order is no fault, so
        that a right structure passes whose parameters have errors; with True it is,
        which finds a plant that has changed since the training.
    baseline : estimator or None, default=None
        Linear model fitted to the same data, with the same `n_init_samples` and
        `noise`: the free run may miss at most 10 % more than this model. None compares
        with the mean.
    noise_floor : float, array_like of shape (ny,), or object or None, default=None
        Root mean squares, in the units of the outputs, that no model goes below; what
        `look` or `nonparametric.best_linear_approximation` return of a periodic record.
        One more check then says how far above them the free run is; it does not decide.
    law_dt : float or None, default=None
        Sampling time of the law, in seconds, for "linearizability"; None: the record's.
    ahead : bool, default=False
        Whether this law looks half a sample ahead (eq. middle).

    Returns
    -------
    validation : Validation
        The checks and what they rest on; it prints as a table.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If an option is out of range or the record is too short for the given lags.

    Notes
    -----
    The p-value of a deciding test is the smallest one of the outputs times their number
    times three, the number of these tests (Bonferroni); that of whiteness is only
    multiplied by the number of outputs. It decides for ``noise="innovations"``, whose
    tests are those of the errors one sample ahead.
    Costs six simulations, one pass of an observer, and unless `exact` one of the
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
            f"`linear_within` must be a positive share of y, got {linear_within}."
        )
    experiments, _ = scored_experiments(model, u, y, experiment)
    n = sum(
        int(np.isfinite(measured).any(axis=1).sum()) for _, measured, _ in experiments
    )
    if n < LEAST:
        raise ValueError(
            f"`y` must have at least {LEAST} measured samples behind those that "
            f"estimate the initial states, got {n}. A verdict needs a longer record."
        )
    inputs, outputs = column_names(model)
    floor = noise_levels(noise_floor, len(outputs))
    linear = model.linearizability(u, y, experiment, law_dt=law_dt, ahead=ahead)
    named = {"input_names": inputs, "output_names": outputs, "dt": model.dt}
    tested, residuals, feedback, doubt = _tests(
        model, u, y, experiment, exact, n_lags=n_lags, level=level, **named
    )
    ahead, problem = None, ""
    try:
        ahead = ahead_fit(model, u, y, experiment, horizons=horizons)
    except ValueError as error:
        if "horizons" in str(error):
            raise
        problem = str(error)
    if baseline is not None:
        baseline, _ = scored_experiments(baseline, u, y, experiment)
    free_run = _free_run(model, experiments, outputs, baseline)
    missed = 1 - _fits(tested or experiments) / 100
    outside, surely = linear.outside, partial(surely_outside, model, u, y, experiment)
    if predicts(model):
        drifts = as_plant(model).drift is not None
        free_run = _noisy_run(linear, free_run, missed, drifts)
    if tested and not free_run.decides and outside is not None:
        predicted = partial(share_outside, model, u, y, experiment)
        outside, surely = predicted(), partial(predicted, surely=True)
    blocks = [_block(residuals, name, missed, doubt) for name in BLOCKS]
    whiteness = _whiteness(residuals, missed, doubt)
    part = 0.0 if whiteness.passed else _color(residuals, missed)
    part = part if part > MATTERS else 0.0
    checks = (  # by weight
        free_run,
        _extrapolation(outside, surely),
        _linear(linear, linear_within, model.fitted_.for_control, free_run, missed),
        *in_closed_loop(blocks, feedback, level, predicts(model), part),
        _ahead(ahead, problem, outputs),
        whiteness,
        feedback_check(feedback, level, predicts(model), doubt),
        *_floor(experiments, outputs, floor),
    )
    return Validation(checks, residuals, ahead, linear, type(model).__name__, feedback)


def _tests(model, u, y, experiment, exact, **named):
    """Return what is tested, both kinds of tests, and what a record leaves open."""
    try:
        tested, options = judged_experiments(model, u, y, experiment, exact=exact)
    except ValueError as error:  # no stable predictor
        return [], None, None, str(error)
    if not all(np.isfinite(y_hat).all() for _, _, y_hat in tested):
        return tested, None, None, ""
    residuals, doubt = _tested(tested, **named, **options)
    return tested, residuals, _fed_back(model, u, y, experiment, tested), doubt


def _tested(experiments, sensitivities, n_lags, ahead, **options):
    """Return the tests of residuals, and what a short record leaves open."""
    doubt = ""
    if n_lags == AUTO:
        n_free = count_estimated(sensitivities)
        n_lags = choose_lags(experiments, n_free, ahead)
        if n_lags == 0 and n_free:
            n_lags, sensitivities = choose_lags(experiments, 0, ahead), None
            doubt = f"The record is too short for a model of {n_free} parameters"
        if n_lags == 0:
            return None, "The record is too short for tests of residuals."
    tests = residual_tests(
        experiments, sensitivities=sensitivities, n_lags=n_lags, ahead=ahead, **options
    )
    return tests, doubt


def _fed_back(model, u, y, experiment, tested):
    """Return the tests of feedback: of the inputs as they were sent."""
    sent, simulated = zip(*sent_experiments(model, u, y, experiment), strict=True)
    plant = as_plant(model).arrived()
    known = all(np.isfinite(y_hat).all() for y_hat in simulated)
    return feedback_tests(
        [(u_i, *pair) for u_i, (_, *pair) in zip(sent, tested, strict=True)],
        moved=plant.moved,
        input_names=moved_names(model),
        simulated=simulated if known else None,
        ahead=predicts(model),
        direct=not plant.feeds_through,
    )


def _bonferroni(p, n_tests=1):
    return float(min(1.0, n_tests * len(p) * p.min()))


def _untested(name, doubt, decides=True):
    sentence = doubt or "The free run diverges: there is no residual to test."
    return Check(name, False, np.nan, "p-value", decides, sentence, bool(doubt))


def _block(residuals, name, missed, doubt=""):
    if residuals is None:
        return _untested(name, doubt)
    p, share = residuals.p_values[name], residuals.shares[name]
    worst = int(p.argmin())
    value = _bonferroni(p, len(BLOCKS))  # `level` is that of all of them together
    noun, past = "residual", "lags of u"
    if residuals.ahead:
        noun, past = "error one sample ahead", "lags of u and y"
    what, remedy, together = (z.replace("lags of u", past) for z in MEANING[name])
    found = np.array([residuals.explained[block] for block in BLOCKS])
    i = BLOCKS.index(name)
    explained = found[: i + 1].sum(axis=0)  # with the blocks before
    part = np.sqrt(explained) * missed
    large = (explained > EXPLAINED) & (part > MATTERS) | (part > PREDICTED)
    large &= found[i] > OWN
    size = (
        f"On samples left out {together} predict {percent(explained.max())} of the "
        f"{noun}, {percent(part.max())} of the output."
    )
    passed = undecided = False
    if np.any(large):
        worst = int(np.argmax(np.where(large, part, 0.0)))
        sentence = (
            f"{what.capitalize()} predict {percent(explained[worst])} of the {noun} "
            f"of {residuals.output_names[worst]} on samples left out, "
            f"{percent(part[worst])} of the output: too much for errors of the "
            f"parameters; {remedy}, or refit."
        )
    elif value >= residuals.level:
        passed = True
        beyond = " beyond errors of the parameters" if residuals.n_parameters else ""
        sentence = f"The {noun} does not depend on {what}{beyond}. {size}"
    elif doubt:
        undecided = True
        sentence = (
            f"{doubt}: the {noun} of {residuals.output_names[worst]} depends on "
            f"{what}, but errors of the parameters may be all of it. {size}"
        )
    else:
        whitened = "" if residuals.ahead else " (whitened)"
        sentence = (
            f"The {noun} of {residuals.output_names[worst]} depends on {what}, which "
            f"explain {percent(share[worst])} of it{whitened}; {remedy}. {size}"
        )
    return Check(name, passed, value, "p-value", True, sentence, undecided)


def _whiteness(residuals, missed, doubt=""):
    if residuals is None:
        return _untested("whiteness", doubt, decides=False)
    p, share = residuals.p_values["whiteness"], residuals.shares["whiteness"]
    value, worst = _bonferroni(p), int(p.argmin())
    passed = value >= residuals.level
    name, explained = residuals.output_names[worst], percent(share[worst])
    undecided = residuals.ahead and bool(doubt) and not passed
    if passed and residuals.ahead:
        sentence = "The error one sample ahead is white: its past tells nothing."
    elif passed:
        sentence = LIKE_WHITE if residuals.n_parameters else WHITE
    elif undecided:
        sentence = (
            f"{doubt}: the error one sample ahead of {name} is colored, but errors "
            "of the parameters may be all of it."
        )
    elif residuals.ahead:
        sentence = (
            f"The error one sample ahead of {name} is colored: its past explains "
            f"{explained} of it. Dynamics or the color of the noise are missing: "
            "raise `nx`."
        )
    else:
        sentence = (
            f"The residual of {name} is colored: its past explains {explained} of it. "
            "This is no fault of a free run, whose residual has the color of the "
            "noise: independence decides."
        )
        part = _color(residuals, missed)
        if part > MATTERS and share.max() > EXPLAINED:
            sentence += (
                f" But this is {percent(part)} of the output: if it is noise of the "
                "process, not of the sensor, the model is biased by it. Compare with "
                "noise='innovations'."
            )
    decides = residuals.ahead
    return Check("whiteness", passed, value, "p-value", decides, sentence, undecided)


def _color(residuals, missed):
    """Return how much of an output the past of its residual tells."""
    if residuals is None:
        return 0.0
    return float(np.max(np.sqrt(np.maximum(residuals.shares["whiteness"], 0)) * missed))


# -- the free run and predictions ------------------------------------------------------


def _free_run(model, experiments, outputs, baseline):
    fit = _fits(experiments)
    worst = int(fit.argmin())
    name, value = outputs[worst], float(fit[worst])
    trained = 100 - missed_percent(model.train_score_)  # nan: unknown
    passed, sentence = False, f"The free run misses {_missed(value)} of {name}"
    if baseline is None:
        linear = np.full_like(fit, np.nan)
        beside = "The mean of the output misses all of it"
    else:
        linear = _fits(baseline)
        beside = f"The linear model misses {_missed(linear[worst])}"
    if not value > 0:
        sentence = (
            f"The free run predicts {name} no better than its mean: the model is of no "
            "use on this record."
        )
    elif np.any(fit < linear - 0.1 * (100 - linear)):
        worse = int(np.argmax((100 - fit) / np.maximum(100 - linear, 1e-12)))
        sentence = (
            f"The free run misses {_missed(fit[worse])} of {outputs[worse]}, the "
            f"linear model {_missed(linear[worse])}. Use the linear model."
        )
    elif value < NOTABLE and 100 - value > WORSE * (100 - trained):
        sentence += (
            f", but {_missed(trained)} of the training record: unless this record is "
            "much noisier, the model does not hold beyond its training. Train on more "
            "data, or with fewer neurons or states."
        )
    else:
        passed = True
        sentence += f", its worst output. {beside}"
        if np.isfinite(trained):
            sentence += f"; in training the model missed {_missed(trained)}"
        sentence += "."
    return Check("free run", passed, value, "fit, %,", True, sentence)


def _floor(experiments, outputs, floor):
    """Return the check of the free run against the noise; none if that is unknown."""
    if floor is None:
        return ()
    ratio = _errors(experiments)[0] / floor
    worst = int(ratio.argmax())
    value, name = float(ratio[worst]), outputs[worst]
    sentence = f"The error of the free run is {value:.3g} times the noise of {name}"
    if value < 1 / FINISHED:
        sentence += ", less than a model can be: this record has less noise."
    elif value <= FINISHED:
        sentence += ": nothing is left to learn."
    else:
        sentence += f": {percent(1 - value**-2)} of its square can still be learnt."
    return (
        Check("noise floor", value <= FINISHED, value, "RMSE / floor", False, sentence),
    )


def _noisy_run(linear, check, missed, drifts):
    """Return the check of a free run that is not told the noise of the process."""
    radius, worst = linear.spectral_radius, percent(np.max(missed))
    if check.passed or (radius < 1 and not drifts):
        sentence = (
            f"{check.sentence} A free run does not know the noise of the process: one "
            f"sample ahead the model misses {worst}."
        )
        return replace(check, sentence=sentence)
    why = "No free run knows what drifts, and this one is reported only."
    if radius >= 1:
        how = "is unstable" if is_unstable(linear) else "integrates"
        why = (
            f"A {how}, spectral radius {radius:.4g}: noise makes every free run leave "
            "the record, and this one is reported only."
        )
    sentence = f"{why} One sample ahead the model misses {worst}."
    return replace(check, decides=False, sentence=sentence)


def _fits(experiments):
    """Return the fit of every output in percent, -inf where the run diverges."""
    return _errors(experiments)[1]


def _errors(experiments):
    """Return RMSE and fit of every output over all experiments."""
    _, y, y_hat = zip(*experiments, strict=True)
    return free_run_errors(np.vstack(y), np.vstack(y_hat))


def _missed(fit):
    """Return what a fit in percent misses, in words."""
    return percent(1 - fit / 100)


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


def _extrapolation(outside, surely):
    outside = np.nan if outside is None else float(outside)
    passed, undecided = bool(outside <= OUTSIDE), False
    sentence = f"{percent(outside)} of the record lies outside the training region"
    if passed:
        sentence += "."
    elif outside > OUTSIDE >= surely():
        undecided = True
        sentence += (
            ", but the training record is short for such slow signals, and another one "
            "of the same kind might do so, too: train on a longer record."
        )
    else:
        sentence += ": there the model is a guess, train on such data as well."
    return Check("extrapolation", passed, outside, "share", True, sentence, undecided)


def _linear(linear, within, decides, free_run, missed):
    fit = free_run.value if free_run.decides else 100 * (1 - float(np.max(missed)))
    passed, sentence = judge(linear, within, fit)
    if not decides:
        sentence += " This model was not made for control: reported only."
    elif not free_run.decides and is_unstable(linear):
        decides = False
        sentence += (
            " No free run tells how linear it is then, and this is reported only: "
            "compare `closed_loop` of the model with `designed_loop`."
        )
    value = worst_error(linear)
    return Check(
        "linearizability", passed, value, "linearization error", decides, sentence
    )

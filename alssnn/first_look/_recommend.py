"""What to begin with, and why: trial fits against each other and against rivals."""

from dataclasses import dataclass, field, replace

import numpy as np

from ..estimators import LinearStateSpace
from ..regression import complete, lagged
from ..shown import percent
from ..validation import feedback_tests
from ._rivals import curve, hysteresis, mirror, varying_delay
from ._trials import LITTLE, MONOTONE, NEAR, USEFUL, Parts, trial, with_options

LEVEL = 0.05  # of the test for nonlinearity
NEAR_FLOOR = 1.05  # error of a linear model over the noise from which it is enough
SHORT = 200  # samples of all experiments, below which networks learn the noise
PAYS = 0.9  # error with an option over that without, from which it is real
AS_GOOD = 1.1  # the same of delays that take the place of states,
SAVED = 2  # so many of them: one alone may be that of a lag of high order
MUCH = 0.5  # error of a rival over that of the best model, from which it is right
MIRRORED = 0.02  # error of an input as a curve of the outputs of the same sample
WANDERS = 1.5  # standard deviation of a delay that varies, in samples
FED_BACK = 1e-3  # level of the test for feedback,
FED_SHARE = 0.01  # and share of an input that noise moves, from which it matters,
FORESEEN = 1e-4  # unless the past of the input foretells all but this share of it,
OWN_LAGS = 20  # samples of it
LARGEST = 6  # states of small networks; those of a linear model may be more
LINEAR = "No nonlinearity was found."


@dataclass(frozen=True)
class Recommendation:
    """Say which estimator to begin with, with which options, and why.

    Parameters
    ----------
    estimator : type or None
        Estimator; None if no model of this package fits, or the record cannot tell.
    options : dict
        Options of the estimator that the record asks for.
    reason : str
        Why, in a sentence.
    linear_rms : ndarray of shape (ny,) or None
        Root mean square error of a linear model along the whole record, of every
        output, in its unit; inf if it diverges, nan where nothing was measured, None
        if none was tried.

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(1500, noise=0.01, random_state=0)
    >>> wanted = alssnn.look(record.u, record.y, dt=record.dt).recommendation
    >>> print(wanted)
    FlSsnn(feedback='state', dt=0.05)
    >>> model = wanted.estimator(**wanted.options)
    """

    estimator: type | None
    options: dict = field(default_factory=dict)
    reason: str = ""
    linear_rms: np.ndarray | None = field(default=None, repr=False, compare=False)

    def __bool__(self):
        """Tell whether there is a model to begin with."""
        return self.estimator is not None

    def __str__(self):
        """Return the estimator with its options, as one would write it."""
        if self.estimator is None:
            return "no model of this package"
        options = ", ".join(f"{k}={v!r}" for k, v in self.options.items())
        return f"{self.estimator.__name__}({options})"


def recommend(records, delays, p, response, dt, period=None):
    """Recommend what to begin with (eq. rivals).

    Parameters
    ----------
    records : Records
        Record.
    delays : ndarray of int of shape (nu,), or None
        Samples by which inputs seem to arrive late; None if a signal is at rest.
    p : float
        How likely a linear plant gives such a record; nan if it cannot tell.
    response : BestLinearApproximation or None
        Frequency response, if there is one.
    dt : float
        Sampling time, in seconds.
    period : int or None, default=None
        Samples of a period of a periodic record.

    Returns
    -------
    recommendation : Recommendation
        Estimator, options and reason.
    """
    given = {} if dt == 1.0 else {"dt": dt}
    n_samples, is_linear = len(records.u), p >= LEVEL
    if delays is None:
        return _none(_what_rests(records))
    if np.isnan(p):
        return _none(_too_few(records))
    if n_samples < SHORT and not is_linear:
        return _none(
            f"The plant is nonlinear, and {n_samples} samples are too few for "
            "networks: record more."
        )
    if n_samples < SHORT:
        return Recommendation(LinearStateSpace, given, LINEAR)
    parts = Parts.of(records)
    if not any(np.isfinite(y).any() for _, y in parts.hidden):
        return _none("No hidden sample was measured.")
    linear, why = _linear(parts, delays), LINEAR
    fits = [linear]
    if not is_linear and _is_near_floor(response):
        why = "A linear model comes within 5 % of the noise."
    elif not is_linear:
        fits, why = _with_networks(parts, linear, records.ny), ""
    best = min(fits, key=lambda fit: fit.error)
    rival = _rival(parts, delays, best.error, is_linear)
    if not rival:
        rival = _wandering(parts, best.error)
        # a controller answers to the output, and so inputs to come tell of it
        rival = "" if rival and _is_fed_back(parts, best, period) else rival
    chosen = _none(rival) if rival else _chosen(parts, fits, best, why, given, period)
    return replace(chosen, linear_rms=_rms(linear.model, records))


def _rms(model, records):
    """Return the error of every output along the record; inf if it diverges."""
    pairs = [model.simulate_test(u, y) for u, y in records.pairs]
    y, y_hat = (np.vstack(z) for z in zip(*pairs, strict=True))
    if not np.isfinite(y_hat).all():
        return np.full(y.shape[1], np.inf)
    with np.errstate(invalid="ignore"):  # nan where nothing was measured
        mean = np.nansum((y - y_hat) ** 2, axis=0) / np.isfinite(y).sum(axis=0)
    return np.sqrt(mean)


def _chosen(parts, fits, best, why, given, period):
    """Return what to begin with, of some trials; `why` is empty if networks compete."""
    near = max(NEAR * best.error, LITTLE * fits[0].error)
    near = near if best.error < USEFUL else np.inf
    chosen = next(fit for fit in fits if fit.error <= near)
    options, sentences = {**chosen.options, **given}, [why or _why(fits, chosen)]
    if _is_fed_back(parts, best, period):
        options["noise"] = "innovations"
        sentences.append("Noise of the outputs moves the inputs: a loop was closed.")
    if chosen.name == "AL" and not chosen.options:  # a monotone map needs u in time
        bent = trial(parts, "h(y)", _orders(fits[0], len(parts.spread)), **MONOTONE)
        if bent.error <= NEAR * best.error:
            tried = Recommendation(type(bent.model), {**bent.options, **given})
            sentences.append(
                f"A curve that the input goes through does as well: compare {tried}."
            )
    return Recommendation(type(chosen.model), options, " ".join(sentences))


def _none(reason):
    """Return that no model of this package is the one to begin with."""
    return Recommendation(None, {}, reason)


def _what_rests(records):
    """Say which columns are at rest, or were never measured."""
    names = [*records.input_names, *records.output_names]
    still = ", ".join(np.compress(records.rests, names))
    return (
        f"At rest: {still}; nothing can be learned of it. Leave it out, or record it "
        "while it moves."
    )


def _too_few(records):
    """Say of which samples there are too few."""
    whole = np.isfinite(records.y).all(axis=1)
    n, n_whole = len(whole), whole.sum()
    if n_whole < n:
        return (
            f"Too few samples have all outputs measured, {n_whole} of {n}, or too few "
            "of them in a row: leave out an output that is seldom measured, or record "
            "more."
        )
    return "There are too few samples: record more."


def _is_near_floor(response):
    """Tell whether a linear model comes within 5 % of the noise."""
    if response is None or not np.isfinite(response.noise_rms).all():
        return False
    return bool(np.all(response.total_rms <= NEAR_FLOOR * response.noise_rms))


def _linear(parts, delays):
    """Return the linear trial, with the options that make it better, or smaller.

    A delay may hide in states; then h and g see more of them than the plant has.
    """
    best = trial(parts, "linear")
    direct = trial(parts, "linear", feedthrough=True)
    if direct.error < PAYS * best.error:
        best = direct
    # a fit takes no delay as long as an experiment
    if delays.any() and delays.max() < min(len(u) for u, _ in parts.train):
        late = trial(parts, "linear", input_delay=delays.tolist())
        takes_place = best.model.nx_ - late.model.nx_ >= SAVED
        if late.error < (AS_GOOD if takes_place else PAYS) * best.error:
            best = late
    return best


def _with_networks(parts, linear, ny):
    """Return trials of all families that have the options of the linear one."""
    names, orders = with_options(linear.options), _orders(linear, ny)
    return [linear, *(trial(parts, n, orders, **linear.options) for n in names)]


def _orders(linear, ny):
    """Return orders to try: what bends looks like many states to a linear model."""
    return sorted({max(2, ny), max(2, min(linear.model.nx_, LARGEST))})


def _why(fits, chosen):
    """Say what the trial fits left of hidden outputs."""
    left = ", ".join(f"{fit.name} {percent(100 * fit.error)}" for fit in fits)
    if chosen.name == "linear":
        return (
            "Small models with networks are hardly better on hidden samples (errors: "
            f"{left} of the output)."
        )
    return (
        f"It is the simplest of the small models that come near the best one on hidden "
        f"samples (errors: {left} of the output)."
    )


def _rival(parts, delays, least, is_linear):
    """Return what describes the record better than any model; empty if nothing does."""
    if not is_linear:
        error = curve(parts, delays)
        if error <= min(NEAR * least, USEFUL):
            return (
                "A curve of the inputs without any dynamics leaves "
                f"{percent(100 * error)} of the output, the best small model "
                f"{percent(100 * least)}: fit a curve, or sample faster."
            )
        error = hysteresis(parts, delays)
        if error <= min(MUCH * least, USEFUL):
            return (
                f"Play operators (hysteresis) leave {percent(100 * error)} of the "
                f"output, the best small model {percent(100 * least)}: use a model of "
                "hysteresis, such as that of Prandtl and Ishlinskii."
            )
    error = mirror(parts)
    if error < MIRRORED:
        return (
            f"Inputs and outputs of a sample follow from each other, up to "
            f"{percent(100 * error)}: the plant has no dynamics, or nothing but a "
            "controller moves it. Fit a curve, or move the reference while recording."
        )
    return ""


def _wandering(parts, least):
    """Say that the delay varies, if that is much better than any model."""
    fixed, moving, spread = varying_delay(parts)
    if moving <= min(MUCH * fixed, least / NEAR) and spread > WANDERS:
        return (
            f"The delay varies by {spread:.2g} samples rms: a linear response with a "
            f"delay of its own in every window leaves {percent(100 * moving)} of the "
            f"output, the best small model {percent(100 * least)}. Models here have a "
            "fixed delay; make it constant, or measure what it depends on."
        )
    return ""


def _is_fed_back(parts, fit, period):
    """Tell whether noise of the outputs moves an input (eq. fedback)."""
    runs = []
    for u, y, _ in parts.pieces:
        y_hat = fit.model.simulate_test(u, y)[1]
        runs.append((u[-len(y_hat) :], y[-len(y_hat) :], y_hat))
    if not all(np.isfinite(y_hat).all() for _, _, y_hat in runs):
        return False
    tests = feedback_tests(
        runs,
        simulated=[y_hat for _, _, y_hat in runs],
        direct="feedthrough" not in fit.options,
        period=period,
    )
    if tests is None:
        return False
    moved = tests.found(FED_BACK) & (tests.shares > FED_SHARE)
    return bool((moved.any(axis=1) & (_surprise(parts) > FORESEEN)).any())


def _surprise(parts):
    """Return which share of the inputs their own past does not foretell."""
    rows = [
        np.hstack([u, lagged(u, range(1, OWN_LAGS + 1)), np.ones((len(u), 1))])
        for u, _, _ in parts.pieces
    ]
    data = np.concatenate(list(complete(rows)))
    nu = len(data.T) // (OWN_LAGS + 1)
    u, X = data[:, :nu], data[:, nu:]
    left = u - X @ np.linalg.lstsq(X, u)[0]
    return left.var(axis=0) / np.maximum(u.var(axis=0), 1e-300)

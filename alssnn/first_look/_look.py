"""The page: all questions, in the order in which they matter."""

import numpy as np

from ..checks import sampling_time
from ..delays import estimate_delays
from ..excitation import Excitation
from ..nonparametric import best_linear_approximation, local_polynomial
from ..nonparametric.records import Records
from ..periods import repeated
from ..shown import percent
from . import _signals
from ._findings import Finding, FirstLook
from ._nonlinearity import arrived, nonlinearity, scaled
from ._recommend import LEVEL, SHORT, recommend

MATTERS = 0.05  # what is not linear, relative to the output, from which it is seen
FEW, MANY = 6.0, 60.0  # samples in a period of the fastest motion
MOTION = 0.99  # share of the power of the output that belongs to the plant
MAX_DELAY = 50  # samples


def look(u, y, experiment=None, *, dt=None, period=None, recommends=True):
    """Look at a record before anything is fitted.

    Parameters
    ----------
    u : array_like of shape (N, nu) or (N,), list of them, or Excitation
        Inputs of all experiments.
    y : array_like of shape (N, ny) or (N,), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    dt : float or None, default=None
        Sampling time, in seconds; None means that of the excitation, or 1.
    period : int or None, default=None
        Samples of a period of a periodic record; None means that of an excitation of
        at least three periods, or that there is none.
    recommends : bool, default=True
        Whether small models are tried, to recommend one.

    Returns
    -------
    page : FirstLook
        Findings "record", "gaps", "saturation", "quantization", "outliers", "inputs",
        "delay", "nonlinearity", "accuracy", "sampling" and "model"; print it to read
        it. Its `recommendation` is the model to begin with (eq. rivals), None if not
        asked for.

    Raises
    ------
    ValueError
        If the signals are no records, or do not fit each other.

    Notes
    -----
    Of a periodic record nonlinearity and accuracy are those of
    `nonparametric.best_linear_approximation`; of others the test (eq. reset) and
    `nonparametric.local_polynomial`, which cannot tell noise from distortion, but for
    the noise of experiments that had the same input (eq. repeats). The first period
    counts as transient then.

    Costs some linear fits of 5,000 samples for the delay, and for the recommendation
    some small fits of 2,000 samples: about 1 second if the plant is linear, 2 to 13 of
    nonlinear ones.

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(2000, noise=0.01, random_state=0)
    >>> page = alssnn.look(record.u, record.y, dt=record.dt)
    >>> page["nonlinearity"].attention
    True
    """
    if isinstance(u, Excitation):
        dt = u.dt if dt is None else dt
        period = u.period if period is None and u.n_periods > 2 else period
    dt = 1.0 if dt is None else sampling_time(dt)
    records = Records.of(u, y, experiment)
    response, why = _response(records, u, y, experiment, dt, period)
    delays = _delays(records)
    p_value, _ = nonlinearity(*arrived(records.pairs, delays))
    not_linear = _nonlinearity(p_value, response)
    wanted = None
    if recommends:
        wanted = recommend(records, delays, not_linear.value, response, dt, period)
    findings = [
        _record(records, dt),
        _signals.gaps(records),
        _signals.saturation(records),
        _signals.quantization(records),
        _signals.outliers(records),
        _signals.inputs(records),
        _delay(records, delays),
        not_linear,
        _accuracy(response, why, getattr(wanted, "linear_rms", None)),
        _sampling(response, dt),
    ]
    if wanted is not None:
        findings.append(_model(wanted))
    known = response is not None and np.isfinite(response.noise_rms).all()
    return FirstLook(tuple(findings), response.noise_rms if known else None, wanted)


def _response(records, u, y, experiment, dt, period):
    """Return the frequency response, or None and why there is none."""
    rests = records.rests[records.nu :]
    if rests.any():
        names = np.compress(rests, records.output_names)
        return None, f"at rest, or never measured: {', '.join(names)}."
    try:
        if period is not None:
            return best_linear_approximation(u, y, experiment, dt=dt, period=period), ""
        return local_polynomial(u, y, experiment, dt=dt), ""
    except ValueError as error:
        return None, str(error)


def _record(records, dt):
    """Say what there is."""
    N, parts = len(records.u), len(records.pairs)
    sentence = (
        f"{N} samples of {records.nu} inputs and {records.ny} outputs in {parts} "
        f"experiment{'s' if parts > 1 else ''}, {N * dt:.4g} s in all."
    )
    copies = parts - len(repeated([u for u, _ in records.pairs]))
    if copies:
        sentence += f" Experiments that repeat the input of another one: {copies}."
    if N < SHORT:
        sentence += " That is little: networks need hundreds of samples at least."
    return Finding("record", float(N), sentence, N < SHORT)


def _delays(records):
    """Return the delays of the inputs; None if a signal is at rest."""
    if records.rests.any():
        return None
    return estimate_delays(scaled(records.pairs), "auto", max_delay=MAX_DELAY)


def _delay(records, delays):
    """Ask whether inputs are late."""
    if delays is None:
        return Finding(
            "delay", np.nan, "A signal is at rest: no delay was found.", True
        )
    worst = float(delays.max())
    late = [
        f"{name} by {d}"
        for name, d in zip(records.input_names, delays, strict=True)
        if d
    ]
    if not late:
        return Finding("delay", 0.0, "No input is late by more than one sample.", False)
    return Finding(
        "delay",
        worst,
        f"Inputs seem to arrive late, beyond one sample: {', '.join(late)} samples; a "
        "slow start looks alike. Compare fits with and without "
        f"input_delay={delays.tolist()}.",
        True,
    )


def _nonlinearity(p, response):
    """Ask whether the plant is nonlinear."""
    if response is not None and np.isfinite(response.p_linear):
        p, what = response.p_linear, "the spread between realizations"
    else:
        what = "squares and cubes of a linear prediction"
    if np.isnan(p):
        sentence = "Too few samples to test whether the plant is nonlinear."
        return Finding("nonlinearity", np.nan, sentence, False)
    verdict = "is nonlinear" if p < LEVEL else "shows no nonlinearity"
    sentence = f"The plant {verdict}, by {what} (p = {p:.2g})."
    if p < LEVEL:
        sentence += " Whether that matters is said by the accuracy."
    return Finding("nonlinearity", float(p), sentence, p < LEVEL)


def _model(wanted):
    """Say what to begin with, and why."""
    begin = f"Begin with {wanted}" if wanted else "No model of this package"
    sentence = f"{begin}. {wanted.reason}"
    return Finding("model", float(bool(wanted)), sentence, not wanted)


def _accuracy(response, why, reached):
    """Say how accurate models can be; a linear one may have reached more."""
    if response is None:
        return Finding("accuracy", np.nan, f"Not told: {why}", True)
    names = response.output_names

    def rms(levels):
        return ", ".join(
            f"{level:.3g} of {name} ({percent(100 * level / max(size, 1e-300))})"
            for name, level, size in zip(
                names, levels, response.output_rms, strict=True
            )
        )

    # the levels are too high where a resonance is narrow
    left = response.total_rms
    left = left if reached is None else np.fmin(left, reached)
    left = np.fmax(left, response.noise_rms)
    share = float(np.max(left / np.maximum(response.output_rms, 1e-300)))
    sentence = f"Linear models leave about {rms(left)} rms or more"
    if np.isfinite(response.noise_rms).all():
        sentence += f", and any model about {rms(response.noise_rms)}."
    else:
        sentence += (
            "; what of it is noise, only periods or experiments with the same input "
            "can tell."
        )
    return Finding("accuracy", share, sentence, share > MATTERS)


def _sampling(response, dt):
    """Ask whether the sampling time fits the motion of the plant."""
    if response is None:
        return Finding(
            "sampling", np.nan, "Not told without a frequency response.", False
        )
    motion = np.nan_to_num(np.maximum(response.output**2 - response.total**2, 0.0))
    size = np.maximum(response.output_rms**2, 1e-300)
    power = np.cumsum(np.sum(motion / size, axis=1))
    if not power[-1] > 0:
        return Finding("sampling", np.nan, "No motion above the noise was found.", True)
    fastest = response.frequencies[np.searchsorted(power, MOTION * power[-1])]
    samples = float(1 / (fastest * dt))
    sentence = (
        f"99 % of the motion is below {fastest:.3g} Hz, where a period has "
        f"{samples:.3g} samples."
    )
    if samples > MANY:
        longer = samples / 20
        sentence += f" A sampling time {longer:.2g} times longer would do."
    if samples < FEW:
        sentence += " Sample faster, if the plant and not the noise moves so fast."
    return Finding("sampling", samples, sentence, not FEW <= samples <= MANY)

"""Steps, pseudorandom binary sequences, swept sines."""

import numpy as np
from sklearn.utils import check_random_state

from ..checks import check_option, count, sampling_time
from ._excitation import repeat
from ._limits import Limits, frequency_band, input_names

SWEPT = 0.4  # of the Nyquist frequency: five samples per period of the fastest sine
BITS = range(2, 21)  # registers of a sequence that fits into memory


def steps(
    n_samples,
    nu=1,
    *,
    dt=1.0,
    hold=None,
    low=-1.0,
    high=1.0,
    rate=None,
    operating_point=None,
    n_periods=1,
    n_realizations=1,
    names=None,
    random_state=None,
):
    """Make steps of random heights and lengths.

    Parameters
    ----------
    n_samples : int
        Samples of one period.
    nu : int, default=1
        Number of inputs; they step independently of each other.
    dt : float, default=1.0
        Sampling time, in seconds.
    hold : tuple of float or None, default=None
        Shortest and longest time between two steps, in seconds; None means 5 to 50
        samples. The longest should let the plant settle, and the shortest not.
    low : float or array_like of shape (nu,), default=-1.0
        Lowest values of the inputs.
    high : float or array_like of shape (nu,), default=1.0
        Highest values; the heights are uniform between both.
    rate : float, array_like of shape (nu,) or None, default=None
        Largest change in units per second; a step becomes a ramp.
    operating_point : float, array_like of shape (nu,) or None, default=None
        Level of the first hold; None means the middle of the limits.
    n_periods : int, default=1
        How often an experiment repeats its `n_samples`.
    n_realizations : int, default=1
        Independent draws, one experiment each.
    names : sequence of str or None, default=None
        Names of the inputs; None means u[0], u[1], ...
    random_state : int, RandomState instance or None, default=None
        Seed of heights and lengths.

    Returns
    -------
    excitation : Excitation
        The signal.

    Raises
    ------
    ValueError
        If an argument is out of range, or limits contradict each other.

    Examples
    --------
    >>> from alssnn.excitation import steps
    >>> excitation = steps(600, dt=0.1, hold=(1, 5), low=0, high=10, random_state=0)
    >>> excitation
    Excitation('steps', N=600, nu=1, dt=0.1 s, 1 experiments of 1 periods)
    """
    n_samples = count("n_samples", n_samples)
    nu, dt = count("nu", nu), sampling_time(dt)
    limits = Limits.of(nu, low, high, operating_point, rate)
    names = input_names(names, nu)
    shortest, longest = _hold(hold, dt)
    rng = check_random_state(random_state)
    n_realizations = count("n_realizations", n_realizations)
    u = np.empty((n_realizations, n_samples, nu))
    for m in range(n_realizations):
        for i in range(nu):
            n = n_samples // shortest + 1
            levels = rng.uniform(limits.low[i], limits.high[i], n)
            levels[0] = limits.operating_point[i]
            holds = rng.randint(shortest, longest + 1, n)
            u[m, :, i] = np.repeat(levels, holds)[:n_samples]
    u = limits.slew(u, dt, count("n_periods", n_periods))
    return repeat(u, dt, limits, n_periods, n_realizations, None, names, "steps")


def prbs(
    n_bits=9,
    nu=1,
    *,
    dt=1.0,
    hold=1,
    low=-1.0,
    high=1.0,
    rate=None,
    operating_point=None,
    n_periods=3,
    n_realizations=1,
    names=None,
    random_state=None,
):
    """Make pseudorandom binary sequences of maximum length.

    Parameters
    ----------
    n_bits : int, default=9
        Length of the shift register, 2 to 20; a period has (2**n_bits - 1) hold
        samples.
    nu : int, default=1
        Number of inputs: the same sequence, shifted by an equal part of the period from
        one to the next.
    dt : float, default=1.0
        Sampling time, in seconds.
    hold : int, default=1
        Samples of a bit.
    low : float or array_like of shape (nu,), default=-1.0
        Lowest values of the inputs.
    high : float or array_like of shape (nu,), default=1.0
        Highest values of the inputs.
    rate : float, array_like of shape (nu,) or None, default=None
        Largest change in units per second; a step becomes a ramp.
    operating_point : float, array_like of shape (nu,) or None, default=None
        Middle of the two levels, of which the nearer one is at its limit; None means
        the middle of the limits.
    n_periods : int, default=3
        Periods of every experiment.
    n_realizations : int, default=1
        Experiments, which start at random places of the sequence.
    names : sequence of str or None, default=None
        Names of the inputs; None means u[0], u[1], ...
    random_state : int, RandomState instance or None, default=None
        Seed of the starts.

    Returns
    -------
    excitation : Excitation
        The signal. Its realizations are one sequence, shifted: they cannot tell
        nonlinear distortions, for which :func:`multisine` is made.

    Raises
    ------
    ValueError
        If an argument is out of range, or limits contradict each other.

    Examples
    --------
    >>> from alssnn.excitation import prbs
    >>> excitation = prbs(7, hold=2, random_state=0)
    >>> excitation.period, excitation.crest_factor
    (254, array([1.]))
    """
    from scipy.signal import max_len_seq  # here: it takes a tenth of a second to load

    nu, dt, hold = count("nu", nu), sampling_time(dt), count("hold", hold)
    if count("n_bits", n_bits) not in BITS:
        raise ValueError(f"`n_bits` must be from 2 to 20, got {n_bits}.")
    limits = Limits.of(nu, low, high, operating_point, rate)
    names = input_names(names, nu)
    n_realizations = count("n_realizations", n_realizations)
    rng = check_random_state(random_state)
    bits, _ = max_len_seq(int(n_bits))
    starts = rng.randint(len(bits), size=n_realizations)
    shifts = np.arange(nu) * len(bits) // nu
    k = starts[:, None, None] + np.arange(len(bits))[:, None] + shifts
    s = 2.0 * bits[k % len(bits)] - 1.0
    s = np.repeat(s, hold, axis=1)  # (realizations, period, nu)
    room = np.minimum(
        limits.high - limits.operating_point, limits.operating_point - limits.low
    )
    n_periods = count("n_periods", n_periods)
    u = limits.slew(limits.operating_point + room * s, dt, n_periods)
    power = np.abs(np.fft.rfft(u[0, :, 0])[1:]) ** 2
    lines = 1 + np.flatnonzero(power > 1e-12 * power.max())
    lines = lines[2 * lines < u.shape[1]]
    return repeat(u, dt, limits, n_periods, n_realizations, lines, names, "prbs")


def swept_sine(
    n_samples,
    nu=1,
    *,
    dt=1.0,
    band=None,
    method="logarithmic",
    low=-1.0,
    high=1.0,
    rate=None,
    operating_point=None,
    n_periods=1,
    n_realizations=1,
    names=None,
    random_state=None,
):
    """Make sines whose frequency rises.

    Parameters
    ----------
    n_samples : int
        Samples of one sweep.
    nu : int, default=1
        Number of inputs. They are swept one after another, an experiment each, while
        the others stay at the operating point.
    dt : float, default=1.0
        Sampling time, in seconds.
    band : tuple of float or None, default=None
        First and last frequency, in Hz; None means from one period per sweep to 40 %
        of the Nyquist frequency.
    method : {"linear", "quadratic", "logarithmic", "hyperbolic"}, \
default="logarithmic"
        How the frequency rises, as of `scipy.signal.chirp`.
    low : float or array_like of shape (nu,), default=-1.0
        Lowest values of the inputs.
    high : float or array_like of shape (nu,), default=1.0
        Highest values of the inputs.
    rate : float, array_like of shape (nu,) or None, default=None
        Largest change in units per second; the amplitude is lowered to keep it.
    operating_point : float, array_like of shape (nu,) or None, default=None
        Value around which the plant is excited; None means the middle of the limits.
    n_periods : int, default=1
        How often a sweep is repeated.
    n_realizations : int, default=1
        Sweeps of other phases: the first begins at zero, others at random.
    names : sequence of str or None, default=None
        Names of the inputs; None means u[0], u[1], ...
    random_state : int, RandomState instance or None, default=None
        Seed of the phases.

    Returns
    -------
    excitation : Excitation
        The signal.

    Raises
    ------
    ValueError
        If an argument is out of range, limits contradict each other, or the band
        reaches the Nyquist frequency.

    Examples
    --------
    >>> from alssnn.excitation import swept_sine
    >>> excitation = swept_sine(500, 2, dt=0.01, band=(0.5, 10))
    >>> excitation.n_experiments, bool(np.any(excitation.experiments[0][:, 1]))
    (2, False)
    """
    from scipy.signal import chirp  # here: it takes a tenth of a second to load

    n_samples = count("n_samples", n_samples, 8)
    nu, dt = count("nu", nu), sampling_time(dt)
    limits = Limits.of(nu, low, high, operating_point, rate)
    names = input_names(names, nu)
    n_realizations = count("n_realizations", n_realizations)
    methods = ("linear", "quadratic", "logarithmic", "hyperbolic")
    check_option("method", method, methods)
    first, last = frequency_band(band, dt, SWEPT)
    slowest = 1 / (n_samples * dt)
    if band is None:
        first = slowest
    if first <= 0 and method in ("logarithmic", "hyperbolic"):
        raise ValueError(
            f"`band` must begin above 0 Hz for a {method} sweep, got {first:g}. Begin "
            f"at {slowest:g} Hz, one period per sweep, or take method='linear'."
        )
    t = dt * np.arange(n_samples)
    rng = check_random_state(random_state)
    phases = np.r_[-90.0, rng.uniform(0, 360, n_realizations - 1)]
    s = np.zeros((n_realizations, nu, n_samples, nu))
    for m, phase in enumerate(phases):
        for i in range(nu):
            s[m, i, :, i] = chirp(t, first, t[-1], last, method=method, phi=phase)
    n_periods = count("n_periods", n_periods)
    u = limits.scale(s, dt, n_periods).reshape(-1, n_samples, nu)
    return repeat(u, dt, limits, n_periods, n_realizations, None, names, "swept_sine")


def _hold(hold, dt):
    """Return the shortest and the longest hold, in samples."""
    if hold is None:
        return 5, 50
    try:
        shortest, longest = (round(float(time) / dt) for time in hold)
    except (TypeError, ValueError, OverflowError):
        shortest, longest = 0, 0
    if not 1 <= shortest <= longest:
        raise ValueError(
            f"`hold` must be an increasing pair of times of at least one sample, "
            f"{dt:g} s, got {hold!r}. Give the shortest and the longest time between "
            "two steps in seconds."
        )
    return shortest, longest

"""A menu of signals, from which an experiment may be chosen."""

from dataclasses import replace

from sklearn.utils import check_random_state

from ..checks import count, sampling_time
from ._limits import Limits
from ._multisine import multisine
from ._signals import steps

LEVELS = (1.0, 0.7, 0.4)  # of the distance from the operating point to the limits
HOLDS = ((0.005, 0.02), (0.02, 0.08), (0.08, 0.3))  # of the samples
BANDS = (0.04, 0.16, 0.8)  # of the Nyquist frequency


def menu(
    n_samples,
    nu=1,
    *,
    dt=1.0,
    n_candidates=24,
    low=-1.0,
    high=1.0,
    rate=None,
    operating_point=None,
    names=None,
    random_state=None,
):
    """Make different signals of one length within the same limits.

    Parameters
    ----------
    n_samples : int
        Samples of every signal.
    nu : int, default=1
        Number of inputs.
    dt : float, default=1.0
        Sampling time, in seconds.
    n_candidates : int, default=24
        Number of signals: steps and multisines by turns, of three amplitudes, and of
        three lengths of the steps or highest frequencies.
    low : float or array_like of shape (nu,), default=-1.0
        Lowest values of the inputs.
    high : float or array_like of shape (nu,), default=1.0
        Highest values of the inputs.
    rate : float, array_like of shape (nu,) or None, default=None
        Largest change in units per second.
    operating_point : float, array_like of shape (nu,) or None, default=None
        Value around which the plant is excited; None means the middle of the limits.
    names : sequence of str or None, default=None
        Names of the inputs.
    random_state : int, RandomState instance or None, default=None
        Seed.

    Returns
    -------
    signals : list of Excitation
        Signals of one experiment each.

    Raises
    ------
    ValueError
        If an argument is out of range, or limits contradict each other.

    Examples
    --------
    >>> from alssnn.excitation import menu
    >>> signals = menu(400, low=0, high=5, n_candidates=6, random_state=0)
    >>> [one.kind for one in signals[:2]], {len(one) for one in signals}
    (['steps', 'multisine'], {400})
    """
    n_samples, dt = count("n_samples", n_samples, 16), sampling_time(dt)
    n_candidates = count("n_candidates", n_candidates)
    limits = Limits.of(nu, low, high, operating_point, rate)
    rng, signals = check_random_state(random_state), []
    for i in range(n_candidates):
        level, form = LEVELS[i // 2 % 3], i // 6 % 3
        point = limits.operating_point
        options = {
            "dt": dt,
            "low": point + level * (limits.low - point),
            "high": point + level * (limits.high - point),
            "rate": rate,
            "operating_point": point,
            "names": names,
            "n_periods": 1,
            "n_realizations": 1,
            "random_state": rng,
        }
        if i % 2 == 0:
            # a step lasts two samples at least
            shortest, longest = (max(2, round(h * n_samples)) for h in HOLDS[form])
            hold = shortest * dt, max(longest, shortest + 1) * dt
            signals.append(steps(n_samples, nu, hold=hold, **options))
            continue
        top = max(BANDS[form] / (2 * dt), 4 / (n_samples * dt))
        band = (1 / (n_samples * dt), top)
        whole = multisine(n_samples, nu, band=band, **options)
        # of several inputs it takes several experiments, each as lively as the others
        u, label = whole.u[:n_samples].copy(), whole.experiment[:n_samples].copy()
        signals.append(replace(whole, u=u, experiment=label))
    return signals

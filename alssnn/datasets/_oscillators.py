"""Oscillators whose nonlinearity enters with the input: pendulum and Duffing."""

import math
from functools import partial

import numpy as np
from sklearn.utils import check_random_state

from ..checks import check_option
from ._checks import _check_positive, _check_samples
from ._excitation import _check_hold, _stairs
from ._plants import _check_slow, _recorded, _runge_kutta, _simulate

PENDULUM_DT = 0.05  # s, 40 samples per period of small swings
PENDULUM_STEPS = 2  # Runge-Kutta steps per sample: 1e-6 rad from the exact solution
DUFFING_DT = 0.4  # s, 16 samples per natural period of 2 pi s, Silverbox has 9
DUFFING_STEPS = 4  # Runge-Kutta steps per sample
DUFFING_BAND = 3  # highest excited over natural frequency, as in Silverbox
DUFFING_PERIOD = 4_096  # samples between two draws of the phases of the multisine
DUFFING_HOLD = (4, 40)  # samples, shortest and longest step of the stairs
# The transients of pendulum and oscillator fall below 1e-8 of their start.
N_WARMUP = 1_000  # samples


def make_pendulum(
    n_samples=10_000,
    *,
    noise=0.0,
    gravity=9.81,
    damping=0.8,
    amplitude=4.0,
    hold=(0.2, 1.5),
    full_turns=False,
    random_state=None,
):
    r"""Simulate a damped pendulum driven by a torque.

    .. math::

        \ddot\theta = -g_0 \sin\theta - d\,\dot\theta + \tau, \qquad y = \theta

    with the input :math:`\tau`, the torque over the moment of inertia, sampled every
    0.05 s. The nonlinearity enters with the input: the law
    :math:`\tau = v + g_0 (\sin\theta - \theta)` makes the pendulum exactly linear
    in continuous time, and nearly so where it is applied once per sample.

    Parameters
    ----------
    n_samples : int, default=10000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    gravity : float, default=9.81
        Gravity over length, in 1/s^2.
    damping : float, default=0.8
        Damping d, in 1/s.
    amplitude : float, default=4.0
        Largest torque, in rad/s^2. It sets how nonlinear the record is.
    hold : tuple of two floats, default=(0.2, 1.5)
        Shortest and longest time between two steps of the torque, in seconds, rounded
        to samples.
    full_turns : bool, default=False
        Whether the arm may swing over the top; theta then counts the turns, which no
        smooth law of the training range describes. Such records test whether a model
        notices that it is out of its depth.
    random_state : int, RandomState instance or None, default=None
        Seed of input and noise. One seed gives the same noise-free record for every
        `noise`, and longer records continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Input in rad/s^2, output in rad, `dt` = 0.05 s. `record.plant` is the true
        plant, a discrete-time `control.NonlinearIOSystem` with the states theta (rad)
        and its derivative (rad/s), input ``tau`` and output ``theta``; started from
        `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or another argument not a number.
    ValueError
        If an argument is not positive (`noise`: negative), if `hold` is not an
        increasing pair of at least one sample, if the arm is too fast for the sampling
        time, or if it swings over the top and `full_turns` is False.

    See Also
    --------
    make_duffing : An oscillator that hardens instead of softening.

    Notes
    -----
    The torque is a stair-step: levels uniform within +-`amplitude`, held for uniformly
    distributed durations. The record is stationary: the first 1,000 samples are
    discarded.

    At the default amplitude the best linear model (400 taps, offset) leaves 11 % of the
    standard deviation of the output; at 2 rad/s^2 it leaves 2 %, at 0.5 rad/s^2 0.1 %.

    Whether the arm stays below the top depends on the course of the torque. With the
    default of 4 it stayed below 2 rad for the random torques of 300 seeds; with 5 it
    went over the top in 7 % of records of 20,000 samples. Every record is checked.

    The plant is the sampled map of two Runge-Kutta steps of order 4 per sample, 1e-6
    rad from the differential equation.

    Examples
    --------
    >>> from alssnn.datasets import make_pendulum
    >>> record = make_pendulum(500, random_state=0)
    >>> record
    Record('simulated pendulum', N=500, nu=1, ny=1, dt=0.05 s, plant=NonlinearIOSystem)
    >>> bool(abs(record.y).max() < np.pi)
    True
    """
    _check_samples(n_samples, noise)
    _check_positive("gravity", gravity, "Give gravity over length in 1/s^2.")
    _check_positive("damping", damping, "Give the damping in 1/s.")
    _check_positive("amplitude", amplitude, "Give the largest torque in rad/s^2.")
    holds = _check_hold(hold, PENDULUM_DT)
    rng = check_random_state(random_state)

    def derivative(x, u):
        theta, omega = x
        return (omega, -gravity * math.sin(theta) - damping * omega + u[0])

    step = partial(_runge_kutta, derivative, PENDULUM_DT, PENDULUM_STEPS)
    u = amplitude * _stairs(N_WARMUP + n_samples, holds, rng)[:, None]  # (N, 1)
    X = _simulate(step, u, [0.0, 0.0])  # (N, 2)
    remedy = "Lower it, or the `amplitude`."
    decay = damping * PENDULUM_DT / PENDULUM_STEPS
    _check_slow(X, "damping", damping, "arm", PENDULUM_DT, remedy, decay=decay)
    highest = np.abs(X[:, 0]).max()
    if not highest < (np.inf if full_turns else np.pi):
        raise ValueError(
            f"`amplitude` must keep the arm below the top, got {amplitude} with an "
            f"angle of {highest:.1f} rad. Lower `amplitude`, raise `damping`, or set "
            "`full_turns`."
        )
    names = "pendulum", "simulated pendulum", ["tau"], ["theta"], ["theta", "omega"]
    return _recorded(step, u, X, N_WARMUP, [0], PENDULUM_DT, noise, rng, names)


def make_duffing(
    n_samples=10_000,
    *,
    noise=0.0,
    damping=0.1,
    k1=1.0,
    k3=1.0,
    amplitude=0.1,
    excitation="multisine",
    random_state=None,
):
    r"""Simulate a Duffing oscillator, a spring that hardens.

    .. math::

        \ddot y + d\,\dot y + k_1 y + k_3 y^3 = u

    sampled every 0.4 s: at the defaults a natural period of :math:`2\pi` s, 16 samples,
    and a damping ratio of 5 %, the proportions of the Silverbox benchmark [1]_ in
    friendly units. The nonlinearity enters with the input: the law
    :math:`u = v + k_3 y^3` makes the oscillator exactly linear
    in continuous time; applied once per sample it leaves a rest, for 0.4 s is long.

    Parameters
    ----------
    n_samples : int, default=10000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    damping : float, default=0.1
        Damping d, in 1/s.
    k1 : float, default=1.0
        Linear stiffness over mass, in 1/s^2.
    k3 : float, default=1.0
        Cubic stiffness over mass, in 1/(s m)^2.
    amplitude : float, default=0.1
        Standard deviation of the input, in m/s^2. It sets how nonlinear the record is.
    excitation : {"multisine", "stairs"}, default="multisine"
        Multisine with random phases, flat up to three times the natural frequency
        (at most the Nyquist frequency), with new phases every 4,096 samples; or a
        stair-step of random levels held for 4 to 40 samples.
    random_state : int, RandomState instance or None, default=None
        Seed of input and noise. One seed gives the same noise-free record for every
        `noise`, and longer records continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Input in m/s^2, output in m, `dt` = 0.4 s. `record.plant` is the true plant, a
        discrete-time `control.NonlinearIOSystem` with the states position (m) and
        velocity (m/s), input ``u`` and output ``y``; started from `record.x0` it
        reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or another argument not a number.
    ValueError
        If an argument is not positive (`noise`: negative), if `excitation` is unknown,
        or if the spring is too stiff for the sampling rate.

    See Also
    --------
    make_pendulum : An oscillator that softens.

    Notes
    -----
    The record is stationary: the first 1,000 samples are discarded.

    At the default amplitude the best linear model (400 taps, offset) leaves 32 % of the
    standard deviation of the output, 16 % for the stairs; at 0.03 m/s^2 it leaves 4 %
    and 2 %, at 0.3 m/s^2 71 % and 45 %.

    The plant is the sampled map of four Runge-Kutta steps of order 4 per sample, 1e-4
    of std(y) from the differential equation.

    References
    ----------
    .. [1] T. Wigren and J. Schoukens, "Three free data sets for development and
       benchmarking in nonlinear system identification", European Control Conference,
       2013, pp. 2933-2938.

    Examples
    --------
    >>> from alssnn.datasets import make_duffing
    >>> record = make_duffing(500, noise=0.01, random_state=0)
    >>> record.plant.state_labels
    ['position', 'velocity']
    >>> u, y = make_duffing(500, excitation="stairs", random_state=0)
    >>> u.shape, y.shape
    ((500, 1), (500, 1))
    """
    _check_samples(n_samples, noise)
    _check_positive("damping", damping, "Give the damping in 1/s.")
    _check_positive("k1", k1, "Give the linear stiffness over mass in 1/s^2.")
    _check_positive("k3", k3, "Give the cubic stiffness over mass in 1/(s m)^2.")
    _check_positive("amplitude", amplitude, "Give the standard deviation in m/s^2.")
    remedy = "Use the default, 'multisine'."
    check_option("excitation", excitation, ("multisine", "stairs"), remedy)
    rng = check_random_state(random_state)

    def derivative(x, u):
        y, velocity = x
        return (velocity, u[0] - damping * velocity - (k1 + k3 * y * y) * y)

    step = partial(_runge_kutta, derivative, DUFFING_DT, DUFFING_STEPS)
    if excitation == "multisine":
        share = DUFFING_BAND * math.sqrt(k1) * DUFFING_DT / (2 * math.pi)
        u = _multisine(N_WARMUP + n_samples, min(share, 0.5), rng)
    else:
        # levels uniform in (-1, 1) have the standard deviation 1 / sqrt(3)
        u = math.sqrt(3) * _stairs(N_WARMUP + n_samples, DUFFING_HOLD, rng)
    u = amplitude * u[:, None]  # (N, 1)
    X = _simulate(step, u, [0.0, 0.0])  # (N, 2)
    remedy = "Lower `amplitude`, `k1` or `k3`."
    _check_slow(X, "amplitude", amplitude, "oscillator", DUFFING_DT, remedy)
    signals = ["u"], ["y"], ["position", "velocity"]
    names = "duffing", "simulated Duffing oscillator", *signals
    return _recorded(step, u, X, N_WARMUP, [0], DUFFING_DT, noise, rng, names)


def _multisine(n_samples, share, rng):
    """Draw a multisine of unit variance, flat up to `share` of the sampling rate."""
    n_lines = max(1, math.ceil(share * DUFFING_PERIOD) - 1)  # neither 0 nor Nyquist
    periods = []
    for _ in range(math.ceil(n_samples / DUFFING_PERIOD)):
        spectrum = np.zeros(DUFFING_PERIOD // 2 + 1, dtype=complex)
        spectrum[1 : n_lines + 1] = np.exp(2j * np.pi * rng.uniform(size=n_lines))
        periods.append(np.fft.irfft(spectrum))
    gain = DUFFING_PERIOD / math.sqrt(2 * n_lines)  # of irfft, for unit variance
    return gain * np.concatenate(periods)[:n_samples]

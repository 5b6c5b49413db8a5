"""Plants simulated in continuous time, each returned with its exact sampled model.

Every plant is a differential equation

    x' = f(x, u),      y = x_i,

driven through a zero-order hold: u is constant between two samples. One sampling
interval is integrated by n steps of the classical Runge-Kutta method of order 4
(`_runge_kutta`), which defines a discrete-time map

    x+ = F(x, u).

F generates the record and is the update of `record.plant`, so that plant and record
agree to the last bit, and a sampled controller closes its loop around F without an
integrator between them. The makers say how far F is from the differential equation; no
plant here has a feedthrough, and the output is always one of the states.
"""

import math
from functools import partial

import numpy as np
from sklearn.utils import check_random_state

from ._checks import _check_numbers, _check_positive, _check_samples
from ._record import Record

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
    random_state=None,
):
    r"""Simulate a damped pendulum driven by a torque.

    .. math::

        \ddot\theta = -g_0 \sin\theta - d\,\dot\theta + \tau, \qquad y = \theta

    with the input :math:`\tau`, the torque over the moment of inertia, sampled every
    0.05 s. The nonlinearity enters with the input: the law
    :math:`\tau = v + g_0 (\sin\theta - \theta)` makes the pendulum exactly linear.

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
        increasing pair of at least one sample, or if the arm swings over the top.

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

    No torque of at most 3.2 rad/s^2 can swing the default arm over the top, whatever
    its course. With the default of 4 the arm stays below 2 rad for the random torques
    of 300 seeds; with 5 it goes over the top in 7 % of records of 20,000 samples.
    Every record is checked.

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
    highest = np.abs(X[:, 0]).max()
    if not highest < np.pi:
        raise ValueError(
            f"`amplitude` must keep the arm below the top, got {amplitude} with an "
            f"angle of {highest:.1f} rad. Lower `amplitude` or raise `damping`."
        )
    u, X = u[N_WARMUP:], X[N_WARMUP:]
    y = _add_noise(X[:, 0], noise, rng)
    names = (["tau"], "theta", ["theta", "omega"])
    plant = _sampled_plant(step, 0, PENDULUM_DT, names, "pendulum")
    return Record(u, y, PENDULUM_DT, "simulated pendulum", plant, X[0])


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
    :math:`u = v + k_3 y^3` makes the oscillator exactly linear.

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
    if excitation not in ("multisine", "stairs"):
        raise ValueError(
            f"`excitation` must be 'multisine' or 'stairs', got {excitation!r}. "
            "Use the default, 'multisine'."
        )
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
    if not np.all(np.isfinite(X)):
        raise ValueError(
            f"`amplitude` must keep the oscillator slow for its sampling time of "
            f"{DUFFING_DT} s, got {amplitude}. Lower `amplitude`, `k1` or `k3`."
        )
    u, X = u[N_WARMUP:], X[N_WARMUP:]
    y = _add_noise(X[:, 0], noise, rng)
    names = (["u"], "y", ["position", "velocity"])
    plant = _sampled_plant(step, 0, DUFFING_DT, names, "duffing")
    return Record(u, y, DUFFING_DT, "simulated Duffing oscillator", plant, X[0])


def make_prey_predator(
    n_samples=50_000,
    *,
    noise=0.0,
    a=(0.2, 0.1),
    b=(0.01, 0.01),
    c=(0.05, 0.05),
    d=(1.0, 1.0),
    e=0.5,
    f=0.02,
    g=0.02,
    amplitude=2.0,
    phases=(0.0, 1.0),
    x0=(30.0, 30.0, 20.0),
    dt=0.05,
    random_state=None,
):
    r"""Simulate two competing preys and their predator.

    .. math::

        \dot x_1 &= a_1 x_1 - b_1 x_1 x_2 - c_1 x_1 x_3 + d_1 u_1^2 \\
        \dot x_2 &= a_2 x_2 - b_2 x_1 x_2 - c_2 x_2 x_3 + d_2 u_2^2 \\
        \dot x_3 &= -e x_3 + f x_1 x_3 + g x_2 x_3, \qquad y = x_3

    The inputs, :math:`u_i(t) = A \sin(t + \varphi_i) + A \sin(t / 10 + \varphi_i)`,
    feed the preys, only the predator is measured, and no feedback law cancels the
    nonlinearity: the plant of the paper [1]_ for which a residual must remain.

    Parameters
    ----------
    n_samples : int, default=50000
        Number of samples; the paper trains on the first half.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    a, b, c, d : tuple of two floats
        Growth of the preys, competition between them, hunting, and food, all per
        second; (0.2, 0.1), (0.01, 0.01), (0.05, 0.05) and (1, 1).
    e : float, default=0.5
        Mortality of the predator, per second.
    f, g : float, default=0.02
        Growth of the predator by the first and the second prey, per second.
    amplitude : float, default=2.0
        Amplitude A of both sines of both inputs.
    phases : tuple of two floats, default=(0.0, 1.0)
        Phases of the two inputs, in rad.
    x0 : tuple of three floats, default=(30.0, 30.0, 20.0)
        Populations at the first sample.
    dt : float, default=0.05
        Sampling time, in seconds.
    random_state : int, RandomState instance or None, default=None
        Seed of the noise; the noise-free record has nothing random.

    Returns
    -------
    record : Record
        Two inputs and one output. `record.plant` is the true plant, a discrete-time
        `control.NonlinearIOSystem` with 3 states, inputs ``u1``, ``u2`` and output
        ``x3``; started from `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or a scalar argument not a number.
    ValueError
        If a scalar argument or `x0` is not positive (`noise`: negative), if a pair is
        not two finite numbers, or if a population does not stay positive and finite.

    See Also
    --------
    make_pendulum : A plant whose nonlinearity a feedback law cancels.

    Notes
    -----
    The last coupling of the second equation is printed as :math:`c_2 x_1 x_3` in the
    paper, with which the populations diverge; :math:`c_2 x_2 x_3`, the loss of the
    second prey to its predator, keeps them bounded, and is used here.

    The record starts with a transient from `x0`, which lasts about 1,000 samples
    (50 s); then the populations follow the inputs, with the period of 62.8 s of the
    slow sines. After
    it, std(y) is 1.48 around a mean of 7.3 (1.59 over the whole record), with the
    default arguments, and all populations stay between 1.7 and 30.

    The plant is the sampled map of one Runge-Kutta step of order 4 per sample, 1e-6
    from the differential equation.

    References
    ----------
    .. [1] M. Thieffry, A. Hache, M. Yagoubi and P. Chevrel, "Identification for
       control based on neural networks: approximately linearizable models".

    Examples
    --------
    >>> from alssnn.datasets import make_prey_predator
    >>> record = make_prey_predator(2000)
    >>> record.u.shape, record.y.shape
    ((2000, 2), (2000, 1))
    >>> train, test = record.split(0.5)
    """
    _check_samples(n_samples, noise)
    (a1, a2), (b1, b2), (c1, c2), (d1, d2) = (
        _check_numbers(name, pair, 2, "Give one number per prey.")
        for name, pair in (("a", a), ("b", b), ("c", c), ("d", d))
    )
    for name, rate in (("e", e), ("f", f), ("g", g)):
        _check_positive(name, rate, "Give a rate per second.")
    _check_positive("amplitude", amplitude, "Give the amplitude of the sines.")
    _check_positive("dt", dt, "Give the sampling time in seconds.")
    phases = _check_numbers("phases", phases, 2, "Give one phase per input, in rad.")
    x0 = _check_numbers("x0", x0, 3, "Give one population per species.")

    def derivative(x, u):
        x1, x2, x3 = x
        u1, u2 = u
        return (
            a1 * x1 - b1 * x1 * x2 - c1 * x1 * x3 + d1 * u1 * u1,
            a2 * x2 - b2 * x1 * x2 - c2 * x2 * x3 + d2 * u2 * u2,
            -e * x3 + f * x1 * x3 + g * x2 * x3,
        )

    step = partial(_runge_kutta, derivative, dt, 1)
    t = np.arange(n_samples)[:, None] * dt  # (N, 1)
    u = amplitude * (np.sin(t + phases) + np.sin(t / 10 + phases))  # (N, 2)
    X = _simulate(step, u, x0)  # (N, 3)
    if not (np.all(X > 0) and np.all(np.isfinite(X))):
        raise ValueError(
            f"`x0` must lead to positive and finite populations, got {x0}. Start from "
            "positive populations, use the default rates, or lower `dt`."
        )
    y = _add_noise(X[:, 2], noise, check_random_state(random_state))
    names = (["u1", "u2"], "x3", ["x1", "x2", "x3"])
    plant = _sampled_plant(step, 2, dt, names, "prey_predator")
    return Record(u, y, dt, "simulated prey and predator", plant, X[0])


def _check_hold(hold, dt):
    """Return shortest and longest hold in samples."""
    remedy = "Give the shortest and the longest time between two steps in seconds."
    shortest, longest = (
        round(time / dt) for time in _check_numbers("hold", hold, 2, remedy)
    )
    if not 1 <= shortest <= longest:
        raise ValueError(
            f"`hold` must be an increasing pair of at least one sample of {dt} s, "
            f"got {hold!r}. {remedy}"
        )
    return shortest, longest


def _stairs(n_samples, hold, rng):
    """Draw levels in (-1, 1), each held for hold[0] to hold[1] samples."""
    levels, holds, n_drawn = [], [], 0
    # One by one, level before duration: a longer record continues a shorter one.
    while n_drawn < n_samples:
        levels.append(rng.uniform(-1, 1))
        holds.append(rng.randint(hold[0], hold[1] + 1))
        n_drawn += holds[-1]
    return np.repeat(levels, holds)[:n_samples]


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


def _runge_kutta(derivative, dt, n_steps, x, u):
    """Integrate x' = derivative(x, u) over `dt` with constant u; lists, not arrays."""
    # Plain floats: ten times faster than arrays of two or three elements.
    step = dt / n_steps
    half, sixth = step / 2, step / 6
    for _ in range(n_steps):
        k1 = derivative(x, u)
        k2 = derivative([xi + half * ki for xi, ki in zip(x, k1, strict=True)], u)
        k3 = derivative([xi + half * ki for xi, ki in zip(x, k2, strict=True)], u)
        k4 = derivative([xi + step * ki for xi, ki in zip(x, k3, strict=True)], u)
        slopes = zip(x, k1, k2, k3, k4, strict=True)
        x = [xi + sixth * (p + 2 * (q + r) + s) for xi, p, q, r, s in slopes]
    return x


def _simulate(step, u, x):
    """Return the states, of shape (N, nx), visited under u of shape (N, nu)."""
    X = []
    for u_k in u.tolist():
        X.append(x)
        if not math.isfinite(sum(x)):  # math.sin refuses infinity
            break
        x = step(x, u_k)
    return np.array(X)


def _add_noise(y, noise, rng):
    """Add white noise, drawn after the input, which does not depend on it."""
    if noise == 0:
        return y
    return y + noise * y.std() * rng.standard_normal(len(y))


def _sampled_plant(step, output_index, dt, names, name):
    """Return x+ = step(x, u) with one state as output, as a NonlinearIOSystem."""
    import control  # here, so that importing the datasets stays light

    inputs, output_name, states = names

    def update(t, x, u, params):
        """Return the next state."""
        return np.array(step(x.tolist(), u.tolist()))

    def output(t, x, u, params):
        """Return the output."""
        return x[output_index : output_index + 1]

    return control.nlsys(
        update,
        output,
        inputs=inputs,
        outputs=[output_name],
        states=states,
        dt=dt,
        name=name,
    )

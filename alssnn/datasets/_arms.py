"""Arms whose input is no force: one lifted by a fan, one with a changing inertia.

The thrust of a fan goes with the square of its command, and what a torque does to an
arm of two links depends on how the arm is bent. No law u = v - h(s) undoes that, but a
law u = phi^-1(v, s) does.
"""

import math
from functools import partial

import numpy as np
from sklearn.utils import check_random_state

from ._checks import _check_numbers, _check_positive, _check_samples
from ._excitation import _check_hold, _check_range, _levels
from ._plants import _check_slow, _recorded, _runge_kutta, _simulate

FAN_DT = 0.05  # s, 40 samples per period of small swings
FAN_STEPS = 2  # Runge-Kutta steps per sample: 1e-6 rad from the exact solution
ARM_DT = 0.01  # s, a tenth of the fastest time constant of the stretched arm
ARM_STEPS = 4
# kg m^2: two rods of 1 kg and 0.5 m, 1 kg at the tip, and a rotor in either joint
ARM_LINKS, ARM_ROTOR = (11 / 12, 3 / 8, 1 / 3), 0.05
# The transients fall below 1e-8 of their start.
FAN_WARMUP, ARM_WARMUP = 1_000, 4_000  # samples


def make_fan_arm(
    n_samples=10_000,
    *,
    noise=0.0,
    gravity=9.81,
    damping=2.0,
    thrust=8.0,
    command=(0.1, 1.0),
    hold=(0.2, 1.5),
    random_state=None,
):
    r"""Simulate a hanging arm that a fan at its end lifts.

    .. math::

        \ddot\theta = -g_0 \sin\theta - d\,\dot\theta + T u^2 \text{ if } u > 0,
        \qquad y = \theta

    with the command u of the fan, sampled every 0.05 s [1]_. A fan does not turn
    backwards: its thrust is zero for u < 0. In continuous time the law

    .. math::

        u^2 = v + \frac{g_0}{T} (\sin\theta - \theta)

    makes the arm exactly linear as long as its right side is not negative; a law
    :math:`u = v - h(s)` leaves the square.

    Parameters
    ----------
    n_samples : int, default=10000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    gravity : float, default=9.81
        Gravity over length :math:`g_0`, in 1/s^2.
    damping : float, default=2.0
        Damping d, in 1/s.
    thrust : float, default=8.0
        Angular acceleration T by the full command, in rad/s^2.
    command : tuple of two floats, default=(0.1, 1.0)
        Smallest and largest command; one is full speed.
    hold : tuple of two floats, default=(0.2, 1.5)
        Shortest and longest time between two steps of the command, in seconds, rounded
        to samples.
    random_state : int, RandomState instance or None, default=None
        Seed of input and noise. One seed gives the same noise-free record for every
        `noise`, and longer records continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Input without unit, output in rad from hanging down, `dt` = 0.05 s.
        `record.plant` is the true plant, a discrete-time `control.NonlinearIOSystem`
        with the states theta (rad) and omega (rad/s), input ``u`` and output ``theta``;
        started from `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or a scalar argument not a number.
    ValueError
        If a scalar argument is not positive (`noise`: negative), if `command` is not
        an increasing pair that is not negative, if `hold` is not an increasing pair of
        at least one sample, or if the arm swings over the top or is too fast for the
        sampling time.

    See Also
    --------
    make_pendulum : An arm driven by a torque, which a law u = v - h(s) linearizes.

    Notes
    -----
    The command is a stair-step: levels uniform in `command`, held for uniformly
    distributed durations. The record is stationary: the first 1,000 samples are
    discarded.

    Whatever h, a law u = v - h(x) leaves 25 % of what the command does within a sample;
    the law above, held for a sample, 0.6 %.

    The plant is the sampled map of two Runge-Kutta steps of order 4 per sample, 1e-6
    rad from the differential equation.

    References
    ----------
    .. [1] E. T. Enikov and G. Campa, "Mechatronic aeropendulum: demonstration of linear
       and nonlinear feedback control principles with MATLAB/Simulink real-time Windows
       target", IEEE Transactions on Education, vol. 55, no. 4, 2012, pp. 538-545.

    Examples
    --------
    >>> from alssnn.datasets import make_fan_arm
    >>> record = make_fan_arm(500, noise=0.01, random_state=0)
    >>> record.u.shape, record.plant.input_labels, record.plant.output_labels
    ((500, 1), ['u'], ['theta'])
    """
    _check_samples(n_samples, noise)
    _check_positive("gravity", gravity, "Give gravity over length in 1/s^2.")
    _check_positive("damping", damping, "Give the damping in 1/s.")
    _check_positive("thrust", thrust, "Give that of the full command in rad/s^2.")
    remedy = "Give the smallest and the largest command."
    limits = _check_range("command", command, remedy)
    holds = _check_hold(hold, FAN_DT)
    rng = check_random_state(random_state)

    def derivative(x, u):
        theta, omega = x
        lift = thrust * max(u[0], 0.0) * u[0]
        return (omega, lift - gravity * math.sin(theta) - damping * omega)

    step = partial(_runge_kutta, derivative, FAN_DT, FAN_STEPS)
    u = _levels(FAN_WARMUP + n_samples, [limits], [holds], rng)  # (N, 1)
    X = _simulate(step, u, [0.0, 0.0])  # (N, 2)
    decay = damping * FAN_DT / FAN_STEPS
    remedy = "Lower it, or the `thrust`."
    _check_slow(X, "damping", damping, "arm", FAN_DT, remedy, decay=decay)
    highest = np.abs(X[:, 0]).max()
    if not highest < np.pi:
        raise ValueError(
            f"`command` must keep the arm below the top, got {command} with an angle "
            f"of {highest:.1f} rad. Lower the commands or `thrust`."
        )
    names = "fan_arm", "simulated arm with a fan", ["u"], ["theta"], ["theta", "omega"]
    return _recorded(step, u, X, FAN_WARMUP, [0], FAN_DT, noise, rng, names)


def make_two_input_arm(
    n_samples=10_000,
    *,
    noise=0.0,
    stiffness=(20.0, 8.0),
    damping=(3.0, 0.8),
    amplitude=(15.0, 12.0),
    hold=(0.1, 0.6),
    random_state=None,
):
    r"""Simulate an arm of two links in a horizontal plane, with a spring in each joint.

    .. math::

        M(q_2) \ddot q + c(q_2, \dot q) + D \dot q + K q = \tau, \qquad y = q,

        M = \begin{bmatrix} a + 2 b \cos q_2 + J & c_0 + b \cos q_2 \\
        c_0 + b \cos q_2 & c_0 + J \end{bmatrix}, \qquad
        c = b \sin q_2 \begin{bmatrix} -\dot q_2 (2 \dot q_1 + \dot q_2) \\
        \dot q_1^2 \end{bmatrix}

    the planar elbow manipulator [1]_, sampled every 0.01 s: two rods of 1 kg and 0.5 m
    with 1 kg at the tip, a = 11/12, b = 3/8 and :math:`c_0` = 1/3 kg m^2, and a rotor
    of J = 0.05 kg m^2 in either joint. The springs bring it back without a controller.
    In continuous time the law

    .. math::

        \tau = M(q_2) M_0^{-1} (v - D \dot q - K q) + c(q_2, \dot q) + D \dot q + K q

    leaves exactly the linear arm :math:`M_0 \ddot q + D \dot q + K q = v`; a law
    :math:`\tau = v - h(s)` leaves an inertia that changes.

    Parameters
    ----------
    n_samples : int, default=10000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output, for each of the two.
    stiffness : tuple of two floats, default=(20.0, 8.0)
        Stiffness of the joints K, in N m/rad.
    damping : tuple of two floats, default=(3.0, 0.8)
        Damping of the joints D, in N m s/rad.
    amplitude : tuple of two floats, default=(15.0, 12.0)
        Largest torques, in N m.
    hold : tuple of two floats, default=(0.1, 0.6)
        Shortest and longest time between two steps of a torque, in seconds, rounded
        to samples.
    random_state : int, RandomState instance or None, default=None
        Seed of inputs and noise. One seed gives the same noise-free record for every
        `noise`, and longer records continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Two inputs in N m, two outputs in rad, `dt` = 0.01 s. `record.plant` is the true
        plant, a discrete-time `control.NonlinearIOSystem` with the states ``q1``,
        ``q2`` (rad; the second relative to the first link), ``omega1``, ``omega2``
        (rad/s), inputs ``tau1``, ``tau2`` and outputs ``q1``, ``q2``; started from
        `record.x0` it reproduces the noise-free outputs.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or `noise` not a number.
    ValueError
        If `noise` is negative, if a pair is not two positive numbers, if `hold` is not
        an increasing pair of at least one sample, or if the arm is too stiff or too
        fast for the sampling time.

    See Also
    --------
    make_prey_predator : Another plant with two inputs.

    Notes
    -----
    The torques are independent stair-steps: levels uniform within +-`amplitude`, held
    for uniformly distributed durations. The record is stationary: the first 4,000
    samples are discarded. At the default amplitudes :math:`q_2` reaches about 2 rad;
    stretched, the arm has 1.8 times the inertia about the first joint that it has when
    bent at a right angle.

    Whatever h, a law of the form v - h(x) leaves 28 to 35 % of what the torques do
    within a sample; the law above, held for a sample, 4 %.

    The plant is the sampled map of four Runge-Kutta steps of order 4 per sample, 1e-6
    rad from the differential equation.

    References
    ----------
    .. [1] M. W. Spong, S. Hutchinson and M. Vidyasagar, "Robot modeling and control",
       Wiley, 2006, chapter 7.

    Examples
    --------
    >>> from alssnn.datasets import make_two_input_arm
    >>> record = make_two_input_arm(500, noise=0.01, random_state=0)
    >>> record.u.shape, record.y.shape, record.plant.nstates
    ((500, 2), (500, 2), 4)
    """
    _check_samples(n_samples, noise)
    k1, k2 = _check_joints("stiffness", stiffness)
    d1, d2 = _check_joints("damping", damping)
    t1, t2 = _check_joints("amplitude", amplitude)
    holds = _check_hold(hold, ARM_DT)
    rng = check_random_state(random_state)
    a, b, c = ARM_LINKS

    def derivative(x, u):
        q1, q2, w1, w2 = x
        bend, turn = b * math.cos(q2), b * math.sin(q2)
        p1 = u[0] - k1 * q1 - d1 * w1 + turn * w2 * (2 * w1 + w2)
        p2 = u[1] - k2 * q2 - d2 * w2 - turn * w1 * w1
        m11, m12, m22 = a + 2 * bend + ARM_ROTOR, c + bend, c + ARM_ROTOR
        det = m11 * m22 - m12 * m12  # M w' = p
        return (w1, w2, (m22 * p1 - m12 * p2) / det, (m11 * p2 - m12 * p1) / det)

    step = partial(_runge_kutta, derivative, ARM_DT, ARM_STEPS)
    ranges = [(-t1, t1), (-t2, t2)]
    u = _levels(ARM_WARMUP + n_samples, ranges, [holds, holds], rng)  # (N, 2)
    X = _simulate(step, u, [0.0] * 4)  # (N, 4)
    remedy = "Lower it, `stiffness` or `damping`."
    _check_slow(X, "amplitude", amplitude, "arm", ARM_DT, remedy)
    signals = ["tau1", "tau2"], ["q1", "q2"], ["q1", "q2", "omega1", "omega2"]
    names = "two_input_arm", "simulated arm of two links", *signals
    return _recorded(step, u, X, ARM_WARMUP, [0, 1], ARM_DT, noise, rng, names)


def _check_joints(name, pair):
    """Return two positive numbers, one per joint."""
    numbers = _check_numbers(name, pair, 2, "Give one positive number per joint.")
    for number in numbers:
        _check_positive(name, number, "Give one positive number per joint.")
    return numbers

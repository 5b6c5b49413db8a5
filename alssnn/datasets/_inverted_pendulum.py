"""An inverted pendulum, recorded in its loop: feedback, and noise of the process."""

import math

import numpy as np
from sklearn.utils import check_random_state

from ._checks import _check_noise, _check_positive, _check_samples
from ._excitation import _check_hold, _levels
from ._plants import _runge_kutta, _sampled_plant
from ._record import Record

PENDULUM_DT = 0.02  # s, a tenth of the time in which a deviation grows by e
PENDULUM_STEPS = 2  # Runge-Kutta steps per sample
GRAVITY, FRICTION, GAIN = 20.0, 0.2, 5.0  # 1/s^2, 1/s, 1/(s^2 Nm)
PROPORTIONAL, RATE = 12.0, 2.0  # Nm/rad and Nm s/rad, gains of the regulator
TURN = 0.5  # share of an old rate that the regulator keeps
N_WARMUP = 500  # samples


def make_inverted_pendulum(
    n_samples=5_000,
    *,
    noise=0.01,
    torque_noise=0.1,
    angle=0.6,
    hold=(0.2, 1.0),
    random_state=None,
):
    r"""Simulate an inverted pendulum in the loop that keeps it upright.

    .. math::

        \ddot x = a \sin x - b \dot x + c\,(u + w), \qquad y = x + n,

    with the angle x from the upright position in rad, the torque u in Nm, a = 20 1/s^2,
    b = 0.2 1/s, c = 5 1/(s^2 Nm), sampled every 20 ms. The pole of the upright position
    is at +4.4 1/s: the pendulum falls without a controller, and no record exists but of
    a loop. A regulator holds it at a reference r by what it measures,

    .. math::

        u = k_p (r - y) - k_d\,\hat{\dot y}, \qquad
        k_p = 12\text{ Nm/rad}, \qquad k_d = 2\text{ Nm s/rad},

    with the filtered difference of y as a rate. So the noise of sensor and torque is in
    u as well, and the free run of every model of the plant falls. Such a record is for
    ``noise="innovations"``. The law u = v - (a / c) sin y makes the pendulum linear.

    Parameters
    ----------
    n_samples : int, default=5000
        Number of samples.
    noise : float, default=0.01
        Standard deviation of the white Gaussian measurement noise n, relative to that
        of the angle. The regulator sees it.
    torque_noise : float, default=0.1
        Standard deviation of the torque w, white and Gaussian from sample to sample, in
        Nm.
    angle : float, default=0.6
        Largest reference, in rad.
    hold : tuple of two floats, default=(0.2, 1.0)
        Shortest and longest time between two steps of the reference, in seconds,
        rounded to samples.
    random_state : int, RandomState instance or None, default=None
        Seed of reference and noise.

    Returns
    -------
    record : Record
        Torque in Nm, angle in rad, `dt` = 0.02 s. `record.plant` is the plant without
        regulator and noise, a discrete-time `control.NonlinearIOSystem` with the states
        angle (rad) and rate (rad/s), input ``torque`` and output ``angle``;
        `record.x0` is where the record begins.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or a size not a number.
    ValueError
        If `noise` or `torque_noise` is negative, `angle` not positive, `hold` not
        increasing, or the regulator lets the pendulum fall.

    See Also
    --------
    make_magnetic_levitation : An unstable plant whose input acts through a square.
    make_pendulum : The pendulum that hangs.

    Notes
    -----
    The record is stationary: the first 500 samples are discarded.

    Examples
    --------
    >>> from alssnn.datasets import make_inverted_pendulum
    >>> record = make_inverted_pendulum(1000, random_state=0)
    >>> record.plant.input_labels, record.plant.output_labels
    (['torque'], ['angle'])
    >>> bool(abs(record.y).max() < 1.2)  # it never fell
    True
    """
    _check_samples(n_samples, noise)
    _check_noise("torque_noise", torque_noise, "Give its standard deviation in Nm.")
    _check_positive("angle", angle, "Give the largest reference in rad.")
    holds = _check_hold(hold, PENDULUM_DT)
    rng = check_random_state(random_state)
    total = N_WARMUP + n_samples
    r = _levels(total, [(-angle, angle)], [holds], rng)[:, 0]
    size = noise * angle / math.sqrt(3)  # of a uniform reference
    n, w = size * rng.standard_normal(total), torque_noise * rng.standard_normal(total)
    x, rate, last = [0.0, 0.0], 0.0, 0.0
    X, u = np.empty((total, 2)), np.empty(total)
    for k in range(total):
        y = x[0] + n[k]
        rate = TURN * rate + (1 - TURN) * (y - last) / PENDULUM_DT
        u[k], last, X[k] = PROPORTIONAL * (r[k] - y) - RATE * rate, y, x
        if not abs(x[0]) < math.pi / 2:
            raise ValueError(
                f"`angle` must let the regulator hold the pendulum, got {angle} with "
                f"torque_noise={torque_noise}. Take smaller ones."
            )
        x = _step(x, [u[k] + w[k]])
    names = (["torque"], ["angle"], ["angle", "rate"])
    plant = _sampled_plant(
        _step, lambda x: x[:1], PENDULUM_DT, names, "inverted_pendulum"
    )
    u, X, n = u[N_WARMUP:], X[N_WARMUP:], n[N_WARMUP:]
    name = "simulated inverted pendulum"
    return Record(u, X[:, 0] + n, PENDULUM_DT, name, plant, X[0])


def _step(x, u):
    """Return the state one sample later."""
    return _runge_kutta(_fall, PENDULUM_DT, PENDULUM_STEPS, x, u)


def _fall(x, u):
    """Return rate and acceleration."""
    angle, rate = x
    return rate, GRAVITY * math.sin(angle) - FRICTION * rate + GAIN * u[0]

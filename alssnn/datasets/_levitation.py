"""Magnetic levitation: unstable, and gone when the ball touches the magnet."""

from functools import partial

import numpy as np
from sklearn.utils import check_random_state

from ._checks import _check_samples
from ._excitation import _check_hold, _check_range, _levels
from ._plants import _recorded, _runge_kutta, _simulate

LEVITATION_DT = 0.002  # s, a tenth of the time in which a deviation grows by e
LEVITATION_STEPS = 4  # Runge-Kutta steps per sample
REST_GAP, REST_CURRENT = 10.0, 1.0  # mm and A: where the weight is balanced
GRAVITY = 9810.0  # mm/s^2
REGULATOR = (0.14, 0.002)  # A/mm and A s/mm, gains on gap and speed
# The transients of the regulated ball fall below 1e-8 of their start.
N_WARMUP = 1_000  # samples


def make_magnetic_levitation(
    n_samples=5_000,
    *,
    noise=0.0,
    gap=(6.0, 14.0),
    hold=(0.05, 0.25),
    travel=(1.0, 20.0),
    regulated=False,
    random_state=None,
):
    r"""Simulate a ball below an electromagnet, held by a regulator.

    .. math::

        \ddot z = g_0 \left(1 - \left(\frac{z_0}{i_0} \frac{i}{z}\right)^2\right),
        \qquad y = z

    with the gap z between magnet and ball in mm and the current i of the coil in A,
    which pulls only (:math:`i < 0` acts as 0), sampled every 2 ms [1]_:
    :math:`g_0` = 9810 mm/s^2, and 1 A balances the weight at 10 mm. There the pole is
    at +44 1/s: without a controller the ball is lost. A regulator holds it at a
    reference r, with the current that balances the weight there and two gains,

    .. math::

        i = \frac{i_0}{z_0} r + k_z (z - r) + k_s \dot z, \qquad
        k_z = 0.14\text{ A/mm}, \qquad k_s = 0.002\text{ A s/mm}.

    In continuous time the law :math:`i = z \sqrt{v}\, i_0 / z_0` makes the ball exactly
    linear, :math:`\ddot z = g_0 (1 - v)`, as long as v is not negative; a law
    :math:`i = v - h(s)` leaves the square, and a gain that grows near the magnet.

    Parameters
    ----------
    n_samples : int, default=5000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output. The regulator does not see it.
    gap : tuple of two floats, default=(6.0, 14.0)
        Smallest and largest reference of the regulator, in mm.
    hold : tuple of two floats, default=(0.05, 0.25)
        Shortest and longest time between two steps of the reference, in seconds,
        rounded to samples.
    travel : tuple of two floats, default=(1.0, 20.0)
        Gaps in mm at which the ball touches the magnet (below its cover) and lies on
        its pedestal.
    regulated : bool, default=False
        Whether the regulator belongs to the plant. False records the current, the input
        of the unstable plant; True records the reference, the input of the plant that
        the regulator stabilizes.
    random_state : int, RandomState instance or None, default=None
        Seed of reference and noise. One seed gives the same noise-free record for every
        `noise`, and longer records continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Input in A (`regulated`: in mm), output in mm, `dt` = 0.002 s. `record.plant` is
        the true plant, a discrete-time `control.NonlinearIOSystem` with the states gap
        (mm) and speed (mm/s), input ``current`` (or ``reference``) and output ``gap``;
        started from `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or `noise` not a number.
    ValueError
        If `noise` is negative, if a pair is not increasing or negative, if `gap` is not
        within `travel`, or if the regulator loses the ball.

    See Also
    --------
    make_fan_arm : A stable plant with a square at its input.

    Notes
    -----
    A ball that reaches an end of `travel` stays there, whatever the current: of a
    simulation of `record.plant` it was lost if the gap is ever at or beyond an end. No
    record contains such a sample.

    Under the recorded current an error of the start grows tenfold every 26 samples. To
    fit a simulation, cut such a record into short experiments, or take
    ``regulated=True``.

    Whatever h, a law i = v - h(x) leaves 15 % of what the current does within a sample;
    the law above, held for a sample, 0.8 %.

    The reference is a stair-step: levels uniform in `gap`, held for uniformly
    distributed durations. The record is stationary: the first 1,000 samples are
    discarded. The plant is the sampled map of four Runge-Kutta steps of order 4 per
    sample, 1e-9 mm per sample from the differential equation.

    References
    ----------
    .. [1] W. Barie and J. Chiasson, "Linear and nonlinear state-space controllers for
       magnetic levitation", International Journal of Systems Science, vol. 27, no. 11,
       1996, pp. 1153-1163.

    Examples
    --------
    >>> from alssnn.datasets import make_magnetic_levitation
    >>> record = make_magnetic_levitation(500, noise=0.01, random_state=0)
    >>> record.plant.input_labels, record.plant.output_labels
    (['current'], ['gap'])
    >>> bool(record.y.min() > 1.0 and record.y.max() < 20.0)  # it never crashed
    True
    """
    _check_samples(n_samples, noise)
    ends = _check_range("travel", travel, "Give both ends in mm.")
    remedy = "Give the smallest and the largest reference in mm, within `travel`."
    limits = _check_range("gap", gap, remedy)
    if not ends[0] < limits[0] < limits[1] < ends[1]:
        raise ValueError(f"`gap` must lie within {travel}, got {gap!r}. {remedy}")
    holds = _check_hold(hold, LEVITATION_DT)
    rng = check_random_state(random_state)
    magnet = partial(_step, ends)

    def regulated_magnet(x, r):
        return magnet(x, _regulate(x, r))

    r = _levels(N_WARMUP + n_samples, [limits], [holds], rng)  # (N, 1)
    X = _simulate(regulated_magnet, r, [sum(limits) / 2, 0.0])  # (N, 2)
    if not np.all((X[:, 0] > ends[0]) & (X[:, 0] < ends[1])):
        raise ValueError(
            f"`gap` must keep the ball off the ends {travel}, got {gap!r}. Narrow its "
            "range, or widen `travel`."
        )
    if regulated:
        u, step, moved = r, regulated_magnet, "reference"
    else:
        runs = zip(X.tolist(), r.tolist(), strict=True)
        u, step, moved = np.array([_regulate(*run) for run in runs]), magnet, "current"
    names = "levitation", "simulated levitation", [moved], ["gap"], ["gap", "speed"]
    return _recorded(step, u, X, N_WARMUP, [0], LEVITATION_DT, noise, rng, names)


def _step(ends, x, u):
    """Return the state one sample later; a ball that has landed stays where it is."""
    low, high = ends
    dt = LEVITATION_DT / LEVITATION_STEPS
    for _ in range(LEVITATION_STEPS):
        # between steps, so that no ball passes through the magnet and comes back
        if x[0] <= low or x[0] >= high:
            return [min(max(x[0], low), high), 0.0]
        x = _runge_kutta(_levitate, dt, 1, x, u)
    return x


def _levitate(x, u):
    """Return speed and acceleration of the ball, in mm/s and mm/s^2."""
    gap, speed = x
    # a stage of the integration may look beyond the magnet
    ratio = REST_GAP / REST_CURRENT * max(u[0], 0.0) / max(gap, 1e-3)
    return (speed, GRAVITY * (1 - ratio * ratio))


def _regulate(x, r):
    """Return the current that holds the ball at a reference; none if negative."""
    gap, speed = x
    k_gap, k_speed = REGULATOR
    rest = REST_CURRENT / REST_GAP * r[0]
    return [max(rest + k_gap * (gap - r[0]) + k_speed * speed, 0.0)]

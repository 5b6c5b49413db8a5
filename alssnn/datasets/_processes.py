"""Processes whose gain depends on where they are: a heat exchanger, a valve on a tank.

What a flow heats depends on how much colder the vessel is, and what a valve lets
through on how far it is open. No law u = v - h(s) undoes that, but a law
u = phi^-1(v, s, d) does, with the disturbance d that was measured.
"""

import math
from functools import partial

import numpy as np
from sklearn.utils import check_random_state

from ._checks import _check_positive, _check_samples
from ._excitation import _check_hold, _check_range, _levels
from ._plants import _recorded, _runge_kutta, _simulate

EXCHANGER_DT = 2.0  # s, a fifth of the shortest time constant
EXCHANGER_STEPS = 2  # Runge-Kutta steps per sample
VESSEL = 2.0  # l, either side
COLD_FLOW, COLD_INLET = 3.0, 15.0  # l/min and degrees C
TRANSFER = 4.0  # l/min, 280 W/K over the heat capacity of a liter of water
HOT_INLET = (70.0, 90.0)  # degrees C, of the disturbance; its mean if constant
TANK_DT = 5.0  # s, a tenth of the time constant at a low level
TANK_STEPS = 2
TANK_AREA, TANK_HEIGHT = 50.0, 1.0  # l/m (0.05 m^2) and m
VALVE = 0.6  # l/s, of the open valve
OUTLET = 0.664  # l/s at a level of 1 m, a hole of 1.5 cm^2
INFLOW = (0.03, 0.15)  # l/s, of the disturbance; its mean if constant
SLOWER = 3  # how much longer than the input a disturbance is held
# The transients of both fall below 1e-8 of their start.
N_WARMUP = 1_000  # samples


def make_heat_exchanger(
    n_samples=5_000,
    *,
    noise=0.0,
    flow=(0.5, 10.0),
    hold=(10.0, 120.0),
    disturbance=True,
    random_state=None,
):
    r"""Simulate a stream of cold water that a stream of hot water heats.

    .. math::

        V \dot T_h &= q\,(T_d - T_h) - \kappa\,(T_h - T_c) \\
        V \dot T_c &= q_c\,(T_{in} - T_c) + \kappa\,(T_h - T_c), \qquad y = T_c

    Either side is well mixed [1]_ and holds V = 2 l. The flow q of hot water is the
    input; it enters at :math:`T_d`, a disturbance that is measured. The cold stream,
    :math:`q_c` = 3 l/min at :math:`T_{in}` = 15 degrees C, leaves at :math:`T_c`; the
    heat transfer is :math:`\kappa` = 4 l/min in the units of a flow of water. Sampled
    every 2 s. In continuous time the law

    .. math::

        q = \frac{v}{T_d - T_h}

    makes the exchanger exactly linear as long as the inlet is hotter than the vessel;
    a law :math:`q = v - h(s)` leaves a gain that changes with the temperature.

    Parameters
    ----------
    n_samples : int, default=5000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    flow : tuple of two floats, default=(0.5, 10.0)
        Smallest and largest flow of hot water, in l/min.
    hold : tuple of two floats, default=(10.0, 120.0)
        Shortest and longest time between two steps of the flow, in seconds, rounded to
        samples; the inlet temperature is held three times as long.
    disturbance : bool, default=True
        Whether the inlet temperature varies, in steps between 70 and 90 degrees C, as
        the second input. False holds it at 80 degrees C: one input.
    random_state : int, RandomState instance or None, default=None
        Seed of inputs and noise. One seed gives the same noise-free record for every
        `noise` and the same flow with and without disturbance, and longer records
        continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Inputs in l/min and degrees C, output in degrees C, `dt` = 2 s. `record.plant`
        is the true plant, a discrete-time `control.NonlinearIOSystem` with the states
        ``hot``, ``cold`` (degrees C), inputs ``flow`` and, with `disturbance`,
        ``inlet``, and output ``cold``; a negative flow acts as none. Started from
        `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or `noise` not a number.
    ValueError
        If `noise` is negative, if `flow` is not an increasing pair that is not
        negative, if `hold` is not an increasing pair of at least one sample, or if the
        flow is too large for the sampling time.

    See Also
    --------
    make_valve_tank : A gain that depends on the input instead.

    Notes
    -----
    Flow and inlet temperature are independent stair-steps with levels uniform in their
    ranges, held for uniformly distributed durations. The record is stationary: the
    first 1,000 samples are discarded. :math:`T_d - T_h`, the gain of the flow, varies
    by a factor of 4 without disturbance.

    Without disturbance, whatever h, a law u = v - h(x) leaves 33 % of what the flow
    does within a sample; the law above, held for a sample, 1 %.

    The plant is the sampled map of two Runge-Kutta steps of order 4 per sample, 1e-5
    degrees from the differential equation.

    References
    ----------
    .. [1] D. E. Seborg, T. F. Edgar and D. A. Mellichamp, "Process dynamics and
       control", 2nd edition, Wiley, 2004, chapter 2.

    Examples
    --------
    >>> from alssnn.datasets import make_heat_exchanger
    >>> record = make_heat_exchanger(500, noise=0.01, random_state=0)
    >>> record.u.shape, record.plant.input_labels
    ((500, 2), ['flow', 'inlet'])
    >>> make_heat_exchanger(500, disturbance=False, random_state=0).u.shape
    (500, 1)
    """
    _check_samples(n_samples, noise)
    limits = _check_range("flow", flow, "Give both ends in l/min.")
    holds = _check_hold(hold, EXCHANGER_DT)
    rng = check_random_state(random_state)
    constant = sum(HOT_INLET) / 2

    def derivative(x, u):
        hot, cold = x
        inlet = u[1] if disturbance else constant
        heat = TRANSFER * (hot - cold)
        return (
            (max(u[0], 0.0) * (inlet - hot) - heat) / (60 * VESSEL),
            (COLD_FLOW * (COLD_INLET - cold) + heat) / (60 * VESSEL),
        )

    step = partial(_runge_kutta, derivative, EXCHANGER_DT, EXCHANGER_STEPS)
    u = _with_disturbance(n_samples, limits, HOT_INLET, holds, rng, disturbance)
    X = _simulate(step, u, [constant, COLD_INLET])  # (N, 2)
    if not np.all((X > 0) & (X <= HOT_INLET[1])):  # it mixes, and cannot be hotter
        raise ValueError(
            f"`flow` must be small for a sampling time of {EXCHANGER_DT} s, got {flow}."
            " Exchange the vessel less than once per second."
        )
    signals = ["flow", "inlet"][: u.shape[1]], ["cold"], ["hot", "cold"]
    names = "heat_exchanger", "simulated heat exchanger", *signals
    return _recorded(step, u, X, N_WARMUP, [1], EXCHANGER_DT, noise, rng, names)


def make_valve_tank(
    n_samples=5_000,
    *,
    noise=0.0,
    rangeability=50.0,
    lift=(0.4, 0.95),
    hold=(25.0, 150.0),
    disturbance=True,
    random_state=None,
):
    r"""Simulate a tank filled through a valve of equal percentage.

    .. math::

        F \dot h = q_v R^{u - 1} + d - k \sqrt h, \qquad y = h

    The lift u of the valve, from 0 to 1, is the input: every step of it changes the
    flow by the same percentage [1]_, up to :math:`q_v` = 0.6 l/s; beyond its ends the
    lift stays there. Another inflow, d, is a disturbance that is measured. The tank, of
    F = 50 l per meter and a height of 1 m, empties through a hole in the bottom,
    k = 0.664 l/s at 1 m. Sampled every 5 s. In continuous time the law

    .. math::

        q_v R^{u - 1} = v - d + k (\sqrt h - s h), \quad s > 0,

    makes the tank exactly linear as long as the valve can let that through; a law
    :math:`u = v - h(s)` leaves the exponential.

    Parameters
    ----------
    n_samples : int, default=5000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    rangeability : float, default=50.0
        Flow R of the open valve over that of the closed one, above one.
    lift : tuple of two floats, default=(0.4, 0.95)
        Smallest and largest lift of the valve, within 0 and 1.
    hold : tuple of two floats, default=(25.0, 150.0)
        Shortest and longest time between two steps of the lift, in seconds, rounded to
        samples; the other inflow is held three times as long.
    disturbance : bool, default=True
        Whether the other inflow varies, in steps between 0.03 and 0.15 l/s, as the
        second input. False holds it at 0.09 l/s: one input.
    random_state : int, RandomState instance or None, default=None
        Seed of inputs and noise. One seed gives the same noise-free record for every
        `noise` and the same lift with and without disturbance, and longer records
        continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Inputs without unit and in l/s, output in m, `dt` = 5 s. `record.plant` is the
        true plant, a discrete-time `control.NonlinearIOSystem` with the state ``level``
        (m), inputs ``lift`` and, with `disturbance`, ``inflow``, and output ``level``;
        started from `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or a scalar argument not a number.
    ValueError
        If `noise` is negative, `rangeability` is not above one, `lift` is not an
        increasing pair within 0 and 1, if `hold` is not an increasing pair of at least
        one sample, or if the tank overflows.

    See Also
    --------
    make_heat_exchanger : A gain that depends on the state instead.
    fetch_cascaded_tanks : The measured record of two tanks.

    Notes
    -----
    Lift and inflow are independent stair-steps with levels uniform in their ranges,
    held for uniformly distributed durations. The record is stationary: the first 1,000
    samples are discarded. The flow of the valve varies by a factor of 8.6.

    Without disturbance, whatever h, a law u = v - h(x) leaves 30 % of what the lift
    does within a sample; the law above, held for a sample, 0.7 %.

    The plant is the sampled map of two Runge-Kutta steps of order 4 per sample, 1e-8 m
    from the differential equation.

    References
    ----------
    .. [1] D. E. Seborg, T. F. Edgar and D. A. Mellichamp, "Process dynamics and
       control", 2nd edition, Wiley, 2004, chapter 9.

    Examples
    --------
    >>> from alssnn.datasets import make_valve_tank
    >>> record = make_valve_tank(500, noise=0.01, random_state=0)
    >>> record.u.shape, record.plant.input_labels
    ((500, 2), ['lift', 'inflow'])
    >>> make_valve_tank(500, disturbance=False, random_state=0).u.shape
    (500, 1)
    """
    _check_samples(n_samples, noise)
    remedy = "Give the flow of the open valve over that of the closed one, 20 to 100."
    _check_positive("rangeability", rangeability, remedy)
    if rangeability <= 1:
        raise ValueError(f"`rangeability` must exceed 1, got {rangeability}. {remedy}")
    limits = _check_range("lift", lift, "Give both ends, within 0 and 1.")
    if limits[1] > 1:
        raise ValueError(
            f"`lift` must not exceed 1, got {lift!r}. Give both ends, within 0 and 1."
        )
    holds = _check_hold(hold, TANK_DT)
    rng = check_random_state(random_state)
    constant = sum(INFLOW) / 2

    def derivative(x, u):
        inflow = u[1] if disturbance else constant
        valve = VALVE * rangeability ** (min(max(u[0], 0.0), 1.0) - 1)
        # a tank that is empty lets out what comes in
        outflow = OUTLET * math.sqrt(max(x[0], 0.0))
        return ((valve + inflow - outflow) / TANK_AREA,)

    step = partial(_runge_kutta, derivative, TANK_DT, TANK_STEPS)
    u = _with_disturbance(n_samples, limits, INFLOW, holds, rng, disturbance)
    X = _simulate(step, u, [0.3 * TANK_HEIGHT])  # (N, 1)
    if not X.max() < TANK_HEIGHT:
        raise ValueError(
            f"`lift` must keep the level below {TANK_HEIGHT} m, got {lift!r} with a "
            f"level of {X.max():.2f} m. Lower it or shorten `hold`."
        )
    signals = ["lift", "inflow"][: u.shape[1]], ["level"], ["level"]
    names = "valve_tank", "simulated tank behind a valve", *signals
    return _recorded(step, u, X, N_WARMUP, [0], TANK_DT, noise, rng, names)


def _with_disturbance(n_samples, limits, disturbed, holds, rng, is_wanted):
    """Draw an input, and a slower disturbance beside it, with the samples to discard.

    Both are drawn even if the disturbance is not wanted: the input does not depend on
    it.
    """
    slow = [SLOWER * n for n in holds]
    u = _levels(N_WARMUP + n_samples, [limits, disturbed], [holds, slow], rng)
    return u if is_wanted else u[:, :1]

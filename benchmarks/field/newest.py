"""Simulated plants behind all rules: none of them has been looked at for a choice.

Every plant is a function ``(rng, N) -> (u, y)`` of a record without noise.
"""

from math import exp, log, sin, sqrt, tanh

import numpy as np

from .case import simulated
from .signals import filtered, iterate, levels, multisine, simulate, steps


def greenhouse(rng, N):
    """Heat and air a greenhouse under changing weather; temperature and humidity."""

    def balance(x, u):
        warmth, moisture = x
        heater, vent, outside = u
        return [
            (8 * heater - (0.4 + vent) * (warmth - outside)) / 6,
            (1.2 + 0.05 * warmth - (0.2 + vent) * (moisture - 6)) / 4,
        ]

    weather = 10 + 4 * multisine(rng, N, 1.0, 0, 0.01)
    heater, vent = steps(rng, N, 0, 2, 8, 50), steps(rng, N, 0, 1.5, 8, 50)
    u = np.column_stack([heater, vent, weather])
    return u, simulate(balance, [18, 9], u, 0.5)[0]


def cylinder(rng, N):
    """Move a piston by air that a valve with a dead zone lets in; it rubs."""

    def motion(x, u):
        place, speed, pressure = x
        spool = u[0] - max(-0.1, min(u[0], 0.1))
        flow = 4 * spool * sqrt(max(1.2 - pressure * (1 if spool > 0 else -1), 0))
        rubbing = 0.6 * speed + 0.15 * tanh(20 * speed)
        return [speed, 8 * (pressure - 0.8 * place - rubbing), flow - 2 * speed]

    u = steps(rng, N, -0.8, 0.8, 5, 25)
    return u, simulate(motion, [0, 0, 0], u, 0.08, 8)[0][:, 0]


def solenoid(rng, N):
    """Drive a coil whose iron saturates; the current is measured."""

    def balance(x, u):
        flux, eddy = x
        current = 0.3 * flux + 0.9 * flux**5
        return [u[0] - current - 0.8 * (flux - eddy), 1.5 * (flux - eddy)]

    u = multisine(rng, N, 0.7, 0, 0.1)
    X, _ = simulate(balance, [0, 0], u, 0.4, 6)
    return u, 0.3 * X[:, 0] + 0.9 * X[:, 0] ** 5


def thermistor(rng, N):
    """Heat a block by the square of a voltage; a thermistor measures it."""

    def balance(x, u):
        block, bead = x
        return [(6 * u[0] ** 2 - (block - 20)) / 12, (block - bead) / 3]

    u = steps(rng, N, 0, 3, 10, 60)
    X, _ = simulate(balance, [40, 40], u, 1.0)
    return u, 10 * np.exp(3500 * (1 / (X[:, 1] + 273) - 1 / 298))


def van_der_pol(rng, N):
    """Force an oscillator that feeds itself; its limit cycle beats with the input."""

    def motion(x, u):
        place, speed = x
        return [speed, 0.6 * (1 - place**2) * speed - place + 1.5 * u[0]]

    u = multisine(rng, N, 1.0, 0, 0.1)
    return u, simulate(motion, [1, 0], u, 0.4, 6)[0][:, 0]


def narma(rng, N):
    """Iterate a map of the past outputs and of products of inputs."""

    def update(x, u):
        y, before, last = x
        return [
            0.3 * y + 0.1 * y * (y + before) + 1.2 * u[0] * last + 0.1,
            y,
            u[0],
        ]

    u = rng.uniform(0, 0.7, N)
    return u, iterate(update, [0.2, 0.2, 0.2], u)[:, 0]


def two_links(rng, N):
    """Swing two links in a vertical plane by two motors, behind a regulator."""

    def motion(x, u):
        a, b, p, q = x
        c, s = 0.4 * np.cos(b), 0.4 * sin(b)
        m11, m12, m22 = 1.4 + 2 * c, 0.3 + c, 0.3
        f1 = u[0] + s * (2 * p + q) * q - 4 * sin(a) - 1.2 * sin(a + b) - 0.8 * p
        f2 = u[1] - s * p * p - 1.2 * sin(a + b) - 0.5 * q
        det = m11 * m22 - m12 * m12
        return [p, q, (m22 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det]

    def law(x, r):
        a, b, p, q = x
        return [3 * (r[0] - a) - p + r[2], 1.5 * (r[1] - b) - 0.4 * q + r[3]]

    r = [steps(rng, N, -1.2, 1.2, 15, 70) for _ in range(2)]
    r += [multisine(rng, N, 0.5, 0, 0.1) for _ in range(2)]
    X, u = simulate(motion, [0, 0, 0, 0], np.column_stack(r), 0.1, 6, law)
    return u, X[:, :2]


def rate_limited(rng, N):
    """Turn an aircraft about its long axis by a rudder of limited rate and travel."""

    def motion(x, u):
        fin, rate, roll = x
        moving = max(-0.8, min(3 * (u[0] - fin), 0.8))
        return [moving, 2.5 * fin - 1.2 * rate - 0.3 * roll, rate]

    u = steps(rng, N, -0.7, 0.7, 5, 30)
    return u, simulate(motion, [0, 0, 0], u, 0.1)[0][:, 1]


def parallel_branches(rng, N):
    """Add two branches, each a curve between filters."""
    u = multisine(rng, N, 1.0, 0, 0.25)
    slow = filtered([0.1, 0.1], [1, -1.4, 0.58], u)
    fast = filtered([0.4, -0.3], [1, -0.5], u)
    first = filtered([0.5], [1, -0.6], np.tanh(1.5 * slow))
    second = filtered([0.3, 0.2], [1, -0.8, 0.3], np.where(fast > 0, fast, 0.2 * fast))
    return u, first + second


def pump(rng, N):
    """Fill two tanks by a pump of which the head limits the flow; both levels."""

    def balance(x, u):
        low, high = x
        head = max(u[0] ** 2 - 0.4 * low, 0)
        over = 0.8 * (low - high) / sqrt(abs(low - high) + 0.05)
        return [(sqrt(head) - over) / 3, (over - u[1] * sqrt(max(high, 0))) / 4]

    u = np.column_stack([steps(rng, N, 0.6, 1.6, 8, 50), steps(rng, N, 0.3, 1, 8, 50)])
    return u, simulate(balance, [1, 0.6], u, 0.8)[0]


def generator(rng, N):
    """Load a generator of which field current and load are inputs; its voltage."""

    def balance(x, u):
        field, voltage = x
        force = 1.6 * field / (1 + 0.6 * abs(field))
        return [(u[0] - field) / 2, (force - voltage * (0.5 + u[1])) / 0.8]

    u = np.column_stack([steps(rng, N, 0.2, 3, 8, 40), steps(rng, N, 0.1, 1, 8, 40)])
    return u, simulate(balance, [1, 1], u, 0.4)[0][:, 1]


def absorber(rng, N):
    """Hang a small mass on a cubic spring to a large one; the large one moves."""

    def motion(x, u):
        place, speed, small, rate = x
        stretch, slip = small - place, rate - speed
        pull = 0.05 * stretch + 0.6 * stretch**3 + 0.02 * slip
        return [speed, u[0] - place - 0.05 * speed + pull, rate, -10 * pull]

    u = multisine(rng, N, 0.35, 0, 0.12)
    return u, simulate(motion, [0, 0, 0, 0], u, 0.4, 8)[0][:, 0]


def catalyst(rng, N):
    """Feed a catalyst that its own product poisons; few levels of the feed."""

    def balance(x, u):
        feed, product = x
        speed = 2 * feed / (1 + 3 * product * product)
        return [0.4 * (u[0] - feed) - speed, speed - 0.3 * product]

    u = levels(rng, N, [0.5, 1.5, 3.0], hold=8)
    return u, simulate(balance, [0.5, 0.5], u, 0.5)[0][:, 1]


def diode_filter(rng, N):
    """Load a capacitor through a diode; it discharges through a resistor."""

    def balance(x, u):
        first, second = x
        drop = max(u[0] - first, -2)
        current = 0.6 * log(1 + exp(6 * (drop - 0.3)))
        return [current - 0.8 * (first - second), 0.5 * (first - second) - 0.1 * second]

    u = multisine(rng, N, 1.2, 0, 0.2)
    return u, simulate(balance, [0, 0], u, 0.4, 10)[0][:, 1]


NEWEST = (
    simulated("greenhouse", "bilinear, 3 x 2", greenhouse, split="newest", N=1_500),
    simulated("cylinder", "dead zone, friction", cylinder, split="newest", dt=0.08),
    simulated("solenoid", "saturation in a loop", solenoid, split="newest", dt=0.4),
    simulated("thermistor", "square, Wiener", thermistor, split="newest", N=1_000),
    simulated("limit cycle", "van der Pol", van_der_pol, split="newest", dt=0.4),
    simulated("narma", "map, products", narma, split="newest", noise=0.03),
    simulated("two links", "behind a regulator, 2 x 2", two_links, split="newest"),
    simulated("rate limited", "actuator", rate_limited, split="newest", runs=2),
    simulated("branches", "parallel", parallel_branches, split="newest", N=3_000),
    simulated("pump", "head, 2 x 2", pump, split="newest", color=0.7),
    simulated("generator", "saturation, load", generator, split="newest", N=600),
    simulated("absorber", "cubic spring", absorber, split="newest", N=6_000),
    simulated("catalyst", "three levels", catalyst, split="newest", noise=0.02),
    simulated("diode filter", "diode", diode_filter, split="newest", dt=0.4),
)

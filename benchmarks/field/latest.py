"""Simulated plants that came last: no rule was chosen with a look at them.

Every plant is a function ``(rng, N) -> (u, y)`` of a record without noise.
"""

from math import cos, exp, sin, sqrt, tanh

import numpy as np

from .case import simulated
from .signals import filtered, iterate, levels, multisine, simulate, steps


def loudspeaker(rng, N):
    """Drive a loudspeaker far; force factor and stiffness depend on its position."""

    def motion(x, u):
        current, place, speed = x
        force = 1 - 0.35 * place**2 - 0.1 * place
        return [
            8 * (u[0] - current - force * speed),
            speed,
            force * current - 0.15 * speed - place * (1 + 0.5 * place**2),
        ]

    u = multisine(rng, N, 0.7, 0, 0.1)
    return u, simulate(motion, [0, 0, 0], u, 0.4, 8)[0][:, 1]


def series_motor(rng, N):
    """Drive a series motor: its torque goes with the square of the current."""

    def motion(x, u):
        current, speed = x
        return [
            (u[0] - current - 0.8 * current * speed) / 0.2,
            current * abs(current) - 0.1 * speed - 0.3 * speed * abs(speed),
        ]

    u = steps(rng, N, 0.3, 2.5, 8, 50)
    return u, simulate(motion, [0.5, 0.5], u, 0.1)[0][:, 1]


def converter(rng, N):
    """Switch a boost converter by its duty; the averaged voltage is measured."""

    def balance(x, u):
        current, voltage = x
        off = 1 - u[0]
        return [
            (1 - off * voltage - 0.1 * current) / 0.5,
            off * current - 0.6 * voltage,
        ]

    u = levels(rng, N, np.linspace(0.1, 0.6, 9), hold=6)
    return u, simulate(balance, [1, 1.2], u, 0.25)[0][:, 1]


def shower(rng, N):
    """Mix hot and cold water in a pot that drains; level and temperature."""

    def balance(x, u):
        level, warmth = x
        hot, cold = u
        return [
            (hot + cold - 1.2 * sqrt(max(level, 0))) / 6,
            (hot * (60 - warmth) + cold * (12 - warmth)) / (6 * max(level, 0.2)),
        ]

    u = np.column_stack([steps(rng, N, 0.3, 1.0, 8, 50) for _ in range(2)])
    return u, simulate(balance, [1, 35], u, 1.0)[0]


def rolling_ship(rng, N):
    """Roll a ship by its fins; righting moment and damping are no lines."""

    def motion(x, u):
        roll, rate = x
        righting = roll - 0.9 * roll**3 + 0.2 * roll**5
        return [rate, 0.25 * u[0] - righting - 0.1 * rate - 0.3 * rate * abs(rate)]

    u = multisine(rng, N, 1.0, 0, 0.12)
    return u, simulate(motion, [0, 0], u, 0.3)[0][:, 0]


def hovering(rng, N):
    """Hold the height of a rotor by a regulator; thrust goes with speed squared."""

    def motion(x, u):
        spin, height, rate = x
        ground = 1 + 0.3 * exp(-2 * max(height, 0))
        return [
            (u[0] - spin) / 0.15,
            rate,
            9.8 * (spin * abs(spin) * ground - 1) - 0.3 * rate * abs(rate),
        ]

    def law(x, r):
        _, height, rate = x
        return [min(max(1 + 0.25 * (r[0] - height) - 0.22 * rate, 0), 1.6)]

    r = steps(rng, N, 0.5, 3, 25, 90)
    X, u = simulate(motion, [1, 1, 0], r, 0.05, 4, law)
    return u, X[:, 1]


def suspension(rng, N):
    """Shake a quarter of a car: its damper is stiffer outwards, its stop is hard."""

    def motion(x, u):
        deflection, body, wheel, tire = x
        relative = body - wheel
        damping = (1.6 if relative > 0 else 0.5) * relative
        stop = 60 * (max(deflection - 0.4, 0) + min(deflection + 0.4, 0))
        force = 4 * deflection + damping + stop
        return [relative, -force, 8 * (force - 25 * tire), wheel - u[0]]

    u = multisine(rng, N, 0.6, 0, 0.15)
    X, _ = simulate(motion, [0, 0, 0, 0], u, 0.1, 10)
    return u, np.column_stack([X[:, 0], X[:, 1]])


def vessel(rng, N):
    """Fill a vessel with gas through a valve; its outlet is choked or not."""

    def balance(x, u):
        valve, pressure = x
        supply = valve * sqrt(max(6 - pressure, 0))
        drop = max(pressure - 1, 0)
        outlet = 0.5 * pressure * (1 if pressure > 1.9 else sqrt(drop / 0.9))
        return [(u[0] - valve) / 1.5, 0.25 * (supply - outlet)]

    u = steps(rng, N, 0.1, 1.0, 6, 40)
    return u, simulate(balance, [0.5, 2], u, 0.8)[0][:, 1]


def collector(rng, N):
    """Heat oil in three sections by the sun; the flow takes the heat away."""

    def balance(x, u):
        flow, sun = u
        before = [20, *x[:2]]
        return [
            flow * (b - t) / 2 + 6 * sun - 0.02 * (t - 20)
            for b, t in zip(before, x, strict=True)
        ]

    flow = steps(rng, N, 0.3, 1.2, 8, 50)
    sun = 0.8 + 0.15 * multisine(rng, N, 1.0, 0, 0.02)
    u = np.column_stack([flow, sun])
    return u, simulate(balance, [35, 50, 65], u, 0.6)[0][:, 2]


def canal(rng, N):
    """Let water into a canal of two reaches behind weirs; both levels."""

    def balance(x, u):
        over = [1.6 * max(h - 0.5, 0) ** 1.5 for h in x]
        return [(u[0] - over[0]) / 5, (over[0] + 0.3 - over[1] - u[1]) / 8]

    u = np.column_stack(
        [steps(rng, N, 0.2, 1.4, 10, 60), steps(rng, N, 0, 0.4, 10, 60)]
    )
    return u, simulate(balance, [1.2, 1.2], u, 1.0)[0]


def glucose(rng, N):
    """Lower the sugar of blood by insulin that acts late, between meals."""

    def balance(x, u):
        sugar, action, insulin, gut = x
        dose, meal = u
        return [
            -0.02 * (sugar - 5) - action * sugar + 0.05 * gut,
            0.05 * (0.012 * insulin - action),
            0.08 * (dose - insulin),
            meal - 0.05 * gut,
        ]

    dose = steps(rng, N, 0.2, 3.0, 10, 60)
    meals = 2.5 * (rng.random(N) < 0.03)
    u = np.column_stack([dose, meals])
    return u, simulate(balance, [6, 0.01, 1, 1], u, 4.0)[0][:, 0]


def logarithmic(rng, N):
    """Measure a filtered concentration by the logarithm of it."""
    u = steps(rng, N, 0.05, 1.0, 5, 40)
    x = filtered([0.06, 0.04], [1, -1.5, 0.6], u - 0.5)
    return u, np.log10(np.maximum(x + 0.5, 0.02))


def loop_2x2(rng, N):
    """Close saturating feedbacks around a linear plant of two inputs."""

    def update(x, u):
        a, b, c = x
        p, q = tanh(2 * (a + c)), tanh(1.5 * (b - c))
        return [
            0.85 * a + 0.2 * b + 0.4 * u[0] - 0.3 * q,
            0.8 * b - 0.2 * a + 0.3 * u[1] + 0.3 * p,
            0.6 * c + 0.2 * a - 0.25 * p * q,
        ]

    u = np.column_stack([multisine(rng, N, 0.7, 0, 0.15) for _ in range(2)])
    return u, iterate(update, [0, 0, 0], u)[:, :2]


def column(rng, N):
    """Separate two liquids by reflux and heat; top and bottom compositions."""

    def lighter(x):
        return 2.2 * x / (1 + 1.2 * x)

    def balance(x, u):
        reflux, boilup = u
        below = reflux + 1  # of liquid, under the feed of 1 on the middle tray
        gas = [boilup * lighter(z) for z in x]
        bottom, low, feed, high, top = x
        rates = [
            below * low - gas[0] - (below - boilup) * bottom,
            below * (feed - low) + gas[0] - gas[1],
            reflux * high - below * feed + gas[1] - gas[2] + 0.5,
            reflux * (top - high) + gas[2] - gas[3],
            gas[3] - boilup * top,
        ]
        return [r / 3 for r in rates]

    u = np.column_stack(
        [steps(rng, N, 1.3, 1.7, 10, 60), steps(rng, N, 1.8, 2.2, 10, 60)]
    )
    return u, simulate(balance, [0.2, 0.4, 0.5, 0.6, 0.8], u, 0.8)[0][:, [0, 4]]


def cogging(rng, N):
    """Turn a motor over the teeth of its rotor; the speed is measured."""

    def motion(x, u):
        angle, speed = x
        return [speed, 2.0 * u[0] - 0.8 * speed - 0.9 * sin(6 * angle)]

    u = steps(rng, N, -1.5, 1.5, 8, 40)
    return u, simulate(motion, [0, 0], u, 0.08, 6)[0][:, 1]


def trolley(rng, N):
    """Pull a trolley up and down a hill; it rubs, and its place is measured."""

    def motion(x, u):
        place, speed = x
        slope = 0.5 * cos(0.8 * place) * 0.8
        pull = u[0] - 0.6 * place
        return [speed, pull - 3 * sin(slope) - 0.5 * speed - 0.2 * tanh(20 * speed)]

    u = steps(rng, N, -2.5, 2.5, 10, 60)
    return u, simulate(motion, [0, 0], u, 0.15, 6)[0][:, 0]


def mode_pair(rng, N):
    """Filter two inputs by four lightly damped modes; the plant is linear."""
    u = np.column_stack([multisine(rng, N, 1.0, 0, 0.3) for _ in range(2)])
    a = np.convolve([1, -1.7, 0.96], [1, -1.1, 0.9])
    first = filtered([0.1, 0.05], a, u[:, 0]) + filtered([0.2], [1, -0.7], u[:, 1])
    second = filtered([0.1, -0.05], a, u[:, 1])
    return u, np.column_stack([first, second])


LATEST = (
    simulated("loudspeaker", "force factor, stiffness", loudspeaker, split="latest"),
    simulated("series motor", "square of the current", series_motor, split="latest"),
    simulated("converter", "bilinear, boost", converter, split="latest", dt=0.25),
    simulated("shower", "bilinear, 2 x 2", shower, split="latest", N=1_000),
    simulated("rolling ship", "stiffness, damping", rolling_ship, split="latest"),
    simulated("hovering", "behind a regulator", hovering, split="latest", dt=0.05),
    simulated("suspension", "hard stop, 1 x 2", suspension, split="latest", dt=0.1),
    simulated("vessel", "choked outlet", vessel, split="latest", N=800, dt=0.8),
    simulated("collector", "bilinear, disturbance", collector, split="latest"),
    simulated("canal", "weirs, 2 x 2", canal, split="latest", runs=2, N=1_000),
    simulated("glucose", "bilinear, pulses", glucose, split="latest", dt=4.0),
    simulated("logarithmic", "Wiener", logarithmic, split="latest", noise=0.05),
    simulated("loop", "Lur'e, 2 x 2", loop_2x2, split="latest", N=5_000),
    simulated("column", "distillation, 2 x 2", column, split="latest", dt=0.8),
    simulated("cogging", "periodic in an angle", cogging, split="latest", dt=0.08),
    simulated("trolley", "hill, friction", trolley, split="latest", color=0.8),
    simulated("mode pair", "linear", mode_pair, split="latest"),
)

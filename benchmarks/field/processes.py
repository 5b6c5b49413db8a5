"""Simulated processes: levels, flows, temperatures, concentrations.

Every plant is a function ``(rng, N) -> (u, y)`` of a record without noise.
"""

from math import exp, sqrt

import numpy as np

from .case import simulated
from .signals import levels, simulate, steps


def two_tanks(rng, N):
    """Fill a tank that empties into another; the level of the lower is measured."""

    def balance(x, u):
        upper, lower = (sqrt(max(h, 0)) for h in x)
        return [0.06 * u[0] - 0.08 * upper, 0.08 * upper - 0.07 * lower]

    u = steps(rng, N, 0.5, 4, 10, 60)
    return u, simulate(balance, rng.uniform(1, 6, 2), u, 4.0)[0][:, 1]


def overflowing_tank(rng, N):
    """Do the same with an upper tank that spills, and a sensor that saturates."""

    def balance(x, u):
        upper, lower = (sqrt(max(h, 0)) for h in x)
        spill = max(x[0] - 8, 0)
        return [
            0.06 * u[0] - 0.08 * upper - spill,
            0.08 * upper - 0.07 * lower + 0.3 * spill,
        ]

    u = steps(rng, N, 0.5, 6, 10, 60)
    level = simulate(balance, rng.uniform(1, 6, 2), u, 4.0, 8)[0][:, 1]
    return u, np.minimum(level, 10)


def valve(rng, N):
    """Open a valve of equal percentage, in percent; the flow is measured."""

    def flow(x, u):
        stem, rate = x
        return [(u[0] / 100 - stem) / 3, (10 * 50 ** (stem - 1) - rate) / 1.5]

    u = steps(rng, N, 20, 95, 10, 50)
    return u, simulate(flow, [0.5, 1.4], u, 1.0)[0][:, 1]


def exchanger(rng, N):
    """Heat a varying stream by steam; the surface fouls slowly, which is not seen."""
    phase, trend = rng.uniform(0, 2 * np.pi), rng.uniform(-0.1, 0.1)

    def balance(x, u):
        stream, wall, t = x
        transfer = 0.3 * (1 + 0.05 * np.sin(t / 3000 + phase) + trend * t / 2e4)
        return [
            u[0] * (20 - stream) + transfer * (wall - stream),
            0.5 * (120 - wall) - transfer * (wall - stream),
            1.0,
        ]

    u = steps(rng, N, 0.05, 0.5, 10, 50)
    return u, simulate(balance, [60, 90, 0], u, 2.0)[0][:, 0]


def reactor(rng, N):
    """Cool an exothermic stirred tank; its temperature is measured."""

    def balance(x, u):
        concentration, T = x
        rate = 7.2e10 * exp(-8750 / T) * concentration
        return [
            1 - concentration - rate,
            350 - T + 209.2 * rate + 2.092 * (u[0] - T),
        ]

    u = steps(rng, N, 288, 300, 10, 50)
    return u, simulate(balance, [0.8, rng.uniform(325, 340)], u, 0.1, 10)[0][:, 1]


def neutralisation(rng, N):
    """Dose base into a stream of acid; the pH is measured behind two volumes."""

    def mixing(x, u):
        return [(u[0] - x[0]) / 8, (x[0] - x[1]) / 3]

    u = steps(rng, N, -1, 1, 10, 50)
    X, _ = simulate(mixing, rng.uniform(-0.5, 0.5, 2), u, 1.0)
    # titration of a strong acid beside a weak one
    return u, 7 + np.arcsinh(20 * X[:, 1]) / np.log(10) + 0.8 * X[:, 1]


def heater(rng, N):
    """Heat a plate that radiates; a sensor with a lag is measured, in degrees C."""

    def balance(x, u):
        plate, sensor = x
        loss = 0.4 * (plate - 293) + 1.2e-8 * (plate**4 - 293.0**4)
        return [(6 * u[0] - loss) / 60, (plate - sensor) / 8]

    u = levels(rng, N, [0, 25, 50, 75, 100], hold=15)
    X, _ = simulate(balance, [400, 400], u, 5.0)
    return u, X[:, 1] - 273


def bioreactor(rng, N):
    """Feed bacteria; their concentration is measured."""

    def balance(x, u):
        cells, food = x
        growth = 0.5 * food / (0.8 + max(food, 0))
        return [(growth - u[0]) * cells, u[0] * (10 - food) - 2 * growth * cells]

    u = steps(rng, N, 0.05, 0.32, 10, 50)
    return u, simulate(balance, [4, 2], u, 1.0)[0][:, 0]


def three_tanks(rng, N):
    """Fill three connected tanks by three pumps; all levels are measured."""

    def balance(x, u):
        def through(a, b):
            return 0.05 * np.sign(a - b) * sqrt(abs(a - b))

        first, second, third = x
        drain = [0.05 * sqrt(max(h, 0)) for h in x]
        left, right = through(first, second), through(second, third)
        return [
            0.05 * u[0] + 0.01 * u[1] - left - drain[0],
            0.05 * u[1] + left - right - drain[1],
            0.05 * u[2] + 0.01 * u[0] + right - drain[2],
        ]

    u = np.column_stack([steps(rng, N, 0.3, 3, 10, 60) for _ in range(3)])
    return u, simulate(balance, rng.uniform(1, 5, 3), u, 4.0)[0]


def furnace(rng, N):
    """Heat a radiating rod at both ends; five temperatures are measured, in K."""

    def balance(x, u):
        left, right = [x[0], *x[:-1]], [*x[1:], x[-1]]
        power = [8 * u[0], 0, 0, 0, 8 * u[1]]
        return [
            (12 * (a - 2 * T + b) + p - 0.1 * (T - 300) - 1e-8 * (T**4 - 300.0**4)) / 60
            for T, a, b, p in zip(x, left, right, power, strict=True)
        ]

    u = np.column_stack([steps(rng, N, 0, 100, 10, 60) for _ in range(2)])
    return u, simulate(balance, [450] * 5, u, 2.0)[0]


PROCESSES = (
    simulated("two tanks", "roots", two_tanks, split="seen", unit="cm", dt=4.0),
    simulated(
        "overflowing tank",
        "overflow and saturation",
        overflowing_tank,
        split="seen",
        unit="cm",
        dt=4.0,
    ),
    simulated("valve", "equal percentage", valve, split="seen", unit="l/s"),
    simulated(
        "exchanger",
        "bilinear, slow drift",
        exchanger,
        split="unseen",
        unit="K",
        dt=2.0,
    ),
    simulated("reactor", "exothermic", reactor, split="seen", unit="K", dt=6.0),
    simulated(
        "neutralisation",
        "titration curve",
        neutralisation,
        split="unseen",
        unit="pH",
        noise=0.015,
    ),
    simulated("heater", "radiation", heater, split="seen", unit="K", dt=5.0),
    simulated("bioreactor", "Monod", bioreactor, split="unseen", unit="g/l", dt=3600.0),
    simulated("three tanks", "3 x 3", three_tanks, split="seen", unit="cm", dt=4.0),
    simulated("furnace", "2 x 5", furnace, split="unseen", unit="K", dt=2.0),
)

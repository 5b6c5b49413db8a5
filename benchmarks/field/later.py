"""Simulated plants that came when the first rules of the defaults were settled.

Every plant is a function ``(rng, N) -> (u, y)`` of a record without noise.
"""

from math import atan, cos, exp, sin, sqrt, tanh

import numpy as np

from .case import simulated
from .signals import filtered, iterate, levels, multisine, simulate, steps


def boat(rng, N):
    """Push a boat by two propellers; surge and turn rate have quadratic drags."""

    def motion(x, u):
        surge, turn = x
        left, right = (f * abs(f) for f in u)
        return [
            (left + right - 0.3 * surge - 0.4 * surge * abs(surge)) / 4,
            (0.5 * (left - right) - 0.2 * turn - 0.6 * turn * abs(turn)) / 1.5
            - 0.1 * surge * turn,
        ]

    u = np.column_stack([steps(rng, N, -1, 2, 8, 50) for _ in range(2)])
    return u, simulate(motion, [0.5, 0], u, 0.5)[0]


def van_de_vusse(rng, N):
    """Feed a reactor whose product decays again: its response begins backwards."""

    def balance(x, u):
        a, b = x
        return [
            -50 * a - 10 * a * abs(a) + u[0] * (10 - a),
            50 * a - 100 * b - u[0] * b,
        ]

    u = steps(rng, N, 10, 90, 5, 40)
    return u, simulate(balance, [3, 1], u, 0.004, 6)[0][:, 1]


def hydraulic_lift(rng, N):
    """Move a load by a valve and a cylinder; its speed is measured."""

    def motion(x, u):
        stem, pressure, speed = x
        opening = max(min(stem, 1), -1)
        drop = 1.0 - (pressure if opening > 0 else -pressure)
        flow = opening * sqrt(max(drop, 0))
        return [
            (u[0] - stem) / 0.1,
            8 * (flow - speed - 0.02 * pressure),
            6 * pressure - 4.0 * speed * abs(speed) - 1.5 * tanh(20 * speed),
        ]

    u = steps(rng, N, -1.2, 1.2, 5, 40)
    return u, simulate(motion, [0, 0, 0], u, 0.05, 10)[0][:, 2]


def rubbing_motor(rng, N):
    """Drive a motor with a dead zone and dry friction; current and speed are known."""

    def motion(x, u):
        current, speed = x
        voltage = np.sign(u[0]) * max(abs(u[0]) - 0.3, 0)
        return [
            (voltage - current - 0.6 * speed) / 0.05,
            3 * current - 0.4 * speed - 0.5 * tanh(30 * speed),
        ]

    u = multisine(rng, N, 1.2, 0, 0.05)
    return u, simulate(motion, [0, 0], u, 0.05, 8)[0]


def four_tanks(rng, N):
    """Pump into four tanks across; the lower levels are measured, the upper spill."""

    def balance(x, u):
        root = [0.09 * sqrt(max(h, 0)) for h in x]
        spill = [max(h - 6, 0) for h in x[2:]]
        return [
            root[2] - root[0] + 0.03 * u[0],
            root[3] - root[1] + 0.03 * u[1],
            0.05 * u[1] - root[2] - spill[0],
            0.05 * u[0] - root[3] - spill[1],
        ]

    u = np.column_stack([steps(rng, N, 0.5, 4, 15, 80) for _ in range(2)])
    return u, simulate(balance, rng.uniform(1, 4, 4), u, 4.0)[0][:, :2]


def rotary_pendulum(rng, N):
    """Hold a pendulum upright on an arm that rubs; both angles are measured."""

    def motion(x, u):
        _, tilt, arm_rate, rate = x
        push = 6 * u[0] - 4 * arm_rate - 1.5 * tanh(20 * arm_rate)
        swing = 30 * sin(tilt) - 0.8 * cos(tilt) * push - 0.3 * rate
        return [arm_rate, rate, push + 0.5 * sin(tilt) * rate**2, swing]

    def law(x, r):
        arm, tilt, arm_rate, rate = x
        return [1.4 * (arm - r[0]) + 2.2 * arm_rate + 30.5 * tilt + 5.4 * rate]

    r = steps(rng, N, -1.6, 1.6, 30, 120)
    return r, simulate(motion, [0, 0, 0, 0], r, 0.03, 6, law)[0][:, :2]


def cell(rng, N):
    """Load a battery; the voltage follows its charge by a curve."""

    def balance(x, u):
        return [-u[0] / 3000, (0.03 * u[0] - x[1]) / 40]

    u = steps(rng, N, -3, 3, 10, 60)
    u -= 0.9 * u.mean()
    X, _ = simulate(balance, [0.6, 0], u, 5.0)
    charge = np.clip(X[:, 0], 0.02, 0.98)
    open_circuit = 3.2 + 0.9 * charge + 0.06 * np.log(charge / (1 - charge))
    return u, open_circuit - X[:, 1] - 0.02 * u


def two_rooms(rng, N):
    """Heat two rooms by fans in front of one boiler; outside it is warm or cold."""

    def balance(x, u):
        first, second, boiler = x
        a, b, outside = u
        return [
            0.02 * a * (boiler - first) + 0.004 * (outside - first),
            0.02 * b * (boiler - second)
            + 0.006 * (outside - second)
            + 0.01 * (first - second),
            0.05 * (60 - boiler)
            - 0.02 * a * (boiler - first)
            - 0.02 * b * (boiler - second),
        ]

    fans = [steps(rng, N, 0, 1, 10, 60) for _ in range(2)]
    outside = 8 + 5 * multisine(rng, N, 1.0, 0, 0.01)
    u = np.column_stack([*fans, outside])
    return u, simulate(balance, [20, 20, 50], u, 4.0)[0][:, :2]


def rotor(rng, N):
    """Pitch the blades of a wind turbine in changing wind; its speed is measured."""

    def motion(x, u):
        blade, speed = x
        pitch, wind = u
        ratio = speed / max(wind, 0.1)
        lift = (1.2 - 0.25 * blade) * exp(-4 * (ratio - 0.8) ** 2)
        return [(pitch - blade) / 2, (lift * wind**2 / max(speed, 0.2) - speed) / 8]

    pitch = steps(rng, N, 0, 3, 8, 40)
    wind = 1.2 + 0.2 * multisine(rng, N, 1.0, 0, 0.03)
    u = np.column_stack([pitch, wind])
    return u, simulate(motion, [1, 1], u, 1.0)[0][:, 1]


def tire(rng, N):
    """Steer a car: its tires slide at large angles; yaw rate and lateral speed."""

    def motion(x, u):
        slip, yaw = x
        front = sin(1.4 * atan(9 * (u[0] - slip - 0.08 * yaw)))
        rear = sin(1.4 * atan(11 * (-slip + 0.09 * yaw)))
        return [0.4 * (front + rear) - yaw, 6 * front - 6.5 * rear]

    u = multisine(rng, N, 0.06, 0, 0.04)
    return u, simulate(motion, [0, 0], u, 0.05)[0]


def crossing(rng, N):
    """Distort input and output of a linear plant, with a resonance between."""
    u = multisine(rng, N, 1.0, 0, 0.2)
    v = u + 0.3 * u**2 - 0.1 * u**3
    x = filtered([0.3, 0.1], [1, -1.5, 0.8], v)
    return u, np.arctan(0.8 * x) + 0.1 * x


def evaporator(rng, N):
    """Concentrate a liquid: three inputs, three outputs, products of states."""

    def balance(x, u):
        level, share, pressure = x
        feed, steam, product = u
        boiling = 0.5 * steam * (1 + 0.3 * pressure)
        return [
            (feed - boiling - product * sqrt(max(level, 0))) / 10,
            (5 * feed - product * sqrt(max(level, 0)) * share) / (8 + 2 * level),
            (boiling - 2 * pressure) / 4,
        ]

    u = np.column_stack(
        [steps(rng, N, *r, 10, 50) for r in ((1.5, 2.5), (1, 2), (0.8, 1.6))]
    )
    return u, simulate(balance, [1.5, 8, 0.5], u, 1.0)[0]


def prey(rng, N):
    """Feed prey that predators hunt; both are counted."""

    def growth(x, u):
        a, b = x
        eaten = 1.5 * a * b / (0.5 + max(a, 0))
        return [a * (1 - a / 2) - eaten + 0.3 * u[0], 0.6 * eaten - 0.5 * b]

    u = steps(rng, N, 0, 1, 10, 60)
    return u, simulate(growth, [1, 0.5], u, 0.4)[0]


def gear(rng, N):
    """Turn a load through a gear with play; motor and load speed are measured."""

    def motion(x, u):
        twist, motor, load = x
        torque = 40 * (np.sign(twist) * max(abs(twist) - 0.05, 0))
        torque += 0.2 * (motor - load) * (abs(twist) > 0.05)
        return [
            motor - load,
            4 * u[0] - 1.0 * motor - torque,
            torque - 0.6 * load - 0.3 * tanh(10 * load),
        ]

    u = multisine(rng, N, 1.0, 0, 0.08)
    return u, simulate(motion, [0, 0, 0], u, 0.1, 10)[0][:, 1:]


def counted(rng, N):
    """Measure a saturating oscillator by a counter of few steps."""

    def update(x, u):
        p, q = x
        return [
            0.5 * p + 0.3 * q + 0.4 * tanh(3 * p) + 0.2 * u[0],
            0.7 * q - 0.3 * p + u[0],
        ]

    u = levels(rng, N, [-1, -0.5, 0, 0.5, 1], hold=6)
    x = iterate(update, [0, 0], u)[:, 0]
    return u, np.round(x / (0.05 * x.std())) * 0.05 * x.std()


LATER = (
    simulated("boat", "quadratic drags, 2 x 2", boat, split="later", dt=0.5),
    simulated("inverse response", "bilinear reactor", van_de_vusse, split="later"),
    simulated("hydraulic lift", "roots, friction", hydraulic_lift, split="later"),
    simulated("rubbing motor", "dead zone, friction", rubbing_motor, split="later"),
    simulated("four tanks", "roots, overflow, 2 x 2", four_tanks, split="later"),
    simulated("rotary pendulum", "behind a regulator", rotary_pendulum, split="later"),
    simulated("cell", "curve of an integral", cell, split="later", dt=5.0),
    simulated("two rooms", "bilinear, disturbance", two_rooms, split="later"),
    simulated("rotor", "ratio, disturbance", rotor, split="later"),
    simulated("tire", "sliding, 1 x 2", tire, split="later", dt=0.05),
    simulated("crossing", "Hammerstein-Wiener", crossing, split="later"),
    simulated("evaporator", "bilinear, 3 x 3", evaporator, split="later"),
    simulated("prey", "predators", prey, split="later", dt=0.4),
    simulated("gear", "play, 1 x 2", gear, split="later", dt=0.1),
    simulated("counted", "quantized", counted, split="later"),
)

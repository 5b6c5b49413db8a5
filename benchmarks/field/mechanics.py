"""Simulated machines: servos, joints, oscillators, a ball in the air and on a beam.

Every plant is a function ``(rng, N) -> (u, y)`` of a record without noise.
"""

from math import cos, sin, tanh

import numpy as np

from .case import simulated
from .signals import multisine, simulate, steps


def servo_position(rng, N):
    """Drive a motor with dry friction to positions; the voltage is recorded."""

    def motion(x, u):
        speed = x[1]
        return [speed, (-speed + 2 * u[0] - 0.8 * tanh(speed / 0.05)) / 0.15]

    def regulator(x, r):
        return [min(max(2 * (r[0] - x[0]), -10), 10)]

    r = steps(rng, N, -3, 3, 15, 60)
    X, U = simulate(motion, [rng.uniform(-1, 1), 0], r, 0.02, law=regulator)
    return U, X[:, 0]


def servo_speed(rng, N):
    """Drive a load through a gear with play; the speed of the load is measured."""

    def motion(x, u):
        motor, twist, load = x
        engaged = abs(twist) > 0.05
        torque = 60 * (twist - 0.05 * np.sign(twist)) if engaged else 0.0
        torque += 0.5 * (motor - load)
        return [
            (u[0] - motor - 0.8 * tanh(motor / 0.1) - torque) / 0.2,
            motor - load,
            (torque - 0.5 * load - 0.3 * tanh(load / 0.1)) / 0.4,
        ]

    u = steps(rng, N, -6, 6, 5, 40)
    return u, simulate(motion, [0, 0, rng.uniform(-1, 1)], u, 0.02)[0][:, 2]


def levitation(rng, N):
    """Let a ball hover at a reference, in mm of the gap, by a saturating coil."""

    def motion(x, r):  # gap and current relative to those at rest
        gap, speed, current = x
        command = 1 + 1.815 * (gap - 1 - r[0] / 10) + 0.0122 * speed
        command = min(max(command, 0), 3)
        fall = 981 * (1 - (current / gap) ** 2)
        return [speed, fall, (command - current) / 0.003]

    r = steps(rng, N, -1.2, 1.2, 10, 50)
    X, _ = simulate(motion, [1 + 0.05 * rng.standard_normal(), 0, 1], r, 0.005)
    return r, 10 * X[:, 0]


def robot_joint(rng, N):
    """Move a hanging link through a stiffening joint; its angle is measured."""

    def motion(x, u):
        link, link_speed, motor, motor_speed = x
        twist = motor - link
        spring = 60 * (twist + 4 * twist**3)
        return [
            link_speed,
            -10 * sin(link) + spring - 0.5 * link_speed,
            motor_speed,
            (u[0] - spring - 2 * motor_speed) / 0.6,
        ]

    u = steps(rng, N, -9, 9, 10, 60)
    start = rng.uniform(-0.3, 0.3)
    X, _ = simulate(motion, [start, 0, start, 0], u, 0.02, 6)
    return u, X[:, 0]


def drone_arm(rng, N):
    """Lift an arm by a propeller: the thrust goes with the square of the command."""

    def motion(x, u):
        return [x[1], -6 * sin(x[0]) + 8 * u[0] * abs(u[0]) - x[1]]

    u = steps(rng, N, 0.05, 0.85, 10, 60)
    X, _ = simulate(motion, [rng.uniform(0, 0.5), 0], u, 0.05)
    return u, np.degrees(X[:, 0])


def ball_on_beam(rng, N):
    """Roll a ball to a reference by a beam that turns only so far."""

    def motion(x, r):
        position, speed, angle = x
        command = 0.32 * (position - r[0]) + 0.26 * speed
        turn = (min(max(command, -0.1), 0.1) - angle) / 0.05
        roll = 5 / 7 * (position * turn**2 - 9.81 * sin(angle))
        return [speed, roll, turn]

    r = steps(rng, N, -0.4, 0.4, 30, 120)
    X, _ = simulate(motion, [rng.uniform(-0.1, 0.1), 0, 0], r, 0.05)
    return r, X[:, 0]


def saturating_motor(rng, N):
    """Drive a fan by a motor whose iron saturates."""

    def motion(x, u):
        current, speed = x
        torque = 0.75 * tanh(current / 1.5)
        drag = 0.02 * speed + 0.004 * abs(speed) * speed
        return [(u[0] - current - 0.3 * speed) / 0.05, (torque - drag) / 0.1]

    u = steps(rng, N, -8, 8, 10, 60)
    return u, simulate(motion, [0, rng.uniform(-3, 3)], u, 0.02)[0][:, 1]


def pendulum(rng, N):
    """Push a pendulum to large angles."""

    def motion(x, u):
        return [x[1], -25 * sin(x[0]) - 1.2 * x[1] + u[0]]

    u = multisine(rng, N, 6, 0, 0.06)
    return u, simulate(motion, [rng.uniform(-1, 1), 0], u, 0.05, 6)[0][:, 0]


def duffing(rng, N):
    """Shake a mass on a hardening spring."""

    def motion(x, u):
        return [x[1], -x[0] - 0.2 * x[1] - 0.5 * x[0] ** 3 + u[0]]

    u = multisine(rng, N, 0.6, 0, 0.1)
    return u, simulate(motion, [rng.uniform(-0.5, 0.5), 0], u, 0.3)[0][:, 0]


def nonlinear_damping(rng, N):
    """Shake an oscillator whose damping grows with the square of its position."""

    def motion(x, u):
        return [x[1], -x[0] - (0.1 + x[0] ** 2) * x[1] + u[0]]

    u = steps(rng, N, -2, 2, 5, 30)
    return u, simulate(motion, [rng.uniform(-1, 1), 0], u, 0.3)[0][:, 0]


def hysteresis(rng, N):
    """Shake a mass on a spring of the kind of Bouc and Wen, in mm."""

    def motion(x, u):
        z = x[2]
        stick = 1e3 * (0.8 * abs(x[1]) * z - 1.1 * x[1] * abs(z))
        return [x[1], (u[0] - 10 * x[1] - 5e4 * x[0] - z) / 2, 5e4 * x[1] - stick]

    u = multisine(rng, N, 120, 5 / 750, 120 / 750)
    return u, 1e3 * simulate(motion, [0, 0, 0], u, 1 / 750, 8)[0][:, 0]


def crane(rng, N):
    """Move a trolley at a commanded speed; the angle of its load is measured."""

    def motion(x, u):
        swing = -9.81 * sin(x[0]) - 0.4 * x[1] - cos(x[0]) * (u[0] - x[2]) / 0.3
        return [x[1], swing, (u[0] - x[2]) / 0.3]

    u = steps(rng, N, -3, 3, 10, 50)
    X, _ = simulate(motion, [rng.uniform(-0.3, 0.3), 0, 0], u, 0.1)
    return u, np.degrees(X[:, 0])


MACHINES = (
    simulated(
        "servo position",
        "integrator and friction, closed loop",
        servo_position,
        split="seen",
        unit="rad",
        dt=0.02,
        noise=0.005,
        N=3_000,
    ),
    simulated(
        "servo speed",
        "friction and play",
        servo_speed,
        split="unseen",
        unit="rad/s",
        dt=0.02,
    ),
    simulated(
        "levitation",
        "behind a regulator",
        levitation,
        split="seen",
        unit="mm",
        dt=0.005,
    ),
    simulated(
        "ball on beam",
        "behind a regulator",
        ball_on_beam,
        split="unseen",
        unit="m",
        dt=0.05,
        N=3_000,
        noise=0.005,
    ),
    simulated(
        "robot joint", "flexible link", robot_joint, split="seen", unit="rad", dt=0.02
    ),
    simulated(
        "drone arm", "quadratic input", drone_arm, split="seen", unit="deg", dt=0.05
    ),
    simulated(
        "saturating motor",
        "saturation inside",
        saturating_motor,
        split="seen",
        unit="rad/s",
        dt=0.02,
    ),
    simulated(
        "pendulum", "softening spring", pendulum, split="unseen", unit="rad", dt=0.05
    ),
    simulated(
        "Duffing", "hardening spring", duffing, split="seen", dt=0.3, noise=0.005
    ),
    simulated(
        "nonlinear damping", "damping", nonlinear_damping, split="unseen", dt=0.3
    ),
    simulated(
        "hysteresis",
        "memory",
        hysteresis,
        split="seen",
        unit="mm",
        dt=1 / 750,
        N=4_000,
    ),
    simulated("crane", "load on a rope", crane, split="unseen", unit="deg", dt=0.1),
)

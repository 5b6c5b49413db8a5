"""Fourteen more plants, by someone who knew neither the package nor any result.

Every plant is a function ``(rng, N) -> (u, y)`` of a record without noise.
"""

from math import cos, exp, hypot, sin, sqrt, tanh

import numpy as np

from .case import simulated
from .signals import levels, multisine, simulate, steps


def _clip(x, low, high):
    return max(low, min(x, high))


def _dead(x, half):
    """Return what exceeds a dead zone of the half width."""
    return x - half if x > half else x + half if x < -half else 0.0


def tanker(rng, N):
    """Steer a tanker that is unstable on its course, behind an autopilot; heading."""

    def yaw(x, u):
        rudder, moment, rate, _ = x
        return [
            _clip((u[0] - rudder) / 1.5, -2.5, 2.5),
            (rudder - moment) / 6,
            (0.5 * rate - 2.5 * rate**3 + 0.05 * moment) / 40,
            rate,
        ]

    def law(x, r):
        return [_clip(2 * (r[0] - x[3]) - 60 * x[2] + r[1], -30, 30)]

    r = np.column_stack([steps(rng, N, -20, 20, 30, 90), multisine(rng, N, 6, 0, 0.12)])
    x0 = [0, 0, rng.uniform(-0.1, 0.1), rng.uniform(-10, 10)]
    X, u = simulate(yaw, x0, r, 4.0, 6, law)
    return u, X[:, 3]


def drum(rng, N):
    """Feed a boiler drum whose level swells with the steam, behind a regulator."""

    def balance(x, u):
        feed, valve, _water, bubbles, p = x
        steam = valve * p
        return [
            (u[0] - feed) / 3,
            (u[1] - valve) / 2,
            (feed - steam) / 20,
            (steam / p**1.5 - 0.25 * (feed - 1) - bubbles) / 8,
            (1.05 - steam * (0.8 + 0.1 * p) - 0.12 * feed) / 30,
        ]

    def level(x):
        return x[2] + 0.3 * (x[3] - 1)

    total = [0.0]

    def law(x, r):
        e = r[0] - level(x)
        total[0] = _clip(total[0] + 0.02 * e, -0.8, 0.8)
        return [_clip(1 + 0.9 * e + total[0] + r[1], 0, 2), r[2]]

    r = np.column_stack(
        [
            steps(rng, N, -0.25, 0.25, 40, 120),
            multisine(rng, N, 0.15, 0, 0.15),
            steps(rng, N, 0.8, 1.25, 20, 80),
        ]
    )
    x0 = [1, 1, rng.uniform(-0.2, 0.2), 1, rng.uniform(0.95, 1.1)]
    X, u = simulate(balance, x0, r, 2.0, 4, law)
    return u, np.column_stack([200 * level(X.T), 60 * X[:, 4]])


def tower_crane(rng, N):
    """Slew a crane by a hydraulic motor, with no regulator; its angle and the sway."""

    def motion(x, u):
        spool, p, rate, _, sway, speed = x
        o = _dead(_clip(spool, -0.8, 0.8), 0.15)
        flow = o * sqrt(max(1 - p if o > 0 else 1 + p, 0.0))
        force = 0.15 * sway
        turn = (p - 0.25 * rate - 0.06 * tanh(25 * rate) + force) / 5
        return [
            (u[0] - spool) / 0.25,
            4 * (flow - rate - 0.06 * p),
            turn,
            0.25 * rate,
            speed,
            -1.2 * sin(sway) - 0.04 * speed - 0.6 * turn * cos(sway),
        ]

    # a plan of moves in turns, by what they should turn
    plan, angle = [], 0.0
    while len(plan) < N:
        hold = int(rng.integers(6, 45))
        joystick = rng.uniform(0.15, 1) * rng.choice([-1, 1])
        if rng.random() < 0.25:
            joystick = 0.0
        if abs(angle) > 0.8 and joystick * angle > 0:
            joystick = -joystick
        plan += [joystick] * hold
        angle += 0.2 * hold * 0.25 * _dead(_clip(joystick, -0.8, 0.8), 0.15)
    u = np.array(plan[:N])
    x0 = [0, 0, 0, rng.uniform(-0.5, 0.5), rng.uniform(-0.1, 0.1), 0]
    X, _ = simulate(motion, x0, u, 0.2, 8)
    return u, np.degrees(X[:, 3:5])


def fighter(rng, N):
    """Pitch an unstable aircraft behind a regulator; pitch rate and incidence."""

    def motion(x, u):
        a, q, d = x
        return [
            q - 0.9 * tanh(3 * a) / 3 - 0.08 * d,
            3 * a - 14 * a**3 - (1.2 + 2 * abs(a)) * q - 8 * d * cos(2 * a),
            _clip(20 * (u[0] - d), -1, 1),
        ]

    def law(x, r):
        return [_clip(0.5 * (x[1] - r[0]) + 0.6 * x[0] + r[1], -0.4, 0.4)]

    r = np.column_stack(
        [steps(rng, N, -0.4, 0.4, 15, 70), multisine(rng, N, 0.035, 0, 0.15)]
    )
    x0 = [rng.uniform(-0.1, 0.1), 0, 0]
    X, u = simulate(motion, x0, r, 0.05, 4, law)
    return np.degrees(u), np.degrees(X[:, [1, 0]])


def compressor(rng, N):
    """Hold a compressor in front of its surge by a valve; pressure is measured."""

    def gas(x, u):
        flow, p, throttle, valve = x
        z = flow / 0.25 - 1
        rise = 0.3 + 0.18 * (1 + 1.5 * z - 0.5 * z**3)
        drop = 0.25 * flow * abs(flow) / max(valve, 0.2) ** 2
        return [
            1.3 * (rise - drop - p),
            (flow - throttle * sqrt(max(p, 0.0))) / 1.3,
            (u[0] - throttle) / 0.8,
            (u[1] - valve) / 0.15,
        ]

    def law(x, r):
        return [r[0], _clip(0.65 - 5 * (x[0] - r[1]) + r[2], 0.3, 1.2)]

    throttle = steps(rng, N, 0.45, 0.62, 20, 80)
    r = np.column_stack(
        [
            throttle + multisine(rng, N, 0.01, 0, 0.1),
            0.72 * throttle + steps(rng, N, -0.02, 0.02, 20, 60),
            multisine(rng, N, 0.06, 0, 0.2),
        ]
    )
    x0 = [0.72 * throttle[0], rng.uniform(0.5, 0.6), throttle[0], 0.65]
    X, u = simulate(gas, x0, r, 0.4, 6, law)
    return u, X[:, 1]


def inverter(rng, N):
    """Feed a grid through a filter whose chokes saturate; currents in two axes."""

    def circuit(x, u):
        a, b, c, d, p, q = x
        size = hypot(a, b)
        choke = 0.1 * (0.45 + 0.55 / (1 + size**2))
        dead = 0.03 / (size + 0.05)
        return [
            (u[0] - dead * a - c - 0.03 * a) / choke + b,
            (u[1] - dead * b - d - 0.03 * b) / choke - a,
            (a - p) / 0.05 + d,
            (b - q) / 0.05 - c,
            (c - 1 - 0.02 * p) / 0.05 + q,
            (d - 0.02 * q) / 0.05 - p,
        ]

    u = np.column_stack(
        [
            1 + levels(rng, N, [-0.1, -0.05, 0, 0.05, 0.1], 15),
            levels(rng, N, [0, 0.06, 0.12, 0.18], 20),
        ]
    )
    u += np.column_stack([multisine(rng, N, 0.03, 0.02, 0.4) for _ in range(2)])
    p, q = rng.uniform(-0.5, 0.5, 2)
    X, _ = simulate(circuit, [p, q, 1, 0, p, q], u, 0.05, 6)
    return u, 20 * X[:, 4:]


def anaesthesia(rng, N):
    """Infuse two drugs that work together; an index of the brain is measured."""

    def body(x, u):
        a, stored, sleep, b, calm, shown = x
        dose = sleep + 0.5 * calm + 0.4 * sleep * calm
        index = 97 / (1 + dose**2.3)
        return [
            0.55 * u[0] - 0.5 * a + 0.05 * stored,
            0.06 * a - 0.05 * stored,
            0.45 * (a - sleep),
            0.7 * (u[1] - b),
            0.6 * (b - calm),
            (index - shown) / 0.4,
        ]

    n = int(rng.integers(int(0.6 * N), N + 1))  # not all patients take as long
    u = np.column_stack(
        [steps(rng, n, 0.0, 1.2, 8, 40), levels(rng, n, [0, 0.3, 0.6, 0.9], 12)]
    )
    s = rng.uniform(0.3, 1)
    X, _ = simulate(body, [s, s, s, 0.4, 0.4, 97 / (1 + s**2.3)], u, 0.5)
    return u, X[:, 5]


def fuel_cell(rng, N):
    """Load a fuel cell while its membrane dries or wets, which is not seen."""

    def stack(x, u):
        i, loss, oxygen, air, heat = x
        warm = heat - 60
        act = 0.28 + 0.06 * np.log(max(i, 0.02) / max(oxygen, 0.05)) - 0.001 * warm
        return [
            (u[0] - i) / 0.5,
            (float(act) - loss) / 1.5,
            (air - i - 1.2 * (oxygen - 0.2) * air) / 2,
            (u[1] - air) / 1.5,
            (14 * i * (0.5 + loss + u[2] * i) - 0.35 * (heat - 25)) / 40,
        ]

    slow = multisine(rng, N, 1, 0, 3 / N)
    ohm = 0.2 * np.exp(0.15 * slow)
    u = np.column_stack(
        [steps(rng, N, 0.15, 1.1, 8, 50), steps(rng, N, 1.3, 2.2, 15, 70)]
    )
    x0 = [0.5, 0.2, 0.8, 1.6, rng.uniform(35, 55)]
    X, _ = simulate(stack, x0, np.column_stack([u, ohm]), 1.0, 4)
    i, loss, _, _, heat = X.T
    drop = ohm * (1 - 0.006 * (heat - 45)) * i
    return u, np.column_stack([1000 * (1.15 - loss - drop), heat])


def damper(rng, N):
    """Turn a damper of a duct by a motor and a linkage with play; the air flow."""

    def duct(x, u):
        motor, blade, flow, sensor = x
        open_ = 0.06 * exp(2.8 * blade)
        return [
            _clip(2 * (u[0] - motor), -0.12, 0.12),
            12 * _dead(motor - blade, 0.07),
            (1 - flow * abs(flow) * (0.5 + 0.15 / open_)) / 2,
            (flow - sensor) / 1.5,
        ]

    u = np.clip(steps(rng, N, 0, 1, 8, 30) + multisine(rng, N, 0.1, 0, 0.05), 0, 1)
    m = rng.uniform(0.2, 0.8)
    X, _ = simulate(duct, [m, m, 0.7, 0.7], u, 1.0, 12)
    return u, 400 * X[:, 3]


def building(rng, N):
    """Shake a building of three floors that a driven mass calms; the roof moves."""

    def motion(x, u):
        a, b, c, m, va, vb, vc, vm, force = x
        ground = u[0]
        s = 90 * a * (1 + 0.3 * a * a) + 0.3 * va
        t = 80 * (b - a) * (1 + 0.3 * (b - a) ** 2) + 0.2 * (vb - va)
        r = 70 * (c - b) + 0.2 * (vc - vb)
        k = 0.6 * (m - c) + 0.04 * (vm - vc) + force
        return [
            va,
            vb,
            vc,
            vm,
            t - s - ground,
            r - t - ground,
            k - r - ground,
            -k / 0.05 - ground,
            (u[1] - force) / 0.05,
        ]

    u = np.column_stack(
        [multisine(rng, N, 2, 0.005, 0.25), multisine(rng, N, 0.8, 0.005, 0.25)]
    )
    x0 = [0] * 4 + list(rng.uniform(-0.5, 0.5, 3)) + [0, 0]
    X, _ = simulate(motion, x0, u, 0.1, 6)
    return u, 10 * X[:, 2]


def idle_engine(rng, N):
    """Idle an engine by air and spark under load; speed and manifold pressure."""

    def engine(x, u):
        throttle, p, first, second, n = x
        part = 1.0 if p < 0.5 else 2 * sqrt(max(p - p * p, 0.0))
        spark = 1 - 0.15 * (u[1] - 0.5) ** 2
        torque = 2 * second * spark - 0.3 - 0.2 * n - u[2]
        return [
            (u[0] - throttle) / 0.15,
            4 * (throttle * part - n * p),
            8 * n * (p - first),
            8 * n * (first - second),
            torque / 0.9,
        ]

    u = np.column_stack(
        [
            np.clip(steps(rng, N, 0.22, 0.4, 15, 60), 0.2, 0.45),
            levels(rng, N, [-0.6, 0, 0.5, 1], 6),
            levels(rng, N, [0.05, 0.12, 0.22], 25),
        ]
    )
    u[:, 0] += multisine(rng, N, 0.01, 0, 0.2)
    x0 = [0.3, 0.35, 0.35, 0.35, rng.uniform(0.7, 1)]
    X, _ = simulate(engine, x0, u, 0.12, 4)
    return u, np.column_stack([1000 * X[:, 4], 100 * X[:, 1]])


def air_muscle(rng, N):
    """Bend an arm by two muscles of air behind slow valves; its angle is measured."""

    def valve(wish, p):
        return _clip(15 * _dead(_clip(wish, 0, 1) - p, 0.04), -1.2, 2.5)

    def arm(x, u):
        a, b, q, v, z = x
        g = 0.06 + 0.05 * (a + b)
        slip = v - 20 * abs(v) * z
        pull = 4 * (a * (1 - 0.7 * q) ** 2 - b * (1 + 0.7 * q) ** 2)
        return [
            valve(u[0], a),
            valve(u[1], b),
            v,
            (pull - 3 * sin(q) - 0.8 * v - 20 * g * z) / 0.15,
            slip,
        ]

    u = np.column_stack([steps(rng, N, -0.05, 1.1, 8, 40) for _ in range(2)])
    x0 = [rng.uniform(0.2, 0.6), rng.uniform(0.2, 0.6), 0, 0, 0]
    X, _ = simulate(arm, x0, u, 0.05, 8)
    return u, np.degrees(X[:, 2])


def chlorine(rng, N):
    """Dose chlorine by a pump with a dead zone, far before the analyser."""

    def water(x, u):
        pump, pipe, tank, cell = x
        dose = _clip(u[0] - 0.2, 0, 0.6) / 0.6
        return [
            (dose - pump) / 0.7,
            (2 * pump - pipe) / 2,
            (pipe - tank) / 5 - 0.12 * tank * tank,
            (tank - cell) / 1.5,
        ]

    late = 9
    u = steps(rng, N + late, 0, 1, 8, 40)
    c = rng.uniform(0.4, 0.9)
    X, _ = simulate(water, [0.5, 1, c, c], u[:N], 1.0)
    return u[late:], X[:, 3]


def treadmill(rng, N):
    """Run on a belt; the heart follows the square of the speed and slowly warms up."""

    def heart(x, u):
        pulse, strain, legs = x
        wish = 8 + 0.75 * legs * legs + strain
        warm = 0.35 * pulse / (1 + exp((45 - pulse) / 8))
        return [
            (wish - pulse) / (25 if wish > pulse else 45),
            (warm - strain) / 300,
            (u[0] - legs) / 6,
        ]

    u = steps(rng, N, 3, 10.5, 6, 24)
    v = u[0]
    X, _ = simulate(heart, [rng.uniform(20, 50), rng.uniform(0, 8), v], u, 10.0, 6)
    return u, 66 + X[:, 0]


def _case(name, kind, run, **options):
    return simulated(name, kind, run, split="independent", **options)


FURTHER = {
    case.name: case
    for case in (
        _case("tanker", "integrator in a loop", tanker, N=600, dt=4.0),
        _case("drum", "integrator in a loop, 2 x 2", drum, dt=2.0, noise=0.02),
        _case("tower crane", "integrator, sway, 1 x 2", tower_crane, N=2_500, dt=0.2),
        _case("fighter", "unstable, 1 x 2, in a loop", fighter, N=3_000, dt=0.05),
        _case("compressor", "unstable, 2 x 1, in a loop", compressor, dt=0.4),
        _case("inverter", "resonance, 2 x 2", inverter, N=4_000, dt=0.05, noise=0.005),
        _case("anaesthesia", "2 x 1", anaesthesia, N=500, dt=0.5, noise=0.04, runs=3),
        _case("fuel cell", "2 x 2, drifts", fuel_cell, N=1_500),
        _case("damper", "play, short", damper, N=600, noise=0.02, color=0.7),
        _case("building", "nearly linear, 2 x 1", building, dt=0.1, noise=0.05),
        _case("idle engine", "3 x 2, long", idle_engine, N=8_000, dt=0.12, noise=0.02),
        _case("air muscle", "2 x 1, rates, friction", air_muscle, N=1_000, dt=0.05),
        _case("chlorine", "dead zone, delay", chlorine, N=1_200, noise=0.015),
        _case("treadmill", "square, short", treadmill, N=300, dt=10.0, noise=0.03),
    )
}

"""Simulated plants by someone who did not write the package, before any result.

None was left out afterwards.  Every plant is a function ``(rng, N) -> (u, y)`` of a
record without noise.
"""

from math import cos, exp, sin, sqrt, tanh

import numpy as np

from .case import simulated
from .signals import levels, multisine, simulate, steps


def peltier(rng, N):
    """Cool a plate by a thermoelectric element; its own heat reverses the gain."""

    def heat(x, u):
        cold, hot, sensor = x
        i = u[0]
        joule, lead = i * i, 0.5 * (hot - cold)
        return [
            (-0.05 * i * (cold + 273) + joule + lead + 0.3 * (22 - cold)) / 20,
            (0.05 * i * (hot + 273) + joule - lead + 3 * (22 - hot)) / 150,
            (cold - sensor) / 4,
        ]

    u = steps(rng, N, -0.5, 3.5, 10, 50)
    c = rng.uniform(-5, 20)
    return u, simulate(heat, [c, 30, c], u, 2.0)[0][:, 2]


def synchronous(rng, N):
    """Drive a saturating motor behind two regulators; speed is not measured."""

    def motion(x, u):
        d, q, w = x
        lq = 0.6 + 0.6 / (1 + q * q)
        return [
            (u[0] - 0.5 * d + w * lq * q) / 0.8,
            (u[1] - 0.5 * q - w * (0.8 * d + 1)) / lq,
            (1.5 * (q + (0.8 - lq) * d * q) - 0.3 * w) / 6,
        ]

    total = [0.0, 0.0]

    def law(x, r):
        out = []
        for k in range(2):
            e = r[k] - x[k]
            total[k] = max(-4, min(total[k] + 0.12 * e, 4))
            out.append(max(-4, min(0.8 * e + total[k] + r[2 + k], 4)))
        return out

    r = np.column_stack(
        [
            levels(rng, N, [-0.8, -0.4, 0], 40),
            levels(rng, N, [-1.2, -0.3, 0.5, 1.5], 30),
            multisine(rng, N, 0.25, 0, 0.2),
            multisine(rng, N, 0.25, 0, 0.2),
        ]
    )
    X, u = simulate(motion, [0, 0, rng.uniform(-1, 1)], r, 0.2, 6, law)
    return u, X[:, :2]


def turbine(rng, N):
    """Open the gate of a turbine below a surge tank; power goes backwards first."""

    def water(x, u):
        gate, flow, surge, tunnel = x
        head = (flow / gate) ** 2
        return [
            max(-0.15, min(2 * (u[0] - gate), 0.15)),
            (surge - head) / 1.2,
            (tunnel - flow) / 10,
            (1 - surge - 0.08 * tunnel * abs(tunnel)) / 5,
        ]

    u = np.clip(0.65 + multisine(rng, N, 0.14, 0, 0.06), 0.3, 1)
    X, _ = simulate(water, [0.6, 0.6, rng.uniform(0.9, 1.05), 0.6], u, 0.4, 6)
    return u, 40 * X[:, 1] ** 3 / X[:, 0] ** 2


def stage(rng, N):
    """Push a sprung stage with presliding friction, and a load on a soft coupling."""

    def motion(x, u):
        p, v, z, q, w = x
        g = 0.25 + 0.2 * exp(-((v / 0.1) ** 2))
        dz = v - 30 * abs(v) * z / g
        pull = 20 * (q - p) + 0.3 * (w - v)
        return [
            v,
            u[0] - 1.5 * p - 0.3 * v - 30 * z - 0.5 * dz + pull,
            dz,
            w,
            -2 * pull,
        ]

    u = multisine(rng, N, 0.5, 0, 0.15) + steps(rng, N, -1, 1, 20, 80)
    p = rng.uniform(-0.3, 0.3)
    X, _ = simulate(motion, [p, 0, 0, p, 0], u, 0.08, 30)
    return u, 50 * X[:, 3]


def mould(rng, N):
    """Hold the level of a caster by a stopper, behind a regulator."""

    def level(x, u):
        s, h, m = x
        open_ = max(s, 0.0) ** 1.5
        flow = 1.5 * open_ / (0.4 + open_)
        return [(u[0] - s) / 0.5, 8 * (flow - u[1]), (h - m) / 0.6]

    total = [0.45]

    def law(x, r):
        e = r[0] - x[2]
        total[0] += 0.0025 * e
        return [max(0.05, min(total[0] + 0.03 * e + r[2], 1.6)), r[1]]

    r = np.column_stack(
        [
            100 + steps(rng, N, -8, 8, 30, 90),
            levels(rng, N, [0.4, 0.6, 0.8], 45),
            multisine(rng, N, 0.07, 0, 0.2),
        ]
    )
    h = 100 + rng.uniform(-8, 8)
    X, u = simulate(level, [0.5, h, h], r, 0.4, 6, law)
    return u, X[:, 2]


def muscle(rng, N):
    """Stimulate a muscle; it has a dead zone, falls slower than it rises, and tires."""

    def tissue(x, u):
        a, b, f = x
        r = max(0.0, tanh(2.2 * (u[0] - 0.25)))
        tired = (1 - f) / 25 - 0.08 * b * f
        return [(r - a) / (0.08 if r > a else 0.2), (a - b) / 0.1, tired]

    u = steps(rng, N, 0, 1, 6, 30)
    X, _ = simulate(tissue, [0, 0, rng.uniform(0.6, 1)], u, 0.05)
    return u, 5 + 40 * X[:, 1] * X[:, 2]


def airpath(rng, N):
    """Charge a diesel engine by turbine vanes and recirculation; boost and air flow."""

    def compressed(power, p):
        return 1.2 * power / (max(p, 1.02) ** 0.283 - 1 + 0.02)

    def gas(x, u):
        v, e, p, px, power = x
        back = e * sqrt(max(px * (px - p), 0))
        turb = v * px * sqrt(max(1 - 1 / px**2, 0)) if px > 1 else 0.0
        work = 1.1 * turb * (1 - max(px, 1.0) ** -0.283)
        return [
            (u[0] - v) / 0.4,
            (u[1] - e) / 0.25,
            2 * (compressed(power, p) + back - 0.8 * p),
            3 * (0.8 * p + 0.06 - back - turb),
            (work - power) / 2.5,
        ]

    vanes = levels(rng, N, [0.5, 0.6, 0.75, 0.95], 12)
    u = np.column_stack([vanes, levels(rng, N, [0, 0.1, 0.2, 0.3], 9)])
    X, _ = simulate(gas, [0.7, 0.1, 1.3, 1.6, rng.uniform(0.05, 0.15)], u, 0.4, 10)
    flow = [compressed(power, p) for p, power in X[:, [2, 4]]]
    return u, np.column_stack([100 * X[:, 2], 120 * np.array(flow)])


def micromirror(rng, N):
    """Sweep a mirror that is pulled electrostatically, near its pull-in."""

    def motion(x, u):
        p, v = x
        gap = max(1 - p, 0.1)
        stop = 200 * max(p - 0.7, 0)
        pull = 0.25 * u[0] * abs(u[0]) / gap**2
        return [v, pull - p - stop - 0.15 * v / gap**1.5]

    parts, n = [], 0
    while n < N:
        size = int(rng.integers(300, 700))
        f = np.linspace(0.005, 0.14, size)
        f = f[::-1] if rng.random() < 0.5 else f
        wave = np.sin(2 * np.pi * (np.cumsum(f) + rng.random()))
        parts.append(rng.uniform(0.35, 0.5) + rng.uniform(0.05, 0.22) * wave)
        n += size
    u = np.concatenate(parts)[:N]
    return u, simulate(motion, [rng.uniform(0, 0.15), 0], u, 0.5, 10)[0][:, 0]


def driveline(rng, N):
    """Drive and brake a car on a slope, by an elastic shaft and limited power."""

    def motion(x, u):
        torque, twist, engine, v = x
        pedal = u[0]
        wish = 3.2 * pedal * min(1, 12 / max(engine, 1))
        wish = wish if pedal > 0 else 0.8 * max(pedal, -0.3)
        brake = 5 * max(-pedal - 0.1, 0) * tanh(2 * v)
        shaft = 9 * twist + 0.5 * (engine - v)
        drag = 0.003 * v * abs(v) + 0.15 * tanh(2 * v)
        return [
            (wish - torque) / 0.3,
            engine - v,
            (torque - 0.05 * engine - shaft) / 0.6,
            (shaft - brake - drag - 3 * u[1]) / 2.5,
        ]

    slope = 0.12 * multisine(rng, N, 1, 0, 0.01)
    u = np.column_stack([steps(rng, N, -0.35, 1, 8, 50), slope])
    v = rng.uniform(4, 15)
    return u, 3.6 * simulate(motion, [0.5, 0, v, v], u, 0.2, 10)[0][:, 3]


def mill(rng, N):
    """Feed rock and water to a mill and its sump; its power has a maximum."""

    def power(s, w):
        return np.maximum(1 - 0.8 * (s + 0.5 * w - 1.1) ** 2, 0.3)

    def balance(x, u):
        s, w, v, c = x
        ground, out = 0.5 * float(power(s, w)) * s, 0.6 * w * (1 + 0.2 * s)
        return [
            0.2 * (u[0] - ground),
            0.2 * (u[1] - out),
            0.3 * (ground + out + u[2] - 0.7 * v),
            0.3 * (ground - 0.7 * c),
        ]

    ranges = (0.15, 0.42), (0.2, 0.7), (0.1, 0.6)
    u = np.column_stack([steps(rng, N, *limits, 10, 60) for limits in ranges])
    X, _ = simulate(balance, [rng.uniform(0.4, 0.9), 0.7, 1.5, 0.4], u, 1.0)
    density = 1 + 1.7 * X[:, 3] / X[:, 2]
    return u, np.column_stack([800 * power(X[:, 0], X[:, 1]), density])


def bearing(rng, N):
    """Hold a gyroscopic rotor by two pairs of magnets; unstable without regulator."""

    def force(i, p):
        return 0.25 * ((1 + i) ** 2 / (1 - p) ** 2 - (1 - i) ** 2 / (1 + p) ** 2)

    def motion(x, u):
        p, q, v, w = x
        a, b = max(-0.85, min(p, 0.85)), max(-0.85, min(q, 0.85))
        return [
            v,
            w,
            force(u[0], a) - 0.8 * w - 0.02 * v - 40 * (p - a),
            force(u[1], b) + 0.8 * v - 0.02 * w - 40 * (q - b),
        ]

    def law(x, r):
        wish = (1.8 * (r[k] - x[k]) - 1.2 * x[2 + k] + r[2 + k] for k in range(2))
        return [max(-0.95, min(i, 0.95)) for i in wish]

    r = [steps(rng, N, -0.15, 0.15, 20, 80) for _ in range(2)]
    r += [multisine(rng, N, 0.15, 0, 0.12) for _ in range(2)]
    x0 = rng.uniform(-0.1, 0.1, 4)
    X, u = simulate(motion, x0, np.column_stack(r), 0.2, 8, law)
    return u, 100 * X[:, :2]


def swing(rng, N):
    """Drive a generator on a grid by power and field; its electric power is told."""

    def motion(x, u):
        angle, slip, field = x
        return [
            slip,
            u[0] - field * sin(angle) / 0.6 - 0.35 * slip,
            (u[1] - field - 0.8 * (field - cos(angle))) / 6,
        ]

    power = levels(rng, N, [0.3, 0.5, 0.7, 0.9], 8)
    u = np.column_stack([power, levels(rng, N, [1.3, 1.7, 2.1], 12)])
    X, _ = simulate(motion, [rng.uniform(0.2, 0.6), 0, 1.2], u, 0.5, 8)
    return u, X[:, 2] * np.sin(X[:, 0]) / 0.6


def amplifier(rng, N):
    """Amplify by a gain that a detector lowers, fast, and lets rise again, slowly."""

    def circuit(x, u):
        a, b, e = x
        more = abs(a) - e
        return [
            0.8 * (tanh(2 / (0.3 + e) * u[0]) - a) - 0.5 * b,
            0.5 * a,
            (0.25 if more > 0 else 0.02) * more,
        ]

    u = multisine(rng, N, 1, 0.01, 0.2) * steps(rng, N, 0.1, 1.2, 80, 200)
    x0 = [0, 0, rng.uniform(0.1, 0.6)]
    return u, simulate(circuit, x0, u, 1.0, 6)[0][:, 0]


def _case(name, kind, run, **options):
    return simulated(name, kind, run, split="independent", **options)


INDEPENDENT = {
    case.name: case
    for case in (
        _case("peltier", "gain that reverses", peltier, N=600, dt=2.0),
        _case("synchronous", "2 x 2, in a loop", synchronous, N=2_500, noise=0.015),
        _case("turbine", "not minimum phase", turbine, N=3_000, dt=0.4, noise=0.005),
        _case("stage", "presliding, resonance", stage, noise=0.02, color=0.8),
        _case("mould", "integrator in a loop", mould, N=500, noise=0.02, runs=3),
        _case("muscle", "dead zone, tires", muscle, N=400, noise=0.03, runs=3),
        _case("airpath", "2 x 2, gas", airpath, N=1_500, dt=0.4),
        _case("micromirror", "pull-in, resonance", micromirror, N=4_000, dt=0.5),
        _case("driveline", "drive and brake", driveline, dt=0.2),
        _case("mill", "3 x 2, maximum", mill, N=900, runs=2),
        _case("bearing", "unstable, 2 x 2, in a loop", bearing, dt=0.2),
        _case("swing", "generator, 2 x 1, short", swing, N=400, dt=0.5, noise=0.02),
        _case("amplifier", "varying gain", amplifier, N=3_000),
    )
}

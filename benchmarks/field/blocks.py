"""Simulated block structures and maps, and records that are awkward by themselves.

Every plant is a function ``(rng, N) -> (u, y)`` of a record without noise. The awkward
records are short, long, with gaps, in strange units or with strange noise; their plants
are simple.
"""

from functools import partial
from math import tanh

import numpy as np
from scipy.signal import cheby1, cheby2

from .case import Case, fresh, simulated
from .signals import filtered, iterate, levels, multisine, steps

LAG = ([0.1], [1, -1.5, 0.6])  # lightly damped


def dead_zone(rng, N):
    """Filter an input of which the middle is lost."""
    u = steps(rng, N, -3, 3, 4, 30)
    inner = np.sign(u) * np.maximum(np.abs(u) - 1, 0)
    return u, filtered(*LAG, inner)


def saturation(rng, N):
    """Filter and saturate."""
    u = steps(rng, N, -3, 3, 4, 30)
    return u, np.tanh(1.0 * filtered(*LAG, u))


def sandwich(rng, N):
    """Saturate one-sidedly between two filters."""
    u = multisine(rng, N, 1, 0, 0.2)
    first, second = cheby1(3, 0.5, 0.25), cheby2(3, 40, 0.35)
    inner = filtered(*first, u)
    return u, filtered(*second, np.where(inner < 0.3, inner, 0.3 + 0.1 * (inner - 0.3)))


def linear(rng, N):
    """Filter, and nothing else."""
    u = levels(rng, N, [-1, 1], 4)
    return u, filtered([0.2, 0.1], [1, -1.6, 0.83, -0.12], u)


def linear_resonances(rng, N):
    """Filter by two resonances."""
    poles = np.array([0.97 * np.exp(0.3j), 0.95 * np.exp(0.9j)])
    a = np.real(np.poly([*poles, *poles.conj()]))
    return (u := multisine(rng, N, 1, 0, 0.3)), filtered([0.1, 0.05, 0.08], a, u)


def bistable(rng, N):
    """Push a state between two rests."""
    u = rng.standard_normal(N)
    X = iterate(lambda x, v: [0.8 * x[0] + v[0] + 0.5 * tanh(3 * x[0])], [0], u)
    return u, X[:, 0]


def rational(rng, N):
    """Run a map with a rational feedback and a cubic input."""

    def update(x, u):
        return [x[0] / (1 + x[0] ** 2) + u[0] ** 3]

    u = rng.uniform(-1, 1, N)
    return u, iterate(update, rng.uniform(-1, 1, 1), u)[:, 0]


def slow_and_fast(rng, N):
    """Add a fast saturating response and a slow one, time constants 1 to 300."""
    u = steps(rng, N, -2, 2, 5, 300)
    fast, slow = np.exp(-1 / 2), np.exp(-1 / 600)

    def update(x, v):
        return [
            fast * x[0] + (1 - fast) * tanh(2 * v[0]),
            slow * x[1] + (1 - slow) * v[0] * (1 + 0.4 * v[0]),
        ]

    X = iterate(update, [0, rng.uniform(-1, 1)], u)
    return u, X[:, 0] + 2 * X[:, 1]


def delayed(rng, N):
    """Saturate, wait seven samples, filter."""
    u = steps(rng, N, -3, 3, 4, 30)
    return u, filtered(*LAG, np.tanh(u) + 0.1 * u, delay=7)


def stiffening(rng, N):
    """Shake a stiffening resonance."""
    u = multisine(rng, N, 1, 0, 0.12)

    def update(x, v):
        force = v[0] - x[0] - 0.8 * x[0] ** 3
        speed = 0.9 * x[1] + 0.3 * force
        return [x[0] + 0.3 * speed, speed]

    return u, iterate(update, [rng.uniform(-0.5, 0.5), 0], u)[:, 0]


def rooted(rng, N, unit=1.0, offset=0.0):
    """Fill a tank that empties by the root of its level, and measure it elsewhere."""

    def update(x, u):
        level = max(x[0], 0)
        return [level + 0.2 * (u[0] - level**0.5), x[1] + 0.3 * (level - x[1])]

    u = steps(rng, N, 0.3, 2, 5, 40)
    level = iterate(update, rng.uniform(1, 3, 2), u)[:, 1]
    return unit * u, unit * (level + offset)


def with_gaps():
    """Return two experiments with stretches where no output was measured."""
    data = fresh("gaps", rooted, N=1_200, N_test=2_000, runs=2)
    for gap in (slice(200, 260), slice(700, 701), slice(900, 1_000)):
        data.train[0][1][gap] = np.nan
    data.train[1][1][50::7] = np.nan
    return data


BLOCKS = (
    simulated("dead zone", "Hammerstein", dead_zone, split="unseen"),
    simulated("saturation", "Wiener", saturation, split="seen"),
    simulated("sandwich", "Wiener-Hammerstein", sandwich, split="unseen", N=4_000),
    simulated("bistable", "map", bistable, split="seen", N=1_500, noise=0.1),
    simulated("rational", "map", rational, split="unseen"),
    simulated("slow and fast", "stiff", slow_and_fast, split="seen", N=6_000),
    simulated("delay", "input delay", delayed, split="unseen"),
    simulated("linear", "linear", linear, split="seen", noise=0.05),
    simulated(
        "linear resonances", "linear", linear_resonances, split="unseen", noise=0.05
    ),
)

AWKWARD = (
    simulated("short", "300 samples", rooted, split="seen", N=300, N_test=1_000),
    simulated(
        "short saturation",
        "300 samples",
        saturation,
        split="unseen",
        N=300,
        N_test=1_000,
    ),
    simulated(
        "long",
        "100,000 samples",
        stiffening,
        split="unseen",
        N=100_000,
        N_test=10_000,
    ),
    simulated(
        "colored noise",
        "AR(0.9)",
        dead_zone,
        split="seen",
        noise=0.05,
        color=0.9,
    ),
    simulated(
        "drifting sensor",
        "AR(0.99)",
        stiffening,
        split="unseen",
        noise=0.05,
        color=0.99,
    ),
    simulated(
        "large offset",
        "1,000 times the signal",
        partial(rooted, offset=1e3),
        split="unseen",
    ),
    simulated("quiet", "noise 1e-6", stiffening, split="seen", noise=1e-6),
    simulated(
        "small units",
        "1e-9",
        partial(rooted, unit=1e-9),
        split="unseen",
        unit="n",
        scale=1e9,
    ),
    Case("gaps", "two experiments, missing outputs", with_gaps, "seen"),
)

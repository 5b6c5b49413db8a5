"""Does `look` recommend a nonlinear model where a linear one is as good as any?

    python -m benchmarks.nearly_linear [--seeds 80] [--quick]

Oscillators of a random frequency and damping, with a curve at the input or the output,
a hardening spring, or friction that grows with the square of the speed, of a random
strength from a three-hundredth to twice the linear part; 300 to 2,000 samples; a
disturbance of the output from 1 % to 80 %, white, slow, with heavy tails, in bursts or
in jumps, as a test for nonlinearity may take it for one.

The plants are simulated, so that the floor of the error is known: the disturbance.  A
linear model with its defaults is fitted to the record and judged by 3,000 fresh samples
without disturbance.  Counted is how often `look` recommends a nonlinear model where the
linear one, with the disturbance, is within 5 % of the floor, which must not happen, and
what it recommends where the linear model is farther away.  No threshold of `look` was
chosen on these plants.

Without --quick (three seeds) the table goes to doc/benchmarks/nearly_linear.md.
"""

import argparse
import os
import sys
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.signal import lfilter

import alssnn
from benchmarks._tables import OUT, machine

FLOOR = 1.05  # error of the linear model over the disturbance
TEST = 3_000
LENGTHS = (300, 500, 1_000, 2_000)
KINDS = ("curve of the input", "curve of the output", "spring", "friction")
DISTURBANCES = {
    "white": lambda rng, n: rng.standard_normal(n),
    "slow": lambda rng, n: lfilter([1], [1, -0.95], rng.standard_normal(n)),
    "heavy tails": lambda rng, n: rng.standard_t(3, n),
    "bursts": lambda rng, n: (
        rng.standard_normal(n)
        * np.exp(3 * lfilter([0.1], [1, -0.99], rng.standard_normal(n)))
    ),
    "jumps": lambda rng, n: (
        np.repeat(rng.standard_normal(n // 60 + 1), 60)[:n]
        + 0.2 * rng.standard_normal(n)
    ),
}
CLASSES = ("within 5 %", "5 to 20 %", "20 to 100 %", "more")
EDGES = (FLOOR, 1.2, 2.0)


def plant(rng):
    """Return a function of u, from rest, without disturbance."""
    w, damping = rng.uniform(0.1, 0.6), rng.uniform(0.1, 0.8)
    r = np.exp(-damping * w)
    a1, a2 = 2 * r * np.cos(w * np.sqrt(1 - damping**2)), -(r**2)
    kind, even = rng.choice(KINDS), rng.uniform(-1, 1)
    strength = 10 ** rng.uniform(-2.5, 0.3)

    def curve(v):
        return v + strength * (even * v**2 - np.tanh(v) ** 3)

    def run(u):
        now, before, y = 0.0, 0.0, np.empty(len(u))
        for k, one in enumerate(u):
            y[k] = curve(now) if kind == "curve of the output" else now
            v = curve(one) if kind == "curve of the input" else one
            if kind == "spring":
                v -= strength * now**3
            if kind == "friction":
                v -= 3 * strength * (now - before) * abs(now - before)
            now, before = a1 * now + a2 * before + (1 - a1 - a2) * v, now
            now = np.clip(now, -50, 50)
        return y

    return run


def study(seed):
    """Return the error of the linear model over the floor, and what `look` says."""
    rng = np.random.default_rng(50_000 + seed)
    run, n, hold = plant(rng), int(rng.choice(LENGTHS)), int(rng.choice([3, 8, 15]))
    disturbance = DISTURBANCES[rng.choice(list(DISTURBANCES))]
    u, fresh = (
        np.repeat(rng.uniform(-1, 1, m // hold + 1), hold)[:m] for m in (n, TEST)
    )
    clean, e = run(u), disturbance(rng, n)
    level = 10 ** rng.uniform(-2, -0.1) * clean.std()
    y = clean + level * e / e.std()
    wanted = alssnn.look(u, y).recommendation
    linear = alssnn.LinearStateSpace(n_init_samples=30).fit(u, y)
    error = np.subtract(*linear.simulate_test(fresh[:, None], run(fresh)))
    ratio = float(np.hypot(1.0, np.sqrt(np.mean(error**2)) / level))
    return ratio, wanted.estimator.__name__ if wanted else "none"


def main(arguments=None):
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=80)
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args(arguments)
    seeds, load = 3 if options.quick else options.seeds, os.getloadavg()[0]
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for seed in range(seeds):
            found.append(study(seed))
            print(seed, f"{found[-1][0]:.2f}", found[-1][1], flush=True)
    names = ("LinearStateSpace", "FlSsnn", "AlSsnn", "none")
    lines = [
        "| error of the linear model, above the floor by | " + " | ".join(names) + " |",
        "|---|--:|--:|--:|--:|",
    ]
    places = np.digitize([ratio for ratio, _ in found], EDGES)
    for i, label in enumerate(CLASSES):
        row = [
            name for place, (_, name) in zip(places, found, strict=True) if place == i
        ]
        lines.append(f"| {label} | {' | '.join(str(row.count(n)) for n in names)} |")
    print("\n".join(lines))
    if not options.quick:
        head = (
            f"What `look` recommends for {seeds} simulated plants that are linear or "
            "nearly so, by how far a linear model is from the best there can be.\n"
        )
        text = "\n".join([head, *lines, "", machine(load, np, alssnn), ""])
        (OUT / "nearly_linear.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""How often does a record of the same kind, or of another, count as extrapolation?

    python -m benchmarks.extrapolation [--repeats 25] [--quick]

The region of a training record of a linear plant of two states, with 10 % of white
noise at its output, is that of its true states: no model is fitted.  A fresh record of
the same kind and length should be inside, one of 1.3, 1.5 or 2 times the amplitude, or
with the input shifted by 1 or 2 of its standard deviations, outside.  Steps of 25 and
50 samples make few independent ones of a record: 250 samples are 10 and 5 levels.  A
record that a short training cannot judge is open instead of failed.

Holes are what a convex region misses: the middle of a limit cycle, zero between two
levels of the input, levels between levels.

Without --quick it writes doc/benchmarks/extrapolation.md.
"""

import argparse
import platform
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
from scipy.signal import lfilter, ss2tf

import alssnn
from alssnn.linearizability import OUTSIDE, Region

OUT = Path(__file__).parents[1] / "doc" / "benchmarks" / "extrapolation.md"
SEED = 7_000
SAMPLES = (250, 500, 1000, 5000)
SETTLE = 100  # samples before a record begins
A = np.array([[0.9, 0.2], [-0.2, 0.8]])
B = np.array([[0.1], [0.4]])
NUMERATORS, DENOMINATOR = ss2tf(A, B, np.eye(2), np.zeros((2, 1)))
NOISE = 0.1  # of the standard deviation of the training output


def multisine(n, rng):
    """Return a period of a multisine of random phases up to half of Nyquist."""
    phases = np.exp(2j * np.pi * rng.uniform(size=n // 4))
    spectrum = np.concatenate([[0.0], phases, np.zeros(n // 2 - n // 4)])
    u = np.fft.irfft(spectrum, n)
    return np.concatenate([u[-SETTLE:], u]) * np.sqrt(n)


def holds(shortest, longest):
    """Return a signal of random levels that are held for so many samples."""

    def signal(n, rng):
        times = rng.integers(shortest, longest + 1, (n + SETTLE) // shortest + 1)
        levels = rng.uniform(-1, 1, len(times))
        return np.repeat(levels, times)[: n + SETTLE]

    return signal


def periods(n, rng):
    """Return five periods of a multisine."""
    u = multisine(n // 5, rng)[-(n // 5) :]
    return np.tile(u, 6 + SETTLE // len(u))[-n - SETTLE :]


KINDS = {
    "white, Gaussian": lambda n, rng: rng.standard_normal(n + SETTLE),
    "white, uniform": lambda n, rng: rng.uniform(-1, 1, n + SETTLE),
    "slow noise, pole 0.95": lambda n, rng: lfilter(
        [0.3], [1, -0.95], rng.standard_normal(n + 2 * SETTLE)
    )[SETTLE:],
    "multisine": multisine,
    "steps of 10": holds(10, 10),
    "steps of 5 to 40": holds(5, 40),
    "steps of 25": holds(25, 25),
    "steps of 50": holds(50, 50),
    "multisine, 5 periods": periods,
}
CASES = {  # factor of the amplitude, shift in standard deviations
    "same": (1.0, 0.0),
    "x 1.3": (1.3, 0.0),
    "x 1.5": (1.5, 0.0),
    "x 2": (2.0, 0.0),
    "shift 1": (1.0, 1.0),
    "shift 2": (1.0, 2.0),
}


def record(kind, n, rng, case="same", noise=None):
    """Return (X, u, y, measured) and the standard deviation of the noise."""
    factor, shift = CASES[case]
    u = KINDS[kind](n, rng)
    X, u, y, _ = response(factor * u + shift * u.std())
    noise = NOISE * y.std() if noise is None else noise
    return (X, u, y, y + noise * rng.standard_normal(y.shape)), noise


def response(u):
    """Return (X, u, y, y) of the plant, without the samples before the record."""
    X = np.column_stack([lfilter(b, DENOMINATOR, u) for b in NUMERATORS])
    u, X, y = u[SETTLE:, None], X[SETTLE:], X[SETTLE:, :1]
    return X, u, y, y


def outcomes(repeats):
    """Return the shares of records that fail and that are open.

    They are by kind, number of samples and case.
    """
    found = {}
    for i, kind in enumerate(KINDS):
        for n in SAMPLES:
            for case in CASES:
                fails, opens = 0, 0
                for repeat in range(repeats):
                    rng = np.random.default_rng([SEED, i, n, repeat])
                    training, noise = record(kind, n, rng)
                    judged, _ = record(kind, n, rng, case, noise)
                    region = Region.of(*training)
                    if region.outside(*judged).mean() > OUTSIDE:
                        surely = region.outside(*judged, surely=True).mean()
                        fails += surely > OUTSIDE
                        opens += surely <= OUTSIDE
                found[kind, n, case] = fails / repeats, opens / repeats
    return found


# -- holes -----------------------------------------------------------------------------


def cycle(n, rng):
    """Return the limit cycle of a van der Pol oscillator under a small input."""
    u = 0.05 * rng.standard_normal((n + SETTLE, 1))
    X, x, dt = np.empty((n + SETTLE, 2)), np.array([2.0, 0.0]), 0.02
    for k, push in enumerate(u[:, 0]):
        X[k] = x
        for _ in range(5):
            x = x + dt * np.array([x[1], (1 - x[0] ** 2) * x[1] - x[0] + push])
    X, u = X[SETTLE:], u[SETTLE:]
    return X, u, X[:, :1], X[:, :1]


def middle(n, rng):
    """Return states in the middle of that limit cycle."""
    X, u = 0.2 * rng.standard_normal((n, 2)), 0.05 * rng.standard_normal((n, 1))
    return X, u, X[:, :1], X[:, :1]


def levels(choices, hold):
    """Return a record of inputs at some levels, held for so many samples."""

    def one(n, rng):
        steps = rng.choice(choices, (n + SETTLE) // hold + 1)
        u = np.repeat(steps, hold)[: n + SETTLE]
        return response(u + 0.02 * rng.standard_normal(len(u)))

    return one


HOLES = {  # training, another record
    "limit cycle, its middle": (cycle, middle),
    "white binary, zero": (levels([-1, 1], 1), levels([0], 1)),
    "binary held for 25, zero": (levels([-1, 1], 25), levels([0], 1)),
    "-1, 0, 1 held for 25, -0.5 and 0.5": (
        levels([-1, 0, 1], 25),
        levels([-0.5, 0.5], 25),
    ),
}


def holes(repeats):
    """Return the mean shares of samples outside, by name and number of samples.

    These are of samples outside box and ellipsoid alone, and outside, and the share of
    fresh records of the same kind that are not inside.
    """
    found = {}
    for i, (name, (train, judge)) in enumerate(HOLES.items()):
        for n in SAMPLES:
            shares = []
            for repeat in range(repeats):
                rng = np.random.default_rng([SEED, 100 + i, n, repeat])
                training, fresh, judged = train(n, rng), train(n, rng), judge(n, rng)
                region = Region.of(*training)
                convex = replace(region, points=region.points[:0])
                shares.append(
                    (
                        convex.outside(*judged).mean(),
                        region.outside(*judged).mean(),
                        region.outside(*fresh).mean() > OUTSIDE,
                    )
                )
            found[name, n] = np.mean(shares, axis=0)
    return found


def report(found, hollow, repeats):
    """Return the page, as lines."""
    lines = [
        "# Records that count as extrapolation",
        "",
        f"By `python -m benchmarks.extrapolation --repeats {repeats}`. Percent of "
        f"{repeats} records each that fail, and behind the + that are open.",
        "",
        f"| input | samples | {' | '.join(CASES)} |",
        f"|---|---|{'---|' * len(CASES)}",
    ]
    for kind in KINDS:
        for n in SAMPLES:
            cells = [[round(100 * z) for z in found[kind, n, case]] for case in CASES]
            row = " | ".join(f"{a} + {b}" if b else f"{a}" for a, b in cells)
            lines.append(f"| {kind} | {n} | {row} |")
    lines += [
        "",
        "Records of the same kind that fail, all inputs: "
        + ", ".join(f"{_same(found, n, repeats)} of {n} samples" for n in SAMPLES)
        + ".",
        "",
        "Holes: percent of the samples outside, by box and ellipsoid alone and with "
        "the nearest training sample, and percent of fresh records of the training's "
        "kind that fail or are open.",
        "",
        "| training, other record | samples | convex | nearest | fresh records |",
        "|---|---|---|---|---|",
    ]
    for (name, n), shares in hollow.items():
        row = " | ".join(f"{100 * share:.0f}" for share in shares)
        lines.append(f"| {name} | {n} | {row} |")
    versions = f"alssnn {alssnn.__version__}, numpy {np.__version__}"
    system = f"{platform.machine()}, Python {platform.python_version()}, {versions}"
    return [*lines, "", f"{system}, {date.today()}", ""]


def _same(found, n, repeats):
    """Return how many records of the same kind fail, and how many are open."""
    both = [
        sum(round(repeats * found[kind, n, "same"][i]) for kind in KINDS)
        for i in range(2)
    ]
    return f"{both[0]} ({both[1]} open) of {repeats * len(KINDS)}"


def main(arguments=None):
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=25)
    parser.add_argument("--quick", action="store_true", help="3 repeats, no file")
    options = parser.parse_args(arguments)
    if options.quick:
        options.repeats = 3
    n = options.repeats
    lines = report(outcomes(n), holes(n), n)
    print("\n".join(lines))
    if not options.quick:
        OUT.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()

"""How often does a record of the same kind, or of another, count as extrapolation?

    python -m benchmarks.extrapolation [--repeats 25] [--quick]

The region of a training record of a linear plant of two states, with 10 % of white
noise at its output, is that of its true states: no model is fitted.  A fresh record of
the same kind and length should be inside, one of 1.3, 1.5 or 2 times the amplitude, or
with the input shifted by 1 or 2 of its standard deviations, outside.  Steps of 25 and
50 samples make few independent ones of a record: 250 samples are 10 and 5 levels.

Without --quick it writes doc/benchmarks/extrapolation.md.
"""

import argparse
import platform
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
    u = factor * u + shift * u.std()
    X = np.column_stack([lfilter(b, DENOMINATOR, u) for b in NUMERATORS])
    u, X, y = u[SETTLE:, None], X[SETTLE:], X[SETTLE:, :1]
    noise = NOISE * y.std() if noise is None else noise
    return (X, u, y, y + noise * rng.standard_normal(y.shape)), noise


def shares(repeats):
    """Return the share of records that extrapolate, per kind, samples and case."""
    found = {}
    for i, kind in enumerate(KINDS):
        for n in SAMPLES:
            for case in CASES:
                outside = []
                for repeat in range(repeats):
                    rng = np.random.default_rng([SEED, i, n, repeat])
                    training, noise = record(kind, n, rng)
                    judged, _ = record(kind, n, rng, case, noise)
                    outside.append(Region.of(*training).outside(*judged).mean())
                found[kind, n, case] = np.mean(np.array(outside) > OUTSIDE)
    return found


def report(found, repeats):
    """Return the page, as lines."""
    lines = [
        "# Records that count as extrapolation",
        "",
        f"By `python -m benchmarks.extrapolation --repeats {repeats}`. Percent of "
        f"{repeats} records each.",
        "",
        f"| input | samples | {' | '.join(CASES)} |",
        f"|---|---|{'---|' * len(CASES)}",
    ]
    for kind in KINDS:
        for n in SAMPLES:
            row = " | ".join(f"{100 * found[kind, n, case]:.0f}" for case in CASES)
            lines.append(f"| {kind} | {n} | {row} |")
    versions = f"alssnn {alssnn.__version__}, numpy {np.__version__}"
    system = f"{platform.machine()}, Python {platform.python_version()}, {versions}"
    return [*lines, "", f"{system}, {date.today()}", ""]


def main(arguments=None):
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=25)
    parser.add_argument("--quick", action="store_true", help="3 repeats, no file")
    options = parser.parse_args(arguments)
    if options.quick:
        options.repeats = 3
    lines = report(shares(options.repeats), options.repeats)
    print("\n".join(lines))
    if not options.quick:
        OUT.write_text("\n".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main()

"""The check of feedback: how often is it wrong, and how often does it see a loop?

    python -m benchmarks.feedback [--seeds 100] [--quick]

The plant is x+ = [[1.6, -0.8], [1, 0]] x + [1, 0]' (u + h + w), y = [0.15, 0.1] x + n,
linear (h = 0) or with h = -0.8 tanh(2 y) + 0.4 y.  A reference r moves in steps of 8
samples; in open loop u = r, in closed loop u = r - 0.4 y with what is measured at the
same sample, and "y alone" is a closed loop whose r rests.  Noise is that of the sensor,
10 % of the output, white or of a pole at 0.9, or that of the process, w of a standard
deviation of 0.5 and n of 0.01.  A model is identified from one record of 1,000 samples
(of the closed loop with its reference for "y alone") and judged on a fresh one.

The check is asked at the level of 1 %.  In open loop all that it finds is false.  In
closed loop, white noise of the sensor does no harm; in the other cases the simulation
error is biased, and independence should not pass.  Where nothing but y moves u, it
should not pass either.  Records of a closed loop take a quarter of the seeds.

Without --quick the table goes to doc/benchmarks/feedback.md.
"""

import argparse
import os
import platform
import sys
import warnings
from datetime import date
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import scipy
from scipy.signal import lfilter

import alssnn
from alssnn import FlSsnn, LinearStateSpace
from benchmarks._options import by_hand

OUT = Path(__file__).parents[1] / "doc" / "benchmarks" / "feedback.md"
A, C = np.array([[1.6, -0.8], [1.0, 0.0]]), np.array([0.15, 0.1])
GAIN, HOLD, SENSOR = 0.4, 8, 0.1
# noise: standard deviations of w and of n (relative to y without noise; 0.01: absolute)
NOISES = {"white": (0.0, 0.0), "pole at 0.9": (0.0, 0.9), "process": (0.5, 0.0)}
LOOPS = ("open", "closed", "y alone")
SAMPLES = 1000


def record(n, loop, noise, nonlinear, rng):
    """Return inputs and measured outputs."""
    proc, pole = NOISES[noise]
    r = np.repeat(rng.uniform(-1.5, 1.5, n // HOLD + 1), HOLD)[:n]
    w, n_white = rng.standard_normal((2, n))
    size = 0.01
    if not proc:
        size = SENSOR * _run(r, 0 * w, 0 * w, 0.0, nonlinear)[1].std()
    sensor = size * lfilter([np.sqrt(1 - pole**2)], [1, -pole], n_white)
    r = 0 * r if loop == "y alone" else r
    u, y = _run(r, proc * w, sensor, 0.0 if loop == "open" else GAIN, nonlinear)
    return u[:, None], y


def _run(r, w, sensor, gain, nonlinear):
    x, u, y = np.zeros(2), np.empty(len(r)), np.empty(len(r))
    for k in range(len(r)):
        clean = C @ x
        y[k] = clean + sensor[k]
        u[k] = r[k] - gain * y[k]
        h = -0.8 * np.tanh(2 * clean) + 0.4 * clean if nonlinear else 0.0
        x = A @ x + np.array([u[k] + h + w[k], 0.0])
    return u, y


def judged(loop, noise, nonlinear, fitted_for, seed, n=SAMPLES):
    """Return the validation of a model that was identified from a record like it."""
    rng = np.random.default_rng(7_000 + seed)
    trained = "closed" if loop == "y alone" else loop
    training = record(n, trained, noise, nonlinear, rng)
    fresh = record(n, loop, noise, nonlinear, rng)
    if nonlinear:
        model = by_hand(FlSsnn, 2, 4, noise=fitted_for, random_state=seed)
    else:
        model = LinearStateSpace(nx=2, noise=fitted_for)
    return model.fit(*training).validate(*fresh)


def rows(seeds, show=print):
    """Return the rows of the table, as text."""
    lines = []
    for nonlinear in (False, True):
        for loop in LOOPS:
            for noise in NOISES:
                if loop == "y alone" and noise != "process":
                    continue  # hardly anything moves
                cells = ["FL-SSNN" if nonlinear else "linear", loop, noise]
                for fitted_for in ("output", "innovations"):
                    found = np.zeros(3, dtype=int)
                    for seed in range(seeds if loop == "open" else seeds // 4 or 1):
                        result = judged(loop, noise, nonlinear, fitted_for, seed)
                        found += _found(result)
                    cells += [f"{count}" for count in found]
                lines.append(f"| {' | '.join(cells)} |")
                show(lines[-1])
    return lines


def _found(validation):
    check = validation["feedback"]
    return np.array(
        [
            np.isfinite(check.value) and not check.passed,
            "nothing but y" in check.sentence,
            validation["independence"].passed,
        ]
    )


def main(arguments=None):
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--quick", action="store_true", help="3 seeds, no file")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore", UserWarning)  # fits that stop
    warnings.simplefilter("ignore", RuntimeWarning)
    lines = rows(
        3 if options.quick else options.seeds, lambda line: print(line, flush=True)
    )
    if options.quick:
        return 0
    versions = [f"{m.__name__} {m.__version__}" for m in (alssnn, np, scipy)]
    system = [platform.machine(), f"Python {platform.python_version()}", *versions]
    text = [
        "# Feedback that is found in a record",
        "",
        f"By `python -m benchmarks.feedback --seeds {options.seeds}`. Of",
        f"{options.seeds} models (in closed loop {options.seeds // 4 or 1}) with each",
        "option `noise`: how often feedback was found at the level of 1 %, how often",
        "nothing but y was found to move u, and how often independence passed.",
        "",
        "| model | loop | noise | output: found | y alone | independence passes "
        "| innovations: found | y alone | independence passes |",
        "|---|---|---|---|---|---|---|---|---|",
        *lines,
        "",
        f"{', '.join(system)}, {date.today()}",
        "",
    ]
    OUT.write_text("\n".join(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Tests of residuals of identified models: how often do they raise a false alarm?

    python -m benchmarks.validation [--seeds 200] [--quick]

A model of the right structure is identified from a record of a known plant; the tests
of its residuals at the level of 1 % ask on that record, and on a fresh one of the same
length, whether something is missing.  With the parameters taken for exact they find
their errors, too.  A model of one state instead of two has to be found.  The linear
plant has two states, inputs and outputs; the nonlinear one has u - tanh(2 y) at its
input, and an FL-SSNN of three neurons.  The noise has 10 % of the standard deviation of
the output, white or of a pole at 0.9.

Without --quick it writes its table to doc/benchmarks.
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
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import FlSsnn, LinearStateSpace
from alssnn.validation import residual_tests, scored_experiments, scored_sensitivities
from benchmarks._options import by_hand

OUT = Path(__file__).parents[1] / "doc" / "benchmarks" / "validation.md"
TESTS = ("independence", "squares", "cubes")
LEVEL = 0.01
NOISE = 0.1
SAMPLES = (500, 1000)
POLES = {"white": 0.0, "colored": 0.9}
# plant: (A, B, C, gain of the feedback of y)
PLANTS = {
    "linear": (
        np.array([[0.8, 0.3], [-0.2, 0.7]]),
        np.array([[1.0, 0.2], [0.1, 0.5]]),
        np.array([[1.0, 0.0], [0.3, 1.0]]),
        0.0,
    ),
    "nonlinear": (
        np.array([[0.9, 0.2], [-0.2, 0.8]]),
        np.array([[0.1], [0.4]]),
        np.array([[1.0, 0.0]]),
        1.0,
    ),
}


def record(plant, n_samples, pole, rng):
    """Return inputs and noisy outputs of a plant."""
    A, B, C, gain = PLANTS[plant]
    u = rng.standard_normal((n_samples, B.shape[1]))
    x, y = np.zeros(2), np.empty((n_samples, len(C)))
    for k, u_k in enumerate(u):
        y[k] = C @ x
        x = A @ x + B @ (u_k - (gain * np.tanh(2 * y[k]) if gain else 0.0))
    white = rng.standard_normal(y.shape)
    noise = lfilter([np.sqrt(1 - pole**2)], [1, -pole], white, axis=0)
    return u, y + NOISE * y.std(axis=0) * noise


def identified(plant, nx, u, y):
    """Return a model of the structure of the plant, of some order."""
    if plant == "linear":
        return LinearStateSpace(nx=nx).fit(u, y)
    model = by_hand(FlSsnn, nx=nx, n_h=3, max_iter=100, tol=1e-5, random_state=0)
    return model.fit(u, y)


def alarms(model, u, y, exact):
    """Return which tests fail, or None where the simulation diverges."""
    experiments, _ = scored_experiments(model, u, y)
    if not all(np.isfinite(y_hat).all() for _, _, y_hat in experiments):
        return None
    sensitivities = None if exact else scored_sensitivities(model, u, y)
    p = residual_tests(experiments, sensitivities=sensitivities).p_values
    return [len(p[test]) * p[test].min() < LEVEL for test in TESTS]


def rates(plant, n_samples, pole, nx, seeds):
    """Return the share of alarms, per kind of test, and how often models diverged."""
    found: dict[str, list] = {"exact": [], "fresh": [], "training": []}
    for seed in seeds:
        rng = np.random.default_rng(1000 + seed)
        training, fresh = (record(plant, n_samples, pole, rng) for _ in range(2))
        model = identified(plant, nx, *training)
        found["exact"].append(alarms(model, *fresh, exact=True))
        found["fresh"].append(alarms(model, *fresh, exact=False))
        found["training"].append(alarms(model, *training, exact=False))
    kept = {k: [z for z in v if z is not None] for k, v in found.items()}
    diverged = len(found["fresh"]) - len(kept["fresh"])
    return {k: np.mean(v, axis=0) for k, v in kept.items()}, diverged


def table(seeds):
    """Return the rows of the table, as text."""
    rows = []
    for plant in PLANTS:
        for color, pole in POLES.items():
            for n in SAMPLES:
                right, diverged = rates(plant, n, pole, 2, range(seeds))
                low, _ = rates(plant, n, pole, 1, range(max(seeds // 4, 1)))
                shares = [
                    " / ".join(f"{100 * z:.1f}" for z in right[kind])
                    for kind in ("exact", "fresh", "training")
                ]
                power = f"{100 * low['fresh'][0]:.0f}"
                cells = [f"{plant}, {color}", f"{n}", *shares, power, f"{diverged}"]
                rows.append(f"| {' | '.join(cells)} |")
                print(rows[-1], flush=True)
    return rows


def main():
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--quick", action="store_true", help="8 seeds, no file")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    rows = table(8 if options.quick else options.seeds)
    if options.quick:
        return 0
    versions = [f"{m.__name__} {m.__version__}" for m in (alssnn, np, scipy)]
    system = [platform.machine(), f"Python {platform.python_version()}", *versions]
    text = [
        "# False alarms of the tests of residuals",
        "",
        f"By `python -m benchmarks.validation --seeds {options.seeds}`. Alarms of",
        f"independence / squares / cubes at the level of {LEVEL:.0%}, in percent of",
        f"{options.seeds} models of the right structure; last but one, independence on",
        f"fresh data of {max(options.seeds // 4, 1)} models of one state instead of",
        "two; last, how many models of the right structure diverged on fresh data.",
        "",
        "| plant, noise | samples | fresh, exact=True | fresh | training | low order "
        "| diverged |",
        "|---|---|---|---|---|---|---|",
        *rows,
        "",
        f"{', '.join(system)}, {date.today()}",
        "",
    ]
    OUT.write_text("\n".join(text), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

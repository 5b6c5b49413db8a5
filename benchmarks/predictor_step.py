"""Time of a training step with innovations, over that of simulation errors.

    python -m benchmarks.predictor_step [--samples 10000] [--repeats 15]

One pass for (J'J, J'r) of the predictor of a model, on pairs ([u, y], y), over one of
its free run, on (u, y), and over one of the same model without K (``noise="output"``):
in one process with one BLAS thread, by turns, medians.  FL-SSNN (h of six neurons) and
AL-SSNN (g of six neurons, too, and the output-referred residual as a second channel),
with one input and output and four states, and with three of each and six states, h of
the predicted and of the measured output, or of the states.

Required: at most 1.2 times the pass of the free run.  Exits with 1 if one is longer;
writes its table to doc/benchmarks, unless --quick (500 samples).
"""

import argparse
import os
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn.criterion import Criterion
from alssnn.innovations import predictor, with_outputs
from alssnn.models import state_space
from alssnn.optimizers import single_threaded
from benchmarks._tables import OUT

LIMIT = 1.2
SIZES = {"SISO": (4, 1, 1), "3 x 3": (6, 3, 3)}  # nx, nu, ny
N_H = N_G = 6
MODELS = {"FL": {"n_h": N_H}, "AL": {"n_h": N_H, "n_g": N_G}}
SEES = {
    "y": {"feedback": "output", "h_sees": "predicted"},
    "y_m": {"feedback": "output", "h_sees": "measured"},
    "x": {"feedback": "state"},
}
TITLES = (
    "size",
    "model",
    "h sees",
    "predictor, ms",
    "free run, ms",
    "output, ms",
    "over free run",
    "over output",
)


def criteria(size, model, sees, n_samples):
    """Return a criterion and a free vector of predictor, free run and output model."""
    nx, nu, ny = SIZES[size]
    rng = np.random.default_rng(0)
    options = {"C": rng.standard_normal((ny, nx)), **MODELS[model], **SEES[sees]}
    channels = ("y", "e") if model == "AL" else ("y",)
    plain = {k: v for k, v in options.items() if k != "h_sees"}
    free = state_space(nx, nu, ny, noise="innovations", **options).observe(*channels)
    output = state_space(nx, nu, ny, **plain).observe(*channels)
    p = {k: 0.05 * rng.standard_normal(s) for k, s in free.shapes.items()}
    A = rng.standard_normal((nx, nx))
    p["A"] = 0.8 * A / np.abs(np.linalg.eigvals(A)).max()
    pair = rng.standard_normal((n_samples, nu)), rng.standard_normal((n_samples, ny))
    weights = dict.fromkeys(channels, 1.0)
    found = []
    for structure, experiments in (
        (predictor(free), with_outputs([pair])),
        (free, [pair]),
        (output, [pair]),
    ):
        criterion = Criterion(structure, experiments, weights=weights)
        theta = structure.join({name: p[name] for name in structure.shapes})
        found.append((criterion, criterion.join(theta, np.zeros((1, nx)))))
    return found


def measure(size, model, sees, n_samples, repeats):
    """Return the median seconds of a pass: predictor, free run and output model."""
    found = criteria(size, model, sees, n_samples)
    seconds = np.empty((repeats, len(found)))
    with single_threaded():
        for criterion, free in found:  # compiles the kernels
            criterion.normal_equations(free)
        for repeat in range(repeats):
            for i, (criterion, free) in enumerate(found):
                start = time.process_time()
                criterion.normal_equations(free)
                seconds[repeat, i] = time.process_time() - start
    return np.median(seconds, axis=0), np.median(seconds[:, :1] / seconds[:, 1:], 0)


def main():
    """Measure, print, and compare with what is required."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--quick", action="store_true", help="500 samples, no file")
    options = parser.parse_args()
    n_samples = 500 if options.quick else options.samples
    table = [f"| {' | '.join(TITLES)} |", "|" + "---|" * len(TITLES)]
    print("\n".join(table), flush=True)
    missed = False
    for size in SIZES:
        for model in MODELS:
            for sees in SEES:
                seconds, ratio = measure(size, model, sees, n_samples, options.repeats)
                missed |= bool(ratio[0] > LIMIT)
                times = [f"{1e3 * s:.1f}" for s in seconds]
                cells = [size, model, sees, *times, *(f"{r:.2f}" for r in ratio)]
                table.append(f"| {' | '.join(cells)} |")
                print(table[-1], flush=True)
    if not options.quick:
        text = [
            "# Time of a training step with innovations",
            "",
            f"By `python -m benchmarks.predictor_step`, {n_samples} samples, one",
            "thread: medians of one pass for (J'J, J'r), and of the ratios of passes",
            "that ran by turns. Output: the same model without K. Required: at most",
            f"{LIMIT} times the pass of the free run.",
            "",
            *table,
        ]
        (OUT / "predictor_step.md").write_text("\n".join(text) + "\n")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

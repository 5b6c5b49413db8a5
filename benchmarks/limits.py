"""Limits: how the time of a step grows with the problem.

    python -m benchmarks.limits [--quick]

A step of Levenberg-Marquardt is a trial (one simulation), a pass for J'J and J'r, their
compression, and the linear algebra of `least_squares` on n + 1 rows.  Printed are the
processor times of one BLAS thread, medians of three, and for every column the exponent
of the size: the slope of a line through the logarithms.  A sweep starts from an
AL-SSNN of order 6 with 10 and 10 neurons, one input and one output, and N = 8,000
samples, which several experiments share; or from a linear model, whose search leaves B,
D and the initial states out.  Exits with 1 if the time of a step does not grow with N
to the power of 1, within `TOLERANCE`.
"""

import argparse
import os
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.optimize import least_squares

from alssnn.compression import compress
from alssnn.criterion import Criterion
from alssnn.linear_model import LinearModel
from alssnn.models import state_space
from alssnn.optimizers import single_threaded
from alssnn.sections import Sections

COLUMNS = ("simulation", "pass", "compression", "algebra", "step")
TOLERANCE = 0.05
START = {"N": 8_000, "nx": 6, "neurons": 10, "experiments": 1}
SWEEPS = [
    ("nonlinear", "N", (20_000, 40_000, 80_000, 160_000)),
    ("nonlinear", "nx", (2, 4, 8, 16)),
    ("nonlinear", "neurons", (5, 10, 20, 40)),
    ("nonlinear", "experiments", (1, 10, 40, 80)),
    ("linear", "N", (80_000, 160_000, 320_000, 640_000)),
    ("linear", "nx", (4, 8, 16, 32, 48)),
    ("linear", "experiments", (1, 10, 40, 80, 160)),
]


def problem(kind, *, N, nx, neurons, experiments):
    """Return a criterion and a point of a given size."""
    rng = np.random.default_rng(0)
    A = rng.standard_normal((nx, nx))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.standard_normal((nx, 1)), rng.standard_normal((1, nx))
    pairs = [
        (rng.standard_normal((N // experiments, 1)),) * 2 for _ in range(experiments)
    ]
    x0 = np.zeros((experiments, nx))
    if kind == "linear":
        sections = Sections(pairs, LinearModel(A, B, C, np.zeros((1, 1)), x0))
        return sections, sections.start
    structure = state_space(nx, 1, 1, n_h=neurons, n_g=neurons, C=C).observe("y", "g")
    p = {k: 0.1 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    criterion = Criterion(structure, pairs, weights={"y": 1.0, "g": 1.0})
    return criterion, criterion.join(structure.join({**p, "A": A}), x0)


def times(criterion, free, repeats):
    """Return the number of unknowns and the processor times of the parts of a step."""
    taken = []
    criterion.normal_equations(free)  # compiles the kernels
    for i in range(repeats):
        marks = [time.process_time()]
        # a new point: nothing is remembered
        point = free * (1 + 1e-12 * (i + 1))
        criterion.norm(point)
        marks.append(time.process_time())
        JJ, Jr, norm = criterion.normal_equations(point)
        marks.append(time.process_time())
        J = compress(JJ, Jr, norm)
        marks.append(time.process_time())
        r = np.zeros(len(J))
        r[0] = norm
        least_squares(
            lambda step, J=J, r=r: r + J @ step,
            np.zeros(len(free)),
            jac=lambda _, J=J: J,
            method="lm",
            x_scale="jac",
            max_nfev=2,
        )
        marks.append(time.process_time())
        taken.append([*np.diff(marks), marks[-1] - marks[0]])
    return len(free), np.median(taken, axis=0)


def exponents(sizes, seconds):
    """Return the slopes of lines through logarithms, one per column."""
    return np.polyfit(np.log(sizes), np.log(np.maximum(seconds, 1e-6)), 1)[0]


def main():
    """Run all sweeps, print their tables and exponents."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer sizes, run once")
    quick = parser.parse_args().quick
    missed = False
    for kind, axis, sizes in SWEEPS:
        sizes = sizes[:3] if quick else sizes
        seconds = []
        print(f"\n{kind}, growth with {axis}, ms")
        print(f"{axis:>12s}{'unknowns':>10s}", *(f"{name:>12s}" for name in COLUMNS))
        for size in sizes:
            with single_threaded():
                n, row = times(
                    *problem(kind, **{**START, axis: size}), 1 if quick else 3
                )
            seconds.append(row)
            print(f"{size:12,d}{n:10,d}", *(f"{1e3 * t:12.2f}" for t in row))
        found = exponents(sizes, np.array(seconds))
        print(f"{'exponent':>22s}", *(f"{e:12.2f}" for e in found), flush=True)
        if axis == "N":
            missed |= abs(found[COLUMNS.index("step")] - 1) > TOLERANCE
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

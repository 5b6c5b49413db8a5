"""Loops of default laws: are they near their design, and near the training data?

    python -m benchmarks.loops [--cases saturation ...] [--seeds 1] [--out FILE.csv]

Fits AlSsnn with default options to plants of `benchmarks.field`, and with
``linear_part="trained"``, which leaves the loop as the training has made it (eq. kept).
Told are, on the test of the plant, the error over that with "trained"; the
linearization error along the test, and in the loop that its input drives as v; the
share of this loop outside the region of the training data; the size of the law in the
loop, over that of the input; and the seconds of the fit.
"""

import argparse
import csv
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn import AlSsnn
from benchmarks.field.__main__ import CASES
from benchmarks.field.runs import score

PARTS = ("trained", "best")
PLANTS = (
    "saturation",
    "dead zone",
    "slow and fast",
    "crane",
    "valve",
    "ball on beam",
    "boat",
    "tire",
    "limit cycle",
    "cylinder",
)
COLUMNS = (
    "case",
    "seed",
    "linear_part",
    "rmse",
    "along",
    "in_loop",
    "outside",
    "law",
    "seconds",
)


def measure(case, seed, linear_part):
    """Return the row of one fit."""
    data = case.load()
    model = AlSsnn(dt=data.dt, linear_part=linear_part, random_state=seed)
    u, y = map(list, zip(*data.train, strict=True))
    start = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(u, y)
    seconds = time.perf_counter() - start
    model.set_params(n_init_samples=case.n_init)
    (test, *_) = data.tests.values()
    found = [model.linearizability(*pair) for pair in test]
    return {
        "case": case.name,
        "seed": seed,
        "linear_part": linear_part,
        "rmse": score(model, test, case.scale)["rmse"],
        "along": np.mean([each.linearization_error for each in found]),
        "in_loop": np.mean([each.closed_linearization_error for each in found]),
        "outside": np.mean([each.closed_outside for each in found]),
        "law": np.mean([each.closed_law_size for each in found]),
        "seconds": seconds,
    }


def line(row, base):
    """Return what is printed of a row, with the error over another one."""
    shares = (f"{100 * row[name]:9.1f}%" for name in ("along", "in_loop", "outside"))
    return (
        f"{row['case']:16s}{row['seed']:5d} {row['linear_part']:8s}"
        f"{row['rmse'] / base:7.2f}{''.join(shares)}{row['law']:8.2f}"
        f"{row['seconds']:8.1f}"
    )


def main():
    """Fit all cases both ways and print a line per fit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(PLANTS))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--out", help="CSV file to append to")
    options = parser.parse_args()
    print(
        f"{'case':16s}{'seed':>5s} {'part':8s}{'rmse':>7s}{'along':>10s}"
        f"{'in loop':>10s}{'outside':>10s}{'law':>8s}{'s':>8s}"
    )
    for name in options.cases:
        for seed in range(options.seeds):
            rows = []
            for part in PARTS:
                rows.append(measure(CASES[name], seed, part))
                print(line(rows[-1], rows[0]["rmse"]), flush=True)
            if options.out:
                append(options.out, rows)


def append(path, rows):
    """Append rows to a file, which may be new."""
    is_new = not os.path.exists(path)
    with open(path, "a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        if is_new:
            writer.writeheader()
        writer.writerows(
            {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
            for row in rows
        )


if __name__ == "__main__":
    main()

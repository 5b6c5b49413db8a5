"""Cost against wall time of the optimizers on the real Wiener-Hammerstein record.

    python -m benchmarks.methods [--steps 150] [--seeds 0 1]

Trains GR-SSNN and AL-SSNN on 8,000 samples by each method of `least_squares` and prints
the root of the cost, in mV, after 5, 10, 20 and 40 seconds: the choice of the default.
"lm" is printed with bent steps (eq. geodesic) and with straight ones.
Needs the recording in ALSSNN_DATA_HOME.
"""

import argparse
import os
import warnings
from contextlib import nullcontext
from unittest.mock import patch

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, GrSsnn
from alssnn.criterion import Criterion
from alssnn.datasets import fetch_wiener_hammerstein
from benchmarks._curves import cost_curve
from benchmarks._options import by_hand

SAMPLES = slice(10_000, 18_000)
TIMES = (5, 10, 20, 40)


def straight():
    """Return a context in which no step is bent."""
    return patch.object(Criterion, "pulled", lambda *_: None)


WAYS = {
    "lm": ("lm", nullcontext),
    "straight": ("lm", straight),
    "trf": ("trf", nullcontext),
}


def main():
    """Train by every method and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=150)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    record, _ = fetch_wiener_hammerstein()
    y = record.y[SAMPLES]
    common = {"nx": 6, "max_iter": options.steps, "tol": 1e-8}
    header = "".join(f"{t:>7d} s" for t in TIMES)
    print(f"{'model':10s}{'method':10s}{'seed':>4s}{header}{'end':>9s}{'seconds':>9s}")
    for name, model in (
        ("GR-SSNN", by_hand(GrSsnn, n_f=15, **common)),
        ("AL-SSNN", by_hand(AlSsnn, gamma=1 / y.var(), **common)),
    ):
        for seed in options.seeds:
            for way, (method, context) in WAYS.items():
                model.set_params(method=method, random_state=seed)
                with context():
                    curve = cost_curve(model, record.u[SAMPLES], record.y[SAMPLES])
                times, costs = curve.stage("train")
                mv = 1e3 * y.std() * np.sqrt(costs)
                at = [mv[times <= t][-1] for t in TIMES]
                values = [*at, mv[-1], curve.seconds]
                cells = "".join(f"{value:9.3f}" for value in values)
                print(f"{name:10s}{way:10s}{seed:4d}{cells}", flush=True)


if __name__ == "__main__":
    main()

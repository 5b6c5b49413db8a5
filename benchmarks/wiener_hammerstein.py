"""Accuracy on the real Wiener-Hammerstein circuit.

    python -m benchmarks.wiener_hammerstein [--models lti gr al gr-official] [--seed 0]

Needs the recording in ALSSNN_DATA_HOME, see `alssnn.datasets`.  Prints one line per
model as soon as it is fitted and exits with 1 if a target is missed.  The initial
state of the test record is estimated from its first 50 samples, which are not scored.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, GrSsnn, LinearStateSpace
from alssnn.datasets import fetch_wiener_hammerstein
from alssnn.metrics import rmse

HEADER = (
    f"{'model':14s}{'split':>9s}{'train mV':>10s}{'test mV':>9s}{'target':>8s}"
    f"{'mean |g|/|Ax+Bu|':>18s}{'target':>8s}{'e/y':>8s}{'radius':>8s}"
    f"{'steps':>7s}{'seconds':>9s}"
)


def configurations(seed, var_y):
    """Return (split, estimator, target in mV, target ratio) by name."""
    common = {"nx": 6, "dt": 1 / 51200, "random_state": seed}
    gr = GrSsnn(n_f=15, n_init=3, max_iter=200, **common)
    # the paper's gamma = 1 is meant for y in volts; ours for y of unit variance
    al = AlSsnn(
        n_h=10,
        n_g=10,
        gamma=1.0 / var_y,
        coarse_samples=8000,
        max_iter=500,
        polish_iter=40,
        **common,
    )
    return {
        "lti": ("paper", LinearStateSpace(nx=6, dt=1 / 51200), 45.0, None),
        "gr": ("paper", gr, 0.30, None),
        "al": ("paper", al, 0.55, 3e-4),
        "gr-official": ("official", gr, 0.25, None),
    }


def main():
    """Fit, print, and compare with the targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--models", nargs="+", default=["lti", "gr", "al", "gr-official"]
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--verbose", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    print(HEADER, flush=True)
    missed = False
    for name in options.models:
        var_y = float(np.var(fetch_wiener_hammerstein()[0].y))
        split, model, target, target_ratio = configurations(options.seed, var_y)[name]
        train, test = fetch_wiener_hammerstein(split=split)
        start = time.perf_counter()
        model.set_params(verbose=options.verbose).fit(train.u, train.y)
        seconds = time.perf_counter() - start
        rmse_train, rmse_test = (
            1e3 * rmse(*model.simulate_test(*record)) for record in (train, test)
        )
        record = model.linearizability(*test)
        ratio_missed = target_ratio is not None and record.ratio_g_mean > target_ratio
        missed |= rmse_test > target or ratio_missed
        print(
            f"{name:14s}{split:>9s}{rmse_train:10.4f}{rmse_test:9.4f}{target:8.2f}"
            f"{record.ratio_g_mean:18.2e}{target_ratio or np.nan:8.0e}"
            f"{record.linearization_error[0]:8.4f}{record.spectral_radius:8.4f}"
            f"{model.n_iter_:7d}{seconds:9.1f}",
            flush=True,
        )
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

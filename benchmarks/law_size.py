"""How small should the law be?  gamma_h of AL-SSNN with h(x) on four plants.

    python -m benchmarks.law_size [--plants tanks] [--seeds 0] [--weights 0 1e-6 ...]

Fits AL-SSNN with state feedback, a penalty on e and options set by hand (`LAW`) to the
first half of two tanks in a row, the pendulum and the Duffing oscillator (4,000
samples) and the Wiener-Hammerstein circuit (8,000), all with about 1 % noise.  The
other half gives the error of the simulation, in % of the standard deviation of y; the
linearization error along the record, and with the recorded input as v; and the share of
samples that this loop spends outside the region of the training data.  Then the loop of
`alssnn control` steps by one standard deviation of y: the ranges of v and u, relative
to that of the recorded u, whose ends are 0 and 1.
"""

import argparse
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn import AlSsnn, model_ladder
from alssnn.datasets import (
    Record,
    make_duffing,
    make_pendulum,
    make_wiener_hammerstein,
)
from alssnn.feedback import balanced_weights, lqi, step_comparison
from benchmarks._options import by_hand

WEIGHTS = (0.0, 1e-6, 1e-5, 1e-4)
STEP_SAMPLES = 400
LAW = {
    "feedback": "state",
    "penalty": "output",
    "stability": "contractive",
    "gamma": 0.01,
    "continuation": 4,
    "max_iter": 120,
}


def make_tanks(n_samples=4_000, dt=2.0):
    """Return a record of two tanks in a row: pump [V] to the lower level [cm]."""
    rng = np.random.default_rng(42)
    u, k = np.zeros(n_samples), 0
    while k < n_samples:
        length = rng.integers(5, 60)
        u[k : k + length] = rng.uniform(2.5, 9.5)
        k += length
    level, y = np.array([8.0, 8.0]), np.empty(n_samples)
    for k in range(n_samples):
        y[k] = level[1] + 0.05 * rng.standard_normal()
        for _ in range(20):
            upper, lower = 0.55 * np.sqrt(np.maximum(level, 0))
            flows = np.array([0.28 * u[k] - upper, upper - lower])
            level = level + dt / 20 * flows / 4.0
    # as a file of five digits has it
    u, y = (np.array([float(f"{z:.5g}") for z in signal]) for signal in (u, y))
    return Record(u[:, None], y[:, None], dt, "tanks")


PLANTS = {
    "tanks": (2, make_tanks),
    "pendulum": (2, lambda: make_pendulum(4_000, noise=0.01, random_state=0)),
    "duffing": (2, lambda: make_duffing(4_000, noise=0.01, random_state=0)),
    "wh": (6, lambda: make_wiener_hammerstein(8_000, noise=0.01, random_state=0)),
}


def main():
    """Fit every plant with every weight and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", nargs="+", choices=PLANTS, default=list(PLANTS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--weights", type=float, nargs="+", default=WEIGHTS)
    options = parser.parse_args()
    print(
        f"{'plant':10s}{'gamma_h':>8s}{'seed':>5s}{'RMSE, %':>9s}{'e/y, %':>8s}"
        f"{'loop, %':>9s}{'outside, %':>11s}{'v':>14s}{'u':>14s}{'s':>7s}"
    )
    for plant in options.plants:
        nx, make = PLANTS[plant]
        record = make()
        for gamma_h in options.weights:
            for seed in options.seeds:
                cells = measure(record, nx, gamma_h, seed)
                print(f"{plant:10s}{gamma_h:8.0e}{seed:5d}{cells}", flush=True)


def measure(record, nx, gamma_h, seed):
    """Return the cells of one fit."""
    start = time.perf_counter()
    own = {"gamma_h": gamma_h, "dt": record.dt, "random_state": seed}
    models = {"AL-SSNN": by_hand(AlSsnn, nx, **LAW, **own)}
    (row,) = model_ladder(*record, dt=record.dt, models=models)
    seconds = time.perf_counter() - start
    model = row.model
    _, test = record.split(0.5)
    linear = model.linearizability(*test)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of a loop that diverges
        responses = step_comparison(
            model, lqi(model, *balanced_weights(model)), n_samples=STEP_SAMPLES
        )
    _, v, u = responses["model"].outputs
    low, width = record.u.min(), np.ptp(record.u)
    v, u = (
        f"{(z.min() - low) / width:.2f} to {(z.max() - low) / width:.2f}"
        for z in (v, u)
    )
    shares = (
        row.rmse_test[0] / record.y.std(),
        linear.linearization_error[0],
        linear.closed_linearization_error[0],
        linear.closed_outside,
    )
    rmse, error, closed, outside = (100 * share for share in shares)
    return (
        f"{rmse:9.2f}{error:8.2f}{closed:9.2f}{outside:11.2f}{v:>14s}{u:>14s}"
        f"{seconds:7.1f}"
    )


if __name__ == "__main__":
    main()

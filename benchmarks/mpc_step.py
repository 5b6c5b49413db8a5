"""Predictive control of a monotone map against one of v = u + h(s): time of a step.

    python -m benchmarks.mpc_step [--steps 1000] [--seed 0]

The same record, sizes and limits for both models, which differ in `input_map` only: the
arm with a fan (one input) and the arm of two links (two), horizon 20, three standard
deviations of reference up and down.  Both controllers run in one process and take turns
at every sample, each on the true plant; one BLAS thread.  Prints for every case the
median processor time of either and of their ratios, sample by sample, the iterations of
the solver, the share of samples at a limit, and the fallbacks.

Exits with 1 if a ratio is above 1.3 or a solver fails.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import FlSsnn
from alssnn.datasets import make_fan_arm, make_two_input_arm
from alssnn.mpc import LinearizingMPC
from benchmarks._options import by_hand

RATIO = 1.3
HORIZON, HOLD = 20, 25
PLANTS = {"fan arm": (make_fan_arm, 2), "two-link arm": (make_two_input_arm, 4)}


def models(make, nx, seed):
    """Return a record and its two models, the one of the monotone map first."""
    record = make(4000, noise=0.01, random_state=seed)
    options = {"n_h": 8, "feedback": "state", "max_iter": 150, "dt": record.dt}
    return record, [
        by_hand(FlSsnn, nx, random_state=seed, input_map=input_map, **options).fit(
            record.u, record.y
        )
        for input_map in ("monotone", "identity")
    ]


def in_turns(plant, controllers, reference, rest):
    """Return the times of steps and what happened, of controllers that take turns."""
    X = [np.zeros(plant.nstates) for _ in controllers]
    U, steps = [rest] * len(controllers), [[] for _ in controllers]
    for mpc in controllers:
        mpc.reset()
    for k, r in enumerate(reference):
        order = range(len(controllers))
        for i in order if k % 2 else reversed(order):
            y = plant.output(0.0, X[i], U[i])
            start = time.process_time()
            U[i] = controllers[i].step(r, y)
            steps[i].append((time.process_time() - start, controllers[i].info_))
            X[i] = np.asarray(plant.dynamics(0.0, X[i], U[i]))
    return [steps_of_one[HOLD:] for steps_of_one in steps]


def main():
    """Measure, print, and compare with the target."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    missed = False
    print(f"load {os.getloadavg()[0]:.1f}; milliseconds, horizon {HORIZON}")
    print(
        f"{'plant':14s}{'limits':16s}{'monotone':>9s}{'identity':>9s}{'ratio':>7s}"
        f"{'iterations':>12s}{'at a limit':>16s}{'fallbacks':>10s}"
    )
    for name, (make, nx) in PLANTS.items():
        record, pair = models(make, nx, args.seed)
        rng, size = np.random.default_rng(args.seed), record.y.std(axis=0)
        levels = rng.uniform(-1.5, 1.5, (args.steps // HOLD + 1, len(size)))
        reference = record.y.mean(axis=0) + size * np.repeat(levels, HOLD, axis=0)
        limits = dict(u_min=record.u.min(axis=0), u_max=record.u.max(axis=0))
        rate = {"du_max": 0.2 * (limits["u_max"] - limits["u_min"])}
        cases = {"none": {}, "u": limits, "u and rate": {**limits, **rate}}
        for case, options in cases.items():
            controllers = [LinearizingMPC(model, HORIZON, **options) for model in pair]
            steps = in_turns(
                record.plant, controllers, reference, record.u.mean(axis=0)
            )
            seconds = np.array([[seconds for seconds, _ in one] for one in steps])
            ratio = np.median(seconds[0] / seconds[1])
            ms = 1e3 * np.median(seconds, axis=1)
            n_iter = [np.median([s.iterations for _, s in one]) for one in steps]
            share = [np.mean([s.saturated.any() for _, s in one]) for one in steps]
            lost = [sum(s.fallback for _, s in one) for one in steps]
            missed |= ratio > RATIO or sum(lost) > 0
            print(
                f"{name:14s}{case:16s}{ms[0]:9.2f}{ms[1]:9.2f}{ratio:7.2f}"
                f"{n_iter[0]:6.0f}{n_iter[1]:6.0f}{share[0]:8.0%}{share[1]:8.0%}"
                f"{lost[0]:5d}{lost[1]:5d}",
                flush=True,
            )
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

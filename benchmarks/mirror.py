"""AL-SSNN of the fine steering mirror: one model of 28 states for three levels.

    python -m benchmarks.mirror [--realizations 2 6 6] [--minutes 6 10 6]
                                [--jobs 2] [--save FILE] [--start FILE]

Defaults of the package search with three random starts and hidden samples, which takes
days on a record of 18 periods of 8,192 samples, three inputs and outputs.  Options are
set by hand: periodic initial states, one random start, alpha = 1e-6, no search.

A linear model of all records comes first.  In modal form its A has 52 entries that are
not zero.  The others are held, and cost nothing.  A first stage fits two realizations
of every level, and the next ones go on from there with all six.  After every stage the
error of each level is printed, in micrometres, as the mean over outputs, realizations
and periods: of the tests, and behind a bar of all training records.  The first 100
samples estimate the initial state.  `--save` keeps the model behind every stage.
`--start` goes on from a kept one, whose errors are the first row.
"""

import argparse
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control
import numpy as np
from scipy.linalg import cdf2rdf
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import AlSsnn, LinearStateSpace
from alssnn.datasets import fetch_fine_steering_mirror

NX, WINDOW, MICROMETRES = 28, 100, 1e6
SHARED = {"feedthrough": True, "initial_state": "periodic"}
OPTIONS = {
    "nx": NX,
    "n_h": 10,
    "n_g": 25,
    "gamma": 0,
    "alpha": 1e-6,
    "n_init": 1,
    "coarse_samples": None,
    "stability": None,
    "random_state": 0,
    "max_iter": 1_000,
    "tol": 1e-9,
    **SHARED,
}


def modal(system):
    """Return a system of simple poles in modal form, and bounds that hold its zeros."""
    A, T = cdf2rdf(*np.linalg.eig(system.A))
    B, C = np.linalg.solve(T, system.B), system.C @ T
    free = np.where(A != 0, np.inf, 0.0)
    return control.ss(A, B, C, system.D, system.dt), {"A": (-free, free)}


def of_linear(train):
    """Return an unfitted model that starts from the linear one of all records."""
    linear = LinearStateSpace(NX, dt=train[0].dt, **SHARED)
    linear.fit(*of_every_level(train, len(train) // 3))
    system, bounds = modal(linear.to_statespace())
    start = {"linear_start": system, "bounds": bounds}
    return linear, AlSsnn(**OPTIONS, **start, dt=train[0].dt)


def errors(model, levels):
    """Return the error of every level, in micrometres."""
    means = []
    for records in levels:
        own = []
        for u, y in records:
            x0 = model.estimate_x0(u[:WINDOW], y[:WINDOW])
            missed = (model.simulate(u, x0=x0) - y)[WINDOW:]
            own.append(np.sqrt(np.mean(missed**2, axis=0)))
        means.append(MICROMETRES * np.mean(own))
    return np.array(means)


def row(model, train, tests):
    """Return the errors of the tests and of the training records as text."""
    each = len(train) // 3
    trained = [train[i : i + each] for i in range(0, len(train), each)]
    parts = errors(model, tests.values()), errors(model, trained)
    return " | ".join(" ".join(f"{error:.4f}" for error in part) for part in parts)


def of_every_level(train, n):
    """Return inputs and outputs of the first n realizations of every level."""
    each = len(train) // 3
    chosen = [record for i, record in enumerate(train) if i % each < n]
    return [record.u for record in chosen], [record.y for record in chosen]


def stage(model, n, minutes, train):
    """Fit, or go on with, a model on so many realizations of every level."""
    model.set_params(max_time=60.0 * minutes, warm_start=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(*of_every_level(train, n))


def main(argv=None):
    """Run the stages and print their errors."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--realizations", type=int, nargs="+", default=[2, 6, 6])
    parser.add_argument("--minutes", type=float, nargs="+", default=[6.0, 10.0, 6.0])
    parser.add_argument("--save", help="where the model is kept")
    parser.add_argument("--start", help="a kept model")
    parser.add_argument("--jobs", type=int, help="threads of a pass")
    args = parser.parse_args(argv)
    if len(args.realizations) != len(args.minutes):
        parser.error("--realizations and --minutes must have as many numbers")
    train, tests = fetch_fine_steering_mirror()
    if args.start:
        model = alssnn.load(args.start).set_params(n_jobs=args.jobs)
    else:
        begun = time.perf_counter()
        linear, model = of_linear(train)
        model.set_params(n_jobs=args.jobs)
    print("realizations, steps, minutes,", ", ".join(tests), "um | training")
    if args.start:
        print("0 0 0.0", row(model, train, tests), flush=True)
    else:
        spent = (time.perf_counter() - begun) / 60
        found = row(linear, train, tests)
        print(f"linear {linear.n_iter_} {spent:.1f} {found}", flush=True)
    for n, minutes in zip(args.realizations, args.minutes, strict=True):
        begun = time.perf_counter()
        stage(model, n, minutes, train)
        spent = (time.perf_counter() - begun) / 60
        found = row(model, train, tests)
        print(f"{n} {model.n_iter_} {spent:.1f} {found}", flush=True)
        if args.save:
            model.save(args.save)


if __name__ == "__main__":
    main()

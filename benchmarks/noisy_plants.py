"""Noise of the process on plants nobody tuned for: the defaults against a linear model.

    python -m benchmarks.noisy_plants [--plants tank Duffing cells] [--seeds 0 1 2]
                                      [--samples 2000 300]

Records of three plants with noise of the process: a tank whose level a proportional
controller keeps, on a noisy measurement; a Duffing oscillator in open loop with noise
of the force; and two cells of a process whose inputs saturate and whose outputs are
missing in one of ten samples.  All estimators are fitted with ``noise="innovations"``
and otherwise with the defaults, FL-SSNN with feedback of the output, too.  Compared is
the error of ``predict_ahead(steps=1)`` on 2,000 fresh samples, each output in units of
its standard deviation in training and without the first 50 samples, with that of
`LinearStateSpace`.

Required: from 2,000 samples no fit is worse than the linear model by more than 2 %.
Shorter records are reported: the fresh samples go where they have not been.  Exits with
1 if a fit is worse; writes its table to doc/benchmarks, unless --quick (one seed of 300
samples).
"""

import argparse
import os
import sys
import time
import warnings
from functools import partial
from itertools import product

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn import FlSsnn
from benchmarks._tables import OUT
from benchmarks.field.case import columns
from benchmarks.field.runs import MODELS
from benchmarks.field.signals import simulate
from benchmarks.one_step import deviations, scaled_rms

ENOUGH = 2_000  # samples from which a fit may not be worse
LIMIT = 1.02
FRESH, FRESH_SEED, SKIP = 2_000, 1_000, 50  # seeds are added to those of training
DT = 0.05  # of the oscillator, in seconds
FORCE_NOISE = 0.5  # standard deviation of the force, constant over a sample
LOST = 0.1  # share of either output of the cells
MODELS = {name: MODELS[name] for name in ("lti", "fl", "al", "gr")}
MODELS["fl of y"] = partial(FlSsnn, feedback="output")
TITLES = ("plant", "samples", "seed", "error of lti", *list(MODELS)[1:], "h sees", "s")
AS_LINEAR = "="  # behind a figure: the networks did not help, it is the linear model


def steps(rng, n_samples, low, high, hold):
    """Return steps of `hold` samples, of shape (n_samples,)."""
    levels = rng.uniform(low, high, -(-n_samples // hold))
    return np.repeat(levels, hold)[:n_samples]


def tank(rng, n_samples):
    """Let a tank drain by the root of its level, which a controller keeps."""
    r = steps(rng, n_samples, 0.5, 1.5, 40)
    x, (u, y) = 1.0, np.empty((2, n_samples))
    for k in range(n_samples):
        y[k] = x + 0.005 * rng.standard_normal()
        u[k] = np.clip(1 + 2.5 * (r[k] - y[k]), 0, 3)
        x = max(x + 0.1 * (u[k] - np.sqrt(x)) + 0.02 * rng.standard_normal(), 0.0)
    return u, y


def duffing(rng, n_samples):
    """Push a mass on a spring that hardens."""

    def motion(x, f):
        return [x[1], f[0] - x[0] - 1.5 * x[0] ** 3 - 0.4 * x[1]]

    u = steps(rng, n_samples, -3, 3, 10)
    force = u + FORCE_NOISE * rng.standard_normal(n_samples)
    X, _ = simulate(motion, [0.0, 0.0], force[:, None], DT)
    return u, X[:, 0] + 0.005 * rng.standard_normal(n_samples)


def cells(rng, n_samples):
    """Feed two cells that exchange, through valves that saturate."""
    A, B = np.array([[0.85, 0.1], [0.15, 0.7]]), np.array([[0.3, 0.05], [-0.05, 0.2]])
    u = np.stack([steps(rng, n_samples, -2, 2, hold) for hold in (7, 11)], axis=1)
    x, y = np.zeros(2), np.empty((n_samples, 2))
    for k in range(n_samples):
        y[k] = x + 0.01 * rng.standard_normal(2)
        noise = 0.03 * rng.standard_normal(2)
        x = A @ x + B @ np.tanh(u[k]) - 0.1 * x**3 + noise
    y[rng.random(y.shape) < LOST] = np.nan
    return u, y


PLANTS = {"tank": tank, "Duffing": duffing, "cells": cells}


def fitted(name, u, y, seed):
    """Return a model with the defaults for innovations."""
    model = MODELS[name](noise="innovations")
    if "random_state" in model.get_params():
        model.set_params(random_state=seed)
    return model.fit(u, y)


def compare(plant, n_samples, seed):
    """Return the errors of one record, that of the linear model first, and notes.

    Returns
    -------
    errors : dict of str to float
        By model.
    is_linear : set of str
        Models of which nothing but the linear model was left.
    sees : str
        What h of "fl of y" sees, if that is among the models.
    """
    make, errors, is_linear, sees = PLANTS[plant], {}, set(), ""
    u, y = map(columns, make(np.random.default_rng(seed), n_samples))
    fresh = map(columns, make(np.random.default_rng(FRESH_SEED + seed), FRESH))
    u_new, y_new = fresh
    for name in MODELS:
        model = fitted(name, u, y, seed)
        y_hat = columns(model.predict_ahead(u_new, y_new))
        errors[name] = scaled_rms([(y_new, y_hat)], deviations([(u, y)]), SKIP)
        if getattr(model, "alpha_", 0.0) == np.inf:
            is_linear.add(name)
        if name == "fl of y":
            sees = model.h_sees_
    return errors, is_linear, sees


def row_of(plant, n_samples, seed):
    """Return a row of the table, and how many of its fits are worse than required."""
    start = time.perf_counter()
    errors, is_linear, sees = compare(plant, n_samples, seed)
    seconds = time.perf_counter() - start
    linear, *others = errors.items()
    ratios = {name: error / linear[1] for name, error in others}
    worse = [ratio for ratio in ratios.values() if not ratio <= LIMIT]
    figures = [
        f"{ratio:.3f}{AS_LINEAR * (name in is_linear)}"
        for name, ratio in ratios.items()
    ]
    head = plant, str(n_samples), str(seed), f"{linear[1]:.4f}"
    return (*head, *figures, sees, f"{seconds:.0f}"), len(worse)


def table(rows):
    """Return the report as Markdown.

    Parameters
    ----------
    rows : list of tuple
        Pairs: what `row_of` has returned.
    """
    text = [
        "# Noise of the process on plants that nobody tuned for",
        "",
        "By `python -m benchmarks.noisy_plants`: error one sample ahead of models with",
        '`noise="innovations"` and the defaults on fresh samples, over that of the',
        "linear model, whose error is given relative to the deviation of y. Behind a",
        f"figure, {AS_LINEAR} says that the networks did not help on hidden samples:",
        "the linear model was returned. `fl of y`: FL-SSNN with",
        f'`feedback="output"`. Required from {ENOUGH:,} samples: at most {LIMIT}.',
        "",
    ]
    for n_samples in dict.fromkeys(row[1] for row, _ in rows):
        part = [worse for row, worse in rows if row[1] == n_samples]
        count = f"{sum(part)} of {len(part) * (len(MODELS) - 1)} fits"
        text.append(f"- {n_samples} samples: {count} are worse than that")
    text += ["", f"| {' | '.join(TITLES)} |", "|" + "---|" * len(TITLES)]
    text += [f"| {' | '.join(row)} |" for row, _ in rows]
    return "\n".join(text) + "\n"


def main():
    """Measure, print, and compare with what is required."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", nargs="+", choices=PLANTS, default=list(PLANTS))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--samples", type=int, nargs="+", default=[ENOUGH, 300])
    parser.add_argument("--quick", action="store_true", help="one seed, no file")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.quick:
        options.samples, options.seeds = [300], [0]
    rows = []
    print("".join(f"{title:>14s}" for title in TITLES))
    for case in product(options.plants, options.samples, options.seeds):
        rows.append(row_of(*case))
        print("".join(f"{cell:>14s}" for cell in rows[-1][0]), flush=True)
    if not options.quick:
        (OUT / "noisy_plants.md").write_text(table(rows))
    return int(any(worse for row, worse in rows if int(row[1]) >= ENOUGH))


if __name__ == "__main__":
    sys.exit(main())

"""Default fits of short records: do they reach what options set by hand reach?

    python -m benchmarks.short_records [--split seen] [--models al fl] [--seeds 2]
                                       [--out short_records.csv]

Records of 300 to 1,000 samples of plants with one to three inputs and one or two
outputs, most of them of `benchmarks.field`, with noise of 0.5 to 5 %.  Every plant is
fitted with the defaults, several seeds, and with small networks of which alpha is one
of three numbers (the grid, one seed).  Errors are those of a fresh record, relative to
the linear model.  Counted are default fits that are worse than the linear model by more
than 2 %, those that return it where the best of the grid has less than half of its
error, and the median of default over best of the grid.  Rules are chosen on the plants
that are called seen; those called unseen tell what they are worth.  One process; a run
goes on where its file ends.
"""

import argparse
import os
import sys
from functools import partial
from math import tanh
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from .field.blocks import dead_zone, saturation
from .field.case import simulated
from .field.mechanics import drone_arm, duffing, nonlinear_damping, robot_joint
from .field.processes import overflowing_tank, two_tanks
from .field.runs import run
from .field.signals import iterate, steps
from .field.table import WORSE

MODELS = ("fl", "al", "gr")
ALPHAS = (1e-6, 1e-4, 1e-2)
SMALL = {"n_init": 1, "max_iter": 60, "n_h": 6, "n_g": 6, "n_f": 8}
HALF = 0.5  # of the error of the linear model: networks could do much better
LINEAR = "the networks do not help"

A = np.array([[0.8, 0.15], [-0.2, 0.75]])
B = np.array([[0.4, 0.1, -0.2], [-0.1, 0.3, 0.25]])


def driven(rng, N, nu, hold=(4, 30)):
    """Return inputs of steps."""
    return np.stack([steps(rng, N, -2, 2, *hold) for _ in range(nu)], axis=1)


def soft_springs(rng, N, nu):
    """Drive two states that pull back by tanh."""

    def update(x, u):
        force = np.tanh(x)
        return A @ x + B[:, :nu] @ u - 0.4 * force

    u = driven(rng, N, nu)
    return u, np.array(iterate(update, rng.uniform(-1, 1, 2), u))


def fed_back(rng, N, nu):
    """Drive two states by inputs that tanh of the outputs changes."""

    def update(x, u):
        return A @ x + B[:, :nu] @ (u - 0.8 * np.tanh(np.resize(x[::-1], nu)))

    u = driven(rng, N, nu)
    return u, iterate(update, rng.uniform(-1, 1, 2), u)


def saturated(rng, N, nu):
    """Drive two states by inputs that saturate."""
    u = driven(rng, N, nu)
    return u, iterate(lambda x, v: A @ x + B[:, :nu] @ np.tanh(v), [0, 0], u)


def product(rng, N):
    """Let an input act on a state by their product."""

    def update(x, u):
        return [
            0.85 * x[0] + 0.2 * u[0] * (1 + 0.5 * x[1]),
            0.7 * x[1] + 0.2 * x[0] * (1 - 0.3 * u[0]),
        ]

    u = steps(rng, N, -1.5, 1.5, 4, 30)
    return u, iterate(update, [0, 0], u)[:, 1]


def products(rng, N):
    """Let two states act on each other by their product."""

    def update(x, u):
        both = tanh(x[0] * x[1])
        return [
            0.8 * x[0] + 0.2 * u[0] - 0.15 * both,
            0.75 * x[1] + 0.25 * u[1] + 0.1 * both,
        ]

    u = driven(rng, N, 2)
    return u, iterate(update, [0, 0], u)


def short(name, run, split, N, noise, dt=1.0):
    """Return a case with a short record."""
    return simulated(
        f"brief {name}", name, run, split=split, N=N, N_test=1_000, noise=noise, dt=dt
    )


CASES = (
    short("2x2 soft springs", partial(soft_springs, nu=2), "seen", 750, 0.005),
    short("3x2 fed back", partial(fed_back, nu=3), "seen", 500, 0.02),
    short("2x2 saturated", partial(saturated, nu=2), "seen", 300, 0.01),
    short("product", product, "seen", 600, 0.02),
    short("saturation", saturation, "seen", 400, 0.05),
    short("two tanks", two_tanks, "seen", 500, 0.01, 4.0),
    short("robot joint", robot_joint, "seen", 1_000, 0.01, 0.02),
    short("Duffing", duffing, "seen", 700, 0.005, 0.3),
    short("3x2 soft springs", partial(soft_springs, nu=3), "unseen", 900, 0.01),
    short("2x2 fed back", partial(fed_back, nu=2), "unseen", 400, 0.005),
    short("3x2 saturated", partial(saturated, nu=3), "unseen", 600, 0.05),
    short("2x2 products", products, "unseen", 1_000, 0.01),
    short("dead zone", dead_zone, "unseen", 500, 0.02),
    short("overflowing tank", overflowing_tank, "unseen", 800, 0.01, 4.0),
    short("drone arm", drone_arm, "unseen", 400, 0.01, 0.05),
    short("nonlinear damping", nonlinear_damping, "unseen", 800, 0.02, 0.3),
)


def fits(cases, models, seeds, path):
    """Return the rows of default fits, and of those by hand, by model and case."""
    options = {"max_time": None, "jobs": 0, "show": partial(print, flush=True)}
    run(cases, models, seeds, path, **options)
    for alpha in ALPHAS:
        rows = run(cases, models, 1, path, options={**SMALL, "alpha": alpha}, **options)
    names = {case.name for case in cases}
    rows = [row for row in rows if row["case"] in names and row["model"] in models]
    found = {}
    for row in rows:
        pair = found.setdefault((row["case"], row["model"]), ([], []))
        pair[bool(row["options"])].append(row)
    return found


def table(found):
    """Return the lines of a table, and its counts."""
    lines = [f"{'plant':26s}{'':4s}{'best by hand':>14s}  defaults, = is linear"]
    ratios, worse, missed, fell = [], 0, 0, 0
    for (case, model), (defaults, grid) in found.items():
        least = min(_relative(row) for row in grid)
        errors = [_relative(row) for row in defaults]
        linear = [LINEAR in row["message"] for row in defaults]
        ratios += [error / min(least, 1.0) for error in errors]
        worse += sum(not error <= WORSE for error in errors)
        missed += sum(linear) * (least < HALF)
        fell += sum(linear)
        cells = [
            f"{e:8.3f}{'=' if is_linear else ' '}"
            for e, is_linear in zip(errors, linear, strict=True)
        ]
        lines.append(f"{case:26s}{model:4s}{least:14.3f}  {' '.join(cells)}")
    seconds = [float(row["cpu"]) for rows, _ in found.values() for row in rows]
    lines.append(
        f"{len(ratios)} default fits: {worse} worse than the linear model, {fell} "
        f"return it, {missed} of them where options set by hand have less than half "
        f"of its error; default over the best by hand: median {np.median(ratios):.3f}, "
        f"upper tenth {np.sort(ratios)[int(0.9 * (len(ratios) - 1))]:.3f}; "
        f"median {np.median(seconds):.1f} s, all {np.sum(seconds):.0f} s"
    )
    return lines


def _relative(row):
    return float(row["relative"] or "inf")


def main(arguments=None):
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--split", choices=("seen", "unseen"), nargs="+")
    parser.add_argument("--models", choices=MODELS, nargs="+", default=MODELS)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("short_records.csv"))
    args = parser.parse_args(arguments)
    for split in args.split or ("seen", "unseen"):
        cases = [case for case in CASES if case.split == split]
        found = fits(cases, args.models, args.seeds, args.out)
        print("\n".join([split, *table(found)]), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

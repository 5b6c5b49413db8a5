"""True plants whose input is no force: does the true loop follow its linear design?

    python -m benchmarks.true_loops [--plants ...] [--seeds 10] [--jobs 2] [--quick]
                                    [--input-map identity monotone] [--models FL AL]

From a record of 2000 samples (10,000 of the "long arm": its law depends on six signals)
with 1 % noise a linear model, FL-SSNN and AL-SSNN are identified, with the defaults but
for order and feedback.  On (A, B, C) of each the same linear-quadratic regulator with
integrators is designed, and the true plant is run with it, with law and observer and
without measurement noise, along random steps of the reference, and with measured
disturbances (inflow of the tank, inlet temperature of the exchanger) that move as in
another record; the design has them, too.  The deviation is the root mean square of the
true output minus that of the designed linear loop, over the standard deviation of the
latter; the ratio is that of the deviations with law and on the linear model.  Beside it
stands what the model and its record say of this loop, by `linearizability`: the
deviation predicted, with the model in the place of the plant, and the one reported,
with the errors that the record does not rule out (eq. carried). They should agree with
the deviation within a factor 2.  Where the loop leaves the training data, nothing is
reported.

The weights do not depend on the units of v, which differ between a law u = v - h(s) and
one of another form: v is weighed by what it makes of y within the time between steps.

A loop that diverges, or a ball that falls or hits its magnet, is a failure: its
deviation is infinite.  Without --quick (two seeds) it writes the tables to
doc/benchmarks.
"""

import argparse
import os
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control
import numpy as np

import alssnn
from alssnn import AlSsnn, FlSsnn, LinearStateSpace
from alssnn.datasets import (
    make_fan_arm,
    make_heat_exchanger,
    make_magnetic_levitation,
    make_two_input_arm,
    make_valve_tank,
)
from alssnn.feedback import lqi
from benchmarks._tables import OUT, machine, replace_runs
from benchmarks.closed_loop import follow, references

SAMPLES = 2_000  # of a record, as far as a case has no other number
NOISE = 0.01  # of a record, of std(y)
LOST = 10  # a distance of so many std of the designed output counts as diverged
COLUMNS = (
    "plant",
    "model",
    "seed",
    "deviation",
    "linear",
    "ratio",
    "predicted",
    "reported",
    "seconds",
    "failure",
)
IDENTITY = "identity"  # the input map of u = v - h(s)


@dataclass(frozen=True)
class Case:
    """Say how a plant is recorded, modelled and controlled; the same for all seeds.

    `reference`, `hold`, `n_steps` and `settle` are those of `closed_loop.Setting`.
    """

    make: object  # the maker of its records
    nx: int
    reference: float  # largest deviation of the reference, in units of y
    hold: int  # samples between two steps of the reference
    weight_v: float = 0.1  # that of y is 1
    weight_z: float = 0.01  # of the integrators
    feedback: str = "state"
    limits: tuple = (None, None)  # of the actuators
    travel: tuple = (-np.inf, np.inf)  # the plant is lost where y reaches an end
    n_steps: int = 10
    settle: int = 150  # samples at rest before the first step, not counted
    disturbances: tuple = ()  # columns of the record that are measured, not moved
    samples: int = SAMPLES  # of a record


CASES = {
    "fan": Case(make_fan_arm, nx=2, reference=0.25, hold=60, limits=(0.0, 1.5)),
    "valve": Case(
        make_valve_tank,  # the inflow is measured
        nx=1,
        reference=0.12,
        hold=40,
        limits=(0.0, 1.0),
        disturbances=(1,),
    ),
    "exchanger": Case(
        make_heat_exchanger,  # the temperature of the inlet is measured
        nx=2,
        reference=2.0,  # with 4, most loops leave the training data
        hold=60,
        limits=(0.0, 20.0),
        disturbances=(1,),
    ),
    # The regulated ball: simulations of the bare one diverge, whatever the model.
    "levitation": Case(
        partial(make_magnetic_levitation, regulated=True),
        nx=2,
        reference=3.4,  # as of the others, within what was recorded
        hold=100,
        travel=(1.0, 20.0),
    ),
    # The arm starts in full motion, and the observer at rest: 350 samples until both
    # agree, also where the law is poor outside the record.
    "arm": Case(make_two_input_arm, nx=4, reference=0.3, hold=60, settle=350),
    "long arm": Case(
        make_two_input_arm, nx=4, reference=0.3, hold=60, settle=350, samples=10_000
    ),
}


@dataclass(frozen=True)
class Run:
    """Hold what became of one design on the true plant."""

    deviation: float  # inf after a failure
    predicted: float  # the same deviation of the model in the place of the plant
    reported: float  # with what the record leaves open; nan outside (eq. carried)
    seconds: float  # of the fit
    failure: str


# -- one loop --------------------------------------------------------------------------


def design(model, case, spread):
    """Return the gain of the regulator, the same for all units of v.

    `spread` is std(y) of the record, of shape (ny,).
    """
    A, B, C, _ = model.plant_.late().linear()
    nx, ny = len(A), len(C)
    weighted = C / spread[:, None]
    Q = np.zeros((nx + ny, nx + ny))
    Q[:nx, :nx] = weighted.T @ weighted
    Q[nx:, nx:] = case.weight_z * np.diag(1 / spread**2)
    # y after steps of v, still finite where the linear part is not stable
    X = np.zeros_like(B)
    for _ in range(case.hold):
        X = A @ X + B
    S = weighted @ X  # (ny, nu)
    return lqi(model, Q, case.weight_v * S.T @ S)


def attempt(case, record, model, seed):
    """Fit, design and run; a failure of any of them is a result."""
    start = time.perf_counter()
    predicted = reported = np.nan
    try:
        model.fit(record.u, record.y)
        seconds = time.perf_counter() - start
        K = design(model, case, record.y.std(axis=0))
        r = references(case, seed, model.y_offset_)
        limits = dict(zip(("u_min", "u_max"), case.limits, strict=True))
        d = disturbances(case, seed, r.shape[1])
        told = model.linearizability(
            record.u,
            record.y,
            controller=model.controller(K, **limits),
            reference=r[:, case.settle - 1 :].T,  # it rests at the first one before
            d=d[:, case.settle - 1 :].T if len(d) else None,
        )
        predicted = float(np.max(told.carried_model))
        reported = float(np.max(told.carried))
        y, designed, _ = follow(record.plant, model, K, r, record.x0, limits, d)
    except (ValueError, RuntimeError) as error:  # no gain, or a loop that diverges
        seconds = time.perf_counter() - start
        return Run(
            np.inf, predicted, reported, seconds, " ".join(str(error).split())[:80]
        )
    failure, deviation = judge(case, y, designed)
    return Run(deviation, predicted, reported, seconds, failure)


def disturbances(case, seed, n):
    """Return measured disturbances of a loop, those of another record, in rows."""
    fresh = case.make(n, random_state=1000 + seed)
    return fresh.u[:, list(case.disturbances)].T


def judge(case, y, designed):
    """Return why a loop failed, if so, and its deviation, the worst of the outputs."""
    low, high = case.travel
    if np.any((y <= low) | (y >= high)):
        return "lost", np.inf
    y, designed = y[:, case.settle :], designed[:, case.settle :]
    distance = np.sqrt(np.mean((y - designed) ** 2, axis=1)) / designed.std(axis=1)
    deviation = float(np.max(distance))
    return ("", deviation) if deviation < LOST else ("diverged", np.inf)


MODELS = {"FL": FlSsnn, "AL": AlSsnn}


def compare(name, seed, input_maps, samples=None, models=tuple(MODELS)):
    """Return the rows of one plant and one seed, those of the linear model first."""
    warnings.simplefilter("ignore")
    case = CASES[name]
    record = case.make(samples or case.samples, noise=NOISE, random_state=seed)
    common = {"nx": case.nx, "dt": record.dt}
    if case.disturbances:
        common["disturbances"] = case.disturbances
    linear = attempt(case, record, LinearStateSpace(**common), seed)
    rows = [row(name, "LTI", seed, linear, linear)]
    for input_map in input_maps:
        # only what is not the default is said: the fits of older versions compare
        chosen = {} if input_map == IDENTITY else {"input_map": input_map}
        for label in models:
            options = {"feedback": case.feedback, "random_state": seed, **chosen}
            model = MODELS[label](**common, **options)
            run = attempt(case, record, model, seed)
            rows.append(row(name, f"{label}, {input_map}", seed, run, linear))
    return rows


def row(name, label, seed, run, linear):
    """Return a row of the table; a failure beside another one has no ratio."""
    ratio = np.inf if run.failure else run.deviation / linear.deviation
    if run.failure and linear.failure:
        ratio = np.nan
    values = run.deviation, linear.deviation, ratio, run.predicted, run.reported
    return (name, label, seed, *map(float, values), run.seconds, run.failure)


# -- tables ----------------------------------------------------------------------------


def summarize(rows):
    """Return per plant and model: medians, the worst, agreement, and failures."""
    summary = []
    for name, label in dict.fromkeys((r[0], r[1]) for r in rows):
        part = [r for r in rows if r[:2] == (name, label)]
        values = np.array([r[3:8] for r in part])
        deviation, linear, ratio, predicted, reported = values.T
        known = ratio[~np.isnan(ratio)]
        inside = reported[~np.isnan(reported)]
        summary.append(
            (
                name,
                label,
                len(part),
                float(np.median(deviation)),
                float(np.median(linear)),
                float(np.median(known)) if len(known) else np.nan,
                float(known.max()) if len(known) else np.nan,
                float(np.median(predicted)),
                agreement(predicted, deviation),
                float(np.median(inside)) if len(inside) else np.nan,
                agreement(reported, deviation),
                sum(bool(np.isnan(r[7]) and not r[9]) for r in part),
                sum(bool(r[9]) for r in part),
                int(np.sum(~np.isfinite(linear))),
            )
        )
    return summary


def agreement(told, true):
    """Return how many deviations were told within a factor 2."""
    with np.errstate(all="ignore"):
        quotient = np.asarray(told) / true
    return int(np.sum((quotient >= 0.5) & (quotient <= 2)))


TITLES = (
    "plant",
    "model",
    "seeds",
    "deviation",
    "linear",
    "ratio",
    "worst",
    "predicted",
    "agree",
    "reported",
    "agree",
    "outside",
    "failed",
    "linear failed",
)


def cells(line):
    """Return the numbers of a line as short text."""
    return [f"{v:.4f}" if isinstance(v, float) else str(v) for v in line]


def write_table(rows, load):
    """Write all runs as CSV, beside those of others, and medians as Markdown."""
    note = machine(load, alssnn, np, control)
    table = replace_runs(OUT / "true_loops.csv", COLUMNS, rows, note, n_first=2)
    kept = [(*r[:3], *map(float, r[3:9]), r[9]) for r in table]
    text = [
        "# True plants with real actuators in closed loop",
        "",
        "By `python -m benchmarks.true_loops --input-map identity monotone`.",
        "Deviation: true minus designed output,",
        "over the standard deviation of the designed one; linear: that of the same",
        "design on a linear model; ratio of the two per seed, median and worst;",
        "predicted: the deviation with the model in the place of the plant; reported:",
        "that of `linearizability` for this loop, with what the record leaves open;",
        "agree: seeds where they tell the deviation within a factor 2; outside: loops",
        "that leave the training data, for which nothing is reported; failed: loops",
        "that diverged or lost the ball.",
        "",
        f"| {' | '.join(TITLES)} |",
        "|" + "---|" * len(TITLES),
        *(f"| {' | '.join(cells(line))} |" for line in summarize(kept)),
        "",
        *(f"{note}." for note in dict.fromkeys(r[-1] for r in table)),
    ]
    (OUT / "true_loops.md").write_text("\n".join(text) + "\n")


def show(rows):
    """Print rows of runs."""
    for name, label, seed, *values, failure in rows:
        numbers = "".join(f"{v:11.4f}" for v in values[:5])
        print(f"{name:12s}{label:16s}{seed:4d}{numbers}{values[5]:11.1f} {failure}")
    sys.stdout.flush()


def main():
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", choices=CASES, nargs="+", default=list(CASES))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--input-map", nargs="+", default=[IDENTITY])
    parser.add_argument("--models", choices=MODELS, nargs="+", default=list(MODELS))
    parser.add_argument("--samples", type=int, help="of all records; writes no files")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="two seeds, no files")
    options = parser.parse_args()
    load, start = os.getloadavg()[0], time.perf_counter()
    seeds = range(2 if options.quick else options.seeds)
    tasks = [(name, seed) for name in options.plants for seed in seeds]
    print(f"{'plant':12s}{'model':16s}seed", *(f"{c:>10s}" for c in COLUMNS[3:9]))
    rows = []
    # fresh processes: a fork would copy the threads of the libraries
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        kind = options.input_map, options.samples, options.models
        jobs = [pool.submit(compare, *task, *kind) for task in tasks]
        for job in jobs:
            rows += job.result()
            show(job.result())
    print("\n" + "".join(f"{title:>14s}" for title in TITLES))
    for line in summarize(rows):
        print("".join(f"{cell:>14s}" for cell in cells(line)))
    print(f"{time.perf_counter() - start:.0f} s")
    if not options.quick and options.samples is None:
        write_table(rows, load)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Unstable plants from records of their regulators: do models hold them?

    python -m benchmarks.unstable [--plants pendulum levitation] [--seeds 10]
                                  [--models FL AL] [--feedback state output]

An inverted pendulum, x'' = 20 sin(x) - 0.2 x' + 5 u sampled every 20 ms, is kept within
about 0.3 rad by a PD controller of the measured angle, with steps of its reference, a
dither, 1 % measurement noise and noise of the process; recorded are u and the angle.
The ball below a magnet (`alssnn.datasets.make_magnetic_levitation`) is held by its own
regulator; recorded are current and gap with 1 % noise.  FL-SSNN and AL-SSNN of two
states are fitted with ``noise="innovations"``, for the ball with
``input_map="monotone"``, and otherwise with the defaults.  On (A, B, C) a
linear-quadratic regulator with integrators is designed, and the true plant is run with
it, with law and observer, from two starts at rest, 0.5 rad or 2 mm to either side; the
observer starts at the operating point.  The coil takes 0 to 2 A, as without limits the
first reaction to a ball 2 mm off may be far beyond all recorded currents.

A start is held if y never leaves the travel (1.5 rad; 1 to 20 mm) and ends within 5 %
of the first distance.  `pole` is the largest one of the linear part, `pole of f` that
of the whole model at its operating point; the true ones are 1.091 and 1.093.  `ahead`
is the error one sample ahead on a fresh record over the standard deviation of y.

Required: all are held from both sides.  Exits with 1 if one is not; writes its table to
doc/benchmarks, unless --quick (one seed of FL-SSNN).
"""

import argparse
import csv
import os
import sys
import time
import warnings
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import control
import numpy as np

from alssnn import AlSsnn, FlSsnn
from alssnn.datasets import Record, make_magnetic_levitation
from alssnn.feedback import closed_loop
from benchmarks._tables import OUT
from benchmarks.true_loops import Case, design

DT, STEPS = 0.02, 4  # of the pendulum: sampling in s, Runge-Kutta steps per sample
GRAVITY, FRICTION, TORQUE = 20.0, 0.2, 5.0
K_P, K_D, FILTER = 10.0, 1.5, 0.5  # of its regulator; pole of the differentiator
REFERENCE, HOLD = 0.15, (25, 75)  # rad, and samples between two of its steps
DITHER, PROCESS, MEASUREMENT = 0.2, 0.05, 0.01  # std beside u, of w, over std(y)
SAMPLES, WARMUP = 2_000, 200
HELD, RUN = 0.05, 250  # share of the first distance, and samples of a loop
MODELS = {"FL": FlSsnn, "AL": AlSsnn}
COLUMNS = (
    "plant",
    "model",
    "feedback",
    "seed",
    "held",
    "pole",
    "pole of f",
    "ahead",
    "seconds",
    "failure",
)


# -- the pendulum ----------------------------------------------------------------------


def swing(x, u):
    """Return angle and speed one sample later."""
    dt = DT / STEPS

    def slope(x):
        angle, speed = x
        return np.array(
            [speed, GRAVITY * np.sin(angle) - FRICTION * speed + TORQUE * u]
        )

    for _ in range(STEPS):
        a = slope(x)
        b = slope(x + dt / 2 * a)
        c = slope(x + dt / 2 * b)
        d = slope(x + dt * c)
        x = x + dt / 6 * (a + 2 * b + 2 * c + d)
    return x


def make_pendulum(n_samples, *, noise=MEASUREMENT, random_state=0):
    """Return a record of the regulated pendulum: torque and measured angle."""
    rng = np.random.default_rng(random_state)
    n = WARMUP + n_samples
    r = np.repeat(rng.uniform(-REFERENCE, REFERENCE, n), rng.integers(*HOLD, n))[:n]
    level = noise * REFERENCE  # about the standard deviation of y
    x, speed, before = np.zeros(2), 0.0, 0.0
    u, y = np.empty((2, n))
    for k in range(n):
        y[k] = x[0] + level * rng.standard_normal()
        speed = FILTER * speed + (1 - FILTER) * (y[k] - before) / DT
        before = y[k]
        u[k] = K_P * (r[k] - y[k]) - K_D * speed + DITHER * rng.standard_normal()
        x = swing(x, u[k] + PROCESS * rng.standard_normal())
    plant = control.nlsys(
        lambda t, x, u, params: swing(x, u[0]),
        lambda t, x, u, params: x[:1],
        inputs=["torque"],
        outputs=["angle"],
        states=["angle", "speed"],
        dt=DT,
    )
    u, y = u[WARMUP:, None], y[WARMUP:]
    return Record(u, y, DT, "inverted pendulum", plant, np.zeros(2))


# -- plants ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Setting:
    """Say how a plant is recorded, modelled and started."""

    case: Case
    rest: float  # reference, in units of y
    away: float  # distance of the starts
    options: tuple = ()  # of the models, pairs


PLANTS = {
    "pendulum": Setting(
        Case(make_pendulum, nx=2, reference=0, hold=10, travel=(-1.5, 1.5)),
        rest=0.0,
        away=0.5,
    ),
    "levitation": Setting(
        Case(
            make_magnetic_levitation,
            nx=2,
            reference=0,
            hold=10,
            limits=(0.0, 2.0),  # 0.4 to 1.7 A are in the records
            travel=(1.0, 20.0),
        ),
        rest=10.0,
        away=2.0,
        options=(("input_map", "monotone"),),
    ),
}


# -- one model -------------------------------------------------------------------------


def held(setting, record, model, start):
    """Return whether a design on a model holds the true plant from a start."""
    case = setting.case
    K = design(model, case, record.y.reshape(len(record.y), -1).std(axis=0))
    limits = dict(zip(("u_min", "u_max"), case.limits, strict=True))
    law = model.linearizing_law(**limits)
    loop = closed_loop(record.plant, model, K, law=law)
    x0 = np.zeros(loop.nstates)
    x0[0] = start  # the plant comes first
    t = record.dt * np.arange(RUN)
    r = np.full((1, RUN), setting.rest)
    y = control.input_output_response(loop, t, r, x0, squeeze=False).outputs[0]
    low, high = case.travel
    end = np.abs(y[-RUN // 5 :] - setting.rest).max()
    return bool(np.all((low < y) & (y < high)) and end <= HELD * setting.away)


def attempt(name, label, feedback, seed):
    """Return the row of one fit; a failure is one, too."""
    setting = PLANTS[name]
    case = setting.case
    record = case.make(SAMPLES, noise=MEASUREMENT, random_state=seed)
    fresh = case.make(SAMPLES, noise=MEASUREMENT, random_state=1000 + seed)
    options = {"nx": case.nx, "dt": record.dt, "feedback": feedback}
    model = MODELS[label](
        **options, noise="innovations", random_state=seed, **dict(setting.options)
    )
    count, pole, pole_f, ahead, failures = 0, np.nan, np.nan, np.nan, []
    start = time.perf_counter()
    try:
        model.fit(record.u, record.y)
        seconds = time.perf_counter() - start
        plant = model.plant_
        pole = np.abs(np.linalg.eigvals(model.A_)).max()
        whole = plant.jacobian(np.zeros(plant.nx), plant.u_offset)[0]
        pole_f = np.abs(np.linalg.eigvals(whole)).max()
        error = model.predict_ahead(fresh.u, fresh.y) - fresh.y
        ahead = error[50:].std() / fresh.y.std()
    except (ValueError, RuntimeError) as problem:
        seconds = time.perf_counter() - start
        failures.append(" ".join(str(problem).split())[:60])
    else:
        for side in (-1, 1):
            try:
                ok = held(setting, record, model, setting.rest + side * setting.away)
            except (ValueError, RuntimeError) as problem:
                failures.append(" ".join(str(problem).split())[:60])
            else:
                count += ok
    head = (name, label, feedback, seed, f"{count}/2")
    figures = [f"{float(v):.4f}" for v in (pole, pole_f, ahead)]
    return [
        *map(str, head),
        *figures,
        f"{seconds:.1f}",
        "; ".join(dict.fromkeys(failures)),
    ]


# -- table -----------------------------------------------------------------------------


def summarize(rows):
    """Return per plant, model and feedback: seeds held, and medians."""
    lines = []
    for key in dict.fromkeys(tuple(row[:3]) for row in rows):
        part = [row for row in rows if tuple(row[:3]) == key]
        count = sum(row[4] == "2/2" for row in part)
        figures = np.array([[float(v) for v in row[5:8]] for row in part])
        unstable = int(np.sum(figures[:, 1] > 1))
        medians = [f"{v:.4f}" for v in np.nanmedian(figures, axis=0)]
        lines.append([*key, f"{count} of {len(part)}", *medians, str(unstable)])
    return lines


def write(rows):
    """Write runs as CSV, in place of those with the same key, and Markdown."""
    path = OUT / "unstable.csv"
    keys = {tuple(row[:4]) for row in rows}
    if path.exists():
        with path.open(newline="") as file:
            old = [r for r in list(csv.reader(file))[1:] if tuple(r[:4]) not in keys]
        rows = sorted(old + rows, key=lambda row: [*row[:3], int(row[3])])
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])
    titles = ("plant", "model", "feedback", "held", *COLUMNS[5:8], "f unstable")
    text = [
        "# Unstable plants identified from records of their regulators",
        "",
        "By `python -m benchmarks.unstable`: loops of law, observer and regulator with",
        "integrators on the true plant. Held: seeds that were, from both starts;",
        "medians of the largest pole of the linear part, of that of the whole model at",
        "its operating point (true: 1.091 pendulum, 1.093 levitation), and of the",
        "error one sample ahead on a fresh record over the standard deviation of y; f",
        "unstable: seeds whose whole model is unstable there, as the plant is.",
        "",
        f"| {' | '.join(titles)} |",
        "|" + "---|" * len(titles),
        *(f"| {' | '.join(line)} |" for line in summarize(rows)),
    ]
    (OUT / "unstable.md").write_text("\n".join(text) + "\n")


def main():
    """Fit, run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", choices=PLANTS, nargs="+", default=list(PLANTS))
    parser.add_argument("--models", choices=MODELS, nargs="+", default=list(MODELS))
    parser.add_argument("--feedback", nargs="+", default=["state", "output"])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--quick", action="store_true", help="one seed, no files")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.quick:
        options.seeds, options.models, options.feedback = 1, ["FL"], ["state"]
    print("".join(f"{title:>12s}" for title in COLUMNS))
    rows = []
    for name in options.plants:
        for label in options.models:
            for feedback in options.feedback:
                for seed in range(options.seeds):
                    rows.append(attempt(name, label, feedback, seed))
                    print("".join(f"{c:>12s}" for c in rows[-1]), flush=True)
                    if not options.quick:
                        write(rows)
    for line in summarize(rows):
        print("  ".join(line))
    return int(any(row[4] != "2/2" for row in rows))


if __name__ == "__main__":
    sys.exit(main())

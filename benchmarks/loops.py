"""Loops of default models: near their design, near the data, true on the true plant?

    python -m benchmarks.loops [--cases ...] [--models lti fl al] [--seeds 1] [--jobs 2]
                               [--set linear_part=trained] [--out FILE.csv]
    python -m benchmarks.loops --table FILE.csv [--page]

Fits models with default options to plants of `benchmarks.field`. Told are, on the test
of the plant, the linearization error along the test, and in the loop that its input
drives as v; the share of this loop outside the region of the training data; the size of
the law in the loop, over that of the input; and the seconds of the fit.

Where the equations of the plant can be run (`benchmarks.field.truth`), and it has no
more outputs than inputs, the true loop is run, too, without noise: regulator and
integrators of `lqi` by the weights of `balanced_weights`, observer and law. The
reference is a staircase of ten levels within half a standard deviation of the output.
Inputs are cut at those of the record, which larger levels would ask for. Told are the
root mean square distance of the true output from its design and from the reference,
over the standard deviation of the output, the largest of the outputs; and what
`linearizability` expects of the first. A loop that diverges, or is ten standard
deviations away, has failed.

--set gives other options to all models that have them. --table prints a file again,
and compares the true loops with those of the linear model; --page writes the table of
the manual.
"""

import argparse
import csv
import os
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import control
import joblib
import numpy as np

import alssnn
from alssnn.feedback import balanced_weights, lqi
from benchmarks._tables import OUT, machine
from benchmarks.closed_loop import follow
from benchmarks.field.__main__ import CASES, assignment
from benchmarks.field.case import columns
from benchmarks.field.runs import MODELS, score
from benchmarks.field.truth import truth

REACH = 0.5  # of the reference, standard deviations of the output
HOLD, STEPS = 60, 10  # samples between two steps of the reference, and their number
SETTLE = 300  # samples before the first one, not counted
LOST = 10  # standard deviations from the design
KEY = ("case", "model", "options", "seed")
NUMBERS = (
    "rmse",
    "along",
    "in_loop",
    "outside",
    "law",
    "seconds",
    "distance",
    "tracking",
    "expected",
)
COLUMNS = (*KEY, *NUMBERS, "failure")
NAMES = {"lti": "LinearStateSpace", "fl": "FlSsnn", "al": "AlSsnn"}


def measure(case, name, options, seed):
    """Return the row of one fit."""
    data = case.load()
    model = MODELS[name](dt=data.dt)
    known = model.get_params()
    model.set_params(**{k: v for k, v in options.items() if k in known})
    if "random_state" in known:
        model.set_params(random_state=seed)
    u, y = map(list, zip(*data.train, strict=True))
    start = time.perf_counter()
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        model.fit(u, y)
        seconds = time.perf_counter() - start
        model.set_params(n_init_samples=case.n_init)
        (test, *_) = data.tests.values()
        row = {
            "case": case.name,
            "model": name,
            "options": "; ".join(f"{k}={v!r}" for k, v in sorted(options.items())),
            "seed": seed,
            "rmse": score(model, test, case.scale)["rmse"],
            "seconds": seconds,
            **(seen_by(model, test) if name != "lti" else {}),
        }
        own = truth(case)
        if own is not None and own.plant.noutputs <= own.plant.ninputs:
            row |= true_loop(model, own, data.train)
    return row


def seen_by(model, test):
    """Return what the model says of its loop, driven by the input of a test as v."""
    found = [model.linearizability(*pair) for pair in test]
    return {
        "along": np.mean([each.linearization_error for each in found]),
        "in_loop": np.mean([each.closed_linearization_error for each in found]),
        "outside": np.mean([each.closed_outside for each in found]),
        "law": np.mean([each.closed_law_size for each in found]),
    }


def true_loop(model, own, train):
    """Return how far the true loop is from its design, and from its reference."""
    std = np.vstack([columns(y) for _, y in train]).std(axis=0)
    steps = np.random.default_rng(0).uniform(-REACH, REACH, (len(std), STEPS))
    start = np.zeros((len(std), SETTLE))
    steps = np.hstack([start, np.repeat(steps, HOLD, axis=1)]) * std[:, None]
    r = model.y_offset_[:, None] + steps
    limits = {"u_min": own.u_min, "u_max": own.u_max}
    told = {"distance": np.inf, "tracking": np.inf}
    try:
        K = lqi(model, *balanced_weights(model))
        y, designed, _ = follow(own.plant, model, K, r, own.x0, limits)
        shares = expected(model, K, r, limits, train)  # of the designed output
        told["expected"] = np.max(shares * designed[:, SETTLE:].std(axis=1) / std)
    except (ValueError, RuntimeError) as error:  # no gain, or a loop that diverges
        return told | {"failure": " ".join(str(error).split())[:80]}
    for name, other in (("distance", designed), ("tracking", r)):
        error = (y - other)[:, SETTLE:]
        told[name] = float(np.max(np.sqrt(np.mean(error**2, axis=1)) / std))
    if not told["distance"] < LOST:
        told |= {"distance": np.inf, "failure": "diverged"}
    return told


def expected(model, K, r, limits, train):
    """Return what `linearizability` expects, by output; nan where it tells nothing."""
    u, y = train[0]
    controller = model.controller(K, **limits)
    reference = r[:, SETTLE - 1 :].T
    found = model.linearizability(u, y, controller=controller, reference=reference)
    return np.nan if found.carried is None else found.carried


# -- tables ----------------------------------------------------------------------------


def line(row):
    """Return what is printed of a row."""
    shares = (f"{100 * row.get(n, np.nan):9.1f}%" for n in NUMBERS[1:4])
    loop = (f"{row.get(n, np.nan):9.4f}" for n in NUMBERS[6:])
    return (
        f"{row['case']:18s}{row['model']:4s}{row['options']:24s}{row['seed']:>3} "
        f"{''.join(shares)}{row.get('law', np.nan):8.2f}{row['seconds']:8.1f}"
        f"{''.join(loop)} {row.get('failure', '')}"
    )


def summary(rows):
    """Return lines that compare true loops with those of the linear model."""
    linear = {row["case"]: row for row in rows if row["model"] == "lti"}
    lines = []
    for name, options in dict.fromkeys((r["model"], r["options"]) for r in rows):
        mine = [
            row
            for row in rows
            if (row["model"], row["options"]) == (name, options)
            and np.isfinite(linear.get(row["case"], {}).get("distance", np.nan))
        ]
        if not mine:
            continue
        ratio = np.array([r["distance"] / linear[r["case"]]["distance"] for r in mine])
        told = [row for row in mine if row["expected"] > 0]
        quotient = np.array([row["expected"] / row["distance"] for row in told])
        beside = (
            f"distance over that of the linear model: median {np.median(ratio):.2f}, "
            f"at most 1/2 in {np.sum(ratio <= 0.5)}, above 1 in {np.sum(ratio > 1)}, "
        )
        lines.append(
            f"{NAMES[name]} {options}".strip()
            + f": {len(mine)} true loops, {'' if name == 'lti' else beside}"
            f"failed {sum(bool(r.get('failure')) for r in mine)}; told within a factor "
            f"2 in {np.sum((quotient >= 0.5) & (quotient <= 2))} of {len(told)}, too "
            f"small in {np.sum(quotient < 0.5)}"
        )
    return lines


def page(rows, note):
    """Return the page of the manual: a row per plant, distances and references."""
    rows = sorted(rows, key=lambda row: list(NAMES).index(row["model"]))
    kinds = list(dict.fromkeys((r["model"], r["options"]) for r in rows))
    names = [f"{NAMES[m]} {options}".strip() for m, options in kinds]
    of = {(r["case"], r["model"], r["options"]): r for r in rows if r["seed"] == 0}
    text = [
        "# True loops of default models",
        "",
        "By `python -m benchmarks.loops --page`. Distance of the true output from its",
        "design, in brackets from the reference, in percent of the standard deviation",
        "of the output of the record.",
        "",
        f"| plant | {' | '.join(names)} |",
        "|" + "---|" * (1 + len(kinds)),
    ]
    for case in sorted({r["case"] for r in rows if not np.isnan(r["distance"])}):
        cells = []
        for kind in kinds:
            row = of.get((case, *kind))
            if row is None or np.isnan(row["distance"]):
                cells.append("")
            elif np.isinf(row["distance"]):
                cells.append("failed")
            else:
                shares = 100 * row["distance"], 100 * row["tracking"]
                cells.append("{:.2g} ({:.0f})".format(*shares))
        text.append(f"| {case} | {' | '.join(cells)} |")
    return [*text, "", *(f"- {each}." for each in summary(rows)), "", f"{note}.", ""]


def read(path):
    """Return the rows of a file; none without one."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [
        {**row, "seed": int(row["seed"])} | {n: float(row[n] or "nan") for n in NUMBERS}
        for row in rows
    ]


def append(path, row):
    """Append a row to a file, which may be new."""
    is_new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(
            {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()}
        )


def main(arguments=None):
    """Fit all cases and print a line per fit, or print a file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    plants = [name for name, case in CASES.items() if case.split != "real"]
    parser.add_argument("--cases", nargs="+", choices=CASES, default=plants)
    parser.add_argument("--models", nargs="+", choices=NAMES, default=list(NAMES))
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--set", type=assignment, nargs="+", default=[], dest="options")
    parser.add_argument("--out", type=Path, default=Path("loops.csv"))
    parser.add_argument("--table", type=Path, help="print this file and run nothing")
    parser.add_argument("--page", action="store_true", help="write the manual's table")
    chosen, load = parser.parse_args(arguments), os.getloadavg()[0]
    rows = read(chosen.table or chosen.out)
    if chosen.table is None:
        text = "; ".join(f"{k}={v!r}" for k, v in sorted(chosen.options))
        there = {tuple(row[k] for k in KEY) for row in rows}
        jobs = [
            joblib.delayed(measure)(CASES[case], name, options, seed)
            for case in chosen.cases
            for name in chosen.models
            for options in [{} if name == "lti" else dict(chosen.options)]
            for seed in range(1 if name == "lti" else chosen.seeds)
            if (case, name, text if options else "", seed) not in there
        ]
        parallel = joblib.Parallel(chosen.jobs, return_as="generator_unordered")
        for row in parallel(jobs):
            print(line(row), flush=True)
            append(chosen.out, row)
        rows = read(chosen.out)
    else:
        print("\n".join(map(line, rows)))
    for text in summary(rows):
        print(text)
    if chosen.page:
        note = machine(load, alssnn, np, control)
        (OUT / "loops.md").write_text("\n".join(page(rows, note)), encoding="utf-8")


if __name__ == "__main__":
    main()

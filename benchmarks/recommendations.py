"""Does `look` recommend the family of models that a search finds best?

    python -m benchmarks.recommendations [--case ...] [--quick]
    python -m benchmarks.recommendations --search RUNS.csv [--case ...]

`look` on the training records of the field benchmark, beside the errors of default fits
(seed 0) on its tests: linear, FlSsnn with an h of the outputs and with one of the
state, AlSsnn.  The best family is the simplest of these four whose error is within 20 %
of the least.  Counted is how often the recommendation is of that family (linear, FL or
AL), and how often the outputs or the state, too; how often it is right about linear or
not; how often the error of what is recommended is at most 1.5 times the least; and how
often a nonlinear model is recommended where the linear one has at most 1.05 times the
least error, which must not happen.

The thresholds of `look` were chosen on the plants that the field benchmark calls seen.
Those that it calls unseen, and all measured records, were looked at with them fixed.

A default fit returns its linear model where hidden samples do not speak for networks,
which says nothing of the family.  Where all three do, fits of the order of the linear
model with a fixed decay of the networks (1e-2, 1e-3 and 1e-4), which are not judged,
stand beside them, and the least error of a family counts: the best that anyone found.

--search makes the fits, minutes each; a run goes on where its file ends, and its errors
go to doc/benchmarks/families.csv.  Without --quick (the first four cases) the table
goes to doc/benchmarks/recommendations.md.  Cases whose data are missing are "not run".
"""

import argparse
import csv
import os
import sys
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import alssnn
from alssnn.estimators import LEFT_LINEAR
from benchmarks._tables import OUT, machine
from benchmarks.field.__main__ import CASES
from benchmarks.field.runs import read, run

FAMILIES = ("linear", "h(y)", "h(x)", "AL")  # simplest first
NEAR, BEARABLE, FLOOR = 1.2, 1.5, 1.05  # error over the least one
ERRORS = OUT / "families.csv"
NOTHING, NOT_RUN = "no model", "not run"
DECAYS = (1e-2, 1e-3, 1e-4)  # of fits that nothing judges
NETWORKS = ((["fl"], {"feedback": "output"}), (["fl", "al"], {}))
HALVES = {"seen": "tuned", "unseen": "unseen", "real": "unseen"}


def known():
    """Return the cases; nobody has searched all families of the later plants."""
    return [n for n, case in CASES.items() if case.split in HALVES and not case.big]


def searched(path=ERRORS):
    """Return errors over that of the linear model by case, of all families."""
    with path.open(encoding="utf-8", newline="") as file:
        return {
            row.pop("case"): {k: float(v) for k, v in row.items()}
            for row in csv.DictReader(file)
        }


def search(names, path):
    """Fit all families to cases, and write their errors beside those known."""
    cases = [CASES[name] for name in names]
    for models, options in NETWORKS:
        run(cases, models, 1, path, options=options, jobs=0)
    for case in cases:
        rows = [row for row in read(path) if row["case"] == case.name]
        fits = [row for row in rows if row["model"] != "lti"]
        if not all(row["message"].startswith(LEFT_LINEAR) for row in fits):
            continue
        nx = max(2, *(int(row["nx"]) for row in rows if row["model"] == "lti"))
        for alpha in DECAYS:
            fixed = {"nx": nx, "alpha": alpha, "n_init": 1}
            for models, options in NETWORKS:
                mine = {f"{m}.{k}": v for m in models for k, v in fixed.items()}
                run([case], models, 1, path, options=options | mine, jobs=0)
    gather(read(path))


def gather(rows, path=ERRORS):
    """Write the least errors of families, means over tests, beside those known."""
    known = {"lti": "linear", "al": "AL"}
    parts = {}
    for row in rows:
        bare = "h(y)" if "feedback='output'" in row["options"] else "h(x)"
        fits = parts.setdefault(row["case"], {})
        errors = fits.setdefault(known.get(row["model"], bare), {})
        errors.setdefault(row["options"], []).append(float(row["relative"]))
    found = searched(path) if path.exists() else {}
    found |= {
        case: {
            family: min(float(np.mean(errors)) for errors in fits[family].values())
            for family in FAMILIES
        }
        for case, fits in parts.items()
        if len(fits) == len(FAMILIES)
    }
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["case", *FAMILIES])
        for case in CASES:
            if case in found:
                writer.writerow([case, *(f"{found[case][k]:.4g}" for k in FAMILIES)])


def best(errors):
    """Return the simplest family that is nearly the best."""
    least = min(errors.values())
    return next(name for name in FAMILIES if errors[name] <= NEAR * least)


def kind(family):
    """Return the family without what h sees."""
    return "FL" if family.startswith("h") else family


def recommended(case):
    """Return what `look` recommends for the training records of a case."""
    data = case.load()
    us, ys = zip(*data.train, strict=True)
    us, ys = ([np.reshape(z, (len(z), -1)) for z in zs] for zs in (us, ys))
    wanted = alssnn.look(us, ys, dt=data.dt).recommendation
    if not wanted:
        return NOTHING
    if wanted.estimator is alssnn.FlSsnn:
        return "h(y)" if wanted.options["feedback"] == "output" else "h(x)"
    return "AL" if wanted.estimator is alssnn.AlSsnn else "linear"


def table(found, errors):
    """Return the table of recommendations by case, and what they amount to."""
    lines = [
        "| case | thresholds | look recommends | best by search | its error / least |",
        "|---|---|---|---|--:|",
    ]
    counts = {half: [] for half in dict.fromkeys(HALVES.values())}
    for name, family in found.items():
        half = HALVES[CASES[name].split]
        cells = [name, half, family, "-", "-"]
        if name in errors and family != NOT_RUN:
            wanted, least = best(errors[name]), min(errors[name].values())
            loss = errors[name].get(family, np.inf) / least
            nonlinear = family not in ("linear", NOTHING)
            counts[half].append(
                (
                    kind(family) == kind(wanted),
                    family == wanted,
                    (family == "linear") == (wanted == "linear"),
                    loss <= BEARABLE,
                    nonlinear and errors[name]["linear"] <= FLOOR * least,
                )
            )
            cells[3:] = wanted, f"{loss:.2f}"
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, "", *(_said(*item) for item in counts.items())])


def _said(half, hits):
    """Return the counts of a half in words."""
    n = len(hits)
    if not n:
        return f"Thresholds {half}: no case with recorded fits was run."
    family, exact, is_linear, bearable, false = np.sum(hits, axis=0)
    return (
        f"Thresholds {half}: {family} of {n} ({100 * family / n:.0f} %) are the best "
        f"family, {exact} with what h sees; {is_linear} are right about linear or not; "
        f"{bearable} have at most {BEARABLE} times the least error; {false} are "
        f"nonlinear where the linear model is within {100 * FLOOR - 100:.0f} % of the "
        "best.\n"
    )


def main(arguments=None):
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", nargs="+", choices=sorted(known()))
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--search", type=Path, metavar="RUNS.csv")
    options = parser.parse_args(arguments)
    load, found = os.getloadavg()[0], {}
    names = options.case or known()[: 4 if options.quick else None]
    if options.search is not None:
        search(names, options.search)
        return 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for name in names:
            start = time.process_time()
            try:
                found[name] = recommended(CASES[name])
            except OSError as error:  # a record that is not on this machine
                print(f"{name}: {error}", flush=True)
                found[name] = NOT_RUN
                continue
            seconds = time.process_time() - start
            print(f"{name}: {found[name]}, {seconds:.1f} s of processor", flush=True)
    text = table(found, searched())
    print(text)
    if not (options.quick or options.case):
        (OUT / "recommendations.md").write_text(
            f"{text}\n{machine(load, np, alssnn)}\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

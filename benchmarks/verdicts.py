"""The verdict of `validate`: how often does it fail good models, and pass wrong ones?

    python -m benchmarks.verdicts [--good 200] [--seeds 6] [--quick]

Good models have the structure of their plant and are judged on a fresh record of the
same kind: four plants (two linear ones, of two inputs and outputs and of a resonance;
two that a law linearizes), white noise and noise of a pole at 0.9 with 10 % of the
standard deviation of the output, 500 to 2,000 samples.  The baseline is the linear
model.  A structure alone makes no good model: one that misses more than 10 % of the
output without noise, or whose law leaves the true plant that far from the linear
design, is not counted, but listed with what the verdict said.

Wrong models are trained on one thing and judged on another, or are too small, too
large, too late, or lead to a law that fails (`WRONG`).  Every case runs with several
seeds; its row shows the largest error of the free run against the output without noise,
as a share of its standard deviation, and what the verdict named.

Without --quick it writes doc/benchmarks/verdicts.md. Exits with 1 if a wrong model
passes, or more than 3 % of the good ones fail.
"""

import argparse
import collections
import itertools
import os
import platform
import sys
import warnings
from datetime import date
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import scipy

import alssnn
from alssnn import LinearStateSpace
from alssnn.validation import validate
from benchmarks.wrong_models import (
    PLANTS,
    WRONG,
    error_of,
    identified,
    loop_error,
    record,
)

OUT = Path(__file__).parents[1] / "doc" / "benchmarks" / "verdicts.md"
SAMPLES = (500, 650, 850, 1200, 2000)
POLES = {"white": 0.0, "colored": 0.9}
BAD = 0.1  # share of the true output, of a model that is not good
ALLOWED = 0.03  # share of good models that may fail


def good_models(n, show=print, start=0):
    """Return what failed of n good models: a list of (name, checks that failed).

    Also the number of good models per plant, and those that were none: a list of
    (name, errors, checks that failed).
    """
    kinds = [
        (plant, color, samples)
        for plant in PLANTS
        if PLANTS[plant].good
        for color in POLES
        for samples in SAMPLES
    ]
    failed, counts, bad = [], collections.Counter(), []
    for i in itertools.count(start):
        if sum(counts.values()) == n:
            return failed, counts, bad
        plant, color, samples = kinds[i % len(kinds)]
        rng = np.random.default_rng(5_000 + i)
        options = {"pole": POLES[color], "rng": rng}
        training, fresh = (record(plant, samples, **options) for _ in range(2))
        model = identified(plant, training.u, training.y)
        baseline = LinearStateSpace(PLANTS[plant].nx).fit(training.u, training.y)
        validation = validate(model, fresh.u, fresh.y, baseline=baseline)
        name, found = f"{plant}, {color}, N={samples}", _failures(validation)
        errors = [error_of(_predicted(model, fresh), fresh.clean)]
        if PLANTS[plant].n_h:
            errors.append(loop_error(plant, model, fresh.u))
        if not max(errors) <= BAD:
            bad.append((name, errors, found or "nothing"))
            show(f"no good model {i}: {bad[-1]}")
            continue
        counts[plant] += 1
        if not validation.passed:
            failed.append((name, found))
            show(f"false alarm {i}: {failed[-1]}")


def _predicted(model, data):
    return np.asarray(model.predict(data.u)).reshape(data.clean.shape)


def wrong_models(seeds, show=print, names=tuple(WRONG)):
    """Return rows of wrong models: name, whether it passed, error, what failed."""
    rows = []
    for name in names:
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            model, fresh, baseline = WRONG[name](rng)
            validation = validate(model, fresh.u, fresh.y, baseline=baseline)
            error = error_of(_predicted(model, fresh), fresh.clean)
            rows.append((name, validation.passed, error, _failures(validation)))
            verdict = "FALSE PASS" if validation.passed else "fails"
            show(f"{name:<55s} {seed} {verdict} {rows[-1][2]:8.3g} {rows[-1][3]}")
    return rows


def _failures(validation):
    return ", ".join(c.name for c in validation if c.decides and not c.passed)


def _by_check(failed):
    counts = collections.Counter(part for _, by in failed for part in by.split(", "))
    return counts.most_common()


def _report(failed, counts, bad, rows):
    """Return the page, as lines."""
    passes, n_good = sum(row[1] for row in rows), sum(counts.values())
    seeds = len(rows) // len(WRONG)
    lines = [
        "# Verdicts of `validate`",
        "",
        f"By `python -m benchmarks.verdicts --good {n_good} --seeds {seeds}`.",
        "",
        f"- false alarms: {len(failed)} of {n_good} good models "
        f"({len(failed) / n_good:.1%})",
        f"- false passes: {passes} of {len(rows)} wrong models ({len(WRONG)} cases)",
        "",
        "Alarms by check: "
        + ", ".join(f"{count} {name}" for name, count in _by_check(failed))
        + ".",
        "",
        "Good models: "
        + ", ".join(f"{count} of {plant}" for plant, count in counts.items())
        + ".",
        "",
        f"Of the right structure, but no good models: {len(bad)}, of which the verdict "
        f"fails {sum(found != 'nothing' for _, _, found in bad)}.",
        "",
    ]
    if bad:
        lines += ["| no good model | free run, loop | named |", "|---|---|---|"]
        lines += [
            f"| {name} | {', '.join(f'{e:.0%}' for e in errors)} | {found} |"
            for name, errors, found in bad
        ] + [""]
    if failed:
        lines += ["| good model that failed | by |", "|---|---|"]
        lines += [f"| {name} | {by} |" for name, by in failed] + [""]
    lines += [
        "| wrong model | passed | error of the free run | named |",
        "|---|---|---|---|",
    ]
    for name in WRONG:
        mine = [row for row in rows if row[0] == name]
        error = np.max([row[2] for row in mine])
        error = f"{error:.1%}" if error < 10 else "diverges" if error > 1e3 else "> 10"
        named = sorted({part for row in mine for part in row[3].split(", ") if part})
        passed = f"{sum(row[1] for row in mine)} of {len(mine)}"
        lines.append(f"| {name} | {passed} | {error} | {', '.join(named)} |")
    return lines


def main(arguments=None):
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--good", type=int, default=200)
    parser.add_argument("--seeds", type=int, default=6, help="of every wrong model")
    parser.add_argument("--quick", action="store_true", help="20 and 1, no file")
    options = parser.parse_args(arguments)
    if options.quick:
        options.good, options.seeds = 20, 1
    warnings.simplefilter("ignore", UserWarning)  # fits that stop, models that diverge
    warnings.simplefilter("ignore", RuntimeWarning)
    rows = wrong_models(options.seeds)
    failed, counts, bad = good_models(options.good)
    lines = _report(failed, counts, bad, rows)
    print("\n".join(lines[4:8]))
    if not options.quick:
        versions = [f"{m.__name__} {m.__version__}" for m in (alssnn, np, scipy)]
        system = [platform.machine(), f"Python {platform.python_version()}", *versions]
        text = "\n".join([*lines, "", f"{', '.join(system)}, {date.today()}", ""])
        OUT.write_text(text, encoding="utf-8")
    return int(len(failed) > ALLOWED * options.good or any(row[1] for row in rows))


if __name__ == "__main__":
    sys.exit(main())

"""Does `look` recommend the family of models that a search finds best?

    python -m benchmarks.recommendations [--case ...] [--quick]

`look` on the training records of the field benchmark, beside the errors of its default
fits (doc/benchmarks/field.inc: errors of FL-SSNN and AL-SSNN over that of the linear
model).  The best family is the simplest of linear, FL and AL whose error is within 20 %
of the least.  Counted is how often the recommendation is that family; how often it is
right about linear or not; and how often the error of the recommended family is at most
1.5 times the least.  Cases without recorded fits are looked at, too, and marked so.

The threshold between FL and AL was set with the table of all these cases at hand, so
that no case is unseen as to that; the test for linear or not is a test at 5 %, which
nobody set by them.  FL is recommended as FlSsnn(feedback="output"), while the fits of
the table are FlSsnn with its default, h(x).

Without --quick (the first four cases) the table goes to
doc/benchmarks/recommendations.md.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import alssnn
from benchmarks._tables import OUT, machine
from benchmarks.field.__main__ import CASES

FAMILIES = ("LinearStateSpace", "FlSsnn", "AlSsnn")
NEAR, BEARABLE = 1.2, 1.5  # error over the least one: as good, and no great loss


def searched():
    """Return errors over that of the linear model by case, of all families."""
    errors = {}
    for line in (OUT / "field.inc").read_text(encoding="utf-8").splitlines():
        name, *cells = line.strip().split(", ")
        if len(cells) == len(FAMILIES) + 1 and name in CASES:
            fl, al = map(float, cells[1:3])
            errors[name] = dict(zip(FAMILIES, (1.0, fl, al), strict=True))
    return errors


def best(errors):
    """Return the simplest family that is nearly the best."""
    least = min(errors.values())
    return next(name for name in FAMILIES if errors[name] <= NEAR * least)


def recommended(case):
    """Return what `look` recommends for the training records of a case."""
    data = case.load()
    us, ys = zip(*data.train, strict=True)
    us, ys = ([np.reshape(z, (len(z), -1)) for z in zs] for zs in (us, ys))
    return alssnn.look(us, ys, dt=data.dt).recommendation


def table(found, errors):
    """Return the table of recommendations by case, and what they amount to."""
    lines = [
        "| case | split | look recommends | best by search | its error / least |",
        "|---|---|---|---|--:|",
    ]
    same, kind, bearable = [], [], []
    for name, family in found.items():
        cells = [name, CASES[name].split, family or "nothing"]
        if name in errors and family:
            wanted = best(errors[name])
            loss = errors[name][family] / min(errors[name].values())
            same.append(family == wanted)
            kind.append((family == FAMILIES[0]) == (wanted == FAMILIES[0]))
            bearable.append(loss <= BEARABLE)
            cells += [wanted, f"{loss:.2f}"]
        else:
            cells += ["-", "-"]
        lines.append(f"| {' | '.join(cells)} |")
    counts = [
        f"{sum(hits)} of {len(hits)} {what}"
        for hits, what in (
            (same, "are the best family"),
            (kind, "are right about linear or not"),
            (bearable, f"have at most {BEARABLE} times the least error"),
        )
    ]
    return "\n".join(
        [*lines, "", f"Of the cases with recorded fits, {', '.join(counts)}."]
    )


def main(arguments=None):
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--case", nargs="+", choices=sorted(CASES))
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args(arguments)
    load, found = os.getloadavg()[0], {}
    names = [name for name, case in CASES.items() if not case.big]
    names = options.case or (names[:4] if options.quick else names)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for name in names:
            start = time.perf_counter()
            try:
                found[name] = recommended(CASES[name])
            except OSError as error:  # a record that is not on this machine
                print(f"{name}: {error}", flush=True)
                continue
            seconds = time.perf_counter() - start
            print(f"{name}: {found[name]}, {seconds:.1f} s", flush=True)
    text = table(found, searched())
    print(text)
    if not (options.quick or options.case):
        (OUT / "recommendations.md").write_text(
            f"{text}\n\n{machine(load, np, alssnn)}\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Default fits on plants and records that nobody tuned for, seed by seed.

    python -m benchmarks.field [--cases ...] [--split seen] [--models fl al] [--seeds 5]
    python -m benchmarks.field --table FILE.csv [--page]

Fits every model with the defaults of the package, in processes of one thread each, and
appends a row per fit and test to a file; a run goes on where the file ends. --table
prints medians and worst seeds relative to the linear model of the same case, published
errors, and counts what must not happen: crashes, diverging tests, fits worse than the
linear model, seeds that disagree.  --page writes the tables of the manual that have
rows: doc/benchmarks/field.inc of plants, independent.inc of those of somebody else,
and records.inc of measured records.
"""

import argparse
import ast
import os
import sys
from fnmatch import fnmatchcase
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # inherited by the processes
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

from .._tables import OUT
from .case import SPLITS
from .further import FURTHER
from .independent import INDEPENDENT
from .plants import PLANTS
from .records import RECORDS
from .runs import MODELS, read, run
from .table import page, records_page, report

CASES = {**PLANTS, **INDEPENDENT, **FURTHER, **RECORDS}


def chosen(patterns, split):
    """Return the cases of a split that fit a pattern; big ones only by their name."""
    cases = [c for c in CASES.values() if split in ("all", c.split)]
    if not patterns:
        return [case for case in cases if not case.big]
    unknown = [p for p in patterns if not any(fnmatchcase(c.name, p) for c in cases)]
    if unknown:
        raise SystemExit(f"no case {', '.join(unknown)} in split {split}; see --list")
    return [
        case
        for case in cases
        if case.name in patterns
        or (not case.big and any(fnmatchcase(case.name, p) for p in patterns))
    ]


def assignment(text):
    """Return name and value of ``name=value``, a literal of Python or else a string."""
    name, equals, value = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r} is not name=value")
    try:
        return name, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return name, value


def main(arguments=None):
    """Run and print, or print a file."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.field", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--cases", nargs="+", metavar="NAME", help="names or globs")
    parser.add_argument("--split", choices=(*SPLITS, "all"), default="all")
    parser.add_argument("--models", choices=MODELS, nargs="+", default=list(MODELS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=2, help="0: in this process")
    parser.add_argument("--out", type=Path, default=Path("field.csv"))
    parser.add_argument("--fresh", action="store_true", help="start the file anew")
    parser.add_argument(
        "--set",
        type=assignment,
        nargs="+",
        default=[],
        metavar="OPTION=VALUE",
        help="of all models that have it, or MODEL.OPTION=VALUE of one",
    )
    parser.add_argument("--max-time", type=float, help="of a nonlinear fit, seconds")
    parser.add_argument("--table", type=Path, help="print this file and run nothing")
    parser.add_argument("--page", action="store_true", help="write the manual's tables")
    parser.add_argument("--list", action="store_true", help="print the cases")
    options = parser.parse_args(arguments)
    if options.list:
        for case in chosen(options.cases, options.split):
            print(f"{case.name:20s}{case.split:8s}{case.kind}")
        return 0
    if options.table is not None:
        names = {case.name for case in chosen(options.cases, options.split)}
        if not options.cases and options.split == "all":
            names |= set(CASES)
        rows = [row for row in read(options.table) if row["case"] in names]
    else:
        if options.fresh:
            options.out.unlink(missing_ok=True)
        rows = run(
            cases := chosen(options.cases, options.split),
            options.models,
            options.seeds,
            options.out,
            options=dict(options.set),
            max_time=options.max_time,
            jobs=options.jobs,
            show=lambda text: print(text, flush=True),
        )
        rows = [row for row in rows if row["case"] in {case.name for case in cases}]
    print("\n".join(report(rows, CASES)))
    if options.page:
        for name, part, write in (
            ("field.inc", PLANTS, page),
            ("independent.inc", INDEPENDENT | FURTHER, page),
            ("records.inc", RECORDS, records_page),
        ):
            if any(row["case"] in part for row in rows):
                text = "\n".join([*write(rows, part), ""])
                (OUT / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

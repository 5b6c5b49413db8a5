"""Reproduce the paper's two studies, its tables and figures.

    python -m benchmarks.paper [--study wh prey] [--quick] [--seed 0] [--output DIR]

Prints every table, the paper's values beside ours, and writes them with the figures,
for the documentation, into doc/benchmarks (CSV per table, Markdown, reStructuredText,
PNG). `--quick` shortens every fit to seconds, to see that all runs, and writes into
doc/_build/benchmarks. The study "wh" needs the recording in ALSSNN_DATA_HOME, see
`alssnn.datasets`. Everything but the times follows from the seed. Exits with 1 if a
requirement is missed, `--quick` excepted.
"""

import argparse
import os
import sys
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from sklearn.exceptions import ConvergenceWarning

from benchmarks.paper.figures import DPI, draw
from benchmarks.paper.report import environment, write
from benchmarks.paper.studies import STUDIES, run
from benchmarks.paper.tables import checks, tables

DOC = Path(__file__).parents[2] / "doc"
CAPTION = (
    "output, error of the linear model, error of AL-SSNN; below, the last of them in "
    "its own scale."
)
HEADER = f"{'requirement':58s}{'value':>10s}{'limit':>10s}"


def main(arguments=None):
    """Run the studies asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.paper", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--study", nargs="+", choices=STUDIES, default=list(STUDIES))
    parser.add_argument("--quick", action="store_true", help="fits of seconds")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, help="folder to write into")
    options = parser.parse_args(arguments)
    folder = DOC / "_build" / "benchmarks" if options.quick else DOC / "benchmarks"
    missed = False
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for key in options.study:
            study = STUDIES[key](seed=options.seed, quick=options.quick)
            fits, gammas = reproduce(study, options.output or folder)
            if options.quick:
                continue
            results = checks(study, fits, gammas)
            print(HEADER, *results, sep="\n", flush=True)
            missed |= not all(check.holds for check in results)
    return int(missed)


def reproduce(study, folder):
    """Fit, print and write one study; return what `run` returns."""
    load = os.getloadavg()[0]
    print(f"\n{study.title}", flush=True)
    fits, gammas = run(study, _progress)
    made = tables(study, fits, gammas)
    where = environment(load)
    print("", *(table.to_text() + "\n" for table in made), where, "", sep="\n")
    drawn = "Test record" if study.view is None else "End of the test record"
    lines = f"{drawn}: {CAPTION}", where
    write(folder, study.key, study.title, made, lines)
    draw(study, fits).savefig(folder / f"{study.key}.png", dpi=DPI)
    return fits, gammas


def _progress(name, fit):
    """Print one line as soon as a model is fitted."""
    print(f"{name:28s}{fit.rmse_test:12.3e}{fit.seconds:9.1f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())

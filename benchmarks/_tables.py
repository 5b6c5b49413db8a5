"""Tables of runs: where they are kept, and the machine that they come from."""

import csv
import os
import platform
from datetime import date
from pathlib import Path

OUT = Path(__file__).parents[1] / "doc" / "benchmarks"


def machine(load, *modules):
    """Return the line that says where and when: versions, cores, load at the start."""
    versions = [f"{module.__name__} {module.__version__}" for module in modules]
    system = [platform.machine(), f"Python {platform.python_version()}", *versions]
    system += [f"{os.cpu_count()} cores", f"load {load:.2f}", str(date.today())]
    return ", ".join(system)


def replace_runs(path, columns, rows, note, n_first=1):
    """Write runs as CSV in place of those with the same `n_first` cells; return all.

    The last column, which `columns` does not name, is the machine of the run.
    """
    table = [[*map(_cell, row), note] for row in rows]
    if path.exists():
        with path.open(newline="") as file:
            old = list(csv.reader(file))[1:]
        new = [row[:n_first] for row in table]
        table = [row for row in old if row[:n_first] not in new] + table
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([(*columns, "system"), *table])
    return table


def _cell(value):
    return f"{value:.6g}" if isinstance(value, float) else str(value)

"""Tables of text, and where they go: terminal, CSV, Markdown, documentation."""

import csv
import io
import os
import platform
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

import alssnn

PACKAGES = ("numpy", "scipy", "scikit-learn", "numba")


@dataclass(frozen=True)
class Table:
    """Hold a table of text cells, and what has to be said below it."""

    name: str
    title: str
    header: tuple[str, ...]
    rows: list[tuple[str, ...]]
    notes: tuple[str, ...] = ()

    def __post_init__(self):
        """Check that every row has one cell per column."""
        for row in self.rows:
            if len(row) != len(self.header):
                raise ValueError(
                    f"Every row of `{self.name}` must have {len(self.header)} cells, "
                    f"got {row!r}. Give one cell per column."
                )

    def to_text(self):
        """Return the table for a terminal, columns aligned."""
        lines = [self.header, *self.rows]
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        body = "\n".join(
            "  ".join(
                cell.ljust(width) if i == 0 else cell.rjust(width)
                for i, (cell, width) in enumerate(zip(line, widths, strict=True))
            ).rstrip()
            for line in lines
        )
        return "\n".join([self.title, body, *self.notes])

    def to_csv(self):
        """Return the table as comma-separated values, titles first."""
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows([self.header, *self.rows])
        return stream.getvalue()

    def to_markdown(self):
        """Return the table in Markdown, with its notes."""
        rule = ("---", *["---:"] * (len(self.header) - 1))
        lines = [
            "| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |"
            for line in (self.header, rule, *self.rows)
        ]
        notes = [part for note in self.notes for part in ("", note)]
        return "\n".join([f"## {self.title}", "", *lines, *notes])

    def to_rst(self):
        """Return the table as a directive of reStructuredText, with its notes."""
        indented = ["   " + line for line in self.to_csv().splitlines()]
        head = f".. csv-table:: {self.title}\n   :header-rows: 1\n"
        notes = [part for note in self.notes for part in ("", note)]
        return "\n".join([head, *indented, *notes])


def number(value):
    """Return three significant digits, nothing for None."""
    if value is None:
        return ""
    return "diverges" if np.isinf(value) else f"{value:.3g}"


def percent(value):
    """Return three significant digits of a share, in percent; nothing for None."""
    return number(None if value is None else 100 * value) + (
        "" if value is None or np.isinf(value) else " %"
    )


def environment(load):
    """Return one line on machine, versions, load before and now, and date."""
    versions = [f"alssnn {alssnn.__version__}", f"Python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            versions.append(f"no {package}")
    threads = os.environ.get("OPENBLAS_NUM_THREADS", "not set")
    return (
        f"{datetime.now(UTC):%Y-%m-%d}; {_processor()}, {os.cpu_count()} cores, "
        f"threads of BLAS: {threads}; {', '.join(versions)}; load of the machine "
        f"{load:.1f} at the start, {os.getloadavg()[0]:.1f} at the end; with others on "
        "it, times are upper bounds."
    )


def _processor():
    """Return the name of the processor, as far as the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if "model name" in line]
    return names[0] if names else platform.machine()


def write(folder, key, title, tables, lines):
    """Write a study: a CSV file per table, a Markdown page, a part of the manual.

    Parameters
    ----------
    folder : pathlib.Path
        Where to write.
    key, title : str
        Prefix of the names of the files, title of the Markdown page.
    tables : sequence of Table
        The tables.
    lines : sequence of str
        Paragraphs that follow them: caption of the figure, environment.

    Notes
    -----
    The figure, `key`.png, is expected beside the files; the part of the manual names
    it from the root of the documentation.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for table in tables:
        path = folder / f"{key}_{table.name}.csv"
        path.write_text(table.to_csv(), encoding="utf-8")
    caption, *rest = lines
    page = [
        f"# {title}",
        *(table.to_markdown() for table in tables),
        f"![{caption}]({key}.png)",
        *rest,
    ]
    (folder / f"{key}.md").write_text("\n\n".join(page) + "\n", encoding="utf-8")
    figure = f".. figure:: /benchmarks/{key}.png\n   :alt: {title}\n\n   {caption}"
    part = [*(table.to_rst() for table in tables), figure, *rest]
    (folder / f"{key}.inc").write_text("\n\n".join(part) + "\n", encoding="utf-8")

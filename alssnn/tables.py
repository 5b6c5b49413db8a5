"""Records from CSV files: named columns, and errors that say where to look."""

import contextlib
import csv
import difflib
import re
import textwrap

import numpy as np

DELIMITERS = ",;\t"
GAPS = ("", "nan")  # cells of outputs that were not measured
INPUT_REMEDY = (
    "An input must be known at every sample: fill the gap, or cut the record there."
)
OUTPUT_REMEDY = "Leave the cell empty where the output was not measured."
COMMA_REMEDY = "Write decimal points, not commas."
DATE_REMEDY = (
    "Dates and clocks are no numbers: write a column of seconds, or read the file with "
    "pandas, whose dates Record.from_dataframe and on_grid of alssnn.datasets take."
)
COLUMNS_SHOWN = 300  # characters of a header in a message
# what a CSV file calls a number: Python knows more, such as 1_0
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
DATE = re.compile(r"\d{1,4}([-/.])\d{1,2}\1\d{1,4}(?!\d).*|\d{1,2}:\d\d.*", re.ASCII)
SECONDS = {
    **dict.fromkeys(("", "s", "sec", "second", "seconds"), 1.0),
    "ns": 1e-9,
    **dict.fromkeys(("us", "\u03bcs"), 1e-6),
    "ms": 1e-3,
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hour", "hours"), 3600.0),
}  # by what stands behind a name
UNITS = "|".join(filter(None, SECONDS))
UNIT = re.compile(rf".*[\s_\[(/]\s*({UNITS})\s*[\])]?\s*")
TIME = re.compile(r"(?:time|t)(?:\s*[\[(_ ]\s*s(?:ec|econds?)?\s*[\])]?)?", re.I)
# no t_min and no t_h, which may be temperatures
OTHER_TIME = re.compile(
    rf"(?:time\s*[\s_\[(/]|t\s*[\[(/])\s*(?:{UNITS})\s*[\])]?|t[\s_][num\u03bc]s"
)


def read_csv(path, inputs, outputs, experiment=None):
    """Read the columns of a record from a CSV file with a header.

    Parameters
    ----------
    path : str, path-like or text file
        File, or what was read from it, such as io.StringIO; columns are separated by
        comma, semicolon or tab, whichever the header has most of.
    inputs : sequence of str
        Names of the columns of the inputs.
    outputs : sequence of str
        Names of the columns of the outputs.
    experiment : str or None, default=None
        Name of the column of labels.

    Returns
    -------
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N, ny)
        Outputs; nan where a cell is empty or nan: not measured.
    experiment : ndarray of str of shape (N,) or None
        Labels.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If a column is missing, ambiguous or asked for twice, a value is not a finite
        number, an input has a gap, or there are no samples.
    """
    names = [*inputs, *outputs]
    wanted = names if experiment is None else [*names, experiment]
    with _opened(path) as file:
        columns, delimiter = _read_header(path, file)
        places = _find_columns(path, columns, wanted)
        reader = csv.reader(file, delimiter=delimiter)
        values, labels = [], []
        empty = 0  # line without values: at the end of many files, or a gap before data
        for fields in reader:
            if not any(field.strip() for field in fields):
                empty = empty or (reader.line_num + 1 if len(fields) > 1 else 0)
                continue
            if empty:
                _numbers(path, names, [""] * len(names), empty, len(inputs))
            line = reader.line_num + 1  # the header was read before
            if any(field.strip() for field in fields[len(columns) :]):
                raise ValueError(
                    f"`{path}` must have as many cells in a line as its header, "
                    f"{len(columns)}, got {len(fields)} at line {line}. Write decimal "
                    "points, not commas, or separate columns by semicolons."
                )
            cells = [fields[i].strip() if i < len(fields) else "" for i in places]
            values.append(_numbers(path, names, cells, line, len(inputs)))
            labels.append(cells[-1])
    if not values:
        raise ValueError(
            f"`{path}` must hold samples below its header, got none. "
            "Write one line per sample."
        )
    data = np.array(values)
    u, y = data[:, : len(inputs)], data[:, len(inputs) :]
    return u, y, None if experiment is None else np.array(labels)


def _opened(path):
    """Return the open file, a text file from its beginning."""
    if hasattr(path, "read"):
        path.seek(0)
        return contextlib.nullcontext(path)
    return open(path, encoding="utf-8-sig", errors="replace", newline="")


def _read_header(path, file):
    """Return the names of the columns and what separates them."""
    header = file.readline()
    if "\0" in header:  # every other byte of a letter in UTF-16
        raise ValueError(
            f"`{path}` must be text in UTF-8, got bytes of zero, as UTF-16 has them. "
            "Save it as UTF-8, in a spreadsheet as CSV UTF-8."
        )
    delimiter = max(DELIMITERS, key=header.count)
    names = next(csv.reader([header], delimiter=delimiter), [])
    return [name.strip() for name in names], delimiter


def _find_columns(path, columns, wanted):
    """Return the places of the wanted columns."""
    found_columns = textwrap.shorten(", ".join(columns), COLUMNS_SHOWN)
    for name in wanted:
        if columns.count(name) != 1:
            found = "none" if name not in columns else "several"
            raise ValueError(
                f"`{path}` must have one column {name!r}, got {found}. Its first "
                f"line names the columns: {found_columns}.{_meant(name, columns)}"
            )
        if wanted.count(name) != 1:
            raise ValueError(
                f"`--input`, `--output` and `--experiment` must name different "
                f"columns, got {name!r} twice. Its role can only be one."
            )
    return [columns.index(name) for name in wanted]


def _meant(name, columns):
    """Return a hint at the one column that a wrong name may stand for."""
    near = [c for c in columns if c.lower().split("[")[0].split("(")[0].strip() == name]
    near = near or difflib.get_close_matches(name, columns, n=1)
    if len(near) != 1 or name in columns:
        return ""
    return f" Did you mean {near[0]!r}? In a shell, quote names with blanks."


def unit_of(name):
    """Return the unit of time that the name of a column ends in.

    Parameters
    ----------
    name : str
        Name, such as time_ms, t [ms], t/ms or time (min).

    Returns
    -------
    unit : str
        One of `SECONDS`, which tells how long it is; empty if the name says none.
    """
    found = UNIT.fullmatch(name.casefold())
    return found.group(1) if found else ""


def _find_time(columns):
    """Return the names of columns of time, those in seconds if there are any."""
    times = [c for c in columns if TIME.fullmatch(c)]
    return times or [c for c in columns if OTHER_TIME.fullmatch(c.casefold())]


def read_steps(path):
    """Return the steps of a column of time, in seconds.

    Parameters
    ----------
    path : str, path-like or text file
        File that `read_csv` reads.

    Returns
    -------
    name : str
        Name of the column: time or t, in seconds or in the unit that its name says;
        empty if there is none, or more than one.
    steps : ndarray of shape (N - 1,)
        Differences of its values, in seconds; none where one is not a number.
    """
    with _opened(path) as file:
        columns, _ = _read_header(path, file)
    times = _find_time(columns)
    if len(times) != 1:
        return "", np.zeros(0)
    try:
        t, _, _ = read_csv(path, times, [])
    except ValueError:  # such as dates
        return times[0], np.zeros(0)
    return times[0], SECONDS[unit_of(times[0])] * np.diff(t[:, 0])


def _numbers(path, names, cells, line, n_inputs):
    """Return the values of one line; nan where an output was not measured."""
    values = []
    # the label may follow
    for i, (name, cell) in enumerate(zip(names, cells, strict=False)):
        is_output = i >= n_inputs
        if cell.lower() in GAPS and is_output:
            values.append(np.nan)
            continue
        value = float(cell) if NUMBER.fullmatch(cell) else np.nan
        if not np.isfinite(value):
            raise ValueError(
                f"`{path}` must hold finite numbers with a decimal point, got "
                f"{cell!r} in column {name!r} at line {line}. "
                + _remedy(cell, is_output)
            )
        values.append(value)
    return values


def _remedy(cell, is_output):
    """Return what to do about a cell that is no number."""
    if NUMBER.fullmatch(cell.replace(",", ".")):
        return COMMA_REMEDY
    if DATE.fullmatch(cell):
        return DATE_REMEDY
    return OUTPUT_REMEDY if is_output else INPUT_REMEDY

"""Files of measured records, read from a folder of the user's: the data home.

The records are not part of the package, as most of them state no licence for
redistribution. A further record is one more ``fetch_*`` function: it finds its file by
`_find_file`, reads it by `_read_columns`, and returns `Record` objects.
"""

import os
from contextlib import contextmanager
from pathlib import Path

import numpy as np

WEBSITE = "https://www.nonlinearbenchmark.org"


def _data_home(data_home):
    """Return the folder of the measured records."""
    if data_home is None:
        # An empty variable counts as unset: it would mean the current directory.
        data_home = os.environ.get("ALSSNN_DATA_HOME") or "~/alssnn_data"
    return Path(data_home).expanduser()


def _find_file(data_home, folder, filename, *, source=WEBSITE, hint=""):
    """Return the path of a file in `folder` of the data home, or directly in it."""
    home = _data_home(data_home)
    candidates = [home / folder / filename, home / filename]
    for path in candidates:
        if path.is_file():
            return path
    raise FileNotFoundError(
        f"The record {filename} was not found, looked for {candidates[0]} and "
        f"{candidates[1]}. Get it from {source} and put it there, or name its folder "
        "by `data_home` or by the environment variable ALSSNN_DATA_HOME. "
        f"{hint}".rstrip()
    )


def _read_columns(path, names, *, length=None, source=WEBSITE):
    """Read the leading columns of a CSV file after checking names and length."""
    with open(path, encoding="utf-8", errors="replace") as file:
        header = file.readline().strip()
    found = [field.strip().strip('"') for field in header.split(",")]
    if found[: len(names)] != names:
        raise ValueError(
            f"`{path}` must start with the columns {', '.join(names)}, got "
            f"{header[:60]!r}. Get the file again from {source}."
        )
    with _must(path, "hold numbers below its header", source):
        columns = np.loadtxt(
            path,
            delimiter=",",
            skiprows=1,
            usecols=range(len(names)),
            ndmin=2,
            encoding="utf-8",
        )  # (N, n_columns)
    _check_length(path, len(columns), length, source)
    return np.ascontiguousarray(columns.T)


@contextmanager
def _must(path, duty, source=WEBSITE):
    """Refuse a file that cannot be read, by saying what it must do."""
    try:
        yield
    except Exception as error:  # readers fail in many ways on a foreign file
        raise ValueError(
            f"`{path}` must {duty}, got: {error}. Get the file again from {source}."
        ) from error


def _check_length(path, found, length, source=WEBSITE):
    """Check that a file is complete; None for any length."""
    if length is not None and found != length:
        raise ValueError(
            f"`{path}` must hold {length} samples, got {found}. Get the complete file "
            f"again from {source}."
        )

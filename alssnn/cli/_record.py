"""Models and records that the commands read."""

import csv
import io
import sys
from pathlib import Path

import numpy as np

from ._arguments import fraction


def add_model(parser):
    """Add the model, which comes first.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    """
    parser.add_argument("model", type=Path, metavar="MODEL.npz", help="saved model")


def add_data(parser, *, required=True):
    """Add the options that name a record.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    required : bool, default=True
        Whether the command needs a record.
    """
    data = parser.add_argument_group("data")
    data.add_argument(
        "--data",
        type=Path,
        required=required,
        metavar="FILE.csv",
        help="record to read" if required else "record to validate the model on first",
    )
    for flag, what in (("--input", "inputs"), ("--output", "outputs")):
        data.add_argument(
            flag,
            nargs="+",
            metavar="COL",
            help=f"columns of the {what} (default: those the model was fitted to)",
        )
    data.add_argument(
        "--experiment",
        metavar="COL",
        help="column of labels, one per uninterrupted experiment",
    )
    data.add_argument(
        "--last",
        type=fraction,
        default=1.0,
        metavar="SHARE",
        help="use the last part of every experiment alone, such as what `fit` kept for "
        "testing (default: all)",
    )


def refuse_columns(args):
    """Refuse the options that say how a record is read, where there is none.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of a command without ``--data``.
    """
    flags = [
        f"--{name}" for name in ("input", "output", "experiment") if vars(args)[name]
    ]
    flags += ["--last"] * (args.last != 1)
    if flags:
        args.parser.error(
            f"{', '.join(flags)} must come with --data: there is no record to read"
        )


def read_record(args, model):
    """Return the record, and what lies before it or None, as (u, y, experiment).

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    model : estimator
        Fitted model.

    Returns
    -------
    record, before : tuple or None
        Both as (u, y, experiment); nothing lies before the whole.
    """
    from ..ladder import hold_out_last
    from ..tables import read_csv

    ny, nu = len(model.C_), model.n_features_in_
    fitted = getattr(model, "feature_names_in_", None)
    inputs = _columns(args, "--input", args.input, fitted, nu)
    outputs = _columns(args, "--output", args.output, model.output_names_, ny)
    u, y, experiment = read_csv(args.data, inputs, outputs, args.experiment)
    report_gaps(y, outputs)
    if args.last == 1:
        return (u, y, experiment), None
    before, last = hold_out_last(u, y, experiment, args.last, name="--last")
    return last, before


def report_gaps(y, names):
    """Say on the standard error how many samples of an output were not measured.

    Parameters
    ----------
    y : ndarray of shape (N, ny)
        Outputs, nan where they were not measured.
    names : sequence of str
        Their names.
    """
    for name, missing in zip(names, np.isnan(y).sum(axis=0), strict=True):
        if missing:
            print(
                f"{name}: not measured at {missing} of {len(y)} samples.",
                file=sys.stderr,
            )


def _columns(args, flag, given, fitted, size):
    """Return the names of the columns, given or those of the fit."""
    names = fitted if given is None else given
    if names is None:
        args.parser.error(f"{flag} is needed: the model has no names of columns")
    if len(names) != size:
        args.parser.error(
            f"{flag} must name {size} columns as the model has, got {len(names)}"
        )
    return [str(name) for name in names]


def gain_columns(model):
    """Return the names of the columns of a gain, one row per input.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    states, integrators : list of str
        Names x0, x1, ... of the states, behind them the past of late inputs, and z0,
        z1, ... of the integrators, one per output.
    """
    nx = model.nx_ + int(model.input_delay_.sum())
    return [f"x{i}" for i in range(nx)], [f"z{i}" for i in range(len(model.C_))]


def write_csv(path, header, rows):
    """Write a table, its folder made if missing.

    Parameters
    ----------
    path : Path
        File to write.
    header : sequence of str
        Names of the columns.
    rows : iterable
        Rows of cells.
    """
    from ..whole_files import replace_file

    path.parent.mkdir(parents=True, exist_ok=True)
    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(header)
    writer.writerows(rows)
    replace_file(path, text.getvalue())

"""Models and records that the commands read."""

import csv
import io
import sys
import warnings
from pathlib import Path

import numpy as np

from ._arguments import fraction, positive

TIME_TOL = 0.05  # of a step: above the rounding of printed times


def add_model(parser):
    """Add the model, which comes first.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    """
    parser.add_argument("model", type=Path, metavar="MODEL.npz", help="saved model")


def add_file(parser):
    """Add the record, which comes first.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command, or a group of it.
    """
    parser.add_argument(
        "file",
        type=Path,
        metavar="FILE.csv",
        help="record to read; - is the standard input",
    )


def add_columns(parser, help="columns of the {}", **options):
    """Add the options that name the columns of inputs, outputs and labels.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command, or a group of it.
    help : str, default="columns of the {}"
        What they are, with {} for inputs or outputs.
    **options : dict
        As for ``parser.add_argument``, of inputs and outputs.
    """
    for what in ("inputs", "outputs"):
        parser.add_argument(
            f"--{what[:-1]}",
            nargs="+",
            metavar="COL",
            help=help.format(what),
            **options,
        )
    parser.add_argument(
        "--experiment",
        metavar="COL",
        help="column of labels, one per uninterrupted experiment",
    )


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
        help=("record to read" if required else "record to validate the model on first")
        + "; - is the standard input",
    )
    add_columns(data, "columns of the {} (default: those the model was fitted to)")
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
    outputs = _columns(args, "output", model.output_names_, len(model.C_))
    record, before = _read(args, model, outputs)
    report_gaps(record[1], outputs)
    return record, before


def read_inputs(args, model):
    """Return the inputs of a record and its labels.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    model : estimator
        Fitted model.

    Returns
    -------
    u : ndarray of shape (N, nu)
        Inputs.
    experiment : ndarray of shape (N,) or None
        Labels.
    """
    (u, _, experiment), _ = _read(args, model, [])
    return u, experiment


def _read(args, model, outputs):
    """Return the record with these outputs, and what lies before it."""
    from ..ladder import hold_out_last
    from ..tables import read_csv

    fitted = getattr(model, "feature_names_in_", None)
    inputs = _columns(args, "input", fitted, model.n_features_in_)
    if str(args.data) == "-":  # once, for all models that read it
        args.data = source_of(args.data)
    u, y, experiment = read_csv(args.data, inputs, outputs, args.experiment)
    compare_times(args, args.data, model.plant_.dt, "resample the record")
    if args.last == 1:
        return (u, y, experiment), None
    before, last = hold_out_last(u, y, experiment, args.last, name="--last")
    return last, before


class StandardInput(io.StringIO):
    """What came through a pipe, kept because it may be read twice."""

    def __str__(self):
        """Return what messages call it."""
        return "the standard input"


def source_of(path):
    """Return what `read_csv` reads: a file, or for - the standard input.

    Parameters
    ----------
    path : Path
        Argument of the command.

    Returns
    -------
    source : Path or StandardInput
        The source.
    """
    if str(path) != "-":
        return path
    data = sys.stdin.buffer.read()
    return StandardInput(data.decode("utf-8-sig", errors="replace"), newline="")


def common_step(steps):
    """Return the step that all steps of a column of time are like.

    Parameters
    ----------
    steps : ndarray of shape (n,)
        Differences.

    Returns
    -------
    step : float
        Their median; 0 if there are none, or they are not all alike.
    """
    middle = float(np.median(steps)) if len(steps) else 0.0
    if middle <= 0 or np.abs(steps - middle).max() > TIME_TOL * middle:
        return 0.0
    return middle


def compare_times(args, source, dt, remedy=None):
    """Warn where a column of time contradicts the sampling time.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments with `experiment`.
    source : Path or StandardInput
        Record.
    dt : float
        Sampling time, in seconds.
    remedy : str or None, default=None
        What to do if the column is right; None means another ``--dt``.
    """
    if args.experiment is not None:
        return  # its time may start anew
    from ..tables import read_steps, unit_of

    name, steps = read_steps(source)
    if not len(steps):
        return
    step = common_step(steps)
    s, doubt = (" s", "") if unit_of(name) else ("", "If the column is in seconds, ")
    if not step:
        warnings.warn(
            f"The steps of the column {name!r} are between {steps.min():g} and "
            f"{steps.max():g}{s}. Models need a fixed rate: resample the record.",
            stacklevel=2,
        )
    elif abs(step - dt) > TIME_TOL * dt:
        advice = doubt + (remedy or f"use --dt {step:g}")
        warnings.warn(
            f"The steps of the column {name!r} are {step:g}{s}, but the sampling time "
            f"is {dt:g} s. {advice[0].upper()}{advice[1:]}.",
            stacklevel=2,
        )


def sampling_time(args, source):
    """Return the sampling time, given or that of the column of time, and say which.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments with `dt`, `time_column`, `experiment` and `quiet`.
    source : Path or StandardInput
        Record.

    Returns
    -------
    dt : float
        Sampling time, in seconds; 1 if neither was given.

    Raises
    ------
    ValueError
        If the steps of the column are not all alike.
    """
    from ..tables import SECONDS, unit_of

    if args.time_column is None:
        return 1.0 if args.dt is None else args.dt
    if args.dt is not None:
        args.parser.error("--dt and --time-column exclude each other")
    dt, unit = column_step(args, source), unit_of(args.time_column)
    if SECONDS[unit] != 1 or not args.quiet:
        print(
            f"Sampling time: {dt:g} s, by the column {args.time_column!r}, which is "
            f"taken to be in {unit if SECONDS[unit] != 1 else 'seconds'}.",
            file=sys.stderr,
        )
    return dt


def column_step(args, source):
    """Return the step of the column of time.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments with `time_column` and `experiment`.
    source : Path or StandardInput
        Record.

    Returns
    -------
    dt : float
        Step in seconds, of a column in the unit that its name says.

    Raises
    ------
    ValueError
        If the steps are not all alike.
    """
    from ..tables import SECONDS, read_csv, unit_of

    t, _, labels = read_csv(source, [args.time_column], [], args.experiment)
    steps = np.diff(t[:, 0])
    if labels is not None:
        steps = steps[labels[1:] == labels[:-1]]
    if not common_step(steps):
        found = f"{steps.min():g} to {steps.max():g}" if len(steps) else "none"
        raise ValueError(
            f"`--time-column` must have equal steps above zero, got {found} in "
            f"{args.time_column!r}. Models need a fixed rate: resample the record."
        )
    # the mean of many steps has less of the rounding of printed times
    return float(f"{SECONDS[unit_of(args.time_column)] * steps.mean():.6g}")


def add_sampling(parser):
    """Add the options that say how fast the record was sampled.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser, or a group of it.
    """
    parser.add_argument(
        "--dt",
        type=positive,
        metavar="S",
        help="sampling time in seconds (default: 1)",
    )
    parser.add_argument(
        "--time-column",
        metavar="COL",
        help="column of time, whose steps are the sampling time; in seconds, or in the "
        "unit that its name ends in, such as time_ms, t [ms] or time (min)",
    )


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


def _columns(args, option, fitted, size):
    """Return the names of the columns, given or those of the fit."""
    given = getattr(args, option)
    names = fitted if given is None else given
    if names is None:
        args.parser.error(f"--{option} is needed: the model has no names of columns")
    if len(names) != size:
        args.parser.error(
            f"--{option} must name {size} columns as the model has, got {len(names)}"
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
    from ..whole_files import write_file

    text = io.StringIO(newline="")
    writer = csv.writer(text)
    writer.writerow(header)
    writer.writerows(rows)
    write_file(path, text.getvalue())

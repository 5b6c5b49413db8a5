"""`alssnn fit`: models of your own record."""

import sys
import textwrap
from pathlib import Path

import numpy as np

from ._arguments import (
    add_figure,
    add_overwrite,
    add_seed,
    refuse_existing,
)
from ._comparison import TEXT_WIDTH, prepare_figure, report, row_numbers, run_ladder
from ._fit_options import (
    FOUR,
    add_data,
    add_effort,
    add_form,
    add_models,
    add_time,
    add_weights,
)
from ._record import (
    TIME_TOL,
    column_step,
    compare_times,
    report_gaps,
    sampling_time,
    source_of,
)

AS_GIVEN = (  # options of the ladder
    "nx n_h n_g n_f gamma gamma_h alpha feedback input_map drift horizon max_iter "
    "n_init"
).split()
HELP = "compare models of your own record in a CSV file"
DESCRIPTION = "Compare models of your own record of a plant."
EPILOG = """\
The file has one header line with the names of the columns and one line per sample, in
time order, sampled at a fixed rate; columns are separated by comma, semicolon or tab.
A cell of an output is empty or nan where it was not measured; inputs have no gaps.
The last part of the record (or of every experiment) tests, the rest trains.

examples:
  alssnn fit plant.csv --input u --output y
      four models; the number of states is chosen from the data
  alssnn fit plant.csv --input u1 u2 --output y --nx 6 --dt 0.01 --figure plant.png
      two inputs, six states, sampled every 10 ms, and a figure
  alssnn fit plant.csv --input u --output y --experiment run --models lti al
      several experiments, told apart by the labels in the column `run`
  alssnn fit plant.csv --input valve --disturbance inflow --output level
      the inflow is measured, and the law feeds it forward
  alssnn fit monday.csv --input u --output y --time-column t --test tuesday.csv
      sampling time from a column, and another record to test on
  alssnn fit plant.csv --input u --output y --gamma 1
      more weight on linearity than on accuracy
  alssnn fit plant.csv --input u --output y --model al --save plant.npz
      one model, kept for validate, report, control and export

Reading the table: GR-SSNN much better than LTI means that the plant is nonlinear. The
closer AL-SSNN comes to GR-SSNN with a small nonlinear rest, the better a linear
controller on top of u = v - h(x) will work. An equals sign behind a name means that
its networks did not help: the model is the linear one.

A single model is fitted beside the linear one. If it is worse on the hidden part, the
exit code is 1 and nothing is saved (but by --force). An interrupt by Ctrl-C saves the
best model that was found up to then.
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    # FILE.csv first: behind --output it would be taken for a column
    parser.usage = (
        "alssnn fit FILE.csv --input COL [COL ...] --output COL [COL ...] [options]"
    )
    add_data(parser.add_argument_group("data"))
    models = parser.add_argument_group("models")
    for add_some in (add_models, add_weights, add_form, add_time, add_effort):
        add_some(models)
    parser.add_argument(
        "--save",
        type=Path,
        metavar="MODEL.npz",
        help="save the fitted model, with the names of its columns; needs one model",
    )
    add_figure(parser)
    parser.add_argument(
        "--force",
        action="store_true",
        help="save a model that is worse than the linear one or than the mean, too",
    )
    add_overwrite(parser)
    add_seed(parser)


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.

    Returns
    -------
    code : int
        0, or 1 if the one model that was asked for is worse than a linear one, or than
        the mean of the output, on the hidden part.
    """
    # the rest takes seconds to import, which --help should not
    from ..ladder import PRESETS

    _check_options(args)
    models = args.models or [args.model]
    if models == ["ladder"]:
        models = list(FOUR)
    if args.save is not None:
        if len(models) != 1:
            args.parser.error("--save needs one model, such as --model al")
        if any(_is_same(args.save, path) for path in (args.file, args.test)):
            args.parser.error("--save must not be the record itself")
        # before the fit: a folder that cannot be made should not cost minutes
        refuse_existing(args, args.save)
    chosen = models[0] if len(models) == 1 else None
    if chosen not in (None, "lti"):
        models = ["lti", chosen]  # to compare with
    prepare_figure(args.figure)
    source = source_of(args.file)
    dt = sampling_time(args, source)
    if args.time_column is None:
        compare_times(args, source, dt)
    name = PRESETS[chosen][0] if chosen else None
    u, y, experiment = _read_moving(args, source)
    rows: list = []
    try:
        ladder = run_ladder(
            args,
            u,
            y,
            experiment=experiment,
            test=None if args.test is None else _read_test(args, dt),
            # an integer where 1.0 would be taken for the default
            dt=1 if args.continuous and dt == 1.0 else dt,
            models=models,
            callback=rows.append,
            **_options(args),
        )
    except KeyboardInterrupt:
        _save_interrupted(args, rows, name)
        raise
    faults = {row.name: reason for row in ladder if (reason := ladder.fault(row))}
    refused = name in faults
    saves = args.save is not None and not (refused and not args.force)
    if saves:
        _save(args, ladder[name].model)  # before a figure that may fail
    report(ladder, args.figure, label=args.output[0])
    for reason in faults.values():
        print("\n" + textwrap.fill(f"Caution: {reason}", TEXT_WIDTH))
    if saves:
        print(f"\nModel: {args.save}. {_unseen(args)}")
    elif args.save is not None:
        print(f"\n{args.save} was not written. To save the model anyway, use --force.")
    args.result = {
        "models": [row_numbers(row) for row in ladder],
        "cautions": faults,
        "saved": args.save if saves else None,
        "figure": args.figure,
    }
    return int(refused and not args.force)


def _is_same(path, record):
    """Return whether a path to write is that of a record."""
    if record is None or not (path.exists() and record.exists()):
        return False
    return path.samefile(record)


def _check_options(args):
    """Refuse options that need others."""
    for option, default in (("drift", None), ("horizon", 1)):
        if getattr(args, option) != default and not args.innovations:
            args.parser.error(f"--{option} needs --innovations")
    if args.hold is not None and not args.continuous:
        args.parser.error("--hold needs --continuous")
    if args.continuous and args.dt is None and args.time_column is None:
        args.parser.error("--continuous needs --dt, the sampling time in seconds")
    if args.test is not None and args.test_size is not None:
        args.parser.error("--test and --test-size exclude each other")
    if str(args.file) == str(args.test) == "-":
        args.parser.error("the standard input can be one record, not both")
    if args.input_delay and "auto" in args.input_delay and len(args.input_delay) > 1:
        args.parser.error("--input-delay takes auto alone, for all inputs")


def _read(args, source):
    """Return a record as (u, y, experiment)."""
    from ..tables import read_csv

    u, y, experiment = read_csv(source, _inputs(args), args.output, args.experiment)
    report_gaps(y, args.output)
    return u, y, experiment


def _read_moving(args, source):
    """Return the record to train on; refuse by name what does not move there."""
    from ..ladder import hold_out_last

    u, y, experiment = _read(args, source)
    trains = u
    if args.test is None:
        size = 0.5 if args.test_size is None else args.test_size
        (trains, _, _), _ = hold_out_last(u, y, experiment, size)
    still = [
        repr(name)
        for name, column in zip(_inputs(args), trains.T, strict=True)
        if not np.ptp(column)
    ]
    if still:
        raise ValueError(
            f"`{args.file}` must have inputs that move where models are trained, got "
            f"{', '.join(still)} at one value. Leave such columns out, or train on "
            "another part of the record."
        )
    return u, y, experiment


def _read_test(args, dt):
    """Return the record to test on, which was sampled as the other one."""
    source = source_of(args.test)
    if args.time_column is None:
        compare_times(args, source, dt)
    elif abs((own := column_step(args, source)) - dt) > TIME_TOL * dt:
        raise ValueError(
            f"`--test` must have the sampling time of the other record, {dt:g} s, got "
            f"{own:g} s in {args.time_column!r}. Resample it."
        )
    return _read(args, source)


def _inputs(args):
    """Return the columns of all inputs."""
    return [*args.input, *args.disturbance]


def _options(args):
    """Return what the ladder hands to the models."""
    options = {name: getattr(args, name) for name in AS_GIVEN}
    options |= {
        "test_size": 0.5 if args.test_size is None else args.test_size,
        "stability": None if args.stability == "none" else args.stability,
        "disturbances": list(range(len(args.input), len(_inputs(args)))) or None,
        "noise": "innovations" if args.innovations else "output",
        "time": "continuous" if args.continuous else "discrete",
        "hold": args.hold or "zoh",
    }
    late = args.input_delay
    choices = {
        "odd": args.odd or None,
        "linear_part": args.linear_part,
        "operating_point": args.operating_point,
        "initial_state": args.initial_state,
        "input_delay": late[0] if late and len(late) == 1 else late,
        "max_time": args.max_time,
    }
    return options | {name: z for name, z in choices.items() if z is not None}


def _save(args, model):
    """Save a model with the names of its columns."""
    model.feature_names_in_ = np.array(_inputs(args), dtype=object)
    model.output_names_ = list(args.output)
    model.save(args.save)


def _save_interrupted(args, rows, name):
    """Save the best model so far, if the one that was asked for is under way."""
    from ..ladder import fault
    from ..shown import percent

    known = {row.name: row for row in rows}
    if args.save is None or name not in known:
        return
    row = known[name]
    reason = fault(row, known.get("LTI"))
    if reason and not args.force:
        print(f"{args.save} was not written. {reason}", file=sys.stderr)
        return
    _save(args, row.model)
    print(
        f"Model: {args.save}, the best one up to the interrupt, which misses "
        f"{percent(100 - row.fit_percent.mean(), 3)} of the test output. "
        f"{_unseen(args)}",
        file=sys.stderr,
    )


def _unseen(args):
    """Say which record did not train the model."""
    label = "" if args.experiment is None else f" --experiment {args.experiment}"
    if args.test is not None:
        by = f", by{label}" if label else ""
        return f"It was not trained on {args.test}: validate it there{by}."
    share = 0.5 if args.test_size is None else args.test_size
    of_each = " of every experiment" if label else ""
    return (
        f"It was not trained on the last {100 * share:g} %{of_each}: validate it "
        f"there, by --last {share:g}{label}."
    )

"""`alssnn look`: a record in words, before anything is fitted."""

from pathlib import Path

from ._arguments import add_command, count, positive

EPILOG = """\
An exclamation mark stands where something is to be done, or to be known. With --period
the record is periodic, and its noise and its nonlinear part are told apart.

examples:
  alssnn look plant.csv --input u --output y --dt 0.05
  alssnn look plant.csv --input u --output y --dt 0.05 --experiment experiment \\
      --period 1024
"""


def add(commands):
    """Add the command.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        Where the command is added.
    """
    parser = add_command(
        commands,
        "look",
        run,
        "Say what is in a record: gaps, spikes, delays, nonlinearity, accuracy.",
        EPILOG,
        help="say what is in a record before a fit",
    )
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="record to read")
    for flag in ("--input", "--output"):
        parser.add_argument(
            flag,
            nargs="+",
            required=True,
            metavar="COL",
            help=f"columns of {flag[2:]}s",
        )
    parser.add_argument("--experiment", metavar="COL", help="column of labels")
    parser.add_argument(
        "--dt", type=positive, default=1.0, help="sampling time in s (default: 1)"
    )
    parser.add_argument(
        "--period", type=count, metavar="N", help="samples of a period, if periodic"
    )


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from ..first_look import look
    from ..tables import read_csv

    u, y, experiment = read_csv(args.file, args.input, args.output, args.experiment)
    print(look(u, y, experiment, dt=args.dt, period=args.period))

"""`alssnn report`: all that is known of a model, on one page."""

from pathlib import Path

from ._arguments import add_command, add_law, add_output, refuse_existing
from ._record import add_data, add_model, read_record

EPILOG = """\
The page needs no network and can be sent as one file: equations with their numbers,
accuracy, validation, linearizability, certificates, a proposal for a controller. With
--last, the samples before are taken for those of the training.

examples:
  alssnn report plant.npz --data plant.csv --last 0.5 -o report.html
  alssnn report plant.npz --data monday.csv --input u --output y -o monday.html
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
        "report",
        run,
        "Write a self-contained HTML page about a saved model.",
        EPILOG,
        help="write an HTML page about a saved model",
    )
    add_model(parser)
    add_data(parser)
    add_law(parser)
    add_output(parser, "FILE.html", "page to write", Path("report.html"))


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from ..estimators import load

    refuse_existing(args, args.output_file)
    model = load(args.model)
    record, before = read_record(args, model)
    law = {"law_dt": args.law_dt, "ahead": args.ahead}
    model.report(args.output_file, *record, train=before, **law)
    args.result = {"file": args.output_file}
    print(f"Report: {args.output_file}")

"""`alssnn report`: all that is known of a model, on one page."""

from pathlib import Path

from ._arguments import add_law, add_output, refuse_existing
from ._record import add_data, add_model, read_record

HELP = "write an HTML page about a saved model"
DESCRIPTION = "Write a self-contained HTML page about a saved model."
EPILOG = """\
The page begins with the verdict. Accuracy, validation, linearizability, certificates,
a proposal for a controller and the equations with their numbers follow. It needs no
network and can be sent as one file. With --last, the samples before are taken for those
of the training.

examples:
  alssnn report plant.npz --data plant.csv --last 0.5 -o report.html
  alssnn report plant.npz --data monday.csv --input u --output y -o monday.html
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    add_model(parser)
    add_data(parser)
    add_law(parser)
    parser.add_argument(
        "--name", metavar="PLANT", help="name of the plant, for the title of the page"
    )
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
    # before it is read, which puts what came through a pipe in its place
    data = "from the standard input" if str(args.data) == "-" else args.data.name
    record, before = read_record(args, model)
    law = {"law_dt": args.law_dt, "ahead": args.ahead}
    source = f"Model {args.model.name}, record {data}"
    if args.last != 1:
        source += f", its last {100 * args.last:g} %"
    said = {"name": args.name, "source": source}
    model.report(args.output_file, *record, train=before, **law, **said)
    args.result = {"file": args.output_file}
    print(f"Report: {args.output_file}")

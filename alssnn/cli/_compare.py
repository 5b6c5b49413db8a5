"""`alssnn compare`: saved models beside each other on one record."""

from pathlib import Path

from ._arguments import add_figure
from ._comparison import prepare_figure, report, row_numbers
from ._record import add_data, read_record

HELP = "compare saved models on one record"
DESCRIPTION = "Compare saved models on one record, in a table and a figure."
EPILOG = """\
The models may be of any kind and order, but of the same outputs and sampling time. Each
reads its inputs by the names that it was fitted to. The record should not have trained
any of them: the name of a model is that of its file.

examples:
  alssnn compare linear.npz plant.npz --data plant.csv --last 0.5
  alssnn compare *.npz --data monday.csv --figure monday.png
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    # models first: behind --input they would be taken for columns
    parser.usage = "alssnn compare MODEL.npz [MODEL.npz ...] --data FILE.csv [options]"
    parser.add_argument(
        "models", nargs="+", type=Path, metavar="MODEL.npz", help="saved models"
    )
    add_data(parser)
    add_figure(parser)


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from ..estimators import load
    from ..ladder import judge_models
    from ..validation import column_names

    names = [path.stem for path in args.models]
    if len(set(names)) != len(names):
        args.parser.error("two models have the same name: rename a file")
    prepare_figure(args.figure)
    models = {name: load(path) for name, path in zip(names, args.models, strict=True)}
    outputs = {tuple(column_names(model)[1]) for model in models.values()}
    if args.output is None and len(outputs) != 1:
        args.parser.error(
            "--output is needed: the models were fitted to columns of other names"
        )
    inputs = {}
    for name, model in models.items():
        (inputs[name], y, experiment), _ = read_record(args, model)
    ladder = judge_models(models, inputs, y, experiment)
    report(ladder, args.figure, label=(args.output or outputs.pop())[0])
    rows = [row_numbers(row) for row in ladder]
    args.result = {"models": rows, "figure": args.figure}

"""`alssnn plot`: what a saved model misses of a record, and what its networks are."""

from pathlib import Path

from ._arguments import add_output, figure_name, refuse_existing
from ._comparison import FIGURE_DPI
from ._record import add_data, add_model, read_record

PARTS = ("simulation", "residual", "h", "g")
HELP = "draw simulation, residual, h and g of a saved model"
DESCRIPTION = "Draw what a saved model misses of a record, and its networks h and g."
EPILOG = """\
One figure with up to four parts: the measured output beside the simulated one, the
correlations of the residual, h, which the law cancels, and what g leaves at the output.
Without --part it has all that the model has. Take a record that did not train it.

examples:
  alssnn plot plant.npz --data plant.csv --last 0.5 -o plant.png
  alssnn plot plant.npz --data monday.csv --part h g -o networks.pdf
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
    parser.add_argument(
        "--part",
        nargs="+",
        choices=PARTS,
        help="parts to draw, below each other (default: all that the model has)",
    )
    what = "figure to write: .png, .pdf or .svg"
    add_output(parser, "FILE", what, Path("plot.png"), figure_name)


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from ..estimators import load
    from ..plotting import plot_model

    refuse_existing(args, args.output_file)
    model = load(args.model)
    record, _ = read_record(args, model)
    figure = plot_model(model, *record, parts=args.part)
    figure.savefig(args.output_file, dpi=FIGURE_DPI)
    args.result = {"file": args.output_file}
    print(f"Figure: {args.output_file}")

"""`alssnn simulate`: the outputs that a saved model predicts for recorded inputs."""

import csv
import sys

import numpy as np

from ._arguments import add_figure, add_output, refuse_existing
from ._comparison import FIGURE_DPI
from ._record import add_data, add_model, read_inputs, read_record, write_csv

HELP = "simulate a saved model with recorded inputs"
DESCRIPTION = "Simulate a saved model with the inputs of a record."
EPILOG = """\
The simulation is free-run: measured outputs are not fed back. By default it starts at
the operating point, and the file needs the inputs alone. With --x0 estimate it starts
where the first measured outputs put it, and the fit is reported. The table has a column
of time, the simulated outputs and, with several experiments, their labels; it goes to
the standard output, or to a file by -o.

examples:
  alssnn simulate plant.npz --data inputs.csv > simulated.csv
  alssnn simulate plant.npz --data plant.csv --x0 estimate -o simulated.csv
  alssnn simulate plant.npz --data plant.csv --last 0.5 --x0 estimate --figure s.png
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
        "--x0",
        choices=["rest", "estimate"],
        default="rest",
        help="initial states: at the operating point, or estimated from the first "
        "outputs of every experiment (default: %(default)s)",
    )
    add_figure(parser, "draw measured and simulated outputs, with --x0 estimate")
    add_output(parser, "FILE.csv", "table to write (default: the standard output)")


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.

    Returns
    -------
    code : int
        0, or 1 if the simulation diverges.
    """
    from ..estimators import load
    from ..experiments import split_experiments
    from ..metrics import fit_percent
    from ..validation import column_names

    if args.figure is not None and args.x0 == "rest":
        args.parser.error("--figure needs --x0 estimate, which reads the outputs")
    refuse_existing(args, args.output_file)
    model = load(args.model)
    _, names = column_names(model)
    x0, fit = "rest", None
    if args.x0 == "estimate":
        (u, y, labels), _ = read_record(args, model)
        x0 = model.estimate_x0(u, y, labels)
    else:
        u, labels = read_inputs(args, model)
    y_hat = np.reshape(model.predict(u, labels, x0=x0), (len(u), -1))
    diverges = not np.isfinite(y_hat).all()
    if args.x0 == "estimate" and not diverges:
        fit = [fit_percent(*pair) for pair in zip(y.T, y_hat.T, strict=True)]
        if not args.quiet:
            for name, value in zip(names, fit, strict=True):
                print(f"{name}: fit {value:.2f} %", file=sys.stderr)
        _draw(args, model, u, y, labels)
    parts, _ = split_experiments(len(u), labels)
    steps = np.concatenate([np.arange(part.stop - part.start) for part in parts])
    columns = [[f"{z:.10g}" for z in column] for column in (model.dt * steps, *y_hat.T)]
    header = ["time", *names]
    if labels is not None:
        header, columns = [*header, args.experiment], [*columns, labels]
    rows = zip(*columns, strict=True)
    if args.output_file is not None:
        write_csv(args.output_file, header, rows)
        print(f"Simulation: {args.output_file}")
    else:
        csv.writer(sys.stdout, lineterminator="\n").writerows([header, *rows])
    args.result = {
        "fit_percent": None if fit is None else dict(zip(names, fit, strict=True)),
        "file": args.output_file,
    }
    if args.output_file is None:
        args.result["outputs"] = {name: y_hat[:, i] for i, name in enumerate(names)}
    if diverges:
        print(
            "The simulation diverges, and no figure is drawn. Check the inputs and "
            "their units, or fit anew.",
            file=sys.stderr,
        )
    return int(diverges)


def _draw(args, model, u, y, labels):
    """Draw the first experiment, if a figure is wanted."""
    if args.figure is None:
        return
    # matplotlib takes a while: only for those who want a figure
    from ..plotting import SimulationDisplay

    args.figure.parent.mkdir(parents=True, exist_ok=True)
    display = SimulationDisplay.from_estimator(model, u, y, labels)
    display.figure_.savefig(args.figure, dpi=FIGURE_DPI)

"""`alssnn excite`: a signal to record a plant with, as CSV."""

import inspect
from pathlib import Path

from ._arguments import (
    add_figure,
    add_output,
    add_seed,
    count,
    finite,
    positive,
    refuse_existing,
)
from ._comparison import FIGURE_DPI, prepare_figure

KINDS = ("multisine", "steps", "prbs", "swept-sine")

HELP = "write a signal to record a plant with"
DESCRIPTION = "Write an excitation that keeps the limits of the actuators."
EPILOG = """\
Columns of the file: time, the inputs, experiment. Play every experiment from the same
operating point, add the columns of the measured outputs, and the file is a record for
`alssnn fit --experiment experiment`. Several inputs take one value of --low, --high,
--rate and --at for all, or one each. What belongs to another signal is an error.

examples:
  alssnn excite multisine --input valve --low 0 --high 10 --dt 0.05 -o excitation.csv
  alssnn excite multisine --input u v --dt 0.01 --band 0.5 20 --grid odd-random \\
      --realizations 1 -o excitation.csv --figure excitation.png
  alssnn excite steps --input heater --low 0 --high 100 --dt 1 --samples 3600 \\
      --hold 30 600 --rate 5 -o steps.csv
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    parser.add_argument("kind", choices=KINDS, help="kind of signal")
    parser.add_argument(
        "--input", nargs="+", default=["u"], metavar="COL", help="names of the inputs"
    )
    parser.add_argument("--dt", type=positive, default=1.0, help="sampling time in s")
    for flag, name, kind, text in (
        ("--low", "low", finite, "lowest values (default: -1)"),
        ("--high", "high", finite, "highest values (default: 1)"),
        ("--rate", "rate", positive, "largest changes per second (default: any)"),
        ("--at", "operating_point", finite, "operating points (default: the middle)"),
    ):
        parser.add_argument(
            flag, dest=name, type=kind, nargs="+", metavar="VALUE", help=text
        )
    for flag, name, text in (
        ("--periods", "n_periods", "periods of every experiment"),
        ("--realizations", "n_realizations", "independent draws"),
        ("--period", "period", "samples of a period (multisine)"),
        ("--samples", "n_samples", "samples of an experiment (steps, swept-sine)"),
        ("--bits", "n_bits", "bits of the shift register (prbs)"),
        ("--bit-samples", "bit", "samples of a bit (prbs)"),
    ):
        parser.add_argument(flag, dest=name, type=count, metavar="N", help=text)
    for flag, name, text in (
        ("--band", "band", "frequencies in Hz (multisine, swept-sine)"),
        ("--hold", "hold", "shortest and longest time between steps in s (steps)"),
    ):
        parser.add_argument(
            flag, dest=name, type=finite, nargs=2, metavar=("LOW", "HIGH"), help=text
        )
    parser.add_argument(
        "--grid", choices=["full", "odd", "odd-random"], help="lines (multisine)"
    )
    parser.add_argument(
        "--reduce-crest",
        action="store_true",
        default=None,
        help="lower peaks, for linear plants (multisine)",
    )
    add_seed(parser)
    add_output(parser, "FILE.csv", "file to write", Path("excitation.csv"))
    add_figure(parser, "draw it")


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from .. import excitation as signals

    makers = {kind: getattr(signals, kind.replace("-", "_")) for kind in KINDS}
    options = {kind: inspect.signature(makers[kind]).parameters for kind in KINDS}
    known, every = options[args.kind], {"bit"}.union(*options.values())
    values = vars(args).items()
    given = {name: z for name, z in values if name in every and z is not None}
    if "bit" in given:
        given["hold"] = given.pop("bit")
    elif args.kind == "prbs" and "hold" in given:
        args.parser.error("--hold belongs to steps: take --bit-samples for prbs")
    foreign = sorted(set(given) - set(known))
    if foreign:
        args.parser.error(f"{', '.join(foreign)} does not belong to {args.kind}")
    if "n_samples" in known and "n_samples" not in given:
        args.parser.error(f"{args.kind} needs --samples")
    given |= {"nu": len(args.input), "names": args.input, "random_state": args.seed}
    refuse_existing(args, args.output_file)
    excitation = makers[args.kind](**given)
    excitation.to_csv(args.output_file)
    print(f"{excitation!r}: {args.output_file}")
    args.result = {"file": args.output_file, "figure": args.figure}
    if args.figure is not None:
        prepare_figure(args.figure)
        excitation.plot().figure_.savefig(args.figure, dpi=FIGURE_DPI)
        print(f"Figure: {args.figure}")

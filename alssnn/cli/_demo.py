"""`alssnn demo`: the package in a minute."""

import sys
from pathlib import Path

from ..datasets import Record, fetch_wiener_hammerstein, make_wiener_hammerstein
from ._arguments import add_command, add_common, count, figure_name
from ._comparison import prepare_figure, report, run_ladder

# Sizes of the demo: a minute or two.
DEMO_SAMPLES, DEMO_MAX_ITER = 10_000, 150
QUICK_SAMPLES, QUICK_MAX_ITER = 3_000, 30
DEMO_NOISE = 0.002  # of std(y): small, so that the models are told apart
DEMO_FIGURE = "alssnn-demo.png"

# The input of the measured record is almost off before this row.
MEASURED_START = 5_200
MEASURED_QUICK = 15_000  # samples for training and for testing
MEASURED_MAX_ITER = 300

DEMO_EPILOG = """\
The first half of the record trains, the second half tests; nothing of the test data is
seen before. The table goes to the standard output, the figure to a file.

examples:
  alssnn demo                                    a minute or two
  alssnn demo --quick                            some seconds, coarser
  alssnn demo --noise 0.05 --seed 1 -o results   another record, figure in results/
  alssnn demo --record wiener-hammerstein        the measured benchmark, many minutes

The measured record is not part of the package: put WienerHammerBenchmark.csv into the
folder named by the environment variable ALSSNN_DATA_HOME.
"""


def add(commands):
    """Add the command.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        Where the command is added.
    """
    demo = add_command(
        commands,
        "demo",
        run,
        "Compare four models of a Wiener-Hammerstein circuit.",
        DEMO_EPILOG,
        help="compare four models of a circuit, in a minute or two",
    )
    demo.add_argument(
        "--record",
        choices=["simulated", "wiener-hammerstein"],
        default="simulated",
        help="a simulated circuit, or the measured benchmark (default: %(default)s)",
    )
    demo.add_argument(
        "-o",
        "--output-dir",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="folder of the figure, made if missing (default: the current one)",
    )
    demo.add_argument(
        "--figure",
        type=figure_name,
        default=Path(DEMO_FIGURE),
        metavar="FILE",
        help="name of the figure in it: .png, .pdf or .svg (default: %(default)s)",
    )
    demo.add_argument(
        "--noise",
        type=float,
        metavar="RATIO",
        help="std of the simulated measurement noise relative to that of the output "
        f"(default: {DEMO_NOISE})",
    )
    demo.add_argument(
        "--samples",
        type=count,
        metavar="N",
        help=f"samples to simulate (default: {DEMO_SAMPLES}; {QUICK_SAMPLES} if quick)",
    )
    demo.add_argument(
        "--quick", action="store_true", help="fewer samples and iterations"
    )
    add_common(demo)


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    measured = args.record == "wiener-hammerstein"
    if measured and not (args.noise is None and args.samples is None):
        args.parser.error("--noise and --samples belong to --record simulated")
    figure = prepare_figure(args)
    train, test = _measured_demo(args) if measured else _simulated_demo(args)
    max_iter = MEASURED_MAX_ITER if measured else DEMO_MAX_ITER
    options = {
        "nx": 6,
        "max_iter": QUICK_MAX_ITER if args.quick else max_iter,
        "n_init": 1 if args.quick else None,
    }
    if not args.quiet:
        sizes = f"{len(train)} samples train, {len(test)} test"
        print(f"record {args.record}: {sizes}", file=sys.stderr)
    ladder = run_ladder(args, *train, test=test, dt=train.dt, **options)
    report(ladder, figure, label="output", unit="V")


def _simulated_demo(args):
    samples = QUICK_SAMPLES if args.quick else DEMO_SAMPLES
    record = make_wiener_hammerstein(
        samples if args.samples is None else args.samples,
        noise=DEMO_NOISE if args.noise is None else args.noise,
        random_state=args.seed,
    )
    return record.split(0.5)


def _measured_demo(args):
    train, test = fetch_wiener_hammerstein(split="paper")
    if args.quick:
        rows = slice(MEASURED_START, MEASURED_START + MEASURED_QUICK)
        train = Record(train.u[rows], train.y[rows], train.dt, train.name)
        test, _ = test.split(MEASURED_QUICK)
    return train, test

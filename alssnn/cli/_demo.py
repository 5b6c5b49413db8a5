"""`alssnn demo`: the loop of a pendulum, or four models of a circuit."""

import sys
from pathlib import Path

from ._arguments import add_figure, add_seed, count, weight

# By plant: samples to simulate and largest number of trial steps; the same, if quick;
# noise over std(y), small enough to tell the models apart.
PENDULUM, CIRCUIT = "pendulum", "wiener-hammerstein"
SIZES = {PENDULUM: (3_000, 300), CIRCUIT: (10_000, 150)}
QUICK = {PENDULUM: (1_200, 300), CIRCUIT: (3_000, 30)}
NOISE = {PENDULUM: 0.01, CIRCUIT: 0.002}
DEMO_FIGURE = "alssnn-demo.png"

# The input of the measured record is almost off before this row.
MEASURED_START = 5_200
MEASURED_QUICK = 15_000  # samples for training and for testing
MEASURED_MAX_ITER = 300

HELP = "identify a pendulum and run its loop, in ten seconds"
DESCRIPTION = (
    "Identify a pendulum and run its loop, or compare four models of a circuit."
)
EPILOG = """\
pendulum: a record of a simulated pendulum, a linear model and one with h(x), and the
loop of each on the true pendulum. The first two thirds train, the last third tests.

wiener-hammerstein: four models of an electronic circuit, compared. The first half of
the record trains, the second half tests.

The table goes to the standard output, the figure to a file.

examples:
  alssnn demo                                    the pendulum, ten seconds
  alssnn demo --quick                            fewer samples
  alssnn demo --noise 0.05 --seed 1 -o results   another record, figure in results/
  alssnn demo wiener-hammerstein                 four models, some minutes
  alssnn demo wiener-hammerstein --measured      the measured benchmark, many minutes

The measured record is not part of the package: put WienerHammerBenchmark.csv into the
folder wiener_hammerstein below the one that the environment variable ALSSNN_DATA_HOME
names.
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    parser.add_argument(
        "plant",
        nargs="?",
        choices=[PENDULUM, CIRCUIT],
        default=PENDULUM,
        help="what is identified (default: %(default)s)",
    )
    parser.add_argument(
        "--measured",
        action="store_true",
        help="the measured benchmark instead of a simulated circuit",
    )
    parser.add_argument(
        "-o",
        "--output-dir",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="folder of the figure, made if missing (default: the current one)",
    )
    add_figure(parser, "name of the figure in it", Path(DEMO_FIGURE))
    parser.add_argument(
        "--noise",
        type=weight,
        metavar="RATIO",
        help="std of the simulated measurement noise relative to that of the output "
        f"(default: {NOISE[PENDULUM]}; {NOISE[CIRCUIT]} for the circuit)",
    )
    parser.add_argument(
        "--samples",
        type=count,
        metavar="N",
        help=f"samples to simulate (default: {SIZES[PENDULUM][0]}, or "
        f"{QUICK[PENDULUM][0]} if quick; {SIZES[CIRCUIT][0]}, or {QUICK[CIRCUIT][0]}, "
        "for the circuit)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="fewer samples and iterations"
    )
    add_seed(parser)


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    # after the parsing: what fits takes a while to import
    from ._comparison import prepare_figure

    if args.measured and args.plant != CIRCUIT:
        args.parser.error(f"--measured belongs to {CIRCUIT}")
    if args.measured and not (args.noise is None and args.samples is None):
        args.parser.error("--noise and --samples belong to a simulated record")
    figure = args.output_dir / args.figure
    prepare_figure(figure)
    samples, max_iter = (QUICK if args.quick else SIZES)[args.plant]
    samples = samples if args.samples is None else args.samples
    noise = NOISE[args.plant] if args.noise is None else args.noise
    if args.plant == PENDULUM:
        _run_pendulum(args, figure, samples, noise, max_iter)
    else:
        _run_circuit(args, figure, samples, noise, max_iter)


def _run_pendulum(args, figure, samples, noise, max_iter):
    from ..datasets import make_pendulum
    from ..plotting import plot_designs
    from ._comparison import FIGURE_DPI
    from ._pendulum import AMPLITUDE, LAW, LINEAR, explain, try_designs

    record = make_pendulum(
        samples, noise=noise, amplitude=AMPLITUDE, random_state=args.seed
    )
    train, test = record.split(2 / 3)
    _say(args, f"record {record.name}: {len(train)} samples train, {len(test)} test")
    outcomes = try_designs(
        record,
        train,
        test,
        max_iter=max_iter,
        random_state=args.seed,
        report=lambda line: _say(args, line),
    )
    # y has the noise in it, whose variance adds
    print(explain(outcomes, noise * record.y.std() / (1 + noise**2) ** 0.5))
    args.result = {
        name: {
            "simulation_error_percent": 100 * one.missed,
            "open_loop_distance": one.open_distance,
            "loop_distance": one.loop_distance,
            "largest_torque": abs(one.torque).max(),
            "seconds": one.seconds,
        }
        for name, one in outcomes.items()
    }
    linear = outcomes[LINEAR].response
    drawn = plot_designs(
        {
            "linear model, without feedback": (*linear[:2], outcomes[LINEAR].planned),
            "linear model, in its loop": linear,
            "model with h, in its loop": outcomes[LAW].response,
        },
        {name: one.residual for name, one in outcomes.items()},
        dt=record.dt,
        label="angle, rad",
    )
    drawn.savefig(figure, dpi=FIGURE_DPI)
    print(f"\nFigure: {figure}")


def _run_circuit(args, figure, samples, noise, max_iter):
    from ..datasets import make_wiener_hammerstein
    from ._comparison import report, row_numbers, run_ladder

    if args.measured:
        train, test = _measured(args)
        max_iter = max_iter if args.quick else MEASURED_MAX_ITER
    else:
        record = make_wiener_hammerstein(samples, noise=noise, random_state=args.seed)
        train, test = record.split(0.5)
    kind = "measured" if args.measured else "simulated"
    _say(args, f"record {kind}: {len(train)} samples train, {len(test)} test")
    options = {"nx": 6, "max_iter": max_iter, "n_init": 1 if args.quick else None}
    ladder = run_ladder(args, *train, test=test, dt=train.dt, **options)
    report(ladder, figure, label="output", unit="V")
    args.result = {"models": [row_numbers(row) for row in ladder], "figure": figure}


def _measured(args):
    """Return training and test data of the measured benchmark."""
    from ..datasets import Record, fetch_wiener_hammerstein

    train, test = fetch_wiener_hammerstein(split="paper")
    if args.quick:
        rows = slice(MEASURED_START, MEASURED_START + MEASURED_QUICK)
        train = Record(train.u[rows], train.y[rows], train.dt, train.name)
        test, _ = test.split(MEASURED_QUICK)
    return train, test


def _say(args, line):
    """Report progress on the standard error."""
    if not args.quiet:
        print(line, file=sys.stderr)

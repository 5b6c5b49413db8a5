"""The command line: ``alssnn demo`` and ``alssnn fit``.

Both fit the ladder of models (`ladder`) and print its table and what it means on the
standard output; progress and errors go to the standard error, so that the result can
be piped.  Exit codes: 0 done; 1 the computation failed; 2 wrong usage or data; 130
interrupted.  What a user can get wrong ends in one line, without a traceback.
"""

import argparse
import contextlib
import csv
import sys
from pathlib import Path

import numpy as np

from . import __version__
from .datasets import Record, fetch_wiener_hammerstein, make_wiener_hammerstein
from .ladder import PRESETS, model_ladder
from .tables import read_csv

# Sizes of the demo: about a minute on two cores without compiled loops.
DEMO_SAMPLES, DEMO_MAX_ITER = 10_000, 150
QUICK_SAMPLES, QUICK_MAX_ITER = 3_000, 30
DEMO_NOISE = 0.002  # of std(y): small, so that the models are told apart
DEMO_FIGURE = "alssnn-demo.png"
FIGURE_FORMATS = (".png", ".pdf", ".svg")
FIGURE_DPI = 150

# The input of the measured record is almost off before this row.
MEASURED_START = 5_200
MEASURED_QUICK = 15_000  # samples for training and for testing
MEASURED_MAX_ITER = 300

DESCRIPTION = """\
Identify nonlinear plants as models made for control: x+ = A x + B (u + h(y)) + g(x, u),
y = C x. The feedback u = v - h(y) cancels h; what is left from v to y is nearly linear.
"""

EPILOG = """\
examples:
  alssnn demo                                    the package in a minute
  alssnn fit plant.csv --input u --output y      your own record
  alssnn fit --help                              all options of it
"""

DEMO_EPILOG = """\
The first half of the record trains, the second half tests; nothing of the test data is
seen before. The table goes to the standard output, the figure to a file.

examples:
  alssnn demo                                    about a minute
  alssnn demo --quick                            a few seconds, coarser
  alssnn demo --noise 0.05 --seed 1 -o results   another record, figure in results/
  alssnn demo --record wiener-hammerstein        the measured benchmark, many minutes

The measured record is not part of the package: put WienerHammerBenchmark.csv into the
folder named by the environment variable ALSSNN_DATA_HOME.
"""

FIT_EPILOG = """\
The file has one header line with the names of the columns and one line per sample, in
time order, sampled at a fixed rate; columns are separated by comma, semicolon or tab.
The last part of the record (or of every experiment) tests, the rest trains.

examples:
  alssnn fit plant.csv --input u --output y
      all models; the number of states is chosen from the data
  alssnn fit plant.csv --input u1 u2 --output y --nx 6 --dt 0.01 --figure plant.png
      two inputs, six states, sampled every 10 ms, and a figure
  alssnn fit plant.csv --input u --output y --experiment run --models lti al
      several experiments, told apart by the labels in the column `run`
  alssnn fit plant.csv --input u --output y --gamma 10
      more weight on linearity than on accuracy

Reading the table: GR-SSNN much better than LTI means that the plant is nonlinear. The
closer AL-SSNN comes to GR-SSNN with a small nonlinear rest, the better a linear
controller on top of u = v - h(y) will work.
"""


def main(argv=None):
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str or None, default=None
        Arguments after the name of the program; None takes those of the process.

    Returns
    -------
    code : int
        0 done, 1 the computation failed, 2 wrong data, 130 interrupted.

    Raises
    ------
    SystemExit
        By argparse: code 2 for wrong usage, 0 after --help and --version.
    """
    args = _parser().parse_args(argv)
    try:
        args.run(args)
    except KeyboardInterrupt:
        return _complain(130, "interrupted")
    # a LinAlgError is a ValueError, but not the user's
    except (np.linalg.LinAlgError, RuntimeError, MemoryError, ImportError) as error:
        return _complain(1, str(error) or type(error).__name__)
    except (ValueError, OSError, csv.Error) as error:
        return _complain(2, error)
    return 0


def _complain(code, message):
    print(f"alssnn: error: {' '.join(str(message).split())}", file=sys.stderr)
    return code


# -- arguments -------------------------------------------------------------------------


def _parser():
    parser = _new_parser(argparse.ArgumentParser, DESCRIPTION, EPILOG, prog="alssnn")
    parser.add_argument("--version", action="version", version=f"alssnn {__version__}")
    commands = parser.add_subparsers(metavar="{demo,fit}", required=True)
    _add_demo(commands)
    _add_fit(commands)
    return parser


def _new_parser(make, description, epilog, **options):
    return make(
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        **options,
    )


def _add_demo(commands):
    demo = _new_parser(
        lambda **options: commands.add_parser("demo", **options),
        "Compare five models of a Wiener-Hammerstein circuit.",
        DEMO_EPILOG,
        help="compare five models of a circuit, in about a minute",
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
        type=_figure_name,
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
        type=_count,
        metavar="N",
        help=f"samples to simulate (default: {DEMO_SAMPLES}; {QUICK_SAMPLES} if quick)",
    )
    demo.add_argument(
        "--quick", action="store_true", help="fewer samples and iterations"
    )
    _add_common(demo)
    demo.set_defaults(run=_demo, parser=demo)


def _add_fit(commands):
    fit = _new_parser(
        lambda **options: commands.add_parser("fit", **options),
        "Compare models of your own record of a plant.",
        FIT_EPILOG,
        help="compare models of your own record in a CSV file",
        # FILE.csv first: behind --output it would be taken for a column
        usage="alssnn fit FILE.csv --input COL [COL ...] --output COL [COL ...] "
        "[options]",
    )
    data = fit.add_argument_group("data")
    data.add_argument("file", type=Path, metavar="FILE.csv", help="record to read")
    for flag, what in (("--input", "inputs"), ("--output", "outputs")):
        data.add_argument(
            flag, nargs="+", required=True, metavar="COL", help=f"columns of the {what}"
        )
    data.add_argument(
        "--experiment",
        metavar="COL",
        help="column of labels, one per uninterrupted experiment",
    )
    data.add_argument(
        "--dt",
        type=_positive,
        default=1.0,
        metavar="S",
        help="sampling time in seconds (default: %(default)s)",
    )
    data.add_argument(
        "--test-size",
        type=float,
        default=0.5,
        metavar="SHARE",
        help="last part of every experiment, kept for testing (default: %(default)s)",
    )
    model = fit.add_argument_group("models")
    model.add_argument(
        "--models",
        nargs="+",
        choices=list(PRESETS),
        default=list(PRESETS),
        help="models to compare (default: all)",
    )
    model.add_argument(
        "--nx",
        type=_order,
        default="auto",
        metavar="N",
        help="number of states, or auto (default: %(default)s)",
    )
    for net, default in (("h", 10), ("g", 10), ("f", 15)):
        model.add_argument(
            f"--n-{net}",
            type=_count_or_zero,
            default=default,
            metavar="N",
            help=f"hidden neurons of {net} (default: %(default)s)",
        )
    model.add_argument(
        "--gamma",
        type=_weight,
        default=1.0,
        metavar="WEIGHT",
        help="weight of |g|^2 in AL-SSNN, outputs scaled to unit variance; larger is "
        "more linear and less accurate (default: %(default)s)",
    )
    model.add_argument(
        "--max-iter",
        type=_count,
        default=300,
        metavar="N",
        help="largest number of trial steps of every model (default: %(default)s)",
    )
    model.add_argument(
        "--n-init",
        type=_count,
        default=1,
        metavar="N",
        help="random starts of every network (default: %(default)s)",
    )
    fit.add_argument(
        "--figure",
        type=_figure_name,
        metavar="FILE",
        help="write a figure: .png, .pdf or .svg",
    )
    _add_common(fit)
    fit.set_defaults(run=_fit, output_dir=Path())


def _add_common(parser):
    parser.add_argument(
        "--seed",
        type=_count_or_zero,
        default=0,
        metavar="N",
        help="seed of everything random (default: %(default)s)",
    )
    parser.add_argument(
        "-q", "--quiet", action="store_true", help="do not report progress"
    )


def _integer(text, smallest):
    try:
        value = int(text)
    except ValueError:
        value = None
    if value is None or value < smallest:
        raise argparse.ArgumentTypeError(
            f"must be an integer of at least {smallest}, got {text}"
        )
    return value


def _count(text):
    return _integer(text, 1)


def _count_or_zero(text):
    return _integer(text, 0)


def _order(text):
    return text if text == "auto" else _count(text)


def _number(text):
    try:
        return float(text)
    except ValueError:
        return np.nan


def _positive(text):
    if not 0 < (value := _number(text)) < np.inf:
        raise argparse.ArgumentTypeError(f"must be a positive number, got {text}")
    return value


def _weight(text):
    if not 0 <= (value := _number(text)) < np.inf:
        raise argparse.ArgumentTypeError(f"must be a number of at least 0, got {text}")
    return value


def _figure_name(text):
    path = Path(text)
    if path.suffix.lower() not in FIGURE_FORMATS:
        raise argparse.ArgumentTypeError(
            f"must end in {', '.join(FIGURE_FORMATS)}, got {text}"
        )
    return path


# -- commands --------------------------------------------------------------------------


def _demo(args):
    measured = args.record == "wiener-hammerstein"
    if measured and not (args.noise is None and args.samples is None):
        args.parser.error("--noise and --samples belong to --record simulated")
    figure = _prepare_figure(args)
    train, test = _measured_demo(args) if measured else _simulated_demo(args)
    max_iter = MEASURED_MAX_ITER if measured else DEMO_MAX_ITER
    options = {
        "nx": 6,
        # the weight 1 of the paper is meant for outputs in volts
        "gamma": float(1 / np.var(train.y)) if measured else 1.0,
        "max_iter": QUICK_MAX_ITER if args.quick else max_iter,
    }
    if not args.quiet:
        sizes = f"{len(train)} samples train, {len(test)} test"
        print(f"record {args.record}: {sizes}", file=sys.stderr)
    ladder = _run_ladder(args, *train, test=test, dt=train.dt, **options)
    _report(ladder, figure, label="output", unit="V")


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


def _fit(args):
    figure = _prepare_figure(args)
    u, y, experiment = read_csv(args.file, args.input, args.output, args.experiment)
    ladder = _run_ladder(
        args,
        u,
        y,
        experiment=experiment,
        test_size=args.test_size,
        dt=args.dt,
        nx=args.nx,
        n_h=args.n_h,
        n_g=args.n_g,
        n_f=args.n_f,
        gamma=args.gamma,
        max_iter=args.max_iter,
        n_init=args.n_init,
        models=args.models,
    )
    _report(ladder, figure, label=args.output[0])


def _prepare_figure(args):
    """Return the path of the figure, whose folder exists, or None."""
    if args.figure is None:
        return None
    path = args.output_dir / args.figure
    # before the fits: a folder that cannot be made should not cost minutes
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


def _run_ladder(args, u, y, **options):
    verbose = 0 if args.quiet else 1
    # the estimators report to the standard output, which is for the result here
    with contextlib.redirect_stdout(sys.stderr):
        return model_ladder(u, y, random_state=args.seed, verbose=verbose, **options)


def _report(ladder, figure, **labels):
    print(f"{ladder}\n")
    explanation = ladder.explain()
    if explanation:
        print(explanation)
    if figure is not None:
        # matplotlib takes a while: only for those who want a figure
        from .plotting import plot_ladder

        axes = plot_ladder(ladder, **labels)
        axes[0].figure.savefig(figure, dpi=FIGURE_DPI)
        print(f"\nFigure: {figure}")

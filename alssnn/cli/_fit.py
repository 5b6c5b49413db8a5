"""`alssnn fit`: models of your own record."""

import textwrap
import warnings
from pathlib import Path

import numpy as np

from ._arguments import (
    add_command,
    add_common,
    count,
    count_or_zero,
    figure_name,
    order,
    positive,
    weight,
    weight_or_auto,
)
from ._comparison import prepare_figure, report, run_ladder
from ._record import report_gaps

# Said again here, for --help would take seconds to import them from where they belong.
MODELS = ("lti", "fl", "al", "al-paper", "gr")  # the keys of `ladder.PRESETS`
FOUR = ("lti", "fl", "al", "gr")  # `ladder.LADDER`
HOLDS = ("zoh", "linear", "cubic")  # those of `continuous`
TEXT_WIDTH = 79  # columns
TIME_TOL = 0.05  # of a step: above the rounding of printed times
FIT_EPILOG = """\
The file has one header line with the names of the columns and one line per sample, in
time order, sampled at a fixed rate; columns are separated by comma, semicolon or tab.
A cell of an output is empty or nan where it was not measured; inputs have no gaps.
The last part of the record (or of every experiment) tests, the rest trains.

examples:
  alssnn fit plant.csv --input u --output y
      four models; the number of states is chosen from the data
  alssnn fit plant.csv --input u1 u2 --output y --nx 6 --dt 0.01 --figure plant.png
      two inputs, six states, sampled every 10 ms, and a figure
  alssnn fit plant.csv --input u --output y --experiment run --models lti al
      several experiments, told apart by the labels in the column `run`
  alssnn fit plant.csv --input valve --disturbance inflow --output level
      the inflow is measured, and the law feeds it forward
  alssnn fit plant.csv --input u --output y --gamma 1
      more weight on linearity than on accuracy
  alssnn fit plant.csv --input u --output y --model al --save plant.npz
      one model, kept for validate, report, control and export

Reading the table: GR-SSNN much better than LTI means that the plant is nonlinear. The
closer AL-SSNN comes to GR-SSNN with a small nonlinear rest, the better a linear
controller on top of u = v - h(x) will work. An equals sign behind a name means that
its networks did not help: the model is the linear one.

A single model is fitted beside the linear one. If it is worse on the hidden part, the
exit code is 1 and nothing is saved (but by --force).
"""


def add(commands):
    """Add the command.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        Where the command is added.
    """
    fit = add_command(
        commands,
        "fit",
        run,
        "Compare models of your own record of a plant.",
        FIT_EPILOG,
        help="compare models of your own record in a CSV file",
        # FILE.csv first: behind --output it would be taken for a column
        usage="alssnn fit FILE.csv --input COL [COL ...] --output COL [COL ...] "
        "[options]",
    )
    _add_data(fit.add_argument_group("data"))
    models = fit.add_argument_group("models")
    for add_some in (_add_models, _add_weights, _add_form, _add_time, _add_effort):
        add_some(models)
    fit.add_argument(
        "--save",
        type=Path,
        metavar="MODEL.npz",
        help="save the fitted model, with the names of its columns; needs one model",
    )
    fit.add_argument(
        "--figure",
        type=figure_name,
        metavar="FILE",
        help="write a figure: .png, .pdf or .svg",
    )
    fit.add_argument(
        "--force",
        action="store_true",
        help="save a model that is worse than the linear one or than the mean, too",
    )
    add_common(fit)
    fit.set_defaults(output_dir=Path())


def _add_data(data):
    """Add the options that say what is read, and how much of it tests."""
    data.add_argument("file", type=Path, metavar="FILE.csv", help="record to read")
    for flag, what in (("--input", "inputs"), ("--output", "outputs")):
        data.add_argument(
            flag, nargs="+", required=True, metavar="COL", help=f"columns of the {what}"
        )
    data.add_argument(
        "--disturbance",
        nargs="+",
        default=[],
        metavar="COL",
        help="columns of further inputs that are measured but no controller moves",
    )
    data.add_argument(
        "--experiment",
        metavar="COL",
        help="column of labels, one per uninterrupted experiment",
    )
    data.add_argument(
        "--dt",
        type=positive,
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


def _add_models(model):
    """Add the options that say which models are fitted, and of what size."""
    which = model.add_mutually_exclusive_group()
    which.add_argument(
        "--models",
        nargs="+",
        choices=list(MODELS),
        help=f"models to compare (default: {' '.join(FOUR)})",
    )
    which.add_argument(
        "--model",
        choices=[*MODELS, "ladder"],
        default="ladder",
        help="the one model to fit, or the ladder of four (default: %(default)s); "
        "al-paper is al with h(y), a penalty on |g|^2, and A free",
    )
    model.add_argument(
        "--nx",
        type=order,
        default="auto",
        metavar="N",
        help="number of states, a range such as 2-5, or auto: chosen by hidden samples "
        "(default: %(default)s)",
    )
    for net, default in (("h", 10), ("g", 10), ("f", 15)):
        model.add_argument(
            f"--n-{net}",
            type=count_or_zero,
            default=default,
            metavar="N",
            help=f"hidden neurons of {net} (default: %(default)s)",
        )


def _add_weights(model):
    """Add the options that weigh what a fit would rather do without."""
    model.add_argument(
        "--gamma",
        type=weight,
        metavar="WEIGHT",
        help="weight of the nonlinear rest in AL-SSNN, outputs scaled to unit "
        "variance; larger is more linear and less accurate (default: 0.01, and 1 for "
        "al-paper)",
    )
    model.add_argument(
        "--gamma-h",
        type=weight,
        metavar="WEIGHT",
        help="weight of |h|^2; larger keeps u closer to v and the loop inside the "
        "data (default: 0)",
    )
    model.add_argument(
        "--alpha",
        type=weight_or_auto,
        default="auto",
        metavar="WEIGHT",
        help="weight of the squared network parameters; auto chooses it, and returns "
        "the linear model where networks do not help (default: %(default)s)",
    )


def _add_form(model):
    """Add the options that say what the equations are, and what their noise."""
    model.add_argument(
        "--stability",
        choices=["auto", "contractive", "none"],
        default="auto",
        help="whether A is kept a contraction (default: %(default)s: in all models but "
        "al-paper)",
    )
    model.add_argument(
        "--feedback",
        choices=["state", "output"],
        help="what h sees (default: state, output for al-paper)",
    )
    model.add_argument(
        "--input-map",
        choices=["identity", "monotone"],
        default="identity",
        help="what the linear part of FL-SSNN and AL-SSNN answers to: u + h, or a map "
        "that increases with u, for valves, fans and gains that depend on the state "
        "(default: %(default)s)",
    )
    model.add_argument(
        "--innovations",
        action="store_true",
        help="fit the errors one sample ahead instead of a simulation: for a record of "
        "a loop, and for noise that goes through the plant",
    )


def _add_time(model):
    """Add the options of models in continuous time."""
    model.add_argument(
        "--continuous",
        action="store_true",
        help="fit equations of derivatives: one model for every sampling time",
    )
    model.add_argument(
        "--hold",
        choices=HOLDS,
        help="with --continuous, what the inputs do between samples: zoh if a computer "
        "set them (default), linear or cubic if they were measured",
    )


def _add_effort(model):
    """Add the options that say how long a training searches."""
    model.add_argument(
        "--drift",
        choices=["output", "input"],
        help="with --innovations, a random walk that nobody measured, added to the "
        "outputs or to the inputs: a sensor or a load that drifts",
    )
    model.add_argument(
        "--horizon",
        type=count,
        default=1,
        metavar="K",
        help="with --innovations, samples over which predictions are trained "
        "(default: %(default)s)",
    )
    model.add_argument(
        "--max-iter",
        type=count,
        metavar="N",
        help="largest number of trial steps of the training of every model, without "
        "the search for alpha and the stages on all samples of a record of more than "
        "8000 (default: 300, 100 for lti)",
    )
    model.add_argument(
        "--n-init",
        type=count,
        metavar="N",
        help="random starts of every network (default: 3)",
    )


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.

    Returns
    -------
    code : int
        0, or 1 if the one model that was asked for is worse than a linear one, or than
        the mean of the output, on the hidden part.
    """
    # the rest takes seconds to import, which --help should not
    from ..ladder import PRESETS
    from ..tables import read_csv

    for option, default in (("drift", None), ("horizon", 1)):
        if getattr(args, option) != default and not args.innovations:
            args.parser.error(f"--{option} needs --innovations")
    if args.hold is not None and not args.continuous:
        args.parser.error("--hold needs --continuous")
    if args.continuous and args.dt is args.parser.get_default("dt"):
        args.parser.error("--continuous needs --dt, the sampling time in seconds")
    models = args.models or [args.model]
    if models == ["ladder"]:
        models = list(FOUR)
    if args.save is not None:
        if len(models) != 1:
            args.parser.error("--save needs one model, such as --model al")
        if args.save.exists() and args.save.samefile(args.file):
            args.parser.error("--save must not be the record itself")
        # before the fit: a folder that cannot be made should not cost minutes
        args.save.parent.mkdir(parents=True, exist_ok=True)
    chosen = models[0] if len(models) == 1 else None
    if chosen not in (None, "lti"):
        models = ["lti", chosen]  # to compare with
    figure = prepare_figure(args)
    inputs = [*args.input, *args.disturbance]
    u, y, experiment = read_csv(args.file, inputs, args.output, args.experiment)
    report_gaps(y, args.output)
    _compare_times(args)
    ladder = run_ladder(
        args,
        u,
        y,
        experiment=experiment,
        test_size=args.test_size,
        # an integer where 1.0 would be taken for the default
        dt=1 if args.continuous and args.dt == 1.0 else args.dt,
        nx=args.nx,
        n_h=args.n_h,
        n_g=args.n_g,
        n_f=args.n_f,
        gamma=args.gamma,
        gamma_h=args.gamma_h,
        alpha=args.alpha,
        stability=None if args.stability == "none" else args.stability,
        feedback=args.feedback,
        input_map=args.input_map,
        disturbances=list(range(len(args.input), len(inputs))) or None,
        noise="innovations" if args.innovations else "output",
        drift=args.drift,
        horizon=args.horizon,
        time="continuous" if args.continuous else "discrete",
        hold=args.hold or "zoh",
        max_iter=args.max_iter,
        n_init=args.n_init,
        models=models,
    )
    faults = {row.name: fault for row in ladder if (fault := ladder.fault(row))}
    row = ladder[PRESETS[chosen][0]] if chosen else None
    refused = row is not None and row.name in faults
    saves = args.save is not None and not (refused and not args.force)
    if saves and row is not None:
        row.model.feature_names_in_ = np.array(inputs, dtype=object)
        row.model.output_names_ = list(args.output)
        row.model.save(args.save)  # before a figure that may fail
    report(ladder, figure, label=args.output[0])
    for fault in faults.values():
        print("\n" + textwrap.fill(f"Caution: {fault}", TEXT_WIDTH))
    if saves:
        print(
            f"\nModel: {args.save}. It was not trained on the last "
            f"{100 * args.test_size:g} %: validate it there, by --last "
            f"{args.test_size:g}."
        )
    elif args.save is not None:
        print(f"\n{args.save} was not written. To save the model anyway, use --force.")
    return int(refused and not args.force)


def _compare_times(args):
    """Warn where a column of time contradicts the sampling time."""
    if args.experiment is not None:
        return  # its time may start anew
    from ..tables import read_steps

    name, steps = read_steps(args.file)
    if not len(steps):
        return
    middle = float(np.median(steps))
    if middle <= 0 or np.abs(steps - middle).max() > TIME_TOL * middle:
        warnings.warn(
            f"The steps of the column {name!r} are between {steps.min():g} and "
            f"{steps.max():g}. Models need a fixed rate: resample the record.",
            stacklevel=2,
        )
    elif abs(middle - args.dt) > TIME_TOL * args.dt:
        warnings.warn(
            f"The steps of the column {name!r} are {middle:g}, but the sampling time "
            f"is {args.dt:g} s. If the column is in seconds, use --dt {middle:g}.",
            stacklevel=2,
        )

"""`alssnn control`: a controller for a saved model, and how the model follows it."""

import textwrap
from itertools import compress
from pathlib import Path

import numpy as np

from ..shown import percent
from ._arguments import (
    add_figure,
    add_limits,
    add_output,
    count,
    finite,
    scalar,
    weight,
)
from ._comparison import FIGURE_DPI, TEXT_WIDTH
from ._record import (
    add_data,
    add_model,
    gain_columns,
    read_record,
    refuse_columns,
    write_csv,
)

HELP = "design a controller for a saved model"
DESCRIPTION = "Design a linear-quadratic controller with integrators for a saved model."
EPILOG = """\
The controller is u = v - h(s), v = u_e - K [x; z], z+ = z + y - r: the law cancels h,
the linear-quadratic regulator with integrators makes y settle at r. All weights are
relative to the size of the signals in the training data. u is what the actuator sees,
v is not. Written are

  gain.csv   K, one row per input, one column per state and integrator
  step.csv   the step response that was designed, and that of the whole model with u
  step.png   both as a figure

`alssnn export --c DIR --gain design/gain.csv` writes law, observer and gain as C.

examples:
  alssnn control plant.npz --data plant.csv --last 0.5 -o design
      only if the model passes on this record
  alssnn control plant.npz --qi 0.1 --ru 0.1 -o faster
  alssnn control plant.npz --u-min -5 --u-max 5 --step 1 -o limited
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    add_model(parser)
    add_data(parser, required=False)
    parser.add_argument(
        "--force",
        action="store_true",
        help="design for a model that fails its validation, too",
    )
    for flag, what, default in (
        ("--qx", "states", 0.0),
        ("--qy", "outputs", 1.0),
        ("--qi", "integrators, larger is faster", 0.01),
        ("--ru", "inputs v, smaller is faster", 1.0),
    ):
        parser.add_argument(
            flag,
            type=weight,
            default=default,
            metavar="WEIGHT",
            help=f"weight of the {what} (default: %(default)s)",
        )
    add_limits(parser)
    parser.add_argument(
        "--step",
        nargs="+",
        type=finite,
        metavar="Y",
        help="step of the references: one, or one per output (default: one standard "
        "deviation of the training data)",
    )
    parser.add_argument(
        "--samples",
        type=count,
        metavar="N",
        help="length of the step response (default: until the design has settled)",
    )
    add_figure(parser, "name of the figure", Path("step.png"))
    add_output(parser, "DIR", "folder to write to, made if missing", Path("design"))


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.

    Returns
    -------
    code : int
        0, or 1 if the model fails its validation or its loop diverges.
    """
    from ..estimators import load

    if args.data is None:
        refuse_columns(args)
    # python-control and matplotlib take a while: only for those who want a design
    from ..feedback import balanced_weights, lqi, step_comparison

    model = load(args.model)
    if not _trusted(args, model) and not args.force:
        print("No controller was designed. To design one anyway, use --force.")
        return 1
    law = model.linearizing_law(*(scalar(z) for z in (args.u_min, args.u_max)))
    Q, R = balanced_weights(
        model, state=args.qx, output=args.qy, integral=args.qi, control=args.ru
    )
    K = lqi(model, Q, R)
    step = scalar(args.step)
    responses = step_comparison(model, K, step=step, n_samples=args.samples, law=law)
    files = [args.output_file / name for name in ("gain.csv", "step.csv", args.figure)]
    gain_file, step_file, figure = files
    states, integrators = gain_columns(model)
    columns = [*states, *integrators]
    write_csv(gain_file, columns, K.tolist())
    header, table = _table(responses)
    write_csv(step_file, header, table.tolist())
    display = _draw(model, responses, step, figure)
    print(f"K, columns {' '.join(columns)} =")
    print(np.array2string(K, precision=6))
    _print_distances(display, responses["design"])
    nu = model.plant_.nv
    names = [display.names[label] for label in responses["model"].output_labels[-nu:]]
    u = responses["model"].outputs[-nu:]
    if np.isfinite(u).all():
        _compare_inputs(names, u, model, law)
    print(f"Files: {', '.join(map(str, files))}")
    if args.data is None:
        print(textwrap.fill(_unknown(model), TEXT_WIDTH))
    args.result = {
        "columns": columns,
        "gain": K,
        "distance": display.distance_["model"],
        "files": files,
    }
    if not np.isfinite(table).all():
        print("The loop of the model diverges: choose slower weights.")
        return 1
    return 0


def _trusted(args, model):
    """Print what is known against the model, and return whether a design may go on."""
    if args.data is not None:
        validation = model.validate(*read_record(args, model)[0])
        linear = validation["linearizability"]
        if validation.passed and (linear.passed or model.fitted_.grows):
            return True
        print(validation)
        return False
    if model.train_score_ <= 0 and not model.fitted_.grows:
        print(
            "The model follows its own training record no better than the mean of the "
            "output."
        )
        return False
    return True


def _unknown(model):
    """Say what is known of a model that no record has judged."""
    from ..metrics import missed_percent

    missed = missed_percent(model.train_score_)
    known = ""
    if np.isfinite(missed):
        known = f" Of its training record the model misses {percent(missed)}."
    return (
        "The verdict is unknown. The model was not validated here: whether the plant "
        f"follows this design is open.{known} Name a record that did not train it, by "
        "--data FILE.csv --last SHARE."
    )


def _print_distances(display, designed):
    """Print how far the outputs of the model are from those of the design."""
    print("RMS distance of the model from the design, step of all references:")
    distances = dict(zip(display.outputs, display.distance_["model"], strict=True))
    for label, design in zip(designed.output_labels, designed.outputs, strict=True):
        distance = distances[label]
        share = 100 * distance / (np.ptp(design) or 1.0)
        print(
            f"  {display.names[label]}: {distance:.3g}, {percent(share)} of the range "
            "of the design"
        )


def _compare_inputs(names, u, model, law):
    """Print what the actuators do in the step beside what they did in training."""
    from ..feedback import input_range
    from ..feedback.law import leaves_range

    print("Inputs of the plant, in the step and in the training data:")
    low, high = input_range(model)
    for i, (name, signal) in enumerate(zip(names, u, strict=True)):
        cut = np.mean((signal <= law.u_min[i]) | (signal >= law.u_max[i]))
        limited = f", at a limit in {percent(100 * cut, 3)} of the samples"
        limited = limited if cut else ""
        print(
            f"  {name}: {signal.min():.4g} to {signal.max():.4g}, largest size "
            f"{np.abs(signal).max():.4g}; training {low[i]:.4g} to {high[i]:.4g}"
            f"{limited}"
        )
    leaves = list(compress(names, leaves_range(model, u)))
    if leaves:
        print(
            textwrap.fill(
                f"The step drives {', '.join(leaves)} out of the range of the training "
                "data, where the model is a guess. Take a smaller --step, a larger "
                "--ru, limits by --u-min and --u-max, or fit with a larger --gamma-h, "
                "which makes the law do less.",
                TEXT_WIDTH,
            )
        )


def _table(responses):
    design = responses["design"]
    header, columns = ["time"], [design.time]
    for name, response in responses.items():
        header += [f"{label} {name}" for label in response.output_labels]
        columns += list(response.outputs)
    return header, np.column_stack(columns)


def _draw(model, responses, step, path):
    from ..plotting import LoopDisplay

    display = LoopDisplay.from_steps(model, responses, step)
    path.parent.mkdir(parents=True, exist_ok=True)
    display.figure_.savefig(path, dpi=FIGURE_DPI)
    return display

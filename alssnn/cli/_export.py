"""`alssnn export`: a saved model for other languages."""

from pathlib import Path

from ..estimators import load
from ..tables import read_csv
from ._arguments import add_command
from ._record import add_model, gain_columns

EPILOG = """\
C sources and the file for MATLAB hold the model, its law and an observer, and with
--gain the controller; ONNX graphs hold one step of the model, and the law.

examples:
  alssnn export plant.npz --c firmware
  alssnn export plant.npz --c firmware --gain design/gain.csv --dtype float
  alssnn export plant.npz --mat plant.mat
  alssnn export plant.npz --onnx graphs
"""


def add(commands):
    """Add the command.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        Where the command is added.
    """
    parser = add_command(
        commands,
        "export",
        run,
        "Write a saved model as C sources, for MATLAB, or as ONNX graphs.",
        EPILOG,
        help="write a saved model as C sources, for MATLAB or ONNX",
    )
    add_model(parser)
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument("--c", type=Path, metavar="DIR", help="folder of C99 sources")
    target.add_argument("--mat", type=Path, metavar="FILE", help="file for MATLAB")
    target.add_argument(
        "--onnx", type=Path, metavar="DIR", help="folder of ONNX graphs (extra onnx)"
    )
    parser.add_argument(
        "--gain",
        type=Path,
        metavar="FILE.csv",
        help="gain of the controller, as `alssnn control` writes it",
    )
    parser.add_argument(
        "--dtype",
        choices=["double", "float"],
        default="double",
        help="type of the numbers in C (default: %(default)s)",
    )


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    if args.onnx is not None and args.gain is not None:
        raise ValueError(
            "`--gain` must be left out with --onnx, whose graphs hold no controller. "
            "Use --c or --mat for one."
        )
    model = load(args.model)
    gain = None if args.gain is None else _read_gain(args.gain, model)
    if args.mat is not None:
        args.mat.parent.mkdir(parents=True, exist_ok=True)
        model.to_mat(args.mat, gain=gain)
        paths = [args.mat]
    elif args.onnx is not None:
        paths = model.to_onnx(args.onnx)
    else:
        paths = model.to_c(args.c, gain=gain, dtype=args.dtype)
    print("\n".join(map(str, paths)))


def _read_gain(path, model):
    K_x, K_z, _ = read_csv(path, *gain_columns(model))
    return [[*x, *z] for x, z in zip(K_x, K_z, strict=True)]

"""`alssnn export`: a saved model for other languages."""

from pathlib import Path

from ._arguments import (
    add_command,
    add_limits,
    add_overwrite,
    refuse_existing,
    scalar,
)
from ._record import add_model, gain_columns

EPILOG = """\
C sources and the file for MATLAB hold the model, its law and an observer, and with
--gain the controller; ONNX graphs hold one step of the model, and the law.

examples:
  alssnn export plant.npz --c firmware
  alssnn export plant.npz --c firmware --gain design/gain.csv --dtype float
  alssnn export plant.npz --c firmware --gain design/gain.csv --u-min -5 --u-max 5
      the law limits u, and integrators do not wind up
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
    add_overwrite(parser)
    add_limits(parser)
    parser.add_argument(
        "--prefix",
        default="plant",
        metavar="NAME",
        help="begins the names of files and functions, C and ONNX (default: "
        "%(default)s)",
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
    from ..estimators import load

    if args.onnx is not None and args.gain is not None:
        raise ValueError(
            "`--gain` must be left out with --onnx, whose graphs hold no controller. "
            "Use --c or --mat for one."
        )
    model = load(args.model)
    gain = None if args.gain is None else _read_gain(args.gain, model)
    law = None
    if args.u_min is not None or args.u_max is not None:
        law = model.linearizing_law(scalar(args.u_min), scalar(args.u_max))
    if args.mat is not None:
        refuse_existing(args, args.mat)
        model.to_mat(args.mat, gain=gain, law=law)
        paths = [args.mat]
    elif args.onnx is not None:
        paths = model.to_onnx(args.onnx, law=law, prefix=args.prefix)
    else:
        paths = model.to_c(
            args.c, gain=gain, law=law, dtype=args.dtype, prefix=args.prefix
        )
    print("\n".join(map(str, paths)))
    args.result = {"files": list(paths)}


def _read_gain(path, model):
    from ..tables import read_csv

    K_x, K_z, _ = read_csv(path, *gain_columns(model))
    return [[*x, *z] for x, z in zip(K_x, K_z, strict=True)]

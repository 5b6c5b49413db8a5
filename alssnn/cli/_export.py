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
C sources, Structured Text and the file for MATLAB hold the model, its law and an
observer, and with --gain the controller; ONNX graphs hold one step of the model, and
the law. An FMU is the model, or with --gain the controller, or by --both their loop.

examples:
  alssnn export plant.npz --c firmware
  alssnn export plant.npz --c firmware --gain design/gain.csv --dtype float
  alssnn export plant.npz --c firmware --gain design/gain.csv --u-min -5 --u-max 5
      the law limits u, and integrators do not wind up
  alssnn export plant.npz --mat plant.mat
  alssnn export plant.npz --onnx graphs
  alssnn export plant.npz --st plant.st --gain design/gain.csv
  alssnn export plant.npz --fmu plant.fmu
  alssnn export plant.npz --fmu control.fmu --gain design/gain.csv --fmi 2.0
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
        "Write a saved model for C, MATLAB, ONNX, PLCs, or as an FMU.",
        EPILOG,
        help="write a saved model for C, MATLAB, ONNX, PLCs or as an FMU",
    )
    add_model(parser)
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument("--c", type=Path, metavar="DIR", help="folder of C99 sources")
    target.add_argument("--mat", type=Path, metavar="FILE", help="file for MATLAB")
    target.add_argument(
        "--onnx", type=Path, metavar="DIR", help="folder of ONNX graphs (extra onnx)"
    )
    target.add_argument(
        "--st", type=Path, metavar="FILE", help="Structured Text of IEC 61131-3"
    )
    target.add_argument(
        "--fmu", type=Path, metavar="FILE", help="FMU for co-simulation"
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
        help="type of the numbers in C and Structured Text (default: %(default)s)",
    )
    parser.add_argument(
        "--both",
        action="store_true",
        help="with --fmu and --gain: the loop of model and controller",
    )
    parser.add_argument(
        "--fmi",
        choices=["3.0", "2.0"],
        default="3.0",
        help="version of the FMU (default: %(default)s)",
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
            "Use --c, --st, --fmu or --mat for one."
        )
    if args.both and (args.fmu is None or args.gain is None):
        raise ValueError(
            "`--both` must come with --fmu and --gain: the loop needs a controller. "
            "`alssnn control` writes a gain."
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
    elif args.st is not None:
        refuse_existing(args, args.st)
        paths = [model.to_st(args.st, gain=gain, law=law, dtype=args.dtype)]
    elif args.fmu is not None:
        refuse_existing(args, args.fmu)
        paths = [_write_fmu(model, args, gain, law)]
    else:
        paths = model.to_c(
            args.c, gain=gain, law=law, dtype=args.dtype, prefix=args.prefix
        )
    print("\n".join(map(str, paths)))
    args.result = {"files": list(paths)}


def _write_fmu(model, args, gain, law):
    what = "both" if args.both else "model" if gain is None else "controller"
    fmu = model.to_fmu(args.fmu, what=what, version=args.fmi, gain=gain, law=law)
    if fmu.no_binary:
        print(fmu.no_binary)
    return fmu.path


def _read_gain(path, model):
    from ..tables import read_csv

    K_x, K_z, _ = read_csv(path, *gain_columns(model))
    return [[*x, *z] for x, z in zip(K_x, K_z, strict=True)]

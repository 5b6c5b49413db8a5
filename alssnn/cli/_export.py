"""`alssnn export`: a saved model for other languages."""

from pathlib import Path
from typing import Any

from ._arguments import (
    add_limits,
    add_overwrite,
    refuse_existing,
    scalar,
)
from ._record import add_model, gain_columns

# folder or file, what it is, and which of the options it has
OBSERVED = ("gain", "gate", "no-observer")
TARGETS = {
    "c": (True, "folder of C99 sources", (*OBSERVED, "prefix", "dtype", "layout")),
    "mat": (False, "file for MATLAB", OBSERVED),
    "simulink": (
        True,
        "folder of a script that builds a diagram, with its data and functions",
        (*OBSERVED, "prefix"),
    ),
    "onnx": (True, "folder of ONNX graphs (extra onnx)", ("prefix",)),
    "st": (
        False,
        "Structured Text of IEC 61131-3; PLCopen XML where FILE ends in .xml",
        (*OBSERVED, "prefix", "dtype"),
    ),
    "modelica": (False, "package of Modelica, such as Motor.mo", OBSERVED),
    "fmu": (False, "FMU for co-simulation", ("gain", "gate", "both", "fmi", "units")),
}

HELP = "write a saved model for C, PLCs, MATLAB, Simulink, Modelica, ONNX, FMI"
DESCRIPTION = (
    "Write a saved model for C, PLCs, MATLAB, Simulink, Modelica, ONNX or FMI."
)
EPILOG = """\
C sources, Structured Text, Modelica, the file for MATLAB and that of Simulink hold the
model, its law and an observer, and with --gain the controller. ONNX graphs hold one
step of the model, and the law. An FMU is the model, or with --gain the controller, or
by --both their loop.

examples:
  alssnn export plant.npz --c firmware
  alssnn export plant.npz --c firmware --gain design/gain.csv --dtype float
  alssnn export plant.npz --c firmware --gain design/gain.csv --u-min -5 --u-max 5
      the law limits u, and integrators do not wind up
  alssnn export plant.npz --c library --layout arduino --dtype float
  alssnn export plant.npz --mat plant.mat
  alssnn export plant.npz --simulink diagram --gain design/gain.csv
  alssnn export plant.npz --onnx graphs
  alssnn export plant.npz --st plant.st --gain design/gain.csv
  alssnn export plant.npz --modelica Plant.mo --gain design/gain.csv
  alssnn export plant.npz --fmu plant.fmu
  alssnn export plant.npz --fmu control.fmu --gain design/gain.csv --fmi 2.0
  alssnn export plant.npz --fmu plant.fmu --units speed=rad/s voltage=V
"""


OPTIONS: dict[str, dict[str, Any]] = {  # that not every target has
    "gate": {
        "type": float,
        "metavar": "SIGMA",
        "help": "largest innovation of the observer, in standard deviations: spikes of "
        "a sensor count as this (default: 100)",
    },
    "no-observer": {"action": "store_true", "help": "leave the observer out"},
    "prefix": {
        "metavar": "NAME",
        "help": "begins the names of files, functions and blocks (default: plant)",
    },
    "dtype": {
        "choices": ["double", "float"],
        "help": "type of all numbers (default: double)",
    },
    "layout": {
        "choices": ["flat", "arduino"],
        "help": "all files in one folder, or a library of the Arduino IDE and "
        "PlatformIO with an example sketch (default: flat)",
    },
    "both": {
        "action": "store_true",
        "help": "with --gain: the loop of model and controller",
    },
    "fmi": {"choices": ["3.0", "2.0"], "help": "version of the FMU (default: 3.0)"},
    "units": {
        "nargs": "+",
        "metavar": "NAME=UNIT",
        "help": "units of signals, such as speed=rad/s",
    },
}


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    add_model(parser)
    parser.usage = (
        "%(prog)s [options] MODEL.npz TARGET PATH\n"
        f"  where TARGET is one of {', '.join(f'--{name}' for name in TARGETS)}"
    )
    target = parser.add_mutually_exclusive_group(required=True)
    for name, (is_folder, words, _) in TARGETS.items():
        metavar = "DIR" if is_folder else "FILE"
        target.add_argument(f"--{name}", type=Path, metavar=metavar, help=words)
    parser.add_argument(
        "--gain",
        type=Path,
        metavar="FILE.csv",
        help="gain of the controller, as `alssnn control` writes it",
    )
    add_overwrite(parser)
    add_limits(parser)
    for name, options in OPTIONS.items():
        of = ", ".join(f"--{target}" for target in _targets_with(name))
        help = f"{options['help']}; with {of}"
        parser.add_argument(f"--{name}", **{"default": None, **options, "help": help})


def _targets_with(option):
    return [target for target, (_, _, known) in TARGETS.items() if option in known]


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from ..estimators import load

    (target,) = (name for name in TARGETS if getattr(args, name) is not None)
    is_folder, _, known = TARGETS[target]
    options = _options(args, target, known)
    model, path = load(args.model), getattr(args, target)
    if args.gain is not None:
        options["gain"] = _read_gain(args.gain, model)
    if args.u_min is not None or args.u_max is not None:
        limits = scalar(args.u_min), scalar(args.u_max)
        options["law"] = model.linearizing_law(*limits)
    if args.gate is not None:
        options["observer"] = model.observer(gate=args.gate)
    if args.no_observer:
        options["observer"] = False
    if not is_folder:
        refuse_existing(args, path)
    written = getattr(model, f"to_{target}")(path, **options)
    if getattr(written, "no_binary", ""):
        print(written.no_binary)
    paths = written if isinstance(written, list) else [Path(written or path)]
    print("\n".join(map(str, paths)))
    args.result = {"files": paths}


def _options(args, target, known):
    """Return the options of the target by their names in Python, checked."""
    for name in sorted({*OPTIONS, "gain"}):
        value = getattr(args, name.replace("-", "_"))
        if value is not None and name not in known:
            others = " or ".join(f"--{other}" for other in _targets_with(name))
            raise ValueError(
                f"`--{name}` must be left out with --{target}, which has no use for "
                f"it. It is an option of {others}."
            )
    of_controller = ("both", "gate") if target == "fmu" else ()
    for name in of_controller:
        if getattr(args, name) is not None and args.gain is None:
            raise ValueError(
                f"`--{name}` must come with --gain: in an FMU it is of the controller. "
                "`alssnn control` writes a gain."
            )
    if args.gate is not None and args.no_observer:
        raise ValueError(
            "`--gate` must be left out with --no-observer: it is one of the observer."
        )
    options = {"version": args.fmi, "units": _units(args.units)}
    options |= {name: getattr(args, name) for name in ("prefix", "dtype", "layout")}
    if args.gain is not None and target == "fmu":
        options["what"] = "both" if args.both else "controller"
    return {name: value for name, value in options.items() if value is not None}


def _units(pairs):
    """Return units by names of signals; None without any."""
    if pairs is None:
        return None
    split = [pair.partition("=") for pair in pairs]
    for name, equals, unit in split:
        if not (name and equals and unit):
            raise ValueError(
                "`--units` must be pairs such as speed=rad/s, got "
                f"{name + equals + unit!r}."
            )
    return {name: unit for name, _, unit in split}


def _read_gain(path, model):
    from ..tables import read_csv

    K_x, K_z, _ = read_csv(path, *gain_columns(model))
    return [[*x, *z] for x, z in zip(K_x, K_z, strict=True)]

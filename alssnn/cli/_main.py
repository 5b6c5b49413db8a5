"""The parser of all commands, and how errors end."""

import argparse
import csv
import sys
import warnings

import numpy as np

from .. import __version__
from . import _control, _demo, _excite, _export, _fit, _look, _report, _validate
from ._arguments import new_parser

COMMANDS = (_demo, _excite, _look, _fit, _validate, _report, _control, _export)

DESCRIPTION = """\
Identify nonlinear plants as models made for control: x+ = A x + B (u + h(y)) + g(x, u),
y = C x. The feedback u = v - h(y) cancels h; what is left from v to y is nearly linear.
"""

EPILOG = """\
examples:
  alssnn demo                                         the package in half a minute
  alssnn excite multisine --input u -o excitation.csv  a signal to record with
  alssnn look plant.csv --input u --output y          what is in a record
  alssnn fit plant.csv --input u --output y           models of your own record
  alssnn fit plant.csv --input u --output y --model al --save plant.npz
  alssnn validate plant.npz --data plant.csv --last 0.5
  alssnn report plant.npz --data plant.csv --last 0.5 -o report.html
  alssnn control plant.npz -o design
  alssnn export plant.npz --c firmware
  alssnn fit --help                                   all options of it

exit codes: 0 done; 1 a check or the computation failed; 2 wrong usage or data;
130 interrupted
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
        0 done, 1 a check or the computation failed, 2 wrong data, 130 interrupted.

    Raises
    ------
    SystemExit
        By argparse: code 2 for wrong usage, 0 after --help and --version.
    """
    args = _parser().parse_args(argv)
    try:
        with warnings.catch_warnings():
            # one line each on the standard error, without the place in the code
            warnings.showwarning = _warn
            # records are read by the names of their columns, then they are arrays
            warnings.filterwarnings("ignore", "X does not have valid feature names")
            return args.run(args) or 0
    except KeyboardInterrupt:
        return _complain(130, "interrupted")
    # a LinAlgError is a ValueError, but not the user's
    except (np.linalg.LinAlgError, RuntimeError, MemoryError, ImportError) as error:
        return _complain(1, str(error) or type(error).__name__)
    except (ValueError, OSError, csv.Error) as error:
        return _complain(2, error)


def _complain(code, message):
    print(f"alssnn: error: {' '.join(str(message).split())}", file=sys.stderr)
    return code


def _warn(message, category, filename, lineno, file=None, line=None):
    print(f"alssnn: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _parser():
    parser = new_parser(argparse.ArgumentParser, DESCRIPTION, EPILOG, prog="alssnn")
    parser.add_argument("--version", action="version", version=f"alssnn {__version__}")
    names = ",".join(module.__name__.rpartition("_")[2] for module in COMMANDS)
    commands = parser.add_subparsers(metavar=f"{{{names}}}", required=True)
    for module in COMMANDS:
        module.add(commands)
    return parser

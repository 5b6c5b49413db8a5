"""The parser of all commands, and how errors end."""

import argparse
import contextlib
import csv
import io
import json
import math
import os
import sys
import warnings
from pathlib import Path

import numpy as np

from .. import __version__
from . import (
    _compare,
    _completion,
    _control,
    _demo,
    _excite,
    _export,
    _fit,
    _info,
    _look,
    _plot,
    _report,
    _simulate,
    _validate,
)
from ._arguments import add_command, new_parser, with_numbers

COMMANDS = (
    _demo,
    _excite,
    _look,
    _fit,
    _info,
    _simulate,
    _compare,
    _validate,
    _plot,
    _report,
    _control,
    _export,
    _completion,
)
READER_GONE = 141  # what a shell gives for a program that a closed pipe ended

DESCRIPTION = """\
Identify nonlinear plants as models made for control: x+ = A x + B (u + h(x)) + g(x, u),
y = C x. The feedback u = v - h(x) cancels h; what is left from v to y is nearly linear.
"""

EPILOG = """\
examples:
  alssnn demo                                         the package in ten seconds
  alssnn excite multisine --input u -o excitation.csv  a signal to record with
  alssnn look plant.csv --input u --output y          what is in a record
  alssnn fit plant.csv --input u --output y           models of your own record
  alssnn fit plant.csv --input u --output y --model al --save plant.npz
  alssnn info plant.npz                               what the model is
  alssnn validate plant.npz --data plant.csv --last 0.5
  alssnn plot plant.npz --data plant.csv --last 0.5   what it misses, h and g
  alssnn report plant.npz --data plant.csv --last 0.5 -o report.html
  alssnn control plant.npz -o design
  alssnn export plant.npz --c firmware
  alssnn fit --help                                   all options of it

exit codes: 0 done; 1 a check or the computation failed; 2 wrong usage or data;
130 interrupted; 141 the reader of the output has gone
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
        0 done, 1 a check or the computation failed, 2 wrong data, 130 interrupted, 141
        the reader of the output has gone.

    Raises
    ------
    SystemExit
        By argparse: code 2 for wrong usage, 0 after --help and --version.
    """
    argv = with_numbers(sys.argv[1:] if argv is None else argv)
    args, unknown = _parser().parse_known_args(argv)
    if unknown:  # by the parser of the command, whose usage helps
        args.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        with warnings.catch_warnings():
            # one line each on the standard error, without the place in the code
            warnings.showwarning = _warn
            # records are read by the names of their columns, then they are arrays
            warnings.filterwarnings("ignore", "X does not have valid feature names")
            # with --json what is printed is not text
            shown = io.StringIO() if args.json else sys.stdout
            with contextlib.redirect_stdout(shown):
                code = args.run(args) or 0
        if args.json:
            print(json.dumps(plain({"exit_code": code, **(args.result or {})})))
        sys.stdout.flush()  # where a reader that has gone is noticed
        return code
    except KeyboardInterrupt:
        return _complain(130, "interrupted")
    except BrokenPipeError:
        # as `head` does; Python would complain when it closes the output
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return READER_GONE
    # a LinAlgError is a ValueError, but not the user's
    except (np.linalg.LinAlgError, RuntimeError, MemoryError, ImportError) as error:
        return _complain(1, str(error) or type(error).__name__)
    except OSError as error:
        named = error.filename is not None and error.strerror
        return _complain(2, f"{error.filename}: {error.strerror}" if named else error)
    except (ValueError, csv.Error) as error:
        return _complain(2, error)


def plain(value):
    """Return a value as JSON knows it: lists, numbers, and null for what is not finite.

    Parameters
    ----------
    value : object
        Arrays, numbers, paths, text, dicts and sequences of them.

    Returns
    -------
    value : object
        The same in other types.
    """
    if isinstance(value, dict):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, complex):
        return [plain(value.real), plain(value.imag)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def _complain(code, message):
    print(f"alssnn: error: {' '.join(str(message).split())}", file=sys.stderr)
    return code


def _warn(message, category, filename, lineno, file=None, line=None):
    print(f"alssnn: warning: {' '.join(str(message).split())}", file=sys.stderr)


def _parser():
    parser = new_parser(argparse.ArgumentParser, DESCRIPTION, EPILOG, prog="alssnn")
    parser.add_argument("--version", action="version", version=f"alssnn {__version__}")
    commands = parser.add_subparsers(
        title="commands", metavar="COMMAND", required=True, dest="command"
    )
    parser.set_defaults(commands=commands.choices)
    for module in COMMANDS:
        add_command(commands, module)
    return parser

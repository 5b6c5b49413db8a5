"""Parsers and options that the commands share."""

import argparse
import math
import re
from functools import partial
from pathlib import Path

# numbers that argparse takes for options
NEGATIVE = re.compile(
    r"-(\d+\.?\d*|\.\d+)e[-+]?\d+|-\d+\.|-(inf|infinity|nan)", re.IGNORECASE
)
FIGURE_FORMATS = (".png", ".pdf", ".svg")


def new_parser(make, description, epilog, **options):
    """Return a parser whose epilog is printed as it is.

    Parameters
    ----------
    make : callable
        What makes the parser.
    description : str
        First lines of the help.
    epilog : str
        Last lines of the help, with examples.
    **options : dict
        Further options.

    Returns
    -------
    parser : argparse.ArgumentParser
        The parser.
    """
    return make(
        description=description,
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        **options,
    )


def with_numbers(argv):
    """Return arguments of which numbers below zero are no options.

    Parameters
    ----------
    argv : sequence of str
        Arguments.

    Returns
    -------
    argv : list of str
        The same, with a blank before -1e-3 or -inf, which argparse would take for an
        option; a number may begin with one.
    """
    return [f" {text}" if NEGATIVE.fullmatch(text) else text for text in argv]


def add_command(commands, module):
    """Add the command of a module, and the options that every command has.

    Parameters
    ----------
    commands : argparse._SubParsersAction
        Where the command is added.
    module : module
        Its name is that of the command behind a ``_``. It has the line in the list of
        commands, HELP, first and last lines of the help, DESCRIPTION and EPILOG,
        ``add(parser)``, which adds its own options, and ``run(args)``, which returns
        the exit code, or None for 0.
    """
    name = module.__name__.rpartition("_")[2]
    make = partial(commands.add_parser, name, help=module.HELP)
    parser = new_parser(make, module.DESCRIPTION, module.EPILOG)
    parser.set_defaults(run=module.run, parser=parser, result=None)
    parser.add_argument(
        "-q", "--quiet", action="store_true", help="do not report progress"
    )
    parser.add_argument(
        "--json",
        action="store_true",
        help="print numbers for another program instead of text for you",
    )
    module.add(parser)


def add_seed(parser):
    """Add the seed of commands that draw random numbers.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    """
    parser.add_argument(
        "--seed",
        type=count_or_zero,
        default=0,
        metavar="N",
        help="seed of everything random (default: %(default)s)",
    )


def _checked(text, kind, holds, convert=float):
    """Return a number for which a condition holds, or say which kind was wanted."""
    try:
        value = convert(text)
    except ValueError:
        value = math.nan
    if not holds(value):
        raise argparse.ArgumentTypeError(f"must be {kind}, got {text}")
    return value


def count(text):
    """Return a positive integer.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : int
        The integer.
    """
    return _checked(text, "an integer of at least 1", lambda n: n >= 1, int)


def count_or_zero(text):
    """Return a nonnegative integer.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : int
        The integer.
    """
    return _checked(text, "an integer of at least 0", lambda n: n >= 0, int)


def order(text):
    """Return a number of states, several of them, or auto.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : int, range or str
        The number of states, or those of "2-5".
    """
    if text == "auto":
        return text
    first, dash, last = text.partition("-")
    if not (first and dash):
        return count(text)
    if (low := count(first)) > (high := count(last)):
        raise argparse.ArgumentTypeError(f"must be a range that ascends, got {text}")
    return range(low, high + 1)


def delay(text):
    """Return a number of samples, or auto.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : int or str
        The number.
    """
    return text if text == "auto" else count_or_zero(text)


def finite(text):
    """Return a finite number.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : float
        The number.
    """
    return _checked(text, "a number", math.isfinite)


def positive(text):
    """Return a positive number.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : float
        The number.
    """
    return _checked(text, "a positive number", lambda value: 0 < value < math.inf)


def weight(text):
    """Return a nonnegative number.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : float
        The number.
    """
    return _checked(text, "a number of at least 0", lambda value: 0 <= value < math.inf)


def weight_or_auto(text):
    """Return a nonnegative number, or auto.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : float or str
        The number.
    """
    return text if text == "auto" else weight(text)


def fraction(text):
    """Return a share, above zero and at most one.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    value : float
        The share.
    """
    return _checked(text, "a share above 0 and at most 1", lambda value: 0 < value <= 1)


def figure_name(text):
    """Return the path of a figure.

    Parameters
    ----------
    text : str
        Text.

    Returns
    -------
    path : Path
        The path.
    """
    path = Path(text)
    if path.suffix.lower() not in FIGURE_FORMATS:
        raise argparse.ArgumentTypeError(
            f"must end in {', '.join(FIGURE_FORMATS)}, got {text}"
        )
    return path


def add_figure(parser, what="write a figure", default=None):
    """Add the option that names a figure.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    what : str, default="write a figure"
        What it does, for the help.
    default : Path or None, default=None
        Its default.
    """
    note = "" if default is None else " (default: %(default)s)"
    parser.add_argument(
        "--figure",
        type=figure_name,
        default=default,
        metavar="FILE",
        help=f"{what}: .png, .pdf or .svg{note}",
    )


def add_output(parser, metavar, what, default=None, kind=Path):
    """Add the option that names what is written.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    metavar : str
        Kind of file, for the help.
    what : str
        What it is, in a few words.
    default : Path or None, default=None
        File if none is named.
    kind : callable, default=Path
        Makes the path of its text.
    """
    note = "" if default is None else " (default: %(default)s)"
    if metavar.startswith("FILE"):
        add_overwrite(parser)
    parser.add_argument(
        "-o",
        dest="output_file",
        type=kind,
        default=default,
        metavar=metavar,
        help=what + note,
    )


def add_overwrite(parser):
    """Add the option that allows a file to be replaced.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    """
    parser.add_argument(
        "--overwrite",
        action="store_true",
        help="replace a file that exists",
    )


def refuse_existing(args, path):
    """Refuse to replace a file, before a computation that may take long.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of a command with ``--overwrite``.
    path : Path or None
        What is to be written; its folder is made if missing.

    Raises
    ------
    ValueError
        If it exists and ``--overwrite`` was not given.
    """
    if path is None:
        return
    if path.exists() and not args.overwrite:
        raise ValueError(
            f"`{path}` must not exist yet. Name another file, or replace it by "
            "--overwrite."
        )
    path.parent.mkdir(parents=True, exist_ok=True)


def add_limits(parser):
    """Add the options that limit the inputs.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command.
    """
    for flag, what in (("--u-min", "lower"), ("--u-max", "upper")):
        parser.add_argument(
            flag,
            nargs="+",
            type=finite,
            metavar="U",
            help=f"{what} limits of the inputs: one, or one per input",
        )


def add_law(parser):
    """Add the options that say which law is judged.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of a command; its results are arguments of `validate` and `report`.
    """
    parser.add_argument(
        "--law-dt",
        type=weight,
        metavar="SECONDS",
        help="sampling time at which the law will run, of a model in continuous time "
        "(default: that of the record)",
    )
    parser.add_argument(
        "--ahead",
        action="store_true",
        help="judge the law that looks half a sample ahead",
    )


def scalar(values):
    """Return limits as a number where there is one.

    Parameters
    ----------
    values : list of float or None
        What the user gave.

    Returns
    -------
    value : float, list of float or None
        The limits.
    """
    return values[0] if values is not None and len(values) == 1 else values

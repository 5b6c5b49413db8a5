"""`alssnn validate`: whether a model deserves trust."""

from ._arguments import add_law, add_output, count, refuse_existing
from ._record import add_data, add_model, read_record, write_csv

HELP = "check a saved model on a record; exit code 1 if it fails"
DESCRIPTION = "Check a saved model on a record that it was not trained on."
EPILOG = """\
The record should not have trained the model: --last 0.5 takes the half that `fit` kept
for testing, or name another file. The exit code is 0 if all checks passed that decide,
1 if one failed or is open, as on a very short record: a shell script can ask for it.

examples:
  alssnn validate plant.npz --data plant.csv --last 0.5
  alssnn validate plant.npz --data monday.csv --input u --output y -o checks.csv
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    add_model(parser)
    add_data(parser)
    parser.add_argument(
        "--lags",
        type=count,
        metavar="N",
        help="lags of the tests of residuals (default: 25, fewer on a short record)",
    )
    add_law(parser)
    add_output(parser, "FILE.csv", "write the checks as a table")


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.

    Returns
    -------
    code : int
        0 if the checks passed, else 1.
    """
    from ..estimators import load

    refuse_existing(args, args.output_file)
    model = load(args.model)
    record, _ = read_record(args, model)
    validation = model.validate(
        *record, n_lags=args.lags or "auto", law_dt=args.law_dt, ahead=args.ahead
    )
    print(validation)
    columns = ("name", "passed", "decides", "value", "quantity", "sentence")
    args.result = {
        "passed": validation.passed,
        "verdict": validation.verdict,
        "checks": [
            {name: getattr(check, name) for name in (*columns, "outcome")}
            for check in validation
        ],
        "file": args.output_file,
    }
    if args.output_file is not None:
        rows = [[getattr(check, name) for name in columns] for check in validation]
        write_csv(args.output_file, columns, rows)
    return 0 if validation.passed else 1

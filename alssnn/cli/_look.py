"""`alssnn look`: a record in words, before anything is fitted."""

from ._arguments import count
from ._record import add_columns, add_file, add_sampling, sampling_time, source_of

HELP = "say what is in a record before a fit"
DESCRIPTION = "Say what is in a record: gaps, spikes, delays, nonlinearity, accuracy."
EPILOG = """\
An exclamation mark stands where something is to be done, or to be known. With --period
the record is periodic, and its noise and its nonlinear part are told apart.

examples:
  alssnn look plant.csv --input u --output y --dt 0.05
  alssnn look plant.csv --input u --output y --dt 0.05 --experiment experiment \\
      --period 1024
"""


def add(parser):
    """Add the options.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Parser of the command.
    """
    add_file(parser)
    add_columns(parser, "columns of {}", required=True)
    add_sampling(parser)
    parser.add_argument(
        "--period", type=count, metavar="N", help="samples of a period, if periodic"
    )


def run(args):
    """Run the command.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    """
    from ..first_look import look
    from ..tables import read_csv

    source = source_of(args.file)
    u, y, experiment = read_csv(source, args.input, args.output, args.experiment)
    dt = sampling_time(args, source)
    u, y = _Named(u, args.input), _Named(y, args.output)
    page = look(u, y, experiment, dt=dt, period=args.period)
    print(page)
    wanted = page.recommendation
    args.result = {
        "findings": [vars(finding) for finding in page],
        "recommendation": {
            "estimator": wanted.estimator.__name__ if wanted else None,
            "options": wanted.options,
            "reason": wanted.reason,
        },
    }


class _Named:
    """Hold signals with the names of their columns, as a data frame does."""

    def __init__(self, values, columns):
        self.values, self.columns = values, columns
        self.shape, self.ndim = values.shape, values.ndim

    def __len__(self):
        """Return the number of samples."""
        return len(self.values)

    def __array__(self, dtype=None, copy=None):
        """Return all samples."""
        return self.values if dtype is None else self.values.astype(dtype)

"""Fit a ladder of models, and print what came of it."""

import contextlib
import sys
from importlib.util import find_spec

FIGURE_DPI = 150
TEXT_WIDTH = 79  # columns


def prepare_figure(path):
    """Make the folder of a figure, before a computation that may take long.

    Parameters
    ----------
    path : Path or None
        The figure; None if there will be none.
    """
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)


def run_ladder(args, u, y, **options):
    """Return the ladder, its progress on the standard error.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments of the command.
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N, ny)
        Outputs.
    **options : dict
        Further options.

    Returns
    -------
    ladder : Ladder
        The ladder.
    """
    # the search takes seconds to import, which --help should not
    from ..ladder import model_ladder

    verbose: int | str = 0 if args.quiet else 1
    if verbose and sys.stderr.isatty() and find_spec("tqdm"):
        verbose = "bar"
    # the estimators report to the standard output, which is for the result here
    with contextlib.redirect_stdout(sys.stderr):
        return model_ladder(u, y, random_state=args.seed, verbose=verbose, **options)


def report(ladder, figure, **labels):
    """Print the table and what it means, and draw the figure if there is one.

    Parameters
    ----------
    ladder : Ladder
        Fitted models.
    figure : Path or None
        Figure to write.
    **labels : dict
        Options of `plotting.plot_ladder`.
    """
    print(f"{ladder}\n")
    explanation = ladder.explain()
    if explanation:
        print(explanation)
    if figure is not None:
        # matplotlib takes a while: only for those who want a figure
        from ..plotting import plot_ladder

        axes = plot_ladder(ladder, **labels)
        axes[0].figure.savefig(figure, dpi=FIGURE_DPI)
        print(f"\nFigure: {figure}")


def row_numbers(row):
    """Return the figures of a row, for ``--json``.

    Parameters
    ----------
    row : Rung
        Row of a ladder.

    Returns
    -------
    numbers : dict
        The figures by name.
    """
    names = (
        "name",
        "n_params",
        "rmse_train",
        "rmse_test",
        "fit_percent",
        "linearization_error",
        "closed_linearization_error",
        "spectral_radius",
        "seconds",
        "converged",
    )
    return {name: getattr(row, name) for name in names} | {"nx": row.model.nx_}

"""Options of `alssnn fit`: which record, which models, and how they are trained."""

from pathlib import Path

from ._arguments import (
    count,
    count_or_zero,
    delay,
    order,
    positive,
    weight,
    weight_or_auto,
)
from ._record import add_columns, add_file, add_sampling

# Said again here, for --help would take seconds to import them from where they belong.
MODELS = ("lti", "fl", "al", "al-paper", "gr")  # the keys of `ladder.PRESETS`
FOUR = ("lti", "fl", "al", "gr")  # `ladder.LADDER`
HOLDS = ("zoh", "linear", "cubic")  # those of `continuous`


def add_data(data):
    """Add the options that say what is read, and how much of it tests.

    Parameters
    ----------
    data : argparse._ArgumentGroup
        Group of the parser.
    """
    add_file(data)
    add_columns(data, required=True)
    data.add_argument(
        "--disturbance",
        nargs="+",
        default=[],
        metavar="COL",
        help="columns of further inputs that are measured but no controller moves",
    )
    add_sampling(data)
    data.add_argument(
        "--test-size",
        type=float,
        metavar="SHARE",
        help="last part of every experiment, kept for testing (default: 0.5)",
    )
    data.add_argument(
        "--test",
        type=Path,
        metavar="FILE.csv",
        help="another record with the same columns to test on; FILE.csv trains whole",
    )


def add_models(model):
    """Add the options that say which models are fitted, and of what size.

    Parameters
    ----------
    model : argparse._ArgumentGroup
        Group of the parser.
    """
    which = model.add_mutually_exclusive_group()
    which.add_argument(
        "--models",
        nargs="+",
        choices=list(MODELS),
        help=f"models to compare (default: {' '.join(FOUR)})",
    )
    which.add_argument(
        "--model",
        choices=[*MODELS, "ladder"],
        default="ladder",
        help="the one model to fit, or the ladder of four (default: %(default)s); "
        "al-paper is al with h(y), a penalty on |g|^2, and A free",
    )
    model.add_argument(
        "--nx",
        type=order,
        default="auto",
        metavar="N",
        help="number of states, a range such as 2-5, or auto: chosen by hidden samples "
        "(default: %(default)s)",
    )
    for net, default in (("h", 10), ("g", 10), ("f", 15)):
        model.add_argument(
            f"--n-{net}",
            type=count_or_zero,
            default=default,
            metavar="N",
            help=f"hidden neurons of {net} (default: %(default)s)",
        )


def add_weights(model):
    """Add the options that weigh what a fit would rather do without.

    Parameters
    ----------
    model : argparse._ArgumentGroup
        Group of the parser.
    """
    model.add_argument(
        "--gamma",
        type=weight,
        metavar="WEIGHT",
        help="weight of the residual g in AL-SSNN, outputs scaled to unit "
        "variance; larger is more linear and less accurate (default: 0.01, and 1 for "
        "al-paper)",
    )
    model.add_argument(
        "--gamma-h",
        type=weight,
        metavar="WEIGHT",
        help="weight of |h|^2; larger keeps u closer to v and the loop inside the "
        "data (default: 0)",
    )
    model.add_argument(
        "--alpha",
        type=weight_or_auto,
        default="auto",
        metavar="WEIGHT",
        help="weight of the squared network parameters; auto chooses it, and returns "
        "the linear model where networks do not help (default: %(default)s)",
    )


def add_form(model):
    """Add the options that say what the equations are, and what their noise.

    Parameters
    ----------
    model : argparse._ArgumentGroup
        Group of the parser.
    """
    model.add_argument(
        "--stability",
        choices=["auto", "contractive", "none"],
        default="auto",
        help="whether A is a contraction (default: %(default)s: all models are trained "
        "so but al-paper)",
    )
    model.add_argument(
        "--linear-part",
        choices=["best", "trained"],
        help="best: without g, A is the best linear fit; with g, the loop is brought "
        "nearer to the data if it is far from them. trained: as the training has left "
        "it (default: best, trained for al-paper)",
    )
    model.add_argument(
        "--feedback",
        choices=["state", "output"],
        help="what h sees (default: state, output for al-paper)",
    )
    model.add_argument(
        "--odd",
        action="store_true",
        help="networks with h(-s) = -h(s): for plants that are symmetric about their "
        "operating point",
    )
    model.add_argument(
        "--operating-point",
        choices=["mean", "zero"],
        help="where the model rests: the mean of the record, or u = 0, y = 0 (default: "
        "mean)",
    )
    model.add_argument(
        "--initial-state",
        choices=["estimate", "rest"],
        help="state at the first sample of every experiment: fitted, or at rest at the "
        "operating point (default: estimate)",
    )
    model.add_argument(
        "--input-delay",
        nargs="+",
        type=delay,
        metavar="N",
        help="samples by which inputs arrive late, one for all or one each, or auto "
        "(default: 0)",
    )
    model.add_argument(
        "--input-map",
        choices=["identity", "monotone"],
        default="identity",
        help="what the linear part of FL-SSNN and AL-SSNN answers to: u + h, or a map "
        "that increases with u, for valves, fans and gains that depend on the state "
        "(default: %(default)s)",
    )
    model.add_argument(
        "--innovations",
        action="store_true",
        help="fit the errors one sample ahead instead of a simulation: for a record of "
        "a loop, and for noise that goes through the plant",
    )


def add_time(model):
    """Add the options of models in continuous time.

    Parameters
    ----------
    model : argparse._ArgumentGroup
        Group of the parser.
    """
    model.add_argument(
        "--continuous",
        action="store_true",
        help="fit equations of derivatives: one model for every sampling time",
    )
    model.add_argument(
        "--hold",
        choices=HOLDS,
        help="with --continuous, what the inputs do between samples: zoh if a computer "
        "set them (default), linear or cubic if they were measured",
    )


def add_effort(model):
    """Add the options that say how long a training searches.

    Parameters
    ----------
    model : argparse._ArgumentGroup
        Group of the parser.
    """
    model.add_argument(
        "--drift",
        choices=["output", "input"],
        help="with --innovations, a random walk that nobody measured, added to the "
        "outputs or to the inputs: a sensor or a load that drifts",
    )
    model.add_argument(
        "--horizon",
        type=count,
        default=1,
        metavar="K",
        help="with --innovations, samples over which predictions are trained "
        "(default: %(default)s)",
    )
    model.add_argument(
        "--max-iter",
        type=count,
        metavar="N",
        help="largest number of trial steps of the training of every model, without "
        "the search for alpha and the stages on all samples of a record of more than "
        "8000 (default: 300, 100 for lti)",
    )
    model.add_argument(
        "--max-time",
        type=positive,
        metavar="S",
        help="seconds after which the training of a model ends, with the best that it "
        "has found",
    )
    model.add_argument(
        "--n-init",
        type=count,
        metavar="N",
        help="random starts of every network (default: 3)",
    )

"""The options of models that are set by hand: nothing is searched.

The tables of most benchmarks are older than the search for order, start and decay
(`alssnn.search`), or compare options one by one.  They start from these values, so that
a change of the defaults does not change what they measure; `benchmarks.field` measures
the defaults.
"""

from alssnn import AlSsnn, FlSsnn, GrSsnn

TRAINING = {
    "alpha": 0.0,
    "n_init": 1,
    "stability": None,
    "phi": 0.01,
    "tol": 1e-6,
    "coarse_samples": 15_000,
}
NETS = {"feedback": "output", "linear_part": "trained", **TRAINING}
OPTIONS = {
    FlSsnn: NETS,
    AlSsnn: {"penalty": "state", "gamma": 1.0, **NETS},
    GrSsnn: TRAINING,
}


def by_hand(cls, *sizes, **options):
    """Return an unfitted model.

    Parameters
    ----------
    cls : type
        `AlSsnn`, `FlSsnn` or `GrSsnn`.
    *sizes : int
        First arguments of the class: order, and hidden neurons.
    **options : dict
        Options that differ from `OPTIONS`.

    Returns
    -------
    model : AlSsnn, FlSsnn or GrSsnn
        The model.
    """
    return cls(*sizes, **{**OPTIONS[cls], **options})

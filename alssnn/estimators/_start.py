"""Linear starts and bounds that the user gives, between his units and those of the fit.

A linear start fixes the basis of the states: its entries may mean something, so that
they can be held or bounded.  Inside the fit its states are scaled to unit variance.
"""

import math

import numpy as np

from ..given_system import LINEAR, GivenSystem
from ..linear_model import LinearModel, normalize
from ._checks import order_choices
from ._integrators import check_given_integrators, identified_linear
from ._judge import reproducing
from ._noise import is_predicting

BOUNDED = (*LINEAR, "G", "H")  # what the user may hold


def portable(options):
    """Return options as what can be pickled.

    Parameters
    ----------
    options : dict
        Options by name, or a state that has them.

    Returns
    -------
    options : dict
        The same; but a linear start of python-control, which cannot, as its matrices,
        and of what tells a noise floor the numbers.
    """
    options = dict(options)
    start, floor = options.get("linear_start"), options.get("noise_floor")
    if all(hasattr(start, name) for name in (*LINEAR, "dt")):
        options["linear_start"] = GivenSystem.of(start)
    if floor is not None:
        options["noise_floor"] = getattr(floor, "noise_rms", floor)
    return options


def linear_start(estimator, experiments, watch):
    """Return the linear model from which a fit starts, given or identified.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array
        Scaled experiments.
    watch : Watch
        What follows the fit.

    Returns
    -------
    model : LinearModel
        The model in scaled deviations.
    x_scale : ndarray of shape (nx,)
        States of the user over those of the model.

    Raises
    ------
    ValueError
        If the model that the user gives does not fit.
    """
    if estimator.linear_start is None:
        model = identified_linear(estimator, experiments, watch)
        if estimator.integrators_ == 0 and not is_predicting(estimator):
            model = reproducing(estimator, model, experiments)
        return model, np.ones(len(model.A))
    model, x_scale = given_model(
        estimator.linear_start,
        estimator._scaling,
        experiments,
        estimator.dt,
        getattr(estimator, "feedthrough", False),
        (getattr(estimator, "feature_names_in_", None), estimator.output_names_),
    )
    choices = order_choices(estimator.nx)
    if choices is not None and len(model.A) not in choices:
        raise ValueError(
            "`nx` must be 'auto' or the order of `linear_start`, "
            f"{len(model.A)}, got {estimator.nx}."
        )
    check_given_integrators(estimator, model.A, len(model.C))
    return model, x_scale


def given_model(start, scaling, experiments, dt, feedthrough, names=(None, None)):
    """Return the linear model that the user starts from.

    Parameters
    ----------
    start : tuple of array_like, control.StateSpace or estimator
        Matrices (A, B, C) or (A, B, C, D) in the user's units, or what has them.
    scaling : Scaling
        Units of the fit.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    dt : float
        Sampling time, in seconds.
    feedthrough : bool
        Whether D is free; else it must be zero.
    names : tuple of (sequence of str or None), default=(None, None)
        Names of inputs and outputs of the record.

    Returns
    -------
    model : LinearModel
        The model in scaled deviations, states of unit variance.
    x_scale : ndarray of shape (nx,)
        States of the user over those of the model.

    Raises
    ------
    ValueError
        If the sizes do not fit, the system is not of this sampling time, it has the
        signals of the record in another order, or a feedthrough that the model lacks.
    """
    given = GivenSystem.of(start)
    # dt=True of python-control: discrete, of unknown sampling time
    if given.dt is not True and not math.isclose(
        float(given.dt or 0), dt, rel_tol=1e-6
    ):
        raise ValueError(
            f"`linear_start` must have the sampling time dt={dt}, got {given.dt}. Use "
            "`control.sample_system` for another one, or for continuous time."
        )
    _check_names(given, names)
    A, B, C, D = (getattr(given, name) for name in LINEAR)
    nu, ny = (signal.shape[1] for signal in experiments[0])
    nx = len(A)
    shapes = {"A": (nx, nx), "B": (nx, nu), "C": (ny, nx), "D": (ny, nu)}
    for name, value in zip(LINEAR, (A, B, C, D), strict=True):
        if value.shape != shapes[name] or not np.isfinite(value).all():
            raise ValueError(
                f"`linear_start` must have a finite {name} of shape {shapes[name]}, "
                f"got shape {value.shape}"
                f"{'' if np.isfinite(value).all() else ' with nan or infinity'}."
            )
    if np.any(D) and not feedthrough:
        raise ValueError(
            "`linear_start` must have D = 0 for a model without feedthrough. Set "
            "feedthrough=True."
        )
    x0 = np.zeros((len(experiments), nx))
    scaled = LinearModel(
        A,
        B * scaling.u_scale,
        C / scaling.y_scale[:, None],
        D * scaling.u_scale / scaling.y_scale[:, None],
        x0,
        feedthrough,
    )
    return normalize(scaled, experiments)


def _check_names(given, names):
    """Refuse a system that has the signals of the record in another order."""
    for kind, its, ours in zip(
        ("inputs", "outputs"), (given.inputs, given.outputs), names, strict=True
    ):
        if its is None or ours is None or list(its) == [str(name) for name in ours]:
            continue
        if set(its) == {str(name) for name in ours}:
            raise ValueError(
                f"`linear_start` must have its {kind} in the order of the record, "
                f"{', '.join(map(str, ours))}, got {', '.join(its)}. Bring its columns "
                "or rows, and `bounds` of them, into this order."
            )


def check_bounds(bounds, structure, units, *, own_basis, contractive):
    """Return bounds in the units of the fit.

    Parameters
    ----------
    bounds : dict of str to tuple of array_like, or None
        Lower and upper bounds of A, B, C, D, G or H, in the user's units.
    structure : Structure
        Structure of the model.
    units : dict of str to ndarray
        The user's units over those of the fit, by axis.
    own_basis : bool
        Whether the states are those of a linear start of the user.
    contractive : bool
        Whether A is a contraction by construction.

    Returns
    -------
    bounds : dict of str to tuple of ndarray
        Bounds of scaled parameters; empty without bounds.

    Raises
    ------
    ValueError
        If a name is unknown or not free, bounds have no meaning without a basis, or
        they cross.
    """
    inverse = {axis: 1.0 / scale for axis, scale in units.items()}
    checked = {}
    for name, pair in (bounds or {}).items():
        free = [n for n in BOUNDED if n in structure.parameters]
        if name not in free:
            raise ValueError(
                f"`bounds` must be for {', '.join(free)}, the free matrices of this "
                f"model, got {name!r}."
            )
        if name not in ("D", "H") and (not own_basis or contractive):
            raise ValueError(
                f"`bounds` for {name!r} need a basis of the states that stays what it "
                "is: give `linear_start`, and no stability='contractive'."
            )
        low, high = _pair(name, pair, structure.shapes[name])
        checked[name] = tuple(
            structure.rescale({name: b}, inverse)[name] for b in (low, high)
        )
    return checked


def _pair(name, pair, shape):
    """Return lower and upper bounds of a matrix."""
    try:
        low, high = (np.broadcast_to(np.asarray(b, dtype=float), shape) for b in pair)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"`bounds` of {name} must be a pair (low, high) of numbers or of arrays of "
            f"shape {shape}, got {pair!r}. Use -inf and inf for free entries."
        ) from error
    if not np.all(low <= high) or np.any(low == np.inf) or np.any(high == -np.inf):
        raise ValueError(
            f"`bounds` of {name} must be numbers with low <= high, got {pair!r}. "
            "Exchange them, and use -inf and inf for free entries."
        )
    return low, high

"""Integrators of a fit: how many there are, and what of A they hold."""

from dataclasses import replace
from numbers import Integral

import numpy as np

from ..drift import identify
from ..given_system import GivenSystem
from ..integrators import (
    GAIN,
    count_integrators,
    identify_integrating,
    integrator_entries,
)
from ..linear_model import simulation_error
from ..mapping import Held
from ..orders import SAMPLES as ORDER_SAMPLES
from ..orders import compare_orders
from ._checks import order_choices
from ._noise import is_predicting, predicted

AUTO = "auto"


def find_integrators(estimator, experiments, watch):
    """Set `integrators_`; tell whether the operating point moved to their rest.

    What is identified on the way is kept for `identified_linear`.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.
    watch : Watch
        What follows the fit.

    Returns
    -------
    moved : bool
        Whether the operating point moved to their rest.
    """
    is_auto = estimator.integrators == AUTO
    estimator.integrators_ = 0 if is_auto else int(estimator.integrators)
    # the states of a linear start are the user's: nothing to find, or to move
    known = estimator.linear_start is not None or is_predicting(estimator)
    if estimator.integrators == 0 or known:
        return False
    near = estimator._near(Held.of(experiments))
    model = plain_linear(estimator, near, estimator.nx, watch)
    if is_auto:
        estimator.integrators_ = count_integrators(near, model)
    n, ny = estimator.integrators_, len(model.C)
    if isinstance(estimator.nx, str) and len(model.A) <= n <= ny:
        model = plain_linear(estimator, near, n + 1, watch)
    check_count(estimator, len(model.A), ny)
    if n == 0:
        estimator._identified = model
        return False
    moves = estimator.operating_point == "mean" and not estimator._at_rest
    found = identify_integrating(
        near, model, n, offset=moves, watch=watch, **estimator._refinement()
    )
    # of what was found: nobody is to begin with a worse model for it, but two slow
    # poles that follow a record slightly better are no reason against it
    bound = (1 + GAIN) * simulation_error(near, model)
    if is_auto and np.sqrt(found.model.result.cost) > bound:
        estimator.integrators_, estimator._identified = 0, model
        return False
    estimator._identified = found.model
    scaling = estimator._scaling
    estimator._scaling = replace(
        scaling,
        u_offset=scaling.u_offset - scaling.u_scale * found.u_shift,
        y_offset=scaling.y_offset + scaling.y_scale * found.y_shift,
    )
    return moves


def plain_linear(estimator, experiments, nx, watch):
    """Return the linear model without integrators.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.
    nx : int, str or sequence of int
        Order, or the choice of it.
    watch : Watch
        What follows the fit.

    Returns
    -------
    model : LinearModel
        The model.
    """
    if not isinstance(nx, Integral):
        estimator._orders = compare_orders(
            Held.of(experiments).stretch(ORDER_SAMPLES),
            order_choices(nx),
            feedthrough=getattr(estimator, "feedthrough", False),
            watch=watch,
            **predicted(estimator, experiments),
        )
        nx = estimator._orders.nx
    return identify(
        experiments,
        nx,
        feedthrough=getattr(estimator, "feedthrough", False),
        watch=watch,
        **predicted(estimator, experiments),
        **estimator._refinement(),
    )


def identified_linear(estimator, experiments, watch):
    """Return the linear model of scaled experiments, integrators included.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    experiments : sequence of tuple of array, Held or Remote
        Scaled experiments.
    watch : Watch
        What follows the fit.

    Returns
    -------
    model : LinearModel
        The model.
    """
    found = vars(estimator).pop("_identified", None)
    if found is None:
        found = plain_linear(estimator, experiments, estimator.nx, watch)
        if estimator.integrators_:  # a warm start that the model does not fit
            check_count(estimator, len(found.A), len(found.C))
            found = identify_integrating(
                experiments, found, estimator.integrators_, offset=False, watch=watch
            ).model
    return found


def check_count(estimator, nx, ny):
    """Refuse more integrators than states or outputs.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    nx : int, str or sequence of int
        Order, or the choice of it.
    ny : int
        Number of outputs.

    Raises
    ------
    ValueError
        If there are.
    """
    if estimator.integrators_ > min(nx, ny):
        raise ValueError(
            f"`integrators` must be at most the number of states ({nx}) and of "
            f"outputs ({ny}), got {estimator.integrators}. Increase `nx`, or take one "
            "per output that integrates."
        )


def check_given_integrators(estimator, A, ny):
    """Refuse a linear start that does not have its integrators last.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    A : ndarray of shape (nx, nx)
        State matrix.
    ny : int
        Number of outputs.

    Raises
    ------
    ValueError
        If they do not.
    """
    n = estimator.integrators_
    check_count(estimator, len(A), ny)
    if n and np.any(A[:, len(A) - n :] != np.eye(len(A))[:, len(A) - n :]):
        raise ValueError(
            f"`linear_start` must have its {n} integrators last, as columns of A "
            "that are zero but for a one on the diagonal, got "
            f"{A[:, len(A) - n :].tolist()}. Change the basis of its states."
        )


def with_integrators(estimator, bounds, structure):
    """Return bounds that hold the rows and columns of integrators in A as well.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    bounds : dict of str to tuple of ndarray
        Bounds of scaled parameters.
    structure : Structure
        Structure of the model.

    Returns
    -------
    bounds : dict of str to tuple of ndarray
        Bounds with those of A.
    """
    n = estimator.integrators_
    if n == 0 or "A" not in structure.parameters:
        return bounds
    nx = structure.sizes["x"]
    held, value = integrator_entries(nx, n), np.eye(nx)
    if estimator.linear_start is not None and keeps_start(estimator):
        scale = np.broadcast_to(estimator._x_scale, nx)
        A = GivenSystem.of(estimator.linear_start).A * scale / scale[:, None]
        value[nx - n :, : nx - n] = A[nx - n :, : nx - n]
    low, high = bounds.get("A", (np.full_like(value, -np.inf),) * 2)
    if "A" not in bounds:
        high = -low
    elif np.any((value < low) | (value > high), where=held):
        raise ValueError(
            "`bounds` of A must allow the zeros and ones of integrators in the "
            f"last {n} columns, and their rows as they are in `linear_start`, got "
            "others. Use -inf and inf there."
        )
    fixed = tuple(np.where(held, value, bound) for bound in (low, high))
    return {**bounds, "A": fixed}


def keeps_start(estimator):
    """Whether the states are those of the linear start.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.

    Returns
    -------
    keeps : bool
        False where the training takes a basis of its own.
    """
    return estimator._phi is None


def regular(estimator, A):
    """Return the block of A without integrators.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.
    A : ndarray of shape (nx, nx)
        State matrix.

    Returns
    -------
    A : ndarray
        Its block.
    """
    n = len(A) - estimator.integrators_
    return A[:n, :n]


def note(estimator):
    """Return what is to be said of integrators that were found.

    Parameters
    ----------
    estimator : StateSpaceModel
        Estimator in its fit.

    Returns
    -------
    note : str
        What `message_` says of them.
    """
    if estimator.integrators != AUTO or not estimator.integrators_:
        return ""
    n = estimator.integrators_
    what = "an integrator, its pole" if n == 1 else f"{n} integrators, their poles"
    pole = 0 if estimator.time == "continuous" else 1  # of s, or of z
    return f"; the record shows {what} held at {pole}"

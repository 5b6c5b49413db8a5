"""Options whose validity depends on the data, or on each other."""

import numpy as np

from ..delays import estimate_delays

DELAY_SAMPLES = 20_000  # of experiments on a cluster, that tell of their delays


def order_choices(nx):
    """Return the orders that the user allows.

    Parameters
    ----------
    nx : int, str or array_like of int
        The option.

    Returns
    -------
    orders : list of int or None
        The orders; None where all are.

    Raises
    ------
    ValueError
        If it names no orders.
    """
    if isinstance(nx, str):
        return None
    orders = np.atleast_1d(nx)
    valid = orders.ndim == 1 and np.issubdtype(orders.dtype, np.integer)
    if not valid or orders.size == 0 or orders.min() < 1:
        raise ValueError(
            "`nx` must be 'auto', a positive integer or several of them, got "
            f"{nx!r}. Give the orders to compare, such as range(1, 5)."
        )
    return sorted({int(n) for n in orders})


def input_delays(option, experiments, nu, *, nx, feedthrough):
    """Return the delay of every input, given or found.

    Parameters
    ----------
    option : int, array_like of int or "auto"
        The option `input_delay`.
    experiments : Held or Remote
        Scaled experiments, without delays.
    nu : int
        Number of inputs.
    nx : int, str or array_like of int
        The option `nx`.
    feedthrough : bool
        Whether D is free.

    Returns
    -------
    delay : ndarray of int of shape (nu,)
        Samples by which every input arrives late.

    Raises
    ------
    ValueError
        If the option does not fit the inputs, or the experiments.
    """
    if isinstance(option, str):
        here = experiments.is_here
        near = list(experiments) if here else experiments.stretch(DELAY_SAMPLES)
        orders = order_choices(nx) or "auto"
        return estimate_delays(near, orders, feedthrough=feedthrough)
    delay = np.asarray(option)
    shortest = min(experiments.lengths)
    if (
        delay.shape not in [(), (nu,)]
        or not np.issubdtype(delay.dtype, np.integer)
        or delay.min() < 0
        or delay.max() >= shortest
    ):
        raise ValueError(
            f"`input_delay` must be 'auto' or one integer per input ({nu}) between "
            f"0 and the length of the shortest experiment ({shortest}), got "
            f"{option!r}. It counts samples."
        )
    return np.broadcast_to(delay, nu).copy()


def output_weights(option, ny):
    """Return the weight of every output.

    Parameters
    ----------
    option : array_like of shape (ny,) or None
        The option `output_weight`.
    ny : int
        Number of outputs.

    Returns
    -------
    weight : ndarray of shape (ny,)
        Weights.

    Raises
    ------
    ValueError
        If the option is not one nonnegative number per output.
    """
    if option is None:
        return np.ones(ny)
    weight = np.asarray(option, dtype=float)
    valid = np.isfinite(weight) & (weight >= 0)
    if weight.shape != (ny,) or not valid.all() or not weight.any():
        raise ValueError(
            f"`output_weight` must be one nonnegative number per output ({ny}), "
            f"not all zero, got {option!r}. Errors are weighed "
            "relative to the standard deviation of their output."
        )
    return weight

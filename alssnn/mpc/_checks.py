"""Checks of what the user gives a predictive controller."""

import numpy as np

from ..checks import as_numbers, check_type
from ..experiments import last_measured
from ..feedback import DisturbanceObserver, Observer
from ..feedback.checks import check_disturbances, check_limits


def check_ahead(name, value, horizon, n, last):
    """Return what is known of samples ahead, one row or one per sample of the horizon.

    One that is not finite is that of the sample before.

    Parameters
    ----------
    name : str
        Name of the argument: references, or measured disturbances.
    value : array_like of shape (n,) or (horizon, n)
        Values; a number if there is one signal.
    horizon : int
        Number of samples of the horizon.
    n : int
        Number of signals.
    last : ndarray of shape (n,)
        Value of the last step.

    Returns
    -------
    rows : ndarray of shape (1, n) or (horizon, n)
        The values.

    Raises
    ------
    ValueError
        If the shape is wrong.
    """
    r = as_numbers(name, value)
    shape = r.shape
    if r.ndim == 0 and n == 1:
        r = r.reshape(1)
    if r.shape == (n,):
        r = r[None]
    elif r.shape != (horizon, n):
        raise ValueError(
            f"`{name}` must have shape ({n},) or ({horizon}, {n}), got {shape}. "
            "Give one value per signal."
        )
    known = np.where(np.isfinite(r), r, np.nan)
    return last_measured(np.vstack([last, known]))[1:]


GATE = 100.0  # standard deviations: far beyond what a sound loop shows
SPREAD = 2.0  # standard deviations of y, which a gate lets pass where y drifts


def check_observer(observer, plant):
    """Return an observer of the model; None stands for the default one.

    Parameters
    ----------
    observer : Observer or None
        The observer.
    plant : Plant
        The model.

    Returns
    -------
    observer : Observer
        The observer.

    Raises
    ------
    TypeError
        If it is no observer.
    ValueError
        If it is one of another model.
    """
    if observer is None:
        gate = GATE
        if plant.drift is not None:  # at the start nobody knows where the walk is
            spread = plant.y_scale / np.sqrt(np.diag(plant.noise_covariance))
            gate = max(gate, SPREAD * float(spread.max()))
        return DisturbanceObserver(plant, gate=gate)
    check_type("observer", observer, Observer, "Use `DisturbanceObserver`.")
    check_disturbances("observer", observer, plant)
    given, own = observer.plant.lure, plant.lure
    nx = own.nx
    fits = given.nx >= nx and given.nu == own.nu and given.nz == own.nz
    if not (fits and np.array_equal(given.M[:nx, :nx], own.M[:nx, :nx])):
        raise ValueError(
            "`observer` must be one of the same model, got another one. Make it from "
            "`model`."
        )
    return observer


def check_rate(du_max, nu):
    """Return the limit of the change of every input.

    Parameters
    ----------
    du_max : float, array_like of shape (nu,) or None
        Limits; None means none.
    nu : int
        Number of inputs.

    Returns
    -------
    du_max : ndarray of shape (nu,)
        Limits; infinite where there is none.

    Raises
    ------
    ValueError
        If a limit is not positive or the size is wrong.
    """
    _, du_max = check_limits("du", None, du_max, nu)
    if not np.all(du_max > 0):
        raise ValueError(
            f"`du_max` must be positive, got {du_max}. Use None for no limit."
        )
    return du_max


def check_penalty(slack_weight):
    """Return the linear and the quadratic price of an excess.

    Parameters
    ----------
    slack_weight : tuple of two floats
        The prices.

    Returns
    -------
    prices : ndarray of shape (2,)
        The prices.

    Raises
    ------
    ValueError
        If they are not two positive numbers.
    """
    prices = as_numbers("slack_weight", slack_weight)
    if prices.shape != (2,) or not (np.isfinite(prices).all() and np.all(prices > 0)):
        raise ValueError(
            "`slack_weight` must be a pair of positive numbers, got "
            f"{slack_weight!r}. Try (100.0, 100.0)."
        )
    return prices

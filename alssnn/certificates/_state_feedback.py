"""The linearized loop with a state feedback v = r - K x around it."""

from dataclasses import replace

import numpy as np

from ..checks import as_numbers
from ..lure import Lure
from ..plants import as_plant


def state_feedback(lure, K, moved=None):
    """Return the form that the feedback v = r - K x makes, with input r.

    Parameters
    ----------
    lure : Lure
        Model.
    K : ndarray of shape (nv, nx)
        Gain.
    moved : ndarray of int or None, default=None
        Inputs that v makes; None means all.

    Returns
    -------
    lure : Lure
        The closed loop.

    Examples
    --------
    >>> from alssnn.certificates import state_feedback
    >>> from alssnn.lure import Lure
    >>> Theta = np.array([[1.5, 1.0, 0.0], [1.0, 0.0, 0.0]])
    >>> lure = Lure(Theta, nx=1, nu=1, nw=0)
    >>> state_feedback(lure, np.ones((1, 1))).M[0]  # x+ = (1.5 - 1) x + r
    array([0.5, 1. ])
    """
    Theta = lure.Theta.copy()
    moved = np.arange(lure.nu) if moved is None else moved
    Theta[:, : lure.nx] -= Theta[:, lure.nx + moved] @ K
    return replace(lure, Theta=Theta)


def full_gain(model, K):
    """Return a gain on all states of a plant, those of late inputs included.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model.
    K : array_like of shape (nu, nx) or (nu, nx + n_late), or None
        State feedback v = r - K x, in the basis of `A_` and the units of u. One that
        acts on the states of `A_` alone has zeros for past inputs, which is what the
        loop does with it; None is no feedback.

    Returns
    -------
    K : ndarray of shape (nv, nx + n_late)
        Gain on the states of ``plant.late()``.

    Raises
    ------
    ValueError
        If `K` has the wrong shape or is not finite.
    """
    plant = as_plant(model).late()
    nu, nx = plant.nv, plant.nx - plant.n_late
    if K is None:
        return np.zeros((nu, plant.nx))
    K = as_numbers("K", K)
    if K.shape not in ((nu, nx), (nu, plant.nx)) or not np.isfinite(K).all():
        late = f" or {(nu, plant.nx)}, past inputs included" if plant.n_late else ""
        raise ValueError(
            f"`K` must be a finite matrix of shape {(nu, nx)}{late}, got shape "
            f"{K.shape}. It acts on the states of `A_`."
        )
    return np.pad(K, ((0, 0), (0, plant.nx - K.shape[1])))


def linearized_loop(model, K=None):
    """Return the loop u = v - h(s), v = r - K x, from r to the channels [y; u].

    Parameters
    ----------
    model : estimator or Plant
        Fitted model.
    K : array_like of shape (nu, nx) or None, default=None
        State feedback, see `full_gain`; None means v = r.

    Returns
    -------
    loop : Lure
        Form with the states of ``plant.late()``, deviations.

    Raises
    ------
    ValueError
        If `K` has the wrong shape, or the plant has no law.
    """
    plant = as_plant(model).late()
    return state_feedback(plant.close(), full_gain(plant, K), plant.moved)


def linear_form(plant):
    """Return the linear part of a plant as a form with the channels y.

    Parameters
    ----------
    plant : Plant
        The plant, without delays beside it.

    Returns
    -------
    form : Lure
        Form without neurons, from v in the place of the inputs that are moved, and
        measured disturbances.
    """
    (A, B, C, D), (G, H) = plant.linear(), plant.disturbed_by()
    by_x, by_v, by_d = (np.vstack(pair) for pair in ((A, C), (B, D), (G, H)))
    Theta = np.hstack([by_x, plant.every_input(by_v, by_d), np.zeros((len(by_x), 1))])
    return Lure(Theta, plant.nx, plant.nu, 0)


def matrices(form):
    """Return the matrices of a linear form.

    Parameters
    ----------
    form : Lure
        Form; its neurons are left out.

    Returns
    -------
    A, B, C, D : ndarray
        Of x+ and of the channels.
    """
    M, nx = form.M, form.nx
    return M[:nx, :nx], M[:nx, nx:], M[nx:, :nx], M[nx:, nx:]

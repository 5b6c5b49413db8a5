"""Bounds on omega and eta, which the linearized loop is left with (eq. eta).

Both are rows of the Lur'e form of a plant: what remains of x+ once A x + B v is taken
away, and of y once C x + D v is (with measured disturbances, G d and H d as well).  For
v = u + h they are functions of the neurons alone,

    omega = G w + c,    G = W - B K,   c = c_x - B k,    h = K w + k,

and likewise eta. Observed along trajectories they give bounds that hold on the data;
since every |w_i| < 1, the sup over the cube gives bounds that hold everywhere (eq.
lmi).  The same holds for every bounded activation.
"""

import numpy as np

from ..plants import as_plant
from ..simulation import channels, simulate
from ._state_feedback import linearized_loop

VERTICES = 16  # neurons of g up to which the 2^n corners of the cube are visited


def global_bound(model):
    """Bound ``|omega|`` and eta for all states and inputs, by saturation of neurons.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model.

    Returns
    -------
    eps : float
        The largest ``|G w + c|`` over the box of w, found at one of its corners, for up
        to 16 neurons in G; for more, the smallest of three upper bounds of it. inf if
        a neuron in G is unbounded.
    eta : ndarray of shape (ny,)
        The largest modulus of every entry of eta; inf if one of its neurons is
        unbounded.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.certificates import global_bound
    >>> global_bound(model)
    (0.0, array([0.]))
    """
    plant = as_plant(model).late()
    rows = plant.observed.rows_z[plant.ny + plant.nv :]
    driven = plant.nx + plant.nu  # columns that no neuron bounds
    bound = np.array([activation.bound for activation in plant.form.sigma])

    def largest(rows):
        G, c = rows[:, driven:-1], rows[:, -1]
        active = np.any(G != 0, axis=0)
        if np.any(rows[:, :driven]) or np.isinf(bound[active]).any():
            return np.inf
        return _largest(G[:, active] * bound[active], c)

    eta = [largest(row[None]) for row in rows[plant.nx :]]
    return largest(rows[: plant.nx]), np.array(eta)


def _largest(G, c):
    """Return the largest |G w + c| over the unit cube of w, or a bound of it."""
    n = G.shape[1]
    if n <= VERTICES:
        # a convex function on a cube is largest at a corner
        corners = 2.0 * ((np.arange(2**n)[:, None] >> np.arange(n)) & 1) - 1.0
        return float(np.linalg.norm(corners @ G.T + c, axis=1).max())
    by_neuron = np.linalg.norm(c) + np.linalg.norm(G, axis=0).sum()
    by_state = np.linalg.norm(np.abs(c) + np.abs(G).sum(axis=1))
    by_norm = np.linalg.norm(c) + np.sqrt(n) * np.linalg.norm(G, 2)
    return float(min(by_neuron, by_state, by_norm))


def data_bound(model, records, K=None):
    """Return the largest ``|omega|`` and eta along records, open and closed loop.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model.
    records : sequence of PreparedRecord
        Experiments.
    K : array_like of shape (nu, nx) or None, default=None
        State feedback v = r - K x of the closed loop, with the recorded input as r.

    Returns
    -------
    eps : float
        Largest ``|omega|``, inf if a simulation diverges.
    eta : ndarray of shape (ny,)
        Largest modulus of every entry of eta, inf if a simulation diverges.

    Raises
    ------
    ValueError
        If `K` has the wrong shape, or the plant has no law.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.certificates import data_bound
    >>> data_bound(model, model.prepare_records(*record))
    (0.0, array([0.]))
    """
    plant = as_plant(model).late()
    loop, form = linearized_loop(plant, K), plant.observed
    nx, ny = plant.nx, plant.ny
    eps, eta = 0.0, np.zeros(ny)
    for record in records:
        r = record.u - plant.u_offset
        x0 = np.pad(record.x0, (0, nx - len(record.x0)))  # late inputs rested
        opened, closed = (simulate(z, r, x0, plant.x_scale)[:-1] for z in (form, loop))
        if not (np.isfinite(opened).all() and np.isfinite(closed).all()):
            return np.inf, np.full(ny, np.inf)
        for X, u in ((opened, r), (closed, channels(loop, closed, r)[:, ny:])):
            rest = channels(form, X, u)[:, ny + plant.nv :]
            eps = max(eps, float(np.linalg.norm(rest[:, :nx], axis=1).max()))
            eta = np.maximum(eta, np.abs(rest[:, nx:]).max(axis=0))
    return eps, eta

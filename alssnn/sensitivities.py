"""Sensitivities of a Lur'e form: the derivative of a simulation.

`sensitivities` differentiates the channels along the trajectory (eq. sens)

    S+ = F S + G,    F = dx+/dx = M_x + W R V_x,
                     R = (I - diag(sigma') E)^-1 diag(sigma')
    J  = H S + D,    H = dz/dx,   G, D = direct derivatives (`structures`)

for S = d x / d (theta, x0).  It works through the record in chunks that fit the
cache and hands out J chunk by chunk.  Parameters that are held have no columns.

A form of many layers, as one that samples a derivative (eq. rk4), has a long E, nearly
empty: W R then goes through a list of its weights (`kernels.back_propagate`).

Nothing here knows what channels mean, but one factor of each (`criterion`).
"""

from itertools import cycle

import numpy as np
from scipy.sparse import csr_array

from .kernels import back_propagate, differentiate
from .simulation import linearized, regressors, trajectory, weight_lists
from .structures import direct

SENSITIVITY_BYTES = 1_200_000  # J of one chunk: about the caches
MANY_LAYERS = 8  # beyond: their weights as a list, most of them being zero
GAINS_BYTES = 1_600_000  # gains of some samples then: more leave the caches


def chunk_length(nz, n):
    """Return the number of samples whose sensitivities fit the cache.

    Parameters
    ----------
    nz : int
        Number of channels.
    n : int
        Number of derivatives of each.

    Returns
    -------
    chunk : int
        Number of samples, at least 32.
    """
    return max(32, SENSITIVITY_BYTES // (8 * max(n, 1) * nz))


def sensitivities(
    structure,
    theta,
    x0,
    u,
    scale,
    chunk=None,
    spare=0,
    buffers=1,
    end=None,
    free=None,
):
    """Yield channels and their derivative by (theta, x0), chunk by chunk.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters.
    x0 : ndarray of shape (n_x0,)
        Free part of the initial state.
    u : array of shape (N, nu)
        Inputs; only sliced.
    scale : ndarray of shape (nz,)
        Factor of every channel.
    chunk : int or None, default=None
        Samples per chunk; None takes `chunk_length`.
    spare : int, default=0
        Further columns of J, for use by the caller.
    buffers : int, default=1
        Chunks that J outlives, its own among them.
    end : ndarray of shape (nx, n_free + n_x0) or None, default=None
        Receives the derivative of the state after the last sample, when all is done.
    free : ndarray of bool of shape (n_params,) or None, default=None
        Parameters by which is differentiated, n_free of them; None means all.

    Yields
    ------
    part : slice
        Samples of this chunk.
    Z : ndarray of shape (L, nz)
        Scaled channels.
    J : ndarray of shape (L, nz, n_free + n_x0 + spare)
        ``J[k, i, j]``: derivative of scaled channel i at sample k by free parameter
        j; n_x0 columns behind those of theta belong to the initial state. The array is
        overwritten by a later chunk.

    Raises
    ------
    FloatingPointError
        If the trajectory diverges.

    Notes
    -----
    Costs O(N (nx + nz) nx n) operations and O(chunk nz n) memory for n
    columns.
    """
    nx, nz = structure.nx, structure.nz
    n_free = structure.n_params if free is None else int(np.sum(free))
    n = n_free + structure.n_x0
    chunk = min(chunk or chunk_length(nz, n), len(u))
    p, lure = structure.split(theta), structure.lure(theta)
    scale = np.concatenate([np.ones(nx), scale])
    M, W = lure.M * scale[:, None], lure.W * scale[:, None]
    Theta_z = (lure.Theta[nx : nx + nz] * scale[nx:, None]).T
    is_deep = len(lure.layers) > MANY_LAYERS and not lure.implicit
    apart = not (is_deep or lure.E.any())  # neurons do not see each other
    derivatives = direct(structure, p, scale, W if apart else None)
    if free is not None:
        derivatives = derivatives.by(free)
    by_slopes = apart and not derivatives.varies
    deep = _Deep(lure, W, M[:, :nx], derivatives) if is_deep else None
    ring = cycle([np.zeros((chunk, nz, n + spare)) for _ in range(buffers)])
    S = np.zeros((nx, n))
    S[: structure.n_x0, n_free:] = np.eye(structure.n_x0)
    for part, u_part, X in trajectory(lure, u, structure.initial_state(x0), chunk):
        if not np.isfinite(X[-1]).all():
            raise FloatingPointError("The simulation diverges at these parameters.")
        L = len(u_part)
        J = next(ring)[:L]
        if deep is not None:
            yield part, deep(X[:-1], u_part, S, J) @ Theta_z, J
            continue
        Phi = regressors(lure, X[:-1], u_part)
        gains, FH = linearized(lure, W, M, Phi, by_slopes)
        differentiate(FH, *derivatives.sheets, *derivatives.factors(Phi, gains), S, J)
        yield part, Phi @ Theta_z, J
    if end is not None:
        end[:] = S


class _Deep:
    """Differentiate through many layers, each of which sees little.

    Arrays have the samples as their last axis, so that every layer is some rows. What
    a neuron moves stands in one list: the neurons that it sees (E), the gains of
    parameters inside it, and the states that it sees (V_x). One way back through all of
    them gives W R, these gains and [F; H] (eq. sens).

    Parameters
    ----------
    lure : Lure
        Model without implicit layers.
    W : ndarray of shape (nx + nz, nw)
        Output weights, scaled like the rows.
    M_x : ndarray of shape (nx + nz, nx)
        Linear part by x, scaled likewise.
    direct : Direct
        Direct derivatives.
    """

    def __init__(self, lure, W, M_x, direct):
        nx, nw = lure.nx, lure.nw
        self.lure, self.direct = lure, direct
        own = direct.gain_map[:, nw:]
        one = np.hstack([np.zeros((len(W), own.shape[1])), np.ones((len(W), 1))])
        self.initial = np.hstack([W, one, M_x])
        self.n_gains = direct.gain_map.shape[1] + 1  # behind them: H of all rows
        own = np.hstack([own, np.zeros((nw, 1))])  # no neuron sees the one
        self.lists = weight_lists(np.hstack([lure.E, own, lure.V[:, :nx]]))
        self.layers = np.array([(a.start, a.stop) for a in lure.layers])
        self.signal_map = csr_array(direct.signal_map[:, nx + lure.nu + nw + 1 :].T)
        self.length = max(8, GAINS_BYTES // (8 * self.initial.size))
        self.gains = np.empty((self.length, *self.initial.shape))

    def __call__(self, X, u, S, J):
        """Carry S on, fill J, and return the regressors, shape (L, n_phi)."""
        Phi, slope = self._evaluate(X, u)
        signals = np.ascontiguousarray(np.vstack([Phi, self.signal_map @ Phi]).T)
        slope, direct = np.ascontiguousarray(slope.T), self.direct
        for start in range(0, len(X), self.length):
            some = slice(start, start + self.length)
            gains = self.gains[: len(slope[some])]
            back_propagate(self.initial, slope[some], self.layers, *self.lists, gains)
            FH = np.ascontiguousarray(gains[:, :, self.n_gains :])
            differentiate(FH, *direct.sheets, gains, signals[some], S, J[some])
        return Phi.T

    def _evaluate(self, X, u):
        """Return regressors, shape (n_phi, L), and slopes, shape (nw, L)."""
        lure = self.lure
        Phi = np.vstack([X.T, u.T, np.ones((lure.nw + 1, len(X)))])
        v = lure.V @ Phi[: lure.nx + lure.nu] + lure.b[:, None]
        w, slope = Phi[lure.nx + lure.nu : -1], np.empty_like(v)
        for layer, before in zip(lure.layers, lure.seen, strict=True):
            v[layer] += lure.E[layer, before] @ w[before]
            sigma = lure.sigma[layer.start]
            w[layer] = sigma.value(v[layer])
            slope[layer] = sigma.derivative(v[layer], w[layer])
        return Phi, slope

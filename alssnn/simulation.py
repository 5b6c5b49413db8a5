"""Simulation and sensitivities of a Lur'e form: the only loops over time.

`simulate` runs  x+ = M_x [x; u] + W_x w + c_x,  w = tanh(V [x; u] + E w + b)  from x0.
Everything that depends on u alone is computed in bulk, so that one step costs two
small matrix-vector products.  The step loop is plain NumPy; when numba is
installed (extra `fast`) the same function is compiled.

`sensitivities` differentiates the channels along a simulated trajectory (eq. sens)

    S+ = F S + G,    F = dx+/dx = M_x + W R V_x,
                     R = (I - diag(1 - w^2) E)^-1 diag(1 - w^2)
    J  = H S + D,    H = dz/dx,   G, D = direct derivatives (`structures`)

for S = d x / d (theta, x0).  It works through the record in chunks that fit the
cache and hands out J chunk by chunk: nothing here grows with the record but the
states themselves.

Neither function knows what the channels mean or how they are weighted beyond one
factor per channel; that is the matter of `criterion`.
"""

import numpy as np

from .kernels import advance, propagate

SIMULATION_CHUNK = 1024  # samples between two tests for divergence
SENSITIVITY_BYTES = 3_000_000  # T and J of one chunk together: about the caches
DIVERGED = 1e8  # |x| in scaled units beyond which a trajectory is given up


def simulate(lure, u, x0):
    """Simulate the states of a Lur'e form.

    Parameters
    ----------
    lure : Lure
        Model.
    u : ndarray of shape (N, nu)
        Inputs.
    x0 : ndarray of shape (nx,)
        State at the first sample.

    Returns
    -------
    X : ndarray of shape (N + 1, nx)
        States, ``X[k]`` at sample k and ``X[N]`` after the last one. From the
        chunk in which the trajectory diverges on, all entries are inf.

    Notes
    -----
    Costs N steps of 2 nw nx + nx^2 multiplications and nw tanh.
    """
    nx = lure.nx
    dtype = np.result_type(lure.Theta, u, x0, float)
    X = np.empty((len(u) + 1, nx), dtype=dtype)
    X[0] = x0
    P = np.vstack([lure.V[:, :nx], lure.M[:nx, :nx]]).astype(dtype)
    Pu = np.vstack([lure.V[:, nx:], lure.M[:nx, nx:]])
    c = np.concatenate([lure.b, lure.c[:nx]])
    W = np.ascontiguousarray(lure.W[:nx], dtype=dtype)
    E = np.ascontiguousarray(lure.E, dtype=dtype)
    layers = np.array([*(layer.start for layer in lure.layers), lure.nw])
    step = advance.plain if dtype.kind == "c" else advance
    with np.errstate(over="ignore", invalid="ignore"):
        for start in range(0, len(u), SIMULATION_CHUNK):
            base = u[start : start + SIMULATION_CHUNK] @ Pu.T + c
            stop = start + len(base)
            base = base.astype(dtype, copy=False)
            step(base, P, E, layers, W, X[start], X[start + 1 :])
            # "not <": nan must count as diverged
            if not np.abs(X[start + 1 : stop + 1]).max() < DIVERGED:
                X[start + 1 :] = np.inf
                break
    return X


def regressors(lure, X, u):
    """Return phi = [x; u; w; 1] of every sample.

    Parameters
    ----------
    lure : Lure
        Model.
    X : ndarray of shape (L, nx)
        States.
    u : ndarray of shape (L, nu)
        Inputs.

    Returns
    -------
    Phi : ndarray of shape (L, nx + nu + nw + 1)
        Regressors; ``Phi @ lure.Theta.T`` is [x+; z; v].
    """
    xu = np.hstack([X, u])
    w = xu @ lure.V.T + lure.b
    for layer in lure.layers:
        before = slice(0, layer.start)
        w[:, layer] += w[:, before] @ lure.E[layer, before].T
        w[:, layer] = np.tanh(w[:, layer])
    return np.hstack([xu, w, np.ones((len(xu), 1))])


def neuron_gains(lure, W, w):
    """Return W R, the derivative of outputs W w by the neurons' own inputs v.

    Parameters
    ----------
    lure : Lure
        Model.
    W : ndarray of shape (n_rows, nw)
        Output weights.
    w : ndarray of shape (L, nw)
        Values of the neurons.

    Returns
    -------
    WR : ndarray of shape (L, n_rows, nw)
        Gains; back-propagation through the layers (eq. sens).
    """
    slope = (1.0 - w**2)[:, None, :]
    if len(lure.layers) <= 1:
        return W * slope
    WR = np.repeat(W[None], len(w), axis=0)
    for layer in reversed(lure.layers):
        before = slice(0, layer.start)
        WR[:, :, layer] *= slope[:, :, layer]
        WR[:, :, before] += WR[:, :, layer] @ lure.E[layer, before]
    return WR


def channels(lure, X, u, chunk=8192):
    """Return the channels z of simulated states.

    Parameters
    ----------
    lure : Lure
        Model.
    X : ndarray of shape (N, nx) or (N + 1, nx)
        States; a state after the last sample is ignored.
    u : ndarray of shape (N, nu)
        Inputs.
    chunk : int, default=8192
        Samples treated at a time, which bounds the memory for w.

    Returns
    -------
    Z : ndarray of shape (N, nz)
        Channels.
    """
    Theta_z = lure.Theta[lure.nx : lure.nx + lure.nz]
    Z = np.empty((len(u), lure.nz), dtype=np.result_type(X, lure.Theta))
    for start in range(0, len(u), chunk):
        part = slice(start, min(start + chunk, len(u)))
        Z[part] = regressors(lure, X[part], u[part]) @ Theta_z.T
    return Z


def chunk_length(structure):
    """Return the number of samples whose sensitivities fit the cache.

    Parameters
    ----------
    structure : Structure
        Structure whose sensitivities are wanted.

    Returns
    -------
    chunk : int
        Number of samples, at least 32.
    """
    n = structure.n_params + structure.n_x0
    per_sample = 8 * n * (structure.nx + 2 * structure.nz)
    return max(32, SENSITIVITY_BYTES // per_sample)


def sensitivities(structure, theta, X, u, scale, chunk=None):
    """Yield the derivative of the channels by (theta, x0), chunk by chunk.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Parameters at which `X` was simulated.
    X : ndarray of shape (N + 1, nx)
        States visited by `simulate`.
    u : ndarray of shape (N, nu)
        Inputs.
    scale : ndarray of shape (nz,)
        Factor of every channel.
    chunk : int or None, default=None
        Samples per chunk; None takes `chunk_length`.

    Yields
    ------
    part : slice
        Samples of this chunk.
    J : ndarray of shape (L, nz, n_params + n_x0)
        ``J[k, i, j]``: derivative of scaled channel i at sample k by parameter j;
        the last n_x0 columns belong to the initial state. The array is
        overwritten by the next chunk.

    Notes
    -----
    Costs O(N (nx + nz) nx n) operations and O(chunk (nx + nz) n) memory for n
    columns.
    """
    nx, nz, n_params = structure.nx, structure.nz, structure.n_params
    n = n_params + structure.n_x0
    chunk = min(chunk or chunk_length(structure), len(u))
    p, lure = structure.split(theta), structure.lure(theta)
    scale = np.concatenate([np.ones(nx), scale])
    M_x, W = lure.M[:, :nx] * scale[:, None], lure.W * scale[:, None]
    V_x = lure.V[:, :nx]
    T = np.empty((chunk, nx + nz, n))  # [G_k; D_k], then [S_k+1; J_k]
    J = np.empty((chunk, nz, n))
    S = np.zeros((nx, n))
    S[: structure.n_x0, n_params:] = np.eye(structure.n_x0)
    for start in range(0, len(u), chunk):
        part = slice(start, min(start + chunk, len(u)))
        L = part.stop - start
        Phi = regressors(lure, X[part], u[part])
        w = Phi[:, nx + structure.nu : -1]
        WR = neuron_gains(lure, W, w)  # (L, nx + nz, nw)
        FH = (WR.reshape(L * (nx + nz), lure.nw) @ V_x).reshape(L, nx + nz, nx) + M_x
        T[:L] = 0.0
        structure.add_direct(p, Phi, WR, scale, T[:L])
        propagate(FH, S, T[:L])
        S[:] = T[L - 1, :nx]
        J[:L] = T[:L, nx:]
        yield part, J[:L]

"""Simulation and sensitivities of a Lur'e form: the only loops over time.

`simulate` runs  x+ = M_x [x; u] + W_x w + c_x,  w = sigma(V [x; u] + E w + b)  from x0.
What depends on u alone is computed in bulk, so that one step costs two small products.
The step loop is plain NumPy; with numba a twin is compiled.

`sensitivities` differentiates the channels along the trajectory (eq. sens)

    S+ = F S + G,    F = dx+/dx = M_x + W R V_x,
                     R = (I - diag(sigma') E)^-1 diag(sigma')
    J  = H S + D,    H = dz/dx,   G, D = direct derivatives (`structures`)

for S = d x / d (theta, x0).  It works through the record in chunks that fit the
cache and hands out J chunk by chunk; inputs are only sliced: a record may live on disk.
Only what `simulate` returns grows with the record.

A form of many layers, as one that samples a derivative (eq. rk4), has a long E, nearly
empty: W R then goes through a list of its weights (`kernels.back_propagate`).

Neither function knows what channels mean, but one factor of each (`criterion`).
"""

from itertools import cycle

import numpy as np
from scipy.sparse import csr_array

from .activations import OTHER
from .implicit import solve_each
from .kernels import advance, back_propagate, differentiate

SIMULATION_CHUNK = 1024  # samples between two tests for divergence
WHOLE_CHUNK = 8192  # samples whose neurons are kept at a time
SENSITIVITY_BYTES = 1_200_000  # J of one chunk: about the caches
MANY_LAYERS = 8  # beyond: their weights as a list, most of them being zero
GAINS_BYTES = 1_600_000  # gains of some samples then: more leave the caches
DIVERGED = 1e8  # |x| over its size beyond which a trajectory is given up


def weight_lists(E):
    """Return the weights that are not zero as lists, one per row.

    Parameters
    ----------
    E : ndarray of shape (n, n_columns)
        Weights.

    Returns
    -------
    first : ndarray of int of shape (n + 1,)
        Places where the list of every row starts, and the end of the last one.
    seen : ndarray of int of shape (n_weights,)
        Their columns.
    weight : ndarray of shape (n_weights,)
        The weights.
    """
    row, seen = np.nonzero(E)
    first = np.searchsorted(row, np.arange(len(E) + 1)).astype(np.int32)
    # unsigned: compiled loops then need not ask whether they count from the end
    return first, seen.astype(np.uintp), E[row, seen]


class Stepper:
    """Step one Lur'e form; what does not depend on the record is prepared once.

    Parameters
    ----------
    lure : Lure
        Model.
    dtype : dtype, default=float
        Type of the states.
    size : float or ndarray of shape (nx,), default=1.0
        Usual size of the states; inf for one that is not known.
    """

    def __init__(self, lure, dtype=float, size=1.0):
        self.lure, self.dtype, self._largest = lure, np.dtype(dtype), DIVERGED * size
        nx, layers = lure.nx, lure.layers
        self._P = np.vstack([lure.V[:, :nx], lure.M[:nx, :nx]]).astype(dtype)
        self._Pu = np.vstack([lure.V[:, nx:], lure.M[:nx, nx:]]).T
        self._c = np.concatenate([lure.b, lure.c[:nx]])
        self._W = np.ascontiguousarray(lure.W[:nx], dtype=dtype)
        self._E: np.ndarray | tuple = np.ascontiguousarray(lure.E, dtype=dtype)
        pairs = zip(layers, lure.seen, strict=True)
        places = [(a.start, a.stop, b.start) for a, b in pairs]
        self._layers = np.array(places, dtype=np.int64).reshape(-1, 3)
        functions = [lure.sigma[layer.start] for layer in layers]
        solved = lure.implicit
        values = tuple(
            solved[layer.start].value if layer.start in solved else function.value
            for layer, function in zip(layers, functions, strict=True)
        )
        codes = np.array([function.code for function in functions], dtype=np.int64)
        self._sigma: np.ndarray | tuple
        plain = OTHER in codes or self.dtype.kind != "f" or lure.implicit
        if advance.is_compiled and not plain:
            self._kernel, self._sigma = advance, codes
            self._E = weight_lists(self._E)
        else:
            self._kernel, self._sigma = advance.plain, values

    def __reduce__(self):
        """Leave out the kernel, which cannot be pickled."""
        return Stepper, (self.lure, self.dtype, self._largest / DIVERGED)

    def __call__(self, u, x, X):
        """Fill the states that follow a state.

        Parameters
        ----------
        u : ndarray of shape (L, nu)
            Inputs.
        x : ndarray of shape (nx,)
            State at the first sample.
        X : ndarray of shape (L, nx)
            Receives the states one sample later; inf if they diverge.
        """
        base = (u @ self._Pu + self._c).astype(self.dtype, copy=False)
        self._kernel(base, self._P, self._E, self._layers, self._sigma, self._W, x, X)
        if not (np.abs(X) < self._largest).all():  # nor is nan below it
            X[:] = np.inf


def trajectory(lure, u, x0, chunk=SIMULATION_CHUNK, size=1.0):
    """Yield the states of a Lur'e form, chunk by chunk.

    Parameters
    ----------
    lure : Lure
        Model.
    u : array of shape (N, nu)
        Inputs; only sliced.
    x0 : ndarray of shape (nx,)
        State at the first sample.
    chunk : int, default=1024
        Samples per chunk.
    size : float or ndarray of shape (nx,), default=1.0
        Usual size of the states, as for `Stepper`.

    Yields
    ------
    part : slice
        Samples of this chunk.
    u_part : ndarray of shape (L, nu)
        Their inputs.
    X : ndarray of shape (L + 1, nx)
        Their states, and the one after the last of them. If the trajectory diverges
        within the chunk, all but the first are inf, and it is the last chunk.
    """
    dtype = np.result_type(lure.Theta, u.dtype, x0, float)
    step = Stepper(lure, dtype, size)
    x = x0
    for start in range(0, len(u), chunk):
        part = slice(start, min(start + chunk, len(u)))
        X = np.empty((part.stop - start + 1, lure.nx), dtype=dtype)
        X[0] = x
        u_part = u[part]
        with np.errstate(over="ignore", invalid="ignore"):
            step(u_part, X[0], X[1:])
        yield part, u_part, X
        x = X[-1]
        if not np.isfinite(x).all():
            return


def simulate(lure, u, x0, size=1.0):
    """Simulate the states of a Lur'e form.

    Parameters
    ----------
    lure : Lure
        Model.
    u : ndarray of shape (N, nu)
        Inputs.
    x0 : ndarray of shape (nx,)
        State at the first sample.
    size : float or ndarray of shape (nx,), default=1.0
        Usual size of the states, as for `Stepper`.

    Returns
    -------
    X : ndarray of shape (N + 1, nx)
        States, ``X[k]`` at sample k and ``X[N]`` after the last one. From the
        chunk in which the trajectory diverges on, all entries are inf.

    Notes
    -----
    Costs N steps of 2 nw nx + nx^2 multiplications and nw activations.
    """
    dtype = np.result_type(lure.Theta, u.dtype, x0, float)
    X = np.full((len(u) + 1, lure.nx), np.inf, dtype=dtype)
    X[0] = x0
    for part, _, X_part in trajectory(lure, u, x0, size=size):
        X[part.start + 1 : part.stop + 1] = X_part[1:]
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
    for layer, before in zip(lure.layers, lure.seen, strict=True):
        w[:, layer] += w[:, before] @ lure.E[layer, before].T
        if layer.start in lure.implicit:
            w[:, layer] = lure.implicit[layer.start].value(w[:, layer])
        else:
            w[:, layer] = lure.sigma[layer.start].value(w[:, layer])
    return np.hstack([xu, w, np.ones((len(xu), 1))])


def runs(lure, u, x0):
    """Yield the states and the channels of a simulation, chunk by chunk.

    Parameters
    ----------
    lure : Lure
        Model.
    u : array of shape (N, nu)
        Inputs; only sliced.
    x0 : ndarray of shape (nx,)
        State at the first sample.

    Yields
    ------
    part : slice
        Samples of this chunk.
    u_part : ndarray of shape (L, nu)
        Their inputs.
    X : ndarray of shape (L, nx)
        Their states.
    Z : ndarray of shape (L, nz)
        Their channels; not finite in the chunk where the simulation diverges, which is
        the last.
    """
    for part, u_part, X in trajectory(lure, u, x0):
        with np.errstate(over="ignore", invalid="ignore"):
            Z = regressors(lure, X[:-1], u_part) @ lure.rows_z.T
        yield part, u_part, X[:-1], Z


def outputs(lure, u, x0):
    """Return the channels of a whole simulation.

    Parameters
    ----------
    lure : Lure
        Model.
    u : array of shape (N, nu)
        Inputs.
    x0 : ndarray of shape (nx,)
        State at the first sample.

    Returns
    -------
    Z : ndarray of shape (N, nz)
        Channels; inf where the simulation diverges.
    """
    Z = np.full((len(u), lure.nz), np.inf)
    for part, _, _, Z_part in runs(lure, u, x0):
        Z[part] = np.where(np.isfinite(Z_part), Z_part, np.inf)
    return Z


def neuron_gains(lure, W, Phi):
    """Return W R, the derivative of outputs W w by the neurons' own inputs v.

    Parameters
    ----------
    lure : Lure
        Model.
    W : ndarray of shape (n_rows, nw)
        Output weights.
    Phi : ndarray of shape (L, nx + nu + nw + 1)
        Regressors.

    Returns
    -------
    WR : ndarray of shape (L, n_rows, nw)
        Gains; back-propagation through the layers (eq. sens).
    """
    w = Phi[:, lure.nx + lure.nu : -1]
    v = Phi @ lure.Theta[lure.nx + lure.nz :].T
    slope = np.empty_like(v)
    for layer in lure.layers:
        derivative = lure.sigma[layer.start].derivative
        slope[:, layer] = derivative(v[:, layer], w[:, layer])
    slope = slope[:, None, :]
    if not lure.E.any():
        return W * slope
    WR = np.repeat(W[None], len(w), axis=0)
    for layer, before in reversed(list(zip(lure.layers, lure.seen, strict=True))):
        if layer.start in lure.implicit:  # W (I - diag(sigma') E)^-1
            bent = np.swapaxes(slope[:, :, layer], 1, 2) * lure.E[layer, layer]
            unit = np.eye(bent.shape[1])
            inner = np.swapaxes(solve_each(unit - bent, unit), 1, 2)
            WR[:, :, layer] = np.einsum("njk,nik->nij", inner, WR[:, :, layer])
        WR[:, :, layer] *= slope[:, :, layer]
        WR[:, :, before] += WR[:, :, layer] @ lure.E[layer, before]
    return WR


def channels(lure, X, u):
    """Return the channels z of simulated states.

    Parameters
    ----------
    lure : Lure
        Model.
    X : ndarray of shape (N, nx) or (N + 1, nx)
        States; a state after the last sample is ignored.
    u : ndarray of shape (N, nu)
        Inputs.

    Returns
    -------
    Z : ndarray of shape (N, nz)
        Channels.
    """
    Z = np.empty((len(u), lure.nz), dtype=np.result_type(X, lure.Theta))
    for start in range(0, len(u), WHOLE_CHUNK):  # w of all samples may be large
        part = slice(start, min(start + WHOLE_CHUNK, len(u)))
        Z[part] = regressors(lure, X[part], u[part]) @ lure.rows_z.T
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
    per_sample = 8 * n * structure.nz
    return max(32, SENSITIVITY_BYTES // per_sample)


def sensitivities(
    structure, theta, x0, u, scale, chunk=None, spare=0, buffers=1, end=None
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
    end : ndarray of shape (nx, n_params + n_x0) or None, default=None
        Receives the derivative of the state after the last sample, when all is done.

    Yields
    ------
    part : slice
        Samples of this chunk.
    Z : ndarray of shape (L, nz)
        Scaled channels.
    J : ndarray of shape (L, nz, n_params + n_x0 + spare)
        ``J[k, i, j]``: derivative of scaled channel i at sample k by parameter j;
        n_x0 columns behind those of theta belong to the initial state. The array is
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
    nx, nz, n_params = structure.nx, structure.nz, structure.n_params
    n = n_params + structure.n_x0
    chunk = min(chunk or chunk_length(structure), len(u))
    p, lure = structure.split(theta), structure.lure(theta)
    scale = np.concatenate([np.ones(nx), scale])
    M_x, W = lure.M[:, :nx] * scale[:, None], lure.W * scale[:, None]
    V_x = lure.V[:, :nx]
    Theta_z = (lure.Theta[nx : nx + nz] * scale[nx:, None]).T
    direct = structure.direct(p, scale)
    deep = None
    if len(lure.layers) > MANY_LAYERS and not lure.implicit:
        deep = _Deep(lure, W, M_x, direct)
    ring = cycle([np.zeros((chunk, nz, n + spare)) for _ in range(buffers)])
    S = np.zeros((nx, n))
    S[: structure.n_x0, n_params:] = np.eye(structure.n_x0)
    for part, u_part, X in trajectory(lure, u, structure.initial_state(x0), chunk):
        if not np.isfinite(X[-1]).all():
            raise FloatingPointError("The simulation diverges at these parameters.")
        L = len(u_part)
        J = next(ring)[:L]
        if deep is not None:
            yield part, deep(X[:-1], u_part, S, J) @ Theta_z, J
            continue
        Phi = regressors(lure, X[:-1], u_part)
        WR = neuron_gains(lure, W, Phi)  # (L, nx + nz, nw)
        FH = (WR.reshape(L * (nx + nz), lure.nw) @ V_x).reshape(L, nx + nz, nx) + M_x
        differentiate(
            FH, direct.table, direct.constants, *direct.factors(Phi, WR), S, J
        )
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
        self.initial = np.hstack([W, np.zeros((len(W), own.shape[1])), M_x])
        self.n_gains = direct.gain_map.shape[1]  # behind them: H of all rows
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
            factors = direct.constants, gains, signals[some]
            differentiate(FH, direct.table, *factors, S, J[some])
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

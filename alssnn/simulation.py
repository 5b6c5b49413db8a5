"""Simulation of a Lur'e form: the loop over time.

`simulate` runs  x+ = M_x [x; u] + W_x w + c_x,  w = sigma(V [x; u] + E w + b)  from x0.
What depends on u alone is computed in bulk, so that one step costs two small products.
The step loop is plain NumPy; with numba a twin is compiled.

Inputs are only sliced: a record may live on disk. Only what `simulate` returns grows
with the record. Nothing here knows what channels mean.
"""

import numpy as np

from .activations import OTHER
from .implicit import solve_each
from .kernels import advance

SIMULATION_CHUNK = 1024  # samples between two tests for divergence
WHOLE_CHUNK = 8192  # samples whose neurons are kept at a time
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


def neuron_slopes(lure, Phi):
    """Return sigma', the derivative of every neuron by its own input v.

    Parameters
    ----------
    lure : Lure
        Model.
    Phi : ndarray of shape (L, nx + nu + nw + 1)
        Regressors.

    Returns
    -------
    slopes : ndarray of shape (L, nw)
        Slopes.
    """
    w = Phi[:, lure.nx + lure.nu : -1]
    v = Phi @ lure.Theta[lure.nx + lure.nz :].T
    slopes = np.empty_like(v)
    for layer in lure.layers:
        derivative = lure.sigma[layer.start].derivative
        slopes[:, layer] = derivative(v[:, layer], w[:, layer])
    return slopes


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
    slope = neuron_slopes(lure, Phi)
    slope = slope[:, None, :]
    if not lure.E.any():
        return W * slope
    WR = np.repeat(W[None], len(Phi), axis=0)
    for layer, before in reversed(list(zip(lure.layers, lure.seen, strict=True))):
        if layer.start in lure.implicit:  # W (I - diag(sigma') E)^-1
            bent = np.swapaxes(slope[:, :, layer], 1, 2) * lure.E[layer, layer]
            unit = np.eye(bent.shape[1])
            inner = np.swapaxes(solve_each(unit - bent, unit), 1, 2)
            WR[:, :, layer] = np.einsum("njk,nik->nij", inner, WR[:, :, layer])
        WR[:, :, layer] *= slope[:, :, layer]
        WR[:, :, before] += WR[:, :, layer] @ lure.E[layer, before]
    return WR


def linearized(lure, W, M, Phi, by_slopes):
    """Return the derivatives of [x+; z] by the neurons and by the states (eq. sens).

    Parameters
    ----------
    lure : Lure
        Model.
    W : ndarray of shape (nx + nz, nw)
        Output weights of the neurons, scaled like the rows.
    M : ndarray of shape (nx + nz, nx + nu)
        Linear part, scaled likewise.
    Phi : ndarray of shape (L, nx + nu + nw + 1)
        Regressors.
    by_slopes : bool
        Whether slopes are enough. Neurons must not see each other then: W R is
        W diag(sigma').

    Returns
    -------
    gains : ndarray of shape (L, 1, nw) or (L, nx + nz, nw)
        The slopes sigma' or W R.
    FH : ndarray of shape (L, nx + nz, nx)
        [F; H] (eq. sens).
    """
    V_x, (n_rows, nw), nx = lure.V[:, : lure.nx], W.shape, lure.nx
    if by_slopes:
        gains = neuron_slopes(lure, Phi)[:, None]
        FH = gains[:, 0] @ (W.T[:, :, None] * V_x[:, None]).reshape(nw, n_rows * nx)
    else:
        gains = neuron_gains(lure, W, Phi)
        FH = gains.reshape(len(Phi) * n_rows, nw) @ V_x
    return gains, FH.reshape(len(Phi), n_rows, nx) + M[:, :nx]


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

"""Kernels: the inner loops that are worth compiling.

Each kernel is plain NumPy.  When numba is installed, a compiled function
takes its place on the first call: the same source where NumPy and numba
like the same code, a loop twin where they do not.  Both do the same arithmetic;
the tests run both.  Compiled code is cached on disk by numba.
"""

import ctypes
import functools

import numpy as np
from scipy import LowLevelCallable
from scipy.linalg import cython_blas
from scipy.linalg.blas import dgemm
from scipy.sparse import csr_array

from .activations import IDENTITY, RELU, SIGMOID, TANH

FEW = 500  # weights below which the twin of `advance` does without BLAS
SIDE_BY_SIDE = 8  # samples that the twin of `back_propagate` treats in one loop


class Kernel:
    """Call a compiled function if numba is installed, else its NumPy original.

    Parameters
    ----------
    plain : callable
        The original.
    twin : callable or None, default=None
        What to compile in its place; None compiles the original.
    """

    def __init__(self, plain, twin=None):
        self.plain = plain
        self.twin = twin or plain
        functools.update_wrapper(self, plain)

    @functools.cached_property
    def _resolved(self):
        try:
            import numba
        except ImportError:
            return self.plain
        # without the GIL, experiments run in parallel threads
        compiled = functools.partial(numba.njit, nogil=True)
        try:
            return compiled(cache=True)(self.twin)
        except RuntimeError:  # no folder can be written: compiled anew by each process
            return compiled()(self.twin)

    @property
    def is_compiled(self):
        """Return whether the twin runs in the place of the original."""
        return self._resolved is not self.plain

    def __call__(self, *args):
        """Run the kernel."""
        return self._resolved(*args)


def _compiled(twin=None):
    """Return a decorator that makes a `Kernel` of a function."""
    return functools.partial(Kernel, twin=twin)


def _advance_loop(base, P, E, layers, codes, W, x, X):
    nw = W.shape[1]
    first, seen, weight = E
    q = np.empty(P.shape[0], dtype=P.dtype)
    w = np.empty(nw, dtype=P.dtype)
    few = P.size + W.size < FEW  # a call of BLAS would cost more than these products
    P_t, W_t = P.T.copy(), W.T.copy()
    for k in range(base.shape[0]):
        if few:
            q[:] = base[k]
            for j in range(len(x)):
                row, v = P_t[j], x[j]
                for i in range(len(q)):
                    q[i] += row[i] * v
        else:
            np.dot(P, x, q)
            q += base[k]
        for i in range(codes.shape[0]):
            a, b, code = layers[i, 0], layers[i, 1], codes[i]
            for j in range(a, b):  # scalars: a view costs more than a short loop
                v = q[j]
                for m in range(first[j], first[j + 1]):
                    v += weight[m] * w[seen[m]]
                if code == TANH:
                    w[j] = np.tanh(v)
                elif code == SIGMOID:
                    w[j] = 0.5 * (1.0 + np.tanh(0.5 * v))
                elif code == RELU:
                    w[j] = max(v, 0.0)
                elif code == IDENTITY:
                    w[j] = v
                else:
                    w[j] = np.sin(v)
        x = X[k]
        if few:
            x[:] = q[nw:]
            for j in range(nw):
                row, v = W_t[j], w[j]
                for i in range(len(x)):
                    x[i] += row[i] * v
        else:
            np.dot(W, w, x)
            x += q[nw:]


@_compiled(_advance_loop)
def advance(base, P, E, layers, sigma, W, x, X):
    """Step a Lur'e form through L samples; ``X[k]`` receives the next state.

    Parameters
    ----------
    base : ndarray of shape (L, nw + nx)
        Part of [v; x+] that depends on neither x nor w.
    P : ndarray of shape (nw + nx, nx)
        Part of [v; x+] that is linear in x.
    E : ndarray of shape (nw, nw) or tuple of ndarray
        Weights between neurons: a matrix for the original; for the twin the weights
        that are not zero, row by row, as `back_propagate` has them, the places first.
    layers : ndarray of int of shape (n_layers, 3)
        First and last neuron (exclusive) of every layer, and the first that it sees.
    sigma : sequence of length n_layers
        Activation of every layer: functions for the original, an array of codes
        (`activations`) for the twin.
    W : ndarray of shape (nx, nw)
        Output weights of the neurons.
    x : ndarray of shape (nx,)
        State at the first sample.
    X : ndarray of shape (>= L, nx)
        Written in place.
    """
    nw = W.shape[1]
    w = np.empty(nw, dtype=P.dtype)
    for k in range(base.shape[0]):
        q = P @ x
        q += base[k]
        for function, (a, b, first) in zip(sigma, layers, strict=True):
            if a > first:
                q[a:b] += E[a:b, first:a] @ w[first:a]
            w[a:b] = function(q[a:b])
        x = X[k]
        np.dot(W, w, x)
        x += q[nw:]


def _differentiate_loop(FH, table, weights, gain_of, signal_of, gains, signals, S, J):
    L, n_rows, nx = FH.shape
    n = S.shape[1]
    now, T = np.empty((n_rows, n)), np.empty((n_rows, n))
    now[:nx] = S
    factors = np.empty(n)
    for k in range(L):
        np.dot(FH[k], now[:nx], T)
        for start, stop, first, end, at, varies in table:
            factor, until = factors[first:end], at + end - first
            gain, signal = gain_of[at:until], signal_of[at:until]
            seen = signals[k]
            if varies:
                for p in range(len(factor)):
                    factor[p] = seen[signal[p]]
                for r in range(start, stop):
                    out, row = T[r, first:end], gains[k, r]
                    for p in range(len(factor)):
                        out[p] += row[gain[p]] * factor[p]
                continue
            row = gains[k, 0]
            for p in range(len(factor)):
                factor[p] = row[gain[p]] * seen[signal[p]]
            for r in range(start, stop):
                out, weight = T[r, first:end], weights[r, at:until]
                for p in range(len(factor)):
                    out[p] += weight[p] * factor[p]
        J[k, :, :n] = T[nx:]
        now, T = T, now
    S[:] = now[:nx]


@_compiled(_differentiate_loop)
def differentiate(FH, table, weights, gain_of, signal_of, gains, signals, S, J):
    """Run S+ = F S + G, J = H S + D (eq. sens) through L samples.

    Parameters
    ----------
    FH : ndarray of shape (L, nx + nz, nx)
        Derivatives of [x+; z] by x.
    table : ndarray of int of shape (n_sheets, 6)
        Direct derivatives G and D as sheets: first and last row (exclusive), first and
        last column, place of the first column in the arrays that follow, and whether
        the sheet varies. Entry (r, p) of a sheet is ``weights[r, p] * gains[0, g] *
        signals[s]`` for the gain g and the signal s of p; if it varies, it is
        ``gains[r, g] * signals[s]``.
    weights : ndarray of shape (nx + nz, n_entries)
        Constant factors.
    gain_of, signal_of : ndarray of unsigned int of shape (n_entries,)
        Numbers of the gains and of the signals.
    gains : ndarray of shape (L, nx + nz or 1, n_gains)
        Left factors; one row is enough where no sheet varies.
    signals : ndarray of shape (L, n_signals)
        Right factors.
    S : ndarray of shape (nx, n)
        Derivative of the state at the first sample; overwritten with that after the
        last one.
    J : ndarray of shape (L, nz, >= n)
        Receives the derivatives of z; further columns are left alone.
    """
    L, n_rows, nx = FH.shape
    n = S.shape[1]
    T = np.zeros((L, n_rows, n))  # [G; D], then [S+; J]
    for start, stop, first, end, at, varies in table:
        rows, entries = slice(start, stop), slice(at, at + end - first)
        gain = gains[:, rows if varies else slice(1), gain_of[entries]]
        weight = 1.0 if varies else weights[rows, entries]
        sheet = gain * signals[:, None, signal_of[entries]] * weight
        T[:, rows, first:end] += sheet
    # BLAS adds the product to T[k] itself (beta = 1): one call per sample. The
    # transposes make the C-ordered arrays Fortran-ordered without a copy.
    S_t = S.T
    for FH_k, T_k in zip(FH, T, strict=True):
        dgemm(1.0, S_t, FH_k.T, 1.0, T_k.T, overwrite_c=1)
        S_t = T_k[:nx].T
    S[:] = T[-1, :nx]
    J[:, :, :n] = T[:, nx:]


def _retrace_loop(FH, carried, rows):
    L, n_rows, nx = FH.shape
    for k in range(L - 1, -1, -1):
        for i in range(nx):
            rows[k, i] = carried[i]
            carried[i] = 0.0
        for r in range(n_rows):
            value = rows[k, r]
            for i in range(nx):
                carried[i] += FH[k, r, i] * value


@_compiled(_retrace_loop)
def retrace(FH, carried, rows):
    """Run the adjoint backwards through L samples (eq. adjoint).

    Parameters
    ----------
    FH : ndarray of shape (L, nx + nz, nx)
        Derivatives of [x+; z] by x.
    carried : ndarray of shape (nx,)
        Adjoint of the state after the last sample; overwritten with that of the state
        at the first one.
    rows : ndarray of shape (L, nx + nz)
        Adjoint of [x+; z]: that of z is given, that of x+ is written.
    """
    nx = FH.shape[2]
    for FH_k, row in zip(FH[::-1], rows[::-1], strict=True):
        row[:nx] = carried
        carried[:] = row @ FH_k


def _back_propagate_loop(initial, slope, layers, first, onto, weight, out):
    n_rows, n_columns = initial.shape
    L, nw = slope.shape
    # samples innermost: every weight then meets one long run of numbers
    n = n_rows * SIDE_BY_SIDE
    G = np.empty((n_columns, n))
    for k in range(0, L, SIDE_BY_SIDE):
        m = min(SIDE_BY_SIDE, L - k)
        for c in range(n_columns):
            for r in range(n_rows):
                G[c, r * SIDE_BY_SIDE : (r + 1) * SIDE_BY_SIDE] = initial[r, c]
        for i in range(nw - 1, -1, -1):
            own = G[i]
            for r in range(n_rows):
                for j in range(m):
                    own[r * SIDE_BY_SIDE + j] *= slope[k + j, i]
            for t in range(first[i], first[i + 1]):
                other, value = G[onto[t]], weight[t]
                for j in range(n):
                    other[j] += value * own[j]
        for j in range(m):
            for r in range(n_rows):
                for c in range(n_columns):
                    out[k + j, r, c] = G[c, r * SIDE_BY_SIDE + j]


@_compiled(_back_propagate_loop)
def back_propagate(initial, slope, layers, first, onto, weight, out):
    """Propagate gains back through neurons that see few others (eq. sens).

    Parameters
    ----------
    initial : ndarray of shape (n_rows, n_columns)
        Gains of the neurons' values, then those of what else the neurons see.
    slope : ndarray of shape (L, nw)
        Derivatives sigma' of the neurons.
    layers : ndarray of int of shape (n_layers, 2)
        First and last neuron (exclusive) of every layer.
    first : ndarray of int of shape (nw + 1,)
        Places in `onto` and `weight` where the list of every neuron starts, and the
        end of the last one.
    onto : ndarray of int of shape (n_weights,)
        Columns that the neurons see: earlier neurons, or columns behind all of them.
    weight : ndarray of shape (n_weights,)
        Weights with which they see them.
    out : ndarray of shape (L, n_rows, n_columns)
        Receives the gains: those of the neurons' own inputs v, then ``initial`` of
        the other columns plus what reaches them through the neurons.
    """
    L, nw = slope.shape
    n_rows, n_columns = initial.shape
    # samples innermost: every layer is then one product of matrices
    G = np.repeat(initial.T[:, :, None], L, axis=2)
    dense = csr_array((weight, onto, first), shape=(nw, n_columns))
    for start, stop in layers[::-1]:
        G[start:stop] *= slope.T[start:stop, None]
        columns = np.unique(onto[first[start] : first[stop]])
        E = dense[start:stop].toarray()[:, columns]
        through = E.T @ G[start:stop].reshape(stop - start, -1)
        G[columns] += through.reshape(-1, n_rows, L)
    out[:] = G.transpose(2, 1, 0)


def _filter_sections_loop(sigma, q, beta, u, Z, out):
    m, n_s = Z.shape[0], Z.shape[1]
    ic = u.shape[1]
    for k in range(u.shape[0]):
        c = 0
        for b in range(m):
            x1 = x2 = 0.0
            for s in range(ic + 1):
                P, Q = Z[b, s, 0], Z[b, s, 1]
                x1 += P * beta[b, 0, s] + Q * beta[b, 1, s]
                x2 += P * beta[b, 1, s] + Q * (q[b] * beta[b, 0, s])
            for s in range(n_s):
                P, Q = Z[b, s, 0], Z[b, s, 1]
                out[k, c], out[k, c + 1] = P, Q
                c += 2
                v = 0.0
                if s < ic:
                    v = u[k, s]
                elif s == ic + 1:
                    v = x1
                elif s == ic + 2:
                    v = x2
                Z[b, s, 0] = sigma[b] * P + q[b] * Q + v
                Z[b, s, 1] = sigma[b] * Q + P
        for j in range(ic):
            out[k, c + j] = u[k, j]


@_compiled(_filter_sections_loop)
def filter_sections(sigma, q, beta, u, Z, out):
    """Filter inputs, impulse and states of sections of second order (`sections`).

    Every pair (P s, Q s) of a signal s obeys P+ = sigma P + q Q + s, Q+ = sigma Q + P.

    Parameters
    ----------
    sigma, q : ndarray of shape (m,)
        Poles sigma +- sqrt(q).
    beta : ndarray of shape (m, 2, nu + 1)
        Input matrix and initial state of every section.
    u : ndarray of shape (L, nu)
        Inputs.
    Z : ndarray of shape (m, nu + 3, 2)
        Pairs of the inputs, of the initial state (no signal: only where it starts) and
        of the two states, at the first sample; overwritten with those after the last.
    out : ndarray of shape (>= L, 2 m (nu + 3) + nu)
        Receives the pairs of every sample, and u.
    """
    m, n_s, _ = Z.shape
    nu, b = u.shape[1], np.arange(m)
    F = np.zeros((m, n_s, 2, n_s, 2))
    for s in range(n_s):
        F[:, s, 0, s] = np.stack([sigma, q], axis=-1)
        F[:, s, 1, s] = np.stack([np.ones(m), sigma], axis=-1)
    beta_1, beta_2 = beta[:, 0], beta[:, 1]
    F[b, nu + 1, 0, : nu + 1] = np.stack([beta_1, beta_2], axis=-1)
    F[b, nu + 2, 0, : nu + 1] = np.stack([beta_2, q[:, None] * beta_1], axis=-1)
    F = F.reshape(m, 2 * n_s, 2 * n_s)
    n = Z.size
    out[: len(u), n:] = u
    for k in range(len(u)):
        out[k, :n] = Z.reshape(-1)
        Z[:] = np.matmul(F, Z.reshape(m, -1, 1)).reshape(Z.shape)
        Z[:, :nu, 0] += u[k]


@functools.cache
def _dsyrk():
    """Return dsyrk of BLAS and the type of its integers; all arguments are pointers."""
    found = LowLevelCallable.from_cython(cython_blas, "dsyrk")
    api = ctypes.pythonapi
    name = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(
        ("PyCapsule_GetName", api)
    )
    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", api)
    )
    address = pointer(found.function, name(found.function))
    integer = ctypes.c_int if " int *" in found.signature else ctypes.c_int64
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 10)(address), integer


def add_square(J, JJ):
    """Add J'J to the lower triangle of JJ, in place.

    Other threads run meanwhile: ctypes releases the GIL, `scipy.linalg.blas` does not.

    Parameters
    ----------
    J : ndarray of shape (m, n)
        C-ordered.
    JJ : ndarray of shape (n, n)
        C-ordered; its upper triangle is left alone.
    """
    for array in (J, JJ):
        if not array.flags.c_contiguous or array.dtype != float:
            raise ValueError("`J` and `JJ` must be C-ordered arrays of type float.")
    dsyrk, integer = _dsyrk()
    m, n = (ctypes.byref(integer(length)) for length in J.shape)
    one = ctypes.byref(ctypes.c_double(1.0))
    # Fortran sees the transposes, and the upper triangle
    dsyrk(b"U", b"N", n, m, one, J.ctypes.data, n, one, JJ.ctypes.data, n)

r"""Models of correlated noise: autoregressions of residuals, forwards and backwards.

The covariance function of a residual v with ny outputs,

    Gamma(l) = E[v_{k+l} v_k'],

determines an autoregression that runs forwards in time and one that runs backwards,

    v_k = sum_i A_i v_{k-i} + e_k,        v_k = sum_i B_i v_{k+i} + f_k,

of which the first makes a residual white and the second colors sensitivities that come
in the order of time (eq. colored).  Both follow from Gamma by the recursion of Whittle,
which is that of Levinson for several outputs.  They are stable if Gamma is that of a
record, sums of products over the length of the record.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh
from scipy.stats import chi2

LAGS_PER_DECADE = 10  # of samples: the highest order, as usual
SAMPLES_PER_ENTRY = 20  # of the coefficients, at least
RIDGE = 1e-10  # relative white noise that keeps outputs with the same noise apart
SETTLED = 1e-4  # of an impulse: the rest of the response does not count
LONGEST = 20_000  # samples of a response, settled or not


class Moments:
    """Collect sums of lagged products of a residual that comes chunk by chunk.

    Parameters
    ----------
    n_lags : int
        Largest lag.
    ny : int
        Number of outputs.

    Examples
    --------
    >>> from alssnn.noise import Moments
    >>> moments = Moments(1, 1)
    >>> moments.start()
    >>> moments.add(np.array([[1.0], [2.0], [np.nan], [4.0]]))
    >>> moments.products[:, 0, 0], moments.pairs[:, 0, 0]
    (array([21.,  2.]), array([3., 1.]))
    """

    def __init__(self, n_lags, ny):
        self.n_lags = n_lags
        self.n_samples = 0
        self.products = np.zeros((n_lags + 1, ny, ny))
        self.pairs = np.zeros((n_lags + 1, ny, ny))
        self.possible = np.zeros(n_lags + 1)
        self.start()

    def start(self):
        """Begin an experiment: no product reaches across the seam."""
        ny = self.products.shape[1]
        self._before = np.zeros((0, ny)), np.zeros((0, ny))

    def add(self, E):
        """Add consecutive samples.

        Parameters
        ----------
        E : ndarray of shape (L, ny)
            Residuals; nan where an output was not measured.
        """
        now = np.nan_to_num(E), (~np.isnan(E)).astype(float)
        value, known = (
            np.concatenate(parts) for parts in zip(self._before, now, strict=True)
        )
        first = len(value) - len(E)
        for lag in range(min(self.n_lags, len(value) - 1) + 1):
            late = slice(max(first, lag), None)
            early = slice(max(first, lag) - lag, len(value) - lag)
            self.products[lag] += value[late].T @ value[early]
            self.pairs[lag] += known[late].T @ known[early]
            self.possible[lag] += len(value) - max(first, lag)
        self.n_samples += len(E)
        keep = max(len(value) - self.n_lags, 0)
        self._before = value[keep:], known[keep:]

    def covariance(self):
        """Return the covariance function, (n_lags + 1, ny, ny).

        Sums are divided by the number of samples, not of pairs, which keeps their
        spectrum positive; by the share of pairs that were measured, where some were
        not. Entries of which no pair was measured are zero: nothing asks for them.

        Returns
        -------
        Gamma : ndarray of shape (n_lags + 1, ny, ny)
            Estimate of E[v_{k+l} v_k'].
        """
        share = self.pairs / np.maximum(self.possible, 1.0)[:, None, None]
        Gamma = self.products / max(self.n_samples, 1)
        return np.divide(Gamma, share, out=np.zeros_like(Gamma), where=share > 0)


@dataclass(frozen=True, eq=False)
class Noise:
    """Hold an autoregression of the noise, in both directions of time.

    Parameters
    ----------
    forward : ndarray of shape (order, ny, ny)
        Coefficients A_1, A_2, ... by the past.
    backward : ndarray of shape (order, ny, ny)
        Coefficients B_1, B_2, ... by the future.
    innovation : ndarray of shape (ny, ny)
        Covariance of what the past does not tell.
    backward_innovation : ndarray of shape (ny, ny)
        Covariance of what the future does not tell.
    p_white : float
        How likely white noise would be as correlated as the residual.

    Examples
    --------
    >>> from alssnn.noise import fit_noise, Moments
    >>> white = np.random.default_rng(0).standard_normal(5000)
    >>> v = np.convolve(white, 0.9 ** np.arange(99))
    >>> moments = Moments(30, 1)
    >>> moments.add(v[:, None])
    >>> fit_noise(moments).forward[0]
    array([[0.9]])
    """

    forward: np.ndarray
    backward: np.ndarray
    innovation: np.ndarray
    backward_innovation: np.ndarray
    p_white: float

    def __repr__(self):
        """Return order and number of outputs."""
        order, ny, _ = self.forward.shape
        return f"Noise(order={order}, ny={ny}, p_white={self.p_white:.2g})"

    @property
    def order(self):
        """Return the order of the autoregression; 0 is white noise."""
        return len(self.forward)

    @property
    def memory(self):
        """Return the number of samples after which an impulse has settled."""
        order, ny, _ = self.forward.shape
        if order == 0:
            return 0
        companion = np.eye(order * ny, k=-ny)
        companion[:ny] = np.hstack(list(self.backward))
        radius = np.max(np.abs(np.linalg.eigvals(companion)))
        if radius >= 1:
            return LONGEST
        samples = np.log(SETTLED) / np.log(max(radius, SETTLED))
        return int(min(np.ceil(samples) + order, LONGEST))

    def rescale(self, scale):
        """Return the noise in other units.

        Parameters
        ----------
        scale : ndarray of shape (ny,)
            Factor of every output.

        Returns
        -------
        noise : Noise
            Noise times the factors.
        """
        ratio, square = scale[:, None] / scale, np.outer(scale, scale)
        return Noise(
            self.forward * ratio,
            self.backward * ratio,
            self.innovation * square,
            self.backward_innovation * square,
            self.p_white,
        )

    def draw(self, n_samples, random_state):
        """Draw normal noise.

        Parameters
        ----------
        n_samples : int
            Number of samples.
        random_state : RandomState instance
            Source of the draws.

        Returns
        -------
        noise : ndarray of shape (n_samples, ny)
            A stretch of the stationary process.
        """
        values, Q = eigh(self.innovation)
        root = np.sqrt(np.maximum(values, 0.0)) * Q
        n = n_samples + self.memory
        white = random_state.standard_normal((n, len(root))) @ root.T
        return _recursion(self.forward, white[:, :, None])[-n_samples:, :, 0]

    def color(self, parts):
        """Yield sensitivities as the noise weighs them (eq. colored).

        Parameters
        ----------
        parts : iterable of ndarray of shape (L, ny, n)
            Consecutive samples of the sensitivities of one experiment.

        Yields
        ------
        Z : ndarray of shape (L, ny, n)
            Z_k = J_k + sum_i B_i' Z_{k-i}, until it has settled behind the record.
        """
        transposed = np.swapaxes(self.backward, 1, 2)
        before, n_columns = None, 0
        for J in parts:
            Z = _recursion(transposed, J, before)
            n_columns = J.shape[2]
            if self.order:
                past = Z if before is None else np.concatenate([before, Z])
                before = past[-self.order :].copy()
            yield Z
        left, chunk = self.memory, 512
        while left > 0 and before is not None:
            silence = np.zeros((min(left, chunk), before.shape[1], n_columns))
            Z = _recursion(transposed, silence, before)
            before = np.concatenate([before, Z])[-self.order :]
            left -= len(silence)
            yield Z

    def whiten(self, parts):
        """Yield signals, and what is left of them behind the whitening filter.

        Parameters
        ----------
        parts : iterable of ndarray of shape (L, ny, n)
            Consecutive samples of one experiment.

        Yields
        ------
        part : ndarray of shape (L, ny, n)
            What came.
        white : ndarray of shape (L, ny, n)
            X_k - sum_i A_i X_{k-i}; nan at the first samples, and behind gaps.
        """
        before = None
        for X in parts:
            if before is None:
                before = np.full((self.order, *X.shape[1:]), np.nan)
            both = np.concatenate([before, X])
            white = X.copy()
            for i, A in enumerate(self.forward, start=1):
                white -= A @ both[self.order - i : len(both) - i]
            before = both[len(both) - self.order :]
            yield X, white


def highest_order(n_samples, ny):
    """Return the highest order of an autoregression worth trying.

    Parameters
    ----------
    n_samples : int
        Number of samples.
    ny : int
        Number of outputs.

    Returns
    -------
    order : int
        Ten per decade of samples, fewer for short records of many outputs.
    """
    by_length = int(LAGS_PER_DECADE * np.log10(max(n_samples, 1)))
    return max(0, min(by_length, n_samples // (SAMPLES_PER_ENTRY * ny)))


def fit_noise(moments):
    """Fit an autoregression, of the order with the least criterion of Akaike.

    Parameters
    ----------
    moments : Moments
        Sums of lagged products of the residual.

    Returns
    -------
    noise : Noise
        White where there is nothing to fit.
    """
    Gamma = moments.covariance()
    ny = Gamma.shape[1]
    size = np.sqrt(np.diag(Gamma[0]))
    size = np.where(size > 0, size, 1.0)
    Gamma = Gamma / np.outer(size, size)
    Gamma[0] += RIDGE * np.eye(ny)
    n = float(np.mean(np.diag(moments.pairs[0])))  # measured samples of an output
    fits = list(_whittle(Gamma))
    deviance = np.array([n * np.linalg.slogdet(V)[1] for _, _, V, _ in fits])
    freedom = ny**2 * np.arange(len(fits))
    order = int(np.argmin(deviance + 2 * freedom))
    gain = deviance[0] - deviance[order]
    p_white = float(chi2.sf(gain, freedom[order])) if order else 1.0
    A, B, V, U = fits[order]
    return Noise(A, B, V, U, p_white).rescale(size)


def _whittle(Gamma):
    """Yield (A, B, covariances of e and f) of the orders 0, 1, ... while stable."""
    ny = Gamma.shape[1]
    A = B = np.zeros((0, ny, ny))
    V = U = Gamma[0]
    yield A, B, V, U
    for p in range(len(Gamma) - 1):
        delta = Gamma[p + 1] - sum(
            (A[i] @ Gamma[p - i] for i in range(p)), np.zeros((ny, ny))
        )
        last, first = np.linalg.solve(U, delta.T).T, np.linalg.solve(V, delta).T
        A, B = (
            np.concatenate([A - last @ B[::-1], last[None]]),
            np.concatenate([B - first @ A[::-1], first[None]]),
        )
        V, U = V - last @ delta.T, U - first @ delta
        V, U = (V + V.T) / 2, (U + U.T) / 2
        if min(np.linalg.eigvalsh(V)[0], np.linalg.eigvalsh(U)[0]) < RIDGE / 2:
            return  # gaps, or a residual that its past tells
        yield A, B, V, U


def _recursion(coefficients, X, before=None):
    """Return Z_k = X_k + sum_i M_i Z_{k-i}, X of shape (L, ny, n)."""
    order = len(coefficients)
    if order == 0:
        return X
    L, ny, n = X.shape
    Z = np.zeros((order + L, ny, n))
    if before is not None:
        Z[order - len(before) : order] = before
    M = np.concatenate(list(coefficients[::-1]), axis=1)  # oldest first
    for k in range(L):
        Z[order + k] = X[k] + M @ Z[k : k + order].reshape(order * ny, n)
    return Z[order:]

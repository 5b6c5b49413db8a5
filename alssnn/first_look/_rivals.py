r"""Descriptions of a record that no model of this package has (eq. rivals).

Each is a linear regression on a few functions of the inputs, judged by the same hidden
samples as the trial fits:

    curve       y_k = f(u_k-d): a curve, and no state
    hysteresis  y_k = sum_j w_j p_j(k) + ...: play operators, whose loops do not shrink
                however slow the input moves
    delay       y_k = sum_i b_i u_(k - i - s): a delay s of its own in every window

Where one of them is much better than every model with a state, the record says that
such a model is the wrong one.
"""

from dataclasses import replace

import numpy as np

from ..regression import lagged

KNOTS = np.linspace(0.1, 0.9, 9)  # of a curve, as shares of the samples
PLAYS = 10  # play operators of an input, up to half of its range
NOW = (0, 1, 2)  # lags of what acts at once, beyond the delay
RIDGE = 1e-6  # relative weight of the coefficients
TAPS = 40  # of the impulse response behind a delay that varies
STRETCH = 50  # samples with one delay
SHIFTS = np.arange(-15, 16)  # samples, against the mean delay
ROUNDS = 6  # of impulse response and shifts in turn


def curve(parts, delays):
    """Return the hidden error of a curve of the inputs.

    Parameters
    ----------
    parts : Parts
        Samples that train and that judge.
    delays : ndarray of int of shape (nu,)
        Samples by which inputs arrive late.

    Returns
    -------
    error : float
        Relative to the standard deviation of the output; the least over the lags of
        the inputs.
    """
    knots = np.quantile(np.vstack([u for u, _ in parts.train]), KNOTS, axis=0)
    return min(
        _error(parts, lambda u, lag=lag: _bent(_late(u, delays + lag), knots))
        for lag in NOW
    )


def hysteresis(parts, delays):
    """Return the hidden error of play operators of the inputs.

    Parameters
    ----------
    parts : Parts
        Samples that train and that judge.
    delays : ndarray of int of shape (nu,)
        Samples by which inputs arrive late.

    Returns
    -------
    error : float
        Relative to the standard deviation of the output.
    """
    u = np.vstack([u for u, _ in parts.train])
    knots = np.quantile(u, KNOTS, axis=0)
    radii = np.ptp(u, axis=0) / 2 * np.arange(1, PLAYS + 1)[:, None] / (PLAYS + 1)

    def columns(u):
        u = _late(u, delays)
        plays = np.hstack([_play(u, radius) for radius in radii])
        return np.hstack([lagged(plays, NOW), lagged(_bent(u, knots), NOW)])

    return _error(parts, columns)


def mirror(parts):
    """Return the hidden error of the inputs as curves of the outputs of the sample.

    Parameters
    ----------
    parts : Parts
        Samples that train and that judge.

    Returns
    -------
    error : float
        Relative to the standard deviation of the inputs.
    """
    y = np.vstack([y for _, y in parts.train])
    knots = np.nanquantile(y, KNOTS, axis=0)
    spread = np.vstack([u for u, _ in parts.train]).std(axis=0)
    turned = replace(
        parts,
        pieces=[(y, u, n) for u, y, n in parts.pieces],
        spread=np.where(spread > 0, spread, 1.0),
    )
    return _error(turned, lambda y: _bent(y, knots))


def _play(u, radius):
    """Return a play operator: its output follows u at a distance of the radius."""
    held = u[0]
    out = np.empty_like(u)
    for k, one in enumerate(u):
        held = np.clip(held, one - radius, one + radius)
        out[k] = held
    return out


def _bent(u, knots):
    """Return u and what bends a line, with kinks and without."""
    return np.hstack([u, *(np.abs(u - knot) ** n for knot in knots for n in (1, 3))])


def _late(u, delays):
    """Return every input later by its delay; at first, as it began."""
    k = np.maximum(np.arange(len(u))[:, None] - delays, 0)
    return np.take_along_axis(u, k, axis=0)


def _error(parts, columns):
    """Return the hidden error of a regression on columns of the inputs."""
    rows = [
        (np.hstack([columns(u), np.ones((len(u), 1))]), y, np.arange(len(u)) < n)
        for u, y, n in parts.pieces
    ]
    X, y, trains = (np.concatenate(z) for z in zip(*rows, strict=True))
    known = np.isfinite(np.hstack([X, y])).all(axis=1)
    size = np.sqrt(np.nanmean(X**2, axis=0))
    X = X / np.where(size > 0, size, 1.0)
    A, b = X[known & trains], y[known & trains]
    w = np.linalg.solve(A.T @ A + RIDGE * len(A) * np.eye(A.shape[1]), A.T @ b)
    hidden = known & ~trains
    return parts.error([(y[hidden], X[hidden] @ w)])


def varying_delay(parts):
    """Return the errors of an impulse response with one delay, and with many.

    Parameters
    ----------
    parts : Parts
        Samples that train and that judge.

    Returns
    -------
    fixed, moving : float
        Errors relative to the standard deviation of the output, of all samples.
    spread : float
        Standard deviation of the delays, in samples. Of a record that is too short, the
        errors are infinite.
    """
    reach = -SHIFTS[0]
    windows = []
    for u, y, _ in parts.pieces:
        X = lagged(u, range(TAPS + 2 * reach)).reshape(len(u), -1, u.shape[1])
        windows += [
            (X[k : k + STRETCH], y[k : k + STRETCH])
            for k in range(TAPS + 2 * reach - 1, len(u) - STRETCH + 1, STRETCH)
        ]
    windows = [(X, y) for X, y in windows if np.isfinite(y).all()]
    if len(windows) * STRETCH < 4 * TAPS * parts.pieces[0][0].shape[1]:
        return np.inf, np.inf, 0.0
    still = np.zeros(len(windows), dtype=int)
    fixed, _ = _with_shifts(parts, windows, still, 1)
    starts = still, _first_shifts(windows)
    found = [_with_shifts(parts, windows, start, ROUNDS) for start in starts]
    moving, shifts = min(found, key=lambda one: one[0])
    return fixed, moving, float(shifts.std())


def _first_shifts(windows):
    """Return where in every window an output is most like an input."""
    peaks = []
    for X, y in windows:
        X, y = X - X.mean(axis=0), y - y.mean(axis=0)
        size = np.linalg.norm(X, axis=0)[..., None] * np.linalg.norm(y, axis=0)
        match = np.abs(np.einsum("kli,kj->lij", X, y)) / np.maximum(size, 1e-300)
        peaks.append(int(np.argmax(match.max(axis=(1, 2)))))
    return np.clip(np.array(peaks) - round(np.mean(peaks)), SHIFTS[0], SHIFTS[-1])


def _with_shifts(parts, windows, shifts, rounds):
    """Fit an impulse response and the shifts of all windows in turn."""

    def at(X, shift):
        part = X[:, shift - SHIFTS[0] : shift - SHIFTS[0] + TAPS]
        return np.column_stack([part.reshape(len(part), -1), np.ones(len(part))])

    y = np.vstack([y for _, y in windows])
    found = []
    for _ in range(rounds):
        A = np.vstack([at(X, s) for (X, _), s in zip(windows, shifts, strict=True)])
        w = np.linalg.lstsq(A, y)[0]
        found.append((parts.error([(y, A @ w)]), shifts))
        left = [
            [np.sum(((y - at(X, s) @ w) / parts.spread) ** 2) for s in SHIFTS]
            for X, y in windows
        ]
        shifts = SHIFTS[np.argmin(left, axis=1)]
    return min(found, key=lambda one: one[0])

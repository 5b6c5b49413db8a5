"""Input delays: the largest that costs neither prediction nor simulation.

Prediction: every output is regressed on its own past and on a long window of all
inputs.  Given that past, an input that has not arrived yet explains nothing, so the
most recent lags can be dropped as long as the residual does not grow significantly.
The past of the output is what makes the first weak response of a smooth plant visible,
which a cross-correlation hides below its band.

Simulation: a smooth input can be foretold from the past of the output alone, which
would excuse any delay one sample ahead.  So linear models are fitted for the delays
that prediction allows, and the largest one whose simulation error is not above the
least by more than chance is taken.  Chance knows of the color of the noise: sums of
squares of slow errors differ by far more than those of white ones.
"""

from numbers import Integral

import numpy as np
from scipy.linalg import qr
from scipy.stats import chi2

from .experiments import last_measured, stretch
from .noise import Moments, fit_noise, highest_order
from .orders import compare_orders
from .regression import Triangle, lagged
from .simulation import runs
from .subspace import identify_linear

PAST = 10  # samples of every output in the regression
TAIL = 20  # lags of every input beyond the largest delay
LEVEL = 1e-4  # chance of calling a response that is none significant
RANK = 1e-7  # relative size of what a lag adds to those before it; below, none
PREDICTED = 20_000  # samples of the regression
SIMULATED = 5_000  # samples on which linear models are compared
STEPS = 5  # of the refinement of each
TRIFLE = 0.001  # relative growth of the simulation error that is none
MARGIN = 2.0  # standard errors of a growth that may be chance


def estimate_delays(experiments, nx, *, feedthrough=False, max_delay=50):
    """Estimate the delay of every input.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; nan where an output was not measured.
    nx : int, sequence of int or "auto"
        Order of the linear models that are compared; of several, one is chosen.
    feedthrough : bool, default=False
        Whether the model responds to u within the same sample; else one sample of
        delay is part of it.
    max_delay : int, default=50
        Largest delay considered, in samples; less where records are short.

    Returns
    -------
    delay : ndarray of int of shape (nu,)
        Samples by which every input arrives late; 0 where no output shows a
        significant response within `max_delay`.

    Notes
    -----
    A response too small to be told from noise counts as delay: on a smooth plant with
    noisy outputs the estimate can exceed the true delay by a few samples.  An input of
    few sinusoids fits every delay; its estimate is 0.

    The regression costs O(N (10 ny + 71 nu)^2) per output; after it, at most one fit
    of a linear model per sample of delay and input.
    """
    experiments = _longest(experiments, PREDICTED)
    delay = _allowed_by_prediction(experiments, feedthrough, max_delay)
    if not delay.any():
        return delay
    experiments = _longest(experiments, SIMULATED)
    if not isinstance(nx, Integral):  # once: a higher order could stand in for a delay
        pairs = _delayed(experiments, delay, delay.max())
        nx = compare_orders(pairs, None if nx == "auto" else nx).nx
    for i in np.flatnonzero(delay):
        trials = np.tile(delay, (delay[i] + 1, 1))
        trials[:, i] = np.arange(delay[i] + 1)
        errors = _simulation_errors(experiments, trials, nx, feedthrough)
        delay[i] = _largest_by_chance(errors)
    return delay


def _allowed_by_prediction(experiments, feedthrough, max_delay):
    """Return, of every input, the largest delay that prediction does not reject."""
    nu, ny = (signal.shape[1] for signal in experiments[0])
    lengths = [len(u) for u, _ in experiments]
    first = 0 if feedthrough else 1
    lags = min(
        max_delay + 1 + TAIL,
        max(lengths) // 2,
        (sum(lengths) // 4 - PAST * ny) // nu,
    )
    candidates = lags - TAIL
    if candidates < 1:
        return np.zeros(nu, dtype=int)
    responds = np.zeros((nu, candidates), dtype=bool)
    for j in range(ny):
        R, rows = _factor(experiments, j, first, lags)
        degrees = rows - R.shape[1] + 1
        if degrees < 1:  # too few samples of this output for a test
            continue
        for i in range(nu):
            growth, residual = _growth(R, i, lags, nu)
            dropped = np.arange(1, candidates + 1)
            threshold = residual / degrees * chi2.isf(LEVEL, dropped)
            responds[i] |= growth[:candidates] > threshold
    return np.where(responds.any(axis=1), responds.argmax(axis=1), 0)


def _longest(experiments, n_samples):
    """Return stretches of the longest experiments, so many samples in all.

    Of many experiments, stretches of all would be too short to show anything.
    """
    chosen, count = [], 0
    for u, y in sorted(experiments, key=lambda pair: -len(pair[0])):
        if count < n_samples:
            chosen.append((u, y))
            count += len(u)
    return stretch(chosen, n_samples)


def _simulation_errors(experiments, delays, nx, feedthrough):
    """Return the errors (N, ny) of a linear model, per row of delays and experiment."""
    before = delays.max()
    errors = []
    for delay in delays:
        pairs = _delayed(experiments, delay, before)
        model = identify_linear(pairs, nx, feedthrough=feedthrough, max_iter=STEPS)
        lure = model.structure.lure(model.structure.join(vars(model)))
        errors.append(
            [
                np.vstack([y[part] - y_hat for part, _, _, y_hat in runs(lure, u, x0)])
                for (u, y), x0 in zip(pairs, model.x0, strict=True)
            ]
        )
    return errors


def _largest_by_chance(errors):
    """Return the last of several models that is worse than the best by chance alone.

    Judged is the sum of d_k = |e_k|^2 - |e_k of the best|^2 by its standard error, that
    of an autoregression of d (eq. margin).
    """
    squares = [[np.nansum(E**2, axis=1) for E in parts] for parts in errors]
    sums = np.array([sum(np.sum(part) for part in parts) for parts in squares])
    least = int(np.argmin(sums))
    count = sum(len(part) for part in squares[least])
    for i in range(len(sums) - 1, least, -1):
        growth = [a - b for a, b in zip(squares[i], squares[least], strict=True)]
        mean = (sums[i] - sums[least]) / count
        spread = _long_run([part - mean for part in growth], count)
        margin = max(MARGIN * np.sqrt(count * spread), 2 * TRIFLE * sums[least])
        if sums[i] - sums[least] <= margin:
            return i
    return least


def _long_run(parts, count):
    """Return the variance of a sum over its number of terms, which are correlated."""
    moments = Moments(min(highest_order(count, 1), max(map(len, parts)) - 1), 1)
    for part in parts:
        moments.start()
        moments.add(part[:, None])
    noise = fit_noise(moments)
    return float(noise.innovation[0, 0] / (1.0 - noise.forward.sum()) ** 2)


def _delayed(experiments, delay, before):
    """Return pairs (u, y) with delayed inputs, all without their first samples."""
    return [
        (
            np.stack(
                [u[before - d : len(u) - d, i] for i, d in enumerate(delay)], axis=1
            ),
            y[before:],
        )
        for u, y in ((np.asarray(u), np.asarray(y)) for u, y in experiments)
        if len(u) > 2 * before
    ]


def _factor(experiments, j, first, lags):
    """Return R of the rows (past outputs, u lags of every input, y_j), and their count.

    The lags of an input stand from the oldest to the most recent.
    """
    nu, ny = (signal.shape[1] for signal in experiments[0])
    triangle = Triangle(PAST * ny + lags * nu + 1)
    for u, y in experiments:
        u, y = np.asarray(u), np.asarray(y)
        past = lagged(last_measured(y), range(1, PAST + 1))
        inputs = [
            lagged(u[:, [i]], range(first + lags - 1, first - 1, -1)) for i in range(nu)
        ]
        triangle.add(np.hstack([past, *inputs, y[:, [j]]]))
    return triangle.factor(), triangle.n_rows


def _growth(R, i, lags, nu):
    """Return how much the residual grows without recent lags of an input (eq. delay).

    Parameters
    ----------
    R : ndarray
        Factor of `_factor`.
    i : int
        The input.
    lags : int
        Lags of every input.
    nu : int
        Number of inputs.

    Returns
    -------
    growth : ndarray of shape (lags,)
        Growth of the sum of squares without the 1, 2, ... most recent lags.
    residual : float
        Sum of squares of the full regression.
    """
    columns = np.arange(R.shape[1])
    base = R.shape[1] - 1 - nu * lags
    own = (columns >= base + i * lags) & (columns < base + (i + 1) * lags)
    order = np.concatenate([columns[:-1][~own[:-1]], columns[own], columns[-1:]])
    S = qr(R[:, order], mode="r")[0]
    size = np.linalg.norm(S, axis=0)
    explained = np.where(np.abs(np.diag(S)) > RANK * size, S[:, -1] ** 2, 0.0)
    return np.cumsum(explained[-2 : -2 - lags : -1]), float(S[-1, -1] ** 2)

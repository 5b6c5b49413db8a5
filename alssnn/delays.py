"""Input delays from cross-correlation.

The response of y to u is estimated by least squares from prewhitened signals: an
autoregressive model of the input makes it white, the same filter is applied to y, and
the cross-correlation of the two is then proportional to the impulse response (Box and
Jenkins).  The delay is the number of lags before the first significant one, beyond the
one sample that a model without feedthrough has anyway.
"""

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import correlate, lfilter

ORDER = 20  # of the autoregressive prewhitening filter
SIGNIFICANCE = 4.0  # standard deviations of a correlation that is truly zero
SHARE = 0.1  # of the largest correlation: leakage of a strong lag is not a response


def estimate_delays(experiments, *, feedthrough=False, max_delay=50):
    """Estimate the delay of every input.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations; missing outputs count as zero.
    feedthrough : bool, default=False
        Whether the model responds to u within the same sample; else one sample of
        delay is part of it.
    max_delay : int, default=50
        Largest delay considered, in samples.

    Returns
    -------
    delay : ndarray of int of shape (nu,)
        Samples by which every input arrives late; 0 where no output shows a
        significant response within `max_delay`.
    """
    nu, ny = (signal.shape[1] for signal in experiments[0])
    first = 0 if feedthrough else 1
    lags = first + max_delay + 1
    correlation = np.zeros((nu, ny, lags))
    count = 0
    for u, y in experiments:
        u, y = np.asarray(u), np.nan_to_num(np.asarray(y))
        for i in range(nu):
            white, filtered = _prewhiten(u[:, i], y)
            for j in range(ny):
                c = correlate(filtered[:, j], white, method="fft")[len(u) - 1 :][:lags]
                scale = float(np.linalg.norm(filtered[:, j]) * np.linalg.norm(white))
                part = np.zeros(lags)
                part[: len(c)] = c / max(scale, np.finfo(float).tiny)
                correlation[i, j] += len(u) * part
        count += len(u)
    size = np.abs(correlation[:, :, first:] / count)
    threshold = np.maximum(
        SIGNIFICANCE / np.sqrt(count), SHARE * size.max(axis=2, keepdims=True)
    )
    responds = (size > threshold).any(axis=1)  # (nu, max_delay + 1)
    return np.where(responds.any(axis=1), responds.argmax(axis=1), 0)


def _prewhiten(u, y):
    """Return u and y under the filter that makes u white."""
    order = min(ORDER, len(u) // 4)
    u = u - u.mean()
    full = correlate(u, u, method="fft")[len(u) - 1 :]
    if order < 1 or not full[0] > 0:
        return u, y
    r = full[: order + 1] / full[0]
    r[0] += 1e-9  # a periodic input is predicted without error
    a = np.concatenate([[1.0], -solve_toeplitz(r[:-1], r[1:])])
    return lfilter(a, 1.0, u), lfilter(a, 1.0, y - y.mean(axis=0), axis=0)

r"""Noise of experiments that had the same input (eq. repeats).

What a plant answers to an input is the same every time, once it has forgotten where it
began.  So of E experiments with one input, what differs between the outputs is noise,

    sigma^2 = sum_k sum_e (y_ek - ybar_k)^2 / sum_k (E - 1),

over the second half of their samples, linear or not, whatever the input is.
"""

import numpy as np

from ..periods import repeated
from .records import Records


def noise_of_repeats(u, y, experiment=None):
    """Return the noise of experiments that had the same input (eq. repeats).

    Parameters
    ----------
    u : array_like of shape (N, nu) or (N,), list of them, or Excitation
        Inputs of all experiments.
    y : array_like of shape (N, ny) or (N,), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.

    Returns
    -------
    noise_rms : ndarray of shape (ny,) or None
        Root mean squares, in the units of the outputs; None if no two experiments had
        the same input, up to rounding, or an output was not measured in both.

    Raises
    ------
    ValueError
        If the signals are no records, or do not fit each other.

    Notes
    -----
    The first half of every experiment is left out, while the plant forgets its initial
    state. An offset that differs between experiments counts as noise.

    Examples
    --------
    >>> from alssnn.nonparametric import noise_of_repeats
    >>> rng = np.random.default_rng(0)
    >>> u = rng.standard_normal((1000, 1))
    >>> y = [u**3 + 0.1 * rng.standard_normal((1000, 1)) for _ in range(3)]
    >>> noise_of_repeats([u, u, u], y).round(2)
    array([0.1])
    """
    return repeated_noise(Records.of(u, y, experiment))


def repeated_noise(records):
    """Return the noise of experiments that had the same input.

    Parameters
    ----------
    records : Records
        The experiments.

    Returns
    -------
    noise_rms : ndarray of shape (ny,) or None
        Root mean squares; None if nothing tells them.
    """
    squares, freedom = np.zeros(records.ny), np.zeros(records.ny)
    for group in repeated([u for u, _ in records.pairs]):
        outputs = [records.pairs[e][1] for e in group]
        n = min(map(len, outputs))
        y = np.stack([one[n // 2 : n] for one in outputs])  # (E, n / 2, ny)
        seen = np.isfinite(y)
        count = seen.sum(axis=0)
        mean = np.where(seen, y, 0.0).sum(axis=0) / np.maximum(count, 1)
        squares += np.sum(np.where(seen, y - mean, 0.0) ** 2, axis=(0, 1))
        freedom += np.sum(np.maximum(count - 1, 0), axis=0)
    return np.sqrt(squares / freedom) if np.all(freedom > 0) else None  # (eq. repeats)

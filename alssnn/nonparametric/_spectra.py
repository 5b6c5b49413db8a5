"""Spectra of periodic records: means over periods, and the noise around them.

P periods of N samples that follow each other have, over P N samples, a DFT in which all
that is periodic stands at multiples of P, and noise alone at the P - 1 bins around each
of them (eq. between).  These bins are samples of the noise that is in the mean over
periods.  What differs between the DFTs of single periods is not quite: a short window
leaks more of a steep spectrum into its valleys.
"""

from dataclasses import dataclass

import numpy as np

from ..checks import count, is_count

EXCITED = 1e-2  # of the largest amplitude: below, a line was not excited
ABOVE_NOISE = 10.0  # power over that of noise at the input, of an excited line
APERIODIC = 0.1  # share of the power of u by which periods may differ: noise
DEPENDENT = 1e-6  # smallest over largest singular value of inputs, scaled
SAME = 0.999  # correlation of two experiments that are one, shifted in time


@dataclass(frozen=True, eq=False)
class Spectra:
    """Hold the spectra of an experiment, as rms values of F = period // 2 + 1 lines.

    Parameters
    ----------
    u, y : ndarray of complex of shape (F, nu) and (F, ny)
        Means over periods.
    u_noise, y_noise : ndarray of complex of shape (n, F, nu) and (n, F, ny)
        Samples of the noise of one period.
    n_periods : int
        Number of periods of the means.
    """

    u: np.ndarray
    y: np.ndarray
    u_noise: np.ndarray
    y_noise: np.ndarray
    n_periods: int


def average(pairs, label, period, n_transient):
    """Return the spectra of experiments that had one input.

    Parameters
    ----------
    pairs : list of tuple of ndarray of shape (N, nu) and (N, ny)
        Inputs and outputs of one or more experiments, whose settled periods count
        alike; outputs are nan where not measured.
    label : object
        Label of the first experiment, for messages.
    period : int
        Samples of a period.
    n_transient : int
        First periods of every experiment to leave out.

    Returns
    -------
    spectra : Spectra
        The spectra, of the periods without a gap.

    Raises
    ------
    ValueError
        If the period does not divide the record, there are no two periods without a gap
        that follow each other, or `u` is not periodic.
    """
    if not is_count(period, 4):
        raise ValueError(
            f"`period` must be the samples of a period, an integer of at least 4, got "
            f"{period!r}. Records that are not periodic are for `local_polynomial`."
        )
    n_transient = count("n_transient", n_transient, 0)
    name = "" if label is None else f" of experiment {label!r}"
    for u, _ in pairs:
        if len(u) % period:
            raise ValueError(
                f"`period` must divide the number of samples, {len(u)}{name}, got "
                f"{period}. Cut the record to whole periods."
            )
    u, y = (
        np.concatenate([z.reshape(-1, period, z.shape[1])[n_transient:] for z in parts])
        for parts in zip(*pairs, strict=True)
    )
    measured = ~np.isnan(y).any(axis=(1, 2))
    n_periods = int(measured.sum())
    runs = np.ma.clump_masked(np.ma.array(measured, mask=measured))
    if max((len(u[run]) for run in runs), default=0) < 2:
        raise ValueError(
            f"`y` must have two complete periods{name} in a row behind the first "
            f"{n_transient}, got {n_periods} complete of {len(y)}. Record more "
            "periods, or lower `n_transient` if the plant had settled. What needs no "
            "two periods is `local_polynomial`, and a `noise_floor` given as a number."
        )
    means, noise = [], []
    for run in runs:
        mean, around = _lines(np.concatenate([u[run], y[run]], axis=2))
        means.append(len(u[run]) * mean)
        noise.append(around)
    mean, around = sum(means) / n_periods, np.concatenate(noise)
    nu = u.shape[2]
    moving = np.sum(np.abs(mean[1:, :nu]) ** 2)
    if np.sum(np.mean(np.abs(around[:, 1:, :nu]) ** 2, axis=0)) > APERIODIC * moving:
        raise ValueError(
            f"`u` must repeat itself after `period` = {period} samples, got periods "
            f"that differ{name}. Check `period`, or take `local_polynomial`."
        )
    return Spectra(
        mean[:, :nu], mean[:, nu:], around[..., :nu], around[..., nu:], n_periods
    )


def _lines(z):
    """Return mean (F, n) and noise (P - 1, F, n) of periods (P, N, n) in a row."""
    P, N, n = z.shape
    lines = np.arange(N // 2 + 1)
    # rms values: their squares add up to the mean square
    scale = np.where((lines == 0) | (2 * lines == N), 1.0, np.sqrt(2)) / (P * N)
    spectrum = np.fft.fft(z.reshape(P * N, n), axis=0)
    around = np.setdiff1d(np.arange(P) - (P - 1) // 2, 0)
    bins = (P * lines + around[:, None]) % (P * N)  # (P - 1, F), (eq. between)
    noise = np.sqrt(P) * spectrum[bins] * scale[:, None]
    return spectrum[P * lines] * scale[:, None], noise


def excited_lines(lines, spectra, period):
    """Return the lines that were excited.

    Parameters
    ----------
    lines : array_like of int or None
        Lines that the user names; None finds them.
    spectra : list of Spectra
        Spectra of the experiments.
    period : int
        Samples of a period.

    Returns
    -------
    lines : ndarray of int
        Lines in ascending order.

    Raises
    ------
    ValueError
        If a line is none between zero and the Nyquist frequency, or none is found.
    """
    last = (period - 1) // 2
    if lines is not None:
        given = np.unique(np.asarray(lines))
        if not (given.dtype.kind in "iu" and len(given)):
            raise ValueError(
                "`lines` must be integers, multiples of the frequency of one period."
            )
        if not 1 <= given[0] <= given[-1] <= last:
            raise ValueError(
                f"`lines` must be from 1 to {last}, below the Nyquist frequency, got "
                f"{given[0]} to {given[-1]} for a period of {period} samples."
            )
        return given
    noise = sum(np.mean(np.abs(s.u_noise) ** 2, axis=0) / s.n_periods for s in spectra)
    power = sum(np.abs(s.u) ** 2 for s in spectra)  # (F, nu)
    power[0], power[last + 1 :] = 0.0, 0.0
    enough = (power > EXCITED**2 * power.max(axis=0)) & (power > ABOVE_NOISE * noise)
    if not enough.any():
        raise ValueError(
            "`u` must move, got inputs without a line above their noise. Name the "
            "excited `lines`, or check the columns of `u`."
        )
    return np.flatnonzero(enough.any(axis=1))


def right_inverse(U, frequencies):
    """Return W with U W = 1.

    Parameters
    ----------
    U : ndarray of complex of shape (n, nu, E)
        Inputs of E experiments at n lines.
    frequencies : ndarray of shape (n,)
        Frequencies of the lines, in Hz, for the message.

    Returns
    -------
    W : ndarray of complex of shape (n, E, nu)
        The least one.

    Raises
    ------
    ValueError
        If inputs depend on each other at a line.
    """
    size = np.sqrt(np.mean(np.abs(U) ** 2, axis=(0, 2)))  # of every input
    scaled = U / np.where(size > 0, size, 1.0)[:, None]
    values = np.linalg.svd(scaled, compute_uv=False)
    poor = values[:, -1] <= DEPENDENT * values[:, 0]
    if poor.any():
        raise ValueError(
            f"`u` must have independent inputs at every excited line, got none at "
            f"{frequencies[np.argmax(poor)]:g} Hz ({poor.sum()} of {len(U)} lines). "
            "Send orthogonal multisines, or name the excited `lines`."
        )
    return np.linalg.pinv(U)


def lines_not_excited(lines, period):
    """Return lines that show distortions, between those that were excited.

    Parameters
    ----------
    lines : ndarray of int
        Excited lines, in ascending order.
    period : int
        Samples of a period.

    Returns
    -------
    beside : ndarray of int
        Lines of their kind: odd ones of an odd grid, else any.
    even : ndarray of int
        Even lines of an odd grid; else none.
    """
    free = np.setdiff1d(np.arange(lines[0], lines[-1] + 1), lines)
    if not np.all(lines % 2):
        return free, np.zeros(0, dtype=int)
    even = np.arange(lines[0] - 1, lines[-1] + 2, 2)
    return free[free % 2 == 1], even[(even > 0) & (2 * even < period)]


def refuse_copies(U, labels):
    """Raise an error if experiments are one signal, shifted: they show no distortion.

    Parameters
    ----------
    U : ndarray of complex of shape (F, nu, E)
        Inputs of E experiments at all lines.
    labels : list
        Labels of the experiments.

    Raises
    ------
    ValueError
        If an experiment repeats the one before it, or the first one.
    """
    energy = np.sum(np.abs(U[1:]) ** 2, axis=(0, 1))  # (E,)
    for e in range(1, U.shape[2]):
        for f in {0, e - 1}:
            product = np.sum(U[..., e] * U[..., f].conj(), axis=1)
            product[0] = 0.0
            # lines count once: a sum over them at every shift in time
            peak = np.abs(np.fft.ifft(product, 2 * len(product))).max()
            if peak * 2 * len(product) > SAME * np.sqrt(energy[e] * energy[f]):
                raise ValueError(
                    f"`u` must hold different realizations, got experiment "
                    f"{labels[e]!r} like {labels[f]!r} but for a shift in time, which "
                    "would hide distortions. Draw random phases by `multisine`; join "
                    "repeated experiments as periods of one."
                )

r"""Multisines: sums of cosines of chosen amplitudes and random phases (eq. multisine).

    u_i(t) = sum over lines k of A_i(k) cos(2 pi k t / period + phi_i(k)).

A plant that is linear answers at these lines alone, and averages over random phases
tell what is linear in one that is not.  The grid says which lines are excited:

    full         all of the band
    odd          odd ones: even nonlinearities answer at even lines, beside them
    odd-random   odd ones but for one of every `group`, drawn at random: odd
                 nonlinearities answer there, and are seen with a single realization

Several inputs share the lines.  A realization then has one experiment per input, in
which all inputs move,

    U(k) = diag(exp(j phi_i)) T diag(exp(j psi_e)) A(k)       (nu, experiments)

with a matrix T whose columns are orthogonal: Hadamard's for 1, 2, 4, 8, ... inputs, of
the DFT for other numbers.  Random psi make the experiments independent of each other.
"""

import numpy as np
from scipy.linalg import dft, hadamard
from sklearn.utils import check_random_state

from ..checks import check_option, count, sampling_time
from ._excitation import repeat
from ._limits import Limits, frequency_band, input_names

GRIDS = ("full", "odd", "odd-random")
HIGHEST = 0.8  # of the Nyquist frequency: above it, anti-aliasing filters cut
CLIPPING = np.linspace(0.75, 0.99, 300)  # level of clipping, relative to the peak


def multisine(
    period=1024,
    nu=1,
    *,
    dt=1.0,
    band=None,
    grid="full",
    group=4,
    spectrum=None,
    reduce_crest=False,
    low=-1.0,
    high=1.0,
    rate=None,
    operating_point=None,
    n_periods=3,
    n_realizations=4,
    names=None,
    random_state=None,
):
    """Make multisines of random phases, orthogonal where there are several inputs.

    Parameters
    ----------
    period : int, default=1024
        Samples of a period; the lines are multiples of 1 / (period dt).
    nu : int, default=1
        Number of inputs; every realization takes as many experiments.
    dt : float, default=1.0
        Sampling time, in seconds.
    band : tuple of float or None, default=None
        Lowest and highest frequency, in Hz; None means up to 80 % of the Nyquist
        frequency.
    grid : {"full", "odd", "odd-random"}, default="full"
        Which lines of the band are excited.
    group : int, default=4
        Of so many odd lines that follow each other one is left out
        (``grid="odd-random"``); at least 2.
    spectrum : callable, array_like or None, default=None
        Amplitudes, of which only ratios count: a function of the frequencies in Hz, or
        an array of shape (n_lines,) or (n_lines, nu); None means equal ones.
    reduce_crest : bool, default=False
        Whether phases are moved until the peaks are low, which gives more power within
        the same limits. The phases are then no longer random: keep it for linear
        plants, since the best linear approximation of others changes with it.
    low : float or array_like of shape (nu,), default=-1.0
        Lowest values of the inputs.
    high : float or array_like of shape (nu,), default=1.0
        Highest values of the inputs.
    rate : float, array_like of shape (nu,) or None, default=None
        Largest change in units per second; the amplitude is lowered to keep it.
    operating_point : float, array_like of shape (nu,) or None, default=None
        Value around which the plant is excited; None means the middle of the limits.
    n_periods : int, default=3
        Periods of every experiment: one to settle and two to see the noise.
    n_realizations : int, default=4
        Independent draws of the phases.
    names : sequence of str or None, default=None
        Names of the inputs; None means u[0], u[1], ...
    random_state : int, RandomState instance or None, default=None
        Seed of phases and grid.

    Returns
    -------
    excitation : Excitation
        The signal. Every realization has the same lines and the same amplitudes.

    Raises
    ------
    ValueError
        If an argument is out of range, limits contradict each other, the band reaches
        the Nyquist frequency or contains too few lines.

    Notes
    -----
    See (eq. multisine). Peaks are reduced by clipping, of all experiments together:
    the waveform is clipped, and of its spectrum the phases are kept, 300 times
    (E. van der Ouderaa, J. Schoukens, J. Renneboog, IEEE Transactions on
    Instrumentation and Measurement 37(1), 1988), by 600 nu FFTs of an input and a
    realization. The first sample of an experiment may be anywhere within the limits:
    bring the plant there slowly if `rate` matters.

    Examples
    --------
    >>> from alssnn.excitation import multisine
    >>> excitation = multisine(
    ...     512, 2, dt=0.1, grid="odd-random", n_realizations=1, random_state=0
    ... )
    >>> excitation.n_experiments, excitation.lines[:6]
    (2, array([ 3,  5,  7,  9, 11, 13]))
    >>> loud = multisine(512, reduce_crest=True, random_state=0)
    >>> bool(loud.crest_factor[0] < 2 < excitation.crest_factor[0])
    True
    """
    period, nu = count("period", period, 8), count("nu", nu)
    n_periods = count("n_periods", n_periods)
    n_realizations = count("n_realizations", n_realizations)
    dt, names = sampling_time(dt), input_names(names, nu)
    limits = Limits.of(nu, low, high, operating_point, rate)
    rng = check_random_state(random_state)
    lines = _lines(period, dt, band, grid, group, rng)
    A = _amplitudes(spectrum, lines / (period * dt), nu)
    T = _orthogonal(nu)
    periods = np.empty((n_realizations, nu, period, nu))
    for m in range(n_realizations):
        phi = rng.uniform(0, 2 * np.pi, (len(lines), nu))
        psi = rng.uniform(0, 2 * np.pi, (len(lines), nu))
        # U (n_lines, experiments, nu): what is left to choose is the phase of the input
        given = (T.T * np.exp(1j * psi)[:, :, None]) * A[:, None, :]
        if reduce_crest:
            phi = _low_peaks(given, phi, lines, period)
        periods[m] = _waveforms(given * np.exp(1j * phi)[:, None, :], lines, period)
    n_periods = count("n_periods", n_periods)
    u = limits.scale(periods, dt, n_periods).reshape(-1, period, nu)
    return repeat(u, dt, limits, n_periods, n_realizations, lines, names, "multisine")


def _lines(period, dt, band, grid, group, rng):
    """Return the lines that are excited."""
    check_option("grid", grid, GRIDS)
    low, high = frequency_band(band, dt, HIGHEST)
    resolution = 1 / (period * dt)
    # a frequency asked for by its decimal digits counts as reached
    first = max(1, int(np.ceil(low / resolution - 1e-9)))
    last = min(int(np.floor(high / resolution + 1e-9)), (period - 1) // 2)
    lines = np.arange(first, last + 1)
    if grid != "full":
        lines = lines[lines % 2 == 1]
    if grid == "odd-random":
        group = count("group", group, 2)
        # whole groups lose one line each; one that is not whole keeps all
        whole = len(lines) // group
        omitted = group * np.arange(whole) + rng.randint(group, size=whole)
        left = np.delete(lines, omitted)
        if not whole or not len(left):
            raise ValueError(
                f"`band` must contain at least `group` = {group} odd lines, got "
                f"{len(lines)} with a resolution of {resolution:g} Hz. Take a longer "
                "period or a wider band."
            )
        lines = left
    if not len(lines):
        raise ValueError(
            f"`band` must contain a line, got none from {low:g} to {high:g} Hz with a "
            f"resolution of {resolution:g} Hz. Take a longer period or a wider band."
        )
    return lines


def _amplitudes(spectrum, frequencies, nu):
    """Return the amplitudes (n_lines, nu), the largest of every input 1."""
    n = len(frequencies)
    values = np.ones(n) if spectrum is None else spectrum
    if callable(values):
        values = values(frequencies)
    values = np.asarray(values, dtype=float)
    if values.shape not in [(n,), (n, nu)]:
        raise ValueError(
            f"`spectrum` must give an amplitude per line, shape ({n},) or ({n}, {nu}), "
            f"got {values.shape}. A function of the frequencies in Hz always fits."
        )
    A = np.array(np.broadcast_to(values.reshape(n, -1), (n, nu)))
    if not np.all(np.isfinite(A) & (A > 0)):
        raise ValueError(
            "`spectrum` must be positive and finite at all lines. Leave lines out by "
            "`band` and `grid`."
        )
    return A / A.max(axis=0)


def _orthogonal(nu):
    """Return T (nu, experiments): unit entries, orthogonal columns."""
    return hadamard(nu).astype(complex) if nu & (nu - 1) == 0 else dft(nu)


def _waveforms(U, lines, period):
    """Return one period (experiments, period, nu) of spectra (n_lines, ..., nu)."""
    spectrum = np.zeros((period // 2 + 1, *U.shape[1:]), dtype=complex)
    spectrum[lines] = U
    return np.moveaxis(np.fft.irfft(spectrum, period, axis=0), 0, 1)


def _low_peaks(given, phi, lines, period):
    """Return phases (n_lines, nu) of lower peaks, by clipping.

    The phases `given` between the experiments have to stay, so that a clipped waveform
    of every experiment votes for the phase of the input.
    """
    best, lowest = phi, np.full(phi.shape[1], np.inf)
    for level in CLIPPING:
        s = _waveforms(given * np.exp(1j * phi)[:, None, :], lines, period)
        peak = np.abs(s).max(axis=(0, 1))  # (nu,), of all experiments
        best = np.where(peak < lowest, phi, best)
        lowest = np.minimum(peak, lowest)
        clipped = np.clip(s, -level * peak, level * peak)
        found = np.moveaxis(np.fft.rfft(clipped, axis=1), 1, 0)[lines]
        phi = np.angle(np.sum(found * np.conj(given), axis=1))
    return best

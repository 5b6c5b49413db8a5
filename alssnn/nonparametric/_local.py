r"""Frequency response of arbitrary records: the local polynomial method (eq. lpm).

The spectrum of a record that is not periodic holds a transient T beside G U, which is
as smooth over frequency as G is.  Within a few lines around a frequency both are
polynomials in the distance r from it,

    Y_e(k + r) = (G_0 + G_1 r + ...) U_e(k + r) + T_e0 + T_e1 r + ... + V_e(k + r),

each experiment e with a transient of its own, and least squares give G = G_0.  What is
left over, by its degrees of freedom, is the covariance of the noise and the distortions
together: only what repeats tells them apart.

A gap in y ends an experiment, and behind it begins another one, with a new transient.
"""

import numpy as np

from ..checks import count, sampling_time
from ..excitation import Excitation
from ._repeats import repeated_noise
from ._response import BestLinearApproximation, error_covariance
from .records import Records

FREEDOM = 8  # degrees of freedom of the noise, at least
LINES = 500  # frequencies at which a long record is evaluated, by default
CHUNK = 500  # frequencies treated at a time
AT_REST = 1e-6  # of the largest line of an input: below, it does not move
DEPENDENT = 1e-7  # of its size: what a column adds to those before it; below, none


def local_polynomial(
    u, y, experiment=None, *, dt=None, degree=2, dof=None, n_frequencies=LINES
):
    """Estimate the frequency response from records of any kind of input.

    Parameters
    ----------
    u : array_like of shape (N, nu) or (N,), list of them, or Excitation
        Inputs of all experiments.
    y : array_like of shape (N, ny) or (N,), or list of them
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample: that of the excitation if `u` is one.
    dt : float or None, default=None
        Sampling time, in seconds; None means that of the excitation, or 1.
    degree : int, default=2
        Degree of the polynomials that stand for G and the transients over a few lines.
    dof : int or None, default=None
        Degrees of freedom that are left for the noise. More of them widen the window:
        smoother, with narrower bands, and biased at resonances. None means the larger
        of 8 and twice the number of outputs.
    n_frequencies : int or None, default=500
        Lines at which the response is evaluated, evenly spread up to the Nyquist
        frequency; None means all lines of the longest experiment.

    Returns
    -------
    approximation : BestLinearApproximation
        Response and its uncertainty. Noise and distortions are not told apart: `noise`,
        `distortion`, `even`, `odd` and `p_linear` are nan, `total` is both. `noise_rms`
        is that of experiments that had the same input (eq. repeats), nan if none had.
        Frequencies at which u does not move have nan.

    Raises
    ------
    ValueError
        If an option is out of range, the stretches without a gap are too short, or the
        inputs are nowhere independent of each other.

    Notes
    -----
    See (eq. lpm). Costs O(n_frequencies n^2 p) with n lines in a window and
    p = (degree + 1) nu unknowns per output, and O(N log N).

    The input must not depend on the noise: not for records of closed loops.

    References
    ----------
    .. [1] R. Pintelon and J. Schoukens, System Identification: A Frequency Domain
       Approach, 2nd edition, Wiley, 2012, section 7.2.

    Examples
    --------
    >>> from alssnn.excitation import steps
    >>> from alssnn.nonparametric import local_polynomial
    >>> excitation = steps(2000, hold=(1, 10), random_state=0)
    >>> u = excitation.u[:, 0]
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(2000)
    >>> y = u + 0.5 * np.r_[0, u[:-1]] + noise
    >>> response = local_polynomial(excitation, y)
    >>> z = np.exp(2j * np.pi * response.frequencies)
    >>> bool(response.covers((1 + 0.5 / z)[:, None, None]).mean() > 0.9)
    True
    """
    if dt is None:
        dt = u.dt if isinstance(u, Excitation) else 1.0
    dt = sampling_time(dt)
    records = Records.of(u, y, experiment)
    degree = count("degree", degree, 0)
    dof = max(FREEDOM, 2 * records.ny) if dof is None else count("dof", dof, 1)
    runs = [run for pair in records.pairs for run in _without_gaps(*pair)]
    runs, widths = _windows(runs, records, degree, dof)
    longest = max(len(u) for u, _ in runs)
    lines = _lines(longest, n_frequencies)
    frequencies = lines / longest  # per sample
    spectra = [
        [np.fft.rfft(z, axis=0)[: (len(z) + 1) // 2] / np.sqrt(len(z)) for z in run]
        for run in runs
    ]
    freedom = int(np.sum(widths - degree - 1)) - (degree + 1) * records.nu
    rows = [
        _fit(frequencies[i : i + CHUNK], spectra, runs, widths, degree, freedom)
        for i in range(0, len(lines), CHUNK)
    ]
    G, W, C, power, left = (np.concatenate(z) for z in zip(*rows, strict=True))
    if np.isnan(G).all():
        raise ValueError(
            "`u` must have inputs that are independent of each other and move at more "
            "than a few frequencies, got none. For multisines take "
            "`best_linear_approximation`."
        )
    # a line of the longest experiment: the squares of all lines add up to a mean square
    total = 2 / longest * np.diagonal(C, axis1=1, axis2=2).real
    everywhere = [
        np.interp(np.arange(1, longest / 2), lines[known], level[known])
        for level, known in zip(2 / longest * left.T, ~np.isnan(left).T, strict=True)
    ]
    unknown, known = np.full_like(total, np.nan), repeated_noise(records)
    covariance = error_covariance(C, W)
    return BestLinearApproximation(
        frequencies=frequencies / dt,
        G=G,
        covariance=covariance,
        noise_covariance=np.full_like(covariance, np.nan),
        dof=freedom,
        output=np.sqrt(2 / longest * power),
        noise=unknown,
        distortion=unknown,
        even=unknown,
        odd=unknown,
        total=np.sqrt(total),
        noise_rms=np.full(records.ny, np.nan) if known is None else known,
        total_rms=np.sqrt(np.sum(everywhere, axis=1)),
        output_rms=np.sqrt(
            np.average([y.var(axis=0) for _, y in runs], axis=0, weights=_lengths(runs))
        ),
        p_linear=np.nan,
        method="local",
        resolution=1 / (longest * dt),
        dt=dt,
        input_names=records.input_names,
        output_names=records.output_names,
    )


def _lines(longest, n_frequencies):
    """Return the lines that are evaluated, evenly spread."""
    lines = np.arange(1, (longest - 1) // 2 + 1)
    n = len(lines) if n_frequencies is None else count("n_frequencies", n_frequencies)
    if len(lines) <= n:
        return lines
    return lines[np.linspace(0, len(lines) - 1, n).round().astype(int)]


def _lengths(runs):
    return [len(u) for u, _ in runs]


def _without_gaps(u, y):
    """Return the stretches (u, y) in which all outputs were measured."""
    measured = ~np.isnan(y).any(axis=1)
    stretches = np.ma.clump_masked(np.ma.array(measured, mask=measured))
    return [(u[part], y[part]) for part in stretches]


def _windows(runs, records, degree, dof):
    """Return the runs that are long enough to count, and the lines of their windows.

    All windows are as wide in frequency. What a run gives beyond its own transient is
    left for G and the noise, so that short ones fall out by themselves.
    """
    own, needed = degree + 1, (degree + 1) * records.nu + dof
    lengths = np.array(_lengths(runs), dtype=int)
    longest = lengths.max(initial=0)
    most = (longest - 1) // 2
    for width in range(own + 1, most + 1):
        widths = np.round(width * lengths / max(longest, 1)).astype(int)
        enough = widths > own
        if np.sum(widths[enough] - own) >= needed:
            kept = [run for run, long in zip(runs, enough, strict=True) if long]
            return kept, widths[enough]
    raise ValueError(
        f"`y` must be measured over stretches long enough for windows of {own + needed}"
        f" lines, got at most {longest} samples between two gaps. Record more, take a "
        "smaller `degree` or `dof`, or fit a model, which may have gaps anywhere."
    )


def _fit(frequencies, spectra, runs, widths, degree, freedom):
    """Fit G and transients around frequencies (n,), in cycles per sample.

    The covariance has as many degrees of freedom as `freedom` says.

    Returns
    -------
    G : ndarray of shape (n, ny, nu)
        Responses.
    W : ndarray of shape (n, p, nu)
        Factor of their covariance, for `error_covariance`.
    C : ndarray of shape (n, ny, ny)
        Covariance of what is left.
    power : ndarray of shape (n, ny)
        Mean square of Y.
    left : ndarray of shape (n, ny)
        What no linear model explains, the diagonal of C; where inputs rest, what the
        others and transients do not explain; nan where G is unknown otherwise.
    """
    blocks, targets = [], []
    power = np.zeros((len(frequencies), spectra[0][1].shape[1]))
    half = max(width / len(u) for width, (u, _) in zip(widths, runs, strict=True)) / 2
    for (U, Y), (u, _), width in zip(spectra, runs, widths, strict=True):
        center = np.round(frequencies * len(u)).astype(int)
        start = np.clip(center - width // 2, 1, len(U) - width)
        index = start[:, None] + np.arange(width)  # (n, width)
        r = (index / len(u) - frequencies[:, None]) / half
        P = r[:, :, None] ** np.arange(degree + 1)  # (n, width, degree + 1)
        A = (U[index][:, :, None, :] * P[..., None]).reshape(*index.shape, -1)
        y = Y[index]
        power += np.sum(np.abs(y) ** 2, axis=1)
        # what the transient of this experiment explains is no matter of G
        Q = np.linalg.qr(P)[0].astype(complex)
        A, y = (z - Q @ (np.swapaxes(Q, 1, 2).conj() @ z) for z in (A, y))
        blocks.append(A)
        targets.append(y)
    A, y = np.concatenate(blocks, axis=1), np.concatenate(targets, axis=1)
    p = A.shape[2]
    nu = p // (degree + 1)
    size = np.sqrt(np.sum(np.abs(A) ** 2, axis=1))  # (n, p)
    largest = np.max([np.abs(U[1:]).max(axis=0) for U, _ in spectra], axis=0)  # (nu,)
    Q, R = np.linalg.qr(A / np.where(size > 0, size, 1.0)[:, None, :])
    poor = np.abs(np.diagonal(R, axis1=1, axis2=2)).min(axis=1) <= DEPENDENT
    rests = size[:, :nu] <= AT_REST * largest
    poor |= np.any(rests, axis=1)
    R[poor] = np.eye(p)
    Qy = np.swapaxes(Q, 1, 2).conj() @ y
    rest = y - Q @ Qy
    inverse = (
        np.linalg.inv(R)[:, :nu] / np.where(poor[:, None], 1.0, size)[:, :nu, None]
    )  # (n, nu, p): rows of G_0
    C = np.einsum("kri,krj->kij", rest, rest.conj()) / freedom
    G = np.swapaxes(inverse @ Qy, 1, 2)
    W = np.swapaxes(inverse, 1, 2)
    for z in (G, W, C):
        z[poor] = np.nan
    left = np.diagonal(C, axis1=1, axis2=2).real.copy()
    for pattern in np.unique(rests[np.any(rests, axis=1)], axis=0):
        # inputs that rest explain nothing there
        here, moved = np.all(rests == pattern, axis=1), np.tile(~pattern, degree + 1)
        Q = np.linalg.qr(A[here][:, :, moved] / size[here][:, None, moved])[0]
        rest = y[here] - Q @ (np.swapaxes(Q, 1, 2).conj() @ y[here])
        left[here] = np.sum(np.abs(rest) ** 2, axis=1) / (freedom + p - moved.sum())
    return G, W, C, power / np.sum(widths), left

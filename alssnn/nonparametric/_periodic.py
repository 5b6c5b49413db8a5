r"""Best linear approximation of periodic records (eq. bla).

E experiments of P steady periods give the spectra U (nu, E) and Y (ny, E), means over
periods, at every line.  The estimate is least squares over experiments (eq. robust),

    G = Y W,     W = U^H (U U^H)^-1,     R = Y - G U,

whether the experiments are orthogonal or merely independent.  Noise is what differs
between periods, C_n; distortion is what differs between realizations beyond it,

    C = R R^H / (E - nu),     C_s = C - C_n / P,     cov(G) = (W' W*) o C.

If E = nu nothing is left of R.  Then C is taken from lines that were not excited and
lie beside (eq. fast): of an odd grid, odd ones for C; even ones show what is even.
"""

import numpy as np
from scipy.special import chdtrc, fdtrc

from ..checks import sampling_time
from ..excitation import Excitation
from ..periods import repeated
from ._response import BestLinearApproximation, error_covariance
from ._spectra import (
    average,
    excited_lines,
    lines_not_excited,
    refuse_copies,
    right_inverse,
)
from .records import Records

NEIGHBORS = 6  # lines over which a level is averaged
ROUNDING = 1e-10  # of the largest line of an output: less is no noise, no distortion


def best_linear_approximation(
    u, y, experiment=None, *, dt=None, period=None, lines=None, n_transient=1
):
    """Estimate the best linear approximation from periodic records.

    Parameters
    ----------
    u : array_like of shape (N, nu) or (N,), list of them, or Excitation
        Inputs of all experiments, which were sent periodically.
    y : array_like of shape (N, ny) or (N,), or list of them
        Outputs, nan where not measured: periods with a gap do not count.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample: that of the excitation if `u` is one.
    dt : float or None, default=None
        Sampling time, in seconds; None means that of the excitation, or 1.
    period : int or None, default=None
        Samples of a period; None means that of the excitation.
    lines : array_like of int or None, default=None
        Lines of the DFT of a period that were excited; None means those of the
        excitation, or those of `u` less than 40 dB below its largest one.
    n_transient : int, default=1
        First periods of every experiment that are left out, while the plant settles.

    Returns
    -------
    approximation : BestLinearApproximation
        Response at the excited lines, its uncertainty, levels of noise and distortion.

    Raises
    ------
    ValueError
        If the record is not one of whole periods, fewer than two of an experiment are
        left, there are fewer experiments than inputs, experiments are copies of each
        other, or nothing is left to tell the distortion from: neither more experiments
        than inputs nor lines that were not excited.

    Notes
    -----
    With more experiments than inputs the distortion is what differs between them
    (eq. robust), which must be realizations of random phases; as many as inputs take
    lines between the excited ones (eq. fast), as ``multisine(grid="odd-random")``
    leaves them. Even and odd levels need an odd grid. Experiments that had the same
    input are one, of more periods.

    The input is taken for known. Noise of a measured input is part of `noise` and of
    the covariance, but it biases G by the square of its ratio to the input.

    Costs O(N log N).

    Examples
    --------
    >>> from alssnn.excitation import multisine
    >>> from alssnn.nonparametric import best_linear_approximation
    >>> excitation = multisine(
    ...     512, grid="odd-random", n_realizations=1, random_state=0
    ... )
    >>> u = excitation.u[:, 0]
    >>> noise = 1e-3 * np.random.default_rng(0).standard_normal(len(u))
    >>> bla = best_linear_approximation(excitation, u + 0.2 * u**2 + noise)
    >>> bla.method, bool(np.all(bla.even > 10 * bla.odd))
    ('fast', True)
    """
    if isinstance(u, Excitation):
        period = u.period if period is None else period
        lines = u.lines if lines is None else lines
        dt = u.dt if dt is None else dt
    records = Records.of(u, y, experiment)
    dt = 1.0 if dt is None else sampling_time(dt)
    groups = repeated([u for u, _ in records.pairs])  # copies are further periods
    nu, E = records.nu, len(groups)
    if E < nu:
        raise ValueError(
            f"`experiment` must name at least as many experiments as there are inputs, "
            f"{nu}, got {E} of different inputs. Send orthogonal multisines, or more "
            "realizations."
        )
    labels = [records.labels[group[0]] for group in groups]
    spectra = [
        average([records.pairs[e] for e in group], label, period, n_transient)
        for group, label in zip(groups, labels, strict=True)
    ]
    U = np.stack([one.u for one in spectra], axis=2)  # (F, nu, E)
    Y = np.stack([one.y for one in spectra], axis=2)  # (F, ny, E)
    period = int(period)
    lines = excited_lines(lines, spectra, period)
    frequencies = lines / (period * dt)
    W = right_inverse(U[lines], frequencies)  # (n, E, nu)
    G = np.zeros((len(U), records.ny, nu), dtype=complex)
    G[lines] = Y[lines] @ W  # (eq. robust)
    of_period, dof_n = _noise(spectra, G)
    C_n = of_period * np.mean([1 / one.n_periods for one in spectra])  # that of Y
    R = Y - G @ U  # at lines that were not excited, Y itself
    C = R @ np.swapaxes(R, 1, 2).conj() / E  # (F, ny, ny)
    beside, even = lines_not_excited(lines, period)
    if E > nu:
        refuse_copies(U, labels)
    method, C[lines], dof = _left_over(C, E, nu, lines, beside)
    tested = [(lines, dof)] if method == "robust" else []
    tested += [(some, E) for some in (beside, even) if len(some)]
    noise, everything, of_period = _power(C_n), _power(C), _power(of_period)
    output = _power(Y @ np.swapaxes(Y, 1, 2).conj() / E)
    distortion = everything - noise  # may be negative by chance
    # the mean of a record is no distortion, but its slow noise is noise
    unexplained = of_period.sum(axis=0) + distortion[1:].sum(axis=0)
    return BestLinearApproximation(
        frequencies=frequencies,
        G=G[lines],
        covariance=error_covariance(C[lines], W),
        noise_covariance=error_covariance(C_n[lines], W),
        dof=dof,
        output=np.sqrt(output[lines]),
        **_levels(of_period, distortion, lines, beside, even, method),
        noise_rms=np.sqrt(of_period.sum(axis=0)),
        total_rms=np.sqrt(np.maximum(unexplained, 0.0)),
        output_rms=np.sqrt(output[1:].sum(axis=0)),
        p_linear=_linear(everything, noise, output, dof_n, tested),
        method=method,
        resolution=1 / (period * dt),
        dt=dt,
        input_names=records.input_names,
        output_names=records.output_names,
    )


def _left_over(C, E, nu, lines, beside):
    """Return the method, what it takes for C at the lines, and the freedom of that."""
    if E > nu:
        return "robust", C[lines] * (E / (E - nu)), E - nu
    if len(beside):  # (eq. fast)
        return "fast", _nearby(C, beside, lines), E * min(NEIGHBORS, len(beside))
    raise ValueError(
        f"`u` must have more experiments than inputs, {nu}, or lines that are not "
        f"excited between those that are, got {E} experiments and no such lines. "
        "Send `multisine(n_realizations=4)` for the robust method, or "
        '`multisine(grid="odd-random")` for the fast one.'
    )


def _noise(spectra, G):
    """Return the covariance (F, ny, ny) of the noise of a period, and its freedom.

    Of y - G u, so that noise of a measured input counts with its effect on G.
    """
    total, dof = 0.0, 0
    for one in spectra:
        e = one.y_noise - np.einsum("pkj,kij->pki", one.u_noise, G)
        total = total + np.einsum("pki,pkj->kij", e, e.conj())
        dof += len(e)
    return total / dof, dof


def _levels(noise, distortion, lines, beside, even, method):
    """Return the levels at lines, means over neighbors, of mean squares (F, ny)."""
    none = np.zeros(0, dtype=int)
    odd_grid = np.all(lines % 2)
    # an odd grid without lines left out shows what is odd between realizations
    odd = beside if len(beside) else lines
    sources = {
        "noise": (noise, np.arange(1, len(noise))),
        "distortion": (distortion, lines if method == "robust" else beside),
        "even": (distortion, even if odd_grid else none),
        "odd": (distortion, odd if odd_grid else none),
    }
    squares = {
        name: np.maximum(_nearby(power, known, lines), 0.0)
        for name, (power, known) in sources.items()
    }
    squares["total"] = squares["noise"] + squares["distortion"]
    return {name: np.sqrt(square) for name, square in squares.items()}


def _nearby(power, known, lines):
    """Return powers (F, ...) at lines, as means over the nearest that are known."""
    if not len(known):
        return np.full((len(lines), *power.shape[1:]), np.nan)
    n = min(NEIGHBORS, len(known))
    start = np.clip(np.searchsorted(known, lines) - n // 2, 0, len(known) - n)
    return np.mean([power[known[start + i]] for i in range(n)], axis=0)


def _power(C):
    """Return the diagonals of covariances, (F, n)."""
    return np.diagonal(C, axis1=1, axis2=2).real.copy()


def _linear(power, noise, output, dof_n, tested):
    """Return how likely a linear plant shows this much power above its noise.

    At a line the quotient has an F distribution; Fisher's sum joins the lines, and
    Bonferroni's factor the outputs.
    """
    floor = ROUNDING**2 * output.max(axis=0) + np.finfo(float).tiny
    statistic, count = 0.0, 0
    for lines, dof in tested:
        ratio = power[lines] / (noise[lines] + floor)
        p = fdtrc(2 * dof, 2 * dof_n, ratio)
        statistic = statistic - 2 * np.log(np.maximum(p, 1e-300)).sum(axis=0)
        count += len(lines)
    p = chdtrc(2 * count, statistic)
    return float(min(1.0, len(p) * p.min()))

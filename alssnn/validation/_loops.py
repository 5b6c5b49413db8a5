"""What a model does at finite amplitudes: sine responses, and the linearized loop.

A linear system has one frequency response; a nonlinear model has one per amplitude, its
describing function: the first harmonic of the output over the sine that made it.  Where
the curves of several amplitudes lie on that of (A, B, C) the loop is linear.
"""

from dataclasses import dataclass

import numpy as np

from ..certificates import linearized_loop
from ..checks import check_option
from ..lure import Lure
from ..plants import as_plant
from ..shown import short_repr
from ..simulation import simulate

SETTLED = 1e-4  # what is left of the transient when the response is measured
MAX_PERIODS = 8  # of the common period, spent on the transient
GROWS = 2.0  # states of the last period over those four before, of what diverges


def frequency_response(sys, frequencies):
    """Return the frequency response of a linear system.

    Parameters
    ----------
    sys : control.StateSpace
        System (A, B, C, D, dt), of continuous time if dt = 0.
    frequencies : array_like of shape (n,)
        Frequencies, in Hz.

    Returns
    -------
    G : ndarray of complex, shape (n, ny, nu)
        C (z I - A)^-1 B + D at z = exp(2 pi j f dt), or at 2 pi j f; not finite at an
        undamped pole.
    """
    s = 2j * np.pi * np.asarray(frequencies)
    point = s if sys.dt == 0 else np.exp(s * sys.dt)
    return np.moveaxis(sys(point, squeeze=False, warn_infinite=False), -1, 0)


def sine_response(model, amplitude, *, loop="open", input=0, n_frequencies=40, period):
    """Return the response of a model to sines of one amplitude.

    All frequencies are harmonics of a common period, and are simulated side by side
    until the transient has settled.

    Parameters
    ----------
    model : estimator
        Fitted model.
    amplitude : float
        Amplitude of the sine, in the units of the input.
    loop : {"open", "closed"}, default="open"
        Whether the sine is u, or v of the loop u = v - h(s).
    input : int, default=0
        Column of the input; the others rest at the operating point.
    n_frequencies : int, default=40
        Number of frequencies, spaced evenly on a logarithmic axis.
    period : int
        Samples of the common period; the lowest frequency is 1 / (period dt).

    Returns
    -------
    frequencies : ndarray of shape (n,)
        Frequencies, in Hz.
    G : ndarray of complex, shape (n, ny)
        First harmonic of the outputs over the sine; nan where it diverges.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If an argument is out of range, or u = v - h is no law of this model.

    Notes
    -----
    Costs at most 9 periods of simulation, all frequencies at once.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.validation import sine_response
    >>> _, small = sine_response(model, 0.1, period=64, n_frequencies=4)
    >>> _, large = sine_response(model, 10.0, period=64, n_frequencies=4)
    >>> np.allclose(small, large)  # linear: the amplitude does not matter
    True
    """
    if not (np.isfinite(amplitude) and amplitude > 0):
        raise ValueError(
            f"`amplitude` must be positive, got {amplitude}. Give it in the units of u."
        )
    remedy = "Take 'closed' for the loop u = v - h(s)."
    check_option("loop", loop, ("open", "closed"), remedy)
    plant = as_plant(model).late()
    if loop == "closed":
        plant = plant.linearized()
    if not 0 <= input < plant.nu:
        raise ValueError(
            f"`input` must be between 0 and {plant.nu - 1}, got {input}. Columns of "
            "the input count from 0."
        )
    harmonics = _harmonics(period, n_frequencies)
    radius = np.abs(np.linalg.eigvals(plant.linear()[0])).max()
    settle = MAX_PERIODS
    if radius < 1:
        samples = np.log(SETTLED) / np.log(max(radius, SETTLED))
        settle = min(int(np.ceil(samples / period)), MAX_PERIODS)
    X = np.zeros((len(harmonics), plant.nx))
    U = np.tile(plant.u_offset, (len(harmonics), 1))
    G = np.zeros((len(harmonics), plant.ny), dtype=complex)
    size = np.zeros((settle + 1, len(harmonics)))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range((settle + 1) * period):
            turn = 2 * np.pi * harmonics * (k % period) / period
            U[:, input] = plant.u_offset[input] + amplitude * np.sin(turn)
            if k >= settle * period:  # y = Im(amplitude G exp(j turn))
                y = plant.output(X, U) - plant.y_offset
                G += y * np.exp(-1j * turn)[:, None]
            X = plant.step(X, U)
            np.fmax(size[k // period], np.abs(X).max(axis=1), out=size[k // period])
        G *= 2j / (period * amplitude)
    lost = ~np.isfinite(G).all(axis=1)
    if radius >= 1:  # what is not yet too large for a number; a ramp is 9 / 5 as large
        lost |= size[-1] > GROWS * size[MAX_PERIODS // 2]
    G[lost] = np.nan
    return harmonics / (period * plant.dt), G


def _harmonics(period, n):
    """Return harmonics of the period below the Nyquist frequency."""
    if period < 8 or n < 1 or period % 1 or n % 1:
        raise ValueError(
            "`period` must be an integer of at least 8 samples and `n_frequencies` one "
            f"of at least 1, got {period} and {n}. Enlarge them."
        )
    return np.unique(np.geomspace(1, (period - 1) // 2, n).round().astype(int))


@dataclass(frozen=True, eq=False)
class LoopDeviation:
    """Hold states of the linearized loop and their distance from the linear ones.

    Parameters
    ----------
    X : ndarray of shape (N, nx)
        States of the loop x+ = (A - B K) x + B r + omega, past values of late inputs
        behind those of `A_`; inf where it diverges.
    Z : ndarray of shape (N, nx)
        Their deviation zeta from the linear loop with the same r and x0, which obeys
        zeta+ = (A - B K) zeta + omega from zeta = 0: it stays in the invariant set.

    Examples
    --------
    >>> record = alssnn.datasets.make_pendulum(600, noise=0.01, random_state=0)
    >>> model = alssnn.FlSsnn(nx=2, n_h=3, n_init=1, random_state=0)
    >>> model = model.fit(*record)
    >>> from alssnn.validation import loop_deviation
    >>> (run,) = loop_deviation(model, *record)
    >>> run.X.shape == run.Z.shape == (600, 2)
    True
    """

    __repr__ = short_repr

    X: np.ndarray
    Z: np.ndarray


def loop_deviation(model, u, y, experiment=None, *, K=None):
    """Simulate the loop u = v - h, with recorded inputs as v or r.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu)
        Inputs of the loop.
    y : array_like of shape (N,) or (N, ny)
        Outputs; they set the initial states.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    K : array_like of shape (nu, nx) or None, default=None
        State feedback v = r - K x, in the basis of `A_`.

    Returns
    -------
    runs : list of LoopDeviation
        One run per experiment.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If `K` has the wrong shape, the data do not fit the model, or u = v - h is no
        law of this model.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.validation import loop_deviation
    >>> (run,) = loop_deviation(model, *record)
    >>> bool(abs(run.Z).max() < 1e-12)  # linear: nothing deviates
    True
    """
    plant = as_plant(model).late()
    loop, (nx, nu) = linearized_loop(plant, K), (plant.nx, plant.nu)
    linear = Lure(np.hstack([loop.M[:nx], np.zeros((nx, 1))]), nx, nu, 0)
    runs = []
    for record in model.prepare_records(u, y, experiment):
        r = record.u - plant.u_offset  # and disturbances as they were
        x0 = np.pad(record.x0, (0, nx - len(record.x0)))  # late inputs rested
        X = simulate(loop, r, x0, plant.x_scale)[:-1]
        with np.errstate(invalid="ignore"):
            Z = X - simulate(linear, r, x0, plant.x_scale)[:-1]
        runs.append(LoopDeviation(X, Z))
    return runs

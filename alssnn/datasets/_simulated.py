"""Plants simulated in discrete time, each returned with its true model.

Wiener-Hammerstein plant: a static nonlinearity between two linear filters,

    v = G1 u,      w = f(v),      y = G2 w,

after the electronic circuit of the SYSID 2009 benchmark [1]_: G1 is a third-order
Chebyshev low-pass filter, f a saturation by a diode, G2 a third-order inverse Chebyshev
low-pass filter. The filters are designed in continuous time and discretized behind a
zero-order hold,

    x1+ = A1 x1 + B1 u,     v = C1 x1,          x2+ = A2 x2 + B2 w,     y = C2 x2.

A filter of odd order falls off at high frequency, so neither has a feedthrough term,
and the plant has the form of the models of this package without an extra delay state:

    x+ = A x + B u + g(x),     y = C x,     x = (x1, x2)  (6 states)

    A = [ A1     0  ]    B = [ B1 ]    C = [ 0  C2 ]    g(x) = [ 0                    ]
        [ B2 C1  A2 ]        [ 0  ]                            [ B2 (f(C1 x1) - C1 x1) ]

(A digital Chebyshev design has feedthrough in both filters; making it strictly proper
by a delay costs a seventh state.) Because f'(0) = 1, (A, B, C) is also the
linearization at the origin. The first two samples of the impulse response of the plant
are zero, one per filter.

.. [1] J. Schoukens, J. Suykens, L. Ljung, "Wiener-Hammerstein benchmark", 15th IFAC
   Symposium on System Identification (SYSID), Saint-Malo, 2009.
"""

import numpy as np
from sklearn.utils import check_random_state

from ._checks import _check_positive, _check_samples
from ._plants import _add_noise, _sampled_plant
from ._record import Record

SAMPLING_RATE = 51_200.0  # Hz, of the benchmark
INPUT_CUTOFF = 10_000.0  # Hz, of the Gaussian input, as in the benchmark
SATURATION = 0.6  # V, forward voltage of a silicon diode
# The slowest pole, 0.906, and the input filter forget their start to below 1e-20.
N_WARMUP = 1_000  # samples


def make_wiener_hammerstein(
    n_samples=20_000, *, noise=0.0, amplitude=0.7, random_state=None
):
    r"""Simulate a Wiener-Hammerstein circuit with a one-sided saturation.

    A third-order Chebyshev low-pass filter (type I, ripple 0.5 dB up to 4.4 kHz), a
    static saturation, and a third-order inverse Chebyshev low-pass filter (type II,
    40 dB from 5 kHz), sampled at 51,200 Hz. The saturation acts on one sign only,

    .. math::

        f(v) = v \text{ if } v \le 0, \qquad
        f(v) = v_s \tanh(v / v_s) \text{ if } v > 0, \qquad v_s = 0.6\text{ V},

    and is twice continuously differentiable.

    Parameters
    ----------
    n_samples : int, default=20000
        Number of samples.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    amplitude : float, default=0.7
        Standard deviation of the input, in volts. It sets how nonlinear the record is.
    random_state : int, RandomState instance or None, default=None
        Seed of input and noise. One seed gives the same noise-free record for every
        `noise`, and longer records continue shorter noise-free ones.

    Returns
    -------
    record : Record
        Input and output, in volts, `dt` = 1 / 51200 s. `record.plant` is the true
        plant, a discrete-time `control.NonlinearIOSystem` with 6 states, input ``u``
        and output ``y``; started from `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or `noise` or `amplitude` not a number.
    ValueError
        If `n_samples` or `amplitude` is not positive, or `noise` is negative.

    See Also
    --------
    fetch_wiener_hammerstein : The measured record of the real circuit.

    Notes
    -----
    The input is white Gaussian noise through a sixth-order Butterworth low-pass filter
    at 10 kHz, a stationary record: the first 1,000 samples are discarded.

    At the default amplitude the best linear model (150 taps, offset) leaves 17 % of the
    standard deviation of the output, as for the real circuit (18 %); at 0.2 V it leaves
    3 %, at 2 V 34 %.

    The filters are the zero-order-hold equivalents of analog ones, so that the plant is
    strictly proper with exactly 6 states; the hold shifts the edges slightly (0.6 dB at
    4.4 kHz, at least 39 dB from 5 kHz to the Nyquist frequency).

    Examples
    --------
    >>> from alssnn.datasets import make_wiener_hammerstein
    >>> record = make_wiener_hammerstein(1000, noise=0.01, random_state=0)
    >>> u, y = record
    >>> u.shape, y.shape
    ((1000, 1), (1000, 1))
    >>> record.plant.nstates
    6
    """
    _check_samples(n_samples, noise)
    _check_positive("amplitude", amplitude, "Give the standard deviation in volts.")
    rng = check_random_state(random_state)
    dt = 1 / SAMPLING_RATE
    filters = _wiener_hammerstein_filters(dt)
    (A1, B1, C1), (A2, B2, C2) = filters

    u = amplitude * _band_limited_noise(N_WARMUP + n_samples, dt, rng)  # (N,)
    X1 = _filter_states(A1, B1, u)  # (N, 3)
    X2 = _filter_states(A2, B2, _saturate(X1 @ C1[0]))  # (N, 3)
    y = X2 @ C2[0]  # (N,)

    u, y = u[N_WARMUP:], y[N_WARMUP:]
    x0 = np.concatenate([X1[N_WARMUP], X2[N_WARMUP]])
    y = _add_noise(y, noise, rng)
    plant = _wiener_hammerstein_plant(filters, dt)
    return Record(u, y, dt, "simulated Wiener-Hammerstein", plant, x0)


def _band_limited_noise(n_samples, dt, rng):
    """Draw Gaussian noise of unit variance, band-limited to INPUT_CUTOFF."""
    from scipy import signal  # slow to import

    sos = signal.butter(6, INPUT_CUTOFF, fs=1 / dt, output="sos")
    impulse_response = signal.sosfilt(sos, signal.unit_impulse(N_WARMUP))
    # The true gain, not that of the sample: a longer record continues a shorter one.
    gain = np.linalg.norm(impulse_response)
    return signal.sosfilt(sos, rng.standard_normal(n_samples)) / gain


def _wiener_hammerstein_filters(dt):
    """Return (A, B, C) of the filters before and after the nonlinearity."""
    # In radians per sample: the matrices stay of order one, whatever the sampling rate.
    from scipy import signal  # slow to import

    radians = 2 * np.pi * dt
    designs = (
        signal.cheby1(3, 0.5, 4_400 * radians, analog=True, output="zpk"),
        signal.cheby2(3, 40, 5_000 * radians, analog=True, output="zpk"),
    )
    return [
        signal.cont2discrete(signal.zpk2ss(*zpk), 1.0, method="zoh")[:3]
        for zpk in designs
    ]


def _filter_states(A, B, u):
    """Return the states, of shape (N, nx), of x+ = A x + B u started at rest."""
    from scipy import signal  # slow to import

    nx = len(A)
    # One transfer function per state: compiled, where a recursion in Python is not.
    numerators, denominator = signal.ss2tf(A, B, np.eye(nx), np.zeros((nx, 1)))
    return np.column_stack(
        [signal.lfilter(numerator, denominator, u) for numerator in numerators]
    )


def _saturate(v):
    """Limit positive voltages smoothly to SATURATION; leave negative ones alone."""
    return np.where(v > 0, SATURATION * np.tanh(v / SATURATION), v)


def _wiener_hammerstein_plant(filters, dt):
    """Return the plant as a discrete-time control.NonlinearIOSystem."""
    (A1, B1, C1), (A2, B2, C2) = filters
    n1 = len(A1)

    def step(x, u):
        x1, x2 = x[:n1], x[n1:]
        return np.concatenate([A1 @ x1 + B1 @ u, A2 @ x2 + B2 @ _saturate(C1 @ x1)])

    names = (["u"], ["y"], n1 + len(A2))
    return _sampled_plant(step, lambda x: C2 @ x[n1:], dt, names, "wiener_hammerstein")

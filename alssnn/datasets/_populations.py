"""Populations: a plant whose nonlinearity no feedback law cancels."""

from functools import partial

import numpy as np
from sklearn.utils import check_random_state

from ._checks import _check_numbers, _check_positive, _check_samples
from ._plants import _recorded, _runge_kutta, _simulate


def make_prey_predator(
    n_samples=50_000,
    *,
    noise=0.0,
    a=(0.2, 0.1),
    b=(0.01, 0.01),
    c=(0.05, 0.05),
    d=(1.0, 1.0),
    e=0.5,
    f=0.02,
    g=0.02,
    amplitude=2.0,
    phases=(0.0, 1.0),
    x0=(30.0, 30.0, 20.0),
    dt=0.05,
    random_state=None,
):
    r"""Simulate two competing preys and their predator.

    .. math::

        \dot x_1 &= a_1 x_1 - b_1 x_1 x_2 - c_1 x_1 x_3 + d_1 u_1^2 \\
        \dot x_2 &= a_2 x_2 - b_2 x_1 x_2 - c_2 x_2 x_3 + d_2 u_2^2 \\
        \dot x_3 &= -e x_3 + f x_1 x_3 + g x_2 x_3, \qquad y = x_3

    The inputs, :math:`u_i(t) = A \sin(t + \varphi_i) + A \sin(t / 10 + \varphi_i)`,
    feed the preys, only the predator is measured, and no feedback law cancels the
    nonlinearity: the plant of the paper [1]_ for which a residual must remain.

    Parameters
    ----------
    n_samples : int, default=50000
        Number of samples; the paper trains on the first half.
    noise : float, default=0.0
        Standard deviation of the white Gaussian measurement noise, relative to that of
        the noise-free output.
    a, b, c, d : tuple of two floats
        Growth of the preys, competition between them, hunting, and food, all per
        second; (0.2, 0.1), (0.01, 0.01), (0.05, 0.05) and (1, 1).
    e : float, default=0.5
        Mortality of the predator, per second.
    f, g : float, default=0.02
        Growth of the predator by the first and the second prey, per second.
    amplitude : float, default=2.0
        Amplitude A of both sines of both inputs.
    phases : tuple of two floats, default=(0.0, 1.0)
        Phases of the two inputs, in rad.
    x0 : tuple of three floats, default=(30.0, 30.0, 20.0)
        Populations at the first sample.
    dt : float, default=0.05
        Sampling time, in seconds.
    random_state : int, RandomState instance or None, default=None
        Seed of the noise; the noise-free record has nothing random.

    Returns
    -------
    record : Record
        Two inputs and one output. `record.plant` is the true plant, a discrete-time
        `control.NonlinearIOSystem` with 3 states, inputs ``u1``, ``u2`` and output
        ``x3``; started from `record.x0` it reproduces the noise-free output.

    Raises
    ------
    TypeError
        If `n_samples` is not an integer, or a scalar argument not a number.
    ValueError
        If a scalar argument or `x0` is not positive (`noise`: negative), if a pair is
        not two finite numbers, or if a population does not stay positive and finite.

    See Also
    --------
    make_pendulum : A plant whose nonlinearity a feedback law cancels.

    Notes
    -----
    The last coupling of the second equation is printed as :math:`c_2 x_1 x_3` in the
    paper, with which the populations diverge; :math:`c_2 x_2 x_3`, the loss of the
    second prey to its predator, keeps them bounded, and is used here.

    The record starts with a transient from `x0`, which lasts about 1,000 samples
    (50 s); then the populations follow the inputs, with the period of 62.8 s of the
    slow sines. After
    it, std(y) is 1.48 around a mean of 7.3 (1.59 over the whole record), with the
    default arguments, and all populations stay between 1.7 and 30.

    The plant is the sampled map of one Runge-Kutta step of order 4 per sample, 1e-6
    from the differential equation.

    References
    ----------
    .. [1] M. Thieffry, A. Hache, M. Yagoubi and P. Chevrel, "Identification for
       control based on neural networks: approximately linearizable models".

    Examples
    --------
    >>> from alssnn.datasets import make_prey_predator
    >>> record = make_prey_predator(2000)
    >>> record.u.shape, record.y.shape
    ((2000, 2), (2000, 1))
    >>> train, test = record.split(0.5)
    """
    _check_samples(n_samples, noise)
    (a1, a2), (b1, b2), (c1, c2), (d1, d2) = (
        _check_numbers(name, pair, 2, "Give one number per prey.")
        for name, pair in (("a", a), ("b", b), ("c", c), ("d", d))
    )
    for name, rate in (("e", e), ("f", f), ("g", g)):
        _check_positive(name, rate, "Give a rate per second.")
    _check_positive("amplitude", amplitude, "Give the amplitude of the sines.")
    _check_positive("dt", dt, "Give the sampling time in seconds.")
    phases = _check_numbers("phases", phases, 2, "Give one phase per input, in rad.")
    x0 = _check_numbers("x0", x0, 3, "Give one population per species.")

    def derivative(x, u):
        x1, x2, x3 = x
        u1, u2 = u
        return (
            a1 * x1 - b1 * x1 * x2 - c1 * x1 * x3 + d1 * u1 * u1,
            a2 * x2 - b2 * x1 * x2 - c2 * x2 * x3 + d2 * u2 * u2,
            -e * x3 + f * x1 * x3 + g * x2 * x3,
        )

    step = partial(_runge_kutta, derivative, dt, 1)
    t = np.arange(n_samples)[:, None] * dt  # (N, 1)
    u = amplitude * (np.sin(t + phases) + np.sin(t / 10 + phases))  # (N, 2)
    X = _simulate(step, u, x0)  # (N, 3)
    if not (np.all(X > 0) and np.all(np.isfinite(X))):
        raise ValueError(
            f"`x0` must lead to positive and finite populations, got {x0}. Start from "
            "positive populations, use the default rates, or lower `dt`."
        )
    signals = ["u1", "u2"], ["x3"], ["x1", "x2", "x3"]
    names = "prey_predator", "simulated prey and predator", *signals
    rng = check_random_state(random_state)
    return _recorded(step, u, X, 0, [2], dt, noise, rng, names)

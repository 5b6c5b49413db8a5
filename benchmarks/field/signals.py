"""Excitations, and the simulation of differential equations under them."""

from collections.abc import Callable
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

# -- inputs of shape (N,) --------------------------------------------------------------


def steps(rng, N, low, high, shortest=10, longest=60):
    """Return steps of random height that last for a random time."""
    n = N // shortest + 1
    lasting = rng.integers(shortest, longest + 1, n)
    return np.repeat(rng.uniform(low, high, n), lasting)[:N]


def multisine(rng, N, rms, low=0.0, high=0.1):
    """Return sines of random phase on all lines of a band, in units of 1/dt."""
    lines = np.zeros(N // 2 + 1, complex)
    band = slice(max(1, int(low * N)), int(high * N) + 1)
    lines[band] = np.exp(2j * np.pi * rng.random(len(lines[band])))
    u = np.fft.irfft(lines, N)
    return rms * u / u.std()


def levels(rng, N, values, hold=5):
    """Return a random sequence of few levels, each held for multiples of `hold`."""
    return np.repeat(rng.choice(values, N // hold + 1), hold)[:N]


# -- simulation ------------------------------------------------------------------------

_listeners: list = []


class Simulation(NamedTuple):
    """Hold what was simulated, for who wants to go on with other inputs."""

    update: Callable  # (x, u) -> the next x, lists of floats
    law: Callable | None  # (x, r) -> u of a sampled controller
    X: np.ndarray  # states, of shape (N, nx)
    U: np.ndarray  # inputs, of shape (N, nu): what the law gives, if there is one


@contextmanager
def heard():
    """Collect all simulations that are run meanwhile."""
    _listeners.append(simulations := [])
    try:
        yield simulations
    finally:
        _listeners.remove(simulations)


def _tell(*parts):
    for simulations in _listeners:
        simulations.append(Simulation(*parts))


def simulate(derivative, x, u, dt, n_steps=4, law=None):
    """Return states and inputs at the samples, of shape (N, nx) and (N, nu).

    x' = derivative(x, u), with u constant between samples, by `n_steps` steps of the
    classical Runge-Kutta method per sample. With a `law`, u is the reference of a
    sampled controller, and the input is law(x, u).
    """

    def update(x, u):
        return _runge_kutta(derivative, x, u, dt / n_steps, n_steps)

    return _run(update, x, u, law)


def _run(update, x, u, law=None):
    # lists: ten times faster than arrays of few elements
    X, U, x = [], [], list(map(float, x))
    for r in np.asarray(u, dtype=float).reshape(len(u), -1).tolist():
        v = r if law is None else law(x, r)
        X.append(x)
        U.append(v)
        x = update(x, v)
    X, U = np.array(X), np.array(U)
    _tell(update, law, X, U)
    return X, U


def _runge_kutta(derivative, x, u, step, n_steps):
    half, sixth = step / 2, step / 6
    for _ in range(n_steps):
        k1 = derivative(x, u)
        k2 = derivative([a + half * b for a, b in zip(x, k1, strict=True)], u)
        k3 = derivative([a + half * b for a, b in zip(x, k2, strict=True)], u)
        k4 = derivative([a + step * b for a, b in zip(x, k3, strict=True)], u)
        slopes = zip(x, k1, k2, k3, k4, strict=True)
        x = [a + sixth * (p + 2 * (q + r) + s) for a, p, q, r, s in slopes]
    return x


def iterate(update, x, u):
    """Return the states, of shape (N, nx), of x+ = update(x, u)."""
    return _run(update, x, u)[0]


def filtered(b, a, u, delay=0):
    """Return the response of a filter in z^-1, one sample late, at rest before."""
    from scipy.signal import lfilter

    y = lfilter(b, a, u, axis=0)
    late = np.zeros_like(y)
    late[1 + delay :] = y[: len(y) - 1 - delay]
    return late

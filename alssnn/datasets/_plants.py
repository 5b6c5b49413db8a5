"""Plants simulated in continuous time, each returned with its exact sampled model.

Every plant is a differential equation

    x' = f(x, u),      y = some of x,

driven through a zero-order hold: u is constant between two samples. One sampling
interval is integrated by n steps of the classical Runge-Kutta method of order 4
(`_runge_kutta`), which defines a discrete-time map

    x+ = F(x, u).

F generates the record and is the update of `record.plant`, so that plant and record
agree to the last bit, and a sampled controller closes its loop around F without an
integrator between them. The makers say how far F is from the differential equation; no
plant here has a feedthrough, and the outputs are always states.
"""

import math

import numpy as np

from ._record import Record

STABLE = 2.785  # decay over a step of `_runge_kutta`, from which it grows instead


def _runge_kutta(derivative, dt, n_steps, x, u):
    """Integrate x' = derivative(x, u) over `dt` with constant u; lists, not arrays."""
    # Plain floats: ten times faster than arrays of two or three elements.
    step = dt / n_steps
    half, sixth = step / 2, step / 6
    for _ in range(n_steps):
        k1 = derivative(x, u)
        k2 = derivative([xi + half * ki for xi, ki in zip(x, k1, strict=True)], u)
        k3 = derivative([xi + half * ki for xi, ki in zip(x, k2, strict=True)], u)
        k4 = derivative([xi + step * ki for xi, ki in zip(x, k3, strict=True)], u)
        slopes = zip(x, k1, k2, k3, k4, strict=True)
        x = [xi + sixth * (p + 2 * (q + r) + s) for xi, p, q, r, s in slopes]
    return x


def _simulate(step, u, x):
    """Return the states, of shape (N, nx), visited under u of shape (N, nu).

    Those of a run that diverges are one row of infinities.
    """
    X, diverged = [], np.full((1, len(x)), np.inf)
    for u_k in u.tolist():
        X.append(x)
        if not math.isfinite(sum(x)):
            return diverged
        try:
            x = step(x, u_k)
        except ValueError:  # math.sin refuses infinity
            return diverged
    return np.array(X)


def _check_slow(X, name, value, what, dt, remedy, *, decay=0.0):
    """Refuse a run that has diverged, or whose decay over a step makes it do so."""
    if not (np.all(np.isfinite(X)) and decay < STABLE):
        raise ValueError(
            f"`{name}` must keep the {what} slow for its sampling time of {dt} s, got "
            f"{value}. {remedy}"
        )


def _add_noise(y, noise, rng):
    """Add white noise, drawn after the input, which does not depend on it."""
    if noise == 0:
        return y
    return y + noise * y.std(axis=0) * rng.standard_normal(y.shape)


def _sampled_plant(step, output, dt, names, name):
    """Return x+ = step(x, u), y = output(x), as a NonlinearIOSystem."""
    import control  # here, so that importing the datasets stays light

    inputs, outputs, states = names

    return control.nlsys(
        lambda t, x, u, params: np.array(step(x.tolist(), u.tolist())),
        lambda t, x, u, params: output(x),
        inputs=inputs,
        outputs=outputs,
        states=states,
        dt=dt,
        name=name,
    )


def _recorded(step, u, X, warmup, measured, dt, noise, rng, names):
    """Return the record of a run behind its first samples; outputs are neighbours."""
    name, title, *signals = names
    u, X = u[warmup:], X[warmup:]
    y = _add_noise(X[:, measured[0] : measured[-1] + 1], noise, rng)
    plant = _sampled_plant(step, lambda x: x[measured], dt, signals, name)
    return Record(u, y, dt, title, plant, X[0])

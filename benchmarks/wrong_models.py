"""Plants, good models of them, and models that are wrong in one way each."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.plants import as_plant
from alssnn.simulation import channels, simulate
from benchmarks._options import by_hand

NOISE = 0.1  # of the standard deviation of an output


@dataclass(frozen=True)
class Plant:
    """A plant of discrete time.

    Parameters
    ----------
    step : callable
        Next state, of a state and an input.
    output : callable
        Output of a state.
    nx, nu, ny : int
        Sizes.
    n_h : int
        Neurons of its model; 0 for a linear one.
    good : bool
        Whether its models count among the good ones.
    """

    step: Callable
    output: Callable
    nx: int
    nu: int = 1
    ny: int = 1
    n_h: int = 0
    good: bool = False


class Data(NamedTuple):
    """A record, and its outputs without noise."""

    u: np.ndarray
    y: np.ndarray
    clean: np.ndarray


A2 = np.array([[0.8, 0.3], [-0.2, 0.7]])
B2 = np.array([[1.0, 0.2], [0.1, 0.5]])
C2 = np.array([[1.0, 0.0], [0.3, 1.0]])
AN = np.array([[0.9, 0.2], [-0.2, 0.8]])
BN = np.array([0.1, 0.4])
ROTATION = 0.97 * np.array(
    [[np.cos(0.6), np.sin(0.6)], [-np.sin(0.6), np.cos(0.6)]]
)  # a lightly damped mode


def linear(x, u):
    """Two inputs, two outputs."""
    return A2 @ x + B2 @ u


def bent(x, u):
    """A restoring force at the input."""
    return AN @ x + BN * (u[0] - np.tanh(2 * x[0]))


def pushed(x, u):
    """A force away from rest, which the law takes out: its loop is calmer."""
    return AN @ x + BN * (u[0] - 0.3 * x[0] + 0.4 * np.tanh(2 * x[0]))


def against(x, u):
    """The same with the other sign, which the law of `bent` makes worse."""
    return AN @ x + BN * (u[0] + 0.3 * np.tanh(2 * x[0]))


def hardening(x, u):
    """A cubic spring at the input."""
    return AN @ x + BN * (u[0] - 0.5 * x[0] - np.clip(x[0], -3, 3) ** 3 / 3)


def resonance(x, u):
    """A pole, and a lightly damped mode."""
    return np.r_[0.8 * x[0] + 0.2 * u[0], ROTATION @ x[1:] + [0.0, 0.2 * u[0]]]


def squared(x, u):
    """A valve that also opens by the square of its input."""
    return AN @ x + BN * (u[0] + 0.4 * u[0] ** 2)


def elsewhere(x, u):
    """A nonlinearity two states from the input: no law cancels it at once."""
    force = np.tanh(3 * x[1]) - x[1]
    return np.array(
        [0.7 * x[0] + 0.3 * x[1] + 0.8 * force, 0.8 * x[1] + 0.3 * u[0] - 0.2 * x[0]]
    )


def first(x):
    """The first state."""
    return x[:1]


PLANTS = {
    "linear": Plant(linear, lambda x: C2 @ x, 2, 2, 2, good=True),
    "resonance": Plant(resonance, lambda x: x[:1] + x[1:2], 3, good=True),
    "bent": Plant(bent, first, 2, n_h=3),
    "pushed": Plant(pushed, first, 2, n_h=4, good=True),
    "hardening": Plant(hardening, first, 2, n_h=4, good=True),
    "against": Plant(against, first, 2),
    "squared": Plant(squared, first, 2),
    "elsewhere": Plant(elsewhere, first, 2),
}


def record(name, n, *, pole=0.0, rng, size=1.0, mean=0.0, noise=NOISE, band=0.0):
    """Return a record.

    Parameters
    ----------
    name : str
        Of a plant.
    n : int
        Samples.
    pole : float
        Of the noise.
    rng : Generator
        Random numbers.
    size, mean : float
        Standard deviation and mean of the input.
    noise : float
        Share of the standard deviation of every output.
    band : float
        Pole of the input.
    """
    plant = PLANTS[name]
    u = rng.standard_normal((n + 100, plant.nu))
    u = mean + size * lfilter([np.sqrt(1 - band**2)], [1, -band], u, axis=0)
    clean = simulated(plant.step, plant.output, plant.nx, u)[100:]
    return _measured(u[100:], clean, rng, pole, noise)


def simulated(step, output, nx, u):
    """Return the outputs of a plant from rest."""
    x, y = np.zeros(nx), []
    for u_k in u:
        y.append(output(x))
        x = step(x, u_k)
    return np.array(y)


def _measured(u, clean, rng, pole=0.0, noise=NOISE):
    white = rng.standard_normal((len(clean) + 100, clean.shape[1]))
    white = lfilter([np.sqrt(1 - pole**2)], [1, -pole], white, axis=0)[100:]
    return Data(u, clean + noise * clean.std(axis=0) * white, clean)


def identified(name, u, y):
    """Return a model of the structure of a plant."""
    plant = PLANTS[name]
    if not plant.n_h:
        return LinearStateSpace(nx=plant.nx).fit(u, y)
    # the defaults but for the search: A is stable, and h no larger than it must be
    options = {"alpha": 0.0, "n_init": 1, "gamma_h": 1e-3, "random_state": 0}
    return FlSsnn(plant.nx, plant.n_h, **options).fit(u, y)


def error_of(y_hat, y):
    """Return the largest share of the outputs that predictions miss."""
    late = slice(len(y) // 4, None)  # the initial state is not known
    with np.errstate(all="ignore"):
        error = np.sqrt(np.mean((y_hat[late] - y[late]) ** 2, axis=0))
        return float(np.max(error / y[late].std(axis=0)))


def loop_error(name, model, u):
    """Return how far a plant under the law of its model is from the linear design.

    The law is that of the model's state, which follows the recorded input as v, and its
    input drives the plant.
    """
    plant = as_plant(model).arrived()
    A, B, C, _ = plant.linear()
    v, x0 = u - plant.u_offset, np.zeros(plant.nx)
    loop = plant.close()
    X = simulate(loop, v, x0)[:-1]
    driven = plant.u_offset + channels(loop, X, v)[:, plant.ny :]
    if not np.isfinite(driven).all():
        return np.inf
    design = simulated(lambda x, v: A @ x + B @ v, lambda x: C @ x, plant.nx, v)
    true = PLANTS[name]
    y = simulated(true.step, true.output, true.nx, driven)
    return error_of(y - plant.y_offset, design)


def fl(nx, n_h, **options):
    """Return an unfitted model with a linearizing law."""
    defaults = {"max_iter": 100, "tol": 1e-5, "random_state": 0}
    return by_hand(FlSsnn, nx, n_h, **{**defaults, **options})


def _case(training, fresh, make=None, n=1000, baseline=False):
    """Return a case: a model of records of one kind, judged on records of another."""

    def build(rng):
        data, judged = (
            record(kind, n, rng=rng, **options) for kind, options in (training, fresh)
        )
        if make is None:
            model = identified(training[0], data.u, data.y)
        else:
            model = make(data)
        linear_model = None
        if baseline:
            linear_model = LinearStateSpace(2).fit(data.u, data.y)
        return model, judged, linear_model

    return build


def _same(name, make, n=1000, n_fresh=1000, **options):
    """Return a case: a model that is made wrongly, on records of the same kind."""

    def build(rng):
        data = record(name, n, rng=rng, **options)
        judged = record(name, n_fresh, rng=rng, **options)
        return make(data), judged, None

    return build


def _changed(name, change, make=None):
    """Return a case: a good model, judged on a record that is not what it seems."""

    def build(rng):
        data, judged = (record(name, 1000, rng=rng) for _ in range(2))
        model = identified(name, data.u, data.y) if make is None else make(data)
        return model, change(judged, rng), None

    return build


def _gain(factor):
    return lambda d, _: Data(d.u / factor, d.y, d.clean)


def _shift(n):
    return lambda d, _: Data(d.u[n:], d.y[: len(d.y) - n], d.clean[: len(d.y) - n])


def _ahead(n):
    return lambda d, _: Data(d.u[: len(d.u) - n], d.y[n:], d.clean[n:])


def _columns(u=None, y=None):
    u, y = u or [0, 1], y or [0, 1]
    return lambda d, _: Data(d.u[:, u], d.y[:, y], d.clean[:, y])


def _half_rate(d, _):
    return Data(d.u[::2], d.y[::2], d.clean[::2])


def _units(d, _):
    return Data(d.u, 1.8 * d.y + 32, 1.8 * d.clean + 32)


def _clipped(d, _):
    low, high = np.quantile(d.clean, [0.2, 0.8])
    return Data(d.u, np.clip(d.y, low, high), np.clip(d.clean, low, high))


def _drift(d, rng):
    walk = np.cumsum(rng.standard_normal(d.clean.shape), axis=0)
    walk *= d.clean.std() / walk.std()
    return Data(d.u, d.y + walk, d.clean + walk)


def _sign(d, _):
    return Data(d.u * [1.0, -1.0], d.y, d.clean)


def _fading(d, _):
    gain = np.linspace(1.0, 0.2, len(d.y))[:, None]
    return Data(d.u, d.y * gain, d.clean * gain)


def _frozen(d, _):
    y, clean = d.y.copy(), d.clean.copy()
    y[len(y) // 2 :] = y[len(y) // 2]
    clean[len(y) // 2 :] = clean[len(y) // 2]
    return Data(d.u, y, clean)


def _noise_only(d, rng):
    noise = rng.standard_normal(d.y.shape)
    return Data(d.u, noise, noise)


def _unstable(_):
    """Return a model of a short record of an unstable plant."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal((60, 1))
    y = simulated(lambda x, u: 1.2 * x + u, first, 1, u)
    start = ([[1.2]], [[1.0]], [[1.0]])
    return fl(1, 2, linear_start=start, max_iter=5).fit(u, y)


def _linear_model(nx, **options):
    return lambda d: LinearStateSpace(nx, **options).fit(d.u, d.y)


def _shuffled(d):
    """Return a model of a record whose rows were mixed up."""
    order = np.random.default_rng(0).permutation(len(d.y))
    return LinearStateSpace(2).fit(d.u, d.y[order])


def _no_penalty(d):
    return by_hand(
        AlSsnn, 2, 2, 4, gamma=0.0, max_iter=100, tol=1e-5, random_state=0
    ).fit(d.u, d.y)


def _strong_penalty(d):
    return by_hand(
        AlSsnn, 2, 1, 4, gamma=1e-3, max_iter=100, tol=1e-5, random_state=0
    ).fit(d.u, d.y)


def _overfitted_network(d):
    return by_hand(GrSsnn, 4, 12, max_iter=300, tol=1e-9, random_state=0).fit(d.u, d.y)


SMALL, LARGE = {"size": 0.3}, {"size": 3.0}
WRONG = {
    "gain of the actuator + 30 %, linear": _changed("linear", _gain(1.3)),
    "gain of the actuator - 30 %, linear": _changed("resonance", _gain(0.7)),
    "gain of the actuator + 30 %, nonlinear": _changed("bent", _gain(1.3)),
    "gain of the actuator - 50 %, nonlinear": _changed("hardening", _gain(0.5)),
    "sign of an input": _changed("linear", _sign),
    "inputs swapped": _changed("linear", _columns(u=[1, 0])),
    "outputs swapped": _changed("linear", _columns(y=[1, 0])),
    "other units of the output": _changed("bent", _units),
    "half the sampling rate": _changed("bent", _half_rate),
    "record shifted by three samples": _changed("resonance", _shift(3)),
    "output late by three samples": _changed("bent", _ahead(3)),
    "sensor that clips": _changed("linear", _clipped),
    "sensor that drifts": _changed("bent", _drift),
    "sensor that freezes": _changed("resonance", _frozen),
    "sensor whose gain fades": _changed("hardening", _fading),
    "another plant: noise": _changed("linear", _noise_only),
    "odd nonlinearity missing": _same("bent", _linear_model(2), size=2.0),
    "odd nonlinearity missing, high order": _same("hardening", _linear_model(8)),
    "even nonlinearity missing": _same("squared", _linear_model(2)),
    "nonlinearity of the other sign": _case(("bent", {}), ("against", {})),
    "one state of two, linear": _same("linear", _linear_model(1)),
    "one state of two, nonlinear": _same("bent", lambda d: fl(1, 3).fit(d.u, d.y)),
    "resonance missing": _same("resonance", _linear_model(1)),
    "resonance missing, colored noise": _same("resonance", _linear_model(1), pole=0.9),
    "delay of three samples too long": _same(
        "bent", lambda d: fl(2, 3, input_delay=3).fit(d.u, d.y)
    ),
    "delay of two samples too long, linear": _same(
        "linear", _linear_model(2, input_delay=2)
    ),
    "overfitted network": _same("bent", _overfitted_network, n=120),
    "overfitted linear model": _same("resonance", _linear_model(12), n=60),
    "rows of the training record shuffled": _same("linear", _shuffled),
    "trained on noise": _same("bent", _linear_model(2), noise=20.0),
    "region left by amplitude": _case(("hardening", SMALL), ("hardening", LARGE)),
    "region left by the operating point": _case(
        ("bent", SMALL), ("bent", {"size": 0.3, "mean": 2.0})
    ),
    "region left, linear model": _case(
        ("bent", SMALL), ("bent", LARGE), _linear_model(2)
    ),
    "another band of the input": _case(
        ("hardening", {"band": 0.0}), ("hardening", {"band": 0.98, "size": 3.0})
    ),
    "free run diverges": _same("bent", _unstable),
    "no law linearizes the plant, no penalty": _same(
        "elsewhere", _no_penalty, size=2.0
    ),
    "no law linearizes the plant, weak penalty": _same(
        "elsewhere", _strong_penalty, size=2.0
    ),
    "no law linearizes the plant, model with law": _same(
        "elsewhere", lambda d: fl(2, 4).fit(d.u, d.y), size=2.0
    ),
}

"""Records and hyper-parameters, in and out of range."""

import numpy as np
from hypothesis import strategies as st

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace

DYNAMICS = ["linear", "bent", "integral", "walk", "noise", "constant"]
SCALES = st.integers(-12, 12).map(lambda k: 10.0**k)
OFFSETS = st.sampled_from([0.0, 0.0, 1.0, -20.1, 1e3, 1e6])  # in units of the signal
GAPS = (
    ["none"] * 14
    + ["some"] * 3
    + ["some", "half", "column", "all", "u", "inf u", "inf y"]
)
LABELS = ["none"] * 20 + ["two"] * 4 + ["mixed", "short", "floats"]


@st.composite
def records(draw):
    """Return (u, y, experiment)."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.one_of(*[st.integers(40, 120)] * 4, st.integers(1, 39)))
    nu, ny = draw(st.integers(1, 2)), draw(st.integers(1, 2))
    u = rng.normal(size=(n, nu))
    y = _respond(draw(st.sampled_from(DYNAMICS)), u, ny, rng)
    y = y + draw(st.sampled_from([0.0, 1e-3, 0.1])) * rng.normal(size=y.shape)
    u = draw(SCALES) * (u + draw(OFFSETS))
    y = draw(SCALES) * (y + draw(OFFSETS))
    if draw(st.integers(0, 9)) == 0:
        side = draw(st.sampled_from([u, y]))
        side[:, -1] = side[0, -1]
    u, y = _damage(draw(st.sampled_from(GAPS)), u, y, rng)
    kind = draw(st.sampled_from([float] * 20 + [np.float32, int, object, complex, str]))
    with np.errstate(all="ignore"):
        y = y.astype(kind) if kind is not int or np.isfinite(y).all() else y
    if ny == 1 and draw(st.booleans()):
        y = y[:, 0]
    return u, y, _labels(draw(st.sampled_from(LABELS)), n, rng)


def _respond(kind, u, ny, rng):
    n, nu = u.shape
    if kind == "constant":
        return np.full((n, ny), 1 / 3)
    if kind == "noise":
        return rng.normal(size=(n, ny))
    if kind == "walk":
        return np.cumsum(np.cumsum(rng.normal(size=(n, ny)), axis=0), axis=0)
    B, x, y = rng.normal(size=(ny, nu)), np.zeros(ny), np.zeros((n, ny))
    pole = 1.0 if kind == "integral" else rng.uniform(-0.5, 0.98)
    for k in range(n):
        y[k] = x
        x = pole * x + B @ u[k] + (0.5 * np.tanh(3 * x) if kind == "bent" else 0)
    return y


def _damage(kind, u, y, rng):
    if kind == "some":
        y[rng.random(y.shape) < 0.2] = np.nan
    elif kind == "half":
        y[: len(y) // 2] = np.nan
    elif kind == "column":
        y[:, 0] = np.nan
    elif kind == "all":
        y[:] = np.nan
    elif kind == "u":
        u[rng.integers(len(u))] = np.nan
    elif kind == "inf u":
        u[rng.integers(len(u))] = np.inf
    elif kind == "inf y":
        y[rng.integers(len(y))] = -np.inf
    return u, y


def _labels(kind, n, rng):
    if kind == "two":
        return np.repeat([0, 1], [n // 2, n - n // 2])
    if kind == "mixed":
        return rng.integers(2, size=n)
    if kind == "short":
        return np.zeros(n - 1)
    if kind == "floats":
        return np.full(n, np.nan)
    return None


COMMON = {
    "nx": st.sampled_from([1, 2, 2, 2, 3, 6]),
    "input_delay": st.sampled_from([0, 0, 0, 1, 2]),
    "operating_point": st.sampled_from(["mean", "mean", "zero"]),
    "initial_state": st.sampled_from(["estimate"] * 4 + ["rest"] * 2 + ["periodic"]),
    "integrators": st.sampled_from(["auto", 0, 0, 0, 1]),
    "dt": st.sampled_from([1.0, 1e-6, 3600.0]),
    "max_iter": st.integers(1, 4),
    "n_init_samples": st.sampled_from([1, 5, 50]),
    "noise": st.sampled_from(["output"] * 6 + ["innovations"]),
    "horizon": st.sampled_from([1] * 8 + [3]),
    "time": st.sampled_from(["discrete"] * 6 + ["continuous"]),
    "hold": st.sampled_from(["zoh"] * 8 + ["linear", "cubic"]),
    "drift": st.sampled_from([None] * 8 + ["output", "input"]),
    "disturbances": st.sampled_from([None] * 8 + [[1], [0]]),
    "period": st.sampled_from([None] * 10 + [20, 1]),
    "noise_floor": st.sampled_from([None] * 8 + [0.1, 1e-9]),
}
NETWORKS = {
    "alpha": st.sampled_from([0.0, 0.0, 0.0, 1e-3]),
    "n_init": st.sampled_from([1, 1, 2]),
    "random_state": st.integers(0, 5),
    "polish_iter": st.integers(1, 2),
    "coarse_samples": st.sampled_from([None, None, 20, 60]),
    "stability": st.sampled_from(["auto", "auto", None]),
    "method": st.sampled_from(["lm", "lm", "trf"]),
    "validation_fraction": st.sampled_from([None, None, None, 0.3]),
    "activation": st.sampled_from(["tanh"] * 4 + ["relu"]),
}
LAWS = {
    "input_map": st.sampled_from(["identity"] * 4 + ["monotone"]),
    "gamma_h": st.sampled_from([0.0, 0.0, 1e-4]),
    "odd": st.sampled_from([False, False, False, True]),
}
SIZES = st.sampled_from([0, 1, 2, 2])
OWN = {
    LinearStateSpace: {"feedthrough": st.booleans()},
    FlSsnn: LAWS | {"n_h": SIZES, "feedback": st.sampled_from(["state", "output"])},
    AlSsnn: LAWS
    | {
        "n_h": SIZES,
        "n_g": SIZES,
        "gamma": st.sampled_from([0.0, 0.01, 1e6]),
        "penalty": st.sampled_from(["state", "output"]),
        "feedback": st.sampled_from(["state", "output"]),
        "n_k": st.sampled_from([0, 0, 0, 1]),
        "feedthrough": st.sampled_from([False, False, False, True]),
    },
    GrSsnn: {"n_f": SIZES},
}
NONSENSE = [
    *(None, -1, 0, 2.5, 10**6, np.nan, np.inf, -np.inf, 1e300, True),
    *("", "best", b"2", [], [1, 2, 3], [[1]], {}, {"A": 1}, (0,), ("a", "b"), object()),
]
# what makes a fit long, or is meant to make it so
UNTOUCHED = {"verbose", "n_jobs", "max_iter", "polish_iter", "n_init", "continuation"}


@st.composite
def models(draw, **given):
    """Return an estimator, one in four with an option that makes no sense.

    Options that are given have these values in all of them, and none is senseless.
    """
    cls = draw(st.sampled_from(list(OWN)))
    options = dict(COMMON, **OWN[cls])
    if cls is not LinearStateSpace:
        options |= NETWORKS
    drawn = {name: draw(z) for name, z in options.items() if name not in given}
    model = cls(**drawn, **given)
    if not given and draw(st.integers(0, 3)) == 0:
        names = sorted(set(model.get_params(deep=False)) - UNTOUCHED)
        name = draw(st.sampled_from(names))
        value = draw(st.sampled_from(NONSENSE))
        if not (name in ("n_h", "n_g", "n_f", "n_k", "nx") and value == 10**6):
            model.set_params(**{name: value})
    return model

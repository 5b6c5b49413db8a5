"""What makes no sense as an argument is refused by the name of the argument."""

import re

import numpy as np
import pytest

import alssnn
from alssnn.datasets import on_grid
from alssnn.nonparametric import local_polynomial

NONSENSE = ["x", {}, object(), [[]], [1, [2]]]


@pytest.fixture(scope="module")
def fitted():
    """Return a linear model and its record."""
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=(80, 1)), np.zeros(80)
    for k in range(79):
        y[k + 1] = 0.8 * y[k] + u[k, 0] + 0.01 * rng.normal()
    return alssnn.LinearStateSpace(nx=1).fit(u, y), u, y


ASKED = {
    "K": lambda m, u, y, v: m.local_certificate(K=v),
    "gain": lambda m, u, y, v: m.controller(v),
    "phi": lambda m, u, y, v: m.iss_certificate(u, y, phi=v),
    "eps": lambda m, u, y, v: m.iss_certificate(u, y, eps=v),
    "amplitude": lambda m, u, y, v: m.local_certificate(v),
    "noise": lambda m, u, y, v: m.controller().certificate(noise=v),
    "error": lambda m, u, y, v: m.controller().certificate(error=v),
    "x0": lambda m, u, y, v: m.predict(u, x0=v),
    "steps": lambda m, u, y, v: m.predict_ahead(u, y, v),
    "models": lambda m, u, y, v: alssnn.compare(v, u, y),
    "n_frequencies": lambda m, u, y, v: local_polynomial(u, y, dt=1, n_frequencies=v),
    "dt": lambda m, u, y, v: on_grid(u, np.arange(80.0), y, np.arange(80.0), dt=v),
    "reference": lambda m, u, y, v: m.controller().step(v, 0.0),
    "level": lambda m, u, y, v: m.tube(u, y, level=v),
    "candidates": lambda m, u, y, v: m.next_input(u, y, candidates=v),
}


@pytest.mark.parametrize("name", ASKED)
@pytest.mark.parametrize(
    "value", NONSENSE, ids=["text", "dict", "object", "empty", "ragged"]
)
def test_a_refusal_names_the_argument(fitted, name, value):
    with pytest.raises((ValueError, TypeError), match=re.escape(f"`{name}`")):
        ASKED[name](*fitted, value)


@pytest.mark.parametrize("value", [-1, 1.5, True])
def test_a_ladder_names_its_models(fitted, value):
    with pytest.raises(ValueError, match="`models` must name"):
        alssnn.model_ladder(*fitted[1:], nx=1, models=value)

import dataclasses

import numpy as np
import pytest

from alssnn.networks import Factor, Term
from alssnn.structures import state_space_structure

# (nx, nu, ny) of every shape, options of state_space_structure
STRUCTURES = {
    "linear": ((3, 2, 2), {}),
    "linear-siso": ((2, 1, 1), {}),
    "more outputs than states": ((1, 1, 3), {}),
    "fl": ((3, 2, 2), {"n_h": 4}),
    "gr": ((3, 2, 2), {"n_g": 3, "tied_bias": False}),
    "al": ((3, 2, 2), {"n_h": 4, "n_g": 3, "penalty": "state"}),
    "al-siso": ((2, 1, 1), {"n_h": 2, "n_g": 2, "penalty": "state"}),
    "al-unpenalized": ((3, 1, 2), {"n_h": 2, "n_g": 3}),
    "fl-state": ((3, 2, 1), {"n_h": 4, "feedback": "state"}),
    "al-output": ((3, 2, 2), {"n_h": 4, "n_g": 3, "penalty": "output"}),
    "al-state-output": (
        (2, 1, 1),
        {"n_h": 2, "n_g": 3, "feedback": "state", "penalty": "output"},
    ),
    "fl-split": ((3, 2, 2), {"n_h": 4, "penalize_h": True}),
    "al-split": (
        (3, 2, 1),
        {
            "n_h": 2,
            "n_g": 3,
            "feedback": "state",
            "penalty": "output",
            "penalize_h": True,
        },
    ),
    "al-free-bias": (
        (3, 2, 1),
        {"n_h": 2, "n_g": 3, "penalty": "state", "tied_bias": False},
    ),
}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def two_layers(rng):
    """Return a structure whose g has two hidden layers, declared by hand."""
    base = state_space_structure(
        3, 2, 1, n_h=2, n_g=3, C=rng.standard_normal((1, 3)), penalty="state"
    )
    first = [t for t in base.terms if t.left.name != "W_g"]
    output = [Term("x", "w_2", Factor("W_g")), Term("g", "w_2", Factor("W_g"))]
    hidden = [Term("w_2", "w_g", Factor("W_2")), Term("w_2", "1", Factor("b_2"))]
    axes = {"W_g": ("x", "w_2"), "W_2": ("w_2", "w_g"), "b_2": ("w_2",)}
    return dataclasses.replace(
        base,
        sizes={**base.sizes, "w_2": 4},
        neurons=(*base.neurons, "w_2"),
        parameters={**base.parameters, **axes},
        terms=(*first, *output, *hidden),
    )


@pytest.fixture(params=[*STRUCTURES, "two layers"], ids=str)
def structure(request, rng):
    if request.param == "two layers":
        return two_layers(rng)
    (nx, nu, ny), options = STRUCTURES[request.param]
    has_network = "n_h" in options or "n_g" in options
    C = rng.standard_normal((ny, nx)) if has_network else None
    return state_space_structure(nx, nu, ny, C=C, **options)


@pytest.fixture
def experiments(structure, rng):
    """Two experiments of unequal length, in scaled units."""
    ny = structure.sizes["y"]
    return [
        (rng.standard_normal((n, structure.nu)), rng.standard_normal((n, ny)))
        for n in (23, 40)
    ]

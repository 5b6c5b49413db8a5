import numpy as np
import pytest

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
    "linear-feedthrough": ((2, 2, 3), {"feedthrough": True}),
    "penalized h": ((2, 2, 1), {"n_h": 3, "n_g": 2, "penalize_h": True}),
    "odd": ((3, 1, 2), {"n_h": (3, 2), "odd": True, "activation": "sin"}),
    "nonlinear output": (
        (3, 2, 2),
        {"n_h": 3, "n_k": 2, "penalty": "output", "feedthrough": True},
    ),
    "deep": (
        (3, 2, 1),
        {
            "n_h": (2, 3),
            "n_g": (3, 4, 2),
            "n_k": (2, 2),
            "penalty": "state",
            "activation": {"h": "sigmoid", "g": "tanh", "k": "sin"},
        },
    ),
    "deep-state-output": (
        (2, 2, 3),
        {
            "n_h": (2, 2),
            "n_g": (2, 3),
            "n_k": 2,
            "feedback": "state",
            "penalty": "output",
            "feedthrough": True,
            "penalize_h": True,
            "tied_bias": False,
            "activation": {"h": "relu", "g": "sigmoid", "k": "identity"},
        },
    ),
}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(params=STRUCTURES, ids=str)
def structure(request, rng):
    (nx, nu, ny), options = STRUCTURES[request.param]
    has_network = {"n_h", "n_g", "n_k"} & set(options)
    C = rng.standard_normal((ny, nx)) if has_network else None
    return state_space_structure(nx, nu, ny, C=C, **options)


@pytest.fixture
def experiments(structure, rng):
    """Two experiments of unequal length, in scaled units, some outputs missing."""
    ny = structure.sizes["y"]
    pairs = [
        (rng.standard_normal((n, structure.nu)), rng.standard_normal((n, ny)))
        for n in (23, 40)
    ]
    pairs[0][1][5:9, 0] = np.nan
    pairs[1][1][-1] = np.nan
    return pairs

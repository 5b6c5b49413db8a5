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
    "al": ((3, 2, 2), {"n_h": 4, "n_g": 3, "penalize_g": True}),
    "al-siso": ((2, 1, 1), {"n_h": 2, "n_g": 2, "penalize_g": True}),
    "al-unpenalized": ((3, 1, 2), {"n_h": 2, "n_g": 3}),
    "al-free-bias": (
        (3, 2, 1),
        {"n_h": 2, "n_g": 3, "penalize_g": True, "tied_bias": False},
    ),
}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(params=STRUCTURES, ids=str)
def structure(request, rng):
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

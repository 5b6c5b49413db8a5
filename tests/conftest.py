import numpy as np
import pytest
from structures import STRUCTURES, declare


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(params=STRUCTURES, ids=str)
def structure(request, rng):
    return declare(request.param, rng)


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

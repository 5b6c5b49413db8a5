from contextlib import contextmanager

import numpy as np
import pytest
from matplotlib.figure import Figure
from structures import STRUCTURES, declare

from alssnn.certificates import local_certificate


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


@pytest.fixture(scope="session")
def roughly():
    """Return how to bound loops on a coarse grid, and to try few inputs, for a while.

    For what is made of certificates.  How sharp they are is tested by themselves.
    """

    @contextmanager
    def patched():
        with pytest.MonkeyPatch.context() as patch:
            patch.setitem(local_certificate.__kwdefaults__, "cells", 3_000)
            patch.setattr("alssnn.certificates._worst.STEPS", 2)
            patch.setattr("alssnn.certificates._worst.SOLVED", (100, 1, 1, 4))
            yield

    return patched


@pytest.fixture
def rough_certificates(roughly):
    with roughly():
        yield


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the pictures out, half of the time, where the words are of interest."""
    monkeypatch.setattr(Figure, "savefig", lambda *_, **__: None)

"""Plants of all structures, for tests of what is written in other languages."""

import numpy as np
from structures import STRUCTURES, declare
from test_extending import SOFTSIGN, hammerstein

from helpers import plant_of_structure, random_theta

OWN = {
    "hammerstein": (lambda: hammerstein(3, 2, 2, n_f=4), 0),
    "softsign": (lambda: hammerstein(2, 1, 2, n_f=3, activation=SOFTSIGN), 0),
    "hammerstein, late": (lambda: hammerstein(2, 2, 1, n_f=3), (0, 3)),
}
LATE = {"linear": (2, 1), "gr": (1, 4), "al": (3, 0), "nonlinear output": (0, 2)}
NAMES = [*STRUCTURES, *OWN, *(f"{name}, late" for name in LATE)]


def make_plant(name):
    """Return the plant of a name, with random parameters."""
    rng = np.random.default_rng(0)
    if name in OWN:
        make, delay = OWN[name]
        structure = make()
    else:
        name, _, late = name.partition(", ")
        structure = declare(name, rng)
        delay = LATE[name] if late else 0
    return plant_of_structure(structure, random_theta(structure, rng), rng, delay)


def signals(plant, n=40):
    """Return states, inputs and what the law measures, one sample per row."""
    rng = np.random.default_rng(1)
    ns = plant.law_form.nu - plant.nu
    x, u, s = (rng.standard_normal((n, m)) for m in (plant.late().nx, plant.nu, ns))
    return x, u, s


def assert_exact(values, expected):
    """Compare to 1e-12 of the range of the expected values."""
    size = max(np.ptp(expected), 1.0)
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12 * size)

"""Plants of all structures, for tests of what is written in other languages."""

import functools
from dataclasses import replace

import numpy as np
from structures import STRUCTURES, declare
from test_extending import SOFTSIGN, hammerstein

from alssnn.continuous import sampled
from alssnn.feedback import LinearizingLaw, Observer, lqi, lqr
from alssnn.models import state_space
from alssnn.rates import Rates
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


def make_unknown(activation):
    """Return a plant with an activation."""
    rng = np.random.default_rng(0)
    structure = hammerstein(2, 1, 2, n_f=3, activation=activation)
    return plant_of_structure(structure, random_theta(structure, rng), rng)


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


def fast_plant():
    """Return a plant of nx = 6 and n_h = n_g = 10, whose steps are timed."""
    rng = np.random.default_rng(0)
    C = rng.standard_normal((1, 6))
    structure = state_space(6, 1, 1, n_h=10, n_g=10, C=C, feedback="output")
    p = {k: 0.2 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    p["A"] = np.diag(np.linspace(0.1, 0.8, 6))
    return plant_of_structure(structure, structure.join(p), rng)


# -- controllers -----------------------------------------------------------------------

CONTROLLED = {  # input map, what the law measures, disturbances, integrators, delay
    "output": ("identity", "output", (), True, 0),
    "state": ("identity", "state", (), False, 0),
    "disturbed": ("identity", "output", (0, 2), True, 0),
    "state, disturbed": ("identity", "state", (1,), True, 0),
    "monotone": ("monotone", "output", (1,), True, 0),
    "monotone, one input": ("monotone", "state", (0, 2), False, 0),
    "late": ("none", "state", (), True, (2, 0, 1)),
    # laws that look half a sample ahead
    "ahead, disturbed": ("identity", "output", (0, 2), True, 0),
    "ahead, state": ("identity", "state", (), True, 0),
    "ahead, monotone": ("monotone", "output", (1,), True, 0),
}


def looking_ahead(structure, p, rng, delay=0):
    """Return a plant of derivatives whose law looks half a sample ahead."""
    theta = structure.join({**p, "A": p["A"] - np.eye(2)})
    structure = sampled(structure, dt=0.5)
    units = {axis: np.ones(structure.sizes[axis]) for axis in "xuy"}
    plant = plant_of_structure(structure, theta, rng, delay)
    plant = replace(plant, rates=Rates(structure, theta, units))
    return plant.at(plant.dt, ahead=True)


class Loop:
    """Hold a plant with law, limits, observer and gain, and what they do in Python."""

    def __init__(self, name):
        input_map, feedback, given, integrates, delay = CONTROLLED[name]
        rng = np.random.default_rng(3)
        ny = 1 if len(given) == 2 else 2
        options = {"feedback": feedback, "input_map": input_map, "n_h": 4}
        if input_map == "none":
            options = {"n_h": 0}
        C = np.array([[1.0, 0.3], [0.2, -1.0]])[:ny]
        structure = state_space(2, 3, ny, n_g=2, C=C, disturbances=given, **options)
        p = {k: 0.3 * rng.standard_normal(s) for k, s in structure.shapes.items()}
        p["A"] = np.array([[0.8, 0.2], [-0.1, 0.7]])
        if name.startswith("ahead"):
            self.plant = looking_ahead(structure, p, rng)
        else:
            self.plant = plant_of_structure(structure, structure.join(p), rng, delay)
        plant = self.plant
        late = plant.late()
        n, self.integrates = late.nx, integrates
        weight = np.eye(n + ny) if integrates else np.eye(n)
        design = lqi if integrates else lqr
        self.gain = design(plant, weight, np.eye(plant.nv))
        self.observer = Observer(late, gate=3)
        self.law = LinearizingLaw(plant)
        self.law = self.limited(self.run(self.controller())[1])
        self.options = {"law": self.law, "observer": self.observer, "gain": self.gain}

    def signals(self, n=1000, seed=0):
        """Return references, measured outputs and disturbances; some are missing."""
        plant, rng = self.plant, np.random.default_rng(seed)
        rest = plant.y_offset if self.integrates else plant.v_offset
        r = rng.standard_normal((n // 20 + 1, len(rest)))
        d = rng.standard_normal((n // 30 + 1, plant.nd))
        r = rest + 0.5 * np.repeat(r, 20, axis=0)[:n]
        d = plant.d_offset + 0.5 * np.repeat(d, 30, axis=0)[:n]
        noise = 0.1 * rng.standard_normal((n, plant.ny))
        noise[rng.random(noise.shape) < 0.05] = np.nan
        noise[rng.random(noise.shape) < 0.02] = np.inf
        noise[rng.random(noise.shape) < 0.02] = 1e6  # a spike, which the gate cuts
        return r, noise, d

    def law_signals(self, n):
        """Return v, what the law measures, and disturbances, one sample per row."""
        plant, rng = self.plant, np.random.default_rng(1)
        sizes = plant.nv, plant.law_form.nu - plant.nu, plant.nd
        return tuple(rng.standard_normal((n, size)) for size in sizes)

    def limited(self, u):
        """Return the law with limits of its first input that are met now and then."""
        low, high = np.full((2, self.plant.nv), np.inf) * [[-1], [1]]
        low[0], high[0] = np.quantile(u[:, 0], [0.2, 0.8])
        return LinearizingLaw(self.plant, low, high)

    def run(self, step, n=1000):
        """Return y, as it was measured, and u of a loop around the plant.

        ``step(r, y, d)`` is one sample of a controller.
        """
        plant, x = self.plant.late(), np.zeros(self.plant.late().nx)
        Y, U = np.empty((n, plant.ny)), np.empty((n, plant.nv))
        for k, (r, noise, d) in enumerate(zip(*self.signals(n), strict=True)):
            Y[k] = plant.output(x) + noise
            U[k] = step(r, Y[k], d)
            x = plant.step(x, plant.every_input(U[k], d))
        return Y, U

    @functools.cache  # noqa: B019, as there is one loop of a name
    def expected(self, n=1000):
        """Return y and u of the loop of plant and controller in Python."""
        return self.run(self.controller(), n)

    def alone(self, n=1000):
        """Return [y, u] of the loop of plant and controller, all of y measured."""
        plant, control = self.plant.late(), self.controller()
        x, rows = np.zeros(plant.nx), []
        for r, _, d in zip(*self.signals(n), strict=True):
            y = plant.output(x)
            u = control(r, y, d)
            x = plant.step(x, plant.every_input(u, d))
            rows.append(np.concatenate([y, u]))
        return np.array(rows)

    def controller(self):
        """Return the controller in Python, a function of r, y and d."""
        plant, observer, law = self.plant.late(), self.observer, self.law
        x, z = np.zeros(plant.nx), np.zeros(plant.ny * self.integrates)
        K_x, K_z = self.gain[:, : plant.nx], self.gain[:, plant.nx :]
        gate = observer.largest_innovation

        def step(r, y, d):
            nonlocal x, z
            finite, expected = np.isfinite(y), plant.output(x)
            y = np.where(finite, np.clip(y, expected - gate, expected + gate), y)
            now = observer.output(0, x, np.concatenate([plant.u_offset, y]), {})
            v = (plant.v_offset if self.integrates else r) - K_x @ now - K_z @ z
            s = np.where(finite, y, plant.output(now))
            if law.feedback == "state":
                s = now[: self.plant.nx]
            u, cut = law.split(v, s, d if len(d) else None)
            if self.integrates:
                z = z + np.where(finite, y - r, 0) + np.linalg.pinv(K_z) @ cut
            x = plant.step(now, plant.every_input(u, d))
            return u

        return step


# its limits come from a long run, and files of tests take the same loops
make_loop = functools.cache(Loop)

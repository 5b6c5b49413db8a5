"""The law u = phi^-1(v, s) of random monotone maps: is every v reached, how exactly?

    python -m benchmarks.inverse [--points 1000000]

Random maps of one to three inputs, ten neurons that see u and ten that do not, of mild
and of steep curves.  Inputs u of three standard deviations are mapped to v and back.
Prints the largest slope of phi in the sample, the points without a solution (nan),
those that miss u by more than 1e-12 of its size, the largest error, and the time per
point; then, where there is a gcc, points that miss, largest error and time of the law
in C that `to_c` writes.
Exits with 1 if a point is without a solution, or one misses u where the map has one
input or is mild.
"""

import argparse
import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn.forms import of_structure
from alssnn.models import state_space
from alssnn.persistence import to_c
from alssnn.plant import Plant

NX, N_H = 3, 10
SIZES = {"mild": 1.0, "steep": 5.0}
TOLERANCE = 1e-12
CHUNK = 10_000
MANY = """
#include "plant.h"

void many(int n, const double *v, const double *s, double *u)
{
    double cut[PLANT_NU];
    int k;
    for (k = 0; k < n; k++)
        plant_law(v + k * PLANT_NU, s + k * PLANT_NS, u + k * PLANT_NU, cut);
}
"""


def make_plant(nu, size, rng):
    """Return a plant with a random map; `size` multiplies all that makes it steep."""
    structure = state_space(
        NX, nu, 1, n_h=N_H, C=np.eye(1, NX), feedback="state", input_map="monotone"
    )
    p = {k: 0.4 * rng.standard_normal(shape) for k, shape in structure.shapes.items()}
    for name in ("U_phi", "r_phi", "V_phi"):
        p[name] *= size
    unit = {"x": np.ones(NX), "u": np.ones(nu), "y": np.ones(1)}
    return Plant(
        **of_structure(structure, structure.join(p), unit),
        u_offset=np.zeros(nu),
        y_offset=np.zeros(1),
        u_scale=unit["u"],
        y_scale=unit["y"],
        x_scale=unit["x"],
        dt=1.0,
        inputs=[f"u[{i}]" for i in range(nu)],
        outputs=["y"],
        name="map",
        delay=np.zeros(nu, dtype=int),
    )


def law_in_c(plant, folder):
    """Return the law in C as a function of v and s."""
    to_c(plant, folder, observer=False)
    (folder / "many.c").write_text(MANY)
    files = ["-o", folder / "law.so", folder / "many.c", folder / "plant.c", "-lm"]
    subprocess.run(["gcc", "-O2", "-shared", "-fPIC", *files], check=True)
    many = ctypes.CDLL(str(folder / "law.so")).many

    def law(v, s):
        u = np.empty_like(v)
        many(len(v), *(z.ctypes.data_as(ctypes.c_void_p) for z in (v, s, u)))
        return u

    return law


class Law:
    """Count what a law misses."""

    def __init__(self, function):
        self.function = function
        self.lost, self.missed, self.worst, self.seconds = 0, 0, 0.0, 0.0

    def __call__(self, v, s, u):
        """Solve for u, and compare."""
        start = time.process_time()
        found = self.function(v, s)
        self.seconds += time.process_time() - start
        error = np.abs(found - u).max(axis=1) / (1 + np.abs(u).max(axis=1))
        is_lost = ~np.isfinite(error)
        self.lost += int(is_lost.sum())
        self.missed += int((error > TOLERANCE).sum())
        self.worst = max(self.worst, float(error[~is_lost].max()))


def measure(plant, laws, n, rng):
    """Let laws solve for random inputs; return the largest slope of the map."""
    steepest = 0.0
    for _ in range(-(-n // CHUNK)):
        s = rng.standard_normal((CHUNK, NX))
        u = 3 * rng.standard_normal((CHUNK, plant.nu))
        v = u + plant.cancelled(s, u)
        for law in laws:
            law(v, s, u)
        ahead = 1e-6 * rng.standard_normal(u.shape)
        moved = ahead + plant.cancelled(s, u + ahead) - plant.cancelled(s, u)
        size = np.linalg.norm(ahead, axis=1)
        steepest = max(steepest, float((np.linalg.norm(moved, axis=1) / size).max()))
    return steepest


def main():
    """Run all maps."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--points", type=int, default=1_000_000)
    args = parser.parse_args()
    print(
        f"{'inputs':>6s} {'map':>6s} {'slope':>9s} {'nan':>6s} {'missed':>9s} "
        f"{'error':>9s} {'us':>6s} {'C missed':>9s} {'C error':>9s} {'C us':>6s}"
    )
    n, failed = CHUNK * -(-args.points // CHUNK), False
    for nu in (1, 2, 3):
        for name, size in SIZES.items():
            rng = np.random.default_rng(nu)
            plant = make_plant(nu, size, rng)
            with tempfile.TemporaryDirectory() as folder:
                laws = [Law(plant.law)]
                if shutil.which("gcc"):
                    laws.append(Law(law_in_c(plant, Path(folder))))
                slope = measure(plant, laws, args.points, rng)
            lost, figures = sum(law.lost for law in laws), []
            for law in laws:
                us = 1e6 * law.seconds / n
                figures.append(f"{law.missed:9d} {law.worst:9.2g} {us:6.2f}")
            print(f"{nu:6d} {name:>6s} {slope:9.3g} {lost:6d}", *figures, flush=True)
            missed = sum(law.missed for law in laws)
            failed |= lost > 0 or ((nu == 1 or name == "mild") and missed > 0)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

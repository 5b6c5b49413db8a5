"""The law u = phi^-1(v, s) of random monotone maps: is every v reached, how exactly?

    python -m benchmarks.inverse [--points 1000000]

Random maps of one to three inputs, ten neurons that see u and ten that do not, of mild
and of steep curves.  Inputs u of three standard deviations are mapped to v and back.
Prints the largest slope of phi in the sample, the points without a solution (nan),
those that miss u by more than 1e-12 of its size, the largest error, and the time per
point.
Exits with 1 if a point is without a solution, or one misses u where the map has one
input or is mild.
"""

import argparse
import os
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn.models import state_space
from alssnn.virtual import VirtualMap

NX, N_H = 3, 10
SIZES = {"mild": 1.0, "steep": 5.0}
TOLERANCE = 1e-12
CHUNK = 10_000


def make_map(nu, size, rng):
    """Return a random map; `size` multiplies all that makes it steep."""
    structure = state_space(
        NX, nu, 1, n_h=N_H, C=np.eye(1, NX), feedback="state", input_map="monotone"
    )
    p = {k: 0.4 * rng.standard_normal(shape) for k, shape in structure.shapes.items()}
    for name in ("U_phi", "r_phi", "V_phi"):
        p[name] *= size
    law = structure.law()
    return VirtualMap(law.lure(law.join(p)), np.ones(nu))


def measure(map_, n, rng):
    """Return the largest slope, counts of nan and of misses, largest error, time."""
    steepest, lost, missed, worst, seconds = 0.0, 0, 0, 0.0, 0.0
    for _ in range(-(-n // CHUNK)):
        s = rng.standard_normal((CHUNK, NX))
        u = 3 * rng.standard_normal((CHUNK, map_.nu))
        v = u + map_.cancelled(s, u)
        start = time.process_time()
        found = map_.inverse(s, v)
        seconds += time.process_time() - start
        ahead = 1e-6 * rng.standard_normal(u.shape)
        moved = ahead + map_.cancelled(s, u + ahead) - map_.cancelled(s, u)
        size = np.linalg.norm(ahead, axis=1)
        steepest = max(steepest, float((np.linalg.norm(moved, axis=1) / size).max()))
        error = np.abs(found - u).max(axis=1) / (1 + np.abs(u).max(axis=1))
        is_lost = ~np.isfinite(error)
        lost += int(is_lost.sum())
        missed += int((error > TOLERANCE).sum())
        worst = max(worst, float(error[~is_lost].max()))
    return steepest, lost, missed, worst, 1e6 * seconds / (CHUNK * -(-n // CHUNK))


def main():
    """Run all maps."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--points", type=int, default=1_000_000)
    args = parser.parse_args()
    print(
        f"{'inputs':>6s} {'map':>6s} {'slope':>9s} {'nan':>6s} {'missed':>7s} "
        f"{'error':>9s} {'us':>6s}"
    )
    failed = False
    for nu in (1, 2, 3):
        for name, size in SIZES.items():
            rng = np.random.default_rng(nu)
            slope, lost, missed, worst, us = measure(
                make_map(nu, size, rng), args.points, rng
            )
            print(
                f"{nu:6d} {name:>6s} {slope:9.3g} {lost:6d} {missed:7d} {worst:9.2g} "
                f"{us:6.1f}",
                flush=True,
            )
            failed |= lost > 0 or ((nu == 1 or name == "mild") and missed > 0)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

"""The simulated plants of the field benchmark, by name, and a check of their data.

python -m benchmarks.field.plants
"""

import sys
import warnings

import numpy as np

from alssnn import LinearStateSpace

from .blocks import AWKWARD, BLOCKS
from .later import LATER
from .latest import LATEST
from .mechanics import MACHINES
from .newest import NEWEST
from .processes import PROCESSES

PLANTS = {
    case.name: case
    for case in (
        *MACHINES,
        *PROCESSES,
        *BLOCKS,
        *AWKWARD,
        *LATER,
        *LATEST,
        *NEWEST,
    )
}


def check(case):
    """Return R2 of a linear model on the test of a case, after a look at its data."""
    data = case.load()
    for u, y in [*data.train, *data.tests["fresh"]]:
        if not np.isfinite(u).all() or np.isinf(y).any() or np.nanmin(y.std(0)) == 0:
            raise ValueError(f"{case.name}: the record is not finite or does not move")
    model = LinearStateSpace(dt=data.dt).fit(*map(list, zip(*data.train, strict=True)))
    u, y = data.tests["fresh"][0]
    return model.score(u, y), model.nx_


def main():
    """Print what a linear model explains of every plant."""
    warnings.simplefilter("ignore")
    wrong = 0
    for case in PLANTS.values():
        score, nx = check(case)
        good = -0.1 < score < (0.9999 if case.kind == "linear" else 0.999)
        wrong += not good
        print(
            f"{case.name:20s}{case.kind:36s}{case.split:8s}R2 {score:8.4f}  "
            f"e {np.sqrt(max(1 - score, 0)):7.2%}  nx {nx:2d}"
            f"{'' if good else '  <- out of range'}",
            flush=True,
        )
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())

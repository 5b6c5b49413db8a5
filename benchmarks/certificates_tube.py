"""Tubes of the plant around the model: how often do future records stay in them?

    python -m benchmarks.certificates_tube [--draws 20] [--fresh 200] [--level 0.9]

A linear model of two states, which none of these plants is, is fitted to one record of
each, and its tube is calibrated again and again on fresh records: on 52 experiments of
200 samples, of which 13 fit the scale, or on the blocks of one long record.  Every tube
is tried on the same further records.  Printed are the units of the calibration, the
share r / (n + 1) that is promised on average over calibrations, the mean of what was
kept, its standard deviation over calibrations, what the beta distribution says of it,
and the median half width over the standard deviation of y.
"""

import argparse
import os
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import beta

from alssnn import LinearStateSpace
from alssnn.datasets import make_duffing, make_pendulum, make_valve_tank

PLANTS = {
    "pendulum": (make_pendulum, 6000),
    "Duffing": (make_duffing, 4000),
    "tank": (make_valve_tank, 20_000),
}
SAMPLES = 200
EXPERIMENTS = 52
NOISE = 0.01


def records(make, n, seeds):
    """Return inputs and outputs of fresh records."""
    pairs = [make(n, noise=NOISE, random_state=seed) for seed in seeds]
    return [pair.u for pair in pairs], [pair.y for pair in pairs]


def cases(make, long, fresh):
    """Return what makes the records of a calibration, and those it is tried on."""

    def experiments(draw):
        first = 10_000 + draw * EXPERIMENTS
        return records(make, SAMPLES, range(first, first + EXPERIMENTS))

    def blocks(draw):
        return records(make, long, [1 + draw])

    return {
        "experiments": (
            experiments,
            records(make, SAMPLES, range(1000, 1000 + fresh)),
            {"block": "experiment"},
        ),
        "blocks": (blocks, records(make, long, range(500, 510)), {"block": 40}),
        "blocks, auto": (blocks, records(make, long, range(500, 510)), {}),
    }


def main(arguments=None):
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--fresh", type=int, default=200)
    parser.add_argument("--level", type=float, default=0.9)
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")  # a linear model that does not fit is what is meant
    print(
        f"{'plant':10}{'units':14}{'n':>5}{'promised':>10}{'kept':>8}{'sd':>7}"
        f"{'beta':>7}{'width':>8}"
    )
    for plant, (make, long) in PLANTS.items():
        train = make(1000, noise=NOISE, random_state=0)
        model = LinearStateSpace(nx=2, dt=train.dt).fit(*train)
        for name, (draw, fresh, choice) in cases(make, long, options.fresh).items():
            rows = []
            for i in range(options.draws):
                tube = model.tube(*draw(i), level=options.level, **choice)
                n = int(tube.n_blocks[0])
                rank = np.ceil((n + 1) * options.level - 1e-9)
                spread = beta(rank, n + 1 - rank).std() if rank <= n else 0.0
                kept, width = tube.contains(*fresh).mean(), tube.typical[0]
                rows.append((n, min(rank / (n + 1), 1), kept, spread, width))
            n, promised, kept, spread, _ = np.mean(rows, axis=0)
            width = np.median([row[-1] for row in rows])  # some may be infinite
            width /= np.std(np.concatenate(fresh[1]))
            print(
                f"{plant:10}{name:14}{n:5.0f}{promised:10.3f}{kept:8.3f}"
                f"{np.std([row[2] for row in rows]):7.3f}{spread:7.3f}{width:8.2f}",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Settled periods: what is gained by a fit that knows them?

    python -m benchmarks.periodic [--seeds 5] [--quick]

Plants of `benchmarks.next_input` are excited by multisines of 256 samples, two
realizations, from rest, with white noise at the outputs.  FL-SSNN of the right order is
fitted to the whole record with an initial state of every experiment (estimate), and to
the mean over the settled periods with the state that comes back (periodic, eq. steady).
Errors are those of a simulation of the second periods of four other realizations,
without noise, relative to the noise.

All samples tell as much as the mean period and the transient together.  So a perfect
fit of them cannot be worse than one of the mean; what can be better are the choices by
hidden samples, and the search for a minimum.  Ratios are medians over seeds, below one
where periods pay.  Without --quick (one seed)
the table goes to doc/benchmarks/periodic.md.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import FlSsnn
from alssnn.excitation import multisine
from benchmarks._tables import OUT, machine
from benchmarks.next_input import PLANTS

PERIOD, TESTS = 256, 4
PERIODS, NOISES = (3, 6), (0.01, 0.03, 0.1)


def study(plant, n_periods, noise, seed):
    """Return errors and times of both fits, (2, 2)."""
    nu, rng = plant.B.shape[1], np.random.default_rng(seed)
    options = {"nu": nu, "band": (0, 0.2), "random_state": seed}
    sent = multisine(PERIOD, n_periods=n_periods, n_realizations=2, **options)
    y = [plant(u) for u in sent.experiments]
    y = [one + noise * rng.standard_normal(one.shape) for one in y]
    options["random_state"] = 1_000 + seed
    fresh = multisine(PERIOD, n_periods=2, n_realizations=TESTS, **options)
    told = []
    for policy in ({}, {"initial_state": "periodic", "period": PERIOD}):
        start = time.process_time()
        model = FlSsnn(
            nx=len(plant.A),
            n_h=6,
            feedback="output",
            n_init=1,
            random_state=0,
            **policy,
        )
        model.fit(sent.experiments, y)
        seconds = time.process_time() - start
        errors = [(model.predict(u) - plant(u))[PERIOD:] for u in fresh.experiments]
        told.append([np.sqrt(np.mean(np.square(errors))) / noise, seconds])
    return np.array(told)


def main(arguments=None):
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args(arguments)
    seeds, load = 1 if options.quick else options.seeds, os.getloadavg()[0]
    lines = [
        "| plant | periods | noise | estimate | periodic | ratio | times |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    ratios = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for name, plant in PLANTS.items():
            for n_periods in PERIODS:
                for noise in NOISES:
                    told = np.array(
                        [study(plant, n_periods, noise, seed) for seed in range(seeds)]
                    )
                    whole, settled = np.median(told[:, :, 0], axis=0)
                    ratio = np.median(told[:, 1] / told[:, 0], axis=0)
                    ratios.append(ratio[0])
                    lines.append(
                        f"| {name} | {n_periods} | {noise:g} | {whole:.2f} | "
                        f"{settled:.2f} | {ratio[0]:.2f} | {ratio[1]:.2f} |"
                    )
                    print(lines[-1], flush=True)
    better = int(np.sum(np.array(ratios) < 1))
    lines += ["", f"Periods are better in {better} of {len(ratios)} rows."]
    print(lines[-1])
    if not options.quick:
        head = (
            f"Error of a simulation over the noise, medians over seeds ({seeds}); and "
            "ratios of errors and of the time of a fit, periodic over estimate.\n"
        )
        text = "\n".join([head, *lines, "", machine(load, np, alssnn), ""])
        (OUT / "periodic.md").write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Models to sample: how many of them could have made the record?

    python -m benchmarks.samples [--draws 100]

An FL-SSNN is identified from 2,000 samples of the pendulum with 5 % of noise.  Models
are then drawn from the first-order covariance of its parameters, and by refits to the
record with more noise (eq. bootstrap).  To first order, the sum of squared errors of a
draw, over the variance of the noise, exceeds that of the fit by a chi-square of as many
degrees of freedom as the model has effective parameters: 99 % of the draws belong below
its quantile.
"""

import argparse
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import chi2
from sklearn.exceptions import ConvergenceWarning

from alssnn import FlSsnn
from alssnn.datasets import make_pendulum
from benchmarks._options import by_hand

LEVEL = 0.99


def main():
    """Draw models of two sizes in both ways and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=100)
    draws = parser.parse_args().draws
    record = make_pendulum(2_000, noise=0.05, random_state=0)
    # draws that diverge are counted
    warnings.simplefilter("ignore", RuntimeWarning)
    warnings.simplefilter("ignore", ConvergenceWarning)
    print(f"neurons  draws   {'within 99 %':>12s}{'diverged':>10s}{'s each':>8s}")
    for n_h in (4, 8):
        model = by_hand(
            FlSsnn, nx=2, n_h=n_h, max_iter=200, random_state=0, dt=record.dt
        )
        model.fit(record.u, record.y)
        covariance = model.parameter_covariance(record.u, record.y)
        bound = chi2.ppf(LEVEL, covariance.n_effective)
        for name, data in (("normal", None), ("refits", (record.u, record.y))):
            start = time.perf_counter()
            models = model.sample_models(covariance, draws, random_state=0, data=data)
            seconds = (time.perf_counter() - start) / draws
            squares = np.array([squared_error(m, record) for m in models])
            growth = squares - squared_error(model, record)
            growth /= covariance.noise_covariance[0, 0]
            print(
                f"{n_h:7d}  {name:8s}{np.mean(growth < bound):12.0%}"
                f"{np.sum(~np.isfinite(growth)):10d}{seconds:8.3f}",
                flush=True,
            )


def squared_error(model, record):
    """Return the sum of squared errors of a simulation, from the trained x0."""
    return float(np.sum((record.y - model.predict(record.u, x0=model.x0_)) ** 2))


if __name__ == "__main__":
    main()

"""Wall time of a grid search with one and with two workers, and their scores.

    python -m benchmarks.grid_search [--samples 10000] [--steps 15] [--workers 2]

Searches 12 candidates of AL-SSNN over 3 folds of the measured Wiener-Hammerstein record
with ``n_jobs=1`` and ``n_jobs=2``, and prints both times, their ratio, whether all
scores are identical, and the load of the machine before each run: on a busy machine the
ratio says nothing. Two workers should take at most 1 / 1.7 of the time of one. Needs
the recording in ALSSNN_DATA_HOME.
"""

import argparse
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("PYTHONWARNINGS", "ignore")  # workers print theirs otherwise

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import GridSearchCV

from alssnn import AlSsnn, scorers
from alssnn.datasets import fetch_wiener_hammerstein
from alssnn.model_selection import BlockedTimeSeriesSplit
from benchmarks._options import by_hand

START = 20_000  # where the input is at full strength
GRID = {"nx": [4, 6], "n_h": [5], "n_g": [5, 8], "gamma": [1.0, 0.1, 0.01]}
SCORING = {
    "accuracy": scorers.neg_rmse,
    "linearity": scorers.neg_linearization_error,
}


def run(u, y, steps, n_jobs):
    """Return the seconds and all scores of one search."""
    search = GridSearchCV(
        by_hand(AlSsnn, max_iter=steps, random_state=0),
        GRID,
        cv=BlockedTimeSeriesSplit(3, gap=100),
        scoring=SCORING,
        refit=False,
        n_jobs=n_jobs,
        error_score="raise",
    )
    start = time.perf_counter()
    search.fit(u, y)
    seconds = time.perf_counter() - start
    results = search.cv_results_
    scores = [results[f"split{i}_test_{name}"] for name in SCORING for i in range(3)]
    return seconds, np.array(scores)


def main():
    """Search twice and print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--steps", type=int, default=15)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    record, _ = fetch_wiener_hammerstein()
    part = slice(START, START + options.samples)
    u, y = record.u[part], record.y[part]
    seconds, scores = {}, {}
    for n_jobs in (options.workers, 1):
        # workers start, and import, before the clock does
        GridSearchCV(
            by_hand(AlSsnn, nx=1, n_h=1, n_g=1, max_iter=1),
            {"gamma": [1.0] * 4},
            n_jobs=n_jobs,
        ).fit(u[:200], y[:200])
        load = os.getloadavg()[0]
        seconds[n_jobs], scores[n_jobs] = run(u, y, options.steps, n_jobs)
        print(f"n_jobs={n_jobs}: {seconds[n_jobs]:7.1f} s, load before {load:.1f}")
    same = np.array_equal(scores[1], scores[options.workers])
    print(f"ratio {seconds[1] / seconds[options.workers]:.2f} (target 1.7, idle)")
    print(f"scores identical: {'yes' if same else 'NO'}, {scores[1].size} of them")


if __name__ == "__main__":
    main()

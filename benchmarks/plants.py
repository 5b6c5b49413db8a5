"""Models of the simulated plants: accuracy and linearizability within two minutes.

    python -m benchmarks.plants [--seed 0]

Trains on the first half of pendulum, Duffing oscillator (noise 1 %) and prey-predator
(no noise) and prints the test error against the noise-free output and the linearization
error, both as shares of the standard deviation of the output.
"""

import argparse
import os
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.datasets import make_duffing, make_pendulum, make_prey_predator
from benchmarks._options import by_hand

SAMPLES = 8_000  # of pendulum and oscillator, half of them for training
TRANSIENT = 200  # samples of the test half, not scored


def main():
    """Train every model on every plant and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    seed = parser.parse_args().seed
    warnings.simplefilter("ignore", ConvergenceWarning)
    matched = {"nx": 2, "n_h": 8, "random_state": seed}
    matched_models = (
        ("LTI", LinearStateSpace(nx=2)),
        ("FL-SSNN, h(y)", by_hand(FlSsnn, **matched)),
        ("FL-SSNN, h(x)", by_hand(FlSsnn, feedback="state", **matched)),
    )
    large = {"nx": 3, "coarse_samples": 10_000, "random_state": seed}
    output_penalty = {
        "feedback": "state",
        "penalty": "output",
        "stability": "contractive",
        "phi": 1e-3,
    }
    large_models = (
        ("LTI", LinearStateSpace(nx=3)),
        ("GR-SSNN", by_hand(GrSsnn, n_f=12, **large)),
        ("AL-SSNN, h(y)", by_hand(AlSsnn, gamma=1.0, **large)),
        # With |g|^2 in state coordinates the basis hides g: |g| is small and its part
        # of the output is large. The penalty on the output does not allow that.
        ("AL-SSNN, h(x), e", by_hand(AlSsnn, gamma=0.1, **output_penalty, **large)),
    )
    options = {"noise": 0.01, "random_state": seed}
    print(f"{'plant':16s}{'model':18s}{'test error':>12s}{'lin. error':>12s}{'s':>8s}")
    for name, make, models in (
        ("pendulum", lambda **k: make_pendulum(SAMPLES, **k), matched_models),
        ("Duffing", lambda **k: make_duffing(SAMPLES, **k), matched_models),
        ("prey-predator", lambda **k: make_prey_predator(), large_models),
    ):
        noisy, clean = make(**options), make(**options | {"noise": 0.0})
        train, test = noisy.split(0.5)
        y = clean.split(0.5)[1].y
        for label, model in models:
            start = time.perf_counter()
            model.fit(train.u, train.y)
            seconds = time.perf_counter() - start
            x0 = model.estimate_x0(test.u, test.y, n_samples=TRANSIENT)
            e = (model.predict(test.u, x0=x0) - y)[TRANSIENT:]
            error = np.sqrt(np.mean(e**2)) / y.std()
            linearity = model.linearizability(train.u, train.y)
            linear = float(np.max(linearity.linearization_error))
            row = f"{name:16s}{label:18s}{error:12.2%}{linear:12.2%}{seconds:8.1f}"
            print(row, flush=True)


if __name__ == "__main__":
    main()

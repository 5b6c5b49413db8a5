"""Does the experiment that a model asks for tell more than a random one?

    python -m benchmarks.next_input [--seeds 10] [--quick]

Plants x+ = A x + B (u + h(y)), y = C x, whose law is known, with noise of 0.02 at the
outputs.  The first record is 300 samples of steps within half of the range of the
inputs.  FL-SSNN of the right order is fitted to it (one random start, else the
defaults), and the second experiment of 300 samples is chosen from the same 24 signals
within the whole range, of `excitation.menu`: by `next_input`, at random, and at random
from those that reach the limits.  Both records together are fitted again.

The error of a law is that of h at the outputs of a long record of the true plant over
the whole range, as a share of h there; affine functions of y are taken out of both,
since A and h may share them.  Ratios are of the errors after the chosen and after a
random experiment of the same seed.

Without --quick (two seeds) the table goes to doc/benchmarks/next_input.md.
"""

import argparse
import os
import sys
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import FlSsnn
from alssnn.excitation import menu, steps
from benchmarks._tables import OUT, machine

SAMPLES, CANDIDATES, NOISE = 300, 24, 0.02
TRUE = 4_000  # samples of the record on which laws are judged


class Plant:
    """Hold a plant whose law is known.

    Parameters
    ----------
    A, B, C : array_like
        Linear part.
    h : callable
        Returns h of an array of outputs, shape (..., nu).
    """

    def __init__(self, A, B, C, h):
        self.A, self.B, self.C = (np.array(M, dtype=float) for M in (A, B, C))
        self.h = h

    def __call__(self, u):
        """Return the outputs from rest, without noise."""
        x, y = np.zeros(len(self.A)), np.empty((len(u), len(self.C)))
        for k, one in enumerate(u):
            y[k] = self.C @ x
            x = self.A @ x + self.B @ (one + self.h(y[k]))
        return y


PLANTS = {
    "spring": Plant(
        [[1.6, -0.8], [1, 0]],
        [[1], [0]],
        [[0.15, 0.1]],
        lambda y: -0.8 * np.tanh(2 * y) + 0.4 * y,
    ),
    "valve": Plant(
        [[1.5, -0.56], [1, 0]],
        [[1], [0]],
        [[0.05, 0.04]],
        lambda y: -0.6 * y**2 / (1 + y**2),
    ),
    "two axes": Plant(
        [[1.5, -0.7, 0], [1, 0, 0], [0.1, 0, 0.8]],
        [[1, 0], [0, 0], [0, 1]],
        [[0.15, 0.1, 0], [0, 0, 0.2]],
        lambda y: np.stack(
            [
                -0.6 * np.tanh(2 * y[..., 0]) + 0.3 * y[..., 1],
                -0.5 * np.tanh(1.5 * (y[..., 0] + y[..., 1])),
            ],
            axis=-1,
        ),
    ),
}


def law_error(model, plant, y):
    """Return the error of the law of a model at outputs, relative to the law."""
    v = np.zeros((len(y), plant.B.shape[1]))
    u = model.plant_.law(v, y)  # u = v - h(y)
    Q = np.linalg.qr(np.hstack([np.ones((len(y), 1)), y]))[0]
    wrong, right = (z - Q @ (Q.T @ z) for z in (u + plant.h(y), plant.h(y)))
    return float(np.linalg.norm(wrong) / np.linalg.norm(right))


def fit(plant, records):
    """Return a model of some records."""
    us, ys = zip(*records, strict=True)
    model = FlSsnn(nx=len(plant.A), n_h=6, feedback="output", n_init=1, random_state=0)
    return model.fit(list(us), list(ys))


def run(plant, seed):
    """Return errors after the first record and each second one, and the latter."""
    rng, nu = np.random.default_rng(seed), plant.B.shape[1]

    def measure(u):
        y = plant(u)
        return u, y + NOISE * rng.standard_normal(y.shape)

    options = {"low": -1.0, "high": 1.0, "random_state": seed}
    truth = plant(steps(TRUE, nu, **{**options, "random_state": 1_000}).u)
    half = {**options, "low": -0.5, "high": 0.5}
    first = measure(steps(SAMPLES, nu, **half).u)
    model = fit(plant, [first])
    signals = menu(SAMPLES, nu, n_candidates=CANDIDATES, **options)
    asked = model.next_input(*first, candidates=signals)
    guess = int(rng.integers(CANDIDATES))
    loud = [i for i, one in enumerate(signals) if np.all(one.high == 1.0)]
    chosen = asked.best, guess, int(rng.choice(loud))
    errors = [law_error(model, plant, truth)]
    for signal in (signals[i] for i in chosen):
        second = measure(signal.u)
        errors.append(law_error(fit(plant, [first, second]), plant, truth))
    return np.array(errors), chosen


def table(runs):
    """Return the table of all plants, in Markdown."""
    lines = [
        "| plant | first record | + chosen | + random | + random, loud "
        "| ratio to random | ratio to loud |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    every = []
    for name, rows in runs.items():
        errors = np.array([row for row, _ in rows])
        ratios = errors[:, 1:2] / errors[:, 2:]
        every.append(ratios)
        middle = [f"{100 * value:.1f} %" for value in np.median(errors, axis=0)]
        lines.append(f"| {name} | {' | '.join([*middle, *map(_spread, ratios.T)])} |")
    cells = ["all", *[""] * 4, *map(_spread, np.concatenate(every).T)]
    return "\n".join([*lines, f"| {' | '.join(cells)} |"])


def _spread(ratio):
    """Return median, quartiles, and how often it is below one."""
    low, middle, high = np.quantile(ratio, [0.25, 0.5, 0.75])
    below = f"{np.sum(ratio < 1)} of {len(ratio)}"
    return f"{middle:.2f} ({low:.2f} to {high:.2f}), below 1 in {below}"


def main(arguments=None):
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args(arguments)
    seeds = 2 if options.quick else options.seeds
    runs, load = {}, os.getloadavg()[0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for name, plant in PLANTS.items():
            runs[name] = []
            for seed in range(seeds):
                runs[name].append(run(plant, seed))
                errors, chosen = runs[name][-1]
                print(name, seed, errors.round(4), chosen, flush=True)
    text = table(runs)
    print(text)
    if not options.quick:
        head = (
            f"Error of the law, a share of it, medians of {seeds} seeds; and ratios of "
            "that after the chosen experiment to that after a random one: medians and "
            "quartiles.\n"
        )
        (OUT / "next_input.md").write_text(
            f"{head}\n{text}\n\n{machine(load, np, alssnn)}\n", encoding="utf-8"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

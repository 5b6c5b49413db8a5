"""Training over a horizon: is a model that is too simple better further ahead?

    python -m benchmarks.horizon [--seeds 4] [--samples 2000] [--horizons 1 5 10]

A plant has two states with h(y) = -0.8 tanh(2 y) + 0.4 y at its input (none for the
linear models), and beside them a slow and a fast one that the models, of two states,
have not; noise of the process (0.05) and of the sensor (0.02); steps as excitation, in
open loop or with u = r - 0.4 y.  Linear models and FL-SSNN (four neurons, feedback of
the output, alpha = 1e-5, one start) are fitted with ``noise="innovations"`` and
`horizon`.  Told are errors on a fresh record 1, 5, 10 and 20 samples ahead and of a
simulation, relative to the standard deviation of y, the mean over the seeds; in how
many of them the error k samples ahead is lower with horizon=k than with 1; and seconds.

Required: in all of them.  Exits with 1 if one is missed; writes its table to
doc/benchmarks, unless --quick (one seed, horizons 1 and 5).
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn import FlSsnn, LinearStateSpace
from benchmarks._tables import OUT

AHEAD = 1, 5, 10, 20
BEGIN = 100  # samples of a fresh record that do not count
A = np.array([[1.6, -0.8], [1.0, 0.0]])
TITLES = (
    "model",
    "loop",
    "horizon",
    *(f"{k} ahead" for k in AHEAD),
    "free",
    "better",
    "s",
)


def make_record(is_linear, gain, n, seed):
    """Return inputs and outputs of shape (n,)."""
    rng = np.random.default_rng(seed)
    r = np.repeat(rng.uniform(-1.5, 1.5, n // 8 + 1), 8)[:n]
    x, s, (u, y) = np.zeros(2), np.zeros(2), np.empty((2, n))
    for k in range(n):
        own = 0.15 * x[0] + 0.1 * x[1] + 0.3 * s[0] + 0.1 * s[1]
        y[k] = own + 0.02 * rng.standard_normal()
        u[k] = r[k] - gain * y[k]
        v = u[k] + 0.05 * rng.standard_normal()
        v += 0.0 if is_linear else -0.8 * np.tanh(2 * own) + 0.4 * own
        x = A @ x + np.array([v, 0.0])
        s = np.array([0.97 * s[0] + 0.03 * v, -0.5 * s[1] + 0.5 * v])
    return u, y


def figures(name, gain, horizon, n, seed):
    """Return the errors on a fresh record, the free run last, and seconds."""
    options = {"nx": 2, "noise": "innovations", "horizon": horizon}
    if name == "linear":
        model = LinearStateSpace(**options)
    else:
        options |= {"n_h": 4, "feedback": "output", "alpha": 1e-5}
        model = FlSsnn(n_init=1, random_state=0, **options)
    start = time.perf_counter()
    model.fit(*make_record(name == "linear", gain, n, seed))
    seconds = time.perf_counter() - start
    u, y = make_record(name == "linear", gain, n, 1000 + seed)
    found = [model.predict_ahead(u, y, k) for k in AHEAD] + [model.predict(u)]
    return [*(np.std((y - z)[BEGIN:]) / np.std(y) for z in found), seconds]


def compare(name, gain, horizons, n, seeds):
    """Return one row per horizon."""
    rows, first = [], None
    for horizon in horizons:
        found = [figures(name, gain, horizon, n, seed) for seed in range(seeds)]
        found = np.array(found)
        first = found if first is None else first
        place = AHEAD.index(horizon)
        better = int(np.sum(found[:, place] < first[:, place]))
        loop = "closed" if gain else "open"
        rows.append((name, loop, horizon, *found.mean(axis=0)[:-1], better))
        rows[-1] += (found[:, -1].mean(), seeds)
        print("".join(f"{cell:>10s}" for cell in cells(rows[-1])), flush=True)
    return rows


def missed(rows):
    """Return the rows of which a horizon did not help every time, as text."""
    return [", ".join(cells(row)) for row in rows if row[2] > 1 and row[-3] < row[-1]]


def cells(row):
    """Return a row as text."""
    *head, better, seconds, seeds = row
    errors = [f"{error:.2%}" for error in head[3:]]
    better = f"{better} of {seeds}" if head[2] > 1 else ""
    return [*map(str, head[:3]), *errors, better, f"{seconds:.1f}"]


def write(rows, options):
    """Write the table as Markdown."""
    text = [
        "# Training over a horizon",
        "",
        f"By `python -m benchmarks.horizon`: {options.seeds} records of "
        f"{options.samples} samples of a plant",
        "with two states more than the models. Mean errors on fresh records, relative",
        "to the standard deviation of y, and in how many of them the error so many",
        "samples ahead as the horizon has is lower than with a horizon of 1. Required:",
        "in all.",
        "",
        f"| {' | '.join(TITLES)} |",
        "|" + "---|" * len(TITLES),
        *(f"| {' | '.join(cells(row))} |" for row in rows),
        "",
        *(f"Missed: {text}." for text in missed(rows) or ["nothing"]),
    ]
    (OUT / "horizon.md").write_text("\n".join(text) + "\n")


def main():
    """Measure, print, and compare with what is required."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=2_000)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument(
        "--horizons", type=int, nargs="+", choices=AHEAD, default=[1, 5, 10]
    )
    parser.add_argument("--quick", action="store_true", help="one seed, no file")
    options = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)
    seeds = 1 if options.quick else options.seeds
    horizons = [1, 5] if options.quick else options.horizons
    print("".join(f"{title:>10s}" for title in TITLES))
    rows = [
        row
        for name in ("linear", "FL-SSNN")
        for gain in (0.0, 0.4)
        for row in compare(name, gain, horizons, options.samples, seeds)
    ]
    for text in missed(rows):
        print("missed:", text)
    if not options.quick:
        write(rows, options)
    return int(bool(missed(rows)))


if __name__ == "__main__":
    sys.exit(main())

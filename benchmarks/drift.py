"""A load or a sensor that drifts: what is gained by declaring it?

    python -m benchmarks.drift [--seeds 5] [--samples 2000]

A linear plant of two inputs, two outputs and three states has a random walk (0.02 per
sample, and 0.003 per sample) at its outputs or at its inputs, noise of the process
(0.02) and of the sensors (0.05), and is excited by steps, in open loop or with
u = r - 0.4 y.  `LinearStateSpace` is fitted with ``noise="innovations"``, without and
with a `drift` of the kind that there is, on the first half of a record.  Told are the
largest error over the seeds of the frequency response, relative in the Frobenius norm
over 30 frequencies; of the errors one sample ahead on the second half, over those of
the Kalman filter that knows the plant; and of the output at the end of 800 samples of
``model.mpc()`` on the true plant with a constant load.

Required with drift: 3 %, 1.05, 1e-6.  Exits with 1 if one is missed; writes its table
to doc/benchmarks, unless --quick (one seed).
"""

import argparse
import os
import sys
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.linalg import block_diag, solve_discrete_are

from alssnn import LinearStateSpace
from benchmarks._tables import OUT

A = np.array([[0.9, 0.2, 0.0], [-0.2, 0.8, 0.1], [0.0, 0.0, 0.6]])
B = np.array([[1.0, 0.0], [0.0, 0.5], [0.3, 1.0]])
C = np.array([[0.3, 0.1, 0.0], [0.0, 0.2, 0.5]])
PROCESS, SENSOR, GAIN = 0.02, 0.05, 0.4
LIMITS = 0.03, 1.05, 1e-6
LOAD, REFERENCE = np.array([0.3, -0.2]), np.array([0.2, 0.4])
BEGIN = 300  # samples of the second half that do not count
STEPS = 800  # of the loop
TITLES = ("walk", "at", "loop", "drift", "response", "1 ahead", "offset")


def make_record(walk, kind, gain, n, seed):
    """Return inputs and outputs of shape (n, 2)."""
    rng = np.random.default_rng(seed)
    x, b = np.zeros(3), 0.5 * rng.standard_normal(2)
    r = np.repeat(rng.uniform(-1, 1, (n // 10 + 1, 2)), 10, axis=0)[:n]
    u, y = np.empty((2, n, 2))
    for k in range(n):
        y[k] = C @ x + b * (kind == "output") + SENSOR * rng.standard_normal(2)
        u[k] = r[k] - gain * y[k]
        w = PROCESS * rng.standard_normal(3)
        x = A @ x + B @ (u[k] + b * (kind == "input")) + w
        b = b + walk * rng.standard_normal(2)
    return u, y


def least_error(walk, kind):
    """Return the mean square error one sample ahead of the Kalman filter."""
    by_b = B if kind == "input" else np.zeros((3, 2))
    A_b = np.block([[A, by_b], [np.zeros((2, 3)), np.eye(2)]])
    C_b = np.hstack([C, np.eye(2) * (kind == "output")])
    Q = block_diag(PROCESS**2 * np.eye(3), walk**2 * np.eye(2))
    R = SENSOR**2 * np.eye(2)
    P = solve_discrete_are(A_b.T, C_b.T, Q, R)
    return float(np.trace(C_b @ P @ C_b.T + R)) / 2


def response(A_m, B_m, C_m):
    """Return the frequency response."""
    z = np.exp(1j * np.geomspace(0.01, 3, 30))
    return np.array([C_m @ np.linalg.solve(s * np.eye(len(A_m)) - A_m, B_m) for s in z])


def offset(model, kind):
    """Return the error at the end of a loop with a constant load."""
    mpc, x = model.mpc(), np.zeros(3)
    for _ in range(STEPS):
        y = C @ x + LOAD * (kind == "output")
        x = A @ x + B @ (mpc.step(REFERENCE, y) + LOAD * (kind == "input"))
    return float(np.abs(y - REFERENCE).max())


def compare(walk, kind, gain, n, seeds):
    """Return two rows, without and with drift."""
    rows, true = [], response(A, B, C)
    for drift in (None, kind):
        worst = np.zeros(3)
        for seed in range(seeds):
            u, y = make_record(walk, kind, gain, 2 * n, seed)
            model = LinearStateSpace(nx=3, noise="innovations", drift=drift)
            model.fit(u[:n], y[:n])
            left = (y[n:] - model.predict_ahead(u[n:], y[n:]))[BEGIN:]
            found = response(model.A_, model.B_, model.C_)
            errors = [
                np.linalg.norm(found - true) / np.linalg.norm(true),
                np.sqrt(np.mean(left**2) / least_error(walk, kind)),
                offset(model, kind),
            ]
            worst = np.maximum(worst, errors)
        loop = "closed" if gain else "open"
        rows.append((walk, kind, loop, drift or "none", *worst))
        print("".join(f"{cell:>12s}" for cell in cells(rows[-1])), flush=True)
    return rows


def missed(rows):
    """Return the rows with drift that miss what is required, as text."""
    return [
        ", ".join(cells(row))
        for row in rows
        if row[3] != "none" and not np.all(np.array(row[4:]) <= LIMITS)
    ]


def cells(row):
    """Return a row as text."""
    return [*map(str, row[:4]), f"{row[4]:.2%}", f"{row[5]:.3f}", f"{row[6]:.1e}"]


def write(rows, options):
    """Write the table as Markdown."""
    text = [
        "# A load or a sensor that drifts",
        "",
        f"By `python -m benchmarks.drift`: the worst of {options.seeds} records of "
        f"{options.samples} samples",
        "of a plant of two inputs and two outputs with a random walk. Error of the",
        "frequency response; error one sample ahead on the samples that follow, over",
        "that of the Kalman filter of the true plant; offset of predictive control",
        "under a constant load. Required with drift: 3 %, 1.05, 1e-6.",
        "",
        f"| {' | '.join(TITLES)} |",
        "|" + "---|" * len(TITLES),
        *(f"| {' | '.join(cells(row))} |" for row in rows),
        "",
        *(f"Missed: {text}." for text in missed(rows) or ["nothing"]),
    ]
    (OUT / "drift.md").write_text("\n".join(text) + "\n")


def main():
    """Measure, print, and compare with what is required."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=2_000)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="one seed, no file")
    options = parser.parse_args()
    warnings.simplefilter("ignore", UserWarning)
    seeds = 1 if options.quick else options.seeds
    print("".join(f"{title:>12s}" for title in TITLES))
    rows = [
        row
        for walk in (0.02, 0.003)
        for kind in ("output", "input")
        for gain in (0.0, GAIN)
        for row in compare(walk, kind, gain, options.samples, seeds)
    ]
    for text in missed(rows):
        print("missed:", text)
    if not options.quick:
        write(rows, options)
    return int(bool(missed(rows)))


if __name__ == "__main__":
    sys.exit(main())

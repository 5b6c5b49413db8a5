"""Systems of every kind in the model class: does a fit reach the noise floor?

    python -m benchmarks.model_class [--kind ...] [--seeds 5] [--quick]

Every kind is a known system of the model class with one feature that a plain model
lacks.  From a record with 1 % of noise a model of this kind is identified; it is then
simulated on fresh inputs, from rest.  The figure is the root mean square of its error,
fresh noisy outputs minus simulation, over that of their noise, for the worst output of
each seed: 1 is what the truth itself would reach.

The second table is out of core: the peak memory of one norm and one pass for the
normal equations, on single-precision records on disk.

Without --quick it writes both tables to doc/benchmarks.  Exits with 1 if the worst
ratio of a kind exceeds 1.5, or the memory grows with the record.
"""

import argparse
import csv
import os
import sys
import tempfile
import time
import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import scipy
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import AlSsnn, FlSsnn, GrSsnn
from benchmarks._options import by_hand
from benchmarks._tables import OUT, machine

COLUMNS = ("kind", "seed", "ratio", "seconds", "system")
TARGET = 1.5
NOISE = 0.01  # standard deviation relative to that of the noise-free output
SAMPLES = 2_000
MEMORY_SAMPLES = (1_000_000, 4_000_000)
MEMORY_TARGET = 1.0  # MB, of the difference


@dataclass(frozen=True)
class System:
    """Hold x+ = A x + B (u + h(s)) + g(x, u), y = C x + D u + k(x, u), as functions."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    h: Callable = lambda x, y: 0.0
    g: Callable = lambda x, u: 0.0
    k: Callable = lambda x, u: 0.0
    delay: int = 0

    def simulate(self, u):
        """Return the outputs from rest."""
        x, y = np.zeros(len(self.A)), np.empty((len(u), len(self.C)))
        late = np.vstack([np.zeros((self.delay, u.shape[1])), u])[: len(u)]
        for i, v in enumerate(late):
            y[i] = self.C @ x + self.D @ v + self.k(x, v)
            drive = self.B @ (v + self.h(x, y[i]))
            x = self.A @ x + drive + self.g(x, v)
        return y


def linear(nu=1, ny=1, feedthrough=0.0):
    """Return matrices of a stable system of order 2 (SISO) or 3."""
    if (nu, ny) == (1, 1):
        A, B = np.array([[0.7, 0.3], [-0.3, 0.7]]), np.array([[0.5], [0.3]])
        C = np.array([[1.0, 0.5]])
    else:
        A = np.array([[0.7, 0.3, 0.0], [-0.3, 0.7, 0.1], [0.0, 0.0, 0.5]])
        B = np.array([[0.5, 0.0], [0.2, 0.4], [0.0, 0.6]])
        C = np.array([[1.0, 0.0, 0.3], [0.0, 1.0, 0.0], [0.2, -0.3, 1.0]])
    return A, B, C, np.full((ny, nu), feedthrough)


def two_layers(x, u):
    """Return a residual with two hidden layers of two neurons."""
    first = np.tanh([1.2 * x[0] + 0.5 * u[0] + 0.3, x[1] - 0.8 * x[0] - 0.4])
    rest = np.tanh([0.3, -0.4])
    inner = np.array([[1.5, -1.0], [0.8, 1.6]])
    gain = np.array([[0.08, -0.06], [0.04, 0.08]])  # stable in all its range
    return gain @ (np.tanh(inner @ first) - np.tanh(inner @ rest))


@dataclass(frozen=True)
class Kind:
    """Say what is identified, by which model, and from what kind of data."""

    system: System
    model: object
    missing: float = 0.0  # share of the outputs that is not measured
    lengths: tuple = (SAMPLES,)  # of the experiments


COMMON = {"random_state": 0, "operating_point": "zero", "max_iter": 150}
FEEDBACK = {"n_h": 4, "gamma_h": 1e-6, **COMMON}


def sat(x, y):
    """Return a nonlinearity of the output at the input of a SISO system."""
    return 0.5 * np.tanh(1.5 * y)


KINDS = {
    "plain": Kind(System(*linear(), h=sat), by_hand(FlSsnn, 2, **FEEDBACK)),
    "feedthrough": Kind(
        System(*linear(feedthrough=0.4), h=sat),
        by_hand(AlSsnn, 2, n_g=0, feedthrough=True, **FEEDBACK),
    ),
    "nonlinear output k": Kind(
        System(*linear(), k=lambda x, u: 0.4 * np.tanh(1.5 * x[:1] + 0.5 * u)),
        by_hand(GrSsnn, 2, n_f=0, n_k=4, **COMMON),
    ),
    "two-layer g": Kind(
        System(*linear(), g=two_layers),
        # an initial state that is free may stand for another rest than that of C x = 0
        by_hand(
            GrSsnn,
            2,
            n_f=(6, 4),
            **{**COMMON, "initial_state": "rest", "max_iter": 400},
        ),
    ),
    "2 inputs, 3 outputs": Kind(
        System(*linear(2, 3), h=lambda x, y: 0.4 * np.tanh(y[:2])),
        by_hand(FlSsnn, 3, **{**FEEDBACK, "n_h": 6}),
    ),
    "delay of 3, found": Kind(
        System(*linear(), h=sat, delay=3),
        by_hand(FlSsnn, 2, input_delay="auto", **FEEDBACK),
    ),
    "20 % missing": Kind(
        System(*linear(), h=sat), by_hand(FlSsnn, 2, **FEEDBACK), missing=0.2
    ),
    "5 experiments": Kind(
        System(*linear(), h=sat),
        by_hand(FlSsnn, 2, **FEEDBACK),
        lengths=(100, 250, 400, 550, 700),
    ),
    "odd h": Kind(System(*linear(), h=sat), by_hand(FlSsnn, 2, odd=True, **FEEDBACK)),
    "sigmoid": Kind(
        System(*linear(), h=sat), by_hand(FlSsnn, 2, activation="sigmoid", **FEEDBACK)
    ),
    "sin": Kind(
        System(*linear(), h=lambda x, y: 0.4 * np.sin(1.5 * y)),
        by_hand(FlSsnn, 2, activation="sin", **FEEDBACK),
    ),
    "state feedback, all of it": Kind(
        System(
            *linear(feedthrough=0.4),
            h=lambda x, y: 0.5 * np.tanh(x[:1]),
            g=lambda x, u: np.array([0.0, 0.1 * np.tanh(2 * x[0] + u[0])]),
            k=lambda x, u: 0.3 * np.tanh(x[1:]),
        ),
        by_hand(
            AlSsnn,
            2,
            n_h=4,
            n_g=4,
            n_k=4,
            gamma=1e-6,
            gamma_k=1e-6,
            gamma_h=1e-6,
            feedback="state",
            feedthrough=True,
            **COMMON,
        ),
    ),
}


def data(kind, seed):
    """Return training records, and inputs, noisy outputs and noise for the test."""
    rng, system = np.random.default_rng(seed), kind.system
    nu = system.B.shape[1]
    us = [rng.uniform(-1.5, 1.5, (n, nu)) for n in (*kind.lengths, SAMPLES)]
    clean = [system.simulate(u) for u in us]
    size = NOISE * np.vstack(clean).std(axis=0)
    noise = [size * rng.standard_normal(y.shape) for y in clean]
    ys = [y + e for y, e in zip(clean, noise, strict=True)]
    train = [np.where(rng.random(y.shape) < kind.missing, np.nan, y) for y in ys[:-1]]
    return (us[:-1], train), (us[-1], ys[-1], noise[-1])


def ratio(kind, seed):
    """Fit one model; return its error over the noise, of the worst output."""
    train, (u, y, noise) = data(kind, seed)
    model = clone(kind.model).set_params(random_state=seed).fit(*train)
    error = y - model.predict(u)
    return float(np.max(np.sqrt(np.mean(error**2, axis=0) / np.mean(noise**2, axis=0))))


def identify(names, seeds):
    """Print a row per kind; return the rows of the table."""
    print(f"{'kind':28s}{'median':>9s}{'worst':>9s}{'s per fit':>11s}")
    rows = []
    for name in names:
        new = []
        for seed in seeds:
            start = time.perf_counter()
            value = ratio(KINDS[name], seed)
            new.append((name, seed, value, time.perf_counter() - start))
        values, seconds = np.array([row[2:] for row in new]).T
        print(
            f"{name:28s}{np.median(values):9.3f}{values.max():9.3f}"
            f"{np.median(seconds):11.1f}",
            flush=True,
        )
        rows += new
    return rows


# -- out of core -----------------------------------------------------------------------


def peak_memory(n_samples):
    """Return the peak memory of one norm and one pass on a record on disk, in MB."""
    from alssnn.criterion import Criterion
    from alssnn.models import state_space
    from alssnn.optimizers import single_threaded
    from alssnn.scaling import Scaling

    rng = np.random.default_rng(0)
    structure = state_space(3, 1, 1, n_h=3, C=np.ones((1, 3)))
    theta = 0.1 * rng.standard_normal(structure.n_params)
    scaling = Scaling(np.zeros(1), np.zeros(1), np.ones(1), np.ones(1))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.npy"
        disk = np.lib.format.open_memmap(path, "w+", np.float32, (n_samples, 2))
        for start in range(0, n_samples, 100_000):
            disk[start : start + 100_000] = rng.standard_normal((100_000, 2))
        disk.flush()
        disk = np.load(path, mmap_mode="r")
        for n in (5_000, n_samples):  # the first compiles the kernels
            u, y = scaling.scale_u(disk[:n, :1]), scaling.scale_y(disk[:n, 1:])
            criterion = Criterion(structure, [(u, y)])
            free = criterion.join(theta, np.zeros((1, 3)))
            tracemalloc.start()
            with single_threaded():
                criterion.norm(free)
                criterion.normal_equations(free)
            peak = tracemalloc.get_traced_memory()[1] / 1e6
            tracemalloc.stop()
    return peak


# -- table -----------------------------------------------------------------------------


def write_table(rows, peaks, load):
    """Write all runs as CSV, and medians as Markdown."""
    OUT.mkdir(parents=True, exist_ok=True)
    note = machine(load, alssnn, np, scipy)
    with (OUT / "model_class.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for kind, seed, value, seconds in rows:
            writer.writerow([kind, seed, f"{value:.6g}", f"{seconds:.3g}", note])
    text = [
        "# Systems of every kind in the model class",
        "",
        "By `python -m benchmarks.model_class`. Ratio: error of the simulation on",
        f"fresh data over their noise ({NOISE:.0%} of the output), worst output.",
        "",
        "| kind | seeds | median ratio | worst ratio | s per fit |",
        "|---|---|---|---|---|",
    ]
    for kind in dict.fromkeys(row[0] for row in rows):
        values, seconds = np.array([row[2:] for row in rows if row[0] == kind]).T
        text.append(
            f"| {kind} | {len(values)} | {np.median(values):.3f} | {values.max():.3f} "
            f"| {np.median(seconds):.1f} |"
        )
    text += [
        "",
        "Out of core: peak of the memory that Python and NumPy allocate in one norm",
        "and one pass for the normal equations, record in single precision on disk.",
        "",
        "| samples | record, MB | peak, MB |",
        "|---|---|---|",
        *(f"| {n:,} | {8e-6 * n:.0f} | {peak:.2f} |" for n, peak in peaks.items()),
        "",
        f"{note}.",
    ]
    (OUT / "model_class.md").write_text("\n".join(text) + "\n")


def main():
    """Run, print, write, and compare with the targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", choices=KINDS, nargs="+", default=list(KINDS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="one seed, no files")
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    load = os.getloadavg()[0]
    rows = identify(options.kind, range(1 if options.quick else options.seeds))
    samples = [n // 10 for n in MEMORY_SAMPLES] if options.quick else MEMORY_SAMPLES
    peaks = {n: peak_memory(n) for n in samples}
    for n, peak in peaks.items():
        print(f"{n:,} samples on disk: peak memory of a pass {peak:.2f} MB", flush=True)
    if not options.quick and set(options.kind) == set(KINDS):
        write_table(rows, peaks, load)
    low, high = peaks.values()
    return int(max(row[2] for row in rows) > TARGET or high > low + MEMORY_TARGET)


if __name__ == "__main__":
    sys.exit(main())

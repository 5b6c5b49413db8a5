"""Speed and memory of the engine, as ratios of what runs side by side.

    python -m benchmarks.speed [--plain]

At N = 100,000, nx = 6, n_h = n_g = 10 (219 columns, 7 channels), one BLAS thread:

- one pass for (J'J, J'r), its simulation included, over a bare `dsyrk` of as many
  rows and columns (in blocks of 20,000 rows), and the same with two threads, which
  takes two idle cores;
- one simulation over that pass;
- peak memory of a fit above the data, at N = 100,000 and 1,000,000 (Linux);
- the time of `import alssnn` and what it must not import;
- the time of the first model of the README without numba over that with it, and how
  long the first compilation takes.

`--plain` runs without numba.  Exits with 1 if a target is missed.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

N, NX, N_H, N_G = 100_000, 6, 10, 10
REPEATS = 5
BLOCK = 20_000
TARGETS = {
    "pass / dsyrk": 1.8,
    "pass in two threads / dsyrk": 1.05,
    "simulation / pass": 0.3,
    "memory at N = 100,000, MB": 300,
    "memory at N = 1,000,000, MB": 1000,
    "import, s": 1.0,
}


def problem(n_samples, n_jobs=None):
    """Return a criterion and a free vector of the size that is measured."""
    from alssnn.criterion import Criterion
    from alssnn.models import state_space

    rng = np.random.default_rng(0)
    A = rng.standard_normal((NX, NX))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    structure = state_space(
        NX, 1, 1, n_h=N_H, n_g=N_G, C=rng.standard_normal((1, NX))
    ).observe("y", "g")
    p = {k: 0.1 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    u, y = rng.standard_normal((n_samples, 1)), rng.standard_normal((n_samples, 1))
    criterion = Criterion(
        structure, [(u, y)], weights={"y": 1.0, "g": 16.0}, n_jobs=n_jobs
    )
    return criterion, criterion.join(structure.join({**p, "A": A}), np.zeros((1, NX)))


def measure_speed():
    """Return the ratios of pass, dsyrk and simulation, medians of paired runs."""
    from scipy.linalg.blas import dsyrk

    from alssnn.optimizers import single_threaded

    criterion, free = problem(N)
    threaded, _ = problem(N, n_jobs=2)
    n, rows = criterion.n, N * criterion.structure.nz
    J = np.random.default_rng(0).standard_normal((BLOCK, n))
    times = {"dsyrk": [], "pass": [], "pass in two threads": [], "simulation": []}
    with single_threaded():
        criterion.normal_equations(free)  # compiles the kernels
        for i in range(REPEATS):
            start = time.perf_counter()
            C = np.zeros((n, n), order="F")
            for _ in range(rows // BLOCK):
                C = dsyrk(1.0, J.T, beta=1.0, c=C, overwrite_c=1)
            times["dsyrk"].append(time.perf_counter() - start)
            start = time.perf_counter()
            criterion.norm(
                free * (1 + 1e-12 * (i + 1))
            )  # a new point: nothing remembered
            times["simulation"].append(time.perf_counter() - start)
            start = time.perf_counter()
            criterion.normal_equations(free)
            times["pass"].append(time.perf_counter() - start)
            start = time.perf_counter()
            threaded.normal_equations(free)
            times["pass in two threads"].append(time.perf_counter() - start)
    ratio = {
        f"{a} / {b}": np.median(np.divide(times[a], times[b]))
        for a, b in (
            ("pass", "dsyrk"),
            ("pass in two threads", "dsyrk"),
            ("simulation", "pass"),
        )
    }
    return {name: np.median(t) for name, t in times.items()}, ratio


def measure_memory(n_samples):
    """Return the peak memory of a whole fit above that of the data, in MB."""
    from alssnn import AlSsnn
    from alssnn.datasets import make_wiener_hammerstein
    from benchmarks._options import by_hand

    model = by_hand(
        AlSsnn, nx=NX, n_h=N_H, n_g=N_G, max_iter=2, polish_iter=2, random_state=0
    )
    warnings.simplefilter("ignore")
    # libraries and compiled code are not ours
    model.fit(*make_wiener_hammerstein(3000, random_state=0))
    record = make_wiener_hammerstein(n_samples, random_state=0)
    before = _status("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak starts anew
    model.fit(*record)
    return _status("VmHWM") - before


def _status(key):
    """Return a memory figure of this process, in MB (Linux)."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) / 1024


def measure_import():
    """Return the median time of `import alssnn` in a fresh process, in seconds."""
    script = (
        "import sys, time; t = time.perf_counter(); import alssnn; "
        "t = time.perf_counter() - t; "
        "assert not {'cvxpy', 'control', 'matplotlib'} & set(sys.modules); print(t)"
    )
    return np.median([float(_run("-c", script)) for _ in range(5)])


def measure_compilation():
    """Return how much longer a default fit takes without numba, and to compile.

    Returns
    -------
    ratio : float
        Processor time of the first model of the README, without numba over with it.
    first : float
        Further processor time of a process that finds nothing compiled, in seconds.
    """
    with tempfile.TemporaryDirectory() as cache:
        first, again = (_run_fit("", NUMBA_CACHE_DIR=cache) for _ in range(2))
    plain = _run_fit("sys.modules['numba'] = None; ")
    return plain / again, first - again


def _run_fit(before, **variables):
    """Return the processor time of the first model of the README, in seconds."""
    script = (
        f"import sys, time; {before}import alssnn; "
        "record = alssnn.datasets.make_pendulum(3_000, noise=0.01, random_state=0); "
        "train, _ = record.split(0.5); t = time.process_time(); "
        "alssnn.AlSsnn(nx=2, n_init=1, dt=record.dt, random_state=0)"
        ".fit(train.u, train.y); print(time.process_time() - t)"
    )
    return float(_run("-c", script, env=os.environ | variables))


def _run(*arguments, **options):
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        check=True,
        **options,
    ).stdout


def main():
    """Measure, print, and compare with the targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plain", action="store_true", help="run without numba")
    parser.add_argument("--memory", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.plain:
        sys.modules["numba"] = None
    if options.memory:
        print(measure_memory(options.memory))
        return 0
    flags = ["--plain"] if options.plain else []
    seconds, figures = measure_speed()
    for n_samples in (100_000, 1_000_000):
        out = _run("-m", "benchmarks.speed", "--memory", str(n_samples), *flags)
        figures[f"memory at N = {n_samples:,}, MB"] = float(out)
    figures["import, s"] = measure_import()
    if not options.plain:
        ratio, first = measure_compilation()
        print(f"fit without numba / with {ratio:.2g}, first compilation {first:.2g} s")
    load = os.getloadavg()[0]
    print(f"numba {'off' if options.plain else 'on'}, load {load:.1f}")
    print(", ".join(f"{name} {value:.3f} s" for name, value in seconds.items()))
    for name, value in figures.items():
        print(f"{name:28s}{value:10.3g}   target {TARGETS[name]:g}")
    return int(any(value > TARGETS[name] for name, value in figures.items()))


if __name__ == "__main__":
    sys.exit(main())

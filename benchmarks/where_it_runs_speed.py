"""Steps of exports per second: C and an FMU, in programs in C.

    python -m benchmarks.where_it_runs_speed [--steps 1000000]

A plant with nx = 6, n_h = 10, n_g = 10, one input and one output, h(y).  An FMU of FMI
3.0 is loaded by a program in C that sets the input, reads the output and steps; law and
observer (correct, law, step) and the controller run as in `benchmarks.embedded`, by
`gcc -O2`.  Prints the median of seven runs, in microseconds of processor time, and
writes doc/benchmarks/where_it_runs_speed.csv.  Exits with 1 if a limit is missed: 1
microsecond a step of the FMU, 0.5 of law and observer.  Needs gcc and fmpy.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import numpy as np

from alssnn.feedback import LinearizingLaw, lqi
from alssnn.persistence import to_c
from benchmarks._tables import OUT, machine, replace_runs
from benchmarks.embedded import MAIN
from exported import fast_plant

RUNS, SAMPLES = 7, 1000
COLUMNS = ("what", "us per step", "limit, us")
FMU, LAW, CONTROLLER = "step of an FMU 3.0", "law + observer in C", "controller in C"
LIMITS = {FMU: 1.0, LAW: 0.5}


def fmu_times(plant, folder, steps):
    """Return microseconds per step of an FMU, of every run."""
    from test_fmu import hosted

    run = hosted(plant, folder)
    return [1e6 * run(steps)[1] for _ in range(RUNS)]


def c_times(plant, folder, steps):
    """Return microseconds of law + observer, and of the controller, of every run."""
    limits = plant.u_offset - plant.u_scale, plant.u_offset + plant.u_scale
    gain = lqi(plant, np.eye(plant.nx + 1), np.eye(1))
    to_c(plant, folder, law=LinearizingLaw(plant, *limits), gain=gain)
    y = plant.y_offset + np.random.default_rng(0).standard_normal(SAMPLES)
    values = ",\n".join(map(repr, y.tolist()))
    blanks = {"samples": SAMPLES, "values": values, "steps": steps}
    (folder / "main.c").write_text(MAIN.format(s="&y[k % SAMPLES]", **blanks))
    command = "gcc -O2 -std=c99 -Wall -Werror -o main main.c plant.c -lm"
    subprocess.run(command.split(), cwd=folder, check=True)
    runs = []
    for _ in range(RUNS):
        done = subprocess.run([folder / "main"], capture_output=True, check=True)
        *seconds, total = map(float, done.stdout.split())
        if not np.isfinite(total):
            raise RuntimeError("The loop of the benchmark diverges.")
        runs.append(1e6 * np.array(seconds) / steps)
    return np.transpose(runs)


def main():
    """Measure, print, write, and compare with the limits."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1_000_000)
    steps = parser.parse_args().steps
    note, plant = machine(os.getloadavg()[0], np), fast_plant()
    with tempfile.TemporaryDirectory() as folder:
        times = dict(
            zip((LAW, CONTROLLER), c_times(plant, Path(folder), steps), strict=True)
        )
    with tempfile.TemporaryDirectory() as folder:
        times[FMU] = fmu_times(plant, Path(folder), steps)
    rows, missed = [], False
    for name, runs in times.items():
        median, limit = float(np.median(runs)), LIMITS.get(name)
        missed |= limit is not None and median > limit
        rows.append([name, f"{median:.3f}", "" if limit is None else f"{limit:g}"])
        print("  ".join(rows[-1]), flush=True)
    replace_runs(OUT / "where_it_runs_speed.csv", COLUMNS, rows, note)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

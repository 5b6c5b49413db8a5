"""The law of an identity and of a monotone input map: time per step in C and Python.

    python -m benchmarks.law_speed [--steps 1000000]

FL-SSNN of a simulated arm that a fan lifts (nx = 2, defaults): u = v - h(s) beside the
law that solves v = phi(u, s) for u.  States of one standard deviation and inputs of two
are mapped to v and back: by the C that `to_c` writes (`gcc -O2 -std=c99`) in double and
single precision, by `model.linearizing_law()` one sample at a time, and by the same
with a thousand samples as rows.  Prints medians of seven runs in microseconds of
processor time, and the largest error of u in its range, and writes the table to
doc/benchmarks/law_speed.inc; without gcc only Python is timed and nothing written.
Exits with 1 if a step in C takes more than 2 microseconds in double precision, or an
error in double precision exceeds 1e-12.
"""

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn import FlSsnn
from alssnn.datasets import make_fan_arm
from benchmarks._tables import OUT

STEP_US, TOLERANCE = 2.0, 1e-12
SAMPLES, RUNS = 1000, 7
MAPS = ("identity", "monotone")
TITLES = ["input map", "C, double", "C, float", "Python", "Python, rows", "error"]

# The signals cycle, so that nothing can be computed beforehand; all inputs of the first
# cycle are printed, and the sum of all, so that nothing can be left out.
MAIN = """\
#include <stdio.h>
#include <time.h>

#include "plant.h"

#define SAMPLES {samples}

static const plant_real v[SAMPLES][PLANT_NU] = {{{v}}};
static const plant_real s[SAMPLES][PLANT_NS] = {{{s}}};

int main(void)
{{
    plant_real u[PLANT_NU], cut[PLANT_NU];
    double sum = 0;
    long k;
    clock_t start = clock();
    for (k = 0; k < {steps}; k++) {{
        plant_law(v[k % SAMPLES], s[k % SAMPLES], u, cut);
        sum += u[0];
    }}
    printf("%.9g %.9g\\n", (double)(clock() - start) / CLOCKS_PER_SEC, sum);
    for (k = 0; k < SAMPLES; k++) {{
        plant_law(v[k], s[k], u, cut);
        printf("%.17g ", (double)u[0]);
    }}
    return 0;
}}
"""


def signals(plant):
    """Return inputs, what makes them, and what the law sees, one sample per row."""
    rng = np.random.default_rng(0)
    s = plant.x_scale * rng.standard_normal((SAMPLES, plant.nx))
    u = plant.u_offset + 2 * plant.u_scale * rng.standard_normal((SAMPLES, plant.nu))
    return (
        u,
        u + (plant.cancelled(s) if plant.is_explicit else plant.cancelled(s, u)),
        s,
    )


def in_c(model, v, s, dtype, steps):
    """Return microseconds per step, and the inputs."""
    f = "f" if dtype == "float" else ""
    rows = [
        ",\n".join(
            "{" + ", ".join(f"{x!r}{f}" for x in row) + "}" for row in z.tolist()
        )
        for z in (v, s)
    ]
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        model.to_c(folder, observer=False, dtype=dtype)
        main = MAIN.format(samples=SAMPLES, v=rows[0], s=rows[1], steps=steps)
        (folder / "main.c").write_text(main)
        command = "gcc -O2 -std=c99 -Wall -Werror -o main main.c plant.c -lm"
        subprocess.run(command.split(), cwd=folder, check=True)
        run = [folder / "main"]
        lines = [
            subprocess.run(run, capture_output=True, text=True, check=True).stdout
            for _ in range(RUNS)
        ]
    seconds = [float(line.split()[0]) for line in lines]
    u = np.array(lines[0].split()[2:], dtype=float)
    return 1e6 * np.median(seconds) / steps, u


def in_python(law, v, s):
    """Return microseconds per step one by one, and by rows, and the inputs."""
    law(v, s)
    by_one, by_rows = [], []
    for _ in range(RUNS):
        start = time.process_time()
        for v_k, s_k in zip(v, s, strict=True):
            law(v_k, s_k)
        by_one.append(time.process_time() - start)
        start = time.process_time()
        for _ in range(10):
            law(v, s)
        by_rows.append((time.process_time() - start) / 10)
    each = (1e6 * np.median(seconds) / SAMPLES for seconds in (by_one, by_rows))
    return *each, law(v, s)[:, 0]


def _write(rows):
    table = [
        ".. csv-table::",
        "   :header-rows: 1",
        "",
        *("   " + ",".join(f'"{cell}"' for cell in row) for row in [TITLES, *rows]),
        "",
        "Microseconds of processor time per step of the law, FL-SSNN with 2 states and",
        f"default neurons, on one core ({platform.machine()}, ``gcc -O2``), by",
        "``python -m benchmarks.law_speed``.",
    ]
    (OUT / "law_speed.inc").write_text("\n".join(table) + "\n")


def main():
    """Measure, print, write, and compare with the targets."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=1_000_000)
    options = parser.parse_args()
    gcc = shutil.which("gcc")
    record = make_fan_arm(1000, noise=0.01, random_state=0)
    rows, missed, load = [], False, os.getloadavg()[0]
    print(f"load {load:.1f}")
    print("  ".join(TITLES))
    for name in MAPS:
        model = FlSsnn(nx=2, dt=record.dt, input_map=name, random_state=0)
        model.fit(record.u, record.y)
        u, v, s = signals(model.plant_)
        one, rows_, found = in_python(model.linearizing_law(), v, s)
        times, errors = ["", ""], [np.abs(found - u[:, 0]).max()]
        if gcc:
            double, found = in_c(model, v, s, "double", options.steps)
            single, _ = in_c(model, v, s, "float", options.steps)
            times = [f"{double:.3f}", f"{single:.3f}"]
            errors.append(np.abs(found - u[:, 0]).max())
            missed |= double > STEP_US
        error = max(errors) / np.ptp(u)
        missed |= error > TOLERANCE
        rows.append([name, *times, f"{one:.0f}", f"{rows_:.2f}", f"{error:.1e}"])
        print("  ".join(rows[-1]), flush=True)
    if gcc:
        _write(rows)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

"""Generated C: processor time of law and observer, timed inside the C program.

    python -m benchmarks.embedded [--steps 1000000]

Models of a simulated Wiener-Hammerstein circuit with nx = 6, n_h = 10, without and with
a residual (n_g = 10), output and state feedback, in double and single precision, by
`gcc -O2 -std=c99`.  One step is `correct`, `law` and `step`, or `control`, which adds
integrators and their gain.  Prints the median of seven runs and the lines of the
source, and writes the table to doc/benchmarks/embedded.inc.  Exits with 1 if a target
is missed: 2 microseconds a step in double precision, 350 lines.
"""

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, FlSsnn
from alssnn.datasets import make_wiener_hammerstein
from alssnn.feedback import lqi
from benchmarks._options import by_hand
from benchmarks._tables import OUT

STEP_US, LINES = 2.0, 350
NX, N_H, N_G = 6, 10, 10
RUNS = 7
TITLES = ["model", "type", "law + observer, us", "controller, us", "lines of C"]

# The measured outputs come from a record, so that nothing can be computed beforehand;
# the sum of the results is printed, so that nothing can be left out.
MAIN = """\
#include <stdio.h>
#include <time.h>

#include "plant.h"

#define SAMPLES {samples}

static const plant_real y[SAMPLES] = {{
{values}
}};

int main(void)
{{
    plant_real x[PLANT_NX] = {{0}}, v[PLANT_NU] = {{0}}, u[PLANT_NU], cut[PLANT_NU];
    plant_controller c;
    double sum = 0;
    long k;
    clock_t start = clock();
    for (k = 0; k < {steps}; k++) {{
        plant_correct(x, 0, &y[k % SAMPLES]);
        v[0] = y[(k + 7) % SAMPLES];
        plant_law(v, {s}, u, cut);
        plant_step(x, u);
        sum += u[0];
    }}
    printf("%.9g ", (double)(clock() - start) / CLOCKS_PER_SEC);
    plant_reset(&c);
    start = clock();
    for (k = 0; k < {steps}; k++) {{
        plant_control(&c, &y[0], &y[k % SAMPLES], u);
        sum += u[0];
    }}
    printf("%.9g %.9g\\n", (double)(clock() - start) / CLOCKS_PER_SEC, sum);
    return 0;
}}
"""


def models():
    """Return fitted models by name; how well they fit does not matter here."""
    record = make_wiener_hammerstein(3000, random_state=0)
    options = {"nx": NX, "n_h": N_H, "max_iter": 20, "random_state": 0}
    warnings.simplefilter("ignore", ConvergenceWarning)
    unfitted = {
        "FL-SSNN, h(y)": by_hand(FlSsnn, **options),
        "FL-SSNN, h(x)": by_hand(FlSsnn, feedback="state", **options),
        "AL-SSNN, h(y)": by_hand(AlSsnn, n_g=N_G, **options),
        "AL-SSNN, h(x)": by_hand(AlSsnn, n_g=N_G, feedback="state", **options),
    }
    fitted = {name: model.fit(*record) for name, model in unfitted.items()}
    return fitted, np.ravel(record.y)[:1000]


def measure(model, y, dtype, steps):
    """Return microseconds of law + observer and of the controller, lines of C."""
    limits = model.u_offset_ - model._scaling.u_scale, model.u_offset_ + 1
    law, gain = model.linearizing_law(*limits), lqi(model, np.eye(NX + 1), np.eye(1))
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        model.to_c(folder, law=law, gain=gain, dtype=dtype)
        suffix = "f" if dtype == "float" else ""
        main = MAIN.format(
            samples=len(y),
            values=",\n".join(f"{value!r}{suffix}" for value in y.tolist()),
            steps=steps,
            s="x" if law.feedback == "state" else "&y[k % SAMPLES]",
        )
        (folder / "main.c").write_text(main)
        command = "gcc -O2 -std=c99 -Wall -Werror -o main main.c plant.c -lm"
        subprocess.run(command.split(), cwd=folder, check=True)
        runs = []
        for _ in range(RUNS):
            out = subprocess.run(
                [folder / "main"], capture_output=True, text=True, check=True
            ).stdout
            *seconds, total = map(float, out.split())
            if not np.isfinite(total):
                raise RuntimeError("The loop of the benchmark diverges.")
            runs.append(seconds)
        lines = len((folder / "plant.c").read_text().splitlines())
    return [*(1e6 * np.median(runs, axis=0) / steps), lines]


def main():
    """Measure, print, write, and compare with the targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1_000_000)
    options = parser.parse_args()
    fitted, y = models()
    rows, missed = [], False
    print(f"load {os.getloadavg()[0]:.1f}")
    print("  ".join(TITLES))
    for name, model in fitted.items():
        for dtype in ("double", "float"):
            step, control, lines = measure(model, y, dtype, options.steps)
            missed |= lines >= LINES or (dtype == "double" and step > STEP_US)
            rows.append([name, dtype, f"{step:.3f}", f"{control:.3f}", str(lines)])
            print("  ".join(rows[-1]), flush=True)
    table = [
        ".. csv-table::",
        "   :header-rows: 1",
        "",
        *("   " + ",".join(f'"{cell}"' for cell in row) for row in [TITLES, *rows]),
        "",
        f"nx = {NX}, n_h = {N_H}, n_g = {N_G} for AL-SSNN; processor time on one core",
        f"({platform.machine()}, ``gcc -O2``), by ``python -m benchmarks.embedded``.",
    ]
    (OUT / "embedded.inc").write_text("\n".join(table) + "\n")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

"""The error that no model goes below, of two measured records.

    python -m benchmarks.floors

Fine steering mirror: the noise of every output at every level, by
`nonparametric.best_linear_approximation` of the training records, six realizations of
two settled periods, beside what no linear model of that level goes below.

Wiener-Hammerstein circuit: its input is not periodic, but nearly off before sample
5,200 and after sample 184,000.  What y does there beside a linear response to u is the
noise of the output.  The input is known up to a step of its converter, an error of
step / sqrt(12) rms, which passes the circuit as u does: times the norm of a linear
impulse response, fitted to 20,000 samples in between.  Both together are the floor of a
simulation.

Published errors of the cases of `benchmarks.field`, and ours, stand beside, as
multiples of these floors; of the mirror, of the mean over its outputs. Ours on the
circuit are those that `benchmarks.paper` has measured, ours on the mirror those of
default fits in doc/benchmarks/mirror.csv, which

    python -m benchmarks.field --cases mirror --models lti
                               --out doc/benchmarks/mirror.csv

has written.

Both need the records (`ALSSNN_DATA_HOME`).  The table goes to doc/benchmarks/floors.md.
"""

import argparse
import csv
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import alssnn
from alssnn.datasets import fetch_wiener_hammerstein
from alssnn.nonparametric import best_linear_approximation
from alssnn.regression import lagged
from benchmarks._tables import OUT, machine
from benchmarks.field.records import RECORDS
from benchmarks.field.runs import MODELS, read

LAGS = 60  # of linear responses
QUIET = slice(1000, 5000), slice(185_000, 188_000)  # the input is nearly off
STEP = 3.43342e-4  # V, of the converters of the circuit
LIVELY = slice(20_000, 40_000)


def mirror():
    """Return rows (level, output, noise, what no linear model goes below), in um."""
    folder = Path(os.environ["ALSSNN_DATA_HOME"]) / "fine_steering_mirror"
    rows = []
    for level in (100, 200, 300):
        u, y = (
            # (samples, channels, realizations, periods)
            np.load(folder / f"{z}_{level}mV_train.npy").transpose(2, 3, 0, 1)
            for z in "uy"
        )
        # the method leaves a first period out, here one more of those that are settled
        u, y = ([np.vstack([one[-1], *one]) for one in z] for z in (u, y))
        response = best_linear_approximation(u, y, dt=1 / 6400, period=8192)
        names, noise = response.output_names, response.noise_rms
        for name, floor, total in zip(names, noise, response.total_rms, strict=True):
            rows.append((f"{level} mV", name, 1e6 * floor, 1e6 * total))
    return rows


def circuit():
    """Return noise of the output, of the input at the output, and both, in mV."""
    u, y = (
        np.concatenate([getattr(part, name)[:, 0] for part in _whole()])
        for name in ("u", "y")
    )
    past = np.column_stack([lagged(u[:, None], range(LAGS)), np.ones(len(u))])
    noise = []
    for part in QUIET:
        response = np.linalg.lstsq(past[part], y[part])[0]
        noise.append(np.std(y[part] - past[part] @ response))
    at_output = float(np.sqrt(np.mean(np.square(noise))))
    response = np.linalg.lstsq(past[LIVELY], y[LIVELY])[0][:LAGS]
    through = float(np.linalg.norm(response)) * STEP / np.sqrt(12)
    return tuple(1e3 * z for z in (at_output, through, np.hypot(at_output, through)))


def _whole():
    """Return both parts of the record, one behind the other."""
    return fetch_wiener_hammerstein(split="paper")


def multiples(case, floors, published):
    """Return rows of published errors over the floors of their tests."""
    return [
        f"| {case}, {test} | {model} | {errors[test]:.3g} "
        f"| {errors[test] / floor:.2f} |"
        for test, floor in floors.items()
        for model, errors in published.items()
    ]


def ours_on_circuit():
    """Return the errors on the circuit that `benchmarks.paper` has measured, in mV."""
    with (OUT / "wh_accuracy.csv").open(encoding="utf-8", newline="") as file:
        return {
            f"{row['model']}, this package": {"test": 1e3 * float(row["test"])}
            for row in csv.DictReader(file)
        }


def ours_on_mirror():
    """Return the errors on the mirror that `benchmarks.field` has measured, in um."""
    errors = {}
    for row in read(OUT / "mirror.csv"):
        model = f"{MODELS[row['model']].__name__}, nx={row['nx']}, this package"
        errors.setdefault(model, {})[row["test"]] = float(row["rmse"])
    return errors


def main():
    """Run the benchmark."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    load = os.getloadavg()[0]
    rows, (at_output, through, both) = mirror(), circuit()
    lines = [
        "| mirror, level | output | noise, um | no linear model below, um |",
        "|---|---|--:|--:|",
        *(f"| {a} | {b} | {c:.4f} | {d:.4f} |" for a, b, c, d in rows),
    ]
    levels = dict.fromkeys(level for level, *_ in rows)
    floors = {
        level: float(np.mean([row[2] for row in rows if row[0] == level]))
        for level in levels
    }
    lines += [
        "",
        f"Wiener-Hammerstein circuit: noise of the output {at_output:.3f} mV, steps of "
        f"the converter of the input {through:.3f} mV, both {both:.3f} mV.",
        "",
        "| test | model | error, um or mV | over the floor |",
        "|---|---|--:|--:|",
        *multiples("mirror", floors, RECORDS["mirror"].published | ours_on_mirror()),
        *multiples("circuit", {"test": both}, RECORDS["wh official"].published),
        *multiples("circuit", {"test": both}, ours_on_circuit()),
    ]
    text = "\n".join(lines)
    print(text)
    (OUT / "floors.md").write_text(
        f"{text}\n\n{machine(load, np, alssnn)}\n", encoding="utf-8"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Linear models from closed loops with noise of the process: bias, and time.

    python -m benchmarks.closed_loop_linear [--runs 100] [--samples 1000]

The plant of `benchmarks.coverage` in closed loop, u = r - 0.4 y with process noise: the
noise is in u as well, and an estimate that takes u for independent of it is biased.
From many records linear models of two states are identified: by prediction errors
(``noise="innovations"``), by simulation errors (``noise="output"``), by the subspace
starts of both without any refinement, and, where the package `sippy_unipi` is installed
(it is not needed otherwise), by N4SID and the PARSIM methods of SIPPY with horizons of
20 samples.  Compared are real and imaginary part of the pole and the static gain: mean
error, its standard error, and their quotient.

Required: the mean errors of innovations are within two standard errors of zero.  Exits
with 1 if one is not; writes its table to doc/benchmarks, unless --quick (eight
records).
"""

import argparse
import os
import sys
import time
import warnings
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from alssnn import LinearStateSpace
from alssnn.innovations import with_outputs
from alssnn.linear_model import simulation_error
from alssnn.subspace import (
    HORIZONS,
    fit_input,
    hankel_triangle,
    past_to_future,
    predictor_space,
    shift_structure,
)
from benchmarks.coverage import A, B, C, make_record

CASE, NX = "process, closed loop", 2
SIPPY = ("N4SID", "PARSIM-K", "PARSIM-S", "PARSIM-P")
HORIZON = 20  # of SIPPY, its default
OMITTED = "Rows of SIPPY are omitted, for sippy_unipi cannot be imported"
FIGURES = ("pole, real", "pole, imaginary", "static gain")
TITLES = ("method", *FIGURES, "median ms")
LIMIT = 2.0  # standard errors
REQUIRED = "innovations"


def fitted(noise, u, y):
    """Return A, B and C of a fit with the defaults."""
    model = LinearStateSpace(nx=NX, operating_point="zero", noise=noise).fit(u, y)
    return model.A_, model.B_, model.C_


def start(predicts, u, y):
    """Return A, B and C of a subspace estimate, the better of two horizons."""
    experiments = [(u[:, None], y[:, None])]
    n_measured = int(predicts)
    if predicts:
        experiments = with_outputs(experiments)
    models = []
    for horizon in HORIZONS:
        if predicts:
            space = predictor_space(experiments, horizon, n_measured=1)
        else:
            R = hankel_triangle(experiments, horizon)
            space = past_to_future(R, experiments, horizon)
        pair = shift_structure(*space, NX, 1)
        models.append(fit_input(experiments, *pair, n_measured=n_measured))
    best = min(models, key=partial(simulation_error, experiments)).by_name()
    return best["A"], best["B"], best["C"]


def by_sippy(method, u, y):
    """Return A, B and C by SIPPY."""
    import sippy_unipi

    model = sippy_unipi.system_identification(
        y[None], u[None], method, SS_fixed_order=NX, SS_f=HORIZON, SS_p=HORIZON
    )
    return model.A, model.B, model.C


def methods():
    """Return what is compared, by name: (u, y) -> A, B, C."""
    found = {
        "innovations": partial(fitted, "innovations"),
        "output": partial(fitted, "output"),
        "start of innovations": partial(start, True),
        "start of output (N4SID)": partial(start, False),
    }
    try:
        import sippy_unipi  # noqa: F401
    except ImportError as error:
        print(f"{OMITTED}: {error}.")
        return found
    return found | {f"SIPPY {name}": partial(by_sippy, name) for name in SIPPY}


def figures(A, B, C):
    """Return real and imaginary part of the pole, and the static gain."""
    poles = np.linalg.eigvals(A)
    pole = poles[np.argmax(poles.imag)]
    gain = C @ np.linalg.solve(np.eye(len(A)) - A, B)
    return np.array([pole.real, pole.imag, gain.item()])


def measure(runs, samples):
    """Return errors of shape (runs, 3) and seconds of shape (runs,), by method."""
    truth = figures(A, B[:, None], C[None])
    compared = methods()
    errors = {name: np.empty((runs, len(truth))) for name in compared}
    seconds = {name: np.empty(runs) for name in compared}
    warm = make_record(CASE, samples, runs)
    for method in compared.values():  # imports and compiled code are not counted
        method(*warm)
    for run in range(runs):
        u, y = make_record(CASE, samples, run)
        for name, method in compared.items():
            begin = time.perf_counter()
            found = method(u, y)
            seconds[name][run] = time.perf_counter() - begin
            errors[name][run] = figures(*found) - truth
    return errors, seconds


def bias(errors):
    """Return mean errors and their standard errors, of shape (3,)."""
    return errors.mean(axis=0), errors.std(axis=0, ddof=1) / np.sqrt(len(errors))


def cells(name, errors, seconds):
    """Return a row of the table as text."""
    pairs = zip(*bias(errors), strict=True)
    texts = [f"{mean:+.4f} ± {se:.4f} ({mean / se:+.1f})" for mean, se in pairs]
    return [name, *texts, f"{1e3 * np.median(seconds):.0f}"]


def main():
    """Measure, print, and compare with what is required."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--quick", action="store_true", help="8 records, no file")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    runs = 8 if options.quick else options.runs
    errors, seconds = measure(runs, options.samples)
    rows = [cells(name, errors[name], seconds[name]) for name in errors]
    mean, se = bias(errors[REQUIRED])
    missed = bool(np.any(np.abs(mean) > LIMIT * se))
    table = [
        f"| {' | '.join(TITLES)} |",
        "|" + "---|" * len(TITLES),
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
    print("\n".join(table))
    print(f"{REQUIRED} within {LIMIT:g} standard errors: {'no' if missed else 'yes'}")
    if not options.quick:
        from benchmarks._tables import OUT

        text = [
            "# Linear models from closed loops with noise of the process",
            "",
            f"By `python -m benchmarks.closed_loop_linear --runs {runs}`: mean error,",
            "its standard error and, in brackets, their quotient, of "
            f"{runs} records of {options.samples} samples; time of one fit, with one",
            "thread. The true pole is 0.8 + 0.4i, the static gain 1.25. Starts are",
            "subspace estimates without refinement; SIPPY is sippy_unipi.",
            *([] if len(rows) > len(SIPPY) else [f"{OMITTED}."]),
            "",
            *table,
        ]
        (OUT / "closed_loop_linear.md").write_text("\n".join(text) + "\n")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

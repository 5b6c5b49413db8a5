"""Measured recordings beside the circuit of the paper: errors on fresh data.

    python -m benchmarks.recordings [--record ...] [--seeds 5] [--quick]

Every model is fitted to the training part with several seeds and simulated free-run on
the test part.  Prints one row per model and test with the median over the seeds, beside
published errors, and writes the table to doc/benchmarks unless --quick.

Choices were made on training data alone: on the last quarter of the training part of
the drives, and by fitting one training run of the drone and simulating the other.  The
settings of the tanks and of the Silverbox were not tuned.

The drives are fitted with restored signs, and their test parts are simulated on from
the training parts: no output of the test is seen.  "|s|" marks fits to what was
measured, with 10 test samples for the initial state.  Elsewhere the first 50 samples of
a test estimate its initial state and are not scored.  Every run of the drone starts 10
s late, when the arm has left its stop, and is thinned to a sample every 0.05 s.
"""

import argparse
import os
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

import alssnn
from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.datasets import (
    Record,
    fetch_cascaded_tanks,
    fetch_coupled_drives,
    fetch_quarter_drone,
    fetch_silverbox,
)
from alssnn.metrics import rmse
from alssnn.rectified import restore_sign
from benchmarks._options import by_hand
from benchmarks._tables import OUT, machine, replace_runs

COLUMNS = ("recording", "test", "model", "seed", "rmse", "linearization", "radius", "s")
DRONE_EVERY = 5  # samples of 0.01 s: the arm takes seconds
DRONE_START = 1_000  # samples at the stop before the arm lifts off


@dataclass(frozen=True)
class Recording:
    """Say what a recording is made of, which models it gets and what is published."""

    load: Callable  # () -> training records, test records by name
    models: dict  # name -> estimator; those with a seed are fitted several times
    unit: str
    published: dict = field(default_factory=dict)  # source -> error by test
    scale: float = 1.0  # of y in the table
    rectified: bool = False  # y = |s|


# -- recordings ------------------------------------------------------------------------


def drives():
    """Return the drives; their tests are known by the number of the experiment."""
    train, test = fetch_coupled_drives()
    return train, {f"experiment {i}": r for i, r in enumerate(test, start=1)}


def drone():
    """Return steps and multisine, and the swept sine, of the thrust over the angle.

    The thrust goes with the square of the command, and the propeller turns one way.
    """
    runs = {
        name: Record(
            (np.maximum(run.u, 0) ** 2 / 100)[DRONE_START::DRONE_EVERY],
            run.y[DRONE_START::DRONE_EVERY],
            run.dt * DRONE_EVERY,
            run.name,
        )
        for name, run in fetch_quarter_drone().items()
    }
    train = [runs.pop("steps"), runs.pop("multisine")]
    return train, runs


def drone_command():
    """Return the same with the command itself as input."""
    train, tests = drone()

    def command(record):
        return Record(10 * np.sqrt(record.u), record.y, record.dt, record.name)

    return [*map(command, train)], {k: command(r) for k, r in tests.items()}


def tanks():
    """Return the tanks."""
    train, test = fetch_cascaded_tanks()
    return [train], {"validation": test}


def silverbox():
    """Return the Silverbox."""
    train, tests = fetch_silverbox()
    return [train], tests


DRIVES = {"nx": 4, "operating_point": "zero", "max_iter": 200, "random_state": 0}
DRIVES_H = {"n_h": 4, "odd": True, "gamma_h": 1e-3, "feedback": "state", "alpha": 1e-4}
DRONE = {"nx": 3, "n_h": 6, "gamma_h": 1e-3, "alpha": 1e-3, "max_iter": 150}
EXPERIMENTS = ("experiment 1", "experiment 2")
SILVERBOX = ("multisine", "arrow", "arrow, no extrapolation")

RECORDINGS = {
    "drives": Recording(
        drives,
        {
            "LTI": LinearStateSpace(nx=4, operating_point="zero"),
            "FL-SSNN, odd h(x)": by_hand(FlSsnn, **DRIVES_H, **DRIVES),
            "AL-SSNN, odd h(x)": by_hand(
                AlSsnn, n_g=4, penalty="output", **DRIVES_H, **DRIVES
            ),
            "GR-SSNN": by_hand(GrSsnn, n_f=5, alpha=1e-3, **DRIVES),
        },
        "ticks/s",
        {
            "LTI [1]": dict(zip(EXPERIMENTS, (0.224, 0.384), strict=True)),
            "GRU [1]": dict(zip(EXPERIMENTS, (0.286, 0.238), strict=True)),
            "LSTM [1]": dict(zip(EXPERIMENTS, (0.303, 0.145), strict=True)),
            "GP-NARX [1]": dict(zip(EXPERIMENTS, (0.102, 0.090), strict=True)),
            "best quoted": dict(zip(EXPERIMENTS, (0.115, 0.074), strict=True)),
        },
        rectified=True,
    ),
    "drives, |s|": Recording(
        drives,
        {
            "LTI": LinearStateSpace(nx=4, n_init_samples=10),
            "FL-SSNN, h(x)": by_hand(
                FlSsnn, nx=2, n_h=6, feedback="state", max_iter=200, n_init_samples=10
            ),
        },
        "ticks/s",
    ),
    "drone": Recording(
        drone,
        {
            "LTI": LinearStateSpace(nx=3),
            "FL-SSNN, h(y)": by_hand(FlSsnn, random_state=0, **DRONE),
            "AL-SSNN, h(y)": by_hand(
                AlSsnn, n_g=4, penalty="output", random_state=0, **DRONE
            ),
            "GR-SSNN": by_hand(GrSsnn, 3, 6, alpha=1e-3, max_iter=150, random_state=0),
        },
        "deg",
    ),
    "drone, u in %": Recording(
        drone_command,
        {
            "LTI": LinearStateSpace(nx=3),
            "FL-SSNN, h(y)": by_hand(FlSsnn, random_state=0, **DRONE),
            # with the defaults: the map has to find the square of the command
            "FL-SSNN, phi(u, x)": FlSsnn(nx=3, input_map="monotone", random_state=0),
            # gravity depends on the angle alone
            "FL-SSNN, phi(u, y)": by_hand(
                FlSsnn, input_map="monotone", n_init=3, random_state=0, **DRONE
            ),
        },
        "deg",
    ),
    "tanks": Recording(
        tanks,
        {
            "LTI": LinearStateSpace(nx=2),
            "FL-SSNN, h(x)": by_hand(FlSsnn, 2, 6, gamma_h=1e-3, feedback="state"),
            "AL-SSNN, h(x)": by_hand(
                AlSsnn, 2, 6, 4, gamma_h=1e-3, feedback="state", penalty="output"
            ),
            "GR-SSNN": by_hand(GrSsnn, 2, 6),
        },
        "V",
        {
            "LTI [1]": {"validation": 0.588},
            "GRU [1]": {"validation": 0.396},
            "LSTM [1]": {"validation": 0.490},
            "GP-NARX [1]": {"validation": 0.622},
        },
    ),
    "Silverbox": Recording(
        silverbox,
        {
            "LTI": LinearStateSpace(nx=2),
            "FL-SSNN, odd h(y)": by_hand(FlSsnn, 2, 6, odd=True, max_iter=100),
            "GR-SSNN": by_hand(GrSsnn, 2, 10, max_iter=100),
        },
        "mV",
        {
            "LTI [1]": dict(zip(SILVERBOX, (6.96, 14.4, 6.58), strict=True)),
            "GRU [1]": dict(zip(SILVERBOX, (1.49, 2.80, 0.947), strict=True)),
            "LSTM [1]": dict(zip(SILVERBOX, (1.50, 2.68, 0.960), strict=True)),
            "GP-NARX [1]": dict(zip(SILVERBOX, (0.301, 0.60, 0.259), strict=True)),
        },
        scale=1e3,
    ),
}


# -- one model -------------------------------------------------------------------------


def score(recording, model, train, tests, y):
    """Return error and linearization error by test of a fitted model."""
    errors = {}
    for i, (name, test) in enumerate(tests.items()):
        if recording.rectified:  # on from the training part
            u = np.vstack([train[i].u, test.u])
            s = model.predict(u, x0=model.x0_[i])
            n = len(train[i])
            y_true, y_hat = test.y, np.abs(s[n:])
            record = model.linearizability(train[i].u, y[i])
        else:
            y_true, y_hat = model.simulate_test(*test)
            record = model.linearizability(*test)
        finite = np.isfinite(y_hat).all()
        error = rmse(y_true, y_hat) if finite else np.inf
        errors[name] = error * recording.scale, float(record.linearization_error[0])
    return errors


def run(name, recording, seeds):
    """Print a row per model and test; return all runs."""
    train, tests = recording.load()
    dt = train[0].dt
    u, y = zip(*train, strict=True)
    if recording.rectified:
        linear = clone(recording.models["LTI"]).set_params(dt=dt)
        y, _ = restore_sign(u, y, linear)
    rows = []
    for label, estimator in recording.models.items():
        random = "random_state" in estimator.get_params()
        for seed in seeds if random else [0]:
            model = clone(estimator).set_params(dt=dt)
            if random:
                model.set_params(random_state=seed)
            start = time.perf_counter()
            model.fit(u, y)
            seconds = time.perf_counter() - start
            radius = float(np.abs(np.linalg.eigvals(model.A_)).max())
            with np.errstate(all="ignore"):
                errors = score(recording, model, train, tests, y)
            rows += [
                (name, test, label, seed, *pair, radius, seconds)
                for test, pair in errors.items()
            ]
        for test in tests:
            values = np.array([r[4:] for r in rows if r[1] == test and r[2] == label])
            median, worst = np.median(values, axis=0), values[:, 0].max()
            print(
                f"{name:14s}{test:25s}{label:20s}{median[0]:9.3f} {recording.unit:8s}"
                f"worst {worst:9.3f}  e {100 * median[1]:7.2f} %  "
                f"radius {median[2]:.4f}{median[3]:7.1f} s",
                flush=True,
            )
    for source, values in recording.published.items():
        for test, value in values.items():
            print(f"{name:14s}{test:25s}{source:20s}{value:9.3f} {recording.unit}")
    return rows


# -- table -----------------------------------------------------------------------------


def write_table(rows, load):
    """Write all runs as CSV, beside those of other recordings, medians as Markdown."""
    note = machine(load, alssnn, np)
    table = replace_runs(OUT / "recordings.csv", COLUMNS, rows, note)
    text = ["# Measured recordings", "", "By `python -m benchmarks.recordings`.", ""]
    text += [*__doc__.split("\n\n", 3)[3].splitlines(), ""]
    text += [
        "RMSE: of the free-run simulation on the test, median over the seeds; e: what",
        "g adds to the output, on the test (drives: on the training part).",
        "",
        "| recording | test | model | seeds | RMSE | worst | unit | e, % | radius "
        "| fit, s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, test in dict.fromkeys((row[0], row[1]) for row in table):
        recording = RECORDINGS[name]
        part = [row for row in table if row[:2] == [name, test]]
        for label in dict.fromkeys(row[2] for row in part):
            values = np.array([row[4:8] for row in part if row[2] == label], float)
            error, e, radius, seconds = np.median(values, axis=0)
            text.append(
                f"| {name} | {test} | {label} | {len(values)} | {error:.3f} | "
                f"{values[:, 0].max():.3f} | {recording.unit} | {100 * e:.2f} | "
                f"{radius:.4f} | {seconds:.1f} |"
            )
        for source, published in recording.published.items():
            if test in published:
                text.append(
                    f"| {name} | {test} | {source} | | {published[test]:.3f} | | "
                    f"{recording.unit} | | | |"
                )
    text += [
        "",
        "[1] Champneys et al., 2024, arXiv 2405.10779, who take the initial states of",
        "the drives from the first 10 test samples. Best quoted: that we know.",
        "",
    ]
    text += [f"{note}." for note in dict.fromkeys(row[-1] for row in table)]
    (OUT / "recordings.md").write_text("\n".join(text) + "\n")


def main(arguments=None):
    """Run, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--record", choices=RECORDINGS, nargs="+", default=list(RECORDINGS)
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="two seeds, no files")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore", ConvergenceWarning)
    warnings.filterwarnings("ignore", "The simulation diverges", RuntimeWarning)
    load, start = os.getloadavg()[0], time.perf_counter()
    seeds, rows = range(2 if options.quick else options.seeds), []
    for name in options.record:
        try:
            rows += run(name, RECORDINGS[name], seeds)
        except FileNotFoundError as error:
            print(f"{name}: {error}")
    print(f"{time.perf_counter() - start:.0f} s")
    if rows and not options.quick:
        write_table(rows, load)
    return int(not rows)


if __name__ == "__main__":
    sys.exit(main())

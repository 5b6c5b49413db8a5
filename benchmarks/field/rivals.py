"""Error against time beside two other packages, each in an environment of its own.

    python -m benchmarks.field.rivals [--study wh mirror] [--seconds 240] [--seeds 1]

Study "wh": the circuit, trained on 10,000 samples (rows 5,000 to 14,999), tested on the
official test part; `GrSsnn` of order 6 with 15 neurons, otherwise with its defaults,
beside jax-sysid with the same structure.
Study "mirror": freq-statespace with the settings of its authors' record, on all levels;
--realizations 3 trains it with half of the records, --ours fits one of our models, too.

The environment is made in --venv, by default a temporary folder, by pip.  Every curve
is a row per point: seconds of clock and processor since the start of the fit,
compilation included, and the error.  A point of ours is a fit of its own that ends
after a part of the seconds (`max_time`).  Nothing of a test is simulated during a fit.
The packages run one after the other; leave the machine to them.  Behind the curves
stand the last errors, and when ours passes that of theirs; --page writes them for the
manual.
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.base import clone

import alssnn
from alssnn.datasets import fetch_wiener_hammerstein
from alssnn.watch import OUT_OF_TIME

from .._tables import OUT, machine
from .records import RECORDS
from .runs import MODELS, score

HERE = Path(__file__).parent
PACKAGES = ("jax-sysid==1.0.1", "freq-statespace==0.1.2", "scipy")
COLUMNS = ("study", "test", "method", "seed", "wall", "cpu", "rmse")
TRAINING = slice(5_000, 15_000)  # rows of the circuit
SIZES = {"nx": 6, "n_f": 15}  # in both packages
LINES = np.arange(1, 3_840)  # excited frequencies of the mirror, up to 3 kHz


def environment(folder):
    """Return the interpreter of an environment with both packages, made if needed."""
    python = folder / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        pip = [python, "-m", "pip", "install", "--quiet"]
        subprocess.run([*pip, *PACKAGES], check=True)
    return python


def curve(python, script, data, *options):
    """Return the rows that a script writes, as lists of strings."""
    out = Path(data).with_suffix(".csv")
    command = [python, HERE / f"{script}.py", data, out, *map(str, options)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with out.open(newline="") as file:
        return list(csv.reader(file))


# -- ours ------------------------------------------------------------------------------


def our_curve(model, train, tests, n_init, scale, seconds):
    """Return rows (test, wall, cpu, rmse) of fits that end after a part of the seconds.

    Parts are half a power of two apart.  The first fit that ends by itself is the last.
    """
    rows = []
    for limit in seconds * 2.0 ** np.arange(-6.0, 0.5, 0.5):
        fitted = clone(model).set_params(max_time=limit)
        wall, cpu = time.perf_counter(), time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            fitted.fit(*map(list, zip(*train, strict=True)))
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        fitted.n_init_samples = n_init
        with np.errstate(all="ignore"):
            for name, test in tests.items():
                rmse = score(fitted, test, scale)["rmse"]
                rows.append((name, f"{wall:.2f}", f"{cpu:.2f}", f"{rmse:.6g}"))
        if OUT_OF_TIME not in fitted.message_:
            break
    return rows


# -- studies ---------------------------------------------------------------------------


def circuit(python, folder, options):
    """Yield rows of the study "wh"."""
    whole, _ = fetch_wiener_hammerstein()
    _, test = fetch_wiener_hammerstein(split="official")
    u, y = whole.u[TRAINING], whole.y[TRAINING]
    data = folder / "wh.npz"
    np.savez(data, u=u, y=y, u_test=test.u, y_test=test.y, scale=1e3, window=50)
    for seed in range(options.seeds):
        model = MODELS["gr"](**SIZES, dt=whole.dt, random_state=seed)
        tests = {"official": [tuple(test)]}
        for row in our_curve(model, [(u, y)], tests, 50, 1e3, options.seconds):
            yield ("wh", row[0], "gr", seed, *row[1:])
        limits = ("--seconds", options.seconds, "--seed", seed)
        limits += ("--nx", SIZES["nx"], "--n-f", SIZES["n_f"])
        for row in curve(python, "rival_jax_sysid", data, *limits):
            yield ("wh", "official", "jax-sysid", seed, *row)


def mirror(python, folder, options):
    """Yield rows of the study "mirror"."""
    case = RECORDS["mirror"]
    records = case.load()
    data = folder / "mirror.npz"
    u, y = (_stacked(z) for z in zip(*records.train, strict=True))
    tests = [zip(*test, strict=True) for test in records.tests.values()]
    pairs = zip(*[map(_stacked, test) for test in tests], strict=True)
    u_test, y_test = (np.stack(z) for z in pairs)
    np.savez(
        data,
        u=u,
        y=y,
        u_test=u_test,
        y_test=y_test,
        names=list(records.tests),
        lines=LINES,
        rate=1 / records.dt,
        scale=case.scale,
        window=case.n_init,
    )
    for seed in range(options.seeds):
        if options.ours is not None:
            model = MODELS[options.ours](dt=records.dt)
            if options.ours != "lti":
                model.set_params(random_state=seed)
            how = case.n_init, case.scale, options.seconds
            for row in our_curve(model, records.train, records.tests, *how):
                yield ("mirror", row[0], options.ours, seed, *row[1:])
        limits = ["--seconds", options.seconds, "--seed", seed]
        limits += ["--realizations", options.realizations]
        for row in curve(python, "rival_freq_statespace", data, *limits):
            yield ("mirror", row[0], "freq-statespace", seed, *row[1:])


def _stacked(signals):
    """Return signals of shape (N, n) as (N, n, n_signals)."""
    return np.stack(signals, axis=2)


STUDIES = {"wh": circuit, "mirror": mirror}


# -- what the curves say ---------------------------------------------------------------


def summary(rows):
    """Return a table in Markdown: last errors, and when ours passes that of theirs.

    Rows are those of the curves.  A test and seed that only one side has is left out.
    """
    curves = {}
    for study, test, method, seed, *point in rows:
        methods = curves.setdefault((study, test, str(seed)), {})
        methods.setdefault(method, []).append(tuple(map(float, point)))
    lines = [
        "| study, test, seed | theirs | error | wall, s | ours | error | wall, s "
        "| ratio of errors | passes theirs after, s | ratio of times |",
        "|---|---|--:|--:|---|--:|--:|--:|--:|--:|",
    ]
    for key, methods in curves.items():
        for name in sorted(set(methods) - set(MODELS)):
            for own in sorted(set(methods) & set(MODELS)):
                cells = compared(methods[name], methods[own])
                cells = [name, *cells[:2], own, *cells[2:]]
                lines.append(f"| {', '.join(key)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def compared(theirs, ours):
    """Return the cells of two curves, points (wall, cpu, rmse)."""
    (end, _, error), (own_end, _, own_error) = theirs[-1], ours[-1]
    cells = [f"{error:.3g}", f"{end:.0f}", f"{own_error:.3g}", f"{own_end:.0f}"]
    cells.append(f"{own_error / error:.2f}")
    passed = next((wall for wall, _, rmse in ours if rmse <= error), None)
    if passed is None:
        return [*cells, "never", ""]
    return [*cells, f"{passed:.1f}", f"{end / passed:.0f}"]


def main(arguments=None):
    """Make the environment, run the studies, write the curves and what they say."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--study", choices=STUDIES, nargs="+", default=["wh"])
    parser.add_argument("--seconds", type=float, default=240)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--realizations", type=int, default=6)
    parser.add_argument("--ours", choices=MODELS)
    parser.add_argument("--venv", type=Path)
    parser.add_argument("--out", type=Path, default=Path("rivals.csv"))
    parser.add_argument("--page", action="store_true", help="write the manual's table")
    options = parser.parse_args(arguments)
    load, rows = os.getloadavg()[0], []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        python = environment(options.venv or folder / "venv")
        with options.out.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(COLUMNS)
            for study in options.study:
                for row in STUDIES[study](python, folder, options):
                    writer.writerow(row)
                    file.flush()
                    print(*row, flush=True)
                    rows.append(row)
    text = summary(rows)
    print(text)
    if options.page:
        note = machine(load, np, alssnn)
        (OUT / "rivals.md").write_text(f"{text}\n\n{note}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())

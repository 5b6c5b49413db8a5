"""One sample ahead: are models with innovations as good as the simplest predictor?

    python -m benchmarks.one_step [--cases ...] [--models lti fl al] [--max-time S]

On plants and records of `benchmarks.field` models are fitted with
``noise="innovations"`` and otherwise with the defaults.  Compared is the error of
``predict_ahead(steps=1)`` on the test with that of ARX,

    y_k = c + sum_(i = 1..n) (a_i y_(k-i) + b_i u_(k-i)) [+ b_0 u_k],

by least squares; the order n, 1 to 10, and whether u_k enters, are those of least error
on the last quarter of the training record, whose whole is then fitted.  Errors are root
mean squares over all outputs, each in units of its standard deviation in the training
record, behind the first samples of the case.  `rel. 1 ahead` is the error over that of
ARX; `no u_k` that of the best ARX without u_k over the same, which a model without
feedthrough can be held against.

Required: never more than 1.05.  Rows replace those of earlier runs in
doc/benchmarks/one_step.csv, from which the table is made; --quick fits one linear model
and writes nothing.
"""

import argparse
import csv
import os
import sys
import time
import warnings
from fnmatch import fnmatchcase
from itertools import product

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks._tables import OUT
from benchmarks.field.__main__ import CASES
from benchmarks.field.case import columns
from benchmarks.field.runs import MODELS

LIMIT = 1.05
ORDERS = range(1, 11)
HELD_OUT = 0.25  # of the training record, at its end, for the order
COLUMNS = (
    "case",
    "model",
    "test",
    "rel. 1 ahead",
    "no u_k",
    "error",
    "ARX",
    "order",
    "nx",
    "h sees",
    "seconds",
    "failure",
)


# -- ARX -------------------------------------------------------------------------------


def regressors(u, y, n, direct):
    """Return the rows [1, y_(k-1) ... y_(k-n), (u_k,) u_(k-1) ... u_(k-n)], k >= n."""
    N = len(u)
    past_y = [y[n - i : N - i] for i in range(1, n + 1)]
    past_u = [u[n - i : N - i] for i in range(0 if direct else 1, n + 1)]
    return np.hstack([np.ones((N - n, 1)), *past_y, *past_u])


def fit_arx(experiments, n, direct):
    """Return the coefficients of an ARX model, of shape (n_regressors, ny).

    Rows where something was not measured are left out.
    """
    pairs = [(regressors(u, y, n, direct), y[n:]) for u, y in experiments if len(u) > n]
    X, Y = (np.vstack(part) for part in zip(*pairs, strict=True))
    known = np.isfinite(X).all(axis=1) & np.isfinite(Y).all(axis=1)
    # columns of one size: the cut of singular values is relative to all of them
    size = np.sqrt(np.mean(X[known] ** 2, axis=0))
    size[size == 0] = 1.0
    return np.linalg.lstsq(X[known] / size, Y[known], rcond=None)[0] / size[:, None]


def predict_arx(theta, u, y, n, direct):
    """Return what an ARX model predicts, of the shape of y; nan in the first n rows."""
    y_hat = np.full_like(y, np.nan)
    if len(u) > n:
        y_hat[n:] = regressors(u, y, n, direct) @ theta
    return y_hat


def bridged(y):
    """Return outputs whose gaps are straight lines, for regressors."""
    rows, filled = np.arange(len(y)), y.copy()
    for y_i in filled.T:  # views
        known = np.isfinite(y_i)
        y_i[:] = np.interp(rows, rows[known], y_i[known])
    return filled


def choose_arx(experiments, directs=(False, True)):
    """Return order, use of u_k and coefficients that validate best."""
    spread = deviations(experiments)
    cuts = [int((1 - HELD_OUT) * len(u)) for u, _ in experiments]
    parts = list(zip(experiments, cuts, strict=True))
    seen = [(u[:cut], y[:cut]) for (u, y), cut in parts]

    def error(choice):
        theta = fit_arx(seen, *choice)
        # all orders are judged by the same rows, and see what lies before them
        tails = []
        for (u, y), cut in parts:
            start = max(cut - ORDERS[-1], 0)
            u_i, y_i = u[start:], y[start:]
            tails.append((y_i, predict_arx(theta, u_i, bridged(y_i), *choice)))
        return scaled_rms(tails, spread, ORDERS[-1])

    choice = min(product(ORDERS, directs), key=error)
    return *choice, fit_arx(experiments, *choice)


# -- errors ----------------------------------------------------------------------------


def deviations(experiments):
    """Return the standard deviation of every output, of shape (ny,)."""
    return np.nanstd(np.vstack([y for _, y in experiments]), axis=0)


def scaled_rms(pairs, spread, skip):
    """Return the root mean square of y_hat - y over spread, of pairs (y, y_hat).

    The first `skip` rows of each pair do not count, and no entry of y that is missing;
    a prediction that is not finite makes it infinite.
    """
    errors = []
    for y, y_hat in pairs:
        known = np.isfinite(y[skip:])
        errors.append((((y_hat - y) / spread)[skip:])[known])
    mean = np.mean(np.concatenate(errors) ** 2)
    return float(np.sqrt(mean)) if np.isfinite(mean) else np.inf


def of_arx(data, experiments, directs, skip):
    """Return the error of the chosen ARX model on a test, and the choice."""
    n, direct, theta = choose_arx(data.train, directs)
    pairs = []
    for u, y in experiments:
        pairs.append((y, predict_arx(theta, u, bridged(y), n, direct)))
    error = scaled_rms(pairs, deviations(data.train), max(skip, ORDERS[-1]))
    return error, f"{n}{'+' if direct else ''}"


# -- runs ------------------------------------------------------------------------------


def load(case):
    """Return the data of a case, all of its signals with two dimensions."""
    data = case.load()
    shaped = [[(columns(u), columns(y)) for u, y in data.train]]
    tests = {k: [(columns(u), columns(y)) for u, y in v] for k, v in data.tests.items()}
    return data._replace(train=shaped[0], tests=tests)


def fitted(name, data, max_time=None):
    """Return a model with innovations, and the seconds of its fit."""
    model = MODELS[name](dt=data.dt, noise="innovations")
    options = {"random_state": 0, "max_time": max_time}
    known = model.get_params()
    model.set_params(**{k: v for k, v in options.items() if k in known})
    start = time.perf_counter()
    model.fit(*map(list, zip(*data.train, strict=True)))
    return model, time.perf_counter() - start


def compare(case, name, max_time=None):
    """Return one row per test; what goes wrong in a fit is one, too."""
    data = load(case)
    spread, skip = deviations(data.train), case.n_init
    model, seconds, failure = None, np.nan, ""
    try:
        model, seconds = fitted(name, data, max_time)
    except Exception as problem:  # a result
        failure = f"{type(problem).__name__}: {' '.join(str(problem).split())}"[:120]
    rows = []
    for test, experiments in data.tests.items():
        arx, order = of_arx(data, experiments, (False, True), skip)
        plain, _ = of_arx(data, experiments, (False,), skip)
        error, nx, sees = np.inf, "", ""
        if model is not None:
            pairs = [(y, columns(model.predict_ahead(u, y))) for u, y in experiments]
            error = scaled_rms(pairs, spread, max(skip, ORDERS[-1]))
            nx, sees = model.nx_, getattr(model, "h_sees_", None) or ""
        figures = error / arx, plain / arx, error, arx
        rows.append(
            (case.name, name, test, *figures, order, nx, sees, seconds, failure)
        )
    return rows


# -- table -----------------------------------------------------------------------------


def text_of(row):
    """Return the cells of a row as text."""
    return [f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row]


def read(path):
    """Return the rows of a file, as text; none without a file."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.reader(file))[1:]


def replaced(old, new):
    """Return rows without those of the same case and model as new ones, and these."""
    keys = {tuple(row[:2]) for row in new}
    return [row for row in old if tuple(row[:2]) not in keys] + new


def failures(rows):
    """Return the rows, as text, that are worse than what is required."""
    return [row for row in rows if not float(row[3]) <= LIMIT]


def write(rows, folder):
    """Write all rows as CSV, and as Markdown by model."""
    order = {name: i for i, name in enumerate(CASES)}
    rows = sorted(rows, key=lambda row: (order.get(row[0], len(order)), row[2]))
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "one_step.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([COLUMNS, *rows])
    text = [
        "# One sample ahead, against ARX",
        "",
        "By `python -m benchmarks.one_step`: error of `predict_ahead(steps=1)` of",
        'models with `noise="innovations"` over that of the best ARX of order 1 to 10',
        "(`order`; + where u_k enters); `no u_k`: the best ARX without u_k over the",
        f"same. Required: at most {LIMIT}. `--max-time` has ended those fits of fl and",
        "al that took little more than 30 s.",
        "",
    ]
    for name in dict.fromkeys(row[1] for row in rows):
        part = [row for row in rows if row[1] == name]
        ratios = np.array([float(row[3]) for row in part])
        text += [
            f"- {name}: {len(failures(part))} of {len(part)} tests missed, median "
            f"{np.median(ratios):.3f}, worst {ratios.max():.3f}",
        ]
    text += ["", f"| {' | '.join(COLUMNS)} |", "|" + "---|" * len(COLUMNS)]
    text += [f"| {' | '.join(row)} |" for row in rows]
    (folder / "one_step.md").write_text("\n".join(text) + "\n")


def main():
    """Fit, print, write, and compare with what is required."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=["*"], help="names or globs")
    parser.add_argument("--models", choices=MODELS, nargs="+", default=["lti"])
    parser.add_argument("--max-time", type=float, help="of a nonlinear fit, seconds")
    parser.add_argument("--quick", action="store_true", help="one case, no file")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    chosen = [
        case
        for case in CASES.values()
        if any(fnmatchcase(case.name, p) for p in options.cases)
        and (not case.big or case.name in options.cases)
    ]
    if options.quick:
        chosen, options.models = [CASES["short"]], ["lti"]
    rows = []
    print("".join(f"{title:>14s}" for title in COLUMNS))
    for case in chosen:
        for name in options.models:
            try:
                new = [text_of(row) for row in compare(case, name, options.max_time)]
            except FileNotFoundError as problem:  # no such record on this machine
                print(f"{case.name}: {problem}")
                break
            for row in new:
                print("".join(f"{cell:>14s}" for cell in row), flush=True)
            rows = replaced(rows, new)
            if not options.quick:
                write(replaced(read(OUT / "one_step.csv"), new), OUT)
    missed = failures(rows)
    print(f"missed: {len(missed)} of {len(rows)}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())

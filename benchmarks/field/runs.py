"""Fits of one model to one case, in processes of their own, and the file of all runs.

A row is the error of one fit on one test. Its columns: `rmse`, the mean over outputs
and experiments, in the unit of the case, infinite if the simulation diverges; the same
relative to that of the linear model (`relative`) and to the standard deviation of the
output (`std`); of a model with a law, its linearization error on the test
(`linearization`, eq. gauge); what the fit says of itself; its time in seconds of
processor and clock; the warnings by category; and what it raised, if it crashed.
"""

import csv
import time
import warnings
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.metrics import rmse

from .case import Case

MODELS = {"lti": LinearStateSpace, "fl": FlSsnn, "al": AlSsnn, "gr": GrSsnn}
KEY = ("case", "model", "seed", "options")
COLUMNS = (
    "case",
    "test",
    "model",
    "seed",
    "options",
    "rmse",
    "relative",
    "std",
    "linearization",
    "converged",
    "message",
    "nx",
    "radius",
    "cpu",
    "wall",
    "warnings",
    "error",
)


_loaded: dict = {}  # one case, by its name


class Job(NamedTuple):
    """Hold what one fit needs."""

    case: Case
    model: str
    seed: int
    options: dict

    def key(self):
        """Return what tells its rows from others in the file."""
        options = "; ".join(f"{k}={v!r}" for k, v in sorted(self.options.items()))
        return self.case.name, self.model, str(self.seed), options


# -- one fit ---------------------------------------------------------------------------


def fit(job):
    """Return the rows of a job, whatever happens in it."""
    head = dict(zip(KEY, job.key(), strict=True))
    data, tests = None, [""]
    try:
        data = _load(job.case)
        tests = list(data.tests)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            told, errors = _fit(job, data)
        counts = Counter(w.category.__name__ for w in caught)
        told["warnings"] = "; ".join(f"{k} {n}" for k, n in sorted(counts.items()))
        return [{**head, "test": test, **told, **errors[test]} for test in tests]
    except FileNotFoundError as error:
        if data is None:  # not a crash: the record is not here
            return [{**head, "test": "", "missing": str(error)}]
        raise
    except Exception as error:
        return failed(job, f"{type(error).__name__}: {error}", tests)


def failed(job, error, tests=("",)):
    """Return the rows of a job that crashed."""
    head = dict(zip(KEY, job.key(), strict=True))
    error = " ".join(error.split())[:500]
    return [{**head, "test": test, "rmse": np.nan, "error": error} for test in tests]


def _load(case):
    """Return the data of a case, kept until another one is asked for."""
    if case.name not in _loaded:
        _loaded.clear()
        _loaded[case.name] = case.load()
    return _loaded[case.name]


def _fit(job, data):
    """Return what a fit tells of itself, and its errors by test."""
    model = MODELS[job.model](dt=data.dt, **job.options)
    if "random_state" in model.get_params():
        model.set_params(random_state=job.seed)
    u, y = map(list, zip(*data.train, strict=True))
    cpu, wall = time.process_time(), time.perf_counter()
    model.fit(u, y)
    told = {
        "cpu": time.process_time() - cpu,
        "wall": time.perf_counter() - wall,
        "converged": model.converged_,
        "message": model.message_,
        "nx": model.nx_,
        "radius": float(np.abs(np.linalg.eigvals(model.A_)).max()),
    }
    model.set_params(n_init_samples=job.case.n_init)  # of the score, not of the fit
    with np.errstate(all="ignore"):
        return told, {
            name: tested(model, test, job.case.scale)
            for name, test in data.tests.items()
        }


def score(model, experiments, scale=1.0):
    """Return the error of a model on a test, and that relative to the output."""
    pairs = [model.simulate_test(u, y) for u, y in experiments]
    if not all(np.isfinite(y_hat).all() for _, y_hat in pairs):
        return {"rmse": np.inf, "std": np.inf}
    errors = np.mean([rmse(*pair, multioutput="raw_values") for pair in pairs], axis=0)
    spread = np.nanstd(np.vstack([y.reshape(len(y), -1) for y, _ in pairs]), axis=0)
    return {"rmse": scale * errors.mean(), "std": np.mean(errors / spread)}


def tested(model, experiments, scale=1.0):
    """Return what a row has of a test; what diverges has no linearization error."""
    errors = score(model, experiments, scale)
    return errors | (
        left_by_the_law(model, experiments) if np.isfinite(errors["rmse"]) else {}
    )


def left_by_the_law(model, experiments):
    """Return the linearization error of a model with a law, mean over a test."""
    if not isinstance(model, (FlSsnn, AlSsnn)):
        return {}
    shares = [
        model.linearizability(u, y, in_loop=False).linearization_error
        for u, y in experiments
    ]
    return {"linearization": float(np.mean(shares))}


# -- many ------------------------------------------------------------------------------


def jobs_of(cases, models, seeds, options=None, max_time=None):
    """Return reference jobs, the linear models, and all others.

    An option holds for all models that have it, or with the name of a model and a dot
    before it for that one.
    """
    reference = [Job(case, "lti", 0, {}) for case in cases]
    others = []
    for case in cases:
        for name in models:
            known = MODELS[name]().get_params()
            mine = {}
            for key, value in (options or {}).items():
                owner, _, bare = key.rpartition(".")
                if owner in ("", name) and bare in known:
                    mine[bare] = value
            if max_time is not None and name != "lti":
                mine["max_time"] = max_time
            several = seeds if "random_state" in known else 1
            others += [Job(case, name, seed, mine) for seed in range(several)]
    keys = {job.key() for job in reference}
    return reference, [job for job in others if job.key() not in keys]


def run(cases, models, seeds, path, *, options=None, max_time=None, jobs=2, show=print):
    """Fit models to cases, append the rows to a file, return those of the file.

    Fits whose rows the file already holds are left out. With ``jobs=0`` all runs in
    this process.
    """
    path = Path(path)
    rows = read(path)
    there = {tuple(row[name] for name in KEY) for row in rows}
    for group in jobs_of(cases, models, seeds, options, max_time):
        todo = [job for job in group if job.key() not in there]
        linear = {
            (row["case"], row["test"]): float(row["rmse"])
            for row in rows
            if row["model"] == "lti" and not row["options"]
        }
        for new in _outcomes(todo, jobs):
            if "missing" in new[0]:
                show(f"{new[0]['case']}: {new[0]['missing']}")
                continue
            for row in new:
                base = linear.get((row["case"], row["test"]), np.nan)
                base = row["rmse"] if row["model"] == "lti" and not base > 0 else base
                row["relative"] = row["rmse"] / base
            rows += append(path, new)
            show(" ".join(map(_line, new)))
    return rows


def _line(row):
    what = row.get("error") or f"{row['rmse']:.4g} ({row['relative']:.3f} of lti)"
    return (
        f"{row['case']:18s} {row['test']:14s} {row['model']} seed {row['seed']} "
        f"{row['options']}: {what} {row.get('cpu', np.nan):.1f} s"
    )


def _outcomes(jobs, n_jobs):
    """Yield the rows of every job as it ends; one that kills its process is a row."""
    if n_jobs == 0:
        yield from map(fit, jobs)
        return
    suspects = []
    with _pool(min(n_jobs, len(jobs) or 1)) as pool:
        futures = {pool.submit(fit, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                try:
                    yield future.result()
                except BrokenProcessPool:  # all that had not ended: one is to blame
                    suspects.append(futures[future])
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    for job in suspects:
        with _pool(1) as pool:
            try:
                yield pool.submit(fit, job).result()
            except BrokenProcessPool:
                yield failed(job, "the process died")


def _pool(n_jobs):
    # not forked: a process of its own has its own compiled code and threads
    return ProcessPoolExecutor(n_jobs, mp_context=get_context("spawn"))


# -- file ------------------------------------------------------------------------------


def read(path):
    """Return the rows of a file as dictionaries of strings; none without a file."""
    path = Path(path)
    if not path.exists():
        return []
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        rows = list(reader)
    if tuple(reader.fieldnames or ()) != COLUMNS:
        raise ValueError(f"`{path}` has other columns; name another file or --fresh.")
    return rows


def append(path, rows):
    """Write rows at the end of a file and return them as `read` does."""
    rows = [{name: _cell(row.get(name, "")) for name in COLUMNS} for row in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        if new:
            writer.writeheader()
        writer.writerows(rows)
    return rows


def _cell(value):
    return f"{value:.6g}" if isinstance(value, float) else str(value)

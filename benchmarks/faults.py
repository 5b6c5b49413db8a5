"""Processes that are killed, disks that are full, memory that ends: what is lost?

    python -m benchmarks.faults [--kills 200] [--quick]

kill      SIGKILL at a random time of `model.save` over a file: one of the two models
          that were saved in turn is read from it, to the bit
term      SIGTERM at a random time of a loop of `fit` and `save`: the same, and the
          process dies of the signal
disk      a file system that is full (RLIMIT_FSIZE) while a model, C code and a report
          are written: an OSError, the old files as they were and nothing beside them
memory    a fit of a fitted model in a process that may take little more memory than it
          has (RLIMIT_AS): a MemoryError that leaves the model as it was, or a fit
injected  a MemoryError of the n-th evaluation of a fit: the same, for random n

Needs a POSIX system. Prints one line per kind, and exits with 1 if anything was lost.
"""

import argparse
import collections
import os
import signal
import sys
import tempfile
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import alssnn
from alssnn import FlSsnn
from alssnn.criterion import Criterion

MEGABYTE = 2**20


def record(n, gain=0.2, seed=0):
    """Return a record of a nonlinear plant of one state."""
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=(n, 1)), np.zeros(n)
    for k in range(n - 1):
        y[k + 1] = 0.8 * y[k] + gain * (u[k, 0] + np.tanh(y[k]))
    return u, y


def fitted(seed, n=200):
    """Return a model of a record."""
    options = {"alpha": 0.0, "n_init": 1, "max_iter": 3, "random_state": seed}
    return FlSsnn(nx=2, n_h=2, **options).fit(*record(n, seed=seed))


def in_child(function, *args):
    """Return what a forked process says of a function, or how it ended."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            os.close(read)
            os.write(write, str(function(*args)).encode())
        except BaseException as error:
            os.write(write, repr(error).encode())
        finally:
            os._exit(0)
    os.close(write)
    with os.fdopen(read, "rb") as pipe:
        said = pipe.read().decode()
    _, status = os.waitpid(pid, 0)
    return said or f"ended by signal {status & 127}"


def killed(work, how, longest, rng):
    """Return whether a process at work died of a signal at a random time."""
    read, write = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.write(write, b"x")
            while True:
                work()
        finally:
            os._exit(0)
    os.read(read, 1)
    time.sleep(longest * rng.random())
    os.kill(pid, how)
    _, status = os.waitpid(pid, 0)
    os.close(read)
    os.close(write)
    return os.WIFSIGNALED(status) and os.WTERMSIG(status) == how


def kills(n, how, folder, rng, refit=False):
    """Return how many of n kills lost the file, or did not kill."""
    models = [fitted(0), fitted(1)]
    u, _ = record(50)
    known = [model.predict(u) for model in models]
    path = Path(folder) / "model.npz"
    models[0].save(path)
    turn = iter(range(10**9))

    def work():
        i = next(turn) % 2
        (fitted(i) if refit else models[i]).save(path)

    work()  # the first one loads and compiles
    next(turn)
    start = time.perf_counter()
    work(), work()
    longest = 2 * (time.perf_counter() - start)  # four rounds of work
    lost, found = 0, collections.Counter()
    for _ in range(n):
        died = killed(work, how, longest, rng)
        try:
            y = alssnn.load(path).predict(u)
            which = [bool(np.array_equal(y, z)) for z in known]
            found[which.index(True)] += 1
            lost += not died
        except (ValueError, OSError) as error:
            print(f"lost: {error}")
            lost += 1
    beside = [p.name for p in Path(folder).iterdir() if p != path]
    hidden = all(name.startswith(".model.npz.") for name in beside)
    return lost + (not hidden), len(beside), dict(found)


def full_disk(folder):
    """Return which outputs were not as they were after a disk was full."""
    import resource

    model, bad = fitted(0), []
    folder = Path(folder)
    outputs = {
        "model": lambda model: model.save(folder / "model.npz"),
        "C": lambda model: model.to_c(folder),
        "matlab": lambda model: model.to_mat(folder / "model.mat"),
        "report": lambda model: model.report(folder / "report.html", *record(300)),
    }
    before = set(folder.iterdir())
    for name, output in outputs.items():
        output(model)
        files = set(folder.iterdir()) - before
        old = {path: path.read_bytes() for path in files}
        limit = min(len(data) for data in old.values()) // 2

        def attempt(output=output, limit=limit):
            hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            try:
                output(fitted(1))
            except OSError as error:
                return f"OSError {error.errno}"
            return "no error"

        said = in_child(attempt)
        same = all(path.read_bytes() == data for path, data in old.items())
        if not (same and said.startswith("OSError")):
            bad.append(f"{name} ({said}, {'same' if same else 'other'} files)")
        elif set(folder.iterdir()) != before | files:
            bad.append(f"{name} (files beside)")
        before |= files
    return bad, len(outputs)


def refitted(model, limit=None, when=None):
    """Return what came of another fit of a fitted model."""
    u, _ = record(50)
    options, before = model.get_params(), model.predict(u)
    data = record(30_000 if limit else 300, gain=0.3, seed=2)
    data = 1e3 * data[0], 1e3 * data[1] + 7  # other units: mixing shows
    if limit:
        import resource

        with open("/proc/self/statm") as file:
            now = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        no_limit = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (now + limit, no_limit[1]))
    original, calls = Criterion.normal_equations, iter(range(10**9))

    def failing(self, free):
        if when is not None and next(calls) == when:
            raise MemoryError
        return original(self, free)

    Criterion.normal_equations = failing
    said = "fitted"
    try:
        model.set_params(max_iter=5, random_state=0).fit(*data)
    except MemoryError:
        said = "MemoryError"
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    finally:
        Criterion.normal_equations = original
        if limit:
            resource.setrlimit(resource.RLIMIT_AS, no_limit)
    model.set_params(**options)
    if said == "MemoryError" and not np.array_equal(model.predict(u), before):
        return "MemoryError, and another model"
    if said == "fitted" and abs(model.y_offset_[0] - data[1].mean()) > 1:
        return "fitted, with other scales"
    return said


def memory(n, rng):
    """Return how often a fit in little memory came to which end."""
    model = fitted(0)
    ends = collections.Counter()
    for _ in range(n):
        limit = int(MEGABYTE * 10 ** rng.uniform(-1, 2.5))
        ends[in_child(refitted, model, limit)] += 1
    return ends


def injected(n, rng):
    """Return how often a fit whose memory ended came to which end."""
    model = fitted(0)
    return collections.Counter(
        in_child(refitted, model, None, int(rng.integers(12))) for _ in range(n)
    )


def main(arguments=None):
    """Run, print, and return whether anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--quick", action="store_true", help="10 kills")
    options = parser.parse_args(arguments)
    n = 10 if options.quick else options.kills
    warnings.simplefilter("ignore", UserWarning)
    rng, failed = np.random.default_rng(0), False
    for name, how, refit in (
        ("kill", signal.SIGKILL, False),
        ("term", signal.SIGTERM, True),
    ):
        with tempfile.TemporaryDirectory() as folder:
            lost, beside, found = kills(n, how, folder, rng, refit)
        failed |= lost > 0
        print(
            f"{name}: {n} signals, {lost} files lost; read after them, by model: "
            f"{found}; {beside} hidden files left beside",
            flush=True,
        )
    with tempfile.TemporaryDirectory() as folder:
        bad, count = full_disk(folder)
    failed |= bool(bad)
    print(f"disk: {count} outputs, lost or left: {', '.join(bad) or 'none'}")
    for name, function in (("memory", memory), ("injected", injected)):
        ends = function(max(n // 5, 5), rng)
        failed |= not set(ends) <= {"fitted", "MemoryError"}
        print(f"{name}: {dict(ends)}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

"""Data on the workers of a cluster: speed, traffic, and a plan for many of them.

    python -m benchmarks.cluster [--samples 40000] [--experiments 8]

On one machine, with one and two worker processes of one thread each:

- the time of an iteration (J'J, J'r and |r|) over all experiments, and its ratio;
- what all workers send in an iteration, and the same with half the samples.

Then what the client does for many experiments, measured piece by piece: merging the
sums of `FAN_IN` workers, and solving for theta and one initial state per experiment.
From these comes the plan for 1,000 workers with one experiment each.
"""

import argparse
import os
import pickle
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

NX, N_H, N_G = 6, 10, 10
REPEATS = 3
SIZES = (50, 100, 200)  # experiments whose dense problem is solved


def make(seed, n_samples):
    """Return one experiment; called where it is to live."""
    rng = np.random.default_rng(seed)
    return rng.standard_normal((n_samples, 1)), rng.standard_normal((n_samples, 1))


def problem(experiments, n_experiments):
    """Return a criterion of the paper's size over experiments, and a free vector."""
    from alssnn.criterion import Criterion
    from alssnn.models import state_space

    rng = np.random.default_rng(0)
    A = rng.standard_normal((NX, NX))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    structure = state_space(
        NX, 1, 1, n_h=N_H, n_g=N_G, C=rng.standard_normal((1, NX))
    ).observe("y", "g")
    p = {k: 0.1 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    criterion = Criterion(structure, experiments, weights={"y": 1.0, "g": 16.0})
    theta = structure.join({**p, "A": A})
    return criterion, criterion.join(theta, np.zeros((n_experiments, NX)))


def measure_cluster(n_workers, n_experiments, n_samples):
    """Return the time of an iteration and the bytes that the workers send."""
    from distributed import Client, LocalCluster

    from alssnn.distributed import Remote

    with (
        LocalCluster(
            n_workers=n_workers,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=50,
        ) as cluster,
        Client(cluster) as client,
    ):
        addresses = sorted(client.scheduler_info()["workers"])
        futures = [
            client.submit(make, i, n_samples, workers=addresses[i % n_workers])
            for i in range(n_experiments)
        ]
        criterion, free = problem(Remote(client, futures), n_experiments)
        criterion.normal_equations(free)  # compiles the kernels on the workers
        times, sent, gather = [], [], client.gather
        client.gather = lambda parts: [
            sent.append(_size(p)) or p for p in gather(parts)
        ]
        for _ in range(REPEATS):
            sent.clear()
            start = time.perf_counter()
            criterion.normal_equations(free)
            times.append(time.perf_counter() - start)
        return min(times), sum(sent)


def _size(arrow):
    return len(pickle.dumps(arrow, protocol=5))


def measure_client(n_experiments):
    """Return the time in which the client solves for theta and all initial states."""
    from alssnn.compression import compress

    _, free = problem([make(0, 50)], 1)
    n = len(free) - NX + n_experiments * NX
    J = np.random.default_rng(0).standard_normal((n + 10, n))
    start = time.perf_counter()
    compress(J.T @ J, J[0], 1.0)
    compressed = time.perf_counter() - start
    return n, compressed


def measure_merge():
    """Return the time of merging the arrows of `FAN_IN` workers of one experiment."""
    from functools import reduce

    from alssnn.contribution import Arrow
    from alssnn.distributed import FAN_IN

    criterion, free = problem([make(0, 2000)], 1)
    theta, x0 = criterion.split(free)
    arrow = criterion.experiments.map(
        lambda u, y: criterion.one.arrow(theta, 0, x0[0], u, y)
    )[0]
    start = time.perf_counter()
    reduce(Arrow.merge, [arrow] * FAN_IN)
    return time.perf_counter() - start, _size(arrow), FAN_IN


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=40_000, help="per experiment")
    parser.add_argument("--experiments", type=int, default=8)
    options = parser.parse_args()
    n, m = options.samples, options.experiments
    print(f"{m} experiments of {n:,} samples, {os.cpu_count()} cores, ", end="")
    print(f"load {os.getloadavg()[0]:.1f}")
    one, sent_one = measure_cluster(1, m, n)
    two, sent_two = measure_cluster(2, m, n)
    half, sent_half = measure_cluster(2, m, n // 2)
    print(f"{'workers':>8s}{'samples':>10s}{'iteration, s':>14s}{'sent, kB':>10s}")
    for row in (
        (1, n, one, sent_one),
        (2, n, two, sent_two),
        (2, n // 2, half, sent_half),
    ):
        print(f"{row[0]:8d}{row[1]:10,d}{row[2]:14.3f}{row[3] / 1e3:10.1f}")
    print(f"two workers are {one / two:.2f} times as fast as one")
    merge, size, fan_in = measure_merge()
    print(f"merging {fan_in} sums {1e3 * merge:.2f} ms, each {size / 1e3:.1f} kB")
    solves = [measure_client(k) for k in SIZES]
    for k, (unknowns, seconds) in zip(SIZES, solves, strict=True):
        print(
            f"{k:6d} experiments, {unknowns:6d} unknowns: compression {seconds:.2f} s"
        )
    levels = int(np.ceil(np.log(1000) / np.log(fan_in)))
    print(
        f"plan, 1,000 workers of one experiment: {levels} levels of mergers, "
        f"{levels * merge * 1e3:.1f} ms of sums; the client alone would receive "
        f"{1000 * size / 1e6:.0f} MB without them; "
        f"{solves[-1][0] + (1000 - SIZES[-1]) * NX} unknowns"
    )


if __name__ == "__main__":
    main()

"""Certificates: how tight, never violated, and the gain margin of whole loops.

    python -m benchmarks.certificates [--study NAME] [--models 100]

bounds: proved bound of |y - y_lin| for all inputs, over the worst input that was found,
on five plants, with the default AL-SSNN and a linear-quadratic gain; beside it the
conditional bound of `iss_certificate`.  violations: random loops of several structures,
with random and optimized inputs; counts how many exceed a proved bound.  margins: whole
loops with observer, limits and noise, whose gain is raised until the certificate
refuses and until the simulation diverges.  speed: the inequality of the gain.  Each
writes its table to doc/benchmarks.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import alssnn
from alssnn import AlSsnn, FlSsnn
from alssnn.certificates import certify_loop, gain_certificate, local_certificate
from alssnn.datasets import (
    make_duffing,
    make_fan_arm,
    make_pendulum,
    make_valve_tank,
    make_wiener_hammerstein,
)
from alssnn.feedback import lqi, lqr
from alssnn.lure import Lure
from alssnn.simulation import channels, simulate
from benchmarks._tables import OUT, machine

SAMPLES = 1_500
PLANTS = {
    "pendulum": (make_pendulum, {"noise": 0.01}, 2),
    "duffing": (make_duffing, {"noise": 0.01}, 2),
    "tanks": (make_valve_tank, {}, 2),
    "fan arm": (make_fan_arm, {}, 2),
    "wiener-hammerstein": (make_wiener_hammerstein, {}, 4),
}
LOOPS = ("pendulum", "duffing", "fan arm")
INPUTS = 1_000  # random inputs for each random loop
SMALL = 0.1  # references of the margins, relative to the record
NOISE = 0.01  # of the sensor in the margins, largest value over the deviation of y
SIZES = ((6, 20), (20, 50), (4, 100))  # states and neurons
LARGEST = 300.0  # factor on a gain that is tried


def fitted(name, estimator, **options):
    """Return the record of a plant and a model of it."""
    make, settings, nx = PLANTS[name]
    record = make(SAMPLES, random_state=0, **settings)
    model = estimator(nx=nx, feedback="state", dt=record.dt, random_state=0, **options)
    return record, model.fit(record.u, record.y)


# -- bounds ----------------------------------------------------------------------------


def bounds():
    """Return a row per plant, with and without a gain."""
    rows = []
    for name in PLANTS:
        record, model = fitted(name, AlSsnn)
        ratio = np.var(record.y, axis=0).mean() / np.var(record.u, axis=0).mean()
        weight = 0.1 * ratio * np.eye(model.plant_.nv)
        for K in (lqr(model, model.C_.T @ model.C_, weight), None):
            local = model.local_certificate(K=K)
            iss = model.iss_certificate(record.u, record.y, K=K)
            found = local.lower_bound
            row = (
                name,
                "no" if K is None else "yes",
                f"{local.amplitude[0]:.3g}",
                f"{np.max(local.design_peak):.3g}",
                f"{local.output_bound:.3g}",
                f"{found:.3g}",
                f"{local.ratio:.2f}" if local.holds else local.verdict,
                f"{iss.output_bound:.3g}",
                f"{local.verify() >= 0}",
                f"{local.solve_time:.1f}",
            )
            print(*row, sep="  ", flush=True)
            rows.append(row)
    for with_gain in ("yes", "no"):
        ratios = [float(row[6]) for row in rows if row[1] == with_gain]
        print(
            f"gain {with_gain}: median ratio {np.median(ratios):.2f}, "
            f"largest {max(ratios):.2f}"
        )
    head = (
        "plant",
        "gain K",
        "amplitude",
        "largest y_lin",
        "proved",
        "found",
        "proved/found",
        "conditional",
        "verified",
        "seconds",
    )
    return head, rows


# -- violations ------------------------------------------------------------------------


def random_loop(rng):
    """Return a random loop of two layers of neurons, and its design."""
    nx, nu, nw = rng.integers(1, 6), rng.integers(1, 3), rng.integers(2, 9)
    Theta = 0.5 * rng.standard_normal((nx + 1 + nw, nx + nu + nw + 1))
    A = rng.standard_normal((nx, nx))
    A *= rng.uniform(0.3, 0.95) / np.abs(np.linalg.eigvals(A)).max()
    Theta[:nx, :nx] = A
    Theta[: nx + 1, nx + nu :] *= rng.choice([0.02, 0.1, 0.3])
    layer = np.arange(nw) >= nw // 2
    Theta[nx + 1 :, nx + nu : -1] *= layer[:, None] & ~layer[None, :]
    names = rng.choice(["tanh", "tanh", "sigmoid", "relu", "sin"])
    sigma = (alssnn.activations.ACTIVATIONS[str(names)],) * nw
    loop = Lure(Theta, int(nx), int(nu), int(nw), sigma)
    M = loop.M
    return loop, (M[:nx, :nx], M[:nx, nx:], M[nx:, :nx], M[nx:, nx:])


def excess(loop, design, r, bound):
    """Return the largest |y - y_lin| over its bound, for an input."""
    A, B, C, D = design
    linear = np.column_stack([np.block([[A, B], [C, D]]), np.zeros(len(A) + len(C))])
    linear = Lure(linear, len(A), B.shape[1], 0)
    y = [
        channels(z, simulate(z, r, np.zeros(z.nx))[:-1], r)[:, : len(C)]
        for z in (loop, linear)
    ]
    return float(np.max(np.abs(y[0] - y[1]) / bound))


def violations(n_models):
    """Return how many models hold, how many inputs were tried, and the worst share."""
    holds = tried = violated = 0
    shares, ratios = [], []
    for seed in range(n_models):
        rng = np.random.default_rng(seed)
        loop, design = random_loop(rng)
        amplitude = rng.uniform(0.2, 2.0, loop.nu)
        c = local_certificate(loop, design, amplitude)
        if not c.holds:
            continue
        holds += 1
        ratios.append(c.ratio)
        worst = float(np.max(c.lower_bounds / c.output_bounds))
        for _ in range(INPUTS):
            hold = int(rng.integers(1, 30))
            levels = rng.choice([-1.0, 0.0, 1.0], (200 // hold + 1, loop.nu))
            if rng.random() < 0.3:
                levels = rng.uniform(-1, 1, levels.shape)
            r = amplitude * np.repeat(levels, hold, axis=0)[:200]
            share = excess(loop, design, r, c.output_bounds)
            violated += share > 1
            worst = max(worst, share)
        tried += INPUTS
        shares.append(worst)
    row = (
        n_models,
        holds,
        tried,
        violated,
        f"{max(shares):.3f}",
        f"{np.median(ratios):.2f}",
        f"{np.quantile(ratios, 0.9):.2f}",
    )
    print(*row, sep="  ")
    head = (
        "models",
        "certified",
        "random inputs",
        "violations",
        "largest share of a bound",
        "median proved/found",
        "90 % below",
    )
    return head, [row]


# -- margins ---------------------------------------------------------------------------


def margins():
    """Return certified and simulated gain margin of every loop."""
    rows = []
    for name in LOOPS:
        record, model = fitted(name, FlSsnn, gamma_h=1e-4)
        nx, ny = model.nx_, model.plant_.ny
        Q = np.zeros((nx + ny, nx + ny))
        Q[:nx, :nx], Q[nx:, nx:] = model.C_.T @ model.C_, 1e-2 * np.eye(ny)
        ratio = np.var(record.y) / np.var(record.u)
        K = lqi(model, Q, 0.1 * ratio * np.eye(model.plant_.nv))
        span = np.ptp(record.u) / 2
        middle = (record.u.max() + record.u.min()) / 2
        limits = {"u_min": middle - 2 * span, "u_max": middle + 2 * span}
        size = SMALL * np.abs(record.y - model.y_offset_).max()

        def controller(factor, model=model, K=K, limits=limits):
            return model.controller(factor * K, **limits)

        noise = NOISE * record.y.std()

        def is_certified(factor, controller=controller, size=size, noise=noise):
            c = certify_loop(controller(factor), size, noise=noise, search=False)
            return c.holds and c.gain.holds

        def is_stable(factor, controller=controller, size=size, model=model):
            return settles(controller(factor), size, model)

        start = time.perf_counter()
        certified = largest(is_certified)
        seconds = time.perf_counter() - start
        true = largest(is_stable)
        refused = not is_certified(1.05 * true)
        share = certified / true
        row = (
            name,
            f"{size:.3g}",
            f"{certified:.2f}",
            f"{true:.2f}",
            f"{share:.2f}",
            "yes" if refused else "NO",
            f"{seconds:.1f}",
        )
        print(*row, sep="  ", flush=True)
        rows.append(row)
    head = (
        "loop",
        "reference",
        "certified up to K times",
        "simulated up to",
        "share",
        "refused beyond",
        "seconds",
    )
    return head, rows


def largest(holds):
    """Return the largest factor that holds, by bisection; 0 if none does."""
    low, high = 1.0, LARGEST
    if not holds(low):
        return 0.0
    while high / low > 1.02:
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def settles(controller, size, model, n=1_500):
    """Return whether the loop of the true model comes to rest after a small step."""
    plant = controller.own
    controller.reset()
    x, y = np.zeros(plant.nx), []
    r = model.y_offset_ + size
    for k in range(n):
        now = plant.output(x)
        u = controller.step(r, now + 1e-4 * size * (-1.0) ** (k // 3))
        x = plant.step(x, u)
        y.append(now - r)
        if not np.isfinite(x).all() or np.abs(x).max() > 1e6:
            return False
    return bool(np.abs(y[-n // 4 :]).max() < 0.05 * size)


# -- speed -----------------------------------------------------------------------------


def speed():
    """Return the time of the inequality of the gain, by states and neurons."""
    rows = []
    for nx, nw in SIZES:
        seconds, verdicts = [], []
        for seed in range(3):
            rng = np.random.default_rng(seed)
            Theta = rng.standard_normal((nx + 1 + nw, nx + 1 + nw + 1)) / np.sqrt(nw)
            A = rng.standard_normal((nx, nx))
            Theta[:nx, :nx] = 0.9 * A / np.abs(np.linalg.eigvals(A)).max()
            Theta[: nx + 1, nx + 1 :] *= 0.05
            Theta[nx + 1 :, nx + 1 : -1] = 0.0
            start = time.perf_counter()
            certificate = gain_certificate(Lure(Theta, nx, 1, nw))
            seconds.append(time.perf_counter() - start)
            verdicts.append(certificate.verdict)
        row = nx, nw, f"{np.median(seconds):.2f}", verdicts.count("holds")
        print(*row, sep="  ", flush=True)
        rows.append(row)
    return ("states", "neurons", "median seconds", "holds, of 3"), rows


STUDIES = {
    "bounds": bounds,
    "violations": violations,
    "margins": margins,
    "speed": speed,
}


def main():
    """Run the studies that were asked for, and write their tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--study", choices=STUDIES, action="append")
    parser.add_argument("--models", type=int, default=100, help="of violations")
    parser.add_argument("--quick", action="store_true", help="write nothing")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    for study in args.study or STUDIES:
        load = os.getloadavg()[0]
        run = STUDIES[study]
        head, rows = run(args.models) if study == "violations" else run()
        if args.quick:
            continue
        text = [
            f"# Certificates: {study}",
            "",
            f"By `python -m benchmarks.certificates --study {study}`.",
            "",
            "| " + " | ".join(head) + " |",
            "|" + "---|" * len(head),
            *("| " + " | ".join(map(str, row)) + " |" for row in rows),
            "",
            f"{machine(load, alssnn, np)}.",
        ]
        (OUT / f"certificates_{study}.md").write_text("\n".join(text) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

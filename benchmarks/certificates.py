"""Certificates: how tight, never violated, and the gain margin of whole loops.

    python -m benchmarks.certificates [--study NAME] [--models 100]

bounds: proved bound of |y - y_lin| for all inputs, over the worst input that was found,
on five plants, with the default AL-SSNN and a linear-quadratic gain; beside it the
conditional bound of `iss_certificate`.  violations: random loops of several structures,
with random and optimized inputs; counts how many exceed a proved bound.  margins: the
loops of the other benchmarks, with observer, limits and noise, whose gain is raised
until the certificate refuses and until the simulation diverges.  speed: the inequality
of the gain.  Each writes its table to doc/benchmarks.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from sklearn.base import clone

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
from alssnn.simulation import neuron_gains, regressors
from benchmarks import closed_loop, true_loops
from benchmarks._tables import OUT, machine

SAMPLES = 1_500
PLANTS = {
    "pendulum": (make_pendulum, {"noise": 0.01}, 2),
    "duffing": (make_duffing, {"noise": 0.01}, 2),
    "tanks": (make_valve_tank, {}, 2),
    "fan arm": (make_fan_arm, {}, 2),
    "wiener-hammerstein": (make_wiener_hammerstein, {}, 4),
}
INPUTS, OPTIMIZED = 100_000, 1_000  # inputs for each random loop
LENGTH, BATCH = 100, 5_000  # samples of an input, inputs at once
ASCENTS = 3  # steps of each length towards a larger distance
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


def run(loop, R):
    """Return y of many inputs at once, of shape (n, T, nu), from rest."""
    x, y = np.zeros((len(R), loop.nx)), []
    for r in np.moveaxis(R, 1, 0):
        Phi = regressors(loop, x, r)
        x, z = np.split(Phi @ loop.Theta[: loop.nx + loop.nz].T, [loop.nx], axis=1)
        y.append(z)
    return np.stack(y, axis=1)


def gradients(loop, R):
    """Return the derivative of y at the last sample by all inputs, (n, T, nu)."""
    x, J = np.zeros((len(R), loop.nx)), []
    for r in np.moveaxis(R, 1, 0):
        Phi = regressors(loop, x, r)
        J.append(loop.M + neuron_gains(loop, loop.W, Phi) @ loop.V)
        x = Phi @ loop.Theta[: loop.nx].T
    nx, rows = loop.nx, J[-1][:, loop.nx]  # of the only output
    found = [rows[:, nx:]]
    for now in J[-2::-1]:
        rows = np.einsum("ni,nij->nj", rows[:, :nx], now[:, :nx])
        found.append(rows[:, nx:])
    return np.stack(found[::-1], axis=1)


def distances(loop, design, R):
    """Return y - y_lin of many inputs."""
    A, B, C, D = design
    rows = np.block([[A, B], [C, D]])
    linear = Lure(np.column_stack([rows, np.zeros(len(rows))]), len(A), B.shape[1], 0)
    return run(loop, R) - run(linear, R), linear


def random_inputs(rng, n, amplitude):
    """Return inputs that switch between limits, rest, and levels in between."""
    R = np.empty((n, LENGTH, len(amplitude)))
    hold = rng.integers(1, LENGTH, n)
    for i, held in enumerate(hold):
        shape = LENGTH // held + 1, len(amplitude)
        levels = rng.choice([-1.0, 0.0, 1.0], shape)
        if rng.random() < 0.3:
            levels = rng.uniform(-1, 1, shape)
        R[i] = amplitude * np.repeat(levels, held, axis=0)[:LENGTH]
    return R


def improved(loop, design, R, amplitude):
    """Return inputs after steps towards a larger distance at the last sample."""
    e, linear = distances(loop, design, R)
    best = np.abs(e[:, -1, 0])
    for share in np.repeat([1.0, 0.5, 0.25, 0.1], ASCENTS):
        slope = gradients(loop, R) - gradients(linear, R)
        e = distances(loop, design, R)[0]
        full = np.where(np.sign(e[:, -1])[:, None] * slope >= 0, amplitude, -amplitude)
        tried = R + share * (full - R)
        reached = np.abs(distances(loop, design, tried)[0][:, -1, 0])
        better = reached > best
        R[better], best[better] = tried[better], reached[better]
    return R


def violations(n_models):
    """Return how many models hold, how many inputs were tried, and the worst share."""
    holds = tried = optimized = violated = 0
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
        sets = [random_inputs(rng, BATCH, amplitude) for _ in range(INPUTS // BATCH)]
        tried += INPUTS
        sets.append(improved(loop, design, sets[0][:OPTIMIZED].copy(), amplitude))
        optimized += OPTIMIZED
        for R in sets:
            share = np.abs(distances(loop, design, R)[0]) / c.output_bounds
            violated += int((share.max(axis=(1, 2)) > 1).sum())
            worst = max(worst, float(share.max()))
        shares.append(worst)
        if seed % 10 == 9:
            print(seed + 1, "models, largest share", f"{max(shares):.4f}", flush=True)
    row = (
        n_models,
        holds,
        tried,
        optimized,
        violated,
        f"{max(shares):.4f}",
        f"{np.median(ratios):.2f}",
        f"{np.quantile(ratios, 0.9):.2f}",
    )
    print(*row, sep="  ")
    head = (
        "models",
        "certified",
        "random inputs",
        "optimized inputs",
        "violations",
        "largest share of a bound",
        "median proved/found",
        "90 % below",
    )
    return head, [row]


# -- margins ---------------------------------------------------------------------------


def loops():
    """Yield name, model, gain, reference and limits of every loop.

    Pendulum and Duffing are those of `benchmarks.closed_loop`, the fan arm with its
    quadratic thrust that of `benchmarks.true_loops`, whose law is solved at every
    sample.
    """
    for name in ("pendulum", "duffing"):
        setting = closed_loop.SETTINGS[name]
        record = setting.record(0)
        model = clone(next(iter(setting.models.values())))
        model.set_params(random_state=0).fit(record.u, record.y)
        C, nx, ny = model.C_, model.nx_, len(model.C_)
        Q = np.diag(np.r_[np.zeros(nx), np.full(ny, setting.weight_z)])
        Q[:nx, :nx] = C.T @ C
        K = lqi(model, Q, setting.weight_v * np.eye(model.plant_.nv))
        yield name, model, K, setting.reference, setting.limits
    case = true_loops.CASES["fan"]
    record = case.make(true_loops.SAMPLES, random_state=0)
    model = FlSsnn(
        nx=case.nx,
        feedback=case.feedback,
        input_map="monotone",
        dt=record.dt,
        random_state=0,
    ).fit(record.u, record.y)
    K = true_loops.design(model, case, record.y.std(axis=0))
    limits = dict(zip(("u_min", "u_max"), case.limits, strict=True))
    # of all references of that size, some would take the fan beyond its limits
    yield "fan arm", model, K, case.reference / 4, limits


def margins():
    """Return certified and simulated gain margin of every loop."""
    rows = []
    for name, model, K, size, limits in loops():
        noise = NOISE * model.plant_.y_scale

        def certificate(
            factor, model=model, K=K, limits=limits, size=size, noise=noise
        ):
            controller = model.controller(factor * K, **limits)
            return certify_loop(controller, size, noise=noise, search=False)

        def is_certified(factor, certificate=certificate):
            c = certificate(factor)
            return c.holds and c.gain.holds and c.rate.holds

        def is_stable(factor, model=model, K=K, limits=limits, size=size):
            return settles(model.controller(factor * K, **limits), size, model)

        start = time.perf_counter()
        certified = largest(is_certified)
        seconds = time.perf_counter() - start
        true = largest(is_stable)
        refused = not is_certified(1.05 * true)
        c = certificate(1.0)
        row = (
            name,
            f"{size:.3g}",
            f"{c.output_bound:.2g}",
            f"{c.gain.gamma:.2g}",
            f"{c.decay:.3f}",
            f"{certified:.2f}",
            f"{true:.2f}",
            f"{certified / true:.2f}",
            "yes" if refused else "NO",
            f"{seconds:.1f}",
        )
        print(*row, sep="  ", flush=True)
        rows.append(row)
    head = (
        "loop",
        "reference",
        "proved bound",
        "gain to y - y_design",
        "rate",
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

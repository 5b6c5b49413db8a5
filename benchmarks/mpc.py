"""Predictive control: time of a step, limits and offset on true plants.

    python -m benchmarks.mpc [--steps 10000] [--seed 0]

One BLAS thread.  Prints

- the time of one step (horizon 20, nx = 6) without and with soft bounds on all outputs,
  for 1 input and 1 output and for 2 inputs and 3 outputs: processor time (mean of a
  simulation, plant included), and wall time of `step` and of its solver;
- the time of the same programs, update and solve, condensed and with the states as
  variables;
- on the true pendulum and Duffing oscillator: how far actuator limits are exceeded in
  `--steps` samples of random levels with 1 % noise, and the error at rest under a
  constant disturbance of the input.

Exits with 1 if a target is missed: 2 ms of processor time per step, no limit exceeded,
no fallback, an error at rest below 1e-6 of the standard deviation of y.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.linalg import block_diag
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, FlSsnn
from alssnn.datasets import make_duffing, make_pendulum
from alssnn.mpc import LinearizingMPC
from alssnn.mpc._qp import QuadraticProgram
from benchmarks._options import by_hand

STEP_MS, REST = 2.0, 1e-6
HORIZON, NX = 20, 6


def random_model(nu, ny, seed):
    """Return an AL-SSNN of order 6, fitted to a random plant with tanh at its input."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((NX, NX))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    B, C = rng.standard_normal((NX, nu)), rng.standard_normal((ny, NX))
    u, y = rng.standard_normal((2000, nu)), np.empty((2000, ny))
    x = np.zeros(NX)
    for k in range(len(u)):
        y[k] = C @ x
        x = A @ x + B @ (u[k] + 0.3 * np.tanh(y[k, :nu]))
    model = by_hand(AlSsnn, nx=NX, n_h=10, n_g=10, max_iter=20, random_state=seed)
    return model.fit(u, y)


def time_steps(model, soft, n_steps):
    """Return controller, record and mean processor time of a step in ms."""
    rng = np.random.default_rng(0)
    size, ny = model._scaling.y_scale, len(model.C_)
    bounds = {"y_min": -0.8 * size, "y_max": 0.8 * size} if soft else {}
    mpc = LinearizingMPC(model, HORIZON, u_min=-1, u_max=1, **bounds)
    levels = rng.uniform(-1, 1, (n_steps // 25, ny)) * size
    noise = 0.01 * size * rng.standard_normal((n_steps, ny))
    reference = np.repeat(levels, 25, axis=0)
    mpc.simulate(model, reference[:50])  # compiles, imports
    start = time.process_time()
    loop = mpc.simulate(model, reference, output_noise=noise)
    return mpc, loop, 1e3 * (time.process_time() - start) / len(reference)


def time_forms(mpc, n_solves=300):
    """Return the median time in ms of a program, condensed and with the states."""
    program, model, E = mpc._planner.program, mpc._model, mpc._soft.rows
    maps, condensed, n = program.prediction, program.qp, HORIZON
    A, B, C, nu = model.A, model.B, model.C, model.B.shape[1]
    ns, nX, nV = n * len(E), n * NX, n * nu
    Q = block_diag(*[C.T @ C] * (n - 1), mpc.P)
    R = np.diag(np.full(nV, 0.1))
    S = np.eye(nX) - np.kron(np.eye(n, k=-1), A)
    eye, Y = np.eye(ns), np.kron(np.eye(n), E)
    rows = [
        [-np.kron(np.eye(n), B), S, np.zeros((nX, ns))],
        [np.eye(nV), np.zeros((nV, nX + ns))],
        [np.zeros((ns, nV)), Y, eye],
        [np.zeros((ns, nV)), Y, -eye],
        [np.zeros((ns, nV + nX)), eye],
    ]
    sparse = QuadraticProgram(
        block_diag(R, Q, condensed.P.toarray()[nV:, nV:]),
        np.vstack([np.hstack(row) for row in rows]),
        tol=condensed.settings["eps_abs"],
        max_iter=condensed.settings["max_iter"],
    )
    price, inf = program.price, np.full(ns, np.inf)
    x, rng, times = np.zeros(NX), np.random.default_rng(0), ([], [])
    worst = 0.0
    for k in range(n_solves):
        if k % 25 == 0:
            X_s = np.tile(rng.standard_normal(NX), n)
        X_free = maps.X_x @ x
        Y_free, limit = Y @ X_free, np.full(ns, 0.8)
        one = np.full(nV, 1.0)
        start = time.perf_counter()
        first = condensed.solve(
            np.concatenate([maps.X_c.T @ (Q @ (X_free - X_s)), price]),
            np.concatenate([-one, -limit - Y_free, -inf, 0 * limit]),
            np.concatenate([one, inf, limit - Y_free, inf]),
        )
        times[0].append(time.perf_counter() - start)
        start = time.perf_counter()
        known = np.concatenate([A @ x, np.zeros(nX - NX)])
        second = sparse.solve(
            np.concatenate([np.zeros(nV), -Q @ X_s, price]),
            np.concatenate([known, -one, -limit, -inf, 0 * limit]),
            np.concatenate([known, one, inf, limit, inf]),
        )
        times[1].append(time.perf_counter() - start)
        v = first.x[:nu]
        worst = max(worst, np.abs(first.x[:nV] - second.x[:nV]).max())
        x = A @ x + B @ v + 0.02 * rng.standard_normal(NX)
    return (*(1e3 * np.median(t[1:]) for t in times), worst)


def run_plant(make, feedback, n_steps, seed):
    """Return excess of limits, share saturated, fallbacks, rest error, seconds."""
    record = make(4000, noise=0.01, random_state=seed)
    model = by_hand(
        FlSsnn, nx=2, n_h=8, feedback=feedback, dt=record.dt, random_state=seed
    )
    model.fit(record.u, record.y)
    size, rng = record.y.std(), np.random.default_rng(seed)
    limit = 0.5 * np.abs(record.u).max()
    mpc = LinearizingMPC(model, HORIZON, u_min=-limit, u_max=limit)
    reference = size * np.repeat(rng.uniform(-2, 2, n_steps // 40), 40)
    noise = 0.01 * size * rng.standard_normal((len(reference), 1))
    loop = mpc.simulate(record.plant, reference, output_noise=noise)
    excess = max(0.0, np.abs(loop.u).max() - limit)
    rest = np.full((1000, 1), 0.4 * size)
    push = np.full((1000, 1), 0.1 * record.u.std())
    held = mpc.simulate(record.plant, rest, input_disturbance=push)
    error = np.abs(held.y[-1] - rest[-1]).max() / size
    fallbacks = loop.n_fallbacks + held.n_fallbacks
    return excess, loop.saturated.mean(), fallbacks, error, loop.step_time[1:]


def main():
    """Measure, print, and compare with the targets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", ConvergenceWarning)
    missed = False
    print(f"load {os.getloadavg()[0]:.1f}; milliseconds, horizon {HORIZON}, nx = {NX}")
    print(
        f"{'nu':>3s}{'ny':>3s}{'soft':>6s}"
        f"{'cpu':>8s}{'step':>8s}{'95 %':>8s}{'solver':>8s}"
        f"{'condensed':>11s}{'states':>8s}{'difference':>12s}"
    )
    for nu, ny in ((1, 1), (2, 3)):
        model = random_model(nu, ny, options.seed)
        for soft in (False, True):
            mpc, loop, cpu = time_steps(model, soft, 1000)
            step, solver = 1e3 * loop.step_time[1:], 1e3 * loop.solve_time[1:]
            missed |= cpu > STEP_MS or loop.n_fallbacks > 0
            condensed, states, difference = time_forms(mpc)
            print(
                f"{nu:3d}{ny:3d}{soft!s:>6s}{cpu:8.2f}{np.median(step):8.2f}"
                f"{np.percentile(step, 95):8.2f}{np.median(solver):8.2f}"
                f"{condensed:11.3f}{states:8.3f}{difference:12.1e}",
                flush=True,
            )
    print(
        f"{'plant':15s}{'s':>8s}{'steps':>8s}{'excess':>9s}{'saturated':>11s}"
        f"{'fallbacks':>11s}{'at rest':>10s}{'step, ms':>10s}"
    )
    for make in (make_pendulum, make_duffing):
        for feedback in ("output", "state"):
            excess, share, fallbacks, error, seconds = run_plant(
                make, feedback, options.steps, options.seed
            )
            missed |= excess > 0 or fallbacks > 0 or error > REST
            print(
                f"{make.__name__:15s}{feedback:>8s}{options.steps:8d}{excess:9.1e}"
                f"{share:11.1%}{fallbacks:11d}{error:10.1e}"
                f"{1e3 * np.median(seconds):10.2f}",
                flush=True,
            )
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())

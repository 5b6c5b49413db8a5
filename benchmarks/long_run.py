"""A million steps on a plant whose sensor fails: limits, errors, memory, worst step.

    python -m benchmarks.long_run [--steps 1000000] [--mpc-steps 100000] [--quick]

A pendulum with a step behind its actuator is controlled (1) by an observer with a gate
of 10, state feedback and the linearizing law, (2) by predictive control, with models
that were identified from 1,500 samples. Of all measurements 5 % are lost (nan or inf),
1 % are spikes of up to 1e300; references change every 100 samples and 2 % of them are
lost; the actuator saturates.

Checks that every input is a number within the limits, that the error in the last tenth
is that of the first, and that memory does not grow after the first tenth. Times are
those of the CPU for one step of the controller, without the plant. Exits with 1 if a
check fails.
"""

import argparse
import os
import sys
import time
import warnings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import alssnn
from alssnn.datasets import make_pendulum
from alssnn.feedback import Observer, lqr

LIMIT = 6.0  # rad/s^2
SPIKES = (1e12, -1e12, 1e3, -1e3, 1e300)
PARTS = 10  # of a run, between which memory and errors are compared
GROWTH = 2_000_000  # bytes that a process may grow after the first part
HOLD = 100  # samples of a reference
LONG = 50_000  # steps from which the errors of tenths are compared


def identified():
    """Return the plant, a model of it and the standard deviation of its output."""
    record = make_pendulum(1_500, amplitude=5.0, noise=0.01, random_state=0)
    options = {"alpha": 0.0, "n_init": 1, "max_iter": 40, "random_state": 0}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model = alssnn.FlSsnn(2, 4, dt=record.dt, **options).fit(record.u, record.y)
    return record.plant, model, float(np.std(record.y))


def by_law(model):
    """Return a control step of observer, state feedback and law."""
    observer = Observer(model, gate=10.0)
    law = model.linearizing_law(u_min=-LIMIT, u_max=LIMIT)
    K = lqr(model, np.eye(2), 0.1 * np.eye(1))
    A, B, C = model.A_, model.B_, model.C_
    gain = np.linalg.inv(C @ np.linalg.solve(np.eye(2) - A + B @ K, B))[0]
    held = {"u": np.zeros(1), "r": 0.0}

    def control(r, y):
        held["r"] = r if np.isfinite(r) else held["r"]
        x_hat = observer.step(held["u"], y)
        v = model.u_offset_ + gain * (held["r"] - model.y_offset_) - K @ x_hat
        held["u"] = law(v, x_hat)
        return held["u"]

    return control


def resident():
    """Return the memory of this process, in bytes; 0 where nobody tells."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def run(plant, control, n, y_std):
    """Return figures of n steps."""
    rng = np.random.default_rng(0)
    dt, x, u = plant.dt, np.zeros(plant.nstates), np.zeros(1)
    seconds, memory, errors = np.ones(n), [], []  # written: it is not to grow
    reference, broken, saturated, square = 0.0, 0, 0, 0.0
    part = n // PARTS
    for k in range(n):
        if k % HOLD == 0:
            reference = rng.uniform(-1, 1) * y_std
        y = np.asarray(plant.output(k * dt, x, u))
        measured = y + 0.01 * rng.standard_normal(1)
        kind = rng.random()
        if kind < 0.05:
            measured = np.array([rng.choice([np.nan, np.inf, -np.inf])])
        elif kind < 0.06:
            measured = y + rng.choice(SPIKES)
        lost = k % HOLD and rng.random() < 0.02
        start = time.process_time()
        u = control(np.nan if lost else reference, measured)
        seconds[k] = time.process_time() - start
        size = abs(float(u[0]))
        broken += not size <= LIMIT  # nan breaks it, too
        saturated += size >= LIMIT
        push = 0.5 * (k // 500 % 2)
        x = np.asarray(plant.dynamics(k * dt, x, u + push))
        if k % HOLD >= 60:  # settled
            square += float(y[0] - reference) ** 2
        if (k + 1) % part == 0:
            memory.append(resident())
            errors.append(np.sqrt(square / (0.4 * part)) / y_std)
            square = 0.0
    return {
        "broken": broken,
        "saturated": saturated / n,
        "first": errors[0],
        "last": errors[-1],
        "growth": memory[-1] - memory[0],
        "typical": 1e6 * np.median(seconds),
        "late": 1e6 * np.quantile(seconds, 0.9999),
        "worst": 1e6 * seconds.max(),
    }


def main(arguments=None):
    """Run, print, and return whether a check failed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--mpc-steps", type=int, default=100_000)
    parser.add_argument("--quick", action="store_true", help="10,000 and 2,000 steps")
    options = parser.parse_args(arguments)
    if options.quick:
        options.steps, options.mpc_steps = 10_000, 2_000
    plant, model, y_std = identified()
    mpc = model.mpc(u_min=-LIMIT, u_max=LIMIT)
    failed = False
    for name, control, n in (
        ("observer and law", by_law(model), options.steps),
        ("predictive control", mpc.step, options.mpc_steps),
    ):
        z = run(plant, control, n, y_std)
        grown = z["growth"] > GROWTH
        # of a short run a tenth has few references
        worse = n >= LONG and not z["last"] < 2 * z["first"] + 0.05
        failed |= bool(z["broken"]) or grown or worse
        print(
            f"{name}: {n} steps, {z['broken']} beyond the limits, "
            f"{z['saturated']:.1%} at them; settled error {z['first']:.4f} of std(y) "
            f"in the first tenth, {z['last']:.4f} in the last; memory grew by "
            f"{z['growth'] / 1e6:.2f} MB; a step takes {z['typical']:.0f} us, "
            f"1 in 10,000 {z['late']:.0f} us, the worst {z['worst']:.0f} us",
            flush=True,
        )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())

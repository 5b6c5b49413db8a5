"""A million steps on plants whose sensors fail: limits, errors, memory, worst step.

    python -m benchmarks.long_run [--steps 1000000] [--mpc-steps 100000] [--quick]
                                  [--loops NAME [NAME ...]]

A pendulum with a step behind its actuator is controlled by an observer with a gate of
10, state feedback and the linearizing law ("law"), by predictive control ("mpc"), by
the controller of a predictor ("innovations") and by a law in continuous time that looks
half a sample ahead ("ahead").  Plants of `benchmarks.true_loops` whose law inverts a
monotone map have the controller of their design: a fan ("fan"), a tank whose inflow is
a measured disturbance ("valve") and an arm with two motors ("arm").  All models are
identified from 1,500 samples.  Of all measurements 5 % are lost (nan or inf), 1 % are
spikes of up to 1e300; references change every 100 samples and 2 % of them are lost, as
are 2 % of the disturbances; the actuators saturate.

Checks that every input is a number within the limits, that the error in the last tenth
is that of the first, and that memory does not grow after the first tenth.  Times are
those of the CPU for one step of the controller, without the plant.  Exits with 1 if a
check fails.
"""

import argparse
import os
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import alssnn
from alssnn.datasets import make_pendulum
from alssnn.feedback import LinearizingController, Observer, lqr
from benchmarks.true_loops import CASES, design

SAMPLES = 1_500  # of a record
LIMIT = 6.0  # rad/s^2, of the pendulum
SPIKES = (1e12, -1e12, 1e3, -1e3, 1e300)
PARTS = 10  # of a run, between which memory and errors are compared
GROWTH = 2_000_000  # bytes that a process may grow after the first part
HOLD = 100  # samples of a reference
SETTLED = 60  # of them, after which errors count
LONG = 50_000  # steps from which the errors of tenths are compared
ROUNDING = 1e-9  # relative, of a limit


@dataclass
class Loop:
    """Hold a true plant, what controls it, and what it is asked to do."""

    plant: Any
    control: Callable  # of reference, measurement and disturbances
    x0: np.ndarray
    center: np.ndarray  # of the references and of the output, (ny,)
    reference: np.ndarray  # their largest deviation, (ny,)
    spread: np.ndarray  # standard deviation of the outputs, (ny,)
    limits: tuple  # of every input
    push: float = 0.0  # a step behind the actuator, for half of the time
    inflow: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)))  # d


def quickly(make, record, *args, **options):
    """Return a model with a fit of few steps."""
    few = {"alpha": 0.0, "n_init": 1, "max_iter": 40, "random_state": 0}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model = make(*args, dt=record.dt, **{**few, **options})
        return model.fit(record.u, record.y)


def pendulum(control, **options):
    """Return the loop of a pendulum; `control` makes its controller of the model."""
    record = make_pendulum(SAMPLES, amplitude=5.0, noise=0.01, random_state=0)
    model = quickly(alssnn.FlSsnn, record, 2, 4, **options)
    spread = np.std(record.y, axis=0, keepdims=True).reshape(-1)
    at_rest, none = np.zeros(record.plant.nstates), np.zeros(1)
    limits = (-LIMIT, LIMIT)
    return Loop(
        record.plant, control(model), at_rest, none, spread, spread, limits, push=0.5
    )


def designed(name):
    """Return the loop of a plant of `benchmarks.true_loops`, with a monotone map."""
    case = CASES[name]
    record = case.make(SAMPLES, noise=0.01, random_state=0)
    kind = {"feedback": case.feedback, "input_map": "monotone"}
    if case.disturbances:
        kind["disturbances"] = list(case.disturbances)
    model = quickly(alssnn.FlSsnn, record, case.nx, 6, **kind)
    spread = record.y.reshape(SAMPLES, -1).std(axis=0)
    # beyond the recorded inputs the map is a guess
    u = np.delete(record.u.reshape(SAMPLES, -1), list(case.disturbances), axis=1)
    low, high = u.min(axis=0), u.max(axis=0)
    controller = model.controller(design(model, case, spread), u_min=low, u_max=high)
    inflow = case.make(5_000, random_state=1000).u[:, list(case.disturbances)]
    reference = np.full(len(spread), case.reference)
    return Loop(
        record.plant,
        lambda r, y, d: controller.step(r, y, d=d if len(d) else None),
        np.asarray(record.x0),
        model.y_offset_,
        reference,
        spread,
        (low, high),
        inflow=inflow,
    )


def by_controller(model):
    """Return a step of the default controller."""
    controller = model.controller(u_min=-LIMIT, u_max=LIMIT)
    return lambda r, y, d: controller.step(r, y)


def by_law_ahead(model):
    """Return a step of the controller whose law sees the middle of the next sample."""
    plant = model.plant_.at(model.dt, ahead=True)
    controller = LinearizingController(plant, u_min=-LIMIT, u_max=LIMIT)
    return lambda r, y, d: controller.step(r, y)


def by_plan(model):
    """Return a step of predictive control."""
    mpc = model.mpc(u_min=-LIMIT, u_max=LIMIT)
    return lambda r, y, d: mpc.step(r, y)


def by_law(model):
    """Return a control step of observer, state feedback and law."""
    observer = Observer(model, gate=10.0)
    law = model.linearizing_law(u_min=-LIMIT, u_max=LIMIT)
    K = lqr(model, np.eye(2), 0.1 * np.eye(1))
    A, B, C = model.A_, model.B_, model.C_
    gain = np.linalg.inv(C @ np.linalg.solve(np.eye(2) - A + B @ K, B))[0]
    held = {"u": np.zeros(1), "r": np.zeros(1)}

    def control(r, y, d):
        held["r"] = r if np.isfinite(r).all() else held["r"]
        x_hat = observer.step(held["u"], y)
        v = model.u_offset_ + gain * (held["r"] - model.y_offset_) - K @ x_hat
        held["u"] = law(v, x_hat)
        return held["u"]

    return control


LOOPS = {
    "law": lambda: pendulum(by_law),
    "mpc": lambda: pendulum(by_plan),
    "innovations": lambda: pendulum(by_controller, noise="innovations"),
    "ahead": lambda: pendulum(by_law_ahead, time="continuous", feedback="state"),
    "fan": lambda: designed("fan"),
    "valve": lambda: designed("valve"),
    "arm": lambda: designed("arm"),
}


def resident():
    """Return the memory of this process, in bytes; 0 where nobody tells."""
    try:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def measured(y, spread, rng):
    """Return what a bad sensor says of outputs."""
    y, kind = y + 0.01 * spread * rng.standard_normal(len(y)), rng.random(len(y))
    lost = rng.choice([np.nan, np.inf, -np.inf], len(y))
    spiked = y + rng.choice(SPIKES, len(y))
    return np.select([kind < 0.05, kind < 0.06], [lost, spiked], y)


def run(loop, n):
    """Return figures of n steps."""
    rng = np.random.default_rng(0)
    plant, x, ny = loop.plant, loop.x0, len(loop.spread)
    low, high = loop.limits
    slack = ROUNDING * (high - low)
    seconds, memory, errors = np.ones(n), [], []  # written: it is not to grow
    u = np.zeros(plant.ninputs - loop.inflow.shape[1])
    broken, saturated, square, part = 0, 0, 0.0, n // PARTS
    for k in range(n):
        if k % HOLD == 0:
            reference = loop.center + rng.uniform(-1, 1, ny) * loop.reference
        d = loop.inflow[k % len(loop.inflow)]
        y = np.asarray(plant.output(k * plant.dt, x, np.append(u, d)))
        seen = measured(y, loop.spread, rng)
        lost = k % HOLD and rng.random() < 0.02
        told = np.where(rng.random(len(d)) < 0.02, np.nan, d)
        start = time.process_time()
        u = loop.control(np.full(ny, np.nan) if lost else reference, seen, told)
        seconds[k] = time.process_time() - start
        broken += not np.all((u >= low - slack) & (u <= high + slack))  # nan, too
        saturated += bool(np.any((u <= low + slack) | (u >= high - slack)))
        push = loop.push * (k // 500 % 2)
        x = np.asarray(plant.dynamics(k * plant.dt, x, np.append(u + push, d)))
        if k % HOLD >= SETTLED:
            square += float(np.mean(((y - reference) / loop.spread) ** 2))
        if (k + 1) % part == 0:
            memory.append(resident())
            errors.append(np.sqrt(square / ((1 - SETTLED / HOLD) * part)))
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
    parser.add_argument("--loops", nargs="+", choices=LOOPS, default=list(LOOPS))
    options = parser.parse_args(arguments)
    if options.quick:
        options.steps, options.mpc_steps = 10_000, 2_000
    failed = False
    for name in options.loops:
        n = options.mpc_steps if name == "mpc" else options.steps
        z = run(LOOPS[name](), n)
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

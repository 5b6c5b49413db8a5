"""Fit a nonlinear LFR model by freq-statespace, in an environment of its own.

    python rival_freq_statespace.py DATA.npz OUT.csv --seconds 600 --seed 0

Called by `benchmarks.field.rivals`.  The steps and sizes are those with which its
authors fitted the mirror: a linear model by subspaces and its refinement, then a
network in its feedback, trained on simulations by BFGS.  The curve has a point after
every step, and points in the last one.
"""

import argparse
import csv
import time
from itertools import count
from types import SimpleNamespace

import equinox as eqx
import freq_statespace as fss
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from freq_statespace import _solve

EVERY = 10.0  # seconds between two points of the curve


class Clock:
    """Keep models and seconds, of clock and processor, and end the searches."""

    def __init__(self):
        self.start, self.cpu = time.perf_counter(), time.process_time()
        self.deadline, self.points, self.model_of = np.inf, [], None

    def now(self):
        """Return the seconds since the start."""
        return time.perf_counter() - self.start

    def keep(self, model):
        """Keep a point of the curve."""
        self.points.append((self.now(), time.process_time() - self.cpu, model))

    def follow(self):
        """Let the searches of the package pass here, step by step."""

        def filter_jit(function):
            compiled = eqx.filter_jit(function)
            last, calls = function.func.__name__ == "terminate", count()

            def told(*, y, state):
                first = next(calls) == 0  # before any step
                if last and self.model_of and self.now() - self.points[-1][0] > EVERY:
                    self.keep(self.model_of(y))
                result = compiled(y=y, state=state)
                over = last and not first and self.now() > self.deadline
                return (True, *result[1:]) if over else result

            return told

        names = {name: getattr(eqx, name) for name in dir(eqx) if name[0] != "_"}
        _solve.eqx = SimpleNamespace(**names | {"filter_jit": filter_jit})


def train(clock, data, options):
    """Fit until the time is over."""
    search = {"print_every": -1, "freq_weighting": False}
    search["solver"] = optx.BFGS(rtol=1e-3, atol=1e-5)
    linear = fss.lin.subspace_id(
        data, options.nx, freq_weighting=False, logging_enabled=False
    )
    clock.keep(linear)
    clock.follow()
    clock.deadline = options.seconds
    linear = fss.lin.optimize(linear, data, max_iter=5_000, **search)
    clock.keep(linear)
    network = fss.static.NeuralNetwork(
        options.nz,
        options.nw,
        layers=2,
        neurons_per_layer=options.neurons,
        activation=jax.nn.relu,
        seed=options.seed,
    )
    model = fss.nonlin.connect(linear, network)
    parts = eqx.partition(model, eqx.is_inexact_array)
    clock.model_of = lambda theta: eqx.combine(theta, parts[1], parts[0])
    model = fss.nonlin.optimize(model, data, max_iter=1_000_000, **search)
    clock.keep(model)


@eqx.filter_jit
def simulated(model, u, x0):
    """Return outputs (N, ny, runs) for inputs (N, nu, runs), both normalized."""
    return model._simulate(u, x0)[0]


@eqx.filter_jit
def sensitivity(model, u, x0):
    """Return the derivative of the outputs of one run by its initial state."""

    def outputs(x0):
        return model._simulate(u[..., None], x0[:, None])[0].ravel()

    return jax.jacfwd(outputs)(x0)


def error(model, norm, u, y, window):
    """Return the error behind the window that estimates the initial states."""
    u = jnp.asarray((u - norm.u_mean[:, None]) / norm.u_std[:, None])
    z = np.asarray((y - norm.y_mean[:, None]) / norm.y_std[:, None])
    nx, n_runs = model.A.shape[0], u.shape[2]
    first, x0 = u[:window], np.zeros((nx, n_runs))
    for _ in range(3):  # Gauss-Newton; the models are almost linear
        e = np.asarray(simulated(model, first, jnp.asarray(x0))) - z[:window]
        for r in range(n_runs):
            J = np.asarray(sensitivity(model, first[..., r], jnp.asarray(x0[:, r])))
            H = J.T @ J + 1e-6 * np.eye(nx)
            x0[:, r] -= np.linalg.solve(H, J.T @ e[..., r].ravel() + 1e-6 * x0[:, r])
    e = (np.asarray(simulated(model, u, jnp.asarray(x0))) - z)[window:]
    return float(np.mean(np.sqrt(np.mean(e**2, axis=0)) * norm.y_std[:, None]))


def main():
    """Fit, simulate the tests with what was kept, and write the curve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("out")
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--nx", type=int, default=28)
    parser.add_argument("--nw", type=int, default=8)
    parser.add_argument("--nz", type=int, default=16)
    parser.add_argument("--neurons", type=int, default=64)
    parser.add_argument("--realizations", type=int, default=6, help="of every level")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    content = np.load(options.data)
    levels = len(content["names"])
    u, y = (z.reshape(*z.shape[:2], levels, -1) for z in (content["u"], content["y"]))
    u, y = (z[..., : options.realizations] for z in (u, y))  # multiples of nu
    u, y = (z.reshape(*z.shape[:2], -1, 1) for z in (u, y))  # one period
    data = fss.create_data_object(u, y, content["lines"], float(content["rate"]))
    clock = Clock()
    train(clock, data, options)
    with open(options.out, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        for wall, cpu, model in clock.points:
            tests = content["names"], content["u_test"], content["y_test"]
            file.flush()
            for name, u, y in zip(*tests, strict=True):
                rmse = error(model, data.norm, u, y, int(content["window"]))
                rmse *= float(content["scale"])
                writer.writerow([name, f"{wall:.2f}", f"{cpu:.2f}", f"{rmse:.6g}"])


if __name__ == "__main__":
    main()

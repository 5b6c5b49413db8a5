"""Fit a state-space network by jax-sysid, in an environment of its own.

    python rival_jax_sysid.py DATA.npz OUT.csv --seconds 240 --seed 0

Called by `benchmarks.field.rivals`.  The model is that of `GrSsnn`,

    x+ = A x + B u + F tanh(E x + G u + b),    y = C x,

where A, B and C start from the package's own linear model, whose training counts.
Adam, then L-BFGS, until the time is over.
"""

import argparse
import csv
import time

import jax
import jax.numpy as jnp
import jaxopt
import numpy as np
from jax_sysid import models
from jax_sysid.models import LinearModel, Model
from scipy.optimize import least_squares

EVERY = 1.0  # seconds between two points of the curve


class OutOfTime(Exception):
    """End a search that knows no limit of time."""


class Clock:
    """Keep parameters and seconds, of clock and processor, and end a search."""

    def __init__(self, seconds):
        self.start, self.cpu = time.perf_counter(), time.process_time()
        self.seconds, self.points = seconds, []

    def __call__(self, z):
        now = time.perf_counter() - self.start
        if not self.points or now - self.points[-1][0] >= EVERY:
            self.keep(z)
        if now > self.seconds:
            raise OutOfTime

    def keep(self, z):
        """Keep a point of the curve."""
        now = time.perf_counter() - self.start, time.process_time() - self.cpu
        self.points.append((*now, [np.array(part) for part in z]))


def follow(clock):
    """Let the searches of jax-sysid tell the clock where they are."""
    minimize, adam = jaxopt.ScipyMinimize, models.adam_solver

    def told(*args, **kwargs):
        return minimize(*args, callback=clock, **kwargs)

    def adam_told(JdJ, z, *args, **kwargs):
        def value(z):
            clock(z)
            return JdJ(z)

        return adam(value, z, *args, **kwargs)

    models.jaxopt.ScipyMinimize, models.adam_solver = told, adam_told


def state(x, u, p):
    """Return the next state."""
    return p[0] @ x + p[1] @ u + p[3] @ jnp.tanh(p[4] @ x + p[5] @ u + p[6])


def output(x, u, p):
    """Return the output."""
    return p[2] @ x


def network(rng, nx, nu, n_f):
    """Return the initial parameters of the network."""
    return [
        0.01 * rng.standard_normal((nx, n_f)),
        0.3 * rng.standard_normal((n_f, nx)),
        0.3 * rng.standard_normal((n_f, nu)),
        0.1 * rng.standard_normal(n_f),
    ]


@jax.jit
def simulated(p, x0, u):
    """Return the outputs of a simulation."""

    def step(x, u):
        return state(x, u, p), output(x, u, p)

    return jax.lax.scan(step, x0, u)[1]


def error(p, u, y, window, scale):
    """Return the error behind the window that estimates the initial state."""
    first = u[:window], y[:window]

    def residual(x0):
        misfit = np.asarray(simulated(p, x0, first[0]) - first[1])
        return np.concatenate([misfit.ravel(), 1e-3 * x0])

    x0 = least_squares(residual, np.zeros(len(p[0])), max_nfev=50).x
    misfit = np.asarray(simulated(p, x0, u) - y)[window:]
    return scale * float(np.sqrt(np.mean(misfit**2)))


def train(clock, u, y, options):
    """Fit until the time is over."""
    nx, n_f = options.nx, options.n_f
    rng = np.random.default_rng(options.seed)
    linear = LinearModel(nx, y.shape[1], u.shape[1], seed=options.seed)
    linear.loss(rho_x0=1e-4, rho_th=1e-6)
    linear.optimization(adam_epochs=500, lbfgs_epochs=options.linear, iprint=-1)
    linear.fit(y, u)
    A, B, C, _ = linear.ssdata()
    _, X = linear.predict(linear.x0, u)
    size = np.asarray(X).std(axis=0)  # states of unit variance suit the network
    A, B, C = A * size / size[:, None], B / size[:, None], C * size
    model = Model(nx, y.shape[1], u.shape[1], state_fcn=state, output_fcn=output)
    model.init(
        params=[A, B, C, *network(rng, nx, u.shape[1], n_f)], x0=linear.x0 / size
    )
    model.loss(rho_x0=1e-4, rho_th=1e-8)
    follow(clock)
    model.optimization(
        adam_eta=1e-3,
        adam_epochs=options.adam,
        lbfgs_epochs=1_000_000,
        lbfgs_tol=1e-14,
        memory=50,
        iprint=-1,
    )
    model.fit(y, u)
    clock.keep(model.params)


def main():
    """Fit, simulate the test with what was kept, and write the curve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data")
    parser.add_argument("out")
    parser.add_argument("--seconds", type=float, default=240)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--nx", type=int, default=6)
    parser.add_argument("--n-f", type=int, default=15)
    parser.add_argument("--linear", type=int, default=200, help="its steps")
    parser.add_argument("--adam", type=int, default=200, help="epochs before L-BFGS")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    data = np.load(options.data)
    u, y, u_test, y_test = (data[k] for k in ("u", "y", "u_test", "y_test"))
    offset, spread = (np.concatenate([z.mean(0), z.std(0)]) for z in (u, y))
    nu, ny = u.shape[1], y.shape[1]
    u, u_test = ((z - offset[:nu]) / offset[nu:] for z in (u, u_test))
    y, y_test = ((z - spread[:ny]) / spread[ny:] for z in (y, y_test))
    clock = Clock(options.seconds)
    try:
        train(clock, u, y, options)
    except OutOfTime:
        pass
    scale = float(data["scale"] * spread[ny])
    with open(options.out, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        for wall, cpu, z in clock.points:
            p = [jnp.asarray(part) for part in z[:7]]
            rmse = error(p, u_test, y_test, int(data["window"]), scale)
            writer.writerow([f"{wall:.2f}", f"{cpu:.2f}", f"{rmse:.6g}"])


if __name__ == "__main__":
    main()

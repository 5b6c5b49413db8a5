"""The derivative oracle and small building blocks of the tests."""

import numpy as np
from structures import declare

from alssnn.activations import ACTIVATIONS
from alssnn.feedback import LinearizingController, Observer, lqi, lqr
from alssnn.forms import of_structure
from alssnn.kernels import differentiate
from alssnn.lure import Lure
from alssnn.models import state_space
from alssnn.plant import Plant
from alssnn.records import PreparedRecord
from alssnn.scaling import Scaling
from alssnn.sensitivities import sensitivities
from alssnn.simulation import neuron_gains, neuron_slopes, regressors
from alssnn.steady import follows
from alssnn.structures import direct
from alssnn.watch import Silent

STEP = 1e-30  # complex step: no subtraction, hence no rounding


class Heard(Silent):
    """Pass on what a search reports of its steps."""

    def __init__(self, step):
        self.step = step


def complex_step(function, x):
    """Return the Jacobian of an analytic function, exact to rounding."""
    columns = []
    for i in range(len(x)):
        shifted = x.astype(complex)
        shifted[i] += STEP * 1j
        columns.append(np.imag(function(shifted)) / STEP)
    return np.stack(columns, axis=-1)


def assert_jacobian(function, jacobian, x, rtol=1e-11):
    """Check a Jacobian against the complex step, relative to its largest entry."""
    expected = complex_step(function, x)
    assert jacobian.shape == expected.shape
    atol = rtol * max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(jacobian, expected, rtol=0, atol=atol)


def assert_direct(structure, theta, rng):
    """Check the direct derivative of one step against the complex step."""
    L = 5
    X, u = (
        rng.standard_normal((L, structure.nx)),
        rng.standard_normal((L, structure.nu)),
    )
    n_rows = structure.nx + structure.nz
    scale = rng.uniform(0.5, 2.0, n_rows)

    def step(theta):
        lure = structure.lure(theta)
        return regressors(lure, X, u) @ lure.Theta[:n_rows].T * scale

    lure, p = structure.lure(theta), structure.split(theta)
    Phi, W = regressors(lure, X, u), lure.W * scale[:, None]
    ways = [(direct(structure, p, scale), neuron_gains(lure, W, Phi))]
    if not lure.E.any():  # the gains of all rows follow from the slopes
        apart = direct(structure, p, scale, W)
        gains = neuron_slopes(lure, Phi)[:, None]
        ways.append((apart, ways[0][1] if apart.varies else gains))
    for sheets, gains in ways:
        gains, signals = sheets.factors(Phi, gains)
        for kernel in (differentiate, differentiate.plain):
            out = np.zeros((L, n_rows, structure.n_params))
            for k in range(L):  # one step each, from S = 0
                FH, one = np.zeros((1, n_rows, structure.nx)), slice(k, k + 1)
                S, J = np.split(out[k].copy(), [structure.nx])
                kernel(FH, *sheets.sheets, gains[one], signals[one], S, J[None])
                out[k] = np.vstack([S, J])
            assert_jacobian(step, out, theta)


def random_theta(structure, rng, radius=0.7):
    """Return parameters of a stable random model."""
    p = {k: 0.4 * rng.standard_normal(s) for k, s in structure.shapes.items()}
    p["A"] *= radius / np.abs(np.linalg.eigvals(p["A"])).max()
    return structure.join(p)


def simulate_linear(A, B, C, u, x0=None):
    """Return the outputs of a linear system, by the plainest loop."""
    x = np.zeros(len(A)) if x0 is None else np.array(x0, dtype=float)
    y = np.empty((len(u), len(C)))
    for k, u_k in enumerate(u):
        y[k] = C @ x
        x = A @ x + B @ u_k
    return y


def linear_plant(A, B, C=None, D=None, dt=1.0):
    """Return a linear plant, signals of unit size."""
    A, B = np.asarray(A, dtype=float), np.asarray(B, dtype=float)
    (nx, nu), C = B.shape, np.eye(len(A)) if C is None else np.asarray(C)
    D = np.zeros((len(C), nu)) if D is None else D
    Theta = np.pad(np.vstack([np.hstack([A, B]), np.hstack([C, D])]), ((0, 0), (0, 1)))
    return plant_of(Lure(Theta, nx, nu, 0), dt=dt)


def plant_of(lure, K=0.0, k=0.0, **fields):
    """Return the plant of a form with the channel y, h = K w + k, unit signals."""
    nx, nu, ny = lure.nx, lure.nu, lure.nz
    v = np.eye(nu, lure.Theta.shape[1], nx)
    v[:, nx + nu : -1] += K
    v[:, -1] += k
    Theta = np.insert(lure.Theta, [nx + ny] * nu, v, axis=0)
    given = {
        "form": Lure(Theta, nx, nu, lure.nw, lure.sigma),
        "law_form": Lure(np.eye(nu, ny + nu + 1, ny), 0, ny + nu, 0),
        "feedback": "output",
        "u_offset": np.zeros(nu),
        "y_offset": np.zeros(ny),
        "u_scale": np.ones(nu),
        "y_scale": np.ones(ny),
        "x_scale": np.ones(nx),
        "dt": 1.0,
        "inputs": [f"u[{i}]" for i in range(nu)],
        "outputs": [f"y[{i}]" for i in range(ny)],
        "name": "plant",
        "delay": np.zeros(nu, dtype=int),
    }
    return Plant(**{**given, **fields})


def stable(rng, n, radius):
    A = rng.standard_normal((n, n))
    return A * radius / np.abs(np.linalg.eigvals(A)).max()


def small_loop(rng, nx=2, nu=1, nw=4, size=0.1, radius=0.8, activation="tanh"):
    """Return a loop with two layers of neurons, and the design that ignores them."""
    ny = 1
    Theta = 0.5 * rng.standard_normal((nx + ny + nw, nx + nu + nw + 1))
    A, B = stable(rng, nx, radius), rng.standard_normal((nx, nu))
    Theta[:nx, : nx + nu] = np.hstack([A, B])
    Theta[: nx + ny, nx + nu :] *= size
    Theta[: nx + ny, -1] = 0.01
    layer = np.arange(nw) >= nw // 2
    Theta[nx + ny :, nx + nu : -1] *= layer[:, None] & ~layer[None, :]
    loop = Lure(Theta, nx, nu, nw, (ACTIVATIONS[activation],) * nw)
    M = loop.M
    return loop, (A, B, M[nx:, :nx], M[nx:, nx:])


def as_records(experiments):
    """Return (u, y, x0) of every experiment, deviations, as prepared records."""
    unit = Scaling(*(np.zeros(1), np.zeros(1), np.ones(1), np.ones(1)))
    return [
        PreparedRecord(
            slice(0, len(u)), u, y, unit.scale_u(u), unit.scale_y(y), x0, 0, unit
        )
        for u, y, x0 in experiments
    ]


def plant_of_structure(structure, theta, rng, delay=0):
    """Return the plant of a structure, at a random operating point."""
    nx, nu, ny = (structure.sizes[axis] for axis in "xuy")
    unit = {axis: np.ones(n) for axis, n in zip("xuy", (nx, nu, ny), strict=True)}
    return Plant(
        **of_structure(structure, theta, unit),
        u_offset=rng.standard_normal(nu),
        y_offset=rng.standard_normal(ny),
        u_scale=unit["u"],
        y_scale=unit["y"],
        x_scale=unit["x"],
        dt=0.5,
        inputs=[f"u[{i}]" for i in range(nu)],
        outputs=[f"y[{i}]" for i in range(ny)],
        name="plant",
        delay=np.broadcast_to(delay, nu).copy(),
    )


def controlled(name, seed=0, *, integrates=True, limits=None, scale=1.0, size=0.3):
    """Return a controller of a random plant of a structure."""
    rng = np.random.default_rng(seed)
    structure = declare(name, rng)
    theta = random_theta(structure, rng, 0.5)
    p = structure.split(theta)
    for key in ("W_h", "W_g"):
        if key in p:
            p[key] = size * p[key]
    plant = plant_of_structure(structure, structure.join(p), rng)
    nx, ny, nv = plant.nx, plant.ny, plant.nv
    if integrates:
        K = lqi(plant, np.eye(nx + ny), 10 * np.eye(nv))
    else:
        K = lqr(plant, np.eye(nx), 10 * np.eye(nv))
    observer = Observer(plant, R=0.1 * np.eye(ny))
    bounds = {}
    if limits is not None:
        bounds = {
            "u_min": plant.v_offset - limits,
            "u_max": plant.v_offset + limits,
        }
    return LinearizingController(plant, scale * K, observer=observer, **bounds)


def point(A, B, C):
    """Return a linear structure and its parameters."""
    structure = state_space(len(A), B.shape[1], len(C))
    return structure, structure.join({"A": A, "B": B, "C": C})


def bistable(w):
    """Return x+ = 0.5 x + u + w tanh(x), y = x: for w > 0.5 it keeps its sign."""
    structure = state_space(1, 1, 1, n_g=1, C=[[1.0]])
    theta = dict.fromkeys(structure.shapes, 0.0)
    theta |= {"A": 0.5, "B": 1.0, "W_x": 1.0, "W_g": w}
    return structure, structure.join(
        {n: np.full(structure.shapes[n], value) for n, value in theta.items()}
    )


def dense_residuals(criterion, free):
    """Return the full residual r; for tests and small problems.

    Parameters
    ----------
    criterion : Criterion
        Criterion.
    free : ndarray of shape (n,)
        Its free vector.

    Returns
    -------
    r : ndarray of shape (n_samples * nz + n,)
        Weighted residuals, those of the weight decay last.
    """
    theta, x0 = criterion.split(free)
    residuals = criterion.experiments.map(
        lambda *one: list(criterion.one.residuals(theta, *one)), x0
    )
    parts = [r.ravel() for rs in residuals for r in rs]
    return np.concatenate([*parts, criterion.decay * (free - criterion.center)])


def dense_jacobian(criterion, free):
    """Return the Jacobian of `dense_residuals`; for tests and small problems.

    Parameters
    ----------
    criterion : Criterion
        Criterion.
    free : ndarray of shape (n,)
        Its free vector.

    Returns
    -------
    J : ndarray of shape (n_samples * nz + n, n)
        Derivative of the residuals.
    """
    theta, x0 = criterion.split(free)
    n_params, n_x0 = criterion.structure.n_params, criterion.structure.n_x0
    parts = []
    x0 = criterion.initial_states(theta, x0)
    end = np.empty((criterion.structure.nx, n_params + n_x0))
    for i, ((u, y), start) in enumerate(zip(criterion.experiments, x0, strict=True)):
        where = np.r_[:n_params, n_params + i * n_x0 : n_params + (i + 1) * n_x0]
        blocks = []
        how = start, u, criterion.one.weight, criterion.one.chunk
        for part, _, J in sensitivities(criterion.structure, theta, *how, end=end):
            J[:, : y.shape[1]][np.isnan(y[part])] = 0.0
            block = np.zeros((J.shape[0] * J.shape[1], criterion.n))
            block[:, where] = J.reshape(len(block), -1)
            blocks.append(block)
        if criterion.periodic:
            own = where[n_params:]
            for block in blocks:
                block[:, :n_params] += block[:, own] @ follows(end, n_params)
                block[:, own] = 0.0
        parts += blocks
    return np.vstack([*parts, np.diag(criterion.decay)])

"""The derivative oracle and small building blocks of the tests."""

import numpy as np

from alssnn.kernels import differentiate
from alssnn.simulation import neuron_gains, regressors

STEP = 1e-30  # complex step: no subtraction, hence no rounding


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

    lure = structure.lure(theta)
    Phi = regressors(lure, X, u)
    WR = neuron_gains(lure, lure.W * scale[:, None], Phi)
    direct = structure.direct(structure.split(theta), scale)
    gains, signals = direct.factors(Phi, WR)
    for kernel in (differentiate, differentiate.plain):
        out = np.zeros((L, n_rows, structure.n_params))
        for k in range(L):  # one step each, from S = 0
            FH, one = np.zeros((1, n_rows, structure.nx)), slice(k, k + 1)
            S, J = np.split(out[k].copy(), [structure.nx])
            factors = direct.constants, gains[one], signals[one]
            kernel(FH, direct.table, *factors, S, J[None])
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

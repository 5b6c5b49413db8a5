"""The derivative oracle and small building blocks of the tests."""

import numpy as np

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

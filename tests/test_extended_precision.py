"""Residuals, Jacobian and J'J against the equations in 80 bits.

The equations are written out once more, for numbers of any type, and differentiated by
a complex step in extended precision: no line of the package takes part, and what is
left of the difference is the rounding of double precision.

    python -m pytest tests/test_extended_precision.py -s    # shows the figures
"""

import numpy as np
import pytest
from structures import declare

from alssnn.compression import EIGENVALUE_FLOOR
from alssnn.criterion import Criterion
from helpers import dense_jacobian, dense_residuals, random_theta

EPS = np.finfo(float).eps
N = (60, 40)  # samples of two experiments
WEIGHTS = {"y": 1.0, "g": 0.7, "e": 0.7, "k": 0.2, "h": 0.4}
NAMES = (
    *("linear", "linear-feedthrough", "fl", "fl-state", "gr", "al", "al-output"),
    *("al-free-bias", "al-state-output", "al-split", "nonlinear output"),
)
STEP = np.longdouble("1e-40")

pytestmark = pytest.mark.skipif(
    np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this system"
)


def outputs(structure, p, x, u):
    """Yield the channels of a structure by sample (eq. model, eq. gauge)."""
    p = {"C": structure.constants.get("C"), **p}
    zeta = 0 * x
    for u_k in u:
        z = {"y": p["C"] @ x}
        if "D" in p:
            z["y"] = z["y"] + p["D"] @ u_k
        if "W_k" in p:
            hidden = np.tanh(p["W_kx"] @ x + p["W_ku"] @ u_k + p["b_kx"])
            z["k"] = p["W_k"] @ (hidden - np.tanh(p["b_kx"]))
            z["y"] = z["y"] + z["k"]
        x_next, v = p["A"] @ x, u_k
        if "W_h" in p:
            by = "s" if "W_s" in p else "y"
            seen = x if by == "s" else z["y"]
            hidden = np.tanh(p[f"W_{by}"] @ seen + p[f"b_{by}"])
            z["h"] = p["W_h"] @ hidden + p["b_h"]
            v = u_k + z["h"]
        x_next = x_next + p["B"] @ v
        z["e"] = p["C"] @ zeta
        if "W_g" in p:
            hidden = np.tanh(p["W_x"] @ x + p["W_u"] @ u_k + p["b_x"])
            rest = p["b_g"] if "b_g" in p else -(p["W_g"] @ np.tanh(p["b_x"]))
            z["g"] = p["W_g"] @ hidden + rest
            x_next, zeta = x_next + z["g"], p["A"] @ zeta + z["g"]
        yield z
        x = x_next


def residuals(criterion, experiments, free):
    """Return the residuals in the precision of the free vector."""
    structure, n = criterion.structure, sum(N)
    theta, x0 = criterion.split(free)
    p, rows = structure.split(theta), []
    for (u, y), start in zip(experiments, x0, strict=True):
        for y_k, z in zip(y, outputs(structure, p, start, u), strict=True):
            z = {**z, "y": z["y"] - y_k}
            for name in structure.channels:
                weight = np.sqrt(np.longdouble(WEIGHTS[name]) / n)
                rows.append(weight * z[name])
    return np.concatenate(rows)


def reference(criterion, experiments, free):
    """Return residuals and Jacobian in extended precision."""
    wide = [tuple(a.astype(np.longdouble) for a in uy) for uy in experiments]
    r = residuals(criterion, wide, free.astype(np.longdouble))
    J = np.empty((len(r), len(free)), np.longdouble)
    for i in range(len(free)):
        shifted = free.astype(np.clongdouble)
        shifted[i] += 1j * STEP
        J[:, i] = residuals(criterion, wide, shifted).imag / STEP
    return r, J


def error(value, exact):
    """Return the largest difference over the largest entry."""
    return float(np.abs(value - exact).max() / np.abs(exact).max())


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_extended_precision(name, rng):
    structure = declare(name, rng)
    experiments = [
        (rng.standard_normal((n, structure.nu)), rng.standard_normal((n, structure.nz)))
        for n in N
    ]
    n_y = structure.sizes["y"]
    experiments = [(u, y[:, :n_y]) for u, y in experiments]
    weights = {channel: WEIGHTS[channel] for channel in structure.channels}
    criterion = Criterion(structure, experiments, weights=weights)
    free = criterion.join(
        random_theta(structure, rng), rng.standard_normal((2, structure.n_x0))
    )
    r, J = reference(criterion, experiments, free)
    JJ, Jr, norm = criterion.normal_equations(free)
    dense = dense_jacobian(criterion, free)[: len(r)]  # without the rows of the decay
    jac, fun = criterion.jac(free), criterion.fun(free)
    errors = {
        "r": error(dense_residuals(criterion, free)[: len(r)], r),
        "J": error(dense, J),
        "J'J": error(JJ, J.T @ J),
        "J'r": error(Jr, J.T @ r),
        "|r|": abs(float(norm / np.sqrt(r @ r) - 1)),
        "compressed J'J": error(jac.T @ jac, J.T @ J),
        "compressed J'r": error(jac.T @ fun, J.T @ r),
    }
    print(f"\n{name:<20s}", ", ".join(f"{k} {v:.1e}" for k, v in errors.items()))
    assert max(errors["r"], errors["|r|"]) < 10 * EPS, errors
    assert max(errors["J"], errors["J'J"]) < 10 * EPS, errors
    assert errors["J'r"] < 30 * EPS, errors  # a sum that cancels
    assert errors["compressed J'r"] < 30 * EPS, errors
    # directions that the data do not tell are given a floor
    assert errors["compressed J'J"] < EIGENVALUE_FLOOR * len(free), errors

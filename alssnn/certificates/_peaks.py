"""What bounded inputs can do to a linear system: peak gains (eq. peak).

For x+ = A x + B r, z = C x, x_0 = 0 and |r_j| <= 1 the largest |z_i| that input j can
make is the sum of the moduli of the impulse response, sum_k |C A^k B|_ij: the input
that has the signs of the response attains it.  The sum is taken up to a power n of A
that is small; what follows is bounded, elementwise, by

    sum_{k >= n} |C A^k B| <= |C A^n| (I - |A^n|)^-1 sum_{k < n} |A^k B|
"""

from dataclasses import dataclass

import numpy as np

SMALL = 1e-9  # of A^n, at which the sum ends
LONGEST = 200_000  # samples of a response
BLOCK = 64  # samples that are computed at once
ROUNDING = 1e-9  # relative, far above what sums of this length lose


class TooSlow(ValueError):
    """Say that a system forgets too slowly for its peak gains to be summed."""


@dataclass(frozen=True, eq=False)
class Peaks:
    """Hold what bounded inputs and constants can do to outputs of a linear system.

    Parameters
    ----------
    gain : ndarray of shape (nz, nu)
        Largest modulus of every output for every input of modulus one.
    low, high : ndarray of shape (nz,)
        Range of the response to the constants, from rest.
    n_terms : int
        Length of the sums.
    """

    gain: np.ndarray
    low: np.ndarray
    high: np.ndarray
    n_terms: int


def peaks(A, B, C, D, c=None, d=None):
    """Bound the outputs of x+ = A x + B r + c, z = C x + D r + d, from x = 0.

    Parameters
    ----------
    A, B, C, D : ndarray of shapes (nx, nx), (nx, nu), (nz, nx), (nz, nu)
        System, all of its poles inside the unit circle.
    c, d : ndarray of shapes (nx,) and (nz,), or None, default=None
        Constants; None means zeros.

    Returns
    -------
    peaks : Peaks
        Upper bounds of the gains, and the range of the response to the constants.

    Raises
    ------
    TooSlow
        If the system is not stable, or forgets so slowly that 200,000 samples do not
        tell its gains.
    """
    nx, nu = B.shape
    c = np.zeros(nx) if c is None else c
    d = np.zeros(len(C)) if d is None else d
    if nx == 0:
        return Peaks(np.abs(D), d, d, 0)
    radius = float(np.abs(np.linalg.eigvals(A)).max())
    if radius >= 1:
        raise TooSlow(
            f"The spectral radius of the linear system is {radius:.6g}, not below one."
        )
    n = int(np.ceil(np.log(SMALL) / np.log(max(radius, 1e-3))))
    n = max(n, 2 * nx)
    power = np.linalg.matrix_power(A, n)
    while np.abs(power).sum(axis=1).max() > 0.1 and n <= LONGEST:
        n, power = 2 * n, power @ power
    if n > LONGEST:
        raise TooSlow(
            f"The slowest pole of the linear system has modulus {radius:.10g}: its "
            f"peak gains need more than {LONGEST} samples."
        )
    at_rest = np.linalg.solve(np.eye(nx) - A, c)
    X = np.column_stack([B, at_rest])
    gain, passed = np.zeros((len(C), nu)), np.zeros((nx, nu + 1))
    settled = C @ at_rest + d
    low = high = d  # the first sample
    steps = [np.eye(nx)]
    for _ in range(min(n, BLOCK) - 1):
        steps.append(A @ steps[-1])
    block, jump = np.array(steps), A @ steps[-1]
    for start in range(0, n, BLOCK):
        several = block[: n - start] @ X  # the powers of A, some at a time
        z = C @ several
        gain += np.abs(z[:, :, :nu]).sum(axis=0)
        response = settled - z[:, :, nu]
        low = np.minimum(low, response.min(axis=0))
        high = np.maximum(high, response.max(axis=0))
        passed += np.abs(several).sum(axis=0)
        X = jump @ X
    rest = np.linalg.solve(np.eye(nx) - np.abs(power), passed)
    rest = np.abs(C @ power) @ rest
    gain = (gain + rest[:, :nu] + np.abs(D)) * (1 + ROUNDING)
    slack = rest[:, nu] + ROUNDING * np.abs(settled)
    low, high = np.minimum(low, settled - slack), np.maximum(high, settled + slack)
    return Peaks(gain, low, high, n)

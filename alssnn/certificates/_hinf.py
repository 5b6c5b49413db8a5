"""The H-infinity norm of a linear system: its largest gain over all frequencies."""

import numpy as np
from scipy.linalg import eig

GRID = 512  # first frequencies of the H-infinity norm
ON_CIRCLE = 1e-7  # distance from the unit circle that counts as on it
MAX_STEPS = 50  # quadratic convergence: a handful is the rule


def hinf_norm(A, B, C, tol=1e-8):
    """Compute the H-infinity norm of C (zI - A)^-1 B.

    Parameters
    ----------
    A, B, C : array_like of shapes (nx, nx), (nx, nu), (ny, nx)
        Discrete-time system; B = I gives the gain from omega to y.
    tol : float, default=1e-8
        Relative accuracy.

    Returns
    -------
    norm : float
        Largest gain over all frequencies; inf if A is not stable.

    Notes
    -----
    A grid of frequencies gives a lower bound. It is raised until the symplectic pencil
    of the bounded-real lemma, at the next larger level, has no eigenvalue on the unit
    circle: such eigenvalues are the frequencies at which the gain crosses the level
    [1]_. Costs a few eigenvalue problems of size 2 nx.

    References
    ----------
    .. [1] N. A. Bruinsma, M. Steinbuch, "A fast algorithm to compute the H-infinity
       norm of a transfer function matrix", Systems and Control Letters 14, 1990.

    Examples
    --------
    >>> from alssnn.certificates import hinf_norm
    >>> round(hinf_norm([[0.5]], [[1.0]], [[1.0]]), 6)  # 1 / (1 - 0.5), at rest
    2.0
    """
    A, B, C = (np.asarray(X, dtype=float) for X in (A, B, C))
    n = len(A)
    poles = np.linalg.eigvals(A)
    if np.abs(poles).max() >= 1:
        return np.inf

    def gain(angles):
        z = np.exp(1j * np.asarray(angles))[:, None, None]
        G = C @ np.linalg.solve(z * np.eye(n) - A, B)
        return float(np.linalg.norm(G, ord=2, axis=(1, 2)).max())

    # resonances are near the poles
    norm = gain(np.concatenate([np.linspace(0, np.pi, GRID), np.angle(poles)]))
    if norm == 0:
        return 0.0
    for _ in range(MAX_STEPS):
        level = norm * (1 + tol)
        right = np.block([[np.eye(n), -(B @ B.T) / level], [np.zeros((n, n)), A.T]])
        left = np.block([[A, np.zeros((n, n))], [-(C.T @ C) / level, np.eye(n)]])
        z = eig(left, right, right=False)
        z = z[np.isfinite(z)]
        crossings = np.sort(np.angle(z[np.abs(np.abs(z) - 1) < ON_CIRCLE]))
        if not len(crossings):
            break
        # those around 0 and pi, which are in the grid, are symmetric
        between = (crossings[1:] + crossings[:-1]) / 2
        raised = gain(np.concatenate([crossings, between]))
        if raised <= level:
            break
        norm = raised
    return norm

"""Compression: J'J, J'r and |r| as a Jacobian of n + 1 rows (eq. compress).

The state basis of a model is not unique: J'J is singular, and a rounded zero may be
negative.  All eigenvalues of the equilibrated matrix are therefore raised by what
rounding may do to them; left at zero, noise divided by noise would move the parameters
along the directions that the cost does not see.  L is then the Cholesky factor.  Where
rounding is larger, eigenvectors are taken, which do not mind.
"""

import numpy as np
from scipy.linalg import LinAlgError, cholesky, eigh

EIGENVALUE_FLOOR = 1e-12  # relative: below it, J'J is rounding times its conditioning


def compress(JJ, Jr, norm):
    """Return the compressed Jacobian [a'; L'] of n + 1 rows (eq. compress).

    Parameters
    ----------
    JJ : ndarray of shape (n, n)
        Gauss-Newton matrix J'J.
    Jr : ndarray of shape (n,)
        J'r.
    norm : float
        Norm of r.

    Returns
    -------
    jacobian : ndarray of shape (n + 1, n)
        ``jacobian.T @ jacobian`` is J'J and ``jacobian[0] * norm`` is J'r.
    """
    a = Jr / norm if norm > 0 else np.zeros_like(Jr)
    size = np.sqrt(np.diag(JJ))
    still = size == 0  # a parameter without effect keeps an exact zero column
    size[still] = 1.0
    # equilibrated, so that the rounding of J'J is relative to each column
    rest = (JJ - np.outer(a, a)) / np.outer(size, size)
    # the largest sum of a row is no less than the largest eigenvalue
    floor = EIGENVALUE_FLOOR * np.abs(rest).sum(axis=1).max(initial=0.0)
    try:
        L_t = cholesky(rest + floor * np.eye(len(rest))) * size
    except LinAlgError:
        # as where r is along the only column: all of it is rounding, of either sign
        eigenvalues, Q = eigh(rest)
        floor = EIGENVALUE_FLOOR * max(eigenvalues[-1], 0.0)
        L_t = np.sqrt(np.maximum(eigenvalues, floor))[:, None] * Q.T * size
    L_t[:, still] = 0.0
    return np.vstack([a, L_t])


def equilibrated_eigh(M, floor):
    """Return the eigenvalues of an equilibrated matrix that are above rounding.

    Parameters
    ----------
    M : ndarray of shape (n, n)
        Symmetric, positive semidefinite up to rounding.
    floor : float
        Largest eigenvalue that counts as rounding, relative to the largest of all.

    Returns
    -------
    values : ndarray of shape (rank,)
        Eigenvalues of M over the outer product of `size` with itself.
    Q : ndarray of shape (n, rank)
        Their eigenvectors.
    size : ndarray of shape (n,)
        Square roots of the diagonal of M, ones where it is zero.
    """
    size = np.sqrt(np.diag(M))
    size = np.where(size > 0, size, 1.0)
    values, Q = eigh(M / np.outer(size, size))
    seen = values > floor * max(values[-1], 0.0)
    return values[seen], Q[:, seen], size

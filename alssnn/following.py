"""Random walks that the predictor of a model follows (eq. drift).

The error of an estimate of [x; b] decays only if the gain K_b of the walk is small
enough and of the right sign.  A training shrinks it as far as that takes.
"""

import numpy as np

from .criterion import Mapped
from .innovations import drift_of, error_matrix

ROUNDING = 1e-9  # a modulus of a pole so close to one is taken for one
LEAST_SHARE = 1e-6  # of a gain, below which it is zero


def follows(structure, p):
    """Tell whether the error of a predictor decays, that of a random walk included.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    p : dict of str to ndarray
        Its parameters.

    Returns
    -------
    follows : bool
        Whether no pole of [x; b] is outside the unit circle (eq. drift); True for a
        model without drift.
    """
    if drift_of(structure) is None:
        return True
    A = error_matrix(structure, p)
    return bool(
        np.isfinite(A).all()
        and np.abs(np.linalg.eigvals(A)).max(initial=0.0) <= 1.0 + ROUNDING
    )


def following(structure, theta):
    """Return parameters with a random walk that follows (eq. drift).

    Parameters
    ----------
    structure : Structure
        Structure of a predictor with drift.
    theta : ndarray of shape (n_params,)
        Its parameters.

    Returns
    -------
    theta : ndarray of shape (n_params,)
        The same, with K_b halved until the error of the predictor decays.
    share : float
        What K_b was multiplied by; zero if no share of it follows.
    """
    p, share = dict(structure.split(theta)), 1.0
    K_b = p["K_b"]
    while share and not follows(structure, p):
        share = share / 2 if share > LEAST_SHARE else 0.0
        p["K_b"] = share * K_b + 0.0  # no negative zero
    return structure.join(p), share


class Following(Mapped):
    """Shrink the gain of a random walk until its predictor follows (eq. drift).

    A step that would make it negative is not rejected for that: where nothing drifts,
    the gain ends at zero, and all else has to move on.

    Parameters
    ----------
    criterion : Criterion
        Criterion of a predictor with drift.
    """

    def __init__(self, criterion):
        self.criterion, self.structure = criterion, criterion.structure
        self.where = self.structure.slices["K_b"]

    def to_free(self, free):
        """Return the free vector with a gain that follows.

        Parameters
        ----------
        free : ndarray of shape (n,)
            Free vector.

        Returns
        -------
        free : ndarray of shape (n,)
            Free vector of the criterion.
        """
        return self._shrunk(free)[0]

    def _shrunk(self, free):
        n = self.structure.n_params
        theta, share = following(self.structure, free[:n])
        return np.concatenate([theta, free[n:]]), share

    def pullback(self, free):  # numpydoc ignore=PR01,RT01
        """Return what gives the gain the share that is left of it."""
        _, share = self._shrunk(free)

        def pull(sums):
            sums[self.where] *= share
            return sums

        return pull

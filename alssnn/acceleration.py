"""Geodesic acceleration: steps that follow the bend of a valley.

A step s of Levenberg and Marquardt is straight, and where J turns on the way the cost
rises soon: the step is rejected and the next one is shorter.  With the second
derivative of the residual along the step, r'', the step is bent (eq. geodesic),

    a = -(J'J + mu D^2)^(-1) J' r'',    theta+ = theta + s + a / 2,

after Transtrum and Sethna (2012).  In parameters where the models that can be reached
are a surface, that is its geodesic, up to the second order.

MINPACK takes no such steps.  But it may search in other coordinates: `Accelerated`
gives it x with theta(x_i + s) = theta_i + s + a(s) / 2 around every accepted point x_i.
The derivative there is the one by theta, as a is of second order in s.
"""

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from .criterion import Mapped

REACH = 0.1  # share of a step over which the second derivative is taken
MOST_BEND = 0.5  # of a step, beyond which the second order does not tell the way
LEAST_DAMPING = 1e-8  # relative to the squared derivatives: rounding is not bent


class Accelerated(Mapped):
    """Evaluate a criterion in coordinates that follow its valleys.

    Parameters
    ----------
    criterion : LeastSquares
        Criterion.
    start : ndarray of shape (n,)
        Free vector of the criterion that has the same coordinates.
    """

    def __init__(self, criterion, start):
        self.criterion = criterion
        self._points = {(start + 0.0).tobytes(): np.array(start)}
        self._derived: tuple = ()  # last point with derivatives
        # largest squared derivatives by every parameter so far, as MINPACK has them
        # unless some are faint (`optimizers`)
        self._square = np.zeros(len(start))

    def to_free(self, x):
        """Return the free vector of the criterion.

        Parameters
        ----------
        x : ndarray of shape (n,)
            Coordinates that were asked for before, or a step away from the last point
            with derivatives.

        Returns
        -------
        free : ndarray of shape (n,)
            The free vector.
        """
        key = (x + 0.0).tobytes()  # no negative zero
        if key not in self._points:
            self._points[key] = self._bent(x)
        return self._points[key]

    def normal_equations(self, x):  # numpydoc ignore=PR01,RT01
        """Return J'J, J'r and |r|."""
        JJ, Jr, norm = super().normal_equations(x)
        self._square = np.maximum(np.diag(JJ), self._square)
        self._derived = x.copy(), self.to_free(x), JJ, Jr
        return JJ, Jr, norm

    def _bent(self, x):
        """Return where a step leads (eq. geodesic), straight on if that is unknown."""
        origin, free, JJ, Jr = self._derived
        step = x - origin
        square = np.where(self._square > 0, self._square, 1.0)  # D^2
        length = step @ (square * step)
        if not length > 0:  # too short to be squared
            return free + step
        change = self.criterion.pulled(free, free + REACH * step)  # J'(r_2 - r)
        if change is None or not np.isfinite(change).all():
            return free + step
        # MINPACK does not tell mu, but (J'J + mu D^2) s = -J'r
        damping = max(-(Jr + JJ @ step) @ step / length, LEAST_DAMPING)
        try:
            factor = cho_factor(JJ + np.diag(damping * square))
        except LinAlgError:
            return free + step
        second = 2 * (change / REACH - JJ @ step) / REACH  # J'r''
        bend = -cho_solve(factor, second)
        if not bend @ (square * bend) < MOST_BEND**2 * length:
            return free + step
        return free + step + bend / 2

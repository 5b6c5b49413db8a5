"""Limits of the actuators, which always hold, and of their rate, in the units of u."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

AT_LIMIT = 1e-6  # distance, in standard deviations of u, that counts as reached


@dataclass(frozen=True, eq=False)
class ActuatorLimits:
    """Hold what the actuators can do.

    Parameters
    ----------
    u_min, u_max : ndarray of shape (nu,)
        Limits of u; infinite without one.
    du_max : ndarray of shape (nu,)
        Limit of its change per sample; infinite without one.
    u_scale : ndarray of shape (nu,)
        Standard deviation of u.
    couple : bool, default=False
        Whether they couple inputs or samples of v, by a map that is no sum.
    """

    u_min: np.ndarray
    u_max: np.ndarray
    du_max: np.ndarray
    u_scale: np.ndarray
    couple: bool = False

    @cached_property
    def rated(self):
        """Return whether the change of any input is limited."""
        return bool(np.isfinite(self.du_max).any())

    def clip(self, u):
        """Return inputs within the limits of u.

        Parameters
        ----------
        u : ndarray of shape (nu,) or (N, nu)
            Inputs.

        Returns
        -------
        u : ndarray of shape (nu,) or (N, nu)
            Inputs that the actuators can take.
        """
        return np.minimum(np.maximum(u, self.u_min), self.u_max)

    def after(self, last, u):
        """Return an input within the limits of u and of its rate.

        Parameters
        ----------
        last : ndarray of shape (nu,)
            Input of the last sample.
        u : ndarray of shape (nu,)
            Input that is wanted; not finite stands for the last one.

        Returns
        -------
        u : ndarray of shape (nu,)
            Input for the plant. Where the limits of u force it, it moves faster.
        """
        u = np.where(np.isfinite(u), u, last)
        return self.clip(np.clip(u, last - self.du_max, last + self.du_max))

    def held(self, last, U):
        """Return a plan that the actuators can follow.

        Parameters
        ----------
        last : ndarray of shape (nu,)
            Input of the last sample.
        U : ndarray of shape (N, nu)
            Planned inputs.

        Returns
        -------
        U : ndarray of shape (N, nu)
            Inputs within the limits of u. If limits couple, they are within those of
            the rate, too: a program along this plan then has a solution.
        """
        return self.followed(last, U) if self.couple else self.clip(U)

    def followed(self, last, U):
        """Return a plan within the limits of u and of its rate, coupled or not.

        Parameters
        ----------
        last : ndarray of shape (nu,)
            Input of the last sample.
        U : ndarray of shape (N, nu)
            Planned inputs.

        Returns
        -------
        U : ndarray of shape (N, nu)
            What the plant receives of them. Where the limits of u force it, the first
            one moves faster.
        """
        U = self.clip(U)
        if self.rated:
            U[0] = last = self.after(last, U[0])
            for column, u, du in zip(U.T, last, self.du_max, strict=True):
                for i, wanted in enumerate(column.tolist()):
                    column[i] = u = min(max(wanted, u - du), u + du)
        return U

    def reached(self, last, u):
        """Return whether a limit of u or its rate is reached.

        Parameters
        ----------
        last : ndarray of shape (nu,)
            Input of the last sample.
        u : ndarray of shape (nu,)
            Input of this one.

        Returns
        -------
        reached : ndarray of bool of shape (nu,)
            Whether it is.
        """
        margin = AT_LIMIT * self.u_scale
        low = np.maximum(self.u_min, last - self.du_max) + margin
        high = np.minimum(self.u_max, last + self.du_max) - margin
        return (u <= low) | (u >= high)

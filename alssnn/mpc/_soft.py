"""Soft bounds of outputs and states: the rows of [C; I] x that have one.

Outputs count in standard deviations of the training data, as everywhere inside the
controller; states have about unit variance already.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SoftBounds:
    """Hold the bounded rows of a linear system, outputs first.

    Parameters
    ----------
    rows : ndarray of shape (n_soft, nx)
        Rows of [C; I] with a bound, outputs scaled.
    kept : ndarray of int of shape (n_soft,)
        Their places among outputs and states.
    below, above : ndarray of bool of shape (n_soft,)
        Whether they have a lower bound, and an upper one.
    lower, upper : ndarray of shape (ny + nx,)
        Bounds of outputs, in the units of y, and of states; infinite without one.
    y_scale : ndarray of shape (ny,)
        Standard deviations of the outputs.
    """

    rows: np.ndarray
    kept: np.ndarray
    below: np.ndarray
    above: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    y_scale: np.ndarray

    @classmethod
    def of(cls, C, y_scale, y_limits, x_limits):
        """Return the bounds of a linear system.

        Parameters
        ----------
        C : ndarray of shape (ny, nx)
            Output matrix, outputs scaled.
        y_scale : ndarray of shape (ny,)
            Standard deviations of the outputs.
        y_limits, x_limits : tuple of ndarray
            Lower and upper bounds of outputs, in the units of y, and of states.

        Returns
        -------
        bounds : SoftBounds
            The bounds.
        """
        lower, upper = (
            np.concatenate(pair) for pair in zip(y_limits, x_limits, strict=True)
        )
        finite = np.isfinite([lower, upper])
        kept = np.flatnonzero(finite.any(axis=0))
        rows = np.vstack([C, np.eye(C.shape[1])])[kept]
        below, above = finite[:, kept]
        return cls(rows, kept, below, above, lower, upper, y_scale)

    def around(self, y0):
        """Return the bounds as deviations, outputs scaled.

        Parameters
        ----------
        y0 : ndarray of shape (ny,)
            Output at x = 0, in the units of y.

        Returns
        -------
        lower, upper : ndarray of shape (n_soft,)
            Bounds of `rows` times x.
        """
        n_states = len(self.lower) - len(y0)
        shift = np.concatenate([y0, np.zeros(n_states)])
        size = np.concatenate([self.y_scale, np.ones(n_states)])
        return tuple(((b - shift) / size)[self.kept] for b in (self.lower, self.upper))

    def excess(self, X, bounds):
        """Return what a plan exceeds the bounds by.

        Parameters
        ----------
        X : ndarray of shape (horizon, nx)
            Planned states.
        bounds : tuple of two ndarray of shape (n_soft,)
            Bounds of `rows` times x, see `around`.

        Returns
        -------
        slack : ndarray of shape (horizon, n_soft)
            Excess of the bounded rows, outputs scaled; inf where the plan diverges.
        """
        lower, upper = bounds
        rows = X @ self.rows.T
        slack = np.maximum(np.maximum(lower - rows, rows - upper), 0.0)
        return np.where(np.isnan(slack), np.inf, slack)

    def largest(self, slack):
        """Return the largest excess of every output and state.

        Parameters
        ----------
        slack : ndarray of shape (horizon, n_soft)
            Excess of the bounded rows, outputs scaled.

        Returns
        -------
        slack_y : ndarray of shape (ny,)
            In the units of y; zero where there is no bound or no excess.
        slack_x : ndarray of shape (nx,)
            The same of the states.
        """
        excess = np.zeros(len(self.lower))
        excess[self.kept] = np.maximum(slack.max(axis=0), 0.0)
        y, x = np.split(excess, [len(self.y_scale)])
        return y * self.y_scale, x

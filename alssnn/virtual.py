"""The virtual input v = phi(u, s) as a map of u, and its inverse (eq. inverse).

All signals are deviations from the operating point, one sample per row.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import forms
from .lure import Lure
from .shown import short_repr
from .simulation import neuron_gains, regressors

NEEDS_S_AHEAD = (
    "The law u = v - h(s) of this model would need s {} samples ahead, for u arrives "
    "late. Fit with input_delay=0 and more states."
)
NEEDS_OLD_D = (
    "The law of this model would need a measured disturbance of {} samples ago, for it "
    "arrives late. Shift its column in the record, and take input_delay=0 for it."
)
NOT_MONOTONE = (
    "v = phi(u, s) of this model is not known to have one u for every v: neurons of h "
    "that see u must be those of `Equations.monotone`."
)
ALGEBRAIC = (
    "The law u = v - h(y) of this model is an algebraic loop: y depends on u of the "
    "same sample, through D or k. Fit with feedback='state', or without `feedthrough` "
    "and `n_k`."
)
PARALLEL = 1e-9  # relative: vectors whose cosine is this close to one are parallel


@dataclass(frozen=True, eq=False)
class Middle:
    """Hold what a law sees that looks half a sample ahead (eq. middle).

    Parameters
    ----------
    matrix : ndarray of shape (ns, nx + nd + nv)
        What s will be in the middle of the coming sample: a linear map of [x; d; v].
    law_form : Lure
        The static map of [s; d; u] to v, which the law solves with this s.
    """

    __repr__ = short_repr

    matrix: np.ndarray
    law_form: Lure

    def seen(self, x, d, v):
        """Return what the law sees.

        Parameters
        ----------
        x : ndarray of shape (N, nx)
            States.
        d : ndarray of shape (N, nd)
            Measured disturbances.
        v : ndarray of shape (N, nv)
            Virtual inputs that are wanted.

        Returns
        -------
        seen : ndarray of shape (N, ns + nd)
            What s is in the middle of the sample, and d.
        """
        s = np.hstack([x, d, v]) @ self.matrix.T  # (eq. middle)
        return np.hstack([s, d])


class VirtualMap:
    """Evaluate and invert the map of a plant.

    Parameters
    ----------
    form : Lure
        The map: no states, the inputs [s; u], the channel v; s is all that the law
        measures.
    scale : ndarray of shape (nu,)
        Sizes of the inputs.
    """

    def __init__(self, form, scale):
        self.form, self.scale, self.nu = form, scale, len(scale)

    @cached_property
    def is_sum(self):
        """Return whether v = u + h, whatever h sees: v has the size of u."""
        return np.array_equal(self.form.M[-self.nu :, -self.nu :], np.eye(self.nu))

    @cached_property
    def is_explicit(self):
        """Return whether v = u + h(s)."""
        return self.is_sum and not np.any(self.form.V[:, -self.nu :])

    @cached_property
    def increases(self):
        """Return whether there is one u for every v, by the weights (eq. monotone).

        Returns
        -------
        increases : bool
            Whether v = diag(d) u + W sigma(diag(lambda) W'u + ...) + ..., in scaled
            inputs, with d > 0, lambda >= 0 and a sigma that does not decrease.
        """
        if self.is_explicit:
            return True
        form, nu, scale = self.form, self.nu, self.scale
        gain = form.M[-nu:, -nu:]
        U, W = form.V[:, -nu:] * scale, form.W[-nu:] / scale[:, None]
        sees = np.any(U != 0, axis=1)
        along = np.einsum("ij,ji->i", U, W)
        size = np.linalg.norm(U, axis=1) * np.linalg.norm(W, axis=0)
        return bool(
            np.array_equal(gain, np.diag(gain.diagonal()))
            and np.all(gain.diagonal() > 0)
            and not np.any(form.E[:, sees])  # no neuron behind them
            and all(form.sigma[i].slope[0] >= 0 for i in np.flatnonzero(sees))
            and np.all(along[sees] >= (1 - PARALLEL) * size[sees])
        )

    def parts(self):
        """Return the map in two steps, of which the second alone depends on u.

        Returns
        -------
        before : Lure
            Static map from s to [z; a]: what v has of s alone, and what the neurons
            that see u see of s.
        behind : Lure
            Static map from [z; a; u] to v.
        """
        form, nu = self.form, self.nu
        ns = form.nu - nu
        sees = np.any(form.V[:, -nu:] != 0, axis=1)
        m, others = int(sees.sum()), np.flatnonzero(~sees)
        columns = np.r_[:ns, form.nu + others, -1]
        rows = np.vstack([form.rows_z, form.rows_v[sees], form.rows_v[others]])
        sigma = tuple(form.sigma[i] for i in others)
        before = Lure(rows[:, columns], 0, ns, len(others), sigma)
        z, a = np.eye(nu + m, nu), np.eye(nu + m, m, -nu)
        u = np.vstack([form.M[:, -nu:], form.V[sees, -nu:]])
        w = np.vstack([form.W[:, sees], np.zeros((m, m))])
        Theta = np.hstack([z, a, u, w, np.zeros((nu + m, 1))])
        sigma = tuple(form.sigma[i] for i in np.flatnonzero(sees))
        return before, Lure(Theta, 0, 2 * nu + m, m, sigma)

    def no_law(self, is_algebraic, delay, late=()):
        """Return why no law solves v = phi(u, s), if none does.

        Parameters
        ----------
        is_algebraic : bool
            Whether s depends on u of the same sample.
        delay : ndarray of int of shape (nu,)
            Samples by which the inputs arrive late.
        late : sequence of int, default=()
            The same of measured disturbances, the last of what the law measures.

        Returns
        -------
        reason : str
            The reason; empty if there is a law.
        """
        if not self.increases:
            return NOT_MONOTONE
        if is_algebraic:
            return ALGEBRAIC
        if np.any(delay):
            return NEEDS_S_AHEAD.format(delay.max())
        n = self.form.nu - self.nu
        columns = np.arange(n - len(late), n)[np.asarray(late, dtype=int) > 0]
        sees = np.any(self.form.Theta[:, columns])
        return NEEDS_OLD_D.format(max(late)) if sees else ""

    def cancelled(self, s, u=None):
        """Return h = phi(u, s) - u.

        Parameters
        ----------
        s : ndarray of shape (N, ns)
            What the law measures.
        u : ndarray of shape (N, nu) or None, default=None
            Inputs; needed unless `is_explicit`.

        Returns
        -------
        h : ndarray of shape (N, nu)
            What the law takes off v.

        Raises
        ------
        ValueError
            If `u` is missing though h depends on it.
        """
        if self.is_explicit:
            u = np.zeros((len(s), self.nu))
        elif u is None:
            raise ValueError(
                "`u` must be given, for what this law cancels depends on it, got "
                "None. Pass the input that goes to the plant."
            )
        Phi = self._regressors(s, u)
        h = Phi @ self.form.rows_z.T
        return h if self.is_explicit else h - u

    def inverse(self, s, v):
        """Return the inputs that make v.

        Parameters
        ----------
        s : ndarray of shape (N, ns)
            What the law measures.
        v : ndarray of shape (N, nu)
            Virtual inputs.

        Returns
        -------
        u : ndarray of shape (N, nu)
            Inputs; nan where none was found.
        """
        form, nu, loop = self.form, self.nu, self._inverse
        u = regressors(loop, s, v) @ loop.rows_z.T
        if not loop.implicit:  # a formula
            return u
        # one step on u itself, for a steep phi takes digits from v - h
        Phi = self._regressors(s, u)
        slope = form.M[:, -nu:] + neuron_gains(form, form.W, Phi) @ form.V[:, -nu:]
        error = (Phi @ form.rows_z.T - v)[..., None]
        return u - np.linalg.solve(slope, error)[..., 0]

    @cached_property
    def _inverse(self):
        """Return the inverse as a form with the state s, the input v, the channel u."""
        form, ns = self.form, self.form.nu - self.nu
        stay = np.eye(ns, form.Theta.shape[1])
        Theta = np.vstack([stay, form.Theta])
        return forms.closed(
            Lure(Theta, ns, self.nu, form.nw, form.sigma), np.arange(self.nu)
        )

    def _regressors(self, s, u):
        return regressors(self.form, np.zeros((len(s), 0)), np.hstack([s, u]))


def by_rows(function, *signals):
    """Return the value of a function of rows, of single samples or both.

    Parameters
    ----------
    function : callable
        Function of arrays with as many rows.
    *signals : ndarray of shape (n,) or (N, n)
        Its arguments; a single sample is repeated.

    Returns
    -------
    value : ndarray of shape (m,) or (N, m)
        What the function returns, a single sample if all are.
    """
    rows = np.broadcast_shapes(*(z.shape[:-1] for z in signals))
    n = int(np.prod(rows))
    every = (np.broadcast_to(np.atleast_2d(z), (n, z.shape[-1])) for z in signals)
    return function(*every).reshape(*rows, -1)

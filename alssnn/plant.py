"""A fitted model as a value: what travels to laws, loops, certificates and files.

A `Plant` is the Lur'e form of one identified model in the units of its user, with the
outputs y and the virtual input v as channels, and all that others must know of the
signals (`Signals`), the region of the training data, and the noise.  It cannot be
changed; its verbs return numbers or other plants.  States are deviations, u and y carry
their operating point,

    x+ = f(x, u - u_offset),    y = c(x, u - u_offset) + y_offset,    v = phi(u, s)

What is linear is linear from v, x+ = A x + B dv + omega and y = C x + D dv + eta with
dv = v - v_offset; omega and eta are what the linear model lacks.  The law solves v =
phi(u, s).  Measured disturbances d add G dd and H dd, and the law sees them beside s
(eq. disturbance).  Inputs that arrive late have their past as further states (`late`).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from . import forms
from .checks import check_columns, check_pairs
from .lure import Lure
from .rates import Rates, resampled
from .region import Region
from .shown import short_repr
from .signals import Signals
from .simulation import neuron_gains, regressors
from .virtual import Middle, VirtualMap, by_rows


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Plant(Signals):
    """Hold one identified model, in the units of the user.

    Parameters
    ----------
    form : Lure
        Model with the states x, the inputs that have arrived, and the channels [y; v];
        all signals are deviations. Inputs are those of a record, in its order.
    law_form : Lure
        The same v as a static map of what the law measures: no states, the inputs
        [s; d; u] with the u that are moved, the channel v; deviations.
    feedback : {"output", "state"}
        What the law measures: s = y, or s = x.
    region : Region or None, default=None
        Region of the training data, without past inputs.
    no_law : str, default=""
        Why u = v - h(s) is no law of this plant; empty if it is one.
    rates : Rates or None, default=None
        Equations in continuous time that were sampled, if they were.
    middle : Middle or None, default=None
        What the law sees of the middle of the coming sample, if it looks ahead (`at`).

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> plant = model.plant_
    >>> np.allclose(plant.output(np.zeros((1, 4)), record.u[:1]), model.y_offset_)
    True
    """

    form: Lure
    law_form: Lure
    feedback: str
    region: Region | None = field(default=None, repr=False)
    no_law: str = ""
    rates: Rates | None = field(default=None, repr=False)
    middle: Middle | None = field(default=None, repr=False)

    def __repr__(self):
        """Return sizes, and first of all whether the law looks ahead."""
        told = "Plant(looks half a sample ahead, " if self.looks_ahead else "Plant("
        return short_repr(self).replace("Plant(", told, 1)

    def __post_init__(self):
        """Say why the law is none, where it is none."""
        if self.cancels and not self.no_law and not self.looks_ahead:
            is_algebraic = self.feedback == "output" and self.feeds_through
            delays = np.delete(self.delay, self.given), self.delay[list(self.given)]
            reason = self.law_map.no_law(is_algebraic, *delays)
            object.__setattr__(self, "no_law", reason)

    # -- sizes and rows --------------------------------------------------------------

    @property
    def looks_ahead(self):
        """Return whether the law sees the middle of the coming sample (eq. middle)."""
        return self.middle is not None

    @property
    def nx(self):
        """Return the number of states, past inputs included."""
        return self.form.nx

    @property
    def lure(self):
        """Return the Lur'e form, with channels [y; v]; refuse it if inputs are late."""
        if np.any(self.delay):
            raise ValueError(
                f"The inputs of this plant arrive late, by {self.delay.tolist()} "
                "samples. Take `plant.late()`, which has their past as states."
            )
        return self.form

    @cached_property
    def cancels(self):
        """Return whether v is more than u."""
        only_u = forms.only_input(self.form, self.moved)
        return bool(np.any(self.form.rows_z[self.ny :] != only_u))

    @cached_property
    def is_explicit(self):
        """Return whether v = u + h(s); else the law solves v = phi(u, s) for u."""
        return not self.cancels or self.law_map.is_explicit

    @property
    def is_solved(self):
        """Return whether the law solves v = phi(u, s) for u, by iteration."""
        return self.cancels and not self.solved_map.is_explicit

    @cached_property
    def has_linear_output(self):
        """Return whether y = C x, without D, H and k of inputs of the same sample."""
        return not np.any(self.form.rows_z[: self.ny, self.nx :])

    @cached_property
    def feeds_through(self):
        """Return whether y depends on inputs of the same sample that are moved."""
        rows = self.form.rows_z[: self.ny, self.nx :]
        by_u, others = rows[:, self.moved], rows[:, self.nu : -1]
        return bool(np.any(by_u) or np.any(others))  # a neuron may see them

    @cached_property
    def observed(self):
        """Return the form with the channels [y; v; omega; eta] (eq. eta)."""
        return forms.observed(self.lure, self.moved)

    # -- other plants ----------------------------------------------------------------

    def at(self, dt, ahead=False):
        """Return the plant at another sampling time, inputs held in between.

        Parameters
        ----------
        dt : float
            Sampling time, in seconds.
        ahead : bool, default=False
            Whether the law sees the middle of the coming sample (eq. middle): it then
            measures the state, and what it misses because u is held falls with dt^2.

        Returns
        -------
        plant : Plant
            The same equations, sampled at this time.

        Raises
        ------
        ValueError
            If time is discrete or the plant was changed (`late`, `linearized`), delays
            are no multiples of `dt`, or to look ahead takes D, H, k or a d of the past.
        """
        return resampled(self, dt, ahead)

    def arrived(self):
        """Return the plant of inputs that have arrived, as prepared records have them.

        Returns
        -------
        plant : Plant
            The same states without the delays; no law of it if none of this plant.
        """
        return replace(self, delay=np.zeros_like(self.delay))

    def late(self):
        """Return the plant with the past of late inputs as states.

        Returns
        -------
        plant : Plant
            The plant with sum(delay) more states: for each input its last values,
            oldest first. Its u and v are what is sent now. Itself without delay.
        """
        n = int(np.sum(self.delay))
        if n == 0:
            return self
        form = self.form
        if self.no_law:
            form = forms.with_virtual(form, forms.only_input(form, self.moved))
        return replace(
            self,
            rates=None,
            form=forms.late_inputs(form, self.delay, self.moved),
            delay=np.zeros_like(self.delay),
            x_scale=np.append(self.x_scale, np.repeat(self.u_scale, self.delay)),
            n_late=n,
        )

    def with_disturbance(self, kind):
        """Return the plant of the state [x; d] with a constant disturbance d.

        Parameters
        ----------
        kind : {"output", "input"}
            Whether d is added to y, in its units, or to the inputs that are moved, in
            theirs.

        Returns
        -------
        plant : Plant
            The same model with nx + ny or nx + nv states, the last of which stay as
            they are. Its v is that of the plant without d if `is_explicit`, and its K
            `gain_with` this kind.

        Raises
        ------
        ValueError
            If `kind` is unknown.
        """
        form = forms.disturbed(self.lure, kind, self.moved)
        size = {"output": self.y_scale, "input": self.v_scale}[kind]
        parts = {"K": self.gain_with(kind), "x_scale": np.append(self.x_scale, size)}
        return replace(self, rates=None, form=form, drift=None, **parts)

    def close(self):
        """Return the loop u = phi^-1(v, s), whatever makes v (eq. loop).

        Returns
        -------
        loop : Lure
            Form with the states of the plant, the inputs of the plant with v in the
            place of those that are moved, and the channels [y; u], all deviations.

        Raises
        ------
        ValueError
            If the law is none of this plant, see `no_law`.
        """
        lure = self.lure
        if self.no_law:
            raise ValueError(self.no_law)
        return forms.closed(lure, self.moved)

    def linearized(self):
        """Return the plant behind its law: v is its input, and nothing is cancelled.

        Returns
        -------
        plant : Plant
            The loop of `close` as a plant.
        """
        n, nv = self.law_form.nu, self.nv
        form = forms.driven(self.close(), self.moved)
        law_form = Lure(np.eye(nv, n + 1, n - nv), 0, n, 0)
        return replace(self, form=form, law_form=law_form, middle=None, rates=None)

    # -- numbers ---------------------------------------------------------------------

    def linear(self):
        """Return the linear part, as v sees it.

        Returns
        -------
        A, B, C, D : ndarray
            Matrices of x+ = A x + B dv + G dd + omega, y = C x + D dv + H dd + eta.
        """
        nx, (M, v) = self.nx, np.split(self.lure.M, [self.nx + self.ny])
        by_v = M[:, nx + self.moved] / forms.input_gain(self.form, self.moved)
        by_x = M[:, :nx] - by_v @ v[:, :nx]  # what is linear of h (eq. split)
        return by_x[:nx], by_v[:nx], by_x[nx:], by_v[nx:]

    def disturbed_by(self):
        """Return what measured disturbances do to the linear part.

        Returns
        -------
        G : ndarray of shape (nx, nd)
            Part of x+ that is linear in them.
        H : ndarray of shape (ny, nd)
            Part of y.
        """
        nx, M = self.nx, self.lure.M
        _, B, _, D = self.linear()
        given = nx + np.asarray(self.given, dtype=int)
        by_d = M[: nx + self.ny, given] - np.vstack([B, D]) @ M[nx + self.ny :, given]
        return by_d[:nx], by_d[nx:]

    def step(self, x, u):
        """Return the next state.

        Parameters
        ----------
        x : ndarray of shape (nx,) or (N, nx)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu)
            Input, in the user's units.

        Returns
        -------
        x_next : ndarray of shape (nx,) or (N, nx)
            State one sample later.
        """
        Phi = self._regressors(x, u)
        return (Phi @ self.form.rows_x.T).reshape(np.shape(x))

    def output(self, x, u=None):
        """Return the output.

        Parameters
        ----------
        x : ndarray of shape (nx,) or (N, nx)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu) or None, default=None
            Input of the same sample, in the user's units; needed only where y depends
            on it.

        Returns
        -------
        y : ndarray of shape (ny,) or (N, ny)
            Output, in the user's units.

        Raises
        ------
        ValueError
            If `u` is missing though y depends on it.
        """
        rows = self.lure.rows_z[: self.ny]
        if self.has_linear_output:
            return check_columns("x", x, self.nx) @ rows[:, : self.nx].T + self.y_offset
        if u is None:
            raise ValueError(
                "`u` must be given, for y depends on inputs of the same sample through "
                f"{forms.at_once(self.form, self.moved)}, got None. Pass them."
            )
        y = self._regressors(x, u) @ rows.T + self.y_offset
        return y.reshape(*np.shape(x)[:-1], self.ny)

    def virtual(self, x, u):
        """Return the virtual input v = phi(u, s) along states and inputs.

        Parameters
        ----------
        x : ndarray of shape (nx,) or (N, nx)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu)
            Input, in the user's units.

        Returns
        -------
        v : ndarray of shape (nv,) or (N, nv)
            Input of the linear part, in the units of u.
        """
        v = self._regressors(x, u, with_v=True) @ self.form.rows_z[self.ny :].T
        return (v + self.v_offset).reshape(*np.shape(x)[:-1], self.nv)

    def cancelled(self, s, u=None, d=None, v=None):
        """Return what the law takes off v.

        Parameters
        ----------
        s : ndarray of shape (ns,) or (N, ns)
            Measured output, in the units of y, or state.
        u : ndarray of shape (nv,) or (N, nv) or None, default=None
            Inputs that are moved, in the user's units; needed unless `is_explicit`.
        d : ndarray of shape (nd,) or (N, nd) or None, default=None
            Measured disturbances, in the user's units; needed if there are any.
        v : ndarray of shape (nv,) or (N, nv) or None, default=None
            Virtual input with which a law that looks ahead sees the middle of the
            sample; None takes the one of u. Other laws do not need it.

        Returns
        -------
        h : ndarray of shape (nv,) or (N, nv)
            Nonlinearity h = phi(u, s) - u, in the units of u; zero for a model without
            it.

        Raises
        ------
        ValueError
            If `u` is missing though h depends on it, or `d` is.
        """
        if not self.cancels:
            return np.zeros((*np.shape(s)[:-1], self.nv))
        of_u = () if u is None else (check_columns("u", u, self.nv) - self.v_offset,)
        law_map = self.law_map if v is None else self.solved_map
        return by_rows(law_map.cancelled, self._seen(s, d, v), *of_u)

    def law(self, v, s, d=None):
        """Return the input that makes v the input of the linear part.

        Parameters
        ----------
        v : ndarray of shape (nv,) or (N, nv)
            Wanted virtual input, in the units of u.
        s : ndarray of shape (ns,) or (N, ns)
            Measured output, in the units of y, or state.
        d : ndarray of shape (nd,) or (N, nd) or None, default=None
            Measured disturbances, in the user's units; needed if there are any.

        Returns
        -------
        u : ndarray of shape (nv,) or (N, nv)
            Inputs of the plant that are moved, in the user's units.

        Raises
        ------
        ValueError
            If the law is none of this plant, see `no_law`, or `d` is missing.
        """
        if self.no_law:
            raise ValueError(self.no_law)
        v = check_columns("v", v, self.nv)
        if not self.is_solved:
            return v - self.cancelled(s, d=d, v=v)
        seen, dv = self._seen(s, d, v), v - self.v_offset
        return by_rows(self.solved_map.inverse, seen, dv) + self.v_offset

    def jacobian(self, x, u):
        """Return the linearization at a state and an input.

        Parameters
        ----------
        x : ndarray of shape (nx,) or (N, nx)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu)
            Input, in the user's units.

        Returns
        -------
        A, B, C, D : ndarray of shape (nx, nx), (nx, nu), (ny, nx), (ny, nu)
            Derivatives of x+ and y by x and u; one per row behind a first axis N.
        """
        return self._slopes(self._regressors(x, u), np.shape(x)[:-1])

    def tangent(self, x, u):
        """Return the next state with its derivatives, for less than both alone.

        Parameters
        ----------
        x : ndarray of shape (N, nx)
            States.
        u : ndarray of shape (N, nu)
            Inputs, in the user's units.

        Returns
        -------
        x_next : ndarray of shape (N, nx)
            States one sample later, as of `step`.
        A, B : ndarray of shape (N, nx, nx) and (N, nx, nu)
            Derivatives by x and u, as of `jacobian`.
        """
        Phi = self._regressors(x, u)
        return Phi @ self.form.rows_x.T, *self._slopes(Phi, np.shape(x)[:-1])[:2]

    @cached_property
    def law_map(self):
        """Return the map from s and u to v, of deviations, as a `VirtualMap`."""
        return VirtualMap(self.law_form, self.v_scale)

    @cached_property
    def solved_map(self):
        """Return the map that the law solves, at what it sees: `law_map` mostly."""
        form = self.law_form if self.middle is None else self.middle.law_form
        return VirtualMap(form, self.v_scale)

    def _seen(self, s, d, v=None):
        """Return deviations of what the law sees; in the middle of a sample with v."""
        if self.feedback == "output":
            s = check_columns("s", s, self.ny) - self.y_offset
        # no network sees past inputs
        ds = np.asarray(s)[..., : self.law_form.nu - self.nu]
        dd = self.check_disturbances(d) - self.d_offset
        if self.middle is not None and v is not None:
            return by_rows(self.middle.seen, ds, dd, v - self.v_offset)
        return by_rows(lambda *z: np.hstack(z), ds, dd) if self.given else ds

    @cached_property
    def _behind(self):
        """Return the form without the first neurons, which make v and nothing else."""
        return forms.part(self.lure, np.arange(self.law_form.nw, self.lure.nw))

    def _regressors(self, x, u, with_v=False):
        """Return phi of states and inputs, one per row."""
        x, u = check_pairs(x=(x, self.nx), u=(u, self.nu))
        du = u - self.u_offset
        if with_v or not self.looks_ahead:
            return regressors(self.lure, x, du)
        Phi, first = regressors(self._behind, x, du), self.nx + self.nu
        return np.insert(Phi, [first] * self.law_form.nw, 0.0, axis=1)

    def _slopes(self, Phi, rows):
        """Return A, B, C and D at regressors."""
        lure, nx, n = self.form, self.nx, self.nx + self.ny
        J = lure.M[:n] + neuron_gains(lure, lure.W[:n], Phi) @ lure.V  # (eq. sens)
        J = J.reshape(*rows, *J.shape[1:])
        return J[..., :nx, :nx], J[..., :nx, nx:], J[..., nx:, :nx], J[..., nx:, nx:]

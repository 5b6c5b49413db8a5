"""The linearizing law u = phi^-1(v, s): one static feedback cancels the matched part.

The law lives in the units of the user.  Its input v has the units of u, and the linear
system (A, B, C) sees v - u_offset:

    u = v - h(s - s_offset)     =>     x+ = A x + B (v - u_offset) + g,   y = C x + ...

s is the measured y (s_offset = y_offset) for a model with output feedback, and the
estimated state x_hat (s_offset = 0) for one with state feedback.

With measured disturbances d the law is u = phi^-1(v, s, d): it feeds forward what they
do through h (eq. disturbance).  What they do beside it, G d, the linear design sees.

A model with ``input_map="monotone"`` has v = phi(u, s), of which h = phi(u, s) - u is
what the law cancels; it solves for the one u of every v (eq. inverse).
"""

import control
import numpy as np

from ..checks import as_numbers
from ..plants import as_plant
from ..warn import warn_user
from .checks import check_limits
from .export import signal_names

RANGE_TOL = 1e-6  # of the width of a range
BEYOND = 0.1  # of the range of an input in training, by which a limit may exceed it
UNSOLVED = (
    "The law found no u with phi(u, s) = v, and the operating point takes its place. "
    "Its map is too steep: fit with a larger `alpha`."
)


class LinearizingLaw:
    """Cancel the matched nonlinearity h of an identified model, ``u = v - h(s)``.

    For a model without h the law is the identity (up to saturation). For one with a
    monotone input map it solves v = phi(u, s) for u. It can be pickled.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    u_min : float, array_like of shape (nv,) or None, default=None
        Lower limits of the actuators, in the units of u; None means no limit.
    u_max : float, array_like of shape (nv,) or None, default=None
        Upper limits of the actuators, in the units of u.

    Attributes
    ----------
    plant : Plant
        What the law was made for.
    u_min, u_max : ndarray of shape (nv,)
        Limits; infinite where there is none.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If a limit has the wrong size, is NaN, or `u_min` is not below `u_max`; or if
        the law is ill-posed: output feedback where y depends on u of the same sample
        (D or k), or an input that arrives late.

    Warns
    -----
    UserWarning
        If a limit of a model with ``input_map="monotone"`` is far from the inputs of
        the training.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.FlSsnn(nx=2, n_h=2, alpha=0.0, max_iter=20, tol=1e-2)
    >>> law = model.fit(record.u, record.y).linearizing_law(u_min=-2, u_max=2)
    >>> law([0.1], [0.0, 0.0]).shape
    (1,)
    """

    def __init__(self, model, u_min=None, u_max=None):
        self.plant = as_plant(model)
        if self.plant.no_law:
            raise ValueError(self.plant.no_law)
        self.u_min, self.u_max = check_limits("u", u_min, u_max, self.plant.nv)
        if self.plant.is_solved and self.plant.region is not None:
            _warn_of_limits(self.plant, self.u_min, self.u_max)

    def __repr__(self):
        """Return what the law measures, and its limits."""
        limits = [
            f", {name}={np.array2string(limit, precision=4, threshold=4)}"
            for name, limit in (("u_min", self.u_min), ("u_max", self.u_max))
            if np.isfinite(limit).any()
        ]
        s = "x_hat" if self.feedback == "state" else "y"
        s = "s half a sample ahead" if self.plant.looks_ahead else s
        term = f"v - h({s})" if self.plant.cancels else "v"
        if self.plant.is_solved:
            term = f"phi^-1(v, {s})"
        return f"LinearizingLaw(u = {term}{''.join(limits)})"

    @property
    def feedback(self):
        """Return what the law measures, "output" or "state"."""
        return self.plant.feedback

    @property
    def n_seen(self):
        """Return the number of outputs or states that the law measures."""
        by_state = self.feedback == "state"
        return self.plant.nx - self.plant.n_late if by_state else self.plant.ny

    def __call__(self, v, s, d=None):
        """Return the input that makes the model linear from v.

        Parameters
        ----------
        v : array_like of shape (nv,) or (N, nv)
            Input of the linear system, in the units of u (operating point included).
        s : array_like of shape (ns,) or (N, ns)
            Measured output, in the units of y, or estimated state.
        d : array_like of shape (nd,) or (N, nd) or None, default=None
            Measured disturbances, in the order and units of the record; needed if the
            model has any.

        Returns
        -------
        u : ndarray of shape (nv,) or (N, nv)
            Input for the plant, within the limits.

        Raises
        ------
        ValueError
            If `v`, `s` or `d` has the wrong number of columns or is not finite, they
            differ in rows, or `d` is missing.
        """
        return self.split(v, s, d)[0]

    def split(self, v, s, d=None):
        """Return the input and the part of it that the limits cut off.

        Parameters
        ----------
        v : array_like of shape (nv,) or (N, nv)
            Input of the linear system, in the units of u (operating point included).
        s : array_like of shape (ns,) or (N, ns)
            Measured output, in the units of y, or estimated state.
        d : array_like of shape (nd,) or (N, nd) or None, default=None
            Measured disturbances, in the order and units of the record; needed if the
            model has any.

        Returns
        -------
        u : ndarray of shape (nv,) or (N, nv)
            Input for the plant, within the limits.
        cut : ndarray of shape (nv,) or (N, nv)
            Part cut off, v - h - u; zero if no limit is met. The linear system sees
            v - cut; of a law that looks ahead up to what h changes with cut in half a
            sample, for it sees the middle of the sample with v.

        Raises
        ------
        ValueError
            If `v`, `s` or `d` has the wrong number of columns or is not finite, they
            differ in rows, or `d` is missing.
        """
        v = _rows("v", v, len(self.u_min))
        s = _rows("s", s, self.n_seen)
        d = self._given(d)
        rows = {len(z) for z in (v, s, d) if z is not None and z.ndim == 2}
        if len(rows) > 1:
            raise ValueError(
                "`v`, `s` and `d` must have the same number of rows, got "
                f"{' and '.join(map(str, sorted(rows)))}."
            )
        return self._split(v, s, d)

    def _given(self, d):
        """Return measured disturbances, checked; the plant says which are missing."""
        plant = self.plant
        if d is None:
            plant.check_disturbances(None)
            return None
        return _rows("d", d, plant.nd)

    @np.errstate(over="ignore", invalid="ignore")
    def _split(self, v, s, d=None):
        """Return the input and what was cut off; the limits hold for nan, too.

        Loops have signals that overflow. An input that is not a number is then the one
        at the operating point, or its limit, and nothing counts as cut off.
        """
        plant = self.plant
        wanted = plant.law(v, s, d)
        u = np.clip(wanted, self.u_min, self.u_max)
        limited = np.isfinite(self.u_min) | np.isfinite(self.u_max)
        lost = np.isnan(u) & limited
        if lost.any():
            if np.isfinite(v).all() and np.isfinite(s).all():
                warn_user(UNSOLVED, RuntimeWarning)
            rest = np.clip(plant.v_offset, self.u_min, self.u_max)
            u, v = np.where(lost, rest, u), np.where(lost, np.nan, v)
            wanted = np.where(lost, u, wanted)
        if not plant.is_solved or np.array_equal(u, wanted, equal_nan=True):
            return u, wanted - u
        # phi couples inputs: a limit of one takes off v of all
        met = np.any(u != wanted, axis=-1, keepdims=True)
        cut = np.where(met, v - u - plant.cancelled(s, u, d, v), 0.0)
        return u, np.where(np.isnan(cut), 0.0, cut)

    def h(self, s, u=None, d=None):
        """Return what the law cancels.

        Parameters
        ----------
        s : array_like of shape (ns,) or (N, ns)
            Measured output, in the units of y, or estimated state.
        u : array_like of shape (nv,) or (N, nv) or None, default=None
            Input of the plant, in the units of u; needed for a model with
            ``input_map="monotone"``, whose h depends on it.
        d : array_like of shape (nd,) or (N, nd) or None, default=None
            Measured disturbances, in the order and units of the record; needed if the
            model has any.

        Returns
        -------
        h : ndarray of shape (nv,) or (N, nv)
            Nonlinearity at the input, phi(u, s) - u, in the units of u; zero for a
            model without it.

        Raises
        ------
        ValueError
            If `s`, `u` or `d` has the wrong number of columns or is not finite, or
            `u` or `d` is missing.
        """
        u = None if u is None else _rows("u", u, len(self.u_min))
        return self.plant.cancelled(_rows("s", s, self.n_seen), u, self._given(d))

    def output(self, t, x, signals, params):
        """Return u for the stacked inputs (v, s, d), for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (0,)
            Not used, the law has no state.
        signals : ndarray of shape (nv + ns + nd,)
            The inputs v, then s, then d.
        params : dict
            Not used.

        Returns
        -------
        u : ndarray of shape (nu,)
            Input for the plant, within the limits whatever the signals are.
        """
        return self.output_and_cut(t, x, signals, params)[: len(self.u_min)]

    def output_and_cut(self, t, x, signals, params):
        """Return u and the part cut off for the stacked inputs (v, s, d).

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (0,)
            Not used, the law has no state.
        signals : ndarray of shape (nv + ns + nd,)
            The inputs v, then s, then d.
        params : dict
            Not used.

        Returns
        -------
        u_cut : ndarray of shape (2 nv,)
            Input for the plant, then what `split` says was cut off.
        """
        nv = len(self.u_min)
        v, s, d = np.split(signals, [nv, nv + self.n_seen])
        return np.concatenate(self._split(v, s, d if len(d) else None))

    def to_nlsys(self, with_cut=False):
        """Return the law as a static block of python-control.

        Parameters
        ----------
        with_cut : bool, default=False
            Whether the part that the limits cut off is an output, too.

        Returns
        -------
        sys : control.NonlinearIOSystem
            Block without state from (v[0], ..., s, d) to u, and ``cut[0]``, ... on
            request. The signals of u, d and y have the names of the training data,
            those of the state are ``x_hat[0]``, ...
        """
        plant, nv = self.plant, self.plant.nv
        cut = signal_names(None, "cut", nv) if with_cut else []
        measured = plant.outputs
        if self.feedback == "state":
            measured = signal_names(None, "x_hat", self.n_seen)
        seen = [*signal_names(None, "v", nv), *measured]
        seen += [plant.inputs[i] for i in plant.given]
        return control.nlsys(
            None,
            self.output_and_cut if with_cut else self.output,
            inputs=signal_names(seen),  # unique
            outputs=[*(plant.inputs[i] for i in plant.moved), *cut],
            dt=plant.dt,
            name="law",
        )


def input_range(model):
    """Return the range of the inputs that are moved, in the training data.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.

    Returns
    -------
    low, high : ndarray of shape (nv,)
        Smallest and largest value of every input, in the units of u.

    Raises
    ------
    NotFittedError
        If the model is not fitted.

    See Also
    --------
    step_comparison : What u is in a step response.

    Examples
    --------
    >>> from alssnn.feedback import input_range
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> bool(np.isclose(input_range(model)[1], record.u.max()).all())
    True
    """
    plant = as_plant(model)
    low, high = (bound[: plant.nu][plant.moved] for bound in plant.region.seen)
    return low + plant.v_offset, high + plant.v_offset


def leaves_range(model, u):
    """Tell which inputs leave the range of the training data.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    u : ndarray of shape (nv, N)
        Inputs that are moved, in their units.

    Returns
    -------
    leaves : ndarray of bool of shape (nv,)
        Whether each goes further than rounding, of the range or of limits set to it.
    """
    low, high = input_range(model)
    slack = RANGE_TOL * (high - low)
    return (u.min(axis=1) < low - slack) | (u.max(axis=1) > high + slack)


def _warn_of_limits(plant, u_min, u_max):
    """Warn of limits far from the inputs of the training, where phi is a guess."""
    low, high = input_range(plant)
    slack = BEYOND * (high - low)
    for i, name in enumerate(plant.inputs[j] for j in plant.moved):
        for limit, beyond in (
            (u_min[i], np.isfinite(u_min[i]) and u_min[i] < low[i] - slack[i]),
            (u_max[i], np.isfinite(u_max[i]) and u_max[i] > high[i] + slack[i]),
        ):
            if beyond:
                warn_user(
                    f"The limit {limit:.4g} of {name!r} is beyond the training data, "
                    f"{low[i]:.4g} to {high[i]:.4g}, where phi(u, s) is a guess. "
                    "Record inputs up to the limit, or take a nearer one.",
                    UserWarning,
                )


def _rows(name, value, size):
    """Return one sample or one per row."""
    value = as_numbers(name, value)
    if value.ndim not in (1, 2) or value.shape[-1] != size:
        raise ValueError(
            f"`{name}` must have shape ({size},) or (N, {size}), got {value.shape}. "
            "Time runs down the rows."
        )
    if not np.isfinite(value).all():
        raise ValueError(
            f"`{name}` must be finite, got nan or inf. Hold the last value where one "
            "is missing."
        )
    return value

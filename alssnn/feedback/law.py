"""The linearizing law u = v - h(s): one static feedback cancels the matched part.

The law lives in the units of the user.  Its input v has the units of u, and the linear
system (A, B, C) sees v - u_offset:

    u = v - h(s - s_offset)     =>     x+ = A x + B (v - u_offset) + g,   y = C x + ...

s is the measured y (s_offset = y_offset) for a model with output feedback, and the
estimated state x_hat (s_offset = 0) for one with state feedback.
"""

import control
import numpy as np
from sklearn.utils.validation import check_is_fitted

from .checks import check_limits
from .export import signal_names


class LinearizingLaw:
    """Cancel the matched nonlinearity h of an identified model, ``u = v - h(s)``.

    For a model without h the law is the identity (up to saturation). It can be
    pickled.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u_min : float, array_like of shape (nu,) or None, default=None
        Lower limits of the actuators, in the units of u; None means no limit.
    u_max : float, array_like of shape (nu,) or None, default=None
        Upper limits of the actuators, in the units of u.

    Attributes
    ----------
    feedback : {"output", "state"}
        What the law measures: s = y, or s = x_hat.
    u_min, u_max : ndarray of shape (nu,)
        Limits; infinite where there is none.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If a limit has the wrong size, is NaN, or `u_min` is not below `u_max`; or if
        the law is ill-posed: output feedback where y depends on u of the same sample
        (D or k), or an input that arrives late.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.FlSsnn(nx=2, n_h=2, alpha=0.0, max_iter=20, tol=1e-2)
    >>> law = model.fit(record.u, record.y).linearizing_law(u_min=-2, u_max=2)
    >>> law([0.1], [0.0, 0.0]).shape
    (1,)
    """

    def __init__(self, model, u_min=None, u_max=None):
        check_is_fitted(model)
        self._net = model._h()
        self.feedback = "state" if "W_s" in model.params_ else "output"
        nu, state = model.B_.shape[1], self.feedback == "state"
        if self._net is not None:
            _check_posed(model, state)
        self._offset = np.zeros(model.nx_) if state else model.y_offset_
        self._dt = model.dt
        self._inputs = signal_names(getattr(model, "feature_names_in_", None), "u", nu)
        self._measured = signal_names(
            None if state else model.output_names_,
            "x_hat" if state else "y",
            len(self._offset),
        )
        self.u_min, self.u_max = check_limits("u", u_min, u_max, nu)

    def __call__(self, v, s):
        """Return the input that makes the model linear from v.

        Parameters
        ----------
        v : array_like of shape (nu,) or (N, nu)
            Input of the linear system, in the units of u (operating point included).
        s : array_like of shape (ns,) or (N, ns)
            Measured output, in the units of y, or estimated state.

        Returns
        -------
        u : ndarray of shape (nu,) or (N, nu)
            Input for the plant, within the limits.
        """
        return self.split(v, s)[0]

    def split(self, v, s):
        """Return the input and the part of it that the limits cut off.

        Parameters
        ----------
        v : array_like of shape (nu,) or (N, nu)
            Input of the linear system, in the units of u (operating point included).
        s : array_like of shape (ns,) or (N, ns)
            Measured output, in the units of y, or estimated state.

        Returns
        -------
        u : ndarray of shape (nu,) or (N, nu)
            Input for the plant, within the limits.
        cut : ndarray of shape (nu,) or (N, nu)
            Part cut off, v - h(s) - u; zero where not saturated. The linear system
            sees v - cut.

        Raises
        ------
        ValueError
            If `v` or `s` has the wrong number of columns, or both differ in rows.
        """
        v = _rows("v", v, len(self.u_min))
        s = _rows("s", s, len(self._offset))
        if v.ndim == s.ndim == 2 and len(v) != len(s):
            raise ValueError(
                "`v` and `s` must have the same number of rows, got "
                f"{len(v)} and {len(s)}."
            )
        wanted = v - self.h(s)
        u = np.clip(wanted, self.u_min, self.u_max)
        return u, wanted - u

    def h(self, s):
        """Return what the law cancels.

        Parameters
        ----------
        s : ndarray of shape (ns,) or (N, ns)
            Measured output, in the units of y, or estimated state.

        Returns
        -------
        h : ndarray of shape (nu,) or (N, nu)
            Nonlinearity at the input, in the units of u; zero for a model without it.
        """
        if self._net is None:
            return np.zeros((*s.shape[:-1], len(self.u_min)))
        return self._net(s - self._offset)

    def bounds_on_v(self, s):
        """Return the interval of v that the limits of the actuators leave.

        Parameters
        ----------
        s : array_like of shape (ns,) or (N, ns)
            Measured output, in the units of y, or estimated state.

        Returns
        -------
        v_min : ndarray of shape (nu,) or (N, nu)
            Lower bound, u_min + h(s); -inf without a limit.
        v_max : ndarray of shape (nu,) or (N, nu)
            Upper bound, u_max + h(s); inf without a limit.

        Raises
        ------
        ValueError
            If `s` has the wrong number of columns.
        """
        h = self.h(_rows("s", s, len(self._offset)))
        return self.u_min + h, self.u_max + h

    def output(self, t, x, signals, params):
        """Return u for the stacked inputs (v, s), for python-control.

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (0,)
            Not used, the law has no state.
        signals : ndarray of shape (nu + ns,)
            The inputs v, then s.
        params : dict
            Not used.

        Returns
        -------
        u : ndarray of shape (nu,)
            Input for the plant.
        """
        v, s = np.split(signals, [len(self.u_min)])
        return self(v, s)

    def output_and_cut(self, t, x, signals, params):
        """Return u and the part cut off for the stacked inputs (v, s).

        Parameters
        ----------
        t : float
            Time, in seconds; not used.
        x : ndarray of shape (0,)
            Not used, the law has no state.
        signals : ndarray of shape (nu + ns,)
            The inputs v, then s.
        params : dict
            Not used.

        Returns
        -------
        u_cut : ndarray of shape (2 nu,)
            Input for the plant, then what `split` says was cut off.
        """
        v, s = np.split(signals, [len(self.u_min)])
        return np.concatenate(self.split(v, s))

    def to_nlsys(self, with_cut=False):
        """Return the law as a static block of python-control.

        Parameters
        ----------
        with_cut : bool, default=False
            Whether the part that the limits cut off is an output, too.

        Returns
        -------
        sys : control.NonlinearIOSystem
            Block without state from (v[0], ..., s) to u, and ``cut[0]``, ... on
            request. The signals of u and y have the names of the training data, those
            of the state are ``x_hat[0]``, ...
        """
        nu = len(self.u_min)
        cut = signal_names(None, "cut", nu) if with_cut else []
        return control.nlsys(
            None,
            self.output_and_cut if with_cut else self.output,
            inputs=[*signal_names(None, "v", nu), *self._measured],
            outputs=[*self._inputs, *cut],
            dt=self._dt,
            name="law",
        )


def _check_posed(model, state):
    """Refuse a law that would need what is not known yet."""
    if not state and (np.any(model.D_) or "W_k" in model.params_):
        raise ValueError(
            "The law u = v - h(y) of this model is an algebraic loop: y depends on u "
            "of the same sample, through D or k. Fit with feedback='state', or without "
            "`feedthrough` and `n_k`."
        )
    if np.any(model.input_delay_):
        raise ValueError(
            "The law u = v - h(s) of this model would need s "
            f"{model.input_delay_.max()} samples ahead, for u arrives late. Fit with "
            "input_delay=0 and more states."
        )


def _rows(name, value, size):
    """Return one sample or one per row."""
    value = np.asarray(value, dtype=float)
    if value.ndim not in (1, 2) or value.shape[-1] != size:
        raise ValueError(
            f"`{name}` must have shape ({size},) or (N, {size}), got {value.shape}. "
            "Time runs down the rows."
        )
    return value

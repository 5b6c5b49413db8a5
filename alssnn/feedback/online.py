"""The linearizing controller as one object: observer, gain, law, limits, anti-windup.

    x_hat from (u, y),  v = controller(r, y, x_hat),  u = v - h(s) within the limits

One sample of `closed_loop`, without a simulation around it: what runs on a computer,
and what exports write.  The parts are those of the loop: both agree to rounding.
"""

from importlib import import_module

import numpy as np

from ..checks import as_numbers, check_type
from ..deferred import deferred
from ..forms import at_once
from ..plants import as_plant
from .checks import check_disturbances, check_measured, check_point
from .controller import from_gain, from_system
from .design import balanced_weights, lqi
from .law import LinearizingLaw
from .observer import Observer
from .run import Controller, LoopStep

GATE = 100.0  # standard deviations of an innovation: noise does not reach it, spikes do


class LinearizingController(Controller):
    """Control a plant sample by sample, by the law and a linear controller.

    An observer estimates the state, a gain with or without integrators or a linear
    system computes v, and the law turns v into the input u, within its limits.
    Integrators of a gain do not wind up. It can be pickled.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    gain : array_like of shape (nv, nx) or (nv, nx + ny) or None, default=None
        Gain on the state, or on states and integrators, as for `closed_loop`. None
        means ``lqi(model, *balanced_weights(model))`` unless `controller` is given.
    controller : control.StateSpace, control.TransferFunction or None, default=None
        Linear controller in place of a gain, as for `closed_loop`.
    observer : Observer, False or None, default=None
        Source of x_hat. None means ``model.observer(gate=100)``, which keeps spikes of
        a sensor small; False leaves it out: then only a simulation with the true
        state is possible. Left out where nothing needs x_hat.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``.
    u_min, u_max : float, array_like of shape (nv,) or None, default=None
        Limits of the actuators, in the units of u, if no `law` is given; None means
        no limit.

    Attributes
    ----------
    model : Plant
        The model.
    own : Plant
        The model, with the past of late inputs as states.
    gain : ndarray or None
        The gain; None with a linear system as the controller.
    linear : LinearController
        What computes v, with the operating point.
    tracks : bool
        Whether the reference is one of y rather than of u.
    needs_state : bool
        Whether law or gain need the state.
    law : LinearizingLaw
        The law.
    observer : Observer or None
        The observer.
    info_ : LoopStep or None
        What happened in the last step.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    TypeError
        If a part is of another type.
    ValueError
        If sizes or sampling times do not fit, both `gain` and `controller` are given,
        or both a law and limits.

    See Also
    --------
    closed_loop : The same loop as a system of python-control.
    alssnn.mpc.LinearizingMPC : The same interface, planned within the limits.
    alssnn.persistence : `to_c`, `to_st`, `to_fmu` and others write it.

    Notes
    -----
    A step costs two evaluations of the model. What is not finite was not measured: the
    estimate is predicted, the law takes the output of the model, integrators wait, and
    references and measured disturbances keep their last value. A measurement beyond
    the gate of the observer counts as one at the gate, in law and integrators alike.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> controller = model.controller(u_min=-2, u_max=2)
    >>> controller.step(0.1, y=[0.0]).shape
    (1,)
    >>> controller.simulate(model, np.full((300, 1), 0.1)).y[-1].round(3)
    array([0.1])
    """

    # what the functions of `persistence` say, without the parts that are here
    to_mat = deferred("persistence", "to_mat")
    to_c = deferred("persistence", "to_c")
    to_casadi = deferred("persistence", "to_casadi")
    to_fmu = deferred("persistence", "to_fmu")
    to_modelica = deferred("persistence", "to_modelica")
    to_simulink = deferred("persistence", "to_simulink")
    to_st = deferred("persistence", "to_st")

    def __init__(
        self,
        model,
        gain=None,
        *,
        controller=None,
        observer=None,
        law=None,
        u_min=None,
        u_max=None,
    ):
        self.model = as_plant(model)
        self.own = own = self.model.late()
        if law is not None and not (u_min is None and u_max is None):
            raise ValueError(
                "`u_min` and `u_max` must be None where `law` is given, which has its "
                "own limits. Give them to `model.linearizing_law`."
            )
        if law is None:
            law = LinearizingLaw(self.model, u_min, u_max)
        check_type("law", law, LinearizingLaw, "Use `model.linearizing_law`.")
        for name, part in (("law", law), ("observer", observer)):
            check_disturbances(name, part, own)
        super().__init__(law)
        if gain is not None and controller is not None:
            raise ValueError(
                "Exactly one of `gain` and `controller` must be given, got both."
            )
        if controller is not None:
            self.gain = None
            self.linear, self.tracks = from_system(controller, own), True
        else:
            if gain is None:
                gain = lqi(model, *balanced_weights(model))
            self.linear, self.tracks = from_gain(gain, own)
            self.gain = np.array(gain, dtype=float)
        nd, by_state = own.nd, law.feedback == "state"
        n_s = own.nx - own.n_late if by_state else own.ny
        sizes = (law.plant.nv + law.n_seen + law.plant.nd, law.plant.nv)
        _check_sizes("law", sizes, (own.nv + n_s + nd, own.nv))
        self.needs_state = self.gain is not None or by_state
        self.observer = self._watch(observer) if self.needs_state else None
        self.reset()

    def __repr__(self):
        """Return its parts in one line."""
        nv, ny = self.own.nv, self.own.ny
        kind = "own linear controller"
        if self.gain is not None:
            kind = "gain with integrators" if self.integrates else "static gain"
        watch = "no observer" if self.observer is None else repr(self.observer)
        return f"LinearizingController({nv} u, {ny} y, {kind}, {watch}, {self.law!r})"

    def _watch(self, observer):
        """Return the observer, checked; None where it is left out."""
        if observer is False:
            return None
        own = self.own
        observer = Observer(own, gate=GATE) if observer is None else observer
        check_type("observer", observer, Observer, "Use `model.observer`.")
        sizes = (observer.plant.nu + observer.plant.ny, observer.plant.nx)
        _check_sizes("observer", sizes, (own.nu + own.ny, own.nx))
        return observer

    @property
    def integrates(self):
        """Return whether a gain has integrators."""
        return self.gain is not None and len(self.linear.A) > 0

    @property
    def at_rest(self):
        """Return the reference at rest and the size of its steps, each (nr,)."""
        if self.tracks:
            return self.own.y_offset, self.own.y_scale
        return self.own.v_offset, self.own.v_scale

    def reset(self, x0=None):
        """Start anew: forget estimate, integrators, references and measurements.

        Parameters
        ----------
        x0 : array_like of shape (nx,) or None, default=None
            Estimate before the first measurement, past values of late inputs behind
            the states; None means the operating point.

        Raises
        ------
        ValueError
            If `x0` has the wrong size.
        """
        own = self.own
        x0 = check_point("x0", x0, own.nx)
        self._z = np.zeros(len(self.linear.A))
        self._r, self._d, self._u = self.at_rest[0], own.d_offset, own.v_offset
        self._x = x0 if self.observer is None else self.observer.initial_state(x0)
        self._y, self._last = own.y_offset, None
        self.info_ = None

    def step(self, reference, y, u_applied=None, d=None):
        """Return the input for a new measurement.

        Parameters
        ----------
        reference : array_like of shape (nr,)
            Reference, in the units of y, or in those of u for a static gain; a number
            if there is one. What is nan or infinite is that of the sample before, at
            first the operating point.
        y : array_like of shape (ny,)
            New measurement; what is nan or infinite was not measured.
        u_applied : array_like of shape (nv,) or None, default=None
            Input that the plant received since the last measurement; None, or a value
            that is nan or infinite, means what the last step returned.
        d : array_like of shape (nd,) or None, default=None
            Measured disturbances of this sample, in the order of the record; needed if
            the model has any. What is nan or infinite is that of the sample before.

        Returns
        -------
        u : ndarray of shape (nv,)
            Input for the plant, within its limits.

        Raises
        ------
        ValueError
            If a size is wrong, or the state is needed and there is no observer, or none
            that is in time: y depends on u of the same sample.
        """
        own = self.own
        self._check_runs()
        r = _given("reference", reference, self._r)
        y = check_measured(y, own.ny)
        now = own.check_disturbances(None) if d is None else _given("d", d, self._d)
        if u_applied is not None:
            self._u = _given("u_applied", u_applied, self._u)
        x_hat, seen, expected = self._estimate(y)
        measured = np.isfinite(seen)
        filled = np.where(measured, seen, expected)
        of_y = np.where(measured, seen, r) if self.integrates else filled
        signals = [r, of_y]
        if self.gain is not None:
            signals.append(x_hat)
        none = [np.zeros(own.nv)] if self.integrates else []
        v = self.linear.output(0.0, self._z, np.concatenate([*signals, *none]), {})
        s = x_hat[: self.law.n_seen] if self.law.feedback == "state" else filled
        u, cut = np.split(
            self.law.output_and_cut(0.0, None, np.concatenate([v, s, now]), {}), 2
        )
        signals += [cut] if self.integrates else []
        self._z = self.linear.update(0.0, self._z, np.concatenate(signals), {})
        saturated = (u <= self.law.u_min) | (u >= self.law.u_max)
        self.info_ = LoopStep(u, v, cut, saturated, x_hat)
        self._r, self._d, self._u, self._y = r, now, u, filled
        self._last = y
        return u.copy()

    def certificate(self, amplitude=None, *, noise=None, error=None, search=True):
        """Certify the loop of this controller around its own model (eq. local).

        Parameters
        ----------
        amplitude : float, array_like of shape (nr,) or None, default=None
            Largest modulus of every reference around the operating point, in its
            units. None takes what keeps the design within the training record, or
            half of it, a quarter and so on, until region and gain are proved.
        noise : float, array_like of shape (ny,) or None, default=None
            Largest modulus of the noise of every sensor, in the units of y. None
            takes three standard deviations of what the fit leaves, relative to the
            output, on average over the outputs.
        error : ErrorGain, float, array_like of shape (ny, nv) or None, default=None
            Largest l2 gain from u to what the plant adds to the output of the model,
            see `certificates.error_gain`; None takes the model for the plant.
        search : bool, default=True
            Whether the worst input is looked for.

        Returns
        -------
        certificate : LoopCertificate
            The certificate; one that does not hold says why.

        Raises
        ------
        ValueError
            If an argument has the wrong shape, or the loop is none that can be
            certified.
        """
        certificates = import_module("alssnn.certificates")  # by name: beside this
        options = {"noise": noise, "error": error, "search": search}
        return certificates.certify_loop(self, amplitude, **options)

    def _estimate(self, y):
        """Return x_hat, y as far as it is believed, and what to expect in its place."""
        observer, own = self.observer, self.own
        if observer is None:
            return np.empty(0), y, self._y
        if self._last is not None:  # the input of the last sample is known only now
            sent = own.every_input(self._u, self._d if own.nd else None)
            signals = np.concatenate([sent, self._last])
            self._x = observer.update(0.0, self._x, signals, {})
        signals = np.concatenate([own.u_offset, y])
        x_hat = observer.output(0.0, self._x, signals, {})
        return x_hat, observer.believed(self._x, signals), own.output(x_hat)

    def _check_runs(self):
        """Refuse to run where the state is not known in time."""
        if not self.needs_state:
            return
        if self.observer is None:
            raise ValueError(
                "`observer` must not be False for a controller that runs by itself, "
                "which needs the state. Leave it out for the default one."
            )
        if not self.own.has_linear_output:
            raise ValueError(
                "`model` must have a y that does not depend on inputs of the same "
                f"sample, got one through {at_once(self.own.form, self.own.moved)}: "
                "the estimated state would wait for them. Fit without `feedthrough` "
                "and `n_k`."
            )


def _check_sizes(name, sizes, expected):
    """Refuse a part of a model of other sizes."""
    if sizes != expected:
        raise ValueError(
            f"`{name}` must have as many inputs and outputs as the model asks for, "
            f"{expected}, got {sizes}. Make it from the same model."
        )


def _given(name, value, last):
    """Return a signal; what is not finite is the last one."""
    value = np.atleast_1d(as_numbers(name, value))
    value = check_point(name, value, len(last), missing=True)
    return np.where(np.isnan(value), last, value)

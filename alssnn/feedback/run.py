"""Controllers that run sample by sample, and what they did along a simulation.

All of them have one interface: `step` takes a reference and a measurement and returns
the input, `reset` starts anew, `simulate` runs the loop with a plant, and `plot` draws
such a run.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from ..shown import short_repr
from .checks import check_point, check_signal
from .export import check_plant
from .law import LinearizingLaw

N_SAMPLES = 200  # of a step response that is drawn without further words


@dataclass(frozen=True, eq=False)
class LoopStep:
    """Hold what a controller did at one sample.

    Parameters
    ----------
    u : ndarray of shape (nv,)
        Input for the plant, in the units of u.
    v : ndarray of shape (nv,)
        Input of the linear system that the controller asked for, in the units of u.
    cut : ndarray of shape (nv,)
        What the limits cut off v.
    saturated : ndarray of bool of shape (nv,)
        Whether a limit is reached.
    x_hat : ndarray of shape (nx,)
        Estimated state; empty without an observer.
    """

    __repr__ = short_repr

    u: np.ndarray
    v: np.ndarray
    cut: np.ndarray
    saturated: np.ndarray
    x_hat: np.ndarray


@dataclass(frozen=True, eq=False)
class LoopRecord:
    """Hold a closed loop of plant and controller, one row per sample.

    The fields of `LoopStep` are attributes, too, stacked over all samples.

    Parameters
    ----------
    t : ndarray of shape (N,)
        Time, in seconds.
    y : ndarray of shape (N, ny)
        Measured outputs, noise included.
    u : ndarray of shape (N, nv)
        Inputs that the controller asks for.
    d : ndarray of shape (N, nd)
        Measured disturbances, in the units of u.
    reference : ndarray of shape (N, nr)
        References, in the units of y; of a static gain in those of u.
    steps : list of LoopStep
        What happened at every sample.
    law : LinearizingLaw
        The law, which knows limits and names of the signals.
    tracks : bool, default=True
        Whether references are those of y, not of u.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> run = model.controller(u_max=1.0).simulate(model, np.full((20, 1), 0.1))
    >>> run
    closed loop, 20 samples, saturated 0.0%
    >>> run.y.shape, run.x_hat.shape
    ((20, 1), (20, 4))
    """

    t: np.ndarray
    y: np.ndarray
    u: np.ndarray
    d: np.ndarray
    reference: np.ndarray
    steps: list
    law: LinearizingLaw
    tracks: bool = True

    of_step: ClassVar[Any] = LoopStep

    def __getattr__(self, name):
        """Return a field of the steps of all samples, stacked."""
        if name not in self.of_step.__dataclass_fields__:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        return np.array([getattr(step, name) for step in self.steps])

    def __repr__(self):
        """Return how long it was, and how often a limit was reached."""
        share = np.mean(self.saturated.any(axis=1))
        return f"closed loop, {len(self.t)} samples, saturated {share:.1%}"

    def plot(self, ax=None, **kwargs):
        """Draw outputs with their references, and inputs with their limits.

        Parameters
        ----------
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output, then one per input that is moved; None makes a figure.
        **kwargs : dict
            Options of the curves of y and u.

        Returns
        -------
        display : RunDisplay
            The display of :mod:`alssnn.plotting`, drawn.
        """
        # by name: figures lie above what is drawn, and matplotlib loads when asked for
        return import_module("alssnn.plotting").RunDisplay(self).plot(ax, **kwargs)


class Controller(ABC):
    """Share what all controllers that run sample by sample can do.

    Parameters
    ----------
    law : LinearizingLaw
        Law behind the controller, with its limits.

    Attributes
    ----------
    law : LinearizingLaw
        The law.
    info_ : LoopStep or None
        What happened in the last step.
    """

    info_: Any = None
    tracks = True  # references of y
    horizon = 0  # samples that are planned
    record_type: ClassVar[type[LoopRecord]] = LoopRecord

    def __init__(self, law):
        self.law = law

    @abstractmethod
    def step(self, reference, y, u_applied=None, d=None):
        """Return the input for a new measurement.

        Parameters
        ----------
        reference : array_like of shape (nr,)
            Reference.
        y : array_like of shape (ny,)
            Measurement.
        u_applied : array_like of shape (nv,) or None, default=None
            Input that the plant received since the last measurement.
        d : array_like of shape (nd,) or None, default=None
            Measured disturbances.
        """

    @abstractmethod
    def reset(self, x0=None):
        """Start anew.

        Parameters
        ----------
        x0 : array_like of shape (nx,) or None, default=None
            State before the first measurement; None means the operating point.
        """

    @property
    def at_rest(self):
        """Return the reference at rest and the size of its steps, each (nr,)."""
        plant = self.law.plant
        return plant.y_offset, plant.y_scale

    def simulate(
        self,
        plant,
        reference,
        *,
        x0=None,
        input_disturbance=None,
        output_noise=None,
        d=None,
        preview=False,
    ):
        """Control a plant from a reset on, and return what happened.

        Parameters
        ----------
        plant : estimator or system of python-control
            What is controlled, from u to y in the units of the user: a fitted model or
            any discrete-time system.
        reference : array_like of shape (N, nr) or (N,)
            Reference of every sample.
        x0 : array_like of shape (n_states,) or None, default=None
            Initial state of the plant, which the controller does not know; None means
            zero.
        input_disturbance : array_like of shape (N, nv) or None, default=None
            Added to u behind the controller, in the units of u.
        output_noise : array_like of shape (N, ny) or None, default=None
            Added to the measured output.
        d : array_like of shape (N, nd) or None, default=None
            Measured disturbances, in the units of u; None means the operating point.
        preview : bool, default=False
            Whether a predictive controller knows the reference, and measured
            disturbances, of the next samples; else it takes the present ones to last.
            Other controllers have no plan.

        Returns
        -------
        record : LoopRecord
            Signals and reports of all steps; of a predictive controller an
            `alssnn.mpc.MpcRecord`.

        Raises
        ------
        TypeError
            If `plant` is neither a model nor a system.
        ValueError
            If sizes or sampling times do not fit, the plant is continuous in time, a
            value is not finite, or `preview` is asked of a controller without a plan.

        Notes
        -----
        The output is measured before the input moves: where it depends on u at once,
        it is that of the last u, at first of the operating point. There is no
        algebraic loop.
        """
        own, ahead = self.law.plant, self.horizon if preview else 0
        if preview and not ahead:
            raise ValueError(
                "`preview` must be False for a controller that plans nothing, got "
                f"{preview!r}. Use `model.mpc`."
            )
        plant = check_plant(plant, own)
        reference = check_signal("reference", reference, None, len(self.at_rest[0]))
        n = len(reference)
        push = check_signal("input_disturbance", input_disturbance, n, own.nv)
        noise = check_signal("output_noise", output_noise, n, own.ny)
        x = check_point("x0", x0, plant.nstates)
        if d is not None and np.size(d) and not own.nd:
            raise ValueError(
                "`d` must be None for a model without measured disturbances, got "
                f"{type(d).__name__}. Leave it out."
            )
        if d is None or not own.nd:
            d = np.tile(own.d_offset, (n, 1))
        d = check_signal("d", d, n, own.nd)
        self.reset()
        t, u, steps = own.dt * np.arange(n), np.zeros((n, own.nv)), []
        y = np.zeros((n, own.ny))
        held = own.v_offset  # until this sample's input is known
        for k in range(n):
            y[k] = plant.output(t[k], x, own.every_input(held, d[k])) + noise[k]
            known, measured = reference[k], d[k]
            if ahead:
                window = np.minimum(np.arange(k + 1, k + 1 + ahead), n - 1)
                known, measured = reference[window], d[np.maximum(window - 1, k)]
            u[k] = self.step(known, y[k], d=measured if own.nd else None)
            steps.append(self.info_)
            held = u[k] + push[k]
            x = np.asarray(plant.dynamics(t[k], x, own.every_input(held, d[k])))
        return self.record_type(t, y, u, d, reference, steps, self.law, self.tracks)

    def plot(self, plant=None, reference=None, *, ax=None, **kwargs):
        """Simulate a step of the reference and draw it.

        Parameters
        ----------
        plant : estimator, system of python-control or None, default=None
            What is controlled, as for `simulate`; None means the model itself.
        reference : array_like of shape (N, nr), (N,) or None, default=None
            Reference of every sample; None means 200 samples of a step of all
            references by one standard deviation of the training data.
        ax : sequence of matplotlib.axes.Axes or None, default=None
            One axes per output, then one per input that is moved; None makes a figure.
        **kwargs : dict
            Options of the curves of y and u.

        Returns
        -------
        display : RunDisplay
            The display, drawn; its `record` holds the signals.
        """
        plant = self.law.plant if plant is None else plant
        if reference is None:
            at_rest, size = self.at_rest
            reference = np.tile(at_rest + size, (N_SAMPLES, 1))
            reference[: N_SAMPLES // 20] = at_rest
        return self.simulate(plant, reference).plot(ax, **kwargs)

"""What an export holds besides the equations of a plant: law, observer and gain."""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..checks import check_type
from ..forms import at_once
from ..lure import Lure
from ..plant import Plant
from ..plants import as_plant
from ..walk import static_map

BETWEEN = {"cubic": "a cubic spline", "linear": "straight lines"}  # by `hold`


@dataclass(frozen=True, eq=False)
class Export:
    """Hold a plant and what closes its loop.

    Parameters
    ----------
    plant : Plant
        The model.
    law : LinearizingLaw or None
        Law; None if it is ill-posed.
    no_law : str
        Why there is no law.
    observer : Observer or None
        Observer of `late`, with constant gain; None without one.
    K_x, K_z : ndarray or None
        Gains of states and integrators; None without a controller.
    """

    plant: Plant
    law: Any
    no_law: str
    observer: Any
    K_x: Any
    K_z: Any

    @property
    def M(self):
        """Return the gain of the observer, (nx + sum(delay), ny); None without one."""
        return None if self.observer is None else self.observer.gain

    @property
    def gate(self):
        """Return the largest innovations, (ny,), units of y; None without a gate."""
        return None if self.observer is None else self.observer.largest_innovation

    @property
    def integrates(self):
        """Return whether the controller has integrators."""
        return self.K_z is not None and self.K_z.size > 0

    @property
    def between(self):
        """Return what inputs did between the samples of the record; empty if held."""
        # what is exported holds them, as all that controls does
        rates = self.plant.rates
        return "" if rates is None else BETWEEN.get(rates.structure.sampling.hold, "")

    @property
    def went_on(self):
        """Return what is held, and what was not, in words; empty if u always was."""
        if not self.between:
            return ""
        return f"u is held for a sample; in the record it went on as {self.between}"

    @property
    def held(self):
        """Return what u does between samples, in words."""
        return self.went_on or "u is held for a sample"

    @cached_property
    def late(self):
        """Return the plant with the past of late inputs as states."""
        return self.plant.late()

    @cached_property
    def h(self):
        """Return what the law takes off v, as a static map of what it sees, [s; d]."""
        form, nv = self.plant.solved_map.form, self.plant.nv
        return static_map(form, slice(0, nv), form.nu - nv)

    @cached_property
    def middle(self):
        """Return s of a law that looks ahead, as a static map of [x; d; v]."""
        assert self.plant.middle is not None  # asked for where the law looks ahead
        matrix = self.plant.middle.matrix  # (eq. middle)
        return Lure(np.pad(matrix, [(0, 0), (0, 1)]), 0, matrix.shape[1], 0)

    @cached_property
    def back(self):
        """Return what takes the part cut off v out of integrators; None without any."""
        from ..feedback.controller import back_calculation

        return back_calculation(self.K_z) if self.integrates else None

    @classmethod
    def of(cls, model, law=None, observer=None, gain=None):
        """Return the export of a fitted model.

        Parameters
        ----------
        model : estimator, Plant or LinearizingController
            Fitted model, or its `plant_`; or a controller, which has all the rest.
        law : LinearizingLaw or None, default=None
            Law, for example with limits; None takes ``model.linearizing_law()``, or
            leaves it out where it is ill-posed.
        observer : Observer, None or False, default=None
            Observer with constant gain; None takes ``model.observer(gate=100)``, False
            leaves it out.
        gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
            Gain of a controller, as for `feedback.closed_loop`.

        Returns
        -------
        export : Export
            The export.

        Raises
        ------
        NotFittedError
            If the model is not fitted.
        TypeError
            If `law` or `observer` is of another type.
        ValueError
            If a controller comes with other parts or has no gain, sizes do not fit,
            the observer has no constant gain, or a gain lacks its law or observer.
        """
        from ..feedback import LinearizingController, split_gain

        if isinstance(model, LinearizingController):
            if any(part is not None for part in (law, observer, gain)):
                raise ValueError(
                    "`law`, `observer` and `gain` must be None beside a controller, "
                    "which has its own. Make another controller."
                )
            if model.gain is None:
                raise ValueError(
                    "`model` must be a controller with a gain for an export, got one "
                    "with a linear system. Use `lqr`, `place` or `lqi`."
                )
            law, gain = model.law, model.gain
            observer = False if model.observer is None else model.observer
            model = law.plant
        plant = as_plant(model)
        law, no_law = _law(plant, law, required=gain is not None)
        K_x, K_z = (None, None) if gain is None else split_gain(gain, plant.late())
        observer = _observer(plant.late(), observer)
        if gain is not None and observer is None:
            raise ValueError(
                "`observer` must not be False with a `gain`, which acts on the "
                "estimated state. Leave it out for the default one."
            )
        if gain is not None and not plant.has_linear_output:
            raise ValueError(
                "`gain` must be None for a model whose y depends on inputs of the same "
                f"sample, through {at_once(plant.form, plant.moved)}: the estimated "
                "state would wait for them. Fit without `feedthrough` and `n_k`."
            )
        return cls(plant, law, no_law, observer, K_x, K_z)

    def controller(self):
        """Return what is exported as a controller in Python.

        Returns
        -------
        controller : LinearizingController
            The controller, at its start.
        """
        from ..feedback import LinearizingController

        gain = np.hstack([self.K_x, self.K_z])
        parts = {"law": self.law, "observer": self.observer}
        return LinearizingController(self.plant, gain, **parts)


@contextmanager
def extra(name, others):
    """Say what to do without a package that is imported in this context.

    Parameters
    ----------
    name : str
        Name of the package, and of the extra that installs it.
    others : str
        Methods that write a model without it.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    try:
        yield
    except ImportError as error:
        raise ImportError(
            f"`to_{name}` needs the package {name}, which could not be imported. "
            f'Install it by pip install "alssnn[{name}]", or write the model by '
            f"{others}."
        ) from error


def _law(plant, law, required):
    """Return the law, or None and why there is none."""
    from ..feedback import LinearizingLaw

    if law is None:
        if plant.no_law and not required:
            return None, plant.no_law
        return LinearizingLaw(plant), ""
    check_type("law", law, LinearizingLaw, "Use `model.linearizing_law`.")
    if _numbers(law.plant) != _numbers(plant):
        raise ValueError(
            "`law` must be one of this model, got one of another model. Use "
            "`model.linearizing_law`."
        )
    return law, ""


def _numbers(plant):
    """Return what tells the laws of plants apart, limits left out."""
    return plant.feedback, plant.y_offset.tolist(), plant.law_form.Theta.tolist()


def _observer(late, observer):
    """Return the observer, checked; None where it is left out."""
    from ..feedback import Observer
    from ..feedback.online import GATE

    if observer is False:
        return None
    observer = Observer(late, gate=GATE) if observer is None else observer
    if not isinstance(observer, Observer):
        raise TypeError(
            f"`observer` must be an Observer, None or False, got "
            f"{type(observer).__name__}. Use `model.observer`."
        )
    if observer.kind != "kalman":
        raise ValueError(
            f"`observer` must have a constant gain, kind='kalman', got "
            f"{observer.kind!r}. Use `model.observer`."
        )
    if not np.array_equal(observer.plant.form.Theta, late.form.Theta):
        raise ValueError(
            "`observer` must estimate the states of this model alone, got one of "
            "another model, or of a disturbance. Use `model.observer`."
        )
    return observer

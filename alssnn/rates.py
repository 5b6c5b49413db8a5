"""Equations in continuous time as a plant keeps them, for any sampling time."""

from dataclasses import dataclass, replace

import numpy as np

from . import forms
from .checks import sampling_time
from .continuous import derivative, held, is_resolved, leading
from .shown import short_repr
from .structures import Structure
from .virtual import NEEDS_OLD_D, Middle

COARSE = 0.02  # relative error of a pole that a plant may have
MOST = 40  # steps of Runge and Kutta in a sample
WHOLE = 1e-6  # share of a sample by which a delay may miss a multiple of it


@dataclass(frozen=True, eq=False)
class Rates:
    """Hold a structure of derivatives with its parameters.

    Parameters
    ----------
    structure : Structure
        Structure that was sampled (`continuous.sampled`).
    theta : ndarray of shape (n_params,)
        Its parameters, time in samples of `dt`.
    units : dict of str to ndarray
        The user's units over those of theta, by axis.
    """

    __repr__ = short_repr

    structure: Structure
    theta: np.ndarray
    units: dict

    def forms(self, dt):
        """Return the forms of a plant that is sampled at some time, inputs held.

        Parameters
        ----------
        dt : float
            Sampling time, in seconds.

        Returns
        -------
        forms : dict
            `form` and `law_form` of a `Plant`.

        Raises
        ------
        ValueError
            If `dt` is so long that its steps could not be counted.
        """
        ratio, p = dt / self.structure.sampling.dt, self.structure.split(self.theta)
        p = {**p, **{name: ratio * p[name] for name in leading(self.structure)}}
        # as many steps as the fit took in this time, and as poles need
        substeps = max(1, round(self.structure.sampling.substeps * ratio + 0.5 - WHOLE))
        while substeps <= MOST and not is_resolved(p["A"], substeps, COARSE):
            substeps += 1
        if substeps > MOST:
            raise ValueError(
                f"`dt` must be shorter for this model, got {dt:g} s, which takes more "
                f"than {MOST} steps of Runge and Kutta. Step the plant several times, "
                "or fit it to a record of that sampling time."
            )
        view = held(self.structure, substeps)
        made = forms.of_structure(view, view.join(p), self.units)
        return {name: made[name] for name in ("form", "law_form")}


def resampled(plant, dt, ahead):
    """Return a plant at another sampling time.

    Parameters
    ----------
    plant : Plant
        The plant.
    dt : float
        Sampling time, in seconds.
    ahead : bool
        Whether the law sees the middle of the coming sample.

    Returns
    -------
    plant : Plant
        The same equations, sampled at this time.

    Raises
    ------
    ValueError
        As of `Plant.at`.
    """
    dt = sampling_time(dt)
    if dt == plant.dt and ahead == plant.looks_ahead:
        return plant
    if plant.rates is None:
        raise ValueError(
            f"`dt` and `ahead` must stay {plant.dt:g} s and {plant.looks_ahead}: the "
            "plant was changed, or its time is discrete. Take time='continuous'."
        )
    delay = _as_samples(plant.delay * plant.dt, dt)
    looks = ahead and plant.cancels
    plant = replace(plant, **plant.rates.forms(dt), dt=dt, delay=delay)
    return replace(plant, **_looking_ahead(plant)) if looks else plant


def kept(structure, theta, units):
    """Return what a plant keeps of equations in continuous time.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    theta : ndarray of shape (n_params,)
        Its parameters.
    units : dict of str to ndarray
        The user's units over those of theta, by axis.

    Returns
    -------
    rates : Rates or None
        None if time is discrete.
    """
    if derivative(structure) is structure:
        return None
    return Rates(structure, theta, units)


def _looking_ahead(plant):
    """Return what is new of a plant whose law looks ahead, by name (eq. middle)."""
    if plant.no_law:
        raise ValueError(plant.no_law)
    half = replace(plant, **plant.rates.forms(plant.dt / 2)).arrived()
    A, B, C, _ = half.linear()
    seen = np.hstack([A, half.disturbed_by()[0], B])
    if plant.feedback == "output":
        if not plant.has_linear_output:
            raise ValueError(
                "A law that looks ahead needs an output that is linear in the state, "
                f"got one with {forms.at_once(plant.form, plant.moved)}. Fit with "
                "feedback='state', or without `feedthrough` and `n_k`."
            )
        seen = C @ seen
    late = plant.delay[list(plant.given)]
    if np.any(seen[:, plant.nx : plant.nx + plant.nd][:, late > 0]):
        raise ValueError(NEEDS_OLD_D.format(late.max()))
    form, law = forms.ahead(plant.form, plant.law_form, seen, plant.moved)
    changes = {"form": form, "law_form": law, "feedback": "state", "rates": None}
    return {**changes, "middle": Middle(seen, plant.law_form)}


def _as_samples(delay, dt):
    """Return delays in samples of a sampling time, or refuse others than multiples."""
    samples = np.round(delay / dt)
    if np.any(np.abs(delay / dt - samples) > WHOLE):
        raise ValueError(
            f"`dt` must divide the delays of the inputs, {delay.tolist()} s, got "
            f"{dt!r}. Take a part of them."
        )
    return samples.astype(int)

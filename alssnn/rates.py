"""Equations in continuous time as a plant keeps them, for any sampling time."""

from dataclasses import dataclass

import numpy as np

from . import forms
from .continuous import FASTEST, derivative, held, leading
from .structures import Structure

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
    dt : float
        Sampling time of theta, in seconds.
    """

    structure: Structure
    theta: np.ndarray
    units: dict
    dt: float

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
            If `dt` is no positive number.
        """
        if not (np.isfinite(dt) and dt > 0):
            raise ValueError(f"`dt` must be a positive time in seconds, got {dt!r}.")
        ratio, p = dt / self.dt, self.structure.split(self.theta)
        p = {**p, **{name: ratio * p[name] for name in leading(self.structure)}}
        # as many steps as the fit took in this time, and as poles need to be stable
        fastest = np.abs(np.linalg.eigvals(p["A"])).max(initial=0.0)
        wanted = max(self.structure.sampling.substeps * ratio, fastest / FASTEST)
        substeps = max(1, int(np.ceil(wanted * (1.0 - WHOLE))))
        view = held(self.structure, substeps)
        made = forms.of_structure(view, view.join(p), self.units)
        return {name: made[name] for name in ("form", "law_form")}


def as_samples(delay, dt):
    """Return delays in samples of a sampling time.

    Parameters
    ----------
    delay : ndarray of shape (nu,)
        Delays, in seconds.
    dt : float
        Sampling time, in seconds.

    Returns
    -------
    delay : ndarray of int of shape (nu,)
        The same in samples.

    Raises
    ------
    ValueError
        If they are no multiples of `dt`.
    """
    samples = np.round(delay / dt)
    if np.any(np.abs(delay / dt - samples) > WHOLE):
        raise ValueError(
            f"`dt` must divide the delays of the inputs, {delay.tolist()} s, got "
            f"{dt!r}. Take a part of them."
        )
    return samples.astype(int)


def kept(structure, theta, units, dt):
    """Return what a plant keeps of equations in continuous time.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    theta : ndarray of shape (n_params,)
        Its parameters.
    units : dict of str to ndarray
        The user's units over those of theta, by axis.
    dt : float
        Sampling time, in seconds.

    Returns
    -------
    rates : Rates or None
        None if time is discrete.
    """
    if derivative(structure) is structure:
        return None
    return Rates(structure, theta, units, dt)

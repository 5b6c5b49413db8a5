"""Observers along a record whose inputs go on between its samples.

In a loop a computer holds u, and so does the plant of a model in continuous time.  A
model that was fitted with another `hold` says more of its record: f_r(x, u, nodes),
where the nodes are what u does between the samples.  Along a record an observer then
predicts by

    x+ = f(x, u) + f_r(x, u, nodes) - f_h(x, u),

where f is its own plant, which may have a disturbance or late inputs as further states,
and f_h the model whose inputs are held.  Every u has the scaled u and its nodes behind
it, as further columns.
"""

from copy import copy

import numpy as np

from ..continuous import held, with_nodes
from ..simulation import regressors


class RecordedPlant:
    """Let the inputs of a plant go on between the samples of a record.

    All that is not said here is as in the plant, with the inputs of the record alone.

    Parameters
    ----------
    plant : Plant
        Plant of an observer of `model`.
    model : estimator
        Fitted model in continuous time.
    """

    def __init__(self, plant, model):
        fit = model.fitted_
        self._plant, self._n = plant, plant.nu
        self._size = np.broadcast_to(fit.x_scale, model.nx_)
        self._forms = tuple(
            structure.lure(fit.theta)
            for structure in (fit.structure, held(fit.structure))
        )
        self.nu = plant.nu + self._forms[0].nu

    def __getattr__(self, name):
        """Return what the plant has."""
        if name.startswith("__") or name == "_plant":  # while it is copied
            raise AttributeError(name)
        return getattr(self._plant, name)

    def step(self, x, u):
        """Return the next state.

        Parameters
        ----------
        x : ndarray of shape (n,) or (N, n)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu)
            Input, with what it does until the next sample.

        Returns
        -------
        x_next : ndarray of shape (n,) or (N, n)
            State one sample later.
        """
        x_next = self._plant.step(x, u[..., : self._n])
        nx, z = len(self._size), np.atleast_2d(u[..., self._n :])
        own = np.atleast_2d(x)[:, :nx] / self._size
        goes_on, stays = (
            regressors(form, own, z[:, : form.nu]) @ form.rows_x.T
            for form in self._forms
        )
        x_next[..., :nx] += ((goes_on - stays) * self._size).reshape(*x.shape[:-1], nx)
        return x_next

    def output(self, x, u=None):
        """Return the output.

        Parameters
        ----------
        x : ndarray of shape (n,) or (N, n)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu) or None, default=None
            Input of the same sample, as in `step`.

        Returns
        -------
        y : ndarray of shape (ny,) or (N, ny)
            Output, in the user's units.
        """
        return self._plant.output(x, None if u is None else u[..., : self._n])

    def jacobian(self, x, u):
        """Return the derivatives of the plant, of inputs that are held.

        Parameters
        ----------
        x : ndarray of shape (n,) or (N, n)
            State, or one per row.
        u : ndarray of shape (nu,) or (N, nu)
            Input, as in `step`.

        Returns
        -------
        A, B, C, D : ndarray
            Derivatives.
        """
        return self._plant.jacobian(x, u[..., : self._n])


def along_records(observer, model):
    """Return an observer for the records of a model, and what makes its inputs.

    Parameters
    ----------
    observer : Observer
        Observer of the model.
    model : estimator
        Fitted model.

    Returns
    -------
    observer : Observer
        The same one where inputs are held; else one with a `RecordedPlant`.
    inputs : callable
        Returns the inputs of `observer` for those of an experiment, of shape (N, nu).
    """
    fit = model.fitted_
    structure = fit.structure
    if structure.sampling is None or structure.sampling.hold == "zoh":
        return observer, np.asarray
    observer = copy(observer)
    observer.plant = RecordedPlant(observer.plant, model)

    def inputs(u):
        scaled = fit.scaling.scale_u(u, model.input_delay_)
        ((z, _),) = with_nodes(structure, [(scaled, None)])
        return np.hstack([u, z])

    return observer, inputs

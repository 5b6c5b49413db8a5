"""A fitted model as a plant, and how linear it is."""

import numpy as np

from ..continuous import held
from ..forms import of_structure
from ..linearizability import measure
from ..names import signal_names
from ..plant import Plant
from ..rates import kept


def linearizability(model, u, y, experiment=None, *, law_dt=None, ahead=False):
    """Measure how linear the model is once h is cancelled.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs; they set the initial states and the size of the output.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    law_dt : float or None, default=None
        Sampling time at which the law will run, in seconds: a part or a multiple of
        that of the record, for a model in continuous time. None is that of the record.
    ahead : bool, default=False
        Whether the law looks half a sample ahead (eq. middle), for a model in
        continuous time.

    Returns
    -------
    record : Linearizability
        The output-referred linearization error (eq. gauge), in all and in
        frequency bands, the paper's ratios, both of the model and of the closed
        loop u = v - h with the recorded input as v, the gains of A, and the share
        of samples outside the region of the training data. It prints as a table.

    Notes
    -----
    The initial state of every experiment is estimated from its first
    `n_init_samples` samples (at most a quarter of it), which are measured as well.
    Costs four simulations.
    """
    records = model.prepare_records(u, y, experiment)
    return measure(
        model.plant_,
        records,
        output_names=model.output_names_,
        law_dt=law_dt,
        ahead=ahead,
    )


def make_plant(model):
    """Return the plant of a fitted model, in continuous time with inputs that are held.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    plant : Plant
        The model as an immutable value.
    """
    structure, theta, units = model._structure, model._theta, model._units()
    scaling, nx, nu = model._scaling, model.nx_, model.n_features_in_
    return Plant(
        **of_structure(held(structure), theta, units),
        u_offset=scaling.u_offset,
        y_offset=scaling.y_offset,
        u_scale=scaling.u_scale,
        y_scale=scaling.y_scale,
        x_scale=np.broadcast_to(model._x_scale, nx),
        dt=sampling_time(model),
        inputs=signal_names(getattr(model, "feature_names_in_", None), "u", nu),
        outputs=signal_names(model.output_names_, "y", len(model.C_)),
        name=type(model).__name__,
        delay=model.input_delay_,
        noise=model.cost_,
        noise_covariance=model.noise_covariance_,
        region=getattr(model, "_region", None),
        rates=kept(structure, theta, units),
    )


def sampling_time(model):
    """Return the sampling time of a fitted model, in seconds.

    Parameters
    ----------
    model : estimator
        Fitted model.

    Returns
    -------
    dt : float
        In continuous time that of the record, whatever became of the option since.
    """
    sampling = model._structure.sampling
    return float(model.dt if sampling is None else sampling.dt)

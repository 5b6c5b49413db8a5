"""A fitted model as a plant, and how linear it is."""

from dataclasses import replace

import numpy as np

from ..continuous import held
from ..forms import of_structure
from ..linearizability import LOOP_OUTSIDE, at_rate, measure
from ..names import signal_names
from ..plant import Plant
from ..rates import kept


def linearizability(
    model,
    u,
    y,
    experiment=None,
    *,
    law_dt=None,
    ahead=False,
    controller=None,
    reference=None,
    d=None,
    in_loop=True,
):
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
    controller : LinearizingController or None, default=None
        Controller of the loop in which the plant is compared with its design
        (`carried`), with a gain, and limits if there are any. None takes
        ``model.controller()``, or a gain on the states alone where there are more
        outputs than inputs.
    reference : array_like of shape (N, nr) or None, default=None
        Reference of this loop, which is at rest at its first sample before; None takes
        eight random steps within one standard deviation of the training data.
    d : array_like of shape (N, nd) or None, default=None
        Measured disturbances of this loop; None takes those of the record.
    in_loop : bool, default=True
        Whether this loop is simulated; it costs more than all the rest.

    Returns
    -------
    record : Linearizability
        The output-referred linearization error (eq. gauge), in all and in
        frequency bands, the paper's ratios, both of the model and of the closed
        loop u = v - h with the recorded input as v, the gains of A, and the share
        of samples outside the region of the training data; and how far the plant
        will be from its design in the loop of a controller (eq. carried). It prints
        as a table.

    Raises
    ------
    TypeError
        If `controller` is none.
    ValueError
        If a controller, reference or disturbance does not fit, or the sampling times
        do not.

    Notes
    -----
    The initial state of every experiment is estimated from its first
    `n_init_samples` samples (at most a quarter of it), which are measured as well.
    Costs four simulations, and unless `in_loop` is False a regression of the residual
    and 18 simulations of the loop, side by side. Records of more than 20,000 samples
    are regressed up to there.
    """
    records = model.prepare_records(u, y, experiment)
    options = {"law_dt": law_dt, "ahead": ahead}
    found = measure(model.plant_, records, output_names=model.output_names_, **options)
    if not in_loop:
        return found
    given = {"controller": controller, "reference": reference, "d": d}
    return replace(found, **_carried(model.plant_, records, **options, **given))


def _carried(plant, records, law_dt, ahead, **given):
    """Return how far the plant may be from its design, as fields of the report."""
    from ..feedback import design_distance

    of_record = plant.dt
    if law_dt is not None or ahead or plant.rates is not None:
        plant, records = at_rate(plant, records, law_dt or of_record, ahead)
    problem = plant.no_law
    if plant.dt > of_record:
        problem = (
            "How far the plant is from its design is not known for a law that is "
            "slower than the record: what happens between its samples is no error of "
            "the model."
        )
    if problem:
        return {"carried_problem": problem}
    try:
        loop = design_distance(plant, records, **given)
    except ValueError as error:
        if any(z is not None for z in given.values()):
            raise
        return {"carried_problem": f"No controller could be tried. {error}"}
    hidden = loop.outside is not None and loop.outside > LOOP_OUTSIDE
    return {
        "carried": np.full_like(loop.distance, np.nan) if hidden else loop.distance,
        "carried_low": loop.low,
        "carried_high": loop.high,
        "carried_model": loop.by_model,
        "carried_missed": loop.by_missed,
        "carried_noise": loop.by_noise,
        "carried_outside": loop.outside,
    }


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
        hidden_error=_hidden_error(model),
        noise_covariance=model.noise_covariance_,
        region=getattr(model, "_region", None),
        rates=kept(structure, theta, units),
    )


def _hidden_error(model):
    """Return the error of the fits of a model on hidden samples, None without any."""
    # networks that were tried and left tell nothing of the linear model
    is_linear = np.isinf(getattr(model, "alpha_", 0.0))
    kind = "networks" if "networks" in model.orders_ and not is_linear else "linear"
    return model.orders_.get(kind, {}).get(model.nx_)


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

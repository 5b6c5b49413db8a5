"""How a plant follows a reference, beside what was designed on a model of it.

Three responses to one reference: that of the linear loop of the design, that of the
plant in the loop with law, observer and gain, and that of the plant without feedback,
if the input is sent to it that the model gets in its own loop.  The second one is as
close to the first as the model is right about the loop; the third one says what
feedback adds.
"""

import control
import numpy as np

from ..plants import as_plant
from .export import check_plant
from .loop import closed_loop, designed_loop


def tracking_comparison(plant, model, gain, r, *, law=None, observer=None):
    """Return responses to a reference: designed, in the loop, and without feedback.

    Parameters
    ----------
    plant : estimator, Plant or system of python-control
        What is controlled, as for `closed_loop`, such as the true plant of a simulated
        record. It starts at its own state zero.
    model : estimator or Plant
        Fitted model, or its `plant_`, that the gain was designed on.
    gain : array_like of shape (nv, nx + ny)
        Gain with integrators, of `lqi`.
    r : array_like of shape (N,) or (N, ny)
        References of the outputs, in their units; time runs down the rows.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``.
    observer : Observer or None, default=None
        Source of the state, as for `closed_loop`.

    Returns
    -------
    responses : dict of str to control.TimeResponseData
        "design" with the outputs and v, "loop" with the outputs, v and u, and "open
        loop", the plant under the u of the model in its own loop, with the outputs; in
        the user's units, nan where a response diverges.
        Measured disturbances stay at the operating point. `plotting.LoopDisplay` draws
        them.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If `r` has another number of columns than there are outputs, or the gain has
        the wrong shape.

    See Also
    --------
    step_comparison : The model itself as the plant.

    Notes
    -----
    The design starts at the operating point. A plant that rests elsewhere at its state
    zero begins with a transient in the loop that the design does not have; fit with
    ``operating_point="zero"`` where the plant rests at zero.

    Examples
    --------
    >>> from alssnn.feedback import balanced_weights, lqi, tracking_comparison
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> gain = lqi(model, *balanced_weights(model))
    >>> responses = tracking_comparison(record.plant, model, gain, np.full(300, 0.1))
    >>> angle = responses["loop"].outputs[0]
    >>> bool(abs(angle[-1] - 0.1) < 1e-3)
    True
    """
    own = as_plant(model)
    ny, nv = own.ny, own.nv
    gain, r = np.asarray(gain, dtype=float), np.asarray(r, dtype=float)
    if gain.shape[1:] != (own.late().nx + ny,):
        raise ValueError(
            f"`gain` must have {own.late().nx + ny} columns, integrators among them, "
            f"got shape {gain.shape}. Take it from `lqi`."
        )
    references = r[:, None] if r.ndim == 1 else r
    if references.shape[1:] != (ny,) or not np.isfinite(references).all():
        raise ValueError(
            f"`r` must be finite with one column per output ({ny}), got shape "
            f"{r.shape}. Let time run down the rows."
        )
    designed = designed_loop(model, gain)
    loop = closed_loop(plant, model, gain, law=law, observer=observer)
    pair = references.T, references.T - own.y_offset[:, None]
    t, inputs, found = compared(own, designed, loop, *pair)
    with np.errstate(all="ignore"):
        planned = _outputs(closed_loop(model, model, gain, law=law), t, inputs)
        sent = np.empty((own.nu, len(r)))
        sent[list(own.moved)] = planned[ny : ny + nv]
        sent[list(own.given)] = inputs[ny:]
        alone = _outputs(check_plant(plant, own), t, sent)
    found["open loop"] = alone[:ny], found["design"][1][:ny]
    return as_responses(t, found)


def compared(own, designed, loop, reference, deviation):
    """Return time, inputs of a loop, and signals of design and loop with their names.

    Parameters
    ----------
    own : Plant
        Plant that the loop was designed for.
    designed, loop : InputOutputSystem
        The loops.
    reference, deviation : ndarray of shape (ny, N)
        References, and their deviations from the operating point.

    Returns
    -------
    t, inputs : ndarray
        Time, and references over disturbances at rest.
    found : dict
        Signals and names of "design" and "loop".
    """
    t, splits = own.dt * np.arange(reference.shape[1]), [own.ny, own.ny + own.nv]
    at_rest = np.repeat(own.d_offset[:, None], len(t), axis=1)
    rest = np.concatenate([own.y_offset, own.v_offset])[:, None]
    inputs = np.vstack([reference, at_rest])
    with np.errstate(all="ignore"):
        driven = np.vstack([deviation, 0 * at_rest])
        design = control.forced_response(designed, t, driven, squeeze=False).outputs
        y, u, v = np.split(_outputs(loop, t, inputs), splits)
    names = list(designed.output_labels)
    design = np.reshape(design, (-1, len(t))) + rest
    whole = np.vstack([y, v, u]), names + loop.output_labels[slice(*splits)]
    return t, inputs, {"design": (design, names), "loop": whole}


def as_responses(t, found):
    """Return responses of python-control; what is not finite is nan.

    Parameters
    ----------
    t : ndarray of shape (N,)
        Time.
    found : dict
        Signals and names.

    Returns
    -------
    responses : dict
        The same as `control.TimeResponseData`.
    """
    return {
        name: control.TimeResponseData(
            t, np.where(np.isfinite(z), z, np.nan), output_labels=names, issiso=False
        )
        for name, (z, names) in found.items()
    }


def _outputs(system, t, inputs):
    """Return the outputs of a system that starts at zero, (n_outputs, N)."""
    response = control.input_output_response(system, t, inputs, squeeze=False)
    return np.reshape(response.outputs, (-1, len(t)))

"""How the model under its law follows the design on (A, B, C).

`step_comparison` puts the step response that was designed beside that of the whole
model: the gap is what the law does not cancel.  With it comes u, what the actuators
have to do: they do not see v, and under a law with a large h it is far from u.
`input_range` of `law` says what they did in the training data; outside of it the model
is a guess.
"""

import numpy as np

from ..checks import is_count
from ..plants import as_plant
from .loop import closed_loop, designed_loop
from .tracking import as_responses, compared

SETTLED = 0.01  # share of the slowest mode that is left at the end of a response
MIN_SAMPLES, MAX_SAMPLES = 40, 5000


def step_comparison(model, gain, *, step=None, n_samples=None, law=None, observer=None):
    """Return the step response that was designed, and that of the model under its law.

    Both start at the operating point, where measured disturbances stay; the references
    of all outputs step at once.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    gain : array_like of shape (nu, nx + ny)
        Gain with integrators, of `lqi`.
    step : float, array_like of shape (ny,) or None, default=None
        Height of the step, in the units of y; None means one standard deviation of
        the training data.
    n_samples : int or None, default=None
        Length of the response; None waits for the slowest mode of the design, 40 to
        5000 samples.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``.
    observer : Observer or None, default=None
        Source of the state; None takes the true state of the model.

    Returns
    -------
    responses : dict of str to control.TimeResponseData
        Responses "design" and "model", each of the outputs and v (names of
        `designed_loop`), that of the model then of u, the real input (names of
        `closed_loop`), in the user's units with the operating point; nan where the
        loop diverges. `plotting.LoopDisplay` draws them.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If an argument has the wrong size, or the law is ill-posed.

    See Also
    --------
    input_range : What u was in the training data.
    """
    gain = np.asarray(gain, dtype=float)
    designed = designed_loop(model, gain)
    loop = closed_loop(model, model, gain, law=law, observer=observer)
    plant = as_plant(model)
    ny = plant.ny
    if gain.shape[1] == plant.late().nx:
        raise ValueError(
            "`gain` must have columns for integrators, got shape "
            f"{gain.shape}. Take it from `lqi`."
        )
    step = plant.y_scale if step is None else np.asarray(step, dtype=float)
    if step.shape not in [(), (ny,)] or not np.isfinite(step).all():
        raise ValueError(
            f"`step` must be one finite number per output ({ny}), got {step}. Give "
            "heights in the units of y."
        )
    if n_samples is None:
        radius = float(np.abs(designed.poles()).max())
        slow = np.log(SETTLED) / np.log(radius) if 0 < radius < 1 else MAX_SAMPLES
        n_samples = int(np.clip(np.ceil(slow), MIN_SAMPLES, MAX_SAMPLES))
    if not is_count(n_samples, 2):
        raise ValueError(
            f"`n_samples` must be at least 2 and an integer, got {n_samples!r}. Use "
            "None to wait for the slowest mode."
        )
    r = np.repeat(np.broadcast_to(step, ny)[:, None], int(n_samples), axis=1)
    pair = r + plant.y_offset[:, None], r
    t, _, found = compared(plant, designed, loop, *pair)
    return as_responses(t, {"design": found["design"], "model": found["loop"]})

"""How far ahead a model sees: fit of k-step predictions against k.

The observer of the model gives x_hat_k from y up to sample k, and what drifts where the
model was fitted with a `drift`; from there the model runs free over the next samples.
One step ahead nearly every model looks good, because the last value is a good guess
already: so that guess stands beside it.
"""

from dataclasses import dataclass

import numpy as np

from ..experiments import last_measured
from ..metrics import free_run_errors
from ..plants import as_plant
from ..shown import short_repr

OBSERVED = 20_000  # samples on which predictions are compared: the observer is slow


@dataclass(frozen=True, eq=False)
class AheadFit:
    """Hold the fit of predictions over several horizons.

    Parameters
    ----------
    horizons : ndarray of int of shape (n,)
        Numbers of samples predicted ahead.
    fit : ndarray of shape (n, ny)
        Fit of the predictions, in percent; -inf where they diverge.
    last_value : ndarray of shape (n, ny)
        Fit of the last measured value as the prediction.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.validation import ahead_fit
    >>> ahead = ahead_fit(model, *record, horizons=(1, 5))
    >>> ahead.horizons, ahead.last_value.shape
    (array([1, 5]), (2, 1))
    """

    __repr__ = short_repr

    horizons: np.ndarray
    fit: np.ndarray
    last_value: np.ndarray


def ahead_fit(model, u, y, experiment=None, *, horizons=(1, 2, 5, 10, 20, 50)):
    """Measure the fit of k-step predictions.

    Parameters
    ----------
    model : estimator
        Fitted model.
    u : array_like of shape (N, nu)
        Inputs.
    y : array_like of shape (N,) or (N, ny)
        Outputs; nan where not measured.
    experiment : array_like of shape (N,) or None, default=None
        Label of the experiment of every sample.
    horizons : sequence of int, default=(1, 2, 5, 10, 20, 50)
        Numbers of samples to predict; those that exceed a quarter of the longest
        experiment are left out.

    Returns
    -------
    ahead : AheadFit
        Fit per horizon and output, over the first 20,000 samples of the record.

    Raises
    ------
    ValueError
        If `horizons` is empty, not of positive integers or too long for the record, or
        the model has no stable observer.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.validation import ahead_fit
    >>> ahead = ahead_fit(model, *record, horizons=(1, 10))
    >>> bool(ahead.fit[0, 0] > ahead.fit[1, 0])
    True
    """
    wanted = np.asarray(horizons)
    numbers = np.issubdtype(wanted.dtype, np.number) and wanted.ndim == 1
    if not (numbers and len(wanted) and np.all((wanted >= 1) & (wanted % 1 == 0))):
        raise ValueError(
            f"`horizons` must be positive integers, got {horizons}. They count samples."
        )
    from ..feedback import DisturbanceObserver, Observer  # imports take a second
    from ..feedback.recorded import along_records

    # what drifts is a part of the predictions
    kind = Observer if as_plant(model).drift is None else DisturbanceObserver
    observer, inputs = along_records(kind(model), model)
    experiments = _first(model, u, y, experiment)
    steps = np.unique(wanted.astype(int))
    steps = steps[steps <= max(len(y) for _, y, _ in experiments) // 4]
    if not len(steps):
        raise ValueError(
            f"`horizons` must fit into a quarter of the longest experiment, got "
            f"{horizons}. Take shorter ones."
        )
    found: dict[int, list] = {int(step): [] for step in steps}
    for u_k, y_k, x0 in experiments:
        u_k, x0 = inputs(u_k), np.pad(x0, (0, len(observer.Q) - len(x0)))
        X = observer.filter(u_k, y_k, x0)
        past = last_measured(y_k)
        for step in range(1, min(steps[-1], len(y_k) - 1) + 1):
            X = observer.plant.step(X[: len(y_k) - step], u_k[step - 1 : -1])
            if step in found:
                y_hat = observer.plant.output(X, u_k[step:])
                found[step].append((y_k[step:], y_hat, past[: len(y_k) - step]))
    fits = []
    for parts in found.values():
        y_true, *guesses = (np.vstack(z) for z in zip(*parts, strict=True))
        fits.append([free_run_errors(y_true, guess)[1] for guess in guesses])
    fit, last_value = np.swapaxes(fits, 0, 1)
    return AheadFit(steps, fit, last_value)


def _first(model, u, y, experiment):
    """Return (u, y, x0) of the first samples of all experiments together."""
    # the observer delays late inputs itself; before the first sample they rested
    out, left = [], OBSERVED
    for record in model.prepare_records(u, y, experiment):
        if left <= 0:
            break
        out.append((record.u[:left], record.y[:left], record.x0))
        left -= len(record.y)
    return out

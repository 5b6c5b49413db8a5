"""Samples that a user hides from a training, to judge it."""

import numpy as np

from ..training import Validation
from ._noise import training_data
from ._periodic import is_periodic
from ._simulation import labeled_data

MIN_VALIDATION = 8  # samples: two for an initial state, six that count


def hold_out(estimator, u, y, parts, validation):
    """Return scaled experiments to fit, and what judges the fit by others.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    u : array of shape (N, nu)
        Inputs.
    y : array of shape (N,) or (N, ny)
        Outputs.
    parts : list of slice
        Samples of every experiment.
    validation : tuple of array_like or None
        Records that the user holds out.

    Returns
    -------
    experiments : list of tuple of array
        Scaled experiments to fit.
    judge : Validation or None
        Judge; None if nothing is held out.

    Raises
    ------
    ValueError
        If what is held out is too short, or not measured.
    """
    experiments = estimator._experiments(u, y, parts, is_periodic(estimator))
    if validation is not None:
        return experiments, _judge(estimator, _given(estimator, validation))
    if estimator.validation_fraction is None:
        return experiments, None
    cuts = [
        len(u) - int(estimator.validation_fraction * len(u)) for u, _ in experiments
    ]
    # slices of the whole: what comes late at the tail was sent before it
    tails = [(u[c:], y[c:]) for (u, y), c in zip(experiments, cuts, strict=True)]
    parts = [slice(p.start, p.start + c) for p, c in zip(parts, cuts, strict=True)]
    return estimator._experiments(u, y, parts), _judge(estimator, tails)


def _given(estimator, validation):
    """Return the scaled experiments that the user holds out."""
    if not isinstance(validation, tuple | list) or len(validation) not in (2, 3):
        raise ValueError(
            "`validation` must be a tuple (u, y) or (u, y, experiment), got "
            f"{type(validation).__name__}."
        )
    u_v, y_v, *labels = validation
    label = labels[0] if labels else None
    u_v, y_v, parts, _ = labeled_data(estimator, u_v, y_v, label)
    return estimator._experiments(u_v, y_v, parts)


def _judge(estimator, experiments):
    """Return what judges the training by scaled experiments held out of it."""
    experiments = training_data(estimator, experiments)
    shortest = min(len(u) for u, _ in experiments)
    if shortest < MIN_VALIDATION:
        raise ValueError(
            f"Validation needs at least {MIN_VALIDATION} samples of every "
            f"experiment, got {shortest}. Increase `validation_fraction`, or pass "
            "longer records as `validation`."
        )
    ny = experiments[0][1].shape[1]
    validation = Validation(
        experiments,
        estimator._output_weight(ny),
        estimator.n_init_samples,
        estimator.n_iter_no_change,
    )
    if all(np.isnan(y[:]).all() for _, y in validation.scored):
        raise ValueError(
            "Validation needs measured outputs behind the samples that estimate "
            "the initial states, got none. Pass other records as `validation`."
        )
    return validation

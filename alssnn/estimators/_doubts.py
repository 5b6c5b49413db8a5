"""What a record says against how it was given: its sampling time, its two sides."""

import numpy as np

from ..containers import index_of
from ..warn import warn_user
from ._warn import warn_of_training

SAME = 0.01  # relative: of sampling times that count as one
GAP = 0.5  # of a step, by which another one may differ: below, stamps are not exact
POOR = 0.5  # R2 of the training record, below which a model says little
TELLING = 0.75  # R2 of u from the past of y, above which that says more
LAGS = 30  # samples of that past
PER_LAG = 10  # samples that are needed, at least, per unknown
MOST = 20_000  # samples that are looked at


def warn_of_time(u, dt, experiment=None, *, fitted=False):
    """Warn where the index of a data frame has another sampling time, or a gap.

    Parameters
    ----------
    u : object
        Inputs as they came; only an index of pandas with dates or durations says
        anything.
    dt : float
        Sampling time of the estimator, in seconds.
    experiment : array_like of shape (N,) or None, default=None
        Labels; the steps between two experiments say nothing.
    fitted : bool, default=False
        Whether it is fitted already, so that its sampling time stays.
    """
    index = index_of(u)
    kind = getattr(getattr(index, "dtype", None), "kind", "")
    if index is None or kind not in ("m", "M") or len(index) < 2:
        return
    steps = (np.diff(np.asarray(index)) / np.timedelta64(1, "s")).astype(float)
    inside = np.ones(len(steps), dtype=bool)
    if experiment is not None and len(experiment) == len(index):
        labels = np.asarray(experiment)
        inside = labels[1:] == labels[:-1]
    if not inside.any():
        return
    step = float(np.median(steps[inside]))
    if step > 0 and abs(step - dt) > SAME * step:
        remedy = "Resample the record, or fit" if fitted else "Fit"
        warn_user(
            f"The index of `u` has steps of {step:g} s, and `dt` is {dt:g} s: times "
            f"and frequencies are wrong by this factor. {remedy} with dt={step:g}.",
            UserWarning,
        )
    # a date that is not there is none either
    far = inside & ~(np.abs(steps - step) <= GAP * abs(step))
    if far.any():
        first = int(np.argmax(far))
        more = f", and {far.sum() - 1} more like it" if far.sum() > 1 else ""
        warn_user(
            f"The index of `u` has a step of {steps[first]:g} s behind row {first}"
            f"{more}, where others are {step:g} s. Rows count as samples that follow "
            "each other: give every uninterrupted run a label in `experiment`, or "
            "resample the record.",
            UserWarning,
        )


def warn_if_exchanged(estimator, u, y, parts):
    """Warn of a poor model where y tells u better than the model tells y.

    Parameters
    ----------
    estimator : StateSpaceModel
        Fitted estimator.
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N, ny)
        Outputs.
    parts : sequence of slice
        Experiments.
    """
    if not estimator.train_score_ < POOR or not isinstance(u, np.ndarray):
        return
    part = max(parts, key=lambda part: part.stop - part.start)
    u, y = u[part][:MOST], y[part][:MOST]
    unknowns = LAGS * y.shape[1]
    if len(y) < LAGS + PER_LAG * unknowns or not np.isfinite(y).all():
        return
    du, dy = u - u.mean(axis=0), y - y.mean(axis=0)
    past = np.hstack([dy[LAGS - k : -k] for k in range(1, LAGS + 1)])
    now = du[LAGS:]
    now = now[:, np.ptp(now, axis=0) > 0]  # at rest, it tells nothing
    if not now.shape[1]:
        return
    missed = now - past @ np.linalg.lstsq(past, now)[0]
    told = 1 - np.mean(np.mean(missed**2, axis=0) / np.mean(now**2, axis=0))
    if told > TELLING:
        warn_of_training(
            f"The model explains {100 * max(estimator.train_score_, 0.0):.0f} % of "
            f"the variance of `y`, while the past of `y` explains {100 * told:.0f} % "
            "of that of `u`. If `y` was sent and `u` was measured, exchange them. Else "
            "the model is too small, or a controller made `u` from `y`."
        )

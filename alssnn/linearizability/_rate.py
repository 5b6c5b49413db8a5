"""Records at the sampling time of the law, where that is not the record's."""

from dataclasses import dataclass

import numpy as np

from ..continuous import between
from ..simulation import channels, simulate

WHOLE = 1e-6  # relative: by which a ratio of sampling times may miss a whole number


@dataclass(frozen=True, eq=False)
class Resampled:
    """Hold deviations of one experiment at another sampling time.

    Parameters
    ----------
    du : ndarray of shape (N, nu)
        Inputs that have arrived.
    dy : ndarray of shape (N, ny)
        Outputs; nan where they are not known.
    x0 : ndarray of shape (nx,)
        State at the first sample.
    """

    du: np.ndarray
    dy: np.ndarray
    x0: np.ndarray


def at_rate(plant, records, law_dt, ahead):
    """Return a plant and its records at the sampling time of the law.

    Parameters
    ----------
    plant : Plant
        Plant in continuous time.
    records : sequence of PreparedRecord
        Experiments at the sampling time of the plant.
    law_dt : float
        Sampling time of the law, in seconds.
    ahead : bool
        Whether the law looks ahead (`Plant.at`).

    Returns
    -------
    plant : Plant
        The plant at this time.
    records : list of Resampled
        Faster ones have the inputs that the model was fitted for between the samples,
        and what the model says of y plus what it misses at the samples, along straight
        lines. Slower ones have the means of the inputs; their y is that of the model.

    Raises
    ------
    ValueError
        If the times are no multiples of each other, or time is discrete.
    """
    ahead = ahead and not plant.no_law
    target = plant.at(law_dt, ahead=ahead)
    parts, samples = round(plant.dt / target.dt), round(target.dt / plant.dt)
    ratio = max(parts, samples)
    if abs(max(plant.dt / target.dt, target.dt / plant.dt) - ratio) > WHOLE * ratio:
        raise ValueError(
            "`law_dt` must be a part or a multiple of the sampling time of the record, "
            f"{plant.dt:g} s, got {target.dt:g} s."
        )
    hold = "zoh" if plant.rates is None else plant.rates.structure.sampling.hold
    if ratio == 1 and hold == "zoh":
        return target, list(records)
    if samples > 1:
        if (shortest := min(len(record.du) for record in records)) < samples:
            raise ValueError(
                f"`law_dt` must be shorter than every experiment, got {target.dt:g} s "
                f"for one of {shortest * plant.dt:g} s."
            )
        return target, [_slower(record, samples, plant.ny) for record in records]
    finer = plant.at(law_dt).arrived()
    return target, [_faster(record, parts, hold, finer) for record in records]


def _slower(record, samples, ny):
    """Return a record of longer samples: means of u, and no y."""
    n = len(record.du) // samples
    du = record.du[: n * samples].reshape(n, samples, -1).mean(axis=1)
    return Resampled(du, np.full((n, ny), np.nan), record.x0)


def _faster(record, parts, hold, plant):
    """Return a record of shorter samples."""
    du = record.du
    N, ny = len(du), plant.ny
    if hold == "zoh":
        inside = np.repeat(du, parts, axis=0)
    else:  # what is held for a part is its middle
        inside = between(du, hold, parts).reshape(N * parts, 2, -1)[:, 0]
    X = simulate(plant.lure, inside, record.x0, plant.x_scale)[:-1]
    y = channels(plant.lure, X, inside)[:, :ny]
    missed = record.dy - y[::parts]
    at = np.arange(N * parts) / parts
    # nan beside nan: a line has two ends
    lines = [np.interp(at, np.arange(N), missed[:, i]) for i in range(ny)]
    return Resampled(inside, y + np.column_stack(lines), record.x0)

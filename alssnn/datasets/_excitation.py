"""Steps of random height and length, the excitation that most plants share."""

import numpy as np

from ._checks import _check_numbers


def _check_hold(hold, dt):
    """Return shortest and longest hold in samples."""
    remedy = "Give the shortest and the longest time between two steps in seconds."
    shortest, longest = (
        round(time / dt) for time in _check_numbers("hold", hold, 2, remedy)
    )
    if not 1 <= shortest <= longest:
        raise ValueError(
            f"`hold` must be an increasing pair of at least one sample of {dt} s, "
            f"got {hold!r}. {remedy}"
        )
    return shortest, longest


def _stairs(n_samples, hold, rng):
    """Draw levels in (-1, 1), each held for hold[0] to hold[1] samples."""
    levels, holds, n_drawn = [], [], 0
    # One by one, level before duration: a longer record continues a shorter one.
    while n_drawn < n_samples:
        levels.append(rng.uniform(-1, 1))
        holds.append(rng.randint(hold[0], hold[1] + 1))
        n_drawn += holds[-1]
    return np.repeat(levels, holds)[:n_samples]


def _check_range(name, values, remedy):
    """Return lowest and highest level of a signal that must not be negative."""
    low, high = _check_numbers(name, values, 2, remedy)
    if not 0 <= low < high:
        raise ValueError(
            f"`{name}` must be an increasing pair of at least 0.0, got {values!r}. "
            f"{remedy}"
        )
    return low, high


def _levels(n_samples, ranges, holds, rng):
    """Draw independent stairs, a column for every pair in `ranges` and in `holds`."""
    # A generator for each, so that longer columns still continue shorter ones.
    seeds = rng.randint(2**31 - 1, size=len(ranges))
    columns = []
    for seed, (low, high), hold in zip(seeds, ranges, holds, strict=True):
        stairs = _stairs(n_samples, hold, np.random.RandomState(seed))
        columns.append(low + (high - low) * (stairs + 1) / 2)
    return np.column_stack(columns)

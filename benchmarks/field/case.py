"""A case: the records that a model is fitted to, and those that it is tested on."""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

SPLITS = ("seen", "unseen", "later", "latest", "newest", "independent", "real")
NOISE = 0.01  # of simulated cases, relative to the output


class Data(NamedTuple):
    """Hold experiments (u, y), of shape (N, nu) and (N, ny), and their sampling."""

    train: list  # experiments
    tests: dict  # name -> experiments
    dt: float


@dataclass(frozen=True)
class Case:
    """Name a set of records, what they are, and what is known about them.

    A case travels to other processes, which load its records themselves.
    Choices are made on "seen" plants alone; "unseen" ones and real records tell what
    they are worth. "later" ones came behind the first rules, and "latest" ones
    behind nearly all: with a look at them, one was chosen (`excursions.OPENED`).
    "independent" ones are by others who did not write the package. With a look at two
    of them, "mould" and "tanker", rules for plants that integrate were chosen.
    """

    name: str
    kind: str
    load: Callable  # () -> Data, the same in every call
    split: str  # one of SPLITS
    unit: str = "-"
    scale: float = 1.0  # of y in the table: rmse in `unit`
    n_init: int = 50  # first samples of a test, for its initial state, not scored
    published: dict = field(default_factory=dict)  # source -> error by test
    big: bool = False  # runs only if it is asked for by name


def simulated(name, kind, run, *, split, unit="-", scale=1.0, **options):
    """Return a case from a plant ``run(rng, N) -> (u, y)`` without noise."""
    return Case(name, kind, partial(fresh, name, run, **options), split, unit, scale)


def floor(case):
    """Return the noise of a simulated case, in its unit; nan of measured ones."""
    if getattr(case.load, "func", None) is not fresh:
        return np.nan
    y = np.vstack([columns(y) for _, y in case.load().train])
    return (
        case.scale
        * case.load.keywords.get("noise", NOISE)
        * np.nanstd(y, axis=0).mean()
    )


def fresh(name, run, N=2_000, N_test=None, dt=1.0, noise=NOISE, color=0.0, runs=1):
    """Return records of a plant: a new input, state and noise for the test.

    `noise` is relative to the training output, of shape AR(1) with the pole `color`.
    The generator follows from the name of the case: its data never change.
    """
    streams = np.random.SeedSequence(zlib.crc32(name.encode())).spawn(runs + 1)
    lengths = [N] * runs + [N_test or N]
    parts = [
        (rng, *run(rng, n))
        for rng, n in zip(map(np.random.default_rng, streams), lengths, strict=True)
    ]
    level = noise * np.vstack([columns(y) for _, _, y in parts[:-1]]).std(axis=0)
    parts = [
        (columns(u), columns(y) + level * ar1(rng, columns(y).shape, color))
        for rng, u, y in parts
    ]
    return Data(parts[:-1], {"fresh": parts[-1:]}, dt)


def ar1(rng, shape, pole):
    """Return noise of unit variance, white for a pole at zero."""
    from scipy.signal import lfilter

    e = rng.standard_normal(shape)
    e[0] /= np.sqrt(1 - pole**2)  # stationary from the first sample on
    return np.sqrt(1 - pole**2) * lfilter([1], [1, -pole], e, axis=0)


def columns(z):
    """Return a signal with two dimensions."""
    return np.asarray(z, dtype=float).reshape(len(z), -1)

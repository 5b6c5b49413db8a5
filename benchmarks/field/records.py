"""The measured records of the field benchmark, by name, and what others published.

Splits are those of the benchmarks where there are any; else the first half trains and
the second half tests. The outputs are what was measured, the drives without their sign.
"""

from functools import partial

from alssnn.datasets import (
    fetch_cascaded_tanks,
    fetch_classics,
    fetch_coupled_drives,
    fetch_fine_steering_mirror,
    fetch_silverbox,
    fetch_wiener_hammerstein,
)
from benchmarks.recordings import RECORDINGS, drone_command

from .case import Case, Data

# -- benchmarks ------------------------------------------------------------------------


def circuit(split):
    """Return the Wiener-Hammerstein circuit."""
    train, test = fetch_wiener_hammerstein(split=split)
    return Data([tuple(train)], {"test": [tuple(test)]}, train.dt)


def silverbox():
    """Return the Silverbox."""
    train, tests = fetch_silverbox()
    return Data([tuple(train)], {k: [tuple(v)] for k, v in tests.items()}, train.dt)


def tanks():
    """Return the cascaded tanks."""
    train, test = fetch_cascaded_tanks()
    return Data([tuple(train)], {"validation": [tuple(test)]}, train.dt)


def drives():
    """Return the drives: the absolute speed, as measured."""
    train, test = fetch_coupled_drives()
    tests = {f"experiment {i}": [tuple(r)] for i, r in enumerate(test, start=1)}
    return Data(list(map(tuple, train)), tests, train[0].dt)


def drone():
    """Return the arm with a propeller, its command as input."""
    train, tests = drone_command()
    tests = {k: [tuple(v)] for k, v in tests.items()}
    return Data(list(map(tuple, train)), tests, train[0].dt)


def mirror():
    """Return the mirror at all levels; tests by level."""
    train, tests = fetch_fine_steering_mirror()
    tests = {name: list(map(tuple, test)) for name, test in tests.items()}
    return Data(list(map(tuple, train)), tests, train[0].dt)


def classic(name):
    """Return both halves of a classic record."""
    train, test = fetch_classics()[name].split(0.5)
    return Data([tuple(train)], {"second half": [tuple(test)]}, train.dt)


# -- all -------------------------------------------------------------------------------


def _published(tests, table):
    """Return errors by test from rows (source, errors)."""
    return {source: dict(zip(tests, values, strict=True)) for source, values in table}


def _real(name, kind, load, unit, scale=1.0, **options):
    return Case(name, kind, load, "real", unit, scale, **options)


WH = (
    ("LTI", (43.4,)),
    ("GRU", (3.97,)),
    ("LSTM", (4.45,)),
    ("GP-NARX", (23.1,)),
    ("SUBNET", (0.241,)),
)
TANKS = (("best quoted black box", (0.33,)), ("best quoted grey box", (0.18,)))
MIRROR_TESTS = ("100 mV", "200 mV", "300 mV")
MIRROR = (
    ("LTI, nx=28", (0.252, 0.179, 0.658)),
    ("LTI, nx=28, one per level", (0.114, 0.216, 0.228)),
    ("freq-statespace, nx=28", (0.0866, 0.131, 0.169)),
)

RECORDS = {
    case.name: case
    for case in (
        _real(
            "wh official",
            "Wiener-Hammerstein circuit",
            partial(circuit, "official"),
            "mV",
            1e3,
            published=_published(["test"], WH),
        ),
        _real(
            "wh paper",
            "Wiener-Hammerstein circuit",
            partial(circuit, "paper"),
            "mV",
            1e3,
        ),
        _real(
            "silverbox",
            "electronic Duffing oscillator",
            silverbox,
            "mV",
            1e3,
            published=RECORDINGS["Silverbox"].published,
        ),
        _real(
            "tanks",
            "cascaded tanks",
            tanks,
            "V",
            published=RECORDINGS["tanks"].published | _published(["validation"], TANKS),
        ),
        _real(
            "drives",
            "two motors and a belt, absolute speed",
            drives,
            "ticks/s",
            n_init=10,
            published=RECORDINGS["drives"].published,
        ),
        _real("drone", "arm with a propeller", drone, "deg"),
        _real(
            "mirror",
            "fine steering mirror, 3 x 3",
            mirror,
            "um",
            1e6,
            n_init=100,
            published=_published(MIRROR_TESTS, MIRROR),
            big=True,
        ),
        *(
            _real(name, "classic", partial(classic, name), "-")
            for name in ("actuator", "ball and beam", "dryer", "flutter", "gas furnace")
        ),
        _real("tank pair", "classic, 1 x 2", partial(classic, "two tanks"), "-"),
    )
}

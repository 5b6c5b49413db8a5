"""The measured records of the field benchmark, by name, and what others published.

Splits are those of the benchmarks where there are any; else the first half trains and
the second half tests. The outputs are what was measured, the drives without their sign.
"""

from functools import partial

import numpy as np

from alssnn.datasets import (
    fetch_cascaded_tanks,
    fetch_coupled_drives,
    fetch_silverbox,
    fetch_wiener_hammerstein,
)
from alssnn.datasets._files import _find_file
from benchmarks.recordings import RECORDINGS, drone_command

from .case import Case, Data, columns

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


# -- fine steering mirror --------------------------------------------------------------

MIRROR_LEVELS = (100, 200, 300)  # mV
MIRROR_RATE = 6_400  # Hz


def mirror():
    """Return the mirror at all levels; tests by level, a period an experiment each.

    The two periods of a training experiment are one record of their mean: the plant is
    in steady state.
    """
    (u, y), (u_test, y_test) = mirror_arrays("train"), mirror_arrays("test")
    u, y = u.mean(axis=4), y.mean(axis=4)
    train = [
        (u[level, ..., r], y[level, ..., r])
        for level in range(len(u))
        for r in range(u.shape[3])
    ]
    tests = {
        f"{name} mV": [
            (u_test[level, ..., r, p], y_test[level, ..., r, p])
            for r in range(u_test.shape[3])
            for p in range(u_test.shape[4])
        ]
        for level, name in enumerate(MIRROR_LEVELS)
    }
    return Data(train, tests, 1 / MIRROR_RATE)


def mirror_arrays(part):
    """Return u and y of shape (levels, samples, channels, realizations, periods)."""
    folder = "fine_steering_mirror"
    names = [[f"{z}_{level}mV_{part}.npy" for level in MIRROR_LEVELS] for z in "uy"]
    return [np.stack([np.load(_find_file(None, folder, f)) for f in n]) for n in names]


# -- classics --------------------------------------------------------------------------


def classic(filename, dt, **options):
    """Return both halves of a classic record."""
    path = _find_file(None, "classics", filename)
    if path.suffix == ".mat":
        from scipy.io import loadmat

        content = loadmat(path)
        u, y = (columns(_upright(content[name])) for name in options["names"])
    else:
        rows = {"delimiter": ",", "skiprows": 1} if path.suffix == ".csv" else {}
        u, y = map(columns, np.loadtxt(path, **rows).T)
    half = len(u) // 2
    return Data([(u[:half], y[:half])], {"second half": [(u[half:], y[half:])]}, dt)


def _upright(z):
    return z.T if z.shape[0] < z.shape[1] else z


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
            published=_published([f"{v} mV" for v in MIRROR_LEVELS], MIRROR),
            big=True,
        ),
        _real(
            "actuator",
            "hydraulic crane",
            partial(classic, "actuator.mat", 1.0, names=("u", "p")),
            "-",
        ),
        _real("ball and beam", "beam", partial(classic, "ballbeam.dat", 0.1), "-"),
        _real("dryer", "hair dryer", partial(classic, "dryer.dat", 0.08), "-"),
        _real("flutter", "wing", partial(classic, "flutter.dat", 1.0), "-"),
        _real("gas furnace", "CO2", partial(classic, "gas_furnace.csv", 9.0), "-"),
        _real(
            "tank pair",
            "two tanks, 1 x 2",
            partial(classic, "tank.mat", 0.2, names=("u", "y")),
            "-",
        ),
    )
}

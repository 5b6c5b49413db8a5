"""Six short measured records that everybody knows."""

import numpy as np

from ._files import _check_length, _find_file, _must
from ._record import Record

CLASSICS_SOURCE = "the collection of Z. Dai et al."
CLASSICS = {  # name: file, number of samples, sampling time in s, variables of a .mat
    "actuator": ("actuator.mat", 1_024, 1.0, ("u", "p")),
    "ball and beam": ("ballbeam.dat", 1_000, 0.1, ()),
    "dryer": ("dryer.dat", 1_000, 0.08, ()),
    "flutter": ("flutter.dat", 1_024, 1.0, ()),
    "gas furnace": ("gas_furnace.csv", 296, 9.0, ()),
    "two tanks": ("tank.mat", 2_500, 0.2, ("u", "y")),
}


def fetch_classics(data_home=None):
    """Load six short records of the literature.

    Parameters
    ----------
    data_home : str or path-like, default=None
        Folder that holds ``classics`` with its files, or the folder of the files. By
        default the environment variable ``ALSSNN_DATA_HOME``, else ``~/alssnn_data``.

    Returns
    -------
    records : dict of str to Record
        "actuator": valve opening and oil pressure of a hydraulic crane, 1,024 samples;
        "ball and beam": angle of the beam and position of the ball, 1,000;
        "dryer": heater and air temperature of a hair dryer, 1,000;
        "flutter": excitation and response of a wing, 1,024;
        "gas furnace": gas rate and CO2 in %, 296;
        "two tanks": pump and both levels, 2,500.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    ValueError
        If a file is not the record.

    Notes
    -----
    There are no official splits; the literature often trains on the first half of a
    record and tests on the second (``record.split(0.5)``). The files of "actuator" and
    "flutter" state no sampling time; theirs is set to 1 s.

    Examples
    --------
    >>> from alssnn.datasets import fetch_classics
    >>> records = fetch_classics()  # doctest: +SKIP
    >>> records["two tanks"]  # doctest: +SKIP
    Record('two tanks', N=2500, nu=1, ny=2, dt=0.2 s)
    """
    records = {}
    for name, (filename, length, dt, variables) in CLASSICS.items():
        path = _find_file(data_home, "classics", filename, source=CLASSICS_SOURCE)
        with _must(path, "hold an input and an output", CLASSICS_SOURCE):
            u, y = _read(path, variables)
        _check_length(path, len(u), length, CLASSICS_SOURCE)
        records[name] = Record(u, y, dt, name)
    return records


def _read(path, variables):
    """Return u and y with time down the rows."""
    if variables:
        from scipy.io import loadmat  # here, so that importing the datasets stays light

        content = loadmat(path, variable_names=list(variables))
        return [z.T if len(z) < z.shape[1] else z for z in map(content.get, variables)]
    if path.suffix == ".csv":
        return np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    return np.loadtxt(path, unpack=True)

"""Measured benchmark records: coupled drives, cascaded tanks, Silverbox."""

import numpy as np

from ..checks import check_option
from ._files import _check_length, _find_file, _must, _read_columns
from ._record import Record

DRIVES_DT = 0.02  # s
DRIVES_LENGTH = 500  # samples
DRIVES_TRAIN = 400  # first samples of every experiment
DRIVES = {  # excitation: file, and its columns, u and z of every experiment in order
    "uniform": ("DATAUNIF.csv", ["u11", "u12", "z11", "z12"]),
    "prbs": ("DATAPRBS.csv", ["z1", "u1", "z2", "u2", "z3", "u3"]),
}

TANKS_DT = 4.0  # s
TANKS_LENGTH = 1_024  # samples

SILVERBOX_FILE = "SNLS80mV.mat"
SILVERBOX_DT = 2**14 / 1e7  # s, 610.35 Hz
SILVERBOX_LENGTH = 131_072  # samples
SILVERBOX_TRAIN = slice(40_650, 105_712)  # three quarters of the multisine
SILVERBOX_TESTS = {
    "multisine": slice(105_712, 127_400),
    "arrow": slice(100, 40_575),
    "arrow, no extrapolation": slice(100, 32_100),
}


def fetch_coupled_drives(data_home=None, excitation="uniform"):
    """Load the measured coupled electric drives.

    Two motors drive a pulley by a flexible belt that a spring keeps tight [1]_. The
    input is the voltage of both motors; the output is the speed of the pulley, whose
    pulse counter does not see its sign.

    Parameters
    ----------
    data_home : str or path-like, default=None
        Folder that holds ``coupled_electric_drives`` with its CSV files, or the folder
        of the files. By default the environment variable ``ALSSNN_DATA_HOME``, else
        ``~/alssnn_data``.
    excitation : {"uniform", "prbs"}, default="uniform"
        "uniform": two experiments with levels of uniform distribution, held for random
        times, the benchmark. "prbs": three experiments with two levels each.

    Returns
    -------
    train, test : list of Record
        The first 400 and the last 100 samples of every experiment: voltage in V,
        absolute speed in ticks/s, each of shape (N, 1), `dt` = 0.02 s.

    Raises
    ------
    FileNotFoundError
        If the file is missing.
    ValueError
        If `excitation` is unknown, or the file is not the record.

    See Also
    --------
    alssnn.rectified.restore_sign : Recover the sign that the counter does not see.

    Notes
    -----
    The experiments are fitted together: ``model.fit(*zip(*train))``. The benchmark
    states one root mean square error per experiment, in ticks/s, and allows 10 samples
    of the test part for the initial state.

    References
    ----------
    .. [1] T. Wigren and M. Schoukens, "Coupled electric drives data set and reference
       models", Technical Report 2017-024, Department of Information Technology,
       Uppsala University, 2017.

    Examples
    --------
    >>> from alssnn.datasets import fetch_coupled_drives
    >>> train, test = fetch_coupled_drives()  # doctest: +SKIP
    >>> train[0]  # doctest: +SKIP
    Record('coupled drives, uniform 1[:400]', N=400, nu=1, ny=1, dt=0.02 s)
    """
    check_option("excitation", excitation, DRIVES, "The benchmark is 'uniform'.")
    filename, names = DRIVES[excitation]
    path = _find_file(data_home, "coupled_electric_drives", filename)
    values = _read_columns(path, names, length=DRIVES_LENGTH)
    is_input = np.array([name[0] == "u" for name in names])
    pairs = zip(values[is_input], values[~is_input], strict=True)
    parts = [
        Record(u, y, DRIVES_DT, f"coupled drives, {excitation} {i}")
        for i, (u, y) in enumerate(pairs, start=1)
    ]
    train, test = zip(*(part.split(DRIVES_TRAIN) for part in parts), strict=True)
    return list(train), list(test)


def fetch_cascaded_tanks(data_home=None):
    """Load the measured cascaded tanks.

    A pump fills the upper of two tanks, which empties into the lower one and that into
    the reservoir [1]_. Both overflow; part of what the upper tank spills reaches the
    lower one.

    Parameters
    ----------
    data_home : str or path-like, default=None
        Folder that holds ``cascaded_tanks/dataBenchmark.csv``, or the folder of that
        file. By default the environment variable ``ALSSNN_DATA_HOME``, else
        ``~/alssnn_data``.

    Returns
    -------
    train, test : Record
        Voltage of the pump and of the level sensor of the lower tank, in V, each of
        shape (1024, 1), `dt` = 4 s.

    Raises
    ------
    FileNotFoundError
        If the file is missing.
    ValueError
        If the file is not the record.

    Notes
    -----
    The sensor saturates at 10 V. The benchmark allows the first 50 samples of the test
    record for estimating the initial state and does not score them.

    References
    ----------
    .. [1] M. Schoukens, P. Mattson, T. Wigren and J.-P. Noel, "Cascaded tanks
       benchmark combining soft and hard nonlinearities", Workshop on Nonlinear System
       Identification Benchmarks, Brussels, 2016, pp. 20-23.

    Examples
    --------
    >>> from alssnn.datasets import fetch_cascaded_tanks
    >>> train, test = fetch_cascaded_tanks()  # doctest: +SKIP
    >>> train  # doctest: +SKIP
    Record('cascaded tanks, train', N=1024, nu=1, ny=1, dt=4 s)
    """
    path = _find_file(data_home, "cascaded_tanks", "dataBenchmark.csv")
    names = ["uEst", "uVal", "yEst", "yVal"]
    u, u_test, y, y_test = _read_columns(path, names, length=TANKS_LENGTH)
    train = Record(u, y, TANKS_DT, "cascaded tanks, train")
    return train, Record(u_test, y_test, TANKS_DT, "cascaded tanks, test")


def fetch_silverbox(data_home=None):
    """Load the measured Silverbox, an electronic Duffing oscillator.

    The circuit behaves like a mass on a hardening spring [1]_. It was driven by a
    multisine in ten realizations and by the "arrow", a filtered noise of growing
    amplitude whose end exceeds that of the multisine.

    Parameters
    ----------
    data_home : str or path-like, default=None
        Folder that holds ``silverbox/SNLS80mV.mat``, or the folder of that file. By
        default the environment variable ``ALSSNN_DATA_HOME``, else ``~/alssnn_data``.

    Returns
    -------
    train : Record
        Three quarters of the multisine: input and output in V, each of shape (65062,
        1), `dt` = 1 / 610.35 s.
    tests : dict of str to Record
        "multisine", its last quarter; "arrow"; and "arrow, no extrapolation", the part
        of it that stays within the amplitudes of the training.

    Raises
    ------
    FileNotFoundError
        If the file is missing.
    ValueError
        If the file is not the record.

    See Also
    --------
    make_duffing : A simulated oscillator of the same kind.

    Notes
    -----
    The benchmark allows the first 50 samples of every test record for estimating the
    initial state, does not score them, and states errors in mV.

    References
    ----------
    .. [1] T. Wigren and J. Schoukens, "Three free data sets for development and
       benchmarking in nonlinear system identification", European Control Conference,
       2013, pp. 2933-2938.

    Examples
    --------
    >>> from alssnn.datasets import fetch_silverbox
    >>> train, tests = fetch_silverbox()  # doctest: +SKIP
    >>> train  # doctest: +SKIP
    Record('Silverbox, train', N=65062, nu=1, ny=1, dt=0.0016384 s)
    """
    from scipy.io import loadmat  # here, so that importing the datasets stays light

    path = _find_file(data_home, "silverbox", SILVERBOX_FILE)
    with _must(path, "be a MATLAB file with the variables V1 and V2"):
        content = loadmat(path, variable_names=["V1", "V2"])
        u, y = (np.ravel(content[name]).astype(float) for name in ("V1", "V2"))
    _check_length(path, min(len(u), len(y)), SILVERBOX_LENGTH)
    parts = {"train": SILVERBOX_TRAIN, **SILVERBOX_TESTS}
    records = {
        name: Record(u[rows], y[rows], SILVERBOX_DT, f"Silverbox, {name}")
        for name, rows in parts.items()
    }
    return records.pop("train"), records

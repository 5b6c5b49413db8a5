"""The measured fine steering mirror of a small satellite."""

import numpy as np

from ._files import _check_length, _find_file, _must
from ._record import Record

MIRROR_DT = 1 / 6_400  # s
MIRROR_LEVELS = (100, 200, 300)  # mV
MIRROR_LENGTH = 8_192  # samples of a period
MIRROR_SOURCE = "https://github.com/merijnfloren/fsm-benchmark-data"


def fetch_fine_steering_mirror(data_home=None):
    """Load the measured fine steering mirror.

    Three piezo actuators move the mirror of a small satellite, and its displacement is
    measured at three points [1]_. The actuators have a slight hysteresis, so that a
    linear model of one level of excitation does not fit the others.

    Parameters
    ----------
    data_home : str or path-like, default=None
        Folder that holds ``fine_steering_mirror`` with its arrays, or the folder of
        the arrays. By default the environment variable ``ALSSNN_DATA_HOME``, else
        ``~/alssnn_data``.

    Returns
    -------
    train : list of Record
        Six realizations of every level, 100, 200 and 300 mV: inputs in V and
        displacements in m, each of shape (8192, 3), `dt` = 1 / 6400 s. A record is the
        mean of two measured periods.
    tests : dict of str to list of Record
        "100 mV", "200 mV" and "300 mV": two periods of three other realizations, six
        records each.

    Raises
    ------
    FileNotFoundError
        If an array is missing.
    ValueError
        If an array is not the record.

    Notes
    -----
    The inputs are orthogonal random-phase multisines up to 3 kHz, and the outputs in
    steady state. The first 100 samples of every test record estimate its initial state
    and are not scored (``n_init_samples=100``); errors are stated in micrometres, as
    means over outputs and records.

    References
    ----------
    .. [1] M. Floren, L. Peri, J. De Maeyer, W. De Munter, D. Vandepitte and J.-P. Noël,
       "Data-driven state-space identification and nonlinearity assessment of the
       CubeSpec Fine Steering Mirror", ISMA-USD, 2024, pp. 2042-2052.

    Examples
    --------
    >>> from alssnn.datasets import fetch_fine_steering_mirror
    >>> train, tests = fetch_fine_steering_mirror()  # doctest: +SKIP
    >>> train[0]  # doctest: +SKIP
    Record('mirror, 100 mV 1', N=8192, nu=3, ny=3, dt=0.00015625 s)
    """
    train, tests = [], {}
    for level in MIRROR_LEVELS:
        u, y = (_read(data_home, f"{z}_{level}mV_train.npy", 6).mean(3) for z in "uy")
        train += [
            Record(u[..., r], y[..., r], MIRROR_DT, f"mirror, {level} mV {r + 1}")
            for r in range(u.shape[2])
        ]
        u, y = (_read(data_home, f"{z}_{level}mV_test.npy", 3) for z in "uy")
        tests[f"{level} mV"] = [
            Record(
                u[..., r, p],
                y[..., r, p],
                MIRROR_DT,
                f"mirror, {level} mV test {r + 1}, period {p + 1}",
            )
            for r in range(u.shape[2])
            for p in range(u.shape[3])
        ]
    return train, tests


def _read(data_home, filename, n_realizations):
    """Return one array of shape (samples, channels, realizations, periods)."""
    path = _find_file(data_home, "fine_steering_mirror", filename, source=MIRROR_SOURCE)
    with _must(path, "be an array of NumPy", MIRROR_SOURCE):
        z = np.load(path, allow_pickle=False)
    _check_length(path, len(z), MIRROR_LENGTH, MIRROR_SOURCE)
    if z.shape[1:] != (3, n_realizations, 2):
        raise ValueError(
            f"`{path}` must have shape ({MIRROR_LENGTH}, 3, {n_realizations}, 2), got "
            f"{z.shape}. Get the file again from {MIRROR_SOURCE}."
        )
    return z

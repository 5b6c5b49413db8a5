"""The measured quarter drone: an arm with one propeller, recorded in closed loop."""

from ._files import _find_file, _read_columns
from ._record import Record

DRONE_DT = 0.01  # s
DRONE_SOURCE = "the author of the record, H. V. H. Ayala"
DRONE_COLUMNS = ["Tempo_s", "Referencia", "Saida_y", "Controle_u"]
STAIRCASE_COLUMNS = ["tempo_ms", "angulo_deg", "u_pct", "referencia"]
DRONE = {  # name: file, its columns, number of samples, columns of u and y
    "steps": ("sinal2_degraus_malha_fechada.csv", DRONE_COLUMNS, 10_000, (3, 2)),
    "multisine": ("sinal4_multiseno_malha_fechada.csv", DRONE_COLUMNS, 10_000, (3, 2)),
    "swept sine": (
        "sinal3_swept_sine_malha_fechada.csv",
        DRONE_COLUMNS,
        10_001,
        (3, 2),
    ),
    "staircase": ("dados_14_drone.csv", STAIRCASE_COLUMNS, 17_537, (2, 1)),
}


def fetch_quarter_drone(data_home=None):
    r"""Load the measured quarter drone.

    An arm turns about a horizontal axis and carries one propeller at its end. Gravity
    and the square of the propeller's speed act on it:

    .. math::

        \ddot\theta = c_1 \sin\theta + c_2 u^2 + c_3 \dot\theta, \qquad y = \theta.

    All runs were recorded in closed loop: a controller chose the input.

    Parameters
    ----------
    data_home : str or path-like, default=None
        Folder that holds ``quarter_drone`` with its CSV files, or the folder of the
        files. By default the environment variable ``ALSSNN_DATA_HOME``, else
        ``~/alssnn_data``.

    Returns
    -------
    runs : dict of str to Record
        "steps", "multisine" and "swept sine" of the reference, 100 s each, and a
        "staircase" of 175 s: command of the motor in %, angle in degrees, each of
        shape (N, 1), `dt` = 0.01 s.

    Raises
    ------
    FileNotFoundError
        If a file is missing.
    ValueError
        If a file is not the record.

    See Also
    --------
    make_pendulum : A simulated arm without propeller.

    Notes
    -----
    There is no official split; the natural one identifies on steps and multisine and
    tests on the swept sine. The arm rests against a stop near 0 degrees, where the
    command, negative at times, has no effect. The staircase has time stamps in whole
    milliseconds, 7 to 14 ms apart, 10.015 ms on average; the other runs are uniform.

    Examples
    --------
    >>> from alssnn.datasets import fetch_quarter_drone
    >>> runs = fetch_quarter_drone()  # doctest: +SKIP
    >>> runs["swept sine"]  # doctest: +SKIP
    Record('quarter drone, swept sine', N=10001, nu=1, ny=1, dt=0.01 s)
    """
    runs = {}
    for name, (filename, columns, length, (u, y)) in DRONE.items():
        path = _find_file(data_home, "quarter_drone", filename, source=DRONE_SOURCE)
        values = _read_columns(path, columns, length=length, source=DRONE_SOURCE)
        runs[name] = Record(values[u], values[y], DRONE_DT, f"quarter drone, {name}")
    return runs

"""The measured Wiener-Hammerstein circuit, the record of the paper."""

from ..checks import check_option
from ._files import WEBSITE, _find_file, _read_columns
from ._record import Record

FILE = "WienerHammerBenchmark.csv"
DT = 1 / 51_200  # s
LENGTH = 188_000  # samples
SPLITS = {
    "paper": {"train": slice(0, 100_000), "test": slice(100_000, 188_000)},
    "official": {"train": slice(5_200, 105_200), "test": slice(105_200, 184_000)},
}
DOWNLOAD = (
    "Or let the package nonlinear_benchmarks (pip install "
    '"alssnn[data]") download it: set `download_if_missing=True`.'
)


def fetch_wiener_hammerstein(data_home=None, split="paper", download_if_missing=False):
    """Load the measured Wiener-Hammerstein benchmark record.

    An electronic circuit [1]_: a third-order Chebyshev filter (0.5 dB, 4.4 kHz), a
    saturation by a diode, and a third-order inverse Chebyshev filter (40 dB from
    5 kHz), excited by band-limited Gaussian noise; 188,000 samples at 51,200 Hz.

    Parameters
    ----------
    data_home : str or path-like, default=None
        Folder that holds ``wiener_hammerstein/WienerHammerBenchmark.csv``, or the
        folder of that file. By default the environment variable ``ALSSNN_DATA_HOME``,
        else ``~/alssnn_data``.
    split : {"paper", "official"}, default="paper"
        "paper": rows 0 to 99,999 for training and 100,000 to 187,999 for testing.
        "official", of the benchmark site: rows 5,200 to 105,199 and 105,200 to 183,999,
        the part in which the input is active.
    download_if_missing : bool, default=False
        If the file is missing, load the record through the package
        ``nonlinear_benchmarks``, which downloads it once into a cache of its own. If
        False, a missing file is an error.

    Returns
    -------
    train, test : Record
        Input and output, in volts, each of shape (N, 1), `dt` = 1 / 51200 s.

    Raises
    ------
    FileNotFoundError
        If the file is missing and `download_if_missing` is False.
    ImportError
        If the file is missing, `download_if_missing` is True, and the package
        ``nonlinear_benchmarks`` is not installed.
    ValueError
        If `split` is unknown, or the file is not the record.

    See Also
    --------
    make_wiener_hammerstein : A simulated circuit of the same structure.

    Notes
    -----
    The input is almost off before row 5,200 and after row 184,000. The file has 5
    significant digits; the step of the converter is 0.343 mV. Linear models, even a
    filter with 150 taps, stop at a simulation error of 42 to 43 mV. The benchmark
    allows the first 50 samples of the official test part for estimating the initial
    state and does not score them.

    References
    ----------
    .. [1] J. Schoukens, J. Suykens, L. Ljung, "Wiener-Hammerstein benchmark", 15th IFAC
       Symposium on System Identification (SYSID), Saint-Malo, 2009.

    Examples
    --------
    >>> from alssnn.datasets import fetch_wiener_hammerstein
    >>> train, test = fetch_wiener_hammerstein()  # doctest: +SKIP
    >>> train  # doctest: +SKIP
    Record('Wiener-Hammerstein, paper train', N=100000, nu=1, ny=1, dt=1.95313e-05 s)
    """
    remedy = "For other rows, slice the signals of the 'paper' records."
    check_option("split", split, SPLITS, remedy)
    try:
        path = _find_file(data_home, "wiener_hammerstein", FILE, hint=DOWNLOAD)
    except FileNotFoundError:
        if not download_if_missing:
            raise
        u, y = _download()
        source = "the package nonlinear_benchmarks"
    else:
        u, y = _read_columns(path, ["uBenchMark", "yBenchMark"])
        source = str(path)
    if len(u) != LENGTH:
        raise ValueError(
            f"The record in {source} must hold {LENGTH} samples, "
            f"got {len(u)}. Get the complete record again from {WEBSITE}."
        )
    train, test = (
        Record(u[rows], y[rows], DT, f"Wiener-Hammerstein, {split} {part}")
        for part, rows in SPLITS[split].items()
    )
    return train, test


def _download():
    """Return u and y, each of shape (N,), from the package nonlinear_benchmarks."""
    try:
        import nonlinear_benchmarks
    except ImportError as error:
        raise ImportError(
            "`download_if_missing=True` needs the package nonlinear_benchmarks, "
            'which could not be imported. Install it by pip install "alssnn[data]", or '
            f"get the record yourself from {WEBSITE}."
        ) from error
    return nonlinear_benchmarks.WienerHammerBenchMark(train_test_split=False)

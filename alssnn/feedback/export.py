"""Systems of python-control with the names of the user's signals."""

import re

import control


def signal_names(names, letter, size):
    """Return names of signals that python-control accepts.

    Parameters
    ----------
    names : sequence of str or None
        Names in the user's data, such as DataFrame columns.
    letter : str
        Letter of default names ``letter[0]``, ``letter[1]``, ...
    size : int
        Number of signals.

    Returns
    -------
    names : list of str
        One unique name per signal; "." means `system.signal` there and becomes "_".
    """
    if names is None:
        return [f"{letter}[{i}]" for i in range(size)]
    clean = [re.sub(r"\.", "_", str(name)) for name in names]
    return [
        name if clean.index(name) == i else f"{name}_{i}"
        for i, name in enumerate(clean)
    ]


def to_statespace(A, B, C, D, dt, *, inputs=None, outputs=None, name=None):
    """Return a discrete-time `control.StateSpace` with named signals.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix.
    B : ndarray of shape (nx, nu)
        Input matrix.
    C : ndarray of shape (ny, nx)
        Output matrix.
    D : ndarray of shape (ny, nu)
        Feedthrough matrix.
    dt : float
        Sampling time, in seconds.
    inputs, outputs : sequence of str or None, default=None
        Names of the signals.
    name : str or None, default=None
        Name of the system.

    Returns
    -------
    sys : control.StateSpace
        The system.
    """
    return control.ss(
        A,
        B,
        C,
        D,
        dt,
        inputs=signal_names(inputs, "u", B.shape[1]),
        outputs=signal_names(outputs, "y", C.shape[0]),
        states=signal_names(None, "x", A.shape[0]),
        name=name,
    )

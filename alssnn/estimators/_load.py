"""Load a fitted model: the way back from `save`."""

from ._al_ssnn import AlSsnn
from ._fl_ssnn import FlSsnn
from ._gr_ssnn import GrSsnn
from ._linear import LinearStateSpace

CLASSES = {cls.__name__: cls for cls in (LinearStateSpace, FlSsnn, AlSsnn, GrSsnn)}


def load(path, classes=()):
    """Load a model that `model.save` wrote.

    Parameters
    ----------
    path : str or path-like
        File.
    classes : sequence of type, default=()
        Estimators of your own, beside those of this package.

    Returns
    -------
    model : estimator
        The fitted model: same estimator, parameters and results, to the bit.

    Raises
    ------
    OSError
        If the file cannot be opened.
    ValueError
        If the file is of another type or of a newer version, damaged, or altered so
        that it contradicts itself.

    Notes
    -----
    Reading executes nothing that the file contains: it holds numbers and names alone,
    and all are checked.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "circuit.npz"
    >>> model.save(path)
    >>> again = alssnn.load(path)
    >>> bool((again.predict(record.u) == model.predict(record.u)).all())
    True
    """
    from ..persistence import load

    return load(path, CLASSES | {cls.__name__: cls for cls in classes})

"""Models in C99: fixed sizes, no allocation, nothing beyond math.h.

The sources state the equations of `Parts` once more.  What is compiled is compared with
Python in the tests, step by step.
"""

import re
from pathlib import Path

from ._c_code import header, source
from ._c_companions import demo, makefile, readme
from ._c_model import SUFFIX, CModel
from ._parts import Parts


def to_c(
    model,
    directory,
    *,
    law=None,
    observer=None,
    gain=None,
    dtype="double",
    prefix="plant",
):
    """Write a fitted model, its law, observer and controller as C sources.

    Parameters
    ----------
    model : estimator
        Fitted model.
    directory : str or path-like
        Folder, made if need be; files of the same names are replaced.
    law : LinearizingLaw or None, default=None
        Law, for example with limits; None takes ``model.linearizing_law()``, or
        leaves it out where it is ill-posed.
    observer : Observer, None or False, default=None
        Observer with constant gain; None takes ``model.observer()``, False leaves it
        out.
    gain : array_like of shape (nu, nx) or (nu, nx + ny) or None, default=None
        Gain of a controller, as for `feedback.closed_loop`.
    dtype : {"double", "float"}, default="double"
        Type of all numbers.
    prefix : str, default="plant"
        Begins the names of files, functions and types.

    Returns
    -------
    paths : list of Path
        The files.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    OSError
        If a file cannot be written.
    TypeError
        If `law` or `observer` is of another type.
    ValueError
        If an argument does not fit the model, a value is beyond the range of `dtype`,
        or an activation is the user's.
    """
    if dtype not in SUFFIX:
        raise ValueError(f"`dtype` must be 'double' or 'float', got {dtype!r}.")
    if not isinstance(prefix, str) or not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", prefix):
        raise ValueError(
            "`prefix` must begin with a letter and consist of letters, digits and _, "
            f"got {prefix!r}. It begins names in C."
        )
    c = CModel(Parts.of(model, law, observer, gain), dtype, prefix, model._scaling)
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    files = {
        f"{prefix}.h": header(c),
        f"{prefix}.c": source(c),
        f"{prefix}_demo.c": demo(c),
        "Makefile": makefile(c),
        "README.md": readme(c),
    }
    paths = [directory / name for name in files]
    for path, content in zip(paths, files.values(), strict=True):
        path.write_text(content, encoding="ascii")
    return paths

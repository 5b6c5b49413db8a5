"""Checks of u and y by scikit-learn, in the words of this package.

scikit-learn knows data as X, prints them whole, and advises to reshape.  Here every
message names the argument and what it should be; what scikit-learn says follows, its
first line, for those who look for it.
"""

from contextlib import contextmanager

import numpy as np
from sklearn.utils.validation import check_array, validate_data

from ..checks import unmasked
from ..containers import Container

# Single precision stays what it is, chunks are converted; nan are left to our checks.
DATA = {"dtype": [np.float64, np.float32], "ensure_all_finite": "allow-nan"}
SHAPES = {"u": "(N, nu) or (N,)", "y": "(N,) or (N, ny)"}
LONGEST = 140  # characters of a message that is not ours
IS_X = (("Input X ", "Input u "), ("for X,", "for u,"), ("of X ", "of u "))


def check_u(model, u, *, reset, least=1):
    """Return inputs as an array, or refuse them.

    Parameters
    ----------
    model : estimator
        Estimator, which remembers the columns.
    u : array_like of shape (N, nu)
        Inputs.
    reset : bool
        Whether these are the inputs of a fit.
    least : int, default=1
        Number of samples that are needed.

    Returns
    -------
    u : ndarray of shape (N, nu)
        Inputs; nan are left to the caller.

    Raises
    ------
    TypeError
        If they are sparse, or no data at all.
    ValueError
        If they are no real numbers, or of the wrong shape.
    """
    with _named("u", u):
        u = unmasked(u)
        return validate_data(model, u, reset=reset, ensure_min_samples=least, **DATA)


def check_y(model, y):
    """Return outputs as an array, or refuse them.

    Parameters
    ----------
    model : estimator
        Estimator, for the message.
    y : array_like of shape (N,) or (N, ny)
        Outputs.

    Returns
    -------
    y : ndarray of shape (N,) or (N, ny)
        Outputs; nan where not measured.

    Raises
    ------
    TypeError
        If they are sparse, or no data at all.
    ValueError
        If they are no real numbers, or of the wrong shape.
    """
    with _named("y", y):
        if y is None:
            raise ValueError(
                f"This {type(model).__name__} estimator requires y to be passed, but "
                "the target y is None."
            )
        y = unmasked(y)
        y = check_array(y, ensure_2d=False, input_name="y", estimator=model, **DATA)
        if y.ndim == 0:
            raise ValueError("A number is no record.")
        return y


def check_outputs(model, y):
    """Refuse outputs whose columns have other names than those of the fit.

    Parameters
    ----------
    model : estimator
        Fitted model.
    y : array_like of shape (N,) or (N, ny)
        Outputs, as they came.

    Raises
    ------
    ValueError
        If several outputs have names, here and there, and these differ.
    """
    known, names = model.output_names_, Container.of(y).output_names
    if known and names and len(known) == len(names) > 1 and known != names:
        raise ValueError(
            f"`y` must have the columns {known}, in this order, as in the fit, got "
            f"{names}. Take y[{known}]."
        )


def check_rows(u, y):
    """Refuse inputs whose time runs along the rows.

    Parameters
    ----------
    u : array_like
        Inputs, as they came.
    y : array_like
        Outputs, as they came.

    Raises
    ------
    ValueError
        If `u` has as many columns, and more than rows, as `y` has samples.
    """
    shape: tuple = getattr(u, "shape", ())
    n = len(y) if isinstance(y, list | tuple) else (*getattr(y, "shape", ()), 0)[0]
    if len(shape) == 2 and shape[0] < shape[1] == n:
        raise ValueError(
            f"`u` must have one row per sample, got shape {shape} for {n} "
            "samples of `y`. Time runs down the rows: pass u.T."
        )


def check_lengths(u, y):
    """Refuse records of unequal length.

    Parameters
    ----------
    u : ndarray of shape (N, nu)
        Inputs.
    y : ndarray of shape (N,) or (N, ny)
        Outputs.

    Raises
    ------
    ValueError
        If they have inconsistent numbers of samples.
    """
    if len(u) != len(y):
        raise ValueError(
            f"`u` and `y` must have the same number of samples, got {len(u)} and "
            f"{len(y)}, inconsistent numbers of samples. Time runs down the rows."
        )


@contextmanager
def _named(name, data):
    """Give an error the name of the argument, and keep it short."""
    try:
        kind = getattr(getattr(data, "dtype", None), "kind", "")
        if isinstance(kind, str) and kind in ("m", "M"):  # would be read as numbers
            raise ValueError("Dates are no signal.")
        yield
    except (TypeError, ValueError, OverflowError) as error:
        reason = (str(error).splitlines() or [""])[0].rstrip(": ")
        for words, ours in IS_X if name == "u" else ():
            reason = reason.replace(words, ours)
        if "Reshape your data" in str(error):
            reason += ". Reshape your data to one column per signal"
        if len(reason) > LONGEST:
            reason = f"{reason[:LONGEST]}..."
        kind = TypeError if isinstance(error, TypeError) else ValueError
        raise kind(
            f"`{name}` must be an array of finite real numbers of shape "
            f"{SHAPES[name]}, time down the rows, got {_described(data)}: {reason}"
        ) from error


def _described(data):
    """Return type and shape of data in words."""
    shape = getattr(data, "shape", None)
    shape = f" of shape {shape}" if isinstance(shape, tuple) else ""
    return f"{type(data).__name__}{shape}"

"""Errors of a simulated output, per output and averaged.

With e = y_true - y_pred, and the mean taken down the rows (time), for each output:

    rmse        = sqrt(mean(e^2))                        in the unit of y
    nrmse       = rmse / std(y_true)                     0 is perfect, 1 is the mean
    fit_percent = 100 (1 - |e| / |y_true - mean(y_true)|) = 100 (1 - nrmse)

so that, with the coefficient of determination of scikit-learn, nrmse^2 = 1 - R2. Means
and deviations are those of the samples that were measured: nan in `y_true` does not
count. No function here removes a transient: slice both arguments first.
"""

import reprlib

import numpy as np
from sklearn.utils import check_array

from .checks import unmasked

__all__ = ["fit_percent", "nrmse", "rmse"]


def rmse(y_true, y_pred, *, multioutput="uniform_average"):
    """Compute the root-mean-square error.

    Parameters
    ----------
    y_true : array-like of shape (N,) or (N, ny)
        Measured output; nan where it was not measured.
    y_pred : array-like of shape (N,) or (N, ny)
        Simulated output, in the unit of `y_true`.
    multioutput : {"uniform_average", "raw_values"}, default="uniform_average"
        Whether to return the mean over the outputs, or one value per output.

    Returns
    -------
    error : float or ndarray of shape (ny,)
        Root-mean-square error, in the unit of `y_true`.

    Raises
    ------
    ValueError
        If the arguments differ in shape, are empty or not finite, if an output was
        never measured, or if `multioutput` is unknown.

    See Also
    --------
    nrmse : The same, relative to the standard deviation of `y_true`.

    Examples
    --------
    >>> from alssnn.metrics import rmse
    >>> rmse([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 6.0])
    1.0
    """
    y_true, y_pred = _check_outputs(y_true, y_pred)
    return _aggregate(_rms(y_true - y_pred), multioutput)


def nrmse(y_true, y_pred, *, multioutput="uniform_average"):
    """Compute the root-mean-square error relative to the output.

    Parameters
    ----------
    y_true : array-like of shape (N,) or (N, ny)
        Measured output; nan where it was not measured.
    y_pred : array-like of shape (N,) or (N, ny)
        Simulated output, in the unit of `y_true`.
    multioutput : {"uniform_average", "raw_values"}, default="uniform_average"
        Whether to return the mean over the outputs, or one value per output.

    Returns
    -------
    error : float or ndarray of shape (ny,)
        Root-mean-square error over the standard deviation of `y_true` around its mean:
        0 for a perfect model, 1 for the mean of `y_true`. For a constant `y_true`, 0 if
        `y_pred` equals it and infinity otherwise.

    Raises
    ------
    ValueError
        If the arguments differ in shape, are empty or not finite, if an output was
        never measured, or if `multioutput` is unknown.

    See Also
    --------
    rmse : The same, in the unit of `y_true`.
    fit_percent : The same, as a percentage that grows with the quality.

    Examples
    --------
    >>> from alssnn.metrics import nrmse
    >>> nrmse([-1.0, 1.0, -1.0, 1.0], [-1.5, 0.5, -1.5, 0.5])
    0.5
    """
    y_true, y_pred = _check_outputs(y_true, y_pred)
    return _aggregate(_relative_error(y_true, y_pred), multioutput)


def fit_percent(y_true, y_pred, *, multioutput="uniform_average"):
    """Compute the fit of a simulated output, in percent.

    Parameters
    ----------
    y_true : array-like of shape (N,) or (N, ny)
        Measured output; nan where it was not measured.
    y_pred : array-like of shape (N,) or (N, ny)
        Simulated output, in the unit of `y_true`.
    multioutput : {"uniform_average", "raw_values"}, default="uniform_average"
        Whether to return the mean over the outputs, or one value per output.

    Returns
    -------
    fit : float or ndarray of shape (ny,)
        ``100 * (1 - norm(y_true - y_pred) / norm(y_true - mean(y_true)))``: 100 for a
        perfect model, 0 for the mean of `y_true`, negative for worse ones. For a
        constant `y_true`, 100 if `y_pred` equals it and minus infinity otherwise.

    Raises
    ------
    ValueError
        If the arguments differ in shape, are empty or not finite, if an output was
        never measured, or if `multioutput` is unknown.

    See Also
    --------
    nrmse : The relative error that this is made of.

    Notes
    -----
    This is the fit that ``compare`` of the MATLAB System Identification Toolbox prints.

    Examples
    --------
    >>> from alssnn.metrics import fit_percent
    >>> fit_percent([-1.0, 1.0, -1.0, 1.0], [-1.5, 0.5, -1.5, 0.5])
    50.0
    """
    y_true, y_pred = _check_outputs(y_true, y_pred)
    return _aggregate(100 * (1 - _relative_error(y_true, y_pred)), multioutput)


def missed_percent(r2):
    """Return what a simulation misses of its output.

    Parameters
    ----------
    r2 : float
        Coefficient of determination; nan if unknown.

    Returns
    -------
    missed : float
        100 nrmse, in percent; nan if unknown.
    """
    return float(100 * np.sqrt(max(1 - r2, 0.0)))


def free_run_errors(y_true, y_pred):
    """Return RMSE and fit of every output, infinite where the simulation diverges.

    Parameters
    ----------
    y_true : ndarray of shape (N,) or (N, ny)
        Measured outputs; nan where not measured.
    y_pred : ndarray of the same shape
        Simulated outputs.

    Returns
    -------
    rmse, fit : ndarray of shape (ny,)
        As `rmse` and `fit_percent`; inf and -inf if not all of them are finite.
    """
    if not np.isfinite(y_pred).all():
        ny = y_pred[0].size
        return np.full(ny, np.inf), np.full(ny, -np.inf)
    y_true, y_pred = _check_outputs(y_true, y_pred)
    relative = _relative_error(y_true, y_pred)
    return _rms(y_true - y_pred), 100 * (1 - relative)


def _check_outputs(y_true, y_pred):
    """Return both outputs as float arrays of the same shape (N, ny)."""
    checked = []
    for name, y in (("y_true", y_true), ("y_pred", y_pred)):
        finite = "allow-nan" if name == "y_true" else True
        try:
            y = check_array(
                unmasked(y),
                ensure_2d=False,
                dtype=np.float64,
                ensure_all_finite=finite,
                input_name=name,
            )
        except (TypeError, ValueError) as error:
            if name in str(error):
                raise
            raise ValueError(
                f"`{name}` must be an array of numbers of shape (N,) or (N, ny), got "
                f"{reprlib.repr(y)}: {str(error).partition(chr(10))[0]}"
            ) from error
        checked.append(y.reshape(len(y), -1))
    y_true, y_pred = checked
    for axis, what in enumerate(("samples", "outputs")):
        if y_true.shape[axis] != y_pred.shape[axis]:
            raise ValueError(
                f"`y_true` and `y_pred` must have the same number of {what}, got "
                f"{y_true.shape[axis]} and {y_pred.shape[axis]}. "
                "Let time run down the rows of both."
            )
    if np.isnan(y_true).all(axis=0).any():
        raise ValueError(
            "`y_true` must have a measured sample in every output, got a column of "
            "nan. Leave an output that was never measured out."
        )
    return y_true, y_pred


def _rms(E):
    """Return the root mean square of each column of E, of shape (ny,)."""
    # Scaled first: the output of a diverged simulation may exceed 1e154, whose square
    # overflows.
    scale = np.nanmax(np.abs(E), axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    return scale * np.sqrt(np.nanmean((E / scale) ** 2, axis=0))


def _relative_error(y_true, y_pred):
    """Return rmse / std per output, of shape (ny,), where 0 / 0 = 0 and 1 / 0 = inf."""
    error = _rms(y_true - y_pred)
    spread = _rms(y_true - np.nanmean(y_true, axis=0))
    # Exactly constant outputs are told by their range: rounding of the mean can leave
    # them a spread of 1e-17.
    constant = np.nanmax(y_true, axis=0) == np.nanmin(y_true, axis=0)
    relative = np.where(error > 0, np.inf, 0.0)
    with np.errstate(over="ignore"):  # a ratio beyond 1e308 is infinite
        return np.divide(error, spread, out=relative, where=~constant)


def _aggregate(values, multioutput):
    """Return the mean of `values` as a float, or `values` themselves."""
    if isinstance(multioutput, str) and multioutput == "uniform_average":
        return float(values.mean())
    if isinstance(multioutput, str) and multioutput == "raw_values":
        return values
    raise ValueError(
        "`multioutput` must be 'uniform_average' or 'raw_values', got "
        f"{multioutput!r}. Weigh the raw values yourself for another average."
    )

"""Warnings at the line of the user, however deep they are raised."""

import inspect
import warnings

OURS = ("alssnn", "sklearn", "joblib")  # packages whose frames no user wrote


def warn_user(message, category):
    """Warn at the line of the user.

    How many frames are between depends on the estimator, on the decorators of
    scikit-learn, and on what calls the fit.

    Parameters
    ----------
    message : str
        What failed, and what to do.
    category : type
        Class of the warning.
    """
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_back is not None and _is_ours(frame):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


def _is_ours(frame):
    return frame.f_globals.get("__name__", "").partition(".")[0] in OURS

"""Warnings of a fit."""

from sklearn.exceptions import ConvergenceWarning

from ..warn import warn_user


def warn_of_training(message):
    """Warn of a training that failed in some way, at the line of the user.

    Parameters
    ----------
    message : str
        What failed, and what to do.
    """
    warn_user(message, ConvergenceWarning)

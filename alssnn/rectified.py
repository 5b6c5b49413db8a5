"""Outputs that were measured without their sign, such as speeds by pulse counters.

Of the output s only y = |s| is known.  A model of y must bend where s crosses zero; a
model of s need not, and is often nearly linear.  The signs are found by turns,

    fit a linear model to s,      s = sign(s_hat) y,      until no sign changes,

as phases are retrieved from magnitudes.  Every linear model is fitted by its simulation
error, so that s_hat depends on the input alone.  The turns start from s = y.

The plant must be odd.  The search is local and starts from what is positive: it was
reliable on simulated plants while s is positive in three quarters of the samples, and
fails for outputs that are as often negative.
"""

import numpy as np
from sklearn.base import clone

from .estimators import LinearStateSpace
from .experiments import is_list_of_records


def restore_sign(u, y, model=None, max_turns=30):
    """Restore the sign of outputs of which only the absolute value was measured.

    Parameters
    ----------
    u : array_like of shape (N, nu), or list of them
        Inputs, zero where they do not push. A list has one array per experiment.
    y : array_like of shape (N,) or (N, ny), or list of them
        Absolute values of the outputs; those below zero, by noise, change sign, too.
        nan where an output was not measured.
    model : estimator or None, default=None
        Model that tells the signs, with ``operating_point="zero"``; None means
        ``LinearStateSpace(operating_point="zero")``, which chooses its order itself.
    max_turns : int, default=30
        Largest number of fits.

    Returns
    -------
    s : ndarray of the shape of y, or list of them
        Outputs with sign.
    model : estimator
        The model fitted last; ``abs(model.predict(u))`` simulates what was measured.

    Raises
    ------
    ValueError
        If `max_turns` is not positive, or the operating point of `model` is not zero.

    Notes
    -----
    A local search, for outputs that are mostly positive: try several orders, and
    compare ``abs(model.predict(u, x0="training"))`` with y.

    Examples
    --------
    >>> from alssnn.rectified import restore_sign
    >>> u = np.repeat(np.random.default_rng(0).uniform(-1, 2, 40), 10)[:, None]
    >>> s = np.zeros(400)
    >>> for k in range(399):
    ...     s[k + 1] = 0.8 * s[k] + u[k, 0]
    >>> first_order = alssnn.LinearStateSpace(nx=1, operating_point="zero")
    >>> restored, model = restore_sign(u, abs(s), first_order)
    >>> bool(np.allclose(restored, s))
    True
    """
    if max_turns < 1:
        raise ValueError(
            f"`max_turns` must be at least 1, got {max_turns}. Use the default, 30."
        )
    if model is None:
        model = LinearStateSpace(operating_point="zero")
    if model.operating_point != "zero":
        raise ValueError(
            "`model` must have operating_point='zero', where signs change, got "
            f"{model.operating_point!r}."
        )
    as_list = is_list_of_records(u)
    us = list(u) if as_list else [np.asarray(u)]
    ys = [np.asarray(part) for part in (y if as_list else [y])]
    s, last = ys, None
    for _ in range(max_turns):
        model = clone(model).fit(us, s)
        simulated = model.predict(us, x0="training")
        signs = [np.where(s_hat < 0, -1.0, 1.0) for s_hat in simulated]
        if last is not None and all(map(np.array_equal, signs, last)):
            break
        s = [sign * part for sign, part in zip(signs, ys, strict=True)]
        last = signs
    return (s if as_list else s[0]), model

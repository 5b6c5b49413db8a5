"""A search without the residual g, where the input acts by a curve.

g explains the curve of an actuator sooner than phi does, and then stays: the search of
a model with a monotone input map leaves it out, and the fit that follows adds it.
"""

from copy import copy
from dataclasses import replace

import numpy as np


def searched(model):
    """Return the model that a search trains.

    Parameters
    ----------
    model : estimator
        Model to be fitted.

    Returns
    -------
    model : estimator
        The same, or one without g.
    """
    options = model.get_params(deep=False)
    if options.get("input_map", "identity") == "identity" or "n_g" not in options:
        return model
    plain = copy(model)
    plain.n_g = 0
    return plain


def completed(model, found, linear, experiments, seed):
    """Return where the fit begins that follows a search.

    Parameters
    ----------
    model : estimator
        Model to be fitted.
    found : Found
        Outcome of the search of `searched`.
    linear : LinearModel
        Any linear model.
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    seed : int
        Seed of the inner weights of g.

    Returns
    -------
    structure : Structure
        Structure of the whole model.
    theta, center : ndarray of shape (n_params,)
        Its parameters, g of zero output, and the center of their decay.
    """
    known = found.structure
    if searched(model) is model:
        return known, found.theta, found.start
    C, p = known.constants["C"], known.split(found.theta)
    nx, nu, ny = (known.sizes[axis] for axis in "xuy")
    structure = model.declare(nx, nu, ny, C)
    D, x0 = p.get("D", np.zeros((ny, nu))), np.zeros((len(experiments), nx))
    linear = replace(linear, A=p["A"], B=p["B"], C=C, D=D, x0=x0)
    fresh = structure.split(model._start(structure, linear, experiments, seed))
    theta, center = (
        structure.join({**fresh, **known.split(each)})
        for each in (found.theta, found.start)
    )
    return structure, theta, center

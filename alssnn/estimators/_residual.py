"""Whether a fit has g beside h: a search may do better without it.

Beside a monotone input map, g explains the curve of an actuator sooner than phi does,
and then stays: the search leaves g out, and the fit that follows adds it, if hidden
samples say so.  Without a map, g may spoil what h alone would find, for it is free:
h alone is searched for, too, and where hidden samples do not need g it is held at zero
(eq. enough).
"""

from copy import copy

import numpy as np

from ..network_orders import AGREE
from ..training import train
from ._noise import is_predicting

SOON = 1 / 3  # of max_time, after which no second search begins
TRIAL = 60  # steps of the short fit that asks whether g is needed, at most
# Mean square error with g over that without, on hidden samples, below which it is: no
# law cancels what g takes over. Of 40 records of `benchmarks.true_loops`, six gained 4
# to 8 % by it; four of the true loops missed their design 1.2 to 3.1 times as much with
# it, two 0.94 times. Errors one sample ahead are mostly noise, which nothing halves:
# their standard is that of the search.
NEEDED = 0.5

H_ALONE = "g is held at zero, for h alone is enough on hidden samples"


def searched(model):
    """Return the models that searches train, in order.

    Parameters
    ----------
    model : estimator
        Model to be fitted.

    Returns
    -------
    models : list of estimator
        The model, and the same without g; beside a monotone map this one alone.
    """
    options = model.get_params(deep=False)
    if not np.any(options.get("n_g", 0)) or not np.any(options.get("n_h", 0)):
        return [model]
    plain = copy(model)
    plain.n_g = 0
    return [model, plain] if options["input_map"] == "identity" else [plain]


def is_worthwhile(model, watch):
    """Tell whether h alone is searched for, in discrete time, where g helps.

    Parameters
    ----------
    model : Ssnn
        Model to be fitted.
    watch : Watch
        May end the fit.

    Returns
    -------
    is_worthwhile : bool
        Whether the law of h alone leaves nothing, so that neither k, D nor late inputs
        are there, and time is left for a second search and the training behind it.
    """
    late = np.any(getattr(model, "input_delay_", 0))
    leaves = np.any(getattr(model, "n_k", 0)) or model.feedthrough or late
    return not leaves and watch.used <= SOON


def is_enough(alone, found, is_predictor):
    """Tell whether h alone is to be taken (eq. enough).

    Parameters
    ----------
    alone : Found
        Outcome of the search without g.
    found : Found
        That with g, on the same hidden samples.
    is_predictor : bool
        Whether errors are those one sample ahead, nearly white.

    Returns
    -------
    is_enough : bool
        Whether h alone helps, and the root mean square error on hidden samples is not
        larger by more than another random start may make it; of a predictor, by more
        than chance does. True if networks with g do not help.
    """
    if not (alone.helps and found.helps):
        return alone.helps
    nearly = 1 / found.gain if is_predictor else AGREE**2
    return bool(alone.errors.sum() <= nearly * found.errors.sum())


def completed(model, own, found, linear, experiments, seed, watch):
    """Return where the fit begins that follows a search.

    Parameters
    ----------
    model : estimator
        Model to be fitted.
    own : estimator
        That of `searched` which was trained.
    found : Found
        Outcome of its search.
    linear : LinearModel
        Any linear model.
    experiments : sequence of tuple of ndarray
        Pairs (u, y) of scaled deviations.
    seed : int
        Seed of the inner weights of g.
    watch : Watch
        May end the short fit that asks whether g is needed.

    Returns
    -------
    structure : Structure
        Structure of the whole model.
    theta : ndarray of shape (n_params,)
        Its parameters, g of zero output.
    decay : dict
        Weight ``alpha`` and ``center`` of their decay, and whether steps bend and
        stages settle, as of `training.train`.
    held : dict of str to tuple of ndarray
        Bounds that hold g at zero, unless there is a map and hidden samples need g.
    """
    known, alpha = found.structure, {"alpha": found.alpha}
    # both of a long record alone: there the fit goes further than what was judged
    alpha |= {"bends": found.bends, "settles": found.bends}
    if own is model:
        return known, found.theta, alpha | {"center": found.center}, {}
    C, p = known.constants["C"], known.split(found.theta)
    nx, nu, ny = (known.sizes[axis] for axis in "xuy")
    structure = model.declare(nx, nu, ny, C)
    x0 = np.zeros((len(experiments), nx))
    linear = linear.with_matrices({**p, "C": C}, known.given, x0=x0)
    fresh = structure.split(model._start(structure, linear, experiments, seed))
    theta, center = (
        structure.join({**fresh, **known.split(each)})
        for each in (found.theta, found.center)
    )
    decay = alpha | {"center": center}
    has_map = model.input_map != "identity"
    if has_map and _is_needed(model, found, structure, theta, decay, watch):
        return structure, theta, decay, {}
    # also where h has ended at zero, and k or an integrator is what helps
    return structure, theta, decay, _held_g(structure, theta)


def idle_g(structure, theta):
    """Return bounds that hold g where a fit without it has left it: at zero.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Its parameters.

    Returns
    -------
    bounds : dict of str to tuple of ndarray
        Equal bounds of all parameters of g; empty if g is not zero, or h is, too.
    """
    p = structure.split(theta)
    if not np.any(p.get("W_h", 0.0)) or np.any(p.get("W_g", 1.0)):
        return {}
    return _held_g(structure, theta)


def _held_g(structure, theta):
    """Return equal bounds of all parameters of g."""
    p = structure.split(theta)
    return {
        name: (p[name], p[name])
        for name, axes in structure.parameters.items()
        if any(axis.startswith("w_g") for axis in axes)
    }


def idle(structure, theta, alpha):
    """Return bounds that hold the networks which a fit has left at zero.

    Parameters
    ----------
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Its parameters.
    alpha : float
        Weight of the decay that was found; inf if the fit returned the linear model.

    Returns
    -------
    bounds : dict of str to tuple of ndarray
        Equal bounds of all networks, if the fit returned the linear model; else those
        of `idle_g`.
    """
    if np.isfinite(alpha):
        return idle_g(structure, theta)
    p = structure.split(theta)
    # of a monotone map also the gain of u, which B can carry
    names = {*structure.network_parameters, "r_phiu"} & p.keys()
    return {name: (p[name], p[name]) for name in names}


def _is_needed(model, found, structure, theta, decay, watch):
    """Tell whether g makes the error on hidden samples so much less."""
    penalized, weights = model._criterion_terms(structure)
    options = model._training(structure)
    options["max_iter"] = min(found.refit_iter, TRIAL)
    result = train(
        penalized,
        found.fold.fitted,
        [theta],
        x0=found.x0,
        watch=watch.quiet(),
        **decay,
        weights=weights,
        **options,
    )
    weight = weights["y"]
    without = found.fold.error(found.structure, found.theta, found.x0, weight)
    error = found.fold.error(structure, result.theta, result.x0, weight)
    return error < (found.gain if is_predicting(model) else NEEDED) * without

"""What the training of a monotone input map v = phi(u, s) needs beside that of others.

The size of v is free, for B can carry it: after the training v has the standard
deviation of u along the record.
"""

import numpy as np

from ..descent import Descent
from ..equations import LEAST_GAIN
from ..network_orders import CONTENDS
from ..simulation import outputs

MAP = ("W_h", "b_h")  # what phi is linear in, beside what stands squared
# A stage of the search takes three times the steps of other models, for squared weights
# in front of neurons move slowly. With one time (`python -m benchmarks.constants
# LONGER_STAGES`), of 6 fits of 3 plants, test errors were 1.6 and 2.1 times as large
# with a fan, and as large with a valve and an exchanger; with six times they had the
# median 1.08 and the worst 2.5.
LONGER_STAGES = 3
# Along the path of a search. Larger ones leave other models linear, but not a map, for
# its layer does not start at zero: what they lead to is a bad start for smaller ones.
# With `descent.ALPHAS` (`python -m benchmarks.constants DECAYS`) test errors of FL-SSNN
# with a fan, a valve, an exchanger, a magnet and an arm are 0.97, 1.60, 2.90, 1.08 and
# 0.91 times as large, medians of two seeds; of all ten the worst is 4.8.
DECAYS = (1e-4, 1e-4, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
# Its first stages tell little of where a start leads, so that several go on. If only
# the best does, of ten long records of an arm (`benchmarks.true_loops`) FL-SSNN has 10,
# 3.5 and 2 times the deviation with three, and 0.75 times with one.


def check_map(estimator):
    """Refuse a monotone input map where there is none, or no law of it.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit; delays are known.

    Raises
    ------
    ValueError
        If h has no neurons, or an input arrives late.
    """
    if getattr(estimator, "input_map", "identity") == "identity":
        return
    if not np.any(estimator.n_h):
        raise ValueError(
            "`n_h` must be positive for input_map='monotone', whose neurons it counts, "
            f"got {estimator.n_h!r}."
        )
    if np.any(estimator.input_delay_):
        raise ValueError(
            "`input_map` must be 'identity' for inputs that arrive late, got "
            f"'monotone' and delays of {estimator.input_delay_.tolist()} samples: the "
            "law would need s of a later sample. Shift u in the record, or take "
            "input_delay=0."
        )


def as_large_as_u(estimator, structure, theta, x0, experiments):
    """Return the same model with a v that is as large as u along the record.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    structure : Structure
        Structure of the model.
    theta : ndarray of shape (n_params,)
        Its parameters.
    x0 : ndarray of shape (n_experiments, nx)
        Initial states.
    experiments : Held or Remote
        Experiments of the fit.

    Returns
    -------
    theta : ndarray of shape (n_params,)
        Parameters of the same map from u to y: phi multiplied, B divided by a number.
        The same parameters where B or its basis is the user's, or the record elsewhere.

    Notes
    -----
    The center of the decay of a search moves with them, for a fit that goes on.
    """
    p = structure.split(theta)
    given = estimator.linear_start is not None or "B" in (estimator.bounds or {})
    if "r_phi" not in p or given or not experiments.is_here:
        return theta
    lure = structure.observe("v").lure(theta)
    v = np.vstack(
        [outputs(lure, u, start) for (u, _), start in zip(experiments, x0, strict=True)]
    )
    size = np.sqrt(np.mean(v.var(axis=0)))
    direct = LEAST_GAIN + p["r_phiu"] ** 2
    if not (np.isfinite(size) and size > 0):
        return theta
    factor = max(1 / size, LEAST_GAIN / direct.min())  # a root stays real
    decay = estimator._decay
    if decay and "center" in decay:
        center = _multiplied(structure, decay["center"], factor)
        estimator._decay = {**decay, "center": center}
    return _multiplied(structure, theta, factor)


def _multiplied(structure, theta, factor):
    """Return parameters with phi multiplied and B divided by a number."""
    p = structure.split(theta)
    direct = LEAST_GAIN + p["r_phiu"] ** 2
    changed = {name: factor * p[name] for name in MAP if name in p}
    changed["r_phi"] = np.sqrt(factor) * p["r_phi"]
    changed["r_phiu"] = np.sqrt(np.maximum(factor * direct - LEAST_GAIN, 0.0))
    return structure.join({**p, **changed, "B": p["B"] / factor})


def stages_of_search(estimator):
    """Return what a search of a monotone map does in another way.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.

    Returns
    -------
    options : dict
        Options of `search.search`.
    """
    if getattr(estimator, "input_map", "identity") == "identity":
        return {"max_iter": estimator.max_iter, "descents": estimator._descents()}
    longer = LONGER_STAGES * estimator.max_iter
    return {"max_iter": longer, "descents": (Descent(DECAYS, contends=CONTENDS),)}

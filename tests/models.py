"""Fitted models with networks that do something, for tests of what is made of them."""

import warnings

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning

from alssnn import AlSsnn, FlSsnn, GrSsnn
from alssnn.estimators._fitted import publish_parameters

# The training alone, for tests of its mechanics: no search by hidden samples or for
# integrators, a free A and a tolerance that leaves the number of steps to `max_iter`.
PLAIN = {
    "alpha": 0.0,
    "integrators": 0,
    "n_init": 1,
    "stability": None,
    "phi": 0.01,
    "coarse_samples": 15_000,
    "tol": 1e-6,
}
OUTPUT = {"feedback": "output"}
PENALIZED = {"penalty": "state", "gamma": 1.0}

N = 300
FIRST = 120  # samples of the first of two experiments


def al_ssnn(*sizes, **options):
    """Return an `AlSsnn` that is trained without a search."""
    return AlSsnn(*sizes, **{**PLAIN, **OUTPUT, **PENALIZED, **options})


def fl_ssnn(*sizes, **options):
    """Return an `FlSsnn` that is trained without a search."""
    return FlSsnn(*sizes, **{**PLAIN, **OUTPUT, **options})


def gr_ssnn(*sizes, **options):
    """Return a `GrSsnn` that is trained without a search."""
    return GrSsnn(*sizes, **{**PLAIN, **options})


def record(nu, ny, seed=0):
    """Return u, y and labels of two experiments on a nonlinear plant, in odd units."""
    rng = np.random.default_rng(seed)
    A = np.array([[0.7, 0.2, 0.0], [-0.2, 0.6, 0.1], [0.0, -0.1, 0.5]])
    B, C = rng.standard_normal((3, nu)), rng.standard_normal((ny, 3))
    du, x, y = rng.standard_normal((N, nu)), np.zeros(3), np.empty((N, ny))
    for k in range(N):
        y[k] = C @ x
        x = A @ x + B @ (du[k] + 0.5 * np.tanh(x[0]))
    y += 0.01 * rng.standard_normal(y.shape)
    u_scale, y_scale = np.array([3.0, 0.02])[:nu], np.array([100.0, 0.1])[:ny]
    return (
        pd.DataFrame(du * u_scale + 10 * u_scale, columns=["valve.a", "p*/"][:nu]),
        pd.DataFrame(y * y_scale - 2 * y_scale, columns=["level", "flow"][:ny]),
        np.where(np.arange(N) < FIRST, "cold", "warm"),
    )


def fit(model, nu=2, ny=2, **changes):
    """Return a fitted copy of a model."""
    model = clone(model).set_params(**changes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(*record(nu, ny))


def lively(model, size=0.1, radius=0.9):
    """Give the networks of a fitted model random weights, and A at most a radius."""
    rng = np.random.default_rng(1)
    structure, theta = model._structure, model._theta.copy()
    for name, where in structure.slices.items():
        if name in structure.network_parameters:
            outer = name in ("W_h", "W_g", "W_k")
            n = where.stop - where.start
            theta[where] = (size if outer else 1.0) * rng.standard_normal(n)
    A = structure.split(theta)["A"]
    A *= min(1.0, radius / np.abs(np.linalg.eigvals(A)).max())
    model._theta = theta
    publish_parameters(model)
    return model


def simulate(model, u, **options):
    """Return what a model that was fitted on named columns predicts, (N, ny)."""
    u = pd.DataFrame(u, columns=model.feature_names_in_)
    return np.asarray(model.predict(u, **options)).reshape(len(u), -1)

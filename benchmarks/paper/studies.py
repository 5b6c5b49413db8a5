"""The plants, the models that are fitted to them, and what is measured of each.

The paper weighs |g|^2 against the squared error of y in its own units; here y has unit
variance inside the fit, so that the paper's gamma is divided by var(y).
"""

import time
from dataclasses import dataclass, field

import numpy as np

from alssnn import AlSsnn, FlSsnn, GrSsnn, LinearStateSpace
from alssnn.datasets import Record, fetch_wiener_hammerstein, make_prey_predator
from alssnn.estimators._base import StateSpaceModel
from alssnn.linearizability import Linearizability
from alssnn.metrics import rmse
from benchmarks._options import by_hand
from benchmarks.paper import published

LTI, GR, FL, AL = "LTI", "GR-SSNN", "FL-SSNN", "AL-SSNN"
STATE = "AL-SSNN, state feedback"  # what the paper does not show
OFFICIAL = "GR-SSNN, official split"


@dataclass(frozen=True, eq=False)
class Study:
    """Hold a plant's records and the models to fit, unfitted."""

    key: str
    title: str
    unit: str
    train: Record
    test: Record
    models: dict[str, StateSpaceModel]
    gammas: dict[float, StateSpaceModel] = field(default_factory=dict)
    official: tuple[Record, Record] | None = None  # records of the row OFFICIAL
    view: int | None = None  # last samples of the test record to draw; None draws all


@dataclass(frozen=True, eq=False)
class Fit:
    """Hold a fitted model and what was measured of it."""

    model: StateSpaceModel
    rmse_train: float  # from the initial state that the fit found
    rmse_test: float  # from an initial state estimated of samples that are not scored
    linearity: Linearizability  # on the test record
    seconds: float


def wiener_hammerstein(seed=0, quick=False):
    """Return the study of the measured circuit."""
    train, test = fetch_wiener_hammerstein()
    models, gammas = wiener_hammerstein_models(float(np.var(train.y)), seed, quick)
    return Study(
        key="wh",
        title="Wiener-Hammerstein circuit",
        unit="V",
        train=train,
        test=test,
        models=models,
        gammas=gammas,
        official=fetch_wiener_hammerstein(split="official"),
    )


def wiener_hammerstein_models(var_y, seed=0, quick=False):
    """Return the models of the study by name, and AL-SSNN by the paper's gamma."""
    linear = {"nx": 6, "dt": 1 / 51200}
    common = {**linear, "random_state": seed}
    gr = {"n_f": 15, "n_init": 3, "max_iter": 200, **common}
    state = {
        "feedback": "state",
        "penalty": "output",
        "stability": "contractive",
        "gamma": 0.01,
        "continuation": 4,
        "max_iter": 120,
        "polish_iter": 60,
    }
    gammas = {
        gamma: by_hand(
            AlSsnn,
            n_h=10,
            n_g=10,
            gamma=gamma / var_y,
            coarse_samples=8000,
            max_iter=500,
            polish_iter=40,
            **common,
        )
        for gamma in published.GAMMA
    }
    (gamma, _, _) = published.TRAINING["wh"][AL]
    models = {
        LTI: LinearStateSpace(**linear),
        GR: by_hand(GrSsnn, **gr),
        FL: by_hand(FlSsnn, n_h=10, **common),
        AL: gammas[gamma],  # fitted once
        STATE: by_hand(AlSsnn, n_h=10, n_g=10, **state, **common),
        OFFICIAL: by_hand(GrSsnn, **gr),
    }
    if quick:
        for model in {*models.values(), *gammas.values()}:
            shorten(model)
    return models, gammas


def prey_predator(seed=0, quick=False, n_samples=50_000):
    """Return the study of the simulated populations, half of them for training."""
    train, test = make_prey_predator(n_samples).split(0.5)
    linear = {"nx": 3, "dt": train.dt, "n_init_samples": 200}
    common = {**linear, "coarse_samples": 10_000, "random_state": seed}
    (gamma, _, _) = published.TRAINING["prey"][AL]
    state = {
        "feedback": "state",
        "penalty": "output",
        "stability": "contractive",
        "phi": 1e-3,  # a rate per sample; the modes of this plant are slow
        "gamma": 0.1,
    }
    models = {
        LTI: LinearStateSpace(**linear),
        GR: by_hand(GrSsnn, n_f=12, n_init=3, max_iter=300, polish_iter=60, **common),
        # few parameters: all samples at once, lest it ends above the linear start
        FL: by_hand(FlSsnn, n_h=10, n_init=3, **{**common, "coarse_samples": None}),
        AL: by_hand(
            AlSsnn,
            n_h=10,
            n_g=10,
            gamma=gamma / float(np.var(train.y)),
            n_init=2,
            max_iter=500,
            polish_iter=60,
            **common,
        ),
        STATE: by_hand(AlSsnn, n_h=10, n_g=10, polish_iter=60, **state, **common),
    }
    if quick:
        for model in models.values():
            shorten(model)
    return Study(
        key="prey",
        title="Prey and predator",
        unit="units of x3",
        train=train,
        test=test,
        models=models,
        view=6000,  # nearly five periods of the slow sines
    )


def shorten(model):
    """Set a model to a fit of seconds, which shows that all runs but reaches little."""
    if isinstance(model, LinearStateSpace):
        return model.set_params(max_iter=5)
    wanted = {
        "coarse_samples": 3000,
        "max_iter": 15,
        "polish_iter": 2,
        "n_init": 1,
        "continuation": 0,
    }
    known = model.get_params()
    return model.set_params(**{k: v for k, v in wanted.items() if k in known})


STUDIES = {"wh": wiener_hammerstein, "prey": prey_predator}


def run(study, report=None):
    """Fit all models of a study; return the fits by name, and by gamma."""
    by_model, fits = {}, {}

    def fit(model, data):
        if model not in by_model:
            by_model[model] = measure(model, *data)
        return by_model[model]

    data = study.train, study.test
    for name, model in study.models.items():
        fits[name] = fit(model, study.official if name == OFFICIAL else data)
        if report is not None:
            report(name, fits[name])
    gammas = {}
    for gamma, model in study.gammas.items():
        gammas[gamma] = fit(model, data)
        if report is not None:
            report(f"{AL}, gamma = {gamma:g}", gammas[gamma])
    return fits, gammas


def measure(model, train, test):
    """Fit a model and measure its errors and its linearity."""
    start = time.perf_counter()
    model.fit(train.u, train.y)
    seconds = time.perf_counter() - start
    return Fit(
        model,
        _error(train.y, model.predict(train.u, x0=model.x0_).reshape(train.y.shape)),
        _error(*model.simulate_test(test.u, test.y)),
        model.linearizability(test.u, test.y),
        seconds,
    )


def _error(y, y_hat):
    """Return the error, inf where the simulation diverges."""
    return rmse(y, y_hat) if np.isfinite(y_hat).all() else np.inf

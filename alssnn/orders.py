"""Orders: how many states, by the simulation error of linear models on hidden samples.

Singular values of a subspace step tell the order of a linear system in white noise.
A nonlinear plant has no order of that kind: its distortions show as further singular
values, without a gap.  What can be measured for every plant is how well a model of an
order simulates samples that it was not fitted to.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from .drift import count_walks, identify
from .holdout import hold_out
from .initial_states import WINDOW, estimate_x0
from .subspace import largest_order

SAMPLES = 8_000  # of a record, on which orders are compared
PATIENCE = 3  # larger orders without a gain, after which the search ends
# The same of smaller orders. Of the plant "boat" of `benchmarks.field` order 3 is 4 %
# worse than 4, and 2 as good: with one, FL-SSNN of order 4 then had no idle states.
PATIENCE_DOWN = 2
TOLERANCE = 0.03  # relative, of the error, for which a smaller order is taken
# Root mean square error of a linear model over that of the order that is taken, from
# which fewer states miss dynamics: networks do not try them. Networks with fewer states
# were chosen up to a ratio of 1.25, on the 72 plants of `benchmarks.field`.
MISSING = 2.0
NOISE = 1e-8  # least mean square error that an initial state is estimated for
SLOWEST = 0.5, 0.999  # bounds of the slowest pole, for states that are added
STEPS, TOL = 30, 1e-4  # of the refinement of every candidate


@dataclass(frozen=True, eq=False)
class Orders:
    """Hold linear models of several orders and their errors on hidden samples.

    Parameters
    ----------
    folds : list of Fold
        What the models were fitted to, and what judges them.
    models : dict of int to list of LinearModel
        By order: one model per fold.
    errors : dict of int to ndarray of shape (n_folds,)
        By order: mean square errors on the hidden samples, outputs of unit variance.
    idle : bool, default=True
        Whether networks of more states than are needed may begin with idle ones, too.
    """

    folds: list
    models: dict
    errors: dict
    idle: bool = True

    @property
    def nx(self):
        """Return the smallest order whose error is close to the least one."""
        total = {nx: np.mean(errors) for nx, errors in self.errors.items()}
        least = min(total.values())
        return min(
            nx for nx, error in total.items() if error <= (1 + TOLERANCE) ** 2 * least
        )

    def beside(self, nx, models):
        """Return these orders and one more.

        Parameters
        ----------
        nx : int
            Order.
        models : list of LinearModel
            One per fold.

        Returns
        -------
        orders : Orders
            New ones, the errors of the models among them.
        """
        pairs = zip(self.folds, models, strict=True)
        errors = np.array([fold.error(*_as_point(model)) for fold, model in pairs])
        return replace(
            self,
            models={**self.models, nx: models},
            errors={**self.errors, nx: errors},
        )

    def candidates(self, more, least):
        """Return the orders among which networks choose.

        Parameters
        ----------
        more : int
            Orders above `nx`, at most.
        least : int
            Orders up to this one are among them in any case.

        Returns
        -------
        orders : list of int
            From those on, of which the linear models miss no dynamics (eq. fewer).
        """
        curve, most = self.curve, max(self.nx + more, least)
        limit = MISSING * curve[self.nx]
        return sorted(
            nx
            for nx in self.models
            if nx <= most and (nx >= self.nx or curve[nx] <= limit)
        )

    def starts(self, nx):
        """Return the models from which networks of an order may start.

        Parameters
        ----------
        nx : int
            Order.

        Returns
        -------
        starts : list of list of LinearModel
            One model per fold each: those that were fitted, and beyond `nx` those of
            this order with idle states (eq. idle). There, what was fitted may have
            found a second mode of the plant, or poles that follow the distortions.
        """
        fitted = [self.models[nx]] if nx in self.models else []
        if nx <= self.nx or not self.idle:
            return fitted
        return [
            *fitted,
            [with_idle_states(model, nx) for model in self.models[self.nx]],
        ]

    @property
    def curve(self):
        """Return the root mean square error on hidden samples, by order."""
        errors = sorted(self.errors.items())
        return {nx: float(np.sqrt(np.mean(e))) for nx, e in errors}


def compare_orders(
    experiments,
    orders,
    *,
    feedthrough=False,
    model=None,
    integrators=0,
    watch=None,
    n_measured=0,
    **kind,
):
    """Fit linear models of several orders, and judge them on hidden samples.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    orders : iterable of int or None
        Orders to compare; None goes up from 1 until three in a row bring no gain.
    feedthrough : bool, default=False
        Whether D is free; else it is zero.
    model : LinearModel or None, default=None
        A model that is given: it is not fitted, only judged.
    integrators : int, default=0
        Number of its last states that integrate.
    watch : Watch or None, default=None
        May end the comparison, which then leaves the orders so far.
    n_measured : int, default=0
        Number of last inputs that are the measured outputs of a predictor.
    **kind : dict
        Random walk of a predictor, `drift` and `given` of `identify`.

    Returns
    -------
    orders : Orders
        The models and their errors.

    Raises
    ------
    ValueError
        If the longest experiment is too short for the least order.
    """
    # they keep what differs in an initial state, as integrators do
    walks = count_walks(experiments, n_measured, kind.get("drift"))
    folds = hold_out(experiments, integrators=integrators + walks)
    quiet = None if watch is None else watch.quiet()
    options = {
        "feedthrough": feedthrough,
        "max_iter": STEPS,
        "tol": TOL,
        "watch": quiet,
        "n_measured": n_measured,
        **kind,
    }
    found = Orders(folds, {}, {})
    if model is not None:
        return found.beside(len(model.A), [_started(model, fold) for fold in folds])
    highest = largest_order(experiments)
    for nx in range(1, highest + 1) if orders is None else sorted(set(orders)):
        found = found.beside(
            nx, [identify(fold.fitted, nx, **options) for fold in folds]
        )
        if quiet is not None and quiet.reason is not None:
            break
        total = {n: np.mean(e) for n, e in found.errors.items()}
        if orders is None and nx - min(total, key=lambda n: total[n]) >= PATIENCE:
            break
    return found


def compare_down(experiments, nx, **options):
    """Compare an order with those below it, until two in a row are worse.

    Parameters
    ----------
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.
    nx : int
        Order of the networks.
    **options : dict
        Of `compare_orders`.

    Returns
    -------
    orders : Orders
        The models and their errors, down to order 1 or to two that are worse.
    """
    orders = compare_orders(experiments, [nx], **options)
    for lower in range(nx - 1, 0, -1):
        one = compare_orders(experiments, [lower], **options)
        orders = replace(
            orders,
            models={**orders.models, **one.models},
            errors={**orders.errors, **one.errors},
        )
        if orders.nx - lower >= PATIENCE_DOWN:
            break
    return orders


def with_idle_states(model, nx):
    """Return a model with states that follow the inputs and act on nothing yet.

    Parameters
    ----------
    model : LinearModel
        Model of less than nx states.
    nx : int
        Number of states.

    Returns
    -------
    model : LinearModel
        The same outputs (eq. idle): the j-th of the further states has a pole (1 + j)
        times as fast as the slowest one of the model, and the variance one for a white
        input.
    """
    n, nu = model.B.shape
    slowest = np.clip(np.abs(np.linalg.eigvals(model.A)).max(initial=0.0), *SLOWEST)
    poles = slowest ** np.arange(2, nx - n + 2)
    B = np.zeros((len(poles), nu))
    j = np.arange(len(poles))
    B[j, j % nu] = np.sqrt(1.0 - poles**2)
    return replace(
        model,
        A=block_diag(model.A, np.diag(poles)),
        B=np.vstack([model.B, B]),
        C=np.hstack([model.C, np.zeros((len(model.C), len(poles)))]),
        x0=np.hstack([model.x0, np.zeros((len(model.x0), len(poles)))]),
        result=None,
    )


def _started(model, fold):
    """Return a model with the initial states of the experiments of a fold."""
    structure, theta, _ = model.as_fit()
    noise = max(fold.error(structure, theta, np.zeros_like(model.x0)), NOISE)
    x0 = estimate_x0(structure, theta, fold.fitted, window=WINDOW, noise=noise)
    return replace(model, x0=x0)


def _as_point(model):
    structure, theta, result = model.as_fit()
    return structure, theta, result.x0

"""Linear models of several orders, from which the networks of a search begin."""

from dataclasses import replace
from numbers import Integral

from ..drift import identify
from ..integrators import identify_integrating
from ..orders import STEPS, TOL, compare_down, compare_orders
from ..subspace import largest_order
from ._checks import order_choices
from ._noise import predicted

MORE_STATES = 1  # orders above that of the linear model, tried with networks
LEAST_STATES = 3  # orders that are tried in any case, unless they miss dynamics


def candidates(estimator, experiments, linear, watch, nx=None):
    """Return linear models, and the orders among which networks choose.

    Parameters
    ----------
    estimator : Ssnn
        Estimator in its fit.
    experiments : Held
        What the search sees.
    linear : LinearModel
        Linear model of the fit.
    watch : Watch
        May end it.
    nx : int or None, default=None
        Order that is given; None lets them choose.

    Returns
    -------
    orders : Orders
        Linear models of every fold, by order.
    among : list of int
        The orders.
    largest : int
        Up to this one, further ones follow as long as they gain.
    """
    n, is_given = len(linear.A), isinstance(estimator.nx, Integral)
    orders, is_auto = estimator._orders, isinstance(estimator.nx, str)
    if estimator.linear_start is not None or (estimator.integrators_ and is_given):
        given = {"model": linear, "integrators": estimator.integrators_}
        orders, among = compare_orders(experiments, None, **given), [n]
    elif estimator.integrators_:
        if orders is None or orders.idle:  # those of models without integrators
            orders = _integrating(estimator, experiments, linear, watch)
            estimator._orders = orders
        among = sorted(orders.models)
    elif orders is None:
        orders = compare_down(
            experiments,
            n,
            feedthrough=estimator.feedthrough,
            watch=watch,
            **predicted(estimator, experiments),
        )
        among = [n]
    else:
        among = sorted(orders.models)
    if nx is not None:
        return orders, [nx], 0
    # beyond those of integrators, there is no model to begin from
    if not is_auto or len(among) == 1 or not orders.idle:
        return orders, among, 0
    most = largest_order(experiments)
    return orders, orders.candidates(MORE_STATES, LEAST_STATES), most


def _integrating(estimator, experiments, linear, watch):
    """Return models with the integrators that were found, of orders about their own.

    All of them have seen the whole record: what quarters leave of a short one hardly
    tells how an integrator is moved, and networks that begin from that end elsewhere.
    """
    n, nx = estimator.integrators_, len(linear.A)
    if isinstance(estimator.nx, str):
        most = max(nx + MORE_STATES, LEAST_STATES)
        among = [*range(n, min(most, max(nx, largest_order(experiments))) + 1)]
    else:
        among = [order for order in order_choices(estimator.nx) if order >= n]
    quiet = watch.quiet()
    how = {"max_iter": STEPS, "tol": TOL, "watch": quiet}

    def judged(model):
        return compare_orders(experiments, None, model=model, integrators=n)

    orders = replace(judged(linear), idle=False)
    for order in among:
        if quiet.reason is not None:
            break
        if order != nx:
            plain = identify(
                experiments, order, feedthrough=estimator.feedthrough, **how
            )
            found = identify_integrating(experiments, plain, n, offset=False, **how)
            orders = orders.beside(order, judged(found.model).models[order])
    return orders

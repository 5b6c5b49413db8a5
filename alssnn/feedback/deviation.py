"""How far the output of a loop will be from its linear design (eq. carried).

The loop is that of a controller, with its observer, law, limits and integrators.  In
the place of the plant stand the model, and the model with the errors w that its record
does not rule out (`missed`).  All of them run side by side, a row each: the same
reference, the same law.  What they do is compared with the linear loop that was
designed, and so the part of the model alone, that of its known error and that of what
noise leaves open are all seen in the loop, which weighs them in its own way.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import dlsim

from ..plants import as_plant
from ..shown import short_repr
from .checks import check_signal
from .design import balanced_weights, lqi, lqr
from .loop import designed_loop
from .missed import what_is_missed
from .online import LinearizingController

DRAWS = 16  # plants that the record does not rule out
STEPS = 8  # of the reference, if none is given
LEAST, MOST = 20, 60  # samples between two of them
SETTLED = 0.01  # share of the slowest mode of the design that is left after them
REST = 150  # samples at the first reference, not counted, that a loop has to settle
DIVERGED = 1e6  # standard deviations of a state that no loop reaches


@dataclass(frozen=True, eq=False)
class DesignDistance:
    """Hold how far the output of a loop will be from its design (eq. carried).

    All are root mean squares over the standard deviation of the designed output.

    Parameters
    ----------
    distance : ndarray of shape (ny,)
        All of it: median over the plants that the record does not rule out; inf where
        most of their loops diverge.
    low, high : ndarray of shape (ny,)
        Four plants of five lie between these.
    by_model : ndarray of shape (ny,)
        With the model in the place of the plant: its g, sampling, the observer, limits.
    by_missed : ndarray of shape (ny,)
        By what the record shows that the model misses.
    by_noise : ndarray of shape (ny,)
        By what the noise of the record leaves open, median.
    outside : float or None
        Share of the samples of this loop outside the region of the training data.

    Examples
    --------
    >>> record = alssnn.datasets.make_wiener_hammerstein(800, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(*record)
    >>> from alssnn.feedback import design_distance
    >>> found = design_distance(model.plant_, model.prepare_records(*record))
    >>> found.distance.shape, bool(found.by_model[0] < 1e-6)
    ((1,), True)
    """

    __repr__ = short_repr

    distance: np.ndarray
    low: np.ndarray
    high: np.ndarray
    by_model: np.ndarray
    by_missed: np.ndarray
    by_noise: np.ndarray
    outside: float | None


def design_distance(model, records, controller=None, reference=None, d=None):
    """Return how far the output of a loop will be from its design (eq. carried).

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    records : sequence of PreparedRecord
        Experiments, of which `du`, `dy` and `x0` count.
    controller : LinearizingController or None, default=None
        Controller by a gain; None takes one by `balanced_weights`.
    reference : array_like of shape (N, nr) or None, default=None
        Reference, which the loop has settled at before it begins; None takes eight
        random steps within one standard deviation of the training data.
    d : array_like of shape (N, nd) or None, default=None
        Measured disturbances, in the units of u; None takes those of the record.

    Returns
    -------
    found : DesignDistance
        The distance and its parts.

    Raises
    ------
    TypeError
        If `controller` is none.
    ValueError
        If no controller can be designed, or sizes and sampling times do not fit.
    """
    plant = as_plant(model)
    controller = _checked(plant, controller)
    own = controller.own
    gain = controller.gain
    design = designed_loop(plant, gain)
    if reference is None:
        reference = _steps(controller, design)
    r = check_signal("reference", reference, None, len(controller.at_rest[0]))
    if d is None:
        du = np.vstack([record.du for record in records])
        d = np.resize(du[:, plant.given] + plant.d_offset, (len(r), plant.nd))
    d = check_signal("d", d, len(r), own.nd) if own.nd else np.zeros((len(r), 0))
    r, d = (np.vstack([np.repeat(z[:1], REST, axis=0), z]) for z in (r, d))
    missed = what_is_missed(plant, records)
    with np.errstate(all="ignore"):
        y_linear = _designed(controller, design, r, d)[REST:]
        signals = _run(controller, missed, r, d)
        return _judge(plant, y_linear, *(z[REST:] for z in signals))


def _checked(plant, controller):
    """Return a controller of the plant, a first one if none is given."""
    if controller is None:
        Q, R = balanced_weights(plant)
        nx = plant.late().nx
        tracks = plant.ny <= plant.nv
        gain = lqi(plant, Q, R) if tracks else lqr(plant, Q[:nx, :nx], R)
        return LinearizingController(plant, gain)
    if not isinstance(controller, LinearizingController) or controller.gain is None:
        raise TypeError(
            "`controller` must be a LinearizingController with a gain, got "
            f"{controller!r}. Take `model.controller(gain)`."
        )
    own = controller.model
    sizes, others = (
        (p.nx, p.nu, p.ny, tuple(p.moved), tuple(p.delay)) for p in (plant, own)
    )
    if sizes != others or not np.isclose(own.dt, plant.dt):
        raise ValueError(
            "`controller` must be made for this model at this sampling time, "
            f"{plant.dt:g} s, got one for {own!r}. Take `model.controller`."
        )
    return controller


def _steps(controller, design):
    """Return random steps of all references, within one standard deviation."""
    rest, size = controller.at_rest
    radius = float(np.abs(design.poles()).max())
    settled = np.log(SETTLED) / np.log(radius) if 0 < radius < 1 else LEAST
    hold = int(np.clip(np.ceil(settled), LEAST, MOST))
    levels = np.random.RandomState(0).uniform(-1, 1, (STEPS, len(rest)))
    steps = np.vstack([np.zeros_like(rest), np.repeat(levels, hold, axis=0)])
    return rest + size * steps


def _designed(controller, design, r, d):
    """Return the output of the linear loop."""
    own = controller.own
    driven = np.hstack([r - controller.at_rest[0], d - own.d_offset])
    linear = design.A, design.B, design.C, design.D, design.dt
    return dlsim(linear, driven)[1][:, : own.ny] + own.y_offset


def _run(controller, missed, r, d):
    """Return y, x and arrived du of all loops: the model's, that with w, the draws.

    Their shapes are (N, n_rows, n). What diverges is nan from there on.
    """
    own, linear, law = controller.own, controller.linear, controller.law
    theta = np.zeros((1, 0))
    if missed is not None:
        draws = missed.draw(DRAWS, np.random.RandomState(0))
        theta = np.vstack([np.zeros_like(missed.mean), missed.mean, draws])
    n, nv = len(theta), own.nv
    arrived = _Arrived(controller.model)
    X = X_next = np.zeros((n, own.nx))
    z, u = np.zeros((n, len(linear.A))), np.tile(own.v_offset, (n, 1))
    scale = own.x_scale
    x_size = np.concatenate([scale, np.full(own.nx - len(scale), np.inf)])
    shape = len(r), n
    every = [np.full((*shape, m), np.nan) for m in (own.ny, arrived.nx, own.nu)]
    alive = np.ones(n, dtype=bool)
    for k in range(len(r)):
        d_k, r_k = (np.tile(row, (n, 1)) for row in (d[k], r[k]))
        U = own.every_input(u, d_k)  # of the last sample: no algebraic loop
        y = own.output(X, U)
        x_hat = X
        if controller.observer is not None:
            gain = controller.observer.gain
            x_hat = X_next + (y - own.output(X_next, U)) @ gain.T
        none = np.zeros((n, nv if controller.integrates else 0))  # is cut off v
        e = np.hstack([r_k, y, x_hat, none]) - linear.offset
        v = linear.v_offset + z @ linear.C.T + e @ linear.D.T
        s = x_hat[:, : law.n_seen] if law.feedback == "state" else y
        u, cut = law.split(v, s, d_k if own.nd else None)
        if controller.integrates:
            e[:, -nv:] = cut
        z = z @ linear.A.T + e @ linear.B.T
        U = own.every_input(u, d_k)
        seen = arrived(X, U)
        for signal, value in zip(every, (own.output(X, U), *seen), strict=True):
            signal[k, alive] = value[alive]
        X, X_next = own.step(X, U), own.step(x_hat, U)
        if missed is not None:
            X[:, : arrived.nx] += missed.push(theta, *seen)
        sizes = X / x_size, X_next / x_size, (u - own.v_offset) / own.v_scale
        alive &= (np.abs(np.hstack(sizes)) < DIVERGED).all(axis=1)  # nan is not
        alive &= np.isfinite(z).all(axis=1)
        # what has diverged waits at the operating point
        lost = ~alive
        X[lost], X_next[lost], z[lost], u[lost] = 0.0, 0.0, 0.0, own.v_offset
    return every


class _Arrived:
    """Return states and inputs of the model without delay, of the one that has them."""

    def __init__(self, model):
        self.nx, self.offset = model.nx, model.u_offset
        first = model.nx + np.cumsum([0, *model.delay[:-1]])
        self.late, self.first = np.flatnonzero(model.delay), first

    def __call__(self, X, U):
        du = U - self.offset
        du[:, self.late] = X[:, self.first[self.late]]  # oldest first
        return X[:, : self.nx], du


def _judge(plant, y_linear, Y, X, du):
    """Return the distances, of loops in rows."""
    size = np.std(y_linear, axis=0)

    def rms(off):
        share = np.sqrt(np.mean(off**2, axis=0)) / np.where(size > 0, size, 1.0)
        return np.where(np.isfinite(share), share, np.inf)

    off = Y - y_linear[:, None]
    if len(off[0]) == 1:  # the model diverges along its record: nothing is known
        unknown = np.full(plant.ny, np.inf)
        return DesignDistance(
            unknown, unknown, unknown, rms(off)[0], unknown, unknown, outside=None
        )
    model, mean, draws = off[:, 0], off[:, 1], off[:, 2:]
    outside = None
    if plant.region is not None:
        seen = X[:, 1], du[:, 1], Y[:, 1] - plant.y_offset
        outside = float(plant.region.outside(*seen).mean())
    every = np.sort(rms(draws), axis=0)  # no quantile between inf and inf is a number
    low, middle, high = (every[round(q * (DRAWS - 1))] for q in (0.1, 0.5, 0.9))
    parts = rms(model), rms(mean - model), np.median(rms(draws - mean[:, None]), axis=0)
    return DesignDistance(middle, low, high, *parts, outside)

"""The whole loop as one Lur'e form: plant, observer, law, gain, integrators, limits.

The states are those of the plant, those that the observer predicts, and the
integrators, X = [x; x_p; z]; the inputs are references, measured disturbances and the
noise of the sensors.  The network stands in the loop twice, at (x, u) in the plant and
at (x_hat, u) in the observer; what the law evaluates is one of the two.  Limits of the
actuators are neurons as well.  The gate of the observer is taken as open: whoever uses
the form has to prove that what corrects the estimate stays below it.
"""

from dataclasses import dataclass

import numpy as np

from ..activations import Activation
from ..lure import Lure
from ._state_feedback import linear_form, matrices

SAME = 1e-9  # relative difference of weights of one and the same neuron
ROUNDING = 1e-13  # of the largest weight of a signal: what is none


@dataclass(frozen=True, eq=False)
class WholeLoop:
    """Hold a loop and its linear design.

    Parameters
    ----------
    lure : Lure
        Loop from [r; d; n] to the channels [y; u], and behind them what corrects the
        estimate, y + n - C x_p.
    design : tuple of ndarray
        (A, B, C, D) of the same loop with the linear part of the model, without limits,
        from [r; d; n] to y.
    twins : ndarray of int, shape (nw,)
        For every neuron of the plant the number of that of the observer with the same
        weights; -1 for others.
    """

    lure: Lure
    design: tuple
    twins: np.ndarray


@dataclass(frozen=True)
class _Limits:
    """Hold the limits of an actuator, and what an activation of them has to tell."""

    low: float
    high: float

    def value(self, v):
        return np.clip(v, self.low, self.high)

    def derivative(self, v, w):
        return 1.0 * ((v > self.low) & (v < self.high))

    def slopes(self, low, high):
        inside = (low >= self.low) & (high <= self.high)
        return 1.0 * inside, 1.0 * ((high > self.low) & (low < self.high))


def limit(low, high):
    """Return the activation of an actuator with limits, deviations.

    Parameters
    ----------
    low, high : float
        Limits, around the operating point.

    Returns
    -------
    activation : Activation
        Identity between the limits.
    """
    limits = _Limits(float(low), float(high))
    return Activation(
        f"limits {low:g} to {high:g}",
        limits.value,
        limits.derivative,
        slope=(0, 1),
        bound=float(max(abs(low), abs(high))),
        slope_range=limits.slopes,
    )


def whole_loop(controller, *, observer=True):
    """Return the loop of a controller around its own model.

    Parameters
    ----------
    controller : LinearizingController
        Controller with a gain, a law and an observer of constant gain.
    observer : bool, default=True
        Whether the observer is part of the loop; else x_hat is x, as it is from rest
        without noise, and there are no inputs n.

    Returns
    -------
    loop : WholeLoop
        The loop and its design.

    Raises
    ------
    ValueError
        If the controller has no gain or no observer of constant gain, y depends on u
        of the same sample, or the law is solved at every sample.
    """
    plant, law = controller.own, controller.law
    kind = getattr(controller.observer, "kind", None)
    needs = [
        (controller.gain is not None, "a gain in place of a linear system"),
        (kind == "kalman" or not observer, "an observer of kind 'kalman'"),
        (plant.has_linear_output, "a model with y = C x"),
        (plant.is_explicit and not plant.looks_ahead, "a law u = v - h(s)"),
        (_same(law.plant.late(), plant), "a law of its own model"),
        (
            not observer or kind is None or _same(controller.observer.plant, plant),
            "an observer of its own model",
        ),
    ]
    for is_met, need in needs:
        if not is_met:
            raise ValueError(
                f"`controller` must have {need} for a certificate of the whole loop. "
                "Certify the loop of the state alone: `model.local_certificate(K=K)`."
            )
    if plant.no_law:
        raise ValueError(plant.no_law)
    limits = np.stack([law.u_min, law.u_max]) - plant.v_offset
    lure, twins = _Wires(plant.form, controller, limits, observer).lure()
    free = np.full_like(limits, np.inf)
    design, _ = _Wires(linear_form(plant), controller, free, observer).lure()
    A, B, C, D = matrices(design)
    return WholeLoop(lure, (A, B, C[: plant.ny], D[: plant.ny]), twins)


def _same(plant, other):
    """Return whether two plants have the same equations and operating point."""
    return plant is other or (
        np.array_equal(plant.form.Theta, other.form.Theta)
        and np.array_equal(plant.law_form.Theta, other.law_form.Theta)
        and np.array_equal(plant.u_offset, other.u_offset)
        and np.array_equal(plant.y_offset, other.y_offset)
    )


class _Wires:
    """Write every signal of the loop as a row over [X; r; d; n; w; 1]."""

    def __init__(self, form, controller, limits, observer):
        self.own = own = controller.own
        self.form, self.controller, self.limits = form, controller, limits
        self.law = own.law_form if form.nw or own.law_form.nw else None
        if form is not own.form:  # the linear design
            self.law = None
        self.limited = np.isfinite(limits).any(axis=0)
        self.gain = controller.observer.gain if observer else None
        nx, ny, nw = own.nx, own.ny, form.nw
        sizes = {
            "x": nx,
            "x_p": nx if observer else 0,
            "z": len(controller.linear.A),
            "r": ny if controller.tracks else own.nv,
            "d": own.nd,
            "n": ny if observer else 0,
            "plant": nw,
            "observer": nw if observer else 0,
            "law": 0 if self.law is None else self.law.nw,
            "limit": int(self.limited.sum()),
            "one": 1,
        }
        ends = np.cumsum(list(sizes.values()))
        parts = np.split(np.eye(ends[-1]), ends[:-1])
        self.at = dict(zip(sizes, parts, strict=True))
        self.nX, self.n_in = int(ends[2]), int(ends[5] - ends[2])

    def lure(self):
        """Return the form, and for every neuron of the plant its twin."""
        at, own, linear = self.at, self.own, self.controller.linear
        nx, ny, nv = own.nx, own.ny, own.nv
        C = self.form.M[nx : nx + ny, :nx]
        y = seen = C @ at["x"]
        x_hat = at["x"]
        if self.gain is not None:
            seen = y + at["n"]
            x_hat = at["x_p"] + self.gain @ (seen - C @ at["x_p"])
        cut = np.zeros((nv if len(linear.A) else 0, y.shape[1]))
        e = np.vstack([at["r"], seen, x_hat, cut])
        v = linear.C @ at["z"] + linear.D @ e
        u, law_sees = self._law(v, seen, x_hat)
        sent = u.copy()
        sent[self.limited] = at["limit"]
        if len(cut):
            e[-nv:] = u - sent
        x_next, plant_sees = self._model(at["x"], sent, at["plant"])
        rows, sees = [x_next], [plant_sees]
        if self.gain is not None:
            x_p, observer_sees = self._model(x_hat, sent, at["observer"])
            rows, sees = [*rows, x_p], [*sees, observer_sees]
        rows += [linear.A @ at["z"] + linear.B @ e, y, sent]
        if self.gain is not None:
            rows.append(seen - C @ at["x_p"])
        sees += [law_sees, u[self.limited]]
        return self._ordered(np.vstack(rows), np.vstack(sees))

    def _model(self, x, u, w):
        """Return x+ and what the neurons w of the model see, at x and u."""
        own, form, at = self.own, self.form, self.at
        every = np.empty((own.nu, x.shape[1]))
        every[own.moved], every[list(own.given)] = u, at["d"]
        Phi = np.vstack([x, every, w, at["one"]])
        return form.rows_x @ Phi, form.rows_v @ Phi

    def _law(self, v, seen, x_hat):
        """Return u = v - h(s) and what the neurons of h see."""
        if self.law is None:
            return v, np.zeros((0, v.shape[1]))
        law, own, at = self.law, self.own, self.at
        s = x_hat[: law.nu - own.nd - own.nv] if own.feedback == "state" else seen
        Phi = np.vstack([s, at["d"], np.zeros_like(v), at["law"], at["one"]])
        return v - law.rows_z @ Phi, law.rows_v @ Phi

    def _ordered(self, rows, sees):
        """Return the form with neurons in the order of their evaluation."""
        nw, is_watched = self.form.nw, self.gain is not None
        sigma = list(self.form.sigma) * (1 + is_watched)
        n_model = len(sigma)
        sigma += [] if self.law is None else list(self.law.sigma)
        n_known = len(sigma)
        sigma += [limit(low, high) for low, high in self.limits.T[self.limited]]
        n, first = len(sigma), self.nX + self.n_in
        Theta, k = np.vstack([rows, sees]), len(rows)
        keep, widest = np.ones(n, dtype=bool), np.abs(sees).max(axis=0, initial=0.0)
        for i in range(n_model, n_known):  # of the law: one of plant or observer
            for j in range(n_model):
                off = np.abs(Theta[k + i] - Theta[k + j])
                size = np.maximum(np.abs(Theta[k + i]), np.abs(Theta[k + j]))
                same = np.all(off <= SAME * size + ROUNDING * widest)
                if same and sigma[i] is sigma[j]:
                    Theta[:, first + j] += Theta[:, first + i]
                    Theta[:, first + i] = 0.0
                    keep[i] = False
                    break
        order = _order(Theta[k:, first : first + n] != 0, keep, sigma)
        place = np.full(n, -1)
        place[order] = np.arange(len(order))
        twins = np.where(np.arange(n) < nw * is_watched, np.arange(n) + nw, -1)[order]
        columns = np.r_[:first, first + order, first + n]
        Theta = Theta[np.r_[:k, k + order]][:, columns]
        twins = np.where(twins >= 0, place[twins], -1)
        ordered = tuple(sigma[i] for i in order)
        return Lure(Theta, self.nX, self.n_in, len(order), ordered), twins


def _order(sees, keep, sigma):
    """Return neurons in the order of evaluation, those of one activation together."""
    order, ready = [], ~keep
    while not ready.all():
        free = ~ready & ~(sees & ~ready).any(axis=1)
        free = free if free.any() else ~ready  # these are solved together
        order += sorted(np.flatnonzero(free), key=lambda i: sigma[i].name)
        ready = ready | free
    return np.array(order, dtype=int)

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
from ..forms import part
from ..lure import Lure
from ._neurons import renumbered
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
        For every neuron of the plant, or of a law before limits, the number of that of
        the observer with the same weights; -1 for others.
    watches : bool
        Whether the observer is part of the loop.
    """

    lure: Lure
    design: tuple
    twins: np.ndarray
    watches: bool


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
        of the same sample, or the law looks ahead.
    """
    plant, law = controller.own, controller.law
    kind = getattr(controller.observer, "kind", None)
    needs = [
        (controller.gain is not None, "a gain in place of a linear system"),
        (kind == "kalman" or not observer, "an observer of kind 'kalman'"),
        (plant.has_linear_output, "a model with y = C x"),
        (not plant.looks_ahead, "a law that does not look ahead"),
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
    return WholeLoop(lure, (A, B, C[: plant.ny], D[: plant.ny]), twins, observer)


def _same(plant, other):
    """Return whether two plants have the same equations and operating point."""
    parts = (
        (one.form.Theta, one.law_form.Theta, one.u_offset, one.y_offset)
        for one in (plant, other)
    )
    return all(map(np.array_equal, *parts))


class _Wires:
    """Write every signal of the loop as a row over [X; r; d; n; w; 1]."""

    def __init__(self, form, controller, limits, observer):
        self.own = own = controller.own
        self.form, self.controller, self.limits = form, controller, limits
        # the design has none
        has_law = form is own.form and (form.nw or own.law_form.nw)
        self.law: Lure | None = own.law_form if has_law else None
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
            "reached": own.law_form.nw if self._cuts_solved() else 0,
            "limit": int(self.limited.sum()),
            "one": 1,
        }
        ends = np.cumsum(list(sizes.values()))
        parts = np.split(np.eye(ends[-1]), ends[:-1])
        self.at = dict(zip(sizes, parts, strict=True))
        self.nX, self.n_in = int(ends[2]), int(ends[5] - ends[2])

    def _cuts_solved(self):
        """Return whether what limits take off v is that of a law that is solved."""
        is_solved = self.law is not None and self.own.is_solved
        return is_solved and self.limited.any() and len(self.controller.linear.A) > 0

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
        s = seen if own.feedback == "output" else x_hat
        u, law_sees = self._law(v, s)
        sent = u.copy()
        sent[self.limited] = at["limit"]
        if self._cuts_solved():  # phi couples inputs
            e[-nv:] = v - own.law_form.rows_z @ self._static(sent, s, "reached")
        elif len(cut):
            e[-nv:] = u - sent
        x_next, plant_sees = self._model(at["x"], sent, at["plant"])
        rows, sees = [x_next], [plant_sees]
        if self.gain is not None:
            x_p, observer_sees = self._model(x_hat, sent, at["observer"])
            rows, sees = [*rows, x_p], [*sees, observer_sees]
        rows += [linear.A @ at["z"] + linear.B @ e, y, sent]
        if self.gain is not None:
            rows.append(seen - C @ at["x_p"])
        sees.append(law_sees)
        if self._cuts_solved():
            sees.append(self._sees(sent, s, "reached"))
        sees.append(u[self.limited])
        estimated = C @ x_hat if own.feedback == "output" else x_hat
        alike = [self._sees(sent, estimated)] * (1 + self._cuts_solved())
        return self._ordered(np.vstack(rows), np.vstack(sees), np.vstack(alike))

    def _model(self, x, u, w):
        """Return x+ and what the neurons w of the model see, at x and u."""
        own, form, at = self.own, self.form, self.at
        every = np.empty((own.nu, x.shape[1]))
        every[own.moved], every[list(own.given)] = u, at["d"]
        Phi = np.vstack([x, every, w, at["one"]])
        return form.rows_x @ Phi, form.rows_v @ Phi

    def _law(self, v, s):
        """Return u, which solves v = phi(u, s), and what the neurons of h see."""
        if self.law is None:
            return v, self._sees(v, s)
        law, own = self.law, self.own
        first = law.nu - own.nv
        by_u = law.rows_z[:, first : first + own.nv]
        u = np.linalg.solve(by_u, v - law.rows_z @ self._static(np.zeros_like(v), s))
        return u, self._sees(u, s)

    def _sees(self, u, s, neurons="law"):
        """Return what the neurons of h see at u and s."""
        if self.law is None:
            return np.zeros((0, u.shape[1]))
        return self.law.rows_v @ self._static(u, s, neurons)

    def _static(self, u, s, neurons="law"):
        """Return what goes into the static map of the law."""
        at, ns = self.at, self.own.law_form.nu - self.own.nd - self.own.nv
        return np.vstack([s[:ns], at["d"], u, at[neurons], at["one"]])

    def _ordered(self, rows, sees, estimated):
        """Return the form with neurons in the order of their evaluation.

        `estimated` is what the neurons of the law would see at the estimate, within
        the limits: those of the observer do.
        """
        nw, is_watched = self.form.nw, self.gain is not None
        sigma = list(self.form.sigma) * (1 + is_watched)
        n_model = len(sigma)
        if self.law is not None:
            sigma += list(self.law.sigma) * (1 + self._cuts_solved())
        n_known = len(sigma)
        sigma += [limit(low, high) for low, high in self.limits.T[self.limited]]
        n, first = len(sigma), self.nX + self.n_in
        Theta, k = np.vstack([rows, sees]), len(rows)
        keep, widest = np.ones(n, dtype=bool), np.abs(sees).max(axis=0, initial=0.0)
        twins = np.where(np.arange(n) < nw * is_watched, np.arange(n) + nw, -1)

        def is_same(row, j):
            off, size = np.abs(row - Theta[k + j]), np.abs([row, Theta[k + j]])
            return np.all(off <= SAME * size.max(axis=0) + ROUNDING * widest)

        for i in range(n_model, n_known):  # of the law: one of plant or observer
            alike = [j for j in range(n_model) if sigma[i] is sigma[j]]
            same = next((j for j in alike if is_same(Theta[k + i], j)), None)
            if same is not None:
                Theta[:, first + same] += Theta[:, first + i]
                Theta[:, first + i] = 0.0
                keep[i] = False
                continue
            row = estimated[i - n_model]
            twins[i] = next((j for j in alike if twins[j] < 0 and is_same(row, j)), -1)
        order = _order(Theta[k:, first : first + n] != 0, keep, sigma)
        form = Lure(Theta, self.nX, self.n_in, n, tuple(sigma))
        return part(form, order), renumbered(twins, order)


def _order(sees, keep, sigma):
    """Return neurons in the order of evaluation, those of one activation together."""
    order, ready, n = [], ~keep, len(sees)
    while not ready.all():
        free = ~ready & ~(sees & ~ready).any(axis=1)
        if not free.any():  # the fewest that see each other are solved together
            waiting = sees & ~ready[:, None] & ~ready
            # what every neuron sees, by way of others, and itself
            behind = np.linalg.matrix_power(waiting | np.eye(n, dtype=bool), n)
            behind[ready] = True
            free = behind[behind.sum(axis=1).argmin()] & ~ready
        order += sorted(np.flatnonzero(free), key=lambda i: sigma[i].name)
        ready = ready | free
    return np.array(order, dtype=int)

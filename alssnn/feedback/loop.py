"""Closed loops: plant, linearizing law, controller and observer, connected by name.

    r -> controller -> v -> law -> u -> plant -> y,    observer: (u, y) -> x_hat

All signals are in the user's units.  Around a strictly proper plant every signal
follows from those before it; around another one `algebraic` solves for u.
"""

import control
import numpy as np

from ..plants import as_plant, is_model
from .algebraic import AlgebraicLoop, feeds_through
from .controller import from_gain
from .export import Block, as_system, check_plant, signal_names, to_statespace
from .online import LinearizingController


def closed_loop(plant, model, gain=None, *, controller=None, observer=None, law=None):
    """Return the closed loop of a plant and a controller designed on a model.

    Exactly one of `gain` and `controller` is given.

    Parameters
    ----------
    plant : estimator, Plant or system of python-control
        What is controlled, from u to y in the user's units (operating point
        included): the model itself, another fitted model, or any discrete-time
        system. Its inputs are those of the record, measured disturbances among them.
    model : estimator, Plant or LinearizingController
        Fitted model, or its `plant_`, that law, gain and observer are made from; or a
        controller, which has them: all other arguments are left out then.
    gain : array_like of shape (nv, nx) or (nv, nx + ny) or None, default=None
        Static gain on the state, v = r - K x_hat with r in the units of u; or, with
        integrators (`lqi`), v = u_offset - K [x_hat; z], z+ = z + y - r with r in the
        units of y.
    controller : control.StateSpace, control.TransferFunction or None, default=None
        Discrete-time controller with output v and the inputs (r, y), or r - y alone;
        it acts on deviations from the operating point. r has the units of y.
    observer : Observer or None, default=None
        Source of x_hat, of either kind. None takes the true state if `plant` is
        `model`, and else ``model.observer(gate=100)``. Left out where nothing needs
        x_hat.
    law : LinearizingLaw or None, default=None
        Linearizing law, for example with limits; None takes
        ``model.linearizing_law()``.

    Returns
    -------
    loop : control.NonlinearIOSystem
        Discrete-time system, interconnected of its blocks if the plant is strictly
        proper, with inputs ``r[0]``, ..., then measured disturbances if the model has
        any, and outputs y, u (names of the training data) and ``v[0]``, ...; at rest
        at the operating point, r equals u_offset (static gain) or y_offset.

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    TypeError
        If plant, controller, observer or law is of another type.
    ValueError
        If sizes or sampling times do not fit, a system is continuous in time, not
        exactly one of `gain` and `controller` is given, or the plant has a direct
        feedthrough with which the loop is not well-posed. A simulation raises it where
        u has no solution.

    Notes
    -----
    Integrators do not wind up while an actuator saturates: by back-calculation they
    take the value with which v stays at the limit, z+ = z + y - r + K_z^+ cut, where
    K_z^+ is the pseudoinverse of their gain and cut = v - h - u. A `controller` of your
    own is left as it is.

    A plant with direct feedthrough, y = C x + D u + k(x, u), closes an algebraic loop
    with what acts on u at once: an observer, which corrects by y; a law of y; a
    controller with a direct path. It is solved at every sample, by Newton's method
    from the operating point. With the true state and a law of it there is none.

    python-control has no samples that were not measured: where y is nan, run a
    `LinearizingController` by its `simulate` or `step`.

    Examples
    --------
    >>> from alssnn.feedback import closed_loop, lqi
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> loop = closed_loop(model, model, lqi(model, np.eye(5), np.eye(1)))
    >>> loop.input_labels, loop.output_labels
    (['r[0]'], ['y[0]', 'u[0]', 'v[0]'])
    """
    parts = _assemble(plant, model, gain, controller, observer, law)
    own, names = parts.own, _Names(parts)
    shows_state = parts.needs_state and parts.observer is None
    if shows_state and not (is_model(plant) and as_plant(plant) is parts.model):
        raise ValueError(
            "`observer` of the controller must not be False unless `plant` is its own "
            "model, whose true state the loop can take. Leave it out for the default."
        )
    plant = names.plant(plant, shows_state)
    blocks = [names.controller(parts.linear), names.law(parts.law)]
    watch = [] if parts.observer is None else [names.observer(parts.observer)]
    if feeds_through(plant, own.u_offset, own.u_scale):
        return names.solve([plant, *watch, *blocks])
    return names.connect([plant, *blocks, *watch])


def _assemble(plant, model, gain, controller, observer, law):
    """Return the controller of a loop; one without observer sees the true state."""
    if isinstance(model, LinearizingController):
        given = {"gain": gain, "controller": controller}
        given |= {"observer": observer, "law": law}
        named = [f"`{name}`" for name, part in given.items() if part is not None]
        if named:
            raise ValueError(
                f"{' and '.join(named)} must be None beside a controller, which has "
                "its own. Make another controller."
            )
        return model
    if (gain is None) == (controller is None):
        raise ValueError(
            "Exactly one of `gain` and `controller` must be given, got "
            f"{'none' if gain is None else 'both'}."
        )
    if observer is None and is_model(plant) and as_plant(plant) is as_plant(model):
        observer = False
    options = {"controller": controller, "observer": observer, "law": law}
    return LinearizingController(model, gain, **options)


def designed_loop(model, gain):
    """Return the linear loop that a gain was designed for.

    That is what `closed_loop` would be if the law left exactly (A, B, C, D): the
    response to compare the true one with, and the poles that were chosen.

    Parameters
    ----------
    model : estimator or Plant
        Fitted model, or its `plant_`.
    gain : array_like of shape (nv, nx) or (nv, nx + ny)
        Gain, as for `closed_loop`.

    Returns
    -------
    loop : control.StateSpace
        Discrete-time system of deviations from the operating point, with inputs
        ``r[0]``, ..., then measured disturbances if the model has any, and outputs y
        (names of the training data) and ``v[0]``, ...

    Raises
    ------
    NotFittedError
        If the model is not fitted.
    ValueError
        If the gain has the wrong shape.

    Examples
    --------
    >>> from alssnn.feedback import designed_loop, lqi
    >>> record = alssnn.datasets.make_wiener_hammerstein(1500, random_state=0)
    >>> model = alssnn.LinearStateSpace(nx=4, dt=record.dt).fit(record.u, record.y)
    >>> loop = designed_loop(model, lqi(model, np.eye(5), np.eye(1)))
    >>> bool(abs(loop.poles()).max() < 1)
    True
    """
    plant = as_plant(model).late()
    block, of_y = from_gain(gain, plant)
    (A, B, C, D), (G, H) = plant.linear(), plant.disturbed_by()
    (nx, nv), ny = B.shape, len(C)
    nr = ny if of_y else nv
    # the controller sees (r, y, x_hat) with x_hat = x, and nothing is cut; its v
    # does not depend on y, which has D v in it
    r, y, x = np.split(np.arange(nr + ny + nx), [nr, nr + ny])
    v_x, v_z, v_r = block.D[:, x], block.C, block.D[:, r]
    B_y = block.B[:, y]
    return to_statespace(
        np.block(
            [
                [A + B @ v_x, B @ v_z],
                [block.B[:, x] + B_y @ (C + D @ v_x), block.A + B_y @ D @ v_z],
            ]
        ),
        np.block([[B @ v_r, G], [block.B[:, r] + B_y @ D @ v_r, B_y @ H]]),
        np.block([[C + D @ v_x, D @ v_z], [v_x, v_z]]),
        np.block([[D @ v_r, H], [v_r, np.zeros((nv, plant.nd))]]),
        plant.dt,
        inputs=[*signal_names(None, "r", nr), *(plant.inputs[i] for i in plant.given)],
        outputs=[*plant.outputs, *signal_names(None, "v", nv)],
        name="designed_loop",
    )


class _Gated:
    """Let an observer tell what it believes of y, beside its estimate."""

    def __init__(self, observer):
        self.observer, self.update = observer, observer.update

    def output(self, t, z, signals, params):
        x_hat = self.observer.output(t, z, signals, params)
        return np.concatenate([x_hat, self.observer.believed(z, signals)])


class _Names:
    """Name the signals inside the loop alike, whatever the user calls them."""

    def __init__(self, parts):
        own = parts.own
        nx, nv, ny = own.nx, own.nv, own.ny
        self.own, self.by_state = own, parts.gain is not None
        self.r_at_rest = parts.at_rest[0]
        self.x = signal_names(None, "x_hat", nx)
        self.u, self.v = (signal_names(None, letter, nv) for letter in "uv")
        self.d = signal_names(None, "d", own.nd)
        self.inputs = [*own.every_input(np.array(self.u), np.array(self.d))]
        self.y = signal_names(None, "y", ny)
        gated = getattr(parts.observer, "gate", None) is not None
        # what the controller, its integrators and a law of y take for y
        self.seen = signal_names(None, "y_seen", ny) if gated else self.y
        self.cut = signal_names(None, "cut", nv) if parts.integrates else []
        self.r = signal_names(None, "r", len(self.r_at_rest))
        given, moved = ([own.inputs[i] for i in z] for z in (own.given, own.moved))
        # those of the loop, made unique
        self.external = signal_names([*self.r, *given])
        self.shown = signal_names([*own.outputs, *moved, *self.v])

    def plant(self, plant, with_state):
        own = self.own
        if with_state:
            signals = self.inputs, self.y + self.x, own.nx
            return as_system(Block(own, with_state=True), *signals, own.dt, "plant")
        plant = check_plant(plant, own)
        plant = plant.copy(name="plant", use_prefix_suffix=False)
        plant.update_names(inputs=self.inputs, outputs=self.y)
        return plant

    def controller(self, block):
        inputs = self.r + self.seen + (self.x if self.by_state else []) + self.cut
        signals = inputs, self.v, len(block.A)
        return as_system(block, *signals, self.own.dt, "controller")

    def law(self, law):
        s = self.x[: law.n_seen] if law.feedback == "state" else self.seen
        sys = law.to_nlsys(with_cut=bool(self.cut))
        sys.update_names(inputs=self.v + s + self.d, outputs=self.u + self.cut)
        return sys

    def observer(self, observer):
        sys, inputs = observer.to_nlsys(), self.inputs + self.y
        if self.seen is self.y:
            sys.update_names(inputs=inputs, outputs=self.x)
            return sys
        signals = inputs, self.x + self.seen, sys.state_labels
        return as_system(_Gated(observer), *signals, sys.dt, "observer")

    def solve(self, blocks):
        own = self.own
        signals = self.r + self.d, self.u, self.y + self.u + self.v
        loop = AlgebraicLoop(blocks, *signals, own.v_offset, own.v_scale)
        loop.check(np.concatenate([self.r_at_rest, own.d_offset]))
        states = [f"{b.name}_{state}" for b in blocks for state in b.state_labels]
        return as_system(loop, self.external, self.shown, states, own.dt, "loop")

    def connect(self, blocks):
        return control.interconnect(
            blocks,
            inplist=[
                *(f"controller.{name}" for name in self.r),
                *(
                    [f"{b.name}.{name}" for b in blocks if name in b.input_labels]
                    for name in self.d
                ),
            ],
            outlist=[
                *(f"plant.{name}" for name in self.y),
                *(f"law.{name}" for name in self.u),
                *(f"controller.{name}" for name in self.v),
            ],
            inputs=self.external,
            outputs=self.shown,
            name="loop",
            check_unused=False,
        )

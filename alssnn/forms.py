"""Lur'e forms of plants, with the channels [y; v], and what becomes of them.

A `Plant` holds such a form in the user's units; its verbs change it here: past inputs
or a disturbance become states, the law closes the loop, and what the linear part lacks
becomes a channel.  The last channels are v, one for every input that is moved; `moved`
are the numbers of these inputs, and the others are measured disturbances (eq.
disturbance).
"""

import numpy as np

from .checks import check_option
from .innovations import LEVEL, MEASURED, drift_of, has_innovations, predictor
from .inputs import split_inputs
from .lure import Lure
from .simulation import neuron_gains, regressors

ROUNDING = 64 * np.finfo(float).eps  # relative: a sum below it is zero


def of_structure(structure, theta, units):
    """Return the forms of a plant, in the user's units.

    Parameters
    ----------
    structure : Structure
        Structure of a model with the axes x, u and y.
    theta : ndarray of shape (n_params,)
        Its parameters.
    units : dict of str to ndarray
        The user's units over those of theta, of u, x and y.

    Returns
    -------
    forms : dict
        `form`, `law_form`, `feedback`, `given`, `K`, `drift` and `K_b` of a `Plant`.
    """
    moved, given = split_inputs(structure.nu, structure.given)
    told = {"given": tuple(map(int, given))}
    units = structure.by_axis(units)
    units["v"] = units["moved"]
    if has_innovations(structure):
        told |= _innovation_gains(structure, theta, units)
    if "v" not in structure.signals:  # nothing that a law could cancel
        lure = _in_units(structure.observe("y"), theta, units)
        nx, ny, nd, nm = lure.nx, structure.sizes["y"], len(given), len(moved)
        v = only_input(lure, moved)
        Theta = np.insert(lure.Theta, [nx + ny] * nm, v, axis=0)
        form = Lure(Theta, nx, lure.nu, lure.nw, lure.sigma)
        static = Lure(np.eye(nm, ny + nd + nm + 1, ny + nd), 0, ny + nd + nm, 0)
        return {**told, "form": form, "law_form": static, "feedback": "output"}
    law = structure.law()
    static = _in_units(law, law.join(structure.split(theta)), units)
    if "disturbances" in structure.options:  # u stands there as a record has it
        ns = static.nu - structure.nu
        order = np.r_[:ns, ns + given, ns + moved, static.nu : static.Theta.shape[1]]
        Theta = static.Theta[:, order]
        static = Lure(Theta, 0, static.nu, static.nw, static.sigma)
    return {
        **told,
        "form": _in_units(structure.observe("y", "v"), theta, units),
        "law_form": static,
        "feedback": "state" if law.inputs[0] == "x" else "output",
    }


def _innovation_gains(structure, theta, units):
    """Return what a measured output does to state and drift, at the operating point."""
    seen, drift = predictor(structure.observe(structure.measured)), drift_of(structure)
    units = {**units, MEASURED: units["y"]}
    if drift is not None:
        units[LEVEL] = units["y" if drift == "output" else "moved"]
    lure = _in_units(seen, theta, units)
    at_rest = regressors(lure, np.zeros((1, lure.nx)), np.zeros((1, lure.nu)))
    J = lure.M[: lure.nx] + neuron_gains(lure, lure.W[: lure.nx], at_rest)[0] @ lure.V
    gains = J[:, lure.nx + seen.nu - units["y"].size :]
    K, K_b = np.split(gains, [seen.sizes["x"]])
    return {"K": K} if drift is None else {"K": K, "drift": drift, "K_b": K_b}


def _in_units(structure, theta, units):
    """Return a Lur'e form in other units, by axis."""
    lure = structure.lure(theta)
    by_row, by_column = (np.ones(n) for n in lure.Theta.shape)
    for axis, unit in units.items():
        for places, scale in ((structure.rows, by_row), (structure.cols, by_column)):
            if axis in places:
                scale[places[axis]] = unit
    # as parameters are rescaled, to the last digit; what is one stays one
    Theta = lure.Theta * by_row[:, None] / by_column
    form = Lure(Theta, lure.nx, lure.nu, lure.nw, lure.sigma)
    return form if structure.sampling is None else without_passing(form)


def without_passing(form):
    """Return a form without the neurons that pass on what they see.

    Parameters
    ----------
    form : Lure
        Form, some of whose neurons have the activation "identity".

    Returns
    -------
    form : Lure
        The same map; the weights of what they saw stand in their places.
    """
    passing = np.array([sigma.name == "identity" for sigma in form.sigma], dtype=bool)
    first, n = form.nx + form.nu, form.nx + form.nz
    columns, rows = first + np.flatnonzero(passing), n + np.flatnonzero(passing)
    Theta, kept = form.Theta.copy(), np.flatnonzero(~passing)
    for row, column in zip(rows, columns, strict=True):  # which see earlier ones only
        Theta += Theta[:, [column]] * Theta[row]
        Theta[:, column] = 0.0
    Theta = np.delete(np.delete(Theta, rows, axis=0), columns, axis=1)
    sigma = tuple(form.sigma[i] for i in kept)
    return Lure(Theta, form.nx, form.nu, len(kept), sigma)


def late_inputs(form, delay, moved):
    """Return a form with the past of late inputs as states.

    Parameters
    ----------
    form : Lure
        Form with the inputs that have arrived.
    delay : ndarray of int of shape (nu,)
        Samples by which every input arrives late.
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    form : Lure
        Form with sum(delay) more states: for each input its last values, oldest
        first. Its inputs, and its v, are what is sent now.
    """
    nx, nu, n = form.nx, form.nu, int(np.sum(delay))
    states, inputs, rest = np.split(form.Theta, [nx, nx + nu], axis=1)
    past, now = np.zeros((len(form.Theta), n)), inputs.copy()
    shift, entry = np.eye(n, k=1), np.zeros((n, nu))
    stops = np.cumsum(delay)
    for i in np.flatnonzero(delay):
        oldest, newest = stops[i] - delay[i], stops[i] - 1
        past[:, oldest], now[:, i] = inputs[:, i], 0.0
        shift[newest] = 0.0
        entry[newest, i] = 1.0
    v = virtual(form, moved)
    past[v], now[v] = 0.0, inputs[v]  # v is sent now, as u is
    plus, others = np.split(np.hstack([states, past, now, rest]), [nx])
    line = np.hstack([np.zeros((n, nx)), shift, entry, np.zeros((n, rest.shape[1]))])
    return Lure(np.vstack([plus, line, others]), nx + n, nu, form.nw, form.sigma)


def disturbed(form, kind, moved):
    """Return the form of the state [x; d] with a constant disturbance d.

    Parameters
    ----------
    form : Lure
        Form of a plant.
    kind : {"output", "input"}
        Whether d is added to y or to u.
    moved : ndarray of int
        Inputs that v makes, and to which d may be added.

    Returns
    -------
    form : Lure
        Form with as many more states, the last, which stay as they are; its v is that
        of the form without d where v = u + h(s).

    Raises
    ------
    ValueError
        If `kind` is unknown.
    """
    remedy = "Use 'input' if the model integrates."
    check_option("kind", kind, ("output", "input"), remedy)
    nx, nu, v = form.nx, form.nu, virtual(form, moved)
    if kind == "input":
        by_d = form.Theta[:, nx + moved]
    else:
        by_d = np.eye(len(form.Theta))[:, nx : v.start]
    by_d[v] = 0.0
    nd = by_d.shape[1]
    Theta = np.insert(form.Theta, [nx] * nd, by_d, axis=1)
    keep = np.eye(nd, Theta.shape[1], nx)  # d+ = d
    Theta = np.insert(Theta, [nx] * nd, keep, axis=0)
    return Lure(Theta, nx + nd, nu, form.nw, form.sigma)


def closed(form, moved):
    """Return the loop u = phi^-1(v, s) (eq. loop).

    Parameters
    ----------
    form : Lure
        Form whose v is u, plus neurons and what does not depend on u.
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    loop : Lure
        Form with the inputs of the given one, v in the place of those that are moved,
        and the channels [y; u], all inputs of the plant. Neurons of v that see u then
        see each other (`implicit`).
    """
    u, gain = form.nx + moved, input_gain(form, moved)[:, None]
    v = virtual(form, moved)
    to_u = -form.Theta[v] / gain  # u = (v - h) / gain
    to_u[:, u] = np.diag(1 / gain[:, 0])
    Theta = np.delete(form.Theta, v, axis=0)
    Theta = np.insert(Theta, [v.start] * form.nu, only_input(form), axis=0)
    by_u = Theta[:, u].copy()
    Theta[:, u] = 0.0
    size = np.abs(Theta) + np.abs(by_u) @ np.abs(to_u)
    Theta += by_u @ to_u
    # what only rounding leaves where u takes back what made v is zero: neurons that
    # see each other so little would have to be solved
    E = np.s_[v.start + form.nu :, form.nx + form.nu : -1]
    tiny = (Theta[E] != 0) & (np.abs(Theta[E]) <= ROUNDING * size[E])
    Theta[E] = np.where(tiny, 0.0, Theta[E])
    return Lure(Theta, form.nx, form.nu, form.nw, form.sigma)


def driven(loop, moved):
    """Return the form of a plant that v drives, behind its law.

    Parameters
    ----------
    loop : Lure
        Form of `closed`, with the channels [y; u].
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    form : Lure
        The same with the channels [y; v], v being its inputs that are moved.
    """
    u = loop.nx + loop.nz - loop.nu  # of which only those that are moved stay
    given = np.setdiff1d(np.arange(loop.nu), moved)
    Theta = np.delete(loop.Theta, u + given, axis=0)
    form = Lure(Theta, loop.nx, loop.nu, loop.nw, loop.sigma)
    return with_virtual(form, only_input(form, moved))


def ahead(form, law, seen, moved):
    """Return the forms of a plant whose law sees what its linear part will do.

    Parameters
    ----------
    form : Lure
        Form of a plant.
    law : Lure
        Its v as a static map of [s; d; u], u the inputs that are moved.
    seen : ndarray of shape (ns, nx + nd + n_moved)
        What stands for s: a linear map of [x; d; v] (eq. middle).
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    form : Lure
        The same states and outputs; v solves v = phi(u, s) with s of `seen`, by
        neurons of its own, the first ones, that see each other.
    law : Lure
        This v as a static map of [x; d; u].
    """
    nx, nu, nw, nh, nv = form.nx, form.nu, form.nw, law.nw, len(moved)
    ns, given = len(seen), np.setdiff1d(np.arange(nu), moved)
    nd = len(given)
    by_x, by_d, by_v = np.split(seen, [nx, nx + nd], axis=1)
    known = np.hstack([by_x, by_d, np.zeros((ns, nv + nh + 1))])  # [x; d; u; w_h; 1]

    def with_v(rows, v):
        by_s, rest = np.split(rows, [ns], axis=1)
        rest = np.hstack([np.zeros((len(rows), nx)), rest])
        return rest + by_s @ (known + by_v @ v)

    nothing = np.zeros((nv, known.shape[1]))
    direct = np.eye(nv) - law.rows_z[:, :ns] @ by_v
    v = np.linalg.solve(direct, with_v(law.rows_z, nothing))
    static = np.vstack([v, with_v(law.rows_v, v)])
    columns = np.r_[:nx, nx + given, nx + moved, nx + nu : nx + nu + nh, -1]
    Theta = np.insert(form.Theta, [nx + nu] * nh, 0.0, axis=1)
    rows = virtual(form, moved)
    own = np.zeros((nv + nh, Theta.shape[1]))
    own[:, columns] = static
    Theta = np.vstack([Theta[: rows.start], own, Theta[rows.stop :]])
    return (
        Lure(Theta, nx, nu, nh + nw, (*law.sigma, *form.sigma)),
        Lure(static, 0, nx + nd + nv, nh, law.sigma),
    )


def part(form, neurons, nz=None, nu=None):
    """Return the form with some of its neurons, channels and inputs.

    Parameters
    ----------
    form : Lure
        Form.
    neurons : ndarray of int
        The neurons that stay, in their new order.
    nz, nu : int or None, default=None
        How many channels and inputs stay, the first ones; None means all.

    Returns
    -------
    form : Lure
        The same for all that does not depend on the others.
    """
    nx, nz, nu = form.nx, form.nz if nz is None else nz, form.nu if nu is None else nu
    rows = np.r_[: nx + nz, nx + form.nz + neurons]
    columns = np.r_[: nx + nu, nx + form.nu + neurons, -1]
    sigma = tuple(form.sigma[i] for i in neurons)
    return Lure(form.Theta[np.ix_(rows, columns)], nx, nu, len(neurons), sigma)


def observed(form, moved):
    """Return the form with the channels [y; v; omega; eta] (eq. eta).

    Parameters
    ----------
    form : Lure
        Form of a plant.
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    form : Lure
        The same with what the linear part lacks as further channels.
    """
    # x+ - A x - B dv - G dd and y - C x - D dv - H dd are rows of Theta, whatever
    # made them; what is linear in x and d is A, C, G, H, also where it went through v
    nx, v = form.nx, virtual(form, moved)
    signals, made_v = form.Theta[: v.start], form.Theta[v]
    by_v = form.Theta[: v.start, nx + moved] / input_gain(form, moved)
    rest = signals - by_v @ made_v
    rest[:, :nx] = 0.0
    rest[:, np.setdiff1d(np.arange(nx, nx + form.nu), nx + moved)] = 0.0
    # what only rounding leaves of B h is zero
    size = np.abs(signals) + np.abs(by_v) @ np.abs(made_v)
    rest[np.abs(rest) <= ROUNDING * size] = 0.0
    Theta = np.vstack([form.rows_x, form.rows_z, rest, form.rows_v])
    return Lure(Theta, nx, form.nu, form.nw, form.sigma)


def input_gain(form, moved):
    """Return what v has of u alone, besides neurons.

    Parameters
    ----------
    form : Lure
        Form of a plant.
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    gain : ndarray of shape (n_moved,)
        Diagonal of dv/du without neurons: one where v = u + h(s).
    """
    return form.Theta[virtual(form, moved)][:, form.nx + moved].diagonal()


def at_once(form, moved):
    """Return the names of what brings inputs to y within a sample.

    Parameters
    ----------
    form : Lure
        Form of a plant.
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    names : str
        Those of D, H and k that are not zero, such as "D and k".
    """
    rows = form.Theta[form.nx : virtual(form, moved).start, form.nx :]
    by_u, rest = np.split(rows, [form.nu], axis=1)
    by_d = np.delete(by_u, moved, axis=1)
    parts = {"D": by_u[:, moved], "H": by_d, "k": rest}
    return " and ".join(name for name, part in parts.items() if np.any(part))


def virtual(form, moved):
    """Return the rows of Theta that make v.

    Parameters
    ----------
    form : Lure
        Form of a plant.
    moved : ndarray of int
        Inputs that v makes.

    Returns
    -------
    rows : slice
        The last channels, one for every input that is moved.
    """
    stop = form.nx + form.nz
    return slice(stop - len(moved), stop)


def with_virtual(form, rows):
    """Return a form with other rows for v.

    Parameters
    ----------
    form : Lure
        Form of a plant.
    rows : ndarray of shape (n_moved, n_columns)
        What makes v.

    Returns
    -------
    form : Lure
        The new form.
    """
    Theta = form.Theta.copy()
    Theta[virtual(form, rows)] = rows
    return Lure(Theta, form.nx, form.nu, form.nw, form.sigma)


def only_input(form, inputs=None):
    """Return the rows of a channel that is inputs themselves.

    Parameters
    ----------
    form : Lure
        Form.
    inputs : ndarray of int or None, default=None
        Numbers of inputs; None means all.

    Returns
    -------
    rows : ndarray of shape (n_inputs, n_columns)
        Rows of Theta.
    """
    rows = np.eye(form.nu, form.Theta.shape[1], form.nx)
    return rows if inputs is None else rows[inputs]

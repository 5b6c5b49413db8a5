"""Continuous time: one step of Runge and Kutta of a Lur'e form is a Lur'e form.

A structure whose updates are derivatives,

    x' = f(x, u),      y = c(x, u)                                    (eq. derivative)

becomes one of x_k at the samples by m steps of the classical method of fourth order
from one sample to the next (eq. rk4).  Every stage is an instance of the equations with
neurons of its own and shared parameters; the states in between, and their derivatives,
are neurons that pass on what they see.  Time counts in samples, so that parameters of
derivatives are those per second times the sampling time.

What u does between two samples is part of the model: it stays what it was ("zoh", a
computer), or goes on to the next sample along a line or a cubic spline (measured
signals).  Its values in between are further inputs (`between`).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from .instances import IDENTITY, instance, passed_on
from .structures import Signal, Structure, Term

HOLDS = ("zoh", "linear", "cubic")
FASTEST = 2.5  # |pole| times a step of Runge and Kutta: within its stability, 2.78
DEFECTIVE = 1e8  # condition of eigenvectors from which they are of no use
ALTERNATING = 0.8  # rate of a mode in place of one that has none
APART = 1e-6  # by which eigenvalues are parted then, relative to A
ROUNDING = 1e-9  # relative imaginary part of a real eigenvalue
LEAST_DECAY = 1e-3  # of a state per sample, of what is `damped`
STAGES = (0.0, 0.5, 0.5, 1.0)  # of a step, where the derivative is evaluated
WEIGHTS = (1 / 6, 1 / 3, 1 / 3, 1 / 6)


@dataclass(frozen=True, eq=False)
class Sampling:
    """Say how a structure was sampled.

    Parameters
    ----------
    derivative : Structure
        Equations of the derivatives.
    hold : {"zoh", "linear", "cubic"}
        What u does between samples.
    substeps : int
        Steps of Runge and Kutta per sample.
    dt : float
        Sampling time, in seconds.
    """

    derivative: Structure
    hold: str = "zoh"
    substeps: int = 1
    dt: float = 1.0


def sampled(structure, hold="zoh", substeps=1, dt=1.0):
    """Return the map from sample to sample of equations of derivatives (eq. rk4).

    Parameters
    ----------
    structure : Structure
        Equations whose updates are derivatives, time in samples.
    hold : {"zoh", "linear", "cubic"}, default="zoh"
        What u does between samples.
    substeps : int, default=1
        Steps of Runge and Kutta per sample.
    dt : float, default=1.0
        Sampling time, in seconds, for those who ask.

    Returns
    -------
    structure : Structure
        The map, with the same parameters. Unless `hold` is "zoh" its inputs are those
        of the structure and, behind them, what `between` returns.
    """
    inputs = structure.inputs
    sizes, layers = dict(structure.sizes), dict(structure.layers)
    signals, activations = dict(structure.signals), dict(structure.activations)
    nodes = [dict(zip(inputs, inputs, strict=True))]
    for i in range(1, 2 * substeps + 1):
        nodes.append(
            {u: u if hold == "zoh" else f"{u}@{i}/{2 * substeps}" for u in inputs}
        )

    def keep(axis, value):
        # neurons that pass on what they see: computed once, seen by many
        sizes[axis], layers[axis] = value.size, passed_on(value, axis)
        activations[axis] = IDENTITY
        return Signal(value.axes, value.shape, (Term(axis),))

    axes = {x: structure.updates[x].axes for x in structure.updates}
    base = {
        x: Signal(axes[x], (structure.sizes[x],), (Term(x),)) for x in structure.updates
    }
    for step in range(substeps):
        slopes: list[dict] = []
        for c, at in zip(STAGES, (0, 1, 1, 2), strict=True):
            tag, updates = f"{step + 1}.{len(slopes) + 1}", structure.updates
            if step or slopes:
                given = dict(nodes[2 * step + at])
                for x, start in base.items():
                    value = start + (c / substeps) * slopes[-1][x] if slopes else start
                    given[x] = keep(f"{x}@{tag}", value).terms[0].cols
                own = instance(structure, tag, given)
                updates = own.updates
                sizes |= own.sizes
                layers |= own.layers
                signals |= own.signals
                activations |= own.activations
            slopes.append({x: keep(f"d{x}@{tag}", f) for x, f in updates.items()})
        for x in base:
            for weight, slope in zip(WEIGHTS, slopes, strict=True):
                base[x] = base[x] + (weight / substeps) * slope[x]
    if hold != "zoh":
        for node in nodes[1:]:
            sizes |= {name: structure.sizes[u] for u, name in node.items()}
            inputs = (*inputs, *node.values())
    return replace(
        structure,
        sizes=sizes,
        inputs=inputs,
        updates=base,
        layers=layers,
        signals=signals,
        activations=activations,
        sampling=Sampling(structure, hold, substeps, dt),
    )


def between(u, hold, substeps=1):
    """Return what an input does between the samples.

    Parameters
    ----------
    u : ndarray of shape (N, nu)
        Inputs of one experiment at the samples.
    hold : {"zoh", "linear", "cubic"}
        What they do in between.
    substeps : int, default=1
        Steps of Runge and Kutta per sample.

    Returns
    -------
    nodes : ndarray of shape (N, 2 * substeps * nu)
        Values 1, 2, ... of 2 m parts of a sample behind each; no columns for "zoh".
        Behind the last sample u goes on as it did, which no output sees.
    """
    N = len(u)
    if hold == "zoh":
        return np.empty((N, 0))
    u = np.vstack([u, u[-1:] + (u[-1:] - u[max(N - 2, 0) : N - 1] if N > 1 else 0.0)])
    k = np.arange(N + 1)
    if hold == "cubic" and N > 2:
        curve = CubicSpline(k, u)
        parts = [curve(k[:-1] + i / (2 * substeps)) for i in range(1, 2 * substeps + 1)]
    else:
        shares = np.arange(1, 2 * substeps + 1) / (2 * substeps)
        parts = [(1 - s) * u[:-1] + s * u[1:] for s in shares]
    return np.hstack(parts)


def derivative(structure):
    """Return the equations that were sampled.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    structure : Structure
        That of the derivatives; the structure itself if time is discrete.
    """
    sampling = structure.sampling
    return structure if sampling is None else sampling.derivative


def flow(structure):
    """Return the map of a structure from a state and inputs to the next state.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    flow : Structure
        The same parameters, without memory: the states are further inputs, behind the
        others, and what is measured is the next state, "x+".
    """
    (state, update), *_ = structure.updates.items()
    name = f"{state}+"
    return replace(
        structure,
        sizes={**structure.sizes, name: structure.sizes[state]},
        inputs=(*structure.inputs, state),
        updates={},
        signals={name: update, **structure.signals},
        channels=(name,),
    )


def held(structure, substeps=None):
    """Return the view of a structure whose inputs a computer holds.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    substeps : int or None, default=None
        Steps of Runge and Kutta per sample; None leaves their number.

    Returns
    -------
    structure : Structure
        The same equations, sampled with "zoh"; the structure itself if time is
        discrete.
    """
    sampling = structure.sampling
    if sampling is None:
        return structure
    substeps = substeps or sampling.substeps
    view = sampled(sampling.derivative, "zoh", substeps, sampling.dt)
    return view.observe(*structure.channels)


def with_nodes(structure, experiments):
    """Return the experiments of a structure: what u does between samples is an input.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    experiments : sequence of tuple of array
        Pairs (u, y) of scaled deviations.

    Returns
    -------
    experiments : list of tuple of array
        Pairs ([u, nodes], y); as they came where u is held.
    """
    sampling = structure.sampling
    if sampling is None or sampling.hold == "zoh":
        return list(experiments)
    how = sampling.hold, sampling.substeps
    return [(np.hstack([u[:], between(u[:], *how)]), y) for u, y in experiments]


def per_second(structure, p):
    """Return parameters of derivatives by seconds instead of samples.

    Parameters
    ----------
    structure : Structure
        Structure of a model.
    p : dict of str to ndarray
        Parameters by name, time in samples.

    Returns
    -------
    p : dict of str to ndarray
        The same, those in front of derivatives divided by dt; as they came if time is
        discrete.
    """
    if structure.sampling is None:
        return p
    dt = structure.sampling.dt
    changed = {name: p[name] / dt for name in leading(structure) if name in p}
    return {**p, **changed}


def leading(structure):
    """Return the parameters that the updates of a structure begin with.

    Parameters
    ----------
    structure : Structure
        Structure of a model.

    Returns
    -------
    names : set of str
        Their names.

    Raises
    ------
    ValueError
        If a term of an update begins otherwise: it had no unit of time to change.
    """
    structure = derivative(structure)

    def first(term):
        if not term.factors and term.cols in structure.signals:
            inner = structure.signals[term.cols].terms
            return set().union(*map(first, inner))
        return {structure.leading(term)}

    names = set()
    for update in structure.updates.values():
        names |= set().union(*map(first, update.terms))
    if None in names:
        raise ValueError(
            "Every term of a derivative must begin with a parameter, which carries the "
            "unit of time, got one that does not. Put a parameter in front of it, or "
            "take time='discrete'."
        )
    return names


def _modes(A):
    """Return eigenvalues, their logarithms, and eigenvectors (eq. d2c).

    Eigenvalues that decay faster than `FASTEST` become real ones of that rate. Negative
    ones, which alternate from sample to sample and have no logarithm, decay by
    `ALTERNATING`.
    """
    values, vectors = np.linalg.eig(A)
    if np.linalg.cond(vectors) > DEFECTIVE:  # part eigenvalues that are one
        spread = APART * np.arange(len(A)) * max(1.0, np.abs(A).max())
        values, vectors = np.linalg.eig(A + np.diag(spread))
    least = np.exp(-FASTEST)
    alternates = is_alternating(values)
    is_fast = (np.abs(values) < least) | alternates
    logarithm = np.log(np.where(is_fast, least, values).astype(complex))
    size = np.abs(logarithm)
    logarithm *= np.minimum(1.0, FASTEST / np.maximum(size, FASTEST))
    return values, np.where(alternates, -ALTERNATING, logarithm), vectors


def is_alternating(poles, least=ROUNDING):
    """Tell which poles alternate from sample to sample, as no sampled ones do.

    Parameters
    ----------
    poles : ndarray of shape (n,)
        Eigenvalues of a discrete state matrix.
    least : float, default=1e-9
        Modulus from which they count.

    Returns
    -------
    is_alternating : ndarray of shape (n,)
        Whether a pole is real and negative.
    """
    is_real = np.abs(np.imag(poles)) <= ROUNDING * np.abs(poles)
    return is_real & (np.real(poles) < -least)


def is_resolved(A, substeps, slack):
    """Tell whether steps of Runge and Kutta have the poles of a state matrix.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix of derivatives, time in samples.
    substeps : int
        Steps per sample.
    slack : float
        Relative error of a pole that is accepted.

    Returns
    -------
    is_resolved : bool
        Whether the logarithm of a step, R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24, is z for
        all poles z.
    """
    z = np.linalg.eigvals(A).astype(complex) / substeps
    z = z[np.abs(z) > ROUNDING]
    R = 1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))
    with np.errstate(divide="ignore"):
        return bool(np.all(np.abs(np.log(R) - z) <= slack * np.abs(z)))


def converted(structure, p, hold="zoh"):
    """Return parameters of derivatives near those from sample to sample (eq. d2c).

    Parameters
    ----------
    structure : Structure
        Equations with a state matrix A.
    p : dict of str to ndarray
        Parameters of the same equations as updates from sample to sample.
    hold : {"zoh", "linear", "cubic"}, default="zoh"
        What u does between samples.

    Returns
    -------
    p : dict of str to ndarray
        Parameters of the derivatives, time in samples.

    Notes
    -----
    What is held over a sample enters by the integral of expm(A s), s from 0 to 1. What
    goes on smoothly enters a discrete model as if A_d stood in front of it: near a
    pole, z - exp(s_i) is exp(s_i) (s - s_i). What enters a mode that alternates keeps
    its response at rest.
    """
    values, logarithm, vectors = _modes(p["A"])
    if hold == "zoh":
        # s / (exp(s) - 1), which is 1 at s = 0
        size = np.where(np.abs(logarithm) > ROUNDING, logarithm, ROUNDING)
        gain = size / np.expm1(size)
    else:
        gain = np.exp(-logarithm)
    np.divide(logarithm, values - 1, out=gain, where=is_alternating(values))
    inverse = np.linalg.inv(vectors)
    gain, A = (np.real(vectors * modes @ inverse) for modes in (gain, logarithm))
    changed = {name: gain @ p[name] for name in leading(structure) if name in p}
    return {**p, **changed, "A": A}


def damped(A, substeps=1):
    """Return a state matrix of derivatives whose states decay, step by step.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix, time in samples.
    substeps : int, default=1
        Steps of Runge and Kutta per sample.

    Returns
    -------
    A : ndarray of shape (nx, nx)
        The matrix itself if its states decay at a least rate and not faster than steps
        can follow; else one shifted to that rate, and scaled down.
    """
    rate = np.linalg.eigvals(A).real.max(initial=-np.inf)
    A = A - max(rate + LEAST_DECAY, 0.0) * np.eye(len(A))
    modulus = np.abs(np.linalg.eigvals(A)).max(initial=0.0)
    return A / max(modulus / (FASTEST * substeps), 1.0)


def can_be_stepped(A, substeps):
    """Tell whether steps of Runge and Kutta decay where the solution does.

    Parameters
    ----------
    A : ndarray of shape (nx, nx)
        State matrix of derivatives, time in samples.
    substeps : int
        Steps per sample.

    Returns
    -------
    can_be_stepped : bool
        Whether no pole is faster than `FASTEST` per step.
    """
    modulus = np.abs(np.linalg.eigvals(A)).max(initial=0.0)
    return bool(modulus <= FASTEST * substeps * (1 + ROUNDING))

"""The loop of a model, as a second run of the same equations (eq. twin).

The equations of a model stand twice in one structure, with the same parameters: once
for the record, and once for the loop u = v - h(s), which the recorded input drives as
its v.  Names of the second run end in `LOOP`.
"""

from dataclasses import replace

from .structures import Factor, Matrix, Signal, Term

LOOP = "'"
GIVEN = Factor("S_d")  # what it takes of u, no law moves: it is that of the record


def looped(structure, share=1.0):
    """Return the equations of a model beside those of its loop.

    The states of the loop begin at zero.

    Parameters
    ----------
    structure : Structure
        Structure of a model with g and a sum v = u + h(s), of which y = C x.
    share : float, default=1.0
        Share of g that acts on the states of the loop. With zero they are those of the
        linear response to v, along which g is asked.

    Returns
    -------
    structure : Structure
        The same parameters, and signals of the loop: y', e', h' and so on, and u',
        all inputs of the plant there.

    Examples
    --------
    >>> import numpy as np
    >>> from alssnn.looped import looped
    >>> from alssnn.models import state_space
    >>> structure = state_space(2, 1, 1, n_h=3, n_g=2, C=np.eye(1, 2))
    >>> both = looped(structure).observe("y", "e'")
    >>> both.nx, both.n_params == structure.n_params
    (6, True)
    """
    u = structure.inputs[0]
    names = {*structure.updates, *structure.layers, *structure.signals, u}
    updates = _renamed(structure.updates, names)
    layers = _renamed(structure.layers, names)
    signals = _renamed(structure.signals, names)
    h, v = structure.signals["h"], structure.signals["v"]
    # by the law, h' takes away what h' adds
    signals[f"v{LOOP}"] = replace(v, terms=tuple(t for t in v.terms if t.cols != "h"))
    taken = Signal(h.axes, h.shape, (Term(f"h{LOOP}"),))
    if len(structure.given):  # only of what a controller moves
        axes = h.axes[0], u
        shape = tuple(structure.sizes[axis] for axis in axes)
        taken = Matrix(axes, shape, (Term("", (Factor("S_m"),)),)).T @ taken
    size = structure.sizes[u]
    signals[f"{u}{LOOP}"] = Signal((u,), (size,), (Term(u),)) - taken
    x = f"{next(iter(structure.updates))}{LOOP}"
    terms = (t for t in updates[x].terms if share or t.cols != f"g{LOOP}")
    updates[x] = replace(
        updates[x],
        terms=tuple(
            replace(t, gain=share * t.gain) if t.cols == f"g{LOOP}" else t
            for t in terms
        ),
    )
    sizes = {f"{name}{LOOP}": structure.sizes[name] for name in names}
    activations = {
        f"{name}{LOOP}": sigma
        for name, sigma in structure.activations.items()
        if name in names
    }
    return replace(
        structure,
        sizes=structure.sizes | sizes,
        updates=structure.updates | updates,
        layers=structure.layers | layers,
        signals=structure.signals | signals,
        activations=structure.activations | activations,
    )


def _renamed(equations, names):
    """Return equations of the loop, where it has signals of its own."""
    return {
        f"{axis}{LOOP}": replace(
            value,
            terms=tuple(
                replace(t, cols=f"{t.cols}{LOOP}")
                if t.cols in names and GIVEN not in t.factors
                else t
                for t in value.terms
            ),
        )
        for axis, value in equations.items()
    }
